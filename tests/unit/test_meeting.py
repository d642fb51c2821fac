"""Pairs of multipliers that pass the unit circle both ways between two rows."""

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.events.even_crossings import find_even_crossings
from hbgear.continuation.tracing import even_crossing_search
from hbgear.harmonic.multipliers.multiplier_collisions import (
    exchanges,
    extrapolated_crossings,
    leaps,
    passes_minus_one_cleanly,
)


def pairs(*exponents):
    mu = np.exp(np.array(exponents))
    return np.concatenate([mu, mu.conj()])


def test_one_leaves_as_another_returns():
    """A pair goes from .01 to -.03 beyond the circle, another from -.02 to .02: at .25 and .5 of the piece."""
    mu = np.array([pairs(0.01 + 1.4j, -0.02 + 2.6j), pairs(-0.03 + 1.45j, 0.02 + 2.62j)])
    ((piece, s),) = exchanges(mu)
    assert piece == 0 and s == pytest.approx(0.375)


def test_the_same_pair_stays_outside():
    mu = np.array([pairs(0.01 + 1.4j, -0.02 + 2.6j), pairs(0.03 + 1.5j, -0.02 + 2.62j)])
    assert exchanges(mu) == []
    assert exchanges(mu[:, :0]) == []
    assert exchanges(np.array([pairs(-0.01 + 1.4j), pairs(0.01 + 1.4j)])) == []  # their number tells


def test_one_that_moves_far_leaves_because_another_surely_returned():
    """Their number stays one: at 7/8 the one returns, at .162 the other left, which came from as near either side."""
    mu = np.array([pairs(0.007 + 0.805j, -0.0185 + 0.868j), pairs(-0.001 + 0.83j, 0.096 + 0.88j)])
    ((piece, s),) = exchanges(mu)
    assert piece == 0 and s == pytest.approx((7 / 8 + 185 / 1145) / 2)


def test_a_pair_about_to_leave_is_seen_behind_a_steady_one():
    """From -.02 to -.01 on a step and on at that pace it passes at half the way; its end tells of another pair."""
    beside = -0.001 + 1j
    mu = np.array([pairs(-0.02 + 3j, 0.05 + 2.9j, beside), pairs(-0.01 + 3.02j, 0.04 + 2.95j, beside),
                   pairs(-0.07 + 2.8j, 0.03 + 2.95j, beside)])  # fmt: skip
    assert extrapolated_crossings(mu, np.array([1.0, 1.0])) == []  # not so soon
    ((piece, s),) = extrapolated_crossings(mu, np.array([1.0, 10.0]))
    assert piece == 1 and s == pytest.approx(0.1)
    ((piece, s),) = extrapolated_crossings(mu[::-1], np.array([10.0, 1.0]))
    assert piece == 0 and s == pytest.approx(0.9)
    assert (
        extrapolated_crossings(np.delete(mu, [1, 4], axis=1), np.array([1.0, 10.0])) == []
    )  # nothing to change places with


def near_minus_one(sigma, detuning, width=0.0):
    """A pair that passes -1, and is real there where the detuning is below the width: it reaches -1 from sigma on."""
    parted = np.emath.sqrt(width**2 - detuning**2)
    return -np.exp(sigma + np.array([parted, -parted], dtype=complex))


def four_rows(random, curved, width):
    """Lengths and multipliers of rows on either side of where a pair passes -1; the width in units of sigma."""
    x = np.cumsum(random.uniform(0.6, 1.4, 4))
    x -= random.uniform(x[1], x[2])
    speed, sigma = random.uniform(0.05, 0.4), -(10 ** random.uniform(-3, -0.7))
    detuning = speed * (x + curved * random.uniform(-0.05, 0.05) * x**2)
    mu = [near_minus_one(sigma * (1 + 0.02 * at), d, width * abs(sigma)) for at, d in zip(x, detuning, strict=True)]
    return np.diff(x), np.array(mu)


def plainly(rows):
    length, mu = rows
    return bool(passes_minus_one_cleanly(mu, length, np.array([1]))[0])


def test_a_pair_that_passes_minus_one_is_told_from_one_that_reaches_it():
    random = np.random.default_rng(3)
    assert all(plainly(four_rows(random, 0, 0.0)) for _ in range(300))
    for width in (1.02, 1.3, 2.0, 5.0, 30.0):
        assert not any(plainly(four_rows(random, curved, width)) for curved in (0, 1) for _ in range(300))


def test_a_pair_that_speeds_up_passes_plainly():
    """As where the frequency falls by a tenth from row to row; one that meets there does not, however fast."""
    x = np.array([-1.3, -0.4, 0.7, 1.8])
    for faster in (-0.1, 0.1):
        detuning = 0.3 * (x + faster * x**2)
        for width in (0.0, 1.02, 2.0):
            mu = [near_minus_one(-0.1 + 0.01 * at, d, 0.1 * width) for at, d in zip(x, detuning, strict=True)]
            assert plainly((np.diff(x), np.array(mu))) is (width == 0)


def test_pairs_far_within_the_circle_are_plain():
    mu = np.array([near_minus_one(-0.6, d) for d in (-0.3, 0.5, 0.1, 0.4)])
    assert plainly((np.ones(3), mu)) and not plainly((np.ones(3), mu * np.exp(0.3)))


def test_each_of_several_pairs_must_pass_plainly():
    x = np.array([-1.3, -0.4, 0.7, 1.8])
    slow, fast = ([near_minus_one(s, d) for d in v * (x - at)] for s, v, at in ((-0.01, 0.1, 0.0), (-0.2, 0.4, 0.3)))
    wide = [near_minus_one(-0.2, d, 0.25) for d in 0.4 * (x - 0.1)]
    apart = [near_minus_one(-0.05, d) for d in (1.4, 1.5, 1.6, 1.7)]
    for pairs_, plain in (((slow, fast), True), ((slow, apart), True), ((slow, wide), False), ((apart,), False)):
        assert plainly((np.diff(x), np.hstack(pairs_))) is plain


def test_what_cannot_be_followed_is_not_plain():
    x = np.array([-1.3, -0.4, 0.7, 1.8])
    mu = np.array([near_minus_one(-0.01, 0.1 * d) for d in x])
    assert passes_minus_one_cleanly(mu, np.diff(x), np.array([0, 1, 2])).tolist() == [
        False,
        True,
        False,
    ]  # no rows on either side
    assert passes_minus_one_cleanly(mu, np.diff(x), np.array([], dtype=int)).tolist() == []
    unknown, real, sudden = mu.copy(), np.hstack([mu, np.full((4, 2), -0.8)]), mu.copy()
    unknown[3] = np.nan
    sudden[2] *= np.exp(-0.01)
    assert not plainly((np.diff(x), unknown))
    assert not plainly((np.diff(x), real))
    assert not plainly((np.diff(x), sudden))


def test_modes_that_pass_minus_one_are_not_looked_at_closer(monkeypatch):
    """Each of the modes of a chain does, some on every curve; a look takes as long as twenty rows."""
    looks = []
    monkeypatch.setattr(
        even_crossing_search, "find_even_crossings", lambda *args: looks.append(args) or find_even_crossings(*args)
    )
    K = 2 * np.eye(30) - np.eye(30, k=1) - np.eye(30, k=-1)
    spring = hb.Element(np.eye(30)[-1], hb.Cubic(k1=0.0, k3=0.5))
    chain = hb.System(np.eye(30), 0.02 * K, K, [spring], hb.Load(cosine={1: 0.1 * np.eye(30)[0]}))
    first = 2 * np.sin(np.pi / 62)
    curve = hb.trace(hb.HarmonicBalance(chain, 5), "Omega", (0.8 * first, 1.3 * first), accuracy=None)
    assert [point.kind for point in curve.special] == ["LP", "LP"] and len(looks) <= 2


def test_multipliers_that_leap_cannot_be_followed():
    """A pair that turns by 20 degrees between rows is followed, by 60 it may be another one; small ones are not."""
    angle = np.radians([20.0, 40.0, 60.0, 120.0, 140.0])
    small = 0.05 * np.exp(3j * angle)
    mu = np.column_stack([np.exp(1j * angle), np.exp(-1j * angle), small, small.conj()])
    assert leaps(mu) == [(2, 0.5)]
    mu[3, 0] = np.nan
    assert leaps(mu) == []  # nothing is known there
    assert leaps(mu[:, :0]) == []
