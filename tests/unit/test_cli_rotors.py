"""``hbgear campbell``."""

import numpy as np
import pytest
import scipy.io

import hbgear as hb


def test_critical_speeds_are_printed_and_drawn(tmp_path, run):
    code, out, err = run("campbell gear-rotor-bearing --order mesh=1 --order twice=2 --plot campbell.png")
    assert code == 0, err
    a, b = sorted(hb.gears.GearRotorBearing.default_span)
    found = hb.analysis.campbell(hb.gears.GearRotorBearing(), (a, b), {"mesh": 1.0, "twice": 2.0})
    assert all(f"{one.Omega:.6g}" in out for one in found.critical) and found.critical
    assert (tmp_path / "campbell.png").stat().st_size > 5000


def test_no_critical_speed(run):
    code, out, _ = run("campbell duffing --from 5 --to 6")
    assert code == 0 and "no order crosses a natural frequency from Omega = 5 to 6" in out


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


def test_open_clearance_of_a_rotor_and_its_whirl(tmp_path, run):
    for name, matrix in (("M", np.eye(2)), ("K", np.eye(2)), ("G", np.array([[0.0, 0.6], [-0.6, 0.0]]))):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix, symmetry="general")
    (tmp_path / "rotor.toml").write_text(ROTOR)
    command = "campbell rotor.toml --from 0.1 --to 3 --order shaft=1"
    code, out, err = run(command)
    assert code == 0, err
    assert "elements in contact: none; open: seal" in out
    rows = [line.split() for line in out.splitlines() if line.strip().startswith("shaft")]
    assert [(row[2], row[-1]) for row in rows] == [("0.790569", "backward"), ("1.58114", "forward")]
    _, out, _ = run(f"{command} --closed seal")
    assert "elements in contact: seal; open: none" in out and "0.790569" not in out


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["spur-pair", "--order", "shaft=x"], "'x' is not a number; give the order relative to Omega"),
        (["spur-pair", "--order", "shaft=-1"], "order 'shaft' = -1.0 must be positive"),
        (["spur-pair", "--modes", "5"], "modes = 5 is more than 1"),
        (["spur-pair", "--from", "1", "--to", "1"], "are the same frequency"),
        (["spur-pair", "--plot", "x.jpg"], "x.jpg"),
        (["spur-pair", "--closed", "gapp"], "there is no element 'gapp'; did you mean 'gap'?"),
        (["spur-pair", "--closed", "gap", "--open", "gap"], "--closed gap and --open gap: give one of them"),
    ],
)
def test_bad_input(args, said, run):
    code, _, err = run("campbell", *args)
    assert code == 2 and said in err


def test_drawing_of_a_diagram():
    found = hb.analysis.campbell(
        hb.gears.DoubleHelicalPair(), (0.1, 1.2), {"mesh": 1.0, "pinion": 0.04}, points=11, modes=6
    )
    ax = hb.plot.campbell(found)
    gids = [str(line.get_gid()) for line in ax.lines]
    assert sum(gid.startswith("mode") for gid in gids) == 6 and {"order mesh", "order pinion"} <= set(gids)
    assert ax.get_ylabel() == "natural frequency [Hz]"
    assert [text.get_text() for text in ax.get_legend().get_texts()][1] == "order 1: mesh"
