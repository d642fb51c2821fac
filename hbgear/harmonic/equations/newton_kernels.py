"""Kernels: motions at a given Omega, folds and grazing contacts of a curve in it by Newton, without Python.

    {R, g}(X, Omega) = 0        g the bordered determinant of dR/dX, an extremum less a corner, or nothing: Omega stays

The equations are those of `continuation.bordered.Fold` and of `harmonic.special.Grazing`, Newton that of
`continuation.newton`. The borders of a fold are found by inverse iteration, so that g is the least singular value
of dR/dX up to its sign; its weight is that value over the norm of the matrix.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import inlined, kernel
from hbgear.continuation.numerics.gauss_kernels import scaled_norm, solve_in_place
from hbgear.continuation.problem.evaluation import FOLD, HELD
from hbgear.harmonic.equations.assembly_kernels import curvature, residual_and_jacobian, workspace_for
from hbgear.harmonic.forces.piecewise_kernels import highest_gap, sampled_gap

_TURNED = 1e-10  # one minus the cosine of the angle by which borders may still turn

_STEP = 1e-5  # `differences.STEP`

_ITERATIONS = 30

_HALVINGS = 12


@kernel
def locate(
    numbers: Any, which: int, u: Any, plain: int, tolerance: float, most: int, R: Any, A: Any
) -> tuple[int, float]:
    """Newton from u (n + 1,), which is overwritten, as are R (n + 1,) and A (n + 1, n + 1), the equations there.

    Parameters
    ----------
    which : the clearance that vanishes, as numbered by `HarmonicBalance.clearance`; or `FOLD`, `HELD`.
    plain : so many steps are taken, whatever they lead to; if 0, it is iterated with step halving until the residual is
        below the tolerance, at most so many times, and but for `HELD` a step more is taken if that lowers it.

    Returns
    -------
    Number of steps, -1 if it does not converge; the size of the terms of R.
    """
    n, room = u.shape[0] - 1, workspace_for(numbers)
    rest, J, dR = np.empty(n), np.empty((n, n)), np.empty(n)
    borders, trial, after, B = np.empty((2, n)), u.copy(), np.empty(n + 1), np.empty((n + 1, n + 1))
    count, halved, last, factor, weight, size = -1, 0, False, 1.0, 1.0, 1.0
    while True:  # the equations are evaluated at one place, for what is called at several takes as often to compile
        new = residual_and_jacobian(numbers, trial, rest, J, dR, room)
        if count < 0:
            weight = new / (_bordered(J, borders) if which == FOLD else 1.0 + scaled_norm(u[:n]))
        if which == HELD:
            g = _held(B[n])
        elif which == FOLD:
            g = _determinant(numbers, trial[:n], J, room.matrices[1], borders, B[n])
        else:
            g = _clearance(numbers, which, room, B[n])
        _fill(rest, J, dR, g, weight, after, B)
        if count < 0 or plain:
            good = True
        elif last:
            good = scaled_norm(after) / new < scaled_norm(R) / size
        else:
            good = scaled_norm(after) < scaled_norm(R) * (1.0 - 0.1 * factor)
        if good:
            size, halved, factor = _take(trial, after, B, new, u, R, A), 0, 1.0
            count += 1
        else:
            halved, factor = halved + 1, 0.5 * factor
        if last or halved == _HALVINGS:
            return (count if last else -1), size
        last = not plain and scaled_norm(R) <= tolerance * size
        if last and which == HELD:
            return count, size
        if count == most and not last:
            return -1, size
        if not _move(u, R, A, factor, u if count + 1 == plain else trial):
            return (count if last else -1), size
        if count + 1 == plain:
            return plain, size


@kernel
def _fill(rest: Any, J: Any, dR: Any, g: float, weight: float, R: Any, A: Any) -> None:
    """The residual and the Jacobian of {R, g}; A holds the gradient of g."""
    n = rest.shape[0]
    for i in range(n):
        R[i], A[i, n] = rest[i], dR[i]
        for j in range(n):
            A[i, j] = J[i, j]
    R[n] = weight * g
    for j in range(n + 1):
        A[n, j] *= weight


@kernel
def _take(trial: Any, after: Any, B: Any, size: float, u: Any, R: Any, A: Any) -> float:
    """Go on to the trial point with its equations; the size given."""
    for i in range(u.shape[0]):
        u[i], R[i] = trial[i], after[i]
        for j in range(u.shape[0]):
            A[i, j] = B[i, j]
    return size


@kernel
def _move(u: Any, R: Any, A: Any, factor: float, out: Any) -> bool:
    """out = u - factor A^-1 R; False if A is singular."""
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


@kernel
def _bordered(J: Any, borders: Any) -> float:
    """Put left and right singular vector of the least singular value of J into borders (2, n); the norm of J."""
    n, total = J.shape[0], 0.0
    for i in range(n):
        borders[0, i], borders[1, i] = math.sin(1.0 + i * i), math.sin(2.0 + i * i)
        for j in range(n):
            total += J[i, j] * J[i, j]
    inverse, x = np.empty((n, 2 * n)), np.empty((2, n))
    if not _inverted(J, 0.0, inverse):
        _inverted(J, 1e-15 * math.sqrt(total), inverse)
    for _ in range(_ITERATIONS):
        x[:, :] = 0.0
        for i in range(n):
            for j in range(n):
                x[0, j] += inverse[i, n + j] * borders[1, i]
                x[1, i] += inverse[i, n + j] * borders[0, j]
        turned = max(_turned(borders[0], x[0]), _turned(borders[1], x[1]))
        if not turned > _TURNED:
            break
    return math.sqrt(total)


@kernel
def _inverted(J: Any, shift: float, out: Any) -> bool:
    """Put the inverse of J, whose diagonal is shifted, beside it in out (n, 2n); False if it is singular."""
    n = J.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j], out[i, n + j] = J[i, j], 0.0
        out[i, i] += shift
        out[i, n + i] = 1.0
    return solve_in_place(out) != 0


@kernel
def _turned(border: Any, x: Any) -> float:
    """One minus the cosine of the angle between a border and the vector x that takes its place, of length one."""
    n, along, total, own = border.shape[0], 0.0, 0.0, scaled_norm(border)
    for i in range(n):
        along += border[i] * x[i]
        total += x[i] * x[i]
    total = math.copysign(math.sqrt(total), along)
    for i in range(n):
        border[i] = x[i] / total
    return 1.0 - abs(along) / (abs(total) * own)


@kernel
def _null(J: Any, column: Any, row: Any, transposed: Any, x: Any) -> None:
    """The solution x (n + 1,) of [J column; row^T 0] x = (0, ..., 0, 1), or with J transposed."""
    n = J.shape[0]
    B = np.empty((n + 1, n + 2))
    for i in range(n):
        for j in range(n):
            B[i, j] = J[j, i] if transposed else J[i, j]
        B[i, n], B[n, i], B[i, n + 1] = column[i], row[i], 0.0
    B[n, n], B[n, n + 1] = 0.0, 1.0
    solve_in_place(B)
    for i in range(n + 1):
        x[i] = B[i, n + 1]


@inlined
def _determinant(numbers: Any, X: Any, J: Any, change: Any, borders: Any, row: Any) -> float:
    """The bordered determinant g of J; its gradient in row (n + 1,). change : dZ/dOmega."""
    n = X.shape[0]
    x, w = np.empty(n + 1), np.empty(n + 1)
    _null(J, borders[0], borders[1], np.bool_(False), x)
    _null(J, borders[1], borders[0], np.bool_(True), w)
    v, g = x[:n], float(x[n])
    along, across = np.empty((n, n)), np.empty((n, n))
    curvature(numbers, X, v, _STEP * max(1e-3, scaled_norm(X)) / scaled_norm(v), change, along, across)
    moved = 0.0
    for j in range(n):
        row[j] = 0.0
    for i in range(n):
        for j in range(n):
            row[j] -= w[i] * along[i, j]
            moved += w[i] * across[i, j] * v[j]
    row[n] = -moved
    return g


@kernel
def _held(row: Any) -> float:
    """No change of Omega: zero, and its gradient in row (n + 1,)."""
    for i in range(row.shape[0]):
        row[i] = 0.0
    row[row.shape[0] - 1] = 1.0
    return 0.0


@kernel
def _clearance(numbers: Any, which: int, room: Any, row: Any) -> float:
    """A clearance of the motion whose rows are in the room, see `spread`; its gradient in row (n + 1,)."""
    orders, c, samples = numbers.linear.orders, room.space.waves, room.space.samples
    corner, side = which // 2, 1.0 if which % 2 else -1.0
    j = numbers.laws.owner[corner]
    sampled_gap(numbers, room.rows[j], j, c, samples)
    value, theta = highest_gap(numbers.corners, j, side, c, samples)
    for i in range(row.shape[0]):
        row[i] = 0.0
    at = j * (2 * orders.shape[0] - 1)
    row[at] = 1.0
    for i in range(1, orders.shape[0]):
        row[at + 2 * i - 1], row[at + 2 * i] = math.cos(orders[i] * theta), math.sin(orders[i] * theta)
    return float(side * value - numbers.laws.level[corner])
