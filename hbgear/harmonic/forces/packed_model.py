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
from hbgear.mechanics.laws.slider import friction_limits
from hbgear.mechanics.series.fourier import to_complex
from hbgear.mechanics.structures.elements import Element


class UserLaws(NamedTuple):
    """Compiled laws of the user.

    element, address (Q,), parameters (Q, G) : element, address of the code and parameters of each law.
    """

    element: np.ndarray
    address: np.ndarray
    parameters: Array


class Sliders(NamedTuple):
    """Friction sliders; their limits are gain d_n + base + wave, see `FrictionLimit`.

    element (Q,), k, residual (Q,) : element of each slider, ascending, and its numbers.
    normal (Q,) : element of the normal force; -1 without one.
    varies (Q,) : whether the limit varies.
    level (Q, B), gain, base (Q, B + 1) : levels of d_n, padded with inf, and the zones between them.
    wave (Q, P + 1) : one-sided coefficients of the prescribed limit without its mean.
    """

    element: np.ndarray
    k: Array
    residual: Array
    normal: np.ndarray
    varies: np.ndarray
    level: Array
    gain: Array
    base: Array
    wave: ComplexArray


class FreeModes(NamedTuple):
    """Poles (r,), displacements (m, r) of the elements, and excitation (r, m) by forces at them, of a structure.

    Without modes r is 0.
    """

    poles: ComplexArray
    output: ComplexArray
    input: ComplexArray


class PackedLinearPart(NamedTuple):
    """Linear part of a model.

    poles (2, r), residues (m m + L m, 2, r) : poles of the structure in real and imaginary parts; residues of the
        receptance G between elements, followed by the residues of the displacements of the elements under L loads. With
        a polynomial the poles are those with fixed elements, and the residues those of Z and of the forces.
    polynomial (3, m, m), static (L, m) : Z and the forces of L loads without the residues, see `fixed_interface`.
        (0, m, m) if Z is the inverse of G.
    free : modes of the structure with free elements.
    springs (2, m) : reference stiffness and damping of the elements.
    orders (K + 1,), truncated_orders (L,) : basis harmonics that are unknowns, all of 0..H by default; the others up to
        2H.
    prescribed (K + 1, m) : harmonics of the prescribed displacements.
    independent (a,), dependent (b,), force_sums (a, b) : elements with independent directions, and the others, whose
        directions are W_b = W_a B; B. `LinearStructure` explains the constraints.
    tie_stiffness, tie_offsets (b, 2K + 1) : factor of the constraints, and their constants.
    loads (L, 2) : power of Omega of each load, and its position among the orders.
    nu : subharmonic order.
    radius, near_count (B,), far_series (B, J, N, 2) : radii of bands of far poles, the number of poles below each
        radius, and the coefficients of the power series of the others; the poles ascend. Empty for few poles.
    """

    poles: Array
    residues: Array
    polynomial: Array
    static: ComplexArray
    free: FreeModes
    springs: Array
    orders: np.ndarray
    truncated_orders: np.ndarray
    prescribed: ComplexArray
    independent: np.ndarray
    dependent: np.ndarray
    force_sums: Array
    tie_stiffness: float
    tie_offsets: Array
    loads: np.ndarray
    nu: int
    radius: Array
    near_count: np.ndarray
    far_series: Array


class PackedModel(NamedTuple):
    """Model for kernels.

    basis (2H + 1, N) : real Fourier basis at N samples.
    piecewise, user_laws, sliders : None, all three, for a model without breakpoints in the phase, compiled laws of the
        user and friction. Kernels are then compiled without the code for them, in half of the time. In all other models
        the absent ones are empty arrays, so that kernels are compiled for two types of models only.
    """

    laws: PackedLaws
    linear: PackedLinearPart
    basis: Array
    piecewise: PiecewiseExcitation | None
    user_laws: UserLaws | None
    sliders: Sliders | None


def sliders_of(elements: Sequence[Element], nu: int, H: int) -> Sliders:
    """Return the friction sliders of a model; harmonics of their limits above H are left out."""
    limits = friction_limits(elements)
    Q, B = len(limits), max([0, *(len(limit.level) for *_, limit in limits)])
    P = nu * min(H // nu, max([0, *(limit.wave.order for *_, limit in limits)]))
    level, zones, wave = np.full((Q, B), np.inf), np.zeros((2, Q, B + 1)), np.zeros((Q, P + 1), dtype=complex)
    for i, (_, _, limit) in enumerate(limits):
        level[i, : len(limit.level)] = limit.level
        zones[:, i, : len(limit.gain)] = limit.gain, limit.base
        wave[i, ::nu] = to_complex(limit.wave.row(P // nu))
    return Sliders(
        np.array([j for j, *_ in limits], dtype=np.int64),
        np.array([slider.k for _, slider, _ in limits]),
        np.array([slider.residual for _, slider, _ in limits]),
        np.array([limit.normal for *_, limit in limits], dtype=np.int64),
        np.array([limit.normal >= 0 or limit.wave.varies for *_, limit in limits], dtype=np.bool_),
        level,
        zones[0].copy(),
        zones[1].copy(),
        wave,
    )


def user_laws_of(laws: Sequence[Law]) -> UserLaws:
    """Return the compiled laws of a model that kernels call."""
    user_laws = [(j, law) for j, law in enumerate(laws) if isinstance(law, CompiledLaw) and law.is_called_by_kernels]
    parameters = np.zeros((len(user_laws), 1 + max([0, *(len(law.parameters) for _, law in user_laws)])))
    for row, (_, law) in zip(parameters, user_laws, strict=True):
        row[: len(law.parameters)] = law.parameters
    return UserLaws(
        np.array([j for j, _ in user_laws], dtype=np.int64),
        np.array([law.address for _, law in user_laws], dtype=np.int64),
        parameters,
    )


def split_complex(z: ComplexArray) -> Array:
    """Return real and imaginary parts (..., 2, r) of complex numbers (..., r)."""
    out = np.empty((*z.shape[:-1], 2, z.shape[-1]))
    out[..., 0, :], out[..., 1, :] = z.real, z.imag
    return out
