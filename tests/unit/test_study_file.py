"""The study file: every error at once, with its line."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.io

import hbgear as hb
from hbgear.cli.app import main
from hbgear.cli.commands.pages import explored
from hbgear.design.studies.study_file import read_study
from hbgear.io.machines.model_file import read_model
from hbgear.io.machines.toml_file import TomlFileError, line_of, lines_of

GOOD = """model = "double-helical"
[base]
zeta = 0.05
eps = [0.16, 0.07]
[grid]
torque = [1000, 1400]
mesh_helix = ["pitch", "base"]
[compute]
what = ["jumps"]
"""

BAD = """model = "duffing"
# a comment
[base]
zetta = 0.05
k3 = "one"
[sample]
count = 0
[sample.parameters]
zeta = ["unifrom", 0.01, 0.05]
F = ["uniform",
     0.3, 0.1]
[compute]
what = ["peaks"]
harmonicz = 3
"""


def test_a_pipe_or_a_device_is_no_study(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for path in (tmp_path / "pipe.toml", "/dev/zero"):
        with pytest.raises(TomlFileError, match="it is a pipe, a device or a socket; need a regular file"):
            read_study(path)


def test_a_good_file(tmp_path):
    (tmp_path / "a.toml").write_text(GOOD)
    study = read_study(tmp_path / "a.toml")
    assert study.model == hb.gears.DoubleHelicalPair(zeta=0.05, eps=(0.16, 0.07))
    assert study.vary.size == 4 and study.work.span == (1.6, 0.2) and study.work.compute == ("jumps",)


PAIR = """
torque = "200 N m"
damping = 0.04
[pinion]
teeth = 25
module = "3 mm"
face_width = "20 mm"
tip_relief = "12 um"
[wheel]
teeth = 40
module = "3 mm"
face_width = "20 mm"
tip_relief = "12 um"
[pair]
backlash = "80 um"
"""


def test_parameters_of_a_drawing_vary_with_their_units(tmp_path):
    """The cases are those of the drawing with other values; the path is relative to the study."""
    (tmp_path / "pair.toml").write_text(PAIR)
    (tmp_path / "a.toml").write_text(
        'model = "pair.toml"\n[base]\ndamping = 0.03\n[grid]\ntorque = ["0.15 kN m", 200]\nbacklash = ["0.09 mm"]\n'
        "[compute]\nharmonics = 8\nspan = [1.2, 0.8]\n"
    )
    study = read_study(tmp_path / "a.toml")
    assert study.model.parameters["damping"] == 0.03 and dict(study.vary.values) == {
        "torque": (150.0, 200.0),
        "backlash": (90.0,),
    }
    work = study.work
    (tmp_path / "other.toml").write_text(
        PAIR.replace("200 N m", "150 N m").replace("80 um", "90 um").replace("0.04", "0.03")
    )
    other = read_model(tmp_path / "other.toml")
    ratio = study.model.scales.frequency / other.scales.frequency  # each drawing has units of its own
    vary, span = hb.design.grid(damping=[0.03]), (1.2 * ratio, 0.8 * ratio)
    with ThreadPoolExecutor(1) as here:
        found = hb.design.cases(
            study.model, study.vary, work.compute, harmonics=work.harmonics, span=work.span, executor=here
        )
        (alone,) = hb.design.cases(other, vary, ("peak",), harmonics=8, span=span, executor=here).table["peak"]
    peak = found.table["peak"] * study.model.scales.length
    assert not found.failed and peak[0] == pytest.approx(alone * other.scales.length, rel=1e-9) != peak[1]


def test_parameters_of_a_structure_file_vary(tmp_path):
    """The cases are those of the structure with other gaps."""
    for name, matrix in (("M", np.eye(2)), ("C", 0.1 * np.eye(2)), ("K", np.array([[2.0, -1.0], [-1.0, 2.0]]))):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix)
    (tmp_path / "two.toml").write_text(
        '[matrices]\nM = "M.mtx"\nC = "C.mtx"\nK = "K.mtx"\nnames = ["a", "b"]\n[[element]]\nname = "stop"\n'
        'direction = { a = 1.0 }\nlaw = "unilateral"\nk = 5.0\ngap = 0.3\n[[load]]\ncosine = { 1 = { b = 0.3 } }\n'
    )
    (tmp_path / "a.toml").write_text('model = "two.toml"\n[grid]\ngap = [0.2, 0.4]\n[compute]\nspan = [0.8, 1.6]\n')
    study = read_study(tmp_path / "a.toml")
    with ThreadPoolExecutor(1) as here:
        found = hb.design.cases(study.model, study.vary, ("peak",), harmonics=6, span=(0.8, 1.6), executor=here)
    assert not found.failed
    for gap, peak in zip((0.2, 0.4), found.table["peak"], strict=True):
        stop = hb.Element([1.0, 0.0], hb.Unilateral(k=5.0, gap=gap))
        two = hb.System(np.eye(2), 0.1 * np.eye(2), [[2, -1], [-1, 2]], [stop], hb.Load(cosine={1: [0, 0.3]}))
        curve = hb.trace(hb.HarmonicBalance(two, 6), "Omega", (0.8, 1.6))
        assert peak == pytest.approx(
            max(p.amplitude("pp2") for p in hb.analysis.peaks(curve, "pp2", accuracy=None)), rel=1e-9
        )


def test_spans_are_speeds_of_the_drawing(tmp_path):
    """A number is Omega, 30 / pi rad/s are 1 r/min; other units and models without scales are refused."""
    (tmp_path / "pair.toml").write_text(PAIR)
    text = 'model = "{}"\n[grid]\ndamping = [0.04]\n[compute]\nspan = {}'
    scales = read_model(tmp_path / "pair.toml").scales
    for span, expected in (
        ('["8000 r/min", "1.2e3 rad/s"]', [scales.from_pinion_speed(n) for n in (8000.0, 1.2e3 * 30 / np.pi)]),
        ('["3 kHz", 0.7]', [scales.from_mesh_frequency(3000.0), 0.7]),
    ):
        (tmp_path / "a.toml").write_text(text.format("pair.toml", span))
        assert read_study(tmp_path / "a.toml").work.span == pytest.approx(expected, rel=1e-12)
    for model, span, words in (
        ("pair.toml", '["8000 um", 1.0]', "need a speed with its unit"),
        ("pair.toml", '["8000 r/min", "8000 r/min"]', "need two different positive"),
        ("pair.toml", '["-8000 r/min", 1.0]', "need two different positive"),
        ("duffing", '["8000 r/min", 1.0]', "this model has no scales"),
    ):
        (tmp_path / "a.toml").write_text(
            text.format(model, span).replace("damping", "zeta" if model == "duffing" else "damping")
        )
        with pytest.raises(TomlFileError) as error:
            read_study(tmp_path / "a.toml")
        assert words in str(error.value), str(error.value)


def test_tuples_have_no_distribution(tmp_path):
    (tmp_path / "a.toml").write_text(
        'model = "spur-pair"\n[sample]\ncount = 2\n[sample.parameters]\neps = ["uniform", 0.01, 0.02]'
    )
    with pytest.raises(TomlFileError, match="line 5: unknown key"):
        read_study(tmp_path / "a.toml")


def test_bad_values_of_a_drawing(tmp_path):
    (tmp_path / "pair.toml").write_text(PAIR)
    for text, words in (
        ('[grid]\ntorque = ["3 mm"]', "line 3: grid.torque.0"),
        ("[grid]\nrelief = [3]", "did you mean 'tip_relief'"),
        ('[sample]\ncount = 2\n[sample.parameters]\nbacklash = ["uniform", "1 N", "2 N"]', "line 5: "),
    ):
        (tmp_path / "a.toml").write_text('model = "pair.toml"\n' + text)
        with pytest.raises(TomlFileError) as error:
            read_study(tmp_path / "a.toml")
        assert words in str(error.value)
    (tmp_path / "a.toml").write_text('model = "none.toml"\n[grid]\ntorque = [3]')
    with pytest.raises(TomlFileError, match=r"line 1: .*none\.toml"):
        read_study(tmp_path / "a.toml")


def test_every_error_with_its_line(tmp_path):
    (tmp_path / "a.toml").write_text(BAD)
    with pytest.raises(TomlFileError) as error:
        read_study(tmp_path / "a.toml")
    lines = [int(text.partition("line ")[2].partition(":")[0]) for text in error.value.problems]
    assert lines == [4, 5, 7, 9, 10, 13, 14]
    assert "did you mean 'zeta'" in error.value.problems[0] and "did you mean 'uniform'" in error.value.problems[3]
    assert "did you mean 'harmonics'" in error.value.problems[-1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("model = ", "cannot be read as a study: Invalid value (at the end, line 1)"),
        ('model = "duffing"\nzeta == 1', "cannot be read as a study: Invalid value (at line 2, column 7)"),
        ("", "cannot be read as a study: it is empty, or has only comments"),
        ("[grid]", "line 1: 'model' is missing"),
        ('model = "dufing"\n[grid]\nzeta = [0.1]', "line 1: there is no model 'dufing'; did you mean 'duffing'"),
        ('model = "duffing"', "need [grid] or [sample]"),
        ('model = "duffing"\n[grid]\nzeta = []', "line 3: grid.zeta"),
        ('model = "duffing"\n[grid]', "line 2: [grid] names no parameter"),
        ('model = "duffing"\n[grid]\nzeta = [1, 1]', "line 2: grid: zeta has a value twice"),
        ('model = "duffing"\n[sample]\ncount = 3\n[sample.parameters]', "line 2: [sample.parameters] names no"),
        ('model = "duffing"\n[grid]\nzeta = [1]\n[compute]\nwhat = []', "line 4: nothing to compute"),
        ('model = "duffing"\n[grid]\nzeta = [1]\n[compute]\nelement = "mesh"', "line 4: no element 'mesh'"),
        ('model = "duffing"\n[grid]\nzeta = [1]\n[compute]\nmeasure = "pp3"', "line 4: "),
        ('model = "duffing"\n[grid]\nzeta = [1]\n[compute]\ncritical = ["zetta"]', "line 4: "),
        (f'model = "duffing"\n[base]\nzeta = {"9" * 5000}', "a number has too many digits (at line 3)"),
        (f'model = "duffing"\n[base]\nzeta = {"[" * 500}{"]" * 500}', "nested too deeply (at line 3)"),
        ('model = "duffing"\n[base]\nzeta = -1.0\n[grid]\nF = [0.1]', "line 2: Duffing: zeta = -1.0"),
    ],
)
def test_bad_files(tmp_path, text, words):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(TomlFileError) as error:
        read_study(tmp_path / "a.toml")
    assert words in str(error.value)


def test_files_that_are_no_text(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\x86\x00\xff")
    (tmp_path / "folder.toml").mkdir()
    for name, words in (
        ("a.toml", "it is no text.*; save it as UTF-8"),
        ("folder.toml", "Is a directory"),
        ("none.toml", "No such file or directory"),
    ):
        with pytest.raises(TomlFileError, match=words):
            read_study(tmp_path / name)


def test_lines_of_values_of_several_lines():
    text = 'a = """\nb = 1\n"""\n\n[t]\nb = [1,\n 2]\nc = 3\n'
    assert [line_of(lines_of(text), place) for place in (("a",), ("t",), ("t", "b", 1), ("t", "c"), ("t", "no"))] == [
        1,
        5,
        6,
        8,
        5,
    ]


@pytest.mark.parametrize("span", ["[nan, 1]", "[inf, 1]", "[0.5, -1]", "[0, 1]", "[1, 1]"])
def test_a_span_that_cannot_be_meant(tmp_path, span):
    (tmp_path / "a.toml").write_text(GOOD + f"span = {span}\n")
    with pytest.raises(TomlFileError, match=r"line (8|10): .*span"):
        read_study(tmp_path / "a.toml")


def test_every_statement_is_parsed_once(monkeypatch):
    """A text of 1800 lines: the work grows with the text, not with its square."""
    import tomllib

    parsed, loads = [], tomllib.loads
    monkeypatch.setattr("hbgear.io.machines.toml_file.tomllib.loads", lambda text: parsed.append(text) or loads(text))
    text = "".join(f"[t{i}]\nvalue = {i}\nmany = [\n  {i},\n  2,\n]\n" for i in range(300))
    lines = lines_of(text)
    assert [line_of(lines, (f"t{i}", "many", 1)) for i in range(300)] == [6 * i + 3 for i in range(300)]
    assert sum(map(len, parsed)) < 3 * len(text)


def test_lines_of_arrays_of_tables():
    lines = lines_of("[[a]]\nx = 1\n[[a]]\nx = 2\n[b]\ny = [\n'1',\n]\n")
    places = [("a", 0), ("a", 0, "x"), ("a", 1), ("a", 1, "x"), ("b", "y", 0)]
    assert [line_of(lines, place) for place in places] == [1, 2, 3, 4, 6]


OWN = 'model = "mine.py:stop"\n[grid]\ngap = [0.5, 0.6]\n[compute]\nharmonics = 4\n'


@pytest.fixture
def own_model(tmp_path, monkeypatch, modules_are_forgotten):
    """A study of a model whose code leaves a trace when it runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "import pathlib, hbgear as hb\npathlib.Path('ran').touch()\n\n@hb.mechanics.model(default_span=(0.5, 1.5))\n"
        "def stop(zeta: float = 0.05, gap: float = 1.0) -> hb.System:\n"
        "    law = hb.Unilateral(k=5.0, gap=gap)\n"
        "    return hb.System([[1.0]], [[2 * zeta]], [[1.0]], [hb.Element([1.0], law)], hb.Load(cosine={1: [0.2]}))\n"
    )
    (tmp_path / "a.toml").write_text(OWN)
    return tmp_path


def test_naming_a_file_runs_no_code(own_model, capsys):
    with pytest.raises(TomlFileError, match=r"line 1: model = 'mine.py:stop' would run that code.*--allow-code"):
        read_study("a.toml")
    for words in (["study", "a.toml"], ["explore", "a.toml", "--no-browser"]):
        with pytest.raises(SystemExit, match="2"):
            main(words)
        assert "a.toml, line 1: model = 'mine.py:stop' would run that code" in capsys.readouterr().err
    assert not (own_model / "ran").exists()


@pytest.mark.slow
def test_code_of_a_file_runs_if_that_is_allowed(own_model, capsys):
    assert read_study("a.toml", allow_code=True).model.zeta == 0.05
    assert (own_model / "ran").exists()
    with pytest.raises(SystemExit, match="0"):
        main(["study", "a.toml", "--allow-code", "--processes", "1"])
    assert "2 of 2 cases" in capsys.readouterr().out
    assert explored("a.toml", None, None, allow_code=True)[0].model({}).gap == 0.5
