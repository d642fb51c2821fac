"""The rows of a curve with more unknowns, each at the solution nearest to it, and what that changes.

    [J R_p] S y = -R,  y of least norm,   R, J, R_p with more unknowns, S the sizes of solution and parameter

A curve may turn at a row, so the parameter moves as well. The difference of anything read from both is an estimate of
its error, as long as errors fall fast enough with the number of unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem, linearise, observe_all
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.solvers.newton import NoConvergence


def nearest_solution(
    problem: ContinuationProblem, X: Array, name: str, here: Mapping[str, float]
) -> tuple[Array, float]:
    """The solution (X, p) nearest to a guess: Newton with the shortest steps in X and p over their sizes.

    Raises
    ------
    NoConvergence
        If there is none.
    """
    at, scale = dict(here), np.full(len(X) + 1, problem.solution_norm(X) or 1.0)
    scale[-1] = problem.unit_of(name, here[name])
    for _ in range(12):
        now = linearise(problem, X, name, at)
        if norm(now.R) <= 1e-11 * now.size:
            return X, at[name]
        Q, R = scipy.linalg.qr((np.column_stack([now.dR_dX, now.dR_dp]) * scale).T, mode="economic")
        step = scale * (Q @ scipy.linalg.solve_triangular(R, -now.R, trans=1))
        X, at[name] = X + step[:-1], at[name] + float(step[-1])
    raise NoConvergence("the solution with more unknowns was not found", X, at, [norm(now.R) / now.size])


def refine_branch(branch: Branch) -> Branch:
    """See `Branch.refined`."""
    problem = branch.problem
    finer = None if problem is None else as_problem(problem).refined_problem
    if finer is None:
        why = "has lost its problem: load it with load(path, problem=HarmonicBalance(...))" if problem is None else (
            "has as many harmonics as are solved for: trace it with fewer")  # fmt: skip
        raise ValueError(f"a curve is refined with twice the harmonics, and this one {why}")
    if branch.tracked:
        raise ValueError("a curve of special points is not refined: its points state their own errors")
    finer = as_problem(finer)
    rows = [_row(finer, branch, i) for i in range(len(branch))]
    X, values = np.array([X for X, _ in rows]), np.array([value for _, value in rows])
    known, seen = np.isfinite(values), _blank(branch)
    for i, told in zip(np.flatnonzero(known), _observed(finer, branch, X[known], values[known]), strict=True):
        for name in seen.keys() & told.keys():
            seen[name][i] = told[name]
    return replace(
        branch, X=X, values=values, layout=finer.layout, problem=finer.original, others=(), full_motion=None, **seen
    )


def _row(finer: ContinuationProblem, branch: Branch, i: int) -> tuple[Array, float]:
    guess = finer.resized(branch.X[i])
    try:
        return nearest_solution(finer, guess, branch.parameter, branch.parameters_at(i))
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        return np.full(len(guess), np.nan), np.nan


def _blank(branch: Branch) -> dict[str, Any]:
    """What is stored of each row beside the solution, not yet known."""
    names = ("regime", "error", "modulus_error", *(["multipliers"] if branch.multipliers is not None else []))
    out = {name: np.array(getattr(branch, name)) for name in names}
    for name, array in out.items():
        array[...] = -1 if name == "regime" else np.nan
    return out


def _observed(finer: ContinuationProblem, branch: Branch, X: Array, values: Array) -> list[dict[str, Any]]:
    rows = np.column_stack([X, values])
    return observe_all(finer, rows, branch.parameter, dict(branch.fixed), branch.multipliers is not None)
