"""Incomplete jump maps as .npz files, from which `jump_map` continues.

The file has the format of a branch, see `npz`: the first response curve, with the other response curves and the fold
curves as its other curves. The entry "map" of its header identifies the map: parameter, span, frequencies.
"""

from __future__ import annotations

import dataclasses
import os
from typing import Any

from hbgear.analysis.fold_curves import equations_of_curve
from hbgear.analysis.jump_maps import JumpMap
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.status import Status
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.models.model_registry import is_description
from hbgear.io.branches.npz import load
from hbgear.mechanics.models import differing_fields


def save_map(jump_map: JumpMap, path: str | os.PathLike[str]) -> None:
    """Write the response curves and fold curves of a jump map to an .npz, completely or not at all.

    ValueError is raised if it has no response curve yet, or the path does not end in .npz.
    """
    if not jump_map.curves:
        raise ValueError("the jump map has no response curve yet, so there is nothing to save")
    curves = [branch for curve in (*jump_map.curves, *jump_map.folds) for branch in curve.curves]
    first, *others = (dataclasses.replace(branch, others=()) for branch in curves)
    meta = {**first.meta, "map": _settings(jump_map.parameter, jump_map.span, jump_map.frequencies)}
    dataclasses.replace(first, meta=meta, others=tuple(others)).save(path)


def read_map(
    path: str | os.PathLike[str],
    problem: HarmonicBalance,
    parameter: str,
    span: tuple[float, float],
    frequencies: tuple[float, float],
) -> JumpMap:
    """Read the part of a jump map that `save_map` wrote, for ``known`` of `jump_map`, with the status ``interrupted``.

    Problem, parameter, its span and the frequencies are those of the map to continue. The result has no arms.
    ValueError is raised if the file cannot be read, or belongs to another map.
    """
    first = load(path)
    expected = {**problem.describe(), "map": _settings(parameter, span, frequencies)}
    differences = {"model": "another model", "balance": "other harmonics or samples", "map": "another map"}
    for name, meaning in differences.items():
        if not _is_same_entry(_plain(first.meta.get(name)), _plain(expected[name])):
            entry = quoted(first.meta.get("map"))
            raise ValueError(
                f"'{path}' is the part of a jump map of {meaning} ({entry}): give another output file, or "
                "remove this one"
            )
    curves = (dataclasses.replace(first, others=()), *first.others)
    responses = _by_value(
        [dataclasses.replace(curve, problem=problem) for curve in curves if curve.parameter == "Omega"], parameter
    )
    folds = tuple(
        dataclasses.replace(curve, problem=equations_of_curve(problem, curve))
        for curve in curves
        if curve.parameter == parameter
    )
    low, high = sorted(map(float, span))
    begin, end = map(float, frequencies)
    return JumpMap(
        parameter, (low, high), folds, (), {}, Status.INTERRUPTED, "read from a file", responses, (begin, end)
    )


def _by_value(curves: list[Branch], parameter: str) -> tuple[Branch, ...]:
    """Return the first response curve at each value of a parameter, with the others at this value in its ``others``."""
    groups: dict[float, list[Branch]] = {}
    for curve in curves:
        groups.setdefault(curve.fixed[parameter], []).append(curve)
    return tuple(dataclasses.replace(first, others=tuple(others)) for first, *others in groups.values())


def _settings(parameter: str, span: tuple[float, float], frequencies: tuple[float, float]) -> dict[str, Any]:
    return {"parameter": parameter, "span": sorted(map(float, span)), "frequencies": list(map(float, frequencies))}


def _is_same_entry(stored: Any, expected: Any) -> bool:
    """Return whether an entry of the header is that of the map; of models only what both descriptions hold."""
    if is_description(stored) and is_description(expected):
        names = ("class", "from")
        return all(stored.get(name) == expected.get(name) for name in names) and not differing_fields(stored, expected)
    return bool(stored == expected)


def _plain(value: Any) -> Any:
    """Return a value with tuples as lists; files contain either."""
    if isinstance(value, dict):
        return {name: _plain(x) for name, x in value.items()}
    return [_plain(x) for x in value] if isinstance(value, list | tuple) else value
