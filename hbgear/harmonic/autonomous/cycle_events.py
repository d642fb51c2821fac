"""Events of limit cycles: period doublings and Neimark-Sacker points, as roots of functions of the multipliers.

PD  det(Phi + 1) = 0 without the multiplier of the arbitrary phase.
NS  the modulus of a complex pair passes one.

Their accuracy is that of the multipliers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.event import Event, LocatedEvent, locate_root
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.harmonic.bifurcations.multiplier_events import NeimarkSackerEvent, PeriodDoublingEvent

_COMPLEX = 1e-8
"""Imaginary part of a multiplier, relative to its modulus, above which it belongs to a pair."""


class _CycleEvent(Event):
    """Zero of a function of the multipliers of a limit cycle, without the one of the arbitrary phase."""

    def __init__(self) -> None:
        pass

    def function(self, multipliers: ComplexArray) -> float:
        """Return the function of the multipliers (r,)."""
        raise NotImplementedError

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        known = [point.observed["multipliers"] for point in points if "multipliers" in point.observed]
        if len(known) < len(points):
            return np.zeros((len(points), 0))
        return np.array([[self.function(mu)] for mu in known])

    def find(self, segment: Segment) -> list[LocatedEvent]:
        def test(point: CurvePoint) -> float:
            mu = point.observed.get("multipliers")
            if mu is None:
                values = {**segment.parameters, segment.name: point.value}
                mu = segment.problem.observe(point.X, True, **values)["multipliers"]
            return self.function(mu)

        if any("multipliers" not in end.observed for end in (segment.a, segment.b)):
            return []
        return [locate_root(segment, self, test)] if test(segment.a) * test(segment.b) < 0 else []

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return None


class CycleDoublingEvent(_CycleEvent):
    """Period doubling of a limit cycle."""

    kind, meaning, marker = PeriodDoublingEvent.kind, PeriodDoublingEvent.meaning, PeriodDoublingEvent.marker

    def function(self, multipliers: ComplexArray) -> float:
        """Return the product of 1 + mu, each factor at most of order one."""
        return float(np.prod((1 + multipliers) / np.maximum(np.abs(multipliers), 1.0)).real)


class CycleTorusEvent(_CycleEvent):
    """Neimark-Sacker point of a limit cycle: a pair of complex multipliers passes the unit circle."""

    kind, meaning, marker = NeimarkSackerEvent.kind, NeimarkSackerEvent.meaning, NeimarkSackerEvent.marker

    def function(self, multipliers: ComplexArray) -> float:
        """Return log|mu| of the complex pair nearest to the unit circle; nan without pairs."""
        pairs = multipliers[multipliers.imag > _COMPLEX * np.abs(multipliers)]
        sizes = np.log(np.abs(pairs))
        return float(sizes[np.argmin(np.abs(sizes))]) if len(sizes) else float("nan")
