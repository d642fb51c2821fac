"""Period and Fourier series of an integrated motion that repeats: the start of a limit cycle.

    min_T | z(t_end) - z(t_end - T) |,   z = (d / range of d, d' / range of d')

T is the shortest time after which the state returns to itself. The displacements of the elements in the last period are
fitted by a Fourier series.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from hbgear.common.arrays import Array
from hbgear.mechanics.series.fourier import resize, to_real, waves

LARGEST_DISTANCE = 0.1
"""Distance of two states [-], relative to the range of the motion, up to which one repeats the other. Newton's method
corrects a motion that has not settled completely."""

FAR = 0.3
"""Distance of two states [-] beyond which the motion has left the neighbourhood of its last state."""

FITTED_SAMPLES_PER_HARMONIC = 4
"""Smallest number of samples of a period for each harmonic that is fitted."""


@runtime_checkable
class SampledMotion(Protocol):
    """Samples of a motion at phases tau = Omega t: displacements and velocities of the elements, (m, T)."""

    @property
    def Omega(self) -> float:
        """Angular frequency of the phase."""

    @property
    def tau(self) -> Array:
        """Phases (T,) of the samples."""

    @property
    def d(self) -> Array:
        """Displacements (m, T) of the elements."""

    @property
    def v(self) -> Array:
        """Velocities (m, T) of the elements."""


def repeated_motion(motion: SampledMotion, harmonics: int) -> tuple[float, Array]:
    """Return the frequency and the real coefficients (m, 2H + 1) of the last period of a motion close to a limit cycle.

    Raises
    ------
    ValueError
        If the motion comes to rest, or does not repeat within its samples.
    """
    t = np.asarray(motion.tau) / motion.Omega
    half = len(t) // 2  # the transient before is left out of the range
    extent = np.ptp(motion.d[:, half:], axis=1)
    if extent.max() <= 1e-6 * np.ptp(motion.d, axis=1).max():
        raise ValueError("the motion comes to rest: there is no limit cycle near it; start from a larger motion")
    moving = extent > 1e-9 * extent.max()
    rates = np.ptp(motion.v[:, half:], axis=1)
    z = np.vstack([motion.d[moving] / extent[moving, None], motion.v[moving] / rates[moving, None]])
    distance = np.linalg.norm(z - z[:, -1:], axis=0)
    end = _last_return(distance)
    if end < 0:
        nearest = distance[: _last_distant(distance)].min(initial=np.inf)
        raise ValueError(
            f"the motion does not repeat: the state nearest to its last one differs by {nearest:.2g} of its range, and "
            f"{LARGEST_DISTANCE:g} is allowed; integrate longer, until a periodic motion is reached"
        )
    before, middle, after = distance[end - 1 : end + 2] ** 2
    # the return lies at the minimum of a parabola through three squared distances, between the samples
    bend = before - 2 * middle + after
    shift = 0.5 * (before - after) / bend if bend > 0 else 0.0
    period = float(t[-1] - t[end] - shift * (t[1] - t[0]))
    return 2 * np.pi / period, _fitted(t, motion.d, period, harmonics)


def _last_distant(distance: Array) -> int:
    """Return the number of the last sample that is far from the last state."""
    distant = np.flatnonzero(distance > FAR * min(1.0, distance.max()))
    return int(distant[-1]) if distant.size else 0


def _last_return(distance: Array) -> int:
    """Return the number of the last sample, before the motion left its last state, that is a return to it; else -1."""
    n = _last_distant(distance)
    d = distance[: n + 1]
    minima = np.flatnonzero((d[1:-1] <= d[:-2]) & (d[1:-1] < d[2:]) & (d[1:-1] < LARGEST_DISTANCE)) + 1
    return int(minima[-1]) if minima.size else -1


def _fitted(t: Array, d: Array, period: float, harmonics: int) -> Array:
    """Return the coefficients (m, 2H + 1) of least squares in the last period."""
    inside = t > t[-1] - period
    theta, H = 2 * np.pi / period * t[inside], min(harmonics, int(inside.sum()) // FITTED_SAMPLES_PER_HARMONIC)
    basis = to_real(waves(theta, H).conj())  # 1, cos theta, sin theta, ...
    return resize(np.linalg.lstsq(basis, d[:, inside].T, rcond=None)[0].T, harmonics)
