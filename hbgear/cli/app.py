"""The command ``hbgear``: trace, inspect and draw response curves. Each command calls a function of the library.

Exit codes: 0, the end was reached; 2, bad input, with one line that states how to fix it; 3, stopped early, and all
results up to that point are saved. Ctrl-C and SIGTERM stop any command. Modules that are slow to import (matplotlib,
rich) are imported when they are needed.
"""

from __future__ import annotations

import atexit
import dataclasses
import re
import shutil
import signal
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.models import CommandInfo

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import kind_of
from hbgear.analysis.summary import in_speeds, message_of, position_headers, position_texts, summary_facts
from hbgear.cli import complete as cli_complete
from hbgear.cli import pages as cli_pages
from hbgear.cli.commands import certify as cli_certify
from hbgear.cli.commands import design as cli_design
from hbgear.cli.commands import fit as cli_fit
from hbgear.cli.commands import gear as cli_gear
from hbgear.cli.commands import motions as cli_motions
from hbgear.cli.commands import rotors as cli_rotors
from hbgear.cli.commands import study as cli_study
from hbgear.cli.commands import time as cli_time
from hbgear.cli.commands.files import BRANCHES, FIGURES, check_writable, outputs
from hbgear.cli.options import (
    At,
    Changes,
    Dimensionless,
    Element,
    File,
    First,
    Harmonics,
    Landing,
    Last,
    Model,
    OtherCurves,
    Output,
    OwnModel,
    ShownMeasure,
    Within,
)
from hbgear.cli.output import (
    BAD_INPUT,
    STOPPED_EARLY,
    bar,
    defaults_text,
    discard_unwritable,
    equation_of,
    exit_code,
    print_message,
    print_table,
    print_text,
    ranges_of,
    show_all_branches,
    show_jumps,
    show_path,
    summary_of,
)
from hbgear.cli.startup import STDOUT_CLOSED
from hbgear.cli.support import (
    check_landing,
    check_shown,
    chosen_model,
    element_of,
    harmonics_of,
    loaded,
    longer_span,
    model_at,
    path_of,
    point_of,
    problem_in,
    problem_of,
    start_of,
    traced,
    with_landings,
)
from hbgear.common.atomic_write import CannotWrite
from hbgear.common.process.signals import sigterm_like_ctrl_c
from hbgear.continuation.events.registry import optional_events
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.models import model_registry
from hbgear.harmonic.models.frequency_units import model_of
from hbgear.mechanics.model_lookup import installed
from hbgear.plot.style import STYLES

RENAMED = {
    "--parameter": "--parameter F --from A --to B is now --in F=A:B, as --from and --to are always in Omega",
    "--omega-from": "--omega-from is now --from",
    "--omega-to": "--omega-to is now --to",
}
"""Options of version 0.1 that are refused, with the option that replaces each."""


COMMAND_ALIASES = {"answers": "results"}
"""Earlier names of commands that still work, without an entry in the help."""


OPTION_ALIASES = {
    "survey": {"--places": "--frequencies"},
    "sweep": {"--longest": "--max-periods", "--over": "--curve"},
    "basins": {"--longest": "--max-periods"},
}
"""Options of version 0.2 that still work, without an entry in the help, by command."""


COMMAND_GROUPS = {
    "Gears and models": ("gear", "speed", "models"),
    "Response curves": ("trace", "plot", "jumps", "info", "results", "extend", "report", "explore"),
    "Further motions": ("switch", "survey", "follow", "backbone", "cycles", "torus", "campbell"),
    "Jumps and design": ("map", "critical", "sensitivity", "scatter", "redesign", "study", "fit"),
    "Validation": ("validate", "sweep", "basins", "certify"),
}
"""Commands by the heading under which the help lists them, in its order."""


CTRL_C_CODE = 130
"""Exit code that typer returns for a Ctrl-C that no command handles."""


MIN_FRAME_WIDTH = 60
"""Width of a terminal [columns] below which help is printed without frames, which would cut words."""

_columns = shutil.get_terminal_size().columns


class _Commands(TyperGroup):
    """The commands, with their earlier names and options."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the command and its arguments, with earlier names replaced by the present ones."""
        if args:
            args = [COMMAND_ALIASES.get(args[0], args[0]), *args[1:]]
            options = OPTION_ALIASES.get(args[0], {})
            for i, (option, equals, value) in enumerate(arg.partition("=") for arg in args):
                args[i] = options.get(option, option) + equals + value
        return super().resolve_command(ctx, args)


app = typer.Typer(
    cls=_Commands,
    name="hbgear",
    rich_markup_mode=None if _columns < MIN_FRAME_WIDTH else "rich",
    help="Nonlinear frequency response of gear drives with backlash.",
    epilog="Example: hbgear trace double-helical -o curve.npz, then hbgear plot curve.npz",
    pretty_exceptions_enable=False,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "terminal_width": _columns - 1 if _columns < MIN_FRAME_WIDTH else None,
    },
)


def main(args: Sequence[str] | None = None) -> None:
    """Run the command and exit."""
    with sigterm_like_ctrl_c(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of libraries: users of a command cannot act on them
        warnings.showwarning = lambda message, *_, **__: print_message("warning", message)
        code = _output_exit_code(_run(list(sys.argv[1:] if args is None else args) or ["--help"]))
        atexit.register(_ignore_interrupts)  # registered last, so that it runs first
        sys.exit(code)


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C while Python ends: the result is complete, only temporary files are removed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _output_exit_code(code: int) -> int:
    """Return the exit code: 2 if the output could not be written."""
    if STDOUT_CLOSED and code != BAD_INPUT:
        return _report_unwritable("standard output is closed")
    try:
        sys.stdout.flush()
    except OSError as error:
        code = _report_unwritable(error.strerror)
    discard_unwritable(sys.stderr)
    return code


def _report_unwritable(reason: str | None) -> int:
    """Print an error: the result could not be printed. Return the exit code."""
    print_message("error", f"the result could not be printed ({reason}); the output files are written")
    discard_unwritable(sys.stdout)
    return BAD_INPUT


def _is_unwritable() -> bool:
    """Return whether standard output refuses to be written."""
    try:
        sys.stdout.write("\n")
        sys.stdout.flush()
    except OSError:
        return True
    return False


def _error_text(error: Exception) -> object:
    """Return the message of an error; errors of the operating system and of libraries have no number."""
    if isinstance(error, KeyError):
        return error.args[0]
    if not isinstance(error, OSError) or error.strerror is None:
        return error
    if isinstance(error, FileNotFoundError) and not _current_folder_exists():  # libraries read it while imported
        return "the current folder does not exist any more; change to another one"
    return error.strerror if error.filename is None else f"'{error.filename}': {error.strerror}"


def _current_folder_exists() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return False
    return True


def _run(args: list[str]) -> int:
    try:
        code = int(app(args, prog_name="hbgear", standalone_mode=False) or 0)
        if code == CTRL_C_CODE:
            raise KeyboardInterrupt
        return code
    except (ValueError, KeyError, OSError, hb.NoConvergence) as error:
        is_stream_error = isinstance(error, OSError) and error.errno is not None and error.filename is None
        if is_stream_error and not isinstance(error, CannotWrite) and _is_unwritable():
            return _report_unwritable(getattr(error, "strerror", None))
        for problem in getattr(error, "problems", [_error_text(error)]):
            print_message("error", problem)
        return BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):  # nothing to keep, or the user refused to continue
        print_message("error", "stopped before the end")
        return STOPPED_EARLY
    except Exception as error:  # typer: an unknown option or command; any other exception is a bug
        if not hasattr(error, "format_message"):
            raise
        message = RENAMED.get(getattr(error, "option_name", ""), error.format_message().rstrip("."))
        print_message("error", f"{message}; see hbgear --help or hbgear COMMAND --help")
        return BAD_INPUT


for commands in (
    cli_design, cli_fit, cli_study, cli_time, cli_certify, cli_gear, cli_pages, cli_rotors, cli_motions,
):  # fmt: skip
    commands.register(app)


# ---- commands

Plot = Annotated[Path | None, typer.Option(help="Draw the curve to a .png, .pdf or .svg.")]

Events = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Locate these special points, too: "
        f"{'; '.join(f'{name}, {entry.meaning}' for name, entry in optional_events().items())}; "
        "and those that FILE.py of the model registers. Repeat for several.",
        autocompletion=cli_complete.events,
    ),
]


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        print(hb.__version__)
        raise typer.Exit


@app.command()
def models(
    model: Annotated[
        str | None, typer.Argument(metavar="[MODEL]", help="Only this model, such as your own FILE.py:NAME.")
    ] = None,
) -> None:
    """List the models, their equations and their parameters with defaults; VALUE marks a required parameter.

    The list includes models of installed packages with entry points hbgear.models.
    """
    rows = []
    for name in [*model_registry.MODELS, *installed()] if model is None else [model]:
        try:
            cls = model_registry.model_class(name)
        except ValueError as error:
            if model is not None:
                raise
            print_message("warning", error)  # a broken package does not hide the others
            continue
        lines = [summary_of(cls), equation_of(cls), defaults_text(cls), ranges_of(cls)]
        about = "\n".join(line for line in lines if line or cls.__module__.startswith("hbgear."))
        rows.append([f"{name}\n{cls.__name__}", f"{about}\n"])
    print_table(["model", "equation, parameters with defaults (change them with --set)"], rows)


@app.command()
def trace(
    model: Model,
    changes: Changes = None,
    first: First = None,
    last: Last = None,
    within: Within = None,
    at: At = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="FILE[:POINT]", help="Begin at a point (label or value) of a saved curve."),
    ] = None,
    harmonics: Harmonics = "16",
    tolerance: Annotated[
        float, typer.Option(help="Largest estimated error of the motion for --harmonics auto.")
    ] = 1e-6,
    orders: Annotated[
        str,
        typer.Option(help="meshes: only the harmonics of each mesh of a train and their combinations; default: all."),
    ] = "",
    samples: Annotated[
        int | None, typer.Option(min=1, help="Samples N per period, at least 2H+1.", show_default="chosen from H")
    ] = None,
    sampled: Annotated[
        bool, typer.Option("--sampled", help="Sample contact forces (AFT) instead of projecting them exactly.")
    ] = False,
    instants: Annotated[
        bool,
        typer.Option("--instants", help="Solve in contact instants instead of harmonics: hard stops, no truncation."),
    ] = False,
    measure: ShownMeasure = None,
    element: Element = "0",
    dimensionless: Dimensionless = False,
    output: Output = None,
    plot: Plot = None,
    stability: Annotated[
        bool, typer.Option("--stability/--no-stability", help="Compute Floquet multipliers and jumps.")
    ] = True,
    max_points: Annotated[
        int, typer.Option(min=2, help="Number of points after which the trace stops.")
    ] = hb.StepControl().max_points,
    predictor_points: Annotated[
        int, typer.Option(min=1, help="Previous points used by the Hermite predictor; 1: tangent predictor.")
    ] = hb.StepControl().predictor_points,
    landing: Landing = "nearest",
    accuracy: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Target relative error of special points, reached with more harmonics where needed; 0: no target.",
        ),
    ] = 1e-5,
    event: Events = None,
) -> None:
    """Trace a response curve through its folds; print its special points and jumps.

    Linear algebra uses one thread: the matrices are too small to gain from more. Ctrl-C stops the trace and keeps all
    points. Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (all traced points are saved).
    """
    for path, allowed in ((output, BRANCHES), (plot, FIGURES)):
        check_writable(path, allowed)
    check_landing(landing)
    machine = chosen_model(model, changes)
    point, nu = None, 1
    if start is not None:
        curve, point = start_of(start)
        layout = layout_of(curve)
        machine, nu = model_at(curve, point, model, changes), layout.nu if layout else 1
    if instants:
        if sampled or samples is not None or orders or harmonics == "auto":
            raise ValueError(
                "--instants has no samples and no choice of harmonics: leave out --sampled, --samples, --orders, and "
                "give --harmonics as a number"
            )
        problem: hb.HarmonicBalance = hb.ContactInstants(machine, int(harmonics_of(harmonics)), nu=nu)
    else:
        problem = problem_of(
            machine, harmonics, nu=nu, samples=samples, sampled=sampled, tolerance=tolerance, orders=orders or None
        )
    parameter, span, fixed = path_of(machine, within, first, last, at, has_start=point is not None)
    if point is not None:  # otherwise its parameter values would override those of --set
        fixed = {name: value for name, value in problem.parameters.items() if name != parameter} | fixed
    problem.check_parameter(parameter)
    element_id = element_of(element)
    check_shown(problem, measure, element_id)

    started = time.perf_counter()
    try:
        branch = traced(
            problem,
            parameter,
            span,
            start=point,
            at=fixed,
            stability=stability,
            steps=hb.StepControl(max_points=max_points, predictor_points=predictor_points),
            accuracy=accuracy or None,
            events=event or (),
        )
    except KeyboardInterrupt:  # outside the trace, which keeps its points
        print_message("error", "interrupted before the first point or after the last; nothing was kept")
        raise typer.Exit(STOPPED_EARLY) from None
    seconds = time.perf_counter() - started
    branch, is_complete = with_landings(landing, branch)
    with outputs() as out:
        out.branch(output, branch)
        out.figure(plot, lambda drawing: drawing.response(branch, measure, element_id, dimensionless=dimensionless))
        print_text(f"{model}: {len(branch)} points in {seconds:.1f} s; {message_of(branch, dimensionless)}")
        show_all_branches(branch, measure, element_id, dimensionless=dimensionless)
    raise typer.Exit(exit_code(branch) if is_complete else STOPPED_EARLY)


@app.command()
def extend(
    file: File,
    model: OwnModel = None,
    first: Annotated[
        str | None,
        typer.Option("--from", help="Omega or speed at which a longer span begins.", show_default="from the curve"),
    ] = None,
    last: Annotated[
        str | None,
        typer.Option("--to", help="Omega or speed at which a longer span ends.", show_default="from the curve"),
    ] = None,
    within: Annotated[
        str | None,
        typer.Option(
            "--in",
            metavar="NAME=FROM:TO",
            help="A longer span of a curve in another parameter than Omega.",
            show_default="from the curve",
        ),
    ] = None,
    harmonics: Annotated[
        str | None, typer.Option(help="H of the new points, or auto.", show_default="from the curve")
    ] = None,
    samples: Annotated[
        int | None, typer.Option(min=1, help="Samples N per period.", show_default="from the curve")
    ] = None,
    measure: ShownMeasure = None,
    element: Element = "0",
    dimensionless: Dimensionless = False,
    output: Output = None,
    plot: Plot = None,
    max_points: Annotated[
        int, typer.Option(min=2, help="Largest number of points to add.")
    ] = hb.StepControl().max_points,
) -> None:
    """Continue the saved curves of a file from their last points; the result is the whole curves.

    By default to the end of its span; --from and --to, or --in for a curve in another parameter, set a longer span.
    Exit codes: as for hbgear trace.
    """
    for path, allowed in ((output, BRANCHES), (plot, FIGURES)):
        check_writable(path, allowed)
    branch, element_id, measure = loaded(file, measure, element, dimensionless)
    branch = dataclasses.replace(branch, problem=problem_in(branch, model))
    problem = problem_in(branch, model, harmonics, samples)
    span = longer_span(branch, within, first, last)
    with bar(branch.parameter) as progress:
        steps = hb.StepControl(max_points=max_points)
        try:
            extended = hb.extend(branch, span, problem=problem, steps=steps, progress=progress)
        except ValueError as error:
            raise ValueError(in_speeds(branch, str(error), dimensionless)) from None
    with outputs() as out:
        out.branch(output, extended)
        out.figure(plot, lambda drawing: drawing.response(extended, measure, element_id, dimensionless=dimensionless))
        count, more = (sum(len(curve) for curve in whole.curves) for whole in (branch, extended))
        print_text(f"{file}: {count} points, {more - count} more; {message_of(extended, dimensionless)}")
        show_all_branches(extended, measure, element_id, dimensionless=dimensionless)
    raise typer.Exit(exit_code(extended))


@app.command()
def info(
    file: File, measure: ShownMeasure = None, element: Element = "0", dimensionless: Dimensionless = False
) -> None:
    """Summarise a saved curve: model, status, special points, jumps and accuracy."""
    branch, element_id, measure = loaded(file, measure, element, dimensionless)
    rows = [[name, text] for name, text in summary_facts(branch, measure, dimensionless) if text]
    print_table(["", str(file)], rows)
    show_all_branches(branch, measure, element_id, dimensionless=dimensionless)


@app.command()
def jumps(
    file: File,
    model: OwnModel = None,
    landing: Landing = "nearest",
    other_branches: OtherCurves = None,
    doublings: Annotated[
        int | None,
        typer.Option(
            min=0, help="Print the paths of slow sweeps instead, through at most this number of period doublings."
        ),
    ] = None,
    measure: ShownMeasure = None,
    element: Element = "0",
    dimensionless: Dimensionless = False,
) -> None:
    """List the jumps of a slow sweep, with the amplitudes before and after, and how the landing was determined.

    By default a jump lands on the nearest stable motion; with --landing integrate, on the motion that integration in
    time reaches, with any period. With --doublings the sweeps in both directions are followed from jump to jump, also
    on motions of twice the period. Exit codes: 0 done, 2 bad input, 3 interrupted.
    """
    check_landing(landing)
    branch, element_id, measure = loaded(file, measure, element, dimensionless)
    other_curves = [hb.load(path) for path in other_branches or ()]
    problem = problem_in(branch, model) if landing == "integrate" and branch.jumps() else None
    branch, is_complete = with_landings(landing, branch, problem, other_curves)
    if doublings is not None:
        branch = dataclasses.replace(branch, problem=problem_in(branch, model))
        for direction in ("up", "down"):
            show_path(
                hb.analysis.run_up(branch, direction, other_curves, doublings), measure, element_id, dimensionless
            )
        raise typer.Exit(0 if is_complete else STOPPED_EARLY)
    if other_curves:
        names = [f"branch {i + 2}" for i in range(len(branch.others))] + [path.name for path in other_branches or ()]
        show_jumps(branch, measure, element_id, [*branch.others, *other_curves], names, dimensionless)
    else:
        show_all_branches(branch, measure, element_id, show_jumps, dimensionless)
    raise typer.Exit(0 if is_complete else STOPPED_EARLY)


@app.command(name="plot")
def plot_command(
    file: File,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help=".png, .pdf or .svg.", show_default="FILE.png")
    ] = None,
    measure: ShownMeasure = None,
    element: Element = "0",
    dimensionless: Dimensionless = False,
    point: Annotated[
        str | None,
        typer.Option(
            help="Draw one point: a label such as LP1, or a value of the parameter.",
            autocompletion=cli_complete.labels,
        ),
    ] = None,
    also: Annotated[
        list[Path] | None,
        typer.Option("--with", metavar="FILE", help="Also draw these saved curves, tori or backbones; repeatable."),
    ] = None,
    style: Annotated[
        str, typer.Option(help="journal: serif text for print; screen: larger sans-serif text.")
    ] = "journal",
) -> None:
    """Draw a saved curve, or the time history, phase diagram and spectrum of one of its points."""
    if style not in STYLES:
        raise ValueError(f"--style {style}: choose {' or '.join(STYLES)}")
    other_curves = [hb.load(x) for x in also or ()]
    measure = measure or ("pp2" if any(kind_of(x) != "periodic" for x in other_curves) else None)
    branch, element_id, measure = loaded(file, measure, element, dimensionless)
    chosen = None if point is None else point_of(branch, point)
    name = file.stem if point is None else f"{file.stem}_{re.sub('[^A-Za-z0-9.]', '_', point)}"
    path = output or file.with_name(f"{name}.png")
    check_writable(path, FIGURES)
    with outputs() as out:
        if chosen is None:
            out.figure(path, lambda drawing: drawing.responses([branch, *other_curves], measure, element_id,
                                                               dimensionless=dimensionless), style)  # fmt: skip
        else:
            out.figure(path, lambda drawing: drawing.portrait(chosen, element_id, model_of(branch),
                                                              dimensionless=dimensionless), style)  # fmt: skip
            names, texts = position_headers(branch, dimensionless), position_texts(branch, chosen, dimensionless)
            print_text("point at " + ", ".join(f"{name} = {text}" for name, text in zip(names, texts, strict=True)))


def _group_commands() -> None:
    """Sort the commands by their headings in the help."""
    order = [(name, heading) for heading, names in COMMAND_GROUPS.items() for name in names]
    position = {name: i for i, (name, _) in enumerate(order)}

    def command_name(info: CommandInfo) -> str:
        return info.name or info.callback.__name__  # type: ignore[union-attr]

    app.registered_commands.sort(key=lambda info: position[command_name(info)])
    for info in app.registered_commands:
        info.rich_help_panel = order[position[command_name(info)]][1]


_group_commands()
