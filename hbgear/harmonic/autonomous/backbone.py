"""Backbones: periodic motions of a nonlinear mode over its amplitude (extended periodic motions).

    M q'' + C q' - 2 D Omega M q' + K q + W p(d) = F_0         unknowns (X, D, Omega)
    <x_ref', x> = 0,   rms(X) = amplitude

The artificial damping -2 D Omega M q' replaces the excitation that would sustain the motion, so D is the modal damping
ratio and Omega the modal frequency at this amplitude. Without dissipation D is zero and the motion is a nonlinear
normal mode. The balance is that of `hbgear.harmonic.harmonic_balance`, with receptances of

    D_k = K + i k Omega C - (k Omega)^2 M - 2 i D k Omega^2 M

References
----------
Krack (2015), Comput. Struct. 154, 59-71, https://doi.org/10.1016/j.compstruc.2015.03.008.
Krack and Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import POSITIVE, Range, checked, counted
from hbgear.continuation.events.event import Event
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem, Observed
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.autonomous.modes import STATIC_FREQUENCY, LinearMode, linear_mode
from hbgear.harmonic.autonomous.phase import in_phase, phase_vector
from hbgear.harmonic.autonomous.unforced import unforced_balance
from hbgear.harmonic.balance.resolution import add_errors_of_free_motions, finer_balance
from hbgear.harmonic.bifurcations.grazing import GrazingEvent
from hbgear.harmonic.bifurcations.slip import SlipEvent
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.structure.receptance import LinearPart
from hbgear.mechanics.models import Model, describe
from hbgear.mechanics.series.fourier import to_complex, to_real

_LOWEST_START_RATIO = 1e-3
"""Amplitude at which the linear mode is a good guess, over the amplitude at which it is not."""

_SMALLEST_DAMPING_SCALE = 1e-2
"""Change of the modal damping ratio that counts as much as the whole motion in the arclength of a backbone."""

AMPLITUDE = "amplitude"
"""Name of the continuation parameter of a backbone: rms of the alternating part of all elements together."""


MAX_OTHER_WHIRL = 1e-3
"""Other whirl relative to the motion, from which a backbone of an isotropic rotor is no longer one of whirl."""


class _WhirlLoss(Event):
    """End of the whirl of an isotropic rotor that is in contact on one side."""

    def termination(self, name: str, value: float) -> tuple[Status, str]:
        """Return status and message of the end."""
        return Status.EVENT, (
            f"the whirl ends at the first contact, at {name} = {value:.6g}: forward and backward whirl have one "
            "frequency, and contact on one side, next to which a mean load holds the rotor, couples them. Remove the "
            "mean load, or give the supports different stiffness in both directions"
        )


def _whirl_loss(other: ComplexArray, m: int) -> Event:
    """Return the event at which the motion contains the ``other`` whirl (m,) of an isotropic rotor: the curve ends."""

    def share(point: Point) -> float:
        fundamental = to_complex(point.X.reshape(m, -1))[:, 1]
        return float(abs(np.vdot(other, fundamental))) / norm(fundamental) - MAX_OTHER_WHIRL

    return _WhirlLoss("WL", share, "end: contact on one side couples both whirls", "x", terminal=True)


class BackboneProblem(ContinuationProblem):
    """Extended periodic motions of one mode: a problem for `trace` in ``amplitude``, with Omega and D unknown.

    Parameters
    ----------
    model : Model
        Model; its excitation is left out, mean loads remain.
    mode : int, optional
        Number of the linear mode at which the backbone begins, in ascending frequency. 1 by default.
    harmonics : int, optional
        H, number of harmonics. 16 by default.

    Raises
    ------
    ValueError
        If the model has fewer modes, a law varies with the phase and has no mean, or the structure depends on Omega, is
        measured or is too large.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.harmonic.BackboneProblem(hb.Duffing(), harmonics=5)
    >>> curve = hb.trace(problem, "amplitude", (0.01, 1.0))
    >>> bool(curve.tracked["Omega"][-1] > curve.tracked["Omega"][0])
    True
    """

    usual_parameter = AMPLITUDE
    unknown_parameters = ("Omega", "modal_damping")
    singular_hint = "an internal resonance, or a gap that stays open"

    @checked_arguments()
    def __init__(self, model: Model, mode: int = 1, harmonics: int = 16) -> None:
        counted("mode", mode, 10_000)
        self.balance = unforced_balance(model, harmonics)
        self.model, self.mode = model, int(mode)
        self._default_mode = linear_mode(self.balance.compiled({}), self.mode)
        self._phase = phase_vector(self._linear_motion(self._default_mode, 1.0)[:-2], self.balance.m)

    def __repr__(self) -> str:
        return f"BackboneProblem({self.model!r}, mode={self.mode}, harmonics={self.balance.H})"

    # ---- parameters and unknowns

    @property
    def size(self) -> int:  # type: ignore[override]
        """Number of unknowns: the unknowns of the balance, D and Omega."""
        return self.balance.size + 2

    @property
    def smooth(self) -> bool:  # type: ignore[override]
        """Whether the Jacobian is differentiable."""
        return self.balance.smooth

    @property
    def is_nonsmooth(self) -> bool:
        """Whether the tangent may be discontinuous, as where a friction slider begins to slip."""
        return self.balance.is_nonsmooth

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the model."""
        return self.balance.parameters

    @property
    def layout(self) -> Layout:
        """Names and measures of the unknowns of the motion."""
        return self.balance.layout

    @property
    def m(self) -> int:
        """Number of displacements of the elements."""
        return self.balance.m

    @property
    def H(self) -> int:
        """Largest order."""
        return self.balance.H

    @property
    def orders(self) -> Array:
        """Orders of the harmonics."""
        return self.balance.orders

    def check_parameter(self, name: str) -> None:
        """Raise KeyError for a name other than ``amplitude`` and the parameters of the model."""
        if name != AMPLITUDE:
            self.balance.check_parameter(name)
        if name == "Omega":
            raise ValueError("Omega is an unknown of a backbone; trace it in amplitude or in a parameter of the model")

    def range_of(self, name: str) -> Range:
        """Return the valid values of a parameter; amplitudes are positive."""
        return POSITIVE if name == AMPLITUDE else self.balance.range_of(name)

    def unit_of(self, name: str, value: float) -> float:
        """Return the size relative to which a parameter change is small."""
        return abs(value) if name == AMPLITUDE else self.balance.unit_of(name, value)

    def missing(self, known: Sequence[str]) -> Sequence[str]:
        """Return ``amplitude`` if it is not given."""
        return () if AMPLITUDE in known else (AMPLITUDE,)

    def split(self, X: Array) -> tuple[Array, dict[str, float]]:
        """Return the unknowns of the motion, and D and Omega by name."""
        return X[:-2], {"modal_damping": float(X[-2]), "Omega": float(X[-1])}

    def join(self, X: Array, parameters: Mapping[str, float]) -> Array:
        """Return the unknowns of this problem from the unknowns of a motion and all parameters."""
        return np.concatenate([X, [parameters["modal_damping"], parameters["Omega"]]])

    def from_point(self, point: Point) -> Array:
        """Return the unknowns of the motion of a point."""
        return self.balance.from_point(point)

    def resized(self, X: Array) -> Array:
        """Return unknowns of any number of harmonics, cut or padded to this number."""
        return X if len(X) == self.size else np.concatenate([self.balance.resized(X[:-2]), X[-2:]])

    def smallest_scale(self, name: str) -> float:
        """Return the smallest scale of an unknown; the damping of a conservative system is rounding."""
        return _SMALLEST_DAMPING_SCALE if name == "modal_damping" else 0.0

    def solution_norm(self, X: Array) -> float:
        """Return the norm of the alternating part, which scales the arclength."""
        return self.balance.solution_norm(X[:-2])

    def with_borders_at(self, X: Array, parameters: Mapping[str, float], renew: bool = False) -> Self:
        """Return the problem with the phase condition relative to a motion, if ``renew``; else itself."""
        return self._with(_phase=phase_vector(X[:-2], self.balance.m)) if renew else self

    def in_phase(self, X: Array, tangent: Array, reference: Array) -> tuple[Array, Array]:
        """Return unknowns and their tangent shifted in time to be nearest to a reference."""
        return in_phase(X, tangent, reference, self.balance.m, 2)

    def _with(self, **changes: Any) -> Self:
        out = copy.copy(self)
        vars(out).update(changes)
        return out

    @property
    def refined_problem(self) -> Self | None:
        """The problem with 2H harmonics."""
        finer = self.balance.refined_problem
        return None if finer is None else self._on(finer)

    @property
    def comparisons(self) -> Sequence[tuple[ContinuationProblem, float]]:
        """Problems with other numbers of harmonics, with their weights in error estimates."""
        return tuple((self._on(balance), weight) for balance, weight in self.balance.comparisons)

    def at_resolution_of(self, point: Point) -> Self:
        """Return the problem with the harmonics of a point if these are more."""
        balance = self.balance.at_resolution_of(point)
        return self if balance is self.balance else self._on(balance)

    def _on(self, balance: Any) -> Self:
        """Return the problem with another balance."""
        return self._with(balance=balance, _phase=balance.resized(self._phase))

    # ---- equations

    @checked_arguments()
    def start(self, amplitude: float, **parameters: float) -> Array:  # type: ignore[override]
        """Return the motion of an amplitude: from the linear mode, or traced from a thousandth of the amplitude.

        Raises
        ------
        NoConvergence
            If Newton's method does not converge.
        """
        checked("start", AMPLITUDE, amplitude, POSITIVE)
        values = {**parameters, AMPLITUDE: float(amplitude)}
        changed = any(self.parameters[name] != value for name, value in parameters.items())
        mode = linear_mode(self.balance.compiled(parameters), self.mode) if changed else self._default_mode
        try:
            return solve(self, self._linear_motion(mode, amplitude), values).X
        except NoConvergence:
            low = _LOWEST_START_RATIO * amplitude
            guess = self._linear_motion(mode, low)
            curve = raise_if_interrupted(
                trace(self, AMPLITUDE, (low, amplitude), guess, at=parameters, cover=False, stability=False)
            )
            if not curve.status.complete:
                raise
            return self.join(curve[-1].X, curve[-1].parameters)

    def _linear_motion(self, mode: LinearMode, amplitude: float) -> Array:
        """Return the unknowns of a motion of a linear mode."""
        d = np.zeros((self.balance.m, self.balance.H + 1), dtype=complex)
        d[:, 0], d[:, 1] = mode.rest, np.sqrt(2.0) * amplitude * mode.shape
        return np.concatenate([to_real(d).ravel(), [mode.damping, mode.omega]])

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return the residual (n,), its Jacobian (n, n), its derivative in a parameter and the size of its terms."""
        d, unknown = self.split(X)
        evaluator, n = self.balance.compiled(model_parameters(parameters)), self.balance.size
        linear, rate, terms = _linear_part(evaluator, unknown["Omega"], unknown["modal_damping"])
        R, J, dR_dOmega, size = evaluator.linearise_with(d, unknown["Omega"], linear)
        rows = to_complex(d.reshape(evaluator.m, -1))
        springs = np.repeat(_springs(evaluator), n // evaluator.m)
        size = max(size, norm(springs * d))  # in a linear mode without forces of the elements all terms are rounding
        size = max(size, CANCELLED_TERMS * float(np.linalg.norm(terms @ np.abs(rows.T[1:, :, None]))))
        amplitude = parameters[AMPLITUDE]
        if not amplitude > 0:  # of a prediction; the span is positive
            raise NoConvergence(f"amplitude = {amplitude:.6g} must be positive", X, parameters, [])
        alternating = d * self._alternating
        rms = norm(alternating) / np.sqrt(2.0)
        # the conditions of phase and amplitude weigh as much as the balance
        weight = size / amplitude
        out, A = np.empty(n + 2), np.zeros((n + 2, n + 2))
        out[:n], out[n], out[n + 1] = R, weight * (self._phase @ d), weight * (rms - amplitude)
        A[:n, :n], A[:n, n + 1] = J, dR_dOmega
        A[:n, n] = to_real(evaluator.structure.force_sums @ np.einsum("kij,jk->ik", rate, rows)).ravel()
        A[n, :n], A[n + 1, :n] = weight * self._phase, 0.5 * weight * alternating / (rms or 1.0)
        if self._default_mode.partner is not None and not self._touches(d, parameters, unknown):
            other = self._partner * np.sqrt(_springs(evaluator).max())
            out[:n] += other.T @ (other @ d)
            A[:n, :n] += other.T @ other
        return Evaluation(out, A, _parameter_derivative(self, X, name, parameters, weight), size)

    def _touches(self, d: Array, parameters: Mapping[str, float], unknown: Mapping[str, float]) -> bool:
        """Return whether any contact closes in a motion."""
        values = {**model_parameters(parameters), "Omega": unknown["Omega"]}
        return bool((self.balance.threshold_distances("edge", d, **values) > 0).any())

    @property
    def _partner(self) -> Array:
        """Return the components (2, n) of motions in the other whirl of an isotropic rotor.

        Without contact both whirls combine in any ratio. Springs along the other one choose the motion without it, on
        which they exert no force.
        """
        assert self._default_mode.partner is not None
        z = np.zeros((self.balance.m, self.balance.size // self.balance.m), dtype=complex)
        z[:, 1:3] = self._default_mode.partner.conj()[:, None] * to_complex(np.eye(3))[1:, 1]
        return np.array([z.real.ravel(), z.imag.ravel()])

    @property
    def _alternating(self) -> Array:
        """Return ones (n,) at the alternating unknowns and zeros at the means."""
        out = np.ones(self.balance.size)
        out[self.balance.means] = 0.0
        return out

    # ---- monitored quantities

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """Return the regime and the truncation error of the motion."""
        d, unknown = self.split(X)
        values = model_parameters(parameters)
        observed = self.balance.observe_many(d[None], "Omega", np.array([unknown["Omega"]]), False, **values)[0]
        return {name: observed[name] for name in ("regime", "error", "clearance", "edge", "slip") if name in observed}

    def check_errors(self, solutions: CurveSolutions, observed: Observed) -> None:
        """Check errors with twice the harmonics, also of Omega and D; see `hbgear.harmonic.balance.resolution`."""
        balance = finer_balance(self.balance, model_parameters(solutions.fixed))
        finer = None if balance is None else self._on(balance)
        add_errors_of_free_motions(self, finer, balance, solutions, observed)

    def events(self, parameter: str) -> tuple[Event, ...]:
        """Return grazing contacts, and first slips of friction sliders."""
        slips = (SlipEvent(),) if self.balance.slider_names else ()
        whirl = () if self._default_mode.partner is None else (_whirl_loss(self._default_mode.partner, self.m),)
        return GrazingEvent(), *slips, *whirl

    def threshold_distances(self, kind: str, X: Array, **parameters: float) -> Array:
        """Return the distances of the motion from its thresholds, see `HarmonicBalance.threshold_distances`."""
        return self.balance.threshold_distances(kind, X[:-2], **self._balance_parameters(X, parameters))

    def threshold(self, kind: str, X: Array, which: int, **parameters: float) -> tuple[float, Array]:
        """Return one distance and its derivative in the motion, see `HarmonicBalance.threshold`."""
        return self.balance.threshold(kind, X[:-2], which, **self._balance_parameters(X, parameters))

    def threshold_names(self, kind: str) -> tuple[str, ...]:
        """Return the meaning of each entry of `threshold_distances`."""
        return self.balance.threshold_names(kind)

    def _balance_parameters(self, X: Array, parameters: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters of the balance at a solution."""
        return {**model_parameters(parameters), "Omega": self.split(X)[1]["Omega"]}

    def describe(self) -> dict[str, Any]:
        """Return the data for the header of a file."""
        curve = {"of": type(self).__name__, "mode": self.mode}
        return {"model": describe(self.model), "balance": self.balance.discretization.describe(None), "curve": curve}

    @property
    def dof_names(self) -> tuple[str, ...]:
        """Names of the coordinates of the structure."""
        return self.balance.dof_names

    def motion(self, X: Array, **parameters: float) -> Array:
        """Return the harmonics of all coordinates, as real rows (n, 2H + 1), with Omega and D among the parameters."""
        evaluator = self.balance.compiled(model_parameters(parameters))
        Omega, D = parameters["Omega"], parameters["modal_damping"]
        d, f = to_complex(X.reshape(evaluator.m, -1)), to_complex(evaluator.forces(X, Omega))
        return to_real(_coordinates(evaluator, Omega, D, d, f).T)


def model_parameters(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of the model alone."""
    return {name: x for name, x in parameters.items() if name not in (AMPLITUDE, "Omega", "modal_damping")}


def _parameter_derivative(
    problem: BackboneProblem, X: Array, name: str, parameters: dict[str, float], weight: float
) -> Array:
    """Return the derivative of the residual in a parameter, zeros without a name."""
    out = np.zeros(len(X))
    if name == AMPLITUDE:
        out[-1] = -weight
    elif name:
        d, unknown = problem.split(X)

        def residual(values: dict[str, float]) -> tuple[Array]:
            evaluator = problem.balance.compiled(model_parameters(values))
            linear, *_ = _linear_part(evaluator, unknown["Omega"], unknown["modal_damping"])
            return (evaluator.linearise_with(d, unknown["Omega"], linear)[0],)

        (out[:-2],) = parameter_derivatives(problem, name, parameters, residual)
    return out


_SPRING_FACTOR = np.sqrt(3.0)
"""Springs of the receptances over the reference springs. With a factor of one the receptance of an undamped structure
would be infinite at the linear frequency, where backbones with backlash begin."""


CANCELLED_TERMS = 1e-5
"""Fraction of the terms of D q that counts in the size of R [-]: with a tolerance of 1e-10 five of their roundings.

In a mode that the elements measure little, these terms are large and cancel, and R changes much with Omega.
"""


SYMMETRY_ROUNDING = 1e-15
"""Difference of opposite entries of a matrix, relative to its largest entry, that is rounding error."""


def _springs(evaluator: Evaluator) -> Array:
    """Return the springs (m,) that the receptances include."""
    return _SPRING_FACTOR * evaluator.structure.kr


def _matrices(evaluator: Evaluator) -> Array:
    """Return M, C and K with the springs of the receptances, (3, n, n)."""
    s = evaluator.structure
    return np.stack([s.M, s.C, s.K + (s.W * (_springs(evaluator) - s.kr)) @ s.W.T])


def _dynamic_stiffness(matrices: Array, orders: Array, Omega: float, D: float) -> ComplexArray:
    """Return D_k = K + i k Omega C - (k^2 + 2 i k D) Omega^2 M of orders k, (K, n, n)."""
    factors = np.stack([-(orders**2 + 2j * orders * D) * Omega**2, 1j * orders * Omega, np.ones(len(orders))])
    n = matrices.shape[-1]
    return (factors.T @ matrices.reshape(3, -1)).reshape(-1, n, n)


def _are_symmetric(matrices: Array) -> bool:
    """Return whether matrices (3, n, n) are symmetric except for rounding."""
    difference = np.abs(matrices - matrices.transpose(0, 2, 1)).max(axis=(1, 2))
    return bool(np.all(difference <= SYMMETRY_ROUNDING * np.abs(matrices).max(axis=(1, 2))))


def _linear_part(evaluator: Evaluator, Omega: float, D: float) -> tuple[LinearPart, ComplexArray, Array]:
    """Return the linear part of the balance with its derivative in Omega, and dZ_k/dD (K + 1, m, m).

    With Y_k = (W^T D_k^-1 W)^-1, the last result is |Y W^T D^-1| |D| |D^-1 W Y| (K, m, m): the size of the terms of
    the structure that cancel in Y.
    """
    s, static = evaluator.structure, evaluator.linear(STATIC_FREQUENCY)
    matrices, k = _matrices(evaluator), evaluator.orders[1:, None, None]
    value = _dynamic_stiffness(matrices, evaluator.orders[1:], Omega, D)
    W = np.broadcast_to(s.W, (len(value), *s.W.shape))
    # left and right solutions of a symmetric stiffness are the same
    Q = np.linalg.solve(value, W)
    Lt = (Q if _are_symmetric(matrices) else np.linalg.solve(value.transpose(0, 2, 1), W)).transpose(0, 2, 1)
    G, damped, inertial = W.transpose(0, 2, 1) @ Q, Lt @ (s.C @ Q), Lt @ (s.M @ Q)
    dG_dOmega = 1j * k * damped - (2 * Omega * (k**2 + 2j * k * D)) * inertial
    out, rate = LinearPart.zero(len(evaluator.orders), s.m), np.zeros((len(evaluator.orders), s.m, s.m), dtype=complex)
    out.matrices[0, 0], out.constants[0, 0] = static.Z[0], static.g[0]
    blocks = np.ix_(np.arange(len(value)), s.independent, s.independent) if s.constrained else ...
    Y, dY, dD = out.matrices[0, 1:], out.matrices[1, 1:], rate[1:]
    Y[blocks] = np.linalg.inv(G[blocks])
    dY[blocks] = Y[blocks] @ dG_dOmega[blocks] @ Y[blocks]
    dD[blocks] = Y[blocks] @ (-2j * k * Omega**2 * inertial)[blocks] @ Y[blocks]
    terms = np.abs(Y @ Lt) @ np.abs(value) @ np.abs(Q @ Y)
    Y -= np.diag(_springs(evaluator))
    return out, rate, terms


def _coordinates(evaluator: Evaluator, Omega: float, D: float, d: ComplexArray, f: ComplexArray) -> ComplexArray:
    """Return the harmonics (K + 1, n) of the coordinates from displacements and law forces, (m, K + 1) each."""
    s = evaluator.structure
    q = np.zeros((len(evaluator.orders), s.n), dtype=complex)
    q[0] = evaluator.receptance.motion(STATIC_FREQUENCY, d.T, f.T)[0]
    u = (f.T - _springs(evaluator) * d.T)[1:]
    stiffness = _dynamic_stiffness(_matrices(evaluator), evaluator.orders[1:], Omega, D)
    q[1:] = np.linalg.solve(stiffness, -(u @ s.W.T)[..., None])[..., 0]
    return q
