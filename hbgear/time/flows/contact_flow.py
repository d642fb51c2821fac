"""Contacts with dampers in time integration: the instants at which they begin and end, and the jumps of the force.

    free    delta < 0                       until delta = 0; the force jumps to c delta'
    pushes  p = side (k delta + c delta')   until delta = 0, or p = 0 if the force is clipped
    open    delta > 0, p = 0 (clipped)      until delta = 0, or k delta + c delta' > 0

A disturbance moves the instant of a jump by -d(delta) / delta', which changes the impulse by c times the disturbance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.structures.elements import Element
from hbgear.time.exponential.segments import Integers
from hbgear.time.flows.step_exits import exits_in_step
from hbgear.time.flows.structure_states import displacement_scales

FREE, PUSHES, OPEN = 0, 1, 2
"""States of a contact."""

_ON_CONTACT = 1e-12
"""Penetration, relative to displacement and gap, up to which the velocity decides whether a contact begins."""


class ContactFlow:
    """Contacts with dampers of the elements of a system.

    Parameters
    ----------
    elements : sequence of Element
        Elements of the system.

    Attributes
    ----------
    element : ndarray, shape (Q,)
        Element of each contact.
    side, gap, k, c : ndarray, shape (Q,)
        Numbers of the contacts, see `DampedContact`.
    clipped : ndarray of bool, shape (Q,)
        Whether tensile forces are zero.
    """

    def __init__(self, elements: Sequence[Element]) -> None:
        contacts = [(j, c) for j, element in enumerate(elements) for c in element.law.damped]
        self.element = np.array([j for j, _ in contacts], dtype=int)
        numbers = np.array([(c.side, c.gap, c.k, c.c) for _, c in contacts], dtype=float).reshape(-1, 4)
        self.side, self.gap, self.k, self.c = numbers.T
        self.clipped = np.array([c.clipped for _, c in contacts], dtype=bool)

    def __len__(self) -> int:
        return len(self.element)

    def _state(self, d: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return delta, delta' and k delta + c delta' (Q, ...) at displacements and rates (m, ...)."""
        columns = (slice(None), *[None] * (d.ndim - 1))
        side = self.side[columns]
        depth, rate = side * d[self.element] - self.gap[columns], side * v[self.element]
        return depth, rate, self.k[columns] * depth + self.c[columns] * rate

    def at(self, d: Array, v: Array) -> Integers:
        """Return the state (Q,) of each contact at displacements and rates (m,)."""
        depth, rate, force = self._state(d, v)
        tolerance = _ON_CONTACT * (np.abs(d[self.element]) + np.abs(self.gap))
        inside = (depth > tolerance) | ((np.abs(depth) <= tolerance) & (rate > 0))
        return np.where(~inside, FREE, np.where(self.clipped & (force <= 0), OPEN, PUSHES))

    def add_forces(self, state: Integers, d: Array, v: Array, p: Array, kd: Array, kv: Array) -> None:
        """Add forces and slopes to p, dp/dd and dp/dv (m,)."""
        if len(self):
            closed = state == PUSHES
            np.add.at(p, self.element, np.where(closed, self.side * self._state(d, v)[2], 0.0))
            np.add.at(kd, self.element, self.k * closed)
            np.add.at(kv, self.element, self.c * closed)

    def exits(self, flow: Any, solver: Any, state: Integers) -> Array:
        """Return the instants (Q,) in the last step at which contacts leave their states, inf if they do not."""
        if not len(self):
            return np.full(0, np.inf)
        dense = solver.dense_output()
        size = displacement_scales(flow, dense(np.array([solver.t_old, solver.t])))[self.element][:, None]

        def tests(instants: Array) -> Array:
            """Return functions (Q, T) that become positive where a contact leaves its state."""
            depth, _, force = self._state(*flow.gaps_over(instants, dense(instants)))
            depth, force = depth / size, force / (self.k[:, None] * size)
            exit_value = np.where(self.clipped[:, None], -force, -depth)
            column = state[:, None]
            return np.select([column == FREE, column == PUSHES], [depth, exit_value], np.maximum(-depth, force))

        return exits_in_step(solver, tests, np.full(len(self), -np.inf), np.zeros(len(self)))

    def after(self, flow: Any, t: float, Y: Array, state: Integers, changed: np.ndarray) -> tuple[Array, Integers]:
        """Return the state of the motion and of the contacts after an event at t of the contacts ``changed``."""
        Y, N = flow.columns_of(Y[:, None])[..., 0].copy(), flow.order
        depth, _, force = self._state(*flow.gaps(t, Y.ravel()))
        state = state.copy()
        for i in np.flatnonzero(changed).tolist():
            j, before = self.element[i], state[i]
            if before == FREE:
                state[i] = PUSHES
            elif before == PUSHES:
                state[i] = OPEN if self.clipped[i] else FREE
            else:
                state[i] = PUSHES if abs(force[i]) < self.k[i] * abs(depth[i]) else FREE
            sign = (state[i] == PUSHES) * 1.0 - (before == PUSHES)
            if FREE in (before, state[i]) and sign and Y.shape[1] > 1:
                # the damper force jumps where the contact begins or ends with a velocity (saltation)
                Y[:N, 1:] -= sign * self.c[i] * np.outer(flow.B[:, j], flow.D[j] @ Y[:N, 1:])
        return Y.ravel(), state
