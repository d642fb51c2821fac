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
    Y = matrix(np.concatenate([zeros(N, N), balls(np.eye(N))]))
    for step in taylor_steps(flow, a, b, Y, TRANSITION_ORDER):
        Y = step.end
    return array(Y)[N:], array(Y)[:N]


class TaylorStep(NamedTuple):
    """Taylor coefficients y_0 ... y_p of a step of width h, the enclosure of y_{p+1} on it, and y at its end.

    Coefficients are ``flint.arb_mat`` of shape (N, 1) or (2N, N).
    """

    h: Any
    coefficients: list[Any]
    last: Any

    @property
    def end(self) -> Any:
        """The value at the end of the step."""
        total = self.last
        for c in reversed(self.coefficients):
            total = total * self.h + c
        return total


def taylor_steps(flow: BallFlow, a: Any, b: Any, y: Any, order: int) -> Iterator[TaylorStep]:
    """Yield the steps of y' = A y from a to b; y (N, 1), or (2N, N) of the derivative in Omega and the value."""
    bound = _Bound(flow, a, b)
    duration = b - a
    steps = max(1, math.ceil(float(duration.upper()) * bound.rate / MAX_STEP))
    if steps > MAX_TAYLOR_STEPS:
        raise OverflowError(f"{steps} Taylor steps in a piece")
    h = duration / steps
    for m in range(steps):
        tau = a + h * m
        step = TaylorStep(h, _taylor(flow, tau, y, order), bound.coefficient(tau.union(tau + h), h, y, order + 1))
        yield step
        y = step.end


class _Bound:
    """Bounds of solutions on a piece, in the norm max |y_i| / w_i with weights w for which stiff contacts are slow.

        |y(tau_m + s)| <= e^(L h) |y(tau_m)|,   |y_k| <= m_k |y|,   (k + 1) m_{k+1} = sum_j a_j m_{k-j},   a_0 = L

    a_j are bounds of the Taylor coefficients of the matrix at any phase of a step.
    """

    def __init__(self, flow: BallFlow, a: Any, b: Any) -> None:
        self.flow = flow
        A, A1, _ = flow.at(a.union(b)) if flow.varying else (flow.A, flow.A1, None)
        size, change = (np.array([[float(x.abs_upper()) for x in row] for row in B]) for B in (A, A1))
        n, N = flow.n, len(size)
        fast, stiff = float(size[:n, n : 2 * n].max()), float(size[n : 2 * n, :n].sum(axis=1).max())
        velocity = math.sqrt(max(stiff, fast) / fast)
        force = float(size[n : 2 * n, 2 * n :].sum(axis=1).max())
        load = min(fast * velocity**2 / force, 1e6) if force else 1.0
        self.weights = np.array([1.0] * n + [velocity] * n + [load] * (N - 2 * n))
        self.rate = float((((size + change) @ self.weights) / self.weights).max()) * (1 + 1e-9)
        self.factors = [
            max(float(f.abs_upper() + f1.abs_upper()) / w for f, f1, w in zip(force, force1, self.weights, strict=True))
            * sum(float(x.abs_upper()) * w for x, w in zip(row, self.weights, strict=True))
            * (1 + 1e-9)
            for _, force, force1, row in flow.varying
        ]

    def coefficient(self, phases: Any, h: Any, y: Any, order: int) -> Any:
        """Return balls that contain the Taylor coefficient of an order at all phases of a step that begins at y."""
        from flint import arb, arb_mat

        kappa = [stiffness.taylor(phases, order) for stiffness, *_ in self.flow.varying]
        a = [arb(0)] * (order + 1)
        for factor, series in zip(self.factors, kappa, strict=True):
            a = [x + k.abs_upper() * factor for x, k in zip(a, series, strict=True)]
        a[0] = arb(self.rate)
        m = [(a[0] * h).exp().upper()]
        for k in range(order):
            terms = [a[0] * m[k]] if not kappa else [a[j] * m[k - j] for j in range(k + 1)]
            m.append((sum(terms, arb(0)) / (k + 1)).upper())
        rows, columns = y.nrows(), y.ncols()
        w = [arb(x) for x in self.weights] * (rows // len(self.weights))
        out = [[arb(0)] * columns for _ in range(rows)]
        for c in range(columns):
            largest = arb(0)
            for i in range(rows):
                largest = largest.max((y[i, c].abs_upper() / w[i]).upper())
            for i in range(rows):
                out[i][c] = arb(0, (largest * m[order] * w[i]).upper())
        return arb_mat(out)


def _taylor(flow: BallFlow, tau: Any, y: Any, order: int) -> list[Any]:
    """Return the Taylor coefficients of y at tau.

    (k + 1) y_{k+1} = A y_k + sum_s force_s sum_j kappa_{s,j} (row_s y_{k-j})

    Y (2N, N) holds the derivative U in Omega and the value V: U' = A U + A1 V, V' = A V.
    """
    from flint import arb

    N, single = len(flow.A), y.ncols() == 1 and y.nrows() == len(flow.A)
    kappa = [stiffness.taylor(tau, order) for stiffness, *_ in flow.varying]
    A = matrix(flow.A if single else np.block([[flow.A, flow.A1], [zeros(N, N), flow.A]]))
    terms = []
    for _, force, force1, row in flow.varying:
        if single:
            terms.append((matrix(force[:, None]), matrix(row[None])))
            continue
        left, right = zeros(2 * N, 2), zeros(2, 2 * N)
        left[:N, 0], left[:N, 1], left[N:, 1] = force, force1, force
        right[0, :N], right[1, N:] = row, row
        terms.append((matrix(left), matrix(right)))
    driven: list[list[Any]] = [[] for _ in terms]
    out = [y]
    for k in range(order):
        total = A * out[k]
        for s, (left, right) in enumerate(terms):
            driven[s].append(right * out[k])
            drive = driven[s][k] * kappa[s][0]
            for j in range(1, k + 1):
                drive = drive + driven[s][k - j] * kappa[s][j]
            total = total + left * drive
        out.append(total * (1 / arb(k + 1)))
    return out


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
        D_b = (
            A_b @ (self.G_x @ dx + self.G_a * da) + (self._rate(self.A_b, self.slope_b, self.end) + A_b @ self.f_b) * db
        )
        D_p = self.psi_p @ dx - (self.psi_p @ self.f_a + self.G_x @ f_p_a) * da + (f_p_b + A_b @ self.G_p) * db
        return D, D_x, D_a, D_b, D_p
