"""Kernels: functions with loops over numbers and arrays, compiled by Numba at their first call.

A kernel that Python calls is compiled together with all kernels that it calls. Their results therefore do not depend on
which of them were compiled before. Products and sums are not fused and sums keep their order (IEEE 754). Results
therefore do not depend on the arrangement of the code by the compiler, or on the process that compiled it.

The machine code of every such unit is stored in one file with a checksum, in the cache folder of the user or in
NUMBA_CACHE_DIR, and loaded by later processes. The folder is named by a hash of the sources of all kernels, the
versions of Python, Numba and LLVM, and the processor. A damaged file is a cache miss. A folder that cannot be
written is read. Numba reads and writes its own files in a temporary folder of the process.

Without Numba the same functions run as Python code, about a hundred times slower. A module of kernels imports Numba at
the first call of a kernel, and is therefore imported inside the functions that use it.

References
----------
Lam, Pitrou & Seibert (2015), LLVM-HPC, https://doi.org/10.1145/2833157.2833162.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import logging
import os
import platform
import re
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from functools import cache, cached_property
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, cast

from hbgear.common.process.checksums import DamagedFileError, read_parts, write_parts
from hbgear.common.process.signals import defer_signals

Function = TypeVar("Function", bound=Callable[..., Any])

_LOG = logging.getLogger("hbgear")
_COMPILING = threading.RLock()
_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def kernel(function: Function) -> Function:
    """Compile a function: no bounds are checked, division by zero gives inf or nan, and threads may run it at once."""
    return cast(Function, Kernel(function, inline=False))


def inlined(function: Function) -> Function:
    """Return a kernel that is inlined in the kernels that call it.

    LLVM optimises a kernel and all that it calls, and does so again in each caller. Inlining avoids this for a kernel
    that calls large kernels and has one call. Small kernels take longer to inline than to compile.
    """
    return cast(Function, Kernel(function, inline=True))


class Kernel:
    """A function and its compiled forms: an entry for calls from Python, and a part of other kernels."""

    def __init__(self, function: Callable[..., Any], inline: bool) -> None:
        functools.update_wrapper(self, function)
        self.function = cast(FunctionType, function)
        self._inline, self._known = inline, set[tuple[type, ...]]()
        self._call: Any = function

    def __call__(self, *args: Any) -> Any:
        """Call the entry; compile or load it first if there is no entry for arguments of these types.

        Numba does not compile at a call, for its code would not be stored. Arguments of known classes can be of another
        type (tuples with other elements, read-only arrays), which Numba refuses with a `TypeError`.
        """
        if tuple(map(type, args)) not in self._known:
            self._prepare(args)
        try:
            return self._call(*args)
        except TypeError:
            known = len(self.signatures)
            self._prepare(args)
            if len(self.signatures) == known:
                raise
        return self._call(*args)

    @property
    def signatures(self) -> list[Any]:
        """Argument types that have an entry in this process."""
        return list(getattr(self._call, "signatures", []))

    @property
    def stored(self) -> Path:
        """File of the code of this kernel for the present sources; it may not exist."""
        return _store() / f"{self.function.__module__}.{self.function.__name__}"

    @cached_property
    def part(self) -> Any:
        """Form that other kernels call, without code for calls from Python."""
        options = _OPTIONS | ({"inline": "always"} if self._inline else {})
        return _numba().njit(no_cpython_wrapper=True, **options)(self._linked(self.function.__code__))

    def _linked(self, code: Any) -> FunctionType:
        """Return the function with parts instead of the kernels that it calls."""
        known = self.function.__globals__
        parts = {name: known[name].part for name in code.co_names if isinstance(known.get(name), Kernel)}
        linked = FunctionType(code, known | parts, self.function.__name__, self.function.__defaults__)
        linked.__module__, linked.__qualname__ = self.function.__module__, self.function.__qualname__
        return linked

    def _prepare(self, args: tuple[Any, ...]) -> None:
        """Compile or load the entry for arguments of some types; Ctrl-C and SIGTERM wait until it is done."""
        with _COMPILING, defer_signals():
            numba = _numba()
            if numba is not None:
                if self._call is self.function:
                    self._call = self._entry()
                if self.signatures:
                    self._call.disable_compile(False)
                self._compile(tuple(numba.typeof(argument) for argument in args))
                self._call.disable_compile()
            self._known.add(tuple(map(type, args)))

    def _entry(self) -> Any:
        """Return the compiled function for calls from Python; Numba caches it in a temporary folder if possible."""
        source = Path(self.function.__code__.co_filename)
        code, options = self.function.__code__, _OPTIONS
        try:
            copy = Path(tempfile.mkdtemp(dir=_folder())) / source.name
            shutil.copyfile(source, copy)
            os.utime(copy, (0.0, 0.0))  # the same in every process, because Numba compares the time
            code, options = code.replace(co_filename=str(copy)), _OPTIONS | {"cache": True}
        except OSError as error:
            _warn_once(_NOT_STORED_MESSAGE, f"no temporary folder: {error}")
        return _numba().njit(**options)(self._linked(code))

    def _compile(self, signature: tuple[Any, ...]) -> None:
        """Load the code of the entry if it is stored, else compile and store it."""
        entry: Any = self._call
        folder = entry.stats.cache_path
        if folder is None:
            entry.compile(signature)
            return
        place, kept = Path(folder), self.stored
        try:
            _write_files(place, _read(kept))
            misses = sum(entry.stats.cache_misses.values())
            entry.compile(signature)
            if sum(entry.stats.cache_misses.values()) > misses:
                _write(kept, {path.name: path.read_bytes() for path in place.iterdir()})
        except OSError as error:  # from the temporary folder
            _warn_once(_NOT_STORED_MESSAGE, error)
            shutil.rmtree(place, ignore_errors=True)  # files of an incomplete copy
            with contextlib.suppress(OSError):  # Numba has compiled the code already if it cannot write it
                entry.compile(signature)
        finally:
            shutil.rmtree(place, ignore_errors=True)


def _write_files(folder: Path, parts: dict[str, bytes]) -> None:
    """Write parts as files of a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in parts.items():
        (folder / name).write_bytes(content)


def _read(path: Path) -> dict[str, bytes]:
    """Return stored code; an empty dict if nothing is stored or it cannot be used."""
    try:
        parts = read_parts(path)
    except (DamagedFileError, OSError) as error:
        _warn_once("hbgear compiles a part of its core again, for stored code cannot be used: %s", error)
        return {}
    if not parts and _writable() is None and not any(_store().iterdir()):
        _warn_once("hbgear compiles its core for this processor: once, for one to three minutes")
    return parts


def _write(path: Path, parts: dict[str, bytes]) -> None:
    """Store code if possible."""
    error = _writable()
    try:
        if error is None:
            write_parts(path, parts)
    except OSError as found:
        error = found
    if error is not None:
        _warn_once(_NOT_STORED_MESSAGE, error)


_NOT_STORED_MESSAGE = (
    "hbgear compiles its core in every process, for the code cannot be stored (%s): set the environment variable "
    "NUMBA_CACHE_DIR to a folder that can be written"
)


_WARNED: set[str] = set()


def _warn_once(message: str, *details: object) -> None:
    """Warn once per message, not for each file."""
    if message not in _WARNED:
        _WARNED.add(message)
        _LOG.warning(message, *details)


@cache
def _numba() -> Any:
    try:
        with defer_signals():  # an extension module of Numba turns Ctrl-C into an ImportError
            import numba
    except ImportError as error:
        _LOG.warning("Numba cannot be imported (%s): hbgear works without it, a hundred times slower", error)
        return None
    return None if getattr(numba.config, "DISABLE_JIT", False) else numba


@cache
def _folder() -> str:
    """Return a temporary folder for files of Numba, which is removed when the process ends."""
    return _temporary().name


@cache
def _temporary() -> tempfile.TemporaryDirectory[str]:
    folder = tempfile.TemporaryDirectory(prefix="hbgear-kernels-", ignore_cleanup_errors=True)
    atexit.register(folder.cleanup)  # without this Python issues a ResourceWarning
    return folder


@cache
def _store() -> Path:
    """Return the folder of stored code for the present sources; it may not exist."""
    import platformdirs

    given = os.environ.get("NUMBA_CACHE_DIR")
    parent = Path(given) if given else Path(platformdirs.user_cache_dir("hbgear"))
    return parent / f"kernels-{_state()}"


def is_missing(compiled: Callable[..., Any]) -> bool:
    """Return whether the code of a kernel can be stored, and no form of it is stored yet for the present sources."""
    return _numba() is not None and not cast(Kernel, compiled).stored.is_file() and _writable() is None


@cache
def _writable() -> OSError | None:
    """Create the folder of stored code if necessary; return the error if it cannot be written, else None."""
    folder = _store()
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            _clear(folder.parent)
        if not os.access(folder, os.W_OK):
            raise PermissionError(f"no permission to write in {folder}")
    except OSError as error:
        return error
    return None


MAX_STORED_AGE = 30 * 24 * 3600.0
"""Time [s] after which stored code of other versions of the sources is removed."""


def _clear(parent: Path) -> None:
    """Remove code of other versions of the sources that no process has changed for `MAX_STORED_AGE`."""
    for other in parent.glob("kernels-*"):
        with contextlib.suppress(OSError):
            if time.time() - other.stat().st_mtime > MAX_STORED_AGE:
                shutil.rmtree(other, ignore_errors=True)


def _state() -> str:
    """Return a hash of sources, compiler and processor, which determine the compiled code."""
    import llvmlite.binding

    root = Path(__file__).parents[2]
    texts = {path.relative_to(root).as_posix(): path.read_text(encoding="utf-8") for path in root.rglob("*.py")}
    own = [name for name, text in texts.items() if re.search(r"^@(kernel|inlined)$", text, re.M)]
    modules = {module for name in own for module in re.findall(r"^from hbgear\.([\w.]+) import", texts[name], re.M)}
    used = {*own, *(f"{module.replace('.', '/')}.py" for module in modules)}
    sources = [f"{name} {texts[name]}" for name in sorted(used & texts.keys())]
    compiler = [platform.python_version(), _numba().__version__, llvmlite.__version__, platform.machine()]
    processor = [llvmlite.binding.get_host_cpu_name(), llvmlite.binding.get_host_cpu_features().flatten()]
    return hashlib.sha256("\n".join([*compiler, *processor, *sources]).encode()).hexdigest()[:16]
