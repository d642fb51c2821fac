"""Limit cycles: periodic motions without excitation, of unknown frequency.

    R(X, Omega, p) = 0,   <x_ref', x> = 0          unknowns (X, Omega)

R is the harmonic balance without periodic excitation. One multiplier is +1, because the phase is arbitrary; the others
decide stability.

References
----------
Krack and Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
Doedel, Keller and Kernevez (1991), Int. J. Bifurcation Chaos 1(4), https://doi.org/10.1142/S0218127491000555.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.follow import trace_to_both_ends
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import Observed
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.solvers.newton import solve
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.autonomous.cycle_events import CycleDoublingEvent, CycleTorusEvent
from hbgear.harmonic.autonomous.equilibrium import HopfPoint
from hbgear.harmonic.autonomous.phase import in_phase, phase_vector, without_trivial
from hbgear.harmonic.autonomous.prescribed_amplitude import PrescribedAmplitude
from hbgear.harmonic.autonomous.recurrence import SampledMotion, repeated_motion
from hbgear.harmonic.autonomous.unforced import Unforced, unforced_balance
from hbgear.harmonic.balance.resolution import add_errors_of_free_motions, finer_balance
from hbgear.mechanics.models import Model, describe
from hbgear.mechanics.series.fourier import to_real


class LimitCycleProblem(MinimallyAugmentedProblem):
    """Limit cycles in a parameter of the model: a problem for `trace`, with the frequency Omega unknown.

    Parameters
    ----------
    problem : HarmonicBalance
        Balance of a model without periodic excitation.
    parameter : str, optional
        The unknown frequency, "Omega".

    Examples
    --------
    See `hbgear.analysis.limit_cycles`.

    >>> import hbgear as hb
    >>> hb.harmonic.LimitCycleProblem(hb.HarmonicBalance(hb.Duffing(), 3)).unknown_parameters
    ('Omega',)
    """

    smooth = True
    are_solutions = True
    problem: Any

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str = "Omega") -> None:
        super().__init__(problem, parameter)

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        """Return the phase condition relative to a motion."""
        size = self.problem.linearise(X, "", **parameters).size
        return Borders(size / max(norm(X), 1e-300), b=phase_vector(X, self.problem.m))

    def update_borders(self, base: Borders, X: Array, parameters: dict[str, float]) -> Borders:
        """Return the phase condition relative to another motion, with the same weight."""
        return replace(base, b=phase_vector(X, self.problem.m))

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the phase condition with its derivatives; see `MinimallyAugmentedProblem.extra`."""
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        b = np.asarray(base.b)
        derivatives = tuple((self.problem.parameter_derivative(X, name, parameters), 0.0) for name in names)
        return AugmentedResidual(evaluation, float(b @ X), b, 0.0, derivatives)

    def in_phase(self, X: Array, tangent: Array, reference: Array) -> tuple[Array, Array]:
        """Return unknowns (X, Omega) and their tangent shifted in time to be nearest to a reference."""
        return in_phase(X, tangent, reference, self.problem.m, 1)

    def events(self, parameter: str) -> tuple[Any, ...]:
        """Return period doublings and Neimark-Sacker points."""
        return CycleDoublingEvent(), CycleTorusEvent()

    @property
    def dof_names(self) -> tuple[str, ...]:
        """Names of the coordinates of the structure."""
        return self.problem.dof_names

    def motion(self, X: Array, **parameters: float) -> Array:
        """Return the harmonics of all coordinates, as real rows (n, 2H + 1), with Omega among the parameters."""
        return self.problem.motion(X, **parameters)

    def describe(self) -> dict[str, Any]:
        """Return the data for the header of a file."""
        model, balance = self.problem.model, self.problem.discretization.describe(None)
        described = describe(model.model if isinstance(model, Unforced) else model)
        return {"model": described, "balance": balance, "curve": {"of": type(self).__name__, "in": self.parameter}}

    def multipliers(
        self, X: Array, points: int | None = None, max_step: float | None = None, **parameters: float
    ) -> ComplexArray:
        """Return the multipliers of unknowns (X, Omega) without the one of the arbitrary phase, largest first."""
        X, unknown = self.solution_of(X)
        return without_trivial(self.problem.multipliers(X, points, max_step, **{**parameters, **unknown}))

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """Return regime, truncation error and the multipliers without the one of the arbitrary phase."""
        X, unknown = self.solution_of(X)
        values = {**parameters, **unknown}
        Omega = np.array([values.pop(self.parameter)])
        observed = self.problem.observe_many(X[None], self.parameter, Omega, stability, **values)[0]
        out = {name: observed[name] for name in ("regime", "error")}
        if "multipliers" in observed:
            out["multipliers"] = without_trivial(observed["multipliers"])
        return out

    def check_errors(self, solutions: CurveSolutions, observed: Observed) -> None:
        """Check errors with twice the harmonics, also that of Omega; see `hbgear.harmonic.balance.resolution`."""
        balance = finer_balance(self.problem, solutions.parameters_at(0))
        finer = None if balance is None else self.for_problem(balance)
        add_errors_of_free_motions(self, finer, balance, solutions, observed)


_FIRST_AMPLITUDE = 5e-2
"""Amplitude of the first limit cycle, relative to the length at which a law changes: small, but far above rounding."""


@checked_arguments(start="a point of hopf_points or a motion of hb.time.integrate")
def limit_cycles(
    model: Model,
    start: HopfPoint | SampledMotion,
    span: tuple[float, float],
    *,
    parameter: str = "",
    harmonics: int = 16,
    length: float = 1.0,
    **options: Any,
) -> Branch:
    """Trace limit cycles from a Hopf point of an equilibrium, or from an integrated motion.

        R(X, Omega, p) = 0,   <x_ref', x> = 0

    From a Hopf point the branch begins at a small amplitude and leaves it in the direction in which the amplitude
    grows, also if the bifurcation is subcritical. It ends at either end of the span, or where the cycles grow without
    bound. From a motion, which has reached a limit cycle of the model, it is traced to both ends of the span. Systems
    with backlash or stick-slip often have limit cycles without a Hopf point.

    Parameters
    ----------
    model : Model
        Model; its periodic excitation is left out.
    start : HopfPoint or Motion
        Point of `hopf_points`, or motion of `hbgear.time.integrate` that ends close to a limit cycle.
    span : (float, float)
        Values of the parameter between which the branch is traced, in any order.
    parameter : str, optional
        Name of the parameter. Required with a motion; by default that of the Hopf point.
    harmonics : int, optional
        H, number of harmonics. 16 by default.
    length : float, optional
        Displacement at which the nonlinearity matters; the first cycle from a Hopf point has a twentieth of it. 1 by
        default.
    **options
        Arguments of `trace`.

    Returns
    -------
    Branch
        Curve in the parameter, with the frequencies ``tracked["Omega"]``. The multiplier +1 of the arbitrary phase is
        left out.

    Raises
    ------
    NoConvergence
        If no limit cycle is found near the start: the Hopf point may be degenerate, ``length`` too large, or the
        motion not settled.
    KeyError
        If the model has no such parameter.
    ValueError
        If the start lies outside the span, or the motion does not repeat.

    Examples
    --------
    The van der Pol oscillator with eps = 0.2 has the frequency 0.99750885636:

    >>> import hbgear as hb
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class VanDerPol(hb.mechanics.Law):
    ...     eps: float
    ...
    ...     def force(self, d, v, tau):
    ...         return self.eps * (d**2 - 1) * v, 2 * self.eps * d * v, self.eps * (d**2 - 1)
    >>> @hb.mechanics.model
    ... def oscillator(eps: float = 0.2, damping: float = 0.0) -> hb.System:
    ...     return hb.System([[1.0]], [[damping]], [[1.0]], [hb.Element([1.0], VanDerPol(eps))])
    >>> (hopf,) = hb.analysis.hopf_points(oscillator(), "damping", (0.5, -0.5))
    >>> cycles = hb.analysis.limit_cycles(oscillator(), hopf, (0.0, 0.4), harmonics=7, stability=False)
    >>> round(float(cycles.tracked["Omega"][-1]), 8)
    0.99750886
    """
    problem = LimitCycleProblem(unforced_balance(model, harmonics, reduce=True))
    name = _parameter_of(start, parameter, problem)
    low, high = sorted(map(float, span))
    default = "the model", problem.parameters[name]
    origin, value = ("the Hopf point", start.value) if isinstance(start, HopfPoint) else default
    if not low <= value <= high:
        raise ValueError(f"{origin} has {name} = {value:.6g}, outside the span ({low:g}, {high:g}); widen it")
    options = {"cover": False} | options
    if isinstance(start, HopfPoint):
        U, fixed = _first_cycle(problem, start, _FIRST_AMPLITUDE * length)
        ends = (low, high) if U[-1] >= value else (high, low)
        return trace(problem, name, ends, _point(problem, U[:-1], {**fixed, name: float(U[-1])}), **options)
    parameters = problem.parameters
    Omega, rows = repeated_motion(start, harmonics)
    guess = np.append(rows.ravel(), Omega)
    U = solve(problem.with_borders_at(guess, parameters), guess, parameters).X
    return trace_to_both_ends(problem, name, span, _point(problem, U, parameters), **options)


def _parameter_of(start: HopfPoint | SampledMotion, parameter: str, problem: LimitCycleProblem) -> str:
    """Return the name of the parameter in which limit cycles are traced."""
    name = parameter or (start.parameter if isinstance(start, HopfPoint) else "")
    if not name:
        names = ", ".join(problem.parameters)
        raise ValueError(f"a motion has no parameter: give parameter=, the name of a parameter of the model ({names})")
    problem.check_parameter(name)
    return name


def _point(problem: LimitCycleProblem, U: Array, parameters: dict[str, float]) -> Point:
    """Return the limit cycle with the unknowns (X, Omega)."""
    return Point.without_data(U[:-1], {**parameters, "Omega": float(U[-1])}, problem)


def _first_cycle(problem: LimitCycleProblem, hopf: HopfPoint, amplitude: float) -> tuple[Array, dict[str, float]]:
    """Return the unknowns (X, Omega, p) of a limit cycle of small amplitude near a Hopf point, and fixed parameters."""
    m, H = problem.problem.m, problem.problem.H
    d = np.zeros((m, H + 1), dtype=complex)
    d[:, 1] = hopf.shape
    shape = to_real(d).ravel()
    d[:, 0], d[:, 1] = hopf.rest, amplitude * hopf.shape
    guess = np.concatenate([to_real(d).ravel(), [hopf.Omega, hopf.value]])
    fixed = {name: value for name, value in problem.parameters.items() if name != hopf.parameter}
    started = problem.with_borders_at(guess[:-1], {**fixed, hopf.parameter: hopf.value})
    return solve(PrescribedAmplitude(started, hopf.parameter, shape, amplitude), guess, fixed).X, fixed
