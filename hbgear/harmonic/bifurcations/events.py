"""Events of periodic motions: what changes their stability or their contact.

PD  a multiplier passes -1 (period doubling).
    Newton on {R = 0, g = 0} of the half-integer block, or a bracketed root of det(Phi + 1).
NS  a complex pair of multipliers passes the unit circle (Neimark-Sacker).
    Newton on {R = 0, g = 0}, g the real part of its exponent by Hill's determinant, from a bracketed root of its
    modulus.
    Where a symmetric system has its multipliers in pairs, two pass +1 (BP) or -1 (PD) at once and no determinant
    changes sign: bracketed root of their modulus.
GR  an extremum of an element grazes a corner of its law: the impact regime changes.
    Newton on {R = 0, extremum = corner}, or a bracketed root.
EP  a subharmonic branch ends on the one of shorter period.

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
import scipy  # its parts are imported when they are first used

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
from hbgear.continuation.events.fold import CuspEvent, FoldEvent
from hbgear.continuation.events.near_tangency import near_zeros
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence, on_curve, refine, solve
from hbgear.harmonic.bifurcations.extremum import peak_of
from hbgear.harmonic.bifurcations.grazing import GrazingProblem
from hbgear.harmonic.bifurcations.neimark_sacker import NeimarkSackerProblem, exponent_of_pair
from hbgear.harmonic.bifurcations.period_doubling import PeriodDoublingProblem
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.multipliers.multiplier_collisions import (
    collisions,
    exchanges,
    extrapolated_crossings,
    leaps,
    passes_minus_one_cleanly,
)
from hbgear.harmonic.multipliers.multiplier_error import count_beyond


class PeriodDoublingEvent(Event):
    """A multiplier passes -1: motions of twice the period branch off."""

    kind, meaning, marker = "PD", "period doubling", "D"

    def __init__(self) -> None:
        pass

    def values(
        self, rows: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """det(Phi + 1), as far as the multipliers are known."""
        mu = _multipliers(rows)
        return np.zeros((len(rows), 0)) if mu is None else _doubled(mu)[:, None]

    def close(self, rows: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Where det(Phi + 1) seems to touch zero, but for pairs that plainly pass -1 and do not meet there."""
        mu, found = _multipliers(rows), super().close(rows, values, scale)
        if mu is None or not found:
            return found
        plain = passes_minus_one_cleanly(mu, lengths(rows, scale), np.array([piece for piece, _ in found]))
        return [one for one, passed in zip(found, plain, strict=True) if not passed]

    def find(self, segment: Segment) -> list[LocatedEvent]:
        mu = _multipliers((segment.a, segment.b))
        if mu is None:
            return []
        before, after = _doubled(mu).tolist()
        return [self.locate(segment, before, after)] if before * after < 0 else []

    def locate(self, segment: Segment, before: float, after: float) -> LocatedEvent:
        """Newton on the half-integer block; bracketed root of det(Phi + 1) where forces are sampled.

        Newton from a root, if it does not converge from the chord: the block is superconvergent, the multipliers of the
        truncated motion pass -1 a little beside.
        """
        smooth = segment.problem.smooth
        extended = PeriodDoublingProblem(segment.problem, segment.name) if smooth else None
        if extended is not None:
            try:
                return locate_by_newton(segment, self, extended, before / (before - after))
            except (NoConvergence, np.linalg.LinAlgError):
                pass
        rough = locate_root(segment, self, lambda row: float(_doubled(_known(segment, row)[None])[0]))
        return rough if extended is None else _sharpened(segment, rough, extended)

    def deviation(self, multipliers: ComplexArray) -> float:
        """Distance of the nearest multiplier from -1."""
        return float(np.abs(multipliers + 1).min(initial=math.inf))

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return PeriodDoublingProblem(problem, parameter)

    def branch_direction(
        self, branch: Branch, point: SpecialPoint, side: int
    ) -> tuple[ContinuationProblem, BranchStart] | None:
        """Onto the motion of twice the period, along the null vector of the half-integer block."""
        doubling, there = PeriodDoublingProblem(branch.problem, branch.parameter), as_traced(branch, point)
        direction = np.append(side * doubling.null_vector(there.X, **there.parameters), 0.0)
        return doubling.doubled, BranchStart(doubling.embed(there.X), dict(there.parameters), direction)


def _sharpened(segment: Segment, rough: LocatedEvent, extended: MinimallyAugmentedProblem) -> LocatedEvent:
    """A root of a function of the multipliers by Newton on equations that are more accurate, if it stays nearby."""
    if not rough.located:
        return rough
    try:
        fine = locate_by_newton(segment, rough.event, extended, rough.s, beyond=_SHIFT / segment.length)
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        return rough
    return fine if norm((fine.row.u - rough.row.u) / segment.scale) <= _SHIFT else rough


class NeimarkSackerEvent(Event):
    """A complex pair of multipliers leaves the unit circle: a second frequency sets in.

    near : the exponent of the pair, of one that was found.
    """

    kind, meaning, marker = "NS", "Neimark-Sacker: a second frequency sets in", "s"
    needs_two_sides = True

    def __init__(self, near: complex | None = None) -> None:
        self.near = near

    def values(
        self, rows: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """log |mu| of the complex pairs next to the unit circle: the first within it, the first outside; else nan."""
        mu = _multipliers(rows)
        if mu is None:
            return np.zeros((len(rows), 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.where(_paired(mu), np.log(np.abs(mu)), np.nan)
        inside = np.where(size < -STABILITY_TOLERANCE, size, -np.inf).max(axis=1, initial=-np.inf)
        outside = np.where(size > STABILITY_TOLERANCE, size, np.inf).min(axis=1, initial=np.inf)
        both = np.column_stack([inside, outside])
        return np.where(np.isfinite(both), both, np.nan)

    def close(self, rows: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Where a pair comes close to the unit circle, alone or because two meet, or one leaves as another returns.

        And segments across which multipliers cannot be followed, on which anything may happen.
        """
        mu, length = _multipliers(rows), lengths(rows, scale)
        if mu is None:
            return []
        return [
            *near_zeros(values, length),
            *collisions(mu, length),
            *exchanges(mu),
            *extrapolated_crossings(mu, length),
            *leaps(mu),
        ]

    def sign_changes(self, rows: Sequence[CurvePoint], values: Array) -> np.ndarray:
        mu = _multipliers(rows)
        if mu is None:
            return np.zeros(len(rows) - 1, dtype=bool)
        unstable = _unstable(mu)
        pairs: np.ndarray = (np.abs(unstable[1:] - unstable[:-1]) + 1) // 2
        return pairs

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """Where more multipliers pass than folds, branch points and period doublings explain."""
        ends = _multipliers((segment.a, segment.b))
        if ends is None:
            return []
        (ua, ub), (da, db) = _unstable(ends).tolist(), _doubled(ends).tolist()
        real = segment.a.heading * segment.b.heading < 0 or segment.a.orientation != segment.b.orientation
        explained = int(real) + int(da * db < 0)
        if abs(ua - ub) - explained >= 2:
            return self._two_at_once(segment, ends)
        return self._beside(segment, ends) if explained or ua != ub else []  # ends may be special points

    def _beside(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """A pair that passes on the same piece as a fold, branch point or doubling, which makes up for it in number."""
        few, many = _pairs_outside(ends)
        out = []
        for rank in range(few, many, 2):
            found = self._passing(segment, rank)
            size = _modulus(_pairs(_known(segment, found.row)), rank)  # else the pair became real outside of the circle
            if found.located and abs(size - 1.0) < _DOUBLE:
                out.append(self._sharp(segment, found))
        return out or self._became_real(segment, ends)

    def _became_real(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """A pair that passes and meets on the positive real axis, on the same piece as a doubling."""
        few, many = sorted(_unstable(_undoubled(ends)).tolist())
        if many - few < 2 or segment.a.heading * segment.b.heading < 0:
            return []
        found = locate_root(
            segment, self, lambda row: _modulus(_undoubled(_known(segment, row)), few) - 1.0, fine=_FINE
        )
        passing = _modulus(_pairs(_known(segment, found.row)), few)
        return [self._sharp(segment, found)] if found.located and abs(passing - 1.0) < _DOUBLE else []

    def _passing(self, segment: Segment, rank: int) -> LocatedEvent:
        """Where the complex multiplier of that number, from the largest, passes the unit circle."""
        return locate_root(segment, self, lambda row: _modulus(_pairs(_known(segment, row)), rank) - 1.0, fine=_FINE)

    def _sharp(self, segment: Segment, found: LocatedEvent) -> LocatedEvent:
        """By the equations of the pair that was located, not of another one next to the unit circle."""
        problem: Any = segment.problem
        if not problem.smooth:
            return found
        Omega = {**segment.parameters, segment.name: found.row.value}["Omega"]
        mu = _known(segment, found.row)
        near = exponent_of_pair(mu, problem.nu, Omega)
        if near is None:
            return found
        own = NeimarkSackerEvent(near)
        equations = own.equations(problem, segment.name, found)
        if equations is None:
            return found
        rough = replace(found, event=own)
        fine = _sharpened(segment, rough, equations)
        return rough if _came_back(segment, mu, fine) else fine

    def _two_at_once(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """Where two multipliers pass the unit circle together: a complex pair, or a double real one by symmetry.

        NS, or with real multipliers BP at +1 and PD at -1: their determinants do not change sign there. Nothing where
        two different real ones pass +1 one after the other: they belong to folds or branch points from which they
        differ by the truncation error.
        """
        outside, most = _pairs_outside(ends)
        found = [self._passing(segment, rank) for rank in range(outside, max(most, outside + 1), 2)]
        if any(one.located for one in found):
            return [self._sharp(segment, one) for one in found if one.located]
        few = int(_unstable(ends).min())
        sizes = sorted(_modulus(mu, few) for mu in ends)
        level = 1.0 if sizes[0] < 1.0 < sizes[1] else 1.0 + STABILITY_TOLERANCE
        real = locate_root(
            segment, self, lambda row: _modulus(_known(segment, row), few) - level, "two multipliers at once"
        )
        mu = _known(segment, real.row)
        first, second = mu[np.argsort(np.abs(np.abs(mu) - level))[:2]]
        if not real.located or (abs(first.imag) > _DOUBLE and abs(first - second.conj()) < _DOUBLE):
            return [replace(real, note="")]
        if abs(first - second) >= _DOUBLE:
            return self._one_by_one(segment, ends)
        return [replace(real, event=BranchPointEvent() if first.real > 0 else PeriodDoublingEvent(), finder=self)]

    def deviation(self, multipliers: ComplexArray) -> float:
        """Distance of the nearest multiplier from the unit circle."""
        return float(np.abs(np.abs(multipliers) - 1).min(initial=math.inf))

    def _one_by_one(self, segment: Segment, ends: ComplexArray) -> list[LocatedEvent]:
        """The period doublings of several different real multipliers that pass -1 on one piece.

        Their number leaves the sign of det(Phi + 1) as it is. Each is the root of the modulus of that rank among the
        multipliers on the negative real axis.
        """
        few, many = sorted(count_beyond(ends, STABILITY_TOLERANCE)[:, 1].tolist())
        out = []

        def size(row: CurvePoint, rank: int) -> float:
            return _modulus(_negative(_known(segment, row)), rank) - 1.0

        for rank in range(few, many):
            note = f"multiplier {rank - few + 1} of {many - few} that pass -1 here"
            found = locate_root(segment, self, partial(size, rank=rank), note)
            if found.located and abs(size(found.row, rank)) < _DOUBLE:
                out.append(replace(found, event=PeriodDoublingEvent(), finder=self))
        return out

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """None for laws that must be asked for their slopes, and structures too large for their modes."""
        if not problem.smooth:
            return None
        compiled = problem.compiled({})
        known = not compiled.asked and not compiled.structure.large
        return NeimarkSackerProblem(problem, parameter, self.near) if known else None


def _came_back(segment: Segment, mu: ComplexArray, fine: LocatedEvent) -> bool:
    """Whether Newton went to another point: beyond an end, where the pair is nearer to the circle than at that end.

    mu : multipliers of the point it began at, of which the pair on the circle is the one.
    """
    if 0 <= fine.s <= 1:
        return False
    pair = mu[np.abs(np.abs(mu) - 1).argmin()]

    def off(row: CurvePoint) -> float:
        found = _known(segment, row)
        return abs(float(np.abs(found[np.abs(found - pair).argmin()])) - 1)

    return off(fine.row) < off(segment.a if fine.s < 0 else segment.b)


_FINE = 1e-10  # share of the chord to which a pair is located: beyond it lies the rounding of its modulus


_SHIFT = 5e-3  # scaled length by which the multipliers of a truncated motion may pass -1 beside the true doubling


_DOUBLE = 1e-6  # distance at which two multipliers on the unit circle are one


_AHEAD = 4.0  # lengths of the last segment within which a contact may lie beyond it


class GrazingEvent(Event):
    """An extremum of an element passes a corner of its law; elements that graze together are one point."""

    kind, meaning, marker = "GR", "grazing contact: the impact regime changes", "x"

    def __init__(self) -> None:
        pass

    def values(
        self, rows: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """The clearances, as far as they are known."""
        clearance = _of_rows(rows, "clearance")
        return np.zeros((len(rows), 0)) if clearance is None else clearance

    def find(self, segment: Segment) -> list[LocatedEvent]:
        both = _of_rows((segment.a, segment.b), "clearance")
        if both is None:
            return []
        before, after = both
        out: list[LocatedEvent] = []
        for i in np.flatnonzero(before * after < 0):
            point = self._locate(segment, int(i), float(before[i]), float(after[i]))
            twin = next((j for j, other in enumerate(out) if abs(other.s - point.s) < 1e-6), None)
            if twin is None:
                out.append(point)
            else:
                out[twin] = replace(out[twin], note=f"{out[twin].note}, {point.note}")
        return out

    def _locate(self, segment: Segment, which: int, before: float, after: float) -> LocatedEvent:
        """Newton on {R, extremum at the corner}; else a bracketed root of the clearance."""
        problem: Any = segment.problem
        note = problem.clearance_names[which]

        def test(row: CurvePoint) -> float:
            known = row.observed.get("clearance")
            if known is None:
                known = problem.clearance(row.X, **{**segment.parameters, segment.name: row.value})
            return float(known[which])

        try:
            extended = GrazingProblem(problem, segment.name, which)
            return locate_by_newton(segment, self, extended, before / (before - after), note)
        except (NoConvergence, np.linalg.LinAlgError):
            return locate_root(segment, self, test, note)

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """The contact that the clearances at both ends approach, by Newton from the end of the segment."""
        both = _of_rows((segment.a, segment.b), "clearance")
        if both is None:
            return None
        before, after = both
        with np.errstate(divide="ignore", invalid="ignore"):
            lengths = np.where(before * after > 0, after / (before - after), np.inf)
        lengths[~(lengths > 0)] = np.inf
        which = int(np.argmin(lengths)) if lengths.size else 0
        if not lengths.size or lengths[which] > _AHEAD:
            return None
        problem: Any = segment.problem
        extended = GrazingProblem(problem, segment.name, which)
        try:
            u = extended.located(segment.b.u, {**segment.parameters, segment.name: segment.b.value}).X
        except (NoConvergence, np.linalg.LinAlgError):
            return None
        s = segment.place(u)
        far = np.linalg.norm((u - segment.b.u) / segment.scale) > 2 * _AHEAD * segment.length
        row = replace(singular(segment, u, segment.b), heading=segment.b.heading)
        return None if far or s <= 1 else LocatedEvent(self, s, row, True, problem.clearance_names[which])

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        names = list(problem.clearance_names)
        return GrazingProblem(problem, parameter, names.index(point.note.split(", ")[0]))


class PeriodDoublingMergeEvent(Event):
    """A subharmonic branch meets the one of shorter period: its subharmonic part passes zero and changes sign."""

    kind, meaning, marker, terminal, alone = "EP", "end: the branch joins the one it came from", "+", True, True

    def __init__(self) -> None:
        pass

    def find(self, segment: Segment) -> list[LocatedEvent]:
        part = segment.problem.subharmonic_part  # type: ignore[attr-defined]
        first, second = part(segment.a.X), part(segment.b.X)
        least = 1e-7 * float(np.linalg.norm(segment.a.X))  # below it is rounding: motions of shorter period
        if min(np.linalg.norm(first), np.linalg.norm(second)) <= least or float(first @ second) >= 0:
            return []
        rough = locate_root(segment, self, lambda row: float(first @ part(row.X)))
        try:
            return [replace(rough, row=_at_doubling(segment, rough.row))]
        except (NoConvergence, np.linalg.LinAlgError):
            return [rough]

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        return None

    def ending(self, name: str, value: float) -> tuple[Status, str]:
        return Status.MERGED, f"the branch joined the one it came from at {name} = {value:.6g}"


def _at_doubling(segment: Segment, row: CurvePoint) -> CurvePoint:
    """The row moved to the period doubling of the shorter motion where the branch ends.

    With subharmonics of size a the equations hold the parameter to the tolerance over a, that is not at all.
    """
    problem: Any = segment.problem
    if problem.nu % 2 or not problem.smooth:
        return row
    extended = PeriodDoublingProblem(problem.with_order(problem.nu // 2), segment.name)
    shorter = extended.doubled.resized(row.X)[extended.even]
    here = {**segment.parameters, segment.name: row.value}
    extended = extended.with_borders_at(np.append(shorter, row.value), here)
    solution = refine(extended, solve(extended, np.append(shorter, row.value), here), here)
    value = float(solution.X[-1])
    if abs(value - row.value) > 0.1 * segment.length * segment.scale[-1]:  # both ends may lie at the same value
        return row
    X = problem.resized(extended.embed(solution.X[:-1]))
    return singular(segment, np.append(X, value), row)


class AmplitudePeakEvent(Event):
    """An amplitude is largest: looked for by `hbgear.peaks` on a finished curve, not while it is traced."""

    kind, meaning, marker = "PK", "peak of an amplitude", "^"

    def __init__(self, measure: str = "rms", element: int = 0) -> None:
        self.measure, self.element = measure, element

    def sign_changes(self, rows: Sequence[CurvePoint], values: Array) -> np.ndarray:
        return np.zeros(len(rows) - 1, dtype=bool)

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """The row of the largest amplitude on a piece of the curve."""

        def low(s: float) -> float:
            return -float(self._amplitude(segment, segment.at(s).X))

        def search(xatol: float) -> float:
            best = scipy.optimize.minimize_scalar(low, bounds=(0.0, 1.0), method="bounded", options={"xatol": xatol})
            return float(best.x)

        sharp = self._sharp(segment, self._place(segment)) or self._sharp(segment, search(_ROUGH))
        return [LocatedEvent(self, 0.5, sharp or segment.at(search(_SEARCHED)), True, f"peak of {self.measure}")]

    def _amplitude(self, segment: Segment, X: Array) -> Array:
        layout = segment.problem.layout
        assert isinstance(layout, Layout)
        return layout.measure(self.measure, X, self.element)

    def _place(self, segment: Segment) -> float:
        """Where on a piece the amplitude of its interpolation is largest, by the parabola through three places."""
        s = np.linspace(0.0, 1.0, _PLACES)
        A = self._amplitude(segment, segment.guess(s[:, None])[:, :-1])
        i = min(max(int(np.argmax(A)), 1), _PLACES - 2)
        before, here, after = A[i - 1 : i + 2].tolist()
        bend = before - 2 * here + after
        return float(s[i] + (0.5 * (before - after) / bend * s[1] if bend < 0 else 0.0))

    def _sharp(self, segment: Segment, s: float) -> CurvePoint | None:
        """All digits of a peak by Newton from a place on the piece, if it stays there."""
        peak, u = peak_of(segment.problem, segment.name, self.measure, self.element), segment.guess(s)
        try:
            solution = on_curve(solve(peak, u, {**segment.parameters, segment.name: float(u[-1])}))
        except NoConvergence:
            return None
        if norm((np.append(solution.X, solution.value) - u) / segment.scale) > 0.1 * segment.length:
            return None
        return point_from_solution(solution, normal_of(segment.b.u - segment.a.u, segment.scale), segment.scale)

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """See `AmplitudeExtremum`."""
        return peak_of(problem, parameter, self.measure, self.element)


_PLACES = 17  # on a piece at which the amplitude of its interpolation is looked at


_ROUGH, _SEARCHED = 1e-2, 1e-7  # shares of a piece to which a peak is searched for: before Newton, and instead of it


def motion_events(nu: int) -> tuple[Event, ...]:
    """What is looked for along a curve of periodic motions of subharmonic order nu, besides folds and branch points."""
    ends = (PeriodDoublingMergeEvent(),) if nu > 1 else ()
    return PeriodDoublingEvent(), NeimarkSackerEvent(), GrazingEvent(), *ends


KINDS: dict[str, Event] = {
    event.kind: event
    for event in (
        FoldEvent(),
        PeriodDoublingEvent(),
        NeimarkSackerEvent(),
        BranchPointEvent(),
        GrazingEvent(),
        CuspEvent(),
        PeriodDoublingMergeEvent(),
        AmplitudePeakEvent(),
    )
}
"""Every kind of special point that hbgear knows itself, in the order of legends."""


def named(point: SpecialPoint) -> SpecialPoint:
    """The point with what it means and its marker, if it is of an old file that did not tell."""
    if point.meaning and point.marker:
        return point
    known = KINDS.get(point.kind)
    meaning, marker = (known.meaning, known.marker) if known else (point.kind, Event.marker)
    return replace(point, meaning=point.meaning or meaning, marker=point.marker or marker)


# ---- multipliers


def _multipliers(rows: Sequence[CurvePoint]) -> ComplexArray | None:
    """Multipliers (rows, r), if any are known."""
    mu: ComplexArray | None = _of_rows(rows, "multipliers")
    return mu


def _of_rows(rows: Sequence[CurvePoint], name: str) -> Any:
    """What was observed of all rows, nan of those that could not be; None without any, or where numbers differ."""
    return column(rows, name, lambda: _observed(rows, name))


def _observed(rows: Sequence[CurvePoint], name: str) -> Any:
    values = [row.observed.get(name) for row in rows]
    some = next((x for x in values if x is not None), None)
    if some is None:
        return None
    try:
        return np.array([np.full_like(some, np.nan) if x is None else x for x in values])
    except ValueError:  # a closed gap has no corners
        return None


def _known(segment: Segment, row: CurvePoint) -> ComplexArray:
    """Multipliers of a row, computed if they are not known."""
    known: ComplexArray | None = row.observed.get("multipliers")
    if known is not None:
        return known
    here = {**segment.parameters, segment.name: row.value}
    problem: Any = segment.problem  # a HarmonicBalance: these are its events
    fine: ComplexArray = problem.multipliers(row.X, points=8, width=1.0, **here)
    return fine


def _unstable(mu: ComplexArray) -> np.ndarray:
    """Numbers of unstable multipliers of sets (P, r)."""
    number: np.ndarray = (np.abs(mu) > 1 + STABILITY_TOLERANCE).sum(axis=1)
    return number


def _doubled(mu: ComplexArray) -> Array:
    """det(Phi + 1), whose sign changes at period doublings, of sets (P, r)."""
    scale = 1.0 / np.maximum(np.abs(mu) / _VAST, 1.0)  # as a factor: to divide a complex nan (not observed) warns
    determinant: Array = ((mu + 1) * scale).prod(axis=1).real
    return determinant


_VAST = 1e6  # modulus of a multiplier above which its size does not count, so that products do not overflow


def _pairs(mu: ComplexArray) -> ComplexArray:
    """The multipliers that are not real."""
    complex_pairs: ComplexArray = mu[_paired(mu)]
    return complex_pairs


def _paired(mu: ComplexArray) -> np.ndarray:
    """Which multipliers are not real."""
    paired: np.ndarray = np.abs(mu.imag) > 1e-8 * np.abs(mu)
    return paired


def _negative(mu: ComplexArray) -> ComplexArray:
    """Multipliers on the negative real axis; zero in the place of others."""
    rest: ComplexArray = np.where(~_paired(mu) & (mu.real < 0), mu, 0.0)
    return rest


def _undoubled(mu: ComplexArray) -> ComplexArray:
    """Multipliers without those on the negative real axis, which are zero."""
    rest: ComplexArray = np.where(_paired(mu) | (mu.real > 0), mu, 0.0)
    return rest


def _pairs_outside(ends: ComplexArray) -> tuple[int, int]:
    """The lesser and the larger number of unstable complex multipliers at two ends."""
    few, many = sorted(_unstable(np.where(_paired(ends), ends, 0.0)).tolist())
    return few, many


def _modulus(mu: ComplexArray, k: int) -> float:
    """The modulus number k, from the largest; nan if there are not so many."""
    sizes = np.sort(np.abs(mu))[::-1]
    return float(sizes[k]) if k < len(sizes) else math.nan
