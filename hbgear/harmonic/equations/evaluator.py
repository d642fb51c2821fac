"""Evaluation of a model at one set of parameters: residual and Jacobian, forces, switching times, truncation error.

The residual is that of `hbgear.harmonic.equations.assembly_kernels`. Laws without exact projection are evaluated by AFT
(alternating frequency/time), see `hbgear.harmonic.forces.aft`.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.lru_cache import LRUCache
from hbgear.harmonic.forces.aft import SampledLaws, SampledVectorLaws
from hbgear.harmonic.forces.breakpoints import Resolution, gap, piecewise_excitation
from hbgear.harmonic.forces.damped_contacts import DampedContacts
from hbgear.harmonic.forces.packed_laws import pack_laws
from hbgear.harmonic.forces.packed_model import PackedModel, sliders_of, user_laws_of
from hbgear.harmonic.instants.equations import Equations
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.harmonic.structure.modes import ModalBlocks, flexibilities, modal_blocks
from hbgear.harmonic.structure.receptance import LinearPart, Receptance
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.mesh_contacts import contacts_of
from hbgear.mechanics.laws.vector_laws import Component, vector_groups
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series, Transform, places, spread

PythonForces = SampledLaws | SampledVectorLaws | DampedContacts
"""Forces of laws that kernels do not evaluate."""


class Crossings(NamedTuple):
    """Switching times: phases at which elements cross breakpoints of their laws.

    Attributes
    ----------
    row : ndarray, shape (R,)
        Number of the breakpoint, counted over all elements.
    theta : ndarray, shape (R,)
        Basis phase in [0, 2 pi] [rad], ascending for each breakpoint.
    sign : ndarray, shape (R,)
        +1 for a crossing upwards, -1 downwards.
    """

    row: np.ndarray
    theta: Array
    sign: np.ndarray


class Evaluator:
    """A model at one parameter set, with the data that its evaluations share.

    Parameters
    ----------
    system : System
        System of the model at these parameters.
    structure : LinearStructure
        Its linear structure.
    H, nu : int
        Number of harmonics of the basis, and its subharmonic order.
    sampled : bool
        Whether piecewise-linear laws are evaluated by AFT too.
    transform : Transform
        Fourier transform with N samples per basis period.
    reduce : bool, optional
        Whether stability may leave out modes far above the frequencies of the motion. True by default.
    orders : ndarray, optional
        Basis harmonics that are unknowns, including 0; all up to H by default.

    Attributes
    ----------
    receptance : Receptance
        Linear part of the balance.
    laws : tuple of Law
        Laws of the elements.
    packed : PackedModel
        Arrays for kernels.
    python_forces : tuple of SampledLaws, SampledVectorLaws or DampedContacts
        Forces that Python adds, because the kernels cannot: laws evaluated by AFT, and damped contacts.
    aft_laws : tuple of (int, Law)
        Laws evaluated by AFT, in Python or compiled, with the numbers of their elements; slopes have no closed form.
    vectors : tuple of (ndarray, VectorLaw)
        Laws of several displacements, each with the numbers of its elements.
    damped : tuple of (int, Law)
        Laws whose force jumps (`Law.damped`), each with the number of its element.
    sliders, user_laws : int
        Number of friction sliders, and of compiled laws of the user.
    normal_pairs : tuple of (int, int)
        Elements with friction whose limit is proportional to the force of another element, and this element.
    breakpoints, element, displacement : ndarray, shape (K,)
        Breakpoints of all laws, the element of each, and the displacement of which it is a value.
    """

    def __init__(
        self,
        system: System,
        structure: LinearStructure,
        H: int,
        nu: int,
        sampled: bool,
        transform: Transform,
        reduce: bool = True,
        orders: np.ndarray | None = None,
    ) -> None:
        self.system, self.structure = system, structure
        self.receptance = Receptance(structure, system, H, nu, orders)
        self.orders = self.receptance.k
        self.laws: tuple[Law, ...] = tuple(e.law for e in system.elements)
        self.H, self.nu, self.N, self.reduce, self.is_sampled = H, nu, transform.N, reduce, sampled
        self._transform = transform
        packing = pack_laws(self.laws, sampled, nu)
        self.damped = tuple((int(j), self.laws[j]) for j in packing.unpacked if self.laws[j].damped)
        self.vectors = vector_groups(self.laws)
        scalar = [j for j in packing.unpacked if not (self.laws[j].damped or isinstance(self.laws[j], Component))]
        laws, aft_elements = packing.table, np.array(scalar, dtype=int)
        user_laws, sliders = user_laws_of(self.laws), sliders_of(system.elements, nu, H)
        coupled = [j for elements, _ in self.vectors for j in elements]
        self.aft_laws = tuple((int(j), self.laws[j]) for j in (*aft_elements, *user_laws.element, *coupled))
        linear = self.receptance.packed
        known, truncated = (tuple(k.tolist()) for k in (linear.orders, linear.truncated_orders))
        resolution = Resolution(H, nu, self.N if self.aft_laws else 0, known, truncated)
        self.piecewise = piecewise = piecewise_excitation(system.elements, packing, resolution)
        self.sliders, self.user_laws = len(sliders.element), len(user_laws.element)
        is_plain = not (len(piecewise.phases) or packing.levels or self.sliders or self.user_laws)
        tables = (None, None, None) if is_plain else (piecewise, user_laws, sliders)
        self.packed = PackedModel(laws, linear, transform.basis, *tables)
        normal = zip(sliders.element.tolist(), sliders.normal.tolist(), strict=True)
        self.normal_pairs = tuple(dict.fromkeys(pair for pair in normal if pair[1] >= 0))
        self.python_forces: tuple[PythonForces, ...] = ()
        if aft_elements.size:
            self.python_forces += (SampledLaws(self.laws, aft_elements, transform, nu, piecewise.grid, sampled),)
        if self.vectors:
            self.python_forces += (SampledVectorLaws(self.vectors, transform, nu),)
        if self.damped:
            self.python_forces += (DampedContacts(self.laws, nu),)
        self.breakpoints = laws.level[: packing.public_count]
        self.displacement = laws.owner[: packing.public_count]
        self.element = laws.element[self.displacement]
        self._linear: tuple[float, LinearPart] | None = None
        self._mode_cache: LRUCache[ModalBlocks] = LRUCache(32)
        self._at_speed: LRUCache[Evaluator] = LRUCache(16)

    @property
    def m(self) -> int:
        """Number of elements."""
        return len(self.laws)

    @property
    def retained(self) -> ComplexArray:
        """Harmonics (H + 1, m) of the prescribed displacements with breakpoints that are unknowns, zero of others."""
        return self.piecewise.retained[:, : self.m]

    @property
    def is_fully_compiled(self) -> bool:
        """Whether kernels evaluate the whole model without Python."""
        return not self.python_forces and self.structure.accurate_modes

    def at(self, Omega: float) -> Evaluator:
        """Return the evaluator with the structure at Omega, which has modes; itself without speed terms."""
        if not self.structure.depends_on_speed:
            return self
        structure = self.structure.at(Omega)
        return self._at_speed.get(
            Omega,
            lambda: Evaluator(
                structure.system, structure, self.H, self.nu, self.is_sampled, self._transform, self.reduce, self.orders
            ),
        )

    @cached_property
    def contact_equations(self) -> Equations:
        """Equations of the exact motion between switching times; see `hbgear.harmonic.instants`.

        Raises
        ------
        NotPiecewiseLinear
            If a law is not piecewise linear.
        """
        return Equations(self.system, self.nu)

    @cached_property
    def reference_sign(self) -> int:
        """Sign of the structure with its reference springs in the parity check of the multiplier +1, see `parity`.

        0 if it is unknown: the structure has no modes, depends on speed, or has dependent element directions.
        """
        structure = self.structure
        if structure.depends_on_speed or structure.modes is None or structure.constrained:
            return 0
        poles, stiffness = structure.modes.poles, self.receptance.at(1.0).Z[0].real
        unstable = np.count_nonzero((poles.real > 0) & (np.abs(poles.imag) <= 1e-12 * np.abs(poles)))
        sign, log = np.linalg.slogdet(stiffness + np.diag(self.packed.linear.springs[0]))
        return int(sign) * (1 - 2 * (int(unstable) % 2)) if np.isfinite(log) else 0

    def stability_modes(self, reach: float = math.inf, lumped: bool = False) -> ModalBlocks:
        """Return the modes for the variational equation; above ``reach`` as flexibility or lumped, see `modes`."""
        return self._mode_cache.get((reach, lumped), lambda: self._build_stability_modes(reach, lumped))

    def _build_stability_modes(self, reach: float, lumped: bool) -> ModalBlocks:
        modes = self.structure.modes
        assert modes is not None
        kinds = [(e.law, e.damping, f"{k:.9e}") for e, k in zip(self.system.elements, self.structure.kr, strict=True)]
        groups = [kinds.index(kind) for kind in kinds]  # slopes are relative to the springs, equal up to rounding
        return modal_blocks((modes.poles, modes.output, modes.input), np.array(groups), reach, lumped)

    def flexibility_above(self, frequencies: Array) -> Array:
        """Return the flexibility (P, m) of the elements from modes above frequencies (P,)."""
        sizes, residual = self._flexibilities
        return residual[np.searchsorted(sizes, frequencies, side="right")]

    @cached_property
    def _flexibilities(self) -> tuple[Array, Array]:
        modes = self.structure.modes
        assert modes is not None
        return flexibilities(modes.poles, modes.output, modes.input)

    def linear(self, Omega: float) -> LinearPart:
        """Return the linear part at Omega; the last one is cached for Newton's method at fixed Omega."""
        cached = self._linear
        if cached is None or cached[0] != Omega:
            self._linear = cached = (Omega, self.receptance.at(Omega))
        return cached[1]  # another thread may have replaced self._linear meanwhile

    def linearise(self, X: Array, Omega: float) -> tuple[Array, Array, Array, float]:
        """Return R (n,), dR/dX (n, n), dR/dOmega (n,) and the size of the terms of R at a motion X (n,)."""
        return self.linearise_with(X, Omega, self.linear(Omega))

    def linearise_with(self, X: Array, Omega: float, linear: LinearPart) -> tuple[Array, Array, Array, float]:
        """Return `linearise` with a given linear part and its derivative."""
        from hbgear.harmonic.equations.assembly_kernels import tie

        R, J, dR, size = self._balance(X, Omega, linear)
        if self.structure.constrained:
            tie(self.packed.linear, writable(X), R, J, dR)
        return R, J, dR, size

    def _balance(self, X: Array, Omega: float, linear: LinearPart) -> tuple[Array, Array, Array, float]:
        """Return `linearise` without constraints between elements."""
        from hbgear.harmonic.equations.assembly_kernels import assemble_allocating

        n = self.length(X)
        R, J, dR = np.empty(n), np.empty((n, n)), np.empty(n)
        size = assemble_allocating(self.packed, writable(X), Omega / self.nu, *linear, R, J, dR)
        for forces in self.python_forces:
            size += self._add_python(forces, X, Omega, R, J, dR)
        return R, J, dR, size

    def _add_python(self, forces: PythonForces, X: Array, Omega: float, R: Array, J: Array, dR: Array) -> float:
        """Add the forces and slopes of laws in Python, which have all harmonics; return the norm of the forces."""
        n = self.m * (2 * self.H + 1)
        if n == len(R):
            return forces.add_to(X.reshape(self.m, -1), Omega, R, J, dR)
        full = np.zeros(n), np.zeros((n, n)), np.zeros(n)
        forces.add_to(self.spread(X).reshape(self.m, -1), Omega, *full)
        selected = (np.arange(self.m)[:, None] * (2 * self.H + 1) + places(self.orders)).ravel()
        R += full[0][selected]
        J += full[1][np.ix_(selected, selected)]
        dR += full[2][selected]
        return float(np.linalg.norm(full[0][selected]))

    def spread(self, X: Array) -> Array:
        """Return motions (..., n) with all harmonics 0..H, (..., m (2H + 1)); unchanged if they have 0..H or 0..2H."""
        full = self.m * (2 * self.H + 1)
        if X.shape[-1] == full or X.shape[-1] == self.m * (4 * self.H + 1):
            return writable(X)
        self.length(X)
        return spread(X, self.m, self.orders, self.H).reshape(*X.shape[:-1], full)

    def length(self, X: Array) -> int:
        """Return the number of unknowns of motions X (..., n); raise an error for another size."""
        n = self.m * (2 * len(self.orders) - 1)
        if X.shape[-1] != n:
            width = "(2H + 1)" if len(self.orders) == self.H + 1 else f"(1 + 2 x {len(self.orders) - 1} orders)"
            raise ValueError(
                f"X of shape {X.shape}: need the unknowns of one motion, {self.m} x {width} = {n} numbers; a Point of "
                "another number of harmonics is converted by problem.from_point(point)"
            )
        return n

    def packed_of(self, X: Array) -> PackedModel:
        """Return the arrays for kernels, for motions X with all harmonics up to H, or up to 2H."""
        if X.shape[-1] == self.m * (2 * self.H + 1):
            return self.packed
        return self.packed._replace(basis=self._transform.wider.basis)

    def curvature(self, X: Array, v: Array, h: float, Omega: float) -> tuple[Array, Array]:
        """Return derivatives (n, n) of dR/dX along v, by a central difference, and in Omega; not for AFT laws."""
        from hbgear.harmonic.equations.assembly_kernels import sum_forces

        n, K, m = self.length(X), len(self.orders), self.m
        zero, Z = LinearPart.zero(K, m), self.linear(Omega).matrices[1]
        dJ_dv = (self._balance(X + h * v, Omega, zero)[1] - self._balance(X - h * v, Omega, zero)[1]) / (2 * h)
        blocks = np.zeros((m, 2 * K - 1, m, 2 * K - 1))
        blocks[:, 0, :, 0] = Z[0].real
        a, b = np.arange(1, 2 * K - 1, 2), np.arange(2, 2 * K, 2)
        blocks[:, a, :, a] = blocks[:, b, :, b] = Z[1:].real
        blocks[:, a, :, b], blocks[:, b, :, a] = Z[1:].imag, -Z[1:].imag
        dJ_dOmega = blocks.reshape(n, n)
        if self.structure.constrained:
            sum_forces(self.packed.linear, n, dJ_dv)
            sum_forces(self.packed.linear, n, dJ_dOmega)
        return dJ_dv, dJ_dOmega

    def forces(self, X: Array, Omega: float) -> Array:
        """Return the force harmonics (m, 2H + 1) of all laws in the real basis."""
        R, *_ = self._balance(X, Omega, LinearPart.zero(len(self.orders), self.m))
        return self.spread(R).reshape(self.m, -1)

    @cached_property
    def smooth_breakpoints(self) -> list[int]:
        """Numbers of the breakpoints of elements whose displacement is a series: its extrema are smooth."""
        elements = self.system.elements
        smooth = [isinstance(e.displacement, Series) and not contacts_of(e.law) for e in elements]
        return np.flatnonzero(np.array(smooth, dtype=bool)[self.element]).tolist()

    def crossings(self, X: Array) -> Crossings:
        """Return the switching times of a motion."""
        from hbgear.harmonic.forces.projection_kernels import instants

        self.length(X)
        theta, sign, count, _ = instants(self.packed, self.spread(X).reshape(self.m, -1), False)
        is_valid = np.arange(theta.shape[1]) < count[: len(self.breakpoints), None]
        theta, sign = theta[: len(self.breakpoints)], sign[: len(self.breakpoints)]
        return Crossings(np.nonzero(is_valid)[0], theta[is_valid], sign[is_valid].astype(int))

    def gap(self, j: int, row: Array, theta: Array, order: int = 0) -> Array:
        """Return the displacement of element j with coefficients ``row``, or a derivative, at basis phases theta."""
        displacement, retained = self.system.elements[j].displacement, self.piecewise.retained[:, j]
        return gap(displacement, retained, self.nu, row, theta, order)

    def highest(self, j: int, row: Array, side: float) -> tuple[float, float]:
        """Return the largest value of ``side`` times displacement j, of an element with this motion, and its phase."""
        from hbgear.harmonic.forces.piecewise_kernels import highest_gap, sampled_gap

        c, motion = np.empty(len(row) // 2 + 1, dtype=complex), np.empty((2, self.N))
        sampled_gap(self.packed.piecewise, self.packed.basis, writable(row), j, c, motion)
        value, theta = highest_gap(self.packed.piecewise, j, side, c, motion)
        return float(value), float(theta)

    def extrema_and_regime(self, X: Array) -> tuple[Array, np.ndarray]:
        """Return clearances (P, 2 K) and impact regimes (P, m) of motions X (P, n)."""
        from hbgear.harmonic.equations.diagnostic_kernels import extrema

        clearance, regime = np.empty((len(X), 2 * len(self.breakpoints))), np.zeros((len(X), self.m), dtype=np.int8)
        X = self.spread(X)
        extrema(self.packed_of(X), X, clearance, regime)
        return clearance, regime


def writable(X: Array) -> Array:
    """Return a writable contiguous array; kernels would be compiled again for the type of read-only arrays."""
    if X.flags.carray and X.dtype == float:  # faster than the same check in `require`
        return X
    return np.require(X, float, ("C", "W"))


def sampled_laws(evaluator: Evaluator) -> SampledLaws | None:
    """Return the laws of one displacement that are evaluated in Python by AFT, or None."""
    return next((forces for forces in evaluator.python_forces if isinstance(forces, SampledLaws)), None)


def elements_between_breakpoints(evaluator: Evaluator) -> frozenset[int]:
    """Return the elements whose laws are integrated by AFT between the crossings of their breakpoints."""
    laws = sampled_laws(evaluator)
    return laws.divided if laws else frozenset()
