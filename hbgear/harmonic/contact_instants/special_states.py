"""Exact motions at special points of curves, which are known, or found again along the curve of other equations."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.bifurcations.codimension_two.resonances import FirstResonanceEvent, SecondResonanceEvent
from hbgear.harmonic.instants.corrector import CurveState
from hbgear.harmonic.instants.pattern import InconsistentPatternError
from hbgear.harmonic.instants.special_points.critical import point_on_curve, relocated
from hbgear.harmonic.instants.special_points.grazing import Grazing
from hbgear.harmonic.instants.special_points.problem import ExactSpecialPointProblem, KnownPoint
from hbgear.harmonic.stability.exact_motion import exact_iterate

RELOCATED_KINDS = ("LP", "PD", "NS")
"""Kinds of special points that are located again along a curve of other equations."""

SAME_PLACE = 1e-9
"""Relative distance of a special point from its place in a file, up to which it is the same one."""

MAX_HARD_COORDINATES = 10
"""Coordinates up to which hard stops are traced in contact instants without a request: some seconds at most."""


def special_state(problem: Any, point: SpecialPoint) -> CurveState:
    """Return the state of a fold, period doubling or Neimark-Sacker point of a curve.

    A curve from a file does not have its states. There the exact motion nearest to the point is computed with a
    free Omega, and the special point is located along the curve.

    Raises
    ------
    NoConvergence
        If the motion is not found at the place of the point, as with contacts that its harmonics do not show.
    """
    states: list[CurveState] = problem.nearest_states(point.X, point.parameters)
    if states:
        return states[0]
    name = list(point.parameters)[-1]
    value = float(point.parameters[name])
    try:
        ode, iterate = exact_iterate(problem, point.X, point.parameters, name == "Omega")
    except InconsistentPatternError as error:
        raise NoConvergence(str(error), point.X, dict(point.parameters), []) from error
    state = CurveState.of(iterate, ode.Omega if name == "Omega" else value)
    family = problem.family(name, {key: x for key, x in point.parameters.items() if key != name})
    point_nearby = point_on_curve(family, state, state.scale(abs(value) or 1.0))
    special = relocated(family, point_nearby, point.kind, reach=0.2).state
    if abs(special.value - value) > SAME_PLACE * abs(value):
        raise NoConvergence(f"no exact motion found at {point.label}", point.X, dict(point.parameters), [])
    return special


def exact_special_point(problem: Any, parameter: str, point: Point) -> ExactSpecialPointProblem | None:
    """Return the problem of a special point whose exact motion is known, with a curve in a second parameter.

    None is returned for structures with many coordinates, which take seconds a point.
    """
    if not isinstance(point, SpecialPoint) or point.kind not in (*RELOCATED_KINDS, "GR"):
        return None
    contacts = grazing_contacts(problem, point) if point.kind == "GR" else ()
    if problem.compiled({}).system.n > MAX_HARD_COORDINATES or (point.kind == "GR" and not contacts):
        return None
    try:
        states = problem.nearest_states(point.X, point.parameters) if contacts else [special_state(problem, point)]
    except NoConvergence:
        return None
    known_point = KnownPoint(states[0], dict(point.parameters), contacts[0] if contacts else None)
    resonances = FirstResonanceEvent(), SecondResonanceEvent()
    return ExactSpecialPointProblem(problem, parameter, point.kind, known_point, resonances)


def exact_or_traced_again(
    problem: Any, parameter: str, point: Point, branch: Branch | None
) -> ExactSpecialPointProblem | None:
    """Return `exact_special_point`; for a point of a curve from a file, also on the same curve traced again.

    The file has the harmonics of each motion, which do not show short contacts.
    """
    exact = exact_special_point(problem, parameter, point)
    span = branch.meta.get("trace", {}).get("span") if branch is not None else None
    is_large = problem.compiled({}).system.n > MAX_HARD_COORDINATES
    if exact is not None or branch is None or span is None or problem.known_states is not None or is_large:
        return exact
    value = point.parameters[parameter]
    with suppress(NoConvergence, ValueError):
        curve = raise_if_interrupted(trace(problem, parameter, tuple(span), at=dict(branch.fixed), stability=False))
        for special in (candidate for part in curve.curves for candidate in part.special):
            is_same = abs(special.parameters[parameter] - value) <= SAME_PLACE * abs(value)
            if is_same and special.kind == getattr(point, "kind", ""):
                return exact_special_point(special.problem, parameter, special)
    return None


def grazing_contacts(problem: Any, point: SpecialPoint) -> tuple[Grazing, ...]:
    """Return the contacts that graze at a point of the curve of a problem; empty for a curve from a file."""
    known, states = problem.known_states, problem.nearest_states(point.X, point.parameters)
    if known is None or not states:
        return ()
    return next((known.contacts.get(i, ()) for i, state in enumerate(known.states) if state is states[0]), ())


def state_of(problem: Any, point: Point) -> CurveState | None:
    """Return the exact motion of a point as the state of a curve; None if it is not found and not required."""
    if isinstance(point, SpecialPoint) and point.kind in RELOCATED_KINDS:
        return special_state(problem, point)
    states: list[CurveState] = problem.nearest_states(point.X, point.parameters)
    with suppress(NoConvergence):
        states = states or [problem.exact_state(point.X, "Omega", point.parameters)]
        return states[0]
    return None
