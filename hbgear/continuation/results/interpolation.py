"""Where a branch passes a value of its parameter.

(p_i - p)(p_i+1 - p) <= 0,   s = (p - p_i) / (p_i+1 - p_i),   X ~ (1 - s) X_i + s X_i+1
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch


@dataclass(frozen=True)
class Crossing:
    """A value of the parameter between the points ``index`` and ``index + 1`` of a branch, the share s of the way."""

    index: int
    share: float

    def between(self, columns: Array) -> Array:
        """What an array over the points, (P,) or (P, n), is there, interpolated linearly."""
        x: Array = (1 - self.share) * columns[self.index] + self.share * columns[self.index + 1]
        return x

    @property
    def nearest(self) -> int:
        """The nearer of the two points."""
        return self.index if self.share <= 0.5 else self.index + 1

    @property
    def points(self) -> tuple[int, ...]:
        """The points it lies between; one if it lies on it."""
        return tuple(i for i, weight in ((self.index, 1 - self.share), (self.index + 1, self.share)) if weight)


def crossings_at(branch: Branch, value: float) -> list[Crossing]:
    """Where a branch passes a value of its parameter, each place once, in the order of the branch.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 0.8))
    >>> (place,) = passings(curve, 0.7)
    >>> round(float(place.between(curve.values)), 12)
    0.7
    """
    x = branch.values - value
    side = np.sign(x)
    out = []
    for i in np.flatnonzero(side[:-1] * side[1:] <= 0):
        if side[i] == 0 and i > 0:  # met as the end of the piece before
            continue
        distance = float(x[i] - x[i + 1])
        out.append(Crossing(int(i), float(x[i]) / distance if distance else 0.0))
    return out
