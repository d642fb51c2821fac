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

A limit that varies, prescribed or proportional to the normal force of another element, moves the bounds of z,

    lower = d - limit / k  <=  z  <=  d + limit / k = upper

Turning points are then those of both bounds, and instants at which the displacement d_n of the normal force passes a
level between two zones (the contact opens or closes). Between them both bounds are monotonic. A force that slips is
+-limit, linear in d_n: it has a derivative with respect to d_n. A slider that begins to stick at a turning point of
its bound has dz = dd -+ (dlimit/dd_n / k) dd_n; where it begins to stick as the contact closes, the instant moves, and
dz = dd - (d' / d_n') dd_n. In an open contact the limit is 0 and z = d.

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
from hbgear.harmonic.forces.switching_times import VALUE_ROUNDING, Distance, crossings, root, sort_by_phase
from hbgear.harmonic.forces.toeplitz_kernel import add_product
from hbgear.mechanics.series.fourier_kernels import bend_of, coefficient, fill_one_sided, sampled, value_of

STICK = 0
"""Kind of an interval in which a slider sticks; +1 and -1 are slips in the direction of the displacement."""

OPEN = 2
"""Kind of an interval in which the limit is zero, because the contact of the normal force is open."""


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
    extreme : ndarray, shape (Q, 2)
        Phases [rad] of the highest lower bound and the lowest upper bound of the position; their distance is ``span``;
        nan for a slider at rest.
    zone : ndarray, shape (Q, I)
        Zone of the limit, see `FrictionLimit`.
    position_slope : ndarray, shape (Q, I)
        Derivative of the position while the slider sticks with respect to the displacement d_n at the onset.
    turn, side, level : ndarray, shape (C,)
        Turning points of one slider, the direction of a crossing there, and the displacements.
    lower, upper : ndarray, shape (C,)
        Bounds of the position at the turning points.
    after : ndarray, shape (C,)
        Zone of the limit after each turning point.
    ratio : ndarray, shape (C,)
        -d' / d_n' where d_n passes a level; nan at the other turning points.
    cross : ndarray, shape (Q, L)
        Two-sided coefficients of the derivative of the force with respect to d_n.
    row, samples, waves : ndarray
        Working memory for the velocity and the displacement of an element.
    part : ndarray, shape (L,)
        Coefficients of an indicator function.
    column, basis_values : ndarray, shape (2H + 1,)
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
    extreme: Array
    zone: np.ndarray
    position_slope: Array
    turn: Array
    side: Array
    level: Array
    lower: Array
    upper: Array
    after: np.ndarray
    ratio: Array
    cross: ComplexArray
    row: Array
    samples: Array
    waves: ComplexArray
    part: ComplexArray
    column: Array
    basis_values: Array


@kernel
def slider_workspace(sliders: Any, H: int, N: int, length: Any) -> Any:
    """Return a `SliderWorkspace` for motions with H harmonics and N samples."""
    if sliders is None:
        return None
    Q, C, width = sliders.element.shape[0], 2 * H + 4, 2 * H + 1
    extra: Any = np.int64(0)
    if sliders.varies.any():
        C = C * (3 * sliders.level.shape[1] + 2)
        extra = max(H, sliders.wave.shape[1] - 1)
    intervals = 2 * C + 1
    return SliderWorkspace(
        np.zeros(Q, np.int64),
        np.empty((Q, intervals)),
        np.empty((Q, intervals)),
        np.empty((Q, intervals), np.int64),
        np.empty((Q, intervals)),
        np.empty((Q, intervals)),
        np.zeros(Q, np.bool_),
        np.empty(Q),
        np.empty((Q, 2)),
        np.empty((Q, intervals), np.int64),
        np.empty((Q, intervals)),
        np.empty(C),
        np.empty(C),
        np.empty(C),
        np.empty(C),
        np.empty(C),
        np.empty(C, np.int64),
        np.empty(C),
        np.empty((Q, length + extra if extra else 0), np.complex128),
        np.empty(width),
        np.empty(N),
        np.empty(H + 1, np.complex128),
        np.empty(max(length + extra, H + 1), np.complex128),
        np.empty(width),
        np.empty(width),
    )


@kernel
def march(sliders: Any, basis: Any, rows: Any, space: Any) -> None:
    """Compute the stick and slip intervals of all sliders in the steady state of a motion with rows (m, 2H + 1)."""
    previous: Any = np.int64(-1)
    count: Any = np.int64(0)
    for i in range(sliders.element.shape[0]):
        j = sliders.element[i]
        if sliders.varies[i]:
            count, previous = _turns_of_bounds(sliders, i, basis, rows, space), np.int64(-1)
        else:
            if j != previous:
                count, previous = _turning_points(basis, rows[j], space), j
            reach = sliders.base[i, 0] / sliders.k[i]
            for n in range(count):
                space.lower[n], space.upper[n] = space.level[n] - reach, space.level[n] + reach
                space.after[n], space.ratio[n] = 0, np.nan
        _march_slider(sliders, i, rows, count, space)


@inlined
def _turning_points(basis: Any, row: Any, space: Any) -> int:
    """Store the turning points of a displacement with their levels, and return their number; 0 for a constant."""
    for k in range(row.shape[0]):
        space.row[k] = row[k]
    count: Any = _zeros_of_slope(basis, space, np.int64(0))
    fill_one_sided(row, space.waves)
    for i in range(count):
        space.level[i] = value_of(space.waves, 0.0, space.turn[i])[0]
    return int(count)


@kernel
def _zeros_of_slope(basis: Any, space: Any, first: Any) -> Any:
    """Store the turning points of ``space.row``, which is overwritten, from entry ``first`` on; return their number."""
    velocity, waves, largest = space.row, space.waves, 0.0
    velocity[0] = 0.0
    for k in range(1, velocity.shape[0] // 2 + 1):
        a = velocity[2 * k - 1]
        velocity[2 * k - 1], velocity[2 * k] = k * velocity[2 * k], -k * a
        largest = max(largest, abs(velocity[2 * k - 1]), abs(velocity[2 * k]))
    if largest == 0.0:
        return np.int64(0)
    for k in range(1, velocity.shape[0]):  # rounding of crossings is absolute
        velocity[k] /= largest
    sampled(velocity, basis, space.samples)
    fill_one_sided(velocity, waves)
    return crossings(waves, 0.0, space.samples, space.turn[first:], space.side[first:])


@kernel
def _turns_of_bounds(sliders: Any, i: int, basis: Any, rows: Any, space: Any) -> int:
    """Store the turning points of the bounds of a slider whose limit varies; return their number."""
    j, n = sliders.element[i], sliders.normal[i]
    count: Any = np.int64(0)
    if n >= 0:
        sampled(rows[n], basis, space.samples)
        fill_one_sided(rows[n], space.waves)
        for b in range(sliders.level.shape[1]):
            if math.isfinite(sliders.level[i, b]):
                added: Any = crossings(
                    space.waves, sliders.level[i, b], space.samples, space.turn[count:], space.side[count:]
                )
                count += added
    for t in range(count):
        slope = value_of(space.waves, 0.0, space.turn[t])[1]
        space.ratio[t] = -1.0 / slope if slope != 0.0 else 0.0
    crossing_count = count
    for zone in range(sliders.gain.shape[1]):
        if not _has_limit(sliders, i, zone):
            continue
        for side in (-1.0, 1.0):
            _fill_bound(sliders, i, zone, side, rows, space.row)
            added = _zeros_of_slope(basis, space, count)
            for t in range(count, count + added):
                if _zone_at(sliders, i, rows, space.turn[t]) == zone:
                    space.turn[count], space.ratio[count] = space.turn[t], np.nan
                    count += 1
    for t in range(crossing_count):
        space.ratio[t] *= _value(rows[j], space.turn[t])[1]
    sort_by_phase(space.turn, space.ratio, count)
    for t in range(count):
        end = space.turn[t + 1] if t + 1 < count else space.turn[0] + 2 * math.pi
        zone = _zone_at(sliders, i, rows, 0.5 * (space.turn[t] + end))
        d, reach = _value(rows[j], space.turn[t])[0], _reach_at(sliders, i, zone, rows, space.turn[t])
        space.after[t], space.lower[t], space.upper[t] = zone, d - reach, d + reach
    return int(count)


@kernel
def _value(row: Any, theta: float) -> tuple[float, float]:
    """Return the value and the slope of a real row at a phase."""
    value, slope = row[0], 0.0
    for k in range(1, row.shape[0] // 2 + 1):
        x, y = math.cos(k * theta), math.sin(k * theta)
        value += row[2 * k - 1] * x + row[2 * k] * y
        slope += k * (row[2 * k] * x - row[2 * k - 1] * y)
    return value, slope


@kernel
def _zone_at(sliders: Any, i: int, rows: Any, theta: float) -> int:
    """Return the zone of the limit of slider i at a phase."""
    if sliders.normal[i] < 0:
        return 0
    d, zone = _value(rows[sliders.normal[i]], theta)[0], 0
    for b in range(sliders.level.shape[1]):
        if d > sliders.level[i, b]:
            zone = b + 1
    return zone


@kernel
def _has_limit(sliders: Any, i: int, zone: int) -> bool:
    """Return whether the limit of slider i is not zero in a zone."""
    return bool(sliders.gain[i, zone] != 0.0 or sliders.base[i, zone] != 0.0)


@kernel
def _fill_bound(sliders: Any, i: int, zone: int, side: float, rows: Any, out: Any) -> None:
    """Store the row of d - side limit / k in a zone, without the constant of the limit."""
    j, n = sliders.element[i], sliders.normal[i]
    for k in range(out.shape[0]):
        out[k] = rows[j, k]
    if n >= 0:
        factor = side * sliders.gain[i, zone] / sliders.k[i]
        for k in range(out.shape[0]):
            out[k] -= factor * rows[n, k]
    wave = sliders.wave[i]
    for k in range(1, min(wave.shape[0], out.shape[0] // 2 + 1)):
        out[2 * k - 1] -= side * wave[k].real / sliders.k[i]
        out[2 * k] += side * wave[k].imag / sliders.k[i]


@kernel
def _reach_at(sliders: Any, i: int, zone: int, rows: Any, theta: float) -> float:
    """Return limit / k of slider i in a zone at a phase."""
    n, wave, limit = sliders.normal[i], sliders.wave[i], sliders.base[i, zone]
    if n >= 0:
        limit += sliders.gain[i, zone] * _value(rows[n], theta)[0]
    for k in range(1, wave.shape[0]):
        limit += wave[k].real * math.cos(k * theta) - wave[k].imag * math.sin(k * theta)
    return float(max(0.0, limit / sliders.k[i]))


@kernel
def _march_slider(sliders: Any, i: int, rows: Any, turns: int, space: Any) -> None:
    """Store the intervals of slider i, which starts at its residual position."""
    turn, lower, upper, z, onset, slope = space.turn, space.lower, space.upper, sliders.residual[i], -1.0, 0.0
    space.number[i], space.slips[i] = 0, False
    if turns < 2:
        _rest(sliders, i, rows, space)
        return
    for n in range(turns + 1):  # the first pass, from the residual position
        current, before = n if n < turns else 0, space.after[n - 1 if n else turns - 1]
        side = _overrun(z, lower[current], upper[current])
        if side != 0 or not _has_limit(sliders, i, before):
            z, onset = lower[current] if side >= 0 else upper[current], turn[current]
            slope = _position_slope(sliders, i, before, side, space.ratio[current])
    highest, lowest = 0, 0
    for n in range(1, turns):
        highest, lowest = n if lower[n] > lower[highest] else highest, n if upper[n] < upper[lowest] else lowest
    space.span[i] = lower[highest] - upper[lowest]
    space.extreme[i, 0], space.extreme[i, 1] = turn[highest], turn[lowest]
    begin = turn[0]
    for n in range(turns):
        following, zone = n + 1 if n + 1 < turns else 0, space.after[n]
        end = turn[following] + (2 * math.pi if following == 0 else 0.0)
        side = _overrun(z, lower[following], upper[following])
        is_open = not _has_limit(sliders, i, zone)
        if side == 0 and not is_open:
            continue
        slip_begin = turn[n]
        if not is_open and z != (lower[n] if side > 0 else upper[n]):
            slip_begin = _slip_begin(sliders, i, zone, side, z, turn[n], end, rows, space)
        _append(i, begin, slip_begin, np.int64(STICK), z, onset, slope, zone, space)
        _append(i, slip_begin, end, np.int64(OPEN if is_open else side), z, onset, slope, zone, space)
        z, onset, begin = lower[following] if side >= 0 else upper[following], turn[following], end
        slope = _position_slope(sliders, i, zone, side, space.ratio[following])
        space.slips[i] = True
    _append(i, begin, turn[0] + 2 * math.pi, np.int64(STICK), z, onset, slope, space.after[turns - 1], space)


@kernel
def _rest(sliders: Any, i: int, rows: Any, space: Any) -> None:
    """Store the only interval of a slider at rest, which sticks where the constant displacement has moved it."""
    d, z, onset, slope = rows[sliders.element[i], 0], sliders.residual[i], -1.0, 0.0
    zone = _zone_at(sliders, i, rows, 0.0)
    reach = _reach_at(sliders, i, zone, rows, 0.0)
    side = _overrun(z, d - reach, d + reach)
    if side != 0:
        z, onset, slope = d - side * reach, 0.0, _position_slope(sliders, i, zone, side, np.nan)
    is_open = not _has_limit(sliders, i, zone)
    space.span[i] = -2.0 * reach
    space.extreme[i, :] = np.nan
    kind = np.int64(OPEN if is_open else STICK)
    _append(i, 0.0, 2 * math.pi, kind, z, onset, slope, zone, space)


@kernel
def _overrun(z: float, lower: float, upper: float) -> int:
    """Return +1 if a position is below its lower bound, -1 if it is above the upper one, else 0."""
    if z < lower:
        return 1
    return -1 if z > upper else 0


@kernel
def _position_slope(sliders: Any, i: int, zone: int, side: int, ratio: float) -> float:
    """Return the derivative of the position with respect to d_n where a slip in a zone ends."""
    return ratio if math.isfinite(ratio) else -side * sliders.gain[i, zone] / sliders.k[i]


@kernel
def _append(
    i: int, begin: float, end: float, kind: Any, z: float, onset: float, slope: float, zone: int, space: Any
) -> None:
    """Append an interval to those of slider i, unless it is empty."""
    n = space.number[i]
    if not end > begin or n >= space.begin.shape[1]:
        return
    space.begin[i, n], space.end[i, n], space.kind[i, n], space.zone[i, n] = begin, end, kind, zone
    space.position[i, n], space.onset[i, n], space.position_slope[i, n] = z, onset, slope
    space.number[i] = n + 1


@kernel
def _slip_begin(
    sliders: Any, i: int, zone: int, side: int, z: float, low: float, high: float, rows: Any, space: Any
) -> float:
    """Return the phase at which a bound of slider i, monotonic in low < theta < high, reaches z near ``high``."""
    _fill_bound(sliders, i, zone, side, rows, space.row)
    fill_one_sided(space.row, space.waves)
    level = z + side * sliders.base[i, zone] / sliders.k[i]
    x = Distance(space.waves, level, VALUE_ROUNDING * abs(level), bend_of(space.waves))
    return float(root(x, None, side > 0, low, high, 0.5 * (low + high)))


@kernel
def _indicator(begin: float, end: float, s: Any, length: int) -> None:
    """Store the first two-sided coefficients of the indicator function of begin < theta < end."""
    s[0] = (end - begin) / (2 * math.pi)
    z, w = complex(math.cos(begin), -math.sin(begin)), complex(math.cos(end), -math.sin(end))
    p, q = complex(1.0, 0.0), complex(1.0, 0.0)
    for n in range(1, length):
        p, q = p * z, q * w
        s[n] = (p - q) * complex(0.0, -1.0 / (2 * math.pi * n))


@kernel
def add_sliders(sliders: Any, basis: Any, rows: Any, space: Any, kappa: Any, chi: Any) -> None:
    """Add the coefficients of sliders to kappa and chi (m, L)."""
    if sliders is None:
        return
    march(sliders, basis, rows, space)
    s, length = space.part, kappa.shape[1]
    space.cross[:, :] = 0j
    for i in range(sliders.element.shape[0]):
        j = sliders.element[i]
        for p in range(space.number[i]):
            kind = space.kind[i, p]
            if kind == OPEN:
                continue
            _indicator(space.begin[i, p], space.end[i, p], s, s.shape[0] if sliders.varies[i] else length)
            if kind == STICK:
                k, constant = sliders.k[i], -sliders.k[i] * space.position[i, p]
                for n in range(length):
                    kappa[j, n] += k * s[n]
                    chi[j, n] += constant * s[n]
            else:
                _add_slip(sliders, i, kind, space.zone[i, p], s, chi[j], space.cross)
        if sliders.normal[i] >= 0:
            fill_one_sided(rows[sliders.normal[i]], space.waves)
            for n in range(length):
                chi[j, n] += coefficient(space.cross[i], space.waves, n)


@kernel
def _add_slip(sliders: Any, i: int, kind: int, zone: int, s: Any, chi: Any, cross: Any) -> None:
    """Add the force of a slip, kind limit, in an interval with the indicator s; its part in d_n to ``cross``."""
    for n in range(chi.shape[0]):
        chi[n] += kind * sliders.base[i, zone] * s[n]
    if not sliders.varies[i]:
        return
    if sliders.normal[i] < 0:
        for n in range(chi.shape[0]):
            chi[n] += kind * coefficient(s, sliders.wave[i], n)
    for n in range(cross.shape[1]):
        cross[i, n] += kind * sliders.gain[i, zone] * s[n]


@kernel
def add_memory(sliders: Any, space: Any, orders: Any, J: Any) -> None:
    """Add the derivatives of slider positions and of limits to dP/dd of `add_sliders` at the unknown orders."""
    if sliders is None:
        return
    K, n = orders.shape[0], 2 * orders.shape[0] - 1
    s, column, basis_values = space.part, space.column, space.basis_values
    for i in range(sliders.element.shape[0]):
        row_start, normal_start = sliders.element[i] * n, sliders.normal[i] * n
        if normal_start >= 0:
            add_product(space.cross[i], orders, J[row_start : row_start + n, normal_start : normal_start + n])
        for p in range(space.number[i]):
            onset, slope = space.onset[i, p], space.position_slope[i, p]
            if space.kind[i, p] != STICK or onset < 0.0:
                continue
            _indicator(space.begin[i, p], space.end[i, p], s, orders[K - 1] + 1)
            column[0], basis_values[0] = sliders.k[i] * s[0].real, 1.0
            for q in range(1, K):
                k = orders[q]
                column[2 * q - 1], column[2 * q] = 2 * sliders.k[i] * s[k].real, -2 * sliders.k[i] * s[k].imag
                basis_values[2 * q - 1], basis_values[2 * q] = math.cos(k * onset), math.sin(k * onset)
            for a in range(n):
                for b in range(n):
                    J[row_start + a, row_start + b] -= column[a] * basis_values[b]
            if normal_start >= 0 and slope != 0.0:
                for a in range(n):
                    for b in range(n):
                        J[row_start + a, normal_start + b] -= slope * column[a] * basis_values[b]


@kernel
def insert_events(sliders: Any, basis: Any, rows: Any, space: Any, out: Any, n: int) -> int:
    """Insert the phases in [0, 2 pi) at which sliders stick or slip into n ascending phases; return their number."""
    if sliders is None:
        return n
    march(sliders, basis, rows, space)
    for i in range(sliders.element.shape[0]):
        for p in range(space.number[i] if space.slips[i] else 0):
            phase, k = space.begin[i, p] % (2 * math.pi), n
            while k > 0 and out[k - 1] > phase:
                out[k] = out[k - 1]
                k -= 1
            out[k] = phase
            n += 1
    return n


@kernel
def interval_at(count: int, begin: Any, theta: float) -> int:
    """Return the one of ``count`` intervals of a slider that contains a phase; see `SliderWorkspace`."""
    phase = theta % (2 * math.pi)
    if phase < begin[0]:
        phase += 2 * math.pi
    for p in range(count - 1, -1, -1):
        if phase >= begin[p]:
            return p
    return 0


@kernel
def sticks_at(count: int, begin: Any, kind: Any, theta: float) -> bool:
    """Return whether a slider with ``count`` intervals sticks at a phase; see `SliderWorkspace`."""
    return bool(kind[interval_at(count, begin, theta)] == STICK)


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
