"""Studies of many cases of a model: numbers of one response curve for each case.

    case i:  the model with the values of case i of a `Grid` or `Sample`  ->  peak, jumps, curve, critical values

Cases run in a `concurrent.futures.Executor`, by default in processes with one BLAS thread each. Each case is stored
when it is finished. A study that is started again computes the missing cases. A case that fails is listed with the
reason. If the executor or the disk fails, the study ends early with a message.
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
from hbgear.harmonic.models.model_registry import fields_from_plain
from hbgear.io.branches.npz import packed, unpacked
from hbgear.mechanics.fields import made
from hbgear.mechanics.model_lookup import find_model_class, reference_of
from hbgear.mechanics.models import Model, describe
from hbgear.mechanics.plausibility import ImplausibleInputWarning

MANY = 1_000_000
"""Default limit of the number of cases."""

KINDS = ("peak", "jumps", "curve", "branch")
"""Results of a case that `Work.compute` may list."""

_MAX_PENDING_GROUPS = 256
"""Largest number of groups that are submitted to the executor and not finished; also the largest size of a group."""

_GROUP_SECONDS = 0.2
"""Computing time of a group of cases [s]. The transfer of a group to a process and back takes about a millisecond."""

_MAX_GROUP_SECONDS = 1.0
"""Computing time [s] after which a group returns its finished cases; the others are submitted again."""


class Outcome(StrEnum):
    """Reason for the end of a study."""

    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    CANNOT_STORE = "cannot_store"
    WORKERS_LOST = "workers_lost"


@dataclass(frozen=True)
class Work:  # numpydoc ignore=PR02
    """Results to compute for each case.

    Parameters
    ----------
    compute : tuple of str, default ("peak", "jumps")
        Kinds of results: "peak" (largest peak), "jumps" (of slow sweeps), "curve" (amplitude and stability over Omega)
        and "branch" (complete curve for `Cases.branch`, a few hundred kB for each case).
    critical : tuple of str, default ()
        Parameters whose critical values are computed.
    harmonics : int, default 16
        Harmonic truncation order.
    span : tuple[float, float], default (0.5, 1.5)
        Span of Omega.
    measure, element : str and int or str, optional
        Measure ("pp2" by default) and element (0 by default) of `Branch.amplitude`.

    Raises
    ------
    ValueError
        If a kind is unknown or there is nothing to compute.
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
            raise ValueError(f"nothing to compute; give some of {', '.join(KINDS)}, or a critical parameter")


@dataclass(frozen=True, eq=False)
class Cases:
    """Results of a study.

    Attributes
    ----------
    model : Model
        Model with the values that do not vary.
    work : Work
        Computed results.
    names : tuple of str
        Names of the parameters that vary.
    table : dict of str to ndarray
        Columns by name, with one entry for each computed case: case, parameters, numbers, reason of a failure, and
        computing time in seconds.
    jumps : ndarray, shape (J, 5)
        Case, Omega, direction (+1 for rising Omega), amplitude before and amplitude after (nan if unknown).
    curves : dict of int to ndarray, shape (3, P)
        Omega, amplitude and stability (1 or 0) by case; only with "curve".
    total : int
        Number of cases of the study.
    outcome, message : Outcome and str
        Reason for the end of the study.
    values : mapping of int to mapping of str to Any
        Values of the varying parameters by case, in the types of the model.
    packed : callable
        Function that returns the bytes of the branch of a case; see `branch`.

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
        """Reason of failure by case."""
        pairs = zip(self.table["case"], self.table["reason"], strict=True)
        return {int(case): str(reason) for case, reason in pairs if reason}

    def model_of(self, case: int) -> Model:
        """Return the model of a case.

        Raises
        ------
        KeyError
            If the case was not computed.
        """
        if case not in self.values:
            raise KeyError(
                f"case {case} was not computed; table['case'] lists the {len(self)} of {self.total} computed cases"
            )
        return self.model.replace(**self.values[case])

    def branch(self, case: int) -> Branch:
        """Return the response curve of a case; only with "branch".

        Raises
        ------
        KeyError
            If the case was not computed or failed, or "branch" was not computed.
        ValueError
            If the file of the case is damaged.
        """
        if case in self.failed:
            raise KeyError(f"case {case} failed: {self.failed[case]}")
        if "branch" not in self.work.compute:
            raise KeyError('no branches were stored; compute them: compute=("branch",)')
        problem = HarmonicBalance(self.model_of(case), self.work.harmonics)
        try:
            return unpacked(self.packed(case), problem)
        except (OSError, ValueError) as error:
            raise ValueError(f"the branch of case {case} cannot be read ({error}); run the study again") from error

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the table (.csv), or the table, jumps and curves as arrays (.npz), atomically."""
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


@checked_arguments(vary="cases, such as grid(zeta=[0.05, 0.06])")
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

    A script must call this function under ``if __name__ == "__main__":``, because the processes import the script.

    Parameters
    ----------
    model : Model
        Model with the values that do not vary.
    vary : Grid or Sample
        Cases from `grid`, `latin_hypercube`, `monte_carlo` or `saltelli`.
    compute : tuple of str, default ("peak", "jumps")
        Kinds of results: some of "peak", "jumps", "curve" and "branch"; see `Work`.
    critical : tuple of str, default ()
        Parameters whose critical values are computed.
    harmonics : int, default 16
        Harmonic truncation order.
    span : tuple[float, float] or None, optional
        Span of Omega. Default: the span of the model.
    measure, element : str and int or str, optional
        Measure ("pp2" by default) and element (0 by default) of `Branch.amplitude`.
    store : path-like or None, optional
        Folder for finished cases. Default None: finished cases are lost if the study is killed.
    executor : Executor or None, optional
        Executor of the cases, which is not shut down. Default None: processes.
    processes : int or None, optional
        Number of processes. Default None: the number of cores.
    retry : bool, default False
        True to compute stored cases that failed again.
    most : int, default 1000000
        Largest number of cases.
    progress : ProgressCallback or None, optional
        Function that is called with a `Progress`, such as ``print``.

    Returns
    -------
    Cases
        Results of the finished cases.

    Raises
    ------
    KeyError, ValueError
        If the model has no such field, a setting is not valid, there are too many cases, or the store belongs to
        another study.
    OSError
        If there are cases to compute and the store cannot be written.
    RuntimeError
        If a script calls this function without the line stated above.

    Notes
    -----
    Stored cases that cannot be read are computed again, with a warning.

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
        except KeyboardInterrupt:  # a second one, while running cases were finishing, or one before the first case
            outcome, message = Outcome.INTERRUPTED, f"interrupted; {run.kept}"
    branch_of = partial(_packed_of, folder, run.done, keys)
    return _collect(model, work, vary.names, rows, keys, run.done, outcome, message, branch_of)


def run_case(cls: type[Model] | str, fields: Mapping[str, Any], work: Work) -> Result:
    """Compute one case, in any process; return its numbers, or the reason of the failure.

    Parameters
    ----------
    cls : type or str
        Class of the model, or its reference from `reference_of`.
    fields : mapping of str to Any
        Values of the fields of the model.
    work : Work
        Results to compute.

    Returns
    -------
    Result
        Result with computing time.
    """
    started = time.perf_counter()
    try:
        found = find_model_class(cls) if isinstance(cls, str) else cls
        result = _result_of(made(found, fields_from_plain(fields)), work)
        return replace(result, seconds=time.perf_counter() - started)
    except Exception as error:  # an error in one case must not end the others
        text = error.args[0] if error.args else type(error).__name__
        known = isinstance(error, ValueError | KeyError)
        reason = str(text) if known else f"{type(error).__name__}: {text}"
        return Result(reason=" ".join(reason.split()), seconds=time.perf_counter() - started)


def _run_cases(cls: type[Model] | str, group: Sequence[Mapping[str, Any]], work: Work) -> list[Result]:
    """Compute the cases of a group with one thread; return the finished ones if the others would take too long."""
    started, results = time.perf_counter(), list[Result]()
    with _libraries(len(sys.modules)).limit(limits=1), warnings.catch_warnings():
        warnings.simplefilter("ignore", ImplausibleInputWarning)  # was given before the first case
        for fields in group:
            results.append(run_case(cls, fields, work))
            if time.perf_counter() - started > _MAX_GROUP_SECONDS:
                break
    return results


@lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """Return the controller of the loaded threaded libraries; the number of modules changes if others are loaded."""
    return ThreadpoolController()


def _result_of(model: Model, work: Work) -> Result:
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
        for kind, take in _CURVE_RESULTS.items():
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
    """Store the largest amplitude and its frequency: a located peak, or an end of the curve."""
    rows = [found.point for *_, found in locate_peaks(branch, work.measure, work.element, share=0.99)]
    A = _amplitudes(branch, work, [*(row.X for row in rows), *branch.X[[0, -1]]])
    largest = int(np.argmax(A))
    Omega = [*(row.value for row in rows), *branch.values[[0, -1]].tolist()]
    numbers |= {"peak": A[largest], "peak_Omega": Omega[largest]}


def _amplitudes(branch: Branch, work: Work, X: Sequence[Array]) -> list[float]:
    """Return the amplitudes of motions of a branch, computed together."""
    layout = layout_of(branch)
    assert layout is not None  # a branch of a harmonic balance has a layout
    A: list[float] = layout.measure(work.measure, np.array(X), work.element).tolist()
    return A


def _jumps(branch: Branch, work: Work, numbers: dict[str, float], arrays: dict[str, Array]) -> None:
    """Store all jumps, and the frequency of the largest jump in each direction."""
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


_CURVE_RESULTS = {"peak": _peak, "jumps": _jumps, "curve": _curve}


def _packed_of(folder: Store | None, done: Mapping[str, Result], keys: list[str], case: int) -> bytes:
    """Return the packed branch of a case from its file, or from memory without a store."""
    key = keys[case]
    return folder.branch(key) if folder else done[key].branch


def _stored(folder: Store, keys: Iterable[str], work: Work) -> dict[str, Result]:
    """Return the stored cases by key; warn about cases that cannot be read."""
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
        text = f"{len(lost)} stored case{'s' if len(lost) > 1 else ''} cannot be read and will be computed again"
        warnings.warn(f"{text} ({lost[0]}{', ...' if lost[1:] else ''})", stacklevel=3)
    return found


def _check_result(result: Result, work: Work) -> None:
    """Raise an error for a result that does not contain the required numbers and arrays."""
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
    """A finished case cannot be written."""

    def __init__(self, reason: OSError) -> None:
        full = reason.errno in (errno.ENOSPC, errno.EDQUOT)
        advice = "free space on the disk" if full else "check the folder"
        super().__init__(f"a case could not be stored ({reason}); {advice}")


class _ExecutorFailed(Exception):
    """The executor did not return a case: a process, a worker or the scheduler has ended."""

    def __init__(self, reason: Exception) -> None:
        kind = type(reason).__name__
        if isinstance(reason, BrokenExecutor):
            text = f"a process died, killed or out of memory ({reason})"
        elif isinstance(reason, CancelledError):
            text = "the executor cancelled a case; its scheduler may have ended"
        else:
            text = f"the executor failed ({kind}: {' '.join(str(reason).split())})"
        super().__init__(text)


class _Run:
    """State of a running study: results by key and their store."""

    def __init__(
        self, study: Mapping[str, Any], folder: Store | None, total: int, progress: ProgressCallback | None
    ) -> None:
        self.study, self.folder, self.total, self.progress = study, folder, total, progress
        self.done: dict[str, Result] = {}
        self.failed: set[str] = set()

    def add(self, key: str, result: Result) -> None:
        """Add a finished case."""
        self.done[key] = result
        if result.reason:
            self.failed.add(key)

    @property
    def kept(self) -> str:
        """Text that states where the finished cases are."""
        return (
            "the finished cases are stored; run the study again to compute the others"
            if self.folder
            else "the result contains the finished cases"
        )

    def compute(
        self, pool: Executor, cls: type[Model] | str, waiting: Mapping[str, dict[str, Any]], work: Work
    ) -> tuple[Outcome, str]:
        """Compute the waiting cases, store each finished one, and return the reason for the end.

        Ctrl-C waits for the running cases; a second one raises KeyboardInterrupt.
        """
        running: dict[Future[list[Result]], list[str]] = {}
        try:
            try:
                self._compute(pool, cls, waiting, work, running)
            except KeyboardInterrupt:
                self._finish(running, waiting)
                return Outcome.INTERRUPTED, f"interrupted; {self.kept}"
            except _ExecutorFailed as failure:
                self._finish(running, waiting, patience=0.0)
                return Outcome.WORKERS_LOST, f"{failure}; {self.kept}"
            return Outcome.FINISHED, "every case was computed"
        except _NotStored as failure:
            for future in running:
                future.cancel()
            return (
                Outcome.CANNOT_STORE,
                f"{failure}; earlier cases are stored; run the study again to compute the others",
            )

    def _compute(
        self, pool: Executor, cls: type[Model] | str, waiting: Mapping[str, dict[str, Any]], work: Work,
        running: dict[Future[list[Result]], list[str]],
    ) -> None:  # fmt: skip
        """Submit groups of cases and store their results; ``running`` contains the groups that are not finished."""
        queue, done, group_size = deque(waiting), SimpleQueue[Future[list[Result]]](), 1
        self._show()
        while True:
            while len(running) < _MAX_PENDING_GROUPS and queue:
                keys = [queue.popleft() for _ in range(min(group_size, len(queue)))]
                future = _submitted(pool, cls, [_inputs(self.study, waiting[key])["fields"] for key in keys], work)
                running[future] = keys
                future.add_done_callback(done.put)  # faster than `wait` for the first of hundreds
            if not running:
                return
            future = done.get()
            results = _result(future)
            self._keep(running[future], waiting, results)
            queue.extend(running.pop(future)[len(results) :])
            slowest = max(1e-6, *(result.seconds for result in results))
            group_size = min(max(int(_GROUP_SECONDS / slowest), 1), _MAX_PENDING_GROUPS)

    def _finish(
        self, running: Mapping[Future[list[Result]], list[str]], waiting: Mapping[str, dict[str, Any]],
        patience: float | None = None,
    ) -> None:  # fmt: skip
        """Keep running cases that cannot be cancelled and finish within ``patience`` seconds."""
        left = [future for future in running if not future.cancel()]
        for future in wait(left, timeout=patience).done:
            if not future.cancelled() and future.exception() is None:
                self._keep(running[future], waiting, future.result())

    def _keep(self, keys: Sequence[str], waiting: Mapping[str, dict[str, Any]], results: Sequence[Result]) -> None:
        """Add and store the finished cases of a group, which are its first ones."""
        for key, result in zip(keys, results, strict=False):
            self.add(key, result)
            if self.folder:
                try:
                    self.folder.write(key, _inputs(self.study, waiting[key]), result)
                except OSError as error:
                    raise _NotStored(error) from error
                self.add(key, replace(result, branch=b""))  # a branch is large and stored in the file
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
        raise _ExecutorFailed(error) from error


def _result(future: Future[list[Result]]) -> list[Result]:
    """Return the results of a group. `run_case` raises nothing, so an error here comes from the executor."""
    try:
        return future.result()
    except Exception as error:
        raise _ExecutorFailed(error) from error


def _check(model: Model, vary: Grid | Sample, work: Work, most: int) -> None:
    """Raise an error for settings that are not valid, before the computation."""
    if vary.size > most:
        raise ValueError(f"{vary.size:,} cases, more than {most:,}; make the grid coarser, or allow them with most=")
    fields = describe(model)["fields"]
    known = [*model.entries, *(model.parameters if isinstance(vary, Sample) else fields)]
    for name in vary.names:
        if name not in known:
            raise KeyError(f"{type(model).__name__} has no parameter '{name}'{did_you_mean(name, known)}")
    check_work(model, work)


def check_work(model: Model, work: Work) -> None:
    """Raise an error if the span, measure, element or critical parameters are not valid for a model.

    Parameters
    ----------
    model : Model
        Model of the study.
    work : Work
        Results to compute.

    Raises
    ------
    ValueError, KeyError
        If a setting is not valid.
    """
    problem = HarmonicBalance(model, work.harmonics)
    problem.check_trace("Omega", min(work.span), max(work.span), {})
    problem.layout.check_measure(work.measure, work.element)
    for name in work.critical:
        problem.check_parameter(name)


def _inputs(study: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, Any]:
    return {**study, "model": study["model"]["class"], "fields": {**study["model"]["fields"], **row}}


def _collect(
    model: Model, work: Work, names: tuple[str, ...], plan: list[dict[str, Any]], keys: list[str],
    done: Mapping[str, Result], outcome: Outcome, message: str, packed: Callable[[int], bytes],
) -> Cases:  # fmt: skip
    """Return the results of the finished cases, in the order of the plan."""
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
    values = {i: fields_from_plain(row) for i, row, _ in rows}
    return Cases(model, work, names, table, jump_rows, curves, len(plan), outcome, message, values, packed)


def _cell(value: Any) -> Any:
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else value
