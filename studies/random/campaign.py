"""Ten thousand random machines: how their traces end, how right their special points, verdicts and landings are.

    python -m studies.random.campaign [--quick] [-o DIR]

Spur pairs, double-helical pairs, pairs on bearings and two masses with one or two elements (`studies.random.machines`),
each traced by the default call on one core. Every status is looked at: whether the curve ends where it says, solves its
equations, and covers the span or says what it does not. Two hundred machines are held against the truth
(`studies.random.truth`): special points and verdicts against shooting, landings of jumps against another integration.
What was computed is kept beside this file, in ``.store``, by the state of the sources; a run that was stopped goes on.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.common.replacing import replacing
from hbgear.continuation.branch import Branch, Status
from hbgear.design.workers import executor_of
from hbgear.mechanics.recession import Receded
from studies import study
from studies.random import truth
from studies.random.machines import PAIRS, Machine, machine
from studies.random.truth import Compared, Comparison, Landed, Verdict

TRACED = {"spur": 8000, "helical": 1250, "bearings": 600, "two": 450}
"""Machines of each kind that are traced, the fewer the longer they take."""

HELD = {"spur": 80, "helical": 30, "bearings": 40, "two": 50}
"""Those of them, the first, that are held against the truth."""

STORE = Path(__file__).parent / ".store"

SECONDS = 600.0
"""Of the processor, after which a machine is interrupted, and counts as one that hangs."""

TITLES = {"spur": "spur pairs", "helical": "double-helical pairs", "bearings": "pairs on bearings", "two": "two masses"}


@dataclass(frozen=True)
class Ended:
    """How a trace ended: status, points, seconds, special points; what is not true of it, or the exception."""

    machine: str
    status: str
    points: int
    seconds: float
    special: int
    untrue: str = ""


@dataclass(frozen=True)
class Results:
    """All traces, and what was held against the truth; seconds it took, of all processes together."""

    ended: list[Ended]
    compared: list[Comparison]
    seconds: float


# ---- one machine


def followed(it: Machine) -> Ended:
    """The machine traced by the default call, and what is not true of what that says."""
    begun = time.process_time()
    try:
        with _limited(SECONDS):
            branch = truth.traced(it, 16)
    except (Exception, KeyboardInterrupt) as error:
        return Ended(it.name, type(error).__name__, 0, time.process_time() - begun, 0, str(error))
    seconds = time.process_time() - begun
    special = sum(len(one.special) for one in truth.curves(branch))
    points = sum(map(len, truth.curves(branch)))
    return Ended(it.name, str(branch.status), points, seconds, special, "; ".join(untrue(it, branch)))


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Interrupt, as Ctrl-C does, what takes more time of the processor; nothing where there are no such timers."""
    if not hasattr(signal, "SIGPROF") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def untrue(it: Machine, branch: Branch) -> Iterator[str]:
    """What is not true of a branch and of the others of its span."""
    for one in truth.curves(branch):
        if not one.residual.max() <= 1e-10:
            yield f"residual {one.residual.max():.1e}"
        if one.multipliers is not None and np.isnan(one.multipliers).any():
            yield "multipliers nan"
        if any(not point.located for point in one.special):
            yield "a special point not located"
        yield from _ending(it, one)
    covered = sum(high - low for low, high in _covered(branch))
    if covered < (1 - 1e-3) * abs(it.span[1] - it.span[0]) and "no curve was found" not in branch.message:
        yield f"covers {covered:.3f} of {abs(it.span[1] - it.span[0]):.3f} without a word"


def _ending(it: Machine, one: Branch) -> Iterator[str]:
    """Whether a curve ends where its status says."""
    last, status = float(one.values[-1]), one.status
    if status is Status.REACHED_END and not np.isclose(last, it.span, rtol=1e-9).any():
        yield f"reached_end at {last:.6g}"
    if status is Status.LEFT_SPAN and not np.isclose(last, it.span, rtol=1e-9).any():
        yield f"left_span at {last:.6g}"
    if status is Status.CLOSED and np.linalg.norm(one.X[-1] - one.X[0]) > 1e-6 * np.linalg.norm(one.X[0]):
        yield "closed, but does not end where it began"
    for far in one.asymptotes.values():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # nothing excites it
            linear = hb.HarmonicBalance(Receded(it.model), one.problem.H)
        apart = np.abs(linear.multipliers(np.zeros(linear.size), Omega=far) - 1).min()
        if apart > 1e-3:
            yield f"runs off to infinity at {far:.6g}, where the nearest multiplier is {apart:.1e} from +1"
    if not status.complete:
        yield f"{status}: {one.message}"


def _covered(branch: Branch) -> list[tuple[float, float]]:
    """Ranges of Omega that the curves cover, without overlap; a curve without bound counts up to its asymptote."""
    ends = [[*one.values, *one.asymptotes.values()] for one in truth.curves(branch)]
    out: list[tuple[float, float]] = []
    for low, high in sorted((min(x), max(x)) for x in ends):
        if out and low <= out[-1][1] + 1e-6:
            out[-1] = out[-1][0], max(high, out[-1][1])
        else:
            out.append((low, high))
    return out


def held(it: Machine) -> Comparison:
    """The machine held against the truth; what cannot be traced is told by `followed`."""
    try:
        with _limited(10 * SECONDS):
            return truth.compare(it)
    except (Exception, KeyboardInterrupt) as error:
        print(f"{it.name}: {type(error).__name__}: {error}", file=sys.stderr)
        return Comparison(it.name)


# ---- all of them


def work(kind: str, first: int, count: int, compare: bool) -> list[dict[str, Any]]:
    """Some machines of a kind, one after the other, as JSON holds them."""
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore")
        return [asdict((held if compare else followed)(machine(kind, i))) for i in range(first, first + count)]


def collect(traced: Mapping[str, int], compared: Mapping[str, int], processes: int, store: Path | None) -> Results:
    """Trace and compare so many machines of each kind, or read what is known of them.

    store : folder of what was computed, None to keep nothing. Tasks are ordered by kind only, so any part of a larger
    run is found by it again.
    """
    tasks = [(kind, first, min(25, count - first), False) for kind, count in traced.items()
             for first in range(0, count, 25)]  # fmt: skip
    tasks += [(kind, i, 1, True) for kind, count in compared.items() for i in range(count)]
    begun, known = time.perf_counter(), {task: _stored(store, task) for task in tasks}
    todo = [task for task in tasks if known[task] is None]
    if todo:
        truth.traced(machine("spur", 1), 16)  # what is compiled is compiled here, and counts for no machine
    if processes == 1:
        for task in todo:
            known[task] = _done(store, task, work(*task))
    elif todo:
        with executor_of(None, processes, len(todo)) as pool:
            for task, rows in _in_parallel(pool, todo):
                known[task] = _done(store, task, rows)
                left = sum(rows is None for rows in known.values())
                print(f"{time.perf_counter() - begun:.0f} s, {left} of {len(tasks)} tasks left", file=sys.stderr)
    rows = [(task, row) for task in tasks for row in known[task] or []]
    ended = [Ended(**row) for task, row in rows if not task[3]]
    comparisons = [_comparison(row) for task, row in rows if task[3]]
    return Results(ended, comparisons, sum(x.seconds for x in (*ended, *comparisons)))


def _in_parallel(pool: Executor, todo: list[Any]) -> Iterator[tuple[Any, list[dict[str, Any]]]]:
    running = {pool.submit(work, *task): task for task in todo}
    for future in as_completed(running):
        yield running[future], future.result()


def _comparison(row: dict[str, Any]) -> Comparison:
    parts = (("points", Compared), ("verdicts", Verdict), ("jumps", Landed))
    return Comparison(**{**row, **{name: [kind(**x) for x in row[name]] for name, kind in parts}})


def _stored(store: Path | None, task: tuple[str, int, int, bool]) -> list[dict[str, Any]] | None:
    try:
        known: list[dict[str, Any]] = json.loads(_path(store, task).read_text(encoding="utf-8")) if store else None
    except (OSError, ValueError):
        return None
    return known


def _done(store: Path | None, task: tuple[str, int, int, bool], rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    if store:
        store.mkdir(parents=True, exist_ok=True)
        with replacing(_path(store, task), "w", encoding="utf-8") as handle:
            json.dump(rows, handle)
    return rows


def _path(store: Path, task: tuple[str, int, int, bool]) -> Path:
    kind, first, count, compare = task
    return store / f"{kind}-{first}-{count}-{'held' if compare else 'traced'}.json"


def run(quick: bool = False) -> Results:
    """All machines; ``quick``: the first of each kind, and one of them held against the truth."""
    if quick:
        return collect(dict.fromkeys(PAIRS, 1), {"spur": 1}, 1, None)
    from studies.__main__ import fingerprint

    return collect(TRACED, HELD, os.cpu_count() or 1, STORE / fingerprint(__name__)[:12])


# ---- figure


def plot(results: Results) -> Figure:
    """Ends and times of all traces; errors of special points, stated and true; verdicts; landings."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(11.0, 6.8), layout="constrained")
    for ax, draw in zip(axes.flat, (_ends, _times, _errors, _stated, _verdicts, _landings), strict=True):
        draw(ax, results)
        ax.tick_params(which="both", direction="in")
    return figure


COLOURS = dict(zip(PAIRS, (study.BLUE, study.ORANGE, study.PURPLE, study.GREEN), strict=True))
MARKERS = {"LP": "o", "PD": "D", "NS": "s", "GR": "x", "BP": "P"}


def _of_kind(names: list[Any], kind: str) -> list[Any]:
    return [one for one in names if one.machine.startswith(f"{kind}:")]


def _ends(ax: Axes, results: Results) -> None:
    """Share of machines by status, for each kind."""
    counts = {kind: Counter(one.status for one in _of_kind(results.ended, kind)) for kind in PAIRS}
    statuses = sorted({s for c in counts.values() for s in c}, key=lambda s: -sum(c[s] for c in counts.values()))
    shades = ["#1f4e8c", "#7ea6d8", "#d9730d", "#9c1f5c", "#2f7d4f", "#8a8a8a", "#c2a500", "#111111"]
    for i, (_kind, count) in enumerate(counts.items()):
        left, total = 0.0, sum(count.values()) or 1
        for status, shade in zip(statuses, shades, strict=False):
            share = 100 * count[status] / total
            ax.barh(i, share, left=left, color=shade, height=0.6, label=status.replace("_", " ") if i == 0 else None)
            left += share
    ax.set_yticks(range(len(PAIRS)), [f"{TITLES[kind]}\n({sum(counts[kind].values())})" for kind in PAIRS])
    ax.invert_yaxis()
    ax.set(xlabel="share of machines [%]", xlim=(0, 100), title="how the traces end")
    _below(ax)


def _times(ax: Axes, results: Results) -> None:
    """Cumulative share of machines over the time of their trace."""
    for kind in PAIRS:
        seconds = np.sort([one.seconds for one in _of_kind(results.ended, kind)])
        ax.step(seconds, 100 * np.arange(1, len(seconds) + 1) / max(len(seconds), 1), where="post",
                color=COLOURS[kind], label=TITLES[kind])  # fmt: skip
    ax.set(xscale="log", xlabel="time of the trace, one core [s]", ylabel="share of machines [%]", ylim=(0, 101),
           title="what a default call takes")  # fmt: skip
    ax.legend(loc="lower right")


def _known(results: Results) -> list[Compared]:
    return [p for one in results.compared for p in one.points if np.isfinite(p.error)]


def _errors(ax: Axes, results: Results) -> None:
    """Cumulative share of special points over their true error."""
    points = _known(results)
    for kind, colour in zip(MARKERS, (*COLOURS.values(), study.GREY), strict=True):
        errors = np.sort([max(p.error, 1e-12) for p in points if p.kind == kind])
        if errors.size:
            ax.step(errors, 100 * np.arange(1, len(errors) + 1) / len(errors), where="post", color=colour,
                    label=f"{kind} ({len(errors)})")  # fmt: skip
    ax.set(xscale="log", xlabel=r"true error of $\Omega$ [-]", ylabel="share of special points [%]", ylim=(0, 101),
           title="special points against shooting")  # fmt: skip
    _below(ax)


def _stated(ax: Axes, results: Results) -> None:
    """True error of every special point over the stated one."""
    points = [p for p in _known(results) if np.isfinite(p.stated)]
    low, high = 1e-12, 1.0
    for kind, marker in MARKERS.items():
        some = [p for p in points if p.kind == kind]
        x, y = ([max(v, low) for v in values] for values in ([p.stated for p in some], [p.error for p in some]))
        ax.plot(x, y, marker, color=study.BLUE, markersize=3, markerfacecolor="none", label=kind, linestyle="none")
    for times, style in ((1, "-"), (3, "--"), (10, ":")):
        ax.plot([low, high], [times * low, times * high], style, color="black", linewidth=0.8,
                label="equal" if times == 1 else f"{times} times")  # fmt: skip
    ax.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high), xlabel="stated error [-]",
           ylabel=r"true error of $\Omega$ [-]", title="stated and true errors")  # fmt: skip
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=4, handlelength=1.4, columnspacing=1.0)


def _verdicts(ax: Axes, results: Results) -> None:
    """Distance of the largest multiplier from the circle, said and true; wrong ones lie in the shaded quadrants."""
    rows = [v for one in results.compared for v in one.verdicts]
    groups = (("right", [v for v in rows if v.stable is not None and not v.wrong], ".", study.BLUE),
              ("undecided", [v for v in rows if v.stable is None], "s", study.ORANGE),
              ("wrong", [v for v in rows if v.wrong], "x", "#c00000"))  # fmt: skip
    for x in ((-1, 0, 0, 1), (0, 1, -1, 0)):
        ax.fill_between(x[:2], x[2], x[3], color="#eeeeee", linewidth=0)
    for label, some, marker, colour in groups:
        ax.plot([v.said - 1 for v in some], [v.true - 1 for v in some], marker, color=colour, markersize=4,
                markerfacecolor="none", linestyle="none", label=f"{label} ({len(some)})")  # fmt: skip
    for set_scale in (ax.set_xscale, ax.set_yscale):
        set_scale("symlog", linthresh=1e-6)
    ax.set(xlim=(-1, 1), ylim=(-1, 1), xlabel=r"$|\mu|_\mathrm{max} - 1$ of the curve", title="verdicts",
           ylabel=r"$|\mu|_\mathrm{max} - 1$ by shooting")  # fmt: skip
    ticks = [-1e-1, -1e-3, -1e-5, 0, 1e-5, 1e-3, 1e-1]
    ax.set_xticks(ticks)
    ax.set_yticks(ticks)
    _below(ax)


def _landings(ax: Axes, results: Results) -> None:
    """Size of the motion a jump lands on, said and integrated."""
    jumps = [j for one in results.compared for j in one.jumps]
    sure = [j for j in jumps if j.sure]
    groups = (("as said", [j for j in sure if j.right], "o", study.BLUE),
              ("indeterminate or slow", [j for j in jumps if j not in sure], "s", study.ORANGE),
              ("elsewhere", [j for j in sure if not j.right], "x", "#c00000"))  # fmt: skip
    for label, some, marker, colour in groups:
        ax.plot([j.said for j in some], [j.true for j in some], marker, color=colour, markersize=4,
                markerfacecolor="none", linestyle="none", label=f"{label} ({len(some)})")  # fmt: skip
    ax.axline((1, 1), (2, 2), color="black", linewidth=0.8, zorder=0)
    ax.set(xscale="log", yscale="log", xlabel="rms said [-]", ylabel="rms integrated [-]", title="landings of jumps")
    _below(ax)


def _below(ax: Axes) -> None:
    """The legend below the axes, where it covers nothing."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=3, handlelength=1.0, columnspacing=1.0)


# ---- table


def report(results: Results) -> str:
    """Counts, errors, and every machine of which something is not as it should be."""
    head = ["machines", "number", *_statuses(results), "exceptions", "untrue or cut short", "median [s]", "longest [s]"]
    rows = [head, ["---"] * len(head)]
    for kind in PAIRS:
        some = _of_kind(results.ended, kind)
        count, seconds = Counter(one.status for one in some), [one.seconds for one in some] or [np.nan]
        failed = sum(one.points == 0 for one in some)
        wrong = sum(bool(one.untrue) and one.points > 0 for one in some)
        rows.append([TITLES[kind], len(some), *(count[s] for s in _statuses(results)), failed, wrong,
                     f"{np.median(seconds):.2f}", f"{np.max(seconds):.1f}"])  # fmt: skip
    lines = [_row(row) for row in rows]
    lines += ["", f"{len(results.compared)} machines are held against the truth. Errors are those of Omega.", ""]
    lines += [_row(row) for row in _points(results)]
    verdicts = [v for one in results.compared for v in one.verdicts]
    wrong_ones = [v for v in verdicts if v.wrong]
    jumps = [j for one in results.compared for j in one.jumps]
    sure = [j for j in jumps if j.sure]
    astray = [j for j in sure if not j.right]
    undecided, unsure = sum(v.stable is None for v in verdicts), len(jumps) - len(sure)
    lines += ["", f"Of {len(verdicts)} verdicts {len(wrong_ones)} are wrong and {undecided} undecided; of {len(jumps)} "
              f"jumps, {unsure} of them told to be indeterminate or slow, {len(astray)} land elsewhere. "
              f"{results.seconds / 60:.0f} min of one core."]  # fmt: skip
    lines += ["", "What is not as it should be, by machine (kind:number):", ""]
    lines += [f"* {one.machine}: {one.status}; {one.untrue}" for one in results.ended if one.untrue]
    lines += [f"* {p.machine}: {p.kind} {_text(p)}" for one in results.compared for p in one.points
              if not np.isfinite(p.error)]  # fmt: skip
    lines += [f"* {v.machine}: {'stable' if v.stable else 'unstable'} at {v.Omega:.7g}, with |mu| = {v.said:.6f}; "
              f"it is {v.true:.6f}" for v in wrong_ones]  # fmt: skip
    lines += [f"* {j.machine}: {j.label} at {j.Omega:.6g} lands on rms {j.true:.4g}, not {j.said:.4g}. {j.note}"
              for j in astray]  # fmt: skip
    return "\n".join([*(line.rstrip() for line in lines), ""])


def _row(cells: list[Any]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def _text(p: Compared) -> str:
    return f"false at {p.Omega:.7g}" if np.isnan(p.true) else f"missing at {p.true:.7g}"


def _statuses(results: Results) -> list[str]:
    known = [str(s) for s in Status]
    seen = {one.status for one in results.ended}
    return [s for s in known if s in seen]


def _points(results: Results) -> list[list[Any]]:
    """Table of special points by their kind."""
    head = ["kind", "held", "shot", "false", "missing", "median error", "95 %", "largest", "below 3 x stated",
            "below 10 x"]  # fmt: skip
    rows = [head, ["---"] * len(head)]
    every = [p for one in results.compared for p in one.points]
    for kind in MARKERS:
        some = [p for p in every if p.kind == kind]
        known = [p for p in some if np.isfinite(p.error)]
        if not some:
            continue
        errors = [p.error for p in known] or [np.nan]
        ratio = np.array([p.error / max(p.stated, 1e-9) for p in known if np.isfinite(p.stated)] or [np.nan])
        false, missing = sum(bool(np.isnan(p.true)) for p in some), sum(bool(np.isnan(p.Omega)) for p in some)
        rows.append([kind, len(some), sum(p.by == "shooting" for p in some), false, missing,
                     *(f"{x:.0e}" for x in np.percentile(errors, (50, 95, 100))),
                     *(f"{100 * np.mean(ratio < times):.1f} %" for times in (3, 10))])  # fmt: skip
    return rows


if __name__ == "__main__":
    study.main()
