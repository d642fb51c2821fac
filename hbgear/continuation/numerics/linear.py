"""Linear algebra of dense and sparse matrices: norms, solutions, determinants, bordered matrices.

    [A  a] [x]   [b]
    [c^T 0] [s] = [t]

A bordered matrix is regular where A has one null vector, if the borders are not orthogonal to the null vectors.
Therefore a curve can be followed around its folds. Dense matrices are numpy arrays. Sparse matrices are of
scipy.sparse, and SuperLU factorises them together with the borders.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import scipy  # imports its sub-packages at their first use

from hbgear.common.arrays import Array

Matrix: TypeAlias = Any
"""A numpy array or a scipy.sparse matrix."""


def norm(x: Array) -> float:
    """Return the Euclidean norm of all entries of a real or complex array.

    `numpy.linalg.norm` takes several times as long for short arrays.
    """
    x = x.ravel().view(float)
    return math.sqrt(x.dot(x))


def norms(x: Array) -> Array:
    """Return the Euclidean norms (P,) of all entries of each x[p], real or complex."""
    flat = x.reshape(len(x), math.prod(x.shape[1:]))
    if flat.dtype == complex:
        flat = flat.view(float)
    return np.sqrt(np.einsum("ij,ij->i", flat, flat))


def dense(A: Matrix) -> bool:
    """Return whether a matrix, or a stack of matrices, is a numpy array."""
    return isinstance(A, np.ndarray)


def as_dense(A: Matrix) -> Array:
    """Return a dense or sparse matrix as a numpy array."""
    return A if dense(A) else A.toarray()


def solve_linear(A: Matrix, b: Array) -> Array:
    """Return A^-1 b for one or several right-hand sides; LinAlgError if A is singular or not finite."""
    if not dense(A):
        return Factors(A).solve(b)
    return _solve_dense(A, b)[2]


def _solve_dense(A: Array, b: Array) -> tuple[Array, np.ndarray, Array]:
    """Return the factors and row exchanges of a dense matrix in the form of LAPACK, and A^-1 b."""
    lu, exchanged, x, info = scipy.linalg.lapack.dgesv(A, b)  # the checks of scipy.linalg.solve cost more than it does
    if info or not math.isfinite(x.sum()):
        raise np.linalg.LinAlgError("singular matrix")
    return lu, exchanged, x


def solve_signed(A: Matrix, b: Array) -> tuple[Array, int]:
    """Return A^-1 b for b (n, r), and the sign of det A; LinAlgError if A is singular."""
    if dense(A) and len(A) <= SMALL:
        from hbgear.continuation.numerics.gauss_kernels import solve_in_place

        augmented = np.ascontiguousarray(np.hstack([A, b]))
        sign, x = solve_in_place(augmented), augmented[:, len(A) :].copy()
        if not sign or not math.isfinite(x.sum()):
            raise np.linalg.LinAlgError("singular matrix")
        return x, sign
    if not dense(A):
        factors = Factors(A)
        return factors.solve(b), -1 if factors.slogdet()[0] < 0 else 1
    lu, exchanged, x = _solve_dense(A, b)
    odd = np.count_nonzero(exchanged != np.arange(len(A))) + np.count_nonzero(np.diag(lu) < 0)
    return x, -1 if odd % 2 else 1


SMALL = 100
"""Number of rows up to which the kernels of `gauss_kernels` are as fast as LAPACK."""


class Factors:
    """Factors A = P L U of a real or complex matrix, dense or sparse, to solve with A, its transpose and its adjoint.

    Solutions with a dense matrix that is exactly singular, or not finite, are not finite. A sparse matrix that is
    exactly singular raises LinAlgError.
    """

    def __init__(self, A: Matrix) -> None:
        self._lu: Any
        self._exchanged: np.ndarray | None = None
        if dense(A):  # the checks of scipy.linalg.lu_factor cost more than it does
            factorise = scipy.linalg.lapack.zgetrf if np.iscomplexobj(A) else scipy.linalg.lapack.dgetrf
            self._lu, self._exchanged, _ = factorise(A)
            return
        try:
            self._lu = scipy.sparse.linalg.splu(scipy.sparse.csc_array(A))
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from None

    def solve(self, b: Array, transposed: bool = False) -> Array:
        """Return A^-1 b, or A^-T b if ``transposed``, for one or several right-hand sides."""
        return self._solved(b, "T" if transposed else "N")

    def adjoint_solve(self, b: Array) -> Array:
        """Return A^-H b for one or several right-hand sides."""
        return self._solved(b, "H")

    def _solved(self, b: Array, operation: str) -> Array:
        """Return the solution with A ("N"), its transpose ("T") or its adjoint ("H")."""
        if self._exchanged is not None:
            real = np.isrealobj(self._lu) and np.isrealobj(b)
            solve = scipy.linalg.lapack.dgetrs if real else scipy.linalg.lapack.zgetrs
            return solve(self._lu, self._exchanged, b, trans="NTH".index(operation))[0]
        x = self._lu.solve(b, operation)
        if not math.isfinite(abs(x.sum())):
            raise np.linalg.LinAlgError("singular matrix")
        return x

    def slogdet(self) -> tuple[float, float]:
        """Return the sign (+1, -1 or 0) and the logarithm of the magnitude of det A, for a sparse matrix."""
        diagonal = self._lu.U.diagonal()
        sign = _parity(self._lu.perm_r) * _parity(self._lu.perm_c) * np.prod(np.sign(diagonal))
        with np.errstate(divide="ignore"):
            return float(sign), float(np.log(np.abs(diagonal)).sum())


def _parity(permutation: Array) -> int:
    """Return +1 for an even permutation, -1 for an odd one."""
    n = len(permutation)
    graph = scipy.sparse.csr_array((np.ones(n), (np.arange(n), permutation)), shape=(n, n))
    cycles = scipy.sparse.csgraph.connected_components(graph, directed=False)[0]
    return -1 if (n - cycles) % 2 else 1


def slogdet(A: Matrix) -> tuple[float, float]:
    """Return the sign (+1, -1 or 0) and the logarithm of the magnitude of det A."""
    if dense(A):
        sign, log = np.linalg.slogdet(A)
        return float(sign), float(log)
    return Factors(A).slogdet()


def is_singular(A: Matrix) -> bool:
    """Return whether a matrix is singular up to rounding.

    A dense matrix is judged by its condition number after scaling of its rows; one that is not finite is not singular.
    Of a sparse matrix only exact singularity is detected.
    """
    if not dense(A):
        try:
            Factors(A)
        except np.linalg.LinAlgError:
            return True
        return False
    if not np.isfinite(A).all():
        return False
    largest = np.abs(A).max(axis=1, keepdims=True)
    return not largest.all() or bool(np.linalg.cond(A / largest) > MAX_CONDITION)


MAX_CONDITION = 1e13
"""Condition number above which a matrix counts as singular: solutions have fewer than three correct digits."""


def bordered(A: Matrix, column: Array, row: Array, corner: float = 0.0) -> Matrix:
    """Return the bordered matrix [A column; row^T corner], dense or sparse like A; the row may include the corner."""
    n = len(column)
    row, corner = (row[:n], row[n]) if len(row) > n else (row, corner)
    if not dense(A):
        return scipy.sparse.block_array([[A, column[:, None]], [row[None], np.array([[corner]])]], format="csc")
    B = np.empty((n + 1, n + 1), dtype=np.result_type(A, float))
    B[:n, :n], B[:n, n], B[n, :n], B[n, n] = A, column, row, corner
    return B
