"""Output files: checked before the computation, and written to another folder if their own fails afterwards."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import typer

import hbgear as hb
from hbgear.cli.output import BAD_INPUT, print_message
from hbgear.common import atomic_write

BRANCHES = (".npz", ".csv", ".mat")


FIGURES = (".png", ".pdf", ".svg")


def check_writable(path: Path | None, allowed: tuple[str, ...]) -> None:
    """Refuse, before the computation, a path that could not be written."""
    if path is None:
        return
    if path.suffix.lower() not in allowed:
        *first_endings, final = allowed
        endings = f"{', '.join(first_endings)} or {final}" if first_endings else final
        raise ValueError(f"cannot write '{path}': the name must end in {endings}")
    atomic_write.check_writable(path)


class Outputs:
    """Writer of files one by one. After a failure the other files are still written and the result is printed.

    A file that cannot be written gets a free name in the current folder, else in the folder for temporary files.
    """

    def __init__(self) -> None:
        self.written: list[Path] = []
        self.displaced = False  # whether a file is not at its path
        self.bug: Exception | None = None

    def write(self, path: Path | None, write: Callable[[Path], object]) -> None:
        """Call ``write`` with the path, or with a fallback, which is reported; nothing without a path."""
        if path is None:
            return
        reason = self._write_error(path, write)
        if reason is None:
            return
        self.displaced = True
        folders = []
        for folder in _fallbacks(path):
            folders.append(f"'{folder}'")
            if self._write_error(free_path := _free(folder, path.name), write) is None:
                print_message("error", f"{reason}; it is kept as '{free_path}' instead")
                return
        print_message("error", f"{reason}; it could not be kept in {' or '.join(folders) or 'another folder'} either")

    def branch(self, path: Path | None, branch: hb.Branch) -> None:
        """Save or export a branch by the suffix."""
        self.write(path, branch.save if path and path.suffix.lower() == ".npz" else branch.export)

    def figure(self, path: Path | None, make: Callable[[Any], Any], style: str = "journal") -> None:
        """Write a figure without a window, in a style of `hbgear.plot.in_style`; ``make`` gets `hbgear.plot`."""
        self.write(path, partial(_draw, make, style))

    def _write_error(self, path: Path, write: Callable[[Path], object]) -> OSError | None:
        try:
            write(path)
        except OSError as error:
            return error
        except Exception as error:  # a bug, such as one in a figure: raised after all else is written and printed
            self.bug = self.bug or error
        else:
            self.written.append(path)
        return None


@contextmanager
def outputs() -> Iterator[Outputs]:
    """Write the files of a block before the result is printed; report at the end which files were written.

    The command ends with the code 2 if a file is not at its path.
    """
    out = Outputs()
    try:
        yield out
    finally:
        report_written(*out.written)
    if out.bug is not None:
        raise out.bug
    if out.displaced:
        raise typer.Exit(BAD_INPUT)


def report_written(*paths: Path | None) -> None:
    """Print which files were written."""
    if any(paths):
        print("wrote", ", ".join(str(path) for path in paths if path))


def _draw(make: Callable[[Any], Any], style: str, path: Path) -> None:
    from hbgear import plot as drawing
    from hbgear.plot.style import without_windows

    with drawing.in_style(style), without_windows():
        drawing.save(make(drawing), path)


def _fallbacks(path: Path) -> Iterator[Path]:
    """Yield the fallback folders."""
    for folder in (Path.cwd, tempfile.gettempdir):
        with suppress(OSError):  # the current folder was removed, or no folder for temporary files exists
            fallback = Path(folder())
            if not path.parent.is_dir() or not fallback.samefile(path.parent):
                yield fallback


def _free(folder: Path, name: str) -> Path:
    """Return a free path in the folder."""
    path, number = folder / name, 1
    while path.exists():
        number += 1
        path = folder / f"{Path(name).stem}-{number}{Path(name).suffix}"
    return path
