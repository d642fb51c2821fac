"""Motions reached from rest at several backlashes W: whether the start explains the W of the paper's Figure 5.

    python -m studies.dong_2022.from_rest [--quick] [-o DIR]

While no tooth touches on its back, W changes no periodic motion apart from its mean. It does change how far apart the
teeth are at rest in the middle of the gap, and so, where two motions are stable, which of them is reached. The machines
have two folds: the reduction to one degree of freedom (F_m = 0.109) and the pair with zeta = 0.05. Above, dots are
settled motions from rest (all coordinates zero) on the response curve; below, the motion reached for each W.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.dong_2022 import base, readings

TITLES = {"one": r"one DOF, $F_m = 0.109$", "pair": r"24 DOF, $\zeta = 0.05$"}
PLANS = {"one": (0.8575, 0.8925, 11), "pair": (0.842, 0.872, 13)}
"""Lowest and highest Omega and how many between, around the two folds of each machine."""
PERIODS = {"one": 100, "pair": 300}
"""Periods of the excitation after which a motion is taken as settled; the slowest mode of the pair decays slowly."""


def machine(name: str, W: float) -> hb.Model:
    """The machine of that name with this change of backlash.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    if name not in TITLES:
        raise ValueError(f"no machine '{name}'; there are {', '.join(TITLES)}")
    if name == "pair":
        return hb.DoubleHelicalPair(zeta=0.05, W=W)
    return readings.model("one DOF, F_m = 0.109").replace(b=1 + W)


def reached(name: str, W: float, frequencies: np.ndarray) -> np.ndarray:
    """Half peak-to-peak of the motion reached from rest (q = q' = 0) at each Omega; nan if it is not of period one."""
    model = machine(name, W)
    rest = np.zeros((len(frequencies), 2 * model.system().n))
    settled = hb.integrate(model, rest, PERIODS[name], frequencies, method="exponential", samples=32).end
    last = hb.integrate(model, settled, 2, frequencies, method="exponential", samples=512).d[:, 0]
    first, second = np.split(last, 2, axis=1)
    same = np.abs(second - first).max(axis=1) < 1e-3
    return np.where(same, np.ptp(second, axis=1) / 2, np.nan)


def run(quick: bool = False) -> dict[str, Any]:
    """Curves at W = 0 and motions from rest; the quick form has one machine, two W and two frequencies."""
    W = base.W[2:4] if quick else base.W
    out: dict[str, Any] = {"W": W, "parts": {}}
    for name in ["one"] if quick else TITLES:
        low, high, count = PLANS[name]
        frequencies = np.array([0.875, 0.9]) if quick else np.linspace(low, high, count)
        curve = hb.trace(hb.HarmonicBalance(machine(name, 0.0), 16), "Omega", (high + 0.02, low - 0.02))
        motions = {w: reached(name, w, frequencies) for w in W}
        out["parts"][name] = {"Omega": frequencies, "curve": curve, "motions": motions}
    return out


def spread(part: dict[str, Any]) -> np.ndarray:
    """Largest difference of the amplitudes reached with different W, at each Omega."""
    A = np.array(list(part["motions"].values()))
    return np.asarray(np.ptp(A, axis=0))


def upper(part: dict[str, Any]) -> np.ndarray:
    """(W, Omega) 1 if the larger of two stable motions was reached, 0 if the smaller, nan where only one is stable.

    The unstable motion between the folds tells them apart.
    """
    curve = part["curve"]
    x, A = curve.values[~curve.stable], curve.amplitude("pp2")[~curve.stable]
    order = np.argsort(x)
    between = np.interp(part["Omega"], x[order], A[order], left=np.nan, right=np.nan)
    reached = np.array(list(part["motions"].values()))
    return np.where(np.isnan(between) | np.isnan(reached), np.nan, reached > between)


def plot(results: dict[str, Any]) -> Figure:
    """Motions from rest as dots on the curves; below, which of the motions each W leads to."""
    parts = results["parts"]
    figure, axes = plt.subplots(2, len(parts), figsize=(3.8 * len(parts), 4.4), layout="constrained", squeeze=False,
                                sharex="col", height_ratios=(1.0, 0.55))  # fmt: skip
    for (above, below), (name, part) in zip(axes.T, parts.items(), strict=True):
        draw.response(part["curve"], ax=above, color=study.GREY, special=False, jumps=False, legend=False)
        above.set(title=TITLES[name], xlabel="", ylabel="")
        _motions(above, below, part, results["W"])
        below.set_xlabel(r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]")
    axes[0, 0].set_ylabel("half peak-to-peak\nof the gap $d/b_c$ [-]")
    axes[1, 0].set_ylabel("backlash change\n$W$ [-]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles[-3:], labels[-3:], loc="outside upper center", ncols=3)
    return figure


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
        above.plot(Omega[which], A[which], ms=4.5, label=text, zorder=3, **look)
        below.plot(Omega[which], row[which], ms=5, **look)
    for fold in part["curve"].special:
        if fold.kind == "LP":
            for ax in (above, below):
                ax.axvline(fold.parameters["Omega"], color="#8a8a8a", lw=0.6, ls=":", zorder=0)
    below.set_yticks(W)
    below.set_ylim(min(W) - 0.2, max(W) + 0.2)
    below.tick_params(which="both", direction="in", top=True, right=True)
    below.minorticks_off()


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
