"""Curves of special points of exact motions in two parameters: pseudo-arclength continuation on a surface of motions.

    F(u, p, q) = 0,   g(u, p, q) = 0        g test function of the special point, see `surface`

    prediction   w_0 + l t,   t = T (-g_2, g_1) / |g'|        g' = (g_1, g_2) derivatives of g along T, by differences
    correction   g(c) = 0 over the points of the surface through w_0 + l t + c n,   n = T g' / |g'|

The correction is that of `special_motion`. The curve passes cusps and turning points. Where the order of the contact
instants changes, it continues with the other order: a further contact begins or vanishes, or contacts of two elements
exchange their order. A fold near a grazing point ends where its own contact vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import scipy

from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NoConvergence
from hbgear.continuation.stepping.control import StepControl
from hbgear.harmonic.instants.corrector import CurveState, chord_passes
from hbgear.harmonic.instants.pattern import InconsistentPatternError
from hbgear.harmonic.instants.refine import with_missed_crossings
from hbgear.harmonic.instants.sampling import MissedCrossing
from hbgear.harmonic.instants.shooting import monodromy_matrix, multipliers_of
from hbgear.harmonic.instants.special_points.grazing import (
    SIMULTANEOUS_DISTANCE,
    Grazing,
    highest_point,
    without_contacts,
)
from hbgear.harmonic.instants.special_points.special_motion import FAST_SECANTS, SpecialMotion, SpecialMotions
from hbgear.harmonic.instants.special_points.surface import Surface

SMALLEST_STEP = 1e-9
"""Smallest step in scaled unknowns before the curve ends."""

MIN_COSINE_OF_STEP = math.cos(math.radians(25.0))
"""Cosine of the largest angle of successive tangents."""

EXCHANGE_STEP = 1e-3
"""Step from which two contacts exchange their order, with the corrector on the other side."""

VANISHING_CONTACT, FIRST_DURATION = 1e-5, 2e-5
"""Duration over the period of a contact that vanishes, and of one that has begun. Differences of a hundredth of it have
rounding of 1e-4 by the corrector."""

SMALLEST_RATIO = 1e-2
"""First parameter over that of the start at which a curve ends if it tends to zero. Motions at so low a frequency have
thousands of natural periods in one of the excitation."""

MOVING_PARAMETER = 1e-3
"""Component of the tangent in the first parameter above which it moves; at a cusp it is rounding."""


Report = Callable[[float, int, float], None]
"""Function of value, number of points and step, called after each point."""


@dataclass(eq=False)
class SpecialPointCurve:
    """Points of a curve, points of codimension two as kind and number of the point, and the reason of its end."""

    points: list[SpecialMotion] = field(default_factory=list)
    steps: list[float] = field(default_factory=list)
    marks: list[tuple[str, int]] = field(default_factory=list)
    status: Status = Status.STEP_TOO_SMALL
    message: str = ""


class SpecialPointFollower:
    """Continuation of the curve of a special point in a second parameter.

    Parameters
    ----------
    problem : ExactSpecialPointProblem
        Kind of the special point, first parameter and its range.
    surface : Surface
        Motions in two parameters.
    name : str
        Name of the second parameter.
    span : (float, float)
        Section of the second parameter.
    steps : StepControl
        First step, largest step and largest number of points.
    report : callable
        Called with value, number of points and step after each point.
    """

    def __init__(
        self, problem: Any, surface: Surface, name: str, span: tuple[float, float], steps: StepControl, report: Report
    ) -> None:
        self.surface, self.kind, self.name, self.span = surface, problem.kind, name, span
        self.first_name, self.allowed = problem.parameter, problem.range_of(problem.parameter)
        self.motions = SpecialMotions(surface, self.kind, abs(span[1] - span[0]))
        self.steps, self.report = steps, report
        self.curve, self.step = SpecialPointCurve(), steps.first_step

    def run(self, state: CurveState, second: float, grazing: Grazing | None, direction: int = 0) -> SpecialPointCurve:
        """Follow the curve from a special point in a direction of the second parameter; with 0 along the span."""
        try:
            first = self.motions.corrected(state, second, grazing)
            orientation = direction or math.copysign(1.0, self.span[1] - self.span[0])
            self._accept(_reversed(first) if first.tangent[-1] * orientation < 0 else first, 0.0)
            while not self._ended():
                self._advance()
        except (NoConvergence, InconsistentPatternError) as error:
            if not self.curve.points:
                raise NoConvergence(str(error), state.z[:-1], {self.name: second}, []) from error
            self._end(Status.STEP_TOO_SMALL, str(error))
        except KeyboardInterrupt:
            if not self.curve.points:
                raise
            self._end(Status.INTERRUPTED, "interrupted")
        return self.curve

    # ---- steps

    def _advance(self) -> None:
        """Compute the next point, and pass a change of the order of contact instants."""
        last = self.curve.points[-1]
        while True:
            length = self.motions.limited_length(last, self.step)
            if self._reaches_end(last, length):
                return
            try:
                step = self._next_motion(last, length)
            except (*SOLVER_ERRORS, InconsistentPatternError) as error:
                self.step = 0.4 * length
                if self.step < SMALLEST_STEP:
                    raise NoConvergence(f"{error}; the shortest step was tried", last.point.w, {}, []) from error
                continue
            break
        if step is None:
            return
        motion, count = step
        self.step = min(self.steps.max_step, max(length * (2.0 if count <= FAST_SECANTS else 1.0), self.step))
        self._add(last, motion, length)
        vanishing = [] if self.curve.message else self._vanishing_contacts(motion)
        if vanishing:
            self._remove_contacts(motion, vanishing)

    def _next_motion(self, last: SpecialMotion, length: float) -> tuple[SpecialMotion, int] | None:
        """Return the next motion and its number of secants; None if it has other contacts, which are added then."""
        point, count = self.motions.point_at(last, length)
        self.motions.check_durations(last, point)
        exchanged = self.motions.exchanged(point)
        if exchanged is not None:
            if length > EXCHANGE_STEP:
                raise NoConvergence("two contacts exchange their order", last.point.state.z, {}, [])
            self._pass_exchange(last, exchanged, point.second)
            return None
        motion = self.motions.with_basis(point, last.grazing)
        missed = self.motions.missed_contacts(point, last.grazing)
        if missed:
            self._add_contacts(last, motion, length, missed)
            return None
        motion = _reversed(motion) if _cosine(last, motion) < 0 else motion
        if _cosine(last, motion) < MIN_COSINE_OF_STEP:
            raise NoConvergence("the curve turns sharply", last.point.state.z, {}, [])
        return motion, count

    def _reaches_end(self, last: SpecialMotion, length: float) -> bool:
        """Accept the point at an end of the span before the next step, and return whether there is one.

        It is located at the constant second parameter, beyond which the model may refuse values.
        """
        rate = float(last.tangent[-1] * last.scale[-1])
        end = max(self.span) if rate > 0 else min(self.span)
        if not rate or not 0 < (end - last.point.second) / rate <= length:
            return False
        try:
            point = self.motions.at_second(last, end, (end - last.point.second) / rate)
        except (*SOLVER_ERRORS, InconsistentPatternError):
            return False
        self._accept(replace(last, point=point), length)
        self._finish(end)
        return True

    def _finish(self, end: float) -> None:
        """Set status and message of a curve that has reached an end of the span."""
        reached = end == self.span[1]
        text = f"{self.name} = {end:.6g} reached" if reached else f"the curve turned back to {self.name} = {end:.6g}"
        self.curve.status, self.curve.message = Status.REACHED_END if reached else Status.LEFT_SPAN, text

    # ---- changes of the order of contact instants

    def _pass_exchange(self, last: SpecialMotion, state: CurveState, second: float) -> None:
        """Accept the special point with exchanged switches."""
        motion = self.motions.corrected(state, second, last.grazing)
        cosine = last.tangent[-2:] * last.scale[-2:] @ (motion.tangent[-2:] * motion.scale[-2:])
        self._accept(_reversed(motion) if cosine < 0 else motion, 0.0)

    def _add_contacts(self, last: SpecialMotion, motion: SpecialMotion, length: float, contacts: list[Grazing]) -> None:
        """Accept the point at which contacts begin between two points, and the first one with the contacts.

        The curve has a corner there: test functions change with the duration of a contact, and this with the square
        root of the distance.
        """
        motion = _reversed(motion) if _cosine(last, motion) < 0 else motion
        opening = self._root(last, motion, length, lambda m: self.motions.largest_distance(m.point, contacts))
        if not min(self.span) <= opening.point.second <= max(self.span):
            self._add(last, motion, length)
            return
        point, ode = opening.point, self.surface.at(opening.point)
        size = SIMULTANEOUS_DISTANCE * float(np.abs(point.state.iterate.x).max())
        half = 0.5 * FIRST_DURATION * ode.period
        extrema = [highest_point(self.surface.family(point.second), point.state, contact) for contact in contacts]
        crossings = [MissedCrossing(g.t - half, g.t + half, g.switch) for g, height in extrema if height > -size]
        iterate = with_missed_crossings(ode, point.state.iterate, crossings)
        guess = self.motions.motion_near(CurveState.of(iterate, point.state.value), point.second, last.grazing)
        first = self.motions.with_basis(self.motions.point_at(self.motions.with_duration(guess), 0.0)[0], guess.grazing)
        durations, rate = self.motions.durations(first.point, first.tangent * first.scale)
        self._accept(opening, length)
        self._accept(_reversed(first) if rate[np.argmin(durations)] < 0 else first, 0.0)

    def _vanishing_contacts(self, motion: SpecialMotion) -> list[tuple[int, int]]:
        """Return the contacts that vanish along the curve."""
        visits = motion.point.state.pattern.visits
        if not visits:
            return []
        durations, rate = self.motions.durations(motion.point, motion.tangent * motion.scale)
        limit = VANISHING_CONTACT * self.surface.at(motion.point).period
        return [visit for visit, a, b in zip(visits, durations, rate, strict=True) if a < limit and b < 0]

    def _remove_contacts(self, motion: SpecialMotion, visits: list[tuple[int, int]]) -> None:
        """Continue without contacts that vanish; the curve ends with them if there is no such point."""
        state, point = motion.point.state, motion.point
        element = self.surface.at(point).equations.system.elements[state.pattern.switches[visits[0][0]].element]
        try:
            guess, contacts = without_contacts(self.surface.family(point.second), state, visits)
            after = self.motions.corrected(guess, point.second, motion.grazing)
            step = EXCHANGE_STEP * after.tangent * after.scale
            ahead, behind = (self.motions.motion_at(after.point, d, after.basis, after.scale) for d in (step, -step))
            closing = self.motions.largest_distance(ahead, contacts) > self.motions.largest_distance(behind, contacts)
            self._accept(_reversed(after) if closing else after, 0.0)
        except (*SOLVER_ERRORS, InconsistentPatternError):
            self._end(Status.EVENT, f"the {self.kind} ends where its contact of {element.name} vanishes")

    # ---- acceptance

    def _add(self, last: SpecialMotion, motion: SpecialMotion, length: float) -> None:
        """Accept a point after the turning point between the last point and it; the end of the span ends the curve."""
        low, high = sorted(self.span)
        if last.tangent[-1] * motion.tangent[-1] < 0:
            turning = self._root(last, motion, length, lambda m: float(m.tangent[-1]))
            if low <= turning.point.second <= high:
                self._accept(turning, 0.0)
                self.curve.marks.append((self._turning_kind(turning), len(self.curve.points) - 1))
        if self.kind == "NS" and low <= motion.point.second <= high and self._ends_at_resonance(last, motion, length):
            return
        if low <= motion.point.second <= high:
            self._accept(motion, length)
            if self._leaves_range(motion):
                self._end(
                    Status.EVENT, f"{self.first_name} = {motion.point.state.value:.3g} tends to the end of its range"
                )
            elif self._is_closed():
                self._end(Status.CLOSED, f"the curve closed after {len(self.curve.points)} points")
            return
        end = high if motion.point.second > high else low
        final = self._root(last, motion, length, lambda m: m.point.second - end)
        self._accept(replace(final, point=final.point._replace(second=end)), length)
        self._finish(end)

    def _ends_at_resonance(self, last: SpecialMotion, motion: SpecialMotion, length: float) -> bool:
        """Accept the point at which a Neimark-Sacker pair becomes real, +1 or -1, and return whether there is one.

        Beyond it, the product of two real multipliers is 1, which is no change of the motion.
        """
        for kind, name, double in (("RI", "1:1", 1), ("RII", "1:2", -1)):
            distance = partial(_distance_of_pair, double=double)
            if distance(last) * distance(motion) < 0:
                self._accept(self._root(last, motion, length, distance), 0.0)
                self.curve.marks.append((kind, len(self.curve.points) - 1))
                reason = f"a {name} resonance: a double multiplier {double:+d}"
                self._end(Status.EVENT, f"the curve of Neimark-Sacker points ends at {reason}")
                return True
        return False

    def _turning_kind(self, motion: SpecialMotion) -> str:
        """Return the kind of a turning point: on curves of folds it is a cusp or an isola centre."""
        if self.kind != "LP":
            return "LP"
        return "IC" if abs(motion.tangent[-2]) > MOVING_PARAMETER else "CP"

    def _root(
        self, last: SpecialMotion, motion: SpecialMotion, length: float, test: Callable[[SpecialMotion], float]
    ) -> SpecialMotion:
        """Return the point between two points at which a function is zero."""
        computed = {0.0: last, length: motion}

        def value(s: float) -> float:
            if s not in computed:
                located = self.motions.with_basis(self.motions.point_at(last, s)[0], last.grazing)
                computed[s] = _reversed(located) if _cosine(last, located) < 0 else located
            return test(computed[s])

        if value(0.0) * value(length) > 0:
            raise NoConvergence("a function has no zero between two points", last.point.state.z, {}, [])
        s = float(scipy.optimize.brentq(value, 0.0, length, xtol=1e-13, rtol=1e-14))
        value(s)
        return computed[s]

    def _accept(self, motion: SpecialMotion, length: float) -> None:
        """Store a point."""
        self.curve.points.append(motion)
        self.curve.steps.append(length)
        self.report(motion.point.second, len(self.curve.points), length)

    def _leaves_range(self, motion: SpecialMotion) -> bool:
        """Return whether the first parameter leaves its range, or tends to zero, which it excludes."""
        value, start = motion.point.state.value, self.curve.points[0].point.state.value
        return value not in self.allowed or (0.0 not in self.allowed and abs(value) < SMALLEST_RATIO * abs(start))

    def _is_closed(self) -> bool:
        """Return whether the last step passed the first point in its direction."""
        points = self.curve.points
        first, before, last = points[0], points[-2], points[-1]
        patterns = {motion.point.state.pattern for motion in (first, before, last)}
        if len(points) < 5 or len(patterns) > 1:
            return False
        passes = chord_passes(*(motion.point.w / last.scale for motion in (first, before, last)))
        return passes and float(first.tangent @ last.tangent) > 0.5

    def _end(self, status: Status, reason: str) -> None:
        """Set the reason of the end."""
        last = self.curve.points[-1].point
        self.curve.status, self.curve.message = status, f"{reason}, at {self.name} = {last.second:.9g}"

    def _ended(self) -> bool:
        """Return whether the curve has ended."""
        if not self.curve.message and len(self.curve.points) >= self.steps.max_points:
            self._end(Status.MAX_POINTS, f"{len(self.curve.points)} points")
        return bool(self.curve.message)


def _reversed(motion: SpecialMotion) -> SpecialMotion:
    """Return the motion with the opposite direction of the curve."""
    return replace(motion, tangent=-motion.tangent)


def _cosine(last: SpecialMotion, motion: SpecialMotion) -> float:
    """Return the cosine of the angle of the tangents of two points of one order of contact instants."""
    t = motion.tangent * motion.scale / last.scale
    return float(last.tangent @ t) / float(np.linalg.norm(t))


def _distance_of_pair(motion: SpecialMotion, double: float) -> float:
    """Return half the sum of the two multipliers whose product is nearest to 1, minus a double multiplier."""
    mu = multipliers_of(monodromy_matrix(motion.point.linearised))
    i, j = np.triu_indices(len(mu), 1)
    k = int(np.abs(mu[i] * mu[j] - 1).argmin())
    return float((mu[i[k]] + mu[j[k]]).real) / 2 - double
