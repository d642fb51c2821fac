"""Kernel: pseudo-arclength continuation of periodic motions in Omega without Python.

Steps are predicted, accepted and adapted by `hbgear.continuation.stepping.kernels`. Residual and Jacobian are computed
by `hbgear.harmonic.equations.assembly_kernels`.
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
    packed: Any, history: Any, count: int, size: Any, step: float, span: Any, control: Any, limits: Any, points: Any
) -> tuple[int, float, int, float]:
    """Compute points of a branch until ``points`` is full, the branch leaves the span, or the smallest step fails.

    Parameters
    ----------
    packed : PackedModel
        Arrays of the model.
    history : ndarray, shape (2, points, n + 1)
        The previous points (X, Omega) and their tangents, the newest first; overwritten.
    count : int
        Number of previous points in ``history``.
    size : ndarray, shape (2,)
        Norm of the largest motion so far, which is updated, and the scale of Omega.
    step : float
        First arclength step.
    span : ndarray, shape (2,)
        Interval of Omega; the first point outside is the last one.
    control : ndarray
        Step size control, see `hbgear.continuation.stepping.kernels.next_step`.
    limits : ndarray, shape (4,)
        Limits of Newton's method, see `hbgear.continuation.stepping.kernels.newton_status`.
    points : ndarray, shape (max_points, 2 (n + 1) + 4)
        Array to be filled with u, tangent, step, orientation, iterations and residual of each new point.

    Returns
    -------
    point_count : int
        Number of new points.
    step : float
        Next step.
    status : int
        Status of the last step, see `hbgear.continuation.stepping.status`; `ACCEPTED` unless it was rejected.
    value : float
        Value for the message of this status.
    """
    u, t, m = history[0], history[1], packed.laws.cubic.shape[0]
    n, vectors = u.shape[1] - 1, np.empty((6, u.shape[1]))
    equations = workspace_for(packed), np.empty(n), np.empty(n), np.empty((n + 1, n + 3)), vectors[0]
    scale, normal, predicted, point, direction = vectors[1], vectors[2], vectors[3], vectors[4], vectors[5]
    statistics, errors = np.empty(3), np.empty(2)
    errors[0] = control[2]
    point_count, status, value = 0, ACCEPTED, 0.0
    while point_count < points.shape[0]:
        _rescale(u[0], size, m, scale)
        arclength_normal(t[0], scale, normal)
        predict(u, t, count, scale, step, predicted)
        status = _corrected(packed, predicted, normal, limits, equations, point, direction, statistics)
        value, prediction_error = statistics[2], 0.0
        if status == ACCEPTED:
            errors[1] = control[4] if count > 1 and step > NO_ERROR_CONTROL_BELOW * control[0] else math.inf
            status, angle, prediction_error = accept_step(point, direction, predicted, u[0], t[0], scale, step, errors)
            value = prediction_error if status == PREDICTION_ERROR else angle
        if status != ACCEPTED:
            if step <= control[0]:
                break
            step = max(0.5 * step, control[0])
            continue
        _store(points[point_count], point, direction, step, statistics)
        point_count += 1
        count = min(count + 1, u.shape[0])
        _shift(u, point, count)
        _shift(t, direction, count)
        step = next_step(step, statistics[1], angle, prediction_error, control)
        if not span[0] < point[n] < span[1]:
            break
    return point_count, step, status, value


@kernel
def _rescale(u: Any, size: Any, m: int, scale: Any) -> None:
    """Fill the scales of the unknowns with the norm of the largest motion so far, and the scale of Omega."""
    n = u.shape[0] - 1
    total = alternating = 0.0
    for i in range(n):
        square = u[i] * u[i]
        total += square
        if i % (n // m):
            alternating += square
    size[0] = max(size[0], math.sqrt(alternating))
    floor = 1e-2 * math.sqrt(total)
    for i in range(n):
        scale[i] = max(size[0], floor if floor > 0.0 else 1.0)
    scale[n] = size[1]


@kernel
def _shift(history: Any, point: Any, count: int) -> None:
    """Insert a new point before the previous ones."""
    for i in range(point.shape[0]):
        for k in range(count - 1, 0, -1):
            history[k, i] = history[k - 1, i]
        history[0, i] = point[i]


@kernel
def _store(point: Any, u: Any, t: Any, step: float, statistics: Any) -> None:
    """Store a new point, its tangent, step and Newton statistics."""
    n = u.shape[0]
    for i in range(n):
        point[i], point[n + i] = u[i], t[i]
    point[2 * n] = step
    for k in range(3):
        point[2 * n + 1 + k] = statistics[k]


@inlined
def _corrected(
    packed: Any, predicted: Any, normal: Any, limits: Any, equations: Any, point: Any, direction: Any, statistics: Any
) -> int:
    """Solve by Newton's method in the plane through the prediction; return the status.

    ``equations`` holds the workspace of the model and the arrays R, dR, A and u of the iteration. statistics (3,)
    receives the sign of the determinant, the number of iterations and the residual.
    """
    workspace, R, dR, A, u = equations
    n = R.shape[0]
    for i in range(n + 1):
        u[i] = predicted[i]
    previous = first = best = math.inf
    for iteration in range(int(limits[2]) + 2):
        if not u[n] > 0.0:
            return NOT_CONVERGED
        size = residual_and_jacobian(packed, u, R, A, dR, workspace)  # J in the upper left block of A
        residual = scaled_norm(R) / size
        distance = 0.0
        for i in range(n):
            A[i, n], A[i, n + 1], A[i, n + 2] = dR[i], R[i], 0.0
        for j in range(n + 1):
            A[n, j] = normal[j]
            distance += normal[j] * (u[j] - predicted[j])
        A[n, n + 1], A[n, n + 2] = distance, 1.0
        sign = solve_in_place(A)
        if sign == 0:
            return SINGULAR
        step_square = point_square = 0.0
        for i in range(n + 1):
            step_square += A[i, n + 1] ** 2
            point_square += (u[i] - A[i, n + 1]) ** 2
        step = math.sqrt(step_square / max(point_square, 1e-300))
        acceptable, status = newton_status(residual, step, previous, first, best, iteration, limits)
        first, previous = min(first, residual), step
        if acceptable:
            best = residual
            statistics[0], statistics[1], statistics[2] = sign, iteration, residual
            for i in range(n + 1):
                point[i], direction[i] = u[i], A[i, n + 2]
        if status == DIVERGED:
            statistics[2] = residual
            return NOT_CONVERGED
        if status == CONVERGED:
            return ACCEPTED
        for i in range(n + 1):
            u[i] -= A[i, n + 1]
    return ACCEPTED if best < math.inf else NOT_CONVERGED
