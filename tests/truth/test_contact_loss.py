"""Where teeth part, in closed form, and the undamped motion with impacts on one side.

While the teeth stay in contact, x'' + 2 zeta x' + x - 1 = F_m + e Omega^2 cos(Omega t) is linear; they part when its
amplitude reaches the static deflection F_m:

    (1 - r^2)^2 + (2 zeta r)^2 = (e / F_m)^2 r^4

Without damping and excitation the tooth oscillates about 1 + F with amplitude A in contact and is thrown off:

    T = 2 pi - 2 arccos(F/A) + 2 sqrt(A^2 - F^2) / F,    A^2 - F^2 < 4 F     (no contact on the back)
"""

import numpy as np
import pytest

from hbgear import HarmonicBalance, SpurPair, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.series.fourier import extrema


def contact_loss(m):
    """Frequencies at which contact is lost, ascending."""
    ratio = m.e[0] / m.F_m
    r2 = np.roots([1 - ratio**2, 4 * m.zeta**2 - 2, 1])
    return np.sort(np.sqrt(r2[(np.abs(r2.imag) < 1e-12) & (r2.real > 0)].real))


CASES = [SpurPair(), SpurPair(zeta=0.1, e=(0.04,)), SpurPair(F_m=0.5, e=(0.2,)), SpurPair(b=0.3, e=(0.03,))]


@pytest.mark.parametrize("H", [1, 10])
@pytest.mark.parametrize("m", CASES, ids=str)
def test_grazing_points_are_at_the_closed_form(m, H):
    """The motion is linear up to there, so one harmonic is as exact as ten."""
    curve = trace(HarmonicBalance(m, H), "Omega", (3.0, 0.3), stability=False)
    found = sorted(p.parameters["Omega"] for p in curve.special if p.kind == "GR")
    np.testing.assert_allclose(found, contact_loss(m), atol=1e-9)
    for point in (p for p in curve.special if p.kind == "GR"):
        assert point.note == f"lowest of gap at {m.b:g}"
        assert point.amplitude("H1") == pytest.approx(m.F_m, abs=1e-9)


def test_the_default_case_parts_at_the_published_frequencies():
    np.testing.assert_allclose(contact_loss(SpurPair()), [0.82063, 1.40709], atol=5e-6)


def test_regimes_change_where_teeth_part():
    curve = trace(HarmonicBalance(SpurPair(), 10), "Omega", (3.0, 0.3), stability=False)
    low, high = contact_loss(SpurPair())
    outside = (curve.values > high + 1e-9) | (curve.values < low - 1e-9)
    parted = curve.regime[:, 0] == 1
    assert not parted[curve.values > high + 1e-9].any() and set(curve.regimes) == {"no_impact", "single_sided"}
    # below the upper and above the lower instant there is no motion in contact
    assert parted[~outside & (np.abs(curve.values - low) > 1e-6) & (np.abs(curve.values - high) > 1e-6)].all()


@pytest.mark.parametrize(("F", "A", "H"), [(0.1, 0.15, 80), (0.3, 0.9, 80)])
def test_undamped_motion_with_impacts(F, A, H):
    """Excited by +e and by -e ever so little, the mean of the two motions is the free one."""
    flight = np.sqrt(A**2 - F**2)
    assert flight**2 < 4 * F
    T = 2 * np.pi - 2 * np.arccos(F / A) + 2 * flight / F
    Omega, top, bottom = 2 * np.pi / T, 1 + F + A, 1 - flight**2 / (2 * F)
    # the free motion, its top at theta = 0, sampled as a guess
    t = np.linspace(-T / 2, T / 2, 4096, endpoint=False)
    after = np.abs(t) - (np.pi - np.arccos(F / A))
    x = np.where(after < 0, 1 + F + A * np.cos(t), 1 - flight * after + F * after**2 / 2)
    guess = np.zeros(2 * H + 1)
    k = np.arange(H + 1)[:, None]
    guess[0], guess[1::2] = x.mean(), (2 * np.cos(k[1:] * Omega * t) * x).mean(1)
    ends = []
    for e in (1e-5, -1e-5):
        problem = HarmonicBalance(SpurPair(zeta=0.0, F_m=F, e=(e,)), H)
        X = solve(problem, guess, {"Omega": Omega}).X
        low, _, high, _ = extrema(X)
        ends.append([low, high])
    np.testing.assert_allclose(np.mean(ends, 0), [bottom, top], atol=1e-7)
