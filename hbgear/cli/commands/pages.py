"""Commands for the browser: ``hbgear report`` and ``hbgear explore``."""

from __future__ import annotations

import dataclasses
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import kind_of
from hbgear.cli import options
from hbgear.cli.output import STOPPED_EARLY, bar, print_message
from hbgear.cli.output_files import outputs
from hbgear.cli.support import chosen_model, class_of, problem_in, span_of
from hbgear.common.optional import needed
from hbgear.continuation.extend import traced_span
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.models import model_registry

if TYPE_CHECKING:
    from hbgear.web.editable_model import EditableModel

Measured = Annotated[
    list[Path] | None,
    typer.Option(
        "--measured",
        metavar="FILE",
        help="A table of measured points whose header states units in square brackets, such as n in r/min, dte in um; "
        "repeatable.",
    ),
]


def report(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Curves saved by hbgear trace -o; also tori and backbones.")
    ],
    output: Annotated[Path, options.output_option("The page, .html.", ".html", ".htm")] = Path("report.html"),
    title: Annotated[str | None, typer.Option(help="Title of the page.", show_default="the model")] = None,
    validate: Annotated[
        int, typer.Option(min=0, help="Number of points of each file to validate by time integration.")
    ] = 0,
    model: options.OwnModel = None,
    measured: Measured = None,
    study: Annotated[
        list[Path] | None,
        typer.Option(metavar="FOLDER", help="Also show this folder of hbgear study, or its table.npz; repeatable."),
    ] = None,
) -> None:
    """Write one page with curves, motions, jumps and accuracy; any browser opens it without a network.

    Exit codes: 0 done, 2 bad input, 3 a validation was interrupted (the page contains the validated points).
    """
    from hbgear.web.page import check_installed

    check_installed()
    branches = [hb.load(file) for file in files]
    checks = []
    for branch in (x for x in branches if validate and kind_of(x) == "periodic"):
        with_problem = dataclasses.replace(branch, problem=problem_in(branch, model))
        with bar("points") as progress:
            checks.append(hb.validate(with_problem, validate, progress=progress))
    names = [file.stem for file in files] if len(files) > 1 else None
    page = hb.report(
        branches, title=title, names=names, validation=checks, measured=measured or (), studies=study or ()
    )
    with outputs() as out:
        out.write(output, page.save)
    if not all(check.complete for check in checks):
        raise typer.Exit(STOPPED_EARLY)


def explore(
    what: Annotated[
        str,
        typer.Argument(
            metavar="MODEL|FILE", help="A model, the .toml of a machine, structure or study, or a saved curve (.npz)."
        ),
    ],
    changes: options.Changes = None,
    first: options.First = None,
    last: options.Last = None,
    harmonics: Annotated[
        int | None, typer.Option(min=1, max=256, help="H at the start.", show_default="16, or from the curve")
    ] = None,
    model: options.OwnModel = None,
    also: Annotated[
        list[Path] | None,
        typer.Option("--with", metavar="FILE", help="Also draw these saved tori or backbones; repeatable."),
    ] = None,
    allow_code: options.AllowCode = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; 0 for any free port.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """Open a page with a slider for each parameter; the response curve is traced again while a slider moves.

    The page is reachable from this machine only. Ctrl-C ends the server; nothing is stored.
    Exit codes: 0 ended by Ctrl-C, 2 bad input.
    """
    import webbrowser

    from hbgear.web.explorer import Explorer
    from hbgear.web.page import check_installed
    from hbgear.web.server import Server

    check_installed()
    needed("flask", "explore", "the explorer")
    subject, span, H, saved = explored(what, changes, model, allow_code, (first, last))
    server = Server(
        Explorer(subject, span, harmonics or H, saved, [hb.load(path) for path in also or ()]), Path(what).stem, port
    )
    print(f"open {server.address}\nend with Ctrl-C", flush=True)
    if browser and not webbrowser.open(server.address):
        print_message("warning", "no browser could be opened; open the address above in one")
    with suppress(KeyboardInterrupt):
        server.run()
    print("ended")


def explored(
    source: str,
    changes: list[str] | None,
    model_class_name: str | None,
    allow_code: bool = False,
    ends: tuple[str | None, str | None] = (None, None),
) -> tuple[EditableModel, tuple[float, float], int, hb.Branch | None]:
    """Return the model or machine to explore, its span and harmonics at the start, and the curve of a file.

    ``ends`` are the texts of --from and --to.
    """
    from hbgear.design.studies.samples import Grid
    from hbgear.design.studies.study_file import read_study
    from hbgear.io.machines.machine_file import read_machine
    from hbgear.io.machines.model_file import kind_of_file, read_model
    from hbgear.web.editable_model import EditableFile, EditableInstance, EditableMachine

    if changes and source.endswith((".npz", ".toml")):
        defining = "curve" if source.endswith(".npz") else "file"
        raise ValueError(f"--set: the {defining} defines the values; change them on the page")
    kind = kind_of_file(source) if source.endswith(".toml") else ""
    subject: EditableModel
    usual, H, saved = None, 16, None
    if source.endswith(".npz"):
        saved = hb.load(source)
        problem = model_registry.rebuild_problem(saved.meta, class_of(model_class_name))
        if saved.parameter != "Omega" or saved.tracked:
            raise ValueError(f"'{source}' is a curve in {saved.parameter}; the explorer draws curves in Omega")
        layout, model = layout_of(saved), problem.model.at(saved.fixed)
        name = model_class_name or next((n for n, cls in model_registry.MODELS.items() if cls is type(model)), "")
        subject = EditableInstance(model, name) if name else EditableFile(problem.model, source, model)
        usual, H = traced_span(saved), layout.harmonics if layout else H
    elif kind == "study":
        study = read_study(source, allow_code)
        model = study.model.replace(**next(study.vary.rows())) if isinstance(study.vary, Grid) else study.model
        of_file, name = study.of_file, study.source
        subject = EditableFile(of_file, name, model) if of_file else EditableInstance(model, name)
        usual, H = study.work.span, study.work.harmonics
    elif kind in ("train", "structure"):
        subject = EditableFile(read_model(source), source)
    elif kind == "machine":
        subject = EditableMachine(read_machine(source))
    else:
        subject = EditableInstance(chosen_model(source, changes), source)
    return subject, span_of(subject.model({}), *ends, usual), H, saved
