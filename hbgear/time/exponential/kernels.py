"""Kernels that integrate motions by steps in which the linear part is exact: see `integrator`.

    zeta' = poles zeta - input w,   d, v = Re(output zeta) + steady(tau),   w = p - kr d

For displacements e with breakpoints, steady contains -e, and w = p - kr (d + e) - c e'.

The period is divided into N cells. The tables of a step over a whole cell are stored; those of a partial step
(x, x + length) are computed. Newton's iteration for w at the Gauss points ends after the first step if the laws are
linear on their segments. A step in which an element leaves its segment is repeated up to the breakpoint, followed by a
step over the rest of the cell. A cell in which the excitation has breakpoints is divided, too. A contact between teeth
has the segments d < level(tau) and d > level(tau); its level is a cubic on a step.

Laws that no table holds are evaluated in Python: `integrate_segments` then returns whenever it needs their forces.

Functions that are called for every step create no views of arrays and take no tuples of them: reference counting would
cost more than the step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import kernel
from hbgear.harmonic.multipliers.phi_functions import integrals
from hbgear.time.exponential.segments import BREAKPOINT_TOLERANCE, SAMPLES_PER_STEP, Bools, Integers

_MAX_BREAKPOINT_MISS = 1e-9  # distance of the end of a step from a breakpoint, relative to 1 + |breakpoint|;
# the error it causes is quadratic in it
_MAX_SEGMENTS_PER_CELL = 24  # segments passed by one element within one cell, after which its rest is one step
_MAX_LENGTH_CORRECTIONS = 3  # corrections of the length of a step that ends on a breakpoint
_MAX_NEWTON_ITERATIONS = 30  # of the implicit equations of a step; three are typical

_TO_EXIT, _TO_END = -1, -2  # target of a step: its end unless an element leaves its segment; its end in any case


class Tables(NamedTuple):
    """Tables of steps for R rows, and for C cells the terms that depend on the phase: see `tabulate`.

    turn (R, q) propagates zeta to the end, observe (R, 2 q, (s + 1) 2 m) maps it to d and v at the nodes;
    feedback (R, (s + 1) 2 m, s m) maps w to d and v, push (R, s m, 2 q) maps w to zeta.
    drive (R, C, (s + 1) 2 m): steady d and v at the nodes. k (R, C, s, S + m): stiffness of the springs at the nodes,
    then kr e + c e' of the elements whose e has breakpoints.
    """

    turn: ComplexArray
    observe: Array
    feedback: Array
    push: Array
    drive: Array
    k: Array


class Plan(NamedTuple):
    """Packed models: R = 1 for all motions, or one row for each motion.

    poles (R, q), output (R, 2 m, q) of d and v, input (R, q, m), kr (R, m): structure, one mode of each pair.
    steady (R, L + 1, 2 m), stiffness (R, S, K + 1): harmonics of d and v of the linear part alone, and of the springs.
    slope, offset (R, S, P), low, high (R, m + J, P), cubic (R, m, 2): see `LawTable`.
    h (R,): duration of a cell.
    """

    poles: ComplexArray
    output: ComplexArray
    input: ComplexArray
    kr: Array
    steady: ComplexArray
    stiffness: ComplexArray
    slope: Array
    offset: Array
    low: Array
    high: Array
    cubic: Array
    h: Array


class Breakpoints(NamedTuple):
    """Breakpoints of the excitation for each row of the plan; kernels are compiled separately for None.

    starts (R, S + m + J, P), rows (R, S + m + J, P, 4): functions with breakpoints, see `Excitation`.
    first (R, N + 1), position, kink (R, I), (R, I, m): `Excitation.step_ends`. kr, c (R, m): springs and dampers of
    the elements.
    """

    starts: Array
    rows: Array
    first: Integers
    position: Array
    kink: Array
    kr: Array
    c: Array


class Method(NamedTuple):
    """Data that are equal for all motions.

    element, contact (S,), in_python (m,): see `LawTable`. owner (m + J,): element of each row of segments.
    straight: true if all laws are linear on their segments.
    nodes (s + 1,): the Gauss points and 1. lagrange (s, s): see `gauss_points.gauss_nodes`.
    dense (2 s + 4, 2 s + 4): contributions of d and h v at 0, the Gauss points and 1 to the Chebyshev coefficients.
    values, slopes (2 s + 4, SAMPLES_PER_STEP + 1): the same for d and h v at equidistant instants.
    """

    element: Integers
    contact: Integers
    owner: Integers
    in_python: Bools
    straight: bool
    nodes: Array
    lagrange: Array
    dense: Array
    values: Array
    slopes: Array


class Work(NamedTuple):
    """State of G motions that are integrated together, and scratch arrays.

    progress (G, 6): cell, target, length corrections, segments passed, Newton iterations, whether the cell is divided.
    prepared (G,): whether a step is prepared. span (G, 2): its beginning x and length, in cells.
    free, y (G, (s + 1) 2 m), w (G, s m): of the step, d and v without and with w.
    exits, side (G, m + J): positions in the step at which elements and contacts leave their segments, and the end.
    levels (G, m + J, 4): levels of contacts as cubics in the part of the step; zero for elements.
    forces (G, 3, s, m): p, dp/dd, dp/dv of the laws evaluated in Python.
    """

    progress: Integers
    prepared: Bools
    span: Array
    free: Array
    y: Array
    w: Array
    exits: Array
    side: Integers
    levels: Array
    forces: Array
    J: Array
    right: Array
    turns: ComplexArray
    inner: ComplexArray
    powers: ComplexArray
    samples: Array
    zeta_end: Array
    scratch: Array


# columns of Work.progress
_CELL, _TARGET, _LENGTH_CORRECTIONS, _SEGMENTS_PASSED, _NEWTON_ITERATIONS, _IS_DIVIDED = range(6)


def allocate_tables(rows: int, cells: int, s: int, m: int, q: int, springs: int) -> Tables:
    """Return tables filled with zeros."""
    n = (s + 1) * 2 * m
    shapes = (rows, 2 * q, n), (rows, n, s * m), (rows, s * m, 2 * q), (rows, cells, n), (rows, cells, s, springs + m)
    return Tables(np.zeros((rows, q), dtype=complex), *map(np.zeros, shapes))


def allocate_workspace(motions: int, s: int, m: int, q: int, contacts: int) -> Work:
    """Return the workspace of a number of motions, none of which is under way."""
    rows = m + contacts
    G, n, r, z, integer, pair = motions, (s + 1) * 2 * m, s * m, np.zeros, np.int64, complex
    progress = z((G, 6), dtype=integer)
    progress[:, _TARGET] = _TO_EXIT
    return Work(
        progress=progress, prepared=z(G, dtype=np.bool_), span=z((G, 2)), free=z((G, n)), y=z((G, n)), w=z((G, r)),
        exits=z((G, rows)), side=z((G, rows), dtype=integer), levels=z((G, rows, 4)), forces=z((G, 3, s, m)),
        J=z((r, r)), right=z(r),
        turns=z((s + 1, q), dtype=pair), inner=z((s, s + 1, q), dtype=pair), powers=z((s + 2, (s + 1) * q), dtype=pair),
        samples=z((4, max(2 * s + 5, SAMPLES_PER_STEP + 1))), zeta_end=z(2 * q), scratch=z((2, r)),
    )  # fmt: skip


@kernel
def integrate_segments(
    plan: Plan,
    method: Method,
    breakpoints: Breakpoints | None,
    cells: Tables,
    maps: Array,
    curves: Tables,
    cut: Tables,
    work: Work,
    zeta: Array,
    d: Array,
    v: Array,
    segment: Integers,
    first: int,
    last: int,
    begin: int,
    end: int,
    strobes: Array,
    fine: Array,
) -> int:
    """Integrate the motions first..last over the cells begin..end in place; return the number of unfinished ones.

    Motions are unfinished if laws must be evaluated in Python: where work.prepared is true, work.y holds d and v at
    which they are needed, and the next call continues.

    Parameters
    ----------
    plan : Plan
        Packed models.
    method : Method
        Data that are equal for all motions.
    breakpoints : Breakpoints or None
        Breakpoints of the excitation.
    cells : Tables
        Steps over whole cells, for R rows and N cells.
    maps : ndarray
        Steps over whole cells that are linear in the state alone, see `fold`, or empty.
    curves : Tables
        D rows of Chebyshev coefficients of turn, observe, feedback and push over the length of a step. Without rows
        these tables are computed.
    cut : Tables
        Steps over partial cells, for G rows and one cell.
    work : Work
        Workspace.
    zeta : ndarray, shape (B, 2 q)
        Real parts, then imaginary parts.
    d, v : ndarray, shape (B, m)
        Displacements and rates of the elements.
    segment : ndarray, shape (B, m + J)
        Segments of the elements and contacts.
    first, last : int
        Range of the motions.
    begin, end : int
        Range of the cells. N cells are an excitation period, which begins with cell 0.
    strobes : ndarray, shape (periods, B, 2 q)
        Output: zeta after each period; or empty.
    fine : ndarray, shape (2, B, m, periods N SAMPLES_PER_STEP)
        Output: d and v at equidistant instants; or empty.

    Returns
    -------
    int
        Number of motions that wait for forces.
    """
    any_in_python, waiting, N, last_cell = method.in_python.any(), 0, cells.drive.shape[1], cut.drive.shape[1] - 1
    element, contact, owner, in_python, straight, nodes, lagrange, dense, values, slopes = method
    has_maps, zeta_end, scratch, D = len(maps) > 0, work.zeta_end, work.scratch, len(curves.turn)
    has_series, turns_of, observes_of = D > 0, curves.turn, curves.observe.reshape(D, cut.observe[0].size)
    feedbacks_of, pushes_of = curves.feedback.reshape(D, cut.feedback[0].size), curves.push.reshape(D, cut.push[0].size)
    J, right, turns, inner, powers, samples = work.J, work.right, work.turns, work.inner, work.powers, work.samples
    for b in range(first, last):
        r, g = b if len(plan.h) > 1 else 0, b - first if any_in_python else 0
        kr, cubic, slope, offset = plan.kr[r], plan.cubic[r], plan.slope[r], plan.offset[r]
        low, high, h, steady, stiffness = plan.low[r], plan.high[r], plan.h[r], plan.steady[r], plan.stiffness[r]
        poles, output, input = plan.poles[r], plan.output[r], plan.input[r]
        turn, observe, feedback, push = cells.turn[r], cells.observe[r], cells.feedback[r], cells.push[r]
        drive, k, cut_drive, cut_k = cells.drive[r], cells.k[r], cut.drive[g], cut.k[g]
        cut_turn, cut_observe, cut_feedback, cut_push = cut.turn[g], cut.observe[g], cut.feedback[g], cut.push[g]
        flat_observe, flat_feedback, flat_push = cut_observe.reshape(-1), cut_feedback.reshape(-1), cut_push.reshape(-1)
        progress, span, forces = work.progress[g], work.span[g], work.forces[g]
        free, y, w = work.free[g], work.y[g], work.w[g]
        exits, side, levels, z, x, rate, active = (
            work.exits[g], work.side[g], work.levels[g], zeta[b], d[b], v[b], segment[b],
        )  # fmt: skip
        if not any_in_python:
            progress[_CELL] = begin
        while True:
            cell, is_whole = progress[_CELL] % N, progress[_SEGMENTS_PASSED] == 0 and progress[_TARGET] == _TO_EXIT
            if breakpoints is not None:
                is_whole = is_whole and progress[_IS_DIVIDED] == 0
            if not work.prepared[g]:
                if progress[_CELL] >= end:
                    break
                if is_whole:
                    span[0], span[1] = 0.0, 1.0
                    if breakpoints is not None:
                        span[1] = _next_breakpoint(breakpoints.first, breakpoints.position, r, cell, 0.0)
                        is_whole = span[1] == 1.0
                        progress[_IS_DIVIDED] = 0 if is_whole else 1
                if breakpoints is not None:
                    _set_levels(breakpoints, r, cell + span[0], span[1], N, len(element), len(x), levels)
                if is_whole:
                    if has_maps:
                        _folded_step(maps, cell, active, low.shape[1], z, y, zeta_end)
                    else:
                        _predict(observe, drive, cell, z, free, y, w)
                else:
                    if has_series:
                        _evaluate_series(turns_of, span[1], cut_turn)
                        _evaluate_series(observes_of, span[1], flat_observe)
                        _evaluate_series(feedbacks_of, span[1], flat_feedback)
                        _evaluate_series(pushes_of, span[1], flat_push)
                    else:
                        tabulate(
                            poles, output, input, span[1] * h, nodes, lagrange, cut_turn, cut_observe, cut_feedback,
                            cut_push, turns, inner, powers, scratch,
                        )  # fmt: skip
                    excite(steady, stiffness, nodes, cell + span[0], span[1], N, last_cell, cut_drive, cut_k)
                    if breakpoints is not None:
                        add_piecewise(breakpoints, r, h, nodes, cell + span[0], span[1], N, last_cell, cut_drive, cut_k)
                    _predict(cut_observe, cut_drive, last_cell, z, free, y, w)
                work.prepared[g], progress[_NEWTON_ITERATIONS] = True, 0
                if any_in_python:
                    waiting += 1
                    break
            if is_whole and has_maps:
                size = change = 0.0
            elif is_whole:
                size = _linearise(
                    kr, cubic, element, contact, slope, offset, active, in_python, forces, k, cell, feedback, y, w, J,
                    right, scratch, breakpoints, nodes, levels,
                )  # fmt: skip
                change = _correct(J, right, feedback, free, y, w)
            else:
                size = _linearise(
                    kr, cubic, element, contact, slope, offset, active, in_python, forces, cut_k, last_cell,
                    cut_feedback, y, w, J, right, scratch, breakpoints, nodes, levels,
                )  # fmt: skip
                change = _correct(J, right, cut_feedback, free, y, w)
            progress[_NEWTON_ITERATIONS] += 1
            if not straight and change > 1e-13 * size and progress[_NEWTON_ITERATIONS] < _MAX_NEWTON_ITERATIONS:
                if any_in_python:
                    waiting += 1
                    break
                continue
            work.prepared[g] = False
            if progress[_TARGET] == _TO_EXIT:
                if _may_leave(nodes, y, x, rate, owner, levels, active, low, high, h * span[1], exits):
                    stop = _first_exit(
                        dense, values, slopes, nodes, y, x, rate, owner, levels, active, low, high, h * span[1], exits,
                        side, samples,
                    )  # fmt: skip
                    if stop >= 0:
                        span[1] *= exits[stop]
                        progress[_TARGET], progress[_LENGTH_CORRECTIONS] = stop, 0
                        continue
            elif progress[_TARGET] >= 0:
                limit = 1.0
                if breakpoints is not None:
                    limit = _next_breakpoint(breakpoints.first, breakpoints.position, r, cell, span[0])
                if _corrects_length(y, len(x), owner, levels, active, low, high, h, side, progress, span, limit):
                    continue
            if fine.shape[3]:
                _record(dense, y, x, rate, span, h, samples, progress[_CELL] * SAMPLES_PER_STEP, b, fine)
            if is_whole and has_maps:
                for i in range(len(z)):
                    z[i] = zeta_end[i]
            elif is_whole:
                _propagate_state(turn, push, w, z)
            else:
                _propagate_state(cut_turn, cut_push, w, z)
            for j in range(len(x)):
                x[j], rate[j] = y[len(y) - 2 * len(x) + j], y[len(y) - len(x) + j]
            if breakpoints is not None:
                _apply_rate_jump(breakpoints, r, cell, span, rate)
            if _finish_step(active, exits, side, progress, span):
                if len(strobes) and progress[_CELL] % N == 0:
                    for i in range(len(z)):
                        strobes[progress[_CELL] // N - 1, b, i] = z[i]
            elif breakpoints is not None:
                span[1] = _next_breakpoint(breakpoints.first, breakpoints.position, r, cell, span[0]) - span[0]
    return waiting


@kernel
def fill(plan: Plan, method: Method, breakpoints: Breakpoints | None, lengths: Array, work: Work, out: Tables) -> None:
    """Compute tables of steps of given lengths in cells, one for each row; drive and k for all cells of the tables."""
    for i in range(len(lengths)):
        r, cells = i if len(plan.h) > 1 else 0, out.drive.shape[1]
        tabulate(
            plan.poles[r], plan.output[r], plan.input[r], lengths[i] * plan.h[r], method.nodes, method.lagrange,
            out.turn[i], out.observe[i], out.feedback[i], out.push[i], work.turns, work.inner, work.powers,
            work.scratch,
        )  # fmt: skip
        for cell in range(cells):
            excite(
                plan.steady[r], plan.stiffness[r], method.nodes, float(cell), 1.0, cells, cell, out.drive[i], out.k[i]
            )
            if breakpoints is not None:
                add_piecewise(
                    breakpoints, r, plan.h[r], method.nodes, float(cell), 1.0, cells, cell, out.drive[i], out.k[i]
                )


@kernel
def fold(plan: Plan, method: Method, breakpoints: Breakpoints | None, cells: Tables, work: Work, out: Array) -> None:
    """Compute steps over whole cells with laws that are linear on their segments: linear maps of zeta.

    out (N, combinations of segments, 2 q + 1, (s + 1) 2 m + 2 q): contribution of each component of zeta, and last of
    the loads, to d and v at the nodes and to zeta at the end.
    """
    m, P, size = plan.kr.shape[1], plan.low.shape[2], plan.output.shape[2] * 2
    n = out.shape[3] - size
    segment, zeta, free, y, w = np.zeros(m, dtype=np.int64), work.zeta_end, work.free[0], work.y[0], work.w[0]
    levels = work.levels[0]
    for cell in range(out.shape[0]):
        for combination in range(out.shape[1]):
            for j in range(m):
                segment[j] = combination // P**j % P
            for u in range(size, -1, -1):
                for r in range(size):
                    zeta[r] = 1.0 if r == u else 0.0
                _predict(cells.observe[0], cells.drive[0], cell, zeta, free, y, w)
                _linearise(
                    plan.kr[0], plan.cubic[0], method.element, method.contact, plan.slope[0], plan.offset[0], segment,
                    method.in_python, work.forces[0], cells.k[0], cell, cells.feedback[0], y, w, work.J, work.right,
                    work.scratch, breakpoints, method.nodes, levels,
                )  # fmt: skip
                _correct(work.J, work.right, cells.feedback[0], free, y, w)
                _propagate_state(cells.turn[0], cells.push[0], w, zeta)
                for i in range(n + size):
                    loads = 0.0 if u == size else out[cell, combination, size, i]
                    out[cell, combination, u, i] = (y[i] if i < n else zeta[i - n]) - loads


@kernel
def _folded_step(maps: Array, cell: int, segment: Integers, P: int, zeta: Array, y: Array, zeta_end: Array) -> None:
    """Compute a step over a whole cell by its linear map: d and v at the nodes, zeta at the end."""
    combination, size, n = 0, len(zeta), len(y)
    for j in range(len(segment) - 1, -1, -1):
        combination = combination * P + segment[j]
    for i in range(n):
        y[i] = maps[cell, combination, size, i]
    for i in range(size):
        zeta_end[i] = maps[cell, combination, size, n + i]
    for r in range(size):
        z = zeta[r]
        for i in range(n):
            y[i] += maps[cell, combination, r, i] * z
        for i in range(size):
            zeta_end[i] += maps[cell, combination, r, n + i] * z


@kernel
def _predict(observe: Array, drive: Array, cell: int, zeta: Array, free: Array, y: Array, w: Array) -> None:
    """Compute d and v in a step without w."""
    for i in range(len(free)):
        free[i] = drive[cell, i]
    for r in range(len(zeta)):
        z = zeta[r]
        for i in range(len(free)):
            free[i] += observe[r, i] * z
    for i in range(len(free)):
        y[i] = free[i]
    for i in range(len(w)):
        w[i] = 0.0


@kernel
def tabulate(
    poles: ComplexArray, output: ComplexArray, input: ComplexArray, h: float, nodes: Array, lagrange: Array,
    turn: ComplexArray, observe: Array, feedback: Array, push: Array, turns: ComplexArray, inner: ComplexArray,
    powers: ComplexArray, scratch: Array,
) -> None:  # fmt: skip
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
def _evaluate_series(curves: Array, length: float, out: Array) -> None:
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
    steady: ComplexArray, stiffness: ComplexArray, nodes: Array, x: float, length: float, N: int, cell: int,
    drive: Array, k: Array,
) -> None:  # fmt: skip
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
        segment = _segment_of(starts, r, q, unit * (x + 0.5 * length))
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
def _segment_of(starts: Array, r: int, q: int, tau: float) -> int:
    """Return the segment of function q of row r that contains a phase."""
    segment = 0
    while segment + 1 < starts.shape[2] and starts[r, q, segment + 1] <= tau:
        segment += 1
    return segment


@kernel
def _set_levels(
    breakpoints: Breakpoints, r: int, x: float, length: float, N: int, springs: int, m: int, levels: Array
) -> None:  # fmt: skip
    """Set the levels of all contacts on (x, x + length), in cells of the period; no breakpoint lies inside."""
    starts, rows, unit = breakpoints.starts, breakpoints.rows, 2 * np.pi / N
    width = unit * length
    for j in range(m, len(levels)):
        q = springs + j
        segment = _segment_of(starts, r, q, unit * (x + 0.5 * length))
        a, b, f, g = rows[r, q, segment, 0], rows[r, q, segment, 1], rows[r, q, segment, 2], rows[r, q, segment, 3]
        y = unit * x - starts[r, q, segment]
        levels[j, 0] = a + y * (b + y * (f + y * g))
        levels[j, 1] = width * (b + y * (2.0 * f + 3.0 * y * g))
        levels[j, 2] = width * width * (f + 3.0 * y * g)
        levels[j, 3] = width * width * width * g


@kernel
def _level(levels: Array, j: int, z: float) -> float:
    """Return a level at a part z of the step."""
    total: float = levels[j, 0] + z * (levels[j, 1] + z * (levels[j, 2] + z * levels[j, 3]))
    return total


@kernel
def _level_slope(levels: Array, j: int, z: float) -> float:
    """Return the derivative of a level in the part z of the step."""
    total: float = levels[j, 1] + z * (2.0 * levels[j, 2] + 3.0 * z * levels[j, 3])
    return total


@kernel
def _next_breakpoint(first: Integers, position: Array, r: int, cell: int, x: float) -> float:
    """Return the end of the step from x in a cell: the next breakpoint of the excitation, or the end of the cell."""
    for i in range(first[r, cell], first[r, cell + 1]):
        end: float = position[r, i]
        if end > x + 1e-12:
            return end
    return 1.0


@kernel
def _apply_rate_jump(breakpoints: Breakpoints, r: int, cell: int, span: Array, v: Array) -> None:
    """Apply the jump of v if the step ends at a breakpoint of the excitation; each breakpoint is applied once."""
    end = span[0] + span[1]
    if 1.0 - end <= 1e-12:
        end = 1.0
    for i in range(breakpoints.first[r, cell], breakpoints.first[r, cell + 1]):
        if span[0] + 1e-12 < breakpoints.position[r, i] <= end + 1e-12:
            for j in range(len(v)):
                v[j] -= breakpoints.kink[r, i, j]


@kernel
def _linearise(
    kr: Array, cubic: Array, element: Integers, contact: Integers, slope: Array, offset: Array, segment: Integers,
    in_python: Bools, forces: Array, k: Array, cell: int, feedback: Array, y: Array, w: Array, J: Array, right: Array,
    scratch: Array, breakpoints: Breakpoints | None, nodes: Array, levels: Array,
) -> float:  # fmt: skip
    """Compute the equations J step = right of the next Newton step for w, and return the size of the forces."""
    s, m, size = k.shape[1], len(kr), 0.0
    for i in range(s):
        for j in range(m):
            a, d = i * m + j, y[i * 2 * m + j]
            right[a] = (cubic[j, 0] + cubic[j, 1] * d * d) * d
            scratch[0, a] = cubic[j, 0] + 3.0 * cubic[j, 1] * d * d
    for spring in range(len(element)):
        j = element[spring]
        row = j if contact[spring] < 0 else m + contact[spring]
        gradient, constant = slope[spring, segment[row]], offset[spring, segment[row]]
        if gradient == 0.0 and constant == 0.0:
            continue
        for i in range(s):
            x = y[i * 2 * m + j] if row == j else y[i * 2 * m + j] - _level(levels, row, nodes[i])
            right[i * m + j] += k[cell, i, spring] * (gradient * x + constant)
            scratch[0, i * m + j] += k[cell, i, spring] * gradient
    for i in range(s):
        for j in range(m):
            a, row = i * m + j, i * 2 * m + j
            if in_python[j]:
                right[a], scratch[0, a] = forces[0, i, j], forces[1, i, j]
            linear, gradient = kr[j] * y[row], scratch[0, a] - kr[j]
            size = max(size, abs(right[a]) + abs(linear))
            right[a] -= linear + w[a]
            if breakpoints is not None:
                right[a] -= k[cell, i, len(element) + j]
            for e in range(s * m):
                J[a, e] = gradient * feedback[row, e]
            if in_python[j]:
                for e in range(s * m):
                    J[a, e] += forces[2, i, j] * feedback[row + m, e]
            J[a, a] += 1.0
    return size


@kernel
def _correct(J: Array, right: Array, feedback: Array, free: Array, y: Array, w: Array) -> float:
    """Apply the Newton step to w, d and v, and return the largest change of w."""
    _solve(J, right)
    change = 0.0
    for a in range(len(w)):
        change = max(change, abs(right[a]))
        w[a] += right[a]
    for i in range(len(y)):
        total = free[i]
        for a in range(len(w)):
            total -= feedback[i, a] * w[a]
        y[i] = total
    return change


@kernel
def _solve(A: Array, b: Array) -> None:
    """Solve A x = b by Gaussian elimination with partial pivoting; x replaces b, A is overwritten."""
    n = len(b)
    for i in range(n):
        best = i
        for j in range(i + 1, n):
            if abs(A[j, i]) > abs(A[best, i]):
                best = j
        if best != i:
            b[i], b[best] = b[best], b[i]
            for e in range(i, n):
                A[i, e], A[best, e] = A[best, e], A[i, e]
        inverse = 1.0 / A[i, i]
        for j in range(i + 1, n):
            factor = A[j, i] * inverse
            if factor != 0.0:
                b[j] -= factor * b[i]
                for e in range(i + 1, n):
                    A[j, e] -= factor * A[i, e]
    for i in range(n - 1, -1, -1):
        x = b[i]
        for e in range(i + 1, n):
            x -= A[i, e] * b[e]
        b[i] = x / A[i, i]


@kernel
def _propagate_state(turn: ComplexArray, push: Array, w: Array, zeta: Array) -> None:
    """Compute zeta at the end of the step."""
    q = len(turn)
    for r in range(q):
        re, im = zeta[r], zeta[q + r]
        zeta[r] = turn[r].real * re - turn[r].imag * im
        zeta[q + r] = turn[r].real * im + turn[r].imag * re
    for a in range(len(w)):
        for r in range(2 * q):
            zeta[r] -= push[a, r] * w[a]


@kernel
def _finish_step(segment: Integers, exits: Array, side: Integers, progress: Integers, span: Array) -> bool:
    """Advance to the rest of the cell or to the next cell; return whether it is the next cell."""
    span[0] += span[1]
    if progress[_TARGET] >= 0:
        stop = exits[progress[_TARGET]] + 1e-9
        for j in range(len(segment)):
            if exits[j] <= stop:
                segment[j] += side[j]
        progress[_SEGMENTS_PASSED] += 1
    if 1.0 - span[0] > 1e-12:
        span[1] = 1.0 - span[0]
        limit = _MAX_SEGMENTS_PER_CELL * len(segment)
        progress[_TARGET] = _TO_EXIT if progress[_SEGMENTS_PASSED] < limit else _TO_END
        return False
    progress[_CELL] += 1
    progress[_TARGET], progress[_SEGMENTS_PASSED], progress[_IS_DIVIDED] = _TO_EXIT, 0, 0
    return True


@kernel
def _corrects_length(
    y: Array, m: int, owner: Integers, levels: Array, segment: Integers, low: Array, high: Array, h: float,
    side: Integers, progress: Integers, span: Array, limit: float,
) -> bool:  # fmt: skip
    """Return whether a step must be repeated with a corrected length, because it does not end on its breakpoint.

    The step does not exceed the limit, in the cell.
    """
    j, end = progress[_TARGET], len(y) - 2 * m
    level = high[j, segment[j]] if side[j] > 0 else low[j, segment[j]]
    error, rate = y[end + owner[j]] - level, y[end + m + owner[j]]
    if j >= m:
        error, rate = error - _level(levels, j, 1.0), rate - _level_slope(levels, j, 1.0) / (h * span[1])
    if (
        not abs(error) > _MAX_BREAKPOINT_MISS * (1.0 + abs(level))
        or progress[_LENGTH_CORRECTIONS] >= _MAX_LENGTH_CORRECTIONS
    ):
        return False
    correction = error / rate / h if abs(rate) > 1e-6 else 0.0
    span[1] = max(0.5 * span[1], min(span[1] - correction, 1.5 * span[1], limit - span[0]))
    progress[_LENGTH_CORRECTIONS] += 1
    return True


@kernel
def _may_leave(
    nodes: Array, y: Array, d: Array, v: Array, owner: Integers, levels: Array, segment: Integers, low: Array,
    high: Array, h: float, exits: Array,
) -> bool:  # fmt: skip
    """Return whether any element or contact may leave its segment; ``exits`` are 0 for these and inf for the others."""
    any_may_leave = False
    for j in range(len(segment)):
        exits[j] = np.inf
        if _may_leave_segment(nodes, y, d, v, j, owner[j], levels, low[j, segment[j]], high[j, segment[j]], h):
            exits[j], any_may_leave = 0.0, True
    return any_may_leave


@kernel
def _may_leave_segment(
    nodes: Array, y: Array, d: Array, v: Array, row: int, j: int, levels: Array, low: float, high: float, h: float
) -> bool:  # fmt: skip
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
        v1 = y[i * 2 * m + m + j] - (_level_slope(levels, row, nodes[i]) / h if is_contact else 0.0)
        rate = max(rate, abs(v1))
    for i in range(len(nodes)):
        d1, v1 = y[i * 2 * m + j], y[i * 2 * m + m + j]
        if is_contact:
            d1, v1 = d1 - _level(levels, row, nodes[i]), v1 - _level_slope(levels, row, nodes[i]) / h
        if d1 > high or d1 < low:
            return True
        if not (v0 * v1 > 0.0 and min(abs(v0), abs(v1)) > 0.5 * rate):
            excursion = h * (nodes[i] - x0) * (0.5 * abs(v1 - v0) + 0.1 * rate)
            if max(d0, d1) + excursion > high or min(d0, d1) - excursion < low:
                return True
        x0, d0, v0 = nodes[i], d1, v1
    return False


@kernel
def _first_exit(
    dense: Array, values: Array, slopes: Array, nodes: Array, y: Array, d: Array, v: Array, owner: Integers,
    levels: Array, segment: Integers, low: Array, high: Array, h: float, exits: Array, side: Integers, samples: Array,
) -> int:  # fmt: skip
    """Return the element or contact that first leaves its segment, or -1; ``exits`` and ``side`` are the exits of all.

    ``exits`` are in units of the step, inf without exit. Only rows with a finite value are tested, see `_may_leave`.
    """
    first = -1
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
        exits[j], side[j] = _exit_of_element(c, len(dense), gaps, rates, low[j, segment[j]], high[j, segment[j]])
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
        data[1 + i] -= _level(levels, j, nodes[i])
        data[count + 1 + i] -= _level_slope(levels, j, nodes[i])


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
def _exit_of_element(c: Array, n: int, d: Array, v: Array, low: float, high: float) -> tuple[float, int]:
    """Return where in the step a motion first leaves (low, high), inf if nowhere, and through which end (-1, +1, 0).

    c (n,) are its Chebyshev coefficients, d and v its values at SAMPLES_PER_STEP + 1 equidistant instants. The extrema
    between them are evaluated in addition, so that short excursions beyond a breakpoint are detected. The start is
    inside, to rounding.
    """
    largest = 0.0
    for i in range(SAMPLES_PER_STEP + 1):
        largest = max(largest, abs(d[i]))
    tolerance = BREAKPOINT_TOLERANCE * (1.0 + largest)
    x0, y0 = 0.0, d[0]
    for i in range(SAMPLES_PER_STEP):
        for part in range(2):
            if part == 0:
                if not v[i] * v[i + 1] < 0:
                    continue
                x = (i + v[i] / (v[i] - v[i + 1])) / SAMPLES_PER_STEP
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
        else:
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
    total: float = 0.5 * t * b_1 - b_2 + c[0]
    return total


@kernel
def _record(
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
