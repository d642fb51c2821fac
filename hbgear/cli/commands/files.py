"""The files a command writes: looked at before the work, and kept somewhere else if their place fails after it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import hbgear as hb
from hbgear.cli.startup import IS_COMMAND
from hbgear.cli.support import BAD_INPUT, say
from hbgear.common import atomic_write
from hbgear.common.process.threads import processors

if TYPE_CHECKING:
    from concurrent.futures import Executor

BRANCHES = (".npz", ".csv", ".mat")


FIGURES = (".png", ".pdf", ".svg")


def check_writable(path: Path | None, allowed: tuple[str, ...]) -> None:
    """Refuse now what could not be written when the work is done."""
    if path is None:
        return
    if path.suffix.lower() not in allowed:
        *others, final = allowed
        endings = f"{', '.join(others)} or {final}" if others else final
        raise ValueError(f"cannot write '{path}': the name must end in {endings}")
    atomic_write.check_writable(path)


class Outputs:
    """Writes files one by one; none of them can keep the others from being written, or the result from being printed.

    Where a file cannot be written, it goes under a free name to the current folder, else to that for temporary files.
    """

    def __init__(self) -> None:
        self.written: list[Path] = []
        self.displaced = False  # whether a file is not where it was wanted
        self.bug: Exception | None = None

    def write(self, path: Path | None, write: Callable[[Path], object]) -> None:
        """Call ``write`` with the path, or with that of a fallback, and say so; nothing without a path."""
        if path is None:
            return
        reason = self._tried(path, write)
        if reason is None:
            return
        self.displaced = True
        tried = []
        for folder in _fallbacks(path):
            tried.append(f"'{folder}'")
            if self._tried(other := _free(folder, path.name), write) is None:
                say("error", f"{reason}; it is kept as '{other}' instead")
                return
        say("error", f"{reason}; it could not be kept in {' or '.join(tried) or 'another folder'} either")

    def branch(self, path: Path | None, branch: hb.Branch) -> None:
        """Save or export a branch by the suffix."""
        self.write(path, branch.save if path and path.suffix.lower() == ".npz" else branch.export)

    def figure(self, path: Path | None, make: Callable[[Any], Any], by: Executor | None = None) -> None:
        """A figure, without a window; make is given the module `hbgear.plot`, by the process of `artist` if any."""
        draw = partial(_draw, make)
        self.write(path, draw if by is None else lambda path: by.submit(draw, path).result())

    def _tried(self, path: Path, write: Callable[[Path], object]) -> OSError | None:
        try:
            write(path)
        except OSError as error:
            return error
        except Exception as error:  # a bug, in a figure for instance: told when all else is written and printed
            self.bug = self.bug or error
        else:
            self.written.append(path)
        return None


@contextmanager
def outputs() -> Iterator[Outputs]:
    """Write files in here first and then print the result; at the end it is said which files were written.

    Raises
    ------
    typer.Exit
        With 2 if a file is not where it was wanted.
    """
    out = Outputs()
    try:
        yield out
    finally:
        wrote(*out.written)
    if out.bug is not None:
        raise out.bug
    if out.displaced:
        raise typer.Exit(BAD_INPUT)


def wrote(*paths: Path | None) -> None:
    """Say which files were written."""
    if any(paths):
        print("wrote", ", ".join(str(path) for path in paths if path))


@contextmanager
def artist() -> Iterator[Executor | None]:
    """A process that draws while this one computes, and first imports what that needs; None if there is one processor.

    None in other programs too, who have not asked for processes.
    """
    if not IS_COMMAND or processors() < 2:
        yield None
        return
    from hbgear.design.studies.processes import executor_of

    with executor_of(None, 1, 1) as pool:
        pool.submit(_ready)
        yield pool


def _ready() -> None:
    """Import what draws."""
    _pyplot()
    from hbgear.plot.machines import mesh  # noqa: F401 with the files it is made of


def _pyplot() -> Any:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def _draw(make: Callable[[Any], Any], path: Path) -> None:
    plt = _pyplot()
    from hbgear import plot as drawing

    try:
        drawing.save(make(drawing), path)
    finally:
        plt.close("all")


def _fallbacks(path: Path) -> Iterator[Path]:
    """Folders to write to instead."""
    for folder in (Path.cwd, tempfile.gettempdir):
        with suppress(OSError):  # a current folder that was removed, no folder for temporary files
            found = Path(folder())
            if not path.parent.is_dir() or not found.samefile(path.parent):
                yield found


def _free(folder: Path, name: str) -> Path:
    """A path in the folder that no file has yet."""
    path, number = folder / name, 1
    while path.exists():
        number += 1
        path = folder / f"{Path(name).stem}-{number}{Path(name).suffix}"
    return path
