"""Commands on designs: ``hbgear map``, ``critical``, ``switch`` and ``survey``."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import hbgear as hb
from hbgear.analysis.jump_maps import JumpMap
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.analysis.summary import as_speeds, digits_of, message_of, text_at
from hbgear.cli import complete as cli_complete
from hbgear.cli import options
from hbgear.cli.commands.shares import MaxRows, Saved, show_shares
from hbgear.cli.output import bar, exit_code, finish, numbered_branches, print_message, print_table, show_branch
from hbgear.cli.output_files import BRANCHES, check_writable, outputs
from hbgear.cli.support import chosen_model, load_with_problem, on_curve, problem_of, range_of, span_of
from hbgear.common.text.digits import rounded
from hbgear.common.text.symbols import shown_unit
from hbgear.io.map_file import read_map, save_map


def map_command(
    model: options.Model,
    within: Annotated[str, options.range_option("Design parameter, a field of the model, and its range.")],
    changes: options.Changes = None,
    harmonics: options.Harmonics = "16",
    seeds: Annotated[int, typer.Option(min=2, help="Response curves that are searched for jumps.")] = 3,
    first: options.First = None,
    last: options.Last = None,
    output: Annotated[Path | None, options.output_option("Save the jump frequencies as .csv.", ".csv")] = None,
    plot: options.Figure = None,
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute a jump map: jump frequencies against a design parameter, and where jumps vanish.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (complete curves are shown and saved). With -o
    FILE.csv, complete curves are then kept in FILE.part.npz, and the same command continues from them.
    """
    problem = problem_of(chosen_model(model, changes), harmonics)
    parameter, span = range_of(within, problem.model, first, last)
    frequencies = span_of(problem.model, first, last)
    path = output.with_suffix(".part.npz") if output else None
    previous = None
    if path and path.exists():
        previous = read_map(path, problem, parameter, span, frequencies)
        print(f"continuing from '{path}': {len(previous.curves)} response curves, {len(previous.folds)} fold curves")
    with bar("map") as progress:
        jump_map = hb.jump_map(
            problem, parameter, span, frequencies=frequencies, seeds=seeds, progress=progress, known=previous
        )
    with outputs() as out:
        out.write(output, jump_map.export)
        if jump_map.status is hb.Status.INTERRUPTED:
            if path:
                out.write(path, partial(save_map, jump_map))
            kept = f"kept in '{path}'" if path else "complete; with -o FILE.csv they are kept"
            print(
                f"{len(jump_map.curves)} response curves and {len(jump_map.folds)} fold curves are {kept}: "
                "the same command continues from there"
            )
        elif path:
            path.unlink(missing_ok=True)
        out.figure(plot, lambda drawing: drawing.jump_map(jump_map, dimensionless=dimensionless))
        _print_map(jump_map, parameter, span, frequencies, unit_after(problem.model, parameter), dimensionless)
    finish(jump_map)


def _print_map(
    jump_map: JumpMap,
    parameter: str,
    span: tuple[float, float],
    frequencies: tuple[float, float],
    unit: str,
    dimensionless: bool,
) -> None:
    """Print the jump curves of a map, the values at which jumps vanish, and its other special points."""
    digits = min((digits_of(fold, 6) for fold in jump_map.folds), default=6)
    axis = OmegaAxis.of_ends(jump_map.folds, jump_map.labels.get("Omega", ""), dimensionless)
    low, high = min(frequencies), max(frequencies)
    leaves = {id(arm) for arm in jump_map.arms if arm.Omega.min() < low or arm.Omega.max() > high}
    rows = [
        [
            f"{arm.values[0]:.{digits}g} to {arm.values[-1]:.{digits}g}",
            " to ".join(axis.number(Omega, digits) for Omega in arm.Omega[[0, -1]]) + " *" * (id(arm) in leaves),
            "increasing" if arm.direction > 0 else "decreasing",
        ]
        for arm in sorted(jump_map.arms, key=lambda arm: arm.Omega.min())
    ]
    if not rows and jump_map.status.complete and not jump_map.message:
        print(f"no jump for {parameter} between {min(span):g} and {max(span):g}{unit}")
    elif rows:
        headers = [parameter + (f" [{unit.strip()}]" if unit else ""), axis.name, "sweep"]
        print_table(headers, rows, "jump curves")
    if leaves:
        bounds = f"{axis.number(low, digits)} to {axis.number(high, digits)}"
        print(f"* leaves the range of the response curves, {bounds}, outside of which no other jumps are searched")
    for cusp in jump_map.cusps:
        print(f"a jump vanishes at {parameter} = {text_at(cusp, parameter)}{unit}, {_frequency_text(cusp, axis)}")
    for point in (p for p in jump_map.special if p not in jump_map.cusps):
        location = f"{parameter} = {text_at(point, parameter)}{unit}, {_frequency_text(point, axis)}"
        print(f"{point.meaning} ({point.label}) at {location}")
    if jump_map.status.complete and jump_map.message:
        print_message("warning", as_speeds(jump_map.message, axis.scale) if axis.is_speed else jump_map.message)


def _frequency_text(point: hb.SpecialPoint, axis: OmegaAxis) -> str:
    """Return the speed of a special point, or its Omega with the digits that are known."""
    return axis.text(point.parameters["Omega"]) if axis.is_speed else f"Omega = {text_at(point, 'Omega')}"


def unit_after(model: Any, parameter: str) -> str:
    """Return the unit of a parameter of a drawing after its value, such as " um"; empty for other models."""
    unit = shown_unit(str(model.labels.get(parameter, ""))) if model.scales is not None else ""
    return f" {unit}" if unit else ""


def critical(
    model: options.Model,
    parameter: Annotated[
        str,
        typer.Argument(
            metavar="PARAMETER", help="A field of the model, such as zeta.", autocompletion=cli_complete.parameters
        ),
    ],
    changes: options.Changes = None,
    harmonics: options.Harmonics = "16",
    first: options.First = None,
    last: options.Last = None,
    derivatives: Annotated[
        bool, typer.Option("--sensitivity", help="Print the derivatives of the value by all other parameters.")
    ] = False,
    quantity: Annotated[
        str, typer.Option("--sort-by", help="Quantity by which that table is sorted.", show_default="PARAMETER")
    ] = "",
    max_rows: MaxRows = 15,
    output: Saved = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute the value of a parameter at which a jump appears or vanishes, and the frequency of that jump.

    With --sensitivity, -o or --plot also its derivatives by all other parameters, in percent per percent.
    Exit codes: 0 found, 2 bad input or no such value, 3 stopped early (results so far are shown).
    """
    problem = problem_of(chosen_model(model, changes), harmonics)
    problem.check_parameter(parameter)
    with bar("critical") as progress:
        result = hb.analysis.critical_parameter(
            problem, parameter, frequencies=span_of(problem.model, first, last), progress=progress
        )
    model_value = problem.value_of(parameter)
    side = "below" if result.jump_below else "above"
    digits = digits_of(result.point)
    axis = OmegaAxis.of(problem.model_at({parameter: result.value}), dimensionless)
    unit = unit_after(problem.model, parameter)
    print(f"{parameter} = {text_at(result.point, parameter)}{unit}: a jump exists {side} this value and vanishes at it")
    Omega = result.point.parameters["Omega"]
    print(f"it appears at {axis.text(Omega) if axis.is_speed else 'Omega = ' + text_at(result.point, 'Omega')}")
    distance = f", {abs(result.value / model_value - 1):.2%} away" if model_value else ""
    print(f"the model has {parameter} = {model_value:.6g}{unit}{distance}")

    def axis_at(value: float) -> OmegaAxis:
        return OmegaAxis.of(problem.model_at({parameter: value}), dimensionless)

    for other_value, Omega in result.others:
        values = f"{parameter} = {rounded(other_value, digits)}{unit}, {axis_at(other_value).text(Omega, digits)}"
        print(f"another jump appears or vanishes at {values}")
    if derivatives or output or plot:
        sensitivities = hb.analysis.sensitivity(result, measure=measure, element=element)
        show_shares(sensitivities, problem.model.labels, quantity, max_rows, output, plot, dimensionless)
    finish(result)


def switch(
    file: options.File,
    label: Annotated[
        str,
        typer.Argument(
            metavar="LABEL", help="A PD or BP of the curve, such as PD1.", autocompletion=cli_complete.crossings
        ),
    ],
    model: options.OwnModel = None,
    output: options.Output = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
) -> None:
    """Trace the branch that leaves a saved curve at a period doubling or branch point."""
    branch, label_on_branch = on_curve(load_with_problem(file, model), label)
    new = hb.switch(branch, label_on_branch)
    names = [str(file), f"from {label}"]
    with outputs() as out:
        out.branch(output, new)
        out.figure(plot, lambda drawing: drawing.responses((branch, new), measure, element, names=names))
        print(f"from {label} of {file}: {len(new)} points; {message_of(new)}")
        show_branch(new, measure, element, [(str(file), branch)])
    raise typer.Exit(exit_code(new))


def survey(
    model: options.Model,
    changes: options.Changes = None,
    first: options.First = None,
    last: options.Last = None,
    harmonics: options.Harmonics = "16",
    nu: Annotated[int, typer.Option(min=1, help="Subharmonic order: motions of nu periods of the excitation.")] = 1,
    frequencies: Annotated[
        int, typer.Option("--frequencies", min=1, help="Frequencies at which further motions are searched.")
    ] = 5,
    guesses: Annotated[int, typer.Option(min=1, help="Random initial guesses at each frequency.")] = 20,
    folder: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for branch1.npz, branch2.npz, ...")
    ] = None,
    plot: options.Figure = None,
    measure: options.Measure = "pp2",
    element: options.Element = "0",
    dimensionless: options.Dimensionless = False,
) -> None:
    """Trace every branch in a span, including disconnected branches.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (results so far are shown and saved).
    """
    if folder is not None:
        if not os.path.isdir(folder):
            raise ValueError(f"there is no folder '{folder}' for branch1.npz, branch2.npz, ...; create it first")
        check_writable(folder / "branch1.npz", BRANCHES)
    problem = problem_of(chosen_model(model, changes), harmonics, nu=nu)
    span = span_of(problem.model, first, last)
    with bar("survey") as progress:
        survey_result = hb.trace_all(problem, span, frequencies=frequencies, guesses=guesses, progress=progress)
    with outputs() as out:
        for number, branch in enumerate(survey_result.branches, 1):
            out.branch(folder / f"branch{number}.npz" if folder else None, branch)
        out.figure(
            plot,
            lambda drawing: drawing.responses(survey_result.branches, measure, element, dimensionless=dimensionless),
        )
        numbered = numbered_branches(survey_result.branches)
        for i, (name, branch) in enumerate(numbered):
            print(f"{name}: {len(branch)} points; {message_of(branch, dimensionless)}")
            show_branch(branch, measure, element, [*numbered[:i], *numbered[i + 1 :]], dimensionless)
    finish(survey_result, *survey_result.branches)
