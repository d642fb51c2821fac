"""Newton's method for exact periodic motions, at one Omega or at the nearest one at which there is a motion.

    J du = -F(u, Omega)                          at fixed Omega
    [J F_Omega] (du, dOmega) = -F, least norm    where the motion does not exist at this Omega

u are contact instants and states, see `shooting`. A step is shortened so that no segment loses more than half of its
duration. If a segment still shrinks, its two switches are removed (a contact that does not occur) or exchanged
(contacts of two elements). If a converged gap crosses a breakpoint between two switches, two switches are added.

The iteration has no time step, and rounding is its only tolerance: the result is a motion of the given equations, not
of truncated ones.

References
----------
Stoer & Bulirsch, Introduction to Numerical Analysis (2002), section 7.3, https://doi.org/10.1007/978-0-387-21738-3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.instants.equations import Equations, EquationsAt
from hbgear.harmonic.instants.pattern import InconsistentPatternError, Pattern, Switch, fixed_switches
from hbgear.harmonic.instants.propagation import growth
from hbgear.harmonic.instants.sampling import MissedCrossing, Samples, sample_gaps
from hbgear.harmonic.instants.shooting import (
    SIMULTANEOUS_SWITCHES,
    Iterate,
    linearise,
    monodromy_matrix,
    multipliers_of,
    residual_scale,
)
from hbgear.mechanics.series.fourier import evaluate

MAX_INSTANT_ITERATIONS = 25
"""Largest number of Newton iterations with one order of switches."""

INSTANT_STEP_TOLERANCE = 1e-10
"""Last step, relative to states and instants, at convergence."""

INSTANT_RESIDUAL_TOLERANCE = 1e-11
"""Residual, relative to the states, at convergence."""

MAX_SHORTENED_STEPS = 4
"""Number of successive steps, shortened by the same segment, after which that segment vanishes."""

MAX_ORDER_CHANGES = 8
"""Largest number of changes of the order of switches."""

MAX_SWITCHES_PER_PERIOD = 400
"""Largest number of switches in a period of the excitation."""

BOUNCING_INSTANTS = 10
"""Number of contact instants of an element in a period from which a failure is explained by its bouncing."""

MIN_CONTACT_DURATION = 1e-8
"""Shortest duration of a new contact, over the period."""

EMPTY_DURATION = 1e-14
"""Duration, over the period, up to which a contact is empty."""

COMPARED_PHASES = 64
"""Number of phases at which two motions are compared."""

FREQUENCY_STEP = 1e-6
"""Relative finite-difference step of Omega."""


@dataclass(frozen=True, eq=False)
class ExactMotion:
    """A periodic motion of a piecewise-linear system, exact to rounding.

    Attributes
    ----------
    Omega : float
        Frequency of the excitation. It differs from the given one only if it was free.
    instants : ndarray, shape (K,)
        Phases tau of the switches, ascending within the nu periods of the motion.
    switches : tuple of Switch
        Element, breakpoint and direction of each switch; element -1 is a breakpoint of the excitation.
    states : ndarray, shape (K, r)
        States at the switches, see `equations`.
    multipliers : ndarray, shape (r,)
        Complex multipliers, largest modulus first.
    residual : float
        Residual of the equations, relative to the states.
    distance : float
        Largest distance of the gaps from the initial motion, relative to their largest peak-to-peak value. A distance
        far from zero means another motion of the same system: the caller must check it.
    shortest : float
        Duration (phase) of the shortest segment that ends with a contact instant; inf without contact.
    monodromy : ndarray, shape (r, r)
        Monodromy matrix of the state.
    samples : Samples
        Gaps over one period.
    """

    Omega: float
    instants: Array
    switches: tuple[Switch, ...]
    states: Array
    multipliers: ComplexArray
    residual: float
    distance: float
    shortest: float
    monodromy: Array
    samples: Samples


@dataclass(frozen=True)
class Approximation:
    """An initial motion: real Fourier coefficients (n, 2H + 1) of all coordinates, over nu periods of the excitation.

    crossings : phases tau at which gaps cross breakpoints, ascending, with element, number of the breakpoint and sign.
    """

    rows: Array
    crossings: Sequence[tuple[float, int, int, int]]


def refine(equations: Equations, approximation: Approximation, Omega: float, free: bool = False) -> ExactMotion:
    """Compute the exact motion near an approximate one.

    If Omega is ``free``, the motion is the nearest one in instants, states and Omega, each relative to its size.

    Raises
    ------
    NoConvergence
        If Newton's method does not converge; the message states the reason.
    """
    ode = equations.at(Omega)
    try:
        ode, iterate, samples = solve(ode, initial(ode, approximation), free)
    except InconsistentPatternError as error:
        raise _failure(f"the order of contacts is inconsistent: {error}", Omega) from error
    return exact_motion_of(ode, iterate, samples, _distance(equations, approximation.rows, samples))


def solve(ode: EquationsAt, iterate: Iterate, free: bool) -> tuple[EquationsAt, Iterate, Samples]:
    """Solve by Newton's method, and change the order of switches where a segment vanishes or a crossing is missed."""
    for _ in range(MAX_ORDER_CHANGES):
        ode, iterate, segment = _newton(ode, iterate, free)
        if segment is not None:
            iterate = _without_segment(ode, iterate, segment)
            continue
        samples, missed = sample_gaps(ode, iterate)
        if not missed:
            return ode, iterate, samples
        iterate = with_missed_crossings(ode, iterate, missed)
    raise _failure("the order of contacts keeps changing", ode.Omega)


def initial(ode: EquationsAt, approximation: Approximation) -> Iterate:
    """Return switches and states of the approximate motion."""
    equations = ode.equations
    events = [(tau, Switch(*switch)) for tau, *switch in approximation.crossings] + fixed_switches(equations)
    if len(events) > MAX_SWITCHES_PER_PERIOD * equations.nu:
        raise _failure(
            f"more than {MAX_SWITCHES_PER_PERIOD} contact instants in a period (chatter): {len(events)}", ode.Omega
        )
    events = sorted(events, key=lambda event: event[0]) or [(0.0, Switch(-1, 0, 0))]
    tau = np.array([phase for phase, _ in events])
    # the period begins after its longest segment, in whose middle the contacts are certain
    longest = int(np.argmax(np.diff(np.append(tau, tau[0] + ode.period))))
    rotation = np.roll(np.arange(len(tau)), -longest - 1)
    tau = np.where(rotation <= longest, tau[rotation] + ode.period, tau[rotation])
    tau = tau - (ode.period if tau[0] >= ode.period else 0.0)
    middle = tau[-1] + 0.5 * (tau[0] + ode.period - tau[-1])
    section = equations.section(middle)
    gaps = ode.gaps(section) @ ode.extended(ode.state(approximation.rows, middle), middle, section)
    levels = [int(np.searchsorted(b, d)) for b, d in zip(equations.breakpoints, gaps, strict=True)]
    pattern = Pattern.of([events[i][1] for i in rotation.tolist()], levels, section)
    return Iterate(pattern, tau, np.array([ode.state(approximation.rows, t) for t in tau.tolist()]))


def _newton(ode: EquationsAt, iterate: Iterate, free: bool) -> tuple[EquationsAt, Iterate, int | None]:
    """Return a solution with the given switches, or the number of a segment that vanishes."""
    vanishing, repetitions = -1, 0
    for _ in range(MAX_INSTANT_ITERATIONS):
        empty = _empty_contact(ode, iterate)
        if empty is not None:
            return ode, iterate, empty
        linearised = linearise(ode, iterate)
        step, dOmega = _step(ode, iterate, linearised.R, linearised.J, free)
        factor, segment = _step_factor(ode, iterate, step)
        repetitions = repetitions + 1 if factor < 1.0 and segment == vanishing else 1
        vanishing = segment if factor < 1.0 else -1
        if factor < 1.0 and repetitions >= MAX_SHORTENED_STEPS:
            return ode, iterate, segment
        if dOmega:
            change = max(-0.05, min(0.05, factor * dOmega / ode.Omega))
            ode = ode.equations.at(ode.Omega * (1.0 + change))
        iterate = _advanced(iterate, factor * step)
        size = residual_scale(iterate)
        if not np.isfinite(iterate.x).all() or size > 1e12:
            break
        step_converged = float(np.abs(step[: iterate.x.size]).max(initial=0.0)) <= INSTANT_STEP_TOLERANCE * size
        instants_converged = float(np.abs(step[iterate.x.size :]).max(initial=0.0)) <= 1e3 * INSTANT_STEP_TOLERANCE
        if (
            factor == 1.0
            and step_converged
            and instants_converged
            and float(np.abs(linearised.R).max(initial=0.0)) <= INSTANT_RESIDUAL_TOLERANCE * size * 1e3
        ):
            return ode, iterate, None
    count = iterate.pattern.count
    bounces = count > BOUNCING_INSTANTS * len(ode.equations.breakpoints) * ode.equations.nu
    reason = "an element bounces: begin the curve where it has fewer contacts in a period, at a larger Omega"
    raise _failure(
        f"Newton's method in {count} contact instants does not converge"
        + ("" if free else f": {reason}" if bounces else ": there may be no motion at this Omega (close to a fold)"),
        ode.Omega,
    )


def _empty_contact(ode: EquationsAt, iterate: Iterate) -> int | None:
    """Return a contact without duration, whose equation would be divided by zero; None without one."""
    switches, durations = iterate.pattern.switches, iterate.durations(ode.period)
    for i in np.flatnonzero(durations <= EMPTY_DURATION * ode.period).tolist():
        if switches[i].opposite(switches[(i + 1) % len(switches)]):
            return int(i)
    return None


def _step(ode: EquationsAt, iterate: Iterate, R: Array, J: Array, free: bool) -> tuple[Array, float]:
    """Return the Newton step, and the change of Omega if it is free."""
    if not free:
        try:
            return np.linalg.solve(J, -R), 0.0
        except np.linalg.LinAlgError as error:
            raise _failure("the equations of the contact instants are singular", ode.Omega) from error
    h = FREQUENCY_STEP * ode.Omega
    above, below = (linearise(ode.equations.at(ode.Omega + d), iterate).R for d in (h, -h))
    scale = np.ones(len(R) + 1)
    scale[: iterate.x.size] = residual_scale(iterate)
    scale[-1] = ode.Omega
    bordered = np.column_stack([J, (above - below) / (2 * h)]) * scale
    if not np.isfinite(bordered).all():  # a contact without duration, about whose equation LAPACK would print a message
        raise _failure("two contact instants of an element meet", ode.Omega)
    step = scale * np.linalg.lstsq(bordered, -R, rcond=1e-14)[0]
    return step[:-1], float(step[-1])


def _step_factor(ode: EquationsAt, iterate: Iterate, step: Array) -> tuple[float, int]:
    """Return the factor of a step that takes at most half of the duration of each segment, and the limiting segment.

    Switches of two elements may be in the wrong order by rounding.
    """
    pattern, free = iterate.pattern, iterate.pattern.free
    phase_steps = np.zeros(pattern.count)
    phase_steps[free] = step[iterate.x.size :]
    loss = phase_steps - np.roll(phase_steps, -1)
    elements = np.array([switch.element for switch in pattern.switches])
    separable = free & np.roll(free, -1) & (elements != np.roll(elements, -1))
    shortest = np.where(separable, SIMULTANEOUS_SWITCHES * ode.period, np.finfo(float).tiny)  # a segment may be empty
    ratio = loss / np.maximum(0.5 * iterate.durations(ode.period), shortest)
    segment = int(np.argmax(ratio))
    return float(min(1.0, 1.0 / max(ratio[segment], 1e-300))), segment


def _advanced(iterate: Iterate, step: Array) -> Iterate:
    """Return the iterate after a step."""
    tau = iterate.tau.copy()
    tau[iterate.pattern.free] += step[iterate.x.size :]
    return Iterate(iterate.pattern, tau, iterate.x + step[: iterate.x.size].reshape(iterate.x.shape))


def _without_segment(ode: EquationsAt, iterate: Iterate, i: int) -> Iterate:
    """Return the iterate with the switches at the ends of a vanishing segment removed or exchanged."""
    pattern, j = iterate.pattern, (i + 1) % iterate.pattern.count
    if pattern.switches[i].opposite(pattern.switches[j]):
        return iterate.without([(i, j)])
    if pattern.switches[i].element == pattern.switches[j].element or j == 0:
        raise _failure("two contact instants of an element meet", ode.Omega)
    tau, width = iterate.tau.copy(), float(iterate.tau[j] - iterate.tau[i])
    if pattern.switches[i].is_fixed:
        tau[[i, j]] -= width
    elif pattern.switches[j].is_fixed:
        tau[[i, j]] += width
    return Iterate(pattern.swapped(i), tau, iterate.x)


def with_missed_crossings(ode: EquationsAt, iterate: Iterate, missed: list[MissedCrossing]) -> Iterate:
    """Return the iterate with switches added at missed crossings."""
    pattern, period = iterate.pattern, ode.period
    events = [(float(t), s, x) for t, s, x in zip(iterate.tau, pattern.switches, iterate.x, strict=True)]
    artificial = pattern.count == 1 and pattern.switches[0].is_fixed and not fixed_switches(ode.equations)
    start = float(iterate.tau[0]) - SIMULTANEOUS_SWITCHES * period  # simultaneous switches have any order
    for begin, end, first in missed:
        end = max(end, begin + MIN_CONTACT_DURATION * period)
        last = Switch(first.element, first.breakpoint, -first.sign)
        for t, switch in ((begin, first), (end, last)):
            events.append((start + (t - start) % period, switch, state_at(ode, iterate, t)))
    if artificial:
        events = events[1:]
    events.sort(key=lambda event: event[0])
    if len(events) > MAX_SWITCHES_PER_PERIOD * ode.equations.nu:
        raise _failure(f"more than {MAX_SWITCHES_PER_PERIOD} contact instants in a period (chatter)", ode.Omega)
    tau, switches, states = zip(*events, strict=True)
    before = pattern.contacts[-1] if not artificial else pattern.contacts[0]
    return Iterate(Pattern.of(switches, before.levels, before.section), np.array(tau), np.array(states))


def state_at(ode: EquationsAt, iterate: Iterate, tau: float) -> Array:
    """Return the state of an iterate at a phase."""
    i = int(np.searchsorted(iterate.tau, tau, side="right")) - 1
    contacts, start = iterate.pattern.contacts[i], float(iterate.tau[i])
    y = ode.extended(iterate.x[i], start, contacts.section)
    return (y + growth(ode.flow(contacts), start, tau - start) @ y)[: ode.size]


def exact_motion_of(ode: EquationsAt, iterate: Iterate, samples: Samples, distance: float) -> ExactMotion:
    """Return the result of a converged iterate."""
    linearised = linearise(ode, iterate)
    monodromy = monodromy_matrix(linearised)
    durations = iterate.durations(ode.period)
    ends = [i for i in range(iterate.pattern.count) if not iterate.pattern.switches[(i + 1) % len(durations)].is_fixed]
    order = np.argsort(iterate.tau % ode.period)
    return ExactMotion(
        Omega=ode.Omega,
        instants=(iterate.tau % ode.period)[order],
        switches=tuple(iterate.pattern.switches[i] for i in order.tolist()),
        states=iterate.x[order],
        multipliers=multipliers_of(monodromy),
        residual=float(np.abs(linearised.R).max(initial=0.0)) / residual_scale(iterate),
        distance=distance,
        shortest=float(durations[ends].min()) if ends else float("inf"),
        monodromy=monodromy,
        samples=samples,
    )


def _distance(equations: Equations, rows: Array, samples: Samples) -> float:
    """Return the largest distance of the gaps from Fourier coefficients, relative to the peak-to-peak value."""
    stride = slice(None, None, max(1, len(samples.tau) // COMPARED_PHASES))
    tau, elements = samples.tau[stride], equations.system.elements
    initial = evaluate(equations.system.W.T @ rows, tau / equations.nu).T
    initial -= np.stack([e.displacement(tau) for e in elements], axis=-1)
    size = float(np.ptp(samples.gaps, axis=0).max(initial=0.0)) or 1.0
    return float(np.abs(initial - samples.gaps[stride]).max(initial=0.0)) / size


def _failure(reason: str, Omega: float) -> NoConvergence:
    """Return an error with its reason."""
    return NoConvergence(f"no exact motion found: {reason}", np.empty(0), {"Omega": Omega}, [])
