"""The command ``hbgear``: trace, look at and draw response curves. Everything it does, the library does.

Exit codes: 0 the end was reached; 2 bad input, with one line that says what to do; 3 stopped early, what was traced is
saved all the same. Ctrl-C and SIGTERM stop any command early. What is slow to import (matplotlib, rich) is imported
when it is needed.
"""

from __future__ import annotations

import dataclasses
import shutil
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

import hbgear as hb
from hbgear.analysis.summary import facts_of, text_at
from hbgear.cli import complete as cli_complete
from hbgear.cli import pages as cli_pages
from hbgear.cli.commands import design as cli_design
from hbgear.cli.commands import fit as cli_fit
from hbgear.cli.commands import gear as cli_gear
from hbgear.cli.commands import rotors as cli_rotors
from hbgear.cli.commands import study as cli_study
from hbgear.cli.commands import time as cli_time
from hbgear.cli.commands.files import BRANCHES, FIGURES, check_writable, outputs
from hbgear.cli.startup import STDOUT_CLOSED
from hbgear.cli.support import (
    BAD_INPUT,
    STOPPED_EARLY,
    At,
    Beside,
    Changes,
    Element,
    File,
    First,
    Harmonics,
    Landing,
    Last,
    Measure,
    Model,
    Output,
    OwnModel,
    Within,
    bar,
    chosen_model,
    defaults_text,
    element_of,
    equation_of,
    exit_code,
    known_landing,
    landed_as,
    loaded,
    longer_span,
    model_at,
    path_of,
    point_of,
    print_table,
    print_text,
    problem_in,
    problem_of,
    ranges_of,
    say,
    show_jumps,
    show_whole,
    silence_broken,
    start_of,
    summary_of,
    traced,
)
from hbgear.common.atomic_write import CannotWrite
from hbgear.common.process.signals import sigterm_like_ctrl_c
from hbgear.harmonic import model_registry
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.frequency_units import model_of
from hbgear.mechanics.model_lookup import installed

RENAMED = {
    "--parameter": "--parameter F --from A --to B is now --in F=A:B, as --from and --to are always in Omega",
    "--omega-from": "--omega-from is now --from",
    "--omega-to": "--omega-to is now --to",
}


_CTRL_C = 130  # what typer makes of a Ctrl-C that a command does not see to itself


_NARROW = 60  # columns of a terminal, below which help has no frames: they would cut its words

_columns = shutil.get_terminal_size().columns

app = typer.Typer(
    name="hbgear",
    rich_markup_mode=None if _columns < _NARROW else "rich",
    help="Nonlinear frequency response of gear drives with backlash.",
    pretty_exceptions_enable=False,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "terminal_width": _columns - 1 if _columns < _NARROW else None,
    },
)


def main(args: Sequence[str] | None = None) -> None:
    """Run the command and exit."""
    with sigterm_like_ctrl_c(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # those of libraries are not for users of a command
        warnings.showwarning = lambda message, *_, **__: say("warning", message)
        sys.exit(_printed(_run(list(sys.argv[1:] if args is None else args) or ["--help"])))


def _printed(code: int) -> int:
    """The exit code, 2 if what was printed did not get to where it goes."""
    if STDOUT_CLOSED and code != BAD_INPUT:
        return _unprinted("standard output is closed")
    try:
        sys.stdout.flush()
    except OSError as error:
        code = _unprinted(error.strerror)
    silence_broken(sys.stderr)
    return code


def _unprinted(reason: str | None) -> int:
    """Say that the result could not be printed; the exit code."""
    say("error", f"the result could not be printed ({reason}); files that were asked for are written")
    silence_broken(sys.stdout)
    return BAD_INPUT


def _takes_nothing() -> bool:
    """Whether standard output takes nothing."""
    try:
        sys.stdout.write("\n")
        sys.stdout.flush()
    except OSError:
        return True
    return False


def _run(args: list[str]) -> int:
    try:
        code = int(app(args, prog_name="hbgear", standalone_mode=False) or 0)
        if code == _CTRL_C:
            raise KeyboardInterrupt
        return code
    except (ValueError, KeyError, OSError, hb.NoConvergence) as error:
        of_stream = isinstance(error, OSError) and error.errno is not None and error.filename is None
        if of_stream and not isinstance(error, CannotWrite) and _takes_nothing():
            return _unprinted(getattr(error, "strerror", None))
        for problem in getattr(error, "problems", [error.args[0] if isinstance(error, KeyError) else error]):
            say("error", problem)
        return BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):  # where there was nothing to keep, or No was the answer
        say("error", "stopped before it was done")
        return STOPPED_EARLY
    except Exception as error:  # what typer says of unknown options and commands; anything else is a bug of ours
        if not hasattr(error, "format_message"):
            raise
        said = RENAMED.get(getattr(error, "option_name", ""), error.format_message().rstrip("."))
        say("error", f"{said}; see hbgear --help or hbgear COMMAND --help")
        return BAD_INPUT


cli_design.register(app)


cli_fit.register(app)


cli_study.register(app)


cli_time.register(app)


cli_gear.register(app)


cli_pages.register(app)
cli_rotors.register(app)


# ---- commands

Plot = Annotated[Path | None, typer.Option(help="Draw the curve to a .png, .pdf or .svg.")]


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        print(hb.__version__)
        raise typer.Exit


@app.command()
def models(
    model: Annotated[
        str | None, typer.Argument(metavar="[MODEL]", help="Only this one, such as FILE.py:NAME of your own.")
    ] = None,
) -> None:
    """List the models, their equations and their parameters with defaults; VALUE where one has to be given.

    Beside those of hbgear there are the models of installed packages with entry points hbgear.models.
    """
    rows = []
    for name in [*model_registry.MODELS, *installed()] if model is None else [model]:
        try:
            cls = model_registry.model_class(name)
        except ValueError as error:
            if model is not None:
                raise
            say("warning", error)  # one broken package leaves the others
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
        float, typer.Option(help="Largest estimated error of the motion with --harmonics auto.")
    ] = 1e-6,
    orders: Annotated[
        str, typer.Option(help="meshes: harmonics of every mesh of a train, and their combinations, instead of all.")
    ] = "",
    samples: Annotated[
        int | None, typer.Option(min=1, help="N per period, at least 2H+1.", show_default="chosen from H")
    ] = None,
    sampled: Annotated[
        bool, typer.Option("--sampled", help="Sample contact forces instead of exact projection.")
    ] = False,
    measure: Measure = "pp2",
    element: Element = "0",
    output: Output = None,
    plot: Plot = None,
    stability: Annotated[
        bool, typer.Option("--stability/--no-stability", help="Floquet multipliers and jumps.")
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
            min=0.0, help="Largest relative error of special points, solved for with more harmonics if need be; 0: any."
        ),
    ] = 1e-5,
) -> None:
    """Trace a response curve through its folds; print its special points and jumps.

    Linear algebra is limited to one thread: the matrices are too small to gain from more. Ctrl-C stops the trace and
    keeps what it has. Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (what was traced is saved).
    """
    for path, allowed in ((output, BRANCHES), (plot, FIGURES)):
        check_writable(path, allowed)
    known_landing(landing)
    machine = chosen_model(model, changes)
    point, nu = None, 1
    if start is not None:
        curve, point = start_of(start)
        layout = layout_of(curve)
        machine, nu = model_at(curve, point, model, changes), layout.nu if layout else 1
    problem = problem_of(
        machine, harmonics, nu=nu, samples=samples, sampled=sampled, tolerance=tolerance, orders=orders or None
    )
    parameter, span, held = path_of(machine, within, first, last, at, known=point is not None)
    if point is not None:  # its values of the parameters would count before those of --set
        held = {name: value for name, value in problem.parameters.items() if name != parameter} | held
    problem.check_parameter(parameter)
    which = element_of(element)
    problem.layout.check_measure(measure, which)  # before the work

    started = time.perf_counter()
    try:
        branch = traced(
            problem,
            parameter,
            span,
            start=point,
            at=held,
            stability=stability,
            steps=hb.StepControl(max_points=max_points, predictor_points=predictor_points),
            accuracy=accuracy or None,
        )
    except KeyboardInterrupt:  # not within the trace itself, which keeps what it has
        say("error", "interrupted while starting or finishing; nothing was kept")
        raise typer.Exit(STOPPED_EARLY) from None
    seconds = time.perf_counter() - started
    branch, done = landed_as(landing, branch)
    with outputs() as out:
        out.branch(output, branch)
        out.figure(plot, lambda drawing: drawing.response(branch, measure, which))
        print_text(f"{model}: {len(branch)} points in {seconds:.1f} s; {branch.message}")
        show_whole(branch, measure, which)
    raise typer.Exit(exit_code(branch) if done else STOPPED_EARLY)


@app.command()
def extend(
    file: File,
    model: OwnModel = None,
    first: Annotated[
        float | None,
        typer.Option("--from", help="Omega at which a longer span begins.", show_default="that of the curve"),
    ] = None,
    last: Annotated[
        float | None, typer.Option("--to", help="Omega at which a longer span ends.", show_default="that of the curve")
    ] = None,
    within: Annotated[
        str | None,
        typer.Option(
            "--in",
            metavar="NAME=FROM:TO",
            help="A longer span of a curve in another parameter than Omega.",
            show_default="that of the curve",
        ),
    ] = None,
    harmonics: Annotated[
        str | None, typer.Option(help="H to go on with, or auto.", show_default="that of the curve")
    ] = None,
    samples: Annotated[
        int | None, typer.Option(min=1, help="N per period to go on with.", show_default="that of the curve")
    ] = None,
    measure: Measure = "pp2",
    element: Element = "0",
    output: Output = None,
    plot: Plot = None,
    max_points: Annotated[
        int, typer.Option(min=2, help="Stop after so many more points.")
    ] = hb.StepControl().max_points,
) -> None:
    """Follow a saved curve on from its last point; the result is the whole curve.

    By default as far as it was to go: --from and --to, or --in of a curve in another parameter, give a longer span.
    Exit codes: as of hbgear trace.
    """
    for path, allowed in ((output, BRANCHES), (plot, FIGURES)):
        check_writable(path, allowed)
    branch, which = loaded(file, measure, element)
    branch = dataclasses.replace(branch, problem=problem_in(branch, model))
    problem = problem_in(branch, model, harmonics, samples)
    span = longer_span(branch, within, first, last)
    with bar(branch.parameter) as progress:
        steps = hb.StepControl(max_points=max_points)
        whole = hb.extend(branch, span, problem=problem, steps=steps, progress=progress)
    with outputs() as out:
        out.branch(output, whole)
        out.figure(plot, lambda drawing: drawing.response(whole, measure, which))
        print_text(f"{file}: {len(branch)} points, {len(whole) - len(branch)} more; {whole.message}")
        show_whole(whole, measure, which)
    raise typer.Exit(exit_code(whole))


@app.command()
def info(file: File, measure: Measure = "pp2", element: Element = "0") -> None:
    """Say what a saved curve is, how it ended, what is on it and how accurate it is."""
    branch, which = loaded(file, measure, element)
    rows = [[name, text] for name, text in facts_of(branch, measure) if text]
    print_table(["", str(file)], rows)
    show_whole(branch, measure, which)


@app.command()
def jumps(
    file: File,
    model: OwnModel = None,
    landing: Landing = "nearest",
    beside: Beside = None,
    measure: Measure = "pp2",
    element: Element = "0",
) -> None:
    """Where a slow sweep jumps, from which amplitude to which, and how it was decided where it lands.

    Of several stable motions it is the nearest, or with --landing integrate the one in which the motion left settles,
    whatever its period. Exit codes: 0 done, 2 bad input, 3 interrupted.
    """
    known_landing(landing)
    branch, which = loaded(file, measure, element)
    others = [hb.load(path) for path in beside or ()]
    problem = problem_in(branch, model) if landing == "integrate" and branch.jumps() else None
    branch, done = landed_as(landing, branch, problem, others)
    if others:
        names = [f"branch {i + 2}" for i in range(len(branch.others))] + [path.name for path in beside or ()]
        show_jumps(branch, measure, which, [*branch.others, *others], names)
    else:
        show_whole(branch, measure, which, show_jumps)
    raise typer.Exit(0 if done else STOPPED_EARLY)


@app.command(name="plot")
def plot_command(
    file: File,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help=".png, .pdf or .svg.", show_default="FILE.png")
    ] = None,
    measure: Measure = "pp2",
    element: Element = "0",
    point: Annotated[
        str | None,
        typer.Option(
            help="Portrait of one point: a label such as LP1, or a value of the parameter.",
            autocompletion=cli_complete.labels,
        ),
    ] = None,
) -> None:
    """Draw a saved curve, or the time history, phase diagram and spectrum of one of its points."""
    branch, which = loaded(file, measure, element)
    chosen = None if point is None else point_of(branch, point)
    path = output or file.with_name(f"{file.stem}{'' if chosen is None else f'_{point}'}.png")
    check_writable(path, FIGURES)
    with outputs() as out:
        if chosen is None:
            out.figure(path, lambda drawing: drawing.response(branch, measure, which))
        else:
            out.figure(path, lambda drawing: drawing.portrait(chosen, which, model_of(branch)))
            print_text(f"point at {branch.parameter} = {text_at(chosen, branch.parameter)}")
