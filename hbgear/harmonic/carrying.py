"""Kernels: what becomes of small disturbances of a periodic motion in a period. The method is told in `floquet`.

In a step of length h from the state z_0 of the modes, with u = D d at s Gauss points,

    d(c_i h) = output e^{poles c_i h} z_0 - sum_j A_ij u_j - rest u_i
    A_ij = int_0^{c_i h} output e^{poles (c_i h - x)} input L_j(x) dx
    z_1 = e^{poles h} z_0 - sum_j (int_0^h e^{poles (h - x)} input L_j(x) dx) u_j
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.compiling import bare, kernel
from hbgear.continuation.elimination import eliminate
from hbgear.harmonic.phi import moments
from hbgear.harmonic.pieces import piece_of, polynomial, waves_with
from hbgear.harmonic.projection import cross, space_of
from hbgear.mechanics.summing import waves_of

COARSE = 32  # phases of an excitation period at which the modulations are looked at for their size


@kernel
def corners(numbers: Any, rows: Any, space: Any) -> Any:
    """Phases in [0, 2 pi), ascending, at which an element crosses a corner of its law, or the excitation has one."""
    cross(numbers, rows, np.bool_(False), space)
    theta, count = space.theta, space.number
    total = n = numbers.corners.phases.shape[0]
    for i in range(count.shape[0]):
        total += count[i]
    out = np.empty(total)
    for i in range(n):
        out[i] = numbers.corners.phases[i]
    for i in range(count.shape[0]):
        for j in range(count[i]):
            at, k = theta[i, j] % (2 * math.pi), n
            while k > 0 and out[k - 1] > at:
                out[k] = out[k - 1]
                k -= 1
            out[k] = at
            n += 1
    return out


@kernel
def pieces(theta: Any, longest: float) -> Any:
    """Smooth pieces of a period cut at phases theta into equal steps of at most ``longest`` radians.

    A period begins at its first corner, or else at 0: the multipliers do not depend on where it begins.

    Returns
    -------
    (C, 3): first phase, length of the steps in radians, number of steps of each piece.
    """
    n = theta.shape[0]
    out, made = np.empty((max(n, 1), 3)), 0
    for i in range(max(n, 1)):
        start = theta[i] if n else 0.0
        end = theta[i + 1] if i + 1 < n else 2 * math.pi + (theta[0] if n else 0.0)
        width = end - start
        if width > 1e-13:
            steps = max(1.0, math.ceil(width / longest - 1e-9))
            out[made, 0], out[made, 1], out[made, 2] = start, width / steps, steps
            made += 1
    return out[:made]


@kernel
def circle(count: int) -> Any:
    """Phases, equally far apart, of a period, with their cosines and sines (3, count)."""
    out = np.empty((3, count))
    for i in range(count):
        theta = 2 * math.pi * i / count
        out[0, i], out[1, i], out[2, i] = theta, math.cos(theta), math.sin(theta)
    return out


@kernel
def _waves(numbers: Any, row: Any, j: int) -> Any:
    """One-sided coefficients of the motion of element j, with those of a displacement with corners."""
    moves = numbers.corners.moves
    return waves_of(row) if moves[j] == moves[j + 1] else waves_with(row, numbers.corners.kept[:, j])


@bare
def stiffness(numbers: Any, c: Any, j: int, phases: Any, work: Any, out: Any) -> None:
    """Add dp/dd of element j at phases (3, T) as of `circle` to out; c as of `_waves`, work (5, T) is overwritten."""
    laws, corners, T = numbers.laws, numbers.corners, phases.shape[1]
    first, end = corners.moves[j], corners.moves[j + 1]
    gap, slope, factor = work[2], work[3], work[4]
    _summed(c, phases, work, gap)
    if first < end:
        for n in range(T):
            theta = phases[0, n] % (2 * math.pi)
            i = piece_of(corners.at, first, end, theta)
            gap[n] += polynomial(corners.rows[i], theta - corners.at[i])
    for n in range(T):
        out[n] += laws.cubic[j, 0] + 3 * laws.cubic[j, 1] * gap[n] * gap[n]
    for s in range(laws.of.shape[0]):
        if laws.of[s] != j:
            continue
        _slope(laws, s, gap, slope)
        if corners.parts[s] < corners.parts[s + 1]:
            for n in range(T):
                theta = phases[0, n] % (2 * math.pi)
                i = piece_of(corners.begin, corners.parts[s], corners.parts[s + 1], theta)
                slope[n] *= polynomial(corners.weight[i], theta - corners.begin[i])
        _modulation(laws.shifts, laws.series[s], phases, work, factor)
        for n in range(T):
            out[n] += slope[n] * factor[n]


@bare
def _slope(laws: Any, s: int, gap: Any, out: Any) -> None:
    """Slope of a spring of the table without its stiffness."""
    for n in range(out.shape[0]):
        out[n] = laws.base[s, 0]
    for r in range(laws.at.shape[0]):
        if laws.part[r] == s:
            level, change = laws.level[laws.at[r]], laws.change[r]
            for n in range(out.shape[0]):
                out[n] += change if gap[n] > level else 0.0


@bare
def _summed(c: Any, phases: Any, work: Any, out: Any) -> None:
    """Re sum_k c_k z^k at phases (3, T) by Horner's rule, all of them together; work (2, T) or more."""
    x, y = work[0], work[1]
    x[:] = 0.0
    y[:] = 0.0
    for k in range(c.shape[0] - 1, 0, -1):
        _turn_on(c[k], phases, x, y)
    for n in range(out.shape[0]):
        out[n] = c[0].real + x[n]


@bare
def _modulation(shifts: Any, series: Any, phases: Any, work: Any, out: Any) -> None:
    """Re of the series, whose coefficients are two-sided ones at the shifts, as of `_summed`."""
    x, y = work[0], work[1]
    x[:] = 0.0
    y[:] = 0.0
    for i in range(shifts.shape[0] - 1, 0, -1):
        for k in range(shifts[i] - shifts[i - 1]):
            _turn_on(2.0 * series[i] if k == 0 else 0j, phases, x, y)
    for n in range(out.shape[0]):
        out[n] = series[0].real + x[n]


@bare
def _turn_on(c: complex, phases: Any, x: Any, y: Any) -> None:
    """(x + i y + c) z at all phases in the place of x + i y."""
    a, b, u, v = c.real, c.imag, phases[1], phases[2]
    for n in range(x.shape[0]):
        p, q = x[n] + a, y[n] + b
        x[n] = p * u[n] - q * v[n]
        y[n] = p * v[n] + q * u[n]


@kernel
def pace(numbers: Any, rows: Any, mobility: Any, coarse: Any) -> float:
    """How fast the modulations can turn the state [rad per unit of time], 0 without any; coarse: phases to look at.

    The square is the largest of: inverse modal mass of an element times the largest stiffness of its law.
    """
    most, k, work = 0.0, np.empty(coarse.shape[1]), np.empty((5, coarse.shape[1]))
    for j in range(rows.shape[0]):
        k[:] = 0.0
        stiffness(numbers, _waves(numbers, rows[j], j), j, coarse, work, k)
        largest = numbers.linear.springs[0, j]
        for i in range(k.shape[0]):
            largest = max(largest, abs(k[i]))
        most = max(most, mobility[j] * largest)
    return math.sqrt(most)


@kernel
def slopes(numbers: Any, X: Any, out: Any) -> None:
    """dp/dd (P, m, T) of motions X (P, n) at T phases, equally far apart, of the basis period; out is zero before."""
    m, phases, work = out.shape[1], circle(out.shape[2]), np.empty((5, out.shape[2]))
    for p in range(X.shape[0]):
        rows = X[p].reshape(m, -1)
        for j in range(m):
            stiffness(numbers, _waves(numbers, rows[j], j), j, phases, work, out[p, j])


@kernel
def moduli(numbers: Any, rows: Any, ports: Any, cut: Any, x: Any) -> Any:
    """D = dp/dd - kr (1, steps, s, g) at the Gauss points x of all steps of a period, for the elements of the ports."""
    steps, s, at = 0, x.shape[0], 0
    for i in range(cut.shape[0]):
        steps += int(cut[i, 2])
    phases, k, work = np.empty((3, steps * s)), np.empty(steps * s), np.empty((5, steps * s))
    for i in range(cut.shape[0]):
        a, b = math.cos(cut[i, 1]), math.sin(cut[i, 1])
        for n in range(int(cut[i, 2])):
            for j in range(s):
                theta = phases[0, at] = cut[i, 0] + cut[i, 1] * (n + x[j])
                if n:  # those of the step before, turned on
                    c, d = phases[1, at - s], phases[2, at - s]
                    phases[1, at], phases[2, at] = a * c - b * d, a * d + b * c
                else:
                    phases[1, at], phases[2, at] = math.cos(theta), math.sin(theta)
                at += 1
    D = np.empty((1, steps, s, ports.shape[0]))
    for p in range(ports.shape[0]):
        for i in range(steps * s):
            k[i] = -numbers.linear.springs[0, ports[p]]
        stiffness(numbers, _waves(numbers, rows[ports[p]], ports[p]), ports[p], phases, work, k)
        for i in range(steps * s):
            D[0, i // s, i % s, p] = k[i]
    return D


@kernel
def monodromy(modes: Any, cut: Any, omega: float, D: Any, x: Any, L: Any, out: Any) -> None:
    """Put the real matrix (r, r) that carries a disturbance over a period in out.

    D (orders, steps, s, g): dp/dd - kr, and with two orders dp/dv, at the Gauss points of all steps.
    """
    s, g, q, r, orders = x.shape[0], modes.output.shape[0], modes.poles.shape[0], out.shape[0], D.shape[0]
    ends, state = np.ones(s + 1), np.zeros((2 * q, r))
    for i in range(s):
        ends[i] = x[i]
    for k in range(q):
        state[k, k] = 1.0
    for k in range(r - q):
        state[q + k, q + k] = 1.0
    turns, work = np.empty((s + 1, q), dtype=np.complex128), np.empty((s + 2, (s + 1) * q), dtype=np.complex128)
    A, R = np.empty((orders, s * g, s * g)), np.empty((orders, s * g, 2 * q))
    B = np.empty((2 * q, s * g))
    M, shown = np.empty((s * g, s * g + r)), np.empty((s * g, 2 * q))
    u = np.empty((s * g, r))
    step = 0
    for i in range(cut.shape[0]):
        moments(modes.poles, cut[i, 1] / omega, ends, turns, work)
        _tables(modes, turns, work, L, A, R, B)
        for _ in range(int(cut[i, 2])):
            _answer(A, R, D[:, step], state, M, shown, u)
            _turned(turns[s], state)
            _add_product(B, u, -1.0, state)
            step += 1
    for k in range(r):
        for n in range(r):
            out[k, n] = state[k, n]


@kernel
def _tables(modes: Any, turns: Any, work: Any, L: Any, A: Any, R: Any, B: Any) -> None:
    """A, R and B of a step, from `moments`: rows and columns are Gauss points and ports; modes are in real numbers.

    The modes are summed before the monomials are put together to Lagrange polynomials, at a part of the cost.
    """
    s, g, q, orders = turns.shape[0] - 1, modes.output.shape[0], modes.poles.shape[0], A.shape[0]
    A[:, :, :] = 0.0
    w = np.empty(q, dtype=np.complex128)
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


@bare
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


@bare
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


@bare
def _answer(A: Any, R: Any, D: Any, state: Any, M: Any, shown: Any, u: Any) -> None:
    """u from (1 + D A) u = D R z_0; M and shown are room for [1 + D A  D R z_0] and D R."""
    n, g = u.shape[0], D.shape[2]
    for i in range(n):
        for o in range(D.shape[0]):
            d = D[o, i // g, i % g]
            for j in range(n):
                M[i, j] = d * A[o, i, j] + (M[i, j] if o else 0.0)
            for j in range(shown.shape[1]):
                shown[i, j] = d * R[o, i, j] + (shown[i, j] if o else 0.0)
        M[i, i] += 1.0
        for j in range(u.shape[1]):
            u[i, j] = 0.0
    _add_product(shown, state, 1.0, u)
    for i in range(n):
        for j in range(u.shape[1]):
            M[i, n + j] = u[i, j]
    eliminate(M)
    for i in range(n):
        for j in range(u.shape[1]):
            u[i, j] = M[i, n + j]


@bare
def _turned(turn: Any, state: Any) -> None:
    """e^{poles h} z in the place of z."""
    q = turn.shape[0]
    for k in range(q):
        a, b = turn[k].real, turn[k].imag
        for j in range(state.shape[1]):
            x, y = state[k, j], state[q + k, j]
            state[k, j], state[q + k, j] = a * x - b * y, b * x + a * y


@bare
def step_of(fast: float, omega: float, nu: int, schemes: Any, share: float) -> tuple[int, float]:
    """Which scheme, and its longest step [rad], for springs that turn the state by ``fast``; see `monodromies`."""
    which = 0 if fast * 2 * math.pi / omega <= schemes[2] else 1
    width = schemes[0][2] if which == 0 else schemes[1][2]
    return which, min(width * omega / max(fast, 1e-300), share * 2 * math.pi / nu)


@kernel
def monodromies(
    numbers: Any, modes: Any, X: Any, Omega: Any, mobility: Any, schemes: Any, share: float, most: float, out: Any
) -> float:
    """Matrices (P, r, r) of motions X (P, n) at Omega (P,) of a model whose laws are all in the table.

    schemes : for a motion whose period the springs turn by few radians and for a long one, (x, L, width), and the
    radians between. Returns 0, or the number of steps of a period if it exceeds ``most``.
    """
    nu = numbers.linear.nu
    m, coarse = mobility.shape[0], circle(COARSE * nu)
    space = space_of(numbers, m, X.shape[1] // (2 * m), 0)
    for p in range(X.shape[0]):
        rows, omega = X[p].reshape(m, -1), Omega[p] / nu
        fast = pace(numbers, rows, mobility, coarse)
        which, longest = step_of(fast, omega, nu, schemes, share)
        x, L, _ = schemes[0] if which == 0 else schemes[1]
        count: float = 2 * math.pi / longest
        if count > most:
            return count
        cut = pieces(corners(numbers, rows, space), longest)
        D = moduli(numbers, rows, modes.ports, cut, x)
        monodromy(modes, cut, omega, D, x, L, out[p])
    return 0.0
