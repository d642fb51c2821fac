"""Floquet multipliers from Hill's matrix, which knows nothing of switching instants, against those of `stability`.

    x = e^{lambda t} p(t), p of the period T of the motion:   [lambda^2 + lambda (2 zeta + 2 D) + J] p = 0
    mu = e^{lambda T}

J is the Jacobian of the balance and D the derivative in time, both (2N + 1) square in the real basis; the eigenvalues
with |Im lambda| <= omega / 2 are the multipliers. The stiffness jumps where contact begins and ends, so its harmonics
fall like 1/k and those of p like 1/k^3.
"""

import numpy as np
import pytest
from machines import Drag, single_mass

import hbgear as hb
from hbgear import HarmonicBalance, SpurPair, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.multipliers.hill import CondensedHillMatrix, hill_multipliers
from hbgear.mechanics.series.fourier import resize

N = np.array([10, 20, 40, 80, 160])
# model, Omega, where the trace that leads there begins
CASES = {
    "constant stiffness": (SpurPair(), 0.78, 1.5),
    "varying stiffness": (SpurPair(eps=(0.3, 0.1)), 0.8, 1.7),
    "unstable by period doubling": (SpurPair(e=(0.10,)), 1.5, 2.4),
    "upper motion": (SpurPair(e=(0.10,)), 0.65, 2.4),
}


def hill(J, omega, zeta):
    """Multipliers from the Jacobian of a balance with basis frequency omega, one for each eigenvalue in the strip."""
    n = len(J)
    k = np.arange(1, n // 2 + 1)
    D = np.zeros((n, n))
    D[2 * k - 1, 2 * k], D[2 * k, 2 * k - 1] = omega * k, -omega * k
    first_order = np.block([[np.zeros((n, n)), np.eye(n)], [-J, -2 * D - 2 * zeta * np.eye(n)]])
    exponents = np.linalg.eigvals(first_order)
    # rounding puts a negative multiplier's exponents on either side of the edge of the strip
    inside = exponents[np.abs(exponents.imag) <= omega / 2 * (1 + 1e-6)]
    return np.exp(inside * 2 * np.pi / omega)


def apart(found, truth):
    """Largest distance of a true multiplier from the nearest one found."""
    return max(np.abs(found - mu).min() for mu in truth)


def motion(model, Omega, H, near):
    problem = HarmonicBalance(model, H)
    return problem, solve(problem, resize(near, H), {**model.parameters, "Omega": Omega}).X


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """Model, Omega, a coarse motion, the fine problem, its motion, and its multipliers by `stability`."""
    model, Omega, start = CASES[request.param]
    near = trace(HarmonicBalance(model, 20), "Omega", (start, Omega), stability=False, special=False).X[-1]
    fine, X = motion(model, Omega, 320, near)
    return model, Omega, near, fine, X, fine.multipliers(X, points=6, Omega=Omega)


def order(errors):
    return np.polyfit(np.log(N), np.log(errors), 1)[0]


def test_the_matrix_of_a_motion_converges_with_the_cube_of_its_harmonics(case):
    model, Omega, _, fine, X, truth = case
    J = fine.evaluate(X, Omega=Omega)[1]
    errors = [apart(hill(J[: 2 * n + 1, : 2 * n + 1], Omega, model.zeta), truth) for n in N]
    assert order(errors) == pytest.approx(-3.0, abs=0.2)
    assert errors[-1] < 5e-7


def test_the_balance_linearised_is_better_than_the_motion_it_gives(case):
    """With the motion of N harmonics, Hill's matrix is that of the balance itself: its errors nearly cancel.

    The multipliers along that motion err like N^-3. Both meet as N grows.
    """
    model, Omega, near, _, _, truth = case
    of_balance, along = [], []
    for n in N:
        problem, X = motion(model, Omega, int(n), near)
        of_balance.append(apart(hill(problem.evaluate(X, Omega=Omega)[1], Omega, model.zeta), truth))
        along.append(apart(problem.multipliers(X, points=6, Omega=Omega), truth))
    assert order(along) == pytest.approx(-3.0, abs=0.3)
    assert of_balance[-1] < 5e-8 and along[-1] < 5e-7
    assert max(of_balance) < 2e-5


def test_in_contact_throughout_it_is_exact():
    problem = HarmonicBalance(SpurPair(b=0.0), 5)
    X = problem.start(0.75)
    J = problem.evaluate(X, Omega=0.75)[1]
    assert apart(hill(J, 0.75, 0.05), problem.multipliers(X, Omega=0.75)) < 1e-12


@pytest.mark.parametrize("law", [hb.Cubic(1.0), hb.Unilateral(8.0, 0.1)])
def test_states_that_decay_fast_do_not_replace_others(law):
    """A Maxwell element with a weak damper has a multiplier below 1e-9, whose vectors fill all harmonics."""
    C = [[0.05, 0.0], [0.0, 0.05]]
    system = hb.System(
        np.diag([1.0, 0.0]), C, [[1.5, -0.5], [-0.5, 0.5]], [hb.Element([0, 1], law)], hb.Load(cosine={1: [0.3, 0.0]})
    )
    problem = HarmonicBalance(system, 32)
    X = problem.start(Omega=0.9)
    truth = problem.multipliers(X, Omega=0.9)
    assert np.abs(truth).min() < 1e-9
    assert apart(hill_multipliers(problem.compiled({}), X, 0.9), truth) < 5e-3


@pytest.mark.slow
def test_one_copy_of_each_exponent_is_chosen():
    """Copies shifted by i omega lie close to the middle of the harmonics as well where several orders resonate."""
    springs = [hb.Element([1, 0], hb.Unilateral(5.0, 0.1)), hb.Element([1, -1], hb.Cubic(0.5))]
    system = hb.System(
        np.eye(2), [[0.07, -0.05], [-0.05, 0.07]], [[1.2, -0.2], [-0.2, 2.2]], springs, hb.Load(cosine={1: [0.3, 0.1]})
    )
    curve = trace(HarmonicBalance(system, 24), "Omega", (0.23, 0.26), special=False, accuracy=None)
    errors = [
        apart(hill_multipliers(curve.problem.compiled({}), p.X, p.parameters["Omega"]), p.multipliers) for p in curve
    ]
    assert max(errors) < 0.02


@pytest.mark.parametrize("law", [Drag(c=0.3, cubic=0.2), hb.Backlash(b=0.3, k=2.0)])
def test_the_rate_of_the_condensed_matrix_is_its_derivative_in_the_exponent(law):
    """D(s) has receptances and, for laws of the velocity, slopes that depend on s: both are differentiated."""
    balance, s, step = HarmonicBalance(single_mass(law, F=0.5), 5), 0.03 + 0.4j, 1e-6
    X = balance.start(Omega=0.9)
    matrix = CondensedHillMatrix.of(balance.compiled({}), X, 0.9)
    assert (matrix.C is not None) == isinstance(law, Drag)
    above, below = (matrix.matrix(matrix.receptances(z)[0], z) for z in (s + step, s - step))
    rate = matrix.rate(*matrix.receptances(s), s)
    np.testing.assert_allclose(rate, (above - below) / (2 * step), rtol=0, atol=1e-8 * np.abs(rate).max())
