"""Safe reader of .npz files: nothing is unpacked before its declared size is plausible.

An .npz is a .zip of arrays, each with a header that declares its type and shape. A damaged or malicious file may
declare any size, and the libraries that read it allocate as declared.
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
from hbgear.common.process.checksums import DamagedFileError
from hbgear.common.text.messages import shortened

_SPARE_BYTES, _MAX_EXPANSION = 2**24, 4
"""Bytes that a file may declare: the first number, plus the second times the size of the file (for compressed ones)."""


_ARRAY_KINDS = "biufcU"
"""Kinds of NumPy types that are read: plain numbers and text."""


_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Compressions that NumPy writes."""


class Archive:
    """The arrays of an .npz by name, each read on access.

    Parameters
    ----------
    handle : file object
        A seekable binary file, open for reading.
    spare : int, optional
        Bytes that the arrays may have in any file; default 16 MiB.
    times : int, optional
        Further bytes that the arrays may have per byte of the file; default 4.

    Raises
    ------
    DamagedFileError
        If the file is not an .npz, or declares more than such a file can hold; from the methods, if the data are
        damaged.
    """

    def __init__(self, handle: IO[bytes], spare: int = _SPARE_BYTES, times: int = _MAX_EXPANSION) -> None:
        with _refusing():
            size = handle.seek(0, os.SEEK_END)
            handle.seek(0)
            if not zipfile.is_zipfile(handle):
                raise DamagedFileError("it is not an .npz, or cut off")
            self._zip = zipfile.ZipFile(handle)
            self._members = {info.filename: info for info in self._zip.infolist()}
            declared = sum(info.file_size for info in self._members.values())
            if len(self._members) < len(self._zip.infolist()):
                raise DamagedFileError("it has two arrays of the same name")
            if declared > spare + times * size:
                raise DamagedFileError(f"it declares {declared:,} bytes in a file of {size:,}")

    @property
    def names(self) -> list[str]:
        """Names of the arrays."""
        return [name.removesuffix(".npy") for name in self._members]

    def __contains__(self, name: str) -> bool:
        return f"{name}.npy" in self._members

    def array(self, name: str) -> Array:
        """Return the array of that name."""
        with _refusing():
            if f"{name}.npy" not in self._members:
                raise DamagedFileError(f"it has no array '{shortened(name)}'")
            info = self._members[f"{name}.npy"]
            if info.compress_type not in _COMPRESSIONS:
                raise DamagedFileError(f"array '{name}' has a compression that NumPy does not write")
            with self._zip.open(info) as member:
                return _decoded_array(name, member.read(info.file_size))  # at most the declared size

    def header(self) -> dict[str, Any]:
        """Return the JSON object that is stored as the array ``header``."""
        with _refusing():
            text = self.array("header")
            if text.dtype.kind != "U" or text.shape:
                raise DamagedFileError("its header is not text")
            try:
                content = json.loads(str(text))
            except ValueError:
                raise DamagedFileError("its header is not JSON") from None
            except RecursionError:
                raise DamagedFileError("its header is nested too deeply") from None
            if not isinstance(content, dict):
                raise DamagedFileError(f"its header is {_JSON[type(content)]}, not an object")
            if too_deep(content):
                raise DamagedFileError("its header is nested too deeply")
            return content


def too_deep(tree: Any) -> bool:
    """Return whether lists and objects are nested deeper than 100 levels, which recursion cannot follow."""
    level = [tree]
    for _ in range(100):
        level = [
            inner
            for node in level
            if isinstance(node, list | dict)
            for inner in (node.values() if isinstance(node, dict) else node)
        ]
    return bool(level)


_JSON = {type(None): "null", bool: "true or false", int: "a number", float: "a number", str: "a text", list: "a list"}


@contextmanager
def archive_of(
    path: str | os.PathLike[str], spare: int = _SPARE_BYTES, times: int = _MAX_EXPANSION
) -> Iterator[Archive]:
    """Open the archive in a file; ``spare`` and ``times`` as for `Archive`.

    OSError is raised if the file cannot be opened, DamagedFileError as for `Archive`, and if the path is not a regular
    file: pipes and devices need not end.
    """
    if not Path(path).is_file():
        os.stat(path)  # raises if it is missing
        raise DamagedFileError("it is a folder" if Path(path).is_dir() else "it is not a regular file")
    with open(path, "rb") as handle:
        yield Archive(handle, spare, times)


def _decoded_array(name: str, data: bytes) -> Array:
    """Return the array in the bytes of an .npy file."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise DamagedFileError(f"array '{name}' has version {version} of .npy; need 1.0 or 2.0")
    shape, by_columns, kind = readers[version](stream)
    offset, count = stream.tell(), 1
    for length in shape:
        count *= int(length)
    if kind.kind not in _ARRAY_KINDS or kind.itemsize == 0:
        raise DamagedFileError(f"array '{name}' holds {kind}; need numbers or text")
    if any(length < 0 for length in shape) or count * kind.itemsize != len(data) - offset:
        raise DamagedFileError(
            f"array '{name}' declares the shape {shape} of {kind} and holds {len(data) - offset:,} bytes"
        )
    array = np.frombuffer(data, kind, count, offset).reshape(shape, order="F" if by_columns else "C")
    return array.astype(kind.newbyteorder("="))  # a writable copy


@contextmanager
def _refusing() -> Iterator[None]:
    """Convert the errors of the readers of .zip, .npy and JSON, which are of many classes, to `DamagedFileError`."""
    try:
        yield
    except DamagedFileError:
        raise
    except MemoryError as error:
        raise DamagedFileError("it does not fit into the memory") from error
    except Exception as error:
        raise DamagedFileError("it is damaged") from error
