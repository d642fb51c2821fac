"""A posteriori error estimates of special points, by comparison of different numbers of unknowns.

    {R, g}(X, p) = 0,     error(n) = max_i w_i | p(n_i) - p(n) |

R and g are the equations of the special point, and p(n) is the parameter value that solves them with n unknowns. The
problem defines the numbers n_i and the weights w_i (`ContinuationProblem.comparisons`): 3/2 n and 2 n with the weight 1
if these can be solved, else smaller numbers with weights for the slow rate n^-2. One difference is not sufficient: with
short contacts the error oscillates with the number of unknowns, and crosses zero.

Each p(n_i) is converged, because a single Newton step is wrong by a factor of 20 for short contacts. The estimate
depends on the point and its number of unknowns alone, and not on the path of the trace. If the error exceeds the
target, or the multipliers deviate from the values that the event requires (`Event.deviation`), the point is located
with twice the unknowns, and the error is estimated again. A special point without equations, or one that leaves its
segment, is located on the segment solved again with the other number of unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.builder import point_fields
from hbgear.continuation.curve.segment import CurvePoint, Segment, has_corner, rescaled, resolve_at_resolution
from hbgear.continuation.events.event import LocatedEvent, RefinedLocation
from hbgear.continuation.events.fold import FoldEvent
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem, observe_all
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.stability import MAX_MULTIPLIER_DEVIATION
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, SOLVER_ERRORS, Solution, solution_at

PARAMETER_ROUNDING = 1e-12
"""Rounding error of a parameter, relative to its unit. Error estimates are not smaller."""


MAX_POINT_SHIFT = 0.05
"""Largest scaled distance by which a special point may move at another number of unknowns."""


SEGMENT_EXTENSIONS = 1.0, 3.0, 9.0
"""Lengths, relative to the segment, by which it is extended at both ends when it is searched again."""


MAX_FAILED_REFINEMENTS = 2
"""Number of successive refinements without a location, after which the search ends."""


UNDER_RESOLVED_ERROR = 0.5
"""Error of a solution, relative to its norm, above which it is no initial guess for more unknowns."""


SETTLED_STEP_RATIO = 0.1
"""Last Newton step, relative to the change of the parameter, below which this change is known."""


MAX_PLAIN_STEPS = 6
"""Number of undamped Newton steps, after which the damped iteration is used."""


COMPARISON_COST = 3
"""Cost of a special point located with 3/2 n and 2 n unknowns, in solutions with 2 n unknowns."""


FAILED_COMPARISON_COST = 150
"""Additional cost of a special point that is not found with another number of unknowns, in the smallest solutions.

All methods are tried then, with their largest numbers of iterations.
"""


LOCATION_COST = 4
"""Cost of a special point located to all digits, in solutions."""


SAME_SEGMENT_FRACTION = 1e-3
"""Shift of a point, as a fraction of the segment, up to which it remains the same special point."""


@dataclass(frozen=True)
class Comparison:
    """A special point at another number of unknowns.

    ``value`` is the parameter there, nan if the point was not found, and ``distance`` the scaled distance from the
    original location. ``locate`` locates the point to all digits, and returns None if that fails.
    """

    value: float
    distance: float
    locate: Callable[[], RefinedLocation | None]


_NOT_FOUND = Comparison(math.nan, math.inf, lambda: None)


def estimate_error(segment: Segment, event: LocatedEvent, accuracy: float, work: Work | None = None) -> LocatedEvent:
    """Return a special point with its error estimate, refined until the error is below the target.

    The target is relative to the size of the parameter (`ContinuationProblem.unit_of`). The last estimate is kept if
    the limit of the work is reached or the highest resolution has no comparison. The error is infinite if the point
    does not exist at other numbers of unknowns, and nan if there is no other number for a comparison, or the limit of
    the work allows none. The point is not located, with an infinite error, if its multipliers at the largest number of
    unknowns deviate by more than 1e-3 from the values that the event requires.
    """
    under_resolved = (
        is_under_resolved(segment.problem, end.X, end.observed.get("error", 0.0)) for end in (segment.a, segment.b)
    )
    if not segment.problem.comparisons or any(under_resolved):
        return event
    work = work or Work(math.inf)
    unit = segment.problem.unit_of(segment.name, event.point.value)
    goal, problem, failures, error = accuracy * unit, segment.problem, 0, math.inf
    points: dict[str, Comparison] = {}
    while True:
        if not _may_compare(problem, problem is segment.problem, work):
            error = math.nan if problem is segment.problem else error
            break
        error = _estimate(segment, event, problem, goal, points)
        if math.isinf(error) and event.located:
            work.estimates(0, FAILED_COMPARISON_COST)
        finer = problem.refined_problem
        if (error <= goal and _deviation(segment, event) <= MAX_MULTIPLIER_DEVIATION) or finer is None:
            break
        if not work.allows(finer.equivalent_size, LOCATION_COST):
            error = _estimate(segment, event, problem, math.inf, points)
            break
        refined = _comparison(finer, segment, event, points).locate()
        failures, problem = (0 if refined else failures + 1), finer
        if refined:
            event = replace(event, refined=refined, located=True)
        elif failures == MAX_FAILED_REFINEMENTS:
            break
    located = event.located and _deviation(segment, event) <= MAX_MULTIPLIER_DEVIATION
    unknown = failures or (event.located and not located)
    location = event.refined or RefinedLocation(segment.problem, event.point)
    smallest = max(PARAMETER_ROUNDING * unit, event.event.location_error(segment, location) if located else 0.0)
    return replace(event, error=math.inf if unknown else max(error, smallest), located=located)


def _deviation(segment: Segment, event: LocatedEvent) -> float:
    """Return the distance of the multipliers of a point from the values that its event requires; 0 if unknown."""
    if not event.located or "multipliers" not in segment.a.observed or event.event.deviation(np.empty(0, complex)) == 0:
        return 0.0
    location = event.refined or RefinedLocation(segment.problem, event.point)
    if not location.point.observed:
        equations = segment.equations._replace(problem=location.problem)
        location.point.observed.update(observe_all(equations, location.point.u[None], True)[0])
    multipliers = location.point.observed.get("multipliers", np.full(1, math.nan))
    return 0.0 if np.isnan(multipliers).any() else event.event.deviation(multipliers)


def _may_compare(problem: ContinuationProblem, first: bool, work: Work) -> bool:
    """Return whether a problem has comparisons, and the limit of the work allows all of them.

    The first estimate of a point (``first``) has a limit of its own. Later estimates only improve it.
    """
    if not problem.comparisons:
        return False
    largest = max(comparison.equivalent_size for comparison, _ in problem.comparisons)
    return work.estimates(largest, COMPARISON_COST) if first else work.allows(largest, COMPARISON_COST)


def _estimate(
    segment: Segment, event: LocatedEvent, problem: ContinuationProblem, goal: float, points: dict[str, Comparison]
) -> float:
    """Return the error of a point at the resolution of a problem; an infinite goal gives the complete estimate.

    The comparisons stop at the first one that exceeds the goal. ``points`` has the points that are known at other
    resolutions, by the texts of their resolutions, and receives further ones.
    """
    is_current = (event.refined.problem if event.refined else segment.problem) is problem
    if not event.located or not is_current:  # not located at this resolution
        return math.inf
    changes: list[float] = []
    for comparison, weight in problem.comparisons:
        changes.append(weight * (_comparison(comparison, segment, event, points).value - event.value))
        if problem.refined_problem is not None and not abs(changes[-1]) <= goal:
            return math.inf if math.isnan(changes[-1]) else abs(changes[-1])
    finite = [change for change in changes if not math.isnan(change)]
    # changes of different signs may both be small by chance: the other two points are further from each other
    return max(0.0, *finite) - min(0.0, *finite) if finite else math.inf


def _comparison(
    problem: ContinuationProblem, segment: Segment, event: LocatedEvent, points: dict[str, Comparison]
) -> Comparison:
    """Return the point at another resolution, from ``points`` if it is known there."""
    if problem.resolution not in points:
        points[problem.resolution] = _at_other_resolution(segment, event, problem)
    return points[problem.resolution]


def is_under_resolved(problem: ContinuationProblem, X: Array, error: float) -> bool:
    """Return whether the error of a solution exceeds half of its norm: too much for a guess at a higher resolution."""
    return error > UNDER_RESOLVED_ERROR * problem.solution_norm(X)


def _at_other_resolution(segment: Segment, event: LocatedEvent, problem: ContinuationProblem) -> Comparison:
    """Return the point at another resolution: by its equations, else on the segment solved again.

    If the solution of the equations leaves the segment, it may be another special point. Then both methods are used,
    and the nearer result is returned.
    """
    simple = event.located and event.finder is None  # the equations are singular if two multipliers cross at once
    if simple and (segment.problem.smooth or event.event.regular_at_corners):
        first = _by_equations(segment, event, problem)
        if first is not None:
            refined = first.locate() if _left_segment(segment, first) else None
            if refined is None:
                return first
            second = _on_segment(segment, event, problem)
            return second if second.distance < first.distance else first
    if event.located and isinstance(event.event, FoldEvent):
        with suppress(*SOLVER_ERRORS):
            change = _fold_shift(segment, event.refined.point if event.refined else event.point, problem)
            return Comparison(event.value + change, 0.0, lambda: _on_segment(segment, event, problem).locate())
    return _on_segment(segment, event, problem)


def _by_equations(segment: Segment, event: LocatedEvent, problem: ContinuationProblem) -> Comparison | None:
    """Return the point by Newton's method on its equations at another resolution; None if it fails.

    In a problem that is not smooth, thresholds are solved in this way, and folds at corners, with those of the corner.
    """
    location = event.refined or RefinedLocation(segment.problem, event.point)
    located, parameters = location.point, segment.parameters_at(location.point.value)
    start = np.append(problem.resized(located.X), located.value)
    try:
        fields = point_fields(segment.equations._replace(problem=location.problem), located)
        point = SpecialPoint(**fields, kind=event.event.kind, note=event.note)
        smooth = segment.problem.smooth
        extended = event.event.equations(problem if smooth else location.problem, segment.name, point)
        if extended is None or (not smooth and isinstance(extended, FoldProblem)):
            return None
        if not smooth:
            extended = extended.for_problem(problem.original)
        unit = problem.unit_of(segment.name, located.value)
        U = _newton_until_settled(extended, start, parameters, PARAMETER_ROUNDING * unit)
    except SEARCH_ERRORS:
        return None

    def locate() -> RefinedLocation | None:
        try:
            solution = extended.located(U, parameters)
            point = solution_at(extended.problem, solution.X, segment.name, segment.parameters)
        except SEARCH_ERRORS:
            return None
        refined = _curve_point(segment, problem, point)
        valid = (
            _distance(segment, refined, located) <= MAX_POINT_SHIFT and refined.residual <= segment.settings.tolerance
        )
        return RefinedLocation(problem, refined) if valid else None

    distance = _distance(segment, replace(located, u=U), located)
    return Comparison(float(U[-1]), distance, locate) if distance <= MAX_POINT_SHIFT else None


def _newton_until_settled(
    extended: MinimallyAugmentedProblem, start: Array, parameters: dict[str, float], rounding: float
) -> Array:
    """Return unknowns (X, p) of a special point whose change of p is accurate to a tenth."""
    U, equations = start, extended
    for _ in range(MAX_PLAIN_STEPS):
        last = U
        try:
            equations, U = equations.stepped(U, parameters, 1)
        except np.linalg.LinAlgError:
            break
        if not np.isfinite(U).all():
            break
        if abs(U[-1] - last[-1]) <= max(SETTLED_STEP_RATIO * abs(U[-1] - start[-1]), rounding):
            return U
    return extended.located(start, parameters).X


def _left_segment(segment: Segment, comparison: Comparison) -> bool:
    """Return whether a point moved beyond the ends of its segment, and may be another special point.

    The segments of corners are so short that their points leave them at any other resolution.
    """
    if comparison.distance <= SAME_SEGMENT_FRACTION * segment.length or has_corner(segment):
        return False
    refined = comparison.locate()
    return refined is not None and not 0 <= segment.fraction_of(_resized(segment, refined.point)) <= 1


def _on_segment(segment: Segment, event: LocatedEvent, problem: ContinuationProblem) -> Comparison:
    """Return the point located on the segment solved again at another resolution."""
    find = (event.finder or event.event).find
    try:
        resolved = _segment_at_resolution(segment, problem)
        points = [
            p
            for p in find(resolved) or _on_extended_segment(resolved, find)
            if p.located and p.event.kind == event.event.kind
        ]
    except SOLVER_ERRORS:
        return _NOT_FOUND
    if not points:
        return _NOT_FOUND
    point = min(points, key=lambda p: abs(resolved.fraction_of(p.point.u) - event.s)).point
    return Comparison(
        point.value, _distance(segment, point, (event.refined or event).point), lambda: RefinedLocation(problem, point)
    )


def _fold_shift(segment: Segment, point: CurvePoint, finer: ContinuationProblem) -> float:
    """Return the change of the parameter value of a fold at a higher resolution, from one point near the fold.

        p(s) ~ p + t (s - s_0) + k (s - s_0)^2 / 2,   at the fold p - t^2 / 2k

    with the slope t at the point and k = dt/ds of the segment.
    """
    finer = finer.with_borders_at(finer.resized(point.X), segment.parameters_at(point.value))
    scale = rescaled(segment.scale, finer, len(finer.resized(point.X)))
    near_fold = resolve_at_resolution(point, segment.equations._replace(problem=finer), scale, segment.settings)
    begin, end = segment.slopes
    curvature = (end[-1] - begin[-1]) / segment.length**2
    return float(abs(near_fold.value - point.value) + near_fold.tangent[-1] ** 2 / abs(2 * curvature))


def _segment_at_resolution(segment: Segment, finer: ContinuationProblem) -> Segment:
    """Return the segment with its ends solved at a higher resolution, with their monitored quantities."""
    scale = rescaled(segment.scale, finer, len(finer.resized(segment.a.X)))
    finer = finer.with_borders_at(finer.resized(segment.a.X), segment.parameters_at(segment.a.value))
    equations, settings = segment.equations._replace(problem=finer), segment.settings
    a, b = (resolve_at_resolution(point, equations, scale, settings) for point in (segment.a, segment.b))
    return _segment_between(replace(segment, problem=finer, scale=scale), a, b)


def _on_extended_segment(segment: Segment, find: Callable[[Segment], list[LocatedEvent]]) -> list[LocatedEvent]:
    """Return the special points of a segment extended at both ends, where they may lie at another resolution."""
    for extension in SEGMENT_EXTENSIONS:
        if extension > 1 and extension * segment.length > MAX_POINT_SHIFT:
            break
        try:
            events = find(_segment_between(segment, segment.at(-extension), segment.at(1.0 + extension)))
        except SOLVER_ERRORS:
            break
        if events:
            return events
    return []


def _segment_between(segment: Segment, a: CurvePoint, b: CurvePoint) -> Segment:
    """Return the segment between two other points, with their monitored quantities."""
    stability = "multipliers" in segment.a.observed
    observed = observe_all(segment.equations, np.array([a.u, b.u]), stability, errors=False)
    for end, quantities in zip((a, b), observed, strict=True):
        end.observed.update(quantities)
    return segment.part(a, b)


def _curve_point(segment: Segment, problem: ContinuationProblem, point: Solution) -> CurvePoint:
    """Return the point of a solution on a segment, with the tangent of the first end."""
    u = np.append(point.X, point.value)
    tangent = np.append(problem.resized(segment.a.tangent[:-1]), segment.a.tangent[-1])
    return CurvePoint(u, tangent, segment.a.orientation, point.residual, point.iterations)


def _distance(segment: Segment, a: CurvePoint, b: CurvePoint) -> float:
    """Return the scaled distance of two points in the unknowns of the segment."""
    return norm((_resized(segment, a) - _resized(segment, b)) / segment.scale)


def _resized(segment: Segment, point: CurvePoint) -> Array:
    """Return the unknowns u of a point at the resolution of the segment."""
    return np.append(segment.problem.resized(point.X), point.value)
