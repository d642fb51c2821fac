"""Readings of what the paper leaves open, each beside the claims of Figures 3 and 4 that it reproduces.

    python -m studies.dong_2022.readings [--quick] [-o DIR]

Every reading changes one choice of the default (1400 N m on each half, b_c = 25 um, e(tau) = -sum e_l sin(l tau)) or a
few. The last two are the reduction to one degree of freedom with the load F_m. The panels show the response curves.
W changes none of them; whether it acts through the start of a motion instead is the question of `from_rest`.
"""

from __future__ import annotations

from math import ceil, pi
from typing import Any

from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from studies import study
from studies.dong_2022 import base
from studies.dong_2022.claims import Case, case, motion, near

PAIR: dict[str, dict[str, Any]] = {
    "default": {},
    "T/2 on each half": {"torque": 700.0},
    r"b_c = 50 um": {"b_c": 50e-6},
    "T/2, b_c = 50 um": {"torque": 700.0, "b_c": 50e-6},
    "e with +": {"e_sign": 1},
    "e lags by pi/2": {"e_phase": pi / 2},
    "e with +, lags by pi/2": {"e_sign": 1, "e_phase": pi / 2},
    "halves staggered by pi/2": {"stagger": pi / 2},
    "halves staggered by pi": {"stagger": pi},
    "supports damped by zeta": {"support_damping": "zeta"},
    "no tilts": {"tilt": False},
    "helix angle of the base": {"mesh_helix": "base"},
    "line of centres along y": {"phi_deg": 90.0},
}
"""Changes of `DoubleHelicalPair`, by name."""
REDUCED = {"one DOF, F_m = 0.109": 0.109, "one DOF, F_m = 0.218": 0.218}
"""Loads of the reduction d'' + 2 zeta d' + k f(d) = F_m + sum (l Omega)^2 e_l sin(l tau)."""
CLAIMS = ("jump near 0.89", "single-sided at 1", "no impact at 1/2", "no impact at 1/3", "peaks near 1/2 and 1/3",
          "never double-sided")  # fmt: skip


def model(name: str) -> hb.Model:
    """The machine of a reading."""
    if name in PAIR:
        return hb.DoubleHelicalPair(**PAIR[name])
    pair = hb.DoubleHelicalPair()
    return hb.SpurPair(zeta=pair.zeta, F_m=REDUCED[name], eps=pair.eps, e=pair.e, phase="sin")


def held(numbers: Case, regimes: dict[str, str]) -> tuple[bool, ...]:
    """Which of `CLAIMS` hold, given the numbers of the curve and the regimes at Omega = 1, 1/2, 1/3."""
    peaks = numbers.superharmonics
    return (
        near(numbers.jumps, 0.89, 0.01),
        regimes["1"] == "single_sided",
        regimes["1/2"] == "no_impact",
        regimes["1/3"] == "no_impact",
        near(peaks, 0.5, 0.06) and near(peaks, 1 / 3, 0.04),
        "double_sided" not in numbers.regimes,
    )


def run(quick: bool = False) -> dict[str, Any]:
    """Curve, its numbers and which claims hold, for each reading; the quick form has two of them."""
    names = ["default", "one DOF, F_m = 0.109"] if quick else [*PAIR, *REDUCED]
    out = {}
    for name in names:
        span = (1.05, 0.3) if quick else base.SPAN
        curve = hb.trace(hb.HarmonicBalance(model(name), 8 if quick else 16), "Omega", span)
        numbers = case(curve)
        frequencies = {"1": 1.0, "1/2": 0.5, "1/3": 1 / 3}
        motions = {key: motion(base.at(curve, Omega)) for key, Omega in frequencies.items()}
        regimes = {key: found["regime"] for key, found in motions.items()}
        stable = motions["1/3"]["stable"]
        out[name] = {"curve": curve, "case": numbers, "held": held(numbers, regimes), "stable at 1/3": stable}
    return out


def _title(name: str) -> str:
    """A name with its symbols set as mathematics."""
    for plain, math in (("b_c", "$b_c$"), ("F_m", "$F_m$"), ("um", r"$\mu$m"), ("pi", r"$\pi$"), ("T/2", "$T/2$")):
        name = name.replace(plain, math)
    return name


def plot(results: dict[str, Any]) -> Figure:
    """One panel for each reading, coloured by regime."""
    rows = ceil(len(results) / 3)
    figure, axes = plt.subplots(rows, 3, figsize=(8.0, 1.75 * rows + 0.5), layout="constrained", sharex=True,
                                squeeze=False)  # fmt: skip
    for ax, (name, found) in zip(axes.flat, results.items(), strict=False):
        draw.response(found["curve"], ax=ax, special=False, legend=False)
        ax.set_title(_title(name))
        ax.set(xlabel="", ylabel="")
        ax.set_ylim(bottom=0)
    for ax in axes.flat[len(results) :]:
        ax.axis("off")
    handles = [plt.Line2D([], [], color=draw.COLOURS[r], label=r.replace("_sided", "-sided").replace("_", " "))
               for r in ("no_impact", "single_sided", "double_sided")]  # fmt: skip
    handles.append(plt.Line2D([], [], color="#555555", ls="--", label="unstable"))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    figure.supxlabel(r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]", fontsize=10)
    figure.supylabel(r"half peak-to-peak of the gap $d/b_c$ [-]", fontsize=10)
    return figure


def report(results: dict[str, Any]) -> str:
    """Readings against claims; the steepest rise is the largest |dA/dOmega|."""
    head = ["reading", *CLAIMS, "held", "stable at 1/3", "peak", "steepest rise at", "jumps"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for name, found in results.items():
        numbers, marks = found["case"], found["held"]
        jumps = ", ".join(f"{x:.5f}" for x in numbers.jumps) or "none"
        cells = [name, *("yes" if x else "no" for x in marks), f"{sum(marks)} of {len(CLAIMS)}"]
        cells += ["yes" if found["stable at 1/3"] else "no"]
        cells += [f"{numbers.peak:.4f} at {numbers.peak_at:.4f}", f"{numbers.slope_at:.4f}", jumps]
        lines.append("| " + " | ".join(cells) + " |")
    note = (
        "Regimes are those of the motion of one period, stable or not. W is no row: it shifts the mean gap of a curve "
        "and nothing else, but from rest it can decide which of two stable motions is reached (see `from_rest`)."
    )
    return "\n".join([*lines, "", note, ""])


if __name__ == "__main__":
    study.main()
