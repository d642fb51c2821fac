"""Torques with shaft orders: pairs against trains, integration in time, the back flanks, planetary sets, bad input."""

import dataclasses
from math import cos, pi, radians

import numpy as np
import pytest
import scipy

import hbgear as hb
from hbgear.gears.torque_orders import parse_torque_orders


def gears(wheel=40):
    return [hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, wheel)]


@pytest.mark.slow
def test_a_train_of_two_wheels_is_the_pair():
    a, b = gears()
    pair = hb.GearPair(a, b, backlash="80 um")
    orders = {2: ("60 N m", "20 deg"), "5/2": "10 N m"}
    drawn = pair.model("200 N m", 0.04, mesh="secant", torque_orders=orders)
    assert (drawn.mesh_order, drawn.orders) == (50, {"mesh": 50.0})  # half turns of the pinion
    assert drawn.scales.pinion_speed(1.0 / 50) == pytest.approx(60 * drawn.scales.mesh_frequency(1.0 / 50) / 25)
    mesh = hb.gears.Mesh.of("a", "b", pair, (200**2 + 0.5 * (60**2 + 10**2)) ** 0.5, 0.04, mesh="secant")
    wheels = [hb.gears.Wheel.of("a", a, torque="200 N m"), hb.gears.Wheel.of("b", b)]
    turned = hb.gears.Train(wheels, [dataclasses.replace(mesh, torque=None)], balance="b")._kinematics.start_angles["a"]
    shifted = {2: (60, radians(20) - 2 * turned), 2.5: (10, -2.5 * turned)}
    wheels[0] = hb.gears.Wheel.of("a", a, torque="200 N m", torque_orders=shifted)
    train = hb.gears.Train(wheels, [mesh], balance="b")
    assert train.orders["a-b"] == 50
    X = np.zeros(2 * 110 + 1)
    X[[0, 1, 8, 99, 100, 203]] = 1.4, 0.05, -0.1, 0.3, 0.2, 0.1
    two = [hb.HarmonicBalance(model, 110).evaluate(X, Omega=0.012)[0] for model in (drawn, train)]
    np.testing.assert_allclose(two[1], two[0], rtol=0, atol=1e-9 * np.abs(two[0]).max())


def test_rattle_closes_under_integration_in_time():
    """Without a mean torque, the flanks are in contact alternately: x'' + 2 zeta x' + k f(x) = F cos(tau)."""
    pair = hb.SpurPair(
        0.06, 0.0, eps=(0.2,), e=(0.02,), mesh_order=5, fluctuation=hb.mechanics.Series(cosine=(0.3,), sine=(0.0, 0.05))
    )
    problem, Omega = hb.HarmonicBalance(pair, 80), 0.16
    X = problem.start(Omega=Omega)
    assert problem.regime(X, Omega=Omega).tolist() == [2]  # contact on both flanks
    e = hb.mechanics.Series(cosine=(0.0,) * 4 + (0.02,))
    q, zero = hb.mechanics.Series(X[0], X[1::2], X[2::2]), np.zeros(1)
    x = [float((q(zero) + e(zero))[0]), Omega * float((q(zero, 1) + e(zero, 1))[0])]

    def motion(t, state):
        tau = Omega * t
        d = state[0] - 0.02 * cos(5 * tau)
        gap = d - np.clip(d, -1.0, 1.0)
        v = state[1] + 0.1 * Omega * np.sin(5 * tau)
        force = 0.3 * cos(tau) + 0.05 * np.sin(2 * tau) - 0.12 * v - (1 - 0.2 * cos(5 * tau)) * gap
        return [state[1], force]

    period = 2 * pi / Omega
    end = scipy.integrate.solve_ivp(motion, (0.0, period), x, rtol=1e-8, atol=1e-8, max_step=period / 300).y[:, -1]
    np.testing.assert_allclose(end, x, rtol=0, atol=1e-3)


@pytest.mark.slow
def test_a_negative_torque_loads_the_back_flanks():
    """Without relief, pairs of teeth and their secant are the same mesh on the back flanks, with the same phase."""
    a, b = gears()
    pair = hb.GearPair(a, b, backlash="80 um")
    found = []
    for mesh in ("teeth", "secant"):
        model = pair.model("-200 N m", 0.04, mesh=mesh)
        assert model.F_m < 0
        found.append(hb.HarmonicBalance(model, 12).start(Omega=0.55))
    assert found[0][0] < -1.0
    assert np.abs(found[0][1:]).max() > 0.02
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-4)


def test_planetary_set_with_engine_orders():
    still, varying = (hb.gears.PlanetarySet(torque_orders=orders) for orders in ((), {1: "30 N m"}))
    p = varying.mesh_order
    assert varying.orders["mesh"] == p
    assert varying.orders["sun"] == pytest.approx(p * still.orders["sun"])
    assert varying.scales.pinion_speed(1 / p) == pytest.approx(still.scales.pinion_speed(1.0))
    one = hb.HarmonicBalance(still, 2)
    many = hb.HarmonicBalance(varying.replace(fluctuation_scale=0.0), orders=(p, 2 * p))
    X = np.random.default_rng(1).normal(0.0, 0.3, (8, 5)) + np.array([2.0, 0, 0, 0, 0])
    R = one.evaluate(X.ravel(), Omega=0.9)[0]
    found = many.evaluate(X.ravel(), Omega=0.9 / p)[0]
    np.testing.assert_allclose(found, R, rtol=0, atol=1e-9 * np.abs(R).max())
    load = varying.system().loads[1].complex(varying.system().n)
    assert list(load) == [round(varying.orders["sun"])]
    force = 30.0 / varying.r_s / varying.scales.force
    np.testing.assert_allclose(next(iter(load.values()))[8], force)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({0.1234567: 1.0}, "order 0.1234567 of the torque has no common base with the turns of its shaft below 60"),
        ({-1: 1.0}, "order -1 of the torque has no common base"),
        ({"two": 1.0}, "order 'two' of the torque must be a number such as 2 or 1/2"),
        ({2: "60 N"}, "torque_orders"),
        ([(2, 1.0), (2.0, 3.0)], "has the order 2 twice"),
        (3.0, "must be amplitudes by order of the shaft, such as"),
    ],
)
def test_orders_that_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        hb.gears.Wheel("a", 1.0, torque_orders=given)


def test_text_of_orders():
    assert parse_torque_orders("--torque-orders", "2: 60Nm, 1/2:5 N m 30deg") == {
        "2": ("60Nm", "0 deg"),
        "1/2": ("5 N m", "30deg"),
    }
    with pytest.raises(ValueError, match="need each order with its amplitude"):
        parse_torque_orders("--torque-orders", "60Nm")


def test_a_mesh_for_another_torque_is_refused():
    """The idler passes on the force: 100 N m on the pinion of 25 teeth are 120 N m on the idler of 30."""
    three = [hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 30, 40)]
    pairs = [hb.GearPair(*three[i : i + 2], backlash="80 um") for i in (0, 1)]
    wheels = [
        hb.gears.Wheel.of(name, gear, x=x) for name, gear, x in zip("abc", three, (0, 0.0825, 0.1875), strict=True)
    ]
    wheels[0] = hb.gears.Wheel.of("a", three[0], torque="100 N m")

    def train(second):
        meshes = [
            hb.gears.Mesh.of("a", "b", pairs[0], "100 N m", mesh="secant"),
            hb.gears.Mesh.of("b", "c", pairs[1], second, mesh="secant"),
        ]
        return hb.gears.Train(wheels, meshes, balance="c")

    assert train("120 N m").torques["c"] == pytest.approx(-160.0)
    with pytest.raises(ValueError, match="mesh b-c is computed for 100 N m on 'b', the train loads it with 120 N m"):
        train("100 N m")


@pytest.mark.parametrize("N", [2, 3, 4, 5, 6])
def test_phasing_by_teeth_of_the_sun(N):
    """The rule of Parker and Lin: torque for l z_s mod N = 0, force for 1 and N - 1, neither for other values."""
    for z_s in range(24, 24 + N):
        z_p = next(z for z in range(12, 12 + N + 1) if (2 * z_s + 2 * z) % N == 0)
        machine = hb.gears.PlanetarySet(z_s, z_p, z_s + 2 * z_p, planets=N)
        names = {0: "in phase", N / 2: "counter-phase"}
        assert machine.phasing == names.get(z_s % N, "sequential")
        for harmonic in (1, 2, 3):
            k = harmonic * z_s % N
            expected = ("torque",) * (k == 0) + ("force",) * (k in (1, N - 1))
            assert machine.excitation(harmonic) == expected


def test_orders_in_files(tmp_path):
    """Files of machines hold torque orders in full; files of trains have them for each wheel."""
    from hbgear.io.machines.machine_file import Machine, read_machine, write_machine
    from hbgear.io.machines.train_file import read_train

    pair = hb.GearPair(*gears(), backlash="80 um")
    machine = Machine(pair, 20.0, 0.04, mesh_model="secant", torque_orders={"1/3": ("10 N m", "30 deg"), 2: 60.0})
    write_machine(machine, tmp_path / "pair.toml")
    read = read_machine(tmp_path / "pair.toml")
    assert read.torque_orders == machine.torque_orders
    assert read.model() == machine.model()
    wheels = "\n".join(
        f'[[wheel]]\nname = "{name}"\ninertia = 1e-3\nteeth = {z}\nbase_radius = {z / 1000}\n{torque}'
        for name, z, torque in (("a", 20, 'torque = 10.0\ntorque_orders = { 2 = "5 N m" }'), ("b", 30, ""))
    )
    text = f'balance = "b"\n{wheels}\n[[mesh]]\nfirst = "a"\nsecond = "b"\nk_mean = 1e8\n'
    (tmp_path / "train.toml").write_text(text)
    assert read_train(tmp_path / "train.toml").wheels[0].torque_orders == ((2.0, 5.0, 0.0),)
    (tmp_path / "wrong.toml").write_text(text.replace("{ 2 =", "{ two ="))
    with pytest.raises(ValueError, match=r"wrong.toml, line 2.*order 'two' of the torque must be a number"):
        read_train(tmp_path / "wrong.toml")
