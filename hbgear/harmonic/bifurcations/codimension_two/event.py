"""Points of codimension two as zeros of smooth functions along a curve of special points."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, NewBranch, Segment
from hbgear.continuation.events.event import BuiltInEvent, LocatedEvent, locate_root
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.solvers.newton import SOLVER_ERRORS

Test = Callable[[Any, Array, dict[str, float]], float]
"""Function of the equations of a special point, the motion and all parameters."""


class CodimensionTwoEvent(BuiltInEvent):
    """Zero of a smooth function along a curve of special points.

    Attributes
    ----------
    function : callable
        The function.
    other : type, optional
        Equations of another curve of special points that passes the point.
    """

    function: Test
    other: type[MinimallyAugmentedProblem] | None = None

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        """Return the function at points, (P, 1); it is stored with them."""
        for point in points:
            if self.kind not in point.observed:
                point.observed[self.kind] = self._value(equations, point)
        return np.array([[point.observed[self.kind]] for point in points])

    def find(self, segment: Segment) -> list[LocatedEvent]:
        def test(point: CurvePoint) -> float:
            return self._value(segment.equations, point)

        return [locate_root(segment, self, test)] if test(segment.a) * test(segment.b) < 0 else []

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> NewBranch | None:
        """Return the other curve that passes the point, in the direction of ``side``; None without one."""
        return None if self.other is None else other_curve(branch, point, side, self.other)

    def _value(self, equations: CurveEquations, point: CurvePoint) -> float:
        """Return the function at a point; nan where it is undefined."""
        try:
            return type(self).function(equations.problem, *equations.solution_at(point.u))
        except SOLVER_ERRORS:
            return math.nan


def other_curve(
    branch: Branch, point: SpecialPoint, side: int, equations: Callable[[Any, str], MinimallyAugmentedProblem]
) -> NewBranch:
    """Return another curve of special points that passes a point of codimension two, in the direction of ``side``.

    ``equations`` makes the equations of this curve from the problem and the parameter of the motions.
    """
    passed: Any = as_problem(branch.problem)
    balance = passed.problem.at_resolution_of(point)  # at fewer harmonics the curve may end before the point
    curve = equations(balance, passed.parameter)
    X = curve.join(balance.from_point(point), point.parameters)
    direction = np.append(np.zeros(len(X)), float(side))
    return curve, BranchStart(X, dict(point.parameters), direction, bifurcating=False)
