"""A structure part of which is known by its receptances alone; see `hbgear.mechanics.structures.receptances`.

    D(w) = K + W kr W^T + i w (C + W c W^T) - w^2 M + S Z(w) S^T,   dD/dw = i C - 2 w M + S Z' S^T,   Z = H^-1

Everything is solved for directly. There are no modes: no multipliers, no integration in time.
"""

from __future__ import annotations

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.structure.receptance import MODAL_LIMIT, LinearStructure, dense
from hbgear.mechanics.models import System

STABILITY_NOT_AVAILABLE = "not available: measured receptances do not determine how a disturbance decays"


class MeasuredStructure(LinearStructure):
    """A `LinearStructure` with receptances.

    Raises
    ------
    ValueError
        If there are too many coordinates to solve for them at every frequency.
    """

    def __init__(self, system: System) -> None:
        if system.n > MODAL_LIMIT:
            raise ValueError(f"{system.n} coordinates beside receptances are too many; at most {MODAL_LIMIT}")
        assert system.receptances is not None
        self._part = system.receptances
        self.highest = self._part.highest
        self._at = [list(system.dof_names).index(name) for name in self._part.names]
        super().__init__(system)

    def _check_mass(self) -> None:
        """Coordinates with receptances need no mass of their own."""

    def _close(self, system: System) -> None:
        self.K = dense(system.K) + (self.W * self.kr) @ self.W.T
        self.modes, self.parted = None, False

    def _stiffness(self, w: float) -> tuple[ComplexArray, ComplexArray]:
        """D and dD/dw (n, n)."""
        D = self.K + 1j * w * self.C - w**2 * self.M
        dD = 1j * self.C - 2 * w * self.M
        Z, dZ = self._part.stiffness(w)
        where = np.ix_(self._at, self._at)
        D[where] += Z
        dD[where] += dZ
        return D, dD

    def solve(self, w: float, rhs: ComplexArray) -> ComplexArray:
        x: ComplexArray = scipy.linalg.solve(self._stiffness(w)[0], rhs)
        return x

    def _direct(self, w: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        Q, dQ = np.empty((2, *F.shape), dtype=complex)
        for i, wi in enumerate(w.tolist()):
            D, dD = self._stiffness(wi)
            Q[i] = scipy.linalg.solve(D, F[i])
            dQ[i] = -scipy.linalg.solve(D, dD @ Q[i]) if wi else 0.0
        return Q, dQ
