"""Time integration of many motions at once, exact in the linear part: exponential collocation.

The coordinates z of the modes of the structure closed by its reference springs kr obey

    z' = poles z + left F(tau) - input (p - kr d - kr e - c e'),   d = output z - e

Of an e with corners kr e + c e' stands with p, a polynomial in every step, for steps end at the corners.

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
from threading import Event
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.threads import for_each, processors
from hbgear.common.ranges import counted
from hbgear.harmonic.multipliers.gauss_points import gauss_nodes
from hbgear.harmonic.structure.modes import halves, mobility_of
from hbgear.harmonic.structure.receptance import LinearStructure, Modes
from hbgear.mechanics.models import Model
from hbgear.mechanics.reference_stiffness import references
from hbgear.mechanics.series.fourier import Series, to_complex
from hbgear.time.exponential.excitation import Excitation
from hbgear.time.exponential.law_table import LawTable
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers, segment_at
from hbgear.time.exponential.step_tables import Steps, dense, packed

_WEAK = 0.01  # share of the structure's stiffness by which smooth laws are closed: p - kr d is what steps approximate


def modal_state(structure: LinearStructure, y: Array) -> ComplexArray:
    """z (..., r) of states y (..., 2n): z = left (C q + M q') + poles left M q; free motions drop out."""
    modes = _modes(structure)
    q, v = y[..., : structure.n], y[..., structure.n :]
    z: Array = (q @ structure.C.T + v @ structure.M.T) @ modes.left.T + modes.poles * (q @ structure.M.T @ modes.left.T)
    return z


def physical_state(structure: LinearStructure, z: ComplexArray) -> Array:
    """States (..., 2n) of z (..., r): q = right z, q' = right poles z, without free motions."""
    modes = _modes(structure)
    return np.concatenate([(z @ modes.right.T).real, (z * modes.poles @ modes.right.T).real], axis=-1)


def _modes(structure: LinearStructure) -> Modes:
    if structure.modes is None:
        raise ValueError(
            f"this needs the modes of the structure; {structure.n} coordinates are too many: use integrate with "
            "method='Radau', or reduce the model"
        )
    return structure.modes


def _at_speeds(models: tuple[Model, ...], Omega: float | Array) -> tuple[tuple[Model, ...], tuple[Model, ...]]:
    """The models, if a structure of theirs depends on speed, else nothing; and what stands for them at their Omega."""
    systems = {id(model): model.system() for model in models}
    if all(system.speed is None for system in systems.values()):
        return (), models
    each = np.atleast_1d(np.asarray(Omega, dtype=float)).tolist()
    rows = max(len(models), len(each))
    if {len(models), len(each)} - {1, rows}:
        raise ValueError(f"{len(models)} models and {len(each)} values of Omega; need one or as many")
    pairs = list(zip(list(models) * (rows // len(models)), each * (rows // len(each)), strict=True))
    still = {(id(model), w): systems[id(model)].at_speed(w) for model, w in pairs}
    return models, tuple(still[id(model), w] for model, w in pairs)


_MOST_STEPS = 100_000  # per period of the excitation, each with its own drive in the tables


_AT_ONCE = 512  # motions whose laws are asked together, or that a thread takes up at a time


_LEAST = 1000  # products of numbers that would take as long as the shortest step


_SHORT = 1e7  # the same that take no longer than threads to start


_LONG = 1e8  # the same in one call of a kernel at most, so that Ctrl-C is heard within a second


@dataclass(frozen=True)
class _Half:
    """One mode of each conjugate pair of a structure, and its real modes.

    kept (q,): where they stand among all; twice (q,): 2 for one of a pair, 1 for a real one.
    """

    kept: Integers
    twice: Array

    @staticmethod
    def of(modes: Modes) -> _Half:
        pairs, alone = halves(modes.poles)
        return _Half(np.concatenate([pairs, alone]), np.repeat([2.0, 1.0], [len(pairs), len(alone)]))


def _parted(z: ComplexArray) -> Array:
    """Real parts, then imaginary parts, along the last axis."""
    return np.concatenate([z.real, z.imag], axis=-1)


@dataclass(eq=False)
class StateBatch:
    """Motions under way: z less its steady part (B, 2 q), d and v (B, m) now, the piece each element is on (B, m).

    z is that of one mode of each conjugate pair and of the real modes: real parts, then imaginary parts.
    """

    zeta: Array
    d: Array
    v: Array
    piece: Integers

    def select(self, rows: Integers) -> StateBatch:
        """Some of the motions."""
        return StateBatch(self.zeta[rows], self.d[rows], self.v[rows], self.piece[rows])

    def put(self, rows: Integers, other: StateBatch) -> None:
        """Replace some of the motions."""
        for mine, others in zip(self.arrays(), other.arrays(), strict=True):
            mine[rows] = others

    def arrays(self) -> tuple[Array, Array, Array, Integers]:
        """zeta, d, v, piece."""
        return self.zeta, self.d, self.v, self.piece


class ExponentialIntegrator:
    """The exponential method for B motions, each with its own state and, if wanted, its own model and Omega.

    z = zeta + z_steady(tau) with the response z_steady of the linear part to all loads and prescribed displacements, so
    that zeta' = poles zeta - input w, w = p - kr d. The steps are those of `stepping`.

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
        self._spinning, models = _at_speeds(models, Omega)
        unique = list(dict.fromkeys(map(id, models)))
        self.systems = [next(m for m in models if id(m) == key).system() for key in unique]
        self.structures = [LinearStructure(system, references(system, _WEAK)) for system in self.systems]
        sizes = {(st.n, st.m, len(_modes(st).poles), len(st.system.elements)) for st in self.structures}
        if len(sizes) > 1:
            raise ValueError("the models must have the same number of coordinates, elements and modes")
        self._models = np.array([unique.index(id(m)) for m in models])
        self.m, self.s = self.structures[0].m, points
        self.halves = [_Half.of(_modes(st)) for st in self.structures]
        self.q = max(len(half.kept) for half in self.halves)
        self.laws = [tuple(e.law for e in system.elements) for system in self.systems]
        self.table = LawTable.stacked([LawTable.of(laws) for laws in self.laws])
        self.excitation = Excitation.of(self.systems)
        self._idle: list[Any] = []  # room to compute in that is not in use
        self._tune(Omega, steps)

    def at(self, Omega: float, steps: int | None = None) -> ExponentialIntegrator:
        """The same models at another Omega."""
        if self._spinning:
            return ExponentialIntegrator(self._spinning, Omega, steps, self.s)
        out = object.__new__(ExponentialIntegrator)
        out.__dict__.update(self.__dict__)
        out._tune(Omega, steps)
        return out

    def _tune(self, Omega: float | Array, steps: int | None) -> None:
        """Everything that depends on Omega."""
        Omega = np.atleast_1d(np.asarray(Omega, dtype=float))
        if not np.all(np.isfinite(Omega) & (Omega > 0)):
            raise ValueError(f"Omega = {Omega} must be positive and finite")
        models = len(self._models)
        if models > 1 and len(Omega) not in (1, models):
            raise ValueError(f"{models} models and {len(Omega)} values of Omega; need one or as many")
        self.rows = max(models, len(Omega))  # of the plan: 1, or one for each motion
        self.of = np.broadcast_to(self._models, self.rows) if models == 1 else self._models
        self.Omega = np.broadcast_to(Omega, self.rows).copy()
        self.N = steps or self.excitation.cells(self._enough())
        counted(f"steps per period at Omega = {self.Omega.min():g}", self.N, _MOST_STEPS, least=3)
        self._steady()
        self.plan, self.method, self.corners = self._plan()
        self.reading = np.concatenate([self.plan.output.real, -self.plan.output.imag], axis=2)
        self.steps = Steps.of(self.plan, self.method, self.corners, self.N)

    def _enough(self) -> int:
        """Steps per period so that neither the contact stiffness nor the excitation changes much in one of them."""
        count = 12.0
        for i, (structure, system) in enumerate(zip(self.structures, self.systems, strict=True)):
            modes = _modes(structure)
            mobility = mobility_of(modes.poles, modes.output, modes.input)
            pace = np.sqrt((mobility * np.maximum(structure.kr, references(system))).max())
            count = max(count, 2 * np.pi * pace / (0.6 * self.Omega[self.of == i].min()))
            orders = [e.displacement.order for e in system.elements] + [load.order for load in system.loads]
            parts = [part for e in system.elements for part in e.law.parts]
            orders += [spring.stiffness.order for part in parts for spring in part.piecewise or ()]
            count = max(count, 5.0 * max(orders))
        return int(np.ceil(count))

    def _steady(self) -> None:
        """z_steady (rows, 2 q) at tau = 0, and the harmonics of its d and v (rows, L + 1, 2 m)."""
        orders = [[e.displacement.order for e in s.elements] + [load.order for load in s.loads] for s in self.systems]
        L = max(0, *(order for each in orders for order in each))
        k = np.arange(L + 1)
        z = np.zeros((self.rows, self.q), dtype=complex)
        self.y = np.zeros((self.rows, L + 1, 2 * self.m), dtype=complex)
        for row in range(self.rows):
            i, Omega = self.of[row], self.Omega[row]
            structure, system, kept = self.structures[i], self.systems[i], self.halves[i].kept
            modes, rate = _modes(structure), 1j * k[:, None] * Omega
            e = np.zeros((L + 1, self.m), dtype=complex)
            F = np.zeros((L + 1, structure.n), dtype=complex)
            for j, element in enumerate(system.elements):
                if isinstance(element.displacement, Series):
                    c = to_complex(element.displacement.row())
                    e[: len(c), j] = c
            for load in system.loads:
                for order, vector in load.complex(structure.n).items():
                    F[order] += Omega**load.power * vector
            pull = (structure.kr + structure.c * rate) * e
            ahead = (F @ modes.left.T + pull @ modes.input.T) / (rate - modes.poles)
            back = (F.conj() @ modes.left.T + pull.conj() @ modes.input.T) / (-rate - modes.poles)
            z[row, : len(kept)] = 0.5 * (ahead + back)[:, kept].sum(axis=0)
            d = ahead @ modes.output.T - e
            self.y[row] = np.concatenate([d, rate * d], axis=1)
        self.z = _parted(z)

    def _plan(self) -> Any:
        """The machines, the way of all motions, and the corners of the excitation."""
        from hbgear.time.exponential.kernels import Breakpoints, Method, Plan

        R, q, m, table = self.rows, self.q, self.m, self.table
        poles, output, input = (np.zeros(shape, dtype=complex) for shape in ((R, q), (R, 2 * m, q), (R, q, m)))
        for row, i in enumerate(self.of):
            modes, half = _modes(self.structures[i]), self.halves[i]
            kept, size = half.kept, len(half.kept)
            poles[row, :size], input[row, :size] = modes.poles[kept], modes.input[kept]
            d = modes.output[:, kept] * half.twice
            output[row, :, :size] = np.concatenate([d, d * modes.poles[kept]])
        kr, c = (np.array([getattr(self.structures[i], name) for i in self.of]) for name in ("kr", "c"))
        laws = (table.stiffness, table.slope, table.offset, table.low, table.high, table.cubic)
        each = (poles, output, input, kr, self.y, *(x[self.of] for x in laws), 2 * np.pi / (self.N * self.Omega))
        x, lagrange = gauss_nodes(self.s)
        straight = not (table.in_python.any() or table.cubic[..., 1].any())
        method = Method(table.element, table.in_python, straight, np.append(x, 1.0), lagrange, *dense(self.s))
        corners = None
        if self.excitation.any:
            pieces = self.excitation.at[self.of], self.excitation.rows[self.of]
            corners = Breakpoints(*packed((*pieces, *self.excitation.stops(self.N, self.of, self.Omega), kr, c)))
        return Plan(*packed(each)), Method(*packed(method)), corners

    def select(self, motions: Integers) -> ExponentialIntegrator:
        """The stepper for some of the motions."""
        if self.rows == 1:
            return self
        out = object.__new__(ExponentialIntegrator)
        out.__dict__.update(self.__dict__)
        out.of, out.Omega, out.rows = self.of[motions], self.Omega[motions], len(motions)
        out.z, out.y, out.reading = self.z[motions], self.y[motions], self.reading[motions]
        out.plan, out.corners = (each and type(each)(*(x[motions] for x in each)) for each in (self.plan, self.corners))
        out.steps = self.steps.select(motions)
        return out

    # ---- states

    def start(self, y: Array) -> StateBatch:
        """Motions from states (B, 2n) at tau = 0."""
        y = np.atleast_2d(np.asarray(y, dtype=float))
        n = self.structures[0].n
        if y.shape[1] != 2 * n or (self.rows > 1 and len(y) != self.rows):
            need = f"({self.rows if self.rows > 1 else 'any number'}, {2 * n})"
            raise ValueError(f"states of shape {y.shape} do not fit; need {need}")
        return self.fly(self.modal(y))

    def modal(self, y: Array) -> Array:
        """Modal states z (B, 2 q), real parts and then imaginary parts, of states (B, 2n)."""
        z = np.zeros((len(y), self.q), dtype=complex)
        for i, rows in self._each(len(y)):
            kept = self.halves[i].kept
            z[np.ix_(rows, np.arange(len(kept)))] = modal_state(self.structures[i], y[rows])[:, kept]
        return _parted(z)

    def fly(self, z: Array) -> StateBatch:
        """Motions from modal states z (B, 2 q) at tau = 0."""
        zeta = z - self.z
        y = (self.reading @ zeta[..., None])[..., 0] + self.y.sum(axis=1).real - self._moved()
        d, v = np.ascontiguousarray(y[:, : self.m]), np.ascontiguousarray(y[:, self.m :])
        return StateBatch(zeta, d, v, segment_at(self.plan.high, d, v))

    def _moved(self) -> Array:
        """e and e' (rows, 2 m) at tau = 0 of the elements whose e has corners."""
        out = np.zeros((self.rows, 2 * self.m))
        for row, i in enumerate(self.of):
            for j, element in enumerate(self.systems[i].elements):
                if element.displacement.corners:
                    out[row, j] = element.displacement(0.0)
                    out[row, self.m + j] = self.Omega[row] * element.displacement(0.0, 1)
        return out

    def land(self, flight: StateBatch) -> Array:
        """Modal states z (B, 2 q) of motions at tau = 0."""
        return flight.zeta + self.z

    def states(self, flight: StateBatch) -> Array:
        """States (B, 2n) at tau = 0, without free motions."""
        z = self.land(flight)
        out = np.empty((len(z), 2 * self.structures[0].n))
        for i, rows in self._each(len(z)):
            half, structure = self.halves[i], self.structures[i]
            size = len(half.kept)
            whole = np.zeros((len(rows), len(_modes(structure).poles)), dtype=complex)
            whole[:, half.kept] = half.twice * (z[rows, :size] + 1j * z[rows, self.q : self.q + size])
            out[rows] = physical_state(structure, whole)
        return out

    def weights(self) -> Array:
        """Size (rows or 1, 2 q) of the motion each part of z stands for, coordinates scaled by the roots of masses."""
        each = np.zeros((len(self.structures), self.q))
        for i, (structure, half) in enumerate(zip(self.structures, self.halves, strict=True)):
            size = np.sqrt(np.abs(np.diag(structure.M)))[:, None] * _modes(structure).right[:, half.kept]
            each[i, : len(half.kept)] = np.linalg.norm(size, axis=0) * np.sqrt(half.twice)
        return np.tile(each[self.of], 2)

    def _each(self, count: int) -> list[tuple[int, Integers]]:
        """The structures and the motions, of so many, that have them."""
        of = np.broadcast_to(self.of, count) if self.rows == 1 else self.of
        return [(i, np.flatnonzero(of == i)) for i in range(len(self.structures))]

    # ---- steps

    def advance(self, flight: StateBatch, periods: int = 1, record: bool = False) -> tuple[Array, Array] | None:
        """Carry motions that are at tau = 0 (mod 2 pi) over whole excitation periods, in place.

        Returns
        -------
        With ``record``, d and v (B, m, periods N 16) at equal instants from the start; else None.
        """
        B = len(flight.d)
        fine = np.empty((2, B, self.m, periods * self.N * SAMPLES_PER_STEP) if record else (2, 1, 0, 0))
        self._march(flight, periods, np.empty((0, B, 2 * self.q)), fine)
        return (fine[0], fine[1]) if record else None

    def strobe(self, flight: StateBatch, seen: Array) -> None:
        """`advance` over as many periods as seen (periods, B, 2 q) has room for: zeta after each of them."""
        self._march(flight, len(seen), seen, np.empty((2, 1, 0, 0)))

    def _march(self, flight: StateBatch, periods: int, strobes: Array, fine: Array) -> None:
        """Carry motions on, many over threads."""
        from hbgear.time.exponential.kernels import allocate_tables, allocate_workspace, integrate_segments

        s, m, q, cells, asks, B = (
            self.s,
            self.m,
            self.q,
            periods * self.N,
            bool(self.table.in_python.any()),
            len(flight.d),
        )
        S, recorded = len(self.method.element), 200 * SAMPLES_PER_STEP * m if fine.size else 0
        cost = max(self.steps.cost, _LEAST) + recorded  # of a step
        few = asks or cost * cells * B < _SHORT
        together = min(B if few else -(-B // (4 * processors())), _AT_ONCE)
        block = max(1, int(_LONG / (cost * max(1, together))))

        shared = (self.plan, self.method, self.corners, self.steps.whole, self.steps.folded, self.steps.curves(not few))

        def carry(first: int, stop: Event) -> None:
            last = min(first + together, B)
            try:
                cut, work = self._idle.pop()
            except IndexError:  # none is in store
                G = last - first if asks else 1
                cut, work = allocate_tables(G, 1, s, m, q, S), allocate_workspace(G, s, m, q)
            for begin in range(0, cells, block):
                if stop.is_set():
                    return
                work.place[:, 0] = begin
                end = min(begin + block, cells)
                while integrate_segments(*shared, cut, work, *flight.arrays(), first, last, begin, end, strobes, fine):
                    self._ask(work, first)
            if not asks:
                self._idle.append((cut, work))

        starts = range(0, B, max(1, together))
        if few:
            for first in starts:
                carry(first, Event())
        else:
            for_each(carry, starts)

    def _ask(self, work: Any, first: int) -> None:
        """Have the laws that are no tables give their forces to the motions that wait for them."""
        waiting, s, m = np.flatnonzero(work.laid), self.s, self.m
        x, length = work.span[waiting].T[:, :, None]
        tau = 2 * np.pi / self.N * (work.place[waiting, :1] % self.N + x + length * self.method.nodes[:-1])
        y = work.y[waiting].reshape(len(waiting), s + 1, 2, m)[:, :-1]
        of = self.of[first + waiting] if self.rows > 1 else np.broadcast_to(self.of, len(waiting))
        for i, laws in enumerate(self.laws):
            here = np.flatnonzero(of == i)
            for j in np.flatnonzero(self.table.in_python) if here.size else ():
                found = laws[j].force(y[here, :, 0, j], y[here, :, 1, j], tau[here])
                for which in range(3):
                    work.given[waiting[here], which, :, j] = found[which]
