"""Kernels: AFT (alternating frequency/time) for compiled laws of the user; `hbgear.harmonic.forces.aft` for Python.

x_k = (1 / N) sum_n x(theta_n) exp(-i k theta_n),   theta_n = 2 pi n / N       x: p, dp/dd, dp/dv
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hbgear.common.process.compiling import kernel
from hbgear.mechanics.laws.c_callback import called
from hbgear.mechanics.series.fourier_kernels import sampled


@kernel
def samples_of(user_laws: Any, packed: Any, coefficients: Any, index: int, omega: float) -> Any:
    """Return samples (N, 3) of p, dp/dd, dp/dv of compiled law ``index`` for coefficients (m, 2H + 1) at omega."""
    j, N = user_laws.element[index], packed.basis.shape[1]
    row = coefficients[j]
    speed, d, v, tau = np.zeros(row.shape[0]), np.empty(N), np.empty(N), np.empty(N)
    for k in range(1, row.shape[0] // 2 + 1):
        speed[2 * k - 1], speed[2 * k] = omega * k * row[2 * k], -omega * k * row[2 * k - 1]
    sampled(row, packed.basis, d)
    sampled(speed, packed.basis, v)
    _add_grid(packed.piecewise, j, omega, d, v)
    for n in range(N):
        tau[n] = 2 * math.pi * ((packed.linear.nu * n) % N) / N
    out = np.empty((N, 3))
    called(user_laws.address[index], d, v, tau, user_laws.parameters[index], out)
    return out


@kernel
def _add_grid(piecewise: Any, j: int, omega: float, d: Any, v: Any) -> None:
    """Add prescribed displacements with breakpoints to samples of the displacement and velocity of element j."""
    if piecewise is None:
        return
    for n in range(piecewise.grid.shape[2]):
        d[n] += piecewise.grid[0, j, n]
        v[n] += omega * piecewise.grid[1, j, n]


@kernel
def spectrum(x: Any, basis: Any, out: Any) -> None:
    """Fill out with two-sided coefficients 0, 1, ... of samples (N,); zero above order N / 2."""
    N = x.shape[0]
    for k in range(out.shape[0]):
        real = imaginary = 0.0
        for n in range(N if k <= N // 2 else 0):
            real += x[n] * basis[1, (k * n) % N]
            imaginary -= x[n] * basis[2, (k * n) % N]
        out[k] = complex(real / N, imaginary / N)


@kernel
def truncated_sample_harmonics(user_laws: Any, packed: Any, coefficients: Any, omega: float, f: Any) -> None:
    """Fill f (m, L) with the one-sided truncated force harmonics of the compiled laws, if any."""
    if user_laws is None:
        return
    H, N, truncated_orders = packed.basis.shape[0] // 2, packed.basis.shape[1], packed.linear.truncated_orders
    part = np.empty(2 * H + 1, dtype=np.complex128)
    for q in range(user_laws.element.shape[0]):
        spectrum(samples_of(user_laws, packed, coefficients, q, omega)[:, 0], packed.basis, part)
        for i in range(truncated_orders.shape[0]):
            if truncated_orders[i] < N // 2:
                f[user_laws.element[q], i] = 2.0 * part[truncated_orders[i]]
