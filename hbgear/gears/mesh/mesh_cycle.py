"""Mesh stiffness and transmission error over one mesh cycle, computed or read from a table.

    force = k(tau) (d - e(tau)) while the teeth touch,   tau = 2 pi phase

Both functions are piecewise linear between the points of their tables. A phase that occurs twice marks a jump.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hbgear.common.argument_checks import check_fields
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import checked_suffix, csv_table
from hbgear.common.ranges import NOT_NEGATIVE, checked
from hbgear.common.units import to_si
from hbgear.mechanics.series.fourier import Series, real_numbers
from hbgear.mechanics.series.periodic import Periodic, Phased

FIT_TOLERANCE = 1e-4
"""Largest fit error of the cubics: of the mesh stiffness relative to its mean, of the transmission error relative to
F/k_mean.
"""

JUMP_HARMONICS = 24
"""Number of harmonics that represent a transmission error with jumps, because the mesh damper has no finite force at a
jump.
"""


@dataclass(frozen=True, eq=False, repr=False)
class MeshTable:  # numpydoc ignore=PR02
    """Piecewise linear function over a mesh cycle.

    Parameters
    ----------
    phase : array_like, shape (P,)
        Fraction of the mesh cycle, ascending from 0 to 1. A phase that occurs twice marks a jump.
    value : array_like, shape (P,)
        Values at these phases. The first and the last value are equal unless the function jumps there.

    Raises
    ------
    ValueError
        If the phases do not ascend from 0 to 1 or a number is not finite.

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
            values = real_numbers(f"Table: {name}", getattr(self, name), "a sequence of numbers")
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        x, y = self.phase, self.value
        if x.ndim != 1 or x.shape != y.shape or len(x) < 2 or not np.isfinite([x, y]).all():
            raise ValueError("Table: phase and value must be finite and of equal length, two numbers at least")
        if np.any(np.diff(x) < 0) or np.any(x[2:] == x[:-2]):
            raise ValueError("Table: phases must ascend; give a phase twice for a jump and never three times")
        if x[0] != 0 or abs(x[-1] - 1) > 1e-9:
            raise ValueError(f"Table: phases go from {x[0]:g} to {x[-1]:g}; they must go from 0 to 1, one whole cycle")

    def __repr__(self) -> str:
        return f"<MeshTable: {len(self.phase)} phases, mean {self.mean:.6g}>"

    @property
    def mean(self) -> float:
        """Mean over the cycle."""
        return float(np.sum(np.diff(self.phase) * (self.value[1:] + self.value[:-1])) / 2)

    @property
    def range(self) -> float:
        """Difference between the largest and the smallest value."""
        return float(self.value.max() - self.value.min())

    def __call__(self, phase: ArrayLike) -> Array:
        """Return the values at fractions of the cycle; at a jump, the value after it."""
        x = np.mod(np.asarray(phase, dtype=float), 1.0)
        right = np.clip(np.searchsorted(self.phase, x, side="right"), 1, len(self.phase) - 1)
        before, after = self.phase[right - 1], self.phase[right]
        with np.errstate(invalid="ignore", divide="ignore"):
            fraction = np.where(after > before, (x - before) / (after - before), 0.0)
        return self.value[right - 1] + fraction * (self.value[right] - self.value[right - 1])

    def mirrored(self, phase: float) -> MeshTable:
        """Return the table of f(phase - x), of the back flanks; ``phase`` is `tooth_mesh.mirror_phase`."""
        turned = phase % 1.0
        x, y = turned - self.phase[::-1], self.value[::-1]
        at_start = np.interp(0.0, x, y)
        first, second = x > 0, x < 0
        phases = np.concatenate([[0.0], x[first], x[second] + 1.0, [1.0]])
        values = np.concatenate([[at_start], y[first], y[second], [at_start]])
        is_new = np.append(True, (np.diff(phases) > 0) | (np.diff(values) != 0))  # the ends of the table meet
        return MeshTable(phases[is_new], values[is_new])

    def function(self, tolerance: float = 0.0) -> Phased:
        """Return the table as a function of the phase tau, including its jumps, for use in models.

        Between jumps the fewest cubics that keep the fit error within ``tolerance`` are used. Each cubic interpolates
        the values at its ends. With zero tolerance the function stays piecewise linear.

        Parameters
        ----------
        tolerance : float, default 0.0
            Largest fit error, in the unit of the values.
        """
        checked("Table.function", "tolerance", tolerance, NOT_NEGATIVE)
        if not self.range > tolerance:
            return Series(self.mean)
        segments: list[tuple[float, list[float]]] = []
        jumps = np.flatnonzero(np.diff(self.phase) == 0)
        ends = [-1, *jumps.tolist(), len(self.phase) - 1]
        for before, last in pairwise(ends):
            if last > before + 1:  # a jump at either end of the cycle leaves no segment beyond it
                fit_cubics(2 * pi * self.phase, self.value, before + 1, last, tolerance, segments)
        return Periodic(
            tuple(begin for begin, _ in segments), tuple(tuple(coefficients) for _, coefficients in segments)
        )


def fit_cubics(
    x: Array, y: Array, first: int, last: int, tolerance: float, segments: list[tuple[float, list[float]]]
) -> None:
    """Append cubics for a range of points.

    If one cubic does not fit within the tolerance, the range is halved.
    """
    width = x[last] - x[first]
    slope = (y[last] - y[first]) / width
    coefficients = [float(y[first]), float(slope)]
    if last > first + 1:
        s = (x[first : last + 1] - x[first]) / width
        deviation = y[first : last + 1] - y[first] - slope * width * s
        basis = np.column_stack([s * (1 - s), s * s * (1 - s)])  # zero at both ends
        a, b = np.linalg.lstsq(basis, deviation, rcond=None)[0] if tolerance else (0.0, 0.0)
        if np.abs(deviation - basis @ [a, b]).max() > tolerance:
            middle = (first + last) // 2
            fit_cubics(x, y, first, middle, tolerance, segments)
            fit_cubics(x, y, middle, last, tolerance, segments)
            return
        coefficients = [coefficients[0], coefficients[1] + a / width, (b - a) / width**2, -b / width**3]
    segments.append((float(x[first]), coefficients))


@dataclass(frozen=True, eq=False)
class MeshCycle:  # numpydoc ignore=PR02
    """Mesh stiffness and transmission error over a mesh cycle, along the line of action in the transverse plane.

    Parameters
    ----------
    stiffness : MeshTable
        Mesh stiffness k(tau) [N/m], positive.
    error : MeshTable
        Transmission error e(tau) without load [m], positive where material is missing.
    force : float or None, optional
        Mesh force at which both were computed [N]. Default None: the load is unknown.

    Raises
    ------
    ValueError
        If the mesh stiffness is not positive everywhere.

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
        lowest = float(self.stiffness.value.min())
        if lowest <= 0:
            phase = float(self.stiffness.phase[np.argmin(self.stiffness.value)])
            raise ValueError(
                f"the mesh stiffness is {lowest:g} N/m at {phase:g} of the cycle; it must be positive "
                "throughout: check the column and its unit, and do not subtract the mean"
            )

    @classmethod
    def loaded(cls, stiffness: MeshTable, static_error: MeshTable, force: Any) -> MeshCycle:
        """Return the cycle of a loaded tooth contact analysis: stiffness and transmission error under a force.

        The error without load is that of the tangent, e(tau) = static_error(tau) - F / k(tau), with which small
        vibration about the static state is correct.

        Parameters
        ----------
        stiffness : MeshTable
            Slope dF/d(delta) of the mesh force at the load [N/m].
        static_error : MeshTable
            Transmission error delta(tau) under the load [m], positive where the driven gear lags behind.
        force : float or str
            Mesh force of the analysis [N].

        Raises
        ------
        ValueError
            If the stiffness is not positive or the force has another unit.

        Examples
        --------
        >>> import hbgear as hb
        >>> k = hb.gears.MeshTable([0, 0.5, 0.5, 1], [2e8, 2e8, 1e8, 1e8])
        >>> delta = hb.gears.MeshTable([0, 0.5, 0.5, 1], [10e-6, 10e-6, 20e-6, 20e-6])
        >>> bool(abs(hb.gears.MeshCycle.loaded(k, delta, "2 kN").error.value).max() < 1e-18)
        True
        """
        F = to_si("MeshCycle.loaded", "force", force, "N")
        x = _joined(stiffness.phase, static_error.phase)
        k, delta = _at(stiffness, x), _at(static_error, x)
        return cls(stiffness, MeshTable(x, delta - F / k), F)

    @property
    def static_error(self) -> MeshTable:
        """Static transmission error e(tau) + F/k(tau) under the force [m]. It is e(tau) if the load is unknown."""
        x = _joined(self.stiffness.phase, self.error.phase)
        k, e = _at(self.stiffness, x), _at(self.error, x)
        return MeshTable(x, e + (self.force or 0.0) / k)

    def mirrored(self, phase: float) -> MeshCycle:
        """Return the cycle of the back flanks, under a negative torque; see `MeshTable.mirrored`."""
        return MeshCycle(self.stiffness.mirrored(phase), self.error.mirrored(phase), self.force)

    def functions(self, force: float) -> tuple[float, Phased, Phased]:
        """Return k_mean [N/m], k(tau)/k_mean and e(tau) [m] without jumps, in the form required by the models.

        Parameters
        ----------
        force : float
            Mesh force [N], which sets the size of errors that matter.
        """
        k = self.stiffness.function(FIT_TOLERANCE * self.stiffness.mean)
        e = self.error.function(FIT_TOLERANCE * abs(force) / k.mean)
        return k.mean, k.scaled(1 / k.mean), _without_jumps(e)

    @property
    def peak_to_peak(self) -> float:
        """Peak-to-peak value of the static transmission error [m]."""
        return self.static_error.range

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write phase, k, e and static transmission error to a CSV table that `read_mesh_table` reads."""
        checked_suffix(path, (".csv",), "tables of a mesh cycle are .csv files")
        x = _joined(self.stiffness.phase, self.error.phase)
        columns = [x, _at(self.stiffness, x), _at(self.error, x), self.static_error.value]
        if any(column[0] != column[-1] for column in columns[1:]):  # a jump at the beginning of the cycle
            columns = [np.append(column, column[0] if i else 1.0) for i, column in enumerate(columns)]
        with csv_table(path) as writer:
            writer.writerow(["phase [cycle]", "stiffness [N/m]", "error [m]", "static error [m]"])
            writer.writerows(zip(*columns, strict=True))


def _without_jumps(e: Phased) -> Phased:
    """Return a transmission error without jumps, truncated to its first harmonics if it has any.

    Pairs of teeth that enter contact with a pitch error cause such jumps.
    """
    if not isinstance(e, Periodic) or e.continuous:
        return e
    coefficients = e.row(JUMP_HARMONICS)
    return Series(float(coefficients[0]), tuple(coefficients[1::2].tolist()), tuple(coefficients[2::2].tolist()))


def _joined(a: Array, b: Array) -> Array:
    """Return the union of the phases of two tables; a jump of either table remains a double phase."""
    counts = {float(x): max(int(np.sum(a == x)), int(np.sum(b == x))) for x in np.union1d(a, b)}
    return np.repeat(list(counts), list(counts.values()))


def _at(table: MeshTable, x: Array) -> Array:
    """Return the values of a table at phases; a phase that occurs twice in ``x`` marks a jump."""
    out = np.interp(x, table.phase, table.value)
    for i in range(len(x)):
        rows = np.flatnonzero(table.phase == x[i])
        if len(rows) == 2:
            before = i + 1 < len(x) and x[i + 1] == x[i]
            out[i] = table.value[rows[0] if before else rows[1]]
    return out
