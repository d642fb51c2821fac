"""Tables of a step: the linear part, the excitation, and their dependence on the length of the step."""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import kernel
from hbgear.harmonic.multipliers.phi_functions import integrals
from hbgear.time.exponential.kernels.data import Breakpoints, Method, Plan, Tables, Work


@kernel
def tabulate(
    poles: ComplexArray,
    output: ComplexArray,
    input: ComplexArray,
    h: float,
    nodes: Array,
    lagrange: Array,
    turn: ComplexArray,
    observe: Array,
    feedback: Array,
    push: Array,
    turns: ComplexArray,
    inner: ComplexArray,
    powers: ComplexArray,
    scratch: Array,
) -> None:
    """Compute the tables of a step of length h for zeta and for w at the Gauss points.

    turn, observe, feedback and push are outputs, see `Tables`; the last four arrays are scratch arrays.
    """
    q, m, s = len(poles), input.shape[1], len(lagrange)
    integrals(poles, h, nodes, lagrange, turns, inner, powers)
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
    steady: ComplexArray,
    stiffness: ComplexArray,
    nodes: Array,
    x: float,
    length: float,
    N: int,
    cell: int,
    drive: Array,
    k: Array,
) -> None:
    """Evaluate steady (L + 1, 2 m) and stiffness (S, K + 1) at the nodes of (x, x + length), in cells of the period.

    Outputs are drive (C, (s + 1) 2 m) and k (C, s, S), at the given cell.
    """
    columns = steady.shape[1]
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
    breakpoints: Breakpoints,
    r: int,
    h: float,
    nodes: Array,
    x: float,
    length: float,
    N: int,
    cell: int,
    drive: Array,
    k: Array,
) -> None:
    """Add the functions with breakpoints of row r to the output of `excite`; no breakpoint lies inside the part.

    The stiffness of springs is added to k, -e and -e' to the drive, and kr e + c e' is stored at the end of k.
    """
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
        tabulate(
            plan.poles[r],
            plan.output[r],
            plan.input[r],
            lengths[i] * plan.h[r],
            method.nodes,
            method.lagrange,
            out.turn[i],
            out.observe[i],
            out.feedback[i],
            out.push[i],
            work.turns,
            work.inner,
            work.powers,
            work.scratch,
        )
        for cell in range(cells):
            excite(
                plan.steady[r], plan.stiffness[r], method.nodes, float(cell), 1.0, cells, cell, out.drive[i], out.k[i]
            )
            if breakpoints is not None:
                add_piecewise(
                    breakpoints, r, plan.h[r], method.nodes, float(cell), 1.0, cells, cell, out.drive[i], out.k[i]
                )
