"""Transition matrices of the flow between two instants, to rounding.

    Psi = 1 + Z,   Z(tau + h) = Z(tau) + sum_{k>0} h^k T_k,   T_0 = 1 + Z(tau)
    (k + 1) T_{k+1} = A T_k + sum_s b_s sum_j kappa_s,j (r_s^T T_{k-j})

With varying stiffness a Taylor series is used, in steps in which it converges fast; kappa_s,j are the Taylor
coefficients of the stiffness. With constant stiffness the matrix exponential is computed by scaling and squaring.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.instants.equations import DEGREE, Flow, shifted_polynomial
from hbgear.mechanics.series.fourier import Series, to_complex
from hbgear.mechanics.series.periodic import Periodic, Phased

TAYLOR_ORDER = 26
"""Order of the Taylor series."""

MAX_STEP_NORM = 2.0
"""Largest norm of the matrix times the step: 2^26 / 26! = 2e-19."""

PADE = (17297280.0, 8648640.0, 1995840.0, 277200.0, 25200.0, 1512.0, 56.0, 1.0)
"""Coefficients of the Pade approximant of order 7 of the exponential; the norm of its argument is at most 1/2."""

SLOPE_ORDER = 18
"""Order of the series of the derivative of Z / h."""


def growth(flow: Flow, tau: float, h: float) -> Array:
    """Return Z (N, N) with y(tau + h) = (1 + Z) y(tau); Z keeps its accuracy in short segments."""
    if not flow.stiffness:
        return exponential(flow.A * h)
    fastest = max((x.order for x in flow.stiffness if isinstance(x, Series)), default=0)
    steps = max(1, math.ceil(abs(h) * max(flow.rate / MAX_STEP_NORM, fastest)))
    Z = np.zeros_like(flow.A)
    for i in range(steps):
        Z = _step(flow, tau + i * h / steps, h / steps, Z)
    return Z


def growths(flows: Sequence[Flow], tau: Array, h: Array) -> Array:
    """Return `growth` (K, N, N) of K flows from phases tau (K,) on, each over its own interval h (K,)."""
    if not flows or any(flow.stiffness for flow in flows):
        found = [growth(flow, float(t), float(d)) for flow, t, d in zip(flows, tau, h, strict=True)]
        return np.array(found) if found else np.zeros((0, 0, 0))
    return exponential(np.array([flow.A for flow in flows]) * np.asarray(h)[:, None, None])


def growth_rate_slopes(flows: Sequence[Flow], tau: Array, h: Array, Z: Array) -> Array:
    """Return the derivatives (K, N, N) of Z(h) / h in h, without cancellation in short intervals.

    d/dh (Z / h) = A^2 sum_k k (A h)^(k - 1) / (k + 1)!                 constant stiffness, |A h| <= 1
    """
    A, d, unit = np.array([flow.A for flow in flows]), h[:, None, None], np.eye(Z.shape[-1])
    varying = np.array([bool(flow.stiffness) for flow in flows])
    short = (np.abs(A).sum(axis=1).max(axis=1) * np.abs(h) <= 1.0) & ~varying
    out = np.empty_like(Z)
    if short.any():
        a, M = A[short], A[short] * d[short]
        total = np.zeros_like(M)
        for k in range(SLOPE_ORDER, 0, -1):
            total = total @ M + unit * (k / math.factorial(k + 1))
        out[short] = a @ a @ total
    if not short.all():
        end = A @ (Z + unit)
        for i in np.flatnonzero(varying).tolist():
            end[i] = rates(flows[i], tau[i] + h[i], (Z[i] + unit).T).T
        out[~short] = ((end - Z / d) / d)[~short]
    return out


def path(Z: Array, y: Array, steps: int) -> Array:
    """Return the states (steps + 1, N) after 0, 1, ... steps of one growth Z from y, by doubling the known part."""
    out = np.empty((steps + 1, len(y)))
    out[0], known, power = y, 1, Z
    while known <= steps:
        more = min(known, steps + 1 - known)
        out[known : known + more] = out[:more] + out[:more] @ power.T
        known += more
        power = 2 * power + power @ power
    return out


def exponential(A: Array) -> Array:
    """Return the matrix exponential of A (..., N, N) minus the unit matrix, by scaling and squaring.

    e^X - 1 = (V - U)^-1 2 U,   U odd, V even part of the numerator of the Pade approximant

    It has the relative accuracy of X, so that it holds for short segments. Higham (2005), SIAM J. Matrix Anal. Appl.
    26(4), 1179-1193, https://doi.org/10.1137/04061101X.
    """
    size = float(np.abs(A).sum(axis=-2).max(initial=0.0))
    halvings = max(0, math.frexp(size)[1] + 1) if math.isfinite(size) else 0
    X = A * 0.5**halvings
    X2 = X @ X
    X4 = X2 @ X2
    X6, unit, p = X4 @ X2, np.eye(A.shape[-1]), PADE
    U = X @ (p[7] * X6 + p[5] * X4 + p[3] * X2 + p[1] * unit)
    V = p[6] * X6 + p[4] * X4 + p[2] * X2 + p[0] * unit
    out: Array = np.linalg.solve(V - U, 2.0 * U)
    for _ in range(halvings):
        out = 2 * out + out @ out
    return out


def _step(flow: Flow, tau: float, h: float, Z: Array) -> Array:
    """Return `growth` after one more step, from Z at the beginning of the step."""
    kappa = np.array([_taylor_coefficients(x, tau, h) for x in flow.stiffness])
    A, terms = flow.A * h, np.empty((TAYLOR_ORDER + 1, len(flow.b), len(Z)))
    b, T, out = (h * flow.b).T, Z + np.eye(len(Z)), Z.copy()
    for k in range(TAYLOR_ORDER):
        terms[k] = flow.r @ T
        drive = np.einsum("sj,jsn->sn", kappa[:, : k + 1], terms[k::-1])
        T = (A @ T + b @ drive) / (k + 1)
        out += T
    return out


def _taylor_coefficients(stiffness: Phased, tau: float, h: float) -> Array:
    """Return the coefficients (order + 1,) of x^j of the stiffness at tau + h x."""
    if isinstance(stiffness, Periodic):
        derivatives = [float(stiffness(tau + 0.5 * h, n)) * h**n for n in range(DEGREE + 1)]  # no breakpoint lies there
        return np.array(shifted_polynomial(derivatives, -0.5) + [0.0] * (TAYLOR_ORDER - DEGREE))
    c: ComplexArray = to_complex(stiffness.row())
    rotated = c * np.exp(1j * np.arange(len(c)) * tau)
    powers = (1j * h * np.arange(len(c)))[None, :] ** np.arange(TAYLOR_ORDER + 1)[:, None]
    series: Array = (powers @ rotated).real / np.array(
        [math.factorial(n) for n in range(TAYLOR_ORDER + 1)], dtype=float
    )
    return series


def rates_of_each(flows: Sequence[Flow], tau: Array, y: Array) -> Array:
    """Return `rates` (K, N) of K flows, each at its own phase and state (K, N)."""
    if any(flow.stiffness for flow in flows):
        return np.array([rates(*each) for each in zip(flows, tau, y, strict=True)])
    out: Array = (np.array([flow.A for flow in flows]) @ y[..., None])[..., 0]
    return out


def rates(flow: Flow, tau: float | Array, y: Array) -> Array:
    """Return dy/dtau (..., N) at phases (...) of states (..., N)."""
    out: Array = y @ flow.A.T
    if flow.stiffness:
        kappa = np.stack([x(tau) for x in flow.stiffness], axis=-1)
        out = out + (kappa * (y @ flow.r.T)) @ flow.b
    return out
