"""Candidates for even numbers of zeros: segments on which a test function of equal signs comes close to zero.

A test function is known at the points of a curve. Two zeros between neighbouring points leave no sign change. Parabolas
and secants through neighbouring points show where the function may reach zero; `even_crossings` searches there.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array


def near_zeros(f: Array, length: Array) -> list[tuple[int, float]]:
    """Return the segments on which test functions f (P, T) at P points, some lengths apart, may cross zero twice.

    Each segment has the fraction at which the test function is closest to zero. It is a candidate if one of these
    conditions holds:

    - the parabola through three points has its extremum on the segment and comes close to zero there,
    - the secants through the two points on either side both reach zero before they intersect,
    - one of these secants reaches zero within the fraction `SECANT_REACH` of the segment.
    """
    from hbgear.continuation.events.near_tangency_kernel import near_zeros_kernel

    if len(f) < 3:
        return []
    candidates = np.empty((f.size, 2))
    values, lengths = (np.ascontiguousarray(array, dtype=float) for array in (f, length))
    count = near_zeros_kernel(values, lengths, NEAR_ZERO_RATIO, SECANT_REACH, candidates)
    return sorted((int(segment), s) for segment, s in candidates[:count].tolist())


SECANT_REACH = 0.2
"""Fraction of a segment within which a secant that reaches zero makes the segment a candidate."""


NEAR_ZERO_RATIO = 0.25
"""Extremum of a test function, relative to its smallest value at the points, below which it may cross zero."""
