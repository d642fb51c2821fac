"""Kernels: receptances and dynamic stiffnesses of the linear structure.

G(w) = sum_r a_r b_r^T / (i w - lambda_r),   Z = G^-1 - kr

or, for elements close to each other, Z = K + i w C - w^2 (M + sum_r a_r b_r^T / (i w - lambda_r)) - kr with the poles
of fixed elements, see `hbgear.harmonic.structure.fixed_interface`.

Poles far above the frequencies, |lambda_r| >= 4 w, are summed as a power series in i w, whose coefficients are computed
once for several radii (`PackedLinearPart.far_series`):

    sum_far a_r b_r^T / (i w - lambda_r) = sum_j c_j (i w / radius)^j
    c_j = -sum_far a_r b_r^T radius^j / lambda_r^(j + 1)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import inlined, kernel

FAR_POLE_RATIO = 4.0
"""Pole over frequency [-] above which a pole is part of the power series."""


@kernel
def receptance(linear: Any, count: int, w: Any, pole_terms: Any, sums: Any) -> None:
    """Fill sums (4, N, K) with the first N receptances sum_r residue_r / (i w - pole_r) at K frequencies w.

    sums[0] and sums[1] are the real and imaginary parts, sums[2] and sums[3] those of i times the derivative in w.
    pole_terms (2, K) is working memory.
    """
    poles, residues = linear.poles, linear.residues
    sums[:, :, :] = 0.0
    for r in range(_add_far_poles(linear, count, w, pole_terms, sums)):
        for k in range(w.shape[0]):  # the inner loop over frequencies is vectorized
            a, b = -poles[0, r], w[k] - poles[1, r]
            size = 1.0 / (a * a + b * b)
            pole_terms[0, k], pole_terms[1, k] = a * size, -b * size
        for i in range(count):
            c, d, x, y, u, v = residues[i, 0, r], residues[i, 1, r], sums[0, i], sums[1, i], sums[2, i], sums[3, i]
            for k in range(w.shape[0]):
                a, b = pole_terms[0, k], pole_terms[1, k]
                p, q = c * a - d * b, c * b + d * a
                x[k] += p
                y[k] += q
                u[k] += p * a - q * b
                v[k] += p * b + q * a


@kernel
def _add_far_poles(linear: Any, count: int, w: Any, pole_terms: Any, sums: Any) -> int:
    """Set sums to the power series of the far poles, by Horner's rule, and return the number of the other poles."""
    highest = 0.0
    for k in range(w.shape[0]):
        highest = max(highest, abs(w[k]))
    band: Any = np.int64(0)
    while band < linear.radius.shape[0] and linear.radius[band] < FAR_POLE_RATIO * highest:
        band += 1
    if band == linear.radius.shape[0]:
        return int(linear.poles.shape[1])
    scale = 1.0 / linear.radius[band]
    for k in range(w.shape[0]):
        pole_terms[0, k] = w[k] * scale
    z = pole_terms[0]
    for i in range(count):
        x, y, u, v = sums[0, i], sums[1, i], sums[2, i], sums[3, i]
        for j in range(linear.far_series.shape[1] - 1, -1, -1):
            c, d = linear.far_series[band, j, i, 0], linear.far_series[band, j, i, 1]
            for k in range(w.shape[0]):
                u[k], v[k] = x[k] - v[k] * z[k], y[k] + u[k] * z[k]
                x[k], y[k] = c - y[k] * z[k], d + x[k] * z[k]
        for k in range(w.shape[0]):
            u[k], v[k] = -u[k] * scale, -v[k] * scale
    return int(linear.near_count[band])


@kernel
def _invert(A: Any, m: int, out: Any) -> None:
    """Compute the inverses of the first m rows and columns of K complex matrices; A is overwritten.

    The method is Gauss-Jordan elimination with pivoting. The inverse of a singular matrix is nan.
    """
    for n in range(A.shape[0]):
        for i in range(m):
            for j in range(m):
                out[n, i, j] = 1.0 if i == j else 0.0
        for j in range(m):
            p = j
            for i in range(j + 1, m):
                if _size(A[n, i, j]) > _size(A[n, p, j]):
                    p = i
            pivot = 1.0 / A[n, p, j] if A[n, p, j] != 0.0 else complex(math.nan, math.nan)
            for k in range(m):
                A[n, p, k], A[n, j, k] = A[n, j, k], A[n, p, k] * pivot
                out[n, p, k], out[n, j, k] = out[n, j, k], out[n, p, k] * pivot
            for i in range(m):
                f = A[n, i, j]
                if i != j:
                    for k in range(m):
                        A[n, i, k] -= f * A[n, j, k]
                        out[n, i, k] -= f * out[n, j, k]


@kernel
def _size(z: complex) -> float:
    """Return |Re z| + |Im z|, which needs no square root."""
    return abs(z.real) + abs(z.imag)


@kernel
def _multiply(A: Any, B: Any, factor: float, m: int, out: Any) -> None:
    """Set out to factor A B for the first m rows and columns of K matrices."""
    for n in range(A.shape[0]):
        for i in range(m):
            for j in range(m):
                total = 0j
                for k in range(m):
                    total += A[n, i, k] * B[n, k, j]
                out[n, i, j] = factor * total


@kernel
def linear_part(linear: Any, Omega: float, matrices: Any, constants: Any) -> None:
    """Call `fill_linear_part` from Python, with working memory of its own."""
    K, m = linear.orders.shape[0], matrices.shape[2]
    sums, work = np.empty((4, linear.residues.shape[0], K)), np.empty((3, K, m, m), np.complex128)
    fill_linear_part(linear, Omega, np.empty(K), np.empty((2, K)), sums, work, matrices, constants)


@kernel
def fill_linear_part(
    linear: Any, Omega: float, w: Any, pole_terms: Any, sums: Any, work: Any, matrices: Any, constants: Any
) -> None:
    """Fill matrices with Z and dZ/dOmega (2, K + 1, m, m) and constants with g and dg/dOmega (2, K + 1, m).

    Elements with dependent directions have springs only. w, pole_terms, sums and work are working memory, see
    `Workspace`.
    """
    m, orders, springs, prescribed = matrices.shape[2], linear.orders, linear.springs, linear.prescribed
    K = orders.shape[0]
    for k in range(K):
        w[k] = Omega * (orders[k] / linear.nu)
    receptance(linear, linear.residues.shape[0], w, pole_terms, sums)
    if linear.polynomial.shape[0]:
        _fixed_stiffnesses(linear.polynomial, sums, w, orders, linear.nu, matrices)
    else:
        _stiffnesses(sums, orders, linear.nu, linear.independent, work, matrices)
    for k in range(K):
        for i in range(m):
            e, loss = prescribed[k, i], orders[k] / linear.nu * springs[1, i]
            g, dg = -complex(springs[0, i], Omega * loss) * e, complex(0.0, -loss) * e
            for j in range(m):
                g += matrices[0, k, i, j] * prescribed[k, j]
                dg += matrices[1, k, i, j] * prescribed[k, j]
            constants[0, k, i], constants[1, k, i] = g, dg
    for n in range(linear.loads.shape[0]):
        power, k = linear.loads[n]
        growth, slope = Omega**power, power * Omega ** (power - 1.0)
        for j in range(m):
            row, ratio = m * (m + n) + j, orders[k] / linear.nu
            y, dy = complex(sums[0, row, k], sums[1, row, k]), ratio * complex(sums[3, row, k], -sums[2, row, k])
            if linear.polynomial.shape[0]:  # forces at fixed elements
                dy, y = ratio * 1j * y + 1j * w[k] * dy, linear.static[n, j] + 1j * w[k] * y
            y, dy = growth * y, growth * dy + slope * y
            if linear.polynomial.shape[0]:
                constants[0, k, j] -= y
                constants[1, k, j] -= dy
                continue
            for i in range(m):
                constants[0, k, i] -= matrices[0, k, i, j] * y
                constants[1, k, i] -= matrices[1, k, i, j] * y + matrices[0, k, i, j] * dy
    for k in range(K):
        for i in range(m):
            matrices[0, k, i, i] -= springs[0, i]


@kernel
def _fixed_stiffnesses(polynomial: Any, sums: Any, w: Any, orders: Any, nu: int, matrices: Any) -> None:
    """Fill matrices with Y = K + i w C - w^2 (M + sum) and dY/dOmega of all orders."""
    m = matrices.shape[2]
    for i in range(m):
        for j in range(m):
            n, K, C, M = i * m + j, polynomial[0, i, j], polynomial[1, i, j], polynomial[2, i, j]
            for k in range(w.shape[0]):
                x, y = M + sums[0, n, k], sums[1, n, k]
                dx, dy, square = sums[3, n, k], -sums[2, n, k], w[k] * w[k]
                matrices[0, k, i, j] = complex(K - square * x, w[k] * C - square * y)
                slope = complex(-2.0 * w[k] * x - square * dx, C - 2.0 * w[k] * y - square * dy)
                matrices[1, k, i, j] = orders[k] / nu * slope


@inlined
def _stiffnesses(sums: Any, orders: Any, nu: int, independent: Any, work: Any, matrices: Any) -> None:
    """Fill matrices with Y = G^-1 and dY/dOmega = -Y dG/dOmega Y of all orders; nan where G is singular.

    G is that of the independent elements; entries of the others are zero.
    """
    K, m, size = orders.shape[0], matrices.shape[2], independent.shape[0]
    if m == 1:  # most models have one element
        for k in range(K):
            G, dG = complex(sums[0, 0, k], sums[1, 0, k]), complex(sums[3, 0, k], -sums[2, 0, k])
            Y = 1.0 / G if G != 0.0 else complex(math.nan, math.nan)
            matrices[0, k, 0, 0], matrices[1, k, 0, 0] = Y, -orders[k] / nu * Y * Y * dG
        return
    for k in range(K):
        for i in range(size):
            for j in range(size):
                n, ratio = independent[i] * m + independent[j], orders[k] / nu
                work[0, k, i, j] = complex(sums[0, n, k], sums[1, n, k])
                work[1, k, i, j] = ratio * complex(sums[3, n, k], -sums[2, n, k])
    if size < m:
        matrices[:, :, :, :] = 0j
    _invert(work[0], size, matrices[0])
    _multiply(work[1], matrices[0], 1.0, size, work[2])
    _multiply(matrices[0], work[2], -1.0, size, matrices[1])
    if size < m:
        _move_to(independent, matrices[0])
        _move_to(independent, matrices[1])


@kernel
def _move_to(places: Any, A: Any) -> None:
    """Move the first rows and columns of K matrices to ascending places, the last ones first."""
    for n in range(A.shape[0]):
        for i in range(places.shape[0] - 1, -1, -1):
            for j in range(places.shape[0] - 1, -1, -1):
                x = A[n, i, j]
                A[n, i, j] = 0j
                A[n, places[i], places[j]] = x
