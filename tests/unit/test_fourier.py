"""Harmonics and samples: the coefficient order, transforms and derived rows."""

import pickle

import numpy as np
import pytest

from hbgear.mechanics.series.fourier import (
    Series,
    Transform,
    derive,
    evaluate,
    extrema,
    fast_length,
    harmonics_of,
    resize,
    stretch,
    to_complex,
    to_real,
    value_and_derivative,
    waves,
)

THETA = np.linspace(0, 2 * np.pi, 37)


def by_hand(row, theta):
    """Return a_0 + sum a_k cos(k theta) + b_k sin(k theta)."""
    k = np.arange(1, len(row) // 2 + 1)[:, None]
    return row[0] + row[1::2] @ np.cos(k * theta) + row[2::2] @ np.sin(k * theta)


def test_coefficient_order(rng):
    row = rng.standard_normal(11)
    np.testing.assert_allclose(evaluate(row, THETA), by_hand(row, THETA), atol=1e-13)
    c = to_complex(row)
    np.testing.assert_allclose(
        (c * np.exp(1j * np.outer(THETA, np.arange(6)))).real.sum(1), by_hand(row, THETA), atol=1e-13
    )
    np.testing.assert_array_equal(to_real(c), row)
    assert harmonics_of(row) == 5
    with pytest.raises(ValueError, match="a row of 10 coefficients has no order H; need an odd length"):
        harmonics_of(row[:10])


def test_derivatives_against_differences(rng):
    rows, h = rng.standard_normal((2, 9)), 1e-5
    for order in (0, 1, 2):
        slope = (evaluate(rows, THETA + h, order) - evaluate(rows, THETA - h, order)) / (2 * h)
        np.testing.assert_allclose(evaluate(rows, THETA, order + 1), slope, atol=1e-7)
        both = value_and_derivative(to_real(derive(to_complex(rows), order)), THETA)
        np.testing.assert_array_equal(both, [evaluate(rows, THETA, order), evaluate(rows, THETA, order + 1)])
        np.testing.assert_allclose(
            evaluate(to_real(derive(to_complex(rows), order)), THETA), evaluate(rows, THETA, order), atol=1e-12
        )


def test_waves():
    np.testing.assert_allclose(waves(THETA, 200), np.exp(1j * np.outer(THETA, np.arange(201))), atol=1e-12)


def test_resize_and_stretch(rng):
    rows = rng.standard_normal((3, 9))
    np.testing.assert_array_equal(resize(rows, 6)[:, :9], rows)
    assert not resize(rows, 6)[:, 9:].any()
    np.testing.assert_array_equal(resize(rows, 2), rows[:, :5])
    np.testing.assert_allclose(evaluate(stretch(rows, 3), THETA), evaluate(rows, 3 * THETA), atol=1e-12)


@pytest.mark.parametrize("H", [1, 3, 12, 40])
def test_extrema(rng, H):
    rows = rng.standard_normal((20, 2 * H + 1))
    low, at_low, high, at_high = extrema(rows)
    dense = evaluate(rows, np.linspace(0, 2 * np.pi, 4000 * H))
    for value, at, best in ((low, at_low, dense.min(-1)), (-high, at_high, -dense.max(-1))):
        # the error of a dense sample is of the order of its squared spacing
        assert np.all(value <= best + 1e-12) and np.all(value >= best - 1e-4)
        for row, x, t in zip(rows, value, at, strict=True):
            assert abs(evaluate(row, t)[0]) == pytest.approx(abs(x), abs=1e-12)
            assert evaluate(row, t, 1)[0] == pytest.approx(0.0, abs=1e-9 * H**2)


def test_extrema_of_two_almost_equal_peaks_and_of_constants():
    # cos 2 theta has two equal peaks; a small cos theta makes one of them the maximum
    for tiny in (1e-9, -1e-9):
        _, _, high, at = extrema(np.array([0.5, tiny, 0.0, 1.0, 0.0]))
        assert high == pytest.approx(1.5 + 1e-9, abs=1e-14)
        assert np.cos(at) == pytest.approx(np.sign(tiny), abs=1e-6)
    # the highest sample (N = 64) is on the lower peak at 0; the higher peak is a third of a step from a sample
    row = np.zeros(7)
    row[[1, 2, 5]] = 1e-3 * np.cos(2 * np.pi / 3), 1e-3 * np.sin(2 * np.pi / 3), 1.0
    _, _, high, at = extrema(row)
    assert (high, at) == (pytest.approx(1.001, abs=1e-12), pytest.approx(2 * np.pi / 3, abs=1e-6))
    low, _, high, _ = extrema(np.array([[2.5, 0, 0], [-1.0, 0, 0]]))
    np.testing.assert_array_equal([low, high], [[2.5, -1.0]] * 2)


def test_series():
    s = Series(mean=1.0, cosine=(0.3,), sine=(0.0, 0.2))
    expected = 1 + 0.3 * np.cos(THETA) + 0.2 * np.sin(2 * THETA)
    np.testing.assert_allclose(s(THETA), expected, atol=1e-14)
    assert s(0.0) == pytest.approx(1.3, abs=1e-15)
    np.testing.assert_allclose(s.shifted(0.7)(THETA), s(THETA - 0.7), atol=1e-14)
    np.testing.assert_allclose(s.scaled(-2)(THETA), -2 * expected, atol=1e-14)
    np.testing.assert_array_equal(s.row(), [1, 0.3, 0, 0, 0.2])
    np.testing.assert_array_equal(s.row(1), [1, 0.3, 0])
    assert s.order == 2 and Series().order == 0
    with pytest.raises(ValueError, match="finite"):
        Series(sine=(np.nan,))


@pytest.mark.parametrize(("H", "N"), [(1, 3), (5, 11), (5, 64), (16, 135)])
def test_transform(rng, H, N):
    rows = rng.standard_normal((2, 2 * H + 1))
    t = Transform(H, N)
    samples = t.samples(to_complex(rows))
    np.testing.assert_allclose(samples, evaluate(rows, 2 * np.pi * np.arange(N) / N), atol=1e-12)
    two_sided = to_complex(rows) * np.where(np.arange(H + 1) == 0, 1.0, 0.5)
    np.testing.assert_allclose(t.spectrum(samples)[:, : H + 1], two_sided, atol=1e-12)


def test_transforms_do_not_share_or_overwrite(rng):
    a, b = Transform(3, 16), Transform(3, 16)
    one, other = rng.standard_normal((2, 1, 7))
    kept, spectrum = a.samples(to_complex(one)), a.spectrum(evaluate(one, THETA[:16]))
    before = kept.copy(), spectrum.copy()
    b.samples(to_complex(other))
    a.samples(to_complex(other))
    a.spectrum(evaluate(other, THETA[:16]))
    np.testing.assert_array_equal(kept, before[0])
    np.testing.assert_array_equal(spectrum, before[1])
    again = pickle.loads(pickle.dumps(a))
    np.testing.assert_array_equal(again.samples(to_complex(one)), kept)


def test_too_few_samples():
    with pytest.raises(ValueError, match="N = 16 samples cannot resolve H = 8 harmonics; need N >= 17"):
        Transform(8, 16)


def test_fast_lengths_are_those_of_scipy():
    from scipy.fft import next_fast_len

    numbers = [*range(1, 300), 1021, 4099, 12345]
    assert [fast_length(n) for n in numbers] == [next_fast_len(n, real=True) for n in numbers]
