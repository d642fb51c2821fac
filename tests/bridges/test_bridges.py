"""Imported ROSS rotors and openTorsion drive trains against these packages; skipped if they are not installed.

.ci/bridges creates an environment with both packages and runs these tests.
"""

import dataclasses

import numpy as np
import pytest
from pages import blocks, run_python

import hbgear as hb
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.series.fourier import evaluate, to_complex
from hbgear.mechanics.series.measures import half_peak_to_peak
from hbgear.time.integration import state_of


@pytest.fixture
def ross():
    return pytest.importorskip("ross", reason="ROSS is not installed; .ci/bridges installs it")


@pytest.fixture
def ot():
    return pytest.importorskip("opentorsion", reason="openTorsion is not installed; .ci/bridges installs it")


@pytest.mark.parametrize("block", [each for each in blocks("text") if "hb.from_" in each.text], ids=str)
def test_examples_of_the_pages(block, ross, ot):
    run_python(block.text)


def test_a_node_that_is_not_there(ross):
    found = hb.io.from_ross(ross.rotor_example())
    with pytest.raises(KeyError, match="no coordinate 'x_99'; it has: x_0, y_0"):
        found.along({"x_99": 1.0})


def silent(found):
    """Return an element without force, for linear systems."""
    return hb.Element(found.along({0: 1.0}), hb.Cubic(k3=0.0), name="none")


@pytest.mark.parametrize("speed", [0.0, 120.0, 600.0])
def test_natural_frequencies_of_a_rotor(ross, speed):
    rotor = ross.rotor_example()
    found = hb.io.from_ross(rotor)
    own = np.sort(rotor.run_modal(speed=speed, num_modes=12).wd)
    at = max(speed, 1e-6)
    ours = hb.analysis.campbell(found.system([silent(found)]), (at * 0.99, at), points=2).frequencies[-1]
    for frequency in own[own > 1.0]:
        assert np.abs(ours - frequency).min() < 1e-9 * frequency


def test_unbalance_of_a_rotor(ross):
    rotor, speeds = ross.rotor_example(), np.array([80.0, 250.0, 900.0])
    own = rotor.run_unbalance_response(2, 0.004, 0.3, frequency=speeds).forced_resp
    found = hb.io.from_ross(rotor)
    turned = 0.004 * np.exp(0.3j)
    along = {axis: found.along({f"{axis}_2": 1.0}) for axis in "xy"}
    force = turned * along["x"] - 1j * turned * along["y"]  # real part: m e cos(tau + phase), m e sin(tau + phase)
    load = hb.Load(cosine={1: force.real}, sine={1: -force.imag}, power=2)
    problem = hb.HarmonicBalance(found.system([silent(found)], load), 2)
    for i, speed in enumerate(speeds):
        q = to_complex(problem.motion(problem.start(Omega=speed), Omega=speed))[:, 1]
        np.testing.assert_allclose(q, own[:, i], rtol=1e-9, atol=1e-11 * np.abs(own[:, i]).max())


def geared(ross):
    multi_rotor = pytest.importorskip("ross.multi_rotor")
    inner = getattr(multi_rotor, "multi_rotor", multi_rotor)  # a subpackage in newer versions
    return inner.two_shaft_rotor_example()


def steel_rotor(ross, teeth, diameter):
    """Return a short shaft on two bearings with a gear between them."""
    shaft = [ross.ShaftElement(L=0.3, idl=0.0, odl=0.1, material=ross.materials.steel) for _ in range(2)]
    gear = ross.GearElement(
        n=1, m=10.0, Id=0.1, Ip=0.2, n_teeth=teeth, pitch_diameter=diameter, pr_angle=ross.Q_(20.0, "deg")
    )
    return ross.Rotor(shaft, [gear], [ross.BearingElement(n=n, kxx=1e8, kyy=1e8, cxx=1e3) for n in (0, 2)])


def test_every_mesh_of_a_multi_rotor_of_multi_rotors_is_found(ross):
    """Both mesh springs are removed from K; with both added again K and natural frequencies agree with ROSS."""
    inner = ross.MultiRotor(
        steel_rotor(ross, 20, 0.1), steel_rotor(ross, 40, 0.2), coupled_nodes=(1, 1), gear_mesh_stiffness=1e8
    )
    rotor = ross.MultiRotor(inner, steel_rotor(ross, 20, 0.1), coupled_nodes=(1, 1), gear_mesh_stiffness=2e8)
    found = hb.io.from_ross(rotor)
    assert {name: k for name, (_, k) in found.meshes.items()} == {"gears_1_7": 2e8, "gears_1_4": 1e8}
    for first, second in ((0, 3), (0, 6), (3, 6)):
        assert not found.K[6 * first : 6 * first + 18, 6 * second : 6 * second + 18].any()
    whole = found.K + sum(k * np.outer(w, w) for w, k in found.meshes.values())
    np.testing.assert_allclose(whole, rotor.K(0), rtol=1e-9, atol=1e-6 * np.abs(whole).max())
    meshes = [hb.Element(w, hb.Cubic(k1=k, k3=0.0), name=name) for name, (w, k) in found.meshes.items()]
    own = np.sort(rotor.run_modal(speed=50.0).wd)
    ours = hb.analysis.campbell(found.system(meshes), (49.0, 50.0), points=2).frequencies[-1]
    for frequency in own[own > 1.0]:
        assert np.abs(ours - frequency).min() < 1e-6 * frequency


def test_natural_frequencies_of_a_geared_rotor(ross):
    rotor = geared(ross)
    found = hb.io.from_ross(rotor)
    w, k = found.meshes["gears"]
    mesh = hb.Element(w, hb.Cubic(k1=k, k3=0.0), name="mesh")
    own = np.sort(rotor.run_modal(speed=50.0).wd)
    ours = hb.analysis.campbell(found.system([mesh]), (49.0, 50.0), points=2).frequencies[-1]
    for frequency in own[own > 1.0]:
        assert np.abs(ours - frequency).min() < 1e-6 * frequency


def test_a_geared_rotor_with_backlash(ross):
    """With backlash and a torque the teeth lose contact: two folds; motions are periodic in time integration."""
    rotor = geared(ross)
    found = hb.io.from_ross(rotor)
    w, k = found.meshes["gears"]
    one, other = (
        found.dof_names.index(f"theta_{gear.n}") for gear in (rotor.mesh.driving_gear, rotor.mesh.driven_gear)
    )
    torques = hb.Load(constant=found.along({one: 2e3, other: 2e3 * w[other] / w[one]}))
    mesh = hb.Element(
        w, hb.Backlash(b=1e-4, k=k, stiffness=hb.mechanics.Series(1.0, (-0.3,))), damping=3e3, name="mesh"
    )
    geared_pair = found.system([mesh], torques, ratio=1 / rotor.mesh.driving_gear.n_teeth)
    problem = hb.HarmonicBalance(geared_pair, 8)
    curve = hb.trace(problem, "Omega", (1890.0, 1840.0), stability=False)
    folds = [point.parameters["Omega"] for point in curve.special if point.kind == "LP"]
    np.testing.assert_allclose(folds, [1846.47, 1872.44], atol=0.1)
    for i in (len(curve) // 4, len(curve) // 2, -2):
        X, Omega = curve.X[i], float(curve.values[i])
        state = state_of(problem, X, Omega=Omega)
        end = hb.time.integrate(geared_pair, state, 1, Omega, method="exponential").d
        d = evaluate(X.reshape(1, -1), 2 * np.pi * np.arange(256) / 256)
        np.testing.assert_allclose(end, d, atol=0.02 * np.abs(d).max())


def test_newmark_of_ross_lies_on_the_curve_with_jumps(ross):
    """A gear pair with backlash, which ROSS lacks: its Newmark integrator receives the gap force with the matrices.

    Mass-proportional damping makes the slow shaft modes decay within a few hundred cycles. The contact state is
    evaluated once per step, 200 times per cycle.
    """
    from ross.utils import newmark

    rotor = geared(ross)
    found = hb.io.from_ross(rotor)
    found = dataclasses.replace(found, C=found.C + 15.0 * found.M)
    w, k = found.meshes["gears"]
    one, other = (
        found.dof_names.index(f"theta_{gear.n}") for gear in (rotor.mesh.driving_gear, rotor.mesh.driven_gear)
    )
    torque, ratio = found.along({one: 2e3, other: 2e3 * w[other] / w[one]}), 1 / rotor.mesh.driving_gear.n_teeth
    b, eps, c = 1e-4, 0.3, 3e3
    mesh = hb.Element(w, hb.Backlash(b=b, k=k, stiffness=hb.mechanics.Series(1.0, (-eps,))), damping=c, name="mesh")
    problem = hb.HarmonicBalance(found.system([mesh], hb.Load(torque), ratio=ratio), 12)
    curve = hb.trace(problem, "Omega", (1890.0, 1850.0))
    np.testing.assert_allclose([jump.value for jump in curve.jumps()], [1867.31, 1874.81], atol=0.05)
    M, G, K = rotor.M(), rotor.G(), np.asarray(found.K)
    sizes = []
    for Omega in (1885.0, 1871.0, 1855.0):
        t = np.linspace(0, 320 * 2 * np.pi / Omega, 320 * 200 + 1)
        C = np.asarray(found.C) + ratio * Omega * G + c * np.outer(w, w)

        def at(step, y=None, **rest):
            d = w @ y
            if abs(d) <= b:
                return M, C, K, torque  # noqa: B023
            now = k * (1 - eps * np.cos(Omega * t[step]))  # noqa: B023
            return M, C, K + now * np.outer(w, w), torque + now * b * np.sign(d) * w  # noqa: B023

        d = newmark(at, t, len(M), tol=1e-7)[-400:] @ w
        one, last = 0.5 * np.ptp(d[:200]), 0.5 * np.ptp(d[200:])
        assert one == pytest.approx(last, rel=1e-3)  # steady state
        stable = [
            half_peak_to_peak(solve(problem, place.interpolate(curve.X), {"Omega": Omega}).X)
            for place in crossings_at(curve, Omega)
            if curve.stable[place.nearest]
        ]
        assert len(stable) == (2 if Omega == 1871.0 else 1)
        nearest = min(stable, key=lambda size: abs(size - last))
        assert last == pytest.approx(nearest, rel=0.01)
        sizes.append(float(last))
    assert sizes[0] > 1.2 * sizes[2]


def test_steady_response_of_a_branched_drive_train(ot):
    """Response to three torque harmonics at several speeds, against the steady-state response of openTorsion."""
    shafts = [ot.Shaft(0, 1, k=2e5, c=30.0), ot.Shaft(1, 2, k=3e5, c=20.0), ot.Shaft(1, 3, k=1.5e5, c=25.0)]
    discs = [ot.Disk(0, I=0.5), ot.Disk(1, I=0.8, c=4.0), ot.Disk(2, I=0.3), ot.Disk(3, I=0.2, k=2e3)]
    assembly = ot.Assembly(shafts, disk_elements=discs)
    found = hb.io.from_opentorsion(assembly)
    torques = {1: ("theta_0", 10.0), 2: ("theta_2", 4.0), 3: ("theta_0", 1.0)}
    load = hb.Load(cosine={order: found.along({name: size}) for order, (name, size) in torques.items()})
    problem = hb.HarmonicBalance(found.system([silent(found)], load), 3)
    for Omega in (90.0, 310.0, 760.0):
        motion = to_complex(problem.motion(problem.start(Omega=Omega), Omega=Omega))
        for order, (name, size) in torques.items():
            excited = np.zeros((4, 1), dtype=complex)
            excited[found.dof_names.index(name)] = size
            own = assembly.ss_response(excited, [order * Omega])[0][:, 0]
            np.testing.assert_allclose(motion[:, order], own, rtol=1e-9, atol=1e-12 * np.abs(own).max())


def test_a_drive_train(ot):
    shafts = [ot.Shaft(0, 1, k=2e5, c=30.0), ot.Shaft(1, 2, k=3e5, c=20.0)]
    discs = [ot.Disk(0, I=0.5), ot.Disk(1, I=0.8), ot.Disk(2, I=0.3)]
    assembly = ot.Assembly(shafts, disk_elements=discs)
    found = hb.io.from_opentorsion(assembly)
    own = np.unique(np.round(np.abs(assembly.modal_analysis()[1]), 6))
    ours = hb.analysis.campbell(found.system([silent(found)]), (1.0, 2.0), points=2).frequencies[-1]
    for frequency in own[own > 1.0]:
        assert np.abs(ours - frequency).min() < 1e-6 * frequency
    Omega = 300.0
    excited = np.array([[10.0], [0.0], [0.0]], dtype=complex)
    q = assembly.ss_response(excited, [Omega])[0][:, 0]
    twist = hb.Element(found.along({"theta_0": 1.0, "theta_1": -1.0}), hb.Cubic(k3=0.0), name="none")
    problem = hb.HarmonicBalance(found.system([twist], hb.Load(cosine={1: found.along({"theta_0": 10.0})})), 2)
    motion = to_complex(problem.motion(problem.start(Omega=Omega), Omega=Omega))[:, 1]
    np.testing.assert_allclose(motion, q, rtol=1e-9)


def test_a_drive_train_with_elastic_gears(ot):
    parent = ot.ElasticGear(1, 0.05, 40)
    child = ot.ElasticGear(2, 0.2, 80, k=5e5, c=0.0, parent=parent)
    shafts = [ot.Shaft(0, 1, k=1e5, c=5.0), ot.Shaft(2, 3, k=2e5, c=5.0)]
    discs = [ot.Disk(0, I=0.3), ot.Disk(3, I=0.6)]
    assembly = ot.Assembly(shafts, disk_elements=discs, elastic_gear_elements=[parent, child])
    found = hb.io.from_opentorsion(assembly)
    ((name, (w, k)),) = found.meshes.items()
    assert name == "1-2"
    np.testing.assert_allclose(found.K + k * np.outer(w, w), assembly.K, rtol=1e-12, atol=1e-6)
    gap = hb.Element(w, hb.Backlash(b=1e-4, k=k), name=name)
    wave = hb.Load(cosine={1: found.along({"theta_0": 20.0})})
    curve = hb.trace(hb.HarmonicBalance(found.system([gap], wave), 8), "Omega", (500.0, 400.0))
    assert curve.status.complete


def test_a_drive_train_with_rigid_and_elastic_gears(ot):
    """Nodes keep their names; with the mesh spring added again K equals the matrix of openTorsion."""
    parent = ot.ElasticGear(1, 1.0, 1.0)
    child = ot.ElasticGear(2, 0.1, 0.5, k=1e5, c=1.0, parent=parent)
    big = ot.Gear(3, 0.1, 1.0)
    small = ot.Gear(4, 0.1, 2.0, parent=big)
    shafts = [ot.Shaft(0, 1, k=1e4, I=0), ot.Shaft(2, 3, k=2e4, I=0), ot.Shaft(4, 5, k=1e4, I=0)]
    assembly = ot.Assembly(
        shafts,
        disk_elements=[ot.Disk(0, I=2.0), ot.Disk(5, I=3.0)],
        gear_elements=[big, small],
        elastic_gear_elements=[parent, child],
    )
    found = hb.io.from_opentorsion(assembly)
    assert found.dof_names == ("theta_0", "theta_1", "theta_2", "theta_3", "theta_5")
    ((name, (w, k)),) = found.meshes.items()
    assert name == "1-2" and k == 1e5
    np.testing.assert_allclose(w, found.along({"theta_1": 1.0, "theta_2": 0.5}), atol=1e-12)
    assert found.K[1, 2] == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(found.K + k * np.outer(w, w), assembly.K, rtol=1e-12, atol=1e-6)
