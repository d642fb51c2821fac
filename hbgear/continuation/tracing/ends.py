"""Ends of a curve: an end of the span, closure, retrace, the range of the parameter, and infinity."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.asymptote import (
    MAX_REMAINING_CHANGE,
    SIZE_RATIO,
    power_law_limit,
    rounded_to_error,
    vertical_asymptote,
)
from hbgear.continuation.curve.segment import CurvePoint, cosine, normal_of, point_from_solution
from hbgear.continuation.events.columns import unknowns
from hbgear.continuation.events.fold import FoldEvent, far_side_of_fold
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, SOLVER_ERRORS, refine, solve
from hbgear.continuation.tracing.state import NUMBER_OF_RECENT_POINTS, TraceState

MIN_BOUNDARY_COSINE = 0.9
"""Smallest cosine of the angle between the tangents of the last step to an end of the parameter's range."""

MAX_SQUARED_DISTANCE_RATIO = 1.3
"""Squared distance of an earlier point from the end of a segment, over the squared length of the segment, above which
the segment does not pass it."""

MAX_SQUARED_OFFSET_RATIO = 0.01
"""Squared distance of an earlier point from a segment, over the squared length, above which it is not compared."""

MAX_DISTANCE_RATIO = 1.1
"""Distance of a point from the end of a segment, over the length of the segment, above which it is not on it."""

FOLD_SAMPLES = 8
"""Number of intervals in which a segment is divided to estimate whether its fold lies outside the span."""


class CurveEnds:
    """Detects the ends of a curve, and computes its last point there."""

    def __init__(self, state: TraceState) -> None:
        self.state = state

    def terminal_candidates(self, path: list[CurvePoint]) -> Sequence[int]:
        """Return the numbers of new points at which the curve may end.

        ``path`` holds the last point and the new ones. Candidates are points outside the span, points after a fold, and
        points near the first one once the curve has folded.
        """
        state, span = self.state, self.state.setup.span
        u, direction = unknowns(path), np.array([point.parameter_direction for point in path])
        folds, value = direction[1:] != direction[:-1], u[1:, -1]
        outside = (span.direction * (value - span.end) >= 0) | (span.direction * (value - span.start) < 0)
        length = norms((u[1:] - u[:-1]) / state.scale)
        near_first = np.abs(value - state.first.value) <= MAX_DISTANCE_RATIO * length * state.scale[-1]
        has_folded = np.logical_or.accumulate(folds) | state.has_folded
        return np.flatnonzero(outside | folds | (near_first & has_folded)).tolist()

    # ---- span and range

    def fold_outside_span(self, last: CurvePoint, point: CurvePoint) -> CurvePoint:
        """Return the fold before a point if it lies outside the span and the step came back inside; else the point."""
        state, end_at = self.state, self.state.setup.span.end_at
        if last.parameter_direction * point.parameter_direction >= 0:
            return point
        segment = state.segment(last, point)
        samples = segment.guess(np.arange(1, FOLD_SAMPLES)[:, None] / FOLD_SAMPLES)[:, -1].tolist()
        reach = max(samples) - min(samples)
        if all(end_at(value + shift) is None for value in samples for shift in (-reach, reach)):
            return point
        for fold in FoldEvent().find(segment):
            if fold.located and end_at(fold.point.value) is not None:
                return fold.point
        return point

    def at_span_end(self, last: CurvePoint, point: CurvePoint, end: float) -> CurvePoint:
        """Return the point at an end of the span that the last step crossed; the point given if that fails."""
        state, setup = self.state, self.state.setup
        segment, parameters, name = state.segment(last, point), setup.parameters_at(end), setup.name
        s = (end - last.value) / (point.value - last.value)
        try:
            guess = (
                far_side_of_fold(segment, end)
                if last.parameter_direction * point.parameter_direction < 0
                else segment.guess(s)
            )
            solution = solve(state.problem, guess[:-1], parameters, name, setup.settings.newton)
            solution = refine(state.problem, solution, parameters, name)
            normal = normal_of(point.u - last.u, state.scale)
            return point_from_solution(solution, normal, state.scale, s * point.step, last)
        except SOLVER_ERRORS:
            return point

    def at_range_boundary(self, step: float) -> CurvePoint | None:
        """Return the point at the end of the admissible range that a step would cross; None if it crosses none.

        The problem cannot be evaluated beyond this end.
        """
        state, setup, last = self.state, self.state.setup, self.state.last
        unit = last.tangent / norm(last.tangent / state.scale)
        predicted, ends = last.value + step * unit[-1], (setup.span.start, setup.span.end)
        end = next((x for x in ends if (x - last.value) * (x - predicted) < 0), None)
        if end is None or math.nextafter(end, predicted) in setup.span.admissible:
            return None
        guess = last.u + (end - last.value) / unit[-1] * unit
        try:
            solution = solve(state.problem, guess[:-1], setup.parameters_at(end), setup.name, setup.settings.newton)
            point = point_from_solution(solution, normal_of(unit, state.scale), state.scale, step, last)
        except SEARCH_ERRORS:
            return None
        distance = norm((point.u - last.u) / state.scale)
        lengths = norm(point.tangent / state.scale), norm(last.tangent / state.scale)
        if distance > 2 * step or cosine(point, last, state.scale) < MIN_BOUNDARY_COSINE * lengths[0] * lengths[1]:
            return None
        state.boundary_value = end
        return point

    def range_violation(self, point: CurvePoint) -> str:
        """Return which parameter among the unknowns is outside its admissible range at a point, and the range."""
        problem = self.state.problem
        unknown = problem.split(point.X)[1].items() if problem.unknown_parameters else ()
        return next(
            (
                f"{name} leaves its range (it must {allowed})"
                for name, value in unknown
                if value not in (allowed := problem.range_of(name))
            ),
            "",
        )

    def predicted_range_violation(self) -> str:
        """Return `range_violation` at the prediction of the shortest step, at which the problem cannot be evaluated."""
        state, last = self.state, self.state.last
        return self.range_violation(
            replace(last, u=last.u + state.step / norm(last.tangent / state.scale) * last.tangent)
        )

    # ---- infinity

    def up_to_infinity(self, path: list[CurvePoint]) -> tuple[list[CurvePoint], float | None]:
        """Return the path up to the point from which the curve tends to infinity, and the asymptote.

        The whole path and None are returned for a curve that does not.
        """
        state, setup = self.state, self.state.setup
        last, outside = path[-1], setup.span.end_at
        size = state.problem.solution_norm
        if len(path) == 1 or float(size(last.X)) <= state.solution_scale or outside(last.value) is not None:
            return path, None
        if vertical_asymptote(state.equations, last) is None:
            return path, self._power_law_asymptote(path)
        for i, point in enumerate(path[1:], 1):
            asymptote = vertical_asymptote(state.equations, point)
            if asymptote is not None and outside(asymptote) is None:
                return path[: i + 1], asymptote
        return path, None

    def _power_law_asymptote(self, path: list[CurvePoint]) -> float | None:
        """Return the asymptote close to the last point that a path approaches by a power law; None without one.

        Only problems with a parameter among the unknowns, such as the frequency of free motions, are examined. Forced
        motions have limit equations, without which a sharp resonance has the same power law up to its finite top.
        """
        state, span, last = self.state, self.state.setup.span, path[-1]
        reach, size = MAX_REMAINING_CHANGE * span.width, state.problem.solution_norm
        if not state.problem.unknown_parameters or abs(last.value - path[-2].value) > reach:
            return None
        points = [last]
        for point in itertools.chain(path[-2::-1], state.points[-2::-1]):
            if not 0 < size(point.X) < size(points[-1].X):
                return None
            points.append(point)
            if SIZE_RATIO * size(point.X) <= size(last.X):
                break
        else:
            return None
        sizes, values = np.array([(float(size(point.X)), point.value) for point in reversed(points)]).T
        fit = power_law_limit(sizes, values)
        if fit is None or abs(fit[0] - last.value) > reach:
            return None
        limit, error = fit
        nearest = limit - math.copysign(error, limit - last.value)  # the end of the span may be the limit
        return rounded_to_error(limit, error) if span.end_at(nearest) is None else None

    # ---- closure and retrace

    def closes(self, last: CurvePoint, point: CurvePoint) -> bool:
        """Return whether the segment from last to point passes the first point in its direction."""
        state = self.state
        if len(state.points) <= NUMBER_OF_RECENT_POINTS or not state.has_folded:
            return False
        length = norm((point.u - last.u) / state.scale)
        if abs(state.first.value - point.value) > MAX_DISTANCE_RATIO * length * state.scale[-1]:
            return False
        first = self.first_in_phase()
        return cosine(point, first, state.scale) > 0 and state.segment(last, point).passes(first)

    def first_in_phase(self) -> CurvePoint:
        """Return the first point at the present resolution, in phase with the last point."""
        first, last = self.state.resized(self.state.first), self.state.last
        X, tangent = self.state.problem.in_phase(first.X, first.tangent[:-1], last.X)
        return replace(first, u=np.append(X, first.value), tangent=np.append(tangent, first.tangent[-1]))

    def points_before_retrace(self, path: list[CurvePoint]) -> int:
        """Return the number of new points of a path before the curve retraces itself.

        ``path`` holds the last point and the new ones.
        """
        state = self.state
        has_folded = state.has_folded or any(point.parameter_direction != path[0].parameter_direction for point in path)
        if len(state.points) <= NUMBER_OF_RECENT_POINTS or not has_folded:
            return len(path) - 1
        earlier, u = state.history() / state.scale, unknowns(path) / state.scale
        distance = np.square(earlier).sum(axis=1)[:, None] - 2 * earlier @ u.T + np.square(u).sum(axis=1)
        length = np.square(u[1:] - u[:-1]).sum(axis=1)
        for k in np.flatnonzero((distance[:, 1:] < MAX_SQUARED_DISTANCE_RATIO * length).any(axis=0)):
            if self._retraces(path[k], path[k + 1], earlier):
                return int(k)
        return len(path) - 1

    def _retraces(self, last: CurvePoint, point: CurvePoint, earlier: Array) -> bool:
        """Return whether a segment passes one of the earlier points (scaled) in the opposite direction."""
        state = self.state
        chord = (point.u - last.u) / state.scale
        offsets = earlier - last.u / state.scale
        s = np.clip(offsets @ chord / (chord @ chord), 0, 1)
        normals = offsets - s[:, None] * chord
        squared = np.einsum("ij,ij->i", normals, normals)
        candidates = np.flatnonzero(squared < MAX_SQUARED_OFFSET_RATIO * (chord @ chord))
        neighbours, segment = [state.resized(state.points[i]) for i in candidates], state.segment(last, point)
        return any(cosine(point, neighbour, state.scale) < 0 and segment.passes(neighbour) for neighbour in neighbours)
