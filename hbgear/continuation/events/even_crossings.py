"""Special points that show at no row of a curve: an event that happens twice between two of them.

Where test functions seem to touch zero (`Event.close`), along the rows and the special points that are known already,
rows are solved for between, until a change of sign shows or there is nothing more to look for.
"""

from __future__ import annotations

import bisect
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint, Points, Segment
from hbgear.continuation.events.detector import EventDetector
from hbgear.continuation.events.event import Event, LocatedEvent
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS

Place: TypeAlias = tuple[int, float]
"""Number of a piece between two rows, and share of its chord."""

Hint: TypeAlias = tuple[Event, float]
"""What may happen twice on a piece, and near which share of its chord."""

Solved: TypeAlias = Callable[[Segment, float], CurvePoint | None]
"""Solves for the row at a share of a piece, and notes with it what the problem says of it; None if there is none."""

_SAME = 0.1  # shares of a piece within which two hints are one


_TRIES = 8  # rows looked at on a piece for each event that may happen there


_AT_AN_END = 0.05  # share of a piece within which a point found on it is the special point of its kind at the end


_ON_A_ROW = 1e-6  # such a share within which it is the row at the end, where nothing was hidden


_BESIDE = 0.05  # share of the way from a special point to the next, or to a row, at which there is a row beside it


@dataclass(frozen=True)
class SampledCurve:
    """Rows of a curve and special points between them, in the order of the curve, with the place and kind of each.

    A point that is on neither side of what happens there (`Event.needs_two_sides`) is passed by two rows beside it.
    holds: its
    kind, by the number of the piece of the path between these.
    """

    rows: Points
    places: list[Place]
    kinds: list[str]
    holds: Mapping[int, str]

    @classmethod
    def through(
        cls, rows: Points, points: Mapping[Place, LocatedEvent], between: Callable[[int, float], CurvePoint | None]
    ) -> SampledCurve:
        """Rows and the special points at some places between them.

        between : solves for a row on a piece, at a share of it; None if there is none.
        """
        every = {(i, 0.0): (row, "") for i, row in enumerate(rows)}
        order, held = sorted([*every, *points]), dict[Place, str]()
        for before, place, after in zip(order, order[1:], order[2:], strict=False):
            if place in points:
                row, event = points[place].row, points[place].event
                sides = _beside(before, place, after, between) if event.needs_two_sides else {}
                every.update(sides or {place: (row, event.kind)})
                if sides:
                    held[min(sides)] = event.kind
        places = sorted(every)
        holds = {k: held[place] for k, place in enumerate(places) if place in held}
        path = Points(every[place][0] for place in places) if points else rows
        return cls(path, places, [every[place][1] for place in places], holds)

    def ends(self, k: int) -> tuple[int, float, float]:
        """The piece between two rows that piece k of the path lies on, and where it begins and ends there."""
        (piece, low), (following, high) = self.places[k : k + 2]
        return piece, low, high if following == piece else 1.0

    def hints(self, watch: EventDetector, rows: Points, scale: Array) -> dict[int, list[Hint]]:
        """Pieces of the path on which events may happen twice, as it tells, or its rows without the special points."""
        found = watch.touching(self.rows, scale)
        if self.rows is rows:
            return found
        for piece, hints in watch.touching(rows, scale).items():
            for event, s in hints:
                k = bisect.bisect(self.places, (piece, s)) - 1
                _, low, high = self.ends(k)
                share, told = (s - low) / (high - low), found.setdefault(k, [])
                if all(other is not event or abs(share - at) > _SAME for other, at in told):
                    told.append((event, share))
        return found

    def unseen(self, watch: EventDetector, rows: Points) -> dict[int, list[tuple[int, Event]]]:
        """Pieces between rows on which an event changes sign more often than is known, as the path tells.

        On each the pieces of the path on which it does so unknown, or besides what is known. Not where a change of
        sign is known whose point the path does not have on its own piece, nor one of another kind that makes it:
        more accurate equations may have put it on another.
        """
        found: dict[int, list[tuple[int, Event]]] = {}
        if self.rows is rows:
            return found
        pieces = [piece for piece, _ in self.places]
        ends = {piece for piece, kind in zip(pieces, self.kinds, strict=True) if kind in STABILITY_CHANGING_KINDS}
        for event in watch.searched:
            changes = watch.changes(event, self.rows)
            held = [k for k, kind in self.holds.items() if kind == event.kind]
            known = np.flatnonzero(watch.changes(event, rows)).tolist()
            doubtful = set(known) - {pieces[k] for k in held}
            doubtful -= ends if event.needs_two_sides else set()  # its change of number is that of the other kinds
            doubtful.update(piece for piece, kind in zip(pieces, self.kinds, strict=True) if kind == event.kind)
            fresh = [k for k in np.flatnonzero(changes).tolist() if k not in held or changes[k] > 1]
            for k in (k for k in held if not changes[k]):  # its change of sign is on a piece of the path nearby
                near = [other for other in fresh if pieces[other] == pieces[k]]
                fresh = [other for other in fresh if not near or other != min(near, key=lambda one: abs(one - k))]
            for k in fresh:
                if pieces[k] not in doubtful:
                    found.setdefault(pieces[k], []).append((k, event))
        return found


def _beside(
    before: Place, place: Place, after: Place, between: Callable[[int, float], CurvePoint | None]
) -> dict[Place, tuple[CurvePoint, str]]:
    """Two rows beside a special point that lies between two places, with theirs; none if one cannot be solved for."""
    piece, s = place
    ends = before[1], after[1] if after[0] == piece else 1.0
    sides = {s + _BESIDE * (end - s): between(piece, s + _BESIDE * (end - s)) for end in ends}
    rows = {(piece, at): (row, "") for at, row in sides.items() if row is not None}
    return rows if len(rows) == len(ends) else {}


def find_even_crossings(
    watch: EventDetector, segment: Segment, hints: Sequence[Hint], solved: Solved, path: SampledCurve, k: int
) -> list[tuple[Segment, LocatedEvent]]:
    """Special points on a piece of a path on which events seem to happen twice, if they do, each on its part of it.

    solved : solves for a row on the piece. k : number of the piece of the path.
    """
    first, kinds = min(k, 1), path.kinds[k : k + 2]
    rows = path.rows[k - first : k + 3]  # with those on either side
    places = [-1.0, 0.0, 1.0, 2.0][1 - first :][: len(rows)]
    known = len(watch.sign_changes(rows))
    for event, s in hints:
        _look(watch, segment, event, s, solved, places, rows)
    pieces = watch.sign_changes(rows)
    if len(pieces) <= known:
        return []
    out: list[tuple[Segment, LocatedEvent]] = []
    for i in pieces:
        if not 0 <= places[i] < 1:
            continue
        part, low, length = segment.part(rows[i], rows[i + 1]), places[i], places[i + 1] - places[i]
        for point in watch.find(part):
            s = low + point.s * length
            end = kinds[0] if s < _AT_AN_END else kinds[1] if s > 1 - _AT_AN_END else ""
            if point.event.kind != end and _ON_A_ROW < s < 1 - _ON_A_ROW:
                out.append((part, point))
    return out


def drop_odd_counts(points: Sequence[LocatedEvent], made_up: bool = False) -> list[LocatedEvent]:
    """Points found between rows of one sign, without those of a kind that change it an odd number of times.

    made_up : whether other points are known there, which may make up for one that changes a number
    (`Event.needs_two_sides`).
    """
    odd = {kind for kind, count in Counter(p.event.kind for p in points if p.finder is None).items() if count % 2}
    return [
        p for p in points if p.finder is not None or p.event.kind not in odd or (made_up and p.event.needs_two_sides)
    ]


def _look(
    watch: EventDetector,
    segment: Segment,
    event: Event,
    s: float,
    solved: Solved,
    places: list[float],
    rows: list[CurvePoint],
) -> None:
    """Add rows between those known of a piece, the first at s, until the event shows or seems to happen no more.

    places : on the piece, 0 and 1 its ends, of the rows; those of the rows before and behind are anything beyond.
    """
    before = np.count_nonzero(watch.changes(event, rows))
    for _ in range(_TRIES):
        if not 0 < s < 1 or s in places:
            return
        row = solved(segment, s)
        if row is None:
            return
        i = bisect.bisect(places, s)
        places.insert(i, s)
        rows.insert(i, row)
        values = watch.values(event, rows)
        near = [(piece, at) for piece, at in event.close(rows, values, segment.scale) if 0 <= places[piece] < 1]
        if not near or np.count_nonzero(watch.changes(event, rows)) > before:
            return
        piece, share = near[0]
        s = places[piece] + share * (places[piece + 1] - places[piece])
