"""Effect of scatter of damping, load and mesh excitation on response and jumps of the double-helical pair.

    python -m studies.design.tolerances [--quick] [-o DIR]

1000 Monte Carlo cases around zeta = 0.055, where the curve has a narrow range of two stable motions: some cases jump,
some do not. Of each case the whole response curve is traced (H = 12) with stability, its largest peak and the jumps of
slow sweeps. Omega is in units of the natural frequency sqrt(k_mean/m_c) of each case. The scatter is an example, not
measured. The report gives the cases per second, and the gain of a second process on the first 24 cases, the start of
the processes included.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

import hbgear as hb
from hbgear import plot as draw
from studies import study

ALONE = True

BASE = hb.gears.DoubleHelicalPair(zeta=0.055)
SCATTER = {
    "zeta": ("truncated_normal", 0.055, 0.008, 0.035, 0.08),
    "torque": ("normal", 1400.0, 40.0),
    "eps_scale": ("uniform", 0.9, 1.1),
    "e_scale": ("triangular", 0.8, 1.0, 1.3),
    "k_mean": ("normal", 1.8456e9, 4.0e7),
}
"""Distribution of each parameter that varies; see `hbgear.design.studies.samples.DISTRIBUTIONS`."""
SEED = 1


@dataclass(frozen=True)
class Results:
    """The cases, the seconds they took on how many processes, and the seconds of a part on one and on two."""

    found: hb.design.Cases
    processes: int
    seconds: float
    part: int
    one: float
    two: float

    @property
    def efficiency(self) -> float:
        """Time on one process over twice the time on two; 1 is ideal."""
        return self.one / (2 * self.two)


def compute(count: int, processes: int, harmonics: int, span: tuple[float, float]) -> tuple[hb.design.Cases, float]:
    """The first cases of the sample, and the seconds they took."""
    start = time.perf_counter()
    found = hb.design.cases(
        BASE,
        hb.design.monte_carlo(count, SEED, **SCATTER),
        ("peak", "jumps", "curve"),
        harmonics=harmonics,
        span=span,
        processes=processes,
    )
    return found, time.perf_counter() - start


def run(quick: bool = False) -> Results:
    """All cases, then a part of them on one and on two processes; ``quick``: 6 cases around the resonance, H = 4."""
    count, part, harmonics, span = (6, 0, 4, (0.95, 0.8)) if quick else (1000, 24, 12, (1.6, 0.2))
    processes = 1 if quick else os.cpu_count() or 1
    found, seconds = compute(count, processes, harmonics, span)
    if quick:
        return Results(found, processes, seconds, part, np.nan, np.nan)
    one, two = (compute(part, n, harmonics, span)[1] for n in (1, 2))
    return Results(found, processes, seconds, part, one, two)


def plot(results: Results) -> Figure:
    """Envelope of the curves and distribution of the jumps; below, peak and jumps against each parameter."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(8.6, 7.4), layout="constrained")
    top, low = figure.subfigures(2, 1, height_ratios=(1.0, 1.45))
    left, right = top.subplots(1, 2)
    draw.envelope(results.found, left)
    draw.jump_distribution(results.found, right)
    draw.against_parameters(results.found, low)
    return figure


def report(results: Results) -> str:
    """Numbers of the peak and the jumps, what they depend on, and the speed, as tables in Markdown."""
    found = results.found
    columns = {
        "largest peak, half peak-to-peak [b_c]": "peak",
        "Omega of the peak": "peak_Omega",
        "jump while Omega rises": "jump_rising",
        "jump while Omega falls": "jump_falling",
    }
    lines = [f"{len(found)} cases, {len(found.failed)} failed. The last columns are rank correlations (Spearman).", ""]
    head = ["number", "cases", "5 %", "median", "95 %", *found.names]
    lines += ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for label, column in columns.items():
        values = found.table[column]
        which = np.isfinite(values)
        if which.sum() < 3:
            continue
        low, middle, high = np.percentile(values[which], (5, 50, 95))
        ranks = [spearmanr(found.table[name][which], values[which]).statistic for name in found.names]
        cells = [label, str(which.sum()), f"{low:.4f}", f"{middle:.4f}", f"{high:.4f}", *(f"{r:+.2f}" for r in ranks)]
        lines.append("| " + " | ".join(cells) + " |")
    rate = len(found) / results.seconds
    lines += ["", f"{rate:.2f} cases per second on {results.processes} processes ({results.seconds:.0f} s)."]
    if np.isfinite(results.efficiency):
        lines += [
            "",
            f"{results.part} cases: {results.one:.1f} s on one process, {results.two:.1f} s on two; "
            f"parallel efficiency {results.efficiency:.2f}.",
        ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
