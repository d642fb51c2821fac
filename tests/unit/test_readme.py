"""Every block of the README runs, and what it says of its results is so.

In Python what follows "->" in a comment is what the statement gives or prints: numbers to the digits written, "..." for
anything. Commands run in this process; what would take minutes is made short by `SHORTER`.
"""

import ast
import contextlib
import io
import itertools
import os
import re
import shlex
import sys
import tokenize
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from cross.test_dask import cluster

import hbgear as hb
from hbgear.cli import app as cli
from hbgear.continuation.branch import NEUTRAL
from hbgear.design.study_file import read_study
from hbgear.harmonic.observables import REGIMES
from hbgear.io.machine_file import read_machine

REPOSITORY = Path(__file__).parents[2]
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
NUMBER = r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?"

SHORTER = {
    "sweep": ["--count", "3", "--tolerance", "1e-2"],
    "map": ["--harmonics", "6"],
    "validate": ["--points", "4"],
    "survey": ["--harmonics", "4"],
}
"""Options that are added to a command, to the same work with less of it."""
CASES = 3
"""Cases of a study instead of those in its file."""
RUN = ("hbgear models", "hbgear gear", "hbgear study designs.toml", "hbgear trace mine.py:two")
"""What is in the blocks of commands that tests of this file run."""
ADDRESS = "tcp://127.0.0.1:8786"


def blocks(language):
    """Texts of the README's blocks in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)


# ---- Python


def statements(body):
    """Statements at the top, and those of ``if __name__ == "__main__"``."""
    for node in body:
        yield from statements(node.body) if isinstance(node, ast.If) else [node]


def said(block):
    """``(statement, its comments)`` of a block; comments on lines of their own belong to the statement before."""
    nodes = list(statements(ast.parse(block).body))
    comments = [t for t in tokenize.generate_tokens(io.StringIO(block).readline) if t.type == tokenize.COMMENT]
    after = [*(node.lineno for node in nodes[1:]), len(block.splitlines()) + 1]
    return [
        (node, [t.string for t in comments if node.lineno <= t.start[0] < end])
        for node, end in zip(nodes, after, strict=True)
    ]


def outcome(node, names):
    """What an expression is worth, or what another statement prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        if isinstance(node, ast.Expr):
            value = eval(compile(ast.Expression(node.value), "README.md", "eval"), names)
        else:
            exec(compile(ast.Module([node], []), "README.md", "exec"), names)
            value = None
    if value is None:
        return out.getvalue().strip()
    return str(value) if isinstance(value, np.ndarray) else re.sub(r"np\.\w+\(([^()]*)\)", r"\1", repr(value))


def agrees(text, got):
    """Whether a result is what the text says: numbers to its digits, "..." for anything."""
    places = re.findall(NUMBER, text)
    pattern = re.escape(re.sub(NUMBER, "\0", text)).replace("\0", f"({NUMBER})").replace(r"\.\.\.", ".*?")
    match = re.fullmatch(re.sub(r"(\\[ \n])+", r"\\s+", pattern), got, re.DOTALL)
    return match is not None and all(
        abs(float(place) - float(number)) <= 0.51 * last_digit(place)
        for place, number in zip(places, match.groups(), strict=True)
    )


def last_digit(number):
    """What one in the last digit of a number as written is worth."""
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


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
def test_results_are_held_against_what_is_said(text, got, so):
    assert agrees(text, got) is so


@pytest.mark.parametrize("block", range(len(blocks("python"))))
def test_python_block(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    for node, comments in said(blocks("python")[block]):
        got = outcome(node, names)
        results = [text.partition("-> ")[2] for text in comments if "->" in text]
        if results:
            assert agrees("\n".join(results), got), f"line {node.lineno}: {' '.join(results)} is {got}"


@pytest.mark.parametrize("block", range(len(blocks("python"))))
def test_numbers_in_comments_are_results(block):
    """A number in a comment that stands before an arrow, or without one, is checked by nothing."""
    for node, comments in said(blocks("python")[block]):
        for text in comments:
            loose = re.findall(NUMBER, re.sub(r"H = \d+", "", text.partition("->")[0]))
            assert not loose, f"line {node.lineno}: {loose} in {text!r}"


def test_there_are_blocks_and_results():
    python = blocks("python")
    assert len(python) >= 6 and len(blocks("sh")) >= 4
    assert sum(block.count("-> ") for block in python) >= 20


# ---- commands


def commands(block):
    """Arguments of each ``hbgear`` of a block, without comments."""
    lines = [shlex.split(line, comments=True) for line in block.splitlines()]
    return [words[1:] for words in lines if words and words[0] == "hbgear"]


def run(words, capsys):
    """``(exit code, what was printed, complaints)`` of a command."""
    with pytest.raises(SystemExit) as stop:
        cli.main(words)
    out, err = capsys.readouterr()
    return stop.value.code, out, err


def shorter(words, folder):
    """The same command, made short; files of the repository are copied to the same place in the folder."""
    for word in words:
        file = Path(word)
        if file.suffix == ".toml":
            text = (REPOSITORY / file if (REPOSITORY / file).exists() else folder / file).read_text(encoding="utf-8")
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_text(re.sub(r"(?m)^count = \d+", f"count = {CASES}", text), encoding="utf-8")
    return [*words, *SHORTER.get(words[0], [])]


def block_with(words):
    """The block of commands that holds a text."""
    (block,) = [block for block in blocks("sh") if words in block]
    return commands(block)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return tmp_path


def test_commands(folder, capsys):
    """In their order, as later ones read what earlier ones wrote."""
    out = {}
    for words in block_with("hbgear models"):
        code, text, err = run(shorter(words, folder), capsys)
        assert (code, err) == (0, ""), f"hbgear {' '.join(words)}: {err}"
        out[words[0], words[1] if len(words) > 1 else ""] = text
        for option, name in itertools.pairwise(words):
            if option in ("-o", "--plot"):
                assert os.path.exists(name), f"hbgear {' '.join(words)} did not write {name}"
    check_what_the_comments_say(out)
    assert not plt.get_fignums(), "a command that wrote its figure left it open"


def check_what_the_comments_say(out):
    low = hb.load("low.npz")
    assert [p.kind for p in low.special].count("LP") == 2 and len(low.jumps()) == 2  # "two folds, and jumps"
    assert "F from 0.05" in out["trace", "duffing"] or "F = 0.3 reached" in out["trace", "duffing"]  # "along the load"
    assert all(name in out["models", ""] for name in ("DoubleHelicalPair", "x'' + 2 zeta x'", "zeta=0.05"))
    for jump in low.jumps():  # "from where to where"
        amplitudes = (f"{end.amplitude('pp2'):.5g}" for end in (jump.before, jump.after))
        assert all(text in out["jumps", "low.npz"] for text in (f"{jump.value:.5g}", *amplitudes))
    assert "reached" in out["info", "low.npz"] and "worst error" in out["info", "low.npz"]
    assert Path("low_LP1.png").exists() and Path("low_sweep.png").exists()
    assert "PD1" in [p.label for p in hb.load("pair.npz").special]
    assert "merged" in out["switch", "pair.npz"] or "period" in out["switch", "pair.npz"]
    assert "4 of 4 points agree" in out["validate", "low.npz"]
    assert max(int(number) for number in re.findall(r"branch (\d)", out["survey", "duffing"])) > 2
    assert len(list(Path("tolerances").glob("*.png"))) >= 2 and Path("tolerances/table.csv").exists()


def test_the_other_commands_study_the_file_that_is_shown(folder, capsys):
    (file,) = [block for block in blocks("toml") if "model =" in block]
    Path("designs.toml").write_text(file, encoding="utf-8")
    study = read_study(Path("designs.toml"))
    assert study.vary.size == 200 and study.model == hb.DoubleHelicalPair(zeta=0.055)
    (here, there) = block_with("hbgear study designs.toml")
    assert run(shorter(here, folder), capsys)[0] == 0
    assert all(Path("designs", name).exists() for name in ("table.csv", "table.npz", "envelope.png"))
    assert there[-1] == ADDRESS
    with cluster(folder) as (address, *_):
        code, out, err = run([*there[:-1], address, "-o", "by_dask"], capsys)
    assert (code, err) == (0, "") and Path("by_dask/table.csv").exists(), out


def test_commands_from_a_drawing(folder, capsys):
    """And the file that is shown, which the first of them would have written with less in it."""
    Path("docs").mkdir()
    for words in block_with("hbgear gear"):
        code, _, err = run(words, capsys)
        assert (code, err) == (0, ""), f"hbgear {' '.join(words)}: {err}"
    assert all(Path(name).exists() for name in ("gearbox.toml", "docs/gear.png", "gearbox.npz", "gearbox.png"))
    (file,) = [block for block in blocks("toml") if "[pinion]" in block]
    Path("other.toml").write_text(file, encoding="utf-8")
    model = read_machine("other.toml").model()
    assert isinstance(model, hb.GearRotorBearing) and model.b_1 * model.scales.length == pytest.approx(5e-6)


def test_commands_with_a_machine_of_your_own(folder, capsys, monkeypatch):
    """Those that name mine.py, which is the block of Python that says so."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    (mine,) = [block for block in blocks("python") if "@hb.model" in block]
    (folder / "mine.py").write_text(mine[: mine.index("two(zeta=0.06)")], encoding="utf-8")
    for words in block_with("mine.py:two"):
        code, out, err = run(shorter(words, folder), capsys)
        assert (code, err) == (0, ""), f"hbgear {' '.join(words)}: {err}"
    assert "4 of 4 points agree" in out


def test_every_block_of_commands_is_run():
    """The two that install are run by .ci/run: the tests as they are, the figure by its command."""
    ran = [block for block in blocks("sh") if any(text in block for text in RUN)]
    others = [block for block in blocks("sh") if block not in ran]
    assert len(ran) == len(RUN) and len(others) == 2 and all(block.startswith("python3 -m venv ") for block in others)


def test_the_first_command_draws_the_figure(folder, capsys):
    (line,) = [block for block in blocks("sh") if "pip install . " in block]
    words = shlex.split(line.rpartition("hbgear ")[2])
    Path("docs").mkdir()
    code, out, err = run(words, capsys)
    assert (code, err) == (0, "") and "no jumps" in out  # "as published (zeta = 0.063) has none"
    assert Path("double_helical.npz").exists() and Path("docs/double_helical.png").stat().st_size > 20_000


def test_ci_runs_the_test_command():
    script = (REPOSITORY / ".ci/run").read_text(encoding="utf-8")
    pattern = re.search(r"grep -m 1 '(.*?)' README.md", script)
    assert pattern and re.search(pattern[1], README, re.MULTILINE)
    assert os.access(REPOSITORY / ".ci/run", os.X_OK)


def test_exit_codes(folder, capsys):
    codes = re.search(r"Exit codes: (.*?)\.\s\s", README, re.DOTALL)
    assert codes and re.findall(r"\d", codes[1]) == ["0", "1", "2", "3"]
    assert run(shlex.split("trace duffing --harmonics 5 --max-points 20 -o a.npz"), capsys)[0] == 3
    curve = hb.load("a.npz")
    assert len(curve) == 20  # "what was computed by then is saved"
    replace(curve, X=1.01 * curve.X).save("wrong.npz")
    assert run(["validate", "wrong.npz", "--points", "1"], capsys)[0] == 1
    assert run(["trace", "duffign"], capsys)[0] == 2


# ---- numbers in the text


def table_after(text, heading):
    """Rows of cells of the first table after a text."""
    lines = text[text.index(heading) :].splitlines()
    rows = [line.strip().strip("|").split("|") for line in lines if line.strip().startswith("|")]
    return [[cell.strip() for cell in row] for row in rows]


def cell(study, table, row, column):
    """Text in a table of the studies of speed: the first row that begins with these cells."""
    text = (REPOSITORY / "studies/speed/figures" / f"{study}.md").read_text(encoding="utf-8")
    rows = table_after(text, table)
    (found, *_) = [cells for cells in rows if cells[: len(row)] == row]
    return found[rows[0].index(column)]


def stated(pattern):
    """The numbers of a sentence, however its lines are broken."""
    match = re.search(pattern, " ".join(README.split()))
    assert match, f"the README has no sentence like {pattern}"
    return [float(number) for number in match.groups()]


ACCURACY = table_after(README, "| H | LP1 | LP2 |")[2:7]


@pytest.mark.parametrize("row", ACCURACY, ids=[row[0] for row in ACCURACY])
def test_table_of_folds(row):
    H, *samples = (int(number) for number in re.findall(r"\d+", row[0].replace("(a cross-check)", "")))
    settings = {"samples": samples[0], "sampled": True} if samples else {}
    problem = hb.HarmonicBalance(hb.DoubleHelicalPair(zeta=0.05), H, **settings)
    curve = hb.trace(problem, "Omega", (0.89, 0.84), stability=False)
    for label, text in zip(("LP1", "LP2"), row[1:], strict=True):
        assert curve[label].parameters["Omega"] == pytest.approx(float(text), abs=0.6e-7)


def test_defaults_and_tolerances():
    (default,) = (row[0] for row in ACCURACY if "default" in row[0])
    assert int(default.split()[0]) == hb.HarmonicBalance(hb.Duffing()).H
    assert stated(r"size of the forces \(at most ([\d.e-]+) by default\)") == [hb.Settings().tolerance]
    assert stated(r"outside the unit circle by more than ([\d.e-]+[\d])") == [NEUTRAL]


def test_times_are_those_of_the_studies():
    def seconds(problem, tool):
        return round(float(cell("peers", "| problem | tool |", [problem, tool], "curve [s]")), 2)

    text = r"Duffing curve of (\d+) points.*? to ([\de-]+), takes ([\d.]+) s, that of a spur pair ([\d.]+) s"
    points, folds, duffing, spur = stated(text)
    assert folds == float(cell("peers", "| problem |", ["Duffing", "hbgear, stability"], "error of folds"))
    assert points == int(cell("peers", "| problem |", ["Duffing", "hbgear, stability"], "points"))
    assert duffing == seconds("Duffing", "hbgear, stability") and spur == seconds("spur pair", "hbgear, stability")
    (own,) = stated(r"of the double-helical pair ([\d.]+) s")
    assert own == round(float(cell("points", "| case |", ["DoubleHelicalPair, H = 16"], "curve [s]")), 1)
    others = stated(r"without stability: ([\d.]+) s and more, ([\d.]+) s and more")
    for least, problem in zip(others, ("Duffing", "spur pair"), strict=True):
        tools = ("pyHarm", "harmonicbalance", "mousai")
        assert least == min(seconds(problem, tool) for tool in tools)
    threads = float(cell("points", "| case |", ["DoubleHelicalPair, H = 16"], "two threads / one"))
    assert "no faster with two threads than with one" in " ".join(README.split()) and threads > 0.9


def test_cost_of_sweeps_and_of_size_is_that_of_the_studies():
    count, ratio, slow = stated(r"sweep of (\d+) frequencies.*? costs (\d+) times .*? about (\d+) times")
    row = "| sweeps, 131 frequencies up and down, settled to |"
    assert count == 131 and "settled to 1e-5" in " ".join(README.split())
    assert ratio == float(cell("sweep_ratio", row, ["1e-05"], "over continuation (H = 16)"))
    assert slow == round(float(cell("sweep_ratio", row, ["1e-05"], "over continuation")), -2)
    chain, ten = stated(r"a chain of (\d+) masses costs per point what one of (\d+) does")
    ratio = float(cell("scale", "| n of the chain |", [f"{chain:.0f}"], "points alone over n = 10"))
    assert ten == 10 and ratio == pytest.approx(1.0, abs=0.2)  # of times below a tenth of a millisecond
    (large,) = stated(r"structures of (\d+ \d+) coordinates".replace(r"(\d+ \d+)", r"(100) 000"))
    assert large == 100 and cell("scale", "| n of the housing |", ["99896"], "[ms/point]")


def test_numbers_of_the_double_helical_pair():
    pair, text = hb.DoubleHelicalPair(), " ".join(README.split())
    (omega,) = stated(r"omega_n = sqrt\(k_mean/m_c\), (\d+) rad/s")
    assert omega == pytest.approx(2 * np.pi * pair.mesh_frequency(1.0), abs=0.5)
    (dofs,) = stated(r"double-helical gear pair with (\d+) degrees of freedom")
    assert dofs == pair.system().n == stated(r"scales the (\d+) coordinates back")[0]
    assert f"as published (zeta = {pair.zeta:g}) has none, with zeta = 0.05 it has two" in text
    assert all(f"`{name}`" in text for name in ("pp2", "rms", "max", "mean", *REGIMES[:3]))
