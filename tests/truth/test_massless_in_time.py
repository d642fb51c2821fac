"""Time integration of coordinates without mass against closed forms, SciPy, condensed systems and small masses."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy
from machines import static_node
from scipy.integrate import solve_ivp

import hbgear as hb
from hbgear.mechanics import Law

SPRING, DAMPER, OMEGA = 0.5, 0.3, 0.9
STOP = hb.Unilateral(k=2.0, gap=0.2)


@dataclass(frozen=True)
class CubicDamper(Law):
    """p = d + 2 v^3."""

    def force(self, d, v, tau):
        return d + 2 * v**3, np.ones_like(d), 6 * v**2


def maxwell(mass=0.0, direction=(1.0, 0.0), law=STOP, damper=0.0):
    """Return a mass on a spring, with a Maxwell element whose node q2 carries a load, and an element."""
    K = np.array([[1 + SPRING, -SPRING], [-SPRING, SPRING]])
    element = hb.Element(list(direction), law, damping=damper, name="stop")
    load = hb.Load([0.02, -0.1], cosine={1: [0.2, 0.0]}, sine={1: [0.0, 0.05], 2: [0.03, 0.0]})
    return hb.System(np.diag([1.0, mass]), np.diag([0.02, DAMPER]), K, [element], load)


def three_states(direction, law, damper=0.0):
    """Return x' of x = (q1, q1', q2), with the rate of an element at q2 solved by bracketing."""
    w = np.array(direction)

    def rates(t, x):
        q1, v1, q2 = x
        d = w @ [q1, q2]
        f1 = 0.02 + 0.2 * np.cos(OMEGA * t) + 0.03 * np.sin(2 * OMEGA * t)
        f2 = -0.1 + 0.05 * np.sin(OMEGA * t)

        def p(v2):
            v = w @ [v1, v2]
            return float(law.force(np.array([d]), np.array([v]), np.array([OMEGA * t]))[0][0]) + damper * v

        def balance(v2):
            return DAMPER * v2 + SPRING * (q2 - q1) + w[1] * p(v2) - f2

        v2 = scipy.optimize.brentq(balance, -1e3, 1e3, xtol=1e-15, rtol=1e-15)
        return [v1, f1 - 0.02 * v1 - q1 - SPRING * (q1 - q2) - w[0] * p(v2), v2]

    return rates


def exact(direction, law, y, t, damper=0.0):
    """Return q1, q1', q2 and q2' at the end, and d and d' of the element at instants t, by SciPy."""
    f, w = three_states(direction, law, damper), np.array(direction)
    found = solve_ivp(f, (0, t[-1]), y, method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True, max_step=0.01)
    x = found.sol(t)
    dx = np.array([f(at, own) for at, own in zip(t, x.T, strict=True)]).T
    return np.array([x[0, -1], x[2, -1], x[1, -1], dx[2, -1]]), w @ x[[0, 2]], w @ np.array([x[1], dx[2]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("direction", "law", "damper", "method"),
    [
        ((1.0, 0.0), hb.Cubic(3.0), 0.0, "DOP853"),
        ((1.0, 0.0), hb.Cubic(3.0), 0.1, "exponential"),
        ((0.0, 1.0), hb.Cubic(3.0), 0.1, "DOP853"),
        ((1.0, -1.0), hb.Cubic(3.0), 0.0, "Radau"),
        ((0.0, 1.0), STOP, 0.0, "DOP853"),
        ((1.0, -1.0), STOP, 0.1, "DOP853"),
        ((0.0, 1.0), CubicDamper(), 0.0, "DOP853"),
        ((1.0, -1.0), CubicDamper(), 0.1, "DOP853"),
    ],
)
def test_a_maxwell_element_has_three_states(direction, law, damper, method):
    model, samples = maxwell(direction=direction, law=law, damper=damper), 32
    steps = 96 if method == "exponential" else None
    motion = hb.time.integrate(model, [0.1, 0.4, 0.2, 9.9], 1, OMEGA, method=method, samples=samples, steps=steps)
    t = 2 * np.pi / OMEGA * np.arange(samples + 1) / samples
    end, d, v = exact(direction, law, [0.1, 0.2, 0.4], t, damper)
    tolerance = 2e-8 if method == "Radau" else 1e-9
    np.testing.assert_allclose(motion.end, end, rtol=0, atol=tolerance)
    np.testing.assert_allclose(motion.d[0], d[:-1], rtol=0, atol=tolerance)
    np.testing.assert_allclose(motion.v[0], v[:-1], rtol=0, atol=10 * tolerance)


def test_a_damper_and_a_spring_alone_relax_by_their_closed_form():
    """c q' + (k + k1) q = F cos(Omega t) without any mass."""
    c, k, k1, F = 0.4, 1.0, 0.5, 0.3
    element = hb.Element([1.0], hb.Cubic(0.0, k1), name="spring")
    model = hb.System([[0.0]], [[c]], [[k]], [element], hb.Load(cosine={1: [F]}))
    motion = hb.time.integrate(model, [0.7, 0.0], 3, OMEGA)
    t, rate = motion.tau / OMEGA, (k + k1) / c
    steady = F / (k + k1 + 1j * OMEGA * c)
    wave = steady * np.exp(1j * motion.tau)
    rest = (0.7 - steady.real) * np.exp(-rate * t)
    np.testing.assert_allclose(motion.d[0], wave.real + rest, rtol=0, atol=1e-10)
    np.testing.assert_allclose(motion.v[0], (1j * OMEGA * wave).real - rate * rest, rtol=0, atol=1e-9)


def turned(model):
    """Return a model in other coordinates q = Q r, with the matrix Q."""
    Q = np.linalg.qr(np.random.default_rng(1).standard_normal((model.n, model.n)))[0]
    (load,) = model.loads
    loads = hb.Load(cosine={order: Q.T @ np.asarray(f) for order, f in load.cosine.items()})
    elements = [replace(e, direction=tuple(Q.T @ np.asarray(e.direction))) for e in model.elements]
    return hb.System(*(Q.T @ A @ Q for A in (model.M, model.C, model.K)), elements, loads), Q


def sparse(model):
    return replace(model, **{name: scipy.sparse.csr_array(getattr(model, name)) for name in "MCK"})


@pytest.mark.parametrize("method", ["DOP853", "exponential"])
@pytest.mark.parametrize("form", ["as it is", "sparse", "turned"])
def test_static_nodes_follow_as_in_the_condensed_system(method, form):
    model, Q = turned(static_node(STOP)) if form == "turned" else (static_node(STOP), np.eye(3))
    model = sparse(model) if form == "sparse" else model
    start = np.array([0.1, 0.0, -0.2, 0.3, 0.0, 0.1])
    other = start[[0, 2, 3, 5]]
    y = np.concatenate([Q.T @ start[:3], Q.T @ start[3:]])
    found = hb.time.integrate(model, y, 3, OMEGA, method=method)
    expected = hb.time.integrate(static_node(STOP, condensed=True), other, 3, OMEGA, method=method)
    end = np.concatenate([Q @ found.end[:3], Q @ found.end[3:]])
    np.testing.assert_allclose(found.d, expected.d, rtol=0, atol=1e-10)
    np.testing.assert_allclose(end[[0, 2, 3, 5]], expected.end, rtol=0, atol=1e-10)
    q, v = expected.end[:2], expected.end[2:]
    assert end[1] == pytest.approx((1.5 * q[0] + 0.7 * q[1] + 0.2) / 2.2, abs=1e-9)
    assert end[4] == pytest.approx((1.5 * v[0] + 0.7 * v[1]) / 2.2, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("direction", [(1.0, 0.0), (1.0, -1.0)])
def test_motions_are_the_limit_of_small_masses(direction):
    start = hb.time.integrate(maxwell(direction=direction), [0.1, 0.4, 0.2, 0.0], 1, OMEGA).end
    end = hb.time.integrate(maxwell(direction=direction), start, 1, OMEGA).end
    errors = []
    for mass in (2e-3, 1e-3):
        near = hb.time.integrate(maxwell(mass, direction), start, 1, OMEGA, tolerance=1e-9).end
        errors.append(np.abs(near - end).max())
    assert errors[0] < 2e-2 and errors[1] == pytest.approx(0.5 * errors[0], rel=0.05)  # first order in the mass


@pytest.mark.slow
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (1.0, -1.0)])
@pytest.mark.parametrize("law", [hb.Cubic(3.0), CubicDamper()], ids=["spring", "damper"])
def test_the_monodromy_matrix_is_the_derivative_of_the_end(direction, law):
    model = maxwell(direction=direction, law=law)
    orbit = hb.time.shoot(model, OMEGA, [0.1, 0.1, 0.0, 0.0])
    assert orbit.multipliers.shape == (3,) and orbit.closure < 1e-11
    np.testing.assert_allclose(hb.time.integrate(model, orbit.state, 1, OMEGA).end, orbit.state, rtol=0, atol=1e-9)
    h, columns = 1e-4, []
    for step in h * np.eye(4):
        ahead, behind = (hb.time.integrate(model, orbit.state + s * step, 1, OMEGA).end for s in (1, -1))
        columns.append((ahead - behind) / (2 * h))
    np.testing.assert_allclose(orbit.monodromy, np.array(columns).T, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("law", "direction"), [(hb.Cubic(3.0), (1.0, 0.0)), (hb.Cubic(3.0), (0.0, 1.0)), (STOP, (1.0, 0.0))]
)
def test_shooting_finds_motions_and_multipliers_of_the_balance(law, direction):
    """The harmonics of a motion with a stop decrease as H^-4 where it acts on a mass: 1e-8 needs 200 of them."""
    from hbgear.continuation.solvers.newton import solve
    from hbgear.time.integration import state_of

    H = 200 if law is STOP else 31
    model = maxwell(direction=direction, law=law)
    problem = hb.HarmonicBalance(model, H)
    X = solve(problem, problem.start(Omega=OMEGA), {"Omega": OMEGA}).X
    orbit = hb.time.shoot(model, OMEGA, state_of(problem, X, Omega=OMEGA))
    np.testing.assert_allclose(orbit.rows(10)[0], X[:21], rtol=0, atol=1e-9)
    distance = np.abs(orbit.multipliers[:, None] - problem.multipliers(X, Omega=OMEGA))
    assert distance.shape == (3, 3) and distance.min(axis=0).max() < 1e-8 and distance.min(axis=1).max() < 1e-8


def strong(mass=0.0):
    """Return the mass with a Maxwell element and a stiff stop, whose resonance has two folds."""
    return replace(maxwell(mass, law=hb.Unilateral(k=20.0, gap=0.2)), load=hb.Load(cosine={1: [0.2, 0.01]}))


def test_sweeps_and_their_exponents_are_the_limit_of_small_masses():
    grid = np.linspace(1.2, 1.8, 4)
    exact, near, coarse = (hb.time.sweep(strong(mass), grid, "up") for mass in (0.0, 1e-5, 1e-4))
    fine, large = (np.abs(one.rms - exact.rms).max() for one in (near, coarse))
    assert (exact.period == 1).all() and large < 1e-3 and fine == pytest.approx(0.1 * large, rel=0.1)
    states = np.abs(near.states - exact.states).max(axis=0)
    assert (states < 1e-4).all()


def test_the_exponent_of_a_periodic_motion_is_that_of_its_multipliers():
    """lambda = log |mu| / T of the largest multiplier."""
    found = hb.time.bifurcation_diagram(strong(), "Omega", (0.5, 0.55), "up", values=2)
    for Omega, state, exponent in zip((0.5, 0.55), found.sweeps[0].states, found.lyapunov[0], strict=True):
        orbit = hb.time.shoot(strong(), Omega, state)
        assert exponent == pytest.approx(np.log(np.abs(orbit.multipliers[0])) * Omega / (2 * np.pi), rel=0.05)


def test_basins_are_those_of_small_masses():
    found = [hb.time.basins(strong(mass), 1.55, shape=(8, 8)) for mass in (0.0, 1e-6)]
    assert len(found[0].attractors) == 2
    for exact, near in zip(*(one.attractors for one in found), strict=True):
        assert exact.rms == pytest.approx(near.rms, rel=1e-5) and exact.share == near.share


@pytest.mark.slow
def test_a_curve_is_validated():
    curve = hb.trace(hb.HarmonicBalance(strong(), 40), "Omega", (1.2, 1.8))
    report = hb.validate(curve, 4)
    assert report.ok and len(report.jumps) == 2
    assert hb.time.compare_multipliers(curve, "LP1").agree


@pytest.mark.parametrize(
    ("law", "method", "message"),
    [
        (STOP, "exponential", "element 'stop' acts on coordinates without mass, which the exponential method, sweeps"),
        (hb.mechanics.Jenkins(1.0, 0.1), "DOP853", "friction, contacts with dampers and vector laws need masses"),
    ],
)
def test_elements_that_need_a_mass(law, method, message):
    with pytest.raises(ValueError, match=message):
        hb.time.integrate(maxwell(direction=(0.0, 1.0), law=law), np.zeros(4), 1, OMEGA, method=method)


def test_a_static_coordinate_with_an_element_is_refused():
    model = hb.System(
        np.diag([1.0, 0.0]),
        np.diag([0.1, 0.0]),
        [[2.0, -1.0], [-1.0, 1.0]],
        [hb.Element([0.0, 1.0], STOP, name="stop")],
    )
    for method in ("DOP853", "exponential"):
        with pytest.raises(ValueError, match="element 'stop' acts on coordinate 'q2' without mass and damping"):
            hb.time.integrate(model, np.zeros(4), 1, OMEGA, method=method)


@pytest.mark.slow
@pytest.mark.parametrize("law", [hb.mechanics.Jenkins(1.0, 0.1), hb.mechanics.KelvinVoigt(2.0, 0.2, gap=0.1)])
def test_memory_and_jumps_on_the_mass_are_the_limit_of_small_masses(law):
    start, ends = [0.1, 0.3, 0.2, 0.0], []
    for mass in (0.0, 4e-3, 2e-3):
        ends.append(hb.time.integrate(maxwell(mass, law=law), start, 1, OMEGA, tolerance=1e-9).end[:3])
    coarse, fine = (np.abs(one - ends[0]).max() for one in ends[1:])
    assert coarse < 1e-2 and fine == pytest.approx(0.5 * coarse, rel=0.1)
