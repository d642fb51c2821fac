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
from hbgear.harmonic.contact_instants import (
    MAX_HARD_COORDINATES,
    RELOCATED_KINDS,
    ContactInstants,
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
    problem: ContactInstants, point: SpecialPoint, here: Mapping[str, float], parameter: str, names: Sequence[str]
) -> Slopes:
    """Return the derivatives of the coefficients and of the parameter of the curve at a special point.

    Parameters
    ----------
    problem : ContactInstants
        Problem of the curve.
    point : SpecialPoint
        Point for which `is_exact` holds.
    here : dict of str to float
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
    known = None if contacts else point_on_curve(problem.family(parameter, fixed), state, scale)

    def located(at: Mapping[str, float], name: str) -> tuple[Array, float]:
        moved = _family(problem, parameter, {**fixed, name: at[name]})
        if known is None:
            found = locate_grazing(moved, state, contacts, scale).state
        else:
            found = relocated(moved, known, point.kind).state
        return coefficients(moved(found.value), found.iterate, problem.H)[0].ravel(), found.value

    X, p = np.zeros((len(names), len(point.X))), np.zeros(len(names))
    for i, name in enumerate(names):
        X[i], p[i] = parameter_derivatives(problem, name, here, partial(located, name=name))
    return Slopes(X, p)


def slopes_of_motion(
    problem: ContactInstants, point: Point, here: Mapping[str, float], parameter: str, names: Sequence[str]
) -> tuple[Array, Array]:
    """Return the derivatives (A, n) of the coefficients of a motion in parameters, and (n,) in that of the curve.

    ``here`` are all parameters, with the value of the parameter of the curve.

    Raises
    ------
    NoConvergence
        If a neighbouring model does not have the motion.
    """
    fixed = {name: x for name, x in point.parameters.items() if name != parameter}
    value = here[parameter]
    state = problem.exact_state(point.X, parameter, {**fixed, parameter: value})
    scale = state.scale(abs(value) or 1.0)
    hold = np.zeros(len(scale))
    hold[-1] = 1.0

    def motion(at: Mapping[str, float], name: str) -> tuple[Array]:
        family = _family(problem, parameter, fixed if name == parameter else {**fixed, name: at[name]})
        z = np.append(state.z[:-1], at[parameter])
        found = correct(family, state.with_z(z), hold, scale)[0]
        return (coefficients(family(found.value), found.iterate, problem.H)[0].ravel(),)

    X = np.zeros((len(names) + 1, len(point.X)))
    for row, name in zip(X, (*names, parameter), strict=True):
        (row[:],) = parameter_derivatives(problem, name, here, partial(motion, name=name))
    return X[:-1], X[-1]


def _family(problem: ContactInstants, parameter: str, fixed: Mapping[str, float]) -> Family:
    """Return the equations as a function of the parameter of a curve; raise ValueError for inadmissible parameters."""
    problem.model_at(fixed)
    return problem.family(parameter, fixed)
