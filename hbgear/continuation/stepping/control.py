"""Step control: how far the next point may lie."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hbgear.common.ranges import checked, counted

_FIRST = 0.01


@dataclass(frozen=True)
class StepControl:
    """Step control, in scaled arclength (the span of the parameter is 1).

    first, longest, shortest : step lengths; the first is 0.01 by default, or the nearest that the other two allow.
    max_turn_deg : largest angle [deg] between successive tangents; steps aim at half of it.
    newton : Newton steps per point the step length aims at.
    max_prediction_error : largest distance of a point from its prediction, as a share of the step: what the curve does
        that its last points do not tell, a small loop for instance, is looked at in smaller steps. Not used with
        sampled corners.
    history : points the predictor extrapolates from, at most; 1 is the tangent alone.
    max_points : points after which the trace stops.

    Raises
    ------
    ValueError
        If lengths are not positive and in order, or a limit is out of range.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> short = hb.trace(problem, "Omega", (0.8, 0.9), steps=hb.StepControl(longest=0.01))
    >>> usual = hb.trace(problem, "Omega", (0.8, 0.9))
    >>> len(short) > len(usual)
    True
    """

    first: float = None  # type: ignore[assignment]  # a number once it is made
    longest: float = 0.04
    shortest: float = 1e-7
    max_turn_deg: float = 20.0
    newton: int = 3
    max_prediction_error: float = 0.02
    history: int = 4
    max_points: int = 5000

    def __post_init__(self) -> None:
        for name in ("longest", "shortest"):
            checked("StepControl", name, getattr(self, name))
        if self.first is None:
            object.__setattr__(self, "first", min(max(_FIRST, self.shortest), self.longest))
        for name in ("first", "longest", "shortest", "max_turn_deg", "max_prediction_error"):
            checked("StepControl", name, getattr(self, name))
        for name, least in (("newton", 1), ("history", 1), ("max_points", 2)):
            counted(f"StepControl: {name}", getattr(self, name), least=least)
        if not 0 < self.shortest <= self.first <= self.longest < math.inf:
            raise ValueError(
                f"step lengths must obey 0 < shortest <= first <= longest, got {self.shortest}, {self.first}, "
                f"{self.longest}"
            )
        if not 0 < self.max_turn_deg <= 60:
            raise ValueError(f"max_turn_deg = {self.max_turn_deg} degrees must be above 0 and at most 60")
        if not 0 < self.max_prediction_error <= 1:
            raise ValueError(f"max_prediction_error = {self.max_prediction_error} must be above 0 and at most 1")


Steps = StepControl
"""The name of the first releases."""
