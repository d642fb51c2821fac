"""Equations R = 0, value = level of any scalar condition."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.problem.finite_differences import STEP, parameter_derivatives
from hbgear.continuation.results.point import Point

_USUAL_SIZE = 1e-3
"""Size of an unknown that is zero."""


class ScalarConditionProblem(MinimallyAugmentedProblem):
    """Equations of points at which a function of the point is zero.

        R(X, p) = 0,   g = test(point) = 0           gradient of g by central differences

    Parameters
    ----------
    problem : ContinuationProblem or object with ``evaluate``
        The problem.
    parameter : str
        Parameter of the curve.
    test : callable
        Smooth function of a `Point`. It may use unknowns, parameters and problem.
    meaning : str, optional
        Meaning of the points in figures of their curve.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> limit = hb.Event("limit", lambda point: point.amplitude("H1") - 0.8)
    >>> curve = hb.trace(problem, "Omega", (0.5, 1.0), events=[limit])
    >>> level = limit.equations(problem, "Omega", curve["limit1"])
    >>> held = hb.trace(level, "zeta", (0.05, 0.06), start=curve["limit1"])
    >>> bool(abs(held.amplitude("H1") - 0.8).max() < 1e-9)
    True
    """

    test: Callable[[Point], float]
    meaning: str
    argument_names: ClassVar[tuple[str, ...]] = ("test", "meaning")

    @checked_arguments()
    def __init__(self, problem: AnyProblem, parameter: str, test: Callable[[Point], float], meaning: str = "") -> None:
        super().__init__(problem, parameter)
        self._fixed(test=test, meaning=meaning)

    def describe(self) -> dict[str, Any]:
        """Return the data for the header of a file, with the meaning of the points."""
        found = super().describe()
        return {**found, "curve": {**found["curve"], **({"meaning": self.meaning} if self.meaning else {})}}

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        return Borders(self.problem.linearise(X, "", **parameters).size)

    def value(self, X: Array, parameters: dict[str, float]) -> float:
        """Return the value of the function at unknowns X and all parameters; ValueError if it is not finite."""
        motion, unknown = self.problem.split(X)
        point = Point.without_data(motion, {**parameters, **unknown}, self.problem)
        value = float(self.test(point))
        if not math.isfinite(value):
            raise ValueError(f"the test function is {value} at {point}; it must be finite")
        return value

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        """Return the equations; see `MinimallyAugmentedProblem.extra`."""
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        gradient = np.empty(len(X))
        for i, h in enumerate(STEP * self._sizes(X)):
            e = np.zeros(len(X))
            e[i] = h
            gradient[i] = (self.value(X + e, parameters) - self.value(X - e, parameters)) / (2 * h)
        derivatives = tuple(
            (self.problem.linearise(X, name, **parameters).dR_dp, self._parameter_derivative(X, parameters, name))
            for name in names
        )
        g_p = self._parameter_derivative(X, parameters, self.parameter)
        return AugmentedResidual(evaluation, self.value(X, parameters), gradient, g_p, derivatives)

    def _sizes(self, X: Array) -> Array:
        """Return the sizes of the unknowns: of the motion, and of each parameter, which has another unit."""
        n = len(self.problem.split(X)[0])
        sizes = np.append(np.full(n, norm(X[:n])), np.abs(X[n:]))
        return np.where(sizes > 0.0, sizes, _USUAL_SIZE)

    def _parameter_derivative(self, X: Array, parameters: dict[str, float], name: str) -> float:
        """Return the derivative of the function in a parameter."""
        (derivatives,) = parameter_derivatives(self.problem, name, parameters, lambda values: (self.value(X, values),))
        return float(derivatives)
