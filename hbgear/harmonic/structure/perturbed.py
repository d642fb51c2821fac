"""First-order expansion of a structure in the parameters of its model, for derivatives in them.

    D(s) = K + s C + s^2 M,   E = D_near - D,   s = i w        D_near: perturbed parameters

    G_near = W_near^T D_near^-1 F_near  ~  L (F_near - E D^-1 F_near),   L = W_near^T D^-1

A central difference of this expansion has the same error O(h^2) as one of the exact receptances, and the rounding of
D^-1 cancels in it. D^-1 is computed from the modes of the unperturbed structure. If the loads act on a free motion, or
the eigenvectors are ill-conditioned, D^-1 is computed once by direct inversion. A further parameter value then needs
only products of small matrices and no decomposition.

If the structure has a free motion without load, D(0) is singular and the pseudo-inverse of the unperturbed structure is
used. The first-order changes of the free motion and of the loads on it cancel in G.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.lru_cache import LRUCache
from hbgear.harmonic.structure.eigenmodes import Modes
from hbgear.harmonic.structure.linear_structure import LinearStructure, UnbalancedLoadError, dense
from hbgear.mechanics.models import System

_MAX_EXPANDED_COORDINATES = 300
"""Number of coordinates up to which D^-1 at all harmonics is cached; it takes n^2 numbers per harmonic."""

_CACHED_FREQUENCY_LISTS = 4
"""Number of lists of frequencies whose inverses are cached."""

_MAX_MODAL_CONDITION = 1e5
"""Condition number of the eigenvectors up to which D^-1 is computed from modes."""

_FREE_WORK_TOLERANCE = 1e-8
"""Relative work of a constant load on a free motion that counts as zero: rounding or terms of second order."""


class Solutions(NamedTuple):
    """Left solutions L and dL/ds (P, m, n), right solutions Q and dQ/ds (n, 2, P, c)."""

    L: ComplexArray
    dL: ComplexArray
    Q: ComplexArray


class FirstOrderExpansion:
    """A structure with cached inverses of its dynamic stiffness, from which perturbed structures are computed.

    Parameters
    ----------
    structure : LinearStructure
        Structure for which an expansion is possible, see `is_possible`.
    """

    def __init__(self, structure: LinearStructure) -> None:
        self.structure = structure
        self._inverses: LRUCache[tuple[ComplexArray, ComplexArray]] = LRUCache(_CACHED_FREQUENCY_LISTS)
        self._solutions: LRUCache[Solutions] = LRUCache(_CACHED_FREQUENCY_LISTS)
        self._static: LRUCache[Array] = LRUCache(_CACHED_FREQUENCY_LISTS)

    @staticmethod
    def is_possible(structure: LinearStructure) -> bool:
        """Return whether a structure has modal receptances, independent elements and at most 300 coordinates."""
        return structure.accurate_modes and not structure.constrained and structure.n <= _MAX_EXPANDED_COORDINATES

    def of(self, system: System) -> LinearStructure:
        """Return the structure of a perturbed system, to first order if its size is the same, else exactly."""
        base = self.structure
        if (system.n, len(system.elements)) != (base.n, base.m) or system.speed or system.receptances:
            return LinearStructure(system)
        perturbed = PerturbedStructure(self, system)
        return perturbed if perturbed.differs else base

    def static(self, F: Array) -> Array:
        """Return K^-1 F (n,) of a constant load."""
        return self._static.get(F.tobytes(), lambda: self.structure.solve(0.0, F[:, None])[:, 0])

    def solutions(self, s: ComplexArray, W: Array, F: ComplexArray) -> Solutions:
        """Return L = W^T D^-1 and Q = D^-1 F of the unperturbed structure at s (P,); they are cached."""
        return self._solutions.get((s.tobytes(), W.tobytes(), F.tobytes()), lambda: self._solved(s, W, F))

    def _solved(self, s: ComplexArray, W: Array, F: ComplexArray) -> Solutions:
        """Compute `solutions` from modes, or by inversion if these are ill-conditioned or F acts on a free motion."""
        modes, free = self.structure.modes, self.structure.free_left.T
        assert modes is not None
        if modes.condition < _MAX_MODAL_CONDITION and np.all(
            np.abs(free @ F) <= _FREE_WORK_TOLERANCE * (np.abs(free) @ np.abs(F))
        ):
            pole_terms = 1.0 / (s[:, None] - modes.poles)
            output, input_ = W.T @ modes.right, modes.left @ F
            L, dL = ((output * part[:, None]) @ modes.left for part in (pole_terms, -np.square(pole_terms)))
            Q, dQ = (modes.right @ (part[..., None] * input_) for part in (pole_terms, -np.square(pole_terms)))
        else:
            inverse, slope = self._inverses.get(s.tobytes(), lambda: self._inverse(s))
            L, Q = W.T @ inverse, inverse @ F
            dL, dQ = -(L @ slope) @ inverse, -inverse @ (slope @ Q)
        return Solutions(L, dL, np.ascontiguousarray(np.stack([Q, dQ]).transpose(2, 0, 1, 3)))

    def _inverse(self, s: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return D^-1 and dD/ds (P, n, n)."""
        base, exponents = self.structure, s[:, None, None]
        out = np.empty((len(s), base.n, base.n), dtype=complex)
        moving = s != 0
        out[moving] = np.linalg.inv(base.K + exponents[moving] * base.C + exponents[moving] ** 2 * base.M)
        if not moving.all():
            out[~moving] = base.solve(0.0, np.eye(base.n))
        return out, base.C + 2 * exponents * base.M


class PerturbedStructure(LinearStructure):
    """A perturbed structure, whose receptances are first-order expansions.

    Parameters
    ----------
    expansion : FirstOrderExpansion
        Expansion about the unperturbed structure.
    system : System
        Perturbed system, with the same coordinates and elements.

    Attributes
    ----------
    differs : bool
        Whether any matrix differs from the unperturbed structure.
    """

    def __init__(self, expansion: FirstOrderExpansion, system: System) -> None:
        base = expansion.structure
        self._expansion, self.system, self.n, self.m = expansion, system, base.n, base.m
        self.independent, self.force_sums, self.compatibility = base.independent, base.force_sums, base.compatibility
        self.large = self.disturbed = False
        self.W, self.kr, self.c = system.W, base.kr, np.array([e.damping for e in system.elements])
        self.M, self._scale = dense(system.M), base._scale
        self.C = dense(system.C) + (self.W * self.c) @ self.W.T
        self.K = dense(system.K) + (self.W * self.kr) @ self.W.T
        changes = enumerate((self.K - base.K, self.C - base.C, self.M - base.M))
        self._changes = [(power, A) for power, A in changes if A.any()]
        self.differs = bool(self._changes) or any(map(np.any, (self.W - base.W, self.c - base.c)))

    def check_balance(self, system: System) -> None:
        """Raise an error if a constant load acts on a free motion r, r^T (F - E K^-1 F) != 0 to first order."""
        base = self._expansion.structure
        for load in system.loads if base.free_left.shape[1] else ():
            if load.constant is None:
                continue
            F = np.asarray(load.constant)
            net_load = F - (self.K - base.K) @ self._expansion.static(F)
            for r in base.free_left.T:
                if abs(r @ net_load) > _FREE_WORK_TOLERANCE * np.abs(r * F).sum():
                    raise UnbalancedLoadError(self._describe_unbalance(r, float(r @ net_load)))

    @property
    def accurate_modes(self) -> bool:
        return False

    @cached_property
    def modes(self) -> Modes:  # type: ignore[override]
        """Modes of the perturbed structure, exactly."""
        self.free = self._null(self.K)
        self.free_left = self.free if np.array_equal(self.K, self.K.T) else self._null(self.K.T)
        return self._decompose(0.0)

    def transfer(self, s: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        return self._first_order(s, self.W)

    def response(self, Omega: float, ratio: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        G, dG = self._first_order(1j * Omega * ratio, F)
        return G, dG * (1j * ratio)[:, None, None]

    def _first_order(self, s: ComplexArray, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return W^T D^-1 F and its derivative in s (P, m, c), of F (n, c)."""
        L, dL, Q = self._expansion.solutions(s, self.W, F)
        EQ = np.zeros_like(Q)  # E Q, and its derivative
        for power, A in self._changes:
            # A is real: real and imaginary parts are multiplied as twice as many real columns
            term = (A @ Q.reshape(self.n, -1).view(float)).view(complex).reshape(Q.shape)
            if power:
                powered = s[:, None] ** power * term
                powered[:, 1] += power * s[:, None] ** (power - 1) * term[:, 0]
                term = powered
            EQ += term
        net_load = F - EQ[:, 0].transpose(1, 0, 2)
        return L @ net_load, dL @ net_load - L @ EQ[:, 1].transpose(1, 0, 2)
