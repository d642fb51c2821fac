"""Figure 4: the base case by curve and by slow sweeps: a steep rise at 0.89 without a fold, hysteresis near 1/3.

    python -m studies.dong_2022.fig04 [--quick] [-o DIR]

Between PD1 and PD2 the motion of one period is unstable and one of two periods takes its place. That one is stable
down to a fold below PD2, where both are stable: the sweep up meets it at PD2 and the sweep down follows it to the fold.
It leaves the curve vertically, since the equations are linear until the teeth lose contact.
Sweeps are time integrations with the state carried over, disturbed a little at every frequency.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import hbgear as hb
from hbgear import plot as draw
from hbgear.time.frequency_sweep import Sweep
from hbgear.time.integration import state_of
from hbgear.time.steady_state import SteadyStateSettings
from studies import study
from studies.dong_2022 import base
from studies.dong_2022.claims import case
from studies.dong_2022.family import AMPLITUDE, OMEGA, cells

_PARTS = ((0.2, 0.3, 0.025), (0.3, 0.36, 0.003), (0.36, 0.84, 0.03), (0.84, 1.0, 0.01), (1.0, 1.61, 0.05))
GRID = np.unique(np.round(np.concatenate([np.arange(*part) for part in _PARTS]), 6))
"""Frequencies of the long sweeps."""
STEEP = np.round(np.arange(0.876, 0.8961, 0.001), 6)
"""Frequencies of short sweeps over the steep rise: no step of them is a jump."""
RISE = (1.0, 0.84)
"""Omega of the steep rise, where the curve is traced with shorter steps."""
THIRD = (0.36, 0.3)
"""Omega of the period doubling."""


@lru_cache(maxsize=4)
def doubled(harmonics: int = 16) -> hb.Branch:
    """The motion of two periods that leaves the base curve at PD1."""
    return hb.switch(base.curve(harmonics, THIRD), "PD1")


def slow_sweep(curve: hb.Branch, grid: np.ndarray, direction: str, settling: SteadyStateSettings) -> Sweep:
    """Sweep that starts on the curve."""
    first = grid.min() if direction == "up" else grid.max()
    point = base.at(curve, float(first))
    start = state_of(curve.problem, point.X, **point.parameters)
    return hb.time.sweep(hb.gears.DoubleHelicalPair(), grid, direction, start=start, settling=settling)


def run(quick: bool = False) -> dict[str, Any]:
    """Curve, doubled branch and sweeps; the quick form has one sweep of two frequencies down the doubled branch."""
    H = 8 if quick else 16
    curve = base.curve(H, (1.0, 0.3) if quick else base.SPAN)
    settling = SteadyStateSettings(tolerance=5e-5) if quick else SteadyStateSettings(tolerance=1e-6)
    grids, directions = ((np.array([0.335, 0.325]),), ("down",)) if quick else ((GRID, STEEP), ("up", "down"))
    start = doubled(H) if quick else curve
    sweeps = [slow_sweep(start, grid, direction, settling) for grid in grids for direction in directions]
    rise = curve if quick else base.curve(H, RISE)
    return {"curve": curve, "rise": rise, "doubled": doubled(H), "sweeps": sweeps}


def panel(ax: Axes, results: dict[str, Any], curve: hb.Branch, span: tuple[float, float], top: float) -> None:
    """A curve, the doubled branch and sweep dots in a range of Omega, up to an amplitude."""
    draw.sweeps(results["sweeps"], curve, ax=ax, legend=False, dimensionless=True)
    draw.response(results["doubled"], ax=ax, jumps=False, legend=False, dimensionless=True)
    ax.set(xlabel=OMEGA, ylabel=AMPLITUDE, xlim=span, ylim=(0, top))


def plot(results: dict[str, Any]) -> Figure:
    """The whole range above; the steep rise and the hysteresis below."""
    figure = plt.figure(figsize=(7.4, 6.4), layout="constrained")
    axes = figure.subplot_mosaic([["a", "a"], ["b", "c"]])
    curve = results["curve"]
    panel(axes["a"], results, curve, (curve.values.min(), curve.values.max()), 0.85)
    panel(axes["b"], results, results["rise"], (min(RISE), max(RISE)), 0.65)
    panel(axes["c"], results, curve, (min(THIRD), max(THIRD)), 0.85)
    for key, text in (("a", "whole range"), ("b", "steep rise"), ("c", "near 1/3")):
        axes[key].set_title(f"({key}) {text}", loc="left")
    _remarks(axes["b"], axes["c"], results["rise"])
    axes["b"].set_ylim(bottom=0.3)
    _legend(figure, axes["a"], results["doubled"])
    return figure


def _remarks(rise: Axes, third: Axes, curve: hb.Branch) -> None:
    """Slope of the steep rise; periods of the two motions near 1/3."""
    steep = case(curve)
    A = float(np.interp(steep.slope_at, curve.values[::-1], curve.amplitude("pp2")[::-1]))
    text = f"no fold; steepest slope {steep.slope:.0f}\n" + rf"at $\Omega$ = {steep.slope_at:.3f}"
    line: Any = {"arrowstyle": "-", "lw": 0.5, "shrinkB": 4}
    rise.annotate(text, (steep.slope_at, A), (0.896, 0.42), fontsize=8, arrowprops=line)
    third.text(0.3395, 0.57, "two periods", fontsize=8)
    third.text(0.346, 0.135, "one period", fontsize=8)


def _legend(figure: Figure, ax: Axes, doubled: hb.Branch) -> None:
    """What occurs on these axes, above the figure."""
    draw.response(doubled, ax=ax, special=False, jumps=False, legend=True, dimensionless=True)
    ax.set(xlabel=OMEGA, ylabel=AMPLITUDE)
    old: Any = ax.get_legend()
    entries = dict(zip((text.get_text() for text in old.get_texts()), old.legend_handles, strict=True))
    for _, color, name in draw.DIRECTIONS.values():
        if name in entries:
            entries[f"jump of {name}"] = Patch(color=color, alpha=0.12, lw=0)
    old.remove()
    figure.legend(list(entries.values()), list(entries), loc="outside upper center", ncols=4)


def hysteresis(results: dict[str, Any]) -> tuple[float, float]:
    """Omega between which the motions of one and of two periods are both stable: fold of the doubled one to PD2."""
    return results["doubled"]["LP1"].parameters["Omega"], results["curve"]["PD2"].parameters["Omega"]


def report(results: dict[str, Any]) -> str:
    """Numbers of the curve, of the doubled branch, and where the sweeps jumped."""
    curve, two = results["curve"], results["doubled"]
    low, high = hysteresis(results)
    tops = hb.analysis.peaks(curve, "pp2")
    peak, at, folds, jumps, _, impact, lost = cells(curve)
    rise = case(results["rise"])
    rows = {
        "peak amplitude": f"{peak} at {at}",
        "other peaks": ", ".join(f"{p.amplitude('pp2'):.4f} at {p.parameters['Omega']:.4f}" for p in tops[1:]),
        "folds; jumps": f"{folds}; {jumps}",
        "steepest slope dA/dOmega": f"{rise.slope:.0f} at {rise.slope_at:.3f}",
        "impact regime": impact,
        "unstable": f"{lost} (PD1, PD2)",
        "motion of two periods, stable": f"{low:.5f}-{curve['PD1'].parameters['Omega']:.5f}",
        "its largest amplitude": f"{two.amplitude('pp2')[two.stable].max():.4f}",
        "both stable": f"{low:.5f}-{high:.5f}",
    }
    for found in results["sweeps"]:
        name = f"sweep {'up' if found.direction > 0 else 'down'}, {len(found)} frequencies"
        low, high = found.values.min(), found.values.max()
        rows[f"{name} from {low:g} to {high:g}, jumps in"] = (
            ", ".join("{:.4f}-{:.4f}".format(*sorted(jump.interval)) for jump in found.jumps) or "none"
        )
        two_periods = found.values[found.period == 2]
        if len(two_periods):
            rows[f"{name}, two periods"] = f"{two_periods.min():.4f}-{two_periods.max():.4f}"
    lines = ["| base case | value |", "| --- | --- |", *(f"| {key} | {value} |" for key, value in rows.items()), ""]
    return "\n".join(lines)


if __name__ == "__main__":
    study.main()
