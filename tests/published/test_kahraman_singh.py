"""The spur gear pair with backlash of Kahraman & Singh (1990), J. Sound Vib. 142(1), 49-75.

    x'' + 2 zeta x' + f(x) = F_m + F_ah Omega^2 cos(Omega t),   zeta = 0.05, F_m = 0.1, half-gap 1

F_ah Omega^2 is the paper's alternating internal excitation F_ah omega_eh^2; here it is e_1 = F_ah of `SpurPair`. The
paper gives figures; the numbers were computed independently for F_ah = 0.05 (to nine digits, by harmonic balance
with 80 harmonics and by shooting) and F_ah = 0.10 (to 1e-4).
"""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from hbgear import HarmonicBalance, SpurPair, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.series.fourier import extrema

FOLDS = (0.7080316187, 0.8284639844)
FOLD_H1 = (0.32333707, 0.11764379)
PEAK_MAX = 1.36550347
CONTACT_LOSS = (0.82063, 1.40709)

FOLDS_010 = (0.58533, 0.73136)
PEAK_010 = (0.594, 0.374)  # Omega and rms, printed to three digits
PD_010 = (1.234, 1.96)
ATTRACTORS_010 = (0.05141, 0.34055)


def frequencies(curve, kind):
    return np.array([p.parameters["Omega"] for p in curve.special if p.kind == kind])


def refined_peak(problem, near, measure):
    """Return (Omega, maximum) of a measure of the motion near a point, by solving at fixed Omega."""
    Omega = near.parameters["Omega"]
    found = minimize_scalar(
        lambda w: -measure(solve(problem, near.X, {"Omega": w}).X),
        bounds=(Omega - 0.004, Omega + 0.004),
        method="bounded",
        options={"xatol": 1e-7},
    )
    return found.x, -found.fun


@pytest.fixture(scope="module")
def fine():
    return trace(HarmonicBalance(SpurPair(), 80), "Omega", (1.5, 0.3))


@pytest.mark.parametrize(
    ("settings", "tolerance"),
    [({"harmonics": 10, "samples": 1024, "sampled": True}, 2e-5), ({"harmonics": 10}, 5e-7)],
    ids=["sampled", "exact"],
)
def test_folds_with_ten_harmonics(settings, tolerance):
    curve = trace(HarmonicBalance(SpurPair(), **settings), "Omega", (1.5, 0.3), stability=False)
    np.testing.assert_allclose(frequencies(curve, "LP"), FOLDS, atol=tolerance, rtol=0)
    np.testing.assert_allclose(np.sort(frequencies(curve, "GR")), CONTACT_LOSS, atol=5e-6, rtol=0)


def test_folds_with_eighty_harmonics(fine):
    assert [p.label for p in fine.special] == ["GR1", "LP1", "LP2", "GR2"]
    np.testing.assert_allclose(frequencies(fine, "LP"), FOLDS, atol=2e-10, rtol=0)
    np.testing.assert_allclose([fine[label].amplitude("H1") for label in ("LP1", "LP2")], FOLD_H1, atol=2e-8, rtol=0)


def test_highest_displacement(fine):
    """The maximum of x over the period and all frequencies matches the reference to 2e-8."""
    _, peak = refined_peak(fine.problem, fine.peak("max"), lambda X: float(extrema(X)[2]))
    assert peak == pytest.approx(PEAK_MAX, abs=2e-8)


def test_jumps_of_a_slow_sweep(fine):
    """Down: the impacting motion jumps at the lower fold; up: the jump is at the upper fold, above contact loss."""
    down, up = fine.jumps()
    assert (down.label, down.direction, up.label, up.direction) == ("LP1", -1, "LP2", 1)
    assert down.after.regime_name == "no_impact" and up.after.regime_name == "single_sided"
    assert down.before.amplitude("H1") == pytest.approx(FOLD_H1[0], abs=2e-8)
    # in contact the pair is linear: closed-form amplitude
    r = FOLDS[0]
    linear = 0.05 * r**2 / np.hypot(1 - r**2, 0.1 * r)
    assert down.after.amplitude("H1") == pytest.approx(linear, abs=1e-8)


def test_no_period_doubling_and_never_contact_on_the_back(fine):
    assert frequencies(fine, "PD").size == frequencies(fine, "NS").size == 0
    assert fine.regime.max() == 1
    # unstable only between the folds; next to a fold the computed stability depends on the truncation, H = 80
    middle = slice(fine["LP1"].index + 2, fine["LP2"].index - 1)
    assert not fine.stable[middle].any()
    assert fine.stable[: fine["LP1"].index - 1].all() and fine.stable[fine["LP2"].index + 2 :].all()


# ---- F_ah = 0.10


@pytest.fixture(scope="module")
def strong():
    return trace(HarmonicBalance(SpurPair(e=(0.1,)), 30), "Omega", (2.2, 0.25))


def test_strong_excitation_folds_and_peak(strong):
    np.testing.assert_allclose(frequencies(strong, "LP"), FOLDS_010, atol=1e-4, rtol=0)
    Omega, rms = refined_peak(strong.problem, strong.peak(), lambda X: float(np.sqrt(0.5 * (X[1:] ** 2).sum())))
    assert (Omega, rms) == (pytest.approx(PEAK_010[0], abs=6e-4), pytest.approx(PEAK_010[1], abs=1e-4))


def test_strong_excitation_period_doubling(strong):
    np.testing.assert_allclose(np.sort(frequencies(strong, "PD")), PD_010, atol=0.01, rtol=0)
    first, second = (strong[label].index for label in ("PD1", "PD2"))
    assert not strong.stable[first + 1 : second].any()
    assert strong.stable[:first].all()


def test_two_attractors(strong):
    """At Omega = 0.65 the sweeps up and down reach different stable motions; the motion between them is unstable."""
    x = strong.values - 0.65
    found = []
    for i in np.flatnonzero(x[:-1] * x[1:] < 0):
        piece = trace(strong.problem, "Omega", (strong.values[i], 0.65), strong[int(i)])
        found.append((piece.amplitude()[-1], bool(piece.stable[-1])))
    assert [stable for _, stable in sorted(found)] == [True, False, True]
    np.testing.assert_allclose([a for a, stable in sorted(found) if stable], ATTRACTORS_010, atol=1e-5, rtol=0)
