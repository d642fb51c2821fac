"""Limit of the unpacked size of matrix files.

    bytes unpacked <= 256 MB + 32 times the size of the file

This admits two dense matrices of 4000 coordinates; larger ones, mostly zeros, are written as sparse.
"""

from __future__ import annotations

import os
from pathlib import Path

import scipy

from hbgear.common.process.checksums import DamagedFileError

SPARE, TIMES = 2**28, 32
"""Bytes that a file may unpack to: the first number, plus the second times the size of the file."""

_MIN_ENTRY_CHARACTERS = {"coordinate": 4, "array": 2}
"""Fewest characters of an entry in the text of a .mtx file: "1 1\\n", "1\\n"."""

MAX_MATRIX_ROWS = 1_000_000
"""Largest number of rows of a matrix; larger systems cannot be solved here."""


def check_mtx(path: str | os.PathLike[str]) -> None:
    """Raise DamagedFileError for a Matrix Market file that declares more rows or entries than its text can hold."""
    rows, columns, entries, form, _, symmetry = scipy.io.mminfo(path)
    stored = entries if form == "coordinate" or symmetry == "general" else (rows * (columns - 1)) // 2
    if stored * _MIN_ENTRY_CHARACTERS[form] > os.path.getsize(path) or max(rows, columns) > MAX_MATRIX_ROWS:
        raise DamagedFileError(
            f"it declares {rows} x {columns} with {entries} entries in {Path(path).stat().st_size:,} bytes"
        )
