"""Kernel that judges how nearly motions seen once a period have closed: see `settle`."""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.compiling import kernel
from hbgear.time.exponential.segments import Integers


@kernel
def is_periodic(
    past: Array, p: int, periods: int, window: int, weights: Array, size: Array, tolerance: float, period: Integers,
    left: Array, guess: Integers,
) -> None:  # fmt: skip
    """What is known of B motions after p periods.

    Parameters
    ----------
    past : (T, B, r) states, that after i periods at (i - 1) % T; T at least 2 window + periods.
    periods : largest period looked for.
    window : periods over which the rate of approach is judged, twice.
    weights : (1 or B, r) of the states' parts. size : (B,) of the states.
    tolerance : distance still to go, relative to the size, below which a motion is settled.
    period : (B,), on return 0 where it is not. left : (B,) distance still to go, for the period guess (B,) that is
        nearest to settling.
    """
    T, B, r = past.shape
    for b in range(B):
        row = b if len(weights) > 1 else 0
        period[b], guess[b], left[b] = 0, 1, np.inf
        first = same = 0
        for k in range(1, periods + 1):
            new = old = 0.0
            for i in range(2 * window):
                gap = np.inf
                if p - i - k >= 0:
                    x, y, total = (p - i - 1) % T, (p - i - k - 1) % T, 0.0
                    for a in range(r):
                        total += (weights[row, a] * (past[x, b, a] - past[y, b, a])) ** 2
                    gap = np.sqrt(total)
                if i < window:
                    new = gap if not gap <= new else new
                else:
                    old = gap if not gap <= old else old
            go = np.inf
            if new <= 1e-14 * size[b]:
                go = 0.0
            elif new < old:
                go = new / (1.0 - (new / old) ** (k / window)) / size[b]
            if go < left[b]:
                left[b], guess[b] = go, k
            if first == 0 and go <= tolerance:
                first = k
            if same == 0 and new <= 30.0 * tolerance * size[b]:
                same = k
        if first:  # a multiple of the period closes before the period does; what is that small is the period
            period[b] = min(first, same) if same else first
