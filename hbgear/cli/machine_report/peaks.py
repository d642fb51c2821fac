"""Largest stable motions of a curve: at stability limits, and between its points by successive parabolas.

    x* = x - s / (2 c)     of the parabola with slope s and curvature c through a point and its neighbours

A fold, or another stability limit, belongs to the stable motions that end there, although a multiplier has modulus one.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS

PARABOLAS = 3
"""Largest number of parabolas that locate a peak between points of a curve."""


def stable_or_limit(branch: hb.Branch) -> Array:
    """Return whether each point is stable, or a stability limit next to a stable point; True if nothing is known.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.6))
    >>> bool(stable_or_limit(curve)[curve["LP1"].index])
    True
    """
    stable = np.ones(len(branch), bool) if branch.stable is None else np.array(branch.stable, bool)
    ends = stable.copy()
    for point in branch.special:
        if point.kind in STABILITY_CHANGING_KINDS:
            ends[point.index] |= stable[max(point.index - 1, 0) : point.index + 2].any()
    return ends


def refined_peak(
    branch: hb.Branch, size: Array, i: int, size_of: Callable[[hb.Point], float]
) -> tuple[hb.Point, float]:
    """Return the motion of the largest size near point i of a branch and this size, by successive parabolas.

    The point is returned if it is an end of the branch, or if the parameter turns back next to it.
    """
    best, largest = branch[i], float(size[i])
    x, y = branch.values[max(i - 1, 0) : i + 2].copy(), size[max(i - 1, 0) : i + 2].copy()
    if len(x) < 3 or (x[1] - x[0]) * (x[2] - x[1]) <= 0 or not np.isfinite(y).all():
        return best, largest
    for _ in range(PARABOLAS):
        curvature, slope, _ = np.polyfit(x - x[1], y, 2)
        top = float(x[1] - slope / (2 * curvature)) if curvature < 0 else math.inf
        if not min(x[0], x[2]) < top < max(x[0], x[2]) or top == x[1]:
            break
        points = [p for p in branch.at(top) if p.stable is not False and p.X.shape == best.X.shape]
        if not points:
            break
        point = points[int(np.argmin([float(np.linalg.norm(p.X - best.X)) for p in points]))]
        height = size_of(point)
        if not height > largest:
            break
        k = 1 if (top - x[1]) * (x[2] - x[1]) > 0 else 0  # the new point is between x[k] and x[k + 1]
        x, y = np.insert(x, k + 1, top)[k : k + 3], np.insert(y, k + 1, height)[k : k + 3]
        best, largest = point, height
    return best, largest
