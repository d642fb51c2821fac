"""A second, less accurate set of multipliers, from whose difference their error is estimated; see `verification`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.curve.refinement import shortest_step
from hbgear.continuation.problem.base import linearise
from hbgear.harmonic.equations.motion import regime as regime_of
from hbgear.harmonic.equations.motion import with_driven_harmonics, with_excited_harmonics
from hbgear.harmonic.multipliers.floquet import floquet_multipliers


def second_set(problem: Any, X: Array, name: str, values: Array, parameters: Mapping[str, float]) -> ComplexArray:
    """Return a second set of multipliers (k, r) of motions X (k, n) at values (k,) of a parameter.

    They lack the driven harmonics above H, and their motions have one more Newton step, in which these harmonics act
    back on the others.
    """
    point_parameters = [{**parameters, name: value} for value in values.tolist()]
    Omega = np.array([p["Omega"] for p in point_parameters])
    if problem.selection is None and problem.refined_problem is not None:
        X, Omega = corrected_motions(problem, X, point_parameters)
    if name == "Omega":
        compiled = problem.compiled(parameters)
        return floquet_multipliers(compiled, with_excited_harmonics(compiled, X, Omega), Omega)
    cases = zip([problem.compiled(p) for p in point_parameters], X[:, None], Omega[:, None], strict=True)
    return np.array(
        [floquet_multipliers(evaluator, with_excited_harmonics(evaluator, x, w), w)[0] for evaluator, x, w in cases]
    )


def corrected_motions(problem: Any, X: Array, parameters: Sequence[Mapping[str, float]]) -> tuple[Array, Array]:
    """Return motions X (k, n) and Omega (k,) after a Newton step with the harmonics up to 2H that they drive.

    The step is the shortest one of [dR/dX, dR/dOmega] delta = -R, with the residual R of the kept harmonics at the
    motion with driven harmonics: the nearest motion, which next to a fold has another Omega. The change of Omega over
    Omega weighs as much as that of the motion over its size. A step past a first contact or slip, where multipliers
    jump, is left out.
    """
    motions, Omega = X.copy(), np.array([p["Omega"] for p in parameters])
    row_length = 2 * problem.H + 1
    for i, (x, p) in enumerate(zip(X, parameters, strict=True)):
        w, compiled, finer = p["Omega"], problem.compiled(p), problem.refined_problem.compiled(p)
        driven = with_driven_harmonics(compiled, x[None], np.array([w]))[0]
        R = finer.linearise(driven, w)[0].reshape(problem.m, -1)[:, :row_length].ravel()
        scale = np.append(np.full(len(x), problem.solution_norm(x) or 1.0), w)
        step = shortest_step(linearise(problem, x, "Omega", p), R, scale)
        if np.array_equal(regime_of(compiled, x + step[:-1]), regime_of(compiled, x)):
            motions[i], Omega[i] = x + step[:-1], w + step[-1]
    return motions, Omega
