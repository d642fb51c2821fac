"""Bracketed roots against closed forms and SciPy."""

import math

import numpy as np
import pytest
import scipy.optimize

from hbgear.continuation.numerics.bracketed_root import find_root_bracketed

FUNCTIONS = {
    "cubic": (lambda x: x**3 - 2 * x - 5, 2.0, 3.0),
    "steep": (lambda x: math.tanh(1e4 * (x - 0.3)), 0.0, 1.0),
    "flat": (lambda x: (x - 0.4) ** 9, 0.0, 1.0),
    "kink": (lambda x: x - 0.7 if x < 0.7 else 1e3 * (x - 0.7), 0.0, 1.0),
    "root of the distance": (lambda x: math.copysign(math.sqrt(abs(x - 0.2)), x - 0.2), 0.0, 1.0),
    "step": (lambda x: -1.0 if x < 0.61 else 1.0, 0.0, 1.0),
    "near pole": (lambda x: 1 / (x + 1e-6) - 3, 0.0, 1.0),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_roots(name):
    function, low, high = FUNCTIONS[name]
    asked = []

    def counted(x):
        asked.append(x)
        return function(x)

    found = find_root_bracketed(counted, low, high, 1e-13)
    true = 0.4 if name == "flat" else scipy.optimize.brentq(function, low, high, xtol=1e-15, rtol=1e-14)
    assert abs(found - true) < (1e-13 if name != "flat" else 0.05) and len(asked) < 80
    assert all(low <= x <= high for x in asked)


def test_hundred_polynomials():
    """On average at most 20 % more evaluations than Brent's method."""
    rng, own, brent = np.random.default_rng(3), [], []
    for _ in range(100):
        place, bend = rng.uniform(0.05, 0.95), rng.uniform(-0.6, 0.6, 2)
        calls = []

        def function(x, place=place, bend=bend, calls=calls):
            calls.append(x)
            return (x - place) * (1 + bend[0] * x + bend[1] * x**2 / 2)

        assert abs(find_root_bracketed(function, 0.0, 1.0, 1e-13) - place) < 2e-13
        own.append(len(calls))
        _, result = scipy.optimize.brentq(function, 0.0, 1.0, xtol=1e-13, rtol=1e-13, full_output=True)
        brent.append(result.function_calls)
    assert np.mean(own) < 1.2 * np.mean(brent)


@pytest.mark.parametrize("curved", [0.0, 0.5])
def test_kinks_at_the_root_cost_few_evaluations(curved):
    """Slopes on both sides differ by factors of 0.01 to 100: interpolation across the root degrades to bisection."""
    rng, counts = np.random.default_rng(5), []
    for _ in range(100):
        root, ratio = rng.uniform(0.02, 0.98), 10 ** rng.uniform(-2, 2)
        calls = []

        def function(x, root=root, ratio=ratio, calls=calls):
            calls.append(x)
            return (x - root) * (1 + curved * (x - root)) * (ratio if x < root else 1.0)

        assert abs(find_root_bracketed(function, 0.0, 1.0, 1e-11) - root) < 2e-11
        counts.append(len(calls))
    assert np.mean(counts) < 15 and max(counts) <= 25


def test_a_good_first_place_saves_evaluations():
    rng, blind, guided = np.random.default_rng(4), [], []
    for _ in range(100):
        place, bend = rng.uniform(0.05, 0.95), rng.uniform(-0.6, 0.6)
        for counts, first in ((blind, math.nan), (guided, place + 1e-3 * rng.uniform(-1, 1))):
            calls = []

            def function(x, place=place, bend=bend, calls=calls):
                calls.append(x)
                return (x - place) * (1 + bend * x)

            assert abs(find_root_bracketed(function, 0.0, 1.0, 1e-9, first) - place) < 1e-9
            counts.append(len(calls))
    assert np.mean(guided) < np.mean(blind) - 1 and max(guided) <= max(blind)


def test_a_bad_first_place_does_no_harm():
    for first in (0.0, 1.0, 1e-12, 0.999):
        assert abs(find_root_bracketed(lambda x: x**3 - 0.2, 0.0, 1.0, 1e-13, first) - 0.2 ** (1 / 3)) < 2e-13


def test_ends_and_bad_input():
    assert find_root_bracketed(lambda x: x, 0.0, 1.0, 1e-13) == 0.0
    assert find_root_bracketed(lambda x: x - 1, 0.0, 1.0, 1e-13) == 1.0
    with pytest.raises(ValueError, match="no change of sign"):
        find_root_bracketed(lambda x: x + 1, 0.0, 1.0, 1e-13)
    with pytest.raises(ValueError, match="nan"):
        find_root_bracketed(lambda x: math.nan if 0 < x < 1 else x - 0.5, 0.0, 1.0, 1e-13)
