"""A curve in words: what was computed and with what, its special points, jumps and accuracy, as rows of text.

Numbers are written with the digits that hold. The command line, reports and notebooks print these rows.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from hbgear.analysis.jump_landings import landings
from hbgear.common.text.digits import concise, rounded
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.harmonic import model_registry
from hbgear.harmonic.bifurcations.events import named
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.frequency_units import model_of, speeds_at
from hbgear.mechanics.fields import defaults_of, kinds_of
from hbgear.mechanics.series.periodic import Phased

Rows = list[list[str]]


def digits_of(motions: Point | Branch, most: int = 8) -> int:
    """Significant digits of amplitudes that hold, from the error of the harmonics left out, relative to the motion.

    The last digit is of the size of that error. The worst of many motions.
    """
    if motions.layout is None:
        return min(_UNKNOWN, most)
    sizes = np.array([motions.amplitude("rms", j) for j in range(len(motions.layout.elements))])
    with np.errstate(all="ignore"):
        errors = motions.truncation if isinstance(motions, SpecialPoint) else motions.error
        error = float(np.max(np.asarray(errors) / np.max(sizes, axis=0)))
    held = _UNKNOWN if math.isnan(error) else most if error == 0 else math.floor(-math.log10(error)) + 1
    return min(max(held, 3), most)


_UNKNOWN = 6  # digits where nothing is known of the error


def text_at(point: Point, name: str) -> str:
    """The value of a parameter at a point, with the digits that hold; where it is known with its error, with that."""
    value = point.parameters[name]
    if isinstance(point, SpecialPoint) and name == list(point.parameters)[-1] and not math.isnan(point.error):
        return concise(value, point.error)
    return rounded(value, digits_of(point))


def size_text(point: Point, measure: str, element: int | str) -> str:
    """An amplitude with the digits that hold."""
    return rounded(point.amplitude(measure, element), digits_of(point, 5))


def special_table(branch: Branch, measure: str, element: int | str) -> tuple[list[str], Rows]:
    """Headers and rows of the special points of a curve."""
    rows = []
    for point in branch.special:
        place = [text_at(point, name) for name in (branch.parameter, *branch.tracked)]
        place += speeds_in_text(branch, point)
        rows.append(
            [point.label, *place, size_text(point, measure, element), regime_of(point), what_happens(branch, point)]
        )
    headers = ["", branch.parameter, *branch.tracked, *speeds_of(branch, branch[0]), measure, "regime", "what happens"]
    return headers, rows


def jump_table(
    branch: Branch, measure: str, element: int | str, beside: Sequence[Branch] = (), names: Sequence[str] = ()
) -> tuple[list[str], Rows, list[str]]:
    """Headers and rows of the jumps of a curve, and what else integration has to say of them.

    ``beside`` are other traced branches, with their names, on which a jump may land; the table then names the branch.
    The last column says how the landing was decided: as the nearest of the stable motions known, or integrated.
    """
    rows, notes = [], []
    for landing in landings((branch, *beside))[0]:
        jump, where = landing.jump, landing.branch
        speeds = speeds_in_text(branch, jump.before)
        before = size_text(jump.before, measure, element)
        if jump.after is None:
            curves = "these curves" if beside else "this curve"
            after = f"no stable motion on {curves}" if jump.landing == "nearest" else "not periodic"
        else:
            after = size_text(jump.after, measure, element)
            after = f"{names[where - 1]}, {after}" if where else after
        if jump.note:
            notes.append(f"{jump.label}: {jump.note}")
        direction = "increasing" if jump.direction > 0 else "decreasing"
        rows.append(
            [
                jump.label,
                text_at(jump.before, jump.parameter),
                *speeds,
                direction,
                before,
                after,
                jump.landing_description,
            ]
        )
    sizes = [f"{measure} before", f"{measure} after"]
    return ["", branch.parameter, *speeds_of(branch, branch[0]), "while", *sizes, "decided"], rows, notes


def reliability_lines(branch: Branch) -> list[str]:
    """Estimated relative errors of a curve, or its warnings; empty if it was traced without error estimates."""
    if branch.meta.get("trace", {}).get("accuracy") is None:
        return []
    if branch.warnings:
        return [f"warning: {doubt}" for doubt in branch.warnings]
    errors = [p.error / abs(p.parameters[branch.parameter]) for p in branch.special if p.parameters[branch.parameter]]
    points = f"special points {np.nanmax(errors):.0e}, " if errors and not np.isnan(errors).all() else ""
    verdicts = "" if branch.multipliers is None else "; stability determined at all points"
    known = branch.meta.get("stability")
    missing = [f"stability is {known}"] if isinstance(known, str) else []
    return [f"estimated relative error: {points}response {branch.relative_error:.0e}{verdicts}", *missing]


def what_happens(branch: Branch, point: SpecialPoint) -> str:
    """A special point in words, with what it does to stability."""
    text = named(point).meaning
    if point.kind in ("PD", "NS") and branch.stable is not None and 0 < point.index < len(branch) - 1:
        before, after = branch.stable[point.index - 1], branch.stable[point.index + 1]
        text += "" if before == after else "; stability is lost" if before else "; stability is regained"
    where = "" if point.located else f" (only known to lie within {point.interval[0]:.8g} and {point.interval[1]:.8g})"
    return f"{text}{f' ({point.note})' if point.note else ''}{where}"


def regime_of(point: Point) -> str:
    """Regime in words; laws without corners have none."""
    layout = layout_of(point)
    corners = layout is None or any(layout.breakpoints)
    return point.regime_name.replace("_sided", "-sided").replace("_", " ") if corners else "-"


def speeds_of(branch: Branch, point: Point) -> dict[str, float]:
    """Mesh frequency and speed of models that know their units."""
    return speeds_at(model_of(branch), point.parameters)


def speeds_in_text(branch: Branch, point: Point) -> list[str]:
    """`speeds_of` a point with the digits that hold."""
    own = point.parameters.get("Omega", 0.0)
    error = point.error / own if isinstance(point, SpecialPoint) and branch.parameter == "Omega" else math.nan
    return [
        rounded(value, digits_of(point, 6)) if math.isnan(error) else concise(value, abs(error * value), 6)
        for value in speeds_of(branch, point).values()
    ]


def facts_of(branch: Branch, measure: str) -> Iterator[tuple[str, str]]:
    """What there is to say of a branch, name and text."""
    stable, layout = branch.stable, branch.layout
    balance = branch.meta.get("balance")
    settings = balance if isinstance(balance, dict) else {}
    yield "model", described(branch)
    yield "settings", ", ".join(f"{name} = {text_of(value)}" for name, value in settings.items() if value is not None)
    yield "held", ", ".join(f"{name} = {branch.fixed[name]:.6g}" for name in ("Omega",) if name in branch.fixed)
    yield "curve", f"{branch.parameter} from {branch.values[0]:.6g} to {branch.values[-1]:.6g}, {len(branch)} points"
    yield "status", f"{branch.status}: {branch.message}"
    far = [f"{branch.parameter} = {value:.9g} (behind the {end} point)" for end, value in branch.asymptotes.items()]
    yield "asymptotes", ", ".join(far)
    if stable is None:
        yield "stability", "not computed"
    else:
        counts = Counter(branch.stability)
        known = [f"{counts[name]} {name}" for name in ("unstable", "undecided", "unknown") if counts[name]]
        yield "stability", ", ".join([f"{counts['stable']} points stable", *known])
    yield "regimes", ", ".join(dict.fromkeys(regime_of(branch[i]) for i in range(len(branch))))
    for j, name in enumerate(layout.elements if layout else ()):
        size = branch.amplitude(measure, j)
        top = branch.values[int(np.nanargmax(size))]
        yield f"{measure} of {name}", f"{size.min():.5g} to {size.max():.5g} (at {branch.parameter} = {top:.6g})"
    yield "worst residual", f"{np.nanmax(branch.residual):.1e} of the forces"
    if not np.isnan(branch.error).all():
        yield "worst error", f"{np.nanmax(branch.error):.1e} rms of the motion, estimated from the harmonics left out"
    yield "Newton steps", f"{branch.iterations.mean():.2f} per point"
    yield "hbgear", str(branch.meta.get("hbgear", "unknown"))


def described(branch: Branch) -> str:
    """Model with the fields that differ from its defaults."""
    model = model_of(branch)
    about: Any = branch.meta.get("model")
    if model is None:
        name = about["class"] if model_registry.is_description(about) else "unknown"
        source = about.get("from") if model_registry.is_description(about) else None
        return f"{name} (not one of hbgear models{f'; from {source}' if isinstance(source, str) else ''})"
    usual, values = defaults_of(type(model)), {name: getattr(model, name) for name in kinds_of(type(model))}
    changed = [f"{f}={text_of(x)}" for f, x in values.items() if f not in usual or not _same(x, usual[f])]
    return f"{type(model).__name__}({', '.join(changed)}){'' if changed else ', all defaults'}"


def _same(value: Any, usual: Any) -> bool:
    """Whether a value is the usual one; a matrix is equal to none."""
    return not hasattr(value, "shape") and bool(value == usual)


def text_of(value: Any) -> str:
    """A value as --set would take it; a part of a machine by its name, a matrix by its size."""
    if isinstance(value, list | tuple):
        return f"({','.join(map(text_of, value))}{',' * (len(value) == 1)})"
    if hasattr(value, "shape"):
        return " x ".join(map(str, value.shape))
    if dataclasses.is_dataclass(value) and not isinstance(value, Phased):
        return str(getattr(value, "name", "") or type(value).__name__)
    return f"{value:g}" if isinstance(value, float) else str(value)
