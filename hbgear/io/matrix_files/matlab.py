"""Reader of MATLAB files of versions 4 to 7, whose elements are checked before SciPy reads them.

file:      128 bytes, the last two the byte order; then elements
element:   type and size (4 bytes each), or both in 4 bytes and up to 4 bytes of data; a matrix contains elements

Compressed elements are unpacked once, checked, and given to SciPy as a file of plain elements.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path
from typing import Any

import scipy  # its parts are imported when they are first used

from hbgear.common.process.checksums import DamagedFileError
from hbgear.io.matrix_files.unpacked_size import SPARE, TIMES

_HEADER_BYTES = 128
"""Size of the header of a file of version 5 to 7."""

_MATRIX, _COMPRESSED = 14, 15
"""Types of elements: a matrix, and compressed data."""

_PLAIN_TYPES = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18}
"""Types of numbers and texts."""

MAX_DEPTH = 16
"""Largest depth of nested elements, such as matrices in cells in structures."""


def read_matlab(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the variables of a file of version 7 or earlier.

    Raises
    ------
    DamagedFileError
        If an element has an unknown type, is longer than the element that contains it, or the variables unpack to more
        bytes than `unpacked_size` admits.
    """
    content = Path(path).read_bytes()
    version_4 = 0 in content[:4]  # has no elements
    variables: dict[str, Any] = scipy.io.loadmat(io.BytesIO(content if version_4 else _plain(content)))
    for value in variables.values():
        if scipy.sparse.issparse(value) and value.format == "csc":
            value.check_format(full_check=True)
    return variables


def _plain(content: bytes) -> bytes:
    """Return the file with unpacked elements, which are checked."""
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise DamagedFileError("it is damaged, or not a .mat file")
    limit = remaining = SPARE + TIMES * len(content)
    blocks, position = [content[:_HEADER_BYTES]], _HEADER_BYTES
    while position < len(content):
        kind, start, end = _element(memoryview(content), position, order)
        if kind == _COMPRESSED:
            part = _unpacked(content[start:end], order, remaining)
            if part is None:
                raise DamagedFileError(
                    f"it unpacks to more than {limit:,} bytes in a file of {len(content):,}; "
                    "write sparse matrices as such"
                )
            remaining -= len(part)
        elif kind == _MATRIX:
            part = content[position:end]
        else:
            raise _unknown(kind)
        _check(memoryview(part), order, 0)
        blocks.append(part)
        position = end
    return b"".join(blocks)


def _element(data: memoryview, at: int, order: str) -> tuple[int, int, int]:
    """Return type, beginning and end of the data of an element."""
    if len(data) - at < 8:
        raise DamagedFileError("it is damaged: an element ends early")
    kind, size = struct.unpack_from(f"{order}II", data, at)
    start = at + 8
    if kind >> 16:  # both in four bytes
        kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
        if size > 4:
            raise DamagedFileError("it is damaged: a small element is too long")
    if size > len(data) - start:
        raise DamagedFileError("it is damaged: an element is longer than the file")
    return kind, start, start + size


def _unpacked(packed: bytes, order: str, remaining: int) -> bytes | None:
    """Return the element in compressed data; None if it is longer than ``remaining``, by the size before it."""
    unpacking = zlib.decompressobj()
    try:
        tag = unpacking.decompress(packed, 8)
        size = struct.unpack(f"{order}II", tag)[1] if len(tag) == 8 else 0
        return None if size > remaining else tag + unpacking.decompress(unpacking.unconsumed_tail, size + 1)[:size]
    except zlib.error:
        raise DamagedFileError("it is damaged: an element cannot be unpacked") from None


def _check(data: memoryview, order: str, depth: int) -> None:
    """Check the elements in an element."""
    at = 0
    while at < len(data):
        if depth > MAX_DEPTH:
            raise DamagedFileError("it is damaged: an element ends early")
        kind, start, end = _element(data, at, order)
        if kind == _MATRIX:
            _check(data[start:end], order, depth + 1)
        elif kind not in _PLAIN_TYPES or depth == 0:
            raise _unknown(kind)
        at = at + 8 if start == at + 4 else start + -(-(end - start) // 8) * 8


def _unknown(kind: int) -> DamagedFileError:
    return DamagedFileError(f"it is damaged: an element has the unknown type {kind}")
