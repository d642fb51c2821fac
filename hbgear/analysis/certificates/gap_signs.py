"""Proof that every gap stays between its breakpoints from one contact instant to the next.

    h(s) > 0 for 0 < s < T,   h distance of a gap to a breakpoint,   h = 0 at an end with a switch of this breakpoint

The motion is a Taylor polynomial with a rigorous remainder on each step. On an interval [m - R, m + R]

    h in h(m) + h'(m) [-R, R] + h'' R^2 [0, 1] / 2            the lower end is positive, or
    h' > 0 after a switch, h' < 0 before one, or h'' < 0 between two

else it is halved. At a grazing h = h' = 0, and h'' > 0 proves that the gap touches there only.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hbgear.analysis.certificates.ball_system import Balls, BallSystem, matrix
from hbgear.analysis.certificates.flows import MOTION_ORDER, TaylorStep, taylor_steps

MAX_INTERVAL_HALVINGS = 45
"""Largest number of times that a step is halved."""

SINGLE, DOUBLE = 1, 2
"""Order of the zero of h at an end of an interval: a switch, a grazing."""


class Gap(NamedTuple):
    """Polynomial of h on a step, and balls with the remainders of h, h' and h''."""

    h: Any
    first: Any
    second: Any
    remainders: tuple[Any, Any, Any]

    def at(self, s: Any) -> tuple[Any, Any]:
        """Return h and h' at a point of the step."""
        return self.h(s) + self.remainders[0], self.first(s) + self.remainders[1]

    def curvature(self, s: Any) -> Any:
        """Return h'' on an interval."""
        return self.second(s) + self.remainders[2]


def failing_gap(
    system: BallSystem, flow: Any, x: Balls, ends: tuple[Any, Any], gap_signs: list[tuple[int, int, int, int, int]]
) -> tuple[int, float] | None:
    """Return the first element and phase for which a sign is not proved; None if all are proved.

    x is the state (2n,) at the beginning of a segment, ``ends`` are the phases of its ends. Each of the ``gap_signs``
    holds element, breakpoint, sign of the distance from it, and the orders of the zeros at both ends (0: none).
    """
    start = ends[0]
    steps = list(taylor_steps(flow, *ends, matrix(system.extended(x, start)[:, None]), MOTION_ORDER))
    for number, step in enumerate(steps):
        for element, breakpoint, sign, zero_left, zero_right in gap_signs:
            gap = _gap(step, system.rows[element] * sign, system.breakpoints[element][breakpoint] * sign)
            zero_a = zero_left if number == 0 else 0
            zero_b = zero_right if number == len(steps) - 1 else 0
            offset = _unproved(gap, step.h, zero_a, zero_b)
            if offset is not None:
                return element, float(start.mid()) + number * float(step.h.mid()) + offset
    return None


def _gap(step: TaylorStep, row: Balls, level: Any) -> Gap:
    """Return the distance row y - level on a step."""
    from flint import arb, arb_poly

    normal = matrix(row[None])
    c = [(normal * y)[0, 0] for y in step.coefficients]
    c[0] = c[0] - level
    h = arb_poly(c)
    step_range = arb(0).union(step.h)
    last, p = (normal * step.last)[0, 0], len(c)  # the coefficient of s^p at an unknown point of the step
    remainders = (last * step_range**p, last * p * step_range ** (p - 1), last * (p * (p - 1)) * step_range ** (p - 2))
    first = h.derivative()
    return Gap(h, first, first.derivative(), remainders)


def _unproved(gap: Gap, width: Any, left: int, right: int) -> float | None:
    """Return a point of the step at which the sign is not proved; None if h > 0 in the interior."""
    from flint import arb

    upper = float(np.nextafter(float(width.upper()), np.inf))
    stack = [(0.0, upper, left, right, 0)]
    while stack:
        a, b, zero_a, zero_b, depth = stack.pop()
        middle, R = 0.5 * (a + b), 0.5 * (b - a) * (1 + 1e-12)
        curvature = gap.curvature(arb(middle, R))
        value, slope = gap.at(arb(middle))
        if _is_positive(value, slope, curvature, arb(0, R), zero_a, zero_b):
            continue
        if zero_a == zero_b == SINGLE and curvature < 0:
            continue
        if depth == MAX_INTERVAL_HALVINGS:
            return middle
        stack += [(a, middle, zero_a, 0, depth + 1), (middle, b, 0, zero_b, depth + 1)]
    return None


def _is_positive(value: Any, slope: Any, curvature: Any, offsets: Any, zero_a: int, zero_b: int) -> bool:
    """Return whether h > 0 follows on an interval with at most one zero at its ends."""
    from flint import arb

    if zero_a and zero_b:
        return False
    slopes = slope + curvature * offsets
    if zero_a == SINGLE:
        return bool(slopes > 0)
    if zero_b == SINGLE:
        return bool(slopes < 0)
    if zero_a or zero_b:
        return bool(curvature > 0)
    half = offsets.abs_upper() ** 2 / 2
    lowest = value + slope * offsets + curvature * arb(0).union(half)
    return bool(lowest > 0)
