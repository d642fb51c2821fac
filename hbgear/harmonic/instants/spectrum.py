"""Fourier coefficients of exact motions, by Gauss quadrature on every segment.

    c_k = 1 / T int_0^T d(tau) e^(-i k theta) dtau,   theta = tau / nu,   T = 2 pi nu

Panels are so short that 12 nodes integrate the fastest mode and the highest harmonic to rounding. Gaps at the nodes are
values of the flow, not of an interpolation.
"""

from __future__ import annotations

import math

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.equations import EquationsAt
from hbgear.harmonic.instants.propagation import growth, growths
from hbgear.harmonic.instants.shooting import Iterate
from hbgear.mechanics.series.fourier import to_real, waves

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(12)
"""Nodes and weights of the Gauss-Legendre rule of 12 points on [-1, 1], exact for polynomials of degree 23."""

PANEL_ANGLE = 3.0
"""Largest angle by which a mode or a harmonic turns in a panel; 12 nodes integrate 2 * 3 rad to 1e-15."""


def coefficients(at: EquationsAt, iterate: Iterate, H: int) -> tuple[Array, float]:
    """Return the real coefficients (m, 2H + 1) of all gaps, and the rms of the harmonics above H, the largest gap's."""
    c, square, nu = np.zeros((at.equations.m, H + 1), dtype=complex), np.zeros(at.equations.m), at.equations.nu
    durations = iterate.durations(at.period)
    for i in range(iterate.pattern.count):
        if durations[i] <= 0:
            continue
        tau, weights, gaps = _nodes(at, iterate, i, float(durations[i]), H / nu)
        c += np.einsum("tm,tk->mk", gaps * weights[:, None], waves(tau / nu, H).conj())  # small: threads cost more
        square += weights @ gaps**2
    c /= at.period
    power = np.abs(c[:, 0]) ** 2 + 2 * (np.abs(c[:, 1:]) ** 2).sum(axis=1)
    rest = math.sqrt(max(0.0, float((square / at.period - power).max(initial=0.0))))
    c[:, 1:] *= 2  # one-sided amplitudes
    return to_real(c), rest


def _nodes(at: EquationsAt, iterate: Iterate, i: int, duration: float, highest: float) -> tuple[Array, Array, Array]:
    """Return phases (T,), weights (T,) and gaps (T, m) at the nodes of segment i."""
    contacts, start = iterate.pattern.contacts[i], float(iterate.tau[i])
    flow = at.flow(contacts)
    panels = max(1, math.ceil(duration * max(flow.rate, highest) / PANEL_ANGLE))
    h = duration / panels
    offsets = 0.5 * h * (1 + GAUSS_NODES)
    y = at.extended(iterate.x[i], start, contacts.section)
    if flow.stiffness:
        state, values = y, []
        for p in range(panels):
            phase = start + p * h
            values += [state + growth(flow, phase, float(o)) @ state for o in offsets]
            state = state + growth(flow, phase, h) @ state
        nodes = np.array(values)
    else:
        Z = growths([flow] * (len(offsets) + 1), np.zeros(len(offsets) + 1), np.append(offsets, h))
        states = np.empty((panels, len(y)))
        for p in range(panels):
            states[p] = y
            y = y + Z[-1] @ y
        nodes = (states[:, None] + np.einsum("gij,pj->pgi", Z[:-1], states)).reshape(-1, len(y))
    tau = (start + h * np.arange(panels)[:, None] + offsets).ravel()
    return tau, np.tile(0.5 * h * GAUSS_WEIGHTS, panels), nodes @ at.gaps(contacts.section).T
