"""Event: branch points, where the bordered determinant changes sign without a fold."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy  # its parts are imported when they are first used

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.branch_point import BranchPointProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.augmented.special_point_problem import SpecialPointProblem
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, NewBranch, Segment, is_within_corner
from hbgear.continuation.events.event import BuiltInEvent, LocatedEvent, locate_root, singular
from hbgear.continuation.numerics.linear import as_dense, bordered, slogdet
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.solvers.newton import SEARCH_ERRORS


class BranchPointEvent(BuiltInEvent):
    """Branch point: two curves cross, and the determinant of [dR/dX dR/dp; t^T] changes sign."""

    kind, meaning, marker = "BP", "branch point: two curves cross", "P"

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        orientation = np.array([point.orientation for point in points])
        return orientation[1:] != orientation[:-1]

    def find(self, segment: Segment) -> list[LocatedEvent]:
        if segment.a.orientation == segment.b.orientation or _is_corner(segment):
            return []
        return [_refined_branch_point(segment, locate_root(segment, self, _determinant(segment)))]

    def deviation(self, multipliers: ComplexArray) -> float:
        """Return the distance of the nearest multiplier from +1."""
        return float(np.abs(multipliers - 1).min(initial=math.inf))

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return BranchPointProblem(problem, parameter)

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> NewBranch | None:
        """Return the start across the traced curve, within the null space of [dR/dX, dR/dp]."""
        traced, problem = as_traced(branch, point), as_problem(branch.problem)
        parameters = dict(traced.parameters)
        U = problem.join(traced.X, parameters)
        problem = problem.with_borders_at(U, parameters, renew=True)
        direction = side * _transverse_direction(problem, branch, point.index, U, parameters)
        return problem, BranchStart(U, parameters, direction, event=self)


def as_traced(branch: Branch, point: SpecialPoint) -> SpecialPoint:
    """Return a special point at the resolution of its branch; it may have been located with more unknowns."""
    if point.layout == branch.layout:
        return point
    return replace(point, X=branch.X[point.index], parameters=branch.parameters_at(point.index), layout=branch.layout)


def _transverse_direction(
    problem: ContinuationProblem, branch: Branch, i: int, U: Array, parameters: Mapping[str, float]
) -> Array:
    """Return the direction in the null space of [dR/dU, dR/dp] orthogonal to the curve at its point i, unknowns U."""
    evaluation = problem.linearise(U, branch.parameter, **parameters)
    curve = np.array([problem.join(X, branch.parameters_at(k)) for k, X in enumerate(branch.X)])
    size = float(problem.solution_norms(curve).max()) or 1.0  # the point itself may be zero up to rounding
    scale = np.append(np.full(len(U), size), np.ptp(branch.values) or 1.0)
    for k, name in enumerate(problem.unknown_parameters, 1):
        scale[-1 - k] = max(float(np.abs(curve[:, -k]).max()), problem.smallest_scale(name)) or 1.0
    null = scipy.linalg.svd(np.column_stack([as_dense(evaluation.dR_dX), evaluation.dR_dp]) * scale)[2][-2:]
    before, after = max(i - 1, 0), min(i + 1, len(branch) - 1)
    along = np.append(curve[after] - curve[before], branch.values[after] - branch.values[before]) / scale
    projection = null @ along
    projection = projection / np.linalg.norm(projection)
    return scale * (np.array([-projection[1], projection[0]]) @ null)


def _is_corner(segment: Segment) -> bool:
    """Return whether a segment is so short that it is a corner of its curve, where signs of determinants are rounding.

    Curves of special points have corners, and curves of problems with a discontinuous dR/dX.
    """
    if isinstance(segment.problem, SpecialPointProblem):
        return segment.length < SHORTEST_SEGMENT
    return is_within_corner(segment)


SHORTEST_SEGMENT = 1e-8
"""Length of a segment of a curve of special points, in scaled unknowns, below which no curves cross on it. At a grazing
contact a point lies within 1e-10 of a corner, and the derivatives of its equations are infinite."""


def _refined_branch_point(segment: Segment, rough: LocatedEvent) -> LocatedEvent:
    """Return a branch point refined by Newton's method on its equations, if the result solves the problem too."""
    u = rough.point.u
    try:
        U = BranchPointProblem(segment.problem, segment.name).located(u, segment.parameters).X
    except SEARCH_ERRORS:
        return rough
    point = singular(segment, U, rough.point)
    is_close = np.linalg.norm((U - u) / segment.scale) <= MAX_REFINEMENT_FRACTION * segment.length
    return (
        replace(rough, point=point)
        if rough.located and is_close and point.residual <= segment.settings.tolerance
        else rough
    )


MAX_REFINEMENT_FRACTION = 1e-3
"""Largest distance of a branch point from the root of the determinant, as a fraction of the segment."""


def _determinant(segment: Segment) -> Callable[[CurvePoint], float]:
    """Return the signed bordered determinant as a function of a point, relative to its size at the first point."""

    def logdet(point: CurvePoint) -> tuple[float, float]:
        parameters = segment.parameters_at(point.value)
        evaluation = segment.problem.linearise(point.X, segment.name, **parameters)
        return slogdet(bordered(evaluation.dR_dX, evaluation.dR_dp, point.tangent / segment.scale**2))

    reference = logdet(segment.a)[1]

    def value(point: CurvePoint) -> float:
        sign, log = logdet(point)
        return sign * float(np.exp(min(log - reference, 50.0)))

    return value
