"""Commands on parameters: ``hbgear sensitivity``, ``scatter``, ``fit`` and ``redesign``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import hbgear as hb
from hbgear.cli import complete as cli_complete
from hbgear.cli import options
from hbgear.cli.commands.shares import SHARE_ROUNDING, MaxRows, Saved, show_shares
from hbgear.cli.output import bar, finish, print_table, print_text
from hbgear.cli.output_files import outputs
from hbgear.cli.quantities import amplitude_in_model, check_parameter, deviation_of, value_in_model
from hbgear.cli.support import (
    assignments,
    chosen_model,
    label_on_curve,
    load_with_problem,
    on_curve,
    point_of,
    problem_of,
    span_of,
)
from hbgear.common.text.symbols import unit_of
from hbgear.design.fitting.measurements import FREQUENCIES
from hbgear.io.branches.columns import bracketed


def sensitivity(
    file: options.File,
    point: Annotated[
        str,
        typer.Argument(
            metavar="POINT",
            help="A label such as LP1, a jump as jump1, the highest peak as peak, or a value such as 0.9.",
            autocompletion=cli_complete.labels,
        ),
    ],
    model: options.OwnModel = None,
    quantity: Annotated[
        str,
        typer.Option(
            "--sort-by", help="Quantity by which the table is sorted, such as 'mesh Hz'.", show_default="r/min if known"
        ),
    ] = "",
    max_rows: MaxRows = 15,
    output: Saved = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
    multipliers: Annotated[
        bool, typer.Option("--multipliers", help="Include the largest modulus of the Floquet multipliers, |mu|.")
    ] = False,
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute the derivatives of the frequency and amplitude of a point of a saved curve by all parameters.

    The table is in percent per percent of each parameter, the largest first.
    """
    branch = load_with_problem(file, model)
    chosen = _chosen(branch, point, measure, element)
    derivatives = hb.analysis.sensitivity(chosen, measure=measure, element=element, multipliers=multipliers)
    show_shares(derivatives, branch.problem.model.labels, quantity, max_rows, output, plot, dimensionless)


def scatter(
    file: options.File,
    spread: Annotated[
        list[str],
        typer.Argument(metavar="NAME=DEVIATION...", help="Standard deviations of parameters, such as zeta=0.002."),
    ],
    model: options.OwnModel = None,
    draws: Annotated[int, typer.Option(min=2, help="Size of the Monte Carlo sample.")] = 300,
    sigmas: Annotated[float, typer.Option(help="Half width of the band in standard deviations.")] = 2.0,
    unit: Annotated[
        str | None,
        typer.Option(help=f"Unit of the frequencies: {', '.join(FREQUENCIES)}.", show_default="r/min if known"),
    ] = None,
    length: Annotated[
        str | None, typer.Option(help="Unit of the amplitudes, such as mm.", show_default="um if known")
    ] = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute the scatter of the jumps of a saved curve for scattered parameters; --plot draws the band of the curve.

    To first order, and by Monte Carlo: the equations of each jump are solved for every draw. The band is that of the
    first curve of the file, jumps are those of all its curves.
    """
    branch = load_with_problem(file, model)
    labels = branch.problem.model.labels
    pairs = assignments("NAME=DEVIATION", spread)
    deviations = {name: deviation_of(labels, "NAME=DEVIATION", name, text) for name, text in pairs}
    if dimensionless:
        unit, length = unit or "Omega", length or ""
    with bar("scatter") as progress:
        jumps = [
            (label_on_curve(number, t), t)
            for number, curve in enumerate(branch.curves, 1)
            if curve.jumps()
            for t in hb.design.jump_tolerance(curve, deviations, draws=draws, unit=unit, progress=progress)
        ]
        band = hb.design.response_band(branch, deviations, measure=measure, element=element, unit=unit, length=length)
    with outputs() as out:
        out.figure(plot, lambda drawing: drawing.band(band, sigmas=sigmas))
        if jumps:
            _print_scatter(jumps, draws)
        else:
            print("no curve of the file has jumps" if branch.others else "the curve has no jumps")
        for name, effect in zip(band.parameters, band.effects.T, strict=True):
            if not np.nanmax(np.abs(effect)) > SHARE_ROUNDING:
                print(f"{name} has no effect on the curve")
        i = int(np.nanargmax(band.deviation))
        size = f"{measure} = {band.amplitude[i]:.6g}{f' {band.length}' if band.length else ''}"
        print(
            f"the curve is displaced most at {band.unit} = {band.frequency[i]:.6g}, {size}: "
            f"by {sigmas * band.deviation[i]:.2%} of its range for {sigmas:g} standard deviations"
        )


Data = Annotated[
    Path,
    typer.Argument(
        metavar="DATA.csv",
        help="Columns frequency, amplitude, direction (up or down) and deviation, with units in square "
        "brackets, such as r/min; see --column.",
    ),
]

FreeToFit = Annotated[
    list[str],
    typer.Option(
        "--free", metavar="NAME,...", help="Parameters to fit: zeta,b or, with bounds, zeta=0.01:0.2; repeatable."
    ),
]

Columns = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=HEADER", help="Header of a column in the file: frequency=rpm; repeatable."),
]

FrequencyUnit = Annotated[
    str | None,
    typer.Option(help=f"Unit of frequencies whose column states none: {', '.join(FREQUENCIES)}.", show_default="Omega"),
]

LengthUnit = Annotated[
    str, typer.Option(help="Unit of amplitudes whose column states none, such as um.", show_default="from the model")
]


def fit(
    data: Data,
    model: options.Model,
    free: FreeToFit,
    changes: options.Changes = None,
    column: Columns = None,
    unit: FrequencyUnit = None,
    length: LengthUnit = "",
    harmonics: options.Harmonics = "16",
    starts: Annotated[int, typer.Option(min=1, help="Starting points to follow if the first fits badly.")] = 3,
    output: Annotated[Path | None, options.output_option("Save the fitted curve as .npz.", ".npz")] = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
) -> None:
    """Fit parameters to measured sweeps; the values of the model are the starting point.

    A row of the file without an amplitude is the frequency of a measured jump.
    Exit codes: 0 done, 2 bad input, 3 stopped early (the best values so far are shown).
    """
    machine = chosen_model(model, changes)
    bounds = _free_parameters(machine, free)
    measured = hb.design.read_measurements(
        data, dict(assignments("--column", column or [])), unit=unit, length=length, measure=measure, element=element
    )
    with bar("fit") as progress:
        result = hb.design.fit(problem_of(machine, harmonics), measured, bounds, starts=starts, progress=progress)
    with outputs() as out:
        out.branch(output, result.curve)
        out.figure(plot, lambda drawing: drawing.fitted(result))
        _print_fit(machine, measured, result)
    finish(result)


def _print_fit(machine: hb.mechanics.Model, measured: hb.design.Measurements, result: hb.design.Fit) -> None:
    """Print the values, their correlations, the residuals and the warnings of a fit that began at a machine."""
    start = machine.parameters | machine.entries
    rows = [
        [
            f"{name}{bracketed(unit_of(machine.labels.get(name, '')))}",
            f"{start[name]:.6g}",
            f"{x:.6g}",
            _number_or_dash(result.errors[name], ".2g"),
        ]
        for name, x in result.values.items()
    ]
    print_table(["", "start", "fitted", "+-"], rows, f"{len(measured)} points and {len(measured.jumps)} jumps")
    pairs = [
        [f"{a}, {b}", _number_or_dash(result.correlation[i, j], "+.3f")]
        for i, a in enumerate(result.names)
        for j, b in enumerate(result.names[:i])
    ]
    if pairs:
        print_table(["", "correlation"], pairs)
    if not math.isnan(result.mean_square):
        print(f"root mean square of the residuals: {math.sqrt(result.mean_square):.3g} deviations")
    if measured.assumed:
        from hbgear.design.fitting.measurements import DEFAULT_DEVIATION

        print_text(
            f"The file has no deviations: {DEFAULT_DEVIATION:.0%} of each amplitude is assumed, and the "
            "uncertainties follow from the residuals."
        )
    for warning in result.warnings:
        print(f"warning: {warning}")


FreeToChange = Annotated[
    list[str],
    typer.Option(
        "--free", metavar="NAME,...", help="Parameters that may change: zeta,e_scale or zeta=0.04:0.1; repeatable."
    ),
]

PeakLimit = Annotated[
    str | None,
    typer.Option(
        metavar="LIMIT",
        help="Limit of the highest peak, with its unit for a machine, such as 20um; default: remove all jumps.",
    ),
]

ScatterOfDesign = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=DEVIATION", help="Standard deviation of a parameter, kept as a margin; repeatable."),
]

Draws = Annotated[
    int | None, typer.Option(min=1, help="Reach the goal for this many draws of the scatter, without a margin.")
]

Fraction = Annotated[float, typer.Option(help="With --draws: fraction of the draws that must reach the goal.")]

Margin = Annotated[
    float | None, typer.Option(help="Relative distance of a parameter from the value at which a jump appears.")
]


def redesign(
    model: options.Model,
    free: FreeToChange,
    peak: PeakLimit = None,
    changes: options.Changes = None,
    scatter: ScatterOfDesign = None,
    sigmas: Annotated[float, typer.Option(min=0, help="Margin in standard deviations.")] = 2.0,
    draws: Draws = None,
    fraction: Fraction = 1.0,
    margin: Margin = None,
    margin_in: Annotated[str, typer.Option(metavar="NAME", help="Parameter of --margin.")] = "",
    first: options.First = None,
    last: options.Last = None,
    harmonics: options.Harmonics = "16",
    output: Annotated[Path | None, options.output_option("Save the new curve as .npz.", ".npz")] = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
) -> None:
    """Find the smallest relative change of a design that removes its jumps or limits its highest peak.

    Exit codes: 0 the goal is reached, 1 no values within the bounds reach it, 2 bad input, 3 stopped early.
    """
    problem = problem_of(chosen_model(model, changes), harmonics)
    if peak is not None and margin is not None:
        raise ValueError("--margin is the distance from a jump; give --margin or --peak, not both")
    ranges = _free_parameters(problem.model, free)
    within = {name: bounds for name, bounds in ranges.items() if bounds is not None}
    spread = {
        name: deviation_of(problem.model.labels, "--scatter", name, text)
        for name, text in assignments("--scatter", scatter or [])
    }
    if peak is None:
        goal = hb.design.no_jumps(margin or 0.0, margin_in)
    else:
        goal = _peak_goal(problem, peak, measure, element, {*ranges, *spread})
    sample = None
    if draws:
        if not spread:
            raise ValueError("--draws needs the scatter; give --scatter NAME=DEVIATION too")
        sample = hb.design.latin_hypercube(draws, **{name: ("normal", 0.0, s) for name, s in spread.items()})
    span = span_of(problem.model, first, last)
    with bar("redesign") as progress:
        result = hb.design.redesign(
            problem,
            goal,
            list(ranges),
            within,
            scatter=None if draws else spread,
            sigmas=sigmas,
            tolerances=sample,
            share=fraction,
            span=span,
            progress=progress,
        )
    with outputs() as out:
        out.branch(output, result.curve)
        out.figure(plot, lambda drawing: drawing.response(result.curve, measure, element))
        wanted = "no jumps" if peak is None else f"{measure} at most {peak}"
        _print_redesign(problem.model, result, wanted, draws)
    if not result.status.complete:
        finish(result)
    raise typer.Exit(0 if result.reached else GOAL_MISSED)


def _peak_goal(
    problem: hb.HarmonicBalance, peak: str, measure: str, element: int | str, varied: set[str]
) -> hb.design.Goal:
    """Return the goal of --peak; ``varied`` are the parameters that change."""
    problem.layout.check_measure(measure, element)
    limit = amplitude_in_model(problem.model, "--peak", measure, peak, varied)
    return hb.design.peak_below(limit, measure, element)


def _print_redesign(model: hb.mechanics.Model, result: hb.design.Redesign, wanted: str, draws: int | None) -> None:
    """Print the values of a redesign, their relative changes, and whether the goal is reached."""
    nominal = model.parameters | model.entries
    rows = [
        [name, f"{nominal[name]:.6g}", f"{x:.6g}", f"{result.changes[name]:+.2%}"] for name, x in result.values.items()
    ]
    print_table(["", "old", "new", "change"], rows, f"root sum of squares of the changes: {result.distance:.2%}")
    if draws:
        print(f"{result.share:.0%} of {draws} machines drawn from the scatter reach the goal")
    distance = "" if math.isnan(result.short) else f" by {result.short:.2%}"
    print(f"the goal, {wanted}, is " + ("reached" if result.reached else f"missed{distance}: {result.message}"))


GOAL_MISSED = 1
"""Exit code of a redesign that does not reach its goal."""


def _free_parameters(model: hb.mechanics.Model, texts: list[str]) -> dict[str, tuple[float, float] | None]:
    """Return the bounds of the parameters of all options --free by name; None where none are given."""
    return dict(_bounds(model, text) for several in texts for text in several.split(",") if text.strip())


def _bounds(model: hb.mechanics.Model, text: str) -> tuple[str, tuple[float, float] | None]:
    """Return the name and the bounds of an entry of --free."""
    name, equals, ends = (part.strip() for part in text.partition("="))
    check_parameter(model, name)
    if not equals:
        return name, None
    low, colon, high = (part.strip() for part in ends.partition(":"))
    if not (name and colon):
        raise ValueError(f"{text}: need NAME or NAME=LOW:HIGH, such as zeta=0.01:0.2")
    return name, (value_in_model(model, "--free", name, low), value_in_model(model, "--free", name, high))


def _print_scatter(jumps: list[tuple[str, hb.design.JumpTolerance]], draws: int) -> None:
    """Print the standard deviation of each jump, given with its label, and the draws in which it vanishes."""
    rows = [
        [
            label,
            "increasing" if t.direction > 0 else "decreasing",
            f"{t.value:.6g}",
            f"{t.first:.3g}",
            _number_or_dash(t.sampled, ".3g"),
            str(t.lost),
            *(f"{effect:+.3g}" for effect in t.effects.values()),
        ]
        for label, t in jumps
    ]
    title = f"standard deviation of each jump: first order, {draws} draws, and contribution of each parameter"
    print_table(["jump", "sweep", jumps[0][1].unit, "+-", "drawn", "lost", *jumps[0][1].effects], rows, title)
    for label, t in jumps:
        if t.lost:
            print(f"{label} vanishes in {t.lost} of {draws} draws; the deviation is that of the others")


def _number_or_dash(number: float, form: str) -> str:
    return "-" if math.isnan(number) else f"{number:{form}}"


def _chosen(branch: hb.Branch, text: str, measure: str, element: int | str) -> hb.Point | hb.Jump:
    """Return the point or jump given by a text, after the number of its curve (``2:jump1``)."""
    branch, text = on_curve(branch, text, "POINT")
    jumps = branch.jumps()
    if text.startswith("jump") and text[4:].isdecimal():
        if not 1 <= int(text[4:]) <= len(jumps):
            raise ValueError(f"POINT {text}: the curve has {len(jumps) or 'no'} jumps, numbered from jump1")
        return jumps[int(text[4:]) - 1]
    if text == "peak":
        peaks = hb.analysis.peaks(branch, measure, element, share=0.99)
        if not peaks:
            raise ValueError(f"POINT peak: {measure} has no peak within the curve")
        return max(peaks, key=lambda point: point.amplitude(measure, element))
    return point_of(branch, text, "POINT")
