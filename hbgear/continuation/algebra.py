"""Small linear algebra: norms, solutions and bordered matrices, cheap for short arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.continuation.problem import Evaluation, Evaluations


def norm(x: Array) -> float:
    """Euclidean norm of all entries, as `numpy.linalg.norm` gives it at several times the cost for short arrays."""
    x = x.ravel().view(float)
    return math.sqrt(x.dot(x))


def norms(x: Array) -> Array:
    """Euclidean norms (P,) of all entries of each x[p], (P, ...)."""
    flat = x.reshape(len(x), math.prod(x.shape[1:]))
    if flat.dtype == complex:
        flat = flat.view(float)
    return np.sqrt(np.einsum("ij,ij->i", flat, flat))


def unit_of(problem: Any, name: str, value: float) -> float:
    """Size against which a change of a parameter is small: its value, near zero a thousandth of the problem's own."""
    own = getattr(problem, "parameters", {}).get(name, 0.0)
    return max(abs(value), 1e-3 * abs(own)) or 1.0


def solve_linear(A: Array, b: Array) -> Array:
    """A^-1 b; a singular or non-finite matrix raises `numpy.linalg.LinAlgError`."""
    *_, x, info = scipy.linalg.lapack.dgesv(A, b)  # the checks of scipy.linalg.solve cost more than the solution
    if info or not math.isfinite(x.sum()):
        raise np.linalg.LinAlgError("singular matrix")
    return x


def is_singular(A: Array) -> bool:
    """Whether a finite matrix is singular up to rounding, once its rows are of one size."""
    if not np.isfinite(A).all():
        return False
    largest = np.abs(A).max(axis=1, keepdims=True)
    return not largest.all() or bool(np.linalg.cond(A / largest) > _SINGULAR)


_SINGULAR = 1e13  # condition of a matrix that is singular to rounding


def all_bordered(now: Evaluations, normal: Array) -> Array:
    """`bordered` of stacked evaluations, (k, n + 1, n + 1), with one normal (n + 1,) or one each (k, n + 1)."""
    k, n = now.R.shape
    A = np.empty((k, n + 1, n + 1))
    A[:, :n, :n], A[:, :n, n], A[:, n] = now.dR_dX, now.dR_dp, normal
    return A


def bordered(now: Evaluation, normal: Array) -> Array:
    """[dR_dX dR_dp; normal^T]."""
    n = now.R.size
    A = np.empty((n + 1, n + 1))
    A[:n, :n], A[:n, n], A[n] = now.dR_dX, now.dR_dp, normal
    return A
