"""Matrix Market files, checked before SciPy reads them: for a damaged file it may write outside of the matrix."""

from __future__ import annotations

import io
import os
from typing import Any

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.process.checksums import DamagedFileError

_NUMBERS = b"0123456789+-.eE \t\r\n"
"""Characters of numbers and spaces."""

_TOKENS = {"real": 1, "integer": 1, "unsigned-integer": 1, "complex": 2, "pattern": 0}


def read_matrix_market(path: str | os.PathLike[str]) -> Any:
    """Return the matrix in a Matrix Market file.

    DamagedFileError is raised if the file has other characters than numbers, or another count of numbers than its size
    requires.
    """
    with open(path, "rb") as handle:
        content = handle.read()
    rows, columns, entries, form, kind, symmetry = scipy.io.mminfo(io.BytesIO(content))
    lines = (line for line in content.split(b"\n") if line.strip() and not line.lstrip().startswith(b"%"))
    next(lines)  # the size
    body = b"\n".join(lines)
    if body.translate(None, _NUMBERS):
        raise DamagedFileError("it has characters that are not part of a number")
    found = np.array(body.split(), dtype=bytes).astype(float).size
    if form == "coordinate":
        expected = entries * (2 + _TOKENS[kind])
    else:
        half = {
            "symmetric": rows * (rows + 1) // 2,
            "hermitian": rows * (rows + 1) // 2,
            "skew-symmetric": rows * (rows - 1) // 2,
        }
        expected = half.get(symmetry, rows * columns) * _TOKENS[kind]
    if found != expected:
        raise DamagedFileError(f"it has {found} numbers, and its size needs {expected}")
    return scipy.io.mmread(io.BytesIO(content))
