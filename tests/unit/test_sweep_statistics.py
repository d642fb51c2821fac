"""Quantiles of sweeps over many cases, against separately traced curves of each case."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import hbgear as hb


@pytest.fixture(scope="module")
def found():
    with ThreadPoolExecutor(1) as here:
        vary = hb.design.grid(F=[0.05, 0.1, 0.14, 0.18, 0.22])
        return hb.design.cases(hb.Duffing(), vary, ("jumps", "curve"), harmonics=3, span=(0.8, 1.5), executor=here)


def test_chances_and_quantiles(found):
    Omega = np.linspace(0.82, 1.48, 34)
    statistics = hb.design.sweep_statistics(found, Omega, (0.0, 0.5, 1.0))
    rising, falling, both, by_rising, by_falling = [], [], [], [], []
    for F in (0.05, 0.1, 0.14, 0.18, 0.22):
        curve = hb.trace(hb.HarmonicBalance(hb.Duffing(F=F), 3), "Omega", (0.8, 1.5), accuracy=None)
        ends = {jump.direction: jump.value for jump in curve.jumps()}
        up, down = ends.get(1, np.inf), ends.get(-1, -np.inf)
        by_rising.append(up < Omega)
        by_falling.append(down > Omega)
        both.append((Omega <= up) & (Omega >= down) & bool(ends))
        A = curve.amplitude("pp2")
        folds = [p.index for p in curve.special if p.kind == "LP"]
        first, last = (folds[0], folds[-1]) if folds else (len(curve), 0)
        upper = np.interp(Omega, curve.values[:first], A[:first], right=np.nan)
        lower = np.interp(Omega, curve.values[last:], A[last:], left=np.nan)
        rising.append(np.where(up >= Omega, upper, lower))
        falling.append(np.where(down > Omega, upper, lower) if ends else upper)
    assert statistics.jumped_rising == pytest.approx(np.mean(by_rising, axis=0))
    assert statistics.jumped_falling == pytest.approx(np.mean(by_falling, axis=0))
    assert statistics.coexisting == pytest.approx(np.mean(both, axis=0)) and 0 < statistics.coexisting.max() < 1
    assert (statistics.known == 1).all()
    for quantiles, each in ((statistics.rising, rising), (statistics.falling, falling)):
        expected = np.sort(each, axis=0)[[0, 2, 4]]
        np.testing.assert_allclose(quantiles, expected, rtol=1e-2)  # the curves are interpolated between other points


def test_amplitudes_between_points_are_those_of_a_linear_oscillator():
    """Its amplitude is F / |1 - Omega^2 + 2 i zeta Omega|; linear interpolation has an error of .4 %."""
    with ThreadPoolExecutor(1) as here:
        vary = hb.design.grid(F=[0.2])
        linear = hb.design.cases(
            hb.Duffing(k3=0.0), vary, ("jumps", "curve"), harmonics=1, span=(0.5, 1.5), executor=here
        )
    Omega = np.linspace(0.5, 1.5, 1001)
    statistics = hb.design.sweep_statistics(linear, Omega, (0.5,))
    expected = 0.2 / np.abs(1 - Omega**2 + 2j * 0.05 * Omega)
    np.testing.assert_allclose(statistics.rising[0], expected, rtol=1e-4)
    np.testing.assert_allclose(statistics.falling[0], expected, rtol=1e-4)


def test_amplitudes_next_to_a_fold_are_those_of_the_harmonic_balance():
    """With one harmonic (1 - Omega^2 + 3/4 A^2)^2 A^2 + (2 zeta Omega A)^2 = F^2, a cubic in A^2."""
    F, zeta, k3 = 0.2, 0.05, hb.Duffing().k3
    with ThreadPoolExecutor(1) as here:
        hard = hb.design.cases(
            hb.Duffing(), hb.design.grid(F=[F]), ("jumps", "curve"), harmonics=1, span=(0.8, 1.5), executor=here
        )
    ends = {int(direction): end for _, end, direction, *_ in hard.jumps}
    for direction, name, choose in ((1, "rising", max), (-1, "falling", min)):
        Omega = ends[direction] - direction * np.array([0.1, 1e-2, 1e-3, 1e-4, 1e-5])[::direction]
        found = getattr(hb.design.sweep_statistics(hard, Omega, (0.5,)), name)[0]
        for w, A in zip(Omega.tolist(), found.tolist(), strict=True):
            d = 1 - w**2
            cubic = [(0.75 * k3) ** 2, 1.5 * k3 * d, d**2 + (2 * zeta * w) ** 2, -(F**2)]
            roots = np.roots(cubic)
            assert choose(np.sqrt(roots[np.abs(roots.imag) < 1e-9].real)) == pytest.approx(A, rel=1e-4)


def test_invalid_statistics_are_refused(found):
    with pytest.raises(ValueError, match="must be between 0 and 1"):
        hb.design.sweep_statistics(found, quantiles=(2.0,))
    with pytest.raises(ValueError, match="Omega must be a list of ascending values"):
        hb.design.sweep_statistics(found, np.array([1.0, 0.9]))
