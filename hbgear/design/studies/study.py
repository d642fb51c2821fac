"""Many cases of a model: each a response curve, of which some numbers are kept.

    case i:  the model with the values of row i of a `Grid` or `Sample`  ->  peak, jumps, curve, critical values

Cases run in any `concurrent.futures.Executor`, by default in processes of one BLAS thread each. Each is stored as soon
as it is done; a study started again goes on where it stopped. A case that fails is a row with its reason. If the
executor itself fails, or the disk, the study ends early and says why.
"""

from __future__ import annotations

import csv
import errno
import json
import os
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from functools import lru_cache, partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from hbgear.analysis.critical_parameters import NoFoldError, critical_parameter
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.text.messages import did_you_mean
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.tracing.trace import trace
from hbgear.design.studies.processes import executor_of
from hbgear.design.studies.samples import Grid, Sample
from hbgear.design.studies.store import Result, Store, key_of
from hbgear.harmonic.bifurcations.peaks import locate_peaks
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.io.branches.npz import packed, unpacked
from hbgear.mechanics.fields import made
from hbgear.mechanics.model_lookup import find_model_class, reference_of
from hbgear.mechanics.models import Model, describe
from hbgear.mechanics.plausibility import ImplausibleInputWarning

MANY = 1_000_000
"""More cases than this are refused unless asked for."""


KINDS = ("peak", "jumps", "curve", "branch")


_AHEAD = 256  # groups of cases handed to the executor before the first of them is done


_TOGETHER = 0.2  # seconds of cases that are handed over as one, for each way there and back takes a millisecond


_LONG = 1.0  # seconds after which a group of cases that take longer than those before is handed back, done or not


class Outcome(StrEnum):
    """Why a study ended."""

    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    CANNOT_STORE = "cannot_store"
    WORKERS_LOST = "workers_lost"


@dataclass(frozen=True)
class Work:
    """What is computed of each case.

    Parameters
    ----------
    compute : tuple of str, optional
        Some of "peak" (largest peak), "jumps" (of slow sweeps), "curve" (amplitude and stability over Omega), "branch"
        (all there is to know of the curve, for `Cases.branch`; some hundred kB for each case).
    critical : tuple of str, optional
        Parameters whose critical values are sought.
    harmonics, span, measure, element : int, optional
        As of `HarmonicBalance`, `trace` and `Branch.amplitude`.
    """

    compute: tuple[str, ...] = ("peak", "jumps")
    critical: tuple[str, ...] = ()
    harmonics: int = 16
    span: tuple[float, float] = (0.5, 1.5)
    measure: str = "pp2"
    element: int | str = 0

    def __post_init__(self) -> None:
        for kind in self.compute:
            if kind not in KINDS:
                raise ValueError(f"cannot compute '{kind}'{did_you_mean(kind, KINDS)}")
        if not (self.compute or self.critical):
            raise ValueError(f"nothing to compute; choose of {', '.join(KINDS)} or name a critical parameter")


@dataclass(frozen=True, eq=False)
class Cases:
    """The results of a study.

    Parameters
    ----------
    model, work : Model
        What was varied from, and what was computed.
    names : tuple of str
        Parameters that vary.
    table : dict of str to Any
        Columns by name, one row for each case done: case, the parameters, the numbers, reason, seconds.
    jumps : ndarray, shape (J, 5)
        Case, Omega, direction (+1 while Omega rises), amplitude before, amplitude after (nan if none).
    curves : dict of int to ndarray
        By case, (3, P) Omega, amplitude and stability (1 or 0); with "curve" only.
    total, outcome, message : int
        Cases there are, and why the study ended.
    values : mapping of int, Mapping[str to Any]
        By case, the values that vary, as the model takes them.
    packed : callable
        Of a case, the bytes of its branch; see `branch`.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> two = hb.design.grid(zeta=[0.05, 0.2])
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), two, ("peak",), harmonics=1, span=(0.9, 1.4), executor=here)
    ...
    >>> found.table["zeta"].tolist()
    [0.05, 0.2]
    """

    model: Model
    work: Work
    names: tuple[str, ...]
    table: dict[str, Any]
    jumps: Array
    curves: dict[int, Array]
    total: int
    outcome: Outcome
    message: str
    values: Mapping[int, Mapping[str, Any]]
    packed: Callable[[int], bytes]

    def __len__(self) -> int:
        return len(self.table["case"])

    def __repr__(self) -> str:
        done = f"{len(self)} of {self.total} done" + (f", {len(self.failed)} failed" if self.failed else "")
        return f"<Cases of {type(self.model).__name__} in {', '.join(self.names)}: {done}>"

    @property
    def failed(self) -> dict[int, str]:
        """Reason of each case that failed."""
        pairs = zip(self.table["case"], self.table["reason"], strict=True)
        return {int(case): str(reason) for case, reason in pairs if reason}

    def model_of(self, case: int) -> Model:
        """The model of a case.

        Raises
        ------
        KeyError
            If the case was not computed.
        """
        if case not in self.values:
            raise KeyError(f"case {case} was not computed; {len(self)} of {self.total} are there, see table['case']")
        return self.model.replace(**self.values[case])

    def branch(self, case: int) -> Branch:
        """The response curve of a case as `trace` gave it; with "branch" only.

        Raises
        ------
        KeyError
            If the case was not computed or failed, or branches were not asked for.
        ValueError
            If its file was damaged since.
        """
        if case in self.failed:
            raise KeyError(f"case {case} failed: {self.failed[case]}")
        if "branch" not in self.work.compute:
            raise KeyError('no branches were kept; ask for them: compute=("branch",)')
        problem = HarmonicBalance(self.model_of(case), self.work.harmonics)
        try:
            return unpacked(self.packed(case), problem)
        except (OSError, ValueError) as error:
            raise ValueError(f"the branch of case {case} cannot be read ({error}); run the study again") from error

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the table (.csv), or the table, jumps and curves as arrays (.npz); whole or not at all."""
        suffix = Path(path).suffix.lower()
        if suffix == ".csv":
            with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
                writer = csv.writer(handle)
                writer.writerow(self.table)
                writer.writerows(zip(*(column.tolist() for column in self.table.values()), strict=True))
        elif suffix == ".npz":
            rows = [np.vstack([np.full(curve.shape[1], case), curve]).T for case, curve in self.curves.items()]
            curves = np.concatenate(rows) if rows else np.empty((0, 4))
            with atomic_write(path) as handle:
                np.savez(handle, jump_table=self.jumps, curve_table=curves, **self.table)
        else:
            raise ValueError(f"'{path}' must end in .csv or .npz")


@checked_arguments(vary="what varies, such as grid(zeta=[0.05, 0.06])")
def cases(
    model: Model,
    vary: Grid | Sample,
    compute: tuple[str, ...] = ("peak", "jumps"),
    *,
    critical: tuple[str, ...] = (),
    harmonics: int = 16,
    span: tuple[float, float] | None = None,
    measure: str = "pp2",
    element: int | str = 0,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | None = None,
    processes: int | None = None,
    retry: bool = False,
    most: int = MANY,
    progress: ProgressCallback | None = None,
) -> Cases:
    """Compute every case of a grid or sample.

    In a script, call it under ``if __name__ == "__main__":``; the processes import the script.

    Parameters
    ----------
    model : Model
        Gives the values that do not vary.
    vary : Grid or Sample
        `grid`, `latin_hypercube`, `monte_carlo` or `saltelli`.
    compute, critical, harmonics, span, measure, element : tuple of str, optional
        See `Work`; the span is the model's by default.
    store : path-like or None, optional
        Folder for finished cases; without one nothing is kept when the study is killed.
    executor : Executor or None, optional
        Where the cases run (it is not shut down); by default ``processes`` processes, one for each core.
    retry : bool, default False
        Compute stored cases that failed once more.
    most : int, optional
        Largest number of cases.
    progress : ProgressCallback or None, optional
        Called with a `Progress`, such as ``print``.

    Raises
    ------
    KeyError, ValueError
        If the model has no such field, a setting is wrong, there are too many cases, or the store is of another study.
    OSError
        If there is something to compute and the store cannot be written.
    RuntimeError
        If a script calls it without the line named above.

    Notes
    -----
    Stored cases that cannot be read are computed anew, with a warning.

    Examples
    --------
    >>> import hbgear as hb
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> two = hb.design.grid(zeta=[0.05, 0.2])
    >>> with ThreadPoolExecutor(1) as here:
    ...     found = hb.design.cases(hb.Duffing(), two, ("jumps",), harmonics=1, span=(0.9, 1.4), executor=here)
    ...
    >>> found.failed
    {}
    """
    low, high = model.default_span if span is None else span
    work = Work(tuple(compute), tuple(critical), harmonics, (float(low), float(high)), measure, element)
    _check(model, vary, work, most)
    described = {name: describe(model)[name] for name in ("class", "fields")}
    study = {"model": described, **json.loads(json.dumps(asdict(work)))}
    folder = None if store is None else Store(store, study)
    rows = list(vary.rows())
    keys = [key_of(_inputs(study, row)) for row in rows]
    run = _Run(study, folder, len(set(keys)), progress)
    if folder:
        for key, found in _stored(folder, dict.fromkeys(keys), work).items():
            if not (retry and found.reason):
                run.add(key, found)
    waiting = {key: row for key, row in zip(keys, rows, strict=True) if key not in run.done}
    if folder and waiting:
        folder.check_writable()
    outcome, message = Outcome.FINISHED, "every case was computed"
    if waiting:
        try:
            with executor_of(executor, processes, len(waiting)) as pool:
                outcome, message = run.compute(pool, reference_of(type(model)), waiting, work)
        except KeyboardInterrupt:  # once more, while the last cases were waited for, or before the first
            outcome, message = Outcome.INTERRUPTED, f"interrupted; {run.kept}"
    branch_of = partial(_packed_of, folder, run.done, keys)
    return _collect(model, work, vary.names, rows, keys, run.done, outcome, message, branch_of)


def run_case(cls: type[Model] | str, fields: Mapping[str, Any], work: Work) -> Result:
    """One case, in whatever process: its numbers, or the reason why there are none.

    cls : the class of the model, or the name of a file and it, as of `reference_of`.
    """
    started = time.perf_counter()
    try:
        result = _computed(made(find_model_class(cls) if isinstance(cls, str) else cls, _as_fields(fields)), work)
        return replace(result, seconds=time.perf_counter() - started)
    except Exception as error:  # whatever is wrong with one case must not end the others
        text = error.args[0] if error.args else type(error).__name__
        known = isinstance(error, ValueError | KeyError)
        reason = str(text) if known else f"{type(error).__name__}: {text}"
        return Result(reason=" ".join(reason.split()), seconds=time.perf_counter() - started)


def _run_cases(cls: type[Model] | str, group: Sequence[Mapping[str, Any]], work: Work) -> list[Result]:
    """The first cases of a group, all of them but where they take long, each on one thread."""
    started, results = time.perf_counter(), list[Result]()
    with _libraries(len(sys.modules)).limit(limits=1), warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", ImplausibleInputWarning
        )  # what is to be said of the model was said before the first case
        for fields in group:
            results.append(run_case(cls, fields, work))
            if time.perf_counter() - started > _LONG:
                break
    return results


@lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """The libraries with threads of their own that are loaded now; there are others only if there are other modules."""
    return ThreadpoolController()


def _computed(model: Model, work: Work) -> Result:
    numbers: dict[str, float] = {}
    arrays: dict[str, Array] = {}
    packed_branch = b""
    problem = HarmonicBalance(model, work.harmonics)
    if work.compute:
        stability = set(work.compute) != {"peak"}
        branch = raise_if_interrupted(
            trace(problem, "Omega", work.span, stability=stability, special=stability, cover=False, accuracy=None)
        )
        if branch.status != Status.REACHED_END:
            raise ValueError(f"the curve ended early: {branch.message}")
        for kind, take in _OF_CURVE.items():
            if kind in work.compute:
                take(branch, work, numbers, arrays)
        if "branch" in work.compute:
            packed_branch = packed(branch)
    for name in work.critical:
        try:
            found = critical_parameter(problem, name, frequencies=work.span)
            if found.status is Status.INTERRUPTED:
                raise KeyboardInterrupt
            numbers |= {f"critical_{name}": found.value, f"critical_{name}_Omega": found.Omega}
        except NoFoldError:
            numbers |= {f"critical_{name}": np.nan, f"critical_{name}_Omega": np.nan}
    return Result(numbers, arrays, packed_branch)


def _peak(branch: Branch, work: Work, numbers: dict[str, float], arrays: dict[str, Array]) -> None:
    """The largest peak, located on the curve, or its end if the curve is largest there."""
    rows = [found.row for *_, found in locate_peaks(branch, work.measure, work.element, share=0.99)]
    A = _amplitudes(branch, work, [*(row.X for row in rows), *branch.X[[0, -1]]])
    largest = int(np.argmax(A))
    Omega = [*(row.value for row in rows), *branch.values[[0, -1]].tolist()]
    numbers |= {"peak": A[largest], "peak_Omega": Omega[largest]}


def _amplitudes(branch: Branch, work: Work, X: Sequence[Array]) -> list[float]:
    """Of motions with the unknowns of a branch; a measure of several takes hardly longer than of one."""
    layout = layout_of(branch)
    assert layout is not None  # of a harmonic balance
    A: list[float] = layout.measure(work.measure, np.array(X), work.element).tolist()
    return A


def _jumps(branch: Branch, work: Work, numbers: dict[str, float], arrays: dict[str, Array]) -> None:
    """All jumps, and of each direction the frequency of the one with the greatest change of amplitude."""
    jumps = branch.jumps()
    ends = [point for jump in jumps for point in (jump.before, jump.after) if point is not None]
    known = iter(_amplitudes(branch, work, [point.X for point in ends]) if ends else [])
    rows = [[jump.value, jump.direction, next(known), np.nan if jump.after is None else next(known)] for jump in jumps]
    arrays["jumps"] = np.array(rows, dtype=float).reshape(-1, 4)
    numbers["jumps"] = float(len(rows))
    for name, direction in (("jump_rising", 1), ("jump_falling", -1)):
        mine = [row for row in rows if row[1] == direction]
        top = max(mine, key=lambda row: np.nan_to_num(abs(row[3] - row[2])), default=None)
        numbers[name] = np.nan if top is None else float(top[0])


def _curve(branch: Branch, work: Work, numbers: dict[str, float], arrays: dict[str, Array]) -> None:
    assert branch.stable is not None
    arrays["curve"] = np.array([branch.values, branch.amplitude(work.measure, work.element), branch.stable])


_OF_CURVE = {"peak": _peak, "jumps": _jumps, "curve": _curve}


def _packed_of(folder: Store | None, done: Mapping[str, Result], keys: list[str], case: int) -> bytes:
    """The packed branch of a case: from its file, or from memory if there is no store."""
    key = keys[case]
    return folder.branch(key) if folder else done[key].branch


def _stored(folder: Store, keys: Iterable[str], work: Work) -> dict[str, Result]:
    """The cases that are in the store; of those that cannot be read a warning is given, to be computed anew."""
    found, lost = {}, []
    for key in keys:
        try:
            result = folder.read(key)
            if result is not None:
                _check_result(result, work)
                found[key] = result
        except (OSError, ValueError) as error:
            lost.append(f"'{folder.path(key)}': {error}")
    if lost:
        text = f"{len(lost)} stored case{'s' if len(lost) > 1 else ''} cannot be read and will be computed anew"
        warnings.warn(f"{text} ({lost[0]}{', ...' if lost[1:] else ''})", stacklevel=3)
    return found


def _check_result(result: Result, work: Work) -> None:
    """Refuse a result that is not one of this work."""
    if result.reason:
        return
    made_of = {"jumps": (-1, 4), "curve": (3, -1)}
    for kind, (rows, columns) in made_of.items():
        if kind in work.compute:
            array = result.arrays.get(kind, np.empty(0))
            if array.ndim != 2 or rows not in (-1, array.shape[0]) or columns not in (-1, array.shape[1]):
                raise ValueError(f"it has no {kind}")
    if "branch" in work.compute and not result.has_branch:
        raise ValueError("it has no branch")
    needed = [kind for kind in ("peak", "jumps") if kind in work.compute]
    for name in (*needed, *(f"critical_{name}" for name in work.critical)):
        if name not in result.numbers:
            raise ValueError(f"it has no number '{name}'")


class _NotStored(Exception):
    """A finished case could not be written."""

    def __init__(self, reason: OSError) -> None:
        full = reason.errno in (errno.ENOSPC, errno.EDQUOT)
        advice = "free some space" if full else "see to the folder"
        super().__init__(f"a case could not be stored ({reason}); {advice}")


class _Lost(Exception):
    """The executor did not bring back a case: a process, a worker or the scheduler is gone."""

    def __init__(self, reason: Exception) -> None:
        kind = type(reason).__name__
        if isinstance(reason, BrokenExecutor):
            text = f"a process died, killed or out of memory ({reason})"
        elif isinstance(reason, CancelledError):
            text = "the executor dropped a case; its scheduler may be gone"
        else:
            text = f"the executor gave a case up ({kind}: {' '.join(str(reason).split())})"
        super().__init__(text)


class _Run:
    """State of one study while it runs: results by key, and where they are stored."""

    def __init__(
        self, study: Mapping[str, Any], folder: Store | None, total: int, progress: ProgressCallback | None
    ) -> None:
        self.study, self.folder, self.total, self.progress = study, folder, total, progress
        self.done: dict[str, Result] = {}
        self.failed: set[str] = set()

    def add(self, key: str, result: Result) -> None:
        """Count a case as done."""
        self.done[key] = result
        if result.reason:
            self.failed.add(key)

    @property
    def kept(self) -> str:
        """Where what is done can be found."""
        return "everything done is kept; run it again to go on" if self.folder else "what is done is in the result"

    def compute(
        self, pool: Executor, cls: type[Model] | str, waiting: Mapping[str, dict[str, Any]], work: Work
    ) -> tuple[Outcome, str]:
        """Run what is waiting, values by key, and store each case as it finishes; how that ended.

        Ctrl-C waits for the cases at work; once more, and it is raised.
        """
        running: dict[Future[list[Result]], list[str]] = {}
        try:
            try:
                self._compute(pool, cls, waiting, work, running)
            except KeyboardInterrupt:
                self._finish(running, waiting)
                return Outcome.INTERRUPTED, f"interrupted; {self.kept}"
            except _Lost as failure:
                self._finish(running, waiting, patience=0.0)
                return Outcome.WORKERS_LOST, f"{failure}; {self.kept}"
            return Outcome.FINISHED, "every case was computed"
        except _NotStored as failure:
            for future in running:
                future.cancel()
            return Outcome.CANNOT_STORE, f"{failure}; what was stored before is kept; run it again to go on"

    def _compute(
        self, pool: Executor, cls: type[Model] | str, waiting: Mapping[str, dict[str, Any]], work: Work,
        running: dict[Future[list[Result]], list[str]],
    ) -> None:  # fmt: skip
        """Every case, some hundred groups handed out ahead; ``running`` holds those that are not done yet."""
        queue, done, together = deque(waiting), SimpleQueue[Future[list[Result]]](), 1
        self._show()
        while True:
            while len(running) < _AHEAD and queue:
                keys = [queue.popleft() for _ in range(min(together, len(queue)))]
                future = _submitted(pool, cls, [_inputs(self.study, waiting[key])["fields"] for key in keys], work)
                running[future] = keys
                future.add_done_callback(done.put)  # `wait` for the first of hundreds takes a while for each
            if not running:
                return
            future = done.get()
            results = _result(future)
            self._keep(running[future], waiting, results)
            queue.extend(running.pop(future)[len(results) :])
            together = min(max(int(_TOGETHER / max(1e-6, *(result.seconds for result in results))), 1), _AHEAD)

    def _finish(
        self, running: Mapping[Future[list[Result]], list[str]], waiting: Mapping[str, dict[str, Any]],
        patience: float | None = None,
    ) -> None:  # fmt: skip
        """Keep the cases that could not be cancelled any more, those done within ``patience`` seconds."""
        left = [future for future in running if not future.cancel()]
        for future in wait(left, timeout=patience).done:
            if not future.cancelled() and future.exception() is None:
                self._keep(running[future], waiting, future.result())

    def _keep(self, keys: Sequence[str], waiting: Mapping[str, dict[str, Any]], results: Sequence[Result]) -> None:
        """Keep the cases of a group that were done, its first ones."""
        for key, result in zip(keys, results, strict=False):
            self.add(key, result)
            if self.folder:
                try:
                    self.folder.write(key, _inputs(self.study, waiting[key]), result)
                except OSError as error:
                    raise _NotStored(error) from error
                self.add(key, replace(result, branch=b""))  # a branch is large, and in the file
            self._show()

    def _show(self) -> None:
        if self.progress:
            finished, failed = len(self.done), len(self.failed)
            text = f"{finished} of {self.total}" + (f", {failed} failed" if failed else "")
            numbers = {"finished": finished, "total": self.total, "failed": failed}
            self.progress(Progress(finished / max(self.total, 1), text, numbers))


def _submitted(
    pool: Executor, cls: type[Model] | str, group: Sequence[Mapping[str, Any]], work: Work
) -> Future[list[Result]]:
    try:
        return pool.submit(_run_cases, cls, group, work)
    except Exception as error:
        raise _Lost(error) from error


def _result(future: Future[list[Result]]) -> list[Result]:
    """What a group gave. `run_case` raises nothing, so what is raised here comes from the executor."""
    try:
        return future.result()
    except Exception as error:
        raise _Lost(error) from error


def _check(model: Model, vary: Grid | Sample, work: Work, most: int) -> None:
    """Refuse before the work what cannot work."""
    if vary.size > most:
        raise ValueError(f"{vary.size:,} cases, more than {most:,}; make the grid coarser, or ask for it with most=")
    fields = describe(model)["fields"]
    known = [*model.entries, *(model.parameters if isinstance(vary, Sample) else fields)]
    for name in vary.names:
        if name not in known:
            raise KeyError(f"{type(model).__name__} has no parameter '{name}'{did_you_mean(name, known)}")
    check_work(model, work)


def check_work(model: Model, work: Work) -> None:
    """Refuse what cannot be computed for any design: a span, a measure, an element or a critical parameter.

    Raises
    ------
    ValueError, KeyError
    """
    problem = HarmonicBalance(model, work.harmonics)
    problem.check_trace("Omega", min(work.span), max(work.span), {})
    problem.layout.check_measure(work.measure, work.element)
    for name in work.critical:
        problem.check_parameter(name)


def _inputs(study: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, Any]:
    return {**study, "model": study["model"]["class"], "fields": {**study["model"]["fields"], **row}}


def _as_fields(values: Mapping[str, Any]) -> dict[str, Any]:
    """Plain data as a model takes it: lists, of which JSON and TOML are made, as tuples."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


def _collect(
    model: Model, work: Work, names: tuple[str, ...], plan: list[dict[str, Any]], keys: list[str],
    done: Mapping[str, Result], outcome: Outcome, message: str, packed: Callable[[int], bytes],
) -> Cases:  # fmt: skip
    """The table of what is done, in the order of the plan."""
    rows = [(i, plan[i], done[key]) for i, key in enumerate(keys) if key in done]
    table: dict[str, Any] = {"case": np.array([i for i, *_ in rows], dtype=int)}
    table |= {name: np.array([_cell(values[name]) for _, values, _ in rows]) for name in names}
    columns = dict.fromkeys(name for *_, result in rows for name in result.numbers)
    table |= {name: np.array([result.numbers.get(name, np.nan) for *_, result in rows]) for name in columns}
    table["reason"] = np.array([result.reason for *_, result in rows], dtype=str)
    table["seconds"] = np.array([result.seconds for *_, result in rows], dtype=float)
    jumps = [[i, *row] for i, _, result in rows for row in result.arrays.get("jumps", ())]
    curves = {i: result.arrays["curve"] for i, _, result in rows if "curve" in result.arrays}
    jump_rows = np.array(jumps, dtype=float).reshape(-1, 5)
    values = {i: _as_fields(row) for i, row, _ in rows}
    return Cases(model, work, names, table, jump_rows, curves, len(plan), outcome, message, values, packed)


def _cell(value: Any) -> Any:
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else value
