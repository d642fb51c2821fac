"""Measures of amplitude of all points of a branch."""

from __future__ import annotations

from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.continuation.results.branch_data import BranchData
from hbgear.continuation.results.point import MAX_DERIVATIVE, dof_index, measured, require_layout, rows_of_dof


def amplitudes(
    branch: BranchData, measure: str, element: int | str, dof: int | str | None = None, derivative: int = 0
) -> Array:
    """Return a measure of amplitude (P,) of each point; see `Branch.amplitude`."""
    counted("derivative", derivative, MAX_DERIVATIVE, least=0)
    layout = require_layout(branch.layout)
    coefficients = layout.rows(branch.X, element) if dof is None else _coefficients_of_dof(branch, dof)
    parameters = [branch.parameters_at(i) for i in range(len(branch))] if derivative else []
    return measured(layout, measure, coefficients, parameters, derivative)


def _coefficients_of_dof(branch: BranchData, dof: int | str) -> Array:
    """Return the coefficients of a degree of freedom, (P, ...), from the file or from the problem."""
    stored = branch.full_motion if branch.problem is None else None
    if stored is not None and len(stored.rows) == len(branch):
        return stored.rows[:, dof_index(dof, stored.names)]
    problem = branch.require_problem()
    return rows_of_dof(problem, dof, branch.X, [branch.parameters_at(i) for i in range(len(branch))])
