"""States in the modes of a structure, and motions under integration.

    z = left (C q + M q') + poles left M q,   q = right z,   q' = right poles z

The poles of a real structure are real or conjugate pairs. The integrator stores one mode of each pair.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.structure.eigenmodes import Modes
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.harmonic.structure.modes import halves
from hbgear.time.exponential.segments import Integers


def modal_state(structure: LinearStructure, y: Array) -> ComplexArray:
    """Return the modal coordinates z (..., r) of states y (..., 2n); free motions are left out."""
    modes = modes_of(structure)
    q, v = y[..., : structure.n], y[..., structure.n :]
    return (q @ structure.C.T + v @ structure.M.T) @ modes.left.T + modes.poles * (q @ structure.M.T @ modes.left.T)


def physical_state(structure: LinearStructure, z: ComplexArray) -> Array:
    """Return the states (..., 2n) of modal coordinates z (..., r), without free motions."""
    modes = modes_of(structure)
    return np.concatenate([(z @ modes.right.T).real, (z * modes.poles @ modes.right.T).real], axis=-1)


def modes_of(structure: LinearStructure) -> Modes:
    """Return the modes of a structure; ValueError if it is too large for them to be computed."""
    if structure.modes is None:
        raise ValueError(f"{too_large(structure)}: use integrate with method='Radau', or reduce the model")
    return structure.modes


def too_large(structure: LinearStructure) -> str:
    """Return the reason for which the modes of a structure are not computed; "" if they are."""
    if structure.modes is not None:
        return ""
    return f"the modes of the structure are required, but {structure.n} coordinates are too many"


@dataclass(frozen=True)
class StoredModes:
    """Indices (q,) of one mode of each conjugate pair and of the real modes; factor (q,) 2 for a pair, else 1."""

    indices: Integers
    factor: Array

    @staticmethod
    def of(modes: Modes) -> StoredModes:
        """Return the stored modes of all modes of a structure."""
        pairs, real = halves(modes.poles)
        return StoredModes(np.concatenate([pairs, real]), np.repeat([2.0, 1.0], [len(pairs), len(real)]))


def real_and_imaginary(z: ComplexArray) -> Array:
    """Return the real parts, followed by the imaginary parts, along the last axis."""
    return np.concatenate([z.real, z.imag], axis=-1)


@dataclass(eq=False)
class StateBatch:
    """Current states of B motions under integration.

    Attributes
    ----------
    zeta : ndarray, shape (B, 2 q)
        Modal coordinates z of the stored modes minus the steady part: real parts, then imaginary parts.
    d, v : ndarray, shape (B, m)
        Element coordinates and their rates.
    segment : ndarray, shape (B, m + J)
        Index of the segment of the law of each element, and of each contact between teeth.
    """

    zeta: Array
    d: Array
    v: Array
    segment: Integers

    def select(self, rows: Integers) -> StateBatch:
        """Return some of the motions."""
        return StateBatch(self.zeta[rows], self.d[rows], self.v[rows], self.segment[rows])

    def replace(self, rows: Integers, other: StateBatch) -> None:
        """Replace some of the motions."""
        for target, new in zip(self.arrays(), other.arrays(), strict=True):
            target[rows] = new

    def arrays(self) -> tuple[Array, Array, Array, Integers]:
        """Return zeta, d, v and segment."""
        return self.zeta, self.d, self.v, self.segment
