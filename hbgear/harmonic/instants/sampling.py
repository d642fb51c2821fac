"""Gaps of exact motions between their switches: missed crossings and Fourier coefficients.

Newton's method solves for the given switches. A solution is a motion of the system only if no gap crosses a breakpoint
elsewhere. Gaps are sampled in steps in which the fastest motion of the structure turns by a fraction of a radian.

    c_k = 1 / T int_0^T d(tau) e^(-i k theta) dtau,   theta = tau / nu,   T = 2 pi nu

The integral is computed by Gauss quadrature on panels so short that 12 nodes integrate the fastest mode and the highest
harmonic to rounding. All gaps are values of the flow, not of an interpolation.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants import kernels
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.pattern import Switch
from hbgear.harmonic.instants.propagation import rates, taylor_steps, varying_states
from hbgear.harmonic.instants.shooting import SIMULTANEOUS_SWITCHES, Iterate
from hbgear.mechanics.series.fourier import to_real

MAX_STEP_OF_FLOW = 0.5
"""Largest product of the rate of the flow and the sampling step."""

MIN_SEGMENT_STEPS, MAX_SEGMENT_STEPS = 6, 400
"""Range of the number of sampling steps of a segment."""

CROSSING_ROUNDING = 1e-9
"""Distance beyond a breakpoint, relative to the size of the gap's motion, that is attributed to rounding."""

SAME_INSTANT = 1e-14
"""Difference of two phases, over the period, that is attributed to rounding."""

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(12)
"""Nodes and weights of the Gauss-Legendre rule of 12 points on [-1, 1], exact for polynomials of degree 23."""

PANEL_ANGLE = 6.0
"""Largest angle by which the product of two modes, or of a mode and a harmonic, turns in a panel; 12 nodes integrate it
to 1e-15."""


class MissedCrossing(NamedTuple):
    """A crossing without switch: phases at which a gap passes a breakpoint and returns."""

    begin: float
    end: float
    first: Switch


class Samples(NamedTuple):
    """Phases (T,) of all steps and the gaps (T, m) there."""

    tau: Array
    gaps: Array


def sample_gaps(ode: EquationsAt, iterate: Iterate) -> tuple[Samples, list[MissedCrossing]]:
    """Return the gaps over a period, and the crossings for which the iterate has no switches."""
    contacts, durations = iterate.pattern.contacts, iterate.durations(ode.period)
    flows = [ode.flow(segment) for segment in contacts]
    steps = np.array(
        [
            max(
                min(MAX_SEGMENT_STEPS, max(MIN_SEGMENT_STEPS, math.ceil(d * flow.rate / MAX_STEP_OF_FLOW))),
                taylor_steps(flow, d),
            )
            for d, flow in zip(durations.tolist(), flows, strict=True)
        ]
    )
    gaps, slopes = (
        values[:, 0]
        for values in _gaps_along(ode, iterate, np.arange(len(flows)), durations / steps, steps + 1, np.zeros(1))
    )
    step = np.concatenate([np.arange(count + 1) for count in steps])
    tau = np.repeat(iterate.tau, steps + 1) + np.repeat(durations / steps, steps + 1) * step
    bounds, missed = ode.equations.bounds(contacts), []
    rounding = CROSSING_ROUNDING, SIMULTANEOUS_SWITCHES * ode.period
    crossings = kernels.unexpected_crossings(tau, gaps, slopes, steps + 1, bounds, rounding)
    for k, j, side, begin, end in crossings.tolist():
        level = contacts[int(k)].levels[int(j)]
        missed.append(MissedCrossing(begin, end, Switch(int(j), level if side > 0 else level - 1, int(side))))
    inner = np.ones(len(tau), dtype=bool)
    inner[np.cumsum(steps + 1) - 1] = False  # the end of a segment is the begin of the next one
    return Samples(tau[inner], gaps[inner]), _merged_crossings(missed, ode.period)


def _merged_crossings(missed: list[MissedCrossing], period: float) -> list[MissedCrossing]:
    """Return the crossings after a merge of the two parts that a switch of another element separates."""
    out: list[MissedCrossing] = []
    for crossing in missed:  # in the order of the segments
        before = [k for k, other in enumerate(out) if _follows(other, crossing, period)]
        if before:
            out[before[0]] = out[before[0]]._replace(end=out[before[0]].end + crossing.end - crossing.begin)
        else:
            out.append(crossing)
    for crossing in out:  # the last segment of a period precedes the first
        after = [other for other in out if other is not crossing and _follows(crossing, other, period)]
        if after:
            others = [other for other in out if other is not crossing and other is not after[0]]
            return _merged_crossings(
                [*others, crossing._replace(end=crossing.end + after[0].end - after[0].begin)], period
            )
    return out


def _follows(first: MissedCrossing, second: MissedCrossing, period: float) -> bool:
    """Return whether a crossing begins where another one of the same gap ends."""
    return first.first == second.first and abs(math.remainder(first.end - second.begin, period)) < SAME_INSTANT * period


def coefficients(ode: EquationsAt, iterate: Iterate, H: int) -> tuple[Array, float]:
    """Return the real coefficients (m, 2H + 1) of all gaps, and the rms of the harmonics above H, the largest gap's."""
    nu, (tau, weights, gaps) = ode.equations.nu, _nodes(ode, iterate, H / ode.equations.nu)
    c = kernels.fourier_sums(tau / nu, weights, gaps, H) / ode.period
    power = np.abs(c[:, 0]) ** 2 + 2 * (np.abs(c[:, 1:]) ** 2).sum(axis=1)
    rms = math.sqrt(max(0.0, float((weights @ gaps**2 / ode.period - power).max(initial=0.0))))
    c[:, 1:] *= 2  # one-sided amplitudes
    return to_real(c), rms


def _nodes(ode: EquationsAt, iterate: Iterate, highest: float) -> tuple[Array, Array, Array]:
    """Return phases (T,), weights (T,) and gaps (T, m) at the nodes of all segments."""
    durations = iterate.durations(ode.period)
    segments = np.flatnonzero(durations > 0)
    flows = [ode.flow(iterate.pattern.contacts[i]) for i in segments]
    panels = np.array(
        [
            max(1, math.ceil(d * max(flow.rate + highest, 2 * flow.rate) / PANEL_ANGLE), taylor_steps(flow, d))
            for d, flow in zip(durations[segments].tolist(), flows, strict=True)
        ]
    )
    h, offsets = durations[segments] / panels, 0.5 * (1 + GAUSS_NODES)
    gaps = _gaps_along(ode, iterate, segments, h, panels, offsets)[0]
    panel = np.concatenate([np.arange(count) for count in panels])
    tau = np.repeat(iterate.tau[segments], panels)[:, None] + np.repeat(h, panels)[:, None] * (panel[:, None] + offsets)
    weights = 0.5 * np.multiply.outer(np.repeat(h, panels), GAUSS_WEIGHTS)
    return tau.ravel(), weights.ravel(), gaps.reshape(tau.size, -1)


def _gaps_along(
    ode: EquationsAt, iterate: Iterate, segments: Any, h: Array, panels: Any, offsets: Array
) -> tuple[Array, Array]:
    """Return gaps and their derivatives (P, G, m) at nodes of panels of duration h in some ``segments``."""
    contacts, starts = [iterate.pattern.contacts[i] for i in segments], iterate.tau[segments]
    sections, flows = [segment.section for segment in contacts], [ode.flow(segment) for segment in contacts]
    y = ode.extended_states(iterate.x[segments], starts, sections)
    rows = np.array([ode.gaps(section) for section in sections])
    gaps, slopes = kernels.gaps_along(np.array([flow.A for flow in flows]), y, rows, h, panels, offsets)
    ends = np.cumsum(panels)
    for k, flow in enumerate(flows):
        if flow.stiffness:
            tau = starts[k] + h[k] * np.add.outer(np.arange(panels[k]), offsets)
            duration = float(h[k] * panels[k])
            states = varying_states(flow, float(starts[k]), duration, int(panels[k]), y[k], offsets)
            block = slice(ends[k] - panels[k], ends[k])
            gaps[block], slopes[block] = states @ rows[k].T, rates(flow, tau, states) @ rows[k].T
    return gaps, slopes
