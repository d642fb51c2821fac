"""Every study can be imported and has its parts; those of contact run in their quick form and give their numbers."""

import importlib
import pkgutil
from pathlib import Path

import matplotlib
import matplotlib.pyplot
import pytest

ROOT = Path(__file__).parents[2]
matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def on_path(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))


def names():
    return [module.name for module in pkgutil.walk_packages([str(ROOT / "studies")], "studies.") if not module.ispkg]


@pytest.mark.parametrize("name", names())
def test_a_study_runs_from_python_and_from_the_command_line(name):
    study = importlib.import_module(name)
    assert study.__doc__ and f"python -m {name} -o DIR" in study.__doc__
    assert callable(study.run) and callable(study.main)


def test_sampling(tmp_path):
    """What 128 samples lose of a jump frequency, and the order in which samples converge."""
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


def test_sampling_from_the_command_line(tmp_path, monkeypatch, capsys):
    study = importlib.import_module("studies.contact.sampling")
    few = study.Results(*(study.np.array([1.0, 2.0]) for _ in range(6)), study.np.array([[2.0, 2.0], [1.0, 0.5]]))
    monkeypatch.setattr(study, "run", lambda quick: few)
    monkeypatch.setattr("sys.argv", ["sampling", "-o", str(tmp_path), "--quick"])
    study.main()
    assert "jump-up: slope -1.00" in capsys.readouterr().out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sampling.pdf", "sampling.png"]
