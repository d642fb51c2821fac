"""Harmonic balance in the element coordinates.

    R_k(d) = Z_k(Omega) d_k + g_k(Omega) + f_k(d) = 0,   k = 0..H

The unknowns are the m (2H + 1) real coefficients of the element coordinates, element after element; the number of
coordinates of the structure does not appear. Z and g come from `receptance`, the force harmonics f_k from `contact`
(piecewise-linear laws, exact) or from N samples per period by fast Fourier transform (any law).

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
Cameron & Griffin (1989), J. Appl. Mech. 56(1), https://doi.org/10.1115/1.3176036, for sampled laws.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.messages import did_you_mean
from hbgear.common.ranges import ANY, POSITIVE, Range, checked, counted
from hbgear.common.recent import Recent
from hbgear.continuation.algebra import norms
from hbgear.continuation.branch import Branch, Point
from hbgear.continuation.differences import in_parameter
from hbgear.continuation.events import Event
from hbgear.continuation.homotopy import solve_from_afar
from hbgear.continuation.newton import NoConvergence, solve
from hbgear.continuation.problem import Evaluation, Evaluations, FullProblem
from hbgear.harmonic.compiled import Compiled
from hbgear.harmonic.crossings import Crossings, crossings
from hbgear.harmonic.events import motion_events
from hbgear.harmonic.floquet import multipliers_of
from hbgear.harmonic.observables import Layout
from hbgear.harmonic.realbasis import Toeplitz, after_derivative, derivative, one_sided, real_blocks
from hbgear.harmonic.receptance import Structure
from hbgear.harmonic.starts import guesses
from hbgear.mechanics.doubts import of_frequency, of_gaps, of_problem, of_size, tell
from hbgear.mechanics.fourier import (
    Transform,
    derive,
    extrema,
    highest,
    resize,
    samples_of,
    stretch,
    to_complex,
    to_real,
)
from hbgear.mechanics.model import Model, System, describe

_UNKNOWNS = 4_000  # of the dense Jacobians, several of which are held at once


_SAMPLES = 1_000_000  # of all elements together


_COUNTABLE = 10**15  # larger numbers are refused before anything is computed with them


_FREQUENCIES = Range(above=0, high=1e60)  # so that powers of Omega are numbers


_FEWEST, _MOST = 4, 400  # harmonics of the excitation that "auto" stays between


class ForceHarmonics(NamedTuple):
    """Law forces of P motions as real rows f (P, m, 2H+1), with matrices (P, m, 2H+1, 2H+1) of their derivatives.

    stiffness: of the rows of f in those of d; damping: in those of d' (None if no law depends on it).
    """

    f: Array
    stiffness: Array
    damping: Array | None


class HarmonicBalance(FullProblem):
    """Periodic motions of a model by harmonic balance: a problem for `trace`.

    Parameters
    ----------
    model : `Model` (any gear pair, oscillator or `System`).
    harmonics : H, number of harmonics of the basis frequency Omega / nu; or "auto": a trace then raises and lowers H
        from row to row so that the estimated truncation error stays below ``tolerance``.
    samples : N per basis period, for laws that are sampled and as the grid that brackets contact instants; by
        default the next fast length above 8H (at least 64), or 64H (at least 1024) with ``sampled``.
    nu : subharmonic order; 2 for period-doubled motions.
    sampled : sample piecewise-linear laws too instead of projecting them exactly (a cross-check).
    tolerance : largest estimated truncation error (rms of the gap motion) with ``harmonics="auto"``.

    Raises
    ------
    ValueError
        If H < nu, N < 2H + 1, nu < 1, there are too many unknowns or samples, or the model cannot move periodically
        (singular M, unbalanced load).

    Notes
    -----
    Its parameters are ``Omega`` and the float fields of the model; ``evaluate(X, Omega=..., zeta=...)`` takes those
    that differ from the model's.

    What an evaluation gives depends on nothing that was asked before, and threads may share a problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(), harmonics=8)
    >>> X = pair.start(Omega=0.9)
    >>> R, J = pair.evaluate(X, Omega=0.9)
    >>> R.shape, J.shape
    ((17,), (17, 17))
    """

    @checked_arguments()
    def __init__(
        self, model: Model, harmonics: int | str = 16, samples: int | None = None, nu: int = 1,
        sampled: bool = False, tolerance: float = 1e-6,
    ) -> None:  # fmt: skip
        counted("nu", nu, _COUNTABLE)
        if harmonics != "auto":
            counted("harmonics", harmonics, _COUNTABLE)
        checked("HarmonicBalance", "tolerance", tolerance, POSITIVE)
        self.auto = harmonics == "auto"
        self.tolerance = float(tolerance)
        self.model, self.nu, self.is_sampled = model, int(nu), bool(sampled)
        self.H = _FEWEST * self.nu if self.auto else int(harmonics)
        system = model.system()
        self.m = len(system.elements)
        if samples is not None:
            counted("samples", samples, _COUNTABLE)
        self._structures: Recent[Structure] = Recent(6)
        self._own = model.parameters
        self._prepare(samples)
        self._warn_truncated(system)
        of_size(system)
        self.compiled({})
        of_problem(model, system, _MOST if self.auto else self.H // self.nu)

    def _prepare(self, samples: int | None) -> None:
        """What depends on H and N alone."""
        H = self.H
        usual = scipy.fft.next_fast_len(max(1024, 64 * H) if self.is_sampled else max(64, 8 * H), real=True)
        self.N = int(samples or usual)
        self._check_size()
        self._transform = Transform(H, self.N)
        self._toeplitz = Toeplitz(H)
        self._compiled: Recent[Compiled] = Recent(8)

    def __repr__(self) -> str:
        kind = ", sampled" if self.is_sampled else ""
        return f"HarmonicBalance({self.model!r}, harmonics={self.H}, nu={self.nu}{kind})"

    # ---- description

    usual_parameter = "Omega"
    undetermined = "a gap that stays open without load: load the system"

    @property
    def batched(self) -> tuple[str, ...]:  # type: ignore[override]
        """Many motions are evaluated together that differ in Omega, unless their numbers of harmonics differ."""
        return () if self.auto else ("Omega",)

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of unknowns m (2H + 1)."""
        return self.m * (2 * self.H + 1)

    @property
    def parameters(self) -> dict[str, float]:
        """The model's parameters; Omega is given with every evaluation."""
        return self.model.parameters

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        """Whether dR/dX is differentiable, so that folds can be found by Newton: no sampled corner in any law."""
        c = self.compiled({})
        return not any(c.laws[j].breakpoints for j in c.sampled)

    @property
    def layout(self) -> Layout:
        """How a row of unknowns is to be read."""
        system = self.compiled({}).system
        return Layout(
            harmonics=self.H,
            nu=self.nu,
            elements=tuple(e.name for e in system.elements),
            breakpoints=tuple(e.law.breakpoints for e in system.elements),
            labels=dict(self.model.labels),
        )

    @property
    def dof_names(self) -> tuple[str, ...]:
        """Names of the coordinates of the structure."""
        return tuple(self.compiled({}).system.dof_names)

    def describe(self) -> dict[str, Any]:
        """Model and settings as plain data, for the header of a saved branch."""
        return {
            "model": describe(self.model),
            "balance": {
                "harmonics": self.H,
                "samples": self.N,
                "nu": self.nu,
                "sampled": self.is_sampled,
                "auto": self.tolerance if self.auto else None,
            },
        }

    @checked_arguments()
    def check_parameter(self, name: str) -> None:
        """Refuse a parameter that neither is Omega nor a float field of the model."""
        known = ("Omega", *self._own)
        if name not in known:
            raise KeyError(f"{type(self.model).__name__} has no parameter '{name}'{did_you_mean(name, known)}")

    def range_of(self, name: str) -> Range:
        """Values a parameter may have; Omega is positive."""
        return POSITIVE if name == "Omega" else self.model.ranges.get(name, ANY)

    def check_trace(self, name: str, low: float, high: float, fixed: Mapping[str, float]) -> None:
        """Warn of an Omega far above every natural frequency of the model."""
        of_frequency(self.compiled({}).structure, high if name == "Omega" else fixed["Omega"])

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """Omega is given with every evaluation."""
        return () if "Omega" in known else ("Omega",)

    def finished(self, branch: Branch, observed: Sequence[Mapping[str, Any]]) -> Branch:
        """The branch as it is; warns where nothing ever comes near a corner of a law."""
        clearances = [seen["clearance"] for seen in observed if "clearance" in seen]
        if branch.parameter == "Omega" and branch.status.complete:
            of_gaps(self.clearance_names, np.array(clearances), branch.amplitude("pp2"))
        return branch

    def events(self, parameter: str) -> tuple[Event, ...]:
        """Period doublings, Neimark-Sacker points, grazing contacts, ends of subharmonic branches."""
        return motion_events(self.nu)

    @checked_arguments()
    def with_order(self, nu: int, harmonics: int | None = None) -> HarmonicBalance:
        """The same model with another subharmonic order; by default harmonics reach the same frequency."""
        H = harmonics or self.H * nu // self.nu
        counted("nu", nu, _COUNTABLE)
        counted("harmonics", H, _COUNTABLE)
        out = copy.copy(self)
        out.nu, out.H = int(nu), int(H)
        out._prepare(None)
        out.compiled({})
        return out

    def converted(self, point: Point) -> Array:
        """Unknowns of a point in this problem's basis; as they are if the point does not say what they are."""
        return self.in_basis(point.X, point.layout) if isinstance(point.layout, Layout) else point.X

    def in_basis(self, X: Array, layout: Layout) -> Array:
        """Unknowns of another basis in this one: more or fewer harmonics, or a multiple of the period.

        Raises
        ------
        ValueError
            If the elements differ, or the motion is not periodic with this nu.
        """
        if len(layout.elements) != self.m:
            raise ValueError(f"the motion has {len(layout.elements)} elements; this model has {self.m}")
        if self.nu % layout.nu:
            raise ValueError(
                f"a motion of order nu = {layout.nu} is not periodic with nu = {self.nu}; need a multiple of it"
            )
        return resize(stretch(X.reshape(self.m, -1), self.nu // layout.nu), self.H).ravel()

    @checked_arguments()
    def with_tolerance(self, tolerance: float) -> HarmonicBalance:
        """The same problem, harmonics included, with ``harmonics="auto"`` from here on."""
        out = copy.copy(self)
        out.auto, out.tolerance = True, float(tolerance)
        return out

    def remeshed(self, observed: Mapping[str, Any]) -> HarmonicBalance | None:
        """The problem with the harmonics that a motion with this truncation error asks for; None to keep them."""
        H = self.wanted_harmonics(observed.get("error", 0.0))
        return None if H is None else self.with_order(self.nu, H)

    def wanted_harmonics(self, error: float) -> int | None:
        """Another number of harmonics for a motion with this truncation error; None to keep H, and unless "auto"."""
        if not self.auto:
            return None
        if error > self.tolerance and _MOST * self.nu > self.H:
            return min(_MOST * self.nu, self.H + max(2, int(0.4 * self.H)))
        if error < 1e-2 * self.tolerance and _FEWEST * self.nu < self.H:
            return max(_FEWEST * self.nu, int(0.8 * self.H))
        return None

    def check_fixed(self, what: str) -> None:
        """Refuse a number of harmonics that varies.

        Raises
        ------
        ValueError
            With ``harmonics="auto"``.
        """
        if self.auto:
            raise ValueError(f"{what} needs one number of harmonics throughout, not 'auto'; give harmonics=16, say")

    def fitted(self, X: Array) -> Array:
        """Unknowns of any number of harmonics, cut or padded to this problem's."""
        if len(X) == self.size:
            return X
        return resize(X.reshape(self.m, -1), self.H).ravel()

    def _check_size(self) -> None:
        """Refuse what would fill the memory before any work."""
        if self.nu > self.H:
            raise ValueError(
                f"harmonics = {self.H} of Omega / {self.nu} do not reach Omega itself; need at least {self.nu}"
            )
        if self.size > _UNKNOWNS:
            raise ValueError(
                f"harmonics = {self.H} for {self.m} elements make {self.size:,} unknowns; at most {_UNKNOWNS:,} can be "
                f"solved for: H <= {(_UNKNOWNS // self.m - 1) // 2}"
            )
        if self.N * self.m > _SAMPLES:
            raise ValueError(f"samples = {self.N:,} for {self.m} elements; at most {_SAMPLES // self.m:,} are possible")

    def _warn_truncated(self, system: System) -> None:
        highest = max([e.displacement.order for e in system.elements] + [load.order for load in system.loads])
        if highest * self.nu > self.H:
            tell(
                f"the excitation has {highest} harmonics but H = {self.H} with nu = {self.nu} keeps only "
                f"{self.H // self.nu}; what is above is left out"
            )

    # ---- evaluation

    def compiled(self, parameters: dict[str, float]) -> Compiled:
        """The model at the given parameters (Omega among them or not), from a small cache."""
        changed = {k: v for k, v in parameters.items() if k != "Omega" and v != self._own.get(k)}
        for name in changed:
            self.check_parameter(name)
        return self._compiled.get(tuple(sorted(changed.items())), lambda: self._compile(changed))

    def _compile(self, changed: dict[str, float]) -> Compiled:
        system = (self.model.replace(**changed) if changed else self.model).system()
        return Compiled(system, self._structure(system), self.H, self.nu, self.is_sampled, self._transform)

    def _structure(self, system: System) -> Structure:
        """Eigen-decompositions are shared between parameter sets that differ in laws and loads only."""
        fresh = tuple(np.array([e.law.reference, e.damping]).tobytes() for e in system.elements)
        dense = [A for A in (system.M, system.C, system.K) if isinstance(A, np.ndarray)]
        loads = tuple(b"" if ld.constant is None else np.asarray(ld.constant).tobytes() for ld in system.loads)
        if len(dense) < 3:
            return Structure(system)
        key = (*(A.tobytes() for A in dense), system.W.tobytes(), *fresh, *loads)
        return self._structures.get(key, lambda: Structure(system))

    def forces(self, rows: Array, c: ComplexArray, Omega: Array, compiled: Compiled) -> ForceHarmonics:
        """Forces of all laws on P motions given by their rows (P, m, 2H + 1) and complex form c (P, m, H + 1)."""
        exact, sampled = compiled.exact, compiled.sampled
        if not sampled.size:
            return self._projected(rows, c, compiled)
        if not exact.size:
            return self._sampled(c, Omega, compiled)
        f, stiffness = np.empty_like(rows), np.empty((*rows.shape, rows.shape[-1]))
        f[:, exact], stiffness[:, exact], _ = self._projected(rows[:, exact], c[:, exact], compiled)
        f[:, sampled], stiffness[:, sampled], part = self._sampled(c[:, sampled], Omega, compiled)
        damping = None
        if part is not None:
            damping = np.zeros_like(stiffness)
            damping[:, sampled] = part
        return ForceHarmonics(f, stiffness, damping)

    def _projected(self, rows: Array, c: ComplexArray, compiled: Compiled) -> ForceHarmonics:
        """Exact forces kappa * d + chi of the piecewise-linear laws, from the motions of their elements."""
        flat = c.reshape(-1, self.H + 1)
        kappa, chi = compiled.projector_of(len(c)).project(flat, self._transform.samples(flat), 2 * self.H)
        stiffness = self._toeplitz(kappa).reshape(*rows.shape, -1)
        held = to_real(one_sided(chi[:, : self.H + 1])).reshape(rows.shape)
        return ForceHarmonics((stiffness @ rows[..., None])[..., 0] + held, stiffness, None)

    def _sampled(self, c: ComplexArray, Omega: Array, compiled: Compiled) -> ForceHarmonics:
        """Forces of the other laws, from the motions of their elements."""
        P, m, n = len(c), c.shape[1], 2 * self.H + 1
        waves = [c, (Omega / self.nu)[:, None, None] * derive(c)] if compiled.rated else [c]
        flat = np.concatenate([x[:, j] for x in waves for j in range(m)])
        samples = self._transform.samples(flat).reshape(len(waves), m, P * self.N)
        at_rest = np.zeros(0 if compiled.rated else P * self.N)
        found = []
        for j, law in enumerate(compiled.bound(P)):
            found.append(law(samples[0, j], samples[1, j] if compiled.rated else at_rest))
        p, dp_dd, dp_dv = zip(*found, strict=True)
        damped = compiled.rated and any(x.any() for x in dp_dv)
        parts = np.concatenate([*p, *dp_dd, *dp_dv] if damped else [*p, *dp_dd]).reshape(-1, self.N)
        spectra = self._transform.spectrum(parts).reshape(-1, m, P, n).swapaxes(1, 2)
        slopes = self._toeplitz(spectra[1:].reshape(-1, n)).reshape(-1, P, m, n, n)
        return ForceHarmonics(
            to_real(one_sided(spectra[0, ..., : self.H + 1])), slopes[0], slopes[1] if damped else None
        )

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Array]:
        """Residual (n,) and Jacobian (n, n) at X (n,), n = m (2H + 1); ``Omega`` must be among the parameters."""
        R, J, *_ = self.linearise(X, "", **parameters)
        return R, J

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """R, dR/dX, dR/dname and the size of the forces that R is the sum of.

        dR/dOmega is analytic; the derivative in a model parameter is a difference of the residual
        (`hbgear.continuation.differences`).
        """
        rest = {key: value for key, value in parameters.items() if key != "Omega"}
        now = self.linearise_all(X[None], np.array([parameters["Omega"]]), **rest)
        R, J, dR, size = now.R[0], now.dR_dX[0], now.dR_dp[0], now.size[0]
        if name != "Omega":
            here = {name: self.parameters.get(name, 0.0), **parameters} if name else {}
            (dR,) = (
                in_parameter(self, name, here, lambda at: (self.residual(X, **at),)) if name else (np.zeros(len(R)),)
            )
        return Evaluation(R, J, dR, float(size))

    def linearise_all(self, X: Array, Omega: Array, **parameters: float) -> Evaluations:
        """`linearise` in Omega of many motions X (P, n) at frequencies Omega (P,), all other parameters equal.

        Eight motions cost little more than one.
        """
        compiled = self.compiled(parameters)
        linear = compiled.linear(Omega)
        matrices, constants = linear.matrices, linear.constants
        P, m, n = len(X), self.m, 2 * self.H + 1
        rows = X.reshape(P, m, n)
        c = to_complex(rows)
        f, own, slip = self.forces(rows, c, Omega, compiled)
        moved = (matrices @ c.swapaxes(1, 2)[..., None])[..., 0]  # Z d and dZ/dOmega d, (2, P, H + 1, m)
        R, dR = to_real((moved + constants).swapaxes(2, 3))
        R += f
        if slip is not None:
            own = own + after_derivative(slip) * (Omega / self.nu)[:, None, None, None]
            dR += (slip @ derivative(rows)[..., None])[..., 0] / self.nu
        J = real_blocks(matrices[0])
        for j in range(m):
            J[:, j, :, j, :] += own[:, j]
        size = norms(f) + norms(moved[0]) + norms(constants[0])
        size[size == 0] = 1.0
        return Evaluations(R.reshape(P, -1), J.reshape(P, m * n, m * n), dR.reshape(P, -1), size)

    def linearise_many(self, X: Array, name: str, values: Array, **parameters: float) -> Evaluations:
        """`linearise` of motions X (P, n) at values (P,) of a parameter."""
        if name == "Omega":
            return self.linearise_all(X, values, **parameters)
        return super().linearise_many(X, name, values, **parameters)

    @checked_arguments()
    def residual(self, X: Array, **parameters: float) -> Array:
        """R alone (n,)."""
        X = self._given(X, parameters)
        return self.linearise(X, "", **parameters).R

    # ---- starting points

    @checked_arguments()
    def start(self, Omega: float, **parameters: float) -> Array:  # type: ignore[override]
        """A periodic motion at Omega, found from the static state and the linear response about it.

        Raises
        ------
        NoConvergence
            If Newton finds no periodic motion from any of the guesses.
        """
        checked("start", "Omega", Omega, _FREQUENCIES)
        here = {name: float(value) for name, value in (parameters | {"Omega": Omega}).items()}
        failure: NoConvergence | None = None
        for method in (solve, solve_from_afar):
            for guess in guesses(self.compiled(here), here["Omega"]):
                try:
                    return method(self, guess, here).X
                except NoConvergence as error:
                    failure = failure or error
        assert failure is not None
        raise failure

    # ---- results

    def switching(self, X: Array, **parameters: float) -> Crossings:
        """Instants theta in [0, 2 pi] of the basis period at which any element crosses a corner of its law.

        ``row`` of the result counts the corners of all elements in order.
        """
        compiled = self.compiled(parameters)
        c = to_complex(X.reshape(self.m, -1))
        return crossings(c, compiled.corner, compiled.element, self._transform.samples(c))

    @checked_arguments()
    def regime(self, X: Array, **parameters: float) -> np.ndarray:
        """Impact regime of each element (m,): 0 no impact, 1 single-sided, 2 double-sided.

        It is the number of corners of the law that the motion crosses, at most 2.
        """
        regime: np.ndarray = self._reach(X[None], self.compiled(parameters))[1][0]
        return regime

    @checked_arguments()
    def clearance(self, X: Array, **parameters: float) -> Array:
        """Signed distances of the extrema of each element from each corner of its law: zero where contact grazes.

        Order: for each element and each of its corners, lowest value minus corner, highest value minus corner.
        """
        clearance: Array = self._reach(X[None], self.compiled(parameters))[0][0]
        return clearance

    def graze(self, X: Array, which: int, **parameters: float) -> tuple[float, float]:
        """One entry of `clearance`, and the phase at which its extremum lies."""
        compiled, corner, sign = self.compiled(parameters), which // 2, 1 if which % 2 else -1
        value, theta = highest(sign * X.reshape(self.m, -1)[compiled.element[corner]])
        return float(sign * value - compiled.corner[corner]), float(theta)

    def _reach(self, X: Array, compiled: Compiled) -> tuple[Array, np.ndarray]:
        """Clearances and regimes of many motions (P, n)."""
        if not compiled.corner.size:
            return np.zeros((len(X), 0)), np.zeros((len(X), self.m), dtype=np.int8)
        low, _, high, _ = extrema(X.reshape(len(X), self.m, -1))
        ends = np.stack([low, high], axis=-1)[:, compiled.element] - compiled.corner[:, None]
        passed = (ends[..., 0] < 0) & (ends[..., 1] > 0)
        count = passed @ (compiled.element[:, None] == np.arange(self.m)).astype(np.int8)
        return ends.reshape(len(X), -1), np.minimum(count, 2).astype(np.int8)

    def force_rows(self, X: Array, **parameters: float) -> Array:
        """Law forces of each element (without its damper) as real rows (m, 2H + 1)."""
        rows = X.reshape(self.m, -1)
        compiled, Omega = self.compiled(parameters), np.array([parameters["Omega"]])
        forces: Array = self.forces(rows[None], to_complex(rows)[None], Omega, compiled).f[0]
        return forces

    @checked_arguments()
    def mesh_forces(self, X: Array, **parameters: float) -> Array:
        """Whole force of each element, law and damper, as real rows (m, 2H + 1): f_k + i k omega c d_k."""
        X = self._given(X, parameters)
        compiled = self.compiled(parameters)
        omega = parameters["Omega"] / self.nu
        rows = X.reshape(self.m, -1)
        return self.force_rows(X, **parameters) + omega * compiled.structure.c[:, None] * derivative(rows)

    @checked_arguments()
    def motion(self, X: Array, **parameters: float) -> Array:
        """Motion of every coordinate of the structure as real rows (n, 2H + 1)."""
        X = self._given(X, parameters)
        compiled = self.compiled(parameters)
        f = to_complex(self.force_rows(X, **parameters)).T
        q = compiled.receptance.motion(parameters["Omega"], to_complex(X.reshape(self.m, -1)).T, f)
        return to_real(q.T)

    @checked_arguments()
    def multipliers(
        self, X: Array, points: int | None = None, width: float | None = None, **parameters: float
    ) -> ComplexArray:
        """Floquet multipliers of the motion over its period, largest first; see `floquet.multipliers_of`."""
        X = self._given(X, parameters)
        if points is not None:
            counted("points", points, 50)
        if width is not None:
            checked("multipliers", "width", width, POSITIVE)
        Omega = np.array([parameters.pop("Omega")])
        compiled = self.compiled(parameters)
        mu: ComplexArray = multipliers_of(compiled, X[None], Omega, points=points, width=width)[0]
        return mu

    def _given(self, X: Array, parameters: dict[str, float]) -> Array:
        """Unknowns of one motion; ``parameters`` hold a frequency that can be meant."""
        X = np.asarray(X, dtype=float)
        if X.shape != (self.size,):
            raise ValueError(
                f"X of shape {X.shape}: need the unknowns of one motion, {self.m} x (2H + 1) = {self.size} numbers"
            )
        if "Omega" not in parameters:
            raise ValueError("a motion needs its frequency: give Omega=...")
        checked(type(self).__name__, "Omega", parameters["Omega"], _FREQUENCIES)
        parameters["Omega"] = float(parameters["Omega"])
        return X

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """What a trace stores beside the unknowns: multipliers (if asked for), regime, clearance, error."""
        Omega = np.array([parameters.pop("Omega")])
        return self.observe_all(X[None], Omega, stability, **parameters)[0]

    def observe_all(self, X: Array, Omega: Array, stability: bool = True, **parameters: float) -> list[dict[str, Any]]:
        """`observe` for many motions X (P, n) at frequencies Omega (P,), all other parameters equal: far less work."""
        compiled = self.compiled(parameters)
        clearance, regime = self._reach(X, compiled)
        error = self._truncation(X, Omega, compiled)
        columns = zip(clearance, regime, error, strict=True)
        seen: list[dict[str, Any]] = [{"clearance": c, "regime": r, "error": float(e)} for c, r, e in columns]
        if stability:
            for one, mu in zip(seen, multipliers_of(compiled, X, Omega), strict=True):
                one["multipliers"] = mu
        return seen

    def observe_many(
        self, X: Array, name: str, values: Array, stability: bool, **parameters: float
    ) -> list[dict[str, Any]]:
        """`observe` of motions X (P, n) at values (P,) of a parameter."""
        if name == "Omega":
            return self.observe_all(X, values, stability, **parameters)
        return super().observe_many(X, name, values, stability, **parameters)

    @property
    def clearance_names(self) -> tuple[str, ...]:
        """What each entry of `clearance` stands for."""
        elements = self.compiled({}).system.elements
        return tuple(
            f"{end} of {e.name} at {x:g}" for e in elements for x in e.law.breakpoints for end in ("lowest", "highest")
        )

    @property
    def clearance_elements(self) -> tuple[int, ...]:
        """Number of the element each entry of `clearance` belongs to."""
        laws = self.compiled({}).laws
        return tuple(j for j, law in enumerate(laws) for _ in law.breakpoints for _ in range(2))

    def motion_size(self, X: Array) -> float:
        """Norm of the alternating part, which scales the arclength."""
        return float(np.linalg.norm(X.reshape(self.m, -1)[:, 1:]))

    def subharmonic_part(self, X: Array) -> Array:
        """The coefficients that a basis of smaller order could not hold; empty for nu = 1."""
        if self.nu == 1:
            return np.empty(0)
        factor = next(p for p in range(2, self.nu + 1) if self.nu % p == 0)
        k = (np.arange(2 * self.H + 1) + 1) // 2
        return X.reshape(self.m, -1)[:, k % factor != 0].ravel()

    def truncation(self, X: Array, **parameters: float) -> float:
        """Estimated error of the gap motion (rms) from the force harmonics above H that the balance leaves out.

        The neglected force harmonics H < k <= 2H drive the closed structure: delta d_k = G_k f_k.
        """
        return float(self._truncation(X[None], np.array([parameters["Omega"]]), self.compiled(parameters))[0])

    def _truncation(self, X: Array, Omega: Array, compiled: Compiled) -> Array:
        """`truncation` of many motions X (P, n) at frequencies Omega (P,)."""
        f = self._neglected(X, Omega / self.nu, compiled)
        w = (Omega / self.nu)[:, None] * np.arange(self.H + 1, 2 * self.H + 1)
        G = compiled.structure.receptances(w)[0]
        delta = G @ f.transpose(0, 2, 1)[..., None]
        rms: Array = np.sqrt(0.5 * np.sum(np.abs(delta) ** 2, axis=(1, 2, 3)))
        return rms

    def _neglected(self, X: Array, omega: Array, compiled: Compiled) -> ComplexArray:
        """One-sided force harmonics H+1..2H, (P, m, H): in closed form, or as far as N samples of a law reach."""
        H, P = self.H, len(X)
        c = to_complex(X.reshape(P, self.m, -1))
        samples = samples_of(c, self.N)
        f = np.zeros((P, self.m, H), dtype=complex)
        if compiled.exact.size:
            mine = c[:, compiled.exact].reshape(-1, H + 1)
            kappa, chi = compiled.projector_of(P).project(mine, samples[:, compiled.exact].reshape(-1, self.N), 3 * H)
            both = np.concatenate([np.conj(mine[:, :0:-1]) / 2, mine[:, :1], mine[:, 1:] / 2], axis=1)
            length = scipy.fft.next_fast_len(3 * H)  # nothing is folded onto entries 2H..3H-1 of the cyclic convolution
            product = np.fft.ifft(np.fft.fft(kappa[:, 1:], length) * np.fft.fft(both, length))
            f[:, compiled.exact] = 2 * (product[:, 2 * H : 3 * H] + chi[:, H + 1 : 2 * H + 1]).reshape(P, -1, H)
        if compiled.sampled.size:
            velocity = samples_of(omega[:, None, None] * derive(c), self.N)
            phases = np.tile(2 * np.pi * self.nu * np.arange(self.N) / self.N, P)
            for j in compiled.sampled:
                p = compiled.laws[j].force(samples[:, j].ravel(), velocity[:, j].ravel(), phases)[0].reshape(P, -1)
                tail = np.fft.rfft(p)[:, H + 1 : min(2 * H, self.N // 2 - 1) + 1]
                f[:, j, : tail.shape[1]] = 2 * tail / self.N
        return f
