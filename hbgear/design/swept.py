"""The response of slow sweeps, read off sampled curves: along a stable part to its end, then on where the jump lands.

    curve (3, P): Omega, amplitude, stable (1 or 0), in the order of the curve;  jumps (J, 5) as in `Cases`

Where a part ends without a jump (its period doubles, for instance) the curve has no stable motion for a while: nan.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hbgear.common.arrays import Array
from hbgear.design.study import Cases

_NEAR = 0.02
"""A jump belongs to the end of a stable part if it is no farther from it than this share of the range of Omega."""


@dataclass(frozen=True, eq=False)
class Swept:
    """Of a slow sweep of each case, (cases, Omega): amplitude, nan where there is none, and jumps made by then."""

    amplitude: Array
    jumped: Array


def swept_cases(found: Cases, Omega: Array, direction: int) -> Swept:
    """The response of each case to a slow sweep with Omega rising (+1) or falling (-1), at these ascending values.

    Raises
    ------
    ValueError
        If no curve with a stable motion was kept.
    """
    known = "jumps" in found.work.compute
    rows = []
    for case, curve in found.curves.items():
        mine = found.jumps[(found.jumps[:, 0] == case) & (found.jumps[:, 2] == direction)][:, [1, 3, 4]]
        rows.append(swept(curve, mine if known else None, Omega, direction))
    if not any(np.isfinite(amplitude).any() for amplitude, _ in rows):
        raise ValueError("there are no curves with stable motions; compute them: compute=('curve',)")
    return Swept(*(np.array(column) for column in zip(*rows, strict=True)))


def swept(curve: Array, jumps: Array | None, Omega: Array, direction: int) -> tuple[Array, Array]:
    """Amplitudes and numbers of jumps made by then, at ascending values of Omega.

    Parameters
    ----------
    curve : see the head of this file.
    jumps : (J, 3) Omega, amplitude before and after of the jumps in this direction; without them (None) a part that
        ends where the curve has other stable motions is taken to end in a jump to the nearest of them.
    Omega, direction : the values, and +1 or -1.
    """
    parts = [(direction * x, y) for x, y in stable_parts(curve)]
    parts = [(x[::direction], y[::direction]) for x, y in parts]
    at = (direction * Omega)[::direction]
    amplitude, count = np.full(len(at), np.nan), np.zeros(len(at))
    reach = _NEAR * float(np.ptp(curve[0]))
    here, start, made = min(parts, key=lambda part: part[0][0], default=None), -np.inf, 0
    while here is not None:
        x, y = here
        inside = (at >= max(start, x[0])) & (at <= x[-1])
        amplitude[inside] = np.interp(at[inside], x, y)
        start = x[-1]
        count[at > start] = made
        here, leaps = _next(parts, here, _after(jumps, direction * start, reach))
        made += leaps
        count[at > start] = made
    return amplitude[::direction], count[::direction]


def stable_parts(curve: Array) -> Iterator[tuple[Array, Array]]:
    """Omega, ascending, and amplitude of each stable part of a curve between folds; a fold counts to both its sides."""
    values, amplitude, stable = curve
    ahead = np.sign(np.diff(values))
    fold = np.zeros(len(values), dtype=bool)
    fold[1:-1] = ahead[1:] != ahead[:-1]
    good = stable.astype(bool)
    way = ahead * ((good[:-1] | fold[:-1]) & (good[1:] | fold[1:]) & (good[:-1] | good[1:]))
    for first, last in pairwise([0, *(np.flatnonzero(np.diff(way)) + 1), len(way)]):
        if first < last and way[first]:
            rows = slice(first, last + 1)
            sense = int(way[first])
            yield values[rows][::sense], amplitude[rows][::sense]


def _after(jumps: Array | None, Omega: float, reach: float) -> float | None:
    """Amplitude after the jump at the end of a part: nan if it is not known, None if there is no jump."""
    if jumps is None:
        return np.nan
    near = [row for row in jumps if abs(row[0] - Omega) <= reach]
    return float(min(near, key=lambda row: abs(row[0] - Omega))[2]) if near else None


def _next(
    parts: list[tuple[Array, Array]], here: tuple[Array, Array], after: float | None
) -> tuple[tuple[Array, Array] | None, int]:
    """The part a sweep is on after the end of one, and whether it got there by a jump."""
    end, height = here[0][-1], here[1][-1]
    met = [part for part in parts if part is not here and part[0][0] <= end < part[0][-1]]
    if met and after is not None:
        wanted = height if np.isnan(after) else after
        return min(met, key=lambda part: abs(float(np.interp(end, *part)) - wanted)), 1
    later = [part for part in parts if part[0][0] > end]
    return min(later, key=lambda part: part[0][0], default=None), int(after is not None and not np.isnan(after))
