"""Integration of motions over many cells."""

from __future__ import annotations

from typing import Any, NamedTuple

from hbgear.common.arrays import Array
from hbgear.common.process.compiling import kernel
from hbgear.time.exponential.kernels.breakpoints import (
    apply_rate_jump,
    level_at,
    level_slope_at,
    next_breakpoint,
    set_levels,
)
from hbgear.time.exponential.kernels.data import (
    CELL,
    IS_DIVIDED,
    LENGTH_CORRECTIONS,
    NEWTON_ITERATIONS,
    ROW,
    SEGMENTS_PASSED,
    TARGET,
    TO_END,
    TO_EXIT,
    Plan,
    Shared,
    Tables,
    Work,
)
from hbgear.time.exponential.kernels.exits import exit_arguments, first_exit, may_leave, record
from hbgear.time.exponential.kernels.newton import (
    correct,
    folded_step,
    law_arguments,
    linearise,
    newton_arguments,
    predict,
    propagate_state,
)
from hbgear.time.exponential.kernels.tables import (
    add_piecewise,
    evaluate_series,
    excite,
    plan_row,
    table_arguments,
    table_row,
    tabulate,
    work_row,
)
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers

_MAX_BREAKPOINT_MISS = 1e-9  # distance of the end of a step from a breakpoint, relative to the size of the motion;
# the error it causes is quadratic in it
_MIN_RATE = 1e-6  # change in a cell, relative to the size of the motion, below which a breakpoint is grazed
_MAX_SEGMENTS_PER_CELL = 24  # segments passed by one element within one cell, after which its rest is one step
_MAX_NEWTON_ITERATIONS = 30  # of the implicit equations of a step; three are typical
_MAX_LENGTH_CORRECTIONS = 3  # corrections of the length of a step that ends on a breakpoint


@kernel
def integrate_segments(
    shared: Shared, cut: Tables, work: Work, motions: Any, block: tuple[int, int, int, int], out: tuple[Array, Array]
) -> int:
    """Integrate the motions first..last over the cells begin..end in place; return the number of unfinished ones.

    Motions are unfinished if laws must be evaluated in Python: where work.prepared is true, work.y holds d and v at
    which they are needed, and the next call continues.

    Parameters
    ----------
    shared : Shared
        Packed models and their steps.
    cut : Tables
        Steps over partial cells, for G rows and one cell.
    work : Work
        Workspace.
    motions : tuple of ndarray
        `StateBatch.arrays` of B motions: zeta, d, v and segment.
    block : tuple of int
        Ranges of the motions and of the cells: first, last, begin, end. N cells are an excitation period, which begins
        with cell 0.
    out : tuple of ndarray, shapes (periods, B, 2 q) and (2, B, m, periods N SAMPLES_PER_STEP)
        Outputs: zeta after each period; d and v at equidistant instants. Either may be empty.

    Returns
    -------
    int
        Number of motions that wait for forces.
    """
    plan, (zeta, d, v, segment), (first, last, begin, end) = shared.plan, motions, block
    any_in_python, waiting = shared.method.in_python.any(), 0
    for b in range(first, last):
        r, g = b if len(plan.h) > 1 else 0, b - first if any_in_python else 0
        motion, step = Motion(b, r, zeta[b], d[b], v[b], segment[b]), work_row(work, g)
        rows = plan_row(plan, r), table_row(shared.cells, r), table_row(cut, g)
        if not any_in_python:
            step.progress[CELL] = begin
        waiting += _integrate_motion(motion, *rows, step, shared, end, out)
    return waiting


class Motion(NamedTuple):
    """Number b of a motion and r of its row of the plan, and its state: rows of zeta, d, v and segment."""

    b: int
    r: int
    zeta: Array
    d: Array
    v: Array
    segment: Integers


@kernel
def _integrate_motion(
    motion: Motion, plan: Plan, whole: Tables, cut: Tables, work: Work, shared: Shared, end: int, out: Any
) -> int:
    """Integrate one motion up to a cell; return 1 if it waits for forces. Plan, tables and work are its rows."""
    b, r, z, d, v, segment = motion
    method, breakpoints, maps, curves = shared.method, shared.breakpoints, shared.maps, shared.curves
    strobes, fine = out
    low, dense, straight, h = plan.low, method.dense, method.straight, plan.h
    progress, prepared, span, free, y, w, exits, side, levels = work[:9]
    samples, zeta_end, observe, drive = work.samples, work.zeta_end, whole.observe, whole.drive
    turn, push, cut_turn, cut_push = whole.turn, whole.push, cut.turn, cut.push
    steady, stiffness, nodes = plan.steady, plan.stiffness, method.nodes
    cut_observe, cut_drive, cut_k = cut.observe, cut.drive, cut.k
    any_in_python, has_maps, has_series, N = method.in_python.any(), len(maps) > 0, len(curves.turn) > 0, len(drive)
    turns_of, observes_of, feedbacks_of, pushes_of = curves[:4]
    flat_observe, flat_feedback, flat_push = cut_observe.reshape(-1), cut.feedback.reshape(-1), cut_push.reshape(-1)
    of_tables = table_arguments(plan, method, work, cut)
    of_laws = law_arguments(plan, method, segment, work)
    of_whole, of_whole_correction = newton_arguments(whole, work)
    of_cut, of_cut_correction = newton_arguments(cut, work)
    of_step, of_exit = exit_arguments(plan, method, d, v, segment, work)
    while True:
        cell = progress[CELL] % N
        is_whole = progress[SEGMENTS_PASSED] == 0 and progress[TARGET] == TO_EXIT and progress[IS_DIVIDED] == 0
        if not prepared[0]:
            if progress[CELL] >= end:
                return 0
            if is_whole:
                span[0], span[1] = 0.0, next_breakpoint(breakpoints, r, cell, 0.0)
                is_whole = span[1] == 1.0
                progress[IS_DIVIDED] = 0 if is_whole else 1
            progress[ROW] = cell if is_whole else 0
            part = cell + span[0], span[1], N
            set_levels(breakpoints, r, part, len(plan.slope), len(d), levels)
            if is_whole and has_maps:
                folded_step(maps, cell, segment, low.shape[1], z, y, zeta_end)
            elif is_whole:
                predict(observe, drive, cell, z, free, y, w)
            else:
                if has_series:
                    evaluate_series(turns_of, span[1], cut_turn)
                    evaluate_series(observes_of, span[1], flat_observe)
                    evaluate_series(feedbacks_of, span[1], flat_feedback)
                    evaluate_series(pushes_of, span[1], flat_push)
                else:
                    tabulate(of_tables)
                excite(steady, stiffness, nodes, part, 0, cut_drive, cut_k)
                add_piecewise(breakpoints, r, h, nodes, part, 0, cut_drive, cut_k)
                predict(cut_observe, cut_drive, 0, z, free, y, w)
            prepared[0], progress[NEWTON_ITERATIONS] = True, 0
            if any_in_python:
                return 1
        if is_whole and has_maps:
            size = change = 0.0
        elif is_whole:
            size, change = linearise(of_laws, of_whole, breakpoints), correct(*of_whole_correction)
        else:
            size, change = linearise(of_laws, of_cut, breakpoints), correct(*of_cut_correction)
        progress[NEWTON_ITERATIONS] += 1
        if not straight and change > 1e-13 * size and progress[NEWTON_ITERATIONS] < _MAX_NEWTON_ITERATIONS:
            if any_in_python:
                return 1
            continue
        prepared[0] = False
        if progress[TARGET] == TO_EXIT:
            stop = first_exit(of_step, of_exit) if may_leave(of_step) else -1
            if stop >= 0:
                span[1] *= exits[stop]
                progress[TARGET], progress[LENGTH_CORRECTIONS] = stop, 0
                continue
        elif progress[TARGET] >= 0:
            limit = next_breakpoint(breakpoints, r, cell, span[0])
            if _corrects_length(of_step, side, progress, limit):
                continue
        if fine.shape[3]:
            record(dense, y, d, v, span, h, samples, progress[CELL] * SAMPLES_PER_STEP, b, fine)
        if is_whole and has_maps:
            for i in range(len(z)):
                z[i] = zeta_end[i]
        elif is_whole:
            propagate_state(turn, push, w, z)
        else:
            propagate_state(cut_turn, cut_push, w, z)
        for j in range(len(d)):
            d[j], v[j] = y[len(y) - 2 * len(d) + j], y[len(y) - len(d) + j]
        apply_rate_jump(breakpoints, r, cell, span, v)
        if not _finish_step(segment, exits, side, progress, span):
            span[1] = next_breakpoint(breakpoints, r, cell, span[0]) - span[0]
        elif len(strobes) and progress[CELL] % N == 0:
            for i in range(len(z)):
                strobes[progress[CELL] // N - 1, b, i] = z[i]


@kernel
def _finish_step(segment: Integers, exits: Array, side: Integers, progress: Integers, span: Array) -> bool:
    """Advance to the rest of the cell or to the next cell; return whether it is the next cell."""
    span[0] += span[1]
    if progress[TARGET] >= 0:
        stop = exits[progress[TARGET]] + 1e-9
        for j in range(len(segment)):
            if exits[j] <= stop:
                segment[j] += side[j]
        progress[SEGMENTS_PASSED] += 1
    if 1.0 - span[0] > 1e-12:
        span[1] = 1.0 - span[0]
        limit = _MAX_SEGMENTS_PER_CELL * len(segment)
        progress[TARGET] = TO_EXIT if progress[SEGMENTS_PASSED] < limit else TO_END
        return False
    progress[CELL] += 1
    progress[TARGET], progress[SEGMENTS_PASSED], progress[IS_DIVIDED] = TO_EXIT, 0, 0
    return True


@kernel
def _corrects_length(arguments: Any, side: Integers, progress: Integers, limit: float) -> bool:
    """Return whether a step must be repeated with a corrected length, because it does not end on its breakpoint.

    The step does not exceed the limit, in the cell.
    """
    _, y, d, _, owner, levels, segment, low, high, h, span, _ = arguments
    j, m, end = progress[TARGET], len(d), len(y) - 2 * len(d)
    level = high[j, segment[j]] if side[j] > 0 else low[j, segment[j]]
    error, rate = y[end + owner[j]] - level, y[end + m + owner[j]]
    size = max(abs(level), abs(y[end + owner[j]]), abs(y[owner[j]]), h * abs(y[m + owner[j]]), h * abs(rate))
    if j >= m:
        error, rate = error - level_at(levels, j, 1.0), rate - level_slope_at(levels, j, 1.0) / (h * span[1])
    if not abs(error) > _MAX_BREAKPOINT_MISS * size or progress[LENGTH_CORRECTIONS] >= _MAX_LENGTH_CORRECTIONS:
        return False
    correction = error / rate / h if h * abs(rate) > _MIN_RATE * size else 0.0
    span[1] = max(0.5 * span[1], min(span[1] - correction, 1.5 * span[1], limit - span[0]))
    progress[LENGTH_CORRECTIONS] += 1
    return True
