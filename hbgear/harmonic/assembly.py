"""Kernels: the balance of one motion, its residual, Jacobian and derivative in Omega.

    R_k(d) = Z_k(Omega) d_k + g_k(Omega) + f_k(d) = 0,   k = 0..H

in the real basis (a0, a1, b1, ..., aH, bH) of each element: with the two-sided coefficients kappa = r + i s,

    T[a_k, a_l] = r_{k-l} + r_{k+l},   T[a_k, b_l] = s_{k-l} - s_{k+l},
    T[b_k, b_l] = r_{k-l} - r_{k+l},   T[b_k, a_l] = -s_{k-l} - s_{k+l}

is the matrix of the product with kappa, r_{-n} = r_n and s_{-n} = -s_n; row 0 is the half of a_0's.

Of these harmonics only the orders of the table are unknowns, if there are fewer: all others are zero in the motion, and
their equations are left out.

The linear part comes from the poles of the structure, G(w) = sum_r a_r b_r^T / (i w - lambda_r); see `receptance`.

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.compiling import kernel
from hbgear.harmonic.projection import projected
from hbgear.harmonic.sampling import samples_of, spectrum

_MANY = 64  # poles from which their terms are computed several at once


@kernel
def receptance(poles: Any, residues: Any, w: float, G: Any, dG: Any) -> None:
    """G (m, m) and dG/dw at a frequency."""
    m = G.shape[0]
    if m == 1:
        G[0, 0], dG[0, 0] = _modal_sum(poles, residues[0], w)
        return
    each = np.empty((2, poles.shape[1]))  # 1 / (i w - pole)
    for k in range(poles.shape[1]):
        a, b = -poles[0, k], w - poles[1, k]
        size = 1.0 / (a * a + b * b)
        each[0, k], each[1, k] = a * size, -b * size
    for i in range(m):
        for j in range(m):
            G[i, j], dG[i, j] = _weighted_sum(each, residues[i * m + j])


@kernel
def _weighted_sum(each: Any, residues: Any) -> tuple[complex, complex]:
    """`_modal_sum` of known 1 / (i w - pole)."""
    x = y = u = v = 0.0
    for k in range(each.shape[1]):
        a, b = each[0, k], each[1, k]
        p, q = residues[0, k] * a - residues[1, k] * b, residues[0, k] * b + residues[1, k] * a
        x, y = x + p, y + q
        u, v = u + p * a - q * b, v + p * b + q * a
    return complex(x, y), complex(v, -u)


@kernel
def _modal_sum(poles: Any, residues: Any, w: float) -> tuple[complex, complex]:
    """sum_k residue_k / (i w - pole_k), and its derivative in w."""
    x = y = u = v = 0.0
    n = poles.shape[1]
    if n < _MANY:
        for k in range(n):
            p, q, r, s = _term(poles, residues, w, k)
            x, y, u, v = x + p, y + q, u + r, v + s
        return complex(x, y), complex(v, -u)
    terms = np.empty((4, n))  # all of them before the sums, so that processors compute several at once
    for k in range(n):
        terms[0, k], terms[1, k], terms[2, k], terms[3, k] = _term(poles, residues, w, k)
    for k in range(n):
        x, y, u, v = x + terms[0, k], y + terms[1, k], u + terms[2, k], v + terms[3, k]
    return complex(x, y), complex(v, -u)


@kernel
def _term(poles: Any, residues: Any, w: float, k: int) -> tuple[float, float, float, float]:
    """residue / (i w - pole) and residue / (i w - pole)^2 of one pole, real and imaginary parts."""
    a, b = -poles[0, k], w - poles[1, k]
    size = 1.0 / (a * a + b * b)
    a, b = a * size, -b * size  # 1 / (i w - pole)
    p, q = residues[0, k] * a - residues[1, k] * b, residues[0, k] * b + residues[1, k] * a
    return p, q, p * a - q * b, p * b + q * a


@kernel
def inverse(A: Any, out: Any) -> None:
    """A^-1 (m, m) complex, by Gauss and Jordan with exchanges of rows; A is lost. All nan if it is singular."""
    m = A.shape[0]
    for i in range(m):
        for j in range(m):
            out[i, j] = 1.0 if i == j else 0.0
    for j in range(m):
        p = j
        for i in range(j + 1, m):
            if abs(A[i, j]) > abs(A[p, j]):
                p = i
        for k in range(m):
            A[j, k], A[p, k] = A[p, k], A[j, k]
            out[j, k], out[p, k] = out[p, k], out[j, k]
        if A[j, j] == 0.0:
            for i in range(m):
                for k in range(m):
                    out[i, k] = complex(math.nan, math.nan)
            return
        pivot = 1.0 / A[j, j]
        for k in range(m):
            A[j, k] *= pivot
            out[j, k] *= pivot
        for i in range(m):
            f = A[i, j]
            if i != j and f != 0.0:
                for k in range(m):
                    A[i, k] -= f * A[j, k]
                    out[i, k] -= f * out[j, k]


@kernel
def linear_part(linear: Any, Omega: float, matrices: Any, constants: Any) -> None:
    """Z and dZ/dOmega (2, K + 1, m, m), g and dg/dOmega (2, K + 1, m) of all orders."""
    m, nu, orders = matrices.shape[2], linear.nu, linear.orders
    poles, residues, springs, moved = linear.poles, linear.residues, linear.springs, linear.moved
    G, dG = np.empty((m, m), dtype=np.complex128), np.empty((m, m), dtype=np.complex128)
    first = residues[0]
    for k in range(orders.shape[0]):
        ratio = orders[k] / nu
        w = Omega * ratio
        if m == 1:  # the usual case: parts of arrays would take longer to make than all that is computed with them
            matrices[0, k, 0, 0], matrices[1, k, 0, 0] = _stiffness(poles, first, w, ratio)
        else:
            receptance(poles, residues, w, G, dG)
            inverse(G, matrices[0, k])
            _change(matrices[0, k], dG, -ratio, matrices[1, k])
        for i in range(m):
            e = moved[k, i]
            constants[0, k, i] = -(springs[0, i] + 1j * w * springs[1, i]) * e
            constants[1, k, i] = -1j * ratio * springs[1, i] * e
            for j in range(m):
                constants[0, k, i] += matrices[0, k, i, j] * moved[k, j]
                constants[1, k, i] += matrices[1, k, i, j] * moved[k, j]
    for n in range(linear.loads.shape[0]):
        _add_load(linear, Omega, n, matrices, constants)
    for k in range(orders.shape[0]):
        for i in range(m):
            matrices[0, k, i, i] -= springs[0, i]


@kernel
def _stiffness(poles: Any, residues: Any, w: float, ratio: float) -> tuple[complex, complex]:
    """1 / G of a single element, and its derivative in Omega = w / ratio; nan where G is zero."""
    G, dG = _modal_sum(poles, residues, w)
    if G == 0.0:
        return complex(math.nan, math.nan), complex(math.nan, math.nan)
    Y = 1.0 / G
    return Y, -ratio * Y * Y * dG


@kernel
def _change(Y: Any, dG: Any, factor: float, dY: Any) -> None:
    """dY = factor Y dG Y; dG is lost."""
    m = Y.shape[0]
    row = np.empty(m, dtype=np.complex128)
    for k in range(m):
        for j in range(m):
            row[j] = 0j
            for n in range(m):
                row[j] += dG[k, n] * Y[n, j]
        for j in range(m):
            dG[k, j] = row[j]
    for i in range(m):
        for j in range(m):
            total = 0j
            for k in range(m):
                total += Y[i, k] * dG[k, j]
            dY[i, j] = factor * total


@kernel
def _add_load(linear: Any, Omega: float, n: int, matrices: Any, constants: Any) -> None:
    """Add the response to load number n: -Y y with its derivative."""
    power, k, m = linear.loads[n, 0], linear.loads[n, 1], matrices.shape[2]
    ratio = linear.orders[k] / linear.nu
    for j in range(m):
        y, dy = _modal_sum(linear.poles, linear.drive[n, j], Omega * ratio)
        dy *= ratio
        if power:
            growth = Omega**power
            y, dy = growth * y, growth * dy + power * Omega ** (power - 1) * y
        for i in range(m):
            constants[0, k, i] -= matrices[0, k, i, j] * y
            constants[1, k, i] -= matrices[1, k, i, j] * y + matrices[0, k, i, j] * dy


@kernel
def assembled(numbers: Any, X: Any, omega: float, matrices: Any, constants: Any, R: Any, J: Any, dR: Any) -> float:
    """R (n,), dR/dX (n, n) and dR/dOmega (n,) of a motion X (n,) at Omega / nu; the size of the terms of R."""
    m, orders = matrices.shape[2], numbers.linear.orders
    n = X.shape[0] // m
    some, rows = X.reshape(m, n), spread(numbers, X, m)
    kappa, chi, more = projected(numbers, rows, rows.shape[1] - 1)
    size_f = _forces(some, orders, kappa, chi, R, J)
    for j in range(m):
        if numbers.laws.cubic[j, 1] != 0.0:
            add_product(more[j], orders, J[j * n : (j + 1) * n, j * n : (j + 1) * n])
    size = size_f + _add_linear(some, matrices, constants, R, J, dR)
    for q in range(numbers.laws.own.shape[0]):
        size += _add_samples(numbers, rows, q, omega, R, J, dR)
    return size if size > 0.0 else 1.0


@kernel
def spread(numbers: Any, X: Any, m: int) -> Any:
    """Rows (m, 2H + 1) of all harmonics from unknowns X (n,), which are some of them."""
    orders, some = numbers.linear.orders, X.reshape(m, -1)
    if some.shape[1] == numbers.basis.shape[0]:
        return some
    rows = np.zeros((m, numbers.basis.shape[0]))
    for j in range(m):
        rows[j, 0] = some[j, 0]
        for i in range(1, orders.shape[0]):
            rows[j, 2 * orders[i] - 1], rows[j, 2 * orders[i]] = some[j, 2 * i - 1], some[j, 2 * i]
    return rows


@kernel
def curvature(numbers: Any, X: Any, v: Any, h: float, change: Any, along: Any, across: Any) -> None:
    """Derivatives (n, n) of dR/dX along v (n,), by a central difference over 2 h, and in Omega; change: dZ/dOmega."""
    m, n, orders = change.shape[1], X.shape[0] // change.shape[1], numbers.linear.orders
    along[:, :] = 0.0
    across[:, :] = 0.0
    for sign in (1.0, -1.0):
        rows = spread(numbers, X + sign * h * v, m)
        kappa, _, more = projected(numbers, rows, rows.shape[1] - 1)
        for j in range(m):
            for k in range(kappa.shape[1]):
                kappa[j, k] = (kappa[j, k] + more[j, k]) * (sign / (2 * h))
            add_product(kappa[j], orders, along[j * n : (j + 1) * n, j * n : (j + 1) * n])
    for k in range(change.shape[0]):
        for i in range(m):
            for j in range(m):
                _add_harmonic(change[k, i, j], k, across, i * n, j * n)


@kernel
def _add_harmonic(Z: complex, k: int, J: Any, row: int, column: int) -> None:
    """Add the product of harmonic number k of the unknowns with a complex number, in the real basis, from a corner."""
    if k == 0:
        J[row, column] += Z.real
        return
    a, b = 2 * k - 1, 2 * k
    J[row + a, column + a] += Z.real
    J[row + b, column + b] += Z.real
    J[row + a, column + b] += Z.imag
    J[row + b, column + a] -= Z.imag


@kernel
def _forces(rows: Any, orders: Any, kappa: Any, chi: Any, R: Any, J: Any) -> float:
    """R = T(kappa) d + chi, J = T(kappa); the norm of R."""
    m, n = rows.shape
    J[:, :] = 0.0
    total = 0.0
    for j in range(m):
        T = J[j * n : (j + 1) * n, j * n : (j + 1) * n]
        add_product(kappa[j], orders, T)
        for a in range(n):
            f = 0.0
            for b in range(n):
                f += T[a, b] * rows[j, b]
            k = orders[(a + 1) // 2]
            f += chi[j, k].real * (2.0 if a else 1.0) if a % 2 or a == 0 else -2.0 * chi[j, k].imag
            R[j * n + a] = f
            total += f * f
    return math.sqrt(total)


@kernel
def add_product(kappa: Any, orders: Any, T: Any) -> None:
    """Add the matrix of the product with kappa, in the real basis of some orders, of which the first is 0."""
    K = orders.shape[0]
    T[0, 0] += kappa[0].real
    for k in range(1, K):
        r, s = kappa[orders[k]].real, kappa[orders[k]].imag
        T[0, 2 * k - 1] += r
        T[0, 2 * k] -= s
        T[2 * k - 1, 0] += 2 * r
        T[2 * k, 0] -= 2 * s
    for k in range(1, K):
        for i in range(1, K):
            apart, both = orders[k] - orders[i], orders[k] + orders[i]
            r, s = kappa[abs(apart)].real, kappa[abs(apart)].imag
            if apart < 0:
                s = -s
            p, q = kappa[both].real, kappa[both].imag
            T[2 * k - 1, 2 * i - 1] += r + p
            T[2 * k - 1, 2 * i] += s - q
            T[2 * k, 2 * i - 1] -= s + q
            T[2 * k, 2 * i] += r - p


@kernel
def _add_linear(rows: Any, matrices: Any, constants: Any, R: Any, J: Any, dR: Any) -> float:
    """Add Z d + g to R, Z to J; dR = dZ d + dg; the norms of Z d and g together."""
    m, n = rows.shape
    moved = held = 0.0
    for k in range(matrices.shape[1]):
        a, b = 2 * k - 1, 2 * k
        for i in range(m):
            zd = dzd = 0j
            for j in range(m):
                d = complex(rows[j, a], -rows[j, b]) if k else complex(rows[j, 0], 0.0)
                Z = matrices[0, k, i, j]
                zd += Z * d
                dzd += matrices[1, k, i, j] * d
                _add_harmonic(Z, k, J, i * n, j * n)
            g, dg = constants[0, k, i], dzd + constants[1, k, i]
            moved += zd.real**2 + zd.imag**2
            held += g.real**2 + g.imag**2
            if k:
                R[i * n + a] += zd.real + g.real
                R[i * n + b] -= zd.imag + g.imag
                dR[i * n + a], dR[i * n + b] = dg.real, -dg.imag
            else:
                R[i * n] += zd.real + g.real
                dR[i * n] = dg.real
    return math.sqrt(moved) + math.sqrt(held)


@kernel
def _add_samples(numbers: Any, rows: Any, which: int, omega: float, R: Any, J: Any, dR: Any) -> float:
    """Add what a compiled law says to R, J and dR; the norm of its forces."""
    j, orders, nu = numbers.laws.own[which], numbers.linear.orders, numbers.linear.nu
    n, total = 2 * orders.shape[0] - 1, 0.0
    samples, part = samples_of(numbers, rows, which, omega), np.empty(rows.shape[1], dtype=np.complex128)
    spectrum(samples[:, 0], numbers.basis, part)
    for i in range(orders.shape[0]):
        k = orders[i]
        a, b = (2.0 * part[k].real, -2.0 * part[k].imag) if i else (part[0].real, 0.0)
        total += a * a + b * b
        R[j * n + (2 * i - 1 if i else 0)] += a
        if i:
            R[j * n + 2 * i] += b
    spectrum(samples[:, 1], numbers.basis, part)
    T = J[j * n : (j + 1) * n, j * n : (j + 1) * n]
    add_product(part, orders, T)
    spectrum(samples[:, 2], numbers.basis, part)
    damping = np.zeros((n, n))
    add_product(part, orders, damping[:n, :n])  # a part of a matrix as above, not another kernel
    grid = numbers.corners.grid
    if grid.shape[2]:
        spectrum(samples[:, 2] * grid[1, j], numbers.basis, part)
        for i in range(orders.shape[0]):
            k = orders[i]
            a, b = (2.0 * part[k].real, -2.0 * part[k].imag) if i else (part[0].real, 0.0)
            dR[j * n + (2 * i - 1 if i else 0)] += a / nu
            if i:
                dR[j * n + 2 * i] += b / nu
    for a in range(n):
        for i in range(1, orders.shape[0]):
            p, q = damping[a, 2 * i - 1] * orders[i], damping[a, 2 * i] * orders[i]
            T[a, 2 * i - 1] -= omega * q
            T[a, 2 * i] += omega * p
            dR[j * n + a] += (p * rows[j, 2 * orders[i]] - q * rows[j, 2 * orders[i] - 1]) / nu
    return math.sqrt(total)


@kernel
def linearised(numbers: Any, u: Any, R: Any, J: Any, dR: Any, matrices: Any, constants: Any) -> float:
    """`assembled` at u = (X, Omega) of a model with poles; matrices and constants are room for its linear part."""
    Omega = u[u.shape[0] - 1]
    linear_part(numbers.linear, Omega, matrices, constants)
    return assembled(numbers, u[: u.shape[0] - 1], Omega / numbers.linear.nu, matrices, constants, R, J, dR)
