"""Kernels: residual of the balance of one motion, its Jacobian and its derivative in Omega.

    R_k(d) = Z_k(Omega) d_k + g_k(Omega) + f_k(d) = 0,   k = 0..H

The unknowns are the coefficients (a0, a1, b1, ..., aH, bH) of each element. With the two-sided coefficients
kappa = r + i s of a periodic stiffness,

    T[a_k, a_l] = r_{k-l} + r_{k+l},   T[a_k, b_l] = s_{k-l} - s_{k+l},
    T[b_k, b_l] = r_{k-l} - r_{k+l},   T[b_k, a_l] = -s_{k-l} - s_{k+l}

is the matrix of the product with kappa, where r_{-n} = r_n and s_{-n} = -s_n. The row of the mean a0 is half of
T[a_0, .].

If directions of elements are dependent, `tie` adds constraints, see `hbgear.harmonic.structure.receptance`. With a
harmonic selection only the selected orders are unknowns. All other harmonics are zero, and their equations are
omitted. The linear part is computed from the poles of the structure, G(w) = sum_r a_r b_r^T / (i w - lambda_r), see
`hbgear.harmonic.structure.receptance`.

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import inlined, kernel
from hbgear.harmonic.forces.aft_kernels import samples_of, spectrum
from hbgear.harmonic.forces.projection_kernels import ProjectionWorkspace, project, projection_workspace
from hbgear.harmonic.forces.slider_kernels import add_memory
from hbgear.harmonic.forces.toeplitz_kernel import add_product
from hbgear.harmonic.structure.receptance_kernels import fill_linear_part
from hbgear.mechanics.series.fourier_kernels import coefficient, fill_one_sided

CANCELLATION = 2.5e-4
"""Share of the terms of Z d in the size of R [-]: at a relative tolerance of 1e-10 about 100 roundings of them."""


class Workspace(NamedTuple):
    """Preallocated arrays for evaluations, overwritten by each one.

    Attributes
    ----------
    space : ProjectionWorkspace
        Arrays of the force projection.
    coefficients : ndarray, shape (m, 2H + 1)
        Coefficients of the motion with all harmonics, see `spread`.
    matrices, constants : ndarray
        Linear part, see `fill_linear_part`.
    w, pole_terms, sums, work : ndarray
        Working memory of `fill_linear_part`, of shapes (K + 1,), (2, K + 1), (4, N, K + 1) and (3, K + 1, m, m).
    """

    space: ProjectionWorkspace
    coefficients: Array
    matrices: ComplexArray
    constants: ComplexArray
    w: Array
    pole_terms: Array
    sums: Array
    work: ComplexArray


@kernel
def workspace_for(packed: Any) -> Any:
    """Return a `Workspace` for motions of a model."""
    linear, m, H = packed.linear, packed.laws.cubic.shape[0], packed.basis.shape[0] // 2
    K = linear.orders.shape[0]
    matrices, constants = np.zeros((2, K, m, m), np.complex128), np.zeros((2, K, m), np.complex128)
    w, pole_terms, sums = np.empty(K), np.empty((2, K)), np.empty((4, linear.residues.shape[0], K))
    space, coefficients = projection_workspace(packed, m, H, 2 * H), np.zeros((m, 2 * H + 1))
    work = np.empty((3, K, m, m), np.complex128)
    return Workspace(space, coefficients, matrices, constants, w, pole_terms, sums, work)


@kernel
def assemble_allocating(
    packed: Any, X: Any, omega: float, matrices: Any, constants: Any, R: Any, J: Any, dR: Any
) -> float:
    """Call `assemble` from Python with a new workspace."""
    return assemble(packed, X, omega, matrices, constants, R, J, dR, workspace_for(packed))


@inlined
def assemble(
    packed: Any, X: Any, omega: float, matrices: Any, constants: Any, R: Any, J: Any, dR: Any, workspace: Any
) -> float:
    """Fill R (n,), J = dR/dX (n, n), dR/dOmega (n,) at X (n,), omega = Omega / nu; return the size of its terms."""
    space, coefficients, unknowns = workspace.space, workspace.coefficients, X.reshape(matrices.shape[2], -1)
    spread(packed.linear.orders, X, coefficients)
    project(packed, coefficients, space)
    size = _fill_forces(coefficients, packed.linear.orders, space, R, J)
    size += _add_linear(unknowns, matrices, constants, R, J, dR)
    add_memory(packed.sliders, space.slides, packed.linear.orders, J)
    size += _add_compiled_laws(packed.user_laws, packed, coefficients, omega, R, J, dR)
    return size if size > 0.0 else 1.0


@kernel
def spread(orders: Any, X: Any, coefficients: Any) -> None:
    """Fill the selected harmonics of coefficients (m, 2H + 1) from unknowns X (n,); all others must be zero before."""
    rows = X.reshape(coefficients.shape[0], -1)
    for j in range(coefficients.shape[0]):
        coefficients[j, 0] = rows[j, 0]
        for i in range(1, orders.shape[0]):
            coefficients[j, 2 * orders[i] - 1], coefficients[j, 2 * orders[i]] = rows[j, 2 * i - 1], rows[j, 2 * i]


@inlined
def curvature(packed: Any, X: Any, v: Any, h: float, workspace: Any, dJ_dv: Any, dJ_dOmega: Any) -> None:
    """Compute the derivatives of dR/dX along a direction of X and in Omega.

    Parameters
    ----------
    packed : PackedModel
        Arrays of the model.
    X, v : ndarray, shape (n,)
        Unknowns, and the direction of the derivative.
    h : float
        Step of the central difference along v.
    workspace : Workspace
        Workspace with the linear part; the arrays of the force projection are overwritten.
    dJ_dv : ndarray, shape (n, n)
        Array to be filled with the derivative along v.
    dJ_dOmega : ndarray, shape (n, n)
        Array to be filled with the derivative in Omega.
    """
    dZ, orders, space = workspace.matrices[1], packed.linear.orders, workspace.space
    m, n, kappa, extra = dZ.shape[1], X.shape[0] // dZ.shape[1], space.kappa, space.extra
    shifted = np.empty(X.shape[0])
    dJ_dv[:, :] = 0.0
    dJ_dOmega[:, :] = 0.0
    for sign in (1.0, -1.0):
        for i in range(X.shape[0]):
            shifted[i] = X[i] + sign * h * v[i]
        spread(orders, shifted, workspace.coefficients)
        project(packed, workspace.coefficients, space)
        for j in range(m):
            for k in range(kappa.shape[1]):
                kappa[j, k] = (kappa[j, k] + extra[j, k]) * (sign / (2 * h))
            add_product(kappa[j], orders, dJ_dv[j * n : (j + 1) * n, j * n : (j + 1) * n])
    for k in range(dZ.shape[0]):
        for i in range(m):
            for j in range(m):
                _add_harmonic(dZ[k, i, j], k, dJ_dOmega, i * n, j * n)
    sum_forces(packed.linear, X.shape[0], dJ_dv)
    sum_forces(packed.linear, X.shape[0], dJ_dOmega)


@kernel
def _add_harmonic(Z: complex, k: int, J: Any, row: int, column: int) -> None:
    """Add the product of Z with the k-th harmonic of the unknowns, in the real basis, to the block at (row, column)."""
    if k == 0:
        J[row, column] += Z.real
        return
    a, b = 2 * k - 1, 2 * k
    J[row + a, column + a] += Z.real
    J[row + b, column + b] += Z.real
    J[row + a, column + b] += Z.imag
    J[row + b, column + a] -= Z.imag


@kernel
def _fill_forces(coefficients: Any, orders: Any, space: Any, R: Any, J: Any) -> float:
    """Set R to kappa d + chi and J to T(kappa + extra), the new kappa; return the norm of R."""
    kappa, chi, extra, c, n, total = space.kappa, space.chi, space.extra, space.waves, 2 * orders.shape[0] - 1, 0.0
    J[:, :] = 0.0
    for j in range(coefficients.shape[0]):
        fill_one_sided(coefficients[j], c)
        for i in range(orders.shape[0]):
            k, position = orders[i], j * n + 2 * i
            f = coefficient(kappa[j], c, k) + chi[j, k]
            if i:
                R[position - 1], R[position] = 2.0 * f.real, -2.0 * f.imag
                total += R[position - 1] ** 2 + R[position] ** 2
            else:
                R[position] = f.real
                total += R[position] ** 2
        for k in range(extra.shape[1]):
            kappa[j, k] += extra[j, k]
        add_product(kappa[j], orders, J[j * n : (j + 1) * n, j * n : (j + 1) * n])
    return math.sqrt(total)


@kernel
def _add_linear(coefficients: Any, matrices: Any, constants: Any, R: Any, J: Any, dR: Any) -> float:
    """Add Z d + g to R and Z to J, set dR to dZ d + dg; return the size of their terms.

    It is the norm of Z d plus the norm of g, and not below the rounding errors of Z d, because the terms of a stiff
    structure are large and cancel.
    """
    m, n = coefficients.shape
    stiffness_terms = constant_terms = cancelled_terms = 0.0
    for k in range(matrices.shape[1]):
        a, b = 2 * k - 1, 2 * k
        for i in range(m):
            zd = dzd = 0j
            magnitude = 0.0
            for j in range(m):
                d = complex(coefficients[j, a], -coefficients[j, b]) if k else complex(coefficients[j, 0], 0.0)
                Z = matrices[0, k, i, j]
                zd += Z * d
                magnitude += (abs(Z.real) + abs(Z.imag)) * (abs(d.real) + abs(d.imag))
                dzd += matrices[1, k, i, j] * d
                _add_harmonic(Z, k, J, i * n, j * n)
            g, dg = constants[0, k, i], dzd + constants[1, k, i]
            stiffness_terms += zd.real**2 + zd.imag**2
            cancelled_terms += magnitude**2
            constant_terms += g.real**2 + g.imag**2
            if k:
                R[i * n + a] += zd.real + g.real
                R[i * n + b] -= zd.imag + g.imag
                dR[i * n + a], dR[i * n + b] = dg.real, -dg.imag
            else:
                R[i * n] += zd.real + g.real
                dR[i * n] = dg.real
    return math.sqrt(stiffness_terms) + math.sqrt(constant_terms) + CANCELLATION * math.sqrt(cancelled_terms)


@kernel
def _add_compiled_laws(user_laws: Any, packed: Any, coefficients: Any, omega: float, R: Any, J: Any, dR: Any) -> float:
    """Add forces and slopes of compiled laws of the user, if any; return the sum of the norms of the forces."""
    if user_laws is None:
        return 0.0
    size = 0.0
    for q in range(user_laws.element.shape[0]):
        size += _add_samples(user_laws, packed, coefficients, q, omega, R, J, dR)
    return size


@inlined
def _add_samples(
    user_laws: Any, packed: Any, coefficients: Any, index: int, omega: float, R: Any, J: Any, dR: Any
) -> float:
    """Add forces and slopes of one compiled law, evaluated by AFT; return the norm of the forces."""
    j, orders, nu = user_laws.element[index], packed.linear.orders, packed.linear.nu
    n, total = 2 * orders.shape[0] - 1, 0.0
    samples = samples_of(user_laws, packed, coefficients, index, omega)
    part = np.empty(coefficients.shape[1], dtype=np.complex128)
    spectrum(samples[:, 0], packed.basis, part)
    for i in range(orders.shape[0]):
        k = orders[i]
        a, b = (2.0 * part[k].real, -2.0 * part[k].imag) if i else (part[0].real, 0.0)
        total += a * a + b * b
        R[j * n + (2 * i - 1 if i else 0)] += a
        if i:
            R[j * n + 2 * i] += b
    spectrum(samples[:, 1], packed.basis, part)
    T = J[j * n : (j + 1) * n, j * n : (j + 1) * n]
    add_product(part, orders, T)
    spectrum(samples[:, 2], packed.basis, part)
    damping = np.zeros((n, n))
    add_product(part, orders, damping[:n, :n])  # a slice has the type of T above, so no further kernel is compiled
    _add_damped(packed.piecewise, packed, j, samples, part, dR)
    for a in range(n):
        for i in range(1, orders.shape[0]):
            p, q = damping[a, 2 * i - 1] * orders[i], damping[a, 2 * i] * orders[i]
            T[a, 2 * i - 1] -= omega * q
            T[a, 2 * i] += omega * p
            dR[j * n + a] += (p * coefficients[j, 2 * orders[i]] - q * coefficients[j, 2 * orders[i] - 1]) / nu
    return math.sqrt(total)


@kernel
def tie(linear: Any, X: Any, R: Any, J: Any, dR: Any) -> None:
    """Replace the balances of elements with dependent directions by their constraints, see `LinearStructure`.

    Their forces act on the independent elements.
    """
    n, B, s = 2 * linear.orders.shape[0] - 1, linear.force_sums, linear.tie_stiffness
    sum_forces(linear, X.shape[0], J)
    for b in range(linear.dependent.shape[0]):
        for i in range(n):
            row = linear.dependent[b] * n + i
            force, slope = R[row], dR[row]
            R[row], dR[row], J[row, row] = linear.tie_offsets[b, i] + s * X[row], 0.0, s
            for a in range(linear.independent.shape[0]):
                other = linear.independent[a] * n + i
                R[other] += B[a, b] * force
                dR[other] += B[a, b] * slope
                R[row] -= s * B[a, b] * X[other]
                J[row, other] = -s * B[a, b]


@kernel
def sum_forces(linear: Any, size: int, J: Any) -> None:
    """Add the rows of dependent elements to those of independent ones, in the first ``size`` columns; set them to 0."""
    n = 2 * linear.orders.shape[0] - 1
    for b in range(linear.dependent.shape[0]):
        for i in range(n):
            row = linear.dependent[b] * n + i
            for c in range(size):
                x = J[row, c]
                if x != 0.0:  # most are zero
                    for a in range(linear.independent.shape[0]):
                        J[linear.independent[a] * n + i, c] += linear.force_sums[a, b] * x
                    J[row, c] = 0.0


@kernel
def _add_damped(piecewise: Any, packed: Any, j: int, samples: Any, part: Any, dR: Any) -> None:
    """Add to dR the damping force of a compiled law on prescribed displacements with breakpoints, over Omega."""
    if piecewise is None:
        return
    orders, nu, grid = packed.linear.orders, packed.linear.nu, piecewise.grid
    n = 2 * orders.shape[0] - 1
    if grid.shape[2]:
        spectrum(samples[:, 2] * grid[1, j], packed.basis, part)
        for i in range(orders.shape[0]):
            k = orders[i]
            a, b = (2.0 * part[k].real, -2.0 * part[k].imag) if i else (part[0].real, 0.0)
            dR[j * n + (2 * i - 1 if i else 0)] += a / nu
            if i:
                dR[j * n + 2 * i] += b / nu


@inlined
def residual_and_jacobian(packed: Any, u: Any, R: Any, J: Any, dR: Any, workspace: Any) -> float:
    """Call `assemble` at u = (X, Omega) for a structure with modes; return the size of the terms of R."""
    n = u.shape[0] - 1
    fill_linear_part(
        packed.linear,
        u[n],
        workspace.w,
        workspace.pole_terms,
        workspace.sums,
        workspace.work,
        workspace.matrices,
        workspace.constants,
    )
    size = assemble(
        packed, u[:n], u[n] / packed.linear.nu, workspace.matrices, workspace.constants, R, J, dR, workspace
    )
    tie(packed.linear, u[:n], R, J, dR)
    return size
