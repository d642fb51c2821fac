"""Floquet multipliers of periodic motions, of many at once.

A small disturbance of the motion obeys the linear structure plus m scalar modulations,

    z' = poles z - input u,   u_j = (dp_j/dd - kr_j) d_j + dp_j/dv d_j',   d = output z

which are smooth except where an element crosses a corner of its law. The period is cut at those instants and each
piece into equal steps; in a step the linear part is propagated exactly and u by collocation at s Gauss points,

    d(c_i h) = output e^{poles c_i h} z_0 - sum_j A_ij u_j
    A_ij = int_0^{c_i h} output e^{poles (c_i h - x)} input L_j(x) dx

with the integrals in closed form, so that neither stiff supports nor fast modes limit the step. The order is 2s.
No saltation matrix is needed: forces are continuous, so the state and its disturbance are continuous at a corner (a
law that switches its *damping* at a corner must not be given; see the contract in `laws`).

With the matrices A, R = (output e^{poles c_i h}), B of the integrals over the whole step, and the diagonal D of the
modulations at the nodes, u = D (R z_0 - A u), and

    z_1 = [e^{poles h} - B (1 + D A)^-1 D R] z_0

A, R, B belong to a piece, D to a step; steps of all motions that share the model are computed at once. Where the state
is large, several equal parts with a polynomial each make one step, for products of large matrices cost least.

Free motions (rigid rotation) carry the trivial multipliers +1 and are left out.

References
----------
Friedmann, Hammond & Woo (1977), Int. J. Numer. Meth. Eng. 11, https://doi.org/10.1002/nme.1620110708.
Hsu (1974), J. Math. Anal. Appl. 45, https://doi.org/10.1016/0022-247X(74)90112-X.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.collocation import gauss, moments
from hbgear.harmonic.compiled import Compiled
from hbgear.mechanics.fourier import derive, to_complex, to_real, waves

_SHARE = 0.2  # longest step as a share of the excitation period, whatever the structure


_COARSE = 32  # phases of an excitation period at which the modulations are looked at for their size


_MOST_STEPS = 10_000  # of one period


_LONG = 12.0  # periods in which the springs turn the inertia by more radians are cut into fewer steps of more points


_ROOM = 1_000_000  # numbers that the matrices of the motions computed at once may have


_CACHE = 16_000  # numbers in matrices of steps that stay close to the processor


def multipliers_of(
    compiled: Compiled, X: Array, Omega: Array, *, points: int | None = None, width: float | None = None
) -> ComplexArray:
    """Floquet multipliers of P motions over their periods 2 pi nu / Omega, largest magnitude first.

    They share the parameters of the model, and are computed together: far cheaper than one by one.

    Parameters
    ----------
    compiled : the model with its parameters.
    X : (P, m (2H + 1)) coefficients of periodic motions.
    Omega : (P,) excitation frequencies.
    points : s, Gauss points per step; the scheme has order 2s. By default 6, or 10 where the period is long beside the
        motions the springs of the elements would excite, for fewer steps are then worth more points.
    width : longest step (of a large structure: part of a step), in units of the time in which the stiffest spring of
        the elements would turn the structure's inertia by one radian; by default s / 5, or with these 10 points 3.5.
        None is longer than a fifth of the excitation period.

    Returns
    -------
    (P, r) complex, r twice the number of coordinates that are not free motions.

    Raises
    ------
    ValueError
        If the structure is too large for its modes to be computed, or a period takes too many steps.
    """
    mu = np.linalg.eigvals(monodromies(compiled, X, Omega, points=points, width=width)).astype(complex)
    return mu[np.arange(len(mu))[:, None], np.argsort(-np.abs(mu), axis=-1, kind="stable")]


def monodromies(
    compiled: Compiled, X: Array, Omega: Array, *, points: int | None = None, width: float | None = None
) -> Array:
    """Real matrices (P, r, r) that carry a disturbance over one period, in real modal coordinates.

    Parameters as of `multipliers_of`.
    """
    if compiled.structure.modes is None:
        raise ValueError(
            f"stability needs the modes of the structure; {compiled.structure.n} coordinates are too many: "
            "trace with stability=False or reduce the model"
        )
    modes, kr = _halved(compiled.structure.modes), compiled.structure.kr
    together = 1 + _ROOM // (4 * modes.size**2 + 20_000)
    out = np.empty((len(X), modes.size, modes.size))
    for some in (slice(i, i + together) for i in range(0, len(X), together)):
        motions = _motions(compiled, X[some], Omega[some])
        period, pace = 2 * np.pi / motions.omega, _pace(motions, modes, kr)
        long = pace * period > (_LONG if points is None else np.inf)
        if long.any() and not long.all():  # each part by its own scheme, so that no motion depends on its company
            for part in (long, ~long):
                out[some][part] = monodromies(compiled, X[some][part], Omega[some][part], width=width)
            continue
        s = points or (10 if long.any() else 6)
        widest = width or (3.5 if long.any() else s / 5.0)
        parts = max(1, modes.size // (2 * s * compiled.m))  # about half as many nodes in a step as states
        longest = np.minimum(widest / pace, _SHARE * period / compiled.nu)
        count = float(np.max(period / (parts * longest)))
        if count > _MOST_STEPS:
            raise ValueError(
                f"stability would take {count:.2g} steps a period, for the springs are so fast beside Omega: give "
                "another Omega, or trace with stability=False"
            )
        out[some] = _carried(motions, _steps(motions, parts * longest), modes, kr, s, parts)
    return out


@dataclass(frozen=True)
class _Motions:
    """P motions of one model.

    rows (P, 2 m, 2H + 1): real rows of d and d'; omega (P,): basis frequencies; nu and laws (m,): common to all;
    motion, corner (R,): the motion and the phase of each instant at which an element crosses a corner of its law.
    """

    rows: Array
    omega: Array
    nu: int
    laws: tuple[Any, ...]
    motion: np.ndarray
    corner: Array

    def slopes(self, motion: np.ndarray, theta: Array) -> Array:
        """dp/dd and dp/dv (2, S, T, m) along the motions number motion (S,), at phases theta (S, T) or (1, T)."""
        shape, m, K = (len(motion), theta.shape[1]), len(self.laws), self.rows.shape[2]
        basis = waves(theta, K // 2).view(float)[:, 1:]  # 1, cos theta, sin theta, cos 2 theta, ...
        basis[:, 0] = 1.0
        both = (basis.reshape(*theta.shape, K) @ self.rows[motion].transpose(0, 2, 1)).reshape(-1, 2 * m).T
        tau = (self.nu * theta + np.zeros(shape)).ravel()
        slopes = [law.force(d, v, tau)[1:] for law, d, v in zip(self.laws, both[:m], both[m:], strict=True)]
        return np.array(slopes).reshape(m, 2, *shape).transpose(1, 2, 3, 0)


def _motions(compiled: Compiled, X: Array, Omega: Array) -> _Motions:
    P, omega = len(X), Omega / compiled.nu
    rows = X.reshape(P, compiled.m, -1)
    c = to_complex(rows)
    both = np.concatenate([rows, to_real(omega[:, None, None] * derive(c))], axis=1)
    return _Motions(both, omega, compiled.nu, compiled.laws, *_switching(compiled, c))


def _switching(compiled: Compiled, c: ComplexArray) -> tuple[np.ndarray, Array]:
    """Motion and phase of every instant at which an element of the motions c (P, m, H + 1) crosses a corner."""
    if not len(compiled.corner):
        return np.zeros(0, dtype=int), np.empty(0)
    found = [compiled.crossings(to_real(one).ravel()) for one in c]
    motion = np.repeat(np.arange(len(c)), [len(one.theta) for one in found])
    return motion, np.mod(np.concatenate([one.theta for one in found]), 2 * np.pi)


def _pace(motions: _Motions, modes: _Modes, kr: Array) -> Array:
    """How fast the modulations can turn the state of each motion [rad per unit of time], (P,).

    The square is the largest of: inverse modal mass of an element times the largest stiffness of its law.
    """
    count = _COARSE * motions.nu
    stiffness, _ = motions.slopes(np.arange(len(motions.rows)), 2 * np.pi * np.arange(count)[None] / count)
    pace = np.sqrt((modes.mobility * np.maximum(kr, np.abs(stiffness).max(axis=1))).max(axis=-1))
    return np.where(pace > 0, pace, 1.0)


@dataclass(frozen=True)
class _Modes:
    """One mode of each conjugate pair, the pairs before the real modes.

    poles (q,); output (m, q), doubled for pairs; input (q, m); mobility (m,), inverse modal masses of the elements;
    pairs, their number. In real numbers the state is (Re z, Im z of the pairs).
    """

    poles: ComplexArray
    output: ComplexArray
    input: ComplexArray
    mobility: Array
    pairs: int

    @property
    def size(self) -> int:
        """r, number of real coordinates."""
        return len(self.poles) + self.pairs

    def reading(self, C: ComplexArray) -> Array:
        """Real matrices (..., r) of Re(C z), C (..., q)."""
        return np.concatenate([C.real, -C.imag[..., : self.pairs]], axis=-1)

    def driving(self, B: ComplexArray) -> Array:
        """Real matrices (..., r, k) of z = B u, B (..., q, k)."""
        return np.concatenate([B.real, B.imag[..., : self.pairs, :]], axis=-2)

    def add_turn(self, out: Array, E: ComplexArray) -> None:
        """Add the real matrices of z -> E z, E (S, q), to out (S, r, r)."""
        q, r, turn = len(self.poles), self.size, E[:, : self.pairs]
        flat = out.reshape(len(out), r * r)  # in which the entries (i, i + k) of a matrix lie r + 1 apart
        flat[:, :: r + 1] += np.concatenate([E.real, turn.real], axis=1)
        flat[:, q : self.pairs * r : r + 1] -= turn.imag
        flat[:, q * r :: r + 1] += turn.imag


def _halved(modes: Any) -> _Modes:
    real = np.abs(modes.poles.imag) <= 1e-13 * np.abs(modes.poles).max(initial=0.0)
    pairs = np.flatnonzero(~real & (modes.poles.imag > 0))
    kept = np.concatenate([pairs, np.flatnonzero(real)])
    mobility = np.abs((modes.output * modes.poles * modes.input.T).sum(axis=1))
    output = modes.output[:, kept]
    output[:, : len(pairs)] *= 2.0
    return _Modes(modes.poles[kept], output, modes.input[kept], mobility, len(pairs))


@dataclass(frozen=True)
class _Steps:
    """Steps of the periods of P motions: first the first step of each, then the second of those that have one, ...

    motion, h (C,): of a piece, its motion and the duration of its steps; piece, start (S,): of a step, its piece and
    the phase it begins at; rounds: where in them the first steps begin, the second, ..., and the end.
    """

    motion: np.ndarray
    h: Array
    piece: np.ndarray
    start: Array
    rounds: np.ndarray


def _steps(motions: _Motions, longest: Array) -> _Steps:
    """Steps of at most longest (P,), none across a corner."""
    motion, theta, length = _pieces(motions)
    omega = motions.omega[motion]
    counts = np.maximum(1, np.ceil(length / omega / longest[motion] - 1e-9)).astype(int)
    piece = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(piece))
    start = theta[piece] + (length / counts)[piece] * (number - (np.cumsum(counts) - counts)[piece])
    number -= np.searchsorted(motion[piece], motion[piece])  # in its motion, from 0
    order = np.argsort(number, kind="stable")
    rounds = np.concatenate([[0], np.cumsum(np.bincount(number))])
    return _Steps(motion, length / counts / omega, piece[order], start[order], rounds)


def _pieces(motions: _Motions) -> tuple[np.ndarray, Array, Array]:
    """Motion, first phase and length of each smooth piece of the periods, (C,) each, motion after motion.

    A period begins at its first corner, or else at 0: the multipliers do not depend on where it begins.
    """
    smooth = np.ones(len(motions.rows), dtype=bool)
    smooth[motions.motion] = False
    motion = np.concatenate([motions.motion, np.flatnonzero(smooth)])
    theta = np.concatenate([motions.corner, np.zeros(smooth.sum())])
    order = np.lexsort((theta, motion))
    motion, theta = motion[order], theta[order]
    first, last = (np.searchsorted(motion, np.arange(len(smooth)), side) for side in ("left", "right"))
    end = np.concatenate([theta[1:], [0.0]])
    end[last - 1] = theta[first] + 2 * np.pi
    real = end - theta > 1e-13
    return motion[real], theta[real], (end - theta)[real]


def _carried(motions: _Motions, steps: _Steps, modes: _Modes, kr: Array, points: int, parts: int) -> Array:
    """What becomes of all disturbances in a period: the matrices (P, r, r)."""
    x, L = gauss(points)
    motion, h = steps.motion[steps.piece], steps.h[steps.piece]
    nodes = (np.arange(parts)[:, None] + x).ravel() / parts
    D = motions.slopes(motion, steps.start[:, None] + (motions.omega[motion] * h)[:, None] * nodes)
    D[0] -= kr
    D = D.reshape(2, len(h), -1)[: 1 + np.any(D[1])]  # without dp/dv no velocity is asked for
    A, R, B = _kernels(modes, steps.h / parts, x, L, len(D), parts)
    feedback = sum(d[:, :, None] * a[steps.piece] for d, a in zip(D, A, strict=True))
    inverse = np.linalg.inv(np.eye(D.shape[-1]) + feedback)
    response = np.concatenate([inverse * -d[:, None, :] for d in D], axis=-1)
    turn = np.exp(steps.h[:, None] * modes.poles)
    total = np.zeros((len(motions.rows), modes.size, modes.size)) + np.eye(modes.size)
    at_once = 1 + _CACHE // total.size
    for first in range(0, len(steps.rounds) - 1, at_once):
        rounds = steps.rounds[first : first + at_once + 1]
        piece = steps.piece[rounds[0] : rounds[-1]]
        step = B[piece] @ (response[rounds[0] : rounds[-1]] @ R[piece])
        modes.add_turn(step, turn[piece])
        for a, b in pairwise(rounds - rounds[0]):
            on = steps.motion[piece[a:b]]
            total[on] = step[a:b] @ total[on]
    return total


def _kernels(modes: _Modes, h: Array, x: Array, L: Array, orders: int, parts: int) -> tuple[Array, Array, Array]:
    """A (orders, C, g s m, g s m), R (C, orders g s m, r), B (C, r, g s m) of steps of g parts of durations h (C,).

    Rows are parts, nodes and elements, of displacements and, with orders = 2, of velocities.
    """
    own, nodes, push = _part(modes, h, x, L, orders)
    turns = np.exp(h[:, None, None] * np.arange(parts)[:, None] * modes.poles)
    R = modes.reading(nodes[:, :, None] * turns[:, None, :, None])
    B = modes.driving(push[:, None] * turns[:, ::-1, :, None])
    # a part acts on later ones through the state it leaves, on none before: A is block Toeplitz
    later = R[:, :, :-1] @ B[:, None, -1:]
    blocks = np.concatenate([own[:, :, None], later, np.zeros_like(own)[:, :, None]], axis=2)
    lag = np.arange(parts)[:, None] - np.arange(parts)
    A = blocks[:, :, np.where(lag < 0, parts, lag)].swapaxes(3, 4)
    C, n = len(h), parts * push.shape[2]
    B = np.ascontiguousarray(B.swapaxes(1, 2))  # as all three, or products with it would be slow
    return A.reshape(C, orders, n, n).swapaxes(0, 1), R.reshape(C, orders * n, -1), B.reshape(C, -1, n)


def _part(modes: _Modes, h: Array, x: Array, L: Array, orders: int) -> tuple[Array, ComplexArray, ComplexArray]:
    """A (C, orders, s m, s m) and, complex, R (C, orders, s m, q) and B (C, q, s m) of one part of durations h (C,)."""
    C, s, m, q = len(h), len(x), len(modes.output), len(modes.poles)
    output = np.array([modes.output * modes.poles**k for k in range(orders)])
    # integrals of the Lagrange polynomials up to each node and to the end, (s, C, s + 1, q)
    powers = moments(modes.poles, h, np.append(x, 1.0), s)
    integrals = (L @ powers.reshape(s, -1)).reshape(powers.shape)
    residues = (output[:, :, None] * modes.input.T).reshape(-1, q).T
    own = (integrals[:, :, :-1] @ residues).real.reshape(s, C, s, orders, m, m).transpose(1, 3, 2, 4, 0, 5)
    nodes = np.exp(h[:, None, None] * x[:, None] * modes.poles)[:, None, :, None] * output[:, None]
    push = (integrals[:, :, -1, :, None] * modes.input).transpose(1, 2, 0, 3)
    return own.reshape(C, orders, s * m, s * m), nodes.reshape(C, orders, s * m, q), push.reshape(C, q, s * m)
