"""Events: special points of a solution curve, what they mean, and how each is located.

An `Event` is one kind of special point. It says between which neighbouring points of a curve it happens, and locates it
there, by default as the bracketed root of a test function along the segment, where every point is corrected onto the
curve. Two events between the same two points leave no change of sign there: where a test function seems to touch zero
(`Event.close`), the curve is looked at more closely (`hidden`).

LP  fold: dR/dX singular, the curve turns in the parameter (`Turning`); CP on a curve of folds.
    Newton on {R = 0, g = 0}, g the bordered determinant, or a bracketed root of the tangent.
BP  two curves cross: det [J R_lambda; t^T] changes sign (`Crossing`).
    Newton on {(1 - b b^T) R, g_1, g_2}, see `crossing`, from a bracketed root of the determinant.

A problem supplies the events of its kind (`FullProblem.events`); users add their own::

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
import scipy  # its parts are imported when they are first used

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.algebra import as_dense, bordered, norms, slogdet
from hbgear.continuation.bordered import Augmented, Fold, Level
from hbgear.continuation.bracketing import bracketed_root
from hbgear.continuation.branch import Branch, Point, SpecialPoint, Status
from hbgear.continuation.crossing import BranchPoint
from hbgear.continuation.newton import NoConvergence, Settings, on_curve, solution_at
from hbgear.continuation.problem import FullProblem, as_problem, linearise
from hbgear.continuation.record import point_of
from hbgear.continuation.segment import CurvePoint, Departure, Rows, Segment, row_of
from hbgear.continuation.touching import SHALLOW, dips


@dataclass(frozen=True)
class Sharp:
    """A special point solved for with more unknowns than the curve it lies on: the problem that has them, and row."""

    problem: FullProblem
    row: CurvePoint


@dataclass(frozen=True)
class Found:
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
    sharp: Sharp | None = None
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
    flanked: bool = False
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

    def test(self, point: Point) -> float:
        """The function that passes zero."""
        value = float(self._test(point))
        if not math.isfinite(value):
            raise ValueError(f"the test of the event '{self.kind}' is {value} at {point}; it must be finite")
        return value

    def values(self, rows: Sequence[CurvePoint], problem: FullProblem, name: str, fixed: dict[str, float]) -> Array:
        """Test functions (rows, T) that change sign where the event happens; T may be 0."""
        return np.array([[self.test(point_of(problem, name, fixed, row))] for row in rows])

    def suspects(self, rows: Sequence[CurvePoint], values: Array) -> np.ndarray:
        """How often the event happens between each row and the next at least, (rows - 1,); ``values`` of `values`."""
        return np.asarray((values[1:] * values[:-1] < 0).any(axis=1))

    def close(self, rows: Sequence[CurvePoint], values: Array, scale: Array) -> list[tuple[int, float]]:
        """Pieces between rows on which the event may happen twice without a change of sign at their ends.

        Each with the place s on it where that would be; ``values`` are those of `values`, scale that of u.
        """
        return dips(values, lengths(rows, scale)) if values.shape[1] else []

    def find(self, segment: Segment) -> list[Found]:
        """The events between the two rows of a segment, each located."""

        def test(row: CurvePoint) -> float:
            return self.test(point_of(segment.problem, segment.name, dict(segment.parameters), row))

        return [root(segment, self, test)] if test(segment.a) * test(segment.b) < 0 else []

    def ahead(self, segment: Segment) -> Found | None:
        """The special point a little beyond the end of the last segment of a curve that ends there; None by default.

        Equations that are not smooth at the point can keep every step from reaching it.
        """
        return None

    def deviation(self, multipliers: ComplexArray) -> float:
        """Distance of the multipliers of a point from the values that the event requires; 0 if it requires none."""
        return 0.0

    def equations(self, problem: Any, parameter: str, point: Any) -> Augmented | None:
        """The event as a problem of its own, to be followed in a second parameter; None if it is no equation.

        Raises
        ------
        ValueError
            If the test uses more of a point than its unknowns and parameters, such as its multipliers.
        """
        level = Level(problem, parameter, self.test)
        try:
            level.value(point.X, point.parameters)
        except Exception as error:
            raise ValueError(
                f"the event '{self.kind}' cannot be followed: its test must use no more of a point than its unknowns "
                f"and parameters ({type(error).__name__}: {error})"
            ) from error
        return level

    def departure(self, branch: Branch, point: SpecialPoint, side: int) -> tuple[FullProblem, Departure] | None:
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


class Turning(Event):
    """The curve turns back in the parameter: a fold."""

    kind, meaning, marker = "LP", "fold: the curve turns back", "o"

    def __init__(self) -> None:
        pass

    def values(self, rows: Sequence[CurvePoint], problem: FullProblem, name: str, fixed: dict[str, float]) -> Array:
        return np.zeros((len(rows), 0))

    def suspects(self, rows: Sequence[CurvePoint], values: Array) -> np.ndarray:
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

    def find(self, segment: Segment) -> list[Found]:
        """Newton on {R, g} from where the tangent's component vanishes; bracketed where forces are sampled."""
        a, b = segment.a, segment.b
        if a.heading * b.heading >= 0:
            return []
        if a.tangent[-1] * b.tangent[-1] >= 0:  # the curve turned on a stretch on which the parameter stood still
            return [Found(self, 0.0, a, True)]
        if segment.problem.smooth:
            try:
                return [newton(segment, self, Fold(segment.problem, segment.name), turn_of(segment))]
            except (NoConvergence, np.linalg.LinAlgError):
                pass
        first = math.nan if segment.problem.cornered else turn_of(segment)  # at corners it turns anywhere
        return [root(segment, self, lambda row: float(row.tangent[-1]), fine=1e-9, first=first)]

    def equations(self, problem: Any, parameter: str, point: Any) -> Augmented | None:
        return Fold(problem, parameter)


class Cusp(Turning):
    """A curve of folds turns back in its parameter."""

    kind, meaning, marker = "CP", "cusp: two folds meet", "*"

    def equations(self, problem: Any, parameter: str, point: Any) -> Augmented | None:
        return None


class Crossing(Event):
    """Two curves cross: the determinant of [J R_lambda; t^T] changes sign."""

    kind, meaning, marker = "BP", "branch point: two curves cross", "P"

    def __init__(self) -> None:
        pass

    def values(self, rows: Sequence[CurvePoint], problem: FullProblem, name: str, fixed: dict[str, float]) -> Array:
        return np.zeros((len(rows), 0))

    def suspects(self, rows: Sequence[CurvePoint], values: Array) -> np.ndarray:
        orientation = np.array([row.orientation for row in rows])
        changed: Array = orientation[1:] != orientation[:-1]
        return changed

    def find(self, segment: Segment) -> list[Found]:
        if segment.a.orientation == segment.b.orientation:
            return []
        return [_crossed(segment, root(segment, self, _determinant(segment)))]

    def deviation(self, multipliers: ComplexArray) -> float:
        """Distance of the nearest multiplier from +1."""
        return float(np.abs(multipliers - 1).min(initial=math.inf))

    def equations(self, problem: Any, parameter: str, point: Any) -> Augmented | None:
        return BranchPoint(problem, parameter)

    def departure(self, branch: Branch, point: SpecialPoint, side: int) -> tuple[FullProblem, Departure] | None:
        """Across the traced curve, within the null space of [dR/dX, dR/dp]."""
        there = as_traced(branch, point)
        direction = side * _across(branch, there)
        return as_problem(branch.problem), Departure(there.X, dict(there.parameters), direction, event=self)


def as_traced(branch: Branch, point: SpecialPoint) -> SpecialPoint:
    """The point as the branch has it, if it was solved for with more unknowns."""
    if point.layout == branch.layout:
        return point
    return replace(point, X=branch.X[point.index], parameters=branch.parameters_at(point.index), layout=branch.layout)


def _across(branch: Branch, point: SpecialPoint) -> Array:
    """Direction in the null space of [dR/dX, dR/dp] at right angles to the traced curve, in scaled unknowns."""
    problem = as_problem(branch.problem)
    now = linearise(problem, point.X, branch.parameter, point.parameters)
    scale = np.append(np.full(len(point.X), problem.motion_size(point.X) or 1.0), np.ptp(branch.values) or 1.0)
    null = scipy.linalg.svd(np.column_stack([as_dense(now.dR_dX), now.dR_dp]) * scale)[2][-2:]
    i = point.index
    before, after = max(i - 1, 0), min(i + 1, len(branch) - 1)
    along = np.append(branch.X[after] - branch.X[before], branch.values[after] - branch.values[before]) / scale
    inside = null @ along
    inside = inside / np.linalg.norm(inside)
    out: Array = scale * (np.array([-inside[1], inside[0]]) @ null)
    return out


RESERVED = ("LP", "CP", "BP", "PD", "NS", "GR", "PK", "EP")
"""Kinds of hbgear itself, which users' events may not have."""


def event_of(branch: Branch, point: SpecialPoint) -> Event | None:
    """The event a special point of the branch is one of: that it was located by; of a loaded one the problem's."""
    return event_at(as_problem(branch.problem), branch.parameter, point)


def event_at(problem: FullProblem, parameter: str, point: SpecialPoint) -> Event | None:
    """`event_of` a point of a curve of the problem in the parameter."""
    known = [] if point.event is None else [point.event]
    own = events_of(problem, parameter)
    return next((event for event in (*known, *own) if event.kind == point.kind), None)


def events_of(problem: FullProblem, parameter: str) -> tuple[Event, ...]:
    """Everything that is looked for along a curve of a problem: turning points, branch points, events of its own."""
    turning = Cusp() if problem.turning_kind == Cusp.kind else Turning()
    return turning, Crossing(), *problem.events(parameter)


# ---- looking along a curve


class Watch:
    """The events that are looked for along a curve, and the rows between which they happen."""

    def __init__(self, events: Sequence[Event], problem: FullProblem, name: str, fixed: dict[str, float]) -> None:
        kinds = [event.kind for event in events]
        twice = {kind for kind in kinds if kinds.count(kind) > 1}
        if twice:
            raise ValueError(f"two events are called {', '.join(sorted(twice))}; give each kind a name of its own")
        self.terminal = tuple(event for event in events if event.terminal)
        self.passing = tuple(event for event in events if not event.terminal)
        self.problem, self.name, self.fixed = problem, name, fixed

    @property
    def searched(self) -> tuple[Event, ...]:
        """Events that are looked for where they show at no row; not folds of sampled corners.

        Their tangents jump, so that next to each fold the curve turns any number of times.
        """
        return tuple(e for e in self.passing if self.problem.smooth or not isinstance(e, Turning))

    def suspects(self, rows: Sequence[CurvePoint]) -> list[int]:
        """Numbers i of the pieces from rows[i] to rows[i + 1] on which `find` finds something."""
        some = np.zeros(len(rows) - 1, dtype=bool)
        for event in self.passing:
            some |= self.changes(event, rows) > 0
        suspects: list[int] = np.flatnonzero(some).tolist()
        return suspects

    def find(self, segment: Segment) -> list[Found]:
        """All special points between the two rows of a segment, in the order in which the curve meets them."""
        return sorted((found for event in self.passing for found in event.find(segment)), key=lambda found: found.s)

    def ahead(self, segment: Segment) -> Found | None:
        """The first special point a little beyond a segment, of the events that can tell."""
        found = [one for event in self.passing if (one := event.ahead(segment)) is not None]
        return min(found, key=lambda one: one.s, default=None)

    def ends(self, segment: Segment) -> Found | None:
        """The first terminal event on a segment."""
        found = [one for event in self.terminal for one in event.find(segment)]
        return min(found, key=lambda one: one.s, default=None)

    def touching(self, rows: Sequence[CurvePoint], scale: Array) -> dict[int, list[tuple[Event, float]]]:
        """Pieces between rows on which an event may happen twice; which event, and the place s on each."""
        found: dict[int, list[tuple[Event, float]]] = {}
        for event in self.searched:
            for piece, s in event.close(rows, self.values(event, rows), scale):
                found.setdefault(piece, []).append((event, s))
        return found

    def changes(self, event: Event, rows: Sequence[CurvePoint]) -> np.ndarray:
        """`Event.suspects` of rows, kept with them."""
        changes: np.ndarray = column(rows, (event, "changes"), lambda: event.suspects(rows, self.values(event, rows)))
        return changes

    def values(self, event: Event, rows: Sequence[CurvePoint]) -> Array:
        """`Event.values` of rows, kept with them."""
        values: Array = column(rows, event, lambda: event.values(rows, self.problem, self.name, self.fixed))
        return values


def column(rows: Sequence[CurvePoint], name: Any, make: Callable[[], Any]) -> Any:
    """What is made of rows; kept with them by that name if they do not change any more."""
    return rows.column(name, make) if isinstance(rows, Rows) else make()


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


def root(
    segment: Segment, event: Event, test: Callable[[CurvePoint], float], note: str = "", fine: float = 1e-13,
    first: float = math.nan,
) -> Found:  # fmt: skip
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
        place = bracketed_root(beside, 0.0, 1.0, fine, first)
        near = [x for x in values if abs(x - place) <= _NOISY]  # a function that grows along it is less at an end
        s = min(near, key=lambda x: abs(values[x]))  # near a singular point the last of them may be noise
        return Found(event, s, rows[s], True, note)
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        f0, f1 = abs(test(segment.a)), abs(test(segment.b))
        s = 0.0 if f0 < f1 else 1.0
        return Found(event, s, rows[s], False, note)


_BESIDE = 1e-5  # distance along the arc at which the two sides of a singular point are looked at


def _between(segment: Segment, a: CurvePoint, b: CurvePoint, share: float) -> CurvePoint:
    """CurvePoint between two close ones, where the equations themselves cannot be solved."""
    tangent = (1 - share) * a.tangent + share * b.tangent
    return singular(segment, (1 - share) * a.u + share * b.u, replace(a, tangent=tangent))


def singular(segment: Segment, u: Array, near: CurvePoint) -> CurvePoint:
    """Point at u, where the equations are singular, with tangent and orientation of one nearby."""
    point = solution_at(segment.problem, u, segment.name, segment.parameters)
    return CurvePoint(u, near.tangent, near.orientation, point.residual, point.iterations)


def _crossed(segment: Segment, rough: Found) -> Found:
    """A branch point to all digits by its equations, if what they are solved at solves those of the problem."""
    u, here = rough.row.u, {**segment.parameters, segment.name: rough.row.value}
    try:
        U = BranchPoint(segment.problem, segment.name).located(u, here).X
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        return rough
    row = singular(segment, U, rough.row)
    near = np.linalg.norm((U - u) / segment.scale) <= _NEARBY * segment.length
    return replace(rough, row=row) if rough.located and near and row.residual <= segment.settings.tolerance else rough


_NEARBY = 1e-3  # share of the arc by which a branch point may lie beside the root of the determinant


def turn_of(segment: Segment) -> float:
    """Where on the arc the parameter turns, by the Hermite polynomial through its ends."""
    rise = float(segment.b.u[-1] - segment.a.u[-1])
    begin, end = (float(slope[-1]) for slope in segment.slopes)
    # begin and end differ in sign: so does the polynomial, and has one root between
    half, bend = 3 * rise - 2 * begin - end, 3 * (begin + end) - 6 * rise
    return begin / (math.copysign(math.sqrt(max(half * half - bend * begin, 0.0)), begin) - half)


def behind_the_turn(segment: Segment, value: float) -> Array:
    """u where the parameter comes back to a value, on a piece on which it turns.

    Raises
    ------
    NoConvergence, numpy.linalg.LinAlgError
        If it does not, or the piece cannot be followed to there.
    """
    behind = segment.part(segment.at(turn_of(segment)), segment.b)
    found = root(behind, Turning(), lambda row: row.value - value, fine=1e-9)
    if not found.located:
        raise NoConvergence("the curve does not come back to this value", found.row.X, segment.parameters, [])
    return found.row.u


def newton(
    segment: Segment, event: Event, extended: Augmented, s: float, note: str = "", beyond: float = _AT_THE_END
) -> Found:
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
    return Found(event, place, row_of(on_curve(solution), chord / segment.scale, segment.scale), True, note)


@lru_cache(maxsize=8)
def _few(settings: Settings) -> Settings:
    """The settings for a start that is nearly there."""
    return replace(settings, max_iterations=5)


def _determinant(segment: Segment) -> Callable[[CurvePoint], float]:
    """Signed bordered determinant, relative to its size at the first row."""

    def logdet(row: CurvePoint) -> tuple[float, float]:
        here = {**segment.parameters, segment.name: row.value}
        now = linearise(segment.problem, row.X, segment.name, here)
        return slogdet(bordered(now.dR_dX, now.dR_dp, row.tangent / segment.scale**2))

    reference = logdet(segment.a)[1]

    def value(row: CurvePoint) -> float:
        sign, log = logdet(row)
        return sign * float(np.exp(min(log - reference, 50.0)))

    return value
