"""Damping matrix of a structure from the damping ratios of its modes.

    C = M Phi diag(2 zeta_i omega_i) Phi^T M,   K Phi = M Phi diag(omega_i^2),   Phi^T M Phi = 1

The modes are those of the linear structure M, K without elements. Modes at rest have no damping. The squares of the
frequencies are Rayleigh quotients: rounding changes the lowest eigenvalues of a fine mesh.

References
----------
Wilson & Penzien (1972), Int. J. Numer. Methods Eng. 4(1), 5-10, https://doi.org/10.1002/nme.1620040103.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.ranges import NOT_NEGATIVE, checked
from hbgear.mechanics.structures.matrices import square

MAX_MODAL_COORDINATES = 4000
"""Largest number of coordinates [-]; all modes of more take minutes and gigabytes."""

ASYMMETRY = 1e-9
"""Difference of a matrix from its transpose, relative to its largest entry, that is attributed to rounding."""

REST_ROUNDING = 10 * np.finfo(float).eps
"""Energy of a mode over the sum of the absolute values of its terms, below which the mode is at rest. Rigid motions
of beams of 10 to 700 elements have at most 2e-17, bending modes at least 1e-12."""


@checked_arguments(ratios="a number, or a list of numbers for the lowest modes")
def modal_damping(M: Any, K: Any, ratios: float | Sequence[float]) -> Array:
    """Return the damping matrix of a structure whose modes have given damping ratios.

    Parameters
    ----------
    M, K : array_like or sparse matrix, shape (n, n)
        Mass and stiffness, symmetric; M positive definite.
    ratios : float or sequence of float
        Damping ratio of all modes [-], or damping ratios of the lowest modes by ascending frequency. The last one
        applies to all higher modes.

    Returns
    -------
    ndarray, shape (n, n)
        Damping matrix C.

    Raises
    ------
    ValueError
        If a matrix is not symmetric, M is not positive definite, K has a negative eigenvalue, a ratio is negative, or
        there are more than `MAX_MODAL_COORDINATES` coordinates.

    Examples
    --------
    >>> import hbgear as hb
    >>> M, K = [[1.0, 0.0], [0.0, 1.0]], [[2.0, -1.0], [-1.0, 2.0]]
    >>> hb.mechanics.modal_damping(M, K, 0.05).round(4).tolist()
    [[0.1366, -0.0366], [-0.0366, 0.1366]]
    """
    M, K = (_symmetric(name, square(name, A)) for name, A in (("M", M), ("K", K)))
    values = np.atleast_1d(np.asarray(ratios, dtype=float))
    if values.ndim != 1 or not values.size:
        raise ValueError("modal_damping: ratios must be a number, or a list of numbers for the lowest modes")
    for value in values.tolist():
        checked("modal_damping", "ratios", value, NOT_NEGATIVE)
    try:
        squares, modes = scipy.linalg.eigh(K, M)
    except np.linalg.LinAlgError:
        raise ValueError(
            "modal_damping: M is not positive definite; remove coordinates without mass, or give C"
        ) from None
    if squares[0] < -ASYMMETRY * np.abs(squares).max():
        raise ValueError(
            f"modal_damping: K has a negative eigenvalue, omega^2 = {squares[0]:.4g}: the structure is "
            "not stable without its elements; give C"
        )
    frequencies = np.sqrt(modal_squares(K, modes, np.abs(K)))
    zeta = np.concatenate([values, np.full(max(len(squares) - values.size, 0), values[-1])])[: len(squares)]
    M_modes = M @ modes
    return (M_modes * (2 * zeta * frequencies)) @ M_modes.T


def modal_squares(K: Array, modes: Array, terms: Array) -> Array:
    """Return the squared frequencies (r,) of modes (n, r) of unit modal mass; zero of modes at rest.

    terms (n, n) : sums of the absolute values of the terms of K, which bound its rounding errors.
    """
    squares = np.sum(modes * (K @ modes), axis=0)
    rounding = REST_ROUNDING * np.sum(np.abs(modes) * (terms @ np.abs(modes)), axis=0)
    return np.where(squares > rounding, squares, 0.0)


def _symmetric(name: str, A: Any) -> Array:
    """Return a matrix as a symmetric array."""
    if A.shape[0] > MAX_MODAL_COORDINATES:
        raise ValueError(
            f"modal_damping: {A.shape[0]} coordinates, at most {MAX_MODAL_COORDINATES}; reduce the "
            "structure first (hb.mechanics.reduce), or give C"
        )
    matrix = A if isinstance(A, np.ndarray) else A.toarray()
    if np.abs(matrix - matrix.T).max() > ASYMMETRY * np.abs(matrix).max():
        raise ValueError(f"modal_damping: {name} is not symmetric, so it has no real modes; give C")
    return 0.5 * (matrix + matrix.T)
