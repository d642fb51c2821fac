"""Output of the commands: messages, progress, tables, exit codes."""

from __future__ import annotations

import math
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import typer

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import SPEED_LABEL, Abscissa, Ordinate, usual_measure
from hbgear.analysis.summary import (
    in_speeds,
    jump_table,
    leaving_lines,
    message_of,
    reliability_lines,
    size_text,
    special_table,
)
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.text.messages import shortened
from hbgear.continuation.results.reliability import branch_warnings

if TYPE_CHECKING:
    from rich.table import Table


BAD_INPUT = 2
"""Exit code of bad input."""


STOPPED_EARLY = 3
"""Exit code of a command that was stopped or interrupted."""


def print_message(kind: str, text: object) -> None:
    """Print one line on standard error; long words, which damaged files contain, are shortened."""
    with suppress(OSError):  # standard error cannot be written: the exit code remains
        print(f"hbgear: {kind}: {' '.join(shortened(word, 1000) for word in str(text).split())}", file=sys.stderr)


def discard_unwritable(stream: Any) -> None:
    """Redirect a stream that cannot be written to the null device; otherwise Python tries again at exit."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@contextmanager
def bar(description: str) -> Iterator[ProgressCallback | None]:
    """Show progress on a terminal: a bar where the fraction is known, the elapsed time and a text."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Display

    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn("{task.fields[text]}")
    with Display(*columns, console=Console(stderr=True), transient=True) as display:
        task = display.add_task(description, total=None, text="")

        def show(progress: Progress) -> None:
            is_known = not math.isnan(progress.done)
            display.update(
                task, total=1.0 if is_known else None, completed=progress.done if is_known else 0.0, text=progress.text
            )

        yield show


def exit_code(branch: hb.Branch) -> int:
    """Return 0 if this curve and all others of its span were traced to their ends, else 3."""
    return 0 if all(curve.status.complete for curve in branch.curves) else STOPPED_EARLY


def finish(result: Any, *parts: Any) -> None:
    """Print a message if a result is not complete, and end the command with the exit code of it and its parts.

    The code is 3 if any has a status that is not complete, else 0.
    """
    if not result.status.complete:
        print_message("stopped early", result.message)
    raise typer.Exit(0 if all(x.status.complete for x in (result, *parts)) else STOPPED_EARLY)


def print_text_table(table: Table) -> None:
    """Print a table, with a width of 140 columns where no terminal sets the width."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 140, highlight=False).print(table)


def print_table(headers: list[str], rows: list[list[str]], title: str = "") -> None:
    """Print a table of texts; on a terminal that is too narrow, one line for each cell."""
    width = shutil.get_terminal_size().columns
    if sys.stdout.isatty() and _smallest_width(headers, rows) > width:
        print(listed(headers, rows, title, width))
    else:
        print_text_table(table_of(headers, rows, title))


def print_records(records: Sequence[Mapping[str, str]], title: str = "") -> None:
    """Print a table whose rows have the same cells by header."""
    print_table(list(records[0]), [list(record.values()) for record in records], title)


_COLUMN_MARGIN = 3  # characters around a column of a table


def _smallest_width(headers: list[str], rows: list[list[str]]) -> int:
    """Return the characters that a table needs: whole cells, and whole words in its last column."""
    columns = list(zip(headers, *rows, strict=True))
    widths = [max(len(line) for cell in column for line in cell.splitlines() or [""]) for column in columns[:-1]]
    last = max(len(word) for cell in columns[-1] for word in cell.split() or [""])
    return sum(widths) + last + _COLUMN_MARGIN * len(columns)


def print_text(text: str) -> None:
    """Print a sentence; on a terminal, lines end between words."""
    if sys.stdout.isatty():
        width = shutil.get_terminal_size().columns
        wrapped = (
            textwrap.wrap(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
            for line in text.splitlines()
        )
        text = "\n".join("\n".join(lines) for lines in wrapped)
    print(text)


def listed(headers: list[str], rows: list[list[str]], title: str, width: int) -> str:
    """Return the cells of a table one below the other, each after its header, for a narrow terminal."""
    lines = [title] if title else []
    for row in rows:
        lines += [""] if lines else []
        for header, cell in zip(headers, row, strict=True):
            first, *others = cell.splitlines() or [""]
            for text in (f"{header}: {first}" if header else first, *(f"  {part}" for part in others)):
                lines += textwrap.wrap(
                    text, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
                ) or [""]
    return "\n".join(lines)


def table_of(headers: list[str], rows: list[list[str]], title: str = "") -> Table:
    """Return a table for the terminal."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, title=Text(title) if title else None, title_justify="left", title_style="bold")
    for i, header in enumerate(headers):
        table.add_column(Text(header), overflow="fold", no_wrap=i < len(headers) - 1)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def show_all_branches(
    branch: hb.Branch,
    measure: str | None,
    element: int | str,
    show: Callable[..., None] | None = None,
    dimensionless: bool = False,
) -> None:
    """Print the tables of a curve and of the other curves of its span, with `show_branch` or another function."""
    numbered = numbered_branches(branch.curves)
    for i, (name, curve) in enumerate(numbered):
        if i:
            print_text(f"\n{name}: {len(curve)} points; {message_of(curve, dimensionless)}")
        (show or show_branch)(curve, measure, element, [*numbered[:i], *numbered[i + 1 :]], dimensionless)


def numbered_branches(branches: Iterable[hb.Branch]) -> list[tuple[str, hb.Branch]]:
    """Return branches with the names by which tables refer to them."""
    return [(f"branch {number}", branch) for number, branch in enumerate(branches, 1)]


def show_branch(
    branch: hb.Branch,
    measure: str | None,
    element: int | str,
    others: Sequence[tuple[str, hb.Branch]] = (),
    dimensionless: bool = False,
) -> None:
    """Print the tables of special points and jumps (see `show_jumps`), and the reliability of the curve."""
    if not branch.special:
        print_text("no special points")
        show_reliability(branch, dimensionless)
        return
    headers, rows = special_table(branch, measure, element, dimensionless)
    print_table(headers, rows, "special points")
    show_jumps(branch, measure, element, others, dimensionless)
    show_reliability(branch, dimensionless)


def show_reliability(branch: hb.Branch, dimensionless: bool = False) -> None:
    """Print the estimated errors and warnings of a curve, and how to fix them."""
    lines = reliability_lines(branch, dimensionless)
    for line in lines:
        print_text(line)
    if branch_warnings(branch) and lines:
        print_text("  use more harmonics: --harmonics 32 or auto")


def show_jumps(
    branch: hb.Branch,
    measure: str | None,
    element: int | str,
    others: Sequence[tuple[str, hb.Branch]] = (),
    dimensionless: bool = False,
) -> None:
    """Print the jumps of a branch as a table, or that it has none; see `jump_table`."""
    if branch.jumps():
        headers, rows, notes = jump_table(branch, measure, element, others, dimensionless)
        print_table(headers, rows, "jumps of a slow sweep")
    else:
        notes = ["no jumps on this curve"]
        if branch.parameter == "amplitude":
            notes = ["a backbone has no jumps: they belong to response curves (hbgear trace)"]
        elif branch.multipliers is None:
            notes = ["jumps unknown: traced without stability"]
    for note in (*notes, *leaving_lines(branch)):
        print_text(note)


def show_path(run: hb.analysis.RunUp, measure: str | None, element: int | str, dimensionless: bool = False) -> None:
    """Print the sections of the path of a slow sweep, and where it jumps."""
    first = run.sections[0].branch
    height = Ordinate(measure or usual_measure(first, dimensionless, element), element, dimensionless=dimensionless)
    abscissa, jumps, rows = Abscissa([first], dimensionless), list(run.jumps), []
    for number, section in enumerate(run.sections):
        branch, last = height.prepared(section.branch), int(section.points[-1])
        end, after = branch[last], ""
        following = run.sections[number + 1] if number + 1 < len(run.sections) else None
        if jumps and (following is None or following.landed is jumps[0].after):
            jump = jumps.pop(0)
            end, after = jump.before, f"jump at {jump.label}"
            if following is not None and jump.after is not None:
                after += f" to {size_text(jump.after, height, height.prepared(following.branch))}"
        layout = branch.layout
        values = (section.values[0], end.parameters[run.parameter])
        rows.append(
            [
                *(f"{abscissa.scale * value:.6g}" for value in values),
                str(getattr(layout, "nu", 1)),
                size_text(end, height, branch),
                after,
            ]
        )
    name = "pinion r/min" if abscissa.label == SPEED_LABEL else run.parameter
    direction = "increasing" if run.direction == "up" else "decreasing"
    headers = [f"from {name}", "to", "period", f"{height.header(first)} at the end", ""]
    print_table(headers, rows, f"path of a slow sweep, {direction}")
    print_text(in_speeds(first, run.message, dimensionless))
