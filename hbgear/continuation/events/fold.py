"""Events: folds and cusps, where the parameter direction of a curve changes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.columns import lengths, unknowns
from hbgear.continuation.events.event import BuiltInEvent, LocatedEvent, locate_by_newton, locate_root
from hbgear.continuation.events.near_tangency import NEAR_ZERO_RATIO
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NoConvergence


def equations_of_fold(
    problem: ContinuationProblem, parameter: str, X: Array, parameters: Mapping[str, float]
) -> MinimallyAugmentedProblem:
    """Return the equations of a fold at a solution, or of the corner at which the curve turns back, if there is one."""
    if problem.is_nonsmooth:
        corners = (event.corner(problem, parameter, X, parameters) for event in problem.events(parameter))
        corner: MinimallyAugmentedProblem | None = next((e for e in corners if e is not None), None)
        if corner is not None:
            return corner
    return FoldProblem(problem.original, parameter)


class FoldEvent(BuiltInEvent):
    """Fold: the parameter direction of the curve changes."""

    kind, meaning, marker = "LP", "fold: the curve turns back", "o"
    regular_at_corners = True  # solved with the equations of the corner

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        direction = np.array([point.parameter_direction for point in points])
        return direction[1:] * direction[:-1] < 0

    def near_zeros(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return the segments on which dp/ds of the cubic Hermite polynomial comes close to zero.

        dp/ds = a + b s + c s^2,   smallest at s = -b / 2c
        """
        p, length = unknowns(points)[:, -1], lengths(points, scale)
        tangents = np.array([point.tangent for point in points])
        slope = tangents[:, -1] / norms(tangents / scale)
        # dp/ds = begin + b s + c s^2: an extremum within (0, 1) towards zero from ends of equal sign
        begin, end, rise = slope[:-1] * length, slope[1:] * length, 6 * (p[1:] - p[:-1])
        b, c = rise - 4 * begin - 2 * end, 3 * (begin + end) - rise
        candidates = np.flatnonzero((begin * end > 0) & (begin * c > 0) & (begin * b < 0))
        begin, end, b, c = begin[candidates], end[candidates], b[candidates], c[candidates]
        s = -0.5 * b / c
        ratio = (begin + 0.5 * b * s) / np.where(np.abs(begin) < np.abs(end), begin, end)
        close = (s < 1) & (ratio < NEAR_ZERO_RATIO)
        return list(zip(candidates[close].tolist(), s[close].tolist(), strict=True))

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return the fold of a segment on which the parameter direction changes.

        Newton's method on {R, g} starts at the fold of the Hermite polynomial. If it fails, or dR/dX is not continuous,
        the root of the tangent component is bracketed; also if the segment has a branch point, where g is zero, too.
        """
        a, b = segment.a, segment.b
        if a.parameter_direction * b.parameter_direction >= 0:
            return []
        if a.tangent[-1] * b.tangent[-1] >= 0:  # the fold lies on a section of constant parameter
            return [LocatedEvent(self, 0.0, a, True)]
        if segment.problem.smooth and a.orientation == b.orientation:
            equations = FoldProblem(segment.problem, segment.name)
            with suppress(*SOLVER_ERRORS):
                return [locate_by_newton(segment, self, equations, fold_on_segment(segment))]
        # at a breakpoint a fold may lie anywhere
        first = math.nan if segment.problem.is_nonsmooth else fold_on_segment(segment)
        return [locate_root(segment, self, lambda point: float(point.tangent[-1]), fine=1e-9, first=first)]

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        curve_problem = as_problem(problem)
        return equations_of_fold(curve_problem, parameter, curve_problem.from_point(point), point.parameters)


class CuspEvent(FoldEvent):
    """Cusp: both parameters of a curve of folds turn back."""

    kind, meaning, marker = "CP", "cusp: two folds meet", "*"

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return the cusp, or the isola centre if the first parameter does not turn back."""
        return [
            replace(fold, event=IsolaCentreEvent(), finder=self) if _is_moving(segment, fold) else fold
            for fold in super().find(segment)
        ]

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return None


class IsolaCentreEvent(CuspEvent):
    """Turning point of a curve of folds in the second parameter alone: curves separate or join, or an isola begins."""

    kind, meaning, marker = "IC", "two folds meet: curves separate or join, or an isola begins", "8"


TURNING_KINDS = (CuspEvent.kind, IsolaCentreEvent.kind)
"""Kinds of the turning points of a curve of folds, at which two folds appear or vanish."""


def _is_moving(segment: Segment, turning: LocatedEvent) -> bool:
    """Return whether the first parameter changes along a curve of folds at a turning point in the second one."""
    if not turning.located or not segment.problem.unknown_parameters:
        return False
    direction = turning.point.tangent / segment.scale
    return abs(float(direction[-2])) > MOVING_PARAMETER * norm(direction)


MOVING_PARAMETER = 1e-3
"""Component of the scaled tangent in the first parameter above which it moves; at a cusp it is rounding, 1e-6."""


def fold_on_segment(segment: Segment) -> float:
    """Return the fraction of a segment at which the Hermite polynomial through its ends has a fold."""
    rise = float(segment.b.u[-1] - segment.a.u[-1])
    begin, end = (float(slope[-1]) for slope in segment.slopes)
    # begin and end have opposite signs, so the derivative has one root between them
    half, bend = 3 * rise - 2 * begin - end, 3 * (begin + end) - 6 * rise
    return begin / (math.copysign(math.sqrt(max(half * half - bend * begin, 0.0)), begin) - half)


def far_side_of_fold(segment: Segment, value: float) -> Array:
    """Return the unknowns u (n + 1,) at which the parameter returns to a value after a fold on a segment.

    NoConvergence or LinAlgError is raised if it does not return to this value, or the corrector fails.
    """
    behind = segment.part(segment.at(fold_on_segment(segment)), segment.b)
    event = locate_root(behind, FoldEvent(), lambda point: point.value - value, fine=1e-9)
    if not event.located:
        raise NoConvergence("the curve does not return to this parameter value", event.point.X, segment.parameters, [])
    return event.point.u
