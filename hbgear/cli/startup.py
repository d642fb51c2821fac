"""Settings of the process of the command ``hbgear``, made before NumPy is imported; see `hbgear.__main__`.

* Linear algebra uses one thread, unless the environment sets another number: the matrices are small, and idle threads
  of BLAS wait at full processor load.
* The collector of cyclic garbage waits for 100 000 new objects instead of 700, and objects that exist at the end are
  not searched: importing makes many objects and no garbage. This saves 0.7 of 4.1 s of a command with a figure, and
  costs no memory (360 MB at most with both settings).
* Closed standard streams are opened on the null device. Otherwise the next file that the command opens would get
  their number, and text would be written to that file.

A program that imports hbgear as a library is not changed.
"""

import atexit
import gc
import os
import sys

GARBAGE_THRESHOLD = 100_000
"""Number of new objects after which garbage is collected: `hbgear gear` takes 3.4 s, without collection 3.3 s."""

IS_COMMAND = False
"""True if this process is the command `hbgear`, not a program that uses the library."""


STDOUT_CLOSED = False
"""True if the command was started without a standard output."""


def begin() -> None:
    """Make the settings of the process. Call this before NumPy is imported."""
    global IS_COMMAND, STDOUT_CLOSED
    IS_COMMAND, STDOUT_CLOSED = True, open_streams()
    gc.set_threshold(GARBAGE_THRESHOLD)
    atexit.register(gc.freeze)
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def open_streams() -> bool:
    """Open closed standard streams on the null device; return whether the standard output was closed."""
    stdout_closed = sys.stdout is None
    for descriptor, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != descriptor:
                os.dup2(opened, descriptor)
                os.close(opened)
            os.set_inheritable(descriptor, True)
            stream = open(descriptor, mode, encoding="utf-8", closefd=False)  # noqa: SIM115 open until the process ends
            setattr(sys, name, stream)
    return stdout_closed
