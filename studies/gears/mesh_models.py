"""Mean mesh (secant, tangent) against the contacts of every pair of teeth, over tip relief, torque and contact ratio.

    python -m studies.gears.mesh_models [--quick] [-o DIR]

The pair of the study on relief. A mean mesh replaces the teeth by one stiffness and one error at the static load. It
is right while no gap of a pair opens or closes beyond the static state. Above the jumps of slow sweeps, below the
largest dynamic factor of the stable motions, where it is finite: over the relief at 200 N m, over the torque with 12
um of relief, and over the transverse contact ratio (by the addendum) at 200 N m with 12 um.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from studies import study
from studies.gears import relief

MESHES = ("teeth", "secant", "tangent")
LOOKS = {
    "teeth": (study.BLUE, "pairs of teeth"),
    "secant": (study.ORANGE, "secant"),
    "tangent": (study.PURPLE, "tangent"),
}
AXES = {
    "relief": ("tip relief [μm]", (0.0, 5.0, 10.0, 12.0, 16.0, 20.0, 25.0)),
    "torque": ("torque of the pinion [N m]", (50.0, 100.0, 150.0, 300.0)),
    "addendum": ("transverse contact ratio [-]", (0.8, 0.9, 1.1, 1.25)),
}
"""Label and values of each axis; the base case of 12 um, 200 N m and an addendum of one module is on all of them."""
BASE = {"relief": 12.0, "torque": 200.0, "addendum": 1.0}
JUMP_TOLERANCE, FACTOR_TOLERANCE = 0.02, 0.1
"""A mean mesh is called right if it has as many jumps as the pairs of teeth, at speeds that agree within the first
tolerance, and a largest dynamic factor that agrees within the second."""


@dataclass(frozen=True)
class Row:
    """One machine: the axes on which it lies, its values, its contact ratio, and its case by model of the mesh."""

    axes: tuple[str, ...]
    values: dict[str, float]
    contact_ratio: float
    cases: dict[str, relief.Case]

    def at(self, axis: str) -> float:
        """Position on an axis of the figure."""
        return self.contact_ratio if axis == "addendum" else self.values[axis]

    def deviation(self, mesh: str) -> float:
        """Relative deviation of the highest jump with rising speed from that of the pairs of teeth; nan without one."""
        ends = [
            max((rpm for rpm, way in self.cases[name].jumps if way > 0), default=np.nan) for name in (mesh, "teeth")
        ]
        return ends[0] / ends[1] - 1

    def right(self, mesh: str) -> bool:
        """Whether a mean mesh agrees with the pairs of teeth."""
        one, exact = self.cases[mesh], self.cases["teeth"]
        if [way for _, way in one.jumps] != [way for _, way in exact.jumps]:
            return False
        near = all(abs(a / b - 1) < JUMP_TOLERANCE for (a, _), (b, _) in zip(one.jumps, exact.jumps, strict=True))
        return near and (one.factor == exact.factor or abs(one.factor / exact.factor - 1) < FACTOR_TOLERANCE)


def run(quick: bool = False) -> list[Row]:
    """All machines; the quick form has the base case without and with relief, by two models."""
    meshes = MESHES[:2] if quick else MESHES
    if quick:
        return [row(("relief",), {**BASE, "relief": value}, meshes) for value in (0.0, 12.0)]
    rows = [row(tuple(AXES), BASE, meshes)]
    for axis, (_, values) in AXES.items():
        rows += [row((axis,), {**BASE, axis: value}, meshes) for value in values if value != BASE[axis]]
    return rows


def row(axes: tuple[str, ...], values: dict[str, float], meshes: Sequence[str]) -> Row:
    """Trace one machine by all models."""
    ratio = relief.pair(values["relief"], values["addendum"]).contact_ratio
    given = values["relief"], values["torque"]
    return Row(axes, values, ratio, {mesh: relief.case(*given, mesh, values["addendum"]) for mesh in meshes})


def plot(results: Sequence[Row]) -> Figure:
    """Jumps and largest dynamic factors over the three axes."""
    figure, panels = plt.subplots(2, len(AXES), figsize=(9.0, 5.6), layout="constrained", sharex="col", sharey="row")
    for (top, bottom), (axis, (label, _)) in zip(panels.T, AXES.items(), strict=True):
        here = sorted((one for one in results if axis in one.axes), key=lambda one: one.at(axis))
        width = max((one.at(axis) for one in here), default=1.0) - min((one.at(axis) for one in here), default=0.0)
        for k, (mesh, (color, name)) in enumerate(LOOKS.items()):
            some = [one for one in here if mesh in one.cases]
            shift = (k - 1) * 0.012 * width
            for one in some:
                for rpm, way in one.cases[mesh].jumps:
                    marker = "^" if way > 0 else "v"
                    top.plot(one.at(axis) + shift, rpm / 1e3, marker, ms=4.5, color=color, mfc="none", mew=0.9)
            line = [one.at(axis) for one in some], [one.cases[mesh].factor for one in some]
            bottom.plot(*line, "o-" if mesh == "teeth" else "s--", ms=3.5, lw=1.2, color=color, label=name)
        bottom.set(xlabel=label, ylim=(0, None))
    panels[0, 0].set_ylabel("jumps at [1000 r/min]")
    panels[1, 0].set_ylabel("largest dynamic factor [-]")
    panels[1, 0].legend()
    for marker, way in ("^", "rising"), ("v", "falling"):
        panels[0, 0].plot([], [], marker, ms=4.5, color="black", mfc="none", label=f"{way} speed")
    panels[0, 0].legend(loc="best")
    return figure


def report(results: Sequence[Row]) -> str:
    """Every machine in a table, and where each mean mesh is right."""
    lines = [
        f"A mean mesh is right where it has the jumps of the pairs of teeth within {JUMP_TOLERANCE:.0%} of their speed "
        f"and the largest dynamic factor within {FACTOR_TOLERANCE:.0%}.",
        "",
    ]
    for mesh in MESHES[1:]:
        some = [one for one in results if mesh in one.cases]
        right = [
            f"({one.values['relief']:g} um, {one.values['torque']:g} N m, contact ratio {one.contact_ratio:.2f})"
            for one in some
            if one.right(mesh)
        ]
        if some:
            found = ", ".join(right) or "none"
            missed = sum(bool(one.cases["teeth"].jumps) and not one.cases[mesh].jumps for one in some)
            false = sum(bool(one.cases[mesh].jumps) and not one.cases["teeth"].jumps for one in some)
            away = np.array([one.deviation(mesh) for one in some])
            span = f"{np.nanmin(away):+.1%} to {np.nanmax(away):+.1%}"
            lines += [
                f"{mesh.capitalize()}: right in {len(right)} of {len(some)} cases: {found}. No jump in {missed} "
                f"cases in which the pairs of teeth jump, jumps in {false} in which they do not; the highest one "
                f"with rising speed is off by {span}.",
                "",
            ]
    head = ("relief [um]", "torque [N m]", "contact ratio", "mesh", "jumps at [r/min]", "dynamic factor", "right")
    lines += ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for one in results:
        start = f"| {one.values['relief']:g} | {one.values['torque']:g} | {one.contact_ratio:.3f}"
        for mesh, case in one.cases.items():
            jumps = ", ".join(f"{rpm:.0f}{'+' if way > 0 else '-'}" for rpm, way in case.jumps) or "none"
            right = "" if mesh == "teeth" else "yes" if one.right(mesh) else "no"
            lines.append(f"{start} | {mesh} | {jumps} | {case.factor:.2f} | {right} |")
    return "\n".join([*lines, "", NOTE, ""])


NOTE = (
    "Without relief the load closes all gaps of the driving flanks, and the mean mesh and the pairs of teeth have the "
    "same force on them. The back flanks touch along the other line of action, with a phase of their own, which a mean "
    "mesh does not have: so motions with contact on both flanks differ there as well. The secant and the tangent "
    "differ because the contact becomes stiffer with the load. The damper is the same in all models."
)
"""Below the table."""


if __name__ == "__main__":
    study.main()
