"""Kernels: gaps that are sums of trigonometric and piecewise polynomials, and integrals over parts of a period.

    x(theta) = Re sum_k c_k exp(i k theta) + w(theta) - level,      w = sum_q rows[i, q] (theta - at[i])^q on segment i

Each segment is divided into cells of the length of the sampling step. x is smooth in each cell, so that crossings and
extrema are computed as in `crossings`. The arrays are those of `Corners`; `hbgear.mechanics.series.periodic` explains
the moments. For a model without breakpoints the arrays are None, and the code for them is not compiled.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import kernel
from hbgear.harmonic.forces.switching_times import CLOSE, PARTS, ROUNDING, crossings
from hbgear.mechanics.series.fourier_kernels import highest, put_waves, sampled, value_of
from hbgear.mechanics.series.periodic import PARTS as BY_PARTS
from hbgear.mechanics.series.periodic import rule

_NODES, _WEIGHTS = rule()


@kernel
def put_gap(corners: Any, row: Any, j: int, c: Any) -> None:
    """Fill c with the one-sided coefficients of displacement j of an element whose motion is a row (2H + 1,).

    They are the harmonics of the motion and the kept harmonics of a prescribed displacement with breakpoints. The rest
    of the displacement is piecewise polynomial.
    """
    put_waves(row, c)
    if corners is None:
        return
    if corners.moves[j] < corners.moves[j + 1]:
        for k in range(min(row.shape[0] // 2 + 1, corners.kept.shape[0])):
            c[k] += corners.kept[k, j]


@kernel
def in_pieces(corners: Any, j: int) -> bool:
    """Return whether displacement j has segments."""
    if corners is None:
        return False
    return bool(corners.moves[j] < corners.moves[j + 1])


@kernel
def sizes_of(corners: Any) -> tuple[int, int, int]:
    """Return the numbers of breakpoints, of segments of the displacement with the most, and of coefficients."""
    if corners is None:
        return 0, 0, 0
    most = corners.moves[1] - corners.moves[0]
    for j in range(corners.moves.shape[0] - 1):
        most = max(most, corners.moves[j + 1] - corners.moves[j])
    return corners.phases.shape[0], most, corners.pulled.shape[1]


@kernel
def sampled_gap(numbers: Any, row: Any, j: int, c: Any, samples: Any) -> None:
    """Apply `put_gap`, and compute the samples (N,) of a displacement without segments."""
    put_gap(numbers.corners, row, j, c)
    if not in_pieces(numbers.corners, j):
        sampled(row, numbers.basis, samples)


@kernel
def highest_gap(corners: Any, j: int, side: float, c: Any, samples: Any) -> tuple[float, float]:
    """Return the largest value of side (+1 or -1) times displacement j, and its phase; see `sampled_gap`."""
    if corners is not None:
        first, last = corners.moves[j], corners.moves[j + 1]
        if first < last:
            return highest_on(c, corners.at, corners.rows, corners.broken, first, last, samples.shape[0], side)
    return highest(c, samples, side)


@kernel
def crossings_of(corners: Any, j: int, level: float, c: Any, samples: Any, theta: Any, sign: Any) -> tuple[int, bool]:
    """Apply `crossings` to displacement j; return their number and whether it is above the level at phase 0."""
    if corners is not None:
        first, last = corners.moves[j], corners.moves[j + 1]
        if first < last:
            return crossings_on(c, level, corners.at, corners.rows, first, last, samples.shape[0], theta, sign)
    return crossings(c, level, samples, theta, sign), samples[0] > level


@kernel
def fill_motion(c: Any, motion: Any) -> float:
    """Fill ``motion`` (2, N) with values and slopes at N samples; return a bound of the alternating part."""
    N, bound = motion.shape[1], 0.0
    for n in range(N):
        motion[0, n], motion[1, n], _ = value_of(c, 0.0, 2 * math.pi * n / N)
    for k in range(1, c.shape[0]):
        bound += abs(c[k])
    return bound


@kernel
def crossings_of_moving(
    corners: Any, j: int, c: Any, bound: float, motion: Any, theta: Any, sign: Any
) -> tuple[int, bool]:
    """Fill theta with the ascending zeros of a displacement with a moving level, and sign with +1 (upwards) or -1.

    Cells end at the samples of the motion and at the ends of segments. On idle segments crossings have no effect;
    only the sign at the end is recorded. A jump through zero is a crossing. ``bound`` and ``motion`` are those of
    `fill_motion`. Return the number of zeros, and whether the displacement is positive at phase 0.
    """
    if corners is None:
        return 0, False
    mean = c[0].real
    if mean - bound + corners.bounds[j, 0] > 0.0:
        return 0, True
    if mean + bound + corners.bounds[j, 1] < 0.0:
        return 0, False
    first, last, at, rows, N = corners.moves[j], corners.moves[j + 1], corners.at, corners.rows, motion.shape[1]
    count: Any = np.int64(0)  # a literal would compile each called kernel a second time
    step = 2 * math.pi / N
    before, slope, _ = value_on(c, 0.0, rows[first], at[first], 0.0)
    above = before > 0.0
    for i in range(first, last):
        end = at[i + 1] if i + 1 < last else 2 * math.pi
        if i > first:
            value, slope, _ = value_on(c, 0.0, rows[i], at[i], at[i])
            if corners.broken[i]:
                count = _add_jump(before, value, at[i], theta, sign, count)
                before = value
        if corners.idle[i]:
            value = value_on(c, 0.0, rows[i], at[i], end)[0]
            count = _add_jump(before, value, at[i], theta, sign, count)
            before = value
            continue
        a, n = at[i], int(at[i] / step) + 1
        while a < end:
            b = step * n
            if b < end - 1e-9 * step and n < N:
                y = b - at[i]
                after = motion[0, n] + rows[i, 0] + y * (rows[i, 1] + y * (rows[i, 2] + y * rows[i, 3]))
                slope_after = motion[1, n] + rows[i, 1] + y * (2.0 * rows[i, 2] + 3.0 * y * rows[i, 3])
            else:
                b = end
                after, slope_after, _ = value_on(c, 0.0, rows[i], at[i], end)
            count = _in_cell(c, 0.0, rows[i], at[i], a, before, slope, b, after, slope_after, theta, sign, count)
            a, before, slope = b, after, slope_after
            n += 1
    return count, above


@kernel
def _add_jump(before: float, after: float, at: float, theta: Any, sign: Any, count: int) -> int:
    """Append a phase if two values there differ in sign."""
    if (before > 0.0) == (after > 0.0) or count >= theta.shape[0]:
        return count
    theta[count], sign[count] = at, 1 if after > before else -1
    return count + 1


@kernel
def piece_of(at: Any, first: int, last: int, theta: float) -> int:
    """Return the segment, of those from first to last, that contains a phase in [0, 2 pi]."""
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if at[middle] <= theta:
            low = middle
        else:
            high = middle
    return low


@kernel
def polynomial(row: Any, x: float) -> float:
    """Return the value of a polynomial."""
    total: float = 0.0
    for q in range(row.shape[0] - 1, -1, -1):
        total = total * x + row[q]
    return total


@kernel
def value_on(c: Any, level: float, row: Any, start: float, theta: float) -> tuple[float, float, float]:
    """Return x, x' and x'' on the segment with these coefficients that begins at ``start``."""
    value, slope, curve = value_of(c, level, theta)
    y = theta - start
    value += row[0] + y * (row[1] + y * (row[2] + y * row[3]))
    slope += row[1] + y * (2.0 * row[2] + 3.0 * y * row[3])
    curve += 2.0 * row[2] + 6.0 * y * row[3]
    return value, slope, curve


@kernel
def crossings_on(
    c: Any, level: float, at: Any, rows: Any, first: int, last: int, N: int, theta: Any, sign: Any
) -> tuple[int, bool]:
    """Fill theta with the ascending crossings of a level, and sign with +1 (upwards) or -1, in at least N cells.

    Return their number, and whether x is above the level at phase 0.
    """
    count: Any = np.int64(0)  # a literal would compile each called kernel a second time
    before = start = value_on(c, level, rows[first], at[first], 0.0)[0]
    for i in range(first, last):
        end = at[i + 1] if i + 1 < last else 2 * math.pi
        cells = max(1, math.ceil((end - at[i]) * N / (2 * math.pi)))
        a, slope = at[i], value_on(c, level, rows[i], at[i], at[i])[1]
        for n in range(1, cells + 1):
            b = end if n == cells else at[i] + (end - at[i]) * n / cells
            after, slope_after, _ = value_on(c, level, rows[i], at[i], b)
            if n == cells and i + 1 == last:
                after = start  # both ends are the same phase
            count = _in_cell(c, level, rows[i], at[i], a, before, slope, b, after, slope_after, theta, sign, count)
            a, before, slope = b, after, slope_after
    return count, start > 0.0


@kernel
def _in_cell(
    c: Any, level: float, row: Any, start: float, a: float, before: float, slope: float, b: float, after: float,
    slope_after: float, theta: Any, sign: Any, count: int,
) -> int:  # fmt: skip
    """Append the crossings of a cell: one or three if its ends differ in sign, two or none otherwise."""
    if (before > 0.0) != (after > 0.0):
        mean = (after - before) / (b - a)
        if (1.5 * mean - 0.25 * (slope + slope_after)) * mean >= 0.0:
            return _add(c, level, row, start, a, before, b, after, theta, sign, count)
        x, value = a, before
        for k in range(1, PARTS + 1):
            y = a + (b - a) * k / PARTS
            other = after if k == PARTS else value_on(c, level, row, start, y)[0]
            if (value > 0.0) != (other > 0.0):
                count = _add(c, level, row, start, x, value, y, other, theta, sign, count)
            x, value = y, other
        return count
    side = 1.0 if before > 0.0 else -1.0
    if side * slope < 0.0 and side * slope_after > 0.0:
        top = _extremum(c, level, row, start, a, b, -side)
        value = value_on(c, level, row, start, top)[0]
        if side * value < 0.0 and abs(value) > ROUNDING * (1.0 + abs(level)):
            count = _add(c, level, row, start, a, before, top, value, theta, sign, count)
            count = _add(c, level, row, start, top, value, b, after, theta, sign, count)
    return count


@kernel
def _add(
    c: Any, level: float, row: Any, start: float, low: float, value_low: float, high: float, value_high: float,
    theta: Any, sign: Any, count: int,
) -> int:  # fmt: skip
    """Append the root between low and high by a safeguarded Newton iteration that begins at the secant."""
    if count >= theta.shape[0]:
        return count
    rising = value_high > value_low
    at = low + (high - low) * value_low / (value_low - value_high)
    for _ in range(80):
        value, slope, curve = value_on(c, level, row, start, at)
        if abs(value) <= ROUNDING * (1.0 + abs(level)):
            break
        if (value < 0.0) == rising:
            low = at
        else:
            high = at
        new = at - value / slope if slope != 0.0 else low
        move = abs(new - at)
        if slope != 0.0 and (move <= CLOSE or abs(curve) * move * move <= CLOSE * abs(slope)):
            at = min(max(new, low), high)
            break
        at = new if low < new < high else 0.5 * (low + high)
    theta[count], sign[count] = at, 1 if rising else -1
    return count + 1


@kernel
def _extremum(c: Any, level: float, row: Any, start: float, low: float, high: float, side: float) -> float:
    """Return the phase of the maximum of side x between low, where it increases, and high, where it decreases."""
    at = 0.5 * (low + high)
    for _ in range(60):
        _, slope, curve = value_on(c, level, row, start, at)
        if side * slope > 0.0:
            low = at
        else:
            high = at
        new = at - slope / curve if curve != 0.0 else low
        if abs(new - at) <= 1e-9 or slope == 0.0:  # the error of the value is of second order
            return min(max(new, low), high) if slope != 0.0 else at
        at = new if low < new < high else 0.5 * (low + high)
    return at


@kernel
def highest_on(
    c: Any, at: Any, rows: Any, broken: Any, first: int, last: int, N: int, side: float
) -> tuple[float, float]:
    """Return the largest value of side (+1 or -1) times x, and its phase; at a jump both values count."""
    most, place = -math.inf, 0.0
    for i in range(first, last):
        end = at[i + 1] if i + 1 < last else 2 * math.pi
        cells = max(1, math.ceil((end - at[i]) * N / (2 * math.pi)))
        a = at[i]
        value, slope, _ = value_on(c, 0.0, rows[i], at[i], a)
        for n in range(1, cells + 1):
            if side * value > most:
                most, place = side * value, a
            b = end if n == cells else at[i] + (end - at[i]) * n / cells
            after, slope_after, _ = value_on(c, 0.0, rows[i], at[i], b)
            if side * slope > 0.0 and side * slope_after < 0.0:
                top = _extremum(c, 0.0, rows[i], at[i], a, b, side)
                height = side * value_on(c, 0.0, rows[i], at[i], top)[0]
                if height > most:
                    most, place = height, top
            a, value, slope = b, after, slope_after
        if broken[i + 1 if i + 1 < last else first] and side * value > most:
            most, place = side * value, end
    return most, place


@kernel
def spans(corners: Any, spring: int, theta: Any, sign: Any, count: Any, above: Any, A: Any, B: Any, ends: Any) -> bool:
    """Fill A, B with the two-sided coefficients 0, 1, ... of k and k w, both zero where x is below a breakpoint.

    With the integral G_n(theta) of f exp(-i n x) from 0 to theta and sign_j = +1 for an upward crossing at theta_j,
    2 pi f_n = [above at 0] G_n(2 pi) - sum_j sign_j G_n(theta_j). ends (2, Q) is overwritten. Return False, without
    changes, if the spring has no segments.
    """
    if corners is None:
        return False
    first, last = corners.parts[spring], corners.parts[spring + 1]
    if first == last:
        return False
    sums, known = corners.sums, min(A.shape[0], corners.sums.shape[2])
    for n in range(A.shape[0]):
        A[n] = B[n] = 0j
    if above:
        for n in range(known):
            A[n], B[n] = sums[last + spring, 0, n], sums[last + spring, 1, n]
    for j in range(count):
        i = piece_of(corners.begin, first, last, theta[j])
        for n in range(known):
            A[n] -= sign[j] * sums[i + spring, 0, n]
            B[n] -= sign[j] * sums[i + spring, 1, n]
        _add_moments(corners.weight[i], corners.begin[i], theta[j] - corners.begin[i], -sign[j], A, ends)
        _add_moments(corners.pulled[i], corners.begin[i], theta[j] - corners.begin[i], -sign[j], B, ends)
    for n in range(A.shape[0]):
        A[n] /= 2 * math.pi
        B[n] /= 2 * math.pi
    return True


@kernel
def add_pieces(corners: Any, j: int, phases: Any, T: int, gap: Any) -> None:
    """Add the piecewise part of displacement j at the first T phases."""
    if corners is None:
        return
    first, end = corners.moves[j], corners.moves[j + 1]
    for n in range(T if first < end else 0):
        theta = phases[n] % (2 * math.pi)
        i = piece_of(corners.at, first, end, theta)
        gap[n] += polynomial(corners.rows[i], theta - corners.at[i])


@kernel
def weigh(corners: Any, spring: int, phases: Any, T: int, slope: Any) -> None:
    """Multiply slopes at the first T phases by the stiffness of a spring with segments."""
    if corners is None:
        return
    first, end = corners.parts[spring], corners.parts[spring + 1]
    for n in range(T if first < end else 0):
        theta = phases[n] % (2 * math.pi)
        i = piece_of(corners.begin, first, end, theta)
        slope[n] *= polynomial(corners.weight[i], theta - corners.begin[i])


@kernel
def add_contact(corners: Any, laws: Any, spring: int, motion: Any, phases: Any, T: int, out: Any) -> None:
    """Add the slope of a contact with a moving level at the first T phases, ascending over at most two periods."""
    if corners is None:
        return
    first, last = corners.parts[spring], corners.parts[spring + 1]
    j = laws.over[spring]
    begin, end = corners.moves[j], corners.moves[j + 1]
    i, q, before, factor = first, begin, 0.0, laws.series[spring, 0].real
    for n in range(T):
        theta = phases[n] % (2 * math.pi)
        if theta < before:
            i, q = first, begin
        before = theta
        while i + 1 < last and corners.begin[i + 1] <= theta:
            i += 1
        k = factor * polynomial(corners.weight[i], theta - corners.begin[i])
        if k == 0.0:
            continue
        while q + 1 < end and corners.at[q + 1] <= theta:
            q += 1
        x = motion[n] + polynomial(corners.rows[q], theta - corners.at[q])
        out[n] += k * (laws.base[spring, 0] if x <= 0.0 else 1.0 - laws.base[spring, 0])


@kernel
def put_phases(corners: Any, out: Any) -> int:
    """Fill ``out`` with the phases of all breakpoints of the excitation, and return their number."""
    if corners is None:
        return 0
    for i in range(corners.phases.shape[0]):
        out[i] = corners.phases[i]
    return int(corners.phases.shape[0])


@kernel
def integrals(at: Any, rows: Any, out: Any) -> None:
    """Fill ``out`` with int_0^theta f exp(-i n x) dx at the beginnings of the segments of f and at 2 pi."""
    ends = np.empty((2, rows.shape[1]))
    out[0] = 0j
    for i in range(at.shape[0]):
        width = (at[i + 1] if i + 1 < at.shape[0] else 2 * math.pi) - at[i]
        out[i + 1] = out[i]
        _add_moments(rows[i], at[i], width, 1.0, out[i + 1], ends)


@kernel
def _add_moments(row: Any, start: float, width: float, factor: float, out: Any, ends: Any) -> None:
    """Add the integrals of p(x) exp(-i n (start + x)) from 0 to width times a factor; see `moments`."""
    degree = -1
    for q in range(row.shape[0]):
        if row[q] != 0.0:
            degree = q
    if degree < 0 or width <= 0.0:
        return
    few = min(out.shape[0], int(BY_PARTS / width) + 1 if width * out.shape[0] > BY_PARTS else out.shape[0])
    for g in range(_NODES.shape[0]):
        x = width * _NODES[g]
        term = complex(factor * width * _WEIGHTS[g] * polynomial(row, x), 0.0)
        z = complex(math.cos(start + x), -math.sin(start + x))
        for n in range(few):
            out[n] += term
            term *= z
    if few == out.shape[0]:
        return
    here, there = ends[0], ends[1]
    for q in range(degree + 1):
        here[q] = there[q] = 0.0
        for k in range(degree, q - 1, -1):
            many = 1.0
            for i in range(q):
                many *= k - i
            there[q] = there[q] * width + many * row[k]
            if k == q:
                here[q] = many * row[k]
    for n in range(few, out.shape[0]):
        power, begin, end = complex(0.0, -1.0 / n), 0j, 0j
        turn = power
        for q in range(degree + 1):
            begin += power * here[q]
            end += power * there[q]
            power *= turn
        a, b = n * start, n * (start + width)
        out[n] += factor * (begin * complex(math.cos(a), -math.sin(a)) - end * complex(math.cos(b), -math.sin(b)))
