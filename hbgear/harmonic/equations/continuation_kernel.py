"""Kernel: a stretch of a curve of periodic motions in Omega, row after row without Python.

The rules are those of `hbgear.continuation.stepping.kernels`, the equations those of
`hbgear.harmonic.equations.assembly_kernels`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import inlined, kernel
from hbgear.continuation.numerics.gauss_kernels import scaled_norm, solve_in_place
from hbgear.continuation.stepping.kernels import (
    CONVERGED,
    DIVERGED,
    NO_ERROR_CONTROL_BELOW,
    POLISH_ABOVE,
    accept_step,
    arclength_normal,
    newton_status,
    next_step,
    predict,
)
from hbgear.continuation.stepping.status import ACCEPTED, NOT_CONVERGED, PREDICTION_ERROR, SINGULAR
from hbgear.harmonic.equations.assembly_kernels import residual_and_jacobian, workspace_for


@kernel
def trace_compiled(
    numbers: Any,
    u: Any,
    t: Any,
    count: int,
    size: Any,
    step: float,
    span: Any,
    control: Any,
    tolerances: Any,
    rows: Any,
) -> tuple[int, float, int, float]:
    """Follow the curve until rows are full, it leaves the span, or the shortest step fails.

    Parameters
    ----------
    u, t : (history, n + 1) the last rows and their tangents, the newest first, ``count`` of them; overwritten.
    size : (2,) largest motion so far, which is updated, and the span that the last unknown is scaled by.
    span : (2,) ends of Omega; the row beyond one of them is the last. control : see `stepping.next_step`.
    tolerances : of the residual, of the last Newton step, most iterations.
    rows : (most, 2 (n + 1) + 4) u, tangent, step, orientation, iterations and residual of each new row, to be filled.

    Returns
    -------
    Number of rows, the next step, why the last attempt was refused (`ACCEPTED` if it was not), with its number.
    """
    n = u.shape[1] - 1
    work = np.empty(n), np.empty(n), np.empty((n + 1, n + 3)), np.empty(n + 1), workspace_for(numbers)
    room = work, np.empty((5, n + 1)), np.empty(3), np.empty(2)
    return _pursued(numbers, room, u, t, count, size, step, span, control, tolerances, rows)


@inlined
def _pursued(
    numbers: Any, room: Any, u: Any, t: Any, count: int, size: Any, step: float, span: Any, control: Any,
    tolerances: Any, rows: Any,
) -> tuple[int, float, int, float]:  # fmt: skip
    """`trace_compiled`, in the arrays of the room."""
    n, m = u.shape[1] - 1, numbers.laws.cubic.shape[0]
    work, vectors, told, limits = room
    scale, normal, predicted, found, direction = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4]
    limits[0] = control[2]
    made, why, number = 0, ACCEPTED, 0.0
    while made < rows.shape[0]:
        _rescale(u[0], size, m, scale)
        arclength_normal(t[0], scale, normal)
        predict(u, t, count, scale, step, predicted)
        why = _corrected(numbers, predicted, normal, tolerances, work, found, direction, told)
        number, missed = told[2], 0.0
        if why == ACCEPTED:
            limits[1] = control[4] if count > 1 and step > NO_ERROR_CONTROL_BELOW * control[0] else math.inf
            why, turn, missed = accept_step(found, direction, predicted, u[0], t[0], scale, step, limits)
            number = missed if why == PREDICTION_ERROR else turn
        if why != ACCEPTED:
            if step <= control[0]:
                break
            step = max(0.5 * step, control[0])
            continue
        _keep(rows[made], found, direction, step, told)
        made += 1
        count = min(count + 1, u.shape[0])
        _shift(u, found, count)
        _shift(t, direction, count)
        step = next_step(step, told[1], turn, missed, control)
        if not span[0] < found[n] < span[1]:
            break
    return made, step, why, number


@kernel
def _rescale(u: Any, size: Any, m: int, scale: Any) -> None:
    """Scales of the unknowns: the largest motion so far, and the span."""
    n = u.shape[0] - 1
    whole = moving = 0.0
    for i in range(n):
        square = u[i] * u[i]
        whole += square
        if i % (n // m):
            moving += square
    size[0] = max(size[0], math.sqrt(moving))
    floor = 1e-2 * math.sqrt(whole)
    for i in range(n):
        scale[i] = max(size[0], floor if floor > 0.0 else 1.0)
    scale[n] = size[1]


@kernel
def _shift(past: Any, new: Any, count: int) -> None:
    """Put a new row before the others."""
    for i in range(new.shape[0]):
        for k in range(count - 1, 0, -1):
            past[k, i] = past[k - 1, i]
        past[0, i] = new[i]


@kernel
def _keep(row: Any, u: Any, t: Any, step: float, told: Any) -> None:
    n = u.shape[0]
    for i in range(n):
        row[i], row[n + i] = u[i], t[i]
    row[2 * n] = step
    for k in range(3):
        row[2 * n + 1 + k] = told[k]


@inlined
def _corrected(
    numbers: Any, predicted: Any, normal: Any, tolerances: Any, work: Any, found: Any, direction: Any, told: Any
) -> int:
    """Newton on the plane through the prediction; told : sign of the determinant, iterations, residual."""
    R, dR, A, u, room = work
    n = R.shape[0]
    for i in range(n + 1):
        u[i] = predicted[i]
    last = first = best = math.inf
    most = int(tolerances[2])
    for iteration in range(most + 2):
        if not u[n] > 0.0:
            return NOT_CONVERGED
        size = residual_and_jacobian(numbers, u, R, A, dR, room)  # J in the corner of A
        residual = scaled_norm(R) / size
        off = 0.0
        for i in range(n):
            A[i, n], A[i, n + 1], A[i, n + 2] = dR[i], R[i], 0.0
        for j in range(n + 1):
            A[n, j] = normal[j]
            off += normal[j] * (u[j] - predicted[j])
        A[n, n + 1], A[n, n + 2] = off, 1.0
        sign = solve_in_place(A)
        if sign == 0:
            return SINGULAR
        moved = reached = 0.0
        for i in range(n + 1):
            moved += A[i, n + 1] ** 2
            reached += (u[i] - A[i, n + 1]) ** 2
        step = math.sqrt(moved / max(reached, 1e-300))
        good, what = newton_status(
            residual, step, last, first, best, iteration, tolerances[0], tolerances[1], most, POLISH_ABOVE
        )
        first, last = min(first, residual), step
        if good:
            best = residual
            told[0], told[1], told[2] = sign, iteration, residual
            for i in range(n + 1):
                found[i], direction[i] = u[i], A[i, n + 2]
        if what == DIVERGED:
            told[2] = residual
            return NOT_CONVERGED
        if what == CONVERGED:
            return ACCEPTED
        for i in range(n + 1):
            u[i] -= A[i, n + 1]
    return ACCEPTED if best < math.inf else NOT_CONVERGED
