"""Cost of a response curve: slow sweeps by time integration against one continuation with stability.

    python -m studies.speed.sweep_ratio [--quick] [-o DIR]

The double-helical pair with its defaults, Omega from 0.3 to 1.6. The sweeps pass 131 frequencies up and down; at each
the motion is integrated until it is settled to the tolerance given. The continuation is the whole curve with
multipliers, special points and jumps. Sweeps run on the fast integrator of hbgear, exact in the linear part; what the
same periods would take with DOP853 of scipy is extrapolated from some of them.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear import plot as draw
from hbgear.time.frequency_sweep import Sweep, sweep
from hbgear.time.integration import integrate, state_of
from hbgear.time.steady_state import SteadyStateSettings
from studies import study

ALONE = True

SPAN = (0.3, 1.6)
VALUES = 131


def continuation(harmonics: int) -> tuple[hb.Branch, float]:
    """The curve and the seconds it took, the better of two runs."""
    problem = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(), harmonics)
    seconds = []
    for _ in range(2):
        start = time.perf_counter()
        branch = hb.trace(problem, "Omega", (SPAN[1], SPAN[0]))
        seconds.append(time.perf_counter() - start)
    return branch, min(seconds)


def sweeps(tolerance: float, values: int) -> tuple[list[Sweep], float]:
    """Up and down, and the seconds they took."""
    grid = np.linspace(*SPAN, values)
    start = time.perf_counter()
    found = [
        sweep(hb.gears.DoubleHelicalPair(), grid, way, settling=SteadyStateSettings(tolerance))
        for way in ("up", "down")
    ]
    return found, time.perf_counter() - start


def dop853(branch: hb.Branch, frequencies: tuple[float, ...] = (0.4, 0.6, 0.9, 1.3)) -> float:
    """Seconds s of DOP853 such that an excitation period at Omega takes s / Omega, as its steps are of one length."""
    per_time = []
    for Omega in frequencies:
        i = int(np.argmin(np.abs(branch.values - Omega)))
        here = branch.parameters_at(i)
        y = state_of(branch.problem, branch.X[i], **here)
        start = time.perf_counter()
        integrate(hb.gears.DoubleHelicalPair(), y, 3, here["Omega"], tolerance=1e-8, samples=64)
        per_time.append((time.perf_counter() - start) / 3 * here["Omega"])
    return float(np.median(per_time))


def run(quick: bool = False) -> dict[str, Any]:
    """Everything in the table; ``quick`` sweeps six frequencies only and scales nothing."""
    values, tolerances = (6, (1e-3,)) if quick else (VALUES, (1e-3, 1e-5, 1e-7))
    with threadpool_limits(1):
        curves = {H: continuation(H) for H in (16, 24)}
        unit = dop853(curves[16][0])
        sweep(hb.gears.DoubleHelicalPair(), np.array(SPAN), "up")  # compiles what it needs
        rows = []
        for tolerance in tolerances:
            found, seconds = sweeps(tolerance, values)
            periods = sum(int(s.integrated_periods.sum()) for s in found)
            slow = sum(float((s.integrated_periods / s.values).sum()) for s in found) * unit
            rows.append(
                {"tolerance": tolerance, "seconds": seconds, "periods": periods, "dop853": slow, "sweeps": found}
            )
    return {"curves": curves, "rows": rows, "values": values}


def report(result: dict[str, Any]) -> str:
    """The results as tables in Markdown."""
    lines = ["| continuation | points | seconds |", "| --- | --- | --- |"]
    for H, (branch, seconds) in result["curves"].items():
        lines.append(f"| H = {H}, with stability and special points | {len(branch)} | {seconds:.2f} |")
    base = result["curves"][16][1]
    head = [
        f"sweeps, {result['values']} frequencies up and down, settled to",
        "periods",
        "seconds",
        "over continuation (H = 16)",
        "the same by DOP853 [s], estimated",
        "over continuation",
    ]
    lines += ["", "| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in result["rows"]:
        seconds, slow = row["seconds"], row["dop853"]
        cells = [f"{row['tolerance']:.0e}", str(row["periods"]), f"{seconds:.0f}", f"{seconds / base:.0f}"]
        cells += [f"{slow:.0f}", f"{slow / base:.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


def plot(result: dict[str, Any]) -> Figure:
    """The tightest sweeps as dots on the curve."""
    return draw.sweeps(result["rows"][-1]["sweeps"], result["curves"][16][0], "rms").figure  # type: ignore[return-value]


if __name__ == "__main__":
    study.main()
