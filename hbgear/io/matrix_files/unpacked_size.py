"""Files of matrices that would unpack to far more than they hold are refused before they are read.

    bytes unpacked <= 256 MB + 32 times the size of the file

That is two matrices of 4000 coordinates, whatever is in them; larger ones, mostly zeros, are written as sparse.
"""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import IO

import scipy

SPARE, TIMES = 2**28, 32
"""Bytes that a file may unpack to: these, and so many for each of its own."""

_CHUNK = 1 << 16

_HEADER = 128  # bytes of a .mat file of version 5, behind which its variables follow, each with a tag of 8

_COMPRESSED = 15  # type of a variable that is compressed

_FEWEST = {"coordinate": 4, "array": 2}  # characters of an entry in the text of a .mtx file: "1 1\n", "1\n"

_MOST_ROWS = 1_000_000  # of a matrix, far beyond what can be solved for here


class TooMuch(ValueError):
    """A file that declares more than it can hold."""


def check_mat(path: str | os.PathLike[str]) -> None:
    """Refuse a MATLAB file of version 5 to 7 whose variables unpack to too much; of others nothing is known here.

    Variables are unpacked piece by piece, and counted.

    Raises
    ------
    TooMuch
    """
    size = os.path.getsize(path)
    limit = left = SPARE + TIMES * size
    with open(path, "rb") as handle:
        head = handle.read(_HEADER)
        if len(head) < _HEADER or head[126:128] not in (b"IM", b"MI"):
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


def _unpacked(handle: IO[bytes], length: int, most: int) -> int:
    """Bytes to which the next ones of a file unpack, counted up to one more than the most."""
    unpacking, count = zlib.decompressobj(), 0
    while length > 0 and count <= most:
        data = handle.read(min(length, _CHUNK))
        if not data:
            break
        length -= len(data)
        while data and count <= most:
            try:
                count += len(unpacking.decompress(data, _CHUNK))
            except zlib.error:  # the reader says what is damaged
                handle.seek(length, os.SEEK_CUR)
                return count
            data = unpacking.unconsumed_tail
    return count


def check_mtx(path: str | os.PathLike[str]) -> None:
    """Refuse a Matrix Market file that declares more rows or entries than its text can have.

    Raises
    ------
    TooMuch
    """
    rows, columns, entries, form, _, symmetry = scipy.io.mminfo(path)
    stored = entries if form == "coordinate" or symmetry == "general" else (rows * (columns - 1)) // 2
    if stored * _FEWEST[form] > os.path.getsize(path) or max(rows, columns) > _MOST_ROWS:
        raise TooMuch(f"it declares {rows} x {columns} with {entries} entries in {Path(path).stat().st_size:,} bytes")
