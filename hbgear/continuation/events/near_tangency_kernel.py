"""Kernel: segments on which test functions with equal signs at the points of a curve come close to zero."""

from __future__ import annotations

import math
from typing import Any

from hbgear.common.process.compiling import kernel


@kernel
def near_zeros_kernel(f: Any, length: Any, ratio: float, reach: float, candidates: Any) -> int:
    """Fill the array ``candidates`` with candidate segments and fractions; return their number. See `near_zeros`.

    Parameters
    ----------
    f : ndarray, shape (P, T)
        Values of T test functions at P points.
    length : ndarray, shape (P - 1,)
        Lengths of the segments.
    ratio : float
        Extremum of a parabola, relative to the smallest value at its points, below which it is close to zero.
    reach : float
        Fraction of a segment within which a single secant that reaches zero suffices.
    candidates : ndarray, shape (P T, 2)
        Result: the number of each segment and the fraction on it.

    Returns
    -------
    int
        Number of candidates.
    """
    count, last = 0, f.shape[0] - 1
    for i in range(last):
        for j in range(f.shape[1]):
            s = math.nan
            if 0 < i < last - 1:
                s = _secant_intersection(f[i - 1, j], f[i, j], f[i + 1, j], f[i + 2, j], length, i, reach)
            if i > 0:
                distance = _parabola_minimum(f[i - 1, j], f[i, j], f[i + 1, j], length[i - 1], length[i], ratio)
                s = distance / length[i] if distance >= 0.0 else s
            if i < last - 1:
                distance = _parabola_minimum(f[i, j], f[i + 1, j], f[i + 2, j], length[i], length[i + 1], ratio)
                s = 1.0 + distance / length[i] if distance < 0.0 else s
            if not math.isnan(s):
                candidates[count, 0], candidates[count, 1] = i, s
                count += 1
    return count


@kernel
def _parabola_minimum(before: float, mid: float, after: float, h: float, k: float, ratio: float) -> float:
    """Return the distance from the middle one of three points, h and k apart, to the parabola minimum; nan if large."""
    if not (before * mid > 0.0 and mid * after > 0.0 and abs(mid) <= abs(before) and abs(mid) <= abs(after)):
        return math.nan
    rise, fall = (mid - before) / h, (after - mid) / k
    bend, slope = (fall - rise) / (h + k), (rise * k + fall * h) / (h + k)
    if not bend * mid > 0.0:
        return math.nan
    distance = -0.5 * slope / bend
    return distance if 1.0 + 0.5 * slope * distance / mid <= ratio else math.nan


@kernel
def _secant_intersection(before: float, a: float, b: float, after: float, length: Any, i: int, reach: float) -> float:
    """Return the fraction of segment i, from a to b, at which the secants of both sides reach zero; nan if none."""
    if not (before * a > 0.0 and a * b > 0.0 and b * after > 0.0):
        return math.nan
    first = a / (before - a) * (length[i - 1] / length[i])
    last = 1.0 - b / (after - b) * (length[i + 1] / length[i])
    if 0.0 < first < last < 1.0:
        return 0.5 * (first + last)
    if 0.0 < first < reach:
        return 2.0 * first
    return 2.0 * last - 1.0 if 1.0 - reach < last < 1.0 else math.nan
