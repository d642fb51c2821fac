"""Going on from where a trace ended: the same curve as that of one trace."""

import dataclasses

import numpy as np
import pytest

import hbgear as hb
from hbgear import HarmonicBalance, StepControl, extend, trace
from hbgear.continuation import FoldProblem

LABELS = ["GR1", "LP1", "LP2", "GR2"]


@pytest.fixture(scope="module")
def problem():
    return HarmonicBalance(hb.SpurPair(), 12)


@pytest.fixture(scope="module")
def whole(problem):
    return trace(problem, "Omega", (1.5, 0.6))


def assert_same(curve, whole, tolerance=1e-9):
    """Special points and jumps of one are those of the other."""
    assert [p.label for p in curve.special] == [p.label for p in whole.special]
    for a, b in zip(curve.special, whole.special, strict=True):
        assert a.parameters["Omega"] == pytest.approx(b.parameters["Omega"], abs=tolerance)
        assert curve.values[a.index] == a.parameters["Omega"]
    assert [(j.label, j.direction) for j in curve.jumps()] == [(j.label, j.direction) for j in whole.jumps()]
    assert curve.status is whole.status and curve.values[-1] == whole.values[-1]


def test_stopped_anywhere_and_gone_on_is_the_whole_curve(problem, whole):
    assert [p.label for p in whole.special] == LABELS and whole.jumps()
    turn = whole["LP1"].index
    for count in (3, turn - 1, turn, turn + 1, turn + 2, turn + 3, len(whole) - 5):
        part = trace(problem, "Omega", (1.5, 0.6), steps=StepControl(max_points=count))
        assert "hb.extend(curve)" in part.message and "hbgear extend FILE" in part.message
        curve = extend(part)
        assert_same(curve, whole)
        assert np.array_equal(curve.X[: len(part)], part.X) and len(set(map(tuple, curve.X))) == len(curve)


def test_further_than_the_span_was(problem, whole):
    short = trace(problem, "Omega", (1.5, 1.0))
    with pytest.raises(ValueError, match=r"ends at Omega = 1, where it leaves the span; give a longer"):
        extend(short)
    assert_same(extend(short, (1.5, 0.6)), whole)


def test_from_a_file_with_more_harmonics(problem, whole, tmp_path):
    trace(problem, "Omega", (1.5, 0.6), steps=StepControl(max_points=30)).save(tmp_path / "part.npz")
    part = hb.load(tmp_path / "part.npz")
    assert_same(extend(part), whole)
    with pytest.raises(ValueError, match="needs the problem"):
        extend(dataclasses.replace(part, meta={}, problem=None))
    curve = extend(part, problem=HarmonicBalance(hb.SpurPair(), 20))
    assert curve.layout.harmonics == 20 and curve.problem.H == 20
    np.testing.assert_allclose(curve.amplitude("rms")[: len(part)], part.amplitude("rms"), rtol=1e-14)
    assert_same(curve, trace(curve.problem, "Omega", (1.5, 0.6)), 1e-4)


def test_a_fold_curve_of_an_earlier_version_is_loaded_and_goes_on(problem, whole, tmp_path):
    """Its header names the class Fold, which is FoldProblem now."""
    equations = FoldProblem(problem)
    part = trace(equations, "zeta", (0.05, 0.2), start=whole["LP1"], steps=StepControl(max_points=4))
    dataclasses.replace(part, meta={**part.meta, "curve": {"of": "Fold", "in": "Omega"}}).save(tmp_path / "fold.npz")
    loaded = hb.load(tmp_path / "fold.npz")
    assert loaded.meta["curve"] == {"of": "Fold", "in": "Omega"} and np.array_equal(loaded.X, part.X)
    assert loaded.tracked.keys() == {"Omega"} and loaded.parameter == "zeta"
    assert extend(loaded, problem=equations)["CP1"].parameters["zeta"] > 0.1


@pytest.mark.slow
def test_a_fold_curve_goes_on_too(problem, whole):
    options = {"start": whole["LP1"]}
    fold = trace(FoldProblem(problem), "zeta", (0.05, 0.2), **options)
    part = trace(FoldProblem(problem), "zeta", (0.05, 0.2), steps=StepControl(max_points=4), **options)
    curve = extend(part)
    assert len(part) == 4 and [p.label for p in curve.special] == [p.label for p in fold.special] == ["CP1"]
    assert curve["CP1"].parameters["zeta"] == pytest.approx(fold["CP1"].parameters["zeta"], abs=1e-8)
    assert len(curve.tracked["Omega"]) == len(curve)


@pytest.mark.slow
def test_a_fold_curve_begins_and_goes_on_with_other_harmonics(problem, whole):
    finer = HarmonicBalance(hb.SpurPair(), 16)
    begun = trace(FoldProblem(finer), "zeta", (0.05, 0.2), start=whole["LP1"])
    assert begun.layout.harmonics == 16
    part = trace(FoldProblem(problem), "zeta", (0.05, 0.2), start=whole["LP1"], steps=StepControl(max_points=4))
    for curve in (
        extend(part, problem=FoldProblem(finer)),
        extend(dataclasses.replace(part, problem=None), problem=begun.problem),
    ):
        assert curve.layout.harmonics == 16 and curve.X.shape[1] == finer.size == len(curve["CP1"].X)
        np.testing.assert_allclose(curve.amplitude("rms")[:4], part.amplitude("rms"), rtol=1e-14)
        assert curve["CP1"].parameters["zeta"] == pytest.approx(begun["CP1"].parameters["zeta"], abs=1e-8)


def test_curves_that_cannot_be_extended(problem, whole):
    with pytest.raises(TypeError, match=r"extend\(branch\) needs a Branch"):
        extend(problem)
    with pytest.raises(ValueError, match="nothing to extend"):
        extend(dataclasses.replace(whole, status="closed"))
    one = trace(problem, "Omega", (1.5, 0.6), steps=StepControl(max_points=2))
    assert_same(extend(one), whole)
