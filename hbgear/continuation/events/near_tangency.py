"""Test functions that may cross zero twice between two rows of a curve, which then have the same sign.

A test function is known at the rows. Where it seems to touch zero between two of them, as neighbouring rows tell, the
curve is looked at more closely (`hidden`).
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array


def near_zeros(f: Array, length: Array) -> list[tuple[int, float]]:
    """Pieces on which test functions f (rows, T) of one sign at the rows may cross zero twice, and where on them.

    They do if the parabola through three rows, the pieces between them of the given lengths, comes close to zero, or if
    the lines through two rows on either side reach zero before they meet, as they do on a piece longer than others, or
    one of them does so at once.
    """
    from hbgear.continuation.events.near_tangency_kernel import near_zeros_kernel

    if len(f) < 3:
        return []
    found = np.empty((f.size, 2))
    values, lengths = (np.ascontiguousarray(each, dtype=float) for each in (f, length))
    count = near_zeros_kernel(values, lengths, SHALLOW, SOON, found)
    return sorted((int(piece), s) for piece, s in found[:count].tolist())


SOON = 0.2  # share of a piece on which a line that reaches zero tells of a test function that does


SHALLOW = 0.25  # share of its least value at the rows below which a test function may cross zero between them
