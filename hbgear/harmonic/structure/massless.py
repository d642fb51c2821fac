"""Structures with coordinates without mass, such as Maxwell elements and nodes of finite-element models.

    q = B (R a + N (P c + Q e)),   N: null space of M,   Q: null space of N^T C N
    M_a a'' + C_a a' + C_ac c' + K_a a + K_ac c + K_ae e = F_a
    C_c c' + C_ca a' + K_ca a + K_c c + K_ce e = F_c
    K_e e + K_ea a + K_ec c = F_e

Coordinates c with a damper have one state instead of two, the static ones e none. The receptance is a sum of poles only
if no element acts on e.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.mechanics.models import System

MATRIX_ROUNDING = 1e-10
"""Entry of a matrix, over its largest one, that is attributed to rounding."""


@dataclass(frozen=True, eq=False)
class StateEquations:
    """First-order equations of a structure: x' = A x + (0, F f), q = S x + G f, x = (a, a', c), f: forces on q.

    Attributes
    ----------
    A : ndarray, shape (N, N)
        Matrix of the states.
    F : ndarray, shape (N - na, n)
        Rates of a' and c by forces.
    S : ndarray, shape (n, N)
        Motions of the coordinates in the states, with the static coordinates that follow them.
    G : ndarray, shape (n, n)
        Motions of the static coordinates by forces.
    bases : tuple of ndarray, shapes (n, na), (n, nc) and (n, ne)
        Directions of the coordinates a, c and e.
    """

    A: Array
    F: Array
    S: Array
    G: Array
    bases: tuple[Array, Array, Array]


def state_equations(system: System, M: Array, C: Array, K: Array, B: Array, T: Array) -> StateEquations:
    """Return the equations of the states that remain without the static coordinates, in the bases B and T (n, p).

    M, C, K (n, n) contain the dampers of the elements; the system gives names in messages and directions of elements.
    ValueError is raised if coordinates without mass cannot be eliminated.
    """
    (R, N), (R_left, N_left) = _split(T.T @ M @ B, T.T @ M @ B)
    (P, Q), (P_left, Q_left) = _split(N_left.T @ (T.T @ C @ B) @ N, T.T @ C @ B)
    right = (B @ R, B @ N @ P, B @ N @ Q)
    left = (T @ R_left, T @ N_left @ P_left, T @ N_left @ Q_left)
    _check_static(system, C, K, right[2], left[2])
    Cr, Kr = ([[x.T @ A @ y for y in right] for x in left] for A in (C, K))
    # e and its force are eliminated from the other equations
    Kei = np.linalg.inv(Kr[2][2])
    rows = [x.T - Kr[i][2] @ Kei @ left[2].T for i, x in enumerate(left[:2])]
    Ka, Kc = ([Kr[i][j] - Kr[i][2] @ Kei @ Kr[2][j] for j in range(2)] for i in range(2))
    Mi, Ci = np.linalg.inv(left[0].T @ M @ right[0]), np.linalg.inv(Cr[1][1])
    n, c = len(Mi), len(Ci)
    A, F = np.zeros((2 * n + c, 2 * n + c)), np.zeros((n + c, system.n))
    A[:n, n : 2 * n] = np.eye(n)
    A[2 * n :] = -Ci @ np.hstack([Kc[0], Cr[1][0], Kc[1]])
    F[n:] = Ci @ rows[1]
    A[n : 2 * n] = -Mi @ (np.hstack([Ka[0], Cr[0][0], Ka[1]]) + Cr[0][1] @ A[2 * n :])
    F[:n] = Mi @ (rows[0] - Cr[0][1] @ F[n:])
    static = right[2] @ Kei @ left[2].T
    motions = [basis - static @ K @ basis for basis in right[:2]]
    return StateEquations(A, F, np.hstack([motions[0], np.zeros((system.n, n)), motions[1]]), static, right)


def massless_modes(
    system: System, M: Array, C: Array, K: Array, B: Array, T: Array
) -> tuple[ComplexArray, ComplexArray, ComplexArray, float]:
    """Return the poles (N,), their right (n, N) and left vectors (N, n), and the condition of the eigenvectors.

    Arguments and errors are the same as for `state_equations`, without free motions in the bases B and T.
    """
    equations = state_equations(system, M, C, K, B, T)
    n = len(equations.A) - len(equations.F)
    time_scale = np.sqrt(np.abs(equations.A[n : 2 * n, :n]).max(initial=0.0)) or 1.0
    units = np.ones(len(equations.A))  # states (a, a'/time_scale, c) as in LinearStructure
    units[n : 2 * n] = time_scale
    poles, V = np.linalg.eig(equations.A * units / units[:, None])
    V = V.astype(complex)
    U = np.linalg.inv(V)
    condition = float(np.linalg.norm(V, 1) * np.linalg.norm(U, 1))
    return poles.astype(complex), equations.S @ V, U[:, n:] @ (equations.F / units[n:, None]), condition


def mass_basis(M: Array) -> Array:
    """Return the diagonal basis (n, n) in which the masses are one; coordinates without mass have the largest one."""
    mass = np.abs(np.diag(M))
    return np.diag(1.0 / np.sqrt(np.where(mass > 0, mass, mass.max(initial=0.0) or 1.0)))


def _check_static(system: System, C: Array, K: Array, right: Array, left: Array) -> None:
    """Raise an error if the static coordinates cannot be eliminated."""
    if not right.shape[1]:
        return
    static_stiffness = left.T @ K @ right
    values, vectors = np.linalg.svd(static_stiffness)[1:]
    if values[-1] <= MATRIX_ROUNDING * np.abs(K).max():
        raise ValueError(
            f"coordinate '{_name(system, right @ vectors[-1])}' has no mass, no damping and no stiffness, so that "
            "nothing determines its position; give it one of them, or remove it from M, C and K"
        )
    acts = np.abs(system.W.T @ right).max(axis=1, initial=0.0)
    if acts.max(initial=0.0) > MATRIX_ROUNDING * np.abs(system.W).max():
        j = int(np.argmax(acts))
        name = _name(system, right @ (right.T @ system.W[:, j]))
        raise ValueError(
            f"element '{system.elements[j].name}' acts on coordinate '{name}' without mass and damping: its "
            "displacement would follow the force of the law without delay; give the coordinate a mass or a damper"
        )
    if max(np.abs(C @ right).max(), np.abs(left.T @ C).max()) > MATRIX_ROUNDING * np.abs(C).max():
        raise ValueError(
            "C joins coordinates without mass and without damping of their own to others; it must be positive "
            "semidefinite there"
        )


def _name(system: System, motion: Array) -> str:
    """Return the name of the coordinate with the largest part in a motion (n,)."""
    return system.dof_names[int(np.argmax(np.abs(motion)))]


def _split(A: Array, matrix: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return bases of the rows and of the null space of a square matrix, and the same of its transpose.

    matrix : matrix of which A is a part, for the size of its rounding errors.
    """
    u, s, vt = np.linalg.svd(A)
    rank = int(np.sum(s > 1e-13 * np.linalg.norm(matrix, 2)))
    return (vt[:rank].T, vt[rank:].T), (u[:, :rank], u[:, rank:])
