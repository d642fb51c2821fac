"""Change of resolution along a curve.

A problem may require another number of unknowns from point to point (`ContinuationProblem.adapted`). The last point is
then solved at the new resolution, and the trace continues there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from hbgear.continuation.curve.segment import CurvePoint, Segment, resolve_at_resolution
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.newton import SOLVER_ERRORS
from hbgear.continuation.tracing.monitoring import Monitor
from hbgear.continuation.tracing.state import TraceState, number_of_unknowns


class ResolutionControl:
    """Adapts the resolution of the present problem and of segments with special points."""

    def __init__(self, state: TraceState, monitor: Monitor) -> None:
        self.state, self.monitor = state, monitor

    def adapt(self, last: bool = False) -> None:
        """Give the last point the resolution that it requires; not a lower one if it is the last of the curve.

        The first point keeps its value of the parameter, where the span begins, unless no solution is found there.
        """
        state = self.state
        while True:
            before = state.problem, state.scale, state.points[-1]
            adapted = state.problem.adapted(state.points[-1].observed)
            if adapted is None or (last and number_of_unknowns(adapted) < number_of_unknowns(state.problem)):
                return
            if not any(self._change(adapted, fixed_value) for fixed_value in self._fixed_values(last)):
                return
            if len(state.points[-1].u) < len(before[2].u):  # a lower resolution is kept only if it suffices
                if state.problem.adapted(state.points[-1].observed) is not None:
                    state.problem, state.scale, state.points[-1] = before
                return
            state.keep_largest(state.problem)

    def _fixed_values(self, last: bool) -> tuple[bool, ...]:
        """Return whether the last point keeps its value of the parameter, in the order in which this is tried.

        A branch that leaves another one begins at a special point, which has no unique solution.
        """
        if last:
            return (True,)
        return (True, False) if len(self.state.points) == 1 and self.state.setup.switched_from is None else (False,)

    def _change(self, problem: ContinuationProblem, fixed_value: bool) -> bool:
        """Solve the last point with another problem and continue with it; return False if that fails."""
        state = self.state
        point = self._solve_again(problem, state.points[-1], fixed_value)
        if point is None:
            return False
        state.problem, state.scale, state.points[-1] = problem, state.scale_for(problem), point
        return True

    def _solve_again(
        self, problem: ContinuationProblem, point: CurvePoint, fixed_value: bool = False
    ) -> CurvePoint | None:
        """Return a point solved with another problem and monitored; None if that fails.

        It is solved at its value of the parameter if ``fixed_value``, as an end of the curve; else in the plane normal
        to the curve.
        """
        state = self.state
        scale, newton = state.scale_for(problem), state.setup.settings.newton
        try:
            solved = resolve_at_resolution(point, state.equations._replace(problem=problem), scale, newton, fixed_value)
        except SOLVER_ERRORS:
            return None
        self.monitor.observe([solved], problem)
        return solved

    def locate_again(
        self, segment: Segment, located: list[LocatedEvent], find: Callable[[Segment], list[LocatedEvent]]
    ) -> list[LocatedEvent]:
        """Locate the special points of a segment again at the resolution that they require."""
        state = self.state
        while segment.problem.changes:
            self.monitor.observe([event.point for event in located], segment.problem)
            required = [segment.problem.adapted(event.point.observed) for event in located if event.located]
            finer = max((p for p in required if p is not None), key=number_of_unknowns, default=segment.problem)
            if number_of_unknowns(finer) <= number_of_unknowns(segment.problem):
                break
            a, b = (self._solve_again(finer, end) for end in (segment.a, segment.b))
            if a is None or b is None:
                break
            segment = replace(segment, problem=finer, a=a, b=b, scale=state.scale_for(finer))
            relocated = find(segment)
            if [point.event.kind for point in relocated] != [point.event.kind for point in located]:
                break
            located = relocated
            state.keep_largest(finer)
        return located
