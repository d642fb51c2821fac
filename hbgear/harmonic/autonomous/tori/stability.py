"""Stability of tori: growth of disturbances of a motion on a torus, from the variational equation.

    z' = poles z - input u,   u_j = (dp_j/dd - kr_j) d_j + dp_j/dv d_j',   d = output z

The slopes depend on both phases. The flow of the first phase over one period T, P(phi), is computed for equidistant
second phases phi, in steps of collocation at Gauss points as in `hbgear.harmonic.multipliers.floquet`. It is smooth in
phi where the slopes are, so that its Fourier series gives the flow of every period,

    w_(p+1) = P(phi + p rho) w_p,   rho = Omega_2 T,   growth = average of log |w_(p+1)| / |w_p|

The weighted Birkhoff average converges faster than any power of the number of periods where the motion rotates
regularly. A torus of unknown second frequency has a neutral disturbance t, the shift of the second phase; w is taken
modulo t, so that the growth is the largest one of the other disturbances. A torus is stable if it is negative.

References
----------
Jorba (2001), Nonlinearity 14(5), https://doi.org/10.1088/0951-7715/14/5/303.
Das, Saiki, Sander & Yorke (2017), Nonlinearity 30(11), https://doi.org/10.1088/1361-6544/aa84c2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.stability import UNDECIDED, UNKNOWN
from hbgear.harmonic.multipliers.gauss_points import gauss_nodes
from hbgear.harmonic.multipliers.sampled_slopes import slope_pairs

_POINTS = 6
"""Gauss points of a step [-]; the order of the steps is 12."""

_LONGEST_STEP = 1.2
"""Angle [rad] by which the stiffest springs turn the inertia in one step, as for periodic motions."""

_MAX_FLOW_NUMBERS = 4_000_000
"""Largest number of entries of the flows of all second phases [-]: 64 MB."""

_PERIODS = (256, 1024, 4096)
"""Numbers of periods of the averages [-]; the next one is used while the growth is not known well enough."""

_TRAJECTORIES = 3
"""Number of motions whose averages are compared [-]; they begin at different second phases."""

_WARM_UP = 0.25
"""Fraction of the periods [-] in which a disturbance turns to the direction of largest growth; it is left out."""

_SUFFICIENT = 0.1
"""Error of the growth over the growth [-] from which the sign is known with a margin."""

_FINEST = 8
"""Largest factor of the number of steps [-] that is tried; slopes with jumps need small steps."""


class Growth(NamedTuple):
    """Growth of disturbances of a torus.

    Attributes
    ----------
    rate : float
        Mean logarithmic growth of the fastest growing disturbance per period 2 pi nu / Omega; nan if it is unknown.
    error : float
        Its estimated error: the change with other steps, motions and averages, and without the outermost harmonics,
        and the relative error of the torus. The latter is the largest one of the neutral disturbance after a period,
        or, with two prescribed frequencies, the size of the outermost harmonics relative to the alternating part.
    reason : str
        Reason why it is unknown; else empty.

    Examples
    --------
    >>> Growth(-0.2, 1e-6, "").reason
    ''
    """

    rate: float
    error: float
    reason: str


def growth_of(problem: Any, X: Array, parameters: Mapping[str, float]) -> Growth:
    """Return the growth of disturbances of a torus X (n + 1,), its coefficients and second frequency."""
    reason = obstacle(problem, parameters)
    if reason:
        return Growth(math.nan, math.nan, reason)
    cut, steps = _without_outermost(problem, X), 1
    coarse = _rate(_Flow(problem, cut, parameters, steps))
    while True:
        steps *= 2
        flow = _Flow(problem, X, parameters, steps)
        fine = _rate(flow)
        torus_error = _relative_error(problem, X) if flow.neutral is None else flow.neutral_error()
        error = fine[1] + abs(fine[0] - coarse[0]) + torus_error
        if error - torus_error <= max(_SUFFICIENT * abs(fine[0]), torus_error) or steps >= _FINEST:
            return Growth(fine[0], error, "")
        coarse = fine if steps > 2 else _rate(_Flow(problem, cut, parameters, steps))


def stability_remark(tori: Branch) -> str:
    """Return a sentence that states where, and why, the stability of a branch is not determined."""
    if tori.multipliers is None:
        return ""
    unsure = np.isin(tori.stability_codes, (UNDECIDED, UNKNOWN))
    unsure[[point.index for point in tori.special if point.kind == "EP"]] = False  # a Neimark-Sacker point is neutral
    count = int(np.count_nonzero(unsure))
    if not count:
        return ""
    reason = obstacle(tori.problem, tori.parameters_at(0)) or "disturbances change by less than the error of the growth"
    return f"stability not determined at {count} of {len(tori)} points: {reason}"


def obstacle(problem: Any, parameters: Mapping[str, float]) -> str:
    """Return the reason why the variational equation of a model is not available; empty if it is."""
    evaluator = problem.evaluator_at(parameters)
    if evaluator.damped:
        return "the force of contacts with dampers jumps"
    states = len(evaluator.structure.modes.poles)
    if states**2 * problem.basis.shape[1] > _MAX_FLOW_NUMBERS:
        return f"{states} states and {problem.basis.shape[1]} phases are too many: reduce the model"
    return ""


def _relative_error(problem: Any, X: Array) -> float:
    """Return the size of the outermost coefficients, relative to the alternating part of the motion."""
    c, basis = problem.basis.to_complex(X[:-1].reshape(problem.balance.m, -1)), problem.basis
    size = basis.rms(np.where(basis.k.any(axis=1), c, 0.0))
    return float(problem.layout.outermost_rms(X[:-1]) / max(size, 1e-300))


def _without_outermost(problem: Any, X: Array) -> Array:
    """Return the unknowns without the outermost coefficients."""
    basis = problem.basis
    c = basis.to_complex(X[:-1].reshape(problem.balance.m, -1))
    return np.append(basis.to_real(np.where(basis.outermost, 0.0, c)).ravel(), X[-1])


class _Flow:
    """Fourier series of the flows over a period of the first phase, and of the neutral disturbance.

    Attributes
    ----------
    series : ndarray, shape (F, r, r)
        Coefficients of the flow P(phi) of r modal states, of the orders ``orders`` (F,).
    neutral : ndarray, shape (F, r) or None
        Coefficients of the disturbance that is not counted.
    rho : float
        Change of the second phase in a period [rad].
    """

    def __init__(self, problem: Any, X: Array, parameters: Mapping[str, float], factor: int) -> None:
        d, unknown = problem.split(X)
        basis, evaluator = problem.basis, problem.evaluator_at(parameters)
        omega = np.array([parameters["Omega"] / problem.balance.nu, *unknown.values()])
        modes, kr = evaluator.structure.modes, evaluator.structure.kr
        period, count = 2 * math.pi / omega[0], basis.shape[1]
        c, w = basis.to_complex(d.reshape(problem.balance.m, -1)), basis.k @ omega
        forces = problem.forces(evaluator, c, w)
        pairs, largest = slope_pairs(evaluator), np.zeros(len(kr))
        np.add.at(largest, pairs[:, 0], np.abs(forces.stiffness).max(axis=(1, 2)))
        mobility = np.abs(np.einsum("jr,r,rj->j", modes.output, modes.poles, modes.input))
        fastest = max(float(np.sqrt((mobility * largest).max())), math.pi * omega[0])
        steps = factor * math.ceil(period * fastest / _LONGEST_STEP)
        step = _Step(modes.poles, modes.output[pairs[:, 1]], modes.input[:, pairs[:, 0]], period / steps)
        t = ((np.arange(steps)[:, None] + step.nodes) * step.h).ravel()
        k, b = problem.slopes(X, parameters, t, 2 * math.pi * np.arange(count) / count)
        k[:, : len(kr)] -= kr[:, None]
        k = k.reshape(count, len(pairs), steps, _POINTS)
        b = None if b is None else b.reshape(k.shape)
        P = np.broadcast_to(np.eye(len(modes.poles), dtype=complex), (count, *(2 * [len(modes.poles)])))
        for i in range(steps):
            P = step.advanced(P, k[:, :, i], None if b is None else b[:, :, i])
        self.orders = np.fft.fftfreq(count, 1.0 / count)
        self.series = np.fft.fft(P, axis=0) / count
        self.rho = float(omega[1] * period)
        self.neutral: ComplexArray | None = None
        if problem.free_phase:
            load = forces.p - kr[:, None] * c
            self.neutral = self._shifted(basis.k, load, w, modes)

    def _shifted(self, k: Any, load: ComplexArray, w: Array, modes: Any) -> ComplexArray:
        """Return the series in the second phase, at theta_1 = 0, of the derivative of the modal states in it."""
        out = np.zeros((len(self.orders), len(modes.poles)), dtype=complex)
        for i in np.flatnonzero(k[:, 1] > 0):
            for sign, u in ((1, load[:, i]), (-1, load[:, i].conj())):
                order = sign * int(k[i, 1])
                out[order] -= 0.5j * order * (modes.input @ u) / (1j * sign * w[i] - modes.poles)
        return out

    def neutral_error(self) -> float:
        """Return the largest error of the neutral disturbance after a period, relative to its largest size."""
        assert self.neutral is not None
        phi = 2 * math.pi * np.arange(len(self.orders)) / len(self.orders)
        before, after = (np.exp(1j * (phi + turn)[:, None] * self.orders) @ self.neutral for turn in (0.0, self.rho))
        flows = np.fft.ifft(self.series, axis=0) * len(self.orders)
        mapped = (flows @ before[:, :, None])[:, :, 0]
        size = float(np.linalg.norm(before, axis=1).max())
        return float(np.linalg.norm(mapped - after, axis=1).max()) / max(size, 1e-300)

    def at(self, phi: Array) -> tuple[ComplexArray, ComplexArray | None]:
        """Return the flows (B, r, r) from second phases (B,), and neutral directions (B, r) there."""
        waves = np.exp(1j * phi[:, None] * self.orders)
        flows = np.einsum("bf,fij->bij", waves, self.series, optimize=True)
        if self.neutral is None:
            return flows, None
        t = waves @ self.neutral
        return flows, t / np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-300)


class _Step:
    """One step of collocation of the variational equation; see `hbgear.harmonic.multipliers.floquet`.

    ``output`` (S, r) are the modal displacements and ``inputs`` (r, S) the modal forces of the slopes.
    """

    def __init__(self, poles: ComplexArray, output: ComplexArray, inputs: ComplexArray, h: float) -> None:
        from hbgear.harmonic.multipliers.phi_functions import integrals

        self.h = h
        self.nodes, L = gauss_nodes(_POINTS)
        ends = np.append(self.nodes, 1.0)
        turns = np.empty((_POINTS + 1, len(poles)), dtype=complex)
        inside = np.empty((_POINTS, _POINTS + 1, len(poles)), dtype=complex)
        integrals(poles, h, ends, L, turns, inside, np.empty((_POINTS + 2, turns.size), dtype=complex))
        self.factors = turns[-1]
        self.free = np.einsum("jr,ir->ijr", output, turns[:-1])  # displacements at the nodes
        self.free_rate = self.free * poles
        A = np.einsum("jr,pir,rl->ijpl", output, inside[:, :-1], inputs, optimize=True).real
        dA = np.einsum("jr,r,pir,rl->ijpl", output, poles, inside[:, :-1], inputs, optimize=True).real
        nodes = np.arange(_POINTS)
        dA[nodes, :, nodes] += (output @ inputs).real
        self.inside, self.inside_rate = A, dA
        self.end = np.einsum("pr,rl->rpl", inside[:, -1], inputs).reshape(len(poles), -1)

    def advanced(self, P: ComplexArray, k: Array, b: Array | None) -> ComplexArray:
        """Return flows (B, r, r) after the step, with slopes (B, m, s) in the displacements and rates."""
        size = self.end.shape[1]

        def applied(k: Array, matrix: Any) -> Any:
            return k.transpose(0, 2, 1).reshape(-1, size, 1) * matrix.reshape(size, -1)

        matrix, right = applied(k, self.inside), applied(k, self.free)
        if b is not None:
            matrix, right = matrix + applied(b, self.inside_rate), right + applied(b, self.free_rate)
        matrix = matrix + np.eye(size)
        u = np.linalg.solve(matrix, right @ P)
        return self.factors[:, None] * P - self.end @ u


def birkhoff_weights(count: int) -> Array:
    """Return the weights (count,) of a weighted average, exp(-1 / (t (1 - t))) for t from 0 to 1, with the sum 1."""
    t = (np.arange(count) + 0.5) / count
    w = np.exp(-1.0 / (t * (1.0 - t)))
    return w / w.sum()


def _rate(flow: _Flow) -> tuple[float, float]:
    """Return the growth of a disturbance per period, and the difference of its averages."""
    rate = error = math.nan
    for periods in _PERIODS:
        rate, error = _average(flow, periods)
        if error <= 0.5 * _SUFFICIENT * abs(rate):
            break
    return rate, error


def _average(flow: _Flow, periods: int) -> tuple[float, float]:
    """Return the average growth of some motions over a number of periods, and its largest difference."""
    r, B = flow.series.shape[1], _TRAJECTORIES
    begin = 2 * math.pi * np.arange(B) / B
    w = np.random.default_rng(0).normal(size=(B, r, 2)) @ [1.0, 1j]
    phi = begin + flow.rho * np.arange(periods + 1)[:, None]
    P, t = flow.at(phi.ravel())
    P, t = P.reshape(periods + 1, B, r, r), None if t is None else t.reshape(periods + 1, B, r)
    if t is not None:
        w -= t[0] * (t[0].conj() * w).sum(axis=1, keepdims=True)
    logs = np.empty((periods, B))
    for p in range(periods):
        w = (P[p] @ w[:, :, None])[:, :, 0]
        if t is not None:
            w -= t[p + 1] * (t[p + 1].conj() * w).sum(axis=1, keepdims=True)
        size = np.linalg.norm(w, axis=1)
        # the disturbance is scaled to unit size in every period, so that it does not overflow
        logs[p] = np.log(size)
        w /= size[:, None]
    logs = logs[int(_WARM_UP * periods) :]
    half = logs[: len(logs) // 2], logs[len(logs) // 2 :]
    averages = np.array([birkhoff_weights(len(sample)) @ sample for sample in (logs, *half)])
    rate = float(averages[0].mean())
    return rate, float(np.abs(averages - rate).max())
