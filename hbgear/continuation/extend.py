"""Going on from where a trace ended."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.concatenation import append_continuation, most_resolved, padded_to_common_size
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NewtonSettings
from hbgear.continuation.tracing.jumps import find_jumps
from hbgear.continuation.tracing.trace import trace


@checked_arguments()
def extend(
    branch: Branch, span: tuple[float, float] | None = None, *, problem: AnyProblem | None = None, **options: Any
) -> Branch:
    """Follow a curve on from its last row, the way it was going; the rows that were there and the new ones in one.

    Special points are numbered on and jumps sought on the whole. The new part does not know the old one: a closed
    curve that stopped before it closed goes round once more, to the row it was extended from.

    Parameters
    ----------
    branch : a branch that ended early, or at the end of a span that was too short.
    span : of the parameter; by default that of the trace.
    problem : what to go on with, if not the branch's own, such as a `HarmonicBalance` of more harmonics; the rows that
        were there stay what they are, with zeros for the harmonics they do not have.
    options : passed to `trace`, such as ``steps=StepControl(max_points=5000)``, which counts the new points only.

    Raises
    ------
    TypeError
        If it is no branch.
    ValueError
        If the branch has lost its problem, has fewer than two rows, closed, or leaves the span where it ends.
    NoConvergence
        If its last row is no solution of the problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> part = hb.trace(problem, "Omega", (0.8, 1.6), steps=hb.StepControl(max_points=10))
    >>> whole = hb.extend(part)
    >>> len(part), whole.message
    (10, 'Omega = 1.6 reached')
    """
    if problem is None:  # a file tells that of a response curve, not of one of special points
        problem = branch.problem if "curve" in branch.meta else branch.require_problem()
    if problem is None:
        raise ValueError("extending needs the problem; load the branch with load(path, problem=HarmonicBalance(...))")
    if len(branch) < 2:
        raise ValueError(f"the branch has {len(branch)} rows; need two, which tell which way it goes: trace it anew")
    if span is None:
        span = branch.meta.get("trace", {}).get("span") or (float(branch.values[0]), float(branch.values[-1]))
    first, last = span
    _check_end(branch, float(first), float(last))
    before, here = (_unknowns(problem, branch, i) for i in (-2, -1))
    direction = np.append(here - before, branch.values[-1] - branch.values[-2])
    start = BranchStart(here, branch.parameters_at(-1), direction, away=False)
    options = {"stability": branch.multipliers is not None, **options}
    new = trace(problem, branch.parameter, (float(first), float(last)), start, **options)
    whole = append_continuation(*padded_to_common_size(branch, new))
    whole = dataclasses.replace(whole, problem=most_resolved(branch, new))
    return dataclasses.replace(whole, jump_records=find_jumps(whole, options.get("settings", NewtonSettings())))


def _check_end(branch: Branch, first: float, last: float) -> None:
    if branch.status in (Status.CLOSED, Status.MERGED, Status.UNBOUNDED):
        raise ValueError(f"the branch ends where it should ({branch.message}); there is nothing to go on to")
    before, end = branch.values[-2:]
    low, high = sorted((first, last))
    if not low <= end <= high or (end in (low, high) and not low <= 2 * end - before <= high):
        raise ValueError(
            f"the branch ends at {branch.parameter} = {end:.6g}, going out of the span ({first:g}, {last:g}); "
            "give a longer span"
        )


def _unknowns(problem: Any, branch: Branch, i: int) -> Array:
    """Unknowns of a row as the problem has them."""
    asked = as_problem(problem)
    return asked.join(asked.from_point(branch[i]), branch.parameters_at(i))
