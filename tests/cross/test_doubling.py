"""Period doubling of the strongly excited spur pair of Kahraman & Singh, between resonance and twice its frequency.

x'' + 0.1 x' + f(x) = 0.1 + 0.1 Omega^2 cos(Omega t), half-gap 1
"""

import numpy as np
import pytest
from cross.shooting import integrate, shoot, state
from cross.shooting_branch import shot

import hbgear as hb
from hbgear import HarmonicBalance, SpurPair, trace
from hbgear.continuation.switch import switch

PAIR = SpurPair(e=(0.10,))
SPAN = (2.2, 0.5)
SIX = {"rel": 0, "abs": 5e-7}
# by shooting; harmonic balance agrees within 5e-7
POINTS = {"PD1": 1.952685, "PD2": 1.226701, "LP1": 0.585332, "LP2": 0.731361}
DOUBLED = {"PD1": 1.846195, "PD2": 1.400379, "LP1": 1.030052, "LP2": 1.404840}


@pytest.fixture(scope="module")
def curve():
    return trace(HarmonicBalance(PAIR, 30), "Omega", SPAN)


@pytest.fixture(scope="module")
def doubled(curve):
    return switch(curve, "PD1")


@pytest.fixture(scope="module")
def shooting():
    return shot(PAIR, SPAN, 20, 24)


@pytest.fixture(scope="module")
def shot_doubled(shooting):
    shooter, curve = shooting
    other, first = shooter.doubled(next(p for p in curve.special if p.kind == "PD"))
    return other.curve(first, SPAN)


def agree(branch, curve, expected):
    """Kinds, order and six digits of the points agree; shooting does not detect grazing and end points."""
    found = [p for p in branch.special if p.kind not in ("GR", "EP")]
    assert [p.kind for p in found] == [p.kind for p in curve.special] == [label[:2] for label in expected]
    for p, truth, x in zip(found, curve.special, expected.values(), strict=True):
        assert p.located
        assert p.parameters["Omega"] == pytest.approx(truth.Omega, **SIX)
        assert truth.Omega == pytest.approx(x, **SIX)


@pytest.mark.slow
def test_folds_and_period_doublings_by_both_methods(curve, shooting):
    assert curve.status == "reached_end"
    agree(curve, shooting[1], POINTS)


@pytest.mark.slow
def test_the_doubled_branch_by_both_methods(doubled, shot_doubled):
    assert doubled.status == "merged" and shot_doubled.merged
    agree(doubled, shot_doubled, DOUBLED)
    # at the end point the subharmonics tend to zero as a square root
    assert doubled.values[-1] == pytest.approx(POINTS["PD2"], **SIX)


def test_unstable_between_the_period_doublings_and_nowhere_else_above_the_jumps(curve):
    above = curve.values > 0.8
    inside = (curve.values > POINTS["PD2"] + 1e-4) & (curve.values < POINTS["PD1"] - 1e-4)
    outside = above & ((curve.values < POINTS["PD2"] - 1e-4) | (curve.values > POINTS["PD1"] + 1e-4))
    assert not curve.stable[inside].any() and curve.stable[outside].all()
    assert inside.sum() > 5 and outside.sum() > 5


def settled(Omega, y, periods, turns):
    """Return the state after a transient from a disturbed start near y."""
    y = y + np.array([0.02, -0.01])
    for _ in range(turns):
        y = integrate(PAIR.system(), Omega, y, periods, tolerance=1e-9).end
    return y


@pytest.mark.slow
@pytest.mark.parametrize("Omega", [1.9, 1.3])
def test_time_integration_settles_on_the_doubled_motion(doubled, Omega):
    """A disturbed start converges to the same motion, which has two periods of the mesh and not one."""
    near = np.flatnonzero(doubled.stable)
    i = near[np.argmin(np.abs(doubled.values[near] - Omega))]
    Omega = float(doubled.values[i])
    expected = state(doubled.problem, doubled.X[i], Omega=Omega)
    y = settled(Omega, expected, 2, 36)
    np.testing.assert_allclose(y, expected, rtol=0, atol=2e-5)
    assert np.linalg.norm(integrate(PAIR.system(), Omega, y, 2).end - y) < 1e-6
    assert np.linalg.norm(integrate(PAIR.system(), Omega, y, 1).end - y) > 0.1


@pytest.mark.slow
def test_four_periods(doubled):
    """A second period doubling gives a branch of four periods; motion and multipliers agree with integration."""
    child = switch(doubled, "PD1")
    assert child.problem.nu == 4 and child.status == "merged"
    assert child.values[-1] == pytest.approx(DOUBLED["PD2"], **SIX)
    stable = np.flatnonzero(child.stable)
    i = stable[np.argmax(np.linalg.norm([child.problem.subharmonic_part(X) for X in child.X[stable]], axis=1))]
    Omega = float(child.values[i])
    y = state(child.problem, child.X[i], Omega=Omega)
    gaps = [np.linalg.norm(integrate(PAIR.system(), Omega, y, nu).end - y) for nu in (1, 2, 4)]
    assert gaps[0] > 0.1 and gaps[1] > 0.02 and gaps[2] < 1e-5
    true, period = shoot(PAIR.system(), Omega, y, 4)
    np.testing.assert_allclose(true, y, rtol=0, atol=1e-5)
    mu = np.linalg.eigvals(period.monodromy)
    np.testing.assert_allclose(np.sort(np.abs(mu)), np.sort(np.abs(child.multipliers[i])), rtol=0, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("problem", [lambda model: hb.HarmonicBalance(model, 32), hb.ContactInstants])
def test_a_doubled_branch_that_turns_next_to_its_start_has_this_fold_only(problem):
    """A contact begins 6e-6 from the period doubling, the branch turns at 1.6e-5; at its start it does not."""
    spring = hb.Element([1.0], hb.Unilateral(k=4.362, gap=-0.279))
    model = hb.System([[0.781]], [[0.0603]], [[0.942]], [spring], hb.Load(cosine={1: [0.327]}))
    curve = hb.trace(problem(model), "Omega", (1.3, 1.26), cover=False)
    label = min((p for p in curve.special if p.kind == "PD"), key=lambda p: p.parameters["Omega"]).label
    found = [(p.kind, round(p.parameters["Omega"], 6)) for p in hb.switch(curve, label).special]
    assert found == [("GR", 1.277767), ("LP", 1.277757), ("GR", 1.281559), ("EP", 1.282323)]
