"""Contact damping against event-exact motions of x'' + 2 zeta x' + f = F cos(Omega t), computed apart."""

from itertools import pairwise

import numpy as np
import pytest
import scipy
from machines import single_mass

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.series.fourier import evaluate


def rattle(zeta, load, law, mean=0.0):
    return single_mass(law, F=load, mean=mean, c=2 * zeta, k=0.0)


def samples(law, X, Omega, N=1 << 16):
    """Return force coefficients from N samples."""
    theta, H = 2 * np.pi * np.arange(N) / N, len(X) // 2
    c = np.fft.rfft(law.force(evaluate(X, theta), Omega * evaluate(X, theta, 1), theta)[0])[: H + 1] / N
    return np.concatenate([[c[0].real], np.column_stack([2 * c[1:].real, -2 * c[1:].imag]).ravel()])


PLAIN = hb.mechanics.KelvinVoigt(1.0, 0.1, 1.0, sides=2)
CLIPPED = hb.mechanics.ClippedKelvinVoigt(1.0, 0.3, 1.0, sides=2)


@pytest.mark.parametrize(
    "law",
    [
        hb.mechanics.KelvinVoigt(1.3, 0.4, 0.2, 2),
        hb.mechanics.ClippedKelvinVoigt(1.3, 0.4, 0.2, 2),
        hb.mechanics.KelvinVoigt(1.3, 0.4, -0.2),
        hb.mechanics.ClippedKelvinVoigt(1.3, 0.4, 0.1),
    ],
)
def test_forces_and_derivatives(law):
    problem, n, Omega = hb.HarmonicBalance(rattle(0.05, 0.2, law), 7), 15, 0.7
    X = np.random.default_rng(1).standard_normal(n) / np.r_[1, np.repeat(np.arange(1, 8) ** 1.5, 2)]
    np.testing.assert_allclose(problem.compiled({}).forces(X, Omega)[0], samples(law, X, Omega), rtol=0, atol=3e-5)
    found, h = problem.linearise(X, "Omega", Omega=Omega), 1e-6
    difference = [
        problem.residual(X + h * e, Omega=Omega) - problem.residual(X - h * e, Omega=Omega) for e in np.eye(n)
    ]
    np.testing.assert_allclose(found.dR_dX, np.transpose(difference) / (2 * h), rtol=0, atol=3e-9)
    difference = problem.residual(X, Omega=Omega + h) - problem.residual(X, Omega=Omega - h)
    np.testing.assert_allclose(found.dR_dp, difference / (2 * h), rtol=0, atol=3e-9)


@pytest.mark.parametrize(
    ("model", "Omega", "state", "rms", "multiplier"),
    [
        (
            rattle(0.005, 0.1, PLAIN, 0.02),
            0.35,
            [1.5619999251272256, 0.2334375337366326],
            0.955938862618165,
            -0.6191790390008902 + 0.16243953182729354j,
        ),
        (
            rattle(0.01, 0.2, CLIPPED),
            0.5,
            [1.3321099749062828, 0.8253948069627242],
            1.2529013488033318,
            -0.21108002404121917 + 0.2561919228688635j,
        ),
    ],
)
def test_spring_and_damper(model, Omega, state, rms, multiplier):
    orbit = hb.time.shoot(model, Omega, np.add(state, 1e-3))
    np.testing.assert_allclose(orbit.state, state, rtol=0, atol=1e-10)
    assert np.abs(orbit.multipliers - multiplier).min() < 1e-9
    errors = []
    for H in (31, 63):
        problem = hb.HarmonicBalance(model, H)
        X = solve(problem, orbit.rows(H).ravel(), {"Omega": Omega}).X
        errors.append(np.sqrt(0.5 * (X[1:] ** 2).sum()) - rms)
    assert abs(errors[1]) < 1e-6
    assert errors[0] / errors[1] == pytest.approx(8, rel=0.25)  # order 3 in H, because the force jumps
    assert np.abs(problem.multipliers(X, Omega=Omega) - multiplier).min() < 3e-5


@pytest.mark.slow
def test_multipliers_of_two_masses_with_another_law():
    """Impulses in the modes of a structure, with a second element whose stiffness changes with the motion."""
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    stop = hb.Element([1.0, 0.0], hb.mechanics.ClippedKelvinVoigt(4.0, 0.5, 0.2), name="stop")
    spring = hb.Element([1.0, -1.0], hb.Cubic(0.5), name="spring")
    model = hb.System(np.eye(2), 0.05 * K, K, [stop, spring], hb.Load(cosine={1: [0.3, 0.1]}))
    orbit = hb.time.shoot(model, 1.1, [0.2, 0.2, 0.1, 0.1])
    problem = hb.HarmonicBalance(model, 50)
    X = solve(problem, orbit.rows(50).ravel(), {"Omega": 1.1}).X
    for mu in orbit.multipliers:
        assert np.abs(problem.multipliers(X, Omega=1.1) - mu).min() < 3e-5


def test_period_doubling_of_a_curve():
    law = hb.mechanics.ClippedKelvinVoigt(1.0, 0.1, 1.0, sides=2)
    model = rattle(0.05, 0.2, law, 0.1)
    problem = hb.HarmonicBalance(model, 7)
    curve = hb.trace(problem, "Omega", (1.545, 1.53), accuracy=None, cover=False)
    (point,) = curve.special
    guess = hb.time.integration.state_of(point.problem, point.X, Omega=point.parameters["Omega"])
    assert np.abs(hb.time.shoot(model, point.parameters["Omega"], guess).multipliers + 1).min() < 1e-3


def test_refusals():
    with pytest.raises(ValueError, match="element of its own"):
        hb.mechanics.Parallel((PLAIN, hb.Cubic(1.0)))
    with pytest.raises(ValueError, match="sides = 3"):
        hb.mechanics.KelvinVoigt(1.0, 0.1, sides=3)
    with pytest.raises(ValueError, match="contacts with dampers"):
        hb.time.integrate(rattle(0.01, 0.1, PLAIN), [0.0, 0.0], 1, 1.0, method="exponential")
    with pytest.raises(ValueError, match="damper and a prescribed"):
        hb.HarmonicBalance(
            single_mass(PLAIN, F=0.1, c=None, displacement=hb.mechanics.Periodic.trapezoidal(0.2, 0.1, 0.3, 0.2)), 5
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("Omega", "load", "state", "rms", "multiplier"),
    [
        (
            0.35,
            0.1,
            [1.4865780092665437, 0.22537209656330362],
            0.9554283813037127,
            -0.514810453981267 + 0.22371943202854108j,
        ),
        (
            0.6,
            0.2,
            [1.4016452791927674, 1.190594011168507],
            1.4944114150264478,
            0.08912937448722495 + 0.32252230115645636j,
        ),
    ],
)
def test_hunt_crossley(Omega, load, state, rms, multiplier):
    model = rattle(0.005, load, hb.mechanics.HuntCrossley(k=1.0, contact_damping=0.4, gap=1.0, sides=2))
    orbit = hb.time.shoot(model, Omega, np.add(state, 1e-3))
    np.testing.assert_allclose(orbit.state, state, rtol=0, atol=1e-9)
    assert np.abs(orbit.multipliers - multiplier).min() < 1e-8
    problem = hb.HarmonicBalance(model, 31)
    rows = orbit.rows(31)
    X = solve(problem, rows.ravel(), {"Omega": Omega}).X
    assert np.sqrt(0.5 * (X[1:] ** 2).sum()) == pytest.approx(rms, rel=2e-5)
    assert np.abs(problem.multipliers(X, Omega=Omega) - multiplier).min() < 1e-3


def test_restitution():
    """A mass that hits a Hertzian stop at v rebounds at about v (1 - 2/3 contact_damping v)."""
    law = hb.mechanics.HuntCrossley(k=1e4, contact_damping=0.01, exponent=1.5)
    mass = single_mass(law, c=0.0, k=0.0)
    motion = hb.time.integrate(mass, [-0.05, 1.0], 1, 2 * np.pi / 0.4)
    assert -motion.end[1] == pytest.approx(1 - 2 / 3 * 0.01, abs=2e-4)


def one_mass(k: float = 8.0, gap: float = 0.5, F: float = 0.3) -> hb.System:
    """A mass and a Hertzian stop with damping; its curve has folds and period doublings."""
    law = hb.mechanics.HuntCrossley(k=k, contact_damping=0.3, gap=gap, exponent=1.5)
    return single_mass(law, F=F, c=0.06)


def two_masses(k: float = 3.0, gap: float = 0.38, F: float = 0.35) -> hb.System:
    """Two masses and a Hertzian stop with damping; its curve has folds and Neimark-Sacker points."""
    law = hb.mechanics.HuntCrossley(k=k, contact_damping=0.3, gap=gap, exponent=1.5)
    M, C, K = np.diag([1.0, 0.8]), np.array([[0.05, -0.02], [-0.02, 0.04]]), np.array([[1.6, -0.7], [-0.7, 1.2]])
    return hb.System(M, C, K, [hb.Element([0.0, 1.0], law)], hb.Load(cosine={1: [F, 0.0]}))


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.2])
def test_force_harmonics_of_hunt_crossley_are_integrals(exponent, rng):
    """f_k = (1/pi) int p(d, d') exp(-i k theta) dtheta between the crossings of the gap, by adaptive quadrature; the
    Jacobian matrix by differences, which exist to the second order in the step."""
    law = hb.mechanics.HuntCrossley(k=2.0, contact_damping=0.3, gap=0.4, exponent=exponent, sides=2)
    H, Omega = 5, 1.3
    problem = hb.HarmonicBalance(single_mass(law), H)
    X = 0.03 * rng.standard_normal(2 * H + 1)
    X[1] += 0.9
    row = X.tolist()

    def motion(t, rate=False):
        terms = (
            (k * row[2 * k] * Omega, -k * row[2 * k - 1] * Omega) if rate else row[2 * k - 1 : 2 * k + 1]
            for k in range(1, H + 1)
        )
        mean = 0.0 if rate else row[0]
        return mean + sum(a * np.cos(k * t) + b * np.sin(k * t) for k, (a, b) in enumerate(terms, 1))

    grid = np.linspace(0, 2 * np.pi, 401)
    cuts = [0.0, 2 * np.pi]
    for level in (-0.4, 0.4):
        x = motion(grid) - level
        cuts += [
            scipy.optimize.brentq(lambda t, level=level: motion(t) - level, grid[i], grid[i + 1], xtol=1e-15)
            for i in np.flatnonzero(x[1:] * x[:-1] < 0)
        ]
    cuts.sort()

    def integral(wave):
        def integrand(t):
            return float(law.force(np.array(motion(t)), np.array(motion(t, True)), 0.0)[0]) * wave(t) / np.pi

        return sum(scipy.integrate.quad(integrand, a, b, epsabs=1e-13, epsrel=1e-12)[0] for a, b in pairwise(cuts))

    expected = [0.5 * integral(lambda t: 1.0)]
    for k in range(1, H + 1):
        expected += [integral(lambda t, k=k: np.cos(k * t)), integral(lambda t, k=k: np.sin(k * t))]
    found = problem.force_rows(X, Omega=Omega)[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    v = rng.standard_normal(len(X))
    J = problem.evaluate(X, Omega=Omega)[1]
    errors = []
    for h in (1e-4, 1e-5):
        up, down = (problem.evaluate(X + side * h * v, Omega=Omega)[0] for side in (1, -1))
        errors.append(np.abs((up - down) / (2 * h) - J @ v).max())
    assert errors[0] < 1e-5 and errors[1] < 0.02 * errors[0] + 1e-9


def test_a_contact_shorter_than_a_sample_step():
    """A contact of .045 rad between two of 64 samples, .098 rad apart, has its force, stiffness and damping."""
    law = hb.mechanics.HuntCrossley(k=2.0, contact_damping=0.3, gap=0.4)
    problem = hb.HarmonicBalance(single_mass(law), 4)
    X, depth, phase = np.zeros(9), 1e-4, 0.049
    X[1:3] = (0.4 + depth) * np.array([np.cos(phase), np.sin(phase)])
    half = np.arccos(0.4 / (0.4 + depth))
    assert problem.N == 64 and 2 * half < 0.046
    mean = 2.0 * (0.4 + depth) * (np.sin(half) - half * np.cos(half)) / np.pi  # the damping force is odd in time
    assert problem.force_rows(X, Omega=1.0)[0][0] == pytest.approx(mean, rel=1e-9)
    J, h = problem.evaluate(X, Omega=1.0)[1], 1e-8
    for v in np.eye(9):
        up, down = (problem.evaluate(X + side * h * v, Omega=1.0)[0] for side in (1, -1))
        np.testing.assert_allclose(J @ v, (up - down) / (2 * h), rtol=0, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(("build", "expected"), [(one_mass, {"LP", "PD"}), (two_masses, {"LP", "NS"})])
def test_special_points_of_hunt_crossley_by_two_methods(build, expected):
    """Equations of folds, doublings and Neimark-Sacker points against multipliers of the exact flow at the same motion,
    which have a multiplier +1, -1 or a pair on the unit circle there; samples of the slopes gave 1e-4."""
    curve = hb.trace(hb.HarmonicBalance(build(), 48), "Omega", (1.7, 0.4), accuracy=None)
    kinds = set()
    for point in curve.special:
        if point.kind in ("LP", "PD", "NS"):
            mu = curve.problem.multipliers(point.X, **point.parameters)
            target = {"LP": mu - 1, "PD": mu + 1, "NS": (np.abs(mu) - 1)[np.abs(mu.imag) > 1e-6]}[point.kind]
            assert np.abs(target).min() < 2e-7
            kinds.add(point.kind)
    assert kinds == expected


@pytest.mark.slow
@pytest.mark.parametrize(("build", "kind"), [(one_mass, "PD"), (two_masses, "NS")])
def test_sensitivities_of_hunt_crossley(build, kind):
    """They depend on the change of the Jacobian matrix along the curve: against points of curves traced again."""
    make = hb.mechanics.model(build)

    def points(**changed):
        curve = hb.trace(hb.HarmonicBalance(make(**changed), 12), "Omega", (1.7, 0.4), accuracy=None)
        return [point for point in curve.special if point.kind == kind]

    base, h = points(), 1e-4
    assert len(base) >= 2
    for name, value in make().parameters.items():
        up, down = (points(**{name: value * (1 + side * h)}) for side in (1, -1))
        for a, b, one in zip(up, down, base, strict=True):
            expected = (a.parameters["Omega"] - b.parameters["Omega"]) / (2 * h * value)
            found = hb.analysis.sensitivity(one).of("Omega")[name]
            assert found == pytest.approx(expected, rel=1e-5, abs=1e-6), (one.label, name)


@hb.mechanics.model
def clipped_stop(F: float = 0.2, gap: float = 0.5, k3: float = 0.0) -> hb.System:
    """Return one mass whose curve turns back where it touches a stop with a strong damper that does not pull."""
    stop = hb.Element([1.0], hb.mechanics.ClippedKelvinVoigt(1.0, 2.0, gap), name="stop")
    springs = [hb.Element([1.0], hb.Cubic(k3))] if k3 else []
    return hb.System([[1.0]], [[0.05]], [[1.0]], [stop, *springs], hb.Load(cosine={1: [F]}))


@pytest.mark.parametrize("name, F, gap", [("F", 0.3, 0.5), ("gap", 0.2, 0.4)])
def test_a_fold_at_a_contact_that_begins_with_a_jump_of_the_slope_is_followed(name, F, gap):
    """The motion in front of the contact is linear: F / |1 - Omega^2 + i c Omega| = gap at the fold."""
    curve = hb.trace(hb.HarmonicBalance(clipped_stop(), 8), "Omega", (1.4, 1.1))
    folds = hb.follow(curve, "LP1", name, (getattr(clipped_stop(), name), {"F": F, "gap": gap}[name]))
    expected = scipy.optimize.brentq(lambda w: F / abs(1 - w**2 + 0.05j * w) - gap, 1.05, 2.0, xtol=1e-14)
    assert folds.status is hb.Status.REACHED_END
    assert folds.tracked["Omega"][-1] == pytest.approx(expected, abs=1e-11)


def test_the_error_of_a_fold_at_a_contact_is_that_of_the_contact():
    problem = hb.HarmonicBalance(clipped_stop(k3=0.8), 4)
    curve, finer = (hb.trace(each, "Omega", (1.6, 1.15)) for each in (problem, problem.refined_problem))
    fold, contact, true = curve["LP1"], curve["GR1"], finer["GR1"].parameters["Omega"]
    assert abs(fold.parameters["Omega"] - true) <= 3 * fold.error
    assert fold.error <= 2 * contact.error < 1e-3


@pytest.mark.parametrize("least", [-1e-6, 1e-6])
def test_second_derivatives_where_a_clipped_force_nearly_vanishes(least):
    """The force of a contact with two maxima of x has a least value near zero between them.

    Steps that end or begin the interval without force there gave a third of the derivative, or 29 instead of .12.
    """
    k, c, X = 1.0, 0.3, np.array([0.0, 1.0, 0.0, 0.0, 0.0, -0.5, 0.0])

    def force(t: float, order: int = 0) -> float:
        """Return k x + c x' of x = cos t - cos 3 t / 2, or a derivative."""
        x, rate = (evaluate(X, np.array([t]), n)[0] for n in (order, order + 1))
        return float(k * x + c * rate)

    valley = scipy.optimize.brentq(lambda t: force(t, 1), -0.5, 0.3, xtol=1e-15)
    gap = (force(valley) - least) / k
    problem = hb.HarmonicBalance(single_mass(hb.mechanics.ClippedKelvinVoigt(k, c, gap), F=1.0), 3)
    v = np.eye(7)[0]
    along, _ = problem.curvature(X, v, "Omega", Omega=1.0)
    h = 1e-9
    expected = (problem.evaluate(X + h * v, Omega=1.0)[1] - problem.evaluate(X - h * v, Omega=1.0)[1]) / (2 * h)
    np.testing.assert_allclose(along, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


@pytest.mark.slow
def test_a_curve_with_jumps_is_validated():
    """Landings need the exponential method, which does not integrate dampers of contacts: the points are compared."""
    system = single_mass(hb.mechanics.KelvinVoigt(k=4.0, c=0.3, gap=0.5), F=0.3, name="stop")
    curve = hb.trace(hb.HarmonicBalance(system, 9), "Omega", (1.2, 1.35))
    assert len(curve.jumps()) == 2
    report = hb.validate(curve, 2, tolerance=1e-3)
    assert report.ok and not report.jumps
    assert report.note.startswith("jumps not compared (2): the exponential method, ")
    assert report.note.endswith(" contacts with dampers and vector laws") and report.summary.endswith(report.note)


def test_two_sides_without_a_gap_are_a_spring_and_a_damper():
    """Laws without a gap were refused: at d = 0 differences of the force agree, with half of its slope on one side."""
    law, Omega = hb.mechanics.KelvinVoigt(k=5.0, c=0.3, sides=2), (1.8, 2.5)
    model = single_mass(law, F=0.2)
    curve = hb.trace(hb.HarmonicBalance(model, 9), "Omega", Omega)
    expected = 0.2 / np.abs(6.0 - curve.values**2 + 0.4j * curve.values)
    np.testing.assert_allclose(curve.amplitude("rms"), expected / np.sqrt(2), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("law", [hb.mechanics.KelvinVoigt, hb.mechanics.ClippedKelvinVoigt, hb.mechanics.HuntCrossley])
@pytest.mark.parametrize("mean", [0.1, -0.1])
def test_contacts_without_a_gap_are_those_of_time_integration(law, mean):
    """With mean = -.1, curves of the first law have jumps, which no integrator passes: they are not compared."""
    model = single_mass(law(5.0, 0.3), F=0.2, mean=mean)
    curve = hb.trace(hb.HarmonicBalance(model, 32), "Omega", (1.8, 0.6))
    outer = {point.kind for point in curve.special if not point.note.startswith("inner extremum")}
    assert outer == ({"PD"} if mean > 0 else {"GR", "LP"})
    report = hb.validate(curve, 3)
    assert report.ok and (not report.jumps or law is hb.mechanics.HuntCrossley)
