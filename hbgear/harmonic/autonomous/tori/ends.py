"""Ends of a branch of tori: the periodic motion at a Neimark-Sacker point, and loss of smoothness."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

from hbgear.continuation.curve.segment import Segment
from hbgear.continuation.events.event import BuiltInEvent, Event, LocatedEvent, locate_root
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.status import Status
from hbgear.harmonic.autonomous.tori.errors import end_error, is_periodic
from hbgear.harmonic.autonomous.tori.layout import SECOND

MAX_SPECTRUM_END = 3e-2
"""Outermost coefficients over the modulation above which a torus is not resolved: its spectrum does not decay."""

LOCKING_DENOMINATOR = 12
"""Largest denominator q of rotation numbers p/q that are named as the locking at which a branch ends."""

LOCKING_DISTANCE = 2e-3
"""Distance of the rotation number from p/q within which an end is named as locking."""


class TorusMergeEvent(BuiltInEvent):
    """End of a branch of tori: its modulation passes zero, and it joins the periodic motions."""

    kind, meaning, marker, terminal, alone = "EP", "end: the branch joins the one it came from", "+", True, True

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the point of a segment at which the modulation vanishes, with its error."""
        problem: Any = segment.problem
        a, b = segment.a, segment.b
        if is_periodic(problem, a.X) or is_periodic(problem, b.X):
            return []
        first = problem.modulation(a.X[:-1])
        if float(first @ problem.modulation(b.X[:-1])) >= 0:
            return []
        located = locate_root(segment, self, lambda point: float(first @ problem.modulation(point.X[:-1])))
        X, value = located.point.X, located.point.value
        error = end_error(problem, X, first, segment.name, value, segment.parameters_at(value))
        return [replace(located, error=error)]

    def termination(self, name: str, value: float) -> tuple[Status, str]:
        """Return status and message of the end."""
        return Status.MERGED, f"the torus became a periodic motion at a Neimark-Sacker point, {name} = {value:.6g}"


class _SmoothnessEvent(Event):
    """End of a branch of tori whose spectrum does not decay."""

    def termination(self, name: str, value: float) -> tuple[Status, str]:
        """Return status and message of the end."""
        return Status.EVENT, (
            f"loss of smoothness at {name} = {value:.6g}: the outermost coefficients exceed {MAX_SPECTRUM_END:g} of "
            "the modulation; more harmonics move this end, or the two frequencies lock"
        )


def smoothness_event() -> Event:
    """Return the event at which the spectrum of a torus no longer decays; the trace ends there."""

    def margin(point: Point) -> float:
        layout: Any = point.layout
        return math.log(max(layout.spectrum_end(point.X), 1e-300) / MAX_SPECTRUM_END)

    return _SmoothnessEvent("SM", margin, "end: the spectrum of the torus does not decay", "x", terminal=True)


def locking_remark(tori: Branch) -> str:
    """Return a sentence that names locking as the reason of the end of a branch, if it ended near a resonance."""
    last, name = tori[-1].parameters, tori.parameter
    turns = last[SECOND] * tori.problem.balance.nu / last["Omega"]
    resonance = Fraction(turns).limit_denominator(LOCKING_DENOMINATOR)
    failed = tori.status in (Status.STEP_TOO_SMALL, Status.EVENT)
    if not failed or abs(turns - resonance) > LOCKING_DISTANCE:
        return ""
    position = f"{turns:.5f} of the first one at {name} = {last[name]:.6g}"
    return f"the second frequency is {position}: locking at {resonance.numerator}/{resonance.denominator}"
