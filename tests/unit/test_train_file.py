"""Trains as files, on the command line and as figures."""

import math
import re
from fractions import Fraction

import numpy as np
import pytest
import scipy
from machines import gear_pair
from typer.testing import CliRunner

import hbgear as hb
from hbgear.analysis.quantities.engineering_quantities import forces_along
from hbgear.cli.app import app
from hbgear.cli.machine_report.speed_ranges import contact_lost, jumps_possible, without_stable_motion
from hbgear.cli.machine_report.speeds import factor_text, recommendation, resonances, show_speeds
from hbgear.io.machines.model_file import kind_of_file
from hbgear.io.machines.toml_file import TomlFileError
from hbgear.io.machines.train_file import read_train
from hbgear.mechanics.models import describe
from hbgear.mechanics.structures.scales import Scales

TEXT = """balance = "out"

[[wheel]]
name = "in"
torque = "100 N m"
gear = { teeth = 25, module = "3 mm", face_width = "20 mm" }

[[wheel]]
name = "middle"
x = "82.5 mm"
gear = { teeth = 30, module = "3 mm", face_width = "20 mm" }

[[wheel]]
name = "flange"
inertia = "0.01 kg m^2"

[[wheel]]
name = "out"
teeth = 40
base_radius = "56.38155725 mm"
inertia = "0.004 kg m^2"
x = "187.5 mm"

[[shaft]]
first = "middle"
second = "flange"
torsion = "2e4 N m/rad"

[[bearing]]
at = "flange"
turn = 0.0

[[mesh]]
first = "in"
second = "middle"
torque = "100 N m"
damping = 0.04
pair = { backlash = "80 um" }

[[mesh]]
first = "middle"
second = "out"
k_mean = "4e8 N/m"
half_backlash = "40 um"
eps = [0.2]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "train.toml"
    path.write_text(TEXT)
    return path


def test_safe_speeds_of_a_double_helical_pair_are_those_of_both_halves():
    """The left half keeps contact at points where the right one, later by an eighth of a cycle, loses it."""
    model = hb.gears.DoubleHelicalPair(zeta=0.05, stagger=np.pi / 4)
    curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", model.default_span, stability=False)
    speeds = model.scales.pinion_speed(curve.values)
    lowest = np.array([[point.samples(name, 2000)[1].min() for name in model.mesh_names] for point in curve])
    lost = (lowest < 1).any(axis=1)
    assert (lost != (lowest[:, 0] < 1)).any()
    ranges = contact_lost(model, curve)
    assert [any(low <= n <= high for low, high in ranges) for n in speeds] == lost.tolist()


def test_a_file_is_the_train(file):
    train = read_train(file)
    pair = gear_pair((25, 30))
    wheels = [
        hb.gears.Wheel.of("in", pair.pinion, torque=100.0),
        hb.gears.Wheel.of("middle", pair.wheel, x=0.0825),
        hb.gears.Wheel("flange", 0.01),
        hb.gears.Wheel("out", 0.004, teeth=40, base_radius=0.05638155725, x=0.1875),
    ]
    meshes = [
        hb.gears.Mesh.of("in", "middle", pair, 100.0, 0.04),
        hb.gears.Mesh("middle", "out", 4e8, 4e-5, eps=(0.2,)),
    ]
    made = hb.gears.Train(
        wheels, meshes, [hb.gears.Shaft("middle", "flange", 2e4)], [hb.gears.Bearing("flange")], balance="out"
    )
    assert train == made and kind_of_file(file) == "train"


SHARED = """balance = "ring"

[[wheel]]
name = "sun"
torque = "300 N m"
gear = { teeth = 24, module = "3 mm", face_width = "20 mm" }

[[wheel]]
name = "ring"
gear = { teeth = 72, module = "3 mm", face_width = "20 mm", internal = true, tip_diameter = "212.5 mm" }
""" + "".join(
    f"""
[[wheel]]
name = "p{n}"
x = {x}
gear = {{ teeth = 24, module = "3 mm", face_width = "20 mm" }}

[[mesh]]
first = "sun"
second = "p{n}"
torque = "150 N m"
pair = {{ backlash = "40 um" }}

[[mesh]]
first = "p{n}"
second = "ring"
torque = "150 N m"
pair = {{ backlash = "40 um" }}
"""
    for n, x in ((1, 0.072), (2, -0.072))
)
"""Two planets that share the load."""


def test_a_mesh_of_a_pair_has_the_static_torque_of_the_train(file):
    train = read_train(file)
    file.write_text(TEXT.replace('torque = "100 N m"\ndamping', "damping"))
    found = read_train(file)
    assert found.meshes[0].k_mean == pytest.approx(train.meshes[0].k_mean, rel=1e-12)
    assert found.meshes[0].torque == pytest.approx(100.0) and found.mesh_torques == {
        "in-middle": pytest.approx(100.0),
        "middle-out": pytest.approx(120.0),
    }
    file.write_text(SHARED)
    assert set(read_train(file).mesh_torques.values()) == {None}
    file.write_text(SHARED.replace('torque = "150 N m"\n', "", 1))
    with pytest.raises(TomlFileError, match="a mesh of a pair needs the torque on the first wheel"):
        read_train(file)


IDLER = """[[wheel]]
name = "in"
torque = "50 N m"
gear = { teeth = 20, module = "2 mm", face_width = "20 mm" }

[[wheel]]
name = "idler"
x = "55 mm"
gear = { teeth = 35, module = "2 mm", face_width = "20 mm" }

[[wheel]]
name = "out"
x = "140 mm"
torque = "-125 N m"
gear = { teeth = 50, module = "2 mm", face_width = "20 mm" }

[[mesh]]
first = "in"
second = "idler"
pair = { backlash = "60 um" }

[[mesh]]
first = "idler"
second = "out"
pair = { backlash = "60 um" }
"""


@pytest.mark.slow
def test_speeds_are_safe_only_with_stable_motions_and_contact_in_all_meshes(file):
    file.write_text(IDLER)
    train = read_train(file)
    curve = hb.trace(hb.HarmonicBalance(train, 12), "Omega", (1.15, 0.85))
    lost, unknown = contact_lost(train, curve), without_stable_motion(train, curve)
    speeds, stable = np.asarray(train.scales.pinion_speed(curve.values)), np.asarray(curve.stable)
    contact = np.asarray(curve.regime) == 0

    def within(ranges, speed):
        return any(low <= speed <= high for low, high in ranges)

    assert all(within(lost, speeds[i]) for i in np.flatnonzero(~contact.all(axis=1))[1:-1])
    for speed in np.linspace(speeds.min(), speeds.max(), 400):
        near = [i for i in range(len(speeds) - 1) if min(speeds[i : i + 2]) <= speed <= max(speeds[i : i + 2])]
        assert within(unknown, speed) or any(stable[i] or stable[i + 1] for i in near)
    assert sum(high - low for low, high in unknown) > 1000
    slower = hb.trace(hb.HarmonicBalance(train, 12), "Omega", (0.65, 0.55))
    contact, speeds = np.asarray(slower.regime) == 0, np.asarray(train.scales.pinion_speed(slower.values))
    second = np.flatnonzero(contact[:, 0] & ~contact[:, 1])  # contact of the second mesh alone is lost
    assert len(second) > 2 and all(within(contact_lost(train, slower), speeds[i]) for i in second[1:-1])
    result = CliRunner().invoke(app, ["speed", str(file), "--from", "35000r/min", "--to", "26000r/min"])
    text = " ".join(result.output.split())
    assert result.exit_code == 0 and "no stable motion of the mesh period: " in text, text
    assert "where motions of twice the period leave: hbgear switch FILE LABEL" in text


@pytest.mark.slow
def test_safe_speeds_and_resonances_of_all_meshes_of_a_planetary_set(capsys):
    """Against forces of all meshes over a period: a mesh without force at some phase has lost its contact.

    The ring loses contact where the sun does not.
    """
    model = hb.gears.PlanetarySet()
    curve = hb.trace(hb.HarmonicBalance(model, 12), "Omega", (1.75, 1.25))
    forces = forces_along(curve, model.mesh_names)[1]
    smallest = np.array([[force.min() for force in each] for each in forces])
    speeds = np.asarray(model.scales.pinion_speed(curve.values))
    separated = np.flatnonzero((smallest[:, 4:] <= 0).any(axis=1))
    assert len(separated) > 20 and (smallest[:, :4] > 0).all()
    low, high = speeds[separated].min(), speeds[separated].max()
    assert contact_lost(model, curve) == [(pytest.approx(low, rel=2e-3), pytest.approx(high, rel=2e-3))]
    factors = np.array([[force.max() / force.mean() for force in each] for each in forces])
    factors[~np.asarray(curve.stable)] = 0.0
    largest = max(resonances(model, curve), key=lambda one: one.factor)
    assert largest.mesh.startswith("ring") and largest.factor == pytest.approx(factors.max(), rel=0.02)
    show_speeds(model, curve)
    shown = " ".join(capsys.readouterr().out.split())
    found = re.search(r"loss of contact is possible: (\d+) to (\d+) r/min", shown)
    assert [float(x) for x in found.groups()] == pytest.approx([low, high], rel=2e-3) and "linear" not in shown
    for jump in curve.jumps():
        at = min(range(len(curve)), key=lambda i: np.linalg.norm(curve.X[i] - jump.before.X))
        assert float(factor_text(model, jump.before, 5)) == pytest.approx(
            max(force.max() / force.mean() for force in forces[at]), rel=1e-3
        )


def test_mesh_frequency_and_usual_range_of_two_stages():
    """The first mesh has the frequency of its teeth; its natural frequency lies in the range of a trace."""
    names, teeth = ("in", "first", "second", "out"), (23, 61, 19, 57)
    wheels = [
        hb.gears.Wheel(name, 1e-3, teeth=z, base_radius=z * 1e-3, torque=10.0 if name == "in" else 0.0)
        for name, z in zip(names, teeth, strict=True)
    ]
    meshes = [hb.gears.Mesh("in", "first", 3e8, 4e-5), hb.gears.Mesh("second", "out", 4e8, 5e-5)]
    train = hb.gears.Train(wheels, meshes, [hb.gears.Shaft("first", "second", torsion=3e5)], balance="out")
    assert (train.orders["in-first"], train.orders["second-out"]) == (61.0, 19.0)
    natural = np.sqrt(3e8 * ((23e-3) ** 2 + (61e-3) ** 2) / 1e-3) / (
        2 * np.pi
    )  # Hz, of the first mesh with fixed shafts
    first, last = (float(train.scales.mesh_frequency(end)) for end in train.default_span)
    assert (first, last) == pytest.approx((1.5 * natural, 0.3 * natural), rel=1e-12)
    assert train.scales.pinion_speed(train.default_span[0]) == pytest.approx(60 * first / 23, rel=1e-12)


@pytest.mark.filterwarnings("ignore:no element comes near a breakpoint")
@pytest.mark.parametrize("zeta", [0.05, 0.15])
def test_speed_of_a_resonance_is_located_between_the_points_of_a_curve(zeta):
    """Without loss of contact the transmission error is e times the transmissibility of an oscillator."""
    pair = hb.SpurPair(zeta=zeta, F_m=0.9, reference=(38000.0, 37.6e-6, 15000.0, 25))
    curve = hb.trace(hb.HarmonicBalance(pair, 3), "Omega", (1.4, 0.6))
    Omega = np.sqrt((np.sqrt(1 + 8 * zeta**2) - 1) / (4 * zeta**2))
    size = 0.05 * np.sqrt((1 + (2 * zeta * Omega) ** 2) / ((1 - Omega**2) ** 2 + (2 * zeta * Omega) ** 2))
    (found,) = resonances(pair, curve)
    assert found.speed == pytest.approx(pair.scales.pinion_speed(Omega), rel=1e-6)
    assert found.transmission_error == pytest.approx(37.6 * size, rel=1e-6)


class HardeningPair(hb.Duffing):
    """Duffing oscillator with units, which jumps without a breakpoint of its law."""

    scales = Scales(1000.0, 1e-5, 1e4, 20.0)


def test_jumps_without_loss_of_contact_are_no_safe_speeds(capsys):
    """Between both folds of a Duffing oscillator two motions are stable."""
    model = HardeningPair()
    curve = hb.trace(hb.HarmonicBalance(model, 3), "Omega", (0.6, 1.6))
    low, high = sorted(float(model.scales.pinion_speed(jump.value)) for jump in curve.jumps())
    assert jumps_possible(model, curve, []) == [(pytest.approx(low), pytest.approx(high))]
    assert jumps_possible(model, curve, [(0.0, 2 * high)]) == []
    show_speeds(model, curve)
    shown = " ".join(capsys.readouterr().out.split())
    assert f"jumps without loss of contact: {low:.0f} to {high:.0f} r/min" in shown and "linear" not in shown
    assert recommendation(model, curve) == f"recommendation: avoid {low:.0f} to {high:.0f} r/min"


EPICYCLIC = """[epicyclic]
planets = 3
torque = "100 N m"
carrier_inertia = "40 kg cm^2"
bodies = [["large", "small"]]

[[wheel]]
name = "sun"
inertia = "1e-4 kg m^2"
teeth = 24
base_radius = "22.5526 mm"

[[wheel]]
name = "large"
inertia = "2e-4 kg m^2"
mass = "0.5 kg"
teeth = 30
base_radius = "28.1908 mm"
x = "54 mm"

[[wheel]]
name = "small"
inertia = "1e-4 kg m^2"
mass = "0.3 kg"
teeth = 18
base_radius = "11.7099 mm"
x = "54 mm"

[[wheel]]
name = "ring"
inertia = "1e-2 kg m^2"
teeth = 96
base_radius = "62.4533 mm"
internal = true

[[mesh]]
first = "sun"
second = "large"
k_mean = "4e8 N/m"
half_backlash = "20 um"
eps = [0.2]

[[mesh]]
first = "small"
second = "ring"
k_mean = "4e8 N/m"
half_backlash = "20 um"
"""


def test_a_file_with_a_carrier_is_an_epicyclic_set(file):
    file.write_text(EPICYCLIC)
    wheel, mesh = hb.gears.Wheel, hb.gears.Mesh
    wheels = [
        wheel("sun", 1e-4, teeth=24, base_radius="22.5526 mm"),
        wheel("large", 2e-4, 0.5, teeth=30, base_radius="28.1908 mm", x="54 mm"),
        wheel("small", 1e-4, 0.3, teeth=18, base_radius="11.7099 mm", x="54 mm"),
        wheel("ring", 1e-2, teeth=96, base_radius="62.4533 mm", internal=True),
    ]
    meshes = [mesh("sun", "large", 4e8, "20 um", eps=(0.2,)), mesh("small", "ring", 4e8, "20 um")]
    made = hb.gears.EpicyclicSet(wheels, meshes, 0.004, 3, (("large", "small"),))
    found = read_train(file)
    assert found.carrier_inertia == pytest.approx(0.004, rel=1e-15)
    assert found.replace(carrier_inertia=0.004) == made and made.ratio == 1 + Fraction(30 * 96, 24 * 18)
    file.write_text(EPICYCLIC.replace("planets = 3\n", 'planets = 3\ntorque_orders = { 2 = ["5 N m", "90 deg"] }\n'))
    assert read_train(file).torque_orders == ((2.0, 5.0, pytest.approx(math.pi / 2)),)
    file.write_text(EPICYCLIC)
    arguments = ["trace", str(file), "--from", "1.2", "--to", "1.1", "--harmonics", "4"]
    assert CliRunner().invoke(app, arguments).exit_code == 0


def drawn_set(first: str = "", second: str = "") -> str:
    """The epicyclic set of drawings, with lines of the two meshes."""
    module = "1.3846153846 mm"
    gears = (
        ("sun", 24, "2 mm", ""),
        ("large", 30, "2 mm", 'x = "54 mm"'),
        ("small", 18, module, 'x = "54 mm"'),
        ("ring", 96, module, ""),
    )
    text = EPICYCLIC[: EPICYCLIC.index("[[wheel]]")]
    for name, teeth, module, place in gears:
        gear = f'teeth = {teeth}, module = "{module}", face_width = "20 mm", internal = {str(name == "ring").lower()}'
        text += f'[[wheel]]\nname = "{name}"\n{place}\ngear = {{ {gear} }}\n'
    for names, line in ((("sun", "large"), first), (("small", "ring"), second)):
        text += f'[[mesh]]\nfirst = "{names[0]}"\nsecond = "{names[1]}"\n{line}\npair = {{ backlash = "60 um" }}\n'
    return text


def test_meshes_of_an_epicyclic_set_have_the_share_of_one_planet(file):
    """A third of 100 N m on the sun; on the small gear 30/24 of it, as large and small gear are one body."""
    file.write_text(drawn_set())
    made = read_train(file)
    assert [mesh.torque for mesh in made.meshes] == pytest.approx([100 / 3, 100 / 3 * 30 / 24], rel=1e-9)
    file.write_text(drawn_set('torque = "33 N m"', 'torque = "42 N m"'))  # within 2 %
    assert [mesh.torque for mesh in read_train(file).meshes] == [33.0, 42.0]
    file.write_text(drawn_set('torque = "100 N m"'))
    with pytest.raises(TomlFileError, match=r"computed for 100 N m on 'sun', the share of one planet .* 33.3333 N m"):
        read_train(file)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("planets = 3", "planets = 5", r"line 1: in the mesh small\d-ring the teeth are .* pitches apart"),
        ('"100 N m"', '"100 N"', r"line 3: .*torque"),
        ('[["large", "small"]]', '[["large", "smal"]]', "'smal' is no gear of a planet; did you mean 'small'"),
        ("[[mesh]]", '[[shaft]]\nfirst = "sun"\nsecond = "large"\n\n[[mesh]]', "an epicyclic set has no shaft"),
        ("planets = 3", "planets = 3\nrings = 2", r"line 3: unknown key 'epicyclic.rings'"),
    ],
)
def test_a_wrong_epicyclic_set(file, old, new, words):
    file.write_text(EPICYCLIC.replace(old, new, 1))
    with pytest.raises(TomlFileError, match=words) as found:
        read_train(file)
    assert len(found.value.args[0]) >= 1


def test_a_wheel_that_no_spring_turns(file):
    """A shaft without torsional stiffness: the wheel has no speed and no angle, and the train has equations."""
    file.write_text(TEXT.replace('torsion = "2e4 N m/rad"', "bending = 1e6"))
    system = read_train(file).system()
    turning = system.dof_names.index("theta_flange")
    assert not np.delete(system.K[turning], turning).any() and len(system.elements) == 2


def test_friction_of_a_mesh(file):
    file.write_text(TEXT.replace("damping = 0.04", "damping = 0.04\nfriction = 0.05"))
    train = read_train(file)
    names = [element.name for element in train.system().elements]
    assert names == ["in-middle", "middle-out", *(f"in-middle friction {i}" for i in (1, 2, 3))]
    file.write_text(TEXT.replace("eps = [0.2]", "friction = 0.05"))
    with pytest.raises(ValueError, match="friction needs a mesh that is computed from pair and torque"):
        read_train(file)


def test_a_train_on_the_command_line(file, tmp_path):
    out = tmp_path / "curve.npz"
    arguments = ["trace", str(file), "--from", "1.2", "--to", "1.1", "--harmonics", "6", "-o", str(out)]
    result = CliRunner().invoke(app, [*arguments, "--set", "torque_scale=0.5"])
    assert result.exit_code == 0, result.output
    assert hb.load(out).layout.elements == ("in-middle", "middle-out")


def test_orders_of_two_stages_on_the_command_line(file, tmp_path):
    """The second pinion sits where the flange was: tooth frequencies as 3 to 2."""
    pinion = 'inertia = "0.01 kg m^2"\nteeth = 20\nbase_radius = "28.190778624 mm"\nx = "82.5 mm"'
    text = TEXT.replace('inertia = "0.01 kg m^2"', pinion).replace('"187.5 mm"', '"172.5 mm"')
    file.write_text(text.replace('first = "middle"\nsecond = "out"', 'first = "flange"\nsecond = "out"'))
    out = tmp_path / "curve.npz"
    arguments = ["trace", str(file), "--from", "0.3", "--to", "0.29", "--harmonics", "5", "--orders", "meshes"]
    result = CliRunner().invoke(app, [*arguments, "-o", str(out)])
    assert result.exit_code == 0, result.output
    layout = hb.load(out).layout
    assert layout.harmonics == 15 and {2, 3, 4, 6, 9, 15} <= set(layout.orders) and 14 not in layout.orders


ROTOR = """balance = "mill"
gyroscopic = true

[[wheel]]
name = "in"
teeth = 20
base_radius = "28 mm"
inertia = 1e-3
mass = 1.5
moves = "space"
torque = "100 N m"

[[wheel]]
name = "out"
teeth = 40
base_radius = "56 mm"
inertia = 4e-3
mass = 4.0
moves = "space"
unbalance = "200 g mm"

[[wheel]]
name = "mill"
inertia = 0.05
mass = 9.0
moves = "space"
z = "300 mm"

[[mesh]]
first = "in"
second = "out"
k_mean = "4e8 N/m"
half_backlash = "40 um"
eps = [0.2]
direction = 0.0

[[beam]]
first = "out"
second = "mill"
outer = "40 mm"
elements = 2

[[bearing]]
at = "in"
x = "2e8 N/m"
y = "2e8 N/m"
z = "1e8 N/m"
tilt_x = 1e5
tilt_y = 1e5
clearance = "20 um"

[[bearing]]
at = "mill"
z = 1e8
table = { speed = ["60 r/min", 2000.0], matrices = [[[1e8, 0.0], [0.0, 1e8]], [[2e8, 1e6], [-1e6, 2e8]]] }

[[bearing]]
at = "out"
x = 3e8
y = 3e8

[housing]
M = "mass.mtx"
K = [[1e9, 0.0], [0.0, 2e9]]
names = ["left", "right"]
seats = { in = { y = "left" }, mill = { x = "right" } }
"""


@pytest.fixture
def rotor(tmp_path):
    scipy.io.mmwrite(tmp_path / "mass.mtx", np.diag([20.0, 30.0]))
    path = tmp_path / "rotor.toml"
    path.write_text(ROTOR)
    return path


def test_a_file_of_all_that_a_train_may_have(rotor, tmp_path):
    train = read_train(rotor)
    wheels = [
        hb.gears.Wheel("in", 1e-3, 1.5, teeth=20, base_radius=0.028, moves="space", torque=100.0),
        hb.gears.Wheel("out", 4e-3, 4.0, teeth=40, base_radius=0.056, moves="space", unbalance=2e-4),
        hb.gears.Wheel("mill", 0.05, 9.0, moves="space", z=0.3),
    ]
    table = hb.mechanics.MatrixTable([2 * np.pi, 2000.0], [[[1e8, 0.0], [0.0, 1e8]], [[2e8, 1e6], [-1e6, 2e8]]])
    bearings = [
        hb.gears.Bearing("in", 2e8, 2e8, 1e8, 1e5, 1e5, clearance=2e-5),
        hb.gears.Bearing("mill", z=1e8, table=table),
        hb.gears.Bearing("out", 3e8, 3e8),
    ]
    housing = hb.gears.Housing(
        np.diag([20.0, 30.0]),
        np.diag([1e9, 2e9]),
        None,
        ["left", "right"],
        {"in": {"y": "left"}, "mill": {"x": "right"}},
    )
    made = hb.gears.Train(
        wheels,
        [hb.gears.Mesh("in", "out", 4e8, 4e-5, eps=(0.2,), direction=0.0)],
        (),
        bearings,
        "mill",
        True,
        beams=[hb.gears.Beam("out", "mill", 0.04, elements=2)],
        housing=housing,
    )
    assert describe(train) == describe(made)
    assert train.orders["out"] == 1.0 and train.orders["in-out"] == 40.0
    problem = hb.HarmonicBalance(train, 42)
    assert problem.layout.elements == ("in-out", "in x", "in y") and "left" in problem.dof_names
    curve = hb.trace(problem, "Omega", (0.03, 0.0301), stability=False, steps=hb.StepControl(max_points=2))
    curve.save(tmp_path / "rotor.npz")
    assert describe(hb.load(tmp_path / "rotor.npz").require_problem().model) == describe(train)


def test_figure_of_beams_and_housing(rotor):
    ax = hb.plot.train(read_train(rotor))
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert {"shaft with mass", "bearing with clearance", "bearing", "on the housing", "unbalance"} <= set(labels)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('outer = "40 mm"', 'outer = "40 kg"', "line 40: outer = '40 kg' must be a quantity in m"),
        ('outer = "40 mm"', "", "beam.0.outer' is missing"),
        ('z = "300 mm"', "", "larger z"),
        ('"60 r/min"', '"60 m"', "table.speed = '60 m' must be a quantity in rad/s"),
        ('["60 r/min", 2000.0]', "[5.0]", "two or more frequencies"),
        ('seats = { in = { y = "left" }', 'seats = { in = { y = "lift" }', "no coordinate 'lift'; did you mean 'left'"),
        ('"mass.mtx"', '"mess.mtx"', "there is no file '.*mess.mtx'"),
        ("K = [[1e9, 0.0], [0.0, 2e9]]", "K = [[1e9]]", "K has shape"),
        ('clearance = "20 um"', 'clearance = "20 m"', "line 50: clearance = 20 m is beyond any machine"),
        ('unbalance = "200 g mm"', 'unbalance = "200 g"', "unbalance = '200 g' must be a quantity in kg m"),
        ("elements = 2", "elements = 2.5", "elements"),
    ],
)
def test_bad_rotors(rotor, old, new, said):
    text = ROTOR.replace(old, new)
    assert text != ROTOR
    rotor.write_text(text)
    with pytest.raises(TomlFileError, match=said):
        read_train(rotor)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("teeth = 25", "teth = 25", "line 6: unknown key 'wheel.0.gear.teth'; did you mean 'teeth'"),
        ('balance = "out"', 'balance = "outt"', "there is no wheel 'outt'; did you mean 'out'"),
        ('first = "middle"\nsecond = "out"', 'first = "middel"\nsecond = "out"', "no wheel 'middel'"),
        (
            'first = "middle"\nsecond = "out"',
            f'first = "{"x" * 999}"\nsecond = "out"',
            r"no wheel 'x{66}\.\.\.x{9}'; it has: in",
        ),
        ('x = "82.5 mm"', 'x = "60 mm"', "collide"),
        ('"100 N m"\ngear', '"100 N"\ngear', "line 5: torque = '100 N' must be a quantity in N m"),
        (
            "teeth = 30",
            'teeth = 10, tip_diameter = "28.3 mm"',
            "line 11: 10 teeth .* undercut, which leaves no involute",
        ),
        ('inertia = "0.01 kg m^2"', "", "line 13: wheel 'flange' needs its inertia"),
        ('k_mean = "4e8 N/m"', "", "a mesh needs its k_mean"),
        ('k_mean = "4e8 N/m"', 'k_mean = "4e8 N/m"\nmesh_model = "tangent"', "computed from pair and torque"),
        ('[[shaft]]\nfirst = "middle"', '[[shaft]]\nfirst = "flange"', "name two wheels"),
        ("eps = [0.2]", "eps = [2.0]", "eps|stiffness"),
        ("[[mesh]]", "[[mesh", "cannot be read as a train"),
    ],
)
def test_bad_files(file, old, new, said):
    text = TEXT.replace(old, new)
    assert text != TEXT
    file.write_text(text)
    if new == "eps = [2.0]":  # computed all the same, with a warning
        with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="negative"):
            hb.HarmonicBalance(read_train(file), 4)
        return
    with pytest.raises(TomlFileError, match=said):
        read_train(file)


def test_figure_of_a_train(file):
    ax = hb.plot.train(read_train(file))
    assert [text.get_text() for text in ax.texts] == ["in, 25 teeth\nflange", "middle\n30 teeth", "out\n40 teeth"]
    assert {str(line.get_gid()) for line in ax.lines} >= {"mesh in-middle", "mesh middle-out", "shaft"}
    assert "order 1, lag 0 cycles" in ax.get_legend().get_texts()[1].get_text()


def test_an_error_is_one_line_for_any_names(tmp_path):
    text = TEXT.replace('first = "in"', 'first = "i\\nn"')
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(TomlFileError) as error:
        read_train(tmp_path / "a.toml")
    assert "\n" not in str(error.value) and "a mesh of a pair needs a wheel 'i n' with a gear" in str(error.value)
