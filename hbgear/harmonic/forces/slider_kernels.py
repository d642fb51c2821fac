"""Kernels: exact projection of friction sliders, the memory of force laws.

    f = k (d - z) while a slider sticks,   f = +-limit while it slips,   |f| <= limit

Between two neighbouring turning points of the motion (d' = 0) d is monotonic. A slider at z then sticks until d reaches
z +- limit / k, slips up to the turning point, and sticks there at the new position z = d -+ limit / k. Two passes over
the turning points of a period give the steady state: after the first one the position repeats. The coefficients of the
force are those of the indicator functions s of the intervals a < theta < b,

    s_n = (exp(-i n a) - exp(-i n b)) / (2 pi i n),   s_0 = (b - a) / 2 pi
    kappa = k s,  chi = -k z s  (stick),      chi = +-limit s  (slip),      P = kappa d + chi

as of `hbgear.harmonic.forces.projection_kernels`. The force is continuous, so the ends of the intervals do not
contribute to its derivative. A slider that began to stick at the turning point theta_0 has dz = dd(theta_0), since
d'(theta_0) = 0: each interval subtracts k s (1, cos theta_0, sin theta_0, ...) from dP/dd. A slider that never slips
stays at its residual position, or where the motion has moved it.

References
----------
Petrov & Ewins (2003), J. Turbomach. 125(2), https://doi.org/10.1115/1.1539868, for exact friction forces.
Krasnosel'skii & Pokrovskii, Systems with Hysteresis (1989), https://doi.org/10.1007/978-3-642-61302-9, for the play.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import inlined, kernel
from hbgear.harmonic.forces.switching_times import PHASE_TOLERANCE, VALUE_ROUNDING, crossings
from hbgear.mechanics.series.fourier_kernels import fill_one_sided, sampled, value_of

STICK = 0
"""Kind of an interval in which a slider sticks; +1 and -1 are slips in the direction of the displacement."""

MAX_ROOT_ITERATIONS = 80
"""Iterations for the begin of a slip; bisection alone needs 52."""


class SliderWorkspace(NamedTuple):
    """Preallocated arrays for the motion of Q sliders, overwritten by `march`.

    Attributes
    ----------
    number : ndarray, shape (Q,)
        Number of intervals of each slider.
    begin, end : ndarray, shape (Q, I)
        Phases [rad] of the intervals; ``begin`` ascends over one period, from the first turning point.
    kind : ndarray, shape (Q, I)
        `STICK`, or the sign of the friction force while the slider slips.
    position, onset : ndarray, shape (Q, I)
        Position z while the slider sticks, and the turning point at which it reached z; -1 for the residual position.
    slips : ndarray, shape (Q,)
        Whether the slider slips in the period.
    span : ndarray, shape (Q,)
        Range of the displacement in the period, minus twice limit / k: positive if the slider slips.
    turn, side, level : ndarray, shape (C,)
        Phases of the turning points of one element, the direction of d' there, and the displacements.
    row, samples, waves : ndarray
        Working memory for the velocity and the displacement of an element.
    part : ndarray, shape (L,)
        Coefficients of an indicator function.
    column, line : ndarray, shape (2H + 1,)
        An indicator function in the real basis, and the values of the basis at a turning point.
    """

    number: np.ndarray
    begin: Array
    end: Array
    kind: np.ndarray
    position: Array
    onset: Array
    slips: np.ndarray
    span: Array
    turn: Array
    side: Array
    level: Array
    row: Array
    samples: Array
    waves: ComplexArray
    part: ComplexArray
    column: Array
    line: Array


@kernel
def slider_workspace(sliders: Any, H: int, N: int, length: Any) -> Any:
    """Return a `SliderWorkspace` for motions with H harmonics and N samples."""
    Q, C, width = sliders.element.shape[0], 2 * H + 4, 2 * H + 1
    intervals = 2 * C + 1
    return SliderWorkspace(
        np.zeros(Q, np.int64), np.empty((Q, intervals)), np.empty((Q, intervals)), np.empty((Q, intervals), np.int64),
        np.empty((Q, intervals)), np.empty((Q, intervals)), np.zeros(Q, np.bool_), np.empty(Q),
        np.empty(C), np.empty(C), np.empty(C), np.empty(width), np.empty(N), np.empty(H + 1, np.complex128),
        np.empty(max(length, H + 1), np.complex128), np.empty(width), np.empty(width),
    )  # fmt: skip


@kernel
def march(sliders: Any, basis: Any, rows: Any, space: Any) -> None:
    """Compute the stick and slip intervals of all sliders in the steady state of a motion with rows (m, 2H + 1)."""
    last: Any = np.int64(-1)
    turns: Any = np.int64(0)
    for i in range(sliders.element.shape[0]):
        j = sliders.element[i]
        if j != last:
            turns, last = _turning_points(basis, rows[j], space), j
        _march_slider(sliders.k[i], sliders.limit[i], sliders.residual[i], i, rows[j, 0], turns, space)


@inlined
def _turning_points(basis: Any, row: Any, space: Any) -> int:
    """Store the turning points of a displacement with their levels, and return their number; 0 for a constant."""
    velocity, waves, most = space.row, space.waves, 0.0
    velocity[0] = 0.0
    for k in range(1, row.shape[0] // 2 + 1):
        velocity[2 * k - 1], velocity[2 * k] = k * row[2 * k], -k * row[2 * k - 1]
        most = max(most, abs(velocity[2 * k - 1]), abs(velocity[2 * k]))
    if most == 0.0:
        return 0
    for k in range(1, row.shape[0]):  # rounding of crossings is absolute
        velocity[k] /= most
    sampled(velocity, basis, space.samples)
    fill_one_sided(velocity, waves)
    count = crossings(waves, 0.0, space.samples, space.turn, space.side)
    fill_one_sided(row, waves)
    for i in range(count):
        space.level[i] = value_of(waves, 0.0, space.turn[i])[0]
    return int(count)


@inlined
def _march_slider(k: float, limit: float, z: float, i: int, mean: float, turns: int, space: Any) -> None:
    """Store the intervals of slider i, which starts at the residual position z."""
    turn, level, reach, onset = space.turn, space.level, limit / k, -1.0
    space.number[i], space.slips[i] = 0, False
    if turns < 2:  # at rest: the slider sticks where the constant displacement has moved it
        side = _overrun(mean, z, reach)
        if side != 0:
            z, onset = mean - side * reach, 0.0
        space.span[i] = -2.0 * reach
        _append(i, 0.0, 2 * math.pi, np.int64(STICK), z, onset, space)
        return
    low = high = level[0]
    for n in range(turns + 1):  # the first pass, from the residual position
        after = n if n < turns else 0
        low, high = min(low, level[after]), max(high, level[after])
        side = _overrun(level[after], z, reach)
        if side != 0:
            z, onset = level[after] - side * reach, turn[after]
    space.span[i] = high - low - 2.0 * reach
    begin = turn[0]
    for n in range(turns):
        after = n + 1 if n + 1 < turns else 0
        end = turn[after] + (2 * math.pi if after == 0 else 0.0)
        side = _overrun(level[after], z, reach)
        if side == 0:
            continue
        at = _reached(space.waves, z + side * reach, turn[n], end, side)
        _append(i, begin, at, np.int64(STICK), z, onset, space)
        _append(i, at, end, np.int64(side), z, onset, space)
        z, onset, begin = level[after] - side * reach, turn[after], end
        space.slips[i] = True
    _append(i, begin, turn[0] + 2 * math.pi, np.int64(STICK), z, onset, space)


@kernel
def _overrun(d: float, z: float, reach: float) -> int:
    """Return +1 if d is beyond z + reach, -1 if it is beyond z - reach, else 0."""
    if d - z > reach:
        return 1
    return -1 if d - z < -reach else 0


@kernel
def _append(i: int, begin: float, end: float, kind: Any, z: float, onset: float, space: Any) -> None:
    """Append an interval to those of slider i, unless it is empty."""
    n = space.number[i]
    if not end > begin or n >= space.begin.shape[1]:
        return
    space.begin[i, n], space.end[i, n], space.kind[i, n] = begin, end, kind
    space.position[i, n], space.onset[i, n] = z, onset
    space.number[i] = n + 1


@kernel
def _reached(c: Any, level: float, low: float, high: float, side: int) -> float:
    """Return the phase at which a motion that is monotonic in low < theta < high reaches a level near ``high``."""
    at = 0.5 * (low + high)
    for _ in range(MAX_ROOT_ITERATIONS):
        value, slope, _ = value_of(c, level, at)
        if abs(value) <= VALUE_ROUNDING * abs(level):
            break
        if side * value < 0.0:
            low = at
        else:
            high = at
        updated = at - value / slope if slope != 0.0 else low
        if abs(updated - at) <= PHASE_TOLERANCE:
            break
        at = updated if low < updated < high else 0.5 * (low + high)
    return at


@kernel
def _indicator(begin: float, end: float, s: Any, length: int) -> None:
    """Store the first two-sided coefficients of the indicator function of begin < theta < end."""
    s[0] = (end - begin) / (2 * math.pi)
    z, w = complex(math.cos(begin), -math.sin(begin)), complex(math.cos(end), -math.sin(end))
    p, q = complex(1.0, 0.0), complex(1.0, 0.0)
    for n in range(1, length):
        p, q = p * z, q * w
        s[n] = (p - q) * complex(0.0, -1.0 / (2 * math.pi * n))


@inlined
def add_sliders(sliders: Any, basis: Any, rows: Any, space: Any, kappa: Any, chi: Any) -> None:
    """Add the coefficients of sliders to kappa and chi (m, L)."""
    march(sliders, basis, rows, space)
    s, length = space.part, kappa.shape[1]
    for i in range(sliders.element.shape[0]):
        j = sliders.element[i]
        for p in range(space.number[i]):
            _indicator(space.begin[i, p], space.end[i, p], s, length)
            kind = space.kind[i, p]
            if kind == STICK:
                k, constant = sliders.k[i], -sliders.k[i] * space.position[i, p]
                for n in range(length):
                    kappa[j, n] += k * s[n]
                    chi[j, n] += constant * s[n]
            else:
                for n in range(length):
                    chi[j, n] += kind * sliders.limit[i] * s[n]


@kernel
def add_memory(sliders: Any, space: Any, orders: Any, J: Any) -> None:
    """Add the derivative of the slider positions to dP/dd of `march` at the unknown orders."""
    K, n = orders.shape[0], 2 * orders.shape[0] - 1
    s, column, line = space.part, space.column, space.line
    for i in range(sliders.element.shape[0]):
        at = sliders.element[i] * n
        for p in range(space.number[i]):
            onset = space.onset[i, p]
            if space.kind[i, p] != STICK or onset < 0.0:
                continue
            _indicator(space.begin[i, p], space.end[i, p], s, orders[K - 1] + 1)
            column[0], line[0] = sliders.k[i] * s[0].real, 1.0
            for q in range(1, K):
                k = orders[q]
                column[2 * q - 1], column[2 * q] = 2 * sliders.k[i] * s[k].real, -2 * sliders.k[i] * s[k].imag
                line[2 * q - 1], line[2 * q] = math.cos(k * onset), math.sin(k * onset)
            for a in range(n):
                for b in range(n):
                    J[at + a, at + b] -= column[a] * line[b]


@inlined
def insert_events(sliders: Any, basis: Any, rows: Any, space: Any, out: Any, n: int) -> int:
    """Insert the phases in [0, 2 pi) at which sliders stick or slip into n ascending phases; return their number."""
    march(sliders, basis, rows, space)
    for i in range(sliders.element.shape[0]):
        for p in range(space.number[i] if space.slips[i] else 0):
            at, k = space.begin[i, p] % (2 * math.pi), n
            while k > 0 and out[k - 1] > at:
                out[k] = out[k - 1]
                k -= 1
            out[k] = at
            n += 1
    return n


@kernel
def sticks_at(count: int, begin: Any, kind: Any, theta: float) -> bool:
    """Return whether a slider with ``count`` intervals sticks at a phase; see `SliderWorkspace`."""
    at = theta % (2 * math.pi)
    if at < begin[0]:
        at += 2 * math.pi
    for p in range(count - 1, -1, -1):
        if at >= begin[p]:
            return bool(kind[p] == STICK)
    return True


@kernel
def slider_states(packed: Any, X: Any, m: int, span: Any) -> None:
    """Fill span (P, Q) of motions X (P, n) with the range of the displacement minus that in which sliders stick."""
    space = slider_workspace(packed.sliders, X.shape[1] // (2 * m), packed.basis.shape[1], np.int64(1))
    for p in range(X.shape[0]):
        march(packed.sliders, packed.basis, X[p].reshape(m, -1), space)
        for i in range(span.shape[1]):
            span[p, i] = space.span[i]


@kernel
def slider_motion(packed: Any, rows: Any) -> Any:
    """Return the `SliderWorkspace` of one motion with rows (m, 2H + 1), for Python."""
    space = slider_workspace(packed.sliders, rows.shape[1] // 2, packed.basis.shape[1], np.int64(1))
    march(packed.sliders, packed.basis, rows, space)
    return space
