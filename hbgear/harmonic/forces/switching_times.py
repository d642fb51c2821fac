"""Kernels: switching times, at which a periodic motion crosses the breakpoints of a law.

    x(theta) = Re sum_k c_k exp(i k theta) - level

On a segment of a gap with breakpoints in the phase a cubic is added, see `piecewise_kernels`. Samples of the motion
bracket the crossings. A safeguarded Newton iteration computes each crossing, with values and derivatives by Horner's
rule. The bound |x''| <= bend = sum_k k^2 |c_k| shows between which samples an extremum can exceed the level, so that
there are two crossings without a change of sign of the samples.

References
----------
Petrov & Ewins (2003), J. Turbomach. 125(2), https://doi.org/10.1115/1.1539868, for contact projected exactly.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import ComplexArray
from hbgear.common.process.compiling import inlined, kernel
from hbgear.mechanics.series.fourier_kernels import bend_of, size_of, value_of

VALUE_ROUNDING = 4e-16
"""Value of x - level that counts as zero, relative to the sizes of x and level [-]: about two machine epsilons."""

PHASE_TOLERANCE = 4e-16 * math.pi
"""Error [rad] at which the iteration for a crossing ends: about two machine epsilons at a phase of pi."""

CELL_PARTS = 16
"""Number of parts into which a cell is divided if it may contain three crossings."""


class Distance(NamedTuple):
    """Distance x of a motion from a level.

    Attributes
    ----------
    c : ndarray, shape (H + 1,)
        One-sided coefficients of the motion.
    level : float
        Level.
    rounding : float
        Value of x that counts as zero.
    bend : float
        Bound of |x''|.
    """

    c: ComplexArray
    level: float
    rounding: float
    bend: float


@kernel
def distance_of(c: Any, level: float) -> Any:
    """Return the `Distance` of a motion from a level."""
    return Distance(c, level, VALUE_ROUNDING * (size_of(c) + abs(level)), bend_of(c))


MAX_ROOT_ITERATIONS = 80
"""Iterations for a crossing; bisection alone needs 52."""


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
    N, x = samples.shape[0], distance_of(c, level)
    count: Any = np.int64(0)  # a literal would compile each called kernel a second time
    step, rounding = 2 * math.pi / N, x.rounding
    sampling_bound = step * step * x.bend
    before, first = samples[N - 1] - level, samples[0] - level
    value_i = first = off_level(first, first, rounding)
    for i in range(N):
        after = off_level(samples[i + 1] - level, value_i, rounding) if i + 1 < N else first
        if abs(value_i) <= sampling_bound:
            extremal = (before - value_i) * value_i >= 0.0 and (after - value_i) * value_i >= 0.0
            # an extremum exceeds its nearest sample by about one eighth of the second difference
            if extremal and abs(value_i) <= abs(before - 2 * value_i + after):
                count = _add_crossings_at_extremum(x, i, step, value_i, theta, sign, count)
        if (value_i > 0.0) != (after > 0.0):
            low, high = step * i, step * (i + 1)
            begin = low, value_i, value_of(c, level, low)[1]
            end = high, after, value_of(c, level, high)[1]
            count = add_crossings_between(x, None, begin, end, theta, sign, count)
        before, value_i = value_i, after
    sort_by_phase(theta, sign, count)
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


@kernel
def value_at(x: Any, cubic: Any, theta: float) -> tuple[float, float, float]:
    """Return x, x' and x'' at theta.

    cubic : None, or the coefficients (4,) of a polynomial that is added, and the phase at which it begins.
    """
    value, slope, curve = value_of(x.c, x.level, theta)
    if cubic is None:
        return value, slope, curve
    a, y = cubic[0], theta - cubic[1]
    value += a[0] + y * (a[1] + y * (a[2] + y * a[3]))
    slope += a[1] + y * (2.0 * a[2] + 3.0 * y * a[3])
    curve += 2.0 * a[2] + 6.0 * y * a[3]
    return value, slope, curve


@kernel
def add_crossings_between(x: Any, cubic: Any, low: Any, high: Any, theta: Any, sign: Any, count: int) -> int:
    """Append the crossings between two phases where x differs in sign, one or three; return the new count.

    low, high : phase, x and x' at both ends. The cubic through them has the slope 3/2 mean - (slope_low + slope_high) /
    4 at the middle. If this slope and the mean slope differ in sign, there may be three crossings, and each of
    `CELL_PARTS` parts is searched.
    """
    mean = (high[1] - low[1]) / (high[0] - low[0])
    if (1.5 * mean - 0.25 * (low[2] + high[2])) * mean >= 0:
        return add_crossing(x, cubic, low, high, theta, sign, count)
    a = low
    for k in range(1, CELL_PARTS + 1):
        phase = low[0] + (high[0] - low[0]) * k / CELL_PARTS
        value, slope, _ = value_at(x, cubic, phase)
        b = phase, high[1] if k == CELL_PARTS else value, slope
        if (a[1] > 0.0) != (b[1] > 0.0):
            count = add_crossing(x, cubic, a, b, theta, sign, count)
        a = b
    return count


@inlined
def _add_crossings_at_extremum(x: Any, i: int, step: float, value_i: float, theta: Any, sign: Any, count: int) -> int:
    """Append the two crossings on both sides of an extremum near sample i that exceeds the level between two samples.

    The extremum is located by Newton's method. Return the new count.
    """
    phase = step * i
    for _ in range(5):
        _, slope, curve = value_of(x.c, x.level, phase)
        if curve != 0.0:
            phase += min(step, max(-step, -slope / curve))
    value = value_of(x.c, x.level, phase)[0]
    # a value within rounding errors of the level does not count as a crossing
    exceeds = (value > 0.0) != (value_i > 0.0) and abs(value) > x.rounding
    if not exceeds or abs(phase - step * i) > step:
        return count
    phase %= 2 * math.pi
    low = math.floor(phase / step) * step
    ends = low, phase, low + step
    for k in range(2):
        a, b = ends[k], ends[k + 1]
        value_a, slope_a, _ = value_of(x.c, x.level, a)
        value_b, slope_b, _ = value_of(x.c, x.level, b)
        count = add_crossing(x, None, (a, value_a, slope_a), (b, value_b, slope_b), theta, sign, count)
    return count


@kernel
def add_crossing(x: Any, cubic: Any, low: Any, high: Any, theta: Any, sign: Any, count: int) -> int:
    """Append the crossing between low and high, where the values differ in sign, and return the new count."""
    if count >= theta.shape[0]:
        return count
    rising = high[1] > low[1]
    theta[count] = root(x, cubic, rising, low[0], high[0], _initial_guess(*low, *high))
    sign[count] = 1 if rising else -1
    return count + 1


@kernel
def root(x: Any, cubic: Any, rising: bool, low: float, high: float, phase: float) -> float:
    """Return the phase of the crossing between low and high by Newton's method from a phase.

    A step that leaves the bracket is replaced by bisection.
    """
    for _ in range(MAX_ROOT_ITERATIONS):
        value, slope, _ = value_at(x, cubic, phase)
        if abs(value) <= x.rounding:
            break  # near a double root, Newton's method would diverge on rounding errors
        if (value < 0.0) == rising:
            low = phase
        else:
            high = phase
        updated = phase - value / slope if slope != 0.0 else low
        correction = abs(updated - phase)
        # the error that remains is at most about half of bend correction^2 / |slope|
        if slope != 0.0 and (
            correction <= PHASE_TOLERANCE or x.bend * correction * correction <= PHASE_TOLERANCE * abs(slope)
        ):
            return min(max(updated, low), high)
        phase = updated if low < updated < high else 0.5 * (low + high)
    return phase


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
def sort_by_phase(theta: Any, value: Any, count: int) -> None:
    """Sort phases and the values at them; an insertion sort is fast, because they are almost sorted."""
    for i in range(1, count):
        phase, current, j = theta[i], value[i], i
        while j > 0 and theta[j - 1] > phase:
            theta[j], value[j] = theta[j - 1], value[j - 1]
            j -= 1
        theta[j], value[j] = phase, current
