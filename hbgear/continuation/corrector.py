"""Newton on a pseudo-arclength plane: R(u) = 0, normal^T (u - u_p) = 0, for one predicted point and for many.

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.algebra import all_bordered, bordered, norm, norms, solve_linear
from hbgear.continuation.newton import NoConvergence, Settings, Solution
from hbgear.continuation.problem import Evaluation, linearise, linearise_all


def correct(
    problem: Any,
    u: Array,
    normal: Array,
    name: str,
    parameters: Mapping[str, float],
    settings: Settings = Settings(),
) -> Solution:
    """Newton from the predicted point u = (X, value) in the plane normal^T (u' - u) = 0.

    Raises
    ------
    NoConvergence
        If Newton diverges, meets a singular bordered matrix or takes more than ``settings.max_iterations`` steps.
    """
    start, rhs = u, np.empty_like(u)
    residuals: list[float] = []
    step = np.inf
    for iteration in range(settings.max_iterations + 1):
        here = {**parameters, name: float(u[-1])}
        now = linearise(problem, u[:-1], name, here)
        residuals.append(norm(now.R) / now.size)
        if residuals[-1] <= settings.tolerance and (step <= settings.step_tolerance or iteration == 0):
            return Solution(u[:-1], float(u[-1]), now, iteration, residuals[-1])
        if not math.isfinite(residuals[-1]) or (iteration > 3 and residuals[-1] > 10 * residuals[0]):
            break
        rhs[:-1], rhs[-1] = now.R, normal @ (u - start)
        try:
            du = solve_linear(bordered(now, normal), rhs)
        except np.linalg.LinAlgError:
            break
        u = u - du
        step = norm(du) / (norm(u) or 1.0)
    raise NoConvergence(
        f"the corrector stopped at a relative residual of {residuals[-1]:.2e} after {len(residuals) - 1} steps",
        u[:-1], {**parameters, name: float(u[-1])}, residuals,
    )  # fmt: skip


class Corrected(NamedTuple):
    """A corrected point with the direction t of the curve there: A t = (0, ..., 0, 1), A = [dR_dX dR_dp; normal^T]."""

    solution: Solution
    direction: Array
    A: Array


_PATIENCE = 2  # Newton steps in which all points but the first must converge: where they do not, they are too far


_SHARP = 1e-2  # part of the tolerance above which a converged point gets one Newton step more


@dataclass
class _Iterate:
    """One point of `correct_all` on its way: its last Newton step and first residual, and the best it came to."""

    patience: int
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
            return True, residual > _SHARP * settings.tolerance and step <= settings.step_tolerance
        diverged = not math.isfinite(residual) or (iteration > 3 and residual > 10 * self.first)
        self.failed = diverged or iteration >= self.patience
        return False, not self.failed


def correct_all(
    problem: Any, predicted: Array, normal: Array, name: str, parameters: Mapping[str, float], settings: Settings
) -> tuple[list[Corrected], str]:
    """`correct` for predicted points (k, n + 1) of one curve together, each in its plane across the same normal.

    A point whose residual is not a hundred times below the tolerance gets one Newton step more, for predictions are
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
    points = [_Iterate(min(_PATIENCE, most) if i else most) for i in range(len(predicted))]
    u, left, reason = predicted, list(range(len(predicted))), ""
    for iteration in range(most + 2):
        now = linearise_all(problem, u, name, parameters)
        A, rhs = all_bordered(now, normal), np.zeros((*u.shape, 2))
        rhs[:, :-1, 0], rhs[:, -1, 0], rhs[:, -1, 1] = now.R, (u - predicted[left]) @ normal, 1.0
        both = np.linalg.solve(A, rhs)
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
    A = bordered(solution.evaluation, normal)
    rhs = np.zeros(len(A))
    rhs[-1] = 1.0
    return Corrected(solution, solve_linear(A, rhs), A)
