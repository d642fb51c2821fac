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
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.compiling import inlined, kernel
from hbgear.harmonic.projection import Space, coefficient, project, space_of
from hbgear.harmonic.sampling import samples_of, spectrum
from hbgear.mechanics.summing import put_waves


@kernel
def receptance(poles: Any, residues: Any, w: Any, each: Any, sums: Any) -> None:
    """sum_r residue_r / (i w - pole_r) of N rows at K frequencies w, and i times the derivative in w: sums (4, N, K).

    They are real and imaginary part of the one and of the other. each : (2, K) room.
    """
    sums[:, :, :] = 0.0
    for r in range(poles.shape[1]):
        for k in range(w.shape[0]):  # all frequencies together, several of them at once
            a, b = -poles[0, r], w[k] - poles[1, r]
            size = 1.0 / (a * a + b * b)
            each[0, k], each[1, k] = a * size, -b * size
        for i in range(residues.shape[0]):
            c, d, x, y, u, v = residues[i, 0, r], residues[i, 1, r], sums[0, i], sums[1, i], sums[2, i], sums[3, i]
            for k in range(w.shape[0]):
                a, b = each[0, k], each[1, k]
                p, q = c * a - d * b, c * b + d * a
                x[k] += p
                y[k] += q
                u[k] += p * a - q * b
                v[k] += p * b + q * a


@kernel
def _invert(A: Any, out: Any) -> None:
    """A^-1 of K complex matrices (K, m, m), by Gauss and Jordan with exchanges of rows; A is lost. nan if singular."""
    m = A.shape[1]
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
    return abs(z.real) + abs(z.imag)


@kernel
def _multiply(A: Any, B: Any, factor: float, out: Any) -> None:
    """out = factor A B of K matrices (K, m, m)."""
    m = A.shape[1]
    for n in range(A.shape[0]):
        for i in range(m):
            for j in range(m):
                total = 0j
                for k in range(m):
                    total += A[n, i, k] * B[n, k, j]
                out[n, i, j] = factor * total


class Room(NamedTuple):
    """Arrays in which motions are evaluated, overwritten each time.

    space : see `Space`. rows (m, 2H + 1) : of the motion, see `spread`. matrices, constants : as of `put_linear`.
    w (K + 1,), each (2, K + 1), sums (4, N, K + 1), work (3, K + 1, m, m) : for these.
    """

    space: Space
    rows: Array
    matrices: ComplexArray
    constants: ComplexArray
    w: Array
    each: Array
    sums: Array
    work: ComplexArray


@kernel
def room_of(numbers: Any) -> Any:
    """A `Room` for motions of a model."""
    linear, m, H = numbers.linear, numbers.laws.cubic.shape[0], numbers.basis.shape[0] // 2
    K = linear.orders.shape[0]
    matrices, constants = np.zeros((2, K, m, m), np.complex128), np.zeros((2, K, m), np.complex128)
    w, each, sums = np.empty(K), np.empty((2, K)), np.empty((4, linear.residues.shape[0], K))
    space, rows, work = space_of(numbers, m, H, 2 * H), np.zeros((m, 2 * H + 1)), np.empty((3, K, m, m), np.complex128)
    return Room(space, rows, matrices, constants, w, each, sums, work)


@kernel
def linear_part(linear: Any, Omega: float, matrices: Any, constants: Any) -> None:
    """`put_linear` for calls from Python."""
    K, m = linear.orders.shape[0], matrices.shape[2]
    sums, work = np.empty((4, linear.residues.shape[0], K)), np.empty((3, K, m, m), np.complex128)
    put_linear(linear, Omega, np.empty(K), np.empty((2, K)), sums, work, matrices, constants)


@kernel
def put_linear(
    linear: Any, Omega: float, w: Any, each: Any, sums: Any, work: Any, matrices: Any, constants: Any
) -> None:
    """Z and dZ/dOmega (2, K + 1, m, m), g and dg/dOmega (2, K + 1, m) of all orders; the rest is as of `Room`."""
    m, orders, springs, moved = matrices.shape[2], linear.orders, linear.springs, linear.moved
    K = orders.shape[0]
    for k in range(K):
        w[k] = Omega * (orders[k] / linear.nu)
    receptance(linear.poles, linear.residues, w, each, sums)
    _stiffnesses(sums, orders, linear.nu, work, matrices)
    for k in range(K):
        for i in range(m):
            e, loss = moved[k, i], orders[k] / linear.nu * springs[1, i]
            g, dg = -complex(springs[0, i], Omega * loss) * e, complex(0.0, -loss) * e
            for j in range(m):
                g += matrices[0, k, i, j] * moved[k, j]
                dg += matrices[1, k, i, j] * moved[k, j]
            constants[0, k, i], constants[1, k, i] = g, dg
    for n in range(linear.loads.shape[0]):
        power, k = linear.loads[n]
        growth, slope = Omega**power, power * Omega ** (power - 1.0)
        for j in range(m):
            at, ratio = m * (m + n) + j, orders[k] / linear.nu
            y, dy = complex(sums[0, at, k], sums[1, at, k]), ratio * complex(sums[3, at, k], -sums[2, at, k])
            y, dy = growth * y, growth * dy + slope * y
            for i in range(m):
                constants[0, k, i] -= matrices[0, k, i, j] * y
                constants[1, k, i] -= matrices[1, k, i, j] * y + matrices[0, k, i, j] * dy
    for k in range(K):
        for i in range(m):
            matrices[0, k, i, i] -= springs[0, i]


@kernel
def _stiffnesses(sums: Any, orders: Any, nu: int, work: Any, matrices: Any) -> None:
    """Put Y = G^-1 and dY/dOmega = -Y dG/dOmega Y of all orders in matrices; nan where G is singular."""
    K, m = orders.shape[0], matrices.shape[2]
    if m == 1:  # the usual case
        for k in range(K):
            G, dG = complex(sums[0, 0, k], sums[1, 0, k]), complex(sums[3, 0, k], -sums[2, 0, k])
            Y = 1.0 / G if G != 0.0 else complex(math.nan, math.nan)
            matrices[0, k, 0, 0], matrices[1, k, 0, 0] = Y, -orders[k] / nu * Y * Y * dG
        return
    for k in range(K):
        for i in range(m):
            for j in range(m):
                n, ratio = i * m + j, orders[k] / nu
                work[0, k, i, j] = complex(sums[0, n, k], sums[1, n, k])
                work[1, k, i, j] = ratio * complex(sums[3, n, k], -sums[2, n, k])
    _invert(work[0], matrices[0])
    _multiply(work[1], matrices[0], 1.0, work[2])
    _multiply(matrices[0], work[2], -1.0, matrices[1])


@kernel
def assembled(numbers: Any, X: Any, omega: float, matrices: Any, constants: Any, R: Any, J: Any, dR: Any) -> float:
    """`assemble` for calls from Python."""
    return assemble(numbers, X, omega, matrices, constants, R, J, dR, room_of(numbers))


@inlined
def assemble(
    numbers: Any, X: Any, omega: float, matrices: Any, constants: Any, R: Any, J: Any, dR: Any, room: Any
) -> float:
    """R (n,), dR/dX (n, n) and dR/dOmega (n,) of a motion X (n,) at Omega / nu; the size of the terms of R."""
    space, rows, some = room.space, room.rows, X.reshape(matrices.shape[2], -1)
    spread(numbers, X, rows)
    project(numbers, rows, space)
    size = _forces(rows, numbers.linear.orders, space, R, J) + _add_linear(some, matrices, constants, R, J, dR)
    size += _add_own(numbers.own, numbers, rows, omega, R, J, dR)
    return size if size > 0.0 else 1.0


@kernel
def spread(numbers: Any, X: Any, rows: Any) -> None:
    """Rows (m, 2H + 1) of all harmonics from unknowns X (n,), some of them; zero before where they are not."""
    orders, some = numbers.linear.orders, X.reshape(rows.shape[0], -1)
    for j in range(rows.shape[0]):
        rows[j, 0] = some[j, 0]
        for i in range(1, orders.shape[0]):
            rows[j, 2 * orders[i] - 1], rows[j, 2 * orders[i]] = some[j, 2 * i - 1], some[j, 2 * i]


@kernel
def curvature(numbers: Any, X: Any, v: Any, h: float, change: Any, along: Any, across: Any) -> None:
    """Derivatives (n, n) of dR/dX along v (n,), by a central difference over 2 h, and in Omega; change: dZ/dOmega."""
    m, n, orders = change.shape[1], X.shape[0] // change.shape[1], numbers.linear.orders
    room = room_of(numbers)
    space, rows, kappa, more = room.space, room.rows, room.space.kappa, room.space.more
    along[:, :] = 0.0
    across[:, :] = 0.0
    for sign in (1.0, -1.0):
        spread(numbers, X + sign * h * v, rows)
        project(numbers, rows, space)
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
def _forces(rows: Any, orders: Any, space: Any, R: Any, J: Any) -> float:
    """R = kappa d + chi, J = T(kappa + more), where more is added to kappa; the norm of R."""
    kappa, chi, more, c, n, total = space.kappa, space.chi, space.more, space.waves, 2 * orders.shape[0] - 1, 0.0
    J[:, :] = 0.0
    for j in range(rows.shape[0]):
        put_waves(rows[j], c)
        for i in range(orders.shape[0]):
            k, at = orders[i], j * n + 2 * i
            f = coefficient(kappa[j], c, k) + chi[j, k]
            if i:
                R[at - 1], R[at] = 2.0 * f.real, -2.0 * f.imag
                total += R[at - 1] ** 2 + R[at] ** 2
            else:
                R[at] = f.real
                total += R[at] ** 2
        for k in range(more.shape[1]):
            kappa[j, k] += more[j, k]
        add_product(kappa[j], orders, J[j * n : (j + 1) * n, j * n : (j + 1) * n])
    return math.sqrt(total)


@kernel
def add_product(kappa: Any, orders: Any, T: Any) -> None:
    """Add the matrix of the product with kappa, in the real basis of some orders, of which the first is 0.

    But for row 0 it is symmetric.
    """
    T[0, 0] += kappa[0].real
    for k in range(1, orders.shape[0]):
        r, s = kappa[orders[k]].real, kappa[orders[k]].imag
        T[0, 2 * k - 1] += r
        T[0, 2 * k] -= s
        T[2 * k - 1, 0] += 2 * r
        T[2 * k, 0] -= 2 * s
        for i in range(1, k + 1):
            apart, both = kappa[orders[k] - orders[i]], kappa[orders[k] + orders[i]]
            r, s, p, q = apart.real, apart.imag, both.real, both.imag
            T[2 * k - 1, 2 * i - 1] += r + p
            T[2 * k - 1, 2 * i] += s - q
            T[2 * k, 2 * i - 1] -= s + q
            T[2 * k, 2 * i] += r - p
            if i < k:
                T[2 * i - 1, 2 * k - 1] += r + p
                T[2 * i, 2 * k - 1] += s - q
                T[2 * i - 1, 2 * k] -= s + q
                T[2 * i, 2 * k] += r - p


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
def _add_own(own: Any, numbers: Any, rows: Any, omega: float, R: Any, J: Any, dR: Any) -> float:
    """Add what compiled laws say, if any, to R, J and dR; the norm of the forces of each, summed."""
    if own is None:
        return 0.0
    size = 0.0
    for q in range(own.element.shape[0]):
        size += _add_samples(own, numbers, rows, q, omega, R, J, dR)
    return size


@kernel
def _add_samples(own: Any, numbers: Any, rows: Any, which: int, omega: float, R: Any, J: Any, dR: Any) -> float:
    """Add what a compiled law says to R, J and dR; the norm of its forces."""
    j, orders, nu = own.element[which], numbers.linear.orders, numbers.linear.nu
    n, total = 2 * orders.shape[0] - 1, 0.0
    samples, part = samples_of(own, numbers, rows, which, omega), np.empty(rows.shape[1], dtype=np.complex128)
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
    _add_damped(numbers.corners, numbers, j, samples, part, dR)
    for a in range(n):
        for i in range(1, orders.shape[0]):
            p, q = damping[a, 2 * i - 1] * orders[i], damping[a, 2 * i] * orders[i]
            T[a, 2 * i - 1] -= omega * q
            T[a, 2 * i] += omega * p
            dR[j * n + a] += (p * rows[j, 2 * orders[i]] - q * rows[j, 2 * orders[i] - 1]) / nu
    return math.sqrt(total)


@kernel
def _add_damped(corners: Any, numbers: Any, j: int, samples: Any, part: Any, dR: Any) -> None:
    """Add the derivative in Omega of what the damping of a compiled law makes of displacements with corners to dR."""
    if corners is None:
        return
    orders, nu, grid = numbers.linear.orders, numbers.linear.nu, corners.grid
    n = 2 * orders.shape[0] - 1
    if grid.shape[2]:
        spectrum(samples[:, 2] * grid[1, j], numbers.basis, part)
        for i in range(orders.shape[0]):
            k = orders[i]
            a, b = (2.0 * part[k].real, -2.0 * part[k].imag) if i else (part[0].real, 0.0)
            dR[j * n + (2 * i - 1 if i else 0)] += a / nu
            if i:
                dR[j * n + 2 * i] += b / nu


@inlined
def linearised(numbers: Any, u: Any, R: Any, J: Any, dR: Any, room: Any) -> float:
    """`assemble` at u = (X, Omega) of a model with poles."""
    n = u.shape[0] - 1
    put_linear(numbers.linear, u[n], room.w, room.each, room.sums, room.work, room.matrices, room.constants)
    return assemble(numbers, u[:n], u[n] / numbers.linear.nu, room.matrices, room.constants, R, J, dR, room)
