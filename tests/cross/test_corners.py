"""Stiffness and error with corners: projection against quadrature, balance against shooting, time against time."""

from itertools import pairwise

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.gears.mesh.mesh_excitation import in_order
from hbgear.harmonic.equations.thresholds import grazing_distance
from hbgear.mechanics.series.fourier import harmonics_of, to_complex
from hbgear.time.integration import state_of

pytestmark = pytest.mark.slow

TURN = 2 * np.pi
RNG = np.random.default_rng(3)
RECTANGULAR = hb.mechanics.Periodic.rectangular(1.16, 0.76, 0.6, start=0.3)
SPLINE = hb.mechanics.Periodic.table(np.sort(RNG.uniform(0, 1, 12)), 0.3 * RNG.normal(size=12), period=1, kind="cubic")
TABLE = hb.mechanics.Periodic.table(np.sort(RNG.uniform(0, 1, 7)), 0.1 * RNG.normal(size=7), period=1)
SMOOTH = hb.mechanics.Series(1.0, (0.2, 0.1), (0.05,))


def system(law: hb.mechanics.Law, e: hb.mechanics.Series | hb.mechanics.Periodic) -> hb.System:
    return single_mass(law, F=0.2, mean=0.1, k=0.2, displacement=e, damping=0.05, name="gap")


LAWS = {
    "rectangular stiffness": (hb.Backlash(0.5, stiffness=RECTANGULAR), hb.mechanics.Series(cosine=(0.1,))),
    "error with corners": (hb.Backlash(0.5, stiffness=SMOOTH), TABLE),
    "both": (hb.Backlash(0.5, stiffness=RECTANGULAR), SPLINE),
    "two splines": (
        hb.mechanics.PiecewiseLinear((-0.2, 0.4), (1.0, 0.3, 2.0), force_at_zero=0.3, stiffness=SPLINE.varied(0.2)),
        SPLINE.shifted(1.0),
    ),
    "five times": (hb.Backlash(0.5, stiffness=in_order(RECTANGULAR, 5)), hb.mechanics.Series(cosine=(0.1,))),
    "three and six times": (hb.Backlash(0.5, stiffness=in_order(RECTANGULAR, 6, 0.7)), in_order(TABLE, 3)),
    "cubic": (hb.Cubic(0.7, 0.3), SPLINE),
    "all at once": (
        hb.mechanics.Parallel(
            (hb.Cubic(0.7, 0.3), hb.Backlash(0.3, stiffness=RECTANGULAR), hb.Unilateral(2.0, 0.1, SMOOTH))
        ),
        SPLINE,
    ),
}


@pytest.mark.parametrize("nu", [1, 2])
@pytest.mark.parametrize("law, e", LAWS.values(), ids=LAWS)
def test_projection_is_exact(law, e, nu):
    """Force harmonics, those above H too, are integrals between all corners and contact instants."""
    H, rng = 8, np.random.default_rng(nu)
    problem = hb.HarmonicBalance(system(law, e), H, nu=nu)
    X = 0.4 * rng.normal(size=problem.size) / np.repeat(np.arange(1, H + 2), 2)[1:]
    compiled = problem.compiled({})
    cuts = np.unique([0, TURN, *compiled.packed.piecewise.phases, *compiled.crossings(X).theta])
    x, w = np.polynomial.legendre.leggauss(100)
    c, k = np.zeros(2 * H + 1, dtype=complex), np.arange(2 * H + 1)
    for a, b in pairwise(cuts):
        theta = (a + b) / 2 + (b - a) / 2 * x
        d = compiled.gap(0, X, theta)
        c += np.exp(-1j * np.outer(k, theta)) @ (law.force(d, 0 * d, nu * theta)[0] * w) * (b - a) / 2 / np.pi
    c[0] /= 2
    found = to_complex(compiled.forces(X, 0.7))[0]
    np.testing.assert_allclose(found, c[: H + 1], rtol=0, atol=1e-12)
    left_out = c[H + 1 :] - 1j * k[H + 1 :] * 0.7 / nu * 0.05 * compiled.packed.piecewise.truncated[:, 0]
    moved = compiled.structure.receptances(0.7, k[H + 1 :] / nu)[0][:, 0, 0] * left_out
    truncation = np.sqrt(0.5 * np.sum(np.abs(moved) ** 2))
    assert problem.truncation(X, Omega=0.7) == pytest.approx(truncation, rel=1e-8)


@pytest.mark.parametrize("law, e", LAWS.values(), ids=LAWS)
def test_derivatives(law, e):
    rng = np.random.default_rng(5)
    problem = hb.HarmonicBalance(system(law, e), 8)
    X, v, h = 0.05 * rng.normal(size=problem.size), rng.normal(size=problem.size), 1e-6
    X[0] = 0.6
    _, J, dR, _ = problem.linearise(X, "Omega", Omega=0.7)
    along = (problem.residual(X + h * v, Omega=0.7) - problem.residual(X - h * v, Omega=0.7)) / (2 * h)
    across = (problem.residual(X, Omega=0.7 + h) - problem.residual(X, Omega=0.7 - h)) / (2 * h)
    np.testing.assert_allclose(J @ v, along, rtol=0, atol=1e-7 * np.abs(along).max())
    np.testing.assert_allclose(dR, across, rtol=0, atol=1e-7 * np.abs(across).max())


@pytest.mark.parametrize("law, e", [case for case in LAWS.values() if case[0].breakpoints])
def test_reach_is_that_of_the_whole_gap(law, e):
    """Extrema may be corners of the error, and are those of all of its harmonics."""
    rng = np.random.default_rng(2)
    problem = hb.HarmonicBalance(system(law, e), 8)
    compiled, theta = problem.compiled({}), np.linspace(0, TURN, 200_001)
    for _ in range(5):
        X = 0.2 * rng.normal(size=problem.size)
        d = compiled.gap(0, X, theta)
        low, high = problem.clearance(X, Omega=1.0)[:2] + law.breakpoints[0]
        assert low == pytest.approx(d.min(), abs=1e-5) and high == pytest.approx(d.max(), abs=1e-5)
        for which, value in enumerate((low, high)):
            place = grazing_distance(compiled, X, which)[1]
            assert compiled.gap(0, X, np.array([place]))[0] == pytest.approx(value, abs=1e-12)
        count = sum(np.count_nonzero(np.diff(d > corner)) for corner in law.breakpoints)
        assert abs(len(compiled.crossings(X).theta) - count) <= 1  # one may lie at the ends


class Damped(hb.mechanics.Law):
    """A law that hbgear does not know: it is sampled."""

    reference = 1.0

    def force(self, d, v, tau):
        return d + 0.1 * d**2 * v, 1 + 0.2 * d * v, 0.1 * d**2


def test_sampled_laws_see_the_whole_gap():
    X = 0.1 * np.random.default_rng(1).normal(size=13)
    problem = hb.HarmonicBalance(system(Damped(), TABLE), 6, samples=4096)
    compiled, h = problem.compiled({}), 1e-6
    theta = TURN * np.arange(1_000_000) / 1_000_000
    d, v = compiled.gap(0, X, theta), 0.7 * compiled.gap(0, X, theta, 1)
    c = np.fft.rfft(Damped().force(d, v, theta)[0])[:7] / len(theta)
    c[1:] *= 2
    np.testing.assert_allclose(to_complex(compiled.forces(X, 0.7))[0], c, rtol=0, atol=3e-5)
    dR = problem.linearise(X, "Omega", Omega=0.7)[2]
    across = (problem.residual(X, Omega=0.7 + h) - problem.residual(X, Omega=0.7 - h)) / (2 * h)
    np.testing.assert_allclose(dR, across, rtol=0, atol=1e-7)


PAIRS = {
    "rectangular stiffness": (hb.SpurPair(stiffness=RECTANGULAR), 0.85),
    "trapezoidal stiffness": (hb.SpurPair(stiffness=hb.mechanics.Periodic.trapezoidal(1.2, 0.8, 0.3, 0.1)), 0.85),
    "table of the error": (hb.SpurPair(eps=(0.2,), error=TABLE), 0.7),
    "spline and rectangle": (hb.SpurPair(stiffness=RECTANGULAR, error=SPLINE.scaled(0.2)), 0.75),
}


@pytest.mark.parametrize("pair, Omega", PAIRS.values(), ids=PAIRS)
def test_balance_converges_to_shooting(pair, Omega):
    """With contact loss; force harmonics fall with 1/k at a jump of the stiffness, so motions with the third power."""
    errors, steps = [], hb.StepControl(max_points=400)
    for H in (20, 40, 80, 160):
        problem = hb.HarmonicBalance(pair, H)
        X = hb.trace(problem, "Omega", (1.5, Omega), stability=False, steps=steps).X[-1]
        if not errors:
            orbit = hb.time.shoot(pair, Omega, state_of(problem, X, Omega=Omega), tolerance=1e-13)
            true = orbit.rows(10, orbit.motion(1 << 15))[0]
            assert problem.regime(X, Omega=Omega)[0] == 1
        errors.append(np.abs(X[: len(true)] - true).max())
    assert errors[-1] < 1e-8 and errors[-1] < errors[0] / 8**2.5
    mu = problem.multipliers(X, Omega=Omega)
    assert abs(mu.sum() - orbit.multipliers.sum()) < 4e-6
    assert abs(np.prod(mu)) == pytest.approx(np.exp(-2 * pair.zeta * TURN / Omega), rel=1e-10)


def test_harmonics_above_H_are_estimated():
    pair = hb.SpurPair(stiffness=RECTANGULAR)
    fine = hb.HarmonicBalance(pair, 160)
    true = hb.trace(fine, "Omega", (1.5, 0.85), stability=False).X[-1]
    for H in (10, 20, 40):
        problem = hb.HarmonicBalance(pair, H)
        X = hb.trace(problem, "Omega", (1.5, 0.85), stability=False).X[-1]
        error = np.linalg.norm(true - fine.resized(X)) / np.sqrt(2)
        assert 0.3 * error < problem.truncation(X, Omega=0.85) < 3 * error


@pytest.mark.parametrize("pair, Omega", PAIRS.values(), ids=PAIRS)
def test_two_ways_to_integrate_agree(pair, Omega):
    """Contact is lost and found, between corners and on both sides of them."""
    state = np.array([1.05, 0.3])
    one = hb.time.integrate(pair, state, 4, Omega, samples=64, tolerance=1e-12)
    two = hb.time.integrate(pair, state, 4, Omega, samples=64, method="exponential")
    assert one.switches.size
    np.testing.assert_allclose(two.end, one.end, rtol=0, atol=1e-9)
    np.testing.assert_allclose(two.d, one.d, rtol=0, atol=1e-7)  # of inside steps
    stiff = hb.time.integrate(pair, state, 4, Omega, samples=64, method="Radau", tolerance=1e-9)
    np.testing.assert_allclose(stiff.end, one.end, rtol=0, atol=1e-6)


def test_many_models_at_once_have_their_own_corners():
    pairs = [
        hb.SpurPair(stiffness=hb.mechanics.Periodic.rectangular(1.2, 0.8, share), error=TABLE) for share in (0.3, 0.55)
    ]
    Omega = np.array([0.8, 0.7])
    both = hb.time.integrate(pairs, np.array([[1.0, 0.2]] * 2), 3, Omega, method="exponential")
    for end, pair, w in zip(both.end, pairs, Omega, strict=True):
        alone = hb.time.integrate(pair, [1.0, 0.2], 3, float(w), tolerance=1e-12)
        np.testing.assert_allclose(end, alone.end, rtol=0, atol=1e-9)


def test_a_table_of_a_smooth_function_is_that_function():
    """A spline through 128 values of a short series: the same jumps to what the spline misses, 1e-8."""
    tau = TURN * np.arange(128) / 128
    k, e = hb.mechanics.Series(1.0, (-0.1, 0.02)), hb.mechanics.Series(0.0, (0.05,), (0.0, 0.01))
    spline = hb.SpurPair(stiffness=Table(tau, k(tau), kind="cubic"), error=Table(tau, e(tau), kind="cubic"))
    smooth = hb.SpurPair(stiffness=k, error=e)
    one, two = (hb.trace(hb.HarmonicBalance(pair, 12), "Omega", (1.2, 0.6)) for pair in (spline, smooth))
    assert [p.label for p in one.special] == [p.label for p in two.special]
    for label in ("LP1", "LP2"):
        a, b = one[label], two[label]
        assert a.parameters["Omega"] == pytest.approx(b.parameters["Omega"], abs=3e-8)
        np.testing.assert_allclose(a.X, b.X, rtol=0, atol=1e-5)
        assert harmonics_of(a.X) == 12


Table = hb.mechanics.Periodic.table


def test_steps_fall_on_the_corners_of_an_even_table():
    from hbgear.time.exponential.integrator import ExponentialIntegrator

    pair = hb.SpurPair(stiffness=Table(np.arange(24) / 24, 1 + 0.2 * RNG.uniform(size=24), period=1))
    stepper = ExponentialIntegrator(pair, 0.7)
    assert stepper.N % 24 == 0 and np.all(stepper.breakpoints.position == 1.0)
    assert ExponentialIntegrator(hb.SpurPair(stiffness=RECTANGULAR), 0.7).breakpoints.position.min() < 1.0
