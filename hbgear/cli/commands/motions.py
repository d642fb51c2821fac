"""Commands on kinds of motion: ``hbgear backbone``, ``cycles``, ``torus`` and ``follow``."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import Abscissa, OmegaAxis, Ordinate, factor_of
from hbgear.cli import complete as cli_complete
from hbgear.cli.commands.files import BRANCHES, FIGURES, check_writable, outputs
from hbgear.cli.options import (
    Changes,
    Dimensionless,
    Element,
    Figure,
    File,
    First,
    Harmonics,
    Last,
    Measure,
    Model,
    Output,
    OwnModel,
    range_option,
)
from hbgear.cli.output import exit_code, print_table, show_branch
from hbgear.cli.quantities import number_of
from hbgear.cli.support import (
    chosen_model,
    element_of,
    harmonics_of,
    load_with_problem,
    longer_span,
    on_curve,
    range_of,
)
from hbgear.common.text.symbols import unit_of
from hbgear.harmonic.models.frequency_units import PINION, length_scale, model_of, scales_at
from hbgear.io.branches.columns import bracketed, label_of
from hbgear.mechanics.structures.scales import Scales

ROWS = 8
"""Number of rows of the tables of backbones, limit cycles and tori."""


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(backbone)
    app.command()(cycles)
    app.command()(torus)
    app.command()(follow)


def backbone(
    model: Model,
    changes: Changes = None,
    mode: Annotated[int, typer.Option(min=1, help="Mode, in ascending frequency.")] = 1,
    amplitudes: Annotated[
        str, typer.Option("--amplitudes", metavar="FROM:TO", help="rms amplitude of all elements, in model units.")
    ] = "0.01:1",
    harmonics: Harmonics = "16",
    output: Output = None,
    plot: Figure = None,
    measure: Measure = "pp2",
    element: Element = "0",
    dimensionless: Dimensionless = False,
) -> None:
    """Trace the backbone of a mode: its frequency and damping ratio over the amplitude, without excitation.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (results so far are shown and saved).
    """
    check_writable(output, BRANCHES)
    check_writable(plot, FIGURES)
    low, colon, high = amplitudes.partition(":")
    if not colon:
        raise ValueError(f"--amplitudes {amplitudes}: need FROM:TO, such as 0.01:1")
    span = number_of("--amplitudes", low), number_of("--amplitudes", high)
    which = element_of(element)
    machine = chosen_model(model, changes)
    found = hb.analysis.backbone(machine, mode, span, harmonics=_fixed(harmonics))
    across, length = OmegaAxis.of(machine, dimensionless), None if dimensionless else length_scale(machine, {})
    stability = hb.analysis.backbone_stability(found)
    with outputs() as out:
        out.branch(output, found)
        draw = {"stability": stability, "dimensionless": dimensionless}
        out.figure(plot, lambda drawing: drawing.backbone(found, measure, which, **draw))
        print(f"backbone of mode {mode}: {len(found)} points; {found.message}")
        heights = factor_of(measure, length) * found.amplitude(measure, which)
        rows = [
            [across.number(found.tracked["Omega"][i]), f"{found.tracked['modal_damping'][i]:.4g}", f"{heights[i]:.5g}"]
            for i in _some(len(found))
        ]
        unit = "" if length is None else " [um]"
        print_table([across.name, "damping ratio", f"{measure}{unit}"], rows)
        if stability.changes:
            changed = [[across.number(one.Omega), f"{factor_of('rms', length) * one.amplitude:.5g}", one.kind]
                        for one in stability.changes]  # fmt: skip
            print_table([across.name, f"rms of all elements{unit}", "multipliers"], changed, "changes of stability")
        elif "stable" in stability.states and "unstable" not in stability.states:
            print("all motions without dissipation are stable")
        peaks = [
            [across.number(peak.Omega), f"{factor_of('rms', length) * peak.amplitude:.5g}"]
            for peak in hb.analysis.predicted_peaks(found)
        ]
        if peaks:
            print_table([across.name, f"rms of all elements{unit}"], peaks, "predicted resonance peaks, order 1")
    raise typer.Exit(exit_code(found))


def cycles(
    model: Model,
    within: Annotated[str, range_option("Parameter, and its range from the stable side.")],
    changes: Changes = None,
    length: Annotated[
        float, typer.Option(min=1e-300, help="Displacement at which the nonlinearity matters, in model units.")
    ] = 1.0,
    harmonics: Harmonics = "16",
    output: Output = None,
    plot: Figure = None,
    measure: Measure = "pp2",
    element: Element = "0",
    dimensionless: Dimensionless = False,
) -> None:
    """Compute Hopf points of the equilibrium over a parameter, and trace the limit cycles from the first one.

    Exit codes: 0 the end was reached, 2 bad input or no Hopf point, 3 stopped early (results so far are shown).
    """
    check_writable(output, BRANCHES)
    check_writable(plot, FIGURES)
    machine, which = chosen_model(model, changes), element_of(element)
    name, span = range_of(within, machine)
    points = hb.analysis.hopf_points(machine, name, span)
    if not points:
        raise ValueError(f"--in {within}: no Hopf point: no pair of eigenvalues crosses the imaginary axis there")
    unit, header = _in_hertz("Omega", None if dimensionless else machine.scales)
    headers = [f"{name}{bracketed(unit_of(machine.labels.get(name, '')))}", header]
    print_table(headers, [[f"{one.value:.8g}", f"{unit * one.Omega:.8g}"] for one in points], "Hopf points")
    found = hb.analysis.limit_cycles(machine, points[0], span, harmonics=_fixed(harmonics), length=length)
    with outputs() as out:
        out.branch(output, found)
        out.figure(plot, lambda drawing: drawing.response(found, measure, which, dimensionless=dimensionless))
        print(f"limit cycles from {name} = {points[0].value:.6g}: {len(found)} points; {found.message}")
        _show_frequencies(found, "Omega", measure, which, dimensionless)
        show_branch(found, measure, which, dimensionless=dimensionless)
    raise typer.Exit(exit_code(found))


def torus(
    file: File,
    label: Annotated[str, typer.Argument(metavar="LABEL", help="A Neimark-Sacker point of the curve.")] = "NS1",
    model: OwnModel = None,
    first: First = None,
    last: Last = None,
    output: Output = None,
    plot: Figure = None,
    measure: Measure = "pp2",
    element: Element = "0",
    dimensionless: Dimensionless = False,
) -> None:
    """Trace the quasi-periodic motions that leave a saved curve at a Neimark-Sacker point; --plot draws both.

    If the file holds tori, they are continued from their last point.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (results so far are shown and saved).
    """
    check_writable(output, BRANCHES)
    check_writable(plot, FIGURES)
    branch, which = load_with_problem(file, model), element_of(element)
    span = None if first is None and last is None else longer_span(branch, None, first, last)
    loaded = isinstance(branch.problem, hb.harmonic.TorusProblem)
    found = hb.extend(branch, span) if loaded else hb.analysis.torus(*on_curve(branch, label), span)
    with outputs() as out:
        out.branch(output, found)
        shown = [found] if loaded else [branch, found]
        out.figure(plot, lambda drawing: drawing.responses(shown, measure, which, dimensionless=dimensionless))
        origin = f"{len(branch)} points of {file} continued" if loaded else f"tori from {label} of {file}"
        print(f"{origin}: {len(found)} points; {found.message}")
        _show_frequencies(found, "Omega_2", measure, which, dimensionless)
    raise typer.Exit(exit_code(found))


def follow(
    file: File,
    label: Annotated[
        str,
        typer.Argument(metavar="LABEL", help="A special point of the curve.", autocompletion=cli_complete.labels),
    ],
    within: Annotated[str, range_option("Second parameter, and its range, in which the value of the curve lies.")],
    model: OwnModel = None,
    output: Output = None,
    plot: Figure = None,
    dimensionless: Dimensionless = False,
) -> None:
    """Trace the curve of a special point of a saved curve in a second parameter, with its special points.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (results so far are shown and saved).
    """
    check_writable(output, BRANCHES)
    check_writable(plot, FIGURES)
    branch = load_with_problem(file, model)
    name, span = range_of(within, model_of(branch))
    found = hb.follow(*on_curve(branch, label), name, span)
    with outputs() as out:
        out.branch(output, found)
        out.figure(plot, lambda drawing: drawing.special_curves([found], dimensionless=dimensionless))
        print(f"{label} of {file} in {name}: {len(found)} points; {found.message}")
        first = branch.parameter
        across = OmegaAxis.of_ends([found] if first == "Omega" else [], first, dimensionless)
        headers = [f"{name}{bracketed(unit_of(label_of(found, name)))}", across.name if across.is_speed else first]
        rows = [[f"{found.values[i]:.6g}", across.number(found.tracked[first][i])] for i in _some(len(found))]
        print_table(headers, rows)
        special = [
            [p.label, f"{p.parameters[name]:.9g}", across.number(p.parameters[first], 9), p.meaning]
            for p in found.special
        ]
        if special:
            print_table(["", *headers, "event"], special, "special points")
        else:
            print("no special points")
    raise typer.Exit(exit_code(found))


def _fixed(harmonics: str) -> int:
    """Return the number of harmonics, which cannot be "auto" here."""
    number = harmonics_of(harmonics)
    if not isinstance(number, int):
        raise ValueError("--harmonics auto: this command needs a whole number")
    return number


def _some(count: int) -> list[int]:
    """Return the numbers of at most `ROWS` points, both ends among them."""
    return sorted(set(np.linspace(0, count - 1, min(ROWS, count)).round().astype(int).tolist()))


def _in_hertz(frequency: str, known: Scales | None) -> tuple[float, str]:
    """Return the unit of a frequency [Hz] and its header in a table; that of the model without scales."""
    return (1.0, frequency) if known is None else (known.frequency / (2 * np.pi), f"{frequency} [Hz]")


def _show_frequencies(found: hb.Branch, frequency: str, measure: str, element: int | str, dimensionless: bool) -> None:
    """Print the parameter, the unknown frequency and the amplitude at some points of a branch."""
    across, height = Abscissa([found], dimensionless), Ordinate(measure, element, dimensionless=dimensionless)
    unit, name = _in_hertz(frequency, None if dimensionless else scales_at(found, 0))
    x, y, heights = across.along(found), unit * found.tracked[frequency], height.along(found)
    rows = [[f"{x[i]:.6g}", f"{y[i]:.6g}", f"{heights[i]:.5g}"] for i in _some(len(found))]
    print_table([PINION if across.scale != 1 else found.parameter, name, height.header(found)], rows)
