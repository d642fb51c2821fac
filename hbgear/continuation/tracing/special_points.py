"""Special points of a curve: pending segments are monitored, searched for events, verified and completed.

New segments wait until enough of them have come together to be monitored at once. Then

1. the monitored quantities and the stability of their points are computed (`monitoring`),
2. sign changes of the test functions are located, with error estimates,
3. segments without a sign change are searched for even numbers of crossings (`even_crossing_search`),
4. stability that contradicts the special points is verified again, and step 2 repeated,
5. a point is inserted between neighbouring special points of one segment, to sample the stability there.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise

from hbgear.continuation.curve.builder import SpecialPointMark
from hbgear.continuation.curve.segment import CurvePoint, Segment, are_equal
from hbgear.continuation.events.accuracy import estimate_error
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.events.detector import EventDetector
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS
from hbgear.continuation.tracing.even_crossing_search import EvenCrossingSearch
from hbgear.continuation.tracing.monitoring import SPURIOUS_POINT_ERROR, Monitor, UnderResolvedError
from hbgear.continuation.tracing.resolution import ResolutionControl
from hbgear.continuation.tracing.state import TraceState

INTERRUPT_GRACE_SECONDS = 0.3
"""Time [s] for which pending segments are still searched after Ctrl-C."""

MAX_SEGMENT_SHIFT = 64
"""Largest number of segments, some of them short, between a special point and the segment on which it was found."""


class SpecialPoints:
    """Locates the special points of pending segments."""

    def __init__(
        self, state: TraceState, monitor: Monitor, resolution: ResolutionControl, detector: EventDetector
    ) -> None:
        self.state, self.monitor, self.resolution, self.detector = state, monitor, resolution, detector
        self._even_crossings = EvenCrossingSearch(state, monitor, detector)

    # ---- pending segments

    def process_pending(self) -> None:
        """Monitor the points of the pending segments and locate the special points between them."""
        state = self.state
        start = len(state.points) - len(state.pending) - 1
        path = state.points[start:]
        self.monitor.observe(path)
        self.monitor.report_if_slow("verification of the stability")
        self.monitor.verify_stability(path)
        self.monitor.report_if_slow("search for special points")
        located = self._search(start)
        if self.monitor.resolve_contradictions(start, located):
            located = self._search(start)
        if state.setup.batch_size == 1:  # the problem may be another one at the next point
            fresh = [event.point for events in located.values() for event in events]
            self.monitor.observe(state.at_present_resolution(fresh))
        self._insert_stability_samples(located)
        unchanged = [entry for entry in state.located if entry[0] not in located]
        state.pending, state.located = [], unchanged + [(i, event) for i, events in located.items() for event in events]

    def flush_pending(self) -> None:
        """Process the pending segments at the end of a trace.

        After Ctrl-C they are processed one by one, for `INTERRUPT_GRACE_SECONDS` at most, because the search of one
        segment can take minutes. Points that are dropped are computed again when the branch is extended.
        """
        state = self.state
        if not isinstance(state.termination.error, KeyboardInterrupt):
            self.process_pending()
            return
        processed = len(state.points) - len(state.pending)
        unprocessed = list(zip(state.points[processed:], state.pending, strict=True))
        del state.points[processed:]
        state.pending = []
        self.process_pending()
        end = time.monotonic() + (INTERRUPT_GRACE_SECONDS if state.setup.batch_size > 1 else 0.0)
        for point, segment in unprocessed:
            if time.monotonic() >= end:
                break
            state.points.append(point)
            state.pending = [segment]
            self.process_pending()

    def complete(self) -> None:
        """Compute the monitored quantities that are still missing: of special points, and of unprocessed points."""
        self.monitor.observe(self.state.points)
        self.monitor.observe([event.point for _, event in self.state.located])
        for _, event in self.state.located:
            if event.refined is not None:
                self.monitor.observe([event.refined.point], event.refined.problem)

    # ---- search

    def _search(self, start: int) -> dict[int, list[LocatedEvent]]:
        """Return the special points of the pending segments after point ``start``, by the number of the point after."""
        state, setup = self.state, self.state.setup
        located: dict[int, list[LocatedEvent]] = {}
        if self.detector.passing and state.pending:
            before = max(start - 2, 0)  # two points on either side of each segment: test functions are curved
            points = state.points[before:]
            for i in self.detector.sign_changes(points):
                number = i + 1 + before
                if number > start:
                    problem, scale = state.pending[number - start - 1]
                    newton = setup.settings.newton
                    segment = Segment(problem, setup.name, setup.fixed, points[i], points[i + 1], scale, newton)
                    located[number] = self._locate(segment)
            self._even_crossings.search(points, before, located)
        return located

    def _locate(self, segment: Segment) -> list[LocatedEvent]:
        """Return the special points of a segment; none if an error ends the search, which is recorded."""
        try:
            located = self.resolution.locate_again(segment, self.detector.find(segment), self.detector.find)
            return self.with_error_estimates(segment, located)
        except Exception as error:
            ends = f"{self.state.setup.name} = {segment.a.value:.6g} and {segment.b.value:.6g}"
            self.state.termination.record_error(error, f"in locating a special point between {ends}")
            return []

    def with_error_estimates(self, segment: Segment, located: list[LocatedEvent]) -> list[LocatedEvent]:
        """Return the special points of a segment with their errors, refined to the target accuracy."""
        setup = self.state.setup
        if setup.settings.accuracy is None:
            return located
        out = [estimate_error(segment, point, setup.settings.accuracy, setup.work) for point in located]
        if setup.abort_if_under_resolved and segment.problem.smooth:
            self._check_existence(segment, out)
        return out

    def _check_existence(self, segment: Segment, located: list[LocatedEvent]) -> None:
        """Raise `UnderResolvedError` if a special point does not exist nearby at a higher resolution."""
        name = self.state.setup.name
        for point in located:
            limit = SPURIOUS_POINT_ERROR * segment.problem.unit_of(name, point.value)
            if point.error > limit and self.monitor.can_refine():
                location = f"{name} = {point.value:.6g}"
                finding = f"it is uncertain whether the {point.event.kind} near {location} exists"
                raise UnderResolvedError(self.state.problem, finding)

    # ---- insertion

    def _insert_stability_samples(self, located: Mapping[int, list[LocatedEvent]]) -> None:
        """Compute a point between neighbouring special points of a segment at which stability may change.

        No other point samples the stability there.
        """
        state = self.state
        for number, points in located.items() if state.setup.settings.stability else ():
            ends = [
                event
                for event in sorted(points, key=lambda event: event.s)
                if event.event.kind in STABILITY_CHANGING_KINDS
                and event.located
                and 0 < event.s < 1
                and len(event.point.u) == len(state.scale)
            ]
            solve = partial(self.monitor.solve_on_segment, s=0.5, errors=True)
            samples = [(0.5 * (a.s + b.s), solve(state.segment(a.point, b.point))) for a, b in pairwise(ends)]
            state.samples[number] = [(s, point) for s, point in samples if point is not None]
            self.monitor.verify_stability([point for _, point in state.samples[number]])


# ---- results


def points_and_marks(state: TraceState) -> tuple[list[CurvePoint], list[SpecialPointMark]]:
    """Return all points, with the located special points among them, and the marks of the special points."""
    points: list[CurvePoint] = []
    marks: list[SpecialPointMark] = []
    inserted: list[tuple[int, float, LocatedEvent | CurvePoint]] = [
        (i, point.s, point) for i, point in (_on_its_segment(state, *entry) for entry in _deduplicated(state.located))
    ]
    inserted += [(i, s, point) for i, samples in state.samples.items() for s, point in samples]
    inserted.sort(key=lambda entry: entry[:2])
    for i, point in enumerate(state.points):
        while inserted and inserted[0][0] == i:
            _insert(inserted.pop(0)[2], (state.points[i - 1].value, point.value), points, marks)
        is_special = bool(marks) and marks[-1].index == len(points) - 1 and marks[-1].special.located
        if is_special and i < len(state.points) - 1 and _coincide(points[-1], point):
            continue
        points.append(point)
    if state.terminal is not None and state.points[-1].u is state.terminal.point.u:
        interval = (state.points[-2].value, state.points[-1].value)
        marks.append(SpecialPointMark(len(points) - 1, state.terminal, interval))
    return points, marks


def _insert(
    addition: LocatedEvent | CurvePoint,
    interval: tuple[float, float],
    points: list[CurvePoint],
    marks: list[SpecialPointMark],
) -> None:
    """Append a point between two points of a curve, or a special point and its mark."""
    if isinstance(addition, CurvePoint):
        points.append(addition)
        return
    if addition.located:
        if _coincides_with_last(addition.point, points, marks):
            points.pop()
        points.append(addition.point)
    marks.append(SpecialPointMark(len(points) - 1, addition, interval))


COINCIDENT_POINT_DISTANCE = 1e-9
"""Distance of a special point from a point of the curve, relative to its norm, below which only the former is kept.

It is the accuracy of the corrector. Two points so close determine no direction of the curve between them.
"""


def _coincide(a: CurvePoint, b: CurvePoint) -> bool:
    """Return whether two points are equal up to the accuracy of the corrector."""
    return len(a.u) == len(b.u) and norm(a.u - b.u) <= COINCIDENT_POINT_DISTANCE * norm(a.u)


def _coincides_with_last(point: CurvePoint, points: list[CurvePoint], marks: list[SpecialPointMark]) -> bool:
    """Return whether a special point coincides with the last point, if this is a regular point after the first one."""
    last = len(points) - 1
    return last > 0 and not (marks and marks[-1].index == last) and _coincide(point, points[last])


def _deduplicated(located: list[tuple[int, LocatedEvent]]) -> list[tuple[int, LocatedEvent]]:
    """Return the special points; of those that coincide at a higher resolution, only the one that moves least."""
    out: list[tuple[int, LocatedEvent]] = []
    for number, point in located:
        duplicate = next((i for i, (_, kept) in enumerate(out) if _are_same(point, kept)), None)
        if duplicate is None:
            out.append((number, point))
        elif _rank(point) < _rank(out[duplicate][1]):
            out[duplicate] = number, point
    return out


def _on_its_segment(state: TraceState, number: int, event: LocatedEvent) -> tuple[int, LocatedEvent]:
    """Return a special point with the number and the fraction of the segment that it lies on.

    Its equations may move it beyond the ends of the segment on which it was found.
    """
    for _ in range(MAX_SEGMENT_SHIFT):
        neighbour = number + (event.s > 1) - (event.s < 0)
        if neighbour == number or not 0 < neighbour < len(state.points):
            break
        a, b = state.points[neighbour - 1 : neighbour + 1]
        if not len(a.u) == len(b.u) == len(event.point.u) == len(state.scale):
            break
        segment = state.segment(a, b)
        s, current = segment.fraction_of(event.point.u), state.segment(*state.points[number - 1 : number + 1])
        beyond_both = (s - 0.5) * (event.s - 0.5) < 0  # the point lies beyond the adjacent ends of both segments
        if not beyond_both or _excess(s) * segment.length < _excess(event.s) * current.length:
            number, event = neighbour, replace(event, s=s)
        if beyond_both:
            break
    return number, event


def _excess(s: float) -> float:
    """Return the distance of a fraction s from [0, 1], negative inside."""
    return max(-s, s - 1.0)


def _are_same(a: LocatedEvent, b: LocatedEvent) -> bool:
    """Return whether two special points coincide at the resolution at which they are known.

    Newton's method ends at one point more than once where multipliers change so fast that their test function changes
    sign several times. Two branch points that coincide are different points: there the curve crosses itself.
    """
    if (a.event.kind, a.note) != (b.event.kind, b.note) or a.event.kind == BranchPointEvent.kind:
        return False
    u, v = ((event.refined or event).point.u for event in (a, b))
    return are_equal(u, v)


def _rank(event: LocatedEvent) -> tuple[bool, float]:
    """Return the order of coinciding special points: located ones first, then by the shift of their refinement."""
    return not event.located, abs(event.refined.point.value - event.point.value) if event.refined else 0.0
