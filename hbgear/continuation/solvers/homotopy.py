"""Homotopies: a solution from a poor start, along a path that joins the two.

    R(X) = (1 - s) R(X0),   s = 0..1         of Newton's method, from any start

and any other path of problems whose solution at s = 0 is known and which at s = 1 are the problem to be solved.

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import bordered, solve_linear
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem, linearise
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.solvers.corrector import correct
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, Solution, describe, solve


class _Homotopy(ContinuationProblem):
    """R(X) - (1 - s) R(X0) = 0: solved by X0 at s = 0, and by a solution of the problem at s = 1."""

    def __init__(self, problem: ContinuationProblem, X0: Array, parameters: Mapping[str, float]) -> None:
        self.problem, self.held = problem, parameters
        self.R0 = linearise(problem, X0, "", parameters).R

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        now = linearise(self.problem, X, "", self.held)
        return Evaluation(now.R - (1 - parameters["s"]) * self.R0, now.dR_dX, self.R0, now.size)


def newton_homotopy(
    problem: Any,
    X: Array,
    parameters: Mapping[str, float],
    settings: NewtonSettings = NewtonSettings(),
    steps: int = 300,
) -> Solution:
    """Solution at fixed parameters from a poor start, along the path that joins the two (Newton homotopy).

    The path R(X) = (1 - s) R(X0) is followed from s = 0 to 1 by arclength, through its folds.

    Raises
    ------
    NoConvergence
        If the path does not reach s = 1 within the given number of steps.
    """
    return solve_along(_Homotopy(as_problem(problem), X, parameters), problem, X, parameters, settings, steps)


def solve_along(
    path: ContinuationProblem,
    problem: Any,
    X: Array,
    parameters: Mapping[str, float],
    settings: NewtonSettings = NewtonSettings(),
    steps: int = 300,
) -> Solution:
    """Solution at fixed parameters, at the end s = 1 of a path that is followed by arclength, through its folds.

    Parameters
    ----------
    path : equations with the parameter s in [0, 1], which at s = 1 have the solutions of the problem.
    X : (n,) solution of the path at s = 0.
    steps : most steps along it.

    Raises
    ------
    NoConvergence
        If the path does not reach s = 1 within the given number of steps.
    """
    size = float(np.linalg.norm(X))
    u, h = np.append(X, 0.0), 0.05
    normal = np.append(np.zeros(len(X)), 1.0)
    for _ in range(steps):
        size = max(size, float(np.linalg.norm(u[:-1])))
        try:
            now = path.linearise(u[:-1], "s", s=float(u[-1]))
            t = solve_linear(bordered(now.dR_dX, now.dR_dp, normal), np.append(np.zeros(len(X)), 1.0))
            size = size or float(np.linalg.norm(t[:-1]))  # from zero: the size it heads for
            scale = np.append(np.full(len(X), size or np.inf), 1.0)
            t = t / np.linalg.norm(t / scale)
            across = t / scale**2 / np.linalg.norm(t / scale**2)
            found = correct(path, u + h * t, across, "s", {"s": 0.0}, NewtonSettings(1e-6, 1e-2, 6)).solution
        except (NoConvergence, np.linalg.LinAlgError):
            h *= 0.5
            if h < _SHORTEST:
                break
            continue
        if found.value >= 1.0:
            share = (1.0 - u[-1]) / (found.value - u[-1])
            return solve(problem, u[:-1] + share * (found.X - u[:-1]), parameters, settings=settings)
        u, normal, h = np.append(found.X, found.value), across, min(0.3, h * (1.6 if found.iterations <= 3 else 1.0))
    raise NoConvergence(f"no path leads from the start to a solution at {describe(parameters)}", X, parameters, [])


_SHORTEST = 1e-8  # step along a path, relative to its size
