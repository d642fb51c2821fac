"""The equations as printed: what each of their errors alone does to the response curve and to stability.

    python -m studies.dong_2022.printed_errors [--quick] [-o DIR]

Each panel has one error of `as_printed` switched on in the consistent equations (grey). Stable motions are solid,
unstable ones dashed. The table adds the errors that symmetric motions do not feel, by the largest real part among the
eigenvalues of opposite motions of the halves, linear with the mean mesh closed; positive means unstable. Several errors
of (25) and (27) contradict each other if only one is there, and are unstable then; all together need not be.
"""

from __future__ import annotations

from typing import Any

from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.dong_2022 import as_printed, base

ALL = ("z_sign", "same_hand", "no_tilts", "leading_one", "eps_in_error", *as_printed.TWISTS)
"""Everything together, for (29) read as the forcing; theta_unscaled is without object once there are no tilts."""
PANELS = {
    "z_sign": r"sign of the $z$ terms",
    "same_hand": "helices of one hand",
    "no_tilts": "no states for the tilts",
    "leading_one": "leading 1 in (29)",
    "eps_in_error": r"$\varepsilon_l$ in (29)",
    "all": "all together",
}


def cases(quick: bool) -> dict[str, tuple[str, ...]]:
    """Which errors are switched on, by name of the case."""
    alone = {name: (name,) for name in as_printed.ERRORS + as_printed.TWISTS}
    if quick:
        alone = {name: alone[name] for name in ("z_sign", "no_tilts", "mesh_r1")}
    return {"none": (), **alone, "all": ALL}


def run(quick: bool = False) -> dict[str, Any]:
    """Response curve and growth of opposite motions of each case; errors of gamma alone have the curve of none."""
    curves: dict[str, hb.Branch] = {}
    growth = {}
    for name, errors in cases(quick).items():
        growth[name] = float(as_printed.antisymmetric(errors).real.max())
        if name not in as_printed.TWISTS:
            problem = hb.HarmonicBalance(as_printed.symmetric(errors), 6 if quick else 16)
            curves[name] = hb.trace(problem, "Omega", (1.05, 0.85) if quick else base.SPAN)
    return {"curves": curves, "growth": growth}


def plot(results: dict[str, Any]) -> Figure:
    """Small multiples: the consistent curve and the one with an error."""
    figure, axes = plt.subplots(2, 3, figsize=(8.0, 4.6), layout="constrained", sharex=True)
    curves = results["curves"]
    for ax, (name, title) in zip(axes.flat, PANELS.items(), strict=True):
        options: Any = {"ax": ax, "special": False, "legend": False}
        draw.response(curves["none"], color=study.GREY, label="consistent", **options)
        if name in curves:
            draw.response(curves[name], color=study.BLUE, label="with the error", **options)
        ax.set_title(title)
        ax.set(xlabel="", ylabel="")
        ax.set_ylim(bottom=0)
    handles = [plt.Line2D([], [], color=c, label=t) for c, t in
               ((study.GREY, "consistent"), (study.BLUE, "with the error"))]  # fmt: skip
    axes[0, 0].legend(handles=handles, loc="upper left")
    figure.supxlabel(r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]", fontsize=10)
    figure.supylabel(r"half peak-to-peak of the gap $d/b_c$ [-]", fontsize=10)
    return figure


def report(results: dict[str, Any]) -> str:
    """Effect of each error on peak, jumps, regimes and stability."""
    head = ["error", "peak", "at Omega", "jumps", "regimes", "unstable rows", "growth of opposite motions"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for name, growth in results["growth"].items():
        cells = [name, *_curve_cells(results["curves"].get(name)), f"{growth:.4f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


def _curve_cells(curve: hb.Branch | None) -> list[str]:
    if curve is None:
        return ["as none", "", "", "", ""]
    top = curve.peak("pp2")
    jumps = ", ".join(f"{jump.value:.4f}" for jump in curve.jumps()) or "none"
    stable = curve.stable
    assert stable is not None
    regimes = ", ".join(sorted(set(curve.regimes)))
    return [f"{top.amplitude('pp2'):.4f}", f"{top.parameters['Omega']:.4f}", jumps, regimes, f"{(~stable).sum()}"]


if __name__ == "__main__":
    study.main()
