"""Errors of measures along a curve: stated against true ones, from eight times the harmonics."""

from dataclasses import replace

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.curve.refinement import shortest_step
from hbgear.continuation.problem.evaluation import Evaluation

MODELS = {
    "spur": (hb.SpurPair(), (1.0, 0.6), 8),
    "helical": (hb.gears.DoubleHelicalPair(zeta=0.05), (1.0, 0.8), 8),
    "duffing": (hb.Duffing(), (0.8, 1.6), 3),
}


@pytest.fixture(scope="module", params=MODELS)
def pair(request):
    """A curve of few harmonics, and its rows with eight times as many."""
    model, span, H = MODELS[request.param]
    curve = hb.trace(hb.HarmonicBalance(model, H), "Omega", span, accuracy=None)
    return curve, curve.refined().refined().refined()


@pytest.mark.parametrize("measure", ["rms", "pp2", "max", "mean", "H1", "H3"])
def test_errors_of_measures(pair, measure):
    """Below three times the stated one in 95 of 100 rows, and not far too large."""
    curve, fine = pair
    true = np.abs(fine.amplitude(measure) - curve.amplitude(measure))
    stated = curve.amplitude_error(measure)
    assert np.isfinite(true).all()
    some = true > 1e-10  # of the others only rounding is left, as of the mean of a symmetric oscillator
    if not some.any():
        assert measure == "mean" and stated.max() < 1e-10
        return
    ratio = true[some] / stated[some]
    assert some.sum() > 50 and np.mean(ratio < 3) >= 0.95 and 0.5 < np.median(ratio) < 1.5


def test_a_refined_curve_solves_its_equations(pair):
    curve, fine = pair
    assert fine.layout.harmonics == 8 * curve.layout.harmonics and len(fine) == len(curve)
    for i in range(0, len(fine), 17):
        R, _ = fine.problem.evaluate(fine.X[i], **fine.parameters_at(i))
        assert np.abs(R).max() < 1e-9
        np.testing.assert_array_equal(fine.regime[i], fine.problem.regime(fine.X[i], **fine.parameters_at(i)))
    moved = np.abs(fine.values - curve.values)
    rough = curve.error > 1e-10
    assert 0 < moved.max() < 1e-4 and (fine.error[rough] < curve.error[rough]).all()
    assert fine.special == curve.special and fine.multipliers.shape == curve.multipliers.shape


def test_motions_that_cannot_be_refined(pair, tmp_path):
    curve, _ = pair
    curve.save(tmp_path / "curve.npz")
    lost = replace(hb.load(tmp_path / "curve.npz"), problem=None)
    with pytest.raises(ValueError, match="this one does not have its problem"):
        lost.refined()
    many = hb.trace(hb.HarmonicBalance(hb.Duffing(), 300), "Omega", (0.8, 0.81), steps=hb.StepControl(max_points=2))
    with pytest.raises(ValueError, match="has the largest number of harmonics already"):
        many.amplitude_error()
    if curve.problem.model == hb.SpurPair():
        with pytest.raises(ValueError, match="a curve of special points is not refined"):
            hb.follow(curve, "LP1", "zeta", (0.05, 0.051)).refined()


@pytest.mark.parametrize("distance", [1.0, 1e-3, 1e-6, 1e-9, 1e-15, 0.0])
def test_the_shortest_step_is_the_solution_of_least_norm(rng, distance):
    """At a regular point, and at any distance from a fold, at which the smallest singular value vanishes."""
    (U, _), (V, _) = (np.linalg.qr(A) for A in rng.standard_normal((2, 30, 30)))
    J = (U * np.append(np.linspace(1.0, 5.0, 29), distance)) @ V.T
    p, R, scale = *rng.standard_normal((2, 30)), rng.uniform(0.1, 3.0, 31)
    expected = scale * np.linalg.lstsq(np.column_stack([J, p]) * scale, -R)[0]
    step = shortest_step(Evaluation(R, J, p, 1.0), R, scale)
    np.testing.assert_allclose(step, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
