"""Contact damping against event-exact motions of x'' + 2 zeta x' + f = F cos(Omega t), computed apart."""

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.solvers.newton import solve


def rattle(zeta, load, law):
    return hb.System([[1.0]], [[2 * zeta]], [[0.0]], [hb.Element([1.0], law)], hb.Load(cosine={1: [load]}))


@pytest.mark.parametrize(
    ("Omega", "load", "state", "rms", "multiplier"),
    [
        (
            0.35, 0.1, [1.4865780092665437, 0.22537209656330362], 0.9554283813037127,
            -0.514810453981267 + 0.22371943202854108j,
        ),
        (
            0.6, 0.2, [1.4016452791927674, 1.190594011168507], 1.4944114150264478,
            0.08912937448722495 + 0.32252230115645636j,
        ),
    ],
)  # fmt: skip
def test_hunt_crossley(Omega, load, state, rms, multiplier):
    model = rattle(0.005, load, hb.mechanics.HuntCrossley(k=1.0, damping=0.4, gap=1.0, sides=2))
    orbit = hb.time.shoot(model, Omega, np.add(state, 1e-3))
    np.testing.assert_allclose(orbit.state, state, rtol=0, atol=1e-9)
    assert np.abs(orbit.multipliers - multiplier).min() < 1e-8
    problem = hb.HarmonicBalance(model, 31)
    rows = orbit.rows(31)
    X = solve(problem, rows.ravel(), {"Omega": Omega}).X
    assert np.sqrt(0.5 * (X[1:] ** 2).sum()) == pytest.approx(rms, rel=2e-5)
    assert np.abs(problem.multipliers(X, Omega=Omega) - multiplier).min() < 1e-3


def test_restitution():
    """A mass that hits a Hertzian stop at v rebounds at about v (1 - 2/3 damping v)."""
    law = hb.mechanics.HuntCrossley(k=1e4, damping=0.01, exponent=1.5)
    mass = hb.System([[1.0]], [[0.0]], [[0.0]], [hb.Element([1.0], law)], hb.Load())
    motion = hb.time.integrate(mass, [-0.05, 1.0], 1, 2 * np.pi / 0.4)
    assert -motion.end[1] == pytest.approx(1 - 2 / 3 * 0.01, abs=2e-4)
