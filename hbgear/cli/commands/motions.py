"""Commands on kinds of motion: ``hbgear backbone``, ``cycles``, ``torus`` and ``follow``."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import Abscissa, OmegaAxis, Ordinate
from hbgear.analysis.quantities.length_units import factor_of
from hbgear.analysis.summary import reliability_lines, special_table
from hbgear.cli import complete as cli_complete
from hbgear.cli import options
from hbgear.cli.output import exit_code, print_table, print_text, show_branch, show_reliability
from hbgear.cli.output_files import outputs
from hbgear.cli.quantities import number_of
from hbgear.cli.support import chosen_model, harmonics_of, load_with_problem, longer_span, on_curve, range_of
from hbgear.common.text.symbols import unit_of
from hbgear.harmonic.models.frequency_units import PINION, length_scale, model_of, scales_at
from hbgear.io.branches.columns import bracketed, label_of
from hbgear.mechanics.structures.scales import Scales

ROWS = 8
"""Number of rows of the tables of backbones, limit cycles and tori."""


def backbone(
    model: options.Model,
    changes: options.Changes = None,
    mode: Annotated[int, typer.Option(min=1, help="Mode, in ascending frequency.")] = 1,
    amplitudes: Annotated[
        str, typer.Option("--amplitudes", metavar="FROM:TO", help="rms amplitude of all elements, in model units.")
    ] = "0.01:1",
    harmonics: options.Harmonics = "16",
    output: options.Output = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Trace the backbone of a mode: its frequency and damping ratio over the amplitude, without excitation.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (results so far are shown and saved).
    """
    low, colon, high = amplitudes.partition(":")
    if not colon:
        raise ValueError(f"--amplitudes {amplitudes}: need FROM:TO, such as 0.01:1")
    span = number_of("--amplitudes", low), number_of("--amplitudes", high)
    machine = chosen_model(model, changes)
    curve = hb.analysis.backbone(machine, mode, span, harmonics=harmonics_of(harmonics))
    axis, length = OmegaAxis.of(machine, dimensionless), None if dimensionless else length_scale(machine, {})
    stability = hb.analysis.backbone_stability(curve)
    with outputs() as out:
        out.branch(output, curve)
        draw = {"stability": stability, "dimensionless": dimensionless}
        out.figure(plot, lambda drawing: drawing.backbone(curve, measure, element, **draw))
        print(f"backbone of mode {mode}: {len(curve)} points; {curve.message}")
        heights = factor_of(measure, length) * curve.amplitude(measure, element)
        rows = [
            [axis.number(curve.tracked["Omega"][i]), f"{curve.tracked['modal_damping'][i]:.4g}", f"{heights[i]:.5g}"]
            for i in _shown_rows(len(curve))
        ]
        unit = "" if length is None else " [um]"
        print_table([axis.name, "damping ratio", f"{measure}{unit}"], rows)
        if stability.changes:
            changed = [
                [axis.number(change.Omega), f"{factor_of('rms', length) * change.amplitude:.5g}", change.kind]
                for change in stability.changes
            ]
            print_table([axis.name, f"rms of all elements{unit}", "multipliers"], changed, "changes of stability")
        elif "stable" in stability.states and "unstable" not in stability.states:
            print("all motions without dissipation are stable")
        peaks = [
            [axis.number(peak.Omega), f"{factor_of('rms', length) * peak.amplitude:.5g}"]
            for peak in hb.analysis.predicted_peaks(curve)
        ]
        if peaks:
            print_table([axis.name, f"rms of all elements{unit}"], peaks, "predicted resonance peaks, order 1")
        show_reliability(curve, dimensionless)
    raise typer.Exit(exit_code(curve))


def cycles(
    model: options.Model,
    within: Annotated[str, options.range_option("Parameter, and its range from the stable side.")],
    changes: options.Changes = None,
    length: Annotated[
        float, typer.Option(min=1e-300, help="Displacement at which the nonlinearity matters, in model units.")
    ] = 1.0,
    harmonics: options.Harmonics = "16",
    output: options.Output = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute Hopf points of the equilibrium over a parameter, and trace the limit cycles from the first one.

    Exit codes: 0 the end was reached, 2 bad input or no Hopf point, 3 stopped early (results so far are shown).
    """
    machine = chosen_model(model, changes)
    name, span = range_of(within, machine)
    points = hb.analysis.hopf_points(machine, name, span)
    if not points:
        raise ValueError(f"--in {within}: no Hopf point: no pair of eigenvalues crosses the imaginary axis there")
    unit, header = _in_hertz("Omega", None if dimensionless else machine.scales)
    headers = [f"{name}{bracketed(unit_of(machine.labels.get(name, '')))}", header]
    print_table(headers, [[f"{point.value:.8g}", f"{unit * point.Omega:.8g}"] for point in points], "Hopf points")
    curve = hb.analysis.limit_cycles(machine, points[0], span, harmonics=harmonics_of(harmonics), length=length)
    with outputs() as out:
        out.branch(output, curve)
        out.figure(plot, lambda drawing: drawing.response(curve, measure, element, dimensionless=dimensionless))
        print(f"limit cycles from {name} = {points[0].value:.6g}: {len(curve)} points; {curve.message}")
        _show_frequencies(curve, "Omega", measure, element, dimensionless)
        show_branch(curve, measure, element, dimensionless=dimensionless)
    raise typer.Exit(exit_code(curve))


def torus(
    file: options.File,
    label: Annotated[str, typer.Argument(metavar="LABEL", help="A Neimark-Sacker point of the curve.")] = "NS1",
    model: options.OwnModel = None,
    first: options.First = None,
    last: options.Last = None,
    output: options.Output = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Trace the quasi-periodic motions that leave a saved curve at a Neimark-Sacker point; --plot draws both.

    If the file holds tori, they are continued from their last point.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (results so far are shown and saved).
    """
    branch = load_with_problem(file, model)
    span = None if first is None and last is None else longer_span(branch, None, first, last)
    is_torus_file = isinstance(branch.problem, hb.harmonic.TorusProblem)
    tori = hb.extend(branch, span) if is_torus_file else hb.analysis.torus(*on_curve(branch, label), span)
    with outputs() as out:
        out.branch(output, tori)
        drawn_branches = [tori] if is_torus_file else [branch, tori]
        out.figure(
            plot, lambda drawing: drawing.responses(drawn_branches, measure, element, dimensionless=dimensionless)
        )
        origin = f"{len(branch)} points of {file} continued" if is_torus_file else f"tori from {label} of {file}"
        print(f"{origin}: {len(tori)} points; {tori.message}")
        _show_frequencies(tori, "Omega_2", measure, element, dimensionless)
        if tori.special:
            print_table(*special_table(tori, measure, element, dimensionless), "special points")
        else:
            print("no special points")
        for line in reliability_lines(tori, dimensionless):
            print_text(line)
    raise typer.Exit(exit_code(tori))


def follow(
    file: options.File,
    label: Annotated[
        str, typer.Argument(metavar="LABEL", help="A special point of the curve.", autocompletion=cli_complete.labels)
    ],
    within: Annotated[
        str, options.range_option("Second parameter, and its range, in which the value of the curve lies.")
    ],
    model: options.OwnModel = None,
    output: options.Output = None,
    plot: options.Figure = None,
    dimensionless: options.Dimensionless = False,
) -> None:
    """Trace the curve of a special point of a saved curve in a second parameter, with its special points.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (results so far are shown and saved).
    """
    branch = load_with_problem(file, model)
    name, span = range_of(within, model_of(branch))
    curve = hb.follow(*on_curve(branch, label), name, span)
    with outputs() as out:
        out.branch(output, curve)
        out.figure(plot, lambda drawing: drawing.special_curves([curve], dimensionless=dimensionless))
        print(f"{label} of {file} in {name}: {len(curve)} points; {curve.message}")
        first = branch.parameter
        axis = OmegaAxis.of_ends([curve] if first == "Omega" else [], first, dimensionless)
        headers = [f"{name}{bracketed(unit_of(label_of(curve, name)))}", axis.name if axis.is_speed else first]
        rows = [[f"{curve.values[i]:.6g}", axis.number(curve.tracked[first][i])] for i in _shown_rows(len(curve))]
        print_table(headers, rows)
        special = [
            [p.label, f"{p.parameters[name]:.9g}", axis.number(p.parameters[first], 9), p.meaning]
            for p in curve.special
        ]
        if special:
            print_table(["", *headers, "event"], special, "special points")
        else:
            print("no special points")
    raise typer.Exit(exit_code(curve))


def _shown_rows(count: int) -> list[int]:
    """Return the numbers of at most `ROWS` points, both ends among them."""
    return sorted(set(np.linspace(0, count - 1, min(ROWS, count)).round().astype(int).tolist()))


def _in_hertz(frequency: str, scales: Scales | None) -> tuple[float, str]:
    """Return the unit of a frequency [Hz] and its header in a table; that of the model without scales."""
    return (1.0, frequency) if scales is None else (scales.frequency / (2 * np.pi), f"{frequency} [Hz]")


def _show_frequencies(branch: hb.Branch, frequency: str, measure: str, element: int | str, dimensionless: bool) -> None:
    """Print the parameter, the unknown frequency and the amplitude at some points of a branch."""
    abscissa, height = Abscissa([branch], dimensionless), Ordinate(measure, element, dimensionless=dimensionless)
    unit, name = _in_hertz(frequency, None if dimensionless else scales_at(branch, 0))
    x, y, heights = abscissa.along(branch), unit * branch.tracked[frequency], height.along(branch)
    rows = [[f"{x[i]:.6g}", f"{y[i]:.6g}", f"{heights[i]:.5g}"] for i in _shown_rows(len(branch))]
    print_table([PINION if abscissa.scale != 1 else branch.parameter, name, height.header(branch)], rows)
