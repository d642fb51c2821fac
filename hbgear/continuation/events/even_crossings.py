"""Even-crossing search: special points on segments whose ends have test functions of equal signs.

A test function that crosses zero an even number of times within one segment has equal signs at both ends. Detection by
sign changes misses these events. The search finds candidate segments on which a test function comes close to zero
(`Event.near_zeros`). It computes additional points there until a sign change appears, the test function is no longer
close to zero, or `MAX_POINTS_PER_EVENT` points were added. Known special points divide their segment.
"""

from __future__ import annotations

import bisect
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.events.detector import EventDetector
from hbgear.continuation.events.event import Event, LocatedEvent
from hbgear.continuation.events.fold import FoldEvent
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS, STABILITY_TOLERANCE

Position: TypeAlias = tuple[int, float]
"""Number of a segment and fraction on it."""

Candidate: TypeAlias = tuple[Event, float]
"""Event that may happen an even number of times on a segment, and the fraction at which this is likely."""

Solved: TypeAlias = Callable[[Segment, float], CurvePoint | None]
"""Type of a function that solves for the point at a fraction of a segment and monitors it; None if it fails."""

SAME_CANDIDATE_DISTANCE = 0.1
"""Difference of fractions of a segment below which two candidates are the same."""


MAX_POINTS_PER_EVENT = 8
"""Largest number of points added on a segment for each candidate event."""


END_POINT_FRACTION = 0.05
"""Fraction of a segment next to an end within which a point is the special point of the same kind at that end."""


COINCIDENT_POINT_FRACTION = 1e-6
"""Fraction of a segment next to an end within which a point is the end itself."""


SIDE_POINT_FRACTIONS = 0.05, 0.15, 0.45
"""Distances of a point added next to a special point, relative to the distance to the next point of the curve.

The next larger one is used where a multiplier is too close to the unit circle to show on which side it is.
"""

SIDE_POINT_MARGIN = 3.0
"""Distance of multipliers from the unit circle at a point next to a special point, over that at the special point.

At the special point it is the error of the multipliers, which are less accurate than the equations of the point.
"""


@dataclass(frozen=True)
class SampledCurve:
    """Points of a curve and the special points between them, in the order of the curve.

    A special point whose own stability is undetermined (`Event.needs_two_sides`) is replaced by a point on either side.

    Attributes
    ----------
    points : list[CurvePoint]
        Points of the curve and special points.
    positions : list of (int, float)
        Position of each point: number of the segment and fraction on it.
    kinds : list of str
        Kind of each special point; empty for other points.
    replaced_kinds : mapping of int to str
        Kinds of the replaced special points, by the number of the segment between the two points on either side.
    """

    points: list[CurvePoint]
    positions: list[Position]
    kinds: list[str]
    replaced_kinds: Mapping[int, str]

    @classmethod
    def through(
        cls,
        curve_points: list[CurvePoint],
        points: Mapping[Position, LocatedEvent],
        between: Callable[[int, float], CurvePoint | None],
    ) -> SampledCurve:
        """Return the curve through points and the special points between them.

        The function ``between`` solves for the point at a fraction of a segment; it returns None if that fails.
        """
        samples = {(i, 0.0): (point, "") for i, point in enumerate(curve_points)}
        order, replaced = sorted([*samples, *points]), dict[Position, str]()
        for before, position, after in zip(order, order[1:], order[2:], strict=False):
            if position in points:
                point, event = points[position].point, points[position].event
                sides = _points_on_both_sides(before, position, after, between, point) if event.needs_two_sides else {}
                samples.update(sides or {position: (point, event.kind)})
                if sides:
                    replaced[min(sides)] = event.kind
        positions = sorted(samples)
        replaced_kinds = {k: replaced[position] for k, position in enumerate(positions) if position in replaced}
        path = [samples[position][0] for position in positions] if points else curve_points
        return cls(path, positions, [samples[position][1] for position in positions], replaced_kinds)

    def ends(self, k: int) -> tuple[int, float, float]:
        """Return the segment that contains part k of the sampled curve, and the fractions of the ends of the part."""
        (segment_number, low), (following, high) = self.positions[k : k + 2]
        return segment_number, low, high if following == segment_number else 1.0

    def near_zero_candidates(
        self, detector: EventDetector, curve_points: list[CurvePoint], scale: Array
    ) -> dict[int, list[Candidate]]:
        """Return candidates by part: from the sampled curve, and from the points without the special points."""
        by_part = detector.touching(self.points, scale)
        if self.points is curve_points:
            return by_part
        for segment_number, extra in detector.touching(curve_points, scale).items():
            for event, s in extra:
                k = bisect.bisect(self.positions, (segment_number, s)) - 1
                _, low, high = self.ends(k)
                fraction, candidates = (s - low) / (high - low), by_part.setdefault(k, [])
                if all(known is not event or abs(fraction - x) > SAME_CANDIDATE_DISTANCE for known, x in candidates):
                    candidates.append((event, fraction))
        return {k: self._without_vertices(k, candidates) for k, candidates in by_part.items()}

    def _without_vertices(self, k: int, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates of part k, without folds if the curve turns back at a branch point at one of its ends.

        The parameter has an extremum at that end, and its direction at the branch point itself is undetermined.
        """
        direction = [point.parameter_direction for point in self.points]
        inner = (i for i in (k, k + 1) if 0 < i < len(direction) - 1 and self.kinds[i] == BranchPointEvent.kind)
        if any(direction[i - 1] != direction[i + 1] for i in inner):
            return [candidate for candidate in candidates if candidate[0].kind != FoldEvent.kind]
        return candidates

    def unmatched_sign_changes(
        self, detector: EventDetector, curve_points: list[CurvePoint]
    ) -> dict[int, list[tuple[int, Event]]]:
        """Return the segments on which test functions change sign more often than the known special points explain.

        For each segment, the parts of the sampled curve with an unexplained sign change are returned, each with its
        event. A segment is left out if it has a known sign change whose special point lies on another segment, because
        more accurate equations may have moved the point there.
        """
        unmatched: dict[int, list[tuple[int, Event]]] = {}
        if self.points is curve_points:
            return unmatched
        segments = [segment_number for segment_number, _ in self.positions]
        ends = {
            segment_number
            for segment_number, kind in zip(segments, self.kinds, strict=True)
            if kind in STABILITY_CHANGING_KINDS
        }
        for event in detector.searched:
            changes = detector.changes(event, self.points)
            replaced = [k for k, kind in self.replaced_kinds.items() if kind == event.kind]
            changed = np.flatnonzero(detector.changes(event, curve_points)).tolist()
            uncertain = set(changed) - {segments[k] for k in replaced}
            uncertain -= ends if event.needs_two_sides else set()  # other kinds change its number as well
            uncertain.update(
                segment_number for segment_number, kind in zip(segments, self.kinds, strict=True) if kind == event.kind
            )
            fresh = [k for k in np.flatnonzero(changes).tolist() if k not in replaced or changes[k] > 1]
            for k in (k for k in replaced if not changes[k]):  # its sign change is on a part nearby
                nearby = [part for part in fresh if segments[part] == segments[k]]
                fresh = [part for part in fresh if not nearby or part != min(nearby, key=lambda j: abs(j - k))]
            for k in fresh:
                if segments[k] not in uncertain:
                    unmatched.setdefault(segments[k], []).append((k, event))
        return unmatched


def _points_on_both_sides(
    before: Position,
    position: Position,
    after: Position,
    between: Callable[[int, float], CurvePoint | None],
    special: CurvePoint,
) -> dict[Position, tuple[CurvePoint, str]]:
    """Return a point on either side of a special point, by position; an empty dict if one of them fails."""
    segment_number, s = position
    nearest = max(SIDE_POINT_MARGIN * _circle_distance(special, 0.0), STABILITY_TOLERANCE)
    points: dict[Position, tuple[CurvePoint, str]] = {}
    for end in (before[1], after[1] if after[0] == segment_number else 1.0):
        side_point: dict[Position, tuple[CurvePoint, str]] = {}
        for fraction in SIDE_POINT_FRACTIONS:
            point = between(segment_number, s + fraction * (end - s))
            if point is None:
                break
            side_point = {(segment_number, s + fraction * (end - s)): (point, "")}
            if _circle_distance(point, math.inf) > nearest:
                break
        if not side_point:
            return {}
        points.update(side_point)
    return points


def _circle_distance(point: CurvePoint, unknown: float) -> float:
    """Return the distance of the nearest multiplier from the unit circle; ``unknown`` without multipliers."""
    multipliers = point.observed.get("multipliers")
    if multipliers is None or np.isnan(multipliers).any():
        return unknown
    return float(np.abs(np.abs(multipliers) - 1.0).min(initial=math.inf))


def find_even_crossings(
    detector: EventDetector,
    segment: Segment,
    candidates: Sequence[Candidate],
    solved: Solved,
    path: SampledCurve,
    k: int,
) -> list[tuple[Segment, LocatedEvent]]:
    """Search part k of a sampled curve, a segment, for candidate events that happen an even number of times.

    The result holds special points, each with the segment on which it was located.
    """
    first, kinds = min(k, 1), path.kinds[k : k + 2]
    curve_points = path.points[k - first : k + 3]  # with one point on either side
    positions = [-1.0, 0.0, 1.0, 2.0][1 - first :][: len(curve_points)]
    count = len(detector.sign_changes(curve_points))
    for event, s in candidates:
        _bisect_candidate(detector, segment, event, s, solved, positions, curve_points)
    segments = detector.sign_changes(curve_points)
    if len(segments) <= count:
        return []
    out: list[tuple[Segment, LocatedEvent]] = []
    for i in segments:
        if not 0 <= positions[i] < 1:
            continue
        part, low = segment.part(curve_points[i], curve_points[i + 1]), positions[i]
        length = positions[i + 1] - low
        for point in detector.find(part):
            s = low + point.s * length
            end = kinds[0] if s < END_POINT_FRACTION else kinds[1] if s > 1 - END_POINT_FRACTION else ""
            if point.event.kind != end and COINCIDENT_POINT_FRACTION < s < 1 - COINCIDENT_POINT_FRACTION:
                out.append((part, point))
    return out


def drop_odd_counts(points: Sequence[LocatedEvent], explained: bool = False) -> list[LocatedEvent]:
    """Return special points between equal signs without the kinds that occur an odd number of times.

    With ``explained``, other special points of the segment may explain an odd number of events with
    `Event.needs_two_sides`.
    """
    odd = {kind for kind, count in Counter(p.event.kind for p in points if p.finder is None).items() if count % 2}
    return [
        p for p in points if p.finder is not None or p.event.kind not in odd or (explained and p.event.needs_two_sides)
    ]


def _bisect_candidate(
    detector: EventDetector,
    segment: Segment,
    event: Event,
    s: float,
    solved: Solved,
    positions: list[float],
    curve_points: list[CurvePoint],
) -> None:
    """Add points to a segment, the first one at s, until the event changes sign or is no longer close.

    ``positions`` contains the fraction of each point: 0 and 1 for the ends, any value outside for points beyond.
    """
    count = np.count_nonzero(detector.changes(event, curve_points))
    for _ in range(MAX_POINTS_PER_EVENT):
        if not 0 < s < 1 or s in positions:
            return
        point = solved(segment, s)
        if point is None:
            return
        i = bisect.bisect(positions, s)
        positions.insert(i, s)
        curve_points.insert(i, point)
        values = detector.values(event, curve_points)
        candidates = [
            (segment_number, location)
            for segment_number, location in event.near_zeros(curve_points, values, segment.scale)
            if 0 <= positions[segment_number] < 1
        ]
        if not candidates or np.count_nonzero(detector.changes(event, curve_points)) > count:
            return
        segment_number, fraction = candidates[0]
        s = positions[segment_number] + fraction * (positions[segment_number + 1] - positions[segment_number])
