"""Parts of trains against closed forms: rotating shafts and discs, unbalance, clearances, housings.

Whirl of a simply supported Timoshenko shaft with the mode sin(k z):
    (E I k^2 - rho I omega^2 + 2 rho I Omega omega) (k^2 - rho omega^2 / (kappa G)) = rho A omega^2
"""

import dataclasses
from math import cos, pi, sqrt

import numpy as np
import pytest
import scipy
from machines import state_matrix

import hbgear as hb
from hbgear.mechanics.series.fourier import to_complex

E, NU, RHO = 2.06e11, 0.3, 7850.0


def timoshenko(beam, mode, Omega):
    """Natural frequencies of a simply supported shaft that rotates at Omega: the two smallest in magnitude."""
    k = mode * pi / beam.length
    A, I = beam.area, beam.second_moment  # noqa: E741
    shear = beam.shear_coefficient * E / (2 * (1 + NU))
    first = np.polynomial.Polynomial([E * I * k**2, 2 * RHO * I * Omega, -RHO * I])
    second = np.polynomial.Polynomial([k**2, 0, -RHO / shear])
    roots = (first * second - np.polynomial.Polynomial([0, 0, RHO * A])).roots().real
    return np.sort(roots[np.argsort(np.abs(roots))][:2])


@pytest.mark.parametrize("Omega", [0.0, 3000.0])
@pytest.mark.parametrize("inner", [0.0, 0.06])
def test_whirl_of_a_timoshenko_shaft(Omega, inner):
    """The error decreases as the square of the element length; extrapolated frequencies agree to 1e-4."""
    found, wanted = [], np.zeros(4)
    for elements in (8, 16):
        beam = hb.gears.Beam("a", "b", 0.1, 0.8, inner, elements=elements)
        M, K, G = beam.matrices
        free = [i for i in range(len(M)) if i % 6 not in (2, 5) and i not in (0, 1, len(M) - 6, len(M) - 5)]
        M, K, G = (A[np.ix_(free, free)] for A in (M, K, Omega * G))
        whirl = np.linalg.eigvals(state_matrix(M, G, K)).imag
        found.append(np.sort(whirl[whirl > 0])[:4])
        wanted = np.sort(np.abs(np.concatenate([timoshenko(beam, mode, Omega) for mode in (1, 2)])))
    coarse, fine = (np.abs(each / wanted - 1) for each in found)
    np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.15)
    np.testing.assert_allclose((4 * found[1] - found[0]) / 3, wanted, rtol=1e-4)


def test_statics_of_a_beam_are_exact():
    """Tip deflection F L^3 / 3 E I + F L / (kappa A G) of a cantilever, its slope, torsion and extension."""
    beam = hb.gears.Beam("a", "b", 0.05, 0.4, 0.02, elements=3)
    K = beam.matrices[1][6:, 6:]
    tip = np.linalg.solve(K, np.eye(len(K))[:, -6:])[-6:]
    A, I, L, G = beam.area, beam.second_moment, 0.4, E / 2 / (1 + NU)  # noqa: E741
    bent, slope = L**3 / (3 * E * I) + L / (beam.shear_coefficient * A * G), L**2 / (2 * E * I)
    expected = np.diag([bent, bent, L / (E * A), L / (E * I), L / (E * I), L / (2 * G * I)])
    expected[0, 4] = expected[4, 0] = slope
    expected[1, 3] = expected[3, 1] = -slope
    np.testing.assert_allclose(tip, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
    assert beam.matrices[0].trace() > 0 and beam.mass == pytest.approx(RHO * A * L)
    rigid = np.tile(np.eye(6)[0], 4)
    assert rigid @ beam.matrices[0] @ rigid == pytest.approx(beam.mass, rel=1e-12)


def gears(**kwargs):
    """A pinion that moves in space, or as given, and a gear that only rotates."""
    return [
        hb.gears.Wheel("pinion", 1e-3, 2.0, teeth=20, base_radius=0.028, torque=100.0, **{"moves": "space", **kwargs}),
        hb.gears.Wheel("gear", 4e-3, 5.0, teeth=20, base_radius=0.028),
    ]


MESH = hb.gears.Mesh("pinion", "gear", 4e8, 4e-5, eps=(0.1,), direction=0.0)


def test_whirl_of_an_overhung_disc():
    """(k_11 - m w^2)(k_22 - I_d w^2 + I_p Omega w) = k_12^2 for a disc at the end of a massless shaft."""
    m, I_p, I_d, L, d = 12.0, 0.09, 0.05, 0.3, 0.05
    disc = hb.gears.Wheel("disc", I_p, m, I_d, moves="space", z=L)
    shaft = hb.gears.Beam("pinion", "disc", d, density=0.0, elements=1, damping=0.0)
    train = hb.gears.Train([*gears(), disc], [MESH], beams=[shaft], balance="gear", gyroscopic=True)
    assert train.beams[0].length == L
    system, at = train.system(), [i for i, name in enumerate(train.system().dof_names) if name.endswith("_disc")]
    at = [at[0], at[4], at[1], at[3]]  # x, theta_y, y, theta_x; the pinion is taken as fixed
    Omega = 0.7
    speed = Omega * train.omega_n / 20
    M, K, C = (A[np.ix_(at, at)] for A in (system.M, system.K, system.at_speed(Omega).C))
    found = np.linalg.eigvals(state_matrix(M, C, K)).imag * train.omega_n
    I = pi * d**4 / 64  # noqa: E741
    phi = 12 * E * I / (train.beams[0].shear_coefficient * pi * d**2 / 4 * E / 2 / (1 + NU) * L**2)
    k11, k12, k22 = E * I / (1 + phi) * np.array([12 / L**3, -6 / L**2, (4 + phi) / L])
    P = np.polynomial.Polynomial
    roots = (P([k11, 0, -m]) * P([k22, I_p * speed, -I_d]) - k12**2).roots().real
    np.testing.assert_allclose(np.sort(found), np.sort(np.concatenate([roots, -roots])), rtol=1e-9)
    assert np.ptp(np.abs(roots)) > 0.3 * abs(roots).max()  # forward and backward whirl differ


def test_damping_of_the_modes_of_a_beam():
    shaft = hb.gears.Beam("a", "b", 0.05, 0.4, elements=4, damping=0.03)
    ends = np.array([2.0, 2.0, 2.0, 0.01, 0.01, 0.02]), np.array([5.0, 5.0, 5.0, 0.02, 0.02, 0.04])
    M, K, _ = shaft.matrices
    M = M + np.diag(np.concatenate([ends[0], np.zeros(len(M) - 12), ends[1]]))
    squares, V = scipy.linalg.eigh(K, M)
    damped = V.T @ shaft.dampers(*ends) @ V
    np.testing.assert_allclose(np.diag(damped)[6:], 2 * 0.03 * np.sqrt(squares[6:]), rtol=1e-6)
    assert np.abs(damped - np.diag(np.diag(damped))).max() < 1e-6 * np.abs(damped).max()


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_unbalance_of_a_jeffcott_rotor(turn):
    """x + i y = U w^2 e^{i (w t + phase)} / (k - m w^2 + i c w) for a rotor driven by a torsional shaft."""
    m, k, zeta, U = 8.0, 6e6, 0.04, 2e-4
    rotor = hb.gears.Wheel("rotor", 0.05, m, moves="plane", unbalance=U, unbalance_angle=0.4)
    wheels = [hb.gears.Wheel("pinion", 1e-3, teeth=20, base_radius=0.028, torque=turn * 100.0), gears()[1], rotor]
    train = hb.gears.Train(
        wheels,
        [MESH],
        [hb.gears.Shaft("pinion", "rotor", 1e5)],
        [hb.gears.Bearing("rotor", k, k, damping=zeta)],
        balance="gear",
        unbalance_scale=1.5,
    )
    assert (train.orders["rotor"], train.orders["pinion-gear"]) == (1.0, 20.0)
    w = 1.2 * sqrt(k / m)
    Omega = w / train.omega_n
    problem = hb.HarmonicBalance(train, 40)
    q = to_complex(problem.motion(problem.start(Omega=Omega), Omega=Omega))[:, 1] * train.b_c
    x, y = (q[problem.dof_names.index(f"{axis}_rotor")] for axis in "xy")
    phase = np.exp(
        turn * 1j * (0.4 + train._kinematics.start_angles["rotor"])
    )  # x ~ cos(theta) in both directions of rotation
    expected = 1.5 * U * w**2 * phase / (k - m * w**2 + 2j * zeta * sqrt(k * m) * w)
    np.testing.assert_allclose([x, y], [expected, -turn * 1j * expected], rtol=1e-10)
    resting = hb.gears.Train(wheels[:2], [MESH], balance="gear")
    assert resting.orders["pinion"] == 0.05  # without an unbalance Omega is the mesh frequency


def test_orders_about_the_multiples_of_the_teeth_are_enough():
    """Unbalance of order 1 and teeth of order 20: orders within 3 of multiples of 20 against all orders, to 1e-6."""
    rotor = hb.gears.Wheel(
        "pinion", 1e-3, 2.0, teeth=20, base_radius=0.028, moves="plane", torque=100.0, unbalance=1e-4
    )
    train = hb.gears.Train([rotor, gears()[1]], [MESH], bearings=[hb.gears.Bearing("pinion", 2e8, 2e8)], balance="gear")
    few = hb.HarmonicBalance(train, orders=[k for b in range(4) for k in range(20 * b - 3, 20 * b + 4) if k > 0])
    whole, Omega = hb.HarmonicBalance(train, 63), 0.04
    X = [problem.motion(problem.start(Omega=Omega), Omega=Omega) for problem in (few, whole)]
    assert few.size < 0.5 * whole.size
    np.testing.assert_allclose(X[0], X[1], atol=1e-6 * np.abs(X[1]).max())
    assert 20 in hb.HarmonicBalance(train, 3).orders  # below the tooth order, the orders of the meshes are selected


def static(train):
    """Return the static displacements [m] of all coordinates under the torques."""
    problem = hb.HarmonicBalance(train, 1)
    means = problem.motion(problem.start(Omega=0.5), Omega=0.5)[:, 0] * train.b_c
    return dict(zip(problem.dof_names, means, strict=True))


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
def test_clearance_and_housing_in_series():
    """The mesh force closes the radial clearance and deflects bearing and housing: c + F / k + F / k_h."""
    F, k, k_h, c, alpha = 100.0 / 0.028, 2e8, 5e8, 3e-5, 0.35
    still = hb.gears.Mesh("pinion", "gear", 4e8, 4e-5, direction=0.0, pressure_angle=alpha)
    box = hb.gears.Housing([[60.0]], [[k_h]], [[1e4]], ["side"], {"pinion": {"y": "side"}})
    bearing = hb.gears.Bearing("pinion", k, k, clearance=c)
    free = hb.gears.Bearing("pinion", k, k)
    for bearings, gap, seat in (([free], 0.0, None), ([bearing], c, None), ([bearing], c, box), ([free], 0.0, box)):
        train = hb.gears.Train(gears(moves="plane"), [still], bearings=bearings, housing=seat, balance="gear")
        found = static(train)
        across, along = ((gap + abs(F) / k) * x for x in (cos(alpha), np.sin(alpha)))
        side = F * cos(alpha) / k_h if seat else 0.0
        assert abs(found["x_pinion"]) == pytest.approx(along, rel=1e-9)
        assert abs(found["y_pinion"]) == pytest.approx(across + side, rel=1e-9)
        assert abs(found.get("side", 0.0)) == pytest.approx(side, rel=1e-9)
        assert [e.name for e in train.system().elements[1:]] == (["pinion x", "pinion y"] if gap else [])


def test_a_stiff_housing_is_the_ground():
    """A rigid housing gives the motion without housing; tables and reactions act between wheel and housing."""
    table = hb.mechanics.MatrixTable([10.0, 1e4], [1e7 * np.eye(2), 3e7 * np.eye(2)])
    bearing = hb.gears.Bearing("pinion", "2e8 N/m", "3e8 N/m", table=table)
    seats = {"pinion": {"x": "h1", "y": "h2"}}
    trains = [
        hb.gears.Train(gears(moves="plane"), [MESH], bearings=[bearing], balance="gear", housing=box)
        for box in (None, hb.gears.Housing(np.diag([1.0, 1.0]), 1e16 * np.eye(2), seats=seats))
    ]
    problems = [hb.HarmonicBalance(train, 8) for train in trains]
    X = [problem.start(Omega=0.8) for problem in problems]
    np.testing.assert_allclose(X[1], X[0], atol=1e-6 * np.abs(X[0]).max())
    plain = dataclasses.replace(trains[1], bearings=(hb.gears.Bearing("pinion", 2e8, 3e8),)).reactions["pinion radial"]
    np.testing.assert_allclose(plain.stiffness[:, -2:], [[-0.5, 0.0], [0.0, -0.75]])


def bent(second, length=0.2, z=0.0):
    wheels = [*gears(), hb.gears.Wheel("d", 1.0, 1.0, moves="space", z=z)]
    return hb.gears.Train(wheels, [MESH], beams=[hb.gears.Beam("pinion", second, 0.05, length)], balance="gear")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: hb.gears.Beam("a", "a", 0.05), "name two wheels"),
        (lambda: hb.gears.Beam("a", "b", 0.05, inner=0.06), "smaller than outer"),
        (lambda: hb.gears.Beam("a", "b", "50 kg"), "outer"),
        (lambda: hb.gears.Beam("a", "b", 0.05, elements=0), "elements"),
        (lambda: bent("gear"), "moves='space'"),
        (lambda: bent("mill"), "no wheel 'mill'"),
        (lambda: bent("d", None), "larger z"),
        (lambda: bent("d", z=0.3), "leave one out"),
        (lambda: hb.gears.Wheel("a", 1.0, unbalance=1e-3), "cannot move sideways"),
        (
            lambda: hb.gears.Train(
                [*gears(), hb.gears.Wheel("d", 1.0, 1.0, moves="plane", unbalance=1e-3)], [MESH], balance="gear"
            ),
            "does not turn",
        ),
        (
            lambda: hb.gears.Bearing(
                "a", 1e8, 1e8, clearance="3 mm", table=hb.mechanics.MatrixTable([1, 2], np.zeros((2, 2, 2)))
            ),
            "needs springs x or y",
        ),
        (lambda: hb.gears.Bearing("a", clearance="3 um"), "needs springs x or y"),
        (lambda: hb.gears.Housing(np.eye(2), np.eye(3)), "the shape of M"),
        (lambda: hb.gears.Housing(np.eye(2), np.full((2, 2), np.nan)), "not finite"),
        (lambda: hb.gears.Housing(np.eye(2), np.eye(2), names=["a"]), "1 names for 2"),
        (lambda: hb.gears.Housing(np.eye(2), np.eye(2), seats={"pinion": {"x": "h3"}}), "no coordinate 'h3'"),
        (lambda: hb.gears.Housing(np.eye(2), np.eye(2), seats={"pinion": {"up": "h1"}}), "must be one of x, y, z"),
        (lambda: hb.gears.Housing(np.eye(2), np.eye(2), seats=["pinion"]), "must be a dict"),
        (
            lambda: hb.gears.Train(
                gears(), [MESH], balance="gear", housing=hb.gears.Housing([[1.0]], [[1.0]], seats={"mill": {}})
            ),
            "no wheel 'mill'",
        ),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_shear_coefficients_of_solid_sections_and_thin_tubes(nu):
    """Limits after Cowper (1966): solid circle to 1e-14 and thin-walled round tube to 1e-8."""

    def coefficient(inner):
        return hb.gears.Beam("a", "b", outer=0.1, inner=inner, length=1.0, poisson=nu).shear_coefficient

    assert coefficient(0.0) == pytest.approx(6 * (1 + nu) / (7 + 6 * nu), rel=1e-14)
    assert coefficient(0.1 * (1 - 1e-9)) == pytest.approx(2 * (1 + nu) / (4 + 3 * nu), rel=1e-8)
    with pytest.raises(ValueError, match="must be smaller than outer"):
        coefficient(0.1)
