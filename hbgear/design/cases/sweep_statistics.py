"""The response of slow sweeps, read off sampled curves: along a stable part to its end, then on where the jump lands.

    curve (3, P): Omega, amplitude, stable (1 or 0), in the order of the curve;  jumps (J, 5) as in `Cases`

Where a part ends without a jump (its period doubles, for instance) the curve has no stable motion for a while: nan.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.design.cases.study import Cases

_NEAR = 0.02
"""A jump belongs to the end of a stable part if it is no farther from it than this share of the range of Omega."""


@dataclass(frozen=True, eq=False)
class Swept:
    """Of a slow sweep of each case, (cases, Omega): amplitude, nan where there is none, and jumps made by then."""

    amplitude: Array
    jumped: Array


@dataclass(frozen=True, eq=False)
class SweepStatistics:
    """What slow sweeps of many cases have in common, at values of Omega.

    Parameters
    ----------
    Omega : ndarray, shape (P,)
        Ascending. quantiles : (Q,) those asked for.
    rising, falling : ndarray, shape (Q, P)
        Quantiles of the amplitude of the sweep in that direction, each that of one of the cases.
    jumped_rising, jumped_falling : ndarray, shape (P,)
        Share of the cases whose sweep has jumped by then.
    coexisting : ndarray, shape (P,)
        Share of the cases that have two or more stable motions there.
    known : ndarray, shape (P,)
        Share of the cases that have a stable motion there at all; the quantiles are those of these.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), hb.design.grid(F=[0.15, 0.2]), ("jumps", "curve"), harmonics=1,
    ...         span=(0.9, 1.4),
    ...                      executor=here)
    >>> told = hb.design.sweep_statistics(found)
    >>> told.rising.shape == told.falling.shape == (3, 200), float(told.coexisting.max())
    (True, 0.5)
    """

    Omega: Array
    quantiles: Array
    rising: Array
    falling: Array
    jumped_rising: Array
    jumped_falling: Array
    coexisting: Array
    known: Array


@checked_arguments()
def sweep_statistics(
    found: Cases, Omega: Array | None = None, quantiles: Sequence[float] = (0.05, 0.5, 0.95)
) -> SweepStatistics:
    """Quantiles of the response of slow sweeps over many cases, each direction by itself, and chances of jumps.

    Across folds a quantile over all motions of a frequency means nothing; that of what a sweep in one direction meets
    does. Chances are shares of the cases.

    Parameters
    ----------
    found : Cases
        Cases computed with "curve", and with "jumps" so that it is known where they land.
    Omega : ndarray or None, shape (P,), optional
        Ascending; 200 values over the span by default.
    quantiles : sequence of float, optional
        Between 0 and 1.

    Raises
    ------
    ValueError
        If no curve with a stable motion was kept, a quantile is beyond 0 and 1, or Omega does not rise.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), hb.design.grid(F=[0.05, 0.2]), ("jumps", "curve"), harmonics=1,
    ...         span=(0.9, 1.4),
    ...                      executor=here)
    >>> hb.design.sweep_statistics(found, [1.0, 1.39]).jumped_rising.tolist()
    [0.0, 0.5]
    """
    given = np.linspace(min(found.work.span), max(found.work.span), 200) if Omega is None else np.asarray(Omega, float)
    levels = np.asarray(quantiles, dtype=float)
    if given.ndim != 1 or not given.size or not (np.diff(given) > 0).all():
        raise ValueError("sweep_statistics: Omega must be values that rise, in one list")
    if not levels.size or not ((levels >= 0) & (levels <= 1)).all():
        raise ValueError(f"sweep_statistics: quantiles = {quoted(quantiles)} must be between 0 and 1")
    up, down = (swept_cases(found, given, direction) for direction in (1, -1))
    stable = np.array([_motions(curve, given) for curve in found.curves.values()])
    return SweepStatistics(
        given, levels, _quantiles(up.amplitude, levels), _quantiles(down.amplitude, levels),
        (up.jumped > 0).mean(axis=0), (down.jumped > 0).mean(axis=0), (stable > 1).mean(axis=0),
        (stable > 0).mean(axis=0),
    )  # fmt: skip


def _quantiles(amplitude: Array, levels: Array) -> Array:
    """Of the cases that have one, (Q, P); each is the amplitude of one of the cases."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # where no case has any
        out: Array = np.nanquantile(amplitude, levels, axis=0, method="inverted_cdf")
    return out


def _motions(curve: Array, Omega: Array) -> Array:
    """Number of stable motions (P,) of a curve."""
    count = np.zeros(len(Omega), dtype=int)
    for x, _ in stable_parts(curve):
        count += (x[0] <= Omega) & (x[-1] >= Omega)
    return count


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
    curve : ndarray
        See the head of this file.
    jumps : ndarray or None, shape (J, 3)
        Omega, amplitude before and after of the jumps in this direction; without them (None) a part that ends where the
        curve has other stable motions is taken to end in a jump to the nearest of them.
    Omega, direction : ndarray
        The values, and +1 or -1.
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
