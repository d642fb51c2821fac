"""Responses of the spur pair for three ratios of alternating to mean load, and of the same ratio under a higher load.

    python -m studies.kahraman_singh_1990.ratios [--quick] [-o DIR]

F_ah / F_m = 0.5, 1 and 2 with F_m = 0.1, and 2 with F_m = 0.3. Drawn are the motions of the period of the excitation,
coloured by impact, and those of longer periods, coloured by period: the ones that leave by period doubling, and
branches of three and seven periods that touch no other; a motion that a sweep met was the way to those. Triangles are
slow sweeps by time integration. Every motion on which a sweep settled lies on a branch; where it did not settle the
largest Lyapunov exponent is positive: chaos. Dotted lines are the frequencies at which the teeth first lose contact,
from the linear pair,

    (1 - r^2)^2 + (2 zeta r)^2 = (F_ah / F_m)^2 r^4.

As long as the teeth do not make contact at their backs, (x - b) / F_m depends on the ratio alone, and so do the folds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import hbgear as hb
from hbgear import plot as draw
from hbgear.common.arrays import Array
from hbgear.continuation.results.status import Status
from hbgear.mechanics.series import measures
from hbgear.time.frequency_sweep import Sweep
from hbgear.time.steady_state import SteadyStateSettings
from studies import study
from studies.dong_2022.family import stretches
from studies.kahraman_singh_1990 import longer

ZETA = 0.05
LOADS = ((0.5, 0.1), (1.0, 0.1), (2.0, 0.1), (2.0, 0.3))
"""F_ah / F_m and F_m of each panel."""
SPAN = (2.4, 0.3)
LABEL = r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]"
LONGEST = 12
"""Periods of the excitation of the longest motions that are traced."""
PERIODS = {2: "#111111", 3: study.GREEN, 4: "#7b4fa3", 6: "#7fb069", 7: "#8a4100", 12: "#c2a500"}
"""Colours of motions of longer periods."""
NAMES = {2: "two", 3: "three", 4: "four", 6: "six", 7: "seven", 12: "twelve"}


@dataclass(frozen=True)
class Case:
    """One panel: the load, the curve, the branches of longer periods, sweeps up and down."""

    ratio: float
    F_m: float
    curve: hb.Branch
    longer: tuple[hb.Branch, ...]
    sweeps: tuple[Sweep, ...]

    @property
    def name(self) -> str:
        """Ratio and load as cells of a table."""
        return f"{self.ratio:g} | {self.F_m:g}"

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

    @property
    def branches(self) -> tuple[hb.Branch, ...]:
        """The curve and all of longer periods, the shortest period first."""
        return (self.curve, *sorted(self.longer, key=longer.order))


def contact_loss(ratio: float, zeta: float = ZETA) -> Array:
    """Frequencies r > 0 with (1 - r^2)^2 + (2 zeta r)^2 = ratio^2 r^4, ascending."""
    u = np.roots([1 - ratio**2, 4 * zeta**2 - 2, 1.0])
    return np.sort(np.sqrt(u[(np.abs(u.imag) < 1e-12) & (u.real > 0)].real))


def run(quick: bool = False) -> list[Case]:
    """The cases; the quick form has fewer harmonics, the first and the third case, two periods at most, no sweeps."""
    loads = (LOADS[0], LOADS[2]) if quick else LOADS
    return [case(ratio, F_m, 12 if quick else 24, 0 if quick else 29) for ratio, F_m in loads]


def case(ratio: float, F_m: float, harmonics: int, values: int) -> Case:
    """One case; ``values`` is the number of frequencies of each sweep, 0 for none."""
    pair = hb.SpurPair(zeta=ZETA, F_m=F_m, e=(ratio * F_m,))
    curve = hb.trace(hb.HarmonicBalance(pair, harmonics), "Omega", SPAN)
    known = longer.family(curve, SPAN, 4 if values else 2)
    grid = np.linspace(*SPAN, values)
    settling = SteadyStateSettings(1e-5, longest=4000)
    sweeps = [hb.time.sweep(pair, grid, way, settling=settling) for way in ("up", "down")] if values else []
    found = longer.isolated(pair, known, sweeps, SPAN, LONGEST)
    return Case(ratio, F_m, curve, (*known[1:], *found), tuple(sweeps))


def plot(results: Sequence[Case]) -> Figure:
    """A panel for each case, wide ones for those with chaos."""
    figure = plt.figure(figsize=(8.2, 9.6 if len(results) == 4 else 3.6), layout="constrained")
    axes = figure.subplot_mosaic([["a", "b"], ["c", "c"], ["d", "d"]] if len(results) == 4 else [["a", "b"]])
    for (letter, ax), found in zip(axes.items(), results, strict=True):
        _panel(ax, found)
        ax.set_title(rf"({letter}) $F_{{ah}}/F_m = {found.ratio:g}$, $F_m = {found.F_m:g}$", loc="left")
    figure.legend(handles=_handles(results), loc="outside lower center", ncols=5, columnspacing=1.6)
    return figure


def _panel(ax: Axes, found: Case) -> None:
    for branch in reversed(found.branches):
        nu = longer.order(branch)
        look = {} if nu == 1 else {"color": PERIODS[nu]}
        draw.response(branch, "rms", ax=ax, special=nu == 1, jumps=nu < 3, legend=False, **look)
        if nu == 2:
            _falls(ax, branch, found.curve)
    if found.sweeps:
        dots = [replace(s, jumps=()) for s in found.sweeps]  # their bands are as wide as the steps; arrows say more
        draw.sweeps(dots, measure="rms", ax=ax, legend=False)
    for r in found.closed:
        ax.axvline(r, color=draw.GREY, lw=0.8, ls=":", zorder=0)
    ax.set(xlabel=LABEL, ylabel="alternating rms of $x$ [-]", xlim=SPAN[::-1])
    ax.set_ylim(bottom=0)


def _falls(ax: Axes, branch: hb.Branch, curve: hb.Branch) -> None:
    """Arrows of jumps that leave a branch of two periods for the only stable motion of the curve."""
    for jump in branch.jumps():
        below = longer.motions_at(curve, jump.value)
        if jump.after is None and len(below) == 1:
            ends = [(jump.value, float(A)) for A in (measures.rms(below[0]), jump.before.amplitude("rms"))]
            style = {"arrowstyle": "-|>", "color": "#777777", "lw": 0.8, "shrinkA": 3, "shrinkB": 0}
            ax.annotate("", *ends, arrowprops=style, zorder=3)


def _handles(results: Sequence[Case]) -> list[Line2D]:
    """One entry for each colour, line and symbol in the figure."""
    seen = {name for found in results for name in found.curve.regimes}
    out = [
        Line2D([], [], color=c, lw=1.4, label=name.replace("_sided", "-sided").replace("_", " "))
        for name, c in draw.COLOURS.items()
        if name in seen
    ]
    periods = {longer.order(branch) for found in results for branch in found.longer}
    out += [Line2D([], [], color=PERIODS[nu], lw=1.4, label=f"{NAMES[nu]} periods") for nu in sorted(periods)]
    out.append(Line2D([], [], color="#555555", ls="--", lw=1.2, label="unstable"))
    for kind in ("LP", "PD", "GR"):
        marker, name = draw.MARKERS[kind]
        out.append(Line2D([], [], ls="none", marker=marker, ms=4.5, mfc="white", mec="black", label=name))
    out.append(Line2D([], [], color=draw.GREY, lw=0.8, ls=":", label="contact lost, closed form"))
    if any(found.sweeps for found in results):
        for marker, color, name in draw.DIRECTIONS.values():
            out.append(Line2D([], [], ls="none", marker=marker, ms=3.6, color=color, label=name))
        out.append(Line2D([], [], ls="none", marker="^", ms=3.6, mfc="white", color="#555555", label="longer period"))
        out.append(Line2D([], [], ls="none", marker="+", ms=3.6, color="#555555", label="chaotic"))
    return out


def report(results: Sequence[Case]) -> str:
    """Frequencies of contact loss, folds and period doublings; branches of longer periods; sweeps. In Markdown."""
    lines = [
        "| F_ah/F_m | F_m | contact lost, closed form | contact lost, curve | folds | period doubling |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for found in results:
        loss = [", ".join(f"{r:.6f}" for r in values) for values in (found.closed, found.traced)]
        cells = [found.name, *loss, frequencies(found.curve, "LP"), frequencies(found.curve, "PD")]
        lines.append("| " + " | ".join(cells) + " |")
    lines += [
        "",
        "Motions of longer periods:",
        "",
        "| F_ah/F_m | F_m | periods | branch | stable in Omega | folds | period doubling |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for found in results:
        for branch in found.branches[1:]:
            where = ", ".join(f"{low:.5f}-{high:.5f}" for low, high in stable(branch)) or "nowhere"
            span = f"{branch.values.min():.5f}-{branch.values.max():.5f}"
            how = f"closed, {span}" if branch.status == Status.CLOSED else f"doubled, {span}"
            cells = [found.name, f"{longer.order(branch)}", how, where]
            cells += [frequencies(branch, "LP"), frequencies(branch, "PD")]
            lines.append("| " + " | ".join(cells) + " |")
    if any(found.sweeps for found in results):
        lines += ["", *_sweeps(results)]
    return "\n".join([*lines, ""])


def frequencies(branch: hb.Branch, kind: str) -> str:
    """Omega of all special points of a kind."""
    return ", ".join(f"{p.parameters['Omega']:.6f}" for p in branch.special if p.kind == kind) or "none"


def stable(branch: hb.Branch) -> list[tuple[float, float]]:
    """Ranges of Omega in which a branch is stable; those that touch are one."""
    assert branch.stable is not None
    ranges = sorted(stretches(branch, branch.stable))
    breaks = [i for i, (a, b) in enumerate(pairwise(ranges), 1) if abs(b[0] - a[1]) > 1e-4]
    parts = [ranges[i:j] for i, j in pairwise([0, *breaks, len(ranges)])] if ranges else []
    return [(part[0][0], max(high for _, high in part)) for part in parts]


def _sweeps(results: Sequence[Case]) -> list[str]:
    """What the sweeps settled on, and the Lyapunov exponents where they did not."""
    lines = [
        "| F_ah/F_m | F_m | sweep | settled | of these on a branch | not settled at Omega | Lyapunov exponents |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for found in results:
        for s in found.sweeps:
            rows = np.flatnonzero(s.settled)
            on = sum(longer.lies_on(found.branches, s, int(i)) for i in rows)
            wild = ", ".join(f"{x:.4g}" for x in np.sort(s.values[~s.settled])) or "none"
            grown = s.lyapunov[~s.settled]
            cells = [found.name, "up" if s.direction > 0 else "down", f"{len(rows)} of {len(s)}"]
            cells += [f"{on}", wild, f"{grown.min():.4f} to {grown.max():.4f}" if len(grown) else "none"]
            lines.append("| " + " | ".join(cells) + " |")
    return lines


if __name__ == "__main__":
    study.main()
