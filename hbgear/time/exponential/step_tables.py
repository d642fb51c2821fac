"""Tables of the kernels, computed before the first step.

A step is linear in its initial state and in w at the Gauss points, with tables that depend on its length alone. They
are stored for whole cells of the period. For partial cells they are computed, or, for many motions, evaluated as
Chebyshev series in the length. If the laws are linear on their segments, a step over a whole cell is linear in the
state alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.multipliers.gauss_points import gauss_nodes
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers

_MAX_FOLDED_ENTRIES = 200_000
"""Largest number of table entries [-] of folded steps, which are linear in the state alone."""

_MAX_SERIES_TERMS = 40
"""Largest number of Chebyshev terms [-] of the tables over the step length; with more they cost more than they save."""


def packed(data: Iterable[Any]) -> list[Any]:
    """Return arrays in the memory layout for which the kernels are compiled."""
    return [np.ascontiguousarray(x) if isinstance(x, np.ndarray) else x for x in data]


@lru_cache(maxsize=8)
def dense(s: int) -> tuple[Array, Array, Array]:
    """Return the interpolation in a step from d and h v at 0, the s Gauss points and 1.

    The arrays are the contributions of each of these values to the Chebyshev coefficients (2s + 4, 2s + 4), and to d
    and h v at SAMPLES_PER_STEP + 1 equidistant instants, (2s + 4, SAMPLES_PER_STEP + 1) each.
    """
    nodes, k = np.concatenate([[0.0], gauss_nodes(s)[0], [1.0]]), np.arange(2 * s + 4)
    matrix = np.linalg.inv(np.concatenate([_chebyshev(nodes, k), _chebyshev_slope(nodes, k)]))
    x = np.linspace(0.0, 1.0, SAMPLES_PER_STEP + 1)
    return matrix.T, (_chebyshev(x, k) @ matrix).T, (_chebyshev_slope(x, k) @ matrix).T


def _chebyshev(x: Array, k: Integers) -> Array:
    """Return T_k(2x - 1), (..., K)."""
    return np.cos(k * np.arccos(np.clip(2 * x - 1, -1.0, 1.0))[..., None])


def _chebyshev_slope(x: Array, k: Integers) -> Array:
    """Return the derivative of T_k(2x - 1) in x."""
    c = np.eye(len(k))
    return np.polynomial.chebyshev.chebval(2 * x - 1, 2 * np.polynomial.chebyshev.chebder(c)).T


@dataclass(frozen=True)
class Steps:
    """Steps of a plan: tables of whole cells, and tables of any length.

    Attributes
    ----------
    plan, method : Plan, Method
        See `kernels`.
    cells : Tables
        Tables of whole cells.
    maps : ndarray
        Steps over whole cells that are linear in the state alone, see `kernels.fold`; empty if they need more products
        than the solution for w.
    cost : int
        Number of products of a step.
    """

    plan: Any
    method: Any
    cells: Any
    maps: Array
    cost: int
    _curves: dict[bool, Any] = field(default_factory=dict)

    @staticmethod
    def of(plan: Any, method: Any, breakpoints: Any, N: int) -> Steps:
        """Return the steps of a plan with N cells a period, and breakpoints of the excitation or None."""
        from hbgear.time.exponential.kernels.newton import fold
        from hbgear.time.exponential.kernels.tables import fill

        (R, m), P, size, s = plan.kr.shape, plan.low.shape[2], 2 * plan.poles.shape[1], len(method.lagrange)
        n, r, (cells, work) = (s + 1) * 2 * m, s * m, _allocate(plan, method, R, N)
        fill(plan, method, breakpoints, np.ones(R), work, cells)
        cost = size * n + 2 * r * n + r**3 + size * r
        shape, has_contacts = (N, P**m, size + 1, n + size), plan.low.shape[1] > m
        is_smaller = size * (n + size) <= cost and math.prod(shape) <= _MAX_FOLDED_ENTRIES
        if R > 1 or not method.straight or has_contacts or not is_smaller:
            return Steps(plan, method, cells, np.empty((0, 0, 0, 0)), cost)
        maps = np.empty(shape)
        fold(plan, method, breakpoints, cells, work, maps)
        return Steps(plan, method, cells, maps, size * (n + size))

    def select(self, rows: Integers) -> Steps:
        """Return the steps of some rows."""
        plan, cells = (type(table)(*(x[rows] for x in table)) for table in (self.plan, self.cells))
        return Steps(plan, self.method, cells, self.maps, self.cost)

    def curves(self, many: bool) -> Any:
        """Return `kernels.Tables` of D Chebyshev coefficients over the length.

        D = 0 unless many motions profit from them.
        """
        from hbgear.time.exponential.kernels.tables import fill

        if many not in self._curves:
            D = self._terms() if many and len(self.plan.h) == 1 else 0
            out, work = _allocate(self.plan, self.method, D, 0)
            angle = np.pi * (np.arange(D) + 0.5) / max(D, 1)
            fill(self.plan, self.method, None, 0.5 * (1 + np.cos(angle)), work, out)
            to_series = np.cos(np.arange(D)[:, None] * angle) * 2 / max(D, 1)
            to_series[:1] /= 2
            rows = (np.tensordot(to_series, x, 1).reshape(D, math.prod(x.shape[1:])) for x in out)
            self._curves[many] = type(out)(*packed(rows))
        return self._curves[many]

    def _terms(self) -> int:
        """Return the number of terms with an error at rounding level; 0 if there are too many to save time."""
        argument, size, D = 0.25 * float(np.abs(self.plan.poles).max(initial=0.0) * self.plan.h[0]), 1.0, 1
        while size > 1e-17 and D <= _MAX_SERIES_TERMS:
            size *= argument / D
            D += 1
        return D if D <= _MAX_SERIES_TERMS else 0


def _allocate(plan: Any, method: Any, rows: int, cells: int) -> tuple[Any, Any]:
    """Return empty tables and a workspace."""
    from hbgear.time.exponential.kernels.data import allocate_tables, allocate_workspace

    sizes = len(method.lagrange), plan.kr.shape[1], plan.poles.shape[1]
    contacts = plan.low.shape[1] - plan.kr.shape[1]
    return allocate_tables(rows, cells, *sizes, len(method.element)), allocate_workspace(1, *sizes, contacts)
