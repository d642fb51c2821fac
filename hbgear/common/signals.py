"""Ctrl-C (SIGINT) and the request to end (SIGTERM): one way to stop, which waits while a file is being written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_STOPS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def sigterm_like_ctrl_c() -> Iterator[None]:
    """SIGTERM raises KeyboardInterrupt as Ctrl-C does, so that what was done is kept.

    Python lets only the main thread say so; elsewhere nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@contextmanager
def held() -> Iterator[None]:
    """Ctrl-C and SIGTERM wait until this is over, the second time they come no longer.

    A signal that something other than Python sees to is left alone, and so is every thread but the main one.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: handler for number in _STOPS if callable(handler := signal.getsignal(number))}
    heard: list[int] = []

    def hold(number: int, frame: FrameType | None) -> None:
        if heard:
            before[signal.Signals(number)](number, frame)
        heard.append(number)

    try:
        for number in before:
            signal.signal(number, hold)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if heard:
            signal.raise_signal(heard[0])
