"""Points and segments of a curve: scaled unknowns, tangents, and points between two neighbouring points.

    u = (X, p),   |du|^2 = sum_i (du_i / scale_i)^2

Lengths and angles are measured in the scaled unknowns u / scale, so that steps, angles and distances do not depend on
the units of X and of the parameter p.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.solvers.corrector import CorrectedPoint, correct, corrected
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NewtonSettings, Solution, solve


@dataclass(slots=True, eq=False)  # not frozen: frozen instances take three times as long to create
class CurvePoint:
    """Converged point of a curve, with its tangent. Only the monitored quantities ``observed`` are filled later.

    Attributes
    ----------
    u : ndarray, shape (n + 1,)
        Unknowns X and the parameter.
    tangent : ndarray, shape (n + 1,)
        Tangent du/ds in unscaled unknowns, of unit length in scaled unknowns.
    orientation : int
        Sign of det [dR/dX dR/dp; tangent^T]. It changes at branch points and not at folds.
    residual : float
        Relative residual.
    iterations : int
        Number of iterations of the corrector.
    step : float
        Size of the step to this point.
    parameter_direction : int
        +1 if the parameter increases along the curve, -1 if it decreases. On a section of constant
        parameter it keeps its last value.
    """

    u: Array
    tangent: Array
    orientation: int
    residual: float
    iterations: int
    step: float = 0.0
    parameter_direction: int = 0
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

        By Cramer's rule it is the sign of det [dR/dX dR/dp; tangent^T] times the component of the tangent in p.
        """
        change, rounding = float(self.tangent[-1]), TANGENT_ROUNDING
        if abs(change) <= rounding and abs(change) <= rounding * norm(self.tangent):
            return 0
        return self.orientation if change > 0 else -self.orientation


TANGENT_ROUNDING = 1e-12
"""Component of the tangent in the parameter, relative to its norm, below which it is rounding error."""


@dataclass(frozen=True)
class BranchStart:
    """Start of a branch: a solution and the direction of the branch.

    Attributes
    ----------
    X : ndarray, shape (n,)
        Unknowns.
    parameters : dict of str to float
        All parameters.
    direction : ndarray, shape (n + 1,)
        Direction in (X, p); zero for a problem that follows curves itself, see `ContinuationProblem.own_trace`.
    bifurcating : bool
        Whether the branch leaves another one at a special point, where the equations are singular. The default is True.
    event : Event or None
        Event of the special point, which happens again where the branch closes.
    """

    X: Array
    parameters: dict[str, float]
    direction: Array
    bifurcating: bool = True
    event: Any = None


NewBranch: TypeAlias = tuple[ContinuationProblem, BranchStart]
"""Problem of a branch that leaves a special point, and its start."""


def normal_of(direction: Array, scale: Array) -> Array:
    """Return the normal (n + 1,) of the plane that is orthogonal to a direction in scaled unknowns."""
    return direction / scale**2


def unit_normal_of(direction: Array, scale: Array) -> Array:
    """Return `normal_of` with unit length, as the corrector needs it."""
    normal = normal_of(direction, scale)
    return normal / np.linalg.norm(normal)


@dataclass(frozen=True)
class Segment:
    """Curve between two neighbouring points a and b, on which one parameter changes and the others are constant.

    Points between them are guessed by cubic Hermite interpolation and corrected orthogonally to b - a. A segment
    between two coinciding special points has zero length.
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
        """Scaled distance of the ends."""
        return norm((self.b.u - self.a.u) / self.scale)

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Derivatives du/ds at both ends in the fraction s: tangents whose scaled length is `length`."""
        length = self.length
        a, b = (length / norm(end.tangent / self.scale) * end.tangent for end in (self.a, self.b))
        return a, b

    @property
    def equations(self) -> CurveEquations:
        """Equations of the curve."""
        return CurveEquations(self.problem, self.name, self.parameters)

    def parameters_at(self, value: float) -> dict[str, float]:
        """Return all parameters, with a value of the continuation parameter."""
        return self.equations.parameters_at(value)

    def guess(self, s: float | Array) -> Array:
        """Return the Hermite interpolation of u (n + 1,) at a fraction s, or (k, n + 1) at fractions (k, 1)."""
        (begin, end), square, r = self.slopes, s * s, 1.0 - s  # s = 0 and 1 give a.u and b.u exactly
        value = square * (3.0 - 2.0 * s)
        return (1.0 - value) * self.a.u + value * self.b.u + s * r * (r * begin - s * end)

    def at(self, s: float) -> CurvePoint:
        """Return the corrected point at a fraction, 0 at a and 1 at b; a for a segment of zero length.

        NoConvergence is raised if the corrector fails there.
        """
        if self.length == 0.0:
            return self.a
        normal = normal_of(self.b.u - self.a.u, self.scale)
        u = self.guess(s)
        # move the guess onto the plane at exactly the fraction s
        along = (1 - s) * self.a.u + s * self.b.u
        chord = self.b.u - self.a.u
        u = u + chord * (normal @ (along - u)) / (normal @ chord)
        normal = normal / np.linalg.norm(normal)
        return point_along(correct(self.equations, u, normal, self.settings), self.scale)

    def part(self, a: CurvePoint, b: CurvePoint) -> Segment:
        """Return the segment between two other points a and b of the same curve."""
        return replace(self, a=a, b=b)

    def fraction_of(self, u: Array) -> float:
        """Return the fraction at the orthogonal projection of a point; 0 on a segment of zero length."""
        if self.length == 0.0:
            return 0.0
        chord = (self.b.u - self.a.u) / self.scale
        return float(chord @ ((u - self.a.u) / self.scale) / (chord @ chord))

    def passes(self, point: CurvePoint) -> bool:
        """Return whether the nearest point of the segment lies on the curve of a known point."""
        chord = (self.b.u - self.a.u) / self.scale
        offset = (point.u - self.a.u) / self.scale
        length, s = norm(chord), self.fraction_of(point.u)
        if not 0 <= s <= 1 or np.linalg.norm(offset - s * chord) > MAX_CHORD_DISTANCE * length:
            return False
        try:
            nearest = self.at(s)
        except SOLVER_ERRORS:
            return False
        gap, along = (nearest.u - point.u) / self.scale, point.tangent / self.scale
        normal = gap - along * (gap @ along) / (along @ along)
        return float(np.linalg.norm(normal)) < SAME_CURVE_DISTANCE * length


MAX_CHORD_DISTANCE = 0.1
"""Distance of a known point from the straight line a to b, relative to the length, above which it is not compared."""

SAME_CURVE_DISTANCE = 1e-3
"""Distance of two points across the curve, relative to the length of the segment, below which they coincide."""

SAME_POINT_TOLERANCE = 1e-6
"""Relative distance of two points below which they are equal up to rounding."""


def are_equal(u: Array, v: Array) -> bool:
    """Return whether the unknowns of two points are equal up to rounding."""
    return len(u) == len(v) and norm(u - v) <= SAME_POINT_TOLERANCE * norm(u)


CORNER_COSINE, CORNER_LENGTH = 0.98, 1e-3
"""Cosine of the angle between the tangents of two points, and their scaled distance, below which the curve of a problem
with a discontinuous dR/dX has a corner between them."""


def has_corner(segment: Segment) -> bool:
    """Return whether a segment has a corner, at which the tangent and the multipliers jump."""
    if not segment.problem.is_nonsmooth or segment.length > CORNER_LENGTH:
        return False
    return is_within_corner(segment) or cosine(segment.a, segment.b, segment.scale) < CORNER_COSINE


WITHIN_CORNER_LENGTH = 1e-6
"""Length of a segment in scaled unknowns below which it is a part of a corner: the points next to one are a few
smallest steps apart. Where a contact begins at all phases at once, each sample of it has its own derivatives there."""


def is_within_corner(segment: Segment) -> bool:
    """Return whether a segment of a problem with a discontinuous dR/dX is so short that it is a part of a corner."""
    return bool(segment.problem.is_nonsmooth) and segment.length < WITHIN_CORNER_LENGTH


def cosine(a: CurvePoint, b: CurvePoint, scale: Array) -> float:
    """Return the cosine of the angle between the tangents of two points, which have unit length in scaled unknowns."""
    return float((a.tangent / scale) @ (b.tangent / scale))


CONSTANT_PARAMETER_SLOPE = 1e-7
"""Component of the scaled tangent in the parameter below which it is rounding error."""


def point_from_solution(
    solution: Solution, normal: Array, scale: Array, step: float = 0.0, last: CurvePoint | None = None
) -> CurvePoint:
    """Return the point of a solution, with the tangent that has a positive product with ``normal``.

    ``step`` is the size of the step to the point, ``last`` the previous one. LinAlgError is raised if the curve has no
    direction there.
    """
    return point_along(corrected(solution, normal), scale, step, last)


def point_along(point: CorrectedPoint, scale: Array, step: float = 0.0, last: CurvePoint | None = None) -> CurvePoint:
    """Return the point of a solution whose direction is known; see `point_from_solution`."""
    solution, unit = point.solution, point.direction / norm(point.direction / scale)
    u = np.append(solution.X, solution.value)
    direction = parameter_direction(float(unit[-1] / scale[-1]), last.parameter_direction if last else 0)
    return CurvePoint(u, unit, point.orientation, solution.residual, solution.iterations, step, direction)


def resolve_at_resolution(
    point: CurvePoint, equations: CurveEquations, scale: Array, settings: NewtonSettings, fixed_value: bool = False
) -> CurvePoint:
    """Return a point solved at the resolution of another problem, with the scales (m + 1,) of its unknowns.

    With ``fixed_value`` the parameter keeps its value, as at the ends of a curve, which are solved as initial solutions
    are. By default the corrector moves in the plane orthogonal to the curve. NoConvergence or LinAlgError is raised if
    it fails.
    """
    problem = equations.problem
    X, direction = problem.resized(point.X), np.append(problem.resized(point.tangent[:-1]), point.tangent[-1])
    if fixed_value:
        solution = solve(problem, X, equations.parameters_at(point.value), equations.name, settings)
        return point_from_solution(solution, normal_of(direction, scale), scale, point.step, point)
    normal = unit_normal_of(direction, scale)
    solved = correct(equations, np.append(X, point.value), normal, settings)
    return point_along(solved, scale, point.step, point)


def rescaled(scale: Array, problem: ContinuationProblem, size: int) -> Array:
    """Return the scales (size + 1,) for another number of unknowns; the scales of parameters remain."""
    count = 1 + len(problem.unknown_parameters)
    return np.concatenate([np.full(size + 1 - count, scale[0]), scale[-count:]])


def parameter_direction(change: float, previous: int) -> int:
    """Return the sign of the scaled parameter change along the tangent; ``previous`` if it is rounding error."""
    return (1 if change > 0 else -1) if abs(change) > CONSTANT_PARAMETER_SLOPE else previous
