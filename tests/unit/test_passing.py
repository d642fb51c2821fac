"""Where a branch passes a value of its parameter."""

import numpy as np
import pytest

from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.finite_differences import parameter_derivatives
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.tracing.trace import trace


class Circle:
    """x^2 + p^2 = 1."""

    def evaluate(self, X, p):
        return X**2 + p**2 - 1, np.diag(2 * X)


@pytest.fixture(scope="module")
def circle() -> Branch:
    return trace(Circle(), "p", (0.0, 2.0), np.array([1.0]), special=False)


def test_every_place_is_found_and_lies_between_its_points(circle):
    places = crossings_at(circle, 0.6)
    assert [np.sign(place.interpolate(circle.X)[0]) for place in places] == [1, -1]
    for place in places:
        assert place.interpolate(circle.values) == pytest.approx(0.6, abs=1e-12)
        assert place.interpolate(circle.X) ** 2 + 0.36 == pytest.approx(1.0, abs=0.02)
        assert place.nearest in place.points == (place.index, place.index + 1)


def test_a_point_on_the_value_is_one_place(circle):
    middle = len(circle) // 3
    places = crossings_at(circle, float(circle.values[middle]))
    here = [place for place in places if place.nearest == middle]
    assert len(here) == 1 and here[0].points == (middle,)
    assert crossings_at(circle, float(circle.values[0]))[0].points == (0,)


def test_a_value_that_is_not_reached_has_no_place(circle):
    assert crossings_at(circle, 1.5) == []


def test_a_difference_is_central_within_the_range_and_one_sided_at_its_end():
    asked = []

    def root(at):
        asked.append(at["p"])
        if at["p"] < 1.0:
            raise ValueError("p must be at least 1")
        return at["p"] ** 2, np.array([at["p"] ** 3])

    square, cube = parameter_derivatives(ContinuationProblem(), "p", {"p": 3.0}, root)
    assert square == pytest.approx(6.0, rel=1e-9) and cube[0] == pytest.approx(27.0, rel=1e-9)
    assert min(asked) < 3.0 < max(asked)
    asked.clear()
    square, cube = parameter_derivatives(ContinuationProblem(), "p", {"p": 1.0}, root)
    assert square == pytest.approx(2.0, rel=1e-9) and cube[0] == pytest.approx(3.0, rel=1e-8)
    assert sorted(p for p in asked if p >= 1.0) == pytest.approx([1.0, 1.0 + 1e-5, 1.0 + 2e-5], abs=1e-12)


def test_a_difference_refused_on_both_sides_gives_the_reason():
    def nowhere(at):
        raise ValueError("p is never allowed")

    with pytest.raises(ValueError, match="never allowed"):
        parameter_derivatives(ContinuationProblem(), "p", {"p": 1.0}, nowhere)


def test_a_step_below_rounding_is_an_error_that_searches_expect():
    """Where dX/dp is infinite, a curve of Neimark-Sacker points ended with a division by zero."""
    with pytest.raises(ValueError, match=r"below the rounding of p = 1"):
        parameter_derivatives(ContinuationProblem(), "p", {"p": 1.0}, lambda at: (at["p"],), 1e-20)


@pytest.mark.parametrize("value", [0.0, 1e-9, -1e-12])
def test_a_difference_near_zero_keeps_its_digits(value):
    (slope,) = parameter_derivatives(ContinuationProblem(), "p", {"p": value}, lambda at: (np.sin(1.0 + at["p"]),))
    assert slope == pytest.approx(np.cos(1.0 + value), rel=1e-8)
