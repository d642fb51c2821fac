"""Jumps of slow sweeps: the point at which a sweep leaves a branch, and the solution of the same curve after it."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from hbgear.continuation.curve.builder import build_point, point_fields
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.events.detector import event_of
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem, observe_all
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.layout import HasDistance
from hbgear.continuation.results.point import BIFURCATING, Jump, Point, SpecialPoint
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS, is_stable
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, NewtonSettings, NoConvergence, Solution, solve
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.first_point import point_on_branch
from hbgear.continuation.tracing.state import TraceSettings

_BRANCHING = ("BP", "PD")
"""Kinds of special points at which another branch of periodic motions leaves."""

UNCERTAIN_POINTS_AT_FOLD = 3
"""Number of points next to a fold whose stability may be wrong.

The fold of the truncated equations and the multiplier +1 of the exact motion differ by the truncation error.
"""


def find_jumps(branch: Branch, settings: NewtonSettings = NewtonSettings()) -> tuple[Jump, ...]:
    """Return a `Jump` for each fold that a slow sweep along a stable section of the branch reaches.

    A branch point at which the curve turns back, as at the vertex of a pitchfork, is a fold here.

    If the section loses its stability just before the fold (PD, NS), the sweep leaves the branch there, and the jump
    has the label of that point. The sweep lands on the stable section of the same curve at the same parameter value. If
    there are several, it lands on the one with the nearest motion; see `nearest`. If the section loses its stability at
    a branch point from which a stable branch leads on, the sweep continues on that branch and does not jump, and if a
    stable motion of twice the period leads on from a period doubling, there is no jump in the list. There are no jumps
    without multipliers or problem.
    """
    if branch.multipliers is None or branch.problem is None:
        return ()
    departures, stability = [], is_stable(branch.multipliers)  # undecided points by their most likely stability
    folds = {point.index: point for point in branch.special if _turns_at(branch, point)}
    for fold in folds.values():
        if not fold.located or not 0 < fold.index < len(branch) - 1:
            continue
        departure = partial(_departure, branch, stability, folds, fold)
        sides = [(side, point) for side in (-1, 1) if (point := departure(side)) is not None]
        if not sides:
            continue
        # a fold ends one stable section; if uncertain points suggest two, the longer one is taken
        side, point = max(sides, key=lambda pair: _stable_run(stability, folds, fold.index, pair[0]))
        direction = 1 if branch.values[fold.index] > branch.values[fold.index + side] else -1
        onward = continuing(branch, point, direction, settings) if point.kind in _BRANCHING else None
        if onward is not None and point.kind == "PD":
            continue
        solutions = [] if onward is not None else _solutions_on_other_sections(branch, point, fold, direction, settings)
        departures.append((point, direction, onward, solutions))
    jumps = []
    groups = monitored_points(branch, [solutions for *_, solutions in departures])
    for (point, direction, onward, _), points in zip(departures, groups, strict=True):
        value, stable = point.parameters[branch.parameter], tuple(p for p in points if p.stable)
        if onward is not None:
            note = f"no jump: a stable branch leaves there, hb.switch(curve, '{point.label}')"
            jumps.append(
                Jump(point.label, branch.parameter, value, direction, point, onward, BIFURCATING, (onward,), note)
            )
            continue
        after = nearest(point, stable)
        jumps.append(Jump(point.label, branch.parameter, value, direction, point, after, candidates=stable))
    return tuple(jumps)


def _turns_at(branch: Branch, point: SpecialPoint) -> bool:
    """Return whether a curve turns back at a special point: a fold, or a branch point at the vertex of a pitchfork."""
    if point.kind != "BP" or not 0 < point.index < len(branch) - 1:
        return point.kind == "LP"
    before, turn, after = branch.values[point.index - 1 : point.index + 2]
    return bool((before - turn) * (after - turn) > 0)


def _departure(
    branch: Branch, stable: np.ndarray, folds: Container[int], fold: SpecialPoint, side: int
) -> SpecialPoint | None:
    """Return the point at which a sweep towards a fold loses stability; None if that side is unstable.

    ``folds`` has the numbers of the points at which the curve turns back.
    """
    marks = {p.index: p for p in branch.special if p.kind in STABILITY_CHANGING_KINDS}
    departure: SpecialPoint | None = None
    i = fold.index + side
    # towards the last stable point before the fold; a loss of stability on the way is where the sweep leaves
    while 0 <= i < len(branch):
        if i in folds:
            return None
        if i in marks:
            departure = marks[i]
        elif stable[i]:
            return departure or (fold if abs(i - fold.index) <= UNCERTAIN_POINTS_AT_FOLD else None)
        i += side
    return None


def _stable_run(stable: np.ndarray, folds: Iterable[int], start: int, side: int) -> int:
    """Return the number of stable points on one side of a fold, up to the next fold."""
    if side > 0:
        return int(np.count_nonzero(stable[start + 1 : min((i for i in folds if i > start), default=len(stable))]))
    return int(np.count_nonzero(stable[max((i for i in folds if i < start), default=-1) + 1 : start]))


def _solutions_on_other_sections(
    branch: Branch, departure: SpecialPoint, fold: SpecialPoint, direction: int, settings: NewtonSettings
) -> list[Solution]:
    """Return the solutions on other sections of the curve at the parameter value at which a sweep leaves it.

    A fold located with more unknowns may lie before the fold of the points. The points then pass its parameter value
    once more on both sides of the fold. These crossings belong to the section that is left and are skipped.
    """
    value = departure.parameters[branch.parameter]
    low, high = sorted((departure.index, fold.index))
    past = (branch.values - value) * direction > 0 if departure is fold else np.zeros(len(branch), dtype=bool)
    while low > 0 and past[low]:
        low -= 1
    while high < len(branch) - 1 and past[high]:
        high += 1
    return motions_at(branch, value, settings, skip=range(low - 1, high + 1))


def motions_at(branch: Branch, value: float, settings: NewtonSettings, *, skip: range = range(0)) -> list[Solution]:
    """Return the solutions of a branch at a value of its parameter, in the order of the branch.

    They are solved from the points on both sides of the value, except on the segments ``skip``; a crossing at which the
    corrector fails is left out.
    """
    solutions, problem = [], as_problem(branch.problem)
    for crossing in crossings_at(branch, value):
        if crossing.index in skip:
            continue
        parameters = {**branch.parameters_at(crossing.index), branch.parameter: value}
        unknown = {name: float(crossing.interpolate(branch.tracked[name])) for name in problem.unknown_parameters}
        parameters = {name: x for name, x in parameters.items() if name not in unknown}
        U = problem.join(crossing.interpolate(branch.X), unknown)
        try:
            solutions.append(solve(problem.with_borders_at(U, parameters), U, parameters, branch.parameter, settings))
        except NoConvergence:
            continue
    return solutions


def points_at(branch: Branch, value: float) -> tuple[Point, ...]:
    """Return all solutions of the curves of a span at a value of the parameter; see `Branch.at`.

    ValueError is raised if no curve reaches the value, or the problem is unknown.
    """
    low, high = min(curve.values.min() for curve in branch.curves), max(curve.values.max() for curve in branch.curves)
    if not low <= value <= high:
        raise ValueError(
            f"no curve reaches {branch.parameter} = {value:.6g}: the span that was traced is {low:.6g} to {high:.6g}"
        )
    curves = [replace(curve, problem=curve.require_problem()) for curve in branch.curves]
    return tuple(point for curve in curves for point in points_of(curve, value))


def points_of(branch: Branch, value: float) -> list[Point]:
    """Return the solutions of a branch, whose problem is known, at a value of its parameter."""
    return monitored_points(branch, [motions_at(branch, value, NewtonSettings())])[0]


def monitored_points(branch: Branch, groups: list[list[Solution]]) -> list[list[Point]]:
    """Return groups of solutions on a branch as points with their monitored quantities, in the same groups."""
    solutions = [solution for group in groups for solution in group]
    if not solutions:
        return [[] for _ in groups]
    problem = as_problem(branch.problem)
    excluded = {branch.parameter, *problem.unknown_parameters}
    fixed = {k: v for k, v in branch.parameters_at(0).items() if k not in excluded}
    equations = CurveEquations(problem, branch.parameter, fixed)
    u = np.array([np.append(solution.X, solution.value) for solution in solutions])
    observed = observe_all(equations, u, True)
    points = iter(
        Point(**point_fields(equations, solution, data)) for solution, data in zip(solutions, observed, strict=True)
    )
    return [[next(points) for _ in group] for group in groups]


def nearest(departure: Point, solutions: Sequence[Point]) -> Point | None:
    """Return the stable solution with the smallest distance from the point at which a sweep leaves the branch, or None.

    The basins of attraction determine which solution a jump reaches; only time integration computes them. During the
    transient the phase drifts, and the amplitudes change last. Therefore amplitudes are compared if the layout can
    evaluate them.
    """
    return min((p for p in solutions if p.stable), key=lambda point: distance(departure, point), default=None)


def distance(a: Point, b: Point) -> float:
    """Return the distance of two solutions: of their layout (`HasDistance`), else the norm of the difference."""
    if isinstance(a.layout, HasDistance) and isinstance(b.layout, type(a.layout)):
        return a.layout.distance(a.X, b.layout, b.X)
    return float(np.linalg.norm(a.X - b.X))


# ---- branches that continue a sweep

DISTANCES_FROM_BRANCH_POINT = (0.02, 0.005)
"""Distances from a branch point or period doubling, relative to the solution norm, at which the new branch is
evaluated."""


def continuing(branch: Branch, point: SpecialPoint, direction: int, settings: NewtonSettings) -> Point | None:
    """Return a stable solution close to a BP or PD, on a branch that leads on in the direction of a sweep, or None."""
    name = branch.parameter
    for offset in DISTANCES_FROM_BRANCH_POINT:
        for new in (point_on_new_branch(branch, point, side, offset, settings) for side in (1, -1)):
            if new is not None and new.stable and (new.parameters[name] - point.parameters[name]) * direction > 0:
                return new
    return None


def point_on_new_branch(
    branch: Branch, point: SpecialPoint, side: int, offset: float, settings: NewtonSettings
) -> Point | None:
    """Return the monitored solution at a distance from a BP or PD on the new branch; None if it does not exist.

    The distance ``offset`` is relative to the solution norm; ``side`` is the direction in which the new branch leaves.
    """
    event = event_of(branch, point)
    try:
        new_branch = event.branch_direction(branch, point, side) if event else None
    except NoConvergence:
        return None
    if new_branch is None:
        return None
    problem, start = new_branch
    if not start.direction.any():  # the problem follows curves itself
        return _first_point(problem, start, branch, offset, settings)
    scale = np.append(np.full(len(start.X), problem.solution_norm(start.X) or 1.0), np.ptp(branch.values) or 1.0)
    fixed = {name: value for name, value in start.parameters.items() if name != branch.parameter}
    equations = CurveEquations(problem, branch.parameter, fixed)
    try:
        new = point_on_branch(equations, start, offset, scale, settings)
    except SEARCH_ERRORS:
        return None
    new.observed = observe_all(equations, new.u[None], True)[0]
    return build_point(equations, new)


def _first_point(
    problem: ContinuationProblem, start: BranchStart, branch: Branch, offset: float, settings: NewtonSettings
) -> Point | None:
    """Return the first point at a distance from a special point on a branch that a problem follows itself."""
    steps, span = StepControl(max_points=POINTS_OF_NEW_BRANCH), (float(branch.values.min()), float(branch.values.max()))
    setup = TraceSettings(branch.parameter, None, steps, settings, True, False, (), None, None)
    try:
        curve = problem.own_trace(span, start, setup, False)
    except (NoConvergence, ValueError):
        return None
    if not isinstance(curve, Branch):
        return None
    distances = np.linalg.norm(curve.X - curve.X[0], axis=1) / (problem.solution_norm(curve.X[0]) or 1.0)
    return curve[int(np.argmax(distances > offset))] if (distances > offset).any() else curve[-1]


POINTS_OF_NEW_BRANCH = 5
"""Largest number of points that are computed on a new branch."""
