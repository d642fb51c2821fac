"""Input of the commands: models, curves, points and values from the words of a command."""

from __future__ import annotations

import dataclasses
import operator
import os
import re
import typing
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import QUANTITIES, Ordinate, usual_measure
from hbgear.cli.first import compile_in_parallel
from hbgear.cli.output import bar, print_message
from hbgear.cli.quantities import changes_of, check_parameter, named, number_of, parameter_value, value_in_model
from hbgear.continuation.extend import traced_span
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.harmonic.models import model_registry
from hbgear.harmonic.models.frequency_units import Omega_of, model_of
from hbgear.io.branches.npz import read
from hbgear.mechanics.fields import check_names, is_entry, kinds_of, made, required_of


def assignments(option: str, texts: list[str]) -> list[tuple[str, str]]:
    """Return ``name=value`` pairs; each name occurs once."""
    pairs: list[tuple[str, str]] = []
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            example = f"{name}=0.05" if name.isidentifier() else "Omega=0.9" if option == "--at" else "zeta=0.05"
            begin = f"{option} " if option.startswith("--") else ""  # an argument has no option before it
            raise ValueError(f"{option} {text}: need NAME=VALUE, such as {begin}{example}")
        if name in dict(pairs):
            raise ValueError(f"{option} {text}: {name} is already given as {dict(pairs)[name]}; give it once")
        pairs.append((name, value))
    return pairs


def fields_of(cls: type[hb.mechanics.Model], changes: list[str]) -> dict[str, Any]:
    """Return the values of --set, converted to the types of the fields, with entries of tuples such as ``e[0]``."""
    values: dict[str, Any] = {}
    for name, text in assignments("--set", changes):
        if is_entry(name):
            values[name] = number_of(f"--set {name}", text)
            continue
        check_names(cls, [name])
        kind = kinds_of(cls)[name]
        if kind is float and isinstance(cls.labels, Mapping):
            values[name] = parameter_value(cls.labels, "--set", name, text)
        else:
            values[name] = value_of(f"--set {name}", text, kind)
    return values


def range_of(
    text: str, model: hb.mechanics.Model | None = None, first: str | None = None, last: str | None = None
) -> tuple[str, tuple[float, float]]:
    """Return the name and the range of --in, with units if the model is known."""
    name, equals, ends = (part.strip() for part in text.partition("="))
    low, colon, high = (part.strip() for part in ends.partition(":"))
    if not (name and equals and low and colon and high):
        example = "0.02:0.08" if first is None or last is None else f"{first}:{last}"
        raise ValueError(
            f"--in {text}: need its range too, such as --in {name or 'zeta'}={example} (--from and --to are in Omega)"
        )
    if model is None:
        return name, (number_of(f"--in {name}", low), number_of(f"--in {name}", high))
    return named(name), (value_in_model(model, "--in", name, low), value_in_model(model, "--in", name, high))


def path_of(
    model: hb.mechanics.Model,
    within: str | None,
    first: str | None,
    last: str | None,
    at: list[str] | None,
    has_start: bool = False,
) -> tuple[str, tuple[float, float], dict[str, float]]:
    """Return the continuation parameter, its span and the fixed parameters.

    The parameter is Omega, or that of --in; then Omega must be fixed by --at or a starting point (``has_start``).
    """
    fixed = {named(name): value_in_model(model, "--at", name, text) for name, text in assignments("--at", at or [])}
    if within is None:
        parameter, span = "Omega", span_of(model, first, last)
    else:
        parameter, span = range_of(within, model, first, last)
        check_parameter(model, parameter)
        if first is not None or last is not None:
            raise ValueError(
                f"--in {within}: {parameter} is the continuation parameter; omit --from and --to, which are in Omega"
            )
    if parameter in fixed:
        instead = "--from and --to" if parameter == "Omega" else f"--set {parameter} or --in {parameter} alone"
        raise ValueError(f"--at {parameter}: {parameter} is the continuation parameter; use {instead}")
    if parameter != "Omega" and not has_start and "Omega" not in fixed:
        raise ValueError(f"--in {parameter}=...: a fixed frequency is required: --at Omega=0.9")
    return parameter, span, fixed


def value_of(option: str, text: str, kind: Any) -> Any:
    """Convert a text to the type of a field; ``option`` names it in errors."""
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise ValueError(f"{option}={text}: need true or false")
        return text.lower() == "true"
    if kind is int:
        try:
            return int(text)
        except ValueError:
            raise ValueError(f"{option}={text}: need a whole number") from None
    if kind is float:
        return number_of(option, text)
    if typing.get_origin(kind) is tuple:
        inner = text.strip("()[] ").removesuffix(",").strip()
        words = re.split(r"\s*,\s*|\s+", inner) if inner else []
        if "" in words:
            raise ValueError(f"{option}={text}: a number is missing between two commas")
        return tuple(number_of(option, word) for word in words)
    return text


def loaded(file: Path, measure: str | None, element: int | str, dimensionless: bool = False) -> tuple[hb.Branch, str]:
    """Load a branch and return it with its measure, by default `usual_measure`.

    An unknown measure or element is refused before anything is printed.
    """
    branch = hb.load(file)
    quantity = measure or usual_measure(branch, dimensionless, element)
    height = Ordinate(quantity, element, dimensionless=dimensionless)
    height.at(height.prepared(branch)[0], branch)
    return branch, quantity


def check_shown(problem: hb.HarmonicBalance, measure: str | None, element: int | str) -> None:
    """Refuse an unknown element or --measure before any computation."""
    problem.layout.index(element)
    if measure is not None and measure not in QUANTITIES:
        problem.layout.check_measure(measure, element)


def with_landings(
    landing: str,
    branch: hb.Branch,
    problem_for: Callable[[hb.Branch], Any] = operator.attrgetter("problem"),
    other_curves: Sequence[hb.Branch] = (),
) -> tuple[hb.Branch, bool]:
    """Return the curves with landings as --landing requires; False if Ctrl-C or an error left some of them unchanged.

    The jumps of each curve may land on all curves; ``problem_for`` returns the problem of a curve.
    """
    if landing == "nearest" or not any(curve.jumps() for curve in branch.curves):
        return branch, True
    from hbgear.time.jump_integration import integrate_jumps

    curves = [dataclasses.replace(curve, others=()) for curve in branch.curves]
    problems = [problem_for(curve) if curve.jumps() else None for curve in curves]
    integrated, is_complete = list(curves), True
    try:
        with bar("jumps") as progress:
            for i, problem in enumerate(problems):
                if problem is not None:
                    others = [*curves[:i], *curves[i + 1 :], *other_curves]
                    integrated[i] = integrate_jumps(curves[i], others, problem=problem, progress=progress)
    except (KeyboardInterrupt, ValueError, ArithmeticError) as error:
        reason = "interrupted" if isinstance(error, KeyboardInterrupt) else f"jumps cannot be integrated: {error}"
        print_message("error", f"{reason}; the nearest motions are shown as landings of the other jumps")
        is_complete = False
    return dataclasses.replace(integrated[0], others=tuple(integrated[1:])), is_complete


def span_of(
    model: hb.mechanics.Model, first: str | None, last: str | None, usual: tuple[float, float] | None = None
) -> tuple[float, float]:
    """Return the span of Omega; an end that is not given is that of the usual span, by default that of the model."""
    if usual is None and isinstance(model, hb.System) and None in (first, last):
        raise ValueError(f"--from and --to are needed: a structure has no usual range of Omega{_natural(model)}")
    a, b = usual or model.default_span
    a = a if first is None else Omega_of(model, "--from", first)
    b = b if last is None else Omega_of(model, "--to", last)
    if a == b and first is not None and last is not None:
        raise ValueError(f"--from {first} and --to {last} are the same frequency; give two different ones")
    for option, text, Omega in (("--from", first, a), ("--to", last, b)):
        if text is not None and Omega <= 0:
            raise ValueError(f"{option} {text}: Omega must be positive")
    return a, b


def _natural(system: hb.System) -> str:
    """Return the lowest natural frequencies of a structure as a part of an error; empty if they cannot be computed."""
    try:
        found = hb.analysis.campbell(system, (1.0, 2.0), points=2)
    except (ValueError, ArithmeticError):
        return ""
    texts = [f"{omega:.4g}" for omega in sorted(x for x in found.frequencies[0] if x > 0)]
    return f"; its natural frequencies are {', '.join(texts[:5] + ['...'] * (len(texts) > 5))}" if texts else ""


def longer_span(branch: hb.Branch, within: str | None, first: str | None, last: str | None) -> tuple[float, float]:
    """Return the span of a curve, in its own parameter, with the given ends replaced."""
    model = model_of(branch)
    if within is not None:
        name, (low, high) = range_of(within, model)
        if name != branch.parameter:
            raise ValueError(f"--in {within}: this curve is in {branch.parameter}; give a longer span of it")
        return low, high
    if branch.parameter != "Omega" and (first is not None or last is not None):
        raise ValueError(f"this curve is in {branch.parameter}: give its range as --in {branch.parameter}=FROM:TO")
    a, b = traced_span(branch)
    return (
        a if first is None else _frequency(model, "--from", first),
        b if last is None else _frequency(model, "--to", last),
    )


def _frequency(model: hb.mechanics.Model | None, option: str, text: str) -> float:
    return number_of(option, text) if model is None else Omega_of(model, option, text)


def metadata_with(meta: dict[str, Any], harmonics: str | None, samples: int | None) -> dict[str, Any]:
    """Return the metadata of a file with other harmonics or samples."""
    balance = dict(meta.get("balance", {}))
    if harmonics is not None:
        balance = {**balance, "harmonics": harmonics_or_auto(harmonics), "samples": None, "auto": None}
    if samples is not None:
        balance = {**balance, "samples": samples}
    return {**meta, "balance": balance} if balance else meta


def start_of(text: str) -> tuple[hb.Branch, hb.Point]:
    """Return a saved curve and its point given by --start: a label, a value of its parameter, or the last point."""
    match = None if os.path.exists(text) else re.fullmatch(r"(.+?):((?:\d+:)?[^:]*)", text)
    branch = hb.load(match[1] if match else text)
    return branch, point_of(branch, match[2], "--start") if match else branch[-1]


def model_at(branch: hb.Branch, point: hb.Point, name: str, changes: list[str] | None) -> hb.mechanics.Model:
    """Return the model of a saved curve at one of its points with the values of --set; its class must be ``name``."""
    cls = type(chosen_model(name, None)) if name.endswith(".toml") else model_registry.model_class(name)
    about = branch.meta.get("model", {})
    if model_registry.is_description(about) and about["class"] != cls.__name__:
        raise ValueError(f"the curve of --start is of {about['class']}; '{name}' is {cls.__name__}")
    model = model_registry.rebuild_model(about, cls)
    return changed(model.at(point.parameters), changes)


def changed(model: hb.mechanics.Model, changes: list[str] | None) -> hb.mechanics.Model:
    """Return a model with the values of --set: parameters with units, or fields."""
    pairs = assignments("--set", changes or [])
    values = changes_of(model, pairs)
    if values is None and isinstance(type(model).parameters, property) and not _has_parameters_without_field(model):
        values = fields_of(type(model), changes or [])
    if values is None:
        for name, _ in pairs:
            check_parameter(model, name)
    return model.replace(**(values or {}))


def _has_parameters_without_field(model: hb.mechanics.Model) -> bool:
    """Return whether parameters of a model are no fields of its class."""
    return any(name not in kinds_of(type(model)) for name in model.parameters)


def label_on_curve(number: int, point: hb.SpecialPoint | hb.Jump | Any) -> str:
    """Return the label of a point or jump of a curve of a file, the first one with number 1: ``LP1`` or ``2:LP1``."""
    return str(point.label) if number == 1 else f"{number}:{point.label}"


def numbered(branch: hb.Branch, text: str, option: str = "LABEL") -> tuple[int, str]:
    """Return the number, from 0, of the curve to which ``LP1``, ``2:LP1`` or ``LP1 (2)`` belongs, and ``LP1``.

    Tables print the second form, figures the third one. ValueError is raised if the file has no such curve, or no
    number is given and only another curve has a point with this label.
    """
    curves = branch.curves
    before, after = re.fullmatch(r"(\d+):(.+)", text), re.fullmatch(r"(.+) \((\d+)\)", text)
    if before is None and after is None:
        owners = [n for n, curve in enumerate(curves, 1) if any(point.label == text for point in curve.special)]
        if owners and owners[0] > 1:
            raise ValueError(
                f"{option} {text}: curve 1 of the file has no such point; curve {owners[0]} has: {owners[0]}:{text}"
            )
        return 0, text
    label, number = (before[2], int(before[1])) if before else (after[1], int(after[2]))  # type: ignore[index]
    if not 1 <= number <= len(curves):
        raise ValueError(f"{option} {text}: the file has {len(curves)} curve{'s' if len(curves) > 1 else ''}")
    return number - 1, label


def on_curve(branch: hb.Branch, text: str, option: str = "LABEL") -> tuple[hb.Branch, str]:
    """Return the curve of a file to which a point such as ``2:LP1`` belongs, and its label; see `numbered`."""
    number, label = numbered(branch, text, option)
    return (branch if number == 0 else branch.others[number - 1]), label


def point_of(branch: hb.Branch, text: str, option: str = "--point") -> hb.Point:
    """Return a special point by label, or the motion at a value or quantity, of several motions a stable one.

    A curve without its problem has computed points only, of which the nearest is returned. ``2:`` in front of either
    selects the second curve of the file; see `numbered`.
    """
    branch, text = on_curve(branch, text, option)
    if not re.match(r"[-+.]?\d", text):
        return branch[text]
    model = model_of(branch)
    if model is None:
        value = number_of(option, text)
    elif branch.parameter == "Omega":
        value = Omega_of(model, option, text)
    else:
        value = parameter_value(model.labels, option, branch.parameter, text)
    low, high = float(branch.values.min()), float(branch.values.max())
    if not low <= value <= high:
        raise ValueError(
            f"{option} {text}: the curve runs from {low:.6g} to {high:.6g} in {branch.parameter}; choose there"
        )
    motions = dataclasses.replace(branch, others=()).at(value) if branch.problem is not None else ()
    nearest = [branch[crossing.nearest] for crossing in crossings_at(branch, value)] or [branch[0]]  # of a single point
    return min(motions or nearest, key=lambda motion: motion.stable is not True)


def chosen_model(name: str, changes: list[str] | None) -> hb.mechanics.Model:
    """Return the model of MODEL, by name or from a file, with the values of --set."""
    if name.endswith(".toml"):
        from hbgear.io.machines.model_file import read_model

        return changed(read_model(name), changes)
    cls = model_registry.model_class(name)
    fields = fields_of(cls, changes or [])
    missing = [field for field in required_of(cls) if field not in fields]
    if missing:
        needed = " ".join(f"--set {field}=VALUE" for field in missing)
        raise ValueError(f"the model '{name}' needs {', '.join(missing)}, which have no default: {needed}")
    return made(cls, fields)


def problem_in(branch: hb.Branch, name: str | None, harmonics: str | None = None, samples: int | None = None) -> Any:
    """Rebuild the problem of a saved curve, with the model class of --model, other harmonics or samples."""
    return model_registry.rebuild_problem(metadata_with(branch.meta, harmonics, samples), class_of(name))


def load_with_problem(file: Path, name: str | None) -> hb.Branch:
    """Load a curve with its problem, which needs the metadata of the file and the model class of --model."""
    return hb.load(file, problem=model_registry.rebuild_traced_problem(read(file).meta, class_of(name)))


def class_of(name: str | None) -> type[hb.mechanics.Model] | None:
    """Return the model class of --model; None without it."""
    return None if name is None else model_registry.model_class(name)


def problem_of(model: hb.mechanics.Model, harmonics: str, **settings: Any) -> hb.HarmonicBalance:
    """Return a harmonic balance with the number of harmonics of --harmonics."""
    return hb.HarmonicBalance(model, harmonics_of(harmonics), **settings)


def harmonics_of(text: str) -> int:
    """Return the value of --harmonics of a command that does not adapt their number."""
    if not (text.isdecimal() and int(text) >= 1):
        auto = "; only hbgear trace and hbgear extend accept auto" if text == "auto" else ""
        raise ValueError(f"--harmonics {text}: need a whole number of at least 1, such as --harmonics 16{auto}")
    return int(text)


def harmonics_or_auto(text: str) -> int | str:
    """Return the value of --harmonics of a command that can adapt their number."""
    if text != "auto" and not (text.isdecimal() and int(text) >= 1):
        raise ValueError(f"--harmonics {text}: need a whole number of at least 1, or auto")
    return text if text == "auto" else int(text)


def traced(problem: hb.HarmonicBalance, parameter: str, span: tuple[float, float], **options: Any) -> hb.Branch:
    """Trace a curve with a progress bar."""
    compilation = compile_in_parallel(problem) if options.get("stability", True) else nullcontext()
    with bar(parameter) as progress, compilation:
        return hb.trace(problem, parameter, span, progress=progress, **options)
