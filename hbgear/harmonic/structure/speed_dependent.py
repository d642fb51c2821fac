"""Structures whose stiffness and damping depend on speed, for example by gyroscopic terms.

    D(w, Omega) = K(Omega) + i w C(Omega) - w^2 M,   w = (k / nu) Omega

K and C include the reference springs and dampers of the elements. Receptances are computed by direct solutions, in one
batch for all harmonics. With the left and right solutions L = W^T D^-1 and Q = D^-1 F, the derivative

    d(W^T Q)/dOmega = -L D' Q,   D' = K' + i w C' + i (k / nu) C - 2 w (k / nu) M

needs no further solution. Stability and time integration use the modes of the structure at one value of Omega.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.lru_cache import LRUCache
from hbgear.harmonic.structure.linear_structure import MODAL_LIMIT, LinearStructure, dense, flexibility
from hbgear.mechanics.models import System

_CACHED_SPEEDS = 16
"""Number of speeds whose structures are cached: the points of a branch that are evaluated together."""


class SpeedDependentStructure(LinearStructure):
    """A `LinearStructure` whose C and K depend on Omega.

    Parameters
    ----------
    system : System
        System with speed-dependent terms, of at most 1500 coordinates.

    Raises
    ------
    ValueError
        If M is singular, or the system has too many coordinates for a direct solution at every frequency.
    """

    depends_on_speed = True

    def __init__(self, system: System) -> None:
        if system.n > MODAL_LIMIT:
            raise ValueError(
                f"{system.n} coordinates of a structure that depends on speed are too many: reduce it first, "
                "hb.mechanics.reduce(model, modes=60).system"
            )
        assert system.speed is not None
        self._speed = system.speed
        self._structures: LRUCache[LinearStructure] = LRUCache(_CACHED_SPEEDS)
        self._free: bool | None = None
        super().__init__(system)

    def _add_reference_springs(self, system: System) -> None:
        """Set K at standstill with the reference springs; modes exist at one Omega only, see `at`."""
        self.K = dense(system.K) + (self.W * self.kr) @ self.W.T
        self.modes, self.disturbed = None, False

    def at(self, Omega: float) -> LinearStructure:
        """Return the structure at one Omega, with its modes."""
        return self._structures.get(Omega, lambda: LinearStructure(self.system.at_speed(Omega)))

    def response(self, Omega: float, ratio: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        C, K = (A + dense(B) for A, B in zip((self.C, self.K), self._speed.at(Omega, self.n), strict=True))
        dC, dK = (dense(B) for B in self._speed.slope(Omega, self.n))
        r, w = ratio[:, None, None], Omega * ratio[:, None, None]
        D = K + 1j * w * C - w**2 * self.M
        dD = dK + 1j * w * dC + 1j * r * C - 2 * w * r * self.M
        Q, L = np.empty((len(ratio), *F.shape), dtype=complex), np.empty((len(ratio), self.n, self.m), dtype=complex)
        moving = ratio > 0 if self._has_free_motion(K) else np.full(len(ratio), True)
        Q[moving] = np.linalg.solve(D[moving], np.broadcast_to(F, Q[moving].shape))
        # adjoint solutions: with them dG = -L^T dD Q needs no further solution
        L[moving] = np.linalg.solve(D[moving].transpose(0, 2, 1), np.broadcast_to(self.W, L[moving].shape))
        if not moving.all():
            static = flexibility(K, self._scale)
            Q[~moving], L[~moving] = static @ F, static.T @ self.W
        Lt = L.transpose(0, 2, 1)
        return self.W.T @ Q, -(Lt @ (dD @ Q))

    def _has_free_motion(self, K: Array) -> bool:
        """Return whether the structure has a free motion; check the loads on it at the first call.

        Without one, K is singular at isolated speeds only, as D can be at any other harmonic.
        """
        if self._free is None:
            at_standstill, self.K = self.K, K
            self.free_left = self._null(K.T)
            try:
                self.check_balance(self.system)
            finally:
                self.K = at_standstill
            self._free = self.free_left.shape[1] > 0
        return self._free
