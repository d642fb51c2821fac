"""Newton's method on a pseudo-arclength plane.

    R(u) = 0,   normal^T (u - u_p) = 0        u = (X, value),   [dR_dX dR_dp; normal^T] du = -(R, normal^T (u - u_p))

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import bordered, norm, solve_signed
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import linearise
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, Solution


class CorrectedPoint(NamedTuple):
    """A solution with the direction of the curve.

    Attributes
    ----------
    solution : Solution
        The solution.
    direction : ndarray, shape (n + 1,)
        Direction t of the curve, A t = (0, ..., 0, 1) with A = [dR_dX dR_dp; normal^T].
    orientation : int
        Sign of det A.
    """

    solution: Solution
    direction: Array
    orientation: int

    @property
    def u(self) -> Array:
        """Unknowns and value of the parameter, shape (n + 1,)."""
        return np.append(self.solution.X, self.solution.value)


def correct(
    problem: Any, u: Array, normal: Array, name: str, parameters: Mapping[str, float],
    settings: NewtonSettings = NewtonSettings(), polish_above: float = 1.0,
) -> CorrectedPoint:  # fmt: skip
    """Return the solution in the plane normal^T (u' - u) = 0 of a predicted point.

    Parameters
    ----------
    problem : ContinuationProblem or object with ``evaluate``
        The problem.
    u : ndarray, shape (n + 1,)
        Predicted unknowns and value of the parameter.
    normal : ndarray, shape (n + 1,)
        Normal of the plane.
    name : str
        The parameter.
    parameters : mapping of str to float
        The other parameters.
    settings : NewtonSettings, optional
        Tolerances and number of iterations.
    polish_above : float, optional
        Fraction of the tolerance above which a converged point gets one more iteration, because predictions are often
        accepted with few correct digits. The default is 1: no further iteration.

    Returns
    -------
    CorrectedPoint
        The solution with its direction.

    Raises
    ------
    NoConvergence
        If the iteration diverges, the bordered matrix is singular, or ``settings.max_iterations`` is reached.
    """
    from hbgear.continuation.stepping.kernels import CONVERGED, DIVERGED, newton_status

    full_problem, predicted, residual = as_problem(problem), u, math.inf
    last = first = math.inf
    best: CorrectedPoint | None = None
    for iteration in range(settings.max_iterations + 2):
        evaluation = linearise(full_problem, u[:-1], name, {**parameters, name: float(u[-1])})
        rhs = np.zeros((len(u), 2))
        rhs[:-1, 0], rhs[-1, 0], rhs[-1, 1] = evaluation.R, (u - predicted) @ normal, 1.0
        try:
            columns, sign = solve_signed(bordered(evaluation.dR_dX, evaluation.dR_dp, normal), rhs)
        except np.linalg.LinAlgError:
            raise NoConvergence(
                "the matrix of the corrector is singular", u[:-1], {**parameters, name: float(u[-1])}, [residual]
            ) from None
        following, residual = u - columns[:, 0], norm(evaluation.R) / evaluation.size
        step = norm(columns[:, 0]) / max(norm(following), 1e-300)
        is_best, status = newton_status(
            residual, step, last, first, best.solution.residual if best else math.inf, iteration,
            settings.tolerance, settings.step_tolerance, settings.max_iterations, polish_above,
        )  # fmt: skip
        if is_best:
            best = CorrectedPoint(Solution(u[:-1], float(u[-1]), evaluation, iteration, residual), columns[:, 1], sign)
        if status in (CONVERGED, DIVERGED):
            break
        u, first, last = following, min(first, residual), step
    if best is None:
        message = f"the corrector stopped at a relative residual of {residual:.2e} after {iteration} steps"
        raise NoConvergence(message, u[:-1], {**parameters, name: float(u[-1])}, [residual])
    return best


def corrected(solution: Solution, normal: Array) -> CorrectedPoint:
    """Return a solution with its direction.

    Parameters
    ----------
    solution : Solution
        The solution.
    normal : ndarray, shape (n + 1,)
        A vector that is not orthogonal to the curve.

    Returns
    -------
    CorrectedPoint
        The same solution, its direction and orientation.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the bordered matrix is singular: at a branch point, or with a normal orthogonal to the curve.
    """
    rhs = np.zeros((len(normal), 1))
    rhs[-1] = 1.0
    t, sign = solve_signed(bordered(solution.evaluation.dR_dX, solution.evaluation.dR_dp, normal), rhs)
    return CorrectedPoint(solution, t[:, 0], sign)
