"""Settings of the process of the command ``hbgear``, made before NumPy is imported; see `hbgear.__main__`.

* Linear algebra uses one thread, unless the environment sets another number: the matrices are small, and idle threads
  of BLAS wait at full processor load.
* Closed standard streams are opened on the null device. Otherwise the next file that the command opens would get
  their number, and text would be written to that file.

A program that imports hbgear as a library is not changed.
"""

import os
import sys

IS_COMMAND = False
"""True if this process is the command `hbgear`, not a program that uses the library."""


STDOUT_CLOSED = False
"""True if the command was started without a standard output."""


def begin() -> None:
    """Make the settings of the process. Call this before NumPy is imported."""
    global IS_COMMAND, STDOUT_CLOSED
    IS_COMMAND, STDOUT_CLOSED = True, open_streams()
    for library in ("OPENBLAS", "MKL", "OMP"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def open_streams() -> bool:
    """Open closed standard streams on the null device.

    Returns
    -------
    bool
        True if the standard output was closed.
    """
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
