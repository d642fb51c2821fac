"""Step over a corner of a curve, at which the tangent is discontinuous because dR/dX is.

    [dR_dX dR_dp] t = 0 at u + delta t_0      tangent t beyond the corner,   sign det [dR_dX dR_dp; t^T] as before

dR/dX jumps where a friction slider begins to slip, or where a sampled law has a breakpoint, and the derivatives of the
equations of a special point where a contact begins. The equations beyond the corner are those at a point a little
further along the old tangent t_0. Their null vector is the new tangent. Its orientation is that of the curve, also if
it turns by more than 90 degrees, so that the parameter turns back as at a fold.

References
----------
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154, for
piecewise smooth curves and their orientation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import bordered, norm, solve_signed
from hbgear.continuation.problem.base import linearise
from hbgear.continuation.solvers.corrector import CorrectedPoint, correct
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, solve
from hbgear.continuation.stepping.status import ACCEPTED

PROBE_DISTANCES = (1e2, 1e3, 1e4)
"""Distances along the old tangent at which the equations beyond the corner are evaluated, over the smallest step. The
last point lies within a few smallest steps before the corner."""

MAX_DIRECTIONS = 2
"""Largest number of directions of a step beyond a corner. Where the old tangent touches the boundary between the two
sides, the probe may lie on the wrong one; the second direction is the tangent at the point that the first one finds."""

STEP_OVER_PROBE = 10.0
"""Step beyond the corner over the distance of the probe, so that the distance to the corner is small in comparison."""


def step_over_corner(
    problem: Any, u: Array, tangent: Array, orientation: int, scale: Array, smallest: float, turn: float, name: str,
    fixed: Mapping[str, float], settings: NewtonSettings,
) -> tuple[CorrectedPoint, float] | None:  # fmt: skip
    """Return a point beyond a corner near the last point of a curve, with the size of the step.

    Parameters
    ----------
    problem : ContinuationProblem
        The problem.
    u, tangent : ndarray, shape (n + 1,)
        Last point and its tangent.
    orientation : int
        Sign of the determinant at the last point.
    scale : ndarray, shape (n + 1,)
        Scales of the unknowns and of the parameter.
    smallest : float
        Smallest step size, at which the usual step failed.
    turn : float
        Largest angle [deg] between the tangent beyond the corner and that of the new point.
    name : str
        Name of the continuation parameter.
    fixed : mapping of str to float
        Values of the other parameters.
    settings : NewtonSettings
        Settings of the corrector.

    Returns
    -------
    tuple or None
        The point with its oriented direction, and the step; None if there is no such point.
    """
    for distance in PROBE_DISTANCES:
        delta = distance * smallest
        try:
            found = _beyond(problem, u, tangent, orientation, scale, delta, turn, name, fixed, settings)
        except (ValueError, NoConvergence, np.linalg.LinAlgError):  # ValueError of a model
            continue
        if found is not None:
            return found, STEP_OVER_PROBE * delta
    return None


def _beyond(
    problem: Any, u: Array, tangent: Array, orientation: int, scale: Array, delta: float, turn: float, name: str,
    fixed: Mapping[str, float], settings: NewtonSettings,
) -> CorrectedPoint | None:  # fmt: skip
    """Return the point beyond the corner with one distance of the probe; None if it is not on that side."""
    from hbgear.continuation.stepping.kernels import accept_step, arclength_normal

    probe, normal = u + delta * tangent / norm(tangent / scale), np.empty(len(u))
    arclength_normal(tangent, scale, normal)
    now = linearise(problem, probe[:-1], name, {**fixed, name: float(probe[-1])})
    last = np.zeros((len(u), 1))
    last[-1] = 1.0
    direction, sign = solve_signed(bordered(now.dR_dX, now.dR_dp, normal), last)
    onward: Array = direction[:, 0] * (sign * orientation or 1)
    onward = onward / norm(onward / scale)
    step, limits = STEP_OVER_PROBE * delta, np.array([turn, np.inf])
    for _ in range(MAX_DIRECTIONS):
        arclength_normal(onward, scale, normal)
        predicted = u + step * onward
        point = _corrected(problem, predicted, normal, name, fixed, settings)
        at, reached = np.append(point.solution.X, point.solution.value), np.array(point.direction)
        if accept_step(at, reached, predicted, u, onward, scale, step, limits)[0] == ACCEPTED:
            return CorrectedPoint(point.solution, reached, point.orientation)
        if point.orientation != orientation:
            break
        onward = reached / norm(reached / scale)
    return None


def _corrected(
    problem: Any, predicted: Array, normal: Array, name: str, fixed: Mapping[str, float], settings: NewtonSettings
) -> CorrectedPoint:
    """Return the solution near a predicted point, first with step halving at a fixed parameter if necessary.

    The slope of a square root, as of a contact that begins, lets Newton's method oscillate between both sides.
    """
    from hbgear.continuation.stepping.kernels import POLISH_ABOVE

    try:
        return correct(problem, predicted, normal, name, fixed, settings, POLISH_ABOVE)
    except NoConvergence:
        near = solve(problem, predicted[:-1], {**fixed, name: float(predicted[-1])}, settings=settings)
    return correct(problem, np.append(near.X, predicted[-1]), normal, name, fixed, settings, POLISH_ABOVE)
