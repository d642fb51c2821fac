"""The points of a curve as columns with meaning and unit, and a summary of the curve in a few lines of text.

Parameters, speeds in r/min and Hz, special points and jumps, stability, accuracy, and for each element its impact
regime, measures of amplitude and coefficients: the same columns in .csv files, data frames and data sets.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.analysis.summary import describe_changes
from hbgear.common.text.symbols import unit_of, without_unit
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint, name_of_regime
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.harmonic.models.frequency_units import MESH, PINION, model_of, speeds_at
from hbgear.mechanics.series.measures import default_measures


@dataclass(frozen=True, eq=False)
class Column:
    """A column: values at the points of a curve, with meaning and unit.

    Attributes
    ----------
    values : array_like, shape (P,)
        One value for each point.
    meaning : str
        Description in words.
    unit : str
        Unit: "1" for a dimensionless number, "" where it is unknown.
    element : str
        Name of the element that the values belong to; "" for a property of the whole curve.
    key : str
        Name of the column without the name of the element; "" for a property of the whole curve.
    """

    values: Any
    meaning: str
    unit: str = ""
    element: str = ""
    key: str = ""


def columns_of(branch: Branch) -> dict[str, Column]:
    """Return the columns of one curve by name; columns of an element end in its name.

    ``special_value`` and ``special_error`` are the parameter of a special point, more accurate than in its row, and its
    error. ``landing`` states how the landing of a jump was determined. ``stable`` is 1, 0 or, if undecided, empty.
    """
    layout = layout_of(branch)
    columns = {name: _parameter(branch, name, values) for name, values in _varied(branch).items()}
    columns |= speeds_of(branch)
    columns |= _special(branch)
    if branch.multipliers is not None:
        stable_codes = [{"stable": 1, "unstable": 0}.get(state, "") for state in branch.stability]
        largest = np.abs(branch.multipliers).max(axis=-1, initial=0.0)
        columns["stable"] = Column(stable_codes, "1 stable, 0 unstable, empty where undecided or unknown")
        columns["multiplier_max"] = Column(largest, "largest modulus of the Floquet multipliers", "1")
    unit = _amplitude(layout)[1]
    columns["residual"] = Column(branch.residual, "residual relative to the forces", "1")
    columns["iterations"] = Column(branch.iterations, "Newton iterations", "1")
    columns["error"] = Column(branch.error, "estimated error of the motion, rms", unit)
    if layout is None:
        return columns | {f"X{i}": Column(x, f"unknown {i}") for i, x in enumerate(branch.X.T)}
    for j, name in enumerate(layout.elements):
        columns |= {f"{column.key}_{name}": column for column in _element(branch, layout, j)}
    return columns


def about(branch: Branch) -> dict[str, str]:
    """Return a description of a curve by name: model, settings, fixed parameters with units, status and message."""
    balance = branch.meta.get("balance")
    settings = balance if isinstance(balance, dict) else {}
    texts = {
        "hbgear": str(branch.meta.get("hbgear", "unknown")),
        "model": describe_changes(branch),
        "settings": ", ".join(f"{name} = {value}" for name, value in settings.items() if value is not None),
    }
    for name, value in branch.fixed.items():
        label = label_of(branch, name)
        meaning = without_unit(label)
        texts[name] = f"{value!r}{bracketed(unit_of(label))}{f' ({meaning})' if meaning != name else ''}"
    texts["status"] = f"{branch.status}: {branch.message}"
    return {name: " ".join(text.split()) for name, text in texts.items() if text}


def bracketed(unit: str) -> str:
    """Return a unit in the brackets that end a label."""
    return {"": "", "1": " [-]"}.get(unit, f" [{unit}]")


def label_of(branch: Branch, name: str) -> str:
    """Return the label of a parameter, its name if the model has none."""
    layout = layout_of(branch)
    labels = layout.labels if layout else getattr(model_of(branch), "labels", {})
    return str(labels.get(name, name))


def _varied(branch: Branch) -> dict[str, Any]:
    return {branch.parameter: branch.values, **branch.tracked}


def _parameter(branch: Branch, name: str, values: Any) -> Column:
    label = label_of(branch, name)
    return Column(values, without_unit(label), unit_of(label))


def speeds_of(branch: Branch) -> dict[str, Column]:
    """Return mesh frequency and speed of the pinion, if the model has scales."""
    model = model_of(branch)
    rows = [speeds_at(model, branch.parameters_at(i)) for i in range(len(branch))] if model is not None else []
    names = {MESH: ("mesh_Hz", "mesh frequency", "Hz"), PINION: ("pinion_rpm", "speed of the pinion", "r/min")}
    return {
        column: Column(np.array([row[name] for row in rows]), meaning, unit)
        for name, (column, meaning, unit) in names.items()
        if rows and name in rows[0]
    }


def _special(branch: Branch) -> dict[str, Column]:
    """Return the columns of special points, their errors and bounds, and of landings."""
    points = {point.index: point for point in branch.special}
    decided = {jump.label: jump.landing_description for jump in branch.jumps()}
    rows = [points.get(i) for i in range(len(branch))]
    unit = unit_of(label_of(branch, branch.parameter))
    bounds = {i: p.certificate["Omega"] for i, p in points.items() if p.certificate}

    def cells(value: Callable[[SpecialPoint], Any]) -> list[Any]:
        return ["" if p is None else value(p) for p in rows]

    columns = {
        f"certified_{end}": Column(
            [bounds[i][k] if i in bounds else "" for i in range(len(branch))],
            f"proved {end} bound of Omega of the special point",
            "1",
        )
        for k, end in enumerate(("lower", "upper") if bounds else ())
    }
    value_meaning = f"{branch.parameter} of the special point, more accurate than the point"
    landing_meaning = "how the landing of the jump was determined"
    return columns | {
        "special": Column(cells(lambda p: p.label), "label of the special point"),
        "special_value": Column(cells(lambda p: p.parameters[branch.parameter]), value_meaning, unit),
        "special_error": Column(cells(lambda p: p.error), "estimated error of special_value", unit),
        "landing": Column(cells(lambda p: decided.get(p.label, "")), landing_meaning),
    }


def _amplitude(layout: Layout | None) -> tuple[str, str]:
    """Return symbol and unit of the motion of an element."""
    label = (layout.labels if layout else {}).get("amplitude", "")
    return without_unit(label) or "gap", unit_of(label)


def _element(branch: Branch, layout: Layout, j: int) -> Iterator[Column]:
    """Yield the columns of an element: its regime, measures and coefficients."""
    name, (symbol, unit) = layout.elements[j], _amplitude(layout)
    yield Column(
        [name_of_regime(codes[j : j + 1], layout) for codes in branch.regime], "impact regime", "", name, "regime"
    )
    for measure, entry in default_measures().items():
        measure_unit = entry.unit_for(unit)
        values = branch.amplitude(measure, j)
        yield Column(values, f"{entry.text} of {symbol}", "1" if measure_unit == "-" else measure_unit, name, measure)
    for term, x in zip(terms_of(layout), layout.rows(branch.X, j).T, strict=True):
        yield Column(x, f"Fourier coefficient {term} of {symbol}", unit, name, term)


def terms_of(layout: Layout) -> list[str]:
    """Return the names of the coefficients of an element."""
    return ["a0", *(f"{letter}{k + 1}" for k in range(layout.harmonics) for letter in "ab")]
