"""Processes that cases run in, and others: started fresh, deaf to Ctrl-C, and ended with the one that started them."""

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
from pathlib import Path
from typing import Any


@contextmanager
def executor_of(given: Executor | None, processes: int | None, count: int) -> Iterator[Executor]:
    """The executor that was given, else processes, one for each core but not more than there is work; ended after.

    An error, Ctrl-C too, does not wait for the processes.

    Raises
    ------
    RuntimeError
        If processes are to be started by a script that does not keep them from starting it again.
    """
    if given is not None:
        yield given
        return
    _check_guard()
    workers = min(processes or os.cpu_count() or 1, count)
    others = set(active_children())
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_prepare) as pool:
        try:
            with _holding_ctrl_c():
                for _ in range(workers):  # each starts a process
                    pool.submit(os.getpid)
            yield pool
        except BaseException:
            for process in set(active_children()) - others:
                process.terminate()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _check_guard() -> None:
    """Refuse a script that calls at its top level: every process imports it first, and would call again."""
    main: Any = sys.modules["__main__"]
    frame = inspect.currentframe()
    while frame is not None and not (frame.f_code.co_name == "<module>" and frame.f_globals is vars(main)):
        frame = frame.f_back
    run_as_package = str(getattr(main.__spec__, "name", "")).endswith("__main__")  # such a file is not imported
    if frame is None or run_as_package:
        return
    try:
        tree = ast.parse(Path(main.__file__).read_bytes())
    except (AttributeError, OSError, SyntaxError, ValueError):  # typed in, or not in a file of its own
        return
    for statement in tree.body:
        if statement.lineno <= frame.f_lineno <= (statement.end_lineno or 0):
            if isinstance(statement, ast.If) or "__name__" in ast.unparse(statement):
                return
            raise RuntimeError(
                f"the processes import {main.__file__} and would start it again: put the line "
                f'if __name__ == "__main__": before line {statement.lineno}, and indent what follows it'
            )


@contextmanager
def _holding_ctrl_c() -> Iterator[None]:
    """Ctrl-C waits until this is over; processes started in here never hear it, not even while they start."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # else the first process starts it, which lets Ctrl-C through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _prepare() -> None:
    """A process leaves Ctrl-C to the one that started it, on Windows too, and ends when that one is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
