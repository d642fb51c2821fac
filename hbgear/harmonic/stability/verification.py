"""Verified stability: multipliers with an error, checked against signs of determinants, refined where undecided.

    modulus_error    estimated difference of the largest modulus from that of the true motion
    undecided        |max |mu| - 1| <= modulus_error

For every point of a curve:

1. **Error estimate.** The multipliers are computed with the harmonics H < k <= 2H that the forces of the motion and the
   excitation drive. A second set is computed without those driven by forces, of a motion with one more Newton step in
   which they act back on the others (`second_set`). The error is estimated from the difference of the two sets
   of complex numbers (`multiplier_error`), also where a complex pair may become two real multipliers. This is done only
   where it can matter: where the relative error of the motion, times ten thousand, is large enough for a multiplier to
   reach the unit circle. To save work the second set is computed for every eighth of these points only. Between them
   the difference is taken to be proportional to the error of the motion. Points whose multipliers come within ten times
   this difference of the circle get a second set of their own, whose difference counts as at least 0.3 of that of
   the points next to it: it changes its sign along the curve.
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
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.events.accuracy import is_under_resolved
from hbgear.continuation.numerics.linear import norms
from hbgear.continuation.problem.base import Observed
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.problem.work import Work
from hbgear.harmonic.equations.motion import shortest_intervals
from hbgear.harmonic.multipliers.multiplier_error import (
    SHARE,
    Difference,
    difference_of,
    estimate_multiplier_error,
    min_deciding_residual,
)
from hbgear.harmonic.stability.parity import Parity
from hbgear.harmonic.stability.second_set import second_set
from hbgear.harmonic.stability.undecided import Stability, UndecidedPoint, has_constant_stiffness, largest_modulus
from hbgear.harmonic.structure.linear_structure import dense

MAX_SENSITIVITY = 1e4
"""Largest difference of multipliers over the relative error of the motion."""


SAMPLING_INTERVAL = 8
"""Points per second set of multipliers, among the points whose multipliers may reach the unit circle."""


MAX_LEADING_CHANGE = 0.1
"""Change of the leading multiplier from point to point above which it may be another multiplier."""


SENSITIVITY_MARGIN = 10.0
"""Factor by which a point may be more sensitive than the sampled points next to it."""


SHORT_INTERVAL = 2.0
"""Contact or flight, in periods of the highest harmonic, up to which multipliers may be inaccurate."""


UNRESOLVED_INTERVAL = 0.5
"""Contact or flight, in periods of the highest harmonic, up to which multipliers of the balance are not used."""


def verify_multipliers(problem: Any, solutions: CurveSolutions, observed: Observed, work: Work | None = None) -> None:
    """Verify the multipliers of points in place; see `HarmonicBalance.verify_stability`."""
    work = work or Work(math.inf)
    for record in observed:
        record["modulus_error"] = math.nan
    multipliers = np.array([record["multipliers"] for record in observed])
    computed = np.flatnonzero(~np.isnan(multipliers).any(axis=1))
    if not computed.size:
        return
    multipliers, relative_errors = multipliers[computed], np.array([observed[i]["error"] for i in computed.tolist()])
    motions = solutions.select(computed)
    relative_errors /= np.maximum(norms(motions.X.reshape(len(computed), problem.m, -1)[:, :, 1:]), 1e-300)
    parity = Parity.of(problem, motions)
    signs = np.array([observed[i].get("determinant", 0) for i in computed.tolist()])
    flagged = parity.mismatch(multipliers, signs) | np.array(
        [observed[i].get("contradicts", False) for i in computed.tolist()]
    )
    regime = np.array([observed[i]["regime"] for i in computed.tolist()])
    intervals = _shortest_intervals(problem, motions, regime)
    flagged |= _is_hard(problem, intervals, motions, multipliers)
    reachable = (MAX_SENSITIVITY * relative_errors >= min_deciding_residual(multipliers)) | flagged
    if not reachable.any():
        return
    selected, multipliers, flagged = computed[reachable], multipliers[reachable], flagged[reachable]

    def differences(rows: np.ndarray) -> Difference:
        """Return the difference of the multipliers of some points from a second set."""
        less_accurate = second_set(problem, solutions.select(selected[rows]))
        return difference_of(multipliers[rows], less_accurate)

    errors, wide_errors = _estimate_errors(multipliers, relative_errors[reachable], regime[reachable], differences)
    distance = np.abs(largest_modulus(multipliers) - 1.0)
    uncertain = flagged | (distance <= errors)
    short = (distance <= wide_errors) & (intervals[reachable] < SHORT_INTERVAL)
    for i, record, error in zip(selected.tolist(), multipliers, errors.tolist(), strict=True):
        observed[i]["multipliers"], observed[i]["modulus_error"] = record, error
    for k in np.flatnonzero(uncertain | short).tolist():
        i = int(selected[k])
        X, stability = solutions.X[i], Stability(multipliers[k], float(errors[k]), not flagged[k])
        expected = parity.constant * int(observed[i].get("determinant", 0))
        resolved = not is_under_resolved(problem, X, observed[i]["error"])
        point = UndecidedPoint(solutions.name, solutions.parameters_at(i), stability, expected, work)
        stability = point.refined(problem, X, bool(uncertain[k]) and resolved)
        observed[i]["multipliers"], observed[i]["modulus_error"] = stability.multipliers, stability.stated_error


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
    sensitivity[:, computed] = values.max(axis=2, initial=0.0) / relative_errors[computed]
    nearby = np.concatenate(
        [
            _nearby_sensitivity(section, chosen, sensitivity[:, chosen])
            for section, chosen in zip(sections, sampled, strict=True)
        ],
        axis=1,
    )
    estimated = np.repeat((relative_errors * nearby)[:, :, None], mu.shape[1], axis=2)
    uncertain = ~(
        np.abs(largest_modulus(mu) - 1.0) > estimate_multiplier_error(mu, Difference(*(SENSITIVITY_MARGIN * estimated)))
    )
    estimated[:, computed], uncertain[computed] = values, False
    remaining = np.flatnonzero(uncertain)
    if remaining.size:
        estimated[:, remaining] = np.array(differences(remaining))
    estimated = _with_neighbours(estimated, relative_errors, regime)
    stacked = Difference(*np.hstack([estimated, SENSITIVITY_MARGIN * estimated]))
    errors, wide_errors = np.split(estimate_multiplier_error(np.vstack([mu, mu]), stacked), 2)
    return errors, wide_errors


def _with_neighbours(estimated: Array, relative_errors: Array, regime: np.ndarray) -> Array:
    """Return differences (3, k, r), at least `SHARE` of those that points of the same regime before and after suggest.

    Differences change their sign along a curve, so those of one point may vanish by chance.
    """
    sensitivity = estimated.max(axis=2, initial=0.0) / relative_errors
    same, least = np.all(regime[1:] == regime[:-1], axis=1), np.zeros_like(sensitivity)
    least[:, :-1] = same * sensitivity[:, 1:]
    least[:, 1:] = np.maximum(least[:, 1:], same * sensitivity[:, :-1])
    return np.maximum(estimated, (SHARE * relative_errors * least)[:, :, None])


def _samples(rows: np.ndarray) -> np.ndarray:
    """Return the first and the last of some points, and one in eight or more between them."""
    return rows[np.linspace(0, len(rows) - 1, -(-(len(rows) - 1) // SAMPLING_INTERVAL) + 1).astype(int)]


def _nearby_sensitivity(rows: np.ndarray, samples: np.ndarray, sensitive: Array) -> Array:
    """Return the largest sensitivities (..., k) of the two samples on either side of each point."""
    padded = np.concatenate([sensitive[..., :1], sensitive, sensitive[..., -1:], sensitive[..., -1:]], axis=-1)
    largest = np.max([padded[..., i : i + len(samples)] for i in range(4)], axis=0)
    return largest[..., np.searchsorted(samples, rows, side="right") - 1]


def _shortest_intervals(problem: Any, motions: CurveSolutions, regime: np.ndarray) -> Array:
    """Return the shortest contacts or flights (k,) of motions, in periods of the highest harmonic.

    regime (k, m) : number of breakpoints that each element passes. The result is inf if no element passes one, and
    unless all laws are piecewise linear with constant stiffness, because only such motions are refined exactly at
    little cost.
    """
    X, parameters = motions.X, motions.parameters_at(0)
    periods, compiled = np.full(len(X), np.inf), problem.compiled(parameters)
    is_sampled = compiled.aft_laws or compiled.damped
    if is_sampled or not len(compiled.breakpoints) or not has_constant_stiffness(problem, parameters):
        return periods
    in_contact = np.any(regime > 0, axis=1)
    if in_contact.any():
        periods[in_contact] = shortest_intervals(compiled, X[in_contact]) * problem.H / (2 * np.pi)
    return periods


def _is_hard(problem: Any, intervals: Array, motions: CurveSolutions, multipliers: ComplexArray) -> NDArray[np.bool_]:
    """Return whether the shortest contacts or flights (k,) are unresolved and can change the stability.

    A contact of stiffness k and duration delta changes multipliers by about (k / m) delta / Omega^2. A soft one at a
    grazing needs no refinement if the multipliers are far from the unit circle.
    """
    short: NDArray[np.bool_] = intervals < UNRESOLVED_INTERVAL
    if short.any():
        compiled = problem.compiled(motions.parameters_at(0))
        system, Omega = compiled.system, motions.values if motions.name == "Omega" else motions.fixed["Omega"]
        if system.massless:
            return short
        mobility = np.einsum("ij,ij->j", system.W, np.linalg.solve(dense(system.M), system.W))
        rate = max(abs(k * law.reference) for k, law in zip(mobility.tolist(), compiled.laws, strict=True))
        effect = rate * problem.nu * intervals * (2 * np.pi / problem.H) / np.square(Omega)
        short &= effect > np.abs(largest_modulus(multipliers) - 1.0)
    return short
