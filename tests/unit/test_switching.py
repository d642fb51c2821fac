"""Branch switching: what leaves at PD and BP, where it goes, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from hbgear import Cubic, Duffing, Element, HarmonicBalance, Load, SpurPair, StepControl, System, trace
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.newton import NewtonSettings
from hbgear.continuation.switch import switch
from hbgear.continuation.tracing.jumps import point_on_new_branch
from hbgear.gears import DoubleHelicalPair

PARAMETRIC = SpurPair(F_m=0.1, eps=(0.3,), e=())


def even_and_odd(branch):
    """Norms of each row in its even and odd basis harmonics."""
    k = (np.arange(branch.X.shape[1]) + 1) // 2
    return np.linalg.norm(branch.X[:, k % 2 == 0], axis=1), np.linalg.norm(branch.X[:, k % 2 == 1], axis=1)


@pytest.fixture(scope="module")
def curve():
    return trace(HarmonicBalance(PARAMETRIC, 10), "Omega", (2.4, 1.0))


@pytest.fixture(scope="module")
def doubled(curve):
    return switch(curve, "PD1")


@pytest.fixture(scope="module")
def oscillators():
    """Two equal Duffing oscillators on a weak spring, driven alike."""
    K = np.eye(2) + 0.1 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    elements = [Element([1.0, 0.0], Cubic(1.0), name="left"), Element([0.0, 1.0], Cubic(1.0), name="right")]
    system = System(np.eye(2), 0.1 * np.eye(2), K, elements, Load(cosine={1: [1.0, 1.0]}))
    return trace(HarmonicBalance(system, 5), "Omega", (0.5, 4.0))


# ---- period doubling


def test_the_doubled_branch_has_twice_the_period(curve, doubled):
    problem = doubled.problem
    assert (problem.nu, problem.H) == (2, 2 * curve.problem.H + 1)
    assert doubled.layout.nu == 2 and doubled.multipliers is not None
    i = int(np.argmax(even_and_odd(doubled)[1]))
    for row in (0, i, -1):
        assert np.linalg.norm(problem.residual(doubled.X[row], **doubled.parameters_at(row))) < 1e-9
    assert even_and_odd(doubled)[1][i] > 0.3


def test_it_leaves_at_the_point_and_ends_on_the_old_branch(curve, doubled):
    assert doubled.status == "merged" and "joined" in doubled.message
    assert doubled.values[0] == pytest.approx(curve["PD1"].parameters["Omega"], rel=0, abs=1e-3)
    assert doubled.values[-1] == pytest.approx(curve["PD2"].parameters["Omega"], rel=0, abs=1e-6)
    odd = even_and_odd(doubled)[1]
    assert odd[0] < 0.05 and odd[-1] < 1e-6 and odd.min() == odd[-1]


def test_both_sides_are_one_motion_a_period_apart(curve, doubled):
    """Shifted by a period of the excitation, odd harmonics of half its frequency change sign."""
    other = switch(curve, "PD1", side=-1, steps=StepControl(max_points=20), stability=False)
    k = (np.arange(doubled.X.shape[1]) + 1) // 2
    sign = np.where(k % 2 == 0, 1.0, -1.0)
    np.testing.assert_allclose(other.values[:20], doubled.values[:20], rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.X[:20] * sign, doubled.X[:20], rtol=0, atol=1e-7)


def test_stability_passes_from_the_old_branch_to_the_new(curve, doubled):
    """The motion of one period is unstable between the doublings, that of two stable where it leaves downwards."""
    between = (curve.values < curve["PD1"].parameters["Omega"] - 1e-6) & (
        curve.values > curve["PD2"].parameters["Omega"] + 1e-6
    )
    assert not curve.stable[between].any()
    contact_lost = doubled.values < curve["PD1"].parameters["Omega"] - 1e-3
    first = int(np.argmax(contact_lost))
    assert doubled.stable[first : first + 5].all()


def test_no_span_means_the_range_of_the_branch(curve):
    few = StepControl(max_points=5)
    branch = switch(curve, "PD1", stability=False, special=False, steps=few)
    assert branch.meta["trace"]["span"] == [1.0, 2.4] and branch.multipliers is None
    narrow = switch(curve, "PD1", (2.3, 1.9), stability=False, special=False)
    assert narrow.status == "reached_end" and narrow.values[-1] == 1.9


# ---- branch points


def test_halves_that_no_longer_move_alike(oscillators):
    points = [p.label for p in oscillators.special if p.kind == "BP"]
    assert points == ["BP1", "BP2"]
    branch = switch(oscillators, "BP1")
    apart = np.abs(branch.amplitude("H1", "left") - branch.amplitude("H1", "right"))
    assert apart[0] < 0.1 and apart.max() > 1.0
    # the branch closes through the mirrored motions, and crosses the old curve at both of its points
    assert branch.status == "closed"
    found = sorted({round(p.parameters["Omega"], 4) for p in branch.special if p.kind == "BP"})
    assert found == sorted(round(oscillators[label].parameters["Omega"], 4) for label in points)


def test_sides_of_a_branch_point_are_mirror_images(oscillators):
    few = StepControl(max_points=15)
    left, right = (switch(oscillators, "BP1", side=side, stability=False, steps=few) for side in (1, -1))
    n = left.X.shape[1] // 2
    np.testing.assert_allclose(left.values[:15], right.values[:15], rtol=0, atol=1e-8)
    np.testing.assert_allclose(left.X[:15, :n], right.X[:15, n:], rtol=0, atol=1e-6)


def test_symmetry_breaking():
    """Beyond BP the mean of a symmetric oscillator is not zero: two motions, x and -x half a period later."""
    curve = trace(HarmonicBalance(Duffing(zeta=0.1, k3=1.0, F=10.0), 9), "Omega", (1.3, 1.8), stability=False)
    branches = [switch(curve, "BP1", side=side, stability=False) for side in (1, -1)]
    mean = [branch.amplitude("mean") for branch in branches]
    np.testing.assert_allclose(mean[0], -mean[1], rtol=0, atol=1e-7)
    assert np.abs(mean[0]).max() > 0.1
    assert np.abs(curve.amplitude("mean")).max() < 1e-9


# ---- bad input


def test_a_label_that_does_not_exist(curve):
    with pytest.raises(KeyError, match="no special point 'PD3' on this branch; it has: PD1, PD2"):
        switch(curve, "PD3")


def test_nothing_leaves_at_a_fold():
    curve = trace(HarmonicBalance(SpurPair(), 6), "Omega", (1.5, 0.6), stability=False)
    for label, a in (("LP1", "an"), ("GR1", "a")):
        with pytest.raises(ValueError, match=f"{label} is {a} {label[:2]}; no other branch leaves there"):
            switch(curve, label)


def test_a_branch_without_its_problem(curve):
    with pytest.raises(ValueError, match="needs the problem of the branch, which is unknown; load the branch with"):
        switch(replace(curve, problem=None, meta={}), "PD1")


@pytest.mark.slow
def test_a_doubled_branch_has_no_unexplained_change_of_stability_at_its_ends():
    """Next to the period doublings the motion is linear, and the curve is a family at one value, without a stability.

    A branch that leaves with a multiplier far from +1, by truncation, begins at a special point as well.
    """
    curve = trace(HarmonicBalance(DoubleHelicalPair(zeta=0.05), 12), "Omega", (0.36, 0.28))
    for label in ("PD1", "PD2"):
        doubled = switch(curve, label)
        assert np.ptp(doubled.values[:4]) < 1e-12 and not any("without a special point" in x for x in doubled.warnings)
        away = replace(doubled, multipliers=doubled.multipliers.copy())
        away.multipliers[0] *= 1.1
        assert not any("without a special point" in x for x in away.warnings)
    assert doubled.stable[doubled["EP1"].index - 1] and not doubled.stable.all()


# ---- points on new branches


class Pitchfork(ContinuationProblem):
    """x (p - x^2) = 0 with the unknown frequency w = 1 + x^2."""

    size, unknown_parameters = 2, ("w",)

    def evaluate(self, X, p, w=0.0):
        x, w = X
        return np.array([x * (p - x**2), w - 1 - x**2]), np.array([[p - 3 * x**2, 0.0], [-2 * x, 1.0]])

    def split(self, U):
        return U[:-1], {"w": float(U[-1])}

    def join(self, X, parameters):
        return np.append(X, parameters["w"])


def test_a_point_on_a_new_branch_has_its_own_unknown_parameter():
    """The branch x = +-sqrt(p) leaves at p = 0; its frequency is not that of the branch point."""
    branch = trace(Pitchfork(), "p", (-1.0, 1.0), np.array([0.0, 1.0]))
    point = point_on_new_branch(branch, branch["BP1"], 1, 0.1, NewtonSettings())
    (x,) = point.X
    assert x**2 == pytest.approx(0.01, rel=1e-9)
    assert point.parameters == pytest.approx({"p": x**2, "w": 1 + x**2}, rel=1e-9)
