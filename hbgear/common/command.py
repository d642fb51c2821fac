"""What the command ``hbgear`` sets before it imports what it is made of; see `hbgear.__main__`.

Objects in circles are looked for more rarely than Python does: a command makes few and ends soon, and what it imports
makes hundreds of thousands of others. Linear algebra has one thread, unless the environment says otherwise when it is
imported: its matrices are small, and other threads would wait for work at full speed.

Standard streams that are closed are opened on the null device, so that no file of the command gets their number, and
nothing is written to that file by mistake.

A program that imports hbgear as a library is left alone.
"""

import gc
import os
import sys

_OBJECTS = 300_000  # more than before, after which circles are looked for


IS_COMMAND = False
"""Whether this process is the command `hbgear`, not a program that uses the library."""


STDOUT_CLOSED = False
"""Whether the command has no standard output to print its result to."""


def begin() -> None:
    """Set all of this, before NumPy is imported."""
    global IS_COMMAND, STDOUT_CLOSED
    IS_COMMAND, STDOUT_CLOSED = True, open_streams()
    gc.set_threshold(_OBJECTS, 20, 20)
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


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
