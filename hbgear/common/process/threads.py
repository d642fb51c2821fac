"""Threads for work that is done without Python's lock, as compiled kernels do it."""

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
    """How many processors this process may use."""
    own = getattr(os, "sched_getaffinity", None)
    return len(own(0)) if own else os.cpu_count() or 1


@contextmanager
def begun(work: Callable[[Item, Event], Result], items: Sequence[Item]) -> Iterator[list[Future[Result]]]:
    """Threads at ``work(item, stop)`` of every item while the block runs, and what they will return.

    At its end ``stop`` is set, which work is to look at often: what runs ends before the block is left, and what waits
    does not begin.
    """
    stop = Event()
    with ThreadPoolExecutor(max(1, min(processors(), len(items)))) as pool:
        try:
            yield [pool.submit(work, item, stop) for item in items]
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


def for_each(work: Callable[[Item, Event], None], items: Sequence[Item]) -> None:
    """``work(item, stop)`` for every item, over threads; one item alone is worked on in this one.

    After Ctrl-C or an error they are stopped as by `begun`.
    """
    if len(items) < 2:
        for item in items:
            work(item, Event())
        return
    with begun(work, items) as futures:
        for future in futures:
            future.result()
