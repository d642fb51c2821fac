"""``hbgear backbone``, ``cycles``, ``torus`` and ``follow``."""

import re
import textwrap

import numpy as np
import pytest
from machines import gear_pair
from typer.testing import CliRunner

import hbgear as hb
from hbgear.cli import app as cli
from hbgear.web.editable_model import EditableInstance
from hbgear.web.explorer import Explorer
from hbgear.web.overlay import lines_of_motions

MODELS = """
from dataclasses import dataclass

import numpy as np

import hbgear as hb


@dataclass(frozen=True)
class VanDerPol(hb.mechanics.Law):
    def force(self, d, v, tau):
        return 0.2 * (d**2 - 1) * v, 0.4 * d * v, 0.2 * (d**2 - 1)


@hb.mechanics.model
def oscillator(damping: float = 0.0) -> hb.System:
    return hb.System([[1.0]], [[damping]], [[1.0]], [hb.Element([1.0], VanDerPol())])


@hb.mechanics.model
def masses(F: float = 0.13) -> hb.System:
    C, K = [[0.015, -0.013], [-0.013, 0.013]], [[1.0453, -0.0453], [-0.0453, 0.0453]]
    springs = [hb.Element([1.0, 0.0], hb.Cubic(1.0), name="ground"), hb.Element([1.0, -1.0], hb.Cubic(0.0042))]
    return hb.System(np.diag([1.0, 0.05]), C, K, springs, hb.Load(cosine={1: [F, 0.0]}))


@hb.mechanics.model
def equal_masses(k3: float = 1.0) -> hb.System:
    springs = [hb.Element([1, 0], hb.Cubic(k3)), hb.Element([0, 1], hb.Cubic(k3))]
    return hb.System(np.eye(2), None, [[3.0, -2.0], [-2.0, 3.0]], springs)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a file of models and the curve of the two masses."""
    path = tmp_path_factory.mktemp("motions")
    (path / "models.py").write_text(textwrap.dedent(MODELS), encoding="utf-8")
    done = run(
        "trace",
        f"{path}/models.py:masses",
        "--from",
        "1.1",
        "--to",
        "1.15",
        "--harmonics",
        "5",
        "-o",
        f"{path}/masses.npz",
    )
    assert done.exit_code in (0, 3), done.output
    return path


def run(*args):
    return CliRunner().invoke(cli.app, list(args))


def numbers(line):
    return [float(x) for x in re.findall(r"[-+0-9.e]+", line)]


def test_backbone(tmp_path):
    done = run(
        "backbone", "spur-pair", "--amplitudes", "0.01:0.2", "-o", f"{tmp_path}/b.npz", "--plot", f"{tmp_path}/b.png"
    )
    assert done.exit_code == 0 and "backbone of mode 1" in done.output
    assert "a backbone has no jumps: they belong to response curves" in run("jumps", f"{tmp_path}/b.npz").output
    saved = hb.load(tmp_path / "b.npz")
    first, *_ = [line for line in done.output.splitlines() if line.strip().startswith("1 ")]
    assert numbers(first)[:2] == pytest.approx([saved.tracked["Omega"][0], saved.tracked["modal_damping"][0]], abs=1e-4)
    assert (tmp_path / "b.png").stat().st_size > 1000


@pytest.mark.slow
def test_cycles(folder):
    done = run(
        "cycles", f"{folder}/models.py:oscillator", "--in", "damping=0.4:0", "--harmonics", "9", "-o", f"{folder}/c.npz"
    )
    assert done.exit_code == 0 and "Hopf points" in done.output
    saved = hb.load(folder / "c.npz")
    assert saved.tracked["Omega"][-1] == pytest.approx(0.9975088563587282, abs=1e-8)  # eps = 0.2, by shooting
    assert f"{saved.tracked['Omega'][-1]:.6g}" in done.output


@pytest.mark.slow
def test_torus(folder):
    done = run(
        "torus",
        f"{folder}/masses.npz",
        "NS1",
        "--model",
        f"{folder}/models.py:masses",
        "--from",
        "1.1",
        "--to",
        "1.13",
        "-o",
        f"{folder}/t.npz",
        "--plot",
        f"{folder}/t.png",
    )
    assert done.exit_code == 0 and "Estimated relative error: response" in done.output, done.output
    saved = hb.load(folder / "t.npz")
    assert ("no special points" in done.output) is not bool(saved.special)
    ratio = np.interp(1.12, saved.values, saved.tracked["Omega_2"]) / 1.12
    assert ratio == pytest.approx(0.08538421776875502, abs=1e-4)  # invariant circle
    assert (folder / "t.png").stat().st_size > 1000
    assert run("info", f"{folder}/t.npz").exit_code == 0
    done = run(
        "torus",
        f"{folder}/t.npz",
        "--model",
        f"{folder}/models.py:masses",
        "--from",
        "1.1",
        "--to",
        "1.14",
        "-o",
        f"{folder}/longer.npz",
    )
    assert done.exit_code == 0 and f"{len(saved)} points of {folder}/t.npz continued" in done.output, done.output
    assert hb.load(folder / "longer.npz").values[-1] == 1.14
    done = run("torus", f"{folder}/t.npz", "--model", f"{folder}/models.py:masses", "--to", "1.27")
    assert re.search(r"EP1.* 1\.2513?\d*.* joins the one it came from", " ".join(done.output.split())), done.output


@pytest.mark.parametrize("end, expected", [("0.7", "all motions without dissipation are stable"), ("1", "0.78483")])
def test_the_stability_of_a_backbone_without_dissipation(folder, end, expected):
    done = run("backbone", f"{folder}/models.py:equal_masses", "--amplitudes", f"0.1:{end}", "--harmonics", "5")
    assert done.exit_code == 0 and expected in done.output, done.output


@pytest.mark.slow
def test_tori_and_backbones_are_drawn_on_saved_curves(folder):
    """`hbgear plot --with`, a report and the explorer have them, in the units of the axes."""
    assert (
        run(
            "torus",
            f"{folder}/masses.npz",
            "NS1",
            "--model",
            f"{folder}/models.py:masses",
            "--from",
            "1.1",
            "--to",
            "1.12",
            "-o",
            f"{folder}/tori.npz",
        ).exit_code
        == 0
    )
    assert (
        run(
            "backbone",
            f"{folder}/models.py:masses",
            "--amplitudes",
            "0.01:0.3",
            "--harmonics",
            "5",
            "-o",
            f"{folder}/backbone.npz",
        ).exit_code
        == 0
    )
    done = run(
        "plot",
        f"{folder}/masses.npz",
        "--with",
        f"{folder}/tori.npz",
        "--with",
        f"{folder}/backbone.npz",
        "-o",
        f"{folder}/all.svg",
    )
    assert done.exit_code == 0, done.output
    figure = (folder / "all.svg").read_text(encoding="utf-8")
    assert 'id="tori' in figure and 'id="backbone' in figure
    files = [f"{folder}/{name}.npz" for name in ("masses", "tori", "backbone")]
    assert run("report", *files, "-o", f"{folder}/r.html").exit_code == 0
    page = (folder / "r.html").read_text(encoding="utf-8")
    tori = hb.load(folder / "tori.npz")
    lines = [line for file in files[1:] for line in lines_of_motions(hb.load(file))]
    np.testing.assert_allclose(lines[0]["sizes"]["rms"][1], tori.amplitude("rms", 1), rtol=1e-6)
    assert [line["name"] for line in lines] == ["quasi-periodic", "backbone"]
    assert '"dash":"dashdot"' in page and tori.message in page
    with pytest.raises(ValueError, match="needs a response curve"):
        hb.report(tori)
    masses = hb.load(folder / "masses.npz")
    explorer = Explorer(EditableInstance(hb.Duffing(), ""), (1.1, 1.15), 5, masses, [tori])
    assert [line["name"] for line in explorer.start()["behind"]] == ["saved curve", "quasi-periodic"]


def test_axes_of_machines_with_scales_are_physical():
    pair = hb.gears.DoubleHelicalPair(zeta=0.05)
    curve = hb.trace(hb.HarmonicBalance(pair, 4), "Omega", (1.3, 1.2), stability=False)
    backbone = hb.analysis.backbone(pair, 1, (0.01, 0.02), harmonics=3)
    axes = hb.plot.responses([curve, backbone])
    (line,) = (line for line in axes.lines if line.get_gid() == "backbone")
    scales = hb.gears.DoubleHelicalPair(zeta=0.05)
    assert line.get_xdata()[0] == pytest.approx(scales.pinion_speed(backbone.tracked["Omega"][0]), rel=1e-12)
    length = curve.problem.model.scales.length
    assert line.get_ydata()[0] == pytest.approx(1e6 * length * backbone.amplitude("pp2")[0], rel=1e-12)


def test_follow(folder):
    """The Neimark-Sacker point at F = 0.1 by shooting."""
    done = run(
        "follow",
        f"{folder}/masses.npz",
        "NS1",
        "--in",
        "F=0.13:0.1",
        "--model",
        f"{folder}/models.py:masses",
        "-o",
        f"{folder}/f.npz",
        "--plot",
        f"{folder}/f.png",
    )
    assert done.exit_code == 0, done.output
    assert hb.load(folder / "f.npz").tracked["Omega"][-1] == pytest.approx(1.1301287894345817, abs=1e-5)
    assert "no special points" in done.output and (folder / "f.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_point_of_a_saved_backbone_is_followed(tmp_path):
    """Contact is lost where the rms is the mean load over the square root of 2."""
    assert run("backbone", "spur-pair", "--amplitudes", "0.01:0.2", "-o", f"{tmp_path}/b.npz").exit_code == 0
    done = run(
        "follow",
        f"{tmp_path}/b.npz",
        "GR1",
        "--in",
        "F_m=0.1:0.3",
        "-o",
        f"{tmp_path}/f.npz",
        "--plot",
        f"{tmp_path}/f.png",
    )
    assert done.exit_code == 0, done.output
    found = hb.load(tmp_path / "f.npz")
    assert found.tracked["amplitude"][-1] == pytest.approx(0.3 / 2**0.5, rel=1e-9)
    assert isinstance(found.require_problem(), hb.harmonic.BackboneProblem)
    assert hb.plot.special_curves([found]).get_ylabel() == "rms of $x$ [-]"
    assert (tmp_path / "f.png").stat().st_size > 1000


@pytest.mark.slow
def test_follow_in_a_parameter_of_a_drawing_with_its_unit(folder):
    drawn = hb.gears.DrawnPair(gear_pair(), 200.0, 0.04)
    hb.trace(hb.HarmonicBalance(drawn, 6), "Omega", (1.2, 0.6)).save(folder / "pair.npz")
    for name, within in (("a", "torque=0.2kNm:205Nm"), ("b", "torque=200:205")):
        done = run("follow", f"{folder}/pair.npz", "LP1", "--in", within, "-o", f"{folder}/{name}.npz")
        assert done.exit_code == 0, done.output
    a, b = (hb.load(folder / f"{name}.npz") for name in "ab")
    assert a.values[-1] == 205.0 and a.tracked["Omega"][-1] == pytest.approx(b.tracked["Omega"][-1], rel=1e-12)


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("backbone", "spur-pair", "--amplitudes", "1"), "need FROM:TO"),
        (("backbone", "spur-pair", "--harmonics", "auto"), "whole number"),
        (("cycles", "duffing", "--in", "zeta=0.1:0.2"), "no Hopf point"),
    ],
)
def test_bad_input(args, message, capsys):
    with pytest.raises(SystemExit) as stopped:
        cli.main(list(args))
    assert stopped.value.code == 2 and message in capsys.readouterr().err
