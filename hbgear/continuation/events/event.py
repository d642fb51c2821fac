"""Events: special points of a solution curve, what they mean, and how each is located.

An `Event` is one kind of special point. It says between which neighbouring points of a curve it happens, and locates it
there, by default as the bracketed root of a test function along the segment, where every point is corrected onto the
curve. Two events between the same two points leave no change of sign there: where a test function seems to touch zero
(`Event.close`), the curve is looked at more closely (`hidden`).

LP  fold: dR/dX singular, the curve turns in the parameter (`FoldEvent`); CP on a curve of folds.
    Newton on {R = 0, g = 0}, g the bordered determinant, or a bracketed root of the tangent.
BP  two curves cross: det [J R_lambda; t^T] changes sign (`BranchPointEvent`).
    Newton on {(1 - b b^T) R, g_1, g_2}, see `crossing`, from a bracketed root of the determinant.

A problem supplies the events of its kind (`ContinuationProblem.events`); users add their own::

    trace(problem, "Omega", span, events=[Event("limit", lambda point: point.amplitude("max") - 2.0)])

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.augmented.level import ScalarConditionProblem
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.builder import build_point
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, Points, Segment, point_from_solution
from hbgear.continuation.events.near_tangency import near_zeros
from hbgear.continuation.numerics.bracketed_root import find_root_bracketed
from hbgear.continuation.numerics.linear import norms
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, on_curve, solution_at


@dataclass(frozen=True)
class RefinedLocation:
    """A special point solved for with more unknowns than the curve it lies on: the problem that has them, and row."""

    problem: ContinuationProblem
    row: CurvePoint


@dataclass(frozen=True)
class LocatedEvent:
    """A special point found on a segment: event, place s on the chord, row, whether located, remark.

    0 <= s <= 1, but for points that more accurate equations put a little beyond the ends of the segment.

    error : of its value of the parameter, nan if unknown; of ``sharp``, if it is there. See `accuracy`.
    finder : the event that found it, if another than its own.
    """

    event: Event
    s: float
    row: CurvePoint
    located: bool
    note: str = ""
    error: float = math.nan
    sharp: RefinedLocation | None = None
    finder: Event | None = None

    @property
    def value(self) -> float:
        """The value of the parameter, as accurate as it is known."""
        return self.sharp.row.value if self.sharp else self.row.value


class Event:
    """A kind of special point: where a function of the point passes zero.

        test(point) = 0,   located on the curve to rounding, labelled kind1, kind2, ...

    Parameters
    ----------
    kind : letters, the stem of the labels.
    test : a continuous function of a `Point`, whose unknowns, parameters and observations it may use.
    meaning : what happens there, for tables and legends.
    marker : one letter or sign of matplotlib's markers, for figures.
    terminal : whether the trace ends at the first one.

    Raises
    ------
    ValueError
        If the kind is not made of letters, or is one of those that hbgear uses itself, or there is no such marker.
    TypeError
        If the test cannot be called.

    Examples
    --------
    >>> import hbgear as hb
    >>> limit = hb.Event("limit", lambda point: point.amplitude("max") - 1.3, "the largest deflection is 1.3")
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6), events=[limit])
    >>> [round(point.amplitude("max"), 9) for point in curve.special if point.kind == "limit"]
    [1.3, 1.3]
    """

    kind: str
    meaning: str
    marker: str = "v"
    terminal: bool = False
    needs_two_sides: bool = False
    """Whether rows on both sides of a point at which it happens tell what happens near, for itself it is on neither."""
    alone: bool = False
    """Whether nothing else is looked for on the segment that a terminal event ends."""

    @checked_arguments(test="a function of a point, such as lambda point: point.amplitude('max') - 2.0")
    def __init__(
        self, kind: str, test: Callable[[Point], float], meaning: str = "", marker: str = "v", terminal: bool = False
    ) -> None:
        if not isinstance(kind, str) or not re.fullmatch(r"[A-Za-z_]*[A-Za-z]", kind):
            raise ValueError(f"Event: kind = {kind!r} must be letters, such as 'limit'; labels add the number")
        if kind in RESERVED:
            taken = ", ".join(RESERVED)
            raise ValueError(f"Event: kind = {kind!r} is one that hbgear uses itself ({taken}); choose another")
        if not is_marker(marker):
            raise ValueError(f"Event: marker = {marker!r} must be one of {' '.join(MARKERS)}")
        self.kind, self._test, self.meaning = kind, test, meaning or kind
        self.marker, self.terminal = marker, terminal

    def __repr__(self) -> str:
        return f"<Event {self.kind}: {self.meaning}>"

    @property
    def test_function(self) -> Callable[[Point], float] | None:
        """Function of the user; None for a class that overrides `test` or locates in another way."""
        return getattr(self, "_test", None)

    def test(self, point: Point) -> float:
        """The function that passes zero."""
        value = float(self._test(point))
        if not math.isfinite(value):
            raise ValueError(f"the test of the event '{self.kind}' is {value} at {point}; it must be finite")
        return value

    def values(
        self, rows: Sequence[CurvePoint], problem: ContinuationProblem, name: str, fixed: dict[str, float]
    ) -> Array:
        """Test functions (rows, T) that change sign where the event happens; T may be 0."""
        return np.array([[self.test(build_point(problem, name, fixed, row))] for row in rows])

    def sign_changes(self, rows: Sequence[CurvePoint], values: Array) -> np.ndarray:
        """How often the event happens between each row and the next at least, (rows - 1,); ``values`` of `values`."""
        return np.asarray((values[1:] * values[:-1] < 0).any(axis=1))

    def close(self, rows: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Pieces between rows on which the event may happen twice without a change of sign at their ends.

        Each with the place s on it where that would be; ``values`` are those of `values`, scale that of u.
        """
        return near_zeros(values, lengths(rows, scale)) if values.shape[1] else []

    def find(self, segment: Segment) -> list[LocatedEvent]:
        """The events between the two rows of a segment, each located."""

        def test(row: CurvePoint) -> float:
            return self.test(build_point(segment.problem, segment.name, dict(segment.parameters), row))

        return [locate_root(segment, self, test)] if test(segment.a) * test(segment.b) < 0 else []

    def ahead(self, segment: Segment) -> LocatedEvent | None:
        """The special point a little beyond the end of the last segment of a curve that ends there; None by default.

        Equations that are not smooth at the point can keep every step from reaching it.
        """
        return None

    def deviation(self, multipliers: ComplexArray) -> float:
        """Distance of the multipliers of a point from the values that the event requires; 0 if it requires none."""
        return 0.0

    def equations(self, problem: Any, parameter: str, point: Any) -> MinimallyAugmentedProblem | None:
        """The event as a problem of its own, to be followed in a second parameter; None if it is no equation.

        Raises
        ------
        ValueError
            If the test uses more of a point than its unknowns, parameters and problem, such as its multipliers.
        """
        level = ScalarConditionProblem(problem, parameter, self.test)
        try:
            level.value(point.X, point.parameters)
        except Exception as error:
            raise ValueError(
                f"the event '{self.kind}' cannot be followed: its test must use no more of a point than its unknowns, "
                f"parameters and problem ({type(error).__name__}: {error})"
            ) from error
        return level

    def branch_direction(
        self, branch: Branch, point: SpecialPoint, side: int
    ) -> tuple[ContinuationProblem, BranchStart] | None:
        """The problem of another branch that leaves at the point, and where it begins; None if none does."""
        return None

    def ending(self, name: str, value: float) -> tuple[Status, str]:
        """Status and message of a trace that a terminal event ends."""
        return Status.EVENT, f"{self.meaning} at {name} = {value:.6g}"


MARKERS = ".,ov^<>12348spP*hH+xXdD|_"
"""Markers of matplotlib that are one character."""


def is_marker(text: str) -> bool:
    """Whether figures can draw it."""
    return isinstance(text, str) and len(text) == 1 and text in MARKERS


RESERVED = ("LP", "CP", "BP", "PD", "NS", "GR", "PK", "EP")
"""Kinds of hbgear itself, which users' events may not have."""


def column(rows: Sequence[CurvePoint], name: Any, make: Callable[[], Any]) -> Any:
    """What is made of rows; kept with them by that name if they do not change any more."""
    return rows.column(name, make) if isinstance(rows, Points) else make()


def unknowns(rows: Sequence[CurvePoint]) -> Array:
    """u (rows, n + 1) of rows."""
    u: Array = column(rows, "u", lambda: np.array([row.u for row in rows]))
    return u


def lengths(rows: Sequence[CurvePoint], scale: Array) -> Array:
    """Scaled lengths (rows - 1,) of the pieces between rows."""

    def make() -> Array:
        u = unknowns(rows)
        return norms((u[1:] - u[:-1]) / scale)

    out: Array = column(rows, ("lengths", scale.tobytes()), make)
    return out


# ---- locating

_AT_THE_END = 1e-6  # how far beyond the ends of its arc a point may come to lie: farther, it belongs to another arc


_NOISY = 1e-6  # distance from a root, as a share of the chord, within which values may be noise


def locate_root(
    segment: Segment, event: Event, test: Callable[[CurvePoint], float], note: str = "", fine: float = 1e-13,
    first: float = math.nan,
) -> LocatedEvent:  # fmt: skip
    """Bracketed root of a test function along the segment; where correction fails, the nearer end, not located.

    fine : share of the chord to which it is located; at a turning point an error there enters the parameter squared.
    first : where on the chord to look first, if something is known of it.
    """
    rows: dict[float, CurvePoint] = {0.0: segment.a, 1.0: segment.b}
    values: dict[float, float] = {}

    def value(s: float) -> float:
        if s not in values:
            rows[s] = rows[s] if s in rows else segment.at(s)
            values[s] = test(rows[s])
        return values[s]

    def beside(s: float) -> float:
        """The value, or zero where the equations are singular with a change of sign beside: the point itself."""
        try:
            return value(s)
        except (NoConvergence, np.linalg.LinAlgError):
            low, high = max(s - _BESIDE, 0.0), min(s + _BESIDE, 1.0)
            if value(low) * value(high) >= 0:
                raise
            share = value(low) / (value(low) - value(high))
            rows[s], values[s] = _between(segment, rows[low], rows[high], share), 0.0
            return 0.0

    try:
        place = find_root_bracketed(beside, 0.0, 1.0, fine, first)
        near = [x for x in values if abs(x - place) <= _NOISY]  # a function that grows along it is less at an end
        s = min(near, key=lambda x: abs(values[x]))  # near a singular point the last of them may be noise
        return LocatedEvent(event, s, rows[s], True, note)
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        f0, f1 = abs(test(segment.a)), abs(test(segment.b))
        s = 0.0 if f0 < f1 else 1.0
        return LocatedEvent(event, s, rows[s], False, note)


_BESIDE = 1e-5  # distance along the arc at which the two sides of a singular point are looked at


def _between(segment: Segment, a: CurvePoint, b: CurvePoint, share: float) -> CurvePoint:
    """CurvePoint between two close ones, where the equations themselves cannot be solved."""
    tangent = (1 - share) * a.tangent + share * b.tangent
    return singular(segment, (1 - share) * a.u + share * b.u, replace(a, tangent=tangent))


def singular(segment: Segment, u: Array, near: CurvePoint) -> CurvePoint:
    """Point at u, where the equations are singular, with tangent and orientation of one nearby."""
    point = solution_at(segment.problem, u, segment.name, segment.parameters)
    return CurvePoint(u, near.tangent, near.orientation, point.residual, point.iterations)


def locate_by_newton(
    segment: Segment,
    event: Event,
    extended: MinimallyAugmentedProblem,
    s: float,
    note: str = "",
    beyond: float = _AT_THE_END,
) -> LocatedEvent:
    """Newton on a special point as a problem of its own, from the fraction s of the segment.

    beyond : how far beyond the ends of the segment the point may lie, as a share of its chord: for equations that are
    more accurate than the test that led here.

    Raises
    ------
    NoConvergence
        If Newton fails or leaves the segment.
    """
    u = segment.guess(s)
    settings = _few(segment.settings)
    here = {**segment.parameters, segment.name: float(u[-1])}
    solution = extended.located(u, here, settings)
    U = solution.X
    chord = (segment.b.u - segment.a.u) / segment.scale
    place = float(chord @ ((U - segment.a.u) / segment.scale) / (chord @ chord))
    inside = -beyond <= place <= 1 + beyond
    if not inside or np.linalg.norm((U - u) / segment.scale) > (0.5 + beyond) * np.linalg.norm(chord):
        raise NoConvergence("Newton left the arc", U, segment.parameters, [])
    return LocatedEvent(
        event, place, point_from_solution(on_curve(solution), chord / segment.scale, segment.scale), True, note
    )


@lru_cache(maxsize=8)
def _few(settings: NewtonSettings) -> NewtonSettings:
    """The settings for a start that is nearly there."""
    return replace(settings, max_iterations=5)
