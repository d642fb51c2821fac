"""Text of a table as headers and rows of cells, in the formats of common programs.

encoding    UTF-8 with or without byte order mark, UTF-16, Windows-1252 (which includes µ and ° of Latin-1)
separator   semicolon, tab, comma, or spaces; the decimal mark is a point or, unless commas separate cells, a comma
comments    lines that begin with #, %, ! or //; the last one before the numbers may name the columns
spreadsheet a first line "sep=;" and empty columns at the end are ignored
headers     one line, and a second one with units if the first has none
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from hbgear.common.text.messages import quoted

MAX_CELL_CHARACTERS = 200
"""Largest number of characters of a cell; longer ones are refused."""

MAX_COLUMNS = 1000
"""Largest number of columns; tables with more are refused."""

_COMMENT = re.compile(r"\s*(#(?!N/A|NV\b|DIV/0|REF!|VALUE!|NAME\?|NUM!|NULL!)|%|!|//)")  # not errors of spreadsheets
_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eEdD][-+]?\d+)?|[-+]?(nan|inf|infinity)", re.ASCII | re.IGNORECASE)
_GROUPED = re.compile(r"[-+]?\d{1,3}([ ,.'’\u00a0\u202f]\d{3})+([.,]\d*)?", re.ASCII)
_SEPARATOR_LINE = re.compile(r'\s*"?sep=.?"?\s*', re.IGNORECASE)
_NO_TEXT = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_MARKS = (
    (b"\xef\xbb\xbf", "utf-8"),
    (b"\xff\xfe\0\0", "utf-32-le"),
    (b"\0\0\xfe\xff", "utf-32-be"),
    (b"\xff\xfe", "utf-16-le"),
    (b"\xfe\xff", "utf-16-be"),
)


@dataclass(frozen=True)
class Row:
    """Cells of a line of a table, and its line number."""

    line: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class TableText:
    """Headers and rows of a table.

    Attributes
    ----------
    headings : tuple of str or None
        Names of the columns as written, with their units; None without a header.
    rows : tuple of Row
        Rows with as many cells as there are headers, or as the first row has.
    remark : tuple of str or None
        Without a header, the cells of the last comment before the rows, if there are as many as columns.
    note : str
        That comment as a whole.
    """

    headings: tuple[str, ...] | None
    rows: tuple[Row, ...]
    remark: tuple[str, ...] | None = None
    note: str = ""


def decoded(content: bytes, name: str) -> str:
    """Return the text of the bytes of a table; ValueError if they are not text.

    Examples
    --------
    >>> decoded("x [µm]".encode("utf-16"), "a.csv"), decoded("x [µm]".encode("latin-1"), "a.csv")
    ('x [µm]', 'x [µm]')
    """
    mark, encoding = next(((m, e) for m, e in _MARKS if content.startswith(m)), (b"", ""))
    start = content[:4096]
    if not encoding and b"\0" in start:
        encoding = "utf-16-le" if start[1::2].count(0) > start[::2].count(0) else "utf-16-be"
    for option in [encoding] if encoding else ["utf-8", "cp1252"]:
        try:
            text = content[len(mark) :].decode(option)
        except UnicodeDecodeError:
            continue
        if not _NO_TEXT.search(text):
            return text
    raise ValueError(f"'{name}' cannot be read as a table: it is not text (UTF-8, UTF-16 or Latin-1)")


def table_text(text: str, name: str) -> TableText:
    r"""Return the headers and cells of the text of a table; ``name`` is that of its file, for errors.

    ValueError is raised if there are no rows, their numbers of cells differ, or a cell is too long; the message states
    the line.

    Examples
    --------
    >>> found = table_text("# of May\nf [Hz];x [mm]\n1,5;0,1\n2;0,3\n", "a.csv")
    >>> found.headings, found.rows[0].cells
    (('f [Hz]', 'x [mm]'), ('1,5', '0,1'))
    """
    lines, remark = _lines(text)
    header_count = 0
    while header_count < len(lines) and not _has_numbers(lines[header_count][1]):
        header_count += 1
    if header_count == len(lines):
        raise ValueError(f"'{name}' has no rows of numbers; need a line of column names and rows of numbers")
    body = lines[header_count:]
    mark = _separator([line for _, line in body])
    rows = [Row(i, _cells(line, mark, i, name)) for i, line in body]
    heads = [line for _, line in lines[max(header_count - 2, 0) : header_count]]
    width = len(rows[0].cells)
    named = [_headings(line, mark, width) for line in heads]
    if header_count > 2 or (header_count == 2 and not _has_line_of_units(named)):
        i, line = lines[header_count - 2 if header_count > 2 else 0]
        raise ValueError(
            f"'{name}', line {i}: {quoted(line.strip()[:80])} is not a row of numbers; mark comments with "
            "#, and give one line of column names"
        )
    headings = _joined(named) if header_count == 2 else named[0] if header_count else None
    if header_count == 1 and headings is None:
        raise ValueError(f"'{name}': {_mismatch(heads[0], mark, width, body[0])}")
    note = "" if headings is not None or remark is None else remark
    return TableText(headings, tuple(_equal_width_rows(rows, headings, mark, name)), _headings(note, mark, width), note)


def number_of_cell(text: str) -> float | None:
    """Return the number in a cell, with a decimal point or comma; None if it is not a number.

    Examples
    --------
    >>> number_of_cell("1,5"), number_of_cell("2.5D-3"), number_of_cell("1.234,5"), number_of_cell("x")
    (1.5, 0.0025, None, None)
    """
    text = text.strip().replace("\u2212", "-")
    if not _NUMBER.fullmatch(text):
        return None
    if text[-1:].isalpha():
        return float(text)
    return float(text.replace(",", ".").lower().replace("d", "e"))


def why_no_number(text: str) -> str:
    """Return the reason why a cell is not a number, for errors."""
    if _GROUPED.fullmatch(text.strip()):
        return "has thousands separators; remove them"
    return "must be a number"


def _lines(text: str) -> tuple[list[tuple[int, str]], str | None]:
    """Return numbers and texts of the lines that are not comments, and the last comment before them."""
    lines: list[tuple[int, str]] = []
    remark = None
    for i, line in enumerate(re.split(r"\r\n|\n|\r", text.removeprefix("\ufeff")), 1):
        if (match := _COMMENT.match(line)) is not None:
            remark = line[match.end() :].strip("#%!/ \t") if not lines else remark
        elif line.strip(" \t\f\v;,\u00a0") and not (i == 1 and _SEPARATOR_LINE.fullmatch(line)):
            lines.append((i, line))
    return _without_empty_columns(lines), remark


def _without_empty_columns(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines without the separators that end all of them: columns without a name and without numbers."""
    for mark in ";\t,":
        while lines and all(line.rstrip(" ").endswith(mark) for _, line in lines):
            lines = [(i, line.rstrip(" ")[:-1]) for i, line in lines]
    return lines


def _has_numbers(line: str) -> bool:
    """Return whether at least half of the cells of a line are numbers, for one of the separators."""
    strong = next((mark for mark in ";\t" if mark in line), None)
    for mark in [strong] if strong is not None else [",", None]:
        cells = [cell for part in line.split(mark) if (cell := part.strip(' "'))]
        if 2 * sum(number_of_cell(cell) is not None for cell in cells) >= len(cells) > 0:
            return True
    return False


def _separator(lines: Sequence[str]) -> str | None:
    """Return the separator of rows of numbers; None for spaces."""
    if any(";" in line for line in lines):
        return ";"
    if all("\t" in line and ",\t" not in line for line in lines):
        return "\t"
    if not any("," in line for line in lines):
        return None
    cells = [line.split() for line in lines]  # with spaces as separators, commas in numbers are decimal marks
    spaced = all(
        len(row) > 1
        and all("," not in cell or number_of_cell(cell) is not None for cell in row)
        and not any(cell.startswith(",") or cell.endswith(",") for cell in row)
        for row in cells
    )
    return None if spaced else ","


def _cells(line: str, mark: str | None, i: int, name: str) -> tuple[str, ...]:
    """Return the cells of a row."""
    cells = line.split(mark)
    if len(cells) > MAX_COLUMNS:
        raise ValueError(f"'{name}', line {i} has {len(cells)} cells; a table has at most {MAX_COLUMNS} columns")
    long = next((cell for cell in cells if len(cell) > MAX_CELL_CHARACTERS), None)
    if long is not None:
        raise ValueError(
            f"'{name}', line {i}: a cell has {len(long)} characters, {quoted(long[:20])} ...; "
            f"need at most {MAX_CELL_CHARACTERS}"
        )
    if mark is None:
        return tuple(cells)
    try:
        return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=mark, strict=True)))
    except csv.Error:
        raise ValueError(f"'{name}', line {i}: quotation marks are not closed") from None


def _headings(line: str, mark: str | None, width: int) -> tuple[str, ...] | None:
    """Return the names of columns in a line; None if no separator gives as many as there are columns."""
    for split in _splits(line, mark):
        while len(split) > width and not split[-1]:
            split.pop()
        if len(split) == width and max(map(len, split), default=0) <= MAX_CELL_CHARACTERS:
            return tuple(split)
    return None


def _splits(line: str, mark: str | None) -> Iterator[list[str]]:
    """Yield the cells of a line for each separator that is possible."""
    for separator in dict.fromkeys((mark, ";", "\t", ",", None)):
        if separator is not None:
            try:
                yield [cell.strip() for cell in next(csv.reader([line], delimiter=separator, strict=True))]
            except csv.Error:
                continue
            continue
        yield re.split(r"\s{2,}|\t", line.strip())
        closed = re.sub(r"\s+(?=[\[(])", "", line.strip())  # a unit belongs to the name before it
        yield re.findall(r"(?:\[[^\]]*\]|\([^)]*\)|[^\s\[(])+", closed)


def _has_line_of_units(named: Sequence[tuple[str, ...] | None]) -> bool:
    """Return whether the second of two lines before the numbers has the units of the columns in the first."""
    first, second = named
    if first is None or second is None or any("[" in name for name in first):
        return False
    return all(re.fullmatch(r"\[[^\[\]]*\]|\([^\[\]]*\)|[^\[\]]*", cell) for cell in second)


def _joined(named: Sequence[tuple[str, ...] | None]) -> tuple[str, ...]:
    names, units = (cells or () for cells in named)
    bare = (re.fullmatch(r"\s*[\[(]?(.*?)[\])]?\s*", unit) for unit in units)
    return tuple(
        f"{name} [{unit[1]}]" if unit is not None and unit[1] else name for name, unit in zip(names, bare, strict=True)
    )


def _mismatch(head: str, mark: str | None, width: int, row: tuple[int, str]) -> str:
    count = len(next(_splits(head, mark)))
    decimal = " (with decimal commas, separate columns by semicolons or tabs)" if mark == "," else ""
    return f"line {row[0]} has {width} cells and the line of column names {count}; need as many{decimal}"


def _equal_width_rows(rows: Sequence[Row], headings: tuple[str, ...] | None, mark: str | None, name: str) -> list[Row]:
    """Return rows with equal numbers of cells; refuse cut rows and two different decimal marks."""
    width = len(rows[0].cells) if headings is None else len(headings)
    aligned = []
    marks: Counter[str] = Counter()
    for row in rows:
        cells = row.cells
        while len(cells) > width and not cells[-1]:
            cells = cells[:-1]
        if len(cells) != width:
            hint = " (with decimal commas, separate columns by semicolons or tabs)" if mark == "," else ""
            raise ValueError(
                f"'{name}', line {row.line} has {len(cells)} cells, and the table has {width} columns; "
                f"need one for each{hint}"
            )
        for cell in cells:
            if number_of_cell(cell) is not None:
                marks.update(decimal_mark for decimal_mark in ".," if decimal_mark in cell)
                if len(marks) > 1:
                    raise ValueError(
                        f"'{name}', line {row.line}: {quoted(cell)} has another decimal mark than earlier numbers; "
                        "use points or commas throughout, and no thousands separators"
                    )
        aligned.append(Row(row.line, cells))
    return aligned
