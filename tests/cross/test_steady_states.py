"""All steady motions at one frequency, of systems whose numbers of motions are known."""

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.time.attractors.steady_states import unseen


def test_a_duffing_oscillator_has_three_motions_between_its_folds():
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 7), "Omega", (0.8, 1.4))
    found = hb.time.steady_states(hb.Duffing(), 1.102, harmonics=7, starts=30, guesses=10)
    rows = np.flatnonzero((curve.values[:-1] - 1.102) * (curve.values[1:] - 1.102) <= 0)
    assert len(found) == len(rows) == 3 and found.indices == {1: 1} and found.missing == 0
    assert [(motion.period, motion.stable) for motion in found.motions] == [(1, True), (1, True), (1, False)]
    assert sum(motion.share for motion in found.motions) == pytest.approx(1.0) and found.aperiodic == 0.0
    rms, near = (np.sort(x) for x in ([p.amplitude("rms") for p in found.points], curve.amplitude("rms")[rows]))
    np.testing.assert_allclose(rms, near, rtol=0.1)


def test_a_spur_pair_has_three_motions_between_its_folds_and_one_above():
    found = hb.time.steady_states(hb.SpurPair(), 0.75, harmonics=15, starts=20, guesses=10, periods=1)
    assert sorted(motion.stable for motion in found.motions) == [False, True, True] and found.missing == 0
    above = hb.time.steady_states(hb.SpurPair(), 1.1, harmonics=15, starts=10, guesses=5, periods=1)
    assert len(above) == 1 and above.motions[0].share == 1.0


def test_rest_is_unstable_and_a_motion_of_two_periods_surrounds_it():
    """Parametric resonance at twice the natural frequency."""
    varying = hb.mechanics.PiecewiseLinear((), (1.0,), stiffness=hb.mechanics.Series(mean=1.0, cosine=(0.5,)))
    spring = hb.mechanics.Parallel((varying, hb.Cubic(1.0)))
    model = single_mass(spring, k=0.0)
    found = hb.time.steady_states(model, 2.0, harmonics=5, starts=5, guesses=6)
    assert [(motion.period, motion.stable) for motion in found.motions] == [(2, True), (1, False)]
    assert found.indices == {1: 1, 2: 1}  # both copies of the motion and the unstable rest: 1 + 1 - 1
    assert found.motions[1].point.amplitude("max") < 1e-9


def test_a_missing_motion_shows_in_the_sum_of_indices():
    """Without deflation the unstable motion between two stable ones is missing."""
    found = hb.time.steady_states(hb.Duffing(), 1.102, harmonics=7, starts=30, guesses=0, periods=1)
    assert len(found) == 2 and found.indices == {1: 2} and found.missing == 1


def test_estimate_of_unseen_motions():
    assert unseen([5, 4, 3]) == 0.0 and unseen([1, 1, 1, 2]) == 1.5 and unseen([1, 9]) == 0.0


@pytest.mark.slow
def test_trace_all_traces_the_motions():
    model = hb.Duffing(zeta=0.01, k3=1, F=3)
    found = hb.time.steady_states(model, 4.0, harmonics=5, starts=40, guesses=0, periods=1)
    (third,) = (motion.point for motion in found.motions if motion.period == 3)
    problem = hb.HarmonicBalance(model, 15, nu=3)
    search = hb.trace_all(problem, (4.2, 3.8), frequencies=[4.0], guesses=0, motions=[third], stability=False)
    assert any("a given motion" in line for line in search.log)
    branch = search[len(search) - 1]
    heights = branch.amplitude("rms")[np.abs(branch.values - 4.0) < 0.1]
    assert np.abs(heights - third.amplitude("rms")).min() < 0.05


def test_bad_input():
    with pytest.raises(ValueError, match="Omega"):
        hb.time.steady_states(hb.Duffing(), -1.0)
    with pytest.raises(ValueError, match="extent"):
        hb.time.steady_states(hb.Duffing(), 1.0, extent=0.0)
    slider = single_mass(hb.mechanics.Jenkins(1.0, 0.1), F=1.0)
    with pytest.raises(ValueError, match="does not integrate friction"):
        hb.time.steady_states(slider, 1.0)
