"""Neimark-Sacker points: against shooting, differences, curves traced again, and one method against the other."""

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

import hbgear as hb
from hbgear.continuation.augmented.sensitivity import of_special
from hbgear.harmonic.bifurcations.neimark_sacker import PairModulusProblem
from hbgear.time.integration import state_of


def nearest_to_the_circle(mu):
    """Logarithm of the modulus of the complex pair nearest to the unit circle, and its angle."""
    pairs = mu[mu.imag > 1e-6]
    one = pairs[np.argmin(np.abs(np.log(np.abs(pairs))))]
    return np.log(np.abs(one)), np.angle(one)


@pytest.fixture(scope="module")
def curve():
    """The double-helical pair at little damping."""
    return hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 16), "Omega", (1.0, 0.8))


def test_the_equations_are_differentiated_exactly(curve):
    point, problem = curve["NS1"], hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 16)
    U = np.append(problem.from_point(point), point.parameters["Omega"])
    equations = hb.harmonic.NeimarkSackerProblem(problem, "Omega").with_borders_at(U, {"zeta": 0.05})
    now = equations.linearise(U, "zeta", zeta=0.05)
    step = 1e-6 * np.random.default_rng(1).normal(size=len(U))
    up, down = (equations.linearise(U + sign * step, "", zeta=0.05).R[-1] for sign in (1, -1))
    assert (up - down) / 2 == pytest.approx(now.dR_dX[-1] @ step, rel=1e-5)
    up, down = (equations.linearise(U, "", zeta=0.05 + sign * 1e-6).R[-1] for sign in (1, -1))
    assert (up - down) / 2e-6 == pytest.approx(now.dR_dp[-1], rel=1e-5)


@pytest.mark.slow
def test_multipliers_of_the_shot_motion_lie_on_the_circle(curve):
    """Also where the point has moved with the damping; the angle is that of the exponent."""
    equations = hb.harmonic.NeimarkSackerProblem(curve.problem.with_order(1, 32), "Omega")
    held = hb.trace(equations, "zeta", (0.05, 0.06), start=curve["NS1"], steps=hb.StepControl(max_points=6))
    assert [point.label for point in held.special] == ["LPNS1"] and len(held) == 7
    assert held.tracked["Omega"][-1] != held.tracked["Omega"][0]
    for i in (0, 6):
        Omega, zeta, X = held.tracked["Omega"][i], held.values[i], held.X[i]
        problem = curve.problem.with_order(1, 32)
        orbit = hb.time.shoot(
            hb.gears.DoubleHelicalPair(zeta=zeta), Omega, state_of(problem, X, Omega=Omega, zeta=zeta)
        )
        growth, angle = nearest_to_the_circle(orbit.multipliers)
        assert abs(growth) < 2e-5
        s = equations.exponent(X, Omega=Omega, zeta=zeta)
        assert abs(np.angle(np.exp(2j * np.pi * s.imag / Omega))) == pytest.approx(angle, abs=1e-4)


def test_it_is_found_with_any_step(curve):
    places = []
    for longest in (0.004, 0.02):
        steps = hb.StepControl(first_step=0.002, max_step=longest)
        again = hb.trace(curve.problem, "Omega", (1.0, 0.8), steps=steps, accuracy=None)
        places.append([p.parameters["Omega"] for p in again.special if p.kind == "NS"])
    assert len(places[0]) == len(places[1]) > 0
    np.testing.assert_allclose(places[0], places[1], rtol=1e-10)


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
def test_where_there_is_none():
    duffing = hb.HarmonicBalance(hb.Duffing(), 7)
    X = duffing.start(Omega=3.0)
    linear = hb.HarmonicBalance(hb.SpurPair(zeta=2.0, e=(0.01,)), 8)
    with pytest.raises(ValueError, match="no complex pair of multipliers"):
        hb.harmonic.NeimarkSackerProblem(linear).with_borders_at(np.append(linear.start(Omega=0.5), 0.5), {})
    s = hb.harmonic.NeimarkSackerProblem(duffing).exponent(X, Omega=3.0)
    assert s.real == pytest.approx(-hb.Duffing().zeta, rel=1e-6)  # a pair that decays with the damper


def test_a_linear_motion_has_the_exponents_of_its_modes():
    """Both modes of two masses decay with half the damping, and turn with their damped frequencies less Omega."""
    two = hb.System(
        np.eye(2),
        0.1 * np.eye(2),
        [[2.0, -1.0], [-1.0, 2.0]],
        [hb.Element([1, 0], hb.Unilateral(k=5.0, gap=100.0))],
        hb.Load(cosine={1: [0.1, 0.0]}),
    )
    problem = hb.HarmonicBalance(two, 5)
    s = hb.harmonic.NeimarkSackerProblem(problem).exponent(problem.start(Omega=1.3), Omega=1.3)
    assert s.real == pytest.approx(-0.05, rel=1e-9)
    turns = np.array([sign * np.sqrt(k - 0.05**2) for k in (1.0, 3.0) for sign in (1, -1)])
    assert np.abs(((s.imag - turns) / 1.3 + 0.5) % 1.0 - 0.5).min() < 1e-9


PAIR = hb.gears.DoubleHelicalPair(
    phi_deg=2.4450378633291523,
    zeta=0.006114419661484982,
    torque=370.6846248952864,
    W=0.37760398300698106,
    eps_scale=1.3324911562218102,
    e_scale=3.1570524284344605,
    e_phase=3.0417072415162063,
    stagger=np.pi,
    support_damping="zeta",
    tilt=False,
)
"""Little damping and load: many pairs of multipliers lie next to the unit circle and pass it."""


def neimark_sacker_of(curve):
    return [p.parameters["Omega"] for p in curve.special if p.kind == "NS"]


@pytest.mark.slow
def test_two_pairs_next_to_the_circle_are_two_points():
    """Each is judged by its own exponent with more harmonics, not by that of the other pair."""
    problem, span = hb.HarmonicBalance(PAIR, 16), (0.43, 0.416)
    curves = [hb.trace(problem, "Omega", span, cover=False)]
    curves += [hb.trace(problem.with_order(1, 48), "Omega", span, accuracy=None)]
    mine, fine = ([x for x in neimark_sacker_of(one) if 0.4162 < x < 0.4166] for one in curves)
    assert len(fine) == 3 and mine == pytest.approx(fine, abs=2e-6)
    assert min(-np.diff(fine)) > 2e-5


@pytest.mark.slow
def test_pairs_that_pass_between_two_points_are_found():
    """Two that leave together, one that leaves and returns, one that leaves as another returns: as by short steps."""
    problem, span = hb.HarmonicBalance(PAIR, 16), (0.87, 0.68)
    curve = hb.trace(problem, "Omega", span, accuracy=None)
    short = hb.trace(problem, "Omega", span, accuracy=None, steps=hb.StepControl(max_step=1e-3))
    assert len(curve) < 50 and len(short) > 1000
    assert len(neimark_sacker_of(short)) == 9
    assert neimark_sacker_of(curve) == pytest.approx(neimark_sacker_of(short), abs=1e-8)


def test_a_doubling_is_no_neimark_sacker_point():
    """Hill's determinant is zero there too, at half the frequency of the motion."""
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(zeta=0.03, F_m=0.05), 10), "Omega", (1.4, 1.1))
    point = next(p for p in curve.special if p.kind == "PD")
    Omega = point.parameters["Omega"]
    U = np.append(curve.problem.from_point(point), Omega)
    with pytest.raises(hb.NoConvergence, match="became real"):
        hb.harmonic.NeimarkSackerProblem(curve.problem, "Omega", near=0.5j * Omega).with_borders_at(U, {}).linearise(
            U, ""
        )


def between_stops():
    """Return two masses, one of them between stops, where H = 16 has a Neimark-Sacker point at 0.53300."""
    C = [[0.02954701, -0.01334178], [-0.01334178, 0.02488377]]
    K = [[1.85088655, -1.20091555], [-1.20091555, 1.20091555]]
    stops = hb.Element([0.0, 1.0], hb.Backlash(b=0.35092747, k=25.50283167))
    load = hb.Load(cosine={1: [0.0, 0.05034684], 2: [0.0, 0.01510405]})
    return hb.System(np.diag([0.9163537, 1.17723058]), C, K, [stops], load)


@pytest.mark.slow
def test_an_error_is_estimated_where_the_first_step_with_more_harmonics_ends_where_it_began():
    model = between_stops()
    balance = hb.HarmonicBalance(model, 16)  # with a start, the curve is not traced in contact instants
    stopped = hb.trace(balance, "Omega", (0.5, 0.54), balance.start(Omega=0.5))
    point = stopped["NS1"]
    problem = stopped.problem.at_resolution_of(point)
    state = state_of(problem, problem.from_point(point), **point.parameters)
    Omega = point.parameters["Omega"] + np.array([-1e-6, 1e-6])
    low, high = (nearest_to_the_circle(hb.time.shoot(model, x, state).multipliers)[0] for x in Omega.tolist())
    true = Omega[0] - low * (Omega[1] - Omega[0]) / (high - low)
    assert point.parameters["Omega"] == pytest.approx(true, abs=3 * point.error)
    assert point.error < 1e-6


@pytest.mark.slow
def test_a_curve_that_the_harmonics_do_not_resolve_has_each_point_once():
    """H = 16 leaves an error of the Neimark-Sacker point; the curve is traced in contact instants."""
    stopped = hb.trace(hb.HarmonicBalance(between_stops(), 16), "Omega", (0.5, 0.6))
    assert "contact instants" in stopped.message
    assert [point.label for point in stopped.special if point.kind == "PD"] == ["PD1", "PD2"]
    assert stopped["PD1"].parameters["Omega"] < 0.55 < stopped["PD2"].parameters["Omega"]


@pytest.mark.slow
@pytest.mark.parametrize("span", [(1.36, 1.6), (1.6, 1.36)])
def test_a_pair_that_is_real_for_a_while_is_located_next_to_a_doubling(span):
    """A pair collides on the real axis, one of both meets a third multiplier that passed -1, and this pair returns."""
    elements = [
        hb.Element([0.0, -1.0], hb.Unilateral(k=27.177, gap=0.408), name="stop"),
        hb.Element([-1.0, 1.0], hb.Backlash(b=0.4, k=0.522), name="backlash"),
    ]
    model = hb.System(
        np.diag([1.741, 0.582]),
        [[0.125, -0.059], [-0.059, 0.11]],
        [[1.558, -0.995], [-0.995, 1.667]],
        elements,
        hb.Load(constant=[-0.033, -0.076], cosine={1: [0.0, 0.382]}),
        speed=hb.mechanics.SpeedTerms(gyroscopic=[[0.0, 0.096], [-0.096, 0.0]]),
    )
    curves = (
        hb.trace(problem, "Omega", span) for problem in (hb.HarmonicBalance(model, 48), hb.ContactInstants(model))
    )
    balance, exact = ([p for p in curve.special if p.kind in ("NS", "PD")] for curve in curves)
    order = ["NS", "PD", "NS"]
    assert [p.kind for p in balance] == [p.kind for p in exact] == order
    for one, other in zip(balance, exact, strict=True):
        assert one.parameters["Omega"] == pytest.approx(other.parameters["Omega"], abs=5e-6)
        assert abs(one.parameters["Omega"] - other.parameters["Omega"]) < 3 * one.error


def test_equations_of_multipliers_and_hills_determinant_have_the_same_point(curve):
    point, problem = curve["NS1"], hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 32)
    U = np.append(problem.resized(curve.problem.from_point(point)), point.parameters["Omega"])
    places, slopes = [], []
    for kind in (hb.harmonic.NeimarkSackerProblem, PairModulusProblem):
        equations = kind(problem, "Omega")
        found = equations.located(U, {"zeta": 0.05}).X
        here = {"zeta": 0.05, "Omega": found[-1]}
        places.append(found[-1])
        slopes.append(of_special(equations, found, here, ("zeta",)).p[0])
    assert places[0] == pytest.approx(places[1], rel=5e-8)
    assert slopes[0] == pytest.approx(slopes[1], rel=2e-5)


@hb.mechanics.model
def chain(limit: float = 0.03, damper: float = 0.0, c: float = 0.03) -> hb.System:
    """Two masses, a slider on the first one, a stop without or with damper on the second one."""
    K, stop = np.array([[2.0, -1.0], [-1.0, 2.0]]), hb.Unilateral(k=10.0, gap=0.2)
    if damper:
        stop = hb.mechanics.KelvinVoigt(10.0, damper, 0.2)
    elements = [hb.Element([0.0, 1.0], stop), hb.Element([1.0, 0.0], hb.mechanics.Jenkins(0.5, limit))]
    return hb.System(np.eye(2), c * K, K, elements, hb.Load(cosine={1: [0.5, 0.0]}))


@pytest.mark.slow
@pytest.mark.parametrize("damper", [0.0, 0.02])
def test_with_sliders_the_followed_point_is_that_of_a_curve_traced_again(damper):
    """The second parameter changes; the sensitivity is the slope of the curve in two parameters."""
    span = (1.66, 1.58)

    def traced(limit):
        return hb.trace(hb.HarmonicBalance(chain(limit=limit, damper=damper), 12), "Omega", span, accuracy=None)

    first, last = traced(0.03), traced(0.033)
    along = hb.follow(first, "NS1", "limit", (0.03, 0.033), accuracy=None)
    assert along.status is hb.Status.REACHED_END
    Omega = along.tracked["Omega"]
    assert Omega[-1] == pytest.approx(last["NS1"].parameters["Omega"], rel=1e-9)
    assert abs(Omega[-1] - Omega[0]) > 1e-5
    slope = hb.analysis.sensitivity(first["NS1"]).of("Omega")["limit"]
    assert (Omega[1] - Omega[0]) / (along.values[1] - along.values[0]) == pytest.approx(slope, rel=1e-2)


@pytest.mark.slow
def test_a_pair_that_turns_by_a_quarter_stays_the_same_pair():
    """Its multiplier moves further than the distance of the two pairs; the curve ended where the other was nearer."""

    @hb.mechanics.model
    def rub(load: float = 0.3) -> hb.System:
        seal = hb.mechanics.VectorElement(np.eye(2), hb.mechanics.RadialClearance(4.0, 1.0, friction=0.1))
        unbalance = hb.Load([0.0, -0.3], cosine={1: [load, 0.0]}, sine={1: [0.0, load]}, power=2)
        return hb.System(np.eye(2), 0.1 * np.eye(2), np.eye(2), list(seal), unbalance)

    curve = hb.trace(hb.HarmonicBalance(rub(), 9), "Omega", (1.065, 1.08), accuracy=None, cover=False)
    followed = hb.follow(curve, "NS1", "load", (0.3, 0.565), accuracy=None)
    assert followed.status is hb.Status.REACHED_END
    angles = []
    for i in (0, len(followed) - 1):
        Omega, load = followed.tracked["Omega"][i], followed.values[i]
        state = state_of(curve.problem, followed.X[i], Omega=Omega, load=load)
        growth, angle = nearest_to_the_circle(hb.time.shoot(rub(load=load), Omega, state).multipliers)
        assert abs(growth) < 1e-4  # 1e-2 at a frequency that differs by 0.1 %
        angles.append(angle)
    assert angles[0] - angles[1] > 0.7


@numba.njit
def belt(d, v, tau, k):
    """Friction of a belt that moves with 0.8; it falls with the sliding velocity, and reverses within k[0]."""
    slip = v - 0.8
    steep, falling = np.tanh(slip / k[0]), np.exp(-((slip / 0.5) ** 2))
    size = 0.3 + 0.2 * falling
    return steep * size, 0.0, (1 - steep**2) / k[0] * size - steep * 0.8 * falling * 2 * slip


@pytest.mark.slow
def test_friction_of_a_moving_belt_has_its_point_where_multipliers_of_shooting_pass_the_circle():
    """Steep friction is resolved where the pair is located, not only at the points of the curve."""
    width, F = 0.02, 0.8
    law = hb.mechanics.CompiledLaw(belt, parameters=(width,))
    mass = hb.System([[1.0]], [[0.03]], [[1.0]], [hb.Element([1.0], law)], hb.Load(cosine={1: [F]}))
    curve = hb.trace(hb.HarmonicBalance(mass), "Omega", (1.3, 2.0))
    (point,) = curve.special
    problem, start = point.problem, point.parameters["Omega"]

    def period(y, Omega):
        def rates(t, Y):
            force, _, damping = belt.py_func(Y[0], Y[1], 0.0, (width,))
            J = np.array([[0.0, 1.0], [-1.0, -0.03 - damping]])
            return [Y[1], F * np.cos(Omega * t) - 0.03 * Y[1] - Y[0] - force, *(J @ Y[2:].reshape(2, 2)).ravel()]

        end = 2 * np.pi / Omega
        out = solve_ivp(rates, (0, end), [*y, 1, 0, 0, 1], "DOP853", rtol=1e-10, atol=1e-12, max_step=end / 300)
        return out.y[:2, -1], out.y[2:, -1].reshape(2, 2)

    def growth(Omega):
        y = root(lambda y: (lambda end, Phi: (end - y, Phi - np.eye(2)))(*period(y, Omega)), guess, jac=True).x
        return np.log(np.abs(np.linalg.eigvals(period(y, Omega)[1])).max())

    guess = state_of(problem, problem.from_point(point), Omega=start)
    true = brentq(growth, start - 1e-4, start + 1e-4, xtol=1e-10)
    assert point.kind == "NS" and point.error < 2e-6
    assert abs(true - start) < 3 * point.error
