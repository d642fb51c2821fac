"""Tables of slow sweeps: columns of frequency, amplitude, direction and deviation, with units in the column names."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.text.decoding import bytes_of_file
from hbgear.common.text.messages import did_you_mean, quoted
from hbgear.design.fitting.measurements import FREQUENCIES, Measurements
from hbgear.harmonic.models.frequency_units import MESH, PINION
from hbgear.io.tables.table_reader import Column, Kind, data_table, normal, split
from hbgear.io.tables.table_units import FREQUENCY, factor_of
from hbgear.mechanics.series.measures import BUILT_IN_MEASURES

_DIRECTIONS = {
    **dict.fromkeys(("up", "rising", "increasing", "+1", "1", "+"), 1),
    **dict.fromkeys(("down", "falling", "decreasing", "-1", "-"), -1),
}
_SPEEDS = ("n", "speed", "pinion", "pinion speed", "rotational speed", "shaft speed")
_TRANSMISSION_ERRORS = ("dte", "dte, half peak to peak", "te", "transmission error", "dynamic transmission error")
_PP2 = "half peak to peak"  # as in headings of `hbgear.analysis.machine_quantities`
_DISPLACEMENTS = ("amplitude", "a", "x", "d", "y", "displacement", f"displacement, {_PP2}", "gap", _PP2)
_SELECT_COLUMNS = "; or select columns: columns={'amplitude': HEADER}, in a command --column amplitude=HEADER"
_COLUMN_UNITS = {"Omega": "", MESH: "Hz", PINION: "r/min"}


def _is_length(unit: str) -> bool:
    return unit == "" or factor_of(unit, ["m"]) is not None


def _is_deviation(unit: str) -> bool:
    return unit == "%" or _is_length(unit)


KINDS = (
    Kind(
        "frequency",
        dict.fromkeys(("frequency", "freq", "f", "Omega"), "")
        | dict.fromkeys(("omega", "angular frequency", "mesh", "mesh frequency", "excitation frequency"))
        | {"Hz": "Hz", "rpm": "r/min"}
        | dict.fromkeys(_SPEEDS),
        lambda unit: unit == "" or unit in FREQUENCY,
        f"{', '.join(FREQUENCY)}, - (Omega)",
    ),
    Kind(
        "amplitude",
        dict.fromkeys((*_DISPLACEMENTS, *_TRANSMISSION_ERRORS, *BUILT_IN_MEASURES), ""),
        _is_length,
        "um, mm, m, - (unit of the model)",
    ),
    Kind("direction", dict.fromkeys(("direction", "sweep", "sweep direction", "dir"), ""), "".__eq__, "-"),
    Kind(
        "deviation",
        dict.fromkeys(("deviation", "standard deviation", "std", "sigma", "uncertainty"), ""),
        _is_deviation,
        "um, mm, m, %, - (unit of the amplitude)",
    ),
)
"""Columns of a table of measurements."""

ROLES = tuple(kind.role for kind in KINDS)


@checked_arguments(columns="names of columns, such as {'frequency': 'rpm', 'amplitude': 'x'}")
def read_measurements(
    path: str | os.PathLike[str], columns: Mapping[str, str] | None = None, **settings: Any
) -> Measurements:
    """Read measurements from a table whose column names state the units: ``n [r/min], dte [um], direction``.

    Frequencies in r/min are speeds of the pinion, frequencies in Hz are mesh frequencies, and frequencies without a
    unit are values of Omega. Amplitudes without a unit are in the unit of the model. A line without an amplitude
    states the frequency of a jump. Directions are up or down, rising or falling, +1 or -1. Without a column of
    directions, every sweep has a rising frequency. Columns are separated by commas, semicolons, tabs or spaces. Lines
    that begin with # are ignored. A table of two columns needs no line of names.

    Parameters
    ----------
    path : path-like
        Path of the file.
    columns : mapping of str to str or None, optional
        Names of the columns: ``{"frequency": ..., "amplitude": ..., "direction": ..., "deviation": ...}``. Other
        columns are ignored. Default: these names, or common ones such as ``n`` and ``dte``.
    **settings : object
        Arguments ``unit``, ``length``, ``measure``, ``element``, ``transmission_error`` and, without a column,
        ``direction`` of `Measurements`. ``unit`` and ``length`` apply to columns whose names state no unit. A column
        named dte, te or transmission error has transmission errors.

    Returns
    -------
    Measurements
        The measurements.

    Raises
    ------
    ValueError
        If the file is not such a table, or a name or unit is unknown; the message states the line or the column.
    KeyError
        If a column is missing.

    Examples
    --------
    >>> import hbgear as hb
    >>> data = hb.design.read_measurements("sweep.csv", {"amplitude": "accelerometer 3 [um]"})  # doctest: +SKIP
    """
    return measurements_of(bytes_of_file(path, "measurements"), str(path), columns, **settings)


def measurements_of(
    content: bytes, name: str, columns: Mapping[str, str] | None = None, **settings: Any
) -> Measurements:
    r"""Return the measurements in the bytes of a table; see `read_measurements`.

    Examples
    --------
    >>> data = measurements_of(b"n [r/min];dte [um];direction\n600;0,1;up\n1200;0,3;down", "run.csv")
    >>> data.unit, data.frequency.tolist(), data.length, data.directions.tolist()
    ('pinion r/min', [600.0, 1200.0], 'um', [1, -1])
    """
    for role in columns or {}:
        if role not in ROLES:
            raise KeyError(f"there is no column for '{role}'{did_you_mean(role, ROLES)}")
    settings = {key: value for key, value in settings.items() if value is not None}
    unit, length = settings.pop("unit", None), settings.pop("length", "")
    if unit is not None and unit not in FREQUENCIES:
        raise ValueError(f"Measurements: unit = {quoted(unit)}{did_you_mean(str(unit), FREQUENCIES)}")
    assumed = {"amplitude": str(length)} | ({} if unit is None else {"frequency": _COLUMN_UNITS[unit]})
    default = ("frequency", "amplitude", "direction")
    table = data_table(content, name, KINDS, default)
    columns_by_role = table.columns(KINDS, columns, assumed, _SELECT_COLUMNS)
    if "frequency" not in columns_by_role:
        raise ValueError(
            f"'{name}' has no frequency, only {', '.join(map(quoted, table.headings))}; need a column "
            "such as 'n [r/min]', 'frequency [Hz]' or 'Omega'"
        )
    frequency_unit, factor = _frequency(columns_by_role["frequency"], unit)
    measure = _measure(columns_by_role.get("amplitude"), settings)
    return _measurements(columns_by_role, frequency_unit, factor, settings | measure)


def _frequency(column: Column, given_unit: str | None) -> tuple[str, float]:
    """Return the unit of `Measurements` for a column of frequencies, and the factor to this unit."""
    is_speed = normal(split(column.heading)[0]) in _SPEEDS
    text = f"'{column.file}': the column {quoted(column.heading)}"
    if is_speed and column.unit in ("Hz", "kHz", "mHz", "MHz"):
        raise ValueError(
            f"{text} may be the mesh frequency or turns per second; write 'mesh frequency [Hz]' or give "
            "the speed in [r/min]"
        )
    if column.unit == "":
        unit, factor = "Omega", 1.0
    elif is_speed or column.unit in ("r/min", "r/s", "deg/s"):
        unit, factor = PINION, 60 * FREQUENCY[column.unit] if column.unit != "r/min" else 1.0
    else:
        unit, factor = MESH, FREQUENCY[column.unit]
    if given_unit not in (None, unit):
        raise ValueError(
            f"{text} is {unit}, and unit = {quoted(given_unit)} was given; leave this argument out, or correct the "
            "name of the column"
        )
    return unit, factor


def _measure(column: Column | None, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the measure that is the name of the column of amplitudes, if it is one, or that it is an error."""
    if column is None:
        return {}
    name = normal(split(column.heading)[0])
    is_error = name in _TRANSMISSION_ERRORS
    found = {"transmission_error": settings.get("transmission_error", True)} if is_error else {}
    measure = "pp2" if name.endswith(_PP2) else name
    if measure not in BUILT_IN_MEASURES:
        return found
    if settings.get("measure", measure) != measure:
        raise ValueError(
            f"'{column.file}': the column {quoted(column.heading)} is {measure}, and measure = "
            f"{quoted(settings['measure'])} was given; give the same measure"
        )
    return found | {"measure": measure}


def _measurements(roles: Mapping[str, Column], unit: str, factor: float, settings: Mapping[str, Any]) -> Measurements:
    """Return the measurements of the lines of the columns."""
    points: list[list[float]] = []
    jumps: list[list[float]] = []
    amplitude, deviation, direction = (roles.get(role) for role in ("amplitude", "deviation", "direction"))
    for i in range(len(roles["frequency"].cells)):
        frequency = _positive(roles["frequency"], i) * factor
        direction_i = settings.get("direction", 1) if direction is None else _direction(direction, i)
        if amplitude is not None and amplitude.cells[i]:
            size = _positive(amplitude, i)
            deviations = (
                [_deviation(deviation, i, size, amplitude)] if deviation is not None and deviation.cells[i] else []
            )
            points.append([frequency, size, direction_i, *deviations])
        else:
            deviations = (
                [_jump_deviation(deviation, i, frequency, factor)]
                if deviation is not None and deviation.cells[i]
                else []
            )
            jumps.append([frequency, direction_i, *deviations])
    arguments = {key: value for key, value in settings.items() if key != "direction"}
    arguments |= {"unit": unit, "length": "" if amplitude is None else amplitude.unit}
    if len({len(point) for point in points}) > 1:
        raise ValueError(
            f"'{roles['frequency'].file}': some amplitudes have a deviation and some have none; give one "
            "for each of them or for none"
        )
    if not points:
        return Measurements([], [], jumps=jumps, **arguments)
    columns = np.array(points, dtype=float).T
    return Measurements(
        columns[0], columns[1], columns[2], columns[3] if len(columns) > 3 else None, jumps, **arguments
    )


def _positive(column: Column, i: int) -> float:
    value = column.number(i)
    if value <= 0:
        raise column.wrong(i, "must be a positive number")
    return value


def _direction(column: Column, i: int) -> int:
    word = column.cells[i].casefold()
    if word not in _DIRECTIONS:
        raise column.wrong(i, "must be up or down, increasing or decreasing, rising or falling, +1 or -1")
    return _DIRECTIONS[word]


def _deviation(column: Column, i: int, size: float, amplitude: Column) -> float:
    """Return the deviation of an amplitude, in the unit of the amplitude."""
    value = _positive(column, i)
    if column.unit in ("", amplitude.unit):
        return value
    if column.unit == "%":
        return value / 100 * size
    deviation_unit, amplitude_unit = factor_of(column.unit, ["m"]), factor_of(amplitude.unit, ["m"])
    if deviation_unit is None or amplitude_unit is None or not amplitude.unit:
        raise column.wrong(i, "is a length, but the amplitudes have no unit; give both")
    return value * deviation_unit[0] / amplitude_unit[0]


def _jump_deviation(column: Column, i: int, frequency: float, factor: float) -> float:
    """Return the deviation of the frequency of a jump, in the unit of the frequency."""
    if column.unit not in ("", "%"):
        raise column.wrong(
            i, f"is the deviation of the frequency of a jump, which has no unit {column.unit}; give it in %"
        )
    value = _positive(column, i)
    return value / 100 * frequency if column.unit == "%" else value * factor
