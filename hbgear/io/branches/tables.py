"""Tables of a branch for other programs: the points as .csv, all data as .mat for MATLAB and Octave.

A .csv begins with lines "# name = text" that describe the curve and the meaning of its columns; the line of column
names follows (``pandas.read_csv(path, comment="#")``). A .mat has the same texts in ``about`` and ``explained``.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.atomic_write import atomic_write, checked_suffix
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.branch_data import saved_fields
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.io.branches.columns import Column, about, bracketed, columns_of, speeds_of
from hbgear.io.branches.npz import encode
from hbgear.mechanics.series.measures import default_measures


@checked_arguments()
def export(branch: Branch, path: str | os.PathLike[str]) -> None:
    """Write a table of the points (.csv), or all data for MATLAB and Octave (.mat), completely or not at all.

    Parameters
    ----------
    branch : Branch
        Branch, with the other branches of its span.
    path : path_like
        File that ends in .csv or .mat.

    Raises
    ------
    ValueError
        If the path has another ending.

    Examples
    --------
    >>> import hbgear as hb
    >>> import os, tempfile
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     hb.io.export(curve, os.path.join(folder, "curve.csv"))
    ...     os.listdir(folder)
    ...
    ['curve.csv']
    """
    if checked_suffix(path, (".csv", ".mat"), "use save for .npz") == ".csv":
        tables = [columns_of(curve) for curve in branch.curves]
        table, head = _joined_table(tables), "".join(f"{line}\n" for line in _head(branch, tables[0]))
        with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
            handle.write(head)
            writer = csv.writer(handle)
            writer.writerow(table)
            writer.writerows(zip(*table.values(), strict=True))
    else:
        from scipy.io import savemat

        with atomic_write(path) as handle:
            savemat(handle, _matlab(branch), long_field_names=True, do_compression=True, oned_as="column")


def _joined_table(tables: Sequence[Mapping[str, Column]]) -> dict[str, Any]:
    """Return the columns of the .csv; of several curves, with the number of the curve first and empty missing cells."""
    contents = [{name: column.values for name, column in table.items()} for table in tables]
    if len(contents) == 1:
        return contents[0]
    counts = [len(table["residual"]) for table in contents]
    names = dict.fromkeys(name for table in contents for name in table)
    numbers = {"curve": [i + 1 for i, count in enumerate(counts) for _ in range(count)]}
    return numbers | {
        name: [x for table, count in zip(contents, counts, strict=True) for x in table.get(name, [""] * count)]
        for name in names
    }


def _head(branch: Branch, columns: Mapping[str, Column]) -> Iterator[str]:
    """Yield the lines before the table: description of the curve and of its columns, one line for all elements."""
    yield from (f"# {name} = {text}" for name, text in about(branch).items())
    described = set()
    for name, column in columns.items():
        key = f"{column.key}_ELEMENT" if column.element else name
        higher = column.key[1:].isdigit() and column.key not in ("a0", "a1", "b1")
        if key not in described and not higher:
            described.add(key)
            yield f"# column {key}: {column.meaning}{bracketed(column.unit)}"


def _matlab(branch: Branch) -> dict[str, Any]:
    """Return the variables of the .mat file: the fields of the branch, its measures, and indices counted from 1."""

    def convert(value: Any) -> Any:
        if isinstance(value, Branch) and value is not branch:
            return _matlab(value)
        if dataclasses.is_dataclass(value):
            pairs = saved_fields(value)
            if isinstance(value, SpecialPoint):
                pairs["row"] = pairs.pop("index") + 1
            return {name: convert(x) for name, x in pairs.items() if x is not None}
        if isinstance(value, dict):  # MATLAB has no field without a name
            return {name or "unnamed": convert(x) for name, x in value.items()}
        if isinstance(value, tuple) and not all(isinstance(x, float) for x in value):
            cells = np.empty(len(value), dtype=object)
            cells[:] = [convert(x) for x in value]
            return cells
        return str(value) if isinstance(value, Status) else value

    variables: dict[str, Any] = convert(branch) | {"meta": json.dumps(encode(branch.meta, "meta", {}))}
    variables["jumps"] = variables.pop("jump_records")
    variables["about"] = about(branch)
    if branch.layout:
        elements = range(len(branch.layout.elements))
        rows = {name: [branch.amplitude(name, j) for j in elements] for name in default_measures()}
        variables["amplitude"] = {name: np.stack(columns, axis=-1) for name, columns in rows.items()}
    if branch.stable is not None:
        variables |= {"stable": branch.stable, "undecided": branch.undecided}
    variables |= {name: column.values for name, column in speeds_of(branch).items()}
    return variables | {"explained": {name: text for name, text in EXPLAINED.items() if name in variables}}


EXPLAINED = {
    "parameter": "name of the continuation parameter",
    "values": "its value at each point [P x 1]",
    "X": "unknowns of each point [P x n]: of each element a0, a1, b1, ..., aH, bH",
    "fixed": "fixed parameters",
    "tracked": "further parameters that vary along the curve",
    "multipliers": "Floquet multipliers of each point [P x r], complex",
    "iterations": "Newton iterations of each point",
    "residual": "residual of each point, relative to the forces",
    "regime": "impact regime of each element at each point: 0 no impact, 1 single-sided, 2 double-sided, -1 unknown",
    "error": "estimated error of the motion at each point, rms",
    "step": "arclength step to each point",
    "special": "special points: kind, label, row (point, from 1), parameters, multipliers, location error",
    "jumps": "jumps of a slow sweep: value, direction, motion before and after",
    "status": "why the trace ended",
    "message": "the same in words",
    "layout": "layout of X: harmonics H, subharmonic order nu, names of the elements, breakpoints of their laws",
    "meta": "versions, model and settings, in JSON",
    "others": "further curves of the span, in the same form",
    "modulus_error": "estimated error of the largest modulus of the multipliers",
    "amplitude": "measures of amplitude [P x m]: rms of the alternating part, pp2 half peak-to-peak, max, mean",
    "stable": "true where a point is verified to be stable",
    "undecided": "true where its stability is undecided",
    "mesh_Hz": "mesh frequency of each point [Hz]",
    "pinion_rpm": "speed of the pinion at each point [r/min]",
    "about": "description of the curve",
}
"""Meaning of the variables of a .mat file."""
