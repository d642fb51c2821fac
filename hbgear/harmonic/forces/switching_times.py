"""Kernels: switching times, at which a periodic motion crosses the breakpoints of a law.

    x(theta) = Re sum_k c_k exp(i k theta) - level

Samples on a grid bracket the crossings; a safeguarded Newton iteration with Horner's rule computes them. The second
derivative of x is at most bend = sum_k k^2 |c_k|. With this bound the extrema between two samples that may cross the
level are detected.

References
----------
Petrov & Ewins (2003), J. Turbomach. 125(2), https://doi.org/10.1115/1.1539868, for exact contact projection.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import kernel
from hbgear.mechanics.series.fourier_kernels import bend_of, value_of

ROUNDING = 4e-16  # relative size of a value that counts as zero

CLOSE = 4e-16 * math.pi  # distance of phases that count as equal [rad]

PARTS = 16  # parts into which a cell is divided that may contain three crossings


@kernel
def crossings(c: Any, level: float, samples: Any, theta: Any, sign: Any) -> Any:
    """Fill theta with all crossings of a level, ascending, and sign with +1 (upwards) or -1; return their number.

    c (H + 1,) : one-sided coefficients. samples (N,) : values of the function without the level, N >= 4H. theta and
    sign hold at least 2H + 4 numbers.
    """
    N, bend = samples.shape[0], bend_of(c)
    count: Any = np.int64(0)  # a literal would compile each called kernel a second time
    step = 2 * math.pi / N
    near = step * step * bend
    for i in range(N):
        here, after = samples[i] - level, samples[i + 1 if i + 1 < N else 0] - level
        if abs(here) <= near and here != 0.0:
            before = samples[i - 1 if i else N - 1] - level
            toward = (before - here) * here >= 0.0 and (after - here) * here >= 0.0
            # an extremum of a smooth function exceeds the nearest sample by about an eighth of the second difference
            if toward and abs(here) <= abs(before - 2 * here + after):
                count = _beside(c, level, bend, i, step, here, theta, sign, count)
        if (here > 0.0) != (after > 0.0):
            count = _in_cell(c, level, bend, i, step, here, after, theta, sign, count)
    _sort(theta, sign, count)
    return count


@kernel
def _in_cell(
    c: Any, level: float, bend: float, i: int, step: float, first: float, last: float, theta: Any, sign: Any, count: int
) -> int:
    """Append the crossings between samples i and i + 1, whose signs differ: one, or three.

    The cubic through the values and slopes at the ends has in the middle the slope 3/2 of the mean slope minus a
    quarter of the sum of the end slopes. If its sign is opposite to the change, the cell is divided into parts.
    """
    low, high = step * i, step * (i + 1)
    slope_low, slope_high = value_of(c, level, low)[1], value_of(c, level, high)[1]
    mean = (last - first) / step
    if (1.5 * mean - 0.25 * (slope_low + slope_high)) * mean >= 0:
        return _add(c, level, bend, low, first, slope_low, high, last, slope_high, theta, sign, count)
    a, value_a, slope_a = low, first, slope_low
    for k in range(1, PARTS + 1):
        b = low + (high - low) * k / PARTS
        value_b, slope_b, _ = value_of(c, level, b)
        if k == PARTS:
            value_b = last
        if (value_a > 0.0) != (value_b > 0.0):
            count = _add(c, level, bend, a, value_a, slope_a, b, value_b, slope_b, theta, sign, count)
        a, value_a, slope_a = b, value_b, slope_b
    return count


@kernel
def _beside(
    c: Any, level: float, bend: float, i: int, step: float, here: float, theta: Any, sign: Any, count: int
) -> int:
    """Append two crossings between samples i - 1, i, i + 1 of equal sign, if an extremum passes the level."""
    at = step * i
    for _ in range(5):
        _, slope, curve = value_of(c, level, at)
        if curve != 0.0:
            at += min(step, max(-step, -slope / curve))
    value = value_of(c, level, at)[0]
    past = value * here < 0.0 and abs(value) > ROUNDING * (1.0 + abs(level))  # a distance below rounding is no contact
    if not past or abs(at - step * i) > step:
        return count
    at %= 2 * math.pi
    low = math.floor(at / step) * step
    high = low + step
    ends = low, at, high
    for k in range(2):
        a, b = ends[k], ends[k + 1]
        value_a, slope_a, _ = value_of(c, level, a)
        value_b, slope_b, _ = value_of(c, level, b)
        count = _add(c, level, bend, a, value_a, slope_a, b, value_b, slope_b, theta, sign, count)
    return count


@kernel
def _add(
    c: Any, level: float, bend: float, low: float, value_low: float, slope_low: float,
    high: float, value_high: float, slope_high: float, theta: Any, sign: Any, count: int,
) -> int:  # fmt: skip
    """Append the root between low and high, where the values differ in sign, by a safeguarded Newton iteration."""
    if count >= theta.shape[0]:
        return count
    rising = value_high > value_low
    at = _guess(low, value_low, slope_low, high, value_high, slope_high)
    for _ in range(60):
        value, slope, _ = value_of(c, level, at)
        if abs(value) <= ROUNDING * (1.0 + abs(level)):  # rounding near a double root would make Newton diverge
            break
        if (value < 0.0) == rising:
            low = at
        else:
            high = at
        new = at - value / slope if slope != 0.0 else low
        move = abs(new - at)
        if slope != 0.0 and (
            move <= CLOSE or bend * move * move <= CLOSE * abs(slope)
        ):  # the error after this step is half of that
            at = min(max(new, low), high)
            break
        at = new if low < new < high else 0.5 * (low + high)
    theta[count], sign[count] = at, 1 if rising else -1
    return count + 1


@kernel
def _guess(low: float, value_low: float, slope_low: float, high: float, value_high: float, slope_high: float) -> float:
    """Return the root of the cubic theta(value) through both ends with their slopes, or of the secant."""
    u, mean = value_low / (value_low - value_high), (value_high - value_low) / (high - low)
    s = u
    if mean * slope_low > 0 and mean * slope_high > 0:
        s = u * (u * (3 - 2 * u) + (1 - u) * ((1 - u) * mean / slope_low - u * mean / slope_high))
    return low + (high - low) * (s if 0 < s < 1 else u)


@kernel
def _sort(theta: Any, sign: Any, count: int) -> None:
    """Sort the phases in ascending order by insertion, because they are nearly sorted."""
    for i in range(1, count):
        at, way, j = theta[i], sign[i], i
        while j > 0 and theta[j - 1] > at:
            theta[j], sign[j] = theta[j - 1], sign[j - 1]
            j -= 1
        theta[j], sign[j] = at, way
