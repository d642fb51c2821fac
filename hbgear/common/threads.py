"""Threads for work that is done without Python's lock, as compiled kernels do it."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import TypeVar

Item = TypeVar("Item")


def processors() -> int:
    """How many processors this process may use."""
    own = getattr(os, "sched_getaffinity", None)
    return len(own(0)) if own else os.cpu_count() or 1


def for_each(work: Callable[[Item, Event], None], items: Sequence[Item]) -> None:
    """``work(item, stop)`` for every item, over threads; one item alone is worked on in this one.

    After Ctrl-C or an error ``stop`` is set, which work is to look at often: what runs ends before this returns.
    """
    stop = Event()
    if len(items) < 2:
        for item in items:
            work(item, stop)
        return
    with ThreadPoolExecutor(min(processors(), len(items))) as pool:
        futures = [pool.submit(work, item, stop) for item in items]
        try:
            for future in futures:
                future.result()
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)
