"""Stability under stiffness with corners, against closed forms.

Meissner's equation x'' + (a + b sgn cos w t) x = 0 is a chain of two oscillators: its multipliers are those of a
product of three rotations.
"""

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb

TURN = 2 * np.pi


def rotation(k: float, c: float, time: float) -> np.ndarray:
    """What x'' + c x' + k x = 0 makes of (x, x') in a time."""
    w, decay = np.sqrt(k - c**2 / 4), np.exp(-c * time / 2)
    cos, sin = np.cos(w * time), np.sin(w * time)
    return decay * np.array([[cos + c / 2 / w * sin, sin / w], [-k / w * sin, cos - c / 2 / w * sin]])


def oscillator(stiffness, c: float = 0.0) -> hb.System:
    spring = hb.mechanics.PiecewiseLinear((), (1.0,), stiffness=stiffness)
    return single_mass(spring, c=c, k=0.0, name="x")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
@pytest.mark.parametrize("method", ["balance", "shooting"])
def test_meissner(method):
    k = hb.mechanics.Periodic.rectangular(high=4.2, low=3.8, share=0.5, start=-np.pi / 2)
    model = oscillator(k)
    if method == "balance":
        problem = hb.HarmonicBalance(model, 3)
        mu = problem.multipliers(np.zeros(problem.size), Omega=1.0)
    else:
        mu = hb.time.shoot(model, 1.0, [0.0, 0.0], tolerance=1e-13).multipliers
    true = rotation(4.2, 0, np.pi / 2) @ rotation(3.8, 0, np.pi) @ rotation(4.2, 0, np.pi / 2)
    np.testing.assert_allclose(np.sort(mu.real), np.sort(np.linalg.eigvals(true).real), rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.sort(mu), [0.99324962, 1.00679626], rtol=0, atol=5e-9)  # as published


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
@pytest.mark.parametrize("nu", [1, 2])
@pytest.mark.parametrize("Omega", [0.3, 1.0, 2.7])
def test_any_share_and_damping(Omega, nu):
    k, c, T = hb.mechanics.Periodic.rectangular(high=2.5, low=0.4, share=0.37, start=1.9), 0.07, TURN / Omega
    problem = hb.HarmonicBalance(oscillator(k, c), 4, nu=nu)
    mu = problem.multipliers(np.zeros(problem.size), Omega=Omega)
    true = np.linalg.eigvals(rotation(2.5, c, 0.37 * T) @ rotation(0.4, c, 0.63 * T)) ** nu
    np.testing.assert_allclose(np.sort_complex(mu), np.sort_complex(true), rtol=0, atol=1e-10 * max(1.0, *np.abs(true)))


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
def test_ramps_and_tables_in_the_limit_of_many_steps():
    """A straight ramp is the limit of stairs, whose error goes with the square of their number."""
    Omega, n = 0.8, np.array([200, 400])
    k = hb.mechanics.Periodic.trapezoidal(high=1.6, low=0.6, share=0.2, ramp=0.3)
    problem = hb.HarmonicBalance(oscillator(k, 0.02), 3)
    trace_ = sum(problem.multipliers(np.zeros(problem.size), Omega=Omega)).real
    found = []
    for count in n:
        chain = np.eye(2)
        for start, end in ((0.0, 0.3), (0.3, 0.5), (0.5, 0.8), (0.8, 1.0)):
            steps = count if k(np.array((start + end) / 2 * TURN), 1) else 1
            for i in range(steps):
                middle = start + (end - start) * (i + 0.5) / steps
                chain = rotation(float(k(TURN * middle)), 0.02, TURN / Omega * (end - start) / steps) @ chain
        found.append(np.trace(chain))
    limit = found[1] + (found[1] - found[0]) / 3
    assert abs(found[1] - limit) < 1e-4 and trace_ == pytest.approx(limit, abs=1e-8)
