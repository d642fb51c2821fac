"""Commands for machines given by drawing data: ``hbgear gear``, ``hbgear speed``, ``hbgear results``."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from operator import methodcaller
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, cast

import numpy as np
import typer

import hbgear as hb
from hbgear.analysis.jump_landings import landings
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.analysis.quantities.engineering_quantities import MachineQuantities, problem_along
from hbgear.analysis.summary import message_of, position_headers, position_texts
from hbgear.cli import options
from hbgear.cli.machine_report import gear_tables
from hbgear.cli.machine_report.assumptions import (
    JUMPS,
    NO_RELIEF,
    alternative_row,
    alternatives,
    factor_and_jumps,
    print_assumptions,
    show_assumptions,
    with_default_span,
    without_relief_warning,
)
from hbgear.cli.machine_report.peaks import refined_peak, stable_or_limit
from hbgear.cli.machine_report.speed_ranges import clipped
from hbgear.cli.machine_report.speeds import recommendation, show_speeds
from hbgear.cli.machine_report.subharmonics import Subharmonic, show_subharmonics, subharmonics
from hbgear.cli.output import exit_code, print_message, print_table, print_text
from hbgear.cli.output_files import FIGURES, check_writable, outputs
from hbgear.cli.quantities import is_number
from hbgear.cli.support import (
    check_shown,
    chosen_model,
    harmonics_of,
    label_on_curve,
    loaded,
    problem_in,
    span_of,
    traced,
)
from hbgear.common.process.threads import begun
from hbgear.common.text.digits import rounded

if TYPE_CHECKING:
    from hbgear.gears import DrawnPair
    from hbgear.io.machines.machine_file import Machine


DEFAULT_DAMPING = 0.04
"""Default damping ratio of a mesh; measured values lie between 0.02 and 0.1."""

DAMPING_RANGE = "effect of the damping ratio of the mesh, whose measured values lie between 0.02 and 0.1"
"""Title of the table of damping ratios, which is printed before all results that depend on them."""


Torque = Annotated[str, typer.Option(help="Mean torque on the pinion, such as 200Nm; negative if the wheel drives.")]

Damping = Annotated[str | None, typer.Option(help="Damping ratio of the mesh.", show_default=str(DEFAULT_DAMPING))]

BacklashAs = Annotated[
    str, typer.Option("--backlash-as", help="Definition of the backlash: circumferential, normal or action.")
]

MeshModel = Annotated[
    str | None,
    typer.Option(
        help="Model of the mesh: teeth (pairs of teeth with their own gaps), or one stiffness, secant or tangent.",
        show_default="teeth",
    ),
]

TorqueOrders = Annotated[
    str | None,
    typer.Option(
        help='Harmonics of the torque by order of the pinion, such as "2: 60Nm, 1/2: 5Nm 30deg". Give few '
        "harmonics then, such as --harmonics 4: the period has many meshes, and a curve takes minutes."
    ),
]

Runout = Annotated[
    str,
    typer.Option(
        metavar="F1,F2",
        help="Radial run-out of pinion and wheel, or of the pinion only, such as 20um. The period "
        "has many meshes then, as for --torque-orders.",
    ),
]

Friction = Annotated[
    str | None, typer.Option(help="Coefficient of friction between the teeth, such as 0.05.", show_default="0")
]

GearFigure = Annotated[
    Path | None, options.file_option("Draw to a .png, .pdf or .svg.", FIGURES, default="gear-Z1-Z2.png")
]


def gear(
    ctx: typer.Context,
    z: Annotated[str, typer.Option("--z", metavar="Z1,Z2", help="Teeth of pinion and wheel; -Z2 for a ring.")],
    module: Annotated[str, typer.Option(help="Normal module, such as 3mm.")],
    width: Annotated[str, typer.Option(help="Face width, such as 20mm.")],
    torque: Torque,
    backlash: Annotated[str, typer.Option(help="Circumferential backlash on the working pitch circle, such as 80um.")],
    damping: Damping = None,
    helix: Annotated[str, typer.Option(help="Helix angle of the pinion, positive right-handed.")] = "0 deg",
    pressure: Annotated[str, typer.Option(help="Normal pressure angle.")] = "20 deg",
    shift: Annotated[str, typer.Option(metavar="X1,X2", help="Profile shifts over the module.")] = "0,0",
    relief: Annotated[str, typer.Option(help="Tip relief of both gears, such as 15um.")] = "0 um",
    measure: BacklashAs = "circumferential",
    mesh: MeshModel = None,
    torque_orders: TorqueOrders = None,
    runout: Runout = "0 um",
    friction: Friction = None,
    rack: Annotated[bool, typer.Option("--rack", help="The wheel is a rack of Z2 teeth.")] = False,
    harmonics: options.Harmonics = "24",
    output: Annotated[Path | None, options.output_option("Write the machine as .toml.", ".toml")] = None,
    plot: GearFigure = None,
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute geometry, mesh stiffness, natural frequency and jump speeds of a gear pair from its drawing.

    A table shows how the jumps change with the assumed values. -o writes a file for hbgear trace and hbgear speed,
    which can also hold other inertias, centre distance, crowning and bearings.
    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early.
    """
    teeth = _two_values("--z", z, int, "25,40")
    plot = plot or _default_figure(teeth)
    machine = _machine(teeth, SimpleNamespace(**ctx.params))
    with without_contact_warning():
        curve = _trace_and_report(machine, harmonics_of(harmonics), damping is None, output, plot, dimensionless)
    raise typer.Exit(exit_code(curve))


def speed(
    file: Annotated[str, typer.Argument(metavar="FILE.toml", help="The machine, as written by hbgear gear -o.")],
    changes: options.Changes = None,
    first: Annotated[
        str | None, typer.Option("--from", help="Speed of the pinion at the start, such as 15000r/min.")
    ] = None,
    last: Annotated[str | None, typer.Option("--to", help="Speed of the pinion at the end.")] = None,
    harmonics: options.Harmonics = "24",
    output: options.Output = None,
    plot: options.Figure = None,
    measure: options.ShownMeasure = None,
    dimensionless: options.Dimensionless = False,
) -> None:
    """Compute resonances, jumps, safe and critical speeds of a machine.

    Resonances and jumps have their dynamic factors, transmission errors and forces. For a gear pair, a table shows how
    they change with assumed values: damping, pitch error, tip relief, inertia and the model of the mesh. --from and
    --to limit the tables; the curve of a gear pair covers its usual range too, because motions may come from there.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (all traced points are saved).
    """
    model = chosen_model(file, changes)
    if model.scales is None:
        raise ValueError(
            f"'{file}' has no scales, so its speeds in r/min are unknown: give the file of a machine (hbgear gear -o)"
        )
    for option, text in (("--from", first), ("--to", last)):
        if text is not None and is_number(text):
            raise ValueError(f"{option} {text}: need a speed with its unit, such as {option} 9000r/min")
    span, shown = span_of(model, first, last), None
    from hbgear.gears import DrawnPair

    count = harmonics_of(harmonics)
    problem, doubled = hb.HarmonicBalance(model, count), list[Subharmonic]()
    check_shown(problem, measure, 0)
    is_pair = isinstance(model, DrawnPair) and model.mesh_order == 1  # otherwise each curve takes minutes
    is_limited = first is not None or last is not None
    if is_pair and is_limited:
        low, high = (float(model.scales.pinion_speed(end)) for end in sorted(span))
        shown, span = (low, high), with_default_span(model, span)
    with without_contact_warning():
        curve = traced(problem, "Omega", span)
        if is_pair and curve.status.complete:
            doubled = subharmonics(model, curve, count, Event())
    other_ranges = [speeds for motions in doubled for speeds in motions.ranges]
    with without_contact_warning(), outputs() as out:
        out.branch(output, curve)
        out.figure(plot, lambda drawing: drawing.response(curve, measure, dimensionless=dimensionless))
        print_text(f"{model.title or file}: {len(curve)} points; {message_of(curve, dimensionless)}")
        if interrupted(curve):
            print_text(PARTIAL)
            raise typer.Exit(exit_code(curve))
        if shown is not None:
            print_text(f"speeds from {shown[0]:.0f} to {shown[1]:.0f} r/min, with motions that come from other speeds")
        show_speeds(model, curve, dimensionless, other_ranges, shown)
        show_subharmonics([motions for motions in doubled if clipped(motions.ranges, shown)])
        if is_pair:
            show_assumptions(cast("DrawnPair", model), curve, count, shown)
        elif is_limited:
            print_text(
                "not included: motions that are reached from speeds outside this range, and those of twice the period"
            )
        print_text(recommendation(model, curve, other_ranges=other_ranges, shown=shown))
    raise typer.Exit(exit_code(curve))


def results(
    file: options.File,
    quantity: Annotated[
        str,
        typer.Argument(metavar="[QUANTITY]", help="Quantity to print at jumps and to draw, such as 'force, largest'."),
    ] = "dynamic factor",
    model: options.OwnModel = None,
    element: options.Element = "0",
    dof: Annotated[
        str | None, typer.Option(help="Coordinate whose acceleration is computed, by number or name.")
    ] = None,
    output: Annotated[Path | None, options.output_option("Save all quantities of all points as .csv.", ".csv")] = None,
    plot: options.Figure = None,
) -> None:
    """Compute forces, dynamic factor, transmission error, reactions and acceleration along a saved curve, with units.

    Exit codes: 0 done, 2 bad input.
    """
    branch, _ = loaded(file, "pp2", element)
    axis = int(dof) if dof is not None and dof.isdecimal() else dof
    problem = problem_in(branch, model) if model else problem_along(branch)
    curves = [dataclasses.replace(curve, problem=problem, others=()) for curve in branch.curves]
    by_curve = [hb.analysis.machine_quantities(curve, element, axis) for curve in curves]
    quantities, title = _joined_quantities(by_curve), by_curve[0].title(quantity)
    with outputs() as out:
        out.write(output, quantities.save)
        together = dataclasses.replace(curves[0], others=tuple(curves[1:]))
        out.figure(plot, lambda drawing: drawing.response(together, quantity, element, dof=axis))
        print_table(
            ["quantity", "largest of stable motions", f"at {position_headers(branch)[0]}"],
            list(_largest(curves, quantities, element, axis)),
        )
        rows = []
        for number, landed in enumerate(landings(curves), 1):
            for jump in (landing.jump for landing in landed):
                ends = (
                    float(hb.analysis.machine_quantities(end, element, axis, problem)[quantity][0]) if end else np.nan
                    for end in (jump.before, jump.after)
                )
                direction = "increasing" if jump.direction > 0 else "decreasing"
                rows.append(
                    [
                        label_on_curve(number, jump),
                        position_texts(branch, jump.before)[0],
                        direction,
                        *(rounded(end, 4) if np.isfinite(end) else "-" for end in ends),
                        jump.landing_description,
                    ]
                )
        if rows:
            headers = ["", position_headers(branch)[0], "sweep", f"{title} before", "after", "landing"]
            print_table(headers, rows, "jumps of a slow sweep")
    raise typer.Exit(0)


def _joined_quantities(by_curve: Sequence[MachineQuantities]) -> MachineQuantities:
    """Return the quantities of several curves together, with the number of the curve first."""
    if len(by_curve) == 1:
        return by_curve[0]
    counts = [len(next(iter(quantities.columns.values()))) for quantities in by_curve]
    columns = {"curve": np.repeat(np.arange(1, len(by_curve) + 1), counts)}
    return MachineQuantities(
        columns
        | {name: np.concatenate([quantities.columns[name] for quantities in by_curve]) for name in by_curve[0].columns}
    )


def _largest(
    curves: Sequence[hb.Branch], quantities: MachineQuantities, element: int | str, dof: int | str | None
) -> Iterator[list[str]]:
    """Yield each quantity with its largest value on all curves, between points too, and where it occurs."""
    first, columns = curves[0], quantities.columns
    stable = np.concatenate([stable_or_limit(curve) for curve in curves])
    if not stable.any():
        stable = np.ones_like(stable)
    starts = np.cumsum([0, *map(len, curves)])
    asymptotes = [
        value for curve in curves for i, value in curve.unbounded_ends if curve.stable is None or curve.stable[i]
    ]
    for name, values in columns.items():
        if name.partition(" [")[0] in ("curve", "stable", "Omega", "mesh", "pinion", first.parameter):
            continue
        if not np.isfinite(values[stable]).any():
            zero = {"dynamic factor [-]": "static", "largest / mean force [-]": "mean"}.get(name)
            yield [name, f"undefined: {zero} force is zero" if zero else "-", "-"]
        elif asymptotes and not (", static" in name or ", mean" in name or name.startswith("efficiency")):
            yield [name, "unbounded", OmegaAxis.of(first.require_problem().model).number(min(asymptotes))]
        else:
            sizes = np.abs(values) if name.startswith("force") else values  # negative if the wheel drives
            k = int(np.nanargmax(np.where(stable, sizes, -np.inf)))
            number = int(np.searchsorted(starts, k, side="right")) - 1
            sign = np.sign(values[k]) if sizes is not values else 1.0

            def size_of(point: hb.Point, name: str = name, sign: float = sign) -> float:
                return sign * float(hb.analysis.machine_quantities(point, element, dof).columns[name][0])

            curve, start = curves[number], int(starts[number])
            point, largest = refined_peak(curve, sizes[start : starts[number + 1]], k - start, size_of)
            yield [name, rounded(sign * largest, 4), position_texts(curve, point)[0]]


PARTIAL = "jumps, safe speeds and the effect of assumptions need the whole curve and are left out"
"""Note of reports whose curve was interrupted."""


def interrupted(curve: hb.Branch) -> bool:
    """Return whether a curve or one of its further curves was interrupted."""
    return any(one.status is hb.Status.INTERRUPTED for one in curve.curves)


# ---- output of hbgear gear


def _trace_and_report(
    machine: Machine, count: int, by_default: bool, output: Path | None, plot: Path | None, dimensionless: bool
) -> hb.Branch:
    """Trace the curve of a machine, write its files and print its tables."""
    from hbgear.gears.mesh.tooth_mesh import mirror_phase
    from hbgear.io.machines.machine_file import write_machine

    cycle = machine.mesh
    model = machine.model()
    curve = traced(hb.HarmonicBalance(model, count), "Omega", model.default_span)

    works: list[Callable[[Event], Any]] = []
    if model.mesh_order == 1 and not interrupted(curve):  # otherwise each curve takes minutes
        works = [partial(subharmonics, model, curve, count)]
        row = partial(alternative_row, model, curve, count, None)
        works += [partial(row, assumption) for assumption in alternatives(model, by_default)]
    with without_relief_warning(), begun(lambda work, stop: work(stop), works) as results, outputs() as out:
        out.write(output, lambda path: write_machine(machine, path, ("A gear pair; see hbgear trace, hbgear speed.",)))
        loaded = cycle if machine.torque >= 0 else cycle.mirrored(mirror_phase(machine.pair))
        out.figure(plot, methodcaller("drive", loaded, curve))
        print_table(["gears", "pinion", "wheel"], list(gear_tables.gears(machine.pair)))
        print_table(["mesh", ""], list(gear_tables.mesh(machine, cycle, model)))
        if interrupted(curve):
            print_text(f"the curve was interrupted: {PARTIAL}")
            return curve
        computed = [future.result() for future in results[1:]]
        damping = [row for row in computed if row[0].startswith("damping")]
        first = [f"damping {machine.damping:g}, as computed", *factor_and_jumps(model, curve)]
        print_table(["damping ratio", "largest dynamic factor", JUMPS], [first, *damping], DAMPING_RANGE)
        doubled = results[0].result() if results else []
        other_ranges = [span for motions in doubled for span in motions.ranges]
        show_speeds(model, curve, dimensionless, other_ranges)
        if getattr(model.equations, "contacts", None) is not None and machine.torque:
            print_table(["pairs of teeth", ""], list(gear_tables.teeth(machine, model, curve)))
        if machine.friction:
            print_table(["friction between the teeth", ""], list(gear_tables.losses(machine, curve)))
        show_subharmonics(doubled)
        first[0] = "as computed"
        print_assumptions([first, *(row for row in computed if row not in damping)])
        reliefs = [row for row in computed if row[0].startswith(NO_RELIEF)]
        helpful = [(f"tip relief of {row[0].partition(': ')[2]} on both gears", _number_in(row[1])) for row in reliefs]
        print_text(recommendation(model, curve, helpful, _number_in(first[1]), other_ranges))
        if not works:
            print_text(
                "With torque orders, run-out or pitch errors of single teeth, other assumptions and motions of "
                "twice the period are not computed: every curve takes minutes."
            )
    return curve


def _machine(teeth: tuple[int, int], options: SimpleNamespace) -> Machine:
    """Return the machine of the options of ``hbgear gear``; a ring has a negative number of teeth."""
    from hbgear.common.units import to_si
    from hbgear.gears.mesh.mesh_models import MESHES
    from hbgear.gears.mesh.tooth_friction import COEFFICIENT
    from hbgear.gears.pairs.pair_models import DAMPING
    from hbgear.gears.torque_orders import parse_torque_orders
    from hbgear.io.machines.machine_file import Machine

    shifts = _two_values("--shift", options.shift, float, "0.2,0")
    beta, ring = to_si("--helix", "angle", options.helix, "rad"), teeth[1] < 0
    runout = options.runout if "," in options.runout else f"{options.runout}, 0 um"
    errors = _two_values("--runout", runout, str, "20um,0um")
    angles, kinds = (beta, beta if ring else -beta), ((False, False), (ring, options.rack))
    size, relief = (options.module, options.width, options.pressure), options.relief
    pinion, wheel = (
        hb.gears.Gear(abs(number), *size, angle, x, *kind, tip_relief=relief, runout=error)
        for number, angle, x, kind, error in zip(teeth, angles, shifts, kinds, errors, strict=True)
    )
    pair = hb.GearPair(pinion, wheel, options.backlash, options.measure)
    zeta = DAMPING.read("--damping", _plain(options.damping or str(DEFAULT_DAMPING)))
    if options.mesh is not None and options.mesh not in MESHES:
        raise ValueError(f"--mesh {options.mesh}: must be one of {', '.join(MESHES)}")
    orders = parse_torque_orders("--torque-orders", options.torque_orders) if options.torque_orders else ()
    torque = to_si("--torque", "torque", options.torque, "N m")
    friction = COEFFICIENT.read("--friction", _plain(options.friction or "0"))
    return Machine(pair, torque, zeta, mesh_model=options.mesh, torque_orders=orders, friction=friction)


def _plain(text: str) -> Any:
    """Return the number that a text represents, else the text."""
    try:
        return float(text)
    except ValueError:
        return text


def _number_in(text: str) -> float:
    """Return a dynamic factor of a table; infinite if it is unbounded."""
    return float(text) if is_number(text) else math.inf


@contextmanager
def without_contact_warning() -> Iterator[None]:
    """Suppress the warning of a response without loss of contact, which the report states in terms of the machine."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "no element comes near", hb.mechanics.ImplausibleInputWarning)
        yield


# ---- input


def _default_figure(teeth: tuple[int, int]) -> Path | None:
    """Return the path of the figure without --plot; None if it cannot be written, which is reported."""
    path = Path(f"gear-{teeth[0]}-{abs(teeth[1])}.png")
    try:
        check_writable(path, FIGURES)
    except OSError as error:
        print_message("warning", f"{error}; no figure is drawn, --plot PATH draws it elsewhere")
        return None
    return path


def _two_values(option: str, text: str, kind: type, example: str) -> tuple[Any, Any]:
    """Return two numbers separated by a comma."""
    words = [word.strip() for word in text.split(",")]
    try:
        first, second = (kind(word) for word in words)
    except ValueError:
        numbers = {int: "whole numbers", float: "numbers"}.get(kind, "values")
        raise ValueError(f"{option} {text}: need two {numbers}, such as {option} {example}") from None
    return first, second
