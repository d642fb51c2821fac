"""Refinement of a branch: each point is solved again with more unknowns, at the nearest solution.

    [J R_p] S y = -R,  y of least norm,   R, J, R_p with more unknowns, S the sizes of solution and parameter

The parameter changes as well, because the point may be a fold. The difference of a result between both branches
estimates its error if errors decrease fast enough with the number of unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm, solve_linear
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem, observe_all
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, NoConvergence

MAX_REFINEMENT_ITERATIONS = 12
"""Maximum number of Newton iterations at a point."""

RESIDUAL_TOLERANCE = 1e-11
"""Largest relative residual of a refined point."""

MAX_STEEPNESS = 1e5
"""Change of the solution over that of the parameter, in units of their scales, above which dR/dX is too close to being
singular: rounding errors of the step would exceed 1e-10 of it."""


def nearest_solution(
    problem: ContinuationProblem, X: Array, name: str, parameters: Mapping[str, float]
) -> tuple[Array, float]:
    """Return the solution (X, p) nearest to a guess, by Newton's method with steps of least norm.

    ``parameters`` has the guess of the continuation parameter ``name``. NoConvergence is raised if the iteration fails.
    """
    values, scale = dict(parameters), np.full(len(X) + 1, problem.solution_norm(X) or 1.0)
    scale[-1] = problem.unit_of(name, parameters[name])
    for _ in range(MAX_REFINEMENT_ITERATIONS):
        evaluation = problem.linearise(X, name, **values)
        if norm(evaluation.R) <= RESIDUAL_TOLERANCE * evaluation.size:
            return X, values[name]
        step = shortest_step(evaluation, evaluation.R, scale)
        X, values[name] = X + step[:-1], values[name] + float(step[-1])
    raise NoConvergence(
        "the solution with more unknowns was not found", X, values, [norm(evaluation.R) / evaluation.size]
    )


def shortest_step(evaluation: Evaluation, R: Array, scale: Array) -> Array:
    """Return the step (n + 1,) of least norm, in units of ``scale``, with [dR/dX, dR/dp] step = -R; also at a fold."""
    A = np.column_stack([evaluation.dR_dX, evaluation.dR_dp]) * scale
    with suppress(np.linalg.LinAlgError):
        y, t = np.vstack([solve_linear(A[:, :-1], np.column_stack([-R, -A[:, -1]])), [0.0, 1.0]]).T
        if norm(t) < MAX_STEEPNESS:
            return scale * (y - (t @ y) / (t @ t) * t)
    factors, tau, _, _ = scipy.linalg.lapack.dgeqrf(A.T)  # A^T = Q T, y = Q T^-T (-R), at several times the cost
    y = np.zeros((len(scale), 1))
    y[:-1, 0] = scipy.linalg.lapack.dtrtrs(factors[:-1], -R, trans=1)[0]
    return scale * scipy.linalg.lapack.dormqr("L", "N", factors, tau, y, len(scale))[0][:, 0]


def refine_branch(branch: Branch) -> Branch:
    """Return a branch with twice the harmonics, nan where no solution was found; see `Branch.refined`.

    ValueError is raised if the branch does not have its problem, has the largest number of harmonics or consists of
    special points.
    """
    problem = branch.problem
    finer = None if problem is None else as_problem(problem).refined_problem
    if finer is None:
        reason = "has the largest number of harmonics already: trace it with fewer"
        if problem is None:
            reason = "does not have its problem: load it with load(path, problem=HarmonicBalance(...))"
        raise ValueError(f"a curve is refined with twice the harmonics, and this one {reason}")
    if branch.tracked:
        raise ValueError("a curve of special points is not refined: its points state their own errors")
    finer = as_problem(finer)
    solutions = [_solution(finer, branch, i) for i in range(len(branch))]
    X, values = np.array([X for X, _ in solutions]), np.array([value for _, value in solutions])
    solved, observed = np.isfinite(values), _blank(branch)
    u, stability = np.column_stack([X, values])[solved], branch.multipliers is not None
    quantities_of = observe_all(CurveEquations(finer, branch.parameter, branch.fixed), u, stability)
    for i, quantities in zip(np.flatnonzero(solved), quantities_of, strict=True):
        for name in observed.keys() & quantities.keys():
            observed[name][i] = quantities[name]
    return replace(
        branch, X=X, values=values, layout=finer.layout, problem=finer.original, others=(), full_motion=None, **observed
    )


def _solution(finer: ContinuationProblem, branch: Branch, i: int) -> tuple[Array, float]:
    """Return unknowns and parameter of point i at the higher resolution; nan if there is no solution."""
    guess = finer.resized(branch.X[i])
    try:
        return nearest_solution(finer, guess, branch.parameter, branch.parameters_at(i))
    except SEARCH_ERRORS:
        return np.full(len(guess), np.nan), np.nan


def _blank(branch: Branch) -> dict[str, Any]:
    """Return arrays for the monitored quantities of each point, filled with the values for unknown quantities."""
    names = ("regime", "error", "modulus_error", *(["multipliers"] if branch.multipliers is not None else []))
    out = {name: np.array(getattr(branch, name)) for name in names}
    for name, array in out.items():
        array[...] = -1 if name == "regime" else np.nan
    return out
