"""Two masses and a stop: all folds, period doublings and Neimark-Sacker points, and no spurious ones.

    q'' + 0.03 A q' + A q + (p(q_1), 0) = (0, 0.1 cos(Omega t)),   A = [[1, -1], [-1, 2]],   p = 100 max(q_1 - 1, 0)

from Omega = 0.8 to 0.5. Sampled forces give hundreds of spurious folds. The stop is stiff, so that harmonics decay
slowly; a fold lies 6e-9 from a grazing contact.
"""

import numpy as np
import pytest
from cross.shooting import integrate
from cross.shooting_branch import shot

from hbgear import Element, HarmonicBalance, Load, StepControl, System, Unilateral, trace
from hbgear.continuation import FoldProblem
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic import PeriodDoublingProblem
from hbgear.mechanics.series.fourier import resize

SPAN = (0.8, 0.5)
# in the order of the curve, by shooting; harmonic balance agrees within 5e-7
POINTS = {"LP1": 0.653440, "LP2": 0.755627, "PD1": 0.755586, "PD2": 0.738783, "NS1": 0.618607, "NS2": 0.581901}


def two_masses():
    A = np.array([[1.0, -1.0], [-1.0, 2.0]])
    stop = Element([1.0, 0.0], Unilateral(k=100.0, gap=1.0), name="stop")
    return System(np.eye(2), 0.03 * A, A, [stop], Load(cosine={1: [0.0, 0.1]}))


@pytest.fixture(scope="module")
def shooting():
    """The curve by shooting."""
    return shot(two_masses(), SPAN, 5, 40)[1]


@pytest.fixture(scope="module")
def curve():
    """The curve by harmonic balance; the period doublings need 120 harmonics."""
    return trace(HarmonicBalance(two_masses(), 120), "Omega", SPAN)


def labelled(points):
    """``{"LP1": Omega, ...}`` in the order of the curve."""
    count, out = {}, {}
    for p in points:
        count[p.kind] = count.get(p.kind, 0) + 1
        out[f"{p.kind}{count[p.kind]}"] = p.Omega
    return out


def refined(problem, point):
    """Omega of a special point, solved with the harmonics of another problem."""
    Omega, X = point.parameters["Omega"], resize(point.X, problem.H)
    if point.kind == "NS":
        wide = 2e-5
        X = solve(problem, X, {"Omega": Omega + wide}).X
        piece = trace(
            problem, "Omega", (Omega + wide, Omega - wide), X, steps=StepControl(first_step=0.2, max_step=0.5)
        )
        return next(p.parameters["Omega"] for p in piece.special if p.kind == "NS")
    kind = {"LP": FoldProblem, "PD": PeriodDoublingProblem}[point.kind]
    return float(solve(kind(problem), np.append(X, Omega), {"Omega": Omega}).X[-1])


@pytest.mark.slow
def test_shooting_finds_these_points_and_no_others(shooting):
    assert not SPAN[1] <= shooting.orbits[-1].Omega
    found = labelled(shooting.special)
    assert list(found) == list(POINTS)
    np.testing.assert_allclose(list(found.values()), list(POINTS.values()), rtol=0, atol=5e-7)


@pytest.mark.slow
def test_harmonic_balance_finds_the_same_points_and_no_others(curve):
    assert curve.status == "reached_end"
    assert [p.label for p in curve.special if p.kind != "GR"] == list(POINTS)
    assert all(p.located for p in curve.special)


@pytest.mark.slow
def test_six_digits_by_both_methods(curve, shooting):
    problem, truth = HarmonicBalance(two_masses(), 320), labelled(shooting.special)
    found = {label: refined(problem, curve[label]) for label in POINTS}
    for label, Omega in found.items():
        assert Omega == pytest.approx(truth[label], rel=0, abs=5e-7), label
    assert {label: round(x, 6) for label, x in found.items()} == POINTS


def test_grazing(curve):
    """The impact regime changes where the motion without contact reaches the stop, by the linear transfer function."""
    A, F = np.array([[1.0, -1.0], [-1.0, 2.0]]), np.array([0.0, 0.1])
    grazing = [p for p in curve.special if p.kind == "GR"]
    assert len(grazing) == 2
    for p in grazing:
        w = p.parameters["Omega"]
        q = np.linalg.solve(A * (1 + 0.03j * w) - w**2 * np.eye(2), F)
        assert abs(q[0]) == pytest.approx(1.0, abs=1e-10)
    assert curve["LP1"].parameters["Omega"] - grazing[0].parameters["Omega"] == pytest.approx(-5.87e-9, rel=0.01)


def test_stable_means_stable(curve, shooting):
    """The number of stability changes along the curve is the same by both methods."""
    changes = [p.label for p in curve.special if p.kind != "GR"]
    stable = [bool(np.abs(orbit.multipliers).max() < 1) for orbit in shooting.orbits]
    assert np.sum(np.diff(np.array(stable, int)) != 0) == np.sum(np.diff(curve.stable.astype(int)) != 0) <= len(changes)


def test_the_two_ways_of_shooting_agree(shooting):
    orbit = min(shooting.orbits, key=lambda o: abs(o.Omega - 0.6))
    period = integrate(two_masses(), orbit.Omega, orbit.y)
    assert len(period.instants) > 1
    np.testing.assert_allclose(period.end, orbit.y, rtol=0, atol=1e-9)
    np.testing.assert_allclose(period.monodromy, orbit.Phi, rtol=0, atol=1e-8 * np.abs(orbit.Phi).max())
