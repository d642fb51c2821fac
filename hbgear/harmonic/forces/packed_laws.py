"""Laws of the elements of a model as a table of numbers.

    p(d, tau) = sum_s k_s(tau) (g0_s + s0_s x + sum_i D_si max(x - x_i, 0)) + k1 d + k3 d^3,   x = d or d - level_s(tau)

The displacement x of a spring is that of its element, or relative to a level that moves over the period, as for a
pair of teeth with a gap. The first m displacements are the elements; those with levels follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.mechanics.laws.compiled_law import CompiledLaw
from hbgear.mechanics.laws.laws import Law, PiecewiseLinear
from hbgear.mechanics.laws.mesh_contacts import contacts_of, first_level, flanks_of, moving_springs_of
from hbgear.mechanics.series.fourier import Series, stretch, to_complex
from hbgear.mechanics.series.periodic import Phased
from hbgear.mechanics.series.piecewise_polynomial import PiecewisePolynomial


class PackedLaws(NamedTuple):
    """Laws of m elements.

    level, owner (K,) : breakpoints x of all laws, element after element, and the displacement of each. First are those
        of `Law.breakpoints`, then those of springs with moving levels.
    ramped (K,) : whether the slope of a spring of the table changes there. If not, and the displacement has a moving
        level, it is the first level of all contacts of a flank, which is used for clearances only.
    element (Q,) : the element of each displacement.
    spring_element, spring_displacement (S,), base (S, 2), series (S, L) : element, displacement, s0 and g0 of each
        spring, and the two-sided coefficients of its stiffness at the basis harmonics shifts (L,), the first of which
        is 0. The series of a stiffness with breakpoints is 1, see `PiecewiseExcitation`.
    ramp_breakpoint, ramp_spring, slope_change (R,) : breakpoint, spring and D of each change of slope.
    cubic (m, 2) : k1 and k3.
    """

    level: Array
    owner: np.ndarray
    ramped: np.ndarray
    element: np.ndarray
    spring_element: np.ndarray
    spring_displacement: np.ndarray
    base: Array
    shifts: np.ndarray
    series: ComplexArray
    ramp_breakpoint: np.ndarray
    ramp_spring: np.ndarray
    slope_change: Array
    cubic: Array


class PackedSpring(NamedTuple):
    """A spring of the table with the numbers of its element and of its displacement."""

    element: int
    displacement: int
    law: PiecewiseLinear


class MovingLevel(NamedTuple):
    """Level of a displacement of an element that moves over the period."""

    element: int
    level: Phased | PiecewisePolynomial


class Packing(NamedTuple):
    """Table of laws with its springs, the moving levels, and the numbers of the elements that it does not describe.

    public_count : number of the breakpoints of the laws, the first in the table.
    """

    table: PackedLaws
    springs: list[PackedSpring]
    levels: list[MovingLevel]
    unpacked: np.ndarray
    public_count: int


def pack_laws(laws: Sequence[Law], sampled: bool, nu: int) -> Packing:
    """Return the table of laws, with all data that the table of breakpoints needs."""
    m = len(laws)
    split_laws = [None if sampled else moving_springs_of(law) for law in laws]
    levels, owner, level = _public_breakpoints(laws, split_laws)
    public_count = len(level)
    position = {(j, x): i for i, (j, x) in enumerate(zip(owner, level, strict=True))}
    displacement_of: dict[tuple[int, Phased], int] = {}
    springs = []
    for j, terms in enumerate(split_laws):
        for spring, moving_level in terms[0] if terms else ():
            q = j
            if moving_level is not None:
                q = displacement_of.setdefault((j, moving_level), m + len(levels))
            if q == m + len(levels):
                levels.append(MovingLevel(j, cast(Phased, moving_level)))
                position[q, 0.0] = len(level)
                owner.append(q)
                level.append(0.0)
            springs.append(PackedSpring(j, q, spring))
    rows = [_two_sided(_series_of(spring.law.stiffness), nu) for spring in springs]
    shifts = sorted({0} | {k for row in rows for k in np.flatnonzero(row).tolist()})
    series = np.zeros((len(springs), len(shifts)), dtype=complex)
    for coefficients, row in zip(series, rows, strict=True):
        coefficients[:] = [row[k] if k < len(row) else 0.0 for k in shifts]
    base, ramps = np.zeros((len(springs), 2)), []
    for s, (_, q, spring) in enumerate(springs):
        g0, changes, breakpoints = spring.ramps
        base[s] = spring.slopes[0], g0
        ramps += [(position[q, float(x)], s, float(D)) for x, D in zip(breakpoints, changes, strict=True)]
    breakpoint_of_ramp, spring_of_ramp, slope_changes = (
        (np.array(column) for column in zip(*ramps, strict=True)) if ramps else ([], [], [])
    )
    breakpoint_of_ramp = np.asarray(breakpoint_of_ramp, dtype=np.int64)
    ramped = np.zeros(len(level), dtype=bool)
    ramped[breakpoint_of_ramp] = True
    cubic = np.array([terms[1:] if terms else (0.0, 0.0) for terms in split_laws], dtype=float).reshape(m, 2)
    table = PackedLaws(
        np.array(level, dtype=float),
        np.array(owner, dtype=np.int64),
        ramped,
        np.array([*range(m), *(moving_level.element for moving_level in levels)], dtype=np.int64),
        np.array([spring.element for spring in springs], dtype=np.int64),
        np.array([spring.displacement for spring in springs], dtype=np.int64),
        base,
        np.array(shifts, dtype=np.int64),
        series,
        breakpoint_of_ramp,
        np.asarray(spring_of_ramp, dtype=np.int64),
        np.asarray(slope_changes, dtype=float),
        cubic,
    )
    is_unpacked = [
        terms is None and not (isinstance(law, CompiledLaw) and law.is_called_by_kernels)
        for terms, law in zip(split_laws, laws, strict=True)
    ]
    return Packing(table, springs, levels, np.flatnonzero(is_unpacked), public_count)


def _public_breakpoints(
    laws: Sequence[Law], split_laws: Sequence[Any]
) -> tuple[list[MovingLevel], list[int], list[float]]:
    """Return the levels, displacements and values of `Law.breakpoints`.

    A breakpoint of contacts with moving levels is the first level of a flank, relative to which its value is zero.
    """
    levels: list[MovingLevel] = []
    owner: list[int] = []
    level: list[float] = []
    for j, law in enumerate(laws):
        contacts = contacts_of(law) if split_laws[j] else ()
        for x, side in zip(law.breakpoints, flanks_of(contacts) if contacts else law.breakpoints, strict=True):
            if contacts:
                owner.append(len(laws) + len(levels))
                levels.append(MovingLevel(j, first_level(contacts, int(side)).level))
            else:
                owner.append(j)
            level.append(0.0 if contacts else float(x))
    return levels, owner, level


def _series_of(stiffness: Phased) -> Array:
    """Return the coefficients of a Fourier series; 1 for a function with breakpoints (see `PiecewiseExcitation`)."""
    return stiffness.row() if isinstance(stiffness, Series) else np.ones(1)


def _two_sided(row: Array, nu: int) -> ComplexArray:
    c = to_complex(stretch(row, nu))
    c[1:] *= 0.5
    return c
