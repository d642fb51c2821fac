"""Events of peaks of amplitudes, on a finished curve or while it is traced."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy  # sub-modules are imported at first use

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment, normal_of, point_from_solution
from hbgear.continuation.events.event import (
    Event,
    LocatedEvent,
    locate_by_newton,
    locate_root,
)
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.newton import NoConvergence, on_curve, solve
from hbgear.harmonic.bifurcations.extremum import peak_of
from hbgear.harmonic.equations.layout import Layout


class AmplitudePeakEvent(Event):
    """Peak of an amplitude, located by `hbgear.analysis.peaks` on a finished curve, not while it is traced."""

    kind, meaning, marker = "PK", "peak of an amplitude", "^"

    def __init__(self, measure: str = "rms", element: int = 0) -> None:
        self.measure, self.element = measure, element

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        return np.zeros(len(points) - 1, dtype=bool)

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the point of the largest amplitude on a segment."""

        def negative_amplitude(s: float) -> float:
            return -float(self._amplitude(segment, segment.at(s).X))

        def search(xatol: float) -> float:
            best = scipy.optimize.minimize_scalar(
                negative_amplitude, bounds=(0.0, 1.0), method="bounded", options={"xatol": xatol}
            )
            return float(best.x)

        sharp = self._refine(segment, self._interpolated_maximum(segment)) or self._refine(
            segment, search(INITIAL_PEAK_TOLERANCE)
        )
        return [
            LocatedEvent(self, 0.5, sharp or segment.at(search(FINAL_PEAK_TOLERANCE)), True, f"peak of {self.measure}")
        ]

    def _amplitude(self, segment: Segment, X: Array) -> Array:
        layout = segment.problem.layout
        assert isinstance(layout, Layout)
        return layout.measure(self.measure, X, self.element)

    def _interpolated_maximum(self, segment: Segment) -> float:
        """Return the fraction of a segment at which the interpolated amplitude is largest, by a parabola."""
        s = np.linspace(0.0, 1.0, AMPLITUDE_SAMPLES)
        A = self._amplitude(segment, segment.guess(s[:, None])[:, :-1])
        i = min(max(int(np.argmax(A)), 1), AMPLITUDE_SAMPLES - 2)
        before, here, after = A[i - 1 : i + 2].tolist()
        bend = before - 2 * here + after
        return float(s[i] + (0.5 * (before - after) / bend * s[1] if bend < 0 else 0.0))

    def _refine(self, segment: Segment, s: float) -> CurvePoint | None:
        """Return the peak by Newton's method from a fraction of the segment, if it stays on the segment."""
        peak, u = peak_of(segment.problem, segment.name, self.measure, self.element), segment.guess(s)
        try:
            solution = on_curve(solve(peak, u, {**segment.parameters, segment.name: float(u[-1])}))
        except NoConvergence:
            return None
        if norm((np.append(solution.X, solution.value) - u) / segment.scale) > 0.1 * segment.length:
            return None
        return point_from_solution(solution, normal_of(segment.b.u - segment.a.u, segment.scale), segment.scale)

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """Return the equations; see `AmplitudeExtremum`."""
        return peak_of(problem, parameter, self.measure, self.element)


AMPLITUDE_SAMPLES = 17
"""Number of points of a segment at which its interpolated amplitude is evaluated."""


INITIAL_PEAK_TOLERANCE, FINAL_PEAK_TOLERANCE = 1e-2, 1e-7
"""Fractions of a segment to which a peak is minimised: before Newton's method, and instead of it."""


class TracedPeakEvent(AmplitudePeakEvent):
    """Peak of the rms amplitude of an element, located while a curve is traced: opt-in event "PK".

    X^T S t = 0, from + to -,   t the tangent of the curve, S the weights of the alternating part
    """

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Return the derivative of half the squared amplitude along the curve at points, shape (points, 1)."""
        return np.array([[self._slope(problem, point)] for point in points])

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        """Return where the amplitude has a maximum: the derivative changes from positive to negative."""
        return np.asarray((values[:-1, 0] > 0) & (values[1:, 0] < 0))

    def close(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return no segments: a maximum and a minimum on one segment are not searched."""
        return []

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the maximum by Newton's method, or as a bracketed root of the derivative."""
        before, after = self._slope(segment.problem, segment.a), self._slope(segment.problem, segment.b)
        if not before > 0 > after:
            return []
        note = f"peak of {self.measure}"
        try:
            equations = peak_of(segment.problem, segment.name, self.measure, self.element)
            return [locate_by_newton(segment, self, equations, before / (before - after), note)]
        except (NoConvergence, np.linalg.LinAlgError):
            return [locate_root(segment, self, lambda point: self._slope(segment.problem, point), note)]

    def _slope(self, problem: Any, point: CurvePoint) -> float:
        """Return the derivative of half the squared rms amplitude along the curve."""
        motion, change = (problem.rows(problem.resized(x))[self.element, 1:] for x in (point.X, point.tangent[:-1]))
        return float(motion @ change) / 2
