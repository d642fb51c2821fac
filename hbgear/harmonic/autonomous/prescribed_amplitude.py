"""First point of a branch that leaves another one: a motion of given amplitude, with the parameter as an unknown.

    R(X, p) = 0,   g = shape @ X - amplitude = 0

R alone is singular where the branch leaves. With the amplitude of the disturbance that leaves given, there is one
solution near its linear prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import AugmentedResidual, Borders, MinimallyAugmentedProblem


class PrescribedAmplitude(MinimallyAugmentedProblem):
    """Motions of a given amplitude near the point where their branch begins: the parameter is the last unknown.

    shape @ X = amplitude
    """

    problem: Any  # a LimitCycleProblem or a TorusProblem
    shape: Array
    amplitude: float

    def __init__(self, problem: Any, parameter: str, shape: Array, amplitude: float) -> None:
        super().__init__(problem, parameter)
        self._fixed(shape=shape, amplitude=amplitude)

    def base_at(self, X: Array, parameters: dict[str, float]) -> Borders:
        return Borders(self.problem.linearise(X, "", **parameters).size / self.amplitude)

    def extra(self, X: Array, parameters: dict[str, float], names: Sequence[str], base: Borders) -> AugmentedResidual:
        evaluation = self.problem.linearise(X, self.parameter, **parameters)
        g = float(self.shape @ X[:-1] - self.amplitude)
        return AugmentedResidual(evaluation, g, np.append(self.shape, 0.0), 0.0, ())
