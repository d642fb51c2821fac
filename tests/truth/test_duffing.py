"""Duffing's oscillator with one harmonic against the cubic equation, and its free motion against elliptic integrals.

    A^2 [(1 - Omega^2 + 3/4 k3 A^2)^2 + (2 zeta Omega)^2] = F^2         (H = 1, exact)
    T = 4 K(m) / sqrt(1 + k3 A^2),   m = k3 A^2 / (2 (1 + k3 A^2))      (free, undamped, exact)

Folds and peak with more harmonics are compared with the reference numbers of the project.
"""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk

from hbgear import Duffing, HarmonicBalance, trace
from hbgear.continuation.solvers.newton import solve

CASES = [Duffing(), Duffing(k3=-0.05, F=0.1), Duffing(zeta=0.02, k3=1.0, F=0.1), Duffing(k3=0.3, F=0.05, zeta=0.1)]


def detuning(m, Omega, A):
    """1 - Omega^2 + 3/4 k3 A^2."""
    return 1 - Omega**2 + 0.75 * m.k3 * A**2


@pytest.mark.parametrize("m", CASES, ids=str)
def test_one_harmonic_is_the_closed_form_all_along_the_curve(m):
    curve = trace(HarmonicBalance(m, 1), "Omega", (0.4, 1.8), stability=False)
    assert curve.status == "reached_end" and len(curve) > 60
    Omega, (mean, a, b) = curve.values, curve.X.T
    A = curve.amplitude("H1")
    np.testing.assert_allclose(A**2 * (detuning(m, Omega, A) ** 2 + (2 * m.zeta * Omega) ** 2), m.F**2, rtol=1e-10)
    np.testing.assert_allclose(mean, 0, atol=1e-12)
    # phase: a detuning + b 2 zeta Omega = F, b detuning = a 2 zeta Omega
    np.testing.assert_allclose(b * detuning(m, Omega, A), 2 * m.zeta * Omega * a, atol=1e-10)


def frequency(m, A, side):
    """Omega at which the H = 1 response has the amplitude A, on the low (-1) or high (+1) side of the backbone.

    Omega^4 - (2 c - 4 zeta^2) Omega^2 + c^2 - F^2/A^2 = 0 with c = 1 + 3/4 k3 A^2.
    """
    c = 1 + 0.75 * m.k3 * A**2
    half = c - 2 * m.zeta**2
    return np.sqrt(half + side * np.sqrt(half**2 - c**2 + (m.F / A) ** 2))


def test_one_harmonic_folds_are_where_the_closed_form_turns():
    """dOmega/dA = 0 on the high side of the backbone: Omega to 1e-10, amplitude to 1e-5."""
    m, h = Duffing(), 1e-4
    curve = trace(HarmonicBalance(m, 1), "Omega", (0.5, 1.6))

    def slope(A):
        def f(A):
            return frequency(m, A, 1)

        return (8 * (f(A + h) - f(A - h)) - f(A + 2 * h) + f(A - 2 * h)) / (12 * h)

    for label, bracket in (("LP1", (1.3, 1.64)), ("LP2", (0.9, 1.3))):
        A = brentq(slope, *bracket, xtol=1e-13)
        assert curve[label].parameters["Omega"] == pytest.approx(frequency(m, A, 1), abs=1e-10)
        assert curve[label].amplitude("H1") == pytest.approx(A, abs=1e-5)


def test_peak_of_one_harmonic_and_its_stability():
    """The peak is A = F / (2 zeta sqrt(1 + 3/4 k3 A^2 - zeta^2)) to 1e-3; only the middle branch is unstable."""
    m = Duffing()
    curve = trace(HarmonicBalance(m, 1), "Omega", (0.5, 1.6))
    peak = brentq(lambda A: A * 2 * m.zeta * np.sqrt(1 + 0.75 * m.k3 * A**2 - m.zeta**2) - m.F, 1.0, 2.0)
    assert curve.amplitude("H1").max() <= peak + 1e-12
    assert curve.amplitude("H1").max() == pytest.approx(peak, rel=1e-3)
    first, second = (curve[label].index for label in ("LP1", "LP2"))
    inside = np.zeros(len(curve), dtype=bool)
    # near a fold the distance of the multiplier from 1 is smaller than its truncation error
    inside[first + 3 : second - 2] = True
    outside = np.ones(len(curve), dtype=bool)
    outside[first - 3 : second + 4] = False
    assert not curve.stable[inside].any() and curve.stable[outside].all()


@pytest.mark.parametrize(("k3", "A"), [(0.1, 1.65), (1.0, 1.2), (-0.2, 0.8)])
def test_undamped_free_motion(k3, A):
    """The mean of the amplitudes with small forces +F and -F is the amplitude of the free motion, to 5e-8."""
    T = 4 * ellipk(k3 * A**2 / 2 / (1 + k3 * A**2)) / np.sqrt(1 + k3 * A**2)
    Omega = 2 * np.pi / T
    found = []
    for F in (2e-5, -2e-5):
        problem = HarmonicBalance(Duffing(zeta=0.0, k3=k3, F=F), 15)
        X = solve(problem, np.eye(31)[1] * A, {"Omega": Omega}).X
        found.append(X[1::2].sum())
    assert found[0] != found[1]
    assert np.mean(found) == pytest.approx(A, abs=5e-8)
