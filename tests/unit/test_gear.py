"""Geometry of gears and pairs against formulas written another way, and what cannot be made."""

import dataclasses
import re
import warnings
from contextlib import nullcontext
from math import acos, atan, cos, degrees, hypot, pi, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import hbgear as hb
from hbgear.gears.drawing.backlash import convert_backlash
from hbgear.gears.drawing.geometry import (
    base_helix_angle,
    base_radius,
    inverse_involute,
    involute,
    shaft_stiffness,
    transverse_pressure_angle,
)
from hbgear.gears.drawing.interference import Engagement
from hbgear.gears.drawing.tooth import Tooth


def gear(z, **fields):
    return hb.gears.Gear(**{"teeth": z, "module": "3 mm", "face_width": "20 mm", **fields})


def pair(z_1=25, z_2=40, x_1=0.0, x_2=0.0, beta=0.0, **fields):
    """A pair whose pinion has a right-hand helix of beta degrees."""
    gears = (gear(z, profile_shift=x, helix_angle=radians(h)) for z, x, h in ((z_1, x_1, beta), (z_2, x_2, -beta)))
    return hb.GearPair(*gears, **fields)


@pytest.mark.parametrize("alpha", [1e-3, 0.1, 0.35, 1.0, 1.4, 1.56])
def test_inverse_involute(alpha):
    assert inverse_involute(involute(alpha)) == pytest.approx(alpha, rel=1e-9)


def test_inverse_involute_of_nothing():
    assert inverse_involute(0.0) == 0.0
    with pytest.raises(ValueError, match="not be negative"):
        inverse_involute(-1e-3)


@pytest.mark.parametrize(("alpha", "beta"), [(20, 0), (20, 14), (25, -30)])
def test_base_cylinder_by_the_base_pitches(alpha, beta):
    """tan(beta_b) = tan(beta) cos(alpha_t); z p_bt = 2 pi r_b with p_bt cos(beta_b) = p_bn = pi m_n cos(alpha_n)."""
    alpha, beta = radians(alpha), radians(beta)
    helix = atan(tan(beta) * cos(transverse_pressure_angle(alpha, beta)))
    assert base_helix_angle(alpha, beta) == pytest.approx(helix, rel=1e-12)
    pitch = pi * 3e-3 * cos(alpha) / cos(helix)
    assert base_radius(23, 3e-3, alpha, beta) == pytest.approx(23 * pitch / (2 * pi), rel=1e-12)


@pytest.mark.parametrize("inner", [0.0, 0.031])
def test_shaft_section_by_its_strain_energy(inner):
    """Unit loads on a section that keeps the directions of its ends: M = l/2 - x, N = 1 and T = 1, over its rings."""
    E, nu, outer, length = 2.1e11, 0.29, 0.047, 0.38
    rings = [quad(lambda r, n=n: 2 * pi * r**n, inner / 2, outer / 2)[0] for n in (1, 3)]  # A and J
    energies = (
        quad(lambda x: (length / 2 - x) ** 2 / (E * rings[1] / 2), 0, length)[0],
        quad(lambda x: 1 / (E * rings[0]), 0, length)[0],
        quad(lambda x: 2 * (1 + nu) / (E * rings[1]), 0, length)[0],
    )
    np.testing.assert_allclose(shaft_stiffness(E, nu, outer, inner, length), 1 / np.array(energies), rtol=1e-12)


def test_published_contact_ratios():
    """A rotor-dynamics code's test pair, and the third stage of the NREL 5 MW gearbox with its shortened tips."""
    twins = hb.GearPair(*(hb.gears.Gear(62, "2 mm", "20 mm") for _ in range(2)))
    assert twins.contact_ratio == pytest.approx(1.78978, abs=5e-6)
    beta, shifts, teeth = radians(10), (0.480, 0.669), (24, 95)
    d = [14e-3 * z / cos(beta) for z in teeth]
    shortened = sum(shifts) - (0.861 - sum(d) / 2) / 14e-3
    gears = [
        hb.gears.Gear(
            z, "14 mm", "360 mm", helix_angle=h, profile_shift=x, tip_diameter=d_0 + 28e-3 * (1 + x - shortened)
        )
        for z, x, d_0, h in zip(teeth, shifts, d, (beta, -beta), strict=True)
    ]
    stage = hb.GearPair(*gears, backlash=0.0, center_distance="861 mm")
    assert stage.contact_ratio == pytest.approx(1.462659, abs=2e-4)  # 2e-4: the tips are rounded in the source
    assert stage.overlap_ratio == pytest.approx(0.36 * sin(beta) / (pi * 14e-3), rel=1e-12)


def test_pair_against_the_construction():
    """Shifted helical pair: the working angle by a root finder, the path of contact from circles and their tangent."""
    p = pair(19, 33, 0.3, 0.15, 14)
    beta = radians(14)
    alpha_t = atan(tan(radians(20)) / cos(beta))
    inv = involute(alpha_t) + 2 * tan(radians(20)) * 0.45 / 52
    alpha_w = brentq(lambda a: involute(a) - inv, 0.1, 1.0, xtol=1e-15)
    r_b = [3e-3 * z / cos(beta) / 2 * cos(alpha_t) for z in (19, 33)]
    a = sum(r_b) / cos(alpha_w)
    assert p.working_center_distance == pytest.approx(a, rel=1e-12)
    begin, end = p.path
    along = np.array(
        [sin(alpha_w), cos(alpha_w)]
    )  # the line of action; it touches the base circle of the pinion in foot
    foot = r_b[0] * np.array([cos(alpha_w), -sin(alpha_w)])
    for s, centre, g in ((begin, (a, 0.0), p.wheel), (end, (0.0, 0.0), p.pinion)):
        at = foot + s * along
        assert np.hypot(*(at - centre)) == pytest.approx(g.tip_diameter_used / 2, rel=1e-9)


def test_ring_against_the_construction():
    p = hb.GearPair(gear(20, profile_shift=0.2), gear(60, internal=True, addendum=0.8, profile_shift=-0.2))
    assert p.working_center_distance == pytest.approx(60e-3, rel=1e-12)  # x_1 = -x_2 leave a ring where it was
    begin, end = p.path
    r_b = p.base_radii[0]
    alpha = acos(r_b / (30e-3))
    along, foot = np.array([sin(alpha), cos(alpha)]), r_b * np.array([cos(alpha), -sin(alpha)])
    assert np.hypot(*(foot + begin * along - (-60e-3, 0))) == pytest.approx(p.wheel.tip_diameter_used / 2, rel=1e-9)
    assert np.hypot(*(foot + end * along)) == pytest.approx(p.pinion.tip_diameter_used / 2, rel=1e-9)
    assert 1.4 < p.contact_ratio < 2


def test_backlash_of_a_wider_centre_distance():
    """j_bt = 2 (r_b1 + r_b2) (inv(alpha_w) - inv(alpha)): both base circles unwind that much more."""
    p = pair(beta=12, center_distance="100.2 mm")
    r, alpha = sum(p.base_radii), p.pinion.transverse_pressure_angle
    expected = 2 * r * (involute(acos(r / 0.1002)) - involute(alpha))
    assert p.backlash_as("action") == pytest.approx(expected, rel=1e-9)
    assert p.half_backlash == pytest.approx(expected / 2, rel=1e-9)
    assert pair(beta=12).half_backlash == 0.0


def test_backlash_in_all_measures():
    """At the reference circle j_bn = j_t cos(alpha_n) cos(beta)."""
    p = pair(beta=12, backlash="80 um")
    assert p.backlash_as("normal") == pytest.approx(80e-6 * cos(radians(20)) * cos(radians(12)), rel=1e-12)
    assert 2 * p.half_backlash == pytest.approx(80e-6 * cos(p.working_pressure_angle), rel=1e-12)
    for measure in ("normal", "action"):
        same = pair(beta=12, backlash=p.backlash_as(measure), backlash_measure=measure)
        assert same.half_backlash == pytest.approx(p.half_backlash, rel=1e-12)
    with pytest.raises(ValueError, match="circumferential, normal, action"):
        convert_backlash(1e-4, "normal", "tangential", 0.35, 0.0)


def test_mass_and_inertia_of_the_cylinder():
    g = gear(25, body_diameter="30 mm")
    d = (0.081 + 0.0675) / 2
    m = 7850 * pi / 4 * (d**2 - 0.03**2) * 0.02
    assert g.mass_used == pytest.approx(m, rel=1e-12)
    assert g.inertia_used == pytest.approx(m * (d**2 + 0.03**2) / 8, rel=1e-12)
    assert gear(25, mass="2 kg", inertia="1 g*m^2").inertia_used == pytest.approx(1e-3)
    p = pair()
    J, r = [x.inertia_used for x in (p.pinion, p.wheel)], p.base_radii
    assert p.equivalent_mass == pytest.approx(J[0] * J[1] / (J[1] * r[0] ** 2 + J[0] * r[1] ** 2), rel=1e-12)


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"profile_shift": 0.4},
        {"helix_angle": "20 deg"},
        {"fillet_radius": 0.2},
        {"profile_shift": -0.2, "dedendum": 1.3},
        {"teeth": 8},
        {"teeth": 10, "helix_angle": "12 deg", "fillet_radius": 0.1},
    ],
)
@pytest.mark.filterwarnings("ignore:.*undercut")
def test_outline_is_the_envelope_of_the_rack(fields):
    """Half the space at a radius is as far as any position of the rolling rack cuts it, of undercut teeth too."""
    g = gear(**{"z": 23, **{("z" if name == "teeth" else name): value for name, value in fields.items()}})
    tooth = Tooth(g)
    m, alpha, r, rho = g.module, g.pressure_angle, tooth.pitch, g.rack_fillet * g.module

    def half_width(depth):
        """Half the tooth of the rack at a depth below the pitch line; nan below its tip."""
        depth = depth + g.profile_shift * m
        straight = pi / 4 * m - depth * tan(alpha)
        below = depth - (g.dedendum * m - rho)
        corner = pi / 4 * m - g.dedendum * m * tan(alpha) - rho * (1 - sin(alpha)) / cos(alpha)
        with np.errstate(invalid="ignore"):
            rounded = corner + np.sqrt(rho**2 - below**2)
        return np.where(below < rho * sin(alpha), straight, rounded)

    psi = np.linspace(-1.0, 1.0, 800_001)
    for i in (5, 60, 120, 148, 160, 250, 400):
        R = tooth.radius[i]
        cut = psi - (R * np.sin(psi) - half_width(r - R * np.cos(psi))) / r
        assert pi / tooth.teeth - np.nanmax(cut) == pytest.approx(tooth.half_angle[i], abs=1e-7)


def test_undercut_is_a_warning_and_shortens_the_path():
    """The path ends at the involute that is left; the stiffness is that of more slender teeth."""
    with pytest.warns(
        hb.mechanics.ImplausibleInputWarning, match="12 teeth .* undercut: the involute begins at .* 33.908"
    ):
        p = pair(12, 40)
    start = sqrt(p.pinion.form_diameter**2 - p.pinion.base_diameter**2) / 2
    assert p.path[0] == start > p.engagement.tip_contact
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="undercut"):
        swapped = pair(40, 12)
    assert swapped.path == pytest.approx([p.tangent_length - s for s in p.path[::-1]], rel=1e-12)
    assert p.mesh(50.0).stiffness.mean < 0.95 * pair(17, 40).mesh(50.0).stiffness.mean


@pytest.mark.parametrize(("alpha", "beta", "z", "x"), [(20, 0, 12, 0.0), (28, 25, 8, -0.3), (16, 10, 20, -0.1)])
def test_advised_shift_and_number_of_teeth_avoid_undercut(alpha, beta, z, x):
    """With the advised shift the involute begins at the base circle. In general the end of the straight flank generates
    its begin, at the distance d/2 sin(alpha_t) - h / sin(alpha_t) from the base circle along the line of action."""
    fields = {"pressure_angle": radians(alpha), "helix_angle": radians(beta)}
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="undercut") as caught:
        gear(z, profile_shift=x, **fields)
    shift, teeth = re.search(r"at least ([\d.]+), or (\d+) teeth", str(caught[0].message)).groups()
    with warnings.catch_warnings(action="error"):
        least, _ = gear(z, profile_shift=float(shift), **fields), gear(int(teeth), profile_shift=x, **fields)
        wider = gear(z, profile_shift=float(shift) + 0.03, **fields)
    assert least.form_diameter == pytest.approx(least.base_diameter, abs=2e-8)  # the shift has three decimals
    h = 3e-3 * (1.25 - wider.rack_fillet * (1 - sin(radians(alpha))) - wider.profile_shift)
    sine = sin(wider.transverse_pressure_angle)
    position = wider.reference_diameter / 2 * sine - h / sine
    assert wider.form_diameter == pytest.approx(2 * hypot(wider.base_diameter / 2, position), rel=1e-9)
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="undercut"):
        gear(int(teeth) - 1, profile_shift=x, **fields)


def test_largest_rounding_of_the_rack():
    """The tip of the rack is one arc, whose centre is in the middle of its tooth; a pointed tip has no rounding."""
    tip = gear(30, dedendum=1.4, fillet_radius=0.6).rack_tip
    assert abs(tip.E) < 1e-15 and 0.3 * 3e-3 < tip.rho < 0.6 * 3e-3
    assert gear(60, profile_shift=1.5, addendum=0.3, dedendum=2.5).rack_fillet == 0.0


def test_published_tips_of_shifted_gears():
    """Example of a gear maker: z 12/24, x 0.6/0.36, m 3: d_a 44.840/79.400, d_f 32.100/66.660, contact ratio 1.202."""
    p = pair(12, 24, 0.6, 0.36)
    assert [g.tip_diameter_used * 1e3 for g in (p.pinion, p.wheel)] == pytest.approx([44.840, 79.400], abs=1e-3)
    assert [g.root_diameter * 1e3 for g in (p.pinion, p.wheel)] == pytest.approx([32.100, 66.660], abs=1e-3)
    assert p.contact_ratio == pytest.approx(1.202, abs=5e-4)
    assert p.pinion.tip_diameter is None and p.pinion.inertia_used < gear(12, profile_shift=0.6).inertia_used


@pytest.mark.parametrize(("z", "x", "beta"), [((40, 45), (-0.3, -0.3), 0), ((19, 33), (0.3, 0.15), 14)])
def test_default_tips_keep_the_clearance_of_the_rack(z, x, beta):
    p = pair(*z, *x, beta)
    for one, other in ((p.pinion, p.wheel), (p.wheel, p.pinion)):
        clearance = p.working_center_distance - one.tip_diameter_used / 2 - other.root_diameter / 2
        assert clearance == pytest.approx(0.25 * 3e-3, rel=1e-9)
    assert pair(20, 30, 0.2, -0.2).pinion == gear(20, profile_shift=0.2)  # without a sum of shifts nothing changes
    assert dataclasses.replace(p, pitch_error=1e-6).pinion == p.pinion
    given = hb.GearPair(gear(20, profile_shift=0.3, tip_alteration=-0.05), gear(30, profile_shift=0.3))
    assert given.pinion.tip_diameter_used == pytest.approx(60e-3 + 6e-3 * 1.25, rel=1e-12)


def test_published_internal_pair():
    """Example of a gear maker: z 16/24, m 3, x 0/0.5 counted outwards: alpha_w 31.0937 deg, a 13.1683 mm."""
    with pytest.warns(hb.mechanics.ImplausibleInputWarning):
        p = hb.GearPair(gear(16), gear(24, internal=True, profile_shift=-0.5))
    assert degrees(p.working_pressure_angle) == pytest.approx(31.0937, abs=1e-4)
    assert p.working_center_distance * 1e3 == pytest.approx(13.1683, abs=5e-5)


def overlap_with_the_ring(pinion, ring, a):
    """Largest depth of points on the flanks of a ring within the teeth of the pinion, over one pitch."""
    fillet, angle = pinion.fillet(300)
    involute_part = np.linspace(fillet[-1], pinion.tip_diameter_used / 2, 300)[1:]
    radius = np.concatenate([fillet, involute_part])
    half = np.concatenate([angle, [pinion.tooth_thickness(2 * r) / (2 * r) for r in involute_part]])
    at = np.linspace(ring.tip_diameter_used / 2, a + pinion.tip_diameter_used / 2, 200)
    flank = np.array([ring.tooth_thickness(2 * r) / (2 * r) for r in at])
    teeth, pitch, deepest = (np.arange(ring.teeth)[:, None] + 0.5) * 2 * pi / ring.teeth, 2 * pi / pinion.teeth, -1.0
    for turn in pitch * np.arange(48) / 48:
        for side in (-1, 1):
            points = at * np.exp(1j * (turn * pinion.teeth / ring.teeth + teeth + side * flank)) - a
            off = np.abs((np.angle(points) - turn + pitch / 2) % pitch - pitch / 2)
            r = np.abs(points)
            deepest = max(deepest, np.max((r * (np.interp(r, radius, half) - off))[r < radius[-1]]))
    return deepest


@pytest.mark.filterwarnings("ignore:.*undercut")
@pytest.mark.parametrize(
    ("z_1", "z_2", "deep"),
    [
        (12, 30, 0),
        (17, 25, 0),
        (17, 40, 0),
        (25, 32, 0),
        (40, 90, 0),
        (17, 23, 7.4e-5),
        (29, 36, 4.1e-6),
        (20, 23, 1e-3),
        (20, 21, 2e-3),
    ],
)
def test_default_rings_mesh_or_are_refused_for_a_true_reason(z_1, z_2, deep):
    """Outlines of all teeth, turned through a pitch, overlap if the pair is refused, and not with the advised tips."""
    pinion, ring = gear(z_1), gear(z_2, internal=True)
    a = 1.5e-3 * (z_2 - z_1)
    if not deep:
        p = hb.GearPair(pinion, ring)
        assert overlap_with_the_ring(p.pinion, p.wheel, a) < 1e-7
        return
    with pytest.raises(ValueError, match="strike the tips of the ring") as refusal:
        hb.GearPair(pinion, ring)
    shown = float(re.search(r"ring of \d+ \(diameter ([\d.]+) mm", str(refusal.value))[1])
    struck = dataclasses.replace(ring, tip_diameter=shown * 1e-3)
    assert overlap_with_the_ring(pinion, struck, a) > deep
    for name, advised in re.findall(r"the (ring|pinion) a tip_diameter of at \w+ ([\d.]+) mm", str(refusal.value)):
        cut = {"pinion": pinion, "ring": ring}
        cut[name] = dataclasses.replace(cut[name], tip_diameter=f"{advised} mm")
        p = hb.GearPair(cut["pinion"], cut["ring"])
        assert overlap_with_the_ring(p.pinion, p.wheel, a) < 1e-7 and p.contact_ratio >= 1


@pytest.mark.parametrize(
    ("which", "other"),
    [(0, {"addendum": 1.2}), (1, {"addendum": 1.2}), (0, {"internal": True, "addendum": 0.9, "tip_alteration": 0.0})],
)
def test_tips_that_touch_below_the_involute(which, other):
    """The straight flank ends at a depth h; there the line of action is at (r - h, h cot(alpha)) from the axis."""
    short, long = gear(20), gear(60, **other)
    sign, alpha, h = long.sign, radians(20), 3e-3 * (1.25 - 0.38 * (1 - sin(radians(20))))
    a, r = 30e-3 * (3 + sign), 30e-3
    tip = long.tip_diameter_used / 2
    at = brentq(lambda y: hypot(sign * a - r + y, y / tan(alpha)) - tip, 0.0, r * sin(alpha) ** 2)
    with pytest.raises(ValueError, match=f"touch the {('pinion', 'wheel')[which]} at") as refusal:
        hb.GearPair(*(short, long)[:: 1 - 2 * which])
    shown = re.search(r" at ([\d.]+) mm.* ends at ([\d.]+) mm.*of at \w+ ([\d.]+) mm", str(refusal.value)).groups()
    points = [(r - at, at), (r - h, h), (sign * a - r + h, h)]
    assert [float(d) for d in shown] == pytest.approx([2e3 * hypot(x, y / tan(alpha)) for x, y in points], abs=6e-4)
    for beyond, refused in ((-0.01, False), (0.06, True)):
        changed = dataclasses.replace(long, tip_diameter=f"{float(shown[2]) + sign * beyond} mm", tip_alteration=None)
        with pytest.raises(ValueError, match="touch") if refused else nullcontext():
            hb.GearPair(*(short, changed)[:: 1 - 2 * which])


@pytest.mark.filterwarnings("ignore:.*undercut")
@pytest.mark.parametrize(
    ("teeth", "shift", "fields", "sign"),
    [
        ((8, 40), 0.0, {"addendum": 1.1}, -1),
        ((10, 25), 0.0, {"addendum": 1.2}, 1),
        ((12, 60), 0.0, {"internal": True}, 1),
        ((12, 40), 0.1, {"internal": True, "addendum": 0.9}, 1),
    ],
)
def test_depth_of_tips_in_undercut_roots(teeth, shift, fields, sign):
    """Both gears are turned from the position in which a tooth of the pinion is in the middle of a space."""
    pinion = gear(teeth[0], profile_shift=shift)
    wheel = gear(teeth[1], **{"profile_shift": -shift, **fields})
    a, pitch, tip = 1.5e-3 * (teeth[1] + wheel.sign * teeth[0]), 2 * pi / teeth[0], wheel.tip_diameter_used
    (radius, half), edge, deepest = pinion.fillet(2000), wheel.tooth_thickness(tip) / tip, -1.0
    turn = pitch * np.linspace(-1.5, 1.5, 6001)
    for corner in [2 * pi / teeth[1] * k + side * edge for k in (-1.5, -0.5, 0.5, 1.5) for side in (-1, 1)]:
        angle = corner - wheel.sign * turn * teeth[0] / teeth[1]
        at = wheel.sign * (a - tip / 2 * np.exp(1j * angle)) * np.exp(-1j * turn)
        off = np.abs((np.angle(at) + pitch / 2) % pitch - pitch / 2)
        r = np.abs(at)
        within = (r > radius[0]) & (r < radius[-1])
        deepest = max(deepest, np.max((r * (np.interp(r, radius, half) - off))[within], initial=-1.0))
    found = Engagement(pinion, wheel, a, radians(20)).root_overlap(tip)
    assert found == pytest.approx(deepest, abs=2e-7) and np.sign(found) == sign and abs(found) > 2e-6


def test_all_default_rings():
    """Of z_1 from 17 and differences from 1: refused below 4 teeth, with advised tips up to 7, else accepted."""
    for z_1 in range(17, 61, 6):
        for difference in (1, 3, 4, 6, 8, 12, 30, 80):
            pinion, ring = gear(z_1), gear(z_1 + difference, internal=True)
            if difference >= 8:
                assert hb.GearPair(pinion, ring).contact_ratio > 1.3
                continue
            with pytest.raises(ValueError, match="a tip_diameter of at" if difference > 3 else "no tip diameter"):
                hb.GearPair(pinion, ring)


@pytest.mark.filterwarnings("ignore:.*undercut")
@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: gear(10, tip_diameter="28.3 mm"), "undercut, which leaves no involute .* of at least 0.415"),
        (lambda: gear(30, tip_diameter="96 mm", tip_alteration=-0.1), "keep one"),
        (lambda: pair(8, 40), "contact ratio is 0.913; .* less undercut of the pinion"),
        (
            lambda: hb.GearPair(gear(25, tip_alteration=0.4), gear(40)),
            r"tip_alteration = 0.4 reach 0.450 mm into the roots .* tip_diameter below 82.5 mm",
        ),
        (lambda: gear(40, rim_thickness="9 mm"), "rim_thickness and web_thickness must both be given"),
        (
            lambda: hb.GearPair(gear(16), gear(24, internal=True, profile_shift=0.5)),
            "teeth of a ring thicker; .* give the opposite sign, profile_shift = -0.5",
        ),
        (
            lambda: gear(24, internal=True, tip_diameter="66 mm"),
            r"tip diameter of 66 mm .* base diameter of 67.6579 mm: "
            r".* many catalogues count the shift of rings outwards",
        ),
        (lambda: gear(25, profile_shift=1.9), r"pointed below the tip .* of 92.4 mm \(thickness there -1.068 mm\)"),
        (lambda: gear(5, dedendum=2.0, profile_shift=-0.6), "root diameter would be -0.6 mm"),
        (lambda: gear(25.5), "whole number"),
        (lambda: gear(25, module=3), "beyond any machine.*'3 mm'"),
        (lambda: gear(25, module="3 kg"), "quantity in m"),
        (lambda: gear(25, pressure_angle=20), "'20 deg'"),
        (lambda: gear(25, tip_diameter="60 mm"), "above the root diameter"),
        (lambda: gear(25, body_diameter="70 mm"), "it is the bore"),
        (lambda: gear(25, internal="yes"), "True or False"),
        (lambda: gear(20, internal=True, tip_diameter="56 mm"), "above its base diameter"),
        (lambda: pair(backlash="80 mm"), "as large as a tooth, which is 4.71 mm thick.*'80 um'"),
        (lambda: pair(backlash=-1e-5), "not be negative"),
        (lambda: pair(backlash="80 um", backlash_measure="axial"), "circumferential, normal, action"),
        (lambda: hb.GearPair(gear(25, helix_angle="10 deg"), gear(40, helix_angle="10 deg")), "of opposite hands"),
        (
            lambda: hb.GearPair(gear(25, helix_angle="10 deg"), gear(40)),
            "a right pinion of 10 deg and a spur wheel of 0 deg .* give the wheel helix_angle = '-10 deg'",
        ),
        (
            lambda: hb.GearPair(gear(20, helix_angle="9 deg"), gear(70, helix_angle="-9 deg", internal=True)),
            "of the same hand",
        ),
        (lambda: hb.GearPair(gear(25), gear(40, module="2 mm")), "modules of 3 mm and 2 mm .* same normal module"),
        (lambda: hb.GearPair(gear(25), gear(40, helix_angle="10 deg")), "give the wheel helix_angle = '0 deg'"),
        (lambda: hb.GearPair(gear(25), gear(40, pressure_angle="25 deg")), "give both the same"),
        (lambda: hb.GearPair(gear(25), "wheel"), "wheel"),
        (lambda: hb.GearPair(gear(60, internal=True), gear(25)), "give the ring as the wheel"),
        (lambda: hb.GearPair(gear(25, tip_diameter="76 mm"), gear(40, tip_diameter="121 mm")), "ratio is 0.318"),
        (lambda: pair(center_distance="97 mm"), "overlap by"),
        (lambda: pair(center_distance="80 mm"), "base circles touch"),
        (lambda: hb.GearPair(gear(25), gear(40, tip_diameter="128 mm")), "into the roots"),
        (lambda: hb.GearPair(gear(18), gear(200, addendum=1.2)), "interference: .* touch the pinion"),
        (lambda: hb.GearPair(gear(20), gear(23, internal=True)), "strike the tips of the ring .* no tip diameter"),
        (lambda: hb.GearPair(gear(20), gear(21, internal=True)), "strike the tips of the ring"),
        (
            lambda: hb.GearPair(gear(20), gear(26, internal=True)),
            r"ring a tip_diameter of at least 74.\d+ mm or the pinion a tip_diameter of at most 64.\d+ mm",
        ),
        (
            lambda: hb.GearPair(gear(20), gear(60, internal=True, tip_alteration=0.0)),
            r"touch the pinion .* a tip_diameter of at least 174.\d+ mm",
        ),
        (
            lambda: hb.GearPair(gear(20, tip_alteration=0.4), gear(60, internal=True)),
            "reach 0.450 mm into the roots of the ring of 60; give the pinion a tip_diameter of at most 67.5 mm",
        ),
        (lambda: hb.GearPair(gear(25), gear(24, internal=True, addendum=0.6)), "no space"),
        (lambda: pair(17, 17).mesh(0.0), "torque = 0 N m must be positive"),
        (lambda: pair(17, 17).mesh("1e6 N m"), r"torque = 1e\+06 N m on the pinion would deflect .* module of 3 mm"),
        (lambda: hb.gears.tooth_mesh(pair(17, 17), "1e9 N m"), r"torque = 1e\+09 N m on the pinion would deflect"),
        (lambda: pair().mesh("200 N"), "quantity in N m"),
        (lambda: pair().mesh(200.0, linearized="chord"), "'secant' or 'tangent'"),
    ],
)
def test_impossible_gears_are_refused(make, said):
    with pytest.raises((ValueError, TypeError), match=said):
        make()


def test_numbers_of_the_example():
    p = pair(backlash="80 um")
    path = sqrt(40.5**2 - 35.2384732**2) + sqrt(63**2 - 56.3815572**2) - 97.5 * sin(radians(20))
    assert p.contact_ratio == pytest.approx(path / (pi * 3 * cos(radians(20))), rel=1e-7)
    assert degrees(p.working_pressure_angle) == pytest.approx(20, rel=1e-12)


def overlap(pair: hb.GearPair, phase: float, points: int = 60) -> float:
    """Largest overlap [module] of a pinion that is moved radially into its ring, which it enters at one phase."""
    p, w = pair.pinion, pair.wheel
    outlines = []
    for g, low, high in (
        (p, max(p.base_diameter, p.root_diameter), p.tip_diameter_used),
        (w, w.tip_diameter_used, w.root_diameter),
    ):
        d = np.linspace(low, high, points)
        half = np.array([g.tooth_thickness(one) / one for one in d])
        radii, angles = np.append(d, d[::-1]) / 2, np.append(-half, half[::-1])
        first = phase if g is p else (phase * p.teeth + pi) / w.teeth
        centres = first + 2 * pi * np.arange(g.teeth) / g.teeth
        outlines.append(radii * np.exp(1j * (centres[:, None] + angles)))
    teeth, ring = pair.working_center_distance + outlines[0], outlines[1].ravel()
    ring, found = ring[ring.real > 0], 0.0
    for tooth in teeth:
        x, y = tooth.real, tooth.imag
        for one in ring[(ring.imag > y.min()) & (ring.imag < y.max())]:
            k = np.flatnonzero((y[:-1] > one.imag) != (y[1:] > one.imag))
            reached = x[k] + (one.imag - y[k]) / (y[k + 1] - y[k]) * (x[k + 1] - x[k])
            if reached.max() > one.real:  # the tooth has passed this point of the ring
                found = max(found, min(one.imag - y.min(), y.max() - one.imag) / p.module)
    return found


@pytest.mark.parametrize(("teeth", "difference"), [(22, 14), (25, 15), (18, 13), (35, 14), (38, 13)])
def test_a_pinion_is_moved_radially_into_its_ring(teeth, difference):
    """The condition holds if no tooth of the pinion sweeps a tooth of the ring, at any phase of both gears."""
    ring = hb.gears.Gear(teeth + difference, "2 mm", "20 mm", internal=True)
    pair = hb.GearPair(hb.gears.Gear(teeth, "2 mm", "20 mm"), ring, "0 um")
    largest = max(overlap(pair, 2 * pi / teeth * k / 12) for k in range(12))
    assert largest == 0 if pair.engagement.radial_assembly else largest > 0.005
    assert pair.engagement.radial_assembly is (difference > 14 or (teeth < 25 and difference == 14))
