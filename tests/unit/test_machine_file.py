"""Machines as files, and the commands gear and speed."""

import dataclasses
import os
import re
import tomllib
import warnings

import numpy as np
import pytest

import hbgear as hb
from hbgear.cli.machine_report import gear_tables
from hbgear.design.studies.study_file import read_study
from hbgear.io.machines.machine_file import Machine, read_machine, write_machine
from hbgear.io.machines.toml_file import TomlFileError

TEXT = """torque = "200 N m"
damping = 0.04

[pinion]
teeth = 25
module = "3 mm"
face_width = "20 mm"

[wheel]
teeth = 40

[pair]
backlash = "80 um"
"""
HELD = """
[support.pinion]
stiffness = "3e8 N/m"
tilt = "5e5 N m/rad"
[support.wheel]
stiffness = "3e8 N/m"
tilt = "5e5 N m/rad"
"""
DRAWING = ["--z", "25,40", "--module", "3mm", "--width", "20mm", "--torque", "200Nm", "--backlash", "80um"]


def pair(pitch_error=0.0, **fields):
    gears = (hb.gears.Gear(z, "3 mm", "20 mm", **fields) for z in (25, 40))
    return hb.GearPair(*gears, backlash="80 um", pitch_error=pitch_error)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "box.toml"
    path.write_text(TEXT)
    return path


def test_a_file_is_the_pair(file):
    machine = read_machine(file)
    assert machine == Machine(pair(), 200.0, 0.04)
    assert machine.model().equations == pair().model(200.0, 0.04)
    assert machine.model().title == "Gear pair 25/40, m = 3 mm, 200 N m"


@pytest.mark.parametrize("form", ["torsion", "bearings", "spatial"])
def test_written_files_are_read(tmp_path, form):
    gears = [
        hb.gears.Gear(z, "3.175 mm", 0.0203, helix_angle=h, profile_shift=x, crowning=3e-6, tip_relief="12 um")
        for z, h, x in ((23, 0.25, 0.21), (41, -0.25, 0.0))
    ]
    held = (hb.gears.Support(3.3e8, tilt=1e6), hb.gears.Support("2e8 N/m", axial=1e8, tilt="2 MN*m/rad", damping=0.05))
    machine = Machine(
        hb.GearPair(*gears, "61 um", "normal", pitch_error=2e-6), 1 / 3, 0.03, form, None if form == "torsion" else held
    )
    path = tmp_path / "m.toml"
    write_machine(machine, path, ("first", "second"))
    assert read_machine(path) == machine
    assert path.read_text().startswith("# first\n# second\n")
    assert tomllib.loads(path.read_text())["pinion"]["tip_relief"] == "12 um"


def test_tables_of_the_mesh_are_files_in_its_folder(file, tmp_path):
    cycle = pair(tip_relief="10 um").mesh(200.0)
    cycle.export(tmp_path / "mesh.csv")
    rows = [line.split(",") for line in (tmp_path / "mesh.csv").read_text().splitlines()]
    (tmp_path / "e.csv").write_text("\n".join(f"{row[0]},{row[2]}" for row in rows))
    file.write_text(TEXT + '\n[mesh]\nstiffness = "mesh.csv"\nerror = "e.csv"\n')
    found, wanted = read_machine(file).model().equations, pair().model(200.0, 0.04, cycle=cycle)
    assert found.eps == pytest.approx(wanted.eps, abs=1e-9) and found.e == pytest.approx(wanted.e, abs=1e-9)
    loaded = "\n".join(f"{row[0]},{row[3]}" for row in rows)
    (tmp_path / "loaded.csv").write_text(loaded)
    under_load = TEXT + '\n[mesh]\nstiffness = "mesh.csv"\nstatic_error = "loaded.csv"\n'
    (tmp_path / "loaded.toml").write_text(under_load)
    phase = np.linspace(0.01, 0.99, 50)
    found = read_machine(tmp_path / "loaded.toml").cycle.error(phase)
    np.testing.assert_allclose(found, cycle.error(phase), rtol=0, atol=1e-12)
    (tmp_path / "loaded.toml").write_text(under_load + 'error = "e.csv"\n')
    with pytest.raises(TomlFileError, match="error and static_error are both given"):
        read_machine(tmp_path / "loaded.toml")
    with pytest.raises(ValueError, match=r"\[mesh\]"):
        write_machine(read_machine(file), tmp_path / "n.toml")
    (tmp_path / "mesh.csv").write_text("phase [cycle], k [N/m]\n0, 1e8\n0.5, -2e8\n1, 1e8\n")
    with pytest.raises(TomlFileError, match=r"line 15: the mesh stiffness is .* must be positive"):
        read_machine(file)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"80 um"', '"80 mm"', "line 12: backlash = 80 mm is as large as a tooth.*'80 um'"),
        ("teeth = 25", "teeth = 6", "line 12: the contact ratio is .* less undercut of the pinion"),
        ('"3 mm"', '"3"', "line 6: module = '3' has no unit"),
        ('"3 mm"', "3", "line 6: module = 3 m is beyond any machine"),
        ('"20 mm"', '"20 kg"', "line 7: face_width = '20 kg' must be a quantity in m"),
        (
            "damping = 0.04",
            "dampng = 0.04",
            "line 1: 'damping' is missing; .*line 2: unknown key 'dampng'; did you mean",
        ),
        ('"200 N m"', '"200 N"', "line 1: torque = '200 N' must be a quantity in N m"),
        ('"200 N m"', "0.0", "line 1: torque = 0 N m"),
        ("0.04", "7", "line 2: damping = 7 is beyond"),
        ("teeth = 40", 'teeth = "x"', "line 10: wheel.teeth = 'x' must be a whole number"),
        ("teeth = 40", "teeth = 40.0", "line 10: wheel.teeth = 40.0 must be a whole number"),
        ('"3 mm"', "true", "line 6: pinion.module = true must be text in quotation marks or a number$"),
        ("damping = 0.04", "damping = 0,04", r"line 2, column 12\); the decimal mark is a point"),
        ("[wheel]", 'friction.viscosit = "1 Pa s"\n[wheel]', "line 9: unknown key 'pinion.friction'"),
        ("[pair]", "[[pair]]", r"line 12: 'pair' is one table: write \[pair\], not \[\[pair\]\]"),
        ("damping", 'friction = "a"\ndamping', "line 2: friction = 'a' must be a number or a table$"),
        (
            "damping",
            "friction = {viscosity = [3], speed = 1}\ndamping",
            r"line 2: friction.viscosity = \[3\] must be text",
        ),
        (
            "damping",
            'friction = {viscosit = "1 Pa s", speed = "1 r/min"}\ndamping',
            "line 2: unknown key 'friction.viscosit'; did you mean 'viscosity'",
        ),
        ("teeth = 40", 'teeth = 40\nhelix_angle = "10 deg"', "line 13: .* give the wheel helix_angle = '0 deg'"),
        ('backlash = "80 um"', "", "line 12: the pair has no backlash"),
        ("damping", 'form = "spatial"\ndamping', "line 2: the form 'spatial' needs a support of the pinion .*tilt = "),
        ("damping", 'form = "plane"\ndamping', "line 2: form = 'plane'"),
        ("[pair]", "[pairs]", "unknown key 'pairs'; did you mean 'pair'"),
        ("teeth = 40", "", "line 9: 'wheel.teeth' is missing"),
        ('backlash = "80 um"', 'backlash = "80 um"\nbacklash_measure = "axial"', "line 14: pair.backlash_measure"),
        ('"80 um"\n', '"80 um"\n[support.pinion]\nstiffness = 1e8\n', "'support.wheel' is missing"),
        ("torque", "torque =", "cannot be read as a machine"),
    ],
)
def test_errors_have_their_line(file, old, new, said):
    file.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(TomlFileError, match=said):
        read_machine(file)


@pytest.mark.parametrize("text", ["", "# to be written\n"])
def test_an_empty_file_is_named_as_such(file, text):
    """It was reported as a machine without its keys, even as the file of a study."""
    file.write_text(text)
    for read, expected in ((read_machine, "machine"), (hb.io.read_model, "machine"), (read_study, "study")):
        with pytest.raises(TomlFileError, match=rf"cannot be read as a {expected}: it is empty, or has only comments$"):
            read(file)


def test_all_errors_at_once(file):
    file.write_text(TEXT.replace('"3 mm"', '"3"').replace('"20 mm"', '"20 kg"').replace('"200 N m"', '"200"'))
    with pytest.raises(TomlFileError) as refused:
        read_machine(file)
    assert [text.partition(": ")[0][-6:] for text in refused.value.problems] == ["line 1", "line 6", "line 7"]


def test_supports_make_the_other_forms(file):
    file.write_text('form = "spatial"\n' + TEXT + HELD)
    assert isinstance(read_machine(file).model().equations, hb.gears.HelicalPair)
    file.write_text('form = "bearings"\n' + TEXT + HELD)
    assert isinstance(read_machine(file).model().equations, hb.gears.GearRotorBearing)


# ---- commands


@pytest.mark.slow
def test_trace_and_speed_of_a_file(run, file):
    file.write_text(TEXT.replace("damping = 0.04", "damping = 0.05"))  # with 0.04 the curve goes to infinity
    code, out, err = run("trace", file, "--harmonics", 24, "-o", "box.npz")
    assert (code, err) == (0, "")
    curve = hb.load("box.npz")
    model = pair().model(200.0, 0.05)
    code, out, err = run("speed", file, "-o", "again.npz", "--plot", "box.png", "--harmonics", 24)
    assert (code, err) == (0, "")
    shown = [float(x) for x in re.findall(r"LP\d +(\d+\.?\d*)", out)]
    speeds = [float(model.scales.pinion_speed(jump.value)) for jump in curve.jumps()]
    assert len(speeds) >= 4 and shown == pytest.approx(speeds, rel=8e-5)
    first = curve.jumps()[0]
    line = next(x for x in out.splitlines() if x.strip().startswith("LP1"))
    assert float(line.split()[-3]) == pytest.approx(hb.analysis.dynamic_factor(model, first.before), rel=5e-3)
    assert float(line.split()[-2]) == pytest.approx(hb.analysis.dynamic_factor(model, first.after), rel=5e-3)
    k_v = hb.gears.iso_dynamic_factor(pair(), 200.0, model.scales.pinion_speed(first.value))
    assert float(line.split()[-1]) == pytest.approx(float(k_v), abs=6e-3)


def test_speed_over_a_span_in_its_own_unit(run, file):
    code, out, _ = run("speed", file, "--from", "16000 r/min", "--to", "1570 rad/s", "--set", "damping=0.06")
    assert code == 0 and "16000 r/min" in out and "no jumps" in out and "Omega" not in out, out
    assert run("speed", file, "--to", "9000")[2] == (
        "hbgear: error: --to 9000: need a speed with its unit, such as --to 9000r/min\n"
    )


@pytest.mark.slow
def test_safe_speeds_do_not_depend_on_the_range_or_the_command(run, file):
    """At 9000 r/min a curve of the motions of lower speeds does not have the motions that come from higher ones.

    From 17154 r/min on there is a stable motion of twice the mesh period, which leaves above the traced span.
    """

    def ranges(*words):
        code, out, err = run(*words)
        assert (code, err) == (0, "")
        line = next(x for x in out.splitlines() if x.startswith("safe speeds"))
        return [(float(a), float(b)) for a, b in re.findall(r"(\d+) to (\d+)", line)]

    file.write_text(TEXT)
    whole = ranges("speed", file)
    assert whole == ranges("gear", *DRAWING, "--damping", 0.04)
    assert [high for _, high in whole][-1] == pytest.approx(17154, rel=1e-3)
    below = [(low, min(high, 9000)) for low, high in whole if low < 9000]
    assert ranges("speed", file, "--from", "9000r/min") == below
    code, out, _ = run("speed", file, "--from", "18000r/min", "--to", "20000r/min")
    assert code == 0 and "recommendation: avoid 18000 to 20000 r/min" in out and "begins at" in out


@pytest.mark.slow
def test_gear_reports_the_requested_quantities(run, tmp_path):
    code, out, err = run("gear", *DRAWING, "--damping", 0.04, "-o", "box.toml")
    assert (code, err) == (0, "")
    assert read_machine(tmp_path / "box.toml") == Machine(pair(), 200.0, 0.04)
    assert (tmp_path / "gear-25-40.png").stat().st_size > 20_000
    for text in (
        "1.66259",
        "97.5000 mm",
        "80.0 circumferential, 75.2 normal",
        "37.6",
        "c' 13.02, c_gamma 19.49",
        "6062",
        "damping 0.04 (given): 0.02",
        "no pitch error: 8.4 um (grade 6)",
        "no tip relief: 10 um",
        "inertia 20 % less",
        "one stiffness, tangent",
        "dynamic factor before",
    ):
        assert text in out, text
    model = pair().model(200.0, 0.04)
    curve = hb.trace(hb.HarmonicBalance(model, 24), "Omega", model.default_span)
    jumps = [jump for one in curve.curves for jump in one.jumps()]
    speeds = [float(model.scales.pinion_speed(jump.value)) for jump in jumps]
    assert [float(x) for x in re.findall(r"^ +(?:\d:)?LP\d +(\d+\.?\d*)", out, re.M)] == pytest.approx(speeds, rel=8e-5)
    lighter = next(x for x in out.splitlines() if "inertia 20 % less" in x)
    assert f"{max(speeds) / 0.8**0.5:.0f}+" in lighter  # speeds go with the root of stiffness over mass


@pytest.mark.slow
def test_losses_of_all_curves_of_a_span():
    """The lowest speed is on the second curve, because the first one grows without bound."""
    machine = Machine(pair(), 200.0, 0.04, friction=0.05)
    model = machine.model()
    curve = hb.trace(hb.HarmonicBalance(model, 12), "Omega", model.default_span)
    rows = dict(gear_tables.losses(machine, curve))
    speeds = [float(model.scales.pinion_speed(end)) for end in sorted(model.default_span)]
    assert curve.others
    assert [*rows][1:3] == [f"lowest speed, {speeds[0]:.0f} r/min", f"highest speed, {speeds[1]:.0f} r/min"]
    del rows["static efficiency"]
    for name, text in rows.items():
        efficiency, loss = (float(x) for x in re.search(r"([\d.]+)%, loss ([\d.]+) W", text).groups())
        power = 200.0 * float(name.split()[-2]) * np.pi / 30
        assert loss / power == pytest.approx(1 - efficiency / 100, rel=1e-3)


@pytest.mark.slow
def test_gear_without_mean_torque_and_without_contact(run):
    """The dynamic factor is not defined, and the teeth are apart at all speeds; both ended in an error."""
    drawing = [*DRAWING[:7], "0Nm", *DRAWING[8:]]
    code, out, err = run("gear", *drawing, "--damping", 0.04, "--torque-orders", "25:60Nm")
    assert (code, err) == (0, "")
    low, high = re.search(r"loss of contact is possible: (\d+) to (\d+) r/min", out).groups()
    assert f"recommendation: avoid {low} to {high} r/min" in out
    assert re.search(r"as computed +- +none", out)


def _force_text(model):
    machine = Machine(model.pair, model.torque, model.damping)
    return dict(gear_tables.mesh(machine, machine.mesh, model))["force along the line of action"]


def test_suggested_relief_has_the_size_of_the_deflection():
    """It was 10 um for all modules. Similar gears with ten times the size and a hundred times the force are equal.

    The warning of relief that is too large for the load names a pitch error if there is no relief.
    """
    from hbgear.cli.machine_report.assumptions import alternatives, without_relief_warning

    for size, relief in ((1, "10 um"), (10, "100 um"), (0.1, "1 um")):
        gears = (hb.gears.Gear(z, 3e-3 * size, 20e-3 * size) for z in (25, 40))
        model = hb.gears.DrawnPair(hb.GearPair(*gears, backlash=80e-6 * size), 200.0 * size**3, 0.04)
        found = dict(alternatives(model))
        changed = found[f"no tip relief: {relief}"]()
        assert changed.pair.pinion.tip_relief == changed.pair.wheel.tip_relief == pytest.approx(10e-6 * size)
        assert _force_text(model) == {1: "5675.6 N", 10: "567560 N", 0.1: "56.756 N"}[size]
        with without_relief_warning(), warnings.catch_warnings(record=True) as raised:
            _ = [model().equations for model in found.values()]
        assert not raised
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="the pitch error leaves a contact ratio of 1.0"):
        hb.gears.tooth_mesh(pair(pitch_error="30 um"), 20.0)


@pytest.mark.slow
def test_gear_with_pairs_of_teeth(run, tmp_path):
    """The jumps of teeth with their own gaps; the mean mesh of the same drawing has none."""
    code, out, err = run("gear", *DRAWING, "--damping", 0.04, "--relief", "12um")
    assert (code, err) == (0, "")
    rows = {line.split("  ")[1].strip(): line for line in out.splitlines() if line.startswith("  ")}
    assert "6941-, 6961+, 9352-, 13282+" in rows["as computed"]
    assert "none" in rows["mesh of tooth pairs: one stiffness, secant"]
    assert "3.951e+08 N/m" in rows["stiffness, all gaps closed"]
    assert "must be one of teeth, secant, tangent" in run("gear", *DRAWING, "--mesh", "mean")[2]


@pytest.mark.slow
def test_gear_states_its_assumptions(run):
    """Also with the torque in the other direction, which loads the back flanks."""
    code, out, err = run("gear", *DRAWING, "--torque", "-200Nm", "--harmonics", 8, "--plot", "x.pdf")
    assert (
        code == 0
        and "hbgear: error" not in err
        and "damping 0.04 (assumed): 0.02" in out
        and "on the driving flank" in out
    )


@pytest.mark.slow
def test_gear_prints_its_tables_where_its_figure_cannot_be_written(run):
    os.mkdir("gear-25-40.png")
    code, out, err = run("gear", *DRAWING, "--damping", 0.04, "--harmonics", 6)
    assert code == 0 and "natural frequency" in out and "wrote" not in out
    assert "cannot write 'gear-25-40.png': it is a folder" in err and "--plot PATH" in err
    assert run("gear", *DRAWING, "--plot", "gear-25-40.png")[0] == 2  # asked for, so it is refused


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--z", "25"], "--z 25: need two whole numbers, such as --z 25,40"),
        (["--z", "25.5,40"], "--z 25.5,40: need two whole numbers"),
        (["--shift", "1.9,0"], "pointed"),
        (["--module", "3"], "module = '3' has no unit"),
        (["--backlash", "80mm"], "as large as a tooth"),
        (["--width", "-20 mm"], r"face_width = '-20 mm' must be positive"),
        (["--relief", "-5um"], r"tip_relief = '-5um' must not be negative"),
        (["--pressure", "-20 deg"], r"pressure_angle = '-20 deg' must be positive"),
        (["--backlash-as", "axial"], "circumferential, normal, action"),
        (["--torque", "200N"], "must be a quantity in N m"),
        (["--helix", "10"], "has no unit"),
        (["--damping", "4"], "damping = 4 is beyond any machine"),
        (["--shift", "1"], "--shift 1: need two numbers"),
        (["-o", "box.txt"], "the name must end in .toml"),
        (["--plot", "box.txt"], "the name must end in"),
        (["--z", "25,-26"], "interference|ring|base"),
    ],
)
def test_gear_refuses_in_a_sentence(run, words, said):
    code, out, err = run("gear", *DRAWING, *words)
    assert (code, out) == (2, "") and err.startswith("hbgear: error: ") and err.count("\n") == 1
    assert re.search(said, err)


def test_errors_of_a_file_are_a_line_each(run, file):
    file.write_text(TEXT.replace('"3 mm"', '"3"').replace('"20 mm"', '"20 kg"'))
    for command in ("trace", "speed"):
        code, _, err = run(command, file)
        assert code == 2 and len(err.splitlines()) == 2 and all("box.toml, line " in x for x in err.splitlines())


def test_speed_needs_a_machine(run):
    assert "has no scales, so its speeds" in run("speed", "duffing")[2]


@pytest.mark.slow
def test_a_helical_ring_on_the_command_line(run, tmp_path):
    code, out, err = run(
        "gear",
        "--z",
        "21,-72",
        "--module",
        "2 mm",
        "--width",
        "25 mm",
        "--torque",
        "80 N m",
        "--backlash",
        "60 um",
        "--helix",
        "12 deg",
        "--shift",
        "0.4,-0.4",
        "-o",
        "ring.toml",
    )
    assert code in (0, 2)
    if code == 0:
        wheel = read_machine(tmp_path / "ring.toml").pair.wheel
        assert wheel.internal and wheel.hand == "right" and "72 (ring)" in out
    else:
        assert "interference" in err


def test_replacing_keeps_a_machine_a_machine(file):
    machine = read_machine(file)
    other = dataclasses.replace(machine, torque=100.0)
    assert other.model().equations.F_m < machine.model().equations.F_m


@pytest.mark.slow
def test_answers_of_a_saved_curve(run, file, tmp_path):
    span = "--from", "9000r/min", "--to", "16000r/min"
    assert run("trace", file, "--harmonics", 12, *span, "-o", "box.npz")[0] == 0
    code, out, err = run("results", "box.npz", "--dof", "q", "-o", "all.csv", "--plot", "all.png")
    assert (code, err) == (0, "")
    curve = hb.load(tmp_path / "box.npz")
    each = [hb.analysis.machine_quantities(one, dof="q") for one in curve.curves]
    assert len(each) == 2
    head, *rows = (tmp_path / "all.csv").read_text().splitlines()
    assert head.count("acceleration, level [dB]") == 1 and len(rows) == len(curve) + len(curve.others[0])
    stable = [found["dynamic factor"][found["stable"].astype(bool)].max() for found in each]
    line = next(x for x in out.splitlines() if x.strip().startswith("dynamic factor [-]"))
    assert float(line.split()[3]) == pytest.approx(max(stable), rel=1e-3)
    assert (tmp_path / "all.png").stat().st_size > 20_000
    code, out, err = run("results", "box.npz", "noise")
    assert code == 2 and "there is no quantity 'noise'; choose one of 'Omega'" in err
    assert run("results", "box.npz", "--dof", "z")[0] == 2
