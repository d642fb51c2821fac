"""GearRotorBearing: its equations, the linear response, the limit of heavy gears, its static state, its ranges."""

import numpy as np
import pytest
from unit.test_models import OMEGA, TAU, backlash, imbalance, random_motion

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.series.fourier import to_complex, to_real

UNEQUAL = hb.gears.GearRotorBearing(
    zeta=0.04,
    zeta_1=0.02,
    zeta_2=0.03,
    kappa_1=1.1,
    kappa_2=0.7,
    mu_1=0.3,
    mu_2=0.15,
    F_m=0.12,
    F_1=0.05,
    F_2=0.08,
    eps=(0.2, -0.1),
    e=(0.05, 0.02),
    phase="sin",
    b=0.8,
    b_1=0.4,
    b_2=0.3,
    eps_scale=1.5,
    e_scale=0.5,
)


@pytest.mark.parametrize("model", [hb.gears.GearRotorBearing(), UNEQUAL])
def test_equations_in_the_coordinates_of_the_papers(model):
    """Left minus right sides in y_1, y_2 and p, with q = (y_1, y_2, p - y_1 + y_2 + e)."""
    motion = random_motion(5, 3)
    turn = 0 if model.phase == "cos" else -np.pi / 2
    error = [
        model.e_scale
        * sum((o * OMEGA) ** n * a * np.cos(o * TAU + turn + n * np.pi / 2) for o, a in enumerate(model.e, 1))
        for n in range(3)
    ]
    (y1, y2, p), (dy1, dy2, dp), (ddy1, ddy2, ddp) = (motion(order) for order in range(3))
    assert np.ptp(np.sign(backlash(p, model.b))) == 2  # meets both flanks
    k = 1 - model.eps_scale * sum(a * np.cos(o * TAU) for o, a in enumerate(model.eps, 1))
    mesh = 2 * model.zeta * dp + k * backlash(p, model.b)
    pinion = ddy1 + 2 * model.zeta_1 * dy1 + model.kappa_1 * backlash(y1, model.b_1) + model.mu_1 * mesh + model.F_1
    gear = ddy2 + 2 * model.zeta_2 * dy2 + model.kappa_2 * backlash(y2, model.b_2) - model.mu_2 * mesh - model.F_2
    gap = ddp - ddy1 + ddy2 + mesh - model.F_m + error[2]

    q = [np.array([y1, y2, p - y1 + y2 + e]) for (y1, y2, p), e in zip(map(motion, range(3)), error, strict=True)]
    found = imbalance(model.system(), *q)
    np.testing.assert_allclose(found, [pinion / model.mu_1, gear / model.mu_2, gap], atol=1e-12)


def test_matrices_are_symmetric():
    system = UNEQUAL.system()
    np.testing.assert_array_equal(system.M, np.diag([1 / 0.3, 1 / 0.15, 1.0]))
    assert not system.K.any() and not system.C.any()


def test_linear_response_is_the_transfer_function():
    """Without clearances, harmonic by harmonic: the equations of the papers as one complex 3 x 3 system each."""
    m = UNEQUAL.replace(b=0.0, b_1=0.0, b_2=0.0, eps=())
    problem = hb.HarmonicBalance(m, 6)
    gap, y1, y2 = to_complex(problem.start(OMEGA, **m.parameters).reshape(3, -1))
    for order, amplitude in ((1, 0.025), (2, 0.01)):
        w = order * OMEGA
        mesh = 1 + 2j * m.zeta * w
        A = [
            [-(w**2) + 2j * m.zeta_1 * w + m.kappa_1, 0, m.mu_1 * mesh],
            [0, -(w**2) + 2j * m.zeta_2 * w + m.kappa_2, -m.mu_2 * mesh],
            [w**2, -(w**2), -(w**2) + mesh],
        ]
        expected = np.linalg.solve(A, [0, 0, w**2 * amplitude * -1j])  # sin = Re(-i exp)
        np.testing.assert_allclose([y1[order], y2[order], gap[order]], expected, rtol=0, atol=1e-12)
    static = [m.F_m, -(m.F_1 + m.mu_1 * m.F_m) / m.kappa_1, (m.F_2 + m.mu_2 * m.F_m) / m.kappa_2]
    np.testing.assert_allclose([gap[0].real, y1[0].real, y2[0].real], static, atol=1e-12)
    assert np.abs([x[3:] for x in (gap, y1, y2)]).max() < 1e-12


def scatter(R, x, now, slope):
    """How far the residual R(x) scatters by rounding: twice what 17 last bits of x show, at least a last bit of R."""
    eps = np.finfo(float).eps
    bits = eps * max(abs(x), 1.0) * np.arange(-8, 9)
    seen = max(np.abs(R(x + bit) - now - bit * slope).max() for bit in bits)
    return max(2 * seen, eps * np.abs(now[slope != 0]).max())


def reference(slope, R, x, h, noise):
    """A fourth-order difference of R at x, and its error: what is left out (shown by the step 2h), and rounding."""
    fine, coarse = slope(R, x, h), slope(R, x, 2 * h)
    return fine, np.abs(fine - coarse).max() / 15 + 1.5 * noise / h


def agree(found, expected, tolerance):
    """Equal to a tolerance; it must be one that a millionth of the numbers would exceed ten times over."""
    assert 10 * tolerance < 1e-5 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", ["Omega", "mu_1", "kappa_2", "b_1", "F_2"])
def test_parameter_derivative_against_differences(name, rng, slope):
    """It is a difference itself, with a step of 1e-6 of the value: rounding over that step is its error."""
    problem = hb.HarmonicBalance(UNEQUAL, 5)
    X = to_real(rng.normal(size=(3, 6)) + 1j * rng.normal(size=(3, 6))).ravel()
    here = {**UNEQUAL.parameters, "Omega": OMEGA}
    x, now = here[name], problem.linearise(X, name, **here)

    def R(value):
        return problem.residual(X, **{**here, name: value})

    noise = scatter(R, x, now.R, now.dR_dp)
    expected, error = reference(slope, R, x, 1e-3 * x, noise)
    own = 0.0 if name == "Omega" else noise / (1e-6 * x)
    agree(now.dR_dp, expected, error + own)


def test_jacobian_against_differences(rng, slope):
    problem = hb.HarmonicBalance(UNEQUAL, 5)
    X = to_real(rng.normal(size=(3, 6)) + 1j * rng.normal(size=(3, 6))).ravel()
    here, V = {**UNEQUAL.parameters, "Omega": OMEGA}, rng.normal(size=X.size)
    now = problem.linearise(X, "", **here)

    def R(s):
        return problem.residual(X + s * V, **here)

    found = now.dR_dX @ V
    expected, error = reference(slope, R, 0.0, 1e-4, scatter(R, 0.0, now.R, found))
    agree(found, expected, error)


def test_heavy_gears_stand_still_and_leave_the_spur_pair():
    """What the supports change is proportional to mu = m_c / m_i."""
    shared = {"eps": (0.2,), "e": (0.05, 0.02), "zeta": 0.05}
    pair = hb.HarmonicBalance(hb.SpurPair(**shared), 12)
    X = pair.start(0.6, **pair.parameters)
    assert pair.observe(X, stability=False, **{**pair.parameters, "Omega": 0.6})["regime"][0] == 1
    errors = []
    for mu in (1e-4, 1e-6, 1e-8):
        problem = hb.HarmonicBalance(
            hb.gears.GearRotorBearing(mu_1=mu, mu_2=mu, F_1=0.0, F_2=0.0, b_1=0.0, b_2=0.0, **shared), 12
        )
        errors.append(np.abs(problem.start(0.6, **problem.parameters)[: X.size] - X).max())
    assert errors[2] < 1e-6
    np.testing.assert_allclose(np.divide(errors[1:], errors[:-1]), 0.01, rtol=0.02)


@pytest.mark.parametrize(("mu", "tolerance", "limit"), [(1e-6, 1e-10, 2e-9), (1e-8, 1e-10, 5e-5), (1e-8, 1e-13, 2e-9)])
def test_accuracy_of_the_gap_with_heavy_gears(mu, tolerance, limit):
    """While the bearings stay loaded, preload and clearance only shift their means: the gap is that without either."""
    bare = hb.gears.GearRotorBearing(mu_1=mu, mu_2=mu, F_1=0.0, F_2=0.0, b_1=0.0, b_2=0.0, eps=(0.2,))
    gaps = []
    for model in (bare, bare.replace(F_1=0.1, F_2=0.1, b_1=1.0, b_2=1.0)):
        problem = hb.HarmonicBalance(model, 12)
        here = {**model.parameters, "Omega": 0.6}
        gaps.append(solve(problem, problem.start(**here), here, settings=hb.NewtonSettings(tolerance=tolerance)).X[:25])
    assert np.abs(gaps[1] - gaps[0]).max() < limit


def test_start_from_springs_pushed_to_either_side():
    """The preloads press the pinion's bearing to the negative side and the gear's to the positive one."""
    m = UNEQUAL.replace(e_scale=0.0, eps_scale=0.0)
    X = hb.HarmonicBalance(m, 3).start(OMEGA, **m.parameters).reshape(3, -1)
    static = [m.b + m.F_m, -m.b_1 - (m.F_1 + m.mu_1 * m.F_m) / m.kappa_1, m.b_2 + (m.F_2 + m.mu_2 * m.F_m) / m.kappa_2]
    np.testing.assert_allclose(X[:, 0], static, atol=1e-12)


def test_points_agree_with_time_integration():
    """A curve on which the bearings rattle too."""
    model = hb.gears.GearRotorBearing(e=(0.1,))
    curve = hb.trace(hb.HarmonicBalance(model, 40), "Omega", (1.5, 1.1), stability=False, special=False)
    assert (curve.regime.max(axis=0) >= 1).all()
    rattling = np.flatnonzero((curve.regime >= 1).all(axis=1))
    report = hb.validate(curve, [int(rattling[len(rattling) // 2])], tolerance=1e-4)
    assert report.ok, report.rows


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mu_1": 0.0}, "mu_1 = 0.0 must be positive"),
        ({"kappa_2": -1.0}, "kappa_2 = -1.0 must be positive"),
        ({"zeta_1": -0.1}, "zeta_1 = -0.1 must not be negative"),
        ({"b_2": -0.5}, "b_2 = -0.5 must not be negative"),
        ({"phase": "cosine"}, "phase = 'cosine' must be 'cos' or 'sin'"),
        ({"e": 0.05}, "e = 0.05 must be a sequence of numbers"),
        ({"eps": (np.nan,)}, "eps = .* not finite"),
        ({"F_1": np.inf}, "F_1 = inf must be a finite number"),
    ],
)
def test_ranges(fields, message):
    with pytest.raises(ValueError, match=f"GearRotorBearing: {message}"):
        hb.gears.GearRotorBearing(**fields)


def test_it_is_known_by_name():
    from hbgear.harmonic.models.model_registry import build, rebuild_model
    from hbgear.mechanics.models import describe

    model = build("gear-rotor-bearing", mu_1=0.5, e=(0.1,))
    assert model == hb.gears.GearRotorBearing(mu_1=0.5, e=(0.1,)) == rebuild_model(describe(model))
    assert [e.name for e in model.system().elements] == ["gap", "bearing 1", "bearing 2"]
