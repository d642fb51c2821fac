"""The pieces between the corners of force laws, and where a motion leaves the one it is on.

On its piece a law is smooth, so that a step of time integration which ends at the corner sees no kink.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.laws import Law, PiecewiseLinear
from hbgear.mechanics.series.fourier import Series
from hbgear.mechanics.series.periodic import Phased

Integers = np.ndarray


Bools = np.ndarray


FINE = 16
"""Samples of a step, on which exits from a piece are looked for."""


ON = 1e-13
"""Distance from a corner, relative to its size, that is still on it."""


@dataclass(frozen=True)
class Pieces:
    """The pieces between the corners of the laws of m elements, padded to the largest number.

    On piece i of element j: low[j, i] < d < high[j, i]; if line[j] the law is p = stiffness(tau) (slope d + offset).
    """

    slope: Array
    offset: Array
    low: Array
    high: Array
    line: Bools

    @staticmethod
    def of(laws: Sequence[Law]) -> Pieces:
        """Of the laws in order."""
        springs = [spring_of(law) for law in laws]
        edges_of = [law.breakpoints if s is None else s.corners for law, s in zip(laws, springs, strict=True)]
        count = max(map(len, edges_of)) + 1
        slope, offset = np.zeros((2, len(laws), count))
        low, high = np.full((2, len(laws), count), np.inf)
        for j, spring in enumerate(springs):
            corners = np.array(edges_of[j], dtype=float)
            edges = np.concatenate([[-np.inf], corners, np.full(count - len(corners), np.inf)])
            low[j], high[j] = edges[:-1], edges[1:]
            if spring is not None:
                g0, changes, _ = spring.ramps
                used = slice(0, len(corners) + 1)
                slope[j, used] = spring.slopes
                offset[j, used] = g0 - np.concatenate([[0.0], np.cumsum(changes * corners)])
        return Pieces(slope, offset, low, high, np.array([spring is not None for spring in springs]))

    def numbers(self) -> tuple[Array, Array, Array, Array]:
        """slope, offset, low, high."""
        return self.slope, self.offset, self.low, self.high

    def at(self, d: Array, v: Array) -> Integers:
        """Piece of each element at d (..., m); on a corner the one the rate v leads to."""
        return piece_at(self.high, d, v)


def piece_at(high: Array, d: Array, v: Array) -> Integers:
    """`Pieces.at` of pieces with these upper ends (..., m, pieces)."""
    ahead = d + np.where(np.abs(v) > 0, np.sign(v), 1.0) * ON * (1 + np.abs(d))
    piece: Array = np.sum(ahead[..., None] > high, axis=-1)
    return piece


def spring_of(law: Law) -> PiecewiseLinear | None:
    """The law as one piecewise-linear spring, straight on its pieces; None if it is not one."""
    springs = law.piecewise or ()
    return springs[0] if len(springs) == 1 else None


def stiffness_of(law: Law) -> Phased:
    """The stiffness that multiplies the lines of a law."""
    spring = spring_of(law)
    return Series(1.0) if spring is None else spring.stiffness


def first_exit(
    x: Array, d: Array, v: Array, low: Array, high: Array, value: Callable[[Integers, Array], Array]
) -> tuple[Array, Integers]:
    """Where rows first leave (low, high), and through which end.

    Besides the samples the extrema between them are looked at, so that short visits beyond a corner are found.

    Parameters
    ----------
    x : (K,) abscissae of the samples. d, v : (S, K) values and slopes. low, high : (S,).
    value : ``value(rows, x)`` gives those rows at one x each.

    Returns
    -------
    x (S,), inf where a row stays inside; side (S,) -1 through low, +1 through high, 0.
    """
    at, side = np.full(len(d), np.inf), np.zeros(len(d), dtype=int)
    slack = ON * (1 + np.abs(d).max(axis=1))

    rows, cells = np.nonzero(v[:, :-1] * v[:, 1:] < 0)
    a, b = v[rows, cells], v[rows, cells + 1]
    top = x[cells] + (x[cells + 1] - x[cells]) * a / (a - b)
    row = np.concatenate([np.repeat(np.arange(len(d)), len(x)), rows])
    place = np.concatenate([np.tile(x, len(d)), top])
    y = np.concatenate([d.ravel(), value(rows, top) if rows.size else top])
    order = np.lexsort((place, row))
    row, place, y = row[order], place[order], y[order]
    out = (y > high[row] + slack[row]).astype(int) - (y < low[row] - slack[row])
    out[np.searchsorted(row, np.arange(len(d)))] = 0  # the start is on its piece, if only by rounding
    seen = np.flatnonzero(out)
    found, first = np.unique(row[seen], return_index=True)
    if found.size == 0:
        return at, side
    pick = seen[first]
    side[found] = out[pick]
    level = np.where(side[found] > 0, high[found], low[found])
    at[found] = _root(
        lambda z: value(found, z) - level, place[pick - 1], place[pick], y[pick - 1] - level, y[pick] - level
    )
    return at, side


def _root(f: Callable[[Array], Array], a: Array, b: Array, fa: Array, fb: Array) -> Array:
    """Roots in brackets by the Illinois rule; a where f(a) has the sign of f(b) already."""
    a, b, fa, fb = a.copy(), b.copy(), fa.copy(), fb.copy()
    late = fa * fb >= 0
    fa[late], fb[late] = 0.0, 1.0
    for _ in range(60):
        c = b - fb * np.divide(b - a, fb - fa, out=np.zeros_like(b), where=fb != fa)
        c = np.where(late, a, c)
        fc = np.where(late, 0.0, f(c))
        across = fc * fb < 0
        a, fa = np.where(across, b, a), np.where(across, fb, 0.5 * fa)
        moved = np.abs(c - b)
        b, fb = c, fc
        if np.all((moved <= 1e-15) | (fc == 0)):
            break
    return b
