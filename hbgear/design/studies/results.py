"""Results of a study, read from its table file without the model."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.checksums import DamagedFileError
from hbgear.io.branches.archive import archive_of

_TABLE_WIDTHS = {"jump_table": 5, "curve_table": 4}
"""Numbers of columns of the two-dimensional arrays of a table file."""

_CURVE_DEFAULTS = {"curve_measure": np.array("pp2"), "curve_element": np.array(0)}
"""Measure and element of the amplitudes in a table file that does not state them."""


@dataclass(frozen=True, eq=False)
class Results:
    """Table, jumps and curves of a study, in the form of `Cases`.

    Attributes
    ----------
    table : dict of str to ndarray
        Columns by name, with one entry for each computed case.
    jumps : ndarray, shape (J, 5)
        Case, Omega, direction, amplitude before and amplitude after each jump.
    curves : dict of int to ndarray, shape (3, P)
        Omega, amplitude and stability (1 or 0) by case.
    measure, element : str and int or str
        Measure and element of the amplitudes.
    """

    table: dict[str, Any]
    jumps: Array
    curves: dict[int, Array]
    measure: str = "pp2"
    element: int | str = 0


def read_results(path: str | os.PathLike[str]) -> Results:
    """Read the results of a study from a table of `Cases.export` (.npz), or a folder of ``hbgear study``.

    FileNotFoundError is raised if there is no such file, ValueError if it is not a table of a study.
    """
    file = Path(path) / "table.npz" if Path(path).is_dir() else Path(path)
    need = "give the folder of hbgear study, or a table that Cases.export has written as .npz"
    try:
        with archive_of(file) as archive:
            arrays = {name: archive.array(name) for name in archive.names}
    except FileNotFoundError:
        raise FileNotFoundError(f"there is no file '{file}'; {need}") from None
    except (OSError, DamagedFileError) as error:
        raise ValueError(f"'{file}' cannot be read as the table of a study: {error}; {need}") from None
    for name, width in _TABLE_WIDTHS.items():
        if (
            name not in arrays
            or arrays[name].ndim != 2
            or arrays[name].shape[1] != width
            or arrays[name].dtype != float
        ):
            raise ValueError(f"'{file}' is not a table of a study: it has no array {name} (n, {width}); {need}")
    jumps, curves = (arrays.pop(name) for name in _TABLE_WIDTHS)
    measure, element = (arrays.pop(name, default) for name, default in _CURVE_DEFAULTS.items())
    cases = arrays.get("case", np.empty(0))
    if cases.dtype.kind != "i" or any(column.shape != (len(cases),) for column in arrays.values()):
        raise ValueError(
            f"'{file}' is not a table of a study: it needs columns of one length, one of them case; {need}"
        )
    curves_by_case = {int(case): curves[curves[:, 0] == case, 1:].T for case in np.unique(curves[:, 0])}
    return Results(arrays, jumps, curves_by_case, str(measure), element.item())
