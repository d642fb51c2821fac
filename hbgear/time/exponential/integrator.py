"""Time integration of many motions at once by exponential collocation: the linear part is integrated exactly.

The modal coordinates z of the structure, which contains the reference springs kr of the elements, obey

    z' = poles z + left F(tau) - input (p - kr d - kr e - c e'),   d = output z - e

For a displacement e with breakpoints, kr e + c e' is added to p. It is a polynomial in each step, because steps end at
the breakpoints.

In a step of length h the linear part and the loads are exact. w = p - kr d is approximated by the polynomial through
its values at s Gauss points, which are solved for together with the displacements there,
d(c_i h) = d_linear(c_i h) - sum_j A_ij w_j. Stiff supports and fast modes do not limit the step length. The order is 2s
if |poles| h is small, and decreases to s + 1 for the contributions of stiff modes. Steps end at the breakpoints of the
laws, so that these do not lower the order.

References
----------
Hochbruck & Ostermann (2010), Acta Numerica 19, https://doi.org/10.1017/S0962492910000048.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Sequence
from threading import Event
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.threads import for_each, processors
from hbgear.common.ranges import counted
from hbgear.harmonic.multipliers.gauss_points import gauss_nodes
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.harmonic.structure.massless import mass_basis
from hbgear.harmonic.structure.modes import mobility_of
from hbgear.mechanics.laws.friction import RigidFriction
from hbgear.mechanics.laws.vector_laws import Component
from hbgear.mechanics.models import Model, System
from hbgear.mechanics.reference_stiffness import references
from hbgear.time.exponential.excitation import Excitation
from hbgear.time.exponential.law_table import LawTable
from hbgear.time.exponential.modal_states import (
    StateBatch,
    StoredModes,
    modal_state,
    modes_of,
    physical_state,
    real_and_imaginary,
    too_large,
)
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers, segment_at
from hbgear.time.exponential.steady_part import element_without_mass, following_loads, highest_order, steady_part
from hbgear.time.exponential.step_tables import Steps, dense, packed

_MAX_EXCITATION_STEPS = 100_000
"""Largest number of steps per excitation period [-]; the tables hold the excitation of each step."""

_CHECKED_MOTIONS = 4
"""Number of motions, the largest ones, with which the number of steps is checked."""

_MAX_STEP_CHANGE = 1e-8
"""Change of a motion in one period by twice the steps, relative to its size, for which their number is accepted."""

_MAX_REFINEMENT = 64
"""Largest ratio of the steps that a law requires to those that springs and excitation require."""

_REFERENCE_STIFFNESS_RATIO = 0.01
"""Reference stiffness of smooth laws as a fraction of the stiffness of the structure [-]."""

_MAX_BLOCK_MOTIONS = 512
"""Largest number of motions of one block [-]. Laws in Python are evaluated for all motions of a block together, and
each thread integrates one block at a time."""

_MIN_STEP_COST = 1000
"""Number of products [-] that takes as long as the shortest step."""

_MAX_SERIAL_COST = 1e7
"""Number of products [-] below which starting threads takes longer than the integration."""

_MAX_CALL_COST = 1e8
"""Number of products [-] of one kernel call; Ctrl-C is handled between calls, within a second."""


def _at_speeds(models: tuple[Model, ...], Omega: float | Array) -> tuple[tuple[Model, ...], tuple[Model, ...]]:
    """Return the models if the structure of one depends on speed, else nothing; and the models at their Omega."""
    systems = {id(model): model.system() for model in models}
    if all(system.speed is None for system in systems.values()):
        return (), models
    freq = np.atleast_1d(np.asarray(Omega, dtype=float)).tolist()
    rows = max(len(models), len(freq))
    if {len(models), len(freq)} - {1, rows}:
        raise ValueError(f"{len(models)} models and {len(freq)} values of Omega; give one Omega or one for each model")
    pairs = list(zip(list(models) * (rows // len(models)), freq * (rows // len(freq)), strict=True))
    fixed = {(id(model), w): systems[id(model)].at_speed(w) for model, w in pairs}
    return models, tuple(fixed[id(model), w] for model, w in pairs)


def _required_steps(structure: LinearStructure, system: System, Omega: float) -> float:
    """Return the steps per period that resolve the highest contact frequency and the harmonics of the excitation."""
    modes = modes_of(structure)
    mobility = mobility_of(modes.poles, modes.output, modes.input)
    contact_frequency = np.sqrt((mobility * np.maximum(structure.kr, references(system))).max())
    orders = [e.displacement.order for e in system.elements] + [load.order for load in system.loads]
    laws = [part for e in system.elements for part in e.law.parts]
    orders += [spring.stiffness.order for part in laws for spring in part.piecewise or ()]
    return max(float(2 * np.pi * contact_frequency / (0.6 * Omega)), 5.0 * max(orders))


def structure_of(system: System) -> LinearStructure | str:
    """Return the structure of a system that the method integrates, or the reason for which it does not."""
    laws = [part for element in system.elements for part in element.law.parts]
    if any(law.sliders or law.damped or isinstance(law, Component | RigidFriction) for law in laws):
        return (
            "the exponential method, which sweeps, basins and landings of jumps need, does not integrate friction, "
            "contacts with dampers and vector laws"
        )
    structure = LinearStructure(system, references(system, _REFERENCE_STIFFNESS_RATIO))
    if reason := too_large(structure):
        return reason
    if name := element_without_mass(structure):
        return (
            f"element '{name}' acts on coordinates without mass, which the exponential method, sweeps and basins do "
            "not integrate"
        )
    return structure


class ExponentialIntegrator:
    """Exponential method for B motions, each with its own state and optionally with its own model and Omega.

    z = zeta + z_steady(tau) with the response z_steady of the linear part to all loads and prescribed displacements, so
    that zeta' = poles zeta - input w, w = p - kr d. Steps are computed by `kernels`.

    Parameters
    ----------
    models : Model or sequence of Model
        One model, or B models of one kind.
    Omega : float or array_like, shape (B,)
        Excitation frequency, > 0.
    steps : int, optional
        Number of steps N per excitation period. By default the error is about 1e-9.
    points : int, optional
        Number of Gauss points s of a step.
    adaptive : bool, optional
        Take more steps where cubic springs or laws in Python require them; by default if ``steps`` is not given.

    Raises
    ------
    ValueError
        If Omega is not positive, the models are not of one kind, or the method does not integrate them.
    """

    def __init__(
        self,
        models: Model | Sequence[Model],
        Omega: float | Array,
        steps: int | None = None,
        points: int = 5,
        adaptive: bool | None = None,
    ) -> None:
        models = (models,) if isinstance(models, Model) else tuple(models)
        self._speed_dependent, models = _at_speeds(models, Omega)
        unique = list(dict.fromkeys(map(id, models)))
        self.systems = [next(m for m in models if id(m) == key).system() for key in unique]
        self.structures: list[LinearStructure] = []
        for system in self.systems:
            structure = structure_of(system)
            if isinstance(structure, str):
                remedy = "use hb.time.integrate(..., method='DOP853' or 'Radau') or hb.time.shoot"
                raise ValueError(f"{structure}: {remedy}")
            self.structures.append(structure)
        sizes = {(st.n, st.m, len(modes_of(st).poles), len(st.system.elements)) for st in self.structures}
        if len(sizes) > 1:
            raise ValueError("the models must have the same numbers of coordinates, elements and modes")
        self._models = np.array([unique.index(id(m)) for m in models])
        self.m, self.s = self.structures[0].m, points
        self.stored = [StoredModes.of(modes_of(st)) for st in self.structures]
        self.q = max(len(modes.indices) for modes in self.stored)
        self.laws = [tuple(e.law for e in system.elements) for system in self.systems]
        self.table = LawTable.stacked([LawTable.of(laws) for laws in self.laws])
        self.excitation = Excitation.of(self.systems)
        self._workspaces: list[Any] = []  # pairs of tables and workspace that no thread uses
        self._adaptive = adaptive
        self._set_frequency(Omega, steps)

    def at(self, Omega: float | Array, steps: int | None = None) -> ExponentialIntegrator:
        """Return the integrator of the same models at another Omega."""
        if self._speed_dependent:
            return ExponentialIntegrator(self._speed_dependent, Omega, steps, self.s, self._adaptive)
        out = copy.copy(self)
        out._set_frequency(Omega, steps)
        return out

    def _set_frequency(self, Omega: float | Array, steps: int | None) -> None:
        """Compute all data that depend on Omega."""
        Omega = np.atleast_1d(np.asarray(Omega, dtype=float))
        if not np.all(np.isfinite(Omega) & (Omega > 0)):
            raise ValueError(f"Omega = {Omega} must be positive and finite")
        models = len(self._models)
        if models > 1 and len(Omega) not in (1, models):
            raise ValueError(f"{models} models and {len(Omega)} values of Omega; give one Omega or one for each model")
        self.rows = max(models, len(Omega))  # of the plan: 1, or 1 for each motion
        self.index = np.broadcast_to(self._models, self.rows) if models == 1 else self._models  # system of each row
        self.Omega = np.broadcast_to(Omega, self.rows).copy()
        self.N = steps or self.excitation.cells(self._default_steps())
        self.adaptive = steps is None if self._adaptive is None else self._adaptive
        counted(f"steps per period at Omega = {self.Omega.min():g}", self.N, _MAX_EXCITATION_STEPS, least=3)
        self._set_steady_part()
        self.plan, self.method, self.breakpoints = self._plan()
        self._output = np.concatenate([self.plan.output.real, -self.plan.output.imag], axis=2)
        self.steps = Steps.of(self.plan, self.method, self.breakpoints, self.N)

    def _default_steps(self) -> int:
        """Return the steps per period that resolve the contact stiffness and the excitation."""
        lowest = [self.Omega[self.index == i].min() for i in range(len(self.systems))]
        return int(np.ceil(max(12.0, *map(_required_steps, self.structures, self.systems, lowest))))

    def _set_steady_part(self) -> None:
        """Store z_steady (rows, 2 q) at tau = 0, and the harmonics of its d and v (rows, L + 1, 2 m)."""
        L = highest_order(self.systems)
        z = np.zeros((self.rows, self.q), dtype=complex)
        self.y = np.zeros((self.rows, L + 1, 2 * self.m), dtype=complex)
        for row in range(self.rows):
            i = self.index[row]
            indices = self.stored[i].indices
            z[row, : len(indices)], self.y[row] = steady_part(
                self.structures[i], self.systems[i], indices, self.Omega[row], L
            )
        self.z = real_and_imaginary(z)

    def _plan(self) -> Any:
        """Return the packed models, the data of all motions, and the breakpoints of the excitation or None."""
        from hbgear.time.exponential.kernels.data import Breakpoints, Method, Plan

        table = self.table
        poles, output, input = self._packed_modes()
        kr, c = (np.array([getattr(self.structures[i], name) for i in self.index]) for name in ("kr", "c"))
        laws = (table.stiffness, table.slope, table.offset, table.low, table.high, table.cubic)
        plan = (poles, output, input, kr, self.y, *(x[self.index] for x in laws), 2 * np.pi / (self.N * self.Omega))
        x, lagrange = gauss_nodes(self.s)
        straight = not (table.in_python.any() or table.cubic[..., 1].any())
        data = (table.element, table.contact, table.owner, table.in_python, straight, np.append(x, 1.0), lagrange)
        method = Method(*data, *dense(self.s))
        breakpoints = None
        if self.excitation.any:
            functions = self.excitation.starts[self.index], self.excitation.rows[self.index]
            ends = self.excitation.step_ends(self.N, self.index, self.Omega)
            breakpoints = Breakpoints(*packed((*functions, *ends, kr, c)))
        return Plan(*packed(plan)), Method(*packed(method)), breakpoints

    def _packed_modes(self) -> tuple[Array, Array, Array]:
        """Return poles (R, q), output (R, 2 m, q) and input (R, q, m) of the stored modes, padded with zeros."""
        R, q, m = self.rows, self.q, self.m
        poles, output, input = (np.zeros(shape, dtype=complex) for shape in ((R, q), (R, 2 * m, q), (R, q, m)))
        for row, i in enumerate(self.index):
            modes, stored = modes_of(self.structures[i]), self.stored[i]
            indices, size = stored.indices, len(stored.indices)
            poles[row, :size], input[row, :size] = modes.poles[indices], modes.input[indices]
            d = modes.output[:, indices] * stored.factor
            output[row, :, :size] = np.concatenate([d, d * modes.poles[indices]])
        return poles, output, input

    def select(self, motions: Integers) -> ExponentialIntegrator:
        """Return the integrator of some of the motions."""
        if self.rows == 1:
            return self
        out = copy.copy(self)
        out.index, out.Omega, out.rows = self.index[motions], self.Omega[motions], len(motions)
        if len(self._models) > 1:
            out._models = self._models[motions]
        if len(self._speed_dependent) > 1:
            out._speed_dependent = tuple(self._speed_dependent[i] for i in motions)
        out.z, out.y, out._output = self.z[motions], self.y[motions], self._output[motions]
        out.plan, out.breakpoints = (
            table and type(table)(*(x[motions] for x in table)) for table in (self.plan, self.breakpoints)
        )
        out.steps = self.steps.select(motions)
        return out

    # ---- states

    def start(self, y: Array) -> StateBatch:
        """Return the motions that start from states (B, 2n) at tau = 0; ValueError for another shape."""
        y = np.atleast_2d(np.asarray(y, dtype=float))
        n = self.structures[0].n
        if y.shape[1] != 2 * n or (self.rows > 1 and len(y) != self.rows):
            shape = f"({self.rows if self.rows > 1 else 'any number'}, {2 * n})"
            raise ValueError(f"states of shape {y.shape} do not fit the models; give an array of shape {shape}")
        return self.from_modal(self.modal(y))

    def modal(self, y: Array) -> Array:
        """Return the modal states z (B, 2 q), real parts and then imaginary parts, of states (B, 2n)."""
        z = np.zeros((len(y), self.q), dtype=complex)
        for i, rows in self._motions_by_structure(len(y)):
            indices = self.stored[i].indices
            z[np.ix_(rows, np.arange(len(indices)))] = modal_state(self.structures[i], y[rows])[:, indices]
        return real_and_imaginary(z)

    def from_modal(self, z: Array) -> StateBatch:
        """Return the motions that start from modal states z (B, 2 q) at tau = 0."""
        zeta = z - self.z
        y = (self._output @ zeta[..., None])[..., 0] + self.y.sum(axis=1).real - self._piecewise_displacements()
        d, v = np.ascontiguousarray(y[:, : self.m]), np.ascontiguousarray(y[:, self.m :])
        (level, rate), owner = self.excitation.levels(self.index, self.Omega), self.method.owner
        return StateBatch(zeta, d, v, segment_at(self.plan.high, d[:, owner] - level, v[:, owner] - rate))

    def _piecewise_displacements(self) -> Array:
        """Return e and e' (rows, 2 m) at tau = 0 of the elements whose e has breakpoints; 0 for the others."""
        out = np.zeros((self.rows, 2 * self.m))
        for row, i in enumerate(self.index):
            for j, element in enumerate(self.systems[i].elements):
                if element.displacement.corners:
                    out[row, j] = element.displacement(0.0)
                    out[row, self.m + j] = self.Omega[row] * element.displacement(0.0, 1)
        return out

    def to_modal(self, batch: StateBatch) -> Array:
        """Return the modal states z (B, 2 q) of motions at tau = 0."""
        return batch.zeta + self.z

    def states(self, batch: StateBatch) -> Array:
        """Return the states (B, 2n) of motions at tau = 0, without free motions."""
        z = self.to_modal(batch)
        out = np.empty((len(z), 2 * self.structures[0].n))
        for i, rows in self._motions_by_structure(len(z)):
            stored, structure = self.stored[i], self.structures[i]
            size = len(stored.indices)
            full_state = np.zeros((len(rows), len(modes_of(structure).poles)), dtype=complex)
            full_state[:, stored.indices] = stored.factor * (z[rows, :size] + 1j * z[rows, self.q : self.q + size])
            out[rows] = physical_state(structure, full_state)
            out[rows] += following_loads(structure, self.Omega[rows] if self.rows > 1 else self.Omega)
        return out

    def weights(self) -> Array:
        """Return the size (rows or 1, 2 q) of the motion of each component of z, with mass-normalized coordinates."""
        sizes = np.zeros((len(self.structures), self.q))
        for i, (structure, stored) in enumerate(zip(self.structures, self.stored, strict=True)):
            size = modes_of(structure).right[:, stored.indices] / np.diag(mass_basis(structure.M))[:, None]
            sizes[i, : len(stored.indices)] = np.linalg.norm(size, axis=0) * np.sqrt(stored.factor)
        return np.tile(sizes[self.index], 2)

    def _motions_by_structure(self, count: int) -> list[tuple[int, Integers]]:
        """Return the index of each structure and its motions out of ``count``."""
        systems = np.broadcast_to(self.index, count) if self.rows == 1 else self.index
        return [(i, np.flatnonzero(systems == i)) for i in range(len(self.structures))]

    # ---- steps

    def advance(self, batch: StateBatch, periods: int = 1, record: bool = False) -> tuple[Array, Array] | None:
        """Integrate motions from tau = 0 (mod 2 pi) over whole excitation periods, in place.

        ``batch`` is replaced by the states at the end. With ``record``, d and v (B, m, periods N SAMPLES_PER_STEP) at
        equidistant instants from the start are returned; else None.
        """
        self.take_sufficient_steps(batch)
        B = len(batch.d)
        fine = np.empty((2, B, self.m, periods * self.N * SAMPLES_PER_STEP) if record else (2, 1, 0, 0))
        self._integrate(batch, periods, np.empty((0, B, 2 * self.q)), fine)
        return (fine[0], fine[1]) if record else None

    def stroboscopic_map(self, batch: StateBatch, states: Array) -> None:
        """Integrate motions in place and store zeta after each period in ``states`` (periods, B, 2 q)."""
        self.take_sufficient_steps(batch)
        self._integrate(batch, len(states), states, np.empty((2, 1, 0, 0)))

    def take_sufficient_steps(self, batch: StateBatch) -> None:
        """Take more steps where motions with cubic springs or laws in Python require them."""
        if self.adaptive and not self.method.straight and len(batch.d):
            self.__dict__.update({**_with_sufficient_steps(self, batch).__dict__, "adaptive": True})

    def _integrate(self, batch: StateBatch, periods: int, strobes: Array, fine: Array) -> None:
        """Integrate motions in place, many motions by several threads."""
        from hbgear.time.exponential.kernels.data import Shared, allocate_tables, allocate_workspace
        from hbgear.time.exponential.kernels.integrate import integrate_segments

        s, m, q, cells, B = self.s, self.m, self.q, periods * self.N, len(batch.d)
        any_in_python = bool(self.table.in_python.any())
        S, record_cost = len(self.method.element), 200 * SAMPLES_PER_STEP * m if fine.size else 0
        cost = max(self.steps.cost, _MIN_STEP_COST) + record_cost  # of a step
        is_serial = any_in_python or cost * cells * B < _MAX_SERIAL_COST
        block_motions = min(B if is_serial else -(-B // (4 * processors())), _MAX_BLOCK_MOTIONS)
        block_cells = max(1, int(_MAX_CALL_COST / (cost * max(1, block_motions))))
        tables = (self.steps.cells, self.steps.maps, self.steps.curves(not is_serial))
        shared = Shared(self.plan, self.method, self.breakpoints, *tables)
        motions, out = batch.arrays(), (strobes, fine)

        def integrate_block(first: int, stop: Event) -> None:
            last = min(first + block_motions, B)
            try:
                cut, work = self._workspaces.pop()
            except IndexError:  # all are in use
                G = last - first if any_in_python else 1
                cut = allocate_tables(G, 1, s, m, q, S)
                work = allocate_workspace(G, s, m, q, self.excitation.contacts)
            for begin in range(0, cells, block_cells):
                if stop.is_set():
                    return
                work.progress[:, 0] = begin
                end = min(begin + block_cells, cells)
                while integrate_segments(shared, cut, work, motions, (first, last, begin, end), out):
                    self._evaluate_laws(work, first)
            if not any_in_python:
                self._workspaces.append((cut, work))

        starts = range(0, B, max(1, block_motions))
        if is_serial:
            for first in starts:
                integrate_block(first, Event())
        else:
            for_each(integrate_block, starts)

    def _evaluate_laws(self, work: Any, first: int) -> None:
        """Evaluate the laws in Python for the motions that wait for their forces."""
        waiting, s, m = np.flatnonzero(work.prepared), self.s, self.m
        x, length = work.span[waiting].T[:, :, None]
        tau = 2 * np.pi / self.N * (work.progress[waiting, :1] % self.N + x + length * self.method.nodes[:-1])
        y = work.y[waiting].reshape(len(waiting), s + 1, 2, m)[:, :-1]
        systems = self.index[first + waiting] if self.rows > 1 else np.broadcast_to(self.index, len(waiting))
        for i, laws in enumerate(self.laws):
            rows = np.flatnonzero(systems == i)
            for j in np.flatnonzero(self.table.in_python) if rows.size else ():
                force = laws[j].force(y[rows, :, 0, j], y[rows, :, 1, j], tau[rows])
                for quantity in range(3):
                    work.forces[waiting[rows], quantity, :, j] = force[quantity]


def _with_sufficient_steps(integrator: ExponentialIntegrator, motions: StateBatch) -> ExponentialIntegrator:
    """Return the integrator, or one with as many steps as motions require, which are not changed.

    A cubic spring that a large motion stiffens, or a steep law in Python such as friction tanh(v / v0), requires more
    steps than springs and excitation. The number is doubled until twice as many do not change one period.
    A RuntimeWarning is given if the largest number of steps does not suffice.
    """
    largest = np.argsort(-np.abs(motions.zeta + integrator.z).max(axis=1))[:_CHECKED_MOTIONS]
    limit = min(integrator.N * _MAX_REFINEMENT, _MAX_EXCITATION_STEPS)
    current, end = integrator, _after_a_period(integrator, motions, largest)
    while limit >= 2 * current.N:
        finer = integrator.at(integrator.Omega, 2 * current.N)
        after = _after_a_period(finer, motions, largest)
        size = np.abs(after + integrator.z[largest if integrator.rows > 1 else 0]).max()
        if not np.abs(after - end).max() > _MAX_STEP_CHANGE * size:  # also if the motion diverges
            return current
        current, end = finer, after
    warnings.warn(
        f"{current.N} steps per period do not resolve a law (twice as many change the motion by more than "
        f"{_MAX_STEP_CHANGE:g}): use hb.time.integrate with method='DOP853' or 'Radau'",
        RuntimeWarning,
        stacklevel=4,
    )
    return current


def _after_a_period(integrator: ExponentialIntegrator, motions: StateBatch, rows: Integers) -> Array:
    """Return zeta of some motions after one period."""
    batch, single = motions.select(rows), copy.copy(integrator.select(rows))
    single.adaptive = False
    single.advance(batch)
    return batch.zeta
