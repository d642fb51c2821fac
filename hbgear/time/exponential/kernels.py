"""Kernels that carry motions over steps in which the linear part is exact: see `exponential`.

    zeta' = poles zeta - input w,   d, v = Re(output zeta) + steady(tau),   w = p - kr d

of displacements e with corners steady has -e, and w = p - kr (d + e) - c e'.

The period is cut into N cells. A step over a whole cell has its tables ready; one over a part (x, x + length) makes
its own. Newton's iterations on w at the Gauss points end after the first where the laws are straight.
A step in which an element leaves its piece is taken again up to the corner, and the rest of the cell after it. A cell
in which the excitation has corners is taken in parts, too.

Laws that are no tables of numbers are asked in Python: `march` then returns whenever it needs the force of a motion.

What is called for every step makes no views of arrays and takes no tuples of them: counting their references would
cost more than the step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import kernel
from hbgear.harmonic.multipliers.phi_functions import integrals
from hbgear.time.exponential.segments import FINE, ON, Bools, Integers

_NEAR = 1e-9  # distance from a corner, in its size, at which a step may end: what is missed goes with its square
_ROUNDS = 24  # pieces a motion may pass within one cell before the rest of it is taken as it is
_CORRECTIONS = 3  # of the length of a step that is to end on a corner
_ITERATIONS = 30  # of Newton

_SCAN, _LAST = -1, -2  # aims of a step: to its end if no element leaves its piece; to its end in any case


class Tables(NamedTuple):
    """What steps are made of, for each of R rows, and for each of C cells what depends on the phase: see `tabulate`.

    turn (R, q) takes zeta to the end, observe (R, 2 q, (s + 1) 2 m) to d and v at the nodes;
    feedback (R, (s + 1) 2 m, s m) takes w there, push (R, s m, 2 q) to zeta.
    drive (R, C, (s + 1) 2 m): steady d and v at the nodes. k (R, C, s, S + m): stiffness of the springs there, then
    kr e + c e' of the elements whose e has corners.
    """

    turn: ComplexArray
    observe: Array
    feedback: Array
    push: Array
    drive: Array
    k: Array


class Plan(NamedTuple):
    """The machines: R = 1 for all motions, or a row for each.

    poles (R, q), output (R, 2 m, q) of d and v, input (R, q, m), kr (R, m): the structure, one mode of each pair.
    steady (R, L + 1, 2 m), stiffness (R, S, K + 1): harmonics of d and v of the linear part alone, and of the springs.
    slope, offset (R, S, P), low, high (R, m, P), cubic (R, m, 2): as of `LawTable`.
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


class Stops(NamedTuple):
    """Corners of the excitation, for each row of the plan. Kernels take None for none, and are then compiled without.

    at (R, S + m, P), rows (R, S + m, P, 4): stiffness and displacements with corners, as of `Excitation`.
    first (R, N + 1), place, kink (R, I), (R, I, m): its `stops`. kr, c (R, m): springs and dampers of the elements.
    """

    at: Array
    rows: Array
    first: Integers
    place: Array
    kink: Array
    kr: Array
    c: Array


class Method(NamedTuple):
    """What is the same for all motions.

    element (S,), asked (m,): as of `LawTable`. straight: whether all laws are straight on their pieces.
    nodes (s + 1,): the Gauss points and 1. lagrange (s, s): see `collocation.gauss`.
    dense (2 s + 4, 2 s + 4): what each d and h v at 0, the Gauss points and 1 adds to the Chebyshev coefficients.
    values, slopes (2 s + 4, FINE + 1): the same for d and h v at equal instants.
    """

    element: Integers
    asked: Bools
    straight: bool
    nodes: Array
    lagrange: Array
    dense: Array
    values: Array
    slopes: Array


class Work(NamedTuple):
    """Where the motions under way stand, G of them at once, and room to compute in.

    place (G, 6): cell, aim, corrections, rounds, iterations, whether the cell has corners. laid (G,): whether a step is
    laid out. span (G, 2): x and length of it, in cells.
    free, y (G, (s + 1) 2 m), w (G, s m): of the step, d and v without w and with it.
    at (G, m), gone (G, m): where in it elements leave their pieces, and through which end.
    given (G, 3, s, m): p, dp/dd, dp/dv of the laws that are asked.
    """

    place: Integers
    laid: Bools
    span: Array
    free: Array
    y: Array
    w: Array
    at: Array
    gone: Integers
    given: Array
    J: Array
    right: Array
    turns: ComplexArray
    inner: ComplexArray
    powers: ComplexArray
    samples: Array
    ahead: Array
    spare: Array


_CELL, _AIM, _CORRECTED, _PASSED, _ITERATED, _CUT = range(6)  # columns of Work.place


def tables_for(rows: int, cells: int, s: int, m: int, q: int, springs: int) -> Tables:
    """Tables yet to be filled in."""
    n = (s + 1) * 2 * m
    shapes = (rows, 2 * q, n), (rows, n, s * m), (rows, s * m, 2 * q), (rows, cells, n), (rows, cells, s, springs + m)
    return Tables(np.zeros((rows, q), dtype=complex), *map(np.zeros, shapes))


def work_for(motions: int, s: int, m: int, q: int) -> Work:
    """For so many motions at once, none of them under way."""
    G, n, r, z, integer, pair = motions, (s + 1) * 2 * m, s * m, np.zeros, np.int64, complex
    place = z((G, 6), dtype=integer)
    place[:, _AIM] = _SCAN
    return Work(
        place=place, laid=z(G, dtype=np.bool_), span=z((G, 2)), free=z((G, n)), y=z((G, n)), w=z((G, r)), at=z((G, m)),
        gone=z((G, m), dtype=integer), given=z((G, 3, s, m)), J=z((r, r)), right=z(r), turns=z((s + 1, q), dtype=pair),
        inner=z((s, s + 1, q), dtype=pair), powers=z((s + 2, (s + 1) * q), dtype=pair),
        samples=z((4, max(2 * s + 5, FINE + 1))), ahead=z(2 * q), spare=z((2, r)),
    )  # fmt: skip


@kernel
def integrate_segments(
    plan: Plan,
    method: Method,
    corners: Stops | None,
    whole: Tables,
    folded: Array,
    curves: Tables,
    cut: Tables,
    work: Work,
    zeta: Array,
    d: Array,
    v: Array,
    piece: Integers,
    first: int,
    last: int,
    begin: int,
    end: int,
    strobes: Array,
    fine: Array,
) -> int:
    """Carry the motions first..last over the cells begin..end, in place; how many of them are not there yet.

    They are not if laws must be asked: where work.laid, work.y then holds the d and v to ask them at, and the next call
    goes on.

    Parameters
    ----------
    whole, cut : tables of steps over whole cells, for R rows and N cells, and over parts, for G rows and one cell.
    folded : steps over whole cells in one go, see `fold`, or empty.
    curves : how turn, observe, feedback and push depend on the length of a step: D rows of Chebyshev coefficients, or
        none to have them computed.
    zeta : (B, 2 q) real parts, then imaginary parts. d, v, piece : (B, m).
    begin, end : N cells make an excitation period, the first of which begins with 0.
    strobes : (periods, B, 2 q) or empty: zeta after each period.
    fine : (2, B, m, periods N FINE) or empty: d and v at equal instants.
    """
    asks, waiting, N, only = method.asked.any(), 0, whole.drive.shape[1], cut.drive.shape[1] - 1
    element, asked, straight, nodes, lagrange, dense, values, slopes = method
    leaps, ahead, spare, D = len(folded) > 0, work.ahead, work.spare, len(curves.turn)
    recalls, turns_of, observes_of = D > 0, curves.turn, curves.observe.reshape(D, cut.observe[0].size)
    feedbacks_of, pushes_of = curves.feedback.reshape(D, cut.feedback[0].size), curves.push.reshape(D, cut.push[0].size)
    J, right, turns, inner, powers, samples = work.J, work.right, work.turns, work.inner, work.powers, work.samples
    for b in range(first, last):
        r, g = b if len(plan.h) > 1 else 0, b - first if asks else 0
        kr, cubic, slope, offset = plan.kr[r], plan.cubic[r], plan.slope[r], plan.offset[r]
        low, high, h, steady, stiffness = plan.low[r], plan.high[r], plan.h[r], plan.steady[r], plan.stiffness[r]
        poles, output, input = plan.poles[r], plan.output[r], plan.input[r]
        turn, observe, feedback, push = whole.turn[r], whole.observe[r], whole.feedback[r], whole.push[r]
        drive, k, cut_drive, cut_k = whole.drive[r], whole.k[r], cut.drive[g], cut.k[g]
        cut_turn, cut_observe, cut_feedback, cut_push = cut.turn[g], cut.observe[g], cut.feedback[g], cut.push[g]
        flat_observe, flat_feedback, flat_push = cut_observe.reshape(-1), cut_feedback.reshape(-1), cut_push.reshape(-1)
        place, span, free, y, w, given = work.place[g], work.span[g], work.free[g], work.y[g], work.w[g], work.given[g]
        at, gone, z, x, rate, on = work.at[g], work.gone[g], zeta[b], d[b], v[b], piece[b]
        if not asks:
            place[_CELL] = begin
        while True:
            cell, uncut = place[_CELL] % N, place[_PASSED] == 0 and place[_AIM] == _SCAN
            if corners is not None:
                uncut = uncut and place[_CUT] == 0
            if not work.laid[g]:
                if place[_CELL] >= end:
                    break
                if uncut:
                    span[0], span[1] = 0.0, 1.0
                    if corners is not None:
                        span[1] = _until(corners.first, corners.place, r, cell, 0.0)
                        uncut = span[1] == 1.0
                        place[_CUT] = 0 if uncut else 1
                if uncut:
                    if leaps:
                        _leap(folded, cell, on, low.shape[1], z, y, ahead)
                    else:
                        _predict(observe, drive, cell, z, free, y, w)
                else:
                    if recalls:
                        _recall(turns_of, span[1], cut_turn)
                        _recall(observes_of, span[1], flat_observe)
                        _recall(feedbacks_of, span[1], flat_feedback)
                        _recall(pushes_of, span[1], flat_push)
                    else:
                        tabulate(
                            poles, output, input, span[1] * h, nodes, lagrange, cut_turn, cut_observe, cut_feedback,
                            cut_push, turns, inner, powers, spare,
                        )  # fmt: skip
                    excite(steady, stiffness, nodes, cell + span[0], span[1], N, only, cut_drive, cut_k)
                    if corners is not None:
                        add_pieces(corners, r, h, nodes, cell + span[0], span[1], N, only, cut_drive, cut_k)
                    _predict(cut_observe, cut_drive, only, z, free, y, w)
                work.laid[g], place[_ITERATED] = True, 0
                if asks:
                    waiting += 1
                    break
            if uncut and leaps:
                size = moved = 0.0
            elif uncut:
                size = _linearise(
                    kr, cubic, element, slope, offset, on, asked, given, k, cell, feedback, y, w, J, right, spare,
                    corners,
                )  # fmt: skip
                moved = _correct(J, right, feedback, free, y, w)
            else:
                size = _linearise(
                    kr, cubic, element, slope, offset, on, asked, given, cut_k, only, cut_feedback, y, w, J, right,
                    spare, corners,
                )  # fmt: skip
                moved = _correct(J, right, cut_feedback, free, y, w)
            place[_ITERATED] += 1
            if not straight and moved > 1e-13 * size and place[_ITERATED] < _ITERATIONS:
                if asks:
                    waiting += 1
                    break
                continue
            work.laid[g] = False
            if place[_AIM] == _SCAN:
                if _may_leave(nodes, y, x, rate, on, low, high, h * span[1]):
                    stop = _exits(dense, values, slopes, y, x, rate, on, low, high, h * span[1], at, gone, samples)
                    if stop >= 0:
                        span[1] *= at[stop]
                        place[_AIM], place[_CORRECTED] = stop, 0
                        continue
            elif place[_AIM] >= 0:
                limit = 1.0
                if corners is not None:
                    limit = _until(corners.first, corners.place, r, cell, span[0])
                if _misses(y, on, low, high, h, gone, place, span, limit):
                    continue
            if fine.shape[3]:
                _record(dense, y, x, rate, span, h, samples, place[_CELL] * FINE, b, fine)
            if uncut and leaps:
                for i in range(len(z)):
                    z[i] = ahead[i]
            elif uncut:
                _turn(turn, push, w, z)
            else:
                _turn(cut_turn, cut_push, w, z)
            for j in range(len(x)):
                x[j], rate[j] = y[len(y) - 2 * len(x) + j], y[len(y) - len(x) + j]
            if corners is not None:
                _kick(corners, r, cell, span, rate)
            if _arrive(on, at, gone, place, span):
                if len(strobes) and place[_CELL] % N == 0:
                    for i in range(len(z)):
                        strobes[place[_CELL] // N - 1, b, i] = z[i]
            elif corners is not None:
                span[1] = _until(corners.first, corners.place, r, cell, span[0]) - span[0]
    return waiting


@kernel
def fill(plan: Plan, method: Method, corners: Stops | None, lengths: Array, work: Work, out: Tables) -> None:
    """Tables of steps of these lengths in cells, one for each row; with drive and k of as many cells as they have."""
    for i in range(len(lengths)):
        r, cells = i if len(plan.h) > 1 else 0, out.drive.shape[1]
        tabulate(
            plan.poles[r], plan.output[r], plan.input[r], lengths[i] * plan.h[r], method.nodes, method.lagrange,
            out.turn[i], out.observe[i], out.feedback[i], out.push[i], work.turns, work.inner, work.powers, work.spare,
        )  # fmt: skip
        for cell in range(cells):
            excite(
                plan.steady[r], plan.stiffness[r], method.nodes, float(cell), 1.0, cells, cell, out.drive[i], out.k[i]
            )
            if corners is not None:
                add_pieces(corners, r, plan.h[r], method.nodes, float(cell), 1.0, cells, cell, out.drive[i], out.k[i])


@kernel
def fold(plan: Plan, method: Method, corners: Stops | None, whole: Tables, work: Work, out: Array) -> None:
    """Steps over whole cells with straight laws as what they are in all: linear in zeta.

    out (N, combinations of pieces, 2 q + 1, (s + 1) 2 m + 2 q): what each part of zeta, and last the loads, add to d
    and v at the nodes and to zeta at the end.
    """
    m, P, size = plan.kr.shape[1], plan.low.shape[2], plan.output.shape[2] * 2
    n = out.shape[3] - size
    piece, zeta, free, y, w = np.zeros(m, dtype=np.int64), work.ahead, work.free[0], work.y[0], work.w[0]
    for cell in range(out.shape[0]):
        for combination in range(out.shape[1]):
            for j in range(m):
                piece[j] = combination // P**j % P
            for u in range(size, -1, -1):
                for r in range(size):
                    zeta[r] = 1.0 if r == u else 0.0
                _predict(whole.observe[0], whole.drive[0], cell, zeta, free, y, w)
                _linearise(
                    plan.kr[0], plan.cubic[0], method.element, plan.slope[0], plan.offset[0], piece, method.asked,
                    work.given[0], whole.k[0], cell, whole.feedback[0], y, w, work.J, work.right, work.spare,
                    corners,
                )  # fmt: skip
                _correct(work.J, work.right, whole.feedback[0], free, y, w)
                _turn(whole.turn[0], whole.push[0], w, zeta)
                for i in range(n + size):
                    loads = 0.0 if u == size else out[cell, combination, size, i]
                    out[cell, combination, u, i] = (y[i] if i < n else zeta[i - n]) - loads


@kernel
def _leap(folded: Array, cell: int, piece: Integers, P: int, zeta: Array, y: Array, ahead: Array) -> None:
    """A step over a whole cell in one go: d and v at the nodes, zeta at the end."""
    combination, size, n = 0, len(zeta), len(y)
    for j in range(len(piece) - 1, -1, -1):
        combination = combination * P + piece[j]
    for i in range(n):
        y[i] = folded[cell, combination, size, i]
    for i in range(size):
        ahead[i] = folded[cell, combination, size, n + i]
    for r in range(size):
        z = zeta[r]
        for i in range(n):
            y[i] += folded[cell, combination, r, i] * z
        for i in range(size):
            ahead[i] += folded[cell, combination, r, n + i] * z


@kernel
def _predict(observe: Array, drive: Array, cell: int, zeta: Array, free: Array, y: Array, w: Array) -> None:
    """d and v in a step without w."""
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
    powers: ComplexArray, spare: Array,
) -> None:  # fmt: skip
    """Tables of a step of length h: what becomes of zeta and of w at the Gauss points.

    turn, observe, feedback and push are those of `Tables`, filled in; the last four arrays are room.
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
                    spare[0, j * m + b], spare[1, j * m + b] = z.real, z.imag
            for a in range(2 * m):
                z, c = output[a, r] * turns[i, r], output[a, r]
                observe[r, i * 2 * m + a], observe[q + r, i * 2 * m + a] = z.real, -z.imag
                for e in range(s * m):
                    feedback[i * 2 * m + a, e] += c.real * spare[0, e] - c.imag * spare[1, e]
        for e in range(s * m):
            push[e, r], push[e, q + r] = spare[0, e], spare[1, e]


@kernel
def _recall(curves: Array, length: float, out: Array) -> None:
    """A table of a step of this length, in cells, from its Chebyshev coefficients (D, ...)."""
    x = 2.0 * length - 1.0
    before, here = x, 1.0
    for e in range(len(out)):
        out[e] = curves[0, e]
    for i in range(1, len(curves)):
        before, here = here, (2.0 * x * here - before if i > 1 else x)
        for e in range(len(out)):
            out[e] += here * curves[i, e]


@kernel
def excite(
    steady: ComplexArray, stiffness: ComplexArray, nodes: Array, x: float, length: float, N: int, cell: int,
    drive: Array, k: Array,
) -> None:  # fmt: skip
    """steady (L + 1, 2 m) and stiffness (S, K + 1) at the nodes of the part (x, x + length), in cells of the period.

    They stand in drive (C, (s + 1) 2 m) and k (C, s, S), at the cell given.
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
def add_pieces(
    corners: Stops, r: int, h: float, nodes: Array, x: float, length: float, N: int, cell: int, drive: Array, k: Array
) -> None:
    """Add to what `excite` gives the functions with corners of row r, of which none lies in the part.

    The stiffness of springs goes to k, -e and -e' to the drive, kr e + c e' to the end of k.
    """
    at, rows, kr, c = corners.at, corners.rows, corners.kr, corners.c
    m, unit, rate = kr.shape[1], 2 * np.pi / N, 2 * np.pi / (N * h)
    springs = at.shape[1] - m
    for q in range(at.shape[1]):
        middle, piece = unit * (x + 0.5 * length), 0
        while piece + 1 < at.shape[2] and at[r, q, piece + 1] <= middle:
            piece += 1
        a, b, f, g = rows[r, q, piece, 0], rows[r, q, piece, 1], rows[r, q, piece, 2], rows[r, q, piece, 3]
        for i in range(len(nodes)):
            y = unit * (x + length * nodes[i]) - at[r, q, piece]
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
def _until(first: Integers, place: Array, r: int, cell: int, x: float) -> float:
    """Where the step from x on in a cell ends: at the next corner of the excitation, or the end of the cell."""
    for i in range(first[r, cell], first[r, cell + 1]):
        end: float = place[r, i]
        if end > x + 1e-12:
            return end
    return 1.0


@kernel
def _kick(corners: Stops, r: int, cell: int, span: Array, v: Array) -> None:
    """Let v jump if the step ends at a corner of the excitation; after `_until` from its start, each is met once."""
    end = span[0] + span[1]
    if 1.0 - end <= 1e-12:
        end = 1.0
    for i in range(corners.first[r, cell], corners.first[r, cell + 1]):
        if span[0] + 1e-12 < corners.place[r, i] <= end + 1e-12:
            for j in range(len(v)):
                v[j] -= corners.kink[r, i, j]


@kernel
def _linearise(
    kr: Array, cubic: Array, element: Integers, slope: Array, offset: Array, piece: Integers, asked: Bools,
    given: Array, k: Array, cell: int, feedback: Array, y: Array, w: Array, J: Array, right: Array, spare: Array,
    corners: Stops | None,
) -> float:  # fmt: skip
    """The equations of Newton's next step of w, J step = right; the size of the forces."""
    s, m, size = k.shape[1], len(kr), 0.0
    for i in range(s):
        for j in range(m):
            a, d = i * m + j, y[i * 2 * m + j]
            right[a] = (cubic[j, 0] + cubic[j, 1] * d * d) * d
            spare[0, a] = cubic[j, 0] + 3.0 * cubic[j, 1] * d * d
    for spring in range(len(element)):
        j = element[spring]
        bend, shift = slope[spring, piece[j]], offset[spring, piece[j]]
        for i in range(s):
            right[i * m + j] += k[cell, i, spring] * (bend * y[i * 2 * m + j] + shift)
            spare[0, i * m + j] += k[cell, i, spring] * bend
    for i in range(s):
        for j in range(m):
            a, row = i * m + j, i * 2 * m + j
            if asked[j]:
                right[a], spare[0, a] = given[0, i, j], given[1, i, j]
            pull, bend = kr[j] * y[row], spare[0, a] - kr[j]
            size = max(size, abs(right[a]) + abs(pull))
            right[a] -= pull + w[a]
            if corners is not None:
                right[a] -= k[cell, i, len(element) + j]
            for e in range(s * m):
                J[a, e] = bend * feedback[row, e]
            if asked[j]:
                for e in range(s * m):
                    J[a, e] += given[2, i, j] * feedback[row + m, e]
            J[a, a] += 1.0
    return size


@kernel
def _correct(J: Array, right: Array, feedback: Array, free: Array, y: Array, w: Array) -> float:
    """Newton's step of w, and d and v with it; how far w has moved."""
    _solve(J, right)
    moved = 0.0
    for a in range(len(w)):
        moved = max(moved, abs(right[a]))
        w[a] += right[a]
    for i in range(len(y)):
        total = free[i]
        for a in range(len(w)):
            total -= feedback[i, a] * w[a]
        y[i] = total
    return moved


@kernel
def _solve(A: Array, b: Array) -> None:
    """A x = b by elimination with row exchanges; x stands in b, A is lost."""
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
def _turn(turn: ComplexArray, push: Array, w: Array, zeta: Array) -> None:
    """zeta at the end of the step."""
    q = len(turn)
    for r in range(q):
        re, im = zeta[r], zeta[q + r]
        zeta[r] = turn[r].real * re - turn[r].imag * im
        zeta[q + r] = turn[r].real * im + turn[r].imag * re
    for a in range(len(w)):
        for r in range(2 * q):
            zeta[r] -= push[a, r] * w[a]


@kernel
def _arrive(piece: Integers, at: Array, gone: Integers, place: Integers, span: Array) -> bool:
    """Go on from the end of a step: in the rest of the cell, or in the next cell; whether it is the latter."""
    span[0] += span[1]
    if place[_AIM] >= 0:
        stop = at[place[_AIM]] + 1e-9
        for j in range(len(piece)):
            if at[j] <= stop:
                piece[j] += gone[j]
        place[_PASSED] += 1
    if 1.0 - span[0] > 1e-12:
        span[1] = 1.0 - span[0]
        place[_AIM] = _SCAN if place[_PASSED] < _ROUNDS else _LAST
        return False
    place[_CELL] += 1
    place[_AIM], place[_PASSED], place[_CUT] = _SCAN, 0, 0
    return True


@kernel
def _misses(
    y: Array, piece: Integers, low: Array, high: Array, h: float, gone: Integers, place: Integers, span: Array,
    limit: float,
) -> bool:  # fmt: skip
    """Whether a step that is to end on a corner does not, and is to be taken again with the length it now has.

    It does not go beyond the limit, in the cell.
    """
    j, m, end = place[_AIM], len(piece), len(y) - 2 * len(piece)
    level = high[j, piece[j]] if gone[j] > 0 else low[j, piece[j]]
    miss, rate = y[end + j] - level, y[end + m + j]
    if not abs(miss) > _NEAR * (1.0 + abs(level)) or place[_CORRECTED] >= _CORRECTIONS:
        return False
    way = miss / rate / h if abs(rate) > 1e-6 else 0.0
    span[1] = max(0.5 * span[1], min(span[1] - way, 1.5 * span[1], limit - span[0]))
    place[_CORRECTED] += 1
    return True


@kernel
def _may_leave(nodes: Array, y: Array, d: Array, v: Array, piece: Integers, low: Array, high: Array, h: float) -> bool:
    """Whether any element is beyond an end of its piece at a node, or may be between two.

    An arc between two nodes rises above both by a quarter of its length times the change of the rate at most; twice
    that and some is allowed for, and nothing where the rate is large at both and of one sign.
    """
    m = len(d)
    for j in range(m):
        lowest, highest, rate = low[j, piece[j]], high[j, piece[j]], abs(v[j])
        for i in range(len(nodes)):
            rate = max(rate, abs(y[i * 2 * m + m + j]))
        x0, d0, v0 = 0.0, d[j], v[j]
        for i in range(len(nodes)):
            d1, v1 = y[i * 2 * m + j], y[i * 2 * m + m + j]
            if d1 > highest or d1 < lowest:
                return True
            if not (v0 * v1 > 0.0 and min(abs(v0), abs(v1)) > 0.5 * rate):
                reach = h * (nodes[i] - x0) * (0.5 * abs(v1 - v0) + 0.1 * rate)
                if max(d0, d1) + reach > highest or min(d0, d1) - reach < lowest:
                    return True
            x0, d0, v0 = nodes[i], d1, v1
    return False


@kernel
def _exits(
    dense: Array, values: Array, slopes: Array, y: Array, d: Array, v: Array, piece: Integers, low: Array, high: Array,
    h: float, at: Array, gone: Integers, samples: Array,
) -> int:  # fmt: skip
    """Where in the step, in units of it, each element first leaves its piece (inf: not); the first to do so or -1."""
    first = -1
    c, here, rates, data = samples[0], samples[1], samples[2], samples[3]
    for j in range(len(d)):
        _gather(y, d[j], v[j], h, j, len(d), data)
        _apply(values, data, here)
        _apply(slopes, data, rates)
        _apply(dense, data, c)
        at[j], gone[j] = _leaves(c, len(dense), here, rates, low[j, piece[j]], high[j, piece[j]])
        if at[j] < np.inf and (first < 0 or at[j] < at[first]):
            first = j
    return first


@kernel
def _gather(y: Array, d: float, v: float, h: float, j: int, m: int, data: Array) -> None:
    """d and h v of element j at 0, the Gauss points and 1."""
    count = len(y) // (2 * m) + 1
    data[0], data[count] = d, h * v
    for i in range(count - 1):
        data[1 + i], data[count + 1 + i] = y[i * 2 * m + j], h * y[i * 2 * m + m + j]


@kernel
def _apply(columns: Array, data: Array, out: Array) -> None:
    for e in range(columns.shape[1]):
        out[e] = columns[0, e] * data[0]
    for a in range(1, len(columns)):
        for e in range(columns.shape[1]):
            out[e] += columns[a, e] * data[a]


@kernel
def _leaves(c: Array, n: int, d: Array, v: Array, low: float, high: float) -> tuple[float, int]:
    """Where in the step a motion first leaves (low, high), inf if nowhere, and through which end (-1, +1, 0).

    c (n,) are its coefficients, d and v its values at FINE + 1 equal instants. Besides these the extrema between them
    are looked at, so that short visits beyond a corner are found. At the start it is inside, if only by rounding.
    """
    largest = 0.0
    for i in range(FINE + 1):
        largest = max(largest, abs(d[i]))
    slack = ON * (1.0 + largest)
    x0, y0 = 0.0, d[0]
    for i in range(FINE):
        for part in range(2):
            if part == 0:
                if not v[i] * v[i + 1] < 0:
                    continue
                x = (i + v[i] / (v[i] - v[i + 1])) / FINE
                y = value(c, n, x)
            else:
                x, y = (i + 1.0) / FINE, d[i + 1]
            if y > high + slack:
                return _root(c, n, high, x0, x, y0 - high, y - high), 1
            if y < low - slack:
                return _root(c, n, low, x0, x, y0 - low, y - low), -1
            x0, y0 = x, y
    return np.inf, 0


@kernel
def _root(c: Array, n: int, level: float, a: float, b: float, fa: float, fb: float) -> float:
    """Where the motion is on a level, between a and b, by the Illinois rule; a if it is beyond it there already."""
    if not fa * fb < 0:
        return a
    for _ in range(60):
        x = b - fb * (b - a) / (fb - fa)
        f = value(c, n, x) - level
        if f * fb < 0:
            a, fa = b, fb
        else:
            fa *= 0.5
        moved = abs(x - b)
        b, fb = x, f
        if moved <= 1e-14 or f == 0:
            break
    return b


@kernel
def value(c: Array, n: int, x: float) -> float:
    """Chebyshev series of n terms at x in (0, 1) by Clenshaw's rule."""
    t = 4.0 * x - 2.0
    one, two = 0.0, 0.0
    for i in range(n - 1, 0, -1):
        one, two = t * one - two + c[i], one
    total: float = 0.5 * t * one - two + c[0]
    return total


@kernel
def _record(
    dense: Array, y: Array, d: Array, v: Array, span: Array, h: float, samples: Array, start: int, b: int, fine: Array
) -> None:
    """Samples of the cell that lie in the step."""
    x, length, n = span[0], span[1], len(dense)
    c, slope = samples[0], samples[1]
    for j in range(len(d)):
        _gather(y, d[j], v[j], length * h, j, len(d), samples[3])
        _apply(dense, samples[3], c)
        slope[n - 1] = slope[n] = 0.0
        for i in range(n - 1, 0, -1):  # of the derivative in x, by the recursion of Chebyshev polynomials
            slope[i - 1] = slope[i + 1] + 4.0 * i * c[i]
        slope[0] *= 0.5
        for i in range(FINE):
            z = (i / FINE - x) / max(length, 1e-300)
            if 0.0 <= z < 1.0:
                fine[0, b, j, start + i] = value(c, n, z)
                fine[1, b, j, start + i] = value(slope, n, z) / (length * h)
