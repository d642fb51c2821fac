"""Tables of frequency responses: every column by name and unit.

H = re + i im,   |H| e^(i phase)   or   10^(L/20) e^(i phase)   with the level L [dB] re 1 of the unit
"""

from __future__ import annotations

import os
import re
from math import pi

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.text.unit_spellings import plain_unit
from hbgear.io.tables.table_reader import Column, Kind, read_data_table
from hbgear.io.tables.table_units import ANGLE, FREQUENCY, factor_of

QUANTITIES = {
    "receptance": ("m/N", "rad/(N m)", "1/N"),
    "mobility": ("m/s/N", "rad/s/(N m)", "1/s/N"),
    "accelerance": ("m/s^2/N", "rad/s^2/(N m)", "1/s^2/N"),
}
"""Units of each quantity: displacement per force, angle per moment, and displacement per moment or angle per force."""

MAX_PHASE_IN_RADIANS = 2 * pi
"""Phases [rad] up to this value may be radians or degrees, so that a unit is required."""

_RESPONSE_UNITS = "m/N, mm/N, um/N, m/s/N, m/s^2/N, rad/(N m)"


def _is_size(unit: str) -> bool:
    return unit == "" or _fitting(unit) is not None


def _is_magnitude(unit: str) -> bool:
    return _is_size(unit) or _level(unit) is not None


KINDS = (
    Kind(
        "frequency",
        dict.fromkeys(("frequency", "freq", "f", "hz"), "Hz")
        | {"khz": "kHz"}
        | dict.fromkeys(("omega", "Omega", "w", "ω", "angular frequency", "circular frequency"), "rad/s")
        | {"rpm": "r/min"}
        | dict.fromkeys(("n", "speed", "rotational speed", "shaft speed")),
        FREQUENCY.__contains__,
        ", ".join(FREQUENCY),
    ),
    Kind(
        "real part",
        dict.fromkeys(("real", "re", "real part", "re(H)", "real(H)", "re H", "H real"), ""),
        _is_size,
        _RESPONSE_UNITS,
    ),
    Kind(
        "imaginary part",
        dict.fromkeys(
            ("imag", "im", "imaginary", "imag part", "imaginary part", "im(H)", "imag(H)", "im H", "H imag"), ""
        ),
        _is_size,
        _RESPONSE_UNITS,
    ),
    Kind(
        "magnitude",
        dict.fromkeys(("magnitude", "mag", "amplitude", "abs", "modulus", "|H|", "abs(H)", "mag(H)"), "")
        | {"db": "dB"},
        _is_magnitude,
        f"{_RESPONSE_UNITS}, dB, dB re 1 m/N",
    ),
    Kind(
        "phase",
        dict.fromkeys(("phase", "angle", "phase angle", "arg", "arg(H)", "phase(H)", "angle(H)", "∠H"), ""),
        lambda unit: unit == "" or (unit in ANGLE and unit != "cycle"),
        "deg, rad, mrad",
    ),
    Kind("coherence", dict.fromkeys(("coherence", "coh", "γ²", "gamma2"), ""), lambda unit: unit in ("", "%"), "-, %"),
)
"""Columns of a table of a frequency response; the coherence is not used."""

_DEFAULT = ("frequency [Hz]", "real", "imag")
_PAIRS = (("real part", "imaginary part"), ("magnitude", "phase"))


def read_response(path: str | os.PathLike[str], quantity: str | None) -> tuple[Array, ComplexArray, str]:
    """Read a frequency response: frequencies [Hz] (P,), complex values in SI (P,), and the quantity.

    Without a given quantity it is taken from the unit, else it is "receptance". ValueError is raised if the file is not
    such a table, or a name or unit of a column is unknown.
    """
    table = read_data_table(path, "a frequency response", KINDS, _DEFAULT)
    columns = table.columns(KINDS)
    pairs = [pair for pair in _PAIRS if any(role in columns for role in pair)]
    if "frequency" not in columns or len(pairs) != 1 or not all(role in columns for role in pairs[0]):
        raise ValueError(
            f"'{path}' has the columns {', '.join(map(repr, table.headings))}; need a frequency with real "
            "and imaginary part, or with magnitude and phase"
        )
    if "coherence" in columns:
        columns["coherence"].numbers()  # not used, but refuses cells that are not numbers
    f = columns["frequency"].numbers() * FREQUENCY[columns["frequency"].unit]
    first, second = (columns[role] for role in pairs[0])
    if pairs[0][0] == "magnitude":
        size, quantity = _sizes(first, quantity)
        return f, size * np.exp(1j * _angles(second)), quantity
    real, quantity = _sizes(first, quantity)
    imaginary, quantity = _sizes(second, quantity)
    return f, real + 1j * imaginary, quantity


def _sizes(column: Column, quantity: str | None) -> tuple[Array, str]:
    """Return the numbers of a column in SI, and their quantity per force."""
    values, level = column.numbers(), _level(column.unit)
    unit = column.unit if level is None else level
    if level is not None:
        values = 10 ** (values / 20)
        if not np.isfinite(values).all():
            raise ValueError(f"'{column.file}': the column {column.heading!r} has levels that are not dB")
    if not unit:
        return values, quantity or "receptance"
    factor, unit_quantity = _fitting(unit) or (1.0, "receptance")
    if quantity not in (None, unit_quantity):
        raise ValueError(
            f"'{column.file}': the unit of the column {column.heading!r} is that of {unit_quantity}, not "
            f"{quantity}; give quantity='{unit_quantity}', or correct the unit"
        )
    return values * factor, unit_quantity


def _fitting(unit: str) -> tuple[float, str] | None:
    """Return the factor of a unit to SI, and its quantity."""
    for quantity, units in QUANTITIES.items():
        if (factor := factor_of(unit, units)) is not None:
            return factor[0], quantity
    return None


def _level(unit: str) -> str | None:
    """Return the reference unit of levels in dB, "" for the unit of the model; None if the unit is not a level."""
    match = re.fullmatch(r"dB(?:\s*(?:re\.?|ref\.?)?\s*(?:1\s*)?(.*))?", unit, re.IGNORECASE)
    if match is None:
        return None
    reference = plain_unit((match[1] or "").strip().removeprefix("(").removesuffix(")"))
    return reference if not reference or _fitting(reference) is not None else None


def _angles(column: Column) -> Array:
    """Return phases in radians; without a unit they are degrees, unless they may be radians."""
    values = column.numbers()
    if not column.unit and np.abs(values).max() <= MAX_PHASE_IN_RADIANS and values.any():
        raise ValueError(
            f"'{column.file}': the column {column.heading!r} has no unit, and its numbers may be degrees "
            "or radians; write 'phase [deg]' or 'phase [rad]'"
        )
    factor = ANGLE[column.unit or "deg"]
    return values * factor
