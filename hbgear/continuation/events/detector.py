"""Detector: the test functions of a curve, evaluated at its points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.events.event import Event, LocatedEvent, column
from hbgear.continuation.events.fold import CuspEvent, FoldEvent
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint


def event_of(branch: Branch, point: SpecialPoint) -> Event | None:
    """The event a special point of the branch is one of: that it was located by; of a loaded one the problem's."""
    return event_at(as_problem(branch.problem), branch.parameter, point)


def event_at(problem: ContinuationProblem, parameter: str, point: SpecialPoint) -> Event | None:
    """`event_of` a point of a curve of the problem in the parameter."""
    known = [] if point.event is None else [point.event]
    own = events_of(problem, parameter)
    return next((event for event in (*known, *own) if event.kind == point.kind), None)


def events_of(problem: ContinuationProblem, parameter: str) -> tuple[Event, ...]:
    """Everything that is looked for along a curve of a problem: turning points, branch points, events of its own."""
    turning = CuspEvent() if problem.turning_kind == CuspEvent.kind else FoldEvent()
    return turning, BranchPointEvent(), *problem.events(parameter)


# ---- looking along a curve


class EventDetector:
    """The events that are looked for along a curve, and the rows between which they happen."""

    def __init__(
        self, events: Sequence[Event], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> None:
        kinds = [event.kind for event in events]
        twice = {kind for kind in kinds if kinds.count(kind) > 1}
        if twice:
            raise ValueError(f"two events are called {', '.join(sorted(twice))}; give each kind a name of its own")
        self.terminal = tuple(event for event in events if event.terminal)
        self.passing = tuple(event for event in events if not event.terminal)
        self.problem, self.name, self.fixed = problem, name, fixed

    @property
    def searched(self) -> tuple[Event, ...]:
        """Events that are looked for where they show at no row; not folds of sampled corners.

        Their tangents jump, so that next to each fold the curve turns any number of times.
        """
        return tuple(e for e in self.passing if self.problem.smooth or not isinstance(e, FoldEvent))

    def sign_changes(self, rows: Sequence[CurvePoint]) -> list[int]:
        """Numbers i of the pieces from rows[i] to rows[i + 1] on which `find` finds something."""
        some = np.zeros(len(rows) - 1, dtype=bool)
        for event in self.passing:
            some |= self.changes(event, rows) > 0
        suspects: list[int] = np.flatnonzero(some).tolist()
        return suspects

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """All special points between the two rows of a segment, in the order in which the curve meets them."""
        return sorted((found for event in self.passing for found in event.find(segment)), key=lambda found: found.s)

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """The first special point a little beyond a segment, of the events that can tell."""
        found = [one for event in self.passing if (one := event.ahead(segment)) is not None]
        return min(found, key=lambda one: one.s, default=None)

    def ends(self, segment: Segment) -> LocatedEvent | None:
        """The first terminal event on a segment."""
        found = [one for event in self.terminal for one in event.find(segment)]
        return min(found, key=lambda one: one.s, default=None)

    def touching(self, rows: Sequence[CurvePoint], scale: Array) -> dict[int, list[tuple[Event, float]]]:
        """Pieces between rows on which an event may happen twice; which event, and the place s on each."""
        found: dict[int, list[tuple[Event, float]]] = {}
        for event in self.searched:
            for piece, s in event.close(rows, self.values(event, rows), scale):
                found.setdefault(piece, []).append((event, s))
        return found

    def changes(self, event: Event, rows: Sequence[CurvePoint]) -> np.ndarray:
        """`Event.sign_changes` of rows, kept with them."""
        changes: np.ndarray = column(
            rows, (event, "changes"), lambda: event.sign_changes(rows, self.values(event, rows))
        )
        return changes

    def values(self, event: Event, rows: Sequence[CurvePoint]) -> Array:
        """`Event.values` of rows, kept with them."""
        values: Array = column(rows, event, lambda: event.values(rows, self.problem, self.name, self.fixed))
        return values
