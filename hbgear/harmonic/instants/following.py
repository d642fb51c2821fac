"""Pseudo-arclength continuation of exact motions through grazing points.

    curve = piece, grazing point, piece, ...        a piece has one order of switches, `corrector`

A piece ends where a gap reaches a breakpoint that it did not reach before, or a contact vanishes: there the grazing
point is located, and the next piece begins with the other number of switches (`grazing`). Steps are limited so that a
short contact keeps a part of its duration. Therefore points approach a grazing geometrically, and special points at a
distance of 1e-10 from it lie between points. Where contacts of two elements exchange their order, their switches are
exchanged, which is no special point.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise, takewhile
from typing import NamedTuple

import numpy as np
import scipy

from hbgear.common.arrays import Array
from hbgear.continuation.curve.asymptote import unbounded_message
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.state import TraceSetup
from hbgear.harmonic.instants.corrector import (
    PREDICTED_LOSS,
    CurveState,
    Family,
    asymptote_ahead,
    chord_passes,
    departure_states,
    exchanges_of,
    with_exchange,
)
from hbgear.harmonic.instants.pattern import InconsistentPatternError, Visit
from hbgear.harmonic.instants.sampling import MissedCrossing, sample_gaps
from hbgear.harmonic.instants.shooting import SIMULTANEOUS_SWITCHES
from hbgear.harmonic.instants.special_points.critical import (
    ExactPoint,
    SpecialExactPoint,
    branch_point_near,
    exact_point,
    hides_two_points,
    point_between,
    point_on_curve,
    special_points,
)
from hbgear.harmonic.instants.special_points.grazing import (
    EQUAL_DURATION,
    GRAZING_DURATION,
    SIMULTANEOUS_DURATION,
    Grazing,
    GrazingPoint,
    first_grazing,
    locate_grazing,
    with_contacts,
    without_contacts,
)

FIRST_STEP, SMALLEST_STEP, LARGEST_STEP = 0.02, 1e-10, 0.1
"""Steps in scaled unknowns: the first, the smallest before the curve ends, the largest with the default `StepControl`.

Instants and velocities change more evenly than harmonics. Another ``max_step`` changes the largest in proportion."""

LARGEST_TURN_COSINE = math.cos(math.radians(18.0))
"""Cosine of the largest angle of successive tangents."""

STEP_GROWTH = 2.0
"""Growth of the step after a fast convergence on a straight section; the curve leaves a grazing geometrically."""

MAX_CORRECTION, ROUNDING_OF_POINTS = 0.5, 1e-9
"""Largest distance of a point from its prediction, over the step, and what rounding adds to it: a tangent that turns
by 18 degrees needs a correction of .16."""

PREDICTOR_POINTS = 3
"""Largest number of points whose polynomial predicts the next one."""

FAST_ITERATIONS = 6
"""Number of corrector iterations up to which the step grows."""

DEPARTURE = 1e-3
"""Distance, in scaled unknowns, of the first point of a branch from the point at which it leaves another one."""

SHORTER_PERIOD_DIFFERENCE = 1e-2
"""Difference of the states of both halves of a period, over that at the ends of a step in which it is reversed, up to
which a special point is the point where both halves become equal."""

MAX_POLYNOMIAL_CHANGE, MULTIPLIER_STEP = 1.5, 1e-3
"""Largest change of the characteristic polynomial in one step, so that two special points of one kind do not lie in a
step, and the step from which it is limited."""

PREDICTED_CHANGE = 0.9
"""Part of the largest change of the characteristic polynomial that a step is chosen for."""

UNBOUNDED_GROWTH = 10.0
"""Size of a motion, over the smallest one of the curve, from which an asymptote is searched."""

SAME_POINT = 1e-5
"""Relative difference of two branch points up to which they are the same point; they are located to 1e-7."""


@dataclass(frozen=True, eq=False)
class CurveMark:
    """Special point of a curve: kind, number of its point, and the contacts of a grazing."""

    kind: str
    index: int
    contacts: tuple[Grazing, ...] = ()


@dataclass(eq=False)
class ExactCurve:
    """Points of a curve with the steps to them, special points, and the reason of its end."""

    points: list[ExactPoint] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)
    marks: list[CurveMark] = field(default_factory=list)
    status: Status = Status.STEP_TOO_SMALL
    message: str = ""
    asymptote: float | None = None


class _Step(NamedTuple):
    """A new point, its missed crossings, points at a border of two orders of switches or its BP."""

    point: ExactPoint
    missed: list[MissedCrossing]
    border: list[ExactPoint]
    crossed: list[SpecialExactPoint]


Report = Callable[[float, int, float], None]


class Follower:
    """Continuation of one curve.

    Parameters
    ----------
    family : callable
        Equations at a value of the parameter.
    setup : TraceSetup
        Name and span of the parameter, largest step and number of points.
    special : bool
        Whether special points are located.
    report : callable
        Called with value of the parameter, number of points and step after each point.
    """

    def __init__(self, family: Family, setup: TraceSetup, special: bool, report: Report) -> None:
        self.family, self.name, self.span = family, setup.name, (setup.span.start, setup.span.end)
        steps = setup.settings.steps
        self.width, self.max_points = setup.span.width, steps.max_points
        self.largest_step = LARGEST_STEP * steps.max_step / StepControl.max_step
        self.special, self.report = special, report
        self.curve, self.step = ExactCurve(), min(FIRST_STEP, self.largest_step)
        self.smallest = math.inf  # size of the motions of the curve
        self.origin: CurveState | None = None

    def run(self, state: CurveState, direction: Array | None = None) -> ExactCurve:
        """Follow the curve from a state; towards the end of the span, or in a direction of z."""
        scale = state.scale(self.width)
        normal = _at_value(len(scale))
        orientation = normal * math.copysign(1.0, self.span[1] - self.span[0])
        if direction is not None:
            self.origin, unit = state, direction / np.linalg.norm(direction / scale)
            # equations are singular where curves cross
            state, ahead = departure_states(state, DEPARTURE, unit, self.family(state.value).period)
            orientation = normal = (ahead.z - state.z) / scale
        try:
            self._accept(_first_point(self.family, state, normal, scale, orientation), 0.0)
            while not self._ended():
                self._advance()
        except (NoConvergence, InconsistentPatternError) as error:
            if not self.curve.points:
                raise NoConvergence(str(error), state.z[:-1], {self.name: state.value}, []) from error
            reason = error.reason if isinstance(error, _Stop) else str(error)
            self._stop(Status.STEP_TOO_SMALL, reason)
        except KeyboardInterrupt:
            if not self.curve.points:
                raise
            self._stop(Status.INTERRUPTED, "interrupted")
        return self.curve

    def _stop(self, status: Status, reason: str) -> None:
        """Set the reason of an early end."""
        value = self.curve.points[-1].state.value
        self.curve.status, self.curve.message = status, f"{reason} at {self.name} = {value:.9g}"

    # ---- steps

    def _advance(self) -> None:
        """Compute the next point, and pass a grazing point if there is one before it."""
        last = self.curve.points[-1]
        while True:
            length = self._limited_length(last, self.step)
            try:
                point, missed, border, crossed = self._next_point(last, length)
                if _turns(last, point):
                    raise NoConvergence("the curve turns sharply", last.state.z, {}, [])
                change = multiplier_change(last, point)
                if length > MULTIPLIER_STEP and change > MAX_POLYNOMIAL_CHANGE:
                    raise NoConvergence("the multipliers change fast", last.state.z, {}, [])
                if missed:
                    self._pass_opening(last, point, missed)
                    return
                if _strays(last, point, length):
                    raise NoConvergence("the corrector leaves the curve", last.state.z, {}, [])
                if self.special and self._hides_two_points(border, point, length):
                    raise NoConvergence("two special points of one kind lie in a step", last.state.z, {}, [])
                special = [] if self._leaves_span(point) else crossed or self._special_points(last, *border, point)
            except (NoConvergence, InconsistentPatternError) as error:
                self.step = 0.4 * length
                if self.step < SMALLEST_STEP:
                    raise _Stop(str(error)) from error
                continue
            break
        grow = STEP_GROWTH if point.iterations <= FAST_ITERATIONS else 1.0
        if change > PREDICTED_CHANGE * MAX_POLYNOMIAL_CHANGE / STEP_GROWTH:  # the next step would change them too far
            grow = min(grow, max(MULTIPLIER_STEP / length, PREDICTED_CHANGE * MAX_POLYNOMIAL_CHANGE / change))
        self.step = min(self.largest_step, max(length * grow, self.step if length < self.step else 0.0))
        if self._leaves_span(point):
            self._finish(last, point)
            return
        self._add(point, length, special)
        self._search_asymptote(point)
        vanishing = [] if self.curve.message else _vanishing_contacts(self.family, point)
        if vanishing:
            self._pass_closing(point, vanishing)

    def _next_point(self, last: ExactPoint, length: float) -> _Step:
        """Return the point at a distance from the last one, with the switches in the order of their phases."""
        guess = _predicted(self.curve.points, length)
        point = exact_point(self.family, guess, last.tangent, last.scale, last.tangent)
        ode = self.family(point.state.value)
        exchanges = exchanges_of(point.state, ode.period, SIMULTANEOUS_SWITCHES * ode.period)
        border: list[ExactPoint] = []
        crossed: list[SpecialExactPoint] = []
        if exchanges:
            if self.special:
                border, crossed = self._border(last, point, exchanges)
            point = self._exchanged(point, exchanges)
        missed = sample_gaps(ode, point.state.iterate)[1]
        return _Step(_rescaled(point, self.width), missed, border, crossed)

    def _border(
        self, last: ExactPoint, point: ExactPoint, exchanges: list[int]
    ) -> tuple[list[ExactPoint], list[SpecialExactPoint]]:
        """Return the point at which two switches coincide, before and after their exchange; a branch point there.

        Where a symmetric motion bifurcates, several pairs of switches coincide and the equations are singular.
        """
        i, fractions = exchanges[0], [0.5]

        def duration(s: float) -> float:
            fractions.append(s)
            state = (last, point)[int(s)].state if s in (0.0, 1.0) else point_between(self.family, last, point, s).state
            return float(state.iterate.durations(self.family(state.value).period)[i])

        if duration(0.0) <= 0:  # both switches coincide at the last point
            return [self._exchanged(last, exchanges)], []
        try:
            s = float(scipy.optimize.brentq(duration, 0.0, 1.0, xtol=1e-13))
            before = point_between(self.family, last, point, s)
            return [before, self._exchanged(before, exchanges)], []
        except NoConvergence:
            if len(exchanges) < 2:
                raise
        s, branch_point = branch_point_near(self.family, last, point, fractions[-1])
        return [], [("BP", s, branch_point)]

    def _exchanged(self, point: ExactPoint, exchanges: list[int]) -> ExactPoint:
        """Return the point with pairs of switches exchanged one after the other."""
        period = self.family(point.state.value).period
        state, ahead = point.state, point.state.with_z(point.state.z + point.tangent * point.scale)
        for i in exchanges:
            state, ahead = (with_exchange(end, i, period) for end in (state, ahead))
        scale = state.scale(self.width)
        direction = (ahead.z - state.z) / scale  # the exchange is linear
        direction /= float(np.linalg.norm(direction))
        return exact_point(self.family, state, direction, scale, direction)

    def _limited_length(self, last: ExactPoint, length: float) -> float:
        """Return the length of a step in which no contact loses too much of its duration."""
        visits = last.state.pattern.visit_ends
        if not len(visits):
            return length
        period = self.family(last.state.value).period
        ahead = last.state.with_z(last.state.z + length * last.tangent * last.scale)
        before, after = (state.iterate.visit_durations(visits, period) for state in (last.state, ahead))
        ratio = float(((before - after) / (PREDICTED_LOSS * before)).max())
        return length / max(1.0, ratio)

    def _hides_two_points(self, border: list[ExactPoint], point: ExactPoint, length: float) -> bool:
        """Return whether two special points of one kind lie between the last point and the next one."""
        points, steps = self.curve.points, self.curve.steps
        before, step = (points[-2], steps[-1]) if len(points) > 1 else (None, 0.0)
        return any(
            hides_two_points(self.family, before if a is points[-1] else None, a, b, step, length)
            for a, b in pairwise((points[-1], *border, point))
        )

    # ---- grazing

    def _pass_opening(self, last: ExactPoint, point: ExactPoint, missed: list[MissedCrossing]) -> None:
        """Accept the grazing point at which contacts open between the last point and one without them."""
        guesses = [Grazing(0.5 * (m.begin + m.end), m.first) for m in missed]
        grazing = first_grazing(self.family, last, point, guesses, 1.5 * self.largest_step)
        exact = self._grazing_point(grazing, last.tangent if len(last.tangent) == len(point.tangent) else point.tangent)
        if self._leaves_span(exact):
            self._finish(last, exact)
            return
        state, growing = with_contacts(self.family, grazing, exact.scale)
        scale = state.scale(self.width)
        first = exact_point(self.family, state, growing, scale, growing)
        self._add(exact, 0.0, self._special_points(last, exact))
        self.curve.marks.append(CurveMark("GR", len(self.curve.points) - 1, tuple(grazing.contacts)))
        self._accept(first, 0.0)
        self.step = float(growing @ state.z) % self.family(state.value).period  # the duration of the first contact

    def _pass_closing(self, point: ExactPoint, visits: list[Visit]) -> None:
        """Accept the grazing point at which contacts vanish, and continue without them."""
        guess, contacts = without_contacts(self.family, point.state, visits)
        grazing = locate_grazing(self.family, guess, contacts, guess.scale(self.width))
        exact = self._grazing_point(grazing, None)
        self._accept(exact, 0.0)
        self.curve.marks.append(CurveMark("GR", len(self.curve.points) - 1, tuple(grazing.contacts)))
        self.step = 1e-4

    def _grazing_point(self, grazing: GrazingPoint, orientation: Array | None) -> ExactPoint:
        """Return the point of a grazing, with its tangent; without ``orientation`` the gap leaves the breakpoint."""
        scale = grazing.state.scale(self.width)
        direction = -grazing.gradient * scale if orientation is None else orientation
        direction = direction / float(np.linalg.norm(direction))
        point = exact_point(self.family, grazing.state, _at_value(len(scale)), scale, direction)
        if orientation is None and grazing.gradient * scale @ point.tangent > 0:
            return ExactPoint(point.state, point.linearised, point.J, scale, -point.tangent)
        return point

    def _search_asymptote(self, point: ExactPoint) -> None:
        """End the curve if its motions grow without bound."""
        state = point.state
        size = float(np.abs(state.iterate.x).max())
        self.smallest = min(self.smallest, size)
        if self.curve.message or size <= UNBOUNDED_GROWTH * self.smallest:
            return
        asymptote = asymptote_ahead(self.family, state, point.tangent * point.scale, self.width)
        if asymptote is not None and min(self.span) <= asymptote <= max(self.span):
            self.curve.status, self.curve.asymptote = Status.UNBOUNDED, asymptote
            self.curve.message = unbounded_message(self.name, asymptote)

    # ---- acceptance

    def _special_points(self, *points: ExactPoint) -> list[SpecialExactPoint]:
        """Return the special points between successive points of a step."""
        if not self.special:
            return []
        return [
            special
            for a, b in pairwise(points)
            if a.state.pattern == b.state.pattern
            for special in special_points(self.family, a, b)
        ]

    def _add(self, point: ExactPoint, length: float, special: list[SpecialExactPoint]) -> None:
        """Accept a point after the special points between the last point and it."""
        norm = _reversed_difference(self.curve.points[-1].state, point.state) if special else 0.0
        for kind, _, exact in special:
            self._accept(exact, 0.0)
            difference = _difference_of_halves(exact.state)
            if len(difference) and np.linalg.norm(difference) < SHORTER_PERIOD_DIFFERENCE * norm:
                self.curve.marks.append(CurveMark("EP", len(self.curve.points) - 1))
                self.curve.status = Status.MERGED
                self.curve.message = f"the branch joined the one it came from at {self.name} = {exact.state.value:.6g}"
                return
            self.curve.marks.append(CurveMark(kind, len(self.curve.points) - 1))
            if kind == "BP" and self.origin and _is_same(self.origin, exact.state, self.width):
                self.curve.status = Status.CLOSED
                self.curve.message = f"the curve closed after {len(self.curve.points)} points"
                return
        self._accept(point, length)

    def _accept(self, point: ExactPoint, length: float) -> None:
        """Store a point."""
        self.curve.points.append(point)
        self.curve.steps.append(length)
        self.report(point.state.value, len(self.curve.points), length)

    def _leaves_span(self, point: ExactPoint) -> bool:
        """Return whether a point lies outside the span."""
        return not min(self.span) <= point.state.value <= max(self.span)

    def _finish(self, last: ExactPoint, point: ExactPoint) -> None:
        """Accept the point at the end of the span, and set the status."""
        low, high = sorted(self.span)
        end = high if point.state.value > high else low
        scale = last.scale
        normal = _at_value(len(scale))
        s = (end - last.state.value) / (point.state.value - last.state.value)
        between = point_between(self.family, last, point, s).state if s > 0 else last.state
        z = between.z.copy()
        z[-1] = end
        final = exact_point(self.family, between.with_z(z), normal, scale, last.tangent)
        self._add(final, self.step, self._special_points(last, final))
        reached = end == self.span[1]
        self.curve.status = Status.REACHED_END if reached else Status.LEFT_SPAN
        self.curve.message = (
            f"{self.name} = {end:.6g} reached" if reached else (f"the curve turned back to {self.name} = {end:.6g}")
        )

    def _ended(self) -> bool:
        """Return whether the curve has ended, and set status and message."""
        curve = self.curve
        if curve.message:
            return True
        if len(curve.points) >= self.max_points:
            self._stop(Status.MAX_POINTS, f"{len(curve.points)} points,")
        elif _is_closed(curve):
            curve.status, curve.message = Status.CLOSED, f"the curve closed after {len(curve.points)} points"
        return bool(curve.message)


def _predicted(points: list[ExactPoint], length: float) -> CurveState:
    """Return the state at a distance from the last of some points, on the polynomial through those of its pattern."""
    from hbgear.continuation.stepping.kernels import predict

    last = points[-1]
    recent = takewhile(lambda point: point.state.pattern == last.state.pattern, points[: -1 - PREDICTOR_POINTS : -1])
    smooth = [(point.state.z, point.tangent * point.scale) for point in recent]
    u, t = np.array(smooth).transpose(1, 0, 2).copy()
    predicted = np.empty(len(last.scale))
    predict(u, t, len(smooth), last.scale, length, predicted)
    return last.state.with_z(predicted)


def _first_point(family: Family, state: CurveState, normal: Array, scale: Array, orientation: Array) -> ExactPoint:
    """Return the point of a state; where the equations at its parameter are singular, across the tangent."""
    try:
        return exact_point(family, state, normal, scale, orientation)
    except NoConvergence:
        tangent = point_on_curve(family, state, scale).tangent
        return exact_point(family, state, tangent, scale, math.copysign(1.0, tangent @ orientation) * tangent)


def _is_same(a: CurveState, b: CurveState, width: float) -> bool:
    """Return whether two branch points are the same one; their switches may have another order."""
    if a.pattern.count != b.pattern.count or abs(a.value - b.value) > SAME_POINT * width:
        return False
    first, second = (np.sort(np.abs(state.iterate.x), axis=None) for state in (a, b))
    return float(np.abs(first - second).max(initial=0.0)) <= SAME_POINT * float(first.max(initial=0.0))


def _strays(last: ExactPoint, point: ExactPoint, length: float) -> bool:
    """Return whether the correction is too large for the step: the point lies on another part of the curve."""
    if last.state.pattern != point.state.pattern:
        return False
    guess = last.state.z + length * last.tangent * last.scale
    correction = float(np.linalg.norm((point.state.z - guess) / last.scale))
    return correction > MAX_CORRECTION * length + ROUNDING_OF_POINTS


def _turns(last: ExactPoint, point: ExactPoint) -> bool:
    """Return whether the tangent turns too far between two points of one pattern."""
    if last.state.pattern != point.state.pattern:
        return False
    t = point.tangent * point.scale / last.scale
    cosine = float(last.tangent @ t) / float(np.linalg.norm(t))
    return cosine < LARGEST_TURN_COSINE


def _is_closed(curve: ExactCurve) -> bool:
    """Return whether the last step passed the first point in its direction."""
    points = curve.points
    if (
        len(points) < 5
        or points[0].state.pattern != points[-1].state.pattern
        or (points[-2].state.pattern != points[-1].state.pattern)
    ):
        return False
    first, last = points[0], points[-1]
    passes = chord_passes(*(point.state.z / last.scale for point in (first, points[-2], last)))
    return passes and float(first.tangent @ last.tangent) > 0.5


def _at_value(size: int) -> Array:
    """Return the normal (size,) of the plane of constant parameter."""
    out = np.zeros(size)
    out[-1] = 1.0
    return out


def _rescaled(point: ExactPoint, width: float) -> ExactPoint:
    """Return the point with scales of its own size."""
    scale = point.state.scale(width)
    tangent = point.tangent * point.scale / scale
    return ExactPoint(
        point.state, point.linearised, point.J, scale, tangent / float(np.linalg.norm(tangent)), point.iterations
    )


def _reversed_difference(a: CurveState, b: CurveState) -> float:
    """Return the smaller norm of the differences of halves at two states if one is opposite to the other, else 0.

    A branch of twice the period is mapped to itself by the exchange of both halves. The difference is reversed where
    the branch joins the motion of the single period. If the same switches have another order in the halves of one
    state, only the difference at the other state is known, and its norm is returned.
    """
    first, second = _difference_of_halves(a), _difference_of_halves(b)
    if len(first) != len(second) and _has_equal_halves(a) and _has_equal_halves(b):
        return float(max(np.linalg.norm(first), np.linalg.norm(second)))
    if not len(first) or not len(second):
        return 0.0
    reversed_ = a.pattern == b.pattern and float((first * second).sum()) < 0
    return float(min(np.linalg.norm(first), np.linalg.norm(second))) if reversed_ else 0.0


def _has_equal_halves(state: CurveState) -> bool:
    """Return whether both halves of a period have the same switches, in any order."""
    switches, count = state.pattern.switches, state.pattern.count // 2
    return not state.pattern.count % 2 and sorted(switches[:count]) == sorted(switches[count:])


def _difference_of_halves(state: CurveState) -> Array:
    """Return the differences (K / 2, r) of the states of both halves of a period; empty if their switches differ."""
    iterate, count = state.iterate, state.pattern.count // 2
    if state.pattern.count % 2 or state.pattern.switches[:count] != state.pattern.switches[count:]:
        return np.empty((0, 0))
    return iterate.x[:count] - iterate.x[count:]


def multiplier_change(a: ExactPoint, b: ExactPoint) -> float:
    """Return the largest change of a coefficient of the characteristic polynomial of the leading multipliers."""
    first, second = a.polynomial, b.polynomial
    return float(np.abs(first - second).max()) if len(first) == len(second) else 0.0


class _Stop(NoConvergence):
    """The shortest step failed."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; the shortest step was tried", np.empty(0), {}, [])
        self.reason = f"{reason}; the shortest step was tried"


def _vanishing_contacts(family: Family, point: ExactPoint) -> list[Visit]:
    """Return the contacts that vanish along the curve."""
    period, pattern = family(point.state.value).period, point.state.pattern
    ahead = point.state.with_z(point.state.z + 1e-3 * point.tangent * point.scale)
    before, after = (state.iterate.visit_durations(pattern.visit_ends, period) for state in (point.state, ahead))
    short = [
        (visit, a)
        for visit, a, b in zip(pattern.visits, before, after, strict=True)
        if a < SIMULTANEOUS_DURATION * period and b < a
    ]
    tied = len(point.linearised.ties) == len(short) - 1
    shortest = min((a for _, a in short), default=math.inf)
    if not tied and shortest > EQUAL_DURATION * period:  # contacts become equal as they vanish
        return []
    limit = GRAZING_DURATION * period if tied else math.inf
    return [visit for visit, a in short if a < limit]
