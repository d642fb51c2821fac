"""Kernels of small dense linear algebra: solutions by Gaussian elimination, and norms.

    A = P L U,   x = U^-1 L^-1 P^T b,   the sign of det A from the pivots and their order

Rows are exchanged for the largest pivot of each column. For matrices of some twenty rows this takes no longer than
LAPACK; threads may run it at once, and its results hardly depend on the processor.

References
----------
Golub & Van Loan, Matrix Computations (2013), section 3.4.
"""

from __future__ import annotations

import math
from typing import Any

from hbgear.common.compiling import kernel


@kernel
def eliminate(A: Any, b: Any) -> int:
    """Put A^-1 b in the place of b (n, r); A (n, n) is lost. Returns the sign of det A, 0 if A is singular."""
    n, sign = A.shape[0], 1
    for j in range(n):
        p = j
        for i in range(j + 1, n):
            if abs(A[i, j]) > abs(A[p, j]):
                p = i
        if not abs(A[p, j]) > 0.0:
            return 0
        if p != j:
            sign = -sign
            _exchange(A, p, j, j)
            _exchange(b, p, j, 0)
        if A[j, j] < 0.0:
            sign = -sign
        _reduce(A, b, j)
    _substitute(A, b)
    return sign


@kernel
def _exchange(A: Any, p: int, j: int, first: int) -> None:
    for k in range(first, A.shape[1]):
        A[p, k], A[j, k] = A[j, k], A[p, k]


@kernel
def _reduce(A: Any, b: Any, j: int) -> None:
    """Make the entries below the pivot of column j zero."""
    n, r, pivot = A.shape[0], b.shape[1], 1.0 / A[j, j]
    for i in range(j + 1, n):
        f = A[i, j] * pivot
        if f != 0.0:
            for k in range(j + 1, n):
                A[i, k] -= f * A[j, k]
            for k in range(r):
                b[i, k] -= f * b[j, k]


@kernel
def _substitute(A: Any, b: Any) -> None:
    """U^-1 b in the place of b, row by row from the last."""
    n, r = b.shape
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            f = A[i, j]
            for k in range(r):
                b[i, k] -= f * b[j, k]
        pivot = 1.0 / A[i, i]
        for k in range(r):
            b[i, k] *= pivot


@kernel
def length(x: Any) -> float:
    """Euclidean norm of a vector."""
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * x[i]
    return math.sqrt(total)


@kernel
def distance(x: Any, y: Any, scale: Any) -> float:
    """Euclidean norm of (x - y) / scale."""
    total = 0.0
    for i in range(x.shape[0]):
        part = (x[i] - y[i]) / scale[i]
        total += part * part
    return math.sqrt(total)
