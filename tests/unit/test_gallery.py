"""One example of the gallery for each kind of user: from a file to a figure in fewer than 30 lines."""

import ast
import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "scripts" / "gallery"
EXPECTED = {
    "user_1_noise_engineer": "jump at 118",
    "user_2_own_equations": "jump at Omega = 0.9217",
    "user_3_rotor_engineer": "critical speeds [0.739, 0.948, 1.086]",
    "user_4_test_engineer": "zeta = 0.060",
    "user_5_designer": "",
}
"""Beginning of a printed line of each."""


def test_every_kind_of_user_has_an_example():
    assert {path.stem for path in FOLDER.glob("user_*.py")} == EXPECTED.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_an_example_is_short_and_draws_a_figure(name, monkeypatch, capsys):
    path = FOLDER / f"{name}.py"
    text = path.read_text(encoding="utf-8")
    code = [line for line in text.partition('"""\n\n')[2].splitlines() if line.strip() and not line.startswith("#")]
    assert len(code) < 30
    monkeypatch.chdir(FOLDER)
    before = plt.get_backend()
    plt.switch_backend("Agg")
    try:
        runpy.run_path(str(path))
        assert plt.get_fignums() and all(plt.figure(i).axes[0].has_data() for i in plt.get_fignums())
    finally:
        plt.close("all")
        plt.switch_backend(before)
    assert any(line.startswith(EXPECTED[name]) for line in ["", *capsys.readouterr().out.splitlines()])


@pytest.mark.parametrize("path", sorted(FOLDER.glob("user_*.py")), ids=lambda path: path.stem)
def test_an_example_names_files_that_exist(path):
    words = [
        node.value for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Constant)
    ]
    files = [word for word in words if isinstance(word, str) and word.startswith("data/")]
    assert all((FOLDER / file).exists() for file in files)


def test_the_matrices_are_those_of_the_guide():
    guide = (FOLDER.parents[1] / "howto" / "rotor.md").read_text(encoding="utf-8")
    for name in ("M.mtx", "C.mtx", "K.mtx", "G.mtx", "rotor.toml"):
        assert (FOLDER / "data" / name).read_text(encoding="utf-8") in guide
