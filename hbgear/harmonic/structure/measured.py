"""Structures with a part that is known only by measured receptances.

See `hbgear.mechanics.structures.receptances` for the receptances H and their derivatives.

    D(w) = K + W kr W^T + i w (C + W c W^T) - w^2 M + S Z(w) S^T,   dD/dw = i C - 2 w M + S Z' S^T,   Z = H^-1

The dynamic stiffness D is solved directly at each frequency. Such a structure has no modes, so Floquet multipliers and
time integration are not available.
"""

from __future__ import annotations

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.structure.linear_structure import MODAL_LIMIT, LinearStructure, dense
from hbgear.mechanics.models import System

STABILITY_NOT_AVAILABLE = "not available: measured receptances do not determine how a disturbance decays"
"""Entry of ``branch.meta["stability"]`` for structures with measured receptances."""


class MeasuredStructure(LinearStructure):
    """A `LinearStructure` with measured receptances.

    Parameters
    ----------
    system : System
        System with receptances, of at most 1500 coordinates.

    Raises
    ------
    ValueError
        If the system has too many coordinates for a direct solution at every frequency.
    """

    def __init__(self, system: System) -> None:
        if system.n > MODAL_LIMIT:
            raise ValueError(f"{system.n} coordinates are too many with receptances: reduce them to {MODAL_LIMIT}")
        assert system.receptances is not None
        self._measured = system.receptances
        self.highest = self._measured.highest
        self._indices = [list(system.dof_names).index(name) for name in self._measured.names]
        super().__init__(system)

    def _add_reference_springs(self, system: System) -> None:
        """Set K with the reference springs; there are no modes."""
        self.K = dense(system.K) + (self.W * self.kr) @ self.W.T
        self.modes, self.disturbed = None, False

    def _stiffness(self, w: float) -> tuple[ComplexArray, ComplexArray]:
        """Return D and dD/dw (n, n)."""
        D = self.K + 1j * w * self.C - w**2 * self.M
        dD = 1j * self.C - 2 * w * self.M
        Z, dZ = self._measured.stiffness(w)
        block = np.ix_(self._indices, self._indices)
        D[block] += Z
        dD[block] += dZ
        return D, dD

    def solve(self, w: float, rhs: ComplexArray) -> ComplexArray:
        return scipy.linalg.solve(self._stiffness(w)[0], rhs)

    def solve_all(self, w: Array, F: ComplexArray) -> ComplexArray:
        return np.array([self.solve(wk, Fk) for wk, Fk in zip(w.tolist(), F, strict=True)])

    def _direct(self, w: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        Q, dQ = np.empty((2, *F.shape), dtype=complex)
        for i, wi in enumerate(w.tolist()):
            D, dD = self._stiffness(wi)
            Q[i] = scipy.linalg.solve(D, F[i])
            dQ[i] = -scipy.linalg.solve(D, dD @ Q[i]) if wi else 0.0
        return Q, dQ
