"""Smallest change of the double-helical pair that removes its jumps, and a map of all changes.

    python -m studies.design.least_change [--quick] [-o DIR]

At zeta = 0.05 the pair jumps. Its damping and the factors of all stiffness and error amplitudes may change. For
each pair of factors the damping at which the two folds meet (`hbgear.analysis.critical_parameter`, H = 8) makes a point
of the surface beyond which there is no jump. `hbgear.design.redesign` should find the nearest point of this surface in
a few steps.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import hbgear as hb
from hbgear.common.arrays import Array
from studies import study

ALONE = True

BASE = hb.gears.DoubleHelicalPair(zeta=0.05)
OVER = ("zeta", "eps_scale", "e_scale")
SPAN = (1.1, 0.7)


@dataclass(frozen=True)
class Results:
    """Factors of the map (n,) and (m,), the critical damping (n, m) and the design found, with the seconds of both."""

    eps: Array
    e: Array
    zeta: Array
    found: hb.design.Redesign
    seconds: tuple[float, float]

    @property
    def distance(self) -> Array:
        """(n, m) root of the sum of squares of the relative changes; no change of the damping where none is needed."""
        more = np.maximum(self.zeta / BASE.zeta - 1.0, 0.0)
        out: Array = np.sqrt((self.eps[:, None] - 1) ** 2 + (self.e - 1) ** 2 + more**2)
        return out


def run(quick: bool = False) -> Results:
    """7 x 7 factors with H = 8; ``quick``: 2 x 2 with H = 3."""
    harmonics, count = (3, 2) if quick else (8, 7)
    eps, e = np.linspace(0.82, 1.0, count), np.linspace(0.94, 1.0, count)
    begin = time.process_time()
    found = hb.design.redesign(BASE, hb.design.no_jumps(), OVER, harmonics=harmonics, span=SPAN)
    middle = time.process_time()
    zeta = np.full((count, count), np.nan)
    for i, a in enumerate(eps):
        for j, b in enumerate(e):
            problem = hb.HarmonicBalance(BASE.replace(eps_scale=float(a), e_scale=float(b)), harmonics)
            zeta[i, j] = hb.analysis.critical_parameter(problem, "zeta", frequencies=SPAN).value
    return Results(eps, e, zeta, found, (middle - begin, time.process_time() - middle))


def plot(results: Results) -> Figure:
    """Distance of each point of the surface from the design, and the design found."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(4.6, 3.4), layout="constrained")
    lines = ax.contour(results.e, results.eps, 100 * results.distance, 12, cmap="viridis", linewidths=1.0)
    ax.clabel(lines, fmt="%.3g %%", fontsize=7)
    i, j = np.unravel_index(np.nanargmin(results.distance), results.distance.shape)
    least = f"least of the map: {results.distance[i, j]:.2%}"
    ax.plot(results.e[j], results.eps[i], "s", color=study.GREY, linestyle="", label=least)
    at = results.found.values
    ax.plot(
        at["e_scale"],
        at["eps_scale"],
        "*",
        color=study.ORANGE,
        markersize=10,
        linestyle="",
        label=f"redesign: {results.found.distance:.2%}",
    )
    ax.plot(1.0, 1.0, "o", color="black", linestyle="", label="the design", clip_on=False)
    ax.set_xlabel(r"factor of the error amplitudes $e_l$ [-]")
    ax.set_ylabel(r"factor of the stiffness amplitudes $\varepsilon_l$ [-]")
    figure.legend(fontsize=7, loc="outside upper center", ncols=3)
    return figure


def report(results: Results) -> str:
    """Both changes, and what they cost."""
    found, distance = results.found, results.distance
    i, j = np.unravel_index(np.nanargmin(distance), distance.shape)
    rows = [
        ("redesign", found.values["zeta"], found.values["eps_scale"], found.values["e_scale"], found.distance),
        ("least of the map", max(results.zeta[i, j], BASE.zeta), results.eps[i], results.e[j], distance[i, j]),
    ]
    lines = ["| | zeta | eps_scale | e_scale | change | seconds of the processor |", "|---|---|---|---|---|---|"]
    for (name, zeta, eps, e, change), seconds in zip(rows, results.seconds, strict=True):
        lines.append(f"| {name} | {zeta:.5f} | {eps:.4f} | {e:.4f} | {change:.3%} | {seconds:.0f} |")
    lines += [
        "",
        f"A trace of the new design has {len(found.curve.jumps())} jumps; the goal is "
        f"{'reached' if found.reached else 'not reached'} after {found.steps} steps. The map has "
        f"{distance.size} points.",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    study.main()
