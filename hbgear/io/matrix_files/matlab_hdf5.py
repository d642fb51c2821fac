"""Matrices of MATLAB files of version 7.3, which are HDF5: dense ones transposed, sparse ones by columns."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import scipy.sparse

from hbgear.common.optional import needed
from hbgear.io.matrix_files.matrix_market import DamagedFileError

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_NUMBERS = {b"double", b"single", b"logical", b"int8", b"int16", b"int32", b"int64", b"uint8", b"uint16", b"uint32",
            b"uint64"}  # fmt: skip
_MOST = 1 << 30  # bytes of a matrix; more would be declared by a damaged file, or belong in a sparse matrix


def is_hdf5(path: str | os.PathLike[str]) -> bool:
    """Whether a file is HDF5, with or without the 512 bytes that MATLAB writes before."""
    with open(path, "rb") as handle:
        start = handle.read(520)
    return start.startswith(_SIGNATURE) or start[512:] == _SIGNATURE


def read_hdf5(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Numeric matrices of a MATLAB file of version 7.3 by name; texts, cells and structures are left out.

    Raises
    ------
    ValueError
        If h5py is not installed.
    DamagedFileError
        If a matrix is too large.
    """
    h5py = needed("h5py", "matlab", "a MATLAB file of version 7.3")
    found = {}
    with h5py.File(path, "r") as file:
        for name, node in file.items():
            if node.attrs.get("MATLAB_class") not in _NUMBERS or "MATLAB_empty" in node.attrs:
                continue
            size = node.nbytes if isinstance(node, h5py.Dataset) else sum(part.nbytes for part in node.values())
            if size > _MOST:
                raise DamagedFileError(
                    f"'{name}' has {size / 2**30:.1f} GiB; need at most {_MOST >> 30}, or a sparse matrix"
                )
            found[name] = _sparse(node) if isinstance(node, h5py.Group) else _dense(node[()])
    return found


def _dense(stored: Any) -> Any:
    """A matrix of what is stored column after column."""
    if stored.dtype.names == ("real", "imag"):
        stored = stored["real"] + 1j * stored["imag"]
    return np.ascontiguousarray(stored.T)


def _sparse(group: Any) -> Any:
    """A sparse matrix of its columns; one without entries has only where they begin."""
    starts = np.asarray(group["jc"], dtype=np.int64)
    values = _dense(group["data"][()]) if "data" in group else np.empty(0)
    rows = np.asarray(group["ir"], dtype=np.int64) if "ir" in group else np.empty(0, dtype=np.int64)
    matrix = scipy.sparse.csc_array((values, rows, starts), shape=(int(group.attrs["MATLAB_sparse"]), len(starts) - 1))
    matrix.check_format(full_check=True)
    return matrix
