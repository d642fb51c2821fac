"""What continuation asks of a problem, and how it asks.

A *problem* is anything with

    evaluate(X, **parameters) -> (R, dR_dX)          R (n,), dR_dX (n, n)

It may also offer, for speed and accuracy,

    linearise(X, name, **parameters) -> Evaluation   R, dR_dX, dR_d(name) and the size of the terms R is the sum of
    linearise_all(X, Omega, **parameters)            the same, name being Omega, for many X (k, n) and Omega (k,)

Without the first dR_d(name) is a central difference and the size is taken as 1 + |X|.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from hbgear.common.arrays import Array


class Problem(Protocol):
    """What continuation needs to know of a problem."""

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Array]:
        """R (n,) and dR/dX (n, n)."""
        ...


class Evaluation(NamedTuple):
    """R (n,), dR_dX (n, n), dR_dp (n,) and the size of the terms of R, against which |R| is judged."""

    R: Array
    dR_dX: Array
    dR_dp: Array
    size: float


class Evaluations(NamedTuple):
    """Evaluations of k points: R (k, n), dR_dX (k, n, n), dR_dp (k, n) and sizes (k,)."""

    R: Array
    dR_dX: Array
    dR_dp: Array
    size: Array


def linearise(problem: Any, X: Array, name: str, parameters: Mapping[str, float]) -> Evaluation:
    """R, dR/dX, dR/dname (zeros without a name) and the size of R's terms, from whatever the problem offers."""
    if hasattr(problem, "linearise"):
        return problem.linearise(X, name, **parameters)
    R, J = problem.evaluate(X, **parameters)
    if not name:
        return Evaluation(np.asarray(R), np.asarray(J), np.zeros(len(X)), 1.0 + float(np.linalg.norm(X)))
    value = parameters[name]
    h = 1e-6 * max(abs(value), 1e-2)
    plus = problem.evaluate(X, **{**parameters, name: value + h})[0]
    minus = problem.evaluate(X, **{**parameters, name: value - h})[0]
    return Evaluation(np.asarray(R), np.asarray(J), (plus - minus) / (2 * h), 1.0 + float(np.linalg.norm(X)))


def linearise_all(problem: Any, U: Array, name: str, parameters: Mapping[str, float]) -> Evaluations:
    """`linearise` at points U (k, n + 1) of unknowns and parameter."""
    if name == "Omega" and hasattr(problem, "linearise_all"):
        rest = {key: value for key, value in parameters.items() if key != name}
        return problem.linearise_all(U[:, :-1], U[:, -1], **rest)
    each = [linearise(problem, u[:-1], name, {**parameters, name: float(u[-1])}) for u in U]
    return Evaluations(*(np.array(x) for x in zip(*each, strict=True)))


def observe_all(
    problem: Any, U: Array, name: str, parameters: Mapping[str, float], stability: bool
) -> list[dict[str, Any]]:
    """What a problem says of its motions U (k, n + 1): at once where only Omega differs between them."""
    if name == "Omega" and hasattr(problem, "observe_all"):
        return problem.observe_all(U[:, :-1], U[:, -1], stability=stability, **parameters)
    return [problem.observe(u[:-1], stability=stability, **{**parameters, name: float(u[-1])}) for u in U]


def jacobians(problem: Any, U: Array, name: str, parameters: Mapping[str, float]) -> Array:
    """dR/dX (k, n, n) at points U (k, n + 1) of unknowns and parameter."""
    if name == "Omega" and hasattr(problem, "linearise_all"):
        return linearise_all(problem, U, name, parameters).dR_dX
    return np.array([problem.evaluate(u[:-1], **{**parameters, name: float(u[-1])})[1] for u in U])
