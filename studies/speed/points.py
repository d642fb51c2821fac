"""Time of a converged point: with and without stability, with two BLAS threads, without errors of special points.

    python -m studies.speed.points [--quick] [-o DIR]

Each case is traced several times, the variants in turn, so that a drift of the machine's speed meets all of them; the
table gives medians, and ratios of the runs made side by side.
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
VARIANTS: dict[str, dict[str, Any]] = {
    "points alone": {"stability": False, "accuracy": 1e-5, "threads": 1},
    "with stability": {"stability": True, "accuracy": 1e-5, "threads": 1},
    "with stability, two BLAS threads": {"stability": True, "accuracy": 1e-5, "threads": 2},
    "with stability, accuracy=None": {"stability": True, "accuracy": None, "threads": 1},
}


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per case: points, Newton steps per point, and for each variant the median seconds of a whole curve.

    ``stability`` is the ratio of the extra time for stability to the time of the points, ``threads`` that of two BLAS
    threads to one; both are medians of ratios of neighbouring runs.
    """
    rows = []
    for name, (model, harmonics) in CASES.items():
        machine = model()
        problem = hb.HarmonicBalance(machine, harmonics)
        span = machine.default_span
        branch = hb.trace(problem, "Omega", span)  # also the warm-up
        seconds: dict[str, list[float]] = {variant: [] for variant in VARIANTS}
        for _ in range(1 if quick else 21):
            for variant, how in VARIANTS.items():
                with threadpool_limits(how["threads"]):
                    start = time.perf_counter()
                    hb.trace(problem, "Omega", span, stability=how["stability"], accuracy=how["accuracy"])
                    seconds[variant].append(time.perf_counter() - start)
        alone, stable, threads, _ = seconds.values()
        rows.append(
            {
                "case": name,
                "points": len(branch),
                "newton": float(branch.iterations.mean()),
                "seconds": {variant: median(times) for variant, times in seconds.items()},
                "stability": median((s - a) / a for a, s in zip(alone, stable, strict=True)),
                "threads": median(t / s for s, t in zip(stable, threads, strict=True)),
            }
        )
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """The results as a table in Markdown."""
    head = ["case", "points", "Newton steps per point", *(f"{v} [ms/point]" for v in VARIANTS), "curve [s]",
            "stability / points", "two threads / one"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        times = [f"{1e3 * t / row['points']:.3f}" for t in row["seconds"].values()]
        whole, extra, threads = row["seconds"]["with stability"], row["stability"], row["threads"]
        cells = [row["case"], str(row["points"]), f"{row['newton']:.2f}", *times]
        cells += [f"{whole:.2f}", f"{extra:.2f}", f"{threads:.2f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
