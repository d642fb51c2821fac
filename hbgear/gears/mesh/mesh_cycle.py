"""Mesh stiffness and transmission error over one mesh cycle: computed, or a table from elsewhere.

    force = k(tau) (d - e(tau)) while the teeth touch,   tau = 2 pi phase

Both are straight between their points; a phase that is there twice is a jump.
"""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import check_fields
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write, checked_suffix
from hbgear.common.ranges import NOT_NEGATIVE, checked
from hbgear.mechanics.series.fourier import Series, real_numbers
from hbgear.mechanics.series.periodic import Periodic, Phased

TOLERANCE = 1e-4
"""By how much cubics may miss the mesh stiffness, over its mean, and the transmission error, over F/k_mean."""

MOST = 24
"""Harmonics of an error that jumps: the damper of the mesh has no force for a jump."""


@dataclass(frozen=True, eq=False)
class MeshTable:
    """A function over a mesh cycle that is straight between its points.

    Parameters
    ----------
    phase : (P,) from 0 to 1, the share of the cycle, ascending; twice the same phase is a jump.
    value : (P,) first and last are the same, unless it jumps there.

    Raises
    ------
    ValueError
        If phases do not ascend or do not go over one whole cycle, or numbers are not finite.

    Examples
    --------
    >>> import hbgear as hb
    >>> square = hb.gears.MeshTable(phase=[0, 0.5, 0.5, 1], value=[2e8, 2e8, 1e8, 1e8])
    >>> square.mean, len(square.function().corners)
    (150000000.0, 2)
    """

    phase: Any
    value: Any

    def __post_init__(self) -> None:
        for name in ("phase", "value"):
            row = real_numbers(f"Table: {name}", getattr(self, name), "a sequence of numbers")
            row.flags.writeable = False
            object.__setattr__(self, name, row)
        x, y = self.phase, self.value
        if x.ndim != 1 or x.shape != y.shape or len(x) < 2 or not np.isfinite([x, y]).all():
            raise ValueError("Table: phase and value must be as many finite numbers, two at least")
        if np.any(np.diff(x) < 0) or np.any(x[2:] == x[:-2]):
            raise ValueError("Table: phases must ascend; one that is there twice is a jump")
        if x[0] != 0 or abs(x[-1] - 1) > 1e-9:
            raise ValueError(f"Table: phases go from {x[0]:g} to {x[-1]:g}; they must go from 0 to 1, a whole cycle")

    @property
    def mean(self) -> float:
        """Mean over the cycle."""
        return float(np.sum(np.diff(self.phase) * (self.value[1:] + self.value[:-1])) / 2)

    @property
    def range(self) -> float:
        """Largest minus smallest value."""
        return float(self.value.max() - self.value.min())

    def __call__(self, phase: ArrayLike) -> Array:
        """Values at shares of the cycle; on a jump the value after it."""
        x = np.mod(np.asarray(phase, dtype=float), 1.0)
        right = np.clip(np.searchsorted(self.phase, x, side="right"), 1, len(self.phase) - 1)
        a, b = self.phase[right - 1], self.phase[right]
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(b > a, (x - a) / (b - a), 0.0)
        out: Array = self.value[right - 1] + share * (self.value[right] - self.value[right - 1])
        return out

    def function(self, tolerance: float = 0.0) -> Phased:
        """The table as a function of the phase tau, with its jumps, for models; without tolerance straight as it is.

        Between jumps, as few cubics as miss no value by more than the tolerance, each through the values at its ends.

        Parameters
        ----------
        tolerance : [unit of the values].
        """
        checked("Table.function", "tolerance", tolerance, NOT_NEGATIVE)
        if not self.range > tolerance:
            return Series(self.mean)
        pieces: list[tuple[float, list[float]]] = []
        jumps = np.flatnonzero(np.diff(self.phase) == 0)
        ends = [-1, *jumps.tolist(), len(self.phase) - 1]
        for before, last in pairwise(ends):
            if last > before + 1:  # a jump where the cycle begins or ends has nothing beyond it
                _fit(2 * pi * self.phase, self.value, before + 1, last, tolerance, pieces)
        return Periodic(tuple(begin for begin, _ in pieces), tuple(tuple(row) for _, row in pieces))


def _fit(x: Array, y: Array, first: int, last: int, tolerance: float, pieces: list[tuple[float, list[float]]]) -> None:
    """Add the pieces of some points: one cubic if it misses none by the tolerance, else those of both halves."""
    width = x[last] - x[first]
    chord = (y[last] - y[first]) / width
    row = [float(y[first]), float(chord)]
    if last > first + 1:
        s = (x[first : last + 1] - x[first]) / width
        missed = y[first : last + 1] - y[first] - chord * width * s
        bends = np.column_stack([s * (1 - s), s * s * (1 - s)])  # nothing at the ends
        a, b = np.linalg.lstsq(bends, missed, rcond=None)[0] if tolerance else (0.0, 0.0)
        if np.abs(missed - bends @ [a, b]).max() > tolerance:
            middle = (first + last) // 2
            _fit(x, y, first, middle, tolerance, pieces)
            _fit(x, y, middle, last, tolerance, pieces)
            return
        row = [row[0], row[1] + a / width, (b - a) / width**2, -b / width**3]
    pieces.append((float(x[first]), row))


@dataclass(frozen=True, eq=False)
class MeshCycle:
    """Mesh stiffness and transmission error over a mesh cycle, along the line of action in the transverse plane.

    Parameters
    ----------
    stiffness : `MeshTable` of k(tau) [N/m], positive.
    error : `MeshTable` of e(tau) [m], the transmission error without load: positive where material is missing.
    force : of the mesh [N] at which both were computed; None for tables of unknown load.

    Raises
    ------
    ValueError
        If the stiffness is not positive.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> cycle = hb.GearPair(pinion, wheel, "80 um").mesh("200 N m")
    >>> round(cycle.stiffness.mean / 1e8, 2), round(cycle.peak_to_peak * 1e6, 1)
    (3.95, 9.3)
    """

    stiffness: MeshTable
    error: MeshTable
    force: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.force is not None:
            checked("MeshCycle", "force", self.force, NOT_NEGATIVE)
        least = float(self.stiffness.value.min())
        if least <= 0:
            where = float(self.stiffness.phase[np.argmin(self.stiffness.value)])
            raise ValueError(f"the mesh stiffness is {least:g} N/m at {where:g} of the cycle; it must be positive "
                             "throughout: is the column or its unit wrong, or was a mean taken off?")  # fmt: skip

    @property
    def static_error(self) -> MeshTable:
        """Static transmission error e(tau) + F/k(tau) under the force [m]; of unknown load, e(tau) alone."""
        x = _joined(self.stiffness.phase, self.error.phase)
        k, e = _at(self.stiffness, x), _at(self.error, x)
        return MeshTable(x, e + (self.force or 0.0) / k)

    def functions(self, force: float) -> tuple[float, Phased, Phased]:
        """As models take it: k_mean [N/m], k(tau)/k_mean, and e(tau) [m], which has no jumps.

        Parameters
        ----------
        force : of the mesh [N], for the size of the errors that matter.
        """
        k = self.stiffness.function(TOLERANCE * self.stiffness.mean)
        e = self.error.function(TOLERANCE * abs(force) / k.mean)
        return k.mean, k.scaled(1 / k.mean), _without_jumps(e)

    @property
    def peak_to_peak(self) -> float:
        """Of the static transmission error [m]."""
        return self.static_error.range

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a table (.csv): phase, k, e, static transmission error. `read_mesh_table` reads it again."""
        checked_suffix(path, (".csv",), "tables of a mesh cycle are .csv")
        x = _joined(self.stiffness.phase, self.error.phase)
        columns = [x, _at(self.stiffness, x), _at(self.error, x), self.static_error.value]
        if any(column[0] != column[-1] for column in columns[1:]):  # a jump where the cycle begins
            columns = [np.append(column, column[0] if i else 1.0) for i, column in enumerate(columns)]
        with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(["phase [cycle]", "stiffness [N/m]", "error [m]", "static error [m]"])
            writer.writerows(zip(*columns, strict=True))


def _without_jumps(e: Phased) -> Phased:
    """An error that jumps, as that of pairs of teeth which come with a pitch error, by its first harmonics."""
    if not isinstance(e, Periodic) or e.continuous:
        return e
    row = e.row(MOST)
    return Series(float(row[0]), tuple(row[1::2].tolist()), tuple(row[2::2].tolist()))


def _joined(a: Array, b: Array) -> Array:
    """Phases of two tables in one; a jump of either is one there too."""
    counts = {float(x): max(int(np.sum(a == x)), int(np.sum(b == x))) for x in np.union1d(a, b)}
    return np.repeat(list(counts), list(counts.values()))


def _at(table: MeshTable, x: Array) -> Array:
    """Values at phases of which one that is there twice is a jump."""
    out: Array = np.interp(x, table.phase, table.value)
    for i in range(len(x)):
        twice = np.flatnonzero(table.phase == x[i])
        if len(twice) == 2:
            before = i + 1 < len(x) and x[i + 1] == x[i]
            out[i] = table.value[twice[0] if before else twice[1]]
    return out
