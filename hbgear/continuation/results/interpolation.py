"""Crossings of a branch with a value of its parameter, by linear interpolation, and amplitudes between points.

(p_i - p)(p_i+1 - p) <= 0,   s = (p - p_i) / (p_i+1 - p_i),   X ~ (1 - s) X_i + s X_i+1

An amplitude is a function of the length along the curve, and so is the parameter. Both are smooth next to a fold, where
the amplitude as a function of the parameter is not. Cubic splines have errors of fourth order in the distance of the
points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.arrays import Array
from hbgear.continuation.results.branch_data import BranchData


@dataclass(frozen=True)
class Crossing:
    """A position between the points ``index`` and ``index + 1`` of a branch, at a fraction from 0 to 1."""

    index: int
    fraction: float

    def interpolate(self, array: Array) -> Array:
        """Return the value of an array (P, ...) over the points of the branch, interpolated linearly."""
        return (1 - self.fraction) * array[self.index] + self.fraction * array[self.index + 1]

    @property
    def nearest(self) -> int:
        """Number of the nearer of the two points."""
        return self.index if self.fraction <= 0.5 else self.index + 1

    @property
    def points(self) -> tuple[int, ...]:
        """Numbers of the two points, or of the one point that it coincides with."""
        return tuple(i for i, weight in ((self.index, 1 - self.fraction), (self.index + 1, self.fraction)) if weight)


def crossings_at(branch: BranchData, value: float) -> list[Crossing]:
    """Return the crossings of a branch with a value of its parameter, in the order of the branch, without duplicates.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 0.8))
    >>> (crossing,) = crossings_at(curve, 0.7)
    >>> round(float(crossing.interpolate(curve.values)), 12)
    0.7
    """
    x = branch.values - value
    side = np.sign(x)
    out = []
    for i in np.flatnonzero(side[:-1] * side[1:] <= 0):
        if side[i] == 0 and i > 0:  # found already, as the end of the previous segment
            continue
        distance = float(x[i] - x[i + 1])
        out.append(Crossing(int(i), float(x[i]) / distance if distance else 0.0))
    return out


def interpolate_along(at: Array, x: Array, y: Array) -> Array:
    """Return a quantity on a section of a curve between folds, by cubic splines over the length along it.

    x, ascending, and y are the parameter and the quantity at the points of the section; the result is y where x is
    ``at``.

    Examples
    --------
    >>> import numpy as np
    >>> angle = np.linspace(-np.pi / 2, 0, 24)  # a quarter of a circle with a fold at its end
    >>> y = interpolate_along(np.array([0.6, 0.999]), np.cos(angle), np.sin(angle))
    >>> bool(np.abs(y + np.sqrt([0.64, 1 - 0.999**2])).max() < 1e-5)
    True
    """
    steps = np.hypot(*(np.diff(z) / (np.ptp(z) or 1.0) for z in (x, y)))
    distinct = np.append(True, steps > _COINCIDENCE)
    x, y, s = x[distinct], y[distinct], np.append(0.0, np.cumsum(steps))[distinct]
    if len(x) < 2:
        return np.full(len(at), y[0])
    x_of_s, k = scipy.interpolate.CubicSpline(s, x), np.clip(np.searchsorted(x, at) - 1, 0, len(x) - 2)
    low, high = s[k], s[k + 1]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = x_of_s(middle) < at
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return scipy.interpolate.CubicSpline(s, y)(high)


_COINCIDENCE = 1e-9
"""Distance of two points of a section, relative to its ranges, below which they are one."""

_BISECTIONS = 45
"""Bisections of the length between two points [-]: the position is then known to rounding."""
