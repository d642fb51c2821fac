"""Amplitude peaks against the closed form of one harmonic, and followed in a second parameter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from hbgear import Duffing, HarmonicBalance, SpurPair, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.continuation.switch import switch
from hbgear.gears import DoubleHelicalPair
from hbgear.harmonic import AmplitudeExtremum
from hbgear.harmonic.bifurcations.peaks import peaks


def closed_form(zeta, k3=0.1, F=0.18):
    """Peak of A of [(1 - W^2 + 3/4 k3 A^2)^2 + (2 zeta W)^2] A^2 = F^2: W^2 = 1 + 3/4 k3 A^2 - 2 zeta^2."""

    def square(A):
        return 1 + 0.75 * k3 * A * A - 2 * zeta**2

    A = brentq(lambda A: A * A * (4 * zeta**4 + 4 * zeta**2 * square(A)) - F * F, 1e-3, 20.0, xtol=1e-15, rtol=1e-14)
    return np.sqrt(square(A)), A


@pytest.fixture(scope="module")
def duffing():
    return trace(HarmonicBalance(Duffing(), 1), "Omega", (0.5, 1.6))


@pytest.fixture(scope="module")
def spur():
    """Resonances with the first, second and third harmonic of the mesh."""
    return trace(HarmonicBalance(SpurPair(zeta=0.1, e=(0.04, 0.01, 0.01)), 8), "Omega", (1.4, 0.25), stability=False)


@pytest.mark.parametrize("measure", ["H1", "rms"])
def test_peak_of_one_harmonic(duffing, measure):
    (peak,) = peaks(duffing, measure)
    Omega, A = closed_form(0.05)
    assert peak.label == "PK1" and peak.kind == "PK" and peak.located
    assert peak.parameters["Omega"] == pytest.approx(Omega, rel=0, abs=1e-10)
    assert peak.amplitude("H1") == pytest.approx(A, rel=0, abs=1e-10)


@pytest.mark.parametrize("measure", ["max", "pp2"])
def test_peak_of_an_extremum(duffing, measure):
    """No Newton for these: a search along the curve, exact in the amplitude and to its square root in the frequency."""
    (peak,) = peaks(duffing, measure)
    Omega, A = closed_form(0.05)
    assert peak.amplitude(measure) == pytest.approx(A, rel=0, abs=1e-11)
    assert peak.parameters["Omega"] == pytest.approx(Omega, rel=0, abs=1e-6)


def test_peaks_followed_in_the_damping(duffing):
    (peak,) = peaks(duffing, "H1")
    for end in (0.02, 0.3):
        curve = trace(AmplitudeExtremum(duffing.problem, "Omega", "H1"), "zeta", (0.05, end), peak)
        assert curve.status == "reached_end"
        for i in (0, len(curve) // 3, len(curve) // 2, -1):
            Omega, A = closed_form(float(curve.values[i]))
            assert curve.tracked["Omega"][i] == pytest.approx(Omega, rel=0, abs=1e-9)
            assert curve.amplitude("H1")[i] == pytest.approx(A, rel=0, abs=1e-9)


@pytest.mark.parametrize("measure", ["rms", "H1", "H2", "H3"])
def test_no_neighbouring_motion_is_larger(spur, measure):
    """Every peak against motions of the same curve a little to both sides, and their number against the rows."""
    found = peaks(spur, measure, accuracy=None)
    A = spur.amplitude(measure)
    assert len(found) == np.sum((A[1:-1] > A[:-2]) & (A[1:-1] > A[2:])) >= 1
    for peak in found:
        top = peak.amplitude(measure)
        assert top >= A[peak.index] - 1e-12
        assert peak.interval[0] != peak.interval[1] and peak.note == f"peak of {measure}"
        for shift in (-1e-4, 1e-4):
            Omega = peak.parameters["Omega"] + shift
            X = solve(spur.problem, peak.X, {**peak.parameters, "Omega": Omega}).X
            assert spur.layout.measure(measure, X) < top


def test_the_amplitude_is_flat_at_a_peak(spur, slope):
    for peak in peaks(spur, "rms"):

        def rms(Omega, peak=peak):
            X = solve(spur.problem, peak.X, {**peak.parameters, "Omega": Omega}).X
            return float(spur.layout.measure("rms", X))

        assert slope(rms, peak.parameters["Omega"], h=1e-5) == pytest.approx(0.0, abs=1e-6)


def test_peaks_are_numbered_along_the_curve(spur):
    found = peaks(spur, "rms")
    assert [p.label for p in found] == [f"PK{i}" for i in range(1, len(found) + 1)]
    assert [p.index for p in found] == sorted(p.index for p in found)
    frequencies = [p.parameters["Omega"] for p in found]
    assert frequencies == sorted(frequencies, reverse=True)


def test_a_peak_of_one_of_two_meshes():
    pair = DoubleHelicalPair(stagger=0.5)
    curve = trace(HarmonicBalance(pair, 4), "Omega", (1.0, 0.8), stability=False)
    left, right = (peaks(curve, "H1", element) for element in (0, 1))
    by_name = peaks(curve, "H1", curve.layout.elements[1])
    assert left and len(right) == len(by_name)
    for a, b in zip(right, by_name, strict=True):
        np.testing.assert_array_equal(a.X, b.X)
    assert left[0].parameters["Omega"] != right[0].parameters["Omega"]


def test_a_peak_of_a_subharmonic():
    """Half the frequency of the mesh, in the doubled motions of a pair that only its varying stiffness excites."""
    curve = trace(HarmonicBalance(SpurPair(F_m=0.1, eps=(0.3,), e=()), 6), "Omega", (2.3, 1.7))
    doubled = switch(curve, "PD1", (1.0, 2.3), stability=False)
    A = doubled.amplitude("H1/2")
    (peak,) = (p for p in peaks(doubled, "H1/2") if p.parameters["Omega"] < 1.8)
    assert peak.amplitude("H1/2") == pytest.approx(A.max(), rel=1e-3) and peak.amplitude("H1/2") >= A.max() - 1e-12


def test_a_monotonic_branch_has_no_peak():
    curve = trace(HarmonicBalance(SpurPair(), 3), "Omega", (2.5, 1.8), stability=False)
    assert peaks(curve, "rms") == ()


def test_without_a_problem(duffing):
    with pytest.raises(ValueError, match="peaks need the problem; load the branch with load"):
        peaks(replace(duffing, problem=None))


def test_no_such_measure(duffing):
    with pytest.raises(ValueError, match="no measure 'rsm'; there are rms"):
        peaks(duffing, "rsm")
    with pytest.raises(ValueError, match="no harmonic 'H2' among H = 1"):
        peaks(duffing, "H2")
    with pytest.raises(KeyError, match="no element 'gap'; choose one of 'x'"):
        peaks(duffing, "rms", "gap")


def test_the_largest_peak_alone(spur):
    every, largest = peaks(spur, "rms"), peaks(spur, "rms", share=0.99)
    assert len(every) > 2 and len(largest) == 1
    best = max(every, key=lambda p: p.amplitude("rms"))
    np.testing.assert_array_equal(largest[0].X, best.X)
