"""Data of a page about a branch, as numbers and texts of JSON.

Amplitudes are given at each point. Coefficients and multipliers are 32-bit arrays in base64, from which the page draws
the motion at any point. Numbers of tables are texts with the verified digits.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hbgear.analysis.jump_landings import Landing, landings
from hbgear.analysis.quantities.axis_quantities import Ordinate
from hbgear.analysis.quantities.engineering_quantities import OTHER_NAMES, are_meshes, problem_along, with_known_problem
from hbgear.analysis.quantities.length_units import in_figure
from hbgear.analysis.summary import (
    certified_header,
    certified_text,
    jump_table,
    message_of,
    reliability_lines,
    special_table,
    summary_facts,
)
from hbgear.common.arrays import Array
from hbgear.common.text.symbols import in_html, unit_of, without_unit
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.harmonic.bifurcations.events import named
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.harmonic.models.frequency_units import MESH, PINION, common_scales, length_scale, model_of
from hbgear.io.branches.columns import bracketed, label_of
from hbgear.mechanics.series.measures import default_measures, motion_text
from hbgear.plot.branch_sections import HEADROOM, bounded, sections
from hbgear.plot.style import legend_entry

_DRAWN_DIGITS = 7
"""Significant digits of drawn numbers."""


def views(branches: Sequence[Branch], names: Sequence[str], with_tables: bool = True) -> list[dict[str, Any]]:
    """Return the data of each branch, with other branches of its range; jumps may land on any of them.

    See `view` and `tables`. ValueError is raised if a branch does not consist of periodic motions.
    """
    curves, labels = [], []
    for branch, name in zip(branches, names, strict=True):
        for number, curve in enumerate(branch.curves, 1):
            curves.append(with_known_problem(curve))
            labels.append(f"{name}, branch {number}" if branch.others else name)
    for curve, name in zip(curves, labels, strict=True):
        if layout_of(curve) is None or not len(curve):
            raise ValueError(f"{name} is not a branch of periodic motions; a page shows only these")
    return [
        view(curve, name, curve_landings, with_tables) | (tables(curve, curves, labels) if with_tables else {})
        for curve, name, curve_landings in zip(curves, labels, landings(curves), strict=True)
    ]


def view(branch: Branch, name: str, landed: Sequence[Landing] = (), with_forces: bool = False) -> dict[str, Any]:
    """Return the drawn data of one branch with a name and its jumps; the page shows r/min and um if scales are known.

    With ``with_forces`` it has dynamic factors and forces, whose computation takes time.
    """
    layout = layout_of(branch)
    assert layout is not None
    elements = range(len(layout.elements))
    units = common_scales([branch])
    length = length_scale(model_of(branch), branch.parameters_at(0)) if units else None
    quantities = _quantities(branch, elements, with_forces) if length else {}
    axes = {name: entry.label for name, entry in quantities.items()}
    label = label_of(branch, branch.parameter)
    motion = layout.labels.get("amplitude") or motion_text({})
    Omega = [branch.parameters_at(i).get("Omega", math.nan) for i in range(len(branch))]
    return {
        "name": name,
        "parameter": branch.parameter,
        "label": "Ω" if label == "Omega" else in_html(label),
        "motion": in_html(motion).removesuffix(" [-]"),
        "motionText": without_unit(motion),
        "unit": unit_of(motion),
        "x": plain(branch.values, 10),
        "Omega": plain(Omega, 10),
        "scales": {
            "Hz": units.get(MESH),
            "rpm": units.get(PINION),
            "um": 1e6 * length if length else None,
            "rate": getattr(getattr(model_of(branch), "scales", None), "frequency", None) if length else None,
        },
        "elements": list(layout.elements),
        "meshes": are_meshes(model_of(branch), layout),
        "breakpoints": [list(points) for points in layout.breakpoints],
        "harmonics": layout.harmonics,
        "nu": layout.nu,
        "amplitudes": {m: [plain(branch.amplitude(m, j)) for j in elements] for m in _measures()}
        | {name: [plain(values) for values in entry.values] for name, entry in quantities.items()},
        "measures": {name: without_unit(label) for name, label in axes.items()} | _measures(),
        "axes": axes,
        "sections": [
            [[regime, _stability(s), first, last] for (regime, s), first, last in sections(branch, j)] for j in elements
        ],
        "stability": branch.stability,
        "regimes": branch.regimes,
        "coefficients": packed(layout.spread(branch.X).reshape(len(branch), -1)),
        "multipliers": None if branch.multipliers is None else multipliers(branch),
        "special": _special(branch, layout, quantities),
        "jumps": _jumps(layout, landed, branch, quantities),
        "asymptotes": list(branch.asymptotes.values()),
        "top": _tops(branch, elements, quantities) if branch.asymptotes else None,
        "status": str(branch.status),
        "message": message_of(branch),
    }


def tables(branch: Branch, curves: Sequence[Branch], names: Sequence[str]) -> dict[str, Any]:
    """Return the texts and tables of one branch; its jumps may land on any of the curves with their names."""
    others = [(name, curve) for curve, name in zip(curves, names, strict=True) if curve is not branch]
    headers, rows, notes = jump_table(branch, others=others)
    special_headers, special_rows = special_table(branch)
    return {
        "parameters": parameter_rows(branch),
        "facts": [[in_figure(name), text] for name, text in summary_facts(branch) if text],
        "specialTable": [[in_figure(header) for header in special_headers], special_rows],
        "jumpTable": [[in_figure(header) for header in headers], rows],
        "notes": notes,
        "reliability": reliability_lines(branch),
    }


def parameter_rows(branch: Branch) -> list[list[str]]:
    """Return name, value, unit and meaning of the fixed parameters."""
    rows = []
    for name, value in branch.fixed.items():
        label = label_of(branch, name)
        meaning = without_unit(label)
        rows.append([name, f"{value:.10g}", bracketed(unit_of(label)).strip(" []"), "" if meaning == name else meaning])
    return rows


def plain(values: Any, digits: int = _DRAWN_DIGITS) -> list[float | None]:
    """Return numbers for JSON, rounded to significant digits, with nan as null."""
    return [float(f"{x:.{digits}g}") if math.isfinite(x) else None for x in np.asarray(values, dtype=float).tolist()]


def packed(array: Array) -> str:
    """Return an array in row-major order as little-endian 32-bit numbers in base64."""
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode()


def multipliers(branch: Branch) -> dict[str, Any]:
    """Return real and imaginary parts of the multipliers, without those that are zero at all points.

    They are `packed` arrays, with the number of multipliers and the largest modulus at each point.
    """
    assert branch.multipliers is not None
    mu = branch.multipliers
    nonzero = np.nanmax(np.abs(np.nan_to_num(mu)), axis=0, initial=0.0) > 1e-9
    mu = mu[:, nonzero] if nonzero.any() else mu[:, :1]
    largest = np.abs(mu).max(axis=1, initial=0.0)
    return {"count": mu.shape[1], "real": packed(mu.real), "imag": packed(mu.imag), "largest": plain(largest)}


def _measures() -> dict[str, str]:
    """Return the descriptions of the measures of a page by name; axes have the unit of the motion."""
    return {name: entry.text for name, entry in default_measures(same_unit=True).items()}


class _Quantity(NamedTuple):
    """An engineering quantity: label of its axis, and for each element its values and its ordinate."""

    label: str
    values: list[Array]
    heights: list[Ordinate]

    def at(self, point: Point, branch: Branch) -> list[float | None]:
        """Return the values of a point for each element."""
        try:
            return plain([height.at(point, branch) for height in self.heights])
        except ValueError:  # the point of a file without its problem
            return [None] * len(self.heights)


_Quantities = Mapping[str, _Quantity]


def _quantities(branch: Branch, elements: Sequence[int], with_forces: bool) -> dict[str, _Quantity]:
    """Return engineering quantities by name; empty without the model."""
    try:
        problem = problem_along(branch)
    except ValueError:
        return {}
    branch = replace(branch, problem=problem)
    quantities = {}
    is_mesh = any(are_meshes(problem.model, problem.layout))
    names = ("dynamic factor" if is_mesh else OTHER_NAMES["dynamic factor"], "force") if with_forces else ()
    for name in ("dte", *names) if is_mesh else names:
        heights = [Ordinate(name, j) for j in elements]
        with suppress(ValueError):  # no static force
            values = [height.along(branch) for height in heights]
            quantities[name] = _Quantity(heights[0].label(branch), values, heights)
    return quantities


def _tops(branch: Branch, elements: Sequence[int], quantities: _Quantities) -> dict[str, list[float]]:
    """Return upper limits of the axes of a branch that goes to infinity, by measure and element."""
    sizes = {m: [branch.amplitude(m, j) for j in elements] for m in _measures()}
    sizes |= {name: entry.values for name, entry in quantities.items()}
    return {
        m: [HEADROOM * bounded(branch, sizes_of_element) for sizes_of_element in by_element]
        for m, by_element in sizes.items()
    }


def _stability(stable: bool | str | None) -> str:
    return {True: "stable", False: "unstable", None: "unknown"}.get(stable, str(stable))  # type: ignore[arg-type]


def _sizes(layout: Layout, points: Sequence[Point]) -> list[dict[str, list[float | None]]]:
    """Return the measures of motions, of every element."""
    if not points:
        return []
    X = [(layout_of(point) or layout).spread(point.X) for point in points]
    width = max(rows.shape[1] for rows in X)  # special points may have more harmonics than their curve
    padded = np.array([np.pad(rows, ((0, 0), (0, width - rows.shape[1]))) for rows in X])
    sizes = {m: layout.measure_rows(m, padded) for m in _measures()}
    return [{m: plain(rows_of_measure[i]) for m, rows_of_measure in sizes.items()} for i in range(len(points))]


def _special(branch: Branch, layout: Layout, quantities: _Quantities) -> list[dict[str, Any]]:
    """Return the special points of a curve for the page."""
    entries = []
    for point, amplitudes in zip(branch.special, _sizes(layout, branch.special), strict=True):
        sizes = amplitudes | {name: entry.at(point, branch) for name, entry in quantities.items()}
        event = named(point)
        entries.append(
            {
                "label": point.label,
                "kind": point.kind,
                "meaning": legend_entry(event),
                "marker": event.marker,
                "index": point.index,
                "x": point.parameters[branch.parameter],
                "sizes": sizes,
                "stability": point.stability,
                "certified": f"{certified_header(branch)}: {certified_text(branch, point)}"
                if point.certificate
                else "",
            }
        )
    return entries


def _jumps(layout: Layout, landed: Sequence[Landing], branch: Branch, quantities: _Quantities) -> list[dict[str, Any]]:
    """Return the jumps of a curve for the page, with the sizes before and after."""

    def heights(point: Point) -> dict[str, list[float | None]]:
        return {name: entry.at(point, branch) for name, entry in quantities.items()}

    before = _sizes(layout, [landing.jump.before for landing in landed])
    entries = []
    for landing, size in zip(landed, before, strict=True):
        jump = landing.jump
        end = None if jump.after is None else layout_of(jump.after)
        entries.append(
            {
                "label": jump.label,
                "x": jump.value,
                "direction": jump.direction,
                "before": size | heights(jump.before),
                "landing": jump.landing_description,
                "after": None
                if end is None or jump.after is None
                else _sizes(end, [jump.after])[0] | heights(jump.after),
            }
        )
    return entries
