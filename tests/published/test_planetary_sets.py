"""Planetary sets: natural frequencies of Lin and Parker (1999), phases of Parker and Lin (2004), and motions in time.

Lin and Parker (1999), J. Vib. Acoust. 121(3), https://doi.org/10.1115/1.2893982: N = 3, ring held, Hz.
"""

import numpy as np
import pytest
from machines import state_matrix

import hbgear as hb
from hbgear.mechanics.series.fourier import evaluate

ROTATIONAL = [0, 1475.7, 1930.3, 2658.3, 7462.8, 11775.3]
TRANSLATIONAL = [743.2, 1102.4, 1896.0, 2276.4, 6986.3, 9647.9]


def test_natural_frequencies_of_lin_and_parker():
    modes = hb.gears.PlanetarySet(26, 34, 94, planets=3).modes()
    for kind, published, multiplicity in (("rotational", ROTATIONAL, 1), ("translational", TRANSLATIONAL, 2)):
        found = [mode for mode in modes if mode.kind == kind]
        np.testing.assert_allclose([mode.frequency for mode in found], published, atol=0.05)
        assert {mode.multiplicity for mode in found} == {multiplicity}
    assert len(modes) == 12


@pytest.mark.parametrize(("planets", "teeth"), [(4, (28, 36, 100)), (5, (26, 34, 94)), (6, (26, 34, 94))])
def test_modes_of_a_planet_have_multiplicity_n_minus_3(planets, teeth):
    small = (
        hb.gears.PlanetarySet(*teeth, planets=planets)
        if planets < 5
        else hb.gears.PlanetarySet(44, 16, 76, planets=planets)
    )
    planet = [mode for mode in small.modes() if mode.kind == "planet"]
    assert [mode.multiplicity for mode in planet] == 3 * [planets - 3]
    assert sum(mode.multiplicity for mode in small.modes()) == 9 + 3 * planets


def test_unequal_places_mix_the_modes():
    uneven = hb.gears.PlanetarySet(28, 36, 100, planets=4, spacing=(0.0, 90.0, 180.0, 275.625))
    assert "mixed" in {mode.kind for mode in uneven.modes()}


@pytest.mark.parametrize("digits", [2, 4])
@pytest.mark.parametrize("teeth", [(28, 14, 56), (30, 12, 54)])
def test_rounded_positions_are_those_of_matching_teeth(teeth, digits):
    """Seven planets every 51.43 degrees: the teeth match at 360 / 7 only, where torque or force cancel exactly."""
    exact = hb.gears.PlanetarySet(*teeth, planets=7)
    spacing = tuple(round(360 * n / 7, digits) for n in range(7))
    rounded = exact.replace(spacing=spacing)
    assert rounded.phasing == exact.phasing
    assert [rounded.excitation(n) for n in (1, 2, 3)] == [exact.excitation(n) for n in (1, 2, 3)]
    np.testing.assert_allclose(list(rounded.lags.values()), list(exact.lags.values()), atol=1e-9)
    np.testing.assert_allclose(rounded.angles, exact.angles, atol=1e-12)
    opposite = hb.gears.PlanetarySet(spacing=(0.0, 92.81, 180.0, 272.81))  # 33 of 128 steps are 92.8125 degrees
    assert opposite.lags["sun-p2"] == pytest.approx(2 * np.pi * (28 * 33 / 128 % 1), abs=1e-9)
    assert opposite.excitation(1) == ("torque",)  # 28 is even, so that opposite planets mesh together


@pytest.mark.parametrize("teeth", [(28, 36, 100), (27, 35, 97), (26, 34, 94), (30, 26, 82)])
@pytest.mark.parametrize(
    ("driver", "fixed", "sense"),
    [("sun", "ring", 1), ("carrier", "ring", -1), ("ring", "sun", -1), ("carrier", "sun", 1), ("sun", "carrier", 1)],
)
def test_phases_of_parker_and_lin(teeth, driver, fixed, sense):
    """gamma_sn = z_s psi_n / (2 pi), gamma_rn = -z_r psi_n / (2 pi), gamma_rs = 1/2 with an even planet, else 0.

    In cycles, of the sun turning clockwise in the frame of the carrier; the signs of the first two change with it.
    """
    planetary = hb.gears.PlanetarySet(*teeth, driver=driver, fixed=fixed)
    psi = np.array(planetary.angles)
    sun, ring = -sense * teeth[0] * psi / (2 * np.pi), sense * teeth[2] * psi / (2 * np.pi)
    expected = np.concatenate([sun, ring + (0.5 if teeth[1] % 2 == 0 else 0.0)])
    found = -np.array([*planetary.lags.values()]) / (2 * np.pi)
    difference = (found - expected + 0.5) % 1.0 - 0.5
    np.testing.assert_allclose(difference, 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("driver", "fixed", "ratios"),
    [
        ("sun", "ring", {"sun": 1, "carrier": 28 / 128, "ring": 0}),
        ("carrier", "ring", {"sun": -128 / 28, "carrier": -1, "ring": 0}),
        ("ring", "sun", {"ring": 1, "carrier": 100 / 128, "sun": 0}),
        ("sun", "carrier", {"sun": 1, "ring": -28 / 100, "carrier": 0}),
    ],
)
def test_speeds_by_willis(driver, fixed, ratios):
    planetary = hb.gears.PlanetarySet(driver=driver, fixed=fixed)
    assert {name: float(speed) for name, speed in planetary.speeds.items()} == pytest.approx(ratios)
    mesh = 28 * abs(ratios["sun"] - ratios["carrier"])
    assert planetary.scales.teeth == pytest.approx(mesh)
    assert planetary.orders["mesh"] == 1


@pytest.mark.parametrize("fixed", ["ring", "sun", "carrier"])
def test_static_forces_and_position_error(fixed):
    """Equal shares of the torque; a planet that sits ahead of its place carries less or more than the others."""
    driver = "sun" if fixed != "sun" else "ring"
    share = {}
    for error in (0.0, 5e-6):
        one = hb.gears.PlanetarySet(fixed=fixed, driver=driver, eps_scale=0.0, planet_errors=(error, 0, 0, 0))
        problem = hb.HarmonicBalance(one, 2)
        share[error] = problem.force_rows(problem.start(Omega=0.4), Omega=0.4)[:, 0] * one.k_sp * one.b_c
    equal = 300.0 / one.r_s / 4
    np.testing.assert_allclose(share[0.0], equal, rtol=1e-9)
    shares = share[5e-6]
    np.testing.assert_allclose(shares.reshape(2, 4).sum(axis=1), 4 * equal, rtol=1e-9)
    np.testing.assert_allclose(shares[:4], shares[4:], rtol=1e-9)  # a planet passes on what it takes
    assert abs(shares[0] - equal) > 0.01 * equal and shares[1] == pytest.approx(shares[3], rel=1e-9)


def test_planets_in_phase_move_alike_and_the_sun_rests():
    problem = hb.HarmonicBalance(hb.gears.PlanetarySet(), 8)
    X = problem.start(Omega=1.0)
    rows = X.reshape(2, 4, -1)
    np.testing.assert_allclose(rows, rows[:, :1] + 0 * rows, atol=1e-10)
    sideways = [problem.dof_names.index(f"{axis}_{name}") for axis in "xy" for name in ("sun", "ring", "carrier")]
    assert np.abs(problem.motion(X, Omega=1.0)[sideways]).max() < 1e-10


def test_planets_one_after_the_other_do_not_turn_the_sun():
    """Only harmonics that are multiples of N turn it; those next to them move it sideways."""
    problem = hb.HarmonicBalance(hb.gears.PlanetarySet(27, 35, 97), 8)
    X = problem.start(Omega=0.8)
    u, x = (problem.motion(X, Omega=0.8)[problem.dof_names.index(name)] for name in ("u_sun", "x_sun"))
    size = [np.hypot(q[1::2], q[2::2]) for q in (u, x)]
    turning = np.arange(1, 9) % 4 == 0
    assert size[0][~turning].max() < 1e-10 < 1e-6 < size[0][turning].max()
    assert size[1][np.arange(1, 9) % 2 == 0].max() < 1e-10 < 1e-3 < size[1][0]


@pytest.mark.slow
@pytest.mark.parametrize(("teeth", "kinds"), [((28, 36, 100), {"LP", "NS", "GR"}), ((27, 35, 97), {"LP", "BP", "GR"})])
def test_response_with_backlash_in_eight_meshes(teeth, kinds):
    curve = hb.trace(hb.HarmonicBalance(hb.gears.PlanetarySet(*teeth), 8), "Omega", (1.75, 1.25))
    assert curve.status.complete and {point.kind for point in curve.special} >= kinds
    folds = [point.parameters["Omega"] for point in curve.special if point.kind == "LP"]
    expected = [1.46411, 1.60945] if teeth[0] == 28 else [1.27938, 1.46063]
    np.testing.assert_allclose(folds, expected, atol=5e-4)
    rows = [int(np.argmax(curve.amplitude("pp2", "ring-p1"))), len(curve) // 4]
    assert hb.validate(curve, rows, landing="nearest").ok


@pytest.mark.slow
def test_symmetry_breaks():
    """Each planet does what the one before it did, a quarter of the period later, until a branch point."""
    planetary = hb.gears.PlanetarySet(27, 35, 97)
    curve = hb.trace(hb.HarmonicBalance(planetary, 8), "Omega", (2.3, 2.04))
    first = next(point for point in curve.special if point.kind == "BP")
    assert first.parameters["Omega"] == pytest.approx(2.0854, abs=1e-3)
    broken = hb.switch(curve, first.label, steps=hb.StepControl(max_points=8), stability=False)

    def apart(X):
        """How far planet 2 is from what planet 1 does, at the same phase of its own mesh."""
        tau, rows = np.linspace(0, 2 * np.pi, 64), X.reshape(8, -1)
        return np.abs(evaluate(rows[0], tau) - evaluate(rows[1], tau + planetary.lags["sun-p2"])).max()

    assert max(apart(X) for X in curve.X) < 1e-6 < 1e-3 < max(apart(X) for X in broken.X)


def test_turning_of_the_carrier():
    """In its frame a body on isotropic bearings has the natural frequencies omega -+ Omega_c."""
    loose = hb.gears.PlanetarySet(
        torque=0.0, k_sp=1.0, k_rp=1.0, zeta=0.0, zeta_b=0.0, carrier_rotation=True
    )  # the sun all by itself
    Omega = 2e5
    carrier, alone = loose.orders["carrier"] * Omega, np.sqrt(loose.k_s / loose.m_s) / loose.omega_n
    found = hb.analysis.campbell(loose, (0.5 * Omega, Omega), points=3).frequencies[-1]
    assert carrier > 0.1 * alone
    for expected in (alone - carrier, alone + carrier):
        assert np.abs(found - expected).min() < 1e-6 * alone
    C, K = loose.system().speed.at(2.0, 21)
    speed = loose.orders["carrier"]
    assert C[0, 1] == pytest.approx(-2 * loose.m_c / loose.m_p * speed * 2.0) and C[1, 0] == -C[0, 1]
    assert K[0, 0] == pytest.approx(-loose.m_c / loose.m_p * (2.0 * speed) ** 2)
    turned = np.zeros(21)
    turned[[2, *range(10, 21, 3)]] = 1.0  # the carrier and with it the planets
    np.testing.assert_allclose(K @ turned, 0.0, atol=1e-15)
    damped = loose.replace(zeta_b=0.2)
    system = damped.system()
    C, K = (np.asarray(A) + B for A, B in zip((system.C, system.K), system.speed.at(Omega, 21), strict=True))
    sun, mass = slice(6, 8), loose.m_s / loose.m_p
    states = np.block([[np.zeros((2, 2)), np.eye(2)], [-K[sun, sun] / mass, -C[sun, sun] / mass]])
    still = alone * (-0.2 + 1j * np.sqrt(1 - 0.2**2))  # the bearing does not turn with the frame
    exact = [still - 1j * carrier, still + 1j * carrier]
    found = np.linalg.eigvals(states)
    for pole in exact:
        assert np.abs(found - pole).min() < 1e-9 * alone


def test_multipliers_with_a_turning_carrier():
    """With constant stiffness they are exp(2 pi lambda / Omega) of the poles lambda except the two of the rotation,
    and stable: the centrifugal forces turn with the set."""
    Omega = 1.2
    one = hb.gears.PlanetarySet(eps_scale=0.0, carrier_rotation=True, zeta_b=0.1)
    curve = hb.trace(hb.HarmonicBalance(one, 2), "Omega", (Omega, 1.19))
    assert curve.stable.all()
    system, n = one.system(), 21
    C, K = (np.asarray(A) + B for A, B in zip((system.C, system.K), system.speed.at(Omega, n), strict=True))
    for element in system.elements:
        w = np.asarray(element.direction)
        C, K = C + element.damping * np.outer(w, w), K + element.law.reference * np.outer(w, w)
    M = np.asarray(system.M)
    poles = np.linalg.eigvals(state_matrix(M, C, K))
    poles = poles[np.abs(poles) > 1e-5]
    assert len(poles) == 40
    exact = np.exp(2 * np.pi * poles / Omega)
    distances = np.abs(exact[:, None] - curve.multipliers[0][None, :])
    assert distances.min(axis=0).max() < 1e-9 and distances.min(axis=1).max() < 1e-9


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"planets": 3}, r"planet 2 cannot be assembled at 120 degrees.* nearest position is 120.938"),
        ({"planets": 8}, r"planets 45 degrees apart collide; .* need more than"),
        ({"spacing": (0.0, 90.0, 180.0, 200.0)}, "collide"),
        ({"spacing": (0.0, 90.0)}, "2 entries; need 4"),
        ({"planet_errors": (1e-6,)}, "1 entries; need 4"),
        ({"teeth_p": 40}, "do not fit between 28 of the sun and 100 of the ring: z_r = z_s . 2 z_p = 108"),
        ({"teeth_s": 2}, "teeth_s = 2"),
        ({"planets": 0}, "planets = 0"),
        ({"fixed": "planet"}, "must be one of carrier, ring, sun|'ring' or 'sun'"),
        ({"driver": "ring"}, "cannot drive and be fixed"),
        ({"torque": -5.0}, "torque"),
        ({"k_sp": 0.0}, "k_sp"),
        ({"b_sp": 1e-300}, "b_sp = 1e-300 m must be 0 or at least 1e-15 m"),
        ({"m_s": float("nan")}, "m_s"),
        ({"alpha_s_deg": 95.0}, "alpha_s_deg"),
        ({"eps_sp": 0.2}, "eps_sp"),
        ({"carrier_rotation": 1}, "carrier_rotation"),
    ],
)
def test_bad_input(fields, said):
    with pytest.raises((ValueError, TypeError), match=said):
        hb.gears.PlanetarySet(**fields)
