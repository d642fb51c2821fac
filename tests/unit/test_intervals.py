"""Standard errors of the likelihood, of residuals that are known in closed form."""

import numpy as np
import pytest

from hbgear.design.fitting.profile_likelihood import MAX_END_RATIO, profile_interval

A = np.array([[1.0, 0.4], [0.3, 2.0], [-0.5, 0.7]])


class Known:
    """What a model says that is linear with A, or bent: r = A bend(a) / s."""

    deviation = np.array([0.1, 0.2, 0.1])

    def __init__(self, a, bend=lambda a: a):
        self.a, self.bend = np.asarray(a, dtype=float), bend

    def residuals(self, s):
        return A @ self.bend(self.a) / s

    def information(self, s):
        return A / s[:, None]


def found(bend=lambda a: a, unit=1.0):
    best = Known(np.zeros(2), bend)
    J = best.information(best.deviation)
    C = unit * np.linalg.inv(J.T @ J)
    errors = profile_interval(best, lambda a: Known(a, bend), best.a, C, unit, np.full(2, -9.0), np.full(2, 9.0))
    return errors, np.sqrt(np.diag(C))


@pytest.mark.parametrize("unit", [1.0, 0.3])
def test_of_a_linear_model_it_is_that_of_first_order(unit):
    errors, first = found(unit=unit)
    np.testing.assert_allclose(errors, first, rtol=1e-12)


def test_the_slower_side_counts():
    """The first parameter acts half as much below its estimate, and ten times as much above."""
    errors, first = found(lambda a: np.array([a[0] * (0.5 if a[0] < 0 else 10.0), a[1]]))
    assert errors[0] == pytest.approx(2 * first[0], rel=1e-12)
    assert errors[1] <= 1.5 * first[1]


def test_unbounded_curves_are_detected_by_the_limit():
    errors, first = found(lambda a: np.array([max(a[0], 0.0), a[1]]))
    assert errors[0] == pytest.approx(MAX_END_RATIO * first[0])


def test_bounds_are_kept():
    """Within half a standard error of the estimate there is less to be seen, and the same found."""
    _, first = found()
    seen = []
    best = Known(np.zeros(2))
    J = best.information(best.deviation)
    C = np.linalg.inv(J.T @ J)

    def at(a):
        seen.append(a)
        return Known(a)

    errors = profile_interval(best, at, best.a, C, 1.0, -0.5 * first, 0.5 * first)
    assert np.abs(seen).max(axis=0) == pytest.approx(0.5 * first)
    assert errors == pytest.approx(first, rel=1e-9)


def test_curves_are_traced_two_standard_errors_away():
    """At the ends of the linear model, where the sum of squares has increased by four."""
    best, seen = Known(np.zeros(2)), []
    J = best.information(best.deviation)
    C = np.linalg.inv(J.T @ J)

    def at(a):
        seen.append(Known(a))
        return seen[-1]

    profile_interval(best, at, best.a, C, 1.0, np.full(2, -9.0), np.full(2, 9.0))
    ends = [side * 2 * C[:, j] / np.sqrt(C[j, j]) for j in range(2) for side in (-1, 1)]
    np.testing.assert_allclose([known.a for known in seen], ends, rtol=1e-12)
    sums = [np.square(known.residuals(best.deviation)).sum() for known in seen]
    np.testing.assert_allclose(sums, 4.0, rtol=1e-12)


def test_no_message_without_a_curve():
    best = Known(np.zeros(2))
    C = np.array([[0.01, np.nan], [np.nan, np.nan]])
    assert np.isnan(profile_interval(best, lambda a: None, best.a, C, 1.0, np.full(2, -1.0), np.full(2, 1.0))).all()
