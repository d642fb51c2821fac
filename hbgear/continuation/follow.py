"""Special points followed in a second parameter."""

from __future__ import annotations

from typing import Any

from hbgear.common.argument_checks import checked_arguments
from hbgear.continuation.events.detector import event_of
from hbgear.continuation.events.event import Event
from hbgear.continuation.events.registry import event_of_kind
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.tracing.trace import trace


@checked_arguments(
    point="the label of a special point of the branch, such as 'LP1'",
    parameter="the name of a parameter, such as 'zeta'",
)
def follow(
    branch: Branch,
    point: str | SpecialPoint,
    parameter: str,
    span: tuple[float, float],
    *,
    event: Event | None = None,
    **options: Any,
) -> Branch:
    """Follow a special point of a branch in a second parameter.

        R(X, p) = 0,   g(X, p) = 0           unknowns X and p, the parameter of the branch; see `Event.equations`

    The same as `trace` of the equations of that kind: `FoldProblem` for LP, `PeriodDoublingProblem` for PD,
    `GrazingProblem` for GR, `AmplitudeExtremum`
    for PK, and for an event of your own its test; with the unknowns of the point, if those are more than the branch's.

    Parameters
    ----------
    branch : a branch that still knows its problem.
    point : label of one of its special points, or the point itself, such as ``hb.analysis.peaks(branch)[0]``.
    parameter, span : the second parameter, and from where to where.
    event : the event that located the point, if the branch was loaded from a file and the event is your own and not
        registered.
    options : passed to `trace`.

    Raises
    ------
    TypeError
        If it is no branch, or the point is neither label nor special point.
    KeyError
        If there is no such label.
    ValueError
        If no equations are known for that kind (BP, CP, EP), the branch is one of special points itself, or it has
        lost its problem or the point its event.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.0, 0.6))
    >>> folds = hb.follow(curve, "LP1", "zeta", (0.05, 0.2))
    >>> bool(folds["CP1"].parameters["zeta"] > 0.1)
    True
    """
    here = branch[point] if isinstance(point, str) else point
    assert isinstance(here, SpecialPoint)
    if branch.problem is None:
        raise ValueError("following needs the problem; load the branch with load(path, problem=HarmonicBalance(...))")
    problem = as_problem(branch.problem)
    if problem.unknown_parameters:
        raise ValueError("the branch is one of special points already; follow points of a curve in one parameter")
    meant = event or event_of(branch, here) or event_of_kind(here.kind)
    if meant is None:
        raise ValueError(f"{here.label} has lost the event that located it, as what comes from a file has: give event= "
                         "or register it with hb.continuation.register_event")  # fmt: skip
    if meant.kind != here.kind:
        raise ValueError(f"event '{meant.kind}' did not locate {here.label}; give the one that did")
    equations = meant.equations(as_problem(problem.at_resolution_of(here)).original, branch.parameter, here)
    if equations is None:
        raise ValueError(
            f"{here.label} ({here.meaning.partition(':')[0]}) cannot be followed in a second parameter: no equations "
            "are known for it; choose LP, PD, NS, GR, PK or an event of your own"
        )
    return trace(equations, parameter, span, here, **options)
