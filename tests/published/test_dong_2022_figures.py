"""Figures 3 to 9 of Dong et al. (2022): quick forms, against time integration and symmetry."""

import matplotlib
import numpy as np
import pytest

import hbgear as hb
from hbgear.time.integration import integrate, state_of

matplotlib.use("Agg")
pytestmark = pytest.mark.usefixtures("on_path")


def drawn(study_module, results, folder):
    """Whether the figure of a study can be written."""
    from studies import study

    return study.draw(study_module.plot, results, folder / "a")[0].stat().st_size > 10_000


def integrated(point, model=None):
    """The gap over the motion's own period, integrated from its state."""
    problem = hb.HarmonicBalance(model or hb.gears.DoubleHelicalPair(), point.layout.harmonics, nu=point.layout.nu)
    Omega = point.parameters["Omega"]
    state = state_of(problem, point.X, Omega=Omega)
    return integrate(problem.model, state, point.layout.nu, Omega, method="exponential", samples=1024).d[..., 0, :]


@pytest.mark.slow
def test_fig03_motions_close_and_are_those_of_time_integration(tmp_path):
    from studies.dong_2022 import fig03

    results = fig03.run(quick=True)
    for points in results.values():
        for point in points:
            d = integrated(point)
            assert np.ptp(d) / 2 == pytest.approx(point.amplitude("pp2"), rel=2e-3)
            assert d.min() == pytest.approx(point.samples()[1].min(), abs=2e-3)
    assert results["1"][0].samples()[1].min() == pytest.approx(1.0845, abs=2e-4)  # no impact
    one, two = results["1/3"]
    assert not one.stable and two.stable and two.regime_name == "single_sided"
    assert "two periods, stable, single-sided | " in fig03.report(results)
    assert drawn(fig03, results, tmp_path)


@pytest.mark.slow
def test_fig04_doubled_motion_coexists_below_the_doubling(tmp_path):
    """The sweep down still finds it at 0.325, where the motion of one period is stable again."""
    from studies.dong_2022 import base, fig04

    results = fig04.run(quick=True)
    low, high = fig04.hysteresis(results)
    assert low == pytest.approx(0.3170, abs=2e-4) and high == pytest.approx(0.33055, abs=2e-5)
    (down,) = results["sweeps"]
    assert list(down.period) == [2, 2]
    two = base.at(results["doubled"], 0.325)
    assert down.pp2[-1, 0] == pytest.approx(two.amplitude("pp2"), rel=1e-3)
    assert base.at(results["curve"], 0.325).stable and two.stable
    assert not results["curve"].jumps()
    assert "| both stable | 0.317" in fig04.report(results)
    assert drawn(fig04, results, tmp_path)


def test_fig05_backlash_shifts_the_motion_and_nothing_else(tmp_path):
    from studies.dong_2022 import fig05

    results = fig05.run(quick=True)
    (_, narrow), (_, wide) = results
    assert narrow.fixed["W"] == -0.6 and wide.fixed["W"] == 0.6
    np.testing.assert_allclose(wide.peak("pp2").amplitude("pp2"), narrow.peak("pp2").amplitude("pp2"), atol=1e-4)
    difference = wide.amplitude("max").max() - narrow.amplitude("max").max()
    assert difference == pytest.approx(1.2, abs=1e-4)
    for label in ("GR1", "GR2"):
        assert wide[label].parameters["Omega"] == pytest.approx(narrow[label].parameters["Omega"], abs=1e-7)
    assert drawn(fig05, results, tmp_path)


@pytest.mark.parametrize(("name", "peaks"), [("fig06", (0.5894, 0.1868)), ("fig07", (0.5894, 0.3731))])
def test_fig06_fig07_are_the_same_at_both_backlashes(name, peaks, tmp_path):
    import importlib

    study = importlib.import_module(f"studies.dong_2022.{name}")
    results = study.run(quick=True)
    for (_, narrow), (_, wide), peak in zip(results["narrow"], results["wide"], peaks, strict=True):
        assert narrow.peak("pp2").amplitude("pp2") == pytest.approx(peak, abs=2e-3)
        assert wide.peak("pp2").amplitude("pp2") == pytest.approx(narrow.peak("pp2").amplitude("pp2"), abs=1e-4)
        assert wide.fixed["W"] == 0.6
    assert set(results["narrow"][1][1].regimes) == {"no_impact"}
    assert drawn(study, results, tmp_path)


def test_fig08_largest_error_jumps_and_none_does_not(tmp_path):
    """Above the fold LP1 two motions are stable, each closed by time integration."""
    from studies.dong_2022 import fig08

    results = fig08.run(quick=True)
    (_, large), (_, without) = results["whole"]
    up, down = sorted(large.jumps(), key=lambda jump: -jump.direction)
    assert up.value == pytest.approx(0.8436, abs=3e-4) and down.value == pytest.approx(0.8099, abs=1e-3)
    assert (up.direction, down.direction) == (1, -1) and not without.jumps()
    assert up.after is not None and down.after is not None
    model = hb.gears.DoubleHelicalPair(e=fig08.MEMBERS[0].changes["e"])
    for point in (up.after, down.after):
        assert np.ptp(integrated(point, model)) / 2 == pytest.approx(point.amplitude("pp2"), rel=5e-3)
    assert "up 0.843" in fig08.report(results)
    assert drawn(fig08, results, tmp_path)


def test_fig09_light_loads_jump_and_heavy_ones_do_not(tmp_path):
    from studies.dong_2022 import fig09

    results = fig09.run(quick=True)
    (_, light), (_, heavy) = results["whole"]
    assert [round(jump.value, 3) for jump in light.jumps()] in ([0.864, 0.852], [0.852, 0.864])
    assert not heavy.jumps() and "single_sided" in heavy.regimes
    assert heavy.peak("pp2").amplitude("pp2") == pytest.approx(1.0384, abs=2e-3)
    point = heavy.peak("pp2")
    assert np.ptp(integrated(point, hb.gears.DoubleHelicalPair(torque=2800.0))) / 2 == pytest.approx(1.0384, abs=3e-3)
    assert drawn(fig09, results, tmp_path)


def test_ranges_end_at_the_special_points():
    from studies.dong_2022 import base, family

    curve = base.curve(8, (1.1, 0.75))
    ((low, high),) = family.parted(curve)
    assert (low, high) == (curve["GR2"].parameters["Omega"], curve["GR1"].parameters["Omega"])
    assert family.unstable(curve) == []


def test_a_motion_at_an_end_of_its_curve():
    from studies.dong_2022 import base

    curve = base.curve(8, (1.1, 0.75))
    assert base.at(curve, 1.1).parameters["Omega"] == 1.1
