"""Figure 3: phase diagrams and time histories of the gap at Omega = 1, 1/2 and 1/3.

    python -m studies.dong_2022.fig03 [--quick] [-o DIR]

At Omega = 1/3 the motion of one period is unstable; what is seen in its place takes two periods and separates the
teeth. Stable motions are solid, unstable ones dashed, with a dot once per period of the excitation. The teeth are apart
where d < b_c, shaded; their backs would touch at d = -b_c.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import hbgear as hb
from hbgear.plot import COLOURS, LINES
from studies import study
from studies.dong_2022 import base
from studies.dong_2022.fig04 import doubled

FREQUENCIES = {"1": 1.0, "1/2": 0.5, "1/3": 1 / 3}
CORNER = 1.0
"""Gap d / b_c at which the teeth lose contact (W = 0)."""
RANGE = (0.7, 2.3)
"""Gap d / b_c shown in every panel."""


def run(quick: bool = False) -> dict[str, list[hb.Point]]:
    """Motions at each frequency, stable ones last; the quick form has fewer harmonics."""
    H = 8 if quick else 16
    found = {name: [base.at(base.curve(H, (Omega + 0.02, Omega - 0.02)), Omega)] for name, Omega in FREQUENCIES.items()}
    found["1/3"].append(base.at(doubled(H), 1 / 3))
    return found


def history(point: hb.Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time in periods of the excitation, gap and velocity over the two periods of the longest motion shown."""
    assert point.layout is not None
    nu = point.layout.nu
    theta, d = point.samples()
    v = point.samples(order=1)[1] * point.parameters["Omega"] / nu
    turns = 2 // nu
    time = (theta / (2 * np.pi) + np.arange(turns)[:, None]).ravel() * nu
    return np.append(time, 2.0), np.append(np.tile(d, turns), d[0]), np.append(np.tile(v, turns), v[0])


def words(point: hb.Point) -> str:
    """Period, stability and regime of a motion."""
    assert point.layout is not None
    period = {1: "one period", 2: "two periods"}[point.layout.nu]
    regime = point.regime_name.replace("_sided", "-sided").replace("_", " ")
    return f"{period}, {'stable' if point.stable else 'unstable'}, {regime}"


def draw_motions(phase: Axes, time: Axes, points: list[hb.Point]) -> None:
    """Motions of one frequency: velocity over gap above, gap over time below."""
    for point in points:
        assert point.layout is not None
        t, d, v = history(point)
        style, width = LINES[point.stable]
        look: Any = {"color": COLOURS[point.regime_name], "ls": style, "lw": width}
        once = t <= point.layout.nu
        phase.plot(d[once], v[once], **look)
        time.plot(t, d, **look)
        starts = np.searchsorted(t, [0.0, 1.0])
        phase.plot(d[starts], v[starts], "o", ms=3.5, color=look["color"])
        time.plot(t[starts], d[starts], "o", ms=3.5, color=look["color"], clip_on=False)
    time.set_xlim(0, 2)


def corner(phase: Axes, time: Axes) -> None:
    """The corner of the backlash, and the side on which the teeth are apart shaded."""
    phase.set_xlim(RANGE)
    time.set_ylim(RANGE)
    for shade, line in ((phase.axvspan, phase.axvline), (time.axhspan, time.axhline)):
        shade(RANGE[0], CORNER, color="#eeeeee", lw=0, zorder=0)
        line(CORNER, color="#8a8a8a", lw=0.7, zorder=0, gid="corner")
    for ax in (phase, time):
        ax.tick_params(direction="in", top=True, right=True, width=0.6, length=3.5)


def plot(results: dict[str, list[hb.Point]]) -> Figure:
    """Phase diagrams above, time histories below."""
    figure, axes = plt.subplots(2, len(results), figsize=(7.4, 4.9), layout="constrained")
    for (phase, time), (name, points) in zip(axes.T, results.items(), strict=True):
        draw_motions(phase, time, points)
        corner(phase, time)
        phase.set_title(rf"$\Omega = {name}$")
        phase.set_xlabel("gap $d/b_c$ [-]")
        time.set_xlabel("periods of the excitation [-]")
        for i, point in enumerate(points):
            time.text(
                0.97,
                0.97 - 0.08 * i,
                words(point),
                color=COLOURS[point.regime_name],
                fontsize=8,
                ha="right",
                va="top",
                transform=time.transAxes,
            )
    axes[1, 0].text(0.03, 0.1, "teeth apart", fontsize=8, transform=axes[1, 0].transAxes)
    axes[0, 0].set_ylabel(r"velocity $\dot d/(b_c \omega_n)$ [-]")
    axes[1, 0].set_ylabel("gap $d/b_c$ [-]")
    return figure


def report(results: dict[str, list[hb.Point]]) -> str:
    """Least and largest gap, amplitude, stability and regime of each motion."""
    head = ["Omega", "motion", "least d/b_c", "largest d/b_c", "amplitude", "largest multiplier"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for name, points in results.items():
        for point in points:
            d = point.samples(count=8192)[1]
            assert point.multipliers is not None
            numbers = (d.min(), d.max(), point.amplitude("pp2"), np.abs(point.multipliers).max())
            lines.append("| " + " | ".join([name, words(point), *(f"{x:.4f}" for x in numbers)]) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
