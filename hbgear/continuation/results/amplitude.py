"""Measures of amplitude of all points of a branch."""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.continuation.results.branch_data import BranchData
from hbgear.continuation.results.layout import ReconstructsMotion
from hbgear.continuation.results.point import dof_index, require_layout

MAX_DERIVATIVE = 10
"""Largest order of a derivative in time. Displacement, velocity, acceleration and jerk are orders 0 to 3."""


def amplitudes(
    branch: BranchData, measure: str, element: int | str, dof: int | str | None = None, derivative: int = 0
) -> Array:
    """Return a measure of amplitude of each point; see `Branch.amplitude`.

    Parameters
    ----------
    branch : BranchData
        Branch with P points.
    measure : str
        Name of the measure, such as "rms".
    element : int or str
        Index or name of the element.
    dof : int or str, optional
        Index or name of a degree of freedom, which is used instead of the element.
    derivative : int, optional
        Order of the derivative in time. The default is 0.

    Returns
    -------
    ndarray, shape (P,)
        Values of the measure.
    """
    counted("derivative", derivative, MAX_DERIVATIVE, least=0)
    layout = require_layout(branch.layout)
    coefficients = layout.rows(branch.X, element) if dof is None else _coefficients_of_dof(branch, dof)
    if derivative:
        points = [branch.parameters_at(i) for i in range(len(branch))]
        parameters = {name: np.array([point[name] for point in points]) for name in points[0]}
        coefficients = layout.in_time(coefficients, parameters, derivative)
    return layout.measure_rows(measure, coefficients)


def _coefficients_of_dof(branch: BranchData, dof: int | str) -> Array:
    """Return the coefficients of a degree of freedom, (P, ...), from the file or from the problem."""
    stored = branch.full_motion if branch.problem is None else None
    if stored is not None and len(stored.rows) == len(branch):
        return stored.rows[:, dof_index(dof, stored.names)]
    problem: Any = branch.require_problem()
    if not isinstance(problem, ReconstructsMotion):
        raise ValueError(f"dof={dof!r} needs a problem with degrees of freedom; {type(problem).__name__} has none")
    q = np.array([problem.motion(X, **branch.parameters_at(i)) for i, X in enumerate(branch.X)])
    return q[:, dof_index(dof, problem.dof_names)]
