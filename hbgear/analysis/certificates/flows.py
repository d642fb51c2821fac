"""Rigorous flow of a linear piece and its derivatives, in ball arithmetic.

    y(b) = Psi(b, a) y(a),   dPsi/db = A(b) Psi,   dPsi/da = -Psi A(a)

Constant coefficients: the exponential of (A A'; 0 A)(b - a), which holds dPsi/dOmega as well. Arb computes it with a
bound of the remainder; with one coordinate it is the closed form. Varying stiffness: Taylor steps. The remainder of
order p + 1 on a step is the Taylor coefficient at an unknown phase of the step,

    |y(tau)| <= e^(L h) |y(tau_m)|,   L >= |A(tau)|,   R = y_{p+1}([tau_m, tau_m + h], y([tau_m, tau_m + h])) h^(p+1)

References
----------
Nedialkov, N. S., Jackson, K. R., & Corliss, G. F. (1999). Validated solutions of initial value problems for ordinary
differential equations. Applied Mathematics and Computation 105(1), 21-68.
https://doi.org/10.1016/S0096-3003(98)10083-8.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from hbgear.analysis.certificates.ball_system import BallFlow, Balls, BallSystem, array, balls, matrix, zeros

TRANSITION_ORDER = 28
"""Order of the Taylor series of a transition matrix: the remainder of a step is below 1 / 29! = 1e-31."""

MOTION_ORDER = 22
"""Order of the Taylor series of a motion, for the signs of gaps: remainder below 1 / 23! = 4e-23."""

MAX_STEP = 1.0
"""Largest product of the bound L and the step."""

MAX_TAYLOR_STEPS = 20_000
"""Largest number of steps of one piece."""


def transition(flow: BallFlow, a: Any, b: Any) -> tuple[Balls, Balls]:
    """Return Psi(b, a) and its derivative in Omega, (N, N)."""
    N = len(flow.A)
    if not flow.varying:
        h, block = b - a, zeros(2 * N, 2 * N)
        block[:N, :N] = block[N:, N:] = flow.A * h
        block[:N, N:] = flow.A1 * h
        E = array(matrix(block).exp())
        return E[:N, :N], E[:N, N:]
    Y = np.concatenate([zeros(N, N), balls(np.eye(N))])
    for step in taylor_steps(flow, a, b, Y, TRANSITION_ORDER):
        Y = step.end
    return Y[N:], Y[:N]


class TaylorStep(NamedTuple):
    """Taylor coefficients y_0 ... y_p of a step of width h, the enclosure of y_{p+1} on it, and y at its end."""

    h: Any
    coefficients: list[Balls]
    last: Balls

    @property
    def end(self) -> Balls:
        """The value at the end of the step."""
        total = self.last
        for c in reversed(self.coefficients):
            total = total * self.h + c
        return total


def taylor_steps(flow: BallFlow, a: Any, b: Any, y: Balls, order: int) -> Iterator[TaylorStep]:
    """Yield the steps of y' = A y from a to b; y (N,), or (2N, N) of a transition matrix and its derivative."""
    weights = _weights(flow, a, b, y.ndim)
    bound = _matrix_bound(flow, a, b, weights)
    duration = b - a
    steps = max(1, math.ceil(float(duration.upper()) * bound / MAX_STEP))
    if steps > MAX_TAYLOR_STEPS:
        raise OverflowError(f"{steps} Taylor steps in a piece")
    h = duration / steps
    for m in range(steps):
        tau = a + h * m
        coefficients = _taylor(flow, tau, y, order)
        whole = tau.union(tau + h)
        last = _taylor(flow, whole, _enclosure(y, bound, h, weights), order + 1)[-1]
        step = TaylorStep(h, coefficients, last)
        yield step
        y = step.end


def _whole(flow: BallFlow, a: Any, b: Any) -> tuple[Balls, Balls]:
    """Return balls that contain the matrix, and its derivative in Omega, at all phases from a to b."""
    A, A1, _ = flow.at(a.union(b)) if flow.varying else (flow.A, flow.A1, None)
    return A, A1


def _weights(flow: BallFlow, a: Any, b: Any, copies: int) -> list[float]:
    """Return positive weights (N,) of the norm max |y_i| / w_i, in which the bound L is small for stiff contacts."""
    size = np.array([[float(x.abs_upper()) for x in row] for row in _whole(flow, a, b)[0]])
    n = flow.n
    fast, stiff = float(size[:n, n : 2 * n].max()), float(size[n : 2 * n, :n].sum(axis=1).max())
    velocity = math.sqrt(max(stiff, fast) / fast)
    force = float(size[n : 2 * n, 2 * n :].sum(axis=1).max())
    load = fast * velocity**2 / force if force else 1.0
    return ([1.0] * n + [velocity] * n + [min(load, 1e6)] * (len(size) - 2 * n)) * copies


def _matrix_bound(flow: BallFlow, a: Any, b: Any, weights: list[float]) -> float:
    """Return an upper bound of the norm of (A A'; 0 A) from a to b."""
    A, A1 = _whole(flow, a, b)
    sums = [
        sum(float(x.abs_upper()) * w for x, w in zip((*row, *row1), (weights * 2)[: 2 * len(row)], strict=True)) / own
        for row, row1, own in zip(A, A1, weights, strict=False)
    ]
    return max(sums) * (1 + 1e-9)


def _enclosure(y: Balls, bound: float, h: Any, weights: list[float]) -> Balls:
    """Return balls that contain the solution on a step that begins at y: |y(tau)| <= e^(L h) |y| for each column."""
    from flint import arb

    growth = (arb(bound) * h).exp().upper()
    out = np.empty(y.shape, dtype=object)
    w = balls(weights)
    for column in np.ndindex(*y.shape[1:]):
        largest = arb(0)
        for x, weight in zip(y[(slice(None), *column)], w, strict=True):
            largest = largest.max((x.abs_upper() / weight).upper())
        out[(slice(None), *column)] = [arb(0, (largest * growth * weight).upper()) for weight in w]
    return out


def _taylor(flow: BallFlow, tau: Any, y: Balls, order: int) -> list[Balls]:
    """Return the Taylor coefficients of y at tau.

    (k + 1) y_{k+1} = A y_k + sum_s force_s sum_j kappa_{s,j} (row_s y_{k-j})

    Y (2N, N) holds the derivative U in Omega and the value V: U' = A U + A1 V, V' = A V.
    """
    N, single = len(flow.A), y.ndim == 1
    kappa = [balls(stiffness.taylor(tau, order)) for stiffness, *_ in flow.varying]
    left, mixed = matrix(flow.A), matrix(flow.A1)
    V, U = (matrix(y[:, None]), None) if single else (matrix(y[N:]), matrix(y[:N]))
    driven: list[list[Balls]] = [[] for _ in flow.varying]
    out = [y]
    for k in range(order):
        total = array(left * V)
        above = None if U is None else array(left * U + mixed * V)
        for s, (_, force, force1, row) in enumerate(flow.varying):
            driven[s].append(_driven(row, array(V), None if U is None else array(U)))
            drive = kappa[s][k::-1] @ np.array(driven[s])
            total = total + np.outer(force, drive[: total.shape[1]])
            if above is not None:
                above = above + np.outer(force, drive[N:]) + np.outer(force1, drive[:N])
        total = total / (k + 1)
        if above is None:
            out.append(total[:, 0])
        else:
            out.append(np.concatenate([above / (k + 1), total]))
            U = matrix(out[-1][:N])
        V = matrix(total)
    return out


def _driven(row: Balls, V: Balls, U: Balls | None) -> Balls:
    """Return row V, and row U if there is a derivative in Omega."""
    return row @ V if U is None else np.concatenate([row @ V, row @ U])


class Piece:
    """Flow of one segment from state x at phase a to phase b, with first derivatives, and second ones in a direction.

    G : state at b;   G_x, G_a, G_b, G_p : its derivatives in the state, the phases and Omega.
    """

    def __init__(self, system: BallSystem, flow: BallFlow, x: Balls, a: Any, b: Any) -> None:
        self.flow, r = flow, system.r
        psi, psi_p = transition(flow, a, b)
        self.y, c = system.extended(x, a), system.functions(b)
        self.A_a, self.A1_a, self.slope_a = flow.at(a)
        self.A_b, self.A1_b, self.slope_b = flow.at(b)
        self.G = psi[:r] @ self.y
        self.end = np.concatenate([self.G, c])
        self.f_a, self.f_b = self.A_a[:r] @ self.y, self.A_b[:r] @ self.end
        self.G_x, self.psi_p = psi[:r, :r], psi_p[:r, :r]
        self.G_a, self.G_b, self.G_p = -(self.G_x @ self.f_a), self.f_b, psi_p[:r] @ self.y
        self.generator, self.r = system.generator, r

    def _rate(self, A: Balls, slope: Balls, y: Balls) -> Balls:
        """Return the partial derivative of f in the phase, at a fixed state."""
        r = self.r
        return A[:r, r:] @ (self.generator @ y[r:]) + slope[:r] @ y

    def second(self, dx: Balls, da: Any, db: Any) -> tuple[Balls, Balls, Balls, Balls, Balls]:
        """Return D = G_x dx + G_a da + G_b db and its derivatives in x, a, b and Omega."""
        r = self.r
        A_a, A_b = self.A_a[:r, :r], self.A_b[:r, :r]
        D = self.G_x @ dx + self.G_a * da + self.G_b * db
        f_p_a, f_p_b = self.A1_a[:r] @ self.y, self.A1_b[:r] @ self.end
        D_x = -(self.G_x @ A_a) * da + A_b @ self.G_x * db
        turn = A_a @ self.f_a - self._rate(self.A_a, self.slope_a, self.y)
        D_a = -(self.G_x @ (A_a @ dx)) + self.G_x @ turn * da + A_b @ self.G_a * db
        D_b = A_b @ (self.G_x @ dx + self.G_a * da) + (
            self._rate(self.A_b, self.slope_b, self.end) + A_b @ self.f_b
        ) * db
        D_p = self.psi_p @ dx - (self.psi_p @ self.f_a + self.G_x @ f_p_a) * da + (f_p_b + A_b @ self.G_p) * db
        return D, D_x, D_a, D_b, D_p
