"""The command ``hbgear``: trace, look at and draw response curves. Everything it does, the library does.

Exit codes: 0 the end was reached; 2 bad input, with one line that says what to do; 3 stopped early, what was traced is
saved all the same. What is slow to import (matplotlib, rich) is imported when it is needed.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import os
import re
import sys
import time
import typing
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

import hbgear as hb
from hbgear import catalogue
from hbgear.model import did_you_mean
from hbgear.trace import Progress

if TYPE_CHECKING:
    from rich.table import Table

BAD_INPUT, STOPPED_EARLY = 2, 3

BRANCHES = (".npz", ".csv", ".mat")
FIGURES = (".png", ".pdf", ".svg")

MEANINGS = {
    "LP": "fold: the curve turns back",
    "CP": "cusp: two folds meet",
    "PD": "period doubling",
    "NS": "Neimark-Sacker: a second frequency sets in",
    "BP": "branch point: two curves cross",
    "GR": "grazing contact: the impact regime changes",
}

app = typer.Typer(
    name="hbgear",
    help="Nonlinear frequency response of gear drives with backlash.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

File = Annotated[Path, typer.Argument(metavar="FILE", help="A curve saved as .npz by hbgear trace -o or Branch.save.")]
Measure = Annotated[str, typer.Option(help="Amplitude: pp2 (half peak-to-peak), rms, max, mean, H1, H2, ...")]
Element = Annotated[str, typer.Option(help="Which element, by number from 0 or by name.")]


def main(args: Sequence[str] | None = None) -> None:
    """Run the command and exit."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _say("warning", message)
        sys.exit(_run(list(sys.argv[1:] if args is None else args) or ["--help"]))


def _run(args: list[str]) -> int:
    try:
        return int(app(args, prog_name="hbgear", standalone_mode=False) or 0)
    except (ValueError, KeyError, OSError, hb.NoConvergence) as error:
        _say("error", error.args[0] if isinstance(error, KeyError) else error)
        return BAD_INPUT
    except Exception as error:  # what typer says of unknown options and commands; anything else is a bug of ours
        if not hasattr(error, "format_message"):
            raise
        _say("error", f"{error.format_message().rstrip('.')}; see hbgear --help or hbgear COMMAND --help")
        return BAD_INPUT


def _say(kind: str, text: object) -> None:
    print(f"hbgear: {kind}: {' '.join(str(text).split())}", file=sys.stderr)


# ---- commands


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        print(hb.__version__)
        raise typer.Exit


@app.command()
def models() -> None:
    """List the models, their equations and their parameters with defaults."""
    rows = []
    for name, cls in catalogue.MODELS.items():
        values = ", ".join(f"{f.name}={_text(f.default)}" for f in dataclasses.fields(cls))  # type: ignore[arg-type]
        rows.append([f"{name}\n{cls.__name__}", f"{_summary(cls)}\n{_equation(cls)}\n{values}\n"])
    _print(_table(["model", "equation, parameters with defaults (change them with --set)"], rows))


@app.command()
def trace(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=f"One of: {', '.join(catalogue.MODELS)}.")],
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Change a field of the model; repeatable.")
    ] = None,
    parameter: Annotated[
        str, typer.Option(help="What changes along the curve: Omega or a field of the model.")
    ] = "Omega",
    first: Annotated[
        float | None, typer.Option("--from", help="Start of the span.", show_default="the model's")
    ] = None,
    last: Annotated[float | None, typer.Option("--to", help="End of the span.", show_default="the model's")] = None,
    harmonics: Annotated[int, typer.Option(min=1, help="H, harmonics of the excitation frequency.")] = 16,
    samples: Annotated[
        int | None, typer.Option(min=1, help="N per period, at least 2H+1.", show_default="chosen from H")
    ] = None,
    sampled: Annotated[
        bool, typer.Option("--sampled", help="Sample contact forces instead of exact projection.")
    ] = False,
    at: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="Hold a parameter, such as Omega=0.9; repeatable.")
    ] = None,
    measure: Measure = "pp2",
    element: Element = "0",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Save as .npz, or export .csv or .mat.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the curve to a .png, .pdf or .svg.")] = None,
    stability: Annotated[
        bool, typer.Option("--stability/--no-stability", help="Floquet multipliers and jumps.")
    ] = True,
    max_points: Annotated[int, typer.Option(min=2, help="Stop after so many points.")] = hb.Steps().max_points,
) -> None:
    """Trace a response curve through its folds; print its special points and jumps.

    Linear algebra is limited to one thread: the matrices are too small to gain from more. Ctrl-C stops the trace and
    keeps what it has. Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (what was traced is saved).
    """
    for path, allowed in ((output, BRANCHES), (plot, FIGURES)):
        _check_writable(path, allowed)
    machine = catalogue.build(model, **_fields(catalogue.MODELS.get(model), changes or []))
    problem = hb.HarmonicBalance(machine, harmonics, samples, sampled=sampled)
    problem.check_parameter(parameter)
    span = _span(machine, parameter, first, last)
    held = _held(parameter, at or [])
    which = _element(element)
    problem.layout.measure(measure, np.zeros(problem.size), which)  # a wrong name is refused before the work

    started = time.perf_counter()
    try:
        branch = _traced(problem, parameter, span, at=held, stability=stability, steps=hb.Steps(max_points=max_points))
    except KeyboardInterrupt:  # not within the trace itself, which keeps what it has
        _say("error", "interrupted while starting or finishing; nothing was kept")
        raise typer.Exit(STOPPED_EARLY) from None
    seconds = time.perf_counter() - started
    if output:
        branch.save(output) if output.suffix.lower() == ".npz" else branch.export(output)
    if plot:
        _draw(plot, lambda drawing: drawing.response(branch, measure, which))
    print(f"{model}: {len(branch)} points in {seconds:.1f} s; {branch.message}")
    _report(branch, measure, which)
    _wrote(output, plot)
    raise typer.Exit(0 if branch.status.complete else STOPPED_EARLY)


@app.command()
def info(file: File, measure: Measure = "pp2", element: Element = "0") -> None:
    """Say what a saved curve is, how it ended, what is on it and how accurate it is."""
    branch, which = _loaded(file, measure, element)
    rows = [[name, text] for name, text in _facts(branch, measure) if text]
    _print(_table(["", str(file)], rows))
    _report(branch, measure, which)


@app.command()
def jumps(file: File, measure: Measure = "pp2", element: Element = "0") -> None:
    """Where a slow sweep jumps, and from which amplitude to which."""
    branch, which = _loaded(file, measure, element)
    _report_jumps(branch, measure, which)


@app.command(name="plot")
def plot_command(
    file: File,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help=".png, .pdf or .svg.", show_default="FILE.png")
    ] = None,
    measure: Measure = "pp2",
    element: Element = "0",
    point: Annotated[
        str | None, typer.Option(help="Portrait of one point: a label such as LP1, or a value of the parameter.")
    ] = None,
) -> None:
    """Draw a saved curve, or the time history, phase diagram and spectrum of one of its points."""
    branch, which = _loaded(file, measure, element)
    chosen = None if point is None else _point(branch, point)
    path = output or file.with_name(f"{file.stem}{'' if chosen is None else f'_{point}'}.png")
    _check_writable(path, FIGURES)
    if chosen is None:
        _draw(path, lambda drawing: drawing.response(branch, measure, which))
    else:
        print(f"point at {branch.parameter} = {chosen.parameters[branch.parameter]:.8g}")
        _draw(path, lambda drawing: drawing.portrait(chosen, which))
    _wrote(path)


# ---- input


def _assignments(option: str, texts: list[str]) -> list[tuple[str, str]]:
    """``name=value`` pairs, each name once."""
    pairs: list[tuple[str, str]] = []
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise ValueError(f"{option} {text}: need NAME=VALUE, such as {option} {name or 'zeta'}=0.05")
        if name in dict(pairs):
            raise ValueError(f"{option} {text}: {name} is already given as {dict(pairs)[name]}; give it once")
        pairs.append((name, value))
    return pairs


def _fields(cls: type[hb.Model] | None, changes: list[str]) -> dict[str, Any]:
    """Values of --set, by the types of the fields of the model; an unknown model has none and is refused later."""
    if cls is None:
        return {}
    types, known = typing.get_type_hints(cls), [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
    values = {}
    for name, text in _assignments("--set", changes):
        if name not in known:
            raise KeyError(f"{cls.__name__} has no parameter '{name}'{did_you_mean(name, known)}")
        values[name] = _value(f"--set {name}", text, types[name])
    return values


def _held(parameter: str, at: list[str]) -> dict[str, float]:
    """Values of --at."""
    held = {name: _number(f"--at {name}", text) for name, text in _assignments("--at", at)}
    if parameter in held:
        raise ValueError(f"--at {parameter}: it is what changes along the curve; use --from and --to")
    if parameter != "Omega" and "Omega" not in held:
        raise ValueError(f"tracing in {parameter} needs a frequency that is held: --at Omega=0.9")
    return held


def _value(what: str, text: str, kind: Any) -> Any:
    """Text as a value of a field's type."""
    if kind is bool:
        if text.lower() not in ("true", "false"):
            raise ValueError(f"{what}={text}: need true or false")
        return text.lower() == "true"
    if kind is int:
        try:
            return int(text)
        except ValueError:
            raise ValueError(f"{what}={text}: need a whole number") from None
    if kind is float:
        return _number(what, text)
    if typing.get_origin(kind) is tuple:
        return tuple(_number(what, part) for part in re.split(r"[,\s]+", text.strip("()[] ")) if part)
    return text


def _number(what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{what}={text}: need a finite number")
    return value


def _loaded(file: Path, measure: str, element: str) -> tuple[hb.Branch, int | str]:
    """A saved branch and the element meant; a wrong measure or element is refused before anything is printed."""
    branch, which = hb.load(file), _element(element)
    branch[0].amplitude(measure, which)
    return branch, which


def _element(text: str) -> int | str:
    return int(text) if text.isdecimal() else text


def _span(model: hb.Model, parameter: str, first: float | None, last: float | None) -> tuple[float, float]:
    default: tuple[float | None, float | None] = model.default_span if parameter == "Omega" else (None, None)
    a, b = (given if given is not None else usual for given, usual in zip((first, last), default, strict=True))
    if a is None or b is None:
        raise ValueError(f"tracing in {parameter} needs --from and --to; only Omega has a usual span")
    return a, b


def _check_writable(path: Path | None, allowed: tuple[str, ...]) -> None:
    """Refuse now what could not be written when the work is done."""
    if path is None:
        return
    if path.suffix.lower() not in allowed:
        raise ValueError(f"cannot write '{path}': the name must end in {', '.join(allowed[:-1])} or {allowed[-1]}")
    if not path.parent.is_dir():
        raise ValueError(f"cannot write '{path}': there is no folder '{path.parent}'; create it first")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        what = "it is a folder" if path.is_dir() else f"you may not write in '{path.parent}'"
        raise ValueError(f"cannot write '{path}': {what}; give another name")


def _point(branch: hb.Branch, text: str) -> hb.Point:
    """Special point by label, or the row nearest to a value; where the curve passes several times, a stable one."""
    try:
        value = float(text)
    except ValueError:
        return branch[text]
    x = branch.values - value
    low, high = float(branch.values.min()), float(branch.values.max())
    if not low <= value <= high:
        raise ValueError(
            f"--point {text}: the curve runs from {low:.6g} to {high:.6g} in {branch.parameter}; choose there"
        )
    passes = np.flatnonzero(x[:-1] * x[1:] <= 0)
    near = [int(i if abs(x[i]) <= abs(x[i + 1]) else i + 1) for i in passes] or [int(np.argmin(abs(x)))]
    return branch[min(near, key=lambda i: branch[i].stable is not True)]


# ---- work


def _traced(problem: hb.HarmonicBalance, parameter: str, span: tuple[float, float], **options: Any) -> hb.Branch:
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1), _progress(parameter, *span) as progress:
        return hb.trace(problem, parameter, span, progress=progress, **options)


@contextmanager
def _progress(parameter: str, a: float, b: float) -> Iterator[Progress | None]:
    """A bar on a terminal: position in the parameter, points, step; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[points]}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(f"{parameter} = {a:.5g}", total=1.0, points="")

        def show(value: float, rows: int, step: float) -> None:
            done = min(max((value - a) / (b - a), 0.0), 1.0)
            points = f"{rows} points, step {step:.1e}"
            bar.update(task, completed=done, description=f"{parameter} = {value:.5f}", points=points)

        yield show


def _draw(path: Path, draw: Callable[[Any], Any]) -> None:
    """A figure to a file, without a window."""
    import matplotlib

    matplotlib.use("Agg")
    from hbgear import plot as drawing

    drawing.save(draw(drawing), path)


# ---- output


def _wrote(*paths: Path | None) -> None:
    if any(paths):
        print("wrote", ", ".join(str(path) for path in paths if path))


def _print(table: Table) -> None:
    """A table; wide enough for all of it where no terminal sets the width."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 140, highlight=False).print(table)


def _table(headers: list[str], rows: list[list[str]], title: str = "") -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, title=title or None, title_justify="left", title_style="bold")
    for i, header in enumerate(headers):
        table.add_column(header, overflow="fold", no_wrap=i < len(headers) - 1)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _report(branch: hb.Branch, measure: str, element: int | str) -> None:
    """Tables of special points and jumps."""
    if not branch.special:
        print("no special points")
        return
    rows = []
    for point in branch.special:
        place = [f"{point.parameters[name]:.8g}" for name in (branch.parameter, *branch.tracked)]
        place += [f"{value:.6g}" for value in _speeds(branch, point).values()]
        amplitude = f"{point.amplitude(measure, element):.5g}"
        rows.append([point.label, *place, amplitude, _regime(point), _what_happens(branch, point)])
    headers = ["", branch.parameter, *branch.tracked, *_speeds(branch, branch[0]), measure, "regime", "what happens"]
    _print(_table(headers, rows, "special points"))
    _report_jumps(branch, measure, element)


def _report_jumps(branch: hb.Branch, measure: str, element: int | str) -> None:
    if not branch.jumps():
        print("no jumps" if branch.multipliers is not None else "no jumps known: traced without stability")
        return
    rows = []
    for jump in branch.jumps():
        speeds = [f"{value:.6g}" for value in _speeds(branch, jump.before).values()]
        before, after = (
            "no stable motion on this curve" if end is None else f"{end.amplitude(measure, element):.5g}"
            for end in (jump.before, jump.after)
        )
        direction = "increasing" if jump.direction > 0 else "decreasing"
        rows.append([jump.label, f"{jump.value:.8g}", *speeds, direction, before, after])
    headers = ["", branch.parameter, *_speeds(branch, branch[0]), "while", f"{measure} before", f"{measure} after"]
    _print(_table(headers, rows, "jumps of a slow sweep"))


def _what_happens(branch: hb.Branch, point: hb.SpecialPoint) -> str:
    text = MEANINGS.get(point.kind, point.kind)
    if point.kind in ("PD", "NS") and branch.stable is not None and 0 < point.index < len(branch) - 1:
        before, after = branch.stable[point.index - 1], branch.stable[point.index + 1]
        text += "" if before == after else "; stability is lost" if before else "; stability is regained"
    where = "" if point.located else f" (only known to lie within {point.interval[0]:.8g} and {point.interval[1]:.8g})"
    return f"{text}{f' ({point.note})' if point.note else ''}{where}"


def _regime(point: hb.Point) -> str:
    """Regime in words; laws without corners have none."""
    corners = point.layout is None or any(point.layout.breakpoints)
    return point.regime_name.replace("_sided", "-sided").replace("_", " ") if corners else "-"


def _model(branch: hb.Branch) -> hb.Model | None:
    """The model a curve was traced with, if the catalogue has it."""
    try:
        return catalogue.rebuild(branch.meta.get("model", {}))
    except (KeyError, TypeError, ValueError):
        return None


def _speeds(branch: hb.Branch, point: hb.Point) -> dict[str, float]:
    """Mesh frequency and speed of models that know their units."""
    model: Any = _model(branch)
    if not (hasattr(model, "mesh_frequency") and hasattr(model, "pinion_speed") and "Omega" in point.parameters):
        return {}
    model = model.replace(**{name: value for name, value in point.parameters.items() if name in model.parameters})
    Omega = point.parameters["Omega"]
    return {"mesh Hz": float(model.mesh_frequency(Omega)), "pinion r/min": float(model.pinion_speed(Omega))}


def _facts(branch: hb.Branch, measure: str) -> Iterator[tuple[str, str]]:
    """What there is to say of a branch, name and text."""
    stable, layout = branch.stable, branch.layout
    settings = branch.meta.get("balance", {})
    yield "model", _described(branch)
    yield "settings", ", ".join(f"{name} = {_text(value)}" for name, value in settings.items() if value is not None)
    yield "held", ", ".join(f"{name} = {branch.fixed[name]:.6g}" for name in ("Omega",) if name in branch.fixed)
    yield "curve", f"{branch.parameter} from {branch.values[0]:.6g} to {branch.values[-1]:.6g}, {len(branch)} points"
    yield "status", f"{branch.status}: {branch.message}"
    if stable is None:
        yield "stability", "not computed"
    else:
        yield "stability", f"{int(stable.sum())} points stable, {int((~stable).sum())} unstable"
    yield "regimes", ", ".join(dict.fromkeys(_regime(branch[i]) for i in range(len(branch))))
    for j, name in enumerate(layout.elements if layout else ()):
        size = branch.amplitude(measure, j)
        top = branch.values[int(np.nanargmax(size))]
        yield f"{measure} of {name}", f"{size.min():.5g} to {size.max():.5g} (at {branch.parameter} = {top:.6g})"
    yield "worst residual", f"{np.nanmax(branch.residual):.1e} of the forces"
    if not np.isnan(branch.error).all():
        yield "worst error", f"{np.nanmax(branch.error):.1e} rms of the motion, estimated from the harmonics left out"
    yield "Newton steps", f"{branch.iterations.mean():.2f} per point"
    yield "hbgear", str(branch.meta.get("hbgear", "unknown"))


def _described(branch: hb.Branch) -> str:
    """Model with the fields that differ from its defaults."""
    model, about = _model(branch), branch.meta.get("model", {})
    if model is None:
        return f"{about.get('class', 'unknown')} (not one of hbgear models)"
    usual = type(model)()
    fields = [f.name for f in dataclasses.fields(model)]  # type: ignore[arg-type]
    changed = [f"{f}={_text(getattr(model, f))}" for f in fields if getattr(model, f) != getattr(usual, f)]
    return f"{type(model).__name__}({', '.join(changed)}){'' if changed else ', all defaults'}"


def _text(value: Any) -> str:
    """A value as --set would take it."""
    if isinstance(value, list | tuple):
        return f"({','.join(map(_text, value))})"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _summary(cls: type) -> str:
    return (inspect.getdoc(cls) or "").splitlines()[0].partition(";")[0].rstrip(".")


def _equation(cls: type) -> str:
    """First indented line of the docstring of the class, or of its module."""
    for text in (inspect.getdoc(cls), inspect.getdoc(inspect.getmodule(cls))):
        for line in (text or "").partition("\nParameters\n")[0].splitlines():
            if line.startswith("    "):
                return re.sub(r"\s+", " ", line.strip())
    return ""
