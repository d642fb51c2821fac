"""Basins of the two motions of the spur pair at Omega = 0.65: permanent contact or impacts, depending on the start.

    python -m studies.kahraman_singh_1990.basins [--quick] [-o DIR]

F_ah = 0.1 = F_m, between the two jumps of the response. Every start (displacement and rate at tau = 0) is integrated
until it settles. The cross is the third, unstable motion of the response curve, from harmonic balance: it lies on the
border of the basins. Dotted lines are the corners x = b and x = -b of the backlash.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import hbgear as hb
from hbgear import plot as draw
from hbgear.common.arrays import Array
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.series.fourier import evaluate
from hbgear.time.basins_of_attraction import Basins
from studies import study

PAIR = hb.SpurPair(e=(0.1,))
OMEGA = 0.65


@dataclass(frozen=True)
class Results:
    """Basins, and the motions of the response curve at the same frequency.

    points (k, 2) their displacement and rate at tau = 0; rms (k,); stable (k,).
    """

    found: Basins
    points: Array
    rms: Array
    stable: Array


def run(quick: bool = False) -> Results:
    """Basins and motions; the quick form has few starts."""
    shape = (12, 10) if quick else (260, 220)
    found = hb.time.basins(PAIR, OMEGA, (-2.0, 3.0), (-1.5, 1.5), shape)
    return Results(found, *motions(24 if quick else 48))


def motions(harmonics: int) -> tuple[Array, Array, Array]:
    """Points, rms and stability of every motion the response curve has at this frequency, the smallest first."""
    problem = hb.HarmonicBalance(PAIR, harmonics)
    curve = hb.trace(problem, "Omega", (1.0, 0.4), stability=False)
    here = {**problem.parameters, "Omega": OMEGA}
    X = [solve(problem, place.interpolate(curve.X), here).X for place in crossings_at(curve, OMEGA)]
    points = [(float(evaluate(row, 0.0)[0]), OMEGA * float(evaluate(row, 0.0, 1)[0])) for row in X]
    rms = [np.sqrt(0.5 * np.sum(row[1:] ** 2)) for row in X]
    stable = [bool(np.abs(problem.multipliers(row, **here)).max() < 1) for row in X]
    order = np.argsort(rms)
    return np.array(points)[order], np.array(rms)[order], np.array(stable)[order]


def plot(results: Results) -> Figure:
    """The basins with attractors, the unstable motion and the corners."""
    figure, ax = plt.subplots(figsize=(5.2, 4.4), layout="constrained")
    for corner in (-PAIR.b, PAIR.b):
        name = r"corners $x = \pm b$" if corner > 0 else "_"
        ax.axvline(corner, color="#444444", lw=0.8, ls=":", zorder=2, label=name)
    ax.plot(
        *results.points[~results.stable].T,
        "X",
        ms=7,
        color="black",
        mec="white",
        mew=0.6,
        zorder=6,
        label="unstable motion",
    )
    draw.basins(results.found, ax)
    ax.set_title(rf"$F_{{ah}}/F_m = {PAIR.e[0] / PAIR.F_m:g}$, $F_m = {PAIR.F_m:g}$, $\Omega = {OMEGA}$", loc="left")
    ax.set(title="", xlabel=r"$x$ at $\tau = 0$ [-]", ylabel=r"$x'$ at $\tau = 0$ [-]")
    return figure


def report(results: Results) -> str:
    """Return a table of the attractors from time integration and the motions of the curve, in Markdown."""
    lines = ["| motion | rms, integrated | rms, harmonic balance | share of the starts |", "| --- | --- | --- | --- |"]
    attractors = sorted(results.found.attractors, key=lambda a: a.rms)
    stable = iter(attractors)
    for i, (rms, ok) in enumerate(zip(results.rms, results.stable, strict=True), 1):
        other = next(stable) if ok else None
        seen, share = (f"{other.rms:.5f}", f"{other.share:.1%}") if other else ("unstable", "none")
        lines.append(f"| {i} | {seen} | {rms:.5f} | {share} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
