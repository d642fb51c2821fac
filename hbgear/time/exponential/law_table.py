"""Force laws as tables of numbers, for compiled time integration.

    p(d, tau) = sum_i k_i(tau) (slope_i d + offset_i) + k1 d + k3 d^3      on the piece d is on

Every sum of piecewise-linear springs with periodic stiffness and of cubic springs is of this form; laws that are not
are asked for their force.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.laws import Law, PiecewiseLinear, springs_of
from hbgear.mechanics.series.fourier import Series, to_complex
from hbgear.time.exponential.segments import Bools, Integers


@dataclass(frozen=True)
class LawTable:
    """The laws of m elements, S springs in all, padded to the same numbers of pieces P and of harmonics.

    element : (S,) which element a spring belongs to.
    slope, offset : (S, P) of a spring on each piece of its element.
    stiffness : (S, L + 1) one-sided complex harmonics of k_i; zero where it has corners, see `excitation`.
    low, high : (m, P) ends of the pieces of each element.
    cubic : (m, 2) k1, k3.
    asked : (m,) whether the law must be asked for its force, of which the table then says nothing.
    """

    element: Integers
    slope: Array
    offset: Array
    stiffness: Array
    low: Array
    high: Array
    cubic: Array
    asked: Bools

    @staticmethod
    def of(laws: Sequence[Law]) -> LawTable:
        """Of the laws in order."""
        known = [springs_of(law) for law in laws]
        parts = [((), 0.0, 0.0) if part is None else part for part in known]
        edges = [_edges(law, part and part[0]) for law, part in zip(laws, known, strict=True)]
        P = max(map(len, edges)) + 1
        low, high = np.full((2, len(laws), P), np.inf)
        for j, inner in enumerate(edges):
            low[j, : len(inner) + 1], high[j, : len(inner)] = [-np.inf, *inner], inner
        springs = [(j, spring) for j, part in enumerate(parts) for spring in part[0]]
        slope, offset = np.zeros((2, len(springs), P))
        stiffness = np.zeros((len(springs), 1 + max([0, *(x.stiffness.order for _, x in springs)])), dtype=complex)
        for i, (j, spring) in enumerate(springs):
            on = [bisect_right(spring.corners, x) for x in (-np.inf, *edges[j])]
            start, changes, corners = spring.ramps
            slope[i, : len(on)] = np.array(spring.slopes)[on]
            offset[i, : len(on)] = start - np.concatenate([[0.0], np.cumsum(changes * corners)])[on]
            if isinstance(spring.stiffness, Series):
                row = to_complex(spring.stiffness.row())
                stiffness[i, : len(row)] = row
        cubic = np.array([part[1:] for part in parts]).reshape(len(laws), 2)
        element = np.array([j for j, _ in springs], dtype=int)
        asked = np.array([part is None for part in known], dtype=bool)
        return LawTable(element, slope, offset, stiffness, low, high, cubic, asked)

    @staticmethod
    def stacked(tables: Sequence[LawTable]) -> LawTable:
        """Of several models, with a first axis for them in all but element and asked.

        Raises
        ------
        ValueError
            If the laws are not of the same kinds, element by element.
        """
        L = max(table.stiffness.shape[1] for table in tables)
        kinds = {(*map(np.ndarray.tobytes, (t.element, t.asked)), t.low.shape) for t in tables}
        if len(kinds) > 1:
            raise ValueError("the models must have laws of the same kind, element by element")
        stiffness = [np.pad(t.stiffness, ((0, 0), (0, L - t.stiffness.shape[1]))) for t in tables]
        each = {
            name: np.array([getattr(t, name) for t in tables]) for name in ("slope", "offset", "low", "high", "cubic")
        }
        return LawTable(tables[0].element, stiffness=np.array(stiffness), asked=tables[0].asked, **each)


def _edges(law: Law, springs: Sequence[PiecewiseLinear] | None) -> tuple[float, ...]:
    """Corners of the law: those of its springs, or what it says itself."""
    return tuple(sorted({x for part in ([law] if springs is None else springs) for x in part.breakpoints}))
