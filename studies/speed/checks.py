"""Cost of the verification of stability: the same curves with and without it, run in turn.

    python -m studies.speed.checks [--quick] [-o DIR]

Without the checks, multipliers have no errors, parities are not compared, and no point is refined. Special points and
their errors are computed in both. The table gives medians of the processor's time, and the median ratio of
neighbouring runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.continuation.problem.curve_equations import CurveSolutions
from studies import study

ALONE = True

CASES: dict[str, tuple[Callable[[], hb.mechanics.Model], int]] = {
    "Duffing, H = 7": (hb.Duffing, 7),
    "SpurPair, H = 10": (hb.SpurPair, 10),
    "DoubleHelicalPair, H = 16": (hb.gears.DoubleHelicalPair, 16),
    "GearRotorBearing, H = 16": (hb.gears.GearRotorBearing, 16),
}


class Unchecked(hb.HarmonicBalance):
    """A balance whose multipliers are taken as they are."""

    def verify_stability(self, solutions: CurveSolutions, seen: Sequence[dict[str, Any]], *rest: Any) -> None:
        """State no error of any multiplier."""
        for record in seen:
            record["modulus_error"] = float("nan")


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per case: points, and seconds of both curves; ``share`` is the median extra time of neighbouring runs."""
    rows = []
    for name, (make, harmonics) in CASES.items():
        model = make()
        problems = hb.HarmonicBalance(model, harmonics), Unchecked(model, harmonics)
        curve, _ = (hb.trace(problem, "Omega", model.default_span) for problem in problems)
        with threadpool_limits(1):
            times = [[_seconds(problem, model.default_span) for problem in problems] for _ in range(1 if quick else 11)]
        checked, plain = zip(*times, strict=True)
        share = median(c / p - 1 for c, p in times)
        rows.append(
            {"case": name, "points": len(curve), "checked": median(checked), "plain": median(plain), "share": share}
        )
    return rows


def _seconds(problem: hb.HarmonicBalance, span: tuple[float, float]) -> float:
    """Processor's time of a curve."""
    start = time.process_time()
    hb.trace(problem, "Omega", span)
    return time.process_time() - start


def report(rows: list[dict[str, Any]]) -> str:
    """The results as a table in Markdown."""
    lines = ["| case | points | with the checks [s] | without [s] | checks / curve |", "|---|---|---|---|---|"]
    lines += [
        f"| {row['case']} | {row['points']} | {row['checked']:.3f} | {row['plain']:.3f} | {row['share']:.0%} |"
        for row in rows
    ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
