"""Rigid friction in time integration: a sticking element is a constraint, and its force the Lagrange multiplier.

    slips  p = side kinetic,   side (v - speed) > 0    until v = speed
    sticks v = speed,  p = (W^T M^-1 W)^-1 W^T a       until |p| = static;   W, a: directions, accelerations without p

At an event the vector field jumps from f to f*. A disturbance dy moves the instant of an event h(t, y) = 0 by
-(grad h dy) / h', h' = dh/dt along the motion, and becomes dy + (f* - f) (grad h dy) / h'.

References
----------
Leine & Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems (2004),
https://doi.org/10.1007/978-3-540-44398-8.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.friction import RigidFriction
from hbgear.mechanics.structures.elements import Element
from hbgear.time.exponential.segments import Integers
from hbgear.time.flows.step_exits import exits_in_step

STICKS = 0
"""State of an element that sticks; one that slips has the sign of its relative velocity, -1 or +1."""

_ON_LIMIT = 1e-9
"""Relative velocity, over the velocities of the motion, and excess of the static limit, relative to it, that count as
zero [-]."""

_RATE_STEP = 1e-5
"""Step of the difference that estimates the rate of a holding force, over 1 / Omega [-]."""

Rates = Callable[[Integers, float, Array], tuple[Array, Array]]
"""Rates (size, columns) of a motion and holding forces (R, columns), at states of the elements, t and Y."""


class StickFlow:
    """Elements of a system with rigid friction.

    Parameters
    ----------
    elements : sequence of Element
        Elements of the system.
    W : ndarray, shape (n, m)
        Directions of all elements.
    accelerations : ndarray, shape (n, m)
        Accelerations by unit forces of all elements, M^-1 W.

    Attributes
    ----------
    element : ndarray, shape (R,)
        Elements with rigid friction.
    static, kinetic, speed : ndarray, shape (R,)
        Numbers of their laws.

    Raises
    ------
    ValueError
        If such an element has a prescribed displacement or other laws, or their directions are linearly dependent.
    """

    def __init__(self, elements: Sequence[Element], W: Array, accelerations: Array) -> None:
        self.element = np.array([j for j, e in enumerate(elements) if isinstance(e.law, RigidFriction)], dtype=int)
        for element in elements:
            frictions = [part for part in element.law.parts if isinstance(part, RigidFriction)]
            if frictions and (element.law is not frictions[0] or element.displacement.bound):
                raise ValueError(
                    f"element '{element.name}' has rigid friction and a prescribed displacement or other laws; give "
                    "the friction an element of its own with the same direction and no displacement"
                )
        laws: list[Any] = [elements[j].law for j in self.element]
        numbers = np.array([(law.static, law.kinetic, law.speed) for law in laws], dtype=float).reshape(-1, 3)
        self.static, self.kinetic, self.speed = numbers.T
        self._W, self._accelerations = W[:, self.element], accelerations[:, self.element]
        if len(self) > 1 and np.linalg.matrix_rank(self._W) < len(self):
            names = ", ".join(f"'{elements[j].name}'" for j in self.element)
            raise ValueError(
                f"the directions of the elements {names} with rigid friction are linearly dependent, so that their "
                "forces while they stick are not determined; combine elements of one direction into one"
            )

    def __len__(self) -> int:
        return len(self.element)

    def fill_forces(self, state: Integers, p: Array) -> None:
        """Set the forces in p (m,) of the elements that slip; zero for those that stick."""
        if len(self):
            p[self.element] = state * self.kinetic

    def hold(self, state: Integers, accelerations: Array) -> Array:
        """Hold the elements that stick: subtract the accelerations by their forces in place, return the forces.

        accelerations : without these forces, shape (n, columns); the forces have the shape (R, columns).
        """
        forces = np.zeros((len(self), accelerations.shape[1]))
        if len(self) and len(sticks := np.flatnonzero(state == STICKS)):
            W, unit = self._W[:, sticks], self._accelerations[:, sticks]
            forces[sticks] = np.linalg.solve(W.T @ unit, W.T @ accelerations)
            accelerations -= unit @ forces[sticks]
        return forces

    def at(self, rates: Rates, t: float, Y: Array, v: Array, size: float) -> Integers:
        """Return the state (R,) of each element at rates v (m,) of all elements, for velocities of this size."""
        if not len(self):
            return np.zeros(0, dtype=int)
        slide, scale = v[self.element] - self.speed, np.maximum(np.abs(self.speed), size)
        state: Integers = np.where(np.abs(slide) <= _ON_LIMIT * scale, STICKS, np.sign(slide)).astype(int)
        return self._released(rates, t, Y, state)

    def without_slip(self, flow: Any, Y: Array, state: Integers) -> Array:
        """Return a state whose disturbances do not slip where elements stick: friction stops a small slip at once."""
        if not len(self) or flow.columns == 1:
            return Y
        columns = Y.reshape(flow.size, -1).copy()
        self.hold(state, columns[flow.n : 2 * flow.n, 1:])
        return columns.ravel()

    def _released(self, rates: Rates, t: float, Y: Array, state: Integers) -> Integers:
        """Return the state after elements whose holding force exceeds the static limit are released, one by one."""
        state = state.copy()
        while True:
            force = rates(state, t, Y)[1][:, 0]
            ratio = np.abs(force) / self.static
            i = int(np.argmax(ratio))
            if ratio[i] <= 1 + _ON_LIMIT:
                return state
            state[i] = int(np.sign(force[i]))

    def exits(self, flow: Any, rates: Rates, solver: Any, state: Integers) -> Array:
        """Return the instants (R,) in the last step at which elements stick or are released, inf if there are none."""
        if not len(self):
            return np.full(0, np.inf)
        dense, sticks, slip_direction = solver.dense_output(), (state == STICKS)[:, None], state[:, None]

        def tests(instants: Array) -> Array:
            """Return holding forces while sticking, and relative speeds while slipping (R, T)."""
            Y = dense(instants)
            values = slip_direction * (flow.gaps_over(instants, Y)[1][self.element] - self.speed[:, None])
            if sticks.any():
                forces = np.array([rates(state, x, y)[1][:, 0] for x, y in zip(instants, Y.T, strict=True)]).T
                values = np.where(sticks, forces, values)
            return values

        low, high = np.where(sticks[:, 0], -self.static, 0.0), np.where(sticks[:, 0], self.static, np.inf)
        return exits_in_step(solver, tests, low, high)

    def after(
        self, flow: Any, rates: Rates, t: float, Y: Array, state: Integers, changed: np.ndarray
    ) -> tuple[Array, Integers]:
        """Return the state of the motion and of the elements after an event at t of the elements ``changed``."""
        Y, n, state = flow.columns_of(Y[:, None])[..., 0].copy(), flow.n, state.copy()
        for i in np.flatnonzero(changed).tolist():
            dY, forces = rates(state, t, Y)
            if state[i] == STICKS:
                h = _RATE_STEP / flow.Omega
                force_after, force_before = (rates(state, t + x, Y + x * dY)[1][i, 0] for x in (h, -h))
                change, disturbance = (force_after - force_before) / (2 * h), forces[i, 1:]
                state[i] = int(np.sign(forces[i, 0]))
            else:
                change = float(self._W[:, i] @ dY[n : 2 * n, 0])
                disturbance = self._W[:, i] @ Y[n : 2 * n, 1:]
                state[i] = STICKS
            state = self._released(rates, t, Y, state)
            if Y.shape[1] > 1 and change:
                # disturbances shift the instant of the event, between rates that differ (saltation)
                jump = rates(state, t, Y)[0][:, 0] - dY[:, 0]
                Y[:, 1:] += np.outer(jump, disturbance / change)
        return Y.ravel(), state
