"""Shared parts of the commands: options, progress, tables, files."""

from __future__ import annotations

import inspect
import math
import os
import re
import shutil
import sys
import textwrap
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import QUANTITIES, Ordinate, usual_measure
from hbgear.analysis.summary import jump_table, message_of, reliability_lines, special_table, text_of
from hbgear.cli import complete as cli_complete
from hbgear.cli.first import compile_in_parallel
from hbgear.cli.quantities import (
    Omega_of,
    changes_of,
    check_parameter,
    named,
    number_of,
    parameter_value,
    value_in_model,
)
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.text.messages import shortened
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.point import LANDINGS
from hbgear.harmonic.models import model_registry
from hbgear.harmonic.models.frequency_units import model_of
from hbgear.mechanics.fields import check_names, defaults_of, is_entry, kinds_of, made, required_of

if TYPE_CHECKING:
    from rich.table import Table


BAD_INPUT = 2
"""Exit code of bad input."""


STOPPED_EARLY = 3
"""Exit code of a command that was stopped or interrupted."""


Model = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help=f"One of: {', '.join(model_registry.MODELS)}; FILE.toml of a machine (see hbgear gear -o), train or "
        "structure; or your own FILE.py:NAME or MODULE:NAME, whose code is run.",
        autocompletion=cli_complete.models,
    ),
]


OwnModel = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="FILE.py:NAME",
        help="The model of the curve if it is not part of hbgear; its code is run. Loading a curve runs no code.",
    ),
]


File = Annotated[Path, typer.Argument(metavar="FILE", help="A curve saved as .npz by hbgear trace -o or Branch.save.")]


Output = Annotated[Path | None, typer.Option("-o", "--output", help="Save as .npz, or export .csv or .mat.")]


AllowCode = Annotated[
    bool,
    typer.Option("--allow-code", help="Run the code of a model FILE.py:NAME or MODULE:NAME that the file names."),
]


Figure = Annotated[Path | None, typer.Option(help="Draw to a .png, .pdf or .svg.")]


Landing = Annotated[
    str,
    typer.Option(
        "--landing",
        metavar="nearest|integrate",
        help="How to determine where a jump lands: the nearest stable motion, or the end of an integration in time.",
    ),
]

OtherCurves = Annotated[
    list[Path] | None,
    typer.Option("--with", metavar="FILE", help="Another saved curve on which jumps may land; repeatable."),
]

Measure = Annotated[
    str,
    typer.Option(
        help="Amplitude: pp2 (half peak-to-peak), rms, max, mean, H1, H2, ...", autocompletion=cli_complete.amplitudes
    ),
]


ShownMeasure = Annotated[
    str | None,
    typer.Option(
        "--measure",
        help="Amplitude pp2 (half peak-to-peak), rms, max, mean, H1, ...; or dte (dynamic transmission error), "
        "'dynamic factor', force.",
        autocompletion=cli_complete.amplitudes,
        show_default="dte if the model has scales, else pp2",
    ),
]


Dimensionless = Annotated[
    bool,
    typer.Option("--dimensionless", help="Show Omega and amplitudes in the unit of the model, not r/min, um and N."),
]


Element = Annotated[str, typer.Option(help="Element, by number from 0 or by name.")]


Harmonics = Annotated[str, typer.Option(help="Harmonics H of the excitation frequency; trace also accepts auto.")]


Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a field of the model; repeatable.",
        autocompletion=cli_complete.fields,
    ),
]


First = Annotated[
    str | None,
    typer.Option("--from", help="Start: Omega, or a speed such as 9000r/min or 2500Hz.", show_default="from the model"),
]


Last = Annotated[
    str | None,
    typer.Option("--to", help="End: Omega, or a speed such as 9000r/min or 2500Hz.", show_default="from the model"),
]


def range_option(text: str) -> Any:
    """Return the option --in of a command that needs a parameter and its range; ``text`` is its help."""
    return typer.Option("--in", metavar="NAME=FROM:TO", help=text, autocompletion=cli_complete.fields)


Within = Annotated[
    str | None,
    typer.Option(
        "--in",
        metavar="NAME=FROM:TO",
        help="Vary this field of the model instead of Omega; see --at.",
        autocompletion=cli_complete.assigned,
    ),
]


At = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Fix a parameter, such as Omega=0.9; repeatable.",
        autocompletion=cli_complete.assigned,
    ),
]


def print_message(kind: str, text: object) -> None:
    """Print one line on standard error; long words, which damaged files contain, are shortened."""
    with suppress(OSError):  # standard error cannot be written: the exit code remains
        print(f"hbgear: {kind}: {' '.join(shortened(word, 1000) for word in str(text).split())}", file=sys.stderr)


def discard_unwritable(stream: Any) -> None:
    """Redirect a stream that cannot be written to the null device; otherwise Python tries again at exit."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


# ---- input


def assignments(option: str, texts: list[str]) -> list[tuple[str, str]]:
    """Return ``name=value`` pairs; each name occurs once."""
    pairs: list[tuple[str, str]] = []
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise ValueError(f"{option} {text}: need NAME=VALUE, such as {option} {name or 'zeta'}=0.05")
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
    labels = {} if model is None else model.labels
    ends_of = [parameter_value(labels, "--in", name, text) for text in (low, high)]
    return name, (ends_of[0], ends_of[1])


def path_of(
    model: hb.mechanics.Model, within: str | None, first: str | None, last: str | None, at: list[str] | None,
    known: bool = False,
) -> tuple[str, tuple[float, float], dict[str, float]]:  # fmt: skip
    """Return the continuation parameter, its span and the fixed parameters.

    The parameter is Omega, or that of --in; then Omega must be fixed by --at or ``known`` from a starting point.
    """
    held = {named(name): value_in_model(model, "--at", name, text) for name, text in assignments("--at", at or [])}
    if within is None:
        parameter, span = "Omega", span_of(model, first, last)
    else:
        parameter, span = range_of(within, model, first, last)
        if first is not None or last is not None:
            raise ValueError(
                f"--in {within}: {parameter} is the continuation parameter; omit --from and --to, which are in Omega"
            )
    if parameter in held:
        instead = "--from and --to" if parameter == "Omega" else f"--set {parameter} or --in {parameter} alone"
        raise ValueError(f"--at {parameter}: {parameter} is the continuation parameter; use {instead}")
    if parameter != "Omega" and not known and "Omega" not in held:
        raise ValueError(f"--in {parameter}=...: a fixed frequency is required: --at Omega=0.9")
    return parameter, span, held


def value_of(what: str, text: str, kind: Any) -> Any:
    """Convert a text to the type of a field; ``what`` names it in errors."""
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
        inner = text.strip("()[] ").removesuffix(",").strip()
        parts = re.split(r"\s*,\s*|\s+", inner) if inner else []
        if "" in parts:
            raise ValueError(f"{what}={text}: a number is missing between two commas")
        return tuple(number_of(what, part) for part in parts)
    return text


def loaded(
    file: Path, measure: str | None, element: str, dimensionless: bool = False
) -> tuple[hb.Branch, int | str, str]:
    """Load a branch and return it with its element and its measure, by default `usual_measure`.

    An unknown measure or element is refused before anything is printed.
    """
    branch, which = hb.load(file), element_of(element)
    chosen = measure or usual_measure(branch, dimensionless)
    height = Ordinate(chosen, which, dimensionless=dimensionless)
    height.at(height.prepared(branch)[0], branch)
    return branch, which, chosen


def check_shown(problem: hb.HarmonicBalance, measure: str | None, element: int | str) -> None:
    """Refuse an unknown element or --measure before any computation."""
    problem.layout.index(element)
    if measure is not None and measure not in QUANTITIES:
        problem.layout.check_measure(measure, element)


def check_landing(landing: str) -> None:
    """Refuse an unknown --landing before any computation."""
    if landing not in LANDINGS:
        raise ValueError(f"--landing {landing}: need {' or '.join(LANDINGS)}")


def with_landings(
    landing: str, branch: hb.Branch, problem: Any = None, others: Sequence[hb.Branch] = ()
) -> tuple[hb.Branch, bool]:
    """Return the branch with landings as --landing requires, and True; unchanged with False after Ctrl-C or errors."""
    if landing == "nearest" or not branch.jumps():
        return branch, True
    from hbgear.time.jump_integration import integrate_jumps

    try:
        with bar("jumps") as progress:
            return integrate_jumps(branch, others, problem=problem, progress=progress), True
    except (KeyboardInterrupt, ValueError, ArithmeticError) as error:
        reason = "interrupted" if isinstance(error, KeyboardInterrupt) else f"jumps cannot be integrated: {error}"
        print_message("error", f"{reason}; the nearest motions are shown as landings")
        return branch, False


def element_of(text: str) -> int | str:
    """Return the number or the name of an element given on the command line."""
    return int(text) if text.isdecimal() else text


def span_of(model: hb.mechanics.Model, first: str | None, last: str | None) -> tuple[float, float]:
    """Return the span of Omega; an end that is not given is taken from the model."""
    a, b = model.default_span
    return (a if first is None else Omega_of(model, "--from", first),
            b if last is None else Omega_of(model, "--to", last))  # fmt: skip


def longer_span(branch: hb.Branch, within: str | None, first: str | None, last: str | None) -> tuple[float, float]:
    """Return the span of a curve, in its own parameter, with the given ends replaced."""
    a, b = branch.meta.get("trace", {}).get("span") or (branch.values[0], branch.values[-1])
    model = model_of(branch)
    if within is not None:
        name, (low, high) = range_of(within, model)
        if name != branch.parameter:
            raise ValueError(f"--in {within}: this curve is in {branch.parameter}; give a longer span of it")
        return low, high
    if branch.parameter != "Omega" and (first is not None or last is not None):
        raise ValueError(f"this curve is in {branch.parameter}: give its range as --in {branch.parameter}=FROM:TO")
    ends = [float(end) if text is None else _frequency(model, option, text)
            for end, text, option in ((a, first, "--from"), (b, last, "--to"))]  # fmt: skip
    return ends[0], ends[1]


def _frequency(model: hb.mechanics.Model | None, option: str, text: str) -> float:
    return number_of(option, text) if model is None else Omega_of(model, option, text)


def metadata_with(meta: dict[str, Any], harmonics: str | None, samples: int | None) -> dict[str, Any]:
    """Return the metadata of a file with other harmonics or samples."""
    balance = dict(meta.get("balance", {}))
    if harmonics is not None:
        balance = {**balance, "harmonics": harmonics_of(harmonics), "samples": None, "auto": None}
    if samples is not None:
        balance = {**balance, "samples": samples}
    return {**meta, "balance": balance} if balance else meta


def start_of(text: str) -> tuple[hb.Branch, hb.Point]:
    """Return a saved curve and its point given by --start: a label, a value of its parameter, or the last point."""
    file, colon, which = (text, "", "") if os.path.exists(text) else text.rpartition(":")
    branch = hb.load(file if colon else text)
    return branch, point_of(branch, which, "--start") if colon else branch[-1]


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
    if values is None and isinstance(type(model).parameters, property) and not _has_own_names(model):
        values = fields_of(type(model), changes or [])
    if values is None:
        for name, _ in pairs:
            check_parameter(model, name)
    return model.replace(**(values or {}))


def _has_own_names(model: hb.mechanics.Model) -> bool:
    """Return whether parameters of a model are no fields of its class."""
    return any(name not in kinds_of(type(model)) for name in model.parameters)


def point_of(branch: hb.Branch, text: str, option: str = "--point") -> hb.Point:
    """Return a special point by label, or the point nearest to a value; of several crossings, a stable one."""
    try:
        value = float(text)
    except ValueError:
        return branch[text]
    low, high = float(branch.values.min()), float(branch.values.max())
    if not low <= value <= high:
        raise ValueError(
            f"{option} {text}: the curve runs from {low:.6g} to {high:.6g} in {branch.parameter}; choose there"
        )
    near = [crossing.nearest for crossing in crossings_at(branch, value)] or [0]  # of a single point
    return branch[min(near, key=lambda i: branch[i].stable is not True)]


def chosen_model(name: str, changes: list[str] | None) -> hb.mechanics.Model:
    """Return the model of MODEL, by name or from a file, with the values of --set."""
    if name.endswith(".toml"):
        return changed(_model_in(name), changes)
    cls = model_registry.model_class(name)
    fields = fields_of(cls, changes or [])
    missing = [field for field in required_of(cls) if field not in fields]
    if missing:
        needed = " ".join(f"--set {field}=VALUE" for field in missing)
        raise ValueError(f"the model '{name}' needs {', '.join(missing)}, which have no default: {needed}")
    return made(cls, fields)


def _model_in(path: str) -> hb.mechanics.Model:
    """Return the model of a file: a train, a structure (matrices or receptances), or a gear pair."""
    from hbgear.io.machines.machine_file import read_machine
    from hbgear.io.machines.structure_file import is_structure, read_structure
    from hbgear.io.machines.train_file import is_train, read_train

    if is_train(path):
        return read_train(path)
    return read_structure(path) if is_structure(path) else read_machine(path).model()


def problem_in(branch: hb.Branch, name: str | None, harmonics: str | None = None, samples: int | None = None) -> Any:
    """Rebuild the problem of a saved curve, with the model class of --model, other harmonics or samples."""
    cls = None if name is None else model_registry.model_class(name)
    return model_registry.rebuild_problem(metadata_with(branch.meta, harmonics, samples), cls)


def load_with_problem(file: Path, name: str | None) -> hb.Branch:
    """Load a curve with its problem, which needs the metadata of the file and the model class of --model."""
    return hb.load(file, problem=problem_in(hb.load(file), name))


def problem_of(model: hb.mechanics.Model, harmonics: str, **settings: Any) -> hb.HarmonicBalance:
    """Return a harmonic balance with the harmonics of --harmonics, a number or auto."""
    return hb.HarmonicBalance(model, harmonics_of(harmonics), **settings)


def harmonics_of(text: str) -> int | str:
    """Return the value of --harmonics."""
    if text != "auto" and not (text.isdecimal() and int(text) >= 1):
        raise ValueError(f"--harmonics {text}: need a whole number of at least 1, or auto")
    return text if text == "auto" else int(text)


# ---- work


@contextmanager
def bar(what: str) -> Iterator[ProgressCallback | None]:
    """Show progress on a terminal: a bar where the fraction is known, the elapsed time and a text."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Display

    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn("{task.fields[text]}")
    with Display(*columns, console=Console(stderr=True), transient=True) as display:
        task = display.add_task(what, total=None, text="")

        def show(now: Progress) -> None:
            known = not math.isnan(now.done)
            display.update(task, total=1.0 if known else None, completed=now.done if known else 0.0, text=now.text)

        yield show


def exit_code(branch: hb.Branch) -> int:
    """Return 0 if this curve and all others of its span were traced to their ends, else 3."""
    return 0 if all(one.status.complete for one in (branch, *branch.others)) else STOPPED_EARLY


def finish(result: Any, *parts: Any) -> None:
    """Print a message if a result is not complete, and end the command with the exit code of it and its parts.

    Raises
    ------
    typer.Exit
        With 3 if any has a status that is not complete, else 0.
    """
    if not result.status.complete:
        print_message("stopped early", result.message)
    raise typer.Exit(0 if all(one.status.complete for one in (result, *parts)) else STOPPED_EARLY)


def traced(problem: hb.HarmonicBalance, parameter: str, span: tuple[float, float], **options: Any) -> hb.Branch:
    """Trace a curve with a progress bar."""
    other_branches = compile_in_parallel() if options.get("stability", True) else nullcontext()
    with bar(parameter) as progress, other_branches:
        return hb.trace(problem, parameter, span, progress=progress, **options)


# ---- output


def print_text_table(table: Table) -> None:
    """Print a table, with a width of 140 columns where no terminal sets the width."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 140, highlight=False).print(table)


def print_table(headers: list[str], rows: list[list[str]], title: str = "") -> None:
    """Print a table of texts; on a terminal that is too narrow, one line for each cell."""
    width = shutil.get_terminal_size().columns
    if sys.stdout.isatty() and _least_width(headers, rows) > width:
        print(listed(headers, rows, title, width))
    else:
        print_text_table(table_of(headers, rows, title))


_COLUMN_MARGIN = 3  # characters around a column of a table


def _least_width(headers: list[str], rows: list[list[str]]) -> int:
    """Return the characters that a table needs: whole cells, and whole words in its last column."""
    columns = list(zip(headers, *rows, strict=True))
    widths = [max(len(line) for cell in column for line in cell.splitlines() or [""]) for column in columns[:-1]]
    last = max(len(word) for cell in columns[-1] for word in cell.split() or [""])
    return sum(widths) + last + _COLUMN_MARGIN * len(columns)


def print_text(text: str) -> None:
    """Print a sentence; on a terminal, lines end between words."""
    if sys.stdout.isatty():
        width = shutil.get_terminal_size().columns
        wrapped = (textwrap.wrap(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
                   for line in text.splitlines())  # fmt: skip
        text = "\n".join("\n".join(lines) for lines in wrapped)
    print(text)


def listed(headers: list[str], rows: list[list[str]], title: str, width: int) -> str:
    """Return the cells of a table one below the other, each after its header, for a narrow terminal."""
    lines = [title] if title else []
    for row in rows:
        lines += [""] if lines else []
        for header, cell in zip(headers, row, strict=True):
            first, *rest = cell.splitlines() or [""]
            for text in (f"{header}: {first}" if header else first, *(f"  {part}" for part in rest)):
                lines += textwrap.wrap(text, width, subsequent_indent="  ", break_long_words=False,
                                       break_on_hyphens=False) or [""]  # fmt: skip
    return "\n".join(lines)


def table_of(headers: list[str], rows: list[list[str]], title: str = "") -> Table:
    """Return a table for the terminal."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, title=Text(title) if title else None, title_justify="left", title_style="bold")
    for i, header in enumerate(headers):
        table.add_column(Text(header), overflow="fold", no_wrap=i < len(headers) - 1)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def show_all_branches(
    branch: hb.Branch, measure: str | None, element: int | str, show: Callable[..., None] | None = None,
    dimensionless: bool = False,
) -> None:  # fmt: skip
    """Print the tables of a curve and of the other curves of its span, with `show_branch` or another function."""
    curves = (branch, *branch.others)
    for number, curve in enumerate(curves, 1):
        if number > 1:
            print_text(f"\nbranch {number}: {len(curve)} points; {message_of(curve, dimensionless)}")
        others = [i for i in range(len(curves)) if i != number - 1]
        other_branches, names = [curves[i] for i in others], [f"branch {i + 1}" for i in others]
        (show or show_branch)(curve, measure, element, other_branches, names, dimensionless)


def show_branch(
    branch: hb.Branch,
    measure: str | None,
    element: int | str,
    other_branches: Sequence[hb.Branch] = (),
    names: Sequence[str] = (),
    dimensionless: bool = False,
) -> None:
    """Print the tables of special points and jumps (see `show_jumps`), and the reliability of the curve."""
    if not branch.special:
        print_text("no special points")
        show_reliability(branch)
        return
    headers, rows = special_table(branch, measure, element, dimensionless)
    print_table(headers, rows, "special points")
    show_jumps(branch, measure, element, other_branches, names, dimensionless)
    show_reliability(branch)


def show_reliability(branch: hb.Branch) -> None:
    """Print the estimated errors and warnings of a curve, and how to fix them."""
    lines = reliability_lines(branch)
    for line in lines:
        print_text(line)
    if branch.warnings and lines:
        print_text("  use more harmonics: --harmonics 32 or auto")


def show_jumps(
    branch: hb.Branch,
    measure: str | None,
    element: int | str,
    other_branches: Sequence[hb.Branch] = (),
    names: Sequence[str] = (),
    dimensionless: bool = False,
) -> None:
    """Print the jumps of a branch as a table, or that it has none; see `jump_table`."""
    if not branch.jumps():
        print_text("no jumps" if branch.multipliers is not None else "jumps unknown: traced without stability")
        return
    headers, rows, notes = jump_table(branch, measure, element, other_branches, names, dimensionless)
    print_table(headers, rows, "jumps of a slow sweep")
    for note in notes:
        print_text(note)


def summary_of(cls: type) -> str:
    """Return the first line of the docstring of a class, up to a semicolon."""
    return next(iter((inspect.getdoc(cls) or "").splitlines()), "").partition(";")[0].rstrip(".")


def defaults_text(cls: type[hb.mechanics.Model]) -> str:
    """Return the fields in the form of --set, with their defaults; VALUE for a required field."""
    defaults = defaults_of(cls)
    return ", ".join(f"{name}={text_of(defaults[name]) if name in defaults else 'VALUE'}" for name in kinds_of(cls))


def ranges_of(cls: type[hb.mechanics.Model]) -> str:
    """Return the ranges of the parameters, the parameters of one range together."""
    names: dict[str, list[str]] = {}
    for name, allowed in cls.ranges.items():
        names.setdefault(str(allowed), []).append(name)
    return "; ".join(f"{', '.join(each)} must {need}" for need, each in names.items())


def equation_of(cls: type) -> str:
    """Return the first indented line of the docstring of the class, or of its module within hbgear."""
    module = inspect.getmodule(cls) if cls.__module__.startswith("hbgear.") else None
    for text in (inspect.getdoc(cls), inspect.getdoc(module) if module else None):
        for line in (text or "").partition("\nParameters\n")[0].splitlines():
            if line.startswith("    "):
                return re.sub(r"\s+", " ", line.strip())
    return ""
