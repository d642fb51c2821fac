"""Crossings of a branch with a value of its parameter, by linear interpolation.

(p_i - p)(p_i+1 - p) <= 0,   s = (p - p_i) / (p_i+1 - p_i),   X ~ (1 - s) X_i + s X_i+1
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.results.branch_data import BranchData


@dataclass(frozen=True)
class Crossing:
    """A position on the segment between the points ``index`` and ``index + 1`` of a branch.

    Attributes
    ----------
    index : int
        Number of the first point of the segment.
    fraction : float
        Fraction s of the segment, from 0 to 1.
    """

    index: int
    fraction: float

    def interpolate(self, array: Array) -> Array:
        """Return the value of an array over the points, interpolated linearly.

        Parameters
        ----------
        array : ndarray, shape (P,) or (P, n)
            Array over the points of the branch.

        Returns
        -------
        ndarray, shape () or (n,)
            Value at the crossing.
        """
        x: Array = (1 - self.fraction) * array[self.index] + self.fraction * array[self.index + 1]
        return x

    @property
    def nearest(self) -> int:
        """Number of the nearer of the two points."""
        return self.index if self.fraction <= 0.5 else self.index + 1

    @property
    def points(self) -> tuple[int, ...]:
        """Numbers of the two points, or of the one point that it coincides with."""
        return tuple(i for i, weight in ((self.index, 1 - self.fraction), (self.index + 1, self.fraction)) if weight)


def crossings_at(branch: BranchData, value: float) -> list[Crossing]:
    """Return the crossings of a branch with a value of its parameter.

    Parameters
    ----------
    branch : BranchData
        Branch.
    value : float
        Value of its parameter.

    Returns
    -------
    list of Crossing
        Crossings in the order of the branch, without duplicates.

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
