"""Friction between teeth against event-exact motions, computed apart.

x'' + 2 zeta x' + along(tau) g(x) = F,    y'' + 2 zeta_y w_y y' + w_y^2 y = across(tau) g(x),    g: gap -2 < x < 0
"""

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.continuation.solvers.newton import solve

ALONG, ACROSS = hb.gears.tooth_friction(1.6, 0.8, 0.1, lever=1.0, lever_slope=0.5)


def pair(across=True):
    """Return the pair with or without the motion y across the line of action."""
    teeth = hb.mechanics.PiecewiseLinear((-2.0, 0.0), (1.0, 0.0, 1.0), stiffness=ALONG)
    if not across:
        return single_mass(teeth, mean=0.2, k=0.0)
    side = hb.mechanics.Directed(hb.mechanics.PiecewiseLinear((-2.0, 0.0), (1.0, 0.0, 1.0), stiffness=ACROSS))
    elements = [
        hb.Element([1.0, 0.0], teeth),
        *hb.mechanics.VectorElement([[1.0, 0.0], [0.0, -1.0]], side, name="side"),
    ]
    return hb.System(np.eye(2), np.diag([0.1, 0.17]), np.diag([0.0, 1.7**2]), elements, hb.Load([0.2, 0.0]))


CASES = [
    (
        0.7,
        [0.33913332389053075, -0.03930945944805254, 0.017501604104399084, -0.0013784470458906716],
        [0.12608265778126393, 0.009912745067244155],
        -0.4435418989565796 + 0.4591492546902813j,
    ),
    (
        0.95,
        [0.3504632192250289, 0.3207499480921336, 0.00015752814533536659, 0.010076303358439431],
        [0.24218647633552057, 0.0031086506832738807],
        0.15125565326832435 + 0.7023220112404595j,
    ),
]
"""Omega, state (x, x', y, y') at tau = 0, rms of the alternating parts, and a multiplier."""


@pytest.mark.slow
@pytest.mark.parametrize(("Omega", "state", "rms", "multiplier"), CASES)
def test_motions(Omega, state, rms, multiplier):
    state = np.array(state)[[0, 2, 1, 3]]
    orbit = hb.time.shoot(pair(), Omega, state + 1e-3)
    np.testing.assert_allclose(orbit.state, state, rtol=0, atol=1e-9)
    assert np.abs(orbit.multipliers - multiplier).min() < 1e-8
    one, rows = hb.HarmonicBalance(pair(across=False), 31), orbit.rows(31)
    X = solve(one, rows[0], {"Omega": Omega}).X
    assert np.sqrt(0.5 * (X[1:] ** 2).sum()) == pytest.approx(rms[0], abs=2e-6)
    assert np.abs(one.multipliers(X, Omega=Omega) - multiplier).min() < 1e-4


def test_force_across_is_sampled():
    Omega, state, rms, _ = CASES[1]
    orbit = hb.time.shoot(pair(), Omega, np.array(state)[[0, 2, 1, 3]])
    problem = hb.HarmonicBalance(pair(), 15, samples=4096)
    X = solve(problem, orbit.rows(15).ravel(), {"Omega": Omega}).X
    q = problem.motion(X, Omega=Omega)
    np.testing.assert_allclose(np.sqrt(0.5 * (q[:, 1:] ** 2).sum(axis=1)), rms, rtol=0, atol=1e-5)


def test_mean_factors_and_refusals():
    tau = 2 * np.pi * (np.arange(1000) + 0.5) / 1000  # between the jumps
    s = tau / (2 * np.pi)
    pairs = [np.where(x < 1.6, (1 + 0.1 * np.sign(x - 0.8) * (1 + 0.5 * (x - 0.8))) / 1.6, 0.0) for x in (s, s + 1)]
    np.testing.assert_allclose(ALONG(tau), sum(pairs), rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="pitch_point"):
        hb.gears.tooth_friction(1.6, 1.7, 0.1)
    with pytest.raises(ValueError, match="coefficient"):
        hb.gears.tooth_friction(1.6, 0.8, -0.1)
