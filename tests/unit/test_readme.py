"""Every block of the README and of the pages of the site runs, and what it says of its results is so.

Commands run in this process; what would take minutes is made short by `SHORTER`.
"""

import itertools
import os
import re
import shlex
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from cross.test_dask import cluster
from pages import (
    BLOCKS,
    NUMBER,
    REPOSITORY,
    TEXTS,
    agrees,
    blocks,
    blocks_of,
    commands,
    run_python,
    said,
    stated,
    table_after,
    write_files,
)

import hbgear as hb
from hbgear.cli import app as cli
from hbgear.continuation.results.stability import STABILITY_TOLERANCE
from hbgear.design.studies.study_file import read_study
from hbgear.harmonic.equations.layout import REGIMES
from hbgear.harmonic.models import model_registry
from hbgear.io.machines.machine_file import read_machine

README = TEXTS["README.md"]
PYTHON = [block for block in blocks("python") if not block.file]

SHORTER = {
    "sweep": ["--count", "3", "--tolerance", "1e-2"],
    "map": ["--harmonics", "6"],
    "validate": ["--points", "4"],
    "scatter": ["--draws", "20"],
    "survey": ["--harmonics", "4"],
}
"""Options that are added to a command, to the same work with less of it."""
CASES = 3
"""Cases of a study instead of those in its file."""
ADDRESS = "tcp://127.0.0.1:8786"
"""Of the Dask scheduler that a page names; one of the test stands in for it."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder to work in, where modules are found."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    plt.close("all")


# ---- Python


@pytest.mark.parametrize(
    ("text", "got", "so"),
    [
        ("0.118", "0.11801", True),
        ("0.118", "0.1186", False),
        ("[0.84, 12]", "[0.8387, 12]", True),
        ("[0.84, 12]", "[0.8387, 13]", False),
        ("<LP1 at Omega = 0.7, ...>", "<LP1 at Omega = 0.708, stable>", True),
        ("<LP1 at Omega = 0.7, ...>", "<LP2 at Omega = 0.708, stable>", False),
        ("(1.0, 2.0)", "()", False),
        ("1.2e-09", "1.24e-09", True),
        ("1.2e-09", "1.3e-09", False),
    ],
)
def test_results_are_compared_with_the_stated_claims(text, got, so):
    assert agrees(text, got) is so


@pytest.mark.parametrize("block", PYTHON, ids=str)
def test_python_block(block, folder):
    write_files(block.page, folder)
    run_python(block.text)


def test_results_stated_in_code_blocks():
    """By an arrow or an assertion; a number in a comment that stands elsewhere is checked by nothing."""
    for block in PYTHON:
        assert "-> " in block.text or "assert" in block.text, block
        for node, comments in said(block.text):
            for text in comments:
                loose = re.findall(NUMBER, re.sub(r"H = \d+", "", text.partition("->")[0]))
                assert not loose, f"{block}, line {node.lineno}: {loose} in {text!r}"


def test_there_are_blocks_and_results():
    assert len(PYTHON) >= 20 and len(blocks("sh")) >= 6
    assert sum(block.text.count("-> ") for block in PYTHON) >= 40
    assert all(block.language in ("python", "sh", "toml", "text", "matlab") for block in BLOCKS), "of unknown language"


# ---- commands


def run(words, capsys):
    """``(exit code, what was printed, complaints)`` of a command."""
    with pytest.raises(SystemExit) as stop:
        cli.main(words)
    out, err = capsys.readouterr()
    return stop.value.code, out, err


def with_few_cases(text):
    """A study with less to do."""
    return re.sub(r"(?m)^count = \d+", f"count = {CASES}", text)


def shorter(words, folder):
    """The same command, made short; files of the repository are copied to the same place in the folder."""
    for word in words:
        file = Path(word)
        if file.suffix == ".toml" and (REPOSITORY / file).exists():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_text(
                with_few_cases((REPOSITORY / file).read_text(encoding="utf-8")), encoding="utf-8"
            )
    return [*words, *SHORTER.get(words[0], [])]


def run_page(page, folder, capsys):
    """What each command of a page prints, by its first two words; later ones read what earlier ones wrote."""
    write_files(page, folder, with_few_cases)
    out = {}
    for words in itertools.chain(*(commands(block.text) for block in blocks_of(page) if block.language == "sh")):
        if ADDRESS in words:
            with cluster(folder) as (address, *_):
                code, text, err = run([*(word.replace(ADDRESS, address) for word in words), "-o", "by_dask"], capsys)
        else:
            code, text, err = run(shorter(words, folder), capsys)
        assert (code, err) == (0, ""), f"hbgear {' '.join(words)}: {err}"
        out[words[0], words[1] if len(words) > 1 else ""] = text
        for option, name in itertools.pairwise(words):
            if option in ("-o", "--plot"):
                assert os.path.exists(name), f"hbgear {' '.join(words)} did not write {name}"
    assert not plt.get_fignums(), "a command that wrote its figure left it open"
    return out


CHECKED = ("docs/howto/command_line.md", "docs/howto/designs.md", "docs/howto/drawing.md", "docs/howto/matrices.md")
"""Pages whose commands have tests of their own below."""
OTHERS = [
    page
    for page in TEXTS
    if page not in CHECKED and any(commands(block.text) for block in blocks_of(page) if block.language == "sh")
]


@pytest.mark.slow
@pytest.mark.parametrize("page", OTHERS)
def test_commands_of_a_page(page, folder, capsys):
    (folder / "docs").mkdir()
    run_page(page, folder, capsys)


@pytest.mark.slow
def test_commands(folder, capsys):
    out = run_page("docs/howto/command_line.md", folder, capsys)
    low = hb.load("low.npz")
    low = hb.load("low.npz", model_registry.rebuild_problem(low.meta))
    assert [p.kind for p in low.special].count("LP") == 2 and len(low.jumps()) == 2  # "two folds, and jumps"
    assert "F from 0.05" in out["trace", "duffing"] or "F = 0.3 reached" in out["trace", "duffing"]  # "along the load"
    assert all(name in out["models", ""] for name in ("DoubleHelicalPair", "x'' + 2 zeta x'", "zeta=0.05"))
    for jump in low.jumps():  # "from where to where"
        ends = (hb.analysis.machine_quantities(end)["dte, half peak-to-peak"][0] for end in (jump.before, jump.after))
        speed = low.problem.model.scales.pinion_speed(jump.value)
        shown = [float(word) for word in re.findall(r"\d+\.\d+", out["jumps", "low.npz"])]
        for number in (speed, *ends):
            assert min(abs(word / number - 1) for word in shown) < 1e-4  # five digits are printed
    assert "reached" in out["info", "low.npz"] and "truncation error" in out["info", "low.npz"]
    assert Path("low_LP1.png").exists() and Path("low_sweep.png").exists()
    assert "PD1" in [p.label for p in hb.load("pair.npz").special]
    assert "merged" in out["switch", "pair.npz"] or "period" in out["switch", "pair.npz"]
    assert "4 of 4 points agree" in out["validate", "low.npz"]
    assert max(int(number) for number in re.findall(r"branch (\d)", out["survey", "duffing"])) > 2
    assert len(list(Path("tolerances").glob("*.png"))) >= 2 and Path("tolerances/table.csv").exists()


@pytest.mark.slow
def test_commands_of_many_designs(folder, capsys):
    run_page("docs/howto/designs.md", folder, capsys)
    (file,) = [block.text for block in blocks_of("docs/howto/designs.md") if block.file]
    Path("whole.toml").write_text(file, encoding="utf-8")
    study = read_study(Path("whole.toml"))
    assert study.vary.size == 200 and study.model == hb.gears.DoubleHelicalPair(zeta=0.055)
    assert all(Path("designs", name).exists() for name in ("table.csv", "table.npz", "envelope.png"))
    assert Path("by_dask/table.csv").exists()


@pytest.mark.slow
def test_commands_from_a_drawing(folder, capsys):
    """And the file that is shown, which the first of them would have written with less in it."""
    run_page("docs/howto/drawing.md", folder, capsys)
    model = read_machine("bearings.toml").model()
    equations = model.equations
    assert isinstance(equations, hb.gears.GearRotorBearing) and equations.b_1 * model.scales.length == pytest.approx(
        5e-6
    )


def test_commands_with_a_machine_of_your_own(folder, capsys):
    out = run_page("docs/howto/matrices.md", folder, capsys)
    assert "4 of 4 points agree" in out["validate", "two.npz"]


def test_every_other_line_installs():
    """They are run by .ci/run: the tests and the site by their commands, the figure by its own."""
    lines = [line for block in blocks("sh") for line in block.text.splitlines() if line.strip()]
    others = [line for line in lines if not line.startswith(("hbgear ", "#"))]
    assert len(others) == 3 and all(line.startswith("python3 -m venv ") for line in others)


def test_the_first_command_draws_the_figure(folder, capsys):
    (line,) = [block.text for block in blocks_of("README.md") if "pip install . " in block.text]
    words = shlex.split(line.rpartition("hbgear ")[2])
    Path("docs").mkdir()
    code, out, err = run(words, capsys)
    assert (code, err) == (0, "") and "no jumps" in out  # "as published (zeta = 0.063) has none"
    assert Path("double_helical.npz").exists() and Path("docs/double_helical.png").stat().st_size > 20_000


def test_ci_runs_the_commands():
    script = (REPOSITORY / ".ci/run").read_text(encoding="utf-8")
    patterns = re.findall(r"grep -m 1 '(.*?)' README.md", script)
    assert len(patterns) == 2 and all(re.search(pattern, README, re.MULTILINE) for pattern in patterns)
    assert os.access(REPOSITORY / ".ci/run", os.X_OK)


def test_exit_codes(folder, capsys):
    codes = re.search(r"Exit codes: (.*?)\.\s", TEXTS["docs/howto/command_line.md"], re.DOTALL)
    assert codes and re.findall(r"\d", codes[1]) == ["0", "1", "2", "3"]
    assert run(shlex.split("trace duffing --harmonics 5 --max-points 20 -o a.npz"), capsys)[0] == 3
    curve = hb.load("a.npz")
    assert len(curve) == 20  # "what was computed by then is saved"
    replace(curve, X=1.01 * curve.X).save("wrong.npz")
    assert run(["validate", "wrong.npz", "--points", "1"], capsys)[0] == 1
    assert run(["trace", "duffign"], capsys)[0] == 2


# ---- numbers in the text


def cell(study, table, row, column):
    """Text in a table of the studies of speed: the first row that begins with these cells."""
    text = (REPOSITORY / "studies/speed/figures" / f"{study}.md").read_text(encoding="utf-8")
    rows = table_after(text, table)
    (found, *_) = [cells for cells in rows if cells[: len(row)] == row]
    return found[rows[0].index(column)]


ALL = " ".join(" ".join(TEXTS.values()).split())
ACCURACY = table_after(TEXTS["docs/theory/accuracy.md"], "| H | LP1 | LP2 |")[2:7]


@pytest.mark.parametrize("row", ACCURACY, ids=[row[0] for row in ACCURACY])
def test_table_of_folds(row):
    H, *samples = (int(number) for number in re.findall(r"\d+", row[0].replace("(a cross-check)", "")))
    settings = {"samples": samples[0], "sampled": True} if samples else {}
    problem = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), H, **settings)
    curve = hb.trace(problem, "Omega", (0.89, 0.84), stability=False)
    for label, text in zip(("LP1", "LP2"), row[1:], strict=True):
        assert curve[label].parameters["Omega"] == pytest.approx(float(text), abs=0.6e-7)


def test_defaults_and_tolerances():
    (default,) = (row[0] for row in ACCURACY if "default" in row[0])
    assert int(default.split()[0]) == hb.HarmonicBalance(hb.Duffing()).H
    assert stated(r"size of the forces \(at most ([\d.e-]+) by default\)") == [hb.NewtonSettings().tolerance]
    assert stated(r"outside the unit circle by more than ([\d.e-]+[\d])") == [STABILITY_TOLERANCE]


def test_times_are_those_of_the_studies():
    def seconds(problem, tool):
        return round(float(cell("peers", "| problem | tool |", [problem, tool], "curve [s]")), 2)

    text = r"Duffing curve of (\d+) points.*? to ([\de-]+), takes ([\d.]+) s, a spur pair ([\d.]+) s"
    points, folds, duffing, spur = stated(text)
    assert folds == float(cell("peers", "| problem |", ["Duffing", "hbgear, stability"], "error of folds"))
    assert points == int(cell("peers", "| problem |", ["Duffing", "hbgear, stability"], "points"))
    assert duffing == seconds("Duffing", "hbgear, stability") and spur == seconds("spur pair", "hbgear, stability")
    (own,) = stated(r"and the double-helical pair ([\d.]+) s")
    assert own == round(float(cell("points", "| case |", ["DoubleHelicalPair, H = 16"], "curve [s]")), 1)
    others = stated(r"without stability: ([\d.]+) s and more, ([\d.]+) s and more")
    for least, problem in zip(others, ("Duffing", "spur pair"), strict=True):
        tools = ("pyHarm", "harmonicbalance", "mousai")
        assert least == min(seconds(problem, tool) for tool in tools)
    more = stated(r"takes ([\d.]+), ([\d.]+) and ([\d.]+) ms, stability included")
    cases = ("Duffing, H = 7", "SpurPair, H = 10", "DoubleHelicalPair, H = 16")
    each = [float(cell("points", "| case |", [case], "each point more [ms]")) for case in cases]
    assert more == [round(each[0], 2), round(each[1], 2), round(each[2], 1)]
    threads = float(cell("points", "| case |", ["DoubleHelicalPair, H = 16"], "two threads / one"))
    assert "no faster with two threads than with one" in ALL and threads > 0.9


def test_comparison_is_that_of_the_studies():
    """The page that compares hbgear with other tools."""
    own, other, spur, spur_other, error, other_error = stated(
        r"takes hbgear ([\d.]+) s with stability and folds, the next package ([\d.]+) s without stability; a spur pair "
        r"with backlash ([\d.]+) s and ([\d.]+) s\. The folds of the spur pair come out to ([\de-]+) and ([\de-]+)\."
    )
    columns = ("curve [s]", "curve [s]", "curve [s]", "curve [s]", "error of folds", "error of folds")
    rows = [[p, t] for p in ("Duffing", "spur pair") for t in ("hbgear, stability", "pyHarm")]
    found = [
        float(cell("peers", "| problem |", row, column)) for row, column in zip(rows + rows[2:], columns, strict=True)
    ]
    assert [own, other, spur, spur_other] == [round(value, 2) for value in found[:4]]
    assert [error, other_error] == found[4:]
    assert cell("peers", "| problem |", ["spur pair", "mousai"], "folds") == "0"  # "some of them find no fold"


def test_cost_of_sweeps_and_of_size_is_that_of_the_studies():
    count, ratio, slow = stated(r"sweep of (\d+) frequencies.*? costs (\d+) times .*? about (\d+) times")
    row = "| sweeps, 131 frequencies up and down, settled to |"
    assert count == 131 and "settled to 1e-5" in ALL
    assert ratio == float(cell("sweep_ratio", row, ["1e-05"], "over continuation (H = 16)"))
    assert slow == round(float(cell("sweep_ratio", row, ["1e-05"], "over continuation")), -2)
    chain, ten = stated(r"a chain of (\d+) masses costs per point as much as one of (\d+), without")
    ratio = float(cell("scale", "| n of the chain |", [f"{chain:.0f}"], "points alone over n = 10"))
    assert ten == 10 and ratio == pytest.approx(1.0, abs=0.2)  # of times below a tenth of a millisecond
    (large,) = stated(r"structures of (\d+ \d+) coordinates".replace(r"(\d+ \d+)", r"(100) 000"))
    assert large == 100 and cell("scale", "| n of the housing |", ["99896"], "[ms/point]")


def test_numbers_of_the_double_helical_pair():
    pair, text = hb.gears.DoubleHelicalPair(), ALL
    (omega,) = stated(r"omega_n = sqrt\(k_mean/m_c\), (\d+) rad/s")
    assert omega == pytest.approx(2 * np.pi * pair.mesh_frequency(1.0), abs=0.5)
    (dofs,) = stated(r"double-helical gear pair with (\d+) degrees of freedom")
    assert dofs == pair.system().n == stated(r"scales the (\d+) coordinates back")[0]
    assert f"as published (zeta = {pair.zeta:g}) has none, with zeta = 0.05 it has two" in text
    assert all(f"`{name}`" in text for name in ("pp2", "rms", "max", "mean", *REGIMES[:3]))


def test_every_status_has_its_advice_on_the_page():
    rows = dict(table_after(TEXTS["docs/howto/trouble.md"], "| status |")[2:])
    assert rows == {f"`{status}`": status.advice for status in hb.Status}
