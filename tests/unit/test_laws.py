"""Force laws: values, derivatives, corners."""

import numpy as np
import pytest
from machines import Drag

from hbgear import Backlash, Cubic, Unilateral
from hbgear.mechanics import Parallel, PiecewiseLinear, Series

WAVY = Series(mean=1.0, cosine=(-0.2, 0.05), sine=(0.1,))
ONE = np.ones(1)


LAWS = {
    "cubic": Cubic(0.4, 1.2),
    "softening": Cubic(-0.4),
    "backlash": Backlash(0.7, 2.0, WAVY),
    "no gap": Backlash(0.0, 2.0, WAVY),
    "unilateral": Unilateral(1.5, 0.3, WAVY),
    "preloaded": Unilateral(1.5, -0.3),
    "three stages": PiecewiseLinear((-1.0, 0.2, 0.9), (0.5, 1.0, 0.2, 3.0), 0.4, WAVY),
    "parallel": Parallel((Cubic(0.4), Backlash(0.5, 3.0, WAVY), Drag(wave=0.5))),
    "drag": Drag(wave=0.5),
}


def test_backlash_values():
    d = np.array([-2.0, -1.0, -0.5, 0.0, 0.9, 1.0, 1.5])
    p, k, c = Backlash(1.0, 2.0).force(d, 0 * d, 0 * d)
    np.testing.assert_allclose(p, [-2, 0, 0, 0, 0, 0, 1], atol=1e-15)
    np.testing.assert_array_equal(k[[0, 2, 3, 4, 6]], [2, 0, 0, 0, 2])
    assert not c.any()
    p, k, _ = Backlash(0.0, 2.0).force(d, 0 * d, 0 * d)
    np.testing.assert_allclose(p, 2 * d, atol=1e-15)


def test_unilateral_values():
    d = np.array([-1.0, -0.3, 0.0, 0.5])
    np.testing.assert_allclose(Unilateral(2.0, 0.2).force(d, d, d)[0], [0, 0, 0, 0.6], atol=1e-15)
    np.testing.assert_allclose(Unilateral(2.0, -0.3).force(d, d, d)[0], [0, 0, 0.6, 1.6], atol=1e-15)


def test_three_stages_values():
    d = np.array([-2.0, -1.0, 0.0, 0.2, 0.9, 1.9])
    p, *_ = PiecewiseLinear((-1.0, 0.2, 0.9), (0.5, 1.0, 0.2, 3.0), 0.4).force(d, d, d)
    np.testing.assert_allclose(p, [-1.1, -0.6, 0.4, 0.6, 0.74, 3.74], atol=1e-14)


def test_stiffness_multiplies():
    d, tau = np.full(50, 1.6), np.linspace(0, 7, 50)
    p, k, _ = Backlash(0.6, 2.0, WAVY).force(d, 0 * d, tau)
    np.testing.assert_allclose(p, 2 * WAVY(tau), atol=1e-14)
    np.testing.assert_allclose(k, 2 * WAVY(tau), atol=1e-14)


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_against_differences(name, rng):
    law, h = LAWS[name], 1e-5
    d, v, tau = rng.uniform(-2, 2, 400), rng.uniform(-2, 2, 400), rng.uniform(0, 7, 400)
    away = np.all([np.abs(d - x) > 10 * h for x in law.breakpoints] or [d == d], axis=0)
    d, v, tau = d[away], v[away], tau[away]
    _, k, c = law.force(d, v, tau)
    np.testing.assert_allclose(k, (law.force(d + h, v, tau)[0] - law.force(d - h, v, tau)[0]) / (2 * h), atol=1e-7)
    np.testing.assert_allclose(c, (law.force(d, v + h, tau)[0] - law.force(d, v - h, tau)[0]) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("name", LAWS)
def test_continuous_and_bound_alike(name, rng):
    law = LAWS[name]
    assert law.reference >= 0
    assert list(law.breakpoints) == sorted(law.breakpoints)
    for x in law.breakpoints:
        below, above = (law.force((x + h) * ONE, ONE, ONE)[0] for h in (-1e-13, 1e-13))
        assert below == pytest.approx(above, abs=1e-11)
    d, v, tau = rng.uniform(-2, 2, (3, 50))
    for one, other in zip(law.force(d, v, tau), law.bind(tau)(d, v), strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.shape == d.shape


def test_breakpoints_of_parallel_laws():
    law = Parallel((Backlash(1.0), Unilateral(2.0, 0.5), Backlash(1.0)))
    assert law.breakpoints == (-1.0, 0.5, 1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Backlash(-1.0), "half backlash b = -1.0 must not be negative"),
        (lambda: Backlash(np.nan), "b = nan"),
        (lambda: Backlash(1.0, k=0.0), "k = 0.0 must be positive"),
        (lambda: Unilateral(np.inf), "k = inf must be a finite number"),
        (lambda: Unilateral(1.0, np.nan), "finite"),
        (lambda: Cubic(np.nan), "Cubic: k3 = nan must be a finite number"),
        (lambda: PiecewiseLinear((1.0, 0.0), (1.0, 2.0, 3.0)), r"corners must ascend, got \(1.0, 0.0\)"),
        (lambda: PiecewiseLinear((1.0,), (1.0,)), "1 corners separate 2 slopes, got 1 slopes"),
        (lambda: PiecewiseLinear((1.0,), (1.0, np.nan)), "finite"),
        (lambda: Parallel(()), "at least one law"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()
