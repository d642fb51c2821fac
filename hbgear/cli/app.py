"""The command ``hbgear``: its commands, its errors and its exit codes. Each command calls functions of the library.

Exit codes: 0, the end was reached; 2, bad input, with one line that states how to fix it; 3, stopped early, and all
results up to that point are saved. Ctrl-C and SIGTERM stop any command. Modules that are slow to import (matplotlib,
rich) are imported when they are needed.
"""

from __future__ import annotations

import atexit
import shutil
import signal
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import hbgear as hb
from hbgear.cli.commands import certify, curves, design, fit, gear, models, motions, pages, rotors, study, time
from hbgear.cli.output import BAD_INPUT, STOPPED_EARLY, discard_unwritable, print_message
from hbgear.cli.startup import STDOUT_CLOSED
from hbgear.common.atomic_write import CannotWrite
from hbgear.common.process.signals import sigterm_like_ctrl_c

RENAMED = {
    "--parameter": "--parameter F --from A --to B is now --in F=A:B, as --from and --to are always in Omega",
    "--omega-from": "--omega-from is now --from",
    "--omega-to": "--omega-to is now --to",
}
"""Options of version 0.1 that are refused, with the option that replaces each."""


COMMAND_ALIASES = {"answers": "results"}
"""Earlier names of commands that still work, without an entry in the help."""


OPTION_ALIASES = {
    "survey": {"--places": "--frequencies"},
    "sweep": {"--longest": "--max-periods", "--over": "--curve"},
    "basins": {"--longest": "--max-periods"},
}
"""Options of version 0.2 that still work, without an entry in the help, by command."""


COMMANDS = {
    "Gears and models": (gear.gear, gear.speed, models.models),
    "Response curves": (
        curves.trace,
        curves.plot_command,
        curves.jumps,
        curves.info,
        gear.results,
        curves.extend,
        pages.report,
        pages.explore,
    ),
    "Further motions": (
        design.switch,
        design.survey,
        motions.follow,
        motions.backbone,
        motions.cycles,
        motions.torus,
        rotors.campbell,
    ),
    "Jumps and design": (
        design.map_command,
        design.critical,
        fit.sensitivity,
        fit.scatter,
        fit.redesign,
        study.study,
        fit.fit,
    ),
    "Validation": (time.validate, time.sweep, time.basins, certify.certify),
}
"""Commands by the heading under which the help lists them, in its order."""


CTRL_C_CODE = 130
"""Exit code that typer returns for a Ctrl-C that no command handles."""


MIN_FRAME_WIDTH = 60
"""Width of a terminal [columns] below which help is printed without frames, which would cut words."""

_columns = shutil.get_terminal_size().columns


class _Commands(TyperGroup):
    """The commands, with their earlier names and options."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the command and its arguments, with earlier names replaced by the present ones."""
        if args:
            args = [COMMAND_ALIASES.get(args[0], args[0]), *args[1:]]
            options = OPTION_ALIASES.get(args[0], {})
            for i, (option, equals, value) in enumerate(arg.partition("=") for arg in args):
                args[i] = options.get(option, option) + equals + value
        return super().resolve_command(ctx, args)


app = typer.Typer(
    cls=_Commands,
    name="hbgear",
    rich_markup_mode=None if _columns < MIN_FRAME_WIDTH else "rich",
    help="Nonlinear frequency response of gear drives with backlash.",
    epilog="Example: hbgear trace double-helical -o curve.npz, then hbgear plot curve.npz",
    pretty_exceptions_enable=False,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "terminal_width": _columns - 1 if _columns < MIN_FRAME_WIDTH else None,
    },
)


def main(args: Sequence[str] | None = None) -> None:
    """Run the command and exit."""
    # of libraries: users of a command cannot act on them
    with sigterm_like_ctrl_c(), warnings.catch_warnings(action="ignore", category=DeprecationWarning):
        warnings.showwarning = partial(_show_once, set())
        code = _output_exit_code(_run(list(sys.argv[1:] if args is None else args) or ["--help"]))
        atexit.register(_ignore_interrupts)  # registered last, so that it runs first
        sys.exit(code)


def _show_once(shown: set[str], message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning, unless an earlier one has the same text: a command may set up several problems of one model."""
    if str(message) not in shown:
        shown.add(str(message))
        print_message("warning", message)


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C while Python ends: the result is complete, only temporary files are removed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _output_exit_code(code: int) -> int:
    """Return the exit code: 2 if the output could not be written."""
    if STDOUT_CLOSED and code != BAD_INPUT:
        return _report_unwritable("standard output is closed")
    try:
        sys.stdout.flush()
    except OSError as error:
        code = _report_unwritable(error.strerror)
    discard_unwritable(sys.stderr)
    return code


def _report_unwritable(reason: str | None) -> int:
    """Print an error: the result could not be printed. Return the exit code."""
    print_message("error", f"the result could not be printed ({reason}); the output files are written")
    discard_unwritable(sys.stdout)
    return BAD_INPUT


def _is_unwritable() -> bool:
    """Return whether standard output refuses to be written."""
    try:
        sys.stdout.write("\n")
        sys.stdout.flush()
    except OSError:
        return True
    return False


def _error_text(error: Exception) -> object:
    """Return the message of an error; errors of the operating system and of libraries have no number."""
    if isinstance(error, KeyError):
        return error.args[0]
    if not isinstance(error, OSError) or error.strerror is None:
        return error
    if isinstance(error, FileNotFoundError) and not _current_folder_exists():  # libraries read it while imported
        return "the current folder does not exist any more; change to another one"
    return error.strerror if error.filename is None else f"'{error.filename}': {error.strerror}"


def _current_folder_exists() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return False
    return True


def _run(args: list[str]) -> int:
    """Run a command and return its exit code; errors of the input are printed as sentences."""
    try:
        code = int(app(args, prog_name="hbgear", standalone_mode=False) or 0)
        if code == CTRL_C_CODE:  # typer turns Ctrl-C into this code; it is reported below
            raise KeyboardInterrupt
        return code
    except (ValueError, KeyError, OSError, hb.NoConvergence) as error:
        is_stream_error = isinstance(error, OSError) and error.errno is not None and error.filename is None
        if is_stream_error and not isinstance(error, CannotWrite) and _is_unwritable():
            return _report_unwritable(getattr(error, "strerror", None))
        for problem in getattr(error, "problems", [_error_text(error)]):
            print_message("error", problem)
        return BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):  # nothing to keep, or the user refused to continue
        print_message("error", "stopped before the end")
        return STOPPED_EARLY
    except Exception as error:  # typer: an unknown option or command; any other exception is a bug
        if not hasattr(error, "format_message"):
            raise
        message = RENAMED.get(getattr(error, "option_name", ""), error.format_message().rstrip("."))
        print_message("error", f"{message}; see hbgear --help or hbgear COMMAND --help")
        return BAD_INPUT


for _heading, _functions in COMMANDS.items():
    for _function in _functions:  # of which map_command and plot_command are named map and plot
        app.command(name=_function.__name__.removesuffix("_command"), rich_help_panel=_heading)(_function)


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    if version:
        print(hb.__version__)
        raise typer.Exit
