"""Events of limit cycles: period doublings and Neimark-Sacker points, as roots of functions of the multipliers.

PD  det(Phi + 1) = 0 without the multiplier of the arbitrary phase.
NS  one of the moduli in descending order, which are continuous, passes one, and the multiplier is one of a pair.

Their accuracy is that of the multipliers, which is estimated with shorter steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NoReturn, cast

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.event import BuiltInEvent, LocatedEvent, RefinedLocation, locate_root
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.harmonic.bifurcations.multiplier_events import NeimarkSackerEvent, PeriodDoublingEvent
from hbgear.harmonic.multipliers.multiplier_error import SAFETY, is_complex

_SAME_ROOT = 1e-6
"""Distance of two points, as a fraction of the segment, up to which they are one point: a pair has two moduli."""


_SHORT_STEPS = 0.3, 0.25
"""Longest steps of the variational equation, see `floquet_multipliers`, with which multipliers are compared. Their
rounding, about 1e-13, is a hundredth of that with the default steps, which are the longest of sufficient order."""


class _CycleEvent(BuiltInEvent):
    """Zero of functions of the multipliers of a limit cycle, without the one of the arbitrary phase.

    name : kind of point in messages. advice : continuation of the advice to integrate a motion beyond it.
    """

    name, advice = "", ""

    def functions(self, multipliers: ComplexArray) -> Array:
        """Return the functions (T,) of the multipliers (r,)."""
        raise NotImplementedError

    def occurs(self, multipliers: ComplexArray) -> bool:
        """Return whether a zero with these multipliers (r,) is a point of this kind."""
        return True

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        multipliers = [point.observed["multipliers"] for point in points if "multipliers" in point.observed]
        if len(multipliers) < len(points):
            return np.zeros((len(points), 0))
        return np.array([self.functions(mu) for mu in multipliers])

    def find(self, segment: Segment) -> list[LocatedEvent]:
        def multipliers(point: CurvePoint) -> ComplexArray:
            mu: ComplexArray | None = point.observed.get("multipliers")
            if mu is None:
                values = segment.parameters_at(point.value)
                mu = segment.problem.observe(point.X, True, **values)["multipliers"]
            return mu

        if any("multipliers" not in end.observed for end in (segment.a, segment.b)):
            return []

        def value(k: int, point: CurvePoint) -> float:
            return float(self.functions(multipliers(point))[k])

        before, after = (self.functions(multipliers(end)) for end in (segment.a, segment.b))
        located: list[LocatedEvent] = []
        for k in np.flatnonzero(before * after < 0).tolist():
            one = locate_root(segment, self, partial(value, k))
            is_new = all(abs(one.s - other.s) > _SAME_ROOT for other in located)
            if is_new and self.occurs(multipliers(one.point)):
                located.append(one)
        return located

    def location_error(self, segment: Segment, location: RefinedLocation) -> float:
        """Return the error of the multipliers, estimated with shorter steps, over the slope of the function of them."""
        point, problem = location.point, cast(Any, location.problem)
        parameters = segment.parameters_at(point.value)
        k = int(np.abs(self.functions(problem.multipliers(point.X, **parameters))).argmin())
        values = [
            self.functions(problem.multipliers(point.X, 6, max_step, **parameters))[k] for max_step in _SHORT_STEPS
        ]
        distances = [
            abs((end.value - point.value) / self.functions(end.observed["multipliers"])[k])
            for end in (segment.a, segment.b)
        ]
        return float(SAFETY * np.abs(values).max() * max(distances))

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> NoReturn:
        """Raise ValueError: the motions that branch off are not traced from the point."""
        raise ValueError(
            f"{point.label} is a {self.name}, from which no branch is traced; integrate a motion beyond it with "
            f"hb.time.integrate{self.advice}"
        )


class CycleDoublingEvent(_CycleEvent):
    """Period doubling of a limit cycle."""

    kind, meaning, marker = PeriodDoublingEvent.kind, PeriodDoublingEvent.meaning, PeriodDoublingEvent.marker
    name, advice = "period doubling of a limit cycle", ", and start hb.analysis.limit_cycles from it"

    def functions(self, multipliers: ComplexArray) -> Array:
        """Return the product of 1 + mu, each factor at most of order one."""
        return np.array([np.prod((1 + multipliers) / np.maximum(np.abs(multipliers), 1.0)).real])


class CycleTorusEvent(_CycleEvent):
    """Neimark-Sacker point of a limit cycle: a pair of complex multipliers passes the unit circle."""

    kind, meaning, marker = NeimarkSackerEvent.kind, NeimarkSackerEvent.meaning, NeimarkSackerEvent.marker
    name = "Neimark-Sacker point of a limit cycle"

    def functions(self, multipliers: ComplexArray) -> Array:
        """Return log|mu| in descending order."""
        return np.log(np.maximum(np.sort(np.abs(multipliers))[::-1], np.finfo(float).tiny))

    def occurs(self, multipliers: ComplexArray) -> bool:
        """Return whether the multiplier nearest to the unit circle belongs to a complex pair.

        At a fold the multiplier +1 is double, and its parts are complex by rounding; one of them has been left out.
        """
        nearest = multipliers[np.argmin(np.abs(np.log(np.maximum(np.abs(multipliers), np.finfo(float).tiny))))]
        partner = np.abs(multipliers - nearest.conjugate()).min()
        return bool(is_complex(nearest) and partner < abs(nearest.imag))
