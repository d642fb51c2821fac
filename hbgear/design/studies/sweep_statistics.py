"""Responses of slow sweeps from sampled curves: a sweep follows a stable segment to its end and jumps to the next one.

    curve (3, P): Omega, amplitude, stable (1 or 0), in the order of the curve, nan between curves
    jumps (J, 5): as in `Cases`

If a segment ends without a jump, for example at a period doubling, the response is nan until the next stable segment.
Between its points a segment is a cubic spline of Omega and amplitude over the length along it, on which the amplitude
next to a fold is as smooth as elsewhere: its error is of fourth order in the distance of the points.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.interpolation import interpolate_along
from hbgear.design.studies.case_results import Cases

JUMP_TOLERANCE = 0.02
"""Largest distance between a jump and the end of its stable segment, as a fraction of the range of Omega."""


@dataclass(frozen=True, eq=False)
class SweepResponses:
    """Responses of a slow sweep for all cases, shape (cases, Omega): amplitudes, nan without a stable motion.

    ``jumped`` is the number of jumps up to this frequency.
    """

    amplitude: Array
    jumped: Array


@dataclass(frozen=True, eq=False)
class SweepStatistics:
    """Statistics of slow sweeps of many cases at given values of Omega.

    Attributes
    ----------
    Omega : ndarray, shape (P,)
        Ascending frequencies.
    quantiles : ndarray, shape (Q,)
        Levels of the quantiles.
    rising, falling : ndarray, shape (Q, P)
        Quantiles of the amplitude of the sweep in this direction; each is the amplitude of one case.
    jumped_rising, jumped_falling : ndarray, shape (P,)
        Fraction of the cases whose sweep has jumped up to this frequency.
    coexisting : ndarray, shape (P,)
        Fraction of the cases with at least two stable motions.
    known : ndarray, shape (P,)
        Fraction of the cases with a stable motion; the quantiles refer to these cases.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), hb.design.grid(F=[0.15, 0.2]), ("jumps", "curve"), harmonics=1,
    ...         span=(0.9, 1.4),
    ...                      executor=here)
    >>> statistics = hb.design.sweep_statistics(found)
    >>> statistics.rising.shape == statistics.falling.shape == (3, 200), float(statistics.coexisting.max())
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
    """Compute quantiles of the response of slow sweeps over many cases, for each direction, and probabilities of jumps.

    A quantile over all coexisting motions at a frequency has no meaning; a quantile over the motions of sweeps in one
    direction has one. Probabilities are fractions of the cases.

    Parameters
    ----------
    found : Cases
        Cases computed with "curve". With "jumps" as well, the landing of each jump is known.
    Omega : array_like, shape (P,), optional
        Ascending frequencies. Default: 200 values over the span.
    quantiles : sequence of float, optional
        Levels between 0 and 1. Default: 0.05, 0.5 and 0.95.

    Raises
    ------
    ValueError
        If no curve with a stable motion is stored, a level is not between 0 and 1, or Omega is not ascending.

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
    frequencies = (
        np.linspace(min(found.work.span), max(found.work.span), 200) if Omega is None else np.asarray(Omega, float)
    )
    levels = np.asarray(quantiles, dtype=float)
    if frequencies.ndim != 1 or not frequencies.size or not (np.diff(frequencies) > 0).all():
        raise ValueError("sweep_statistics: Omega must be a list of ascending values")
    if not levels.size or not ((levels >= 0) & (levels <= 1)).all():
        raise ValueError(f"sweep_statistics: quantiles = {quoted(quantiles)} must be between 0 and 1")
    rising, falling = (sweep_responses(found, frequencies, direction) for direction in (1, -1))
    stable = np.array([_stable_count(curve, frequencies) for curve in found.curves.values()])
    return SweepStatistics(
        frequencies,
        levels,
        quantiles_of(rising.amplitude, levels),
        quantiles_of(falling.amplitude, levels),
        (rising.jumped > 0).mean(axis=0),
        (falling.jumped > 0).mean(axis=0),
        (stable > 1).mean(axis=0),
        (stable > 0).mean(axis=0),
    )


def quantiles_of(amplitude: Array, levels: Array) -> Array:
    """Return quantiles (Q, P) over the cases with a stable motion; each is the amplitude of one case."""
    # at frequencies without a stable motion of any case
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
        return np.nanquantile(amplitude, levels, axis=0, method="inverted_cdf")


def _stable_count(curve: Array, Omega: Array) -> Array:
    """Return the number of stable motions (P,) of a curve."""
    count = np.zeros(len(Omega), dtype=int)
    for x, _ in stable_segments(curve):
        count += (x[0] <= Omega) & (x[-1] >= Omega)
    return count


def sweep_responses(found: Cases, Omega: Array, direction: int) -> SweepResponses:
    """Return the response of each case to a slow sweep with Omega rising (+1) or falling (-1).

    Omega (P,) or (cases, P) are ascending values, common to all curves or one row for each. ValueError is raised if no
    curve with a stable motion is stored.
    """
    has_jumps = "jumps" in found.work.compute
    responses = []
    rows = np.broadcast_to(Omega, (len(found.curves), np.shape(Omega)[-1]))
    for (case, curve), frequencies in zip(found.curves.items(), rows, strict=True):
        jumps = found.jumps[(found.jumps[:, 0] == case) & (found.jumps[:, 2] == direction)][:, [1, 3, 4]]
        known_jumps = jumps if has_jumps else None
        responses.append(sweep_response(curve, known_jumps, frequencies, direction, interpolate_along))
    if not any(np.isfinite(amplitude).any() for amplitude, _ in responses):
        raise ValueError("there are no curves with stable motions; compute them: compute=('curve',)")
    return SweepResponses(*(np.array(column) for column in zip(*responses, strict=True)))


Interpolation = Callable[[Array, Array, Array], Array]
"""Function of some values of Omega, and of Omega, ascending, and amplitude at the points of a segment."""


def sweep_response(
    curve: Array, jumps: Array | None, Omega: Array, direction: int, interpolate: Interpolation = np.interp
) -> tuple[Array, Array]:
    """Return amplitudes and numbers of jumps up to each of the ascending values of Omega, for a direction of the sweep.

    ``curve`` (3, P) has Omega, amplitude and stability (1 or 0); a column of nan separates curves. ``jumps`` (J, 3) has
    Omega and the amplitudes before and after each jump in this direction. With None, a segment that ends at a frequency
    of other stable segments is assumed to end in a jump to the nearest one. ``interpolate`` is used between the points
    of a segment.
    """
    segments = [(direction * x, y) for x, y in stable_segments(curve)]
    segments = [(x[::direction], y[::direction]) for x, y in segments]
    frequencies = (direction * Omega)[::direction]
    amplitude, count = np.full(len(frequencies), np.nan), np.zeros(len(frequencies))
    tolerance = JUMP_TOLERANCE * float(np.nanmax(curve[0]) - np.nanmin(curve[0]))
    segment, start, jump_count = min(segments, key=lambda part: part[0][0], default=None), -np.inf, 0
    while segment is not None:
        x, y = segment
        within = (frequencies >= max(start, x[0])) & (frequencies <= x[-1])
        amplitude[within] = interpolate(frequencies[within], x, y)
        start = x[-1]
        count[frequencies > start] = jump_count
        segment, jumped = _next_segment(segments, segment, _amplitude_after(jumps, direction * start, tolerance))
        jump_count += jumped
        count[frequencies > start] = jump_count
    return amplitude[::direction], count[::direction]


def stable_segments(curve: Array) -> Iterator[tuple[Array, Array]]:
    """Yield Omega, ascending, and amplitude of each stable segment between folds; a fold belongs to both neighbours."""
    separators = np.flatnonzero(np.isnan(curve[0]))
    for part in np.split(curve, separators, axis=1):
        yield from _curve_segments(part[:, np.isfinite(part[0])])


def _curve_segments(curve: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the stable segments of a single curve."""
    values, amplitude, stable = curve
    steps = np.sign(np.diff(values))
    fold = np.zeros(len(values), dtype=bool)
    fold[1:-1] = steps[1:] != steps[:-1]
    is_stable = stable.astype(bool)
    direction = steps * ((is_stable[:-1] | fold[:-1]) & (is_stable[1:] | fold[1:]) & (is_stable[:-1] | is_stable[1:]))
    for first, last in pairwise([0, *(np.flatnonzero(np.diff(direction)) + 1), len(direction)]):
        if first < last and direction[first]:
            points = slice(first, last + 1)
            step = int(direction[first])
            yield values[points][::step], amplitude[points][::step]


def _amplitude_after(jumps: Array | None, Omega: float, tolerance: float) -> float | None:
    """Return the amplitude after the jump at the end of a segment: nan if it is unknown, None without a jump."""
    if jumps is None:
        return np.nan
    candidates = [jump for jump in jumps if abs(jump[0] - Omega) <= tolerance]
    return float(min(candidates, key=lambda jump: abs(jump[0] - Omega))[2]) if candidates else None


def _next_segment(
    segments: list[tuple[Array, Array]], segment: tuple[Array, Array], after: float | None
) -> tuple[tuple[Array, Array] | None, int]:
    """Return the segment that follows the end of a segment, or None, and 1 if the sweep jumped to it, else 0."""
    end, height = segment[0][-1], segment[1][-1]
    candidates = [part for part in segments if part is not segment and part[0][0] <= end < part[0][-1]]
    if candidates and after is not None:
        target = height if np.isnan(after) else after
        return min(candidates, key=lambda part: abs(float(np.interp(end, *part)) - target)), 1
    later = [part for part in segments if part[0][0] > end]
    return min(later, key=lambda part: part[0][0], default=None), int(after is not None and not np.isnan(after))
