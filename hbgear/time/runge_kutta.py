"""Time integration of the coordinates (q, q') by the Runge-Kutta methods of SciPy, between breakpoints.

    y' = A y + f(tau) - B (p(d, d', tau) - c e'),   y = (q, q')

Coordinates without mass are eliminated from y, see `structure_states`.

Each step ends where an element reaches a breakpoint of its law. On its segment a piecewise-linear law is a straight
line, which is continued beyond the breakpoint within the step; the step is then repeated up to the breakpoint.
Breakpoints of the excitation are known in advance: between two of them stiffness and displacement are polynomials,
which are continued beyond the breakpoints in the same way. Friction sliders add their positions to the state, and end
a step where they slip or stick, see `slider_flow`; contacts with dampers end it where their force jumps, see
`contact_flow`, and rigid friction where an element sticks or is released, see `stick_flow`.

References
----------
Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I (1993), https://doi.org/10.1007/978-3-540-78862-1.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.friction import RigidFriction
from hbgear.mechanics.laws.vector_laws import Component, vector_groups
from hbgear.mechanics.models import System
from hbgear.time.exponential.law_table import LawTable, as_one_spring
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers, first_exit, segment_at
from hbgear.time.flows.contact_flow import ContactFlow
from hbgear.time.flows.excitation import Excitation, Interval
from hbgear.time.flows.slider_flow import SliderFlow
from hbgear.time.flows.stick_flow import StickFlow
from hbgear.time.flows.structure_states import StructureStates, displacement_scales

METHODS = ("DOP853", "RK45", "Radau")
"""Methods of SciPy."""

Lines = tuple[Array, Array, Integers, Integers, Integers]
"""Slope and offset (m,) of the linear segment of each element, the state (2, Q) of each slider, and the states of each
damped contact and each element with rigid friction."""

Visit = Callable[[float, float, Callable[[Array], Array]], None]


class Method(NamedTuple):
    """Method of SciPy with its tolerances: relative, and absolute of each component."""

    name: str
    tolerance: float
    atol: Array

    def start(self, f: Any, t: float, Y: Array, end: float, options: dict[str, Any]) -> Any:
        """Return the solver of y' = f(t, y) from a state at t to an end."""
        return getattr(scipy.integrate, self.name)(f, t, Y, end, rtol=self.tolerance, atol=self.atol, **options)


class Flow:
    """Equations of motion of a system at one Omega.

    Parameters
    ----------
    system : System
        System of equations of a model.
    Omega : float
        Excitation frequency, > 0.
    variational : bool, optional
        Integrate the variational equation Phi' = df/dy Phi as well. The state is then (size, 1 + size), flattened.

    Attributes
    ----------
    states : callable
        Returns the state of (q, q') and the positions of sliders; the same without massless coordinates.
    displacements, load : ndarray of shape (m,), float
        Largest prescribed displacement of each element, and largest rate by a load.
    size : int
        Number of states: `order` of the structure, 2n without massless coordinates, and the positions of the sliders.

    Raises
    ------
    ValueError
        If Omega is not positive and finite.
    """

    def __init__(self, system: System, Omega: float, variational: bool = False) -> None:
        if not (np.isfinite(Omega) and Omega > 0):
            raise ValueError(f"Omega = {Omega} must be positive and finite")
        system = system.at_speed(Omega)
        self.Omega, self.m = Omega, len(system.elements)
        self.structure = states = StructureStates(system, Omega)
        self.n, self.order, self.states = states.inertial, states.order, states.states
        self.A, self.B, self.D, self.W = states.A, states.B, states.D, states.W
        self.laws = tuple(e.law for e in system.elements)
        table = LawTable.of(self.laws, as_one_spring)
        self.low, self.high, (self.slope, self.offset) = table.low, table.high, np.zeros((2, *table.low.shape))
        self.slope[table.element], self.offset[table.element] = table.slope, table.offset
        self.sliders, self.contacts = SliderFlow(system.elements), ContactFlow(system.elements)
        self.size = self.order + len(self.sliders)
        self.columns = 1 + self.size if variational else 1
        self.c = np.array([e.damping for e in system.elements])
        self.vectors = vector_groups(self.laws)
        curved = [j for j in np.flatnonzero(table.in_python) if not isinstance(self.laws[j], Component)]
        jumps = [j for j in curved if self.laws[j].damped or isinstance(self.laws[j], RigidFriction)]
        self._curved = np.array([j for j in curved if j not in jumps], dtype=int)
        self.rigid = StickFlow(system.elements, self.W, self.B[self.n : 2 * self.n])
        self.excitation = Excitation(system, Omega, self.structure.rates)
        self.displacements, self.load = self.excitation.sizes()

    def gaps(self, t: float, y: Array, interval: Interval | None = None) -> tuple[Array, Array]:
        """Return d and v (m,) of a state, its first column; at a breakpoint of the excitation their limits after it."""
        interval = interval or self.excitation.interval_at(t)
        e, de, k, f = self.excitation.at(t, interval)
        y = y.reshape(self.size, -1)[: self.order, 0]
        d, v = self.D @ y - e, self.structure.free_rates(y, de, f)
        if len(self.structure.following):
            slip = np.zeros((2, len(self.sliders)), dtype=int)
            v = self._consistent_rates(self._lines_at(d, v, slip), d, v, self.excitation.phase(t, interval), k)
        return d, v

    def coordinates(self, t: float, Y: Array) -> Array:
        """Return (q, q') and the positions of sliders (2n + Q, columns) of states, the inverse of `states`."""
        Y = Y.reshape(self.size, -1)
        if not self.structure.massless:
            return Y
        interval = self.excitation.interval_at(t)
        d, v = self.gaps(t, Y, interval)
        slip = self.sliders.at(self.Omega * t, self.Omega, d, v, Y[self.order :, 0])
        dx = self._rates_and_forces(self._lines_at(d, v, slip), interval, t, Y)[0][: self.order]
        q = self.structure.coordinates(self.Omega * t, self.Omega, Y[: self.order], dx)
        return np.concatenate([q, Y[self.order :]])

    def columns_of(self, Y: Array) -> Array:
        """Return states (size columns, T) as an array (size, columns, T)."""
        return Y.reshape(self.size, -1, Y.shape[-1])

    def gaps_over(self, t: Array, Y: Array) -> tuple[Array, Array]:
        """Return d and v (m, T) of states (size, T) at instants t."""
        y = self.columns_of(Y)[: self.order, 0]
        if len(self.structure.following):
            pairs = [self.gaps(x, column) for x, column in zip(t.tolist(), Y.T, strict=True)]
            return np.array([d for d, _ in pairs]).T, np.array([v for _, v in pairs]).T
        e, de = self.excitation.over(t)
        return self.D @ y - e, self.structure.V @ y - de

    def _lines(self, segment: Integers, slip: Integers, contact: Integers, rigid: Integers) -> Lines:
        """Return the segments of the elements, and the states of sliders and contacts."""
        rows = np.arange(self.m)
        return self.slope[rows, segment], self.offset[rows, segment], slip, contact, rigid

    def _lines_at(self, d: Array, v: Array, slip: Integers) -> Lines:
        """Return the segments and the states of contacts at displacements and rates (m,); no element sticks rigidly."""
        return self._lines(
            segment_at(self.high, d, v), slip, self.contacts.at(d, v), np.zeros(len(self.rigid), dtype=int)
        )

    def rates(self, line: Lines, interval: Interval, t: float, Y: Array) -> Array:
        """Return y', or (y', Phi') flattened, with each element on its linear segment."""
        return self._rates_and_forces(line, interval, t, Y)[0].ravel()

    def _rates_and_forces(self, line: Lines, interval: Interval, t: float, Y: Array) -> tuple[Array, Array]:
        """Return y' or (y', Phi'), and the forces (R, columns) of sticking elements and their derivatives."""
        n, N, elements = self.n, self.order, self.sliders.element
        e, de, k, f = self.excitation.at(t, interval)
        Y = Y.reshape(self.size, -1)
        Y, z = Y[:N], Y[N:]
        d, tau = self.D @ Y[:, 0] - e, self.excitation.phase(t, interval)
        v = self._consistent_rates(line, d, self.structure.free_rates(Y[:, 0], de, f), tau, k)
        p, kd, kv = self._forces(line, d, v, tau, k)
        out = np.zeros((self.size, Y.shape[1]))
        out[:N] = self.A @ Y
        out[n:N, 0] += f
        if len(elements):
            slip, zone = line[2]
            limit, change, gain = self.sliders.limit(zone, self.Omega * t, self.Omega, d, v)
            friction, stick_stiffness = self.sliders.forces(line[2], d, z[:, 0], limit)
            np.add.at(p, elements, friction)
            np.add.at(kd, elements, stick_stiffness)
            slips = np.flatnonzero(slip)
            out[N + slips, 0] = (v[elements] - slip * change / self.sliders.k)[slips]
        out[:N, 0] -= self.B @ (p - self.c * de)
        if Y.shape[1] > 1:
            u = self.D @ Y[:, 1:]
            rate = self.structure.variations(u, self.structure.V @ Y[:, 1:], kd, kv)
            out[:N, 1:] -= self.B @ (kd[:, None] * u + kv[:, None] * rate)
            for rows, kd, kv in self._coupling(d, v, tau):
                out[:N, 1:] -= self.B[:, rows] @ (kd @ u[rows] + kv @ rate[rows])
            if len(elements):
                factors, normal = (slip * gain)[:, None], self.sliders.normal
                out[:N, 1:] += self.B[:, elements] @ (stick_stiffness[:, None] * z[:, 1:] - factors * u[normal])
                out[N + slips, 1:] = (rate[elements] - factors / self.sliders.k[:, None] * rate[normal])[slips]
        return out, self.rigid.hold(line[4], out[n : 2 * n])

    def slopes(self, line: Lines, interval: Interval, t: float, y: Array) -> Array:
        """Return df/dy (order, order) for implicit methods."""
        d, v = self.gaps(t, y, interval)
        tau = self.excitation.phase(t, interval)
        _, kd, kv = self._forces(line, d, v, tau, self.excitation.at(t, interval)[2])
        V = self.structure.variations(self.D, self.structure.V, kd, kv)
        J = self.A - (self.B * kd) @ self.D - (self.B * kv) @ V
        for rows, kd, kv in self._coupling(d, v, tau):
            J -= self.B[:, rows] @ (kd @ self.D[rows] + kv @ V[rows])
        return J

    def _consistent_rates(self, line: Lines, d: Array, v: Array, tau: float, k: Array) -> Array:
        """Return the rates of the elements with the forces on coordinates without mass, on their linear segments."""
        rows = self.structure.following
        if not len(rows):
            return v

        def forces(v: Array) -> tuple[Array, Array]:
            p, _, kv = self._forces(line, d, v, tau, k)
            return p[rows], kv[rows]

        return self.structure.consistent_rates(v, forces)

    def _forces(self, line: Lines, d: Array, v: Array, tau: float, k: Array) -> tuple[Array, Array, Array]:
        """Return p, dp/dd and dp/dv (m,)."""
        slope, offset, _, contact, rigid = line
        kd = k * slope
        p, kv = kd * d + k * offset, np.zeros(self.m)
        for j in self._curved:
            p[j], kd[j], kv[j] = (x[0] for x in self.laws[j].force(d[j : j + 1], v[j : j + 1], np.array([tau])))
        self.contacts.add_forces(contact, d, v, p, kd, kv)
        self.rigid.fill_forces(rigid, p)
        for rows, law in self.vectors:
            p[rows] += law.force(d[rows, None], v[rows, None], np.array([tau]))[0][:, 0]
        return p, kd, kv

    def _coupling(self, d: Array, v: Array, tau: float) -> list[tuple[Integers, Array, Array]]:
        """Return the elements (p,), dp/dd and dp/dv (p, p) of vector laws."""
        forces = [law.force(d[rows, None], v[rows, None], np.array([tau])) for rows, law in self.vectors]
        return [(rows, kd[..., 0], kv[..., 0]) for (rows, _), (_, kd, kv) in zip(self.vectors, forces, strict=True)]

    def integrate(
        self, t: float, Y: Array, end: float, method: str, tolerance: float, visit: Visit | None = None
    ) -> tuple[Array, list[float], int]:
        """Integrate from a state at t to the end.

        Parameters
        ----------
        t : float
            Instant of the start.
        Y : array_like
            State at the start.
        end : float
            Instant of the end.
        method : {"DOP853", "RK45", "Radau"}
            Method of SciPy.
        tolerance : float
            Error per step, relative to the size of the motion.
        visit : callable, optional
            Called as ``visit(t0, t1, dense)`` with every step, where ``dense(t)`` returns states (size, len(t)).

        Returns
        -------
        Y : ndarray
            State at the end, flattened.
        instants : list of float
            Instants at which breakpoints were passed.
        steps : int
            Number of steps.

        Raises
        ------
        ArithmeticError
            If the motion diverges, or steps become too short.
        """
        Y, instants, count = np.asarray(Y, dtype=float).ravel(), [], 0
        solution, rounding = Method(method, tolerance, tolerance * _sizes(self, Y)), 1e-14 * abs(end)
        with np.errstate(over="ignore", invalid="ignore"):
            while end - t > rounding:  # from one breakpoint of the excitation to the next
                interval = self.excitation.interval_at(t)
                stop = interval.end if end - interval.end > rounding else end
                Y, new_instants, steps = self._integrate_between(interval, t, Y, stop, solution, visit)
                t, count = stop, count + steps
                instants += new_instants
        return Y, instants, count

    def _integrate_between(
        self, interval: Interval, t: float, Y: Array, end: float, method: Method, visit: Visit | None
    ) -> tuple[Array, list[float], int]:
        """Integrate an interval without breakpoints of the excitation."""
        d, v = self.gaps(t, Y, interval)
        segment, instants, count = segment_at(self.high, d, v), [], 0
        slip = self.sliders.at(self.Omega * t, self.Omega, d, v, Y.reshape(self.size, -1)[self.order :, 0])
        contact = self.contacts.at(d, v)

        def lines(rigid: Integers) -> Lines:
            return self._lines(segment, slip, contact, rigid)

        def rates(rigid: Integers, t: float, Y: Array) -> tuple[Array, Array]:
            return self._rates_and_forces(lines(rigid), interval, t, Y)

        rigid = self.rigid.at(rates, t, Y, v, float(max(np.abs(v).max(), self.Omega * np.abs(d).max())))
        Y = self.rigid.without_slip(self, Y, rigid)
        while end - t > 1e-14 * abs(end):
            line = lines(rigid)
            f = partial(self.rates, line, interval)
            analytic = method.name == "Radau" and self.columns == 1 and not len(self.sliders) and not len(self.rigid)
            options = {"jac": partial(self.slopes, line, interval)} if analytic else {}
            solver = method.start(f, t, Y, end, options)
            while solver.status == "running":
                before = solver.y
                solver.step()
                count += 1
                if solver.status == "failed":
                    raise ArithmeticError(
                        f"{method.name} could not continue at t = {solver.t:.6g}: the motion diverges, or Omega = "
                        f"{self.Omega:.6g} or tolerance = {method.tolerance:g} is too small"
                    )
                exits, side = self._exit(solver, before, segment, interval)
                change, zone_exits, zone_changes = self.sliders.exits(self, solver, slip)
                ends = self.contacts.exits(self, solver, contact)
                sticks = self.rigid.exits(self, rates, solver, rigid)
                events = np.concatenate([change, zone_exits, ends, sticks])
                stop = float(min(exits.min(), events.min(initial=np.inf)))
                if visit:
                    visit(solver.t_old, min(stop, solver.t), solver.dense_output())
                if not np.isfinite(stop):
                    t, Y = solver.t, solver.y
                    continue
                Y = _repeat_step(method, f, solver.t_old, before, stop, options)
                t = stop
                limit = stop + 1e-12 * (1 / self.Omega + abs(stop))
                segment += np.where(exits <= limit, side, 0)
                if (np.minimum(change, zone_exits) <= limit).any():
                    passed_zones = np.where(zone_exits <= limit, zone_changes, 0)
                    Y, slip = self.sliders.after(self, t, Y, slip, change <= limit, passed_zones)
                if (ends <= limit).any():
                    Y, contact = self.contacts.after(self, t, Y, contact, ends <= limit)
                if (sticks <= limit).any():
                    Y, rigid = self.rigid.after(self, rates, t, Y, rigid, sticks <= limit)
                instants.append(t)
                break
        return Y, instants, count

    def _exit(self, solver: Any, before: Array, segment: Integers, interval: Interval) -> tuple[Array, Integers]:
        """Return the instants in the last step at which elements leave their segments (inf if not), and the ends."""
        elements = np.arange(self.m)
        low, high = self.low[elements, segment], self.high[elements, segment]
        (d0, v0), (d1, v1) = self.gaps(solver.t_old, before, interval), self.gaps(solver.t, solver.y, interval)
        max_change = 2 * (solver.t - solver.t_old) * np.maximum(np.abs(v0), np.abs(v1))
        if np.all((np.maximum(d0, d1) + max_change < high) & (np.minimum(d0, d1) - max_change > low)):
            return np.full(self.m, np.inf), np.zeros(self.m, dtype=int)
        dense, t = solver.dense_output(), np.linspace(solver.t_old, solver.t, SAMPLES_PER_STEP + 1)
        size = displacement_scales(self, dense(t[[0, -1]]))
        d, v = (x / size[:, None] for x in self.gaps_over(t, dense(t)))

        def value(rows: Integers, t: Array) -> Array:
            return np.array([self.gaps(x, dense(x), interval)[0][j] / size[j] for j, x in zip(rows, t, strict=True)])

        return first_exit(t, d, v, low / size, high / size, value)


def _sizes(flow: Flow, Y: Array) -> Array:
    """Return the scale of errors of each component: the largest of q and the displacements e.

    At rest it is the displacement by the loads within 1 / rate, the shortest time scale of the structure and the loads.
    """
    y, n = Y.reshape(flow.size, -1)[: flow.order, 0], flow.n
    velocity = float(np.abs(y[n : 2 * n]).max(initial=0.0))
    length = max(float(np.abs(np.delete(y, slice(n, 2 * n))).max()), float(flow.displacements.max(initial=0.0)))
    if not length:
        rate = flow.Omega + float(np.abs(np.linalg.eigvals(flow.A)).max())
        length = max(velocity / rate, flow.load / rate**2) or 1.0
    size = np.full(flow.size, length)
    size[n : 2 * n] = max(velocity, flow.Omega * length)
    return np.column_stack([size, *np.outer(size, 1 / size).T[: flow.columns - 1]]).ravel()


def _repeat_step(method: Method, f: Any, t: float, Y: Array, end: float, options: dict[str, Any]) -> Array:
    """Return the state at a breakpoint by a repeated step, which is more accurate than the dense output."""
    if end - t <= 1e-14 * abs(end):
        return Y
    solver = method.start(f, t, Y, end, {**options, "first_step": end - t})
    while solver.status == "running":
        solver.step()
    return solver.y
