"""Homotopies: a solution along a path of problems with a known solution at s = 0 that end at the problem at s = 1.

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.solvers.corrector import correct, corrected
from hbgear.continuation.solvers.newton import (
    SOLVER_ERRORS,
    NewtonSettings,
    NoConvergence,
    Solution,
    describe,
    solution_at,
    solve,
)


def solve_along(
    path: ContinuationProblem, problem: Any, X: Array, parameters: Mapping[str, float], steps: int = 300
) -> Solution:
    """Return the solution at the end s = 1 of a path, which is followed by arclength, through its folds.

    ``path`` has the solution X at s = 0, and the solutions of the problem at s = 1. NoConvergence is raised if it does
    not reach s = 1 within a number of steps.
    """
    size, h, equations = float(np.linalg.norm(X)), 0.05, CurveEquations(path, "s", {})
    start = solution_at(path, np.append(X, 0.0), "s", {})
    try:
        current = corrected(start, np.append(np.zeros(len(X)), 1.0))
    except np.linalg.LinAlgError:
        steps = 0  # the path has no direction
    for _ in range(steps):
        u, t = current.u, current.direction
        # at the zero solution: the size of the tangent
        size = max(size, float(np.linalg.norm(u[:-1]))) or float(np.linalg.norm(t[:-1]))
        scale = np.append(np.full(len(X), size or np.inf), 1.0)
        t = t / np.linalg.norm(t / scale)
        normal = t / scale**2 / np.linalg.norm(t / scale**2)
        try:
            # points of the path only lead to its end, so that a loose tolerance is enough
            point = correct(equations, u + h * t, normal, NewtonSettings(1e-6, 1e-2, 6))
        except SOLVER_ERRORS:
            h *= 0.5
            if h < MIN_STEP:
                break
            continue
        solution = point.solution
        if solution.value >= 1.0:
            fraction = (1.0 - u[-1]) / (solution.value - u[-1])
            return solve(problem, u[:-1] + fraction * (solution.X - u[:-1]), parameters)
        current, h = point, min(0.3, h * (1.6 if solution.iterations <= 3 else 1.0))
    raise NoConvergence(
        f"the homotopy found no path from the start to a solution at {describe(parameters)}", X, parameters, []
    )


MIN_STEP = 1e-8
"""Smallest step along a path, in scaled arclength."""
