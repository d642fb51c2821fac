"""A planetary set with four planets and backlash in all eight meshes: planets in phase and in sequence.

    python -m studies.gears.phasing [--quick] [-o DIR]

The machine of Lin and Parker (1999) with 28, 36 and 100 teeth, whose planets all mesh with the sun at the same instant,
and with 27, 35 and 97, where they do so one after the other; nothing else differs. In phase, forces of the planets add
up along the circumference and cancel sideways: the rotational mode at 7774 Hz is excited, sun and ring rest in their
bearings. In turn, they cancel along the circumference (but for every fourth harmonic) and the translational modes at
7190 and 10438 Hz are excited. Both lose contact and jump. Up to BP1 each planet of the sequential set repeats the
motion of the previous one a quarter of the period later; at BP1 a branch starts without this symmetry (symmetry
breaking). The curves are compared with time integration at 12 points each.
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

TEETH = {"in phase": (28, 36, 100), "sequential": (27, 35, 97)}
"""Sun, planet, ring."""
SPAN, HARMONICS = (2.3, 0.5), 12


@dataclass(frozen=True)
class Case:
    """One phasing: the curve, the one that leaves by symmetry breaking, and what is read from them."""

    name: str
    model: hb.gears.PlanetarySet
    curve: hb.Branch
    broken: hb.Branch | None
    confirmed: str
    """Points that agree with integration in time, of those looked at."""

    @property
    def jumps(self) -> list[str]:
        """Frequencies of the meshing [Hz] with + or - for a rising or falling speed."""
        hertz = self.model.scales.mesh_frequency
        return [f"{hertz(jump.value):.0f} {'+' if jump.direction > 0 else '-'}" for jump in self.curve.jumps()]

    def largest(self, dof: str) -> float:
        """Largest rms of a coordinate on stable motions [um]."""
        rms = self.curve.amplitude("rms", dof=dof)
        return float(rms[self.curve.stable].max() * self.model.b_c * 1e6)


def case(name: str, check: bool = True) -> Case:
    """Trace one; its symmetry breaking too, and 12 points by integration in time if so asked."""
    model = hb.gears.PlanetarySet(*TEETH[name])
    curve = hb.trace(hb.HarmonicBalance(model, HARMONICS), "Omega", SPAN)
    first = next((point.label for point in curve.special if point.kind == "BP"), None)
    broken = hb.switch(curve, first) if first else None
    report = hb.validate(curve, 12, landing="nearest") if check else None
    confirmed = "not checked" if report is None else f"{sum(row.ok for row in report.rows)} of {len(report.rows)}"
    return Case(name, model, curve, broken, confirmed)


def run(quick: bool = False) -> tuple[Case, ...]:
    """Both phasings; the quick form does not check them."""
    return tuple(case(name, not quick) for name in TEETH)


def plot(results: Sequence[Case]) -> Figure:
    """Gaps above, motion of the sun below; in phase on the left, sequential on the right."""
    figure, axes = plt.subplots(2, 2, figsize=(8.6, 6.0), layout="constrained", sharex=True, sharey="row")
    for column, one in zip(axes.T, results, strict=True):
        hertz, length = one.model.scales.mesh_frequency, one.model.b_c * 1e6
        for element, color in (("ring-p1", draw.BRANCHES[0]), ("sun-p1", draw.BRANCHES[1])):
            response(
                column[0], one.curve, "pp2", lambda w, f=hertz: f(w) / 1e3, length, color, element, element=element
            )
        if one.broken is not None:
            response(
                column[0],
                one.broken,
                "pp2",
                lambda w, f=hertz: f(w) / 1e3,
                length,
                draw.BRANCHES[3],
                "sun-p1, symmetry broken",
                element="sun-p1",
            )
        for dof, color, what in (("x_sun", draw.BRANCHES[2], "sideways"), ("u_sun", draw.BRANCHES[5], "turning")):
            f, rms = hertz(one.curve.values) / 1e3, one.curve.amplitude("rms", dof=dof) * length
            for stable, style in ((one.curve.stable, "-"), (~one.curve.stable, "--")):
                column[1].plot(
                    f, np.where(stable, rms, np.nan), style, color=color, lw=1.3, label=what if style == "-" else None
                )
        column[0].set_title(f"{one.name}: {', '.join(map(str, TEETH[one.name]))} teeth")
        column[1].set_xlabel("frequency of the teeth [kHz]")
        column[0].legend(loc="upper left")
        column[1].legend(loc="upper left")
    axes[0, 0].set_ylabel(r"half peak-to-peak of a gap [$\mu$m]")
    axes[1, 0].set_ylabel(r"rms of the sun [$\mu$m]")
    for ax in axes.ravel():
        ax.set_ylim(bottom=0)
    return figure


def report(results: Sequence[Case]) -> str:
    """Every case in a table, in Markdown."""
    lines = [
        "Jumps while the speed rises (+) or falls (-). rms of the sun: the largest of stable motions.",
        "",
        "| phasing | teeth | jumps at [Hz] | sun sideways [um] | sun turning [um] | points confirmed by integration |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for one in results:
        teeth = ", ".join(map(str, TEETH[one.name]))
        lines.append(
            f"| {one.name} | {teeth} | {', '.join(one.jumps)} | {one.largest('x_sun'):.3f} "
            f"| {one.largest('u_sun'):.3f} | {one.confirmed} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
