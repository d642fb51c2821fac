"""Commands on response curves: ``hbgear trace``, ``extend``, ``info``, ``jumps`` and ``plot``."""

from __future__ import annotations

import dataclasses
import re
import time
from pathlib import Path
from typing import Annotated, Any

import typer

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import kind_of
from hbgear.analysis.summary import in_speeds, message_of, position_headers, position_texts, summary_facts
from hbgear.cli import complete as cli_complete
from hbgear.cli import options
from hbgear.cli.output import (
    STOPPED_EARLY,
    bar,
    exit_code,
    numbered_branches,
    print_message,
    print_table,
    print_text,
    show_all_branches,
    show_jumps,
    show_path,
)
from hbgear.cli.output_files import FIGURES, check_writable, outputs
from hbgear.cli.support import (
    check_shown,
    chosen_model,
    harmonics_of,
    harmonics_or_auto,
    loaded,
    longer_span,
    model_at,
    path_of,
    point_of,
    problem_in,
    start_of,
    traced,
    with_landings,
)
from hbgear.continuation.events.registry import optional_events
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.models.frequency_units import model_of
from hbgear.plot.style import STYLES

STEPS = hb.StepControl()
"""Default step control of curves."""

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


Start = Annotated[
    str | None, typer.Option(metavar="FILE[:POINT]", help="Begin at a point (label or value) of a saved curve.")
]

TraceHarmonics = Annotated[
    str,
    typer.Option(
        help="Number H of harmonics of the excitation frequency, or auto to adapt it. With --instants that of the "
        "results, on which the curve does not depend."
    ),
]

HarmonicsTolerance = Annotated[
    float | None, typer.Option(help="Largest estimated error of the motion for --harmonics auto.", show_default="1e-6")
]

Orders = Annotated[
    str, typer.Option(help="meshes: only the harmonics of each mesh of a train and their combinations; default: all.")
]

Samples = Annotated[
    int | None, typer.Option(min=1, help="Samples N per period, at least 2H+1.", show_default="chosen from H")
]

Sampled = Annotated[
    bool, typer.Option("--sampled", help="Sample contact forces (AFT) instead of projecting them exactly.")
]

Instants = Annotated[
    bool, typer.Option("--instants", help="Solve in contact instants instead of harmonics: hard stops, no truncation.")
]

Stability = Annotated[bool, typer.Option("--stability/--no-stability", help="Compute Floquet multipliers and jumps.")]

MaxPoints = Annotated[int, typer.Option(min=2, help="Number of points after which the trace stops.")]

PredictorPoints = Annotated[
    int, typer.Option(min=1, help="Previous points used by the Hermite predictor; 1: tangent predictor.")
]

Accuracy = Annotated[
    float,
    typer.Option(
        min=0.0, help="Target relative error of special points, reached with more harmonics where needed; 0: no target."
    ),
]


def trace(
    model: options.Model,
    changes: options.Changes = None,
    first: options.First = None,
    last: options.Last = None,
    within: options.Within = None,
    at: options.At = None,
    start: Start = None,
    harmonics: TraceHarmonics = "16",
    tolerance: HarmonicsTolerance = None,
    orders: Orders = "",
    samples: Samples = None,
    sampled: Sampled = False,
    instants: Instants = False,
    measure: options.ShownMeasure = None,
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
    output: options.Output = None,
    plot: options.Figure = None,
    stability: Stability = True,
    max_points: MaxPoints = STEPS.max_points,
    predictor_points: PredictorPoints = STEPS.predictor_points,
    landing: options.Landing = "nearest",
    accuracy: Accuracy = 1e-5,
    event: Events = None,
) -> None:
    """Trace a response curve through its folds; print its special points and jumps.

    Linear algebra uses one thread: the matrices are too small to gain from more. Ctrl-C stops the trace and keeps all
    points. Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (all traced points are saved).
    """
    machine, point, nu = _model_and_start(model, changes, start)
    settings = {"samples": samples, "sampled": sampled, "orders": orders or None}
    problem = _problem(machine, nu, harmonics, tolerance, instants, settings)
    parameter, span, fixed = path_of(machine, within, first, last, at, has_start=point is not None)
    if point is not None:  # otherwise its parameter values would override those of --set
        fixed = {name: value for name, value in problem.parameters.items() if name != parameter} | fixed
    problem.check_parameter(parameter)
    check_shown(problem, measure, element)

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
        out.figure(plot, lambda drawing: drawing.response(branch, measure, element, dimensionless=dimensionless))
        print_text(f"{model}: {len(branch)} points in {seconds:.1f} s; {message_of(branch, dimensionless)}")
        show_all_branches(branch, measure, element, dimensionless=dimensionless)
    raise typer.Exit(exit_code(branch) if is_complete else STOPPED_EARLY)


def _problem(
    machine: hb.mechanics.Model,
    nu: int,
    harmonics: str,
    tolerance: float | None,
    instants: bool,
    settings: dict[str, Any],
) -> hb.HarmonicBalance:
    """Return the harmonic balance of a model, or its equations in contact instants, which take no settings."""
    if tolerance is not None and harmonics != "auto":
        raise ValueError(f"--tolerance {tolerance:g} has no effect without --harmonics auto: give both or neither")
    if instants:
        if any(settings.values()) or harmonics == "auto":
            raise ValueError(
                "--instants has no samples and no choice of harmonics: leave out --sampled, --samples, --orders, and "
                "give --harmonics as a number"
            )
        return hb.ContactInstants(machine, harmonics_of(harmonics), nu=nu)
    if tolerance is not None:
        settings = settings | {"tolerance": tolerance}
    return hb.HarmonicBalance(machine, harmonics_or_auto(harmonics), nu=nu, **settings)


def _model_and_start(
    name: str, changes: list[str] | None, start: str | None
) -> tuple[hb.mechanics.Model, hb.Point | None, int]:
    """Return the model, the first point of --start, and the number of excitation periods of its motion."""
    if start is None:
        return chosen_model(name, changes), None, 1
    curve, point = start_of(start)
    layout = layout_of(curve)
    return model_at(curve, point, name, changes), point, layout.nu if layout else 1


def extend(
    file: options.File,
    model: options.OwnModel = None,
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
    measure: options.ShownMeasure = None,
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
    output: options.Output = None,
    plot: options.Figure = None,
    max_points: Annotated[int, typer.Option(min=2, help="Largest number of points to add.")] = STEPS.max_points,
) -> None:
    """Continue the saved curves of a file from their last points; the result is the whole curves.

    By default to the end of its span; --from and --to, or --in for a curve in another parameter, set a longer span.
    Exit codes: as for hbgear trace.
    """
    branch, measure = loaded(file, measure, element, dimensionless)
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
        out.figure(plot, lambda drawing: drawing.response(extended, measure, element, dimensionless=dimensionless))
        count, more = (sum(len(curve) for curve in whole.curves) for whole in (branch, extended))
        print_text(f"{file}: {count} points, {more - count} more; {message_of(extended, dimensionless)}")
        show_all_branches(extended, measure, element, dimensionless=dimensionless)
    raise typer.Exit(exit_code(extended))


def info(
    file: options.File,
    measure: options.ShownMeasure = None,
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Summarise a saved curve: model, status, special points, jumps and accuracy."""
    branch, shown = loaded(file, measure, element, dimensionless)
    rows = [[name, text] for name, text in summary_facts(branch, measure, dimensionless) if text]
    print_table(["", str(file)], rows)
    show_all_branches(branch, shown, element, dimensionless=dimensionless)


def jumps(
    file: options.File,
    model: options.OwnModel = None,
    landing: options.Landing = "nearest",
    other_branches: options.OtherCurves = None,
    doublings: Annotated[
        int | None,
        typer.Option(
            min=0, help="Print the paths of slow sweeps instead, through at most this number of period doublings."
        ),
    ] = None,
    measure: options.ShownMeasure = None,
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """List the jumps of a slow sweep, with the amplitudes before and after, and how the landing was determined.

    By default a jump lands on the nearest stable motion; with --landing integrate, on the motion that integration in
    time reaches, with any period. With --doublings the sweeps in both directions are followed from jump to jump, also
    on motions of twice the period. Exit codes: 0 done, 2 bad input, 3 interrupted.
    """
    branch, measure = loaded(file, measure, element, dimensionless)
    from_files = [(path.name, hb.load(path)) for path in other_branches or ()]
    other_curves = [curve for _, curve in from_files]
    branch, is_complete = with_landings(landing, branch, lambda curve: problem_in(curve, model), other_curves)
    if doublings is not None:
        branch = dataclasses.replace(branch, problem=problem_in(branch, model))
        for direction in ("up", "down"):
            run = hb.analysis.run_up(branch, direction, other_curves, doublings)
            show_path(run, measure, element, dimensionless)
        raise typer.Exit(0 if is_complete else STOPPED_EARLY)
    if other_curves:
        others = [*numbered_branches(branch.curves)[1:], *from_files]
        show_jumps(branch, measure, element, others, dimensionless)
    else:
        show_all_branches(branch, measure, element, show_jumps, dimensionless)
    raise typer.Exit(0 if is_complete else STOPPED_EARLY)


def plot_command(
    file: options.File,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help=".png, .pdf or .svg.", show_default="FILE.png")
    ] = None,
    measure: options.ShownMeasure = None,
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
    point: Annotated[
        str | None,
        typer.Option(
            help="Draw one point: a label such as LP1, or a value of the parameter, such as 9000r/min.",
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
    branch, measure = loaded(file, measure, element, dimensionless)
    chosen = None if point is None else point_of(branch, point)
    name = file.stem if point is None else f"{file.stem}_{re.sub('[^A-Za-z0-9.]', '_', point)}"
    path = output or file.with_name(f"{name}.png")
    check_writable(path, FIGURES)
    with outputs() as out:
        if chosen is None:
            out.figure(
                path,
                lambda drawing: drawing.responses(
                    [branch, *other_curves], measure, element, dimensionless=dimensionless
                ),
                style,
            )
        else:
            out.figure(
                path,
                lambda drawing: drawing.portrait(chosen, element, model_of(branch), dimensionless=dimensionless),
                style,
            )
            names, texts = position_headers(branch, dimensionless), position_texts(branch, chosen, dimensionless)
            print_text("point at " + ", ".join(f"{name} = {text}" for name, text in zip(names, texts, strict=True)))
