"""From one period to chaos: Poincare points of the spur pair in slow sweeps, over the curves of harmonic balance.

    python -m studies.kahraman_singh_1990.bifurcation [--quick] [-o DIR]

F_ah = 0.1 = F_m. Dots are x at tau = 0, once per period of the excitation, while Omega falls and while it rises. Lines
are the motions of one, two and four periods by harmonic balance, each from the period doubling of the one before: at
every tau = 0 mod 2 pi they pass through the dots where they are stable, and go on unstable (dashed) through the chaos.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import hbgear as hb
from hbgear import plot as draw
from hbgear.common.arrays import Array
from hbgear.mechanics.series.fourier import evaluate
from hbgear.time.frequency_sweep import Sweep
from hbgear.time.steady_state import SteadyStateSettings
from studies import study

PAIR = hb.SpurPair(e=(0.1,))
SPAN = (2.1, 0.95)
COLOURS = {1: study.BLUE, 2: study.ORANGE, 4: study.PURPLE}
"""Of the motions of one, two and four periods."""


@dataclass(frozen=True)
class Results:
    """Branches by their period in periods of the excitation, and the sweeps down and up."""

    branches: dict[int, hb.Branch]
    sweeps: tuple[Sweep, ...]


def run(quick: bool = False) -> Results:
    """Branches and sweeps; the quick form has one sweep of three values, a shorter span, no motions of four periods."""
    H, span = (10, (2.2, 1.2)) if quick else (24, (2.6, 0.4))
    one = hb.trace(hb.HarmonicBalance(PAIR, H), "Omega", span)
    branches = {1: one, 2: hb.switch(one, "PD1")}
    if not quick:
        branches[4] = hb.switch(branches[2], "PD1")
    grid = np.array((2.0, 1.9, 1.7)) if quick else np.linspace(*SPAN, 121)
    between = 0.5 * (grid[1:] + grid[:-1])  # the other way at other values: the dots lie closer
    settling = SteadyStateSettings(1e-6, longest=128 if quick else 1000)
    ways = (("down", grid),) if quick else (("down", grid), ("up", between))
    return Results(branches, tuple(hb.time.sweep(PAIR, x, way, settling=settling) for way, x in ways))


def strobed(branch: hb.Branch) -> Array:
    """x at tau = 0, 2 pi, ... of every row, (P, nu)."""
    assert branch.layout is not None
    nu = branch.layout.nu
    return np.array([evaluate(row, 2 * np.pi * np.arange(nu) / nu) for row in branch.layout.rows(branch.X, 0)])


def plot(results: Results) -> Figure:
    """Dots of the sweeps, lines of the branches."""
    figure, ax = plt.subplots(figsize=(7.4, 4.6), layout="constrained")
    draw.bifurcation(results.sweeps, ax=ax)
    for period, branch in results.branches.items():
        for column in strobed(branch).T:
            _line(ax, branch, column, COLOURS[period])
    names = {1: "one period", 2: "two periods", 4: "four periods"}
    handles = [
        Line2D([], [], color=COLOURS[k], lw=1.2, label=f"{names[k]}, harmonic balance") for k in results.branches
    ]
    handles.append(Line2D([], [], color="#555555", ls="--", lw=0.9, label="unstable"))
    for s in results.sweeps:
        color, name = draw.DIRECTIONS[s.direction][1:] if len(results.sweeps) > 1 else ("black", "sweep down")
        handles.append(Line2D([], [], ls="none", marker="o", ms=3, mew=0, color=color, label=name))
    ax.legend(handles=handles, loc="lower right")
    ax.set(xlabel=r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]", ylabel=r"$x$ at $\tau = 0$ [-]", xlim=SPAN[::-1])
    return figure


def _line(ax: Axes, branch: hb.Branch, height: Array, color: str) -> None:
    """One line, dashed where it is unstable."""
    stable = np.asarray(branch.stable)
    extended = ~stable | np.append(~stable[1:], False) | np.append(False, ~stable[:-1])  # up to the last stable row
    for part, style in ((extended, "--"), (stable, "-")):
        ax.plot(branch.values, np.where(part, height, np.nan), style, color=color, lw=0.9, zorder=4)


def report(results: Results) -> str:
    """Period doublings and folds of each branch; which values of a sweep did not settle. In Markdown."""
    lines = ["| motion | period doublings | folds |", "| --- | --- | --- |"]
    for period, branch in results.branches.items():
        kinds = [
            ", ".join(f"{p.parameters['Omega']:.6f}" for p in branch.special if p.kind == kind) for kind in ("PD", "LP")
        ]
        lines.append(f"| period {period} | {kinds[0] or 'none'} | {kinds[1] or 'none'} |")
    lines += ["", "| sweep | chaotic, or not settled near a doubling | jumps between |", "| --- | --- | --- |"]
    for s in results.sweeps:
        wild = s.values[~s.settled]
        where = f"{len(wild)} of {len(s)} values from {wild.min():.4f} to {wild.max():.4f}" if len(wild) else "none"
        jumps = "; ".join(f"{a:.4f} and {b:.4f}" for a, b in (sorted(j.interval) for j in s.jumps)) or "none"
        lines.append(f"| {'up' if s.direction > 0 else 'down'} | {where} | {jumps} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
