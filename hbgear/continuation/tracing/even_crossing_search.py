"""Search of a traced curve for test functions that cross zero an even number of times within one segment.

Such crossings leave no change of sign at the ends of the segment. The search evaluates test functions at additional
points (`even_crossings`). A point found in this way divides its segment, so that the next crossings may show on the
parts or on the neighbouring segments: the search is repeated there, `MAX_SEARCH_ROUNDS` times at most.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

from hbgear.continuation.curve.segment import CurvePoint, Segment, are_equal, has_corner
from hbgear.continuation.events.accuracy import estimate_error
from hbgear.continuation.events.detector import EventDetector
from hbgear.continuation.events.even_crossings import SampledCurve, drop_odd_counts, find_even_crossings
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS
from hbgear.continuation.tracing.monitoring import SPURIOUS_POINT_ERROR, Monitor
from hbgear.continuation.tracing.state import TraceState

MAX_SEARCH_ROUNDS = 4
"""Number of times that the parts of a segment are searched."""


@dataclass(frozen=True)
class _Section:
    """Successive points of a curve, the number of the first of them, and the special points known between them.

    ``events`` holds the special points of each segment by the number of the point after it.
    """

    points: list[CurvePoint]
    first: int
    events: dict[int, list[LocatedEvent]]

    def number(self, segment: int) -> int:
        """Return the number of the point after a segment."""
        return self.first + segment + 1


class EvenCrossingSearch:
    """Finds special points between points at which test functions have equal signs."""

    def __init__(self, state: TraceState, monitor: Monitor, detector: EventDetector) -> None:
        self.state, self.monitor, self.detector = state, monitor, detector

    def search(self, points: list[CurvePoint], first: int, located: dict[int, list[LocatedEvent]]) -> None:
        """Search the segments between points, of which the first has the number ``first``.

        ``located`` holds the special points of each segment by the number of the point after it. Segments with further
        special points are replaced in it.
        """
        if len({len(point.u) for point in points}) > 1:
            return
        events = {**located}
        for number, event in self.state.located:
            if number > first and number not in located:
                events[number] = [*events.get(number, []), event]
        section = _Section(points, first, events)
        segments: Sequence[int] = range(len(points) - 1)

        @cache  # successive rounds need the same points
        def between(segment: int, s: float) -> CurvePoint | None:
            return self.monitor.solve_on_segment(self.state.segment(points[segment], points[segment + 1]), s)

        for _ in range(MAX_SEARCH_ROUNDS):
            fresh = self._search_round(section, segments, between)
            located.update(fresh)
            events.update(fresh)
            segments = sorted({number - first - 1 + offset for number in fresh for offset in (-1, 0, 1)})
            if not segments:
                break

    def _search_round(
        self, section: _Section, segments: Sequence[int], between: Callable[[int, float], CurvePoint | None]
    ) -> dict[int, list[LocatedEvent]]:
        """Return all special points of the segments with more special points than are known.

        ``between`` computes a point at a fraction of a segment; see `SampledCurve.through`.
        """
        state, first = self.state, section.first
        events = {
            (number - first - 1, event.s): event
            for number, group in section.events.items()
            for event in group
            if event.located and 0 < event.s < 1 and len(event.point.u) == len(state.scale)
        }
        self.monitor.observe([event.point for event in events.values()])
        path = SampledCurve.through(section.points, events, between)
        result: dict[int, list[LocatedEvent]] = {}
        self._add_unmatched_sign_changes(section, segments, path, result)
        self._add_even_crossings(section, segments, path, result)
        return result

    def _add_unmatched_sign_changes(
        self, section: _Section, segments: Sequence[int], path: SampledCurve, result: dict[int, list[LocatedEvent]]
    ) -> None:
        """Add the special points of sign changes of test functions that the known special points do not explain."""
        state, points = self.state, section.points
        for segment, changes in path.unmatched_sign_changes(self.detector, points).items():
            if segment not in segments:
                continue
            segments_with_event = [(state.segment(*path.points[k : k + 2]), event) for k, event in changes]
            number = section.number(segment)
            known_events = section.events.get(number, [])
            candidates = [
                (part, point)
                for part, event in segments_with_event
                for point in event.find(part)
                if point.located and not any(_coincide(point, known) for known in known_events)
            ]
            confirmed = self._confirmed(candidates, state.segment(points[segment], points[segment + 1]))
            fresh = drop_odd_counts(
                confirmed, explained=any(known.event.kind in STABILITY_CHANGING_KINDS for known in known_events)
            )
            if fresh:
                result[number] = sorted([*known_events, *fresh], key=lambda point: point.s)

    def _add_even_crossings(
        self, section: _Section, segments: Sequence[int], path: SampledCurve, result: dict[int, list[LocatedEvent]]
    ) -> None:
        """Add the special points found by additional points where test functions come close to zero."""
        state, points = self.state, section.points
        for k, near_zeros in path.near_zero_candidates(self.detector, points, state.scale).items():
            segment, low, high = path.ends(k)
            if segment not in segments:
                continue
            part = state.segment(*path.points[k : k + 2])
            if has_corner(part):  # test functions of multipliers jump there
                continue
            candidates = find_even_crossings(self.detector, part, near_zeros, self.monitor.solve_on_segment, path, k)
            number, full_segment = section.number(segment), state.segment(points[segment], points[segment + 1])
            known_events = result.get(number, section.events.get(number, []))
            outside = [point for point in known_events if not low < point.s < high]
            fresh = self._confirmed(candidates, full_segment)
            fresh = fresh if len(outside) < len(known_events) or any(path.kinds[k : k + 2]) else drop_odd_counts(fresh)
            if len(fresh) > len(known_events) - len(outside):
                result[number] = sorted(outside + fresh, key=lambda point: point.s)

    def _confirmed(self, candidates: Sequence[tuple[Segment, LocatedEvent]], segment: Segment) -> list[LocatedEvent]:
        """Return the candidates that exist at a higher resolution, with their fractions of the whole segment.

        If one point of a pair exists, so does the other, although it may be too far away to be located.
        """
        assessed = [self._assess(part, point) for part, point in candidates]
        kinds = Counter(event.event.kind for event, _ in assessed)
        existing = Counter(event.event.kind for event, exists in assessed if exists)
        paired = {kind for kind, count in existing.items() if count % 2 and not kinds[kind] % 2}
        return [
            replace(event, s=segment.fraction_of(event.point.u))
            for event, exists in assessed
            if exists or event.event.kind in paired
        ]

    def _assess(self, part: Segment, point: LocatedEvent) -> tuple[LocatedEvent, bool]:
        """Return a candidate with its error, and whether it exists at a higher resolution."""
        setup = self.state.setup
        accuracy, work = setup.settings.accuracy, setup.work
        if accuracy is None:
            return point, True
        refused = work.refused
        assessed = estimate_error(part, point, accuracy, work)
        refined = assessed.refined is not None or work.refused > refused  # a refusal is no evidence against a point
        limit = max(accuracy, SPURIOUS_POINT_ERROR) if refined else accuracy
        return assessed, not assessed.error > limit * part.problem.unit_of(setup.name, assessed.point.value)


def _coincide(a: LocatedEvent, b: LocatedEvent) -> bool:
    """Return whether two points of one kind on a segment are the same point at the resolution of the curve.

    Two multipliers that cross the limit simultaneously do so once. The equations are singular there and determine few
    digits, so that points found with an event of another kind are the same.
    """
    simultaneous = a.finder is not None and b.finder is not None
    return a.event.kind == b.event.kind and (simultaneous or are_equal(a.point.u, b.point.u))
