"""Kernels: switching times, at which a periodic motion crosses the breakpoints of a law.

    x(theta) = Re sum_k c_k exp(i k theta) - level

Samples of the motion bracket the crossings. A safeguarded Newton iteration computes each crossing, with values and
derivatives by Horner's rule. The bound |x''| <= bend = sum_k k^2 |c_k| shows between which samples an extremum can
exceed the level, so that there are two crossings without a change of sign of the samples.

References
----------
Petrov & Ewins (2003), J. Turbomach. 125(2), https://doi.org/10.1115/1.1539868, for contact projected exactly.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import inlined, kernel
from hbgear.mechanics.series.fourier_kernels import bend_of, size_of, value_of

VALUE_ROUNDING = 4e-16
"""Value of x - level that counts as zero, relative to the sizes of x and level [-]: about two machine epsilons."""

PHASE_TOLERANCE = 4e-16 * math.pi
"""Error [rad] at which the iteration for a crossing ends: about two machine epsilons at a phase of pi."""

CELL_PARTS = 16
"""Number of parts into which a cell is divided if it may contain three crossings."""


@kernel
def crossings(c: Any, level: float, samples: Any, theta: Any, sign: Any) -> Any:
    """Compute all crossings of a level in a period.

    Parameters
    ----------
    c : ndarray, shape (H + 1,)
        One-sided coefficients of the motion.
    level : float
        Level to be crossed.
    samples : ndarray, shape (N,)
        Samples of the motion at N >= 4H equal steps of the period; the level is not subtracted.
    theta : ndarray, shape (2H + 4,)
        Array to be filled with the phases [rad] of the crossings, ascending in [0, 2 pi].
    sign : ndarray, shape (2H + 4,)
        Array to be filled with +1 for each upward and -1 for each downward crossing.

    Returns
    -------
    int
        Number of crossings.
    """
    N, bend = samples.shape[0], bend_of(c)
    count: Any = np.int64(0)  # a literal would compile each called kernel a second time
    step = 2 * math.pi / N
    sampling_bound = step * step * bend
    rounding = VALUE_ROUNDING * (size_of(c) + abs(level))
    before, first = samples[N - 1] - level, samples[0] - level
    value_i = first = off_level(first, first, rounding)
    for i in range(N):
        after = off_level(samples[i + 1] - level, value_i, rounding) if i + 1 < N else first
        if abs(value_i) <= sampling_bound:
            extremal = (before - value_i) * value_i >= 0.0 and (after - value_i) * value_i >= 0.0
            # an extremum exceeds its nearest sample by about one eighth of the second difference
            if extremal and abs(value_i) <= abs(before - 2 * value_i + after):
                count = _add_crossings_at_extremum(c, level, rounding, bend, i, step, value_i, theta, sign, count)
        if (value_i > 0.0) != (after > 0.0):
            count = _add_crossings_in_cell(c, level, rounding, bend, i, step, value_i, after, theta, sign, count)
        before, value_i = value_i, after
    _sort_by_phase(theta, sign, count)
    return count


@inlined
def off_level(value: float, before: float, rounding: float) -> float:
    """Return x - level of a sample, moved off the level if it lies there within the rounding error.

    Such a sample is moved to the side of the sample before it. A crossing at a sample is then found in one of its two
    cells, and a second crossing in a cell that ends there is not mistaken for the first.
    """
    if abs(value) > rounding:
        return value
    return rounding if before > 0.0 else -rounding


@inlined
def _add_crossings_in_cell(
    c: Any,
    level: float,
    rounding: float,
    bend: float,
    i: int,
    step: float,
    first: float,
    last: float,
    theta: Any,
    sign: Any,
    count: int,
) -> int:
    """Append the crossings between samples i and i + 1 of different signs, one or three; return the new count.

    The cubic through the values and slopes at both ends has the slope 3/2 mean - (slope_low + slope_high) / 4 at the
    middle. If this slope and the mean slope differ in sign, the cell may contain three crossings, and each of its parts
    is searched.
    """
    low, high = step * i, step * (i + 1)
    slope_low, slope_high = value_of(c, level, low)[1], value_of(c, level, high)[1]
    mean = (last - first) / step
    if (1.5 * mean - 0.25 * (slope_low + slope_high)) * mean >= 0:
        return _add_crossing(
            c, level, rounding, bend, low, first, slope_low, high, last, slope_high, theta, sign, count
        )
    a, value_a, slope_a = low, first, slope_low
    for k in range(1, CELL_PARTS + 1):
        b = low + (high - low) * k / CELL_PARTS
        value_b, slope_b, _ = value_of(c, level, b)
        if k == CELL_PARTS:
            value_b = last
        if (value_a > 0.0) != (value_b > 0.0):
            count = _add_crossing(
                c, level, rounding, bend, a, value_a, slope_a, b, value_b, slope_b, theta, sign, count
            )
        a, value_a, slope_a = b, value_b, slope_b
    return count


@inlined
def _add_crossings_at_extremum(
    c: Any,
    level: float,
    rounding: float,
    bend: float,
    i: int,
    step: float,
    value_i: float,
    theta: Any,
    sign: Any,
    count: int,
) -> int:
    """Append the two crossings on both sides of an extremum near sample i that exceeds the level between two samples.

    The extremum is located by Newton's method. Return the new count.
    """
    phase = step * i
    for _ in range(5):
        _, slope, curve = value_of(c, level, phase)
        if curve != 0.0:
            phase += min(step, max(-step, -slope / curve))
    value = value_of(c, level, phase)[0]
    # a value within rounding errors of the level does not count as a crossing
    exceeds = (value > 0.0) != (value_i > 0.0) and abs(value) > rounding
    if not exceeds or abs(phase - step * i) > step:
        return count
    phase %= 2 * math.pi
    low = math.floor(phase / step) * step
    high = low + step
    ends = low, phase, high
    for k in range(2):
        a, b = ends[k], ends[k + 1]
        value_a, slope_a, _ = value_of(c, level, a)
        value_b, slope_b, _ = value_of(c, level, b)
        count = _add_crossing(c, level, rounding, bend, a, value_a, slope_a, b, value_b, slope_b, theta, sign, count)
    return count


@kernel
def _add_crossing(
    c: Any,
    level: float,
    rounding: float,
    bend: float,
    low: float,
    value_low: float,
    slope_low: float,
    high: float,
    value_high: float,
    slope_high: float,
    theta: Any,
    sign: Any,
    count: int,
) -> int:
    """Append the crossing between low and high, where the values differ in sign, and return the new count.

    A step of Newton's method that leaves the bracket is replaced by bisection.
    """
    if count >= theta.shape[0]:
        return count
    rising = value_high > value_low
    phase = _initial_guess(low, value_low, slope_low, high, value_high, slope_high)
    for _ in range(60):
        value, slope, _ = value_of(c, level, phase)
        if abs(value) <= rounding:
            break  # near a double root, Newton's method would diverge on rounding errors
        if (value < 0.0) == rising:
            low = phase
        else:
            high = phase
        updated = phase - value / slope if slope != 0.0 else low
        correction = abs(updated - phase)
        # the error that remains is at most about half of bend correction^2 / |slope|
        if slope != 0.0 and (
            correction <= PHASE_TOLERANCE or bend * correction * correction <= PHASE_TOLERANCE * abs(slope)
        ):
            phase = min(max(updated, low), high)
            break
        phase = updated if low < updated < high else 0.5 * (low + high)
    theta[count], sign[count] = phase, 1 if rising else -1
    return count + 1


@kernel
def _initial_guess(
    low: float, value_low: float, slope_low: float, high: float, value_high: float, slope_high: float
) -> float:
    """Return an initial guess of the crossing by inverse cubic interpolation of the values and slopes at both ends.

    If the slopes do not have the sign of the change of value, or the cubic leaves the interval, interpolate linearly.
    """
    u, mean = value_low / (value_low - value_high), (value_high - value_low) / (high - low)
    s = u
    if mean * slope_low > 0 and mean * slope_high > 0:
        s = u * (u * (3 - 2 * u) + (1 - u) * ((1 - u) * mean / slope_low - u * mean / slope_high))
    return low + (high - low) * (s if 0 < s < 1 else u)


@kernel
def _sort_by_phase(theta: Any, sign: Any, count: int) -> None:
    """Sort crossings by phase; an insertion sort is fast, because they are almost sorted."""
    for i in range(1, count):
        phase, direction, j = theta[i], sign[i], i
        while j > 0 and theta[j - 1] > phase:
            theta[j], sign[j] = theta[j - 1], sign[j - 1]
            j -= 1
        theta[j], sign[j] = phase, direction
