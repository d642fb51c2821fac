"""Event of friction: a slider begins to slip, or sticks throughout the period.

    max d - min d = 2 limit / k      over the period of the steady motion

A slider that never slips allows the displacement of its element this range. See
`hbgear.harmonic.equations.thresholds`.
"""

from __future__ import annotations

from hbgear.continuation.curve.segment import Segment
from hbgear.continuation.events.event import LocatedEvent
from hbgear.harmonic.bifurcations.threshold import ThresholdEvent, ThresholdProblem

SAME_SLIP_FRACTION = 1e-6
"""Fraction of a segment up to which several sliders begin to slip at the same point."""

SLIP_LOCATION_TOLERANCE = 1e-10
"""Tolerance of a first slip as a bracketed root, as a fraction of a segment of at most .1: 1e-11 in the parameter, far
below the truncation error. The margin has a kink where the number of sticking intervals changes."""


class SlipProblem(ThresholdProblem):
    """First slips (SL): the range of the displacement of a slider is that in which it sticks.

        g = max (d - limit / k) - min (d + limit / k)

    Parameters are the same as for `ThresholdProblem`; ``which`` is an index into ``problem.slider_names``.
    """

    quantity = "slip"


class SlipEvent(ThresholdEvent):
    """First slip: a friction slider begins to slip somewhere in the period, or slips no longer.

    Sliders that begin to slip at the same value of the parameter are one point.
    """

    kind, meaning, marker = "SL", "first slip: a friction slider begins to slip", "1"
    problems = (SlipProblem,)
    root_tolerance = SLIP_LOCATION_TOLERANCE

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the zeros of the margins."""
        located: list[LocatedEvent] = []
        for event in self.zeros(segment):
            if not any(abs(event.s - earlier.s) < SAME_SLIP_FRACTION for earlier in located):
                located.append(event)
        return located
