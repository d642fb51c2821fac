"""Special points against theory: multipliers, orders of convergence, cusps, critical values.

| point | property |
|---|---|
| LP | a multiplier is +1; the error decreases at least as H^-3 |
| PD | a multiplier is -1 |
| CP | two folds at 1e-6 below the cusp, none at 1e-6 above; same location by shooting |
| critical value | a jump at 0.5 % on one side, none on the other |
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cross.shooting import state
from cross.shooting_branch import Shooter
from scipy.optimize import brentq, minimize_scalar

from hbgear import HarmonicBalance, SpurPair, StepControl, trace
from hbgear.analysis.critical_parameters import critical_parameter
from hbgear.continuation import FoldProblem
from hbgear.continuation.numerics.linear import solve_linear
from hbgear.continuation.solvers.newton import solve
from hbgear.gears import DoubleHelicalPair
from hbgear.harmonic import PeriodDoublingProblem
from hbgear.mechanics.series.fourier import resize

CUSP = {"Omega": 0.85722108, "zeta": 0.11800747}


def folds(branch):
    return [p for p in branch.special if p.kind == "LP"]


def refined(kind, model, H, point):
    """Solve for a special point with H harmonics; return problem, X and Omega."""
    problem = HarmonicBalance(model, H)
    start = np.append(resize(point.X, H), point.parameters["Omega"])
    U = solve(kind(problem), start, point.parameters).X
    return problem, U[:-1], float(U[-1])


def distance_from(value, problem, X, Omega):
    """Distance of the nearest multiplier from a value, +1 or -1."""
    return float(np.abs(problem.multipliers(X, points=6, Omega=Omega) - value).min())


# ---- folds


@pytest.fixture(scope="module")
def curve():
    """Curve of kahraman_singh_fah005 through both folds."""
    return trace(HarmonicBalance(SpurPair(), 20), "Omega", (1.5, 0.6), stability=False)


@pytest.mark.parametrize("label", ["LP1", "LP2"])
def test_a_fold_converges_at_least_with_the_cube_of_the_harmonics(curve, label):
    H = np.array([10, 14, 20, 28, 40, 56, 80])
    truth = refined(FoldProblem, SpurPair(), 320, curve[label])[2]
    errors = [abs(refined(FoldProblem, SpurPair(), int(h), curve[label])[2] - truth) for h in H]
    assert np.polyfit(np.log(H), np.log(errors), 1)[0] < -3.0
    assert errors[0] < (4.2e-7 if label == "LP1" else 1.8e-7) and errors[-1] < 1e-10


@pytest.mark.parametrize("label", ["LP1", "LP2"])
def test_newton_converges_quadratically_on_a_fold(curve, label):
    """Residuals of plain Newton on {R, g}, relative to the forces: each at most 20 times the square of the previous."""
    problem, point = FoldProblem(HarmonicBalance(SpurPair(), 20)), curve[label]
    truth = np.append(point.X, point.parameters["Omega"])
    U, residuals = truth + 2e-4 * np.cos(np.arange(len(truth))), []
    for _ in range(5):
        now = problem.linearise(U, "zeta", **SpurPair().parameters)
        residuals.append(float(np.linalg.norm(now.R)) / now.size)
        U = U - solve_linear(now.dR_dX, now.R)
    rounding = 8 * np.finfo(float).eps * np.sqrt(len(truth))  # rounding error of the residual, relative to its terms
    assert residuals[0] > 0.1 and residuals[-1] < rounding
    for last, new in pairwise(residuals):
        assert new < 20 * last**2 + rounding
    np.testing.assert_allclose(U, truth, rtol=0, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("label", ["LP1", "LP2"])
def test_a_multiplier_is_one_at_a_fold(curve, label):
    """The multiplier at the fold of H harmonics differs from 1 by O(H^-3), and by less than 1e-8 at H = 800."""
    H = np.array([40, 80, 160])
    errors = [distance_from(1, *refined(FoldProblem, SpurPair(), int(h), curve[label])) for h in H]
    assert np.polyfit(np.log(H), np.log(errors), 1)[0] < -2.85
    assert distance_from(1, *refined(FoldProblem, SpurPair(), 800, curve[label])) < 1e-8


@pytest.mark.parametrize("model", [SpurPair(eps=(0.3,), e=()), SpurPair(eps=(0.1, 0.05))], ids=["alone", "with error"])
def test_a_multiplier_is_one_at_a_fold_with_varying_stiffness(model):
    coarse = trace(HarmonicBalance(model, 20), "Omega", (1.5, 0.6), stability=False)
    assert len(folds(coarse)) == 2
    for point in folds(coarse):
        assert distance_from(1, *refined(FoldProblem, model, 200, point)) < 1e-6


# ---- period doublings


@pytest.mark.parametrize(
    ("model", "span", "coarse", "fine", "error"),
    [
        pytest.param(SpurPair(e=(0.10,)), (2.1, 1.1), 40, 400, 1e-8, id="contact loss, kahraman_singh_fah010"),
        pytest.param(SpurPair(eps=(0.3,), e=()), (2.3, 1.8), 20, 40, 1e-9, id="varying stiffness, a smooth motion"),
    ],
)
def test_a_multiplier_is_minus_one_at_a_period_doubling(model, span, coarse, fine, error):
    points = [p for p in trace(HarmonicBalance(model, coarse), "Omega", span).special if p.kind == "PD"]
    assert len(points) == 2
    for point in points:
        assert distance_from(-1, *refined(PeriodDoublingProblem, model, fine, point)) < error


# ---- cusps


def fold_curve(problem, zeta, end):
    curve = trace(problem, "Omega", (1.3, 0.8), at={"zeta": zeta}, stability=False)
    return trace(FoldProblem(problem), "zeta", (zeta, end), folds(curve)[0], steps=StepControl(max_step=0.1))


def test_cusp_to_eight_digits():
    found = fold_curve(HarmonicBalance(SpurPair(), 80), 0.117, 0.119)
    assert [p.label for p in found.special] == ["CP1"] and found["CP1"].located
    for name, value in CUSP.items():
        assert found["CP1"].parameters[name] == pytest.approx(value, rel=0, abs=5e-9)


@pytest.mark.parametrize("before", [1e-7, 3e-7, 1e-6])
def test_a_cusp_next_to_a_row_has_an_error(before):
    """The error is estimated to 10 % although the cusp with more harmonics lies before the first point."""
    coarse, settings = HarmonicBalance(SpurPair(), 10), StepControl(first_step=0.03, max_step=0.03)
    cusp = fold_curve(coarse, 0.117, 0.119)["CP1"].parameters["zeta"]
    near = fold_curve(coarse, 0.117, cusp - before)
    found = trace(FoldProblem(coarse), "zeta", (cusp - before, 0.119), near[-1], steps=settings)["CP1"]
    assert found.parameters["zeta"] == pytest.approx(cusp, rel=0, abs=1e-10)
    assert abs(cusp - CUSP["zeta"]) == pytest.approx(found.error, rel=0.1)


@pytest.mark.slow
def test_the_same_cusp_by_shooting():
    """At the cusp the maximum along the curve of the Omega component of the tangent is zero, beyond it negative."""
    near, coarse = 0.118, HarmonicBalance(SpurPair(), 10)
    X = trace(coarse, "Omega", (1.3, 0.87), at={"zeta": near}, stability=False, special=False).X[-1]
    shooter = Shooter(SpurPair(zeta=near), cells=24)
    first = shooter.orbit(state(coarse, X, Omega=0.87, zeta=near), 0.87)
    rows = shooter.curve(replace(first, tangent=-first.tangent), (0.84, 0.8701), longest=0.02).orbits
    i = 1 + int(np.argmax([orbit.tangent[-1] for orbit in rows[1:-1]]))
    a, chord = rows[i - 1].u, rows[i + 1].u - rows[i - 1].u

    def on_curve(zeta, s):
        u = a + s * chord
        return Shooter(SpurPair(zeta=zeta), cells=24).orbit(u[:-1], float(u[-1]), chord / np.linalg.norm(chord))

    def top(zeta):
        def falling(s):
            return -on_curve(zeta, s).tangent[-1]

        s = minimize_scalar(falling, bounds=(0, 1), method="bounded", options={"xatol": 1e-6}).x
        return on_curve(zeta, s)

    zeta = brentq(lambda z: top(z).tangent[-1], 0.1179, 0.1181, xtol=1e-11)
    assert zeta == pytest.approx(CUSP["zeta"], rel=0, abs=5e-9)
    assert top(zeta).Omega == pytest.approx(CUSP["Omega"], rel=0, abs=2e-8)


@pytest.mark.parametrize(("shift", "count"), [(-1e-6, 2), (1e-6, 0)])
def test_folds_a_hair_below_the_cusp_and_none_above(shift, count):
    problem = HarmonicBalance(SpurPair(), 24)
    zeta, Omega, wide = 0.118007465867 + shift, 0.8572210826, 4e-5
    X = trace(problem, "Omega", (1.3, Omega + wide), at={"zeta": zeta}, stability=False, special=False).X[-1]
    curve = trace(problem, "Omega", (Omega + wide, Omega - wide), X, at={"zeta": zeta}, stability=False)
    assert curve.status == "reached_end" and len(folds(curve)) == count


# ---- critical values


# critical value with 32 harmonics, and Omega
CRITICAL = {"zeta": (0.06115863, 0.88253), "torque": (1196.4704, 0.88149), "eps_scale": (1.034328, 0.88004)}


@pytest.mark.parametrize("name", CRITICAL)
def test_critical_value_of_the_double_helical_pair(name):
    """The curve has two folds at 0.5 % on one side of the critical value, and none at 0.5 % on the other."""
    model, (value, Omega) = DoubleHelicalPair(), CRITICAL[name]
    problem = HarmonicBalance(model, 12)
    found = critical_parameter(problem, name, frequencies=(0.92, 0.84))
    assert abs(found.value - value) <= 3 * found.point.error + 5e-7 * value and found.point.error <= 1e-5 * value
    assert found.Omega == pytest.approx(Omega, abs=2e-5)
    span = (found.Omega + 0.03, found.Omega - 0.03)
    below, above = (
        len(folds(trace(problem, "Omega", span, at={name: found.value * factor}, stability=False)))
        for factor in (0.995, 1.005)
    )
    assert (below, above) == ((2, 0) if found.jump_below else (0, 2))
    assert found.jump_below == (name != "eps_scale")


@pytest.mark.slow
def test_a_pair_that_crosses_just_before_a_fold():
    """In one segment a pair enters the unit circle and a real multiplier passes +1: both points are located."""
    problem = HarmonicBalance(DoubleHelicalPair(zeta=0.03), 16)
    coarse = trace(problem, "Omega", (1.0, 0.7))
    fine = trace(
        problem, "Omega", (1.0, 0.7), steps=StepControl(first_step=0.004, max_step=0.004)
    )  # the points lie in different segments
    assert [p.kind for p in coarse.special] == [p.kind for p in fine.special]
    for a, b in zip(coarse.special, fine.special, strict=True):
        assert a.located and a.parameters["Omega"] == pytest.approx(b.parameters["Omega"], abs=1e-8)
    assert coarse["LP2"].parameters["Omega"] - coarse["NS2"].parameters["Omega"] > 1e-4
    for label in ("NS1", "NS2"):
        mu = coarse[label].multipliers
        # multipliers of the truncated motion differ from the zero of Hill's determinant by their truncation error
        assert np.min(np.abs(np.abs(mu[np.abs(mu.imag) > 1e-3]) - 1)) < 1e-6
