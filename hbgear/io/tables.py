"""Tables of a branch for other programs: rows as .csv, everything as .mat for MATLAB and Octave."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
from typing import Any

import numpy as np

from hbgear.common.replacing import checked_suffix, replacing
from hbgear.continuation.branch import Branch, SpecialPoint, Status, name_of_regime, saved_fields
from hbgear.harmonic.observables import MEASURES, layout_of
from hbgear.io.npz import encode


def export(branch: Branch, path: str | os.PathLike[str]) -> None:
    """Write a table of the rows (.csv) or everything for MATLAB and Octave (.mat), whole or not at all."""
    if checked_suffix(path, (".csv", ".mat"), "use save for .npz") == ".csv":
        table = _whole_table(branch)
        with replacing(path, "x", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(table)
            writer.writerows(zip(*table.values(), strict=True))
    else:
        from scipy.io import savemat

        with replacing(path) as handle:
            savemat(handle, _matlab(branch), long_field_names=True, do_compression=True, oned_as="column")


def _whole_table(branch: Branch) -> dict[str, Any]:
    """Columns of the .csv; with the number of the curve first, and nothing where one has no such column, of several."""
    if not branch.others:
        return _table(branch)
    tables = [{"curve": [i + 1] * len(b), **_table(b)} for i, b in enumerate((branch, *branch.others))]
    names = dict.fromkeys(name for table in tables for name in table)
    return {name: [x for t in tables for x in t.get(name, [""] * len(t["curve"]))] for name in names}


def _table(branch: Branch) -> dict[str, Any]:
    """Columns of one curve: parameters, stability, per element its regime, measures and coefficients.

    special_value, special_error : where a special point lies, more accurately than its row may, and the error of that.
    landing : how it was decided where the jump from a special point lands.
    stable : 1 or 0; nothing where it is undecided or unknown.
    """
    columns: dict[str, Any] = {branch.parameter: branch.values, **branch.tracked}
    points = {point.index: point for point in branch.special}
    columns["special"] = [points[i].label if i in points else "" for i in range(len(branch))]
    columns["special_value"] = [
        points[i].parameters[branch.parameter] if i in points else "" for i in range(len(branch))
    ]
    columns["special_error"] = [points[i].error if i in points else "" for i in range(len(branch))]
    decided = {jump.label: jump.decided for jump in branch.jumps()}
    columns["landing"] = [decided.get(label, "") for label in columns["special"]]
    if branch.multipliers is not None:
        columns["stable"] = [{"stable": 1, "unstable": 0}.get(verdict, "") for verdict in branch.verdicts]
        columns["multiplier_max"] = np.abs(branch.multipliers).max(axis=-1, initial=0.0)
    columns |= {name: getattr(branch, name) for name in ("residual", "iterations", "error")}
    layout = layout_of(branch)
    if layout is None:
        return columns | {f"X{i}": column for i, column in enumerate(branch.X.T)}
    terms = ["a0", *(f"{letter}{k + 1}" for k in range(layout.harmonics) for letter in "ab")]
    for j, name in enumerate(layout.elements):
        columns[f"regime_{name}"] = [name_of_regime(codes[j : j + 1], layout) for codes in branch.regime]
        columns |= {f"{measure}_{name}": branch.amplitude(measure, j) for measure in MEASURES}
        columns |= {f"{term}_{name}": x for term, x in zip(terms, layout.rows(branch.X, j).T, strict=True)}
    return columns


def _matlab(branch: Branch) -> dict[str, Any]:
    """Variables of the .mat file: the fields of the branch, its measures, and rows counted from 1."""

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

    out: dict[str, Any] = convert(branch) | {"meta": json.dumps(encode(branch.meta, "meta", {}))}
    out["jumps"] = out.pop("jump_records")
    if branch.layout:
        each = range(len(branch.layout.elements))
        rows = {name: [branch.amplitude(name, j) for j in each] for name in MEASURES}
        out["amplitude"] = {name: np.stack(columns, axis=-1) for name, columns in rows.items()}
    return out if branch.stable is None else out | {"stable": branch.stable, "undecided": branch.undecided}
