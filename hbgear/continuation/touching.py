"""Test functions that may cross zero twice between two rows of a curve, which then have the same sign.

A test function is known at the rows. Where it seems to touch zero between two of them, as neighbouring rows tell, the
curve is looked at more closely (`hidden`).
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array


def dips(f: Array, length: Array) -> list[tuple[int, float]]:
    """Pieces on which test functions f (rows, T) of one sign at the rows may cross zero twice, and where on them.

    They do if the parabola through three rows, the pieces between them of the given lengths, comes close to zero, or if
    the lines through two rows on either side reach zero before they meet, as they do on a piece longer than others, or
    one of them does so at once.
    """
    if len(f) < 3:
        return []
    places = {**_lines(f, length), **_parabolas(f, length)}
    return sorted((piece, s) for (piece, _), s in places.items())


def _parabolas(f: Array, length: Array) -> dict[tuple[int, int], float]:
    """Places s on pieces where the parabola of a function through three rows comes close to zero."""
    before, here, after = f[:-2], f[1:-1], f[2:]
    h, k = length[:-1, None], length[1:, None]
    least = (before * here > 0) & (here * after > 0) & (np.abs(here) <= np.minimum(np.abs(before), np.abs(after)))
    rise, fall = (here - before) / h, (after - here) / k
    bend, slope = (fall - rise) / (h + k), (rise * k + fall * h) / (h + k)
    found = {}
    for i, j in np.argwhere(least & (bend * here > 0)):
        at = -0.5 * slope[i, j] / bend[i, j]
        if 1 + 0.5 * slope[i, j] * at / here[i, j] <= SHALLOW:
            piece, s = (int(i), 1 + at / h[i, 0]) if at < 0 else (int(i) + 1, at / k[i, 0])
            found[piece, int(j)] = float(s)
    return found


def _lines(f: Array, length: Array) -> dict[tuple[int, int], float]:
    """Places s on pieces where lines of a function through two rows on either side reach zero."""
    one_sign = f[:-1] * f[1:] > 0
    one_sign = one_sign[:-2] & one_sign[1:-1] & one_sign[2:]
    before, a, b, after = f[:-3], f[1:-2], f[2:-1], f[3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        first = a / (before - a) * (length[:-2] / length[1:-1])[:, None]
        last = 1 - b / (after - b) * (length[2:] / length[1:-1])[:, None]
    soon, late = (first > 0) & (first < _SOON), (last < 1) & (last > 1 - _SOON)
    both = (first > 0) & (first < last) & (last < 1)
    place = np.where(both, 0.5 * (first + last), np.where(soon, 2 * first, 2 * last - 1))
    return {(int(i) + 1, int(j)): float(place[i, j]) for i, j in np.argwhere(one_sign & (both | soon | late))}


_SOON = 0.1  # share of a piece on which a line that reaches zero tells of a test function that does


SHALLOW = 0.25  # share of its least value at the rows below which a test function may cross zero between them
