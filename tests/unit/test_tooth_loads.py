"""Form factors of ISO 6336-3, loads of single pairs of teeth and static transmission error over torque."""

from math import cos, pi, radians

import numpy as np
import pytest

import hbgear as hb
from hbgear.gears.drawing.tooth import Tooth
from hbgear.gears.mesh.tooth_forces import static_displacement


def gear(z, **fields):
    return hb.gears.Gear(**{"teeth": z, "module": "3 mm", "face_width": "20 mm", **fields})


def pair(relief=12e-6, **fields):
    return hb.GearPair(*(gear(z, tip_relief=relief, **fields) for z in (25, 40)), backlash="80 um")


PUBLISHED = {
    17: (2.97, 1.52),
    20: (2.80, 1.55),
    25: (2.62, 1.59),
    30: (2.52, 1.625),
    40: (2.40, 1.67),
    60: (2.28, 1.73),
    100: (2.18, 1.79),
    200: (2.12, 1.865),
}
"""Y_F and Y_S for a force at the tip, rack of 20 degrees, dedendum 1.25, tip radius 0.38: GB/T 3480 (ISO 6336-3), as
tabulated in textbooks of machine design with two decimals."""


@pytest.mark.parametrize("z", PUBLISHED)
def test_form_factors_are_the_published_ones(z):
    found = hb.gears.root_factors(gear(z), gear(z).tip_diameter_used)
    assert float(found.form) == pytest.approx(PUBLISHED[z][0], rel=8e-3)
    assert float(found.correction) == pytest.approx(PUBLISHED[z][1], rel=3e-3)


@pytest.mark.parametrize(("z", "x", "beta"), [(17, 0.0, 0.0), (25, 0.4, 0.0), (60, -0.2, 0.3), (30, 1.6, 0.0)])
def test_the_root_is_where_the_generated_fillet_is_inclined_by_30_degrees(z, x, beta):
    """Thickness there, by differences of the trochoid instead of the closed form."""
    one = gear(z, profile_shift=x, helix_angle=beta)
    tooth = Tooth(one)
    r, a = tooth._fillet()
    up, half = r * np.cos(a), r * np.sin(a)
    slope = -np.gradient(half) / np.gradient(up)
    order = np.argsort(slope)
    thickness = 2 * np.interp(np.tan(pi / 6), slope[order], half[order])
    found = hb.gears.root_factors(one, one.reference_diameter)
    assert found.thickness == pytest.approx(thickness, rel=1e-3)


@pytest.mark.parametrize(("z", "x"), [(17, 0.0), (25, 0.4), (60, -0.2)])
def test_factors_along_the_flank_are_those_of_its_normals(z, x):
    """The normal of the flank meets the centre line at r_b / cos(slope); the root is found by differences."""
    one = gear(z, profile_shift=x)
    r, a = Tooth(one)._fillet()
    up, half = r * np.cos(a), r * np.sin(a)
    first, second = np.gradient(half, up), np.gradient(np.gradient(half, up), up)
    order = np.argsort(-first)
    root, thickness, curvature = (
        np.interp(np.tan(pi / 6), -first[order], y[order])
        for y in (up, 2 * half, np.abs(second) / (1 + first**2) ** 1.5)
    )
    alpha, base = radians(20), one.base_diameter / 2
    for at in np.linspace(1.02 * base, one.tip_diameter_used / 2, 4).tolist():
        angle = np.arccos(base / at)
        half_angle = (pi / 2 + 2 * x * np.tan(alpha)) / z + np.tan(alpha) - alpha - np.tan(angle) + angle
        slope = angle - half_angle
        arm = base / np.cos(slope) - root
        form = 6 * arm * one.module * np.cos(slope) / (thickness**2 * np.cos(alpha))
        L, notch = thickness / arm, thickness * curvature / 2
        found = hb.gears.root_factors(one, 2 * at)
        assert float(found.form) == pytest.approx(form, rel=2e-3)
        assert float(found.correction) == pytest.approx((1.2 + 0.13 * L) * notch ** (1 / (1.21 + 2.3 / L)), rel=4e-3)
    assert found.fillet_radius == pytest.approx(1 / curvature, rel=1e-2)


def test_gears_without_a_form_factor():
    with pytest.raises(ValueError, match="ring gear; form factors"):
        hb.gears.root_factors(gear(80, internal=True), 0.24)
    with pytest.raises(
        ValueError,
        match=r"not on the involute; give values from the base diameter 70\.4769 mm to the tip diameter 81 mm",
    ):
        hb.gears.root_factors(gear(25), 0.07)


@pytest.fixture(scope="module")
def loaded():
    """A stable motion with loss of contact, below the resonance."""
    gears = pair()
    mesh = hb.gears.tooth_mesh(gears, 200.0)
    problem = hb.HarmonicBalance(gears.model(200.0, 0.04, mesh="teeth"), 16)
    curve = hb.trace(problem, "Omega", (1.2, 0.7), special=False, cover=False)
    point = max((curve[i] for i in np.flatnonzero(curve.stable)), key=lambda p: p.amplitude("max"))
    return gears, mesh, point, hb.analysis.tooth_loads(point, mesh)


def test_pair_forces_add_to_the_mesh_force(loaded):
    _, mesh, point, loads = loaded
    model = point.problem.model
    factor = hb.analysis.dynamic_factor(model, point)
    static = mesh.force
    assert loads.forces.total.max() == pytest.approx(factor * static, rel=1e-3)
    assert loads.static.force.max() == pytest.approx(static, rel=1e-9)  # one pair carries all between two
    np.testing.assert_allclose(loads.static.total, static, rtol=1e-9)
    np.testing.assert_allclose(loads.static.share, loads.static.force / static, rtol=1e-9)
    assert loads.static.share.max() == pytest.approx(1.0) and not loads.forces.share[loads.forces.total <= 0].any()
    assert 1.5 < loads.force_factor == pytest.approx(loads.force.max() / static)
    assert 0.1 < loads.separated[0] < 0.6 and loads.back_contact[0] == 0.0
    number, position = loads.largest
    assert number == 0 and loads.force[0, np.searchsorted(loads.position, position)] == loads.force.max()


def test_root_stress_of_the_standard_at_the_outer_point_of_single_contact(loaded):
    """sigma_F0 = F_t / (b m) Y_F Y_S there, with the whole static force on one pair."""
    gears, mesh, _, loads = loaded
    begin = gears.path[0]
    for i, (wheel, s) in enumerate(
        (
            (gears.pinion, begin + gears.base_pitch),
            (gears.wheel, gears.tangent_length - begin - (gears.contact_ratio - 1) * gears.base_pitch),
        )
    ):
        factors = hb.gears.root_factors(wheel, 2 * np.hypot(s, wheel.base_diameter / 2))
        force = mesh.force * cos(wheel.transverse_pressure_angle)
        nominal = force / (0.02 * 0.003) * float(factors.form * factors.correction)
        assert loads.static_root_stress[i].max() == pytest.approx(nominal, rel=2e-3)
    assert all(factor > 1.5 for factor in loads.root_factor)


def test_another_mesh_is_refused(loaded):
    gears, mesh, point, _ = loaded
    with pytest.raises(ValueError, match="give the tooth_mesh of the same pair and torque"):
        hb.analysis.tooth_loads(point, hb.gears.tooth_mesh(gears, 150.0))
    problem = hb.HarmonicBalance(gears.model(200.0, 0.04, mesh="secant"), 4)
    with pytest.raises(ValueError, match="has not the contacts of this mesh"):
        hb.analysis.tooth_loads(hb.trace(problem, "Omega", (1.5, 1.49))[0], mesh)


def test_contacts_of_helical_teeth_with_relief_do_not_depend_on_the_backlash():
    """The fits of the gaps of their slices did, so that the loads of these teeth were refused."""
    gears = [
        hb.gears.Gear(z, "2.5 mm", "40 mm", helix_angle=beta, tip_relief="15 um")
        for z, beta in ((25, "15 deg"), (63, "-15 deg"))
    ]
    contacts = [
        hb.gears.tooth_mesh(hb.GearPair(*gears, backlash=backlash), 300.0).contacts(1.0)
        for backlash in (None, "100 um")
    ]
    assert contacts[0] == contacts[1]


def test_loads_of_a_changed_drawing():
    """In the units of another design the forces [N] are the same; teeth in contact do not notice the backlash."""
    found = []
    for change in ({}, {"backlash": 100.0}, {"torque": 200.5}):
        model = hb.gears.DrawnPair(pair(), 200.0, 0.04).replace(**change)
        curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", (1.2, 1.19), stability=False, special=False)
        found.append(hb.analysis.tooth_loads(curve[0], hb.gears.tooth_mesh(model.pair, model.torque)))
    assert found[1].force.max() == pytest.approx(found[0].force.max(), rel=1e-9)
    assert found[1].root_stress.max() == pytest.approx(found[0].root_stress.max(), rel=1e-9)
    assert found[2].force_factor == pytest.approx(found[0].force_factor, rel=2e-3)


def test_harris_map_is_the_static_state_of_the_tooth_resolved_mesh():
    """At the torque of the mesh both have the same compliance of the contacts; the best torque is in between."""
    gears, torques = pair(), (50.0, 120.0, 200.0)
    found = hb.gears.harris_map(gears, torques)
    for torque, error in zip(torques, found.error, strict=True):
        mesh = hb.gears.tooth_mesh(gears, torque)
        phase, delta = static_displacement(mesh.flanks, mesh.force)
        inner = np.abs((found.phase - gears.contact_ratio) % 1.0 - 0.5) < 0.49
        inner &= (found.phase > 0.01) & (found.phase < 0.99)
        exact = np.interp(found.phase[inner], phase, delta)
        np.testing.assert_allclose(error[inner], exact, rtol=1e-3)
    assert np.argmin(found.peak_to_peak) == 1
    assert len(np.unique(found.phase)) == 256 + 2  # both ends, and the phase at which a pair leaves contact
    np.testing.assert_array_equal(hb.gears.harris_map(gears, torques[:1]).error, found.error[:1])
    with pytest.raises(ValueError, match="torques is empty"):
        hb.gears.harris_map(gears, [])


def test_figures(loaded, tmp_path):
    figure = hb.plot.tooth_loads(loaded[3])
    assert [ax.get_ylabel() for ax in figure.axes] == ["force of a pair of teeth [kN]", "share in the mesh force [-]"]
    ax = hb.plot.harris_map(hb.gears.harris_map(pair(), [50.0, 200.0], phases=32))
    assert ax.lines[0].get_label().startswith("50 N m")
    hb.plot.save(figure, tmp_path / "a.png")


def test_loads_of_back_flanks():
    """Equal gears are symmetric: a negative torque loads the back flanks as the same torque loads the driving ones."""
    gears = [hb.gears.Gear(z, "3 mm", "20 mm", tip_relief="10 um") for z in (30, 30)]
    pair, found = hb.GearPair(*gears, backlash="80 um"), []
    for torque in (200.0, -200.0):
        problem = hb.HarmonicBalance(pair.model(torque, 0.06), 16)
        curve = hb.trace(problem, "Omega", (0.6, 0.59), stability=False, special=False)
        found.append(hb.analysis.tooth_loads(curve[0], hb.gears.tooth_mesh(pair, 200.0)))
    drive, coast = found
    assert (drive.side, coast.side) == (1, -1)
    assert coast.force.max() == pytest.approx(drive.force.max(), rel=2e-3)  # one step of the path
    assert coast.force.mean() == pytest.approx(drive.force.mean() * drive.force.size / coast.force.size, rel=1e-3)
    np.testing.assert_allclose(coast.static.force.max(), drive.static.force.max(), rtol=1e-6)
    # the wheel drives: its dedendum is in contact first, where that of the pinion was
    np.testing.assert_allclose(coast.root_stress.max(axis=(1, 2)), drive.root_stress.max(axis=(1, 2))[::-1], rtol=3e-3)
