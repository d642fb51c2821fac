"""Linear part of the harmonic balance, condensed to the element coordinates by receptances.

With the reference stiffness kr and the damping c of the elements included in the structure,

    D(w) = K + W kr W^T + i w (C + W c W^T) - w^2 M,      G(w) = W^T D(w)^-1 W   (m x m)

the balance of harmonic k of the element coordinates is, with w = k omega and the force harmonics f_k of the laws,

    Z_k d_k + g_k + f_k = 0,   Z_k = G^-1 - kr,   g_k = G^-1 (e_k - y_k) - (kr + i w c) e_k,   y_k = W^T D^-1 F_k

The solution does not depend on kr, and its size not on the number of coordinates. The structure with its modes is that
of `hbgear.harmonic.structure.linear_structure`. The inverse of G loses digits if many elements act close to each other
on a flexible structure; Z + kr is then computed from the modes with fixed elements,
see `hbgear.harmonic.structure.fixed_interface`.

If directions of elements are linearly dependent, W_b = W_a B, then G is singular. The balance is then written for the
independent elements a under all forces, with constraints for the dependent elements b,

    Z_a,k d_a,k + g_a,k + f_a,k + B (f_b,k - kr_b d_b,k - (kr_b + i w c_b) e_b,k) = 0,   d_b + e_b = B^T (d_a + e_a)

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.packed_model import FreeModes, PackedLinearPart, split_complex
from hbgear.harmonic.structure.fixed_interface import FixedInterface, direct_stiffness
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import stretch, to_complex, to_real


class LinearPart(NamedTuple):
    """Linear part Z_k d_k + g_k of the balance at one frequency.

    Attributes
    ----------
    matrices : ndarray, shape (2, K + 1, m, m)
        Condensed dynamic stiffness Z without the reference springs, and dZ/dOmega, of K + 1 harmonics.
    constants : ndarray, shape (2, K + 1, m)
        Constant terms g from loads and prescribed displacements, and dg/dOmega.
    """

    matrices: ComplexArray
    constants: ComplexArray

    @staticmethod
    def zero(count: int, m: int) -> LinearPart:
        """Return a linear part of zeros for ``count`` harmonics and m elements."""
        return LinearPart(np.zeros((2, count, m, m), dtype=complex), np.zeros((2, count, m), dtype=complex))

    @property
    def Z(self) -> ComplexArray:
        """Dynamic stiffness (K+1, m, m)."""
        return self.matrices[0]

    @property
    def g(self) -> ComplexArray:
        """Constant terms (K+1, m)."""
        return self.constants[0]


class _LoadPart(NamedTuple):
    """Harmonic Omega^power Re(amplitudes exp(i k theta)) of a load, amplitudes (n,); ``position`` is the index of k."""

    power: int
    position: int
    amplitudes: ComplexArray


class TruncatedExcitation(NamedTuple):
    """Loads, and prescribed displacements without breakpoints, of orders that are not unknowns.

    Attributes
    ----------
    ratio : ndarray, shape (L,)
        Orders of Omega.
    loads : list of _LoadPart
        Loads; ``position`` is the index of the order.
    displacements : ndarray, shape (m, L)
        Amplitudes of the prescribed displacements.
    """

    ratio: Array
    loads: list[_LoadPart]
    displacements: ComplexArray

    @classmethod
    def of(cls, system: System, orders: np.ndarray, nu: int) -> TruncatedExcitation | None:
        """Return the excitation of basis harmonics ``orders`` (L,), or None without any."""
        index = {k: i for i, k in enumerate(orders.tolist())}
        e = np.zeros((len(system.elements), len(orders)), dtype=complex)
        for amplitudes, element in zip(e, system.elements, strict=True):
            if not element.displacement.corners:
                c = to_complex(element.displacement.row(element.displacement.order)).tolist()
                for order in [k for k in range(len(c)) if k * nu in index]:
                    amplitudes[index[order * nu]] = c[order]
        loads = _load_parts(system, nu, index)
        return cls(orders / nu, loads, e) if loads or e.any() else None

    def response(self, structure: LinearStructure, Omega: Array, f: ComplexArray) -> ComplexArray:
        """Return W^T D^-1 F_k - e_k (P, m, L), and add -(kr + i w c) e_k of springs and dampers to f (P, m, L)."""
        out = np.tile(-self.displacements, (len(Omega), 1, 1))
        for displacements, forces, w in zip(out, f, Omega.tolist(), strict=True):
            at_speed = structure.at(w)
            forces -= (at_speed.kr[:, None] + 1j * w * self.ratio * at_speed.c[:, None]) * self.displacements
            for load in self.loads:
                q = at_speed.solve(w * self.ratio[load.position], load.amplitudes[:, None])[:, 0]
                displacements[:, load.position] += w**load.power * (at_speed.W.T @ q)
        return out


def _load_parts(system: System, nu: int, index: Mapping[int, int]) -> list[_LoadPart]:
    """Return the harmonics of all loads whose basis harmonic is a key of ``index``."""
    return [
        _LoadPart(load.power, index[order * nu], amplitudes)
        for load in system.loads
        for order, amplitudes in load.complex(system.n).items()
        if order * nu in index
    ]


POLE_SHIFT = 1e-5
"""Relative distance of two frequencies whose mean replaces the linear part at an undamped natural frequency. The error
of the mean is its square; rounding grows with its inverse."""


class Receptance:
    """Linear part of the balance for harmonics 0..H of the basis frequency Omega / nu, or a selection of them.

    Parameters
    ----------
    structure : LinearStructure
        Structure of the system.
    system : System
        System with the loads and prescribed displacements.
    H, nu : int
        Number of harmonics of the basis, and its subharmonic order.
    orders : ndarray, shape (K + 1,), optional
        Basis harmonics among 0..H that are unknowns; all by default.

    Attributes
    ----------
    packed : PackedLinearPart
        Arrays for kernels, without poles if the receptances are computed by direct solutions.
    truncated : TruncatedExcitation or None
        Excitation up to 2H of orders that are not unknowns.
    """

    def __init__(
        self, structure: LinearStructure, system: System, H: int, nu: int, orders: np.ndarray | None = None
    ) -> None:
        self.structure, self.H, self.nu = structure, H, nu
        self.k = np.arange(H + 1) if orders is None else orders
        e = np.zeros((H + 1, structure.m), dtype=complex)
        for j, element in enumerate(system.elements):
            c = to_complex(stretch(element.displacement.row(H // nu), nu))
            e[: len(c), j] = c
        self.e = np.ascontiguousarray(e[self.k])
        self._loads = _load_parts(system, nu, {k: i for i, k in enumerate(self.k.tolist())})
        self.packed = self._pack()
        self.truncated = TruncatedExcitation.of(system, self.packed.truncated_orders, nu)

    def _pack(self) -> PackedLinearPart:
        """Return the arrays for kernels."""
        structure, m = self.structure, self.structure.m
        modes = structure.modes if structure.accurate_modes else None
        fixed = None if modes is None else _fixed_interface(structure)
        poles, residues = np.empty(0, dtype=complex), np.empty((m * (m + len(self._loads)), 0), dtype=complex)
        polynomial, static = np.empty((0, m, m)), np.zeros((len(self._loads), m), dtype=complex)
        free = FreeModes(poles, np.empty((m, 0), dtype=complex), np.empty((0, m), dtype=complex))
        if modes is not None:
            output, input_, left, poles = modes.output, modes.input, modes.left, modes.poles
            free = FreeModes(*map(np.ascontiguousarray, (poles, output, input_)))
            if fixed is not None:
                rows, poles, left = structure.independent, fixed.poles, fixed.left
                output, input_ = np.zeros((m, len(poles)), complex), np.zeros((len(poles), m), complex)
                output[rows], input_[:, rows] = fixed.output, fixed.input
                polynomial = np.zeros((3, m, m))
                polynomial[:, rows[:, None], rows] = fixed.polynomial
                static[:, rows] = [fixed.static @ load.amplitudes for load in self._loads]
            driven = [output * (left @ load.amplitudes) for load in self._loads]
            residues = np.concatenate([(output[:, None, :] * input_.T).reshape(m * m, len(poles)), *driven])
            # near poles first: the kernels sum the far ones as a power series
            order = np.argsort(np.abs(poles), kind="stable")
            poles, residues = poles[order], residues[:, order]
        loads = np.array([(load.power, load.position) for load in self._loads], dtype=np.int64).reshape(-1, 2)
        is_unknown = np.zeros(2 * self.H + 1, dtype=bool)
        is_unknown[self.k] = True
        a, b = structure.independent.astype(np.int64), structure.dependent.astype(np.int64)
        ties, stiffness = structure.compatibility[b], float(np.diag(structure.compatibility).max(initial=0.0))
        return PackedLinearPart(
            split_complex(poles),
            split_complex(residues),
            polynomial,
            static,
            free,
            np.array([structure.kr, structure.c]),
            self.k.astype(np.int64),
            np.flatnonzero(~is_unknown),
            self.e,
            a,
            b,
            np.ascontiguousarray(structure.force_sums[np.ix_(a, b)]),
            stiffness,
            ties @ to_real(self.e.T),
            loads,
            int(self.nu),
            *_far_poles(poles, residues),
        )

    def loads(self, Omega: float) -> ComplexArray:
        """Return the load harmonics (K + 1, n) at Omega."""
        F = np.zeros((len(self.k), self.structure.n), dtype=complex)
        for part in self._loads:
            F[part.position] += Omega**part.power * part.amplitudes
        return F

    def at(self, Omega: float) -> LinearPart:
        """Return Z_k, g_k and their derivatives in Omega."""
        s = self.structure
        if not s.accurate_modes:
            out = LinearPart.zero(len(self.k), s.m)
            self._fill_directly(Omega, out)
            return out
        out = self._from_poles(Omega)
        if not np.isfinite(out.matrices).all():  # at a pole of the receptance, where its inverse is smooth
            sides = [self._from_poles(Omega * (1 + shift)) for shift in (-POLE_SHIFT, POLE_SHIFT)]
            out = LinearPart(*(0.5 * (below + above) for below, above in zip(*sides, strict=True)))
        if not np.isfinite(out.matrices).all():
            raise ValueError(
                f"at Omega = {Omega:g} the receptance of the structure is zero or infinite: "
                "values of the model differ by too many orders of magnitude; check their units"
            )
        return out

    def _from_poles(self, Omega: float) -> LinearPart:
        """Return the linear part at Omega from the poles; it is not finite at a natural frequency."""
        from hbgear.harmonic.structure.receptance_kernels import linear_part

        out = LinearPart.zero(len(self.k), self.structure.m)
        linear_part(self.packed, float(Omega), *out)
        return out

    def _fill_directly(self, Omega: float, out: LinearPart) -> None:
        """Fill the linear part at Omega from receptances that are computed by direct solutions."""
        s, ratio = self.structure, self.k / self.nu
        w, a = Omega * ratio, len(s.independent)
        amplitudes = np.array([part.amplitudes for part in self._loads]).reshape(-1, s.n)
        U, dU = direct_stiffness(s, Omega, ratio, amplitudes.T)
        Y, dY = out.matrices
        block = np.ix_(np.arange(len(w)), s.independent, s.independent)
        Y[block], dY[block] = U[..., :a], dU[..., :a]
        constants = out.constants
        constants[:] = (out.matrices @ self.e[..., None])[..., 0]
        constants[0] -= (s.kr + 1j * w[:, None] * s.c) * self.e
        constants[1] -= 1j * ratio[:, None] * s.c * self.e
        for n, part in enumerate(self._loads):
            k, power = part.position, part.power
            force, slope = U[k, :, a + n], dU[k, :, a + n]
            constants[0, k, s.independent] -= Omega**power * force
            constants[1, k, s.independent] -= Omega**power * slope
            if power:
                constants[1, k, s.independent] -= power * Omega ** (power - 1) * force
        Y -= np.diag(s.kr)

    def motion(self, Omega: float, d: ComplexArray, f: ComplexArray) -> ComplexArray:
        """Return harmonics q_k (K + 1, n) of the coordinates from displacements d and law forces f, (K + 1, m) each.

        q_k = D_k^-1 (F_k - W (f_k - kr d_k - (kr + i w c) e_k))
        """
        s = self.structure.at(Omega)
        w = self.k * Omega / self.nu
        u = f - s.kr * d - (s.kr + 1j * w[:, None] * s.c) * self.e
        rhs = self.loads(Omega) - u @ s.W.T
        return s.solve_all(w, rhs[..., None])[..., 0]


def _fixed_interface(structure: LinearStructure) -> FixedInterface | None:
    """Return Z from the modes with fixed elements if its computation as inverse of G has large rounding errors.

    The errors of Z d, relative to Z d, are proportional to G_ii (G^-1)_ii, here near the lowest natural frequency,
    where it is largest. This is 1 for elements that do not influence each other. None too if Z and G contradict each
    other, because values of the model differ by too many orders of magnitude.
    """
    modes, independent = structure.modes, structure.independent
    frequencies = np.abs(modes.poles[modes.poles != 0.0]) if modes is not None else np.empty(0)
    if modes is None or len(independent) < 2 or not frequencies.size:
        return None
    s = 0.99j * float(frequencies.min())
    G = (modes.output[independent] / (s - modes.poles)) @ modes.input[:, independent]
    try:
        amplification = float(np.abs(np.diag(G) * np.diag(np.linalg.inv(G))).max())
    except np.linalg.LinAlgError:
        return None
    fixed = structure.fixed_interface if amplification > MAX_AMPLIFICATION else None
    if fixed is None or np.abs(G @ fixed.stiffness(s) @ G - G).max() > CONTRADICTION * np.abs(G).max():
        return None
    return fixed


CONTRADICTION = 1e-2
"""Difference of G Z G and G, relative to G, that no rounding explains: fine meshes have up to 1e-4."""

MAX_AMPLIFICATION = 100.0
"""Amplification G_ii (G^-1)_ii of rounding errors [-] up to which Z is the inverse of G.

The errors of forces are up to 1e-13 times the amplification: at 100 a tenth of the tolerance of converged points. Two
elements on a beam have 12, 20 have 1e6, and 90 have 1e8.
"""


FEW_POLES = 32
"""Number of poles [-] up to which all of them are summed one by one."""

FAR_POLE_TERMS = 26
"""Terms of the power series of far poles [-]: at a fourth of the radius the first term left out is 4^-26 = 2e-16."""


def _far_poles(poles: ComplexArray, residues: ComplexArray) -> tuple[Array, np.ndarray, Array]:
    """Return radii (B,), numbers of poles below them (B,), and coefficients (B, J, N, 2) of the others, see kernels.

    The poles (r,) ascend; the residues have the shape (N, r).
    """
    counts = 8 * 2 ** np.arange(24)
    near_counts = counts[counts <= len(poles) - FEW_POLES // 2] if len(poles) > FEW_POLES else counts[:0]
    series = np.empty((len(near_counts), FAR_POLE_TERMS, len(residues), 2))
    for coefficients, first in zip(series, near_counts.tolist(), strict=True):
        ratio = abs(poles[first]) / poles[first:]
        terms = -(ratio / abs(poles[first]))[:, None] * ratio[:, None] ** np.arange(FAR_POLE_TERMS)
        sums = (residues[:, first:] @ terms).T
        coefficients[..., 0], coefficients[..., 1] = sums.real, sums.imag
    return np.abs(poles[near_counts]), near_counts.astype(np.int64), series
