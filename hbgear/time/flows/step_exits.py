"""Instants within a step of a method of SciPy at which test functions leave their ranges."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.time.exponential.segments import SAMPLES_PER_STEP, Integers, first_exit


def exits_in_step(solver: Any, tests: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Return the instants (Q,) in the last step of a SciPy solver at which functions leave (low, high), else inf.

    ``tests(t)`` returns the functions (Q, T) at instants (T,) of the step.
    """

    def value(rows: Integers, instants: Array) -> Array:
        return np.array([tests(np.array([x]))[i, 0] for i, x in zip(rows, instants, strict=True)])

    t = np.linspace(solver.t_old, solver.t, SAMPLES_PER_STEP + 1)
    samples = tests(t)
    return first_exit(t, samples, np.gradient(samples, t, axis=1), low, high, value)[0]
