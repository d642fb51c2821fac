"""Events of periodic motions: changes of their stability or of their contact regime.

PD  a multiplier passes -1 (period doubling).
    Located by Newton's method on {R = 0, g = 0} of the half-integer block, or as a bracketed root of det(Phi + 1).
NS  a complex pair of multipliers passes the unit circle (Neimark-Sacker).
    Located by Newton's method on {R = 0, g = 0}, with g the real part of its exponent from Hill's determinant. The
    initial guess is a bracketed root of the modulus.
    In a symmetric system with multipliers in equal pairs, two pass +1 (BP) or -1 (PD) at once, and no determinant
    changes sign: bracketed root of their modulus.
GR  an extremum of an element grazes a breakpoint of its law: the impact regime changes.
    Located by Newton's method on {R = 0, extremum = breakpoint}, or as a bracketed root.
SL  a friction slider begins to slip, see `slip`.
EP  a subharmonic branch ends on the branch of shorter period.

References
----------
Friedmann, Hammond & Woo (1977), Int. J. Numer. Meth. Eng. 11, https://doi.org/10.1002/nme.1620110708, for multipliers.
Petrov & Ewins (2003), J. Turbomach. 125(2), https://doi.org/10.1115/1.1539868, for contact projected exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy  # sub-modules are imported at first use

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, Segment, normal_of, point_from_solution
from hbgear.continuation.events.branch_point import BranchPointEvent, as_traced
from hbgear.continuation.events.event import (
    Event,
    LocatedEvent,
    column,
    lengths,
    locate_by_newton,
    locate_root,
    singular,
)
from hbgear.continuation.events.fold import CuspEvent, FoldEvent, IsolaCentreEvent
from hbgear.continuation.events.near_tangency import near_zeros
from hbgear.continuation.events.registry import EVENTS, RegisteredEvent
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence, on_curve, refine, solve
from hbgear.harmonic.bifurcations.codimension_two import (
    FirstResonanceEvent,
    FlipOnFoldEvent,
    FourthResonanceEvent,
    GeneralisedDoublingEvent,
    SecondResonanceEvent,
    ThirdResonanceEvent,
)
from hbgear.harmonic.bifurcations.extremum import peak_of
from hbgear.harmonic.bifurcations.grazing import GrazingProblem
from hbgear.harmonic.bifurcations.neimark_sacker import NeimarkSackerProblem, exponent_of_pair
from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem
from hbgear.harmonic.bifurcations.slip import SlipEvent
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.multipliers.multiplier_collisions import (
    collisions,
    exchanges,
    extrapolated_crossings,
    leaps,
    passes_minus_one_cleanly,
)
from hbgear.harmonic.multipliers.multiplier_error import count_beyond
from hbgear.harmonic.multipliers.sampled_slopes import has_sampled_slopes


class PeriodDoublingEvent(Event):
    """Period doubling: a multiplier passes -1, and motions of twice the period branch off."""

    kind, meaning, marker = "PD", "period doubling", "D"

    def __init__(self) -> None:
        pass

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Return det(Phi + 1) at points with known multipliers."""
        mu = _multipliers(points)
        return np.zeros((len(points), 0)) if mu is None else _doubling_determinant(mu)[:, None]

    def near_zeros(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return where det(Phi + 1) comes close to zero, except where pairs clearly pass -1 without collision."""
        mu, candidates = _multipliers(points), super().near_zeros(points, values, scale)
        if mu is None or not candidates:
            return candidates
        clean = passes_minus_one_cleanly(mu, lengths(points, scale), np.array([segment for segment, _ in candidates]))
        return [candidate for candidate, passed in zip(candidates, clean, strict=True) if not passed]

    def find(self, segment: Segment) -> list[LocatedEvent]:
        mu = _multipliers((segment.a, segment.b))
        if mu is None:
            return []
        before, after = _doubling_determinant(mu).tolist()
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
            try:
                return locate_by_newton(segment, self, extended, before / (before - after))
            except (NoConvergence, np.linalg.LinAlgError):
                pass
        rough = locate_root(
            segment, self, lambda point: float(_doubling_determinant(_multipliers_at(segment, point)[None])[0])
        )
        return rough if extended is None else _refine_root(segment, rough, extended)

    def deviation(self, multipliers: ComplexArray) -> float:
        """Return the distance of the nearest multiplier from -1."""
        return float(np.abs(multipliers + 1).min(initial=math.inf))

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return PeriodDoublingProblem(problem, parameter)

    def branch_direction(
        self, branch: Branch, point: SpecialPoint, side: int
    ) -> tuple[ContinuationProblem, BranchStart] | None:
        """Return the start of the motion of twice the period, along the null vector of the half-integer block."""
        doubling, traced = PeriodDoublingProblem(branch.problem, branch.parameter), as_traced(branch, point)
        direction = np.append(side * doubling.null_vector(traced.X, **traced.parameters), 0.0)
        return doubling.doubled, BranchStart(doubling.embed(traced.X), dict(traced.parameters), direction)


def _refine_root(segment: Segment, rough: LocatedEvent, extended: MinimallyAugmentedProblem) -> LocatedEvent:
    """Refine a root of a function of the multipliers by Newton's method on more accurate equations.

    The rough root is returned if the refined one is not near.
    """
    if not rough.located:
        return rough
    try:
        refined = locate_by_newton(
            segment, rough.event, extended, rough.s, beyond=MAX_TRUNCATION_SHIFT / segment.length
        )
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        return rough
    return refined if norm((refined.point.u - rough.point.u) / segment.scale) <= MAX_TRUNCATION_SHIFT else rough


class NeimarkSackerEvent(Event):
    """Neimark-Sacker point: a complex pair of multipliers leaves the unit circle, and a second frequency appears.

    near : exponent of the pair, if it has been located already.
    """

    kind, meaning, marker = "NS", "Neimark-Sacker: a second frequency sets in", "s"
    needs_two_sides = True

    def __init__(self, near: complex | None = None) -> None:
        self.near = near

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Return log |mu| of the complex pairs nearest to the unit circle, one inside and one outside; else nan."""
        mu = _multipliers(points)
        if mu is None:
            return np.zeros((len(points), 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.where(_is_complex(mu), np.log(np.abs(mu)), np.nan)
        inside = np.where(size < -STABILITY_TOLERANCE, size, -np.inf).max(axis=1, initial=-np.inf)
        outside = np.where(size > STABILITY_TOLERANCE, size, np.inf).min(axis=1, initial=np.inf)
        both = np.column_stack([inside, outside])
        return np.where(np.isfinite(both), both, np.nan)

    def near_zeros(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return where a pair comes close to the circle, alone, by a collision, or as another one returns.

        Segments across which multipliers cannot be followed are returned as well, because any event may occur on them.
        """
        mu, length = _multipliers(points), lengths(points, scale)
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
        mu = _multipliers(points)
        if mu is None:
            return np.zeros(len(points) - 1, dtype=bool)
        unstable = _count_unstable(mu)
        pairs: np.ndarray = (np.abs(unstable[1:] - unstable[:-1]) + 1) // 2
        return pairs

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate pairs where more multipliers pass than folds, branch points and period doublings explain."""
        ends = _multipliers((segment.a, segment.b))
        if ends is None:
            return []
        (ua, ub), (da, db) = _count_unstable(ends).tolist(), _doubling_determinant(ends).tolist()
        passes_real = (
            segment.a.parameter_direction * segment.b.parameter_direction < 0
            or segment.a.orientation != segment.b.orientation
        )
        explained = int(passes_real) + int(da * db < 0)
        if abs(ua - ub) - explained >= 2:
            return self._locate_simultaneous(segment, ends)
        return self._locate_compensated(segment, ends) if explained or ua != ub else []  # ends may be special points

    def _locate_compensated(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Locate a pair on the same segment as a fold, branch point or doubling that compensates it in number."""
        few, many = _unstable_complex_counts(ends)
        located = []
        for rank in range(few, many, 2):
            found = self._locate_crossing(segment, rank)
            size = _ranked_modulus(
                _complex_multipliers(_multipliers_at(segment, found.point)), rank
            )  # else the pair became real outside the circle
            if found.located and abs(size - 1.0) < DOUBLE_MULTIPLIER_DISTANCE:
                located.append(self._refine(segment, found))
        return located or self._locate_pair_becoming_real(segment, ends)

    def _locate_pair_becoming_real(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Locate a pair that passes the circle and becomes a positive real pair, on the same segment as a doubling."""
        few, many = sorted(_count_unstable(_without_negative_real(ends)).tolist())
        if many - few < 2 or segment.a.parameter_direction * segment.b.parameter_direction < 0:
            return []
        found = locate_root(
            segment,
            self,
            lambda point: _ranked_modulus(_without_negative_real(_multipliers_at(segment, point)), few) - 1.0,
            fine=PAIR_LOCATION_TOLERANCE,
        )
        passing = _ranked_modulus(_complex_multipliers(_multipliers_at(segment, found.point)), few)
        return (
            [self._refine(segment, found)] if found.located and abs(passing - 1.0) < DOUBLE_MULTIPLIER_DISTANCE else []
        )

    def _locate_crossing(self, segment: Segment, rank: int) -> LocatedEvent:
        """Locate where the complex multiplier of this rank, from the largest, passes the unit circle."""
        return locate_root(
            segment,
            self,
            lambda point: _ranked_modulus(_complex_multipliers(_multipliers_at(segment, point)), rank) - 1.0,
            fine=PAIR_LOCATION_TOLERANCE,
        )

    def _refine(self, segment: Segment, found: LocatedEvent) -> LocatedEvent:
        """Refine the point by the equations of the pair that was located, not of another one near the unit circle."""
        problem: Any = segment.problem
        if not problem.smooth:
            return found
        Omega = {**segment.parameters, segment.name: found.point.value}["Omega"]
        mu = _multipliers_at(segment, found.point)
        near = exponent_of_pair(mu, problem.nu, Omega)
        if near is None:
            return found
        event = NeimarkSackerEvent(near)
        equations = event.equations(problem, segment.name, found)
        if equations is None:
            return found
        rough = replace(found, event=event)
        refined = _refine_root(segment, rough, equations)
        return rough if _left_segment(segment, mu, refined) else refined

    def _locate_simultaneous(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Locate two multipliers that pass the unit circle together: a complex pair, or a double real one by symmetry.

        The event is NS, or with real multipliers BP at +1 and PD at -1, whose determinants do not change sign there.
        Nothing is returned where two different real multipliers pass +1 one after the other: they belong to folds or
        branch points that truncation has displaced.
        """
        outside, most = _unstable_complex_counts(ends)
        found = [self._locate_crossing(segment, rank) for rank in range(outside, max(most, outside + 1), 2)]
        if any(one.located for one in found):
            return [self._refine(segment, one) for one in found if one.located]
        few = int(_count_unstable(ends).min())
        sizes = sorted(_ranked_modulus(mu, few) for mu in ends)
        level = 1.0 if sizes[0] < 1.0 < sizes[1] else 1.0 + STABILITY_TOLERANCE
        real = locate_root(
            segment,
            self,
            lambda point: _ranked_modulus(_multipliers_at(segment, point), few) - level,
            "two multipliers at once",
        )
        mu = _multipliers_at(segment, real.point)
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
        few, many = sorted(count_beyond(ends, STABILITY_TOLERANCE)[:, 1].tolist())
        located = []

        def size(point: CurvePoint, rank: int) -> float:
            return _ranked_modulus(_negative_real(_multipliers_at(segment, point)), rank) - 1.0

        for rank in range(few, many):
            note = f"multiplier {rank - few + 1} of {many - few} that pass -1 here"
            found = locate_root(segment, self, partial(size, rank=rank), note)
            if found.located and abs(size(found.point, rank)) < DOUBLE_MULTIPLIER_DISTANCE:
                located.append(replace(found, event=PeriodDoublingEvent(), finder=self))
        return located

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """Return the equations; None where slopes of laws are unknown, and for structures too large for their modes."""
        if not problem.smooth:
            return None
        compiled = problem.compiled({})
        known = has_sampled_slopes(compiled) and not compiled.structure.large
        return NeimarkSackerProblem(problem, parameter, self.near) if known else None


def _left_segment(segment: Segment, mu: ComplexArray, refined: LocatedEvent) -> bool:
    """Return whether Newton's method went beyond an end, where the pair is nearer to the circle than at that end.

    mu : multipliers at the initial point; the pair is the one nearest to the circle.
    """
    if 0 <= refined.s <= 1:
        return False
    pair = mu[np.abs(np.abs(mu) - 1).argmin()]

    def circle_distance(point: CurvePoint) -> float:
        multipliers = _multipliers_at(segment, point)
        return abs(float(np.abs(multipliers[np.abs(multipliers - pair).argmin()])) - 1)

    return circle_distance(refined.point) < circle_distance(segment.a if refined.s < 0 else segment.b)


PAIR_LOCATION_TOLERANCE = 1e-10
"""Fraction of the segment to which a pair is located; its modulus is not known more accurately because of rounding."""


MAX_TRUNCATION_SHIFT = 5e-3
"""Scaled arc length by which the multipliers of a truncated motion may pass -1 before or after the true doubling."""


DOUBLE_MULTIPLIER_DISTANCE = 1e-6
"""Distance up to which two multipliers on the unit circle are equal."""


MAX_CONTACT_EXTRAPOLATION = 4.0
"""Lengths of the last segment within which a contact beyond it is searched."""


class GrazingEvent(Event):
    """Grazing contact: an extremum of an element passes a breakpoint of its law.

    Elements that graze at the same value of the parameter are one point.
    """

    kind, meaning, marker = "GR", "grazing contact: the impact regime changes", "x"

    def __init__(self) -> None:
        pass

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Return the clearances at points where they are known."""
        clearance = _monitored_values(points, "clearance")
        return np.zeros((len(points), 0)) if clearance is None else clearance

    def find(self, segment: Segment) -> list[LocatedEvent]:
        clearances = _monitored_values((segment.a, segment.b), "clearance")
        if clearances is None:
            return []
        before, after = clearances
        located: list[LocatedEvent] = []
        for i in np.flatnonzero(before * after < 0):
            event = self._locate(segment, int(i), float(before[i]), float(after[i]))
            simultaneous = next((j for j, other in enumerate(located) if abs(other.s - event.s) < 1e-6), None)
            if simultaneous is None:
                located.append(event)
            else:
                located[simultaneous] = replace(
                    located[simultaneous], note=f"{located[simultaneous].note}, {event.note}"
                )
        return located

    def _locate(self, segment: Segment, which: int, before: float, after: float) -> LocatedEvent:
        """Locate the point by Newton's method on {R, extremum at the breakpoint}, or as a bracketed root."""
        problem: Any = segment.problem
        note = problem.clearance_names[which]

        def test(point: CurvePoint) -> float:
            known = point.observed.get("clearance")
            if known is None:
                known = problem.clearance(point.X, **{**segment.parameters, segment.name: point.value})
            return float(known[which])

        try:
            extended = GrazingProblem(problem, segment.name, which)
            return locate_by_newton(segment, self, extended, before / (before - after), note)
        except (NoConvergence, np.linalg.LinAlgError):
            return locate_root(segment, self, test, note)

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """Return the contact that the clearances at both ends approach, by Newton's method from the end."""
        clearances = _monitored_values((segment.a, segment.b), "clearance")
        if clearances is None:
            return None
        before, after = clearances
        with np.errstate(divide="ignore", invalid="ignore"):
            distances = np.where(before * after > 0, after / (before - after), np.inf)
        distances[~(distances > 0)] = np.inf
        which = int(np.argmin(distances)) if distances.size else 0
        if not distances.size or distances[which] > MAX_CONTACT_EXTRAPOLATION:
            return None
        problem: Any = segment.problem
        extended = GrazingProblem(problem, segment.name, which)
        try:
            u = extended.located(segment.b.u, {**segment.parameters, segment.name: segment.b.value}).X
        except (NoConvergence, np.linalg.LinAlgError):
            return None
        s = segment.fraction_of(u)
        is_far = np.linalg.norm((u - segment.b.u) / segment.scale) > 2 * MAX_CONTACT_EXTRAPOLATION * segment.length
        point = replace(singular(segment, u, segment.b), parameter_direction=segment.b.parameter_direction)
        return None if is_far or s <= 1 else LocatedEvent(self, s, point, True, problem.clearance_names[which])

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        names = list(problem.clearance_names)
        return GrazingProblem(problem, parameter, names.index(point.note.split(", ")[0]))


class PeriodDoublingMergeEvent(Event):
    """End of a subharmonic branch: its subharmonic part passes zero, and it joins the branch of shorter period."""

    kind, meaning, marker, terminal, alone = "EP", "end: the branch joins the one it came from", "+", True, True

    def __init__(self) -> None:
        pass

    def find(self, segment: Segment) -> list[LocatedEvent]:
        part = segment.problem.subharmonic_part  # type: ignore[attr-defined]
        first, second = part(segment.a.X), part(segment.b.X)
        threshold = 1e-7 * float(np.linalg.norm(segment.a.X))  # smaller parts are rounding of motions of shorter period
        if min(np.linalg.norm(first), np.linalg.norm(second)) <= threshold or float(first @ second) >= 0:
            return []
        root = locate_root(segment, self, lambda point: float(first @ part(point.X)))
        try:
            return [replace(root, point=_at_doubling(segment, root.point))]
        except (NoConvergence, np.linalg.LinAlgError):
            return [root]

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return None

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
    values = {**segment.parameters, segment.name: point.value}
    extended = extended.with_borders_at(np.append(shorter, point.value), values)
    solution = refine(extended, solve(extended, np.append(shorter, point.value), values), values)
    value = float(solution.X[-1])
    if abs(value - point.value) > 0.1 * segment.length * segment.scale[-1]:  # both ends may lie at the same value
        return point
    X = problem.resized(extended.embed(solution.X[:-1]))
    return singular(segment, np.append(X, value), point)


class AmplitudePeakEvent(Event):
    """Peak of an amplitude, located by `hbgear.analysis.peaks` on a finished curve, not while it is traced."""

    kind, meaning, marker = "PK", "peak of an amplitude", "^"

    def __init__(self, measure: str = "rms", element: int = 0) -> None:
        self.measure, self.element = measure, element

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        return np.zeros(len(points) - 1, dtype=bool)

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the point of the largest amplitude on a segment."""

        def negative_amplitude(s: float) -> float:
            return -float(self._amplitude(segment, segment.at(s).X))

        def search(xatol: float) -> float:
            best = scipy.optimize.minimize_scalar(
                negative_amplitude, bounds=(0.0, 1.0), method="bounded", options={"xatol": xatol}
            )
            return float(best.x)

        sharp = self._refine(segment, self._interpolated_maximum(segment)) or self._refine(
            segment, search(INITIAL_PEAK_TOLERANCE)
        )
        return [
            LocatedEvent(self, 0.5, sharp or segment.at(search(FINAL_PEAK_TOLERANCE)), True, f"peak of {self.measure}")
        ]

    def _amplitude(self, segment: Segment, X: Array) -> Array:
        layout = segment.problem.layout
        assert isinstance(layout, Layout)
        return layout.measure(self.measure, X, self.element)

    def _interpolated_maximum(self, segment: Segment) -> float:
        """Return the fraction of a segment at which the interpolated amplitude is largest, by a parabola."""
        s = np.linspace(0.0, 1.0, AMPLITUDE_SAMPLES)
        A = self._amplitude(segment, segment.guess(s[:, None])[:, :-1])
        i = min(max(int(np.argmax(A)), 1), AMPLITUDE_SAMPLES - 2)
        before, here, after = A[i - 1 : i + 2].tolist()
        bend = before - 2 * here + after
        return float(s[i] + (0.5 * (before - after) / bend * s[1] if bend < 0 else 0.0))

    def _refine(self, segment: Segment, s: float) -> CurvePoint | None:
        """Return the peak by Newton's method from a fraction of the segment, if it stays on the segment."""
        peak, u = peak_of(segment.problem, segment.name, self.measure, self.element), segment.guess(s)
        try:
            solution = on_curve(solve(peak, u, {**segment.parameters, segment.name: float(u[-1])}))
        except NoConvergence:
            return None
        if norm((np.append(solution.X, solution.value) - u) / segment.scale) > 0.1 * segment.length:
            return None
        return point_from_solution(solution, normal_of(segment.b.u - segment.a.u, segment.scale), segment.scale)

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """Return the equations; see `AmplitudeExtremum`."""
        return peak_of(problem, parameter, self.measure, self.element)


AMPLITUDE_SAMPLES = 17
"""Number of points of a segment at which its interpolated amplitude is evaluated."""


INITIAL_PEAK_TOLERANCE, FINAL_PEAK_TOLERANCE = 1e-2, 1e-7
"""Fractions of a segment to which a peak is minimised: before Newton's method, and instead of it."""


class TracedPeakEvent(AmplitudePeakEvent):
    """Peak of the rms amplitude of an element, located while a curve is traced: opt-in event "PK".

    X^T S t = 0, from + to -,   t the tangent of the curve, S the weights of the alternating part
    """

    def values(
        self, points: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Return the derivative of half the squared amplitude along the curve at points, shape (points, 1)."""
        return np.array([[self._slope(problem, point)] for point in points])

    def sign_changes(self, points: Sequence[CurvePoint], values: Array) -> np.ndarray:
        """Return where the amplitude has a maximum: the derivative changes from positive to negative."""
        return np.asarray((values[:-1, 0] > 0) & (values[1:, 0] < 0))

    def close(self, points: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Return no segments: a maximum and a minimum on one segment are not searched."""
        return []

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Locate the maximum by Newton's method, or as a bracketed root of the derivative."""
        before, after = self._slope(segment.problem, segment.a), self._slope(segment.problem, segment.b)
        if not before > 0 > after:
            return []
        note = f"peak of {self.measure}"
        try:
            equations = peak_of(segment.problem, segment.name, self.measure, self.element)
            return [locate_by_newton(segment, self, equations, before / (before - after), note)]
        except (NoConvergence, np.linalg.LinAlgError):
            return [locate_root(segment, self, lambda point: self._slope(segment.problem, point), note)]

    def _slope(self, problem: Any, point: CurvePoint) -> float:
        """Return the derivative of half the squared rms amplitude along the curve."""
        motion, change = (problem.rows(problem.resized(x))[self.element, 1:] for x in (point.X, point.tangent[:-1]))
        return float(motion @ change) / 2


def motion_events(nu: int, sliders: bool) -> tuple[Event, ...]:
    """Return the events of periodic motions of subharmonic order nu, in addition to folds and branch points."""
    ends = (PeriodDoublingMergeEvent(),) if nu > 1 else ()
    slips = (SlipEvent(),) if sliders else ()
    return PeriodDoublingEvent(), NeimarkSackerEvent(), GrazingEvent(), *slips, *ends


def _has_peaks(problem: ContinuationProblem, parameter: str) -> bool:
    """Return whether amplitude peaks can be located on curves of a problem: response curves of periodic motions."""
    return isinstance(problem.layout, Layout) and not problem.unknown_parameters


EVENTS.update(
    (event.kind, RegisteredEvent(event.kind, event, event.meaning, True, __name__))
    for event in (
        FoldEvent,
        PeriodDoublingEvent,
        NeimarkSackerEvent,
        BranchPointEvent,
        GrazingEvent,
        SlipEvent,
        CuspEvent,
        IsolaCentreEvent,
        FirstResonanceEvent,
        SecondResonanceEvent,
        ThirdResonanceEvent,
        FourthResonanceEvent,
        FlipOnFoldEvent,
        GeneralisedDoublingEvent,
        PeriodDoublingMergeEvent,
    )
)
EVENTS["PK"] = RegisteredEvent("PK", TracedPeakEvent, TracedPeakEvent.meaning, False, __name__, _has_peaks)

KINDS: dict[str, Event] = {name: entry.create() for name, entry in EVENTS.items() if entry.origin == __name__}
"""All built-in kinds of special points, in the order of legends."""


def named(point: SpecialPoint) -> SpecialPoint:
    """Return the point with its meaning and marker, which old files do not contain."""
    if point.meaning and point.marker:
        return point
    known = KINDS.get(point.kind)
    meaning, marker = (known.meaning, known.marker) if known else (point.kind, Event.marker)
    return replace(point, meaning=point.meaning or meaning, marker=point.marker or marker)


# ---- multipliers


def _multipliers(points: Sequence[CurvePoint]) -> ComplexArray | None:
    """Return multipliers (points, r), if any are known."""
    mu: ComplexArray | None = _monitored_values(points, "multipliers")
    return mu


def _monitored_values(points: Sequence[CurvePoint], name: str) -> Any:
    """Return a monitored quantity of all points, nan where it is unknown.

    The result is None if the quantity is unknown at all points, or its length differs between points.
    """
    return column(points, name, lambda: _stacked_values(points, name))


def _stacked_values(points: Sequence[CurvePoint], name: str) -> Any:
    """Return a monitored quantity of all points as an array; see `_monitored_values`."""
    values = [point.observed.get(name) for point in points]
    example = next((value for value in values if value is not None), None)
    if example is None:
        return None
    try:
        return np.array([np.full_like(example, np.nan) if value is None else value for value in values])
    except ValueError:  # a closed gap has no breakpoints
        return None


def _multipliers_at(segment: Segment, point: CurvePoint) -> ComplexArray:
    """Return the multipliers of a point, computed if they are unknown."""
    known: ComplexArray | None = point.observed.get("multipliers")
    if known is not None:
        return known
    values = {**segment.parameters, segment.name: point.value}
    problem: Any = segment.problem  # a HarmonicBalance, whose events these are
    computed: ComplexArray = problem.multipliers(point.X, points=8, width=1.0, **values)
    return computed


def _count_unstable(mu: ComplexArray) -> np.ndarray:
    """Return the number of unstable multipliers of sets (P, r)."""
    number: np.ndarray = (np.abs(mu) > 1 + STABILITY_TOLERANCE).sum(axis=1)
    return number


def _doubling_determinant(mu: ComplexArray) -> Array:
    """Return det(Phi + 1), which changes sign at period doublings, of sets (P, r)."""
    scale = 1.0 / np.maximum(
        np.abs(mu) / MAX_DETERMINANT_MODULUS, 1.0
    )  # a factor, because the division of a complex nan (unknown) warns
    determinant: Array = ((mu + 1) * scale).prod(axis=1).real
    return determinant


MAX_DETERMINANT_MODULUS = 1e6
"""Modulus to which multipliers are limited in the determinant, so that products do not overflow."""


def _complex_multipliers(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers that are not real."""
    complex_pairs: ComplexArray = mu[_is_complex(mu)]
    return complex_pairs


def _is_complex(mu: ComplexArray) -> np.ndarray:
    """Return which multipliers are not real."""
    paired: np.ndarray = np.abs(mu.imag) > 1e-8 * np.abs(mu)
    return paired


def _negative_real(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers on the negative real axis, and zero in the place of others."""
    rest: ComplexArray = np.where(~_is_complex(mu) & (mu.real < 0), mu, 0.0)
    return rest


def _without_negative_real(mu: ComplexArray) -> ComplexArray:
    """Return the multipliers with zero in the place of those on the negative real axis."""
    rest: ComplexArray = np.where(_is_complex(mu) | (mu.real > 0), mu, 0.0)
    return rest


def _unstable_complex_counts(ends: ComplexArray) -> tuple[int, int]:
    """Return the smaller and the larger number of unstable complex multipliers at two ends."""
    few, many = sorted(_count_unstable(np.where(_is_complex(ends), ends, 0.0)).tolist())
    return few, many


def _ranked_modulus(mu: ComplexArray, k: int) -> float:
    """Return the modulus of a rank k from the largest; nan if there are fewer multipliers."""
    sizes = np.sort(np.abs(mu))[::-1]
    return float(sizes[k]) if k < len(sizes) else math.nan
