"""What a study has found, as its table file holds it: read without the model, and without computing anything."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.io.branches.archive import Damaged, archive_of

_TABLES = {"jump_table": 5, "curve_table": 4}  # arrays beside the columns, and their widths


@dataclass(frozen=True, eq=False)
class Results:
    """Table, jumps and curves of a study, as `Cases` has them.

    Parameters
    ----------
    table : dict of str to Any
        Columns by name, one row for each case done.
    jumps : ndarray, shape (J, 5)
        Case, Omega, direction, amplitude before and after.
    curves : dict of int to ndarray
        By case, (3, P) Omega, amplitude and stability.
    """

    table: dict[str, Any]
    jumps: Array
    curves: dict[int, Array]


def read_results(path: str | os.PathLike[str]) -> Results:
    """The results in a table as `Cases.export` writes it (.npz), or in the folder of ``hbgear study``.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is no such file, or it is no table of a study.
    """
    file = Path(path) / "table.npz" if Path(path).is_dir() else Path(path)
    need = "give the folder of hbgear study, or a table that Cases.export has written as .npz"
    try:
        with archive_of(file) as found:
            arrays = {name: found.array(name) for name in found.names}
    except FileNotFoundError:
        raise FileNotFoundError(f"there is no file '{file}'; {need}") from None
    except (OSError, Damaged) as error:
        raise ValueError(f"'{file}' cannot be read as the table of a study: {error}; {need}") from None
    for name, width in _TABLES.items():
        if (
            name not in arrays
            or arrays[name].ndim != 2
            or arrays[name].shape[1] != width
            or arrays[name].dtype != float
        ):
            raise ValueError(f"'{file}' is no table of a study, which has an array {name} (n, {width}); {need}")
    jumps, curves = (arrays.pop(name) for name in _TABLES)
    cases = arrays.get("case", np.empty(0))
    if cases.dtype.kind != "i" or any(column.shape != (len(cases),) for column in arrays.values()):
        raise ValueError(f"'{file}' is no table of a study, which has columns of one length, one of them case; {need}")
    parts = {int(case): curves[curves[:, 0] == case, 1:].T for case in np.unique(curves[:, 0])}
    return Results(arrays, jumps, parts)
