"""Derivatives of solutions and special points in the parameters of their problem.

    R(X, p, a) = 0,  p held:             dX/da = -J^-1 R_a
    {R, g}(X, p, a) = 0:                 d(X, p)/da = -B^-1 (R_a, g_a),   B the matrix of the special point
    R(X, p, a) = 0,  a curve:            [J R_p; b^T] d(X, p)/da = -(R_a, 0),   b towards its next point

One factorisation serves all parameters a. For example, the sensitivity of a fold is dp/da = -(w . R_a) / (w . R_p)
with the left null vector w of J; this is the last row of the second equation.

A branch point persists under a change of a parameter only if the change is no imperfection, w . R_a = 0. At a branch
point J v = 0 and R_p = J z, and with t_1 = (v, 0), t_2 = (-z, 1), both tangent to curves,

    R + b s = 0,   w . d(R_U t_1) = 0,   w . d(R_U t_2) = 0         unknowns (X, p, s)

where s is the imperfection.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.augmented.null_vectors import borders_of, null_vectors
from hbgear.continuation.numerics.linear import Factors, as_dense, bordered, norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.finite_differences import STEP, directional_step, parameter_derivatives

Value = Callable[[Array, dict[str, float]], float]
"""Type of a smooth function of the unknowns and all parameters."""


class Slopes(NamedTuple):
    """Derivatives of the unknowns (A, n) and of the parameter of the curve (A,) in A parameters."""

    X: Array
    p: Array


def of_solution(
    problem: ContinuationProblem, X: Array, parameters: Mapping[str, float], names: Sequence[str]
) -> Slopes:
    """Return the derivatives of a solution at a fixed parameter of the curve; LinAlgError if the solution is a fold."""
    J = Factors(problem.evaluate(X, **parameters)[1])
    return Slopes(_minus_solutions(J, _parameter_derivatives(problem, X, parameters, names)), np.zeros(len(names)))


def tangent(problem: ContinuationProblem, X: Array, parameters: Mapping[str, float], parameter: str) -> Array:
    """Return dX/dp (n,) along the curve at a solution that is not a fold."""
    evaluation = problem.linearise(X, parameter, **parameters)
    return -Factors(evaluation.dR_dX).solve(evaluation.dR_dp)


def of_curve(equations: CurveEquations, U: Array, border: Array, names: Sequence[str]) -> tuple[Array, Slopes]:
    """Return the direction (n + 1,) of a curve at U = (X, p), and its displacement orthogonal to ``border``.

    The point may be a fold; LinAlgError is raised where two curves cross. A displacement along the curve does not
    change the curve, so that this component is arbitrary.
    """
    evaluation = equations.linearise(U)
    M = Factors(bordered(evaluation.dR_dX, evaluation.dR_dp, border))
    direction = -_minus_solutions(M, np.append(np.zeros(len(U) - 1), 1.0)[None])[0]
    changes = _parameter_derivatives(equations.problem, U[:-1], equations.parameters_at(float(U[-1])), names)
    slopes = _minus_solutions(M, np.column_stack([changes, np.zeros(len(names))]))
    return direction, Slopes(slopes[:, :-1], slopes[:, -1])


def of_special(
    equations: MinimallyAugmentedProblem, U: Array, parameters: Mapping[str, float], names: Sequence[str]
) -> Slopes:
    """Return the derivatives of a special point U = (X, p) that is defined by augmented equations."""
    evaluation, changes = equations.with_borders_at(U, parameters).linearised(U, names, **parameters)
    slopes = _minus_solutions(Factors(evaluation.dR_dX), changes)
    return Slopes(slopes[:, :-1], slopes[:, -1])


def along(
    problem: ContinuationProblem, X: Array, parameters: Mapping[str, float], value: Value, dX: Array, name: str
) -> float:
    """Return the derivative of a function of the point along dX (n,) per unit change of a parameter.

    The largest step changes the unknowns as little as the parameter: near a fold dX/dp is large. A point may lie still
    closer to a grazing contact, beyond which the function is another one, and rounding limits small steps. Steps are
    reduced until two successive differences agree; else the one is returned that differs least from the one before.
    """
    p = parameters[name]
    change = norm(dX) * problem.unit_of(name, p)
    step = STEP * min(1.0, max(1e-3, norm(X)) / change) if change else STEP

    def moved_value(values: dict[str, float]) -> tuple[float]:
        return (value(X + (values[name] - p) * dX, values),)

    best, smallest, last = math.nan, math.inf, math.nan
    for _ in range(STEP_SIZES):
        (derivative,) = parameter_derivatives(problem, name, parameters, moved_value, step)
        difference = abs(derivative - last)
        if difference < smallest:
            best, smallest = derivative, difference
        if smallest <= AGREEMENT * abs(derivative):
            break
        last, step = derivative, step / STEP_RATIO
    return float(best)


STEP_RATIO, STEP_SIZES = 8.0, 6
"""Ratio of the step sizes of differences along a curve, and their number: 1e-5 to 3e-10 of the size of a point."""


AGREEMENT = 1e-6
"""Relative difference of two derivatives with successive step sizes that agree."""


def of_branch_point(equations: CurveEquations, U: Array, names: Sequence[str]) -> Slopes:
    """Return the derivatives of a branch point U = (X, p); nan in parameters whose change separates the curves."""
    evaluation = equations.linearise(U)
    J, n = as_dense(evaluation.dR_dX), len(U) - 1
    b, c, _ = borders_of(J)
    v, w, _ = null_vectors(J, b, c)
    z = Factors(bordered(J, b, c)).solve(np.append(evaluation.dR_dp, 0.0))[:n]
    tangents = (np.append(v, 0.0), np.append(-z, 1.0))  # they span the null space of [dR/dX, dR/dp]
    M = np.zeros((n + 2, n + 2))
    M[:n, :n], M[:n, n], M[:n, n + 1] = J, evaluation.dR_dp, b
    M[n:, : n + 1] = [_curvature_row(equations, U, w, t) for t in tangents]
    rhs = np.array([_crossing_derivatives(equations, U, name, w, tangents) for name in names]).reshape(-1, n + 2)
    slopes = _minus_solutions(Factors(M), rhs)
    valid = np.abs(slopes[:, -1]) <= IMPERFECTION_ROUNDING * np.array([norm(row[:n]) + 1e-300 for row in rhs]) / norm(b)
    slopes[~valid] = np.nan
    return Slopes(slopes[:, :n], slopes[:, n])


IMPERFECTION_ROUNDING = 1e-6
"""Imperfection, relative to the derivative of the equations, below which it is rounding error."""


def _curvature_row(equations: CurveEquations, U: Array, w: Array, t: Array) -> Array:
    """Return the derivative (n + 1,) of w . [J R_p] t in U = (X, p), by differences of w . [J R_p] along t."""
    X, parameters = U[:-1], equations.parameters_at(float(U[-1]))
    h = directional_step(X, t, equations.problem.difference_step(X, parameters))
    plus, minus = (equations.linearise(U + s * t) for s in (h, -h))
    change = (as_dense(plus.dR_dX) - as_dense(minus.dR_dX), plus.dR_dp - minus.dR_dp)
    return np.append(w @ change[0], w @ change[1]) / (2 * h)


def _crossing_derivatives(equations: CurveEquations, U: Array, name: str, w: Array, tangents: Sequence[Array]) -> Array:
    """Return R_a and the derivatives of w . [J R_p] t in the parameter a for both tangents, (n + 2,)."""
    problem, X, parameter = equations.problem, U[:-1], equations.name

    def residuals(values: dict[str, float]) -> tuple[Array, ...]:
        evaluation = problem.linearise(X, parameter, **values)
        return evaluation.R, np.array([w @ (evaluation.dR_dX @ t[:-1] + evaluation.dR_dp * t[-1]) for t in tangents])

    dR, dg = parameter_derivatives(problem, name, equations.parameters_at(float(U[-1])), residuals)
    return np.append(dR, dg)


def _parameter_derivatives(
    problem: ContinuationProblem, X: Array, parameters: Mapping[str, float], names: Sequence[str]
) -> Array:
    """Return R_a (A, n) in each parameter."""
    rows = [problem.parameter_derivative(X, name, parameters) for name in names]
    return np.array(rows).reshape(len(names), len(X))


def _minus_solutions(J: Factors, rows: Array) -> Array:
    """Return -J^-1 r for each row r of an array (A, n); LinAlgError if J is singular."""
    if not len(rows):
        return rows
    solutions = -J.solve(rows.T).T
    if not np.isfinite(solutions).all():
        raise np.linalg.LinAlgError("singular matrix")
    return solutions
