"""Matrices of the real basis (a0, a1, b1, ..., aH, bH), in which the balance is solved."""

from __future__ import annotations

import numpy as np

from hbgear.fourier import Array, ComplexArray, derive, to_complex, to_real


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
        return parts[:, 0] + parts[:, 1]


def real_blocks(Z: ComplexArray) -> Array:
    """Real matrices (P, m, n, m, n) of d_k -> Z_k d_k in the basis (a0, a1, b1, ...), n = 2H + 1, Z (P, H+1, m, m)."""
    P, m, n = len(Z), Z.shape[-1], 2 * Z.shape[1] - 1
    J = np.zeros((P, m, n, m, n))
    J[:, :, 0, :, 0] = Z[:, 0].real
    re, im = Z.real[:, 1:].transpose(0, 2, 3, 1), Z.imag[:, 1:].transpose(0, 2, 3, 1)
    pairs = ((1, 1), (2, 2), (1, 2), (2, 1))
    diagonals = [np.einsum("piaja->pija", J[:, :, i::2, :, j::2]) for i, j in pairs]  # views
    diagonals[0][:], diagonals[1][:], diagonals[2][:] = re, re, im
    np.negative(im, out=diagonals[3])
    return J


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
