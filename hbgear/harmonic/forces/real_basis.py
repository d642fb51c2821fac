"""Matrices of the real basis (a0, a1, b1, ..., aH, bH), in which the balance is solved."""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.mechanics.series.fourier import derive, to_complex, to_real


def one_sided(c: ComplexArray) -> ComplexArray:
    """One-sided coefficients of two-sided ones."""
    out = 2.0 * c
    out[..., 0] *= 0.5
    return out


def derivative(rows: Array) -> Array:
    """d/dtheta of real rows: a_k -> k b_k, b_k -> -k a_k."""
    return to_real(derive(to_complex(rows)))


def after_derivative(A: Array) -> Array:
    """Matrix A (..., n, n) applied after d/dtheta."""
    H = A.shape[-1] // 2
    k = np.arange(1, H + 1)
    out = np.zeros_like(A)
    out[..., 1::2] = -k * A[..., 2::2]
    out[..., 2::2] = k * A[..., 1::2]
    return out
