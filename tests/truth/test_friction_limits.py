"""Friction limits that vary: prescribed over the period, or proportional to the normal force of another element.

The motions with a prescribed limit are computed without hbgear: event-exact shooting of x'' + .02 x' + x + f =
.2 cos(Omega t), closed to 1e-12. Those of a contact are integrated here by SciPy from event to event.
"""

import json

import numpy as np
import pytest
from machines import single_mass
from scipy.integrate import solve_ivp
from scipy.io import mmwrite

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.io.machines.structure_file import read_structure
from hbgear.mechanics.laws.slider import friction_limits
from hbgear.mechanics.serialization import from_plain, to_plain
from hbgear.mechanics.series.fourier import evaluate

WAVE = 0.05 * np.cos(0.7), -0.05 * np.sin(0.7)  # of .1 (1 + .5 cos(tau + .7))
PRESCRIBED = hb.mechanics.Jenkins(1.0, 0.1, cosine=WAVE[:1], sine=WAVE[1:])


def oscillator(law):
    return single_mass(law, F=0.2, c=0.02, name="x")


def foot(gap=-0.1, friction=0.3, k=5.0):
    """A foot that moves along and across a wall, pressed by gap < 0 or apart from it, with friction in between."""
    wall = hb.Element([0.0, 1.0], hb.Unilateral(k=2.0, gap=gap), name="wall")
    rub = hb.Element([1.0, 0.0], hb.mechanics.ContactFriction(k, friction, "wall"), name="rub")
    K, load = [[1.0, 0.2], [0.2, 1.0]], hb.Load(cosine={1: [0.3, 0.25]}, sine={1: [0.0, 0.2]})
    return hb.System(np.eye(2), 0.1 * np.eye(2), K, [wall, rub], load)


def state_of(rows, Omega):
    return np.concatenate([evaluate(rows, [0.0])[:, 0], Omega * evaluate(rows, [0.0], 1)[:, 0]])


@pytest.mark.parametrize(
    ("Omega", "mean", "rms", "mu", "z"),
    [
        (0.95, -0.0312340560831309, 0.7094527476607210, 0.7110999462875 + 0.2223915450376j, 0.5731718641354840),
        (1.15, 0.0230492288196070, 0.4861030569876100, 0.5576263874176 + 0.5085760756657j, -0.5243068461902639),
        (1.35, 0.0361989547880576, 0.2262098100698971, 0.0489001586188 + 0.6532274281829j, -0.1390388529789108),
    ],
)
def test_prescribed_limit(Omega, mean, rms, mu, z):
    problem = hb.HarmonicBalance(oscillator(PRESCRIBED), 41)
    X = solve(problem, np.zeros(problem.size), {"Omega": Omega}).X
    assert X[0] == pytest.approx(mean, abs=2e-7)
    assert np.sqrt(0.5 * (X[1:] ** 2).sum()) == pytest.approx(rms, rel=1e-6)
    assert np.abs(problem.multipliers(X, Omega=Omega) - mu).min() < 1e-5
    assert problem.slider_positions(X, Omega=Omega)[0] == pytest.approx(z, abs=1e-6)
    orbit = hb.time.shoot(problem.model, Omega, state_of(X[None], Omega))
    assert orbit.state[2] == pytest.approx(z, abs=1e-9)
    assert np.abs(orbit.multipliers - mu).min() < 1e-8


def loop(system, rows, N):
    """Return force coefficients of the friction of a foot, or an oscillator, from N samples of two periods."""
    theta, H = 2 * np.pi * np.arange(N) / N, rows.shape[1] // 2
    d = evaluate(rows, theta)
    j = len(system.elements) - 1
    slider = system.elements[j].law.sliders[0]
    if slider.normal:
        limit = slider.limit * np.abs(system.elements[0].law.force(d[0], 0 * theta, theta)[0])
    else:
        limit = slider.limit + WAVE[0] * np.cos(theta) + WAVE[1] * np.sin(theta)
    z, f = slider.residual, np.empty(N)
    for _ in range(2):
        for i, (x, reach) in enumerate(zip(d[j].tolist(), (limit / slider.k).tolist(), strict=True)):
            if reach and not limit[i - 1]:  # the contact closed between two samples
                z = d[j, i - 1] + (system.elements[0].law.corners[0] - d[0, i - 1]) / (d[0, i] - d[0, i - 1]) * (
                    x - d[j, i - 1]
                )
            z = min(max(z, x - reach), x + reach)
            f[i] = slider.k * (x - z)
    c = np.fft.rfft(f)[: H + 1] / N
    return j, np.concatenate([[c[0].real], np.column_stack([2 * c[1:].real, -2 * c[1:].imag]).ravel()])


def rows_of(m, H, size, seed):
    fall = np.r_[1, np.repeat(np.arange(1, H + 1) ** 1.5, 2)]
    return np.random.default_rng(seed).standard_normal((m, 2 * H + 1)) * size / fall


LIMITS = [(oscillator(PRESCRIBED), 0.3), (foot(), 0.3), (foot(gap=0.2), 0.5), (foot(gap=-0.5), 0.2), (foot(k=0.5), 1.0)]
"""Systems and sizes of random motions: with a contact that always acts, sometimes, and that opens."""


@pytest.mark.parametrize(("system", "size"), LIMITS)
@pytest.mark.parametrize("seed", [1, 2])
def test_forces_are_those_of_a_sampled_loop(system, size, seed):
    rows = rows_of(len(system.elements), 6, size, seed)
    j, expected = loop(system, rows, 65536)
    found = hb.HarmonicBalance(system, 6).compiled({}).forces(rows.ravel(), 1.0)[j]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize(("system", "size"), LIMITS)
def test_jacobian_is_the_derivative_of_the_forces(system, size):
    problem, m = hb.HarmonicBalance(system, 4), len(system.elements)
    X, h = rows_of(m, 4, size, 5).ravel(), 1e-6
    J = problem.evaluate(X, Omega=1.0)[1]
    exact = [
        (problem.residual(X + h * e, Omega=1.0) - problem.residual(X - h * e, Omega=1.0)) / (2 * h)
        for e in np.eye(len(X))
    ]
    np.testing.assert_allclose(J, np.transpose(exact), rtol=0, atol=1e-6)


def integrated(gap, Omega, periods):
    """Return states (x, y, x', y', z) of the foot after each period, by DOP853 between the events, from rest."""
    k, stiff, friction, K = 5.0, 2.0, 0.3, np.array([[1.0, 0.2], [0.2, 1.0]])

    def force(t):
        return np.array([0.3 * np.cos(Omega * t), 0.25 * np.cos(Omega * t) + 0.2 * np.sin(Omega * t)])

    def normal(y):
        return stiff * max(y[1] - gap, 0.0)

    def reach(y):
        return friction * normal(y) / k

    def rate(y):
        return friction * stiff * (y[1] > gap) * y[3] / k

    def right(mode):
        def f(t, y):
            side = {"+": 1.0, "-": -1.0}.get(mode, 0.0)
            p = np.array([k * (y[0] - y[4]) if mode == "stick" else side * k * reach(y), normal(y)])
            dz = 0.0 if mode == "stick" else y[2] - side * rate(y)
            return np.concatenate([y[2:4], force(t) - 0.1 * y[2:4] - K @ y[:2] - p, [dz]])

        return f

    def events(mode):
        tests = [lambda t, y: y[1] - gap]
        if mode == "stick":
            tests += [lambda t, y: (y[0] - y[4]) - reach(y), lambda t, y: -(y[0] - y[4]) - reach(y)]
        elif mode in "+-":
            side = 1.0 if mode == "+" else -1.0
            tests.append(lambda t, y: side * y[2] - rate(y))
        for one, way in zip(tests, (0, 1, 1) if mode == "stick" else (0, -1), strict=False):
            one.terminal, one.direction = True, way
        return tests

    T, t, out = 2 * np.pi / Omega, 0.0, []
    y = np.zeros(5)
    mode = "stick" if gap < 0 else "open"
    for p in range(periods):
        end = (p + 1) * T
        while end - t > 1e-13:
            found = solve_ivp(right(mode), (t, end), y, "DOP853", events=events(mode), rtol=1e-12, atol=1e-13)
            t, y = float(found.t[-1]), found.y[:, -1].copy()
            if found.status != 1:
                continue
            which = next(i for i, at in enumerate(found.t_events) if len(at))
            if which == 0:
                y[1] = gap + np.sign(y[3]) * 1e-15
                if y[3] < 0:
                    mode = "open"
                    continue
                y[4] = y[0]
                grows = friction * stiff * y[3] / k
                mode = "stick" if abs(y[2]) < grows else "+" if y[2] > 0 else "-"
            elif mode == "stick":
                mode = "+" if which == 1 else "-"
            else:
                mode = "stick"
        if mode == "open":
            y[4] = y[0]
        out.append(y.copy())
    return np.array(out)


@pytest.mark.slow
@pytest.mark.parametrize(("gap", "Omega", "periods"), [(-0.1, 0.7, 60), (0.2, 1.3, 80), (-0.5, 0.8, 60)])
def test_contact_friction_against_integration(gap, Omega, periods):
    system = foot(gap)
    truth = integrated(gap, Omega, periods)
    np.testing.assert_allclose(truth[-1], truth[-2], rtol=0, atol=1e-6)
    problem = hb.HarmonicBalance(system, 31)
    X = solve(problem, np.zeros(problem.size), {"Omega": Omega}).X
    state = state_of(X.reshape(2, -1)[::-1], Omega)
    np.testing.assert_allclose(state, truth[-1, :4], rtol=0, atol=2e-4)
    orbit = hb.time.shoot(system, Omega, state)
    np.testing.assert_allclose(orbit.state, truth[-1], rtol=0, atol=1e-8)
    mu = problem.multipliers(X, Omega=Omega)
    assert len(mu) == 5 and np.abs(np.sort(np.abs(mu)) - np.sort(np.abs(orbit.multipliers))).max() < 2e-3


@pytest.mark.slow
def test_a_curve_with_contact_friction():
    """Every motion of the curve is one of the shooting method, with its multipliers where it is stable."""
    curve = hb.trace(hb.HarmonicBalance(foot(gap=-0.5), 9), "Omega", (0.5, 0.8))
    assert curve.status.complete and "gross_slip" in set(curve.regimes)
    assert hb.validate(curve, 2, tolerance=5e-3, landing="nearest").ok


def test_limits_of_the_force_of_other_laws():
    """The normal force is that of the law, on both sides of a clearance and of a linear spring."""
    for law in (hb.Backlash(b=0.2, k=3.0), hb.mechanics.PiecewiseLinear((0.1, 0.4), (1.0, 0.5, 4.0), 0.2)):
        rub = hb.Element([1.0, 0.0], hb.mechanics.ContactFriction(5.0, 0.3, "wall"), name="rub")
        wall = hb.Element([0.0, 1.0], law, name="wall")
        system = hb.System(np.eye(2), 0.1 * np.eye(2), np.eye(2), [rub, wall], hb.Load(cosine={1: [0.3, 0.25]}))
        (_, _, limit), d = friction_limits(system.elements)[0], np.linspace(-2.0, 2.0, 4001)
        zone = np.searchsorted(limit.level, d)
        found = np.array(limit.gain)[zone] * d + np.array(limit.base)[zone]
        np.testing.assert_allclose(found, 0.3 * np.abs(law.force(d, 0 * d, 0 * d)[0]), rtol=0, atol=1e-14)


def test_files(tmp_path):
    for system in (foot(), oscillator(PRESCRIBED)):
        again = from_plain(json.loads(json.dumps(to_plain(system.elements))), {"Element": hb.Element})
        assert [element.law for element in again] == [element.law for element in system.elements]
    mmwrite(tmp_path / "unit.mtx", np.eye(2))
    text = """
        [matrices]
        M = "unit.mtx"
        K = "unit.mtx"
        names = ["along", "across"]
        [[element]]
        name = "wall"
        direction = { across = 1.0 }
        law = "unilateral"
        k = 2.0
        gap = -0.1
        [[element]]
        name = "rub"
        direction = { along = 1.0 }
        law = "contact friction"
        k = 5.0
        friction = 0.3
        normal = "wall"
        [[element]]
        direction = { along = 1.0 }
        law = "jenkins"
        k = 1.0
        limit = 0.1
        cosine = [0.05]
        """
    (tmp_path / "foot.toml").write_text(text)
    system = read_structure(tmp_path / "foot.toml")
    assert system.elements[1].law == hb.mechanics.ContactFriction(5.0, 0.3, "wall")
    assert system.elements[2].law == hb.mechanics.Jenkins(1.0, 0.1, cosine=(0.05,))
    (tmp_path / "foot.toml").write_text(text.replace('normal = "wall"', 'normal = "wal"'))
    with pytest.raises(ValueError, match=r"normal force of element 'wal'.*did you mean 'wall'"):
        read_structure(tmp_path / "foot.toml")


def rubbing(law, name="wall"):
    rub = hb.Element([1.0], hb.mechanics.ContactFriction(5.0, 0.3, name), name="rub")
    return hb.System([[1.0]], [[0.1]], [[1.0]], [hb.Element([1.0], law, name="wall"), rub], hb.Load(cosine={1: [0.2]}))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: hb.mechanics.Jenkins(1.0, 0.1, cosine=(0.2,)),
            r"becomes negative in the period: -0.1 near tau = 3.14",
        ),
        (lambda: hb.mechanics.Slider(1.0, 0.1, cosine=(0.05,), normal="wall"), "prescribed over the period and prop"),
        (lambda: hb.mechanics.ContactFriction(1.0, 0.0, "wall"), "ContactFriction: friction = 0"),
        (lambda: hb.mechanics.ContactFriction(1.0, 0.1, ""), "must be the name of the element"),
        (lambda: rubbing(hb.Unilateral(k=1.0, gap=0.1), "floor"), "of element 'floor', which must be one element"),
        (lambda: rubbing(hb.Cubic(1.0)), "piecewise-linear spring of constant stiffness"),
        (lambda: rubbing(hb.Backlash(stiffness=hb.mechanics.Series(1.0, (0.1,)))), "spring of constant stiffness"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_harmonics_of_a_limit_that_are_left_out_give_a_warning():
    law = hb.mechanics.Jenkins(1.0, 0.1, cosine=(0.0, 0.0, 0.02))
    with pytest.warns(UserWarning, match="3 harmonics but H = 2"):
        hb.HarmonicBalance(oscillator(law), 2)


def test_friction_that_sticks_from_contact_to_contact_is_a_spring():
    """With k < friction k_n in the direction of the stop, k (d - gap) never reaches friction k_n (d - gap)."""
    stop = hb.Element([1.0], hb.Unilateral(k=3.7, gap=-0.25), name="stop")
    rub = hb.Element([1.0], hb.mechanics.ContactFriction(1.5, 0.6, "stop"), name="rub")
    spring, load = hb.Element([1.0], hb.Unilateral(k=5.2, gap=-0.25)), hb.Load(constant=[-0.3], cosine={1: [0.9]})
    both, one = (
        hb.time.integrate(hb.System([[1.0]], [[0.1]], [[1.0]], elements, load), [-0.3, 0.0], 20, 0.9)
        for elements in ([stop, rub], [spring])
    )
    assert len(both.switches) > 40
    np.testing.assert_allclose(both.end[:2], one.end, rtol=0, atol=1e-9)
