"""Points of a curve of exact motions with one order of switches: Newton's method with a free parameter, and tangents.

    F(u, p) = 0,   n (z - z_0) = 0        z = (u, p), u = states and contact instants, see `shooting`
    [F_u F_p] t = 0                       tangent t

The parameter p is Omega or a parameter of the model. Unknowns are scaled: states by the largest of them, instants by
one radian, the parameter by the width of its span.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.asymptote import MAX_TANGENT_MISS
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.pattern import Pattern
from hbgear.harmonic.instants.shooting import Iterate, Linearisation, linearise, residual_scale

Family = Callable[[float], EquationsAt]
"""The equations as a function of the continuation parameter."""

MAX_CORRECTOR_ITERATIONS = 13
"""Largest number of corrector iterations; a good prediction needs two to four."""

CORRECTOR_TOLERANCE = 1e-7
"""Scaled size of a Newton step after which the next one is the last."""

MAX_FINAL_STEP, NEGLIGIBLE_STEP = 1e-10, 1e-13
"""Scaled size of the last step, and the size up to which the flows before this step are those of the point. Multipliers
of a stop of k = 1e5 change by 2e-7 in a step of 1e-10, and tangents near a branch point by tens of degrees."""

PARAMETER_STEP = 1e-6
"""Relative finite-difference step of the parameter: truncation and rounding error are both near 1e-10."""

PREDICTED_LOSS = 0.55
"""Largest part of its duration that a contact loses in a predicted step."""

CLOSED_DISTANCE = 0.5
"""Distance from the first point, over the step, at which the chord passes it: the curve is closed."""

MAX_SEGMENT_LOSS = 0.6
"""Largest part of the duration of a contact that one Newton step may take."""


@dataclass(frozen=True, eq=False)
class CurveState:
    """A solution z = (u, p) with its pattern.

    Attributes
    ----------
    pattern : Pattern
        Order of the switches.
    z : ndarray, shape (K r + F + 1,)
        States at the K switches, phases of the F free switches, parameter.
    fixed : ndarray, shape (K,)
        Phases of the switches whose phase is prescribed; nan for the others.
    """

    pattern: Pattern
    z: Array
    fixed: Array

    @property
    def value(self) -> float:
        """The parameter."""
        return float(self.z[-1])

    @cached_property
    def iterate(self) -> Iterate:
        """States and phases of the switches."""
        x, phases = self._split(self.z)
        tau = self.fixed.copy()
        tau[self.pattern.free] = phases
        return Iterate(self.pattern, tau, x.reshape(self.pattern.count, -1))

    def _split(self, z: Array) -> tuple[Array, Array]:
        """Return the states and the free phases of z, or of a step of z."""
        first = len(z) - 1 - self.pattern.free_count
        return z[:first], z[first:-1]

    def phase_steps(self, step: Array) -> Array:
        """Return the changes (K,) of the phases of the switches by a step of z."""
        out = np.zeros(self.pattern.count)
        out[self.pattern.free] = self._split(step)[1]
        return out

    @staticmethod
    def of(iterate: Iterate, value: float) -> CurveState:
        """Return the state of an iterate at a value of the parameter."""
        free = iterate.pattern.free
        z = np.concatenate([iterate.x.ravel(), iterate.tau[free], [value]])
        return CurveState(iterate.pattern, z, np.where(free, np.nan, iterate.tau))

    def with_z(self, z: Array) -> CurveState:
        """Return the state with other values."""
        return CurveState(self.pattern, z, self.fixed)

    def enlarged(self, rate: Array, factor: float) -> CurveState:
        """Return the state extrapolated along dz/dr, r = |x|, to r -> inf, with states of the size ``factor`` r."""
        count = len(self._split(self.z)[0])
        r = float(np.linalg.norm(self.z[:count]))
        z = self.z + r * rate  # to first order in 1 / r
        z[:count] = factor * r * rate[:count]
        return self.with_z(z)

    def phase_column(self, i: int) -> int:
        """Return the entry of z that is the phase of switch i."""
        return len(self.z) - 1 - int(self.pattern.free[i:].sum())

    def scale(self, width: float) -> Array:
        """Return the scales of z."""
        scale = np.ones(len(self.z))
        self._split(scale)[0][:] = residual_scale(self.iterate)
        scale[-1] = width
        return scale


FORWARD_STEP = 1e-8
"""Relative forward-difference step of the parameter in a corrector."""

VALID_DISTANCE = 1e-5
"""Distance in scaled unknowns within which F_p is used again. Where dF/du is nearly singular, as close to a branch
point, its error of this order changes the direction of the tangent by several hundred times as much."""


def jacobian(family: Family, state: CurveState) -> tuple[Linearisation, Array]:
    """Return the linearised equations at a state, and [F_u F_p]."""
    linearised = linearise(family(state.value), state.iterate)
    return linearised, np.column_stack([linearised.J, parameter_column(family, state, state.value)])


def parameter_column(equations: Family, state: CurveState, value: float) -> Array:
    """Return the central difference of F in a parameter at a value, for the same states and instants."""
    h = PARAMETER_STEP * max(abs(value), 1e-3)
    above, below = (linearise(equations(value + d), state.iterate, False).R for d in (h, -h))
    return (above - below) / (2 * h)


def correct(
    family: Family, state: CurveState, row: Array, scale: Array
) -> tuple[CurveState, Linearisation, Array, int]:
    """Solve F = 0 in the plane through a state across ``row`` in scaled unknowns, see `solve_in_plane`."""
    z, linearised, J, iterations = solve_in_plane(lambda p: family(float(p[0])), state, state.z, row[None], scale)
    return state.with_z(z), linearised, J, iterations


def solve_in_plane(
    equations: Callable[[Array], EquationsAt], guess: CurveState, start: Array, normals: Array, scale: Array
) -> tuple[Array, Linearisation, Array, int]:
    """Solve F(u, p) = 0, normals (z - start) = 0 for the unknowns z = (u, p) with one or more parameters p (k,).

    ``start`` (n + k,) is a point of the plane, and ``normals`` (k, n + k) are its normals in unknowns with the
    ``scale`` (n + k,). ``guess`` has the pattern of the solution. F_p is computed by forward differences, again where
    the state has moved. The result is z, the linearised equations and [F_u F_p] there, and the number of iterations;
    NoConvergence is raised if Newton's method does not converge.
    """
    z, last_size, distance, k = start, math.inf, math.inf, len(normals)
    bordered = np.zeros((len(start), len(start)))
    bordered[-k:] = normals / scale
    for iteration in range(1, MAX_CORRECTOR_ITERATIONS + 1):
        state, p = guess.with_z(z[: len(guess.z)]), z[-k:]
        ode = equations(p)
        linearised = linearise(ode, state.iterate)
        bordered[:-k, :-k] = linearised.J
        # F_p takes one more evaluation for each parameter; near the last place it is used again
        if distance > VALID_DISTANCE:
            distance = 0.0
            for i, h in enumerate(FORWARD_STEP * np.maximum(np.abs(p), 1e-3)):
                shifted = equations(p + h * (np.arange(k) == i))
                bordered[:-k, i - k] = (linearise(shifted, state.iterate, False).R - linearised.R) / h
        rhs = -np.concatenate([linearised.R, normals @ ((z - start) / scale)])
        try:
            step = np.linalg.solve(bordered * scale, rhs) * scale
        except np.linalg.LinAlgError as error:
            raise _failed(state) from error
        size = float(np.abs(step / scale).max())
        if not np.isfinite(size) or size > 1e3:
            break
        if last_size <= CORRECTOR_TOLERANCE and size <= MAX_FINAL_STEP:
            z = z + step
            if size > NEGLIGIBLE_STEP:
                linearised = linearise(equations(z[-k:]), guess.with_z(z[: len(guess.z)]).iterate)
                bordered[:-k, :-k] = linearised.J
            return z, linearised, bordered[:-k].copy(), iteration
        factor = step_factor(state, step[: len(guess.z)], ode.period)
        z, last_size = z + factor * step, size if factor == 1.0 else math.inf
        distance += factor * size
    raise _failed(guess)


def _failed(state: CurveState) -> NoConvergence:
    """Return the error of a corrector without solution."""
    return NoConvergence(
        f"the corrector in {state.pattern.count} contact instants does not converge", state.z[:-1], {}, []
    )


def step_factor(state: CurveState, step: Array, period: float) -> float:
    """Return the factor of a step that takes at most a part of the duration of each contact."""
    pattern, phases = state.pattern, state.phase_steps(step)
    if not pattern.visits:
        return 1.0
    duration = state.iterate.visit_durations(pattern.visit_ends, period)
    i, j = pattern.visit_ends.T
    loss = (phases[i] - phases[j]) / np.maximum(MAX_SEGMENT_LOSS * np.abs(duration), np.finfo(float).tiny)
    return float(1.0 / max(1.0, loss.max()))


def tangent_of(J: Array, scale: Array, direction: Array) -> Array:
    """Return the unit null vector of [F_u F_p] in scaled unknowns, with the orientation of ``direction`` (scaled)."""
    bordered = np.vstack([J * scale, direction])
    rhs = np.zeros(len(bordered))
    rhs[-1] = 1.0
    try:
        t = np.linalg.solve(bordered, rhs)
    except np.linalg.LinAlgError:
        t = np.linalg.svd(J * scale)[2][-1]
        t = t if t @ direction >= 0 else -t
    return t / float(np.linalg.norm(t))


ENLARGEMENT = 1e12
"""Factor of a motion after which gaps, loads and prescribed displacements are rounding."""

MAX_TURN_TO_INFINITY, MAX_CHANGE_TO_INFINITY = 0.3, 0.02
"""Largest distance of the direction of the states, and relative distance of the parameter, from their extrapolation to
infinity, up to which an asymptote is searched."""

ASYMPTOTE_ROUNDING = 1e-9
"""Relative rounding of an asymptote."""


def asymptote_ahead(family: Family, state: CurveState, tangent: Array, width: float) -> float | None:
    """Return the value of the parameter at which motions grow without bound ahead of a point, else None.

        x = r y(r),   y and p have limits for r = |x| -> inf:   y = dx/dr,   p + r dp/dr   to first order in 1/r

    The equations are solved for a motion 1e12 times as large, for which gaps and loads are rounding. A finite resonance
    has no such solution. ``tangent`` is dz/ds.
    """
    count = len(state.z) - 1 - state.pattern.free_count
    x, r = state.z[:count], float(np.linalg.norm(state.z[:count]))
    growth = float(x @ tangent[:count]) / r
    if not growth > 0:
        return None
    rate = tangent / growth
    change, size = r * float(rate[-1]), abs(state.value)
    deviation = float(np.linalg.norm(rate[:count] - x / r))
    if deviation > MAX_TURN_TO_INFINITY or abs(change) > MAX_CHANGE_TO_INFINITY * size:
        return None
    enlarged = state.enlarged(rate, ENLARGEMENT)
    scale = enlarged.scale(width)
    row = np.append(enlarged.z[:count], np.zeros(len(scale) - count)) / scale
    try:
        limit = correct(family, enlarged, row / float(np.linalg.norm(row)), scale)[0].value
    except NoConvergence:
        return None
    allowed = MAX_TANGENT_MISS * abs(change) + ASYMPTOTE_ROUNDING * size
    return limit if abs(limit - enlarged.value) < allowed else None


def chord_passes(first: Array, before: Array, last: Array) -> bool:
    """Return whether the chord from the point before to the last one passes the first point, in scaled unknowns."""
    offset, chord = first - before, last - before
    length = float(np.linalg.norm(chord))
    s = float(offset @ chord) / length**2
    return 0 < s <= 1 and float(np.linalg.norm(offset - s * chord)) < CLOSED_DISTANCE * length**2


# ---- order of switches


def departure_states(state: CurveState, distance: float, unit: Array, period: float) -> tuple[CurveState, CurveState]:
    """Return the states at one distance and at one more unit in a direction, with switches ordered by phase.

    Contacts of different elements, simultaneous on a symmetric motion, separate in an order of their own.
    """
    start, ahead = state.with_z(state.z + distance * unit), state.with_z(state.z + (1 + distance) * unit)
    for i in exchanges_of(start, period, 0.0):
        start, ahead = (with_exchange(point, i, period) for point in (start, ahead))
    return start, ahead


def exchanges_of(state: CurveState, period: float, tolerance: float) -> list[int]:
    """Return the segments whose switches are exchanged one after the other until all are in the order of their phases.

    Raises
    ------
    NoConvergence
        If both switches belong to one element: its contact vanishes.
    """
    segments: list[int] = []
    while len(early := np.flatnonzero(state.iterate.durations(period) < -tolerance)):
        i, switches = int(early[0]), state.pattern.switches
        if switches[i].element == switches[(i + 1) % len(switches)].element or len(segments) > len(switches) ** 2:
            raise NoConvergence("a contact vanishes within one step", state.z, {}, [])
        segments.append(i)
        state = with_exchange(state, i, period)
    return segments


def with_exchange(state: CurveState, i: int, period: float) -> CurveState:
    """Return the state with switches i and i + 1 exchanged, without a correction."""
    iterate, j = state.iterate, (i + 1) % state.pattern.count
    if j == 0:
        iterate, i, j = _rotated(iterate, period), i - 1, i
    tau, x = iterate.tau.copy(), iterate.x.copy()
    tau[[i, j]], x[[i, j]] = tau[[j, i]], x[[j, i]]
    return CurveState.of(Iterate(iterate.pattern.swapped(i), tau, x), state.value)


def _rotated(iterate: Iterate, period: float) -> Iterate:
    """Return the iterate with its first switch as the last one."""
    switches, contacts = iterate.pattern.switches, iterate.pattern.contacts
    pattern = Pattern(switches[1:] + switches[:1], contacts[1:] + contacts[:1])
    tau = np.append(iterate.tau[1:], iterate.tau[0] + period)
    return Iterate(pattern, tau, np.roll(iterate.x, -1, axis=0))
