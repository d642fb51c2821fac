"""Files of structures from matrices and from measured receptances, in Python and on the command line."""

import numpy as np
import pytest
import scipy
from typer.testing import CliRunner

import hbgear as hb
from hbgear.cli.app import app
from hbgear.harmonic.models.model_registry import rebuild_model
from hbgear.io.machines.model_file import kind_of_file
from hbgear.io.machines.structure_file import read_structure
from hbgear.io.machines.toml_file import TomlFileError
from hbgear.mechanics.models import describe

M, K = np.diag([2.0, 5.0]), np.array([[200.0, -100.0], [-100.0, 400.0]])
C = 5e-3 * K
ELEMENTS = """
[[element]]
name = "stop"
direction = { shaft = 1.0, case = -1.0 }
law = "unilateral"
k = 200.0
gap = 0.1
damping = 0.5
eps = [0.1]

[[element]]
name = "gap"
direction = { case = 1.0 }
law = "backlash"
k = 50.0
b = 0.2
error = [0.01, 0.002]

[[load]]
constant = { shaft = 1.0 }
cosine = { 1 = { shaft = 4.0 }, 2 = { case = 0.5 } }
"""
SEPARATE = '[matrices]\nM = "mass.mtx"\nK = "stiffness.npy"\nC = "damping.mtx"\nnames = ["shaft", "case"]\n' + ELEMENTS
TOGETHER = (
    '[matrices]\nfile = "all.mat"\nK = "Stiffness"\nG = "spin"\nratio = 0.05\nnames = ["shaft", "case"]\n' + ELEMENTS
)
MEASURED = (
    """[receptances]
tables = [
    { response = "shaft", force = "shaft", file = "ss.csv" },
    { response = "shaft", force = "case", file = "sc.csv" },
    { response = "case", force = "case", file = "cc.csv" },
]
"""
    + ELEMENTS
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scipy.io.mmwrite("mass.mtx", M)
    scipy.io.mmwrite("damping.mtx", scipy.sparse.coo_array(C))
    np.save("stiffness.npy", K)
    scipy.io.savemat("all.mat", {"M": M, "C": C, "Stiffness": K, "spin": np.array([[0.0, 1.0], [-1.0, 0.0]])})
    f = np.linspace(0.0, 30.0, 3001)
    w = 2 * np.pi * f[:, None, None]
    H = np.linalg.inv(K + 1j * w * C - w**2 * M)
    for name, (i, j) in {"ss": (0, 0), "sc": (0, 1), "cc": (1, 1)}.items():
        np.savetxt(f"{name}.csv", np.column_stack([f, H[:, i, j].real, H[:, i, j].imag]), delimiter=",")
    for name, text in (("separate", SEPARATE), ("together", TOGETHER), ("measured", MEASURED)):
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


def by_hand(spin=0.0, structure=None):
    names = ["shaft", "case"]
    stop = hb.Element(
        [1.0, -1.0], hb.Unilateral(200.0, 0.1, hb.mechanics.Series(1.0, (-0.1,))), damping=0.5, name="stop"
    )
    gap = hb.Element([0.0, 1.0], hb.Backlash(0.2, 50.0), hb.mechanics.Series(0.0, (0.01, 0.002)), name="gap")
    load = hb.Load([1.0, 0.0], {1: [4.0, 0.0], 2: [0.0, 0.5]})
    terms = hb.mechanics.SpeedTerms([[0.0, spin], [-spin, 0.0]], 0.05) if spin else None
    return hb.System(M, C, K, [stop, gap], load, names, terms)


def test_files_are_the_machines(folder):
    written, made = (describe(one)["fields"] for one in (read_structure("together.toml"), by_hand(1.0)))
    assert {name: written[name] for name in made} == made
    a, b = (hb.HarmonicBalance(model, 8) for model in (read_structure("separate.toml"), by_hand()))
    X = np.sin(np.arange(a.size))
    np.testing.assert_allclose(a.evaluate(X, Omega=9.0)[0], b.evaluate(X, Omega=9.0)[0], rtol=1e-12, atol=1e-12)
    c = hb.HarmonicBalance(read_structure("measured.toml"), 8)
    np.testing.assert_allclose(c.evaluate(X, Omega=9.0)[0], b.evaluate(X, Omega=9.0)[0], atol=1e-4 * np.abs(K).max())
    assert (kind_of_file("measured.toml"), kind_of_file("nowhere.toml")) == ("structure", "machine")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["separate", "together", "measured"])
def test_on_the_command_line(name, folder):
    run = CliRunner().invoke
    result = run(app, ["trace", f"{name}.toml", "--from", "8", "--to", "11", "--harmonics", "8", "-o", "a.npz"])
    assert result.exit_code == 0, result.output
    curve = hb.load("a.npz")
    assert curve.layout.elements == ("stop", "gap") and (curve.multipliers is None) == (name == "measured")
    assert ("stability is not available" in " ".join(result.output.split())) == (name == "measured")
    longer = run(app, ["extend", "a.npz", "--to", "11.2", "-o", "b.npz"])
    assert longer.exit_code == 0, longer.output
    checked = run(app, ["validate", "a.npz", "--points", "1"])
    message = str(checked.exception)
    assert "known by receptances only" in message if name == "measured" else checked.exit_code == 0, message


def test_a_structure_needs_a_span_and_the_error_lists_its_natural_frequencies(folder):
    """Its unit of time is unknown: Omega = 0.5 to 1.5 of other models has no meaning."""
    (folder / "a.toml").write_text(SEPARATE)
    natural = np.sqrt(scipy.linalg.eigvalsh(K, M))
    for options in ([], ["--from", "8"], ["--to", "8"]):
        message = str(CliRunner().invoke(app, ["trace", "a.toml", *options]).exception)
        found = [float(text) for text in message.partition("frequencies are ")[2].split(", ")]
        assert "--from and --to are needed" in message
        np.testing.assert_allclose(found, natural, rtol=1e-3)


def test_models_lists_the_parameters_of_a_file(folder):
    (folder / "a.toml").write_text(SEPARATE)
    result = CliRunner().invoke(app, ["models", "a.toml"])
    assert result.exit_code == 0 and {"stop.k", "200", "gap.k", "50"} <= set(result.output.split()), result.output


@pytest.mark.parametrize(
    ("text", "old", "new", "said"),
    [
        (SEPARATE, '"mass.mtx"', '"mess.mtx"', "line 1: there is no file '.*mess.mtx'"),
        (SEPARATE, "gap = 0.1", "", "line 7: law = 'unilateral' needs gap"),
        (SEPARATE, "gap = 0.1", "gap = 0.1\nb = 2.0", "law = 'unilateral' has no b; it has k, gap, eps"),
        (SEPARATE, "case = -1.0", "cage = -1.0", "no coordinate 'cage'; did you mean 'case'"),
        (SEPARATE, "{ shaft = 1.0, case = -1.0 }", "[1.0]", "one for each coordinate: shaft, case"),
        (SEPARATE, "{ shaft = 1.0, case = -1.0 }", "'shaft'", "need numbers by coordinate"),
        (SEPARATE, "{ shaft = 1.0, case = -1.0 }", "[inf, 0.0]", "finite"),
        (SEPARATE, 'law = "unilateral"', 'law = "stop"', "there is no law 'stop'"),
        (SEPARATE, "2 = { case = 0.5 }", "two = { case = 0.5 }", "'two' is not a harmonic"),
        (SEPARATE, "k = 200.0", "k = -200.0", "k"),
        (SEPARATE, '["shaft", "case"]', '["shaft"]', "1 dof_names for 2 coordinates"),
        (SEPARATE, "[[load]]", "[[lode]]", "unknown key 'lode'"),
        (SEPARATE, "[[load]]", "[load]", r"'load' is a list of tables: write \[\[load\]\]"),
        (TOGETHER, '"all.mat"', '"damping.mtx"', r"given by name, such as M = 'mass.mtx', K = 'stiffness.mtx'"),
        (SEPARATE, "[matrices]", "[receptances]\nstatic = [[1.0]]\n[matrices]", "give either"),
        (SEPARATE, 'M = "mass.mtx"', "", "M is missing"),
        (TOGETHER, 'K = "Stiffness"', "", "has no matrix 'K', but"),
        (TOGETHER, '"all.mat"', '"damping.mtx"', "must be a .mat or .npz file"),
        (MEASURED, '"sc.csv"', '"all.mat"', "cannot be read as a table: it is not text"),
        (MEASURED, "[receptances]\n", '[receptances]\nfile = "a.uff"\n', "give either file or tables"),
        (MEASURED, "[receptances]\n", "[receptances]\nquantity = 'speed'\n", "quantity"),
    ],
)
def test_bad_files(text, old, new, said, folder):
    assert old in text
    (folder / "bad.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(TomlFileError, match=said):
        read_structure("bad.toml")


def test_vectors_have_a_number_for_each_coordinate_or_names(folder):
    (folder / "lists.toml").write_text(SEPARATE.replace("{ shaft = 1.0, case = -1.0 }", "[1.0, -1.0]"))
    (folder / "names.toml").write_text(SEPARATE)
    lists, names = read_structure("lists.toml"), read_structure("names.toml")
    np.testing.assert_array_equal(lists.W, names.W)


@pytest.mark.filterwarnings("ignore:nothing excites")
def test_parameters_by_the_keys_of_the_file(tmp_path):
    """Changing a parameter equals reading a file with its new value; keys of several elements have their names."""
    np.save(tmp_path / "m.npy", np.eye(2))
    np.save(tmp_path / "k.npy", np.array([[2.0, -1.0], [-1.0, 2.0]]))
    one = '[[element]]\nname = "{}"\ndirection = {{ q1 = 1.0 }}\nlaw = "unilateral"\nk = 10.0\ngap = {}\n{}'
    start = '[matrices]\nM = "m.npy"\nK = "k.npy"\n'

    def read(*elements):
        (tmp_path / "s.toml").write_text(start + "".join(one.format(*each) for each in elements))
        return read_structure(tmp_path / "s.toml")

    single, wider = read(("stop", 0.1, "damping = 0.2\n")), read(("stop", 0.3, "damping = 0.2\n"))
    assert single.parameters == {"k": 10.0, "gap": 0.1, "damping": 0.2}
    changed = single.replace(gap=0.3)
    assert changed.elements[0].law == wider.elements[0].law and changed.parameters == wider.parameters
    assert single.replace(damping=0.5).elements[0].damping == 0.5
    again = rebuild_model(describe(changed))
    assert again.parameters == wider.parameters and again.elements[0].law == wider.elements[0].law
    X = np.linspace(-1, 1, 5)
    residuals = [hb.HarmonicBalance(model, 2, samples=16).residual(X, Omega=0.9) for model in (changed, wider)]
    np.testing.assert_array_equal(*residuals)
    both = read(("low", 0.1, ""), ("high", 0.2, ""))
    assert both.parameters == {"low.k": 10.0, "low.gap": 0.1, "high.k": 10.0, "high.gap": 0.2}
    assert both.replace(**{"high.gap": 0.4}).elements[1].law.breakpoints == (0.4,)
    with pytest.raises(KeyError, match="no parameter 'gap'"):
        both.replace(gap=0.2)


def test_matrices_in_the_file_with_a_damping_ratio(tmp_path):
    file = tmp_path / "small.toml"
    head = f"[matrices]\nM = {M.tolist()}\nK = {K.tolist()}\ndamping_ratio = [0.02, 0.05]\n"
    file.write_text(head + 'names = ["shaft", "case"]\n' + ELEMENTS)
    system = read_structure(file)
    np.testing.assert_array_equal(system.K, K)
    np.testing.assert_allclose(system.C, hb.mechanics.modal_damping(M, K, [0.02, 0.05]), rtol=1e-14)
    np.savez(tmp_path / "all.npz", K=K)
    file.write_text(head.replace("[matrices]", '[matrices]\nfile = "all.npz"') + ELEMENTS)
    with pytest.raises(TomlFileError, match="M is a matrix and file names a file with all matrices"):
        read_structure(file)


def test_matrices_without_their_table_are_a_structure(tmp_path):
    file = tmp_path / "flat.toml"
    file.write_text(f"M = {M.tolist()}\nK = {K.tolist()}\n" + ELEMENTS)
    assert kind_of_file(file) == "structure"
    with pytest.raises(TomlFileError, match=r"unknown key 'M'; it has: matrices, receptances, element, load"):
        read_structure(file)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("unilaterall", "there is no law 'unilaterall'; did you mean 'unilateral'"),
        ("rubber", "there is no law 'rubber'; give one of cubic, .*backlash"),
        ("parallel", "law = 'parallel' cannot be given in TOML"),
    ],
)
def test_unknown_laws_are_named(tmp_path, law, words):
    file = tmp_path / "law.toml"
    text = ELEMENTS.replace('"unilateral"', f'"{law}"')
    file.write_text(f"[matrices]\nM = {M.tolist()}\nK = {K.tolist()}\n" + 'names = ["shaft", "case"]\n' + text)
    with pytest.raises(TomlFileError, match=words):
        read_structure(file)
