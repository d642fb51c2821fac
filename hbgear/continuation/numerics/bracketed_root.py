"""Bracketed root of a scalar function, by Chandrupatla's method.

Each iteration uses inverse quadratic interpolation through the last three points where that is safe, else bisection.
`scipy.optimize` has the method too, but takes a third of a second to import, for which every command would wait.

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

    Parameters
    ----------
    function : callable
        Function of one number.
    low, high : float
        Ends of the bracket.
    tolerance : float
        Largest distance between the result and the root.
    first : float, optional
        First point, between `low` and `high`. By default it is the middle.

    Returns
    -------
    float
        The root.

    Raises
    ------
    ValueError
        If the values at the ends have the same sign, or a value is nan.
    """
    a, b = high, low
    fa, fb = function(a), function(b)
    if not fa * fb <= 0:
        raise ValueError(f"the function has the values {fb} and {fa} at {low} and {high}: no change of sign")
    fraction = 0.5 if math.isnan(first) else (first - a) / (b - a)
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
        fraction = _next_fraction(a, b, c, fa, fb, fc)
        if abs(fraction * (b - a)) < EARLY_ACCEPTANCE * tolerance:
            return a
    return best


def _next_fraction(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> float:
    """Return the next point as a fraction of the way from a to b: by interpolation if that is safe, else one half."""
    xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb) if fc != fb else 2.0
    if not (phi**2 < xi and (1 - phi) ** 2 < 1 - xi):
        return 0.5
    return fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
