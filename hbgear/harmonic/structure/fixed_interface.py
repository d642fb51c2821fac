"""Dynamic stiffness of a structure at its elements from the modes with fixed elements, without an inverse.

Let q = P t + V y with the displacements t = W^T q of the elements, W^T V = 0, and static displacements P for unit t,
V^T K P = 0. Elimination of y from D(s) q = F - W u at s = i w gives, without loss of digits for any number of elements,

    Z(s) t + u = P^T F + s sum_r a_r (y_r F) / (s - lambda_r)
    Z(s) = K_t + s C_t + s^2 (M_t + sum_r a_r b_r / (s - lambda_r))
    K_t, C_t = P^T (K, C) P,   M_t = P^T M P - P^T M V (V^T M V)^-1 V^T M P
    a_r = -P^T (C + lambda_r M) x_r,   b_r = y_r (C + lambda_r M) P

x_r and y_r are the right and left modes with fixed elements, V (V^T D V)^-1 V^T = sum x_r y_r / (s - lambda_r). With
unsymmetric matrices the left P and V differ from the right ones.

References
----------
Craig & Bampton (1968), AIAA J. 6(7), 1313-1319, https://doi.org/10.2514/3.4741.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.structure.eigenmodes import (
    FREE_MOTION_TOLERANCE,
    MAX_EIGENVECTOR_CONDITION,
    modal_pairs,
    modes_of_states,
    real_shapes,
)
from hbgear.harmonic.structure.massless import massless_modes
from hbgear.mechanics.models import System

Matrices = tuple[Array, Array, Array]
"""M, C and K with the reference springs and dampers of the elements, (n, n) each."""


@dataclass(frozen=True)
class FixedInterface:
    """Dynamic stiffness Z and loads at the a elements with independent directions, see the module.

    Attributes
    ----------
    polynomial : ndarray, shape (3, a, a)
        K_t, C_t and M_t.
    poles : ndarray, shape (r,)
        Poles with fixed elements.
    output, input : ndarray, shapes (a, r) and (r, a)
        a_r and b_r.
    static, left : ndarray, shapes (a, n) and (r, n)
        Forces at the elements, and excitation of the modes y_r, by forces on the coordinates.
    """

    polynomial: Array
    poles: ComplexArray
    output: ComplexArray
    input: ComplexArray
    static: Array
    left: ComplexArray

    def stiffness(self, s: complex) -> ComplexArray:
        """Return Z (a, a) at an exponent s that is no pole."""
        K, C, M = self.polynomial
        return np.asarray(K + s * C + s**2 * (M + (self.output / (s - self.poles)) @ self.input))


def fixed_interface(
    system: System, matrices: Matrices, W: Array, bases: tuple[Array, Array], free: int
) -> FixedInterface | None:
    """Return the dynamic stiffness at independent directions W (n, a); None if the modes are not accurate.

    bases : right and left bases (n, p) of the coordinates without undamped free motions. free : number of free motions,
    with those that dampers act on.
    """
    M, C, K = matrices
    damped_free = free - (len(M) - bases[0].shape[1])
    if damped_free and (system.massless or not np.array_equal(C, C.T)):
        return None
    (P, V), (L, V_left) = (_split(basis, W) for basis in bases)
    k = V_left.T @ K @ V
    try:
        inverse = scipy.linalg.pinv(k, rtol=FREE_MOTION_TOLERANCE) if damped_free else np.linalg.inv(k)
        modes = _interior_modes(system, matrices, V, V_left)
    except np.linalg.LinAlgError:
        return None
    if modes is None or not np.isfinite(inverse).all():
        return None
    L = L - V_left @ (inverse.T @ (V.T @ (K.T @ L)))
    K_t = L.T @ K @ P
    P = P - V @ (inverse @ (V_left.T @ (K @ P)))
    poles, x, y = modes
    inertia, left_inertia = L.T @ M @ x, y @ M @ P
    output, input_ = -(L.T @ C @ x + poles * inertia), y @ C @ P + poles[:, None] * left_inertia
    C_t, M_t, static = L.T @ C @ P, L.T @ M @ P - ((inertia * poles) @ left_inertia).real, L.T
    # a free motion with a damper has a pole at zero, where s^2 / s and s / s are powers of s
    order = np.argsort(np.abs(poles), kind="stable")
    zero, others = order[:damped_free], order[damped_free:]
    C_t = C_t + (output[:, zero] @ input_[zero]).real
    static = static + (output[:, zero] @ y[zero]).real
    return FixedInterface(
        np.array([K_t, C_t, M_t]), poles[others], output[:, others], input_[others], static, y[others]
    )


def direct_stiffness(structure: Any, Omega: float, ratio: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return Z of the independent elements of a structure without accurate modes, and the forces Z W^T D^-1 F.

    Both are in one array (P, a, a + c), of F (n, c) at frequencies Omega ratio (P,), followed by its derivative in
    Omega. Large structures are solved with prescribed displacements d of the elements,

        [D    W] [q]   [F]
        [W^T  0] [u] = [d],   u = -Z d + Z W^T D^-1 F

    without the inverse of G, which has large rounding errors if elements are close to each other.
    """
    a, W = len(structure.independent), structure.W[:, structure.independent]
    if structure.large:
        parts = [_with_fixed_elements(structure, Omega * r, W, F) for r in ratio.tolist()]
        U, dU = (np.array(part) for part in zip(*parts, strict=True))
        return U, dU * ratio[:, None, None]
    x, dx = structure.response(Omega, ratio, np.column_stack([W, F]))
    (G, y), (dG, dy) = ((A[:, structure.independent, :a], A[:, structure.independent, a:]) for A in (x, dx))
    Z = np.linalg.inv(G)
    dZ = -(Z @ dG @ Z)
    return np.concatenate([Z, Z @ y], axis=2), np.concatenate([dZ, dZ @ y + Z @ dy], axis=2)


def _with_fixed_elements(structure: Any, w: float, W: Array, F: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return `direct_stiffness` at a frequency w, and its derivative in w, of a large structure."""
    (n, a), D = W.shape, structure.K + 1j * w * structure.C - w**2 * structure.M
    size = abs(D).max()  # of the borders: they are pivots
    border = size * scipy.sparse.csc_array(W)
    factors = scipy.sparse.linalg.splu(scipy.sparse.block_array([[D, border], [border.T, None]], format="csc"))
    sides = np.zeros((n + a, a + F.shape[1]), dtype=complex)
    sides[n:, :a], sides[:n, a:] = -size * np.eye(a), F
    x = factors.solve(sides)
    sides[:n], sides[n:] = 1j * (structure.C @ x[:n]) - 2 * w * (structure.M @ x[:n]), 0.0
    return size * x[n:], -size * factors.solve(sides)[n:]


def _split(basis: Array, W: Array) -> tuple[Array, Array]:
    """Return displacements P (n, a) with W^T P = 1, and a basis V (n, p - a) with W^T V = 0, within a basis (n, p)."""
    a = W.shape[1]
    Q, R = scipy.linalg.qr(basis.T @ W)
    inverse = scipy.linalg.solve_triangular(R[:a], np.eye(a))
    return basis @ (Q[:, :a] @ inverse.T), basis @ Q[:, a:]


def _interior_modes(
    system: System, matrices: Matrices, V: Array, V_left: Array
) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
    """Return poles (r,), right modes (n, r) and left modes (r, n) with fixed elements; None if not accurate."""
    M, C, K = matrices
    if system.massless:
        poles, right, left, condition = massless_modes(system, M, C, K, V, V_left)
        return (poles, right, left) if condition < MAX_EIGENVECTOR_CONDITION else None
    m, c, k = (V_left.T @ A @ V for A in (M, C, K))
    squares, shapes = np.zeros(1), V
    if np.array_equal(M, M.T) and np.array_equal(K, K.T):
        squares, shapes = real_shapes(m, k)
    if squares.all():
        D, shapes = shapes.T @ c @ shapes, V @ shapes
        pairs = modal_pairs(D, squares, shapes) if np.array_equal(C, C.T) else None
        if pairs is not None:
            return pairs[:3]
        w = np.sqrt(squares)
        states = D, np.diag(w), np.diag(w), shapes / w, shapes.T
    else:
        inverse = np.linalg.inv(m)
        k, c = inverse @ k, inverse @ c
        unit = np.sqrt(np.abs(k).max(initial=0.0)) or 1.0  # of the frequencies
        states = c, unit * np.eye(len(c)), k / unit, V, inverse @ V_left.T / unit
    modes = modes_of_states(*states, V[:, :0], 0.0)
    return (modes.poles, modes.right, modes.left) if modes.condition < MAX_EIGENVECTOR_CONDITION else None
