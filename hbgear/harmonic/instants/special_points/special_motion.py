"""Special points of exact motions in two parameters: corrector, tangents, and the contacts that a motion requires.

    F(u, p, q) = 0,   g(u, p, q) = 0        g test function of the special point, see `surface`

    t = T (-g_2, g_1) / |g'|,   n = T g' / |g'|        g' = (g_1, g_2) derivatives of g along T, by differences

From a prediction w the zero of g is located by secants over the points of the surface through w + c n.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.instants.corrector import PREDICTED_LOSS, CurveState, Family, exchanges_of, with_exchange
from hbgear.harmonic.instants.sampling import sample_gaps
from hbgear.harmonic.instants.shooting import SIMULTANEOUS_SWITCHES, linearise
from hbgear.harmonic.instants.special_points.critical import point_on_curve, relocated
from hbgear.harmonic.instants.special_points.grazing import Grazing, highest_point, locate_grazing
from hbgear.harmonic.instants.special_points.surface import Surface, SurfacePoint, TestFunction

MAX_CORRECTION_OF_POINT = 0.5
"""Largest distance of a point from its prediction, over the step."""

DIFFERENCE, DIFFERENCE_OF_CONTACT = 1e-5, 1e-2
"""Step of the derivatives of g in scaled unknowns, and its limit over the shortest contact [rad], the distance on which
the motion changes."""

SECANT_TOLERANCE, MAX_SECANTS, FAST_SECANTS = 1e-11, 12, 4
"""Last change of c; largest number of evaluations of g; number up to which the step grows."""

SAME_EXTREMUM = 1e-6
"""Difference of the phases [rad] of two extrema of a gap, up to which they are the same one."""

MAX_DISTANCE_OF_GUESS = 0.03
"""Largest distance of a special point from a guess with another order of contact instants."""

MAX_LOSS = 0.75
"""Largest part of its duration that a contact loses in a corrected step: motions with a contact of no duration are
another solution."""


@dataclass(frozen=True, eq=False)
class SpecialMotion:
    """Point of a curve of special points.

    Attributes
    ----------
    point : SurfacePoint
        The motion.
    scale : ndarray, shape (n + 2,)
        Scales of w.
    basis : ndarray, shape (n + 2, 2)
        Tangent plane T of the surface.
    tangent, normal : ndarray, shape (n + 2,)
        Unit vectors in the plane, along the curve and in the direction of the gradient.
    slope : float
        Size of the gradient of the test function.
    test : callable
        Test function near the point.
    grazing : Grazing or None
        The contact that grazes.
    """

    point: SurfacePoint
    scale: Array
    basis: Array
    tangent: Array
    normal: Array
    slope: float
    test: TestFunction
    grazing: Grazing | None


class SpecialMotions:
    """Special points of one kind on a surface of motions.

    Parameters
    ----------
    surface : Surface
        Motions in two parameters.
    kind : str
        LP, PD, NS or GR.
    width : float
        Scale of the second parameter.
    """

    def __init__(self, surface: Surface, kind: str, width: float) -> None:
        self.surface, self.kind, self.width = surface, kind, width

    def with_basis(self, point: SurfacePoint, grazing: Grazing | None) -> SpecialMotion:
        """Return a motion with the tangent plane of the surface and the gradient of the test function there."""
        scale = self.surface.scale(point.state, self.width)
        linearised, J = self.surface.linearised(point.state, point.second)
        T = self.surface.basis(J, scale)
        if grazing is not None:
            grazing = highest_point(self.surface.family(point.second), point.state, grazing)[0]
        point = point._replace(linearised=linearised)
        test = self.surface.test(self.kind, point, scale, grazing)
        visits = point.state.pattern.visits
        durations = point.state.iterate.visit_durations(visits, self.surface.at(point).period)
        h = min(DIFFERENCE, DIFFERENCE_OF_CONTACT * float(np.abs(durations).min(initial=1.0)))
        slopes = []
        for direction in T.T:
            above, below = (test(self.motion_at(point, sign * h * direction * scale, T, scale)) for sign in (1, -1))
            slopes.append((above - below) / (2 * h))
        size = math.hypot(*slopes)
        if not size > 0 or not math.isfinite(size):
            raise NoConvergence("the special point is not isolated", point.state.z, {}, [])
        tangent, normal = T @ np.array([-slopes[1], slopes[0]]) / size, T @ np.array(slopes) / size
        return SpecialMotion(point, scale, T, tangent, normal, size, test, grazing)

    def motion_at(self, point: SurfacePoint, change: Array, T: Array, scale: Array) -> SurfacePoint:
        """Return the motion of the surface near a motion plus a change of w."""
        w = point.w + change
        return self.surface.point(point.state.with_z(w[:-1]), float(w[-1]), T, scale)

    def point_at(self, last: SpecialMotion, length: float) -> tuple[SurfacePoint, int]:
        """Return the special point at a distance along the tangent, and the number of evaluations of g."""
        c, slope, last_value = 0.0, last.slope, (math.nan, math.nan)
        for count in range(1, MAX_SECANTS + 1):
            change_of_w = (length * last.tangent + c * last.normal) * last.scale
            point = self.motion_at(last.point, change_of_w, last.basis, last.scale)
            g = last.test(point)
            if count > 1 and c != last_value[0]:
                slope = (g - last_value[1]) / (c - last_value[0])
            # secant method, which needs no gradient of g beyond the first one
            change = -g / slope if slope else math.inf
            if not abs(c + change) <= (MAX_CORRECTION_OF_POINT * length or MAX_DISTANCE_OF_GUESS):
                break
            if abs(change) <= SECANT_TOLERANCE:
                return point, count
            last_value, c = (c, g), c + change
        raise NoConvergence("the special point is not found", last.point.state.z, {}, [])

    def corrected(self, state: CurveState, second: float, grazing: Grazing | None) -> SpecialMotion:
        """Return the special point near a guess."""
        guess = self.motion_near(state, second, grazing)
        return self.with_basis(self.point_at(guess, 0.0)[0], guess.grazing)

    def motion_near(self, state: CurveState, second: float, grazing: Grazing | None) -> SpecialMotion:
        """Return the motion near a guess, which need not be the special point."""
        scale = self.surface.scale(state, self.width)
        J = self.surface.linearised(state, second)[1]
        return self.with_basis(self.surface.point(state, second, self.surface.basis(J, scale), scale), grazing)

    def with_duration(self, motion: SpecialMotion) -> SpecialMotion:
        """Return a motion whose normal is the direction in which the shortest contact keeps its duration."""
        T = motion.basis
        durations, _ = self.durations(motion.point, motion.tangent * motion.scale)
        rates = [self.durations(motion.point, column * motion.scale)[1][np.argmin(durations)] for column in T.T]
        v = np.array([-rates[1], rates[0]]) / math.hypot(*rates)
        return replace(motion, normal=T @ v, slope=motion.slope * float(motion.normal @ (T @ v)))

    def at_second(self, last: SpecialMotion, second: float, length: float) -> SurfacePoint:
        """Return the special point at a value of the second parameter, near a distance along the tangent.

        Raises
        ------
        NoConvergence
            If there is no such point nearby, or its contact instants have another order.
        """
        family, scale = self.surface.family(second), last.scale[:-1]
        guess = last.point.state.with_z(last.point.state.z + length * (last.tangent * last.scale)[:-1])
        state = state_near(family, guess, self.kind, last.grazing, scale, MAX_CORRECTION_OF_POINT * length)
        point = SurfacePoint(state, second, linearise(family(state.value), state.iterate))
        self.check_durations(last, point)
        if self.exchanged(point) is not None or self.missed_contacts(point, last.grazing):
            raise NoConvergence("the order of contact instants changes", state.z, {}, [])
        if np.linalg.norm((state.z - guess.z) / scale) > MAX_CORRECTION_OF_POINT * length:
            raise NoConvergence("the special point is another one", state.z, {}, [])
        return point

    # ---- contacts

    def limited_length(self, last: SpecialMotion, length: float) -> float:
        """Return the length of a step in which no contact loses too much of its duration."""
        if not last.point.state.pattern.visits:
            return length
        durations, rate = self.durations(last.point, last.tangent * last.scale)
        return length / max(1.0, float((-length * rate / (PREDICTED_LOSS * durations)).max()))

    def durations(self, point: SurfacePoint, direction: Array) -> tuple[Array, Array]:
        """Return the durations of all visits, and their rates in a direction of w."""
        state = point.state
        i, j = np.array(state.pattern.visits).T
        phases = state.phase_steps(direction[:-1])
        period = self.surface.at(point).period
        return state.iterate.visit_durations(state.pattern.visits, period), phases[j] - phases[i]

    def check_durations(self, last: SpecialMotion, point: SurfacePoint) -> None:
        """Raise NoConvergence if a contact has lost most of its duration."""
        period, visits = self.surface.at(point).period, point.state.pattern.visits
        before, after = (state.iterate.visit_durations(visits, period) for state in (last.point.state, point.state))
        if (after < (1 - MAX_LOSS) * before).any():
            raise NoConvergence("a contact vanishes within one step", point.state.z, {}, [])

    def exchanged(self, point: SurfacePoint) -> CurveState | None:
        """Return the state with switches in the order of their phases; None if they are."""
        period, state = self.surface.at(point).period, point.state
        exchanges = exchanges_of(state, period, SIMULTANEOUS_SWITCHES * period)
        for i in exchanges:
            state = with_exchange(state, i, period)
        return state if exchanges else None

    def missed_contacts(self, point: SurfacePoint, grazing: Grazing | None) -> list[Grazing]:
        """Return the contacts for which a motion has no switches, except the contact ``grazing`` of the curve.

        By rounding, the gap of that contact may cross its breakpoint around the extremum.
        """
        ode, family = self.surface.at(point), self.surface.family(point.second)
        contacts = [Grazing(0.5 * (m.begin + m.end), m.first) for m in sample_gaps(ode, point.state.iterate)[1]]
        if grazing is None or not contacts:
            return contacts
        extremum = highest_point(family, point.state, grazing)[0].t

        def is_grazing(contact: Grazing) -> bool:
            distance = highest_point(family, point.state, contact)[0].t - extremum
            return contact.switch == grazing.switch and abs(math.remainder(distance, ode.period)) < SAME_EXTREMUM

        return [contact for contact in contacts if not is_grazing(contact)]

    def largest_distance(self, point: SurfacePoint, contacts: Sequence[Grazing]) -> float:
        """Return the largest distance of the gaps of contacts beyond their breakpoints."""
        family = self.surface.family(point.second)
        return max(highest_point(family, point.state, contact)[1] for contact in contacts)


def state_near(
    family: Family, guess: CurveState, kind: str, grazing: Grazing | None, scale: Array, reach: float
) -> CurveState:
    """Return the special point of a curve in the first parameter near a guess; see `relocated` and `locate_grazing`."""
    if grazing is not None:
        return locate_grazing(family, guess, [grazing], scale).state
    return relocated(family, point_on_curve(family, guess, scale), kind, reach).state
