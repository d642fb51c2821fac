"""Responses of the spur pair for three ratios of alternating to mean load, and of the same ratio under a higher load.

    python -m studies.kahraman_singh_1990.ratios [--quick] [-o DIR]

F_ah / F_m = 0.5, 1 and 2 with F_m = 0.1, and 2 with F_m = 0.3. Drawn are the motions of the period of the excitation
and those of twice that period, which leave where the first lose their stability by period doubling. Triangles are slow
sweeps by time integration, which also find longer periods and chaos. Dotted lines are the frequencies at which the
teeth first part, from the linear pair,

    (1 - r^2)^2 + (2 zeta r)^2 = (F_ah / F_m)^2 r^4.

As long as the teeth do not meet on their backs, (x - b) / F_m depends on the ratio alone, and so do the folds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import hbgear as hb
from hbgear import plot as draw
from hbgear import plot_time
from hbgear.fourier import Array
from hbgear.sweep import Settling, Sweep
from studies import study

ZETA = 0.05
LOADS = ((0.5, 0.1), (1.0, 0.1), (2.0, 0.1), (2.0, 0.3))
"""F_ah / F_m and F_m of each panel."""
SPAN = (2.4, 0.3)
LABEL = r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]"


@dataclass(frozen=True)
class Case:
    """One panel: the load, the curve, the motions of twice its period, sweeps up and down."""

    ratio: float
    F_m: float
    curve: hb.Branch
    doubled: tuple[hb.Branch, ...]
    sweeps: tuple[Sweep, ...]

    @property
    def closed(self) -> Array:
        """Frequencies of contact loss by the closed form, ascending, within the span."""
        r = contact_loss(self.ratio)
        return r[(r > SPAN[1]) & (r < SPAN[0])]

    @property
    def traced(self) -> Array:
        """The same from the curve: grazing points at which a motion in contact meets x = b, ascending."""
        points = [p for p in self.curve.special if p.kind == "GR" and p.amplitude("rms") < 0.8 * self.F_m]
        return np.sort([p.parameters["Omega"] for p in points])


def contact_loss(ratio: float, zeta: float = ZETA) -> Array:
    """Frequencies r > 0 with (1 - r^2)^2 + (2 zeta r)^2 = ratio^2 r^4, ascending."""
    u = np.roots([1 - ratio**2, 4 * zeta**2 - 2, 1.0])
    return np.sort(np.sqrt(u[(np.abs(u.imag) < 1e-12) & (u.real > 0)].real))


def run(quick: bool = False) -> list[Case]:
    """The cases; the quick form has fewer harmonics, the first and the third case, and no sweeps."""
    loads = (LOADS[0], LOADS[2]) if quick else LOADS
    return [case(ratio, F_m, 12 if quick else 24, 0 if quick else 29) for ratio, F_m in loads]


def case(ratio: float, F_m: float, harmonics: int, values: int) -> Case:
    """One case; ``values`` is the number of frequencies of each sweep, 0 for none."""
    pair = hb.SpurPair(zeta=ZETA, F_m=F_m, e=(ratio * F_m,))
    curve = hb.trace(hb.HarmonicBalance(pair, harmonics), "Omega", SPAN)
    grid = np.linspace(*SPAN, values)
    settling = Settling(1e-5, longest=400)
    sweeps = [hb.sweep(pair, grid, way, settling=settling) for way in ("up", "down")] if values else []
    return Case(ratio, F_m, curve, doubled(curve), tuple(sweeps))


def doubled(curve: hb.Branch) -> tuple[hb.Branch, ...]:
    """The branches of twice the period that leave at period doublings, each once: they join the curve again."""
    found: list[hb.Branch] = []
    ends: list[float] = []
    for point in curve.special:
        Omega = point.parameters["Omega"]
        if point.kind == "PD" and not any(abs(Omega - end) < 1e-3 for end in ends):
            found.append(hb.switch(curve, point.label))
            ends.append(float(found[-1].values[-1]))
    return tuple(found)


def plot(results: Sequence[Case]) -> Figure:
    """A panel for each case."""
    rows = (len(results) + 1) // 2
    size = (8.2, 0.8 + 2.8 * rows)
    figure, axes = plt.subplots(rows, 2, figsize=size, layout="constrained", sharex=True, squeeze=False)
    for ax, letter, found in zip(axes.flat, "abcd", results, strict=False):
        _panel(ax, found)
        ax.set_title(rf"({letter}) $F_{{ah}}/F_m = {found.ratio:g}$, $F_m = {found.F_m:g}$", loc="left")
    for ax in axes[-1]:
        ax.set_xlabel(LABEL)
    figure.legend(handles=_handles(results), loc="outside lower center", ncols=4, columnspacing=1.6)
    return figure


def _panel(ax: Axes, found: Case) -> None:
    for branch in (*found.doubled, found.curve):
        draw.response(branch, "rms", ax=ax, special=branch is found.curve, legend=False)
    if found.sweeps:
        dots = [replace(s, jumps=()) for s in found.sweeps]  # their bands are as wide as the steps; arrows say more
        plot_time.sweeps(dots, measure="rms", ax=ax, legend=False)
    for r in found.closed:
        ax.axvline(r, color=draw.GREY, lw=0.8, ls=":", zorder=0)
    ax.set(xlabel="", ylabel="alternating rms of $x$ [-]", xlim=SPAN[::-1])
    ax.set_ylim(bottom=0)


def _handles(results: Sequence[Case]) -> list[Line2D]:
    """One entry for each colour, line and symbol in the figure."""
    seen = {name for found in results for branch in (found.curve, *found.doubled) for name in branch.regimes}
    out = [Line2D([], [], color=c, lw=1.4, label=name.replace("_sided", "-sided").replace("_", " "))
           for name, c in draw.COLOURS.items() if name in seen]  # fmt: skip
    out.append(Line2D([], [], color="#555555", ls="--", lw=1.2, label="unstable"))
    for kind in ("LP", "PD", "GR"):
        marker, name = draw.MARKERS[kind]
        out.append(Line2D([], [], ls="none", marker=marker, ms=4.5, mfc="white", mec="black", label=name))
    out.append(Line2D([], [], color=draw.GREY, lw=0.8, ls=":", label="contact lost, closed form"))
    if any(found.sweeps for found in results):
        for marker, color, name in plot_time.DIRECTIONS.values():
            out.append(Line2D([], [], ls="none", marker=marker, ms=3.6, color=color, label=name))
        out.append(Line2D([], [], ls="none", marker="^", ms=3.6, mfc="white", color="#555555", label="longer period"))
        out.append(Line2D([], [], ls="none", marker="+", ms=3.6, color="#555555", label="not periodic"))
    return out


def report(results: Sequence[Case]) -> str:
    """Frequencies of contact loss, folds and period doublings, in Markdown."""
    lines = ["| F_ah/F_m | F_m | contact lost, closed form | contact lost, curve | folds | period doubling |",
             "| --- | --- | --- | --- | --- | --- |"]  # fmt: skip
    for found in results:
        kinds = [
            ", ".join(f"{p.parameters['Omega']:.6f}" for p in found.curve.special if p.kind == kind)
            for kind in ("LP", "PD")
        ]
        loss = [", ".join(f"{r:.6f}" for r in values) for values in (found.closed, found.traced)]
        cells = [f"{found.ratio:g}", f"{found.F_m:g}", *loss, *(text or "none" for text in kinds)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
