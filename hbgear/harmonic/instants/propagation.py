"""Transition matrices of the flow between two instants, to rounding.

    y(tau + h) = Psi y(tau),   Psi = 1 + Z

With constant stiffness the matrix exponential is computed by scaling and squaring. With varying stiffness a Taylor
series is used, in steps in which it converges fast; see `kernels`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants import kernels
from hbgear.harmonic.instants.equations import DEGREE, Flow, shifted_polynomial
from hbgear.mechanics.series.fourier import Series, to_complex
from hbgear.mechanics.series.periodic import Periodic, Phased

TAYLOR_ORDER = 26
"""Order of the Taylor series."""

MAX_STEP_NORM = 2.0
"""Largest norm of the matrix times the step: 2^26 / 26! = 2e-19."""


def growth(flow: Flow, tau: float, h: float) -> Array:
    """Return Z (N, N) with y(tau + h) = (1 + Z) y(tau); Z keeps its accuracy in short segments."""
    if not flow.stiffness:
        return kernels.constant_segments(flow.A[None], np.array([float(h)]), np.zeros((1, len(flow.A))))[0][0]
    steps = taylor_steps(flow, h)
    return kernels.taylor_growth(flow.A, flow.b, flow.r, _stiffness_series(flow, tau, h, steps), h / steps)


def taylor_steps(flow: Flow, h: float) -> int:
    """Return the number of steps of the Taylor series in an interval of duration h; 1 with constant stiffness."""
    fastest = max((x.order for x in flow.stiffness if isinstance(x, Series)), default=0)
    return max(1, math.ceil(abs(h) * max(flow.rate / MAX_STEP_NORM, fastest))) if flow.stiffness else 1


def varying_states(flow: Flow, tau: float, h: float, steps: int, y: Array, offsets: Array) -> Array:
    """Return the states (steps, G, N) at nodes of equal steps from tau to tau + h, with varying stiffness.

    y (N,) is the state at the begin; offsets (G,) are the positions of the nodes in a step, 0 to 1.
    """
    kappa = _stiffness_series(flow, tau, h, steps)
    return kernels.taylor_states(flow.A, flow.b, flow.r, kappa, h / steps, y, offsets)


def _stiffness_series(flow: Flow, tau: float, h: float, steps: int) -> Array:
    """Return the Taylor coefficients (steps, S, order + 1) of all stiffnesses in steps of an interval."""
    begins = tau + np.arange(steps) * h / steps
    return np.stack([_taylor_coefficients(x, begins, h / steps) for x in flow.stiffness], axis=1)


class Segments(NamedTuple):
    """Growth Z (K, N, N) of K segments, and (K, N): Z y, the rates at both ends, and d/dh (Z / h) y."""

    Z: Array
    change: Array
    begin: Array
    end: Array
    slope: Array


def segments_of(A: Array, varying: Mapping[int, Flow], tau: Array, h: Array, y: Array) -> Segments:
    """Return the growth of states y (K, N) of segments of duration h (K,) from phases tau (K,) on, and its derivatives.

    A (K, N, N) are the matrices; ``varying`` has the flows of varying stiffness by the number of their segment. With
    constant stiffness all of it is computed without cancellation in short segments.
    """
    segments = Segments(*kernels.constant_segments(A, h, y))
    for k, flow in varying.items():
        Z = growth(flow, float(tau[k]), float(h[k]))
        change, begin = Z @ y[k], rates(flow, float(tau[k]), y[k])
        end = rates(flow, float(tau[k] + h[k]), y[k] + change)
        with np.errstate(divide="ignore", invalid="ignore"):  # segments that vanish have no slope
            slope = (end - change / h[k]) / h[k]
        for array, value in zip(segments, (Z, change, begin, end, slope), strict=True):
            array[k] = value
    return segments


def _taylor_coefficients(stiffness: Phased, tau: Array, h: float) -> Array:
    """Return the coefficients (steps, order + 1) of x^j of the stiffness at tau + h x, for phases tau (steps,)."""
    if isinstance(stiffness, Periodic):
        out = np.zeros((len(tau), TAYLOR_ORDER + 1))
        derivatives = [stiffness(tau + 0.5 * h, n) * h**n for n in range(DEGREE + 1)]  # no breakpoint lies there
        out[:, : DEGREE + 1] = np.stack(shifted_polynomial(derivatives, -0.5), axis=1)
        return out
    c = to_complex(stiffness.row())
    rotated = c * np.exp(1j * np.multiply.outer(tau, np.arange(len(c))))
    powers = (1j * h * np.arange(len(c)))[None, :] ** np.arange(TAYLOR_ORDER + 1)[:, None]
    return (rotated @ powers.T).real / np.array([math.factorial(n) for n in range(TAYLOR_ORDER + 1)], float)


def rates(flow: Flow, tau: float | Array, y: Array) -> Array:
    """Return dy/dtau (..., N) at phases (...) of states (..., N)."""
    out = y @ flow.A.T
    if flow.stiffness:
        kappa = np.stack([x(tau) for x in flow.stiffness], axis=-1)
        out = out + (kappa * (y @ flow.r.T)) @ flow.b
    return out
