"""Derivatives of points of curves in contact instants, from points of neighbouring models."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.sensitivity import Slopes
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.contact_instants.problem import ContactInstants
from hbgear.harmonic.contact_instants.special_states import RELOCATED_KINDS, grazing_contacts, special_state, state_of
from hbgear.harmonic.instants.corrector import Family, correct
from hbgear.harmonic.instants.sampling import coefficients
from hbgear.harmonic.instants.shooting import linearise
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


def slopes_of(
    problem: ContactInstants, point: SpecialPoint, parameters: Mapping[str, float], parameter: str, names: Sequence[str]
) -> Slopes:
    """Return the derivatives of the coefficients (A, n) and of the parameter of the curve (A,) at a special point.

    The point is one for which `is_exact` holds, ``parameters`` are all parameters, ``names`` those of the derivatives.
    NoConvergence is raised if a neighbouring model does not have the point.
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

    ``parameters`` are all parameters, with the value of the parameter of the curve. NoConvergence is raised if a
    neighbouring model does not have the motion.
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


NeighbouringFamilies = Callable[[str, float], Family]
"""Equations of a curve as a function of name and value of another parameter."""

TANGENT_STEP = 1e-6
"""Finite-difference step along a curve, in scaled unknowns: truncation and rounding errors are below 1e-9."""


def neighbouring_families(problem: ContactInstants, parameter: str, fixed: Mapping[str, float]) -> NeighbouringFamilies:
    """Return the equations of a curve as a function of name and value of another parameter; they are stored."""
    return cache(lambda name, value: _family(problem, parameter, {**fixed, name: value}))


def slopes_of_curve(
    problem: ContactInstants,
    point: Point,
    parameters: Mapping[str, float],
    border: Array,
    names: Sequence[str],
    families: NeighbouringFamilies,
) -> tuple[Array, Slopes]:
    """Return the direction (n + 1,) of a curve, and its displacements across the curve; see `of_curve`.

        [F_z; t] dz/da = -[F_a; 0],   dX/da = X_z dz/da + X_a        z instants, states and p, X coefficients, t tangent

    X depends on z and a; its derivatives are central differences at states near the curve, which are not corrected.
    The equations are regular at a grazing point, where a contact of a neighbouring model may not exist.

    Raises
    ------
    NoConvergence
        If the exact motion of the point is not known.
    """
    state = state_of(problem, point)
    if state is None:
        raise NoConvergence("the exact motion is not known: trace the curve again", point.X, point.parameters, [])
    scale = state.scale(abs(state.value) or 1.0)

    def moved(family: Family, step: Array) -> Array:
        z = state.with_z(state.z + step)
        return np.append(coefficients(family(z.value), z.iterate, problem.H)[0].ravel(), z.value)

    def residual(changed: Mapping[str, float], name: str) -> tuple[Array]:
        return (linearise(families(name, changed[name])(state.value), state.iterate, False).R,)

    def displaced(changed: Mapping[str, float], name: str, rate: Array) -> tuple[Array]:
        return (moved(families(name, changed[name]), (changed[name] - parameters[name]) * rate),)

    unchanged = families(names[0], parameters[names[0]])
    exact = point_on_curve(unchanged, state, scale)
    along = TANGENT_STEP * exact.tangent * scale
    direction = (moved(unchanged, along) - moved(unchanged, -along)) / (2 * TANGENT_STEP)
    bordered, slopes = np.vstack([exact.J * scale, exact.tangent]), np.zeros((len(names), len(direction)))
    for row, name in zip(slopes, names, strict=True):
        (F_a,) = parameter_derivatives(problem, name, parameters, partial(residual, name=name))
        rate = scale * np.linalg.solve(bordered, -np.append(F_a, 0.0))
        (row[:],) = parameter_derivatives(problem, name, parameters, partial(displaced, name=name, rate=rate))
    return direction * np.copysign(1.0, direction @ border), Slopes(slopes[:, :-1], slopes[:, -1])


def _family(problem: ContactInstants, parameter: str, fixed: Mapping[str, float]) -> Family:
    """Return the equations as a function of the parameter of a curve; raise ValueError for inadmissible parameters."""
    problem.model_at(fixed)
    return problem.family(parameter, fixed)
