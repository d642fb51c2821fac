"""A model at one set of parameters as a table of numbers, the form in which kernels take it.

Every law that is known here is, for each element, a sum of piecewise-linear springs with periodic stiffness and a
cubic spring,

    p(d, tau) = sum_s k_s(tau) (g0_s + s0_s x + sum_i D_si max(x - x_i, 0)) + k1 d + k3 d^3

Their table is that of `packed_laws`.
Of a compiled law of the user there is its address; others (a user's in Python, or those that shall be sampled) leave
nothing but their corners in the table.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.forces.breakpoints import Corners
from hbgear.harmonic.forces.packed_laws import PackedLaws
from hbgear.mechanics.laws.compiled_law import CompiledLaw
from hbgear.mechanics.laws.laws import Law


class Own(NamedTuple):
    """Compiled laws of the user.

    element, address (Q,), given (Q, G) : of each its element, its code and its parameters.
    """

    element: np.ndarray
    address: np.ndarray
    given: Array


class PackedLinearPart(NamedTuple):
    """The linear part: poles (2, r) of the structure, real and imaginary parts, and residues (m m + L m, 2, r).

    These are of the receptance G, and behind it of what L loads do to the elements. springs (2, m) : reference
    stiffness and damping of elements. orders (K + 1,) : basis harmonics that are unknowns, 0..H unless only some are;
    left (L,) : those up to 2H that are none. moved (K + 1, m) : harmonics of the prescribed displacements. loads (L, 2)
    : power of Omega and place among the orders of each load. nu : subharmonic order.
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
    """A model for kernels: its laws, its linear part, the basis (2H + 1, N) on the grid of N samples, its corners.

    corners, own : None of a model that has none. Kernels are then compiled without the code for them, in two thirds of
    the time.
    """

    laws: PackedLaws
    linear: PackedLinearPart
    basis: Array
    corners: Corners | None
    own: Own | None


def own_of(laws: Sequence[Law]) -> Own | None:
    """The compiled laws of a model, None if there are none."""
    own = [(j, law) for j, law in enumerate(laws) if isinstance(law, CompiledLaw)]
    if not own:
        return None
    given = np.zeros((len(own), 1 + max([0, *(len(law.parameters) for _, law in own)])))
    for row, (_, law) in zip(given, own, strict=True):
        row[: len(law.parameters)] = law.parameters
    return Own(
        np.array([j for j, _ in own], dtype=np.int64),
        np.array([law.address for _, law in own], dtype=np.int64),
        given,
    )


def in_two(z: ComplexArray) -> Array:
    """Real and imaginary parts (..., 2, r) of (..., r)."""
    out = np.empty((*z.shape[:-1], 2, z.shape[-1]))
    out[..., 0, :], out[..., 1, :] = z.real, z.imag
    return out
