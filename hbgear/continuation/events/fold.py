"""Events: folds and cusps, where the parameter direction of a curve changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.event import Event, LocatedEvent, lengths, locate_by_newton, locate_root, unknowns
from hbgear.continuation.events.near_tangency import SHALLOW
from hbgear.continuation.numerics.linear import norms
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.newton import NoConvergence


class FoldEvent(Event):
    """The curve turns back in the parameter: a fold."""

    kind, meaning, marker = "LP", "fold: the curve turns back", "o"

    def __init__(self) -> None:
        pass

    def values(
        self, rows: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        return np.zeros((len(rows), 0))

    def sign_changes(self, rows: Sequence[CurvePoint], values: Array) -> np.ndarray:
        heading = np.array([row.heading for row in rows])
        turned: np.ndarray = heading[1:] * heading[:-1] < 0
        return turned

    def close(self, rows: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Where dp/ds of the cubic through both ends of a piece, with their tangents, comes close to zero within it.

        dp/ds = a + b s + c s^2,   least at s = -b / 2c
        """
        p, length, tangents = unknowns(rows)[:, -1], lengths(rows, scale), np.array([row.tangent for row in rows])
        slope = tangents[:, -1] / norms(tangents / scale)
        begin, end, rise = slope[:-1] * length, slope[1:] * length, 6 * (p[1:] - p[:-1])
        b, c = rise - 4 * begin - 2 * end, 3 * (begin + end) - rise
        bent = np.flatnonzero((begin * end > 0) & (begin * c > 0) & (begin * b < 0))
        begin, end, b, c = begin[bent], end[bent], b[bent], c[bent]
        s = -0.5 * b / c
        share = (begin + 0.5 * b * s) / np.where(np.abs(begin) < np.abs(end), begin, end)
        shallow = (s < 1) & (share < SHALLOW)
        return list(zip(bent[shallow].tolist(), s[shallow].tolist(), strict=True))

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Newton on {R, g} from where the tangent's component vanishes; bracketed where forces are sampled."""
        a, b = segment.a, segment.b
        if a.heading * b.heading >= 0:
            return []
        if a.tangent[-1] * b.tangent[-1] >= 0:  # the curve turned on a stretch on which the parameter stood still
            return [LocatedEvent(self, 0.0, a, True)]
        if segment.problem.smooth:
            try:
                return [
                    locate_by_newton(
                        segment, self, FoldProblem(segment.problem, segment.name), fold_on_segment(segment)
                    )
                ]
            except (NoConvergence, np.linalg.LinAlgError):
                pass
        first = math.nan if segment.problem.is_nonsmooth else fold_on_segment(segment)  # at corners it turns anywhere
        return [locate_root(segment, self, lambda row: float(row.tangent[-1]), fine=1e-9, first=first)]

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return FoldProblem(problem, parameter)


class CuspEvent(FoldEvent):
    """A curve of folds turns back in its parameter."""

    kind, meaning, marker = "CP", "cusp: two folds meet", "*"

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return None


def fold_on_segment(segment: Segment) -> float:
    """Where on the arc the parameter turns, by the Hermite polynomial through its ends."""
    rise = float(segment.b.u[-1] - segment.a.u[-1])
    begin, end = (float(slope[-1]) for slope in segment.slopes)
    # begin and end differ in sign: so does the polynomial, and has one root between
    half, bend = 3 * rise - 2 * begin - end, 3 * (begin + end) - 6 * rise
    return begin / (math.copysign(math.sqrt(max(half * half - bend * begin, 0.0)), begin) - half)


def far_side_of_fold(segment: Segment, value: float) -> Array:
    """u where the parameter comes back to a value, on a piece on which it turns.

    Raises
    ------
    NoConvergence, numpy.linalg.LinAlgError
        If it does not, or the piece cannot be followed to there.
    """
    behind = segment.part(segment.at(fold_on_segment(segment)), segment.b)
    found = locate_root(behind, FoldEvent(), lambda row: row.value - value, fine=1e-9)
    if not found.located:
        raise NoConvergence("the curve does not come back to this value", found.row.X, segment.parameters, [])
    return found.row.u
