"""Every study can be imported and is complete; the study of sampling runs in its quick form with known results."""

import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import matplotlib
import matplotlib.pyplot
import pytest

ROOT = Path(__file__).parents[2]
matplotlib.use("Agg")
pytestmark = pytest.mark.usefixtures("on_path")


def names():
    found = pkgutil.walk_packages([str(ROOT / "studies")], "studies.")
    return [module.name for module in found if not module.ispkg and module.name.count(".") == 2]


@pytest.mark.parametrize("name", names())
def test_a_study_has_its_parts(name):
    module = importlib.import_module(name)
    if not hasattr(module, "run"):
        return  # a helper module of other studies
    assert f"python -m {name} " in module.__doc__
    assert hasattr(module, "plot") or hasattr(module, "report")


def test_gallery_is_up_to_date():
    from studies.__main__ import names as all_names
    from studies.gallery import gallery

    assert (ROOT / "studies" / "README.md").read_text(encoding="utf-8") == gallery(all_names())


def test_a_study_is_made_with_its_figure_and_report(tmp_path, monkeypatch):
    from studies import study

    module = importlib.import_module("studies.contact.sampling")
    few = module.Results(*(module.np.array([1.0, 2.0]) for _ in range(6)), module.np.array([[2.0, 2.0], [1.0, 0.5]]))
    monkeypatch.setattr(module, "run", lambda quick: few)
    study.make("studies.contact.sampling", tmp_path, quick=True, kinds=("png", "pdf"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sampling.md", "sampling.pdf", "sampling.png"]
    assert "| jump-up | -1.00 |" in (tmp_path / "sampling.md").read_text()


def test_curves_of_the_pair_are_drawn_in_the_unit_of_their_axes():
    """Figures 4 to 9 have axes of d / b_c; the library draws a model with scales in um unless asked otherwise."""
    from studies.dong_2022 import base, family

    curve = base.curve(2, (1.6, 1.4))
    figure, ax = matplotlib.pyplot.subplots()
    family.draw_family(ax, [(family.Member("base", "base", "black"), curve)], (), "")
    highest = max(line.get_ydata().max() for line in ax.lines if len(line.get_ydata()) > 2)
    matplotlib.pyplot.close(figure)
    assert "d/b_c" in ax.get_ylabel() and highest == pytest.approx(curve.amplitude("pp2").max(), rel=1e-12)


def test_runner_refuses_unknown_studies(monkeypatch, capsys):
    from studies.__main__ import main

    monkeypatch.setattr("sys.argv", ["studies", "dong_2023"])
    assert main() == 2 and "no study 'studies.dong_2023'" in capsys.readouterr().err
    monkeypatch.setattr("sys.argv", ["studies", "--quick"])
    assert main() == 2 and "give a folder" in capsys.readouterr().err


def test_runner_skips_unchanged_studies(tmp_path):
    from studies.__main__ import fingerprint, is_made

    name, file = "studies.contact.sampling", tmp_path / "a.png"
    made = {name: {"fingerprint": fingerprint(name), "files": [str(file)]}}
    assert not is_made(name, {}) and not is_made(name, made)
    file.touch()
    assert is_made(name, made)
    made[name]["fingerprint"] = "of other sources"
    assert not is_made(name, made)


@pytest.mark.slow
def test_sampling(tmp_path):
    """The error of a jump frequency with 128 samples, and the orders of convergence of force and Jacobian."""
    study = importlib.import_module("studies.contact.sampling")
    results = study.run(quick=True)
    assert results.slopes["force"] == pytest.approx(-2.0, abs=0.2)
    assert results.slopes["jacobian"] == pytest.approx(-1.0, abs=0.15)
    assert 5e-5 < results.fold[0] < 1e-3
    assert results.folds[-1].max() < 2e-9
    figure = study.plot(results)
    left, right = figure.axes
    assert left.get_xlabel() and right.get_xlabel() and left.get_xscale() == right.get_yscale() == "log"
    figure.savefig(tmp_path / "sampling.png")
    matplotlib.pyplot.close(figure)
    assert (tmp_path / "sampling.png").stat().st_size > 10_000


@pytest.mark.slow
def test_studies_are_made_by_the_command(tmp_path):
    """`python -m studies` makes the figure and the report of a study in a separate process."""
    command = [sys.executable, "-m", "studies", "dong_2022.fig15", "--quick", "-o", str(tmp_path), "--jobs", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {path.name for path in tmp_path.iterdir()} >= {"fig15.png", "fig15.md"} and not list(tmp_path.glob("*.pdf"))
