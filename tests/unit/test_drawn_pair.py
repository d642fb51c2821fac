"""Gear pairs by the names of the drawing: the same curves as fresh models, in the units of the first design."""

import numpy as np
import pytest
from typer.testing import CliRunner

import hbgear as hb
from hbgear.analysis.quantities.axis_quantities import Abscissa, Ordinate
from hbgear.cli import app as cli
from hbgear.cli.quantities import Omega_of, parameter_value
from hbgear.gears.pairs.drawn_pair import PARAMETERS
from hbgear.harmonic.models.model_registry import rebuild_model
from hbgear.mechanics.models import describe

SUPPORTS = (hb.gears.Support(3.3e8, tilt=1e6), hb.gears.Support(2e8, tilt=2e6))


def pair(backlash="80 um", module="3 mm", relief="0 um"):
    gears = (hb.gears.Gear(z, module, "20 mm", tip_relief=relief) for z in (25, 40))
    return hb.GearPair(*gears, backlash=backlash)


def drawn(form="torsion"):
    return hb.gears.DrawnPair(pair(), 200.0, 0.04, form, SUPPORTS if form != "torsion" else ())


@pytest.mark.parametrize("form", ["torsion", "bearings", "spatial"])
def test_a_changed_design_has_the_motion_of_a_fresh_model(form):
    """Backlash, torque, module and relief change together: the motion in um at the same r/min, to rounding."""
    changed = drawn(form).replace(backlash=100.0, torque=250.0, module=3.5, tip_relief=12.0, damping=0.06)
    more = {"supports": SUPPORTS} if form != "torsion" else {}
    fresh = pair("100 um", "3.5 mm", "12 um").model(250.0, 0.06, form, **more)
    sizes = []
    for model in (changed, fresh):
        problem = hb.HarmonicBalance(model, 6)
        X = hb.trace(
            problem,
            "Omega",
            (start := model.scales.from_pinion_speed(21000.0), 0.999 * start),
            stability=False,
            special=False,
            accuracy=None,
        )
        found = hb.analysis.machine_quantities(X)
        sizes.append([found[name][0] for name in ("pinion", "dte, half peak-to-peak", "force, largest")])
    np.testing.assert_allclose(*sizes, rtol=1e-8)
    assert changed.scales.frequency == pytest.approx(drawn(form).scales.frequency, rel=1e-12)


def test_multipliers_take_the_width_of_the_gears_as_a_parameter():
    """The width [mm] was taken as the step size of the multipliers: it had no effect, and events raised TypeError."""
    problem, wide = (hb.HarmonicBalance(model, 8) for model in (drawn(), drawn().replace(width=30.0)))
    X = wide.start(1.2)
    given = problem.multipliers(X, points=8, max_step=1.0, Omega=1.2, width=30.0)
    np.testing.assert_allclose(given, wide.multipliers(X, points=8, max_step=1.0, Omega=1.2), rtol=1e-10)
    assert abs(given[0] - problem.multipliers(X, Omega=1.2)[0]) > 1e-4


def test_every_parameter_is_read_and_changed():
    model = drawn("bearings").replace(friction=0.05)
    absent = {"tip_relief_pinion", "tip_relief_wheel", "runout_pinion", "runout_wheel"}  # equal reliefs, no run-out
    assert {**PARAMETERS}.keys() - absent == model.parameters.keys()
    for name, value in model.parameters.items():
        other = model.replace(**{name: 1.01 * value + 0.01})
        changed = {n for n, x in other.parameters.items() if x != model.parameters[n]}
        assert changed == {name} and other.parameters[name] == pytest.approx(1.01 * value + 0.01, rel=1e-14)
        assert model.labels[name].endswith(f"[{PARAMETERS[name].unit or '-'}]")
    one = model.replace(tip_relief_pinion=12.0)
    assert one.pair.pinion.tip_relief == 12e-6 and one.pair.wheel.tip_relief == 0.0
    assert "tip_relief" not in one.parameters and one.parameters["tip_relief_pinion"] == 12.0
    with pytest.raises(KeyError, match="no parameter 'backlsh'; did you mean 'backlash'"):
        model.replace(backlsh=1.0)
    with pytest.raises(ValueError, match="backlash"):
        model.replace(backlash=-5.0)


def test_a_file_has_the_model():
    model = drawn("bearings").replace(torque=210.0)
    assert rebuild_model(describe(model)) == model
    assert model.title == "Gear pair 25/40, m = 3 mm, 210 N m"


@pytest.mark.parametrize(
    ("parameter", "span", "unit"), [("torque", (200.0, 210.0), "N m"), ("damping", (0.04, 0.05), "-")]
)
def test_quantities_along_a_parameter_have_its_unit(tmp_path, parameter, span, unit):
    problem = hb.HarmonicBalance(drawn(), 3)
    curve = hb.trace(problem, parameter, span, at={"Omega": 0.8}, stability=False, special=False, accuracy=None)
    found = hb.analysis.machine_quantities(curve)
    np.testing.assert_allclose(found[f"{parameter} [{unit}]"][[0, -1]], span)
    curve.save(tmp_path / "curve.npz")
    out = CliRunner().invoke(cli.app, ["results", str(tmp_path / "curve.npz")]).output
    assert "force, largest [N]" in out and f"{parameter} [" not in out


def test_axes_in_physical_units():
    model = drawn()
    curve = hb.trace(hb.HarmonicBalance(model, 6), "Omega", (1.5, 1.45), stability=False, special=False)
    across = Abscissa([curve])
    np.testing.assert_allclose(across.along(curve), model.scales.pinion_speed(curve.values), rtol=1e-12)
    np.testing.assert_allclose(Ordinate("pp2").along(curve), 1e6 * model.scales.length * curve.amplitude("pp2"))
    np.testing.assert_allclose(Ordinate("dte").along(curve), Ordinate("pp2").along(curve))  # no transmission error
    found = hb.analysis.machine_quantities(curve)
    np.testing.assert_allclose(Ordinate("force").along(curve), found["force, largest"])
    assert Ordinate("force").header(curve) == "force, largest [N]"
    assert Ordinate("H1", dimensionless=True).header(curve) == "H1"
    assert Ordinate("pp2").at(curve[0]) == pytest.approx(Ordinate("pp2").along(curve)[0])


@pytest.mark.slow
def test_a_curve_in_the_backlash_is_at_one_speed():
    """Beyond all contact with the back flanks and without loss of contact the backlash has no effect."""
    model = drawn().replace(damping=0.2, tip_relief=20.0)
    problem = hb.HarmonicBalance(model, 4)
    curve = hb.trace(problem, "backlash", (80.0, 82.0), at={"Omega": 1.2}, stability=False, special=False)
    assert curve.values[-1] == 82.0
    size = Ordinate("pp2").along(curve)
    np.testing.assert_allclose(size, size[0], rtol=1e-9)
    assert Abscissa([curve]).label == "backlash [um]"


@pytest.mark.parametrize(("text", "value"), [("90", 90.0), ("90um", 90.0), ("0.09 mm", 90.0)])
def test_values_with_units(text, value):
    assert parameter_value(drawn().labels, "--set", "backlash", text) == pytest.approx(value, rel=1e-15)


def test_refused_values():
    model, labels = drawn(), drawn().labels
    with pytest.raises(ValueError, match="backlash = '90N' must be a quantity in um"):
        parameter_value(labels, "--set", "backlash", "90N")
    with pytest.raises(ValueError, match="damping has no unit"):
        parameter_value(labels, "--set", "damping", "4um")
    with pytest.raises(ValueError, match="--from x9: need a speed with its unit"):
        Omega_of(model, "--from", "x9")
    with pytest.raises(ValueError, match="has no scales"):
        Omega_of(hb.Duffing(), "--from", "9000r/min")
    with pytest.raises(ValueError, match=r"^--from abc: need a number, such as --from 0.9$"):
        Omega_of(hb.Duffing(), "--from", "abc")


def test_speeds_and_frequencies_are_Omega():
    model = drawn()
    assert Omega_of(model, "--from", "9000r/min") == pytest.approx(model.scales.from_pinion_speed(9000.0), rel=1e-14)
    assert Omega_of(model, "--from", "2.5 kHz") == pytest.approx(model.scales.from_mesh_frequency(2500.0), rel=1e-14)
    assert Omega_of(model, "--from", "0.9") == 0.9
