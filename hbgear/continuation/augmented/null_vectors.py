"""Null vectors of nearly singular matrices, which are the borders of extended equations."""

from __future__ import annotations

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import SMALL, Factors, Matrix, bordered, dense, norm, slogdet, solve_signed


def borders_of(A: Matrix) -> tuple[Array, Array, float]:
    """Return the borders b and c of a nearly singular matrix, and its norm.

    The borders are the left and right singular vectors of the smallest singular value. Their signs are chosen so that g
    has the sign of det A. For large or sparse matrices they are computed by inverse iteration, b ~ A^-T c and c ~ A^-1
    b, with a bordered matrix, which is regular where A is singular. The norm is the largest singular value, or the
    1-norm of a large or sparse matrix.
    """
    sign = -1.0 if slogdet(A)[0] > 0 else 1.0
    if dense(A) and len(A) <= SMALL:
        u, s, vt = scipy.linalg.svd(A)
        return sign * u[:, -1], vt[-1], float(s[0])
    b, c = least_singular_vectors(A)
    g = null_vectors(A, b, c)[2]
    return (-b if g * sign > 0 else b), c, float(abs(A).sum(axis=0).max())


def least_singular_vectors(A: Matrix, max_iterations: int = 200) -> tuple[Array, Array]:
    """Return the left and the right singular vector of the smallest singular value, of any signs, by inverse iteration.

    With A v = -g b and c^H v = 1, and x, s from the same bordered matrix with A x + s b = y and c^H x = 0, A (g x - s
    v) = g y. This gives the direction of A^-1 y without division by g, which is zero where A is singular. A few
    iterations suffice near a fold, 200 if the two smallest singular values differ by 5 %.
    """
    n = A.shape[0]
    first = np.random.default_rng(0).normal(size=(2, n))  # random vectors, which are not orthogonal to the null vectors
    b, c = first[0] / norm(first[0]), first[1] / norm(first[1])
    lu = Factors(bordered(A, b, c))
    corner = np.zeros(n + 1)
    corner[-1] = 1.0
    right, left = lu.solve(corner), lu.adjoint_solve(corner)
    g = right[-1]
    for _ in range(max_iterations):  # the factors of the first borders serve all iterations
        x, y = lu.solve(np.append(b, 0.0)), lu.adjoint_solve(np.append(c, 0.0))
        # g A^-1 b and g A^-T c: the bordered matrix is regular where A is not, and right and left remove the border
        new_c, new_b = g * x[:-1] - x[-1] * right[:-1], g.conj() * y[:-1] - y[-1] * left[:-1]
        new_b, new_c = new_b / norm(new_b), new_c / norm(new_c)
        change = max(1.0 - abs(np.vdot(new_b, b)), 1.0 - abs(np.vdot(new_c, c)))
        b, c = new_b, new_c
        if change < CONVERGED_VECTOR_CHANGE:
            break
    return b, c


CONVERGED_VECTOR_CHANGE = 1e-15
"""Convergence threshold of inverse iteration: one minus the cosine of the angle between successive vectors."""


def null_vectors(A: Matrix, b: Array, c: Array) -> tuple[Array, Array, float]:
    """Return v, w and g of a matrix with borders b and c; see the module.

    v and w are the right and the left null vector where A is singular; there the test function g is zero.
    """
    B, e = bordered(A, b, c), np.zeros((len(b) + 1, 1))
    e[-1] = 1.0
    if dense(B) and len(B) <= SMALL:
        right, left = (solve_signed(matrix, e)[0][:, 0] for matrix in (B, B.T))
    else:
        lu = Factors(B)
        right, left = lu.solve(e[:, 0]), lu.solve(e[:, 0], transposed=True)
    return right[:-1], left[:-1], float(right[-1])
