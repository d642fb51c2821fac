"""Response of the gear-rotor-bearing model with clearance in mesh and bearings, checked by time integration.

    python -m studies.kahraman_singh_1991.rotor_bearing [--quick] [-o DIR]

Bearings under a light preload lose contact near both resonances, which are those of the mesh against the shafts. Above
the mesh gap, below the pinion's bearing, each coloured by its own impacts. The grey line is the same machine with
bearings that have no clearance: the two coincide where both bearings stay loaded. Circles are points of the curve that
agree with time integration in amplitude, harmonics, multipliers and growth of a disturbance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import hbgear as hb
from hbgear import plot as draw
from hbgear.time.validation.report import Report
from studies import study

MODEL = hb.gears.GearRotorBearing(mu_2=0.15, F_1=0.02, F_2=0.02, b_1=0.1, b_2=0.1)
SPAN = (1.9, 0.4)
ELEMENTS = {"gap": "mesh gap $p/b_c$", "bearing 1": "pinion $y_1/b_c$"}


@dataclass(frozen=True)
class Results:
    """The curve, that of linear bearings, and the points compared with time integration."""

    curve: hb.Branch
    linear: hb.Branch
    report: Report


def run(quick: bool = False) -> Results:
    """Trace and check; the quick form has the upper resonance alone, fewer harmonics and two points."""
    span, harmonics, points = ((1.9, 1.1), 16, 2) if quick else (SPAN, 32, 16)

    def traced(model: hb.mechanics.Model, stability: bool) -> hb.Branch:
        steps = hb.StepControl(max_step=0.04 if quick else 0.012)  # the minimum between the resonances is sharp
        return hb.trace(hb.HarmonicBalance(model, harmonics), "Omega", span, steps=steps, stability=stability)

    curve = traced(MODEL, True)
    return Results(curve, traced(MODEL.replace(b_1=0.0, b_2=0.0), False), hb.validate(curve, points, tolerance=1e-3))


def plot(results: Results) -> Figure:
    """Mesh gap above, bearing of the pinion below."""
    figure, axes = plt.subplots(2, 1, figsize=(6.4, 6.2), layout="constrained", sharex=True)
    curve, rows = results.curve, [row.index for row in results.report.rows]
    good = np.array([row.ok for row in results.report.rows])
    for ax, (element, name) in zip(axes, ELEMENTS.items(), strict=True):
        rms = curve.amplitude("rms", element)[rows]
        ax.plot(results.linear.values, results.linear.amplitude("rms", element), color=draw.GREY, lw=0.9)
        draw.response(curve, "rms", element, ax, legend=False)
        ax.plot(curve.values[rows][good], rms[good], "o", ms=3.6, color=study.GREEN, mec="white", mew=0.4, zorder=6)
        ax.set(xlabel="", ylabel=f"alternating rms of {name} [-]", xlim=(curve.values.min(), curve.values.max()))
        ax.set_ylim(bottom=0)
    axes[-1].set_xlabel(r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]")
    figure.legend(handles=_handles(curve), loc="outside lower center", ncols=3, columnspacing=1.6)
    return figure


def _handles(curve: hb.Branch) -> list[Line2D]:
    """One entry for each colour, line and symbol in the figure."""
    out = [
        Line2D([], [], color=draw.COLOURS[name], lw=1.4, label=name.replace("_sided", "-sided").replace("_", " "))
        for name in draw.COLOURS
        if name in curve.regimes
    ]
    out.append(Line2D([], [], color="#555555", ls="--", lw=1.2, label="unstable"))
    kinds = {point.kind for point in curve.special}
    for kind, (marker, name) in draw.MARKERS.items():
        if kind in kinds:
            out.append(Line2D([], [], ls="none", marker=marker, ms=4.5, mfc="white", mec="black", label=name))
    out.append(Line2D([], [], color=draw.GREY, lw=0.9, label="bearings without clearance"))
    out.append(Line2D([], [], ls="none", marker="o", ms=3.6, color=study.GREEN, label="agrees with integration"))
    return out


def report(results: Results) -> str:
    """The points compared with time integration, in Markdown."""
    headers, rows = results.report.table()
    lines = ["| " + " | ".join(headers) + " |", "|" + " --- |" * len(headers)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]).replace("|mu|", "largest mu")


if __name__ == "__main__":
    study.main()
