"""Equations of a curve: a problem in one parameter, the others fixed.

R(u) = 0,   u = (X, p)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from hbgear.common.arrays import Array
from hbgear.continuation.problem.evaluation import Evaluation


class CurveEquations(NamedTuple):
    """Equations of a curve.

    Attributes
    ----------
    problem : ContinuationProblem
        The problem.
    name : str
        Name of the continuation parameter p.
    fixed : dict of str to float
        Values of the other parameters.
    """

    problem: Any
    name: str
    fixed: Mapping[str, float]

    def parameters_at(self, value: float) -> dict[str, float]:
        """Return all parameters at a value of the continuation parameter."""
        return {**self.fixed, self.name: value}

    def linearise(self, u: Array) -> Evaluation:
        """Return the residual and its derivatives at u (n + 1,)."""
        return self.problem.linearise(u[:-1], self.name, **self.parameters_at(float(u[-1])))

    def solution_at(self, u: Array) -> tuple[Array, dict[str, float]]:
        """Return the solution at u (n + 1,) without its unknown parameters, and all parameters."""
        X, tracked = self.problem.split(u[:-1])
        return X, {**self.fixed, **tracked, self.name: float(u[-1])}


class CurveSolutions(NamedTuple):
    """Solutions of a problem at several values of a parameter.

    Attributes
    ----------
    X : ndarray, shape (k, n)
        Unknowns.
    name : str
        Name of the parameter.
    values : ndarray, shape (k,)
        Its values.
    fixed : dict of str to float
        Values of the other parameters.
    """

    X: Array
    name: str
    values: Array
    fixed: Mapping[str, float]

    def parameters_at(self, i: int) -> dict[str, float]:
        """Return all parameters of a solution."""
        return {**self.fixed, self.name: float(self.values[i])}

    def select(self, rows: Any) -> CurveSolutions:
        """Return some of the solutions."""
        return self._replace(X=self.X[rows], values=self.values[rows])
