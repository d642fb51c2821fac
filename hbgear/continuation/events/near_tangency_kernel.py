"""Kernel: where functions that are known at the rows of a curve, and of one sign there, come close to zero between."""

from __future__ import annotations

import math
from typing import Any

from hbgear.common.process.compiling import kernel


@kernel
def near_zeros_kernel(f: Any, length: Any, shallow: float, soon: float, found: Any) -> int:
    """Put pieces and places on them, see `touching.dips`, of functions f (rows, T) in found (rows T, 2); their number.

    length (rows - 1,) : of the pieces. shallow : share of its least value at three rows below which a parabola comes
    close to zero. soon : share of a piece on which a line that reaches zero tells enough by itself.
    """
    count, last = 0, f.shape[0] - 1
    for i in range(last):
        for j in range(f.shape[1]):
            s = math.nan
            if 0 < i < last - 1:
                s = _by_lines(f[i - 1, j], f[i, j], f[i + 1, j], f[i + 2, j], length, i, soon)
            if i > 0:
                at = _lowest(f[i - 1, j], f[i, j], f[i + 1, j], length[i - 1], length[i], shallow)
                s = at / length[i] if at >= 0.0 else s
            if i < last - 1:
                at = _lowest(f[i, j], f[i + 1, j], f[i + 2, j], length[i], length[i + 1], shallow)
                s = 1.0 + at / length[i] if at < 0.0 else s
            if not math.isnan(s):
                found[count, 0], found[count, 1] = i, s
                count += 1
    return count


@kernel
def _lowest(before: float, here: float, after: float, h: float, k: float, shallow: float) -> float:
    """How far from the middle of three rows, h and k apart, their parabola comes close to zero; nan if it does not."""
    if not (before * here > 0.0 and here * after > 0.0 and abs(here) <= abs(before) and abs(here) <= abs(after)):
        return math.nan
    rise, fall = (here - before) / h, (after - here) / k
    bend, slope = (fall - rise) / (h + k), (rise * k + fall * h) / (h + k)
    if not bend * here > 0.0:
        return math.nan
    at: float = -0.5 * slope / bend
    return at if 1.0 + 0.5 * slope * at / here <= shallow else math.nan


@kernel
def _by_lines(before: float, a: float, b: float, after: float, length: Any, i: int, soon: float) -> float:
    """Place on piece i, from a to b, where the lines through two rows on either side reach zero; nan if they do not."""
    if not (before * a > 0.0 and a * b > 0.0 and b * after > 0.0):
        return math.nan
    first: float = a / (before - a) * (length[i - 1] / length[i])
    last: float = 1.0 - b / (after - b) * (length[i + 1] / length[i])
    if 0.0 < first < last < 1.0:
        return 0.5 * (first + last)
    if 0.0 < first < soon:
        return 2.0 * first
    return 2.0 * last - 1.0 if 1.0 - soon < last < 1.0 else math.nan
