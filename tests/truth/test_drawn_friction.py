"""Friction between the teeth of a drawing against the equations of both gears, integrated apart, and closed forms.

J_1 th_1'' = T_1 - M_1,   J_2 th_2'' = M_2 - T_2,   M = sum over pairs of N (r_b +- mu sign(s - s_P) rho(s))
"""

import numpy as np
import pytest
from machines import gear_pair
from scipy.integrate import solve_ivp

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.gears.mesh.tooth_contacts import Flank, PathFunction
from hbgear.gears.mesh.tooth_friction import friction_mesh

MU, TORQUE, ZETA = 0.08, 200.0, 0.04
PAIR = gear_pair()
PINION, WHEEL = PAIR.pinion, PAIR.wheel
SUPPORTS = (hb.gears.Support("3e8 N/m", axial="1e8 N/m", tilt="5e5 N m/rad"),) * 2


def approach_and_recess(pair):
    """Return the path of contact before and behind the pitch point in base pitches."""
    pitch = pair.base_radii[0] * np.tan(pair.working_pressure_angle)
    return (pitch - pair.path[0]) / pair.base_pitch, (pair.path[1] - pitch) / pair.base_pitch


class TwoGears:
    """Both rotations of the pair in SI units, and the mean power at both shafts."""

    def __init__(self, torque_2, speed):
        self.r, self.J = PAIR.base_radii, (PINION.inertia_used, WHEEL.inertia_used)
        mesh = hb.gears.tooth_mesh(PAIR, TORQUE)
        self.flank, self.eps = mesh.flanks[0], PAIR.contact_ratio
        self.c = 2 * ZETA * np.sqrt(PAIR.equivalent_mass * mesh.stiffness)
        self.torques, self.mesh_rate = (TORQUE, torque_2), speed * PINION.teeth / (2 * np.pi)
        self.approach = approach_and_recess(PAIR)[0]

    def torques_of_mesh(self, t, gap, rate):
        """Return M_1 and M_2 for pairs that touch on the driving flanks, with the damper along the line of action."""
        u, found = t * self.mesh_rate % 1.0, np.array(self.r) * self.c * rate
        for s in (u, u + 1.0):
            if s < self.eps:
                x = np.array(s)
                N = float(self.flank.stiffness.at(x)) * max(gap - PAIR.half_backlash - float(self.flank.gap.at(x)), 0)
                rho = PAIR.path[0] + s * PAIR.base_pitch
                side = MU * np.sign(s - self.approach)
                found += N * (np.array(self.r) + side * np.array([rho, PAIR.tangent_length - rho]))
        return found

    def steady(self, periods=45):
        """Return half the range of the gap in half backlashes and the mean powers over the last period."""
        T = 1 / self.mesh_rate

        def rates(t, y):
            M = self.torques_of_mesh(t, y[0], y[1])
            turn = (self.torques[0] - M[0]) / self.J[0], (M[1] - self.torques[1]) / self.J[1]
            return [y[1], self.r[0] * turn[0] - self.r[1] * turn[1], *M]

        y = np.array([1.3 * PAIR.half_backlash, 0.0, 0.0, 0.0])
        breaks = np.unique(np.mod([0.0, self.eps, self.approach], 1.0))
        for n in range(periods):
            gaps, begin = [], y[2:].copy()
            for a, b in zip(breaks, [*breaks[1:], 1.0], strict=True):
                span = (n + a) * T + 1e-13 * T, (n + b) * T - 1e-13 * T
                run = solve_ivp(rates, span, y, rtol=1e-9, atol=1e-13)
                y, gaps = run.y[:, -1], [*gaps, run.y[0]]
        x = np.concatenate(gaps) / PAIR.half_backlash
        return 0.5 * np.ptp(x), (y[2:] - begin) / T


@pytest.mark.slow
def test_torsion_is_the_motion_of_both_gears():
    model = PAIR.model(TORQUE, ZETA, friction=MU)
    Omega = 0.7
    speed = model.scales.pinion_speed(Omega) * np.pi / 30
    # the load of the relative rotation fixes the torque of the wheel
    r, J, m = PAIR.base_radii, (PINION.inertia_used, WHEEL.inertia_used), PAIR.equivalent_mass
    load = model.F_m * model.scales.force
    torque_2 = (load / m - r[0] * TORQUE / J[0]) * J[1] / r[1]
    half, M = TwoGears(torque_2, speed).steady()
    problem = hb.HarmonicBalance(model, 48)
    point = hb.trace(problem, "Omega", (Omega, Omega - 0.001), special=False, stability=False)[0]
    found = hb.analysis.machine_quantities(point)
    assert found["dte, half peak-to-peak"][0] == pytest.approx(half * PAIR.half_backlash * 1e6, rel=2e-4)
    power = M * speed * np.array([1, PINION.teeth / WHEEL.teeth])
    assert found["power loss"][0] == pytest.approx(power[0] - power[1], rel=2e-4)
    assert found["efficiency"][0] == pytest.approx(power[1] / power[0], abs=2e-6)


@pytest.mark.parametrize("wheel", [40, -60])
def test_static_efficiency_of_equal_pairs(wheel):
    """Pairs that share the load equally lose mu pi (1/z_1 +- 1/z_2) (1 - eps + eps_1^2 + eps_2^2)."""
    gear = hb.gears.Gear(teeth=abs(wheel), module="3 mm", face_width="20 mm", internal=wheel < 0)
    pair = hb.GearPair(PINION, gear, backlash="80 um")
    k = PathFunction.linear([0.0, pair.contact_ratio], [2e8, 2e8])
    gap = PathFunction.linear([0.0, pair.contact_ratio], [0.0, 0.0])
    mesh = hb.gears.ToothMesh((Flank(1, k, gap), Flank(-1, k, gap)), 2e8 * pair.contact_ratio, 5000.0, pair)
    first, last = approach_and_recess(pair)
    loss = MU * np.pi * (1 / 25 + 1 / wheel) * (1 - first - last + first**2 + last**2)
    found = friction_mesh(mesh, MU)
    # to first order in mu: friction also changes the torque at the same normal force
    lever = np.tan(pair.working_pressure_angle)
    order_2 = loss**2 + MU * lever * loss
    assert 1 - found.output == pytest.approx(loss, abs=1e-3 * loss + order_2)
    # exactly: the loss over the normal force, with a displacement that gives every pair its share
    sliding, tau = found.contacts.sliding, 2 * np.pi * (np.arange(20000) + 0.5) / 20000
    count = 1 + (tau / (2 * np.pi) + 1 < pair.contact_ratio)
    forces = found.contacts.sliding_forces(pair.contact_ratio / count, tau)
    np.testing.assert_allclose(forces.normal, 1.0, rtol=1e-12)
    assert sliding.relative * forces.slide.mean() == pytest.approx(loss, rel=1e-4)
    assert forces.across.mean() == pytest.approx(MU * _mean_sign(first, last), rel=1e-3)


def _mean_sign(first, last):
    """Return the mean of share times sign(s - s_P) of pairs that share the load equally."""
    s = (np.arange(200000) + 0.5) / 200000 * (first + last)
    share = np.where((s < first + last - 1) | (s > 1), 0.5, 1.0)
    return float(np.sum(share * np.sign(s - first)) * (first + last) / 200000)


def test_back_flanks_lose_the_same_power():
    mesh = hb.gears.tooth_mesh(PAIR, TORQUE)
    loss = [abs(1 - friction_mesh(mesh, MU, side).output) for side in (1, -1)]
    assert loss[0] == pytest.approx(loss[1], rel=0.02) and loss[0] > 0.01
    forward, backward = (PAIR.model(side * TORQUE, ZETA, friction=MU) for side in (1, -1))
    slow = {}
    for model in (forward, backward):
        curve = hb.trace(hb.HarmonicBalance(model, 24), "Omega", (0.05, 0.0499), special=False, stability=False)
        slow[model.F_m > 0] = hb.analysis.machine_quantities(curve)["efficiency"][0]
    static = friction_mesh(mesh, MU, 1).output, 1 / friction_mesh(mesh, MU, -1).output
    assert slow[True] == pytest.approx(static[0], abs=1e-4) and slow[False] == pytest.approx(static[1], abs=1e-4)


def test_space_and_line_of_action_agree_and_supports_carry_the_friction():
    """The motion across the line of action does not change the gap; the supports carry N n + across t."""
    Omega = 0.3
    models = [PAIR.model(TORQUE, ZETA, form, supports=SUPPORTS, friction=MU) for form in ("spatial", "bearings")]
    points = [
        hb.trace(hb.HarmonicBalance(one, 8), "Omega", (Omega, Omega - 0.001), special=False, stability=False)[0]
        for one in models
    ]
    np.testing.assert_allclose(points[0].X[:17], points[1].X[:17], rtol=0, atol=1e-9)
    problem, X = points[0].problem, points[0].X
    mean = problem.motion(X, Omega=Omega)[:2, 0]  # x and y of the pinion; the wheel lies in the direction x
    law = problem.model.system().elements[0].law
    tau = 2 * np.pi * (np.arange(4096) + 0.5) / 4096
    row, k = problem.rows(X)[0], np.arange(1, 9)[:, None]
    d = row[0] + row[1::2] @ np.cos(k * tau) + row[2::2] @ np.sin(k * tau)
    forces, alpha = law.sliding_forces(d, tau), PAIR.working_pressure_angle
    n, t = np.array([np.sin(alpha), np.cos(alpha)]), np.array([-np.cos(alpha), np.sin(alpha)])
    reaction = 3e8 / models[0].k_mean * mean
    np.testing.assert_allclose(reaction, -(forces.normal.mean() * n + forces.across.mean() * t), atol=3e-5)
    assert abs(forces.across.mean()) > 3e-4


def pair_with_helix(angle):
    """Return the pair with another helix angle [deg]."""
    gears = (
        hb.gears.Gear(teeth=z, module="3 mm", face_width="20 mm", helix_angle=f"{side * angle} deg")
        for z, side in ((25, 1), (40, -1))
    )
    return hb.GearPair(*gears, backlash="80 um")


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0, 15])
def test_a_train_of_one_mesh_is_the_pair(angle):
    drawn = pair_with_helix(angle)
    mesh = hb.gears.Mesh.of("a", "b", drawn, TORQUE, ZETA, friction=MU)
    wheels = [hb.gears.Wheel.of("a", drawn.pinion, torque=TORQUE), hb.gears.Wheel.of("b", drawn.wheel)]
    train = hb.gears.Train(wheels, [mesh], balance="b")
    pair = drawn.model(TORQUE, ZETA, friction=MU)
    pair = pair.replace(F_m=pair.F_m / friction_mesh(hb.gears.tooth_mesh(drawn, TORQUE), MU).load)
    problem = hb.HarmonicBalance(pair, 8)
    X = solve(problem, problem.start(Omega=0.3), {"Omega": 0.3}).X
    whole = hb.HarmonicBalance(train, 8, samples=8192)
    assert whole.layout.elements[1:] == ("a-b friction 1", "a-b friction 2", "a-b friction 3")
    Omega = 0.3 * pair.scales.frequency / train.scales.frequency  # lengths of the pair are along the normal
    found = solve(whole, whole.start(Omega=Omega), {"Omega": Omega}).X
    np.testing.assert_allclose(whole.rows(found)[0], X, rtol=0, atol=2e-5)
    slow = {"special": False, "stability": False}
    of_train = hb.analysis.machine_quantities(hb.trace(whole, "Omega", (Omega, Omega - 0.001), **slow))
    of_pair = hb.analysis.machine_quantities(hb.trace(problem, "Omega", (0.3, 0.299), **slow))
    assert of_train["power loss"][0] == pytest.approx(of_pair["power loss"][0], rel=1e-4)
    assert of_train["efficiency"][0] == pytest.approx(of_pair["efficiency"][0], abs=1e-5)


def test_friction_and_errors_against_the_drive_are_refused():
    mesh = hb.gears.Mesh.of("a", "b", PAIR, TORQUE, ZETA, friction=MU)
    wheels = [hb.gears.Wheel.of("a", PINION, torque=TORQUE), hb.gears.Wheel.of("b", WHEEL)]
    driven = hb.gears.Mesh.of("c", "b", PAIR, TORQUE, friction=MU)
    wheels.append(hb.gears.Wheel.of("c", PINION))
    with pytest.raises(
        ValueError, match=r"friction of the mesh c-b is .* 'b' drives 'c'; exchange .* or give friction=0"
    ):
        hb.gears.Train(wheels, [mesh, driven], balance="c")
    eccentric = hb.GearPair(hb.gears.Gear(PINION.teeth, "3 mm", "20 mm", runout="10 um"), WHEEL, "80 um")
    driven = hb.gears.Mesh.of("c", "b", eccentric, TORQUE)
    with pytest.raises(ValueError, match=r"errors of single teeth of the mesh c-b are .* exchange .* or omit them"):
        hb.gears.Train(wheels, [mesh, driven], balance="c")
    idle = hb.gears.Train(wheels, [mesh, driven], balance="b")
    assert idle._kinematics.backward == (False, False)


def test_benedict_kelley():
    oil = hb.gears.BenedictKelley("10 mPa s", "1000 r/min", "0.4 um")
    # lb/in, cP, in/s and microinch
    w, v_s, v_r, S = 200e3 * 0.0254 / 4.4482216, 2 / 0.0254, 10 / 0.0254, 0.4e-6 / 2.54e-8
    expected = 0.0127 * 50 / (50 - S) * np.log10(3.17e8 * w / (10 * v_s * v_r**2))
    assert oil.coefficient(200e3, -2.0, 10.0) == pytest.approx(expected, rel=1e-9)
    mesh = hb.gears.tooth_mesh(PAIR, TORQUE)
    values = [1 - friction_mesh(mesh, hb.gears.BenedictKelley("10 mPa s", f"{n} r/min")).output for n in (300, 3000)]
    # mu falls by 3 * 0.0127 if the speed grows by ten; between them lie the losses of constant coefficients
    per_mu = (1 - friction_mesh(mesh, 0.05).output) / 0.05
    assert (values[0] - values[1]) / per_mu == pytest.approx(0.0381, rel=0.02)
    with pytest.raises(ValueError, match="roughness = 8e-07"):
        hb.gears.BenedictKelley("10 mPa s", "1000 r/min", "0.8 um")  # the formula has a pole at 1.27 um
    with pytest.raises(ValueError, match=r"at 1e\+05 r/min .* falls to -0.0.* the formula does not hold"):
        friction_mesh(mesh, hb.gears.BenedictKelley("1 Pa s", "100000 r/min"))


@pytest.mark.parametrize("teeth", [40, -60])
def test_coefficient_on_the_path_by_the_velocities_of_both_flanks(teeth):
    """Of one pair in contact, which carries the whole force; within 0.05 base pitches of the pitch point the sliding
    velocity is that at 0.05."""
    gear = hb.gears.Gear(teeth=abs(teeth), module="3 mm", face_width="20 mm", internal=teeth < 0)
    pair, omega = hb.GearPair(PINION, gear, backlash="80 um"), 60.0
    mesh, oil = hb.gears.tooth_mesh(pair, TORQUE), hb.gears.BenedictKelley("10 mPa s", omega, "0.3 um")
    first = approach_and_recess(pair)[0]
    s = np.append(np.linspace(pair.contact_ratio - 0.99, 0.99, 60), first + np.array([-0.0501, -0.0499, 0.0499]))
    s = s[s < 0.99]
    other = omega * 25 / abs(teeth)

    def flanks(s):
        rho = pair.path[0] + s * pair.base_pitch
        return omega * rho, other * abs(pair.tangent_length - rho)

    total, away = sum(flanks(s)), np.where(np.abs(s - first) < 0.05, first + 0.05, s)
    sliding = np.subtract(*flanks(away))
    mu = oil.coefficient(TORQUE / pair.base_radii[0] / pair.face_width, sliding, total)
    forces = friction_mesh(mesh, oil).contacts.sliding_forces(np.full(s.shape, 5e-5), 2 * np.pi * s)
    np.testing.assert_allclose(forces.across / forces.normal, mu * np.sign(s - first), rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"friction": 0.05, "mesh": "tangent"},
            "friction needs the force on every pair of teeth, and mesh = 'tangent'",
        ),
        ({"friction": 0.7}, "friction = 0.7 is beyond any machine"),
        ({"friction": -0.1}, r"friction = -0.1 must not be negative"),
        ({"friction": None}, "friction = None must be a coefficient such as 0.05, or BenedictKelley"),
    ],
)
def test_refusals(options, message):
    with pytest.raises(ValueError, match=message):
        PAIR.model(TORQUE, ZETA, **options)


def test_files_and_parameters(tmp_path):
    text = """torque = "200 N m"\ndamping = 0.04\nfriction = FRICTION\npair = { backlash = "80 um" }
    pinion = { teeth = 25, module = "3 mm", face_width = "20 mm" }\nwheel = { teeth = 40 }\n"""
    path = tmp_path / "pair.toml"
    formula = '{ viscosity = "0.01 Pa s", speed = 100.0 }'
    for written, value in (("0.05", 0.05), (formula, hb.gears.BenedictKelley(0.01, 100.0))):
        path.write_text(text.replace("FRICTION", written))
        machine = hb.io.read_machine(path)
        assert machine.friction == value and ("friction" in machine.model().parameters) == isinstance(value, float)
        from hbgear.io.machines.machine_file import write_machine

        write_machine(machine, tmp_path / f"{type(value).__name__}.toml")
        assert hb.io.read_machine(tmp_path / f"{type(value).__name__}.toml") == machine
        curve = hb.trace(hb.HarmonicBalance(machine.model(), 4), "Omega", (1.5, 1.48), special=False, stability=False)
        curve.save(tmp_path / "curve.npz")
        loaded = hb.analysis.machine_quantities(hb.load(tmp_path / "curve.npz"))
        np.testing.assert_allclose(loaded["power loss"], hb.analysis.machine_quantities(curve)["power loss"])
    path.write_text(text.replace("FRICTION", "2.0"))
    with pytest.raises(ValueError, match=r"line 3.*friction = 2 is beyond any machine"):
        hb.io.read_machine(path)
    model = hb.gears.DrawnPair(PAIR, TORQUE, ZETA, friction=0.05)
    assert model.replace(friction=0.06).equations.contacts.sliding != model.equations.contacts.sliding
