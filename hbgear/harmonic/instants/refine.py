"""Newton's method for exact periodic motions, at one Omega or at the nearest one where there is a motion.

    J du = -F(u, Omega)                          at fixed Omega
    [J F_Omega] (du, dOmega) = -F, least norm    where the motion does not exist at this Omega

u are contact instants and states, see `shooting`. A step is shortened so that no segment loses more than half of its
duration. Where a segment shrinks all the same, its two switches are removed (a contact that does not happen) or
exchanged (contacts of two elements); where a converged gap crosses a breakpoint in between, two switches are added.

The iteration has no step size in time and no tolerance but rounding: the result is a motion of the equations that are
given, not of a truncation of them.

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
from hbgear.harmonic.instants.checking import Missed, Samples, sampled
from hbgear.harmonic.instants.equations import Equations, EquationsAt
from hbgear.harmonic.instants.pattern import Inconsistent, Pattern, Switch, fixed_switches
from hbgear.harmonic.instants.propagation import growth
from hbgear.harmonic.instants.shooting import Iterate, linearise, residual_scale
from hbgear.mechanics.series.fourier import evaluate

_ITERATIONS = 25

_CONVERGED = 1e-10  # last step relative to states and instants

_RESIDUAL = 1e-11  # residual relative to the states

_SHRUNK = 4  # shortened steps one after the other, all by the same segment, from which it is taken to vanish

_CHANGES = 8  # of the order of switches

_MOST = 400  # switches of a period of the excitation

_NARROWEST = 1e-8  # duration of a new contact, over the period, at least

_EMPTY = 1e-14  # duration, over the period, that is rounding

_COMPARED = 64  # phases at which two motions are compared

_STEP = 1e-6  # relative difference of Omega


@dataclass(frozen=True, eq=False)
class ExactMotion:
    """A periodic motion of a piecewise-linear system, exact to rounding.

    Attributes
    ----------
    Omega : frequency of the excitation; other than the given one only from `refine_near_fold`.
    instants : (K,) phases tau, ascending within the nu periods of the motion, of the switches.
    switches : element, breakpoint and direction of each; element -1 is a corner of the excitation.
    states : (K, r) states there, see `equations`.
    multipliers : (r,) complex, largest modulus first.
    residual : of the equations, relative to the states.
    distance : largest distance of the gaps from the motion that it was computed from, relative to their largest
        way from end to end. Far from zero it is another motion of the same system: the caller must compare.
    shortest : duration (phase) of the shortest segment that ends with a contact instant; inf without contact.
    monodromy : (r, r).
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
    """A motion to start from: real Fourier rows (n, 2H + 1) of all coordinates, over nu periods of the excitation.

    crossings : phases tau at which gaps cross breakpoints, ascending, with element, number of the breakpoint and sign.
    """

    rows: Array
    crossings: Sequence[tuple[float, int, int, int]]


def refine(equations: Equations, approximation: Approximation, Omega: float, free: bool = False) -> ExactMotion:
    """The exact motion near an approximate one.

    Parameters
    ----------
    equations : of the system.
    approximation : its Fourier coefficients and contact instants.
    Omega : frequency of the excitation.
    free : whether Omega may change: the motion nearest in instants, states and Omega over their sizes.

    Raises
    ------
    NoConvergence
        If Newton's method does not converge, with the reason.
    """
    at = equations.at(Omega)
    try:
        at, iterate, samples = solve(at, initial(at, approximation), free)
    except Inconsistent as error:
        raise _failure(f"the order of contacts is inconsistent: {error}", Omega) from error
    return finished(at, iterate, samples, _distance(equations, approximation.rows, samples))


def solve(at: EquationsAt, iterate: Iterate, free: bool) -> tuple[EquationsAt, Iterate, Samples]:
    """Newton's method and the changes of the order of switches that it asks for."""
    for _ in range(_CHANGES):
        at, iterate, vanished = _newton(at, iterate, free)
        if vanished is not None:
            iterate = _closed(at, iterate, vanished)
            continue
        samples, missed = sampled(at, iterate)
        if not missed:
            return at, iterate, samples
        iterate = _opened(at, iterate, missed)
    raise _failure("the order of contacts keeps changing", at.Omega)


def initial(at: EquationsAt, approximation: Approximation) -> Iterate:
    """Switches and states of the approximate motion."""
    equations = at.equations
    events = [(tau, Switch(*rest)) for tau, *rest in approximation.crossings] + fixed_switches(equations)
    if len(events) > _MOST * equations.nu:
        raise _failure(f"more than {_MOST} contact instants in a period (chatter): {len(events)}", at.Omega)
    events = sorted(events, key=lambda event: event[0]) or [(0.0, Switch(-1, 0, 0))]
    tau = np.array([phase for phase, _ in events])
    longest = int(np.argmax(np.diff(np.append(tau, tau[0] + at.period))))
    ahead = np.roll(np.arange(len(tau)), -longest - 1)
    tau = np.where(ahead <= longest, tau[ahead] + at.period, tau[ahead])
    tau = tau - (at.period if tau[0] >= at.period else 0.0)
    middle = tau[-1] + 0.5 * (tau[0] + at.period - tau[-1])
    section = equations.section(middle)
    gaps = at.gaps(section) @ at.extended(at.state(approximation.rows, middle), middle, section)
    levels = [int(np.searchsorted(b, d)) for b, d in zip(equations.breakpoints, gaps, strict=True)]
    pattern = Pattern.of([events[i][1] for i in ahead.tolist()], levels, section)
    return Iterate(pattern, tau, np.array([at.state(approximation.rows, t) for t in tau.tolist()]))


def _newton(at: EquationsAt, iterate: Iterate, free: bool) -> tuple[EquationsAt, Iterate, int | None]:
    """A solution with the switches as they are, or the number of a segment that vanishes."""
    vanishing, times = -1, 0
    for _ in range(_ITERATIONS):
        empty = _empty(at, iterate)
        if empty is not None:
            return at, iterate, empty
        now = linearise(at, iterate)
        step, dOmega = _step(at, iterate, now.R, now.J, free)
        share, segment = _shortened(at, iterate, step)
        times = times + 1 if share < 1.0 and segment == vanishing else 1
        vanishing = segment if share < 1.0 else -1
        if share < 1.0 and times >= _SHRUNK:
            return at, iterate, segment
        if dOmega:
            limited = max(-0.05, min(0.05, share * dOmega / at.Omega))
            at = at.equations.at(at.Omega * (1.0 + limited))
        iterate = _moved(iterate, share * step)
        size = residual_scale(iterate)
        if not np.isfinite(iterate.x).all() or size > 1e12:
            break
        small = float(np.abs(step[: iterate.x.size]).max(initial=0.0)) <= _CONVERGED * size
        still = float(np.abs(step[iterate.x.size :]).max(initial=0.0)) <= 1e3 * _CONVERGED
        if share == 1.0 and small and still and float(np.abs(now.R).max(initial=0.0)) <= _RESIDUAL * size * 1e3:
            return at, iterate, None
    raise _failure(
        f"Newton's method in {iterate.pattern.count} contact instants does not converge"
        + ("" if free else ": there may be no motion at this Omega (beside a fold)"),
        at.Omega,
    )


def _empty(at: EquationsAt, iterate: Iterate) -> int | None:
    """A contact without duration, whose equation would be divided by zero."""
    switches, durations = iterate.pattern.switches, iterate.durations(at.period)
    for i in np.flatnonzero(durations <= _EMPTY * at.period).tolist():
        if switches[i].opposite(switches[(i + 1) % len(switches)]):
            return int(i)
    return None


def _step(at: EquationsAt, iterate: Iterate, R: Array, J: Array, free: bool) -> tuple[Array, float]:
    if not free:
        try:
            return np.linalg.solve(J, -R), 0.0
        except np.linalg.LinAlgError as error:
            raise _failure("the equations of the contact instants are singular", at.Omega) from error
    h = _STEP * at.Omega
    up, down = (linearise(at.equations.at(at.Omega + d), iterate).R for d in (h, -h))
    scale = np.ones(len(R) + 1)
    scale[: iterate.x.size] = residual_scale(iterate)
    scale[-1] = at.Omega
    whole = np.column_stack([J, (up - down) / (2 * h)]) * scale
    step = scale * np.linalg.lstsq(whole, -R, rcond=1e-14)[0]
    return step[:-1], float(step[-1])


def _shortened(at: EquationsAt, iterate: Iterate, step: Array) -> tuple[float, int]:
    """Share of a step that takes at most half of the duration of each segment, and the segment that limits it."""
    moves = np.zeros(iterate.pattern.count)
    moves[[i for i, switch in enumerate(iterate.pattern.switches) if not switch.is_fixed]] = step[iterate.x.size :]
    loss = moves - np.roll(moves, -1)
    ratio = loss / (0.5 * iterate.durations(at.period))
    segment = int(np.argmax(ratio))
    return float(min(1.0, 1.0 / max(ratio[segment], 1e-300))), segment


def _moved(iterate: Iterate, step: Array) -> Iterate:
    tau = iterate.tau.copy()
    tau[[i for i, switch in enumerate(iterate.pattern.switches) if not switch.is_fixed]] += step[iterate.x.size :]
    return Iterate(iterate.pattern, tau, iterate.x + step[: iterate.x.size].reshape(iterate.x.shape))


def _closed(at: EquationsAt, iterate: Iterate, i: int) -> Iterate:
    """With the switches at the ends of a segment that vanishes removed, or exchanged."""
    pattern, j = iterate.pattern, (i + 1) % iterate.pattern.count
    if pattern.switches[i].opposite(pattern.switches[j]):
        kept = [k for k in range(pattern.count) if k not in (i, j)]
        if not kept:
            start = Pattern.of([Switch(-1, pattern.contacts[j].section, 0)], pattern.contacts[j].levels, 0)
            return Iterate(start, iterate.tau[[j]], iterate.x[[j]])
        return Iterate(pattern.without(i), iterate.tau[kept], iterate.x[kept])
    if pattern.switches[i].element == pattern.switches[j].element or j == 0:
        raise _failure("two contact instants of an element meet", at.Omega)
    tau, width = iterate.tau.copy(), float(iterate.tau[j] - iterate.tau[i])
    if pattern.switches[i].is_fixed:
        tau[[i, j]] -= width
    elif pattern.switches[j].is_fixed:
        tau[[i, j]] += width
    return Iterate(pattern.swapped(i), tau, iterate.x)


def _opened(at: EquationsAt, iterate: Iterate, missed: list[Missed]) -> Iterate:
    """With the switches added that a solution lacks."""
    pattern, period = iterate.pattern, at.period
    events = [(float(t), s, x) for t, s, x in zip(iterate.tau, pattern.switches, iterate.x, strict=True)]
    artificial = pattern.count == 1 and pattern.switches[0].is_fixed and not fixed_switches(at.equations)
    for begin, end, first in missed:
        end = max(end, begin + _NARROWEST * period)
        back = Switch(first.element, first.corner, -first.sign)
        for t, switch in ((begin, first), (end, back)):
            events.append((t, switch, _state_at(at, iterate, t)))
    if artificial:
        events = events[1:]
    start = float(iterate.tau[0])
    events.sort(key=lambda event: (event[0] - start) % period)
    if len(events) > _MOST * at.equations.nu:
        raise _failure(f"more than {_MOST} contact instants in a period (chatter)", at.Omega)
    tau = np.array([start + (t - start) % period for t, _, _ in events])
    before = pattern.contacts[-1] if not artificial else pattern.contacts[0]
    return Iterate(
        Pattern.of([s for _, s, _ in events], before.levels, before.section), tau, np.array([x for *_, x in events])
    )


def _state_at(at: EquationsAt, iterate: Iterate, tau: float) -> Array:
    i = int(np.searchsorted(iterate.tau, tau, side="right")) - 1
    contacts, start = iterate.pattern.contacts[i], float(iterate.tau[i])
    y = at.extended(iterate.x[i], start, contacts.section)
    x: Array = (y + growth(at.flow(contacts), start, tau - start) @ y)[: at.size]
    return x


def finished(at: EquationsAt, iterate: Iterate, samples: Samples, distance: float) -> ExactMotion:
    """The result of a converged iterate."""
    now = linearise(at, iterate)
    monodromy = now.flows[0]
    for flow in now.flows[1:]:
        monodromy = flow @ monodromy
    mu = np.linalg.eigvals(monodromy).astype(complex)
    durations = iterate.durations(at.period)
    ends = [i for i in range(iterate.pattern.count) if not iterate.pattern.switches[(i + 1) % len(durations)].is_fixed]
    order = np.argsort(iterate.tau % at.period)
    return ExactMotion(
        Omega=at.Omega,
        instants=(iterate.tau % at.period)[order],
        switches=tuple(iterate.pattern.switches[i] for i in order.tolist()),
        states=iterate.x[order],
        multipliers=mu[np.argsort(-np.abs(mu), kind="stable")],
        residual=float(np.abs(now.R).max(initial=0.0)) / residual_scale(iterate),
        distance=distance,
        shortest=float(durations[ends].min()) if ends else float("inf"),
        monodromy=monodromy,
        samples=samples,
    )


def _distance(equations: Equations, rows: Array, samples: Samples) -> float:
    """Largest distance of the gaps from those of Fourier rows, relative to their largest way from end to end."""
    some = slice(None, None, max(1, len(samples.tau) // _COMPARED))
    tau, elements = samples.tau[some], equations.system.elements
    given = evaluate(equations.system.W.T @ rows, tau / equations.nu).T
    given -= np.stack([e.displacement(tau) for e in elements], axis=-1)
    size = float(np.ptp(samples.gaps, axis=0).max(initial=0.0)) or 1.0
    return float(np.abs(given - samples.gaps[some]).max(initial=0.0)) / size


def _failure(reason: str, Omega: float) -> NoConvergence:
    return NoConvergence(f"no exact motion: {reason}", np.empty(0), {"Omega": Omega}, [])
