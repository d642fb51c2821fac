"""Matrix Market files, checked before SciPy reads them: of a damaged one it may write beyond the matrix."""

from __future__ import annotations

import io
import os
from typing import Any

import numpy as np
import scipy.io

_NUMBERS = b"0123456789+-.eE \t\r\n"
_TOKENS = {"real": 1, "integer": 1, "unsigned-integer": 1, "complex": 2, "pattern": 0}


class DamagedFileError(ValueError):
    """A file of matrices that is refused, with the reason."""


def read_matrix_market(path: str | os.PathLike[str]) -> Any:
    """The matrix in a Matrix Market file.

    Raises
    ------
    DamagedFileError
        If it has other characters than numbers, or not as many as its size says.
    """
    with open(path, "rb") as handle:
        content = handle.read()
    rows, columns, entries, form, kind, symmetry = scipy.io.mminfo(io.BytesIO(content))
    lines = (line for line in content.split(b"\n") if line.strip() and not line.lstrip().startswith(b"%"))
    next(lines)  # the size
    body = b"\n".join(lines)
    if body.translate(None, _NUMBERS):
        raise DamagedFileError("it has characters that belong to no number")
    found = np.array(body.split(), dtype=bytes).astype(float).size
    if form == "coordinate":
        expected = entries * (2 + _TOKENS[kind])
    else:
        half = {"symmetric": rows * (rows + 1) // 2, "hermitian": rows * (rows + 1) // 2,
                "skew-symmetric": rows * (rows - 1) // 2}  # fmt: skip
        expected = half.get(symmetry, rows * columns) * _TOKENS[kind]
    if found != expected:
        raise DamagedFileError(f"it has {found} numbers, and its size needs {expected}")
    return scipy.io.mmread(io.BytesIO(content))
