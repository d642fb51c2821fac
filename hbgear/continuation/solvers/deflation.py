"""Deflated Newton's method: iterates are repelled by known solutions.

    M(X) R(X) = 0,   M = prod_i (1 + 1 / |X - X_i|^2),     step  dX / (1 - (grad log M)^T dX),  dX = -J^-1 R

References
----------
Farrell, Birkisson & Funke (2015), SIAM J. Sci. Comput. 37(4), A2026, https://doi.org/10.1137/140984798.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import solve_linear
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.newton import NewtonSettings


def same_solution(X: Array, Y: Array) -> bool:
    """Return whether two solutions differ by less than 1e-6 of their size."""
    return float(np.linalg.norm(X - Y)) < 1e-6 * (1e-3 + float(np.linalg.norm(Y)))


_TOLERANCE = NewtonSettings().tolerance
"""Relative residual of a solution."""

_MAX_DEFLATED_ITERATIONS = 60
"""Largest number of iterations: deflated residuals decrease slowly as long as a known solution is near."""


def deflated_newton(
    problem: ContinuationProblem, X: Array, parameters: dict[str, float], solutions: list[Array]
) -> Array | None:
    """Return a solution other than the known ones from a start X (n,); None if no new one is found."""
    scale = max([float(np.linalg.norm(Y)) for Y in solutions] + [1e-6])
    evaluation = problem.linearise(X, "", **parameters)
    for _ in range(_MAX_DEFLATED_ITERATIONS):
        if float(np.linalg.norm(evaluation.R)) <= _TOLERANCE * evaluation.size:
            return None if any(same_solution(X, Y) for Y in solutions) else X
        try:
            step = -solve_linear(evaluation.dR_dX, evaluation.R)
        except np.linalg.LinAlgError:
            return None
        offsets = [(X - Y) / scale for Y in solutions]
        pull = -sum(2 * float(a @ step) / scale / (float(a @ a) * (1 + float(a @ a)) + 1e-300) for a in offsets)
        # Newton step of M R: that of R, scaled by the derivative of log M along it; unscaled near the pole
        step = step / (1.0 - pull) if abs(1.0 - pull) > 1e-3 else step
        merit = _merit(evaluation.R, X, solutions, scale)
        for _ in range(10):
            trial = problem.linearise(X + step, "", **parameters)
            if np.isfinite(trial.size) and _merit(trial.R, X + step, solutions, scale) < merit:
                break
            step = 0.5 * step
        else:
            return None
        X, evaluation = X + step, trial
    return None


def _merit(R: Array, X: Array, solutions: list[Array], scale: float) -> float:
    """Return log |M R|, which each step has to reduce."""
    distance = [float(np.linalg.norm(X - Y)) / scale + 1e-300 for Y in solutions]
    return float(np.log(np.linalg.norm(R) + 1e-300) + sum(np.log1p(d**-2) for d in distance))
