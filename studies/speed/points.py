"""Time of a converged point: with and without stability, with two BLAS threads, without errors of special points.

    python -m studies.speed.points [--quick] [-o DIR]

Each case is traced several times, the variants in turn, so that a drift of the machine's speed meets all of them; the
table gives medians, and ratios of the runs made side by side. What is done once for a curve (the first motion, special
points, jumps) is shared by its points, so that each takes less where steps are shorter.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

from threadpoolctl import threadpool_limits

import hbgear as hb
from studies import study

ALONE = True

CASES: dict[str, tuple[Callable[[], hb.mechanics.Model], int]] = {
    "Duffing, H = 7": (hb.Duffing, 7),
    "SpurPair, H = 10": (hb.SpurPair, 10),
    "DoubleHelicalPair, H = 16": (hb.gears.DoubleHelicalPair, 16),
}
VARIANTS: dict[str, tuple[int, dict[str, Any]]] = {
    "points alone": (1, {"stability": False}),
    "with stability": (1, {}),
    "with stability, two BLAS threads": (2, {}),
    "with stability, accuracy=None": (1, {"accuracy": None}),
    "the same, shorter steps": (1, {"accuracy": None, "steps": hb.StepControl(max_step=0.01)}),
}
"""Number of BLAS threads, and what a trace is given."""
Runs = dict[str, tuple[hb.Branch, list[float]]]


def timed(problem: hb.HarmonicBalance, span: tuple[float, float], repeats: int) -> Runs:
    """The curve of each variant and seconds of its runs; the first is not counted."""
    found = {
        variant: (hb.trace(problem, "Omega", span, **how), list[float]()) for variant, (_, how) in VARIANTS.items()
    }
    for _ in range(repeats):
        for variant, (threads, how) in VARIANTS.items():
            with threadpool_limits(threads):
                start = time.perf_counter()
                hb.trace(problem, "Omega", span, **how)
                found[variant][1].append(time.perf_counter() - start)
    return found


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per case: points, Newton steps per point, and for each variant the median seconds of a whole curve.

    ``stability`` is the ratio of the extra time for stability to the time of the points, ``threads`` that of two BLAS
    threads to one; both are medians of ratios of neighbouring runs. ``more``: seconds of each point that shorter steps
    add to a curve, the median of neighbouring runs.
    """
    rows = []
    for name, (model, harmonics) in CASES.items():
        machine = model()
        found = timed(hb.HarmonicBalance(machine, harmonics), machine.default_span, 1 if quick else 21)
        (_, alone), (curve, stable), (_, threads), (few, whole), (many, longer) = found.values()
        rows.append(
            {
                "case": name,
                "points": len(curve),
                "newton": float(curve.iterations.mean()),
                "seconds": {variant: median(times) for variant, (_, times) in found.items()},
                "each": {variant: median(times) / len(branch) for variant, (branch, times) in found.items()},
                "stability": median((s - a) / a for a, s in zip(alone, stable, strict=True)),
                "threads": median(t / s for s, t in zip(stable, threads, strict=True)),
                "more": median((y - x) / (len(many) - len(few)) for x, y in zip(whole, longer, strict=True)),
            }
        )
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """The results as a table in Markdown."""
    head = [
        "case",
        "points",
        "Newton steps per point",
        *(f"{v} [ms/point]" for v in VARIANTS),
        "each point more [ms]",
        "curve [s]",
        "stability / points",
        "two threads / one",
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        times = [f"{1e3 * t:.3f}" for t in (*row["each"].values(), row["more"])]
        whole, extra, threads = row["seconds"]["with stability"], row["stability"], row["threads"]
        cells = [row["case"], str(row["points"]), f"{row['newton']:.2f}", *times]
        cells += [f"{whole:.3f}", f"{extra:.2f}", f"{threads:.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
