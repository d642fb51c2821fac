"""Reading .npz files of whatever origin: nothing is unpacked before its declared size is known to be plausible.

An .npz is a .zip of arrays, each with a header that declares its type and shape. Both declare sizes, and both may be
damaged or made up; the libraries that read them believe them.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.text.messages import shortened

_SPARE, _TIMES = 2**24, 4  # bytes that may be declared: this, and so many times the size of the file (if compressed)


_KINDS = "biufcU"  # of NumPy's types: plain numbers and text


_PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


class Damaged(ValueError):
    """The file is no .npz, or something in it cannot be read."""


class Archive:
    """The arrays of an .npz by name, each read when it is asked for.

    Parameters
    ----------
    handle : a seekable file, open for reading bytes.
    spare, times : bytes that the arrays may have: these, and so many for each byte of the file.

    Raises
    ------
    Damaged
        If it is no .npz, or declares more than such a file can hold; from the methods, if what they read is damaged.
    """

    def __init__(self, handle: IO[bytes], spare: int = _SPARE, times: int = _TIMES) -> None:
        with _refusing():
            size = handle.seek(0, os.SEEK_END)
            handle.seek(0)
            if not zipfile.is_zipfile(handle):
                raise Damaged("it is no .npz at all, or cut off")
            self._zip = zipfile.ZipFile(handle)
            self._members = {info.filename: info for info in self._zip.infolist()}
            declared = sum(info.file_size for info in self._members.values())
            if len(self._members) < len(self._zip.infolist()):
                raise Damaged("it has two arrays of one name")
            if declared > spare + times * size:
                raise Damaged(f"it declares {declared:,} bytes in a file of {size:,}")

    @property
    def names(self) -> list[str]:
        """Of its arrays."""
        return [name.removesuffix(".npy") for name in self._members]

    def __contains__(self, name: str) -> bool:
        return f"{name}.npy" in self._members

    def array(self, name: str) -> Array:
        """The array of that name."""
        with _refusing():
            if f"{name}.npy" not in self._members:
                raise Damaged(f"it has no array '{shortened(name)}'")
            info = self._members[f"{name}.npy"]
            if info.compress_type not in _PACKED:
                raise Damaged(f"array '{name}' is compressed in a way that NumPy does not write")
            with self._zip.open(info) as member:
                return _array_of(name, member.read(info.file_size))  # as much as was declared, whatever there is

    def header(self) -> dict[str, Any]:
        """The JSON object that is the array ``header``."""
        with _refusing():
            text = self.array("header")
            if text.dtype.kind != "U" or text.shape:
                raise Damaged("its header is no text")
            try:
                found = json.loads(str(text))
            except ValueError:
                raise Damaged("its header is no JSON") from None
            except RecursionError:
                raise Damaged("its header is nested too deeply") from None
            if not isinstance(found, dict):
                raise Damaged(f"its header is {_JSON[type(found)]}, not an object")
            if too_deep(found):
                raise Damaged("its header is nested too deeply")
            return found


def too_deep(tree: Any, most: int = 100) -> bool:
    """Whether lists and objects lie in each other more than so many levels deep; no recursion can follow those."""
    level = [tree]
    for _ in range(most):
        level = [
            inner
            for each in level
            if isinstance(each, list | dict)
            for inner in (each.values() if isinstance(each, dict) else each)
        ]
    return bool(level)


_JSON = {type(None): "null", bool: "true or false", int: "a number", float: "a number", str: "a text", list: "a list"}


@contextmanager
def archive_of(path: str | os.PathLike[str], spare: int = _SPARE, times: int = _TIMES) -> Iterator[Archive]:
    """The archive in a file; spare and times as of `Archive`.

    Raises
    ------
    OSError
        If the file cannot be opened.
    Damaged
        As of `Archive`, and if it is no regular file: pipes and devices need not end.
    """
    if not Path(path).is_file():
        os.stat(path)  # tells of a missing one
        raise Damaged("it is a folder" if Path(path).is_dir() else "it is no regular file")
    with open(path, "rb") as handle:
        yield Archive(handle, spare, times)


def _array_of(name: str, data: bytes) -> Array:
    """The array in the bytes of an .npy file."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise Damaged(f"array '{name}' is of version {version} of .npy; need 1.0 or 2.0")
    shape, by_columns, kind = readers[version](stream)
    offset, count = stream.tell(), 1
    for length in shape:
        count *= int(length)
    if kind.kind not in _KINDS or kind.itemsize == 0:
        raise Damaged(f"array '{name}' holds {kind}, which is no number and no text")
    if any(length < 0 for length in shape) or count * kind.itemsize != len(data) - offset:
        raise Damaged(f"array '{name}' declares the shape {shape} of {kind} and holds {len(data) - offset:,} bytes")
    array = np.frombuffer(data, kind, count, offset).reshape(shape, order="F" if by_columns else "C")
    return array.astype(kind.newbyteorder("="))  # a copy that may be written to


@contextmanager
def _refusing() -> Iterator[None]:
    """Whatever the readers of .zip, .npy and JSON stumble over is damage: what they raise is no closed list."""
    try:
        yield
    except Damaged:
        raise
    except MemoryError as error:
        raise Damaged("it does not fit into the memory") from error
    except Exception as error:
        raise Damaged("it is damaged") from error
