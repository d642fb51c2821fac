"""Studies of Dong et al. (2022): spectra, backlash and speed, jump maps, period doubling, double-sided impact.

Harmonic-balance results of each study are compared with time integration, closed forms or scaling laws.
"""

import importlib
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from scipy.linalg import expm

import hbgear as hb
from hbgear.mechanics.series.fourier import extrema
from hbgear.time.integration import state_of
from hbgear.time.steady_state import SteadyStateSettings

ROOT = Path(__file__).parents[2]
matplotlib.use("Agg")
pytestmark = pytest.mark.usefixtures("on_path")


def study(name):
    return importlib.import_module(f"studies.dong_2022.{name}")


def drawn(module, results):
    """Draw and close the figure of a study; return its axes."""
    from studies.study import journal

    with journal():
        import matplotlib.pyplot as plt

        figure = module.plot(results)
        figure.canvas.draw()
        plt.close(figure)
    return figure.axes


@pytest.mark.slow
def test_spectra_at_one_third():
    """In the period-doubled motion half orders have opposite phase in the two helices."""
    module = study("fig14")
    results = module.run(quick=True)
    assert not results["symmetric"].stable and results["doubled"].stable
    left, right = (results["doubled"].coefficients(j) for j in (0, 1))
    order = (np.arange(len(left) - 1) // 2) + 1
    np.testing.assert_allclose(right[1:], np.where(order % 2, -left[1:], left[1:]), atol=1e-9)
    # slow sweep with time integration at the same Omega: period 2, half peak-to-peak 0.57174
    assert results["doubled"].amplitude("pp2") == pytest.approx(0.57174, abs=3e-4)
    assert drawn(module, results)
    assert "| doubled | 0.5 | 0.46" in module.report(results)


@pytest.mark.parametrize(("name", "Omega"), [("fig15", 0.5), ("fig16", 1.0)])
def test_spectra_against_time_integration(name, Omega):
    module = study(name)
    results = module.run(quick=True)
    settled = hb.time.sweep(hb.gears.DoubleHelicalPair(), [Omega])
    for measure in ("H1", "H2", "H3"):
        assert results["motion"].amplitude(measure) == pytest.approx(settled.amplitude(measure)[0], abs=1e-6)
    assert drawn(module, results)
    assert "10.23" in module.report(results)


def test_mesh_frequency_of_the_rig():
    rig = study("spectra").RIG
    assert [round(test.mesh, 1) for test in rig] == [166.7, 250.0, 500.0]
    assert rig[0].orders[2] == pytest.approx(3.0402, abs=1e-4)
    assert rig[2].orders[0] == pytest.approx(0.96)


@pytest.mark.slow
def test_backlash_changes_nothing_but_the_mean():
    module = study("fig17")
    results = module.run(quick=True)
    first, last = results["paper", "gap"]
    np.testing.assert_allclose(last.orders, first.orders, atol=1e-8)
    assert last.mean - first.mean == pytest.approx(0.25, abs=1e-8)  # half of 51.27 - 50.77 um
    # b_c = b keeps the gap and multiplies the error by B / 50 um: the same machine in other units
    B = 51.27e-6
    same = hb.gears.DoubleHelicalPair(W=B / 50e-6 - 1, e_scale=B / 50e-6)
    settled = hb.time.sweep(same, [1.0], settling=SteadyStateSettings(1e-6))
    grown = results["paper", "unit"][1].orders[0]
    for k in (1, 2, 3):
        assert grown[k - 1] == pytest.approx(25 * settled.amplitude(f"H{k}")[0], abs=1e-5)
    assert drawn(module, results)
    assert "0.3168" in module.report(results)


@pytest.mark.slow
def test_speeds_and_backlash():
    """Far below resonance the motion is quasi-static, d - b = (torque term) / k(tau), independent of the error."""
    module = study("fig18")
    results = module.run(quick=True)
    slow = results["gaps"]["model", "unit"][0]
    k = 1 - sum(
        eps * np.cos(order * np.linspace(0, 2 * np.pi, 999)) for order, eps in ((1, 0.16), (2, 0.07), (3, 0.03))
    )
    closure = 2 * 5.446 / k  # um at 1400 N m
    assert slow.pp2[0] == pytest.approx((closure.max() - closure.min()) / 2, rel=0.02)
    assert np.all(np.diff(slow.pp2) > 0)
    assert drawn(module, results)
    assert "| paper | kept in um | 600 | 50.77 | 6.276" in module.report(results)


def folds(**changes):
    """Return the number of folds of the response between Omega = 1 and 0.8."""
    problem = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(**changes), 8)
    curve = hb.trace(problem, "Omega", (1.0, 0.8), stability=False)
    return sum(point.kind == "LP" for point in curve.special)


@pytest.mark.slow
def test_jump_maps():
    """Folds exist 1.5 % below the critical load and vanish 1 % above it; scaling the error is equivalent."""
    module = study("maps")
    results = module.run(quick=True)
    load = results["boundaries"]["torque"]
    assert load.value == pytest.approx(1196.45, rel=5e-4) and load.jump_below
    assert (folds(torque=0.985 * load.value), folds(torque=1.01 * load.value)) == (2, 0)
    error = load.own / load.value
    assert (folds(e_scale=error / 0.985), folds(e_scale=error / 1.01)) == (2, 0)
    assert load.distance == pytest.approx(-14.54, abs=0.05)
    assert drawn(module, results)
    assert "| torque | 1400 | 119" in module.report(results)


def floquet(pair, Omega, steps=200):
    """Return the multipliers of a motion without impact: Hill's equation of the pair, piecewise constant stiffness."""
    system = pair.system()
    W, c, n = system.W, np.array([e.damping for e in system.elements]), 24
    C = system.C + (W * c) @ W.T
    flow = np.eye(2 * n)
    for tau in 2 * np.pi * (np.arange(steps) + 0.5) / steps:
        k = 1 - pair.eps_scale * np.dot(pair.eps, np.cos(np.arange(1, 4) * tau))
        below = np.linalg.solve(system.M, np.hstack([-system.K - k * W @ W.T, -C]))
        flow = expm(np.vstack([np.eye(n, 2 * n, n), below]) * 2 * np.pi / (Omega * steps)) @ flow
    return np.linalg.eigvals(flow)


@pytest.mark.slow
def test_period_doubling_is_a_parametric_resonance():
    module = study("doublings")
    results = module.run(quick=True)
    pair = hb.gears.DoubleHelicalPair()
    for label in ("PD1", "PD2"):
        mu = floquet(pair, results["curve"][label].parameters["Omega"])
        assert np.min(np.abs(mu + 1)) < 1e-5
    top = module.apex(results["boundaries"]["zeta"]).parameters
    assert top["zeta"] == pytest.approx(0.12054, abs=1e-5)
    assert module.limit(pair, "zeta") == pytest.approx(top["zeta"], rel=0.06)  # first order in eps
    assert np.min(np.abs(floquet(pair.replace(zeta=top["zeta"]), top["Omega"]) + 1)) < 1e-5
    swept = results["sweeps"][0]
    assert swept.period[0] == 2
    np.testing.assert_allclose(swept.pp2[0], results["motion"].amplitude("pp2"), atol=3e-4)
    assert drawn(module, results)
    assert "0.12054" in module.report(results)


@pytest.mark.slow
def test_double_sided_impact_begins():
    """The grazing curve agrees with the depth of motions in a wide gap and with time integration to 5e-4."""
    module = study("double_sided")
    results = module.run(quick=True)
    top = module.widest(results["grazing"]["mesh period"]).parameters
    assert top["W"] == pytest.approx(-0.93934, abs=1e-4)
    deep = results["depths"]["mesh period", 0.063][0]
    assert deep / 2 == pytest.approx(1 + top["W"], rel=3e-3)  # largest depth of the points, not interpolated
    pair = hb.gears.DoubleHelicalPair(W=top["W"])
    touching = module.widest(results["grazing"]["mesh period"])
    state = state_of(hb.HarmonicBalance(pair, touching.layout.harmonics), touching.X, Omega=top["Omega"])
    settled = hb.time.sweep(pair, [top["Omega"]], start=state, settling=SteadyStateSettings(1e-4))
    lowest = extrema(settled.rows[0, 0])[0]
    assert lowest == pytest.approx(-(1 + top["W"]), abs=5e-4)
    assert drawn(module, results)
    assert "| mesh period | -0.93" in module.report(results)


def test_basins_of_the_pair():
    """Initial states have the specified gap values; the quick map gives the expected attractors."""
    module = study("basins")
    state = module.turned(module.LOW, np.array([-0.3]), np.array([0.2]))[0]
    first = hb.time.integrate(module.LOW, state, 1, module.FOLDED, samples=64)
    np.testing.assert_allclose(first.d[:, 0], -0.3, atol=1e-12)
    np.testing.assert_allclose(first.v[:, 0], 0.2 + module.rest(), atol=1e-12)
    moved = module.shifted(module.LOW, np.array([1.0]), np.array([0.0]))[0, :24]
    opened = np.sin(np.radians(24.43)) * np.array([1, -1])
    np.testing.assert_allclose(module.LOW.system().W.T @ moved, opened, atol=1e-12)
    results = module.run(quick=True)
    assert results["folds"].left < 1e-4
    np.testing.assert_array_equal(results["folds"].large, [[0, 1, 1], [0, 1, 1]])
    assert drawn(module, results)
    assert "| zeta = 0.05, Omega = 0.867 | 6 |" in module.report(results)
