"""Excitation with breakpoints as tables of numbers, for compiled time integration: see `kernels`.

    e_j(tau), k_i(tau), level_c(tau) = sum_q rows[p, q] (tau - at[p])^q       from at[p] to at[p + 1]

Steps end at the breakpoints. These are assigned to the cell of the period in which they lie or end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.laws.mesh_contacts import moving_springs_of
from hbgear.mechanics.models import System
from hbgear.mechanics.series.periodic import Periodic, Phased, pieces_of
from hbgear.mechanics.series.piecewise_polynomial import TURN
from hbgear.time.exponential.segments import Integers

_MAX_COMMON_CELLS = 600
"""Largest number of cells of a period [-] that is used to place all breakpoints on ends of cells."""


@dataclass(frozen=True)
class Excitation:
    """Functions with breakpoints of R systems: stiffness of S springs, displacements of m elements, J contact levels.

    Attributes
    ----------
    starts : ndarray, shape (R, S + m + J, P)
        Phases at which segments begin; inf beyond the last.
    rows : ndarray, shape (R, S + m + J, P, 4)
        Coefficients; zero for stiffness and displacements without breakpoints.
    contacts : int
        J.
    phases : tuple of ndarray
        All breakpoints of each system, ascending.
    kinks : tuple of ndarray, shape (I, m)
        Jumps of the first derivatives of the displacements at the breakpoints.
    """

    starts: Array
    rows: Array
    contacts: int
    phases: tuple[Array, ...]
    kinks: tuple[Array, ...]

    @staticmethod
    def of(systems: Sequence[System]) -> Excitation:
        """Return the tables of systems with the same numbers of springs and elements."""
        functions_of = [_functions(system) for system in systems]
        phases = tuple(_phases(system) for system in systems)
        pieces = [
            [f.pieces() if isinstance(f, Periodic) else None for f in functions] + list(map(pieces_of, levels))
            for functions, levels in functions_of
        ]
        P = max((len(piece.at) for system_pieces in pieces for piece in system_pieces if piece), default=1)
        Q, contacts = len(pieces[0]), len(functions_of[0][1])
        starts, rows = np.full((len(functions_of), Q, P), np.inf), np.zeros((len(functions_of), Q, P, 4))
        starts[:, :, :1] = 0.0
        for i, system_pieces in enumerate(pieces):
            for q, piece in enumerate(system_pieces):
                if piece:
                    starts[i, q, : len(piece.at)] = piece.at
                    rows[i, q, : len(piece.at), : piece.rows.shape[1]] = piece.rows
        return Excitation(starts, rows, contacts, phases, tuple(map(_kinks, systems, phases)))

    @property
    def any(self) -> bool:
        """True if there are breakpoints or contacts."""
        return self.contacts > 0 or any(map(len, self.phases))

    def levels(self, index: Integers, Omega: Array) -> tuple[Array, Array]:
        """Return levels and rates (R, m + J) at tau = 0 for rows of systems ``index`` at Omega (R,); 0 for elements."""
        m = self.kinks[0].shape[1]
        rows = np.zeros((len(index), m + self.contacts, 4))
        rows[:, m:] = self.rows[index, self.rows.shape[1] - self.contacts :, 0]
        return rows[..., 0], Omega[:, None] * rows[..., 1]

    def cells(self, minimum: int) -> int:
        """Return the number of cells of the period, at least ``minimum``.

        A slightly larger number is returned if all breakpoints are then ends of cells.
        """
        multiple = 1
        for x in np.concatenate(self.phases) / TURN:
            fraction = Fraction(float(x)).limit_denominator(_MAX_COMMON_CELLS)
            multiple = math.lcm(multiple, fraction.denominator)
            if multiple > _MAX_COMMON_CELLS or abs(float(fraction) - x) > 1e-12:
                return minimum
        return -(-minimum // multiple) * multiple

    def step_ends(self, N: int, index: Integers, Omega: Array) -> tuple[Integers, Array, Array]:
        """Return the positions in N cells of a period at which steps end, for systems ``index`` (R,) at Omega (R,).

        Returns
        -------
        first : ndarray, shape (R, N + 1)
            Index of the first breakpoint of each cell.
        position : ndarray, shape (R, I)
            Positions as fractions of the cell, above 0; 1 is its end.
        kink : ndarray, shape (R, I, m)
            Jumps of the rates e'.
        """
        m = self.kinks[0].shape[1]
        ends = [self._step_ends(i, N) for i in range(len(self.phases))]
        largest = max(len(position) for _, position, _ in ends)
        first = np.array([ends[i][0] for i in index]).reshape(len(index), N + 1)
        position, kink = np.ones((len(index), largest)), np.zeros((len(index), largest, m))
        for row, i in enumerate(index):
            count = len(ends[i][1])
            position[row, :count], kink[row, :count] = ends[i][1], Omega[row] * ends[i][2]
        return first, position, kink

    def _step_ends(self, i: int, N: int) -> tuple[Integers, Array, Array]:
        """Return `step_ends` of system i at Omega = 1."""
        x = self.phases[i] * (N / TURN)
        cell = np.ceil(x - 1e-11).astype(int) - 1
        position = x - cell
        position[position > 1 - 1e-11] = 1.0
        cell[cell < 0] = N - 1  # the breakpoint at 0 is the end of the period
        order = np.lexsort((position, cell))
        cell, position = cell[order], position[order]
        return np.searchsorted(cell, np.arange(N + 1)), position, self.kinks[i][order]


def _kinks(system: System, phases: Array) -> Array:
    """Return the jumps (I, m) of the first derivatives of the displacements at given phases."""
    out = np.zeros((len(phases), len(system.elements)))
    for j, element in enumerate(system.elements):
        e = element.displacement
        for x, jump in zip(e.phases, e.jumps, strict=True) if isinstance(e, Periodic) else ():
            distance = np.abs(phases - x % TURN)
            if distance.min() < 1e-9 and len(jump) > 1:
                out[np.argmin(distance), j] = jump[1]
    return out


def _functions(system: System) -> tuple[list[Phased], list[Phased]]:
    """Return the stiffness of all springs and the displacements of all elements, and the levels of all contacts."""
    splits = [moving_springs_of(element.law) for element in system.elements]
    springs = [s for part in splits if part for s in part[0]]
    functions = [*(s.spring.stiffness for s in springs), *(element.displacement for element in system.elements)]
    return functions, [s.level for s in springs if s.level is not None]


def _phases(system: System) -> Array:
    """Return all breakpoints of a system over the phase."""
    return np.unique([x for e in system.elements for x in (*e.law.phases, *e.displacement.corners)])
