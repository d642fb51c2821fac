"""The commands map, critical, switch and survey."""

import dataclasses
import os
import re

import numpy as np
import pytest

import hbgear as hb
from hbgear.analysis.summary import text_at


@pytest.fixture
def saved(run):
    """A curve of SpurPair with two period doublings, saved in the folder."""
    code, _, err = run("trace spur-pair --set e=0.1 --from 2.1 --to 0.95 --harmonics 8 -o pair.npz")
    assert (code, err) == (0, "")
    return "pair.npz"


@pytest.mark.slow
def test_map_gives_the_cusp_and_writes_both_files(run):
    code, out, err = run("map spur-pair --in zeta=0.1:0.13 --harmonics 6 -o map.csv --plot map.png")
    assert (code, err) == (0, "")
    zeta = float(re.search(r"vanishes at zeta = ([\d.]+)", out)[1])
    assert zeta == pytest.approx(0.118, abs=2e-4)
    table = np.genfromtxt("map.csv", delimiter=",", names=True)
    assert table["zeta"].max() == pytest.approx(zeta, abs=5e-5) and set(table["direction"]) == {-1, 1}
    assert os.path.getsize("map.png") > 10_000


def test_map_without_any_jump(run):
    code, out, err = run("map spur-pair --in zeta=0.2:0.3 --harmonics 3 --seeds 2")
    assert (code, err) == (0, "") and "no jump for zeta between 0.2 and 0.3" in out


def test_an_interrupted_map_does_not_state_that_there_are_no_jumps(run, monkeypatch):
    found = hb.jump_map(hb.SpurPair(), "zeta", (0.2, 0.3), harmonics=3, seeds=2)
    stopped = dataclasses.replace(found, status=hb.Status.INTERRUPTED, message="interrupted")
    monkeypatch.setattr(hb, "jump_map", lambda *_, **__: stopped)
    code, out, err = run("map spur-pair --in zeta=0.2:0.3")
    assert code == 3 and "no jump" not in out and "interrupted" in err
    (text,) = hb.plot.jump_map(stopped).texts
    assert text.get_text() == "no jump yet: the map is not complete"


@pytest.mark.slow
def test_critical_is_that_of_the_library(run):
    code, out, err = run("critical spur-pair zeta --set zeta=0.1 --harmonics 6")
    assert (code, err) == (0, "")
    found = hb.analysis.critical_parameter(hb.SpurPair(zeta=0.1), "zeta", harmonics=6)
    place = {name: text_at(found.point, name) for name in ("zeta", "Omega")}
    assert f"zeta = {place['zeta']}: a jump exists below" in out and f"Omega = {place['Omega']}\n" in out


@pytest.mark.slow
def test_derivatives_of_a_critical_value(run):
    line = "critical spur-pair zeta --set zeta=0.1 --harmonics 6 --from 1.0 --to 0.6"
    code, out, err = run(f"{line} --sensitivity --max-rows 2 -o moved.csv --plot moved.png")
    assert (code, err) == (0, "")
    found = hb.analysis.sensitivity(
        hb.analysis.critical_parameter(hb.SpurPair(zeta=0.1), "zeta", harmonics=6, frequencies=(1.0, 0.6)),
        measure="pp2",
    )
    shares = found.percent("zeta")
    lines = [text.split() for text in out.splitlines()]
    table = [words for words in lines if len(words) == 2 + len(found.quantities) and words[0] in shares]
    assert [words[0] for words in table] == list(shares)[:2] and "percent per percent of a parameter" in out
    assert [float(words[2]) for words in table] == pytest.approx(list(shares.values())[:2], abs=6e-5)
    assert (
        "e[0]" in shares and "1 more parameters with smaller derivatives" in out
    )  # e[0], e_scale and F_m; b is a unit
    assert np.genfromtxt("moved.csv", delimiter=",", names=True, dtype=None, encoding=None).dtype.names[2] == "d_zeta"
    assert os.path.getsize("moved.png") > 10_000
    code, out, _ = run(line)
    assert code == 0 and "percent of each" not in out
    code, _, err = run(f"{line} --sensitivity --sort-by omega")
    assert code == 2 and "did you mean 'Omega'" in err
    code, _, err = run(f"{line} --sensitivity -o moved.npz")
    assert code == 2 and ".csv" in err


def test_switch_traces_the_doubled_motion(run, saved):
    code, out, err = run(f"switch {saved} PD1 -o doubled.npz --plot doubled.png")
    assert (code, err) == (0, "")
    doubled = hb.load("doubled.npz")
    assert doubled.layout.nu == 2 and doubled.status == "merged" and "joined the one it came from" in out
    assert np.any(doubled.amplitude("H1/2") > 0.1)


def test_switch_reports_a_jump_back_to_its_curve(run, saved):
    _, out, _ = run(f"switch {saved} PD1 -o doubled.npz")
    doubled, pair = hb.load("doubled.npz"), hb.load(saved)
    (jump,) = (jump for jump in doubled.jumps() if jump.label == "LP1")
    assert jump.after is None  # no stable motion on the doubled curve itself
    below = float(np.interp(jump.value, pair.values[::-1], pair.amplitude("pp2")[::-1]))
    (line,) = (line for line in out.splitlines() if "decreasing" in line)
    assert float(re.search(r"pair\.npz, ([\d.]+)", line)[1]) == pytest.approx(below, rel=2e-3)
    assert "no stable motion on these curves" in out  # LP2 lies where every traced motion is unstable


def test_survey_saves_every_branch(run):
    os.mkdir("found")
    code, out, err = run(
        "survey duffing --set zeta=0.05 --from 0.6 --to 1.5 --harmonics 3 --places 1 --guesses 3 -o found"
    )
    assert (code, err) == (0, "")
    assert sorted(os.listdir("found")) == ["branch1.npz"] and "branch 1:" in out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("map spur-pair --in Omega=1:2", ["must differ from Omega", "choose one of: zeta"]),
        ("map spur-pair --in zetta=1:2", ["no parameter 'zetta'", "did you mean 'zeta'"]),
        ("map spur-pair --in zeta=0.1:0.1", ["two different finite values of zeta"]),
        ("map spur-pair --in zeta=0.1:0.2 -o map.txt", ["must end in .csv"]),
        ("critical spur-pair Omega", ["must differ from Omega"]),
        ("critical duffing F --set k3=0 --harmonics 3", ["no jump", "steepest slope of the rms amplitude"]),
        ("switch missing.npz PD1", ["no file 'missing.npz'"]),
        ("survey duffing -o nowhere", ["no folder 'nowhere' for branch1.npz"]),
        (f"survey duffing -o {'o' * 300}", ["no folder 'ooo", "create it first"]),
        (f"trace {'o' * 300}.py:Mine", ["cannot be loaded: there is no file"]),
        ("survey duffing --harmonics many", ["--harmonics many", "whole number"]),
    ],
)
def test_bad_input(run, text, words):
    code, _, err = run(text)
    assert code == 2 and err.startswith("hbgear: error: ") and err.count("\n") == 1
    for word in words:
        assert word in err


def test_switch_refuses_points_without_a_second_branch(run, saved):
    code, _, err = run(f"switch {saved} PD9")
    assert code == 2 and "no special point 'PD9'" in err and "PD1" in err
    code, _, err = run("trace spur-pair --harmonics 5 --from 1.5 --to 0.6 -o fold.npz")
    code, _, err = run("switch fold.npz LP1")
    assert code == 2 and "LP1 is an LP" in err and "choose a PD or BP" in err
