"""The study of designs in lock step: its batch against single problems, its estimate, its quick form."""

import importlib
from pathlib import Path

import matplotlib
import matplotlib.pyplot
import numpy as np
import pytest

import hbgear as hb

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def modules():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2]))
        yield importlib.import_module("studies.speed.batched"), importlib.import_module("studies.speed.lockstep")


def singles(problems, X, Omega):
    pairs = zip(problems, X, Omega.tolist(), strict=True)
    return [problem.linearise(x, "Omega", Omega=w) for problem, x, w in pairs]


@pytest.mark.parametrize("case", range(3))
def test_batch_is_every_problem_by_itself(modules, case):
    """R, dR/dX, dR/dOmega and sizes on rows of a curve, disturbed so that they are no solutions."""
    batched, study = modules
    name = list(study.CASES)[case]
    model, H, _ = study.CASES[name]
    curve = hb.trace(hb.HarmonicBalance(model, H), "Omega", model.default_span, stability=False, special=False)
    rng = np.random.default_rng(3)
    rows = rng.integers(0, len(curve), 12)
    X = curve.X[rows] * (1 + 1e-2 * rng.standard_normal((12, curve.X.shape[1])))
    problems = [hb.HarmonicBalance(one, H) for one in study.designs(name, 12)]
    now = batched.Batch(problems).linearise(X, curve.values[rows])
    for i, one in enumerate(singles(problems, X, curve.values[rows])):
        assert np.abs(now.R[i] - one.R).max() < 1e-13 * one.size
        assert now.dR_dX[i] == pytest.approx(one.dR_dX, abs=1e-13 * np.abs(one.dR_dX).max())
        assert now.dR_dp[i] == pytest.approx(one.dR_dp, abs=1e-13 * np.abs(one.dR_dp).max())
        assert now.size[i] == pytest.approx(one.size, rel=1e-13)


def test_batch_refuses_what_it_cannot_hold(modules):
    batched, _ = modules
    with pytest.raises(ValueError, match="differ in harmonics"):
        batched.Batch([hb.HarmonicBalance(hb.Duffing(), H) for H in (5, 7)])
    with pytest.raises(ValueError, match="piecewise linear or all cubic"):
        batched.Batch([hb.HarmonicBalance(hb.Duffing()), hb.HarmonicBalance(hb.SpurPair())])


def test_estimate(modules):
    """Steps of 0.9 of the time, nine times faster: 0.1 + 0.1 are left; half of the time for nothing: twice as fast."""
    _, study = modules
    assert study.gain(1.0, 0.9, 9.0) == pytest.approx(5.0)
    assert study.gain(3.0, 1.5, np.inf) == pytest.approx(2.0)
    assert study.gain(1.0, 1.1, 4.0) == pytest.approx(4.0) and study.gain(1.0, 1.1, np.inf) == np.inf


def test_quick_form(modules):
    _, study = modules
    rows = study.run(quick=True)
    assert [row["name"] for row in rows] == ["spur pair, $H = 10$"]
    assert set(rows[0]["gains"]) == {1, 8, 32} and min(rows[0]["gains"].values()) > 0
    assert all(0 < found["gain"] <= found["most"] for found in rows[0]["tasks"].values())
    text = study.report(rows)
    assert "| spur pair, H = 10: peak and jumps |" in text and "needed 3" in text
    figure = study.plot(rows)
    assert all(ax.get_ylabel() for ax in figure.axes)
    matplotlib.pyplot.close(figure)
