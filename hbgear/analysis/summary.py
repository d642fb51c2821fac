"""Summaries of branches as text: model, settings, special points, jumps and reliability.

Numbers are printed with their significant digits. The command line, reports and notebooks use these texts.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from decimal import Decimal
from typing import Any

import numpy as np

from hbgear.analysis.jump_landings import landings
from hbgear.analysis.quantities.axis_quantities import SPEED_LABEL, Abscissa, Ordinate, usual_measure
from hbgear.common.text.digits import concise, outward, rounded
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.reliability import branch_warnings, special_point_size
from hbgear.harmonic.bifurcations.events import named
from hbgear.harmonic.equations.layout import STICK_REGIME, layout_of
from hbgear.harmonic.models import model_registry
from hbgear.harmonic.models.frequency_units import model_of, speeds_at
from hbgear.mechanics.fields import defaults_of, kinds_of
from hbgear.mechanics.models import Model
from hbgear.mechanics.series.periodic import Phased

Rows = list[list[str]]
"""Rows of a table: the cells of each row as text."""


def digits_of(motions: Point | Branch, limit: int = 8) -> int:
    """Return the number of significant digits of amplitudes, from the truncation error relative to the motion.

    The last digit has the size of the error. For a branch the point with the largest relative error decides. There are
    at least 3 digits where the error is known, and at most ``limit``.
    """
    if motions.layout is None:
        return min(DIGITS_WITHOUT_ERROR, limit)
    sizes = np.array([motions.amplitude("rms", j) for j in range(len(motions.layout.elements))])
    with np.errstate(all="ignore"):
        errors = motions.truncation if isinstance(motions, SpecialPoint) else motions.error
        error = float(np.max(np.asarray(errors) / np.max(sizes, axis=0)))
    return _digits_with_error(error, limit)


def _digits_with_error(error: float, limit: int) -> int:
    """Return the number of significant digits of a value with a relative error, nan if it is unknown."""
    digits = DIGITS_WITHOUT_ERROR if math.isnan(error) else limit if error == 0 else math.floor(-math.log10(error)) + 1
    return min(max(digits, 3), limit)


DIGITS_WITHOUT_ERROR = 6
"""Significant digits that are printed if the error is unknown."""


def text_at(point: Point, name: str) -> str:
    """Return the value of a parameter at a point with its significant digits.

    The error of a special point follows in parentheses, in units of the last digit.
    """
    value = point.parameters[name]
    if isinstance(point, SpecialPoint) and name == list(point.parameters)[-1] and not math.isnan(point.error):
        return concise(value, point.error)
    return rounded(value, digits_of(point))


def size_text(point: Point, height: Ordinate, branch: Branch) -> str:
    """Return the value of a quantity at a point with its significant digits, at most five."""
    return rounded(height.at(point, branch), digits_of(point, 5))


def position_headers(branch: Branch, dimensionless: bool = False) -> list[str]:
    """Return the headers of the parameter of a branch and of the speeds; Omega is left out if speeds are known."""
    speeds = list(speeds_of(branch, branch[0]))
    headers = [] if speeds and branch.parameter == "Omega" and not dimensionless else [branch.parameter]
    headers += [name for name in branch.tracked if dimensionless or not speeds or name != "Omega"]
    return [*headers, *(reversed(speeds) if not dimensionless else speeds)]


def position_texts(branch: Branch, point: Point, dimensionless: bool = False) -> list[str]:
    """Return the cells of `position_headers` at a point, with their significant digits."""
    speeds = dict(zip(speeds_of(branch, point), speeds_in_text(branch, point), strict=True))
    texts = {name: text_at(point, name) for name in point.parameters} | {
        name: rounded(point.parameters[name], min(digits_of(point), _digits_with_error(error, 8)))
        for name, error in branch.unknown_errors.items()
    }
    return [speeds[name] if name in speeds else texts[name] for name in position_headers(branch, dimensionless)]


def special_table(
    branch: Branch, measure: str | None = None, element: int | str = 0, dimensionless: bool = False
) -> tuple[list[str], Rows]:
    """Return headers and rows of the table of the special points of a branch; the measure is one of `Ordinate`.

    With ``dimensionless`` Omega and the units of the model are shown although the model has scales.
    """
    height = Ordinate(measure or usual_measure(branch, dimensionless, element), element, dimensionless=dimensionless)
    branch = height.prepared(branch)
    rows = [
        [
            point.label,
            *position_texts(branch, point, dimensionless),
            size_text(point, height, branch),
            regime_of(point),
            event_description(branch, point),
        ]
        for point in branch.special
    ]
    headers = ["", *position_headers(branch, dimensionless), height.header(branch), "regime", "event"]
    if any(point.certificate for point in branch.special):
        headers.append(certified_header(branch, dimensionless))
        for row, point in zip(rows, branch.special, strict=True):
            row.append(certified_text(branch, point, dimensionless))
    return headers, rows


UNCERTAIN_LANDING = (
    "several motions are stable, so the landing is uncertain; integration in time finds it: hbgear jumps FILE "
    "--landing integrate"
)
"""Note of jumps whose landing is the nearest of several motions: of 26 jumps of 40 random spur pairs 8 went to another
motion, at all ratios of the distances, and none of the 134 jumps with a single stable motion."""


def certified_header(branch: Branch, dimensionless: bool = False) -> str:
    """Return the header of the values of `certified_text`."""
    speeds = [] if dimensionless else list(speeds_of(branch, branch[0]))
    return f"certified {speeds[-1] if speeds else 'Omega'}"


def certified_text(branch: Branch, point: SpecialPoint, dimensionless: bool = False) -> str:
    """Return the certified enclosure of the speed of a special point, or of Omega; empty without a certificate.

    It consists of two decimals, rounded outward. A speed is the product of the enclosure and the scale of the model.
    """
    if not point.certificate:
        return ""
    return " to ".join(certified_bounds(branch, point, point.certificate["Omega"], dimensionless))


def certified_bounds(
    branch: Branch, point: Point, Omega: Sequence[str], dimensionless: bool = False
) -> tuple[str, str]:
    """Return the bounds of Omega at a point in the quantity of `certified_header`, rounded outward to 17 digits."""
    speeds = [] if dimensionless else list(speeds_of(branch, point).values())
    scale = Decimal(speeds[-1] / point.parameters["Omega"]) if speeds else Decimal(1)
    return outward(Decimal(Omega[0]) * scale, Decimal(Omega[1]) * scale)


def jump_table(
    branch: Branch,
    measure: str | None = None,
    element: int | str = 0,
    others: Sequence[tuple[str, Branch]] = (),
    dimensionless: bool = False,
) -> tuple[list[str], Rows, list[str]]:
    """Return headers and rows of the table of the jumps of a branch, and notes on their landings.

    A jump may also land on one of ``others``, names and branches; the table then states the name of the branch. The
    last column states how the landing was chosen: the nearest known stable motion, or by integration. The other
    arguments are those of `special_table`.
    """
    height = Ordinate(measure or usual_measure(branch, dimensionless, element), element, dimensionless=dimensionless)
    rows, notes, uncertain = [], [], []
    branches = [height.prepared(curve) for curve in (branch, *(curve for _, curve in others))]
    branch = branches[0]
    for landing in landings(branches)[0]:
        jump, number = landing.jump, landing.branch
        if jump.after is None:
            curves = "these curves" if others else "this curve"
            after = f"no stable motion on {curves}" if jump.landing == "nearest" else "not periodic"
        else:
            after = size_text(jump.after, height, branches[number or 0])
            after = f"{others[number - 1][0]}, {after}" if number else after
        if jump.note:
            notes.append(f"{jump.label}: {jump.note}")
        direction = "increasing" if jump.direction > 0 else "decreasing"
        rows.append(
            [
                jump.label,
                *position_texts(branch, jump.before, dimensionless),
                direction,
                size_text(jump.before, height, branch),
                after,
                jump.landing_description,
            ]
        )
        if jump.is_uncertain:
            uncertain.append(jump.label)
    if uncertain:
        notes.append(f"{', '.join(uncertain)}: {UNCERTAIN_LANDING}")
    header = height.header(branch)
    name, bracket, unit = header.partition(" [")
    sizes = [f"{name} {moment}{bracket}{unit}" for moment in ("before", "after")]
    return ["", *position_headers(branch, dimensionless), "sweep", *sizes, "landing"], rows, notes


_LEAVING = {"PD": ("motions of twice the period", "switch"), "NS": ("quasi-periodic motions", "torus")}
"""Motions that leave at special points of a kind, and the command that traces them."""


def leaving_lines(branch: Branch) -> list[str]:
    """Return a line for each kind of special points at which a stable section ends without a jump.

    Motions of twice the period or quasi-periodic motions leave there. A sweep continues on them if they are stable.
    """
    if branch.stable is None:
        return []
    jumps, stable, last = {jump.label for jump in branch.jumps()}, np.asarray(branch.stable, bool), len(branch) - 1
    lines = []
    for kind, (motions, command) in _LEAVING.items():
        labels = [
            point.label
            for point in branch.special
            if point.kind == kind
            and point.label not in jumps
            and 0 < point.index < last
            and stable[point.index - 1] != stable[point.index + 1]
        ]
        if labels:
            text = f"stability also ends at {', '.join(labels)}, where {motions} leave"
            lines.append(text if kind == "NS" and not _has_tori(branch) else f"{text}: hbgear {command} FILE LABEL")
    return lines


def _has_tori(branch: Branch) -> bool:
    """Return whether tori of the model of a branch can be computed; True if its problem is unknown."""
    from hbgear.harmonic.harmonic_balance import HarmonicBalance

    if not isinstance(branch.problem, HarmonicBalance):
        return True
    evaluator = branch.problem.compiled({})
    return not (evaluator.sliders or evaluator.damped or evaluator.structure.constrained)


def reliability_lines(branch: Branch, dimensionless: bool = False) -> list[str]:
    """Return the estimated relative errors of a branch in one line, followed by a line for each of its warnings.

    The first line also has the number of points with determined stability; the others start with "warning:". Empty if
    no errors are known. A branch that was traced without errors of special points, such as one of tori, has the errors
    of its points. ``dimensionless`` warnings state Omega although the model has scales.
    """
    if branch.meta.get("trace", {}).get("accuracy") is None and math.isnan(branch.relative_error):
        return []
    errors = [f"special points {error}" for error in _special_point_error(branch)]
    if not math.isnan(branch.relative_error):
        errors.append(f"response {branch.relative_error:.0e}")
    errors += [
        f"{name} {'unknown' if math.isnan(error) else f'{error:.0e}'}" for name, error in branch.unknown_errors.items()
    ]
    texts = [f"Estimated relative error: {', '.join(errors) or 'unknown'}", *_determined_stability(branch)]
    return [
        "; ".join(texts),
        *(f"warning: {in_speeds(branch, warning, dimensionless)}" for warning in branch_warnings(branch)),
    ]


def _special_point_error(branch: Branch) -> Iterator[str]:
    """Yield the largest relative error of the special points, with the number of errors that are unknown."""
    errors = np.array([point.error / special_point_size(branch, point) for point in branch.special])
    finite = np.isfinite(errors)  # a point in an interval only has the error inf
    unknown = int((~finite).sum())
    if unknown < len(errors):
        yield f"{errors[finite].max():.0e}{f' ({unknown} of {len(errors)} unknown)' if unknown else ''}"
    elif unknown:
        yield "unknown"


def _determined_stability(branch: Branch) -> Iterator[str]:
    """Yield the number of points whose stability is determined, or the reason why it is not available."""
    reason = branch.meta.get("stability")
    if isinstance(reason, str):
        yield f"stability is {reason}"
    elif branch.multipliers is not None and len(branch):
        determined = sum(state in ("stable", "unstable") for state in branch.stability)
        points = "all" if determined == len(branch) else f"{determined} of {len(branch)}"
        yield f"stability determined at {points} points"


def event_description(branch: Branch, point: SpecialPoint) -> str:
    """Return the meaning of a special point, with the change of stability."""
    text = named(point).meaning
    if point.kind in ("PD", "NS") and branch.stable is not None and 0 < point.index < len(branch) - 1:
        before, after = branch.stable[point.index - 1], branch.stable[point.index + 1]
        text += "" if before == after else "; stability is lost" if before else "; stability is regained"
    first, last = values_text(branch, list(point.interval))
    if point.kind == "SM" and math.isnan(point.error):
        text += "; more harmonics move this end, its error is unknown"
    interval_note = "" if point.located else f" (only known to lie within {first} and {last})"
    return f"{text}{f' ({point.note})' if point.note else ''}{interval_note}"


def regime_of(point: Point) -> str:
    """Return the regime of a point as words; "-" if no law has contacts or friction."""
    layout = layout_of(point)
    has_friction = bool(point.regime.max(initial=0) >= STICK_REGIME)
    has_regimes = layout is None or any(layout.breakpoints) or bool(layout.edged) or has_friction
    return point.regime_name.replace("_sided", "-sided").replace("_", " ") if has_regimes else "-"


def speeds_of(branch: Branch, point: Point) -> dict[str, float]:
    """Return the mesh frequency [Hz] and the pinion speed [r/min] at a point; empty if the model has no units."""
    return speeds_at(model_of(branch), point.parameters)


def speeds_in_text(branch: Branch, point: Point) -> list[str]:
    """Return the values of `speeds_of` with their significant digits."""
    Omega = point.parameters.get("Omega", 0.0)
    error = point.error / Omega if isinstance(point, SpecialPoint) and branch.parameter == "Omega" else math.nan
    digits = min(digits_of(point, 6), _digits_with_error(branch.unknown_errors.get("Omega", 0.0), 6))
    return [
        rounded(value, digits) if math.isnan(error) else concise(value, abs(error * value), 6)
        for value in speeds_of(branch, point).values()
    ]


def title_of(branch: Branch) -> str:
    """Return the model of a branch in words, with the parameters that are no defaults: "Duffing, F = 0.2"."""
    model = model_of(branch)
    if model is None:
        return describe_changes(branch)
    if model.title:
        return model.title
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(model).__name__).replace("_", " ")
    numbers = [f"{name} = {_numbers_text(value)}" for name, value in _changes(model).items() if _is_short(value)]
    return ", ".join([words[:1].upper() + words[1:].lower(), *numbers])


def values_text(branch: Branch, values: Sequence[float], dimensionless: bool = False, digits: int = 6) -> list[str]:
    """Return values of the parameter of a branch as text: "9000 r/min", or "Omega = 0.8" without physical units."""
    axis = Abscissa([branch], dimensionless)
    if axis.label == SPEED_LABEL:
        return [f"{axis.scale * value:.6g} r/min" for value in values]
    return [f"{branch.parameter} = {value:.{digits}g}" for value in values]


def message_of(branch: Branch, dimensionless: bool = False) -> str:
    """Return the message of a branch, with speeds instead of values of Omega if the model has scales."""
    return in_speeds(branch, branch.message, dimensionless)


def in_speeds(branch: Branch, text: str, dimensionless: bool = False) -> str:
    """Return a text about a branch, with speeds instead of values of Omega if the model has scales."""
    axis = Abscissa([branch], dimensionless)
    if branch.parameter != "Omega" or axis.label != SPEED_LABEL:
        return text
    return as_speeds(text, axis.scale)


def as_speeds(text: str, scale: float) -> str:
    """Return a text with speeds [r/min], scale times Omega, instead of values of Omega.

    >>> as_speeds("a jump at Omega = 0.91803", 1e4)
    'a jump at 9180.3 r/min'
    """

    def converted(match: re.Match[str]) -> str:
        digits = len(match[1].partition("e")[0].replace(".", "").lstrip("0")) - 1  # the last one is rounded
        return f"{scale * float(match[1]):.{max(digits, 5)}g} r/min"

    return OMEGA_TEXT.sub(converted, text)


OMEGA_TEXT = re.compile(r"Omega = (\d+(?:\.\d+)?(?:e[-+]?\d+)?)")
"""Value of Omega in a text."""


_TORUS_SETTINGS = ("harmonics", "dense", "ratio", "band", "half")
"""Settings of tori, which replace the harmonics and samples of the balance of their periodic motions."""


_SETTINGS = {"samples": "samples per period", "nu": "excitation periods in a period", "auto": "tolerance"}
"""Descriptions of settings whose names are those of the code."""


def _settings_text(branch: Branch) -> str:
    """Return the settings of the equations of a branch in words; the usual order and exact forces are not stated."""
    balance, torus = (branch.meta.get(name) for name in ("balance", "torus"))
    settings = dict(balance) if isinstance(balance, dict) else {}
    if isinstance(torus, dict):
        settings = {"nu": settings.get("nu")} | {name: torus.get(name) for name in _TORUS_SETTINGS}
    if settings.get("nu") == 1:
        del settings["nu"]
    sampled = settings.pop("sampled", None) is True
    texts = [f"{_SETTINGS.get(name, name)} = {text_of(value)}" for name, value in settings.items() if value is not None]
    return ", ".join([*texts, "contact forces sampled (AFT)"] if sampled else texts)


def summary_facts(branch: Branch, measure: str | None = None, dimensionless: bool = False) -> Iterator[tuple[str, str]]:
    """Yield name and text of each entry of the summary of a branch; entries without content have an empty text.

    The measure is one of `Ordinate`. With ``dimensionless`` Omega and the units of the model are shown although the
    model has scales.
    """
    stable, layout = branch.stable, branch.layout
    yield "model", title_of(branch)
    yield "settings", _settings_text(branch)
    yield "fixed", ", ".join(f"{name} = {branch.fixed[name]:.6g}" for name in ("Omega",) if name in branch.fixed)
    ends = values_text(branch, [branch.values[0], branch.values[-1]], dimensionless)
    yield "curve", f"from {ends[0]} to {ends[1]}, {len(branch)} points"
    yield "status", f"{branch.status.in_words}: {message_of(branch, dimensionless)}"
    asymptotes = values_text(branch, list(branch.asymptotes.values()), dimensionless, 9)
    asymptote_texts = [f"{x} (beyond the {end} point)" for x, end in zip(asymptotes, branch.asymptotes, strict=True)]
    yield "asymptotes", ", ".join(asymptote_texts)
    if stable is None:
        yield "stability", "not computed"
    else:
        counts = Counter(branch.stability)
        other_counts = [f"{counts[name]} {name}" for name in ("unstable", "undecided", "unknown") if counts[name]]
        yield "stability", ", ".join([f"{counts['stable']} points stable", *other_counts])
    yield "regimes", ", ".join(dict.fromkeys(regime_of(branch[i]) for i in range(len(branch))))
    for j, name in enumerate(layout.elements if layout else ()):
        height = Ordinate(measure or usual_measure(branch, dimensionless, j), j, dimensionless=dimensionless)
        size = height.along(height.prepared(branch))
        (location,) = values_text(branch, [branch.values[int(np.nanargmax(size))]], dimensionless)
        yield f"{height.header(branch)} of {name}", f"{np.nanmin(size):.5g} to {np.nanmax(size):.5g} (at {location})"
    yield "largest residual", f"{np.nanmax(branch.residual):.1e} relative to the forces"
    if not np.isnan(branch.error).all():
        yield "truncation error", f"at most {np.nanmax(branch.error):.1e} rms, estimated from the truncated harmonics"
    yield "Newton iterations", f"{branch.iterations.mean():.2f} per point"
    yield "hbgear", str(branch.meta.get("hbgear", "unknown"))


def describe_changes(branch: Branch) -> str:
    """Return the class of the model of a branch with the fields that differ from their defaults."""
    model = model_of(branch)
    description: Any = branch.meta.get("model")
    if model is None:
        name = description["class"] if model_registry.is_description(description) else "unknown"
        source = description.get("from") if model_registry.is_description(description) else None
        return f"{name} (not a model of hbgear{f'; from {source}' if isinstance(source, str) else ''})"
    changed = [f"{name}={text_of(value)}" for name, value in _changes(model).items()]
    return f"{type(model).__name__}({', '.join(changed)}){'' if changed else ', all defaults'}"


def _changes(model: Model) -> dict[str, Any]:
    """Return the fields of a model that differ from their defaults."""
    defaults, values = defaults_of(type(model)), {name: getattr(model, name) for name in kinds_of(type(model))}
    return {f: x for f, x in values.items() if f not in defaults or not _is_default(x, defaults[f])}


def _numbers_text(value: Any) -> str:
    """Return a number, or numbers in parentheses."""
    values = value if isinstance(value, tuple) else (value,)
    text = ", ".join(map(text_of, values))
    return f"({text})" if len(values) > 1 else text


def _is_short(value: Any) -> bool:
    """Return whether a value is a number or at most three numbers."""
    values = value if isinstance(value, tuple) else (value,)
    return 0 < len(values) <= 3 and all(isinstance(x, int | float) for x in values)


def _is_default(value: Any, default: Any) -> bool:
    """Return whether a value equals the default; a matrix never does."""
    return not hasattr(value, "shape") and bool(value == default)


def text_of(value: Any) -> str:
    """Return a value in the form of the option ``--set``; a component as its name, a matrix as its shape."""
    if isinstance(value, list | tuple):
        return f"({','.join(map(text_of, value))}{',' * (len(value) == 1)})"
    if hasattr(value, "shape"):
        return " x ".join(map(str, value.shape))
    if dataclasses.is_dataclass(value) and not isinstance(value, Phased):
        return str(getattr(value, "name", "") or type(value).__name__)
    return f"{value:g}" if isinstance(value, float) else str(value)
