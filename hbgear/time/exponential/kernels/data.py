"""Data of the kernels: models, tables of steps, and the state of motions that are integrated together."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Bools, Integers


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
    h (R,): duration of a cell; a number in a row of the plan.
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
    h: Any


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


class Shared(NamedTuple):
    """Packed models with their steps over whole cells.

    plan, method, breakpoints: see `Plan`, `Method` and `Breakpoints`. cells: tables for R rows and N cells.
    maps: steps over whole cells that are linear in the state alone, see `fold`, or empty.
    curves: D rows of Chebyshev coefficients of turn, observe, feedback and push over the length of a step; without rows
    these tables are computed.
    """

    plan: Plan
    method: Method
    breakpoints: Breakpoints | None
    cells: Tables
    maps: Array
    curves: Tables


class Work(NamedTuple):
    """State of G motions that are integrated together, and scratch arrays.

    progress (G, 7): cell, target, length corrections, segments passed, Newton iterations, whether the cell is divided,
    and the row of drive and k of the step.
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


Part = tuple[float, float, int]
"""Part (x, x + length) of a period of N cells, in cells: x, length, N."""

# columns of Work.progress
CELL, TARGET, LENGTH_CORRECTIONS, SEGMENTS_PASSED, NEWTON_ITERATIONS, IS_DIVIDED, ROW = range(7)


TO_EXIT, TO_END = -1, -2  # target of a step: its end unless an element leaves its segment; its end in any case


def allocate_tables(rows: int, cells: int, s: int, m: int, q: int, springs: int) -> Tables:
    """Return tables filled with zeros."""
    n = (s + 1) * 2 * m
    shapes = (rows, 2 * q, n), (rows, n, s * m), (rows, s * m, 2 * q), (rows, cells, n), (rows, cells, s, springs + m)
    return Tables(np.zeros((rows, q), dtype=complex), *map(np.zeros, shapes))


def allocate_workspace(motions: int, s: int, m: int, q: int, contacts: int) -> Work:
    """Return the workspace of a number of motions, none of which is under way."""
    rows = m + contacts
    G, n, r, z, integer, pair = motions, (s + 1) * 2 * m, s * m, np.zeros, np.int64, complex
    progress = z((G, 7), dtype=integer)
    progress[:, TARGET] = TO_EXIT
    return Work(
        progress=progress,
        prepared=z(G, dtype=np.bool_),
        span=z((G, 2)),
        free=z((G, n)),
        y=z((G, n)),
        w=z((G, r)),
        exits=z((G, rows)),
        side=z((G, rows), dtype=integer),
        levels=z((G, rows, 4)),
        forces=z((G, 3, s, m)),
        J=z((r, r)),
        right=z(r),
        turns=z((s + 1, q), dtype=pair),
        inner=z((s, s + 1, q), dtype=pair),
        powers=z((s + 2, (s + 1) * q), dtype=pair),
        samples=z((4, max(2 * s + 5, SAMPLES_PER_STEP + 1))),
        zeta_end=z(2 * q),
        scratch=z((2, r)),
    )
