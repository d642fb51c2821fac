"""Force laws as tables of numbers, for compiled time integration.

    p(d, tau) = sum_i k_i(tau) (slope_i d + offset_i) + k1 d + k3 d^3      on the segment of d

Every sum of piecewise-linear springs with periodic stiffness and of cubic springs has this form. A contact between
teeth is such a spring of d - level(tau), with segments of this distance. Other laws are evaluated in Python.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.laws import Law
from hbgear.mechanics.laws.mesh_contacts import MovingSpring, moving_springs_of
from hbgear.mechanics.series.fourier import Series, to_complex
from hbgear.time.exponential.segments import Bools, Integers, single_spring

Split = tuple[tuple[MovingSpring, ...], float, float]
"""Springs of a law, and the coefficients k1 and k3 of its cubic spring."""


@dataclass(frozen=True)
class LawTable:
    """Laws of m elements with S springs in total, padded to the same numbers of segments P and of harmonics.

    J of the springs are contacts with a moving level. The segments are those of the m elements, then of the J contacts.

    Attributes
    ----------
    element : ndarray, shape (S,)
        Element of each spring.
    contact : ndarray, shape (S,)
        Number of the contact of a spring; -1 for a spring that is no contact.
    slope, offset : ndarray, shape (S, P)
        Line of a spring on each segment of its element or contact.
    stiffness : ndarray, shape (S, L + 1)
        One-sided complex harmonics of k_i; zero if it has breakpoints, see `excitation`.
    low, high : ndarray, shape (m + J, P)
        Ends of the segments of each element and contact.
    cubic : ndarray, shape (m, 2)
        Coefficients k1, k3.
    in_python : ndarray, shape (m,)
        True for a law that the table does not hold and that is evaluated in Python.
    """

    element: Integers
    contact: Integers
    slope: Array
    offset: Array
    stiffness: Array
    low: Array
    high: Array
    cubic: Array
    in_python: Bools

    @staticmethod
    def of(laws: Sequence[Law], split: Callable[[Law], Split | None] = moving_springs_of) -> LawTable:
        """Return the table of laws in order, whose springs ``split`` returns; None for a law in Python."""
        splits = [split(law) for law in laws]
        terms = [((), 0.0, 0.0) if part is None else part for part in splits]
        springs = [(j, spring) for j, part in enumerate(terms) for spring in part[0]]
        element = np.array([j for j, _ in springs], dtype=int)
        is_contact = np.array([_moves(spring) for _, spring in springs], dtype=bool)
        contact = np.where(is_contact, np.cumsum(is_contact) - 1, -1).astype(int)
        edges = [_edges(law, part and part[0]) for law, part in zip(laws, splits, strict=True)]
        edges += [spring.spring.breakpoints for _, spring in springs if _moves(spring)]
        P = max(map(len, edges)) + 1
        low, high = np.full((2, len(edges), P), np.inf)
        for j, inner in enumerate(edges):
            low[j, : len(inner) + 1], high[j, : len(inner)] = [-np.inf, *inner], inner
        slope, offset = np.zeros((2, len(springs), P))
        stiffness = np.zeros((len(springs), 1 + max([0, *(x.spring.stiffness.order for _, x in springs)])), complex)
        for i, (j, (spring, _)) in enumerate(springs):
            inner = edges[j if contact[i] < 0 else len(laws) + contact[i]]
            zones = [bisect_right(spring.corners, x) for x in (-np.inf, *inner)]
            start, changes, breakpoints = spring.ramps
            slope[i, : len(zones)] = np.array(spring.slopes)[zones]
            offset[i, : len(zones)] = start - np.concatenate([[0.0], np.cumsum(changes * breakpoints)])[zones]
            if isinstance(spring.stiffness, Series):
                row = to_complex(spring.stiffness.row())
                stiffness[i, : len(row)] = row
        cubic = np.array([part[1:] for part in terms]).reshape(len(laws), 2)
        in_python = np.array([part is None for part in splits], dtype=bool)
        return LawTable(element, contact, slope, offset, stiffness, low, high, cubic, in_python)

    @property
    def owner(self) -> Integers:
        """Element (m + J,) of each row of segments: of each element, and of each contact."""
        return np.concatenate([np.arange(len(self.in_python)), self.element[self.contact >= 0]])

    @staticmethod
    def stacked(tables: Sequence[LawTable]) -> LawTable:
        """Return the table of several models, with a first axis in all fields that are not equal for all models.

        ValueError is raised if the laws are not of the same kinds, element by element.
        """
        L = max(table.stiffness.shape[1] for table in tables)
        kinds = {(t.element.tobytes(), t.contact.tobytes(), t.in_python.tobytes(), t.low.shape) for t in tables}
        if len(kinds) > 1:
            raise ValueError("the models must have laws of the same kind, element by element")
        stiffness = [np.pad(t.stiffness, ((0, 0), (0, L - t.stiffness.shape[1]))) for t in tables]
        rows = {
            name: np.array([getattr(t, name) for t in tables]) for name in ("slope", "offset", "low", "high", "cubic")
        }
        first = tables[0]
        return LawTable(first.element, first.contact, stiffness=np.array(stiffness), in_python=first.in_python, **rows)


def as_one_spring(law: Law) -> Split | None:
    """Return a law as one piecewise-linear spring, linear on its segments; None if it is not one spring."""
    spring = single_spring(law)
    return None if spring is None else ((MovingSpring(spring, None),), 0.0, 0.0)


def _moves(spring: MovingSpring) -> bool:
    return spring.level is not None


def _edges(law: Law, springs: Sequence[MovingSpring] | None) -> tuple[float, ...]:
    """Return the constant breakpoints of the springs of a law, or of the law itself if it has no springs."""
    if springs is None:
        return tuple(sorted(law.breakpoints))
    return tuple(sorted({x for spring in springs if not _moves(spring) for x in spring.spring.breakpoints}))
