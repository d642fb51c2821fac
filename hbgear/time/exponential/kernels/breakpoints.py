"""Breakpoints of the excitation, and the levels of contacts between teeth."""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.compiling import kernel
from hbgear.time.exponential.kernels.data import Breakpoints, Part
from hbgear.time.exponential.kernels.tables import segment_of


@kernel
def set_levels(breakpoints: Breakpoints | None, r: int, part: Part, springs: int, m: int, levels: Array) -> None:
    """Set the levels of all contacts on a part of the period; no breakpoint lies inside."""
    if breakpoints is None:
        return
    x, length, N = part
    starts, rows, unit = breakpoints.starts, breakpoints.rows, 2 * np.pi / N
    width = unit * length
    for j in range(m, len(levels)):
        q = springs + j
        segment = segment_of(starts, r, q, unit * (x + 0.5 * length))
        a, b, f, g = rows[r, q, segment, 0], rows[r, q, segment, 1], rows[r, q, segment, 2], rows[r, q, segment, 3]
        y = unit * x - starts[r, q, segment]
        levels[j, 0] = a + y * (b + y * (f + y * g))
        levels[j, 1] = width * (b + y * (2.0 * f + 3.0 * y * g))
        levels[j, 2] = width * width * (f + 3.0 * y * g)
        levels[j, 3] = width * width * width * g


@kernel
def level_at(levels: Array, j: int, z: float) -> float:
    """Return a level at a part z of the step."""
    return levels[j, 0] + z * (levels[j, 1] + z * (levels[j, 2] + z * levels[j, 3]))


@kernel
def level_slope_at(levels: Array, j: int, z: float) -> float:
    """Return the derivative of a level in the part z of the step."""
    return levels[j, 1] + z * (2.0 * levels[j, 2] + 3.0 * z * levels[j, 3])


@kernel
def next_breakpoint(breakpoints: Breakpoints | None, r: int, cell: int, x: float) -> float:
    """Return the end of the step from x in a cell: the next breakpoint of the excitation, or the end of the cell."""
    if breakpoints is None:
        return 1.0
    for i in range(breakpoints.first[r, cell], breakpoints.first[r, cell + 1]):
        end = breakpoints.position[r, i]
        if end > x + 1e-12:
            return end
    return 1.0


@kernel
def apply_rate_jump(breakpoints: Breakpoints | None, r: int, cell: int, span: Array, v: Array) -> None:
    """Apply the jump of v if the step ends at a breakpoint of the excitation; each breakpoint is applied once."""
    if breakpoints is None:
        return
    end = span[0] + span[1]
    if 1.0 - end <= 1e-12:
        end = 1.0
    for i in range(breakpoints.first[r, cell], breakpoints.first[r, cell + 1]):
        if span[0] + 1e-12 < breakpoints.position[r, i] <= end + 1e-12:
            for j in range(len(v)):
                v[j] -= breakpoints.kink[r, i, j]
