"""Nothing is computed relative to a static force that is zero."""

import re

import numpy as np
import pytest
from machines import single_mass
from typer.testing import CliRunner

import hbgear as hb
from hbgear.analysis.quantities.mesh_dynamic_factor import FORCE_SAMPLES, is_static
from hbgear.cli import app as cli


def rotor(mean=0.0):
    """A disc that an unbalance moves in x; its bearing in y has forces of rounding only."""
    bearings = [hb.Element(w, hb.Cubic(k1=2.0, k3=0.5), name=name) for w, name in (([1, 0], "x"), ([1e-16, 1], "y"))]
    seal = hb.Element([1.0, 0.0], hb.Backlash(k=8.0, b=0.2), name="seal")
    loads = [hb.Load(constant=[mean, 0.0]), hb.Load(cosine={1: [0.3, 0.0]}, power=2)]
    return hb.System(np.eye(2), 0.1 * np.eye(2), 0.01 * np.eye(2), [*bearings, seal], loads, dof_names=["x", "y"])


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(rotor(), 8), "Omega", (0.8, 1.4), stability=False)


@pytest.mark.parametrize("element", ["x", "y", "seal"])
def test_no_dynamic_factor_without_static_force(curve, element):
    found = hb.analysis.machine_quantities(curve, element)
    assert np.isnan(found["dynamic factor"]).all() and not found["force, static"].any()
    assert element == "y" or found["force, largest"].max() > 0.1
    with pytest.raises(ValueError, match=f"the static force of '{element}' is zero"):
        hb.analysis.dynamic_factor(rotor(), curve[0], element)
    with pytest.raises(ValueError, match="there is no dynamic factor to draw"):
        hb.plot.response(curve, "dynamic factor", element)


def test_no_load_to_share(curve):
    with pytest.raises(ValueError, match=r"the mean load of .* is zero"):
        hb.analysis.load_sharing(curve, ["x", "y"])


def test_a_small_static_force_counts():
    """Mean load F on a linear bearing, amplitude a: the factor is 1 + k a / F."""
    F, k = 1e-4, 2.0
    one = single_mass(hb.Cubic(k1=k, k3=0), F=0.3, mean=F, k=0.0, name="x")
    point = hb.trace(hb.HarmonicBalance(one, 2), "Omega", (0.5, 0.6), stability=False)[0]
    amplitude = 0.3 / abs(k - 0.25 + 0.05j)
    assert hb.analysis.dynamic_factor(one, point) == pytest.approx(1 + k * amplitude / F, rel=1e-5)
    assert hb.analysis.machine_quantities(point)["dynamic factor"][0] == pytest.approx(1 + k * amplitude / F, rel=1e-5)


@pytest.mark.parametrize("pulses", [2, 10, 60])
def test_jumps_of_the_stiffness_are_no_static_force(rng, pulses):
    """Pulses of both signs without a mean: that of their samples is up to 1e-3 of the force, and counted as a mean."""
    time, largest = np.arange(FORCE_SAMPLES) / FORCE_SAMPLES, 0.0
    for _ in range(100):
        width = rng.uniform(0.001, 0.2, pulses // 2).repeat(2)
        begins, heights = rng.uniform(0, 1, pulses), rng.uniform(0.2, 1, pulses // 2).repeat(2)
        inside = (time - begins[:, None]) % 1.0 < width[:, None]
        force = (heights * np.tile([1.0, -1.0], pulses // 2)) @ inside
        size = np.abs(force).max()
        assert not is_static(force, size)
        assert is_static(force + 0.01 * size, size)
        largest = max(largest, abs(force.mean()) / size)
    assert largest > 1e-4


@pytest.mark.filterwarnings("ignore:no element comes near a breakpoint")
def test_command_prints_the_largest_force_of_a_wheel_that_drives(tmp_path):
    """The motions are those of the pair whose pinion drives, with the opposite sign."""
    pair = hb.SpurPair(zeta=0.1, F_m=0.9)
    curves = [
        hb.trace(hb.HarmonicBalance(one, 3), "Omega", (1.4, 0.6)) for one in (pair, pair.replace(F_m=-0.9, e_scale=-1))
    ]
    largest = hb.analysis.machine_quantities(curves[0])["force, largest"].max()
    curves[1].save(tmp_path / "pair.npz")
    out = CliRunner().invoke(cli.app, ["results", str(tmp_path / "pair.npz")]).output
    (shown,) = re.findall(r"force, largest \[-\] +(\S+)", out)
    assert float(shown) == pytest.approx(-largest, rel=1e-3)


def test_command_prints_the_largest_values_between_the_points_of_a_curve(tmp_path):
    """Without loss of contact the transmission error is e times the transmissibility of an oscillator, and the dynamic
    factor is 1 + e R / F_m with R = Omega^2 / |1 - Omega^2 + 2 i zeta Omega|."""
    zeta = 0.05
    pair = hb.SpurPair(zeta=zeta, F_m=0.9, reference=(38000.0, 37.6e-6, 15000.0, 25))
    hb.trace(hb.HarmonicBalance(pair, 3), "Omega", (1.4, 0.6)).save(tmp_path / "pair.npz")
    out = CliRunner().invoke(cli.app, ["results", str(tmp_path / "pair.npz")]).output
    Omega = np.sqrt([(np.sqrt(1 + 8 * zeta**2) - 1) / (4 * zeta**2), 1 / (1 - 2 * zeta**2)])
    r = np.abs(1 - Omega**2 + 2j * zeta * Omega)
    sizes = 37.6 * 0.05 * np.sqrt(1 + (2 * zeta * Omega[0]) ** 2) / r[0], 1 + 0.05 / 0.9 * Omega[1] ** 2 / r[1]
    for name, size, speed in zip(("dte, half peak-to-peak", "dynamic factor"), sizes, Omega, strict=True):
        ((shown, at),) = re.findall(rf"{name} \[.*\] +(\S+) +(\S+)", out)
        assert float(shown) == pytest.approx(size, rel=3e-4)
        assert float(at) == pytest.approx(pair.scales.pinion_speed(speed), rel=1e-5)


def test_command_prints_the_largest_value_at_a_fold(tmp_path):
    """The stable points of a coarse curve are 0.5 % below the fold at which the stable motions end."""
    problem = hb.HarmonicBalance(hb.SpurPair(zeta=0.01), 8)
    curve = hb.trace(problem, "Omega", (1.6, 0.3), steps=hb.StepControl(max_step=1, max_turn_deg=60))
    curve.save(tmp_path / "pair.npz")
    fold = hb.trace(problem, "Omega", (1.6, 0.3))["LP1"]
    largest = hb.analysis.machine_quantities(fold)["dte, half peak-to-peak"][0]
    errors = hb.analysis.machine_quantities(curve)["dte, half peak-to-peak"]
    assert errors[np.array(curve.stable, bool)].max() < 0.996 * largest
    out = CliRunner().invoke(cli.app, ["results", str(tmp_path / "pair.npz")]).output
    ((shown, at),) = re.findall(r"dte, half peak-to-peak \[-\] +(\S+) +(\S+)", out)
    assert float(shown) == pytest.approx(largest, rel=3e-4)
    assert float(at.partition("(")[0]) == pytest.approx(fold.parameters["Omega"], rel=1e-3)


def test_command_prints_no_factor(curve, tmp_path):
    path = tmp_path / "rotor.npz"
    curve.save(path)
    result = CliRunner().invoke(cli.app, ["results", str(path), "--element", "y"])
    assert result.exit_code == 0, result.output
    assert "undefined: mean force is zero" in result.output


def test_the_static_force_of_pairs_of_teeth_is_that_of_the_torque():
    """T / r_b at each point, though the stiffness jumps where pairs begin: sampled means differ by up to 1e-3."""
    gears = [hb.gears.Gear(z, "2.5 mm", "18 mm") for z in (21, 37)]
    model = hb.GearPair(*gears, backlash="60 um").model("120 N m", damping=0.06)
    curve = hb.trace(hb.HarmonicBalance(model, 12), "Omega", (1.3, 1.1), stability=False)
    found = hb.analysis.machine_quantities(curve)
    base = 2.5e-3 * 21 / 2 * np.cos(np.radians(20))
    np.testing.assert_allclose(found["force, static"], 120 / base, rtol=1e-8)
    factors = [hb.analysis.dynamic_factor(model, point) for point in curve]
    np.testing.assert_allclose(factors, found["dynamic factor"], rtol=1e-12)
