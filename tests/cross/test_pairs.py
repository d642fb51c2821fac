"""Pairs of multipliers that pass the unit circle, against those of shooting."""

import numpy as np
import pytest
from cross.shooting import shoot, state

from hbgear import Backlash, Element, HarmonicBalance, Load, System, Unilateral, trace


def rotor():
    """Rotor in equal gaps in x and in y, driven by an unbalance."""
    one = np.eye(2)
    gaps = [Element(w, Backlash(b=0.5, k=2.0)) for w in one]
    return System(one, 0.02 * one, one, gaps, Load(cosine={1: one[0]}, sine={1: one[1]}, power=2))


def stops():
    """Two masses, a stop and a hard gap."""
    C, K = np.array([[0.1714, -0.0922], [-0.0922, 0.1114]]), np.array([[1.4258, -0.8069], [-0.8069, 0.8069]])
    elements = [
        Element([0.0, 1.0], Unilateral(k=2.2025, gap=0.7689)),
        Element([1.0, 0.0], Backlash(b=0.27504, k=54.957)),
    ]
    return System(np.diag([0.8534, 1.922]), C, K, elements, Load(cosine={1: [0.13765, 0.0]}))


def multipliers(system, problem, X, Omega):
    """Of the motion that shooting finds from X."""
    _, period = shoot(system, Omega, state(problem, X, Omega=Omega), tolerance=1e-11)
    return np.linalg.eigvals(period.monodromy)


@pytest.mark.slow
def test_pairs_of_real_multipliers_of_a_rotor():
    """On either side of each branch point shooting finds two more, or fewer, unstable multipliers."""
    problem = HarmonicBalance(rotor(), 20)
    branch = trace(problem, "Omega", (0.55, 0.7))
    assert [p.label for p in branch.special] == ["GR1", "BP1", "BP2"]
    for label, counts in (("BP1", (0, 2)), ("BP2", (2, 0))):
        point = branch[label]
        for side, count in zip((-1, 1), counts, strict=True):
            i = point.index + side
            mu = multipliers(rotor(), problem, branch.X[i], float(branch.values[i]))
            assert (np.abs(mu) > 1).sum() == count
            np.testing.assert_allclose(np.sort(np.abs(mu)), np.sort(np.abs(branch.multipliers[i])), atol=0.05)


@pytest.mark.slow
def test_a_pair_of_complex_multipliers_of_hard_stops():
    """At NS1 a complex pair comes to lie on the circle by shooting too, as the truncation error falls."""
    away = []
    for H in (9, 16):  # with 9 the trace was lost at the first rows behind 0.48
        problem = HarmonicBalance(stops(), H)
        point = trace(problem, "Omega", (2.5, 1.5), accuracy=None)["NS1"]
        mu = multipliers(stops(), problem, point.X, point.parameters["Omega"])
        nearest = mu[np.argmin(np.abs(np.abs(mu) - 1))]
        assert abs(nearest.imag) > 1e-3
        away.append(abs(abs(nearest) - 1))
    assert away[1] < 0.02 and away[1] < 0.5 * away[0]
