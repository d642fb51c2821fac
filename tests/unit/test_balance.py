"""Residual, Jacobian and results of the harmonic balance."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest
from machines import Drag, single_mass

from hbgear import (
    Backlash,
    Cubic,
    Duffing,
    Element,
    HarmonicBalance,
    Load,
    NoConvergence,
    SpurPair,
    System,
    Unilateral,
    trace,
)
from hbgear.gears import DoubleHelicalPair
from hbgear.harmonic.equations import discretization
from hbgear.harmonic.equations.thresholds import grazing_distance
from hbgear.mechanics import Model, Series
from hbgear.mechanics.series.fourier import derive, evaluate, stretch, to_complex, to_real

OMEGA = 0.83
TAU = 2 * np.pi * np.arange(256) / 256


def three_masses():
    """Three coordinates, three laws of different kinds, prescribed displacement, an unbalance and a constant load."""
    gap = Backlash(0.6, 1.5, Series(mean=1.0, cosine=(-0.2,)))
    elements = [
        Element([1.0, -1.0, 0.0], gap, Series(cosine=(0.1,), sine=(0.0, 0.05)), damping=0.1),
        Element([0.0, 1.0, 1.0], Cubic(0.3, 0.2)),
        Element([0.0, 0.0, 1.0], Drag(wave=0.5, cubic=0.1)),
    ]
    loads = [Load([0.1, 0.2, -0.1], {1: [0.3, 0, 0]}), Load(sine={2: [0, 0.1, 0.1]}, power=2)]
    K = [[1.0, -0.3, 0.0], [-0.3, 1.2, -0.2], [0.0, -0.2, 0.8]]
    return System(np.diag([1.0, 2.0, 0.7]), 0.05 * np.eye(3), K, elements, loads)


PROBLEMS = {
    "duffing": lambda: HarmonicBalance(Duffing(), 6),
    "spur pair": lambda: HarmonicBalance(SpurPair(eps=(0.2, 0.1)), 6),
    "spur pair, sampled": lambda: HarmonicBalance(SpurPair(eps=(0.2, 0.1)), 6, sampled=True),
    "double-helical": lambda: HarmonicBalance(DoubleHelicalPair(stagger=0.5), 4),
    "three masses": lambda: HarmonicBalance(three_masses(), 5),
    "three masses, nu = 2": lambda: HarmonicBalance(three_masses(), 6, nu=2),
}
# samples of a sampled law must not cross its breakpoints within the finite difference
STEP = {"spur pair, sampled": 1e-6}


@pytest.fixture(params=PROBLEMS)
def case(request, rng):
    """Return a problem, a random motion of order one, and the step size of finite differences."""
    problem = PROBLEMS[request.param]()
    X = 0.4 * rng.standard_normal(problem.size)
    X.reshape(problem.m, -1)[:, 0] += 0.7
    return problem, X, STEP.get(request.param, 1e-5)


def test_jacobian_against_differences(case, slope):
    problem, X, h = case
    J = problem.evaluate(X, Omega=OMEGA)[1]
    columns = [slope(lambda x, e=e: problem.residual(X + x * e, Omega=OMEGA), h=h) for e in np.eye(len(X))]
    scale = max(1.0, np.abs(J).max())
    np.testing.assert_allclose(J / scale, np.transpose(columns) / scale, atol=1e-7)


def test_frequency_derivative_against_differences(case, slope):
    problem, X, _ = case
    analytic = problem.linearise(X, "Omega", Omega=OMEGA).dR_dp
    expected = slope(lambda Omega: problem.residual(X, Omega=Omega), OMEGA, 1e-4)
    np.testing.assert_allclose(analytic, expected, rtol=1e-7, atol=1e-7)


def test_second_derivatives_against_differences(case, rng, slope):
    """The second derivatives along X exist for smooth problems only."""
    problem, X, h = case
    v = rng.standard_normal(len(X))
    along, across = problem.curvature(X, v, "Omega", Omega=OMEGA)
    expected = slope(lambda x: problem.evaluate(X + x * v, Omega=OMEGA)[1], h=h / np.linalg.norm(v))
    if problem.smooth:
        np.testing.assert_allclose(along, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    expected = slope(lambda Omega: problem.evaluate(X, Omega=Omega)[1], OMEGA, 1e-4)
    np.testing.assert_allclose(across, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


class Own(Cubic):
    """A cubic spring of a class that hbgear does not know."""

    rated = False


class Rated(Own):
    """The same law, declared as dependent on the velocity."""

    rated = True


def test_a_law_that_needs_no_velocity_is_evaluated_as_one_that_gets_it(rng):
    X, found = rng.standard_normal(11), []
    for law in (Cubic(0.3, 0.1), Own(0.3, 0.1), Rated(0.3, 0.1)):
        system = System(np.eye(1), 0.1 * np.eye(1), np.eye(1), [Element(np.ones(1), law)], Load(cosine={1: np.ones(1)}))
        problem = HarmonicBalance(system, 5)
        sampled = problem.compiled({}).aft_laws
        assert not sampled if type(law) is Cubic else [each.rated for _, each in sampled] == [law.rated]
        found.append(problem.linearise(X, "Omega", Omega=OMEGA))
    for known, own, rated in zip(*found, strict=True):
        np.testing.assert_allclose(own, rated, rtol=0, atol=1e-14)
        np.testing.assert_allclose(own, known, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["zeta", "F_m", "b", "eps_scale", "e_scale"])
def test_parameter_derivative_against_differences(name, rng, slope):
    problem = HarmonicBalance(SpurPair(eps=(0.2, 0.1)), 6)
    X, value = 0.4 * rng.standard_normal(problem.size), problem.parameters[name]
    found = problem.linearise(X, name, Omega=OMEGA).dR_dp
    expected = slope(lambda x: problem.residual(X, Omega=OMEGA, **{name: x}), value, 1e-4)
    np.testing.assert_allclose(found, expected, atol=1e-7)
    assert np.linalg.norm(expected) > 1e-3


def test_parameter_derivative_at_the_end_of_its_range():
    """zeta must not be negative; at zero the difference is one-sided."""
    problem = HarmonicBalance(Duffing(zeta=0.0), 1)
    found = problem.linearise(np.array([0.0, 0.5, 0.2]), "zeta", Omega=OMEGA).dR_dp
    np.testing.assert_allclose(found, [0, 2 * OMEGA * 0.2, -2 * OMEGA * 0.5], atol=1e-8)


def imbalance(problem, X, Omega):
    """Return the residual (n, T) of the equations of motion along a motion, computed in the time domain."""
    system, nu = problem.model.system(), problem.nu
    q = to_complex(problem.motion(X, Omega=Omega))
    omega = Omega / nu
    q0, q1, q2 = (omega**o * evaluate(to_real(derive(q, o)), TAU) for o in range(3))
    F = np.zeros_like(q0)
    for load in system.load:
        for order, amplitude in load.complex(system.n).items():
            F += Omega**load.power * (amplitude[:, None] * np.exp(1j * order * nu * TAU)).real
    left = system.M @ q2 + system.C @ q1 + system.K @ q0 - F
    for element, row in zip(system.elements, X.reshape(problem.m, -1), strict=True):
        e = stretch(element.displacement.row(), nu)
        d = element.direction @ q0 - evaluate(e, TAU)
        v = element.direction @ q1 - omega * evaluate(e, TAU, 1)
        np.testing.assert_allclose(d, evaluate(row, TAU), atol=1e-9)
        p = element.law.force(d, v, nu * TAU)[0] + element.damping * v
        left += np.outer(element.direction, p)
    return left


@pytest.mark.parametrize("name", ["duffing", "spur pair, sampled", "three masses", "three masses, nu = 2"])
def test_a_solution_solves_the_equations_of_motion(name):
    """At a zero of R harmonics 0 to H of the residual of the equations of motion vanish."""
    problem = PROBLEMS[name]()
    problem = HarmonicBalance(problem.model, problem.H, samples=256, nu=problem.nu, sampled=True)
    Omega = OMEGA if problem.m > 1 else 1.5
    rest = np.fft.rfft(imbalance(problem, problem.start(Omega), Omega))[:, : problem.H + 1] / len(TAU)
    np.testing.assert_allclose(rest, 0, atol=1e-9)


def test_mesh_forces_accelerate_the_masses():
    """The mesh force equals the load minus the inertia force: q'' = F_m - mesh force."""
    problem = HarmonicBalance(SpurPair(eps=(0.2,)), 8)
    X = problem.start(1.6)
    q = to_complex(problem.motion(X, Omega=1.6))
    force = to_complex(problem.mesh_forces(X, Omega=1.6))
    expected = -(1.6**2) * derive(q, 2)
    expected[:, 0] += 0.1
    np.testing.assert_allclose(force, expected, atol=1e-10)


def test_parameters_given_are_those_of_the_model(rng):
    """evaluate(zeta=...) equals the balance of the changed model and does not change the problem."""
    problem = HarmonicBalance(DoubleHelicalPair(), 4)
    X = 0.4 * rng.standard_normal(problem.size)
    before = problem.evaluate(X, Omega=OMEGA)
    for name, value in {"zeta": 0.2, "W": 0.4, "torque": 2000.0, "I_p": 0.02, "e_scale": 0.0, "b_c": 3e-5}.items():
        changed = HarmonicBalance(DoubleHelicalPair(**{name: value}), 4).evaluate(X, Omega=OMEGA)
        for a, b in zip(problem.evaluate(X, Omega=OMEGA, **{name: value}), changed, strict=True):
            np.testing.assert_array_equal(a, b)
        assert not np.allclose(changed[0], before[0], rtol=1e-6)
    for a, b in zip(problem.evaluate(X, Omega=OMEGA), before, strict=True):
        np.testing.assert_array_equal(a, b)


def test_many_parameter_sets_and_frequencies_in_turn(rng):
    """The caches return the compiled model of the given parameters in any order of calls."""
    problem = HarmonicBalance(SpurPair(), 4)
    X = rng.standard_normal(problem.size)
    visits = [(w, z) for z in np.linspace(0.01, 0.3, 12) for w in (0.7, 1.1)]
    first = [problem.residual(X, Omega=w, zeta=z) for w, z in visits]
    for i in rng.permutation(len(visits)):
        w, z = visits[i]
        np.testing.assert_array_equal(problem.residual(X, Omega=w, zeta=z), first[i])


def test_two_balances_share_nothing(rng):
    X = rng.standard_normal(9)
    alone = HarmonicBalance(SpurPair(), 4).evaluate(X, Omega=OMEGA)[0]
    a, b = HarmonicBalance(SpurPair(), 4), HarmonicBalance(SpurPair(zeta=0.3), 4)
    b.evaluate(X, Omega=OMEGA)
    kept = a.evaluate(X, Omega=OMEGA)[0]
    a.evaluate(2 * X, Omega=1.1)
    np.testing.assert_array_equal(kept, alone)
    again = pickle.loads(pickle.dumps(a))
    np.testing.assert_array_equal(again.evaluate(X, Omega=OMEGA)[0], alone)


def test_arguments_are_not_changed(rng):
    problem = HarmonicBalance(three_masses(), 4)
    X = rng.standard_normal(problem.size)
    X.flags.writeable = False
    problem.evaluate(X, Omega=OMEGA)
    problem.observe(X, Omega=OMEGA)
    problem.motion(X, Omega=OMEGA)


def test_regime_clearance_and_switching():
    """d = 0.4 + 1.5 cos(theta) crosses both breakpoints, -1 and 1."""
    problem = HarmonicBalance(SpurPair(), 2)
    X = np.array([0.4, 1.5, 0, 0, 0])
    np.testing.assert_allclose(problem.clearance(X, Omega=1.0), [-0.1, 2.9, -2.1, 0.9], atol=1e-14)
    assert problem.clearance_names[3] == "highest of gap at 1"
    expected = np.concatenate([np.arccos([-1.4 / 1.5, 0.6 / 1.5]), -np.arccos([-1.4 / 1.5, 0.6 / 1.5]) + 2 * np.pi])
    np.testing.assert_allclose(np.sort(problem.switching(X, Omega=1.0).theta), np.sort(expected), atol=1e-14)
    for mean, regime in ((0.4, 2), (1.0, 1), (3.0, 0), (0.6, 1), (-3.0, 0)):
        X[0] = mean
        assert problem.regime(X, Omega=1.0) == [regime]
    assert problem.regime(np.array([0, 0.5, 0, 0, 0]), Omega=1.0) == [0]


def test_a_grazing_extremum_is_an_entry_of_the_clearance(rng):
    problem = HarmonicBalance(DoubleHelicalPair(stagger=0.5), 4)
    X = rng.standard_normal(problem.size)
    clearance = problem.clearance(X)
    for which, expected in enumerate(clearance):
        g, theta = grazing_distance(problem.compiled({}), X, which)
        element, corner = divmod(which // 2, 2)
        row = X.reshape(problem.m, -1)[element]
        assert g == pytest.approx(expected, abs=1e-13)
        assert evaluate(row, theta)[0] - (-1, 1)[corner] == pytest.approx(g, abs=1e-12)
        assert evaluate(row, theta, 1)[0] == pytest.approx(0.0, abs=1e-8)


def test_truncation_estimate_predicts_the_error():
    """The estimate at H = 10 against the difference to H = 80, for a motion with contact loss."""
    coarse, fine = HarmonicBalance(SpurPair(), 10), HarmonicBalance(SpurPair(), 80)
    X = _traced(coarse)
    x = _traced(fine)
    error = np.sqrt(0.5 * np.sum((x - np.pad(X, (0, len(x) - len(X))))[1:] ** 2))
    assert error / 4 < coarse.truncation(X, Omega=0.78) < 4 * error
    assert fine.truncation(x, Omega=0.78) < error / 100


def _traced(problem):
    """Return the upper motion at Omega = 0.78, continued from Omega = 1.5 in small steps."""
    from hbgear.continuation.solvers.newton import solve

    X = problem.start(1.5)
    for Omega in np.linspace(1.5, 0.78, 30):
        X = solve(problem, X, {"Omega": Omega}).X
    return X


def test_one_harmonic_of_every_model():
    for model, Omega in ((Duffing(), 1.5), (SpurPair(), 1.5), (DoubleHelicalPair(e=(0.03,), eps=(0.1,)), 1.5)):
        problem = HarmonicBalance(model, 1)
        X = problem.start(Omega)
        assert np.linalg.norm(problem.residual(X, Omega=Omega)) < 1e-9
        assert problem.observe(X, Omega=Omega)["multipliers"].size > 0


@pytest.mark.parametrize("count", [15, 25])
def test_unknowns_of_another_number_of_harmonics_are_refused(count):
    """Kernels index by the number of harmonics of the problem: other arrays would be written out of bounds."""
    problem, X = HarmonicBalance(SpurPair(), 9), np.full(count, 0.7)
    at = {"Omega": 1.0}
    for ask in (
        problem.evaluate,
        problem.residual,
        problem.multipliers,
        problem.regime,
        problem.clearance,
        problem.switching,
        problem.truncation,
        problem.observe,
        problem.force_rows,
        problem.mesh_forces,
        problem.motion,
        lambda X, **at: problem.linearise(X, "Omega", **at),
    ):
        with pytest.raises(ValueError, match=r"need the unknowns of one motion, 1 x \(2H \+ 1\) = 19 numbers"):
            ask(X, **at)


def test_smooth_means_no_sampled_corner():
    assert HarmonicBalance(Duffing(), 3).smooth
    assert HarmonicBalance(SpurPair(), 3).smooth
    assert not HarmonicBalance(SpurPair(), 3, sampled=True).smooth


def test_higher_order_in_time_holds_the_same_motion():
    problem = HarmonicBalance(SpurPair(), 5)
    X = problem.start(1.5)
    doubled = problem.with_order(2)
    assert (doubled.nu, doubled.H) == (2, 10)
    Y = doubled.from_layout(X, problem.layout)
    np.testing.assert_allclose(doubled.residual(Y, Omega=1.5), 0, atol=1e-10)
    assert not Y[1::4].any() and not Y[2::4].any()
    with pytest.raises(ValueError, match="nu = 2 is not periodic with nu = 3"):
        problem.with_order(3, 9).from_layout(Y, doubled.layout)


@pytest.mark.parametrize(
    ("model", "Omega"), [(SpurPair(), 0.86), (SpurPair(eps=(0.2, 0.1)), 0.77), (Duffing(k3=2.0, F=2.0), 1.7)]
)
def test_start_inside_a_resonance(model, Omega):
    """The linear response is a poor initial guess inside a resonance, but a motion exists."""
    problem = HarmonicBalance(model, 8)
    X = problem.start(Omega)
    assert np.linalg.norm(problem.residual(X, Omega=Omega)) < 1e-9


def test_a_start_that_only_another_frequency_leads_to():
    """Strong excitation and little damping far below resonance: all guesses fail, but continuation finds a motion."""
    pair = SpurPair(zeta=0.00822908, F_m=0.26746474, e=(0.56724623, 0.18651221, 0.07432142))
    problem = HarmonicBalance(pair, 16)
    X = problem.start(0.3)
    now = problem.linearise(X, "", Omega=0.3)
    assert np.linalg.norm(now.R) <= 1e-9 * now.size and len(X) == problem.size
    assert trace(problem, "Omega", (0.3, 0.32)).status.complete


def test_start_without_any_periodic_motion():
    """A load that opens the gap without bound raises NoConvergence with X, residuals and parameters."""
    problem = HarmonicBalance(single_mass(Unilateral(1.0, 0.0), F=0.1, mean=-0.1, c=None, k=0.0, damping=0.1), 3)
    with pytest.raises(NoConvergence, match="singular") as caught:
        problem.start(0.9)
    assert caught.value.X.shape == (7,) and caught.value.residuals and caught.value.parameters == {"Omega": 0.9}


@dataclass(frozen=True)
class Unfinished(Model):
    zeta: float = 0.1

    def system(self):
        return Duffing(zeta=self.zeta).system()


def test_a_model_of_the_user():
    problem = HarmonicBalance(Unfinished(), 3)
    assert problem.parameters == {"zeta": 0.1}
    X = problem.start(0.5)
    np.testing.assert_allclose(X, HarmonicBalance(Duffing(zeta=0.1), 3).start(0.5), atol=1e-14)


def evaluated(**parameters):
    return HarmonicBalance(Duffing(), 3).evaluate(np.zeros(7), Omega=1.0, **parameters)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: HarmonicBalance("duffing"), TypeError, r"needs a model, .*; got 'duffing'"),
        (lambda: HarmonicBalance(Duffing(), 0), ValueError, "harmonics = 0 must be a whole number of at least 1"),
        (lambda: HarmonicBalance(Duffing(), 2.5), ValueError, "harmonics = 2.5"),
        (lambda: HarmonicBalance(Duffing(), 3, nu=0), ValueError, "nu = 0"),
        (lambda: HarmonicBalance(Duffing(), 8, 16), ValueError, "N = 16 samples .* H = 8 harmonics; need N >= 17"),
        (lambda: evaluated(zetta=1), KeyError, "Duffing has no parameter 'zetta'; did you mean 'zeta'"),
        (lambda: evaluated(zeta=-1.0), ValueError, "must not be negative"),
        (lambda: evaluated(zeta=np.nan), ValueError, "finite"),
    ],
)
def test_bad_input(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_excitation_above_the_harmonics_is_warned_of():
    with pytest.warns(UserWarning, match="the excitation has 3 harmonics but H = 2 with nu = 1 keeps only 2"):
        HarmonicBalance(DoubleHelicalPair(), 2)


@pytest.mark.parametrize("model", [Duffing(), SpurPair(eps=(0.2,)), DoubleHelicalPair(zeta=0.05)], ids=type)
def test_many_motions_are_observed_as_one_by_one(model):
    """Points with and without contact loss: equal regimes, clearances, truncation errors and multipliers."""
    problem = HarmonicBalance(model, 8)
    branch = trace(problem, "Omega", (1.1, 0.7), special=False, stability=False)
    some = slice(None, None, 5)
    together = problem.observe_many(branch.X[some], "Omega", branch.values[some])
    for seen, X, Omega in zip(together, branch.X[some], branch.values[some], strict=True):
        (alone,) = problem.observe_many(X[None], "Omega", np.array([Omega]))
        assert seen.keys() == alone.keys()
        for name, value in alone.items():
            np.testing.assert_allclose(seen[name], value, rtol=1e-9, atol=1e-13, err_msg=name)


def test_a_curve_is_complete_where_tables_for_twice_the_harmonics_are_too_large(monkeypatch):
    """A train of 35/55 and 81/50 teeth lost its curve, because the error of its motions needed a table of 1.9 GB."""
    problem = HarmonicBalance(SpurPair(zeta=0.05), 16)
    finer = problem.refined_problem
    monkeypatch.setattr(discretization, "MAX_TABLE", (2 * problem.H + 1) * problem.N)
    limited = HarmonicBalance(SpurPair(zeta=0.05), 16)
    assert finer is not None and limited.refined_problem is None
    assert trace(limited, "Omega", (0.9, 0.8)).status.complete


def test_comparisons_with_fewer_harmonics_have_the_weights_of_an_error_of_second_order(monkeypatch):
    """If e(H) = c / H^2, each difference times its weight is e(H); other differences have the weight 1."""
    problem = HarmonicBalance(SpurPair(), 16)
    assert [(other.H, weight) for other, weight in problem.comparisons] == [(24, 1.0), (32, 1.0)]
    monkeypatch.setattr(discretization, "MAX_REFINED_UNKNOWNS", 20)
    problem = HarmonicBalance(SpurPair(), 16)
    assert [other.H for other, _ in problem.comparisons] == [12, 8]
    for other, weight in problem.comparisons:
        assert weight * (other.H**-2.0 - 16**-2.0) == pytest.approx(16**-2.0, rel=1e-12)


def test_distance_of_two_motions_is_the_rms_of_their_amplitudes():
    """Means differ by 0.3, first harmonics by |5| - |13| in other phases; a motion of two periods adds its own ones."""
    problem = HarmonicBalance(SpurPair(), 2)
    a, b = np.array([0.1, 3.0, 4.0, 0.0, 0.0]), np.array([0.4, -12.0, 5.0, 0.0, 0.0])
    layout = problem.layout
    assert layout.distance(a, layout, b) == pytest.approx((0.3**2 + 8.0**2 / 2) ** 0.5, rel=1e-12)
    doubled = problem.doubled.layout
    half = np.zeros(problem.doubled.size)
    half[[0, 1, 3, 4]] = 0.1, 2.0, 3.0, 4.0  # the harmonic 1/2 has the amplitude 2
    assert layout.distance(a, doubled, half) == pytest.approx(2.0**0.5, rel=1e-12)
