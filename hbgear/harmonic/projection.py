"""Exact harmonic projection of piecewise-linear laws.

A continuous piecewise-linear law is a sum of ramps, g(d) = g0 + s0 d + sum_i D_i max(d - x_i, 0). With theta_j the
instants where d crosses the corner x and sigma_j = +1 on going above it, -1 on going below, the indicator of d > x has

    s_n = (1 / 2 pi) sum_j sigma_j exp(-i n theta_j) / (i n),     s_0 = fraction of the period spent above x

so that with kappa = s0 + sum_i D_i s(x_i) and chi = g0 - sum_i D_i x_i s(x_i), both times the Fourier series of the
stiffness,

    P_k = sum_m kappa_{k-m} d_m + chi_k,        dP/dd = Toeplitz(kappa)      (two-sided coefficients)

A law that is a sum of such springs with different stiffness series has the sum of their kappa and chi.

No boundary term appears in the derivative because g is continuous. Nothing is sampled: the only discrete
decision is which roots exist, and it is checked at the extrema between grid points.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.harmonic.crossings import crossings
from hbgear.mechanics.fourier import Series, stretch, to_complex
from hbgear.mechanics.laws import Law


def modulate(series: ComplexArray, s: ComplexArray, order: int, shifts: Sequence[int]) -> ComplexArray:
    """Coefficients 0..order of products of real functions, row by row, from two-sided coefficients 0, 1, 2, ...

    Parameters
    ----------
    series : (m, L + 1); s : (..., m, order + L + 1) or longer; shifts : the l >= 1 at which any series is not zero.
    """
    reach = series.shape[-1] - 1
    out = series[:, :1].real * s[..., : order + 1]
    if shifts:
        both = np.concatenate([np.conj(s[..., reach:0:-1]), s], axis=-1)
    for shift in shifts:
        factor = series[:, shift, None]
        out += factor * both[..., reach - shift : reach - shift + order + 1]
        out += np.conj(factor) * both[..., reach + shift : reach + shift + order + 1]
    return out


class ContactProjector:
    """Projection of the piecewise-linear laws of some elements, all at once.

    Parameters
    ----------
    laws : the laws, one per element, each the sum of the springs that `Law.piecewise` gives.
    nu : subharmonic order (a stiffness harmonic l is basis harmonic l nu).
    """

    def __init__(self, laws: Sequence[Law], nu: int) -> None:
        self.laws = laws
        each = [law.piecewise or () for law in laws]
        springs = [spring for several in each for spring in several]
        self.first = np.cumsum([0, *(len(several) for several in each[:-1])])  # spring of each element
        ramps = [spring.ramps for spring in springs]
        corners = [len(changes) for _, changes, _ in ramps]
        self.springs = np.repeat(np.arange(len(springs)), corners)  # of each corner
        self.rows = np.repeat(np.arange(len(laws)), [len(several) for several in each]).repeat(corners)
        self.level = np.concatenate([levels for *_, levels in ramps]) if ramps else np.empty(0)
        change = np.concatenate([changes for _, changes, _ in ramps]) if ramps else np.empty(0)
        weights = np.zeros((2, len(springs), len(change)))  # of the indicators of the corners in kappa and chi
        self.own = np.array([change, -change * self.level])
        weights[:, self.springs, np.arange(len(change))] = self.own
        self.weights = weights
        self.base = np.array([[spring.slopes[0] for spring in springs], [g0 for g0, *_ in ramps]])
        series = [_two_sided(spring.stiffness, nu) for spring in springs]
        self.reach = max((len(row) - 1 for row in series), default=0)
        self.series = np.array([np.pad(row, (0, self.reach + 1 - len(row))) for row in series])
        self.shifts = [k for k in range(1, self.reach + 1) if any(len(row) > k and row[k] for row in series)]

    def project(self, c: ComplexArray, samples: Array, order: int) -> tuple[ComplexArray, ComplexArray]:
        """kappa and chi, two-sided coefficients 0..order of each element, (m, order + 1) each."""
        found, count = crossings(c, self.level, self.rows, samples), len(self.series)
        turns, kernel = _orders(order + self.reach)
        # fraction of the period above: sum of (falling - rising) instants, plus a turn if the period starts above
        share = found.above - np.bincount(found.row, found.sign * found.theta, len(self.level)) / (2 * np.pi)
        both = np.empty((2, count, len(turns) + 1), dtype=complex)
        both[:, :, 0] = self.base + self.weights @ share
        if found.row.size:
            # sums over the instants of each spring, which lie side by side, as differences of one running sum
            each = (self.own[:, found.row] * found.sign)[..., None] * np.exp(found.theta[:, None] * turns)
            running = np.zeros((2, len(found.row) + 1, len(turns)), dtype=complex)
            np.cumsum(each, axis=1, out=running[:, 1:])
            edge = np.searchsorted(self.springs[found.row], np.arange(count + 1))
            np.multiply(running[:, edge[1:]] - running[:, edge[:-1]], kernel, out=both[:, :, 1:])
        else:
            both[:, :, 1:] = 0.0
        kappa, chi = modulate(self.series, both, order, self.shifts)
        if count > len(c):
            kappa, chi = np.add.reduceat(kappa, self.first), np.add.reduceat(chi, self.first)
        return kappa, chi


@lru_cache(maxsize=32)
def _orders(order: int) -> tuple[ComplexArray, ComplexArray]:
    """-i n and 1 / (2 pi i n) for n = 1..order."""
    n = 1j * np.arange(1, order + 1)
    return -n, 1 / (2 * np.pi * n)


def _two_sided(series: Series, nu: int) -> ComplexArray:
    c = to_complex(stretch(series.row(), nu))
    c[1:] *= 0.5
    return c
