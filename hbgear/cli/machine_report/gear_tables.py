"""Tables of a gear pair: gears, mesh, loads of the teeth, and friction losses."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, pi
from typing import TYPE_CHECKING

import numpy as np

import hbgear as hb
from hbgear.analysis.loads.tooth_loads import load_estimates
from hbgear.cli.machine_report.assumptions import bounded_inside
from hbgear.cli.machine_report.peaks import stable_or_limit
from hbgear.cli.machine_report.speed_ranges import scales_of
from hbgear.common.text.digits import rounded

if TYPE_CHECKING:
    from hbgear.gears import DrawnPair
    from hbgear.io.machines.machine_file import Machine


def gears(pair: hb.GearPair) -> Iterator[list[str]]:
    """Yield the dimensions of both gears."""
    both = (pair.pinion, pair.wheel)
    kinds = (" (ring)" if g.internal else " (rack)" if g.rack else "" for g in both)
    yield ["teeth", *(f"{g.teeth}{kind}" for g, kind in zip(both, kinds, strict=True))]
    yield ["normal module [mm], face width [mm]", *(f"{g.module * 1e3:g}, {g.face_width * 1e3:g}" for g in both)]
    if pair.pinion.helix_angle:
        yield ["helix [deg]", *(f"{degrees(abs(g.helix_angle)):g} {g.hand}" for g in both)]
    yield ["profile shift [module]", *(f"{g.profile_shift:g}" for g in both)]
    for name in ("reference", "base", "tip_diameter_used", "root"):
        values = (getattr(g, name if "used" in name else f"{name}_diameter") for g in both)
        yield [
            f"{name.partition('_')[0]} diameter [mm]",
            *("-" if g.rack else f"{value * 1e3:.4f}" for g, value in zip(both, values, strict=True)),
        ]
    if pair.wheel.rack:
        w = pair.wheel
        heights = ((d - w.reference_diameter) / 2 * 1e3 for d in (w.tip_diameter_used, w.root_diameter))
        yield ["tip, root over the reference line [mm]", "-", "{:.4f}, {:.4f}".format(*heights)]
    yield ["mass [kg] (solid)", *(f"{g.mass_used:.4g}" for g in both)]
    yield ["inertia [kg m^2] (solid)", *("-" if g.rack else f"{g.inertia_used:.4g}" for g in both)]


def mesh(machine: Machine, cycle: hb.gears.MeshCycle, model: DrawnPair) -> Iterator[list[str]]:
    """Yield the geometry, stiffness and natural frequency of the mesh."""
    from hbgear.gears.mesh.iso_stiffness import iso_stiffness
    from hbgear.gears.mesh.tooth_mesh import tooth_mesh

    pair, scales = machine.pair, scales_of(model)
    iso = iso_stiffness(pair)
    heading = "distance of the rack from the axis" if pair.wheel.rack else "centre distance"
    yield [
        heading,
        f"{pair.mounting_distance * 1e3:.4f} mm, working pressure angle {degrees(pair.working_pressure_angle):.4f} deg",
    ]
    overlap = f", overlap {pair.overlap_ratio:.4f}" if pair.overlap_ratio else ""
    yield ["contact ratio", f"{pair.contact_ratio:.5f} transverse{overlap}"]
    sizes = ", ".join(f"{pair.backlash_as(measure) * 1e6:.1f} {measure}" for measure in ("circumferential", "normal"))
    yield ["backlash [um]", f"{sizes}; half gap along the line of action {pair.half_backlash * 1e6:.1f}"]
    force = rounded(pair.transverse_force(machine.torque), 5) if machine.torque else "0"
    yield ["force along the line of action", f"{force} N{_orders_text(machine)}"]
    k = cycle.stiffness
    yield [
        "mesh stiffness",
        f"{k.mean:.4g} N/m mean ({k.mean / pair.face_width / 1e9:.2f} N/(mm um)), "
        f"{k.value.min():.4g} to {k.value.max():.4g}",
    ]
    k_0 = tooth_mesh(pair, machine.mesh_torque).stiffness
    yield ["stiffness, all gaps closed", f"{k_0:.4g} N/m mean, to which the damping ratio refers"]
    yield [
        "by ISO 6336-1, method B",
        f"{iso.mesh * pair.face_width:.4g} N/m (c' {iso.single / 1e9:.2f}, c_gamma {iso.mesh / 1e9:.2f} N/(mm um))",
    ]
    yield ["static transmission error", f"{cycle.peak_to_peak * 1e6:.2f} um peak to peak"]
    yield [
        "natural frequency",
        f"{scales.frequency / (2 * pi):.1f} Hz of the mesh, "
        f"{float(scales.pinion_speed(1 / model.mesh_order)):.0f} r/min of the pinion",
    ]


LOAD_CANDIDATES = 3
"""Motions of each curve with the largest estimates of the force and of each root stress, whose loads are computed."""


def largest_motions(curve: hb.Branch, mesh: hb.gears.ToothMesh, side: int) -> list[hb.Point]:
    """Return the stable points with the largest loads of a pair of teeth on a curve and on each of its others.

    A part that goes to infinity is left out, because its largest motion is where the curve ends.
    """
    points = []
    for branch in curve.curves:
        stable = stable_or_limit(branch)
        numbers = [i for i in bounded_inside(branch, None) if stable[i]]
        if numbers:
            order = np.argsort(load_estimates(branch, numbers, mesh, side), axis=0)[-LOAD_CANDIDATES:]
            points += [branch[numbers[i]] for i in np.unique(order)]
    return points


def teeth(machine: Machine, model: hb.mechanics.Model, curve: hb.Branch) -> Iterator[list[str]]:
    """Yield the largest loads of a pair of teeth on stable motions."""
    tooth_mesh, scales = hb.gears.tooth_mesh(machine.pair, machine.mesh_torque), scales_of(model)
    points = largest_motions(curve, tooth_mesh, 1 if machine.torque >= 0 else -1)
    if not points:
        yield ["largest force of a pair", "- (no stable motion)"]
        return
    candidates = [(hb.analysis.tooth_loads(point, tooth_mesh), point) for point in points]

    def speed_of(point: hb.Point) -> str:
        return f"{float(scales.pinion_speed(point.parameters['Omega'])):.0f} r/min"

    loads, point = max(candidates, key=lambda entry: float(entry[0].force.max()))
    number, position = loads.largest
    force, static = (rounded(float(forces.force.max()), 4) for forces in (loads.forces, loads.static))
    yield [
        "largest force of a pair",
        f"{force} N, {loads.force_factor:.2f} times the static force of {static} N, at {speed_of(point)}",
    ]
    pairs = len(loads.force)
    pair_text = "every pair" if pairs == 1 else f"pair {number + 1} of {pairs} that follow each other"
    yield ["it acts on", f"{pair_text}, {position:.2f} mesh periods after the pair enters contact"]
    other_flank = "back" if loads.side > 0 else "driving"
    back = "none" if not loads.back.any() else f"{rounded(float(loads.back.max()), 4)} N at most"
    yield [
        "separated, at this speed",
        f"{loads.separated.max():.0%} of the path of contact; contact on the {other_flank} flank: {back}",
    ]
    for i, name in enumerate(("pinion", "wheel")):
        if np.isfinite(loads.root_factor[i]):
            most, point = max(candidates, key=lambda entry: float(entry[0].root_stress[i].max()))
            yield [
                f"largest root stress, {name}",
                f"{most.root_stress[i].max() / 1e6:.1f} N/mm^2 (ISO 6336-3, "
                f"nominal), {most.root_factor[i]:.2f} times the static one, at {speed_of(point)}",
            ]
    limits = {float(scales.pinion_speed(x)) for branch in curve.curves for x in branch.asymptotes.values()}
    if limits:
        speeds = " and ".join(f"{limit:.0f}" for limit in sorted(limits))
        yield ["not included", f"motions that grow without bound near {speeds} r/min"]


def losses(machine: Machine, curve: hb.Branch) -> Iterator[list[str]]:
    """Yield the static efficiency and the efficiency and power loss of stable motions."""
    from hbgear.gears.mesh.tooth_friction import friction_mesh
    from hbgear.gears.mesh.tooth_mesh import tooth_mesh

    side = 1 if machine.torque >= 0 else -1
    static = friction_mesh(tooth_mesh(machine.pair, machine.mesh_torque), machine.friction, side).output
    yield ["static efficiency", f"{static if side > 0 else 1 / static:.4%}"]
    motions = list[tuple[float, ...]]()
    for branch in curve.curves:
        q, stable = hb.analysis.machine_quantities(branch), stable_or_limit(branch)
        columns = [q[name] for name in ("pinion", "efficiency", "power loss", "friction across, largest")]
        motions += [tuple(float(x[i]) for x in columns) for i in bounded_inside(branch, None) if stable[i]]
    if not motions:
        return
    for name, (rpm, efficiency, loss, _) in (("lowest", min(motions)), ("highest", max(motions))):
        yield [f"{name} speed, {rpm:.0f} r/min", f"efficiency {efficiency:.4%}, loss {rounded(loss, 4)} W"]
    rpm, efficiency, loss, across = min(motions, key=lambda motion: motion[1])
    yield [
        f"lowest efficiency, {rpm:.0f} r/min",
        f"{efficiency:.4%}, loss {rounded(loss, 4)} W; friction across the line of action {rounded(across, 4)} N",
    ]


def _orders_text(machine: Machine) -> str:
    """Return the amplitudes of the torque orders of the pinion."""
    return "".join(f", order {order:g} of the torque {size:g} N m" for order, size, _ in machine.torque_orders)
