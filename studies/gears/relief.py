"""Tip relief that removes the jump of a spur pair at its load, and its effect at half of the load.

    python -m studies.gears.relief [--quick] [-o DIR]

25 and 40 teeth, module 3 mm, 20 mm wide, steel, 200 N m on the pinion, backlash 80 um, damping ratio 0.04 (assumed),
with the contacts of every pair of teeth (mesh="teeth"). Linear relief of both gears, from the tips to the highest
point of single contact, takes material where teeth deflect; at the load it is made for the static transmission error
is smooth. With less relief the pair jumps, because pairs that the relief has opened make contact under dynamic load.
At another load the same relief is too little or too much. Above the responses at 200 N m; below the largest dynamic
factor of the stable motions, the largest force of a pair of teeth over its largest static force, and the speeds at
which slow sweeps jump, over the relief.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.gears.drawing import response

TORQUES = (200.0, 100.0)
"""On the pinion [N m]: that the relief is made for, and half of it."""
RELIEFS = (0.0, 5.0, 10.0, 12.0, 14.0, 16.0, 17.0, 18.0, 19.0, 20.0, 21.0, 22.0, 23.0, 25.0, 30.0)
"""[um]"""
SHOWN = (0.0, 12.0, 20.0)
"""Reliefs whose responses are drawn [um]."""
DAMPING, SPAN, HARMONICS = 0.04, (1.5, 0.3), 24
CANDIDATES = 20
"""Stable points with the largest displacement, among which the largest dynamic factor is searched."""


@dataclass(frozen=True)
class Case:
    """One pair with one model of its mesh under one torque: the curve, and what is read from it."""

    relief: float
    torque: float
    mesh: str
    ripple: float
    """Static transmission error, peak to peak [um]."""
    curve: hb.Branch
    model: hb.SpurPair
    jumps: tuple[tuple[float, int], ...]
    """Speed [r/min] and direction of each jump, ascending."""
    factor: float
    """Largest dynamic factor of stable motions; infinite if a stable branch tends to infinity."""
    speed: float
    """Where it is [r/min]; nan if it is infinite."""
    pair_factor: float
    """Largest force of a pair of teeth over its largest static one, in that motion; nan for a mean mesh."""


def pair(relief: float, addendum: float = 1.0) -> hb.GearPair:
    """The drawing, with a relief [um] and an addendum [module]."""
    gears = (
        hb.gears.Gear(
            teeth=z,
            module="3 mm",
            face_width="20 mm",
            tip_relief=relief * 1e-6,
            addendum=addendum,
            dedendum=addendum + 0.25,
        )
        for z in (25, 40)
    )
    return hb.GearPair(*gears, backlash="80 um")


def case(relief: float, torque: float, mesh: str = "teeth", addendum: float = 1.0) -> Case:
    """Trace one."""
    gears = pair(relief, addendum)
    model = gears.model(torque, DAMPING, mesh=mesh)
    curve = hb.trace(hb.HarmonicBalance(model, HARMONICS), "Omega", SPAN)
    rpm = model.scales.pinion_speed
    curves = curve.curves
    jumps = tuple(sorted((float(rpm(jump.value)), jump.direction) for one in curves for jump in one.jumps()))
    ripple = gears.mesh(torque).peak_to_peak * 1e6
    if any(one.status == hb.Status.UNBOUNDED and one.stable[-1] for one in curves):
        return Case(relief, torque, mesh, ripple, curve, model, jumps, np.inf, np.nan, np.inf)
    points = [one[int(i)] for one in curves for i in np.argsort(one.amplitude("max") * one.stable)[-CANDIDATES:]]
    factor, top = max(((hb.analysis.dynamic_factor(model, point), point) for point in points), key=lambda x: x[0])
    speed, of_pair = float(rpm(top.parameters["Omega"])), np.nan
    if mesh == "teeth":
        of_pair = hb.analysis.tooth_loads(top, hb.gears.tooth_mesh(gears, torque)).force_factor
    return Case(relief, torque, mesh, ripple, curve, model, jumps, factor, speed, of_pair)


def run(quick: bool = False) -> tuple[Case, ...]:
    """All cases; the quick form has three reliefs under the first torque."""
    if quick:
        return tuple(case(relief, TORQUES[0]) for relief in SHOWN)
    return tuple(case(relief, torque) for torque in TORQUES for relief in RELIEFS)


def plot(results: Sequence[Case]) -> Figure:
    """Responses above; dynamic factors and jumps over the relief below."""
    figure, axes = plt.subplots(2, 2, figsize=(8.4, 6.4), layout="constrained")
    grid = axes[0, 0].get_gridspec()
    for ax in axes[0]:
        ax.remove()
    top = figure.add_subplot(grid[0, :])
    at_load = [c for c in results if c.torque == TORQUES[0]]
    for c, color in zip([c for c in at_load if c.relief in SHOWN], draw.BRANCHES, strict=False):
        scales = c.model.scales
        name = rf"relief {c.relief:g} $\mu$m"
        response(top, c.curve, "pp2", scales.pinion_speed, scales.length * 1e6, color, name)
    top.set(xlabel="speed of the pinion [r/min]", ylabel=r"half peak-to-peak of $x$ [$\mu$m]", xlim=(4000, 22000))
    top.set(yscale="log", ylim=(0.5, 1e3))
    top.legend(loc="upper right")
    for torque, color, marker in zip(TORQUES, (study.BLUE, study.ORANGE), "os", strict=True):
        here = [c for c in results if c.torque == torque]
        if here:
            axes[1, 0].plot(
                [c.relief for c in here],
                [c.factor for c in here],
                marker + "-",
                ms=4,
                color=color,
                label=f"{torque:g} N m",
            )
            axes[1, 0].plot(
                [c.relief for c in here],
                [c.pair_factor for c in here],
                marker + ":",
                ms=3,
                color=color,
                mfc="white",
                label=f"{torque:g} N m, pair of teeth",
            )
        for c in here:
            for rpm, direction in c.jumps:
                axes[1, 1].plot(c.relief, rpm, "^" if direction > 0 else "v", ms=5, color=color, mfc="white")
    axes[1, 0].set(xlabel=r"tip relief [$\mu$m]", ylabel="largest / static force [-]", ylim=(0, None))
    axes[1, 0].set_title("where no stable motion tends to infinity", loc="left")
    axes[1, 0].axhline(1, color=draw.GREY, lw=0.8)
    axes[1, 0].legend()
    axes[1, 1].set(xlabel=r"tip relief [$\mu$m]", ylabel="jumps at [r/min]", xlim=axes[1, 0].get_xlim())
    for marker, way in ("^", "rising"), ("v", "falling"):
        axes[1, 1].plot([], [], marker, ms=5, color="black", mfc="white", label=f"{way} speed")
    axes[1, 1].legend(loc="lower center")
    return figure


def free(results: Sequence[Case], torque: float) -> list[float]:
    """Reliefs without a jump under a torque [um]."""
    return [c.relief for c in results if c.torque == torque and not c.jumps]


def report(results: Sequence[Case]) -> str:
    """Every case in a table, in Markdown."""
    lines = [
        "Jumps while the speed rises (+) or falls (-). The dynamic factor is the largest over the static mesh force; "
        "that of a pair of teeth is its largest over its largest static force. It is infinite where a branch of stable "
        "motions tends to infinity: there the parametric excitation exceeds the damping.",
        "",
    ]
    for torque in TORQUES:
        found = ", ".join(f"{relief:g}" for relief in free(results, torque)) or "none"
        lines.append(f"Reliefs without a jump at {torque:g} N m [um]: {found}.")
    lines += [
        "",
        "| torque [N m] | tip relief [um] | static error, peak to peak [um] | jumps at [r/min] "
        "| largest dynamic factor | at [r/min] | of a pair of teeth |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for c in results:
        jumps = ", ".join(f"{rpm:.0f}{'+' if way > 0 else '-'}" for rpm, way in c.jumps) or "none"
        lines.append(
            f"| {c.torque:g} | {c.relief:g} | {c.ripple:.2f} | {jumps} | {c.factor:.2f} | "
            f"{'-' if np.isnan(c.speed) else f'{c.speed:.0f}'} "
            f"| {c.pair_factor:.2f} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
