"""Error of Floquet multipliers, estimated from two sets of them, and the number of multipliers beyond the unit circle.

    P(z) = (z - mu_i) (z - mu_n),   P'(z) = (z - nu_i) (z - nu_n),   epsilon_i = |P'(mu_i)|
    x max(x, d - x) = epsilon_i,    d = |mu_i - mu_n|

mu are the multipliers of a motion, and nu the multipliers of a less accurate one. mu_n is the neighbour of mu_i, and
nu_i, nu_n are the two that lie nearest to mu_i. epsilon_i is the residual of mu_i in the local quadratic factor of the
other characteristic polynomial, and x is the largest distance by which such a residual moves a root: epsilon / d for a
multiplier that lies apart, sqrt(epsilon) for a nearly double one. No matching of the two sets is needed, and it does
not matter whether a pair is complex in one set and real in the other.

The determinant of the monodromy matrix fixes the modulus of a complex pair as long as the pair cannot reach the real
axis (x < |Im mu|). The error of the modulus is then the difference of the moduli. Several pairs exchange damping, so
with several pairs it is at least the difference of the multipliers.

References
----------
Stewart & Sun, Matrix Perturbation Theory (1990), ch. IV, for eigenvalues that are nearly double.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array, ComplexArray

SAFETY = 3.0
"""Factor from the difference of two sets of multipliers to the stated error."""

SHARE = 0.3
"""Smallest difference of a multiplier over the largest one of its motion: differences may vanish by chance."""

MIN_DECISIVE_MODULUS = 0.3
"""Modulus, over the smaller of 1 and the largest modulus, from which a multiplier may decide stability."""


MAX_MODULUS = 1e6
"""Modulus to which multipliers are limited. Beyond it their size does not matter, and products could overflow."""


REAL_TOLERANCE = 1e-8
"""Imaginary part of a multiplier, over its modulus, up to which it is real."""


class Difference(NamedTuple):
    """Differences (k, r) of the multipliers of k motions from those of another set.

    residual : epsilon. modulus : difference of the moduli of a complex pair. distance : distance of such a pair in the
    complex plane. Each is at least `SHARE` of the largest one among the multipliers that may decide stability.
    """

    residual: Array
    modulus: Array
    distance: Array


def count_beyond(multipliers: ComplexArray, margin: float = 0.0) -> NDArray[np.int_]:
    """Return the numbers (..., 3) of multipliers (..., r) beyond the unit circle by more than a margin.

    They are real multipliers above +1, real multipliers below -1, and complex multipliers outside the circle.

    Examples
    --------
    >>> import numpy as np
    >>> count_beyond(np.array([1.2, -1.1, 0.3, 0.2])).tolist()
    [1, 1, 0]
    """
    outside, real = np.abs(multipliers) > 1.0 + margin, ~is_complex(multipliers)
    kinds = (outside & real & (multipliers.real > 0), outside & real & (multipliers.real < 0), outside & ~real)
    return np.stack([np.count_nonzero(kind, axis=-1) for kind in kinds], axis=-1)


def is_complex(multipliers: ComplexArray) -> NDArray[np.bool_]:
    """Return whether multipliers are not real, up to rounding."""
    return np.abs(multipliers.imag) > REAL_TOLERANCE * np.abs(multipliers)


def difference_of(mu: ComplexArray, less_accurate: ComplexArray) -> Difference:
    """Return the `Difference` of multipliers mu (k, r) from less accurate ones (k, r)."""
    mu, less_accurate = _limited(mu), _limited(less_accurate)
    decisive = _decisive(mu)
    distances = np.abs(mu[:, :, None] - less_accurate[:, None, :])
    two_nearest = np.sort(distances, axis=2)[:, :, :2]
    residual = np.where(decisive, two_nearest.prod(axis=2), 0.0)
    pairs = decisive & is_complex(mu)
    nearest = np.take_along_axis(np.abs(less_accurate), distances.argmin(axis=2), axis=1)
    modulus = np.where(pairs, np.abs(np.abs(mu) - nearest), 0.0)
    quantities = (residual, modulus, np.where(pairs, two_nearest[:, :, 0], 0.0))
    return Difference(*(np.maximum(x, SHARE * x.max(axis=1, initial=0.0, keepdims=True)) for x in quantities))


def estimate_multiplier_error(mu: ComplexArray, difference: Difference) -> Array:
    """Return estimated errors (k,) of the largest moduli of multipliers mu (k, r), towards the unit circle.

    The estimate is the largest change of the modulus with `SAFETY` times the difference, also where a complex pair may
    become two real multipliers. A motion remains unstable as long as one multiplier stays outside.

    Examples
    --------
    A pair near the real axis, and the real pair of a more accurate motion with the same product:

    >>> import numpy as np
    >>> mu = np.array([[0.92 + 0.05j, 0.92 - 0.05j]])
    >>> true = np.array([[1.06, (0.92**2 + 0.05**2) / 1.06]])
    >>> bool(abs(np.abs(mu).max() - 1.06) < estimate_multiplier_error(mu, difference_of(mu, true))[0])
    True
    """
    mu = _limited(mu)
    size, distance = np.abs(mu), distance_of_neighbours(mu)
    x = largest_shift(SAFETY * difference.residual, distance)
    modulus_error = SAFETY * difference.modulus + (difference.distance if mu.shape[1] > 2 else 0.0)
    stays = is_complex(mu) & (x < np.abs(mu.imag))
    x = np.where(stays, np.minimum(modulus_error, x), x)
    decisive = _decisive(mu)
    largest = size.max(axis=1, initial=0.0)
    high = np.where(decisive, size + x, 0.0).max(axis=1, initial=0.0)
    low = np.where(decisive, size - x, 0.0).max(axis=1, initial=0.0)
    return np.where(largest > 1.0, largest - low, high - largest)


def min_deciding_residual(mu: ComplexArray) -> Array:
    """Return the smallest residual (k,) that may change the stability of multipliers mu (k, r).

    Either one multiplier reaches the unit circle from within, or all multipliers outside reach it.
    """
    mu = _limited(mu)
    gap, distance = np.abs(np.abs(mu) - 1.0), distance_of_neighbours(mu)
    needed = np.minimum(gap * np.maximum(gap, distance - gap), gap)
    outside = np.abs(mu) > 1.0
    inner = np.where(_decisive(mu), needed, np.inf).min(axis=1, initial=np.inf)
    outer = np.where(outside, needed, 0.0).max(axis=1, initial=0.0)
    return np.where(outside.any(axis=1), outer, inner)


def largest_shift(residual: Any, distance: Any) -> Array:
    """Return the largest x with x max(x, d - x) <= epsilon; see the head of this file."""
    square = np.square(distance) - 4.0 * residual
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        small_root = 2.0 * residual / (distance + np.sqrt(np.maximum(square, 0.0)))
    return np.where(square > 0.0, small_root, np.sqrt(residual))


def distance_of_neighbours(mu: ComplexArray) -> Array:
    """Return the distance (k, r) of each multiplier of sets (k, r) from its nearest neighbour; 1 if it has none."""
    r = mu.shape[1]
    if r < 2:
        return np.ones(mu.shape)
    distances = np.abs(mu[:, :, None] - mu[:, None, :])
    distances[:, np.arange(r), np.arange(r)] = np.inf
    return distances.min(axis=2)


def _limited(mu: ComplexArray) -> ComplexArray:
    """Return multipliers with limited moduli, whose products do not overflow."""
    return mu / np.maximum(np.abs(mu) / MAX_MODULUS, 1.0)


def _decisive(mu: ComplexArray) -> NDArray[np.bool_]:
    """Return which multipliers of sets (k, r) may decide stability: all that are not far within the unit circle."""
    size = np.abs(mu)
    return size >= MIN_DECISIVE_MODULUS * np.minimum(size.max(axis=1, keepdims=True, initial=0.0), 1.0)
