"""Commands on designs: ``hbgear map``, ``critical``, ``switch`` and ``survey``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import hbgear as hb
from hbgear import catalogue
from hbgear.cli_support import (
    BRANCHES,
    FIGURES,
    Changes,
    Element,
    File,
    Harmonics,
    Measure,
    check_writable,
    chosen_model,
    draw,
    element_of,
    exit_code,
    one_thread,
    print_table,
    problem_of,
    reporting,
    save_branch,
    show_branch,
    wrote,
)

Model = Annotated[str, typer.Argument(metavar="MODEL", help=f"One of: {', '.join(catalogue.MODELS)}.")]
Low = Annotated[float | None, typer.Option("--omega-from", help="Lowest Omega.", show_default="the model's")]
High = Annotated[float | None, typer.Option("--omega-to", help="Highest Omega.", show_default="the model's")]
Figure = Annotated[Path | None, typer.Option(help="Draw to a .png, .pdf or .svg.")]


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command(name="map")(map_command)
    app.command()(critical)
    app.command()(switch)
    app.command()(survey)


def map_command(
    model: Model,
    parameter: Annotated[str, typer.Option("--in", help="Design parameter: a field of the model.")],
    first: Annotated[float, typer.Option("--from", help="Start of its range.")],
    last: Annotated[float, typer.Option("--to", help="End of its range.")],
    changes: Changes = None,
    harmonics: Harmonics = "12",
    seeds: Annotated[int, typer.Option(min=2, help="Response curves on which jumps are looked for.")] = 3,
    low: Low = None,
    high: High = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Save the jump frequencies as .csv.")] = None,
    plot: Figure = None,
) -> None:
    """Jump map: jump frequencies against a design parameter, and where they vanish."""
    check_writable(output, (".csv",))
    check_writable(plot, FIGURES)
    problem = problem_of(chosen_model(model, changes), harmonics)
    frequencies = _frequencies(problem, low, high)
    with one_thread(), reporting() as report:
        found = hb.jump_map(problem, parameter, (first, last), frequencies=frequencies, seeds=seeds, report=report)
    rows = [
        [f"{arm.values[0]:.6g} to {arm.values[-1]:.6g}", f"{arm.Omega[0]:.6g} to {arm.Omega[-1]:.6g}",
         "increasing" if arm.direction > 0 else "decreasing"]
        for arm in found.arms
    ]  # fmt: skip
    if not rows:
        print(f"no jump for {parameter} between {first:g} and {last:g}")
    else:
        print_table([parameter, "Omega", "jump while Omega is"], rows, "jump curves")
    for cusp in found.cusps:
        print(
            f"a jump vanishes at {parameter} = {cusp.parameters[parameter]:.8g}, Omega = {cusp.parameters['Omega']:.8g}"
        )
    if output:
        found.export(output)
    if plot:
        draw(plot, lambda drawing: drawing.jump_map(found))
    wrote(output, plot)


def critical(
    model: Model,
    parameter: Annotated[str, typer.Argument(metavar="PARAMETER", help="A field of the model, such as zeta.")],
    changes: Changes = None,
    harmonics: Harmonics = "16",
    low: Low = None,
    high: High = None,
) -> None:
    """The value of a parameter at which a jump appears or vanishes, and the frequency at which it does so."""
    problem = problem_of(chosen_model(model, changes), harmonics)
    problem.check_parameter(parameter)
    with one_thread(), reporting() as report:
        found = hb.critical(problem, parameter, frequencies=_frequencies(problem, low, high), report=report)
    own = problem.parameters.get(parameter, float("nan"))
    side = "below" if found.jump_below else "above"
    print(f"{parameter} = {found.value:.8g}: a jump exists {side} this value, none just on the other side")
    print(f"it appears at Omega = {found.Omega:.8g}")
    distance = f", {abs(found.value / own - 1):.2%} away" if own else ""
    print(f"the model has {parameter} = {own:.6g}{distance}")
    for value, Omega in found.others:
        print(f"another jump appears or vanishes at {parameter} = {value:.8g}, Omega = {Omega:.8g}")


def switch(
    file: File,
    label: Annotated[str, typer.Argument(metavar="LABEL", help="A PD or BP of the curve, such as PD1.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Save as .npz, or export .csv or .mat.")] = None,
    plot: Figure = None,
    measure: Measure = "pp2",
    element: Element = "0",
) -> None:
    """Trace the branch that leaves a saved curve at a period doubling or branch point."""
    check_writable(output, BRANCHES)
    check_writable(plot, FIGURES)
    branch, which = hb.load(file), element_of(element)
    branch = hb.load(file, problem=catalogue.problem_of(branch.meta))
    with one_thread():
        new = hb.switch(branch, label)
    save_branch(new, output)
    names = [str(file), f"from {label}"]
    if plot:
        draw(plot, lambda drawing: drawing.responses((branch, new), measure, which, names=names))
    print(f"from {label} of {file}: {len(new)} points; {new.message}")
    show_branch(new, measure, which, beside=(branch,), names=names[:1])
    wrote(output, plot)
    raise typer.Exit(exit_code(new))


def survey(
    model: Model,
    changes: Changes = None,
    low: Low = None,
    high: High = None,
    harmonics: Harmonics = "16",
    nu: Annotated[int, typer.Option(min=1, help="Subharmonic order: motions of nu periods of the excitation.")] = 1,
    places: Annotated[int, typer.Option(min=1, help="Frequencies at which more motions are sought.")] = 5,
    guesses: Annotated[int, typer.Option(min=1, help="Random starts at each.")] = 20,
    folder: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for branch1.npz, branch2.npz, ...")
    ] = None,
    plot: Figure = None,
    measure: Measure = "pp2",
    element: Element = "0",
) -> None:
    """Every branch in a span, also those not connected with each other."""
    check_writable(plot, FIGURES)
    machine, which = chosen_model(model, changes), element_of(element)
    if folder is not None and not folder.is_dir():
        raise ValueError(f"there is no folder '{folder}'; create it first")
    problem = problem_of(machine, harmonics, nu=nu)
    span = _frequencies(problem, low, high)
    with one_thread(), reporting() as report:
        found = hb.trace_all(problem, span, frequencies=places, guesses=guesses, report=report)
    for number, branch in enumerate(found.branches, 1):
        print(f"branch {number}: {len(branch)} points; {branch.message}")
        others = [i for i in range(len(found)) if i != number - 1]
        show_branch(branch, measure, which, [found.branches[i] for i in others], [f"branch {i + 1}" for i in others])
        if folder is not None:
            branch.save(folder / f"branch{number}.npz")
    if plot:
        draw(plot, lambda drawing: drawing.responses(found.branches, measure, which))
    wrote(*([folder / f"branch{i + 1}.npz" for i in range(len(found))] if folder else []), plot)
    raise typer.Exit(max((exit_code(branch) for branch in found.branches), default=0))


def _frequencies(problem: hb.HarmonicBalance, low: float | None, high: float | None) -> tuple[float, float]:
    a, b = problem.model.default_span
    rising = a < b
    a, b = (a, b) if rising else (b, a)
    a, b = (a if low is None else low), (b if high is None else high)
    return (a, b) if rising else (b, a)
