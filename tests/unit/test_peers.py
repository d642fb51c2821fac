"""The benchmark against other packages, run with hbgear only and without a network: correct folds and peaks."""

import importlib
import sys

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")
pytestmark = pytest.mark.usefixtures("on_path")


@pytest.fixture
def peers():
    return importlib.import_module("studies.speed.peers")


def test_quick_form(peers, tmp_path):
    rows = peers.run(quick=True)
    assert [row["tool"] for row in rows] == ["hbgear", "hbgear, stability"] * 3
    duffing, spur = rows[1], rows[3]
    assert sorted(duffing["folds"]) == pytest.approx([1.1001550351366, 1.1033778377325], abs=1e-4)
    assert sorted(spur["folds"]) == pytest.approx([0.7080316187, 0.8284639844], abs=1e-4)
    assert duffing["peak"] == pytest.approx(1.65351716694, rel=2e-4)
    assert spur["peak"] == pytest.approx(1.36550347, rel=2e-4)
    text = peers.report([*rows, {"problem": "spur", "tool": "mousai", "failure": "not done in 60 s"}])
    assert "| spur pair | mousai | not done in 60 s |" in text and "| Duffing | hbgear, stability |" in text
    figure = peers.plot(rows)
    assert figure.axes[0].get_yscale() == "log" and "[ms]" in figure.axes[0].get_ylabel()
    figure.savefig(tmp_path / "peers.png")
    matplotlib.pyplot.close(figure)


def test_curves_are_judged_by_the_equation_of_motion():
    """A linear chain in closed form has a residual below 1e-13, a wrong one fails; a parabola has the exact vertex."""
    curve = importlib.import_module("studies.speed.peers_curve")
    given = curve.problem("chain3")
    given = type(given)(**{**given.__dict__, "k": 0.0})
    Omega = np.linspace(*given.span, 5)
    Q = np.zeros((5, 3, given.harmonics + 1), complex)
    for row, w in zip(Q, Omega, strict=True):
        row[:, 1] = np.linalg.solve(given.K + 1j * w * given.C - w**2 * given.M, [given.cosine, 0, 0])
    found = curve.judged(given, (Omega, Q), 1.0)
    assert found["residual"] < 1e-13 and found["points"] == 5
    Q[2, 1, 1] += 1.0
    assert curve.judged(given, (Omega, Q), 1.0)["failed"] == 1
    assert curve.vertex(np.array([0.0, 3.0, 3.0]), 1) == pytest.approx(3.375)
    with pytest.raises(ValueError, match="no problem 'gear'"):
        curve.problem("gear")


def test_the_residual_of_a_nonlinear_motion():
    """The benchmark computes a residual below 1e-8 for a motion of the Duffing oscillator from hbgear."""
    hb, curve = importlib.import_module("hbgear"), importlib.import_module("studies.speed.peers_curve")
    branch = hb.trace(hb.HarmonicBalance(hb.Duffing(), 7), "Omega", (0.9, 1.2), stability=False)
    given, X = curve.problem("duffing"), branch[3].X
    Q = np.concatenate([X[:1], X[1::2] - 1j * X[2::2]])[None]
    assert curve.residual(given, branch.values[3], Q) < 1e-8
    assert curve.residual(given, branch.values[3], 1.01 * Q) > 1e-3


def test_a_package_that_fails_gives_the_reason(peers, monkeypatch):
    monkeypatch.setattr(peers, "environment", lambda package: sys.executable)
    assert "No module named 'mousai'" in peers.theirs("duffing", "mousai")["failure"]


def test_against_the_previous_fastest_code(peers):
    """The speeds of two computers are compared by pyHarm: if it takes twice as long here, so does the fastest code."""
    rows = [
        {"problem": "duffing", "tool": tool, "seconds": ms / 10, "points": 100, "residual": 0.0, "folds": []}
        for tool, ms in (("hbgear, stability", 0.5), ("pyHarm", 2.2))
    ]
    line = next(text for text in peers.against_before(rows) if text.startswith("| Duffing"))
    assert line == "| Duffing | 4 | 2.00 | 1.68 | 3.4 |"
    rows[1] = {"problem": "duffing", "tool": "pyHarm", "failure": "not done in 60 s"}
    assert f"| > {peers.LIMIT / 0.05:.0f} |" in peers.against_before(rows)[2]  # a lower bound from the time limit


def test_profile(tmp_path):
    profile = importlib.import_module("studies.speed.profile")
    rows = profile.run(quick=True)
    for row in rows:
        assert row["points"] > 50 and 0.9 < row["newton"] < 2.0 and row["lu"] > 0
        assert set(row["parts"]) == set(profile.PARTS) and all(part >= 0 for part in row["parts"].values())
        assert row["whole"] <= sum(row["parts"].values()) * (1 + 1e-12)
    assert "whole / LU alone" in profile.report(rows)
    figure = profile.plot(rows)
    figure.savefig(tmp_path / "profile.png")
    matplotlib.pyplot.close(figure)
