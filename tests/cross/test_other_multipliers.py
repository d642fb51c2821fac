"""Curves of special points along which another multiplier passes the unit circle: fold-, flip- and double
Neimark-Sacker points, against shooting."""

from dataclasses import dataclass

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.time.integration import state_of


@dataclass(frozen=True)
class VanDerPol(hb.mechanics.Law):
    """eps (d^2 - 1) d' + quadratic d^2 + cubic d^3"""

    eps: float
    quadratic: float = 0.0
    cubic: float = 0.0

    def force(self, d, v, tau):
        force = self.eps * (d**2 - 1) * v + self.quadratic * d**2 + self.cubic * d**3
        slope = 2 * self.eps * d * v + 2 * self.quadratic * d + 3 * self.cubic * d**2
        return force, slope, self.eps * (d**2 - 1)


@hb.mechanics.model
def linked(F: float = 1.0) -> hb.System:
    """A van der Pol oscillator, and a forced mass that a cubic spring links to it."""
    elements = [hb.Element([1.0, 0.0], VanDerPol(0.3)), hb.Element([1.0, -1.0], hb.Cubic(0.2))]
    load = hb.Load(cosine={1: [0.0, F]})
    return hb.System(np.eye(2), np.diag([0.0, 0.1]), [[2.0, -1.0], [-1.0, 3.0]], elements, load)


@hb.mechanics.model
def parametric(F: float = 1.0) -> hb.System:
    """A forced van der Pol oscillator, and a mass with varying stiffness that a cubic spring links to it."""
    varying = hb.mechanics.Series(mean=0.49, cosine=(0.49 * 0.3,))
    elements = [
        hb.Element([1.0, 0.0], VanDerPol(0.2, 0.05)),
        hb.Element([0.0, 1.0], hb.mechanics.PiecewiseLinear((), (1.0,), stiffness=varying)),
        hb.Element([1.0, -1.0], hb.Cubic(0.05)),
    ]
    K, load = [[1.02, -0.02], [-0.02, 0.02]], hb.Load(cosine={1: [F, 0.0]})
    return hb.System(np.eye(2), np.diag([0.0, 0.05]), K, elements, load)


@hb.mechanics.model
def two_van_der_pol(F: float = 1.0) -> hb.System:
    """Two forced van der Pol oscillators with a weak linear link."""
    elements = [hb.Element([1.0, 0.0], VanDerPol(0.2, 0.05)), hb.Element([0.0, 1.0], VanDerPol(0.25, 0.0, 0.05))]
    load = hb.Load(cosine={1: [F, 1.2 * F]})
    return hb.System(np.eye(2), np.zeros((2, 2)), [[1.05, -0.05], [-0.05, 2.0]], elements, load)


@hb.mechanics.model
def rotor(F: float = 1.0) -> hb.System:
    """The two van der Pol oscillators with a gyroscopic matrix."""
    plain = two_van_der_pol(F).system()
    speed = hb.mechanics.SpeedTerms([[0.0, 0.05], [-0.05, 0.0]])
    return hb.System(plain.M, plain.C, plain.K, plain.elements, plain.load, speed=speed)


@hb.mechanics.model
def stopped(F: float = 1.5) -> hb.System:
    """A forced van der Pol oscillator, linked to a mass with a stop."""
    elements = [hb.Element([1.0, 0.0], VanDerPol(0.2, 0.05)), hb.Element([0.0, 1.0], hb.Unilateral(k=1.0, gap=0.5))]
    load = hb.Load(cosine={1: [F, 0.2 * F]})
    return hb.System(np.eye(2), np.diag([0.0, 0.05]), [[1.2, -0.2], [-0.2, 2.0]], elements, load)


def places(curve, kind):
    """Return F and Omega of the points of a kind, sorted."""
    found = [(p.parameters["F"], p.parameters["Omega"]) for p in curve.special if p.kind == kind]
    return np.array(sorted(found))


def shot(model, point):
    """Return the multipliers at a point by shooting, of positive imaginary part or real."""
    balance = hb.HarmonicBalance(model, 10)
    F, Omega = point.parameters["F"], point.parameters["Omega"]
    state = state_of(balance, balance.from_point(point), Omega=Omega, F=F)
    mu = hb.time.shoot(model.replace(F=F), Omega, state, tolerance=1e-12).multipliers
    return mu[mu.imag > -1e-12]  # real ones have imaginary parts of either sign by rounding


@pytest.mark.slow
def test_a_pair_passes_the_circle_on_a_curve_of_folds(tmp_path):
    """Number: an extended system of shooting. The curve of Neimark-Sacker points through the point meets the folds."""
    curve = hb.trace(hb.HarmonicBalance(linked(), 12), "Omega", (0.6, 0.9))
    folds = hb.follow(curve, "LP1", "F", (0.3, 3.0))
    point = folds["LPNS1"]
    exact = {"F": 0.8508530742600341, "Omega": 0.7900222043299652}
    assert abs(point.parameters["F"] - exact["F"]) <= 3 * point.error < 1e-8
    assert point.parameters["Omega"] == pytest.approx(exact["Omega"], abs=3e-10)
    folds.save(tmp_path / "folds.npz")
    loaded = hb.load(tmp_path / "folds.npz")["LPNS1"]
    assert loaded.parameters == point.parameters and loaded.meaning.startswith("fold-Neimark-Sacker")
    few = {"accuracy": None, "steps": hb.StepControl(max_points=8)}
    held = hb.switch(folds, "LPNS1", (0.3, 1.3), side=-1, **few)
    assert isinstance(held.problem, hb.harmonic.NeimarkSackerProblem)
    # back through the point at which it began
    held = hb.trace(
        held.problem, "F", (held.values[-1], 0.8), held[-1], accuracy=None, steps=hb.StepControl(max_points=20)
    )
    assert places(held, "LPNS")[0] == pytest.approx(list(exact.values()), abs=3e-9)
    back = hb.switch(held, "LPNS1", (0.3, 1.3), **few)
    assert isinstance(back.problem, hb.continuation.FoldProblem) and len(back) == 8


@pytest.mark.slow
def test_a_pair_passes_the_circle_on_a_curve_of_period_doublings():
    """The curve of Neimark-Sacker points has the same points; shooting has the multiplier -1 and the pair."""
    curve = hb.trace(hb.HarmonicBalance(parametric(), 10), "Omega", (1.0, 2.2), accuracy=None)
    doublings = hb.follow(curve, "PD1", "F", (0.3, 4.0), accuracy=None)
    label = max((p for p in curve.special if p.kind == "NS"), key=lambda p: p.parameters["Omega"]).label
    held = hb.follow(curve, label, "F", (1.0, 4.0), accuracy=None)
    assert len(places(doublings, "PDNS")) == 2
    np.testing.assert_allclose(places(held, "PDNS"), places(doublings, "PDNS"), atol=1e-9)
    for name in ("PDNS1", "PDNS2"):
        mu = shot(parametric(), doublings[name])
        assert np.abs(mu + 1).min() < 1e-8
        assert np.sort(np.abs(np.abs(mu) - 1))[1] < 1e-8  # the pair, and the multiplier -1


@pytest.mark.slow
def test_two_pairs_pass_the_circle():
    """Both curves of Neimark-Sacker points have the point; shooting has two pairs on the circle."""
    curve = hb.trace(hb.HarmonicBalance(two_van_der_pol(), 10), "Omega", (1.1, 1.4), accuracy=None)
    found = [hb.follow(curve, label, "F", (0.6, 1.0), accuracy=None) for label in ("NS1", "NS2")]
    np.testing.assert_allclose(places(found[0], "NSNS"), places(found[1], "NSNS"), atol=1e-9)
    mu = shot(two_van_der_pol(), found[0]["NSNS1"])
    assert len(mu) == 2 and np.abs(np.abs(mu) - 1).max() < 1e-8
    other = hb.switch(found[0], "NSNS1", (0.6, 0.8), accuracy=None)
    second = found[1].at(0.8)[0].parameters["Omega"]
    assert other.values[-1] == 0.8 and other.tracked["Omega"][-1] == pytest.approx(second, abs=1e-9)


@pytest.mark.slow
def test_a_structure_that_depends_on_speed():
    """Its curves of Neimark-Sacker points had no points of codimension two and no end. Numbers: shooting."""
    curve = hb.trace(hb.HarmonicBalance(rotor(), 10), "Omega", (0.9, 1.2), accuracy=None)
    held = hb.follow(curve, "NS1", "F", (0.6, 1.3), accuracy=None)
    assert [p.kind for p in held.special] == ["NSNS", "RIV", "RIII", "RII"] and held.status is hb.Status.EVENT
    np.testing.assert_allclose(places(held, "NSNS"), [[0.687154946366820, 1.259050612081184]], atol=1e-9)


@hb.mechanics.model
def rubbing(mu: float = 0.2) -> hb.System:
    """A rotor that rubs in a round clearance with friction."""
    seal = hb.mechanics.VectorElement(np.eye(2), hb.mechanics.RadialClearance(2.0, 0.3, mu))
    unbalance = hb.Load(cosine={1: [0.1, 0.0]}, sine={1: [0.0, 0.1]}, power=2)
    return hb.System(np.eye(2), 0.1 * np.eye(2), np.diag([1.0, 1.1]), list(seal), unbalance)


@pytest.mark.slow
def test_laws_whose_slopes_are_unknown():
    """Number: an extended system of shooting. Curves of folds and of Neimark-Sacker points have the same point.

    At the point dR/dX is singular; gradients of a multiplier along motions over Omega did not exist there.
    """
    curve = hb.trace(hb.HarmonicBalance(rubbing(), 10), "Omega", (0.5, 4.0))
    folds = hb.follow(curve, "LP1", "mu", (0.1, 0.2))
    left = hb.switch(folds, "LPNS1", (0.1035, 0.106), steps=hb.StepControl(max_points=8))
    held = hb.trace(left.problem, "mu", (left.values[-1], 0.104), left[-1], steps=hb.StepControl(max_points=20))
    assert type(held.problem).__name__ == "PairModulusProblem"
    for point in (folds["LPNS1"], held["LPNS1"]):
        assert point.parameters["mu"] == pytest.approx(0.1045740702, abs=3e-10) and point.error < 1e-9
        assert point.parameters["Omega"] == pytest.approx(1.5496797171, abs=3e-10)


@pytest.mark.slow
def test_a_pair_of_a_rub_becomes_real():
    """A curve of Neimark-Sacker points ends where it joins the folds, which have equations of their own."""
    curve = hb.trace(hb.HarmonicBalance(rubbing(0.143), 5, samples=512), "Omega", (0.5, 2.0), accuracy=None)
    (last,) = (p for p in curve.special if p.kind == "NS" and 1.3315 < p.parameters["Omega"] < 1.3325)
    end = hb.follow(curve, last, "mu", (0.143, 0.13), accuracy=None)
    assert end.status.name == "EVENT" and "ends at a 1:1 resonance" in end.message
    point = end["RI1"]
    balance = end.problem.problem
    fold = hb.continuation.FoldProblem(balance, "Omega")
    others = {name: value for name, value in point.parameters.items() if name != "Omega"}
    X = solve(fold, fold.join(balance.from_point(point), point.parameters), others).X
    assert fold.split(X)[1]["Omega"] == pytest.approx(point.parameters["Omega"], rel=2e-7)
    mu = balance.multipliers(balance.from_point(point), **point.parameters)
    assert np.sort(np.abs(mu - 1))[1] < 1e-4


@pytest.mark.slow
def test_errors_with_a_stop_are_those_of_shooting():
    curve = hb.trace(hb.HarmonicBalance(stopped(), 16), "Omega", (1.42, 1.52))
    folds = hb.follow(curve, "LP1", "F", (0.3, 4.0))
    exact = np.array([[1.1782065454006911, 1.452618500786271], [1.1912663849020337, 1.4499752125025334]])
    found = sorted((p for p in folds.special if p.kind == "LPNS"), key=lambda p: p.parameters["F"])
    for point, (F, Omega) in zip(found, exact, strict=True):
        assert abs(point.parameters["F"] - F) < 3 * point.error < 1e-6
        assert point.parameters["Omega"] == pytest.approx(Omega, abs=1e-8)


@pytest.mark.slow
def test_many_multipliers():
    """At the point the Neimark-Sacker point and the fold of the response curve change their order; 46 multipliers."""
    curve = hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 12), "Omega", (1.0, 0.6))
    places = [hb.follow(curve, label, "zeta", (0.05, 0.055))["LPNS1"].parameters["zeta"] for label in ("LP1", "NS1")]
    assert places[0] == pytest.approx(places[1], abs=1e-10)
    gaps = []
    for zeta in (places[0] - 2e-4, places[0] + 2e-4):
        one = hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=zeta), 12), "Omega", (1.0, 0.6))
        gaps.append([p.kind for p in one.special if p.kind in ("LP", "NS")][:2])
    assert gaps == [["NS", "LP"], ["LP", "NS"]]
