"""Trains against models written by hand, closed forms and integration in time."""

import dataclasses
from math import cos, pi, radians, sin, tan

import numpy as np
import pytest
from machines import gear_pair

import hbgear as hb
from hbgear.gears.trains.train import in_order
from hbgear.mechanics.series.fourier import evaluate
from hbgear.time.integration import state_of


def double_helical(pair, **kwargs):
    """The marine pair put together from wheels, shafts, bearings and meshes."""
    wheels, bearings = [], []
    distance = (pair.r_p + pair.r_g) / cos(pair.alpha_t)
    for name in ("pL", "gL", "pR", "gR"):
        gear = name[0]
        inertia = getattr(pair, f"I_{gear}")
        x = distance if gear == "g" else 0.0
        wheels.append(
            hb.gears.Wheel(
                name,
                inertia,
                getattr(pair, f"m_{gear}"),
                tilt_inertia=inertia,
                teeth=getattr(pair, f"teeth_{gear}"),
                base_radius=getattr(pair, f"r_{gear}"),
                x=x,
                moves="space",
                torque=pair.torque if gear == "p" else 0.0,
            )
        )
        k = {axis: getattr(pair, f"k_{gear}{axis}") for axis in ("x", "y", "z", "thx", "thy")}
        c = {f"c_{axis}": getattr(pair, f"c_{gear}{axis}") for axis in "xyz"}
        bearings.append(hb.gears.Bearing(name, k["x"], k["y"], k["z"], k["thx"], k["thy"], damping=pair.zeta, **c))
    wheels[1] = hb.gears.Wheel(**{**vars(wheels[1]), "torque": pair.torque * pair.r_g / pair.r_p})
    shafts = [
        hb.gears.Shaft.section(
            f"{g}L",
            f"{g}R",
            getattr(pair, f"outer_{g}"),
            pair.shaft_length,
            getattr(pair, f"inner_{g}"),
            pair.E,
            pair.poisson,
            pair.zeta,
        )
        for g in "pg"
    ]
    error = hb.mechanics.Series(sine=tuple(-x * pair.b_c for x in pair.e))
    meshes = [
        hb.gears.Mesh(
            f"p{half}",
            f"g{half}",
            pair.k_mean,
            pair.b_c,
            eps=pair.eps,
            error=error,
            damping=pair.zeta,
            helix_angle=-hand * pair.beta_mesh,
        )
        for half, hand in (("L", 1), ("R", -1))
    ]
    return hb.gears.Train(wheels, meshes, shafts, bearings, balance="gR", **kwargs)


def with_published_arms(train, pair):
    """The equations of the train with the arms of the axial forces of the paper: to the base circles, where the line of
    action touches them. A train has the arms to the pitch point; all other entries are equal.

    The paper counts the rotations of the wheels the other way."""
    signs, forces = np.ones((4, 6)), [0, 1, 2, 5]
    signs[1::2, 3:] = -1.0
    elements = []
    for gap, published in zip(train.system().elements, pair.system().elements, strict=True):
        found, w = np.reshape(gap.direction, (4, 6)), signs * np.reshape(published.direction, (4, 6))
        np.testing.assert_allclose(found[:, forces], w[:, forces], rtol=0, atol=1e-12)
        assert np.abs(found - w).max() > 0.01
        elements.append(dataclasses.replace(gap, direction=w.ravel()))
    return dataclasses.replace(train.system(), elements=elements)


def test_the_marine_pair_is_the_model_written_by_hand(rng):
    pair = hb.gears.DoubleHelicalPair(zeta=0.05)
    train = double_helical(pair)
    assert train.omega_n == pytest.approx(pair.omega_n, rel=1e-12)
    assert train.lags == pytest.approx({"pL-gL": 0.0, "pR-gR": 0.0}, abs=1e-12)
    by_hand, built = hb.HarmonicBalance(pair, 12), hb.HarmonicBalance(with_published_arms(train, pair), 12)
    for Omega in (0.31, 0.77, 1.4):
        X = rng.standard_normal(by_hand.size)
        for a, b in zip(by_hand.evaluate(X, Omega=Omega), built.evaluate(X, Omega=Omega), strict=True):
            np.testing.assert_allclose(b, a, rtol=0, atol=1e-9 * np.abs(a).max())
    assert train.reactions.keys() == pair.reactions.keys()
    for name, force in train.reactions.items():
        for what in ("stiffness", "damping"):
            expected = getattr(pair.reactions[name], what)
            np.testing.assert_allclose(getattr(force, what), expected, atol=1e-9 * expected.max())
    X = by_hand.start(Omega=1.2)
    np.testing.assert_allclose(built.start(Omega=1.2), X, atol=1e-9)
    here = [problem.multipliers(X, Omega=1.2)[0] for problem in (by_hand, built)]
    assert abs(here[1]) == pytest.approx(abs(here[0]), rel=1e-8)


def test_folds_of_the_marine_pair():
    pair = hb.gears.DoubleHelicalPair(zeta=0.05)
    train = with_published_arms(double_helical(pair), pair)
    curves = [hb.trace(hb.HarmonicBalance(model, 12), "Omega", (1.0, 0.8)) for model in (pair, train)]
    folds = [[p.parameters["Omega"] for p in curve.special if p.kind == "LP"] for curve in curves]
    assert len(folds[0]) == 2
    np.testing.assert_allclose(folds[1], folds[0], rtol=1e-9)


def spur(**kwargs):
    pair = gear_pair()
    wheels = [hb.gears.Wheel.of("pinion", pair.pinion, torque="200 N m"), hb.gears.Wheel.of("wheel", pair.wheel)]
    return pair, hb.gears.Train(
        wheels, [hb.gears.Mesh.of("pinion", "wheel", pair, "200 N m", 0.04)], balance="wheel", **kwargs
    )


def test_a_pair_that_only_turns_is_the_model_of_its_drawing():
    pair, train = spur()
    drawn = pair.model("200 N m", 0.04)
    X = [hb.HarmonicBalance(model, 12).start(Omega=0.9) for model in (drawn, train)]
    # the same motion, begun where the flanks come into contact or where they pass the pitch point
    a, b = (x[1::2] - 1j * x[2::2] for x in X)
    np.testing.assert_allclose(np.abs(b), np.abs(a), atol=1e-10)
    assert X[1][0] == pytest.approx(X[0][0], abs=1e-10)
    assert train.scales == drawn.scales


def idler(places, teeth=(25, 30, 40), driver="in", turn=1.0, **kwargs):
    """Three gears in mesh, the torque through the middle one; places are directions from the idler [rad]."""
    module, alpha = 3e-3, radians(20)
    r = [module * z / 2 for z in teeth]
    at = [(0.0, 0.0)] * 3
    for i, direction in zip((0, 2), places, strict=True):
        at[i] = ((r[i] + r[1]) * cos(direction), (r[i] + r[1]) * sin(direction))
    wheels = [
        hb.gears.Wheel(
            name,
            1e-3 * z / 25,
            1.0,
            teeth=z,
            base_radius=x * cos(alpha),
            x=at[i][0],
            y=at[i][1],
            torque=turn * 100.0 if name == driver else 0.0,
        )
        for i, (name, z, x) in enumerate(zip(("in", "idler", "out"), teeth, r, strict=True))
    ]
    meshes = [hb.gears.Mesh(a, b, 4e8, 4e-5, eps=(0.2,)) for a, b in (("in", "idler"), ("idler", "out"))]
    return hb.gears.Train(wheels, meshes, balance="out", **kwargs)


def flanks(teeth, turned, side):
    """Angles of all flanks of a gear that face one side, teeth half a pitch thick."""
    return turned + 2 * pi * np.arange(teeth) / teeth + side * pi / (2 * teeth)


@pytest.mark.parametrize("teeth", [(25, 30, 40), (24, 31, 40), (25, 31, 19)])
@pytest.mark.parametrize("place", [0.0, 0.7, -1.3])
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_phase_of_an_idler_by_turning_its_teeth(teeth, place, turn):
    """The idler is turned until a flank that carries load passes each of its pitch points."""
    train = idler((pi, place), teeth, turn=turn)
    z, sense = teeth[1], -turn  # the idler turns against the first gear; its trailing flank is pushed
    passing = []
    for direction, side in ((pi, -sense), (place, sense)):
        behind = (sense * (direction - flanks(z, 0.0, side))) % (2 * pi)  # way of each flank to the pitch point
        passing.append(behind.min() * z)
    expected = (passing[1] - passing[0]) % (2 * pi)
    difference = (train.lags["idler-out"] - expected + pi) % (2 * pi) - pi
    assert difference == pytest.approx(0.0, abs=1e-9)


def star(angle, teeth=(28, 36, 100), **kwargs):
    """A pinion, two idlers at 0 and an angle [deg], and a ring, all with fixed axes."""
    distance = 1.5e-3 * (teeth[0] + teeth[1])
    places = {"a": 0.0, "b": radians(angle)}
    wheels = [gear("sun", teeth[0], torque=1.0, x=0.1, y=-0.2), gear("ring", teeth[2], internal=True, x=0.1, y=-0.2)]
    wheels += [
        gear(name, teeth[1], x=0.1 + distance * cos(psi), y=-0.2 + distance * sin(psi)) for name, psi in places.items()
    ]
    meshes = [hb.gears.Mesh(*ends, 4e8) for ends in (("sun", "a"), ("a", "ring"), ("sun", "b"))]
    return hb.gears.Train(wheels, [*meshes, hb.gears.Mesh("b", "ring", 4e8, **kwargs)], balance="ring")


@pytest.mark.parametrize("teeth", [(28, 36, 100), (30, 20, 70), (21, 22, 65)])
def test_wheels_in_a_loop_are_assembled_where_their_teeth_match(teeth):
    """The angle between two idlers is a multiple of 360 / (z_s + z_r) degrees; the message names the nearest one."""
    pitch = 360 / (teeth[0] + teeth[2])
    step = round(120 / pitch)
    for angle in (step * pitch, 180.0 + pitch * ((teeth[0] + teeth[2]) % 2) / 2):
        star(angle, teeth)
    star((step + 0.015) * pitch, teeth)  # rounded
    for part in (0.03, 0.2, -0.4):
        with pytest.raises(ValueError, match="closes a loop") as error:
            star((step + part) * pitch, teeth)
        assert f"teeth are {abs(part):.3g} pitches apart" in str(error.value)
        assert f"place 'b' at {step * pitch:.6g} degrees about 'sun'" in str(error.value)
    star((step + 0.4) * pitch, teeth, lag=0.3)  # the user knows better


@pytest.mark.parametrize("x", [0.4, -0.3])
def test_phases_of_shifted_gears(x):
    """Shifts x of an idler and -x of its mates: the teeth of the idler have the thickness m (pi/2 + 2 x tan alpha) on
    the reference circle, on which all gears roll. The loaded flanks of planets are as far apart."""
    z, thick = 31, 0.5 + 2 * x * tan(radians(20)) / pi
    one, idler, ring = (
        hb.gears.Gear(teeth, "3 mm", "20 mm", profile_shift=shift, internal=teeth > 50)
        for teeth, shift in ((40, -x), (z, x), (102, -x))
    )
    pairs = hb.GearPair(one, idler, "80 um"), hb.GearPair(idler, one, "80 um")
    distance = pairs[0].working_center_distance
    assert distance == pytest.approx(3e-3 * (40 + z) / 2, rel=1e-12)
    places = {"in": (one, 0.0), "idler": (idler, distance), "out": (one, 2 * distance)}
    wheels = [hb.gears.Wheel.of(name, gear, x=at, torque=100.0 * (name == "in")) for name, (gear, at) in places.items()]
    meshes = [hb.gears.Mesh.of("in", "idler", pairs[0], 100.0), hb.gears.Mesh.of("idler", "out", pairs[1], 77.5)]
    train = hb.gears.Train(wheels, meshes, balance="out")
    turned = z / 2 - thick  # pitches by which the idler turns between the pitch points of the same tooth
    pitch = [mesh.pitch_phase / (2 * pi) for mesh in meshes]
    assert np.exp(1j * train.lags["idler-out"]) == pytest.approx(np.exp(2j * pi * (pitch[0] - pitch[1] + turned)))
    planetary = hb.gears.PlanetarySet.of(pairs[0], hb.GearPair(idler, ring, "80 um"), 300.0, planets=2)
    assert np.exp(1j * planetary.lags["ring-p1"]) == pytest.approx(np.exp(2j * pi * turned))
    backward = planetary.replace(driver="carrier")
    assert np.exp(1j * backward.lags["ring-p1"]) == pytest.approx(np.exp(-2j * pi * turned))


@pytest.mark.parametrize("drawn", [True, False])
def test_a_mesh_whose_second_wheel_drives_runs_backwards(drawn):
    """The idler drives a smaller gear, whose mesh is given with the pinion first and with the driver first."""
    gears = [hb.gears.Gear(z, "3 mm", "20 mm", tip_relief=f"{relief} um") for z, relief in ((25, 10), (30, 0), (19, 8))]
    pairs = hb.GearPair(*gears[:2], "80 um"), hb.GearPair(*gears[1:], "80 um"), hb.GearPair(*gears[:0:-1], "80 um")
    wheels = [
        hb.gears.Wheel.of(name, gear, x=x, torque=100.0 * (name == "in"))
        for name, gear, x in zip(("in", "idler", "out"), gears, (0.0, 82.5e-3, 156e-3), strict=True)
    ]
    first = hb.gears.Mesh.of("in", "idler", pairs[0], 100.0)
    drives = hb.gears.Mesh.of("idler", "out", pairs[1], 120.0)
    driven = hb.gears.Mesh.of("out", "idler", pairs[2], 76.0)
    if not drawn:
        functions = {"contacts": None, "eps": (0.2, 0.1), "e": (2e-6, 1e-6), "torque": None}
        lags = {"eps_lag": (0.5, 1.5), "e_lag": (2.0, -1.0)}
        drives = dataclasses.replace(drives, **functions, **lags)
        lags = {name: tuple(-x for x in lag) for name, lag in lags.items()}
        driven = dataclasses.replace(driven, **functions, **lags, pitch_phase=-drives.pitch_phase)
    X, rows = 0.2 * np.random.default_rng(1).normal(size=(2, 13)), []
    X[:, 0] = 1.3
    for second in (drives, driven):
        train = hb.gears.Train(wheels, [first, second], balance="out")
        rows.append(hb.HarmonicBalance(train, 6).evaluate(X.ravel(), Omega=0.7)[0])
    np.testing.assert_allclose(rows[0], rows[1], rtol=0, atol=1e-5 * np.abs(rows[0]).max())


def helical(teeth, width, sign):
    return hb.gears.Gear(teeth, "3 mm", width, helix_angle=sign * radians(20))


def test_pitch_point_of_helical_teeth_is_in_the_middle_of_the_face():
    """The contact of equal gears is symmetric in time about this phase. Gears of other widths have the same middle: the
    mesh of an idler with a narrower gear begins later, by half the difference of the overlap ratios."""
    equal = hb.GearPair(helical(30, "20 mm", 1), helical(30, "20 mm", -1), "80 um")
    mesh, tau = hb.gears.Mesh.of("a", "b", equal, 100.0), 2 * pi * (np.arange(50) + 0.37) / 50
    later, earlier = (
        mesh.contacts.force(np.full(50, 2e-5), 0 * tau, mesh.pitch_phase + side * tau)[0] for side in (1, -1)
    )
    np.testing.assert_allclose(later, earlier, rtol=2e-3)
    assert np.ptp(later) > 0.02 * later.mean()
    lags, overlaps = [], []
    for widths in (("20 mm", "40 mm", "40 mm"), ("40 mm", "40 mm", "20 mm"), ("40 mm",) * 3):
        gears = [helical(z, b, sign) for z, b, sign in zip((25, 30, 40), widths, (1, -1, 1), strict=True)]
        pairs = hb.GearPair(*gears[:2], "80 um"), hb.GearPair(*gears[1:], "80 um")
        places = np.cumsum([0.0, *(pair.working_center_distance for pair in pairs)])
        wheels = [
            hb.gears.Wheel.of(name, gear, x=x, torque=100.0 * (name == "in"))
            for name, gear, x in zip(("in", "idler", "out"), gears, places, strict=True)
        ]
        meshes = [hb.gears.Mesh.of("in", "idler", pairs[0], 100.0), hb.gears.Mesh.of("idler", "out", pairs[1], 120.0)]
        lags.append(hb.gears.Train(wheels, meshes, balance="out").lags["idler-out"] / (2 * pi))
        overlaps.append(pairs[0].overlap_ratio - pairs[1].overlap_ratio)
    expected = lags[2] + np.array(overlaps) / 2
    np.testing.assert_allclose(np.exp(2j * pi * np.array(lags)), np.exp(2j * pi * expected), atol=1e-9)


def test_statics_and_mirror_of_an_idler():
    """Forces of a triangle of gears, all of which move in the plane: torques pass through, bearings carry the rest."""
    train = idler((pi, 0.9))
    moving = [hb.gears.Wheel(**{**vars(w), "moves": "plane"}) for w in train.wheels]
    bearings = [hb.gears.Bearing(w.name, 1e8, 1e8) for w in moving]
    held = hb.gears.Train(moving, train.meshes, bearings=bearings, balance="out")
    still = held.replace(eps_scale=0.0)
    problem = hb.HarmonicBalance(still, 2)
    X = problem.start(Omega=0.5)
    force = problem.force_rows(X, Omega=0.5)[:, 0] * held.k_mean * held.b_c
    np.testing.assert_allclose(force, 2 * [100.0 / train.wheels[0].base_radius], rtol=1e-9)
    q = problem.motion(X, Omega=0.5)[:, 0] * held.units
    pull = 1e8 * np.array([q[problem.dof_names.index(f"{axis}_idler")] for axis in "xy"])
    alpha, F = radians(20), force[0]
    # the idler turns clockwise: the first gear pushes it by the line of action at its pitch point, the last one back
    first = F * np.array([sin(alpha), cos(alpha)])
    to = np.array([sin(alpha), -cos(alpha)])
    turned = np.array([[cos(0.9), -sin(0.9)], [sin(0.9), cos(0.9)]]) @ to
    np.testing.assert_allclose(pull, first - F * turned, atol=1e-6 * F)
    mirrored = idler((pi, -0.9), turn=-1.0)
    assert mirrored.lags["idler-out"] == pytest.approx(train.lags["idler-out"], abs=1e-9)


def two_stages(**kwargs):
    """40/80 and 20/60: the second stage meshes at half the frequency of the first."""
    alpha, r = radians(20), {z: 3e-3 * z / 2 for z in (40, 80, 20, 60)}
    wheels = [hb.gears.Wheel(f"z{z}", 4e-4 * (z / 20) ** 2, teeth=z, base_radius=x * cos(alpha)) for z, x in r.items()]
    wheels[0] = hb.gears.Wheel(**{**vars(wheels[0]), "torque": 100.0})
    meshes = [
        hb.gears.Mesh("z40", "z80", 4e8, 4e-5, eps=(0.2, 0.05)),
        hb.gears.Mesh("z20", "z60", 3e8, 3e-5, eps=(0.25,)),
    ]
    return hb.gears.Train(wheels, meshes, [hb.gears.Shaft("z80", "z20", 2e5)], balance="z60", **kwargs)


@pytest.mark.slow
def test_two_stages_with_commensurate_frequencies():
    train = two_stages()
    assert train.orders["z40-z80"] == 4 and train.orders["z20-z60"] == 1
    assert train.orders["z40"] == pytest.approx(4 / 40) and train.orders["z60"] == pytest.approx(1 / 60)
    problem = hb.HarmonicBalance(train, 24)
    curve = hb.trace(problem, "Omega", (0.18, 0.3))
    assert curve.status.complete
    for i in (0, len(curve) // 2, -1):
        Omega = float(curve.values[i])
        orbit = hb.time.shoot(train, Omega, state_of(problem, curve.X[i], Omega=Omega))
        motion = hb.time.integrate(train, orbit.state, 1, Omega)
        d = evaluate(curve.X[i].reshape(2, -1), motion.tau)
        np.testing.assert_allclose(d, motion.d, atol=30 * curve.error[i] + 1e-8)


def test_gyroscopic_wheels_and_bearings_over_speed():
    """A table that does not vary is the bearing of that number; wheels have gyroscopic terms by their own speeds."""
    _, train = spur()
    speeds = [10.0, 5000.0]
    wheels = [
        hb.gears.Wheel(**{**vars(w), "moves": "space", "x": x}) for w, x in zip(train.wheels, (0, 0.0975), strict=True)
    ]
    table = hb.mechanics.MatrixTable(speeds, [2e8 * np.eye(2)] * 2)
    damper = hb.mechanics.MatrixTable(speeds, [4e3 * np.eye(2)] * 2)
    rest = {"z": 1e8, "tilt_x": 1e5, "tilt_y": 1e5}
    by_table = [hb.gears.Bearing(w.name, **rest, table=table, damping_table=damper) for w in wheels]
    plain = [hb.gears.Bearing(w.name, 2e8, 2e8, **rest, c_x=4e3, c_y=4e3) for w in wheels]
    spinning, constant = (
        hb.gears.Train(wheels, train.meshes, bearings=bearings, balance="wheel") for bearings in (by_table, plain)
    )
    X = [hb.HarmonicBalance(model, 8).start(Omega=0.8) for model in (spinning, constant)]
    np.testing.assert_allclose(X[0], X[1], atol=1e-9)
    fast = hb.gears.Train(wheels, train.meshes, bearings=plain, balance="wheel", gyroscopic=True)
    G = fast.system().speed.gyroscopic * 1.0
    i, j = (fast.system().dof_names.index(f"theta_{axis}_pinion") for axis in "xy")
    expected = wheels[0].inertia / 25 / fast.m_c / wheels[0].base_radius ** 2
    assert G[i, j] == pytest.approx(expected, rel=1e-12) and G[j, i] == -G[i, j]
    i, j = (fast.system().dof_names.index(f"theta_{axis}_wheel") for axis in "xy")
    assert G[i, j] < 0  # it turns the other way
    spread = hb.analysis.campbell(fast, (0.05, 2.0), points=5).frequencies
    assert np.ptp(spread, axis=0).max() > 1e-4


def test_functions_in_an_order():
    tau = np.linspace(0, 2 * pi, 50)
    smooth, pieces = hb.mechanics.Series(1.0, (0.2, 0.1), (0.3,)), hb.mechanics.Periodic.trapezoidal(1.2, 0.8, 0.3, 0.1)
    for function in (smooth, pieces):
        np.testing.assert_allclose(in_order(function, 3, 0.4)(tau), function(3 * tau - 0.4), atol=1e-12)


def ring(sun=20, outer=60):
    """A gear inside a ring that is driven by it."""
    alpha, m = radians(20), 3e-3
    gears = [
        hb.gears.Wheel("sun", 1e-3, teeth=sun, base_radius=m * sun / 2 * cos(alpha), torque=50.0),
        hb.gears.Wheel(
            "ring", 1e-1, teeth=outer, base_radius=m * outer / 2 * cos(alpha), internal=True, x=m * (outer - sun) / 2
        ),
    ]
    return hb.gears.Train(gears, [hb.gears.Mesh("sun", "ring", 4e8, 4e-5, eps=(0.2,))], balance="ring")


def test_a_ring_turns_the_same_way():
    train = ring()
    assert train._kinematics.speeds["ring"] == pytest.approx(1 / 3)
    assert train.torques["ring"] == pytest.approx(-150.0)
    problem = hb.HarmonicBalance(train, 8)
    force = problem.force_rows(problem.start(Omega=1.4), Omega=1.4)[0, 0] * train.k_mean * train.b_c
    assert force > 0


def gear(name, teeth=20, **kwargs):
    return hb.gears.Wheel(name, 1e-3, teeth=teeth, base_radius=1.4e-3 * teeth, **kwargs)


def spur_pair():
    return hb.GearPair(*(hb.gears.Gear(z, "3 mm", "20 mm") for z in (25, 40)), backlash="80 um")


MESH = hb.gears.Mesh("a", "b", 4e8, 4e-5, eps=(0.1,))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: hb.gears.Train([gear("a"), gear("b")], []), "at least one Mesh"),
        (lambda: hb.gears.Train([gear("a"), gear("a")], [MESH]), "two wheels have the name 'a'"),
        (lambda: hb.gears.Train([gear("a"), gear("c")], [MESH]), "there is no wheel 'b'"),
        (
            lambda: hb.gears.Train([gear("a"), gear("b")], [MESH], [hb.gears.Shaft("a", "shaft", 1e5)]),
            "no wheel 'shaft'",
        ),
        (lambda: hb.gears.Train([gear("a", torque=10.0), gear("b", torque=5.0)], [MESH]), "torques do not balance"),
        (lambda: hb.gears.Train([gear("a", torque=10.0), gear("b", torque=5.0)], [MESH], balance="b"), "keep one"),
        (lambda: hb.gears.Train([gear("a"), gear("b", x=0.05)], [MESH]), "collide"),
        (
            lambda: hb.gears.Train([gear("a"), hb.gears.Wheel("b", 1e-3, teeth=21, base_radius=0.02)], [MESH]),
            "ratio of the teeth",
        ),
        (lambda: hb.gears.Train([gear("a"), hb.gears.Wheel("b", 1e-3)], [MESH]), "'b' has no teeth"),
        (lambda: hb.gears.Train([gear("a"), gear("b", held=True)], [MESH]), "PlanetarySet"),
        (
            lambda: hb.gears.Train(
                [gear("a"), gear("b"), gear("c")],
                [MESH, hb.gears.Mesh("b", "c", 1e8, 1e-5), hb.gears.Mesh("c", "a", 1e8, 1e-5)],
            ),
            "locked",
        ),
        (
            lambda: hb.gears.Train(
                [gear("a"), gear("b"), gear("c"), gear("d")], [MESH, hb.gears.Mesh("c", "d", 1e8, 1e-5)]
            ),
            "does not turn with the first",
        ),
        (lambda: hb.gears.Train([gear("a", internal=True), gear("b", internal=True)], [MESH]), "two rings"),
        (lambda: hb.gears.Train([gear("a", 30), gear("b", internal=True)], [MESH]), "does not fit into"),
        (
            lambda: hb.gears.Train(
                [gear("a"), gear("b", x=0.06)], [hb.gears.Mesh("a", "b", 4e8, 4e-5, pressure_angle="30 deg")]
            ),
            "omit one",
        ),
        (lambda: hb.gears.Train([gear("a"), gear("b")], MESH), "must be a list of Mesh"),
        (lambda: hb.gears.Wheel("a", 1e-3, teeth=20), "teeth and base_radius"),
        (lambda: hb.gears.Wheel("a", 1e-3, moves="plane"), "give its mass"),
        (lambda: hb.gears.Wheel("a", 1e-3, moves="up"), "must be one of torsion, plane, space"),
        (lambda: hb.gears.Wheel("", 1e-3), "not the name of a wheel"),
        (lambda: hb.gears.Wheel("a", "3 mm"), "inertia"),
        (lambda: hb.gears.Shaft("a", "a"), "name two wheels"),
        (lambda: hb.gears.Shaft.section("a", "b", 0.02, 0.1, 0.03), "smaller than outer"),
        (lambda: hb.gears.Mesh("a", "a", 1e8), "cannot mesh with itself"),
        (lambda: hb.gears.Mesh.of("a", "b", spur_pair(), "-5 N m"), r"^Mesh\.of: torque = -5 N m must be positive"),
        (lambda: hb.gears.Mesh.of("a", "b", spur_pair(), 0.0, mesh="secant"), r"^Mesh\.of: torque = 0 N m"),
        (lambda: hb.gears.tooth_mesh(spur_pair(), -5.0), r"^tooth_mesh: torque = -5 N m must be positive"),
        (lambda: hb.gears.Mesh("a", "b", 1e8, e=(5.0,)), "give 5e-6 for 5 um"),
        (lambda: hb.gears.Mesh("a", "b", 1e8, half_backlash=1e-300), "must be 0 or at least 1e-15 m"),
        (lambda: hb.gears.Mesh("a", "b", 1e8, eps=(0.1,), stiffness=hb.mechanics.Series(1.0)), "keep one"),
        (lambda: hb.gears.Bearing("a", table=3.0), "MatrixTable"),
        (lambda: hb.gears.Bearing("a", table=hb.mechanics.MatrixTable([1, 2], np.zeros((2, 3, 3)))), "for x and y"),
    ],
)
def test_bad_input(make, said):
    with pytest.raises((ValueError, TypeError), match=said):
        make()


@pytest.mark.parametrize("mesh", ["teeth", "secant"])
def test_a_train_of_two_helical_wheels_is_the_pair(mesh):
    """Transverse quantities of the pair are converted to the normal of the flanks: equal motions at equal speeds."""
    gears = [
        hb.gears.Gear(z, "3 mm", "20 mm", helix_angle=h, tip_relief="10 um")
        for z, h in ((25, "25 deg"), (40, "-25 deg"))
    ]
    pair = hb.GearPair(*gears, backlash="80 um")
    wheels = [hb.gears.Wheel.of("a", gears[0], torque="100 N m"), hb.gears.Wheel.of("b", gears[1])]
    meshed = hb.gears.Mesh.of("a", "b", pair, "100 N m", 0.04, mesh=mesh)
    train, one = hb.gears.Train(wheels, [meshed], balance="b"), pair.model("100 N m", 0.04, mesh=mesh)
    Omega = 0.7
    other = Omega * one.scales.frequency / train.scales.frequency
    X = hb.HarmonicBalance(one, 12).start(Omega=Omega)
    np.testing.assert_allclose(hb.HarmonicBalance(train, 12).start(Omega=other), X, rtol=0, atol=1e-8)
    assert train.scales.pinion_speed(other) == pytest.approx(one.scales.pinion_speed(Omega))


def in_space(pair, place):
    """Train of a drawn pair on bearings, the wheel in a direction from the pinion."""
    distance, free = pair.working_center_distance, {"moves": "space"}
    wheels = [
        hb.gears.Wheel.of("a", pair.pinion, torque="100 N m", **free),
        hb.gears.Wheel.of("b", pair.wheel, x=distance * cos(place), y=distance * sin(place), **free),
    ]
    bearings = [hb.gears.Bearing(name, 3e8, 3e8, 1e8, 5e5, 5e5) for name in "ab"]
    mesh = hb.gears.Mesh.of("a", "b", pair, "100 N m", 0.04, mesh="secant")
    return hb.gears.Train(wheels, [mesh], bearings=bearings, balance="b")


@pytest.mark.parametrize("ring", [False, True])
@pytest.mark.parametrize("helix", [0.0, 25.0, -25.0])
def test_forces_of_a_mesh_in_space_are_in_equilibrium(helix, ring):
    """Forces and moments about the centre of the first wheel, whose sum a pair of equal and opposite forces on one line
    does not have."""
    place, z = 0.8, 90 if ring else 40
    gears = [
        hb.gears.Gear(n, "3 mm", "20 mm", helix_angle=radians(h), internal=ring and n == z)
        for n, h in ((25, helix), (z, helix if ring else -helix))
    ]
    pair = hb.GearPair(*gears, backlash="80 um")
    w = in_space(pair, place).mesh_vectors().reshape(2, 6)
    to_wheel = pair.working_center_distance * np.array([cos(place), sin(place), 0.0])
    np.testing.assert_allclose(w[0, :3], -w[1, :3], rtol=0, atol=1e-15)
    moment = w[0, 3:] + w[1, 3:] + np.cross(to_wheel, w[1, :3])
    np.testing.assert_allclose(moment, 0.0, rtol=0, atol=1e-12 * pair.working_center_distance)


@pytest.mark.parametrize(("helix", "place"), [(15.0, 0.0), (-25.0, 0.8)])
def test_a_helical_train_in_space_has_the_natural_frequencies_of_the_pair(helix, place):
    """`HelicalPair` measures along the line of action in the transverse plane, a train normal to the flanks."""
    gears = [hb.gears.Gear(z, "3 mm", "20 mm", helix_angle=radians(h)) for z, h in ((25, helix), (40, -helix))]
    pair = hb.GearPair(*gears, backlash="80 um")
    supports = (hb.gears.Support("3e8 N/m", axial="1e8 N/m", tilt="5e5 N m/rad"),) * 2
    one = pair.model("100 N m", 0.04, "spatial", supports=supports, mesh="secant").replace(phi_deg=np.degrees(place))
    frequencies = []
    for model in (one, in_space(pair, place)):
        system, frequency = model.system(), model.scales.frequency
        gap = system.elements[0]
        K = system.K + gap.law.stiffness.mean * np.outer(gap.direction, gap.direction)
        squares = np.linalg.eigvals(np.linalg.solve(system.M, K)).real
        frequencies.append(frequency * np.sqrt(np.sort(squares)[1:]))
    np.testing.assert_allclose(*frequencies, rtol=1e-9)
