"""Error of Floquet multipliers, estimated from two sets of them, and the number of multipliers beyond the unit circle.

    P(z) = (z - mu_i) (z - mu_n),   P'(z) = (z - nu_i) (z - nu_n),   epsilon_i = |P'(mu_i)|
    x max(x, d - x) = epsilon_i,    d = |mu_i - mu_n|

mu are the multipliers of a motion, nu those of a less accurate one; mu_n is the neighbour of mu_i, and nu_i, nu_n are
the two that lie nearest to mu_i. epsilon_i is the residual of mu_i in the local quadratic factor of the other
characteristic polynomial, and x the largest distance by which such a residual moves a root: epsilon / d for a
multiplier that lies apart, sqrt(epsilon) for a nearly double one. No matching of the two sets is needed, and it does
not matter whether a pair is complex in one set and real in the other.

A complex pair keeps the modulus that the determinant of the monodromy matrix gives as long as it cannot reach the real
axis (x < |Im mu|): there the error of the modulus is the difference of the moduli, and with several pairs, which
exchange damping, at least the difference of the multipliers.

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

_DECISIVE = 0.3  # modulus, over the smaller of 1 and the largest, from which a multiplier may decide the verdict


_LARGE = 1e6  # modulus above which the size of a multiplier does not matter


_REAL = 1e-8  # imaginary part of a real multiplier, over its modulus


class Difference(NamedTuple):
    """Differences of two sets of multipliers, for each of k motions.

    residual (k,) : the largest epsilon of the multipliers that may decide stability. modulus (k,) : the largest
    difference of the moduli of complex pairs. apart (k,) : the largest difference of these pairs themselves.
    """

    residual: Array
    modulus: Array
    apart: Array


def count_beyond(multipliers: ComplexArray, margin: float = 0.0) -> NDArray[np.int_]:
    """Number of multipliers beyond the unit circle.

    Parameters
    ----------
    multipliers : (..., r) complex.
    margin : float, optional
        Distance outside the circle up to which a multiplier counts as on it; 0 by default.

    Returns
    -------
    (..., 3) integers: real multipliers above +1, real multipliers below -1, complex multipliers outside.

    Examples
    --------
    >>> import numpy as np
    >>> count_beyond(np.array([1.2, -1.1, 0.3, 0.2])).tolist()
    [1, 1, 0]
    """
    outside, real = np.abs(multipliers) > 1.0 + margin, ~is_complex(multipliers)
    each = (outside & real & (multipliers.real > 0), outside & real & (multipliers.real < 0), outside & ~real)
    counts: NDArray[np.int_] = np.stack([np.count_nonzero(one, axis=-1) for one in each], axis=-1)
    return counts


def is_complex(multipliers: ComplexArray) -> NDArray[np.bool_]:
    """Whether multipliers are not real, up to rounding."""
    found: NDArray[np.bool_] = np.abs(multipliers.imag) > _REAL * np.abs(multipliers)
    return found


def difference_of(mu: ComplexArray, other: ComplexArray) -> Difference:
    """`Difference` of multipliers mu (k, r) from less accurate ones (k, r)."""
    mu, other = _limited(mu), _limited(other)
    decisive = _decisive(mu)
    apart = np.abs(mu[:, :, None] - other[:, None, :])
    two = np.sort(apart, axis=2)[:, :, :2]
    residual = np.where(decisive, two.prod(axis=2), 0.0)
    pairs = decisive & is_complex(mu)
    nearest = np.take_along_axis(np.abs(other), apart.argmin(axis=2), axis=1)
    modulus = np.where(pairs, np.abs(np.abs(mu) - nearest), 0.0)
    return Difference(
        residual.max(axis=1, initial=0.0), modulus.max(axis=1, initial=0.0),
        np.where(pairs, two[:, :, 0], 0.0).max(axis=1, initial=0.0),
    )  # fmt: skip


def estimate_multiplier_error(mu: ComplexArray, difference: Difference) -> Array:
    """Estimated errors (k,) of the largest moduli of multipliers mu (k, r), towards the unit circle.

    The largest modulus is expected to change by no more than that with `SAFETY` times the difference, also where a
    complex pair may be two real multipliers. A motion remains unstable as long as one multiplier stays outside.

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
    x = largest_shift(SAFETY * difference.residual[:, None], distance)
    kept = SAFETY * difference.modulus + (difference.apart if mu.shape[1] > 2 else 0.0)
    stays = is_complex(mu) & (x < np.abs(mu.imag))
    x = np.where(stays, np.minimum(kept[:, None], x), x)
    decisive = _decisive(mu)
    largest = size.max(axis=1, initial=0.0)
    high = np.where(decisive, size + x, 0.0).max(axis=1, initial=0.0)
    low = np.where(decisive, size - x, 0.0).max(axis=1, initial=0.0)
    errors: Array = np.where(largest > 1.0, largest - low, high - largest)
    return errors


def least_residual(mu: ComplexArray) -> Array:
    """The least residual (k,) that may change the verdict of multipliers mu (k, r).

    One multiplier reaches the unit circle from within, or all that are outside reach it.
    """
    mu = _limited(mu)
    gap, distance = np.abs(np.abs(mu) - 1.0), distance_of_neighbours(mu)
    needed = np.minimum(gap * np.maximum(gap, distance - gap), gap)
    outside = np.abs(mu) > 1.0
    inner = np.where(_decisive(mu), needed, np.inf).min(axis=1, initial=np.inf)
    outer = np.where(outside, needed, 0.0).max(axis=1, initial=0.0)
    least: Array = np.where(outside.any(axis=1), outer, inner)
    return least


def may_reach(mu: ComplexArray, residual: Array) -> NDArray[np.bool_]:
    """Whether residuals (k,) may change the verdict of multipliers mu (k, r); see `least_residual`."""
    gap = np.where(_decisive(mu), np.abs(np.abs(mu) - 1.0), np.inf).min(axis=1, initial=np.inf)
    found: NDArray[np.bool_] = residual >= np.minimum(gap * gap, gap)  # needs no distances of neighbours
    some = np.flatnonzero(found)
    if some.size:
        found[some] = residual[some] >= least_residual(mu[some])
    return found


def largest_shift(residual: Any, distance: Any) -> Array:
    """The largest x with x max(x, d - x) <= epsilon; see the module."""
    square = np.square(distance) - 4.0 * residual
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        apart = 2.0 * residual / (distance + np.sqrt(np.maximum(square, 0.0)))
    x: Array = np.where(square > 0.0, apart, np.sqrt(residual))
    return x


def distance_of_neighbours(mu: ComplexArray) -> Array:
    """Distance (k, r) of each multiplier of sets (k, r) from the nearest other one; 1 where there is none."""
    r = mu.shape[1]
    if r < 2:
        return np.ones(mu.shape)
    apart = np.abs(mu[:, :, None] - mu[:, None, :])
    apart[:, np.arange(r), np.arange(r)] = np.inf
    distance: Array = apart.min(axis=2)
    return distance


def _limited(mu: ComplexArray) -> ComplexArray:
    """Multipliers whose moduli are limited, so that products of them do not overflow."""
    limited: ComplexArray = mu / np.maximum(np.abs(mu) / _LARGE, 1.0)
    return limited


def _decisive(mu: ComplexArray) -> NDArray[np.bool_]:
    """Which multipliers of sets (k, r) may decide stability: those that are not far within the unit circle."""
    size = np.abs(mu)
    found: NDArray[np.bool_] = size >= _DECISIVE * np.minimum(size.max(axis=1, keepdims=True, initial=0.0), 1.0)
    return found
