"""Friction sliders in time integration: their positions, and the instants at which they slip or stick.

    stick:  f = k (d - z),  z' = 0       until |d - z| = limit / k
    slip:   f = +-limit,    z' = d'      until d' changes its sign

The positions z of the sliders follow the state (q, q'). Their disturbances are states of the variational equation. Only
where a slider begins to slip they jump, to those of its displacement, because z' jumps there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.models import Element
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers, first_exit

_ON_LIMIT = 1e-9
"""Distance from the friction limit, relative to limit / k [-], within which a state that moves outwards slips."""


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
    k, limit, reach, residual : ndarray, shape (Q,)
        Stiffness, friction limit, limit / k and residual position of each slider.
    """

    def __init__(self, elements: Sequence[Element]) -> None:
        found = [(j, one) for j, element in enumerate(elements) for one in element.law.sliders]
        self.element = np.array([j for j, _ in found], dtype=int)
        numbers = np.array([(one.k, one.limit, one.reach, one.residual) for _, one in found]).reshape(-1, 4)
        self.k, self.limit, self.reach, self.residual = numbers.T

    def __len__(self) -> int:
        return len(self.element)

    def positions(self, d: Array, z: Array | None = None) -> Array:
        """Return positions (Q,) within the friction limits at displacements d (m,), by default the residual ones."""
        d = d[self.element]
        found: Array = np.clip(self.residual if z is None else z, d - self.reach, d + self.reach)
        return found

    def at(self, d: Array, v: Array, z: Array) -> Integers:
        """Return the direction in which each slider slips (Q,), 0 if it sticks, at displacements and rates (m,)."""
        stretch = (d[self.element] - z) / self.reach
        slips = (np.abs(stretch) >= 1 - _ON_LIMIT) & (v[self.element] * stretch > 0)
        return np.where(slips, np.sign(stretch), 0.0).astype(int)

    def forces(self, slip: Integers, d: Array, z: Array) -> tuple[Array, Array]:
        """Return the forces and stiffnesses (Q,) of sliders, of which some slip."""
        k = np.where(slip == 0, self.k, 0.0)
        return np.where(slip == 0, k * (d[self.element] - z), slip * self.limit), k

    def exits(self, flow: Any, solver: Any, slip: Integers) -> Array:
        """Return the instants (Q,) in the last step at which sliders begin to slip or stick, inf if they do not."""
        if not len(self):
            return np.full(0, np.inf)
        dense = solver.dense_output()
        t = np.linspace(solver.t_old, solver.t, SAMPLES_PER_STEP + 1)

        def tests(at: Array, rows: Integers) -> tuple[Array, Array]:
            """Return the stretch d - z of sticking and the velocity of slipping sliders (R, T), with their slopes."""
            Y = dense(at)
            d, v = (x[self.element[rows]] for x in flow.gaps_over(at, Y))
            z = flow.columns_of(Y)[2 * flow.n :, 0][rows]
            value = np.where(slip[rows, None] == 0, d - z, slip[rows, None] * v)
            if len(at) < 2:
                return value, v
            return value, np.where(slip[rows, None] == 0, v, np.gradient(value, at, axis=1))

        every = np.arange(len(self))
        low = np.where(slip == 0, -self.reach, 0.0)
        high = np.where(slip == 0, self.reach, np.inf)

        def value(rows: Integers, at: Array) -> Array:
            return np.array([tests(np.array([x]), np.array([i]))[0][0, 0] for i, x in zip(rows, at, strict=True)])

        return first_exit(t, *tests(t, every), low, high, value)[0]

    def after(self, flow: Any, t: float, Y: Array, slip: Integers, passed: np.ndarray) -> tuple[Array, Integers]:
        """Return the state and the directions of slip after an event at t of the sliders ``passed``."""
        Y, n = flow.columns_of(Y[:, None])[..., 0].copy(), flow.n
        d, _ = flow.gaps(t, Y.ravel())
        slip = slip.copy()
        for i in np.flatnonzero(passed).tolist():
            j = self.element[i]
            side = int(slip[i]) or int(np.sign(d[j] - Y[2 * n + i, 0]))
            slip[i] = 0 if slip[i] else side
            Y[2 * n + i, 0] = d[j] - side * self.reach[i]
            Y[2 * n + i, 1:] = flow.W[:, j] @ Y[:n, 1:]
        return Y.ravel(), slip


def complete_state(flow: Any, t: float, y: Array) -> Array:
    """Return a state of a `Flow` with the positions of its friction sliders.

    Parameters
    ----------
    flow : Flow
        Equations of motion.
    t : float
        Instant of the state.
    y : ndarray, shape (2n,) or (2n + Q,)
        State (q, q'), with or without positions; by default they are the residual ones, within the friction limits.

    Returns
    -------
    ndarray, shape (2n + Q,)
        State with positions.

    Raises
    ------
    ValueError
        If the state has another shape.
    """
    n, Q = 2 * flow.n, len(flow.sliders)
    if y.shape not in ((n,), (n + Q,)):
        more = f", or ({n + Q},) with the positions of the sliders" if Q else ""
        raise ValueError(
            f"a state of shape {y.shape} does not fit {flow.n} coordinates; give an array of shape ({n},){more}"
        )
    if not Q:
        return y
    d, _ = flow.gaps(t, np.append(y[:n], np.zeros(Q)))
    return np.append(y[:n], flow.sliders.positions(d, y[n:] if len(y) > n else None))
