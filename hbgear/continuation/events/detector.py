"""Detector: the test functions of a curve, evaluated at its points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.events.event import Event, LocatedEvent
from hbgear.continuation.events.fold import CuspEvent, FoldEvent
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint


def event_of(branch: Branch, point: SpecialPoint) -> Event | None:
    """Return the event of a special point of a branch with its problem: the one that located it, or one of the problem.

    It is None for an event of the user whose branch was loaded from a file.
    """
    return event_at(as_problem(branch.problem), branch.parameter, point)


def event_at(problem: ContinuationProblem, parameter: str, point: SpecialPoint) -> Event | None:
    """Return the event of a special point of a curve of a problem; see `event_of`."""
    stored = [] if point.event is None else [point.event]
    problem_events = events_of(problem, parameter)
    return next((event for event in (*stored, *problem_events) if event.kind == point.kind), None)


def events_of(problem: ContinuationProblem, parameter: str) -> tuple[Event, ...]:
    """Return the events detected along a curve: folds (or cusps), branch points, and the events of the problem.

    An event of the problem replaces the common event of its kind.
    """
    turning = CuspEvent() if problem.turning_kind == CuspEvent.kind else FoldEvent()
    problem_events = problem.events(parameter)
    replaced = {event.kind for event in problem_events}
    return *(event for event in (turning, BranchPointEvent()) if event.kind not in replaced), *problem_events


# ---- detection


class EventDetector:
    """Detector of events of different kinds along a curve."""

    def __init__(self, events: Sequence[Event], equations: CurveEquations) -> None:
        kinds = [event.kind for event in events]
        twice = {kind for kind in kinds if kinds.count(kind) > 1}
        if twice:
            raise ValueError(f"two events have the kind {', '.join(sorted(twice))}; give each event another kind")
        self.terminal = tuple(event for event in events if event.terminal)
        self.passing = tuple(event for event in events if not event.terminal)
        self.equations = equations

    @property
    def searched(self) -> tuple[Event, ...]:
        """Events that are searched for even numbers of crossings.

        Folds of problems with a discontinuous dR/dX are not: the tangent jumps at breakpoints, so that any number of
        folds may lie next to each other.
        """
        return tuple(e for e in self.passing if self.equations.problem.smooth or not isinstance(e, FoldEvent))

    def sign_changes(self, points: Sequence[CurvePoint]) -> list[int]:
        """Return the numbers i of the segments from point i to i + 1 on which a test function changes sign."""
        changed = np.zeros(len(points) - 1, dtype=bool)
        for event in self.passing:
            changed |= self.changes(event, points) > 0
        return np.flatnonzero(changed).tolist()

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return all special points of a segment in the order of the curve.

        A curve that turns back at a branch point, as at the vertex of a pitchfork, has the branch point only.
        """
        points = sorted((point for event in self.passing for point in event.find(segment)), key=lambda point: point.s)
        crossings = [point for point in points if point.event.kind == BranchPointEvent.kind]
        return [
            point
            for point in points
            if point.event.kind != FoldEvent.kind or not any(_are_one(segment, point, other) for other in crossings)
        ]

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """Return the first special point slightly beyond a segment; see `Event.ahead`."""
        events = (*self.passing, *self.terminal)
        points = [point for event in events if (point := event.ahead(segment)) is not None]
        return min(points, key=lambda point: point.s, default=None)

    def ends(self, segment: Segment) -> LocatedEvent | None:
        """Return the first terminal event on a segment."""
        points = [point for event in self.terminal for point in event.find(segment)]
        return min(points, key=lambda point: point.s, default=None)

    def touching(self, points: Sequence[CurvePoint], scale: Array) -> dict[int, list[tuple[Event, float]]]:
        """Return candidates for even numbers of crossings: by segment, the events, each with a fraction s."""
        candidates: dict[int, list[tuple[Event, float]]] = {}
        for event in self.searched:
            for segment, s in event.near_zeros(points, self.values(event, points), scale):
                candidates.setdefault(segment, []).append((event, s))
        return candidates

    def changes(self, event: Event, points: Sequence[CurvePoint]) -> np.ndarray:
        """Return `Event.sign_changes` of points."""
        return event.sign_changes(points, self.values(event, points))

    def values(self, event: Event, points: Sequence[CurvePoint]) -> Array:
        """Return `Event.values` of points."""
        return event.values(points, self.equations)


def _are_one(segment: Segment, fold: LocatedEvent, branch_point: LocatedEvent) -> bool:
    """Return whether a fold of a segment is a branch point of it, at which the parameter has an extremum too."""
    distance = abs(fold.point.value - branch_point.point.value) / float(segment.scale[-1])
    return fold.located and branch_point.located and distance <= VERTEX_DISTANCE


VERTEX_DISTANCE = 1e-8
"""Scaled distance of a fold and a branch point of one segment in the parameter below which they are one point.

The tangent at a branch point is that of a neighbour, so that the fold has an error: 3e-9 in tests on 40 machines.
"""
