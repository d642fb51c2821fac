"""The first points of a branch that leaves another one at a special point.

    u(s) = u_0 + s t + O(s^2),   p(s) = p_0 + c s + a s^2 + ...

u_0 is the special point, t the direction in which the branch leaves. The special point is the first point of the
branch. The second lies so near that the first term of p(s) - p_0 that is not zero dominates,

    1/2 <= s p'(s) / (p(s) - p_0) <= 3        (1 if c is not zero, 2 if it is, as at a pitchfork)

so that the branch does not turn between both, and its first fold is behind them.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, normal_of, point_along
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.corrector import correct
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, solution_at
from hbgear.continuation.stepping.control import StepControl

_LEAST = 1e-4  # share of the first step below which a branch is not looked for nearer to the point


_STILL = 1e-10  # change of the parameter, scaled, over the step, that is rounding: the branch leaves vertically


def departed(
    problem: ContinuationProblem,
    name: str,
    parameters: Mapping[str, float],
    start: BranchStart,
    step: float,
    scale: Array,
    settings: NewtonSettings,
) -> CurvePoint:
    """The row a step (scaled) along the direction of a departure.

    Raises
    ------
    NoConvergence, numpy.linalg.LinAlgError
        If the corrector finds none.
    """
    direction = start.direction / np.linalg.norm(start.direction / scale)
    normal = normal_of(direction, scale)
    normal = normal / np.linalg.norm(normal)
    u = np.append(start.X, start.parameters[name]) + step * direction
    return point_along(correct(problem, u, normal, name, parameters, settings), scale, step)


def first_two(
    problem: ContinuationProblem, name: str, parameters: Mapping[str, float], start: BranchStart, steps: StepControl,
    scale: Array, settings: NewtonSettings,
) -> tuple[CurvePoint, CurvePoint]:  # fmt: skip
    """The special point at which a branch leaves another, as its first row, and the next row.

    Raises
    ------
    NoConvergence, numpy.linalg.LinAlgError
        If no point of the branch is found beside the special point.
    """
    step, found = steps.first_step, None
    while step >= _LEAST * steps.first_step:
        try:
            row = departed(problem, name, parameters, start, step, scale, settings)
        except (NoConvergence, np.linalg.LinAlgError):
            if found is None and step < 10 * _LEAST * steps.first_step:
                raise
        else:
            found = row
            if _leads(start.parameters[name], row, step, scale):
                break
        step *= 0.5
    assert found is not None  # else the corrector raised
    u = np.append(start.X, start.parameters[name])
    solution = solution_at(problem, u, name, parameters)
    direction = start.direction / np.linalg.norm(start.direction / scale)
    first = replace(found, u=u, tangent=direction, residual=solution.residual, iterations=0, step=0.0, observed={})
    return first, found


def _leads(value: float, row: CurvePoint, step: float, scale: Array) -> bool:
    """Whether the first term of the parameter's change dominates from the special point, at a value, to a row."""
    moved, slope = (row.value - value) / scale[-1], row.tangent[-1] / scale[-1]
    if abs(moved) <= _STILL * step:
        return True
    return bool(0.5 <= step * slope / moved <= 3.0)
