"""Basins of attraction of two stable motions: near the main resonance at zeta = 0.05, and near Omega = 1/3.

    python -m studies.dong_2022.basins [--quick] [-o DIR]

Each cell is a start, integrated until it has settled. (a) zeta = 0.05 at Omega = 0.867, between the folds: both halves
of the pinion are turned so that the gaps start with d and the rate d', all else starts at rest at zero. Dots are the
starts from rest at each backlash W of `from_rest`: while no tooth makes contact at its back, rest in the middle of a
gap b_c (1 + W) is the start d = -W. (b) Base case at Omega = 0.325: the motion of the mesh period (square) is disturbed
at tau = 0 by moving the floating pinion along its shaft, by z and at the rate z': one gap opens and the other closes.
Where the disturbance is large enough the motion doubles its period.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.mechanics.series.fourier import evaluate
from hbgear.plot import BASINS
from hbgear.time.integration import state_of
from studies import study
from studies.dong_2022 import base

ROTATIONS = (5, 17)
"""Coordinates of the rotation of the left and right half of the pinion."""
AXIAL = (2, 14)
"""Coordinates of their position along the shaft."""
LOW = hb.gears.DoubleHelicalPair(zeta=0.05)
FOLDED, THIRD = 0.867, 0.325
"""Omega of the two maps."""
NAMES = {"folds": ("the smaller motion", "the larger motion"), "third": ("mesh period", "twice the period")}


@dataclass(frozen=True)
class Map:
    """Which motion each start leads to.

    x (X,), y (Y,) starts; large (Y, X) whether the larger or doubled motion was reached; left : largest change of a
    motion over its last period.
    """

    x: Array
    y: Array
    large: Array
    left: float


def turned(pair: hb.gears.DoubleHelicalPair, gap: Array, rate: Array) -> Array:
    """States (B, 48) in which both gaps start with these values and rates (B,): the pinion turned, all else at zero."""
    system = pair.system()
    out = np.zeros((len(gap), 2 * system.n))
    for j, i in enumerate(ROTATIONS):
        out[:, i], out[:, system.n + i] = gap / system.W[i, j], rate / system.W[i, j]
    return out


def shifted(pair: hb.gears.DoubleHelicalPair, z: Array, rate: Array) -> Array:
    """Changes of the state (B, 48) that move the whole pinion by z (B,) along its shaft, at these rates (B,)."""
    n = pair.system().n
    out = np.zeros((len(z), 2 * n))
    for i in AXIAL:
        out[:, i], out[:, n + i] = z, rate
    return out


def rest() -> float:
    """Rate d' of a gap at rest (q' = 0) at tau = 0, which is that of the error: -e'."""
    error = LOW.system().elements[0].displacement.row()
    return float(-FOLDED * evaluate(error, 0.0, 1)[0])


def settled(pair: hb.gears.DoubleHelicalPair, Omega: float, states: Array, periods: int) -> tuple[Array, Array, Array]:
    """Half peak-to-peak of the left gap over two periods, how far these differ, and how far they differ from the next.

    Evaluated after the given number of periods.
    """
    end = hb.time.integrate(pair, states, periods, Omega, method="exponential", samples=32).end
    last = hb.time.integrate(pair, end, 4, Omega, method="exponential", samples=128).d[:, 0]
    one, two, three, four = np.split(last, 4, axis=1)
    apart = np.maximum(np.abs(three - one), np.abs(four - two)).max(axis=1)
    return np.ptp(last, axis=1) / 2, np.abs(two - one).max(axis=1), apart


def between_folds(shape: tuple[int, int], periods: int) -> Map:
    """Starts with the same gap and rate in both halves; the unstable motion separates the two stable ones."""
    x, y = np.linspace(-1.0, 3.0, shape[0]), np.linspace(-1.5, 1.5, shape[1])
    d, rate = (grid.ravel() for grid in np.meshgrid(x, y))
    A, _, left = settled(LOW, FOLDED, turned(LOW, d, rate - rest()), periods)
    curve = base.curve(span=(0.89, 0.83), zeta=LOW.zeta)
    lost = ~np.asarray(curve.stable)
    order = np.argsort(curve.values[lost])
    border = np.interp(FOLDED, curve.values[lost][order], curve.amplitude("pp2")[lost][order])
    return Map(x, y, (border < A).reshape(shape[::-1]), float(left.max()))


def near_third(shape: tuple[int, int], periods: int) -> Map:
    """Starts near the motion of the mesh period, with the pinion moved along its shaft."""
    x, y = np.linspace(-4.0, 4.0, shape[0]), np.linspace(-0.8, 0.8, shape[1])
    z, rate = (grid.ravel() for grid in np.meshgrid(x, y))
    pair = hb.gears.DoubleHelicalPair()
    point = base.at(base.curve(span=(0.34, 0.31)), THIRD)
    own = state_of(hb.HarmonicBalance(pair, 16), point.X, **point.parameters)
    _, doubled, left = settled(pair, THIRD, own + shifted(pair, z, rate), periods)
    return Map(x, y, (doubled > 0.1).reshape(shape[::-1]), float(left.max()))


def run(quick: bool = False) -> dict[str, Any]:
    """Both maps; the quick form has a few starts of the first."""
    if quick:
        return {"folds": between_folds((3, 2), 60)}
    return {"folds": between_folds((21, 15), 60), "third": near_third((21, 15), 150)}


def plot(results: dict[str, Any]) -> Figure:
    """One panel for each map."""
    figure, axes = plt.subplots(1, len(results), figsize=(4.1 * len(results), 4.2), layout="constrained", squeeze=False)
    for ax, (name, found) in zip(axes[0], results.items(), strict=True):
        _cells(ax, found, NAMES[name])
    first = axes[0, 0]
    for w in base.W:
        first.plot(-w, rest(), "o", ms=4, mfc="white", mec="black", mew=0.8)
        name = f"{w:g}".replace("-", "\N{MINUS SIGN}")
        first.annotate(name, (-w, rest()), (0, 5), textcoords="offset points", ha="center", fontsize=7)
    first.annotate("$W$ =", (-0.75, rest()), (-4, 5), textcoords="offset points", ha="right", fontsize=7)
    first.axvline(1.0, color="#444444", lw=0.8, ls=":")
    first.set(xlabel="gap $d/b_c$ of both halves at $\\tau = 0$ [-]", ylabel="its rate $\\dot d/(b_c \\omega_n)$ [-]")
    first.set_title(rf"(a) $\zeta$ = {LOW.zeta}, $\Omega$ = {FOLDED}", loc="left")
    if len(results) > 1:
        axes[0, 1].plot(0, 0, "s", ms=5, color=study.BLUE, mec="white", mew=0.6)
        axes[0, 1].set(xlabel="axial shift of the pinion $z/b_c$ [-]", ylabel="its rate $\\dot z/(b_c \\omega_n)$ [-]")
        axes[0, 1].set_title(rf"(b) base case, $\Omega$ = {THIRD}", loc="left")
    return figure


def _cells(ax: Axes, found: Map, names: tuple[str, str]) -> None:
    half_x, half_y = (0.5 * (axis[1] - axis[0]) for axis in (found.x, found.y))
    extent = (found.x[0] - half_x, found.x[-1] + half_x, found.y[0] - half_y, found.y[-1] + half_y)
    shades = ListedColormap(BASINS[:2])
    ax.imshow(
        found.large, origin="lower", extent=extent, aspect="auto", cmap=shades, vmin=0, vmax=1, interpolation="nearest"
    )
    share = float(np.mean(found.large))
    handles = [
        Patch(facecolor=shade, edgecolor="#777777", lw=0.5, label=f"{name}: {part:.0%} of starts")
        for shade, name, part in zip(BASINS, names, (1 - share, share), strict=False)
    ]
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=1)
    ax.tick_params(which="both", direction="in", top=True, right=True)


def report(results: dict[str, Any]) -> str:
    """Shares of the starts, and how well all had settled."""
    places = {"folds": f"zeta = {LOW.zeta}, Omega = {FOLDED}", "third": f"base case, Omega = {THIRD}"}
    lines = [
        "| machine | starts | motion | share | other motion | share | change over the last period, at most |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, found in results.items():
        share, (small, large) = float(np.mean(found.large)), NAMES[name]
        cells = [places[name], f"{found.large.size}", small, f"{1 - share:.1%}", large, f"{share:.1%}"]
        lines.append("| " + " | ".join([*cells, f"{found.left:.0e}"]) + " |")
    if "third" in results:
        x, row = results["third"].x, results["third"].large[len(results["third"].y) // 2].astype(bool)
        least = f"by about {np.abs(x[row]).min():.2g} b_c" if row.any() else f"by more than {x.max():g} b_c"
        lines += [
            "",
            f"At Omega = {THIRD} the pinion must be moved {least} along its shaft, without a rate, for the "
            "motion to double: a machine that starts evenly keeps the mesh period.",
        ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
