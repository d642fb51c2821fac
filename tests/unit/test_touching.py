"""Where a test function of one sign at the rows may cross zero between them."""

import numpy as np
import pytest

from hbgear.continuation.events.near_tangency import near_zeros


def found(f, x):
    x = np.asarray(x, dtype=float)
    return near_zeros(np.array([f(x)]).T, np.diff(x))


def places(f, x):
    return [x[i] + s * (x[i + 1] - x[i]) for i, s in found(f, x)]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_parabola_through_three_points(sign):
    x = [0.0, 1.0, 1.9, 3.0]
    assert places(lambda x: sign * ((x - 1.4) ** 2 - 0.04), x) == pytest.approx([1.4])
    assert not found(lambda x: sign * ((x - 1.4) ** 2 + 2.0), x)


def test_lines_meet_beyond_zero_on_a_piece_longer_than_others():
    """A bump on a long piece: each line through short ones beside it reaches zero before it meets the other."""
    x = np.array([0.0, 0.2, 3.2, 3.4])
    ((piece, s),) = found(lambda x: np.abs(x - 1.7) - 1.0, x)
    assert piece == 1 and s == pytest.approx(0.5)
    assert not found(lambda x: np.abs(x - 1.7) + 0.1, x)


@pytest.mark.parametrize("mirror", [1, -1])
def test_a_line_that_reaches_zero_at_once(mirror):
    """det(Phi + 1) of two masses, steep on one side, flat on the other: zero at .9386125 and .9422022."""
    x = np.array([0.923315, 0.9320736, 0.9363386, 0.9423536, 0.9444353, 0.9462202])[::mirror]
    f = np.array([-19.30286, -12.07228, -7.12432, -0.01074, -0.14504, -0.26161])[::mirror, None]
    between = [x[i] + s * (x[i + 1] - x[i]) for i, s in near_zeros(f, np.abs(np.diff(x)))]
    assert any(0.9386125 < place < 0.9422022 for place in between)


def test_unknown_values_and_few_points():
    assert near_zeros(np.full((4, 2), np.nan), np.ones(3)) == []
    assert near_zeros(np.ones((2, 1)), np.ones(1)) == []
    assert near_zeros(np.array([[1.0], [-1.0], [1.0], [2.0]]), np.ones(3)) == []  # a change of sign is no dip


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("where", [0.07, 0.28, 0.74, 1.28, 1.8])
def test_the_minimum_of_a_parabola_between_unequal_steps_is_exact(where, sign):
    """Three points determine a parabola; its minimum lies on the first, an inner or the last segment."""
    x = np.array([0.0, 0.1, 0.35, 0.5, 1.0, 1.15, 1.7, 2.0])
    places = dict(near_zeros(sign * ((x - where) ** 2 + 1e-4)[:, None], np.diff(x)))
    segment = int(np.searchsorted(x, where)) - 1
    assert x[segment] + places[segment] * (x[segment + 1] - x[segment]) == pytest.approx(where, abs=1e-9)
