"""Kernels: motions at a fixed Omega, folds and grazing contacts by Newton's method, without Python.

    {R, g}(X, Omega) = 0

g is the bordered determinant of dR/dX (fold), an extremum minus a breakpoint (grazing), or the change of Omega (fixed).

The equations agree with `FoldProblem` and `GrazingProblem`, and the step halving with
`hbgear.continuation.solvers.newton`. The borders of a fold are the singular vectors of the smallest singular value of
dR/dX, computed by inverse iteration. Then g is this singular value except for its sign, weighted by the norm of dR/dX.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import inlined, kernel
from hbgear.continuation.numerics.gauss_kernels import scaled_norm, solve_in_place
from hbgear.continuation.problem.evaluation import FOLD, HELD
from hbgear.continuation.problem.finite_differences import STEP
from hbgear.harmonic.equations.assembly_kernels import curvature, residual_and_jacobian, workspace_for
from hbgear.harmonic.forces.piecewise_kernels import highest_gap, sampled_gap
from hbgear.harmonic.forces.projection_kernels import LEAST_STEP, STEP_OVER_SQUARE, shortest_interval

_BORDER_TOLERANCE = 1e-10
"""Change of a border, 1 - cos(angle), at which the inverse iteration has converged."""

_MAX_INVERSE_ITERATIONS = 30
"""Maximum number of inverse iterations for the borders."""

_MAX_HALVINGS = 12
"""Maximum number of halvings of one Newton step."""


@kernel
def locate(
    packed: Any, condition: int, u: Any, full_steps: int, tolerance: float, max_iterations: int, R: Any, A: Any
) -> tuple[int, float]:
    """Solve {R, g} = 0 by Newton's method, starting at u.

    Parameters
    ----------
    packed : PackedModel
        Arrays of the model.
    condition : int
        Index of the clearance that vanishes, see `HarmonicBalance.clearance`; or `FOLD`, or `HELD` for a fixed Omega.
    u : ndarray, shape (n + 1,)
        Initial guess (X, Omega), overwritten by the solution.
    full_steps : int
        Number of full Newton steps without checks. If 0, the iteration uses step halving and stops when the residual is
        below ``tolerance``; except for `HELD`, one more step is taken if it reduces the residual.
    tolerance : float
        Tolerance of the residual, relative to the size of its terms.
    max_iterations : int
        Maximum number of iterations.
    R : ndarray, shape (n + 1,)
        Array for the residual at the solution.
    A : ndarray, shape (n + 1, n + 1)
        Array for the Jacobian at the solution.

    Returns
    -------
    count : int
        Number of steps; -1 if the iteration does not converge.
    size : float
        Size of the terms of R.
    """
    n, workspace = u.shape[0] - 1, workspace_for(packed)
    residual, J, dR = np.empty(n), np.empty((n, n)), np.empty(n)
    borders, trial, new_R, B = np.empty((2, n)), u.copy(), np.empty(n + 1), np.empty((n + 1, n + 1))
    count, halvings, is_final, factor, weight, size = -1, 0, False, 1.0, 1.0, 1.0
    while True:  # one call only: each further call of an inlined function adds its compile time
        new_size = residual_and_jacobian(packed, trial, residual, J, dR, workspace)
        if count < 0:
            weight = new_size / (_fill_borders(J, borders) if condition == FOLD else 1.0 + scaled_norm(u[:n]))
        if condition == HELD:
            g = _fixed_parameter(B[n])
        elif condition == FOLD:
            g = _determinant(packed, trial[:n], J, borders, B[n], workspace)
        else:
            g = _clearance(packed, condition, workspace, B[n])
        _fill(residual, J, dR, g, weight, new_R, B)
        if count < 0 or full_steps:
            is_accepted = True
        elif is_final:
            is_accepted = scaled_norm(new_R) / new_size < scaled_norm(R) / size
        else:
            is_accepted = scaled_norm(new_R) < scaled_norm(R) * (1.0 - 0.1 * factor)
        if is_accepted:
            size, halvings, factor = _accept(trial, new_R, B, new_size, u, R, A), 0, 1.0
            count += 1
        else:
            halvings, factor = halvings + 1, 0.5 * factor
        if is_final or halvings == _MAX_HALVINGS:
            return (count if is_final else -1), size
        is_final = not full_steps and scaled_norm(R) <= tolerance * size
        if is_final and condition == HELD:
            return count, size
        if count == max_iterations and not is_final:
            return -1, size
        if not _newton_step(u, R, A, factor, u if count + 1 == full_steps else trial):
            return (count if is_final else -1), size
        if count + 1 == full_steps:
            return full_steps, size


@kernel
def _fill(residual: Any, J: Any, dR: Any, g: float, weight: float, R: Any, A: Any) -> None:
    """Fill residual and Jacobian of {R, g}; the last row of A contains the gradient of g."""
    n = residual.shape[0]
    for i in range(n):
        R[i], A[i, n] = residual[i], dR[i]
        for j in range(n):
            A[i, j] = J[i, j]
    R[n] = weight * g
    for j in range(n + 1):
        A[n, j] *= weight


@kernel
def _accept(trial: Any, new_R: Any, B: Any, size: float, u: Any, R: Any, A: Any) -> float:
    """Accept the trial point with its residual and Jacobian; return ``size``."""
    for i in range(u.shape[0]):
        u[i], R[i] = trial[i], new_R[i]
        for j in range(u.shape[0]):
            A[i, j] = B[i, j]
    return size


@inlined
def _newton_step(u: Any, R: Any, A: Any, factor: float, out: Any) -> bool:
    """Set out to u - factor A^-1 R; return False if A is singular."""
    n = u.shape[0]
    work = np.empty((n, n + 1))
    for i in range(n):
        for j in range(n):
            work[i, j] = A[i, j]
        work[i, n] = R[i]
    if solve_in_place(work) == 0:
        return False
    for i in range(n):
        out[i] = u[i] - factor * work[i, n]
    return math.isfinite(scaled_norm(out))


@inlined
def _fill_borders(J: Any, borders: Any) -> float:
    """Fill borders (2, n) with the singular vectors of the smallest singular value of J; return the norm of J."""
    n, total = J.shape[0], 0.0
    for i in range(n):
        borders[0, i], borders[1, i] = math.sin(1.0 + i * i), math.sin(2.0 + i * i)
        for j in range(n):
            total += J[i, j] * J[i, j]
    inverse, x = np.empty((n, 2 * n)), np.empty((2, n))
    for shift in (0.0, 1e-15 * math.sqrt(total)):  # one call only, as in `locate`
        if _inverted(J, shift, inverse):
            break
    for _ in range(_MAX_INVERSE_ITERATIONS):
        x[:, :] = 0.0
        for i in range(n):
            for j in range(n):
                x[0, j] += inverse[i, n + j] * borders[1, i]
                x[1, i] += inverse[i, n + j] * borders[0, j]
        rotation = max(_replace_border(borders[0], x[0]), _replace_border(borders[1], x[1]))
        if not rotation > _BORDER_TOLERANCE:
            break
    return math.sqrt(total)


@inlined
def _inverted(J: Any, shift: float, out: Any) -> bool:
    """Fill out (n, 2n) with J + shift I and its inverse; return False if it is singular."""
    n = J.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j], out[i, n + j] = J[i, j], 0.0
        out[i, i] += shift
        out[i, n + i] = 1.0
    return solve_in_place(out) != 0


@kernel
def _replace_border(border: Any, x: Any) -> float:
    """Replace a border by the normalized vector x; return one minus the cosine of the angle between them."""
    n, projection, total, old_norm = border.shape[0], 0.0, 0.0, scaled_norm(border)
    for i in range(n):
        projection += border[i] * x[i]
        total += x[i] * x[i]
    total = math.copysign(math.sqrt(total), projection)
    for i in range(n):
        border[i] = x[i] / total
    return 1.0 - abs(projection) / (abs(total) * old_norm)


@inlined
def _solve_bordered(J: Any, borders: Any, out: Any) -> None:
    """Fill out (2, n + 1) with the solutions of [J b_0; b_1^T 0] x = (0, ..., 0, 1) and [J^T b_1; b_0^T 0] x = same."""
    n = J.shape[0]
    B = np.empty((n + 1, n + 2))
    for k in range(2):
        for i in range(n):
            for j in range(n):
                B[i, j] = J[j, i] if k else J[i, j]
            B[i, n], B[n, i], B[i, n + 1] = borders[k, i], borders[1 - k, i], 0.0
        B[n, n], B[n, n + 1] = 0.0, 1.0
        solve_in_place(B)
        for i in range(n + 1):
            out[k, i] = B[i, n + 1]


@inlined
def _determinant(packed: Any, X: Any, J: Any, borders: Any, row: Any, workspace: Any) -> float:
    """Return the bordered determinant g of J; fill row (n + 1,) with its gradient; overwrite the workspace."""
    n = X.shape[0]
    solutions = np.empty((2, n + 1))
    _solve_bordered(J, borders, solutions)
    v, w, g = solutions[0, :n], solutions[1], float(solutions[0, n])
    dJ_dv, dJ_dOmega = np.empty((n, n)), np.empty((n, n))
    space = workspace.space
    interval = shortest_interval(space.theta, space.number) if packed.laws.spring_element.shape[0] else 2 * math.pi
    relative = min(STEP, max(LEAST_STEP, STEP_OVER_SQUARE * interval * interval))
    curvature(packed, X, v, relative * max(1e-3, scaled_norm(X)) / scaled_norm(v), workspace, dJ_dv, dJ_dOmega)
    dg_dOmega = 0.0
    for j in range(n):
        row[j] = 0.0
    for i in range(n):
        for j in range(n):
            row[j] -= w[i] * dJ_dv[i, j]
            dg_dOmega += w[i] * dJ_dOmega[i, j] * v[j]
    row[n] = -dg_dOmega
    return g


@kernel
def _fixed_parameter(row: Any) -> float:
    """Return g = 0 for a fixed Omega; fill row (n + 1,) with its gradient."""
    for i in range(row.shape[0]):
        row[i] = 0.0
    row[row.shape[0] - 1] = 1.0
    return 0.0


@inlined
def _clearance(packed: Any, index: int, workspace: Any, row: Any) -> float:
    """Return a clearance of the motion in ``workspace.coefficients``, see `spread`; fill row (n + 1,): gradient."""
    orders, c, motion = packed.linear.orders, workspace.space.waves, workspace.space.motion
    breakpoint_, side = index // 2, 1.0 if index % 2 else -1.0
    j = packed.laws.owner[breakpoint_]
    sampled_gap(packed.piecewise, packed.basis, workspace.coefficients[packed.laws.element[j]], j, c, motion)
    value, theta = highest_gap(packed.piecewise, j, side, c, motion)
    for i in range(row.shape[0]):
        row[i] = 0.0
    mean_index = packed.laws.element[j] * (2 * orders.shape[0] - 1)
    row[mean_index] = 1.0
    for i in range(1, orders.shape[0]):
        row[mean_index + 2 * i - 1], row[mean_index + 2 * i] = math.cos(orders[i] * theta), math.sin(orders[i] * theta)
    return float(side * value - packed.laws.level[breakpoint_])
