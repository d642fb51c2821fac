"""Kernels: functions in plain loops over numbers and arrays, compiled by Numba when they are first called.

What is compiled is kept in the user's cache folder (or below NUMBA_CACHE_DIR) and loaded by later processes. It stands
in a folder of its own for every state of their sources, for a kernel holds the code of those it calls, whichever file
they stand in. Without Numba the same functions run as they are written, some hundred times slower.

A module of kernels imports Numba, and is therefore imported inside of the functions that need it.

References
----------
Lam, Pitrou & Seibert (2015), LLVM-HPC, https://doi.org/10.1145/2833157.2833162.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import re
import shutil
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from hbgear.common.signals import held

Function = TypeVar("Function", bound=Callable[..., Any])

_LOG = logging.getLogger("hbgear")


def kernel(function: Function) -> Function:
    """The function compiled: no bounds are checked, division by zero gives inf or nan, and threads may run it at once.

    Fused products and sums may be used; the order of sums is kept, so that results differ between processors in the
    last digits only.
    """
    return _compiled(function, counted=True)


def bare(function: Function) -> Function:
    """A kernel that makes no array and calls none that returns one, for what is called with many arrays from Python.

    References to arrays are not counted in it, nor in the kernels that it calls to those it was given: in short loops
    that took half of the time. An array that another kernel returned to it would never be thrown away.
    """
    return _compiled(function, counted=False)


def _compiled(function: Function, counted: bool) -> Function:
    if _numba() is None:
        return function
    compiled: Any = _made(function, _nrt=counted)  # else a kernel takes after the one that calls it

    @cache
    def part() -> Any:
        from hbgear.common.linking import Parts

        return _made(function, "parts", no_cpython_wrapper=True, pipeline_class=Parts, _nrt=counted)

    if _known():  # what Numba asks of a function that another kernel calls
        compiled.get_call_template = lambda args, kws: part().get_call_template(args, kws)
        compiled.get_overload = lambda signature: part().get_overload(signature)
    return cast(Function, compiled)


def _made(function: Callable[..., Any], below: str = "", **options: Any) -> Any:
    """What Numba makes of a function; its code is kept below the folder of the kernels."""
    numba = _numba()
    before, folder = numba.config.CACHE_DIR, _folder(numba.config.CACHE_DIR)
    made = numba.njit(nogil=True, error_model="numpy", fastmath={"contract"}, no_cfunc_wrapper=True, **options)(
        function
    )
    if folder is None:
        return made
    numba.config.CACHE_DIR = str(folder / below)  # for this function only
    try:
        if _known():
            from hbgear.common.linking import Kept

            made._cache = Kept(function)  # type: ignore[no-untyped-call]
        else:
            made.enable_caching()
    finally:
        numba.config.CACHE_DIR = before
    return made


_FIRST, _LAST = (0, 60), (0, 68)  # versions of Numba whose inside `linking` was tried with


@cache
def _known() -> bool:
    """Whether `linking` knows the inside of this Numba. Another one compiles a third longer, and the same."""
    return _FIRST <= tuple(map(int, _numba().__version__.split(".")[:2])) <= _LAST


@cache
def _numba() -> Any:
    try:
        with held():  # an extension module of Numba makes an ImportError of Ctrl-C: hbgear would go on without it
            import numba
    except ImportError as error:
        _LOG.warning("Numba cannot be imported (%s): hbgear works without it, a hundred times slower", error)
        return None
    _let_it_finish()
    return numba


def _let_it_finish() -> None:
    """Ctrl-C and SIGTERM wait until a kernel is compiled or loaded: the compiler does not survive them everywhere."""
    from numba.core import event

    class Waiting(event.Listener):
        def __init__(self) -> None:
            self.depth, self.waiting = 0, contextlib.ExitStack()

        def on_start(self, event: Any) -> None:
            if threading.current_thread() is threading.main_thread():
                self.depth += 1
                if self.depth == 1:
                    self.waiting.enter_context(held())

        def on_end(self, event: Any) -> None:
            if threading.current_thread() is threading.main_thread() and self.depth:
                self.depth -= 1
                if self.depth == 0:
                    self.waiting.close()

    event.register("numba:compiler_lock", Waiting())  # type: ignore[no-untyped-call]


def nothing_compiled() -> bool:
    """Whether what is compiled for the sources as they are now will be kept, and there is nothing yet."""
    numba = _numba()
    if numba is None or _place(numba.config.CACHE_DIR).is_dir():
        return False
    return _folder(numba.config.CACHE_DIR) is not None


@cache
def _place(given: str) -> Path:
    """The folder for compiled code of the sources as they are now."""
    import platformdirs

    parent = Path(given) if given else Path(platformdirs.user_cache_dir("hbgear"))
    return parent / f"kernels-{_state()}"


@cache
def _folder(given: str) -> Path | None:
    """Where compiled code of the sources as they are now is kept; None if nothing can be written there."""
    folder = _place(given)
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            _clear(folder.parent)
            _LOG.warning("hbgear compiles its core for this processor: once, for some seconds")
        if not os.access(folder, os.W_OK):
            raise PermissionError(f"no permission to write in {folder}")
    except OSError as error:
        _LOG.warning(
            "hbgear compiles its core anew in every process, for it cannot be kept (%s): let the environment variable "
            "NUMBA_CACHE_DIR name a folder that can be written",
            error,
        )
        return None
    return folder


_STALE = 30 * 24 * 3600.0  # seconds after which the code of other states of the sources is thrown away


def _clear(parent: Path) -> None:
    """Throw away code that no process has compiled anything into for long."""
    for other in parent.glob("kernels-*"):
        with contextlib.suppress(OSError):
            if time.time() - other.stat().st_mtime > _STALE:
                shutil.rmtree(other, ignore_errors=True)


def _state() -> str:
    """A name for the sources of kernels, and of what these import, as they are now."""
    root = Path(__file__).parents[1]
    texts = {path.relative_to(root).as_posix(): path.read_text(encoding="utf-8") for path in root.rglob("*.py")}
    own = [name for name, text in texts.items() if re.search(r"^@(kernel|bare)$", text, re.M)]
    modules = {module for name in own for module in re.findall(r"^from hbgear\.([\w.]+) import", texts[name], re.M)}
    used = {*own, "common/linking.py", *(f"{module.replace('.', '/')}.py" for module in modules)}
    told = [f"{name} {texts[name]}" for name in sorted(used & texts.keys())]
    return hashlib.sha256("\n".join([str(root), *told]).encode()).hexdigest()[:16]
