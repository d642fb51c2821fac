"""Equations of a periodic motion in its contact instants and the states there, with their derivatives.

    x_{i+1} - [Psi_i(tau_{i+1}, tau_i) y_i]_x = 0,   y_i = (x_i, c(tau_i))       flow of segment i
    h_i = row_i y_i - breakpoint_i = 0                                          switching

The force is continuous, so the state and its disturbance are continuous at a switch, and the monodromy matrix is the
product of the flows. Where a contact becomes short, the second of its two switching equations becomes equal to the
first. It is therefore replaced by the difference divided by the duration,

    (h_j - h_i) / delta = sum_k row (Psi_k - 1) y_k / delta = 0,   k from i to j - 1

which is regular through delta = 0, where the contact is a grazing one. Switches of other elements may lie between i
and j: contacts of a symmetric machine begin and end at the same instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.instants import kernels
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.pattern import Pattern, Switch, Visit
from hbgear.harmonic.instants.propagation import segments_of

SIMULTANEOUS_SWITCHES = 1e-9
"""Duration, over the period, by which two switches may be in the wrong order: contacts of a symmetric machine switch at
the same instant up to rounding of 1e-15, and grazing contacts last for 2e-8."""


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
        out = np.empty(len(self.tau))
        out[:-1] = self.tau[1:] - self.tau[:-1]
        out[-1] = self.tau[0] + period - self.tau[-1]
        return out

    def visit_durations(self, visits: Sequence[Visit] | Array, period: float) -> Array:
        """Return the durations of visits (i, j) from switch i to switch j."""
        i, j = np.asarray(visits, dtype=np.int64).reshape(-1, 2).T
        return self.tau[j] - self.tau[i] + period * (j < i)

    def without(self, visits: Sequence[Visit]) -> Iterate:
        """Return the iterate without some visits; without switches, it begins after the last one of them."""
        pattern, removed = self.pattern, {switch for visit in visits for switch in visit}
        retained = [k for k in range(pattern.count) if k not in removed]
        if retained:
            return Iterate(pattern.without(visits), self.tau[retained], self.x[retained])
        firsts = {i for i, _ in visits}
        j = next(j for _, j in visits if (j + 1) % pattern.count in firsts)
        remaining = Pattern.of([Switch(-1, pattern.contacts[j].section, 0)], pattern.contacts[j].levels, 0)
        return Iterate(remaining, self.tau[[j]], self.x[[j]])


def linearise(ode: EquationsAt, iterate: Iterate, derivatives: bool = True) -> Linearisation:
    """Return the residual of the equations at an iterate, its ``derivatives`` J, empty without them, and the flows."""
    r, pattern, tau = ode.size, iterate.pattern, iterate.tau
    y = ode.extended_states(iterate.x, tau, pattern.sections)
    A, varying = ode.flows(pattern.contacts)
    segments = segments_of(A, varying, tau, iterate.durations(ode.period), y)
    switches = pattern.columns, *switching_rows(ode, pattern), pattern.divisible_visits
    R, J = kernels.periodicity(tuple(segments), switches, y, tau, ode.period, r, derivatives)
    return Linearisation(R, J, list(np.eye(r) + segments.Z[:, :r, :r]) if derivatives else [])


def switching_rows(ode: EquationsAt, pattern: Pattern) -> tuple[Array, Array]:
    """Return the rows (K, N) that map y to the gap of each switch, and its breakpoints (K,); zero for fixed phases."""
    stored = ode.structure.switching_rows.get(pattern)
    if stored is None:
        rows, levels = np.zeros((pattern.count, ode.size + ode.equations.count)), np.zeros(pattern.count)
        for i, (element, breakpoint, _) in enumerate(pattern.switches):
            if element >= 0:
                rows[i] = ode.gaps(pattern.contacts[i].section)[element]
                levels[i] = ode.equations.breakpoints[element][breakpoint]
        stored = ode.structure.switching_rows[pattern] = rows, levels
    return stored


def residual_scale(iterate: Iterate) -> float:
    """Return the size of the states, relative to which residuals are measured."""
    return float(np.abs(iterate.x).max(initial=0.0)) or 1.0


def monodromy_matrix(linearised: Linearisation) -> Array:
    """Return the product (r, r) of the flows."""
    P = linearised.flows[0]
    for flow in linearised.flows[1:]:
        P = flow @ P
    return P


def multipliers_of(P: Array) -> ComplexArray:
    """Return the multipliers (r,) of a monodromy matrix, largest modulus first."""
    mu = np.linalg.eigvals(P).astype(complex)
    return mu[np.argsort(-np.abs(mu), kind="stable")]
