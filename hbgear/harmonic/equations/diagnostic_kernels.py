"""Kernels: quantities of periodic motions except stability: extrema, impact regime, truncated harmonics.

delta d_k = -G_k f_k,   k <= 2H       response of the structure to the truncated force harmonics

The orders k are not unknowns: H < k <= 2H, and orders below H outside a harmonic selection.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.process.compiling import inlined, kernel
from hbgear.harmonic.forces.aft_kernels import truncated_sample_harmonics
from hbgear.harmonic.forces.piecewise_kernels import highest_gap, sampled_gap
from hbgear.harmonic.forces.projection_kernels import cross, project, projection_workspace, shortest_interval
from hbgear.mechanics.series.fourier_kernels import coefficient, fill_one_sided


@kernel
def extrema(packed: Any, X: Any, clearance: Any, regime: Any) -> None:
    """Fill clearances (P, 2 K) of extrema from breakpoints, and regimes (P, m), see `HarmonicBalance.regime`."""
    laws, m = packed.laws, regime.shape[1]
    c, motion = np.empty(X.shape[1] // (2 * m) + 1, dtype=np.complex128), np.empty((2, packed.basis.shape[1]))
    regime[:, :] = 0
    low = high = 0.0
    for p in range(X.shape[0]):
        coefficients, previous = X[p].reshape(m, -1), -1
        for i in range(clearance.shape[1] // 2):
            j = laws.owner[i]
            if j != previous:
                previous = j
                sampled_gap(packed.piecewise, packed.basis, coefficients[laws.element[j]], j, c, motion)
                low = -highest_gap(packed.piecewise, j, -1.0, c, motion)[0]
                high = highest_gap(packed.piecewise, j, 1.0, c, motion)[0]
            clearance[p, 2 * i], clearance[p, 2 * i + 1] = low - laws.level[i], high - laws.level[i]
            if low < laws.level[i] < high and regime[p, laws.element[j]] < 2:
                regime[p, laws.element[j]] += 1


@kernel
def shortest_intervals(packed: Any, m: int, X: Any, out: Any) -> None:
    """Fill out (P,) with the shortest intervals between two switching times of motions X (P, n); 2 pi without any."""
    space = projection_workspace(packed, m, X.shape[1] // (2 * m), 0)
    for p in range(X.shape[0]):
        cross(packed, X[p].reshape(m, -1), np.bool_(False), space)
        out[p] = shortest_interval(space.theta, space.number)


@kernel
def truncated_force_harmonics(packed: Any, X: Any, Omega: Any, f: Any) -> None:
    """Fill f (P, m, L) with the one-sided force harmonics of the truncated orders at Omega (P,).

    They are exact for piecewise-linear and cubic laws, and from samples for compiled laws. Of the dampers only
    prescribed displacements with breakpoints contribute, because all other velocities have no truncated harmonics.
    """
    m, H = f.shape[1], packed.basis.shape[0] // 2
    space = projection_workspace(packed, m, H, 3 * H)
    for p in range(X.shape[0]):
        coefficients = X[p].reshape(m, -1)
        _project_truncated(packed, coefficients, space, f[p])
        truncated_sample_harmonics(packed.user_laws, packed, coefficients, Omega[p] / packed.linear.nu, f[p])
        _add_damped(packed.piecewise, packed.linear, Omega[p], f[p])


@kernel
def _add_damped(piecewise: Any, linear: Any, Omega: float, f: Any) -> None:
    """Add the truncated forces (m, L) of dampers on displacements with breakpoints."""
    if piecewise is None:
        return
    for j in range(f.shape[0]):
        for i in range(linear.truncated_orders.shape[0]):
            rate = linear.springs[1, j] * Omega * linear.truncated_orders[i] / linear.nu
            f[j, i] -= 1j * rate * piecewise.truncated[i, j]


@inlined
def _project_truncated(packed: Any, coefficients: Any, space: Any, f: Any) -> None:
    """Fill f (m, L) with the exact force harmonics of the truncated orders."""
    orders, c = packed.linear.truncated_orders, space.waves
    project(packed, coefficients, space)
    for j in range(coefficients.shape[0]):
        fill_one_sided(coefficients[j], c)
        for i in range(orders.shape[0]):
            f[j, i] = 2.0 * (coefficient(space.kappa[j], c, orders[i]) + space.chi[j, orders[i]])


@kernel
def driven_response(linear: Any, Omega: Any, f: Any, out: Any) -> None:
    """Fill the truncated harmonics of out (P, n) with the response of the elements to force harmonics (P, m, L)."""
    (P, m, L), free = f.shape, linear.free
    d = np.empty(m, np.complex128)
    for p in range(P):
        coefficients = out[p].reshape(m, -1)
        for k in range(L):
            s, position = 1j * (Omega[p] * linear.truncated_orders[k] / linear.nu), 2 * linear.truncated_orders[k]
            d[:] = 0j
            for r in range(free.poles.shape[0]):
                z = 0j
                for j in range(m):
                    z += free.input[r, j] * f[p, j, k]
                z /= s - free.poles[r]
                for i in range(m):
                    d[i] += free.output[i, r] * z
            for i in range(m):
                coefficients[i, position - 1], coefficients[i, position] = -d[i].real, d[i].imag
