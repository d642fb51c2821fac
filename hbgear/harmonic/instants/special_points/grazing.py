"""Grazing points of curves of exact motions: contacts that open and close.

    F(u, p) = 0,   h(t; u, p) = 0,   dh/dt = 0          h distance beyond a breakpoint, at phase t

u are the unknowns without the contact. On the other side of the point two switches enter, at t - delta / 2 and
t + delta / 2. Near the point

    p - p_GR = O(delta^2),   delta >= 0

so a curve leaves the point with prescribed delta, and arrives when delta falls below `GRAZING_DURATION`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.instants.corrector import PARAMETER_STEP, CurveState, Family, correct, exchanges_of, jacobian
from hbgear.harmonic.instants.pattern import Switch, Visit
from hbgear.harmonic.instants.propagation import growth, rates
from hbgear.harmonic.instants.refine import with_missed_crossings
from hbgear.harmonic.instants.sampling import MissedCrossing
from hbgear.harmonic.instants.shooting import SIMULTANEOUS_SWITCHES
from hbgear.harmonic.instants.special_points.critical import ExactPoint

GRAZING_DURATION = 2e-8
"""Shortest contact on a curve, over the period. The parameter differs from that of the grazing by its square."""

SIMULTANEOUS_DURATION = 1e-4
"""The same for several contacts, as of a symmetric machine. The duration of one is prescribed, and the others follow
from equations that are nearly singular: rounding of 1e-16 changes phases by 1e-16 / delta^2, which is 1e-10 here, the
tolerance of a corrector."""

EQUAL_DURATION = 1e-6
"""Duration at which simultaneous contacts are tested for equal durations. Those of contacts of different stiffness, as
of two stops at the same distance from a mass, become equal as they vanish: they differ by the order of their square."""

MAX_GRAZING_ITERATIONS = 15
"""Largest number of Newton iterations for a grazing point."""

GRAZING_TOLERANCE = 1e-9
"""Scaled size of the last Newton step of a grazing point."""

GRAZING_ROUNDING = 1e-6
"""Scaled size of a Newton step below which the next one may be larger by rounding."""

SIMULTANEOUS_DISTANCE = 1e-9
"""Distance, over the size of the gap's motion, up to which other contacts graze at the same point."""

MAX_PHASE_STEP = 0.05
"""Largest Newton step [rad] of the phase of an extremum."""

SAME_GRAZING_DISTANCE = 0.02
"""Difference of the phases [rad] of two grazings of one gap up to which they are the same; the gap has one maximum."""

MAX_MISSED_DISTANCE = 1e-6
"""Largest distance of a grazing point behind the last point, whose contact the samples do not show."""


class Grazing(NamedTuple):
    """Contact that grazes: phase t, in a segment, and the switch with which it begins."""

    t: float
    switch: Switch


class GrazingPoint(NamedTuple):
    """Grazing point: state without the contacts, contacts, and the gradient of h in z for the first of them."""

    state: CurveState
    contacts: list[Grazing]
    gradient: Array


def _segment_at(state: CurveState, period: float, t: float) -> tuple[int, float]:
    """Return the segment that contains a phase, and the phase in the period that starts with the first switch."""
    tau = state.iterate.tau
    t = float(tau[0]) + (t - float(tau[0])) % period
    return int(np.searchsorted(tau, t, side="right")) - 1, t


def _distance(family: Family, state: CurveState, grazing: Grazing) -> tuple[Array, Array, int, float]:
    """Return (h, dh/dt), their derivatives (2, r) in the state of the segment, its number, and d2h/dt2."""
    ode, iterate = family(state.value), state.iterate
    i, t = _segment_at(state, ode.period, grazing.t)
    contacts, r = iterate.pattern.contacts[i], ode.size
    flow, tau = ode.flow(contacts), float(iterate.tau[i])
    row = grazing.switch.sign * ode.gaps(contacts.section)[grazing.switch.element]
    level = grazing.switch.sign * ode.equations.breakpoints[grazing.switch.element][grazing.switch.breakpoint]
    Y = np.eye(len(row)) + growth(flow, tau, t - tau)
    y = Y @ ode.extended(iterate.x[i], tau, contacts.section)
    rate = rates(flow, t, y)
    value = np.array([row @ y - level, row @ rate])
    gradient = np.stack([row @ Y[:, :r], row @ rates(flow, t, Y.T).T[:, :r]])
    h = 1e-6
    # d2h/dt2 by a central difference of the rates
    after, before = (rates(flow, t + d, y + d * rate) for d in (h, -h))
    return value, gradient, i, float(row @ (after - before)) / (2 * h)


def _equations(family: Family, state: CurveState, grazing: Grazing) -> tuple[Array, Array]:
    """Return (h, dh/dt) and its derivatives (2, n + 2) in z and t."""
    value, gradient, i, curvature = _distance(family, state, grazing)
    r, J = gradient.shape[1], np.zeros((2, len(state.z) + 1))
    J[:, i * r : (i + 1) * r] = gradient
    J[:, -1] = value[1], curvature
    columns = [len(state.z) - 1] + ([state.phase_column(i)] if state.pattern.free[i] else [])
    for column in columns:
        h = PARAMETER_STEP * max(abs(state.z[column]), 1e-3)
        above, below = (_distance(family, state.with_z(_shifted(state.z, column, d)), grazing)[0] for d in (h, -h))
        J[:, column] = (above - below) / (2 * h)
    return value, J


def _shifted(z: Array, column: int, change: float) -> Array:
    """Return z with one entry changed."""
    out = z.copy()
    out[column] += change
    return out


def locate_grazing(family: Family, state: CurveState, contacts: Sequence[Grazing], scale: Array) -> GrazingPoint:
    """Return the grazing point of the first contact near a state without it, and all contacts that graze there.

    Raises
    ------
    NoConvergence
        If Newton's method does not converge, or the switches are not in the order of their phases at the point. A step
        that is larger than the one before ends it: from the guesses that converge, all steps become smaller.
    """
    grazing, scales, last_size = contacts[0], np.append(scale, 1.0), 10.0
    for _ in range(MAX_GRAZING_ITERATIONS):
        linearised, J = jacobian(family, state)
        value, grazing_rows = _equations(family, state, grazing)
        bordered = np.zeros((len(J) + 2, len(scales)))
        bordered[: len(J), :-1] = J
        bordered[len(J) :] = grazing_rows
        try:
            step = np.linalg.solve(bordered * scales, -np.concatenate([linearised.R, value])) * scales
        except np.linalg.LinAlgError:
            break
        size = float(np.abs(step / scales).max())
        if not size <= max(last_size, GRAZING_ROUNDING):
            break
        last_size = size
        state, grazing = state.with_z(state.z + step[:-1]), grazing._replace(t=grazing.t + float(step[-1]))
        if size <= GRAZING_TOLERANCE:
            _require_order(family, state)
            _, gradient = _equations(family, state, grazing)
            extrema = [_touching(family, state, contact) for contact in contacts[1:]]
            touching = [contact for contact in extrema if contact is not None]
            return GrazingPoint(state, [grazing, *touching], gradient[0, :-1])
    raise NoConvergence("the grazing point does not converge", state.z[:-1], {}, [])


def _require_order(family: Family, state: CurveState) -> None:
    """Raise NoConvergence if switches are not in the order of their phases: the state solves other equations."""
    period = family(state.value).period
    if exchanges_of(state, period, SIMULTANEOUS_SWITCHES * period):
        raise NoConvergence("contact instants are exchanged before the grazing point", state.z[:-1], {}, [])


def first_grazing(
    family: Family, last: ExactPoint, point: ExactPoint, guesses: Sequence[Grazing], reach: float
) -> GrazingPoint:
    """Return the first of the grazing points between the last point and one without contacts at ``guesses``.

    ``reach`` is the largest distance from the last point.

    Raises
    ------
    NoConvergence
        If no grazing point converges, or all lie elsewhere.
    """
    candidates: list[tuple[float, GrazingPoint]] = []
    error = NoConvergence("the grazing point does not lie on the step", point.state.z, {}, [])
    for i, guess in enumerate(guesses):
        if any(_is_same_contact(guess, contact) for _, candidate in candidates for contact in candidate.contacts):
            continue
        try:
            candidate = locate_grazing(family, point.state, [*guesses[i:], *guesses[:i]], point.scale)
        except NoConvergence as failed:
            error = failed
            continue
        comparable = len(candidate.state.z) == len(last.state.z)
        distance = float((candidate.state.z - last.state.z) / last.scale @ last.tangent) if comparable else 0.0
        if -MAX_MISSED_DISTANCE < distance < reach:
            candidates.append((distance, candidate))
    if not candidates:
        raise error
    return min(candidates, key=lambda candidate: candidate[0])[1]


def _is_same_contact(a: Grazing, b: Grazing) -> bool:
    """Return whether two grazings are the same contact."""
    return a.switch == b.switch and abs(a.t - b.t) < SAME_GRAZING_DISTANCE


def _touching(family: Family, state: CurveState, grazing: Grazing) -> Grazing | None:
    """Return a contact at the extremum of its gap if it grazes at the state, else None."""
    grazing, distance = highest_point(family, state, grazing)
    size = float(np.abs(state.iterate.x).max())
    return grazing if abs(distance) <= SIMULTANEOUS_DISTANCE * size else None


def highest_point(family: Family, state: CurveState, grazing: Grazing) -> tuple[Grazing, float]:
    """Return the contact at the extremum of its gap near a phase, and the distance beyond the breakpoint there."""
    for _ in range(MAX_GRAZING_ITERATIONS):
        value, _, _, curvature = _distance(family, state, grazing)
        step = -float(value[1]) / (curvature or 1.0)
        grazing = grazing._replace(t=grazing.t + max(-MAX_PHASE_STEP, min(MAX_PHASE_STEP, step)))
        if abs(step) < SIMULTANEOUS_DISTANCE:
            break
    return grazing, float(_distance(family, state, grazing)[0][0])


def with_contacts(family: Family, point: GrazingPoint, scale: Array) -> tuple[CurveState, Array]:
    """Return the first state with the contacts of a grazing point, and the direction (scaled) in which they grow."""
    shortest = GRAZING_DURATION
    if len(point.contacts) > 1:
        try:
            ties = len(_with_short_contacts(family, point, scale, EQUAL_DURATION)[2])
        except NoConvergence:
            ties = 0
        shortest = GRAZING_DURATION if ties == len(point.contacts) - 1 else SIMULTANEOUS_DURATION
    return _with_short_contacts(family, point, scale, shortest)[:2]


def _with_short_contacts(
    family: Family, point: GrazingPoint, scale: Array, duration: float
) -> tuple[CurveState, Array, Array]:
    """Return the state with contacts of a duration over the period, its direction and its tied visits."""
    ode = family(point.state.value)
    delta = duration * ode.period
    missed = [MissedCrossing(t - 0.5 * delta, t + 0.5 * delta, switch) for t, switch in point.contacts]
    guess = CurveState.of(with_missed_crossings(ode, point.state.iterate, missed), point.state.value)
    switch = point.contacts[0].switch
    visits = [visit for visit in guess.pattern.visits if guess.pattern.switches[visit[0]] == switch]
    first, last = visits[int(np.argmin(guess.iterate.visit_durations(visits, ode.period)))]
    row = np.zeros(len(guess.z))
    row[guess.phase_column(first)], row[guess.phase_column(last)] = -1.0, 1.0
    size = guess.scale(scale[-1])
    state, linearised, *_ = correct(family, guess, row, size)
    return state, row, linearised.ties


def without_contacts(family: Family, state: CurveState, visits: Sequence[Visit]) -> tuple[CurveState, list[Grazing]]:
    """Return the state without contacts that vanish, as a guess, and the contacts as they graze."""
    iterate = state.iterate
    durations = iterate.visit_durations(visits, family(state.value).period)
    grazing = [
        Grazing(float(iterate.tau[i] + 0.5 * duration), iterate.pattern.switches[i])
        for (i, _), duration in zip(visits, durations, strict=True)
    ]
    return CurveState.of(iterate.without(visits), state.value), grazing
