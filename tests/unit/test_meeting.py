"""Pairs of multipliers that pass the unit circle both ways between two rows."""

import numpy as np
import pytest

from hbgear.harmonic.meeting import exchanges


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
