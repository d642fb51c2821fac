"""Initial guesses for Newton's method, and a homotopy to a first periodic motion.

The first guess is the linear response about the static state under the constant loads. Other static states are searched
at the breakpoints of laws, and where the stiffness of a smooth law has changed by the stiffness of the structure. All
lengths come from the model, so the search does not depend on its units.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import islice
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.homotopy import solve_along
from hbgear.continuation.solvers.newton import NoConvergence, Solution, solve
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.equations.evaluator import Evaluator
from hbgear.harmonic.equations.static_state import linear_response, static_states
from hbgear.mechanics.series.fourier import places, to_real
from hbgear.mechanics.series.real_basis import derivative


def find_motion(problem: Any, parameters: dict[str, float]) -> Array:
    """Return a periodic motion of a `HarmonicBalance` at the given parameters.

    Newton starts from the `initial_guesses` about stable static states, then from static states with dampers that are
    removed along a path, then about all static states, and last from a motion at another frequency. With many unknowns
    the path follows the first guess, and no motion at another frequency is searched. Between several stable static
    states an unstable motion is replaced by a stable one that crosses all of them, if one is found.

    Raises
    ------
    NoConvergence
        If Newton converges from none of these guesses.
    """
    X = _first_motion(problem, parameters)
    return X if problem.size > MANY_UNKNOWNS else _across_wells(problem, parameters, X)


def _first_motion(problem: Any, parameters: dict[str, float]) -> Array:
    """Return the motion of the first guess from which Newton's method converges, see `find_motion`."""
    many = problem.size > MANY_UNKNOWNS
    compiled, Omega = problem.compiled(parameters), parameters["Omega"]
    stable = initial_guesses(compiled, Omega, unstable=False)
    try:
        return _solution_from_guesses(problem, parameters, islice(stable, 1) if many else stable)
    except NoConvergence as error:
        failure = error
    # before guesses about unstable states, which lead to saddles far away
    with suppress(NoConvergence):
        return from_damped(problem, parameters).X
    with suppress(NoConvergence):
        return _solution_from_guesses(problem, parameters, initial_guesses(compiled, Omega))
    if many:
        raise NoConvergence(f"{failure}; {_ADVICE}", failure.X, failure.parameters, failure.residuals) from None
    # a fold may end the motions near these guesses; at another frequency they can be close to a motion
    X = continue_from_nearby_frequency(problem, parameters)
    if X is None:
        raise failure
    return X


MANY_UNKNOWNS = 150
"""Number of unknowns above which the search is shorter, because it takes minutes: as of a gear pair with a torque that
varies over a revolution. Its motions with impacts, mostly unstable, are far from all guesses, which have none. A train
of two stages has motions with impacts that the path finds in a third of the time of all guesses."""

_ADVICE = (
    "there may be no stable motion of one period here, as where teeth rattle: integrate in time (hb.time.sweep), give "
    "fewer harmonics, or start at another frequency"
)


def _across_wells(problem: Any, parameters: dict[str, float], X: Array) -> Array:
    """Return a stable motion across all stable static states if there are several and X is unstable; else X.

    Motions within one well lose their stability where the load drives the system across the wells, and no linear
    response is near the large motion. Its guesses are a harmonic about the middle of the states, in four phases.
    """
    if not _unstable(problem, parameters, X):
        return X
    compiled, Omega = problem.compiled(parameters), parameters["Omega"]
    states = [static for static in static_states(compiled, Omega) if static.balanced and static.stable]
    if len(states) < 2:
        return X
    ends = np.array([static.d for static in states])
    d = linear_response(compiled, Omega, states[0])
    driven = 1 + int(np.argmax(np.abs(d[:, 1:]).max(axis=0)))
    for amplitude in _WELL_AMPLITUDES:
        for phase in (1, 1j, -1, -1j):
            d[:] = 0
            d[:, 0], d[:, driven] = (ends.max(axis=0) + ends.min(axis=0)) / 2, amplitude * phase * np.ptp(ends, axis=0)
            with suppress(NoConvergence):
                Y = solve(problem, to_real(d).ravel(), parameters).X
                if not _unstable(problem, parameters, Y):
                    return Y
    return X


def _unstable(problem: Any, parameters: dict[str, float], X: Array) -> bool:
    """Return whether a motion has a multiplier outside the unit circle; False where multipliers are not computed."""
    try:
        return bool(np.abs(problem.multipliers(X, **parameters)).max() > 1 + _MULTIPLIER_MARGIN)
    except ValueError:  # too many coordinates, or measured receptances
        return False


_WELL_AMPLITUDES = (0.75, 1.25)
"""Amplitudes of a guess across wells, over the distance of the outer wells: just beyond them, and far beyond."""

_MULTIPLIER_MARGIN = 1e-3
"""Distance of a multiplier from the unit circle up to which it is attributed to truncation."""


def _solution_from_guesses(problem: Any, parameters: dict[str, float], guesses: Iterable[Array]) -> Array:
    """Return the solution from the first guess from which Newton's method converges; else raise its error."""
    failure: NoConvergence | None = None
    for guess in guesses:
        try:
            return solve(problem, guess, parameters).X
        except NoConvergence as error:
            failure = failure or error
    assert failure is not None
    raise failure


def initial_guesses(compiled: Evaluator, Omega: float, unstable: bool = True) -> Iterator[Array]:
    """Yield the linear responses about static states, and the static states, the stable ones first.

    Unstable states may be left out if there are stable ones.
    """
    for number, static in enumerate(static_states(compiled, Omega)):
        if number and not (unstable or static.stable):
            return
        d = linear_response(compiled, Omega, static)
        yield to_real(d).ravel()
        yield to_real(np.concatenate([d[:, :1], 0 * d[:, 1:]], axis=1)).ravel()


class _DampedBalance(ContinuationProblem):
    """Homotopy from a static state at s = 0 to the balance at s = 1, with dampers parallel to the elements.

        R_0 = 0,   s^3 R_k + (1 - s)^3 i (k / nu) kr d_k = 0,  k > 0

    With damping the power of the loads bounds the velocity, so the path stays bounded for s < 1. It ends at a motion if
    there is only one static state. The third power varies the damping over many orders of magnitude along the path,
    because contacts may be stiff compared with the structure.
    """

    def __init__(self, problem: Any, fixed: Mapping[str, float]) -> None:
        self.problem, self.fixed = problem, fixed
        compiled = problem.compiled(fixed)
        positions = places(compiled.orders)
        rates = derivative(np.eye(2 * compiled.H + 1)).T[np.ix_(positions, positions)] / problem.nu
        self.dampers = np.kron(np.diag(compiled.structure.kr), rates)
        self.moving = np.tile(positions > 0, compiled.m)

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return the equations at s."""
        s, base = parameters["s"], self.problem.linearise(X, "", **self.fixed)
        force_factor, damped = np.where(self.moving, s**_DAMPING_POWER, 1.0), self.dampers @ X
        damping_factor = (1 - s) ** _DAMPING_POWER
        R = force_factor * base.R + damping_factor * damped
        J = force_factor[:, None] * base.dR_dX + damping_factor * self.dampers
        rate = np.where(self.moving, s ** (_DAMPING_POWER - 1) * base.R, 0.0) - (1 - s) ** (_DAMPING_POWER - 1) * damped
        return Evaluation(R, J, _DAMPING_POWER * rate, base.size)


_DAMPING_POWER = 3
"""Exponent of s and 1 - s in the homotopy, see `_DampedBalance`."""


def from_damped(problem: Any, parameters: dict[str, float]) -> Solution:
    """Return a motion of a `HarmonicBalance` by the homotopy that removes dampers, starting at a static state.

    Raises
    ------
    NoConvergence
        If no path from a static state reaches a motion.
    """
    compiled = problem.compiled(parameters)
    failure: NoConvergence | None = None
    for static in static_states(compiled, parameters["Omega"]):
        if not static.balanced:
            continue
        d = np.zeros((compiled.m, len(compiled.orders)), dtype=complex)
        d[:, 0] = static.d
        X = to_real(d).ravel()
        try:
            steps = 600 if problem.size <= MANY_UNKNOWNS else 200  # paths that reach a motion have 30 to 190
            return solve_along(_DampedBalance(problem, parameters), problem, X, parameters, steps)
        except NoConvergence as error:
            failure = failure or error
    raise failure or NoConvergence("there is no static state", np.zeros(problem.size), parameters, [])


_FREQUENCY_FACTORS = (1.1, 0.9, 1.3, 0.75, 1.8, 0.5, 3.0, 6.0)
"""Factors of the frequency at which a motion is searched instead, in this order."""


def continue_from_nearby_frequency(problem: Any, parameters: dict[str, float]) -> Array | None:
    """Return a motion at the given parameters by continuation from another frequency; None if this fails.

    It is used if Newton's method converges from no initial guess at this frequency. problem : `HarmonicBalance`.
    """
    Omega = parameters["Omega"]
    fixed = {name: value for name, value in parameters.items() if name != "Omega"}
    for nearby_Omega in (Omega * factor for factor in _FREQUENCY_FACTORS):
        try:
            nearby = {**parameters, "Omega": nearby_Omega}
            guesses = initial_guesses(problem.compiled(nearby), nearby_Omega)
            X = _solution_from_guesses(problem, nearby, guesses)
            with warnings.catch_warnings(action="ignore"):  # warnings about the auxiliary branch are of no use
                steps, span = StepControl(max_points=1000), (nearby_Omega, Omega)
                plain: dict[str, Any] = {"stability": False, "special": False, "cover": False}
                curve = trace(problem, "Omega", span, X, at=fixed, steps=steps, **plain)
                raise_if_interrupted(curve)
        except NoConvergence:  # also of a motion without contact, from which no curve begins: its mean is arbitrary
            continue
        if curve.values[-1] == Omega:
            with suppress(NoConvergence):  # with the harmonics of the problem
                return solve(problem, problem.from_point(curve[-1]), parameters).X
    return None
