"""Events of Floquet multipliers: period doublings, Neimark-Sacker points and ends of subharmonic branches.

BP  a multiplier passes +1 and curves cross (branch point), see `branch_point`.
PD  a multiplier passes -1 (period doubling).
    Located by Newton's method on {R = 0, g = 0} of the half-integer block, or as a bracketed root of det(Phi + 1).
NS  a complex pair of multipliers passes the unit circle (Neimark-Sacker).
    Located by Newton's method on {R = 0, g = 0}, with g the real part of its exponent from Hill's determinant. The
    initial guess is a bracketed root of the modulus.
    In a symmetric system with multipliers in equal pairs, two pass +1 (BP) or -1 (PD) at once, and no determinant
    changes sign: bracketed root of their modulus.
EP  a subharmonic branch ends on the branch of shorter period.

References
----------
Friedmann, Hammond & Woo (1977), Int. J. Numer. Meth. Eng. 11, https://doi.org/10.1002/nme.1620110708, for multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, NewBranch, Segment, has_corner
from hbgear.continuation.events.branch_point import BranchPointEvent, as_traced
from hbgear.continuation.events.columns import lengths, monitored_values
from hbgear.continuation.events.event import BuiltInEvent, LocatedEvent, locate_by_newton, locate_root, singular
from hbgear.continuation.events.near_tangency import near_zeros
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.stability import STABILITY_TOLERANCE, scaled_determinant, sign_of_pairs
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, SOLVER_ERRORS, refine, solve
from hbgear.harmonic.bifurcations.neimark_sacker import NeimarkSackerProblem, PairModulusProblem, exponent_of_pair
from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem
from hbgear.harmonic.multipliers.multiplier_collisions import (
    MIN_MULTIPLIERS,
    collisions,
    exchanges,
    extrapolated_crossings,
    leaps,
    passes_minus_one_cleanly,
)
from hbgear.harmonic.multipliers.multiplier_error import count_beyond, is_complex
from hbgear.harmonic.multipliers.sampled_slopes import has_sampled_slopes

PAIR_LOCATION_TOLERANCE = 1e-10
"""Fraction of the segment to which a pair is located; its modulus is not known more accurately because of rounding."""


MAX_TRUNCATION_SHIFT = 5e-3
"""Scaled arc length by which the multipliers of a truncated motion may pass -1 before or after the true doubling."""


SUBSEGMENTS, MIN_COLLIDING_MODULUS = 8, 0.8
"""Number of parts of a segment on which a pair is searched that is real for a while, and the least modulus of
multipliers that collide there."""

FOLD_DIRECTION = 1e-6
"""Component of the unit tangent in the parameter below which a point is a fold."""

DOUBLE_MULTIPLIER_DISTANCE = 1e-6
"""Distance up to which two multipliers on the unit circle are equal."""


class PeriodDoublingEvent(BuiltInEvent):
    """Period doubling: a multiplier passes -1, and motions of twice the period branch off."""

    kind, meaning, marker = "PD", "period doubling", "D"

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        """Return det(Phi + 1) at points with known multipliers."""
        mu = multipliers_of(points)
        return np.zeros((len(points), 0)) if mu is None else scaled_determinant(mu, -1.0)[:, None]

    def near_zeros(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return where det(Phi + 1) comes close to zero, except where pairs clearly pass -1 without collision."""
        mu, candidates = multipliers_of(points), super().near_zeros(points, values, scale)
        if mu is None:
            return candidates
        return _without_clean_passages(candidates, mu, lengths(points, scale))

    def find(self, segment: Segment) -> list[LocatedEvent]:
        mu = multipliers_of((segment.a, segment.b))
        if mu is None:
            return []
        before, after = scaled_determinant(mu, -1.0).tolist()
        return [self.locate(segment, before, after)] if before * after < 0 else []

    def locate(self, segment: Segment, before: float, after: float) -> LocatedEvent:
        """Locate the point by Newton's method on the half-integer block, or as a bracketed root of det(Phi + 1).

        The root is used if forces are sampled. If Newton's method does not converge from the secant estimate, it starts
        from the root: the block is superconvergent, while the multipliers of the truncated motion pass -1 at a slightly
        different value.
        """
        smooth = segment.problem.smooth
        extended = PeriodDoublingProblem(segment.problem, segment.name) if smooth else None
        if extended is not None:
            with suppress(*SOLVER_ERRORS):
                return locate_by_newton(segment, self, extended, before / (before - after))
        rough = locate_root(
            segment, self, lambda point: float(scaled_determinant(multipliers_at(segment, point)[None], -1.0)[0])
        )
        return rough if extended is None else refine_root(segment, rough, extended)

    def deviation(self, multipliers: ComplexArray) -> float:
        """Return the distance of the nearest multiplier from -1."""
        return float(np.abs(multipliers + 1).min(initial=math.inf))

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return PeriodDoublingProblem(problem, parameter)

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> NewBranch | None:
        """Return the start of the motion of twice the period, along the null vector of the half-integer block."""
        doubling, traced = PeriodDoublingProblem(branch.problem, branch.parameter), as_traced(branch, point)
        direction = np.append(side * doubling.null_vector(traced.X, **traced.parameters), 0.0)
        return doubling.doubled, BranchStart(doubling.embed(traced.X), dict(traced.parameters), direction)


def _without_clean_passages(
    candidates: list[tuple[int, float]], mu: ComplexArray, length: Array
) -> list[tuple[int, float]]:
    """Return the candidates, segments and fractions, on which pairs do not clearly pass -1 without collision."""
    if not candidates:
        return []
    clean = passes_minus_one_cleanly(mu, length, np.array([segment for segment, _ in candidates]))
    return [candidate for candidate, is_clean in zip(candidates, clean, strict=True) if not is_clean]


def refine_root(segment: Segment, rough: LocatedEvent, extended: MinimallyAugmentedProblem) -> LocatedEvent:
    """Refine a root of a function of the multipliers by Newton's method on more accurate equations.

    The rough root is returned if the refined one is not near or lies beyond the farther end, where it is another point,
    or if the ends of the segment are one point.
    """
    if not rough.located or segment.length == 0.0:
        return rough
    try:
        refined = locate_by_newton(
            segment, rough.event, extended, rough.s, margin=MAX_TRUNCATION_SHIFT / segment.length
        )
    except SEARCH_ERRORS:
        return rough
    beyond_farther_end = refined.s < 0 if rough.s > 0.5 else refined.s > 1
    shift = norm((refined.point.u - rough.point.u) / segment.scale)
    return rough if beyond_farther_end or shift > MAX_TRUNCATION_SHIFT else refined


class MotionBranchPointEvent(BranchPointEvent):
    """Branch point of periodic motions: two in one step are searched where multipliers come close to +1."""

    def near_zeros(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return where det(Phi - 1) / (dp/ds), which has no zero at folds, comes close to zero.

        Segments on which pairs clearly pass +1 without collision are left out.
        """
        mu = multipliers_of(points)
        if mu is None:
            return []
        tangents, length = np.array([point.tangent for point in points]), lengths(points, scale)
        direction = tangents[:, -1] / scale[-1] / norms(tangents / scale)
        direction[np.abs(direction) < FOLD_DIRECTION] = np.nan  # at a fold the ratio is rounding
        determinant = scaled_determinant(mu, 1.0) / direction
        return _without_clean_passages(near_zeros(determinant[:, None], length), -mu, length)


class NeimarkSackerEvent(BuiltInEvent):
    """Neimark-Sacker point: a complex pair of multipliers leaves the unit circle, and a second frequency appears.

    near : exponent of the pair, if it has been located already.
    """

    kind, meaning, marker = "NS", "Neimark-Sacker: a second frequency sets in", "s"
    needs_two_sides = True

    def __init__(self, near: complex | None = None) -> None:
        self.near = near

    def values(self, points: Sequence[CurvePoint], equations: CurveEquations) -> Array:
        """Return log |mu| of the complex pairs nearest to the unit circle, one inside and one outside; else nan."""
        mu = multipliers_of(points)
        if mu is None:
            return np.zeros((len(points), 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithm = np.where(is_complex(mu), np.log(np.abs(mu)), np.nan)
        inside = np.where(logarithm < -STABILITY_TOLERANCE, logarithm, -np.inf).max(axis=1, initial=-np.inf)
        outside = np.where(logarithm > STABILITY_TOLERANCE, logarithm, np.inf).min(axis=1, initial=np.inf)
        nearest = np.column_stack([inside, outside])
        return np.where(np.isfinite(nearest), nearest, np.nan)

    def near_zeros(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return where a pair comes close to the circle, alone, by a collision, or as another one returns.

        Segments across which multipliers cannot be followed are returned as well, because any event may occur on them.
        """
        mu, length = multipliers_of(points), lengths(points, scale)
        if mu is None:
            return []
        return [
            *near_zeros(values, length),
            *collisions(mu, length),
            *exchanges(mu),
            *extrapolated_crossings(mu, length),
            *leaps(mu),
        ]

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        mu = multipliers_of(points)
        if mu is None:
            return np.zeros(len(points) - 1, dtype=bool)
        unstable = count_unstable(mu)
        return (np.abs(unstable[1:] - unstable[:-1]) + 1) // 2

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate pairs where more multipliers pass than folds, branch points and period doublings explain."""
        ends = multipliers_of((segment.a, segment.b))
        if ends is None or has_corner(segment):  # multipliers jump at a corner
            return []
        (ua, ub), (da, db) = count_unstable(ends).tolist(), scaled_determinant(ends, -1.0).tolist()
        passes_real = (
            segment.a.parameter_direction * segment.b.parameter_direction < 0
            or segment.a.orientation != segment.b.orientation
        )
        explained = int(passes_real) + int(da * db < 0)
        # a fold, branch point or doubling changes the number by one, a complex pair by two
        if abs(ua - ub) - explained >= 2:
            return self._locate_simultaneous(segment, ends)
        if not explained and ua == ub:  # ends may be special points
            return []
        # refined multipliers at an end may jump from those that are computed along the segment
        computed = np.array([computed_multipliers(segment, point) for point in (segment.a, segment.b)])
        return self._locate_compensated(segment, computed)

    def _locate_compensated(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Locate a pair on the same segment as a fold, branch point or doubling that compensates it in number."""
        lower, upper = unstable_complex_counts(ends)
        located = []
        for rank in range(lower, upper, 2):
            crossing = self._locate_crossing(segment, rank)
            size = ranked_modulus(complex_multipliers(multipliers_at(segment, crossing.point)), rank)
            # else the pair became real outside the circle
            if crossing.located and abs(size - 1.0) < DOUBLE_MULTIPLIER_DISTANCE:
                located.append(self._refine(segment, crossing))
        return located or self._locate_pair_becoming_real(segment, ends) or self._locate_on_subsegments(segment, ends)

    def _locate_pair_becoming_real(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Locate a pair that passes the circle and becomes a positive real pair, on the same segment as a doubling."""
        lower, upper = sorted(count_unstable(without_negative_real(ends)).tolist())
        if upper - lower < 2 or segment.a.parameter_direction * segment.b.parameter_direction < 0:
            return []
        root = self._pair_root(segment, lambda mu: ranked_modulus(without_negative_real(mu), lower) - 1.0)
        modulus = ranked_modulus(complex_multipliers(multipliers_at(segment, root.point)), lower)
        return [self._refine(segment, root)] if root.located and abs(modulus - 1.0) < DOUBLE_MULTIPLIER_DISTANCE else []

    def _locate_on_subsegments(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Locate pairs that pass the circle on parts of a segment on which they are real for a while.

        The product of mu_i mu_j - 1 over all pairs passes zero there, as at a neutral saddle, whose pair is real.
        """
        colliding = np.count_nonzero(is_complex(ends) & (np.abs(ends) > MIN_COLLIDING_MODULUS), axis=1)
        if colliding[0] == colliding[1] or ends.shape[1] < MIN_MULTIPLIERS:
            return []
        fractions = np.linspace(0.0, 1.0, SUBSEGMENTS + 1).tolist()
        try:
            points = [segment.a, *(segment.at(s) for s in fractions[1:-1]), segment.b]
        except SOLVER_ERRORS:
            return []
        values = [sign_of_pairs(multipliers_at(segment, point)) for point in points]
        located = []
        for low, (a, b), (first, second) in zip(fractions, pairwise(points), pairwise(values), strict=False):
            if first * second >= 0:
                continue
            root = self._pair_root(segment.part(a, b), sign_of_pairs)
            pairs = np.abs(complex_multipliers(multipliers_at(segment, root.point)))
            if root.located and np.abs(pairs - 1).min(initial=math.inf) < DOUBLE_MULTIPLIER_DISTANCE:
                located.append(self._refine(segment, replace(root, s=low + root.s / SUBSEGMENTS)))
        return located

    def _locate_crossing(self, segment: Segment, rank: int) -> LocatedEvent:
        """Locate where the complex multiplier of this rank, from the largest, passes the unit circle."""
        return self._pair_root(segment, lambda mu: ranked_modulus(complex_multipliers(mu), rank) - 1.0)

    def _pair_root(self, segment: Segment, size: Callable[[ComplexArray], float]) -> LocatedEvent:
        """Locate the zero of a function of the multipliers (r,) on a segment."""
        return locate_root(
            segment, self, lambda point: size(multipliers_at(segment, point)), fine=PAIR_LOCATION_TOLERANCE
        )

    def _refine(self, segment: Segment, located: LocatedEvent) -> LocatedEvent:
        """Refine the point by the equations of the pair that was located, not of another one near the unit circle."""
        problem: Any = segment.problem
        if not problem.smooth:
            return located
        Omega = segment.parameters_at(located.point.value)["Omega"]
        mu = multipliers_at(segment, located.point)
        exponent = exponent_of_pair(mu, problem.nu, Omega)
        if exponent is None:
            return located
        event = NeimarkSackerEvent(exponent)
        equations = event.equations(problem, segment.name, located)
        if equations is None:
            return located
        rough = replace(located, event=event)
        refined = refine_root(segment, rough, equations)
        return rough if _leaves_segment(segment, mu, refined) else refined

    def _locate_simultaneous(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Locate two multipliers that pass the unit circle together: a complex pair, or a double real one by symmetry.

        The event is NS, or with real multipliers BP at +1 and PD at -1, whose determinants do not change sign there.
        Nothing is returned where two different real multipliers pass +1 one after the other: they belong to folds or
        branch points that truncation has displaced.
        """
        lower, upper = unstable_complex_counts(ends)
        crossings = [self._locate_crossing(segment, k) for k in range(lower, max(upper, lower + 1), 2)]
        if any(crossing.located for crossing in crossings):
            return [self._refine(segment, crossing) for crossing in crossings if crossing.located]
        rank = int(count_unstable(ends).min())
        sizes = sorted(ranked_modulus(mu, rank) for mu in ends)
        level = 1.0 if sizes[0] < 1.0 < sizes[1] else 1.0 + STABILITY_TOLERANCE

        def distance(point: CurvePoint) -> float:
            return ranked_modulus(multipliers_at(segment, point), rank) - level

        real = locate_root(segment, self, distance, "two multipliers at once")
        mu = multipliers_at(segment, real.point)
        first, second = mu[np.argsort(np.abs(np.abs(mu) - level))[:2]]
        if not real.located or (
            abs(first.imag) > DOUBLE_MULTIPLIER_DISTANCE and abs(first - second.conj()) < DOUBLE_MULTIPLIER_DISTANCE
        ):
            return [replace(real, note="")]
        if abs(first - second) >= DOUBLE_MULTIPLIER_DISTANCE:
            return self._locate_several_doublings(segment, ends)
        return [replace(real, event=BranchPointEvent() if first.real > 0 else PeriodDoublingEvent(), finder=self)]

    def deviation(self, multipliers: ComplexArray) -> float:
        """Return the distance of the nearest multiplier from the unit circle."""
        return float(np.abs(np.abs(multipliers) - 1).min(initial=math.inf))

    def _locate_several_doublings(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Locate the period doublings of several different real multipliers that pass -1 on one segment.

        An even number of them does not change the sign of det(Phi + 1). Each is the root of the modulus of its rank
        among the multipliers on the negative real axis.
        """
        lower, upper = sorted(count_beyond(ends, STABILITY_TOLERANCE)[:, 1].tolist())
        located = []

        def size(point: CurvePoint, rank: int) -> float:
            return ranked_modulus(negative_real(multipliers_at(segment, point)), rank) - 1.0

        for rank in range(lower, upper):
            note = f"multiplier {rank - lower + 1} of {upper - lower} that pass -1 here"
            root = locate_root(segment, self, partial(size, rank=rank), note)
            if root.located and abs(size(root.point, rank)) < DOUBLE_MULTIPLIER_DISTANCE:
                located.append(replace(root, event=PeriodDoublingEvent(), finder=self))
        return located

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """Return the equations: with Hill's determinant where the slopes of all laws are known."""
        compiled = problem.compiled({})
        has_slopes = problem.smooth and has_sampled_slopes(compiled) and not compiled.structure.large
        return (NeimarkSackerProblem if has_slopes else PairModulusProblem)(problem, parameter, self.near)


def _leaves_segment(segment: Segment, mu: ComplexArray, refined: LocatedEvent) -> bool:
    """Return whether Newton's method went beyond an end, where the pair is nearer to the circle than at that end.

    mu : multipliers at the initial point; the pair is the one nearest to the circle.
    """
    if 0 <= refined.s <= 1:
        return False
    pair = mu[np.abs(np.abs(mu) - 1).argmin()]

    def circle_distance(point: CurvePoint) -> float:
        multipliers = multipliers_at(segment, point)
        return abs(float(np.abs(multipliers[np.abs(multipliers - pair).argmin()])) - 1)

    return circle_distance(refined.point) < circle_distance(segment.a if refined.s < 0 else segment.b)


class PeriodDoublingMergeEvent(BuiltInEvent):
    """End of a subharmonic branch: its subharmonic part passes zero, and it joins the branch of shorter period."""

    kind, meaning, marker, terminal, alone = "EP", "end: the branch joins the one it came from", "+", True, True

    def find(self, segment: Segment) -> list[LocatedEvent]:
        part = segment.problem.subharmonic_part  # type: ignore[attr-defined]
        first, second = part(segment.a.X), part(segment.b.X)
        threshold = 1e-7 * float(np.linalg.norm(segment.a.X))  # smaller parts are rounding of motions of shorter period
        if min(np.linalg.norm(first), np.linalg.norm(second)) <= threshold or float(first @ second) >= 0:
            return []
        root = locate_root(segment, self, lambda point: float(first @ part(point.X)))
        try:
            return [replace(root, point=_at_doubling(segment, root.point))]
        except SOLVER_ERRORS:
            return [root]

    def termination(self, name: str, value: float) -> tuple[Status, str]:
        return Status.MERGED, f"the branch joined the one it came from at {name} = {value:.6g}"


def _at_doubling(segment: Segment, point: CurvePoint) -> CurvePoint:
    """Return the point moved to the period doubling of the shorter motion where the branch ends.

    With a subharmonic part of size a the equations determine the parameter to the tolerance over a only, which does not
    determine it at all as a vanishes.
    """
    problem: Any = segment.problem
    if problem.nu % 2 or not problem.smooth:
        return point
    extended = PeriodDoublingProblem(problem.with_order(problem.nu // 2), segment.name)
    shorter = extended.doubled.resized(point.X)[extended.even]
    values = segment.parameters_at(point.value)
    extended = extended.with_borders_at(np.append(shorter, point.value), values)
    solution = refine(extended, solve(extended, np.append(shorter, point.value), values), values)
    value = float(solution.X[-1])
    if abs(value - point.value) > 0.1 * segment.length * segment.scale[-1]:  # both ends may lie at the same value
        return point
    X = problem.resized(extended.embed(solution.X[:-1]))
    return singular(segment, np.append(X, value), point)


def multipliers_of(points: Sequence[CurvePoint]) -> ComplexArray | None:
    """Return multipliers (points, r), if any are known."""
    return monitored_values(points, "multipliers")


def multipliers_at(segment: Segment, point: CurvePoint) -> ComplexArray:
    """Return the multipliers of a point, computed if they are unknown."""
    stored: ComplexArray | None = point.observed.get("multipliers")
    return computed_multipliers(segment, point) if stored is None else stored


def computed_multipliers(segment: Segment, point: CurvePoint) -> ComplexArray:
    """Return the multipliers of a point with the harmonics of the curve; known ones may have been refined."""
    values = segment.parameters_at(point.value)
    problem: Any = segment.problem  # a HarmonicBalance, whose events these are
    return problem.multipliers(point.X, points=8, **values)


def count_unstable(mu: ComplexArray) -> np.ndarray:
    """Return the number of unstable multipliers of sets (P, r)."""
    return (np.abs(mu) > 1 + STABILITY_TOLERANCE).sum(axis=1)


def complex_multipliers(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers that are not real."""
    return mu[is_complex(mu)]


def negative_real(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers on the negative real axis, and zero in the place of others."""
    return np.where(~is_complex(mu) & (mu.real < 0), mu, 0.0)


def without_negative_real(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers with zero in the place of those on the negative real axis."""
    return np.where(is_complex(mu) | (mu.real > 0), mu, 0.0)


def unstable_complex_counts(ends: ComplexArray) -> tuple[int, int]:
    """Return the smaller and the larger number of unstable complex multipliers at two ends."""
    smaller, larger = sorted(count_unstable(np.where(is_complex(ends), ends, 0.0)).tolist())
    return smaller, larger


def ranked_modulus(mu: ComplexArray, k: int) -> float:
    """Return the modulus of a rank k from the largest; nan if there are fewer multipliers."""
    sizes = np.sort(np.abs(mu))[::-1]
    return float(sizes[k]) if k < len(sizes) else math.nan
