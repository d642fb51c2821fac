"""Matrices of the real basis (a0, a1, b1, ..., aH, bH), in which the balance is solved."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.mechanics.fourier import derive, to_complex, to_real


class Toeplitz:
    """Real matrix of X -> kappa * X (a product of periodic functions) in the basis (a0, a1, b1, ...)."""

    def __init__(self, H: int) -> None:
        k = np.concatenate([[0], np.repeat(np.arange(1, H + 1), 2)])
        sine = np.concatenate([[False], np.tile([False, True], H)])
        row, col = k[:, None], k[None, :]
        difference, total = np.abs(row - col), row + col
        rs, cs = sine[:, None], sine[None, :]
        mixed, imaginary = rs != cs, 2 * H + 1
        half = np.where(row == 0, 0.5, 1.0)
        sign = np.where(mixed, np.where(rs, -1.0, 1.0) * np.sign(row - col), 1.0)
        self._index = np.array([difference, total]) + imaginary * mixed
        # cos-cos +, sin-sin -, mixed -
        self._sign = np.array([half * sign, half * np.where(mixed | (rs & cs), -1.0, 1.0)])

    def __call__(self, kappa: ComplexArray) -> Array:
        """(m, 2H + 1) coefficients 0..2H -> (m, 2H + 1, 2H + 1)."""
        r = np.concatenate([kappa.real, kappa.imag], axis=-1)
        parts = r.take(self._index, axis=1)
        parts *= self._sign
        both: Array = parts[:, 0] + parts[:, 1]
        return both


def real_blocks(Z: ComplexArray) -> Array:
    """Real matrices (P, m, n, m, n) of d_k -> Z_k d_k in the basis (a0, a1, b1, ...), n = 2H + 1, Z (P, H+1, m, m)."""
    P, K, m = Z.shape[:3]
    n = 2 * K - 1
    J = np.zeros((P, m * n * m * n))
    to, place, sign = _blocks(K, m)
    J[:, to] = np.ascontiguousarray(Z).view(float).reshape(P, -1).take(place, axis=1) * sign
    return J.reshape(P, m, n, m, n)


@lru_cache(maxsize=32)
def _blocks(K: int, m: int) -> tuple[np.ndarray, np.ndarray, Array]:
    """Where in the matrix entries go that come from real and imaginary parts of Z (K, m, m), where from, and signs."""
    n = 2 * K - 1
    matrix, parts = np.arange((m * n) ** 2).reshape(m, n, m, n), np.arange(2 * K * m * m).reshape(K, m, m, 2)
    i, j = np.meshgrid(np.arange(m), np.arange(m), indexing="ij")
    to, place, sign = [matrix[i, 0, j, 0]], [parts[0, ..., 0]], [np.ones((m, m))]
    for k in range(1, K):
        a, b = 2 * k - 1, 2 * k
        for row, column, part, factor in ((a, a, 0, 1.0), (b, b, 0, 1.0), (a, b, 1, 1.0), (b, a, 1, -1.0)):
            to.append(matrix[i, row, j, column])
            place.append(parts[k, ..., part])
            sign.append(np.full((m, m), factor))
    return np.ravel(to), np.ravel(place), np.ravel(sign)


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
