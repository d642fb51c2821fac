"""The studies of designs in their quick forms: tolerances, held against curves traced one by one, and fits."""

from pathlib import Path

import matplotlib
import numpy as np
import pytest

import hbgear as hb

pytestmark = pytest.mark.slow

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def tolerances():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2]))
        import studies.design.tolerances as module

        yield module


def test_tolerances(tolerances, tmp_path):
    results = tolerances.run(quick=True)
    found = results.found
    print(found.table)
    assert len(found) == 6 and not found.failed
    jumps = np.isfinite(found.table["jump_rising"])
    assert 0 < jumps.sum() < 6  # some jump, some do not
    for case in (int(np.argmax(jumps)), int(np.argmin(jumps))):
        model = tolerances.BASE.replace(**{name: float(found.table[name][case]) for name in found.names})
        curve = hb.trace(hb.HarmonicBalance(model, 4), "Omega", (0.95, 0.8), accuracy=None)
        peak = max(point.amplitude("pp2") for point in hb.analysis.peaks(curve, "pp2", accuracy=None))
        assert found.table["peak"][case] == pytest.approx(peak, rel=1e-8)
        rising = [jump.value for jump in curve.jumps() if jump.direction == 1]
        assert rising == pytest.approx([found.table["jump_rising"][case]] if jumps[case] else [], rel=1e-8)
    figure = tolerances.plot(results)
    figure.savefig(tmp_path / "a.png")
    assert "6 cases, 0 failed" in tolerances.report(results)


def test_coverage(tmp_path, monkeypatch):
    """Two draws: every estimate is within four of the standard errors that are claimed."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    import studies.design.coverage as coverage

    results = coverage.run(quick=True)
    assert np.abs(results.off["spur pair"]).max() < 4 and results.off["spur pair"].shape == (2, 4)
    assert results.residual["spur pair"].max() < 2
    coverage.plot(results).savefig(tmp_path / "a.png")
    assert "spur pair: 2 draws" in coverage.report(results)


def test_least_change(tmp_path, monkeypatch):
    """The design found is on the surface of the map, and no point of the map is nearer."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    import studies.design.least_change as least_change

    results = least_change.run(quick=True)
    found, at = results.found, results.found.values
    assert found.reached and found.distance < results.distance.min()
    there = least_change.BASE.replace(eps_scale=at["eps_scale"], e_scale=at["e_scale"])
    cusp = hb.analysis.critical_parameter(hb.HarmonicBalance(there, 3), "zeta", frequencies=least_change.SPAN).value
    assert at["zeta"] == pytest.approx(cusp, rel=2e-3) and at["zeta"] > cusp
    least_change.plot(results).savefig(tmp_path / "a.png")
    assert "has 0 jumps; the goal is reached" in least_change.report(results)
