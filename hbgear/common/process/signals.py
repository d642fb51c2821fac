"""Ctrl-C (SIGINT) and the request to end (SIGTERM): one way to stop, which waits while a file is being written."""

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
    """These signals call ``handler(number, frame)`` until this is over.

    Python lets only the main thread say so; elsewhere nothing changes. Nor does it for a signal that something other
    than Python sees to.
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
    """SIGTERM raises KeyboardInterrupt as Ctrl-C does, so that what was done is kept; neither is ever lost."""
    with signal_handlers(_interrupt, signal.SIGTERM), _told_again():
        yield


@contextmanager
def _told_again() -> Iterator[None]:
    """A KeyboardInterrupt that Python cannot raise where it comes is raised a moment later.

    It comes so in functions that compiled code calls, of which the compiler of kernels has some.
    """
    before = sys.unraisablehook

    def hook(given: sys.UnraisableHookArgs) -> None:
        if issubclass(given.exc_type, KeyboardInterrupt):
            threading.Timer(_MOMENT, _thread.interrupt_main).start()
        else:
            before(given)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


_MOMENT = 0.05  # seconds after which the compiled code has returned


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@contextmanager
def defer_signals() -> Iterator[None]:
    """Ctrl-C and SIGTERM wait until this is over, the second time they come no longer.

    A signal that something other than Python sees to is left alone, and so is every thread but the main one.
    """
    before = {number: handler for number in _STOPS if callable(handler := signal.getsignal(number))}
    came: list[int] = []

    def hold(number: int, frame: FrameType | None) -> None:
        if came:
            before[signal.Signals(number)](number, frame)
        came.append(number)

    try:
        with signal_handlers(hold, *before):
            yield
    finally:
        if came:
            signal.raise_signal(came[0])
