"""Predictor: Hermite extrapolation through the last points of a curve with their tangents."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.algebra import norms
from hbgear.continuation.segment import CurvePoint, normal_of

_STRAIGHT = 0.3  # share of the step by which the first predicted bend may move the point; cosine of the last turn


def predict(rows: Sequence[CurvePoint], unit: Array, scale: Array, distance: Array) -> Array:
    """Unknowns (k, n + 1) at distances (k,) along the tangent ``unit`` from the last row: Hermite extrapolation.

    Parameters
    ----------
    rows : the last rows, the newest first. Through one of them with its tangent goes a line, through two a cubic,
        through r a polynomial of degree 2r - 1, in the distance x = unit . (u - u_0) (scaled). As many are used
        as bring smaller and smaller changes: beyond that the curve is not smooth on their scale.
    """
    along = normal_of(unit, scale)
    u, t = np.array([row.u for row in rows]), np.array([row.tangent for row in rows])
    x, cosine = (u - u[0]) @ along, t @ along
    steep = np.flatnonzero(cosine[1:] < _STRAIGHT * norms(t[1:] / scale))
    r = 1 + int(steep[0]) if steep.size else len(rows)
    value, slope = _hermite(x[:r], distance)
    guesses = np.concatenate([
        (rows[0].u + distance[:, None] * unit)[None], value @ u[:r] + (slope / cosine[:r]) @ t[:r]
    ])  # fmt: skip
    change = np.sqrt(np.square((guesses[1:] - guesses[:-1]) / scale).sum(axis=2))
    before = np.concatenate([_STRAIGHT * distance[None], change])
    better = np.logical_and.accumulate(change < before[:-1], axis=0).sum(axis=0)
    chosen: Array = guesses[better, np.arange(len(distance))]
    return chosen


def _hermite(x: Array, at: Array) -> tuple[Array, Array]:
    """Weights (r - 1, k, r) of values and slopes at the nodes x (r,) in Hermite polynomials, evaluated at (k,).

    They go through the first 2, ..., r nodes: L_i^2 (1 - 2 (x - x_i) sum_j 1 / (x_i - x_j)) and L_i^2 (x - x_i), with
    Lagrange's polynomials L_i.
    """
    used, others = _used(len(x))
    gap = np.where(others, x[:, None] - x, 1.0)  # from every node to the others that are used
    off = at[:, None] - x
    lagrange = np.where(used[:, None], off, 1.0).prod(axis=2)[..., None] / (off * gap.prod(axis=2)[:, None])
    squared = np.where(used[:, None], lagrange * lagrange, 0.0)
    slope = off * squared
    steep = np.where(others, 1.0 / gap, 0.0).sum(axis=2)
    return squared - 2 * steep[:, None] * slope, slope


@lru_cache(maxsize=16)
def _used(r: int) -> tuple[np.ndarray, np.ndarray]:
    """Which of r nodes the polynomials through the first 2, ..., r use (r - 1, r), and beside each (r - 1, r, r)."""
    used = np.arange(r) < np.arange(2, r + 1)[:, None]
    return used, used[:, :, None] & used[:, None] & ~np.eye(r, dtype=bool)
