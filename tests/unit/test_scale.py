"""The study of large structures in its quick form."""

import importlib
from pathlib import Path

import matplotlib
import matplotlib.pyplot
import pytest

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def results():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2]))
        study = importlib.import_module("studies.speed.scale")
        yield study, study.run(quick=True)


@pytest.mark.slow
def test_reduced_peaks_are_those_of_all_coordinates(results):
    _, rows = results
    for row in rows["chain"]:
        assert row["reduced"]["peak"] == pytest.approx(row["full"]["peak"], rel=1e-5)
    housing = rows["housing"][0]
    assert housing["reduced"]["peak"] == pytest.approx(housing["peak"], rel=max(1e-5, housing["error"]))


def test_a_finer_mesh_is_the_same_housing(results):
    """Refined from 8 x 8 to 12 x 12 nodes its lowest frequency stays: the mesh refines a membrane, it adds no mass."""
    study, _ = results
    low = [study.hb.mechanics.reduce(study.housing(side), 5).frequencies[0] for side in (8, 16, 24)]
    assert low[2] == pytest.approx(low[1], rel=0.05)
    assert abs(low[2] - low[1]) < abs(low[1] - low[0])


def test_report_and_figure(results):
    study, rows = results
    assert study.report(rows).count("\n| ") == 2 * 2 + 3
    figure = study.plot(rows)
    assert all(ax.get_xscale() == "log" and ax.get_xlabel() for ax in figure.axes)
    matplotlib.pyplot.close(figure)
