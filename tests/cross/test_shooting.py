"""Harmonic balance against time integration: motions close, multipliers and special points agree."""

import numpy as np
import pytest
from cross.shooting import integrate, shoot, state
from machines import single_mass
from scipy.integrate import solve_ivp
from scipy.optimize import linear_sum_assignment, root

from hbgear import Duffing, HarmonicBalance, SpurPair, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.gears import DoubleHelicalPair
from hbgear.mechanics import PiecewiseLinear

FINE = {"points": 5, "max_step": 0.3}


def motion(model, Omega, H, start=1.6, coarse=12):
    """A motion reached from a start with few harmonics, then solved with H."""
    X = trace(HarmonicBalance(model, coarse), "Omega", (start, Omega), stability=False, special=False).X[-1]
    problem = HarmonicBalance(model, H)
    rows = X.reshape(problem.m, -1)
    X = np.pad(rows, ((0, 0), (0, 2 * (H - coarse)))).ravel()
    return problem, solve(problem, X, {"Omega": Omega}).X


def middle(model, Omega, H):
    """The unstable motion between two folds."""
    problem = HarmonicBalance(model, H)
    curve = trace(problem, "Omega", (1.5, 0.6), stability=False)
    first, second = (p.index for p in curve.special if p.kind == "LP")
    x = curve.values[first : second + 1] - Omega
    (i,) = np.flatnonzero(x[:-1] * x[1:] < 0) + first
    return problem, trace(problem, "Omega", (curve.values[i], Omega), curve[int(i)], stability=False).X[-1]


def distance(a, b):
    """Largest distance between two sets of multipliers matched in pairs; a may hold fewer."""
    D = np.abs(np.asarray(a)[:, None] - np.asarray(b))
    return D[linear_sum_assignment(D)].max()


def test_shooting_itself():
    """A linear oscillator: the motion, and multipliers exp(lambda T), are known."""
    system = SpurPair(b=0.0).system()
    y, period = shoot(system, 0.8, np.zeros(2))
    q = 0.1 + (1 + 0.08j) * 0.05 / (1 - 0.64 + 0.08j)
    np.testing.assert_allclose(y, [q.real, -0.8 * q.imag], atol=1e-10)
    poles = -0.05 + 1j * np.sqrt(1 - 0.05**2) * np.array([1, -1])
    assert distance(np.linalg.eigvals(period.monodromy), np.exp(poles * 2 * np.pi / 0.8)) < 1e-10


def test_shooting_follows_the_lines_of_a_law():
    """Three stages with asymmetrical corners: integration over lines is that of the law itself with small steps."""
    law = PiecewiseLinear((-0.4, 0.1, 0.5), (2.0, 0.5, 1.0, 3.0), 0.2)
    system = single_mass(law, F=1.0, mean=0.1, k=0.1)
    y0 = np.array([0.3, 0.6])
    period = integrate(system, 0.9, y0)
    assert len(period.instants) >= 4

    def f(t, y):
        p = law.force(y[:1], y[1:], np.zeros(1))[0][0]
        return np.array([y[1], 0.1 + np.cos(0.9 * t) - 0.1 * y[1] - 0.1 * y[0] - p])

    whole = solve_ivp(f, (0, 2 * np.pi / 0.9), y0, method="DOP853", rtol=1e-9, atol=1e-11, max_step=0.02)
    np.testing.assert_allclose(period.end, whole.y[:, -1], atol=1e-8)
    disturbed = [
        integrate(system, 0.9, y0 + 1e-6 * e).end - integrate(system, 0.9, y0 - 1e-6 * e).end for e in np.eye(2)
    ]
    np.testing.assert_allclose(period.monodromy, np.transpose(disturbed) / 2e-6, atol=1e-6)


SINGLE = {
    "Duffing": (Duffing(), 1.09, 25, 1e-9),
    "SpurPair": (SpurPair(), 0.78, 160, 1e-9),
    "SpurPair, varying stiffness": (SpurPair(eps=(0.1, 0.05)), 0.8, 160, 1e-8),
    "SpurPair, contact on both sides": (SpurPair(zeta=0.02, b=0.1, e=(0.2,)), 0.9, 160, 1e-7),
}


@pytest.mark.parametrize("name", SINGLE)
def test_motions_close_under_integration(name):
    model, Omega, H, tolerance = SINGLE[name]
    problem, X = motion(model, Omega, H)
    y = state(problem, X, Omega=Omega)
    true, period = shoot(model.system(), Omega, y)
    # a velocity cut off at H is one order behind its displacement
    np.testing.assert_allclose((y - true) / [1, 100], 0, atol=tolerance)
    np.testing.assert_allclose(
        np.sort(period.instants) * Omega, np.sort(problem.switching(X, Omega=Omega).theta), atol=1e3 * tolerance
    )
    # the multipliers are those of the truncated motion: an order of H behind it
    mu = problem.multipliers(X, Omega=Omega, **FINE)
    assert distance(mu, np.linalg.eigvals(period.monodromy)) < 1e-6


def test_double_sided_contact_is_among_them():
    model, Omega, *_ = SINGLE["SpurPair, contact on both sides"]
    problem, X = motion(model, Omega, 20)
    assert problem.regime(X, Omega=Omega) == [2]


@pytest.mark.parametrize(
    ("model", "Omega"), [(SpurPair(), 0.76), (SpurPair(eps=(0.1, 0.05)), 0.7)], ids=["constant", "varying"]
)
def test_an_unstable_motion_closes_too(model, Omega):
    problem, X = middle(model, Omega, 100)
    y = state(problem, X, Omega=Omega)
    true, period = shoot(model.system(), Omega, y)
    np.testing.assert_allclose(y, true, atol=1e-7)
    mu = problem.multipliers(X, Omega=Omega, **FINE)
    assert mu[0].real > 1.05
    assert distance(mu, np.linalg.eigvals(period.monodromy)) < 3e-6


def test_motions_converge_to_the_integrated_one():
    """Displacement with the cube, velocity with the square of the harmonics, at any one instant."""
    model, Omega, H, gaps = SpurPair(), 0.78, np.array([15, 30, 60, 120, 240]), []
    true = None
    for h in H[::-1]:
        problem, X = motion(model, Omega, int(h))
        y = state(problem, X, Omega=Omega)
        true = shoot(model.system(), Omega, y, tolerance=1e-13)[0] if true is None else true
        gaps.append(np.abs(y - true))
    slopes = np.polyfit(np.log(H[::-1]), np.log(gaps), 1)[0]
    assert slopes[0] < -2.7 and slopes[1] < -1.7


@pytest.mark.slow
def test_double_helical_pair():
    """24 coordinates with impacts on both helices: 46 multipliers and the rotation's double +1."""
    model, Omega = DoubleHelicalPair(), 0.92
    problem, X = motion(model, Omega, 60, start=1.2)
    assert problem.regime(X, Omega=Omega).tolist() == [1, 1]
    true, period = shoot(model.system(), Omega, state(problem, X, Omega=Omega), tolerance=1e-11)
    np.testing.assert_allclose(
        problem_gaps(problem, true, Omega), problem_gaps(problem, state(problem, X, Omega=Omega), Omega), atol=1e-6
    )
    mu, all_mu = problem.multipliers(X, Omega=Omega, **FINE), np.linalg.eigvals(period.monodromy)
    assert distance(mu, all_mu) < 1e-6
    free = np.sort(np.abs(all_mu - 1))[:2]
    assert free.max() < 1e-5


def problem_gaps(problem, y, Omega):
    """Gaps and their velocities at tau = 0: what the free rotation does not touch."""
    system = problem.model.system()
    e = np.array([element.displacement.row() for element in system.elements])
    return np.concatenate([system.W.T @ y[:24] - e[:, 0] - e[:, 1::2].sum(1), system.W.T @ y[24:]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "H"), [(SpurPair(eps=(0.1, 0.05)), 100), (Duffing(), 25)], ids=["SpurPair", "Duffing"]
)
def test_folds_are_those_of_the_true_motion(model, H):
    """The folds found by shooting, {y(T) = y, det(Phi - 1) = 0}, from the located ones."""
    problem, system = HarmonicBalance(model, H), model.system()
    curve = trace(problem, "Omega", (1.5, 0.6), stability=False)

    def equations(u):
        period = integrate(system, u[2], u[:2])
        return np.append(period.end - u[:2], np.linalg.det(period.monodromy - np.eye(2)))

    folds = [p for p in curve.special if p.kind == "LP"]
    assert len(folds) == 2
    for fold in folds:
        Omega = fold.parameters["Omega"]
        found = root(equations, np.append(state(problem, fold.X, Omega=Omega), Omega), tol=1e-12)
        assert np.abs(found.fun).max() < 1e-10
        assert found.x[2] == pytest.approx(Omega, abs=1e-9)


def test_period_doubling_of_the_true_motion():
    """At a located period doubling with impacts a multiplier of the integrated motion is -1."""
    model = SpurPair(e=(0.1,))
    problem = HarmonicBalance(model, 80)
    curve = trace(problem, "Omega", (2.2, 1.9))
    (point,) = [p for p in curve.special if p.kind == "PD"]
    Omega = point.parameters["Omega"]
    _, period = shoot(model.system(), Omega, state(problem, point.X, Omega=Omega))
    assert np.abs(np.linalg.eigvals(period.monodromy) + 1).min() < 1e-5
