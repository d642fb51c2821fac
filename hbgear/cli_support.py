"""What the commands share: reading options, progress, tables, files."""

from __future__ import annotations

import dataclasses
import inspect
import math
import os
import re
import sys
import typing
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

import hbgear as hb
from hbgear import catalogue
from hbgear.landings import landings
from hbgear.model import did_you_mean
from hbgear.speeds import model_of, speeds_at
from hbgear.trace import Progress

if TYPE_CHECKING:
    from rich.table import Table

STOPPED_EARLY = 3

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

File = Annotated[Path, typer.Argument(metavar="FILE", help="A curve saved as .npz by hbgear trace -o or Branch.save.")]
Measure = Annotated[str, typer.Option(help="Amplitude: pp2 (half peak-to-peak), rms, max, mean, H1, H2, ...")]
Element = Annotated[str, typer.Option(help="Which element, by number from 0 or by name.")]
Harmonics = Annotated[str, typer.Option(help="H, harmonics of the excitation frequency; or auto, see --tolerance.")]
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Change a field of the model; repeatable.")
]


def say(kind: str, text: object) -> None:
    """One line on standard error."""
    print(f"hbgear: {kind}: {' '.join(str(text).split())}", file=sys.stderr)


# ---- input


def assignments(option: str, texts: list[str]) -> list[tuple[str, str]]:
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


def fields_of(cls: type[hb.Model] | None, changes: list[str]) -> dict[str, Any]:
    """Values of --set, by the types of the fields of the model; an unknown model has none and is refused later."""
    if cls is None:
        return {}
    types, known = typing.get_type_hints(cls), [f.name for f in dataclasses.fields(cls)]  # type: ignore[arg-type]
    values = {}
    for name, text in assignments("--set", changes):
        if name not in known:
            raise KeyError(f"{cls.__name__} has no parameter '{name}'{did_you_mean(name, known)}")
        values[name] = value_of(f"--set {name}", text, types[name])
    return values


def held_values(parameter: str, at: list[str]) -> dict[str, float]:
    """Values of --at."""
    held = {name: number_of(f"--at {name}", text) for name, text in assignments("--at", at)}
    if parameter in held:
        raise ValueError(f"--at {parameter}: it is what changes along the curve; use --from and --to")
    if parameter != "Omega" and "Omega" not in held:
        raise ValueError(f"tracing in {parameter} needs a frequency that is held: --at Omega=0.9")
    return held


def value_of(what: str, text: str, kind: Any) -> Any:
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
        return number_of(what, text)
    if typing.get_origin(kind) is tuple:
        return tuple(number_of(what, part) for part in re.split(r"[,\s]+", text.strip("()[] ")) if part)
    return text


def number_of(what: str, text: str) -> float:
    """The finite number a text stands for; ``what`` names it in the error."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{what}={text}: need a finite number")
    return value


def loaded(file: Path, measure: str, element: str) -> tuple[hb.Branch, int | str]:
    """A saved branch and the element meant; a wrong measure or element is refused before anything is printed."""
    branch, which = hb.load(file), element_of(element)
    branch[0].amplitude(measure, which)
    return branch, which


def element_of(text: str) -> int | str:
    """The number or the name of an element, as given on the command line."""
    return int(text) if text.isdecimal() else text


def span_of(model: hb.Model, parameter: str, first: float | None, last: float | None) -> tuple[float, float]:
    """The span given, with the ends that are missing from the model's default."""
    default: tuple[float | None, float | None] = model.default_span if parameter == "Omega" else (None, None)
    a, b = (given if given is not None else usual for given, usual in zip((first, last), default, strict=True))
    if a is None or b is None:
        raise ValueError(f"tracing in {parameter} needs --from and --to; only Omega has a usual span")
    return a, b


def check_writable(path: Path | None, allowed: tuple[str, ...]) -> None:
    """Refuse now what could not be written when the work is done."""
    if path is None:
        return
    if path.suffix.lower() not in allowed:
        *others, final = allowed
        endings = f"{', '.join(others)} or {final}" if others else final
        raise ValueError(f"cannot write '{path}': the name must end in {endings}")
    if not path.parent.is_dir():
        raise ValueError(f"cannot write '{path}': there is no folder '{path.parent}'; create it first")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        what = "it is a folder" if path.is_dir() else f"you may not write in '{path.parent}'"
        raise ValueError(f"cannot write '{path}': {what}; give another name")


def point_of(branch: hb.Branch, text: str) -> hb.Point:
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


def chosen_model(name: str, changes: list[str] | None) -> hb.Model:
    """The model of MODEL with the values of --set."""
    return catalogue.build(name, **fields_of(catalogue.MODELS.get(name), changes or []))


def problem_of(model: hb.Model, harmonics: str, **settings: Any) -> hb.HarmonicBalance:
    """Harmonic balance with the harmonics of --harmonics, a number or auto."""
    if harmonics != "auto" and not (harmonics.isdecimal() and int(harmonics) >= 1):
        raise ValueError(f"--harmonics {harmonics}: need a whole number of at least 1, or auto")
    return hb.HarmonicBalance(model, harmonics if harmonics == "auto" else int(harmonics), **settings)


# ---- work


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra on one thread: the matrices are too small to gain from more."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        yield


@contextmanager
def reporting() -> Iterator[Callable[[str], None] | None]:
    """Shows lines of progress on a terminal, the last one beside a spinner; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("starting") as status:
        yield lambda line: status.update(line)


def exit_code(branch: hb.Branch) -> int:
    """0 if the end was reached, else 3."""
    return 0 if branch.status.complete else STOPPED_EARLY


def save_branch(branch: hb.Branch, path: Path | None) -> None:
    """Save or export by the suffix."""
    if path is not None:
        branch.save(path) if path.suffix.lower() == ".npz" else branch.export(path)


def traced(problem: hb.HarmonicBalance, parameter: str, span: tuple[float, float], **options: Any) -> hb.Branch:
    """A curve, traced with a progress bar and one thread for linear algebra."""
    with one_thread(), progress_bar(parameter, *span) as progress:
        return hb.trace(problem, parameter, span, progress=progress, **options)


@contextmanager
def progress_bar(parameter: str, a: float, b: float) -> Iterator[Progress | None]:
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


def draw(path: Path, make: Callable[[Any], Any]) -> None:
    """A figure to a file, without a window; make is given the module `hbgear.plot`."""
    import matplotlib

    matplotlib.use("Agg")
    from hbgear import plot as drawing

    drawing.save(make(drawing), path)


# ---- output


def wrote(*paths: Path | None) -> None:
    """Say which files were written."""
    if any(paths):
        print("wrote", ", ".join(str(path) for path in paths if path))


def print_text_table(table: Table) -> None:
    """A table; wide enough for all of it where no terminal sets the width."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 140, highlight=False).print(table)


def print_table(headers: list[str], rows: list[list[str]], title: str = "") -> None:
    """A table of texts."""
    print_text_table(table_of(headers, rows, title))


def table_of(headers: list[str], rows: list[list[str]], title: str = "") -> Table:
    """A table for the terminal."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, title=title or None, title_justify="left", title_style="bold")
    for i, header in enumerate(headers):
        table.add_column(header, overflow="fold", no_wrap=i < len(headers) - 1)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def show_branch(
    branch: hb.Branch,
    measure: str,
    element: int | str,
    beside: Sequence[hb.Branch] = (),
    names: Sequence[str] = (),
) -> None:
    """Tables of special points and jumps; see `show_jumps`."""
    if not branch.special:
        print("no special points")
        return
    rows = []
    for point in branch.special:
        place = [f"{point.parameters[name]:.8g}" for name in (branch.parameter, *branch.tracked)]
        place += [f"{value:.6g}" for value in speeds_of(branch, point).values()]
        amplitude = f"{point.amplitude(measure, element):.5g}"
        rows.append([point.label, *place, amplitude, regime_of(point), what_happens(branch, point)])
    headers = ["", branch.parameter, *branch.tracked, *speeds_of(branch, branch[0]), measure, "regime", "what happens"]
    print_table(headers, rows, "special points")
    show_jumps(branch, measure, element, beside, names)


def show_jumps(
    branch: hb.Branch,
    measure: str,
    element: int | str,
    beside: Sequence[hb.Branch] = (),
    names: Sequence[str] = (),
) -> None:
    """Print the jumps of a branch as a table, or that there are none.

    ``beside`` are other traced branches, with their names, on which a jump may land if its own curve has no stable
    motion there; the table then names the branch.
    """
    if not branch.jumps():
        print("no jumps" if branch.multipliers is not None else "no jumps known: traced without stability")
        return
    rows = []
    for landing in landings((branch, *beside))[0]:
        jump, where = landing.jump, landing.branch
        speeds = [f"{value:.6g}" for value in speeds_of(branch, jump.before).values()]
        before = f"{jump.before.amplitude(measure, element):.5g}"
        if where is None or jump.after is None:
            after = f"no stable motion on {'these curves' if beside else 'this curve'}"
        else:
            after = f"{jump.after.amplitude(measure, element):.5g}"
            after = f"{names[where - 1]}, {after}" if where else after
        direction = "increasing" if jump.direction > 0 else "decreasing"
        rows.append([jump.label, f"{jump.value:.8g}", *speeds, direction, before, after])
    headers = ["", branch.parameter, *speeds_of(branch, branch[0]), "while", f"{measure} before", f"{measure} after"]
    print_table(headers, rows, "jumps of a slow sweep")


def what_happens(branch: hb.Branch, point: hb.SpecialPoint) -> str:
    """A special point in words, with what it does to stability."""
    text = MEANINGS.get(point.kind, point.kind)
    if point.kind in ("PD", "NS") and branch.stable is not None and 0 < point.index < len(branch) - 1:
        before, after = branch.stable[point.index - 1], branch.stable[point.index + 1]
        text += "" if before == after else "; stability is lost" if before else "; stability is regained"
    where = "" if point.located else f" (only known to lie within {point.interval[0]:.8g} and {point.interval[1]:.8g})"
    return f"{text}{f' ({point.note})' if point.note else ''}{where}"


def regime_of(point: hb.Point) -> str:
    """Regime in words; laws without corners have none."""
    corners = point.layout is None or any(point.layout.breakpoints)
    return point.regime_name.replace("_sided", "-sided").replace("_", " ") if corners else "-"


def speeds_of(branch: hb.Branch, point: hb.Point) -> dict[str, float]:
    """Mesh frequency and speed of models that know their units."""
    return speeds_at(model_of(branch), point.parameters)


def facts_of(branch: hb.Branch, measure: str) -> Iterator[tuple[str, str]]:
    """What there is to say of a branch, name and text."""
    stable, layout = branch.stable, branch.layout
    settings = branch.meta.get("balance", {})
    yield "model", described(branch)
    yield "settings", ", ".join(f"{name} = {text_of(value)}" for name, value in settings.items() if value is not None)
    yield "held", ", ".join(f"{name} = {branch.fixed[name]:.6g}" for name in ("Omega",) if name in branch.fixed)
    yield "curve", f"{branch.parameter} from {branch.values[0]:.6g} to {branch.values[-1]:.6g}, {len(branch)} points"
    yield "status", f"{branch.status}: {branch.message}"
    if stable is None:
        yield "stability", "not computed"
    else:
        yield "stability", f"{int(stable.sum())} points stable, {int((~stable).sum())} unstable"
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


def described(branch: hb.Branch) -> str:
    """Model with the fields that differ from its defaults."""
    model, about = model_of(branch), branch.meta.get("model", {})
    if model is None:
        return f"{about.get('class', 'unknown')} (not one of hbgear models)"
    usual = type(model)()
    fields = [f.name for f in dataclasses.fields(model)]  # type: ignore[arg-type]
    changed = [f"{f}={text_of(getattr(model, f))}" for f in fields if getattr(model, f) != getattr(usual, f)]
    return f"{type(model).__name__}({', '.join(changed)}){'' if changed else ', all defaults'}"


def text_of(value: Any) -> str:
    """A value as --set would take it."""
    if isinstance(value, list | tuple):
        return f"({','.join(map(text_of, value))})"
    return f"{value:g}" if isinstance(value, float) else str(value)


def summary_of(cls: type) -> str:
    """First line of the docstring of a class, up to a semicolon."""
    return (inspect.getdoc(cls) or "").splitlines()[0].partition(";")[0].rstrip(".")


def equation_of(cls: type) -> str:
    """First indented line of the docstring of the class, or of its module."""
    for text in (inspect.getdoc(cls), inspect.getdoc(inspect.getmodule(cls))):
        for line in (text or "").partition("\nParameters\n")[0].splitlines():
            if line.startswith("    "):
                return re.sub(r"\s+", " ", line.strip())
    return ""
