"""Newton homotopy: a solution from a poor start, along the path that joins the two.

    R(X) = (1 - s) R(X0),   s = 0..1

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
from hbgear.continuation.algebra import bordered, solve_linear
from hbgear.continuation.corrector import correct
from hbgear.continuation.newton import NoConvergence, Settings, Solution, describe, solve
from hbgear.continuation.problem import Evaluation, FullProblem, as_problem, linearise


class _Homotopy(FullProblem):
    """R(X) - (1 - s) R(X0) = 0: solved by X0 at s = 0, and by a solution of the problem at s = 1."""

    def __init__(self, problem: FullProblem, X0: Array, parameters: Mapping[str, float]) -> None:
        self.problem, self.held = problem, parameters
        self.R0 = linearise(problem, X0, "", parameters).R

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        now = linearise(self.problem, X, "", self.held)
        return Evaluation(now.R - (1 - parameters["s"]) * self.R0, now.dR_dX, self.R0, now.size)


def solve_from_afar(
    problem: Any,
    X: Array,
    parameters: Mapping[str, float],
    settings: Settings = Settings(),
    steps: int = 300,
) -> Solution:
    """Solution at fixed parameters from a poor start, along the path that joins the two (Newton homotopy).

    The path R(X) = (1 - s) R(X0) is followed from s = 0 to 1 by arclength, through its folds.

    Raises
    ------
    NoConvergence
        If the path does not reach s = 1 within the given number of steps.
    """
    path = _Homotopy(as_problem(problem), X, parameters)
    size = float(np.linalg.norm(X)) or 1.0
    scale = np.append(np.full(len(X), size), 1.0)
    u, h = np.append(X, 0.0), 0.05
    normal = np.append(np.zeros(len(X)), 1.0)
    for _ in range(steps):
        try:
            now = path.linearise(u[:-1], "s", s=float(u[-1]))
            t = solve_linear(bordered(now.dR_dX, now.dR_dp, normal), np.append(np.zeros(len(X)), 1.0))
            t = t / np.linalg.norm(t / scale)
            across = t / scale**2 / np.linalg.norm(t / scale**2)
            found = correct(path, u + h * t, across, "s", {"s": 0.0}, Settings(1e-6, 1e-2, 6)).solution
        except (NoConvergence, np.linalg.LinAlgError):
            h *= 0.5
            if h < 1e-6:
                break
            continue
        if found.value >= 1.0:
            share = (1.0 - u[-1]) / (found.value - u[-1])
            return solve(problem, u[:-1] + share * (found.X - u[:-1]), parameters, settings=settings)
        u, normal, h = np.append(found.X, found.value), across, min(0.3, h * (1.6 if found.iterations <= 3 else 1.0))
    raise NoConvergence(f"no path leads from the start to a solution at {describe(parameters)}", X, parameters, [])
