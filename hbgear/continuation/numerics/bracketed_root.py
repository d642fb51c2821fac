"""Bracketed root of a function of one number, by Chandrupatla's method.

Inverse quadratic interpolation through the last three points where that is safe, else bisection. The commands begin a
third of a second sooner than with `scipy.optimize`, of which this is all that a curve needs.

References
----------
Chandrupatla (1997), Adv. Eng. Softw. 28(3), 145-149, https://doi.org/10.1016/S0965-9978(96)00051-8.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

_MOST = 100  # evaluations


_SURE = 0.1  # share of the tolerance within which three values see the root: no other beyond it is asked for


def find_root_bracketed(
    function: Callable[[float], float], low: float, high: float, tolerance: float, first: float = math.nan
) -> float:
    """Where a continuous function passes zero between two places at which it has different signs.

    Parameters
    ----------
    tolerance : distance from the root.
    first : where to look first, between the two; by default half way.

    Raises
    ------
    ValueError
        If the signs are alike, or a value is nan.
    """
    a, b = high, low
    fa, fb = function(a), function(b)
    if not fa * fb <= 0:
        raise ValueError(f"the function has the values {fb} and {fa} at {low} and {high}: no change of sign")
    share = 0.5 if math.isnan(first) else (first - a) / (b - a)
    for _ in range(_MOST):
        best, smallest = (b, fb) if abs(fb) < abs(fa) else (a, fa)
        least = (2 * sys.float_info.epsilon * abs(best) + tolerance) / abs(b - a)
        if smallest == 0 or least > 0.5:
            return best
        x = a + min(max(share, least), 1 - least) * (b - a)
        fx = function(x)
        if math.isnan(fx):
            raise ValueError(f"the function is nan at {x}")
        c, fc, b, fb = (a, fa, b, fb) if (fx > 0) == (fa > 0) else (b, fb, a, fa)
        a, fa = x, fx
        share = _share(a, b, c, fa, fb, fc)
        if abs(share * (b - a)) < _SURE * tolerance:
            return a
    return best


def _share(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> float:
    """Where to look next between a and b: a share of the way, by interpolation if it is monotonous there, or half."""
    xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb) if fc != fb else 2.0
    if not (phi**2 < xi and (1 - phi) ** 2 < 1 - xi):
        return 0.5
    return fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
