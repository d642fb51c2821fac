"""Bifurcation diagrams against a published cascade, against points of harmonic balance, and against closed forms.

x'' + 0.3 x' - x + x^3 = gamma cos(1.2 t): Jordan & Smith, Nonlinear Ordinary Differential Equations, 4th ed. (2007),
ch. 12, period 1 at gamma = 0.20, 2 at 0.28, 4 at 0.29, 5 at 0.37, chaos at 0.50, period 2 at 0.65.
"""

import machines
import matplotlib.pyplot as plt
import numpy as np
import pytest

import hbgear as hb
from hbgear.harmonic.autonomous.tori.stability import birkhoff_weights
from hbgear.mechanics import Cubic, model
from hbgear.time.attractors.verdicts import Verdict, verdict_of

OMEGA = 1.2
PD1, PD2 = 0.265582, 0.286693
"""Period doublings of the motions of period 1 and 2, by harmonic balance with 30 harmonics."""


@model
def two_wells(gamma: float = 0.2) -> hb.System:
    return machines.single_mass(Cubic(1.0), F=gamma, c=0.3, k=-1.0, name="x")


@model
def two_masses(F: float = 0.13) -> hb.System:
    return machines.two_masses(F)


def diagram(span, values, direction="up"):
    return hb.time.bifurcation_diagram(
        two_wells(), "gamma", span, direction, values=values, at={"Omega": OMEGA}, start=np.array([1.0, 0.0])
    )


@pytest.fixture(scope="module")
def cascade():
    return diagram((0.26, 0.296), 13)


@pytest.mark.slow
def test_the_period_doubles_where_harmonic_balance_has_its_points(cascade):
    (found,), windows = cascade.sweeps, cascade.windows()
    assert [window.period for window in windows[:3]] == [1, 2, 4]
    for value, before, after in ((PD1, *windows[:2]), (PD2, *windows[1:3])):
        assert before.high < value < after.low < before.high + 1.5 * 0.003
    assert cascade.verdicts[0][-1] is Verdict.CHAOTIC and found.period[-1] == 0 and cascade.lyapunov[0][-1] > 0.02
    assert np.all(cascade.lyapunov[0][found.settled] < 0)


def test_points_of_harmonic_balance_are_those_of_the_figure(cascade):
    problem = hb.HarmonicBalance(two_wells(), 15)
    curve = hb.trace(problem, "gamma", (0.26, 0.296), cascade.sweeps[0].rows[0, 0, :31], at={"Omega": OMEGA})
    assert curve["PD1"].parameters["gamma"] == pytest.approx(PD1, abs=2e-6)
    doubled = hb.switch(curve, "PD1")
    assert doubled["PD1"].parameters["gamma"] == pytest.approx(PD2, abs=2e-6)
    ax = hb.plot.bifurcation_diagram(cascade, curves=[curve, doubled])
    lines = {gid: [line for line in ax.lines if line.get_gid() == gid] for gid in ("periodic", "chaotic", "stable")}
    x, y = lines["periodic"][0].get_data()
    assert len(x) == sum(cascade.sweeps[0].period) and len(lines["chaotic"]) == 1
    for gamma, height in zip(x, y, strict=True):
        if gamma < PD2:  # both curves together pass through every stroboscopic point
            near = [
                abs(np.interp(gamma, *line.get_data()) - height)
                for line in lines["stable"]
                if line.get_xdata().min() <= gamma <= line.get_xdata().max()
            ]
            assert min(near) < 2e-3
    with pytest.raises(ValueError, match="trace the curve in gamma"):
        hb.plot.bifurcation_diagram(
            cascade, curves=[hb.trace(problem, "Omega", (1.2, 1.3), cascade.sweeps[0].rows[0, 0, :31])]
        )
    plt.close("all")


@pytest.mark.slow
@pytest.mark.parametrize(("gamma", "period"), [(0.20, 1), (0.28, 2), (0.29, 4), (0.37, 5), (0.50, 0), (0.65, 2)])
def test_published_periods(gamma, period):
    found = diagram((gamma, gamma + 1e-9), 2)
    expected = Verdict.PERIODIC if period else Verdict.CHAOTIC
    assert found.sweeps[0].period[0] == period and found.verdicts[0][0] is expected


@pytest.mark.slow
def test_between_neimark_sacker_points_the_motion_is_quasi_periodic():
    found = hb.time.bifurcation_diagram(two_masses(), "Omega", (1.10, 1.16), values=3)
    for kinds, sweep in zip(found.verdicts, found.sweeps, strict=True):
        by_value = dict(zip(np.round(sweep.values, 3), kinds, strict=True))
        assert by_value == {1.10: Verdict.PERIODIC, 1.13: Verdict.QUASI_PERIODIC, 1.16: Verdict.QUASI_PERIODIC}
    assert found.sweeps[1].direction == -1 and found.digits[0][1] > 8
    assert abs(found.lyapunov[0][1]) < 1e-3  # no neighbouring motion approaches or moves away
    periodic, torus = found.windows()
    assert (torus.low, torus.high, torus.count, torus.period) == (1.13, 1.16, 2, 0) and periodic.count == 1


def test_exponent_of_a_linear_oscillator_is_its_damping():
    found = hb.time.bifurcation_diagram(hb.Duffing(zeta=0.05, k3=0.0), "Omega", (0.8, 0.9), "up", values=2)
    np.testing.assert_allclose(found.lyapunov[0], -0.05, atol=1e-3)


def test_weights_average_a_rotation_to_rounding():
    p = 2 * np.pi * (np.sqrt(5) - 1) / 2 * np.arange(1000)
    assert birkhoff_weights(1000).sum() == pytest.approx(1.0)
    assert abs(birkhoff_weights(1000) @ np.cos(p)) < 1e-12
    assert abs(np.cos(p).mean()) > 1e-5  # a plain average has a slow error


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ((2, 0.5, 0.0, 9.0), Verdict.PERIODIC),
        ((0, 0.0, 8.0, 0.01), Verdict.QUASI_PERIODIC),
        ((0, 0.0, 8.0, 0.3), Verdict.UNDECIDED),
        ((0, 0.1, 2.0, 0.01), Verdict.CHAOTIC),
        ((0, 0.1, 8.0, 0.01), Verdict.UNDECIDED),
        ((0, 0.0, 2.0, 0.01), Verdict.UNDECIDED),
        ((0, np.nan, 8.0, 0.01), Verdict.UNDECIDED),
    ],
)
def test_verdicts_follow_the_stated_tests(numbers, expected):
    assert verdict_of(*numbers) is expected


def test_bad_input():
    with pytest.raises(ValueError, match="direction = 'left' must be 'both', 'up' or 'down'"):
        hb.time.bifurcation_diagram(hb.Duffing(), "Omega", (0.5, 0.6), "left")
    with pytest.raises(ValueError, match="is empty"):
        hb.time.bifurcation_diagram(hb.Duffing(), "Omega", (0.5, 0.5))
    with pytest.raises(ValueError, match="needs a fixed Omega"):
        hb.time.bifurcation_diagram(hb.Duffing(), "F", (0.1, 0.2))


def test_figure_of_a_machine_with_scales_is_in_its_units() -> None:
    pair = hb.SpurPair(reference=(38000.0, 37.6e-6, 15000.0, 25.0))
    found = hb.time.bifurcation_diagram(pair, "Omega", (0.9, 0.95), "up", values=2)
    curve = hb.trace(hb.HarmonicBalance(pair, 3), "Omega", (0.95, 0.9))
    speed, length = pair.scales.pinion_speed(1.0), 1e6 * pair.scales.length
    for measure in ("", "pp2"):
        physical = hb.plot.bifurcation_diagram(found, measure, curves=[curve])
        bare = hb.plot.bifurcation_diagram(found, measure, curves=[curve], dimensionless=True)
        for one, other in zip(physical.lines, bare.lines, strict=True):
            np.testing.assert_allclose(one.get_xydata(), other.get_xydata() * (speed, length), rtol=1e-9)
        assert "r/min" in physical.get_xlabel() and "\N{MICRO SIGN}m" in physical.get_ylabel()
