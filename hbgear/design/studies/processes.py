"""Worker processes of studies: spawned, without a reaction to Ctrl-C, and ended together with the parent process.

After Ctrl-C the parent process calls `request_stop`, and the workers begin no further case: a pool passes on more
groups of cases than it has processes, and these cannot be cancelled.
"""

from __future__ import annotations

import ast
import inspect
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process, resource_tracker
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

_stop_event: Event | None = None
"""In a worker process: set if no further case is to begin."""


class _Pool(ProcessPoolExecutor):
    """Spawned processes that `request_stop` reaches."""

    def __init__(self, workers: int) -> None:
        context = get_context("spawn")
        self.stop_event = context.Event()
        super().__init__(workers, mp_context=context, initializer=_initialize_worker, initargs=(self.stop_event,))


def request_stop(executor: Executor) -> None:
    """Let the processes of a pool of `executor_of` begin no further case; other executors are left alone."""
    if isinstance(executor, _Pool):
        executor.stop_event.set()


def is_stop_requested() -> bool:
    """Return whether this is a worker process that is to begin no further case."""
    return _stop_event is not None and _stop_event.is_set()


@contextmanager
def executor_of(executor: Executor | None, processes: int | None, count: int) -> Iterator[Executor]:
    """Yield the given executor, or a pool of processes that is shut down afterwards.

    The pool has one process for each core, and at most one for each case. After an error or Ctrl-C the processes are
    terminated. RuntimeError is raised if a script would start processes outside of ``if __name__ == "__main__":``, so
    that each of them would run the script again.
    """
    if executor is not None:
        yield executor
        return
    _check_guard()
    workers = min(processes or os.cpu_count() or 1, count)
    existing = set(active_children())
    with _Pool(workers) as pool:
        try:
            with _delayed_ctrl_c():
                for _ in range(workers):  # each starts a process
                    pool.submit(os.getpid)
            yield pool
        except BaseException:
            for process in set(active_children()) - existing:
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _check_guard() -> None:
    """Raise an error for a call at the top level of a script: every process imports the script and would call again."""
    main: Any = sys.modules["__main__"]
    frame = inspect.currentframe()
    while frame is not None and not (frame.f_code.co_name == "<module>" and frame.f_globals is vars(main)):
        frame = frame.f_back
    run_as_package = str(getattr(main.__spec__, "name", "")).endswith("__main__")  # processes do not import such a file
    if frame is None or run_as_package:
        return
    try:
        tree = ast.parse(Path(main.__file__).read_bytes())
    except (AttributeError, OSError, SyntaxError, ValueError):  # interactive, or not a file
        return
    for statement in tree.body:
        if statement.lineno <= frame.f_lineno <= (statement.end_lineno or 0):
            if isinstance(statement, ast.If) or "__name__" in ast.unparse(statement):
                return
            raise RuntimeError(
                f"the processes import {main.__file__} and would start it again: write the line "
                f'if __name__ == "__main__": before line {statement.lineno}, and indent the lines after it'
            )


@contextmanager
def _delayed_ctrl_c() -> Iterator[None]:
    """Delay Ctrl-C until the end of the block; processes that start in the block never receive it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # otherwise the first process starts it and unblocks Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _initialize_worker(stop_event: Event) -> None:
    """Ignore Ctrl-C in a worker process, and end the process when its parent process ends."""
    global _stop_event
    _stop_event = stop_event
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
