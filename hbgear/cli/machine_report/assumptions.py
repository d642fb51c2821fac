"""Assumptions of the model of a gear pair: the effect of other values on jumps and on the largest dynamic factor.

A table shows the curve as computed and with each alternative: other damping, pitch errors of an accuracy grade, tip
relief of the size of the static deflection, inertia, and other models of the mesh. The alternatives are computed in
threads.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from threading import Event
from typing import TYPE_CHECKING, Any

import numpy as np

import hbgear as hb
from hbgear.analysis.quantities.engineering_quantities import element_force, problem_along
from hbgear.cli.machine_report.speed_ranges import is_shown, scales_of
from hbgear.cli.machine_report.speeds import ACCURACY_GRADE, is_unbounded, mesh_torque
from hbgear.cli.output import print_table
from hbgear.common.process.threads import begun
from hbgear.common.text.digits import rounded
from hbgear.plot.branch_sections import bounded_points

if TYPE_CHECKING:
    from hbgear.gears import DrawnPair

FACTOR_CANDIDATES, COARSE_SAMPLES = 5, 256
"""Stable points with the largest forces at which the dynamic factor is computed, and samples that select them."""

LONG_STEPS = hb.StepControl(max_step=0.4)
"""Steps of the curves for comparison. Jumps are located between the points, so that their speeds do not depend on the
steps; factors changed by 0.5 % at most, and half of the points remain."""

JUMPS = "jumps at r/min, speed increasing (+) or decreasing (-)"
"""Header of the column of jumps."""

NO_RELIEF = "no tip relief"
"""Name of the alternative with tip relief, before its size."""


@contextmanager
def without_relief_warning() -> Iterator[None]:
    """Suppress the warning of too much relief or pitch error for the load, of which alternatives have more."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "GearPair: under the mesh force", hb.mechanics.ImplausibleInputWarning)
        yield


def until(stop: Event) -> Callable[[hb.continuation.Progress], None]:
    """Return a monitor of a trace that ends it when an event is set."""

    def ends(_: hb.continuation.Progress) -> None:
        if stop.is_set():
            raise KeyboardInterrupt

    return ends


def alternative_row(
    model: DrawnPair,
    curve: hb.Branch,
    count: int,
    speeds: tuple[float, float] | None,
    assumption: tuple[str, Callable[[], DrawnPair]],
    stop: Event,
) -> list[str]:
    """Return the name of another assumption and its `factor_and_jumps`, in a range of speeds [r/min] or of the curve.

    The curve is reused if the model differs in scales only, and no range is given.
    """
    name, changed = assumption[0], assumption[1]().equations
    is_reusable = (
        speeds is None
        and hasattr(changed, "reference")
        and changed.replace(reference=getattr(model.equations, "reference", ())) == model.equations
    )
    if not is_reusable:
        problem, unit = hb.HarmonicBalance(changed, count), float(scales_of(changed).pinion_speed(1.0))
        ends = () if speeds is None else (speeds[0] / unit, speeds[1] / unit)
        span = with_default_span(changed, ends)
        curve = hb.trace(problem, "Omega", span, steps=LONG_STEPS, accuracy=None, progress=until(stop))
    return [name, *factor_and_jumps(changed, curve, speeds)]


def with_default_span(model: hb.mechanics.Model, ends: Sequence[float]) -> tuple[float, float]:
    """Return the default span of Omega of a model, extended to given ends.

    Motions of a range of speeds may be reached from outside this range only, so that a curve of the range misses them.
    """
    first, last = model.default_span
    every = (first, last, *ends)
    return (max(every), min(every)) if first > last else (min(every), max(every))


def factor_and_jumps(
    model: hb.mechanics.Model, curve: hb.Branch, shown: tuple[float, float] | None = None
) -> tuple[str, str]:
    """Return the largest dynamic factor and the jump speeds as texts, in a range of speeds [r/min]."""
    return largest_factor(model, curve, shown), _jump_speeds(model, curve, shown)


def alternatives(model: DrawnPair, by_default: bool = False) -> Iterator[tuple[str, Callable[[], DrawnPair]]]:
    """Yield each assumption with an alternative value as text, and a function that returns the model with that value.

    With ``by_default`` the damping ratio of the pair is a default value.
    """
    from hbgear.gears.mesh.iso_dynamics import deviations
    from hbgear.gears.mesh.mesh_models import MESHES

    zeta, pair = model.damping, model.pair

    def with_changes(**changes: Any) -> Callable[[], DrawnPair]:
        return partial(dataclasses.replace, model, units=(), **changes)

    def with_pair_changes(**changes: Any) -> Callable[[], DrawnPair]:
        return with_changes(pair=dataclasses.replace(pair, **changes))

    origin = "assumed" if by_default else "given"
    for factor in (0.5, 1.5):
        if zeta and zeta * factor <= 1:
            yield f"damping {zeta:g} ({origin}): {zeta * factor:g}", with_changes(damping=zeta * factor)
    pitch = max(deviations(gear, ACCURACY_GRADE)[0] for gear in (pair.pinion, pair.wheel) if not gear.rack)
    if model.cycle is None and not pair.pitch_error:
        yield f"no pitch error: {pitch * 1e6:.3g} um (grade {ACCURACY_GRADE})", with_pair_changes(pitch_error=pitch)
    if model.cycle is None and not pair.pinion.tip_relief:
        relief = _relief_for_load(model)
        relieved = {name: dataclasses.replace(getattr(pair, name), tip_relief=relief) for name in ("pinion", "wheel")}
        yield f"{NO_RELIEF}: {relief * 1e6:g} um", with_pair_changes(**relieved)
    lighter = {name: _lighter(getattr(pair, name), 0.8) for name in ("pinion", "wheel")}
    solid = pair.pinion.inertia is None and pair.wheel.inertia is None
    yield (
        f"{'solid gears without other inertia' if solid else 'inertia'}: inertia 20 % less",
        with_pair_changes(**lighter),
    )
    current = model.mesh or MESHES[0]
    for name in MESHES if model.cycle is None and not model.friction else ():  # the mean-mesh models have no friction
        if name != current:
            yield f"{_MESH_WORDS[current]}: {_MESH_WORDS[name]}", with_changes(mesh=name)


def _relief_for_load(model: DrawnPair) -> float:
    """Return the static deflection of the teeth of a pair in contact, with one digit [m]."""
    from hbgear.gears.mesh.tooth_mesh import tooth_mesh

    mesh = tooth_mesh(model.pair, mesh_torque(model))
    return float(f"{mesh.force / mesh.stiffness:.0e}")


def _lighter(gear: hb.gears.Gear, factor: float) -> hb.gears.Gear:
    """Return a gear with a factor of its inertia, or a rack with a factor of its mass."""
    if gear.rack:
        return dataclasses.replace(gear, mass=factor * gear.mass_used)
    return dataclasses.replace(gear, inertia=factor * gear.inertia_used)


def show_assumptions(model: DrawnPair, curve: hb.Branch, count: int, shown: tuple[float, float] | None) -> None:
    """Print the table of assumptions of a gear pair and of their effect in a range of speeds [r/min].

    Without ``shown`` it is that of the curve. ``count`` are the harmonics of the other curves.
    """
    row = partial(alternative_row, model, curve, count, shown)
    with without_relief_warning(), begun(row, [*alternatives(model)]) as results:
        rows = [["as computed", *factor_and_jumps(model, curve, shown)], *(future.result() for future in results)]
    print_assumptions(rows)


def print_assumptions(rows: Sequence[Sequence[str]]) -> None:
    """Print the table of assumptions."""
    headers = ["assumption: alternative", "largest dynamic factor", JUMPS]
    print_table(headers, [[*row] for row in rows], "assumptions and their effect")


_MESH_WORDS = {"teeth": "mesh of tooth pairs", "secant": "one stiffness, secant", "tangent": "one stiffness, tangent"}
"""Names of the models of the mesh in tables."""


def _jump_speeds(model: hb.mechanics.Model, curve: hb.Branch, shown: tuple[float, float] | None) -> str:
    jumps = [jump for branch in curve.curves for jump in branch.jumps()]
    speeds = sorted((float(scales_of(model).pinion_speed(jump.value)), jump.direction) for jump in jumps)
    listed = [f"{rpm:.0f}{'+' if direction > 0 else '-'}" for rpm, direction in speeds if is_shown(rpm, shown)]
    return ", ".join(listed) or "none"


def largest_factor(model: hb.mechanics.Model, curve: hb.Branch, shown: tuple[float, float] | None = None) -> str:
    """Return the largest dynamic factor of the stable points, in a range of r/min; "-" without them.

    Where the stiffness varies, the largest force is not at the largest amplitude.
    """
    unit = float(scales_of(model).pinion_speed(1.0))
    for branch in filter(is_unbounded, curve.curves):
        if is_shown(unit * branch.asymptotes.get("last", float(branch.values[-1])), shown):
            return "unbounded"
    span = None if shown is None else (shown[0] / unit, shown[1] / unit)
    points = [
        (branch, i)
        for branch in curve.curves
        for i in bounded_inside(branch, span)
        if branch.stable is None or branch.stable[i]
    ]
    factor = largest_of(model, points) if points else math.nan
    return rounded(factor, 3) if math.isfinite(factor) else "-"


def largest_of(model: hb.mechanics.Model, points: Sequence[tuple[hb.Branch, int]]) -> float:
    """Return the largest dynamic factor of points of curves in Omega, on which the static force is the same.

    It is nan without a static force.
    """

    def force(entry: tuple[hb.Branch, int]) -> float:
        branch, i = entry
        problem, parameters = problem_along(branch), branch.parameters_at(i)
        return float(np.abs(element_force(problem, branch.X[i], parameters, 0, COARSE_SAMPLES)).max())

    largest = sorted(points, key=force)[-FACTOR_CANDIDATES:]
    try:
        return max(hb.analysis.dynamic_factor(model, branch[i]) for branch, i in largest)
    except ValueError:
        return math.nan


def bounded_inside(branch: hb.Branch, span: tuple[float, float] | None) -> list[int]:
    """Return the numbers of the points in a span of Omega, without those that go to infinity."""
    return [i for i in range(len(branch))[bounded_points(branch)] if is_shown(float(branch.values[i]), span)]
