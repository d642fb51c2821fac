"""Kernels of monodromy matrices; the method is explained in `floquet`.

In a step of length h from the state z_0 of the modes, with u = D d at s Gauss points,

    d(c_i h) = output e^{poles c_i h} z_0 - sum_j A_ij u_j - rest u_i
    A_ij = int_0^{c_i h} output e^{poles (c_i h - x)} input L_j(x) dx
    z_1 = e^{poles h} z_0 - sum_j (int_0^h e^{poles (h - x)} input L_j(x) dx) u_j

If D is constant in each segment, the exact flow of `constant_flow` replaces the collocation.

A friction slider has one more state, the disturbance y of its position. While it sticks, u = (D + k) d - k y and y is
constant. While it slips, its force does not change, or is proportional to the displacement d_n of a normal force. Where
it begins to stick, y = d + slope d_n (`SliderWorkspace.position_slope`); no other saltation is needed, because the
force is continuous. The last columns and rows of the matrix are those of the sliders. A
slider that never slips has a prescribed position: its column is zero instead of a multiplier +1.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.process.compiling import inlined, kernel
from hbgear.continuation.numerics.gauss_kernels import add_product, solve_in_place
from hbgear.harmonic.forces.piecewise_kernels import fill_gap, fill_phases, sizes_of
from hbgear.harmonic.forces.projection_kernels import cross, projection_workspace
from hbgear.harmonic.forces.slider_kernels import OPEN, STICK, insert_events, interval_at, sticks_at
from hbgear.harmonic.multipliers.constant_flow import apply_flow, fill_displacements, fill_flow, flow_workspace
from hbgear.harmonic.multipliers.gauss_points import MAX_STEP_OVER_PERIOD, MAX_STEPS_PER_PERIOD
from hbgear.harmonic.multipliers.phi_functions import fill_step_matrices, moments
from hbgear.harmonic.multipliers.stiffness_kernels import (
    MODULATION_SAMPLES,
    add_stiffness,
    circle,
    modulation_order,
    modulation_rate,
)


class MonodromyWorkspace(NamedTuple):
    """Preallocated arrays for the integration of the variational equation of a motion over one period.

    A period has T Gauss points: s in each of its steps. The model has g ports and q modes, the displacements of c ports
    and the forces of b ports are independent, and the matrices have r columns. The number of orders is 1, or 2 if dp/dv
    is not zero.

    Attributes
    ----------
    phases : ndarray, shape (3, T)
        Phases of the Gauss points [rad], their cosines and sines.
    stiffness : ndarray, shape (T,)
        Modulation of the stiffness of one port.
    work : ndarray, shape (6, T)
        Working memory of `add_stiffness`.
    D : ndarray, shape (orders, T / s, s, g)
        Modulations dp/dd - kr, and dp/dv, of all ports, see `fill_stiffness_modulation`.
    ends : ndarray, shape (s + 1,)
        Gauss points and end of a step, in units of the step.
    state : ndarray, shape (2q, r)
        Real and imaginary parts of the modes.
    turns, moments : ndarray, shapes (s + 1, q) and (s + 2, (s + 1) q)
        Response of the modes in a step, see `hbgear.harmonic.multipliers.phi_functions.moments`.
    weighted_output : ndarray, shape (q,)
        Output of the modes at one port.
    A, R, B : ndarray, shapes (orders, s c, s b), (orders, s c, 2q) and (2q, s b)
        Matrices of a step, see `fill_step_matrices`.
    M, DR, u : ndarray, shapes (s b, s b + r), (s b, 2q) and (s b, r)
        System of equations of a step, S R, and the solution u, see `_solve_collocation`.
    memory, forces, base_forces : ndarray, shapes (Q, r), (g, r) and (b, r)
        Disturbances of the sliders, and their constant forces k y in a step, on all and on the independent ports.
    stuck : ndarray, shape (Q,)
        Whether each slider sticks.
    flow : FlowWorkspace
        Exact flow of a segment, and the displacements of the ports at its end.
    """

    phases: Array
    stiffness: Array
    work: Array
    D: Array
    ends: Array
    state: Array
    turns: ComplexArray
    moments: ComplexArray
    weighted_output: ComplexArray
    A: Array
    R: Array
    B: Array
    M: Array
    DR: Array
    u: Array
    memory: Array
    forces: Array
    base_forces: Array
    stuck: np.ndarray
    flow: Any


@kernel
def monodromy_workspace(modes: Any, size: int, s: int, steps: Any, orders: int, number: Any) -> Any:
    """Return a `MonodromyWorkspace` for ``size`` columns, ``steps`` steps of s points and a ``number`` of sliders."""
    g, q, T = modes.output.shape[0], modes.poles.shape[0], steps * s
    c, b = s * modes.base.output.shape[0], modes.base.input.shape[1]
    return MonodromyWorkspace(
        np.empty((3, T)),
        np.empty(T),
        np.empty((6, T)),
        np.empty((orders, steps, s, g)),
        np.empty(s + 1),
        np.empty((2 * q, size)),
        np.empty((s + 1, q), np.complex128),
        np.empty((s + 2, (s + 1) * q), np.complex128),
        np.empty(q, np.complex128),
        np.empty((orders, c, s * b)),
        np.empty((orders, c, 2 * q)),
        np.empty((2 * q, s * b)),
        np.empty((s * b, s * b + size)),
        np.empty((s * b, 2 * q)),
        np.empty((s * b, size)),
        np.empty((number, size)),
        np.zeros((g, size)),
        np.empty((b, size)),
        np.empty(number, np.bool_),
        flow_workspace(g, q, size),
    )


@kernel
def segment_arrays(packed: Any, space: Any) -> Any:
    """Return empty arrays of breakpoint phases (C,) and of the segments (C + 1, 3); see `partition_period`."""
    C = sizes_of(packed.piecewise)[0] + space.theta.size + _event_count(space.slides)
    return np.empty(C), np.empty((C + 1, 3))


@kernel
def _event_count(slides: Any) -> int:
    """Return the largest number of slider events of a period."""
    if slides is None:
        return 0
    return int(slides.begin.size)


@kernel
def slider_count(sliders: Any) -> int:
    """Return the number of sliders."""
    if sliders is None:
        return 0
    return int(sliders.element.shape[0])


@inlined
def partition_period(
    packed: Any, coefficients: Any, longest: float, space: Any, theta: Any, segments: Any
) -> tuple[int, int]:
    """Fill ``segments`` with the smooth segments of a period between the breakpoints of a motion.

    theta : overwritten with the phases of `_fill_breakpoints`. Return the result of `_fill_segments`.
    """
    return _fill_segments(theta, _fill_breakpoints(packed, coefficients, space, theta), longest, segments)


@inlined
def _fill_breakpoints(packed: Any, coefficients: Any, space: Any, out: Any) -> int:
    """Fill ``out`` with the ascending phases in [0, 2 pi) of all breakpoints, and return their number.

    At such a phase an element crosses a breakpoint of its law, a slider slips or sticks, or the excitation has a
    breakpoint.
    """
    cross(packed, coefficients, np.bool_(False), space)
    theta, count = space.theta, space.number
    n = fill_phases(packed.piecewise, out)
    for i in range(count.shape[0]):
        for j in range(count[i]):
            phase, k = theta[i, j] % (2 * math.pi), n
            while k > 0 and out[k - 1] > phase:
                out[k] = out[k - 1]
                k -= 1
            out[k] = phase
            n += 1
    return insert_events(packed.sliders, packed.basis, coefficients, space.slides, out, n)


@kernel
def _fill_segments(theta: Any, n: int, longest: float, out: Any) -> tuple[int, int]:
    """Divide the smooth segments of a period between n phases theta into equal steps of at most ``longest`` radians.

    The period begins at its first breakpoint, or else at 0; the multipliers do not depend on where it begins. ``out``
    (n + 1, 3) is filled with the first phase, the length of the steps in radians and the number of steps of each
    segment.

    Returns
    -------
    int, int
        Number of segments, and of all steps.
    """
    count = step_count = 0
    for i in range(max(n, 1)):
        start = theta[i] if n else 0.0
        end = theta[i + 1] if i + 1 < n else 2 * math.pi + (theta[0] if n else 0.0)
        width = end - start
        if width > 1e-13:
            steps = max(1.0, math.ceil(width / longest - 1e-9))
            out[count, 0], out[count, 1], out[count, 2] = start, width / steps, steps
            count += 1
            step_count += int(steps)
    return count, step_count


@inlined
def fill_stiffness_modulation(
    packed: Any, coefficients: Any, ports: Any, segments: Any, count: int, x: Any, space: Any, workspace: Any
) -> None:
    """Fill D = dp/dd - kr of the ports at the Gauss points x of all steps; ``space`` as of `partition_period`."""
    s, phases, k, c = x.shape[0], workspace.phases, workspace.stiffness, space.waves
    total: Any = np.int64(0)  # a literal would compile each called kernel a second time
    for i in range(count):
        a, b = math.cos(segments[i, 1]), math.sin(segments[i, 1])
        for n in range(int(segments[i, 2])):
            for j in range(s):
                theta = phases[0, total] = segments[i, 0] + segments[i, 1] * (n + x[j])
                if n:  # rotate the values of the previous step
                    u, v = phases[1, total - s], phases[2, total - s]
                    phases[1, total], phases[2, total] = a * u - b * v, a * v + b * u
                else:
                    phases[1, total], phases[2, total] = math.cos(theta), math.sin(theta)
                total += 1
    for p in range(ports.shape[0]):
        for i in range(total):
            k[i] = -packed.linear.springs[0, ports[p]]
        fill_gap(packed.piecewise, coefficients[ports[p]], ports[p], c)
        add_stiffness(packed, c, ports[p], phases, total, workspace.work, k)
        _add_stuck(packed.sliders, space.slides, ports[p], segments, count, s, k)
        for i in range(total):
            workspace.D[0, i // s, i % s, p] = k[i]


@kernel
def _add_stuck(sliders: Any, slides: Any, j: int, segments: Any, count: int, s: int, k: Any) -> None:
    """Add the stiffness of the sliders of element j that stick to k, at the s Gauss points of all steps."""
    if sliders is None:
        return
    for q in range(sliders.element.shape[0]):
        first: Any = np.int64(0)
        for i in range(count if sliders.element[q] == j else 0):
            points = int(segments[i, 2]) * s
            if sticks_at(slides.number[q], slides.begin[q], slides.kind[q], _middle(segments, i)):
                for n in range(first, first + points):
                    k[n] += sliders.k[q]
            first += points


@kernel
def _middle(segments: Any, i: int) -> float:
    """Return the phase in the middle of a segment."""
    return float(segments[i, 0] + 0.5 * segments[i, 1] * segments[i, 2])


@kernel
def _begin_memory(sliders: Any, slides: Any, segments: Any, count: int, r: int, modes: Any, workspace: Any) -> None:
    """Set the disturbances of the sliders to the last unit vectors, and the displacements of the ports.

    Sliders and modulations, which determine these displacements, have their values at the end of the period.
    """
    if sliders is None:
        return
    workspace.memory[:, :] = 0.0
    last, phase = -1, _middle(segments, count - 1)
    for i in range(count):
        last += int(segments[i, 2])
    for i in range(sliders.element.shape[0]):
        workspace.stuck[i] = sticks_at(slides.number[i], slides.begin[i], slides.kind[i], phase)
        workspace.memory[i, r + i] = 1.0 if slides.slips[i] else 0.0
    _fill_slider_forces(sliders, modes, workspace)
    fill_displacements(modes, workspace.D[0, last, -1], workspace.state, workspace.forces, workspace.flow)


@kernel
def _enter_segment(sliders: Any, slides: Any, phase: float, modes: Any, workspace: Any) -> None:
    """Set the states of the sliders in a segment, and their forces on the ports."""
    if sliders is None:
        return
    for i in range(sliders.element.shape[0]):
        interval = interval_at(slides.number[i], slides.begin[i], phase)
        sticks = slides.kind[i, interval] == STICK
        if sticks and not workspace.stuck[i]:
            normal = _port_of(modes.ports, sliders.normal[i])
            _set_memory(
                workspace, i, _port_of(modes.ports, sliders.element[i]), normal, slides.position_slope[i, interval]
            )
        workspace.stuck[i] = sticks
    _fill_slider_forces(sliders, modes, workspace)


@kernel
def _fill_slider_forces(sliders: Any, modes: Any, workspace: Any) -> None:
    """Compute the forces k y of the sliders that stick on the ports."""
    workspace.forces[:, :] = 0.0
    for i in range(sliders.element.shape[0]):
        p = _port_of(modes.ports, sliders.element[i])
        for n in range(workspace.forces.shape[1] if workspace.stuck[i] and p >= 0 else 0):
            workspace.forces[p, n] += sliders.k[i] * workspace.memory[i, n]


@kernel
def _port_of(ports: Any, j: int) -> int:
    """Return the number of the port of element j, -1 if it has none."""
    for p in range(ports.shape[0]):
        if ports[p] == j:
            return p
    return -1


@kernel
def _set_memory(workspace: Any, i: int, p: int, normal: int, slope: float) -> None:
    """Set the disturbance of slider i to d + slope d_n, from the displacements of ports p and normal (-1: none)."""
    d, memory = workspace.flow.displacements, workspace.memory
    for n in range(memory.shape[1]):
        memory[i, n] = (d[p, n] if p >= 0 else 0.0) + (slope * d[normal, n] if normal >= 0 and slope != 0.0 else 0.0)


@kernel
def _end_memory(
    sliders: Any, slides: Any, phase: float, modes: Any, r: int, factor: float, workspace: Any, out: Any
) -> None:
    """Store the disturbances of the sliders at the end of the period in the last rows of the monodromy matrix."""
    if sliders is None:
        return
    for i in range(sliders.element.shape[0]):
        if not workspace.stuck[i]:
            interval = interval_at(slides.number[i], slides.begin[i], phase)
            gain = 0.0 if slides.kind[i, interval] == OPEN else sliders.gain[i, slides.zone[i, interval]]
            normal = _port_of(modes.ports, sliders.normal[i])
            slope = -slides.kind[i, interval] * gain / sliders.k[i]
            _set_memory(workspace, i, _port_of(modes.ports, sliders.element[i]), normal, slope)
        for n in range(out.shape[1]):
            out[r + i, n] = factor * workspace.memory[i, n]


@kernel
def monodromy(
    sliders: Any, slides: Any, modes: Any, segments: Any, omega: float, scheme: Any, exact: Any, work: Any, out: Any
) -> None:
    """Compute the real monodromy matrix (r + Q, r + Q) of r modal states and Q sliders into ``out``.

    ``scheme`` holds the Gauss points x and L. D of the workspace holds dp/dd - kr, and with two orders dp/dv, at the
    Gauss points of all steps; with ``exact`` it is constant in each segment. Where disturbances grow beyond 1e300 the
    matrix is scaled, so that its largest entry is about that number; not with sliders.
    """
    (x, L), workspace, count = scheme, work, segments.shape[0]
    s, q, size = x.shape[0], modes.poles.shape[0], out.shape[0]
    r = size - slider_count(sliders)
    ends, state, turns = workspace.ends, workspace.state, workspace.turns
    ends[s] = 1.0
    for i in range(s):
        ends[i] = x[i]
    for k in range(2 * q):
        for n in range(size):
            state[k, n] = 1.0 if k == n and n < r else 0.0
    step: Any = np.int64(0)
    log = 0.0
    _begin_memory(sliders, slides, segments, count, r, modes, workspace)
    for i in range(count):
        _enter_segment(sliders, slides, _middle(segments, i), modes, workspace)
        if exact:
            fill_flow(modes, workspace.D[0, step, 0], workspace.forces, segments[i, 1] / omega, workspace.flow)
        else:
            moments(modes.poles, segments[i, 1] / omega, ends, turns, workspace.moments)
            fill_step_matrices(modes, L, workspace)
            workspace.base_forces[:, :] = 0.0
            add_product(modes.base.action, workspace.forces, 1.0, workspace.base_forces)
        for _ in range(int(segments[i, 2])):
            if exact:
                apply_flow(workspace.flow, state)
            else:
                _solve_collocation(modes.base, workspace, step)
                _propagate(turns[s], state)
                add_product(workspace.B, workspace.u, -1.0, state)
            step += 1
            if step % STEPS_BETWEEN_OVERFLOW_CHECKS == 0 and size == r:
                log += _rescale(state, STATE_SCALING_THRESHOLD)
        if size > r:
            fill_displacements(modes, workspace.D[0, step - 1, -1], state, workspace.forces, workspace.flow)
    if size == r:
        log += _rescale(state, 1.0 if log > 0.0 else STATE_SCALING_THRESHOLD)
    factor = math.exp(min(log, math.log(MAX_MONODROMY_ENTRY))) if log > 0.0 else 1.0
    for k in range(r):
        for n in range(size):
            out[k, n] = factor * state[k, n]
    _end_memory(sliders, slides, _middle(segments, count - 1), modes, r, factor, workspace, out)


@kernel
def _solve_collocation(base: Any, workspace: Any, step: int) -> None:
    """Solve (1 + S A) u = S R z_0 - k y of a step, with S = action D measure at each Gauss point.

    u are the forces of the independent ports. M holds [1 + S A  S R z_0 - k y] and ``DR`` the product S R.
    """
    D, A, R, M, DR, u = workspace.D, workspace.A, workspace.R, workspace.M, workspace.DR, workspace.u
    measure, action = base.measure, base.action
    n, b, c = u.shape[0], action.shape[0], measure.shape[1]
    M[:, :n], DR[:, :], u[:, :] = 0.0, 0.0, 0.0
    for i in range(n):
        point, force = i // b, i % b
        for o in range(D.shape[0]):
            for e in range(c):
                slope = 0.0
                for p in range(action.shape[1]):
                    slope += action[force, p] * D[o, step, point, p] * measure[p, e]
                if slope != 0.0:  # the sum is empty for most pairs if all ports are independent
                    row, observed = A[o, point * c + e], R[o, point * c + e]
                    for j in range(n):
                        M[i, j] += slope * row[j]
                    for j in range(DR.shape[1]):
                        DR[i, j] += slope * observed[j]
        M[i, i] += 1.0
    add_product(DR, workspace.state, 1.0, u)
    for i in range(n):
        for j in range(u.shape[1]):
            M[i, n + j] = u[i, j] - workspace.base_forces[i % b, j]
    solve_in_place(M)
    for i in range(n):
        for j in range(u.shape[1]):
            u[i, j] = M[i, n + j]


@kernel
def _propagate(factors: Any, state: Any) -> None:
    """Replace z by e^{poles h} z."""
    q = factors.shape[0]
    for k in range(q):
        a, b = factors[k].real, factors[k].imag
        for j in range(state.shape[1]):
            x, y = state[k, j], state[q + k, j]
            state[k, j], state[q + k, j] = a * x - b * y, b * x + a * y


@kernel
def step_of(rate: float, omega: float, nu: int, schemes: Any, modes: Any, mobility: Any) -> tuple[int, float]:
    """Return the scheme (0 short period, 1 long period) and its longest step [rad]; see `monodromies`.

    ``rate`` is the rate at which springs turn the state. Coupled modes limit the step to no less than 2 pi /
    `MAX_STEPS_PER_PERIOD`.
    """
    period = 2 * math.pi / omega
    scheme = 0 if rate * period <= schemes[2] else 1
    width, turn = (schemes[0][2], schemes[0][3]) if scheme == 0 else (schemes[1][2], schemes[1][3])
    highest = _highest_coupled_mode(modes, mobility, rate, period)
    resolved = max(turn * omega / max(highest, 1e-300), 2 * math.pi / MAX_STEPS_PER_PERIOD)
    return scheme, min(width * omega / max(rate, 1e-300), MAX_STEP_OVER_PERIOD * 2 * math.pi / nu, resolved)


MODE_ERROR = 1e-9
"""Error of a multiplier by a mode that is not resolved by the steps, up to which it does not limit them."""


@kernel
def _highest_coupled_mode(modes: Any, mobility: Any, rate: float, period: float) -> float:
    """Return the largest modulus of the poles whose modes the steps must resolve, 0 without such modes.

    The free vibration of a mode is no polynomial in a step that it turns by several radians. Let c be the stiffness of
    the elements times the flexibility of the mode, times the angle that the mode turns in a period. The error is then c
    for the multiplier of the mode itself, and c^2 for multipliers of slow modes, which excite it and which it excites.
    """
    highest = 0.0
    for k in range(modes.poles.shape[0]):
        size, participation = abs(modes.poles[k]), 0.0
        for p in range(modes.ports.shape[0]):
            j = modes.ports[p]
            if j >= 0 and mobility[j] > 0.0:
                participation = max(participation, size * abs(modes.output[p, k] * modes.input[k, p]) / mobility[j])
        c = rate * rate * participation * period / max(size, 1e-300)
        if size > highest and c * max(c, math.exp(min(0.0, modes.poles[k].real * period))) > MODE_ERROR:
            highest = size
    return highest


@kernel
def limit_step_by_order(longest: float, order: float, turn: float) -> float:
    """Return the longest step [rad] in which harmonics of `modulation_order` turn by at most ``turn``."""
    return min(longest, max(turn / max(order, 1e-300), 2 * math.pi / MAX_STEPS_PER_PERIOD))


MAX_GROWTH_EXPONENT = 10.0
"""Largest exponent by which a disturbance of an unstable mode grows in one step."""


STEPS_BETWEEN_OVERFLOW_CHECKS = 16
"""Steps after which the state is checked for overflow."""


STATE_SCALING_THRESHOLD = 1e100
"""Largest entry of the state above which it is scaled."""


MAX_MONODROMY_ENTRY = 1e300
"""Largest entry of a monodromy matrix; larger matrices are scaled to it."""


@kernel
def limit_step_by_growth(longest: float, omega: float, poles: Any) -> float:
    """Return the longest step [rad] in which disturbances of unstable modes do not overflow."""
    growth = 0.0
    for k in range(poles.shape[0]):
        growth = max(growth, poles[k].real)
    return min(longest, MAX_GROWTH_EXPONENT * omega / growth) if growth > 0.0 else longest


@kernel
def _rescale(state: Any, limit: float) -> float:
    """Divide a state with entries above a limit by its largest entry, and return the logarithm of the divisor, or 0."""
    largest = 0.0
    for k in range(state.shape[0]):
        for j in range(state.shape[1]):
            largest = max(largest, abs(state[k, j]))
    if largest <= limit:
        return 0.0
    for k in range(state.shape[0]):
        for j in range(state.shape[1]):
            state[k, j] /= largest
    return math.log(largest)


PRODUCTS_PER_EXPONENTIAL = 35
"""Products of matrices of a typical `fill_flow`: the terms of its series, and ten doublings."""


@kernel
def _exact_is_faster(segments: int, steps: float, s: int, g: int, q: int, columns: int) -> bool:
    """Return whether exact flows take fewer operations than collocation.

    The collocation has s points, q modes and g independent ports.
    """
    m, n = s * g, 2 * q
    exact = segments * PRODUCTS_PER_EXPONENTIAL * 2 * n**3
    step = m**3 // 2 + 2 * m * columns * (m + 2 * n)
    return exact <= max(steps, float(segments)) * step + segments * 2 * m * m * q


@kernel
def monodromies(
    packed: Any, modes: Any, X: Any, Omega: Any, mobility: Any, schemes: Any, resolve: Any, constant: Any, out: Any
) -> float:
    """Compute the monodromy matrices (P, r, r) of motions X (P, n) at Omega (P,) of a model without Python laws.

    ``schemes`` holds (x, L, width, turn) of a motion with a short period, the same of one with a long period, the angle
    [rad] that separates them, and (x, L) of exact flows; in a step, springs turn the state by ``width`` and modes by
    ``turn`` [rad] at most, and with ``resolve`` harmonics of the stiffness as well. With ``constant``, the stiffness of
    all elements is constant in each segment. Return 0, or the number of steps of a period if it exceeds
    `MAX_STEPS_PER_PERIOD`.
    """
    nu, m, size = packed.linear.nu, mobility.shape[0], out.shape[1]
    space = projection_workspace(packed, m, X.shape[1] // (2 * m), np.int64(0))
    samples = circle(MODULATION_SAMPLES * nu)
    work, stiffness = np.empty((6, MODULATION_SAMPLES * nu)), np.empty(MODULATION_SAMPLES * nu)
    theta, segments = segment_arrays(packed, space)
    number = slider_count(packed.sliders)
    typical = 1 + 2 * packed.laws.level.shape[0] + 4 * number
    workspace = monodromy_workspace(modes, size, schemes[0][0].shape[0], np.int64(MODULATION_SAMPLES), 1, number)
    for p in range(X.shape[0]):
        coefficients, omega = X[p].reshape(m, -1), Omega[p] / nu
        rate = modulation_rate(packed, coefficients, mobility, samples, space.waves, work, stiffness)
        scheme, longest = step_of(rate, omega, nu, schemes, modes, mobility)
        x, L = (schemes[0][0], schemes[0][1]) if scheme == 0 else (schemes[1][0], schemes[1][1])
        if resolve:
            turn = schemes[0][3] if scheme == 0 else schemes[1][3]
            order = modulation_order(packed, coefficients, space.waves, 1.0 / (2 * x.shape[0] + 1))
            longest = limit_step_by_order(longest, order, turn)
        exact = constant and _exact_is_faster(
            typical, 2 * math.pi / longest, x.shape[0], modes.base.input.shape[1], modes.poles.shape[0], size
        )
        if exact:
            x, L, longest = schemes[3][0], schemes[3][1], 2 * math.pi
        longest = limit_step_by_growth(longest, omega, modes.poles)
        count = 2 * math.pi / longest
        if count > MAX_STEPS_PER_PERIOD:
            return count
        segment_count, steps = partition_period(packed, coefficients, longest, space, theta, segments)
        if steps > workspace.D.shape[1] or x.shape[0] != workspace.D.shape[2]:
            workspace = monodromy_workspace(modes, size, x.shape[0], 2 * steps, 1, number)
        fill_stiffness_modulation(packed, coefficients, modes.ports, segments, segment_count, x, space, workspace)
        parts = segments[:segment_count]
        monodromy(packed.sliders, space.slides, modes, parts, omega, (x, L), exact, workspace, out[p])
    return 0.0
