"""Time integration: orders, closed forms, corners, many motions at once. `cross.shooting` is other code for it."""

import numpy as np
import pytest
from cross.shooting import integrate as integrate_otherwise
from machines import Drag, single_mass

from hbgear import Backlash, Cubic, Duffing, HarmonicBalance, NoConvergence, SpurPair, Unilateral
from hbgear.gears import DoubleHelicalPair
from hbgear.harmonic.structure.linear_structure import LinearStructure
from hbgear.mechanics import Parallel
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.modal_states import modal_state, physical_state
from hbgear.time.integration import integrate, state_of
from hbgear.time.runge_kutta import METHODS, Flow
from hbgear.time.shooting import shoot

VARYING = SpurPair(eps=(0.2, 0.1))
STARTS = {"Duffing": (Duffing(), 1.09, np.array([0.5, -0.8])), "SpurPair": (VARYING, 0.8, np.array([1.2, 0.1]))}


def gaps(model, Omega, y):
    """Element coordinates and rates at tau = 0: what free motions do not touch."""
    return np.concatenate(Flow(model.system(), Omega).gaps(0.0, np.asarray(y)))


def slope(x, y):
    return np.polyfit(np.log(x), np.log(y), 1)[0]


# ---- orders


@pytest.fixture(scope="module")
def truth():
    """States after two periods, to rounding, by other code."""
    out = {}
    for name, (model, Omega, y) in STARTS.items():
        half = integrate_otherwise(model.system(), Omega, y, nu=2, tolerance=1e-13)
        out[name] = half.end
    return out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "order", "digits"), [("DOP853", 8, range(6, 11)), ("RK45", 5, range(4, 8)), ("Radau", 5, range(4, 7))]
)
def test_order_of_the_methods_of_scipy(method, order, digits):
    """Their error falls with the power of the number of steps that their names promise, as the tolerance is reduced."""
    model, Omega, y = STARTS["Duffing"]
    truth = integrate_otherwise(model.system(), Omega, y, nu=8, tolerance=1e-13).end
    runs = [integrate(model, y, 8, Omega, method=method, tolerance=10.0**-k, samples=1) for k in digits]
    errors = [np.abs(run.end - truth).max() for run in runs]
    assert -slope([run.steps for run in runs], errors) == pytest.approx(order, abs=1.0)


@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize("points", [1, 2, 3])
def test_order_of_the_exponential_method(name, points, truth):
    """Order 2s with s Gauss points, smooth or with impacts (where in a step they fall makes it uneven)."""
    model, Omega, y = STARTS[name]
    steps, errors = (12, 24, 48, 96), []
    for N in steps:
        stepper = ExponentialIntegrator(model, Omega, N, points=points)
        flight = stepper.start(y)
        stepper.advance(flight, 2)
        errors.append(np.abs(stepper.states(flight)[0] - truth[name]).max())
    assert -slope(steps, errors) == pytest.approx(2 * points, abs=0.5)
    assert errors[-1] < 10.0 ** (-0.5 - 3 * points)


def test_double_helical_pair_keeps_the_order():
    """Poles at -16 and at 14i: far outside what an explicit method could take at these steps."""
    model, Omega = DoubleHelicalPair(), 0.92
    problem = HarmonicBalance(model, 20)
    y = state_of(problem, problem.start(Omega), Omega=Omega)
    true = gaps(model, Omega, integrate(model, y, 1, Omega, tolerance=1e-13).end)
    errors = {}
    for points, N in ((2, 24), (2, 48), (2, 96), (5, 15)):
        stepper = ExponentialIntegrator(model, Omega, N, points=points)
        flight = stepper.start(y)
        stepper.advance(flight)
        errors[points, N] = np.abs(gaps(model, Omega, stepper.states(flight)[0]) - true).max()
    assert errors[2, 24] / errors[2, 48] > 12 and errors[2, 48] / errors[2, 96] > 12
    assert errors[5, 15] < 2e-9
    assert ExponentialIntegrator(model, Omega).N == 15


# ---- truths


@pytest.mark.parametrize("method", [*METHODS, "exponential"])
def test_linear_oscillator_in_closed_form(method):
    """Contact throughout: q = q_steady + Re(A exp(lambda t)), also at the samples."""
    model, Omega = SpurPair(b=0.0), 0.8
    lam = -0.05 + 1j * np.sqrt(1 - 0.05**2)
    start = np.array([0.4, -0.3])
    steady = (1 + 0.08j) * 0.05 / (1 - 0.64 + 0.08j)
    a = start - [0.1 + steady.real, -Omega * steady.imag]
    A = a[0] - 1j * (a[1] - lam.real * a[0]) / lam.imag
    run = integrate(model, start, 3, Omega, method=method, tolerance=1e-12 if method == "DOP853" else 1e-9, samples=32)
    t = run.tau / Omega
    q = 0.1 + (steady * np.exp(1j * run.tau)).real + (A * np.exp(lam * t)).real
    np.testing.assert_allclose(run.d[0], q - 0.05 * np.cos(run.tau), atol=1e-7 if method in ("RK45", "Radau") else 1e-9)
    end = A * np.exp(lam * 6 * np.pi / Omega) + steady
    np.testing.assert_allclose(run.end[0], 0.1 + end.real, atol=1e-7 if method in ("RK45", "Radau") else 1e-11)
    assert run.d.shape == run.v.shape == (1, 96)


@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize("method", ["DOP853", "exponential"])
def test_agrees_with_other_code(name, method, truth):
    model, Omega, y = STARTS[name]
    steps = {"exponential": {"steps": 32}, "DOP853": {"tolerance": 1e-13}}[method]
    np.testing.assert_allclose(integrate(model, y, 2, Omega, method=method, **steps).end, truth[name], atol=1e-11)


@pytest.mark.parametrize("method", ["DOP853", "exponential"])
def test_shortest_visits_beyond_a_corner_are_found(method):
    """q'' + q = 0 touches a stiff stop for a thousandth of each turn; overlooked, the motion would be the free one."""
    depth = 1e-5
    system = single_mass(Unilateral(k=1e4, gap=1 - depth), c=None)
    run = integrate(system, np.array([0.0, 1.0]), 4, 0.7, method=method, samples=8)
    energy = 0.5 * (run.end**2).sum()
    assert energy == pytest.approx(0.5, abs=1e-9)
    free = np.array([np.sin(8 * np.pi / 0.7), np.cos(8 * np.pi / 0.7)])
    assert np.abs(run.end - free).max() > 1e-4
    if method == "DOP853":
        assert len(run.switches) == 12


def test_both_methods_see_the_same_short_visits():
    system = single_mass(Unilateral(k=1e4, gap=1 - 1e-5), c=None)
    y = np.array([0.0, 1.0])
    a = integrate(system, y, 4, 0.7, tolerance=1e-12).end
    np.testing.assert_allclose(integrate(system, y, 4, 0.7, method="exponential").end, a, atol=1e-8)


def test_switching_instants_are_on_the_corners():
    model, Omega, y = STARTS["SpurPair"]
    run = integrate(model, y, 2, Omega, samples=4096)
    d = run.d[0]
    crossings = run.tau[np.flatnonzero(np.diff(d > 1) | np.diff(d < -1))]
    assert len(run.switches) == len(crossings) >= 3
    assert np.all((run.switches > crossings) & (run.switches <= crossings + 2 * np.pi / 4096 + 1e-12))


def test_samples_are_the_motion():
    """At starts at a multiple of 2 pi they are the ends of shorter runs."""
    model, Omega, y = STARTS["SpurPair"]
    for method in ("DOP853", "exponential"):
        run = integrate(model, y, 3, Omega, method=method, samples=64)
        end = integrate(model, y, 2, Omega, method=method).end
        np.testing.assert_allclose([run.d[0, 128], run.v[0, 128]], gaps(model, Omega, end), atol=1e-9)
        np.testing.assert_allclose(run.tau[1] - run.tau[0], 2 * np.pi / 64)


# ---- general laws


@pytest.mark.parametrize(
    "law",
    [Drag(wave=0.2), Parallel((Backlash(0.5), Cubic(0.2))), Cubic(1.0, -1.0)],
    ids=["velocity", "corners", "double well"],
)
def test_laws_of_any_kind(law):
    system = single_mass(law, F=0.7, mean=0.3, c=0.05, k=0.1)
    y = np.array([0.3, -0.6])
    true = integrate(system, y, 2, 0.9, tolerance=1e-13).end
    np.testing.assert_allclose(integrate(system, y, 2, 0.9, method="exponential", steps=48).end, true, atol=2e-10)
    np.testing.assert_allclose(integrate(system, y, 2, 0.9, method="Radau", tolerance=1e-6).end, true, atol=1e-4)


# ---- many at once


@pytest.mark.slow
def test_many_motions_are_those_of_one_by_one(rng):
    n = 5
    y, Omega = rng.uniform(-2, 2, (n, 2)), rng.uniform(0.4, 1.5, n)
    models = [SpurPair(zeta=0.02 + 0.1 * x, b=0.2 + x, eps=(0.2,)) for x in rng.uniform(0, 1, n)]
    for model, frequency in ((VARYING, 0.8), (VARYING, Omega), (models, 0.8), (models, Omega)):
        many = integrate(model, y, 2, frequency, method="exponential", samples=32)
        each = zip(model if isinstance(model, list) else [model] * n, y, np.broadcast_to(frequency, n), strict=True)
        single = [integrate(m, state, 2, f, samples=32) for m, state, f in each]
        np.testing.assert_allclose(many.end, [s.end for s in single], atol=1e-9)
        np.testing.assert_allclose(many.d, [s.d for s in single], atol=1e-7)
        assert many.d.shape == (n, 1, 64)
    one_by_one = integrate(VARYING, y, 2, 0.8, samples=32)
    assert one_by_one.d.shape == (n, 1, 64)


def test_modal_state_and_back(rng):
    """All but the rotation of the train."""
    structure = LinearStructure(DoubleHelicalPair().system())
    y = rng.standard_normal((5, 48))
    back = physical_state(structure, modal_state(structure, y))
    lost = y - back
    W = structure.W
    assert np.abs(lost[:, :24] @ W).max() < 1e-12 and np.abs(lost[:, 24:] @ W).max() < 1e-12
    assert np.linalg.matrix_rank(lost[:, :24], tol=1e-9) == 1
    np.testing.assert_allclose(physical_state(structure, modal_state(structure, back)), back, atol=1e-11)


def test_rotation_of_the_train_is_left_out():
    """A drift of the whole train changes no gap."""
    model, Omega = DoubleHelicalPair(), 0.9
    problem = HarmonicBalance(model, 12)
    y = state_of(problem, problem.start(Omega), Omega=Omega)
    structure = LinearStructure(model.system())
    drift = np.concatenate([structure.free[:, 0], 0.3 * structure.free[:, 0]])
    for method in ("DOP853", "exponential"):
        a, b = (integrate(model, x, 1, Omega, method=method, samples=32) for x in (y, y + drift))
        np.testing.assert_allclose(a.d, b.d, atol=1e-9)


# ---- shooting


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Duffing", "SpurPair"])
def test_a_shot_motion_closes(name):
    """To 1e-9 by both integrators, which share nothing but the system."""
    model, Omega, _ = STARTS[name]
    problem = HarmonicBalance(model, 12)
    orbit = shoot(model, Omega, state_of(problem, problem.start(Omega), Omega=Omega))
    assert orbit.closure < 1e-11
    for method, options in (("DOP853", {"tolerance": 1e-12}), ("exponential", {"steps": 24}), ("Radau", {})):
        end = integrate(model, orbit.state, 1, Omega, method=method, **options).end
        np.testing.assert_allclose(end, orbit.state, atol=1e-9)


def test_multipliers_of_a_linear_motion():
    orbit = shoot(SpurPair(b=0.0), 0.8, [0.0, 0.0])
    expected = np.exp((-0.05 + 1j * np.sqrt(1 - 0.05**2)) * 2 * np.pi / 0.8)
    upper = orbit.multipliers[np.argmax(orbit.multipliers.imag)]
    assert min(abs(upper - expected), abs(upper - expected.conjugate())) < 1e-10
    steady = (1 + 0.08j) * 0.05 / (1 - 0.64 + 0.08j)
    H1 = steady - 0.05
    np.testing.assert_allclose(orbit.rows(2), [[0.1, H1.real, -H1.imag, 0, 0]], atol=1e-10)


def test_monodromy_is_the_derivative_of_the_map(rng):
    model, Omega, y = STARTS["SpurPair"]
    orbit = shoot(model, Omega, integrate(model, y, 20, Omega, method="exponential").end)
    for direction in rng.standard_normal((2, 2)):
        ends = [integrate(model, orbit.state + s * 1e-5 * direction, 1, Omega, tolerance=1e-13).end for s in (1, -1)]
        np.testing.assert_allclose((ends[0] - ends[1]) / 2e-5, orbit.monodromy @ direction, atol=1e-7)


# ---- bad input


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: integrate(VARYING, np.zeros(2), 1, 0.8, method="RK4"), "no method 'RK4'; did you mean 'RK45'"),
        (lambda: integrate(VARYING, np.zeros(3), 1, 0.8), r"shape \(3,\) does not fit"),
        (lambda: integrate(VARYING, np.zeros(3), 1, 0.8, method="exponential"), "do not fit"),
        (lambda: integrate(VARYING, np.zeros(2), 0, 0.8), "at least 1"),
        (lambda: integrate(VARYING, np.zeros(2), 1, -0.8), "must be positive"),
        (lambda: integrate(VARYING, np.zeros(2), 1, np.nan, method="exponential"), "must be a finite number"),
        (lambda: integrate([VARYING, VARYING], np.zeros((2, 2)), 1, 0.8), "one model"),
        (lambda: integrate(VARYING, np.zeros(2), 1, 0.8, method="exponential", phase=1.0), "a multiple of 2 pi"),
        (lambda: ExponentialIntegrator([SpurPair(), Duffing()], 0.8), "same"),
        (lambda: ExponentialIntegrator([SpurPair(), SpurPair()], [0.8, 0.9, 1.0]), "2 models and 3 values"),
        (lambda: shoot(VARYING, 0.8, np.zeros(2), nu=0), "nu = 0"),
        (lambda: shoot(VARYING, 0.8, np.zeros(3)), "does not fit"),
        (lambda: shoot(VARYING, 0.8, np.zeros(2), tolerance=1e-15), "cannot be reached"),
    ],
)
def test_bad_input(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_shooting_without_convergence_is_reported():
    with pytest.raises(NoConvergence, match="shooting did not converge at Omega") as error:
        shoot(VARYING, 0.8, [30.0, -40.0], max_iterations=1, tolerance=1e-13)
    assert len(error.value.residuals) == 2 and error.value.X.shape == (2,)
