"""Derivatives of solutions and special points in the parameters of their problem.

    R(X, p, a) = 0,  p held:             dX/da = -J^-1 R_a
    {R, g}(X, p, a) = 0:                 d(X, p)/da = -B^-1 (R_a, g_a),   B the matrix of the special point
    R = 0 and g = 0 along the curve:     dp/da = -(g along dX/da, a) / (g along dX/dp, p),   J regular there
    R(X, p, a) = 0,  a curve:            [J R_p; b^T] d(X, p)/da = -(R_a, 0),   b towards its next point

each from one factorisation for all parameters a. A fold, for one, moves by dp/da = -(w . R_a) / (w . R_p), w the left
null vector of J, which is the last row of the second.

A branch point survives a change of a parameter only if that is no imperfection, w . R_a = 0. Where two curves cross,
J v = 0 and R_p = J z, and with t_1 = (v, 0), t_2 = (-z, 1), both tangent to curves,

    R + b s = 0,   w . d(R_U t_1) = 0,   w . d(R_U t_2) = 0         unknowns (X, p, s)

s the imperfection.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem, borders_of, null_vectors
from hbgear.continuation.numerics.linear import Factors, as_dense, bordered, norm
from hbgear.continuation.problem.base import ContinuationProblem, linearise
from hbgear.continuation.problem.finite_differences import STEP, parameter_derivatives

Value = Callable[[Array, dict[str, float]], float]
"""A smooth function of the unknowns and all parameters."""


class Slopes(NamedTuple):
    """Derivatives X (A, n) of the unknowns and p (A,) of the curve's parameter in A parameters."""

    X: Array
    p: Array


def of_solution(problem: ContinuationProblem, X: Array, here: Mapping[str, float], names: Sequence[str]) -> Slopes:
    """Of a solution whose parameter is held.

    Raises
    ------
    numpy.linalg.LinAlgError
        If it is a fold.
    """
    J = Factors(problem.evaluate(X, **here)[1])
    return Slopes(_answers(J, _moved(problem, X, here, names)), np.zeros(len(names)))


def tangent(problem: ContinuationProblem, X: Array, here: Mapping[str, float], parameter: str) -> Array:
    """dX/dp (n,) along the curve in its parameter, of a solution that is no fold."""
    now = linearise(problem, X, parameter, here)
    return -Factors(now.dR_dX).solve(now.dR_dp)


def of_curve(
    problem: ContinuationProblem,
    U: Array,
    here: Mapping[str, float],
    parameter: str,
    ahead: Array,
    names: Sequence[str],
) -> tuple[Array, Slopes]:
    """The direction (n + 1,) of a curve at U = (X, p), folds included, and how it is displaced, normal to ``ahead``.

    A displacement along the curve itself moves no curve: what is added along its direction is of no account.

    Raises
    ------
    numpy.linalg.LinAlgError
        If two curves cross there.
    """
    X = U[:-1]
    now = linearise(problem, X, parameter, here)
    M = Factors(bordered(now.dR_dX, now.dR_dp, ahead))
    direction = -_answers(M, np.append(np.zeros(len(X)), 1.0)[None])[0]
    moved = _moved(problem, X, here, names)
    slopes = _answers(M, np.column_stack([moved, np.zeros(len(names))]))
    return direction, Slopes(slopes[:, :-1], slopes[:, -1])


def of_special(
    equations: MinimallyAugmentedProblem, U: Array, here: Mapping[str, float], names: Sequence[str]
) -> Slopes:
    """Of a special point that has equations of its own, U = (X, p)."""
    now, moved = equations.with_borders_at(U, here).linearised(U, names, **here)
    slopes = _answers(Factors(now.dR_dX), moved)
    return Slopes(slopes[:, :-1], slopes[:, -1])


def of_crossing(
    problem: ContinuationProblem,
    X: Array,
    here: Mapping[str, float],
    parameter: str,
    names: Sequence[str],
    value: Value,
) -> Slopes:
    """Of a point that is no fold, at which a function of it passes zero along the curve."""
    t = tangent(problem, X, here, parameter)
    X_a = of_solution(problem, X, here, names).X
    rate = along(problem, X, here, value, t, parameter)
    p_a = np.array([-along(problem, X, here, value, dX, name) / rate for name, dX in zip(names, X_a, strict=True)])
    return Slopes(X_a + p_a[:, None] * t, p_a)


def along(
    problem: ContinuationProblem, X: Array, here: Mapping[str, float], value: Value, dX: Array, name: str
) -> float:
    """Derivative of a function of the point along dX (n,) for a change of the parameter by one."""
    at = here[name]
    (moved,) = parameter_derivatives(problem, name, here, lambda there: (value(X + (there[name] - at) * dX, there),))
    return float(moved)


def of_branch_point(
    problem: ContinuationProblem, X: Array, here: Mapping[str, float], parameter: str, names: Sequence[str]
) -> Slopes:
    """Of a point at which two curves cross; nan in parameters of which a change parts the curves."""
    now = linearise(problem, X, parameter, here)
    J, n = as_dense(now.dR_dX), len(X)
    b, c, _ = borders_of(J)
    v, w, _ = null_vectors(J, b, c)
    z = Factors(bordered(J, b, c)).solve(np.append(now.dR_dp, 0.0))[:n]
    tangents = (np.append(v, 0.0), np.append(-z, 1.0))
    M = np.zeros((n + 2, n + 2))
    M[:n, :n], M[:n, n], M[:n, n + 1] = J, now.dR_dp, b
    M[n:, : n + 1] = [_bend(problem, X, here, parameter, w, t) for t in tangents]
    rhs = np.array([_parted(problem, X, here, parameter, name, w, tangents) for name in names]).reshape(-1, n + 2)
    slopes = _answers(Factors(M), rhs)
    kept = np.abs(slopes[:, -1]) <= _PERFECT * np.array([norm(row[:n]) + 1e-300 for row in rhs]) / norm(b)
    slopes[~kept] = np.nan
    return Slopes(slopes[:, :n], slopes[:, n])


_PERFECT = 1e-6  # share of a change of the equations that is no imperfection but rounding


def _bend(
    problem: ContinuationProblem, X: Array, here: Mapping[str, float], parameter: str, w: Array, t: Array
) -> Array:
    """Derivative (n + 1,) of w . [J R_p] t in (X, p), which is that of w . [J R_p] along t."""
    h = STEP * max(1e-3, norm(X)) / norm(t)
    plus, minus = (
        linearise(problem, X + s * t[:-1], parameter, {**here, parameter: here[parameter] + s * t[-1]}) for s in (h, -h)
    )
    change = (as_dense(plus.dR_dX) - as_dense(minus.dR_dX), plus.dR_dp - minus.dR_dp)
    return np.append(w @ change[0], w @ change[1]) / (2 * h)


def _parted(
    problem: ContinuationProblem, X: Array, here: Mapping[str, float], parameter: str, name: str, w: Array,
    tangents: Sequence[Array],
) -> Array:  # fmt: skip
    """R_a and the derivatives of w . [J R_p] t in the parameter a for both tangents, (n + 2,)."""

    def parts(at: dict[str, float]) -> tuple[Array, ...]:
        now = linearise(problem, X, parameter, at)
        return now.R, np.array([w @ (now.dR_dX @ t[:-1] + now.dR_dp * t[-1]) for t in tangents])

    dR, dg = parameter_derivatives(problem, name, here, parts)
    return np.append(dR, dg)


def _moved(problem: ContinuationProblem, X: Array, here: Mapping[str, float], names: Sequence[str]) -> Array:
    """R_a (A, n) in each parameter."""
    rows = [problem.moved(X, name, here) for name in names]
    return np.array(rows).reshape(len(names), len(X))


def _answers(J: Factors, rows: Array) -> Array:
    """-J^-1 of each row (A, n).

    Raises
    ------
    numpy.linalg.LinAlgError
        If J is singular.
    """
    if not len(rows):
        return rows
    answers: Array = -J.solve(rows.T).T
    if not np.isfinite(answers).all():
        raise np.linalg.LinAlgError("singular matrix")
    return answers
