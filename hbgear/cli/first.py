"""The first command: half of the kernels of a curve are compiled in a process of their own.

That process stores them, and a kernel that is stored is loaded when it is first called. Those that follow the curve
are compiled meanwhile where it is traced, which takes longer. If the other process is late or fails, its half is
compiled here too.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

import hbgear as hb
from hbgear.cli import startup
from hbgear.common.process.threads import processors


@contextmanager
def compiled_beside() -> Iterator[None]:
    """If this is a command, of two processors or more, and nothing is stored: compile while the block runs."""
    from hbgear.common.process.compiling import nothing_stored

    if not startup.IS_COMMAND or processors() < 2 or not nothing_stored():
        yield
        return
    from hbgear.design.studies.processes import executor_of

    with executor_of(None, 1, 1) as pool:
        pool.submit(_observed)
        yield


def _observed() -> None:
    """Ask for what is computed at every point of a curve; kernels are the same for all models without corners."""
    logging.getLogger("hbgear").setLevel(logging.ERROR)  # the process that traces says that kernels are compiled
    from hbgear.harmonic.multipliers.floquet import floquet_multipliers

    problem = hb.HarmonicBalance(hb.SpurPair(), 8)
    motion, Omega = np.ones((1, problem.size)), np.array([0.8])
    floquet_multipliers(problem.compiled({}), motion, Omega)
    problem.observe_many(motion, "Omega", Omega)
