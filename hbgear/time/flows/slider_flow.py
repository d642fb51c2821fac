"""Friction sliders in time integration: their positions, and the instants at which they slip or stick.

    stick:  f = k (d - z),  z' = 0                  until |d - z| = limit / k
    slip:   f = +-limit,    z' = d' -+ limit' / k   until z' changes its sign
    open:   f = 0,          z' = d'                 while the contact of the normal force is open

The limit is that of `FrictionLimit`, in each of its zones linear in the displacement d_n of an element. The positions z
of the sliders follow the states of the structure. Their disturbances are states of the variational equation. Where a
slider begins to slip they jump, to those of its bound d -+ limit / k, because z' jumps there, and where it begins to
stick as d_n leaves a zone, because a disturbance moves this instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.slider import friction_limits
from hbgear.mechanics.structures.elements import Element
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers, first_exit, segment_at
from hbgear.time.flows.structure_states import displacement_scales

_ON_LIMIT = 1e-9
"""Distance from the friction limit, relative to limit / k [-], within which a state that moves outwards slips."""

SLIP, ZONE = 0, 1
"""Rows of the state of sliders: the direction of slip (0 while sticking), and the zone of the limit."""


class SliderFlow:
    """Friction sliders of the elements of a system.

    Parameters
    ----------
    elements : sequence of Element
        Elements of the system.

    Attributes
    ----------
    element : ndarray, shape (Q,)
        Element of each slider.
    normal : ndarray, shape (Q,)
        Element of the normal force of each slider; -1 without one.
    k, residual : ndarray, shape (Q,)
        Stiffness and residual position of each slider.
    level, gain, base : ndarray, shapes (Q, B), (Q, B + 1) and (Q, B + 1)
        Zones of the limits, see `FrictionLimit`; levels are padded with inf.
    """

    def __init__(self, elements: Sequence[Element]) -> None:
        limits = friction_limits(elements)
        self.element = np.array([j for j, *_ in limits], dtype=int)
        self.normal = np.array([limit.normal for *_, limit in limits], dtype=int)
        self.k, self.residual = np.array([(slider.k, slider.residual) for _, slider, _ in limits]).reshape(-1, 2).T
        self._waves = [(i, limit.wave) for i, (*_, limit) in enumerate(limits) if limit.wave.varies]
        B = max([0, *(len(limit.level) for *_, limit in limits)])
        self.level, self.gain, self.base = np.full((len(limits), B), np.inf), *np.zeros((2, len(limits), B + 1))
        for i, (*_, limit) in enumerate(limits):
            self.level[i, : len(limit.level)] = limit.level
            self.gain[i, : len(limit.gain)], self.base[i, : len(limit.base)] = limit.gain, limit.base
        self._indices = np.arange(len(limits))

    def __len__(self) -> int:
        return len(self.element)

    def zones(self, d: Array, v: Array) -> Integers:
        """Return the zones (Q,) of the limits at displacements and rates (m,); on a level the rate decides."""
        return np.where(self.normal >= 0, segment_at(self.level, d[self.normal], v[self.normal]), 0)

    def limit(self, zone: Integers, tau: Any, Omega: float, d: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return the limits and their rates (Q, ...) at displacements and rates (m, ...), and their gains (Q,).

        In a trial step the limit of a contact that opens continues with negative values.
        """
        gain, base = self.gain[self._indices, zone], self.base[self._indices, zone]
        columns = (slice(None), *[None] * (d.ndim - 1))
        value = base[columns] + gain[columns] * d[self.normal]
        rate = gain[columns] * v[self.normal]
        for i, wave in self._waves:
            value[i] += wave(tau)
            rate[i] += Omega * wave(tau, 1)
        return value, rate, gain

    def is_open(self, zone: Integers) -> np.ndarray:
        """Return whether the limits (Q,) are zero, because contacts are open."""
        return (self.gain[self._indices, zone] == 0) & (self.base[self._indices, zone] == 0)

    def positions(self, tau: float, d: Array, z: Array | None = None) -> Array:
        """Return positions (Q,) within the friction limits at displacements d (m,), by default the residual ones."""
        max_elastic = self.limit(self.zones(d, 0 * d), tau, 0.0, d, 0 * d)[0] / self.k
        d = d[self.element]
        return np.clip(self.residual if z is None else z, d - max_elastic, d + max_elastic)

    def at(self, tau: float, Omega: float, d: Array, v: Array, z: Array, zone: Integers | None = None) -> Integers:
        """Return the state (2, Q) of each slider at displacements and rates (m,), see `SLIP` and `ZONE`.

        The slider of an open contact slips in the direction +1 with the limit zero. Zones are by default those of d.
        """
        zone = self.zones(d, v) if zone is None else zone
        limit, rate, _ = self.limit(zone, tau, Omega, d, v)
        elastic, max_elastic, v = d[self.element] - z, limit / self.k, v[self.element]
        size = _ON_LIMIT * np.maximum(max_elastic, np.abs(d[self.element]))
        outwards = np.where(max_elastic > size, np.sign(elastic), np.sign(v))  # a contact that closes has no stretch
        slips = (np.abs(elastic) >= max_elastic - size) & (outwards * v > rate / self.k)
        slip = np.where(self.is_open(zone), 1.0, np.where(slips, outwards, 0.0))
        return np.array([slip, zone]).astype(int)

    def forces(self, state: Integers, d: Array, z: Array, limit: Array) -> tuple[Array, Array]:
        """Return the forces and stiffnesses (Q,) of sliders, of which some slip."""
        slip = state[SLIP]
        k = np.where(slip == 0, self.k, 0.0)
        return np.where(slip == 0, k * (d[self.element] - z), slip * limit), k

    def exits(self, flow: Any, solver: Any, state: Integers) -> tuple[Array, Array, Integers]:
        """Return instants (Q,) in the last step, inf if there are none.

        The first ones are those at which sliders begin to slip or stick, the second ones those at which limits leave
        their zones; the last array has the changes of the zones, -1 or +1.
        """
        never, no_changes = np.full(len(self), np.inf), np.zeros(len(self), dtype=int)
        if not len(self):
            return never, never, no_changes
        dense = solver.dense_output()
        t, (slip, zone) = np.linspace(solver.t_old, solver.t, SAMPLES_PER_STEP + 1), state
        opened, sticks = self.is_open(zone)[:, None], (slip == 0)[:, None]

        def tests(instants: Array) -> tuple[Array, Array]:
            """Return functions (Q, T), not positive while sticking and not negative while slipping, and d_n."""
            Y = dense(instants)
            d, v = flow.gaps_over(instants, Y)
            z = flow.columns_of(Y)[flow.order :, 0]
            limit, rate, _ = self.limit(zone, flow.Omega * instants, flow.Omega, d, v)
            excess = np.abs(d[self.element] - z) * self.k[:, None] - limit
            sliding = slip[:, None] * v[self.element] - rate / self.k[:, None]
            return np.where(sticks, excess, np.where(opened, 1.0, sliding)), d[self.normal]

        def first(index: int, low: Array, high: Array) -> tuple[Array, Integers]:
            def value(rows: Integers, instants: Array) -> Array:
                values = (tests(np.array([x]))[index][i, 0] for i, x in zip(rows, instants, strict=True))
                return np.array(list(values)) / sizes[index][rows]

            scaled = samples[index] / sizes[index][:, None]
            return first_exit(t, scaled, np.gradient(scaled, t, axis=1), low, high, value)

        samples = tests(t)
        size = np.abs(samples[0]).max(axis=1)
        sizes = np.where(size > 0, size, 1.0), displacement_scales(flow, dense(t[[0, -1]]))[self.normal]
        change = first(0, np.where(slip == 0, -np.inf, 0.0), np.where(slip == 0, 0.0, np.inf))[0]
        if (self.normal < 0).all():
            return change, never, no_changes
        edges = np.pad(self.level, ((0, 0), (1, 1)), constant_values=((0, 0), (-np.inf, np.inf)))
        low, high = edges[self._indices, zone], edges[self._indices, zone + 1]
        low, high = np.where(self.normal < 0, -np.inf, low), np.where(self.normal < 0, np.inf, high)
        return change, *first(1, low / sizes[1], high / sizes[1])

    def after(
        self, flow: Any, t: float, Y: Array, state: Integers, changed: np.ndarray, zone_changes: Integers
    ) -> tuple[Array, Integers]:
        """Return the states of the motion and of the sliders after an event at t.

        ``changed`` are the sliders that begin to slip or stick, ``zone_changes`` (Q,) the changes of zones of limits.
        """
        Y, N = flow.columns_of(Y[:, None])[..., 0].copy(), flow.order
        d, v = flow.gaps(t, Y.ravel())
        limit, _, gain = self.limit(state[ZONE], flow.Omega * t, flow.Omega, d, v)
        u, state, left = flow.D @ Y[:N, 1:], state.copy(), zone_changes != 0
        for i in np.flatnonzero(changed & ~left).tolist():
            j, before = self.element[i], state[SLIP, i]
            side = int(before) or int(np.sign(d[j] - Y[N + i, 0]))
            state[SLIP, i] = 0 if before else side
            Y[N + i, 0] = d[j] - side * limit[i] / self.k[i]
            Y[N + i, 1:] = u[j] - side * gain[i] / self.k[i] * u[self.normal[i]]
        if left.any():
            new_state = self.at(flow.Omega * t, flow.Omega, d, v, Y[N:, 0], state[ZONE] + zone_changes)
            for i in np.flatnonzero(left).tolist():
                j, normal = self.element[i], self.normal[i]
                if state[SLIP, i] and v[normal]:
                    Y[N + i, 1:] = u[j] - v[j] / v[normal] * u[normal]
                state[:, i] = new_state[:, i]
        return Y.ravel(), state


def complete_state(flow: Any, t: float, y: Array) -> Array:
    """Return a state (2n,) or (2n + Q,) of a `Flow` at an instant with the positions of its Q friction sliders.

    Without positions they are the residual ones, within the friction limits. ValueError is raised for another shape.
    """
    n, Q = 2 * flow.structure.n, len(flow.sliders)
    if y.shape not in ((n,), (n + Q,)):
        hint = f", or ({n + Q},) with the positions of the sliders" if Q else ""
        raise ValueError(
            f"a state of shape {y.shape} does not fit {n // 2} coordinates; give an array of shape ({n},){hint}"
        )
    if not Q:
        return y
    d, _ = flow.gaps(t, flow.states(np.append(y[:n], np.zeros(Q))))
    return np.append(y[:n], flow.sliders.positions(flow.Omega * t, d, y[n:] if len(y) > n else None))
