"""Invariance of the motion: size of a backlash that is not crossed, and equivalent formulations of a model."""

from dataclasses import dataclass

import numpy as np
import pytest

from hbgear import Cubic, Duffing, Element, HarmonicBalance, SpurPair, System, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.gears import DoubleHelicalPair

OMEGAS = (1.3, 0.95, 0.9, 0.88)


def motions(model, harmonics=12):
    """X, multipliers and regimes at OMEGAS, by continuation down from Omega = 1.6."""
    problem = HarmonicBalance(model, harmonics)
    out, X, Omega = {}, None, 1.6
    for target in OMEGAS:
        curve = trace(problem, "Omega", (Omega, target), X, stability=False, special=False)
        assert curve.status == "reached_end"
        # Newton steps to rounding accuracy: the comparison is stricter than the tolerance of a trace
        X, Omega = curve.X[-1], target
        for _ in range(2):
            R, J = problem.evaluate(X, Omega=Omega)
            X = X - np.linalg.solve(J, R)
        out[target] = X, problem.multipliers(X, Omega=Omega), problem.regime(X, Omega=Omega)
    return out


@pytest.fixture(scope="module")
def reference():
    return motions(DoubleHelicalPair())


@pytest.mark.parametrize("W", [-0.6, 0.6])
def test_backlash_that_is_not_crossed_only_shifts_the_gap(W, reference):
    """Without back contact d is shifted by b_c W; amplitudes and multipliers do not depend on W, to 1e-9."""
    regimes = []
    for Omega, (X, mu, regime) in motions(DoubleHelicalPair(W=W)).items():
        X0, mu0, regime0 = reference[Omega]
        shift = np.zeros((2, X.size // 2))
        shift[:, 0] = W
        np.testing.assert_allclose(X, X0 + shift.ravel(), atol=1e-9)
        rms, rms0 = (np.sqrt(0.5 * (x.reshape(2, -1)[:, 1:] ** 2).sum(-1)) for x in (X, X0))
        np.testing.assert_allclose(rms, rms0, atol=1e-9)
        np.testing.assert_allclose(np.sort_complex(mu), np.sort_complex(mu0), atol=1e-9)
        np.testing.assert_array_equal(regime, regime0)
        regimes.append(regime[0])
    assert set(regimes) == {0, 1}  # permanent contact and impacts both occur


def test_jump_frequencies_do_not_know_the_backlash():
    found = []
    for W in (-0.6, 0.0, 0.6):
        problem = HarmonicBalance(DoubleHelicalPair(zeta=0.05, W=W), 8)
        curve = trace(problem, "Omega", (1.0, 0.83), stability=False)
        found.append([p.parameters["Omega"] for p in curve.special])
    np.testing.assert_allclose(found, [found[0]] * 3, atol=1e-9)
    assert len(found[0]) == 4


def test_a_backlash_that_is_crossed_does_change_the_motion():
    """Counter-check: with W = -0.99 teeth touch on their backs, and the amplitude changes by more than 1e-2."""
    problem = HarmonicBalance(DoubleHelicalPair(W=-0.99), 12)
    curve = trace(problem, "Omega", (1.6, 0.9), stability=False, special=False)
    full = trace(HarmonicBalance(DoubleHelicalPair(), 12), "Omega", (1.6, 0.9), stability=False, special=False)
    assert curve.regime.max() == 2
    assert (
        np.abs(curve.amplitude() - np.interp(curve.values[::-1], full.values[::-1], full.amplitude()[::-1])[::-1]).max()
        > 1e-2
    )


def traced(model, Omega, H=12):
    problem = HarmonicBalance(model, H)
    X = trace(problem, "Omega", (1.5, Omega), stability=False, special=False).X[-1]
    return problem, X


def test_origin_of_time():
    """With constant stiffness, a cosine error is the sine error shifted by a quarter period."""
    (a, X), (b, Y) = (traced(SpurPair(phase=phase), 0.78) for phase in ("cos", "sin"))
    shifted = X.copy()
    k = np.arange(1, a.H + 1)
    c = (X[1::2] - 1j * X[2::2]) * np.exp(-0.5j * np.pi * k)
    shifted[1::2], shifted[2::2] = c.real, -c.imag
    np.testing.assert_allclose(Y, shifted, atol=1e-8)
    np.testing.assert_allclose(a.multipliers(X, Omega=0.78), b.multipliers(Y, Omega=0.78), atol=1e-8)


def test_direction_of_an_element():
    """With reversed direction and error the gap changes its sign, and the motion is the same."""
    model = SpurPair(eps=(0.1,))
    base = model.system()
    (gap,) = base.elements
    other = Element([-1.0], gap.law, gap.displacement.scaled(-1.0), gap.damping)
    turned = System(base.M, base.C, base.K, [other], base.load)
    (a, X), (b, Y) = traced(model, 0.9), traced(turned, 0.9)
    np.testing.assert_allclose(Y, -X, atol=1e-8)
    np.testing.assert_allclose(a.motion(X, Omega=0.9), b.motion(Y, Omega=0.9), atol=1e-8)


def test_order_of_coordinates_and_elements(rng):
    """A permutation of the 24 coordinates and of the two elements gives the same motion."""
    base = DoubleHelicalPair(stagger=0.4).system()
    p = rng.permutation(24)
    (load,) = base.load
    elements = [Element(e.direction[p], e.law, e.displacement, e.damping) for e in base.elements[::-1]]
    mixed = System(
        base.M[np.ix_(p, p)], base.C[np.ix_(p, p)], base.K[np.ix_(p, p)], elements, type(load)(load.constant[p])
    )
    a, b = HarmonicBalance(base, 6), HarmonicBalance(mixed, 6)
    X = a.start(1.2)
    Y = solve(b, X.reshape(2, -1)[::-1].ravel(), {"Omega": 1.2}).X
    np.testing.assert_allclose(Y.reshape(2, -1)[::-1].ravel(), X, atol=1e-9)
    # the mean of the free rotation is arbitrary, so only the harmonics are compared
    np.testing.assert_allclose(b.motion(Y, Omega=1.2)[:, 1:], a.motion(X, Omega=1.2)[p, 1:], atol=1e-9)


def test_two_periods_are_two_periods():
    """Over two periods (nu = 2) the residual of a motion is zero too, and its multipliers are the squares."""
    problem, X = traced(SpurPair(eps=(0.1,)), 0.9)
    doubled = problem.with_order(2)
    Y = doubled.from_layout(X, problem.layout)
    np.testing.assert_allclose(doubled.residual(Y, Omega=0.9), 0, atol=1e-9)
    mu, mu2 = problem.multipliers(X, Omega=0.9), doubled.multipliers(Y, Omega=0.9)
    np.testing.assert_allclose(np.sort_complex(mu2), np.sort_complex(mu**2), atol=1e-7)


@dataclass(frozen=True)
class Referred(Cubic):
    """A cubic spring with a given reference stiffness."""

    kr: float = 1.0

    @property
    def reference(self):
        return self.kr


@pytest.mark.parametrize("kr", [0.01, 1.0, 20.0])
def test_reference_stiffness_changes_nothing(kr):
    """The reference stiffness conditions the linear equations; motions and multipliers must not depend on it."""
    base = Duffing().system()
    other = System(base.M, base.C, base.K, [Element([1.0], Referred(0.1, 0.0, kr))], base.load)
    a, b = HarmonicBalance(base, 7), HarmonicBalance(other, 7)
    X = a.start(1.0)
    np.testing.assert_allclose(b.evaluate(X, Omega=1.0)[1], a.evaluate(X, Omega=1.0)[1], atol=1e-10)
    np.testing.assert_allclose(b.residual(X, Omega=1.0), 0, atol=1e-9)
    fine = {"max_step": 0.02, "points": 5, "Omega": 1.0}
    np.testing.assert_allclose(b.multipliers(X, **fine), a.multipliers(X, **fine), atol=1e-9)
    # also with the default steps
    np.testing.assert_allclose(b.multipliers(X, Omega=1.0), a.multipliers(X, **fine), atol=1e-7)
