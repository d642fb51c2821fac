"""Natural modes of planetary gear sets, and the terms of the turning frame of the carrier.

    [K + W diag(k) W^T - omega^2 M] q = 0

The modes of a set with equally spaced planets are rotational, translational or planet modes.

References
----------
Lin and Parker (1999), Analytical characterization of the unique properties of planetary gear free vibration, J. Vib.
Acoust. 121(3), 316-321, https://doi.org/10.1115/1.2893982.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.mechanics.structures.speed_terms import SpeedTerms

SHAPE_TOLERANCE = 1e-6  # components of a mode shape with maximum 1 below this value are rounding errors

ZERO_FREQUENCY = 1e-9  # squares of frequencies below this fraction of the highest one are rounding errors

SAME_FREQUENCY = 1e-6  # difference of equal frequencies over the highest one


@dataclass(frozen=True)
class PlanetMode:
    """Natural mode of a planetary set with all teeth in contact.

    Attributes
    ----------
    frequency : float
        Natural frequency [Hz].
    kind : {"rotational", "translational", "planet", "mixed"}
        Kind of the mode: the central members turn and all planets move alike; the central members move sideways; the
        central members rest; or another shape, of a set without the symmetry.
    multiplicity : int
        Number of modes with this frequency.

    Examples
    --------
    >>> import hbgear as hb
    >>> [mode.multiplicity for mode in hb.gears.PlanetarySet().modes() if mode.kind == "planet"]  # N - 3
    [1, 1, 1]
    """

    frequency: float
    kind: str
    multiplicity: int


def natural_modes(M: Array, K: Array) -> tuple[PlanetMode, ...]:
    """Return the undamped natural modes of M and K (n, n) in SI units, in ascending order.

    All teeth are in contact; x, y, u of the central members are the first coordinates.
    """
    squares, shapes = scipy.linalg.eigh(K, M)
    frequencies = np.sqrt(np.maximum(squares, 0.0)) / (2 * pi)
    frequencies[squares < ZERO_FREQUENCY * squares[-1]] = 0.0
    modes: list[PlanetMode] = []
    start = 0
    while start < len(frequencies):
        count = int(np.sum(np.abs(frequencies[start:] - frequencies[start]) <= SAME_FREQUENCY * frequencies[-1]))
        modes.append(PlanetMode(float(frequencies[start]), _kind(shapes[:, start : start + count]), count))
        start += count
    return tuple(modes)


def _kind(shapes: Array) -> str:
    """Return the kind of the modes (n, count) of one frequency."""
    unit = shapes / np.abs(shapes).max(axis=0)
    central, planets = unit[:9].reshape(3, 3, -1), unit[9:].reshape(-1, 3, unit.shape[1])
    sideways, turning = np.abs(central[:, :2]).max() > SHAPE_TOLERANCE, np.abs(central[:, 2]).max() > SHAPE_TOLERANCE
    alike = np.abs(planets - planets[:1]).max() < SHAPE_TOLERANCE
    if turning and not sideways and alike:
        return "rotational"
    if sideways and not turning:
        return "translational"
    return "mixed" if sideways or turning else "planet"


def turning_frame(masses: Array, dampers: Array, speed: float) -> SpeedTerms:
    """Return the terms of a frame that turns at ``speed`` times Omega.

        x'' - 2 Omega_c y' - Omega_c^2 x,   y'' + 2 Omega_c x' - Omega_c^2 (y - u_c)
        damping force on central members  -c (x' - Omega_c y),   -c (y' + Omega_c x)

    u_c is subtracted for planets only: where the carrier has turned, the centrifugal force of a planet has turned with
    it, so that a rotation of the whole set needs no force. The bearings of the central members, with the ``dampers``
    (3,), stand still. ``masses`` (n,) is the diagonal of M: every third coordinate is a rotation, the two before it are
    displacements in the plane; carrier, ring and sun are the first members.
    """
    n = len(masses)
    G, inward, around = np.zeros((3, n, n))
    for i in range(0, n, 3):
        G[i, i + 1], G[i + 1, i] = -2 * masses[i], 2 * masses[i]
        sideways = np.eye(n)[i + 1] - (np.eye(n)[2] if i >= 9 else 0.0)
        inward += masses[i] * (np.outer(np.eye(n)[i], np.eye(n)[i]) + np.outer(sideways, sideways))
    for i, c in enumerate(dampers.tolist()):
        around[3 * i, 3 * i + 1], around[3 * i + 1, 3 * i] = -c, c

    def stiffness(Omega: float) -> Any:
        return speed * Omega * around - (speed * Omega) ** 2 * inward

    return SpeedTerms(G, speed, stiffness=stiffness)
