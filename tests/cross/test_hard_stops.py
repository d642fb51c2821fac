"""One mass and a hard stop: a curve that cannot pass a grazing contact ends at it, in seconds, and is right before."""

import time

import numpy as np
import pytest
from scipy.optimize import brentq

import hbgear as hb

GAP, C, F = 0.5, 0.1, 0.3


def grazing(low, high):
    """Omega at which the motion without contact reaches the stop."""
    return brentq(lambda w: F / abs(1 - w**2 + 1j * w * C) - GAP, low, high, xtol=1e-15)


@pytest.mark.parametrize("k, H", [(1e4, 32), (1e5, 32)])
def test_curve_ends_at_the_contact_that_it_cannot_pass(k, H):
    stop = hb.Element([1.0], hb.Unilateral(k=k, gap=GAP), name="stop")
    model = hb.System([[1.0]], [[C]], [[1.0]], [stop], hb.Load(cosine={1: [F]}))
    hb.trace(hb.HarmonicBalance(model, 4), "Omega", (0.5, 0.51))  # compiles
    start = time.process_time()
    curve = hb.trace(hb.HarmonicBalance(model, H), "Omega", (0.6, 2.2))
    assert time.process_time() - start < 10
    assert curve.status == hb.Status.STEP_TOO_SMALL
    assert "grazing contact" in curve.message and "highest of stop at 0.5" in curve.message
    assert "more harmonics" in curve.message
    assert [point.label for point in curve.special] == ["GR1"]
    point = curve.special[0]
    assert point.parameters["Omega"] == pytest.approx(grazing(0.6, 0.7), abs=1e-10)
    assert point.index == len(curve) - 1
    q = F / np.abs(1 - curve.values**2 + 1j * C * curve.values)
    np.testing.assert_allclose(np.linalg.norm(curve.X[:, 1:], axis=1), q, atol=1e-8)
    assert np.all(curve.stable[:-1])
    np.testing.assert_allclose(np.abs(curve.multipliers[:, 0]), np.exp(-C * np.pi / curve.values), atol=1e-6)
    (other,) = curve.others
    assert other.special[0].parameters["Omega"] == pytest.approx(grazing(1.1, 1.4), abs=1e-10)
