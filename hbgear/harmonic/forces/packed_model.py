"""Arrays of a model at one set of parameters, in the form that kernels require.

Each element has a sum of piecewise-linear springs with periodic stiffness and a cubic spring,

    p(d, tau) = sum_s k_s(tau) (g0_s + s0_s x + sum_i D_si max(x - x_i, 0)) + k1 d + k3 d^3

`packed_laws` holds their arrays. Compiled laws of the user are stored by their address. Of other laws (in Python, or
sampled by choice) only the breakpoints are stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.breakpoints import PiecewiseExcitation
from hbgear.harmonic.forces.packed_laws import PackedLaws
from hbgear.mechanics.laws.compiled_law import CompiledLaw
from hbgear.mechanics.laws.laws import Law


class Own(NamedTuple):
    """Compiled laws of the user.

    element, address (Q,), given (Q, G) : element, address of the code and parameters of each law.
    """

    element: np.ndarray
    address: np.ndarray
    given: Array


class Sliders(NamedTuple):
    """Friction sliders.

    element (Q,), k, limit, residual (Q,) : element of each slider, ascending, and its numbers.
    """

    element: np.ndarray
    k: Array
    limit: Array
    residual: Array


class PackedLinearPart(NamedTuple):
    """Linear part of a model.

    poles (2, r), residues (m m + L m, 2, r) : poles of the structure in real and imaginary parts; residues of the
        receptance G between elements, followed by the residues of the displacements of the elements under L loads.
    springs (2, m) : reference stiffness and damping of the elements.
    orders (K + 1,), left (L,) : basis harmonics that are unknowns, all of 0..H by default; the others up to 2H.
    moved (K + 1, m) : harmonics of the prescribed displacements.
    loads (L, 2) : power of Omega of each load, and its position among the orders.
    nu : subharmonic order.
    """

    poles: Array
    residues: Array
    springs: Array
    orders: np.ndarray
    left: np.ndarray
    moved: ComplexArray
    loads: np.ndarray
    nu: int


class PackedModel(NamedTuple):
    """Model for kernels.

    basis (2H + 1, N) : real Fourier basis at N samples.
    piecewise : None for a model without breakpoints in the phase. Kernels are then compiled without the code for them,
        in two thirds of the time.
    own, sliders : empty arrays for a model without compiled laws or friction.
    """

    laws: PackedLaws
    linear: PackedLinearPart
    basis: Array
    piecewise: PiecewiseExcitation | None
    own: Own
    sliders: Sliders


def sliders_of(laws: Sequence[Law]) -> Sliders:
    """Return the friction sliders of a model."""
    found = [(j, slider) for j, law in enumerate(laws) for slider in law.sliders]
    packed = np.array([(one.k, one.limit, one.residual) for _, one in found], dtype=float).reshape(-1, 3).T.copy()
    return Sliders(np.array([j for j, _ in found], dtype=np.int64), *packed)


def own_of(laws: Sequence[Law]) -> Own:
    """Return the compiled laws of a model."""
    own = [(j, law) for j, law in enumerate(laws) if isinstance(law, CompiledLaw)]
    given = np.zeros((len(own), 1 + max([0, *(len(law.parameters) for _, law in own)])))
    for row, (_, law) in zip(given, own, strict=True):
        row[: len(law.parameters)] = law.parameters
    return Own(
        np.array([j for j, _ in own], dtype=np.int64),
        np.array([law.address for _, law in own], dtype=np.int64),
        given,
    )


def in_two(z: ComplexArray) -> Array:
    """Return real and imaginary parts (..., 2, r) of complex numbers (..., r)."""
    out = np.empty((*z.shape[:-1], 2, z.shape[-1]))
    out[..., 0, :], out[..., 1, :] = z.real, z.imag
    return out
