"""Spectra of the gap motion with the lines measured on the test rig: common parts of Figures 14 to 16.

The rig turns at speeds n whose mesh frequency is f = teeth_p n / 60, so a line at f_k is of mesh order f_k / f. Only
the frequencies of measured lines are known, not their heights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import hbgear as hb
from hbgear.common.arrays import Array
from studies import study
from studies.dong_2022 import base

FLOOR = 1e-4
"""Amplitude in b_c below which no line is drawn (2.5 nm)."""
LAST = 8
"""Highest mesh order drawn."""


@dataclass(frozen=True)
class Rig:
    """A test of the paper: speed of the pinion [r/min], the lines it reports [Hz], whether with sidebands."""

    speed: float
    lines: tuple[float, ...]
    sidebands: bool = False

    @property
    def mesh(self) -> float:
        """Mesh frequency [Hz]."""
        return hb.gears.DoubleHelicalPair().teeth_p * self.speed / 60

    @property
    def orders(self) -> tuple[float, ...]:
        """The lines in multiples of the mesh frequency."""
        return tuple(line / self.mesh for line in self.lines)


RIG = (Rig(400.0, (166.7, 333.4, 506.7)), Rig(600.0, (250.0, 500.0, 750.0)), Rig(1200.0, (480.0,), True))
"""The tests of Figures 14, 15 and 16, which the paper pairs with Omega = 1/3, 1/2 and 1."""


def lines(point: hb.Point, element: int = 0) -> tuple[Array, Array]:
    """Mesh orders and amplitudes in b_c of the lines of a motion, the mean left out."""
    row, layout = point.coefficients(element), point.layout
    assert layout is not None
    return np.arange(1, layout.harmonics + 1) / layout.nu, np.hypot(row[1::2], row[2::2])


def plot(motions: Sequence[tuple[str, hb.Point]], rig: Rig) -> Figure:
    """One panel for each motion (title, point), and below them the measured lines on the same axis."""
    count = len(motions)
    figure, axes = plt.subplots(
        count + 1,
        1,
        figsize=(6.4, 1.5 + 1.9 * count),
        sharex=True,
        layout="constrained",
        height_ratios=[*[1.0] * count, 0.3],
    )
    for ax, (title, point) in zip(axes, motions, strict=False):
        _stems(ax, point)
        ax.set_title(title, loc="left")
    hertz = axes[0].secondary_xaxis("top", functions=(lambda order: order * rig.mesh, lambda f: f / rig.mesh))
    hertz.set_xlabel(f"frequency at {rig.speed:g} r/min of the test rig [Hz]")
    hertz.tick_params(direction="in")
    _strip(axes[-1], rig)
    axes[-1].set_xlim(0, LAST + 0.5)
    axes[-1].set_xlabel(r"mesh order $f / f_\mathrm{mesh}$ [-]")
    return figure


def _stems(ax: Axes, point: hb.Point) -> None:
    order, height = lines(point)
    shown = (height >= FLOOR) & (order <= LAST)
    for whole, color, name in ((True, study.BLUE, "mesh orders"), (False, study.ORANGE, "half orders")):
        some = shown & ((order % 1 == 0) == whole)
        if not some.any():
            continue
        ax.vlines(order[some], FLOOR, height[some], color=color, lw=1.4)
        ax.plot(order[some], height[some], "o", color=color, ms=3.5, label=name)
    ax.set_yscale("log")
    ax.set_ylim(FLOOR, 1.0)
    ax.set_ylabel(r"amplitude of $d_L / b_c$ [-]")
    ax.tick_params(which="both", direction="in", right=True)
    if point.layout is not None and point.layout.nu > 1:
        ax.legend(loc="upper right")


def _strip(ax: Axes, rig: Rig) -> None:
    for order, line in zip(rig.orders, rig.lines, strict=True):
        ax.axvline(order, color=study.PURPLE, lw=1.6)
        text = f"{line:.1f} Hz" + (", with sidebands" if rig.sidebands else "")
        ax.annotate(text, (order, 0.5), (4, 0), textcoords="offset points", va="center", fontsize=8)
    ax.set_yticks([])
    ax.set_ylim(0, 1)
    ax.set_ylabel("measured", rotation=0, ha="right", va="center")
    ax.tick_params(direction="in", top=True)


def table(motions: Sequence[tuple[str, hb.Point]]) -> list[str]:
    """Amplitudes of the lines above 0.001 b_c of each motion as Markdown; in um too."""
    b_c = hb.gears.DoubleHelicalPair().b_c
    out = ["| motion | mesh order | amplitude in b_c | in um |", "| --- | --- | --- | --- |"]
    for name, point in motions:
        for order, height in zip(*lines(point), strict=True):
            if height >= 1e-3:
                out.append(f"| {name} | {order:g} | {height:.4f} | {1e6 * b_c * height:.3f} |")
    return out


def speeds(Omega: float, rig: Rig) -> str:
    """What the paper's pairing of this Omega with a speed means in the units of the model, as a sentence."""
    pair = hb.gears.DoubleHelicalPair()
    return (
        f"With Tables 1 and 2 of the paper Omega = {Omega:.4g} is a mesh frequency of {pair.mesh_frequency(Omega):.0f} "
        f"Hz, or {pair.pinion_speed(Omega):.0f} r/min of the pinion; the test ran at {rig.speed:g} r/min, "
        f"{rig.mesh:.1f} Hz, which is Omega = {pair.from_pinion_speed(rig.speed):.4f}. The pairing is off by a factor "
        f"{pair.pinion_speed(Omega) / rig.speed:.2f}, so measured lines can only be compared by their orders."
    )


def page(motions: dict[str, hb.Point], text: Sequence[str], Omega: float, rig: Rig) -> str:
    """The table of the motions, the paragraphs, and what the paper's pairing with a speed means, in Markdown."""
    return "\n\n".join(["\n".join(table(list(motions.items()))), *text, speeds(Omega, rig)]) + "\n"


def base_motion(Omega: float) -> hb.Point:
    """The motion of the base case at Omega."""
    return base.at(base.curve(), Omega)


def heading(point: hb.Point) -> str:
    """Stability and impact regime of a motion in words."""
    regime = point.regime_name.replace("_sided", "-sided impact").replace("_", " ")
    return f"{'stable' if point.stable else 'unstable'}, {regime}"
