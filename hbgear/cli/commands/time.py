"""Commands that integrate in time: ``hbgear validate``, ``hbgear sweep`` and ``hbgear basins``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.analysis.quantities.length_units import dimension_of, factor_of
from hbgear.analysis.summary import OMEGA_TEXT
from hbgear.cli import options
from hbgear.cli.output import STOPPED_EARLY, bar, print_table
from hbgear.cli.output_files import FIGURES, check_writable, outputs
from hbgear.cli.quantities import is_number, number_of
from hbgear.cli.support import chosen_model, path_of, problem_in
from hbgear.common.units import to_si
from hbgear.harmonic.models.frequency_units import Omega_of, length_scale, scales

DISAGREES = 1
"""Exit code of a validation in which a point or jump disagrees."""


def validate(
    file: options.File,
    model: options.OwnModel = None,
    points: Annotated[int, typer.Option(min=1, help="Number of points of all curves, chosen by importance.")] = 12,
    tolerance: Annotated[float, typer.Option(help="Largest relative difference that agrees.")] = 1e-4,
    landing: options.Landing = "integrate",
    other_branches: options.OtherCurves = None,
    output: options.Table = None,
    plot: options.Figure = None,
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Validate the curves of a file by time integration, point by point.

    The table lists the differences of the curve as traced. A point whose difference exceeds the tolerance is solved
    again with up to 8 times the harmonics; if it agrees then, it counts as agreeing, and both differences are shown.
    Jumps are integrated to their steady state, unless --landing nearest accepts them as they are.
    Exit codes: 0 every point and jump agrees, 1 one does not, 2 bad input, 3 interrupted (results so far are shown and
    saved).
    """
    from hbgear.time.validation.validate import validate as validate_by_integration

    branch = hb.load(file)
    branch[0].amplitude("rms", element)
    problem = None if model is None else problem_in(branch, model)
    other_curves = [hb.load(path) for path in other_branches or ()]
    with bar("points") as progress:
        report = validate_by_integration(
            branch, points, tolerance, problem=problem, landing=landing, others=other_curves, progress=progress
        )
    headers, rows = report.table(dimensionless)
    with outputs() as out:
        out.write(output, report.export)
        out.figure(
            plot if report.rows else None,
            lambda drawing: drawing.validation(report, branch, element, dimensionless=dimensionless),
        )
        print_table(headers, rows, "harmonic balance against time integration")
        if report.jumps:
            print_table(*report.jump_table(dimensionless), "landings of jumps by integration")
        print(report.summary)
    raise typer.Exit(STOPPED_EARLY if not report.complete else 0 if report.ok else DISAGREES)


Remaining = Annotated[float, typer.Option(help="Largest remaining distance from the steady state.")]

MaxPeriods = Annotated[int, typer.Option("--max-periods", help="Periods to integrate per value at most, 20 or more.")]

CurveBelow = Annotated[
    Path | None, typer.Option("--curve", metavar="FILE", help="A saved curve to draw the sweeps on.")
]

SweepFigure = Annotated[
    Path | None, options.file_option("Draw to a .png, .pdf or .svg.", FIGURES, default="FILE_sweep.png with --curve")
]

PoincareFigure = Annotated[Path | None, options.file_option("Draw the Poincare points against the parameter.", FIGURES)]


def sweep(
    model: options.Model,
    changes: options.Changes = None,
    up: Annotated[bool, typer.Option("--up", help="Sweep with increasing parameter (default without --down).")] = False,
    down: Annotated[bool, typer.Option("--down", help="Sweep with decreasing parameter.")] = False,
    first: options.First = None,
    last: options.Last = None,
    within: options.Within = None,
    at: options.At = None,
    count: Annotated[int, typer.Option(min=2, max=100_000, help="Number of values, the ends included.")] = 131,
    tolerance: Remaining = 1e-7,
    max_periods: MaxPeriods = 3000,
    curve_file: CurveBelow = None,
    output: options.Table = None,
    plot: SweepFigure = None,
    bifurcation: PoincareFigure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute a slow sweep by time integration, with its jumps and its motions of other periods.

    Exit codes: 0 the end was reached, 2 bad input, 3 interrupted (results so far are shown and saved).
    """
    from hbgear.time.frequency_sweep import export
    from hbgear.time.frequency_sweep import sweep as run
    from hbgear.time.steady_state import SteadyStateSettings
    from hbgear.time.validation.point_selection import same_model

    plot = plot or (curve_file.with_name(f"{curve_file.stem}_sweep.png") if curve_file else None)
    check_writable(plot, FIGURES)
    machine = chosen_model(model, changes)
    parameter, span, fixed = path_of(machine, within, first, last, at)
    grid = np.linspace(*span, count)
    curve = hb.load(curve_file) if curve_file else None
    if curve is not None:
        same_model(curve.meta.get("model"), machine)
        curve[0].amplitude(measure, element)
    settling = SteadyStateSettings(tolerance, max_periods)
    sweeps: list[Any] = []
    for direction in [name for name, selected in (("up", up or not down), ("down", down)) if selected]:
        with bar(f"sweep {direction}") as progress:
            sweeps.append(
                run(machine, grid, direction, parameter=parameter, at=fixed, settling=settling, progress=progress)
            )
        if not sweeps[-1].status.complete:
            break
    sweeps = [s for s in sweeps if len(s)]
    with outputs() as out:
        if sweeps:
            out.write(output, lambda path: export(sweeps, path))
            shown: dict[str, Any] = {"model": machine, "dimensionless": dimensionless}
            out.figure(plot, lambda drawing: drawing.sweeps(sweeps, curve, measure, element, **shown))
            out.figure(bifurcation, lambda drawing: drawing.bifurcation(sweeps, element, **shown))
        for s in sweeps:
            _show(s, measure, element, machine, dimensionless)
    complete = bool(sweeps) and all(s.status.complete for s in sweeps)
    raise typer.Exit(0 if complete else STOPPED_EARLY)


def basins(
    model: options.Model,
    omega: Annotated[str, typer.Option(help="Frequency: Omega, or a speed such as 9000r/min or 2500Hz.")],
    changes: options.Changes = None,
    d: Annotated[
        str,
        typer.Option(metavar="FROM:TO", help="Range of the initial element coordinate, such as -2:2 or -80um:80um."),
    ] = "-2:2",
    v: Annotated[
        str, typer.Option(metavar="FROM:TO", help="Range of its initial rate, such as -2:2 or -1m/s:1m/s.")
    ] = "-2:2",
    shape: Annotated[
        tuple[int, int],
        typer.Option(metavar="COUNT COUNT", help="Numbers of initial states along both ranges, such as 60 60."),
    ] = (60, 60),
    element: Annotated[
        Any,
        typer.Option(
            parser=options.element_of,
            metavar="NUMBER|NAME",
            help="Element of the coordinate, by number or name; required if there are several.",
        ),
    ] = None,
    tolerance: Remaining = 1e-6,
    max_periods: Annotated[
        int, typer.Option("--max-periods", min=1, help="Periods to integrate per initial state at most.")
    ] = 3000,
    output: options.Table = None,
    plot: options.Figure = None,
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute basins of attraction over the coordinate and rate of an element.

    All other coordinates start at rest. Exit codes: 0 all initial states were integrated, 2 bad input, 3 interrupted
    (results so far are shown and saved).
    """
    from hbgear.time.steady_state import SteadyStateSettings

    machine = chosen_model(model, changes)
    Omega, units = Omega_of(machine, "--omega", omega), machine.scales
    length, rate = (None, None) if units is None else (units.length, units.velocity)
    spans = _ends("--d", d, "m", length), _ends("--v", v, "m/s", rate)
    settling = SteadyStateSettings(tolerance, max_periods, min(16, max_periods))
    with bar("basins") as progress:
        result = hb.time.basins(
            machine, Omega, spans[0], spans[1], shape, element=element, settling=settling, progress=progress
        )
    with outputs() as out:
        out.write(output, result.export)
        out.figure(plot, lambda drawing: drawing.basins(result, model=machine, dimensionless=dimensionless))
        length = None if dimensionless else length
        size, axis_text = f"rms{'' if length is None else ' [um]'}", OmegaAxis.of(machine, dimensionless).text(Omega)
        rows = [
            [str(a.period or "not periodic"), f"{factor_of('rms', length) * a.rms:.5g}", f"{a.share:.2%}"]
            for a in result.attractors
        ]
        print_table(["period", size, "fraction of initial states"], rows, f"motions at {axis_text}")
        print(result.message)
    raise typer.Exit(0 if result.status.complete else STOPPED_EARLY)


def _ends(option: str, text: str, unit: str, size: float | None) -> tuple[float, float]:
    """Return the ends of a range FROM:TO, numbers or quantities; size [unit]: unit of the model, None if unknown."""
    low, colon, high = text.partition(":")
    if not colon:
        raise ValueError(f"{option} {text}: need a range, such as {option} -2:2")
    if size is None or (is_number(low) and is_number(high)):
        return number_of(option, low), number_of(option, high)
    return to_si(option, "an end", low, unit) / size, to_si(option, "an end", high, unit) / size


def _show(s: Any, measure: str, element: int | str, model: hb.mechanics.Model, dimensionless: bool) -> None:
    """Print a sweep: how it ended, its jumps, and the motions that do not have the period of the excitation."""
    axis = OmegaAxis(scales(model, {}) if s.parameter == "Omega" else {}, dimensionless=dimensionless)
    name = axis.name if axis.is_speed else s.parameter
    length = None if dimensionless else length_scale(model, {})
    factor = factor_of(measure, length)
    size, unit = factor * s.amplitude(measure, element), "" if length is None else " [um]" * dimension_of(measure)
    message = OMEGA_TEXT.sub(lambda match: axis.text(float(match[1]), 5), s.message) if axis.is_speed else s.message
    print(f"sweep {'up' if s.direction > 0 else 'down'}: {len(s)} values; {message}")
    jumps = []
    for jump in s.jumps:
        ends = [float(size[np.argmin(np.abs(s.values - x))]) for x in jump.interval]
        jumps.append([*(axis.number(x) for x in jump.interval), *(f"{x:.5g}" for x in ends)])
    if jumps:
        headers = [f"jump after{f' {name}' if axis.is_speed else ''}", "before", f"{measure}{unit} before", "after"]
        print_table(headers, jumps, "jumps")
    rows = []
    for i in np.flatnonzero(s.period != 1):
        distance = (
            f"remaining distance {s.remaining_distance[i]:.0e}"
            if np.isfinite(s.remaining_distance[i])
            else "not converging"
        )
        converging = f", {distance}" if s.lyapunov[i] < 0 else ""
        aperiodic = (
            f"not periodic after {s.integrated_periods[i]} periods{converging}, Lyapunov exponent {s.lyapunov[i]:.3g}"
        )
        motion = f"period {s.period[i]}" if s.period[i] else aperiodic
        rows.append([axis.number(s.values[i]), motion, f"{size[i]:.5g}"])
    if rows:
        headers = [name, "motion", measure + unit]
        print_table(headers, rows, "motions that do not have the period of the excitation")
