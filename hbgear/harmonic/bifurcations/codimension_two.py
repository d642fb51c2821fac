"""Points of codimension two on curves of folds, period doublings and Neimark-Sacker points in two parameters.

RI    1:1 resonance, a double multiplier +1: on folds w^T D_s v = 0; the end of a Neimark-Sacker curve.
RII   1:2 resonance, a double multiplier -1: on period doublings w^T D_s v = 0; the end of a Neimark-Sacker curve.
RIII  1:3 resonance: cos theta = -1/2 on a Neimark-Sacker curve, theta the angle of the multipliers.
RIV   1:4 resonance: cos theta = 0.
FF    fold-flip, multipliers +1 and -1: the other of the two blocks of the doubled problem is singular.
GPD   generalised period doubling: the cubic coefficient of the doubled branch is zero,

    w^T [R_XX h v + R_XXX v v v / 6] = 0,   R_X h = -R_XX v v / 2

v and w are the null vectors at the point, D(s) is Hill's determinant in real coefficients and D_s its derivative in
the exponent. All are zeros of smooth functions along the curve, located as bracketed roots. Their signs do not depend
on the signs of v and w: they are multiplied by the sign of the determinant of [A w; v^T 0], A v = 0.

A curve of Neimark-Sacker points leaves a resonance RI or RII on the side where the two exponents with zero sum are
imaginary. Its first point is solved next to the resonance, since the equations of the pair are singular there.

Cusps (CP) are turning points of curves of folds; see `hbgear.continuation.events.fold`.

References
----------
Kuznetsov, Elements of Applied Bifurcation Theory (2004), ch. 9, https://doi.org/10.1007/978-1-4757-3978-7.
Kuznetsov & Meijer (2005), SIAM J. Sci. Comput. 26(6), https://doi.org/10.1137/030601508.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import scipy

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.augmented.level import ScalarConditionProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.augmented.null_vectors import least_singular_vectors
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, Segment
from hbgear.continuation.events.event import BuiltInEvent, Event, LocatedEvent, locate_root
from hbgear.continuation.numerics.linear import as_dense, bordered, norm
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, SOLVER_ERRORS, Solution, solve
from hbgear.harmonic.bifurcations.neimark_sacker import NeimarkSackerProblem, PairModulusProblem, exponent_of_pair
from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem
from hbgear.harmonic.multipliers.hill import CondensedHillMatrix
from hbgear.harmonic.multipliers.sampled_slopes import has_sampled_slopes
from hbgear.mechanics.series.fourier import places, to_real

Test = Callable[[Any, Array, dict[str, float]], float]
"""Function of the equations of a special point, the motion and all parameters."""


class CodimensionTwoEvent(BuiltInEvent):
    """Zero of a smooth function along a curve of special points."""

    function: Test

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Return the function at points, (P, 1); it is stored with them."""
        for point in points:
            if self.kind not in point.observed:
                point.observed[self.kind] = self._value(problem, name, fixed, point)
        return np.array([[point.observed[self.kind]] for point in points])

    def find(self, segment: Segment) -> list[LocatedEvent]:
        def test(point: CurvePoint) -> float:
            return self._value(segment.problem, segment.name, segment.parameters, point)

        return [locate_root(segment, self, test)] if test(segment.a) * test(segment.b) < 0 else []

    def _value(self, problem: Any, name: str, fixed: Mapping[str, float], point: CurvePoint) -> float:
        """Return the function at a point; nan where it is undefined."""
        X, tracked = problem.split(point.X)
        try:
            return type(self).function(problem, X, {**fixed, **tracked, name: point.value})
        except SOLVER_ERRORS:
            return math.nan


# ---- resonances 1:1 and 1:2, and fold-flip


def hill_matrices(balance: Any, X: Array, parameters: Mapping[str, float], unknowns: Array) -> tuple[Array, Array]:
    """Return Hill's determinant D(0) and its derivative in the exponent, (k, k) each, for real coefficients.

    The disturbance of a motion X (n,) has the given unknowns (k,).
    """
    hill = CondensedHillMatrix.of(balance.compiled(parameters), X, parameters["Omega"])
    G, dG = hill.receptances(0.0)
    D, D_s = (
        _in_real_coefficients(matrix, balance.m, balance.orders)[np.ix_(unknowns, unknowns)]
        for matrix in (hill.matrix(G, 0.0), hill.rate(G, dG, 0.0))
    )
    return D, D_s


def _in_real_coefficients(matrix: ComplexArray, m: int, orders: Array) -> Array:
    """Return a matrix for coefficients -H..H of m elements as the matrix for real coefficients of some orders."""
    H = len(matrix) // m // 2
    rows = matrix.reshape(2 * H + 1, m, 2 * H + 1, m)[H:]
    above, below = rows[:, :, H:], rows[:, :, H::-1]
    image = np.empty_like(rows)
    image[:, :, 0] = above[:, :, 0]
    image[:, :, 1::2], image[:, :, 2::2] = 0.5 * (above + below)[:, :, 1:], 0.5j * (below - above)[:, :, 1:]
    image[1:] *= 2.0
    i = places(orders)
    real = to_real(image.transpose(1, 3, 2, 0))[..., i].transpose(0, 3, 1, 2)[..., i]  # row, column by element
    return real.reshape(m * len(i), -1)


def rate_of_exponent(D: Array, D_s: Array) -> float:
    """Return the derivative of det D(s) at s = 0, up to a positive factor, with a singular D: zero if it is double."""
    w, v = least_singular_vectors(D)
    return float(w @ D_s @ v) * _border_sign(D, w, v)


def _border_sign(A: Array, w: Array, v: Array) -> float:
    """Return the sign of the determinant of [A w; v^T 0]."""
    return float(np.linalg.slogdet(bordered(A, w, v))[0])


def _signed_singular_value(A: Array) -> float:
    """Return the smallest singular value relative to the largest, with the sign of the determinant."""
    s = scipy.linalg.svdvals(A)
    return float(np.linalg.slogdet(A)[0] * s[-1] / s[0])


class ResonanceEvent(CodimensionTwoEvent):
    """Double real multiplier on a curve of folds or period doublings, at which a curve of Neimark-Sacker points begins.

    Attributes
    ----------
    multiplier : {1, -1}
        The double multiplier.
    """

    multiplier: int

    def branch_direction(
        self, branch: Branch, point: SpecialPoint, side: int
    ) -> tuple[ContinuationProblem, BranchStart] | None:
        """Return a Neimark-Sacker point near the resonance, which does not depend on the side; None without one.

        It is searched near the points of the branch next to the resonance. On one side of it the pair is complex.
        """
        for distance, sign in product(range(1, MAX_NEIGHBOURS + 1), (1, -1)):
            i = point.index + sign * distance
            start = self._complex_pair_near(branch, i) if 0 <= i < len(branch) else None
            if start is not None:
                direction = np.zeros(len(start[1].X) + 1)
                direction[-1] = branch.values[i] - branch.values[point.index]
                return start[0], BranchStart(start[1].X, branch.parameters_at(i), direction, bifurcating=False)
        return None

    def _complex_pair_near(self, branch: Branch, i: int) -> tuple[NeimarkSackerProblem, Solution] | None:
        """Return a Neimark-Sacker point near point i of a branch, with its equations; None if the pair is real.

        The parameters have their values at point i, except the tracked one. On the curve of motions through point i,
        with tangent t, the sum of the two exponents is zero at the distance -f / (df/dt) from it, f the function of
        this event.
        """
        equations: Any = as_problem(branch.problem)
        balance, name, parameters = equations.problem, equations.parameter, branch.parameters_at(i)
        X = balance.from_point(branch[i])
        evaluation = balance.linearise(X, name, **parameters)
        t = scipy.linalg.svd(np.column_stack([as_dense(evaluation.dR_dX), evaluation.dR_dp]))[2][-1]
        h = DIFFERENCE_STEP * (norm(X) or 1.0)

        def point_at(distance: float) -> tuple[Array, dict[str, float]]:
            return X + distance * t[:-1], {**parameters, name: parameters[name] + distance * float(t[-1])}

        try:
            before, value, after = (type(self).function(equations, *point_at(distance)) for distance in (-h, 0.0, h))
            # Newton step along the curve of motions to the zero of the function
            distance = -2 * h * value / (after - before)
            nearby, changed = point_at(distance)
            mu = balance.multipliers(nearby, **changed)
            two = np.argsort(np.abs(mu - self.multiplier))[:2]
            s = exponent_of_pair(mu[two], balance.nu, changed["Omega"])
            if s is None:
                return None
            pair = NeimarkSackerProblem(balance, name, 1j * s.imag)
            fixed = {key: value for key, value in parameters.items() if key != name}
            solution = solve(pair, pair.join(nearby, changed), fixed)
        except SEARCH_ERRORS:
            return None
        return (pair, solution) if norm(pair.split(solution.X)[0] - nearby) <= abs(distance) else None


MAX_NEIGHBOURS = 8
"""Points of a branch on each side of a resonance near which a complex pair of multipliers is searched."""


class FirstResonanceEvent(ResonanceEvent):
    """1:1 resonance on a curve of folds: a second multiplier is +1, and a curve of Neimark-Sacker points begins."""

    kind, meaning, marker, multiplier = "RI", "1:1 resonance: a double multiplier +1", "p", 1

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the derivative of the determinant in the exponent."""
        return rate_of_exponent(*hill_matrices(problem.problem, X, parameters, np.arange(len(X))))


class SecondResonanceEvent(ResonanceEvent):
    """1:2 resonance on a curve of period doublings: a second multiplier is -1."""

    kind, meaning, marker, multiplier = "RII", "1:2 resonance: a double multiplier -1", "h", -1

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the derivative of the determinant of the half-integer block in the exponent."""
        return rate_of_exponent(*hill_matrices(problem.doubled, problem.embed(X), parameters, problem.odd))


class FlipOnFoldEvent(CodimensionTwoEvent):
    """Fold-flip on a curve of folds: a multiplier passes -1."""

    kind, meaning, marker = "FF", "fold-flip: multipliers +1 and -1", "H"

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the smallest singular value of the half-integer block, with the sign of its determinant."""
        return _signed_singular_value(
            PeriodDoublingProblem(problem.problem, problem.parameter).matrix(X, parameters)[0]
        )


class FoldOnFlipEvent(CodimensionTwoEvent):
    """Fold-flip on a curve of period doublings: a multiplier passes +1."""

    kind, meaning, marker = "FF", FlipOnFoldEvent.meaning, FlipOnFoldEvent.marker

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the smallest singular value of dR/dX, with the sign of its determinant."""
        return _signed_singular_value(as_dense(problem.problem.linearise(X, "", **parameters).dR_dX))


# ---- generalised period doubling


class GeneralisedDoublingEvent(CodimensionTwoEvent):
    """Generalised period doubling: the branch of twice the period turns over, and a curve of its folds begins."""

    kind, meaning, marker = "GPD", "generalised period doubling: the doubled branch turns over", "X"

    @staticmethod
    def function(problem: Any, X: Array, parameters: dict[str, float]) -> float:
        """Return the cubic coefficient, or zero if it is within a hundred times its rounding.

        Every point of a curve of a linear oscillator is degenerate.
        """
        value, rounding = cubic_coefficient(problem, X, parameters)
        return 0.0 if abs(value) < rounding else value

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return the zero of the coefficient itself if its sign changes beyond rounding."""

        def test(point: CurvePoint) -> float:
            X, tracked = segment.problem.split(point.X)
            parameters = {**segment.parameters, **tracked, segment.name: point.value}
            return cubic_coefficient(segment.problem, X, parameters)[0]

        first, last = (
            self._value(segment.problem, segment.name, segment.parameters, end) for end in (segment.a, segment.b)
        )
        return [locate_root(segment, self, test)] if first * last < 0 else []


def cubic_coefficient(problem: Any, X: Array, parameters: dict[str, float]) -> tuple[float, float]:
    """Return the cubic coefficient of the doubled branch of a period doubling X (n,) and a hundred times its rounding.

    Its sign is that of the side on which the branch exists. Derivatives along v and h are differences of Jacobians of
    fourth order.
    """
    doubled, embedded, odd, even = problem.doubled, problem.embed(X), problem.odd, problem.even
    w, v = np.zeros(len(embedded)), np.zeros(len(embedded))
    w[odd], v[odd] = least_singular_vectors(problem.matrix(X, parameters)[0])
    t = DIFFERENCE_STEP * (norm(X) or 1.0)

    def jacobian(change: Array) -> Array:
        return as_dense(doubled.linearise(embedded + change, "", **parameters).dR_dX)

    def jacobians_along(direction: Array) -> tuple[list[Array], float]:
        size = norm(direction) or 1.0
        step = t / size
        return [jacobian(k * step * direction) for k in (-2, -1, 1, 2)], step

    # first and second derivatives along v by five points, with errors of fourth order
    (A, B, C, D), step = jacobians_along(v)
    first, second = (A - 8 * B + 8 * C - D) @ v / (12 * step), (-A + 16 * B + 16 * C - D) @ v
    middle = jacobian(np.zeros(len(embedded)))
    third = (second - 30 * middle @ v) / (12 * step**2)
    h = np.zeros(len(embedded))
    h[even] = -0.5 * np.linalg.solve(middle[np.ix_(even, even)], first[even])
    (A, B, C, D), step = jacobians_along(h)
    mixed = (A - 8 * B + 8 * C - D) @ v / (12 * step)
    coefficient = float(w @ (mixed + third / 6))
    rounding = MAX_ROUNDING * float(np.finfo(float).eps) * float(np.abs(middle).max()) / t**2
    return coefficient * _border_sign(middle[np.ix_(odd, odd)], w[odd], v[odd]), rounding


DIFFERENCE_STEP = 5e-3
"""Step of the differences of Jacobians, relative to the motion: the errors of fourth order and of rounding are 1e-8."""

MAX_ROUNDING = 100.0
"""Rounding of the cubic coefficient, over the rounding of an entry of the Jacobian over the step squared."""


# ---- resonances on curves of Neimark-Sacker points


class AngleEvent(CodimensionTwoEvent):
    """Strong resonance on a curve of Neimark-Sacker points: cos theta passes a value.

    The exponent at a point starts at that of the point before, because another pair may be nearer to the unit circle.
    """

    cosine: float

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        exponent = None
        for point in points:
            if EXPONENT not in point.observed:
                point.observed[EXPONENT] = exponent_at(problem, name, fixed, point, exponent)
            exponent = point.observed[EXPONENT]
        return np.array([[self._value(problem, name, fixed, point)] for point in points])

    def _value(self, problem: Any, name: str, fixed: Mapping[str, float], point: CurvePoint) -> float:
        """Return cos theta minus its value at the resonance; nan where the pair is real."""
        s = point.observed.get(EXPONENT) or exponent_at(problem, name, fixed, point, None)
        return math.nan if s is None else math.cos(_angle(problem, name, fixed, point, s)) - self.cosine


EXPONENT = "Neimark-Sacker exponent"
"""Name under which points of a curve store the exponent of the pair."""


def exponent_at(
    problem: Any, name: str, fixed: Mapping[str, float], point: CurvePoint, near: complex | None
) -> complex | None:
    """Return the exponent of the pair at a point of a curve of Neimark-Sacker points; None if the pair is real.

    ``near`` is the exponent of a neighbouring point; None for that of the equations.
    """
    X, tracked = problem.split(point.X)
    equations = problem if near is None else type(problem)(problem.problem, problem.parameter, near)
    try:
        return equations.exponent(X, **{**fixed, **tracked, name: point.value})
    except SEARCH_ERRORS:
        return None


def _angle(problem: Any, name: str, fixed: Mapping[str, float], point: CurvePoint, s: complex) -> float:
    """Return the angle [rad] of the multipliers with the exponent s, up to whole turns."""
    Omega = {**fixed, **problem.split(point.X)[1], name: point.value}["Omega"]
    return float(2 * math.pi * problem.problem.nu * s.imag / Omega)


class ThirdResonanceEvent(AngleEvent):
    """1:3 resonance: multipliers exp(+-2 pi i / 3)."""

    kind, meaning, marker, cosine = "RIII", "1:3 resonance: the multipliers are third roots of unity", "<", -0.5


class FourthResonanceEvent(AngleEvent):
    """1:4 resonance: multipliers i and -i."""

    kind, meaning, marker, cosine = "RIV", "1:4 resonance: the multipliers are i and -i", "d", 0.0


class RealPairProblem(ScalarConditionProblem):
    """Equations of the resonance at the end of a curve of Neimark-Sacker points, on a curve of codimension one.

    Parameters
    ----------
    problem : NeimarkSackerProblem
        Equations of the Neimark-Sacker points, which are singular there.
    parameter : str
        Parameter of their curve.
    end : RealPairEvent
        The end.
    """

    argument_names = ("end",)

    def __init__(self, problem: Any, parameter: str, end: RealPairEvent) -> None:
        curve = end.codimension_one(problem.problem, problem.parameter)
        super().__init__(curve, parameter, lambda point: end.on.function(curve, point.X, dict(point.parameters)))
        self._fixed(end=end)


class RealPairEvent(CodimensionTwoEvent):
    """End of a curve of Neimark-Sacker points, where the pair becomes real: the resonance 1:1 or 1:2.

    theta^2, or (pi - theta)^2, falls linearly to zero. The point is located on the curve of folds or period doublings
    that passes there.

    Parameters
    ----------
    on : FirstResonanceEvent or SecondResonanceEvent
        The same point on that curve.
    equations : type
        `FoldProblem` or `PeriodDoublingProblem`.
    """

    terminal = True
    regular_at_corners = True  # the curve of folds or period doublings does not end there

    def __init__(self, on: type[CodimensionTwoEvent], equations: type[FoldProblem]) -> None:
        self.kind, self.meaning, self.marker = on.kind, on.meaning, on.marker
        self.on, self.codimension_one = on, equations

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Return the resonance that a step has passed: the pair is real on a part of the segment, not at its ends."""

        def square(s: float) -> float:
            return self._angle(segment, replace(segment.a, u=segment.guess(s), observed={})) ** 2

        ends = square(0.0), square(1.0)
        if min(ends) > MAX_PASSED_ANGLE**2:
            return []
        falls = [end - square(s) for end, s in zip(ends, (SLOPE_FRACTION, 1.0 - SLOPE_FRACTION), strict=True)]
        if min(falls) <= 0:
            return []
        first, last = (SLOPE_FRACTION * end / fall for end, fall in zip(ends, falls, strict=True))
        gap = 1.0 - first - last  # at one point of it a pair of a symmetric motion may pass -1 and stay complex
        if gap <= 0 or any(square(first + part * gap) > 0 for part in (1 / 3, 2 / 3)):
            return []
        found = self._near(segment, segment.guess(first))
        return [found] if found is not None and 0 <= found.s <= 1 else []

    def branch_direction(
        self, branch: Branch, point: SpecialPoint, side: int
    ) -> tuple[ContinuationProblem, BranchStart]:
        """Return the curve of folds or period doublings that passes at the end, in the direction of ``side``."""
        ended: Any = as_problem(branch.problem)
        equations = self.codimension_one(ended.problem, ended.parameter)
        X = equations.join(ended.problem.from_point(point), point.parameters)
        direction = np.append(np.zeros(len(X)), float(side))
        return equations, BranchStart(X, dict(point.parameters), direction, bifurcating=False)

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """Return the resonance slightly beyond the last segment."""
        before, after = (self._angle(segment, end) ** 2 for end in (segment.a, segment.b))
        if not (after < before and after < MAX_END_ANGLE**2):
            return None
        s = before / (before - after)
        return self._near(segment, segment.a.u + s * (segment.b.u - segment.a.u))

    def _near(self, segment: Segment, u: Array) -> LocatedEvent | None:
        """Return the resonance near unknowns u; None if Newton's method finds no such point."""
        equations = self.equations(segment.problem, segment.name, None)
        try:
            solution = equations.located(u, segment.parameters_at(float(u[-1])))
        except SEARCH_ERRORS:
            return None
        root = solution.X
        if norm((root - u) / segment.scale) > MAX_END_SHIFT:
            return None
        point = replace(segment.b, u=root, residual=solution.residual, iterations=solution.iterations, observed={})
        return LocatedEvent(self, segment.fraction_of(root), point, True)

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem:
        """Return the equations of the resonance, with the unknowns of the Neimark-Sacker points."""
        return RealPairProblem(problem, parameter, self)

    def _angle(self, segment: Segment, point: CurvePoint) -> float:
        """Return the angle of the multipliers from the real axis at this resonance [rad]; zero if they are real."""
        s = exponent_at(segment.problem, segment.name, segment.parameters, point, segment.a.observed.get(EXPONENT))
        if s is None:
            return 0.0
        cosine = math.cos(_angle(segment.problem, segment.name, segment.parameters, point, s))
        return math.acos(max(-1.0, min(1.0, cosine if self.on is FirstResonanceEvent else -cosine)))

    def termination(self, name: str, value: float) -> tuple[Status, str]:
        return Status.EVENT, f"the curve of Neimark-Sacker points ends at a {self.meaning} at {name} = {value:.9g}"


MAX_END_ANGLE = 0.3
"""Angle of the multipliers, from 0 or pi [rad], up to which the end of a Neimark-Sacker curve is searched."""

MAX_PASSED_ANGLE = 1.0
"""Angle of the multipliers, from 0 or pi [rad], from which a step may pass the end of a Neimark-Sacker curve."""

SLOPE_FRACTION = 0.02
"""Fraction of a segment over which the slope of the square of the angle is a difference."""

MAX_END_SHIFT = 0.1
"""Scaled distance of the end of a Neimark-Sacker curve from its extrapolation, above which it is another point."""


def events_of_codimension_two(curve: MinimallyAugmentedProblem) -> tuple[Event, ...]:
    """Return the events along a curve of special points of a harmonic balance, besides cusps and branch points.

    There are none for other curves, laws whose slopes are unknown, and structures without modes.
    """
    balance: Any = curve.problem
    evaluator = balance.compiled({})
    if isinstance(curve, PairModulusProblem):
        return ThirdResonanceEvent(), FourthResonanceEvent()
    has_slopes = balance.smooth and has_sampled_slopes(evaluator) and evaluator.structure.modes is not None
    if not has_slopes:
        return ()
    if isinstance(curve, PeriodDoublingProblem):
        return SecondResonanceEvent(), FoldOnFlipEvent(), GeneralisedDoublingEvent()
    if isinstance(curve, NeimarkSackerProblem):
        ends = (
            RealPairEvent(FirstResonanceEvent, FoldProblem),
            RealPairEvent(SecondResonanceEvent, PeriodDoublingProblem),
        )
        return ThirdResonanceEvent(), FourthResonanceEvent(), *ends
    if isinstance(curve, FoldProblem):
        return FirstResonanceEvent(), FlipOnFoldEvent()
    return ()
