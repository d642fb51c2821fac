"""Threads for compiled kernels, which release the global interpreter lock."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def processors() -> int:
    """Return the number of processors that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


@contextmanager
def begun(work: Callable[[Item, Event], Result], items: Sequence[Item]) -> Iterator[list[Future[Result]]]:
    """Run ``work(item, stop)`` of every item in threads while a block runs; yield the futures.

    At the end of the block the event ``stop`` is set, which the work must test often. Running work ends before the
    block is left; waiting work is cancelled.
    """
    stop = Event()
    with ThreadPoolExecutor(max(1, min(processors(), len(items)))) as pool:
        try:
            yield [pool.submit(work, item, stop) for item in items]
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


def for_each(work: Callable[[Item, Event], None], items: Sequence[Item]) -> None:
    """Run ``work(item, stop)`` for every item in threads; a single item in the calling thread.

    Ctrl-C or an error stops the threads as in `begun`.
    """
    if len(items) < 2:
        for item in items:
            work(item, Event())
        return
    with begun(work, items) as futures:
        for future in futures:
            future.result()
