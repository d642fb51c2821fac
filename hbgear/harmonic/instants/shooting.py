"""Equations of a periodic motion in its contact instants and the states there, with their derivatives.

    x_{i+1} - [Psi_i(tau_{i+1}, tau_i) y_i]_x = 0,   y_i = (x_i, c(tau_i))       flow of segment i
    h_i = row_i y_i - breakpoint_i = 0                                          switching

The force is continuous, so the state and its disturbance are continuous at a switch, and the monodromy matrix is the
product of the flows. Where a contact becomes short, the second of its two switching equations becomes equal to the
first. It is therefore replaced by the difference divided by the duration,

    (h_{i+1} - h_i) / delta = row (Psi_i - 1) y_i / delta = 0

which is regular through delta = 0, where the contact is a grazing one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.pattern import Pattern
from hbgear.harmonic.instants.propagation import growth_rate_slope, growths, rates

SHORT_SEGMENT_RATIO = 0.25
"""Duration of a segment, over its shorter neighbour, below which its second equation is divided by it."""


class Linearisation(NamedTuple):
    """Residual (K r + F,), its derivatives in the states and the F free instants, and the flows Psi_i of the states."""

    R: Array
    J: Array
    flows: list[Array]


@dataclass
class Iterate:
    """States x (K, r) at the switches of a pattern, and the phases tau (K,) of the switches."""

    pattern: Pattern
    tau: Array
    x: Array

    def durations(self, period: float) -> Array:
        """Return the durations (K,) of the segments."""
        return np.diff(np.append(self.tau, self.tau[0] + period))


def divided_equations(iterate: Iterate, period: float) -> dict[int, int]:
    """Return the switches whose equation is divided, each with the segment that ends there."""
    duration, K, out = iterate.durations(period), iterate.pattern.count, {}
    switches = iterate.pattern.switches
    for i in range(K):
        j = (i + 1) % K
        neighbour = min(duration[i - 1], duration[j])
        if K > 1 and switches[i].opposite(switches[j]) and duration[i] < SHORT_SEGMENT_RATIO * neighbour:
            out[j] = i
    return out


def linearise(equations: EquationsAt, iterate: Iterate) -> Linearisation:
    """Return the residual of the equations at an iterate, its derivatives and the flows."""
    r, K, pattern = equations.size, iterate.pattern.count, iterate.pattern
    free = [i for i, switch in enumerate(pattern.switches) if not switch.is_fixed]
    column = {i: K * r + n for n, i in enumerate(free)}
    short = divided_equations(iterate, equations.period)
    duration = iterate.durations(equations.period)
    R, J, flows = np.zeros(K * r + len(free)), np.zeros((K * r + len(free),) * 2), []
    segments = [equations.flow(contacts) for contacts in pattern.contacts]
    growing = growths(segments, iterate.tau, duration)
    for i in range(K):
        j, contacts, tau = (i + 1) % K, pattern.contacts[i], float(iterate.tau[i])
        flow, y, Z = segments[i], equations.extended(iterate.x[i], tau, contacts.section), growing[i]
        rate = rates(flow, tau, y)
        change = Z @ y
        end = rates(flow, tau + duration[i], y + change)
        here, there = slice(i * r, i * r + r), slice(j * r, j * r + r)
        R[here] += iterate.x[j] - iterate.x[i] - change[:r]
        J[here, there] += np.eye(r)
        J[here, here] -= np.eye(r) + Z[:r, :r]
        back = np.concatenate([rate[:r], np.zeros(len(y) - r)])
        if i in column:
            J[here, column[i]] += rate[:r] + Z[:r] @ back
        if j in column:
            J[here, column[j]] -= end[:r]
        flows.append(np.eye(r) + Z[:r, :r])
        if i in column and i not in short:
            row = equations.gaps(contacts.section)[pattern.switches[i].element]
            level = equations.equations.breakpoints[pattern.switches[i].element][pattern.switches[i].breakpoint]
            R[column[i]] = row @ y - level
            J[column[i], here] = row[:r]
            J[column[i], column[i]] = row[r:] @ rate[r:]
        if short.get(j) == i:
            row, delta = equations.gaps(contacts.section)[pattern.switches[j].element], duration[i]
            slope = float(row @ growth_rate_slope(flow, tau, float(delta), Z) @ y)
            R[column[j]] = float(row @ change) / delta
            J[column[j], here] = row @ Z[:, :r] / delta
            J[column[j], column[j]] += slope
            J[column[j], column[i]] += float(row @ Z @ (rate - back)) / delta - slope
    return Linearisation(R, J, flows)


def residual_scale(iterate: Iterate) -> float:
    """Return the size of the states, relative to which residuals are measured."""
    return float(np.abs(iterate.x).max(initial=0.0)) or 1.0
