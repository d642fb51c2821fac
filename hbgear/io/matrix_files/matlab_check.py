"""Check of MATLAB files of versions 5 to 7 before SciPy reads them: it does not check the types of elements.

file:      128 bytes, the last two the byte order; then elements
element:   type and size (4 bytes each), or both in 4 bytes and up to 4 bytes of data; a matrix contains elements
"""

from __future__ import annotations

import os
import struct
import zlib

from hbgear.io.matrix_files.matrix_market import DamagedFileError

_MATRIX, _COMPRESSED = 14, 15
"""Types of elements: a matrix, and compressed data."""

_PLAIN_TYPES = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18}
"""Types of numbers and texts."""

MAX_DEPTH = 16
"""Largest depth of nested elements, such as matrices in cells in structures."""

MAX_UNPACKED_BYTES = 1 << 30
"""Largest size of a compressed element when it is unpacked."""


def check_matlab(path: str | os.PathLike[str]) -> None:
    """Refuse a file with an element of an unknown type, or one that is longer than the element that contains it.

    Raises
    ------
    DamagedFileError
        If there is such an element.
    """
    with open(path, "rb") as handle:
        content = handle.read()
    if 0 in content[:4]:  # version 4, which has no elements
        return
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise DamagedFileError("it is damaged, or not a .mat file")
    _walk(memoryview(content)[128:], order, 0)


def _walk(data: memoryview, order: str, depth: int) -> None:
    """Check the elements in a section of a file."""
    at = 0
    while at < len(data):
        if len(data) - at < 8 or depth > MAX_DEPTH:
            raise DamagedFileError("it is damaged: an element ends early")
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start = at + 8
        if kind >> 16:  # both in four bytes
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
            if size > 4:
                raise DamagedFileError("it is damaged: a small element is too long")
        if size > len(data) - start:
            raise DamagedFileError("it is damaged: an element is longer than the file")
        if kind == _COMPRESSED and depth == 0:
            _walk(_unpacked(data[start : start + size]), order, 1)
        elif kind == _MATRIX:
            _walk(data[start : start + size], order, depth + 1)
        elif kind not in _PLAIN_TYPES or depth == 0:
            raise DamagedFileError(f"it is damaged: an element has the unknown type {kind}")
        small = start == at + 4
        at = at + 8 if small else start + (size if kind == _COMPRESSED else -(-size // 8) * 8)


def _unpacked(data: memoryview) -> memoryview:
    unpacker = zlib.decompressobj()
    try:
        out = unpacker.decompress(data, MAX_UNPACKED_BYTES)
    except zlib.error:
        raise DamagedFileError("it is damaged: an element cannot be unpacked") from None
    if unpacker.unconsumed_tail:
        raise DamagedFileError(f"an element has more than {MAX_UNPACKED_BYTES >> 30} GiB when it is unpacked")
    return memoryview(out)
