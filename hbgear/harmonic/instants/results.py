"""Branches of exact motions: the points of a curve in contact instants as harmonics, multipliers and special points."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from hbgear.continuation.curve.builder import SpecialPointMark, build_branch
from hbgear.continuation.curve.segment import CurvePoint
from hbgear.continuation.events.accuracy import PARAMETER_ROUNDING
from hbgear.continuation.events.event import Event, LocatedEvent
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.tracing.state import TraceSetup
from hbgear.harmonic.instants.corrector import Family
from hbgear.harmonic.instants.following import ExactCurve
from hbgear.harmonic.instants.observables import observed_point
from hbgear.harmonic.instants.special_points.critical import ExactPoint

EXACT_ERRORS = {"BP": 1e-7, "EP": 1e-7}
"""Relative error of points at which the equations are singular; the others have the error of rounding. Folds, doublings
and grazing points of a hard stop differ from a solution of 30 digits by less than 1e-13."""

GRAZING_NOTE = {1: "highest", -1: "lowest"}
"""Extremum that grazes a breakpoint, by the direction of the switch."""


def build_exact_branch(
    equations: CurveEquations, family: Family, curve: ExactCurve, events: Mapping[str, Event], setup: TraceSetup
) -> Branch:
    """Return the branch of a curve, without jumps; X are the exact Fourier coefficients of the elements up to H.

    ``events`` has the event of each kind of special point.
    """
    settings, span = setup.settings, setup.span
    points = [
        _curve_point(equations.problem, family, point, step, settings.stability)
        for point, step in zip(curve.points, curve.steps, strict=True)
    ]
    for before, point in zip([points[0], *points], points, strict=False):
        if point.parameter_direction == 0:
            point.parameter_direction = before.parameter_direction
    marks = []
    for mark in curve.marks:
        low, high = points[max(mark.index - 1, 0)], points[min(mark.index + 1, len(points) - 1)]
        switches = sorted(contact.switch for contact in mark.contacts)
        elements = family(points[mark.index].value).equations.system.elements
        note = ", ".join(_grazing_text(elements, switch, curve.points[mark.index]) for switch in switches)
        error = EXACT_ERRORS.get(mark.kind, PARAMETER_ROUNDING) * abs(points[mark.index].value)
        event = LocatedEvent(events[mark.kind], 0.5, points[mark.index], True, note or "in contact instants", error)
        marks.append(SpecialPointMark(mark.index, event, (low.value, high.value)))
    return build_branch(equations, points, marks, (curve.status, curve.message), settings.header(span.start, span.end))


def _grazing_text(elements: Sequence[Any], switch: Any, point: ExactPoint) -> str:
    """Return the extremum and the element of a grazing contact; it is an inner one if the motion has other contacts."""
    element = elements[switch.element]
    inner = any(other[:2] == switch[:2] for other in point.state.pattern.switches)
    extremum = "inner extremum" if inner else GRAZING_NOTE[switch.sign]
    return f"{extremum} of {element.name} at {element.law.breakpoints[switch.breakpoint]:g}"


def _curve_point(problem: Any, family: Family, point: ExactPoint, step: float, stability: bool) -> CurvePoint:
    """Return a point of a branch: harmonics, multipliers, regime."""
    ode, iterate = family(point.state.value), point.state.iterate
    out = observed_point(ode, iterate, point.linearised, problem.H, [point.state.value], float(point.tangent[-1]))
    out.step, out.iterations = step, point.iterations
    out.observed |= {"instants": iterate.tau % ode.period, "shortest": float(iterate.durations(ode.period).min())}
    if stability:
        out.observed |= {"multipliers": point.multipliers, "modulus_error": math.nan}
    return out
