"""Multipliers that meet, or pass the unit circle both ways, between two rows of a curve.

    prod_i (z - mu_i) = z^k + c_1 z^(k-1) + ... + c_k

Two multipliers that come near each other repel at right angles, often across the unit circle and back: two complex
pairs make a bubble of their moduli, a pair that meets on the real axis two real ones. It may be far shorter than a
step. The coefficients of their polynomial know nothing of that: they are smooth along the curve, so they are
interpolated by cubics through four rows, and the roots between looked at.

References
----------
Seyranian & Mailybaev, Multiparameter Stability Theory with Mechanical Applications (2003), ch. 2, for the bubble.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.branch import NEUTRAL

_MOST = 8  # multipliers of one polynomial: the roots of longer ones are rounding


_LARGE = 0.6  # modulus from which multipliers may come to the unit circle within a step


_NEAR = 3.0  # distance of two multipliers, over what they move on a piece or beside it, up to which they may meet on it


_APART = 1.05  # least ratio of moduli between the multipliers in a polynomial and those that are not


_PLACES = np.arange(1, 8) / 8  # where between two rows the roots are looked at


def meetings(mu: ComplexArray, length: Array) -> list[tuple[int, float]]:
    """Pieces between rows with multipliers mu (rows, r), of the given lengths, on which a meeting crosses the circle.

    Each with the place s on it where the most multipliers have changed sides.
    """
    count = min(4, len(mu))
    if mu.shape[1] < 4 or count < 3:
        return []
    order = np.argsort(-np.abs(mu), axis=1, kind="stable")[:, : _MOST + 1]
    largest = np.take_along_axis(mu, order, axis=1)
    outside = np.count_nonzero(np.abs(mu) > 1 + NEUTRAL, axis=1)
    pieces = np.flatnonzero(_near(largest[:, :_MOST]) & (outside[1:] == outside[:-1]))
    rows = np.clip(pieces - 1, 0, len(mu) - count)[:, None] + np.arange(count)
    sizes = _groups(np.abs(largest)[rows])
    found = []
    for k in np.unique(sizes[sizes > 0]):
        some = sizes == k
        between = _between(largest[:, :k], np.append(0.0, np.cumsum(length)), pieces[some], rows[some])
        changed = np.abs(np.count_nonzero(np.abs(between) > 1 + NEUTRAL, axis=2) - outside[pieces[some], None])
        found += [(int(i), float(_PLACES[x.argmax()])) for i, x in zip(pieces[some], changed, strict=True) if x.any()]
    return sorted(found)


def exchanges(mu: ComplexArray) -> list[tuple[int, float]]:
    """Pieces between rows on which one complex pair leaves the unit circle and another one comes back to it.

    Those outside at one end are nearer to ones inside at the other. Where their number outside stays as it is, it is
    enough that one surely comes back, or leaves: another must have done the opposite. Each with the place s between the
    two, which lines between the rows tell.
    """
    pairs = mu.imag > 1e-8 * np.abs(mu)
    outside = pairs & (np.abs(mu) > 1 + NEUTRAL)
    number = np.count_nonzero(outside, axis=1)
    pieces = np.flatnonzero(np.minimum(number[1:], number[:-1]))
    if not pieces.size:
        return []
    x = np.log(np.where(pairs, mu, 1.0))
    apart = np.where(pairs[pieces, :, None] & pairs[pieces + 1, None, :],
                     np.abs(x[pieces, :, None] - x[pieces + 1, None, :]), np.inf)  # fmt: skip
    doubt, returned = _passed(apart, x.real, outside, pieces, pieces + 1)
    other, left = _passed(apart.transpose(0, 2, 1), x.real, outside, pieces + 1, pieces)
    same = number[pieces] == number[pieces + 1]
    sure = np.where(same, np.minimum(doubt, other), np.maximum(doubt, other)) < _SURE
    return [(int(i), float(s)) for i, s in zip(pieces[sure], 0.5 * (returned + 1 - left)[sure], strict=True)]


_SURE = 0.5  # distance to the nearest multiplier on the other side of the circle, over that on its own, that is near


def _passed(apart: Array, size: Array, outside: np.ndarray, here: np.ndarray, there: np.ndarray) -> tuple[Array, Array]:
    """How doubtful it is that a multiplier which is outside ``here`` is not ``there``, and where it passes the circle.

    Of those of each piece the likeliest; size: log of the moduli.
    """
    inner = np.where(outside[there, None, :], np.inf, apart)
    least, outer = inner.min(axis=2), np.where(outside[there, None, :], apart, np.inf).min(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        doubt = np.where(outside[here] & np.isfinite(least), least / outer, np.inf)
        there_size = np.take_along_axis(size[there], inner.argmin(axis=2), axis=1)
        place = size[here] / (size[here] - there_size)
    likeliest = np.arange(len(doubt)), doubt.argmin(axis=1)
    return doubt[likeliest], place[likeliest]


def _near(mu: ComplexArray) -> np.ndarray:
    """Pieces at whose ends two multipliers are so near each other, and to the circle, that they may meet within."""
    size = np.abs(mu)
    large = size > _LARGE
    apart = np.where(large[:, :, None] & large[:, None, :], np.abs(mu[:, :, None] - mu[:, None, :]), np.inf)
    apart[:, np.arange(mu.shape[1]), np.arange(mu.shape[1])] = np.inf
    least = apart.min(axis=(1, 2))
    least = np.minimum(least[1:], least[:-1])
    moved = np.where(large[1:, None, :], np.abs(mu[:-1, :, None] - mu[1:, None, :]), np.inf).min(axis=2)
    moved = np.where(large[:-1], moved, 0.0).max(axis=1)
    moved = np.pad(moved, 1, mode="edge")
    moved = np.maximum(np.maximum(moved[:-2], moved[2:]), moved[1:-1])  # on the pieces beside it too
    gap = np.abs(1 - np.where(large, size, np.inf)).min(axis=1)
    out: np.ndarray = (least < _NEAR * moved) & (np.minimum(gap[1:], gap[:-1]) < least) & np.isfinite(least)
    return out


def _groups(size: Array) -> np.ndarray:
    """How many of the largest multipliers, of sorted moduli (pieces, rows, r), keep to themselves; 0 if too many."""
    out = np.zeros(len(size), dtype=int)
    for k in range(min(size.shape[2], _MOST), 1, -1):
        rest = size[:, :, k] if k < size.shape[2] else np.zeros(size.shape[:2])
        out[np.all((rest < _LARGE) & (size[:, :, k - 1] > _APART * rest), axis=1)] = k
    return out


def _between(mu: ComplexArray, x: Array, pieces: np.ndarray, rows: np.ndarray) -> ComplexArray:
    """Multipliers (pieces, places, k) at the `_PLACES` of pieces, from those (all, k) at x of some rows for each."""
    k, count = mu.shape[1], rows.shape[1]
    c = np.zeros((len(mu), k + 1), dtype=complex)
    c[:, 0] = 1.0
    for j in range(k):
        c[:, 1 : j + 2] -= mu[:, j, None] * c[:, : j + 1]
    at = x[pieces, None] + np.diff(x)[pieces, None] * _PLACES
    weights = np.ones((len(pieces), len(_PLACES), count))
    for i in range(count):
        for j in range(count):
            if j != i:
                weights[:, :, i] *= (at - x[rows[:, j], None]) / (x[rows[:, i], None] - x[rows[:, j], None])
    companion = np.zeros((len(pieces), len(_PLACES), k, k))
    companion[:, :, 0] = -(weights @ c.real[rows])[:, :, 1:]
    companion[:, :, 1:, :-1] = np.eye(k - 1)
    roots: ComplexArray = np.linalg.eigvals(companion)
    return roots
