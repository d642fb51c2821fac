"""Motions reached from rest at several backlashes W: whether the start explains the W of the paper's Figure 5.

    python -m studies.dong_2022.from_rest [--quick] [-o DIR]

While no tooth touches on its back, W changes no periodic motion apart from its mean. It does change how far apart the
teeth are at rest in the middle of the gap, and so, where two motions are stable, which of them is reached. The machine
is the reduction to one degree of freedom (F_m = 0.109), which has two folds. Dots are settled motions from rest at each
Omega, the line is the response curve.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.dong_2022 import base, readings

TITLES = {"one": r"one DOF, $F_m = 0.109$"}
COLOURS = (study.PURPLE, study.ORANGE, "#333333", study.BLUE, study.GREEN)
MARKERS = "v<o>^"


def machine(name: str, W: float) -> hb.Model:
    """The machine of that name with this change of backlash.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    if name not in TITLES:
        raise ValueError(f"no machine '{name}'; there are {', '.join(TITLES)}")
    return readings.model("one DOF, F_m = 0.109").replace(b=1 + W)


def reached(model: hb.Model, frequencies: np.ndarray) -> np.ndarray:
    """Half peak-to-peak of the motion reached from rest (q = q' = 0) at each Omega; nan if it is not of period one."""
    out = np.full(len(frequencies), np.nan)
    for i, Omega in enumerate(frequencies):
        found = hb.sweep(model, [Omega])
        if found.period[0] == 1:
            out[i] = found.pp2[0, 0]
    return out


def run(quick: bool = False) -> dict[str, Any]:
    """Curves at W = 0 and motions from rest; the quick form has two W and one frequency."""
    plans = {"one": (0.8575, 0.8925, 11)}
    W = base.W[::4] if quick else base.W
    out: dict[str, Any] = {"W": W, "parts": {}}
    for name, (low, high, count) in plans.items():
        frequencies = np.array([0.9]) if quick else np.linspace(low, high, count)
        problem = hb.HarmonicBalance(machine(name, 0.0), 16)
        curve = hb.trace(problem, "Omega", (high + 0.02, low - 0.02))
        motions = {w: reached(machine(name, w), frequencies) for w in W}
        out["parts"][name] = {"Omega": frequencies, "curve": curve, "motions": motions}
    return out


def spread(part: dict[str, Any]) -> np.ndarray:
    """Largest difference of the amplitudes reached with different W, at each Omega."""
    A = np.array(list(part["motions"].values()))
    return np.asarray(np.ptp(A, axis=0))


def plot(results: dict[str, Any]) -> Figure:
    """Motions from rest as dots on the curves."""
    parts = results["parts"]
    figure, axes = plt.subplots(1, len(parts), figsize=(4.6 * len(parts), 3.4), layout="constrained", squeeze=False)
    for ax, (name, part) in zip(axes[0], parts.items(), strict=True):
        draw.response(part["curve"], ax=ax, color=study.GREY, special=False, jumps=False, legend=False)
        for W, color, marker in zip(results["W"], COLOURS, MARKERS, strict=False):
            ax.plot(part["Omega"], part["motions"][W], marker, ms=4, mfc="none", color=color, label=f"$W = {W:g}$")
        ax.set_title(TITLES[name])
        ax.set_xlabel(r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]")
        ax.set_ylabel("")
    axes[0, 0].set_ylabel("half peak-to-peak of the gap $d/b_c$ [-]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    kept = [(h, t) for h, t in zip(handles, labels, strict=True) if t.startswith("$W")]
    figure.legend(*zip(*kept, strict=True), loc="outside upper center", ncols=3)
    return figure


def report(results: dict[str, Any]) -> str:
    """Where different W lead to different motions."""
    lines = ["| machine | Omega | frequencies at which W decides | largest difference |", "| --- | --- | --- | --- |"]
    for name, part in results["parts"].items():
        difference, Omega = spread(part), part["Omega"]
        where = ", ".join(f"{x:.4f}" for x in Omega[difference > 1e-3]) or "none"
        span = f"{Omega[0]:.3f} to {Omega[-1]:.3f}, {len(Omega)} values"
        lines.append(f"| {TITLES[name]} | {span} | {where} | {np.nanmax(difference):.2g} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
