"""Square matrices given by the user, dense or scipy.sparse, of finite numbers, and names of their coordinates."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import scipy

from hbgear.common.text.messages import quoted
from hbgear.mechanics.series.fourier import is_listed, real_numbers

Matrix: TypeAlias = Any


def square(name: str, value: Any, n: int | None = None) -> Matrix:
    """Return a square matrix of finite numbers, read-only if it is dense, else a csr_array.

    Raises
    ------
    ValueError
        If it is not a square matrix of finite numbers, or has not n rows if n is given.
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
    if n is not None and out.shape[0] != n:
        raise ValueError(f"{name} has shape {out.shape}; need {(n, n)}, the shape of M")
    return out


def coordinate_names(field: str, names: Any, n: int, letter: str = "q") -> tuple[str, ...]:
    """Return the names of n coordinates, by default a letter with numbers.

    Raises
    ------
    ValueError
        If it is not a list of names, or has another length.
    """
    owner, _, plural = field.rpartition(": ")
    if not is_listed(names) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"{field} = {quoted(names)} must be a list of names")
    given = tuple(names) or tuple(f"{letter}{i + 1}" for i in range(n))
    if len(given) != n:
        raise ValueError(f"{owner}: {len(given)} {plural} for {n} coordinates; need one for each")
    return given
