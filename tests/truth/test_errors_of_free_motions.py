"""Stated errors of frequencies that are unknown with a motion: closed forms, and eight times the harmonics."""

import math

import numpy as np
import pytest
from machines import VanDerPol, single_mass
from scipy.optimize import brentq

import hbgear as hb
from hbgear.analysis.summary import reliability_lines
from hbgear.continuation.results.concatenation import concatenate
from hbgear.continuation.solvers.newton import solve


def with_stop(k: float) -> hb.System:
    return single_mass(hb.Unilateral(k, 1.0), c=None, name="stop")


def exact_motion_with_stop(k: float, A: float) -> tuple[float, float]:
    """Return frequency and rms of x'' + x + k max(x - 1, 0) = 0 with the least displacement -A < -1."""
    w, v = math.sqrt(1 + k), math.sqrt(A**2 - 1)
    centre = k / (1 + k)
    free, closed = math.pi / 2 + math.asin(1 / A), math.atan2(v / w, 1 - centre) / w
    weights = np.polynomial.legendre.leggauss(60)
    t, dt = (weights[0] + 1) / 2, weights[1] / 2
    x = -A * np.cos(free * t), centre + (1 - centre) * np.cos(w * closed * t) + v / w * np.sin(w * closed * t)
    mean, square = ((free * dt @ x[0] ** n + closed * dt @ x[1] ** n) / (free + closed) for n in (1, 2))
    return math.pi / (free + closed), math.sqrt(square - mean**2)


def exact_frequency(k: float, rms: float) -> float:
    if rms <= 1 / math.sqrt(2):
        return 1.0
    A = brentq(lambda A: exact_motion_with_stop(k, A)[1] - rms, 1.0, 10 * rms, xtol=1e-14)
    return exact_motion_with_stop(k, A)[0]


@pytest.mark.parametrize(("k", "harmonics"), [(1.0, 4), (1.0, 8), (10.0, 8), (10.0, 16), (100.0, 16), (100.0, 32)])
def test_the_error_of_the_frequency_of_a_stop_agrees_with_the_closed_form(k, harmonics):
    """No error was stated."""
    curve = hb.analysis.backbone(with_stop(k), span=(0.5, 2.0), harmonics=harmonics)
    exact = np.array([exact_frequency(k, rms) for rms in curve.values.tolist()])
    error = np.abs(curve.tracked["Omega"] / exact - 1).max()
    assert error / 3 < curve.unknown_errors["Omega"] < 3 * error
    assert f"Omega {curve.unknown_errors['Omega']:.0e}" in reliability_lines(curve)[0]


def errors_against(curve: hb.Branch, finer: hb.Branch, interval: int) -> tuple[float, dict[str, float]]:
    """Return the largest errors of motions (rms) and of unknown parameters, with the harmonics of a finer curve."""
    count, motions, unknown = len(curve.unknown_errors), [], []
    for i in range(0, len(curve), interval):
        X = finer.problem.resized(curve.problem.join(curve[i].X, curve[i].parameters))
        known = {name: x for name, x in curve.parameters_at(i).items() if name not in curve.unknown_errors}
        exact = solve(finer.problem.with_borders_at(X, known, renew=True), X, known).X
        motions.append(np.linalg.norm((X - exact)[:-count]) / math.sqrt(2))
        unknown.append(np.abs((X - exact)[-count:] / exact[-count:]))
    names = finer.problem.unknown_parameters[::-1]  # the last unknown first
    return max(motions), dict(zip(names, np.max(unknown, axis=0).tolist(), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("harmonics", [16, 32])
def test_the_frequency_of_a_stiff_slider_is_less_accurate_than_its_motion(harmonics):
    """With 16 harmonics Omega is 6 % off, and the motion of given amplitude 0.6 %."""
    model = single_mass(hb.mechanics.Jenkins(176.0, 1.0), c=None, name="slider")
    curve = hb.analysis.backbone(model, span=(0.05, 0.5), harmonics=harmonics)
    motion, unknown = errors_against(curve, hb.analysis.backbone(model, span=(0.05, 0.5), harmonics=8 * harmonics), 1)
    assert motion / 3 < curve.error.max() < 3 * motion
    for name, error in unknown.items():
        assert error / 3 < curve.unknown_errors[name] < 3 * error, name
    warnings = [text for text in curve.warnings if text.startswith("the relative error of Omega")]
    assert bool(warnings) == (curve.unknown_errors["Omega"] > 1e-2)


@hb.mechanics.model
def self_excited(damping: float = 0.0) -> hb.System:
    stop = hb.Element([1.0], hb.Unilateral(50.0, 1.5), name="stop")
    return hb.System([[1.0]], [[damping]], [[1.0]], [hb.Element([1.0], VanDerPol(1.0), name="source"), stop])


@pytest.mark.slow
def test_the_error_of_the_frequency_of_limit_cycles(tmp_path):
    """It is in the file, and in the two parts of a curve that are joined."""
    (hopf,) = hb.analysis.hopf_points(self_excited(), "damping", (2.0, -1.0))
    curve, finer = (
        hb.analysis.limit_cycles(self_excited(), hopf, (0.0, 2.0), harmonics=H, stability=False) for H in (16, 128)
    )
    motion, unknown = errors_against(curve, finer, 4)
    assert motion / 3 < curve.error.max() < 3 * motion
    assert unknown["Omega"] / 3 < curve.unknown_errors["Omega"] < 3 * unknown["Omega"]
    hb.save(curve, tmp_path / "cycles.npz")
    assert hb.load(tmp_path / "cycles.npz").unknown_errors == curve.unknown_errors
    for first, second in ((curve, finer), (finer, curve)):
        assert concatenate(first, second).unknown_errors == curve.unknown_errors
