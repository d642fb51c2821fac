"""Candidates for even numbers of zeros: segments on which a test function of equal signs comes close to zero.

A test function is known at the points of a curve. Two zeros between neighbouring points leave no sign change. Parabolas
and secants through neighbouring points show where the function may reach zero; `even_crossings` searches there.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.compiling import kernel


def near_zeros(f: Array, length: Array) -> list[tuple[int, float]]:
    """Return the segments on which test functions f (P, T) at P points, some lengths apart, may cross zero twice.

    Each segment has the fraction at which the test function is closest to zero. It is a candidate if one of these
    conditions holds:

    - the parabola through three points has its extremum on the segment and comes close to zero there,
    - the secants through the two points on either side both reach zero before they intersect,
    - one of these secants reaches zero within the fraction `SECANT_REACH` of the segment.
    """
    if len(f) < 3:
        return []
    candidates = np.empty((f.size, 2))
    values, lengths = (np.ascontiguousarray(array, dtype=float) for array in (f, length))
    count = _fill_candidates(values, lengths, candidates)
    return sorted((int(segment), s) for segment, s in candidates[:count].tolist())


SECANT_REACH = 0.2
"""Fraction of a segment within which a secant that reaches zero makes the segment a candidate."""


NEAR_ZERO_RATIO = 0.25
"""Extremum of a test function, relative to its smallest value at the points, below which it may cross zero."""


@kernel
def _fill_candidates(f: Any, length: Any, candidates: Any) -> int:
    """Fill the array ``candidates`` with candidate segments and fractions; return their number. See `near_zeros`.

    Parameters
    ----------
    f : ndarray, shape (P, T)
        Values of T test functions at P points.
    length : ndarray, shape (P - 1,)
        Lengths of the segments.
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
                s = _secant_intersection(f[i - 1, j], f[i, j], f[i + 1, j], f[i + 2, j], length, i)
            if i > 0:
                distance = _parabola_minimum(f[i - 1, j], f[i, j], f[i + 1, j], length[i - 1], length[i])
                s = distance / length[i] if distance >= 0.0 else s
            if i < last - 1:
                distance = _parabola_minimum(f[i, j], f[i + 1, j], f[i + 2, j], length[i], length[i + 1])
                s = 1.0 + distance / length[i] if distance < 0.0 else s
            if not math.isnan(s):
                candidates[count, 0], candidates[count, 1] = i, s
                count += 1
    return count


@kernel
def _parabola_minimum(before: float, mid: float, after: float, h: float, k: float) -> float:
    """Return the distance from the middle one of three points, h and k apart, to the parabola minimum; nan if large."""
    if not (before * mid > 0.0 and mid * after > 0.0 and abs(mid) <= abs(before) and abs(mid) <= abs(after)):
        return math.nan
    rise, fall = (mid - before) / h, (after - mid) / k
    bend, slope = (fall - rise) / (h + k), (rise * k + fall * h) / (h + k)
    if not bend * mid > 0.0:
        return math.nan
    distance = -0.5 * slope / bend
    return distance if 1.0 + 0.5 * slope * distance / mid <= NEAR_ZERO_RATIO else math.nan


@kernel
def _secant_intersection(before: float, a: float, b: float, after: float, length: Any, i: int) -> float:
    """Return the fraction of segment i, from a to b, at which the secants of both sides reach zero; nan if none."""
    if not (before * a > 0.0 and a * b > 0.0 and b * after > 0.0):
        return math.nan
    first = a / (before - a) * (length[i - 1] / length[i])
    last = 1.0 - b / (after - b) * (length[i + 1] / length[i])
    if 0.0 < first < last < 1.0:
        return 0.5 * (first + last)
    if 0.0 < first < SECANT_REACH:
        return 2.0 * first
    return 2.0 * last - 1.0 if 1.0 - SECANT_REACH < last < 1.0 else math.nan
