"""Multipliers that meet, or pass the unit circle both ways, between two rows of a curve.

    prod_i (z - mu_i) = z^k + c_1 z^(k-1) + ... + c_k
    log mu = sigma + i (pi - theta),   (1 + mu) (1 + mu*) = 2 |mu| (cosh sigma - cos theta)

Two multipliers that come near each other repel at right angles, often across the unit circle and back: two complex
pairs make a bubble of their moduli, a pair that meets on the real axis two real ones. It may be far shorter than a
step. The coefficients of their polynomial know nothing of that: they are smooth along the curve, so they are
interpolated by cubics through four rows, and the roots between looked at.

A pair passes -1 whenever the frequency of its mode is an odd number of halves of the basis frequency, and comes as near
as sigma. Only if it meets on the real axis may it reach -1: theta^2, which is smooth there, falls to -sigma^2.

References
----------
Seyranian & Mailybaev, Multiparameter Stability Theory with Mechanical Applications (2003), ch. 2, for the bubble.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.events.near_tangency import SOON
from hbgear.continuation.results.stability import STABILITY_TOLERANCE

_TWO_PAIRS = 4  # multipliers: with fewer none can meet another or make up for it


_MOST = 8  # multipliers of one polynomial: the roots of longer ones are rounding


_LARGE = 0.6  # modulus from which multipliers may come to the unit circle within a step


_NEAR = 3.0  # distance of two multipliers, over what they move on a piece or beside it, up to which they may meet on it


_VAST = 1e12  # largest modulus beside which the smaller multipliers have no digits


_APART = 1.05  # least ratio of moduli between the multipliers in a polynomial and those that are not


_PLACES = np.arange(1, 8) / 8  # where between two rows the roots are looked at


def collisions(mu: ComplexArray, length: Array) -> list[tuple[int, float]]:
    """Pieces between rows with multipliers mu (rows, r), of the given lengths, on which a meeting crosses the circle.

    Each with the place s on it where the most multipliers have changed sides.
    """
    count = min(4, len(mu))
    if mu.shape[1] < _TWO_PAIRS or count < 3:
        return []
    order = np.argsort(-np.abs(mu), axis=1, kind="stable")[:, : _MOST + 1]
    largest = np.take_along_axis(mu, order, axis=1)
    outside = np.count_nonzero(np.abs(mu) > 1 + STABILITY_TOLERANCE, axis=1)
    pieces = np.flatnonzero(_near(largest[:, :_MOST]) & (outside[1:] == outside[:-1]))
    rows = np.clip(pieces - 1, 0, len(mu) - count)[:, None] + np.arange(count)
    sizes = _groups(np.abs(largest)[rows])
    sizes[(np.abs(largest[rows, 0]) > _VAST).any(axis=1)] = 0
    found = []
    for k in np.unique(sizes[sizes > 0]):
        some = sizes == k
        between = _between(largest[:, :k], np.append(0.0, np.cumsum(length)), pieces[some], rows[some])
        changed = np.abs(
            np.count_nonzero(np.abs(between) > 1 + STABILITY_TOLERANCE, axis=2) - outside[pieces[some], None]
        )
        found += [(int(i), float(_PLACES[x.argmax()])) for i, x in zip(pieces[some], changed, strict=True) if x.any()]
    return sorted(found)


def exchanges(mu: ComplexArray) -> list[tuple[int, float]]:
    """Pieces between rows on which one complex pair leaves the unit circle and another one comes back to it.

    Those outside at one end are nearer to ones inside at the other. Where their number outside stays as it is, it is
    enough that one surely comes back, or leaves: another must have done the opposite. Each with the place s between the
    two, which lines between the rows tell.
    """
    if mu.shape[1] < _TWO_PAIRS:
        return []
    pairs = _upper(mu)
    outside = pairs & (np.abs(mu) > 1 + STABILITY_TOLERANCE)
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


def extrapolated_crossings(mu: ComplexArray, length: Array) -> list[tuple[int, float]]:
    """Pieces between rows, with as many pairs outside at both ends, at an end of which one is about to pass the circle.

    So the line through its modulus there and that of the nearest at the row beyond tells: it comes to the circle on the
    first part of the piece, at a place s. Then another one must do the opposite on it, or the same one come back.
    """
    if mu.shape[1] < _TWO_PAIRS:
        return []
    pairs = _upper(mu)
    number = np.count_nonzero(pairs & (np.abs(mu) > 1 + STABILITY_TOLERANCE), axis=1)
    still = np.flatnonzero((number[1:] == number[:-1]) & (number[1:] > 0))
    if not still.size:
        return []
    x = np.log(np.where(pairs, mu, _NOWHERE))
    x = np.take_along_axis(x, np.argsort(np.abs(x.real), axis=1)[:, :_CLOSEST], axis=1)
    found: dict[int, float] = {}
    for side in (0, 1):
        beyond = still + 3 * side - 1
        pieces, beyond = (each[(beyond >= 0) & (beyond < len(mu))] for each in (still, beyond))
        here, there = x[pieces + side], x[beyond]
        nearest = np.abs(here[:, :, None] - there[:, None, :]).argmin(axis=2)
        grows = here.real - np.take_along_axis(there.real, nearest, axis=1)
        grows *= (length[pieces] / length[beyond - side])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            first = np.where(np.abs(here.real) > STABILITY_TOLERANCE, -here.real / grows, np.inf)
        first = np.where(first > 0, first, np.inf).min(axis=1)
        found |= {int(i): abs(side - float(s)) for i, s in zip(pieces, first, strict=True) if s < SOON}
    return sorted(found.items())


def leaps(mu: ComplexArray) -> list[tuple[int, float]]:
    """Pieces between rows across which multipliers mu (rows, r) cannot be followed, each with its middle.

    A multiplier that is not far within the unit circle has none within `_LEAP`, relative to the largest, at the other
    end.
    """
    size = np.abs(mu)
    largest = np.maximum(np.minimum(*(size[i : len(size) - 1 + i].max(axis=1, initial=0.0) for i in (0, 1))), 1.0)
    apart = np.abs(mu[:-1, :, None] - mu[1:, None, :])
    forth = np.where(size[:-1] > _LARGE, apart.min(axis=2, initial=np.inf), 0.0).max(axis=1, initial=0.0)
    back = np.where(size[1:] > _LARGE, apart.min(axis=1, initial=np.inf), 0.0).max(axis=1, initial=0.0)
    far = np.flatnonzero(np.isfinite(forth + back) & (np.maximum(forth, back) > _LEAP * largest))
    return [(piece, 0.5) for piece in far.tolist()]


_LEAP = 0.8
"""Distance between a multiplier and the nearest one at the next row from which it may be another one.

With the default steps .6 % of all pieces of spur pairs are as long, most of them beside a grazing contact.
"""


_NOWHERE = 1e-300  # in the place of multipliers that are none of a pair


_CLOSEST = 8  # pairs of each row, those next to the circle, that are looked at


def passes_minus_one_cleanly(mu: ComplexArray, length: Array, pieces: np.ndarray) -> np.ndarray:
    """Whether complex pairs plainly pass -1 on pieces (n,) between rows, and none that comes near reaches it there.

    Each pair that is not far within the circle is followed over the piece and the ones beside it: with a sigma that
    hardly changes on it and is nearly straight, and a theta that is a parabola and may change its sign, where the cubic
    through sigma^2 + theta^2 at these four rows is to come down to sigma^2, and not below. If all are far within the
    circle none reaches it. It is not plain where pairs cannot be followed or are real, nor on the first piece and the
    last.
    """
    plain = np.zeros(len(pieces), dtype=bool)
    inner = np.flatnonzero((pieces > 0) & (pieces + 1 < len(length)))
    rows = pieces[inner, None] + np.arange(-1, 3)
    negative = ~_upper(mu) & ~_upper(mu.conj()) & (mu.real < -_LARGE)
    known = np.isfinite(mu[rows]).all(axis=(1, 2)) & ~negative[rows].any(axis=(1, 2))
    inner, rows = inner[known], rows[known]
    if inner.size:
        x = np.append(0.0, np.cumsum(length))
        sigma, theta = _from_minus_one(mu[rows])
        same = _followed(sigma, theta, x[rows], _weights(x, pieces[inner], rows, _FINE))
        near = (sigma > np.log(_LARGE)) & (theta < _BEFORE)
        followed = (same.any(axis=2) | ~near[:, 1]).all(axis=1) & (same.any(axis=1) | ~near[:, 2]).all(axis=1)
        plain[inner] = (followed & near[:, 1:3].any(axis=(1, 2))) | ~(np.abs(mu[rows]) > _LARGE).any(axis=(1, 2))
    return plain


_SMALL = 0.3  # modulus up to which pairs are not followed


_BEFORE = 1.0  # theta from which a pair may reach -1 on a piece


_STEADY = 0.2  # share of sigma by which it may differ


_CURVED = 0.4  # share of what theta moves up to a row beside by which it may bend there


_UNEVEN = 0.1  # such a share by which it may bend otherwise than at the other row beside


_LOW, _HIGH = 0.5, 2.0  # shares of sigma^2 between which a pair that passes -1 comes down to it


_FINE = np.arange(17) / 16  # where between two rows it is looked for


_MANY = 32  # pairs next to -1 among which one is followed


def _from_minus_one(mu: ComplexArray) -> tuple[Array, Array]:
    """sigma and theta, (pieces, 4, r) each, of the pairs next to -1; in place of others what is like none of them."""
    log = np.log(np.where(_upper(mu) & (np.abs(mu) > _SMALL), mu, 1e9))
    order = np.argsort(-log.imag, axis=2, kind="stable")[:, :, :_MANY]
    return np.take_along_axis(log.real, order, axis=2), np.pi - np.take_along_axis(log.imag, order, axis=2)


def _followed(sigma: Array, theta: Array, x: Array, weights: Array) -> np.ndarray:
    """Which pairs at row 1 of four plainly are which at row 2, (pieces, r, r), if one of them is near -1.

    x : (pieces, 4) of the rows. weights : (pieces, `_FINE`, 4), of the rows in the cubic between these two.
    """
    steady = np.abs(sigma[:, 2, None, :] - sigma[:, 1, :, None]) <= _STEADY * np.abs(sigma[:, 1, :, None])
    near = np.minimum(theta[:, 1, :, None], theta[:, 2, None, :]) < _BEFORE
    piece, one, other = both = np.nonzero(steady & near)
    s, t, end = sigma[piece, 1, one], theta[piece, 1, one], theta[piece, 2, other]
    way, slope = x[piece] - x[piece, 1:2], (np.array([[1.0], [-1.0]]) * end - t) / (x[:, 2] - x[:, 1])[piece]
    line = t[:, None] + slope[:, :, None] * way  # (signs, found, 4)
    along = s[:, None] + ((sigma[piece, 2, other] - s) / (x[:, 2] - x[:, 1])[piece])[:, None] * way
    off = np.where(np.abs(sigma[piece] - along[..., None]) <= _STEADY * np.abs(s)[:, None, None],
                   np.abs(theta[piece] - np.abs(line)[..., None]), np.inf)  # fmt: skip
    nearest = piece[:, None], np.arange(4), off.argmin(axis=-1)
    moves = np.abs(slope[:, :, None]) * np.minimum(np.abs(way), np.abs(x[piece] - x[piece, 2:3]))
    bent = (np.copysign(theta[nearest], line) - line)[..., [0, 3]] / (way * (x[piece] - x[piece, 2:3]))[:, [0, 3]]
    uneven = np.abs(bent[..., 0] - bent[..., 1]) * (x[:, 3] - x[:, 2])[piece] * (x[:, 3] - x[:, 1])[piece]
    followed = (off.min(axis=-1) <= _CURVED * moves + 1e-9).all(axis=-1) & (uneven <= _UNEVEN * moves[..., 3] + 1e-9)
    square = (sigma**2 + theta**2)[nearest]
    lowest = _lowest(np.einsum("sfr,fpr->sfp", square, weights[piece]))
    lowest -= _UNSURE * _rest(square, x[piece])
    least = np.minimum(s**2, sigma[piece, 2, other] ** 2)
    most = np.array([[np.inf], [_HIGH]]) * least  # of pairs that pass
    same = np.zeros(steady.shape, dtype=bool)
    same[both] = (followed & (lowest > _LOW * least) & (lowest < most)).any(axis=0)
    return same


_UNSURE = 0.25
"""Share of the third-order term of the cubic that is taken for its error.

A pair in a tongue of instability .04 wide was taken for one that passes -1 on a step of .24, of which the cubic through
rows at such distances tells nothing.
"""


def _rest(f: Array, x: Array) -> Array:
    """Largest value, between rows 1 and 2, by which the cubic through values f (..., 4) differs from parabolas."""
    for k in range(1, 4):
        f = np.diff(f, axis=-1) / (x[:, k:] - x[:, :-k])
    way = 0.25 * (x[:, 2] - x[:, 1]) ** 2 * np.maximum(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    rest: Array = np.abs(f[..., 0]) * way
    return rest


def _lowest(f: Array) -> Array:
    """The least value along the last axis, of the parabola through the three values there."""
    i = np.clip(f.argmin(axis=-1), 1, f.shape[-1] - 2)[..., None]
    before, here, after = (np.take_along_axis(f, i + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = before - 2 * here + after
    at = np.clip(0.5 * (before - after) / np.where(bend > 0, bend, np.inf), -1.0, 1.0)
    lowest: Array = here + 0.5 * at * (after - before) + 0.5 * at**2 * bend
    return lowest


def _upper(mu: ComplexArray) -> np.ndarray:
    """Which multipliers are the one of a complex pair whose imaginary part is positive."""
    found: np.ndarray = mu.imag > 1e-8 * np.abs(mu)
    return found


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
    k = mu.shape[1]
    c = np.zeros((len(mu), k + 1), dtype=complex)
    c[:, 0] = 1.0
    for j in range(k):
        c[:, 1 : j + 2] -= mu[:, j, None] * c[:, : j + 1]
    companion = np.zeros((len(pieces), len(_PLACES), k, k))
    companion[:, :, 0] = -(_weights(x, pieces, rows, _PLACES) @ c.real[rows])[:, :, 1:]
    companion[:, :, 1:, :-1] = np.eye(k - 1)
    roots: ComplexArray = np.linalg.eigvals(companion)
    return roots


def _weights(x: Array, pieces: np.ndarray, rows: np.ndarray, places: Array) -> Array:
    """Weights (pieces, places, rows) of rows at x in the polynomial through those of a piece, at places on it."""
    at, count = x[pieces, None] + np.diff(x)[pieces, None] * places, rows.shape[1]
    weights = np.ones((len(pieces), len(places), count))
    for i in range(count):
        for j in range(count):
            if j != i:
                weights[:, :, i] *= (at - x[rows[:, j], None]) / (x[rows[:, i], None] - x[rows[:, j], None])
    return weights
