"""Two-parameter continuation: curves of special points.

R(X, p) = 0,   g(X, p) = 0        X and p unknown, a second parameter varies
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

from hbgear.common.argument_checks import checked_arguments
from hbgear.continuation.augmented.branch_point import BranchPointProblem
from hbgear.continuation.augmented.special_point_problem import SpecialPointProblem
from hbgear.continuation.events.detector import event_of
from hbgear.continuation.events.event import Event
from hbgear.continuation.events.registry import event_of_kind
from hbgear.continuation.events.residual_form import in_residual_form
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.concatenation import concatenate
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence
from hbgear.continuation.tracing.jumps import find_jumps
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
    """Trace the curve of a special point in a second parameter.

        R(X, p) = 0,   g(X, p) = 0           unknowns X and p, the parameter of the branch; see `Event.equations`

    The equations depend on the kind of the point: `FoldProblem` for LP, `PeriodDoublingProblem` for PD,
    `NeimarkSackerProblem` for NS (with friction, contacts with dampers, laws of several displacements or compiled laws
    of the user the modulus of a multiplier), `BranchPointProblem` for BP, `GrazingProblem` for GR, the margin of a
    slider for SL, `AmplitudeExtremum` for PK, and the test function for an event of the user. They have the number of
    unknowns with which the point was located. Points of a backbone are followed like points of a response curve.

    Points of codimension two are located along the curve:

    ====  ==================  ======================================================================================
    CP    LP                  cusp: both parameters turn back
    IC    LP                  two folds meet while the first parameter moves: curves join, or an isola begins
    RI    LP, end of NS       1:1 resonance, a double multiplier +1
    RII   PD, end of NS       1:2 resonance, a double multiplier -1
    RIII  NS                  1:3 resonance
    RIV   NS                  1:4 resonance
    FF    LP, PD              fold-flip, multipliers +1 and -1
    LPNS  LP, NS              fold-Neimark-Sacker, a multiplier +1 and a pair on the unit circle
    PDNS  PD, NS              flip-Neimark-Sacker, a multiplier -1 and a pair on the unit circle
    NSNS  NS                  double Neimark-Sacker, two pairs on the unit circle
    GPD   PD                  generalised period doubling: the doubled branch turns over
    ====  ==================  ======================================================================================

    CP and IC exist on curves of any problem, the others on curves of a harmonic balance. RI, RII, FF and GPD on curves
    of LP and PD need laws that have slopes, without friction and contacts with dampers. Points of curves in contact
    instants are followed in contact instants, with CP, IC, RI and RII.

    Parameters
    ----------
    branch : Branch
        Branch with its problem.
    point : str or SpecialPoint
        Label of a special point, or the point itself, such as ``hb.analysis.peaks(branch)[0]``.
    parameter : str
        Name of the second parameter.
    span : (float, float)
        First and last value of the second parameter. If the value of the point lies between them, the curve is traced
        to both ends; if it is the last value, to the first one.
    event : Event, optional
        Event that located the point. It is required for an event of the user that is not
        registered if the branch was loaded from a file.
    **options
        Arguments of `trace`.

    Returns
    -------
    Branch
        Curve of special points.

    Raises
    ------
    TypeError
        If the branch is not a `Branch`, or the point is not a label or a `SpecialPoint`.
    KeyError
        If the label does not exist.
    ValueError
        If there are no equations for this kind (CP, EP), the branch is a curve of special points itself, its problem or
        the event of the point is unknown, or curves cross at single values of the second parameter only (BP).
    NoConvergence
        If the point does not solve the equations of its kind.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.0, 0.6))
    >>> folds = hb.follow(curve, "LP1", "zeta", (0.05, 0.2))
    >>> bool(folds["CP1"].parameters["zeta"] > 0.1)
    True
    """
    branch = replace(branch, problem=branch.continued_problem())
    special = branch[point] if isinstance(point, str) else point
    assert isinstance(special, SpecialPoint)
    problem = as_problem(branch.problem)
    if isinstance(problem, SpecialPointProblem) and not problem.are_solutions:
        raise ValueError("the branch is a curve of special points; follow a point of the curve on which they lie")
    special_event = event or event_of(branch, special) or event_of_kind(special.kind)
    if special_event is None:
        raise ValueError(
            f"the event that located {special.label} is unknown, because files do not store it: give event= or "
            "register it with hb.continuation.register_event"
        )
    if special_event.kind != special.kind:
        raise ValueError(f"event '{special_event.kind}' did not locate {special.label}; give the one that did")
    exact = problem.special_point_equations(branch.parameter, special, branch)
    if exact is not None:
        with suppress(NoConvergence):  # of the first point
            return trace_to_both_ends(exact, parameter, span, special, **options)
    form, start = in_residual_form(problem.at_resolution_of(special), special, branch.parameter, special_event)
    equations = special_event.equations(as_problem(form).original, branch.parameter, start)
    if equations is None:
        raise ValueError(
            f"{special.label} ({special.meaning.partition(': ')[0]}) cannot be followed in a second parameter: no "
            f"equations are known for it{_ALTERNATIVES if special.kind in FOLLOWED else _CHOICE}"
        )
    try:
        curve = trace_to_both_ends(equations, parameter, span, start, **options)
    except NoConvergence as error:
        raise NoConvergence(
            f"{special.label} (stated error {special.error:.1e}) cannot be followed, because it does not solve the "
            f"equations of this kind of point: {error}. If the curve has a corner there, no equations are known; else "
            "trace it with more harmonics",
            error.X,
            error.parameters,
            error.residuals,
        ) from error
    if isinstance(equations, BranchPointProblem):
        equations.require_solutions(curve)
    return curve


FOLLOWED = ("LP", "PD", "NS", "GR", "SL", "PK")
"""Kinds of points of response curves that are followed in a second parameter."""

_CHOICE = f"; choose {', '.join(FOLLOWED)} or an event of your own"
_ALTERNATIVES = " on this curve; trace the curve again at other values of the second parameter"
"""Advice for a point of a kind that cannot be followed, and for a curve on which it cannot."""


def trace_to_both_ends(
    equations: Any, parameter: str, span: tuple[float, float], point: Point, **options: Any
) -> Branch:
    """Trace from a point to the last value of a span, and to the first one unless the point lies there.

    The equations are those of `follow`, the point is a solution of them, and the options are arguments of `trace`. Both
    parts are one branch, from the first to the last value; from the last to the first one if the point lies there.
    """
    low, high = sorted(map(float, span))
    value = {**point.parameters, **options.get("at", {})}.get(parameter, low)
    forward = trace(equations, parameter, span, point, **options)
    if not low < value < high or forward.status in (Status.CLOSED, Status.INTERRUPTED):
        return forward
    backward = trace(equations, parameter, (span[1], span[0]), point, **options)
    curve = concatenate(backward, forward)
    if not options.get("special", True):
        return curve
    return replace(curve, jump_records=find_jumps(curve, options.get("settings", NewtonSettings())))
