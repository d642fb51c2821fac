"""Orders of convergence: folds with the harmonics, sampled forces with the samples, multipliers with the step."""

import numpy as np
import pytest
from machines import Drag, SteepFriction, single_mass

from hbgear import Backlash, Cubic, Duffing, Element, HarmonicBalance, Load, SpurPair, System, Unilateral, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics import Jenkins, KelvinVoigt


def folds(model, H, span, **settings):
    """Folds of the equations with H harmonics themselves, not located with more."""
    curve = trace(HarmonicBalance(model, H, **settings), "Omega", span, stability=False, accuracy=None)
    return np.array([p.parameters["Omega"] for p in curve.special if p.kind == "LP"])


def slope(x, errors):
    """Fitted order: d log error / d log x."""
    return np.polyfit(np.log(x), np.log(errors), 1)[0]


@pytest.mark.parametrize("model", [SpurPair(), SpurPair(eps=(0.1, 0.05))], ids=["constant", "varying stiffness"])
def test_folds_of_a_kinked_law_converge_with_the_cube_of_the_harmonics(model):
    H = np.array([10, 14, 20, 28])
    found = np.array([folds(model, h, (1.5, 0.6)) for h in H])
    errors = np.abs(found - folds(model, 70, (1.5, 0.6)))
    for column in errors.T:
        assert slope(H, column) < -2.7
        assert column[-1] < column[0] / 15


def test_folds_of_a_smooth_law_converge_exponentially():
    """Each further odd harmonic wins more than three digits."""
    span = (0.95, 1.3)
    truth = folds(Duffing(), 15, span)
    errors = np.abs([folds(Duffing(), h, span) - truth for h in (1, 3, 5)])
    assert errors.shape == (3, 2)
    assert np.all(errors[1:] < errors[:-1] / 1000) and np.all(errors[2] < 1e-10)


def test_motion_converges_with_the_harmonics():
    """Rms error of the contact-loss motion: harmonics of a curve with a kinked acceleration fall with k^-4."""
    H = np.array([10, 20, 40, 80])
    X = upper_motion(320)
    errors = [np.linalg.norm(np.pad(x, (0, X.size - x.size)) - X) for x in map(upper_motion, H)]
    assert slope(H, errors) < -3


def upper_motion(H, Omega=0.78):
    problem = HarmonicBalance(SpurPair(), int(H))
    coarse = trace(HarmonicBalance(SpurPair(), 10), "Omega", (1.5, Omega), stability=False, special=False).X[-1]
    return solve(problem, np.pad(coarse, (0, problem.size - coarse.size)), {"Omega": Omega}).X


def test_folds_of_a_sampled_law_converge_with_the_square_of_the_samples():
    exact = folds(SpurPair(), 10, (1.5, 0.6))
    N = np.array([256, 1024, 4096])
    errors = np.abs([folds(SpurPair(), 10, (1.5, 0.6), samples=int(n), sampled=True) - exact for n in N])
    assert slope(N, errors.max(axis=1)) == pytest.approx(-2.0, abs=0.6)


@pytest.mark.parametrize("samples", [512, 1024, 4096])
def test_a_sampled_law_has_no_folds_of_its_own(samples):
    """Tangents of sampled corners jump, so that the curve turns several times next to a fold: that is one fold."""
    exact = folds(SpurPair(zeta=0.03), 10, (1.5, 0.6))
    found = folds(SpurPair(zeta=0.03), 10, (1.5, 0.6), samples=samples, sampled=True)
    np.testing.assert_allclose(found, exact, rtol=0, atol=100.0 / samples**2)


# ---- multipliers


def dragged():
    system = single_mass(Drag(), F=0.8, c=0.05, k=0.2)
    problem = HarmonicBalance(system, 15)
    return problem, problem.start(1.1), 1.1


def parametric():
    """Spur pair with varying stiffness and contact loss: the period is cut where teeth meet and part."""
    problem = HarmonicBalance(SpurPair(eps=(0.3, 0.1)), 20)
    X = trace(problem, "Omega", (1.7, 0.8), stability=False, special=False).X[-1]
    assert problem.switching(X, Omega=0.8).theta.size == 2
    return problem, X, 0.8


def smooth():
    problem = HarmonicBalance(Duffing(k3=1.0, F=0.6), 20)
    return problem, problem.start(0.9), 0.9


def two_laws():
    """A cubic spring and a gap between two masses."""
    elements = [Element([1.0, -1.0], Backlash(0.3)), Element([0.0, 1.0], Cubic(0.5, 0.5))]
    system = System(np.diag([1.0, 2.0]), 0.1 * np.eye(2), 0.3 * np.eye(2), elements, Load([0.2, 0], {1: [0.5, 0]}))
    problem = HarmonicBalance(system, 20)
    return problem, problem.start(0.9), 0.9


@pytest.mark.parametrize(("points", "width"), [(1, 0.1), (2, 0.2), (3, 0.4)])
@pytest.mark.parametrize("case", [dragged, parametric, smooth, two_laws])
def test_multipliers_converge_with_twice_the_points(case, points, width):
    problem, X, Omega = case()
    widths = width * 2.0 ** -np.arange(3)
    truth = np.sort_complex(problem.multipliers(X, points=6, max_step=0.05, Omega=Omega))
    errors = [
        np.abs(np.sort_complex(problem.multipliers(X, points=points, max_step=w, Omega=Omega)) - truth).max()
        for w in widths
    ]
    assert min(errors) > 1e-13
    assert slope(widths, errors) == pytest.approx(2 * points, abs=0.5)


@pytest.mark.parametrize("case", [dragged, parametric, smooth, two_laws])
def test_default_steps_are_fine_enough(case):
    problem, X, Omega = case()
    truth = np.sort_complex(problem.multipliers(X, points=6, max_step=0.05, Omega=Omega))
    np.testing.assert_allclose(np.sort_complex(problem.multipliers(X, Omega=Omega)), truth, atol=1e-7)


@pytest.mark.parametrize("H", [16, 24, 48])
@pytest.mark.parametrize(
    ("law", "Omega"),
    [(SteepFriction(), 0.9), (SteepFriction(), 1.1), (KelvinVoigt(5.0, 0.3, 0.2), 0.8)],
    ids=["near resonance", "beyond resonance", "damped contact"],
)
def test_stated_errors_include_the_effect_of_truncated_harmonics_on_the_others(law, Omega, H):
    """Next to resonance a steep damper returns the force harmonics above H to the motion: stated errors lacked that."""
    model = single_mass(law, F=0.2, c=0.01)
    coarse, fine = HarmonicBalance(model, H), HarmonicBalance(model, 8 * H)
    curve = trace(coarse, "Omega", (Omega, Omega + 1e-4), stability=False, special=False, accuracy=None)
    exact = solve(fine, fine.resized(curve.X[0]), {"Omega": Omega}).X
    change = exact - fine.resized(curve.X[0])
    true = np.sqrt(change[0] ** 2 + 0.5 * np.sum(change[1:] ** 2))
    assert 0.6 < curve.error[0] / true < 1.7


@pytest.mark.slow
@pytest.mark.parametrize("law", [Unilateral(50.0, 0.5), Jenkins(5.0, 0.1)], ids=["stop", "friction"])
def test_stated_errors_along_curves_of_exactly_projected_laws(law):
    """The truncated force harmonics alone state errors of these motions with friction that are up to 7 times too small.

    One in eight motions is checked with twice the harmonics; every fifth motion is compared with eight times as many.
    Next to a fold the stated error may be that of the curve, which is smaller than that of the motion at its Omega.
    """
    model = single_mass(law, F=0.2, c=0.05)
    curve = trace(HarmonicBalance(model, 12), "Omega", (0.3, 2.0), stability=False, special=False)
    fine = curve.problem.with_order(1, 8 * curve.problem.H)
    ratios = []
    for i in range(2, len(curve), 5):
        start, Omega = fine.resized(curve.X[i]), float(curve.values[i])
        true = rms(solve(fine, start, {"Omega": Omega}).X - start)
        if true > 1e-7 * np.linalg.norm(start):  # else there is no contact, or no slip
            assert distance_of_curve(fine, start, Omega) / 3 < curve.error[i] < 4 * true
            ratios.append(curve.error[i] / true)
    assert len(ratios) > 25
    assert 0.8 < np.median(ratios) < 1.25 and np.quantile(ratios, 0.2) > 0.5


def rms(X):
    """Root mean square of a motion of one element."""
    return np.sqrt(X[0] ** 2 + 0.5 * np.sum(X[1:] ** 2))


def distance_of_curve(problem, X, Omega):
    """Distance of a motion from the curve of a problem, by Newton's method with steps of least norm."""
    weight, scale, Y, at = np.full(len(X), np.sqrt(0.5)), Omega / rms(X), X, Omega
    weight[0] = 1.0
    for _ in range(8):
        R, J, slope, _ = problem.linearise(Y, "Omega", Omega=at)
        moved = np.append(weight * (Y - X), (at - Omega) / scale)
        A = np.column_stack([J / weight, slope * scale])
        change = np.linalg.lstsq(A, A @ moved - R)[0] - moved
        Y, at = Y + change[:-1] / weight, at + change[-1] * scale
    assert np.linalg.norm(change) < 1e-6 * np.linalg.norm(moved)
    return rms(Y - X)
