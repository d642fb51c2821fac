"""Exact motions in contact instants against shooting by SciPy, harmonic balance with H = 64, and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from cross.shooting import shoot, state
from machines import single_mass
from scipy import sparse

import hbgear as hb
from hbgear.harmonic.instants.equations import Equations, NotPiecewiseLinear
from hbgear.harmonic.instants.pattern import Pattern, Switch
from hbgear.harmonic.instants.refine import Approximation, exact_motion_of, refine, solve
from hbgear.harmonic.instants.shooting import Iterate, linearise
from hbgear.harmonic.stability.exact_motion import refine_motion

RECTANGLE = hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.6)
TRAPEZOID = hb.mechanics.Periodic.trapezoidal(1.2, 0.8, 0.4, 0.1)
ERROR = hb.mechanics.Periodic.table([0, 1, 2, 4], [0, 0.2, 0.1, -0.1], kind="cubic")


def one_mass(law, c=0.1, k=1.0, **more):
    load = hb.Load(constant=[0.1], cosine={1: [0.5]}, sine={2: [0.05]})
    return hb.System([[1.0]], [[c]], [[k]], [hb.Element([1.0], law, **more)], load)


def stop(k, c, F, gap=0.5):
    return single_mass(hb.Unilateral(k, gap), F=F, c=c)


def chain(**more):
    elements = [
        hb.Element([1, -1], hb.Backlash(b=0.3, k=2.0), displacement=hb.mechanics.Series(0.0, (0.05,)), damping=0.02),
        hb.Element([0, 1], hb.Unilateral(k=5.0, gap=0.2)),
    ]
    load = hb.Load(constant=[0.1, 0], cosine={1: [0.5, 0.2]}, sine={2: [0, 0.1]})
    return hb.System(np.eye(2), 0.05 * np.eye(2), [[2, -1], [-1, 2]], elements, load, **more)


def floating():
    """Three unconstrained masses, coupled by two meshes with backlash."""
    elements = [
        hb.Element([1, -1, 0], hb.Backlash(b=0.5, stiffness=hb.mechanics.Series(1, (0.2,))), damping=0.1),
        hb.Element([0, 1, -1], hb.Backlash(b=0.5, k=2.0), displacement=hb.mechanics.Series(0, (0.1,)), damping=0.1),
    ]
    load = hb.Load(constant=[0.3, 0, -0.3], cosine={1: [0.4, 0, -0.1]})
    return hb.System(np.diag([1.0, 2.0, 1.5]), np.zeros((3, 3)), np.zeros((3, 3)), elements, load)


MODELS = {
    "chain": (chain(), 0.9),
    "gyroscopic": (chain(speed=hb.mechanics.SpeedTerms(np.array([[0, 0.3], [-0.3, 0]]))), 0.9),
    "floating": (floating(), 0.6),
    "varying stiffness": (one_mass(hb.Backlash(0.2, 2.0, hb.mechanics.Series(1.0, (0.2, 0.1), (0.0, 0.05)))), 0.9),
    "breakpoints": (one_mass(hb.mechanics.PiecewiseLinear((-0.2, 0.1, 0.5), (3, 0.5, 1, 4.0), force_at_zero=0.2)), 0.8),
    "two springs": (
        one_mass(
            hb.mechanics.Parallel((hb.Backlash(0.2, 1.0, hb.mechanics.Series(1, (0.2,))), hb.Unilateral(3.0, 0.4)))
        ),
        0.8,
    ),
    "rectangle": (one_mass(hb.Backlash(0.3, 1.0, RECTANGLE), damping=0.02), 0.8),
    "trapezoid": (one_mass(hb.Backlash(0.3, 1.0, TRAPEZOID), displacement=ERROR, damping=0.02), 0.8),
    "spur pair": (hb.SpurPair(zeta=0.05, eps=(0.2, 0.1)), 0.7),
    "rotor": (hb.gears.GearRotorBearing(), 0.8),
}


@pytest.mark.parametrize("name", MODELS)
def test_balance_converges_to_the_exact_motion(name):
    model, Omega = MODELS[name]
    distances, moduli, exact = [], [], []
    for H in (16, 64):
        problem = hb.HarmonicBalance(model, H)
        X = problem.start(Omega=Omega)
        motion = refine_motion(problem, X, {"Omega": Omega})
        assert motion.residual < 1e-12 and motion.Omega == Omega
        assert any(not switch.is_fixed for switch in motion.switches)
        distances.append(motion.distance)
        moduli.append(
            np.abs(np.sort_complex(problem.multipliers(X, Omega=Omega)) - np.sort_complex(motion.multipliers))
        )
        exact.append(motion)
    assert distances[1] < 2e-5 and distances[1] < distances[0] / 16  # errors fall as 1 / H^3
    assert moduli[1].max() < 1e-4
    np.testing.assert_allclose(exact[0].instants, exact[1].instants, atol=1e-10)
    np.testing.assert_allclose(exact[0].monodromy, exact[1].monodromy, atol=1e-9)


@pytest.mark.parametrize("name", ["chain", "varying stiffness", "breakpoints"])
def test_multipliers_of_shooting(name):
    model, Omega = MODELS[name]
    problem = hb.HarmonicBalance(model, 32)
    X = problem.start(Omega=Omega)
    _, period = shoot(model, Omega, state(problem, X, Omega=Omega))
    exact = refine_motion(problem, X, {"Omega": Omega})
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(period.monodromy)), np.sort_complex(exact.multipliers), atol=1e-8
    )
    instants = np.sort(exact.instants) / Omega
    np.testing.assert_allclose(np.sort(period.instants), instants, atol=1e-8)


@pytest.mark.parametrize("nu", [1, 2])
def test_determinant_of_the_monodromy_is_the_loss_of_volume(nu):
    model, Omega = MODELS["chain"]
    problem = hb.HarmonicBalance(model, 16 * nu, nu=nu)
    exact = refine_motion(problem, problem.start(Omega=Omega), {"Omega": Omega})
    C = model.C + 0.02 * np.array([[1, -1], [-1, 1]])
    expected = np.exp(-np.trace(C) * 2 * np.pi * nu / Omega)
    assert np.linalg.det(exact.monodromy) == pytest.approx(expected, rel=1e-9)


def test_motion_without_contact_is_the_linear_response():
    k, c, F, Omega = 1.0, 0.1, 0.3, 0.7
    problem = hb.HarmonicBalance(stop(5.0, c, F, gap=50.0), 4)
    exact = refine_motion(problem, problem.start(Omega=Omega), {"Omega": Omega})
    q = F / (k - Omega**2 + 1j * Omega * c)
    expected = (q * np.exp(1j * exact.samples.tau)).real
    np.testing.assert_allclose(exact.samples.gaps[:, 0], expected, atol=1e-12)
    poles = -c / 2 + 1j * np.sqrt(1 - c**2 / 4) * np.array([1, -1])
    np.testing.assert_allclose(
        np.sort_complex(exact.multipliers), np.sort_complex(np.exp(poles * 2 * np.pi / Omega)), atol=1e-10
    )
    assert exact.shortest == np.inf


def test_points_that_a_truncated_motion_calls_stable():
    """One mass with a stop of k = 200: at Omega = 1.629541 the largest multiplier is 1.0985 by shooting."""
    problem = hb.HarmonicBalance(stop(200.0, 0.04, 0.1), 16)
    curve = hb.trace(problem, "Omega", (0.8, 2.2), stability=False, special=False, accuracy=None)
    top = int(np.argmax(np.diff(curve.values) < 0))  # next to the first fold
    row = top + int(np.argmin(np.abs(curve.values[top : top + 40] - 1.629541)))
    side = top - int(np.argmin(np.abs(curve.values[top::-1] - 1.629541)))
    largest = []
    for i in (row, side):
        exact = refine_motion(problem, curve.X[i], {"Omega": 1.629541})
        largest.append(float(exact.multipliers[0].real))
    assert max(largest) == pytest.approx(1.0985, abs=1e-4)
    assert min(largest) < 1.0


# kind, k, c, F, Omega, instants, velocities: folds and period doublings computed with 30 digits in contact instants
SPECIAL = [
    (
        "PD",
        50,
        0.04,
        0.1,
        0.8973292021418086,
        [0.126554754269326, 0.23443814800278392],
        [0.025748906071337285, -0.025745873860456236],
    ),
    (
        "LP",
        50,
        0.04,
        0.1,
        1.5597537034509845,
        [1.3295950719414005, 2.001121589311005],
        [2.1351223046366434, -2.1228831912224932],
    ),
    (
        "LP",
        1000,
        0.1,
        0.3,
        0.6351155621602433,
        [0.1030888596875163, 0.10900256286609189],
        [0.0009458218841833373, -0.0009458193136133445],
    ),
    (
        "PD",
        1000,
        0.1,
        0.3,
        0.5625771897446171,
        [-1.136743576725717, -1.081968108490416, 1.559450103197631, 1.5614603297377474],
        [0.3800591039233865, -0.3779611634288575, 0.0008885889242620403, -0.0008888422347931101],
    ),
    (
        "LP",
        1000,
        0.1,
        0.3,
        0.6421889233987886,
        [-0.7468665610057343, -0.6835455768925769, 2.069204824283152, 2.1254383272549493],
        [0.7888643032999935, -0.7847640324319052, 0.10965204467100609, -0.10946669709578687],
    ),
    (
        "PD",
        1000,
        0.1,
        0.3,
        0.8639678495853121,
        [0.050255930486294356, 0.13508152168823376],
        [0.3616201458151522, -0.35991528781577753],
    ),
    (
        "LP",
        10000,
        0.04,
        0.3,
        0.5145794569215186,
        [-0.5965642975194317, -0.5809292770753411],
        [0.04860376886372815, -0.04855936965073252],
    ),
    (
        "PD",
        10000,
        0.04,
        0.3,
        0.6293137942906766,
        [-1.1807418434405914, -1.161075685980249, 1.4362991813409915, 1.4558828583136423],
        [0.46687406070016574, -0.46654954746172145, 0.31343378930197063, -0.3132771714223372],
    ),
    (
        "LP",
        10000,
        0.04,
        0.3,
        0.7563428715304554,
        [-0.6884114439547896, -0.6646851705635516, 2.1934055402690245, 2.217013808620012],
        [1.19280969637807, -1.192034327371257, 0.6757325763478399, -0.6753494959697176],
    ),
    (
        "PD",
        10000,
        0.04,
        0.3,
        0.8607838645899833,
        [0.02038031662759134, 0.047326902713020126],
        [0.3651924352731389, -0.36496638790167557],
    ),
    (
        "LP",
        100000,
        0.1,
        0.3,
        0.5379657947238464,
        [-0.4969967025811338, -0.4916765727256458],
        [0.10442755228846913, -0.10437464834390976],
    ),
    (
        "PD",
        100000,
        0.1,
        0.3,
        0.6270735647787442,
        [-0.9587021229757804, -0.9524794082603997, 1.7274296576234403, 1.7336122748901561],
        [0.5881207185411311, -0.5878262449900689, 0.14596214521889983, -0.14589438975645633],
    ),
    (
        "LP",
        100000,
        0.1,
        0.3,
        0.6567592021940908,
        [-0.7121997920371159, -0.705679665256441, 2.0934789322407723, 2.0999342250728454],
        [0.7997783788266835, -0.7993791895664589, 0.12331870188899108, -0.12326206412760501],
    ),
    (
        "PD",
        100000,
        0.1,
        0.3,
        0.8766907032019411,
        [0.08722059864510251, 0.09592054008757436],
        [0.3685815195194083, -0.3683993620542907],
    ),
]


def iterate_of(model, at, instants, velocities):
    switches = [Switch(0, 0, 1 - 2 * (i % 2)) for i in range(len(instants))]
    gap = model.elements[0].law.breakpoints[0]
    states = np.array([at.structure.reduce @ np.array([gap, v]) for v in velocities])
    return Iterate(Pattern.of(switches, [0], 0), np.array(instants), states)


@pytest.mark.parametrize("kind, k, c, F, Omega, instants, velocities", SPECIAL)
def test_special_points_of_hard_stops(kind, k, c, F, Omega, instants, velocities):
    model = stop(k, c, F)
    at = Equations(model).at(Omega)
    iterate = iterate_of(model, at, instants, velocities)
    now = linearise(at, iterate)
    assert np.abs(now.R).max() < 1e-9
    if kind == "LP":  # the equations are singular in these unknowns
        exact = exact_motion_of(at, iterate, None, 0.0)
        assert np.abs(exact.multipliers - 1).min() < 1e-5
        return
    durations = iterate.durations(at.period)
    shift = 0.02 * np.minimum(durations, np.roll(durations, 1)) * np.cos(np.arange(len(instants)))
    moved = Iterate(iterate.pattern, iterate.tau + shift, 1.001 * iterate.x)
    at, found, samples = solve(at, moved, False)
    exact = exact_motion_of(at, found, samples, 0.0)
    assert np.abs(exact.multipliers + 1).min() < 1e-6
    np.testing.assert_allclose(found.tau, instants, atol=1e-8)


@pytest.mark.parametrize("clearance, half", [(-1e-3, 0.05), (1e-3, 0.05), (1e-3, 0.0)])
def test_crossings_that_are_missing_or_too_many_are_corrected(clearance, half):
    """Solutions slightly beyond a stop or in front of it, from approximations without or with a contact."""
    Omega, free = 0.7, 0.3 / (1 - 0.7**2 + 1j * 0.1 * 0.7)
    model = stop(20.0, 0.1, 0.3, gap=abs(free) * (1 + clearance))
    rows, top = np.array([[0.0, free.real, -free.imag]]), -np.angle(free)
    contact = [(top - half, 0, 0, 1), (top + half, 0, 0, -1)]
    found = refine(Equations(model), Approximation(rows, contact if clearance > 0 else []), Omega)
    assert found.residual < 1e-12
    if clearance > 0:
        assert all(switch.is_fixed for switch in found.switches) and found.distance < 1e-12
        return
    problem = hb.HarmonicBalance(model, 128)
    exact = refine_motion(problem, problem.start(Omega=Omega), {"Omega": Omega})
    assert len(found.switches) == 2 and not any(switch.is_fixed for switch in found.switches)
    np.testing.assert_allclose(found.instants, exact.instants, atol=1e-9)


def test_near_a_fold_another_Omega_has_the_motion():
    model = stop(200.0, 0.04, 0.1)
    problem = hb.HarmonicBalance(model, 32)
    curve = hb.trace(problem, "Omega", (0.8, 2.2), stability=False, special=False, accuracy=None)
    top = int(np.argmax(np.diff(curve.values) < 0))
    beyond = 1.001 * 1.63974  # 0.1 % above the fold of the exact motion
    with pytest.raises(hb.NoConvergence, match="no exact motion"):
        refine_motion(problem, curve.X[top], {"Omega": beyond})
    exact = refine_motion(problem, curve.X[top], {"Omega": beyond}, free=True)
    assert exact.residual < 1e-12
    assert exact.Omega < beyond and exact.Omega == pytest.approx(1.63974, rel=2e-3)


def test_bouncing_on_a_hard_stop_is_named():
    """A mass on its stop bounces until it rests, at a low Omega: not all contacts of the balance are found."""
    model = stop(1e5, 0.1, 0.3, gap=0.0)
    with pytest.raises(hb.NoConvergence, match="an element bounces: begin the curve where it has fewer contacts"):
        hb.trace(hb.ContactInstants(model), "Omega", (0.2, 0.01))


def test_models_without_contact_instants_are_refused():
    problem = hb.HarmonicBalance(hb.Duffing(), 4)
    with pytest.raises(NotPiecewiseLinear, match="not piecewise linear"):
        refine_motion(problem, problem.start(Omega=0.8), {"Omega": 0.8})


def test_units_do_not_matter():
    model = stop(200.0, 0.04, 0.1)
    length, time, mass = 1e-6, 1e3, 1e3
    stiffness = mass / time**2
    scaled = replace(
        model,
        M=mass * model.M,
        C=mass / time * model.C,
        K=stiffness * model.K,
        elements=[hb.Element([1.0], hb.Unilateral(200.0 * stiffness, 0.5 * length))],
        load=hb.Load(cosine={1: [0.1 * stiffness * length]}),
    )
    results = []
    for one, Omega in ((model, 1.4), (scaled, 1.4 / time)):
        problem = hb.HarmonicBalance(one, 32)
        results.append(refine_motion(problem, problem.start(Omega=Omega), {"Omega": Omega}))
    np.testing.assert_allclose(results[0].multipliers, results[1].multipliers, rtol=1e-8)
    np.testing.assert_allclose(results[0].instants, results[1].instants, atol=1e-8)


def test_residual_where_a_contact_begins_is_relative_to_the_motion():
    """Gap and velocity at the switches are nearly zero there; relative to them the residual was 7e-8."""
    touching = single_mass(hb.Unilateral(27.154, 0.0), F=0.05705222, mean=-0.01255479, c=0.05203305)
    curve = hb.trace(hb.ContactInstants(touching), "Omega", (2.37, 2.34))
    assert "GR" in {one.kind for one in curve.special} and curve.residual.max() < 1e-11


@pytest.mark.slow
def test_a_structure_of_1600_coordinates_has_the_exact_motion_of_its_modes():
    """A string of masses with a stop: the structure that a curve reduces, against one that is reduced before."""
    n = 1600
    K = 2 * n / np.pi**2 * sparse.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    M, middle = 2 / n * sparse.eye_array(n), np.eye(1, n, n // 2)[0]
    element = hb.Element(middle, hb.Unilateral(k=0.5, gap=0.5), name="stop")
    string = hb.System(M, 0.05 * M, K, [element], hb.Load(cosine={1: 0.1 * middle}))
    problem = hb.HarmonicBalance(string, 8).restricted_to("Omega", 1.0, 1.0, {})
    small = hb.HarmonicBalance(hb.mechanics.reduce(string, modes=20).system, 8)
    exact, expected = (refine_motion(p, p.start(Omega=1.0), {"Omega": 1.0}) for p in (problem, small))
    assert len(exact.instants) == 2 and exact.residual < 1e-10 and exact.distance < 0.02
    np.testing.assert_allclose(np.sort(exact.instants), np.sort(expected.instants), atol=2e-3)
    np.testing.assert_allclose(np.abs(exact.multipliers[:2]), np.abs(expected.multipliers[:2]), rtol=2e-3)
