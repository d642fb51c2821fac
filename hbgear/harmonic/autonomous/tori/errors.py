"""Errors of tori: a Newton step with twice the harmonics of both phases, and of the excitation.

    delta X = -J_fine^-1 R_fine(X)

Truncated harmonics change the forces and so act back on the kept ones. The outermost coefficients do not contain this
effect, and are zero for many laws with symmetries. They are the estimate where twice the harmonics are too many.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import Observed
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.solvers.newton import SOLVER_ERRORS
from hbgear.harmonic.autonomous.prescribed_amplitude import PrescribedAmplitude
from hbgear.harmonic.balance.resolution import (
    CHECK_INTERVAL,
    MAX_CHECKED_UNKNOWNS,
    change_to_solution,
    every,
    relative_changes,
)

SMALLEST_MODULATION = 1e-7
"""Modulation over the whole motion below which it is rounding of a periodic motion."""

_END_MODULATION = 3e-3
"""Smaller one of two modulations, relative to the motion, from which the end of a branch is extrapolated."""


def check_errors(problem: Any, solutions: CurveSolutions, observed: Observed) -> None:
    """Replace ``"error"``, the size of the outermost coefficients, by the Newton step with twice the harmonics.

    Some of successive tori X (P, n + 1) at values (P,) of a parameter are checked. Between them the ratio of both is
    interpolated. The second frequency has no error where the modulation vanishes, because any frequency fits there.
    """
    X = solutions.X
    if not len(X) or _is_large(problem):
        return
    finer, subset = finer_problem(problem), every(CHECK_INTERVAL, np.arange(len(X)))
    sizes = np.array([max(entry["error"], 1e-300) for entry in observed])
    errors = []
    for i in subset:
        error, of_unknowns = resolution_error(problem, finer, X[i], solutions.parameters_at(i))
        errors.append(error)
        if problem.free_phase and not is_periodic(problem, X[i]):
            observed[i]["unknown_errors"] = of_unknowns
    ratios = np.array(errors) / sizes[subset]
    known = np.isfinite(ratios)
    if known.any():
        for i, entry in enumerate(observed):
            entry["error"] = float(sizes[i] * np.interp(i, subset[known], ratios[known]))


def _is_large(problem: Any) -> bool:
    """Return whether twice the harmonics are too many for a check."""
    return bool(4 * problem.balance.m * problem.basis.width > 2 * MAX_CHECKED_UNKNOWNS)


def is_periodic(problem: Any, X: Array) -> bool:
    """Return whether the modulation of a torus X (n + 1,) is rounding of a periodic motion."""
    return norm(problem.modulation(X[:-1])) <= SMALLEST_MODULATION * norm(X)


def finer_problem(problem: Any) -> Any:
    """Return the problem with twice the harmonics of both phases and of the excitation, without borders."""
    out = copy.copy(problem)
    out.basis = problem.basis.finer()
    out._phase = np.zeros(out.balance.m * out.basis.width)
    out.balance = problem.balance.with_order(problem.balance.nu, max(problem.balance.H, out.basis.H1))
    return out


def resolution_error(
    problem: Any, finer: Any, X: Array, parameters: Mapping[str, float]
) -> tuple[float, dict[str, float]]:
    """Return the rms distance of a torus X (n + 1,) from the one with more harmonics, and the error of Omega_2.

    The latter is relative. Errors that are unknown are nan.
    """
    start = _converted(problem, finer, X)
    weight = np.where(finer.basis.k.any(axis=1), np.sqrt(0.5), 1.0)
    weights = np.append(np.tile(np.concatenate([weight, weight[1:]]), problem.balance.m), 0.0)
    finer = finer.with_borders_at(start, parameters, renew=True)
    change = change_to_solution(finer, start, weights, parameters, "Omega")
    return norm(weights * change), relative_changes(finer, start, change)


def end_error(problem: Any, X: Array, shape: Array, name: str, value: float, parameters: Mapping[str, float]) -> float:
    """Return the error of the parameter value at which the modulation vanishes; nan if it is unknown.

    At this end X (n + 1,) the equations are singular: any value fits a modulation of the size of rounding. With twice
    the harmonics and small modulations of a shape (n,) the value is p + c eps^2, from which p is extrapolated.
    """
    if _is_large(problem):
        return math.nan
    finer = finer_problem(problem)
    start, shape = _converted(problem, finer, X), _converted(problem, finer, np.append(shape, 0.0))[:-1]
    shape, fixed = shape / norm(shape), {key: x for key, x in parameters.items() if key != name}
    values = []
    for modulation in (_END_MODULATION, 2 * _END_MODULATION):
        size = modulation * norm(start[:-1])
        guess = start + np.append(size * shape, 0.0)
        bordered = finer.with_borders_at(guess, {**fixed, name: value}, renew=True)
        try:
            solution = PrescribedAmplitude(bordered, name, shape, size).located(np.append(guess, value), fixed)
        except SOLVER_ERRORS:
            return math.nan
        values.append(float(solution.X[-1]))
    return abs((4 * values[0] - values[1]) / 3 - value)


def _converted(problem: Any, finer: Any, X: Array) -> Array:
    """Return a torus X (n + 1,) of a problem with the harmonics of a finer one."""
    rows = X[:-1].reshape(problem.balance.m, -1)
    return np.append(finer.basis.convert(rows, problem.basis).ravel(), X[-1])
