"""Whether a slow sweep goes on along a branch that bifurcates where its own loses stability.

At a supercritical branch point the solution that loses its stability hands it over to others, which begin there and
lead on in the direction of the sweep: nothing jumps.
"""

from __future__ import annotations

import numpy as np

from hbgear.continuation.curve.segment import normal_of
from hbgear.continuation.events.detector import event_of
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.solvers.corrector import correct
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence

_AWAY = (0.02, 0.005)  # distances from the point, over the size of the solution, at which the new branch is looked at


def continuing(branch: Branch, point: SpecialPoint, direction: int, settings: NewtonSettings) -> Point | None:
    """The stable solution next to a branch point on a branch that leads on in a direction; None if there is none.

    Parameters
    ----------
    branch : a curve that still knows its problem.
    point : a branch point of it.
    direction : +1 or -1, of the parameter along a sweep.
    settings : of the corrector.
    """
    name = branch.parameter
    for away in _AWAY:
        for one in (_beside(branch, point, side, away, settings) for side in (1, -1)):
            if one is not None and one.stable and (one.parameters[name] - point.parameters[name]) * direction > 0:
                return one
    return None


def _beside(branch: Branch, point: SpecialPoint, side: int, away: float, settings: NewtonSettings) -> Point | None:
    """The solution at a distance from a branch point on the branch that leaves there, with what is observed of it."""
    event = event_of(branch, point)
    left = event.branch_direction(branch, point, side) if event else None
    if left is None:
        return None
    problem, start = left
    name = branch.parameter
    u = np.append(start.X, start.parameters[name])
    size = problem.solution_norm(start.X) or 1.0
    scale = np.append(np.full(len(start.X), size), np.ptp(branch.values) or 1.0)
    direction = start.direction / np.linalg.norm(start.direction / scale)
    normal = normal_of(direction, scale)
    normal = normal / np.linalg.norm(normal)
    fixed = {key: value for key, value in start.parameters.items() if key != name}
    try:
        found = correct(problem, u + away * direction, normal, name, fixed, settings).solution
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        return None
    here = {**start.parameters, name: found.value}
    rest = {key: value for key, value in here.items() if key != name}
    seen = as_problem(problem).observe_many(found.X[None], name, np.array([found.value]), True, **rest)[0]
    return Point(
        found.X, here, found.residual, found.iterations, seen.get("multipliers"),
        seen.get("regime", np.zeros(0, np.int8)), seen.get("error", np.nan), problem.layout, problem=problem,
    )  # fmt: skip
