"""Mesh stiffness and transmission error over a mesh cycle, from tables of other programs or measurements."""

from __future__ import annotations

import os
from collections.abc import Sequence
from math import pi

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.common.text.unit_spellings import plain_unit
from hbgear.common.units import known_unit
from hbgear.gears.mesh.mesh_cycle import MeshTable
from hbgear.io.tables.table_reader import DataTable, Kind, named, read_data_table, split
from hbgear.io.tables.table_units import ANGLE, factor_of

PERIODICITY_TOLERANCE = 1e-3
"""Largest difference between the first and last value of a cycle, relative to the range of values."""

_PHASE = Kind(
    "phase",
    dict.fromkeys(("phase", "mesh phase", "phase of mesh", "mesh cycle", "cycle", "tau", "theta", "x"), None),
    lambda unit: unit == "" or unit in ANGLE,
    "cycle, deg, rad, -",
)

_STIFFNESS = (
    "stiffness",
    "mesh stiffness",
    "gear mesh stiffness",
    "time varying mesh stiffness",
    "tvms",
    "k",
    "k(t)",
    "k m",
    "km",
    "k mesh",
    "c gamma",
    "torsional stiffness",
)
_ERROR = (
    "error",
    "transmission error",
    "static transmission error",
    "loaded transmission error",
    "unloaded transmission error",
    "static error",
    "te",
    "ste",
    "lte",
    "e",
    "e(t)",
    "displacement",
    "deviation",
)


@checked_arguments()
def read_mesh_table(path: str | os.PathLike[str], column: int | str = 1, unit: str = "N/m") -> MeshTable:
    """Read a function over a mesh cycle from a table of phases and values.

    The header names the columns with their units: ``phase [deg]; stiffness [N/um]``. The first column contains the
    phases, as fractions [cycle], [rad] or [deg] of a mesh cycle, over one whole cycle; the last row may be the first
    one of the next cycle or the last one before it. Columns are separated by commas, semicolons, tabs or spaces; lines
    that begin with # are comments.

    Parameters
    ----------
    path : str or path-like
        Path of the file.
    column : int or str, optional
        Column of the values; default 1, the second one, which must be called a stiffness or an error. A column of
        another name is given by its name as written, without unit: ``column="stiffness of pair 1"``.
    unit : str, optional
        Unit to which the values are converted; default "N/m".

    Returns
    -------
    MeshTable
        The function over a mesh cycle.

    Raises
    ------
    ValueError
        If the file is not such a table, a name is unknown, a unit is missing or unsuitable, or the values are not
        periodic.

    Examples
    --------
    >>> import hbgear as hb
    >>> pinion, wheel = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 40))
    >>> hb.GearPair(pinion, wheel).mesh("200 N m").export("mesh.csv")  # doctest: +SKIP
    >>> stiffness = hb.io.read_mesh_table("mesh.csv")  # doctest: +SKIP
    """
    if not known_unit(unit):
        raise ValueError(f"read_table: unit = {quoted(unit)} is not known; need one such as 'N/m' or 'm'")
    values = Kind(
        "value",
        dict.fromkeys(_names_for(unit), None),
        lambda x: factor_of(x, [unit]) is not None,
        f"{unit} and units that convert to it",
    )
    table = read_data_table(path, "a table of a mesh cycle", [_PHASE, values])
    column = _position(path, table, column, values)
    if named(table.headings[0], _PHASE) is None:
        raise ValueError(
            f"{path}: the first column is {quoted(split(table.headings[0])[0])}; need the phase, as in "
            "'phase [cycle]' (shaft angles are not phases of the mesh)"
        )
    phases, value_column = table.column(0, _PHASE), table.column(column, values)
    if len(table.rows) < 3:
        raise ValueError(f"{path}: {len(table.rows)} rows of numbers are too few for a mesh cycle")
    phase = phases.numbers() * ANGLE[phases.unit or "cycle"] / (2 * pi)
    factor, _ = factor_of(plain_unit(value_column.unit), [unit]) or (1.0, unit)
    return MeshTable(*_closed(path, phases.lines, phase, value_column.numbers() * factor))


def _names_for(unit: str) -> tuple[str, ...]:
    """Return the names of columns that can have a unit."""
    if factor_of(unit, ["N/m", "N m/rad"]) is not None:
        return _STIFFNESS
    return _ERROR if factor_of(unit, ["m", "rad"]) is not None else _STIFFNESS + _ERROR


def _position(path: object, table: DataTable, column: int | str, values: Kind) -> int:
    """Return the number of the column of the values; refuse a column of an unknown name that is not given by it."""
    column_names = [split(heading)[0] for heading in table.headings]
    if isinstance(column, str):
        if column_names[1:].count(column.strip()) != 1:
            raise ValueError(
                f"{path}: it has no column {quoted(column)}; it has {', '.join(map(quoted, column_names))}"
            )
        return column_names.index(column.strip(), 1)
    if not 0 < column < len(column_names):
        raise ValueError(f"{path}: it has {len(column_names)} columns, and no column {column} (from 0)")
    if named(table.headings[column], values) is None:
        name = quoted(column_names[column])
        raise ValueError(
            f"{path}: the column {name} is unknown; accepted are {', '.join(values.names)}; a column of "
            f"another name is given by it: column={name}"
        )
    return column


def _closed(path: object, lines: Sequence[int], phase: Array, value: Array) -> tuple[Array, Array]:
    """Return phases from 0 to 1, with the same value at both ends; refuse values that are not periodic."""
    if np.any(np.diff(phase) < 0):
        line = lines[int(np.flatnonzero(np.diff(phase) < 0)[0]) + 1]
        raise ValueError(f"{path}: phases must ascend; line {line} goes back")
    phase = phase - phase[0]
    length, step = float(phase[-1]), float(np.diff(phase).max())
    if abs(length - 1) < 1e-6:
        phase = phase / length
        difference = abs(value[-1] - value[0])
        if difference > max(PERIODICITY_TOLERANCE * (value.max() - value.min()), 1e-12 * np.abs(value).max()):
            raise ValueError(
                f"{path}: the values are not periodic: the first is {value[0]:.6g}, the last, one cycle later, "
                f"{value[-1]:.6g}; give one whole mesh cycle (at a discontinuity, give its phase twice)"
            )
        return phase, np.append(value[:-1], value[0])
    if not (length < 1 and 1 - length <= 1.5 * step):
        raise ValueError(
            f"{path}: its phases span {length:.4g} mesh cycles; need one whole cycle, periodic: from "
            "one pair of teeth to the next, 1/z of a revolution"
        )
    return np.append(phase, 1.0), np.append(value, value[0])
