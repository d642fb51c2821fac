"""Continuation loop: predictor-corrector steps along the curve until one of its ends.

Each round takes one or many steps (`stepper`), then accepts their points one after the other: it cuts off a path that
retraces the curve or tends to infinity, tests the points at which the curve may end, and adapts scales and resolution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hbgear.continuation.curve.asymptote import unbounded_message
from hbgear.continuation.curve.segment import CurvePoint
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.events.columns import unknowns
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.results.status import Status
from hbgear.continuation.tracing.ends import CurveEnds
from hbgear.continuation.tracing.resolution import ResolutionControl
from hbgear.continuation.tracing.special_points import SpecialPoints
from hbgear.continuation.tracing.state import PendingSegment, TraceState
from hbgear.continuation.tracing.stepper import Stepper

_RETRACED = "the curve ran back over itself"

STALLED_STEPS, STALLED_LENGTH = 40, 1e-2
"""A trace ends after this number of steps in succession whose sum is below this fraction of the largest step size.

After a sharp turn sizes grow within ten steps: on 50 random machines the smallest sum of 30 steps was 0.14 of the
largest step.
"""


MAX_SINGULAR_POINTS = 20
"""Points in succession at one value of the parameter after which a trace ends if half of them are branch points: they
belong to a family of solutions."""


class ContinuationLoop:
    """Traces a curve from its first point until something ends it.

    ``first_after_corner`` is the number of the first point after the last corner at which short steps made no progress.
    """

    def __init__(self, state: TraceState, special_points: SpecialPoints, resolution: ResolutionControl) -> None:
        self.state, self.special_points, self.resolution = state, special_points, resolution
        self.detector, self.ends = special_points.detector, CurveEnds(state)
        self.first_after_corner = 0

    def run(self, second: list[CurvePoint]) -> tuple[Status, str]:
        """Trace until something ends the curve; return status and message.

        ``second`` holds the second point if it is known already.
        """
        if second:
            self._append(second)
        elif self.state.setup.batch_size == 1:
            self.special_points.process_pending()
        self.resolution.adapt()
        self.state.step = self.state.setup.settings.steps.first_step
        return self._continue_to_end()

    def _continue_to_end(self) -> tuple[Status, str]:
        """Take steps until the curve ends; return status and message."""
        state, max_points = self.state, self.state.setup.settings.steps.max_points
        while True:
            if len(state.points) >= max_points:
                return Status.MAX_POINTS, f"{len(state.points)} points, {state.location_text()}"
            stalled = self._has_stalled()
            path, reason = self._over_corner() if stalled else self._step()
            if stalled and len(path) == 1:
                return Status.STEP_TOO_SMALL, f"{reason} {state.location_text()}"
            path, asymptote = self.ends.up_to_infinity(path)
            if len(path) == 1:
                if violation := self.ends.predicted_range_violation():
                    return self._end_by_range_violation(violation)
                status = Status.RETRACED if reason == _RETRACED else Status.STEP_TOO_SMALL
                message = f"{reason} {state.location_text()}; the shortest step was tried"
                special_point = self._special_point_ahead()
                if special_point is not None and special_point.event.terminal:
                    return special_point.event.termination(state.setup.name, special_point.value)
                return status, message if special_point is None else message + self._turning_text(special_point)
            ended = self._accept_points(path)
            if ended is not None:
                if state.terminal is None:
                    self.resolution.adapt(last=True)
                return ended
            if asymptote is not None:
                state.asymptote = asymptote
                return Status.UNBOUNDED, unbounded_message(state.setup.name, asymptote)
            if self._is_singular():
                return Status.ARBITRARY, f"a family of solutions, which are not isolated, lies {state.location_text()}"
            sizes = state.problem.solution_norms(unknowns(path)[1:, :-1])
            state.update_scale(state.last.X, max(state.solution_scale, float(sizes.max())))
            self.resolution.adapt()

    # ---- steps

    def _has_stalled(self) -> bool:
        """Return whether the last steps made no progress compared with the largest step size."""
        first = max(self.first_after_corner, len(self.state.points) - STALLED_STEPS)
        latest, largest = self.state.points[first:], self.state.setup.settings.steps.max_step
        return len(latest) == STALLED_STEPS and sum(point.step for point in latest) < STALLED_LENGTH * largest

    def _is_singular(self) -> bool:
        """Return whether the parameter is constant and the equations are singular along the last points.

        A curve may be vertical for a while, as motions of twice the period in contact; its equations are regular.
        """
        state = self.state
        values = [point.value for point in state.points[-MAX_SINGULAR_POINTS:]]
        if len(values) < MAX_SINGULAR_POINTS or np.ptp(values) > 1e-12 * abs(values[-1]):
            return False
        first = len(state.points) - MAX_SINGULAR_POINTS
        crossings = [n for n, event in state.located if n > first and event.event.kind == BranchPointEvent.kind]
        return 2 * len(crossings) > MAX_SINGULAR_POINTS

    def _over_corner(self) -> tuple[list[CurvePoint], str]:
        """Return the last point with a point beyond a corner that short steps only approach, or with none; see `_step`.

        Beyond the corner the count of short steps starts again.
        """
        state = self.state
        result = self._stepper().over_corner(state.last, state.scale, state.step)
        state.step, self.first_after_corner = result.step, len(state.points)
        path = [state.last, *result.points]
        return path, f"{STALLED_STEPS} steps in succession were close to the smallest size"

    def _stepper(self) -> Stepper:
        """Return the predictor and corrector of the present problem."""
        setup = self.state.setup
        steps, newton, single = setup.settings.steps, setup.settings.newton, setup.batch_size == 1
        return Stepper(self.state.equations, setup.span.bounds, steps, newton, single)

    def _step(self) -> tuple[list[CurvePoint], str]:
        """Return the last point with the next ones, or with none and the reason why the shortest step failed."""
        state, setup = self.state, self.state.setup
        steps, stepper = setup.settings.steps, self._stepper()
        recent = [state.last, *(state.resized(point) for point in state.points[-2 : -1 - steps.predictor_points : -1])]
        max_points = min(steps.max_points - len(state.points), setup.batch_size)
        while True:
            step = state.step
            points, state.step, reason, is_beyond_corner = stepper.stride(
                recent, state.scale, state.solution_scale, step, max_points
            )
            path = [recent[0], *points]
            if is_beyond_corner:
                return path, reason
            retained = self.ends.points_before_retrace(path)
            if retained < len(points):
                shorter = max(0.5 * points[retained].step, steps.min_step)
                path, reason, state.step = path[: retained + 1], _RETRACED, shorter
            if len(path) == 1 and (point := self.ends.at_range_boundary(step)):
                return [recent[0], point], ""
            if len(path) > 1 or state.step >= step or reason != _RETRACED:  # the smallest step is not shortened
                return path, reason

    def _special_point_ahead(self) -> LocatedEvent | None:
        """Continue to a special point just beyond the last point that no step passes, and return it."""
        state = self.state
        if len(state.points) < 2 or not (self.detector.passing or self.detector.terminal):
            return None
        self.special_points.process_pending()
        segment = state.segment(state.resized(state.points[-2]), state.points[-1])
        point = self.detector.ahead(segment)
        if point is None:
            return None
        state.ended_at_sharp_turn = True
        (state.terminal,) = self.special_points.with_error_estimates(segment, [point])
        state.points += [state.terminal.point]
        return state.terminal

    def _turning_text(self, point: LocatedEvent) -> str:
        """Return the description of a special point at which a curve turns sharply."""
        name = self.state.setup.name
        return f". It turns sharply at {name} = {point.point.value:.9g}, {point.event.meaning} ({point.note})"

    # ---- acceptance

    def _end_by_range_violation(self, violation: str) -> tuple[Status, str]:
        """Return status and message of a curve on which an unknown parameter leaves its range."""
        return Status.EVENT, f"{violation} beyond {self.state.location_text().removeprefix('at ')}"

    def _accept_points(self, path: list[CurvePoint]) -> tuple[Status, str] | None:
        """Accept the new points of a path, whose first point is the last one; return status and message at an end."""
        points, accepted = path[1:], 0
        for i in self._terminal_candidates(path):
            if accepted < i:
                self._append(points[accepted:i])
            ended = self._accept_point(points[i])
            if ended is not None:
                return ended
            accepted = i + 1
        if accepted < len(points):
            self._append(points[accepted:])
        return None

    def _terminal_candidates(self, path: list[CurvePoint]) -> Sequence[int]:
        """Return the numbers of new points that are accepted one by one, because the curve may end there."""
        one_by_one = self.state.setup.settings.progress or self.detector.terminal or len(path) == 2
        if one_by_one or self.state.boundary_value is not None:
            return range(len(path) - 1)
        return self.ends.terminal_candidates(path)

    def _accept_point(self, point: CurvePoint) -> tuple[Status, str] | None:
        """Accept a point; return status and message if the curve ends there."""
        state, span = self.state, self.state.setup.span
        last = state.last
        violation = self.ends.range_violation(point)
        if violation:
            return self._end_by_range_violation(violation)
        point = self.ends.fold_outside_span(last, point)
        end = span.end_at(point.value)
        if state.boundary_value is not None:
            end = state.boundary_value
        elif end is not None:
            point = self.ends.at_span_end(last, point, end)
        closed = end is None and self.ends.closes(last, point)
        if closed:
            point = self._closing_point(last)
        segment = state.segment(last, point)
        terminal = self.detector.ends(segment) if self.detector.terminal else None
        if terminal is not None:
            (terminal,) = self.special_points.with_error_estimates(segment, [terminal])
            return self._end_at(terminal)
        self._append([point])
        origin = state.setup.switched_from
        if closed and origin is not None and origin.event is not None:
            self.special_points.process_pending()
            event = LocatedEvent(origin.event, 1.0, point, True)
            (state.terminal,) = self.special_points.with_error_estimates(segment, [event])
        self.special_points.monitor.report(point)
        if end is not None:
            if end == span.end:
                return Status.REACHED_END, f"{state.setup.name} = {end:.6g} reached"
            return Status.LEFT_SPAN, f"the curve turned back to {state.setup.name} = {end:.6g}"
        return (Status.CLOSED, f"the curve closed after {len(state.points)} points") if closed else None

    def _closing_point(self, last: CurvePoint) -> CurvePoint:
        """Return the first point as the last one; a special point gets the direction in which the curve returns."""
        point = self.ends.first_in_phase()
        if self.state.setup.switched_from is None:
            return point
        return replace(point, parameter_direction=last.parameter_direction, orientation=last.orientation)

    def _end_at(self, terminal: LocatedEvent) -> tuple[Status, str]:
        """Accept the point of a terminal event; return status and message."""
        state = self.state
        if terminal.event.alone:
            self.special_points.process_pending()
            state.points += [terminal.point]
        else:
            self._append([terminal.point])
        state.terminal = terminal
        return terminal.event.termination(state.setup.name, terminal.point.value)

    def _append(self, points: list[CurvePoint]) -> None:
        """Store points, and process the pending segments once there are enough of them."""
        state, setup = self.state, self.state.setup
        segments = [PendingSegment(state.problem, state.scale)] * len(points)
        direction = state.points[-1].parameter_direction
        state.has_folded = state.has_folded or any(point.parameter_direction != direction for point in points)
        state.pending += segments  # no call, and so no Ctrl-C, comes between this statement and the next
        state.points += points
        if len(state.pending) >= setup.batch_size:
            self.special_points.process_pending()
        if state.problem.unknown_parameters:
            parameters = setup.parameters_at(points[-1].value)
            state.problem = state.problem.with_borders_at(points[-1].X, parameters, renew=True)
