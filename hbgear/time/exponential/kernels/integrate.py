"""Integration of motions over many cells."""

from __future__ import annotations

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
    SEGMENTS_PASSED,
    TARGET,
    TO_END,
    TO_EXIT,
    Breakpoints,
    Method,
    Plan,
    Tables,
    Work,
)
from hbgear.time.exponential.kernels.exits import first_exit, may_leave, record
from hbgear.time.exponential.kernels.newton import correct, folded_step, linearise, predict, propagate_state
from hbgear.time.exponential.kernels.tables import add_piecewise, evaluate_series, excite, tabulate
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers

_MAX_BREAKPOINT_MISS = 1e-9  # distance of the end of a step from a breakpoint, relative to the size of the motion;
# the error it causes is quadratic in it
_MIN_RATE = 1e-6  # change in a cell, relative to the size of the motion, below which a breakpoint is grazed
_MAX_SEGMENTS_PER_CELL = 24  # segments passed by one element within one cell, after which its rest is one step
_MAX_NEWTON_ITERATIONS = 30  # of the implicit equations of a step; three are typical
_MAX_LENGTH_CORRECTIONS = 3  # corrections of the length of a step that ends on a breakpoint


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
            work.exits[g],
            work.side[g],
            work.levels[g],
            zeta[b],
            d[b],
            v[b],
            segment[b],
        )
        if not any_in_python:
            progress[CELL] = begin
        while True:
            cell, is_whole = progress[CELL] % N, progress[SEGMENTS_PASSED] == 0 and progress[TARGET] == TO_EXIT
            if breakpoints is not None:
                is_whole = is_whole and progress[IS_DIVIDED] == 0
            if not work.prepared[g]:
                if progress[CELL] >= end:
                    break
                if is_whole:
                    span[0], span[1] = 0.0, 1.0
                    if breakpoints is not None:
                        span[1] = next_breakpoint(breakpoints.first, breakpoints.position, r, cell, 0.0)
                        is_whole = span[1] == 1.0
                        progress[IS_DIVIDED] = 0 if is_whole else 1
                if breakpoints is not None:
                    set_levels(breakpoints, r, cell + span[0], span[1], N, len(element), len(x), levels)
                if is_whole:
                    if has_maps:
                        folded_step(maps, cell, active, low.shape[1], z, y, zeta_end)
                    else:
                        predict(observe, drive, cell, z, free, y, w)
                else:
                    if has_series:
                        evaluate_series(turns_of, span[1], cut_turn)
                        evaluate_series(observes_of, span[1], flat_observe)
                        evaluate_series(feedbacks_of, span[1], flat_feedback)
                        evaluate_series(pushes_of, span[1], flat_push)
                    else:
                        tabulate(
                            poles,
                            output,
                            input,
                            span[1] * h,
                            nodes,
                            lagrange,
                            cut_turn,
                            cut_observe,
                            cut_feedback,
                            cut_push,
                            turns,
                            inner,
                            powers,
                            scratch,
                        )
                    excite(steady, stiffness, nodes, cell + span[0], span[1], N, last_cell, cut_drive, cut_k)
                    if breakpoints is not None:
                        add_piecewise(breakpoints, r, h, nodes, cell + span[0], span[1], N, last_cell, cut_drive, cut_k)
                    predict(cut_observe, cut_drive, last_cell, z, free, y, w)
                work.prepared[g], progress[NEWTON_ITERATIONS] = True, 0
                if any_in_python:
                    waiting += 1
                    break
            if is_whole and has_maps:
                size = change = 0.0
            elif is_whole:
                size = linearise(
                    kr,
                    cubic,
                    element,
                    contact,
                    slope,
                    offset,
                    active,
                    in_python,
                    forces,
                    k,
                    cell,
                    feedback,
                    y,
                    w,
                    J,
                    right,
                    scratch,
                    breakpoints,
                    nodes,
                    levels,
                )
                change = correct(J, right, feedback, free, y, w)
            else:
                size = linearise(
                    kr,
                    cubic,
                    element,
                    contact,
                    slope,
                    offset,
                    active,
                    in_python,
                    forces,
                    cut_k,
                    last_cell,
                    cut_feedback,
                    y,
                    w,
                    J,
                    right,
                    scratch,
                    breakpoints,
                    nodes,
                    levels,
                )
                change = correct(J, right, cut_feedback, free, y, w)
            progress[NEWTON_ITERATIONS] += 1
            if not straight and change > 1e-13 * size and progress[NEWTON_ITERATIONS] < _MAX_NEWTON_ITERATIONS:
                if any_in_python:
                    waiting += 1
                    break
                continue
            work.prepared[g] = False
            if progress[TARGET] == TO_EXIT:
                if may_leave(nodes, y, x, rate, owner, levels, active, low, high, h * span[1], exits):
                    stop = first_exit(
                        dense,
                        values,
                        slopes,
                        nodes,
                        y,
                        x,
                        rate,
                        owner,
                        levels,
                        active,
                        low,
                        high,
                        h * span[1],
                        exits,
                        side,
                        samples,
                    )
                    if stop >= 0:
                        span[1] *= exits[stop]
                        progress[TARGET], progress[LENGTH_CORRECTIONS] = stop, 0
                        continue
            elif progress[TARGET] >= 0:
                limit = 1.0
                if breakpoints is not None:
                    limit = next_breakpoint(breakpoints.first, breakpoints.position, r, cell, span[0])
                if _corrects_length(y, len(x), owner, levels, active, low, high, h, side, progress, span, limit):
                    continue
            if fine.shape[3]:
                record(dense, y, x, rate, span, h, samples, progress[CELL] * SAMPLES_PER_STEP, b, fine)
            if is_whole and has_maps:
                for i in range(len(z)):
                    z[i] = zeta_end[i]
            elif is_whole:
                propagate_state(turn, push, w, z)
            else:
                propagate_state(cut_turn, cut_push, w, z)
            for j in range(len(x)):
                x[j], rate[j] = y[len(y) - 2 * len(x) + j], y[len(y) - len(x) + j]
            if breakpoints is not None:
                apply_rate_jump(breakpoints, r, cell, span, rate)
            if _finish_step(active, exits, side, progress, span):
                if len(strobes) and progress[CELL] % N == 0:
                    for i in range(len(z)):
                        strobes[progress[CELL] // N - 1, b, i] = z[i]
            elif breakpoints is not None:
                span[1] = next_breakpoint(breakpoints.first, breakpoints.position, r, cell, span[0]) - span[0]
    return waiting


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
def _corrects_length(
    y: Array,
    m: int,
    owner: Integers,
    levels: Array,
    segment: Integers,
    low: Array,
    high: Array,
    h: float,
    side: Integers,
    progress: Integers,
    span: Array,
    limit: float,
) -> bool:
    """Return whether a step must be repeated with a corrected length, because it does not end on its breakpoint.

    The step does not exceed the limit, in the cell.
    """
    j, end = progress[TARGET], len(y) - 2 * m
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
