"""Excitation with corners as tables of numbers, for compiled time integration: see `stepping`.

    e_j(tau), k_i(tau) = sum_q rows[p, q] (tau - at[p])^q       from at[p] to at[p + 1]

Steps end at the corners. These are counted by the cell of the period they lie in, or end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.laws import springs_of
from hbgear.mechanics.models import System
from hbgear.mechanics.series.periodic import TURN, Periodic, Phased
from hbgear.time.exponential.segments import Integers

_GRID = 600  # cells of a period that may be needed for corners to fall on their ends


@dataclass(frozen=True)
class Excitation:
    """The functions with corners of R systems: the stiffness of S springs, then the displacements of m elements.

    at (R, S + m, P) : phases where pieces begin; inf beyond the last. rows (R, S + m, P, 4) : coefficients; zero of
    functions without corners. phases : all corners of each system, ascending.
    kinks : jumps (I, m) of the first derivatives of the displacements there.
    """

    at: Array
    rows: Array
    phases: tuple[Array, ...]
    kinks: tuple[Array, ...]

    @staticmethod
    def of(systems: Sequence[System]) -> Excitation:
        """Of systems with the same numbers of springs and elements."""
        each = [_functions(system) for system in systems]
        phases = tuple(_phases(system) for system in systems)
        pieces = [[f.pieces() if isinstance(f, Periodic) else None for f in functions] for functions in each]
        P = max((len(piece.at) for one in pieces for piece in one if piece), default=1)
        Q = len(each[0])
        at, rows = np.full((len(each), Q, P), np.inf), np.zeros((len(each), Q, P, 4))
        at[:, :, :1] = 0.0
        for i, one in enumerate(pieces):
            for q, piece in enumerate(one):
                if piece:
                    at[i, q, : len(piece.at)] = piece.at
                    rows[i, q, : len(piece.at), : piece.rows.shape[1]] = piece.rows
        return Excitation(at, rows, phases, tuple(map(_kinks, systems, phases)))

    @property
    def any(self) -> bool:
        """Whether there are corners."""
        return any(map(len, self.phases))

    def cells(self, least: int) -> int:
        """At least so many cells of the period; if few more are enough for all corners to be ends of cells, these."""
        together = 1
        for x in np.concatenate(self.phases) / TURN:
            share = Fraction(float(x)).limit_denominator(_GRID)
            together = math.lcm(together, share.denominator)
            if together > _GRID or abs(float(share) - x) > 1e-12:
                return least
        return -(-least // together) * together

    def stops(self, N: int, of: Integers, Omega: Array) -> tuple[Integers, Array, Array]:
        """Where steps end among N cells of a period, for rows whose systems are number ``of``, at Omega (R,).

        Returns
        -------
        first (R, N + 1) : the stops first[cell] to first[cell + 1] are those of a cell.
        place (R, I) : in shares of it, above 0, 1 for its end. kink (R, I, m) : by how much the rates e' jump there.
        """
        m = self.kinks[0].shape[1]
        made = [self._stops(i, N) for i in range(len(self.phases))]
        most = max(len(place) for _, place, _ in made)
        first = np.array([made[i][0] for i in of]).reshape(len(of), N + 1)
        place, kink = np.ones((len(of), most)), np.zeros((len(of), most, m))
        for row, i in enumerate(of):
            count = len(made[i][1])
            place[row, :count], kink[row, :count] = made[i][1], Omega[row] * made[i][2]
        return first, place, kink

    def _stops(self, i: int, N: int) -> tuple[Integers, Array, Array]:
        x = self.phases[i] * (N / TURN)
        cell = np.ceil(x - 1e-11).astype(int) - 1
        place = x - cell
        place[place > 1 - 1e-11] = 1.0
        cell[cell < 0] = N - 1  # the corner at 0 is the end of the period
        order = np.lexsort((place, cell))
        cell, place = cell[order], place[order]
        return np.searchsorted(cell, np.arange(N + 1)), place, self.kinks[i][order]


def _kinks(system: System, phases: Array) -> Array:
    """Jumps (I, m) of the first derivatives of the displacements at these phases."""
    out = np.zeros((len(phases), len(system.elements)))
    for j, element in enumerate(system.elements):
        e = element.displacement
        for x, jump in zip(e.phases, e.jumps, strict=True) if isinstance(e, Periodic) else ():
            away = np.abs(phases - x % TURN)
            if away.min() < 1e-9 and len(jump) > 1:
                out[np.argmin(away), j] = jump[1]
    return out


def _functions(system: System) -> list[Phased]:
    parts = [springs_of(element.law) for element in system.elements]
    springs = [spring.stiffness for part in parts if part for spring in part[0]]
    return [*springs, *(element.displacement for element in system.elements)]


def _phases(system: System) -> Array:
    return np.unique([x for e in system.elements for x in (*e.law.phases, *e.displacement.corners)])
