"""Tables of a step: the linear part, the excitation, and their dependence on the length of the step."""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import kernel
from hbgear.harmonic.multipliers.phi_functions import integrals
from hbgear.time.exponential.kernels.data import Breakpoints, Method, Part, Plan, Tables, Work


@kernel
def tabulate(arguments: Any) -> None:
    """Compute the tables of a step of length span[1] h for zeta and for w at the Gauss points.

    ``arguments`` are those of `table_arguments`. turn, observe, feedback and push are outputs, see `Tables`.
    """
    poles, output, input, h, span, nodes, lagrange = arguments[:7]
    turn, observe, feedback, push, turns, inner, powers, scratch = arguments[7:]
    q, m, s = len(poles), input.shape[1], len(lagrange)
    integrals(poles, span[1] * h, nodes, lagrange, turns, inner, powers)
    for i in range(len(feedback)):
        for e in range(s * m):
            feedback[i, e] = 0.0
    for r in range(q):
        turn[r] = turns[s, r]
        for i in range(s + 1):
            for j in range(s):
                for b in range(m):
                    z = inner[j, i, r] * input[r, b]
                    scratch[0, j * m + b], scratch[1, j * m + b] = z.real, z.imag
            for a in range(2 * m):
                z, c = output[a, r] * turns[i, r], output[a, r]
                observe[r, i * 2 * m + a], observe[q + r, i * 2 * m + a] = z.real, -z.imag
                for e in range(s * m):
                    feedback[i * 2 * m + a, e] += c.real * scratch[0, e] - c.imag * scratch[1, e]
        for e in range(s * m):
            push[e, r], push[e, q + r] = scratch[0, e], scratch[1, e]


@kernel
def evaluate_series(curves: Array, length: float, out: Array) -> None:
    """Evaluate a table of a step of given length, in cells, from its Chebyshev coefficients (D, ...)."""
    x = 2.0 * length - 1.0
    previous, current = x, 1.0
    for e in range(len(out)):
        out[e] = curves[0, e]
    for i in range(1, len(curves)):
        previous, current = current, (2.0 * x * current - previous if i > 1 else x)
        for e in range(len(out)):
            out[e] += current * curves[i, e]


@kernel
def excite(
    steady: ComplexArray, stiffness: ComplexArray, nodes: Array, part: Part, cell: int, drive: Array, k: Array
) -> None:
    """Evaluate steady (L + 1, 2 m) and stiffness (S, K + 1) at the nodes of a part of the period.

    Outputs are drive (C, (s + 1) 2 m) and k (C, s, S), at the given cell.
    """
    columns, (x, length, N) = steady.shape[1], part
    for i in range(len(nodes)):
        tau = 2 * np.pi / N * (x + length * nodes[i])
        base, wave = complex(np.cos(tau), np.sin(tau)), complex(1.0, 0.0)
        for a in range(columns):
            drive[cell, i * columns + a] = 0.0
        for order in range(len(steady)):
            for a in range(columns):
                c = steady[order, a]
                drive[cell, i * columns + a] += c.real * wave.real - c.imag * wave.imag
            wave *= base
        if i == k.shape[1]:
            break
        wave = complex(1.0, 0.0)
        for spring in range(len(stiffness)):
            k[cell, i, spring] = 0.0
        for order in range(stiffness.shape[1]):
            for spring in range(len(stiffness)):
                c = stiffness[spring, order]
                k[cell, i, spring] += c.real * wave.real - c.imag * wave.imag
            wave *= base


@kernel
def add_piecewise(
    breakpoints: Breakpoints | None, r: int, h: float, nodes: Array, part: Part, cell: int, drive: Array, k: Array
) -> None:
    """Add the functions with breakpoints of row r to the output of `excite`; no breakpoint lies inside the part.

    The stiffness of springs is added to k, -e and -e' to the drive, and kr e + c e' is stored at the end of k.
    """
    if breakpoints is None:
        return
    x, length, N = part
    starts, rows, kr, c = breakpoints.starts, breakpoints.rows, breakpoints.kr, breakpoints.c
    m, unit, rate = kr.shape[1], 2 * np.pi / N, 2 * np.pi / (N * h)
    springs = k.shape[2] - m
    for q in range(springs + m):
        segment = segment_of(starts, r, q, unit * (x + 0.5 * length))
        a, b, f, g = rows[r, q, segment, 0], rows[r, q, segment, 1], rows[r, q, segment, 2], rows[r, q, segment, 3]
        for i in range(len(nodes)):
            y = unit * (x + length * nodes[i]) - starts[r, q, segment]
            value = a + y * (b + y * (f + y * g))
            if q < springs:
                if i < k.shape[1]:
                    k[cell, i, q] += value
                continue
            j, slope = q - springs, rate * (b + y * (2.0 * f + 3.0 * y * g))
            drive[cell, i * 2 * m + j] -= value
            drive[cell, i * 2 * m + m + j] -= slope
            if i < k.shape[1]:
                k[cell, i, q] = kr[r, j] * value + c[r, j] * slope


@kernel
def segment_of(starts: Array, r: int, q: int, tau: float) -> int:
    """Return the segment of function q of row r that contains a phase."""
    segment = 0
    while segment + 1 < starts.shape[2] and starts[r, q, segment + 1] <= tau:
        segment += 1
    return segment


@kernel
def fill(plan: Plan, method: Method, breakpoints: Breakpoints | None, lengths: Array, work: Work, out: Tables) -> None:
    """Compute tables of steps of given lengths in cells, one for each row; drive and k for all cells of the tables."""
    for i in range(len(lengths)):
        r, cells = i if len(plan.h) > 1 else 0, out.drive.shape[1]
        row, table, step = plan_row(plan, r), table_row(out, i), work_row(work, 0)
        step.span[1] = lengths[i]
        tabulate(table_arguments(row, method, step, table))
        for cell in range(cells):
            excite(row.steady, row.stiffness, method.nodes, (float(cell), 1.0, cells), cell, table.drive, table.k)
            add_piecewise(breakpoints, r, row.h, method.nodes, (float(cell), 1.0, cells), cell, table.drive, table.k)


@kernel
def plan_row(plan: Plan, r: int) -> Plan:
    """Return the row r of the plan, without the first axis of its arrays."""
    linear = plan.poles[r], plan.output[r], plan.input[r], plan.kr[r], plan.steady[r], plan.stiffness[r]
    return Plan(*linear, plan.slope[r], plan.offset[r], plan.low[r], plan.high[r], plan.cubic[r], plan.h[r])


@kernel
def table_row(tables: Tables, r: int) -> Tables:
    """Return the row r of tables, without the first axis of its arrays."""
    linear = tables.turn[r], tables.observe[r], tables.feedback[r], tables.push[r]
    return Tables(*linear, tables.drive[r], tables.k[r])


@kernel
def table_arguments(plan: Plan, method: Method, work: Work, out: Tables) -> Any:
    """Return the arguments of `tabulate` for rows of the plan, the work and the tables."""
    structure = plan.poles, plan.output, plan.input, plan.h, work.span, method.nodes, method.lagrange
    scratch = work.turns, work.inner, work.powers, work.scratch
    return (*structure, out.turn, out.observe, out.feedback, out.push, *scratch)


@kernel
def work_row(work: Work, g: int) -> Work:
    """Return the state of motion g, without the first axis of its arrays, and the scratch arrays."""
    state = work.progress[g], work.prepared[g : g + 1], work.span[g], work.free[g], work.y[g], work.w[g]
    segments = work.exits[g], work.side[g], work.levels[g], work.forces[g]
    scratch = work.J, work.right, work.turns, work.inner, work.powers, work.samples, work.zeta_end, work.scratch
    return Work(*state, *segments, *scratch)
