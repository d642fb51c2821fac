"""Whether the gaps of a solution stay between their breakpoints from one switch to the next.

Newton's method solves for the switches it is given. A solution is a motion of the system if no gap crosses a breakpoint
elsewhere. Gaps are looked at in steps of which the fastest motion of the structure makes a fraction of a turn; between
two of them an extremum is computed by Newton's method on the derivative.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.pattern import Switch
from hbgear.harmonic.instants.propagation import growth, rates
from hbgear.harmonic.instants.shooting import Iterate

_TURNS = 0.5  # rate of the flow times the step

_FEWEST, _MOST = 6, 400  # steps of a segment

_ROUNDING = 1e-9  # distance beyond a breakpoint, relative to the size of the gap's motion, that is rounding


class Missed(NamedTuple):
    """A crossing that the switches do not have: phases at which a gap passes a breakpoint and returns."""

    begin: float
    end: float
    first: Switch


class Samples(NamedTuple):
    """Phases (T,) of all steps and the gaps (T, m) there."""

    tau: Array
    gaps: Array


def sampled(equations: EquationsAt, iterate: Iterate) -> tuple[Samples, list[Missed]]:
    """The gaps over a period, and what the switches of the iterate miss."""
    durations, phases, gaps, missed = iterate.durations(equations.period), [], [], []
    for i in range(iterate.pattern.count):
        tau, some, found = _segment(equations, iterate, i, float(durations[i]))
        phases.append(tau)
        gaps.append(some)
        missed += found
    return Samples(np.concatenate(phases), np.concatenate(gaps)), missed


def _segment(equations: EquationsAt, iterate: Iterate, i: int, duration: float) -> tuple[Array, Array, list[Missed]]:
    contacts, start = iterate.pattern.contacts[i], float(iterate.tau[i])
    flow = equations.flow(contacts)
    steps = min(_MOST, max(_FEWEST, math.ceil(duration * flow.rate / _TURNS)))
    tau, h = start + duration * np.arange(steps + 1) / steps, duration / steps
    y = np.empty((steps + 1, len(flow.A)))
    y[0] = equations.extended(iterate.x[i], start, contacts.section)
    same = None if flow.stiffness else growth(flow, start, h)
    for s in range(steps):
        y[s + 1] = y[s] + (growth(flow, float(tau[s]), h) if same is None else same) @ y[s]
    rows = equations.gaps(contacts.section)
    gaps, slopes = y @ rows.T, rates(flow, tau, y) @ rows.T
    missed = []
    for j, level in enumerate(contacts.levels):
        breakpoints = equations.equations.breakpoints[j]
        for corner, side in ((level, 1), (level - 1, -1)):
            if 0 <= corner < len(breakpoints):
                beyond = side * (gaps[:, j] - breakpoints[corner])
                size = _ROUNDING * max(np.ptp(gaps[:, j]), abs(breakpoints[corner]))
                found = _beyond(tau, beyond, side * slopes[:, j], size)
                if found is not None:
                    missed.append(Missed(*found, Switch(j, corner, side)))
    return tau[:-1], gaps[:-1], missed


def _beyond(tau: Array, h: Array, slope: Array, rounding: float) -> tuple[float, float] | None:
    """Where h (T,) is positive for the first time, as estimated by cubic interpolation; None if nowhere."""
    over = np.flatnonzero(h[1:-1] > rounding) + 1
    if over.size:
        first = int(over[0])
        last = first
        while last + 1 < len(h) - 1 and h[last + 1] > rounding:
            last += 1
        return _root(tau, h, first - 1), _root(tau, h, last)
    for s in np.flatnonzero((slope[:-1] > 0) & (slope[1:] < 0)).tolist():
        top, at = _highest(h[s : s + 2], slope[s : s + 2], tau[s + 1] - tau[s])
        if top > rounding:
            width = math.sqrt(2 * top * (tau[s + 1] - tau[s]) / (slope[s] - slope[s + 1]))
            return max(tau[s] + at - width, tau[s]), min(tau[s] + at + width, tau[s + 1])
    return None


def _root(tau: Array, h: Array, s: int) -> float:
    """Zero of the chord between samples s and s + 1."""
    share = h[s] / (h[s] - h[s + 1]) if h[s] != h[s + 1] else 0.5
    return float(tau[s] + min(max(share, 0.0), 1.0) * (tau[s + 1] - tau[s]))


def _highest(h: Array, slope: Array, width: float) -> tuple[float, float]:
    """Largest value of the cubic with these values and slopes at its ends, and its place."""
    a, b = slope * width
    c, d = 3 * (h[1] - h[0]) - 2 * a - b, 2 * (h[0] - h[1]) + a + b
    root = math.sqrt(max(c * c - 3 * d * a, 0.0))
    x = a / (root - c) if root > c else 0.5  # root of a + 2 c x + 3 d x^2 at a maximum
    x = min(max(x, 0.0), 1.0)
    return float(h[0] + x * (a + x * (c + x * d))), float(x * width)
