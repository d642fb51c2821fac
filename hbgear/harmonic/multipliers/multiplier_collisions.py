"""Collisions of multipliers, and crossings of the unit circle in both directions, between two points of a curve.

    prod_i (z - mu_i) = z^k + c_1 z^(k-1) + ... + c_k
    log mu = sigma + i (pi - theta),   (1 + mu) (1 + mu*) = 2 |mu| (cosh sigma - cos theta)

Two multipliers that approach each other separate at right angles, often across the unit circle and back. Two complex
pairs make a bubble of their moduli; a pair that collides on the real axis becomes two real multipliers. The bubble may
be far shorter than a step. The coefficients of the characteristic polynomial stay smooth along the curve. They are
interpolated by cubics through four points, and the roots are evaluated between the points.

A pair passes -1 whenever the frequency of its mode is an odd number of halves of the basis frequency, and its distance
from -1 is then sigma. It can reach -1 only by a collision on the real axis: theta^2, which is smooth there, falls to
-sigma^2.

References
----------
Seyranian & Mailybaev, Multiparameter Stability Theory with Mechanical Applications (2003), ch. 2, for the bubble.
"""

from __future__ import annotations

import numpy as np

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.events.near_tangency import SECANT_REACH
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.harmonic.multipliers.multiplier_error import is_complex

MIN_MULTIPLIERS = 4
"""Smallest number of multipliers with which one pair can collide with another or replace it outside the circle."""


MAX_GROUP_SIZE = 8
"""Largest number of multipliers of one polynomial; the roots of higher degrees are rounding."""


MIN_MODULUS = 0.6
"""Modulus from which multipliers may come to the unit circle within a step."""


COLLISION_DISTANCE_RATIO = 3.0
"""Distance of two multipliers up to which they may collide, over their change on a segment or its neighbours."""


MAX_MODULUS_RANGE = 1e12
"""Largest modulus at which the smaller multipliers still have correct digits."""


GROUP_SEPARATION = 1.05
"""Smallest ratio of moduli between the multipliers of a polynomial and all smaller ones."""


INTERPOLATION_FRACTIONS = np.arange(1, 8) / 8
"""Fractions of a segment at which the roots are evaluated."""


def collisions(mu: ComplexArray, length: Array) -> list[tuple[int, float]]:
    """Return the segments on which a collision crosses the unit circle, each with a fraction s of it.

    mu (points, r) are the multipliers, ``length`` the lengths of the segments. At s the most multipliers have changed
    sides.
    """
    count = min(4, len(mu))
    if mu.shape[1] < MIN_MULTIPLIERS or count < 3:
        return []
    order = np.argsort(-np.abs(mu), axis=1, kind="stable")[:, : MAX_GROUP_SIZE + 1]
    largest = np.take_along_axis(mu, order, axis=1)
    outside = np.count_nonzero(np.abs(mu) > 1 + STABILITY_TOLERANCE, axis=1)
    segments = np.flatnonzero(_may_collide(largest[:, :MAX_GROUP_SIZE]) & (outside[1:] == outside[:-1]))
    points = np.clip(segments - 1, 0, len(mu) - count)[:, None] + np.arange(count)
    sizes = _groups(np.abs(largest)[points])
    sizes[(np.abs(largest[points, 0]) > MAX_MODULUS_RANGE).any(axis=1)] = 0
    position = np.append(0.0, np.cumsum(length))
    sizes[(np.diff(position[points], axis=1) <= 0.0).any(axis=1)] = 0  # points that coincide up to rounding
    located = []
    for k in np.unique(sizes[sizes > 0]):
        selected = sizes == k
        between = _interpolated_multipliers(largest[:, :k], position, segments[selected], points[selected])
        changed = np.abs(
            np.count_nonzero(np.abs(between) > 1 + STABILITY_TOLERANCE, axis=2) - outside[segments[selected], None]
        )
        located += [
            (int(i), float(INTERPOLATION_FRACTIONS[x.argmax()]))
            for i, x in zip(segments[selected], changed, strict=True)
            if x.any()
        ]
    return sorted(located)


def exchanges(mu: ComplexArray) -> list[tuple[int, float]]:
    """Return the segments on which one complex pair leaves the unit circle and another one enters it.

    Multipliers that are outside at one end are nearer to multipliers inside at the other end. Where the number outside
    does not change, it suffices that one crossing is certain, because another pair must then cross in the opposite
    direction. Each segment is returned with the fraction s halfway between the crossings, by linear interpolation.
    """
    if mu.shape[1] < MIN_MULTIPLIERS:
        return []
    pairs = _in_upper_half_plane(mu)
    outside = pairs & (np.abs(mu) > 1 + STABILITY_TOLERANCE)
    number = np.count_nonzero(outside, axis=1)
    segments = np.flatnonzero(np.minimum(number[1:], number[:-1]))
    if not segments.size:
        return []
    x = np.log(np.where(pairs, mu, 1.0))
    distances = np.where(
        pairs[segments, :, None] & pairs[segments + 1, None, :],
        np.abs(x[segments, :, None] - x[segments + 1, None, :]),
        np.inf,
    )
    leaving, exit_at = _crossing_ratio(distances, x.real, outside, segments, segments + 1)
    entering, entry_at = _crossing_ratio(distances.transpose(0, 2, 1), x.real, outside, segments + 1, segments)
    balanced = number[segments] == number[segments + 1]
    certain = np.where(balanced, np.minimum(leaving, entering), np.maximum(leaving, entering)) < MAX_MATCH_RATIO
    return [(int(i), float(s)) for i, s in zip(segments[certain], 0.5 * (exit_at + 1 - entry_at)[certain], strict=True)]


def extrapolated_crossings(mu: ComplexArray, length: Array) -> list[tuple[int, float]]:
    """Return segments with equally many pairs outside at both ends, near an end of which a pair crosses the circle.

    A line through the modulus at that end and the nearest one at the point beyond it reaches the circle on the first
    part of the segment, at the fraction s. Another pair must then cross in the opposite direction, or the same one
    returns.
    """
    if mu.shape[1] < MIN_MULTIPLIERS:
        return []
    pairs = _in_upper_half_plane(mu)
    number = np.count_nonzero(pairs & (np.abs(mu) > 1 + STABILITY_TOLERANCE), axis=1)
    candidates = np.flatnonzero((number[1:] == number[:-1]) & (number[1:] > 0))
    if not candidates.size:
        return []
    x = np.log(np.where(pairs, mu, UNPAIRED_VALUE))
    x = np.take_along_axis(x, np.argsort(np.abs(x.real), axis=1)[:, :MAX_EXTRAPOLATED_PAIRS], axis=1)
    crossings: dict[int, float] = {}
    for side in (0, 1):
        neighbours = candidates + 3 * side - 1
        within = (neighbours >= 0) & (neighbours < len(mu))
        within[within] = length[neighbours[within] - side] > 0.0  # points that coincide have no line
        segments, neighbours = candidates[within], neighbours[within]
        end_values, neighbour_values = x[segments + side], x[neighbours]
        nearest = np.abs(end_values[:, :, None] - neighbour_values[:, None, :]).argmin(axis=2)
        grows = end_values.real - np.take_along_axis(neighbour_values.real, nearest, axis=1)
        grows *= (length[segments] / length[neighbours - side])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            first = np.where(np.abs(end_values.real) > STABILITY_TOLERANCE, -end_values.real / grows, np.inf)
        first = np.where(first > 0, first, np.inf).min(axis=1)
        crossings |= {int(i): abs(side - float(s)) for i, s in zip(segments, first, strict=True) if s < SECANT_REACH}
    return sorted(crossings.items())


def leaps(mu: ComplexArray) -> list[tuple[int, float]]:
    """Return the segments across which multipliers mu (points, r) cannot be followed, each with its middle.

    A multiplier that is not far within the unit circle has none within `MAX_MULTIPLIER_CHANGE`, relative to the
    largest, at the other end.
    """
    size = np.abs(mu)
    largest = np.maximum(np.minimum(*(size[i : len(size) - 1 + i].max(axis=1, initial=0.0) for i in (0, 1))), 1.0)
    distances = np.abs(mu[:-1, :, None] - mu[1:, None, :])
    forward = np.where(size[:-1] > MIN_MODULUS, distances.min(axis=2, initial=np.inf), 0.0).max(axis=1, initial=0.0)
    backward = np.where(size[1:] > MIN_MODULUS, distances.min(axis=1, initial=np.inf), 0.0).max(axis=1, initial=0.0)
    segments = np.flatnonzero(
        np.isfinite(forward + backward) & (np.maximum(forward, backward) > MAX_MULTIPLIER_CHANGE * largest)
    )
    return [(segment, 0.5) for segment in segments.tolist()]


MAX_MULTIPLIER_CHANGE = 0.8
"""Distance between a multiplier and the nearest one at the next point, from which it may be another multiplier.

With the default steps 0.6 % of all segments of spur pairs exceed it, most of them next to a grazing contact.
"""


UNPAIRED_VALUE = 1e-300
"""Value that replaces multipliers outside complex pairs."""


MAX_EXTRAPOLATED_PAIRS = 8
"""Number of pairs per point, nearest to the circle, that are extrapolated."""


def passes_minus_one_cleanly(mu: ComplexArray, length: Array, segments: np.ndarray) -> np.ndarray:
    """Return whether complex pairs clearly pass -1 on segments (n,), and no pair near -1 reaches it.

    Each pair that is not far within the circle is followed over the segment and its two neighbours. Its sigma must be
    nearly constant and straight, and its theta a parabola that may change its sign. The cubic through sigma^2 + theta^2
    at these four points must come down to sigma^2, and not below. If all pairs are far within the circle, none reaches
    -1. The result is False where pairs cannot be followed or are real, where points coincide up to rounding, and on the
    first and the last segment.
    """
    clean = np.zeros(len(segments), dtype=bool)
    interior = np.flatnonzero((segments > 0) & (segments + 1 < len(length)))
    points = segments[interior, None] + np.arange(-1, 3)
    negative = ~_in_upper_half_plane(mu) & ~_in_upper_half_plane(mu.conj()) & (mu.real < -MIN_MODULUS)
    x = np.append(0.0, np.cumsum(length))
    usable = np.isfinite(mu[points]).all(axis=(1, 2)) & ~negative[points].any(axis=(1, 2))
    usable &= (np.diff(x[points], axis=1) > 0.0).all(axis=1)
    interior, points = interior[usable], points[usable]
    if interior.size:
        sigma, theta = _from_minus_one(mu[points])
        same_pair = _continued_pairs(
            sigma, theta, x[points], _weights(x, segments[interior], points, MINIMUM_FRACTIONS)
        )
        close = (sigma > np.log(MIN_MODULUS)) & (theta < MAX_APPROACH_ANGLE)
        followed = (same_pair.any(axis=2) | ~close[:, 1]).all(axis=1) & (same_pair.any(axis=1) | ~close[:, 2]).all(
            axis=1
        )
        clean[interior] = (followed & close[:, 1:3].any(axis=(1, 2))) | ~(np.abs(mu[points]) > MIN_MODULUS).any(
            axis=(1, 2)
        )
    return clean


MIN_FOLLOWED_MODULUS = 0.3
"""Modulus up to which pairs are not followed."""


MAX_APPROACH_ANGLE = 1.0
"""Angle theta [rad] up to which a pair may reach -1 on a segment."""


MAX_SIGMA_CHANGE = 0.2
"""Largest change of sigma, relative to it, of one followed pair."""


MAX_THETA_CURVATURE = 0.4
"""Largest deviation of theta from a line at a neighbouring point, over its change up to there."""


MAX_CURVATURE_DIFFERENCE = 0.1
"""Largest difference of these deviations at both neighbouring points, over the change of theta."""


MIN_PASSING_MINIMUM, MAX_PASSING_MINIMUM = 0.5, 2.0
"""Range of the smallest sigma^2 + theta^2, over sigma^2, of a pair that passes -1 without reaching it."""


MINIMUM_FRACTIONS = np.arange(17) / 16
"""Fractions of a segment at which the smallest sigma^2 + theta^2 is searched."""


MAX_FOLLOWED_PAIRS = 32
"""Number of pairs nearest to -1 among which one is followed."""


def _from_minus_one(mu: ComplexArray) -> tuple[Array, Array]:
    """Return sigma and theta, (segments, 4, r) each, of the pairs nearest to -1; other entries are far away."""
    log = np.log(np.where(_in_upper_half_plane(mu) & (np.abs(mu) > MIN_FOLLOWED_MODULUS), mu, 1e9))
    order = np.argsort(-log.imag, axis=2, kind="stable")[:, :, :MAX_FOLLOWED_PAIRS]
    return np.take_along_axis(log.real, order, axis=2), np.pi - np.take_along_axis(log.imag, order, axis=2)


def _continued_pairs(sigma: Array, theta: Array, x: Array, weights: Array) -> np.ndarray:
    """Return which pairs at point 1 of four continue which pairs at point 2, (segments, r, r), if one is near -1.

    x : (segments, 4) positions of the points. weights : (segments, `MINIMUM_FRACTIONS`, 4), of the points in the cubic
    between points 1 and 2.
    """
    steady = np.abs(sigma[:, 2, None, :] - sigma[:, 1, :, None]) <= MAX_SIGMA_CHANGE * np.abs(sigma[:, 1, :, None])
    close = np.minimum(theta[:, 1, :, None], theta[:, 2, None, :]) < MAX_APPROACH_ANGLE
    segment, first, second = indices = np.nonzero(steady & close)
    s, t, end = sigma[segment, 1, first], theta[segment, 1, first], theta[segment, 2, second]
    offset, slope = x[segment] - x[segment, 1:2], (np.array([[1.0], [-1.0]]) * end - t) / (x[:, 2] - x[:, 1])[segment]
    line = t[:, None] + slope[:, :, None] * offset  # (signs, found, 4)
    sigma_line = s[:, None] + ((sigma[segment, 2, second] - s) / (x[:, 2] - x[:, 1])[segment])[:, None] * offset
    deviation = np.where(
        np.abs(sigma[segment] - sigma_line[..., None]) <= MAX_SIGMA_CHANGE * np.abs(s)[:, None, None],
        np.abs(theta[segment] - np.abs(line)[..., None]),
        np.inf,
    )
    nearest = segment[:, None], np.arange(4), deviation.argmin(axis=-1)
    changes = np.abs(slope[:, :, None]) * np.minimum(np.abs(offset), np.abs(x[segment] - x[segment, 2:3]))
    bends = (np.copysign(theta[nearest], line) - line)[..., [0, 3]] / (offset * (x[segment] - x[segment, 2:3]))[
        :, [0, 3]
    ]
    difference = np.abs(bends[..., 0] - bends[..., 1]) * (x[:, 3] - x[:, 2])[segment] * (x[:, 3] - x[:, 1])[segment]
    followed = (deviation.min(axis=-1) <= MAX_THETA_CURVATURE * changes + 1e-9).all(axis=-1) & (
        difference <= MAX_CURVATURE_DIFFERENCE * changes[..., 3] + 1e-9
    )
    square = (sigma**2 + theta**2)[nearest]
    lowest = _parabola_minimum(np.einsum("sfr,fpr->sfp", square, weights[segment]))
    lowest -= CUBIC_ERROR_SHARE * _cubic_remainder(square, x[segment])
    smallest = np.minimum(s**2, sigma[segment, 2, second] ** 2)
    largest = np.array([[np.inf], [MAX_PASSING_MINIMUM]]) * smallest  # of pairs that pass
    same_pair = np.zeros(steady.shape, dtype=bool)
    same_pair[indices] = (followed & (lowest > MIN_PASSING_MINIMUM * smallest) & (lowest < largest)).any(axis=0)
    return same_pair


CUBIC_ERROR_SHARE = 0.25
"""Share of the third-order term of the cubic that is taken as its error.

Without it a pair in an instability tongue of width 0.04 was classified as passing -1 on a step of 0.24, where points so
far apart do not resolve the tongue.
"""


def _cubic_remainder(f: Array, x: Array) -> Array:
    """Return the largest difference, between points 1 and 2, of the cubic through values f (..., 4) from parabolas."""
    for k in range(1, 4):
        f = np.diff(f, axis=-1) / (x[:, k:] - x[:, :-k])
    weight = 0.25 * (x[:, 2] - x[:, 1]) ** 2 * np.maximum(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    return np.abs(f[..., 0]) * weight


def _parabola_minimum(f: Array) -> Array:
    """Return the minimum along the last axis of the parabola through the three values around the smallest one."""
    i = np.clip(f.argmin(axis=-1), 1, f.shape[-1] - 2)[..., None]
    before, middle, after = (np.take_along_axis(f, i + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    curvature = before - 2 * middle + after
    offset = np.clip(0.5 * (before - after) / np.where(curvature > 0, curvature, np.inf), -1.0, 1.0)
    return middle + 0.5 * offset * (after - before) + 0.5 * offset**2 * curvature


def _in_upper_half_plane(mu: ComplexArray) -> np.ndarray:
    """Return which multipliers belong to a complex pair and have a positive imaginary part."""
    return is_complex(mu) & (mu.imag > 0)


MAX_MATCH_RATIO = 0.5
"""Distance to the nearest multiplier across the circle, over that on the same side, of a certain crossing."""


def _crossing_ratio(
    distances: Array, size: Array, outside: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[Array, Array]:
    """Return the least distance ratio of multipliers outside at ``first`` and inside at ``second``, and its fraction.

    A small ratio means a certain crossing. size : logarithms of the moduli. The fraction is measured on each segment.
    """
    inner = np.where(outside[second, None, :], np.inf, distances)
    nearest_inner, nearest_outer = inner.min(axis=2), np.where(outside[second, None, :], distances, np.inf).min(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(outside[first] & np.isfinite(nearest_inner), nearest_inner / nearest_outer, np.inf)
        second_size = np.take_along_axis(size[second], inner.argmin(axis=2), axis=1)
        fraction = size[first] / (size[first] - second_size)
    best = np.arange(len(ratio)), ratio.argmin(axis=1)
    return ratio[best], fraction[best]


def _may_collide(mu: ComplexArray) -> np.ndarray:
    """Return on which segments two multipliers are so near each other, and near the circle, that they may collide."""
    size = np.abs(mu)
    leading = size > MIN_MODULUS
    distance = np.where(leading[:, :, None] & leading[:, None, :], np.abs(mu[:, :, None] - mu[:, None, :]), np.inf)
    distance[:, np.arange(mu.shape[1]), np.arange(mu.shape[1])] = np.inf
    nearest = distance.min(axis=(1, 2))
    nearest = np.minimum(nearest[1:], nearest[:-1])
    change = np.where(leading[1:, None, :], np.abs(mu[:-1, :, None] - mu[1:, None, :]), np.inf).min(axis=2)
    change = np.where(leading[:-1], change, 0.0).max(axis=1)
    change = np.pad(change, 1, mode="edge")
    change = np.maximum(np.maximum(change[:-2], change[2:]), change[1:-1])  # also on the neighbouring segments
    gap = np.abs(1 - np.where(leading, size, np.inf)).min(axis=1)
    return (
        (nearest < COLLISION_DISTANCE_RATIO * change) & (np.minimum(gap[1:], gap[:-1]) < nearest) & np.isfinite(nearest)
    )


def _groups(size: Array) -> np.ndarray:
    """Return how many of the largest multipliers are separate from the others; 0 if too many.

    size : sorted moduli (segments, points, r).
    """
    out = np.zeros(len(size), dtype=int)
    for k in range(min(size.shape[2], MAX_GROUP_SIZE), 1, -1):
        next_size = size[:, :, k] if k < size.shape[2] else np.zeros(size.shape[:2])
        out[np.all((next_size < MIN_MODULUS) & (size[:, :, k - 1] > GROUP_SEPARATION * next_size), axis=1)] = k
    return out


def _interpolated_multipliers(mu: ComplexArray, x: Array, segments: np.ndarray, points: np.ndarray) -> ComplexArray:
    """Return multipliers (segments, fractions, k) at the `INTERPOLATION_FRACTIONS` of segments.

    They are interpolated from multipliers (all, k) at x of the given points of each segment.
    """
    k = mu.shape[1]
    c = np.zeros((len(mu), k + 1), dtype=complex)
    c[:, 0] = 1.0
    for j in range(k):
        c[:, 1 : j + 2] -= mu[:, j, None] * c[:, : j + 1]
    companion = np.zeros((len(segments), len(INTERPOLATION_FRACTIONS), k, k))
    companion[:, :, 0] = -(_weights(x, segments, points, INTERPOLATION_FRACTIONS) @ c.real[points])[:, :, 1:]
    companion[:, :, 1:, :-1] = np.eye(k - 1)
    return np.linalg.eigvals(companion)


def _weights(x: Array, segments: np.ndarray, points: np.ndarray, fractions: Array) -> Array:
    """Return weights (segments, fractions, points) of the polynomial through the given points of each segment."""
    positions, count = x[segments, None] + np.diff(x)[segments, None] * fractions, points.shape[1]
    weights = np.ones((len(segments), len(fractions), count))
    for i in range(count):
        for j in range(count):
            if j != i:
                weights[:, :, i] *= (positions - x[points[:, j], None]) / (
                    x[points[:, i], None] - x[points[:, j], None]
                )
    return weights
