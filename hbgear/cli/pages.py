"""Commands for the browser: ``hbgear report``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

import hbgear as hb
from hbgear.cli.files import check_writable, outputs
from hbgear.cli.support import STOPPED_EARLY, OwnModel, bar, one_thread, problem_in
from hbgear.web.page import check_installed

Measured = Annotated[
    list[Path] | None,
    typer.Option(
        "--measured",
        metavar="FILE",
        help="A table of measured points: Omega, or a speed with its unit [Hz] or [r/min] in the first line, and half "
        "peak-to-peak; can be repeated.",
    ),
]


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command()(report)


def report(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Curves saved by hbgear trace -o.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The page, .html.")] = Path("report.html"),
    title: Annotated[str | None, typer.Option(help="Title of the page.", show_default="the model")] = None,
    validate: Annotated[
        int, typer.Option(min=0, help="So many points of each curve are held against integration in time first.")
    ] = 0,
    model: OwnModel = None,
    measured: Measured = None,
) -> None:
    """Write one page with curves, motions, jumps and accuracy, which any browser opens without a network.

    Exit codes: 0 done, 2 bad input, 3 a validation was interrupted (the page has what was checked).
    """
    check_writable(output, (".html", ".htm"))
    check_installed()
    branches = [hb.load(file) for file in files]
    checks = []
    for branch in branches if validate else ():
        known = dataclasses.replace(branch, problem=problem_in(branch, model))
        with one_thread(), bar("points") as progress:
            checks.append(hb.validate(known, validate, progress=progress))
    names = [file.stem for file in files] if len(files) > 1 else None
    made = hb.report(branches, title=title, names=names, validation=checks, measured=measured or ())
    with outputs() as out:
        out.write(output, made.save)
    if not all(check.complete for check in checks):
        raise typer.Exit(STOPPED_EARLY)
