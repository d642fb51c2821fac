"""Coordinates without mass in the exponential method: parts of a state that follow the loads without delay.

    q = right z + G F,   q' = right (poles z + left F) + G F'

The modes of `harmonic.structure.massless` hold the rest. The rates of the elements are continuous in the method, so
that no element may act on a coordinate without mass: right left W = 0 there.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.harmonic.structure.massless import MATRIX_ROUNDING, mass_basis, state_equations
from hbgear.time.exponential.modal_states import modes_of
from hbgear.time.exponential.steady_part import load_harmonics


def element_without_mass(structure: LinearStructure) -> str:
    """Return the name of an element on coordinates without mass, so that its rate follows its force; "" without any."""
    if not structure.system.massless:
        return ""
    modes = modes_of(structure)
    rates = np.abs(np.diag(modes.output @ modes.input))
    massless = rates > MATRIX_ROUNDING * np.diag(np.abs(modes.output) @ np.abs(modes.input))
    return structure.system.elements[int(np.argmax(massless))].name if massless.any() else ""


def following_loads(structure: LinearStructure, Omega: Array) -> Array:
    """Return the parts of q and q' (B, 2n) at tau = 0 that follow the loads, at frequencies (B,)."""
    system, modes = structure.system, modes_of(structure)
    out = np.zeros((len(Omega), 2 * system.n))
    if not system.massless:
        return out
    basis = mass_basis(structure.M)
    static = state_equations(system, structure.M, structure.C, structure.K, basis, basis).G
    for row, w in zip(out, Omega.tolist(), strict=True):
        F = load_harmonics(system, w)
        force, rate = F.sum(axis=1).real, (F @ (1j * w * np.arange(F.shape[1]))).real
        row[: system.n] = static @ force
        row[system.n :] = (modes.right @ (modes.left @ force)).real + static @ rate
    return out
