"""Kernels: what becomes of small disturbances of a periodic motion in a period. The method is told in `floquet`.

In a step of length h from the state z_0 of the modes, with u = D d at s Gauss points,

    d(c_i h) = output e^{poles c_i h} z_0 - sum_j A_ij u_j - rest u_i
    A_ij = int_0^{c_i h} output e^{poles (c_i h - x)} input L_j(x) dx
    z_1 = e^{poles h} z_0 - sum_j (int_0^h e^{poles (h - x)} input L_j(x) dx) u_j
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import kernel
from hbgear.continuation.numerics.gauss_kernels import solve_in_place
from hbgear.harmonic.forces.piecewise_kernels import add_pieces, put_gap, put_phases, sizes_of, weigh
from hbgear.harmonic.forces.projection_kernels import cross, projection_workspace
from hbgear.harmonic.multipliers.phi_functions import moments

COARSE = 32  # phases of an excitation period at which the modulations are looked at for their size


class MonodromyWorkspace(NamedTuple):
    """Arrays in which a disturbance of one motion is carried over a period, overwritten each time.

    For s Gauss points, g ports, q modes and T points of all steps. phases (3, T) : their values, cosines and sines.
    stiffness (T,), work (5, T), D (orders, T / s, s, g) : see `fill_stiffness_modulation`. The others are for
    `monodromy`.
    """

    phases: Array
    stiffness: Array
    work: Array
    D: Array
    ends: Array
    state: Array
    turns: ComplexArray
    moments: ComplexArray
    felt: ComplexArray
    A: Array
    R: Array
    B: Array
    M: Array
    shown: Array
    u: Array


@kernel
def monodromy_workspace(modes: Any, size: int, s: int, steps: Any, orders: int) -> Any:
    """A `MonodromyWorkspace` for matrices of a size and so many steps of s points."""
    g, q, T = modes.output.shape[0], modes.poles.shape[0], steps * s
    return MonodromyWorkspace(
        np.empty((3, T)), np.empty(T), np.empty((5, T)), np.empty((orders, steps, s, g)),
        np.empty(s + 1), np.empty((2 * q, size)),
        np.empty((s + 1, q), np.complex128), np.empty((s + 2, (s + 1) * q), np.complex128), np.empty(q, np.complex128),
        np.empty((orders, s * g, s * g)), np.empty((orders, s * g, 2 * q)), np.empty((2 * q, s * g)),
        np.empty((s * g, s * g + size)), np.empty((s * g, 2 * q)), np.empty((s * g, size)),
    )  # fmt: skip


@kernel
def cuts_of(numbers: Any, space: Any) -> Any:
    """Room for phases of corners (C,) and the pieces between them (C + 1, 3), see `partition_period`."""
    C = sizes_of(numbers.corners)[0] + space.theta.size
    return np.empty(C), np.empty((C + 1, 3))


@kernel
def partition_period(numbers: Any, rows: Any, longest: float, space: Any, theta: Any, cut: Any) -> tuple[int, int]:
    """Put the pieces of a period, cut at the `_put_corners` of a motion, in cut; see `_put_pieces`."""
    return _put_pieces(theta, _put_corners(numbers, rows, space, theta), longest, cut)


@kernel
def _put_corners(numbers: Any, rows: Any, space: Any, out: Any) -> int:
    """Phases in [0, 2 pi), ascending, at which an element crosses a corner of its law, or the excitation has one.

    Returns their number.
    """
    cross(numbers, rows, np.bool_(False), space)
    theta, count = space.theta, space.number
    n = put_phases(numbers.corners, out)
    for i in range(count.shape[0]):
        for j in range(count[i]):
            at, k = theta[i, j] % (2 * math.pi), n
            while k > 0 and out[k - 1] > at:
                out[k] = out[k - 1]
                k -= 1
            out[k] = at
            n += 1
    return n


@kernel
def _put_pieces(theta: Any, n: int, longest: float, out: Any) -> tuple[int, int]:
    """Smooth pieces of a period cut at the n phases theta into equal steps of at most ``longest`` radians.

    A period begins at its first corner, or else at 0: the multipliers do not depend on where it begins.

    Returns
    -------
    The number of pieces, and of all steps. out (n + 1, 3) : first phase, length of the steps in radians, number of
    steps of each piece.
    """
    made = total = 0
    for i in range(max(n, 1)):
        start = theta[i] if n else 0.0
        end = theta[i + 1] if i + 1 < n else 2 * math.pi + (theta[0] if n else 0.0)
        width = end - start
        if width > 1e-13:
            steps = max(1.0, math.ceil(width / longest - 1e-9))
            out[made, 0], out[made, 1], out[made, 2] = start, width / steps, steps
            made += 1
            total += int(steps)
    return made, total


@kernel
def circle(count: int) -> Any:
    """Phases, equally far apart, of a period, with their cosines and sines (3, count)."""
    out = np.empty((3, count))
    for i in range(count):
        theta = 2 * math.pi * i / count
        out[0, i], out[1, i], out[2, i] = theta, math.cos(theta), math.sin(theta)
    return out


@kernel
def add_stiffness(numbers: Any, c: Any, j: int, phases: Any, T: int, work: Any, out: Any) -> None:
    """Add dp/dd of element j at the first T phases (3, ...) as of `circle` to out; c as of `put_gap`.

    work (5, ...) is overwritten.
    """
    laws = numbers.laws
    gap, slope, factor = work[2], work[3], work[4]
    _summed(c, phases, T, work, gap)
    add_pieces(numbers.corners, j, phases[0], T, gap)
    for n in range(T):
        out[n] += laws.cubic[j, 0] + 3 * laws.cubic[j, 1] * gap[n] * gap[n]
    for s in range(laws.of.shape[0]):
        if laws.of[s] != j:
            continue
        _slope(laws, s, gap, T, slope)
        weigh(numbers.corners, s, phases[0], T, slope)
        _modulation(laws.shifts, laws.series[s], phases, T, work, factor)
        for n in range(T):
            out[n] += slope[n] * factor[n]


@kernel
def _slope(laws: Any, s: int, gap: Any, T: int, out: Any) -> None:
    """Slope of a spring of the table without its stiffness."""
    for n in range(T):
        out[n] = laws.base[s, 0]
    for r in range(laws.at.shape[0]):
        if laws.part[r] == s:
            level, change = laws.level[laws.at[r]], laws.change[r]
            for n in range(T):
                out[n] += change if gap[n] > level else 0.0


@kernel
def _summed(c: Any, phases: Any, T: int, work: Any, out: Any) -> None:
    """Re sum_k c_k z^k at phases (3, T) by Horner's rule, all of them together; work (2, T) or more."""
    x, y = work[0], work[1]
    for n in range(T):
        x[n] = y[n] = 0.0
    for k in range(c.shape[0] - 1, 0, -1):
        _turn_on(c[k], phases, T, x, y)
    for n in range(T):
        out[n] = c[0].real + x[n]


@kernel
def _modulation(shifts: Any, series: Any, phases: Any, T: int, work: Any, out: Any) -> None:
    """Re of the series, whose coefficients are two-sided ones at the shifts, as of `_summed`."""
    x, y = work[0], work[1]
    for n in range(T):
        x[n] = y[n] = 0.0
    for i in range(shifts.shape[0] - 1, 0, -1):
        for k in range(shifts[i] - shifts[i - 1]):
            _turn_on(2.0 * series[i] if k == 0 else 0j, phases, T, x, y)
    for n in range(T):
        out[n] = series[0].real + x[n]


@kernel
def _turn_on(c: complex, phases: Any, T: int, x: Any, y: Any) -> None:
    """(x + i y + c) z at all phases in the place of x + i y."""
    a, b, u, v = c.real, c.imag, phases[1], phases[2]
    for n in range(T):
        p, q = x[n] + a, y[n] + b
        x[n] = p * u[n] - q * v[n]
        y[n] = p * v[n] + q * u[n]


@kernel
def steps_per_segment(numbers: Any, rows: Any, mobility: Any, coarse: Any, c: Any, work: Any, k: Any) -> float:
    """How fast the modulations can turn the state [rad per unit of time], 0 without any; coarse: phases to look at.

    The square is the largest of: inverse modal mass of an element times the largest stiffness of its law. c (H + 1,),
    work (5, T) and k (T,) are overwritten.
    """
    most, T = 0.0, coarse.shape[1]
    for j in range(rows.shape[0]):
        for i in range(T):
            k[i] = 0.0
        put_gap(numbers.corners, rows[j], j, c)
        add_stiffness(numbers, c, j, coarse, T, work, k)
        largest = numbers.linear.springs[0, j]
        for i in range(T):
            largest = max(largest, abs(k[i]))
        most = max(most, mobility[j] * largest)
    return math.sqrt(most)


@kernel
def slopes(numbers: Any, X: Any, out: Any) -> None:
    """dp/dd (P, m, T) of motions X (P, n) at T phases, equally far apart, of the basis period; out is zero before."""
    m, T = out.shape[1], out.shape[2]
    phases, work, c = circle(T), np.empty((5, T)), np.empty(X.shape[1] // (2 * m) + 1, np.complex128)
    for p in range(X.shape[0]):
        rows = X[p].reshape(m, -1)
        for j in range(m):
            put_gap(numbers.corners, rows[j], j, c)
            add_stiffness(numbers, c, j, phases, T, work, out[p, j])


@kernel
def fill_stiffness_modulation(
    numbers: Any, rows: Any, ports: Any, cut: Any, pieces: int, x: Any, c: Any, carriage: Any
) -> None:
    """D = dp/dd - kr at the Gauss points x of all steps of a period, for the elements of the ports; c as of `pace`."""
    s, phases, k = x.shape[0], carriage.phases, carriage.stiffness
    at: Any = np.int64(0)  # for a literal those called would be compiled once more
    for i in range(pieces):
        a, b = math.cos(cut[i, 1]), math.sin(cut[i, 1])
        for n in range(int(cut[i, 2])):
            for j in range(s):
                theta = phases[0, at] = cut[i, 0] + cut[i, 1] * (n + x[j])
                if n:  # those of the step before, turned on
                    u, v = phases[1, at - s], phases[2, at - s]
                    phases[1, at], phases[2, at] = a * u - b * v, a * v + b * u
                else:
                    phases[1, at], phases[2, at] = math.cos(theta), math.sin(theta)
                at += 1
    for p in range(ports.shape[0]):
        for i in range(at):
            k[i] = -numbers.linear.springs[0, ports[p]]
        put_gap(numbers.corners, rows[ports[p]], ports[p], c)
        add_stiffness(numbers, c, ports[p], phases, at, carriage.work, k)
        for i in range(at):
            carriage.D[0, i // s, i % s, p] = k[i]


@kernel
def monodromy(modes: Any, cut: Any, pieces: int, omega: float, x: Any, L: Any, carriage: Any, out: Any) -> None:
    """Put the real matrix (r, r) that carries a disturbance over a period in out.

    D of the carriage holds dp/dd - kr, and with two orders dp/dv, at the Gauss points of all steps. Where disturbances
    grow by more than 1e300 the matrix is scaled, so that its largest entry is about that.
    """
    s, q, r = x.shape[0], modes.poles.shape[0], out.shape[0]
    ends, state, turns = carriage.ends, carriage.state, carriage.turns
    ends[s] = 1.0
    for i in range(s):
        ends[i] = x[i]
    for k in range(2 * q):
        for n in range(r):
            state[k, n] = 1.0 if k == n else 0.0
    step: Any = np.int64(0)
    log = 0.0
    for i in range(pieces):
        moments(modes.poles, cut[i, 1] / omega, ends, turns, carriage.moments)
        _tables(modes, L, carriage)
        for _ in range(int(cut[i, 2])):
            _answer(carriage, step)
            _turned(turns[s], state)
            _add_product(carriage.B, carriage.u, -1.0, state)
            step += 1
            if step % _OFTEN == 0:
                log += _rescaled(state, _MOST)
    log += _rescaled(state, 1.0 if log > 0.0 else _MOST)
    factor = math.exp(min(log, math.log(_END))) if log > 0.0 else 1.0
    for k in range(r):
        for n in range(r):
            out[k, n] = factor * state[k, n]


@kernel
def _tables(modes: Any, L: Any, carriage: Any) -> None:
    """A, R and B of a step, from `moments`: rows and columns are Gauss points and ports; modes are in real numbers.

    The modes are summed before the monomials are put together to Lagrange polynomials, at a part of the cost.
    """
    turns, work, w, A, R, B = carriage.turns, carriage.moments, carriage.felt, carriage.A, carriage.R, carriage.B
    s, g, q, orders = turns.shape[0] - 1, modes.output.shape[0], modes.poles.shape[0], A.shape[0]
    A[:, :, :] = 0.0
    for o in range(orders):
        for p in range(g):
            for k in range(q):
                w[k] = modes.output[p, k] * (modes.poles[k] if o else 1.0)
            for i in range(s):
                for k in range(q):
                    felt = w[k] * turns[i, k]
                    R[o, i * g + p, k], R[o, i * g + p, q + k] = felt.real, -felt.imag
            for e in range(g):
                _felt(w, modes.input[:, e], work, L, A[o, p::g, e::g])
                if o == 0:
                    for i in range(s):
                        A[0, i * g + p, i * g + e] += modes.rest[p, e]
    for j in range(s):
        for k in range(q):
            z = 0j
            for n in range(s):
                z += L[j, n] * work[n + 1, s * q + k]
            for p in range(g):
                pushed = z * modes.input[k, p]
                B[k, j * g + p], B[q + k, j * g + p] = pushed.real, pushed.imag


@kernel
def _felt(output: Any, pushed: Any, work: Any, L: Any, out: Any) -> None:
    """Add what a port feels at the Gauss points (s, s) of a force on another one that is a Lagrange polynomial."""
    s, q = L.shape[0], output.shape[0]
    for n in range(s):
        for i in range(s):
            total = rest = 0.0
            for k in range(q):
                both, z = output[k] * pushed[k], work[n + 1, i * q + k]
                total += both.real * z.real
                rest += both.imag * z.imag
            for j in range(s):
                out[i, j] += (total - rest) * L[j, n]


@kernel
def _add_product(A: Any, B: Any, factor: float, out: Any) -> None:
    """Add factor A B to out: four rows of B at a time, for which out is read and written once."""
    n, whole = A.shape[1], A.shape[1] - A.shape[1] % 4
    for i in range(A.shape[0]):
        for k in range(0, whole, 4):
            a, b, c, d = factor * A[i, k], factor * A[i, k + 1], factor * A[i, k + 2], factor * A[i, k + 3]
            for j in range(B.shape[1]):
                out[i, j] += a * B[k, j] + b * B[k + 1, j] + c * B[k + 2, j] + d * B[k + 3, j]
        for k in range(whole, n):
            a = factor * A[i, k]
            for j in range(B.shape[1]):
                out[i, j] += a * B[k, j]


@kernel
def _answer(carriage: Any, step: int) -> None:
    """u of a step from (1 + D A) u = D R z_0; M and shown are room for [1 + D A  D R z_0] and D R."""
    D, A, R, M, shown, u = carriage.D, carriage.A, carriage.R, carriage.M, carriage.shown, carriage.u
    n, g = u.shape[0], D.shape[3]
    for i in range(n):
        for o in range(D.shape[0]):
            d = D[o, step, i // g, i % g]
            for j in range(n):
                M[i, j] = d * A[o, i, j] + (M[i, j] if o else 0.0)
            for j in range(shown.shape[1]):
                shown[i, j] = d * R[o, i, j] + (shown[i, j] if o else 0.0)
        M[i, i] += 1.0
        for j in range(u.shape[1]):
            u[i, j] = 0.0
    _add_product(shown, carriage.state, 1.0, u)
    for i in range(n):
        for j in range(u.shape[1]):
            M[i, n + j] = u[i, j]
    solve_in_place(M)
    for i in range(n):
        for j in range(u.shape[1]):
            u[i, j] = M[i, n + j]


@kernel
def _turned(turn: Any, state: Any) -> None:
    """e^{poles h} z in the place of z."""
    q = turn.shape[0]
    for k in range(q):
        a, b = turn[k].real, turn[k].imag
        for j in range(state.shape[1]):
            x, y = state[k, j], state[q + k, j]
            state[k, j], state[q + k, j] = a * x - b * y, b * x + a * y


@kernel
def step_of(fast: float, omega: float, nu: int, schemes: Any, share: float) -> tuple[int, float]:
    """Which scheme, and its longest step [rad], for springs that turn the state by ``fast``; see `monodromies`."""
    which = 0 if fast * 2 * math.pi / omega <= schemes[2] else 1
    width = schemes[0][2] if which == 0 else schemes[1][2]
    return which, min(width * omega / max(fast, 1e-300), share * 2 * math.pi / nu)


_GROWTH = 10.0  # exponent of a disturbance's growth in one step


_OFTEN = 16  # steps after which the state is looked at for overflow


_MOST = 1e100  # entries of the state above which it is scaled


_END = 1e300  # largest entry of a monodromy matrix; larger ones are scaled to it


@kernel
def shortened(longest: float, omega: float, poles: Any) -> float:
    """The longest step [rad] in which disturbances of unstable modes do not overflow."""
    growth = 0.0
    for k in range(poles.shape[0]):
        growth = max(growth, poles[k].real)
    return min(longest, _GROWTH * omega / growth) if growth > 0.0 else longest


@kernel
def _rescaled(state: Any, limit: float) -> float:
    """Divide a state with entries above a limit by the largest of them; returns its logarithm, or 0."""
    most = 0.0
    for k in range(state.shape[0]):
        for j in range(state.shape[1]):
            most = max(most, abs(state[k, j]))
    if most <= limit:
        return 0.0
    for k in range(state.shape[0]):
        for j in range(state.shape[1]):
            state[k, j] /= most
    return math.log(most)


@kernel
def monodromies(
    numbers: Any, modes: Any, X: Any, Omega: Any, mobility: Any, schemes: Any, share: float, most: float, out: Any
) -> float:
    """Matrices (P, r, r) of motions X (P, n) at Omega (P,) of a model whose laws are all in the table.

    schemes : for a motion whose period the springs turn by few radians and for a long one, (x, L, width), and the
    radians between. Returns 0, or the number of steps of a period if it exceeds ``most``.
    """
    nu, m, size = numbers.linear.nu, mobility.shape[0], out.shape[1]
    space, coarse = projection_workspace(numbers, m, X.shape[1] // (2 * m), np.int64(0)), circle(COARSE * nu)
    work, k = np.empty((5, COARSE * nu)), np.empty(COARSE * nu)
    theta, cut = cuts_of(numbers, space)
    few = monodromy_workspace(modes, size, schemes[0][0].shape[0], np.int64(COARSE), 1)
    many = monodromy_workspace(modes, size, schemes[1][0].shape[0], np.int64(COARSE), 1)
    for p in range(X.shape[0]):
        rows, omega = X[p].reshape(m, -1), Omega[p] / nu
        fast = steps_per_segment(numbers, rows, mobility, coarse, space.waves, work, k)
        which, longest = step_of(fast, omega, nu, schemes, share)
        longest = shortened(longest, omega, modes.poles)
        count: float = 2 * math.pi / longest
        if count > most:
            return count
        pieces, steps = partition_period(numbers, rows, longest, space, theta, cut)
        if which == 0 and steps > few.D.shape[1]:
            few = monodromy_workspace(modes, size, schemes[0][0].shape[0], 2 * steps, 1)
        if which == 1 and steps > many.D.shape[1]:
            many = monodromy_workspace(modes, size, schemes[1][0].shape[0], 2 * steps, 1)
        carriage, x, L = few, schemes[0][0], schemes[0][1]
        if which == 1:
            carriage, x, L = many, schemes[1][0], schemes[1][1]
        fill_stiffness_modulation(numbers, rows, modes.ports, cut, pieces, x, space.waves, carriage)
        monodromy(modes, cut, pieces, omega, x, L, carriage, out[p])
    return 0.0
