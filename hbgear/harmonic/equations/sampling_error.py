"""Error of sampled forces: what more samples and harmonics would change of a motion.

    delta X = -J_fine^-1 R_fine(X),   a Newton step of the balance with twice the harmonics and more samples

N samples a period put harmonics k + N, k + 2N, ... of a force into harmonic k. Where a law is steep, such as the
friction tanh(v / v0), that is not small, and harmonics left out act back on those that are kept: neither is part of the
estimate from neglected harmonics alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm, solve_linear

_EACH = 4  # rows, of which one is looked at


_NOTICED = 1e-7  # residual with more samples, relative, above which the error is computed


_MOST = 1200  # unknowns with which it is


def newton_step(problem: Any, X: Array, parameters: Mapping[str, float]) -> Array:
    """Newton step (n,) of a problem at a motion; nan where its Jacobian is singular."""
    R, J = problem.evaluate(X, **parameters)
    try:
        return solve_linear(J, -R)
    except np.linalg.LinAlgError:
        return np.full(len(X), np.nan)


def add_sampling_error(
    problem: Any, X: Array, values: Array, seen: list[dict[str, Any]], parameters: Mapping[str, float]
) -> None:
    """Add the error of sampling to ``"error"`` of motions X (P, n) at Omega values (P,).

    Of neighbouring rows one in four is looked at, and the others have the larger error of those on both sides.
    """
    P = len(X)
    places = np.unique(np.append(np.arange(0, P, _EACH), P - 1))
    found = np.array([_error(problem, X[i], {**parameters, "Omega": float(values[i])}) for i in places])
    after = np.searchsorted(places, np.arange(P))
    errors = np.maximum(found[after], found[np.maximum(after - (places[after] != np.arange(P)), 0)])
    for one, error in zip(seen, errors.tolist(), strict=True):
        one["error"] = float(np.hypot(one["error"], error))


def _error(problem: Any, X: Array, here: Mapping[str, float]) -> float:
    """Root mean square of what more samples and harmonics change of a motion; 0 where samples suffice."""
    dense = problem.denser(4)
    R, _, _, size = dense.linearise(X, "", **here)
    if norm(R) <= _NOTICED * size:
        return 0.0
    more = problem.denser(4, 2) if 2 * problem.size <= _MOST else dense
    step = newton_step(more, more.resized(X), here)
    rms = np.sqrt(np.sum(np.where(np.arange(len(step)) % (len(step) // problem.m) == 0, 1.0, 0.5) * step**2))
    return float(rms)
