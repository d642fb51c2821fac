"""Friction sliders against closed forms, sampled hysteresis loops and event-exact motions.

The motions are computed without hbgear: event-exact shooting of x'' + .02 x' + x + f = F cos(Omega t), closed to 1e-12.
"""

import numpy as np
import pytest
import scipy
from machines import cantilever, chain, single_mass

import hbgear as hb
from hbgear.analysis.summary import regime_of
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.balance.resolution import change_to_solution

ONE = hb.mechanics.Jenkins(k=1.0, limit=0.1)
FOUR = hb.mechanics.Iwan((0.25,) * 4, (0.02, 0.05, 0.1, 0.2))


def oscillator(law, load):
    return single_mass(law, F=load, c=0.02, name="x")


def two_masses():
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    link = hb.Element([1.0, -1.0], hb.mechanics.Jenkins(0.8, 0.04), name="link")
    ground = hb.Element([1.0, 0.0], hb.mechanics.Jenkins(0.5, 0.05), name="ground")
    return hb.System(np.eye(2), 0.02 * K, K, [link, ground], hb.Load(cosine={1: [0.3, 0.0]}))


CASES = [
    (oscillator(ONE, 0.2), 0.8, [0.17467880901245447], [-0.05457821841161181 + 0.14690430424744766j]),
    (oscillator(ONE, 0.2), 1.0, [2.620838760625804], [0.9388285846512008, 0.8428128246521769]),
    (oscillator(ONE, 0.2), 1.2, [0.37198130615026276], [0.4189142342692289 + 0.5780854399386923j]),
    (oscillator(ONE, 0.2), 1.1, [0.6715787180953859], [0.6892777531783076 + 0.3841614985763404j]),
    (oscillator(ONE, 0.2), 1.3, [0.2586415822109516], [0.16800424087902946 + 0.6386711478012458j]),
    (oscillator(ONE, 0.2), 1.4, [0.1977010980683245], [-0.03675448882137031 + 0.6165461571236344j]),
    (
        two_masses(),
        0.9,
        [0.5100925548545224, 0.4539009576850897],
        [0.6459115641703974 + 0.5621449603135003j, 0.033788226860090066 + 0.3527941414281958j],
    ),
    (two_masses(), 1.1, [0.48725283320524476, 0.5743942600784194], []),
    (
        two_masses(),
        1.3,
        [0.10917954138674084, 0.24618849366130338],
        [0.17519218125546085 + 0.7513243044346177j, -0.3016518893370178 + 0.276995274009557j],
    ),
    (
        two_masses(),
        1.6,
        [0.09370544786877079, 0.188503430564102],
        [0.4854252909369512j * 1j + 0.6205794814886958j, 0.4899486204828081 + 0.40554086783226634j],
    ),
    (oscillator(FOUR, 0.3), 1.1, [0.9182106375242401], [0.7883112064096958, 0.37236444407272623]),
    (oscillator(FOUR, 0.3), 1.3, [0.6082444959802444], [0.2866051497762092 + 0.3682997696007467j]),
]
"""Models, Omega, rms of the alternating part of the coordinates, and multipliers (one of each complex pair)."""


def loop(law, row, N):
    """Return force coefficients of sliders from N samples of two periods: marching without any root or integral."""
    theta, H = 2 * np.pi * np.arange(N) / N, len(row) // 2
    k = np.arange(1, H + 1)[:, None]
    d = row[0] + row[1::2] @ np.cos(k * theta) + row[2::2] @ np.sin(k * theta)
    out = np.zeros(2 * H + 1)
    for slider in law.sliders:
        z, f = slider.residual, np.empty(N)
        for _ in range(2):
            for n, x in enumerate(d.tolist()):
                z = min(max(z, x - slider.limit / slider.k), x + slider.limit / slider.k)
                f[n] = slider.k * (x - z)
        c = np.fft.rfft(f)[: H + 1] / N
        out += np.concatenate([[c[0].real], np.column_stack([2 * c[1:].real, -2 * c[1:].imag]).ravel()])
    return out


@pytest.mark.parametrize("size", [0.05, 0.12, 0.3, 2.0])
def test_forces_are_those_of_a_sampled_loop(size):
    row = np.random.default_rng(3).standard_normal(15) * size / np.r_[1, np.repeat(np.arange(1, 8) ** 1.5, 2)]
    for law in (ONE, FOUR, hb.mechanics.Jenkins(2.0, 0.1, residual=0.07)):
        exact = hb.HarmonicBalance(oscillator(law, 0.2), 7).compiled({}).forces(row, 1.0)[0]
        np.testing.assert_allclose(exact, loop(law, row, 65536), rtol=0, atol=1e-8 * max(1.0, size))


@pytest.mark.parametrize("size", [0.12, 2.0])
def test_jacobian_is_the_derivative_of_the_forces(size):
    """Against differences of a loop with N = 65 536 samples, which has errors of N^-2 / h."""
    problem = hb.HarmonicBalance(oscillator(ONE, 0.2), 5)
    row = np.random.default_rng(7).standard_normal(11) * size / np.r_[1, np.repeat(np.arange(1, 6) ** 1.5, 2)]
    J = problem.evaluate(row, Omega=1.0)[1] - problem.evaluate(np.zeros(11), Omega=1.0)[1] + np.eye(11)
    for i, h in ((0, 1e-4), (1, 1e-4), (4, 1e-4)):
        step = h * np.eye(11)[i]
        difference = (loop(ONE, row + step, 65536) - loop(ONE, row - step, 65536)) / (2 * h)
        np.testing.assert_allclose(J[:, i], difference, rtol=0, atol=2e-5)
        exact = problem.compiled({})
        central = (exact.forces(row + 0.1 * step, 1.0)[0] - exact.forces(row - 0.1 * step, 1.0)[0]) / (0.2 * h)
        np.testing.assert_allclose(J[:, i], central, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("A", "cosine", "sine"),
    [
        (0.1, 0.1, 0.0),
        (0.15, 0.1062312891313607, -0.04244131815771428),
        (0.3, 0.08753742173727866, -0.08488263631542858),
        (1.0, 0.0520440193309139, -0.11459155902635662),
    ],
)
def test_first_harmonic_by_masing(A, cosine, sine):
    f = hb.HarmonicBalance(oscillator(ONE, 0.2), 3).compiled({}).forces(np.array([0.0, A, 0, 0, 0, 0, 0]), 1.0)[0]
    np.testing.assert_allclose(f[1:3], [cosine, sine], rtol=0, atol=2e-10)  # the references have ten digits
    if A > 0.1:
        assert -np.pi * A * f[2] == pytest.approx(4 * 0.1 * (A - 0.1), rel=1e-12)  # energy of the loop


@pytest.mark.parametrize(("model", "Omega", "rms", "multipliers"), CASES)
def test_motions_and_multipliers(model, Omega, rms, multipliers):
    problem = hb.HarmonicBalance(model, 41)
    X = solve(problem, np.zeros(problem.size), {"Omega": Omega}).X
    q = problem.motion(X, Omega=Omega)
    np.testing.assert_allclose(np.sqrt(0.5 * (q[:, 1:] ** 2).sum(axis=1)), rms, rtol=1e-6)
    mu = problem.multipliers(X, Omega=Omega)
    assert len(mu) == 2 * model.n + problem.compiled({}).sliders
    for one in multipliers:
        assert np.abs(mu - one).min() < 1e-5


def test_order_of_convergence():
    """The error of the rms decreases like H^-4: the force has kinks, its coefficients decrease like k^-2."""
    orders, errors = np.array([7, 15, 31, 63]), []
    for H in orders.tolist():
        problem = hb.HarmonicBalance(oscillator(ONE, 0.2), H)
        X = solve(problem, np.zeros(problem.size), {"Omega": 1.6}).X
        errors.append(abs(np.sqrt(0.5 * (X[1:] ** 2).sum()) - 0.13203008615190304))
    order = -np.polyfit(np.log(orders), np.log(errors), 1)[0]
    assert 3.0 < order < 5.0


@pytest.mark.slow
def test_coulomb_friction_is_rigid_to_the_root_of_its_flexibility():
    """x'' + x + limit sign(x') = cos(w t) by Den Hartog (1931), x_0^2 = V^2 - (limit U)^2: the force of a spring k
    changes its sign in a time proportional to k^-1/2, so that four times the stiffness halves the difference."""
    w, limit = 1.4, 0.6
    V, U = 1 / (1 - w**2), np.sin(np.pi / w) / (w * (1 + np.cos(np.pi / w)))
    differences = []
    for k, H in ((250.0, 60), (1000.0, 100)):
        model = single_mass(hb.mechanics.Coulomb(limit, k), F=1.0, c=0.0)
        largest = hb.trace(hb.HarmonicBalance(model, H), "Omega", (w, w + 1e-3))[0].amplitude("max")
        differences.append(float(largest) / np.sqrt(V**2 - (limit * U) ** 2) - 1)
    assert differences[0] == pytest.approx(2 * differences[1], rel=0.05)
    assert 0.08 < differences[1] < 0.1


def test_shooting_is_event_exact():
    q, v, z = -0.4274815078679192, 0.38103590920764163, -0.4288796621625097
    orbit = hb.time.shoot(oscillator(ONE, 0.2), 1.2, [q + 1e-3, v - 1e-3])
    np.testing.assert_allclose(orbit.state, [q, v, z], rtol=0, atol=1e-10)
    reference = [0.4189142342692289 + 0.5780854399386923j, 0.4189142342692289 - 0.5780854399386923j, 0.0]
    assert all(np.abs(orbit.multipliers - one).min() < 1e-9 for one in reference)


def test_residual_position_selects_the_motion():
    """Where no slider slips, each residual position has its motion: a linear oscillator about a shifted mean."""
    for residual in (0.0, 0.03, -0.02):
        law = hb.mechanics.Jenkins(1.0, 0.1, residual)
        problem = hb.HarmonicBalance(oscillator(law, 0.02), 3)
        X = solve(problem, np.zeros(problem.size), {"Omega": 0.5}).X
        G = 0.02 / (2.0 - 0.25 + 0.01j)
        np.testing.assert_allclose(X, [residual / 2, G.real, -G.imag, 0, 0, 0, 0], rtol=0, atol=1e-13)
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match=r"no friction slider slips .*nearest: x, .* spring"):
        curve = hb.trace(problem, "Omega", (0.4, 0.5))
    assert set(curve.stability) == {"neutral"} and set(curve.regimes) == {"stick"} and curve.stable.all()


@pytest.mark.slow
def test_a_curve_through_first_slip():
    curve = hb.trace(hb.HarmonicBalance(oscillator(ONE, 0.06), 9), "Omega", (0.6, 2.2))
    assert curve.status.complete and set(curve.regimes) == {"stick", "gross_slip"}
    slips = [point for point in curve.special if point.kind == "SL"]
    assert len(slips) == 2 and [point.note for point in slips] == ["x", "x"]
    assert {regime_of(point) for point in slips} <= {"stick", "gross slip"}
    for point in slips:
        assert abs(curve.problem.threshold_distances("slip", point.X, **point.parameters)[0]) < 1e-10
        # a linear oscillator of stiffness 2 whose amplitude is limit / k
        W = point.parameters["Omega"]
        assert 0.06 / np.hypot(2.0 - W**2, 0.02 * W) == pytest.approx(0.1, rel=1e-9)
    assert {state for state, name in zip(curve.stability, curve.regimes, strict=True) if name == "stick"} == {"neutral"}
    assert hb.validate(curve, 3, tolerance=1e-3, landing="nearest").ok
    jump = "the exponential method, which sweeps, .* need, does not integrate friction"
    with pytest.raises(ValueError, match=jump):
        hb.time.integrate(curve.problem.model, [0.0, 0.0], 1, 1.0, method="exponential")


CHAIN = {
    1.1: [0.050109577028395344, 0.08950290333721908, 0.1122747906505226],
    1.3: [0.16431478744593517, 0.20298462513388246, 0.3898104287551068],
    1.5: [0.11411177489442188, 0.147061892612611, 0.6016146257568062],
    1.8: [0.0837426655479115, 0.141179606175808, 0.14031016628950427],
    1.95: [0.11549626479930869, 0.1623490889063048, 0.10589659114473592],
}
"""Rms of the three masses of `chain` over Omega: event-exact shooting from a motion that started at rest."""


@pytest.mark.slow
def test_chain_with_friction_cubic_springs_and_a_stop():
    curve = hb.trace(hb.HarmonicBalance(chain(), 9), "Omega", (0.5, 2.0))
    assert curve.status.complete and {"stick", "gross_slip"} <= set(curve.regimes)
    problem = hb.HarmonicBalance(chain(), 81)  # with 41 harmonics the largest error is 5e-6
    for Omega, rms in CHAIN.items():
        apart = np.abs(curve.amplitude("rms", 0) / rms[0] - 1) + 10 * np.abs(curve.values - Omega)
        X = solve(problem, problem.from_point(curve[int(np.argmin(apart))]), {"Omega": Omega}).X
        q = problem.motion(X, Omega=Omega)
        np.testing.assert_allclose(np.sqrt(0.5 * (q[:, 1:] ** 2).sum(axis=1)), rms, rtol=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: hb.mechanics.Jenkins(0.0, 0.1), "Jenkins: k = 0"),
        (lambda: hb.mechanics.Jenkins(1.0, -0.1), "Jenkins: limit = -0.1"),
        (lambda: hb.mechanics.Coulomb(0.0, 1.0), "Coulomb: limit = 0"),
        (lambda: hb.mechanics.Iwan((1.0, 1.0), (0.1,)), "2 stiffnesses k and 1 limits"),
        (lambda: hb.mechanics.Iwan((1.0, 0.0), (0.1, 0.1)), "must be a sequence of positive numbers"),
        (lambda: hb.mechanics.Iwan.uniform(1.0, 0.1, 0), "number = 0 sliders"),
        (lambda: hb.HarmonicBalance(_moved(), 3), "element 'x' has friction and a prescribed displacement with break"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.filterwarnings("ignore:no friction slider slips")
@pytest.mark.parametrize(("n", "count", "k", "tolerance"), [(100, 20, 5.0, 1e-8), (300, 20, 1.0, 1e-5)])
def test_many_sliders_on_a_fine_mesh(n, count, k, tolerance):
    """The sliders stick, so that the structure is linear.

    With 100 elements the tolerance of the residual was below the rounding errors of the dynamic stiffness, an inverse:
    120 points were not enough for this span. With 300 the lowest mode was taken for a free motion and was missing.
    """
    (M, K), places = cantilever(n), 2 * np.linspace(n // 5, n - 1, count).astype(int)
    C, tip, W = 0.05 * M + 1e-3 * K, np.eye(1, 2 * n, 2 * n - 2)[0], np.eye(2 * n)[places]
    sliders = [hb.Element(w, hb.mechanics.Jenkins(k=k, limit=1.0)) for w in W]
    beam = hb.System(M, C, K, sliders, hb.Load(cosine={1: 0.1 * tip}))
    steps = hb.StepControl(max_points=120)
    curve = hb.trace(hb.HarmonicBalance(beam, 1), "Omega", (3.45, 3.5), steps=steps)
    assert curve.status == "reached_end"
    sticking = [W @ np.linalg.solve(K + k * W.T @ W + 1j * w * C - w**2 * M, 0.1 * tip) for w in curve.values]
    first = curve.X.reshape(len(curve), count, 3)[:, :, 1:] @ [1, -1j]
    assert np.abs(first - sticking).max() < tolerance * np.abs(sticking).max()


def _moved():
    step = hb.mechanics.Periodic.trapezoidal(0.2, 0.1, 0.3, 0.2)
    return single_mass(ONE, displacement=step, name="x")


def motion_with_stops(Omega, load, limit, k):
    """Return x at 1024 times of the period of x'' + .1 x' + x + f = load cos(Omega t), integrated from stop to stop."""
    period, y, slip = 2 * np.pi / Omega, np.array([0.1, 0.0, 0.0]), 0
    times, path = np.arange(1024) * period / 1024, np.empty(1024)

    def rates(t, y, slip):
        return [y[1], load * np.cos(Omega * t) - 0.1 * y[1] - y[0] - y[2], 0.0 if slip else k * y[1]]

    def reversal(t, y, slip):
        return slip * y[1] if slip else limit - abs(y[2])

    reversal.terminal, reversal.direction = True, -1
    for _ in range(150):
        t, start = 0.0, y
        while t < period:
            run = scipy.integrate.solve_ivp(
                rates, (t, period), y, "DOP853", None, True, reversal, args=(slip,), rtol=1e-10, atol=1e-12
            )
            inside = (times >= t) & (times <= run.t[-1])
            path[inside] = run.sol(times[inside])[0]
            t, y = run.t[-1], run.y[:, -1]
            if run.status == 1:
                slip = 0 if slip else int(np.sign(y[2]))
        if np.abs(y - start).max() < 1e-7:
            return path
    raise AssertionError("the motion is not periodic")


@pytest.mark.slow
def test_the_error_of_motions_with_several_stops_is_stated():
    """Errors were up to 4 times too small, or 14 times too large where a truncated harmonic is in resonance."""
    law = hb.mechanics.Coulomb(0.4, 200.0)
    system = single_mass(law, F=0.45, name="x")
    problem = hb.HarmonicBalance(system, 16)
    curve = hb.trace(problem, "Omega", (0.6, 1.5), special=False, stability=False, accuracy=None)
    for Omega in (0.63, 0.774, 0.88, 0.916, 1.32):
        i = int(np.argmin(np.abs(curve.values - Omega)))
        x = motion_with_stops(curve.values[i], 0.45, 0.4, 200.0)
        error = np.sqrt(np.mean((curve[i].samples(0, 1024)[1] - x) ** 2))
        assert error / 3 < curve.error[i] < 3 * error


@pytest.mark.slow
def test_the_error_next_to_sticking_is_not_the_distance_from_the_curve():
    """Errors were 4 to 20 times too small where the first Newton step leads to another order of stops."""
    law = hb.mechanics.Coulomb(0.47, 240.0)
    system = single_mass(law, F=0.5, name="x")
    problem, finer = hb.HarmonicBalance(system, 16), hb.HarmonicBalance(system, 32)
    curve = hb.trace(problem, "Omega", (0.5, 1.4), special=False, stability=False, accuracy=None)
    weight = np.sqrt(np.append(1.0, np.full(64, 0.5)))
    for Omega in (0.585, 1.03, 1.05, 1.33):
        i = int(np.argmin(np.abs(curve.values - Omega)))
        parameters = curve.parameters_at(i)
        change = change_to_solution(finer, finer.resized(curve.X[i]), weight, parameters, "Omega", sliders=True)
        estimate = np.linalg.norm(weight * change)
        x = motion_with_stops(parameters["Omega"], 0.5, 0.47, 240.0)
        error = np.sqrt(np.mean((curve[i].samples(0, 1024)[1] - x) ** 2))
        assert error / 1.5 < estimate < 1.5 * error
