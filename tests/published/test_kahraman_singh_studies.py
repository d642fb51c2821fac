"""Studies of Kahraman & Singh (1990, 1991) in quick form, and the numerical results behind their figures."""

import importlib
from pathlib import Path

import matplotlib
import numpy as np
import pytest

import hbgear as hb
from hbgear.harmonic.equations.layout import REGIMES
from hbgear.time.integration import state_of
from hbgear.time.steady_state import SteadyStateSettings

matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def on_path(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))


def study(name):
    return importlib.import_module(f"studies.{name}")


def frequencies(curve, kind):
    return np.array([p.parameters["Omega"] for p in curve.special if p.kind == kind])


def test_ratios():
    """Contact loss matches the closed form; folds match a reference; doubled branches end at period doublings."""
    module = study("kahraman_singh_1990.ratios")
    light, strong = module.run(quick=True)
    assert len(light.closed) == 2 and len(strong.closed) == 1
    for found in (light, strong):
        np.testing.assert_allclose(found.traced, found.closed, rtol=0, atol=1e-5)
    np.testing.assert_allclose(frequencies(light.curve, "LP"), (0.7080316, 0.8284640), atol=1e-6)
    assert not light.longer and len(strong.longer) == 2
    ends = np.sort([b.values[-1] for b in strong.longer])
    np.testing.assert_allclose(ends, np.sort(frequencies(strong.curve, "PD"))[[0, 2]], atol=1e-3)
    assert len(module.plot((light, strong)).axes) == 2
    assert "0.820631, 1.407088 | 0.820631, 1.407088" in module.report((light, strong))


def test_motions_of_three_periods():
    """A branch traced from one motion: integrated multipliers are -1 at its period doubling and +1 at its fold."""
    longer = study("kahraman_singh_1990.longer")
    pair = hb.SpurPair(e=(0.2,))
    start = longer.orbit(pair, 2.1, 0.7765, -0.2683, 3)
    branch = longer.root(pair, start, (2.3, 2.0))
    assert longer.order(branch) == 3 and branch.values.min() == 2.0
    for label, Omega, mu, closure in (("PD1", 2.094172, -1, 1e-9), ("LP1", 2.151813, 1, 1e-3)):
        found = branch[label].parameters["Omega"]
        assert found == pytest.approx(Omega, abs=2e-6)
        state = state_of(branch.problem, branch[label].X, Omega=found)
        integrated = hb.time.shoot(pair, found, state, 3, tolerance=closure)  # singular at the fold: loose tolerance
        assert np.abs(integrated.multipliers - mu).min() < 5e-3
    swept = hb.time.sweep(pair, [2.1], start=start.state)
    assert swept.period[0] == 3 and longer.lies_on([branch], swept, 0)
    assert swept.rms[0, 0] == pytest.approx(0.31463, abs=2e-5)


def test_the_branch_of_a_doubled_motion_is_that_of_its_ancestor():
    """The motion has period 2 below the period doubling at 1.856903; the root branch has period 1."""
    longer = study("kahraman_singh_1990.longer")
    pair = hb.SpurPair(e=(0.2,))
    swept = hb.time.sweep(pair, [1.87, 1.85], "down", settling=SteadyStateSettings(1e-5))
    assert list(swept.period) == [1, 2]
    found = longer.orbit(pair, 1.85, *swept.points[1][0, 0], 2)
    branch = longer.root(pair, found, (1.95, 1.84))
    assert longer.order(branch) == 1 and frequencies(branch, "PD") == pytest.approx([1.856903], abs=1e-6)
    assert longer.lies_on([branch], swept, 0) and not longer.lies_on([branch], swept, 1)
    both = longer.family(branch, (1.95, 1.84), 2)
    assert [longer.order(b) for b in both] == [1, 2] and longer.lies_on(both, swept, 1)
    assert longer.isolated(pair, both, [swept], (1.95, 1.84), 2) == []


@pytest.mark.parametrize(("ratio", "regime"), [(0.5, "single_sided"), (2.0, "double_sided")])
def test_only_the_ratio_matters_until_the_backs_of_the_teeth_meet(ratio, regime):
    """Folds at F_m = 0.1 and 0.3 agree to 1e-9; with contact on the back the lower one differs by more than 1e-3."""
    curves = [
        hb.trace(hb.HarmonicBalance(hb.SpurPair(F_m=F, e=(ratio * F,)), 12), "Omega", (1.2, 0.3), stability=False)
        for F in (0.1, 0.3)
    ]
    assert max(curves[1].regimes, key=REGIMES.index) == regime
    light, heavy = (frequencies(curve, "LP") for curve in curves)
    lower, upper = (np.abs(heavy - fold).min() for fold in np.sort(light))
    assert upper < 1e-9  # near contact loss, where impacts are weak
    assert lower < 1e-9 if regime == "single_sided" else lower > 1e-3


def test_basins():
    """Basins and harmonic balance give equal rms of both attractors; the unstable motion is on the basin boundary."""
    module = study("kahraman_singh_1990.basins")
    results = module.run(quick=True)
    rms = sorted(a.rms for a in results.found.attractors)
    np.testing.assert_allclose(rms, (0.05141, 0.34055), atol=1e-5)
    np.testing.assert_allclose(results.rms[results.stable], rms, rtol=1e-5)
    assert list(results.stable) == [True, False, True]
    # two starts on either side of the unstable motion converge to different attractors
    d, v = results.points[1]
    nearby = hb.time.basins(module.PAIR, module.OMEGA, (d - 2e-3, d + 2e-3), (v, v + 1e-9), (2, 1))
    assert len(nearby.attractors) == 2
    assert "unstable | 0.224" in module.report(results)
    assert module.plot(results).axes[0].get_legend()


def test_bifurcation():
    """Sweep points of period 1 and 2 lie on traced branches to 2e-3; between the doublings the sweep is chaotic."""
    module = study("kahraman_singh_1990.bifurcation")
    results = module.run(quick=True)
    (sweep,) = results.sweeps
    seen = set(sweep.period)
    assert {0, 1, 2} <= seen
    for period in (1, 2):
        branch = results.branches[period]
        for i in np.flatnonzero(sweep.period == period):
            lines = at(branch, module.strobed(branch), sweep.values[i])
            for x in sweep.points[i][:, 0, 0]:
                assert np.abs(lines - x).min() < 2e-3
    np.testing.assert_allclose(frequencies(results.branches[2], "PD"), (1.846195, 1.40038), atol=2e-5)
    wild = sweep.values[~sweep.settled]
    assert wild.min() > 1.538632 and wild.max() < 1.819998  # period doublings of the motion of period 4
    assert (sweep.lyapunov[~sweep.settled] > 0.01).all()
    assert module.plot(results).axes[0].get_legend()


def at(branch, heights, value):
    """Return the heights of all lines of a branch at a parameter value, by linear interpolation."""
    x = branch.values - value
    i = np.flatnonzero(x[:-1] * x[1:] <= 0)
    s = (x[i] / (x[i] - x[i + 1]))[:, None]
    return ((1 - s) * heights[i] + s * heights[i + 1]).ravel()


@pytest.mark.slow
def test_rotor_bearing():
    """Points agree with integration; folds match H = 64; contact is lost where the linear gap amplitude reaches F_m."""
    module = study("kahraman_singh_1991.rotor_bearing")
    results = module.run(quick=True)
    assert results.report.ok and len(results.report.rows) == 2
    assert set(results.curve.regimes) == {"no_impact", "single_sided"}
    np.testing.assert_allclose(frequencies(results.curve, "LP"), (1.1573133, 1.2745382), atol=2e-7)  # H = 64
    parted = frequencies(results.curve, "GR")[0]
    model = module.MODEL.replace(b=0.0, b_1=0.0, b_2=0.0)
    linear = hb.HarmonicBalance(model, 2)
    X = linear.start(parted, **model.parameters)
    assert np.hypot(*X[1:3]) == pytest.approx(model.F_m, abs=1e-9)
    assert len(module.plot(results).axes) == 2 and "agrees" in module.report(results)
