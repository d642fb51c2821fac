"""Run-up and run-down, their figures, and machine quantities in engineering units."""

from dataclasses import replace

import numpy as np
import pytest
from machines import gear_pair, single_mass

import hbgear as hb
from hbgear.mechanics.series.fourier import evaluate
from hbgear.mechanics.series.measures import derivative
from hbgear.time.integration import state_of


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(hb.SpurPair(eps=(0.2,)), 12), "Omega", (1.5, 0.3))


def test_a_run_equals_a_slow_sweep(curve):
    """Run-up and run-down agree within 1 % with a slow sweep by time integration, on both sides of the jumps."""
    up, down = hb.analysis.run_up(curve, "up"), hb.analysis.run_up(curve, "down")
    assert [jump.direction for jump in (*up.jumps, *down.jumps)] == [1, -1]
    assert up.message == "Omega = 1.5 reached" and down.message == "Omega = 0.3 reached"
    for found, way in ((up, 1), (down, -1)):
        assert (np.diff(found.values) * way >= 0).all()
        (jump,), (before, after) = found.jumps, found.sections
        assert before.values[-1] == after.values[0] == jump.value
        assert after.amplitude("rms", 0)[0] == jump.after.amplitude("rms")
        speeds = np.linspace(jump.value - 0.05 * way, jump.value + 0.05 * way, 11)
        near = int(np.argmin(np.abs(before.values - speeds[0])))
        start = state_of(curve.problem, before.branch.X[before.points[near]], Omega=float(before.values[near]))
        swept = hb.time.sweep(hb.SpurPair(eps=(0.2,)), speeds, found.direction, start=start)
        for stretch, side in ((before, -1), (after, 1)):
            here = (swept.values - jump.value) * way * side > 1e-9
            expected = np.interp(way * swept.values[here], way * stretch.values, stretch.amplitude("rms", 0))
            assert here.sum() == 5
            np.testing.assert_allclose(swept.rms[here, 0], expected, rtol=1e-2)  # linear interpolation between points


@pytest.mark.slow
def test_a_run_goes_on_along_doubled_motions():
    curve = hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 8), "Omega", (1.0, 0.2))
    alone = hb.analysis.run_up(curve, "down")
    assert "at PD1, and none of the branches continues there; hb.switch(curve, 'PD1')" in alone.message
    doubled = hb.switch(curve, "PD1")
    down = hb.analysis.run_up(curve, "down", [doubled])
    assert down.message == "Omega = 0.2 reached" and down.sections[-2].branch is doubled
    followed = hb.analysis.run_up(curve, "down", doublings=1)
    assert followed.message == down.message and len(followed.sections) == len(down.sections)
    np.testing.assert_allclose(followed.sections[-2].values, down.sections[-2].values)
    axes = hb.plot.runs(curve, others=[doubled])
    assert sum(line.get_gid() == "on another curve" for line in axes.lines) >= 1


def test_runs_that_cannot_be_meant(curve):
    with pytest.raises(ValueError, match="direction = 'left' must be 'up' or 'down'"):
        hb.analysis.run_up(curve, "left")
    blind = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.9), stability=False)
    with pytest.raises(ValueError, match="with known stability"):
        hb.analysis.run_up(blind)
    along = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "F", (0.1, 0.12), at={"Omega": 0.8})
    with pytest.raises(ValueError, match="a waterfall is over Omega; this run is along F"):
        hb.plot.waterfall(hb.analysis.run_up(along))


def test_a_run_begins_on_the_curve_that_reaches_farthest(tmp_path):
    model = hb.SpurPair(zeta=0.01, eps=(0, 0.2), reference=(38000.0, 37.6e-6, 15000.0, 25))
    wild = hb.trace(hb.HarmonicBalance(model, 8), "Omega", (1.5, 0.3))
    wild.save(tmp_path / "wild.npz")
    curve = hb.load(tmp_path / "wild.npz")  # without its problem, which the forces of landings need
    for direction, extreme in (("up", min), ("down", max)):
        found = hb.analysis.run_up(curve, direction)
        stable = [one.values[np.asarray(one.stable)] for one in curve.curves]
        assert found.sections[0].values[0] == extreme(extreme(values) for values in stable)
    assert len(found.sections) > 1
    levels = hb.plot.orders(found, quantity="force").lines[0].get_ydata()
    assert len(levels) and np.isfinite(levels).all()


def test_a_landing_of_twice_the_period_has_the_quantities_of_its_branch():
    """A loaded landing has the problem of its curve, with half its period; its quantities agree with its branch."""
    model = hb.SpurPair(e=(0.1,), reference=(38000.0, 37.6e-6, 15000.0, 25))
    curve = hb.trace(hb.HarmonicBalance(model, 6), "Omega", (2.1, 1.9))
    doubled = hb.switch(curve, "PD1", steps=hb.StepControl(max_points=4))
    landing = replace(doubled[2], problem=curve.problem)
    assert curve.problem.nu == 1 and curve.problem.at_resolution_of(landing).nu == 2
    own, found = (hb.analysis.machine_quantities(point) for point in (doubled[2], landing))
    for name in ("dte, half peak-to-peak", "dynamic factor", "force, largest"):
        np.testing.assert_allclose(found[name], own[name], rtol=1e-12)


def test_figures_of_runs(curve):
    up = hb.analysis.run_up(curve, "up")
    axes = hb.plot.orders(up, (1, 3), derivative=2)
    lines = [line for line in axes.lines if line.get_gid() == "order 3"]
    np.testing.assert_array_equal(lines[1].get_ydata(), up.sections[1].amplitude("H3", 0, 2))
    assert axes.get_yscale() == "log" and "acceleration of" in axes.get_ylabel()
    axes = hb.plot.waterfall(up)
    levels = [c.get_array().max() for c in axes.collections if c.get_gid() == "order 1"]
    assert len(levels) == 2 and max(levels) == pytest.approx(0.0, abs=0.3)  # mean level of a segment
    arrows = [text for text in hb.plot.runs(curve).texts if text.arrowprops]
    assert len(arrows) == 2


@pytest.mark.parametrize(
    ("labels", "units"),
    [
        ({}, ("model units", "model units", "model units")),
        ({"amplitude": "$x$ [-]"}, ("-", "-", "-")),
        ({"amplitude": "$x$ [mm]", "Omega": "speed [rad/s]"}, ("rad/s", "mm", "model units")),
    ],
)
def test_quantities_of_matrices_have_no_unit_that_is_not_stated(labels, units):
    """Matrices may be in any units, so that their forces are not called dimensionless."""
    system = single_mass(hb.Unilateral(k=1.0, gap=1.0), F=0.2, name="stop")

    @hb.mechanics.model(labels=labels)
    def machine(k: float = 1.0) -> hb.System:
        return system

    for model in (machine(), system) if not labels else (machine(),):
        point = hb.trace(hb.HarmonicBalance(model, 2), "Omega", (1.9, 2.0), stability=False)[0]
        columns = hb.analysis.machine_quantities(point, dof=0).columns
        Omega, length, force = units
        assert [f"Omega [{Omega}]", f"displacement, half peak-to-peak [{length}]"] == list(columns)[:2]
        assert {f"force, largest [{force}]", "largest / mean force [-]", f"acceleration, rms [{force}]"} < set(columns)


def test_answers(curve, tmp_path):
    found, i = hb.analysis.machine_quantities(curve), curve["LP1"].index - 15  # stable, with contact loss
    Omega = float(curve.values[i])
    orbit = hb.time.shoot(hb.SpurPair(eps=(0.2,)), Omega, state_of(curve.problem, curve.X[i], Omega=Omega)).motion()
    force = (1 - 0.2 * np.cos(orbit.tau)) * (np.maximum(orbit.d[0] - 1, 0) + np.minimum(orbit.d[0] + 1, 0))
    assert found["force, largest"][i] == pytest.approx(force.max(), rel=2e-2)
    assert found["force, static"][i] == pytest.approx(0.1, rel=1e-4)
    assert found["dynamic factor"][i] == pytest.approx(found["force, largest"][i] / found["force, static"][i])
    dte = orbit.d[0] + 0.05 * np.cos(orbit.tau)
    assert found["dte, half peak-to-peak"][i] == pytest.approx(np.ptp(dte) / 2, rel=2e-2)
    found.save(tmp_path / "answers.csv")
    head, *rows = (tmp_path / "answers.csv").read_text().splitlines()
    assert head.startswith("Omega [-],") and head.endswith(",stable") and len(rows) == len(curve)
    with pytest.raises(KeyError, match="there is no quantity 'dynamik factor'"):
        found["dynamik factor"]
    with pytest.raises(ValueError, match="the equations of this curve are needed"):
        hb.analysis.machine_quantities(replace(curve, problem=None, meta={}))
    curve.save(tmp_path / "curve.npz")
    np.testing.assert_array_equal(
        hb.analysis.machine_quantities(hb.load(tmp_path / "curve.npz"))["force, largest"], found["force, largest"]
    )
    fold = hb.analysis.machine_quantities(curve["LP1"], problem=curve.problem)
    assert fold["dynamic factor"][0] == pytest.approx(
        hb.analysis.dynamic_factor(curve.problem.model, curve["LP1"]), rel=1e-12
    )
    with pytest.raises(ValueError, match=r"give problem=branch\.problem"):
        hb.analysis.machine_quantities(replace(curve["LP1"], problem=None))
    np.testing.assert_array_equal(
        hb.analysis.machine_quantities(curve["LP1"])["dynamic factor"], fold["dynamic factor"]
    )


@pytest.mark.parametrize(
    ("pair", "gears"),
    [
        (hb.gears.HelicalPair(e=(0.05,)), {"p": ["pinion"], "g": ["wheel"]}),
        (hb.gears.DoubleHelicalPair(), {"p": ["pL", "pR"], "g": ["gL", "gR"]}),
    ],
)
def test_reactions_are_mesh_force_less_inertia(pair, gears):
    """Support forces of a gear equal its mesh forces minus mass times acceleration (Newton's second law)."""
    curve = hb.trace(hb.HarmonicBalance(pair, 10), "Omega", (1.45, 1.451))
    problem, system, Omega, X = curve.problem, pair.system(), float(curve.values[0]), curve.X[0]
    q = problem.motion(X, Omega=Omega)
    mesh = problem.force_rows(X, Omega=Omega) + 2 * pair.zeta * derivative(
        X.reshape(len(system.elements), -1), Omega, 1
    )
    left = -np.transpose([one.direction for one in system.elements]) @ mesh - system.M @ derivative(q, Omega, 2)
    held = {name: one.stiffness @ q + one.damping @ derivative(q, Omega, 1) for name, one in pair.reactions.items()}
    for gear, parts in gears.items():
        for what, axes in (("radial", "xy"), ("axial", "z")):
            own = [f"{part} {what}" for part in parts if f"{part} {what}" in held]
            if not own:
                continue
            rows = [
                sum(left[i] for i, name in enumerate(problem.dof_names) if name.startswith(f"{axis}_{gear}"))
                for axis in axes
            ]
            np.testing.assert_allclose(sum(held[name] for name in own), rows, atol=2e-9 * np.abs(left).max())
    found, theta = hb.analysis.machine_quantities(curve), np.linspace(0, 2 * np.pi, 4001)
    for name, rows in held.items():
        size = np.linalg.norm([evaluate(row, theta) for row in rows], axis=0).max() * pair.scales.force
        assert found[f"reaction {name}, largest"][0] == pytest.approx(size, rel=1e-4)


def test_static_reactions_of_a_spur_pair_are_the_tooth_force():
    pair = hb.gears.HelicalPair(beta_deg=0.0, eps=(0.1,))
    found = hb.analysis.machine_quantities(hb.trace(hb.HarmonicBalance(pair, 8), "Omega", (1.5, 1.49)))
    static = pair.torque / pair.r_p
    for gear in ("pinion", "wheel"):
        assert found[f"reaction {gear} radial, static"] == pytest.approx(static, rel=1e-9)
        assert found[f"reaction {gear} axial, largest"] == pytest.approx(0.0, abs=1e-9 * static)
    leaning = hb.gears.HelicalPair(beta_deg=14.0)
    found = hb.analysis.machine_quantities(hb.trace(hb.HarmonicBalance(leaning, 8), "Omega", (1.5, 1.49)))
    assert found["reaction pinion axial, static"] == pytest.approx(
        leaning.torque / leaning.r_p * np.tan(np.radians(14)), rel=1e-9
    )


def test_the_dynamic_factor_of_an_error_with_corners():
    """The dynamic factor of a point agrees with the machine quantities, both computed from the whole gap."""
    error = hb.mechanics.Periodic.trapezoidal(high=0.06, low=-0.06, share=0.5, ramp=0.1)
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(e=(), error=error), 6), "Omega", (1.5, 1.3))
    expected = hb.analysis.machine_quantities(curve)["dynamic factor"]
    for i in (0, len(curve) - 1):
        assert hb.analysis.dynamic_factor(curve.problem.model, curve[i]) == pytest.approx(expected[i], rel=1e-12)


def test_answers_in_units_of_the_machine():
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(reference=(3e4, 25e-6, 2e4, 25)), 8), "Omega", (1.5, 1.4))
    found = hb.analysis.machine_quantities(curve, dof="q")
    bare = hb.analysis.machine_quantities(hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.5, 1.4)), dof="q")
    assert {"dte, half peak-to-peak [um]", "force, largest [N]", "acceleration, rms [m/s^2]"} <= found.columns.keys()
    np.testing.assert_allclose(found["force, largest"], 2e4 * bare["force, largest"], rtol=1e-9)
    np.testing.assert_allclose(found["dte, half peak-to-peak"], 25 * bare["dte, half peak-to-peak"], rtol=1e-9)
    acceleration = found["acceleration, rms"]
    np.testing.assert_allclose(acceleration, 25e-6 * 3e4**2 * bare["acceleration, rms"], rtol=1e-9)
    np.testing.assert_allclose(found["acceleration, level"], 20 * np.log10(acceleration / 1e-6), rtol=1e-12)


@pytest.mark.parametrize(("order", "zeta"), [(1, 0.05), (2, 0.2)])
def test_order_cuts_satisfy_the_equation_of_motion(order, zeta):
    """a = x'' + e'' = F_m - 2 zeta x' - p, and p = x - 1 in contact: |a_k| = |1 + 2i zeta k Omega| X_k."""
    pair = hb.SpurPair(zeta=zeta, F_m=0.4, e=(0.02, 0.01))
    with pytest.warns(hb.mechanics.ImplausibleInputWarning):
        curve = hb.trace(hb.HarmonicBalance(pair, 6), "Omega", (1.5, 1.4))
    x = curve.amplitude(f"H{order}") / np.sqrt(2)
    force, acceleration, error = (
        hb.analysis.order_amplitudes(curve, name, order) for name in ("force", "acceleration", "transmission error")
    )
    np.testing.assert_allclose(force, x, rtol=1e-7)
    np.testing.assert_allclose(acceleration, np.abs(1 + 2j * zeta * order * curve.values) * x, rtol=1e-7)
    np.testing.assert_allclose(error, acceleration / (order * curve.values) ** 2, rtol=1e-7)
    assert hb.analysis.order_amplitudes(curve[3], "force", order)[0] == force[3]


@pytest.mark.parametrize("quantity", [None, "force"])
def test_axes_of_orders_have_no_rounding_errors(quantity):
    """Without contact the order 2 is zero, or 1e-50; the axis ends 120 dB below the largest amplitude."""
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(zeta=0.1), 8), "Omega", (1.5, 0.6))
    axes = hb.plot.orders(hb.analysis.run_up(curve, "up"), (1, 2), quantity=quantity)
    low, high = axes.get_ylim()
    top = max(line.get_ydata().max() for line in axes.lines)
    assert min(line.get_ydata().min() for line in axes.lines) < low < top < high
    assert low == pytest.approx(1e-6 * top if quantity is None else top - 120)


def test_levels_of_orders_state_their_reference():
    model = gear_pair().model("200 N m", 0.04, mesh="tangent")
    with pytest.warns(hb.mechanics.ImplausibleInputWarning):
        curve = hb.trace(hb.HarmonicBalance(model, 6), "Omega", (1.5, 1.45))
    run, scales = hb.analysis.run_up(curve, "up"), model.scales
    axes = hb.plot.orders(run, (1,), quantity="acceleration")
    assert axes.get_ylabel() == "level of the acceleration [dB re 1 \N{MICRO SIGN}m/s\N{SUPERSCRIPT TWO}]"
    x, y = axes.lines[0].get_data()
    assert x[-1] == pytest.approx(float(scales.pinion_speed(1.5)), rel=1e-12)
    bare = hb.plot.orders(run, (1,), quantity="acceleration", dimensionless=True)
    lower = 20 * np.log10(scales.length * scales.frequency**2 / 1e-6)
    np.testing.assert_allclose(bare.lines[0].get_ydata() + lower, y, atol=1e-9)
    assert "unit of the model" in bare.get_ylabel() and bare.lines[0].get_xdata()[-1] == 1.5
    with pytest.raises(ValueError, match="no order cut of 'speed'; there are transmission error, force, acceleration"):
        hb.plot.orders(run, quantity="speed")


def test_a_waterfall_of_a_drawing_is_in_hertz_over_the_speed():
    model = gear_pair().model("200 N m", 0.04, mesh="tangent")
    with pytest.warns(hb.mechanics.ImplausibleInputWarning):
        curve = hb.trace(hb.HarmonicBalance(model, 6), "Omega", (1.5, 1.45))
    axes = hb.plot.waterfall(hb.analysis.run_up(curve, "up"))
    assert axes.get_xlabel() == "speed of the pinion [r/min]" and axes.get_ylabel() == "frequency [Hz]"
    (line,) = [one for one in axes.lines if one.get_gid() == "line of order 2"]
    (x, y), teeth = np.array(line.get_data())[:, 1], 25
    assert y / x == pytest.approx(2 * teeth / 60, rel=1e-9)
