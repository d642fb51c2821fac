"""Rattle of a lightly loaded pair under a torque of the second order of its shaft, as of an engine with four cylinders.

    python -m studies.gears.rattle [--quick] [-o DIR]

20 and 30 teeth, module 3 mm, 20 mm wide, tip relief 12 um, backlash 80 um, with the contacts of every pair of teeth. A
drag torque loads the pinion, and a torque of order 2 acts on it in addition; ten meshes are one period. On the line of
action

    m_c x'' + c x' + sum_j F_j(x, tau) = T_drag / r_b1 + (m_c r_b1^2 / J_1) T_2 / r_b1 cos(2 phi),   phi = shaft angle

If the elastic deflection is neglected, the teeth separate when the second force exceeds the first: at the ratio 1. The
curves follow the amplitude T_2 at one speed for three drag torques. Above the largest forces of a pair of teeth on both
flanks over T_2; below the displacement over one period at the end of a curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.gears.mesh.tooth_contacts import Flank, mesh_contacts
from hbgear.gears.mesh.tooth_forces import PairForces, pair_forces
from studies import study

TEETH, ORDER, DAMPING = (20, 30), 2, 0.05
MESHES = TEETH[0] // ORDER
"""Mesh periods in a period of the torque."""
DRAGS = (5.0, 10.0, 20.0)
"""On the pinion [N m]."""
LARGEST = 3.0
"""Largest ratio of the second force to the first."""
OMEGA = 0.5
"""Mesh frequency over the natural frequency of the mesh."""
HARMONICS = 12
"""Per mesh period."""


@lru_cache(maxsize=1)
def mesh() -> hb.gears.ToothMesh:
    """The mesh, with the compliance of the contacts at the middle drag torque."""
    gears = (hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm", tip_relief="12 um") for z in TEETH)
    return hb.gears.tooth_mesh(hb.GearPair(*gears, backlash="80 um"), DRAGS[1])


@lru_cache(maxsize=1)
def law() -> hb.mechanics.Law:
    """The contacts over ten meshes, in half backlashes and mean stiffnesses."""
    given, b = mesh(), mesh().pair.half_backlash
    flanks = [
        Flank(one.side, one.stiffness.plus(0.0, 1 / given.stiffness), one.gap.plus(0.0, 1 / b), 1.0, one.lag)
        for one in given.flanks
    ]
    return mesh_contacts(flanks, MESHES)


def force(torque: float) -> float:
    """A torque of the pinion as a force along the line of action, over k b."""
    pair = mesh().pair
    return pair.transverse_force(torque) / (mesh().stiffness * pair.half_backlash)


def part_of_pinion() -> float:
    """Part m_c r_b1^2 / J_1 of a varying torque that acts on the mesh; the rest accelerates the pinion."""
    pair = mesh().pair
    return pair.equivalent_mass * pair.base_radii[0] ** 2 / pair.pinion.inertia_used


@hb.mechanics.model
def drive(drag: float = 10.0, ratio: float = 0.0) -> hb.System:
    """The pair; ratio is that of the varying force to the force of the drag."""
    element = hb.Element([1.0], law(), damping=2 * DAMPING, name="mesh")
    load = hb.Load(constant=[force(drag)], cosine={1: [ratio * force(drag)]})
    return hb.System([[1.0]], None, [[0.0]], [element], load)


@dataclass(frozen=True)
class Rattle:
    """The curve of a drag torque over the ratio, and what is read from it."""

    drag: float
    curve: hb.Branch
    drive: Array
    """Largest force of a pair on its driving flank at each point [N]."""
    back: Array
    """And on its back flank."""
    last: PairForces
    """Forces at the end of the curve."""

    def ripple(self, ratio: Array | float) -> Array:
        """Amplitude of the varying torque of the pinion [N m]."""
        return np.asarray(ratio) * self.drag / part_of_pinion()

    def first(self, regimes: Sequence[str]) -> float:
        """Ratio at which one of these regimes begins; nan if it does not."""
        rows = np.flatnonzero(np.isin(self.curve.regimes, regimes))
        return float(self.curve.values[rows[0]]) if len(rows) else np.nan


def run(quick: bool = False) -> list[Rattle]:
    """One curve for each drag torque; the quick form has one with few harmonics and a small span."""
    if quick:
        return [traced(DRAGS[1], 1.6, 6)]
    return [traced(drag, LARGEST, HARMONICS) for drag in DRAGS]


def traced(drag: float, largest: float, harmonics: int) -> Rattle:
    """Trace one."""
    problem = hb.HarmonicBalance(drive(drag=drag), harmonics * MESHES)
    steps = hb.StepControl(max_points=150)
    at = {"Omega": OMEGA / MESHES}
    curve = hb.trace(problem, "ratio", (0.0, largest), at=at, steps=steps, special=False, accuracy=None)
    found = [forces(curve[i]) for i in range(len(curve))]
    return Rattle(
        drag,
        curve,
        np.array([one.force.max() for one in found]),
        np.array([one.back.max() for one in found]),
        found[-1],
    )


def forces(point: hb.Point) -> PairForces:
    """Forces of all pairs in a motion [N], [m]."""
    b, row = mesh().pair.half_backlash, point.coefficients()
    turn = 2 * np.pi * np.arange(64 * MESHES + 1) / (64 * MESHES)
    k = np.arange(1, len(row) // 2 + 1)
    x = row[0] + np.cos(np.outer(turn, k)) @ row[1::2] + np.sin(np.outer(turn, k)) @ row[2::2]
    at = turn * MESHES / (2 * np.pi)
    return pair_forces(mesh().flanks, lambda t: b * np.interp(t, at, x, period=MESHES), MESHES, b)


def plot(results: Sequence[Rattle]) -> Figure:
    """Largest forces over the varying torque, and a motion."""
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(6.4, 6.0), layout="constrained")
    for one, color in zip(results, (study.BLUE, study.ORANGE, study.PURPLE), strict=False):
        x = one.ripple(one.curve.values)
        top.plot(x, one.drive, color=color, lw=1.4, label=f"drag {one.drag:g} N m, driving flank")
        top.plot(x, one.back, ":", color=color, lw=1.4, label="back flank")
        for row in np.flatnonzero(~np.asarray(one.curve.stable)):
            top.plot(x[row], one.drive[row], "x", ms=3, color=color)
    top.plot([], [], "x", ms=3, color="black", label="unstable")
    top.set(xlabel="amplitude of the torque of order 2 [N m]", ylabel="largest force of a pair of teeth [N]")
    top.set_xlim(left=0)
    top.set_ylim(bottom=0)
    top.legend(fontsize=7)
    one = results[len(results) // 2]
    span = one.last.position < one.last.position[0] + 1
    u = np.concatenate([p + one.last.position[span] for p in range(MESHES)])
    x = np.concatenate([row[span] for row in one.last.displacement])
    b = mesh().pair.half_backlash
    bottom.plot(u - u[0], x * 1e6, color=study.BLUE, lw=1.3)
    for level in (b, -b):
        bottom.axhline(level * 1e6, color=study.GREY, lw=0.8, ls="--")
    bottom.set(xlabel="time [mesh periods]", ylabel="displacement on the line of action [μm]", xlim=(0, MESHES))
    ripple = float(one.ripple(one.curve.values[-1]))
    bottom.set_title(f"drag {one.drag:g} N m, torque of order 2 {ripple:.0f} N m; dashed: half backlash", loc="left")
    return figure


def report(results: Sequence[Rattle]) -> str:
    """Where rattle begins for each drag torque."""
    scale = mesh().pair
    lines = [
        f"Mesh frequency over natural frequency {OMEGA:g}; {part_of_pinion():.4f} of a varying torque acts on the mesh; half backlash {scale.half_backlash * 1e6:.1f} um. The ratio is that of the varying force to the "
        "force of the drag; rigid teeth separate at 1.",
        "",
        "| drag [N m] | separation from ratio | torque of order 2 [N m] | contact on the back flank from ratio "
        "| largest force of a pair at the end [N] | on the back flank [N] | ratio at the end | unstable rows |",
        "|" + " --- |" * 8,
    ]
    for one in results:
        begins, back = one.first(("single_sided", "double_sided")), one.first(("double_sided",))
        unstable = int(np.sum(~np.asarray(one.curve.stable)))
        lines.append(
            f"| {one.drag:g} | {begins:.3f} | {float(one.ripple(begins)):.1f} | {back:.3f} | {one.drive[-1]:.0f} "
            f"| {one.back[-1]:.0f} | {one.curve.values[-1]:.2f} | {unstable} of {len(one.curve)} |"
        )
    text = (
        "Where rows are unstable, the motion is not periodic with the torque: it has twice its period, or is chaotic."
    )
    return "\n".join([*lines, "", text, ""])


if __name__ == "__main__":
    study.main()
