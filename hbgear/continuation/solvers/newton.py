"""Newton's method with step halving at fixed parameters.

X <- X - t J^-1 R,   t = 1, 1/2, 1/4, ...   the first that reduces |R| sufficiently

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

from hbgear.common.argument_checks import NamedFields
from hbgear.common.arrays import Array
from hbgear.common.ranges import POSITIVE, checked, counted
from hbgear.continuation.numerics.linear import as_dense, is_singular, norm, solve_linear
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import HELD, Evaluation


class NoConvergence(RuntimeError):
    """Newton's method did not converge.

    Parameters
    ----------
    message : str
        Description of the failure.
    X : ndarray, shape (n,)
        Last iterate.
    parameters : mapping of str to float
        Parameters of the iteration.
    residuals : list of float
        Relative residuals of the iterations.

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


SOLVER_ERRORS = (NoConvergence, np.linalg.LinAlgError)
"""Errors of a solver that finds no solution: it does not converge, or a matrix is singular."""

SEARCH_ERRORS = (*SOLVER_ERRORS, ValueError)
"""Errors of a search without a result: those of a solver, and ValueError of a model that refuses its parameters."""


@dataclass(frozen=True)
class NewtonSettings(NamedFields):
    """Settings of the corrector.

    Attributes
    ----------
    tolerance : float, optional
        Largest relative residual |R| / size of a converged point. A trace applies one more iteration to a point whose
        residual is not a hundred times smaller, because predictions are often accepted with few correct digits. The
        default is 1e-10.
    step_tolerance : float, optional
        Largest last Newton step relative to |u| of a converged point. The default is 1e-6.
    max_iterations : int, optional
        Number of iterations after which the corrector fails. The default is 12.

    Raises
    ------
    ValueError
        If a number is not positive, or max_iterations is not a whole number.

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
            checked("NewtonSettings", name, getattr(self, name), POSITIVE)
        counted("NewtonSettings: max_iterations", self.max_iterations)


@dataclass(frozen=True)
class Solution:
    """A converged point: unknowns (n,), value of the parameter, and the evaluation there."""

    X: Array
    value: float
    evaluation: Evaluation
    iterations: int
    residual: float


def solution_at(problem: ContinuationProblem, u: Array, name: str, parameters: Mapping[str, float]) -> Solution:
    """Return the solution at a known position u = (X, value of the parameter), with its evaluation."""
    evaluation = problem.linearise(u[:-1], name, **{**parameters, name: float(u[-1])})
    return Solution(u[:-1], float(u[-1]), evaluation, 0, norm(evaluation.R) / evaluation.size)


def on_curve(solution: Solution) -> Solution:
    """Return the solution of a curve from that of augmented equations, with its parameter as last unknown."""
    R, J, _, size = solution.evaluation
    n = len(R) - 1
    evaluation = Evaluation(R[:n], J[:n, :n], as_dense(J[:n, n:]).ravel(), size)
    return Solution(solution.X[:n], float(solution.X[n]), evaluation, solution.iterations, norm(R[:n]) / size)


def solve(
    problem: Any,
    X: Array,
    parameters: Mapping[str, float],
    name: str = "",
    settings: NewtonSettings = NewtonSettings(),
    max_halvings: int = 11,
) -> Solution:
    """Return the solution near a start X (n,) at fixed parameters, by Newton's method with step halving.

    The solution holds the value of the parameter ``name`` and the derivative in it; without a name they are nan and 0.
    A step is halved until the residual decreases, ``max_halvings`` times at most. NoConvergence is raised if this
    fails, or if the residual does not fall below the tolerance.
    """
    X = np.array(X, dtype=float)
    problem = as_problem(problem).with_borders_at(X, parameters)
    compiled_solution = _compiled(problem, X, parameters, name, settings)
    if compiled_solution is not None:
        return compiled_solution
    evaluation = problem.linearise(X, name, **parameters)
    residuals = [norm(evaluation.R) / evaluation.size]
    for iteration in range(settings.max_iterations * 4 + 1):
        if residuals[-1] <= settings.tolerance:
            return Solution(X, parameters[name] if name else math.nan, evaluation, iteration, residuals[-1])
        try:
            dX = -solve_linear(evaluation.dR_dX, evaluation.R)
        except np.linalg.LinAlgError:
            break
        factor = 1.0
        for _ in range(max_halvings + 1):
            trial = problem.linearise(X + factor * dX, name, **parameters)
            if norm(trial.R) < norm(evaluation.R) * (1 - 0.1 * factor):  # a sufficient decrease, which nan never passes
                break
            factor *= 0.5
        else:
            break
        X, evaluation = X + factor * dX, trial
        residuals.append(norm(evaluation.R) / evaluation.size)
    if is_singular(evaluation.dR_dX):
        raise NoConvergence(
            f"the Jacobian is singular: the equations do not determine all unknowns at this point "
            f"({problem.singular_hint}, or a fold exactly at the start); move the start",
            X,
            parameters,
            residuals,
        )
    raise NoConvergence(
        f"Newton stopped at a relative residual of {residuals[-1]:.2e} (needed {settings.tolerance:.0e}) "
        f"after {len(residuals) - 1} steps at {describe(parameters)}",
        X,
        parameters,
        residuals,
    )


def _compiled(
    problem: ContinuationProblem, X: Array, parameters: Mapping[str, float], name: str, settings: NewtonSettings
) -> Solution | None:
    """Return the result of the compiled Newton iteration, or None if it does not exist or does not converge."""
    curve = name or problem.usual_parameter
    locate = problem.compiled_locator(curve, parameters, HELD)
    if locate is None:
        return None
    n = len(X)
    U, R, A = np.append(X, parameters[curve]), np.empty(n + 1), np.empty((n + 1, n + 1))
    steps, size = locate(U, 0, settings.tolerance, settings.max_iterations, R, A)  # `solve` allows more iterations
    if steps < 0:
        return None
    value, dR = (float(U[n]), A[:n, n]) if name else (math.nan, np.zeros(n))
    return Solution(U[:n], value, Evaluation(R[:n], A[:n, :n], dR, size), steps, norm(R[:n]) / size)


def refine(
    problem: ContinuationProblem, solution: Solution, parameters: Mapping[str, float], name: str = ""
) -> Solution:
    """Return a solution after one more Newton iteration, or unchanged if that does not reduce its residual.

    It gives special points, at which a residual at the tolerance determines few digits of the unknowns, the accuracy of
    the other points.
    """
    problem = problem.with_borders_at(solution.X, parameters)
    try:
        X = solution.X - solve_linear(solution.evaluation.dR_dX, solution.evaluation.R)
    except np.linalg.LinAlgError:
        return solution
    evaluation = problem.linearise(X, name, **parameters)
    residual = norm(evaluation.R) / evaluation.size
    if not residual < solution.residual:
        return solution
    return replace(solution, X=X, evaluation=evaluation, iterations=solution.iterations + 1, residual=residual)


def describe(parameters: Mapping[str, float]) -> str:
    """Return at most four parameters as text such as ``p = 0.9, zeta = 0.05``."""
    shown = [f"{k} = {v:.6g}" for k, v in list(parameters.items())[:4]]
    return ", ".join(shown)
