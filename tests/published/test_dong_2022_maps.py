"""Studies of Dong et al. (2022): spectra, backlash and speed, jump maps, period doubling, double-sided impact.

What a study reads from harmonic balance is held against time integration, closed forms or scaling laws.
"""

import importlib
from pathlib import Path

import matplotlib
import numpy as np
import pytest

import hbgear as hb

ROOT = Path(__file__).parents[2]
matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def on_path(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))


def study(name):
    return importlib.import_module(f"studies.dong_2022.{name}")


def drawn(module, results, tmp_path):
    """The figure of a study is made and closed again; its axes."""
    from studies.study import draw

    kept = []

    def plot(r):
        kept.append(module.plot(r))
        return kept[0]

    draw(plot, results, tmp_path / "figure")
    return kept[0].axes


def test_spectra_at_one_third(tmp_path):
    """The doubled motion: half orders lead, and are of opposite phase in the two helices."""
    module = study("fig14")
    results = module.run(quick=True)
    assert not results["symmetric"].stable and results["doubled"].stable
    left, right = (results["doubled"].coefficients(j) for j in (0, 1))
    order = (np.arange(len(left) - 1) // 2) + 1
    np.testing.assert_allclose(right[1:], np.where(order % 2, -left[1:], left[1:]), atol=1e-9)
    # slow sweep with time integration at the same Omega: period 2, half peak-to-peak 0.57174
    assert results["doubled"].amplitude("pp2") == pytest.approx(0.57171, abs=1e-4)
    assert drawn(module, results, tmp_path)
    assert "| doubled | 0.5 | 0.462" in module.report(results)


@pytest.mark.parametrize(("name", "Omega"), [("fig15", 0.5), ("fig16", 1.0)])
def test_spectra_against_time_integration(name, Omega, tmp_path):
    module = study(name)
    results = module.run(quick=True)
    settled = hb.sweep(hb.DoubleHelicalPair(), [Omega])
    for measure in ("H1", "H2", "H3"):
        assert results["motion"].amplitude(measure) == pytest.approx(settled.amplitude(measure)[0], abs=1e-6)
    assert drawn(module, results, tmp_path)
    assert "10.23" in module.report(results)


def test_mesh_frequency_of_the_rig():
    rig = study("spectra").RIG
    assert [round(test.mesh, 1) for test in rig] == [166.7, 250.0, 500.0]
    assert rig[0].orders[2] == pytest.approx(3.0402, abs=1e-4)
    assert rig[2].orders[0] == pytest.approx(0.96)
