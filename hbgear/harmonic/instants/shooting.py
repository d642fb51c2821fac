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

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.pattern import Pattern, Switch, Visit
from hbgear.harmonic.instants.propagation import growth_rate_slopes, growths, rates_of_each

SHORT_SEGMENT_RATIO = 0.25
"""Duration of a visit beyond a breakpoint, over the times to the switches of the same gap before and after it, below
which its second equation is divided by it."""


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

    def visit_durations(self, visits: Sequence[Visit], period: float) -> Array:
        """Return the durations of visits (i, j) from switch i to switch j."""
        return np.array([self.tau[j] - self.tau[i] + (period if j < i else 0.0) for i, j in visits])

    def without(self, visits: Sequence[Visit]) -> Iterate:
        """Return the iterate without some visits; without switches, it begins after the last one of them."""
        pattern, removed = self.pattern, {switch for visit in visits for switch in visit}
        kept = [k for k in range(pattern.count) if k not in removed]
        if kept:
            return Iterate(pattern.without(visits), self.tau[kept], self.x[kept])
        firsts = {i for i, _ in visits}
        j = next(j for _, j in visits if (j + 1) % pattern.count in firsts)
        outside = Pattern.of([Switch(-1, pattern.contacts[j].section, 0)], pattern.contacts[j].levels, 0)
        return Iterate(outside, self.tau[[j]], self.x[[j]])


def divided_equations(iterate: Iterate, period: float) -> dict[int, int]:
    """Return the switches whose equation is divided, each with the first switch of the visit that ends there."""
    visits = iterate.pattern.divisible_visits
    intervals = [interval for each in visits for interval in each]
    times = iterate.visit_durations(intervals, period).reshape(-1, 3)
    short = times[:, 0] < SHORT_SEGMENT_RATIO * times[:, 1:].min(axis=1)
    return {visits[n][0][1]: visits[n][0][0] for n in np.flatnonzero(short).tolist()}


def linearise(equations: EquationsAt, iterate: Iterate, derivatives: bool = True) -> Linearisation:
    """Return the residual of the equations at an iterate, its derivatives and the flows.

    Parameters
    ----------
    equations : EquationsAt
        Equations at one Omega.
    iterate : Iterate
        States and phases of the switches.
    derivatives : bool, optional
        Whether J is computed; if False it is empty. Default: True.
    """
    r, K, pattern = equations.size, iterate.pattern.count, iterate.pattern
    free = [i for i, switch in enumerate(pattern.switches) if not switch.is_fixed]
    column = {i: K * r + n for n, i in enumerate(free)}
    short = divided_equations(iterate, equations.period)
    duration, sections = iterate.durations(equations.period), [contacts.section for contacts in pattern.contacts]
    segments = [equations.flow(contacts) for contacts in pattern.contacts]
    Z = growths(segments, iterate.tau, duration)
    y = np.concatenate([iterate.x, equations.equations.functions(iterate.tau, sections)], axis=1)
    change = (Z @ y[..., None])[..., 0]
    rows, levels = _switching_rows(equations, pattern, free)
    whole = np.array([n for n, i in enumerate(free) if i not in short], dtype=int)
    at = np.array(free, dtype=int)[whole]
    R, each = np.empty(K * r + len(free)), np.arange(K)
    following = (each + 1) % K
    R[: K * r] = (iterate.x[following] - iterate.x - change[:, :r]).ravel()
    R[K * r + whole] = (rows[whole] * y[at]).sum(axis=1) - levels[whole]
    visits = [(i, j) for j, i in short.items()]
    own, delta = np.array([column[j] for j in short], dtype=int), iterate.visit_durations(visits, equations.period)
    row = rows[own - K * r]
    for n, (i, j) in enumerate(visits):
        R[own[n]] = float(row[n] @ change[pattern.segments_between(i, j)].sum(axis=0)) / delta[n]
    if not derivatives:
        return Linearisation(R, np.zeros((0, 0)), [])
    J, unit = np.zeros((len(R), len(R))), np.eye(r)
    states, phases = J[: K * r, : K * r].reshape(K, r, K, r), J[: K * r].reshape(K, r, -1)
    states[each, :, following] += unit
    states[each, :, each] -= unit + Z[:, :r, :r]
    rate, end = (rates_of_each(segments, *where) for where in ((iterate.tau, y), (iterate.tau + duration, y + change)))
    moved = rate[:, :r] + (Z[:, :r, :r] @ rate[:, :r, None])[..., 0]
    columns, switched = K * r + np.arange(len(free)), np.array(free, dtype=int)
    phases[switched, :, columns] += moved[switched]
    phases[switched - 1, :, columns] -= end[switched - 1, :r]
    equation = J[:, : K * r].reshape(-1, K, r)
    equation[K * r + whole, at] = rows[whole, :r]
    J[K * r + whole, K * r + whole] = (rows[whole, r:] * rate[at, r:]).sum(axis=1)
    single = np.array([n for n, (i, j) in enumerate(visits) if (j - i) % K == 1], dtype=int)
    if len(single):
        begins, at = np.array([visits[n][0] for n in single], dtype=int), own[single]
        chosen = [segments[i] for i in begins]
        slope = growth_rate_slopes(chosen, iterate.tau[begins], delta[single], Z[begins])
        slopes = (row[single] * (slope @ y[begins, :, None])[..., 0]).sum(axis=1)
        carried = (row[single, None] @ Z[begins])[:, 0] / delta[single, None]
        equation[at, begins] = carried[:, :r]
        J[at, at] += slopes
        J[at, [column[i] for i in begins]] += (carried[:, r:] * rate[begins, r:]).sum(axis=1) - slopes
    start = np.concatenate([moved, rate[:, r:]], axis=1)
    for n in set(range(len(visits))) - set(single.tolist()):
        i, j = visits[n]
        for k in pattern.segments_between(i, j):
            equation[own[n], k] += row[n] @ Z[k][:, :r] / delta[n]
            J[own[n], column[k]] -= row[n] @ start[k] / delta[n]
            J[own[n], column[(k + 1) % K]] += row[n] @ end[k] / delta[n]
        J[own[n], column[i]] += R[own[n]] / delta[n]
        J[own[n], column[j]] -= R[own[n]] / delta[n]
    return Linearisation(R, J, list(unit + Z[:, :r, :r]))


def _switching_rows(equations: EquationsAt, pattern: Pattern, free: list[int]) -> tuple[Array, Array]:
    """Return the rows (F, N) that map y to the gap of each free switch, and the breakpoints (F,)."""
    rows = np.empty((len(free), equations.size + equations.equations.count))
    levels = np.empty(len(free))
    for n, i in enumerate(free):
        element, breakpoint, _ = pattern.switches[i]
        rows[n] = equations.gaps(pattern.contacts[i].section)[element]
        levels[n] = equations.equations.breakpoints[element][breakpoint]
    return rows, levels


def residual_scale(iterate: Iterate) -> float:
    """Return the size of the states, relative to which residuals are measured."""
    return float(np.abs(iterate.x).max(initial=0.0)) or 1.0
