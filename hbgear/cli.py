"""The command ``hbgear``: trace, look at and draw response curves. Everything it does, the library does.

Exit codes: 0 the end was reached; 2 bad input, with one line that says what to do; 3 stopped early, what was traced is
saved all the same. What is slow to import (matplotlib, rich) is imported when it is needed.
"""

from __future__ import annotations

import dataclasses
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import hbgear as hb
from hbgear import catalogue, cli_design, cli_study, cli_time
from hbgear.cli_support import (
    BRANCHES,
    FIGURES,
    STOPPED_EARLY,
    Changes,
    Element,
    File,
    Harmonics,
    Measure,
    check_writable,
    chosen_model,
    draw,
    element_of,
    equation_of,
    exit_code,
    facts_of,
    held_values,
    loaded,
    point_of,
    print_table,
    problem_of,
    save_branch,
    say,
    show_branch,
    show_jumps,
    span_of,
    summary_of,
    text_of,
    traced,
    wrote,
)
from hbgear.speeds import model_of

BAD_INPUT = 2
_CTRL_C = 130  # what typer makes of a Ctrl-C that a command does not see to itself

app = typer.Typer(
    name="hbgear",
    help="Nonlinear frequency response of gear drives with backlash.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main(args: Sequence[str] | None = None) -> None:
    """Run the command and exit."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: say("warning", message)
        sys.exit(_run(list(sys.argv[1:] if args is None else args) or ["--help"]))


def _run(args: list[str]) -> int:
    try:
        code = int(app(args, prog_name="hbgear", standalone_mode=False) or 0)
        if code == _CTRL_C:
            raise KeyboardInterrupt
        return code
    except (ValueError, KeyError, OSError, hb.NoConvergence) as error:
        say("error", error.args[0] if isinstance(error, KeyError) else error)
        return BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):  # where there was nothing to keep, or No was the answer
        say("error", "stopped before it was done")
        return STOPPED_EARLY
    except Exception as error:  # what typer says of unknown options and commands; anything else is a bug of ours
        if not hasattr(error, "format_message"):
            raise
        say("error", f"{error.format_message().rstrip('.')}; see hbgear --help or hbgear COMMAND --help")
        return BAD_INPUT


cli_design.register(app)
cli_study.register(app)
cli_time.register(app)


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
        values = ", ".join(f"{f.name}={text_of(f.default)}" for f in dataclasses.fields(cls))  # type: ignore[arg-type]
        rows.append([f"{name}\n{cls.__name__}", f"{summary_of(cls)}\n{equation_of(cls)}\n{values}\n"])
    print_table(["model", "equation, parameters with defaults (change them with --set)"], rows)


@app.command()
def trace(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=f"One of: {', '.join(catalogue.MODELS)}.")],
    changes: Changes = None,
    parameter: Annotated[
        str, typer.Option(help="What changes along the curve: Omega or a field of the model.")
    ] = "Omega",
    first: Annotated[
        float | None, typer.Option("--from", help="Start of the span.", show_default="the model's")
    ] = None,
    last: Annotated[float | None, typer.Option("--to", help="End of the span.", show_default="the model's")] = None,
    harmonics: Harmonics = "16",
    tolerance: Annotated[
        float, typer.Option(help="Largest estimated error of the motion with --harmonics auto.")
    ] = 1e-6,
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
        check_writable(path, allowed)
    machine = chosen_model(model, changes)
    problem = problem_of(machine, harmonics, samples=samples, sampled=sampled, tolerance=tolerance)
    problem.check_parameter(parameter)
    span = span_of(machine, parameter, first, last)
    held = held_values(parameter, at or [])
    which = element_of(element)
    problem.layout.measure(measure, np.zeros(problem.size), which)  # a wrong name is refused before the work

    started = time.perf_counter()
    try:
        branch = traced(problem, parameter, span, at=held, stability=stability, steps=hb.Steps(max_points=max_points))
    except KeyboardInterrupt:  # not within the trace itself, which keeps what it has
        say("error", "interrupted while starting or finishing; nothing was kept")
        raise typer.Exit(STOPPED_EARLY) from None
    seconds = time.perf_counter() - started
    save_branch(branch, output)
    if plot:
        draw(plot, lambda drawing: drawing.response(branch, measure, which))
    print(f"{model}: {len(branch)} points in {seconds:.1f} s; {branch.message}")
    show_branch(branch, measure, which)
    wrote(output, plot)
    raise typer.Exit(exit_code(branch))


@app.command()
def info(file: File, measure: Measure = "pp2", element: Element = "0") -> None:
    """Say what a saved curve is, how it ended, what is on it and how accurate it is."""
    branch, which = loaded(file, measure, element)
    rows = [[name, text] for name, text in facts_of(branch, measure) if text]
    print_table(["", str(file)], rows)
    show_branch(branch, measure, which)


@app.command()
def jumps(file: File, measure: Measure = "pp2", element: Element = "0") -> None:
    """Where a slow sweep jumps, and from which amplitude to which."""
    branch, which = loaded(file, measure, element)
    show_jumps(branch, measure, which)


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
    branch, which = loaded(file, measure, element)
    chosen = None if point is None else point_of(branch, point)
    path = output or file.with_name(f"{file.stem}{'' if chosen is None else f'_{point}'}.png")
    check_writable(path, FIGURES)
    if chosen is None:
        draw(path, lambda drawing: drawing.response(branch, measure, which))
    else:
        print(f"point at {branch.parameter} = {chosen.parameters[branch.parameter]:.8g}")
        draw(path, lambda drawing: drawing.portrait(chosen, which, model_of(branch)))
    wrote(path)
