"""The commands validate and sweep."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hbgear as hb


@pytest.fixture
def saved(run):
    """A Duffing curve with its two folds, saved in the folder."""
    assert run("trace duffing --harmonics 9 --from 0.9 --to 1.3 -o duffing.npz")[0] == 0
    return "duffing.npz"


@pytest.mark.slow
def test_validate_agrees_and_writes_both_files(run, saved):
    code, out, err = run(f"validate {saved} --points 5 -o report.csv --plot report.png")
    assert (code, err) == (0, "") and "5 of 5 points agree within 0.0001" in out
    points, jumps = out.split("landings of jumps by integration")
    assert points.count("agrees") == 5 and "near LP1" in out and "near LP2" in out
    assert jumps.count("agrees") == 2 and "2 of 2 jumps agree" in out
    table = np.genfromtxt("report.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert len(table) == 5 and table["rms_error"].max() < 1e-6
    assert os.path.getsize("report.png") > 10_000


PAIR = "spur-pair --set zeta=0.0254 --set F_m=0.0469 --set eps=0.2286,0.1741,0.0462 --set e=0.00868 --set phase=sin"


def test_paths_of_sweeps_through_a_period_doubling(run):
    """Upwards the doubled motion leads from 1.2267 to its fold, downwards from 1.9527 to a second doubling."""
    assert run("trace spur-pair --set e=0.1 --from 2.2 --to 1.0 --harmonics 8 -o pair.npz")[0] == 0
    code, out, err = run("jumps pair.npz --doublings 1")
    assert (code, err) == (0, "")
    expected = {"increasing": [("1", 1.2267), ("2", 1.40484)], "decreasing": [("1", 1.95269), ("2", 1.8462)]}
    for way, ends in expected.items():
        table = out.partition(f"path of a slow sweep, {way}")[2].partition("path of")[0]
        rows = [line.split() for line in table.splitlines() if line.strip()[:1].isdigit()]
        assert [row[2] for row in rows] == [period for period, _ in ends]
        assert [float(row[1]) for row in rows] == pytest.approx([value for _, value in ends], abs=2e-3)
    assert "jump at LP1" in out and "the motion loses its stability at PD1, and none" in out


@pytest.mark.slow
def test_jumps_that_are_integrated_say_so(run):
    """At LP4 the nearest of two motions is not the one that integration ends in; LP3 goes to either."""
    assert run(f"trace {PAIR} --from 2.5 --to 0.3 -o pair.npz")[0] == 0
    near, found = run("jumps pair.npz --measure rms"), run("jumps pair.npz --measure rms --landing integrate")
    assert near[0] == found[0] == 0 and near[2] == found[2] == ""
    lines = [{line.split()[0]: line for line in out.splitlines() if " LP" in line} for _, out, _ in (near, found)]
    assert "uncertain: nearest of 2" in lines[0]["LP4"] and all("integrated" in line for line in lines[1].values())
    after = [float(line["LP4"].partition("creasing")[2].split()[1]) for line in lines]
    assert after == pytest.approx([0.0715, 0.0828], abs=1e-4)
    assert "LP1, LP3, LP4, LP6: several motions are stable" in " ".join(near[1].split()) and "several" not in found[1]
    assert "LP3: indeterminate: " in found[1] and "indeterminate" not in near[1]
    code, out, _ = run("validate pair.npz --points 1")
    assert code == 1 and "5 of 6 jumps agree" in out
    assert run("validate pair.npz --points 1 --landing nearest")[0] == 0
    code, out, _ = run(f"trace {PAIR} --from 2.5 --to 0.3 -o decided.npz --landing integrate")
    assert code == 0 and "integrated" in out and run("validate decided.npz --points 1")[0] == 0
    hb.load("decided.npz").export("decided.csv")
    assert Path("decided.csv").read_text().count(",integrated,") == 6
    text = run("jumps decided.npz")[1]
    assert text.count("integrated") == 6 and "LP3: indeterminate: " in text


@pytest.mark.slow
def test_jumps_to_a_curve_that_is_given_name_it(run):
    assert run("trace spur-pair --set e=0.1 --from 2.6 --to 0.4 -o pair.npz")[0] == 0
    assert run("switch pair.npz PD1 -o doubled.npz")[0] == 0
    code, out, err = run("jumps doubled.npz --landing integrate --with pair.npz")
    assert (code, err) == (0, "") and "pair.npz, " in out and "LP2: period 4, on a curve that was not given" in out
    code, out, _ = run("validate doubled.npz --points 1 --with pair.npz")
    assert "2 of 2 jumps agree" in out
    code, out, err = run("jumps doubled.npz --landing farthest")
    assert code == 2 and "--landing farthest: need nearest or integrate" in err


def test_jumps_of_all_curves_of_a_file_are_integrated(run):
    """Only those of the first curve were, and the advice for the others was to integrate them."""
    problem = hb.HarmonicBalance(hb.Duffing(), 5)
    up, down = (hb.trace(problem, "Omega", span) for span in ((0.9, 1.3), (1.3, 0.9)))
    replace(up, others=(down,)).save("both.npz")
    code, out, err = run("jumps both.npz --landing integrate")
    assert (code, err) == (0, "") and out.count("integrated") == 4 and "nearest" not in out


def test_jumps_interrupted_are_those_to_the_nearest(run, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("hbgear.time.jump_integration.jump_ends", interrupted)
    code, out, err = run("trace duffing --harmonics 9 --from 0.9 --to 1.3 -o duffing.npz --landing integrate")
    assert code == 3 and "the nearest motions are shown as landings" in err and "wrote duffing.npz" in out
    assert [jump.landing_description for jump in hb.load("duffing.npz").jumps()] == ["nearest", "nearest"]


@pytest.mark.slow
def test_validate_confirms_with_more_harmonics_and_states_the_error_of_the_curve(run):
    assert run("trace duffing --harmonics 1 --from 1.0 --to 1.08 -o coarse.npz")[0] == 0
    code, out, err = run("validate coarse.npz --points 3 -o report.csv --plot report.png")
    assert (code, err) == (0, "") and "3 of 3 points agree within 0.0001" in out
    assert "3 of them with more harmonics: difference" in out and "agrees with H = 4 to" in out
    table = np.genfromtxt("report.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert (table["harmonic_error"] > 1e-4).all() and (table["refined_error"] < 1e-4).all()
    assert (table["harmonics"] > 1).all()


@pytest.mark.slow
def test_validate_reports_unbounded_motions(run):
    """Unstable motions of a softening oscillator, which integration leaves at once: no number to show for some.

    x = a cos tau with (1 - Omega^2) a - 3/4 a^3 = F has the unstable solution a = 0.77 at Omega = 0.55.
    """
    problem = hb.HarmonicBalance(hb.Duffing(k3=-1.0, F=0.2), 2)
    soft = hb.trace(problem, "Omega", (0.55, 0.57), np.array([0.0, 0.77, 0.0, 0.0, 0.0]))
    assert soft.status.complete and not soft.stable.any()
    soft.save("soft.npz")
    code, out, err = run("validate soft.npz --points 1 -o report.csv --plot report.png")
    assert (code, err) == (1, "") and "no periodic motion" in out
    assert "nan" not in out and "inf" not in out and max(map(len, out.splitlines())) <= 200
    assert "inf" in Path("report.csv").read_text() and os.path.getsize("report.png") > 10_000


@pytest.mark.slow
def test_validate_ends_with_1_where_a_point_disagrees(run, saved):
    curve = hb.load(saved)
    replace(curve, X=curve.X * (1 + 1e-3)).save("wrong.npz")
    code, out, err = run("validate wrong.npz --points 3")
    assert (code, err) == (1, "") and "0 of 3 points agree within 0.0001" in out and "more harmonics" not in out


def test_sweep_brackets_the_folds_of_the_curve_it_is_drawn_on(run):
    model = "duffing --set zeta=0.1 --set F=1.2"
    assert run(f"trace {model} --harmonics 9 --from 1.1 --to 1.7 -o hard.npz")[0] == 0
    span = "--from 1.32 --to 1.53 --count 8 --tolerance 1e-4"
    code, out, err = run(f"sweep {model} --up --down {span} --curve hard.npz -o sweep.csv")
    assert (code, err) == (0, "")
    curve = hb.load("hard.npz")
    rows = [line.split() for line in out.splitlines() if line.strip().startswith("1.")]
    found = [sorted(float(x) for x in row[:2]) for row in rows]
    folds = [curve["LP1"].parameters["Omega"], curve["LP2"].parameters["Omega"]]
    assert len(found) == 2
    for (low, high), fold in zip(found, folds, strict=True):  # up first, then down
        assert low <= fold <= high and high - low == pytest.approx(0.03)
    assert os.path.exists("hard_sweep.png") and os.path.exists("sweep.csv")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("validate missing.npz", ["no file 'missing.npz'"]),
        ("validate duffing.npz --tolerance 1e-15", ["tolerance = 1e-15 cannot be verified"]),
        ("validate duffing.npz -o report.txt", ["must end in .csv"]),
        ("validate duffing.npz --element nose", ["no element 'nose'"]),
        ("sweep duffing --max-periods 10", ["longest = 10 periods are too few", "give 20 or more"]),
        ("sweep duffing --set k3=-1 --set F=0.5", ["the motion diverges at Omega = "]),
        ("sweep duffign", ["no model 'duffign'", "did you mean 'duffing'"]),
        ("sweep spur-pair --curve duffing.npz", ["Duffing"]),
        ("sweep duffing --in zeta=0.1:0.2", ["--at Omega"]),
        ("sweep duffing --at Omega=1 --in Omga=1:2", ["no parameter 'Omga'"]),
    ],
)
def test_bad_input(run, saved, text, words):
    code, _, err = run(text)
    assert code == 2 and err.startswith("hbgear: error: ") and err.count("\n") == 1
    for word in words:
        assert word in err


def test_basins_of_a_pair(run):
    where = "--set e=0.1 --omega 0.65 --d -2:3 --v -1.5:1.5 --shape 6 5"
    code, out, err = run(f"basins spur-pair {where} -o basins.csv --plot basins.png")
    assert (code, err) == (0, "") and "all starts were integrated" in out
    assert "0.34055" in out and "0.051407" in out
    table = np.genfromtxt("basins.csv", delimiter=",", names=True)
    assert len(table) == 30 and set(table["attractor"]) == {0, 1}
    assert os.path.getsize("basins.png") > 10_000
    code, out, err = run("basins spur-pair --omega 9000r/min --shape 2 2")
    assert code == 2 and "no scales" in err
    for text, words in (
        ("--omega 0.9", "select one of 'gap L', 'gap R'"),
        ("--omega 0.9 --d 3", "--d 3: need a range"),
    ):
        code, _, err = run(f"basins double-helical {text}")
        assert code == 2 and words in err and err.count("\n") == 1


def test_a_sweep_of_more_values_than_can_be_meant(run):
    code, _, err = run("sweep duffing --count 99999999")
    assert code == 2 and "'--count'" in err and "100000" in err and err.count("\n") == 1
