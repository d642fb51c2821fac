"""Traces of many random machines and comparisons with the truth, on all cores, stored by the state of the sources.

trace_end(machine)      status, time and contradictions of the trace of a machine
comparison_of(machine)  its special points, stability and landings compared with shooting and integration
collect(traced, compared, processes, store)  both for the first machines of each kind
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.common.atomic_write import atomic_write
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.status import Status
from hbgear.design.studies.processes import executor_of
from hbgear.harmonic.structure.recession import Receded
from studies.random import truth
from studies.random.machines import Machine, machine
from studies.random.truth import ComparedJump, ComparedPoint, Comparison, Verdict

STORE = Path(__file__).parent / ".store"

SECONDS = 600.0
"""Processor time [s] after which a machine is interrupted, and counts as one that does not end."""

ASYMPTOTE_TOLERANCE = 1e-3
"""Distance from +1 of a multiplier of the machine without gaps [-], in the direction of the last point of a curve."""


@dataclass(frozen=True)
class TraceEnd:
    """End of a trace: status, points, seconds, special points, and contradictions of the status or the exception."""

    machine: str
    status: str
    points: int
    seconds: float
    special: int
    contradictions: str = ""


@dataclass(frozen=True)
class Results:
    """All traces and comparisons; processor time [s] of all processes."""

    ended: list[TraceEnd]
    compared: list[Comparison]
    seconds: float


# ---- one machine


def trace_end(it: Machine) -> TraceEnd:
    """Trace a machine by the default call, and check its status."""
    begun = time.process_time()
    try:
        with _limited(SECONDS):
            branch = truth.traced(it, 16)
    except (Exception, KeyboardInterrupt) as error:
        return TraceEnd(it.name, type(error).__name__, 0, time.process_time() - begun, 0, str(error))
    seconds = time.process_time() - begun
    special = sum(len(one.special) for one in truth.curves(branch))
    points = sum(map(len, truth.curves(branch)))
    return TraceEnd(it.name, str(branch.status), points, seconds, special, "; ".join(contradictions(it, branch)))


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Interrupt a computation like Ctrl-C after a processor time, on platforms with such timers."""
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


def contradictions(it: Machine, branch: Branch) -> Iterator[str]:
    """Yield contradictions of the status of a branch and the other branches of its span."""
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
        yield f"covers {covered:.3f} of {abs(it.span[1] - it.span[0]):.3f} without a message"


def _ending(it: Machine, one: Branch) -> Iterator[str]:
    """Yield contradictions between the end of a curve and its status."""
    last, status = float(one.values[-1]), one.status
    if status is Status.REACHED_END and not np.isclose(last, it.span, rtol=1e-9).any():
        yield f"reached_end at {last:.6g}"
    if status is Status.LEFT_SPAN and not np.isclose(last, it.span, rtol=1e-9).any():
        yield f"left_span at {last:.6g}"
    if status is Status.CLOSED and np.linalg.norm(one.X[-1] - one.X[0]) > 1e-6 * np.linalg.norm(one.X[0]):
        yield "closed, but does not end where it began"
    for end, far in one.unbounded_ends:
        direction = one.X[end]
        with warnings.catch_warnings(action="ignore"):  # nothing excites it
            far_off = hb.HarmonicBalance(Receded(it.model), one.problem.H)
        mu = far_off.multipliers(direction / np.abs(direction).max(), Omega=far)
        apart = np.abs(mu - 1).min()
        if apart > ASYMPTOTE_TOLERANCE:
            yield f"runs off to infinity at {far:.6g}, where the nearest multiplier is {apart:.1e} from +1"
    if not status.complete:
        yield f"{status}: {one.message}"


def _covered(branch: Branch) -> list[tuple[float, float]]:
    """Return the ranges of Omega that the curves cover, without overlap; an unbounded curve ends at its asymptote."""
    ends = [[*one.values, *one.asymptotes.values()] for one in truth.curves(branch)]
    out: list[tuple[float, float]] = []
    for low, high in sorted((min(x), max(x)) for x in ends):
        if out and low <= out[-1][1] + 1e-6:
            out[-1] = out[-1][0], max(high, out[-1][1])
        else:
            out.append((low, high))
    return out


def comparison_of(it: Machine) -> Comparison:
    """Compare a machine with the references; `trace_end` reports machines that cannot be traced."""
    try:
        with _limited(10 * SECONDS):
            return truth.compare(it)
    except (Exception, KeyboardInterrupt) as error:
        print(f"{it.name}: {type(error).__name__}: {error}", file=sys.stderr)
        return Comparison(it.name)


# ---- all of them


def work(kind: str, first: int, count: int, compare: bool) -> list[dict[str, Any]]:
    """Return the results of some machines of a kind as JSON."""
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore")
        return [
            asdict((comparison_of if compare else trace_end)(machine(kind, i))) for i in range(first, first + count)
        ]


def collect(traced: Mapping[str, int], compared: Mapping[str, int], processes: int, store: Path | None) -> Results:
    """Trace and compare a number of machines of each kind, or read stored results.

    store : folder of results, None to store nothing. A larger run finds the results of a smaller one.
    """
    tasks = [
        (kind, first, min(25, count - first), False) for kind, count in traced.items() for first in range(0, count, 25)
    ]
    tasks += [(kind, i, 1, True) for kind, count in compared.items() for i in range(count)]
    begun, known = time.perf_counter(), {task: _stored(store, task) for task in tasks}
    todo = [task for task in tasks if known[task] is None]
    if todo:
        truth.traced(machine("spur", 1), 16)  # compiles the kernels, whose time belongs to no machine
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
    ended = [TraceEnd(**row) for task, row in rows if not task[3]]
    comparisons = [_comparison(row) for task, row in rows if task[3]]
    return Results(ended, comparisons, sum(x.seconds for x in (*ended, *comparisons)))


def _in_parallel(pool: Executor, todo: list[Any]) -> Iterator[tuple[Any, list[dict[str, Any]]]]:
    running = {pool.submit(work, *task): task for task in todo}
    for future in as_completed(running):
        yield running[future], future.result()


def _comparison(row: dict[str, Any]) -> Comparison:
    parts = (("points", ComparedPoint), ("verdicts", Verdict), ("jumps", ComparedJump))
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
        with atomic_write(_path(store, task), "w", encoding="utf-8") as handle:
            json.dump(rows, handle)
    return rows


def _path(store: Path, task: tuple[str, int, int, bool]) -> Path:
    kind, first, count, compare = task
    return store / f"{kind}-{first}-{count}-{'compared' if compare else 'traced'}.json"


def collected(name: str, traced: Mapping[str, int], compared: Mapping[str, int], quick: bool = False) -> Results:
    """`collect` for a study; ``quick``: one machine of each kind, and the first of the first kind compared."""
    if quick:
        return collect(dict.fromkeys(traced, 1), {next(iter(traced)): 1}, 1, None)
    from studies.__main__ import fingerprint

    return collect(traced, compared, os.cpu_count() or 1, STORE / fingerprint(name)[:12])
