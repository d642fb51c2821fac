"""The processes that cases run in: started fresh, deaf to Ctrl-C, and ended with the one that started them."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process, resource_tracker


@contextmanager
def executor_of(given: Executor | None, processes: int | None, count: int) -> Iterator[Executor]:
    """The executor that was given, else processes, one for each core but not more than there is work; ended after.

    An error, Ctrl-C too, does not wait for the processes.
    """
    if given is not None:
        yield given
        return
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
