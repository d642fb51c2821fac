"""The command line: what it prints, writes and returns, and that every bad input gets one line that says what to do."""

import csv
import dataclasses
import os
import re
import subprocess
import sys
import time
import warnings
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import typer
from scipy.io import loadmat

import hbgear as hb
from hbgear.analysis import summary
from hbgear.analysis.quantities.axis_quantities import Ordinate
from hbgear.cli import app as cli
from hbgear.cli import support as cli_support
from hbgear.cli.support import assignments, numbered
from hbgear.common.text.digits import concise

REPOSITORY = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(hb.__file__).parents[1])}  # whether installed or not
QUICK = ["trace", "duffing", "--harmonics", "3", "--no-stability"]
DRAWING = "--z 25,40 --module 3mm --width 20mm --torque 200Nm --backlash 80um"


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A curve of SpurPair with folds, jumps and grazing contacts, saved."""
    path = tmp_path_factory.mktemp("saved") / "spur.npz"
    hb.trace(hb.HarmonicBalance(hb.SpurPair(F_m=0.11), harmonics=5), "Omega", (1.5, 0.6)).save(path)
    return path


def shell(*args, env=ENVIRONMENT, **options):
    return subprocess.run([sys.executable, *args], capture_output=True, text=True, timeout=120, env=env, **options)


# ---- what it does


def test_models_shows_names_equations_and_defaults(run):
    code, out, err = run("models")
    assert (code, err) == (0, "")
    for text in ("double-helical", "DoubleHelicalPair", "x'' + 2 zeta x' + x + k3 x^3 = F cos(tau)", "k3=0.1", "W=0,"):
        assert text in out
    assert "d_j = w_j^T q - e_j(tau)" in out


def test_trace_saves_the_curve_of_the_library(run):
    code, out, err = run("trace", "duffing", "--harmonics", 7, "--set", "F=0.17", "--to", 1.4, "-o", "d.npz")
    assert (code, err) == (0, "")
    here = hb.load("d.npz")
    there = hb.trace(hb.HarmonicBalance(hb.Duffing(F=0.17), 7), "Omega", (0.5, 1.4))
    assert here.X.shape == there.X.shape
    np.testing.assert_allclose(here.X, there.X, rtol=0, atol=1e-10)
    for jump in there.jumps():
        place = summary.text_at(jump.before, "Omega")
        line = next(x for x in out.split("jumps of a slow sweep")[1].splitlines() if place in x)
        assert jump.label in line and ("increasing" if jump.direction > 0 else "decreasing") in line
        assert all(summary.size_text(end, Ordinate("pp2"), there) in line for end in (jump.before, jump.after))
    assert len(there.jumps()) >= 2 and "wrote d.npz" in out


def test_formats_and_figure(run):
    for name in ("d.csv", "d.mat"):
        assert run(*QUICK, "-o", name, "--measure", "H1")[0] == 0
    lines = Path("d.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    values = [float(row["Omega"]) for row in rows]
    assert values[0] == 0.5 and values[-1] == 1.6 and len(values) == loadmat("d.mat")["values"].size
    code, out, _ = run(*QUICK, "--plot", "d.png")
    assert code == 0 and Path("d.png").read_bytes().startswith(b"\x89PNG")
    assert "jumps unknown: traced without stability" in out


def test_values_take_the_type_of_the_field(run):
    sets = ["--set", "eps=(0.1, 0.05)", "--set", "e=0.05,", "--set", "phase=sin", "--set", "b=2"]
    assert run("trace", "spur-pair", *sets, "--max-points", 3, "--no-stability", "-o", "s.npz")[0] == 3
    fields = hb.load("s.npz").meta["model"]["fields"]
    assert fields["eps"] == [0.1, 0.05] and fields["e"] == [0.05] and fields["phase"] == "sin" and fields["b"] == 2.0
    assert run("trace", "duffing", "--set", "zeta=2.5 %", "--max-points", 3, "--no-stability", "-o", "d.npz")[0] == 3
    assert hb.load("d.npz").meta["model"]["fields"]["zeta"] == 0.025
    sets = ["--set", "tilt=false", "--set", "teeth_p=23", "--set", "e=()"]
    assert run("trace", "double-helical", *sets, "--max-points", 3, "--no-stability", "-o", "g.npz")[0] == 3
    fields = hb.load("g.npz").meta["model"]["fields"]
    assert fields["tilt"] is False and fields["teeth_p"] == 23 and fields["e"] == []


def test_trace_in_another_parameter(run):
    code, out, _ = run(*QUICK, "--in", "F=0.05:0.1", "--at", "Omega=1.3", "-o", "F.npz")
    curve = hb.load("F.npz")
    assert code == 0 and curve.parameter == "F" and (curve.values[0], curve.values[-1]) == (0.05, 0.1)
    assert curve.fixed["Omega"] == 1.3 and "no special points" in out
    assert "Omega = 1.3" in run("info", "F.npz")[1]


def test_samples_reach_the_balance(run):
    run("trace", "spur-pair", "--sampled", "--samples", 128, "--max-points", 2, "--no-stability", "-o", "s.npz")
    settings = hb.load("s.npz").meta["balance"]
    assert {name: settings[name] for name in ("harmonics", "samples", "sampled")} == {
        "harmonics": 16,
        "samples": 128,
        "sampled": True,
    }


def test_info_summarises_the_file(run, saved):
    code, out, err = run("info", saved)
    curve = hb.load(saved)
    assert (code, err) == (0, "")
    facts = [
        "Spur pair, F_m = 0.11",
        "harmonics = 5",
        f"{len(curve)} points",
        "complete: ",
        "no impact, single-sided",
        f"{curve.amplitude('pp2').max():.5g}",
        f"{curve.residual.max():.1e}",
        f"{curve.error.max():.1e}",
        f"{int((~curve.stable).sum())} unstable",
        "LP1",
        "GR1",
        "grazing contact",
        "jumps of a slow sweep",
    ]
    for fact in facts:
        assert fact in out
    assert re.search(r"\bb=", out) is None  # fields at their defaults are not listed


def test_jumps_of_a_file(run, saved):
    code, out, _ = run("jumps", saved, "--measure", "rms")
    curve = hb.load(saved)
    assert code == 0 and curve.jumps() and "special points" not in out
    for jump in curve.jumps():
        assert summary.text_at(jump.before, "Omega") in out
        assert summary.size_text(jump.before, Ordinate("rms"), curve) in out


def test_frequency_and_speed_of_models_that_have_them(run):
    run("trace", "double-helical", "--harmonics", 4, "--from", 1.1, "--to", 0.9, "-o", "g.npz")
    _, out, _ = run("info", "g.npz")
    point = hb.load("g.npz")["GR1"]
    graze = point.parameters["Omega"]
    pair = hb.gears.DoubleHelicalPair()
    line = next(line for line in out.splitlines() if "GR1" in line)
    speeds = pair.mesh_frequency(graze), pair.pinion_speed(graze)
    assert all(concise(speed, point.error * speed / graze, 6) in line for speed in speeds)
    assert "mesh Hz" in out and "pinion r/min" in out
    assert pair.mesh_frequency(1.0) == pytest.approx(32145.7 / (2 * np.pi), abs=0.01)


def test_plot_of_a_file_and_of_its_points(run, saved):
    assert run("plot", saved, "-o", "curve.svg")[0] == 0
    assert "<svg" in Path("curve.svg").read_text(encoding="utf-8")
    code, out, _ = run("plot", saved, "--point", "LP1", "-o", "point.png")
    assert code == 0 and f"Omega = {summary.text_at(hb.load(saved)['LP1'], 'Omega')}\n" in out
    assert run("plot", saved)[0] == 0 and saved.with_suffix(".png").exists()


def test_a_point_at_a_value_lies_exactly_there(run, saved):
    """The curve has no computed point at 0.75; the nearest one was used."""
    assert np.abs(hb.load(saved).values - 0.75).min() > 1e-6
    code, out, _ = run("plot", saved, "--point", 0.75, "-o", "point.png")
    assert code == 0 and "point at Omega = 0.7500\n" in out
    assert run("trace", "spur-pair", "--start", f"{saved}:0.75", "--in", "zeta=0.05:0.06", "-o", "load.npz")[0] == 0
    start = hb.load("load.npz")[0]
    assert start.parameters["Omega"] == 0.75
    assert np.abs(start.problem.residual(start.X, **start.parameters)).max() < 1e-9


def test_a_span_that_takes_several_curves(run):
    """The first runs off to infinity; jumps land from one on the other, and the file has both."""
    wild = ["--set", "zeta=0.01", "--set", "eps=0,0.2", "--set", "e=0.05", "--harmonics", 8]
    code, out, err = run("trace", "spur-pair", *wild, "-o", "w.npz", "--plot", "w.png")
    assert (code, err) == (0, "") and Path("w.png").exists()
    assert "the curve runs off to infinity towards Omega = 1.04828; another curve covers the rest of the span" in out
    curve = hb.load("w.npz")
    (other,) = curve.others
    assert f"branch 2: {len(other)} points; {other.message}" in out
    assert sum(line.strip().startswith("special points") for line in out.splitlines()) == 2
    code, jumps, _ = run("jumps", "w.npz")
    for text in (out, jumps):
        assert re.search(r"LP1 .* decreasing .* branch 2, 0\.0", text)
        assert re.search(r"LP1 .* increasing .* branch 1, 1\.", text)
    code, out, _ = run("info", "w.npz")
    assert code == 0 and f"Omega = {curve.asymptotes['last']:.9g} (beyond the last point)" in out
    assert "unbounded" in out and run("plot", "w.npz", "-o", "w.svg")[0] == 0


@pytest.mark.slow
def test_a_point_at_a_speed_with_its_unit(run):
    """The mesh frequency of Omega = 1 is 38000 / 2 pi Hz; the pinion has 25 teeth."""
    pair = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25.0))
    hb.trace(hb.HarmonicBalance(pair, 2), "Omega", (1.5, 1.2)).save("r.npz")
    curve = hb.load("r.npz")
    mesh = 1.3 * 38000 / 2 / np.pi
    for text in (f"{mesh:.12g}Hz", f"{mesh * 60 / 25:.12g} r/min", "1.3"):
        assert abs(cli_support.point_of(curve, text).parameters["Omega"] - 1.3) < 1e-9
    with pytest.raises(ValueError, match=r"--point 1\.3x: need a speed with its unit, such as --point 9000r/min"):
        cli_support.point_of(curve, "1.3x")
    with pytest.raises(KeyError, match="no special point 'LP9'"):
        cli_support.point_of(curve, "LP9")


def test_points_of_the_second_curve_of_a_file(run):
    """Commands take 2:LP1; results, jumps and scatter are those of both curves."""
    wild = ["--set", "zeta=0.01", "--set", "eps=0,0.2", "--set", "e=0.05", "--harmonics", 8]
    run("trace", "spur-pair", *wild, "-o", "w.npz")
    curve = hb.load("w.npz")
    (other,) = curve.others
    fold = other["LP1"].parameters["Omega"]
    for label in ("2:LP1", "LP1 (2)"):
        code, out, err = run("sensitivity", "w.npz", label)
        assert (code, err) == (0, "") and f"Omega = {fold:.6g}" in out
    code, out, _ = run("follow", "w.npz", "2:LP1", "--in", "zeta=0.01:0.0101")
    assert code == 0 and f"{fold:.6g}" in out
    code, out, _ = run("plot", "w.npz", "--point", "2:LP1", "-o", "p.png")
    assert code == 0 and "point at Omega = 0.4468" in out and Path("p.png").exists()
    assert run("plot", "w.npz", "--point", "2:LP1")[0] == 0 and Path("w_2_LP1.png").exists()  # a name on any system
    assert run("plot", "w.npz", "--style", "screen", "-o", "s.svg")[0] == 0 and Path("s.svg").exists()
    assert "--style poster: choose journal or screen" in run("plot", "w.npz", "--style", "poster")[2]
    code, _, err = run("sensitivity", "w.npz", "3:LP1")
    assert code == 2 and "POINT 3:LP1: the file has 2 curves" in err
    code, out, _ = run("scatter", "w.npz", "zeta=1e-4", "--draws", 20)
    assert code == 0 and re.search(r"^ +LP1 .*decreasing", out, re.M) and re.search(r"^ +2:LP1 .*increasing", out, re.M)
    code, out, _ = run("results", "w.npz", "-o", "r.csv")
    stable = [hb.analysis.machine_quantities(one)["dynamic factor"][one.stable].max() for one in (curve, other)]
    (factor,) = re.findall(r"dynamic factor \[-\] +([\d.]+)", out)[:1]
    assert code == 0 and float(factor) == pytest.approx(max(stable), rel=1e-3)  # unstable where it is unbounded
    assert re.search(r"force, static \[-\] +0\.\d+", out) and re.search(r"2:LP1 .*increasing", out)
    rows = Path("r.csv").read_text().splitlines()
    assert rows[0].startswith("curve,") and len(rows) == 1 + len(curve) + len(other)


def test_a_label_of_another_curve_is_named():
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 1.6), accuracy=None)
    first = dataclasses.replace(curve, special=(), jump_records=(), others=(curve,))
    with pytest.raises(ValueError, match="POINT LP2: curve 1 of the file has no such point; curve 2 has: 2:LP2"):
        numbered(first, "LP2", "POINT")
    assert numbered(first, "2:LP2") == numbered(first, "LP2 (2)") == (1, "LP2")
    assert numbered(first, "1.1") == (0, "1.1") and numbered(first, "2:1.1") == (1, "1.1")


def test_point_by_value_is_the_nearest_stable_one(saved):
    curve = hb.load(saved)
    fold, other = (curve[label].parameters["Omega"] for label in ("LP1", "LP2"))
    middle = (fold + other) / 2
    assert np.sum(np.diff(np.sign(curve.values - middle)) != 0) == 3  # upper, unstable, lower
    point = cli_support.point_of(curve, str(middle))
    assert point.stable and abs(point.parameters["Omega"] - middle) < 0.05
    assert cli_support.point_of(curve, str(curve.values[0])).parameters["Omega"] == curve.values[0]


# ---- how it ends


def test_early_stop_saves_and_returns_3(run):
    code, out, _ = run(*QUICK, "--max-points", 6, "-o", "d.npz", "--plot", "d.png")
    curve = hb.load("d.npz")
    assert code == 3 and len(curve) == 6 and curve.status is hb.Status.MAX_POINTS
    assert Path("d.png").exists() and ". Allow more points" in out


def test_interrupt_saves_and_returns_3(run, monkeypatch):
    @contextmanager
    def impatient(what):
        def show(now):
            if now.numbers["points"] == 8:
                raise KeyboardInterrupt

        yield show

    monkeypatch.setattr(cli_support, "bar", impatient)
    code, out, _ = run(*QUICK, "-o", "d.npz")
    assert code == 3 and hb.load("d.npz").status is hb.Status.INTERRUPTED and len(hb.load("d.npz")) == 8
    assert "interrupted" in out


def test_a_report_of_an_interrupted_curve_has_no_recommendation(run, monkeypatch):
    """Safe speeds and alternatives need the whole curve; the drawing, the file and the part of the curve are kept."""

    @contextmanager
    def impatient(what):
        def show(now):
            if now.numbers["points"] >= 8:
                raise KeyboardInterrupt

        yield show

    monkeypatch.setattr(cli_support, "bar", impatient)
    for args in (f"gear {DRAWING} -o pair.toml --plot pair.png", "speed pair.toml -o part.npz"):
        code, out, _ = run(*args.split())
        assert code == 3 and "interrupted" in out and "need the whole curve and are left out" in out
        assert "recommendation" not in out and "safe speeds," not in out
    assert (
        hb.load("part.npz").status is hb.Status.INTERRUPTED and Path("pair.toml").exists() and Path("pair.png").exists()
    )


def test_interrupt_before_the_first_point(run, monkeypatch):
    def impatient(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(hb, "trace", impatient)
    code, _, err = run(*QUICK, "-o", "d.npz")
    assert code == 3 and "nothing was kept" in err and not os.listdir()


def test_start_without_motion_is_refused(run, monkeypatch):
    def lost(*_, **__):
        raise hb.NoConvergence("Newton stopped", np.zeros(3), {}, [])

    monkeypatch.setattr(hb, "trace", lost)
    code, _, err = run(*QUICK, "-o", "d.npz")
    assert code == 2 and err == "hbgear: error: Newton stopped\n" and not os.listdir()


def test_failure_while_drawing_leaves_no_half_figure(run, saved, monkeypatch):
    from matplotlib.figure import Figure

    def fail(self, handle, **options):
        handle.write(b"half")
        raise OSError("the disk is full")

    monkeypatch.setattr(Figure, "savefig", fail)
    code, _, err = run("plot", saved, "-o", "curve.png")
    assert code == 2 and err.startswith("hbgear: error: the disk is full; ")
    assert err.count("\n") == 1 and not os.listdir()


def test_a_bug_is_not_hidden(monkeypatch):
    monkeypatch.setattr("hbgear.cli.commands.models.print_table", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        cli.main(["models"])


def test_warnings_are_one_line(run):
    before = warnings.showwarning
    code, _, err = run("trace", "double-helical", "--harmonics", 2, "--max-points", 2, "--no-stability")
    assert code == 3 and warnings.showwarning is before
    assert re.fullmatch(r"hbgear: warning: the excitation has 3 harmonics but H = 2 .*\n", err)


@pytest.mark.slow
def test_linear_algebra_of_the_command_has_one_thread_by_default():
    as_command = "from hbgear.__main__ import main\ntry: main()\nexcept SystemExit: pass"

    def seen(name, begin, **asked):
        env = {key: value for key, value in ENVIRONMENT.items() if not key.endswith("_NUM_THREADS")}
        program = (
            f"import os, sys; sys.argv = ['{name}', '--version']\n{begin}\nimport scipy.linalg, threadpoolctl\n"
            "pools = [pool['num_threads'] for pool in threadpoolctl.threadpool_info() if pool['user_api'] == 'blas']\n"
            "print(os.environ.get('OPENBLAS_NUM_THREADS'), max(pools))"
        )
        return shell("-c", program, env=env | asked).stdout.split()[-2:]

    assert seen("hbgear", as_command) == ["1", "1"]
    assert seen("hbgear", as_command, OPENBLAS_NUM_THREADS="2")[0] == "2"
    assert seen("hbgear", "import hbgear; hbgear.trace")[0] == "None"


def test_help_is_quick_to_import():
    program = "import sys\nfrom hbgear.cli.app import main\ntry:\n    main([])\nfinally:\n    "
    out = shell("-c", program + "print('matplotlib' in sys.modules)")
    assert out.returncode == 0 and "trace" in out.stdout and out.stdout.endswith("False\n")


def test_long_words_are_shortened(run):
    """Typer repeats what it was given; damaged files have such words too."""
    code, out, err = run("models", "duffing", "9" * 5000)
    assert (code, out) == (2, "") and err.startswith("hbgear: error: ") and len(err) < 1200 and "99...99" in err


def test_module_and_version(run):
    assert shell("-m", "hbgear", "--version").stdout == f"{hb.__version__}\n"
    assert run("--version") == (0, f"{hb.__version__}\n", "")


@pytest.mark.slow
def test_no_progress_bar_where_there_is_no_terminal(tmp_path):
    out = shell("-m", "hbgear", *QUICK, cwd=tmp_path, env={**ENVIRONMENT, "FORCE_COLOR": "1"})
    assert out.returncode == 0 and out.stderr == ""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_progress_bar_on_a_terminal(tmp_path):
    import pty

    master, slave = pty.openpty()
    env = {**ENVIRONMENT, "TERM": "xterm", "COLUMNS": "100"}
    command = [sys.executable, "-m", "hbgear", *QUICK[:4], "--set", "zeta=0.01"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=slave, cwd=tmp_path, env=env) as process:
        os.close(slave)
        seen, deadline = b"", time.monotonic() + 100
        while time.monotonic() < deadline:
            try:
                part = os.read(master, 4096)
            except OSError:  # how Linux says that the other end is closed
                break
            if not part:
                break
            seen += part
    os.close(master)
    assert process.returncode == 0
    # The display shows the state ten times a second and once at its end: a fast trace is seen only there.
    assert re.search(rb"Omega = \d\.\d+, \d+ points", seen)


# ---- bad input


def refused(run, args, *words):
    """Exit code 2, one line on stderr with these words, nothing on stdout, nothing written."""
    before = sorted(os.listdir())
    code, out, err = run(*args)
    assert (code, out) == (2, "")
    assert err.startswith("hbgear: error: ") and err.count("\n") == 1
    for word in words:
        assert word in err
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize(
    "args, words",
    [
        ("trace duffign", ["no model 'duffign'", "did you mean 'duffing'"]),
        ("trace duffing --set zetta=0.1", ["no parameter 'zetta'", "did you mean 'zeta'"]),
        ("trace duffing --set name=1", ["no parameter 'name'", "it has: zeta, k3, F"]),
        ("trace duffing --in zetta=0.1:0.2 --at Omega=1", ["did you mean 'zeta'"]),
        ("trace duffing --in zetta=0.1:0.2", ["did you mean 'zeta'"]),
        ("map duffing --in zetta=3um:4um", ["did you mean 'zeta'"]),
        ("trace duffing --in zeta=0.1:0.2 --at 9000r/min", ["such as --at Omega=0.9"]),
        ("trace duffing --at zetta=1", ["no parameter 'zetta'", "did you mean 'zeta'"]),
        ("trace duffing --at Omega=1", ["--at Omega", "--from and --to"]),
        ("trace duffing --at zeta=much", ["--at zeta=much", "finite number"]),
        ("trace duffing --set zeta=nan", ["zeta=nan", "finite number"]),
        ("trace duffing --set F=inf", ["F=inf", "finite number"]),
        ("trace duffing --set zeta=-0.1", ["zeta = -0.1", "must not be negative"]),
        ("trace duffing --set zeta=x%", ["zeta", "x%", "must be a number"]),
        ("redesign duffing --free zeta --scatter zeta=10%", ["--scatter zeta=10%", "no percentage", "as a number"]),
        ("redesign double-helical --free W --free zeta", ["W is 0 in the model", "nonzero W"]),
        ("trace duffing --set zeta", ["--set zeta", "need NAME=VALUE"]),
        ("trace duffing --set zeta=0.1 --set zeta=0.2", ["already given as 0.1"]),
        ("trace spur-pair --set eps=0.1,x", ["eps=x", "finite number"]),
        ("trace spur-pair --set e=0.1,,0.2", ["e=0.1,,0.2", "a number is missing between two commas"]),
        ("trace spur-pair --in b=1:-1 --at Omega=0.6", ["b must not be negative"]),
        ("trace duffing --harmonics 1000000000", ["unknowns", "at most"]),
        ("trace duffing --samples 1000000000000", ["samples", "at most"]),
        ("map spur-pair --in b=-1:1", ["b must not be negative"]),
        ("map spur-pair --in b=0.5:1 --seeds 1000000000", ["seeds", "more than 1,000"]),
        ("survey duffing --frequencies 1000000000000", ["frequencies", "more than"]),
        ("survey duffing --guesses 1000000000000", ["guesses", "more than"]),
        ("trace spur-pair --set phase=tan", ["'tan'", "'cos' or 'sin'"]),
        ("trace double-helical --set teeth_p=2.5", ["teeth_p=2.5", "whole number"]),
        ("trace double-helical --set teeth_p=0", ["teeth_p = 0"]),
        ("trace double-helical --set k_mean=0", ["k_mean = 0"]),
        ("trace double-helical --set tilt=maybe", ["tilt=maybe", "true or false"]),
        ("trace duffing --harmonics 8 --samples 16", ["N = 16", "H = 8", "need N >= 17"]),
        ("trace duffing --harmonics 0", ["--harmonics", "1"]),
        ("trace duffing --samples 0", ["--samples", "1"]),
        ("trace duffing --samples many", ["--samples", "integer"]),
        ("trace duffing --from 1 --to 1", ["--from 1 and --to 1 are the same frequency", "two different ones"]),
        ("trace double-helical --from 9000r/min --to 9000r/min", ["--from 9000r/min and --to 9000r/min are the same"]),
        ("trace duffing --from 1.2 --to -0.5", ["--to -0.5: Omega must be positive"]),
        ("trace double-helical --to -5r/min", ["--to -5r/min: Omega must be positive"]),
        ("trace duffing --from nan", ["--from=nan", "finite number"]),
        ("trace duffing --parameter F --at Omega=1 --to 1", ["--parameter F --from A --to B is now --in F=A:B"]),
        ("trace duffing --in F --at Omega=1", ["--in F", "such as --in F=0.02:0.08"]),
        ("trace duffing --in F --from 1 --to 2 --at Omega=1", ["--in F=1:2", "--from and --to are in Omega"]),
        ("trace duffing --in F=1: --at Omega=1", ["--in F=1:", "need its range too"]),
        ("trace duffing --in F=1:2e9x --at Omega=1", ["--in F=2e9x", "finite number"]),
        ("trace duffing --in F=1:2 --to 2 --at Omega=1", ["F is the continuation parameter; omit --from and --to"]),
        ("trace duffing --in F=1:2 --at Omega=1 --at F=1", ["--at F", "is the continuation parameter; use"]),
        ("trace duffing --in F=0.1:1", ["a fixed frequency is required", "--at Omega="]),
        ("survey duffing --omega-from 1", ["--omega-from is now --from"]),
        ("critical duffing F --omega-to 1", ["--omega-to is now --to"]),
        ("map duffing --in F --from 1 --to 2", ["--in F=1:2", "--from and --to are in Omega"]),
        ("trace duffing --measure loud", ["no measure 'loud'", "pp2"]),
        ("trace duffing --harmonics 3 --measure H4", ["'H4'", "H = 3"]),
        ("trace duffing --tolerance 1e-4", ["--tolerance 0.0001", "no effect", "--harmonics auto"]),
        ("trace duffing --harmonics many", ["--harmonics many", "whole number", "or auto"]),
        ("map duffing --in F=1:2 --harmonics auto", ["--harmonics auto", "whole number", "--harmonics 16"]),
        ("critical duffing F --harmonics auto", ["--harmonics auto", "whole number", "--harmonics 16"]),
        (
            "survey duffing --harmonics auto",
            ["--harmonics auto", "whole number", "only hbgear trace and hbgear extend"],
        ),
        (f"gear {DRAWING} --harmonics auto", ["--harmonics auto", "whole number", "--harmonics 16"]),
        ("trace duffing --element 1", ["no element 1", "'x'"]),
        ("trace duffing --element y", ["no element 'y'", "'x'"]),
        ("trace duffing -o curve.txt", ["'curve.txt'", ".npz, .csv or .mat"]),
        ("trace duffing -o nowhere/curve.npz", ["no folder 'nowhere'", "create it"]),
        ("trace duffing --plot curve.jpg", ["'curve.jpg'", ".png, .pdf or .svg"]),
        ("trace duffing --plot nowhere/curve.png", ["no folder 'nowhere'", "create it"]),
        ("trace duffing --max-points 1", ["--max-points", "2"]),
        ("trace", ["MODEL", "--help"]),
        ("trac duffing", ["'trac'", "--help"]),
        ("trace duffing --harmonic 3", ["--harmonic", "--help"]),
        ("info missing.npz", ["no file 'missing.npz'"]),
        ("jumps missing.npz", ["no file 'missing.npz'"]),
        ("plot missing.npz", ["no file 'missing.npz'"]),
    ],
)
def test_bad_input(run, args, words):
    refused(run, args.split(), *words)


def test_number_of_harmonics_of_a_curve_in_contact_instants(run):
    """It is that of the results; the curve does not depend on it, but H = 4 leaves out a part of the motions."""
    curves = []
    for H in (4, 20):
        line = f"trace spur-pair --from 0.9 --to 0.88 --no-stability --instants --harmonics {H} -o {H}.npz"
        code, _, err = run(line)
        assert (code, err) == (0, "")
        curves.append(hb.load(f"{H}.npz"))
    few, many = curves
    assert (few.layout.harmonics, many.layout.harmonics) == (4, 20)
    np.testing.assert_allclose(few.values, many.values, rtol=1e-9)
    np.testing.assert_allclose(few.X, many.X[:, : few.X.shape[1]], atol=1e-9)
    assert few.error.max() > 100 * many.error.max()


def test_nothing_is_computed_before_outputs_are_checked(run, monkeypatch):
    monkeypatch.setattr(hb, "trace", lambda *_, **__: pytest.fail("traced"))
    for output in (["-o", "curve.txt"], ["--plot", "nowhere/curve.png"], ["--measure", "loud"], ["--element", "7"]):
        assert run("trace", "duffing", *output)[0] == 2


def test_output_that_cannot_be_written(run):
    os.mkdir("taken.npz")
    refused(run, ["trace", "duffing", "-o", "taken.npz"], "it is a folder")
    if os.name == "posix" and os.geteuid() != 0:
        os.mkdir("locked", mode=0o500)
        refused(run, ["trace", "duffing", "-o", "locked/a.npz"], "you may not write in 'locked'")


def test_files_that_are_no_branch(run, saved):
    whole = saved.read_bytes()
    Path("text.npz").write_text("no archive")
    Path("cut.npz").write_bytes(whole[: len(whole) // 2])
    Path("empty.npz").write_bytes(b"")
    np.savez("foreign.npz", x=np.arange(3))
    os.mkdir("folder.npz")
    for name in ("text", "cut", "empty", "foreign", "folder"):
        for command in ("info", "jumps", "plot"):
            refused(run, [command, f"{name}.npz"], f"'{name}.npz' cannot be read as a branch", "hbgear trace -o")


def test_points_that_are_not_there(run, saved):
    refused(run, ["plot", saved, "--point", "LP9"], "no special point 'LP9'", "LP1")
    refused(run, ["plot", saved, "--point", "9.5"], "--point 9.5", "from 0.6 to 1.5")
    refused(run, ["plot", saved, "--point", "LP1", "-o", "x.jpg"], ".png, .pdf or .svg")
    refused(run, ["info", saved, "--element", "tooth"], "no element 'tooth'", "'gap'")


def free_pair(load):
    """Two masses with a backlash spring between them and nothing to ground."""
    gap = hb.Element([1.0, -1.0], hb.Backlash(b=1.0), damping=0.1, name="mesh")
    return hb.System(np.eye(2), None, np.zeros((2, 2)), [gap], hb.Load(constant=load), dof_names=["pinion", "wheel"])


def test_unbalanced_torque_names_the_motion():
    hb.HarmonicBalance(free_pair([0.5, -0.5]), 3)
    with pytest.raises(ValueError, match=r"balance.*") as error:
        hb.HarmonicBalance(free_pair([0.5, -0.4]), 3)
    assert "pinion" in str(error.value) and "wheel" in str(error.value)


def test_singular_and_ill_formed_matrices():
    gap = hb.Element([1.0, 0.0], hb.Backlash())
    with pytest.raises(ValueError, match=r"element 'element 1' acts on coordinate 'q1' without mass and damping"):
        hb.HarmonicBalance(hb.System(np.diag([0.0, 1.0]), None, np.eye(2), [gap]), 3)
    with pytest.raises(ValueError, match=r"K has shape \(3, 3\); need \(2, 2\)"):
        hb.System(np.eye(2), None, np.eye(3), [gap])
    with pytest.raises(ValueError, match=r"M has entries that are not finite"):
        hb.System(np.diag([1.0, np.nan]), None, np.eye(2), [gap])


# ---- digits


@pytest.mark.parametrize("harmonics", [5, 8, 16])
def test_digits_are_printed_as_far_as_they_hold(harmonics):
    """What is printed is within three times its own error of what many harmonics give."""
    coarse, fine = (
        hb.trace(hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), H), "Omega", (2.6, 0.55)) for H in (harmonics, 48)
    )
    for label in ("PD1", "PD2", "LP1", "LP2"):
        text, true = summary.text_at(coarse[label], "Omega"), fine[label].parameters["Omega"]
        digits, units = re.fullmatch(r"([\d.]+)(?:\((\d)\))?", text).groups()
        unit = 10.0 ** -len(digits.partition(".")[2])
        assert abs(float(digits) - true) <= unit * (3 * int(units or 0) + 0.5) and unit <= 1e-5


def test_the_map_and_the_critical_value_agree_in_every_digit(run):
    span = ["--from", 1.2, "--to", 0.6]
    _, map_, _ = run("map", "spur-pair", "--in", "zeta=0.1:0.13", "--seeds", 2, *span)
    _, critical, _ = run("critical", "spur-pair", "zeta", "--set", "zeta=0.1", *span)
    found = re.search(r"vanishes at zeta = (\S+), Omega = (\S+)", map_)
    assert found and f"zeta = {found[1]}: a jump exists below" in critical
    assert f"Omega = {found[2]}\n" in critical
    digits, units = re.fullmatch(r"(0\.1180068)\((\d)\)", found[1]).groups()
    off = abs(float(digits) - 0.11800746)  # with 32 and with 64 harmonics
    assert off <= int(units) * 1e-7 < 2 * off


def test_jumps_outside_the_range_of_the_response_curves_are_marked(run):
    """With falling damping a fold leaves the range in which folds were searched; the other one remains in it."""
    line = ["map", "spur-pair", "--in", "zeta=0.08:0.13", "--seeds", 2, "--harmonics", 8, "--to", 0.9]
    narrow, whole = (run(*line, "--from", first)[1] for first in (0.8, 0.5))
    assert "leaves the range of the response curves, 0.8 to 0.9" in " ".join(narrow.split()) and "leaves" not in whole
    marked = [row for row in narrow.splitlines() if " * " in row]
    assert len(marked) == 1 and "decreasing" in marked[0]


# ---- going on


def test_extend_goes_on_as_far_as_the_curve_was_to_go(run):
    spur = ["trace", "spur-pair", "--harmonics", "8", "--from", 1.5, "--to", 0.6]
    assert run(*spur, "-o", "whole.npz")[0] == 0
    code, out, _ = run(*spur, "--max-points", 30, "-o", "part.npz")
    assert code == 3 and "hbgear extend FILE" in " ".join(out.split())
    code, out, err = run("extend", "part.npz", "-o", "part.npz", "--plot", "part.png")
    whole, curve = hb.load("whole.npz"), hb.load("part.npz")
    assert (code, err) == (0, "") and "part.npz: 31 points, " in out and "wrote part.npz, part.png" in out
    assert [p.label for p in curve.special] == [p.label for p in whole.special]
    places = [[p.parameters["Omega"] for p in branch.special] for branch in (curve, whole)]
    np.testing.assert_allclose(*places, rtol=0, atol=1e-9)
    code, out, err = run("extend", "part.npz")
    assert code == 2 and "give a longer span, --to in a command" in err
    code, out, err = run("extend", "part.npz", "--to", 0.5, "--harmonics", 12, "-o", "longer.npz")
    assert (code, err) == (0, "") and hb.load("longer.npz").values[-1] == 0.5
    assert hb.load("longer.npz").layout.harmonics == 12
    code, _, err = run("extend", "part.npz", "--in", "zeta=0.1:0.2")
    assert code == 2 and "this curve is in Omega" in err


def test_extend_continues_every_curve_of_a_file(run):
    problem, few = hb.HarmonicBalance(hb.SpurPair(), 8), hb.StepControl(max_points=30)
    first, other = (hb.trace(problem, "Omega", span, steps=few, cover=False) for span in ((1.5, 0.6), (0.6, 1.5)))
    dataclasses.replace(first, others=(other,)).save("both.npz")
    code, out, err = run("extend", "both.npz", "-o", "whole.npz")
    whole = hb.load("whole.npz")
    assert (code, err) == (0, "") and all(curve.status.complete for curve in whole.curves)
    count, more = len(first) + len(other), sum(map(len, whole.curves)) - len(first) - len(other)
    assert f"both.npz: {count} points, {more} more" in " ".join(out.split())
    assert [point.kind for point in whole.special] == [point.kind for point in whole.others[0].special[::-1]]


def test_trace_starts_at_a_point_of_a_saved_curve(run, saved):
    fold = hb.load(saved)["LP1"]
    start = ["--start", f"{saved}:LP1", "--harmonics", 5]
    code, _, err = run("trace", "spur-pair", "--in", "zeta=0.02:0.1", *start, "-o", "zeta.npz")
    curve = hb.load("zeta.npz")
    assert (code, err) == (0, "") and curve.fixed["Omega"] == fold.parameters["Omega"] and curve.fixed["F_m"] == 0.11
    nearest = np.argmin(np.linalg.norm(curve.X - fold.X, axis=1))
    assert np.linalg.norm(curve.X[nearest] - fold.X) < 1e-6
    start[1] = f"{saved}:1.45"
    code, _, err = run("trace", "spur-pair", "--set", "F_m=0.1", "--to", 0.9, *start, "-o", "F.npz")
    assert (code, err) == (0, "") and hb.load("F.npz").fixed["F_m"] == 0.1
    refused(run, ["trace", "duffing", *start], "the curve of --start is of SpurPair", "'duffing' is Duffing")
    refused(run, ["trace", "spur-pair", "--start", f"{saved}:LP9"], "no special point 'LP9'")
    refused(run, ["trace", "spur-pair", "--start", "missing.npz"], "no file 'missing.npz'")


# ---- what the shell offers


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("ext", ["extend"]),
        ("trace d", ["duffing", "double-helical"]),
        ("trace duffing --set ", ["zeta=", "k3=", "F="]),
        ("map spur-pair --in ze", ["zeta="]),
        ("trace duffing --in ", ["Omega=", "zeta=", "k3=", "F="]),
        ("critical duffing z", ["zeta"]),
        ("plot FILE --point L", ["LP1", "LP2"]),
        ("switch FILE ", []),
        ("plot missing.npz --point ", []),
        ("info FILE --measure r", ["rms"]),
    ],
)
def test_shell_completion(run, saved, monkeypatch, typed, offered):
    words = f"hbgear {typed}".replace("FILE", str(saved))
    monkeypatch.setenv("_HBGEAR_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split(" ")) - 1))
    code, out, err = run()
    assert (code, err) == (0, "") and out.split() == offered


# ---- help


@pytest.mark.parametrize("name", sorted(typer.main.get_command(cli.app).commands))
def test_help_names_only_options_of_its_own_command(name):
    command = typer.main.get_command(cli.app).commands[name]
    texts = [command.help, *(getattr(parameter, "help", "") for parameter in command.params)]
    own = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    assert {option for text in texts for option in re.findall(r"--[a-z][a-z-]*", text or "")} <= own


def test_a_saved_curve_is_no_model(run):
    assert (
        "'pair.npz' is the name of a saved curve; give a model, FILE.toml or FILE.py:NAME"
        in run("trace", "pair.npz")[2]
    )


# ---- what is unlikely


@pytest.mark.parametrize(
    "args, words",
    [
        ("spur-pair --from 12000 --to 9000", ["Omega = 12000", "r/min"]),
        ("double-helical --set b_c=80 --from 1.6 --to 1.5", ["b_c = 80.0", "unit (m)"]),
        ("spur-pair --harmonics 1 --from 1.5 --to 1.4", ["1 harmonic of", "contact"]),
    ],
)
def test_unlikely_input_is_computed_with_a_warning(run, args, words):
    code, _, err = run("trace", *args.split(), "--no-stability")
    assert code == 0 and err.startswith("hbgear: warning: ")
    assert all(word in err for word in words)
    assert len(err.splitlines()) == len(set(err.splitlines()))


def test_the_models_tell_their_ranges(run):
    assert "zeta, b must not be negative" in run("models")[1]


@pytest.mark.parametrize(
    ("former", "present"),
    [
        ("answers no.npz", "results no.npz"),
        ("survey duffing --places 0", "survey duffing --frequencies 0"),
        ("survey duffing --places=0", "survey duffing --frequencies=0"),
        ("sweep duffing --longest 10", "sweep duffing --max-periods 10"),
        ("sweep duffing --over no.npz", "sweep duffing --curve no.npz"),
        ("basins duffing --omega 0.9 --longest 0", "basins duffing --omega 0.9 --max-periods 0"),
    ],
)
def test_former_names_of_commands_and_options_still_work(run, former, present):
    """They do the same, here refuse the same value with the same message."""
    code, out, err = run(*former.split())
    assert code == 2 and "No such" not in err
    assert (code, out, err) == run(*present.split())


def test_former_names_are_not_in_the_help(run):
    text = "".join(run(*line.split())[1] for line in ("--help", "survey --help", "sweep --help", "basins --help"))
    for name in ("answers", "--places", "--longest", "--over"):
        assert name not in text
    for name in ("results", "--frequencies", "--max-periods", "--curve"):
        assert name in text


def test_help_has_no_brackets_that_the_terminal_takes_as_styles():
    from typer.main import get_command

    for name, command in get_command(cli.app).commands.items():
        texts = [command.help or "", *(getattr(one, "help", None) or "" for one in command.params)]
        assert not [text for text in texts if re.search(r"\[[a-z/]", text)], name


def test_the_example_of_an_argument_has_no_option():
    with pytest.raises(ValueError, match=r"^NAME=DEVIATION zeta: need NAME=VALUE, such as zeta=0\.05$"):
        assignments("NAME=DEVIATION", ["zeta"])
    with pytest.raises(ValueError, match=r"such as --set zeta=0\.05$"):
        assignments("--set", ["zeta"])
