"""Verified stability: multipliers with an error, checked against signs of determinants, refined where undecided.

    modulus_error    estimated difference of the largest modulus from that of the true motion
    undecided        |max |mu| - 1| <= modulus_error

For every point of a curve:

1. **Error estimate.** The multipliers are computed with the harmonics H < k <= 2H that the forces of the motion and the
   excitation drive. A second set is computed without those driven by forces, of a motion with one more Newton step in
   which they act back on the others (`corrected_motions`). The error is estimated from the difference of the two sets
   of complex numbers (`multiplier_error`), also where a complex pair may become two real multipliers. This is done only
   where it can matter: where the relative error of the motion, times ten thousand, is large enough for a multiplier to
   reach the unit circle. To save work the second set is computed for every eighth of these points only. Between them
   the difference is taken to be proportional to the error of the motion. Points whose multipliers come within ten times
   this difference of the circle get a second set of their own.
2. **Parity.** The number of real multipliers beyond +1 is compared with the sign of det(dR/dX) at every point. For
   refined motions the number beyond -1 is compared with the sign of the half-integer block (`parity`). A mismatch flags
   the point. So do a special point that contradicts the stability, and contacts or flights shorter than half a period
   of the highest harmonic, if their stiffness is large enough for a multiplier to reach the circle: there the
   multipliers of hard stops change by more than ten thousand times the relative error of the motion.
3. **Refinement.** A point is refined if its error reaches the circle, its contacts are too short for H harmonics, or it
   is flagged. With piecewise-linear laws the exact motion is computed (`hbgear.harmonic.instants`), whose multipliers
   have no truncation error. With other laws, or where that fails, more harmonics are used, and the error covers the
   change of the multipliers. Both are solved at the same value of the parameter, and must lie on the same side of a
   fold as the point. Where no motion exists there, because truncation has displaced a fold, the parameter is free.
4. **Undecided points.** A point that is still uncertain gets a ``modulus_error`` that reaches the circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.curve.refinement import nearest_solution, shortest_step
from hbgear.continuation.events.accuracy import is_under_resolved
from hbgear.continuation.numerics.linear import norm, norms, solve_linear
from hbgear.continuation.problem.base import linearise
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.harmonic.equations.motion import regime as regime_of
from hbgear.harmonic.equations.motion import shortest_intervals, with_driven_harmonics, with_excited_harmonics
from hbgear.harmonic.instants.equations import NotPiecewiseLinear
from hbgear.harmonic.multipliers.floquet import floquet_multipliers
from hbgear.harmonic.multipliers.multiplier_error import (
    Difference,
    count_beyond,
    difference_of,
    estimate_multiplier_error,
    may_reach,
)
from hbgear.harmonic.stability.exact_motion import refine_motion, refine_near_fold
from hbgear.harmonic.stability.parity import Parity
from hbgear.harmonic.structure.linear_structure import dense

MAX_SENSITIVITY = 1e4
"""Largest difference of multipliers over the relative error of the motion."""


SAMPLING_INTERVAL = 8
"""Points per second set of multipliers, among the points whose multipliers may reach the unit circle."""


MAX_LEADING_CHANGE = 0.1
"""Change of the leading multiplier from point to point above which it may be another multiplier."""


SENSITIVITY_MARGIN = 10.0
"""Factor by which a point may be more sensitive than the sampled points next to it."""


MAX_REFINEMENTS = 3
"""Number of times that the harmonics are doubled at an undecided point."""


SHORT_INTERVAL = 2.0
"""Contact or flight, in periods of the highest harmonic, up to which multipliers may be inaccurate."""


UNRESOLVED_INTERVAL = 0.5
"""Contact or flight, in periods of the highest harmonic, up to which multipliers of the balance are not used."""


def verify_multipliers(
    problem: Any, X: Array, name: str, values: Array, observed: Sequence[dict[str, Any]],
    parameters: Mapping[str, float], work: Work | None = None,
) -> None:  # fmt: skip
    """Verify the multipliers of points in place; see `HarmonicBalance.verify_stability`."""
    work = work or Work(math.inf)
    for record in observed:
        record["modulus_error"] = math.nan
    multipliers = np.array([record["multipliers"] for record in observed])
    computed = np.flatnonzero(~np.isnan(multipliers).any(axis=1))
    if not computed.size:
        return
    multipliers, relative_errors = multipliers[computed], np.array([observed[i]["error"] for i in computed.tolist()])
    relative_errors /= np.maximum(norms(X[computed].reshape(len(computed), problem.m, -1)[:, :, 1:]), 1e-300)
    parity = Parity.of(problem, name, values[computed], parameters)
    signs = np.array([observed[i].get("determinant", 0) for i in computed.tolist()])
    flagged = parity.mismatch(multipliers, signs) | np.array(
        [observed[i].get("contradicts", False) for i in computed.tolist()]
    )
    regime = np.array([observed[i]["regime"] for i in computed.tolist()])
    intervals = _shortest_intervals(problem, X[computed], regime, {**parameters, name: float(values[computed[0]])})
    flagged |= _is_hard(problem, intervals, name, values[computed], parameters, multipliers)
    reachable = may_reach(multipliers, MAX_SENSITIVITY * relative_errors) | flagged
    if not reachable.any():
        return
    selected, multipliers, flagged = computed[reachable], multipliers[reachable], flagged[reachable]

    def differences(rows: np.ndarray) -> Difference:
        """Return the difference of the multipliers of some points from a second set."""
        second_set = _second_set(problem, X[selected[rows]], name, values[selected[rows]], parameters)
        return difference_of(multipliers[rows], second_set)

    errors, wide_errors = _estimate_errors(multipliers, relative_errors[reachable], regime[reachable], differences)
    distance = np.abs(_modulus(multipliers) - 1.0)
    uncertain = flagged | (distance <= errors)
    short = (distance <= wide_errors) & (intervals[reachable] < SHORT_INTERVAL)
    for i, record, error in zip(selected.tolist(), multipliers, errors.tolist(), strict=True):
        observed[i]["multipliers"], observed[i]["modulus_error"] = record, error
    for k in np.flatnonzero(uncertain | short).tolist():
        i = int(selected[k])
        point_parameters = {**parameters, name: float(values[i])}
        stability = _Stability(multipliers[k], float(errors[k]), not flagged[k])
        expected = parity.expected(int(observed[i].get("determinant", 0)))
        resolved = not is_under_resolved(problem, X[i], observed[i]["error"])
        stability = _refine_stability(
            problem, X[i], name, point_parameters, stability, expected, bool(uncertain[k]) and resolved, work
        )
        observed[i]["multipliers"], observed[i]["modulus_error"] = stability.multipliers, stability.stated_error


class _Stability(NamedTuple):
    """Multipliers (r,) of a motion, the error of their largest modulus, and whether they pass all checks."""

    multipliers: ComplexArray
    error: float
    consistent: bool

    @property
    def determined(self) -> bool:
        """Whether the stability is determined."""
        return self.consistent and abs(float(_modulus(self.multipliers)) - 1.0) > self.error

    @property
    def stated_error(self) -> float:
        """The error; it reaches the unit circle if a check failed."""
        if self.consistent:
            return self.error
        return max(self.error, 1.01 * abs(float(_modulus(self.multipliers)) - 1.0), 2.0 * STABILITY_TOLERANCE)


def _estimate_errors(
    mu: ComplexArray, relative_errors: Array, regime: np.ndarray, differences: Callable[[np.ndarray], Difference]
) -> tuple[Array, Array]:
    """Return errors (k,) of the largest moduli, and the errors with differences `SENSITIVITY_MARGIN` times as large.

    mu (k, r) are multipliers of motions with relative errors (k,) and with ``regime`` (k, m) of each element.
    ``differences`` computes the `Difference` of some points from a second set.
    """
    relative_errors = np.maximum(relative_errors, np.finfo(float).eps)  # a motion without contact has no error
    largest = np.take_along_axis(mu, np.abs(mu).argmax(axis=1)[:, None], axis=1)
    change = np.abs(np.diff(largest[:, 0].real + 1j * np.abs(largest[:, 0].imag)))
    breaks = (change > MAX_LEADING_CHANGE) | np.any(regime[1:] != regime[:-1], axis=1)
    sections = np.split(np.arange(len(mu)), 1 + np.flatnonzero(breaks))
    sampled = [_samples(section) for section in sections]
    computed = np.concatenate(sampled)
    values = np.array(differences(computed))
    sensitivity = np.zeros((len(values), len(mu)))
    sensitivity[:, computed] = values / relative_errors[computed]
    nearby = np.concatenate(
        [
            _nearby_sensitivity(section, chosen, sensitivity[:, chosen])
            for section, chosen in zip(sections, sampled, strict=True)
        ],
        axis=1,
    )
    estimated = relative_errors * nearby
    uncertain = ~(
        np.abs(_modulus(mu) - 1.0) > estimate_multiplier_error(mu, Difference(*(SENSITIVITY_MARGIN * estimated)))
    )
    estimated[:, computed], uncertain[computed] = values, False
    remaining = np.flatnonzero(uncertain)
    if remaining.size:
        estimated[:, remaining] = np.array(differences(remaining))
    stacked = Difference(*np.hstack([estimated, SENSITIVITY_MARGIN * estimated]))
    errors, wide_errors = np.split(estimate_multiplier_error(np.vstack([mu, mu]), stacked), 2)
    return errors, wide_errors


def _samples(rows: np.ndarray) -> np.ndarray:
    """Return the first and the last of some points, and one in eight or more between them."""
    picked: np.ndarray = rows[np.linspace(0, len(rows) - 1, -(-(len(rows) - 1) // SAMPLING_INTERVAL) + 1).astype(int)]
    return picked


def _nearby_sensitivity(rows: np.ndarray, samples: np.ndarray, sensitive: Array) -> Array:
    """Return the largest sensitivities (..., k) of the two samples on either side of each point."""
    padded = np.concatenate([sensitive[..., :1], sensitive, sensitive[..., -1:], sensitive[..., -1:]], axis=-1)
    largest = np.max([padded[..., i : i + len(samples)] for i in range(4)], axis=0)
    around: Array = largest[..., np.searchsorted(samples, rows, side="right") - 1]
    return around


def _refine_stability(
    problem: Any,
    X: Array,
    name: str,
    parameters: Mapping[str, float],
    stability: _Stability,
    expected: int,
    more_harmonics: bool,
    work: Work,
) -> _Stability:
    """Return the stability of a refined motion; more_harmonics : whether more of them may be used.

    Exact motions are computed first if all laws are piecewise linear with constant stiffness. Where a stiffness varies
    over the period they take a hundred times as long: they are computed last, and only for small structures. With other
    laws there are none.
    """
    constant = _has_constant_stiffness(problem, parameters)
    if constant:
        exact = _exact_stability(problem, X, name, parameters, stability, expected, work)
        if exact is not None:
            if exact.consistent:
                return exact
            return _exact_from_finer(problem, X, name, parameters, stability, expected, work) or exact
    if more_harmonics:  # many harmonics gain little where Newton's method in the contact instants fails
        stability = _with_more_harmonics(
            problem, X, name, parameters, stability, expected, 1 if constant else MAX_REFINEMENTS, work
        )
    if constant or stability.determined or problem.compiled(dict(parameters)).structure.n > MAX_EXACT_COORDINATES:
        return stability
    return _exact_stability(problem, X, name, parameters, stability, expected, work) or stability


MAX_EXACT_COORDINATES = 2
"""Coordinates of a structure up to which exact motions with varying stiffness are computed."""


def _has_constant_stiffness(problem: Any, parameters: Mapping[str, float]) -> bool:
    """Return whether all laws are piecewise linear without memory, with a stiffness that does not vary."""
    compiled = problem.compiled(dict(parameters))
    springs = [law.piecewise for law in compiled.laws]
    return not compiled.sliders and not any(
        law_springs is None or any(spring.stiffness.varies for spring in law_springs) for law_springs in springs
    )


def _shortest_intervals(problem: Any, X: Array, regime: np.ndarray, parameters: dict[str, float]) -> Array:
    """Return the shortest contacts or flights (k,) of motions X (k, n), in periods of the highest harmonic.

    regime (k, m) : number of breakpoints that each element passes. The result is inf if no element passes one, and
    unless all laws are piecewise linear with constant stiffness, because only such motions are refined exactly at
    little cost.
    """
    periods = np.full(len(X), np.inf)
    compiled = problem.compiled(parameters)
    if (
        compiled.aft_laws
        or compiled.damped
        or not len(compiled.breakpoints)
        or not _has_constant_stiffness(problem, parameters)
    ):
        return periods
    in_contact = np.any(regime > 0, axis=1)
    if in_contact.any():
        periods[in_contact] = shortest_intervals(compiled, X[in_contact]) * problem.H / (2 * np.pi)
    return periods


def _is_hard(
    problem: Any, intervals: Array, name: str, values: Array, parameters: Mapping[str, float], multipliers: ComplexArray
) -> NDArray[np.bool_]:
    """Return whether the shortest contacts or flights (k,) are unresolved and can change the stability.

    A contact of stiffness k and duration delta changes multipliers by about (k / m) delta / Omega^2. A soft one at a
    grazing needs no refinement if the multipliers are far from the unit circle.
    """
    short: NDArray[np.bool_] = intervals < UNRESOLVED_INTERVAL
    if short.any():
        compiled = problem.compiled({**parameters, name: float(values[0])})
        system, Omega = compiled.system, values if name == "Omega" else parameters["Omega"]
        if system.massless:
            return short
        mobility = np.einsum("ij,ij->j", system.W, np.linalg.solve(dense(system.M), system.W))
        rate = max(abs(k * law.reference) for k, law in zip(mobility.tolist(), compiled.laws, strict=True))
        effect = rate * problem.nu * intervals * (2 * np.pi / problem.H) / np.square(Omega)
        short &= effect > np.abs(_modulus(multipliers) - 1.0)
    return short


def _exact_stability(
    problem: Any, X: Array, name: str, parameters: Mapping[str, float], stability: _Stability, expected: int, work: Work
) -> _Stability | None:
    """Return the stability of the exact motion next to a motion X (n,); None if it cannot be computed.

    It counts as one small solution for each contact instant, and as more of them if Newton's method fails.

    Where there is no exact motion at this Omega, the nearest one is used if it lies on the same side of a fold. A
    motion whose parity differs from ``expected`` is not consistent. Next to the grazing of a hard stop the multipliers
    may be far from +1 on both sides of a fold.
    """
    compiled = problem.compiled(dict(parameters))
    try:
        compiled.contact_equations  # noqa: B018  raises NotPiecewiseLinear
        states = 2 * compiled.structure.n + 1
        if not work.verifies(states, max(EXACT_MOTION_COST, len(compiled.crossings(X).theta))):
            return None
        try:
            exact = refine_motion(problem, X, parameters)
        except NoConvergence:
            work.verifies(states, FAILED_MOTION_COST)
            if name != "Omega":
                return None
            exact = refine_near_fold(problem, X, parameters)
    except (NotPiecewiseLinear, NoConvergence, np.linalg.LinAlgError):
        return None
    if exact.distance > MAX_EXACT_DISTANCE:
        return None
    mu = np.zeros(len(stability.multipliers), dtype=complex)
    count = min(len(mu), len(exact.multipliers))
    mu[:count] = exact.multipliers[:count]
    other_fold_side = bool(expected) and expected != _parity_beyond_one(mu)
    error = EXACT_MULTIPLIER_ERROR
    if exact.Omega != parameters["Omega"]:
        error = max(error, abs(float(_modulus(mu) - _modulus(stability.multipliers))))
        if _parity_beyond_one(mu) < 0:  # unstable, however large the multiplier is
            error = min(error, 0.99 * float(_modulus(mu) - 1.0))
    return _Stability(mu, error, not other_fold_side)


def _parity_beyond_one(mu: ComplexArray) -> int:
    """Return +1 for an even number of real multipliers (r,) above +1, and -1 for an odd one."""
    return int(1 - 2 * (count_beyond(mu)[0] % 2))


def _exact_from_finer(
    problem: Any,
    X: Array,
    name: str,
    parameters: Mapping[str, float],
    stability: _Stability,
    expected: int,
    work: Work,
) -> _Stability | None:
    """Return the stability of the exact motion on the same side of a fold, from a solution with more harmonics.

    Next to a fold, Newton's method in the contact instants may converge to the motion on the other side. None if no
    number of harmonics gives a motion of the expected parity.
    """
    for _ in range(MAX_REFINEMENTS):
        finer = problem.refined_problem
        if finer is None or not work.allows(finer.equivalent_size):
            return None
        try:
            X, problem = solve(finer, finer.resized(X), dict(parameters)).X, finer
        except (NoConvergence, np.linalg.LinAlgError, ValueError):
            return None
        exact = _exact_stability(problem, X, name, parameters, stability, expected, work)
        if exact is not None and exact.consistent:
            return exact
    return None


EXACT_MOTION_COST = 5
"""Least cost of an exact motion, in solutions with the states of the structure as unknowns."""


FAILED_MOTION_COST = 60
"""Additional cost where Newton's method does not converge, or only with Omega as an unknown."""


MAX_EXACT_DISTANCE = 0.02
"""Distance of the exact motion from the solution of the balance, relative to its size, up to which both are the same.
"""


EXACT_MULTIPLIER_ERROR = 1e-7
"""Error of multipliers of exact motions."""


def _with_more_harmonics(
    problem: Any,
    X: Array,
    name: str,
    parameters: Mapping[str, float],
    stability: _Stability,
    expected: int,
    doublings: int,
    work: Work,
) -> _Stability:
    """Return the stability of the motion, or of the nearest one, with enough harmonics to determine it.

    doublings : largest number of doublings of the harmonics. expected : parity of the real multipliers beyond +1 at the
    point, +1 even, -1 odd and 0 unknown.
    """
    values = dict(parameters)
    for _ in range(doublings):
        finer = problem.refined_problem
        if finer is None or not work.allows(finer.equivalent_size):
            break
        try:
            X, values[name] = nearest_solution(finer, finer.resized(X), name, values)
        except (NoConvergence, np.linalg.LinAlgError, ValueError):
            break
        X, values[name] = _at_fixed_parameter(finer, X, values[name], name, parameters)
        problem, coarse = finer, _modulus(stability.multipliers)
        stability = _stability_at(problem, X, name, values, expected)
        change = REFINED_ERROR_RATIO * abs(float(_modulus(stability.multipliers) - coarse))
        stability = stability._replace(error=max(stability.error, change))
        if stability.determined:
            break
    return stability


def _stability_at(problem: Any, X: Array, name: str, parameters: Mapping[str, float], expected: int) -> _Stability:
    """Return the multipliers of one motion with their error, and whether both determinants agree with them.

    expected : parity of the real multipliers beyond +1 that the motion must have to lie on the right side of a fold.
    """
    mu, value = problem.multipliers(X, **parameters), np.array([parameters[name]])
    second_set = _second_set(problem, X[None], name, value, parameters)
    error = float(estimate_multiplier_error(mu[None], difference_of(mu[None], second_set))[0])
    parity = Parity.of(problem, name, value, parameters)
    return _Stability(mu, error, parity.agrees(problem, X, parameters, mu, expected))


def _at_fixed_parameter(
    problem: Any, X: Array, value: float, name: str, parameters: Mapping[str, float]
) -> tuple[Array, float]:
    """Return the motion at the parameter value of the point, if there is one next to a motion X at another value.

    Close to a fold, where there may be none, multipliers change so fast with the parameter that the small difference
    matters. The curve is followed from X by tangent and Newton's method. It may be so steep that the motion changes by
    a quarter of its size while the parameter changes by 2e-5, where Newton's method from X does not converge.
    """
    motion, values, change = X, dict(parameters), parameters[name] - value
    try:
        for i in range(STEPS_ALONG_CURVE):
            values[name] = value + change * i / STEPS_ALONG_CURVE
            evaluation = linearise(problem, motion, name, values)
            predicted = motion - solve_linear(evaluation.dR_dX, evaluation.dR_dp) * (change / STEPS_ALONG_CURVE)
            values[name] = value + change * (i + 1) / STEPS_ALONG_CURVE
            motion = solve(problem, predicted, values).X
            if not norm(motion - predicted) <= MAX_CORRECTION * problem.solution_norm(X):
                return X, value
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        return X, value
    return motion, parameters[name]


REFINED_ERROR_RATIO = 1 / 3
"""Error with 2H harmonics over its change from H to 2H, for errors of order H^-2.

The difference with and without the excited harmonics changes its sign along a curve, so it alone may vanish by chance.
"""


STEPS_ALONG_CURVE = 2
"""Number of steps from a refined motion to the parameter value of its point; one is too long on the steepest curves."""


MAX_CORRECTION = 0.05
"""Distance of a motion from its prediction by the tangent, relative to its size, up to which it lies on the curve."""


def _second_set(problem: Any, X: Array, name: str, values: Array, parameters: Mapping[str, float]) -> ComplexArray:
    """Return a second set of multipliers (k, r) of motions X (k, n) at values (k,) of a parameter.

    They lack the driven harmonics above H, and their motions have one more Newton step, in which these harmonics act
    back on the others.
    """
    point_parameters = [{**parameters, name: value} for value in values.tolist()]
    Omega = np.array([p["Omega"] for p in point_parameters])
    if problem.selection is None and problem.refined_problem is not None:
        X, Omega = corrected_motions(problem, X, point_parameters)
    if name == "Omega":
        compiled = problem.compiled(dict(parameters))
        return floquet_multipliers(compiled, with_excited_harmonics(compiled, X, Omega), Omega)
    cases = zip([problem.compiled(p) for p in point_parameters], X[:, None], Omega[:, None], strict=True)
    return np.array(
        [floquet_multipliers(evaluator, with_excited_harmonics(evaluator, x, w), w)[0] for evaluator, x, w in cases]
    )


def corrected_motions(problem: Any, X: Array, parameters: Sequence[Mapping[str, float]]) -> tuple[Array, Array]:
    """Return motions X (k, n) and Omega (k,) after a Newton step with the harmonics up to 2H that they drive.

    The step is the shortest one of [dR/dX, dR/dOmega] delta = -R, with the residual R of the kept harmonics at the
    motion with driven harmonics: the nearest motion, which next to a fold has another Omega. The change of Omega over
    Omega weighs as much as that of the motion over its size. A step past a first contact or slip, where multipliers
    jump, is left out.
    """
    motions, Omega = X.copy(), np.array([p["Omega"] for p in parameters])
    row_length = 2 * problem.H + 1
    for i, (x, p) in enumerate(zip(X, parameters, strict=True)):
        w, compiled, finer = p["Omega"], problem.compiled(p), problem.refined_problem.compiled(p)
        driven = with_driven_harmonics(compiled, x[None], np.array([w]))[0]
        R = finer.linearise(driven, w)[0].reshape(problem.m, -1)[:, :row_length].ravel()
        scale = np.append(np.full(len(x), problem.solution_norm(x) or 1.0), w)
        step = shortest_step(linearise(problem, x, "Omega", p), R, scale)
        if np.array_equal(regime_of(compiled, x + step[:-1]), regime_of(compiled, x)):
            motions[i], Omega[i] = x + step[:-1], w + step[-1]
    return motions, Omega


def _modulus(mu: ComplexArray) -> Any:
    """Return the largest modulus of multipliers (..., r)."""
    return np.abs(mu).max(axis=-1, initial=0.0)
