"""Harmonic balance held against time integration (whose orders are measured in unit/test_timedomain.py)."""

from dataclasses import dataclass

import numpy as np
import pytest

from hbgear import Cubic, Duffing, Element, HarmonicBalance, Load, SpurPair, System, trace
from hbgear.mechanics import Law
from hbgear.time import integrate, shoot, sweep
from hbgear.time.integration import state_of
from hbgear.time.steady_state import SteadyStateSettings

DRIVEN = SpurPair(eps=(0.2,), e=(0.08,))


def test_the_exponential_method_meets_corners_exactly():
    """With contact lost and regained in each period the error is still that of rounding."""
    y = np.array([1.4, 0.3])
    true = integrate(DRIVEN, y, 4, 0.8, tolerance=1e-13)
    found = integrate(DRIVEN, y, 4, 0.8, method="exponential", steps=12)
    assert true.d.min() < 0.9 < 1.1 < true.d.max()
    np.testing.assert_allclose(found.end, true.end, rtol=0, atol=1e-11)


@pytest.mark.parametrize("method", ["RK45", "Radau", "exponential"])
def test_methods_agree(method):
    y = np.array([1.4, 0.3])
    true = integrate(DRIVEN, y, 3, 0.8, tolerance=1e-13).end
    np.testing.assert_allclose(integrate(DRIVEN, y, 3, 0.8, method=method).end, true, rtol=0, atol=3e-8)


@pytest.mark.parametrize(("model", "H", "Omega"), [(Duffing(), 21, 1.05), (SpurPair(), 300, 0.9)])
def test_dop853_closes_motions_of_harmonic_balance(model, H, Omega):
    problem = HarmonicBalance(model, H)
    X = problem.start(Omega)
    y = state_of(problem, X, **model.parameters, Omega=Omega)
    end = integrate(model, y, 1, Omega, tolerance=1e-13).end
    # what the harmonics above H leave goes with H^-3 in the velocity of a kinked law
    assert np.linalg.norm(end - y) < (1e-9 if isinstance(model, Duffing) else 1e-7)
    orbit = shoot(model, Omega, y)
    assert orbit.closure < 1e-10 and np.linalg.norm(orbit.state - y) < 1e-6


def test_sweeps_jump_where_the_folds_are():
    curve = trace(HarmonicBalance(SpurPair(), 20), "Omega", (0.9, 0.65))
    low, high = sorted(curve[label].parameters["Omega"] for label in ("LP1", "LP2"))
    grid = np.arange(0.68, 0.86, 0.01)
    settling = SteadyStateSettings(1e-5)
    for direction, fold in (("up", high), ("down", low)):
        (jump,) = sweep(SpurPair(), grid, direction, settling=settling).jumps
        a, b = sorted(jump.interval)
        assert a <= fold <= b and b - a < 0.0101


def test_two_attractors():
    """kahraman_singh_fah010 at Omega = 0.65."""
    model, found = SpurPair(e=(0.10,)), []
    curve = trace(HarmonicBalance(model, 24), "Omega", (0.9, 0.5))
    for i in np.flatnonzero(np.diff(np.sign(curve.values - 0.65))):
        X = curve.problem.start(0.65) if not curve.stable[i] else curve.X[i]
        if curve.stable[i]:
            orbit = shoot(model, 0.65, state_of(curve.problem, X, **curve.parameters_at(int(i))))
            found.append(float(np.sqrt(0.5 * np.sum(orbit.rows(20)[0, 1:] ** 2))))
    assert sorted(found) == pytest.approx([0.05141, 0.34055], abs=2e-5)


@dataclass(frozen=True)
class Steep(Law):
    """p = .1 tanh(x / scale), of the displacement or of its rate."""

    scale: float
    rate: bool

    def force(self, d, v, tau):
        p = np.tanh((v if self.rate else d) / self.scale)
        slope, none = 0.1 / self.scale * (1 - p * p), 0 * d
        return 0.1 * p, *((none, slope) if self.rate else (slope, none))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "load"),
    [(Steep(0.01, True), {1: [0.5]}), (Steep(0.01, False), {1: [0.5]}), (Cubic(5.0), {1: [0.2], 15: [20.0]})],
    ids=["steep damper", "steep spring", "cubic spring with a large motion"],
)
def test_the_exponential_method_takes_as_many_steps_as_a_law_requires(law, load):
    """Springs at rest and the excitation alone require 16 to 80 steps, with errors of 4e-3 to 1e-2."""
    model = System([[1.0]], [[0.1]], [[1.0]], [Element([1.0], law)], Load([0.3], load))
    Omega, periods = (0.3, 1) if 15 in load else (1.3, 3)
    true = integrate(model, [0.3, 0.1], periods, Omega, tolerance=1e-12).end
    found = integrate(model, [0.3, 0.1], periods, Omega, method="exponential")
    np.testing.assert_allclose(found.end, true, rtol=0, atol=3e-8)
    assert np.abs(integrate(model, [0.3, 0.1], periods, Omega, method="exponential", steps=80).end - true).max() > 1e-6
