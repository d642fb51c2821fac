"""Limit of the unpacked size of matrix files, checked before they are read.

    bytes unpacked <= 256 MB + 32 times the size of the file

This admits two dense matrices of 4000 coordinates; larger ones, mostly zeros, are written as sparse.
"""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import IO

import scipy

SPARE, TIMES = 2**28, 32
"""Bytes that a file may unpack to: the first number, plus the second times the size of the file."""

_CHUNK_BYTES = 1 << 16  # bytes read at once

_HEADER_BYTES = 128
"""Size of the header of a .mat file of version 5; its variables follow, each with a tag of 8 bytes."""

_COMPRESSED = 15
"""Type of a compressed variable."""

_MIN_ENTRY_CHARACTERS = {"coordinate": 4, "array": 2}
"""Fewest characters of an entry in the text of a .mtx file: "1 1\\n", "1\\n"."""

MAX_MATRIX_ROWS = 1_000_000
"""Largest number of rows of a matrix; larger systems cannot be solved here."""


class TooMuch(ValueError):
    """Error: a file declares more than it can hold."""


def check_mat(path: str | os.PathLike[str]) -> None:
    """Refuse a MATLAB file of version 5 to 7 whose variables unpack to too many bytes; other versions are not checked.

    Variables are unpacked in chunks, whose bytes are counted.

    Raises
    ------
    TooMuch
        If the variables exceed the limit.
    """
    size = os.path.getsize(path)
    limit = left = SPARE + TIMES * size
    with open(path, "rb") as handle:
        head = handle.read(_HEADER_BYTES)
        if len(head) < _HEADER_BYTES or head[126:128] not in (b"IM", b"MI"):
            return
        order = "<" if head[126:128] == b"IM" else ">"
        while len(tag := handle.read(8)) == 8:
            kind, length = struct.unpack(f"{order}II", tag)
            if kind == _COMPRESSED:
                left -= _unpacked(handle, length, left)
                if left < 0:
                    raise TooMuch(
                        f"it unpacks to more than {limit:,} bytes in a file of {size:,}; write sparse matrices as such"
                    )
            else:
                handle.seek(length, os.SEEK_CUR)


def _unpacked(handle: IO[bytes], length: int, limit: int) -> int:
    """Return the unpacked size of the next ``length`` bytes of a file, counted up to just above ``limit``."""
    unpacking, count = zlib.decompressobj(), 0
    while length > 0 and count <= limit:
        data = handle.read(min(length, _CHUNK_BYTES))
        if not data:
            break
        length -= len(data)
        while data and count <= limit:
            try:
                count += len(unpacking.decompress(data, _CHUNK_BYTES))
            except zlib.error:  # the reader reports the damage
                handle.seek(length, os.SEEK_CUR)
                return count
            data = unpacking.unconsumed_tail
    return count


def check_mtx(path: str | os.PathLike[str]) -> None:
    """Refuse a Matrix Market file that declares more rows or entries than its text can hold.

    Raises
    ------
    TooMuch
        If it declares more.
    """
    rows, columns, entries, form, _, symmetry = scipy.io.mminfo(path)
    stored = entries if form == "coordinate" or symmetry == "general" else (rows * (columns - 1)) // 2
    if stored * _MIN_ENTRY_CHARACTERS[form] > os.path.getsize(path) or max(rows, columns) > MAX_MATRIX_ROWS:
        raise TooMuch(f"it declares {rows} x {columns} with {entries} entries in {Path(path).stat().st_size:,} bytes")
