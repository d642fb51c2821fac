"""Eigenmodes of structures: real shapes, pairs of damped modes, and modes of first-order equations.

K phi = w^2 M phi,   phi^T C phi = 2 delta,   poles = -delta +- sqrt(delta^2 - w^2)
x' = U y,   y' = -L x - C y + T (F - W u),   q = B x
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.mechanics.structures.modal_damping import modal_squares

FREE_MOTION_TOLERANCE = 1e-12
"""Squared frequency, relative to the highest, below which a motion counts as free."""

_MODAL_COUPLING_TOLERANCE = 1e-13
"""Off-diagonal modal damping, relative to the largest entry, that counts as rounding."""

MAX_EIGENVECTOR_CONDITION = 1e8
"""Condition number of the eigenvectors above which receptances are computed by direct solutions."""


@dataclass(frozen=True)
class Modes:
    """Modal form z' = poles z + left (F - W u), q = right z of the structure with the reference springs.

    Attributes
    ----------
    poles : ndarray, shape (r,)
        Poles [1 / time].
    right : ndarray, shape (n, r)
        Right eigenvectors of the coordinates.
    left : ndarray, shape (r, n)
        Left eigenvectors.
    output : ndarray, shape (m, r)
        Modal displacements W^T right of the elements.
    input : ndarray, shape (r, m)
        Modal forces left W of the elements.
    condition : float
        Condition number of the eigenvectors.
    """

    poles: ComplexArray
    right: ComplexArray
    left: ComplexArray
    output: ComplexArray
    input: ComplexArray
    condition: float


def _is_identity(A: Array) -> bool:
    return bool(np.abs(A - np.eye(len(A))).max() < 4 * np.finfo(float).eps)


def real_shapes(M: Array, K: Array) -> tuple[Array, Array]:
    """Return the squared frequencies of symmetric M and K, zero if not positive, and the modes of unit modal mass.

    Rounding changes the lowest eigenvalues of a fine mesh, but not their Rayleigh quotients.
    """
    if not len(K):
        return np.empty(0), K
    shapes = scipy.linalg.eigh(K, None if _is_identity(M) else M)[1]
    return modal_squares(K, shapes, np.abs(K)), shapes


def modal_pairs(
    D: Array, squares: Array, shapes: Array
) -> tuple[ComplexArray, ComplexArray, ComplexArray, float] | None:
    """Return poles (2r,), right (n, 2r) and left modes (2r, n), and their condition, of shapes (n, r) of unit mass.

    None if the modal damping D (r, r) couples them, or if damping makes two poles equal.
    """
    delta = 0.5 * np.diag(D)
    coupling = np.abs(D - np.diag(np.diag(D))).max(initial=0.0)
    is_coupled = coupling > _MODAL_COUPLING_TOLERANCE * np.abs(D).max(initial=0.0)
    difference = 2 * np.sqrt((delta**2 - squares).astype(complex))
    is_double = np.abs(difference) * MAX_EIGENVECTOR_CONDITION < np.abs(delta) + np.sqrt(np.abs(squares))
    if is_coupled or is_double.any():
        return None
    poles = np.concatenate([-delta + 0.5 * difference, -delta - 0.5 * difference])
    right = np.tile(shapes, 2).astype(complex)
    left = right.T / np.concatenate([difference, -difference])[:, None]
    return poles, right, left, float(np.max(np.abs(poles[: len(squares)] / difference), initial=0.0))


def modes_of_states(
    C: Array,
    upper: Array,
    lower: Array,
    B: Array,
    T: Array,
    W: Array,
    disturbance: float,
    Z: Array | None = None,
    drifts: int = 0,
) -> Modes:
    """Return the modes of x' = upper y, y' = -lower x - C y + T (F - W u), q = B x.

    disturbance : relative disturbance that separates coincident poles. Z : basis of the states to which x, y are
    restricted. drifts : number of damped free motions. Each has a pole at zero, a drift that no element measures.
    """
    size = len(C)
    A = np.block([[np.zeros((size, size)), upper], [-lower, -C]])
    if disturbance:
        # different disturbances of the states separate the eigenvectors of a defective matrix
        A += disturbance * np.abs(upper).max() * np.diag(np.linspace(-1.0, 1.0, 2 * size) ** 3)
    poles, V = np.linalg.eig(A if Z is None else Z.T @ A @ Z)
    poles, V = poles.astype(complex), V.astype(complex)
    try:
        U = np.linalg.inv(V)
    except np.linalg.LinAlgError:
        U = np.full_like(V, np.inf)  # rejected by the caller because of the condition
    if Z is not None:
        V, U = Z @ V, U @ Z.T
    right, left = B @ V[:size], U[:, size:] @ T
    keep = np.abs(poles) > 1e-9 * np.abs(poles).max(initial=0.0)
    keep[np.argsort(np.abs(poles), kind="stable")[drifts:]] = True
    condition = float(np.linalg.norm(V, 1) * np.linalg.norm(U, 1)) if np.all(np.isfinite(U)) else np.inf
    return Modes(poles[keep], right[:, keep], left[keep], (W.T @ right)[:, keep], (left @ W)[keep], condition)


def null_space(A: Array, threshold: float | None = None) -> Array:
    """Return an orthonormal basis of the null space of a matrix with scaled rows and columns.

    threshold : largest singular value that counts as zero, by default 1e-12 times the largest one.
    """
    _, s, vt = np.linalg.svd(A)
    largest = s.max(initial=0.0)
    rank = int(np.sum(s > (FREE_MOTION_TOLERANCE * largest if threshold is None else threshold))) if largest > 0 else 0
    return vt[rank:].T
