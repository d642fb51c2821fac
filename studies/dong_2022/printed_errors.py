"""The equations as printed: what each of their errors alone does to the response curve and to stability.

    python -m studies.dong_2022.printed_errors [--quick] [-o DIR]

Each panel has one error of `as_printed` switched on in the consistent equations (grey). Stable motions are solid,
unstable ones dashed. The table adds the errors that symmetric motions do not feel, by the largest real part among the
eigenvalues of opposite motions of the halves, linear with the mean mesh closed; positive means unstable. Several errors
of (25) and (27) contradict each other if only one is there, and are unstable then; all together they are stable or
not depending on how the undefined terms of (27) are read.
The mean gap is that at the peak; where it is negative the teeth rest on their backs.
"""

from __future__ import annotations

from math import cos
from typing import Any

from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.dong_2022 import as_printed, base

EVERY = ("z_sign", "same_hand", "no_tilts", "leading_one", "eps_in_error", "shaft_r2", "mesh_r1")
"""Everything with one reading, for (29) read as the forcing; theta_unscaled is without object without tilts."""
ALL = {f"all, {name}": (*EVERY, name) for name in ("undefined", "undefined_half", "undefined_zero")}
"""Everything together for each reading of the undefined Delta_pL and Delta_pR."""
PANELS = {
    "z_sign": r"sign of the $z$ terms",
    "same_hand": "helices of one hand",
    "no_tilts": "no states for the tilts",
    "leading_one": "leading 1 in (29)",
    "eps_in_error": r"$\varepsilon_l$ in (29)",
    "all, undefined": "all together",
}


def cases(quick: bool) -> dict[str, tuple[str, ...]]:
    """Which errors are switched on, by name of the case."""
    alone = {name: (name,) for name in as_printed.ERRORS + as_printed.TWISTS}
    if quick:
        alone = {name: alone[name] for name in ("no_tilts", "mesh_r1")}
    return {"none": (), **alone, **ALL}


def run(quick: bool = False) -> dict[str, Any]:
    """Response curve and growth of opposite motions of each case; errors of gamma do not change the curve."""
    curves: dict[frozenset[str], hb.Branch] = {}
    found = {}
    for name, errors in cases(quick).items():
        felt = frozenset(errors) - set(as_printed.TWISTS)
        if felt not in curves:
            problem = hb.HarmonicBalance(as_printed.symmetric(felt), 6 if quick else 16)
            curves[felt] = hb.trace(problem, "Omega", (1.05, 0.85) if quick else base.SPAN)
        found[name] = (curves[felt], float(as_printed.antisymmetric(errors).real.max()))
    return {
        "curves": {name: curve for name, (curve, _) in found.items()},
        "growth": {name: growth for name, (_, growth) in found.items()},
    }


def plot(results: dict[str, Any]) -> Figure:
    """Small multiples: the consistent curve and the one with an error."""
    figure, axes = plt.subplots(2, 3, figsize=(8.0, 4.6), layout="constrained", sharex=True)
    curves = results["curves"]
    for ax, (name, title) in zip(axes.flat, PANELS.items(), strict=True):
        options: Any = {"ax": ax, "special": False, "legend": False, "dimensionless": True}
        draw.response(curves["none"], color=study.GREY, label="consistent", **options)
        if name in curves:
            draw.response(curves[name], color=study.BLUE, label="with the error", **options)
        ax.set_title(title)
        ax.set(xlabel="", ylabel="")
        ax.set_ylim(bottom=0)
    handles = [
        plt.Line2D([], [], color=c, label=t) for c, t in ((study.GREY, "consistent"), (study.BLUE, "with the error"))
    ]
    axes[0, 0].legend(handles=handles, loc="upper left")
    figure.supxlabel(r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]", fontsize=10)
    figure.supylabel(r"half peak-to-peak of the gap $d/b_c$ [-]", y=0.53, fontsize=10)
    return figure


def report(results: dict[str, Any]) -> str:
    """Effect of each error on peak, jumps, regimes and stability, and what the two that are not drawn would do."""
    head = ["error", "peak", "at Omega", "mean gap", "jumps", "regimes", "unstable rows", "growth of opposite motions"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for name, growth in results["growth"].items():
        cells = [name, *_curve_cells(results["curves"][name]), f"{growth:.4f}"]
        lines.append("| " + " | ".join(cells) + " |")
    unstable = [name for name in ALL if results["growth"][name] > 1e-6]
    note = (
        f"All together, opposite motions are unstable for {len(unstable)} of the {len(ALL)} readings of Delta_pL and "
        f"Delta_pR{': ' if unstable else ''}{'; '.join(unstable)}. With k divided by m_c omega_n^2 once more, "
        f"as (25) and (28) print it, the mesh would close by {closure() / 1000:.1f} km under the load."
    )
    if "leading_minus_one" in results["curves"]:
        mean = _top(results["curves"]["leading_minus_one"]).coefficients()[0]
        note += f" With leading_minus_one the teeth rest on their backs (mean gap {mean:.3f} b_c)."
    return "\n".join([*lines, "", note, ""])


def closure() -> float:
    """Static closure of the mesh [m] if the scaled stiffness were divided by m_c omega_n^2 = k_mean again."""
    pair = hb.gears.DoubleHelicalPair()
    return pair.torque / (pair.r_p * cos(pair.beta_mesh))  # T / (r_p c_b) is the force; the stiffness is 1 N/m


def _top(curve: hb.Branch) -> hb.Point:
    """The highest peak of a curve."""
    return max(hb.analysis.peaks(curve, "pp2"), key=lambda point: point.amplitude("pp2"))


def _curve_cells(curve: hb.Branch) -> list[str]:
    top = _top(curve)
    jumps = ", ".join(f"{jump.value:.4f}" for jump in curve.jumps()) or "none"
    stable = curve.stable
    assert stable is not None
    regimes = ", ".join(sorted(set(curve.regimes)))
    mean = top.coefficients()[0]
    numbers = [f"{top.amplitude('pp2'):.4f}", f"{top.parameters['Omega']:.4f}", f"{mean:.3f}"]
    return [*numbers, jumps, regimes, f"{(~stable).sum()}"]


if __name__ == "__main__":
    study.main()
