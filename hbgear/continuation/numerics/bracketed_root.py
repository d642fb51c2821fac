"""Bracketed root of a scalar function with or without a kink at the root, by an extension of Chandrupatla's method.

Each iteration uses inverse quadratic interpolation through the last three points where that is safe. Elsewhere the
line through the two points on one side of the root is extrapolated, which converges fast where the slopes on the two
sides differ: test functions of contacts and sliders have such kinks at their roots. An iteration bisects if the last
two have not halved the bracket. The methods of `scipy.optimize` bisect at kinks: 30 evaluations instead of 10.

References
----------
Chandrupatla (1997), Adv. Eng. Softw. 28(3), 145-149, https://doi.org/10.1016/S0965-9978(96)00051-8.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

MAX_EVALUATIONS = 100
"""Number of evaluations after which the best point is returned. Bisection alone needs about 50."""


EARLY_ACCEPTANCE = 0.1
"""Distance of the interpolated root from the last point, relative to the tolerance, at which that point is returned."""


def find_root_bracketed(
    function: Callable[[float], float], low: float, high: float, tolerance: float, first: float = math.nan
) -> float:
    """Return the root of a continuous function between two points at which it has different signs.

    The result is within ``tolerance`` of the root. ``first`` is the first point evaluated, by default the middle.
    ValueError is raised if the values at the ends have the same sign, or a value is nan.
    """
    a, b = high, low
    fa, fb = function(a), function(b)
    if not fa * fb <= 0:
        raise ValueError(f"the function has the values {fb} and {fa} at {low} and {high}: no change of sign")
    fraction = 0.5 if math.isnan(first) else (first - a) / (b - a)
    width, slow = abs(b - a), 0
    for _ in range(MAX_EVALUATIONS):
        best, smallest = (b, fb) if abs(fb) < abs(fa) else (a, fa)
        min_fraction = (2 * sys.float_info.epsilon * abs(best) + tolerance) / abs(b - a)
        if smallest == 0 or min_fraction > 0.5:
            return best
        x = a + min(max(fraction, min_fraction), 1 - min_fraction) * (b - a)
        fx = function(x)
        if math.isnan(fx):
            raise ValueError(f"the function is nan at {x}")
        c, fc, b, fb = (a, fa, b, fb) if (fx > 0) == (fa > 0) else (b, fb, a, fa)
        a, fa = x, fx
        width, slow = (abs(b - a), 0) if abs(b - a) <= 0.5 * width or slow > 1 else (width, slow + 1)
        fraction = 0.5 if slow > 1 else _next_fraction(a, b, c, fa, fb, fc)
        if abs(fraction * (b - a)) < EARLY_ACCEPTANCE * tolerance:
            return a
    return best


def _next_fraction(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> float:
    """Return the next point as a fraction of the way from a to b.

    Inverse quadratic interpolation is used where it is safe, else the line through c and the end on its side of the
    root, if it ends in the bracket, else bisection.
    """
    xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb) if fc != fb else 2.0
    if phi**2 < xi and (1 - phi) ** 2 < 1 - xi:
        return fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    x, fx = (a, fa) if (fc > 0) == (fa > 0) else (b, fb)
    fraction = (x - fx * (x - c) / (fx - fc) - a) / (b - a) if fx != fc else 0.5
    return fraction if 0 < fraction < 1 else 0.5
