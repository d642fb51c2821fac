"""Resonances on curves of Neimark-Sacker points: 1:3, 1:4, and the ends at 1:1 and 1:2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.level import ScalarConditionProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import SEARCH_ERRORS
from hbgear.harmonic.bifurcations.codimension_two.event import CodimensionTwoEvent
from hbgear.harmonic.bifurcations.codimension_two.resonances import FirstResonanceEvent, ResonanceEvent


class AngleEvent(CodimensionTwoEvent):
    """Strong resonance on a curve of Neimark-Sacker points: cos theta passes a value.

    The exponent at a point starts at that of the point before, because another pair may be nearer to the unit circle.
    """

    cosine: float

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        exponent = None
        for point in points:
            if EXPONENT not in point.observed:
                point.observed[EXPONENT] = exponent_at(equations, point, exponent)
            exponent = point.observed[EXPONENT]
        return np.array([[self._value(equations, point)] for point in points])

    def _value(self, equations: CurveEquations, point: CurvePoint) -> float:
        """Return cos theta minus its value at the resonance; nan where the pair is real."""
        s = point.observed.get(EXPONENT) or exponent_at(equations, point, None)
        return math.nan if s is None else cosine_of_pair(equations, point, s) - self.cosine


EXPONENT = "Neimark-Sacker exponent"
"""Name under which points of a curve store the exponent of the pair."""


def exponent_at(equations: CurveEquations, point: CurvePoint, near: complex | None) -> complex | None:
    """Return the exponent of the pair at a point of a curve of Neimark-Sacker points; None if the pair is real.

    ``near`` is the exponent of a neighbouring point; None for that of the equations.
    """
    X, parameters = equations.solution_at(point.u)
    problem = equations.problem
    problem = problem if near is None else type(problem)(problem.problem, problem.parameter, near)
    try:
        return problem.exponent(X, **parameters)
    except SEARCH_ERRORS:
        return None


def angle_of_pair(equations: CurveEquations, point: CurvePoint, s: complex) -> float:
    """Return the angle [rad] of the multipliers with the exponent s, up to whole turns."""
    return float(2 * math.pi * equations.problem.problem.nu * s.imag / equations.solution_at(point.u)[1]["Omega"])


def cosine_of_pair(equations: CurveEquations, point: CurvePoint, s: complex) -> float:
    """Return (mu + 1 / mu) / 2 of the multiplier mu with the exponent s; beyond -1 and 1 it is real."""
    Omega = equations.solution_at(point.u)[1]["Omega"]
    return float(np.cosh(2 * math.pi * equations.problem.problem.nu * s / Omega).real)


class ThirdResonanceEvent(AngleEvent):
    """1:3 resonance: multipliers exp(+-2 pi i / 3)."""

    kind, meaning, marker, cosine = "RIII", "1:3 resonance: the multipliers are third roots of unity", "<", -0.5


class FourthResonanceEvent(AngleEvent):
    """1:4 resonance: multipliers i and -i."""

    kind, meaning, marker, cosine = "RIV", "1:4 resonance: the multipliers are i and -i", "d", 0.0


class EndEvent(CodimensionTwoEvent):
    """End of a curve of Neimark-Sacker points, where the pair becomes real: the resonance 1:1 or 1:2.

    Parameters
    ----------
    on : FirstResonanceEvent or SecondResonanceEvent
        The same point on a curve of folds or period doublings.
    equations : type
        Equations of this curve: `FoldProblem` or `PeriodDoublingProblem`.
    """

    terminal = True
    other: type[FoldProblem]

    def __init__(self, on: type[ResonanceEvent], equations: type[FoldProblem]) -> None:
        self.kind, self.meaning, self.marker = on.kind, on.meaning, on.marker
        self.on, self.other = on, equations

    def termination(self, name: str, value: float) -> tuple[Status, str]:
        return Status.EVENT, f"the curve of Neimark-Sacker points ends at a {self.meaning} at {name} = {value:.9g}"


class PassedEndEvent(EndEvent, AngleEvent):
    """End of a curve of Neimark-Sacker points from multipliers, whose equations are regular there."""

    @property
    def cosine(self) -> float:  # type: ignore[override]
        """Cosine of the angle of the pair."""
        return float(self.on.multiplier)


class RealPairProblem(ScalarConditionProblem):
    """Equations of the resonance at the end of a curve of Neimark-Sacker points, on a curve of codimension one.

    Parameters
    ----------
    problem : NeimarkSackerProblem
        Equations of the Neimark-Sacker points, which are singular there.
    parameter : str
        Parameter of their curve.
    end : RealPairEvent
        The end.
    """

    argument_names = ("end",)

    def __init__(self, problem: Any, parameter: str, end: RealPairEvent) -> None:
        curve = end.other(problem.problem, problem.parameter)
        super().__init__(curve, parameter, lambda point: end.on.function(curve, point.X, dict(point.parameters)))
        self._fixed(end=end)


class RealPairEvent(EndEvent):
    """End of a curve of Neimark-Sacker points from Hill's determinant, whose equations are singular there.

    theta^2, or (pi - theta)^2, falls linearly to zero. The point is located on the curve of folds or period doublings
    that passes there.
    """

    regular_at_corners = True  # the curve of folds or period doublings does not end there

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return the resonance that a step has passed: the pair is real on a part of the segment, not at its ends."""

        def square(s: float) -> float:
            return self._angle(segment, replace(segment.a, u=segment.guess(s), observed={})) ** 2

        ends = square(0.0), square(1.0)
        if min(ends) > MAX_PASSED_ANGLE**2:
            return []
        falls = [end - square(s) for end, s in zip(ends, (SLOPE_FRACTION, 1.0 - SLOPE_FRACTION), strict=True)]
        if min(falls) <= 0:
            return []
        first, last = (SLOPE_FRACTION * end / fall for end, fall in zip(ends, falls, strict=True))
        gap = 1.0 - first - last  # at one point of it a pair of a symmetric motion may pass -1 and stay complex
        if gap <= 0 or any(square(first + part * gap) > 0 for part in (1 / 3, 2 / 3)):
            return []
        found = self._near(segment, segment.guess(first))
        return [found] if found is not None and 0 <= found.s <= 1 else []

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """Return the resonance slightly beyond the last segment."""
        before, after = (self._angle(segment, end) ** 2 for end in (segment.a, segment.b))
        if not (after < before and after < MAX_END_ANGLE**2):
            return None
        s = before / (before - after)
        return self._near(segment, segment.a.u + s * (segment.b.u - segment.a.u))

    def _near(self, segment: Segment, u: Array) -> LocatedEvent | None:
        """Return the resonance near unknowns u; None if Newton's method finds no such point."""
        equations = self.equations(segment.problem, segment.name, None)
        try:
            solution = equations.located(u, segment.parameters_at(float(u[-1])))
        except SEARCH_ERRORS:
            return None
        root = solution.X
        if norm((root - u) / segment.scale) > MAX_END_SHIFT:
            return None
        point = replace(segment.b, u=root, residual=solution.residual, iterations=solution.iterations, observed={})
        return LocatedEvent(self, segment.fraction_of(root), point, True)

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem:
        """Return the equations of the resonance, with the unknowns of the Neimark-Sacker points."""
        return RealPairProblem(problem, parameter, self)

    def _angle(self, segment: Segment, point: CurvePoint) -> float:
        """Return the angle of the multipliers from the real axis at this resonance [rad]; zero if they are real."""
        s = exponent_at(segment.equations, point, segment.a.observed.get(EXPONENT))
        if s is None:
            return 0.0
        cosine = math.cos(angle_of_pair(segment.equations, point, s))
        return math.acos(max(-1.0, min(1.0, cosine if self.on is FirstResonanceEvent else -cosine)))


MAX_END_ANGLE = 0.3
"""Angle of the multipliers, from 0 or pi [rad], up to which the end of a Neimark-Sacker curve is searched."""

MAX_PASSED_ANGLE = 1.0
"""Angle of the multipliers, from 0 or pi [rad], from which a step may pass the end of a Neimark-Sacker curve."""

SLOPE_FRACTION = 0.02
"""Fraction of a segment over which the slope of the square of the angle is a difference."""

MAX_END_SHIFT = 0.1
"""Scaled distance of the end of a Neimark-Sacker curve from its extrapolation, above which it is another point."""
