"""Mesh stiffness and transmission error over a mesh cycle from tables of other programs or of a measurement."""

from __future__ import annotations

import os
from collections.abc import Sequence
from math import pi

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.common.units import known_unit
from hbgear.gears.mesh.mesh_cycle import MeshTable
from hbgear.io.tables.table_reader import Kind, named, read_data_table, split
from hbgear.io.tables.table_units import ANGLE, factor_of, plain_unit

_CLOSED = 1e-3  # of the range of values: how well the last value of a table is the first

_PHASE = Kind(
    "phase", dict.fromkeys(("phase", "mesh phase", "phase of mesh", "mesh cycle", "cycle", "tau", "theta", "x"), None),
    lambda unit: unit == "" or unit in ANGLE, "cycle, deg, rad, -",
)  # fmt: skip


@checked_arguments()
def read_mesh_table(path: str | os.PathLike[str], column: int = 1, unit: str = "N/m") -> MeshTable:
    """A function over a mesh cycle from a table of phases and values, measured or computed by other programs.

    One line names the columns with their units: ``phase [deg]; stiffness [N/um]``. The first column has the phases, as
    shares of a mesh cycle [cycle], [rad] or [deg] of it, over one whole cycle; the last row may be the first of the
    next cycle or the last before it. Columns are separated by commas, semicolons, tabs or spaces; lines that begin
    with # are left out.

    Parameters
    ----------
    path : of the file.
    column : of the values, 1 for the second one.
    unit : that the values are converted to.

    Raises
    ------
    ValueError
        If the file is no such table, a unit is missing or does not fit, or the values do not come back after a cycle.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> hb.GearPair(pinion, wheel).mesh("200 N m").export("mesh.csv")  # doctest: +SKIP
    >>> stiffness = hb.io.read_mesh_table("mesh.csv")  # doctest: +SKIP
    """
    if not known_unit(unit):
        raise ValueError(f"read_table: unit = {quoted(unit)} is not known; need one such as 'N/m' or 'm'")
    values = Kind("value", {}, lambda own: factor_of(own, [unit]) is not None, f"{unit} and units that convert to it")
    table = read_data_table(path, "a table of a mesh cycle", [_PHASE, values])
    if not 0 < column < len(table.headings):
        raise ValueError(f"{path}: it has {len(table.headings)} columns and none with the number {column}, from 0")
    if named(table.headings[0], _PHASE) is None:
        raise ValueError(f"{path}: the first column is {quoted(split(table.headings[0])[0])}; need the phase, as in "
                         "'phase [cycle]' (angles of a shaft are other phases)")  # fmt: skip
    phases, found = table.column(0, _PHASE), table.column(column, values)
    if len(table.rows) < 3:
        raise ValueError(f"{path}: {len(table.rows)} rows of numbers are too few for a mesh cycle")
    phase = phases.numbers() * ANGLE[phases.unit or "cycle"] / (2 * pi)
    factor, _ = factor_of(plain_unit(found.unit), [unit]) or (1.0, unit)
    return MeshTable(*_closed(path, phases.lines, phase, found.numbers() * factor))


def _closed(path: object, lines: Sequence[int], phase: Array, value: Array) -> tuple[Array, Array]:
    """Phases from 0 to 1 with the value of the end at both; refuses what does not come back."""
    if np.any(np.diff(phase) < 0):
        line = lines[int(np.flatnonzero(np.diff(phase) < 0)[0]) + 1]
        raise ValueError(f"{path}: phases must ascend; line {line} goes back")
    phase = phase - phase[0]
    length, step = float(phase[-1]), float(np.diff(phase).max())
    if abs(length - 1) < 1e-6:
        phase = phase / length
        apart = abs(value[-1] - value[0])
        if apart > max(_CLOSED * (value.max() - value.min()), 1e-12 * np.abs(value).max()):
            raise ValueError(
                f"{path}: it is not periodic: it begins with {value[0]:.6g} and ends with {value[-1]:.6g} one cycle "
                "later; give one whole mesh cycle (with a jump there, its phase twice)"
            )
        return phase, np.append(value[:-1], value[0])
    if not (length < 1 and 1 - length <= 1.5 * step):
        raise ValueError(f"{path}: its phases go over {length:.4g} mesh cycles; need one whole cycle, periodic")
    return np.append(phase, 1.0), np.append(value, value[0])
