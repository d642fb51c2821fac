"""Motions reached from rest at several backlashes W: effect of the initial state in Figure 5 of the paper.

    python -m studies.dong_2022.from_rest [--quick] [-o DIR]

While no tooth makes contact at its back, W changes no periodic motion apart from its mean. It does change how far apart
the teeth are at rest in the middle of the gap, and so, where two motions are stable, which of them is reached. The
machines have two folds (dotted): the reduction to one degree of freedom (F_m = 0.109) and the pair with zeta = 0.05.
Above, dots are settled motions from rest (all coordinates zero) on the response curve; below, the motion reached for
each W.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.dong_2022 import base, readings
from studies.dong_2022.family import OMEGA
from studies.dong_2022.resting import reached

TITLES = {"one": r"one DOF, $F_m = 0.109$", "pair": r"24 DOF, $\zeta = 0.05$"}
PLANS = {
    "one": np.linspace(0.8575, 0.8925, 11),
    "pair": np.concatenate([np.linspace(0.842, 0.8645, 10), np.arange(0.8655, 0.8686, 0.0005), [0.8695, 0.872]]),
}
"""Omega around the two folds of each machine, finer where a start from rest may reach either motion."""
NEAR = (0.8635, 0.8705)
"""Omega of the enlarged panel of the pair."""
MARGIN = 0.02
"""By which the panels show more than these frequencies."""
PERIODS = {"one": 100, "pair": 200}
"""Periods of the excitation after which a motion is taken as settled."""


def machine(name: str, W: float) -> hb.mechanics.Model:
    """The machine of that name with this change of backlash.

    Raises
    ------
    ValueError
        If there is no machine of this name.
    """
    if name not in TITLES:
        raise ValueError(f"no machine '{name}'; there are {', '.join(TITLES)}")
    if name == "pair":
        return hb.gears.DoubleHelicalPair(zeta=0.05, W=W)
    return readings.model("one DOF, F_m = 0.109").replace(b=1 + W)


def run(quick: bool = False) -> dict[str, Any]:
    """Curves at W = 0 and motions from rest; the quick form has one machine, two W and two frequencies."""
    W = base.W[2:4] if quick else base.W
    out: dict[str, Any] = {"W": W, "parts": {}}
    for name in ["one"] if quick else TITLES:
        frequencies = np.array([0.875, 0.9]) if quick else PLANS[name]
        span = (1.5, frequencies[0] - MARGIN)  # from where teeth stay in contact
        problem = hb.HarmonicBalance(machine(name, 0.0), 16)
        steps = hb.StepControl() if quick else hb.StepControl(first_step=0.005, max_step=0.005)
        curve = hb.trace(problem, "Omega", span, steps=steps)
        motions = {w: reached(machine(name, w), frequencies, PERIODS[name]).amplitude for w in W}
        out["parts"][name] = {"Omega": frequencies, "curve": curve, "motions": motions}
    return out


def spread(part: dict[str, Any]) -> np.ndarray:
    """Largest difference of the amplitudes reached with different W, at each Omega."""
    A = np.array(list(part["motions"].values()))
    return np.asarray(np.ptp(A, axis=0))


def upper(part: dict[str, Any]) -> np.ndarray:
    """(W, Omega) 1 if the larger of two stable motions was reached, 0 if the smaller, nan where only one is stable.

    The unstable motion between the folds separates them.
    """
    curve = part["curve"]
    x, A = curve.values[~curve.stable], curve.amplitude("pp2")[~curve.stable]
    order = np.argsort(x)
    between = np.interp(part["Omega"], x[order], A[order], left=np.nan, right=np.nan)
    reached = np.array(list(part["motions"].values()))
    return np.where(np.isnan(between) | np.isnan(reached), np.nan, reached > between)


def plot(results: dict[str, Any]) -> Figure:
    """Motions from rest as dots on the curves; below, which of the motions each W leads to; the pair twice."""
    panels = [(part, TITLES[name], _span(part["Omega"])) for name, part in results["parts"].items()]
    if "pair" in results["parts"]:
        panels.append((results["parts"]["pair"], f"{TITLES['pair']}, enlarged", NEAR))
    figure, axes = plt.subplots(
        2,
        len(panels),
        figsize=(0.8 + 2.8 * len(panels), 4.4),
        layout="constrained",
        squeeze=False,
        sharex="col",
        height_ratios=(1.0, 0.55),
    )
    for (above, below), (part, title, span) in zip(axes.T, panels, strict=True):
        curve = part["curve"]
        options: Any = {"special": False, "jumps": False, "legend": False, "dimensionless": True}
        draw.response(curve, ax=above, color=study.GREY, **options)
        seen = curve.amplitude("pp2")[(span[0] <= curve.values) & (curve.values <= span[1])]
        room = 0.06 * np.ptp(seen)
        above.set(title=title, xlabel="", ylabel="", xlim=span, ylim=(seen.min() - room, seen.max() + room))
        _motions(above, below, part, results["W"])
        below.set_xlabel(OMEGA)
    axes[0, 0].set_ylabel("half peak-to-peak\nof the gap $d/b_c$ [-]")
    axes[1, 0].set_ylabel("backlash change\n$W$ [-]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    handles.append(plt.Line2D([], [], color="#8a8a8a", lw=0.8, ls=":", label="fold"))
    handles.append(plt.Line2D([], [], color=study.GREY, lw=1.2, ls="--", label="unstable"))
    figure.legend(handles[-5:], [*labels[-3:], "fold", "unstable"], loc="outside upper center", ncols=5)
    return figure


def _span(Omega: np.ndarray) -> tuple[float, float]:
    return float(Omega[0]) - MARGIN, float(Omega[-1]) + MARGIN


def _motions(above: Axes, below: Axes, part: dict[str, Any], W: tuple[float, ...]) -> None:
    """Marks of the motions: the larger of two, the smaller of two, the only one."""
    large = upper(part)
    Omega, row = np.broadcast_to(part["Omega"], large.shape), np.broadcast_to(np.array(W)[:, None], large.shape)
    A = np.array(list(part["motions"].values()))
    for which, color, face, text in (
        (large == 1, study.ORANGE, study.ORANGE, "from rest: the larger of two motions"),
        (large == 0, study.BLUE, "white", "the smaller of two"),
        (np.isnan(large), study.GREY, study.GREY, "the only one"),
    ):
        look: Any = {"ls": "", "marker": "o", "color": color, "mfc": face}
        above.plot(Omega[which], A[which], ms=4, label=text, zorder=3, **look)
        below.plot(Omega[which], row[which], ms=4, **look)
    for fold in part["curve"].special:
        if fold.kind == "LP":
            for ax in (above, below):
                ax.axvline(fold.parameters["Omega"], color="#8a8a8a", lw=0.6, ls=":", zorder=0)
    below.set_yticks(W)
    below.set_ylim(min(W) - 0.2, max(W) + 0.2)
    below.tick_params(which="both", direction="in", top=True, right=True)
    below.minorticks_off()


def report(results: dict[str, Any]) -> str:
    """Where different W lead to different motions, and which each reaches."""
    lines = ["| machine | Omega | frequencies at which W decides | largest difference |", "| --- | --- | --- | --- |"]
    for name, part in results["parts"].items():
        difference, Omega = spread(part), part["Omega"]
        where = ", ".join(f"{x:.4f}" for x in Omega[difference > 1e-3]) or "none"
        span = f"{Omega[0]:.4f} to {Omega[-1]:.4f}, {len(Omega)} values"
        lines.append(f"| {TITLES[name]} | {span} | {where} | {np.nanmax(difference):.2g} |")
    lines += [
        "",
        "Lowest Omega from which on the larger motion is reached from rest, or nothing else is stable:",
        "",
        "| machine | " + " | ".join(f"W = {w:g}" for w in results["W"]) + " |",
        "| --- |" + " --- |" * len(results["W"]),
    ]
    remarks: list[str] = []
    for name, part in results["parts"].items():
        starts = [_first(part["Omega"], row, part["curve"]) for row in upper(part)]
        lines.append(f"| {TITLES[name]} | " + " | ".join(f"{x:.4f}" for x in starts) + " |")
        if all(a < b for a, b in pairwise(starts)):
            lean = f"{TITLES[name]}: from rest the jump leans to the right as W grows, from {starts[0]:.4f} to "
            remarks += [
                "",
                f"{lean}{starts[-1]:.4f}, as the paper's Figure 5 says; it is the start that moves it, not "
                "the curve, and only where the curve has two folds.",
            ]
    return "\n".join([*lines, *remarks, ""])


def _first(Omega: np.ndarray, large: np.ndarray, curve: hb.Branch) -> float:
    """First frequency above all at which the smaller of two motions, or the only one below the folds, is met."""
    low = min(point.parameters["Omega"] for point in curve.special if point.kind == "LP")
    small = np.flatnonzero((large == 0) | (Omega < low))
    return float(Omega[small[-1] + 1 if small.size else 0])


if __name__ == "__main__":
    study.main()
