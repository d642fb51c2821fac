"""What tracing many designs of a small model in lock step could gain over tracing them one by one.

    python -m studies.speed.lockstep [--quick] [-o DIR]

In lock step the equations of B designs, each with its own parameters, motion and frequency, are evaluated and solved in
one set of arrays (`batched`), as a trace does with the rows it seeks together, of one design. Measured are the CPU time
of such a Newton iteration for each design beside that of eight rows of one problem for each row, and how the time of a
case parts into steps along the curve, which a lock step would take together, and the rest: start, truncation errors and
regimes, stability, special points, jumps and peaks, which belong to each design. The estimate is generous: prediction
and step control gain as much as Newton does, no design waits for another, and nothing is spent on those that leave.

    gain of a case = whole / (rest + steps / gain of an iteration)  <=  whole / rest

Two processes give at most 2, and a lock step in one process was to be kept if it is three times better than that. With
both in the same number of processes, the gain over one process is the comparison.
"""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import hbgear as hb
from hbgear.continuation.algebra import all_bordered
from studies import study
from studies.speed.batched import Batch
from studies.speed.profile import TOGETHER, Counted

ALONE = True

CASES: dict[str, tuple[hb.Model, int, tuple[str, ...]]] = {
    "Duffing, $H = 7$": (hb.Duffing(), 7, ("zeta", "k3", "F")),
    "spur pair, $H = 10$": (hb.SpurPair(), 10, ("zeta", "F_m", "b")),
    "double-helical pair, $H = 16$": (hb.DoubleHelicalPair(), 16, ("zeta",)),
}
"""Model, harmonics, and what differs between its designs."""
SIZES = (1, 8, 32, 128)
TASKS = {
    "peak": {"peak": True, "special": True, "stability": False},
    "peak and jumps": {"peak": True, "special": True, "stability": True},
    "curve": {"peak": False, "special": True, "stability": True},
    "peak, no special points": {"peak": True, "special": False, "stability": False},
    "points alone": {"peak": False, "special": False, "stability": False},
}
"""Three cases of `hb.cases`, what a peak alone could do without, and the points of a curve, for which no study asks."""
PROCESSES, WORTH = 2, 3


def seconds(call: Callable[[], Any]) -> float:
    """CPU time of a call."""
    start = time.process_time()
    call()
    return time.process_time() - start


def designs(name: str, count: int, seed: int = 1) -> list[hb.Model]:
    """Models whose parameters are up to a tenth off those of the case."""
    model, _, names = CASES[name]
    rng = np.random.default_rng(seed)
    factors = 1 + 0.1 * rng.uniform(-1, 1, (count, len(names)))
    values = [{key: model.parameters[key] * x for key, x in zip(names, row, strict=True)} for row in factors]
    return [model.replace(**changed) for changed in values]


def jobs(name: str, sizes: tuple[int, ...]) -> dict[tuple[int, str], Callable[[float], Any]]:
    """By size of the batch and part of a Newton iteration: that part for max(sizes) designs, in turns of B.

    Each takes a factor of all frequencies. Size 0 is one problem, eight motions at once as `trace` does. The motions
    are rows of the curve of the case.
    """
    model, harmonics, _ = CASES[name]
    alone = hb.HarmonicBalance(model, harmonics)
    branch = hb.trace(alone, "Omega", model.default_span, special=False, stability=False)
    count = max(sizes)
    rows = np.random.default_rng(2).integers(0, len(branch), count)
    X, Omega = branch.X[rows], branch.values[rows]
    problems = [hb.HarmonicBalance(one, harmonics) for one in designs(name, count)]
    normal, rhs = np.column_stack([X, np.ones(count)]), np.column_stack([X, np.zeros(count)])
    strides = [slice(i, i + TOGETHER) for i in range(0, count, TOGETHER)]
    each = [(alone.linearise_all(X[some], Omega[some]), normal[some], rhs[some, :, None]) for some in strides]
    out: dict[tuple[int, str], Callable[[float], Any]] = {
        (0, "evaluation"): lambda f: [alone.linearise_all(X[some], f * Omega[some]) for some in strides],
        (0, "solution"): lambda f: [np.linalg.solve(all_bordered(now.dR_dX, now.dR_dp, n), b) for now, n, b in each],
    }
    for B in sizes:
        batch, turns = Batch(problems[:B]), range(count // B)
        now, n, b = batch.linearise(X[:B], Omega[:B]), normal[:B], rhs[:B, :, None]
        x, w = X[:B], Omega[:B]
        out[B, "evaluation"] = partial(_repeat, turns, lambda f, batch=batch, x=x, w=w: batch.linearise(x, f * w))
        out[B, "solution"] = partial(
            _repeat, turns, lambda f, now=now, n=n, b=b: np.linalg.solve(all_bordered(now.dR_dX, now.dR_dp, n), b)
        )
    return out


def _repeat(turns: range, call: Callable[[float], Any], factor: float) -> None:
    for _ in turns:
        call(factor)


def iterations(name: str, sizes: tuple[int, ...], repeats: int) -> dict[int, dict[str, list[float]]]:
    """Seconds for each design of the parts of an iteration, by size of the batch, each measured in turn."""
    calls = jobs(name, sizes)
    found: dict[int, dict[str, list[float]]] = {B: {"evaluation": [], "solution": []} for B in (0, *sizes)}
    for turn in range(repeats):
        factor = 1 + 1e-9 * (turn + 1)  # a frequency that is not kept from the last turn
        for (B, part), call in calls.items():
            found[B][part].append(seconds(partial(call, factor)) / max(sizes))
    return found


def parts(name: str, repeats: int) -> dict[str, Any]:
    """Motions evaluated for a curve, and seconds of its steps and of each task."""
    model, harmonics, _ = CASES[name]
    span = model.default_span
    counted = Counted(model, harmonics)
    branch = hb.trace(counted, "Omega", span, special=False, stability=False)
    problem = hb.HarmonicBalance(model, harmonics)

    def case(peak: bool, special: bool, stability: bool) -> None:
        mine = hb.HarmonicBalance(model, harmonics)
        curve = hb.trace(mine, "Omega", span, special=special, stability=stability)
        if peak:
            hb.peaks(curve, "pp2")

    calls: dict[str, Callable[[], Any]] = {
        "bare": lambda: hb.trace(problem, "Omega", span, special=False, stability=False),
        "start": lambda: problem.start(span[0]),
        "observed": lambda: problem.observe_all(branch.X, branch.values, False, **branch.fixed),
        **{task: partial(case, **how) for task, how in TASKS.items()},
    }
    measured = [[seconds(call) for call in calls.values()] for _ in range(repeats)]
    typical = dict(zip(calls, np.median(measured, axis=0).tolist(), strict=True))
    return {
        "motions": counted.motions,
        "steps": typical["bare"] - typical["start"] - typical["observed"],
        "tasks": {task: typical[task] for task in TASKS},
    }


def gain(whole: float, steps: float, faster: float) -> float:
    """Whole time over what is left of it with the steps so many times faster."""
    rest = whole - min(steps, whole)  # steps were timed by themselves, in another run
    return whole / (rest + (whole - rest) / faster) if rest or np.isfinite(faster) else np.inf


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per model: seconds of a Newton iteration by batch size, gains, and the estimate for each task."""
    rows = []
    for name in list(CASES)[1:2] if quick else CASES:
        found = iterations(name, SIZES[:3] if quick else SIZES, 3 if quick else 15)
        curve = parts(name, 1 if quick else 7)
        cost = {
            B: [curve["motions"] * (e + s) for e, s in zip(times["evaluation"], times["solution"], strict=True)]
            for B, times in found.items()
        }  # fmt: skip
        gains = {B: median(a / b for a, b in zip(cost[0], times, strict=True)) for B, times in cost.items() if B}
        tasks = {
            task: {"whole": whole, "share": curve["steps"] / whole,
                   "gain": gain(whole, curve["steps"], max(gains.values())),
                   "most": gain(whole, curve["steps"], np.inf)}
            for task, whole in curve["tasks"].items()
        }  # fmt: skip
        typical = {B: {part: median(t) for part, t in times.items()} for B, times in found.items()}
        rows.append({"name": name, "times": typical, "gains": gains, "tasks": tasks})
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """Two tables in Markdown, and what follows from them."""
    sizes = list(rows[0]["gains"])
    head = ["for each design [µs]", f"{TOGETHER} rows of one", *(f"B = {B}" for B in sizes)]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        name = row["name"].replace("$", "")
        for part in ("evaluation", "solution"):
            cells = [f"{1e6 * row['times'][B][part]:.1f}" for B in (0, *sizes)]
            lines.append("| " + " | ".join([f"{name}: {part}", *cells]) + " |")
        cells = ["1", *(f"{row['gains'][B]:.1f}" for B in sizes)]
        lines.append("| " + " | ".join([f"{name}: gain of the iterations of a curve", *cells]) + " |")
    head = ["a case of", "ms", "of it steps along the curve", "gain over one process, estimated",
            "with steps that cost nothing", "over two processes, estimated"]  # fmt: skip
    lines += ["", "| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        for task, found in row["tasks"].items():
            cells = [f"{row['name'].replace('$', '')}: {task}", f"{1e3 * found['whole']:.0f}"]
            cells += [f"{100 * found['share']:.0f} %", f"{found['gain']:.1f}", f"{found['most']:.1f}"]
            lines.append("| " + " | ".join([*cells, f"{found['gain'] / PROCESSES:.1f}"]) + " |")
    best = max(found["gain"] for row in rows for task, found in row["tasks"].items() if task != "points alone")
    worth = "worth its code" if best / PROCESSES >= WORTH else "so designs stay traced one by one, in processes"
    verdict = f"For a peak or a curve at best {best / PROCESSES:.1f} times two processes, needed {WORTH}: {worth}."
    return "\n".join([*lines, "", verdict, "", "CPU time, medians; B designs in one set of arrays.", ""])


def plot(rows: list[dict[str, Any]]) -> Figure:
    """Left: time of an iteration for each design over the size of the batch; right: estimated gain of a case."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 3.3), width_ratios=(2, 3), layout="constrained")
    colours = (study.BLUE, study.ORANGE, study.PURPLE)
    width = 0.8 / len(rows)
    for i, (row, colour) in enumerate(zip(rows, colours, strict=False)):
        times = {B: 1e6 * sum(each.values()) for B, each in row["times"].items()}
        sizes = list(row["gains"])
        left.loglog(sizes, [times[B] for B in sizes], "o-", color=colour, ms=3.5)
        left.axhline(times[0], color=colour, lw=0.8, ls=":")
        found = list(row["tasks"].values())
        at = np.arange(len(found)) + (i - (len(rows) - 1) / 2) * width
        right.bar(at, [one["gain"] for one in found], 0.9 * width, color=colour, label=row["name"])
        most = "steps that cost nothing" if row is rows[-1] else None
        right.hlines([one["most"] for one in found], at - 0.45 * width, at + 0.45 * width, "black", lw=1.2, label=most)
    left.plot([], [], color=study.GREY, lw=0.8, ls=":", label="eight rows of one problem")
    left.set_xticks(SIZES, [str(B) for B in SIZES])
    left.minorticks_off()
    left.set(xlabel="designs in the batch, $B$", ylabel="Newton iteration of a design [µs]", ylim=(5, 1500))
    left.legend(loc="upper right")
    for level, text in ((PROCESSES, "two processes"), (PROCESSES * WORTH, "three times two processes")):
        right.axhline(level, color="black", lw=0.7, ls="--", zorder=0)
        right.annotate(text, (1.0, level), (3, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
                       va="center", fontsize=8)  # fmt: skip
    right.set_xticks(range(len(TASKS)), [textwrap.fill(task, 8) for task in TASKS])
    right.tick_params(axis="x", length=0)
    right.set(ylabel="gain over one process, estimated", xlim=(-0.5, len(TASKS) - 0.5))
    right.legend(loc="upper left")
    return figure


if __name__ == "__main__":
    study.main()
