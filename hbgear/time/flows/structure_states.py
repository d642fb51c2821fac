"""States of a structure in time integration.

    x' = A x + (0, F f) - B u,   q = S x + s,   u: forces of the elements, f: loads
    x = (q, q'), S x = q, s = 0   if every coordinate has a mass

Coordinates without mass are eliminated as for harmonic balance: x = (a, a', c) has one state for each of them with a
damper, and none for the static ones, which follow the others and the loads, s = G f. The rates of c follow the forces:

    D = W^T S,   d' = D x' = D A x + D (0, F f) - D B u
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.harmonic.structure.linear_structure import dense
from hbgear.harmonic.structure.massless import MATRIX_ROUNDING, mass_basis, state_equations
from hbgear.mechanics.laws.friction import RigidFriction
from hbgear.mechanics.laws.vector_laws import Component
from hbgear.mechanics.models import System
from hbgear.time.exponential.steady_part import load_harmonics

Forces = Callable[[Array], tuple[Array, Array]]
"""Forces p and slopes dp/dv of the elements that act on coordinates without mass, at rates (m,)."""

_MAX_ITERATIONS = 50
"""Newton iterations for the rates of coordinates without mass; a law of displacements needs none."""

_RATE_TOLERANCE = 1e-13
"""Change of these rates, relative to their size, with which the iteration ends."""


class StructureStates:
    """First-order equations of the structure of a system at one Omega.

    Parameters
    ----------
    system : System
        System without terms that depend on speed.
    Omega : float
        Excitation frequency.

    Attributes
    ----------
    n : int
        Number of coordinates of the model.
    inertial, order : int
        Number of motions with mass, and of states.
    A : ndarray, shape (order, order)
        Matrix of the states, with the dampers of the elements.
    B : ndarray, shape (order, m)
        Rates by forces of the elements.
    W : ndarray, shape (inertial, m)
        Directions of the elements in the motions with mass.
    D, V : ndarray, shape (m, order)
        Displacements of the elements, and their rates without forces.
    following : ndarray
        Elements whose rates follow the forces, because they act on coordinates without mass.

    Raises
    ------
    ValueError
        If coordinates without mass cannot be eliminated, or a law with memory or jumps of the force acts on them.
    """

    def __init__(self, system: System, Omega: float) -> None:
        self.n, self.massless = system.n, bool(system.massless)
        self._W = system.W
        self._c = np.array([e.damping for e in system.elements])
        damping = self._W * self._c
        if self.massless:
            self._eliminate(system, damping, Omega)
        else:
            self._invert(system, damping)
        self.V = self.D @ self.A
        self._through = self.D @ self.B
        rounding = MATRIX_ROUNDING * (np.abs(self.D) @ np.abs(self.B))
        coupled = self.massless & (np.abs(self._through) > rounding)
        self.following = np.flatnonzero(coupled.any(axis=0) | coupled.any(axis=1))
        self._through = self._through[np.ix_(self.following, self.following)]
        self._check(system)

    def _invert(self, system: System, damping: Array) -> None:
        """Store the equations of a system with a mass of every coordinate."""
        n, W = self.n, self._W
        if scipy.sparse.issparse(system.M):
            self.rates = scipy.sparse.linalg.splu(scipy.sparse.csc_array(system.M)).solve
            C, K = system.C + scipy.sparse.csr_array(damping @ W.T), scipy.sparse.csr_array(system.K)
            lower = scipy.sparse.hstack([-K, -C]).toarray()
        else:
            self.rates = np.linalg.inv(system.M).__matmul__
            lower = np.hstack([-dense(system.K), -dense(system.C) - damping @ W.T])
        self.inertial, self.order, self.W = n, 2 * n, W
        self.A = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), self.rates(lower)])
        self.B = np.vstack([np.zeros_like(W), self.rates(W)])
        self.D = np.hstack([W.T, np.zeros_like(W.T)])

    def _eliminate(self, system: System, damping: Array, Omega: float) -> None:
        """Store the equations without the coordinates that have no mass; a and c are motions of unit length."""
        M, C, K = dense(system.M), dense(system.C) + damping @ self._W.T, dense(system.K)
        basis = mass_basis(M)
        equations = state_equations(system, M, C, K, basis, basis)
        a, c, e = (np.linalg.norm(vectors, axis=0) for vectors in equations.bases)
        n, unit = len(a), np.concatenate([a, a, c])
        self.inertial, self.order = n, len(unit)
        self.A = equations.A * unit[:, None] / unit
        F = unit[n:, None] * equations.F
        self.rates = F.__matmul__
        self.B = np.vstack([np.zeros((n, self._W.shape[1])), F @ self._W])
        self._S = equations.S / unit
        self.D = self._W.T @ self._S
        self.D[:, n : 2 * n] = 0.0
        self.W = self.D[:, :n].T
        inverse = np.linalg.inv(np.hstack(equations.bases)) * np.concatenate([a, c, e])[:, None]
        self._own, self._relaxing = inverse[:n], inverse[n : n + len(c)]
        self._static = equations.G @ load_harmonics(system, Omega)

    def _check(self, system: System) -> None:
        """Raise an error if a law with memory or jumps of the force acts on coordinates without mass."""
        for j in self.following.tolist():
            element = system.elements[j]
            parts = element.law.parts
            if any(law.sliders or law.damped or isinstance(law, Component | RigidFriction) for law in parts):
                raise ValueError(
                    f"element '{element.name}' acts on coordinates without mass: friction, contacts with dampers and "
                    "vector laws need masses in time integration; give these coordinates small masses"
                )

    def states(self, y: Array) -> Array:
        """Return the state of (q, q'), followed by the positions of sliders; static coordinates are not used."""
        if not self.massless:
            return y
        q, v = y[: self.n], y[self.n : 2 * self.n]
        return np.concatenate([self._own @ q, self._own @ v, self._relaxing @ q, y[2 * self.n :]])

    def coordinates(self, phase: float, Omega: float, x: Array, dx: Array) -> Array:
        """Return (q, q'), with columns of their disturbances, of states x and rates dx (order, columns) at a phase."""
        out = np.concatenate([self._S @ x, self._S @ dx])
        order = np.arange(self._static.shape[1])
        waves = np.exp(1j * phase * order)
        out[:, 0] += np.concatenate([self._static @ waves, self._static @ (1j * Omega * order * waves)]).real
        return out

    def free_rates(self, x: Array, de: Array, f: Array) -> Array:
        """Return the rates of the elements (m,) without their forces, at rates e' and rates by loads f."""
        v = self.V @ x - de
        if len(self.following):
            v += self.D[:, self.inertial :] @ f + self.D @ (self.B @ (self._c * de))
        return v

    def consistent_rates(self, v: Array, forces: Forces) -> Array:
        """Return the rates (m,) of all elements with the forces of those that act on coordinates without mass.

        There must be such elements, see `following`. v (m,) are the rates without these forces, which ``forces``
        returns with their derivatives at rates v. ArithmeticError is raised if no rates are found.
        """
        rows, out = self.following, v.copy()
        for _ in range(_MAX_ITERATIONS):
            p, kv = forces(out)
            effect = self._through @ p
            residual = out[rows] - v[rows] + effect
            if not kv.any():  # laws of displacements
                out[rows] -= residual
                return out
            step = np.linalg.solve(np.eye(len(rows)) + self._through * kv, residual)
            out[rows] -= step
            if not np.abs(step).max() > _RATE_TOLERANCE * max(np.abs(v[rows]).max(), np.abs(effect).max()):
                return out
        raise ArithmeticError(
            "no rate of a coordinate without mass balances the forces: a law with negative damping acts on it"
        )

    def variations(self, u: Array, rate: Array, kd: Array, kv: Array) -> Array:
        """Return disturbances of the rates (m, columns) from disturbances of d and of the rates without forces."""
        rows = self.following
        if len(rows):
            rate = rate.copy()
            change = rate[rows] - self._through @ (kd[rows, None] * u[rows])
            rate[rows] = np.linalg.solve(np.eye(len(rows)) + self._through * kv[rows], change)
        return rate


def displacement_scales(flow: Any, states: Array) -> Array:
    """Return the sizes (m,) of the terms whose sums are the displacements in states (size, T), for their rounding."""
    y = np.abs(states.reshape(flow.size, -1, states.shape[-1])[: flow.order, 0]).max(axis=1)
    size = np.abs(flow.D) @ y + flow.displacements
    return np.where(size > 0, size, 1.0)
