"""Derivatives of points of curves in contact instants, from points of neighbouring models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.sensitivity import Slopes
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.contact_instants.problem import ContactInstants
from hbgear.harmonic.contact_instants.special_states import (
    MAX_HARD_COORDINATES,
    RELOCATED_KINDS,
    grazing_contacts,
    special_state,
)  # fmt: skip
from hbgear.harmonic.instants.corrector import Family, correct
from hbgear.harmonic.instants.sampling import coefficients
from hbgear.harmonic.instants.special_points.critical import point_on_curve, relocated
from hbgear.harmonic.instants.special_points.grazing import locate_grazing


def is_exact(problem: Any, point: Point) -> bool:
    """Return whether a point is a special point of a curve in contact instants whose exact motion is known."""
    if not isinstance(problem, ContactInstants) or not isinstance(point, SpecialPoint):
        return False
    if point.kind not in RELOCATED_KINDS:
        return bool(point.kind == "GR" and grazing_contacts(problem, point))
    try:
        special_state(problem, point)
    except NoConvergence:
        return False
    return True


def is_small(problem: ContactInstants) -> bool:
    """Return whether a structure has so few coordinates that exact points are located in milliseconds."""
    return bool(problem.compiled({}).system.n <= MAX_HARD_COORDINATES)


def slopes_of(
    problem: ContactInstants, point: SpecialPoint, parameters: Mapping[str, float], parameter: str, names: Sequence[str]
) -> Slopes:
    """Return the derivatives of the coefficients and of the parameter of the curve at a special point.

    Parameters
    ----------
    problem : ContactInstants
        Problem of the curve.
    point : SpecialPoint
        Point for which `is_exact` holds.
    parameters : dict of str to float
        All parameters.
    parameter : str
        Parameter of the curve.
    names : sequence of str
        Names of A parameters.

    Returns
    -------
    Slopes
        Derivatives (A, n) and (A,).

    Raises
    ------
    NoConvergence
        If a neighbouring model does not have the point.
    """
    fixed = {name: x for name, x in point.parameters.items() if name != parameter}
    contacts = grazing_contacts(problem, point) if point.kind == "GR" else ()
    state = problem.nearest_states(point.X, point.parameters)[0] if contacts else special_state(problem, point)
    scale = state.scale(abs(state.value) or 1.0)
    reference = None if contacts else point_on_curve(problem.family(parameter, fixed), state, scale)

    def located(changed: Mapping[str, float], name: str) -> tuple[Array, float]:
        family = _family(problem, parameter, {**fixed, name: changed[name]})
        if reference is None:
            solution = locate_grazing(family, state, contacts, scale).state
        else:
            solution = relocated(family, reference, point.kind).state
        return coefficients(family(solution.value), solution.iterate, problem.H)[0].ravel(), solution.value

    X, p = np.zeros((len(names), len(point.X))), np.zeros(len(names))
    for i, name in enumerate(names):
        X[i], p[i] = parameter_derivatives(problem, name, parameters, partial(located, name=name))
    return Slopes(X, p)


def slopes_of_motion(
    problem: ContactInstants, point: Point, parameters: Mapping[str, float], parameter: str, names: Sequence[str]
) -> tuple[Array, Array]:
    """Return the derivatives (A, n) of the coefficients of a motion in parameters, and (n,) in that of the curve.

    ``parameters`` are all parameters, with the value of the parameter of the curve.

    Raises
    ------
    NoConvergence
        If a neighbouring model does not have the motion.
    """
    fixed = {name: x for name, x in point.parameters.items() if name != parameter}
    value = parameters[parameter]
    state = problem.exact_state(point.X, parameter, {**fixed, parameter: value})
    scale = state.scale(abs(value) or 1.0)
    constraint = np.zeros(len(scale))
    constraint[-1] = 1.0

    def motion(changed: Mapping[str, float], name: str) -> tuple[Array]:
        family = _family(problem, parameter, fixed if name == parameter else {**fixed, name: changed[name]})
        z = np.append(state.z[:-1], changed[parameter])
        solution = correct(family, state.with_z(z), constraint, scale)[0]
        return (coefficients(family(solution.value), solution.iterate, problem.H)[0].ravel(),)

    X = np.zeros((len(names) + 1, len(point.X)))
    for row, name in zip(X, (*names, parameter), strict=True):
        (row[:],) = parameter_derivatives(problem, name, parameters, partial(motion, name=name))
    return X[:-1], X[-1]


def _family(problem: ContactInstants, parameter: str, fixed: Mapping[str, float]) -> Family:
    """Return the equations as a function of the parameter of a curve; raise ValueError for inadmissible parameters."""
    problem.model_at(fixed)
    return problem.family(parameter, fixed)
