"""Points of problems without a residual of their own, in a problem whose residual is extended by further equations.

Some problems define solutions in other unknowns, such as contact instants. Their special points are followed and
differentiated in a problem with the same solutions and a residual R(X, p), `ContinuationProblem.residual_form`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from hbgear.continuation.events.event import Event
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.results.point import Point
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NewtonSettings, NoConvergence, solve

AnyPoint = TypeVar("AnyPoint", bound=Point)

RESIDUAL_FORM_ACCURACY = 1e-5
"""Relative difference of a point in both problems, up to which the residual form is accurate enough."""


def in_residual_form(problem: Any, point: AnyPoint, parameter: str, event: Event | None) -> tuple[Any, AnyPoint]:
    """Return the residual form of a problem, and a point in its unknowns; both as given if the problem has a residual.

    The residual form is refined until it has the point, a special one of kind ``event`` or any, at the same value of
    the parameter. NoConvergence is raised if it does not have the point at its highest resolution.
    """
    form = problem.residual_form
    if form is problem:
        return problem, point
    while True:
        with suppress(*SOLVER_ERRORS):
            converted = replace(point, X=problem.in_residual_form(point, form), layout=form.layout, problem=form)
            if _difference(form, converted, parameter, event) <= RESIDUAL_FORM_ACCURACY:
                return form, converted
        if form.refined_problem is None:
            raise NoConvergence(
                f"{getattr(point, 'label', '') or 'the point'} is not known to {form}, which has the equations to "
                "follow and differentiate it: its contacts are too short; choose another point, or trace the curve at "
                "neighbouring values of the parameter",
                point.X,
                dict(point.parameters),
                [],
            )
        form = form.refined_problem


def _difference(problem: Any, point: Point, parameter: str, event: Event | None) -> float:
    """Return the relative difference of a point from the nearest one of the problem."""
    equations = event.equations(as_problem(problem).original, parameter, point) if event else None
    if equations is None:
        X = solve(problem, point.X, dict(point.parameters)).X
        return norm(X - point.X) / (norm(X) or 1.0)
    value = point.parameters[parameter]
    fixed = {name: x for name, x in point.parameters.items() if name != parameter}
    # the point is one of another problem: the iteration may start far from its solution
    solution = equations.located(np.append(point.X, value), fixed, NewtonSettings())
    return abs(float(solution.X[-1]) - value) / (abs(value) or 1.0)
