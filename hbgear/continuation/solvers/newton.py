"""Newton's method with step halving at fixed parameters.

X <- X - t J^-1 R,   t = 1, 1/2, 1/4, ...   the first that lowers |R|

References
----------
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.numerics.linear import as_dense, is_singular, norm, solve_linear
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem, linearise
from hbgear.continuation.problem.evaluation import HELD, Evaluation


class NoConvergence(RuntimeError):
    """Newton's method failed; carries the last iterate ``X``, ``parameters`` and relative ``residuals``.

    Examples
    --------
    >>> import hbgear as hb
    >>> import numpy as np
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> try:
    ...     hb.trace(problem, "Omega", (0.8, 1.6), np.full(11, 1e6), settings=hb.NewtonSettings(max_iterations=1))
    ... except hb.NoConvergence as error:
    ...     print(len(error.residuals) > 0, error.parameters["Omega"])
    ...
    True 0.8
    """

    def __init__(self, message: str, X: Array, parameters: Mapping[str, float], residuals: list[float]) -> None:
        super().__init__(message)
        self.X, self.parameters, self.residuals = X, dict(parameters), residuals


@dataclass(frozen=True)
class NewtonSettings:
    """Corrector settings.

    tolerance : largest |R| / size of a converged point. A trace gives a row that is not a hundred times better one
        Newton step more, for predictions are often good enough to be accepted with few digits.
    step_tolerance : largest last Newton step relative to |u| of a converged point.
    max_iterations : Newton steps before giving up.

    Raises
    ------
    ValueError
        If a number is not positive, or max_iterations no whole number.

    Examples
    --------
    >>> import hbgear as hb
    >>> exact = hb.NewtonSettings(tolerance=1e-12)
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 0.9), settings=exact)
    >>> bool(curve.residual.max() <= 1e-12)
    True
    """

    tolerance: float = 1e-10
    step_tolerance: float = 1e-6
    max_iterations: int = 12

    def __post_init__(self) -> None:
        for name in ("tolerance", "step_tolerance"):
            checked("Settings", name, getattr(self, name), POSITIVE)
        counted("Settings: max_iterations", self.max_iterations)


@dataclass(frozen=True)
class Solution:
    """A converged point: X, the parameter's value, its evaluation, Newton steps and relative residual."""

    X: Array
    value: float
    evaluation: Evaluation
    iterations: int
    residual: float


def solution_at(
    problem: ContinuationProblem, u: Array, name: str, parameters: Mapping[str, float], iterations: int = 0
) -> Solution:
    """The solution known to lie at u (n + 1,), with its evaluation."""
    now = linearise(problem, u[:-1], name, {**parameters, name: float(u[-1])})
    return Solution(u[:-1], float(u[-1]), now, iterations, norm(now.R) / now.size)


def on_curve(solution: Solution) -> Solution:
    """The solution of a curve in a parameter that a special point is, from that of its equations with one more."""
    R, J, _, size = solution.evaluation
    n = len(R) - 1
    now = Evaluation(R[:n], J[:n, :n], as_dense(J[:n, n:]).ravel(), size)
    return Solution(solution.X[:n], float(solution.X[n]), now, solution.iterations, norm(R[:n]) / size)


def solve(
    problem: Any,
    X: Array,
    parameters: Mapping[str, float],
    name: str = "",
    settings: NewtonSettings = NewtonSettings(),
) -> Solution:
    """Newton with step halving at fixed parameters.

    Parameters
    ----------
    X : (n,) start.
    parameters : all parameters of the problem.
    name : the parameter whose value and derivative the solution holds; if empty they are nan and 0.

    Raises
    ------
    NoConvergence
        If the residual does not fall below the tolerance.
    """
    X = np.array(X, dtype=float)
    problem = as_problem(problem).with_borders_at(X, parameters)
    found = _compiled(problem, X, parameters, name, settings)
    if found is not None:
        return found
    now = linearise(problem, X, name, parameters)
    residuals = [norm(now.R) / now.size]
    for iteration in range(settings.max_iterations * 4 + 1):
        if residuals[-1] <= settings.tolerance:
            return Solution(X, parameters[name] if name else math.nan, now, iteration, residuals[-1])
        try:
            dX = -solve_linear(now.dR_dX, now.R)
        except np.linalg.LinAlgError:
            break
        factor = 1.0
        for _ in range(12):
            trial = linearise(problem, X + factor * dX, name, parameters)
            if norm(trial.R) < norm(now.R) * (1 - 0.1 * factor):
                break
            factor *= 0.5
        else:
            break
        X, now = X + factor * dX, trial
        residuals.append(norm(now.R) / now.size)
    if is_singular(now.dR_dX):
        raise NoConvergence(
            f"the Jacobian is singular: something is not determined by the equations at this point "
            f"({problem.singular_hint}, or a fold exactly at the start); move the start",
            X, parameters, residuals,
        )  # fmt: skip
    raise NoConvergence(
        f"Newton stopped at a relative residual of {residuals[-1]:.2e} (needed {settings.tolerance:.0e}) "
        f"after {len(residuals) - 1} steps at {describe(parameters)}",
        X, parameters, residuals,
    )  # fmt: skip


def _compiled(
    problem: ContinuationProblem, X: Array, parameters: Mapping[str, float], name: str, settings: NewtonSettings
) -> Solution | None:
    """`solve` without Python, if the problem has that; None where it finds nothing: `solve` tells why."""
    curve = name or problem.usual_parameter
    locate = problem.compiled_locator(curve, parameters, HELD)
    if locate is None:
        return None
    n = len(X)
    U, R, A = np.append(X, parameters[curve]), np.empty(n + 1), np.empty((n + 1, n + 1))
    steps, size = locate(U, 0, settings.tolerance, settings.max_iterations, R, A)  # `solve` goes on longer
    if steps < 0:
        return None
    value, dR = (float(U[n]), A[:n, n]) if name else (math.nan, np.zeros(n))
    return Solution(U[:n], value, Evaluation(R[:n], A[:n, :n], dR, size), steps, norm(R[:n]) / size)


def refine(
    problem: ContinuationProblem, solution: Solution, parameters: Mapping[str, float], name: str = ""
) -> Solution:
    """The solution after one more Newton step; as it was if that does not lower its residual.

    For equations so flat that a residual at the tolerance leaves digits of the unknowns open, as at special points, and
    rows of a curve that shall have as many as the others. name : as of `solve`.
    """
    problem = problem.with_borders_at(solution.X, parameters)
    try:
        X = solution.X - solve_linear(solution.evaluation.dR_dX, solution.evaluation.R)
    except np.linalg.LinAlgError:
        return solution
    now = linearise(problem, X, name, parameters)
    residual = norm(now.R) / now.size
    if not residual < solution.residual:
        return solution
    return replace(solution, X=X, evaluation=now, iterations=solution.iterations + 1, residual=residual)


def describe(parameters: Mapping[str, float]) -> str:
    """The parameters as ``p = 0.9, zeta = 0.05`` (at most four)."""
    shown = [f"{k} = {v:.6g}" for k, v in list(parameters.items())[:4]]
    return ", ".join(shown)
