"""Equations of a periodic motion in its contact instants and the states there, with their derivatives.

    x_{i+1} - [Psi_i(tau_{i+1}, tau_i) y_i]_x = 0,   y_i = (x_i, c(tau_i))       flow of segment i
    h_i = row_i y_i - breakpoint_i = 0                                          switching

The force is continuous, so the state and its disturbance are continuous at a switch, and the monodromy matrix is the
product of the flows. Where a contact becomes short, the second of its two switching equations becomes equal to the
first. It is therefore replaced by the difference divided by the duration,

    (h_j - h_i) / delta = sum_k row (Psi_k - 1) y_k / delta = 0,   k from i to j - 1

which is regular through delta = 0, where the contact is a grazing one. Switches of other elements may lie between i
and j: contacts of a symmetric machine begin and end at the same instants. Then the gap at the first switch of one short
contact determines its duration, and the durations of the others are equal to it: their own equations h_i = 0 have the
slope delta and would change them by rounding over delta.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import kernel
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.kernels import dot
from hbgear.harmonic.instants.pattern import Pattern, Switch, Visit
from hbgear.harmonic.instants.propagation import segments_of

SIMULTANEOUS_SWITCHES = 1e-9
"""Duration, over the period, by which two switches may be in the wrong order: contacts of a symmetric machine switch at
the same instant up to rounding of 1e-15, and grazing contacts last for 2e-8."""

SHORT_SEGMENT_RATIO = 0.25
"""Duration of a visit beyond a breakpoint, over the times to the switches of the same gap before and after it, below
which its second equation is divided by it."""

TIED_DURATION = 2e-4
"""Duration, over the period, up to which visits of the same duration have one unknown duration."""

TIE_ROUNDING = 1e-12
"""Rounding of a gap over its second derivative."""


class Linearisation(NamedTuple):
    """Residual (K r + F,), its derivatives in the states and the F free instants, flows of the states, tied visits.

    ``flows`` has the K matrices Psi_i, ``ties`` (T, 2, 2) visits with one of the same duration, see `tied_visits`.
    """

    R: Array
    J: Array
    flows: list[Array]
    ties: Array


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
    R, J, ties = periodicity(tuple(segments), switches, y, tau, ode.period, r, derivatives)
    return Linearisation(R, J, list(np.eye(r) + segments.Z[:, :r, :r]) if derivatives else [], ties)


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


# ---- compiled equations


@kernel
def short_visits(visits: Any, tau: Any, period: float) -> Any:
    """Return the first switch (K,) of the short visit that ends with each switch; -1 for the others.

    Parameters
    ----------
    visits : ndarray, shape (V, 3, 2)
        First and last switch of each visit, and of the intervals of its gap before and after it.
    tau, period : ndarray, shape (K,), and float
        Phases of the switches, and of a period.
    """
    first = np.full(tau.shape[0], -1)
    for v in range(visits.shape[0]):
        visit, before, after = visits[v, 0], visits[v, 1], visits[v, 2]
        nearest = min(_duration(before, tau, period), _duration(after, tau, period))
        if _duration(visit, tau, period) < SHORT_SEGMENT_RATIO * nearest:
            first[visit[1]] = visit[0]
    return first


@kernel
def _duration(visit: Any, tau: Any, period: float) -> float:
    """Return the duration of a visit from switch i to switch j."""
    i, j = visit[0], visit[1]
    return tau[j] - tau[i] + (period if j < i else 0.0)


@kernel
def periodicity(segments: Any, pattern: Any, y: Any, tau: Any, period: float, r: int, derivatives: bool) -> Any:
    """Return the residual R of the equations of a periodic motion, and its derivatives J.

    Parameters
    ----------
    segments : tuple of ndarray
        Z, change, begin, end and slope, see `constant_segments`.
    pattern : tuple of ndarray
        Column (K,), number of the instant of each switch among the free ones, -1 for a prescribed phase; rows (K, N) of
        the gap of each switch; levels (K,), its breakpoint; visits, see `short_visits`.
    y, tau, period : ndarray, shape (K, N), (K,), and float
        States and phases of the switches, and the period.
    r : int
        Number of states of the structure, the first entries of y.
    derivatives : bool
        Whether J is computed; it is empty if not.
    """
    column, rows, levels, visits = pattern
    change, K = segments[1], y.shape[0]
    size, first = K * r + column.max() + 1, short_visits(visits, tau, period)
    R = np.zeros(size)
    for k in range(K):
        after = (k + 1) % K
        for a in range(r):
            R[k * r + a] = y[after, a] - y[k, a] - change[k, a]
        if column[k] < 0:
            continue
        n = K * r + column[k]
        if first[k] < 0:
            R[n] = dot(rows[k], y[k]) - levels[k]
            continue
        i = first[k]
        while i != k:
            R[n] += dot(rows[k], change[i])
            i = (i + 1) % K
        R[n] /= _duration(np.array((first[k], k)), tau, period)
    ties = tied_visits(segments, pattern, first, y, tau, period)
    for t in range(ties.shape[0]):
        visit, reference = ties[t, 0], ties[t, 1]
        difference = _duration(visit, tau, period) - _duration(reference, tau, period)
        R[K * r + column[visit[0]]] = _tie_sign(segments, rows, visit[0]) * difference
    J = np.zeros((size, size) if derivatives else (0, 0))
    if derivatives:
        _periodicity_slopes(segments, column, r, J)
        for k in range(K):
            if column[k] < 0:
                continue
            if first[k] < 0:
                J[K * r + column[k], k * r : (k + 1) * r] = rows[k, :r]
                J[K * r + column[k], K * r + column[k]] = dot(rows[k, r:], segments[2][k, r:])
            else:
                visit = np.array((first[k], k))
                _divided_slopes(segments, column, rows[k], visit, _duration(visit, tau, period), R, r, J)
        for t in range(ties.shape[0]):
            visit, reference = ties[t, 0], ties[t, 1]
            n, sign = K * r + column[visit[0]], _tie_sign(segments, rows, visit[0])
            J[n] = 0.0
            for i, end in ((0, -sign), (1, sign)):
                J[n, K * r + column[visit[i]]] += end
                J[n, K * r + column[reference[i]]] -= end
    return R, J, ties


@kernel
def _tie_sign(segments: Any, rows: Any, i: int) -> float:
    """Return the sign of the equation of equal durations, with which the determinant of J keeps its sign."""
    return -1.0 if dot(rows[i], segments[2][i]) > 0 else 1.0


@kernel
def tied_visits(segments: Any, pattern: Any, first: Any, y: Any, tau: Any, period: float) -> Any:
    """Return short visits (T, 2, 2) with an earlier one of the same duration up to rounding of the gaps.

    The first switch of such a visit is nearly the second one: its phase is known to rounding of the gap over its slope.
    """
    rows, levels, visits = pattern[1], pattern[2], pattern[3]
    ties, count = np.empty((visits.shape[0], 2, 2), dtype=np.int64), 0
    for v in range(visits.shape[0]):
        visit = visits[v, 0]
        delta = _duration(visit, tau, period)
        if first[visit[1]] != visit[0] or first[visit[0]] >= 0 or not 0.0 < delta < TIED_DURATION * period:
            continue
        for w in range(v):
            other = visits[w, 0]
            if first[other[1]] != other[0] or first[other[0]] >= 0:
                continue
            length = _duration(other, tau, period)
            for end, sign in ((visit[0], 1.0), (other[0], -1.0)):  # the first switches after a step of Newton's method
                slope = dot(rows[end], segments[2][end])
                length -= sign * (dot(rows[end], y[end]) - levels[end]) / slope if slope != 0.0 else math.inf
            if delta * abs(delta - length) < TIE_ROUNDING:
                ties[count, 0], ties[count, 1] = visit, other
                count += 1
                break
    return ties[:count]


@kernel
def _begin_rate(Z: Any, begin: Any, a: int, r: int) -> float:
    """Return entry a of the derivative of the final state of a segment in its begin, with the sign of its advance."""
    return begin[a] + dot(Z[a, :r], begin[:r])


@kernel
def _periodicity_slopes(segments: Any, column: Any, r: int, J: Any) -> None:
    """Add the derivatives of the equations of continuity x_{i+1} - Psi_i y_i = 0."""
    Z, _, begin, end, _ = segments
    K = Z.shape[0]
    for k in range(K):
        after = (k + 1) % K
        for a in range(r):
            e = k * r + a
            J[e, after * r + a] += 1.0
            J[e, e] -= 1.0
            for b in range(r):
                J[e, k * r + b] -= Z[k, a, b]
            if column[k] >= 0:
                J[e, K * r + column[k]] += _begin_rate(Z[k], begin[k], a, r)
            if column[after] >= 0:
                J[e, K * r + column[after]] -= end[k, a]


@kernel
def _divided_slopes(segments: Any, column: Any, row: Any, visit: Any, delta: float, R: Any, r: int, J: Any) -> None:
    """Add the derivatives of the divided equation of a short visit."""
    Z, _, begin, end, slope = segments
    K, i, j = Z.shape[0], visit[0], visit[1]
    n, first, last = K * r + column[j], K * r + column[i], K * r + column[j]
    k = i
    while k != j:
        for b in range(r):
            for a in range(row.shape[0]):
                J[n, k * r + b] += row[a] * Z[k, a, b] / delta
        k = (k + 1) % K
    if (i + 1) % K == j:  # without cancellation
        change = dot(row, slope[i])
        J[n, last] += change
        J[n, first] -= change
        for a in range(row.shape[0]):
            J[n, first] += row[a] * dot(Z[i, a, r:], begin[i, r:]) / delta
        return
    k = i
    while k != j:
        after = (k + 1) % K
        for a in range(row.shape[0]):
            rate = begin[k, a] if a >= r else _begin_rate(Z[k], begin[k], a, r)
            J[n, K * r + column[k]] -= row[a] * rate / delta
            J[n, K * r + column[after]] += row[a] * end[k, a] / delta
        k = after
    J[n, first] += R[n] / delta
    J[n, last] -= R[n] / delta
