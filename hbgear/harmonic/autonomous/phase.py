"""Phase condition of motions without excitation, whose phase is arbitrary.

    g(X) = <x_ref', x> = 0         x_ref a neighbouring motion of the curve

It selects the motion closest to the reference among all time shifts. For the Fourier coefficients X of x the condition
is linear, g = b^T X, with b the coefficients of the derivative of the reference.

References
----------
Doedel, Keller and Kernevez (1991), Int. J. Bifurcation Chaos 1(4), https://doi.org/10.1142/S0218127491000555.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.numerics.linear import norm
from hbgear.mechanics.series.real_basis import derivative


def phase_vector(X: Array, m: int) -> Array:
    """Return the coefficients b (n,) of the phase condition, of length one, with a motion X (n,) of m elements.

    Raises
    ------
    ValueError
        If the motion is constant.
    """
    b: Array = derivative(X.reshape(m, -1)).ravel()
    if not np.any(b):
        raise ValueError("a motion without alternating part has no phase; give a periodic motion as the reference")
    return b / norm(b)


def without_trivial(multipliers: ComplexArray, count: int = 1) -> ComplexArray:
    """Return the multipliers without the ``count`` closest to +1, which belong to the arbitrary phase."""
    remaining = np.argsort(np.abs(multipliers - 1.0), kind="stable")[count:]
    out: ComplexArray = multipliers[np.sort(remaining)]
    return out
