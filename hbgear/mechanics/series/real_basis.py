"""Operations in the real Fourier basis (a0, a1, b1, ..., aH, bH) of the unknowns."""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.mechanics.series.fourier import derive, to_complex, to_real


def one_sided(c: ComplexArray) -> ComplexArray:
    """Return one-sided Fourier coefficients from two-sided ones."""
    out = 2.0 * c
    out[..., 0] *= 0.5
    return out


def derivative(rows: Array) -> Array:
    """Return the coefficients of d/dtheta: a_k -> k b_k, b_k -> -k a_k."""
    return to_real(derive(to_complex(rows)))


def after_derivative(A: Array) -> Array:
    """Return the matrix A (..., n, n) times the matrix of d/dtheta."""
    H = A.shape[-1] // 2
    k = np.arange(1, H + 1)
    out = np.zeros_like(A)
    out[..., 1::2] = -k * A[..., 2::2]
    out[..., 2::2] = k * A[..., 1::2]
    return out
