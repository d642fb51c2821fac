"""Time integration of many motions at once, exact in the linear part: exponential collocation.

The coordinates z of the modes of the structure closed by its reference springs kr obey

    z' = poles z + left F(tau) - input (p - kr d - kr e - c e'),   d = output z - e

In a step of length h the linear part and the loads are exact; w = p - kr d is a polynomial through its values at s
Gauss points, found with the displacements there, d(c_i h) = d_linear(c_i h) - sum_j A_ij w_j. Neither stiff supports
nor fast modes limit the step. The order is 2s where |poles| h is small, and falls towards s + 1 for what stiff modes
contribute; steps end at corners of the laws, which therefore do not lower it.

References
----------
Hochbruck & Ostermann (2010), Acta Numerica 19, https://doi.org/10.1017/S0962492910000048.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.ranges import counted
from hbgear.harmonic.collocation import gauss, moments
from hbgear.harmonic.receptance import Modes, Structure
from hbgear.mechanics.fourier import to_complex, waves
from hbgear.mechanics.model import Model, System
from hbgear.timedomain.segments import FINE, Bools, Integers, Pieces, first_exit, stiffness_row

_NEAR = 1e-9  # distance from a corner, in its size, at which a step may end: what is missed goes with its square


_ROUNDS = 24  # pieces a motion may pass within one step before the rest of the step is taken as it is


def modal_state(structure: Structure, y: Array) -> ComplexArray:
    """z (..., r) of states y (..., 2n): z = left (C q + M q') + poles left M q; free motions drop out."""
    modes = _modes(structure)
    q, v = y[..., : structure.n], y[..., structure.n :]
    z: Array = (q @ structure.C.T + v @ structure.M.T) @ modes.left.T + modes.poles * (q @ structure.M.T @ modes.left.T)
    return z


def physical_state(structure: Structure, z: ComplexArray) -> Array:
    """States (..., 2n) of z (..., r): q = right z, q' = right poles z, without free motions."""
    modes = _modes(structure)
    return np.concatenate([(z @ modes.right.T).real, (z * modes.poles @ modes.right.T).real], axis=-1)


def _modes(structure: Structure) -> Modes:
    if structure.modes is None:
        raise ValueError(
            f"this needs the modes of the structure; {structure.n} coordinates are too many: use integrate with "
            "method='Radau', or reduce the model"
        )
    return structure.modes


_MOST_STEPS = 100_000  # per period of the excitation, each with its own matrices in the tables


@dataclass(frozen=True)
class _Table:
    """Matrices of steps of lengths h (b,): rows (Gauss point or end, d or v, element), columns (point, element).

    turn (b, r), observe (b, (s + 1) 2 m, r), kernel (b, (s + 1) 2 m, s m), push (b, r, s m).
    """

    h: Array
    turn: ComplexArray
    observe: ComplexArray
    kernel: Array
    push: ComplexArray
    inner: Array
    """(b, 2, s m, s m): what the d and v at the Gauss points feel of w there."""

    def select(self, rows: Integers) -> _Table:
        return _Table(*(getattr(self, name)[rows] for name in _TABLES))


_TABLES = ("h", "turn", "observe", "kernel", "push", "inner")


def _table(modes: Modes, h: Array, s: int) -> _Table:
    x, L = gauss(s)
    c = np.append(x, 1.0)
    output = np.concatenate([modes.output, modes.output * modes.poles])
    powers = moments(modes.poles, h, c, s)
    b, m, r = len(h), len(modes.output), len(modes.poles)
    integrals = (L @ powers.reshape(s, -1)).reshape(s, b, s + 1, r)
    pairs = output[:, None, :] * modes.input.T  # (2m, m, r)
    kernel = (
        (integrals.reshape(-1, r) @ pairs.reshape(-1, r).T).real.reshape(s, b, s + 1, 2 * m, m).transpose(1, 2, 3, 0, 4)
    )
    push = integrals[:, :, -1].transpose(1, 2, 0)[..., None] * modes.input[:, None]
    ripple = np.exp(h[:, None, None] * c[:, None] * modes.poles)
    observe = ripple[:, :, None, :] * output
    inner = kernel[:, :-1].reshape(b, s, 2, m, s * m).transpose(0, 2, 1, 3, 4).reshape(b, 2, s * m, s * m)
    return _Table(
        h, ripple[:, -1], observe.reshape(b, -1, r), kernel.reshape(b, -1, s * m), push.reshape(b, r, -1), inner
    )


@lru_cache(maxsize=8)
def _dense(s: int) -> tuple[Array, Array, Array, Array]:
    """Interpolation in a step from d and h v at 0, the Gauss points and 1.

    Returns the abscissae (FINE + 1,), matrices (FINE + 1, 2s + 4) that give d and h v there, and one (2s + 4, 2s + 4)
    that gives the Chebyshev coefficients.
    """
    nodes = np.concatenate([[0.0], gauss(s)[0], [1.0]])
    k = np.arange(2 * s + 4)
    to_coefficients = np.linalg.inv(np.concatenate([_chebyshev(nodes, k), _chebyshev_slope(nodes, k)]))
    x = np.linspace(0.0, 1.0, FINE + 1)
    return x, _chebyshev(x, k) @ to_coefficients, _chebyshev_slope(x, k) @ to_coefficients, to_coefficients


def _chebyshev(x: Array, k: Integers) -> Array:
    """T_k(2x - 1), (..., K)."""
    T: Array = np.cos(k * np.arccos(np.clip(2 * x - 1, -1.0, 1.0))[..., None])
    return T


def _chebyshev_slope(x: Array, k: Integers) -> Array:
    """Derivative of T_k(2x - 1) in x."""
    c = np.eye(len(k))
    return np.polynomial.chebyshev.chebval(2 * x - 1, 2 * np.polynomial.chebyshev.chebder(c)).T


@dataclass(eq=False)
class Flight:
    """Motions under way: z less its steady part (B, r), d and v (B, m) now, the piece each element is on (B, m)."""

    zeta: ComplexArray
    d: Array
    v: Array
    piece: Integers

    def select(self, rows: Integers) -> Flight:
        """Some of the motions."""
        return Flight(self.zeta[rows], self.d[rows], self.v[rows], self.piece[rows])

    def put(self, rows: Integers, other: Flight) -> None:
        """Replace some of the motions."""
        for name in ("zeta", "d", "v", "piece"):
            getattr(self, name)[rows] = getattr(other, name)


class Stepper:
    """The exponential method for B motions, each with its own state and, if wanted, its own model and Omega.

    z = zeta + z_steady(tau) with the response z_steady of the linear part to all loads and prescribed displacements, so
    that zeta' = poles zeta - input w, w = p - kr d.

    Parameters
    ----------
    models : one model, or B of one kind.
    Omega : () or (B,), > 0.
    steps : N per excitation period; by default so many that the error is about 1e-9.
    points : s, Gauss points of a step.

    Raises
    ------
    ValueError
        If Omega is not positive, the models are not of one kind, or too large for their modes to be computed.
    """

    def __init__(
        self, models: Model | Sequence[Model], Omega: float | Array, steps: int | None = None, points: int = 5
    ) -> None:
        models = (models,) if isinstance(models, Model) else tuple(models)
        Omega = np.atleast_1d(np.asarray(Omega, dtype=float))
        if not np.all(np.isfinite(Omega) & (Omega > 0)):
            raise ValueError(f"Omega = {Omega} must be positive and finite")
        if len(models) > 1 and len(Omega) not in (1, len(models)):
            raise ValueError(f"{len(models)} models and {len(Omega)} values of Omega; need one or as many")
        unique = list(dict.fromkeys(map(id, models)))
        systems = [next(m for m in models if id(m) == key).system() for key in unique]
        self.structures = [Structure(system) for system in systems]
        sizes = {(st.n, st.m, len(_modes(st).poles), len(st.system.elements)) for st in self.structures}
        if len(sizes) > 1:
            raise ValueError("the models must have the same number of coordinates, elements and modes")
        self.rows = max(len(models), len(Omega))  # of the tables: 1, or one for each motion
        of = np.array([unique.index(id(m)) for m in models])
        self.of = np.broadcast_to(of, self.rows) if len(of) == 1 else of
        self.Omega = np.broadcast_to(Omega, self.rows).copy()
        self.m, self.s = self.structures[0].m, points
        self.N = steps or self._enough(systems)
        counted(f"steps per period at Omega = {self.Omega.min():g}", self.N, _MOST_STEPS, least=3)
        self._laws(systems)
        self._steady(systems)
        self._tables()

    def _enough(self, systems: list[System]) -> int:
        """Steps per period so that neither the contact stiffness nor the excitation changes much in one of them."""
        count = 12.0
        for i, (structure, system) in enumerate(zip(self.structures, systems, strict=True)):
            modes = _modes(structure)
            mobility = np.abs(np.einsum("jr,r,rj->j", modes.output, modes.poles, modes.input))
            pace = np.sqrt((mobility * np.maximum(structure.kr, [e.law.reference for e in system.elements])).max())
            count = max(count, 2 * np.pi * pace / (0.6 * self.Omega[self.of == i].min()))
            orders = [e.displacement.order for e in system.elements] + [load.order for load in system.loads]
            parts = [part for e in system.elements for part in e.law.parts]
            orders += [spring.stiffness.order for part in parts for spring in part.piecewise or ()]
            count = max(count, 5.0 * max(orders))
        return int(np.ceil(count))

    def _laws(self, systems: list[System]) -> None:
        self.laws = [tuple(e.law for e in system.elements) for system in systems]
        found = [Pieces.of(laws) for laws in self.laws]
        if len({p.slope.shape for p in found}) > 1 or len({p.line.tobytes() for p in found}) > 1:
            raise ValueError("the models must have laws of the same kind, element by element")
        slope, offset, low, high = (np.array(x)[self.of] for x in zip(*map(Pieces.numbers, found), strict=True))
        self.pieces = Pieces(slope, offset, low, high, found[0].line)
        self.linear = bool(found[0].line.all())
        self.kr = np.array([st.kr for st in self.structures])[self.of]
        rows = [[stiffness_row(law) for law in laws] for laws in self.laws]
        L = max(len(row) // 2 for each in rows for row in each)
        c = np.zeros((len(rows), self.m, L + 1), dtype=complex)
        for i, each in enumerate(rows):
            for j, row in enumerate(each):
                c[i, j, : len(row) // 2 + 1] = to_complex(row)
        self.stiffness = c[self.of]

    def _steady(self, systems: list[System]) -> None:
        """Harmonics e^(i k tau), e^(-i k tau) of z_steady (rows, 2, L + 1, r); those of its d, v (rows, L + 1, 2 m)."""
        L = max(max([0, *(e.displacement.order for e in s.elements), *(ld.order for ld in s.loads)]) for s in systems)
        k = np.arange(L + 1)
        self.z = np.zeros((self.rows, 2, L + 1, len(_modes(self.structures[0]).poles)), dtype=complex)
        self.y = np.zeros((self.rows, L + 1, 2 * self.m), dtype=complex)
        for row in range(self.rows):
            structure, system, Omega = self.structures[self.of[row]], systems[self.of[row]], self.Omega[row]
            modes, rate = _modes(structure), 1j * k[:, None] * Omega
            e = np.zeros((L + 1, self.m), dtype=complex)
            F = np.zeros((L + 1, structure.n), dtype=complex)
            for j, element in enumerate(system.elements):
                c = to_complex(element.displacement.row())
                e[: len(c), j] = c
            for load in system.loads:
                for order, vector in load.complex(structure.n).items():
                    F[order] += Omega**load.power * vector
            pull = (structure.kr + structure.c * rate) * e
            ahead = (F @ modes.left.T + pull @ modes.input.T) / (rate - modes.poles)
            back = (F.conj() @ modes.left.T + pull.conj() @ modes.input.T) / (-rate - modes.poles)
            self.z[row] = 0.5 * ahead, 0.5 * back
            d = ahead @ modes.output.T - e
            self.y[row] = np.concatenate([d, rate * d], axis=1)

    def _tables(self) -> None:
        """Everything that does not depend on the state, for the N steps of a period."""
        h = 2 * np.pi / (self.N * self.Omega)
        c = np.append(gauss(self.s)[0], 1.0)
        self.phases = 2 * np.pi / self.N * (np.arange(self.N)[:, None] + c)  # (N, s + 1)
        self.full = self._table(h, np.arange(self.rows))
        w = waves(self.phases, max(self.y.shape[1], self.stiffness.shape[2]) - 1)
        shape = (self.rows, self.N, self.s + 1, -1)
        self.drive = (w[:, : self.y.shape[1]] @ self.y).real.reshape(shape)
        self.k = (w[:, : self.stiffness.shape[2]] @ self.stiffness.transpose(0, 2, 1)).real.reshape(shape)[:, :, :-1]

    def _table(self, h: Array, rows: Integers) -> _Table:
        """Matrices for steps h (b,) of the motions in these rows of the tables."""
        of = self.of[rows]
        if len(self.structures) == 1:
            return _table(_modes(self.structures[0]), h, self.s)
        parts = [(np.flatnonzero(of == i), _modes(st)) for i, st in enumerate(self.structures)]
        parts = [(at, modes) for at, modes in parts if at.size]
        tables = [_table(modes, h[at], self.s) for at, modes in parts]
        back = np.argsort(np.concatenate([at for at, _ in parts]))
        return _Table(*(np.concatenate([getattr(t, name) for t in tables])[back] for name in _TABLES))

    def select(self, motions: Integers) -> Stepper:
        """The stepper for some of the motions."""
        if self.rows == 1:
            return self
        out = object.__new__(Stepper)
        out.__dict__.update(self.__dict__)
        out.of, out.Omega, out.rows = self.of[motions], self.Omega[motions], len(motions)
        slope, offset, low, high = (x[motions] for x in self.pieces.numbers())
        out.pieces = Pieces(slope, offset, low, high, self.pieces.line)
        for name in ("kr", "stiffness", "z", "y", "drive", "k"):
            setattr(out, name, getattr(self, name)[motions])
        out.full = self.full.select(motions)
        return out

    # ---- states

    def start(self, y: Array, tau: float = 0.0) -> Flight:
        """Motions from states (B, 2n) at tau."""
        y = np.atleast_2d(np.asarray(y, dtype=float))
        n = self.structures[0].n
        if y.shape[1] != 2 * n or (self.rows > 1 and len(y) != self.rows):
            need = f"({self.rows if self.rows > 1 else 'any number'}, {2 * n})"
            raise ValueError(f"states of shape {y.shape} do not fit; need {need}")
        z = np.empty((len(y), self.z.shape[3]), dtype=complex)
        of = np.broadcast_to(self.of, len(y)) if self.rows == 1 else self.of
        for i, structure in enumerate(self.structures):
            z[of == i] = modal_state(structure, y[of == i])
        return self.fly(z, tau)

    def fly(self, z: ComplexArray, tau: float = 0.0) -> Flight:
        """Motions from modal states z (B, r) at tau."""
        zeta = z - self._steady_state(tau)
        outputs = np.array([np.concatenate([m.output, m.output * m.poles]) for m in map(_modes, self.structures)])[
            self.of
        ]
        steady = (waves(tau, self.y.shape[1] - 1)[0] @ self.y).real
        y = _times(outputs, zeta).real + steady
        d, v = y[:, : self.m], y[:, self.m :]
        return Flight(zeta, d, v, self.pieces.at(d, v))

    def land(self, flight: Flight, tau: float = 0.0) -> ComplexArray:
        """Modal states z (B, r) of motions at tau."""
        return flight.zeta + self._steady_state(tau)

    def states(self, flight: Flight, tau: float = 0.0) -> Array:
        """States (B, 2n), without free motions."""
        z = self.land(flight, tau)
        of = np.broadcast_to(self.of, len(z)) if self.rows == 1 else self.of
        out = np.empty((len(z), 2 * self.structures[0].n))
        for i, structure in enumerate(self.structures):
            out[of == i] = physical_state(structure, z[of == i])
        return out

    def _steady_state(self, tau: float) -> ComplexArray:
        w = waves(tau, self.z.shape[2] - 1)[0]
        d: Array = w @ self.z[:, 0] + w.conj() @ self.z[:, 1]
        return d

    # ---- steps

    def advance(self, flight: Flight, periods: int = 1, record: bool = False) -> tuple[Array, Array] | None:
        """Carry motions that are at tau = 0 (mod 2 pi) over whole excitation periods, in place.

        Those that run away beyond all numbers become inf and nan.

        Returns
        -------
        With ``record``, d and v (B, m, periods N 16) at equal instants from the start; else None.
        """
        kept = []
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(periods):
                for i in range(self.N):
                    fine = self._cell(flight, i, record)
                    if record:
                        kept.append(fine)
        if not record:
            return None
        d, v = (np.concatenate([np.swapaxes(x[which], 1, 2) for x in kept], axis=2) for which in (0, 1))
        return d, v

    def _cell(self, flight: Flight, i: int, record: bool) -> Any:
        """One step of all motions, over the cell i of the period."""
        zeta, y = self._leap(self.full, flight, self.drive[:, i], self.k[:, i], self.phases[i, :-1])
        data = self._data(flight, y, self.full.h)
        _, values, slopes, _ = _dense(self.s)
        d = values @ data
        at, side = self._exits(flight, d, data)
        fine: Any = (d[:, :-1], (slopes @ data)[:, :-1] / self.full.h[:, None, None]) if record else None
        rows = np.flatnonzero(np.isfinite(at).any(axis=1)) if at is not None else np.empty(0, dtype=int)
        if rows.size == 0:
            self._commit(flight, zeta, y)
            return fine
        before = flight.select(rows)
        self._commit(flight, zeta, y)
        part = self.select(rows)
        pieced = part._pass_corners(before, i, at[rows], side[rows], record)
        flight.put(rows, before)
        if record:
            fine[0][rows], fine[1][rows] = pieced
        return fine

    def _commit(self, flight: Flight, zeta: ComplexArray, y: Array) -> None:
        flight.zeta, flight.d, flight.v = zeta, y[:, -1, 0], y[:, -1, 1]

    def _leap(self, table: _Table, flight: Flight, drive: Array, k: Array, tau: Array) -> tuple[ComplexArray, Array]:
        """One step of each motion with each element on its piece.

        drive (B or 1, s + 1, 2 m) at the Gauss points and the end; k (B or 1, s, m) and tau (B or 1, s) at the former.

        Returns
        -------
        zeta at the end (B, r); y (B, s + 1, 2, m), the d and v at the Gauss points and the end.
        """
        B, s, m = len(flight.zeta), self.s, self.m
        y = (_times(table.observe, flight.zeta).real.reshape(B, s + 1, 2 * m) + drive).reshape(B, s + 1, 2, m)
        slope, offset = self._lines(flight.piece)
        if self.linear:
            kd = k * slope[:, None]
            D = kd - self.kr[:, None]
            right = (D * y[:, :-1, 0] + k * offset[:, None]).reshape(B, -1)
            w = np.linalg.solve(_EYE[s * m] + D.reshape(B, -1, 1) * table.inner[:, 0], right[..., None])[..., 0]
        else:
            w = self._newton(table, y, k, tau, slope, offset)
        zeta = table.turn * flight.zeta - _times(table.push, w)
        return zeta, y - _times(table.kernel, w).reshape(y.shape)

    def _newton(self, table: _Table, y: Array, k: Array, tau: Array, slope: Array, offset: Array) -> Array:
        """w = p - kr d at the Gauss points (B, s m), for laws that are not straight on their pieces."""
        B, s, m = len(y), self.s, self.m
        free = y[:, :-1]
        w = np.zeros((B, s * m))
        for _ in range(30):
            felt = [_times(table.inner[:, i], w).reshape(B, s, m) for i in (0, 1)]
            d, v = free[:, :, 0] - felt[0], free[:, :, 1] - felt[1]
            p, kd, kv = self._forces(d, v, tau, k, slope, offset)
            kr = self.kr[:, None]
            J = _EYE[s * m] + (kd - kr).reshape(B, -1, 1) * table.inner[:, 0] + kv.reshape(B, -1, 1) * table.inner[:, 1]
            step = np.linalg.solve(J, (w - (p - kr * d).reshape(B, -1))[..., None])[..., 0]
            w = w - step
            if np.abs(step).max(initial=0.0) <= 1e-14 * (1e-300 + np.abs(w).max(initial=0.0)):
                break
        return w

    def _forces(
        self, d: Array, v: Array, tau: Array, k: Array, slope: Array, offset: Array
    ) -> tuple[Array, Array, Array]:
        """p and its derivatives (B, s, m)."""
        kd = k * slope[:, None] + 0 * d
        p, kv = kd * d + k * offset[:, None], np.zeros_like(d)
        tau = np.broadcast_to(tau, d.shape[:2])
        of = np.broadcast_to(self.of, len(d)) if self.rows == 1 else self.of
        for j in np.flatnonzero(~self.pieces.line):
            for i, laws in enumerate(self.laws):
                here = of == i
                found = laws[j].force(d[here, :, j], v[here, :, j], tau[here])
                p[here, :, j], kd[here, :, j], kv[here, :, j] = found
        return p, kd, kv

    def _lines(self, piece: Integers) -> tuple[Array, Array]:
        return self._of_piece(self.pieces.slope, piece), self._of_piece(self.pieces.offset, piece)

    def _of_piece(self, x: Array, piece: Integers) -> Array:
        """x (rows, m, pieces) at the piece of each motion and element (B, m)."""
        every = np.arange(self.m)
        taken: Array = x[0][every, piece] if self.rows == 1 else x[np.arange(len(piece))[:, None], every, piece]
        return taken

    def _data(self, flight: Flight, y: Array, h: Array) -> Array:
        """d and h v at 0, the Gauss points and 1: (B, 2 s + 4, m)."""
        count = self.s + 2
        out = np.empty((len(y), 2 * count, self.m))
        out[:, 0], out[:, 1:count] = flight.d, y[:, :, 0]
        out[:, count], out[:, count + 1 :] = flight.v, y[:, :, 1]
        out[:, count:] *= h[:, None, None]
        return out

    def _exits(self, flight: Flight, d: Array, data: Array) -> tuple[Any, Any]:
        """Where in the step, in units of it, each element first leaves its piece (B, m), and how; None if none does.

        d (B, FINE + 1, m) are samples, data as of `_data`.
        """
        low, high = self._of_piece(self.pieces.low, flight.piece), self._of_piece(self.pieces.high, flight.piece)
        # between samples an extremum exceeds them by no more than half a sample's way at the largest rate
        reach = np.abs(data[:, self.s + 2 :]).max(axis=1) * (1.0 / FINE)
        suspect = (d.max(axis=1) + reach > high) | (d.min(axis=1) - reach < low)
        if not suspect.any():
            return None, None
        rows, j = np.nonzero(suspect)
        x, _, slopes, coefficients = _dense(self.s)
        samples = data[rows, :, j]
        c, k = samples @ coefficients.T, np.arange(len(coefficients))
        at, side = np.full(low.shape, np.inf), np.zeros(low.shape, dtype=int)
        at[rows, j], side[rows, j] = first_exit(
            x, d[rows, :, j], samples @ slopes.T, low[rows, j], high[rows, j],
            lambda which, z: np.einsum("sk,sk->s", c[which], _chebyshev(z, k)),
        )  # fmt: skip
        return at, side

    # ---- corners

    def _pass_corners(self, flight: Flight, i: int, at: Array, side: Integers, record: bool) -> Any:
        """Carry motions that leave their pieces in cell i to its end, from corner to corner; in place.

        at, side (B, m) are the first exits on the way from the start of the cell.
        """
        B = len(flight.d)
        x = np.zeros(B)  # how far each motion is, in units of the cell
        fine = np.zeros((2, B, FINE, self.m))
        left = np.arange(B)  # motions not yet at the end
        for _ in range(_ROUNDS):
            stop = at.min(axis=1)
            part, here = self.select(left), flight.select(left)
            goes = np.isfinite(stop)
            length = np.where(goes, stop, 1.0) * (1 - x[left])
            length, data = part._to_corner(here, i, x[left], length, at, side, goes)
            if record:
                _fill(fine, left, x[left], length, data, self.full.h if self.rows == 1 else self.full.h[left])
            x[left] += length
            here.piece = here.piece + np.where(at <= stop[:, None] + 1e-9, side, 0)
            flight.put(left, here)
            stay = goes & (1 - x[left] > 1e-12)
            left = left[stay]
            if left.size == 0:
                break
            part, here = self.select(left), flight.select(left)
            _, y, table = part._partial(here, i, x[left], 1 - x[left])
            data = part._data(here, y, table.h)
            at, side = part._exits(here, _dense(self.s)[1] @ data, data)
            if at is None:
                at, side = np.full((left.size, self.m), np.inf), np.zeros((left.size, self.m), dtype=int)
        else:
            self._finish(flight, i, left, x)
        return fine

    def _finish(self, flight: Flight, i: int, left: Integers, x: Array) -> None:
        """Take motions that chatter on a corner to the end of the cell as they are: the force is continuous there."""
        part, here = self.select(left), flight.select(left)
        zeta, y, _ = part._partial(here, i, x[left], 1 - x[left])
        part._commit(here, zeta, y)
        flight.put(left, here)

    def _to_corner(
        self, here: Flight, i: int, x: Array, length: Array, at: Array, side: Integers, goes: Bools
    ) -> tuple[Array, Array]:
        """Carry motions to their corners (those that go) or the end of the cell; the way made, and its data.

        The corner is where the step ends, which is more accurate than its inside; so the way is corrected if need be.
        """
        every = np.arange(len(x))
        first = at.argmin(axis=1)
        level = np.where(
            side[every, first] > 0, self._of_piece(self.pieces.high, here.piece)[every, first],
            self._of_piece(self.pieces.low, here.piece)[every, first],
        )  # fmt: skip
        for _ in range(4):
            zeta, y, table = self._partial(here, i, x, length)
            miss = np.where(goes, y[every, -1, 0, first] - level, 0.0)
            v = y[every, -1, 1, first]
            if not np.any(np.abs(miss) > _NEAR * (1 + np.abs(np.where(goes, level, 0.0)))):
                break
            way = np.divide(miss, v, out=np.zeros_like(miss), where=np.abs(v) > 1e-6) / self.full.h
            length = np.clip(length - way, 0.5 * length, np.minimum(1.5 * length, 1 - x))
        data = self._data(here, y, table.h)
        self._commit(here, zeta, y)
        return length, data

    def _partial(self, here: Flight, i: int, x: Array, length: Array) -> tuple[ComplexArray, Array, _Table]:
        """A step over the part (x, x + length) of cell i, different for each motion: zeta, y and the table used."""
        B = len(x)
        h = length * self.full.h
        table = self._table(h, np.arange(B) if self.rows > 1 else np.zeros(B, dtype=int))
        c = np.append(gauss(self.s)[0], 1.0)
        tau = 2 * np.pi / self.N * (i + x[:, None] + length[:, None] * c)
        w = waves(tau, max(self.y.shape[1], self.stiffness.shape[2]) - 1).reshape(B, self.s + 1, -1)
        drive = (w[:, :, : self.y.shape[1]] @ self.y).real
        k = (w[:, :-1, : self.stiffness.shape[2]] @ self.stiffness.transpose(0, 2, 1)).real
        zeta, y = self._leap(table, here, drive, k, tau[:, :-1])
        return zeta, y, table


_EYE = [np.eye(n) for n in range(65)]


def _times(A: Any, x: Any) -> Any:
    """A x for matrices A (B or 1, p, q) and vectors x (B, q)."""
    return x @ A[0].T if len(A) == 1 else (A @ x[..., None])[..., 0]


def _fill(fine: Array, motions: Integers, x: Array, length: Array, data: Array, h: Array) -> None:
    """Samples of the cell that lie in the parts (x, x + length) of it, from their data as of `Stepper._data`."""
    grid, _, _, coefficients = _dense(data.shape[1] // 2 - 2)
    z = (grid[:-1] - x[:, None]) / np.maximum(length, 1e-300)[:, None]
    rows, at = np.nonzero((z >= 0) & (z < 1))
    if rows.size == 0:
        return
    k = np.arange(len(coefficients))
    c = np.einsum("kl,slj->skj", coefficients, data[rows])
    fine[0, motions[rows], at] = np.einsum("sk,skj->sj", _chebyshev(z[rows, at], k), c)
    slope = np.einsum("sk,skj->sj", _chebyshev_slope(z[rows, at], k), c)
    fine[1, motions[rows], at] = slope / (length * h)[rows, None]
