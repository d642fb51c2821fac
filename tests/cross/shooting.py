"""Time integration with its variational equation, to check harmonic balance against: nothing here uses it.

    y = (q, q'),   y' = f(t, y),   Phi' = df/dy Phi,   Phi(0) = 1,   over nu periods 2 pi / Omega

On each piece a piecewise-linear law is the straight line it has there, so the integrator never sees a corner: it stops
where an element reaches the end of its piece and goes on with the next line.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from hbgear.mechanics import PiecewiseLinear
from hbgear.mechanics.series.fourier import derive, evaluate, to_complex, to_real


@dataclass(frozen=True)
class Period:
    """State (2n,) and monodromy matrix (2n, 2n) at the end, and the instants t of the corners passed."""

    end: np.ndarray
    monodromy: np.ndarray
    instants: list


class Line:
    """One straight piece of a piecewise-linear law: p = stiffness(tau) (slope d + offset) for low < d < high."""

    def __init__(self, law, piece):
        corners, slopes = np.array(law.corners), law.slopes
        zero = int(np.searchsorted(corners, 0.0))
        offset = law.force_at_zero
        for i in range(zero, piece):
            offset += (slopes[i] - slopes[i + 1]) * corners[i]
        for i in range(zero, piece, -1):
            offset += (slopes[i] - slopes[i - 1]) * corners[i - 1]
        self.law, self.piece, self.slope, self.offset = law, piece, slopes[piece], offset
        self.low, self.high = np.concatenate([[-np.inf], corners, [np.inf]])[piece : piece + 2]

    def force(self, d, v, tau):
        k = float(self.law.stiffness(tau))
        return k * (self.slope * d + self.offset), k * self.slope, 0.0

    def beyond(self, end):
        return Line(self.law, self.piece + (1 if end == "high" else -1))


class Smooth:
    """A law without corners."""

    low, high = -np.inf, np.inf

    def __init__(self, law):
        self.force = law.force


class Flow:
    """The equations of motion of a `System` at one Omega as y' = f(t, y)."""

    def __init__(self, system, Omega):
        M, C, K = (A.toarray() if hasattr(A, "toarray") else np.asarray(A) for A in (system.M, system.C, system.K))
        self.W, self.Omega, self.n = system.W, Omega, system.n
        c = np.array([e.damping for e in system.elements])
        self.inverse = np.linalg.inv(M)
        self.C, self.K = C + (self.W * c) @ self.W.T, K
        self.elements, self.loads = system.elements, system.load
        self.c = c

    def gaps(self, t, y):
        tau = self.Omega * t
        rows = [e.displacement.row() for e in self.elements]
        e = np.array([evaluate(row, tau)[0] for row in rows])
        de = self.Omega * np.array([evaluate(row, tau, 1)[0] for row in rows])
        return self.W.T @ y[: self.n] - e, self.W.T @ y[self.n :] - de, de

    def load(self, tau):
        F = np.zeros(self.n)
        for load in self.loads:
            for order, amplitude in load.complex(self.n).items():
                F += self.Omega**load.power * (amplitude * np.exp(1j * order * tau)).real
        return F

    def __call__(self, t, Y, pieces):
        """Derivative of (y, Phi), flattened."""
        n = self.n
        Y = Y.reshape(2 * n, -1)
        d, v, de = self.gaps(t, Y[:, 0])
        p, k, c = np.array(
            [piece.force(*x, self.Omega * t) for piece, x in zip(pieces, zip(d, v, strict=True), strict=True)]
        ).T
        out = np.empty_like(Y)
        out[:n] = Y[n:]
        force = -self.C @ Y[n:] - self.K @ Y[:n]
        force[:, 0] += self.load(self.Omega * t) - self.W @ (p - self.c * de)
        force[:, 1:] -= self.W @ (k[:, None] * (self.W.T @ Y[:n, 1:]) + c[:, None] * (self.W.T @ Y[n:, 1:]))
        out[n:] = self.inverse @ force
        return out.ravel()


def integrate(system, Omega, y, nu=1, tolerance=1e-12):
    """One period from the state y (2n,) at tau = 0."""
    flow, n = Flow(system, Omega), system.n
    d, *_ = flow.gaps(0.0, y)
    pieces = [
        Line(e.law, int(np.searchsorted(e.law.corners, x))) if isinstance(e.law, PiecewiseLinear) else Smooth(e.law)
        for e, x in zip(system.elements, d, strict=True)
    ]
    t, T = 0.0, nu * 2 * np.pi / Omega
    Y = np.column_stack([y, np.eye(2 * n)]).ravel()
    instants = []
    while t < T:
        ends, events = _events(flow, pieces)
        run = solve_ivp(flow, (t, T), Y, method="DOP853", rtol=tolerance, atol=tolerance, events=events, args=(pieces,))
        assert run.success, run.message
        t, Y = run.t[-1], run.y[:, -1]
        if run.status == 1:
            j, end = next(which for which, found in zip(ends, run.t_events, strict=True) if found.size)
            pieces[j] = pieces[j].beyond(end)
            instants.append(t)
    Y = Y.reshape(2 * n, -1)
    return Period(Y[:, 0], Y[:, 1:], instants)


def _events(flow, pieces):
    """Terminal events at the finite ends of the pieces, each falling through zero, and whose they are."""
    ends, events = [], []
    for j, piece in enumerate(pieces):
        for end, sign, level in (("low", 1.0, piece.low), ("high", -1.0, piece.high)):
            if np.isfinite(level):

                def event(t, Y, _, j=j, sign=sign, level=level):
                    return sign * (flow.gaps(t, Y.reshape(2 * flow.n, -1)[:, 0])[0][j] - level)

                event.terminal, event.direction = True, -1
                ends.append((j, end))
                events.append(event)
    return ends, events


def state(problem, X, **parameters):
    """The state y (2n,) at tau = 0 of a motion found by harmonic balance."""
    q = problem.motion(X, **parameters)
    velocity = parameters["Omega"] / problem.nu * to_real(derive(to_complex(q)))
    return np.concatenate([evaluate(q, 0.0)[:, 0], evaluate(velocity, 0.0)[:, 0]])


def shoot(system, Omega, y, nu=1, tolerance=1e-12):
    """Periodic motion near y by Newton on the end of a period: its state and its `Period`."""
    for _ in range(12):
        period = integrate(system, Omega, y, nu, tolerance)
        gap = period.end - y
        if np.linalg.norm(gap) <= 100 * tolerance * (1 + np.linalg.norm(y)):
            return y, period
        y = y - np.linalg.lstsq(period.monodromy - np.eye(len(y)), gap, rcond=1e-10)[0]
    raise AssertionError(f"shooting did not converge: the period closes to {np.linalg.norm(gap):.1e}")
