"""Atomic writes: files appear completely or not at all.

The content is written to a temporary file in the same folder, synchronised to the disk, and then renamed. On Windows a
file that another program has open cannot be replaced. Virus scanners and indexers open new files for a moment, so the
rename is repeated there. Folders are synchronised where the system can open them as files.
"""

from __future__ import annotations

import csv
import errno
import os
import stat
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import IO, Any

from hbgear.common.process.signals import defer_signals

_SHARING_VIOLATIONS = os.name == "nt"
"""True if a file that another program reads cannot be replaced."""

_REPLACE_DELAYS = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Times [s] after which a refused rename is repeated; virus scanners hold a new file for less than a second."""

_UNSUPPORTED = (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS)
"""Errors of file systems that cannot synchronise a file, such as some network folders."""

_PROBE = bytes(1 << 16)  # content of the file that tests whether files can be written


class CannotWrite(OSError):
    """A file cannot be written; the message states the file, the reason and how to fix it."""

    def __str__(self) -> str:
        return str(self.strerror)


def _cannot(path: str | os.PathLike[str], reason: OSError | str, advice: str) -> CannotWrite:
    """Return the error of a file that cannot be written."""
    number, text = (reason.errno, reason.strerror or str(reason)) if isinstance(reason, OSError) else (0, reason)
    return CannotWrite(number or 0, f"cannot write '{path}': {text[:1].lower()}{text[1:]}; {advice}")


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "xb", **options: Any) -> Iterator[IO[Any]]:
    """Open a file for writing that replaces the target only when it is complete and on the disk.

    Ctrl-C is deferred until it is written. An existing file keeps its permissions; a link is followed, a broken link is
    refused. The mode is "xb" or another one for new files of `open`, which gets the other options too.
    FileNotFoundError is raised if there is no such folder, CannotWrite if the file cannot be created, written
    completely or renamed; an existing file is then unchanged.
    """
    target = _target(path)
    # a name of fixed length, because the name of the file may have the maximum length
    temporary = target.with_name(f".hbgear-{uuid.uuid4().hex[:16]}")
    with defer_signals():
        try:
            with open(temporary, mode, opener=partial(_opened, like=target), **options) as handle:
                yield handle
                handle.flush()
                _sync(handle.fileno())
            _replace(temporary, target)
            _sync_folder(target.parent)
        except Exception as error:
            reason = _reason(error)
            if reason is None or isinstance(reason, CannotWrite):
                raise
            before = "the file that was there is unchanged" if target.exists() else "nothing was left there"
            raise _cannot(path, reason, before) from error
        finally:
            with suppress(OSError):  # nothing can be removed if the folder was removed or is read-only
                temporary.unlink(missing_ok=True)


@contextmanager
def csv_table(path: str | os.PathLike[str]) -> Iterator[Any]:
    """Open a .csv table by `atomic_write`, and yield its `csv.writer`."""
    with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
        yield csv.writer(handle)


def _opened(name: str, flags: int, like: Path) -> int:
    """Open a new file with the permissions of the file that it replaces, or with the default permissions."""
    try:
        permissions = stat.S_IMODE(like.stat().st_mode)
    except FileNotFoundError:
        return os.open(name, flags, 0o666)
    number = os.open(name, flags, 0o600)
    os.chmod(name, permissions)  # independent of the mask of the user
    return number


def check_writable(path: str | os.PathLike[str]) -> None:
    """Check that a file can be written: write a test file in its folder and remove it.

    Permissions alone do not decide it, for example on a full disk.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    CannotWrite
        If the name is too long or belongs to a folder or device, or the folder cannot be written.
    """
    target = _target(path)
    temporary = target.with_name(f".hbgear-{uuid.uuid4().hex[:16]}")
    try:
        try:
            with open(temporary, "xb", buffering=0) as handle:
                done = handle.write(_PROBE)
                if done < len(_PROBE):
                    handle.write(_PROBE[done:])  # a full disk accepts a part first and fails then
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = f"no file can be made in '{target.parent}'" if isinstance(error, FileNotFoundError) else error
        raise _cannot(path, reason, "give another place") from error


def _target(path: str | os.PathLike[str]) -> Path:
    """Return the target of a path after links: an existing file, or a new file in an existing folder."""
    path = Path(path)
    try:
        target = Path(os.path.realpath(path))
    except FileNotFoundError as error:  # the current folder was removed
        raise _cannot(path, "the current folder does not exist any more", "change to another one") from error
    try:
        kind = target.stat().st_mode
    except FileNotFoundError:
        if path.is_symlink():
            reason = f"it is a link to '{target}', which does not exist"
            raise _cannot(path, reason, "remove the link or give another name") from None
        if not target.parent.is_dir():
            folder = path.parent if not path.parent.is_dir() else target.parent
            raise FileNotFoundError(f"cannot write '{path}': there is no folder '{folder}'; create it first") from None
        return target
    except OSError as error:
        raise _cannot(path, error, "give another name") from error
    if not stat.S_ISREG(kind):
        what = "a folder" if stat.S_ISDIR(kind) else "a device or pipe"
        raise _cannot(path, f"it is {what}", "give another name")
    return target


def _reason(error: BaseException | None) -> OSError | None:
    """Return the error of the system behind an error; an archive raises another error when it is closed."""
    while error is not None:
        if isinstance(error, OSError) and error.errno is not None:
            return error
        error = error.__cause__ or error.__context__
    return None


def _sync(number: int) -> None:
    """Synchronise an open file to the disk, if its file system can."""
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise


def _replace(temporary: Path, target: Path) -> None:
    """Rename a file over another one; repeat it where a program that reads the other one prevents it."""
    for delay in _REPLACE_DELAYS if _SHARING_VIOLATIONS else ():
        try:
            os.replace(temporary, target)
            return
        except PermissionError:
            time.sleep(delay)
    os.replace(temporary, target)


def _sync_folder(folder: Path) -> None:
    """Synchronise a folder to the disk, which stores the new name."""
    if os.name != "posix":
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some file systems do not support it; the file itself is written
            os.fsync(number)
    finally:
        os.close(number)


def checked_suffix(path: str | os.PathLike[str], allowed: tuple[str, ...], advice: str) -> str:
    """Return the suffix of a file name in lower case; raise an error with the advice if it is not allowed."""
    suffix = Path(path).suffix.lower()
    if suffix not in allowed:
        raise ValueError(f"'{path}' must end in {' or '.join(allowed)}; {advice}")
    return suffix
