"""Displacements within a step: the instants at which elements leave their segments, and samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.compiling import kernel
from hbgear.time.exponential.kernels.breakpoints import level_at, level_slope_at
from hbgear.time.exponential.kernels.data import Method, Plan, Work
from hbgear.time.exponential.segments import BREAKPOINT_TOLERANCE, SAMPLES_PER_STEP, Integers


@kernel
def may_leave(arguments: Any) -> bool:
    """Return whether any element or contact may leave its segment; ``exits`` are 0 for these and inf for the others."""
    nodes, y, d, v, owner, levels, segment, low, high, h, span, exits = arguments
    any_may_leave = False
    h *= span[1]
    for j in range(len(segment)):
        exits[j] = np.inf
        if _may_leave_segment(nodes, y, d, v, j, owner[j], levels, low[j, segment[j]], high[j, segment[j]], h):
            exits[j], any_may_leave = 0.0, True
    return any_may_leave


@kernel
def exit_arguments(plan: Plan, method: Method, d: Array, v: Array, segment: Integers, work: Work) -> Any:
    """Return the arguments of `may_leave`, and those of `first_exit` in addition, for rows of the plan and the work."""
    step = method.nodes, work.y, d, v, method.owner, work.levels, segment, plan.low, plan.high, plan.h, work.span
    return (*step, work.exits), (work.side, work.samples, method.dense, method.values, method.slopes)


@kernel
def _may_leave_segment(
    nodes: Array, y: Array, d: Array, v: Array, row: int, j: int, levels: Array, low: float, high: float, h: float
) -> bool:
    """Return whether a displacement is beyond an end of its segment at a node, or may be between two nodes.

    Between two nodes d exceeds both values at most by a quarter of the interval times the change of the rate. The test
    allows for more than twice that, and for nothing where the rate is large and of one sign at both nodes.
    """
    m, is_contact = len(d), row != j
    x0, d0, v0 = 0.0, d[j], v[j]
    if is_contact:
        d0, v0 = d0 - levels[row, 0], v0 - levels[row, 1] / h
    rate = abs(v0)
    for i in range(len(nodes)):
        v1 = y[i * 2 * m + m + j] - (level_slope_at(levels, row, nodes[i]) / h if is_contact else 0.0)
        rate = max(rate, abs(v1))
    for i in range(len(nodes)):
        d1, v1 = y[i * 2 * m + j], y[i * 2 * m + m + j]
        if is_contact:
            d1, v1 = d1 - level_at(levels, row, nodes[i]), v1 - level_slope_at(levels, row, nodes[i]) / h
        if d1 > high or d1 < low:
            return True
        if not (v0 * v1 > 0.0 and min(abs(v0), abs(v1)) > 0.5 * rate):
            excursion = h * (nodes[i] - x0) * (0.5 * abs(v1 - v0) + 0.1 * rate)
            if max(d0, d1) + excursion > high or min(d0, d1) - excursion < low:
                return True
        x0, d0, v0 = nodes[i], d1, v1
    return False


@kernel
def first_exit(arguments: Any, tables: Any) -> int:
    """Return the element or contact that first leaves its segment, or -1; ``exits`` and ``side`` are the exits of all.

    ``exits`` are in units of the step, inf without exit. Only rows with a finite value are tested, see `may_leave`.
    """
    nodes, y, d, v, owner, levels, segment, low, high, h, span, exits = arguments
    side, samples, dense, values, slopes = tables
    first = -1
    h *= span[1]
    c, gaps, rates, data = samples[0], samples[1], samples[2], samples[3]
    for j in range(len(segment)):
        if exits[j] == np.inf:
            continue
        _end_values(y, d[owner[j]], v[owner[j]], h, owner[j], len(d), data)
        if j >= len(d):
            _subtract_level(nodes, levels, j, data)
        _apply(values, data, gaps)
        _apply(slopes, data, rates)
        _apply(dense, data, c)
        size, ends = abs(d[owner[j]]), (low[j, segment[j]], high[j, segment[j]])
        exits[j], side[j] = _exit_of_element(c, len(dense), gaps, rates, ends[0], ends[1], size)
        if exits[j] < np.inf and (first < 0 or exits[j] < exits[first]):
            first = j
    return first


@kernel
def _subtract_level(nodes: Array, levels: Array, j: int, data: Array) -> None:
    """Subtract a level and its slope at 0, the Gauss points and 1 from the values of `_end_values`."""
    count = len(nodes) + 1
    data[0] -= levels[j, 0]
    data[count] -= levels[j, 1]
    for i in range(count - 1):
        data[1 + i] -= level_at(levels, j, nodes[i])
        data[count + 1 + i] -= level_slope_at(levels, j, nodes[i])


@kernel
def _end_values(y: Array, d: float, v: float, h: float, j: int, m: int, data: Array) -> None:
    """Store d and h v of element j at 0, the Gauss points and 1."""
    count = len(y) // (2 * m) + 1
    data[0], data[count] = d, h * v
    for i in range(count - 1):
        data[1 + i], data[count + 1 + i] = y[i * 2 * m + j], h * y[i * 2 * m + m + j]


@kernel
def _apply(columns: Array, data: Array, out: Array) -> None:
    """Store the product of data and a matrix given by rows."""
    for e in range(columns.shape[1]):
        out[e] = columns[0, e] * data[0]
    for a in range(1, len(columns)):
        for e in range(columns.shape[1]):
            out[e] += columns[a, e] * data[a]


@kernel
def _exit_of_element(c: Array, n: int, d: Array, v: Array, low: float, high: float, size: float) -> tuple[float, int]:
    """Return where in the step a motion first leaves (low, high), inf if nowhere, and through which end (-1, +1, 0).

    c (n,) are its Chebyshev coefficients, d and v its values at SAMPLES_PER_STEP + 1 equidistant instants. The extrema
    between them are evaluated in addition, so that short excursions beyond a breakpoint are detected. The start is
    inside, to the rounding of displacements of a given ``size``.
    """
    for i in range(SAMPLES_PER_STEP + 1):
        size = max(size, abs(d[i]), abs(v[i]))
    tolerance = BREAKPOINT_TOLERANCE * size
    x0, y0 = 0.0, d[0]
    for i in range(SAMPLES_PER_STEP):
        for part in range(2):
            if part == 0:
                if not v[i] * v[i + 1] < 0:
                    continue
                x = (i + v[i] / (v[i] - v[i + 1])) / SAMPLES_PER_STEP  # an extremum between samples, to first order
                y = value(c, n, x)
            else:
                x, y = (i + 1.0) / SAMPLES_PER_STEP, d[i + 1]
            if y > high + tolerance:
                return _root(c, n, high, x0, x, y0 - high, y - high), 1
            if y < low - tolerance:
                return _root(c, n, low, x0, x, y0 - low, y - low), -1
            x0, y0 = x, y
    return np.inf, 0


@kernel
def _root(c: Array, n: int, level: float, a: float, b: float, fa: float, fb: float) -> float:
    """Return where the motion reaches a level between a and b, by the Illinois method; a if it is already beyond it."""
    if not fa * fb < 0:
        return a
    for _ in range(60):
        x = b - fb * (b - a) / (fb - fa)
        f = value(c, n, x) - level
        if f * fb < 0:
            a, fa = b, fb
        else:  # the end a is kept twice: half its value, else it would be kept for ever
            fa *= 0.5
        change = abs(x - b)
        b, fb = x, f
        if change <= 1e-14 or f == 0:
            break
    return b


@kernel
def value(c: Array, n: int, x: float) -> float:
    """Return the Chebyshev series of n terms at x in (0, 1) by Clenshaw's algorithm."""
    t = 4.0 * x - 2.0
    b_1, b_2 = 0.0, 0.0
    for i in range(n - 1, 0, -1):
        b_1, b_2 = t * b_1 - b_2 + c[i], b_1
    return 0.5 * t * b_1 - b_2 + c[0]


@kernel
def record(
    dense: Array, y: Array, d: Array, v: Array, span: Array, h: float, samples: Array, start: int, b: int, fine: Array
) -> None:
    """Store the samples of the cell that lie in the step."""
    x, length, n = span[0], span[1], len(dense)
    c, slope = samples[0], samples[1]
    for j in range(len(d)):
        _end_values(y, d[j], v[j], length * h, j, len(d), samples[3])
        _apply(dense, samples[3], c)
        slope[n - 1] = slope[n] = 0.0
        for i in range(n - 1, 0, -1):  # of the derivative in x, by the recursion of Chebyshev polynomials
            slope[i - 1] = slope[i + 1] + 4.0 * i * c[i]
        slope[0] *= 0.5
        for i in range(SAMPLES_PER_STEP):
            z = (i / SAMPLES_PER_STEP - x) / max(length, 1e-300)
            if 0.0 <= z < 1.0:
                fine[0, b, j, start + i] = value(c, n, z)
                fine[1, b, j, start + i] = value(slope, n, z) / (length * h)
