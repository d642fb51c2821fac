"""Event of friction: a slider begins to slip, or sticks throughout the period.

    max d - min d = 2 limit / k      over the period of the steady motion

A slider that never slips allows the displacement of its element this range. See
`hbgear.harmonic.equations.thresholds`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.event import Event, LocatedEvent
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.harmonic.bifurcations.threshold import ThresholdProblem, locate_threshold

SAME_SLIP_FRACTION = 1e-6
"""Fraction of a segment up to which several sliders begin to slip at the same point."""

SLIP_LOCATION_TOLERANCE = 1e-10
"""Tolerance of a first slip as a bracketed root, as a fraction of a segment of at most .1: 1e-11 in the parameter, far
below the truncation error. The margin has a kink where the number of sticking intervals changes."""

CORNER_MARGIN = 1e-9
"""Margin of a slider, relative to the motion, up to which a fold lies at its first slip, a corner of the curve; such
folds are located to 1e-13 of a segment."""


class SlipProblem(ThresholdProblem):  # numpydoc ignore=PR02
    """First slips (SL): the range of the displacement of a slider is that in which it sticks.

        g = max (d - limit / k) - min (d + limit / k)

    Parameters
    ----------
    problem : HarmonicBalance or BackboneProblem
        The problem of the curve.
    parameter : str, optional
        The parameter of the curve, such as "Omega".
    which : int, optional
        Index into ``problem.slider_names``. The default is 0.
    """

    def threshold(self, X: Array, which: int, here: Mapping[str, float]) -> tuple[float, Array]:
        """Return the margin of a slider and its derivative; see `ThresholdProblem.threshold`."""
        out: tuple[float, Array] = self.problem.slip_threshold(X, which, **here)
        return out

    def distances(self, X: Array, here: Mapping[str, float]) -> Array:
        """Return the margins of all sliders."""
        out: Array = self.problem.slip_margins(X, **here)
        return out


class SlipEvent(Event):
    """First slip: a friction slider begins to slip somewhere in the period, or slips no longer.

    Sliders that begin to slip at the same value of the parameter are one point.
    """

    kind, meaning, marker = "SL", "first slip: a friction slider begins to slip", "1"

    def __init__(self) -> None:
        pass

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Return the margins of the sliders, positive where they slip; nan where they are unknown."""
        known = [point.observed.get("slip") for point in points]
        example = next((one for one in known if one is not None), np.empty(0))
        return np.array([np.full_like(example, np.nan) if one is None else one for one in known])

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the zeros of the margins."""
        ends = [point.observed.get("slip") for point in (segment.a, segment.b)]
        if ends[0] is None or ends[1] is None:
            return []
        problem: Any = segment.problem
        located: list[LocatedEvent] = []
        for i in np.flatnonzero(ends[0] * ends[1] < 0).tolist():
            extended, first = SlipProblem(problem, segment.name, i), float(ends[0][i] / (ends[0][i] - ends[1][i]))
            event = locate_threshold(
                segment, self, extended, "slip", first, problem.slider_names[i], SLIP_LOCATION_TOLERANCE
            )
            if not any(abs(event.s - other.s) < SAME_SLIP_FRACTION for other in located):
                located.append(event)
        return located

    def corner(
        self, problem: Any, parameter: str, X: Array, parameters: Mapping[str, float]
    ) -> MinimallyAugmentedProblem | None:
        """Return the equations of a slider that begins to slip at a motion, else None; see `Event.corner`."""
        margins = np.abs(problem.slip_margins(X, **parameters))
        if not margins.size or margins.min() > CORNER_MARGIN * (1.0 + norm(X)):
            return None
        return SlipProblem(problem, parameter, int(np.argmin(margins)))

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        names = list(problem.slider_names)
        return SlipProblem(problem, parameter, names.index(point.note)) if point.note in names else None
