"""Racks against the formulas of rack and pinion, and against wheels of growing numbers of teeth."""

from dataclasses import replace
from math import cos, degrees, pi, radians, sin, sqrt

import numpy as np
import pytest

import hbgear as hb
from hbgear.gears.pairs.support import Support
from hbgear.io.machines.machine_file import Machine, read_machine, write_machine

TORQUE = "200 N m"


def pinion(**fields):
    return hb.gears.Gear(25, "3 mm", "20 mm", **fields)


def rack(**fields):
    return hb.gears.Gear(40, "3 mm", "20 mm", rack=True, **fields)


@pytest.fixture(scope="module")
def pair():
    return hb.GearPair(pinion(), rack(mass="4 kg"), backlash="80 um")


@pytest.mark.parametrize(("x_1", "x_2", "helix"), [(0, 0, 0), (0.3, 0, 0), (0.2, -0.1, 0), (0.1, 0.2, 15)])
def test_geometry_of_rack_and_pinion(x_1, x_2, helix):
    p = pinion(profile_shift=x_1, helix_angle=radians(helix))
    w = rack(profile_shift=x_2, helix_angle=-radians(helix), mass="4 kg")
    pair = hb.GearPair(p, w, backlash="80 um")
    m, alpha = 0.003, p.transverse_pressure_angle
    r, r_b, r_a = p.reference_diameter / 2, p.base_diameter / 2, p.tip_diameter_used / 2
    # the pitch line touches the reference circle; the reference line of the rack is (x_1 + x_2) m farther away, and its
    # tips are (1 + x_2) m in front of it
    assert pair.mounting_distance == pytest.approx(r + (x_1 + x_2) * m, abs=2e-9)
    path = sqrt(r_a**2 - r_b**2) - r * sin(alpha) + (1 - x_1) * m / sin(alpha)
    assert pair.contact_ratio == pytest.approx(path / (pi * m * cos(alpha) / cos(radians(helix))), abs=2e-6)
    assert degrees(pair.working_pressure_angle) == pytest.approx(degrees(alpha), abs=2e-5)
    # kinetic energy m v^2 / 2 of the rack, whose velocity along the line of action is v cos(alpha)
    assert pair.equivalent_mass == pytest.approx(1 / (r_b**2 / p.inertia_used + cos(alpha) ** 2 / 4.0), rel=1e-6)


def test_the_standard_pinion_of_17_teeth_meshes_with_a_rack():
    """The tips of the rack pass the base circle by .0058 module, less than the undercut that needs no warning.

    The path begins at the base circle, so that it is that of higher racks and of large wheels. It was refused, although
    16 teeth, with a warning, were not.
    """
    small = hb.gears.Gear(17, "3 mm", "20 mm")
    r, r_b, r_a, alpha = 25.5, 25.5 * cos(radians(20)), 28.5, radians(20)
    assert r * sin(alpha) ** 2 < 3 < r * sin(alpha) ** 2 + 0.02 * 3
    ratio = hb.GearPair(small, rack(), "80 um").contact_ratio
    assert ratio == pytest.approx(sqrt(r_a**2 - r_b**2) / (3 * pi * cos(alpha)), abs=4e-3)
    others = rack(addendum=1.01), hb.gears.Gear(8000, "3 mm", "20 mm")
    assert [hb.GearPair(small, other, "80 um").contact_ratio for other in others] == pytest.approx(
        [ratio] * 2, abs=1e-6
    )
    with pytest.raises(ValueError, match="below its base circle"):
        hb.GearPair(small, rack(addendum=1.02), "80 um")


def test_given_distance_leaves_the_backlash_of_straight_flanks():
    wide = hb.GearPair(pinion(), rack(), center_distance=0.0375 + 1e-4)
    assert wide.backlash_as("circumferential") == pytest.approx(2 * 1e-4 * np.tan(radians(20)), rel=1e-4)
    assert wide.mounting_distance == pytest.approx(0.0376, abs=1e-9)


def test_mass_of_the_bar():
    # 40 teeth of 3 mm: bar of 40 pi 3 mm, from half the tooth height, 6.75 / 2 mm, to 9 mm below the roots
    assert rack().mass_used == pytest.approx(40 * pi * 3e-3 * (6.75e-3 / 2 + 9e-3) * 0.02 * 7850, rel=1e-6)


def test_mesh_is_the_limit_of_large_wheels(pair):
    own = pair.mesh(TORQUE)
    large = [hb.GearPair(pair.pinion, hb.gears.Gear(z, "3 mm", "20 mm"), "80 um").mesh(TORQUE) for z in (800, 3200)]
    for values in ([c.stiffness.mean for c in (*large, own)], [c.peak_to_peak for c in (*large, own)]):
        far, near = values[0] - values[2], values[1] - values[2]
        assert far / near == pytest.approx(4, rel=0.02) and abs(near) < 2e-3 * values[2]  # first order in 1 / z


def wheel(teeth, mass):
    """Return a wheel whose kinetic energy is that of a rack of this mass."""
    return hb.gears.Gear(teeth, "3 mm", "20 mm", inertia=mass * (teeth * 0.003 / 2) ** 2)


def check_limit(values, tolerance=0.05):
    """Check that values for wheels of 2400 and 9600 teeth approach that of the rack with 1 / z."""
    far, near = values[0] - values[2], values[1] - values[2]
    assert far / near == pytest.approx(4, rel=tolerance) and abs(near) < 5e-3 * values[2]


@pytest.mark.slow
def test_jumps_are_the_limit_of_large_wheels():
    found = []
    for one in (wheel(2400, rack().mass_used), wheel(9600, rack().mass_used), rack()):
        model = hb.GearPair(pinion(), one, "80 um").model(TORQUE, 0.04)
        curve = hb.trace(hb.HarmonicBalance(model, 24), "Omega", (1.2, 0.5))
        found.append(sorted(float(model.scales.pinion_speed(jump.value)) for c in curve.curves for jump in c.jumps()))
    assert len(found[0]) == len(found[1]) == len(found[2]) > 2
    for values in zip(*found, strict=True):
        check_limit(values, 0.2)  # the difference is some ten times the truncation error


def test_a_rack_in_files(pair, tmp_path):
    machine = Machine(pair, 200.0, 0.04)
    write_machine(machine, tmp_path / "steering.toml")
    read = read_machine(tmp_path / "steering.toml")
    assert read.pair == pair and "rack = true" in (tmp_path / "steering.toml").read_text()
    model = read.model()
    assert model.title == "Gear pair 25/40 (rack), m = 3 mm, 200 N m"
    curve = hb.trace(hb.HarmonicBalance(model, 4), "Omega", (1.5, 1.45), stability=False, special=False)
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz")
    assert hb.analysis.machine_quantities(again)["dynamic factor"] == pytest.approx(
        hb.analysis.machine_quantities(curve)["dynamic factor"]
    )


def test_friction_of_a_rack_is_the_limit_of_large_wheels(pair):
    amplitudes = []
    for one in (wheel(2400, 4.0), wheel(9600, 4.0), pair.wheel):
        problem = hb.HarmonicBalance(replace(pair, wheel=one).model(TORQUE, 0.04, friction=0.06), 12)
        curve = hb.trace(problem, "Omega", (1.6, 1.55), stability=False, special=False)
        amplitudes.append(curve.amplitude("pp2")[0])
    check_limit(amplitudes)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: hb.GearPair(rack(), rack(), "80 um"), "rack = True for the pinion; give the rack as the wheel"),
        (lambda: rack(internal=True), "internal and rack are both True"),
        (lambda: rack(inertia=1.0), "inertia belongs to a gear that turns, and this is a rack; give its mass"),
        (lambda: rack(runout="10 um"), "runout belongs to a gear that turns, and this is a rack; omit runout"),
        (lambda: hb.gears.Gear(25, "3 mm", "20 mm", rack=1), "rack = 1 must be True or False"),
        (
            lambda: hb.GearPair(pinion(), rack(), center_distance="37.2 mm"),
            "at center_distance = 37.2 mm the teeth overlap by 218 um",
        ),
        (lambda: hb.GearPair(pinion(), rack(addendum=1.6), "80 um"), "give an addendum below 1.2500 modules"),
        (
            lambda: hb.GearPair(pinion(), rack(), "80 um").model(
                TORQUE, 0.04, "bearings", supports=(Support("1e8 N/m"), Support("1e8 N/m"))
            ),
            "this wheel is a rack, which moves along its length only",
        ),
        (
            lambda: hb.gears.Mesh.of("a", "b", hb.GearPair(pinion(), rack(), "80 um"), TORQUE),
            "the wheel is a rack, and all wheels of a train turn",
        ),
    ],
)
def test_impossible_racks_are_refused(make, said):
    with pytest.raises(ValueError, match=said):
        make()
