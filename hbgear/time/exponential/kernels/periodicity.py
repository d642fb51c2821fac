"""Kernel that estimates how closely motions sampled once a period approach a periodic motion: see `steady_state`."""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.compiling import kernel
from hbgear.time.exponential.segments import Integers


@kernel
def is_periodic(
    history: Array, p: int, periods: int, window: int, weights: Array, size: Array, tolerance: float
) -> tuple[Integers, Array, Integers]:
    """Estimate the period and the remaining distance of B motions after p excitation periods.

    Parameters
    ----------
    history : ndarray, shape (T, B, r)
        States; the state after i periods has the index (i - 1) % T. T is at least 2 window + periods.
    p : int
        Number of periods integrated.
    periods : int
        Largest period that is tested.
    window : int
        Number of periods of each of the two windows from which the rate of convergence is estimated.
    weights : ndarray, shape (1, r) or (B, r)
        Weights of the components of the states.
    size : ndarray, shape (B,)
        Sizes of the states.
    tolerance : float
        Remaining distance, relative to the size, below which a motion is settled.

    Returns
    -------
    period : ndarray, shape (B,)
        Period, 0 if the motion is not settled.
    remaining_distance : ndarray, shape (B,)
        Remaining distance for the period ``guess``.
    guess : ndarray, shape (B,)
        Period with the smallest remaining distance.
    """
    T, B, r = history.shape
    period, guess, remaining_distance = np.zeros(B, np.int64), np.ones(B, np.int64), np.full(B, np.inf)
    for b in range(B):
        row = b if len(weights) > 1 else 0
        first = small = 0
        for k in range(1, periods + 1):
            new = old = 0.0
            for i in range(2 * window):
                distance = np.inf
                if p - i - k >= 0:
                    x, y, total = (p - i - 1) % T, (p - i - k - 1) % T, 0.0
                    for a in range(r):
                        total += (weights[row, a] * (history[x, b, a] - history[y, b, a])) ** 2
                    distance = np.sqrt(total)
                if i < window:
                    new = distance if not distance <= new else new
                else:
                    old = distance if not distance <= old else old
            remaining = np.inf
            if new <= 1e-14 * size[b]:
                remaining = 0.0
            elif new < old:  # distances of a geometric decay: the sum of all that remain
                remaining = new / (1.0 - (new / old) ** (k / window)) / size[b]
            if remaining < remaining_distance[b]:
                remaining_distance[b], guess[b] = remaining, k
            if first == 0 and remaining <= tolerance:
                first = k
            if small == 0 and new <= 30.0 * tolerance * size[b]:
                small = k
        if first:  # a multiple of the period may converge first; the smallest period with a small distance is taken
            period[b] = min(first, small) if small else first
    return period, remaining_distance, guess
