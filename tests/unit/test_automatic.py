"""Automatic harmonics: every point of a curve keeps to the tolerance, and where that cannot be, it is said."""

import numpy as np
import pytest

import hbgear as hb


def traced(model, tolerance, *span):
    return hb.trace(hb.HarmonicBalance(model, "auto", tolerance=tolerance), "Omega", span)


@pytest.mark.parametrize("tolerance", np.geomspace(1e-4, 1e-7, 16)[[8, 11, 15]].tolist())
def test_special_points_keep_to_the_tolerance(tolerance):
    curve = traced(hb.SpurPair(e=(0.1,)), tolerance, 2.1, 0.6)
    assert curve.status.complete and [p.kind for p in curve.special].count("PD") == 2
    assert curve.error.max() <= tolerance and max(p.truncation for p in curve.special) <= tolerance
    fine = hb.trace(hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 100), "Omega", (2.1, 0.6))
    for label in ("PD1", "PD2"):
        assert curve[label].parameters["Omega"] == pytest.approx(fine[label].parameters["Omega"], abs=100 * tolerance)


@pytest.mark.parametrize(("tolerance", "end"), [(1e-4, 0.817), (1e-4, 0.6192), (1e-6, 1.1574), (1e-6, 0.8625)])
def test_the_end_keeps_to_the_tolerance(tolerance, end):
    curve = traced(hb.SpurPair(e=(0.1,)), tolerance, 1.9, end)
    assert curve.values[-1] == end and curve.error.max() <= tolerance


@pytest.mark.slow
def test_a_tolerance_that_is_missed_is_reported():
    with pytest.warns(
        hb.mechanics.ImplausibleInputWarning,
        match=r"up to H = 400, leave (a point|\d+ points) of the curve with an estimated error above",
    ):
        curve = traced(hb.SpurPair(e=(0.1,)), 1e-11, 1.0, 0.97)
    assert curve.status.complete and curve.error.max() > 1e-11


@pytest.mark.parametrize("begin", [0.41, 0.62, 2.3])
def test_a_curve_begins_at_its_span(begin):
    """The first point gets more harmonics at its Omega, not in the plane across the curve."""
    model = hb.SpurPair(stiffness=hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.3))
    problem = hb.HarmonicBalance(model, "auto")
    curve = hb.trace(problem, "Omega", (begin, 1.0), cover=False, steps=hb.StepControl(max_points=3))
    assert curve.values[0] == begin and curve.problem.H > problem.H
