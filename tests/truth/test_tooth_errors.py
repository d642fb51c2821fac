"""Pitch errors of single teeth and run-out: closed forms of their sidebands, geometry, integration in time, input."""

from math import acos, atan2, cos, hypot, pi, sin, tan

import numpy as np
import pytest
import scipy

import hbgear as hb
from hbgear.gears.drawing.tooth_errors import GapWave, gap_waves, pair_gaps
from hbgear.gears.mesh.tooth_contacts import Flank, PathFunction, mesh_contacts
from hbgear.gears.mesh.tooth_forces import PairForces, pair_forces
from hbgear.mechanics.laws.mesh_contacts import MeshContacts

TURN = 2 * np.pi
ZETA, LOAD, OMEGA = 0.05, 0.4, 0.6


def middle_passes(pair: hb.GearPair, which: int) -> float:
    """Return the time [mesh periods] at which the middle of tooth 0 is on the line of centres of spur gears without
    profile shift, whose teeth are half a pitch thick: the flanks touch at the pitch point a quarter of a pitch from it.
    """
    pitch_point = (pair.base_radii[0] * tan(pair.working_pressure_angle) - pair.path[0]) / pair.base_pitch
    return pitch_point + (0.25 if which == 0 else -0.25)


def amplitudes(flanks: list[Flank], meshes: int, harmonics: int) -> np.ndarray:
    """Return the complex amplitudes x_m exp(i m tau), m >= 0, of a pair whose teeth stay in contact."""
    pair = hb.SpurPair(ZETA, LOAD, e=(), contacts=mesh_contacts(flanks, meshes), mesh_order=meshes, b=0.0)
    assert pair.orders == {"mesh": meshes}
    problem = hb.HarmonicBalance(pair, harmonics, orders=range(1, harmonics + 1))
    X = problem.start(Omega=OMEGA / meshes)
    assert problem.regime(X, Omega=OMEGA / meshes).tolist() == [0]
    return np.concatenate([X[:1], X[1::2] - 1j * X[2::2]])


def receptance(m: np.ndarray, meshes: int) -> np.ndarray:
    w = m * OMEGA / meshes
    return 1 / (1 - w**2 + 2j * ZETA * w)


def test_sidebands_of_pitch_errors():
    """With contact ratio 2 and constant stiffness, f_p = A cos(2 pi p / z) is a staircase with the orders n z +- 1:
    G_m = A sin(2 pi m / z) / (2 pi m / z) exp(-2 pi i m / z)."""
    z, A = 12, 0.05
    ends, half = np.array([0.0, 2.0]), np.array([0.5, 0.5])
    errors = {p: A * cos(TURN * p / z) for p in range(z)}
    flank = Flank(1, PathFunction.linear(ends, half), PathFunction.linear(ends, 0 * half), errors=errors)
    found, m = amplitudes([flank], z, 3 * z), np.arange(1, 3 * z + 1)
    excited = (m % z == 1) | (m % z == z - 1)
    exact = A * np.sin(TURN * m / z) / (TURN * m / z) * np.exp(-1j * TURN * m / z) * excited * receptance(m, z)
    assert found[0] == pytest.approx(LOAD, abs=1e-9)
    np.testing.assert_allclose(found[1:], exact, rtol=0, atol=1e-10)
    assert abs(exact[[z - 2, z]]).min() > 1e-3


def test_run_out_has_sidebands_by_the_varying_stiffness():
    """Of a constant stiffness, run-out excites the order 1 only. Otherwise the harmonics are those of the linear
    equation x'' + 2 zeta x' + k(tau) (x - g(tau)) = F, solved with the Fourier coefficients of k."""
    z, length, wave = 12, 1.625, GapWave(0.05, 12, 0.7)
    u = np.linspace(0.0, length, 3)
    none = PathFunction.linear(u, 0 * u)
    g_1 = wave.amplitude * np.exp(1j * (wave.phase - pi / 2))
    ends = np.array([0.0, 2.0])
    level = Flank(1, PathFunction.linear(ends, [0.5, 0.5]), PathFunction.linear(ends, [0.0, 0.0]), waves=(wave,))
    found = amplitudes([level], z, 2 * z)
    assert found[1] == pytest.approx(g_1 * receptance(np.array(1), z), abs=1e-7)
    assert np.abs(found[2:]).max() < 1e-7
    stiffness = PathFunction.linear(u, [0.55, 0.85, 0.45])
    H = 6 * z
    found = amplitudes([Flank(1, stiffness, none, waves=(wave,))], z, H)
    n = z * 4096  # jumps lie between two samples
    t = z * (np.arange(n) + 0.5) / n
    k = sum(np.where(t % 1 + q < length, stiffness.at(t % 1 + q), 0.0) for q in range(2))
    loads = LOAD + k * wave.amplitude * np.sin(TURN * t / z + wave.phase)
    c, force = (np.fft.fft(y) * np.exp(-1j * pi * np.fft.fftfreq(n)) / n for y in (k, loads))
    m = np.arange(-H, H + 1)
    A = c[m[:, None] - m] + np.diag(1 / receptance(m, z) - 1)
    linear = np.linalg.solve(A, force[m])[H:]
    np.testing.assert_allclose(found[1:], 2 * linear[1:], rtol=0, atol=1e-7)
    assert np.abs(linear[[z - 1, z + 1]]).min() > 1e-5


def test_gaps_of_an_eccentric_gear():
    """The gap of involutes whose centres move is R (inv(alpha') - inv(alpha)) +- R gamma, R = r_b1 + r_b2 = a' cos
    alpha', where gamma is the rotation of the line of centres; gaps are linear in the eccentricity to e^2 / a."""
    e, phase = 10e-6, 0.4
    gears = [hb.gears.Gear(z, "3 mm", "20 mm", runout=2 * e, runout_phase=phase) for z in (25, 40)]
    plain = [hb.gears.Gear(z, "3 mm", "20 mm") for z in (25, 40)]
    for which in (0, 1):
        pair = hb.GearPair(*(gears[i] if i == which else plain[i] for i in (0, 1)), backlash="80 um")
        a, R, alpha = pair.working_center_distance, sum(pair.base_radii), pair.working_pressure_angle
        for t in (0.0, 3.3, 11.0):
            psi = TURN * (t - middle_passes(pair, which)) / gears[which].teeth + phase
            closer, along = e * cos(psi), e * sin(psi)  # along: in the direction of the velocity of the pitch point
            moved = (a - closer, -along if which == 0 else along)
            rotated, angle = atan2(moved[1], moved[0]), acos(R / hypot(*moved))
            common = R * (tan(angle) - angle - tan(alpha) + alpha)
            for side in (1, -1):
                (wave,) = gap_waves(pair, side)
                found = wave.amplitude * sin(TURN * t / wave.meshes + wave.phase)
                assert found == pytest.approx(common + side * R * rotated, abs=5e-9)
    ring = hb.gears.Gear(70, "3 mm", "20 mm", internal=True, runout=2 * e)
    pair = hb.GearPair(plain[0], ring, backlash="80 um")
    alpha, begin = pair.working_pressure_angle, middle_passes(pair, 1)
    for turned, exact in ((0.0, (e * sin(alpha), e * sin(alpha))), (17.5, (e * cos(alpha), -e * cos(alpha)))):
        t = begin + turned
        found = [w.amplitude * sin(TURN * t / w.meshes + w.phase) for s in (1, -1) for w in gap_waves(pair, s)]
        np.testing.assert_allclose(found, exact, atol=1e-12)  # the ring moves off the pinion, then along its rotation


def test_gaps_of_displaced_teeth():
    """An arc f of the reference circle turns the base circle by f d_b / d; a tooth of the wheel that lags behind is
    closer to the tooth that drives it."""
    errors = [[9e-6 * (p == 3) for p in range(20)], [-2e-6 * (p == 3) for p in range(30)]]
    gears = [
        hb.gears.Gear(len(f), "3 mm", "20 mm", helix_angle=h, pitch_errors=f)
        for f, h in zip(errors, (0.3, -0.3), strict=True)
    ]
    base = gears[1].base_diameter / gears[1].reference_diameter
    for side in (1, -1):
        found = pair_gaps(hb.GearPair(*gears, backlash="80 um"), side, 60)
        exact = {3: 11e-6, 23: 9e-6, 33: 2e-6, 43: 9e-6}
        assert found == pytest.approx({p: side * base * f for p, f in exact.items()}, rel=1e-12)


@pytest.mark.parametrize("which", [0, 1])
def test_pitch_errors_of_an_eccentric_gear_are_its_run_out(which):
    """The eccentricity moves the tooth at the pitch point along the pitch circle by e sin(psi): when its middle is
    there, the mean of the gaps that run-out gives the driving and, negative, the back flanks is that of these pitch
    errors."""
    e, teeth = 10e-6, (25, 40)
    z = teeth[which]
    arcs = -e * np.sin(TURN * np.arange(z) / z)  # positive for a tooth that lags behind
    gears = [
        [hb.gears.Gear(n, "3 mm", "20 mm", **(given if i == which else {})) for i, n in enumerate(teeth)]
        for given in ({"runout": 2 * e}, {"pitch_errors": arcs})
    ]
    pair = hb.GearPair(*gears[0], backlash="80 um")
    drive, back = (gap_waves(pair, side)[0] for side in (1, -1))
    found = pair_gaps(hb.GearPair(*gears[1], backlash="80 um"), 1, z)
    times = middle_passes(pair, which) + np.arange(z)
    mean = [
        sum(side * w.amplitude * sin(TURN * t / w.meshes + w.phase) for side, w in ((1, drive), (-1, back))) / 2
        for t in times
    ]
    np.testing.assert_allclose([found.get(p, 0.0) for p in range(z)], mean, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_motion_of_a_drawing_closes_under_integration():
    """Teeth with run-out, pitch errors and loss of contact, integrated pair by pair from the state of the balance."""
    f = 1e-6 * np.random.default_rng(3).normal(0.0, 3.0, 18)
    pinion = hb.gears.Gear(18, "3 mm", "20 mm", tip_relief="12 um", pitch_errors=f, runout="16 um", runout_phase=0.5)
    wheel = hb.gears.Gear(30, "3 mm", "20 mm", tip_relief="12 um")
    pair = hb.GearPair(pinion, wheel, backlash="80 um")
    model, mesh = pair.model("60 N m", 0.06), hb.gears.tooth_mesh(pair, "60 N m")
    assert (model.mesh_order, mesh.meshes) == (18, 18)
    H, Omega = 18 * 16, 1.0 / 18
    problem = hb.HarmonicBalance(model, H, orders=range(1, H + 1))
    X = problem.start(Omega=Omega)
    assert problem.regime(X, Omega=Omega).tolist() == [1]
    b, k_0, alpha = pair.half_backlash, mesh.stiffness, pair.working_pressure_angle
    phase = 0.5 - TURN * middle_passes(pair, 0) / 18

    def right(tau, state):
        t, force = tau / TURN * 18, 0.0
        for flank in mesh.flanks:
            begin, length, side = flank.stiffness.nodes[0], flank.stiffness.length, flank.side
            for p in range(int(np.floor(t - length)), int(np.ceil(t - begin)) + 1):
                u = t - p
                if begin < u < length:
                    gap = float(flank.gap.at(np.array(u))) + side * f[p % 18] * cos(pinion.transverse_pressure_angle)
                    gap -= side * 8e-6 * sin(TURN * t / 18 + phase + side * alpha)
                    closed = side * state[0] - 1 - gap / b
                    force += side * float(flank.stiffness.at(np.array(u))) / k_0 * max(closed, 0.0)
        return [state[1], (model.F_m - force) / Omega**2 - 2 * model.zeta / Omega * state[1]]

    orders = np.arange(1, H + 1)
    state = [X[0] + X[1::2].sum(), float(orders @ X[2::2])]
    ends = np.unique(
        np.concatenate(
            [(flank.stiffness.nodes[[0, -1]][:, None] + np.arange(18)).ravel() % 18 for flank in mesh.flanks]
        )
    )
    start = np.array(state)
    for begin, end in zip([0.0, *ends], [*ends, 18.0], strict=True):
        if end > begin + 1e-12:
            found = scipy.integrate.solve_ivp(
                right,
                (TURN * begin / 18, TURN * end / 18),
                state,
                "DOP853",
                rtol=1e-7,
                atol=1e-7,
                first_step=(end - begin) / 40,
            )
            state = found.y[:, -1]
    np.testing.assert_allclose(state, start, rtol=0, atol=1e-3)


def test_loads_of_pairs_with_pitch_errors():
    """The tooth that leads carries the largest mean force; the sum of all pairs balances the mean load."""
    f = [0.0] * 20
    f[7] = -8e-6
    gears = hb.gears.Gear(20, "3 mm", "20 mm", pitch_errors=f), hb.gears.Gear(30, "3 mm", "20 mm")
    pair = hb.GearPair(*gears, backlash="80 um")
    problem = hb.HarmonicBalance(pair.model("150 N m", 0.1), 100, orders=range(1, 101))
    point = hb.trace(problem, "Omega", (0.011, 0.01095), stability=False, special=False)[0]
    loads = hb.analysis.tooth_loads(point, hb.gears.tooth_mesh(pair, "150 N m"))
    assert loads.force.shape[0] == 20 and np.argmax(loads.force.sum(axis=1)) == 7
    assert loads.forces.total[:, :1024].mean() == pytest.approx(pair.transverse_force(150), rel=2e-3)


def test_forces_of_pairs_with_run_out_are_those_of_the_contacts():
    """Sums over pairs, whose gaps have the sinusoid itself, against the law, whose levels are continuous cubics."""
    u = np.array([0.0, 0.5, 1.1, 1.6])
    stiffness, gap = (PathFunction.linear(u, values) for values in ([0.0, 0.6, 0.5, 0.0], [0.2, 0.0, 0.0, 0.1]))
    errors, waves = {1: 0.1, 2: -0.05}, (GapWave(0.1, 4, 0.7), GapWave(0.05, 2, -0.3))
    flanks = [Flank(side, stiffness, gap, 0.3, 0.2, errors, waves) for side in (1, -1)]
    contacts = mesh_contacts(flanks, 4)
    assert all(contact.level.continuous for contact in contacts.contacts)
    found = pair_forces(flanks, lambda t: 1.2 * np.sin(TURN * t / 4), 4)
    for p in range(4):
        t = p + found.position
        x = 1.2 * np.sin(TURN * t / 4)
        for side, force in ((1, found.drive), (-1, found.back)):
            law = MeshContacts(tuple(contact for contact in contacts.contacts if contact.side == side))
            total = PairForces(found.position, force, force, found.displacement).total[p]
            np.testing.assert_allclose(side * law.force(x, 0 * x, TURN * t / 4)[0], total, atol=1e-7)
    assert found.drive.max() > 0.3 and found.back.max() > 0.3


def test_periods_and_trains():
    pinion, wheel = (hb.gears.Gear(z, "3 mm", "20 mm", runout="20 um") for z in (20, 30))
    plain = [hb.gears.Gear(z, "3 mm", "20 mm") for z in (20, 30)]
    assert hb.GearPair(plain[0], wheel, "80 um").model(100, 0.04).mesh_order == 30
    both = hb.GearPair(pinion, wheel, "80 um")
    assert both.model(100, 0.04).mesh_order == 60
    one = hb.GearPair(pinion, plain[1], "80 um")
    assert one.model(100, 0.04, torque_orders={"1/2": 5.0}).mesh_order == 40
    mesh = hb.gears.Mesh.of("a", "b", one, "100 N m", 0.04)
    wheels = [hb.gears.Wheel.of("a", pinion, torque="100 N m"), hb.gears.Wheel.of("b", plain[1])]
    train = hb.gears.Train(wheels, [mesh], balance="b")
    assert train.orders["a-b"] == 20
    X = np.zeros(81)
    X[[0, 1, 4, 39, 42]] = 1.4, 0.1, 0.05, -0.2, 0.1
    two = [
        hb.HarmonicBalance(model, 40, orders=range(1, 41)).evaluate(X, Omega=0.03)[0]
        for model in (train, one.model(100, 0.04))
    ]
    np.testing.assert_allclose(two[0], two[1], rtol=0, atol=1e-9)
    assert pair_gaps(one, 1, 20) == {}


@pytest.mark.parametrize("place", [0.0, 1.0, -2.0])
def test_a_tooth_of_an_idler_is_the_same_in_both_meshes(place):
    """A tooth that leads opens the gap of the mesh that drives it and closes the next one, as many pitches later as the
    idler turns between the pitch points, less half a pitch, the distance of the loaded flanks."""
    z, errors = (25, 30, 40), [-6e-6 * (p == 7) for p in range(30)]
    gears = [hb.gears.Gear(n, "3 mm", "20 mm", pitch_errors=errors if n == 30 else ()) for n in z]
    pairs = hb.GearPair(*gears[:2], "80 um"), hb.GearPair(*gears[1:], "80 um")
    x, y = 82.5e-3 + 105e-3 * cos(place), 105e-3 * sin(place)
    wheels = [
        hb.gears.Wheel.of("in", gears[0], torque=100.0),
        hb.gears.Wheel.of("idler", gears[1], x=82.5e-3),
        hb.gears.Wheel.of("out", gears[2], x=x, y=y),
    ]
    meshes = [hb.gears.Mesh.of("in", "idler", pairs[0], 100.0), hb.gears.Mesh.of("idler", "out", pairs[1], 120.0)]
    train = hb.gears.Train(wheels, meshes, balance="out")
    pitch = [mesh.pitch_phase / TURN for mesh in meshes]
    turned = (pi - place) % TURN * 30 / TURN - 0.5  # the idler turns clockwise
    begin = 7.0, (7.0 + pitch[0] + turned - pitch[1]) % 30
    t = 30 * (np.arange(30 * 200) + 0.5) / 6000
    for element, at, pair, side in zip(train.system().elements, begin, pairs, (1, -1), strict=True):
        touches = np.zeros(len(t), dtype=bool)
        for contact in element.law.contacts:
            if contact.side > 0:
                level = np.where(contact.stiffness(TURN * t / 30) > 0, contact.level(TURN * t / 30), np.nan)
                moved = (level - np.nanmedian(level)) * train.b_c
                touches |= np.abs(moved) > 1e-9
                np.testing.assert_allclose(moved[np.abs(moved) > 1e-9], side * 6e-6 * cos(pi / 9), rtol=1e-6)
        np.testing.assert_array_equal(touches, (t - at) % 30 < pair.contact_ratio)


@pytest.mark.parametrize("place", [0.0, 1.0, -2.0])
@pytest.mark.parametrize("helix", [0.0, 0.3])
def test_the_eccentricity_of_an_idler_is_the_same_in_both_meshes(place, helix):
    """Its centre is displaced by e in a direction that turns with it: the gaps of both meshes, whose flanks are a tooth
    apart and whose faces differ, are the components of one vector along their lines of action."""
    widths = "20 mm", "30 mm", "30 mm"
    gears = [
        hb.gears.Gear(z, "3 mm", width, helix_angle=h, profile_shift=x, runout=e)
        for z, width, h, x, e in zip(
            (25, 30, 40), widths, (helix, -helix, helix), (0.1, 0.3, 0.2), (0.0, 10e-6, 0.0), strict=True
        )
    ]
    pairs = hb.GearPair(*gears[:2], "80 um"), hb.GearPair(*gears[1:], "80 um")
    first, second = (pair.working_center_distance for pair in pairs)
    at = (0.0, 0.0), (first, 0.0), (first + second * cos(place), second * sin(place))
    wheels = [
        hb.gears.Wheel.of(name, gear, x=x, y=y, torque=100.0 * (name == "in"), moves="plane")
        for name, gear, (x, y) in zip(("in", "idler", "out"), gears, at, strict=True)
    ]
    meshes = [hb.gears.Mesh.of("in", "idler", pairs[0], 100.0), hb.gears.Mesh.of("idler", "out", pairs[1], 120.0)]
    train = hb.gears.Train(wheels, meshes, balance="out")
    tau, angles = TURN * (np.arange(3000) + 0.5) / 3000, []
    for element, w in zip(train.system().elements, train.mesh_vectors().T, strict=True):
        contact = next(contact for contact in element.law.contacts if contact.side > 0)
        closed = contact.stiffness(tau) > 0
        columns = np.column_stack([np.exp(1j * tau), np.exp(-1j * tau), np.ones(3000)])[closed]
        wave = np.linalg.lstsq(columns, contact.level(tau[closed]) * train.b_c, rcond=None)[0]
        n = w[3] + 1j * w[4]  # the gap opens by -Re(conj(n) e exp(i (angle - tau))), the idler turns clockwise
        eccentricity = -2 * wave[1] / np.conj(n)
        assert abs(eccentricity) == pytest.approx(5e-6, rel=1e-4)
        angles.append(np.angle(eccentricity))
    assert np.exp(1j * (angles[1] - angles[0])) == pytest.approx(1.0, abs=1e-4)


def test_run_out_in_files(tmp_path):
    from hbgear.io.machines.machine_file import Machine, read_machine, write_machine

    pinion = hb.gears.Gear(20, "3 mm", "20 mm", runout="20 um", runout_phase="30 deg", pitch_errors=[5e-6] + [0.0] * 19)
    machine = Machine(hb.GearPair(pinion, hb.gears.Gear(30, "3 mm", "20 mm"), "80 um"), 100.0, 0.04)
    write_machine(machine, tmp_path / "pair.toml")
    model = read_machine(tmp_path / "pair.toml").model()
    assert model == machine.model()
    assert (model.mesh_order, model.parameters["runout_pinion"]) == (20, 20.0)
    assert model.replace(runout_pinion=10.0).pair.pinion.runout == 10e-6
    assert "runout_wheel" not in model.parameters


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"pitch_errors": "5 um"}, "pitch_errors = '5 um' must be a sequence with one length for each tooth"),
        ({"pitch_errors": ["5 um", "0 um"]}, "pitch_errors has 2 values for 20 teeth; give one for each tooth"),
        ({"pitch_errors": [1e-6] * 19 + [5.0]}, "has the value 5 m, beyond any machine"),
        ({"pitch_errors": [float("nan")] + [0.0] * 19}, "pitch_errors"),
        ({"runout": "20 N"}, "runout = '20 N' must be a quantity in m"),
    ],
)
def test_errors_that_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        hb.gears.Gear(20, "3 mm", "20 mm", **fields)


def test_errors_that_a_mesh_does_not_have():
    pinion = hb.gears.Gear(20, "3 mm", "20 mm", runout="20 um")
    pair = hb.GearPair(pinion, hb.gears.Gear(30, "3 mm", "20 mm", runout="20 um"), "80 um")
    one = hb.GearPair(pinion, hb.gears.Gear(30, "3 mm", "20 mm"), "80 um")
    for option, given in (({"mesh": "tangent"}, "mesh = 'tangent'"), ({"cycle": pair.mesh(100)}, "a cycle")):
        with pytest.raises(ValueError, match=f"pitch_errors and runout .* pairs of teeth, and {given} has one gap"):
            one.model(100, 0.04, **option)
    long = hb.GearPair(pinion, hb.gears.Gear(101, "3 mm", "20 mm", runout="20 um"), "80 um")
    with pytest.raises(ValueError, match="repeat after 2020 meshes, and at most 250 can be computed"):
        long.model(100, 0.04)
    contacts = hb.gears.tooth_mesh(pair, 100).contacts(pair.half_backlash)
    with pytest.raises(ValueError, match="period of 60 meshes, and mesh_order = 1 is not a multiple"):
        hb.SpurPair(e=(), contacts=contacts)
