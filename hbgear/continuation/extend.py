"""Extension of a branch beyond the point at which its trace ended."""

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
from hbgear.continuation.results.concatenation import append_continuation
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NewtonSettings
from hbgear.continuation.tracing.jumps import find_jumps
from hbgear.continuation.tracing.trace import trace


@checked_arguments()
def extend(
    branch: Branch, span: tuple[float, float] | None = None, *, problem: AnyProblem | None = None, **options: Any
) -> Branch:
    """Continue the trace of a branch from its last point, and return all points in one branch.

    The other curves of its span, `Branch.others`, are continued in the same way; a curve that is complete is kept. The
    numbering of special points continues, and jumps are searched on the whole branch. The trace does not detect that
    it meets the existing points: a closed curve that was interrupted is traced once around, up to the point from which
    it was extended.

    Parameters
    ----------
    branch : Branch
        Branch that ended early, or at the end of a span that was too short, or with others that did.
    span : (float, float), optional
        Span of the parameter. The default is the span of each curve.
    problem : HarmonicBalance, ContinuationProblem or object with ``evaluate``, optional
        Problem of the new points, for example with more harmonics. The existing points are kept and padded with zeros.
        The default is the problem of each curve.
    **options
        Arguments of `trace`, such as ``steps=StepControl(max_points=5000)``, which counts the new points only.

    Returns
    -------
    Branch
        The existing and the new points.

    Raises
    ------
    TypeError
        If the branch is not a `Branch`.
    ValueError
        If no curve can be extended. The first one does not have its problem, has fewer than two points, is closed, or
        ends where it leaves the span.
    NoConvergence
        If the last point of a curve is not a solution of the problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> part = hb.trace(problem, "Omega", (0.8, 1.6), steps=hb.StepControl(max_points=10))
    >>> whole = hb.extend(part)
    >>> len(part), whole.message
    (10, 'Omega = 1.6 reached')
    """
    curves, complete = list(branch.curves), list[_CompleteCurve]()
    for i, curve in enumerate(curves):
        try:
            curves[i] = _extended(curve, span, problem, options)
        except _CompleteCurve as reason:
            complete.append(reason)
        if curves[i].status is Status.INTERRUPTED and curves[i] is not curve:
            break
    if len(complete) == len(curves):
        raise ValueError(str(complete[0]))
    return dataclasses.replace(curves[0], others=tuple(curves[1:]))


class _CompleteCurve(Exception):
    """There is nothing to trace beyond the last point of a curve, or no direction to trace in."""


def _extended(
    branch: Branch, span: tuple[float, float] | None, problem: AnyProblem | None, options: dict[str, Any]
) -> Branch:
    """Return one curve with its continuation; raise `_CompleteCurve` if it has none."""
    problem = branch.continued_problem() if problem is None else problem
    if len(branch) < 2:
        raise _CompleteCurve(f"the branch has {len(branch)} points; its direction needs two: trace it again")
    traced = traced_span(branch)
    first, last = traced if span is None else sorted(map(float, span), reverse=traced[0] > traced[1])
    _check_end(branch, first, last)
    X_previous, X_last = (_unknowns(problem, branch, i) for i in (-2, -1))
    direction = np.append(X_last - X_previous, branch.values[-1] - branch.values[-2])
    start = BranchStart(X_last, branch.parameters_at(-1), direction, bifurcating=False)
    options = {"stability": branch.multipliers is not None, **options}
    new = trace(problem, branch.parameter, (first, last), start, **options)
    extended = append_continuation(branch, new)
    return dataclasses.replace(extended, jump_records=find_jumps(extended, options.get("settings", NewtonSettings())))


def traced_span(branch: Branch) -> tuple[float, float]:
    """Return the span over which a branch was traced; from its first to its last point if it is unknown."""
    first, last = branch.meta.get("trace", {}).get("span") or (branch.values[0], branch.values[-1])
    return float(first), float(last)


def _check_end(branch: Branch, first: float, last: float) -> None:
    """Raise `_CompleteCurve` if there is nothing to trace beyond the last point."""
    if branch.status in (Status.CLOSED, Status.MERGED, Status.UNBOUNDED):
        raise _CompleteCurve(f"the branch is complete ({branch.message}); there is nothing to extend")
    previous, end = branch.values[-2:]
    low, high = sorted((first, last))
    if not low <= end <= high or (end in (low, high) and not low <= 2 * end - previous <= high):
        raise _CompleteCurve(
            f"the branch ends at {branch.parameter} = {end:.6g}, where it leaves the span; "
            "give a longer span, --to in a command"
        )


def _unknowns(problem: Any, branch: Branch, i: int) -> Array:
    """Return the unknowns of point i in the form of the problem."""
    adapted = as_problem(problem)
    return adapted.join(adapted.from_point(branch[i]), branch.parameters_at(i))
