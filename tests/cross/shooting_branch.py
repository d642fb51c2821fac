"""Branches of periodic motions by event-driven shooting, with folds, period doublings and Neimark-Sacker points.

    F(y, Omega) = y(2 pi nu; y, Omega) - y = 0,   y = (q, q') at tau = 0,   Phi = dy(2 pi nu)/dy

While every element stays on one linear piece of its law the equation is linear, dy/dtau = A(tau) y + f(tau). Its
solutions over each of ``cells`` equal cells of the excitation period are computed once by collocation at Gauss points.
A motion is propagated from cell to cell, and changes pieces where the collocation polynomial reaches a breakpoint.
Forces are continuous there, so Phi is the product of the propagation matrices.

    LP  det(Phi - 1) = 0      PD  det(Phi + 1) = 0      NS  a product of two multipliers is 1, and they are complex

Each point is a bracketed root along the curve; every iterate is corrected onto the curve. `cross.shooting` integrates
the same equations by another method.
"""

from dataclasses import dataclass, replace

import numpy as np
from cross.shooting import Flow, Line, state
from scipy.optimize import brentq

from hbgear import HarmonicBalance
from hbgear.mechanics.series.fourier import evaluate

STAGES = 10
CORNER = 1e-13
"""Distance from a breakpoint below which an element counts as on it."""
UPRIGHT = 1e-8
"""Omega component of the tangent below which the curve is vertical: a continuum of motions at one Omega, no fold."""


def _collocation(s):
    """Nodes (0, Gauss points, 1), and integrals from 0 to each node of the Lagrange polynomials on the Gauss points."""
    gauss = 0.5 * (np.polynomial.legendre.leggauss(s)[0] + 1.0)
    nodes = np.concatenate([[0.0], gauss, [1.0]])
    powers = np.arange(1, s + 1)
    return nodes, (nodes[:, None] ** powers / powers) @ np.linalg.inv(np.vander(gauss, increasing=True))


NODES, INTEGRALS = _collocation(STAGES)
# interpolation on 0 and the Gauss points reproduces the collocation polynomial
UNIT = np.eye(len(NODES))
_WEIGHTS = np.array([1.0 / np.prod(x - np.delete(NODES[:-1], i)) for i, x in enumerate(NODES[:-1])])


def _weights(x):
    """Interpolation weights (s + 2,) of the nodes for the value at x."""
    i = int(np.searchsorted(NODES, x))
    if NODES[i] == x:
        return UNIT[i]
    w = np.zeros(len(NODES))
    np.divide(_WEIGHTS, x - NODES[:-1], out=w[:-1])
    return w / w.sum()


def _at(x, values):
    """Value at x of the collocation polynomial with given values (s + 2,) at the nodes."""
    return float(_weights(x) @ values)


def _motion_at(x, U, g):
    """Matrix (2n, 2n) and offset (2n,) at x, interpolated from U (s + 2, 2n, 2n) and g (s + 2, 2n) at the nodes."""
    w = _weights(x)
    return np.tensordot(w, U, 1), w @ g


class Pieces:
    """Linear motions of a `System` at one Omega, computed once for each combination of linear pieces."""

    def __init__(self, system, Omega, cells):
        self.flow, self.Omega, self.cells, self.n = Flow(system, Omega), Omega, cells, system.n
        self.laws = [e.law for e in system.elements]
        self.h = 2 * np.pi / cells
        self.tau = self.h * (np.arange(cells)[:, None] + NODES)
        shape = (len(self.laws), *self.tau.shape)
        rows = [e.displacement.row() for e in system.elements]
        self.e = np.array([evaluate(r, self.tau.ravel()) for r in rows]).reshape(shape)
        self.de = Omega * np.array([evaluate(r, self.tau.ravel(), 1) for r in rows]).reshape(shape)
        self.k = np.array([law.stiffness(self.tau) for law in self.laws])
        self._load = self._loads()
        self._known = {}

    def _loads(self):
        out = np.zeros((*self.tau.shape, self.n))
        for load in self.flow.loads:
            for order, a in load.complex(self.n).items():
                out += self.Omega**load.power * (np.exp(1j * order * self.tau)[..., None] * a).real
        return out

    def pieces(self, y):
        """Return the linear piece of each element for a state at tau = 0."""
        d = self.flow.W.T @ y[: self.n] - self.e[:, 0, 0]
        return tuple(Line(law, int(np.searchsorted(law.corners, x))) for law, x in zip(self.laws, d, strict=True))

    def motions(self, lines):
        """General solution on these pieces: U eta + g at the nodes of every cell, with the state eta at tau = 0."""
        key = tuple(line.piece for line in lines)
        if key not in self._known:
            U, g = self._solve(lines)
            P, p = np.eye(2 * self.n), np.zeros(2 * self.n)
            through, offset = np.empty((self.cells, *U.shape[1:])), np.empty(g.shape)
            for i in range(self.cells):
                Ui = U[i if len(U) > 1 else 0]
                through[i], offset[i] = Ui @ P, Ui @ p + g[i]
                P, p = through[i, -1], offset[i, -1]
            self._known[key] = through, offset
        return self._known[key]

    def _solve(self, lines):
        n, W, flow = self.n, self.flow.W, self.flow
        slope = np.array([line.slope for line in lines])[:, None, None] * self.k
        offset = np.array([line.offset for line in lines])[:, None, None] * self.k
        steady = all(law.stiffness.order == 0 for law in self.laws)
        inner = slice(1, -1)
        A = np.zeros((1 if steady else self.cells, STAGES, 2 * n, 2 * n))
        A[..., :n, n:] = np.eye(n)
        stiffness = flow.K + np.einsum("aj,bj,jcs->csab", W, W, slope[:, : len(A), inner])
        A[..., n:, :n] = -flow.inverse @ stiffness
        A[..., n:, n:] = -flow.inverse @ flow.C
        f = np.zeros((self.cells, STAGES, 2 * n))
        pull = slope * self.e - offset + flow.c[:, None, None] * self.de
        f[..., n:] = (self._load + np.einsum("aj,jcs->csa", W, pull))[:, inner] @ flow.inverse.T
        A, f = A / self.Omega, f / self.Omega
        # stage derivatives D_i = A_i (y_0 + h sum_j a_ij D_j) + f_i
        size = STAGES * 2 * n
        system = -self.h * np.einsum("ij,ciab->ciajb", INTEGRALS[inner], A).reshape(-1, size, size)
        inverse = np.linalg.inv(system + np.eye(size))
        D = (inverse @ A.reshape(-1, size, 2 * n)).reshape(-1, STAGES, 2 * n, 2 * n)
        d = (inverse @ f.reshape(-1, size, 1)).reshape(-1, STAGES, 2 * n)
        U = np.eye(2 * n) + self.h * np.einsum("ij,cjab->ciab", INTEGRALS, D)
        return U, self.h * np.einsum("ij,cja->cia", INTEGRALS, d)

    def turn(self, y, nu=1):
        """Return the state and Phi after nu periods, and the number of breakpoints passed."""
        Phi, lines, passed = np.eye(2 * self.n), self.pieces(y), 0
        for _ in range(nu):
            i, x = 0, 0.0
            while True:
                U, g = self.motions(lines)
                matrix, offset = _motion_at(x, U[i], g[i])
                back = np.linalg.inv(matrix)
                y, Phi = back @ (y - offset), back @ Phi
                event = self._first_event(lines, i, x, U[i:] @ y + g[i:])
                i, x, j, end = event or (self.cells - 1, 1.0, -1, "")
                matrix, offset = _motion_at(x, U[i], g[i])
                y, Phi = matrix @ y + offset, matrix @ Phi
                if event is None:
                    break
                passed += 1
                lines = tuple(line.beyond(end) if a == j else line for a, line in enumerate(lines))
        return y, Phi, passed

    def _first_event(self, lines, i, x, Y):
        """First event after x in cell i, where an element leaves its piece: cell, position, element, end; or None."""
        suspect = np.zeros(len(Y), dtype=bool)
        for j, line in enumerate(lines):
            d = Y[..., : self.n] @ self.flow.W[:, j] - self.e[j, i:]
            v = Y[..., self.n :] @ self.flow.W[:, j] - self.de[j, i:]
            reach = self.h / self.Omega * np.abs(v).max(axis=1)
            out = np.any((d > line.high) | (d < line.low), axis=1)
            near = (d.max(axis=1) + reach > line.high) | (d.min(axis=1) - reach < line.low)
            suspect |= out | (near & np.any(v[:, 1:] * v[:, :-1] < 0, axis=1))
        suspect[0] = True
        for a in np.flatnonzero(suspect):
            event = self._event(lines, i + a, x if a == 0 else 0.0, Y[a])
            if event is not None:
                return i + int(a), *event
        return None

    def _event(self, lines, i, x, Y):
        """First event after x within cell i, with Y (nodes, 2n): position, element, end; or None."""
        found = []
        for j, line in enumerate(lines):
            d = Y[:, : self.n] @ self.flow.W[:, j] - self.e[j, i]
            v = Y[:, self.n :] @ self.flow.W[:, j] - self.de[j, i]
            first = int(np.searchsorted(NODES, x, side="right"))
            start = np.array([_at(x, v)])
            turns = np.flatnonzero(np.append(start, v[first:])[:-1] * v[first:] < 0)
            behind = d[first:]
            if not turns.size and np.all((behind > line.low) & (behind < line.high)):
                continue
            places = np.append(x, NODES[first:])
            extrema = [brentq(_at, places[a], places[a + 1], args=(v,), xtol=1e-15) for a in turns]
            values = np.concatenate([[_at(x, d)], behind, [_at(p, d) for p in extrema]])
            places = np.append(places, extrema)
            order = np.argsort(places)
            places, values = places[order], values[order]
            for end, level, beyond in (("low", line.low, line.low - values), ("high", line.high, values - line.high)):
                out = np.flatnonzero(beyond[1:] > CORNER)
                if out.size:
                    a, b = places[out[0]], places[out[0] + 1]
                    if beyond[out[0]] < 0:
                        a = brentq(lambda p, d=d, level=level: _at(p, d) - level, a, b, xtol=1e-15)
                    found.append((a, j, end))
        return min(found) if found else None


@dataclass(frozen=True)
class Orbit:
    """A periodic motion: state y at tau = 0, Omega, Phi over nu periods, unit tangent (dy, dOmega) of its curve,
    and the change of the state over the first period of the excitation."""

    y: np.ndarray
    Omega: float
    Phi: np.ndarray
    tangent: np.ndarray
    half: np.ndarray

    @property
    def u(self):
        return np.append(self.y, self.Omega)

    @property
    def multipliers(self):
        return np.linalg.eigvals(self.Phi)


@dataclass(frozen=True)
class Special:
    """A special point of a `Curve`, of the kind "LP", "PD" or "NS"."""

    kind: str
    orbit: Orbit

    @property
    def Omega(self):
        return self.orbit.Omega


@dataclass(frozen=True)
class Curve:
    """Orbits and special points in order, and whether the curve merged with the motion of the single period."""

    orbits: list
    special: list
    merged: bool

    def at(self, kind):
        """Omega of all special points of a kind."""
        return [p.Omega for p in self.special if p.kind == kind]


class Shooter:
    """Shooting for a model: orbits, their curves, and the branch of doubled motions.

    Parameters
    ----------
    model : Model
        Model with piecewise linear laws.
    cells : int
        Cells of the excitation period; a tenth of a radian of the fastest mode per cell gives rounding accuracy.
    nu : int
        Excitation periods per period of the motion.
    """

    def __init__(self, model, cells=64, nu=1):
        self.system, self.cells, self.nu = model.system(), cells, nu

    def turn(self, y, Omega):
        return Pieces(self.system, Omega, self.cells).turn(y, self.nu)

    def orbit(self, y, Omega, normal=None):
        """Newton's method on F in the plane orthogonal to ``normal`` through (y, Omega), at fixed Omega by default.

        The tangent is oriented along the normal. dF/dOmega is evaluated at the start: this changes the tangent
        slightly, but not the zero of its last component, which is proportional to det(Phi - 1).
        """
        u, size = np.append(y, Omega), len(y)
        normal = np.eye(size + 1)[-1] if normal is None else normal
        start, slope = u, self._slope(u)
        for _ in range(20):
            end, Phi, _ = self.turn(u[:-1], float(u[-1]))
            A = np.vstack([np.column_stack([Phi - np.eye(size), slope]), normal])
            du = np.linalg.solve(A, -np.append(end - u[:-1], normal @ (u - start)))
            u = u + du
            if np.linalg.norm(du) < 1e-10 * (1 + np.linalg.norm(u)):
                break
        else:
            raise AssertionError(f"shooting did not converge at Omega = {u[-1]:.6g}: step {np.linalg.norm(du):.1e}")
        t = np.linalg.solve(A, np.eye(size + 1)[-1])
        half = Pieces(self.system, u[-1], self.cells).turn(u[:-1])[0] - u[:-1] if self.nu > 1 else np.zeros(size)
        return Orbit(u[:-1], float(u[-1]), Phi, t / np.linalg.norm(t), half)

    def _slope(self, u, h=1e-6):
        """dF/dOmega by a central difference."""
        y, Omega = u[:-1], float(u[-1])
        return (self.turn(y, Omega + h)[0] - self.turn(y, Omega - h)[0]) / (2 * h)

    def curve(self, first, span, step=0.01, longest=0.06, turn=0.5, limit=2000):
        """Continue from an orbit until Omega leaves the span, or the motion has the single period again."""
        low, high = sorted(span)
        orbits, special, merged, largest = [first], [], False, 0.0
        while len(orbits) < limit and low <= orbits[-1].Omega <= high:
            last = orbits[-1]
            try:
                new = self.orbit(*self._split(last.u + step * last.tangent), last.tangent)
                angle = np.arccos(min(1.0, float(new.tangent @ last.tangent)))
            except (AssertionError, np.linalg.LinAlgError):
                angle = np.inf
            if angle > turn:
                step /= 2
                assert step > 1e-9, f"shooting stuck at Omega = {last.Omega:.6g}"
                continue
            orbits.append(new)
            largest = max(largest, float(np.linalg.norm(new.half)))
            merged = bool(self.nu > 1 and (last.half @ new.half < 0 or np.linalg.norm(new.half) < 0.01 * largest))
            if merged:
                break
            special += self._special(last, new)
            step = min(longest, step * min(2.0, 0.5 * turn / max(angle, 1e-3)))
        return Curve(orbits, special, merged)

    @staticmethod
    def _split(u):
        return u[:-1], float(u[-1])

    def _special(self, a, b):
        """Special points between two neighbouring orbits, in order."""
        found = []
        for kind, test in TESTS.items():
            if test(a) * test(b) < 0 and not (kind == "LP" and min(abs(test(a)), abs(test(b))) < UPRIGHT):
                s, orbit = self._root(test, a, b)
                if kind != "NS" or _complex_pair(orbit.multipliers):
                    found.append((s, Special(kind, orbit)))
        return [p for _, p in sorted(found, key=lambda f: f[0])]

    def _root(self, test, a, b):
        chord = b.u - a.u
        normal = chord / np.linalg.norm(chord)
        known = {0.0: a, 1.0: b}

        def value(s):
            if s not in known:
                known[s] = self.orbit(*self._split(a.u + s * chord), normal)
            return test(known[s])

        s = brentq(value, 0.0, 1.0, xtol=1e-9, rtol=1e-9)
        return s, known[s]

    def doubled(self, point, distance=0.01):
        """Return the shooter for twice the period, and the first doubled motion near a period doubling."""
        other = Shooter(_Given(self.system), self.cells, 2 * self.nu)
        v = np.append(np.linalg.svd(point.orbit.Phi + np.eye(len(point.orbit.y)))[2][-1], 0.0)
        u = point.orbit.u + distance * v
        return other, other.orbit(*self._split(u), v)


@dataclass(frozen=True)
class _Given:
    """Model that returns a given system."""

    value: object

    def system(self):
        return self.value


def _products(mu):
    """mu_i mu_j - 1 for all pairs i < j."""
    i, j = np.triu_indices(len(mu), 1)
    return mu[i] * mu[j] - 1


def _complex_pair(mu):
    """Whether the pair with the product 1 is complex: a Neimark-Sacker point and not a neutral saddle."""
    i, j = np.triu_indices(len(mu), 1)
    best = int(np.argmin(np.abs(mu[i] * mu[j] - 1)))
    return abs(mu[i[best]].imag) > 1e-6


TESTS = {
    "LP": lambda orbit: float(orbit.tangent[-1]),
    "PD": lambda orbit: float(np.linalg.det(orbit.Phi + np.eye(len(orbit.y)))),
    "NS": lambda orbit: float(np.prod(_products(orbit.multipliers)).real),
}


def shot(model, span, harmonics, cells):
    """Return a shooter and its curve over a span, from a motion of the harmonic balance at the first end."""
    problem, shooter = HarmonicBalance(model, harmonics), Shooter(model, cells=cells)
    first = shooter.orbit(state(problem, problem.start(span[0]), Omega=span[0]), span[0])
    return shooter, shooter.curve(replace(first, tangent=-first.tangent), span)
