"""First points of a curve: the initial solution, or the first two points of a branch that leaves another one.

A branch leaves another one at a special point u_0 in the direction t,

    u(s) = u_0 + s t + O(s^2),   p(s) = p_0 + c s + a s^2 + ...

The special point is the first point of the branch. The second one is so close that the first non-zero term of
p(s) - p_0 dominates,

    1/2 <= s p'(s) / (p(s) - p_0) <= 3        (1 if c is not zero, 2 if it is, as at a pitchfork)

Then the branch does not fold between both points, and its first fold lies beyond the second one.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, point_along, point_from_solution, unit_normal_of
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.point import Point
from hbgear.continuation.solvers.corrector import correct
from hbgear.continuation.solvers.newton import (
    SOLVER_ERRORS,
    NewtonSettings,
    NoConvergence,
    Solution,
    solution_at,
    solve,
)
from hbgear.continuation.tracing.state import TraceSetup, TraceState

MIN_STEP_RATIO = 1e-4
"""Ratio of the smallest distance of a second point from the special point to the first step size."""

DEPARTURE_RATIO = 1e-2
"""Distance, over the first step size, at which the direction of the parameter is that in which the branch leaves."""

VERTICAL_SLOPE = 1e-10
"""Scaled parameter change per step below which it is rounding error: the branch leaves at constant parameter."""

DOMINANT_TERM_RANGE = 0.5, 3.0
"""Range of s p'(s) / (p(s) - p_0) in which the first non-zero term dominates."""

SAME_SOLUTION = 0.05
"""Distance, relative to their norm, up to which initial solutions of two searches are the same."""

ZERO_SOLUTION_RATIO = 1e-12
"""Norm of the solution at a special point, relative to the direction of a branch, below which it is rounding error."""


class ArbitrarySolutionError(NoConvergence):
    """The initial solution is one of a continuum; ``problem`` has the equations that choose one solution of it.

    ``description`` states the arbitrary quantity.
    """

    def __init__(
        self, X: Array, parameters: Mapping[str, float], problem: ContinuationProblem, description: str
    ) -> None:
        super().__init__(description, X, parameters, [])
        self.problem, self.description = problem, description


def begin(setup: TraceSetup, start: Point | BranchStart | Array | None) -> tuple[TraceState, list[CurvePoint]]:
    """Return the state of a trace at its first point, and the second point where the first one is a special point.

    NoConvergence is raised if no solution is found, or the curve has no direction there, `ArbitrarySolutionError` if
    the solution found is one of a continuum, and ValueError if the start lies outside the span or has a wrong number of
    unknowns.
    """
    if isinstance(start, BranchStart):
        return _begin_branch(setup, start)
    value, X = _initial_guess(setup, start)
    _check_start(setup.problem, X)
    state, solution = _initial_solution(setup, value, X, check_uniqueness=start is None)
    try:
        state.points = [_initial_point(state, solution)]
    except np.linalg.LinAlgError:
        message = (
            f"the curve has no direction at {setup.name} = {value:.6g}: a fold or branch point lies exactly there, "
            f"or something is not determined ({state.problem.singular_hint}); start elsewhere"
        )
        raise NoConvergence(message, solution.X, setup.parameters_at(value), [solution.residual]) from None
    return state, []


# ---- initial solution


START_ROUNDING = 1e-9
"""Difference of a start from the beginning of the span, relative to its value, that is attributed to rounding."""


def _initial_guess(setup: TraceSetup, start: Point | Array | None) -> tuple[float, Array]:
    """Return the parameter value and the unknowns at which a trace begins."""
    problem, name, span = setup.problem, setup.name, setup.span
    if isinstance(start, Point):
        value, (low, high) = start.parameters.get(name, span.start), span.bounds
        if not low <= value <= high and math.isclose(value, span.start, rel_tol=START_ROUNDING):
            value = span.start
        if not low <= value <= high:
            raise ValueError(
                f"the start has {name} = {value:.6g}, outside the span ({span.start:.6g}, {span.end:.6g}); "
                "widen the span or choose another start"
            )
        return value, problem.join(problem.from_point(start), start.parameters)
    if start is not None:
        return span.start, np.array(start, dtype=float)
    return span.start, solution_by_problem(setup, problem, setup.parameters_at(span.start))


def solution_by_problem(setup: TraceSetup, problem: ContinuationProblem, parameters: dict[str, float]) -> Array:
    """Return the initial guess of the problem, searched at the requested resolution if that succeeds."""
    X = setup.requested.start(**parameters)
    if setup.requested is problem:
        return X
    try:
        return solve(problem, problem.resized(X), parameters, "", setup.settings.newton).X
    except NoConvergence:
        return problem.start(**parameters)


def _check_start(problem: ContinuationProblem, X: Array) -> None:
    """Raise ValueError if X is no valid start of the problem."""
    if not np.all(np.isfinite(X)):
        raise ValueError("the start has entries that are not finite")
    if problem.size is not None and X.shape != (problem.size,):
        raise ValueError(
            f"the start has {X.size} unknowns; the problem has {problem.size}. Start from a Point, which is converted "
            "to this number, or from unknowns of the right length"
        )


def _initial_solution(setup: TraceSetup, value: float, X: Array, check_uniqueness: bool) -> tuple[TraceState, Solution]:
    """Solve for the initial solution, with as many samples as it requires; return it with the state of the trace."""
    name, newton, parameters = setup.name, setup.settings.newton, setup.parameters_at(value)
    original, problem = setup.problem, setup.problem.with_borders_at(X, parameters)
    solution = solve(problem, X, parameters, name, newton)
    if check_uniqueness and problem.changes:
        problem, solution = _search_resolved(problem, solution, name, parameters, newton)
        original = problem
    finer = problem.resolved(solution.X, parameters)
    if finer is not problem:
        solution = solve(finer, solution.X, parameters, name, newton)
        original = problem = finer
    family = problem.arbitrary(solution.X, parameters) if check_uniqueness else None
    if family is not None:
        raise ArbitrarySolutionError(solution.X, parameters, *family)
    return TraceState(setup, problem, original), solution


def _search_resolved(
    problem: ContinuationProblem, solution: Solution, name: str, parameters: dict[str, float], newton: NewtonSettings
) -> tuple[ContinuationProblem, Solution]:
    """Search an initial solution with more unknowns until it does not depend on their number, and return its problem.

    With an adaptive resolution the search begins with few unknowns, with which there may be other solutions than with
    many: the solution that is found with more unknowns must be the one that Newton's method finds from the first one.
    """
    while True:
        finer = problem.adapted(problem.observe(solution.X, False, **parameters))
        if finer is None or finer.size is None or problem.size is None or finer.size <= problem.size:
            return problem, solution
        try:
            candidate = solve(finer, finer.start(**parameters), parameters, name, newton)
        except NoConvergence:
            return problem, solution
        previous, problem, solution = solution, finer, candidate
        with suppress(NoConvergence):
            refined = solve(finer, finer.resized(previous.X), parameters, name, newton)
            if norm(refined.X - candidate.X) <= SAME_SOLUTION * finer.solution_norm(candidate.X):
                return problem, solution


def _initial_point(state: TraceState, solution: Solution) -> CurvePoint:
    """Return the first point, with its tangent in the direction of the span, and set the scales.

    LinAlgError is raised if the curve has no direction there.
    """
    problem, span = state.problem, state.setup.span
    state.update_scale(solution.X, float(problem.solution_norm(solution.X)))
    normal = np.zeros(len(solution.X) + 1)
    normal[-1] = span.direction
    point = point_from_solution(solution, normal, state.scale)
    if state.solution_scale == 0 and abs(point.tangent[-1]) > 0:  # a zero solution: the size at the end of the span
        size = problem.solution_norm(point.tangent[:-1] / point.tangent[-1] * span.width)
        state.update_scale(solution.X, float(size))
        point = point_from_solution(solution, normal, state.scale)
    return point


# ---- switched branches


def _begin_branch(setup: TraceSetup, start: BranchStart) -> tuple[TraceState, list[CurvePoint]]:
    """Return the state at the first point of a branch with a known direction, and the second point if there is one."""
    problem = setup.problem.with_borders_at(start.X, setup.parameters_at(start.parameters[setup.name]))
    state = TraceState(setup, problem, setup.problem)
    size, along = (float(problem.solution_norm(x)) for x in (start.X, start.direction[:-1]))
    state.update_scale(start.X, along if size <= ZERO_SOLUTION_RATIO * along else size)
    if not start.bifurcating:
        state.points = [_point_along_branch(state, start, 0.0)]
        return state, []
    first, second = _first_two_points(state, start)
    state.points = [first]
    return state, [second]


def _point_along_branch(state: TraceState, start: BranchStart, step: float) -> CurvePoint:
    """Return `point_on_branch` of the problem of a trace."""
    setup = state.setup
    return point_on_branch(state.equations, start, step, state.scale, setup.settings.newton)


def point_on_branch(
    equations: CurveEquations, start: BranchStart, step: float, scale: Array, settings: NewtonSettings
) -> CurvePoint:
    """Return the point at a scaled distance ``step`` along the direction of a branch from its start.

    NoConvergence or LinAlgError is raised if the corrector fails.
    """
    direction = start.direction / np.linalg.norm(start.direction / scale)
    u = np.append(start.X, start.parameters[equations.name]) + step * direction
    corrected = correct(equations, u, unit_normal_of(direction, scale), settings)
    return point_along(corrected, scale, step)


def _first_two_points(state: TraceState, start: BranchStart) -> tuple[CurvePoint, CurvePoint]:
    """Return the special point at which a branch leaves another one, and the next point of the branch.

    NoConvergence or LinAlgError is raised if no point of the branch is found near the special point.
    """
    setup, scale = state.setup, state.scale
    smallest = MIN_STEP_RATIO * setup.settings.steps.first_step
    step, second, departure = setup.settings.steps.first_step, None, 0
    with suppress(*SOLVER_ERRORS):
        departure = _point_along_branch(state, start, DEPARTURE_RATIO * step).parameter_direction
    while step >= smallest:
        try:
            point = _point_along_branch(state, start, step)
        except SOLVER_ERRORS:
            if second is None and step < 10 * MIN_STEP_RATIO * setup.settings.steps.first_step:
                raise
        else:
            second = point
            turned = point.parameter_direction * departure < 0  # beyond a fold, as next to a grazing contact
            if not turned and _first_term_dominates(start.parameters[setup.name], point, step, scale):
                break
        step *= 0.5
    assert second is not None  # else the corrector raised
    u = np.append(start.X, start.parameters[setup.name])
    solution = solution_at(state.problem, u, setup.name, setup.fixed)
    direction = start.direction / np.linalg.norm(start.direction / scale)
    first = replace(second, u=u, tangent=direction, residual=solution.residual, iterations=0, step=0.0, observed={})
    return first, second


def _first_term_dominates(value: float, point: CurvePoint, step: float, scale: Array) -> bool:
    """Return whether the first non-zero term dominates the parameter change from a value to the point."""
    change, slope = (point.value - value) / scale[-1], point.tangent[-1] / scale[-1]
    if abs(change) <= VERTICAL_SLOPE * step:
        return True
    low, high = DOMINANT_TERM_RANGE
    return bool(low <= step * slope / change <= high)
