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
from hbgear.mechanics.series.fourier import to_complex, to_real
from hbgear.mechanics.series.real_basis import derivative


def phase_vector(X: Array, m: int) -> Array:
    """Return the coefficients b (n,) of the phase condition, of length one, with a motion X (n,) of m elements.

    Raises
    ------
    ValueError
        If the motion is constant.
    """
    b = derivative(X.reshape(m, -1)).ravel()
    if not np.any(b):
        raise ValueError("a motion without alternating part has no phase; give a periodic motion as the reference")
    return b / norm(b)


def in_phase(X: Array, tangent: Array, reference: Array, m: int, parameters: int) -> tuple[Array, Array]:
    """Return unknowns X and their tangent, shifted in time: the motion of m elements nearest to that of a reference.

    The last unknowns are parameters, whose number is given. Along a closed curve a motion that is not symmetric in time
    returns with another phase.
    """
    n = len(X) - parameters
    c, t, r = (to_complex(x[:n].reshape(m, -1)) for x in (X, tangent, reference))
    k = np.arange(c.shape[1])
    product = np.sum(r.conj() * c, axis=0)  # max_phi Re sum_k product_k exp(i k phi)
    phases = 2 * np.pi * np.arange(_PHASES_PER_HARMONIC * len(k)) / (_PHASES_PER_HARMONIC * len(k))
    phi = float(phases[np.argmax((np.exp(1j * np.outer(phases, k)) @ product).real)])
    for _ in range(_PHASE_ITERATIONS):
        terms = k * np.exp(1j * k * phi) * product
        bend = float((k * terms).real.sum())
        phi -= float(terms.imag.sum()) / bend if bend > 0 else 0.0
    turn = np.exp(1j * k * phi)
    return np.append(to_real(c * turn), X[n:]), np.append(to_real(t * turn), tangent[n:])


_PHASES_PER_HARMONIC = 16
"""Number of phases for each harmonic at which two motions are compared, before Newton's method."""

_PHASE_ITERATIONS = 6
"""Iterations of Newton's method for the phase, which starts close to it."""


def without_trivial(multipliers: ComplexArray) -> ComplexArray:
    """Return the multipliers without the one closest to +1, which belongs to the arbitrary phase."""
    return np.delete(multipliers, np.argmin(np.abs(multipliers - 1.0)))
