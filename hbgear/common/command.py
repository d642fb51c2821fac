"""What the command ``hbgear`` sets before all else is imported.

Ctrl-C meanwhile gives one sentence and the exit code 130, as nothing has begun. Objects in circles are looked for more
rarely than Python does: a command makes few and ends soon, and what it imports makes hundreds of thousands of others.
Linear algebra has one thread, unless the environment says otherwise when it is imported: its matrices are small, and
other threads would wait for work at full speed.

Standard streams that are closed are opened on the null device, so that no file of the command gets their number, and
nothing is written to that file by mistake.

A program that imports hbgear as a library is left alone. Only modules that Python has imported already are imported
here: Ctrl-C would give a traceback meanwhile.
"""

import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import TracebackType

_OBJECTS = 300_000  # more than before, after which circles are looked for


_CTRL_C = 130  # exit code of what Ctrl-C ended, as shells have it


def is_command() -> bool:
    """Whether this process is ``hbgear`` or ``python -m hbgear``, of which Python knows no more yet than ``-m``."""
    first = str(getattr(sys, "argv", [""])[0])
    if first == "-m":
        return sys.orig_argv[-len(sys.argv)] == "hbgear"
    return os.path.splitext(os.path.basename(first))[0] == "hbgear"


def end(kind: type[BaseException], error: BaseException, trace: "TracebackType | None") -> None:
    """What to do about an exception that nothing has caught."""
    if not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, trace)
        return
    print("hbgear: error: stopped before it was done", file=sys.stderr)
    sys.exit(_CTRL_C)


def open_streams() -> bool:
    """Open standard streams that are closed on the null device; whether standard output was one of them."""
    closed = sys.stdout is None
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            given = os.open(os.devnull, os.O_RDWR)
            if given != number:
                os.dup2(given, number)
                os.close(given)
            os.set_inheritable(number, True)
            stream = open(number, mode, encoding="utf-8", closefd=False)  # noqa: SIM115 until the process ends
            setattr(sys, name, stream)
    return closed


IS_COMMAND = is_command()
"""Whether this process is the command `hbgear`, not a program that uses the library."""


STDOUT_CLOSED = IS_COMMAND and open_streams()
"""Whether the command has no standard output to print its result to."""


if IS_COMMAND:
    sys.excepthook = end
    import gc

    gc.set_threshold(_OBJECTS, 20, 20)
    for _library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
