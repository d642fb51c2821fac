"""Kernels of small dense linear algebra: solutions by Gaussian elimination, products and norms.

    A = P L U,   X = U^-1 L^-1 P^T B,   the sign of det A from the pivots and their order

Rows are exchanged for the largest pivot of each column. Four columns are eliminated together, so that the rest of the
matrix is read and written once for all four. For matrices of up to about seventy rows this takes no longer than LAPACK.
Threads may run it at once, and its results depend very little on the processor.

References
----------
Golub & Van Loan, Matrix Computations (2013), sections 3.2 and 3.4.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import kernel

PANEL_WIDTH = 4
"""Number of columns eliminated together. `_reduce` is written for this number."""


@kernel
def solve_in_place(A: Any) -> int:
    """Replace B by A^-1 B in the matrix [A B], and return the sign of det A.

    Parameters
    ----------
    A : ndarray, shape (n, n + r)
        The matrix [A B]. A is overwritten.

    Returns
    -------
    int
        Sign of det A, 0 if A is singular.
    """
    n, sign = A.shape[0], 1
    for first in range(0, n, PANEL_WIDTH):
        end = min(first + PANEL_WIDTH, n)
        sign *= _factorise(A, first, A[first:, first:end])
        if sign == 0:
            return 0
        for i in range(first + 1, end):
            for j in range(first, i):
                _subtract(A[i, j], A[j, end:], A[i, end:])
        if end < n:
            _reduce(A, first, end, n, end)
    if A.shape[1] - n <= 2:
        _solve_few(A, n, A.shape[1] - 1)
        return sign
    for end in range(n, 0, -PANEL_WIDTH):
        first = max(0, end - PANEL_WIDTH)
        for i in range(end - 1, first - 1, -1):
            row, pivot = A[i, n:], 1.0 / A[i, i]
            for j in range(i + 1, end):
                _subtract(A[i, j], A[j, n:], row)
            for k in range(row.shape[0]):
                row[k] *= pivot
        if first > 0:
            _reduce(A, first, np.int64(0), first, n)  # a literal would compile `_reduce` a second time
    return sign


@kernel
def _solve_few(A: Any, first: int, last: int) -> None:
    """Apply U^-1 in place to two columns, or to one that is given twice. Loops over such short rows are slow."""
    n = A.shape[0]
    for i in range(n - 1, -1, -1):
        a = b = c = d = 0.0
        for j in range(i + 1, n - 1, 2):
            x, y = A[i, j], A[i, j + 1]
            a, b = a + x * A[j, first], b + x * A[j, last]
            c, d = c + y * A[j + 1, first], d + y * A[j + 1, last]
        if (n - i) % 2 == 0:
            a, b = a + A[i, n - 1] * A[n - 1, first], b + A[i, n - 1] * A[n - 1, last]
        pivot = 1.0 / A[i, i]
        A[i, first], A[i, last] = (A[i, first] - (a + c)) * pivot, (A[i, last] - (b + d)) * pivot


@kernel
def _factorise(A: Any, first: int, panel: Any) -> int:
    """Compute L and U in place for some columns (panel). Exchange rows of A from the first of these columns on."""
    sign, (n, columns) = 1, panel.shape
    for j in range(columns):
        p, largest = j, abs(panel[j, j])
        for i in range(j + 1, n):
            if abs(panel[i, j]) > largest:
                p, largest = i, abs(panel[i, j])
        if not largest > 0.0:
            return 0
        if p != j:
            sign = -sign
            _exchange(A[first + p, first:], A[first + j, first:])
        if panel[j, j] < 0.0:
            sign = -sign
        pivot = 1.0 / panel[j, j]
        for i in range(j + 1, n):
            if panel[i, j] != 0.0:
                f = panel[i, j] * pivot
                panel[i, j] = f
                for k in range(j + 1, columns):
                    panel[i, k] -= f * panel[j, k]
    return sign


@kernel
def _exchange(x: Any, y: Any) -> None:
    """Exchange two rows."""
    for k in range(x.shape[0]):
        x[k], y[k] = y[k], x[k]


@kernel
def _subtract(f: float, x: Any, y: Any) -> None:
    """Subtract f x from y."""
    for k in range(x.shape[0]):
        y[k] -= f * x[k]


@kernel
def _reduce(A: Any, j: int, first: Any, end: int, start: int) -> None:
    """Subtract multiples of four rows, from row j on, from the rows first to end, in the columns from start on.

    The multiples are stored in columns j to j + 3. Columns are sliced: only loops whose indices are known to be
    non-negative are vectorized by the compiler.
    """
    p, q, r, s = A[j, start:], A[j + 1, start:], A[j + 2, start:], A[j + 3, start:]
    for i in range(first, end - 1, 2):  # two rows together: the four rows are read once for both
        a, b, c, d, row = A[i, j], A[i, j + 1], A[i, j + 2], A[i, j + 3], A[i, start:]
        e, f, g, h, below = A[i + 1, j], A[i + 1, j + 1], A[i + 1, j + 2], A[i + 1, j + 3], A[i + 1, start:]
        if abs(a) + abs(b) + abs(c) + abs(d) + abs(e) + abs(f) + abs(g) + abs(h) != 0.0:  # zero if not coupled
            for k in range(row.shape[0]):
                x, y, z, w = p[k], q[k], r[k], s[k]
                row[k] -= a * x + b * y + c * z + d * w
                below[k] -= e * x + f * y + g * z + h * w
    for i in range(end - (end - first) % 2, end):
        a, b, c, d, row = A[i, j], A[i, j + 1], A[i, j + 2], A[i, j + 3], A[i, start:]
        for k in range(row.shape[0]):
            row[k] -= a * p[k] + b * q[k] + c * r[k] + d * s[k]


@kernel
def add_product(A: Any, B: Any, factor: float, out: Any) -> None:
    """Add factor A B to out, four rows of B at a time, so that out is read and written once for four rows.

    Parameters
    ----------
    A, B : ndarray, shape (n, m), (m, k)
        Matrices.
    factor : float
        Factor of the product.
    out : ndarray, shape (n, k)
        Matrix that is changed.
    """
    n, blocked = A.shape[1], A.shape[1] - A.shape[1] % 4
    for i in range(A.shape[0]):
        for k in range(0, blocked, 4):
            a, b, c, d = factor * A[i, k], factor * A[i, k + 1], factor * A[i, k + 2], factor * A[i, k + 3]
            for j in range(B.shape[1]):
                out[i, j] += a * B[k, j] + b * B[k + 1, j] + c * B[k + 2, j] + d * B[k + 3, j]
        for k in range(blocked, n):
            a = factor * A[i, k]
            for j in range(B.shape[1]):
                out[i, j] += a * B[k, j]


@kernel
def scaled_norm(x: Any) -> float:
    """Return the Euclidean norm of a vector.

    Parameters
    ----------
    x : ndarray, shape (n,)
        The vector.

    Returns
    -------
    float
        The norm.
    """
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * x[i]
    return math.sqrt(total)


@kernel
def scaled_distance(x: Any, y: Any, scale: Any) -> float:
    """Return the Euclidean norm of (x - y) / scale.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Vectors.
    scale : ndarray, shape (n,)
        Scale of each entry.

    Returns
    -------
    float
        The scaled distance.
    """
    total = 0.0
    for i in range(x.shape[0]):
        difference = (x[i] - y[i]) / scale[i]
        total += difference * difference
    return math.sqrt(total)
