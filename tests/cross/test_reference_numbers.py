"""Numbers computed independently of this project: harmonic balance with many harmonics, checked by shooting.

Duffing: x'' + 2 * 0.05 x' + x + 0.1 x^3 = 0.18 cos(Omega t), 60 harmonics. The double-helical pair in the reading of
its documentation. The spur pair's numbers are with the published cases.
"""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from hbgear import Duffing, HarmonicBalance, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.gears import DoubleHelicalPair
from hbgear.mechanics.series.fourier import extrema

DUFFING_FOLDS = (1.1033778377325, 1.1001550351366)
DUFFING_PEAK = {"max": 1.65351716694, "Omega": 1.0947673094, "H1": 1.6416564777}
PAIR_PEAK = {"pp2": 0.5894, "Omega": 0.896, "rms at 0.9": 0.4138}
PAIR_FOLDS = (0.84537, 0.86870)  # zeta = 0.05


def folds(curve):
    return [p.parameters["Omega"] for p in curve.special if p.kind == "LP"]


def refined_peak(problem, near, measure, reach):
    """(Omega, X) where a measure of the motion is highest, by solving at fixed Omega around a row."""

    def X_at(Omega):
        return solve(problem, near.X, {"Omega": Omega}).X

    Omega = near.parameters["Omega"]
    found = minimize_scalar(
        lambda w: -measure(X_at(w)), bounds=(Omega - reach, Omega + reach), method="bounded", options={"xatol": 1e-9}
    )
    return found.x, X_at(found.x)


def half_peak_to_peak(X):
    low, _, high, _ = extrema(X.reshape(2, -1))
    return float((high - low).max() / 2)


@pytest.mark.parametrize(("H", "tolerance"), [(7, 1e-6), (25, 1e-12)])
def test_duffing_folds(H, tolerance):
    curve = trace(HarmonicBalance(Duffing(), H), "Omega", (0.5, 1.6))
    assert [p.label for p in curve.special] == ["LP1", "LP2"]
    np.testing.assert_allclose(folds(curve), DUFFING_FOLDS, atol=tolerance, rtol=0)


@pytest.mark.parametrize(("H", "tolerance"), [(7, 1e-5), (25, 2e-10)])
def test_duffing_peak(H, tolerance):
    problem = HarmonicBalance(Duffing(), H)
    near = trace(problem, "Omega", (0.5, 1.6), stability=False).peak("max")

    def highest(X):
        low, _, high, _ = extrema(X)
        return max(float(high), -float(low))

    Omega, X = refined_peak(problem, near, highest, 0.004)
    assert highest(X) == pytest.approx(DUFFING_PEAK["max"], abs=tolerance)
    # an extremum is found to the square root of what its value is
    assert Omega == pytest.approx(DUFFING_PEAK["Omega"], abs=1e-5)
    assert np.hypot(X[1], X[2]) == pytest.approx(DUFFING_PEAK["H1"], abs=1e-5)


@pytest.fixture(scope="module")
def pair_curve():
    return trace(HarmonicBalance(DoubleHelicalPair(), 16), "Omega", (1.6, 0.2))


def test_double_helical_pair_has_no_fold(pair_curve):
    assert pair_curve.status == "reached_end"
    assert folds(pair_curve) == []
    assert pair_curve.regime.max() == 1


def test_double_helical_peak(pair_curve):
    Omega, X = refined_peak(pair_curve.problem, pair_curve.peak("pp2"), half_peak_to_peak, 0.003)
    assert half_peak_to_peak(X) == pytest.approx(PAIR_PEAK["pp2"], abs=5e-4)
    assert Omega == pytest.approx(PAIR_PEAK["Omega"], abs=1.5e-3)


def test_double_helical_amplitude_near_the_peak(pair_curve):
    i = int(np.argmin(np.abs(pair_curve.values - 0.9)))
    X = solve(pair_curve.problem, pair_curve.X[i], {"Omega": 0.9}).X
    rms = np.sqrt(0.5 * (X.reshape(2, -1)[:, 1:] ** 2).sum(-1))
    np.testing.assert_allclose(rms, PAIR_PEAK["rms at 0.9"], atol=1e-4, rtol=0)


@pytest.mark.parametrize(
    "settings",
    [{"harmonics": 12, "samples": 4096, "sampled": True}, {"harmonics": 12}, {"harmonics": 30}],
    ids=["sampled", "exact", "exact, many harmonics"],
)
def test_double_helical_folds(settings):
    curve = trace(HarmonicBalance(DoubleHelicalPair(zeta=0.05), **settings), "Omega", (1.0, 0.8), stability=False)
    np.testing.assert_allclose(folds(curve), PAIR_FOLDS, atol=1e-4, rtol=0)
