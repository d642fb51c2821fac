"""Newton's method on a pseudo-arclength plane.

    R(u) = 0,   normal^T (u - u_p) = 0        u = (X, value),   [dR_dX dR_dp; normal^T] du = -(R, normal^T (u - u_p))

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import bordered, norm, solve_signed
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, Solution


class CorrectedPoint(NamedTuple):
    """A solution with the direction of the curve.

    The direction t (n + 1,) solves A t = (0, ..., 0, 1) with A = [dR_dX dR_dp; normal^T]; ``orientation`` is the sign
    of det A.
    """

    solution: Solution
    direction: Array
    orientation: int

    @property
    def u(self) -> Array:
        """Unknowns and value of the parameter, shape (n + 1,)."""
        return np.append(self.solution.X, self.solution.value)


def correct(
    equations: CurveEquations,
    u: Array,
    normal: Array,
    settings: NewtonSettings = NewtonSettings(),
    polish_above: float = 1.0,
) -> CorrectedPoint:
    """Return the solution in the plane normal^T (u' - u) = 0 of a predicted point u = (X, value).

    ``polish_above`` is the fraction of the tolerance above which a converged point gets one more iteration, because
    predictions are often accepted with few correct digits; by default no point does. NoConvergence is raised if the
    iteration diverges, the bordered matrix is singular, or ``settings.max_iterations`` is reached.
    """
    from hbgear.continuation.stepping.kernels import CONVERGED, DIVERGED, newton_status

    predicted, residual = u, math.inf
    last = first = math.inf
    best: CorrectedPoint | None = None
    limits = newton_limits(settings, polish_above)
    for iteration in range(settings.max_iterations + 2):
        evaluation = equations.linearise(u)
        rhs = np.zeros((len(u), 2))
        rhs[:-1, 0], rhs[-1, 0], rhs[-1, 1] = evaluation.R, (u - predicted) @ normal, 1.0
        try:
            columns, sign = solve_signed(bordered(evaluation.dR_dX, evaluation.dR_dp, normal), rhs)
        except np.linalg.LinAlgError:
            raise NoConvergence(
                "the matrix of the corrector is singular", u[:-1], equations.parameters_at(float(u[-1])), [residual]
            ) from None
        following, residual = u - columns[:, 0], norm(evaluation.R) / evaluation.size
        step = norm(columns[:, 0]) / max(norm(following), 1e-300)
        best_residual = best.solution.residual if best else math.inf
        is_best, status = newton_status(residual, step, last, first, best_residual, iteration, limits)
        if is_best:
            best = CorrectedPoint(Solution(u[:-1], float(u[-1]), evaluation, iteration, residual), columns[:, 1], sign)
        if status in (CONVERGED, DIVERGED):
            break
        u, first, last = following, min(first, residual), step
    if best is None:
        message = f"the corrector stopped at a relative residual of {residual:.2e} after {iteration} steps"
        raise NoConvergence(message, u[:-1], equations.parameters_at(float(u[-1])), [residual])
    return best


def newton_limits(settings: NewtonSettings, polish_above: float) -> Array:
    """Return the limits (4,) of `stepping.kernels.newton_status`."""
    return np.array([settings.tolerance, settings.step_tolerance, settings.max_iterations, polish_above])


def corrected(solution: Solution, normal: Array) -> CorrectedPoint:
    """Return a solution with its direction, from a normal (n + 1,) that is not orthogonal to the curve.

    LinAlgError is raised if the bordered matrix is singular: at a branch point, or with an orthogonal normal.
    """
    rhs = np.zeros((len(normal), 1))
    rhs[-1] = 1.0
    t, sign = solve_signed(bordered(solution.evaluation.dR_dX, solution.evaluation.dR_dp, normal), rhs)
    return CorrectedPoint(solution, t[:, 0], sign)
