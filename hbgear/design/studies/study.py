"""Studies of many cases of a model: numbers of one response curve for each case.

    case i:  the model with the values of case i of a `Grid` or `Sample`  ->  peak, jumps, curve, critical values

Cases run in a `concurrent.futures.Executor`, by default in processes with one BLAS thread each. Each case is stored
when it is finished. A study that is started again computes the missing cases. A case that fails is listed with the
reason. If the executor or the disk fails, the study ends early with a message.
"""

from __future__ import annotations

import errno
import json
import os
import warnings
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from dataclasses import asdict, replace
from functools import partial
from queue import SimpleQueue
from typing import Any

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.text.messages import did_you_mean
from hbgear.design.studies.case_results import Cases, Outcome, Work, collect
from hbgear.design.studies.case_work import check_result, check_work, run_cases
from hbgear.design.studies.processes import executor_of, request_stop
from hbgear.design.studies.samples import Grid, Sample
from hbgear.design.studies.store import Result, Store, key_of
from hbgear.mechanics.model_lookup import reference_of
from hbgear.mechanics.models import Model, describe

MANY = 1_000_000
"""Default limit of the number of cases."""

_MAX_PENDING_GROUPS = 256
"""Largest number of groups that are submitted to the executor and not finished; also the largest size of a group."""

_GROUP_SECONDS = 0.2
"""Computing time of a group of cases [s]. The transfer of a group to a process and back takes about a millisecond."""


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
        for key, result in _stored(folder, dict.fromkeys(keys), work).items():
            if not (retry and result.reason):
                run.add(key, result)
    pending = {key: row for key, row in zip(keys, rows, strict=True) if key not in run.done}
    if folder and pending:
        folder.check_writable()
    outcome, message = Outcome.FINISHED, "every case was computed"
    if pending:
        try:
            with executor_of(executor, processes, len(pending)) as pool:
                outcome, message = run.compute(pool, reference_of(type(model)), pending, work)
        except KeyboardInterrupt:  # a second one, while running cases were finishing, or one before the first case
            outcome, message = Outcome.INTERRUPTED, f"interrupted; {run.kept_text}"
    branch_of = partial(_packed_branch, folder, run.done, keys)
    return collect(model, work, vary.names, rows, keys, run.done, outcome, message, branch_of)


def _packed_branch(folder: Store | None, done: Mapping[str, Result], keys: list[str], case: int) -> bytes:
    """Return the packed branch of a case from its file, or from memory without a store."""
    key = keys[case]
    return folder.branch(key) if folder else done[key].branch


def _stored(folder: Store, keys: Iterable[str], work: Work) -> dict[str, Result]:
    """Return the stored cases by key; warn about cases that cannot be read."""
    results, lost = {}, []
    for key in keys:
        try:
            result = folder.read(key)
            if result is not None:
                check_result(result, work)
                results[key] = result
        except (OSError, ValueError) as error:
            lost.append(f"'{folder.path(key)}': {error}")
    if lost:
        text = f"{len(lost)} stored case{'s' if len(lost) > 1 else ''} cannot be read and will be computed again"
        warnings.warn(f"{text} ({lost[0]}{', ...' if lost[1:] else ''})", stacklevel=3)
    return results


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
    def kept_text(self) -> str:
        """Text that states where the finished cases are."""
        return (
            "the finished cases are stored; run the study again to compute the others"
            if self.folder
            else "the result contains the finished cases"
        )

    def compute(
        self, pool: Executor, cls: type[Model] | str, pending: Mapping[str, dict[str, Any]], work: Work
    ) -> tuple[Outcome, str]:
        """Compute the waiting cases, store each finished one, and return the reason for the end.

        Ctrl-C waits for the running cases; a second one raises KeyboardInterrupt.
        """
        running: dict[Future[list[Result]], list[str]] = {}
        try:
            try:
                self._compute(pool, cls, pending, work, running)
            except KeyboardInterrupt:
                request_stop(pool)
                self._finish(running, pending)
                return Outcome.INTERRUPTED, f"interrupted; {self.kept_text}"
            except _ExecutorFailed as failure:
                self._finish(running, pending, patience=0.0)
                return Outcome.WORKERS_LOST, f"{failure}; {self.kept_text}"
            return Outcome.FINISHED, "every case was computed"
        except _NotStored as failure:
            for future in running:
                future.cancel()
            return (
                Outcome.CANNOT_STORE,
                f"{failure}; earlier cases are stored; run the study again to compute the others",
            )

    def _compute(
        self,
        pool: Executor,
        cls: type[Model] | str,
        pending: Mapping[str, dict[str, Any]],
        work: Work,
        running: dict[Future[list[Result]], list[str]],
    ) -> None:
        """Submit groups of cases and store their results; ``running`` contains the groups that are not finished."""
        queue, finished, group_size = deque(pending), SimpleQueue[Future[list[Result]]](), 1
        self._show()
        while True:
            while len(running) < _MAX_PENDING_GROUPS and queue:
                keys = [queue.popleft() for _ in range(min(group_size, len(queue)))]
                future = _submitted(pool, cls, [_inputs(self.study, pending[key])["fields"] for key in keys], work)
                running[future] = keys
                future.add_done_callback(finished.put)  # faster than `wait` for the first of hundreds
            if not running:
                return
            future = finished.get()
            results = _result(future)
            self._keep(running[future], pending, results)
            queue.extend(running.pop(future)[len(results) :])
            slowest = max(1e-6, *(result.seconds for result in results))
            # groups of fast cases hide the time of their transfer; one slow case makes groups small again
            group_size = min(max(int(_GROUP_SECONDS / slowest), 1), _MAX_PENDING_GROUPS)

    def _finish(
        self,
        running: Mapping[Future[list[Result]], list[str]],
        pending: Mapping[str, dict[str, Any]],
        patience: float | None = None,
    ) -> None:
        """Keep running cases that cannot be cancelled and finish within ``patience`` seconds."""
        uncancelled = [future for future in running if not future.cancel()]
        for future in wait(uncancelled, timeout=patience).done:
            if not future.cancelled() and future.exception() is None:
                self._keep(running[future], pending, future.result())

    def _keep(self, keys: Sequence[str], pending: Mapping[str, dict[str, Any]], results: Sequence[Result]) -> None:
        """Add and store the finished cases of a group, which are its first ones."""
        for key, result in zip(keys, results, strict=False):
            self.add(key, result)
            if self.folder:
                try:
                    self.folder.write(key, _inputs(self.study, pending[key]), result)
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
        return pool.submit(run_cases, cls, group, work)
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
    allowed = [*model.entries, *model.parameters, *(() if isinstance(vary, Sample) else fields)]
    for name in vary.names:
        if name not in allowed:
            raise KeyError(f"{type(model).__name__} has no parameter '{name}'{did_you_mean(name, allowed)}")
    check_work(model, work)


def _inputs(study: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, Any]:
    return {**study, "model": study["model"]["class"], "fields": {**study["model"]["fields"], **row}}
