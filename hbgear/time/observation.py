"""Amplitudes of an integrated motion: extrema, harmonics and stroboscopic points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.series.fourier import coefficients_of, to_real
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.modal_states import StateBatch

HARMONICS = 16
"""Number of harmonics of the excitation that are stored for each settled motion [-]."""


@dataclass(frozen=True, eq=False)
class Observation:
    """Amplitudes of a settled motion, or of a section of a motion that is not periodic.

    Attributes
    ----------
    rms, pp2, max, mean : ndarray, shape (m,)
        Root mean square, half peak-to-peak, largest modulus and mean of each element coordinate.
    rows : ndarray, shape (m, 2H + 1)
        Real Fourier coefficients of each element coordinate, in harmonics of the excitation.
    points : ndarray, shape (k, m, 2)
        Poincare points (d, v) at tau = 0, one per excitation period.
    """

    rms: Array
    pp2: Array
    max: Array
    mean: Array
    rows: Array
    points: Array


def observe(integrator: ExponentialIntegrator, motions: StateBatch, periods: int) -> Observation:
    """Integrate one motion over a number of excitation periods, in place, and evaluate its amplitudes."""
    fine = integrator.advance(motions, periods, record=True)
    assert fine is not None
    d, v = fine[0][0], fine[1][0]
    per_period = d.shape[1] // periods
    h = 2 * np.pi / (integrator.Omega[0] * per_period)
    low, high = _extremum(d, v, h, -1), _extremum(d, v, h, 1)
    c = coefficients_of(d, HARMONICS * periods)[:, ::periods]
    points = np.stack([d[:, ::per_period], v[:, ::per_period]], axis=-1).transpose(1, 0, 2)
    return Observation(
        d.std(axis=1), (high - low) / 2, np.maximum(np.abs(low), np.abs(high)), d.mean(axis=1), to_real(c), points
    )


def _extremum(d: Array, v: Array, h: float, sign: int) -> Array:
    """Return the maximum (sign = 1) or minimum (-1) of each element from samples at distance h.

    The extreme sample is corrected by the parabola through it, d - v^2 / (2 v').
    """
    i = np.argmax(sign * d, axis=1)
    rows, count = np.arange(len(d)), d.shape[1]
    acceleration = (v[rows, (i + 1) % count] - v[rows, (i - 1) % count]) / (2 * h)
    correction = np.divide(-(v[rows, i] ** 2), 2 * acceleration, out=np.zeros(len(d)), where=sign * acceleration < 0)
    return d[rows, i] + correction
