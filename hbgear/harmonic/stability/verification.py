"""Verified stability: multipliers with an error, checked against signs of determinants, refined where in doubt.

    modulus_error    distance by which the largest modulus may differ from that of the true motion
    undecided        |max |mu| - 1| <= modulus_error

For every point of a curve:

1. The multipliers are those of the motion with the harmonics H < k <= 2H that its own forces drive. A second set is
   computed without these harmonics, and the error is estimated from the difference of the two sets of complex numbers
   (`multiplier_error`), also where a complex pair may be two real multipliers. It is computed where it can matter: if
   the relative error of the motion, times ten thousand, is enough for a multiplier to reach the unit circle. Of these
   points one in eight has a second set of multipliers; between them the difference is taken to be proportional to the
   error of the motion, and points whose multipliers come within ten times that of the circle have a set of their own.
2. The number of real multipliers beyond +1 is compared with the sign of det(dR/dX) at every point, and for refined
   motions the number beyond -1 with that of the half-integer block (`parity`). A mismatch flags the point, as do a
   special point that contradicts it, and contacts or flights shorter than half a period of the highest harmonic, for
   multipliers of hard stops change by more than ten thousand times the relative error of such a motion.
3. Points that remain in doubt, because their error reaches the circle, their contacts are too short for H harmonics, or
   they are flagged, are refined. With piecewise-linear laws the exact motion is computed (`hbgear.instants`), whose
   multipliers have no truncation error; with others, or where that fails, one with more harmonics. Both are solved for
   at the same value of the parameter. Where no motion exists there, because truncation has displaced a fold, the
   parameter is free, and the refined motion must lie on the same side of the fold as the point.
4. Points whose doubt remains have a ``modulus_error`` that reaches the circle: they are undecided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.curve.refinement import nearest_solution
from hbgear.continuation.events.accuracy import is_under_resolved
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.solvers.newton import NoConvergence, solve
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

_SENSITIVE = 1e4  # largest difference of multipliers over the relative error of the motion


_APART = 8  # rows per second set of multipliers, of the rows that may reach the unit circle


_ANOTHER = 0.1  # change of the largest multiplier from row to row above which it may be another one


_BETWEEN = 10.0  # factor by which a row may be more sensitive than the sampled rows next to it


_TIMES = 3  # times that the number of harmonics is doubled where a verdict is in doubt


_SHORT = 2.0  # contact or flight, in periods of the highest harmonic, up to which multipliers may be inaccurate


_UNRESOLVED = 0.5  # such a duration up to which the multipliers of the balance are not relied on


def verify_multipliers(
    problem: Any, X: Array, name: str, values: Array, seen: Sequence[dict[str, Any]], parameters: Mapping[str, float],
    work: Work | None = None,
) -> None:  # fmt: skip
    """See `HarmonicBalance.decided`."""
    work = work or Work(math.inf)
    for one in seen:
        one["modulus_error"] = math.nan
    mu = np.array([one["multipliers"] for one in seen])
    known = np.flatnonzero(~np.isnan(mu).any(axis=1))
    if not known.size:
        return
    mu, rough = mu[known], np.array([seen[i]["error"] for i in known.tolist()])
    rough /= np.maximum(norms(X[known].reshape(len(known), problem.m, -1)[:, :, 1:]), 1e-300)
    parity = Parity.of(problem, name, values[known], parameters)
    signs = np.array([seen[i].get("determinant", 0) for i in known.tolist()])
    flagged = parity.mismatch(mu, signs) | np.array([seen[i].get("contradicts", False) for i in known.tolist()])
    flagged |= _unresolved(problem, X[known], {**parameters, name: float(values[known[0]])}, _UNRESOLVED)
    near = may_reach(mu, _SENSITIVE * rough) | flagged
    if not near.any():
        return
    some, mu, flagged = known[near], mu[near], flagged[near]

    def differences(rows: np.ndarray) -> Difference:
        plain = _plain_multipliers(problem, X[some[rows]], name, values[some[rows]], parameters)
        return difference_of(mu[rows], plain)

    regime = np.array([seen[i]["regime"] for i in some.tolist()])
    errors, wide = _errors_of(mu, rough[near], regime, differences)
    distance = np.abs(_modulus(mu) - 1.0)
    doubtful = flagged | (distance <= errors)
    short = (distance <= wide) & _unresolved(problem, X[some], {**parameters, name: float(values[some[0]])}, _SHORT)
    for i, one, error in zip(some.tolist(), mu, errors.tolist(), strict=True):
        seen[i]["multipliers"], seen[i]["modulus_error"] = one, error
    for k in np.flatnonzero(doubtful | short).tolist():
        i = int(some[k])
        here = {**parameters, name: float(values[i])}
        verdict = _Verdict(mu[k], float(errors[k]), not flagged[k])
        expected = parity.expected(int(seen[i].get("determinant", 0)))
        enough = not is_under_resolved(problem, X[i], seen[i]["error"])
        verdict = _refined(problem, X[i], name, here, verdict, expected, bool(doubtful[k]) and enough, work)
        seen[i]["multipliers"], seen[i]["modulus_error"] = verdict.multipliers, verdict.stated_error


class _Verdict(NamedTuple):
    """Multipliers (r,) of a motion, the error of their largest modulus, and whether they pass all checks."""

    multipliers: ComplexArray
    error: float
    consistent: bool

    @property
    def sure(self) -> bool:
        """Whether the point is decided."""
        return self.consistent and abs(float(_modulus(self.multipliers)) - 1.0) > self.error

    @property
    def stated_error(self) -> float:
        """The error, which reaches the unit circle if a check failed."""
        if self.consistent:
            return self.error
        return max(self.error, 1.01 * abs(float(_modulus(self.multipliers)) - 1.0), 2.0 * STABILITY_TOLERANCE)


def _errors_of(
    mu: ComplexArray, rough: Array, regime: np.ndarray, differences: Callable[[np.ndarray], Difference]
) -> tuple[Array, Array]:
    """Errors (k,) of the largest moduli of multipliers mu (k, r) of motions with relative errors rough (k,).

    regime (k, m) : of each element. differences : computes the `Difference` of some rows from a second set.

    Returns
    -------
    The errors, and those of differences `_BETWEEN` times as large.
    """
    rough = np.maximum(rough, np.finfo(float).eps)  # a motion without contact has no error
    largest = np.take_along_axis(mu, np.abs(mu).argmax(axis=1)[:, None], axis=1)
    moved = np.abs(np.diff(largest[:, 0].real + 1j * np.abs(largest[:, 0].imag)))
    ends = (moved > _ANOTHER) | np.any(regime[1:] != regime[:-1], axis=1)
    stretches = np.split(np.arange(len(mu)), 1 + np.flatnonzero(ends))
    samples = [_samples(rows) for rows in stretches]
    first = np.concatenate(samples)
    found = np.array(differences(first))
    sensitive = np.zeros((len(found), len(mu)))
    sensitive[:, first] = found / rough[first]
    around = np.concatenate(
        [_around(rows, some, sensitive[:, some]) for rows, some in zip(stretches, samples, strict=True)], axis=1
    )
    estimated = rough * around
    doubtful = ~(np.abs(_modulus(mu) - 1.0) > estimate_multiplier_error(mu, Difference(*(_BETWEEN * estimated))))
    estimated[:, first], doubtful[first] = found, False
    more = np.flatnonzero(doubtful)
    if more.size:
        estimated[:, more] = np.array(differences(more))
    wide = Difference(*(_BETWEEN * estimated))
    return estimate_multiplier_error(mu, Difference(*estimated)), estimate_multiplier_error(mu, wide)


def _samples(rows: np.ndarray) -> np.ndarray:
    """The first and the last of some rows, and of those between them one in eight or more."""
    picked: np.ndarray = rows[np.linspace(0, len(rows) - 1, -(-(len(rows) - 1) // _APART) + 1).astype(int)]
    return picked


def _around(rows: np.ndarray, samples: np.ndarray, sensitive: Array) -> Array:
    """The largest sensitivities (..., k) of the two samples on either side of each row."""
    padded = np.concatenate([sensitive[..., :1], sensitive, sensitive[..., -1:], sensitive[..., -1:]], axis=-1)
    largest = np.max([padded[..., i : i + len(samples)] for i in range(4)], axis=0)
    around: Array = largest[..., np.searchsorted(samples, rows, side="right") - 1]
    return around


def _refined(
    problem: Any,
    X: Array,
    name: str,
    here: Mapping[str, float],
    verdict: _Verdict,
    expected: int,
    more: bool,
    work: Work,
) -> _Verdict:
    """The verdict of a refined motion; more : whether more harmonics may be tried.

    Exact motions come first if all laws are piecewise linear with constant stiffness. Where a stiffness varies over the
    period they take a hundred times as long: they come last there, and only of small structures. Other laws have none.
    """
    constant = _is_constant(problem, here)
    if constant:
        exact = _exact(problem, X, name, here, verdict, expected)
        if exact is not None:
            return exact
    if more:  # little is gained by many harmonics where Newton in the contact instants fails
        verdict = _with_more(problem, X, name, here, verdict, expected, 1 if constant else _TIMES, work)
    if constant or verdict.sure or problem.compiled(dict(here)).structure.n > _SMALL:
        return verdict
    return _exact(problem, X, name, here, verdict, expected) or verdict


_SMALL = 2  # coordinates of a structure up to which exact motions with varying stiffness are computed


def _is_constant(problem: Any, here: Mapping[str, float]) -> bool:
    """Whether all laws are piecewise linear and the stiffness of none varies over the period."""
    springs = [law.piecewise for law in problem.compiled(dict(here)).laws]
    return not any(each is None or any(one.stiffness.varies for one in each) for each in springs)


def _unresolved(problem: Any, X: Array, here: dict[str, float], periods: float) -> NDArray[np.bool_]:
    """Whether motions X (k, n) have contacts or flights shorter than so many periods of the highest harmonic.

    Only of models with piecewise-linear laws of constant stiffness, whose motions are refined exactly at little cost.
    """
    compiled = problem.compiled(here)
    if compiled.asked or not len(compiled.corner) or not _is_constant(problem, here):
        return np.zeros(len(X), dtype=bool)
    short: NDArray[np.bool_] = compiled.shortest_intervals(X) < periods * 2 * np.pi / problem.H
    return short


def _exact(
    problem: Any, X: Array, name: str, here: Mapping[str, float], verdict: _Verdict, expected: int
) -> _Verdict | None:
    """The verdict of the exact motion next to a motion X (n,); None if it is not known.

    Where there is no exact motion at this Omega that nearest by counts, if it lies on the same side of a fold.
    """
    try:
        try:
            exact = refine_motion(problem, X, here)
        except NoConvergence:
            if name != "Omega":
                return None
            exact = refine_near_fold(problem, X, here)
    except (NotPiecewiseLinear, NoConvergence, np.linalg.LinAlgError):
        return None
    if exact.distance > _SAME:
        return None
    mu = np.zeros(len(verdict.multipliers), dtype=complex)
    some = min(len(mu), len(exact.multipliers))
    mu[:some] = exact.multipliers[:some]
    other_side = bool(expected) and expected != 1 - 2 * (count_beyond(mu)[0] % 2)
    near_fold = exact.Omega != here["Omega"] or np.abs(mu - 1.0).min(initial=1.0) < _NEAR_FOLD
    return _Verdict(mu, _EXACT, not (other_side and near_fold))


_NEAR_FOLD = 0.3  # distance of a multiplier from +1 up to which a fold is near


_SAME = 0.02  # distance of the exact motion from that of the balance, relative to its size, up to which it is the same


_EXACT = 1e-7  # error of multipliers of exact motions


def _with_more(
    problem: Any,
    X: Array,
    name: str,
    here: Mapping[str, float],
    verdict: _Verdict,
    expected: int,
    times: int,
    work: Work,
) -> _Verdict:
    """The verdict of the motion, or of the nearest one, with enough harmonics for it to be sure.

    times : how often their number is doubled at most. expected : parity of the real multipliers beyond +1 at the row,
    +1 even and -1 odd; 0 if it is not known.
    """
    at = dict(here)
    for _ in range(times):
        finer = problem.refined_problem
        if finer is None or not work.allows(finer.size):
            break
        try:
            X, at[name] = nearest_solution(finer, finer.resized(X), name, at)
        except (NoConvergence, np.linalg.LinAlgError, ValueError):
            break
        X, at[name] = _held(finer, X, at[name], name, here)
        problem = finer
        verdict = _verdict_at(problem, X, name, at, expected if at[name] != here[name] else 0)
        if verdict.sure:
            break
    return verdict


def _verdict_at(problem: Any, X: Array, name: str, at: Mapping[str, float], expected: int) -> _Verdict:
    """Multipliers of one motion with their error, and whether both determinants agree with them.

    expected : parity of the real multipliers beyond +1 that the motion must have to lie on the right side of a fold.
    """
    mu, value = problem.multipliers(X, **at), np.array([at[name]])
    plain = _plain_multipliers(problem, X[None], name, value, at)
    error = float(estimate_multiplier_error(mu[None], difference_of(mu[None], plain))[0])
    parity = Parity.of(problem, name, value, at)
    return _Verdict(mu, error, parity.agrees(problem, X, at, mu, expected))


def _held(problem: Any, X: Array, value: float, name: str, here: Mapping[str, float]) -> tuple[Array, float]:
    """The motion at the row's own value of the parameter, if there is one next to a motion X at another value.

    Close to a fold, where there may be none, multipliers change so fast with the parameter that the small distance
    matters.
    """
    try:
        own = solve(problem, X, dict(here)).X
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        return X, value
    beside = norm(own - X) <= _BESIDE * problem.solution_norm(X)
    return (own, here[name]) if beside else (X, value)


_BESIDE = 0.05  # distance of two motions, relative to their size, that are one a little farther along the curve


def _plain_multipliers(
    problem: Any, X: Array, name: str, values: Array, parameters: Mapping[str, float]
) -> ComplexArray:
    """Multipliers (k, r) of motions X (k, n) at values (k,) of a parameter, without the harmonics that are driven."""
    if name == "Omega":
        return floquet_multipliers(problem.compiled(dict(parameters)), X, values)
    Omega = np.array([parameters["Omega"]])
    each = [problem.compiled({**parameters, name: value}) for value in values.tolist()]
    return np.array([floquet_multipliers(one, x[None], Omega)[0] for one, x in zip(each, X, strict=True)])


def _modulus(mu: ComplexArray) -> Any:
    """The largest of multipliers (..., r)."""
    return np.abs(mu).max(axis=-1, initial=0.0)
