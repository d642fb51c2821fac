"""Reader of numeric tables: name and unit of every column are parsed, and its numbers converted.

A reader lists the kinds of columns that it accepts. An unknown name or unit is refused with the accepted ones; nothing
is guessed from the numbers.

    frequency [kHz]; |H| [dB]; phase (deg)        ->  roles "frequency", "magnitude", "phase" with their units
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.text.decoding import bytes_of_file
from hbgear.common.text.messages import quoted
from hbgear.common.text.unit_spellings import plain_unit
from hbgear.io.tables.table_text import Row, TableText, decoded, number_of_cell, table_text, why_no_number
from hbgear.io.tables.table_units import ANGLE, FREQUENCY, factor_of


@dataclass(frozen=True)
class Kind:
    """A kind of column.

    Attributes
    ----------
    role : str
        Name by which a reader accesses the column.
    names : dict of str to (str or None)
        Accepted names with the unit that each implies: "" for a dimensionless number, None if the header must state
        one. Case, underscores and hyphens are ignored.
    unit : callable
        Returns whether a unit belongs to this kind.
    accepted : str
        Accepted units in words, for errors.
    """

    role: str
    names: Mapping[str, str | None]
    unit: Callable[[str], bool]
    accepted: str


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    heading : str
        Header as written, or the default of a table without a header.
    unit : str
        Unit as `plain_unit` writes it, else implied by the name.
    cells : tuple of str
        Text of each row.
    lines : tuple of int
        Line numbers of the rows.
    file : str
        Name of the file, for errors.
    stated : bool
        Whether the header states the unit.
    """

    heading: str
    unit: str
    cells: tuple[str, ...]
    lines: tuple[int, ...]
    file: str
    stated: bool = True

    def number(self, i: int) -> float:
        """Return the finite number in a cell; ValueError, with the line, for other text."""
        value = number_of_cell(self.cells[i])
        if value is None or not np.isfinite(value):
            reason = why_no_number(self.cells[i]) if value is None else "must be a finite number"
            raise self.wrong(i, reason)
        return value

    def wrong(self, i: int, reason: str) -> ValueError:
        """Return the error of a cell, with its line."""
        return ValueError(
            f"'{self.file}', line {self.lines[i]}: {quoted(self.cells[i])} in the column "
            f"{quoted(self.heading)} {reason}"
        )

    def numbers(self) -> Array:
        """Return all cells as finite numbers, in the unit of the column."""
        return np.array([self.number(i) for i in range(len(self.cells))])


@dataclass(frozen=True)
class DataTable:
    """A table with columns by position.

    Attributes
    ----------
    file : str
        Name of the file, for errors.
    headings : tuple of str
        Headers with units, as written; for a table without a header, the defaults of its reader.
    rows : tuple of Row
        Rows of cells.
    """

    file: str
    headings: tuple[str, ...]
    rows: tuple[Row, ...]

    def column(self, i: int, kind: Kind) -> Column:
        """Return a column of a given kind; ValueError if its unit does not belong to that kind, or is missing."""
        return self._column_in_unit(i, kind, (named(self.headings[i], kind) or (None,))[0])

    def columns(
        self,
        kinds: Sequence[Kind],
        called: Mapping[str, str] | None = None,
        assumed: Mapping[str, str] | None = None,
        advice: str = "",
    ) -> dict[str, Column]:
        """Return the columns of accepted kinds by role.

        ``called`` has headers of roles with other names; columns without such a header are then omitted. ``assumed``
        has units of roles whose header and name give no unit, ``advice`` ends the error of a column without a kind.
        KeyError is raised if a header of ``called`` does not exist, ValueError if a column has no kind, two have the
        same kind, or a unit is not accepted.
        """
        columns: dict[str, Column] = {}
        by_role = {kind.role: kind for kind in kinds}
        positions = {role: self._position(role, head) for role, head in (called or {}).items()}
        for i, heading in enumerate(self.headings):
            role = next((role for role, position in positions.items() if position == i), None)
            kind = (
                by_role[role] if role is not None else next((k for k in kinds if named(heading, k) is not None), None)
            )
            if kind is None and called:
                continue
            if kind is None:
                raise ValueError(f"'{self.file}': the column {quoted(heading)} is unknown; {_accepted(kinds)}{advice}")
            if role is None and kind.role in positions:
                continue
            if kind.role in columns:
                first = quoted(columns[kind.role].heading)
                raise ValueError(
                    f"'{self.file}': the columns {first} and {quoted(heading)} are both the {kind.role}; need one"
                )
            implied = named(heading, kind) or (None if role is None else "",)
            columns[kind.role] = self._column_in_unit(i, kind, implied[0] or (assumed or {}).get(kind.role, implied[0]))
        return columns

    def _position(self, role: str, head: str) -> int:
        for matches in (lambda text: text.strip() == head.strip(), lambda text: split(text)[0].strip() == head.strip()):
            positions = [i for i, heading in enumerate(self.headings) if matches(heading)]
            if len(positions) == 1:
                return positions[0]
        raise KeyError(
            f"'{self.file}': there is no column {quoted(head)} for {role}; it has "
            f"{', '.join(quoted(heading) for heading in self.headings)}"
        )

    def _column_in_unit(self, i: int, kind: Kind, implied: str | None) -> Column:
        """Return a column with its unit, which its heading states or the kind implies."""
        heading = self.headings[i]
        name, stated = split(heading)
        if normal(heading) in map(normal, kind.names):  # "Re(H)" is not Re in henry
            stated = None
        unit = implied if stated is None else plain_unit(stated)
        text = f"'{self.file}': the column {quoted(heading)}"
        if unit is None:
            example = f"{name} [{kind.accepted.split(',')[0]}]"
            raise ValueError(f"{text} has no unit; write it as in {quoted(example)}; accepted are {kind.accepted}")
        if not kind.unit(unit):
            raise ValueError(f"{text} has an unknown unit for the {kind.role}; accepted are {kind.accepted}")
        cells = tuple(row.cells[i] for row in self.rows)
        return Column(heading, unit, cells, tuple(row.line for row in self.rows), self.file, stated is not None)


def read_data_table(path: object, expected: str, kinds: Sequence[Kind], default: Sequence[str] = ()) -> DataTable:
    """Read the table in a file; ``expected`` is its content in messages, such as "measurements".

    ``default`` are the headers of a table without a header, which has the first ones; by default a header is required.
    ValueError is raised if the file cannot be read, is not a regular file, is too large, or is not such a table.
    """
    return data_table(bytes_of_file(path, expected), str(path), kinds, default)  # type: ignore[arg-type]


def data_table(content: bytes, name: str, kinds: Sequence[Kind], default: Sequence[str] = ()) -> DataTable:
    r"""Return the table in the bytes of a file; see `read_data_table`.

    Examples
    --------
    >>> length = Kind("length", {"x": None}, lambda unit: unit in ("m", "mm"), "m, mm")
    >>> table = data_table(b"x [mm]\n1\n2", "a.csv", [length])
    >>> table.columns([length])["length"].unit, table.columns([length])["length"].numbers().tolist()
    ('mm', [1.0, 2.0])
    """
    text = table_text(decoded(content, name), name)
    headings = text.headings if text.headings is not None else _in_remark(text, kinds)
    if headings is None:
        _check_note(text.note, name, kinds)
        count = len(text.rows[0].cells)
        if not 1 < count <= len(default):
            need = f"a line of column names, such as {quoted(', '.join(kind.role for kind in kinds[:3]))}"
            raise ValueError(f"'{name}' has rows of {count} cells and no {need}; {_accepted(kinds)}")
        headings = tuple(default[:count])
    return DataTable(name, headings, text.rows)


def split(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a header, None without a unit.

    A unit is written as in ``speed [r/min]``, ``speed (r/min)``, ``speed / (r/min)`` or ``speed in r/min``.

    Examples
    --------
    >>> split("speed [r/min]"), split("f / Hz"), split("speed in r/min"), split("x in bearing")
    (('speed', 'r/min'), ('f', 'Hz'), ('speed', 'r/min'), ('x in bearing', None))
    """
    match = re.fullmatch(r"\s*(.*?)\s*(?:\[([^\[\]]*)\]|\(((?:[^()]|\([^()]*\))*)\)|\s/\s(.*?))\s*", heading)
    if match is None:
        in_unit = re.fullmatch(r"\s*(.+?)\s+in\s+(\S+)\s*", heading)
        return (in_unit[1], in_unit[2]) if in_unit and _is_unit(in_unit[2]) else (heading.strip(), None)
    unit = next(part for part in match.groups()[1:] if part is not None).strip()
    return match[1].removesuffix("/").strip(), unit.removeprefix("in ").strip()


def _is_unit(text: str) -> bool:
    unit = plain_unit(text)
    return unit in FREQUENCY or unit in ANGLE or factor_of(unit, _TARGETS) is not None


_TARGETS = ("m", "m/N", "m/s/N", "m/s^2/N", "N/m")
"""Quantities whose units may follow the word "in", besides frequencies and angles."""


def normal(name: str) -> str:
    """Return a name in lower case without underscores, hyphens and double spaces; Omega remains distinct from omega."""
    text = unicodedata.normalize("NFKC", name).replace("Ω", "Omega")
    text = " ".join(re.sub(r"[_\-]+", " ", text).split())
    return text if text == "Omega" else text.casefold()


def named(heading: str, kind: Kind) -> tuple[str | None] | None:
    """Return the unit that the name of a header implies, in a tuple; None if it is not a name of this kind."""
    for text in (heading, split(heading)[0]):
        for name, unit in kind.names.items():
            if normal(text) == normal(name):
                return (unit,)
    return None


def _in_remark(text: TableText, kinds: Sequence[Kind]) -> tuple[str, ...] | None:
    """Return the last comment before rows without a header, if it names one of the columns."""
    if text.remark is None or not any(named(cell, kind) is not None for cell in text.remark for kind in kinds):
        return None
    return text.remark


def _check_note(note: str, name: str, kinds: Sequence[Kind]) -> None:
    """Refuse a table without a header whose last comment states units: the columns may be in these units."""
    for match in re.finditer(r"\[([^\[\]]*)\]|\(([^()]*)\)", note):
        unit = plain_unit(match[1] if match[1] is not None else match[2])
        if unit and any(kind.unit(unit) for kind in kinds):
            raise ValueError(
                f"'{name}' has no line of column names, and its last remark {quoted(note)} has the unit {quoted(unit)}"
                "; name every column in a line without a comment sign"
            )


def _accepted(kinds: Sequence[Kind]) -> str:
    return "accepted are " + "; ".join(f"{kind.role} ({', '.join(kind.names)})" for kind in kinds)
