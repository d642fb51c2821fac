"""The first command: half of the kernels are compiled in a second process.

The second process stores the compiled kernels; this process loads each one at its first call. The kernels that trace
the curve, which take longer, are compiled meanwhile in this process. If the second process is late or fails, its half
is compiled here too.
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
def compile_in_parallel(problem: hb.HarmonicBalance) -> Iterator[None]:
    """Compile in a second process while the block runs, if this is a command, has two processors and needs it."""
    from hbgear.common.process.compiling import is_missing
    from hbgear.harmonic.multipliers.monodromy_kernels import monodromies

    if not startup.IS_COMMAND or processors() < 2 or not is_missing(monodromies):
        yield
        return
    from hbgear.design.studies.processes import executor_of

    with executor_of(None, 1, 1) as pool:
        pool.submit(_compile_point_kernels, problem.compiled({}).packed.piecewise is None)
        yield


def _compile_point_kernels(plain: bool) -> None:
    """Compile the kernels evaluated at every point, for plain models or all others, see `PackedModel`."""
    logging.getLogger("hbgear").setLevel(logging.ERROR)  # the tracing process already reports the compilation
    from hbgear.harmonic.multipliers.floquet import floquet_multipliers

    model = hb.SpurPair() if plain else hb.SpurPair(stiffness=hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.3))
    problem = hb.HarmonicBalance(model, 8)
    motion, Omega = np.ones((1, problem.size)), np.array([0.8])
    floquet_multipliers(problem.compiled({}), motion, Omega)
    problem.observe_many(motion, "Omega", Omega)
