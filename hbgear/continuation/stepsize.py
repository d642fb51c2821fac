"""Step control: how far the next point may lie."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from hbgear.common.ranges import checked, counted


@dataclass(frozen=True)
class Steps:
    """Step control, in scaled arclength (the span of the parameter is 1).

    first, longest, shortest : step lengths.
    turn : largest angle [deg] between successive tangents; steps aim at half of it.
    newton : Newton steps per point the step length aims at.
    miss : largest distance of a point from its prediction, as a share of the step: what the curve does that its last
        rows do not tell, a small loop for instance, is looked at in smaller steps. Not used with sampled corners.
    support : rows the predictor extrapolates from, at most; 1 is the tangent alone.
    ahead : rows predicted and corrected together, at most, in parameters in which the problem evaluates
        many points at once and has no corners. The rows obey the same limits as one after the other.
    max_points : rows after which the trace stops.

    Raises
    ------
    ValueError
        If lengths are not positive and in order, or a limit is out of range.
    """

    first: float = 0.01
    longest: float = 0.04
    shortest: float = 1e-7
    turn: float = 20.0
    newton: int = 3
    miss: float = 0.02
    support: int = 4
    ahead: int = 8
    max_points: int = 5000

    def __post_init__(self) -> None:
        for name in ("first", "longest", "shortest", "turn", "miss"):
            checked("Steps", name, getattr(self, name))
        for name, least in (("newton", 1), ("support", 1), ("ahead", 1), ("max_points", 2)):
            counted(f"Steps: {name}", getattr(self, name), least=least)
        if not 0 < self.shortest <= self.first <= self.longest < math.inf:
            raise ValueError(
                f"step lengths must obey 0 < shortest <= first <= longest, got {self.shortest}, {self.first}, "
                f"{self.longest}"
            )
        if not 0 < self.turn <= 60:
            raise ValueError(f"turn = {self.turn} degrees must be above 0 and at most 60")
        if not 0 < self.miss <= 1:
            raise ValueError(f"miss = {self.miss} must be above 0 and at most 1")


class Pace(NamedTuple):
    """Length of the next step, and how many rows are sought together."""

    step: float
    rows: int = 1
