"""Commands for machines given by drawing data: ``hbgear gear``, ``hbgear speed``, ``hbgear results``."""

from __future__ import annotations

import dataclasses
import math
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import degrees, pi
from operator import methodcaller
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any, cast

import numpy as np
import typer

import hbgear as hb
from hbgear.analysis.jump_landings import landings
from hbgear.analysis.quantities.axis_quantities import OmegaAxis
from hbgear.analysis.quantities.engineering_quantities import MachineQuantities, problem_along
from hbgear.analysis.summary import message_of, position_headers, position_texts
from hbgear.cli.commands.assumptions import (
    FACTOR_CANDIDATES,
    JUMPS,
    LONG_STEPS,
    MEASURES,
    alternative_results,
    alternatives,
    factor_and_jumps,
    largest_motions,
    print_assumptions,
    show_assumptions,
    until,
)
from hbgear.cli.commands.files import BRANCHES, FIGURES, check_writable, outputs
from hbgear.cli.commands.machine_report import merged, recommendation, show_speeds
from hbgear.cli.options import (
    Changes,
    Dimensionless,
    Element,
    Figure,
    File,
    Harmonics,
    OwnModel,
    ShownMeasure,
)
from hbgear.cli.output import exit_code, print_table, print_text
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

PARAMETRIC_SPAN = 2.4
"""Omega up to which period doublings are searched: those of the parametric resonance lie near 2."""

SAME_SPEED = 1e-4
"""Difference of Omega [-] below which a curve of twice the period ends at a period doubling."""

DEFAULT_DAMPING = 0.04
"""Default damping ratio of a mesh; measured values lie between 0.02 and 0.1."""

DAMPING_RANGE = "effect of the damping ratio of the mesh, whose measured values lie between 0.02 and 0.1"
"""Title of the table of damping ratios, which is printed before all results that depend on them."""


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(gear)
    app.command()(speed)
    app.command()(results)


def gear(
    z: Annotated[str, typer.Option("--z", metavar="Z1,Z2", help="Teeth of pinion and wheel; -Z2 for a ring.")],
    module: Annotated[str, typer.Option(help="Normal module, such as 3mm.")],
    width: Annotated[str, typer.Option(help="Face width, such as 20mm.")],
    torque: Annotated[
        str, typer.Option(help="Mean torque on the pinion, such as 200Nm; negative if the wheel drives.")
    ],
    backlash: Annotated[str, typer.Option(help="Circumferential backlash on the working pitch circle, such as 80um.")],
    damping: Annotated[
        str | None, typer.Option(help="Damping ratio of the mesh.", show_default=str(DEFAULT_DAMPING))
    ] = None,
    helix: Annotated[str, typer.Option(help="Helix angle of the pinion, positive right-handed.")] = "0 deg",
    pressure: Annotated[str, typer.Option(help="Normal pressure angle.")] = "20 deg",
    shift: Annotated[str, typer.Option(metavar="X1,X2", help="Profile shifts over the module.")] = "0,0",
    relief: Annotated[str, typer.Option(help="Tip relief of both gears, such as 15um.")] = "0 um",
    measure: Annotated[
        str, typer.Option("--backlash-as", help="Definition of the backlash: circumferential, normal or action.")
    ] = "circumferential",
    mesh: Annotated[
        str | None,
        typer.Option(
            help="Model of the mesh: teeth (pairs of teeth with their own gaps), or one stiffness, secant or tangent.",
            show_default="teeth",
        ),
    ] = None,
    torque_orders: Annotated[
        str | None,
        typer.Option(
            help='Harmonics of the torque by order of the pinion, such as "2: 60Nm, 1/2: 5Nm 30deg". Give few '
            "harmonics then, such as --harmonics 4: the period has many meshes, and a curve takes minutes."
        ),
    ] = None,
    runout: Annotated[
        str,
        typer.Option(
            metavar="F1,F2",
            help="Radial run-out of pinion and wheel, or of the pinion only, such as 20um. The period "
            "has many meshes then, as for --torque-orders.",
        ),
    ] = "0 um",
    friction: Annotated[
        str | None, typer.Option(help="Coefficient of friction between the teeth, such as 0.05.", show_default="0")
    ] = None,
    rack: Annotated[bool, typer.Option("--rack", help="The wheel is a rack of Z2 teeth.")] = False,
    harmonics: Harmonics = "24",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write the machine as .toml.")] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw to a .png, .pdf or .svg.", show_default="gear-Z1-Z2.png")
    ] = None,
    dimensionless: Dimensionless = False,
) -> None:
    """Compute geometry, mesh stiffness, natural frequency and jump speeds of a gear pair from its drawing.

    A table shows how the jumps change with the assumed values. -o writes a file for hbgear trace and hbgear speed,
    which can also hold other inertias, centre distance, crowning and bearings.
    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early.
    """
    teeth = _two_values("--z", z, int, "25,40")
    plot = plot or Path(f"gear-{teeth[0]}-{abs(teeth[1])}.png")
    check_writable(output, (".toml",))
    check_writable(plot, FIGURES)
    machine = _machine(
        teeth, module, width, torque, backlash, damping or str(DEFAULT_DAMPING), helix, pressure,
        _two_values("--shift", shift, float, "0.2,0"), relief, measure, mesh,
        torque_orders, friction, runout, rack,
    )  # fmt: skip
    with without_contact_warning():
        curve = _trace_and_report(machine, harmonics_of(harmonics), damping is None, output, plot, dimensionless)
    raise typer.Exit(exit_code(curve))


def speed(
    file: Annotated[str, typer.Argument(metavar="FILE.toml", help="The machine, as written by hbgear gear -o.")],
    changes: Changes = None,
    first: Annotated[
        str | None, typer.Option("--from", help="Speed of the pinion at the start, such as 15000r/min.")
    ] = None,
    last: Annotated[str | None, typer.Option("--to", help="Speed of the pinion at the end.")] = None,
    harmonics: Harmonics = "24",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Save the curve as .npz, .csv or .mat.")] = None,
    plot: Figure = None,
    measure: ShownMeasure = None,
    dimensionless: Dimensionless = False,
) -> None:
    """Compute resonances, jumps, safe and critical speeds of a machine.

    Resonances and jumps have their dynamic factors, transmission errors and forces. For a gear pair, a table shows how
    they change with assumed values: damping, pitch error, tip relief, inertia and the model of the mesh.

    Exit codes: 0 the end was reached, 2 bad input, 3 stopped early (all traced points are saved).
    """
    check_writable(output, BRANCHES)
    check_writable(plot, FIGURES)
    model = chosen_model(file, changes)
    if model.scales is None:
        raise ValueError(
            f"'{file}' has no scales, so its speeds in r/min are unknown: give the file of a machine (hbgear gear -o)"
        )
    for option, text in (("--from", first), ("--to", last)):
        if text is not None and is_number(text):
            raise ValueError(f"{option} {text}: need a speed with its unit, such as {option} 9000r/min")
    span = span_of(model, first, last)
    from hbgear.gears import DrawnPair

    problem = hb.HarmonicBalance(model, harmonics_of(harmonics))
    check_shown(problem, measure, 0)
    with without_contact_warning():
        curve = traced(problem, "Omega", span)
    with without_contact_warning(), outputs() as out:
        out.branch(output, curve)
        out.figure(plot, lambda drawing: drawing.response(curve, measure, dimensionless=dimensionless))
        print_text(f"{model.title or file}: {len(curve)} points; {message_of(curve, dimensionless)}")
        show_speeds(model, curve, dimensionless)
        if isinstance(model, DrawnPair) and model.mesh_order == 1:
            show_assumptions(model, curve, harmonics_of(harmonics), span)
        print_text(recommendation(model, curve))
    raise typer.Exit(exit_code(curve))


def results(
    file: File,
    quantity: Annotated[
        str,
        typer.Argument(metavar="[QUANTITY]", help="Quantity to print at jumps and to draw, such as 'force, largest'."),
    ] = "dynamic factor",
    model: OwnModel = None,
    element: Element = "0",
    dof: Annotated[
        str | None, typer.Option(help="Coordinate whose acceleration is computed, by number or name.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Save all quantities of all points as .csv.")
    ] = None,
    plot: Figure = None,
) -> None:
    """Compute forces, dynamic factor, transmission error, reactions and acceleration along a saved curve, with units.

    Exit codes: 0 done, 2 bad input.
    """
    check_writable(output, (".csv",))
    check_writable(plot, FIGURES)
    branch, element_id, _ = loaded(file, "pp2", element)
    axis = int(dof) if dof is not None and dof.isdecimal() else dof
    problem = problem_in(branch, model) if model else problem_along(branch)
    curves = [dataclasses.replace(curve, problem=problem, others=()) for curve in branch.curves]
    by_curve = [hb.analysis.machine_quantities(curve, element_id, axis) for curve in curves]
    quantities, title = _joined_quantities(by_curve), by_curve[0].title(quantity)
    with outputs() as out:
        out.write(output, quantities.save)
        together = dataclasses.replace(curves[0], others=tuple(curves[1:]))
        out.figure(plot, lambda drawing: drawing.response(together, quantity, element_id, dof=axis))
        print_table(["quantity", "largest of stable motions", f"at {position_headers(branch)[0]}"],
                    list(_largest(curves, quantities)))  # fmt: skip
        rows = []
        for number, landed in enumerate(landings(curves), 1):
            for jump in (landing.jump for landing in landed):
                ends = (
                    float(hb.analysis.machine_quantities(end, element_id, axis, problem)[quantity][0])
                    if end
                    else np.nan
                    for end in (jump.before, jump.after)
                )
                direction = "increasing" if jump.direction > 0 else "decreasing"
                rows.append([label_on_curve(number, jump), position_texts(branch, jump.before)[0], direction,
                             *(rounded(end, 4) if np.isfinite(end) else "-" for end in ends)])  # fmt: skip
        if rows:
            headers = ["", position_headers(branch)[0], "sweep", f"{title} before", "after"]
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


def _largest(curves: Sequence[hb.Branch], quantities: MachineQuantities) -> Iterator[list[str]]:
    """Yield each quantity with its largest value on all curves and the frequency at which it occurs."""
    first, columns = curves[0], quantities.columns
    stable = columns.get("stable", np.ones(sum(map(len, curves)))).astype(bool)
    if not stable.any():
        stable = np.ones_like(stable)
    rows = [(curve, i) for curve in curves for i in range(len(curve))]
    asymptotes = [
        value for curve in curves for i, value in curve.unbounded_ends if curve.stable is None or curve.stable[i]
    ]  # fmt: skip
    for name, values in columns.items():
        if name in ("curve", "stable", "Omega [-]", "mesh [Hz]", "pinion [r/min]", f"{first.parameter} [-]"):
            continue
        if not np.isfinite(values[stable]).any():
            yield [name, "undefined: static force is zero" if name.startswith("dynamic factor") else "-", "-"]
        elif asymptotes and ", static" not in name:
            yield [name, "unbounded", OmegaAxis.of(first.require_problem().model).number(min(asymptotes))]
        else:
            k = int(np.nanargmax(np.where(stable, values, -np.inf)))
            curve, i = rows[k]
            yield [name, rounded(float(values[k]), 4), position_texts(curve, curve[i])[0]]


# ---- output of hbgear gear


def _trace_and_report(
    machine: Machine, count: int | str, by_default: bool, output: Path | None, plot: Path, dimensionless: bool,
) -> hb.Branch:  # fmt: skip
    """Trace the curve of a machine, write its files and print its tables."""
    from hbgear.io.machines.machine_file import write_machine

    cycle = machine.mesh
    model = machine.model()
    curve = traced(hb.HarmonicBalance(model, count), "Omega", model.default_span)

    def alternative(assumption: tuple[str, Callable[[], DrawnPair]], stop: Event) -> list[list[str]]:
        name, changed = assumption
        return [[name, *alternative_results(changed().equations, model.equations, curve, count, stop)]]

    def subharmonics(stop: Event) -> list[list[str]]:
        span = (float(curve.values.min()), PARAMETRIC_SPAN)
        curves = (_parametric_curve(model, count), curve, *curve.others)
        return [row for branch in curves for row in _subharmonics(model, branch, span, stop)]

    works: list[Callable[[Event], list[list[str]]]] = [subharmonics]
    works += [partial(alternative, assumption) for assumption in alternatives(model, by_default)]
    long = model.mesh_order > 1
    if long:  # each curve takes minutes
        works = [_nothing]
    with begun(_do, works) as (doubled, *rows), outputs() as out:
        out.write(output, lambda path: write_machine(machine, path, ("A gear pair; see hbgear trace, hbgear speed.",)))
        out.figure(plot, methodcaller("drive", cycle, curve))
        print_table(["gears", "pinion", "wheel"], list(_gears(machine.pair)))
        print_table(["mesh", ""], list(_mesh(machine, cycle, model)))
        computed = [row for future in rows for row in future.result()]
        damping = [row for row in computed if row[0].startswith("damping")]
        first = [f"damping {machine.damping:g}, as computed", *factor_and_jumps(model, curve)]
        print_table(["damping ratio", "largest dynamic factor", JUMPS], [first, *damping], DAMPING_RANGE)
        subharmonic_rows = doubled.result()
        other_ranges = [
            (float(a), float(b)) for row in subharmonic_rows for a, b in re.findall(r"(\d+) to (\d+)", row[1])
        ]
        show_speeds(model, curve, dimensionless, other_ranges)
        if getattr(model.equations, "contacts", None) is not None and machine.torque:
            print_table(["pairs of teeth", ""], list(_teeth(machine, model, curve)))
        if machine.friction:
            print_table(["friction between the teeth", ""], list(_losses(machine, curve)))
        if subharmonic_rows:
            headers = ["begins at", "stable at pinion r/min", "largest dynamic factor"]
            print_table(
                headers, subharmonic_rows, "other motions of twice the mesh period, which may be reached instead"
            )
        first[0] = "as computed"
        print_assumptions([first, *(row for row in computed if row not in damping)])
        helpful = [(MEASURES[row[0]], _number_in(row[1])) for row in computed if row[0] in MEASURES]
        print_text(recommendation(model, curve, helpful, _number_in(first[1]), other_ranges))
        if long:
            print_text("With torque orders, run-out or pitch errors of single teeth, other assumptions and motions of "
                       "twice the period are not computed: every curve takes minutes.")  # fmt: skip
    return curve


def _machine(
    teeth: tuple[int, int], module: str, width: str, torque: str, backlash: str, damping: str, helix: str,
    pressure: str, shift: tuple[float, float], relief: str, measure: str, mesh: str | None,
    torque_orders: str | None, friction: str | None, runout: str, rack: bool,
) -> Machine:  # fmt: skip
    from hbgear.common.units import to_si
    from hbgear.gears.mesh.mesh_models import MESHES
    from hbgear.gears.mesh.tooth_friction import COEFFICIENT
    from hbgear.gears.pairs.pair_models import DAMPING
    from hbgear.gears.torque_orders import parse_torque_orders
    from hbgear.io.machines.machine_file import Machine

    beta = to_si("--helix", "angle", helix, "rad")
    ring = teeth[1] < 0
    errors = _two_values("--runout", runout if "," in runout else f"{runout}, 0 um", str, "20um,0um")
    pinion, wheel = (
        hb.gears.Gear(abs(number), module, width, pressure, angle, x, *kind, tip_relief=relief, runout=error)
        for number, angle, x, kind, error in zip(
            teeth, (beta, beta if ring else -beta), shift, ((False, False), (ring, rack)), errors, strict=True
        )
    )
    pair = hb.GearPair(pinion, wheel, backlash, measure)
    zeta = DAMPING.read("--damping", _plain(damping))
    if mesh is not None and mesh not in MESHES:
        raise ValueError(f"--mesh {mesh}: must be one of {', '.join(MESHES)}")
    orders = parse_torque_orders("--torque-orders", torque_orders) if torque_orders else ()
    return Machine(
        pair, to_si("--torque", "torque", torque, "N m"), zeta, mesh_model=cast(Any, mesh), torque_orders=orders,
        friction=COEFFICIENT.read("--friction", _plain(friction or "0")),
    )  # fmt: skip


def _plain(text: str) -> Any:
    """Return the number that a text represents, else the text."""
    try:
        return float(text)
    except ValueError:
        return text


def _orders_text(machine: Machine) -> str:
    """Return the amplitudes of the torque orders of the pinion."""
    return "".join(f", order {order:g} of the torque {size:g} N m" for order, size, _ in machine.torque_orders)


def _gears(pair: hb.GearPair) -> Iterator[list[str]]:
    gears = (pair.pinion, pair.wheel)
    kinds = (" (ring)" if g.internal else " (rack)" if g.rack else "" for g in gears)
    yield ["teeth", *(f"{g.teeth}{kind}" for g, kind in zip(gears, kinds, strict=True))]
    yield ["normal module [mm], face width [mm]", *(f"{g.module * 1e3:g}, {g.face_width * 1e3:g}" for g in gears)]
    if pair.pinion.helix_angle:
        yield ["helix [deg]", *(f"{degrees(abs(g.helix_angle)):g} {g.hand}" for g in gears)]
    yield ["profile shift [module]", *(f"{g.profile_shift:g}" for g in gears)]
    for name in ("reference", "base", "tip_diameter_used", "root"):
        values = (getattr(g, name if "used" in name else f"{name}_diameter") for g in gears)
        yield [f"{name.partition('_')[0]} diameter [mm]", *(
            "-" if g.rack else f"{value * 1e3:.4f}" for g, value in zip(gears, values, strict=True)
        )]  # fmt: skip
    if pair.wheel.rack:
        w = pair.wheel
        heights = ((d - w.reference_diameter) / 2 * 1e3 for d in (w.tip_diameter_used, w.root_diameter))
        yield ["tip, root over the reference line [mm]", "-", "{:.4f}, {:.4f}".format(*heights)]
    yield ["mass [kg] (solid)", *(f"{g.mass_used:.4g}" for g in gears)]
    yield ["inertia [kg m^2] (solid)", *("-" if g.rack else f"{g.inertia_used:.4g}" for g in gears)]


def _mesh(machine: Machine, cycle: hb.gears.MeshCycle, model: DrawnPair) -> Iterator[list[str]]:
    from hbgear.gears.mesh.iso_stiffness import iso_stiffness
    from hbgear.gears.mesh.tooth_mesh import tooth_mesh

    pair, scales = machine.pair, model.scales
    assert scales is not None
    iso = iso_stiffness(pair)
    heading = "distance of the rack from the axis" if pair.wheel.rack else "centre distance"
    yield [heading, f"{pair.mounting_distance * 1e3:.4f} mm, "
           f"working pressure angle {degrees(pair.working_pressure_angle):.4f} deg"]  # fmt: skip
    overlap = f", overlap {pair.overlap_ratio:.4f}" if pair.overlap_ratio else ""
    yield ["contact ratio", f"{pair.contact_ratio:.5f} transverse{overlap}"]
    sizes = ", ".join(f"{pair.backlash_as(measure) * 1e6:.1f} {measure}" for measure in ("circumferential", "normal"))
    yield ["backlash [um]", f"{sizes}; half gap along the line of action {pair.half_backlash * 1e6:.1f}"]
    yield ["force along the line of action", f"{pair.transverse_force(machine.torque):.1f} N" + _orders_text(machine)]
    k = cycle.stiffness
    yield ["mesh stiffness", f"{k.mean:.4g} N/m mean ({k.mean / pair.face_width / 1e9:.2f} N/(mm um)), "
           f"{k.value.min():.4g} to {k.value.max():.4g}"]  # fmt: skip
    k_0 = tooth_mesh(pair, machine.mesh_torque).stiffness
    yield ["stiffness, all gaps closed", f"{k_0:.4g} N/m mean, to which the damping ratio refers"]
    yield ["by ISO 6336-1, method B", f"{iso.mesh * pair.face_width:.4g} N/m "
           f"(c' {iso.single / 1e9:.2f}, c_gamma {iso.mesh / 1e9:.2f} N/(mm um))"]  # fmt: skip
    yield ["static transmission error", f"{cycle.peak_to_peak * 1e6:.2f} um peak to peak"]
    yield ["natural frequency", f"{scales.frequency / (2 * pi):.1f} Hz of the mesh, "
           f"{float(scales.pinion_speed(1 / model.mesh_order)):.0f} r/min of the pinion"]  # fmt: skip


def _teeth(machine: Machine, model: hb.mechanics.Model, curve: hb.Branch) -> Iterator[list[str]]:
    """Yield the largest loads of a pair of teeth on stable motions."""
    mesh, scales = hb.gears.tooth_mesh(machine.pair, machine.mesh_torque), model.scales
    assert scales is not None
    candidates = [(hb.analysis.tooth_loads(point, mesh), point) for point in largest_motions(curve)]
    loads, point = max(candidates, key=lambda entry: entry[0].force_factor)
    number, position = loads.largest
    speed = float(scales.pinion_speed(point.parameters["Omega"]))
    yield ["largest force of a pair", f"{loads.force.max():.0f} N, {loads.force_factor:.2f} times the static force of "
           f"{loads.static.force.max():.0f} N, at {speed:.0f} r/min"]  # fmt: skip
    limits = {float(scales.pinion_speed(x)) for branch in curve.curves for x in branch.asymptotes.values()}
    if limits:
        speeds = " and ".join(f"{limit:.0f}" for limit in sorted(limits))
        yield ["not included", f"motions that grow without bound near {speeds} r/min"]
    pairs = len(loads.force)
    pair_text = "every pair" if pairs == 1 else f"pair {number + 1} of {pairs} that follow each other"
    yield ["it acts on", f"{pair_text}, {position:.2f} mesh periods after the pair enters contact"]
    for name, stress, factor in zip(("pinion", "wheel"), loads.root_stress, loads.root_factor, strict=True):
        if np.isfinite(factor):
            yield [f"largest root stress, {name}", f"{stress.max() / 1e6:.1f} N/mm^2 (ISO 6336-3, nominal), "
                   f"{factor:.2f} times the static one"]  # fmt: skip
    other_flank = "back" if loads.side > 0 else "driving"
    back = "none" if not loads.back.any() else f"{loads.back.max():.0f} N at most"
    yield [
        "separated",
        f"{loads.separated.max():.0%} of the path of contact; contact on the {other_flank} flank: {back}",
    ]


def _losses(machine: Machine, curve: hb.Branch) -> Iterator[list[str]]:
    """Yield the static efficiency and the efficiency and power loss of stable motions."""
    from hbgear.gears.mesh.tooth_friction import friction_mesh
    from hbgear.gears.mesh.tooth_mesh import tooth_mesh

    side = 1 if machine.torque >= 0 else -1
    static = friction_mesh(tooth_mesh(machine.pair, machine.mesh_torque), machine.friction, side).output
    yield ["static efficiency", f"{static if side > 0 else 1 / static:.4%}"]
    q = hb.analysis.machine_quantities(curve)
    stable = np.asarray(q.columns.get("stable", np.ones(len(curve)))).astype(bool)
    if not stable.any():
        return
    rpm, loss = q["pinion"], q["power loss"]
    for name, i in (("lowest", int(np.argmin(rpm))), ("highest", int(np.argmax(np.where(stable, rpm, -1.0))))):
        if stable[i]:
            yield [
                f"{name} speed, {rpm[i]:.0f} r/min",
                f"efficiency {q['efficiency'][i]:.4%}, loss {loss[i]:.1f} W",
            ]
    i = int(np.argmin(np.where(stable, q["efficiency"], np.inf)))
    yield [f"lowest efficiency, {rpm[i]:.0f} r/min", f"{q['efficiency'][i]:.4%}, loss {loss[i]:.1f} W; friction "
           f"across the line of action {q['friction across, largest'][i]:.0f} N"]  # fmt: skip


def _nothing(_: Event) -> list[list[str]]:
    """Return no rows."""
    return []


def _number_in(text: str) -> float:
    """Return a dynamic factor of a table; infinite if it is unbounded."""
    return float(text) if is_number(text) else math.inf


@contextmanager
def without_contact_warning() -> Iterator[None]:
    """Suppress the warning of a response without loss of contact, which the report states in terms of the machine."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "no element comes near", hb.mechanics.ImplausibleInputWarning)
        yield


def _do(work: Callable[[Event], list[list[str]]], stop: Event) -> list[list[str]]:
    return work(stop)


def _parametric_curve(model: hb.mechanics.Model, count: int | str) -> hb.Branch:
    """Return the curve above the usual span, in which the period doublings of the parametric resonance lie."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hb.mechanics.ImplausibleInputWarning)  # no loss of contact there is usual
        span = (PARAMETRIC_SPAN, model.default_span[0])
        return hb.trace(hb.HarmonicBalance(model, count), "Omega", span, steps=LONG_STEPS, accuracy=None)


def _subharmonics(
    model: hb.mechanics.Model, curve: hb.Branch, span: tuple[float, float], stop: Event
) -> Iterator[list[str]]:
    """Yield the first speed, stable speeds and largest dynamic factor of each curve of twice the period.

    A curve that ends at another period doubling is traced once.
    """
    scales, ends = model.scales, list[float]()
    assert scales is not None
    for point in curve.special:
        if point.kind != "PD" or any(abs(end - point.parameters["Omega"]) < SAME_SPEED for end in ends):
            continue
        doubled = hb.switch(curve, point.label, span, steps=LONG_STEPS, special=False, accuracy=None,
                            progress=until(stop))  # fmt: skip
        ends.append(float(doubled.values[-1]))
        stable = np.zeros(len(doubled), dtype=bool) if doubled.stable is None else doubled.stable.astype(bool)
        rpm = scales.pinion_speed(doubled.values)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], stable, [False]]).astype(int)))
        spans = merged((min(rpm[a], rpm[b - 1]), max(rpm[a], rpm[b - 1]))
                       for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1)  # fmt: skip
        if not spans:
            continue
        largest = np.argsort(doubled.amplitude("max") * stable)[-FACTOR_CANDIDATES:]
        factor = max(hb.analysis.dynamic_factor(model, doubled[int(i)]) for i in largest if stable[i])
        speeds = ", ".join(f"{low:.0f} to {high:.0f}" for low, high in spans)
        begin = float(scales.pinion_speed(point.parameters["Omega"]))
        yield [f"{begin:.0f} r/min", speeds, rounded(factor, 3)]


# ---- input


def _two_values(option: str, text: str, kind: type, example: str) -> tuple[Any, Any]:
    """Return two numbers separated by a comma."""
    words = [word.strip() for word in text.split(",")]
    try:
        first, second = (kind(word) for word in words)
    except ValueError:
        raise ValueError(f"{option} {text}: need two numbers, such as {option} {example}") from None
    return first, second
