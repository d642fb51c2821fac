"""Special point, or motion at a constant parameter of its branch, as a function of some parameters of its model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hbgear.analysis.parameter_sensitivity.point_sensitivity import (
    PointSensitivity,
    differentiable,
    parameter_names,
    problem_and_parameters,
    with_cache_size,
)
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.sensitivity import Slopes, of_solution, of_special
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.results.point import Point
from hbgear.continuation.solvers.newton import NoConvergence, solve


class RelocatedPoint:
    """Special point as for `sensitivity`, as a function of some parameters.

    ValueError is raised if the point has no equations, or does not know its problem.
    """

    def __init__(self, point: Point, names: Sequence[str]) -> None:
        point = differentiable(point)
        problem, parameters, parameter = problem_and_parameters(point)
        self._names = parameter_names(problem, parameters, parameter, names)
        sensitivity = PointSensitivity(with_cache_size(problem, point, 4), point, parameters, parameter, self._names)
        self._equations, self._parameters = sensitivity.equations(), parameters
        self._ranges = {name: problem.range_of(name) for name in self._names}
        slopes = sensitivity.slopes()
        self._U = np.append(sensitivity.X, parameters[parameter])
        self._slopes = np.column_stack([slopes.X, slopes.p])

    def refused(self, changes: Array) -> str:
        """Return the condition of a parameter that is outside its range for changes of the parameters, or ""."""
        changed = _changed(self._parameters, self._names, changes)
        return next((f"{name} must {x}" for name, x in self._ranges.items() if changed[name] not in x), "")

    def changed(self, changes: Array) -> dict[str, float]:
        """Return all parameters, of which some are changed."""
        return _changed(self._parameters, self._names, changes)

    def slopes(self, U: Array, parameters: Mapping[str, float]) -> Slopes:
        """Return the derivatives of the unknowns and of the parameter of the branch at a point of `solved`."""
        return of_special(self._equations, U, parameters, self._names)

    def bounds_stable_motions(self, U: Array, parameters: Mapping[str, float]) -> bool:
        """Return whether no multiplier is outside the unit circle at a point of `solved`, apart from its critical ones.

        Otherwise the motions on both sides of the point are unstable, and no sweep reaches it.
        """
        X, unknown = self._equations.solution_of(U)
        mu = as_problem(self._equations.problem).observe(X, True, **{**parameters, **unknown}).get("multipliers")
        return mu is None or bool(np.abs(mu).max(initial=0.0) < 1 + _CRITICAL_MARGIN)

    def solved(self, changes: Array) -> tuple[Array, dict[str, float]]:
        """Return the unknowns U = (X, p) and all parameters of the point with changed parameters (A,).

        NoConvergence, ValueError or LinAlgError is raised if there is no point near the prediction of first order.
        """
        parameters = _changed(self._parameters, self._names, changes)
        U = self._U + changes @ self._slopes
        solution = solve(self._equations.with_borders_at(U, parameters), U, parameters).X
        if not is_near(solution[-1], self._U[-1], U[-1] - self._U[-1]):
            raise NoConvergence("Newton ended at another point", solution, parameters, [])
        return solution, parameters


def _changed(parameters: Mapping[str, float], names: Sequence[str], changes: Array) -> dict[str, float]:
    """Return a copy of the parameters in which the named ones are changed."""
    return {**parameters, **{name: parameters[name] + float(x) for name, x in zip(names, changes, strict=True)}}


def is_near(value: float, old: float, change: float) -> bool:
    """Return whether a point at a value can be the one that was at an old value, with a change of first order."""
    return abs(value - old) <= _MAX_CHANGE_RATIO * (abs(change) + 1e-3 * abs(old))


_MAX_CHANGE_RATIO = 5.0
"""Largest change of a point over its prediction of first order; a larger one belongs to another point."""


_CRITICAL_MARGIN = 1e-2
"""Distance of the critical multipliers from the unit circle [-] that truncated harmonics may cause."""


class RelocatedMotion:
    """Motion at a constant parameter of its branch, no fold, as a function of parameters, like a point."""

    def __init__(self, point: Point, names: Sequence[str]) -> None:
        self._problem, self._parameters, self._parameter = problem_and_parameters(point)
        self._names = parameter_names(self._problem, self._parameters, self._parameter, names)
        self._X = point.X
        self._slopes = of_solution(self._problem, self._X, self._parameters, self._names).X

    def slopes(self, U: Array, parameters: Mapping[str, float]) -> Slopes:
        """Return the derivatives of the unknowns at a motion of `solved`."""
        return of_solution(self._problem, U[:-1], parameters, self._names)

    def solved(self, changes: Array) -> tuple[Array, dict[str, float]]:
        """Solve for the motion with changed parameters; see `RelocatedPoint.solved`."""
        parameters = _changed(self._parameters, self._names, changes)
        X = solve(self._problem, self._X + changes @ self._slopes, parameters, self._parameter).X
        return np.append(X, parameters[self._parameter]), parameters
