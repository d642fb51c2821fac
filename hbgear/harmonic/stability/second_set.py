"""A second, less accurate set of multipliers, from whose difference their error is estimated; see `verification`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.curve.refinement import shortest_step
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.harmonic.equations.motion import regimes, with_driven_harmonics, with_excited_harmonics
from hbgear.harmonic.multipliers.floquet import floquet_multipliers


def second_set(problem: Any, motions: CurveSolutions) -> ComplexArray:
    """Return a second set of multipliers (k, r) of motions.

    They lack the driven harmonics above H, and their motions have one more Newton step, in which these harmonics act
    back on the others.
    """
    X, name, values, parameters = motions
    if name == "Omega":
        return _multipliers(problem, X, values, parameters)
    cases = [{**parameters, name: value} for value in values.tolist()]
    sets = [_multipliers(problem, x, np.array([p["Omega"]]), p) for x, p in zip(X[:, None], cases, strict=True)]
    return np.concatenate(sets)


def _multipliers(problem: Any, X: Array, Omega: Array, parameters: Mapping[str, float]) -> ComplexArray:
    """Return `second_set` of motions X (k, n) at Omega (k,), which share all other parameters."""
    compiled = problem.compiled(parameters)
    if problem.selection is None and problem.refined_problem is not None:
        X, Omega = corrected_motions(problem, X, Omega, parameters)
    return floquet_multipliers(compiled, with_excited_harmonics(compiled, X, Omega), Omega)


def corrected_motions(problem: Any, X: Array, Omega: Array, parameters: Mapping[str, float]) -> tuple[Array, Array]:
    """Return motions X (k, n) and Omega (k,) after a Newton step with the harmonics up to 2H that they drive.

    The step is the shortest one of [dR/dX, dR/dOmega] delta = -R, with the residual R of the kept harmonics at the
    motion with driven harmonics: the nearest motion, which next to a fold has another Omega. The change of Omega over
    Omega weighs as much as that of the motion over its size. A step past a first contact or slip, where multipliers
    jump, is left out. The motions share all other parameters.
    """
    row_length = 2 * problem.H + 1
    compiled, finer = problem.compiled(parameters), problem.refined_problem.compiled(parameters)
    driven = with_driven_harmonics(compiled, X, Omega)
    corrected, frequencies = X.copy(), Omega.copy()
    for i, (x, w) in enumerate(zip(X, Omega.tolist(), strict=True)):
        R = finer.linearise(driven[i], w)[0].reshape(problem.m, -1)[:, :row_length].ravel()
        scale = np.append(np.full(len(x), problem.solution_norm(x) or 1.0), w)
        step = shortest_step(problem.linearise(x, "Omega", **{**parameters, "Omega": w}), R, scale)
        corrected[i], frequencies[i] = x + step[:-1], w + step[-1]
    same = np.all(regimes(compiled, corrected) == regimes(compiled, X), axis=1)
    return np.where(same[:, None], corrected, X), np.where(same, frequencies, Omega)
