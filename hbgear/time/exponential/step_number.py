"""Number of steps of the exponential method that a motion with cubic springs or laws in Python requires.

Springs and excitation give the first number. A law that is steep where the motion passes, such as friction
tanh(v / v0), or a cubic spring that a large motion stiffens, requires more. The number is doubled until twice as many
steps do not change one period.
"""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.time.exponential.modal_states import StateBatch
from hbgear.time.exponential.segments import Integers

MAX_EXCITATION_STEPS = 100_000
"""Largest number of steps per excitation period [-]; the tables hold the excitation of each step."""

CHECKED_MOTIONS = 4
"""Number of motions, the largest ones, with which the number of steps is checked."""

MAX_STEP_CHANGE = 1e-8
"""Change of a motion in one period by twice the steps, relative to its size, for which their number is accepted."""

MAX_REFINEMENT = 64
"""Largest ratio of the steps that a law requires to those that springs and excitation require."""


def with_sufficient_steps(integrator: Any, motions: StateBatch) -> Any:
    """Return the integrator, or one with as many steps as motions require, which are not changed.

    A RuntimeWarning is given if the largest number of steps does not suffice.
    """
    largest = np.argsort(-np.abs(motions.zeta + integrator.z).max(axis=1))[:CHECKED_MOTIONS]
    limit = min(integrator.N * MAX_REFINEMENT, MAX_EXCITATION_STEPS)
    current, end = integrator, _after_a_period(integrator, motions, largest)
    while limit >= 2 * current.N:
        finer = integrator.at(integrator.Omega, 2 * current.N)
        after = _after_a_period(finer, motions, largest)
        size = np.abs(after + integrator.z[largest if integrator.rows > 1 else 0]).max()
        if not np.abs(after - end).max() > MAX_STEP_CHANGE * size:  # also if the motion diverges
            return current
        current, end = finer, after
    warnings.warn(
        f"{current.N} steps per period do not resolve a law (twice as many change the motion by more than "
        f"{MAX_STEP_CHANGE:g}): use hb.time.integrate with method='DOP853' or 'Radau'",
        RuntimeWarning,
        stacklevel=4,
    )
    return current


def _after_a_period(integrator: Any, motions: StateBatch, rows: Integers) -> Array:
    """Return zeta of some motions after one period."""
    batch, single = motions.select(rows), copy.copy(integrator.select(rows))
    single.adaptive = False
    single.advance(batch)
    return batch.zeta
