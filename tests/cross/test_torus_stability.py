"""Growth of disturbances of tori against closed forms, multipliers of periodic motions, and time integration."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
import scipy
from machines import single_mass, two_masses

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.autonomous.tori.basis import TorusBasis
from hbgear.harmonic.autonomous.tori.stability import growth_of

RATIO = math.sqrt(2.0)
ZETA, K3, F = 0.05, 0.1, 0.4


def duffing() -> hb.System:
    return single_mass(hb.Cubic(K3), F=F, c=2 * ZETA, name="x")


def two_tones(second: float, span: tuple[float, float], harmonics=(7, 7)) -> hb.Branch:
    load = hb.Load(cosine={1: [second]})
    return hb.analysis.two_tones(duffing(), RATIO, span, load=load, harmonics=harmonics)


@pytest.fixture(scope="module")
def curve() -> hb.Branch:
    """A curve with two folds."""
    return two_tones(0.02, (1.15, 1.4))


@pytest.mark.slow
def test_growth_of_an_oscillator_is_its_damping_where_disturbances_rotate(curve):
    """The product of both factors is exp(-2 zeta T) (Liouville); they are equal where disturbances rotate."""
    expected = np.exp(-ZETA * 2 * math.pi / curve.values)
    factor = np.abs(curve.multipliers[:, 0])
    rotates = np.abs(factor - expected) < 1e-2 * expected
    rotates &= curve.modulus_error < 1e-3
    assert rotates.sum() > 30
    assert np.all(np.abs(factor - expected)[rotates] <= np.maximum(3 * curve.modulus_error[rotates], 1e-6))


def test_stability_changes_at_the_folds(curve):
    first, last = curve["LP1"].index, curve["LP2"].index
    assert curve.stability[first - 2] == "stable" and set(curve.stability[first + 2 : last - 1]) == {"unstable"}
    assert np.abs(curve.multipliers[[first, last], 0]) == pytest.approx(1.0, abs=1e-8)  # one multiplier is 1 at a fold
    assert [jump.after.stable for jump in curve.jumps()] == [True, True]


def test_figures_mark_the_folds_of_tori_and_name_a_stable_line(curve):
    ax = hb.plot.torus(curve)
    drawn = {line.get_gid(): line for line in ax.lines}
    for label in ("LP1", "LP2"):
        x, y = drawn[label].get_data()
        assert x[0] == curve[label].parameters["Omega"] and y[0] == pytest.approx(curve[label].amplitude("pp2"))
    named = [line for line in ax.lines if line.get_label() == "quasi-periodic"]
    assert [line.get_linestyle() for line in named] == ["-"]
    plt.close(ax.figure)


def test_weak_second_load_gives_the_multipliers_of_the_periodic_motion():
    """The change is of second order in the second load."""
    periodic = hb.trace(hb.HarmonicBalance(duffing(), 9), "Omega", (1.15, 1.4))
    i = (periodic["LP1"].index + periodic["LP2"].index) // 2
    problem = hb.harmonic.TwoToneProblem(duffing(), RATIO, hb.Load(cosine={1: [1e-5]}), harmonics=(9, 3))
    tori = hb.trace(
        problem,
        "Omega",
        (periodic.values[i], periodic.values[i] + 1e-4),
        cover=False,
        accuracy=None,
        start=_as_torus(problem, periodic[i]),
    )
    assert abs(tori.multipliers[0, 0]) == pytest.approx(np.abs(periodic.multipliers[i]).max(), abs=1e-7)


def _as_torus(problem, point):
    c = np.zeros((1, len(problem.basis.k)), dtype=complex)
    rows = point.X[0], point.X[1::2] - 1j * point.X[2::2]
    for i, (k1, k2) in enumerate(problem.basis.k.tolist()):
        if k2 == 0:
            c[0, i] = rows[0] if k1 == 0 else rows[1][k1 - 1]
    X = problem.basis.to_real(c).ravel()
    return np.append(X, RATIO * point.parameters["Omega"])


def test_unstable_motion_departs_at_the_rate_of_growth(curve):
    """Time integration of a small disturbance of an unstable motion."""
    i = (curve["LP1"].index + curve["LP2"].index) // 2
    Omega, growth = curve.values[i], math.log(abs(curve.multipliers[i, 0]))
    basis = curve.layout.basis
    c = basis.to_complex(curve.X[i])
    w = basis.k @ np.array([Omega, RATIO * Omega])
    start = [basis.evaluate(c, np.zeros((1, 2)))[0], basis.evaluate(1j * w * c, np.zeros((1, 2)))[0]]
    period, turned, count = 2 * math.pi / Omega, 20, 100

    def rates(t, y):
        gap = (c @ np.exp(1j * w * t)).real
        return [y[1], -2 * ZETA * y[1] - (1 + 3 * K3 * gap**2) * y[0]]

    times = period * np.array([turned, turned + count])
    found = scipy.integrate.solve_ivp(rates, (0, times[-1]), [1.0, 0.0], "DOP853", times, rtol=1e-9, atol=1e-12)
    first, last = np.linalg.norm(found.y, axis=0)
    assert math.log(last / first) / count == pytest.approx(growth, abs=5e-3)

    def full(t, y):
        load = F * math.cos(Omega * t) + 0.02 * math.cos(RATIO * Omega * t)
        return [y[1], load - 2 * ZETA * y[1] - y[0] - K3 * y[0] ** 3]

    times, small = period * np.array([6, 22]), 1e-7
    both = [
        scipy.integrate.solve_ivp(
            full, (0, times[-1]), np.add(start, [e, 0.0]), "DOP853", times, rtol=1e-12, atol=1e-13
        ).y
        for e in (small, -small)
    ]
    first, last = np.linalg.norm(both[0] - both[1], axis=0)
    assert math.log(last / first) / 16 == pytest.approx(growth, abs=0.1 * growth)


@pytest.fixture(scope="module")
def masses():
    """A part of the tori of two masses, see `test_tori`."""
    curve = hb.trace(hb.HarmonicBalance(two_masses(), 7), "Omega", (1.1, 1.15))
    return hb.analysis.torus(curve, "NS1", (1.1, 1.15), harmonics=(7, 10))


@pytest.mark.slow
def test_distance_from_a_torus_decays_at_the_rate_of_growth(masses):
    """Time integration of two motions that begin next to each other; their distance along the torus is taken off."""
    i = int(np.argmin(np.abs(masses.values - 1.13)))
    problem, at = masses.problem, masses.parameters_at(i)
    Omega, basis = at["Omega"], problem.basis
    period, rho = 2 * math.pi / Omega, 2 * math.pi * at["Omega_2"] / Omega
    q = problem.motion(masses.X[i], **at)
    w = basis.k @ np.array([Omega, at["Omega_2"]])

    def state(phi, order=0):
        """Return the state of the section at a second phase, or its derivative in it."""
        c = q * (1j * basis.k[:, 1]) ** order
        theta = np.array([[0.0, phi]])
        return np.concatenate([basis.evaluate(c, theta)[:, 0], basis.evaluate(1j * w * c, theta)[:, 0]])

    M, C = np.diag([1.0, 0.05]), np.array([[0.015, -0.013], [-0.013, 0.013]])
    K = np.array([[1.0453, -0.0453], [-0.0453, 0.0453]])

    def rates(t, y):
        d = y[0], y[0] - y[1]
        f = np.array([0.13 * math.cos(Omega * t) - d[0] ** 3 - 0.0042 * d[1] ** 3, 0.0042 * d[1] ** 3])
        return np.concatenate([y[2:], np.linalg.solve(M, f - C @ y[2:] - K @ y[:2])])

    growth, count = math.log(abs(masses.multipliers[i, 0])), 60
    y, small, logs = state(0.0) + 1e-6 * np.array([1.0, 0.5, -0.3, 0.2]), 1e-6, []
    y0 = state(0.0)
    for p in range(count):
        y, y0 = (scipy.integrate.solve_ivp(rates, (0, period), one, rtol=1e-10, atol=1e-13).y[:, -1] for one in (y, y0))
        t = state((p + 1) * rho, 1)
        t /= np.linalg.norm(t)
        w_ = y - y0
        w_ -= t * (t @ w_)
        logs.append(math.log(np.linalg.norm(w_) / small))
        y = y0 + small * w_ / np.linalg.norm(w_)
    assert masses.stability[i] == "stable"
    assert np.mean(logs[10:]) == pytest.approx(growth, abs=0.1 * abs(growth))


@pytest.mark.parametrize("harmonics", [(3, 3), (3, 4), (5, 4), (5, 6)])
def test_stated_error_covers_the_truncation(masses, harmonics):
    """The growth of a torus with few harmonics differs from that of the fine one by less than its stated error."""
    i = int(np.argmin(np.abs(masses.values - 1.13)))
    at, fine = masses.parameters_at(i), math.log(abs(masses.multipliers[i, 0]))
    coarse = hb.harmonic.TorusProblem(masses.problem.balance, TorusBasis(*harmonics, odd=True))
    rows = [coarse.basis.convert(masses.layout.rows(masses.X[i], j), masses.layout.basis) for j in (0, 1)]
    guess, here = np.append(np.concatenate(rows), at["Omega_2"]), {"Omega": at["Omega"]}
    X = solve(coarse.with_borders_at(guess, here), guess, here).X
    found = growth_of(coarse, X, here)
    assert abs(found.rate - fine) <= found.error < 100 * abs(found.rate - fine)
    assert coarse.layout.spectrum_end(X[:-1]) > 1e-3


def test_contacts_with_dampers_have_no_stability():
    system = single_mass(hb.mechanics.KelvinVoigt(1.0, 0.1, 1.0), F=0.1, name="x")
    load = hb.Load(cosine={1: [0.05]})
    curve = hb.analysis.two_tones(system, RATIO, (0.4, 0.45), load=load, harmonics=(4, 4))
    assert set(curve.stability) == {"unknown"}
    assert f"stability not determined at {len(curve)} of {len(curve)} points: the force of contacts" in curve.message
