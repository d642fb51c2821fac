"""Fourier coefficients of exact motions, by Gauss quadrature on every segment.

    c_k = 1 / T int_0^T d(tau) e^(-i k theta) dtau,   theta = tau / nu,   T = 2 pi nu

Panels are so short that 12 nodes integrate the fastest mode and the highest harmonic to rounding. Gaps at the nodes are
values of the flow, not of an interpolation.
"""

from __future__ import annotations

import math

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.equations import EquationsAt, Flow
from hbgear.harmonic.instants.propagation import growth, growths, path
from hbgear.harmonic.instants.shooting import Iterate
from hbgear.mechanics.series.fourier import to_real, waves

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(12)
"""Nodes and weights of the Gauss-Legendre rule of 12 points on [-1, 1], exact for polynomials of degree 23."""

PANEL_ANGLE = 3.0
"""Largest angle by which a mode or a harmonic turns in a panel; 12 nodes integrate 2 * 3 rad to 1e-15."""


def coefficients(at: EquationsAt, iterate: Iterate, H: int) -> tuple[Array, float]:
    """Return the real coefficients (m, 2H + 1) of all gaps, and the rms of the harmonics above H, the largest gap's."""
    nu, (tau, weights, gaps) = at.equations.nu, _nodes(at, iterate, H / at.equations.nu)
    c = np.einsum("tm,tk->mk", gaps * weights[:, None], waves(tau / nu, H).conj()) / at.period
    power = np.abs(c[:, 0]) ** 2 + 2 * (np.abs(c[:, 1:]) ** 2).sum(axis=1)
    rest = math.sqrt(max(0.0, float((weights @ gaps**2 / at.period - power).max(initial=0.0))))
    c[:, 1:] *= 2  # one-sided amplitudes
    return to_real(c), rest


def _nodes(at: EquationsAt, iterate: Iterate, highest: float) -> tuple[Array, Array, Array]:
    """Return phases (T,), weights (T,) and gaps (T, m) at the nodes of all segments."""
    durations = iterate.durations(at.period)
    used = np.flatnonzero(durations > 0)
    contacts = [iterate.pattern.contacts[i] for i in used]
    flows, sections = [at.flow(one) for one in contacts], [one.section for one in contacts]
    panels = np.array([
        max(1, math.ceil(d * max(flow.rate, highest) / PANEL_ANGLE))
        for d, flow in zip(durations[used], flows, strict=True)
    ])  # fmt: skip
    h, starts = durations[used] / panels, iterate.tau[used]
    y = np.concatenate([iterate.x[used], at.equations.functions(starts, sections)], axis=1)
    offsets = np.append(0.5 * (1 + GAUSS_NODES), 1.0)
    constant = [k for k, flow in enumerate(flows) if not flow.stiffness]
    parts = np.multiply.outer(h[constant], offsets)
    found = growths([flows[k] for k in constant for _ in offsets], np.zeros(parts.size), parts.ravel())
    growing = dict(zip(constant, found.reshape(*parts.shape, *found.shape[1:]), strict=True))
    gaps = []
    for k, flow in enumerate(flows):
        if k in growing:
            states = path(growing[k][-1], y[k], int(panels[k]) - 1)
            nodes = states[:, None] + np.einsum("gij,pj->pgi", growing[k][:-1], states)
        else:
            nodes = _varying_nodes(flow, float(starts[k]), float(h[k]), int(panels[k]), y[k])
        gaps.append(nodes.reshape(-1, y.shape[1]) @ at.gaps(sections[k]).T)
    panel = np.concatenate([np.arange(count) for count in panels])
    tau = np.repeat(starts, panels)[:, None] + np.repeat(h, panels)[:, None] * (panel[:, None] + offsets[:-1])
    weights = 0.5 * np.multiply.outer(np.repeat(h, panels), GAUSS_WEIGHTS)
    return tau.ravel(), weights.ravel(), np.concatenate(gaps)


def _varying_nodes(flow: Flow, start: float, h: float, panels: int, y: Array) -> Array:
    """Return the states (panels, nodes, N) at the nodes of a segment with varying stiffness."""
    nodes = np.empty((panels, len(GAUSS_NODES), len(y)))
    for p in range(panels):
        phase = start + p * h
        for g, offset in enumerate(0.5 * h * (1 + GAUSS_NODES)):
            nodes[p, g] = y + growth(flow, phase, float(offset)) @ y
        y = y + growth(flow, phase, h) @ y
    return nodes
