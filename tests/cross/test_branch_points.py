"""Equations of branch points against finite differences, shooting and more harmonics, and in a second parameter."""

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.time.integration import state_of

STATED = 3.0  # largest ratio of the true to the stated error


def spring(zeta=0.05):
    """A hardening spring at large amplitudes, where the symmetric motion has a branch point."""
    return hb.Duffing(zeta=zeta, k3=1.0, F=20.0)


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(spring(), 9), "Omega", (1.0, 1.4))


def test_the_equations_are_differentiated_exactly(curve):
    point, problem = curve["BP1"], curve.problem
    U = np.append(curve.X[point.index], curve.values[point.index])
    equations = hb.continuation.BranchPointProblem(problem, "Omega").with_borders_at(U, {"zeta": 0.05})
    assert np.abs(equations.linearise(U, "", zeta=0.05).R).max() < 1e-10
    random = np.random.default_rng(1)
    at, step = U + 1e-2 * random.normal(size=len(U)), 1e-5 * random.normal(size=len(U))
    now = equations.linearise(at, "zeta", zeta=0.05)
    up, down = (equations.linearise(at + sign * step, "", zeta=0.05).R for sign in (1, -1))
    assert (up - down) / 2 == pytest.approx(now.dR_dX @ step, rel=1e-6, abs=1e-12)
    up, down = (equations.linearise(at, "", zeta=0.05 + sign * 1e-5).R for sign in (1, -1))
    assert (up - down) / 2e-5 == pytest.approx(now.dR_dp, rel=1e-6, abs=1e-7)


@pytest.mark.slow
def test_a_multiplier_of_the_shot_motion_is_one(curve):
    """The motion is symmetric, x(t + T/2) = -x(t), so that the point is not a fold."""
    point = curve["BP1"]
    Omega = point.parameters["Omega"]
    problem = curve.problem.at_resolution_of(point).with_order(1, 45)
    orbit = hb.time.shoot(spring(), Omega, state_of(problem, problem.from_point(point), Omega=Omega))
    assert np.abs(orbit.multipliers - 1).min() < 1e-3  # square root of the error of Omega, which is 3e-6
    assert abs(point.amplitude("mean")) < 1e-10 < abs(point.amplitude("rms"))


def test_stated_errors_and_the_second_parameter(curve):
    """Compared with four times the harmonics, and with a curve traced at another damping ratio."""
    places = {}
    for zeta in (0.05, 0.06):
        fine = hb.trace(hb.HarmonicBalance(spring(zeta), 36), "Omega", (1.0, 1.4), accuracy=None, stability=False)
        places[zeta] = fine["BP1"].parameters["Omega"]
    point = curve["BP1"]
    assert abs(point.parameters["Omega"] - places[0.05]) < STATED * point.error < 3e-5
    assert abs(point.parameters["Omega"] - places[0.05]) > 0.1 * point.error
    held = hb.follow(curve, "BP1", "zeta", (0.05, 0.06))
    assert held.status is hb.Status.REACHED_END
    assert held.tracked["Omega"][-1] == pytest.approx(places[0.06], abs=1e-4)
    assert abs(held.tracked["Omega"][-1] - held.tracked["Omega"][0]) > 3e-3
    slope = hb.analysis.sensitivity(point, ["zeta"]).slopes[0, 0]
    near = hb.follow(curve, "BP1", "zeta", (0.05, 0.0501))
    change = (near.tracked["Omega"][-1] - near.tracked["Omega"][0]) / 1e-4
    assert slope == pytest.approx(change, rel=1e-2)


def test_curves_that_do_not_cross_have_none():
    """A mean load breaks the symmetry: the crossing becomes a fold and a separate branch."""
    bent = single_mass(hb.Cubic(k3=1.0), F=20.0, mean=0.05)
    curve = hb.trace(hb.HarmonicBalance(bent, 9), "Omega", (1.0, 1.4))
    assert "BP" not in {point.kind for point in curve.special}


def test_two_branch_points_in_a_long_step_are_located():
    """The symmetric motion between two stops is unstable in a range between two stable points of the curve."""
    stop = hb.Unilateral(k=0.8, gap=0.06)
    elements = [hb.Element([1.0], stop, name="right"), hb.Element([-1.0], stop, name="left")]
    model = hb.System([[1.0]], [[0.0655]], [[0.5]], elements, hb.Load(cosine={1: [0.325]}))
    curve = hb.trace(hb.HarmonicBalance(model, 48), "Omega", (0.456, 1.73))
    exact = hb.trace(hb.ContactInstants(model), "Omega", (0.5, 0.6))
    for label in ("BP1", "BP2"):
        assert abs(curve[label].parameters["Omega"] - exact[label].parameters["Omega"]) < STATED * curve[label].error
    between = (curve.values > curve["BP1"].parameters["Omega"]) & (curve.values < curve["BP2"].parameters["Omega"])
    assert between.any() and not curve.stable[between].any()


@pytest.mark.slow
def test_a_fold_next_to_a_branch_point():
    """The branch point is 7e-6 above the fold, and dR/dX is singular at both."""
    K, damping = np.array([[1.3, 0.3], [0.3, 1.3]]), 0.050292591836367084
    backlash = hb.Backlash(b=0.34996675113574505, k=11.040666286043532)
    elements = [hb.Element([1.0, 0.0], backlash, name="a"), hb.Element([0.0, 1.0], backlash, name="b")]
    force = hb.Load(cosine={1: [0.08543560352722451, 0.08543560352722451]})
    model = hb.System(np.eye(2), 2 * damping * K + 0.01 * np.eye(2), K, elements, force)
    span = (0.8859088066879133, 1.3706221119584108)
    curve = hb.trace(hb.HarmonicBalance(model, 64), "Omega", span)
    exact = hb.trace(hb.ContactInstants(model), "Omega", span)
    assert [point.label for point in curve.special] == [point.label for point in exact.special]
    for point, reference in zip(curve.special, exact.special, strict=True):
        assert abs(point.parameters["Omega"] - reference.parameters["Omega"]) < max(STATED * point.error, 1e-7)
