"""One piece of a solution curve: scaled unknowns, tangents, and points between two rows.

A row is u = (X, lambda). Lengths and angles are measured in scaled unknowns u / scale, so that a step, a turning angle
and a distance mean the same whatever the units of X and lambda.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.corrector import CorrectedPoint, correct, corrected
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, Solution


@dataclass(slots=True, eq=False)  # not frozen, for that makes it three times as dear to make one
class CurvePoint:
    """A converged point of a curve with what the curve does there; it is not changed.

    u (n + 1,) unknowns and parameter; tangent (n + 1,), unit in the scaled unknowns but given unscaled; orientation:
    sign of the determinant of [J R_lambda; tangent], which changes at branch points and not at folds. heading: whether
    lambda rises (+1) or falls (-1) along the curve, or last did before a stretch on which it stands still. residual and
    iterations of the corrector; step: distance to the prediction it came from; observed: what the problem says of it.
    """

    u: Array
    tangent: Array
    orientation: int
    residual: float
    iterations: int
    step: float = 0.0
    heading: int = 0
    observed: dict[str, Any] = field(default_factory=dict)

    @property
    def X(self) -> Array:
        """Unknowns without the parameter."""
        return self.u[:-1]

    @property
    def value(self) -> float:
        """Value of the traced parameter."""
        return float(self.u[-1])

    @property
    def determinant(self) -> int:
        """Sign of det(dR/dX), 0 where it vanishes up to rounding.

        By Cramer's rule it is that of det [J R_lambda; tangent] times the component of the tangent in lambda.
        """
        moves = float(self.tangent[-1])
        if abs(moves) <= _SINGULAR and abs(moves) <= _SINGULAR * norm(self.tangent):
            return 0
        return self.orientation if moves > 0 else -self.orientation


_SINGULAR = 1e-12  # component of the tangent in lambda, over its norm, that is rounding


class Points(list[CurvePoint]):
    """Rows of a curve that do not change any more, of which columns are made once."""

    def __init__(self, rows: Iterable[CurvePoint]) -> None:
        super().__init__(rows)
        self._columns: dict[Any, Any] = {}

    def column(self, name: Any, make: Callable[[], Any]) -> Any:
        """What is kept by that name; made when it is first asked for."""
        if name not in self._columns:
            self._columns[name] = make()
        return self._columns[name]


@dataclass(frozen=True)
class BranchStart:
    """Where a branch begins, and which way: X, parameters, and the direction (n + 1,) in (X, lambda).

    away : whether another branch leaves at a special point, X, where its equations are singular.
    event : the event of that point, which happens again where the branch closes.
    """

    X: Array
    parameters: dict[str, float]
    direction: Array
    away: bool = True
    event: Any = None


def normal_of(direction: Array, scale: Array) -> Array:
    """Normal, in unscaled unknowns, of the plane across a direction in scaled ones."""
    scaled: Array = direction / scale**2
    return scaled


@dataclass(frozen=True)
class Segment:
    """The curve between two neighbouring rows a and b: cubic Hermite guess, corrected across the chord.

    ``at(s)`` returns the row at the fraction s of the chord, 0 at a and 1 at b. Two special points can lie at one
    place, and the segment between them has no length: then ``at`` returns a.
    """

    problem: ContinuationProblem
    name: str
    parameters: Mapping[str, float]
    a: CurvePoint
    b: CurvePoint
    scale: Array
    settings: NewtonSettings

    @property
    def length(self) -> float:
        """Length of the chord, scaled."""
        return norm((self.b.u - self.a.u) / self.scale)

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """du/ds at both ends: the tangents, as long as the chord in the scales of the piece."""
        length = self.length
        a, b = (length / norm(row.tangent / self.scale) * row.tangent for row in (self.a, self.b))
        return a, b

    def guess(self, s: float | Array) -> Array:
        """Hermite interpolation of u, or of several at places (k, 1)."""
        (begin, end), square, rest = self.slopes, s * s, 1.0 - s
        value = square * (3.0 - 2.0 * s)
        return (1.0 - value) * self.a.u + value * self.b.u + s * rest * (rest * begin - s * end)

    def at(self, s: float) -> CurvePoint:
        """Corrected row at the fraction s of the chord.

        Raises
        ------
        NoConvergence
            If the corrector fails there.
        """
        if self.length == 0.0:
            return self.a
        normal = normal_of(self.b.u - self.a.u, self.scale)
        u = self.guess(s)
        # put the guess on the plane at exactly the fraction s of the chord
        along = (1 - s) * self.a.u + s * self.b.u
        chord = self.b.u - self.a.u
        u = u + chord * (normal @ (along - u)) / (normal @ chord)
        normal = normal / np.linalg.norm(normal)
        return point_along(correct(self.problem, u, normal, self.name, self.parameters, self.settings), self.scale)

    def part(self, a: CurvePoint, b: CurvePoint) -> Segment:
        """The curve between two rows on it."""
        return replace(self, a=a, b=b)

    def place(self, u: Array) -> float:
        """The fraction of the chord at which u lies beside it; 0 if the segment has no length."""
        if self.length == 0.0:
            return 0.0
        chord = (self.b.u - self.a.u) / self.scale
        return float(chord @ ((u - self.a.u) / self.scale) / (chord @ chord))

    def passes(self, known: CurvePoint) -> bool:
        """Whether the curve from a to b contains a row already known: the points nearest to it are compared."""
        chord = (self.b.u - self.a.u) / self.scale
        offset = (known.u - self.a.u) / self.scale
        length, s = norm(chord), self.place(known.u)
        if not 0 <= s <= 1 or np.linalg.norm(offset - s * chord) > 0.1 * length:
            return False
        try:
            there = self.at(s)
        except (NoConvergence, np.linalg.LinAlgError):
            return False
        gap, along = (there.u - known.u) / self.scale, known.tangent / self.scale
        across = gap - along * (gap @ along) / (along @ along)
        return float(np.linalg.norm(across)) < 1e-3 * length


SAME_POINT_TOLERANCE = 1e-6
"""Relative distance of two points below which they are equal up to rounding."""


def are_equal(u: Array, v: Array) -> bool:
    """Return whether the unknowns of two points are equal up to rounding."""
    return len(u) == len(v) and norm(u - v) <= SAME_POINT_TOLERANCE * norm(u)


def cosine(a: CurvePoint, b: CurvePoint, scale: Array) -> float:
    """Cosine of the angle between the tangents of two rows, up to their lengths."""
    return float((a.tangent / scale) @ (b.tangent / scale))


_STILL = 1e-7  # component of the scaled tangent in lambda that is rounding


def point_from_solution(
    solution: Solution, normal: Array, scale: Array, step: float = 0.0, before: CurvePoint | None = None
) -> CurvePoint:
    """Point of a solution, its tangent pointing along normal; before is the row the curve comes from.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the curve has no direction there.
    """
    return point_along(corrected(solution, normal), scale, step, before)


def point_along(point: CorrectedPoint, scale: Array, step: float = 0.0, before: CurvePoint | None = None) -> CurvePoint:
    """Point of a solution whose direction is known."""
    solution, unit = point.solution, point.direction / norm(point.direction / scale)
    u = np.append(solution.X, solution.value)
    heading = parameter_direction(float(unit[-1] / scale[-1]), before.heading if before else 0)
    return CurvePoint(u, unit, point.orientation, solution.residual, solution.iterations, step, heading)


def resolve_at_resolution(
    row: CurvePoint, problem: ContinuationProblem, name: str, parameters: Mapping[str, float], scale: Array,
    settings: NewtonSettings, still: bool = False,
) -> CurvePoint:  # fmt: skip
    """A row with the unknowns of another problem, whose scales are given.

    still : at its value of the parameter, as the ends of a curve; else in the plane across the curve.

    Raises
    ------
    NoConvergence, numpy.linalg.LinAlgError
        If it is not found.
    """
    X, direction = problem.resized(row.X), np.append(problem.resized(row.tangent[:-1]), row.tangent[-1])
    normal = np.append(np.zeros(len(X)), row.heading or 1.0) if still else normal_of(direction, scale)
    normal = normal / np.linalg.norm(normal)
    point = correct(problem, np.append(X, row.value), normal, name, parameters, settings)
    return point_along(point, scale, row.step, row)


def rescaled(scale: Array, problem: ContinuationProblem, size: int) -> Array:
    """Scales (size + 1,) of a problem with another number of unknowns, its parameters among them as they were."""
    own = 1 + len(problem.unknown_parameters)
    return np.concatenate([np.full(size + 1 - own, scale[0]), scale[-own:]])


def parameter_direction(moves: float, before: int) -> int:
    """Whether lambda rises or falls, by the scaled component of the tangent in it; as before where it stands still."""
    return (1 if moves > 0 else -1) if abs(moves) > _STILL else before
