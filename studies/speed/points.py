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

CASES: dict[str, tuple[Callable[[], hb.Model], int]] = {
    "Duffing, H = 7": (hb.Duffing, 7),
    "SpurPair, H = 10": (hb.SpurPair, 10),
    "DoubleHelicalPair, H = 16": (hb.DoubleHelicalPair, 16),
}
FEW, MANY = "with stability, accuracy=None", "the same, shorter steps"
VARIANTS: dict[str, tuple[int, dict[str, Any]]] = {
    "points alone": (1, {"stability": False}),
    "with stability": (1, {}),
    "with stability, two BLAS threads": (2, {}),
    FEW: (1, {"accuracy": None}),
    MANY: (1, {"accuracy": None, "steps": hb.Steps(longest=0.01)}),
}
"""Number of BLAS threads, and what a trace is given."""


def timed(problem: hb.HarmonicBalance, span: tuple[float, float], repeats: int) -> dict[str, tuple[int, list[float]]]:
    """Points of the curve and seconds of each run, of each variant."""
    found = {variant: (len(hb.trace(problem, "Omega", span, **how)), list[float]())
             for variant, (_, how) in VARIANTS.items()}  # fmt: skip
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
        problem, span = hb.HarmonicBalance(model(), harmonics), model().default_span
        found = timed(problem, span, 1 if quick else 21)
        (_, alone), (points, stable), (_, threads), (few, whole), (many, longer) = found.values()
        rows.append(
            {
                "case": name,
                "points": points,
                "newton": float(hb.trace(problem, "Omega", span).iterations.mean()),
                "seconds": {variant: median(times) for variant, (_, times) in found.items()},
                "each": {variant: median(times) / count for variant, (count, times) in found.items()},
                "stability": median((s - a) / a for a, s in zip(alone, stable, strict=True)),
                "threads": median(t / s for s, t in zip(stable, threads, strict=True)),
                "more": median((y - x) / (many - few) for x, y in zip(whole, longer, strict=True)),
            }
        )
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """The results as a table in Markdown."""
    head = ["case", "points", "Newton steps per point", *(f"{v} [ms/point]" for v in VARIANTS), "each point more [ms]",
            "curve [s]", "stability / points", "two threads / one"]  # fmt: skip
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
