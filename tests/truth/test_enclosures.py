"""Enclosures of a certificate: Krawczyk's test, Taylor remainders and signs of gaps, against exact functions.

Each bound is compared where it is attained: a bound that is too small by a tenth does not contain the exact value.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("flint")

from hbgear.analysis.certificates.ball_system import BallFlow, balls, matrix, zeros
from hbgear.analysis.certificates.flows import TaylorStep, taylor_steps
from hbgear.analysis.certificates.gap_signs import SINGLE, _gap, _is_positive, _unproved
from hbgear.analysis.certificates.krawczyk import Krawczyk


def squares(z):
    """Return z^2 - 2 for each unknown, and its derivatives."""
    J = zeros(len(z), len(z))
    for i, x in enumerate(z):
        J[i, i] = 2 * x
    return np.array([x * x - 2 for x in z], dtype=object), J


@pytest.mark.parametrize(
    ("radius", "mapped"), [(0.0144, False), (0.0146, True), (0.3, True), (1.38, True), (1.39, False), (3.0, False)]
)
def test_a_box_with_two_zeros_is_not_mapped_into_itself(radius, mapped):
    """Of z^2 = 2, at z = 1.4: K = z - Y F + (1 - Y F') [-R, R], Y = 1 / 2z, has the half width R^2 / z.

    Its middle is shifted by 0.0143: K lies within boxes of 0.0145 < R < 1.385, which contain one zero.
    """
    image = Krawczyk(squares, balls([1.4, -1.4])).image(balls([radius, radius]))
    half_width = radius**2 / 1.4
    assert (image is not None) == mapped
    if image is not None:
        assert all(x.contains(y) for x, y in zip(image, (math.sqrt(2), -math.sqrt(2)), strict=True))
        np.testing.assert_allclose([float(x.rad()) for x in image], half_width, rtol=1e-6)


WIDTH = 0.875
"""Width of the step. The steps are shorter than 1 for a rate of 1."""


def exponential_step(order: int) -> TaylorStep:
    """Return one step of q'' = q from (1, 1), whose solution is e^s."""
    flow = BallFlow(1, balls([[0, 1], [1, 0]]), zeros(2, 2), ())
    (step,) = taylor_steps(flow, balls([0]).item(), balls([WIDTH]).item(), matrix(balls([[1], [1]])), order)
    return step


@pytest.mark.parametrize("order", [2, 3, 6])
def test_the_remainder_of_a_growing_solution_is_contained_and_attained(order):
    step = exponential_step(order)
    last, exact = step.last[0, 0], math.exp(WIDTH) / math.factorial(order + 1)
    assert exact * (1 - 1e-12) <= float(last.upper()) < exact * (1 + 1e-6)
    assert step.end[0, 0].contains(balls([WIDTH]).item().exp())


@pytest.mark.parametrize("order", [2, 3, 6])
def test_values_and_slopes_of_a_gap_contain_those_of_the_solution(order):
    gap, end = _gap(exponential_step(order), balls([1, 0]), balls([0.5]).item()), balls([WIDTH]).item()
    value, slope = gap.at(end)
    exact, p = end.exp(), order + 1
    assert value.contains(exact - 0.5) and slope.contains(exact) and gap.curvature(end).contains(exact)
    # Lagrange's remainder and its derivatives, e^s s^k / k! at the end of the step
    for ball, k in ((value, p), (slope, p - 1), (gap.curvature(end), p - 2)):
        assert float(ball.rad()) == pytest.approx(math.exp(WIDTH) * WIDTH**k / math.factorial(k), rel=1e-6)


@pytest.mark.parametrize("lowest", [-0.01, 0.01])
@pytest.mark.parametrize(("slope", "curvature"), [(0.0, -2.0), (0.7, -2.0), (-0.7, -2.0), (-0.7, 0.0), (0.7, 1.5)])
def test_a_parabola_is_proved_where_it_is_positive_and_only_there(slope, curvature, lowest):
    """h = value + slope s + curvature s^2 / 2 on [-R, R], of a lowest value just above or below zero."""
    from flint import arb

    R = 0.5
    value = lowest + abs(slope) * R + max(-curvature, 0.0) * R**2 / 2
    proved = _is_positive(arb(value), arb(slope), arb(curvature), arb(0, R), 0, 0)
    assert proved == (lowest > 0)


@pytest.mark.parametrize("shift", [-0.01, 0.01])
@pytest.mark.parametrize("side", [1, -1])
def test_an_interval_next_to_a_switch_needs_a_slope_of_one_sign(side, shift):
    """h' = slope + curvature s is between -0.01 and more, or positive, on [-R, R]; mirrored before a switch."""
    from flint import arb

    R, curvature = 0.5, -2.0
    slope = side * (shift - curvature * R)
    ends = (SINGLE, 0) if side > 0 else (0, SINGLE)
    assert _is_positive(arb(0), arb(slope), arb(curvature), arb(0, R), *ends) == (shift > 0)


@pytest.mark.parametrize(("level", "proved"), [(-1e-6, True), (1e-6, False)])
def test_a_gap_that_comes_close_to_its_breakpoint_inside_of_a_step(level, proved):
    """h = cosh(s - 1/2) - 1 - level: the lowest value -level lies at s = 1/2."""
    flow, middle = BallFlow(1, balls([[0, 1], [1, 0]]), zeros(2, 2), ()), balls([0.5]).item()
    y = matrix(np.array([[middle.cosh()], [-middle.sinh()]], dtype=object))
    (step,) = taylor_steps(flow, balls([0]).item(), balls([WIDTH]).item(), y, 22)
    place = _unproved(_gap(step, balls([1, 0]), balls([1]).item() + balls([level]).item()), step.h, 0, 0)
    assert (place is None) == proved
    if not proved:
        assert abs(place - 0.5) < 2e-3
