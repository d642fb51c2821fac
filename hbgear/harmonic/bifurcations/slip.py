"""Event of friction: a slider begins to slip, or sticks throughout the period.

    max d - min d = 2 limit / k      over the period of the steady motion

A slider that never slips allows the displacement of its element this range. See
`hbgear.harmonic.equations.thresholds`.
"""

from __future__ import annotations

from hbgear.harmonic.bifurcations.threshold import ThresholdEvent, ThresholdProblem

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
