"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hbgear.cli import complete as cli_complete
from hbgear.cli.output_files import BRANCHES, FIGURES, check_writable
from hbgear.continuation.results.point import LANDINGS
from hbgear.harmonic.models import model_registry


def file_option(text: str, endings: tuple[str, ...], *names: str, default: str | bool = True) -> Any:
    """Return an option for a file that is written; it is refused before the computation if it could not be written.

    ``text`` is its help, ``endings`` are the allowed endings of the name, such as ``(".csv",)``, ``names`` those of the
    option, by default that of the argument, and ``default`` describes the default in the help.
    """

    def checked(path: Path | None) -> Path | None:
        check_writable(path, endings)
        return path

    return typer.Option(*names, help=text, callback=checked, show_default=default)


def output_option(text: str, *endings: str) -> Any:
    """Return the option -o of a command that writes one file; see `file_option`."""
    return file_option(text, endings, "-o", "--output")


def element_of(text: str) -> int | str:
    """Return the number or the name of an element given on the command line."""
    return int(text) if text.isdecimal() else text


def _checked_landing(landing: str) -> str:
    if landing not in LANDINGS:
        raise ValueError(f"--landing {landing}: need {' or '.join(LANDINGS)}")
    return landing


Model = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help=f"One of: {', '.join(model_registry.MODELS)}; FILE.toml of a machine (see hbgear gear -o), train or "
        "structure; or your own FILE.py:NAME or MODULE:NAME, whose code is run.",
        autocompletion=cli_complete.models,
    ),
]


OwnModel = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="FILE.py:NAME",
        help="The model of the curve if it is not part of hbgear; its code is run. Loading a curve runs no code.",
    ),
]


File = Annotated[Path, typer.Argument(metavar="FILE", help="A curve saved as .npz by hbgear trace -o or Branch.save.")]


Output = Annotated[Path | None, output_option("Save as .npz, or export .csv or .mat.", *BRANCHES)]


Table = Annotated[Path | None, output_option("Save all numbers as .csv.", ".csv")]


AllowCode = Annotated[
    bool, typer.Option("--allow-code", help="Run the code of a model FILE.py:NAME or MODULE:NAME that the file names.")
]


Figure = Annotated[Path | None, file_option("Draw to a .png, .pdf or .svg.", FIGURES)]


Landing = Annotated[
    str,
    typer.Option(
        "--landing",
        metavar="nearest|integrate",
        help="How to determine where a jump lands: the nearest stable motion, or the end of an integration in time.",
        callback=_checked_landing,
    ),
]


OtherCurves = Annotated[
    list[Path] | None,
    typer.Option("--with", metavar="FILE", help="Another saved curve on which jumps may land; repeatable."),
]


Measure = Annotated[
    str,
    typer.Option(
        help="Amplitude: pp2 (half peak-to-peak), rms, max, mean, H1, H2, ...", autocompletion=cli_complete.amplitudes
    ),
]


ShownMeasure = Annotated[
    str | None,
    typer.Option(
        "--measure",
        help="Amplitude pp2 (half peak-to-peak), rms, max, mean, H1, ...; or dte (dynamic transmission error), "
        "'dynamic factor', force.",
        autocompletion=cli_complete.amplitudes,
        show_default="dte if the model has scales, else pp2",
    ),
]


Dimensionless = Annotated[
    bool,
    typer.Option("--dimensionless", help="Show Omega and amplitudes in the unit of the model, not r/min, um and N."),
]


Element = Annotated[
    Any, typer.Option(parser=element_of, metavar="NUMBER|NAME", help="Element, by number from 0 or by name.")
]


Harmonics = Annotated[str, typer.Option(help="Number H of harmonics of the excitation frequency.")]


Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a field of the model; repeatable.",
        autocompletion=cli_complete.fields,
    ),
]


First = Annotated[
    str | None,
    typer.Option(
        "--from",
        help="Start: Omega, or with a unit the speed of the pinion (9000r/min) or the mesh frequency (2500Hz).",
        show_default="from the model",
    ),
]


Last = Annotated[str | None, typer.Option("--to", help="End, as --from.", show_default="from the model")]


def range_option(text: str) -> Any:
    """Return the option --in of a command that needs a parameter and its range; ``text`` is its help."""
    return typer.Option("--in", metavar="NAME=FROM:TO", help=text, autocompletion=cli_complete.fields)


Within = Annotated[
    str | None,
    typer.Option(
        "--in",
        metavar="NAME=FROM:TO",
        help="Vary this field of the model instead of Omega; see --at.",
        autocompletion=cli_complete.assigned,
    ),
]


At = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Fix a parameter, such as Omega=0.9; repeatable.",
        autocompletion=cli_complete.assigned,
    ),
]
