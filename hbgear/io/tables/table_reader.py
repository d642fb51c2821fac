"""Tables of numbers from files: the name and the unit of every column are read, and its numbers converted.

A reader lists the kinds of columns that it takes. What is not on the list, a name or a unit, is refused with what is;
nothing is guessed from numbers.

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
from hbgear.io.tables.table_text import Row, TableText, decoded, number_of_cell, table_text, why_no_number
from hbgear.io.tables.table_units import plain_unit


@dataclass(frozen=True)
class Kind:
    """A kind of column.

    Parameters
    ----------
    role : name by which a reader asks for the column.
    names : accepted names with the unit that each implies: "" for a number without one, None if a heading must state
        one. They are compared without regard to capitals, underscores and hyphens.
    unit : whether a unit is one of this kind.
    accepted : the units in words, for errors.
    """

    role: str
    names: Mapping[str, str | None]
    unit: Callable[[str], bool]
    accepted: str


@dataclass(frozen=True)
class Column:
    """A column of a table.

    heading : as it is written, or the default of a table without headings.
    unit : as `plain_unit` writes it; of its name if the heading states none.
    cells : texts, one of each row.
    lines : numbers of the lines they are in.
    file : its name, for errors.
    """

    heading: str
    unit: str
    cells: tuple[str, ...]
    lines: tuple[int, ...]
    file: str
    stated: bool = True

    def number(self, i: int) -> float:
        """The finite number in a cell.

        Raises
        ------
        ValueError
            If it is none; the message names the line.
        """
        value = number_of_cell(self.cells[i])
        if value is None or not np.isfinite(value):
            why = why_no_number(self.cells[i]) if value is None else "must be a number that is finite"
            raise self.wrong(i, why)
        return value

    def wrong(self, i: int, why: str) -> ValueError:
        """The error of a cell, with its line."""
        return ValueError(f"'{self.file}', line {self.lines[i]}: {quoted(self.cells[i])} in the column "
                          f"{quoted(self.heading)} {why}")  # fmt: skip

    def numbers(self) -> Array:
        """All cells as finite numbers, in the unit of the column."""
        return np.array([self.number(i) for i in range(len(self.cells))])


@dataclass(frozen=True)
class DataTable:
    """A table whose columns are known by place.

    file : name of the file, for errors.
    headings : names with units, as they are written; of a table without a line of names the defaults of its reader.
    """

    file: str
    headings: tuple[str, ...]
    rows: tuple[Row, ...]

    def column(self, i: int, kind: Kind) -> Column:
        """A column that is to be of a kind.

        Raises
        ------
        ValueError
            If its unit is none of that kind, or is missing.
        """
        return self._of_unit(i, kind, (named(self.headings[i], kind) or (None,))[0])

    def columns(
        self, kinds: Sequence[Kind], called: Mapping[str, str] | None = None, assumed: Mapping[str, str] | None = None
    ) -> dict[str, Column]:
        """Columns by role.

        Parameters
        ----------
        kinds : that the reader takes.
        called : headings of roles that are called otherwise; columns that have no such heading are left out then.
        assumed : units of roles that hold where a heading states none, and its name does not imply one.

        Raises
        ------
        KeyError
            If there is no column that is called so.
        ValueError
            If a column is of no kind, two are of one, or a unit is not accepted.
        """
        found: dict[str, Column] = {}
        by_role = {kind.role: kind for kind in kinds}
        places = {role: self._place(role, head) for role, head in (called or {}).items()}
        for i, heading in enumerate(self.headings):
            role = next((role for role, place in places.items() if place == i), None)
            kind = (
                by_role[role] if role is not None else next((k for k in kinds if named(heading, k) is not None), None)
            )
            if kind is None and called:
                continue
            if kind is None:
                raise ValueError(f"'{self.file}': the column {quoted(heading)} is not known; {_accepted(kinds)}")
            if role is None and kind.role in places:
                continue
            if kind.role in found:
                first = quoted(found[kind.role].heading)
                raise ValueError(f"'{self.file}': the columns {first} and {quoted(heading)} are both the {kind.role}; "
                                 "need one")  # fmt: skip
            implied = named(heading, kind) or (None if role is None else "",)
            found[kind.role] = self._of_unit(i, kind, implied[0] or (assumed or {}).get(kind.role, implied[0]))
        return found

    def _place(self, role: str, head: str) -> int:
        for same in (lambda text: text.strip() == head.strip(), lambda text: split(text)[0].strip() == head.strip()):
            places = [i for i, heading in enumerate(self.headings) if same(heading)]
            if len(places) == 1:
                return places[0]
        raise KeyError(f"'{self.file}': there is no column {quoted(head)} for {role}; it has "
                       f"{', '.join(quoted(heading) for heading in self.headings)}")  # fmt: skip

    def _of_unit(self, i: int, kind: Kind, implied: str | None) -> Column:
        heading = self.headings[i]
        name, stated = split(heading)
        if normal(heading) in map(normal, kind.names):  # "Re(H)" is no Re in henry
            stated = None
        unit = implied if stated is None else plain_unit(stated)
        which = f"'{self.file}': the column {quoted(heading)}"
        if unit is None:
            example = f"{name} [{kind.accepted.split(',')[0]}]"
            raise ValueError(f"{which} has no unit; write it as in {quoted(example)}; accepted are {kind.accepted}")
        if not kind.unit(unit):
            raise ValueError(f"{which} has a unit that is not known for the {kind.role}; accepted are {kind.accepted}")
        cells = tuple(row.cells[i] for row in self.rows)
        return Column(heading, unit, cells, tuple(row.line for row in self.rows), self.file, stated is not None)


def read_data_table(path: object, what: str, kinds: Sequence[Kind], default: Sequence[str] = ()) -> DataTable:
    """The table in a file.

    Parameters
    ----------
    path : of the file.
    what : it is to be, for errors: "measurements".
    kinds : of columns that are taken.
    default : headings of a table without a line of names, of which it has the first ones; () if it must have one.

    Raises
    ------
    ValueError
        If the file cannot be read, is no regular file or too large, or is no such table.
    """
    return data_table(bytes_of_file(path, what), str(path), kinds, default)  # type: ignore[arg-type]


def data_table(content: bytes, name: str, kinds: Sequence[Kind], default: Sequence[str] = ()) -> DataTable:
    r"""The table in the bytes of a file; see `read_data_table`.

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
    """Name and unit of a heading: ``speed [r/min]``, ``speed (r/min)`` or ``speed / (r/min)``; None without one.

    Examples
    --------
    >>> split("speed [r/min]"), split("f / Hz"), split("x")
    (('speed', 'r/min'), ('f', 'Hz'), ('x', None))
    """
    found = re.fullmatch(r"\s*(.*?)\s*(?:\[([^\[\]]*)\]|\(((?:[^()]|\([^()]*\))*)\)|\s/\s(.*?))\s*", heading)
    if found is None:
        return heading.strip(), None
    unit = next(part for part in found.groups()[1:] if part is not None).strip()
    return found[1].removesuffix("/").strip(), unit.removeprefix("in ").strip()


def normal(name: str) -> str:
    """A name without capitals, underscores, hyphens and double spaces; Omega stays apart from omega."""
    text = unicodedata.normalize("NFKC", name).replace("Ω", "Omega")
    text = " ".join(re.sub(r"[_\-]+", " ", text).split())
    return text if text == "Omega" else text.casefold()


def named(heading: str, kind: Kind) -> tuple[str | None] | None:
    """The unit that the name of a heading implies, in a tuple; None if it is no name of this kind."""
    for text in (heading, split(heading)[0]):
        for name, unit in kind.names.items():
            if normal(text) == normal(name):
                return (unit,)
    return None


def _in_remark(text: TableText, kinds: Sequence[Kind]) -> tuple[str, ...] | None:
    """The last remark before rows without a line of names, if it names one of the columns."""
    if text.remark is None or not any(named(cell, kind) is not None for cell in text.remark for kind in kinds):
        return None
    return text.remark


def _check_note(note: str, name: str, kinds: Sequence[Kind]) -> None:
    """Refuse a table without a line of names whose last remark has units: the columns are in other ones, perhaps."""
    for found in re.finditer(r"\[([^\[\]]*)\]|\(([^()]*)\)", note):
        unit = plain_unit(found[1] if found[1] is not None else found[2])
        if unit and any(kind.unit(unit) for kind in kinds):
            raise ValueError(
                f"'{name}' has no line of column names, and its last remark {quoted(note)} has the unit {quoted(unit)}"
                "; name every column in a line without a remark sign"
            )


def _accepted(kinds: Sequence[Kind]) -> str:
    return "accepted are " + "; ".join(f"{kind.role} ({', '.join(kind.names)})" for kind in kinds)
