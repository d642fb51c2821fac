"""Ctrl-C (SIGINT) and the request to end (SIGTERM): both raise KeyboardInterrupt, after a file has been written."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_STOPS = (signal.SIGINT, signal.SIGTERM)

Handler = Callable[[int, FrameType | None], None]


@contextmanager
def signal_handlers(handler: Handler, *numbers: int) -> Iterator[None]:
    """Call ``handler(number, frame)`` for signals while a block runs.

    Only the main thread can set handlers; in other threads nothing changes. Signals whose handler was not set by
    Python are left alone.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: earlier for number in numbers if (earlier := signal.getsignal(number)) is not None}
    try:
        for number in before:
            signal.signal(number, handler)
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def sigterm_like_ctrl_c() -> Iterator[None]:
    """Raise KeyboardInterrupt for SIGTERM as for Ctrl-C, so that results so far are returned; no signal is lost."""
    with signal_handlers(_interrupt, signal.SIGTERM), _repeat_lost_interrupts():
        yield


@contextmanager
def _repeat_lost_interrupts() -> Iterator[None]:
    """Raise a KeyboardInterrupt again that Python could not raise where it occurred.

    It is lost in Python functions that compiled code calls, as the compiler of kernels does.
    """
    before = sys.unraisablehook

    def hook(given: sys.UnraisableHookArgs) -> None:
        if issubclass(given.exc_type, KeyboardInterrupt):
            threading.Timer(REPEAT_DELAY, _thread.interrupt_main).start()
        else:
            before(given)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


REPEAT_DELAY = 0.05
"""Time [s] after which compiled code has returned, and a lost interrupt is repeated."""


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt: a signal handler."""
    raise KeyboardInterrupt


@contextmanager
def defer_signals() -> Iterator[None]:
    """Defer Ctrl-C and SIGTERM to the end of a block; a second signal is handled at once.

    Signals whose handler was not set by Python are left alone, and so are other threads than the main one.
    """
    before = {number: handler for number in _STOPS if callable(handler := signal.getsignal(number))}
    received: list[int] = []

    def hold(number: int, frame: FrameType | None) -> None:
        if received:
            before[signal.Signals(number)](number, frame)
        received.append(number)

    try:
        with signal_handlers(hold, *before):
            yield
    finally:
        if received:
            signal.raise_signal(received[0])
