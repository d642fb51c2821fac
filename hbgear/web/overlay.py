"""Lines and dots on the figure of a page: measured points of a table, tori and backbones."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.analysis.parameter_sensitivity.units import LENGTH, units_of
from hbgear.analysis.quantities.axis_quantities import kind_of
from hbgear.common.text.decoding import bytes_of_file
from hbgear.common.text.symbols import unit_of
from hbgear.continuation.results.branch import Branch
from hbgear.design.fitting.measurement_table import measurements_of
from hbgear.design.fitting.measurements import Measurements
from hbgear.harmonic.models.frequency_units import model_of, same_scales
from hbgear.io.branches.columns import label_of
from hbgear.mechanics.models import Model
from hbgear.plot.branch_sections import sections
from hbgear.web.view import plain

_SWEEPS = ((1, "rising", "triangle-up-open"), (-1, "falling", "triangle-down-open"))


def dots_of(path: str | os.PathLike[str], branches: Sequence[Branch]) -> list[dict[str, Any]]:
    """Return the measured points of a file as `dots` on branches in Omega, whose scales convert the data.

    FileNotFoundError or ValueError is raised if the file does not exist, is not a table of measurements (see
    `read_measurements`), or the branches have no scale for its units.
    """
    if not os.path.exists(path):
        raise FileNotFoundError(f"there is no file '{path}'; give a table of measured points")
    parameter = next((branch.parameter for branch in branches if branch.parameter != "Omega"), None)
    if parameter is not None:
        raise ValueError(
            f"'{path}' has frequencies; a branch is in {parameter}; measured points need branches in Omega"
        )
    data = measurements_of(bytes_of_file(path, "measured points"), os.fspath(path))
    units = {unit_of(label_of(branch, "amplitude")) for branch in branches}
    if len(units) > 1 and data.length:
        raise ValueError(f"'{path}' is in {data.length}, and the curves have amplitudes of several units")
    models = [model.at(branch.parameters_at(0)) for branch in branches if (model := model_of(branch)) is not None]
    return dots(data, os.path.basename(os.fspath(path)), _units(branches), units.pop(), models)


def dots(
    data: Measurements, name: str, units: Mapping[str, float], amplitude: str, models: Sequence[Model] = ()
) -> list[dict[str, Any]]:
    """Return measured points as groups of dots, and measured jumps as vertical lines: one group for each direction.

    ``units`` are the scales of the model, see `units_of`, ``amplitude`` is the unit of the amplitude axis, "1" or ""
    without. ValueError is raised if the data are transmission errors, and the page has displacements that differ from
    them.
    """
    measure = data.measure
    if data.transmission_error and measure == "pp2" and LENGTH in units:
        measure = "dte"
    else:
        for model in models:
            data.check_displacement_of(model)
    Omega, size, _ = data.in_units(units, amplitude)
    jumps = [(x / data.frequency_unit(units), direction) for x, direction, _ in data.jumps]
    directions = {int(d) for d in data.directions} | {direction for _, direction in jumps}
    groups = []
    for direction, word, symbol in _SWEEPS:
        if direction in directions:
            single = directions == {1}
            rows = data.directions == direction
            groups.append(
                {
                    "name": name if single else f"{name}, {word}",
                    "mode": "markers",
                    "file": name,
                    "measure": measure,
                    "element": data.element,
                    "symbol": "circle-open" if single else symbol,
                    "x": plain(Omega[rows]),
                    "y": plain(size[rows]),
                    "jumps": plain([x for x, jump_direction in jumps if jump_direction == direction]),
                }
            )
    return groups


_NAMES = {"tori": "quasi-periodic", "backbone": "backbone"}
"""Name in the legend of each kind of motions."""

_DASHES: dict[bool | str | None, str] = {True: "solid", False: "dash", "undecided": "dot", None: "solid"}
"""Dashes of stable, unstable and undecided tori, and of those of unknown stability."""


def lines_of_motions(branch: Branch, name: str = "") -> list[dict[str, Any]]:
    """Return the lines of tori, one for each stability, or of a backbone over Omega, for all measures and elements.

    The branch is one of `hbgear.analysis.torus`, `two_tones` or `backbone`; without a name the legend has the kind of
    its motions. ``sizes`` are given by measure and element, unknown outside the sections of a line. ValueError is
    raised if it has no Omega, or consists of periodic motions.
    """
    kind = kind_of(branch)
    if kind == "periodic" or (kind == "tori" and branch.parameter != "Omega"):
        raise ValueError("lines are drawn for backbones, and for tori in Omega")
    layout: Any = branch.layout
    x = branch.values if kind == "tori" else branch.tracked["Omega"]
    masks: dict[bool | str | None, Any] = {}
    for (_, stable), first, last in sections(branch, 0):
        masks.setdefault(stable, np.zeros(len(branch), dtype=bool))[first : last + 1] = True
    lines: list[dict[str, Any]] = []
    heights = {
        measure: [branch.amplitude(measure, j) for j in range(len(layout.elements))]
        for measure in ("pp2", "rms", "max", "mean")
    }
    for stable, mask in masks.items():
        sizes = {
            measure: [plain(np.where(mask, y, np.nan)) for y in by_element] for measure, by_element in heights.items()
        }
        dash = "dashdot" if kind == "backbone" else _DASHES[stable]
        text = name or _NAMES[kind]
        lines.append(
            {
                "name": f"{text}, {stable or 'unstable'}" if lines else text,
                "mode": "lines",
                "x": plain(x),
                "sizes": sizes,
                "dash": dash,
                "kind": kind,
                "legend": True,
            }
        )
    return lines


def facts_of_motions(branch: Branch) -> list[list[str]]:
    """Return name and value of the facts on tori or a backbone: kind, range of frequencies, stability, message."""
    rows = [
        ["motions", _NAMES[kind_of(branch)]],
        ["points", f"{len(branch)} points, {branch.parameter} from {branch.values[0]:.6g} to {branch.values[-1]:.6g}"],
    ]
    for name, values in branch.tracked.items():
        rows.append([name.replace("_", " "), f"from {values.min():.6g} to {values.max():.6g}"])
    if branch.multipliers is not None:
        counts = {state: branch.stability.count(state) for state in dict.fromkeys(branch.stability)}
        rows.append(["stability", ", ".join(f"{count} points {state}" for state, count in counts.items())])
    return [*rows, ["end", branch.message]]


def _units(branches: Sequence[Branch]) -> dict[str, float]:
    """Return the scales that hold at every point of every branch; empty if they differ."""
    rows = []
    for branch in branches:
        model = model_of(branch)
        for i in range(len(branch)) if branch.tracked else (0,):
            rows.append({} if model is None else units_of(model.at(branch.parameters_at(i))))
    return same_scales(rows)
