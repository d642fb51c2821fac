"""Jumps: where a slow sweep of the parameter leaves a branch, and where on the same curve it lands."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hbgear.continuation.curve.segment import normal_of
from hbgear.continuation.events.detector import event_of
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import observe_all
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.layout import HasDistance
from hbgear.continuation.results.point import BIFURCATING, Jump, Point, SpecialPoint
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS, is_stable
from hbgear.continuation.solvers.corrector import correct
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, Solution, solve

# A fold of the truncated equations and the multiplier +1 of the true motion differ by the truncation error: that many
# rows beside a fold may carry the other verdict.
_ROWS_IN_DOUBT = 3


def find_jumps(branch: Branch, settings: NewtonSettings = NewtonSettings()) -> tuple[Jump, ...]:
    """A `Jump` for each fold that a slow sweep along a stable part of the branch runs into.

    Where the part loses its stability just before the fold (PD, NS), the sweep leaves there, and the jump carries that
    point's label. A sweep that finds no stable motion of this kind any more lands on the stable part of the same
    curve at the same parameter; if there are several, on the one whose motion is nearest: see `nearest_solution`. Where
    it loses
    its stability at a branch point from which a stable branch leads on, the sweep continues there, and nothing jumps.
    """
    if branch.multipliers is None or branch.problem is None:
        return ()
    left, likely = [], is_stable(branch.multipliers)  # undecided rows as they are most likely
    for fold in branch.special:
        if fold.kind != "LP" or not fold.located or not 0 < fold.index < len(branch) - 1:
            continue
        sides = [(side, point) for side in (-1, 1) if (point := _leaves_at(branch, likely, fold, side)) is not None]
        if not sides:
            continue
        # a fold ends one stable part; where rows in doubt make it look like two, the longer run is the true one
        side, point = max(sides, key=lambda found: _stable_run(branch, likely, fold.index, found[0]))
        direction = 1 if branch.values[fold.index] > branch.values[fold.index + side] else -1
        left.append((point, direction, _crossed(branch, point, fold, direction, settings)))
    jumps = []
    for (point, direction, _), found in zip(left, monitored_points(branch, [found for *_, found in left]), strict=True):
        value, stable = point.parameters[branch.parameter], tuple(p for p in found if p.stable)
        onward = continuing(branch, point, direction, settings) if point.kind == "BP" else None
        if onward is not None:
            note = f"no jump: a stable branch leaves there, hb.switch(curve, '{point.label}')"
            jumps.append(
                Jump(point.label, branch.parameter, value, direction, point, onward, BIFURCATING, (onward,), note)
            )
            continue
        after = nearest(point, stable) if len(stable) > 1 else next(iter(stable), None)
        jumps.append(Jump(point.label, branch.parameter, value, direction, point, after, candidates=stable))
    return tuple(jumps)


def _leaves_at(branch: Branch, stable: np.ndarray, fold: SpecialPoint, side: int) -> SpecialPoint | None:
    """Where a sweep towards the fold from one side loses its stable motion; None if that side is unstable."""
    marks = {p.index: p for p in branch.special if p.kind in STABILITY_CHANGING_KINDS}
    lost: SpecialPoint | None = None
    i = fold.index + side
    while 0 <= i < len(branch):
        mark = marks.get(i)
        if mark is not None and mark.kind == "LP":
            return None
        if mark is not None:
            lost = mark
        elif stable[i]:
            return lost or (fold if abs(i - fold.index) <= _ROWS_IN_DOUBT else None)
        i += side
    return None


def _stable_run(branch: Branch, stable: np.ndarray, start: int, side: int) -> int:
    """Number of stable rows on one side of a fold, up to the next fold."""
    folds = [p.index for p in branch.special if p.kind == "LP"]
    if side > 0:
        return int(np.count_nonzero(stable[start + 1 : min((i for i in folds if i > start), default=len(branch))]))
    return int(np.count_nonzero(stable[max((i for i in folds if i < start), default=-1) + 1 : start]))


def _crossed(
    branch: Branch, left: SpecialPoint, fold: SpecialPoint, direction: int, settings: NewtonSettings
) -> list[Solution]:
    """The motions on other parts of the curve at the parameter of the point left.

    A fold that was solved for with more unknowns may lie before that of the rows, which then pass its value once more
    on both sides: these are the motions that are left, not others.
    """
    value = left.parameters[branch.parameter]
    low, high = sorted((left.index, fold.index))
    past = (branch.values - value) * direction > 0 if left is fold else np.zeros(len(branch), dtype=bool)
    while low > 0 and past[low]:
        low -= 1
    while high < len(branch) - 1 and past[high]:
        high += 1
    return motions_at(branch, value, settings, skip=range(low - 1, high + 1))


def motions_at(branch: Branch, value: float, settings: NewtonSettings, *, skip: range = range(0)) -> list[Solution]:
    """The motions of a branch at a value of its parameter, solved for between the rows where the curve passes it.

    ``skip`` holds rows after which it is not looked for.
    """
    found = []
    for place in crossings_at(branch, value):
        if place.index in skip:
            continue
        here = {**branch.parameters_at(place.index), branch.parameter: value}
        try:
            found.append(
                solve(as_problem(branch.problem), place.interpolate(branch.X), here, branch.parameter, settings)
            )
        except NoConvergence:
            continue
    return found


def monitored_points(branch: Branch, groups: list[list[Solution]]) -> list[list[Point]]:
    """Motions, group by group, with what the problem says of them."""
    every = [solution for group in groups for solution in group]
    if not every:
        return [[] for _ in groups]
    fixed = {k: v for k, v in branch.parameters_at(0).items() if k != branch.parameter}
    here = [{**fixed, branch.parameter: solution.value} for solution in every]
    u = np.array([np.append(solution.X, solution.value) for solution in every])
    seen = observe_all(as_problem(branch.problem), u, branch.parameter, fixed, True)
    points = iter([
        Point(
            solution.X, p, solution.residual, solution.iterations, one.get("multipliers"),
            one.get("regime", np.zeros(0, np.int8)), one.get("error", math.nan), branch.layout, problem=branch.problem,
        ) for solution, p, one in zip(every, here, seen, strict=True)
    ])  # fmt: skip
    return [[next(points) for _ in group] for group in groups]


def nearest(left: Point, found: Sequence[Point]) -> Point | None:
    """The stable one whose motion is nearest to that of the point left, if there is any.

    Which of several motions a jump ends in is decided by their basins, which only integration knows. At the fold the
    motion moves on with the phase that it has, but on its way to another motion the phase turns: what it keeps longest
    are its amplitudes, so those are compared where the unknowns are read as motions.
    """
    return min((p for p in found if p.stable), key=lambda point: distance(left, point), default=None)


def distance(one: Point, other: Point) -> float:
    """How far apart two solutions are: as their reader says (`HasDistance`), else the norm of the difference."""
    if isinstance(one.layout, HasDistance) and isinstance(other.layout, type(one.layout)):
        return one.layout.distance(one.X, other.layout, other.X)
    return float(np.linalg.norm(one.X - other.X))


# ---- branches that continue a sweep

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
