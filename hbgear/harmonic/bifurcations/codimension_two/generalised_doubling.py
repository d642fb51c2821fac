"""Generalised period doublings: the cubic coefficient of the doubled branch is zero."""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.null_vectors import least_singular_vectors
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.event import LocatedEvent, locate_root
from hbgear.continuation.numerics.linear import as_dense, norm
from hbgear.harmonic.bifurcations.codimension_two.event import CodimensionTwoEvent
from hbgear.harmonic.bifurcations.codimension_two.resonances import DIFFERENCE_STEP, border_sign


class GeneralisedDoublingEvent(CodimensionTwoEvent):
    """Generalised period doubling: the branch of twice the period turns over, and a curve of its folds begins."""

    kind, meaning, marker = "GPD", "generalised period doubling: the doubled branch turns over", "X"

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the cubic coefficient, or zero if it is within a hundred times its rounding.

        Every point of a curve of a linear oscillator is degenerate.
        """
        value, rounding = cubic_coefficient(problem, X, parameters)
        return 0.0 if abs(value) < rounding else value

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return the zero of the coefficient itself if its sign changes beyond rounding."""

        def test(point: CurvePoint) -> float:
            return cubic_coefficient(segment.problem, *segment.equations.solution_at(point.u))[0]

        first, last = (self._value(segment.equations, end) for end in (segment.a, segment.b))
        return [locate_root(segment, self, test)] if first * last < 0 else []


def cubic_coefficient(problem: Any, X: Array, parameters: dict[str, float]) -> tuple[float, float]:
    """Return the cubic coefficient of the doubled branch of a period doubling X (n,) and a hundred times its rounding.

    Its sign is that of the side on which the branch exists. Derivatives along v and h are differences of Jacobians of
    fourth order.
    """
    doubled, embedded, odd, even = problem.doubled, problem.embed(X), problem.odd, problem.even
    w, v = np.zeros(len(embedded)), np.zeros(len(embedded))
    w[odd], v[odd] = least_singular_vectors(problem.matrix(X, parameters)[0])
    t = DIFFERENCE_STEP * (norm(X) or 1.0)

    def jacobian(change: Array) -> Array:
        return as_dense(doubled.linearise(embedded + change, "", **parameters).dR_dX)

    def jacobians_along(direction: Array) -> tuple[list[Array], float]:
        size = norm(direction) or 1.0
        step = t / size
        return [jacobian(k * step * direction) for k in (-2, -1, 1, 2)], step

    # first and second derivatives along v by five points, with errors of fourth order
    (A, B, C, D), step = jacobians_along(v)
    first, second = (A - 8 * B + 8 * C - D) @ v / (12 * step), (-A + 16 * B + 16 * C - D) @ v
    middle = jacobian(np.zeros(len(embedded)))
    third = (second - 30 * middle @ v) / (12 * step**2)
    h = np.zeros(len(embedded))
    h[even] = -0.5 * np.linalg.solve(middle[np.ix_(even, even)], first[even])
    (A, B, C, D), step = jacobians_along(h)
    mixed = (A - 8 * B + 8 * C - D) @ v / (12 * step)
    coefficient = float(w @ (mixed + third / 6))
    rounding = MAX_ROUNDING * float(np.finfo(float).eps) * float(np.abs(middle).max()) / t**2
    return coefficient * border_sign(middle[np.ix_(odd, odd)], w[odd], v[odd]), rounding


MAX_ROUNDING = 100.0
"""Rounding of the cubic coefficient, over the rounding of an entry of the Jacobian over the step squared."""
