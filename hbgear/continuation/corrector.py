"""Newton on a pseudo-arclength plane, for one predicted point and for many by one rule.

    R(u) = 0,   normal^T (u - u_p) = 0        u = (X, value),   [dR_dX dR_dp; normal^T] du = -(R, normal^T (u - u_p))

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.algebra import Matrix, all_bordered, bordered, norms, solve_linear, solve_linear_all
from hbgear.continuation.newton import NoConvergence, Settings, Solution
from hbgear.continuation.problem import Evaluation, FullProblem, as_problem, linearise_all


class Corrected(NamedTuple):
    """A corrected point with the direction t of the curve there: A t = (0, ..., 0, 1), A = [dR_dX dR_dp; normal^T]."""

    solution: Solution
    direction: Array
    A: Matrix


_PATIENCE = 2  # Newton steps in which all points but the first must converge: where they do not, they are too far


_SHARP = 1e-2  # part of the tolerance above which a converged point gets one Newton step more


@dataclass
class _Iterate:
    """One point on its way: its last Newton step and first residual, and the best it came to.

    patience : Newton steps in which it must converge. sharp : share of the tolerance above which a converged point gets
    one Newton step more.
    """

    patience: int
    sharp: float
    last: float = math.inf
    first: float = math.inf
    best: Corrected | None = None
    failed: bool = False

    def judge(self, residual: float, iteration: int, step: float, settings: Settings) -> tuple[bool, bool]:
        """Whether the point where it is now is converged and the best so far, and whether to take the next step."""
        close = residual <= settings.tolerance and (self.last <= settings.step_tolerance or iteration == 0)
        self.first = residual if iteration == 0 else min(self.first, residual)
        self.last = step
        if self.best is not None:
            return residual < self.best.solution.residual, False
        if close:
            return True, residual > self.sharp * settings.tolerance and step <= settings.step_tolerance
        diverged = not math.isfinite(residual) or (iteration > 3 and residual > 10 * self.first)
        self.failed = diverged or iteration >= self.patience
        return False, not self.failed


def correct(
    problem: Any, u: Array, normal: Array, name: str, parameters: Mapping[str, float], settings: Settings = Settings()
) -> Solution:
    """The solution in the plane normal^T (u' - u) = 0 of a predicted point u = (X, value).

    Raises
    ------
    NoConvergence
        If Newton diverges, meets a singular bordered matrix or takes more than ``settings.max_iterations`` steps.
    """
    full = as_problem(problem)
    try:
        found, reason = correct_all(full, u[None], normal, name, parameters, settings, sharp=1.0)
    except np.linalg.LinAlgError:
        found, reason = [], "the corrector met a singular matrix"
    if not found:
        raise NoConvergence(reason, u[:-1], {**parameters, name: float(u[-1])}, [])
    return found[0].solution


def correct_all(
    problem: FullProblem, predicted: Array, normal: Array, name: str, parameters: Mapping[str, float],
    settings: Settings, sharp: float = _SHARP,
) -> tuple[list[Corrected], str]:  # fmt: skip
    """Newton for predicted points (k, n + 1) of one curve together, each in its plane across the same normal.

    A point whose residual is not far below the tolerance (``sharp``) gets one Newton step more, for predictions are
    often good enough to be accepted with few digits.

    Returns
    -------
    The points in order, up to the first that fails, and why it did.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a bordered matrix is singular.
    """
    most = settings.max_iterations
    points = [_Iterate(min(_PATIENCE, most) if i else most, sharp) for i in range(len(predicted))]
    u, left, reason = predicted, list(range(len(predicted))), ""
    for iteration in range(most + 2):
        now = linearise_all(problem, u, name, parameters)
        A, rhs = all_bordered(now.dR_dX, now.dR_dp, normal), np.zeros((*u.shape, 2))
        rhs[:, :-1, 0], rhs[:, -1, 0], rhs[:, -1, 1] = now.R, (u - predicted[left]) @ normal, 1.0
        both = solve_linear_all(A, rhs)
        onward = u - both[..., 0]
        residuals = (norms(now.R) / now.size).tolist()
        steps = (norms(both[..., 0]) / np.maximum(norms(onward), 1e-300)).tolist()
        onto = []
        for j, point in enumerate(points[i] for i in left):
            best, on = point.judge(residuals[j], iteration, steps[j], settings)
            if best:  # copied, or it would hold on to the arrays of all
                here = Evaluation(now.R[j].copy(), now.dR_dX[j].copy(), now.dR_dp[j].copy(), float(now.size[j]))
                solution = Solution(u[j, :-1].copy(), float(u[j, -1]), here, iteration, residuals[j])
                point.best = Corrected(solution, both[j, :, 1].copy(), A[j].copy())
            if on:
                onto.append(j)
            if point.failed:
                reason = f"the corrector stopped at a relative residual of {residuals[j]:.2e} after {iteration} steps"
                break
        if not onto:
            break
        u, left = onward[onto], [left[j] for j in onto]
    return [point.best for point in takewhile(lambda p: p.best is not None, points)], reason  # type: ignore[misc]


def corrected(solution: Solution, normal: Array) -> Corrected:
    """A solution with its direction.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the bordered matrix is singular: a branch point, or a normal that is no direction of the curve.
    """
    A = bordered(solution.evaluation.dR_dX, solution.evaluation.dR_dp, normal)
    rhs = np.zeros(len(normal))
    rhs[-1] = 1.0
    return Corrected(solution, solve_linear(A, rhs), A)
