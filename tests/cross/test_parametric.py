"""A gear pair that only its varying stiffness excites, and the motions of twice the period it gives rise to.

    x'' + 0.1 x' + (1 - 0.3 cos(Omega t)) f(x) = 0.1,   Omega from 2.6 to 0.4

Near Omega = 2 the teeth stay in contact and the motion is on the border of parametric resonance: the doubled motions
are a continuum there, the branch leaves vertically until contact is first lost.
"""

import numpy as np
import pytest
from cross.shooting import integrate, state
from cross.shooting_branch import shot

from hbgear import HarmonicBalance, SpurPair, trace
from hbgear.continuation.switch import switch

PAIR = SpurPair(F_m=0.1, zeta=0.05, eps=(0.3,), e=())
SPAN = (2.6, 0.4)
SIX = {"rel": 0, "abs": 5e-7}
# by shooting; within 5e-7 of it by harmonic balance
POINTS = {"PD1": 2.106392, "PD2": 1.883144, "LP1": 0.705697, "LP2": 0.844564}
DOUBLED = {"LP1": 1.225503}


@pytest.fixture(scope="module")
def curve():
    return trace(HarmonicBalance(PAIR, 40), "Omega", SPAN)


@pytest.fixture(scope="module")
def doubled(curve):
    return switch(curve, "PD1")


@pytest.fixture(scope="module")
def shooting():
    return shot(PAIR, SPAN, 10, 24)


@pytest.fixture(scope="module")
def shot_doubled(shooting):
    shooter, curve = shooting
    other, first = shooter.doubled(next(p for p in curve.special if p.kind == "PD"))
    return other.curve(first, (0.4, 2.6))


def places(special):
    """(kind, Omega) of all but grazing points and ends of branches, in order."""
    out = []
    for p in special:
        if p.kind not in ("GR", "EP"):
            out.append((p.kind, p.Omega if hasattr(p, "Omega") else p.parameters["Omega"]))
    return out


def agree(found, truth, expected):
    """The same kinds in the same order, at the same six digits."""
    assert [kind for kind, _ in found] == [kind for kind, _ in truth] == [label[:2] for label in expected]
    for (_, a), (_, b), c in zip(found, truth, expected.values(), strict=True):
        assert a == pytest.approx(b, **SIX)
        assert b == pytest.approx(c, **SIX)


@pytest.mark.slow
def test_folds_and_period_doublings_by_both_methods(curve, shooting):
    assert curve.status == "reached_end"
    agree(places(curve.special), places(shooting[1].special), POINTS)


@pytest.mark.slow
def test_the_doubled_branch_by_both_methods(doubled, shot_doubled):
    assert doubled.status == "merged" and shot_doubled.merged
    assert doubled.values[-1] == pytest.approx(POINTS["PD2"], **SIX)
    assert shot_doubled.orbits[-1].Omega == pytest.approx(POINTS["PD2"], rel=0, abs=1e-4)
    agree(places(doubled.special), places(shot_doubled.special), DOUBLED)


def test_the_doubled_branch_leaves_vertically(curve, doubled):
    """Where contact holds the equation is linear: motions of any size at one Omega, until the first loss of contact."""
    in_contact = doubled.regime[:, 0] == 0
    assert np.ptp(doubled.values[in_contact & (doubled.values > 2)]) < 1e-8
    first = next(p for p in doubled.special if p.kind == "GR")
    assert first.parameters["Omega"] == pytest.approx(curve["PD1"].parameters["Omega"], rel=0, abs=1e-9)
    assert np.ptp(doubled.amplitude("H1/2")[: first.index + 1]) > 0.1


def test_a_doubled_motion_and_its_multipliers(doubled):
    """One stable motion well inside, against time integration over two periods of the mesh."""
    i = int(np.argmin(np.abs(doubled.values - 1.6)))
    Omega = float(doubled.values[i])
    y = state(doubled.problem, doubled.X[i], Omega=Omega)
    once, twice = (integrate(PAIR.system(), Omega, y, nu) for nu in (1, 2))
    assert np.linalg.norm(once.end - y) > 0.3
    np.testing.assert_allclose(twice.end, y, rtol=0, atol=1e-6)
    mu = np.linalg.eigvals(twice.monodromy)
    np.testing.assert_allclose(np.sort_complex(mu), np.sort_complex(doubled.multipliers[i]), rtol=0, atol=1e-5)
    assert bool(doubled.stable[i]) == bool(np.abs(mu).max() < 1)
