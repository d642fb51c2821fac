"""Report on the speeds of a machine: resonances, jumps, safe ranges, critical speeds and a recommendation.

resonance      largest dynamic transmission error of a mesh, of stable motions, between its minima
safe range     speeds at which all known motions are stable and keep the teeth in contact
critical speed n = 60 f / order of a natural frequency f, for the orders of the mesh and of the shafts
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

import hbgear as hb
from hbgear.analysis.jump_landings import landings
from hbgear.analysis.quantities.axis_quantities import Ordinate
from hbgear.analysis.summary import digits_of, leaving_lines, text_at
from hbgear.cli.machine_report.peaks import refined_peak, stable_or_limit
from hbgear.cli.machine_report.speed_ranges import (
    Ranges,
    clipped,
    contact_lost,
    is_shown,
    jumps_possible,
    merged,
    meshes_of,
    outside,
    scales_of,
    speed_span,
    speeds_text,
    without_stable_motion,
)
from hbgear.cli.output import print_records, print_table, print_text
from hbgear.cli.support import label_on_curve
from hbgear.common.arrays import Array
from hbgear.common.text.digits import rounded

MIN_PROMINENCE = 1.15
"""Peak over the larger of the minima on both sides, above which it is a resonance."""


SAME_PEAK = 0.01
"""Relative difference of the speeds of a peak and of a jump that ends its branch."""

ACCURACY_GRADE = 6
"""Accuracy grade of ISO 1328 for the factor K_v and for the pitch error of an alternative: usual for ground gears."""


@dataclass(frozen=True)
class Resonance:
    """Largest stable motion of a resonance.

    Attributes
    ----------
    mesh : int or str
        Mesh by number or name.
    point : Point
        Motion.
    speed : float
        Speed of the pinion [r/min].
    transmission_error : float
        Half the peak-to-peak dynamic transmission error [um].
    factor : float
        Dynamic factor.
    force : float
        Largest force of the mesh [N].
    ends : bool
        Whether the motion is the last one before a jump.
    """

    mesh: int | str
    point: hb.Point
    speed: float
    transmission_error: float
    factor: float
    force: float
    ends: bool


def resonances(model: hb.mechanics.Model, curve: hb.Branch) -> list[Resonance]:
    """Return the resonances of a curve and of the other curves of its range, the lowest speed first.

    Of resonances of several meshes at the same speed, the one with the largest dynamic factor is returned.
    """
    all_resonances = [
        r for branch in curve.curves for name in meshes_of(model) for r in _mesh_resonances(model, branch, name)
    ]
    distinct: list[Resonance] = []
    for r in sorted(all_resonances, key=lambda r: np.nan_to_num(-r.factor)):
        if all(r.mesh == other.mesh or abs(r.speed - other.speed) > SAME_PEAK * r.speed for other in distinct):
            distinct.append(r)
    return sorted(distinct, key=lambda r: r.speed)


def _mesh_resonances(model: hb.mechanics.Model, branch: hb.Branch, mesh: int | str) -> Iterator[Resonance]:
    """Yield the resonances of a mesh along a branch."""
    scales, height = scales_of(model), Ordinate("dte", mesh)
    size = height.along(branch)
    stable = stable_or_limit(branch)
    jumps = [jump.value for jump in branch.jumps()]
    for i in _peaks(size, stable):
        ends = any(abs(branch.values[i] - value) < SAME_PEAK * value for value in jumps)
        if i in (0, len(branch) - 1) and not ends:
            continue  # the range ends there, not the resonance
        point, largest = refined_peak(branch, size, i, lambda motion: height.at(motion, branch))
        quantities = hb.analysis.machine_quantities(point, mesh)
        speed = float(scales.pinion_speed(point.parameters["Omega"]))
        yield Resonance(
            mesh,
            point,
            speed,
            largest,
            float(quantities["dynamic factor"][0]),
            abs(float(quantities["force, largest"][0])),
            ends,
        )


def _peaks(size: Array, stable: Array) -> list[int]:
    """Return the largest stable points between minima that are lower by `MIN_PROMINENCE`."""
    peaks: list[int] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stable.astype(int), [0]])))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        top, low = int(first), float(size[first]) if first == 0 else 0.0  # unstable motions are no minimum
        rising = True
        for i in range(int(first), int(end)):
            if rising and size[i] >= size[top]:
                top = i
            elif rising and size[top] > MIN_PROMINENCE * size[i]:
                if size[top] > MIN_PROMINENCE * low or top == first:
                    peaks.append(int(top))
                rising, low = False, float(size[i])
            elif not rising and size[i] < low:
                low = float(size[i])
            elif not rising and size[i] > MIN_PROMINENCE * low:
                rising, top = True, i
        if rising and size[top] > MIN_PROMINENCE * low:
            peaks.append(top)
    return peaks


def show_speeds(
    model: hb.mechanics.Model,
    curve: hb.Branch,
    dimensionless: bool = False,
    other_ranges: Ranges | None = None,
    shown: tuple[float, float] | None = None,
) -> None:
    """Print resonances, jumps, speed ranges and critical speeds of a machine; ValueError if the model has no scales.

    ``other_ranges`` are ranges of the speed [r/min] with other motions that lose the contact of the teeth, ``shown`` is
    the one that is reported, by default that of the curve. With ``dimensionless`` Omega is printed as well.
    """
    _show_resonances(model, curve, shown)
    _show_jumps(model, curve, dimensionless, shown)
    for number, branch in enumerate(curve.curves, 1):
        for line in leaving_lines(branch):
            print_text(line if number == 1 else f"curve {number}: {line}")
    _show_ranges(model, curve, other_ranges or [], shown)
    _show_critical(model, curve)


def _show_resonances(model: hb.mechanics.Model, curve: hb.Branch, shown: tuple[float, float] | None) -> None:
    """Print the resonances: speed, mesh frequency, dynamic factor, transmission error and force."""
    scales, several = scales_of(model), len(meshes_of(model)) > 1
    sizes = ("dynamic factor", "transmission error [um]", "largest force [N]")

    def at(Omega: float, mesh: str) -> dict[str, str]:
        speeds = {"pinion r/min": scales.pinion_speed(Omega), "mesh Hz": scales.mesh_frequency(Omega)}
        return {name: f"{float(x):.0f}" for name, x in speeds.items()} | ({"mesh": mesh} if several else {})

    records = []
    for r in (r for r in resonances(model, curve) if is_shown(r.speed, shown)):
        texts = number_or_dash(r.factor), rounded(r.transmission_error, 3), rounded(r.force, 4)
        record = at(r.point.parameters["Omega"], str(r.mesh)) | dict(zip(sizes, texts, strict=True))
        records.append(record | {"": "before a jump" if r.ends else ""})
    for branch in filter(is_unbounded, curve.curves):
        end = branch.asymptotes.get("last", float(branch.values[-1]))
        if is_shown(float(scales.pinion_speed(end)), shown):
            record = at(end, "-") | dict.fromkeys(sizes, "unbounded")
            records.append(record | {"": "more damping would limit it"})
    records.sort(key=lambda record: float(record["pinion r/min"]))
    if records:
        addition = ", with the mesh of the largest dynamic factor" if several else " of the mesh"
        print_records(records, f"resonances{addition}; the transmission error is half peak to peak")
    else:
        print_text("no resonance in this range of speeds")


def number_or_dash(value: float) -> str:
    """Return a number with three digits, "-" for nan."""
    return rounded(value, 3) if np.isfinite(value) else "-"


def _show_jumps(
    model: hb.mechanics.Model, curve: hb.Branch, dimensionless: bool, shown: tuple[float, float] | None
) -> None:
    """Print the jumps of slow sweeps with the dynamic factors before and after."""
    scales, pair = scales_of(model), getattr(model, "pair", None)
    records = []
    for number, branch_landings in enumerate(landings(curve.curves), 1):
        for jump in (landing.jump for landing in branch_landings):
            speed = float(scales.pinion_speed(jump.value))
            if not is_shown(speed, shown):
                continue
            digits = digits_of(jump.before, 6)
            record = {"": label_on_curve(number, jump), "pinion r/min": rounded(speed, digits)}
            record["mesh Hz"] = rounded(float(scales.mesh_frequency(jump.value)), digits)
            if dimensionless:
                record["Omega"] = text_at(jump.before, "Omega")
            record["sweep"] = "increasing" if jump.direction > 0 else "decreasing"
            for name, point in (("dynamic factor before", jump.before), ("after", jump.after)):
                record[name] = factor_text(model, point, min(digits, 3))
            if pair is not None:
                K_v = float(hb.gears.iso_dynamic_factor(pair, mesh_torque(model), speed, ACCURACY_GRADE))
                record["K_v"] = f"{K_v:.2f}"
            records.append(record)
    if not records:
        where = "on these curves" if curve.others else "on this curve"
        print_text(f"no jumps {where if shown is None else 'in this range of speeds'}")
        return
    title = "jumps of a slow sweep; dynamic factor = largest / static force of the mesh"
    title += " with the largest one" if len(meshes_of(model)) > 1 else ""
    title += "" if pair is None else f"; K_v of ISO 6336-1, method B, grade {ACCURACY_GRADE}"
    print_records(records, title)


def mesh_torque(model: Any) -> float:
    """Return the torque at which the mesh of a gear pair is computed [N m]."""
    from hbgear.gears.torque_orders import effective_torque

    return effective_torque(model.torque, model.torque_orders)


def _show_ranges(
    model: hb.mechanics.Model, curve: hb.Branch, other_ranges: Ranges, shown: tuple[float, float] | None
) -> None:
    """Print the speeds at which the teeth stay in contact and nothing jumps, and why others are left out."""
    low, high = shown or speed_span(model, curve)
    lost = clipped(merged([*contact_lost(model, curve), *other_ranges]), shown)
    unknown = clipped(without_stable_motion(model, curve), shown)
    avoided = merged([*lost, *unknown])
    jumps = clipped(jumps_possible(model, curve, avoided), shown)
    if not avoided and not jumps:
        print_text(f"linear at this load: the teeth stay in contact from {low:.0f} to {high:.0f} r/min")
        return
    safe = outside(merged([*avoided, *jumps]), low, high)
    print_text(
        f"safe speeds, at which the teeth stay in contact and nothing jumps: "
        f"{speeds_text(safe) if safe else f'none from {low:.0f} to {high:.0f} r/min'}"
    )
    if lost:
        print_text(f"loss of contact is possible: {speeds_text(lost)}")
    if jumps:
        print_text(f"jumps without loss of contact: {speeds_text(jumps)}")
    if unknown:
        note = "" if other_ranges else "; motions of other periods are not computed"
        print_text(f"no stable motion of the mesh period: {speeds_text(unknown)}{note}")


def _show_critical(model: hb.mechanics.Model, curve: hb.Branch) -> None:
    """Print the speeds at which orders of mesh and shafts meet natural frequencies."""
    scales, pair = scales_of(model), getattr(model, "pair", None)
    if pair is None:
        return
    Omega = float(np.max(np.abs(curve.values)))
    diagram = hb.analysis.campbell(model, (0.5 * Omega, Omega), points=2)
    order = float(getattr(model, "mesh_order", 1))
    z1, z2 = pair.pinion.teeth, pair.wheel.teeth
    orders = {"mesh order 1": order, "2": 2 * order, "3": 3 * order, "pinion order 1": order / z1}
    if not pair.wheel.rack:
        orders["wheel order 1"] = order / z2
    rows = []
    for frequency in diagram.frequencies[-1]:
        if np.isfinite(frequency) and frequency > 0:
            hertz = float(scales.mesh_frequency(float(frequency))) / order
            speeds = [
                f"{float(scales.pinion_speed(float(frequency) / order_value)):.0f}" for order_value in orders.values()
            ]
            rows.append([f"{hertz:.0f}", *speeds])
    if rows:
        title = "critical speeds of the pinion in r/min, at which an order meets a natural frequency (closed gaps)"
        print_table(["natural frequency [Hz]", *orders], rows, title)


def is_unbounded(branch: hb.Branch) -> bool:
    """Return whether the stable motions of a branch grow without bound."""
    return branch.status == hb.Status.UNBOUNDED and (branch.stable is None or bool(branch.stable[-1]))


def factor_text(model: hb.mechanics.Model, point: hb.Point | None, digits: int) -> str:
    """Return the largest dynamic factor of the meshes at a point; "-" without a point or a static force."""
    if point is None:
        return "-"
    factors = []
    for name in meshes_of(model):
        with suppress(ValueError):
            factors.append(hb.analysis.dynamic_factor(model, point, name))
    return rounded(max(factors), digits) if factors else "-"


def recommendation(
    model: hb.mechanics.Model,
    curve: hb.Branch,
    measures: Sequence[tuple[str, float]] = (),
    reference: float = np.inf,
    other_ranges: Ranges | None = None,
    shown: tuple[float, float] | None = None,
) -> str:
    """Return one sentence on the speeds to avoid and on the change of the design that helps most.

    ``measures`` are changes that a designer can make, with the largest dynamic factor that each gives, ``reference`` is
    that of the design. The ranges are those of `show_speeds`.
    """
    lost = merged([*contact_lost(model, curve), *(other_ranges or []), *without_stable_motion(model, curve)])
    avoided = clipped(merged([*lost, *jumps_possible(model, curve, lost)]), shown)
    if avoided:
        text = f"avoid {speeds_text(avoided)}"
    else:
        finite = (x for x in resonances(model, curve) if np.isfinite(x.factor) and is_shown(x.speed, shown))
        worst = max(finite, key=lambda x: x.factor, default=None)
        text = (
            "no speed of this range has to be avoided"
            if worst is None
            else (
                f"no speed has to be avoided because of jumps; the dynamic factor is largest at {worst.speed:.0f} r/min"
            )
        )
    better = min(measures, key=lambda x: x[1], default=None)
    if better is not None and better[1] < 0.9 * reference:
        comparison = "" if np.isinf(reference) else f" instead of {reference:.3g}"
        text += f"; {better[0]} gives a largest dynamic factor of {better[1]:.3g}{comparison}"
    return f"recommendation: {text}"
