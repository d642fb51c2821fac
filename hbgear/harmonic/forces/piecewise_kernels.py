"""Kernels: crossings, extrema and integrals of the sum of a trigonometric and a piecewise polynomial.

    x(theta) = Re sum_k c_k exp(i k theta) + w(theta) - level
    w(theta) = sum_q coefficients[i, q] (theta - starts[i])^q on segment i

Each segment is divided into cells no longer than the sampling step of the model. x is smooth in each cell, so that its
crossings and extrema are computed as in `hbgear.harmonic.forces.switching_times`. The arrays of segments are described
in `hbgear.harmonic.forces.breakpoints.PiecewiseExcitation`, the integrals in
`hbgear.mechanics.series.piecewise_polynomial.moments`. For a model without breakpoints in the phase, ``piecewise`` is
None, and the code for segments is not compiled.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import kernel
from hbgear.harmonic.forces.switching_times import (
    Distance,
    add_crossing,
    add_crossings_between,
    crossings,
    distance_of,
    off_level,
    value_at,
)
from hbgear.mechanics.series.fourier_kernels import fill_one_sided, highest, sampled
from hbgear.mechanics.series.piecewise_polynomial import MIN_PHASE_BY_PARTS, rule

_NODES, _WEIGHTS = rule()


@kernel
def fill_gap(piecewise: Any, coefficients: Any, j: int, c: Any) -> None:
    """Store the one-sided coefficients of displacement j in the first entries of c; the motion has (2H + 1,) real ones.

    If the prescribed displacement has breakpoints, its harmonics `PiecewiseExcitation.retained` are added. The rest of
    the gap is the piecewise polynomial w.
    """
    fill_one_sided(coefficients, c)
    if piecewise is None:
        return
    if piecewise.gap_offsets[j] < piecewise.gap_offsets[j + 1]:
        for k in range(min(coefficients.shape[0] // 2 + 1, piecewise.retained.shape[0])):
            c[k] += piecewise.retained[k, j]


@kernel
def has_segments(piecewise: Any, j: int) -> bool:
    """Return whether the gap of displacement j has segments."""
    if piecewise is None:
        return False
    return bool(piecewise.gap_offsets[j] < piecewise.gap_offsets[j + 1])


@kernel
def sizes_of(piecewise: Any) -> tuple[int, int, int]:
    """Return the numbers of breakpoints in a period, of segments of a gap at most, and of coefficients."""
    if piecewise is None:
        return 0, 0, 0
    max_segments = piecewise.gap_offsets[1] - piecewise.gap_offsets[0]
    for j in range(piecewise.gap_offsets.shape[0] - 1):
        max_segments = max(max_segments, piecewise.gap_offsets[j + 1] - piecewise.gap_offsets[j])
    return piecewise.phases.shape[0], max_segments, piecewise.gap_force.shape[1]


@kernel
def sampled_gap(piecewise: Any, basis: Any, coefficients: Any, j: int, c: Any, motion: Any) -> float:
    """Call `fill_gap`, and store N samples of the motion in the first row of ``motion`` (2, N).

    If the gap has segments, the second row receives its slopes, and a bound of |x - mean(x)| is returned.
    """
    fill_gap(piecewise, coefficients, j, c)
    if not has_segments(piecewise, j):
        sampled(coefficients, basis, motion[0])
        return 0.0
    bound = 0.0
    for n in range(motion.shape[1]):
        motion[0, n], motion[1, n] = c[0].real, 0.0
    for k in range(1, c.shape[0]):
        a, b = c[k].real, -c[k].imag
        if a != 0.0 or b != 0.0:
            bound += abs(c[k])
            for n in range(motion.shape[1]):
                motion[0, n] += a * basis[2 * k - 1, n] + b * basis[2 * k, n]
                motion[1, n] += k * (b * basis[2 * k - 1, n] - a * basis[2 * k, n])
    return bound


@kernel
def highest_gap(piecewise: Any, j: int, side: float, c: Any, motion: Any) -> tuple[float, float]:
    """Return the largest value of side times the gap of displacement j, side +1 or -1, and its phase.

    c, motion : results of `sampled_gap`.
    """
    if has_segments(piecewise, j):
        return _highest_on(piecewise, j, side, c, motion)
    return highest(c, motion[0], side)


@kernel
def crossings_of(
    piecewise: Any, j: int, level: float, c: Any, bound: float, motion: Any, theta: Any, sign: Any
) -> tuple[int, bool]:
    """Compute the `crossings` of a level by the gap of displacement j.

    Return their number, and whether the gap is above the level at phase 0. c, bound, motion : results of `sampled_gap`.
    """
    if has_segments(piecewise, j):
        return _crossings_on(piecewise, j, level, c, bound, motion, theta, sign)
    return crossings(c, level, motion[0], theta, sign), motion[0, 0] > level


@kernel
def _crossings_on(
    piecewise: Any, j: int, level: float, c: Any, bound: float, motion: Any, theta: Any, sign: Any
) -> tuple[int, bool]:
    """Compute the crossings of a level by a gap with segments: the zeros of x = t + w - level.

    A jump of x that changes its sign is a crossing. On an idle segment all springs have zero stiffness, and only the
    values of x at both ends are compared; a change of sign is then a crossing at the beginning of the segment.

    Parameters
    ----------
    piecewise : PiecewiseExcitation or None
        Segments of the displacements.
    j : int
        Index of the displacement.
    level : float
        Level to be crossed; 0 if w is relative to a moving level.
    c : ndarray, shape (H + 1,)
        One-sided coefficients of t, see `fill_gap`.
    bound : float
        Bound of |t - mean(t)|.
    motion : ndarray, shape (2, N)
        Values and slopes of t, see `sampled_gap`. Its samples and the breakpoints separate the cells.
    theta : ndarray
        Array to be filled with the phases [rad] of the crossings, ascending.
    sign : ndarray
        Array to be filled with +1 for each upward and -1 for each downward crossing.

    Returns
    -------
    count : int
        Number of crossings.
    above : bool
        Whether x is positive at phase 0.
    """
    if piecewise is None:
        return 0, False
    mean = c[0].real - level
    if mean - bound + piecewise.bounds[j, 0] > 0.0:
        return 0, True
    if mean + bound + piecewise.bounds[j, 1] < 0.0:
        return 0, False
    first, last = piecewise.gap_offsets[j], piecewise.gap_offsets[j + 1]
    starts, coefficients = piecewise.gap_starts, piecewise.coefficients
    count: Any = np.int64(0)  # a literal would compile each called kernel a second time
    whole = distance_of(c, level)
    before, slope, _ = value_at(whole, (coefficients[first], starts[first]), 0.0)
    start = before
    for i in range(first, last):
        end = starts[i + 1] if i + 1 < last else 2 * math.pi
        x, cubic = _on_segment(whole, coefficients[i], end - starts[i]), (coefficients[i], starts[i])
        if i > first:
            value, slope, _ = value_at(x, cubic, starts[i])
            if piecewise.has_jump[i]:
                count = _add_jump(before, value, starts[i], theta, sign, count)
                before = value
        if piecewise.inactive[i]:
            value = value_at(x, cubic, end)[0]
            count = _add_jump(before, value, starts[i], theta, sign, count)
            before = value
            continue
        a = starts[i]
        while a < end:
            b, after, slope_after = _cell_end(x, cubic, motion, a, end)
            after = off_level(after, before, x.rounding)
            if b == end and i + 1 == last and not piecewise.has_jump[first]:
                after = start  # the phases 0 and 2 pi have the same value
            low, high = (a, before, slope), (b, after, slope_after)
            count = _add_crossings_in_cell(x, cubic, low, high, theta, sign, count)
            a, before, slope = b, after, slope_after
    return count, start > 0.0


@kernel
def _on_segment(x: Any, a: Any, width: float) -> Any:
    """Return the distance with the bound of |x''| on a segment with the coefficients a (4,) of w."""
    return Distance(x.c, x.level, x.rounding, x.bend + 2.0 * abs(a[2]) + 6.0 * abs(a[3]) * width)


@kernel
def _cell_end(x: Any, cubic: Any, motion: Any, a: float, end: float) -> tuple[float, float, float]:
    """Return the next sample of the motion after a, or the end of the segment, with the value and slope of x there."""
    N, coefficients, start = motion.shape[1], cubic[0], cubic[1]
    step = 2 * math.pi / N
    n = int(a / step * (1.0 + 1e-14)) + 1
    b = step * n
    if n >= N or b >= end - 1e-9 * step:
        value, slope, _ = value_at(x, cubic, end)
        return end, value, slope
    y = b - start
    value = motion[0, n] - x.level + polynomial(coefficients, y)
    slope = motion[1, n] + coefficients[1] + y * (2.0 * coefficients[2] + 3.0 * y * coefficients[3])
    return b, value, slope


@kernel
def _add_jump(before: float, after: float, phase: float, theta: Any, sign: Any, count: int) -> int:
    """Append a crossing at a phase if the values before and after it differ in sign; return the updated count."""
    if (before > 0.0) == (after > 0.0) or count >= theta.shape[0]:
        return count
    theta[count], sign[count] = phase, 1 if after > before else -1
    return count + 1


@kernel
def segment_of(starts: Any, first: int, last: int, theta: float) -> int:
    """Return the index of the segment, from first to last - 1, that contains a phase in [0, 2 pi]."""
    low, high = first, last
    while high - low > 1:
        middle = (low + high) // 2
        if starts[middle] <= theta:
            low = middle
        else:
            high = middle
    return low


@kernel
def polynomial(coefficients: Any, x: float) -> float:
    """Return sum_q coefficients[q] x^q."""
    total = 0.0
    for q in range(coefficients.shape[0] - 1, -1, -1):
        total = total * x + coefficients[q]
    return total


@kernel
def _add_crossings_in_cell(x: Any, cubic: Any, low: Any, high: Any, theta: Any, sign: Any, count: int) -> int:
    """Append the crossings in a cell, and return the updated count; low, high : phase, x and x' at its ends.

    If the values at the ends differ in sign, there are one or three crossings, otherwise two or none.
    """
    if (low[1] > 0.0) != (high[1] > 0.0):
        return add_crossings_between(x, cubic, low, high, theta, sign, count)
    side = 1.0 if low[1] > 0.0 else -1.0
    if side * low[2] < 0.0 and side * high[2] > 0.0:
        phase = _extremum(x, cubic, low[0], high[0], -side)
        value, slope, _ = value_at(x, cubic, phase)
        if side * value < 0.0 and abs(value) > x.rounding:
            count = add_crossing(x, cubic, low, (phase, value, slope), theta, sign, count)
            count = add_crossing(x, cubic, (phase, value, slope), high, theta, sign, count)
    return count


@kernel
def _extremum(x: Any, cubic: Any, low: float, high: float, side: float) -> float:
    """Return the phase of the maximum of side x between low, where side x rises, and high, where it falls."""
    phase = 0.5 * (low + high)
    for _ in range(60):
        _, slope, curve = value_at(x, cubic, phase)
        if side * slope > 0.0:
            low = phase
        else:
            high = phase
        updated = phase - slope / curve if curve != 0.0 else low
        if abs(updated - phase) <= 1e-9 or slope == 0.0:  # the error of the maximum is of second order
            return min(max(updated, low), high) if slope != 0.0 else phase
        phase = updated if low < updated < high else 0.5 * (low + high)
    return phase


@kernel
def _highest_on(piecewise: Any, j: int, side: float, c: Any, motion: Any) -> tuple[float, float]:
    """Return `highest_gap` of a gap with segments.

    The values at the ends of all cells, on both sides of jumps, and at maxima inside are compared.
    """
    if piecewise is None:
        return 0.0, 0.0
    first, last = piecewise.gap_offsets[j], piecewise.gap_offsets[j + 1]
    starts, coefficients = piecewise.gap_starts, piecewise.coefficients
    largest, phase, x = -math.inf, 0.0, Distance(c, 0.0, 0.0, 0.0)
    for i in range(first, last):
        end, cubic = starts[i + 1] if i + 1 < last else 2 * math.pi, (coefficients[i], starts[i])
        a = starts[i]
        value, slope, _ = value_at(x, cubic, a)
        while a < end:
            if side * value > largest:
                largest, phase = side * value, a
            b, after, slope_after = _cell_end(x, cubic, motion, a, end)
            if side * slope > 0.0 and side * slope_after < 0.0:
                peak = _extremum(x, cubic, a, b, side)
                height = side * value_at(x, cubic, peak)[0]
                if height > largest:
                    largest, phase = height, peak
            a, value, slope = b, after, slope_after
        if piecewise.has_jump[i + 1 if i + 1 < last else first] and side * value > largest:
            largest, phase = side * value, end
    return largest, phase


@kernel
def spans(
    piecewise: Any, spring: int, theta: Any, sign: Any, count: Any, above: Any, A: Any, B: Any, ends: Any
) -> bool:
    """Compute the Fourier coefficients of k s and k w s, where s is 1 above a breakpoint of the law and 0 below.

    For f = k or k w and G_n(theta) = int_0^theta f exp(-i n x) dx, the coefficients of f s are

        (1 / 2 pi) ([above at 0] G_n(2 pi) - sum_j sign_j G_n(theta_j))

    Parameters
    ----------
    piecewise : PiecewiseExcitation or None
        Segments of the springs.
    spring : int
        Index of the spring.
    theta : ndarray
        Phases [rad] at which the breakpoint is crossed.
    sign : ndarray
        Directions of the crossings: +1 upwards, -1 downwards.
    count : int
        Number of crossings.
    above : bool
        Whether the gap is above the breakpoint at phase 0.
    A, B : ndarray
        Arrays to be filled with the two-sided coefficients 0, 1, ... of k s and k w s.
    ends : ndarray, shape (2, Q)
        Working memory for derivatives of polynomials.

    Returns
    -------
    bool
        False if the spring has no segments; A and B are then unchanged.
    """
    if piecewise is None:
        return False
    first, last = piecewise.spring_offsets[spring], piecewise.spring_offsets[spring + 1]
    if first == last:
        return False
    sums, length = piecewise.integrals, min(A.shape[0], piecewise.integrals.shape[2])
    row, repeats = piecewise.integral_offsets[spring], piecewise.repeats[spring]
    segments = (last - first) // repeats
    part_row = row + segments
    roots = np.empty(repeats, np.complex128)
    for n in range(repeats):
        roots[n] = complex(math.cos(2 * math.pi * n / repeats), -math.sin(2 * math.pi * n / repeats))
    for n in range(A.shape[0]):
        A[n] = B[n] = 0j
    if above:
        for n in range(0, length, repeats):
            A[n], B[n] = repeats * sums[part_row, 0, n], repeats * sums[part_row, 1, n]
    for j in range(count):
        i = segment_of(piecewise.spring_starts, first, last, theta[j])
        part, segment = (i - first) // segments, (i - first) % segments
        _add_integrals(sums[part_row], sums[row + segment], roots, part, -sign[j], length, A, B)
        _add_moments(
            piecewise.stiffness[i], piecewise.spring_starts[i], theta[j] - piecewise.spring_starts[i], -sign[j], A, ends
        )
        _add_moments(
            piecewise.gap_force[i], piecewise.spring_starts[i], theta[j] - piecewise.spring_starts[i], -sign[j], B, ends
        )
    for n in range(A.shape[0]):
        A[n] /= 2 * math.pi
        B[n] /= 2 * math.pi
    return True


@kernel
def _add_integrals(whole: Any, partial: Any, roots: Any, part: int, factor: float, length: int, A: Any, B: Any) -> None:
    """Add factor times the integrals G_n of k and k w to A and B, for functions that repeat in the period.

    With the width w = 2 pi / R of a part, G_n(part w + x) = exp(-i n part w) G_n(x) + sum_{r < part} exp(-i n r w)
    G_n(w). ``whole`` holds G_n(w), ``partial`` G_n(x), and roots (R,) exp(-i n w).
    """
    repeats, p, q = roots.shape[0], 0, 0  # n and n part, modulo R
    for n in range(length):
        turned, before, gap = roots[q], complex(part, 0.0), 1.0 - roots[p]
        if p > 0:
            before = (1.0 - turned) * gap.conjugate() / (gap.real * gap.real + gap.imag * gap.imag)
        A[n] += factor * (turned * partial[0, n] + before * whole[0, n])
        B[n] += factor * (turned * partial[1, n] + before * whole[1, n])
        p, q = (p + 1) % repeats, (q + part) % repeats


@kernel
def add_segments(piecewise: Any, j: int, phases: Any, T: int, gap: Any) -> None:
    """Add w of displacement j at the first T phases to ``gap``, if it has segments."""
    if piecewise is None:
        return
    first, last = piecewise.gap_offsets[j], piecewise.gap_offsets[j + 1]
    for n in range(T if first < last else 0):
        theta = phases[n] % (2 * math.pi)
        i = segment_of(piecewise.gap_starts, first, last, theta)
        gap[n] += polynomial(piecewise.coefficients[i], theta - piecewise.gap_starts[i])


@kernel
def multiply_stiffness(piecewise: Any, spring: int, phases: Any, T: int, slope: Any) -> None:
    """Multiply slopes at the first T phases by the stiffness of a spring, if it has segments."""
    if piecewise is None:
        return
    first, last = piecewise.spring_offsets[spring], piecewise.spring_offsets[spring + 1]
    for n in range(T if first < last else 0):
        theta = phases[n] % (2 * math.pi)
        i = segment_of(piecewise.spring_starts, first, last, theta)
        slope[n] *= polynomial(piecewise.stiffness[i], theta - piecewise.spring_starts[i])


@kernel
def add_contact(piecewise: Any, laws: Any, spring: int, motion: Any, phases: Any, T: int, out: Any) -> None:
    """Add dp/dd of a contact with a moving level at the first T phases to ``out``.

    The phases ascend over at most two periods. motion (T,) : values of the motion at these phases.
    """
    if piecewise is None:
        return
    first, last = piecewise.spring_offsets[spring], piecewise.spring_offsets[spring + 1]
    j = laws.spring_displacement[spring]
    gap_first, gap_last = piecewise.gap_offsets[j], piecewise.gap_offsets[j + 1]
    i, q, previous, factor = first, gap_first, 0.0, laws.series[spring, 0].real
    for n in range(T):
        theta = phases[n] % (2 * math.pi)
        if theta < previous:
            i, q = first, gap_first
        previous = theta
        while i + 1 < last and piecewise.spring_starts[i + 1] <= theta:
            i += 1
        k = factor * polynomial(piecewise.stiffness[i], theta - piecewise.spring_starts[i])
        if k == 0.0:
            continue
        while q + 1 < gap_last and piecewise.gap_starts[q + 1] <= theta:
            q += 1
        x = motion[n] + polynomial(piecewise.coefficients[q], theta - piecewise.gap_starts[q])
        out[n] += k * (laws.base[spring, 0] if x <= 0.0 else 1.0 - laws.base[spring, 0])


@kernel
def fill_phases(piecewise: Any, out: Any) -> int:
    """Store the phases of all breakpoints of the excitation in ``out``, and return their number."""
    if piecewise is None:
        return 0
    for i in range(piecewise.phases.shape[0]):
        out[i] = piecewise.phases[i]
    return int(piecewise.phases.shape[0])


@kernel
def integrals(starts: Any, coefficients: Any, end: float, out: Any) -> None:
    """Store int_0^theta f exp(-i n x) dx at the beginning of each segment and at ``end`` in ``out`` (T + 1, L).

    f is the piecewise polynomial with the beginnings starts (T,) and the coefficients (T, Q) of its segments.
    """
    ends = np.empty((2, coefficients.shape[1]))
    out[0] = 0j
    for i in range(starts.shape[0]):
        width = (starts[i + 1] if i + 1 < starts.shape[0] else end) - starts[i]
        out[i + 1] = out[i]
        _add_moments(coefficients[i], starts[i], width, 1.0, out[i + 1], ends)


@kernel
def _add_moments(coefficients: Any, start: float, width: float, factor: float, out: Any, ends: Any) -> None:
    """Add factor times int_0^width p(x) exp(-i n (start + x)) dx to out[n]; the method is that of `moments`.

    Low orders n are integrated by Gauss quadrature, the others by parts. ``ends`` is overwritten.
    """
    degree = -1
    for q in range(coefficients.shape[0]):
        if coefficients[q] != 0.0:
            degree = q
    if degree < 0 or width <= 0.0:
        return
    gauss_count = min(
        out.shape[0], int(MIN_PHASE_BY_PARTS / width) + 1 if width * out.shape[0] > MIN_PHASE_BY_PARTS else out.shape[0]
    )
    for g in range(_NODES.shape[0]):
        x = width * _NODES[g]
        term = complex(factor * width * _WEIGHTS[g] * polynomial(coefficients, x), 0.0)
        z = complex(math.cos(start + x), -math.sin(start + x))
        for n in range(gauss_count):
            out[n] += term
            term *= z
    if gauss_count == out.shape[0]:
        return
    derivatives_start, derivatives_end = ends[0], ends[1]
    for q in range(degree + 1):
        derivatives_start[q] = derivatives_end[q] = 0.0
        for k in range(degree, q - 1, -1):
            falling_factorial = 1.0
            for i in range(q):
                falling_factorial *= k - i
            derivatives_end[q] = derivatives_end[q] * width + falling_factorial * coefficients[k]
            if k == q:
                derivatives_start[q] = falling_factorial * coefficients[k]
    phase = gauss_count * start, gauss_count * (start + width)
    z, z_end = complex(math.cos(start), -math.sin(start)), complex(math.cos(start + width), -math.sin(start + width))
    wave, wave_end = complex(math.cos(phase[0]), -math.sin(phase[0])), complex(math.cos(phase[1]), -math.sin(phase[1]))
    for n in range(gauss_count, out.shape[0]):
        power, begin, end = complex(0.0, -1.0 / n), 0j, 0j
        inverse = power
        for q in range(degree + 1):
            begin += power * derivatives_start[q]
            end += power * derivatives_end[q]
            power *= inverse
        out[n] += factor * (begin * wave - end * wave_end)
        wave, wave_end = wave * z, wave_end * z_end
