"""Check that the gaps of a solution stay between their breakpoints from one switch to the next.

Newton's method solves for the given switches. A solution is a motion of the system only if no gap crosses a breakpoint
elsewhere. Gaps are sample_gaps in steps in which the fastest motion of the structure turns by a fraction of a radian.
Between two samples an extremum is estimated by cubic interpolation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.equations import Contacts, EquationsAt, Flow
from hbgear.harmonic.instants.pattern import Switch
from hbgear.harmonic.instants.propagation import growth, growths, path, rates
from hbgear.harmonic.instants.shooting import Iterate

MAX_STEP_OF_FLOW = 0.5
"""Largest product of the rate of the flow and the sampling step."""

MIN_SEGMENT_STEPS, MAX_SEGMENT_STEPS = 6, 400
"""Range of the number of sampling steps of a segment."""

CROSSING_ROUNDING = 1e-9
"""Distance beyond a breakpoint, relative to the size of the gap's motion, that is attributed to rounding."""


class MissedCrossing(NamedTuple):
    """A crossing without switch: phases at which a gap passes a breakpoint and returns."""

    begin: float
    end: float
    first: Switch


class Samples(NamedTuple):
    """Phases (T,) of all steps and the gaps (T, m) there."""

    tau: Array
    gaps: Array


def sample_gaps(equations: EquationsAt, iterate: Iterate) -> tuple[Samples, list[MissedCrossing]]:
    """Return the gaps over a period, and the crossings for which the iterate has no switches."""
    durations, phases, gaps, missed = iterate.durations(equations.period), [], [], []
    contacts = iterate.pattern.contacts
    y = np.concatenate(
        [iterate.x, equations.equations.functions(iterate.tau, [one.section for one in contacts])], axis=1
    )
    flows = [equations.flow(one) for one in contacts]
    steps = [
        min(MAX_SEGMENT_STEPS, max(MIN_SEGMENT_STEPS, math.ceil(d * flow.rate / MAX_STEP_OF_FLOW)))
        for d, flow in zip(durations, flows, strict=True)
    ]
    growing = growths(flows, iterate.tau, durations / steps)
    for i in range(iterate.pattern.count):
        tau = float(iterate.tau[i]) + float(durations[i]) * np.arange(steps[i] + 1) / steps[i]
        states = _varying_states(flows[i], tau, y[i]) if flows[i].stiffness else path(growing[i], y[i], steps[i])
        segment_gaps, segment_missed = _missed_crossings(equations, contacts[i], flows[i], tau, states)
        tau, segment_gaps = tau[:-1], segment_gaps[:-1]
        phases.append(tau)
        gaps.append(segment_gaps)
        missed += segment_missed
    return Samples(np.concatenate(phases), np.concatenate(gaps)), missed


def _varying_states(flow: Flow, tau: Array, start: Array) -> Array:
    """Return the states (T, N) at equidistant phases (T,) from the first one, with varying stiffness."""
    y = np.empty((len(tau), len(start)))
    y[0], h = start, float(tau[1] - tau[0])
    for s in range(len(tau) - 1):
        y[s + 1] = y[s] + growth(flow, float(tau[s]), h) @ y[s]
    return y


def _missed_crossings(
    equations: EquationsAt, contacts: Contacts, flow: Flow, tau: Array, y: Array
) -> tuple[Array, list[MissedCrossing]]:
    """Return the gaps (T, m) at phases (T,) of a segment with states (T, N), and its missed crossings."""
    rows = equations.gaps(contacts.section)
    gaps, slopes = y @ rows.T, rates(flow, tau, y) @ rows.T
    missed = []
    for j, level in enumerate(contacts.levels):
        breakpoints = equations.equations.breakpoints[j]
        for breakpoint, side in ((level, 1), (level - 1, -1)):
            if 0 <= breakpoint < len(breakpoints):
                beyond = side * (gaps[:, j] - breakpoints[breakpoint])
                rounding = CROSSING_ROUNDING * max(np.ptp(gaps[:, j]), abs(breakpoints[breakpoint]))
                interval = _first_positive_interval(tau, beyond, side * slopes[:, j], rounding)
                if interval is not None:
                    missed.append(MissedCrossing(*interval, Switch(j, breakpoint, side)))
    return gaps, missed


def _first_positive_interval(tau: Array, h: Array, slope: Array, rounding: float) -> tuple[float, float] | None:
    """Return the interval where h (T,) is positive for the first time, by cubic interpolation; None if nowhere."""
    positive = np.flatnonzero(h[1:-1] > rounding) + 1
    if positive.size:
        first = int(positive[0])
        last = first
        while last + 1 < len(h) - 1 and h[last + 1] > rounding:
            last += 1
        return _linear_root(tau, h, first - 1), _linear_root(tau, h, last)
    for s in np.flatnonzero((slope[:-1] > 0) & (slope[1:] < 0)).tolist():
        maximum, offset = _cubic_maximum(h[s : s + 2], slope[s : s + 2], tau[s + 1] - tau[s])
        if maximum > rounding:
            width = math.sqrt(2 * maximum * (tau[s + 1] - tau[s]) / (slope[s] - slope[s + 1]))
            return max(tau[s] + offset - width, tau[s]), min(tau[s] + offset + width, tau[s + 1])
    return None


def _linear_root(tau: Array, h: Array, s: int) -> float:
    """Return the zero of the line between samples s and s + 1."""
    fraction = h[s] / (h[s] - h[s + 1]) if h[s] != h[s + 1] else 0.5
    return float(tau[s] + min(max(fraction, 0.0), 1.0) * (tau[s + 1] - tau[s]))


def _cubic_maximum(h: Array, slope: Array, width: float) -> tuple[float, float]:
    """Return the largest value of the cubic with these values and slopes at its ends, and its position."""
    a, b = slope * width
    c, d = 3 * (h[1] - h[0]) - 2 * a - b, 2 * (h[0] - h[1]) + a + b
    root = math.sqrt(max(c * c - 3 * d * a, 0.0))
    x = a / (root - c) if root > c else 0.5  # root of a + 2 c x + 3 d x^2 at a maximum
    x = min(max(x, 0.0), 1.0)
    return float(h[0] + x * (a + x * (c + x * d))), float(x * width)
