"""``hbgear campbell``."""

import pytest
from typer.testing import CliRunner

import hbgear as hb
from hbgear.cli import app as cli


def run(*args):
    return CliRunner().invoke(cli.app, ["campbell", *args])


def test_critical_speeds_are_told_and_drawn(tmp_path):
    figure = tmp_path / "campbell.png"
    result = run("gear-rotor-bearing", "--order", "mesh=1", "--order", "twice=2", "--plot", str(figure))
    assert result.exit_code == 0, result.output
    a, b = sorted(hb.GearRotorBearing.default_span)
    found = hb.campbell(hb.GearRotorBearing(), (a, b), {"mesh": 1.0, "twice": 2.0})
    assert all(f"{one.Omega:.6g}" in result.output for one in found.critical) and found.critical
    assert figure.stat().st_size > 5000


def test_no_critical_speed(capsys):
    result = run("duffing", "--from", "5", "--to", "6")
    assert result.exit_code == 0 and "no order meets a natural frequency from Omega = 5 to 6" in result.output


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["spur-pair", "--order", "shaft=x"], "'x' is no number; give the order over Omega"),
        (["spur-pair", "--order", "shaft=-1"], "order 'shaft' = -1.0 must be positive"),
        (["spur-pair", "--modes", "5"], "modes = 5 is more than 1"),
        (["spur-pair", "--from", "1", "--to", "1"], "the end of the span"),
        (["spur-pair", "--plot", "x.jpg"], "x.jpg"),
    ],
)
def test_bad_input(args, said, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["campbell", *args])
    assert end.value.code == 2 and said in capsys.readouterr().err


def test_drawing_of_a_diagram():
    found = hb.campbell(hb.DoubleHelicalPair(), (0.1, 1.2), {"mesh": 1.0, "pinion": 0.04}, points=11, modes=6)
    ax = hb.plot.campbell(found)
    gids = [str(line.get_gid()) for line in ax.lines]
    assert sum(gid.startswith("mode") for gid in gids) == 6 and {"order mesh", "order pinion"} <= set(gids)
    assert ax.get_ylabel() == "natural frequency [Hz]"
    assert [text.get_text() for text in ax.get_legend().get_texts()][1] == "order 1: mesh"
