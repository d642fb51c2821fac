"""``hbgear campbell``."""

import numpy as np
import pytest
import scipy.io
from typer.testing import CliRunner

import hbgear as hb
from hbgear.cli import app as cli


def run(*args):
    return CliRunner().invoke(cli.app, ["campbell", *args])


def test_critical_speeds_are_printed_and_drawn(tmp_path):
    figure = tmp_path / "campbell.png"
    result = run("gear-rotor-bearing", "--order", "mesh=1", "--order", "twice=2", "--plot", str(figure))
    assert result.exit_code == 0, result.output
    a, b = sorted(hb.gears.GearRotorBearing.default_span)
    found = hb.analysis.campbell(hb.gears.GearRotorBearing(), (a, b), {"mesh": 1.0, "twice": 2.0})
    assert all(f"{one.Omega:.6g}" in result.output for one in found.critical) and found.critical
    assert figure.stat().st_size > 5000


def test_no_critical_speed(capsys):
    result = run("duffing", "--from", "5", "--to", "6")
    assert result.exit_code == 0 and "no order crosses a natural frequency from Omega = 5 to 6" in result.output


ROTOR = """
[matrices]
M = "M.mtx"
K = "K.mtx"
G = "G.mtx"
names = ["x", "y"]

[[element]]
name = "seal"
direction = { x = 1.0 }
law = "backlash"
k = 8.0
b = 0.5

[[load]]
cosine = { 1 = { x = 0.1 } }
"""


def test_open_clearance_of_a_rotor_and_its_whirl(tmp_path):
    for name, matrix in (("M", np.eye(2)), ("K", np.eye(2)), ("G", np.array([[0.0, 0.6], [-0.6, 0.0]]))):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix, symmetry="general")
    (tmp_path / "rotor.toml").write_text(ROTOR)
    args = [str(tmp_path / "rotor.toml"), "--from", "0.1", "--to", "3", "--order", "shaft=1"]
    result = run(*args)
    assert result.exit_code == 0, result.output
    assert "elements in contact: none; open: seal" in result.output
    rows = [line.split() for line in result.output.splitlines() if line.strip().startswith("shaft")]
    assert [(row[2], row[-1]) for row in rows] == [("0.790569", "backward"), ("1.58114", "forward")]
    result = run(*args, "--closed", "seal")
    assert "elements in contact: seal; open: none" in result.output and "0.790569" not in result.output


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["spur-pair", "--order", "shaft=x"], "'x' is not a number; give the order relative to Omega"),
        (["spur-pair", "--order", "shaft=-1"], "order 'shaft' = -1.0 must be positive"),
        (["spur-pair", "--modes", "5"], "modes = 5 is more than 1"),
        (["spur-pair", "--from", "1", "--to", "1"], "the end of the span"),
        (["spur-pair", "--plot", "x.jpg"], "x.jpg"),
        (["spur-pair", "--closed", "gapp"], "there is no element 'gapp'; did you mean 'gap'?"),
        (["spur-pair", "--closed", "gap", "--open", "gap"], "--closed gap and --open gap: give one of them"),
    ],
)
def test_bad_input(args, said, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["campbell", *args])
    assert end.value.code == 2 and said in capsys.readouterr().err


def test_drawing_of_a_diagram():
    found = hb.analysis.campbell(
        hb.gears.DoubleHelicalPair(), (0.1, 1.2), {"mesh": 1.0, "pinion": 0.04}, points=11, modes=6
    )
    ax = hb.plot.campbell(found)
    gids = [str(line.get_gid()) for line in ax.lines]
    assert sum(gid.startswith("mode") for gid in gids) == 6 and {"order mesh", "order pinion"} <= set(gids)
    assert ax.get_ylabel() == "natural frequency [Hz]"
    assert [text.get_text() for text in ax.get_legend().get_texts()][1] == "order 1: mesh"
