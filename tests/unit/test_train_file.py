"""Trains as files, on the command line and as figures."""

import pytest
from typer.testing import CliRunner

import hbgear as hb
from hbgear.cli.app import app
from hbgear.io.train_file import TrainFileError, is_train, read_train

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


def test_a_file_is_the_train(file):
    train = read_train(file)
    first, second = (hb.Gear(teeth=z, module="3 mm", face_width="20 mm") for z in (25, 30))
    pair = hb.GearPair(first, second, backlash="80 um")
    wheels = [hb.Wheel.of("in", first, torque=100.0), hb.Wheel.of("middle", second, x=0.0825), hb.Wheel("flange", 0.01),
              hb.Wheel("out", 0.004, teeth=40, base_radius=0.05638155725, x=0.1875)]  # fmt: skip
    meshes = [hb.Mesh.of("in", "middle", pair, 100.0, 0.04), hb.Mesh("middle", "out", 4e8, 4e-5, eps=(0.2,))]
    made = hb.Train(wheels, meshes, [hb.Shaft("middle", "flange", 2e4)], [hb.Bearing("flange")], balance="out")
    assert train == made and is_train(file)


def test_a_train_on_the_command_line(file, tmp_path):
    out = tmp_path / "curve.npz"
    arguments = ["trace", str(file), "--from", "1.2", "--to", "1.1", "--harmonics", "6", "-o", str(out)]
    result = CliRunner().invoke(app, [*arguments, "--set", "eps_scale=0.5"])
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


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("teeth = 25", "teth = 25", "line 6: unknown key 'wheel.0.gear.teth'; did you mean 'teeth'"),
        ('balance = "out"', 'balance = "outt"', "there is no wheel 'outt'; did you mean 'out'"),
        ('first = "middle"\nsecond = "out"', 'first = "middel"\nsecond = "out"', "no wheel 'middel'"),
        ('x = "82.5 mm"', 'x = "60 mm"', "collide"),
        ('"100 N m"\ngear', '"100 N"\ngear', "line 5: torque = '100 N' must be a quantity in N m"),
        ("teeth = 30", "teeth = 6", "line 11: 6 teeth .* undercut"),
        ('inertia = "0.01 kg m^2"', "", "line 13: wheel 'flange' needs its inertia"),
        ('k_mean = "4e8 N/m"', "", "a mesh needs its k_mean"),
        ('torque = "100 N m"\ndamping', "damping", "needs the torque on the first wheel"),
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
        with pytest.warns(hb.Unlikely, match="negative"):
            hb.HarmonicBalance(read_train(file), 4)
        return
    with pytest.raises(TrainFileError, match=said):
        read_train(file)


def test_figure_of_a_train(file):
    ax = hb.plot.train(read_train(file))
    assert [text.get_text() for text in ax.texts] == ["in\n25 teeth", "middle\n30 teeth", "flange", "out\n40 teeth"]
    assert {str(line.get_gid()) for line in ax.lines} >= {"mesh in-middle", "mesh middle-out", "shaft"}
    assert "order 1, lag 0 cycles" in ax.get_legend().get_texts()[1].get_text()
