"""Measured response curves: amplitudes over frequency of slow sweeps, and the frequencies at which they jump.

point i:  frequency_i, amplitude_i +- deviation_i, of a sweep with the frequency rising (+1) or falling (-1)
jump j:   frequency_j +- deviation_j, with the same directions
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hbgear.common.arguments import check_fields, checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.messages import did_you_mean, quoted
from hbgear.common.units import si
from hbgear.harmonic.observables import check_measure
from hbgear.harmonic.speeds import MESH, PINION
from hbgear.io.measured import rows_of

FREQUENCIES = ("Omega", MESH, PINION)
"""What frequencies are given in: dimensionless, of the mesh in Hz, or of the pinion in r/min."""

USUAL = 0.01
"""Deviation of an amplitude, relative, that is taken where none is given; of a frequency a tenth of it."""

_WORDS = {"up": 1, "rising": 1, "+1": 1, "1": 1, "+": 1, "down": -1, "falling": -1, "-1": -1, "-": -1}


@dataclass(frozen=True, eq=False)
class Measurements:
    """Measured amplitudes of slow sweeps and measured jump frequencies.

    Parameters
    ----------
    frequency : (N,) in ``unit``.
    amplitude : (N,) of an element, by ``measure``; in the model's unit of length, or in ``length`` if that is given.
    direction : (N,) or one number: +1 while the frequency rises, -1 while it falls.
    deviation : (N,) or one number, standard deviations of the amplitudes; by default 1 % of each.
    jumps : frequencies at which the sweeps jumped, as ``(frequency, direction)`` or with its standard deviation,
        by default .1 %.
    unit : one of "Omega", "mesh Hz", "pinion r/min".
    length : unit of the amplitudes, such as "um"; "" for that of the model.
    measure, element : as of `Branch.amplitude`.
    assumed : whether no deviations were given.

    Raises
    ------
    ValueError
        If lengths differ, a number is not finite, a frequency or amplitude not positive, a measure or unit
        unknown, or there is nothing.

    Examples
    --------
    >>> import hbgear as hb
    >>> data = hb.Measurements([0.8, 0.9, 1.0], [0.2, 0.5, 0.3], direction=1, jumps=[(0.92, 1)])
    >>> len(data), data.directions.tolist()
    (3, [1, 1, 1])
    """

    frequency: Any
    amplitude: Any
    direction: Any = 1
    deviation: Any = None
    jumps: Sequence[Any] = ()
    unit: str = "Omega"
    length: str = ""
    measure: str = "pp2"
    element: int | str = 0
    assumed: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        check_fields(self)
        if self.unit not in FREQUENCIES:
            raise ValueError(f"Measurements: unit = {quoted(self.unit)}{did_you_mean(str(self.unit), FREQUENCIES)}")
        check_measure("Measurements", self.measure)
        frequency, amplitude = self._numbers("frequency"), self._numbers("amplitude")
        if len(frequency) != len(amplitude):
            raise ValueError(
                f"Measurements: {len(frequency)} frequencies and {len(amplitude)} amplitudes; give as many"
            )
        deviation = USUAL * amplitude if self.deviation is None else self._numbers("deviation", len(frequency))
        direction = np.asarray(self.direction)
        fits = direction.dtype.kind in "iuf" and direction.shape in ((), (len(frequency),))
        if not fits or not np.isin(direction, (-1, 1)).all():
            raise ValueError(
                "Measurements: direction must be +1 (the frequency rises) or -1, one or one for each point"
            )
        set_(self, "assumed", self.deviation is None)
        set_(self, "frequency", frequency)
        set_(self, "amplitude", amplitude)
        set_(self, "deviation", deviation)
        set_(self, "direction", np.broadcast_to(direction.astype(int), len(frequency)))
        set_(self, "jumps", tuple(_jump(jump) for jump in self.jumps))
        if not len(frequency) and not self.jumps:
            raise ValueError("Measurements: there is neither an amplitude nor a jump; give at least one")
        if self.length:
            set_(self, "amplitude", amplitude * self.metres)
            set_(self, "deviation", deviation * self.metres)

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def directions(self) -> Array:
        """(N,) +1 or -1."""
        return np.asarray(self.direction)

    @property
    def metres(self) -> float:
        """The unit of length of the amplitudes as they were given."""
        return si("Measurements", "length", f"1 {self.length}", "m") if self.length else 1.0

    def _numbers(self, name: str, count: int | None = None) -> Array:
        try:
            values = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            values = values if count is None else np.broadcast_to(values, count)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"Measurements: {name} = {quoted(getattr(self, name))} must be numbers") from None
        if values.ndim != 1 or not np.all(np.isfinite(values)) or not np.all(values > 0):
            raise ValueError(f"Measurements: {name} must be positive, finite numbers in a list")
        return values


def _jump(given: Any) -> tuple[float, int, float]:
    """Frequency, direction and standard deviation of a measured jump."""
    try:
        frequency, direction, *rest = (float(x) for x in given)
        deviation = rest[0] if rest else 0.1 * USUAL * frequency
        good = len(rest) < 2 and direction in (-1, 1) and 0 < frequency < np.inf and 0 < deviation < np.inf
    except (TypeError, ValueError):
        good = False
    if not good:
        raise ValueError(
            f"Measurements: the jump {quoted(given)} must be (frequency, +1 or -1) or (frequency, +1 or -1, deviation)"
        )
    return frequency, int(direction), deviation


@checked_arguments(columns="names of columns, such as {'frequency': 'rpm', 'amplitude': 'x'}")
def read_measurements(
    path: str | os.PathLike[str], columns: Mapping[str, str] | None = None, **settings: Any
) -> Measurements:
    """Measurements from a .csv file with a line of column names.

    A row without an amplitude is the frequency of a jump. Directions are written as up or down, rising or falling, +1
    or -1; without such a column every sweep is one upwards. Lines that begin with # are left out.

    Parameters
    ----------
    path : of the file.
    columns : what its columns are called: ``{"frequency": ..., "amplitude": ..., "direction": ..., "deviation": ...}``;
        by default these names themselves.
    settings : unit, length, measure, element and, without a column, direction of `Measurements`.

    Raises
    ------
    ValueError
        If the file is no such table; the message names the line.
    KeyError
        If a column is not there.

    Examples
    --------
    >>> import hbgear as hb
    >>> data = hb.read_measurements("sweep.csv", {"frequency": "n"}, unit="pinion r/min")  # doctest: +SKIP
    """
    known = {name: name for name in _COLUMNS}
    for name in columns or {}:
        if name not in _COLUMNS:
            raise KeyError(f"there is no column for '{name}'{did_you_mean(name, _COLUMNS)}")
    known |= columns or {}
    rows = _rows(path)
    heads = [head.strip() for head in rows[0][1]]
    needed = ("frequency", *(name for name in columns or {}))
    for name in needed:
        if known[name] not in heads:
            raise KeyError(f"{path}: there is no column '{known[name]}' for {name}{did_you_mean(known[name], heads)}")
    at = {name: heads.index(head) for name, head in known.items() if head in heads}
    points: list[list[float]] = []
    jumps: list[list[float]] = []
    for line, cells in rows[1:]:
        cell = {name: cells[i].strip() if i < len(cells) else "" for name, i in at.items()}
        direction = _direction(path, line, cell.get("direction", str(settings.get("direction", 1))))
        frequency = _number(path, line, cell["frequency"])
        deviation = [_number(path, line, cell["deviation"])] if cell.get("deviation") else []
        if cell.get("amplitude"):
            points.append([frequency, _number(path, line, cell["amplitude"]), direction, *deviation])
        else:
            jumps.append([frequency, direction, *deviation])
    if len({len(point) for point in points}) > 1:
        raise ValueError(f"{path}: some amplitudes have a deviation and some have none; give one for each or for none")
    table = np.array(points).reshape(len(points), -1)
    given = {name: value for name, value in settings.items() if name != "direction"}
    if not points:
        return Measurements([], [], jumps=jumps, **given)
    return Measurements(table[:, 0], table[:, 1], table[:, 2].astype(int),
                        table[:, 3] if table.shape[1] > 3 else None, jumps, **given)  # fmt: skip


_COLUMNS = ("frequency", "amplitude", "direction", "deviation")


def _rows(path: str | os.PathLike[str]) -> list[tuple[int, list[str]]]:
    """Number and cells of each line that says something."""
    try:
        rows = rows_of(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no text (UTF-8)"
        raise ValueError(f"{quoted(str(path))} cannot be read as measurements: {reason.lower()}") from None
    if len(rows) < 2:
        raise ValueError(f"{path}: need a line of column names, such as 'frequency,amplitude', and rows of numbers")
    return rows


def _number(path: Any, line: int, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0 < value < np.inf:
        raise ValueError(f"{path}, line {line}: {quoted(text)} must be a positive number")
    return value


def _direction(path: Any, line: int, text: str) -> int:
    if text.lower() not in _WORDS:
        raise ValueError(f"{path}, line {line}: the direction {quoted(text)} must be up or down, +1 or -1")
    return _WORDS[text.lower()]
