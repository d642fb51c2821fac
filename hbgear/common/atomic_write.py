"""Files that appear whole or not at all.

What is written goes to a temporary file beside the one that is meant, reaches the disk, and only then takes the name.
"""

from __future__ import annotations

import os
import stat
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import IO, Any

from hbgear.common.process.signals import defer_signals

_PROBE = bytes(1 << 16)  # what is written to see whether a file can be


class CannotWrite(OSError):
    """A file cannot be written; the text is one sentence that says which, why, and what to do."""

    def __str__(self) -> str:
        return str(self.strerror)


def _cannot(path: str | os.PathLike[str], reason: OSError | str, advice: str) -> CannotWrite:
    number, text = (reason.errno, reason.strerror or str(reason)) if isinstance(reason, OSError) else (0, reason)
    return CannotWrite(number or 0, f"cannot write '{path}': {text[:1].lower()}{text[1:]}; {advice}")


@contextmanager
def atomic_write(path: str | os.PathLike[str], mode: str = "xb", **options: Any) -> Iterator[IO[Any]]:
    """A file to write that takes its name only once it is complete and on the disk; before, nothing is changed.

    Ctrl-C waits until it is written.

    Parameters
    ----------
    path : of the file, which keeps its permissions if it is there; a link is followed, unless it leads nowhere.
    mode, options : as of `open`, with "x" for a new file.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    CannotWrite
        If the file cannot be made, written to its end or given its name: what was there before is whole.
    """
    target = _target(path)
    # a name of fixed length: that of the file may already be as long as names can be
    temporary = target.with_name(f".hbgear-{uuid.uuid4().hex[:16]}")
    with defer_signals():
        try:
            with open(temporary, mode, opener=partial(_opened, like=target), **options) as handle:
                yield handle
                handle.flush()
                os.fsync(handle.fileno())
            os.replace(temporary, target)
            _sync_folder(target.parent)
        except Exception as error:
            reason = _reason(error)
            if reason is None or isinstance(reason, CannotWrite):
                raise
            before = "the file that was there is unchanged" if target.exists() else "nothing was left there"
            raise _cannot(path, reason, before) from error
        finally:
            with suppress(OSError):  # where the folder itself is gone or sealed nothing is left to be done
                temporary.unlink(missing_ok=True)


def _opened(name: str, flags: int, like: Path) -> int:
    """A new file with the permissions of the one that it replaces, from its first byte on; else those of the user."""
    try:
        permissions = stat.S_IMODE(like.stat().st_mode)
    except FileNotFoundError:
        return os.open(name, flags, 0o666)
    number = os.open(name, flags, 0o600)
    os.chmod(name, permissions)  # without what the user's mask would take away
    return number


def check_writable(path: str | os.PathLike[str]) -> None:
    """Write a file beside the one that is meant and remove it; permissions alone do not tell.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    CannotWrite
        If the name is too long or taken by something that is no file, or nothing can be written beside it.
    """
    target = _target(path)
    temporary = target.with_name(f".hbgear-{uuid.uuid4().hex[:16]}")
    try:
        try:
            with open(temporary, "xb", buffering=0) as handle:
                done = handle.write(_PROBE)
                if done < len(_PROBE):
                    handle.write(_PROBE[done:])  # a full disk takes a part first, and fails then
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = f"no file can be made in '{target.parent}'" if isinstance(error, FileNotFoundError) else error
        raise _cannot(path, reason, "give another place") from error


def _target(path: str | os.PathLike[str]) -> Path:
    """The file that is meant, links followed: a file already, or nothing yet in a folder that is there."""
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
    """What the system said, behind an error: closing an archive that failed says something else."""
    while error is not None:
        if isinstance(error, OSError) and error.errno is not None:
            return error
        error = error.__cause__ or error.__context__
    return None


def _sync_folder(folder: Path) -> None:
    """A new name is on the disk once its folder is."""
    if os.name != "posix":
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some file systems cannot; the file itself has been written
            os.fsync(number)
    finally:
        os.close(number)


def checked_suffix(path: str | os.PathLike[str], allowed: tuple[str, ...], advice: str) -> str:
    """The ending of a name, in small letters; any other than those allowed is refused with the advice."""
    suffix = Path(path).suffix.lower()
    if suffix not in allowed:
        raise ValueError(f"'{path}' must end in {' or '.join(allowed)}; {advice}")
    return suffix
