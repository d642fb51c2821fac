"""Square matrices given by the user: dense or scipy.sparse, of finite numbers."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import scipy

from hbgear.mechanics.series.fourier import real_numbers

Matrix: TypeAlias = Any


def square(name: str, value: Any) -> Matrix:
    """Return a square matrix of finite numbers, read-only if it is dense, else a csr_array.

    Raises
    ------
    ValueError
        If it is not a square matrix of finite numbers.
    """
    if not isinstance(value, np.ndarray | list | tuple) and scipy.sparse.issparse(
        value
    ):  # last, because the import is slow
        if value.dtype.kind not in "iufb":
            raise ValueError(f"{name} of {value.dtype} must be a square matrix of numbers")
        out: Matrix = scipy.sparse.csr_array(value, dtype=float)
        finite = np.all(np.isfinite(out.data))
    else:
        out = real_numbers(name, value, "a square matrix of numbers")
        finite = np.all(np.isfinite(out))
        out.flags.writeable = False
    if out.ndim != 2 or out.shape[0] != out.shape[1] or not out.shape[0]:
        raise ValueError(f"{name} has shape {out.shape}; need a square matrix")
    if not finite:
        raise ValueError(f"{name} has entries that are not finite")
    return out
