"""Reader of MATLAB files of version 7.3, which are HDF5: dense matrices transposed, sparse matrices by columns."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.optional import needed
from hbgear.common.process.checksums import DamagedFileError

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_NUMBERS = {
    b"double",
    b"single",
    b"logical",
    b"int8",
    b"int16",
    b"int32",
    b"int64",
    b"uint8",
    b"uint16",
    b"uint32",
    b"uint64",
}
MAX_MATRIX_BYTES = 1 << 30
"""Largest matrix that is read; only damaged files declare larger ones, or sparse matrices stored as dense."""


def is_hdf5(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is HDF5, with or without the 512 bytes that MATLAB writes at its start."""
    with open(path, "rb") as handle:
        start = handle.read(520)
    return start.startswith(_SIGNATURE) or start[512:] == _SIGNATURE


def read_hdf5(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the numeric matrices of a MATLAB file of version 7.3 by name; texts, cells and structures are omitted.

    Raises
    ------
    ValueError
        If h5py is not installed.
    DamagedFileError
        If a matrix is too large.
    """
    h5py = needed("h5py", "matlab", "a MATLAB file of version 7.3")
    matrices = {}
    with h5py.File(path, "r") as file:
        for name, node in file.items():
            if node.attrs.get("MATLAB_class") not in _NUMBERS or "MATLAB_empty" in node.attrs:
                continue
            size = node.nbytes if isinstance(node, h5py.Dataset) else sum(part.nbytes for part in node.values())
            if size > MAX_MATRIX_BYTES:
                raise DamagedFileError(
                    f"'{name}' has {size / 2**30:.1f} GiB; need at most {MAX_MATRIX_BYTES >> 30}, or a sparse matrix"
                )
            matrices[name] = _sparse(node) if isinstance(node, h5py.Group) else _dense(node[()])
    return matrices


def _dense(stored: Any) -> Any:
    """Return a matrix that is stored column by column."""
    if stored.dtype.names == ("real", "imag"):
        stored = stored["real"] + 1j * stored["imag"]
    return np.ascontiguousarray(stored.T)


def _sparse(group: Any) -> Any:
    """Return a sparse matrix that is stored by columns; one without entries has only their starts."""
    starts = np.asarray(group["jc"], dtype=np.int64)
    values = _dense(group["data"][()]) if "data" in group else np.empty(0)
    rows = np.asarray(group["ir"], dtype=np.int64) if "ir" in group else np.empty(0, dtype=np.int64)
    matrix = scipy.sparse.csc_array((values, rows, starts), shape=(int(group.attrs["MATLAB_sparse"]), len(starts) - 1))
    matrix.check_format(full_check=True)
    return matrix
