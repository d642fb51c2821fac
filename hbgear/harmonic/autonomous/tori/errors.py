"""Errors of tori: a Newton step with twice the harmonics of both phases, and of the excitation.

    delta X = -J_fine^-1 R_fine(X)

Truncated harmonics change the forces and so act back on the kept ones. The outermost coefficients do not contain this
effect, and are zero for many laws with symmetries. They are the estimate where twice the harmonics are too many.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm
from hbgear.harmonic.balance.resolution import (
    CHECK_INTERVAL,
    MAX_CHECKED_UNKNOWNS,
    change_to_solution,
    every,
    relative_changes,
)


def check_errors(
    problem: Any, X: Array, name: str, values: Array, observed: Sequence[dict[str, Any]],
    parameters: Mapping[str, float],
) -> None:  # fmt: skip
    """Replace ``"error"``, the size of the outermost coefficients, by the Newton step with twice the harmonics.

    Some of successive tori X (P, n + 1) at values (P,) of a parameter are checked. Between them the ratio of both is
    interpolated.
    """
    if not len(X) or 4 * problem.balance.m * problem.basis.width > 2 * MAX_CHECKED_UNKNOWNS:
        return
    finer, subset = finer_problem(problem), every(CHECK_INTERVAL, np.arange(len(X)))
    sizes = np.array([max(entry["error"], 1e-300) for entry in observed])
    errors = []
    for i in subset:
        error, of_unknowns = resolution_error(problem, finer, X[i], {**parameters, name: float(values[i])})
        errors.append(error)
        if problem.free_phase:
            observed[i]["unknown_errors"] = of_unknowns
    ratios = np.array(errors) / sizes[subset]
    known = np.isfinite(ratios)
    if known.any():
        for i, entry in enumerate(observed):
            entry["error"] = float(sizes[i] * np.interp(i, subset[known], ratios[known]))


def finer_problem(problem: Any) -> Any:
    """Return the problem with twice the harmonics of both phases and of the excitation, without borders."""
    out = copy.copy(problem)
    out.basis = problem.basis.finer()
    out._phase = np.zeros(out.balance.m * out.basis.width)
    out.balance = problem.balance.with_order(problem.balance.nu, max(problem.balance.H, out.basis.H1))
    return out


def resolution_error(
    problem: Any, finer: Any, X: Array, parameters: Mapping[str, float]
) -> tuple[float, dict[str, float]]:  # fmt: skip
    """Return the rms distance of a torus X (n + 1,) from the one with more harmonics, and the error of Omega_2.

    The latter is relative. Errors that are unknown are nan.
    """
    rows = X[:-1].reshape(problem.balance.m, -1)
    start = np.append(finer.basis.convert(rows, problem.basis).ravel(), X[-1])
    weight = np.where(finer.basis.k.any(axis=1), np.sqrt(0.5), 1.0)
    weights = np.append(np.tile(np.concatenate([weight, weight[1:]]), len(rows)), 0.0)
    finer = finer.with_borders_at(start, parameters, renew=True)
    change = change_to_solution(finer, start, weights, parameters, "Omega")
    return norm(weights * change), relative_changes(finer, start, change)
