"""Epicyclic sets: speeds by Willis' equation, static equilibrium, simple sets against `PlanetarySet`, assembly."""

import dataclasses
from fractions import Fraction
from math import cos, radians

import numpy as np
import pytest

import hbgear as hb

ALPHA = cos(radians(20))
Wheel, Mesh = hb.gears.Wheel, hb.gears.Mesh


def gear(name: str, teeth: int, module: float, **others) -> hb.gears.Wheel:
    radius = teeth * module / 2
    return Wheel(name, 800.0 * radius**4, 80.0 * radius**2, teeth=teeth, base_radius=radius * ALPHA, **others)


def mesh(first: str, second: str, **others) -> hb.gears.Mesh:
    return Mesh(first, second, "4e8 N/m", "20 um", **{"eps": (0.1,), "damping": 0.05} | others)


def stepped(z=(24, 30, 18, 96), planets=3, **others) -> hb.gears.EpicyclicSet:
    """Sun - large planet, small planet - ring."""
    a = 0.002 * (z[0] + z[1]) / 2
    module = 2 * a / (z[3] - z[2])
    wheels = [
        gear("sun", z[0], 0.002),
        gear("large", z[1], 0.002, x=a),
        gear("small", z[2], module, x=a),
        gear("ring", z[3], module, internal=True),
    ]
    meshes = [mesh("sun", "large"), mesh("small", "ring")]
    return hb.gears.EpicyclicSet(wheels, meshes, 0.004, planets, (("large", "small"),), **others)


def ravigneaux(**others) -> hb.gears.EpicyclicSet:
    """Small sun - short planet - long planet - ring, large sun - long planet."""
    m, z = 0.002, {"s1": 30, "s2": 36, "short": 18, "long": 18, "ring": 72}
    r = {name: m * teeth / 2 for name, teeth in z.items()}
    a_1, a_2, between = r["s1"] + r["short"], r["s2"] + r["long"], r["short"] + r["long"]
    turn = np.arccos((a_1**2 + a_2**2 - between**2) / (2 * a_1 * a_2))
    wheels = [
        gear("s1", 30, m),
        gear("s2", 36, m),
        gear("ring", 72, m, internal=True),
        gear("short", 18, m, x=a_1 * np.cos(turn), y=a_1 * np.sin(turn)),
        gear("long", 18, m, x=a_2),
    ]
    meshes = [mesh("s1", "short"), mesh("short", "long"), mesh("s2", "long"), mesh("long", "ring")]
    return hb.gears.EpicyclicSet(wheels, meshes, 0.004, 3, **others)


def test_speeds_of_stepped_planets():
    """Ring at rest: omega_s / omega_c = 1 + z_l z_r / (z_s z_p); carrier at rest: -z_l z_r / (z_s z_p)."""
    step = Fraction(30 * 96, 24 * 18)
    assert stepped().ratio == 1 + step
    assert stepped(output="ring", fixed="carrier").ratio == -step
    assert stepped(driver="ring", output="carrier", fixed="sun").ratio == 1 + 1 / step
    assert stepped(driver="carrier", output="sun").ratio == 1 / (1 + step)


@pytest.mark.parametrize(
    ("driver", "output", "fixed", "ratio"),
    [
        ("s1", "ring", "carrier", Fraction(72, 30)),  # first gear
        ("s1", "ring", "s2", (1 + Fraction(30, 36)) * Fraction(72, 30) / (1 + Fraction(72, 36))),  # second gear
        ("s2", "ring", "carrier", -Fraction(72, 36)),  # reverse
        ("carrier", "ring", "s2", 1 / (1 + Fraction(36, 72))),  # overdrive
    ],
)
def test_speeds_of_ravigneaux(driver, output, fixed, ratio):
    """Willis: (omega_s1 - omega_c) z_s1 = (omega_r - omega_c) z_r = -(omega_s2 - omega_c) z_s2."""
    found = ravigneaux(driver=driver, output=output, fixed=fixed)
    assert found.ratio == ratio
    w = found.speeds
    relative = {name: (w[name] - w["carrier"]) * z for name, z in (("s1", 30), ("ring", 72), ("s2", -36))}
    assert len(set(relative.values())) == 1
    T = found.torques
    assert sum(T.values()) == pytest.approx(0.0, abs=1e-9)
    assert sum(T[name] * float(w[name]) for name in T) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("fixed", ["ring", "carrier", "sun"])
def test_static_forces(fixed):
    """Constant stiffness at rest: every mesh of a kind carries T / (N r), by equilibrium of each wheel."""
    roles = {"ring": ("sun", "carrier"), "carrier": ("sun", "ring"), "sun": ("ring", "carrier")}[fixed]
    one = stepped(driver=roles[0], output=roles[1], fixed=fixed, eps_scale=0.0)
    problem = hb.HarmonicBalance(one, 2)
    X = problem.start(Omega=0.4)
    force = problem.force_rows(X, Omega=0.4)[:, 0] * one.scales.force
    radius = {wheel.name: wheel.base_radius for wheel in one.wheels}
    sun = abs(one.torques.get("sun", 0.0)) / (3 * radius["sun"])
    expected = {"sun-large": sun, "small-ring": sun * radius["large"] / radius["small"]}
    assert expected["small-ring"] == pytest.approx(abs(one.torques["ring"]) / (3 * radius["ring"]), rel=1e-9)
    kinds = [sorted([name.rstrip("123") for name in m.name.split("-")]) for m in one.train.meshes]
    for kind, value in zip(kinds, np.abs(force), strict=True):
        assert value == pytest.approx(expected["sun-large" if "sun" in kind else "small-ring"], rel=1e-6)


@pytest.mark.parametrize("roles", [("s1", "ring", "carrier"), ("s1", "ring", "s2"), ("carrier", "ring", "s2")])
def test_torques_of_meshes(roles):
    """The force of a mesh is a third of the torque of its central gear over the radius; planets have no torque."""
    driver, output, fixed = roles
    one = ravigneaux(driver=driver, output=output, fixed=fixed, torque_scale=2.0)
    T = {name: abs(torque) / 2.0 / 3 for name, torque in one.torques.items()}
    loaded = {
        "s1-short": T.get("s1", 0.0),
        "short-long": T.get("s1", 0.0) * 18 / 30,
        "s2-long": T.get("s2", 0.0),
        "long-ring": T.get("ring", 0.0) * 18 / 72,
    }
    assert one.mesh_torques == pytest.approx(loaded, rel=1e-9, abs=1e-9)
    for fixed in ("ring", "sun", "carrier"):
        driver = "sun" if fixed != "sun" else "ring"
        one = stepped(driver=driver, output="carrier" if fixed != "carrier" else "ring", fixed=fixed)
        torque = {name: abs(torque) / 3 for name, torque in one.torques.items()}
        expected = {"sun-large": torque.get("sun", 0.0), "small-ring": torque.get("ring", 0.0) * 18 / 96}
        assert one.mesh_torques == pytest.approx(expected, rel=1e-9)


def simple(fixed="ring", driver="sun", output="carrier", planets=4):
    """The machine of Lin and Parker, with its base radii, as a set with rotation only."""
    scale, alpha = 38.7e-3 / 28, cos(radians(24.6))
    radii = {name: scale * z for name, z in (("sun", 28), ("p", 36), ("ring", 100))}
    J = {"sun": 0.39, "p": 0.61, "ring": 3.0}
    a = scale * 64 / alpha
    mass = {"sun": 0.4, "p": 0.66, "ring": 2.35}
    teeth = {"sun": 28, "p": 36, "ring": 100}
    wheels = [
        Wheel(
            name,
            J[name] * radii[name] ** 2,
            mass[name],
            teeth=z,
            base_radius=radii[name],
            internal=name == "ring",
            x=a * (name == "p"),
        )
        for name, z in teeth.items()
    ]
    meshes = [Mesh(*names, 5e8, 20e-6, eps=(0.2, 0.05), damping=0.03) for names in (("sun", "p"), ("p", "ring"))]
    return hb.gears.EpicyclicSet(
        wheels, meshes, 6.29 * a**2, planets, driver=driver, output=output, fixed=fixed, torque=300.0
    )


@pytest.mark.parametrize(
    ("fixed", "driver", "output"),
    [("ring", "sun", "carrier"), ("ring", "carrier", "sun"), ("sun", "ring", "carrier"), ("carrier", "sun", "ring")],
)
def test_simple_sets_are_planetary_sets(fixed, driver, output):
    """Speeds, orders, phases, and with stiff bearings the rotational natural frequencies."""
    own, other = simple(fixed, driver, output), hb.gears.PlanetarySet(fixed=fixed, driver=driver)
    sense = 1 if driver != "carrier" else -1
    assert all(own.speeds[name] == sense * other.speeds[name] for name in ("sun", "ring", "carrier"))
    assert own.scales.teeth == pytest.approx(other.scales.teeth)
    lags = {name: [x for key, x in some.items() if name in key] for some in (own.lags,) for name in ("sun", "ring")}
    expected = [*other.lags.values()]
    for i, name in enumerate(("sun", "ring")):
        difference = (np.array(lags[name]) - expected[4 * i : 4 * i + 4]) / (2 * np.pi)
        difference -= (lags["sun"][0] - expected[0]) / (2 * np.pi)
        np.testing.assert_allclose((difference + 0.5) % 1.0 - 0.5, 0.0, atol=1e-6)
    stiff = other.replace(k_s=1e13, k_r=1e13, k_c=1e13, k_p=1e13, k_t=1e13)
    modes = sorted(mode.frequency for mode in stiff.modes() for _ in range(mode.multiplicity))
    own_frequencies = own.natural_frequencies
    mass = own.structure()[0][-1] if fixed != "carrier" else 0.0
    assert mass == 0.0 or mass > own.carrier_inertia  # the planets circle with the carrier
    np.testing.assert_allclose(own_frequencies[1:], modes[1 : len(own_frequencies)], rtol=2e-3)


@pytest.mark.parametrize("orders", [(), {"175/16": ("60 N m", "20 deg"), "175/24": "30 N m"}])
def test_motion_is_that_of_the_planetary_set_with_stiff_bearings(orders):
    """The mesh has 28 x 100 / 128 = 175 / 8 periods in a turn of the sun: orders of 1/2 and 1/3 of its frequency."""
    own = simple().replace(torque_orders=orders)
    other = hb.gears.PlanetarySet(zeta_b=0.0, k_s=1e13, k_r=1e13, k_c=1e13, k_p=1e13, k_t=1e13, torque_orders=orders)
    Omega = 0.9 / other.mesh_order
    assert own.common_order == other.mesh_order == (6 if orders else 1)
    assert own.orders["sun"] == pytest.approx(other.orders["sun"])
    assert own.scales.pinion_speed(1.0) / own.scales.frequency == pytest.approx(
        other.scales.pinion_speed(1.0) / other.scales.frequency
    )
    found = []
    for model in (own, other):
        at = Omega * other.scales.frequency / model.scales.frequency
        problem = hb.HarmonicBalance(model, 6 * other.mesh_order)
        rows = problem.force_rows(problem.start(Omega=at), Omega=at) * model.scales.force
        found.append([sorted(np.hypot(rows[:, 2 * n - 1], rows[:, 2 * n]).tolist()) for n in (2, 3, 6)])
    if orders:
        assert np.min(found) > 10.0  # N
    np.testing.assert_allclose(found[0], found[1], rtol=2e-3, atol=1e-6)


@pytest.mark.slow
def test_drawn_helical_planets():
    """Meshes resolved into pairs of teeth of helical gears; torques on the pinions from the static equilibrium."""
    sun, planet = (hb.gears.Gear(z, "2 mm", "20 mm", helix_angle=f"{h} deg") for z, h in ((24, 15), (30, -15)))
    ring = hb.gears.Gear(84, "2 mm", "20 mm", helix_angle="-15 deg", internal=True)
    pairs = hb.GearPair(sun, planet, "60 um"), hb.GearPair(planet, ring, "60 um")
    x = pairs[0].working_center_distance
    wheels = [Wheel.of("sun", sun), Wheel.of("planet", planet, x=x), Wheel.of("ring", ring)]
    meshes = [Mesh.of("sun", "planet", pairs[0], 100 / 3), Mesh.of("planet", "ring", pairs[1], 100 / 3 * 30 / 24)]
    one = hb.gears.EpicyclicSet(wheels, meshes, 0.01, 3)
    assert one.ratio == 1 + Fraction(84, 24)
    problem = hb.HarmonicBalance(one, 2)
    force = problem.force_rows(problem.start(Omega=0.3), Omega=0.3)[:, 0] * one.scales.force
    normal = np.cos(sun.base_helix_angle)
    np.testing.assert_allclose(np.abs(force) * normal, 100 / 3 / pairs[0].base_radii[0], rtol=1e-6)


def test_meshes_that_run_backwards():
    """With the ring as driver the planet drives the sun: the phases of its contacts run the other way."""
    one = simple("sun", "ring", "carrier")
    assert one.train.meshes[0].first == "p1" and one.train.meshes[1].first == "ring"
    error = hb.mechanics.Periodic((0.0, 1.0), ((0.0, 1e-6), (1e-6, -1e-6 / (2 * np.pi - 1))))
    skewed = dataclasses.replace(one.meshes[0], error=error)
    turned = one.replace(meshes=(skewed, one.meshes[1])).train.meshes[0].error
    assert float(turned(2 * np.pi - 0.5)) == pytest.approx(0.5e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: stepped(planets=5), "5 equal planets cannot be assembled at equal distances"),
        (lambda: stepped(driver="hub"), "there is no member 'hub'; give one of sun, ring, carrier"),
        (lambda: stepped(driver="ring"), "must be different members"),
        (lambda: stepped(torque=-1.0), "torque"),
        (lambda: stepped().replace(bodies=(("large", "sun"),)), "'sun' is no gear of a planet"),
        (
            lambda: stepped().replace(wheels=[dataclasses.replace(w, torque=3.0) for w in stepped().wheels]),
            "must be a gear with moves='torsion' and without torque",
        ),
        (lambda: simple(planets=5), "5 equal planets cannot be assembled"),
    ],
)
def test_sets_that_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("planets", [2, 3, 4, 5, 6])
def test_stepped_planets_assemble_by_the_rule(planets):
    """(z_r + z_s z_b / z_a) / N = k gcd(z_a, z_b) / z_a, k whole: a planet is turned by whole teeth of one gear."""
    z_s, z_a, z_b, z_r = 24, 40, 16, 96
    pitches = Fraction(z_r * z_a + z_s * z_b, z_a * planets)
    fits = (pitches * Fraction(z_a, np.gcd(z_a, z_b).item())).denominator == 1
    assert fits == (planets in (2, 3, 4, 6))
    if fits:
        assert stepped((z_s, z_a, z_b, z_r), planets).planets == planets
    else:
        with pytest.raises(ValueError, match="cannot be assembled"):
            stepped((z_s, z_a, z_b, z_r), planets)


def test_simple_planets_assemble_by_the_rule():
    """(z_s + z_r) / N is whole: 128 teeth for 2, 4 planets and not for 3."""
    assert [simple(planets=n).planets for n in (2, 4)] == [2, 4]
    with pytest.raises(ValueError, match="cannot be assembled"):
        simple(planets=3)


def test_mesh_frequency_of_stepped_planets_is_that_of_the_teeth_of_the_sun():
    """f = z_sun (n_sun - n_carrier) / 60: the meshes of large and small planets have different frequencies."""
    gears = [
        hb.gears.Wheel("sun", 1e-4, teeth=24, base_radius="22.5526 mm"),
        hb.gears.Wheel("large", 2e-4, 0.5, teeth=30, base_radius="28.1908 mm", x="54 mm"),
        hb.gears.Wheel("small", 1e-4, 0.3, teeth=18, base_radius="11.7099 mm", x="54 mm"),
        hb.gears.Wheel("ring", 1e-2, teeth=96, base_radius="62.4533 mm", internal=True),
    ]
    meshes = [hb.gears.Mesh("sun", "large", 4e8, 4e-5), hb.gears.Mesh("small", "ring", 4e8, 4e-5)]
    stepped = hb.gears.EpicyclicSet(
        gears, meshes, 0.004, planets=3, bodies=(("large", "small"),), driver="sun", output="carrier", fixed="ring"
    )
    n = stepped.scales.pinion_speed(0.7)
    ratio = 1 + 96 / 18 * 30 / 24  # of the sun to the carrier, by Willis' equation
    assert stepped.scales.mesh_frequency(0.7) == pytest.approx(24 * (n - n / ratio) / 60, rel=1e-12)
    assert stepped.orders["sun-large"] * stepped.default_span[0] == pytest.approx(1.5, rel=1e-12)
