"""Response of the linear part alone to all loads and displacement excitations that are Fourier series.

z_steady(tau) = sum_k (left F_k + input (kr + i k Omega c) e_k) / (i k Omega - poles) exp(i k tau)

Coordinates without mass follow the loads without delay:

    q = right z + G F,   q' = right (poles z + left F) + G F'

The modes of `harmonic.structure.massless` hold the rest. The rates of the elements are continuous in the method, so
that no element may act on a coordinate without mass: right left W = 0 there.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.harmonic.structure.massless import MATRIX_ROUNDING, mass_basis, state_equations
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import Series, to_complex
from hbgear.time.exponential.modal_states import modes_of
from hbgear.time.exponential.segments import Integers


def highest_order(systems: list[System]) -> int:
    """Return the highest harmonic order of the displacements and loads of some systems."""
    orders = [[e.displacement.order for e in s.elements] + [load.order for load in s.loads] for s in systems]
    return max(0, *(order for system_orders in orders for order in system_orders))


def steady_part(
    structure: LinearStructure, system: System, indices: Integers, Omega: float, order: int
) -> tuple[ComplexArray, ComplexArray]:
    """Return z_steady (q,) of the stored modes at tau = 0, and the harmonics of its d and v (order + 1, 2 m)."""
    k = np.arange(order + 1)
    modes, rate = modes_of(structure), 1j * k[:, None] * Omega
    e = np.zeros((order + 1, structure.m), dtype=complex)
    loads = load_harmonics(system, Omega).T
    F = np.pad(loads, ((0, order + 1 - len(loads)), (0, 0)))
    for j, element in enumerate(system.elements):
        if isinstance(element.displacement, Series):
            c = to_complex(element.displacement.row())
            e[: len(c), j] = c
    spring_forces = (structure.kr + structure.c * rate) * e
    positive = (F @ modes.left.T + spring_forces @ modes.input.T) / (rate - modes.poles)
    negative = (F.conj() @ modes.left.T + spring_forces.conj() @ modes.input.T) / (-rate - modes.poles)
    d = positive @ modes.output.T - e
    z = 0.5 * (positive + negative)[:, indices].sum(axis=0)
    return z, np.concatenate([d, rate * d], axis=1)


def load_harmonics(system: System, Omega: float) -> ComplexArray:
    """Return the complex harmonics (n, L + 1) of the loads of a system at a frequency."""
    forces = np.zeros((system.n, 1 + max([0, *(load.order for load in system.loads)])), dtype=complex)
    for load in system.loads:
        for order, vector in load.complex(system.n).items():
            forces[:, order] += Omega**load.power * vector
    return forces


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
