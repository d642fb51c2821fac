"""Tooth-resolved mesh of a drawing: static equilibrium, flanks, and jump speeds against pair-by-pair sweeps."""

import dataclasses

import numpy as np
import pytest

import hbgear as hb
from hbgear.analysis.quantities.engineering_quantities import problem_along
from hbgear.gears.mesh.tooth_mesh import mirror_phase, tooth_mesh

TURN = 2 * np.pi


def drawing(relief: float = 0.0, helix: float = 0.0, teeth: tuple[int, int] = (25, 40), **options) -> hb.GearPair:
    """A pair of module 3 mm, 20 mm wide, with tip relief in um and helix angle in degrees."""
    pinion, wheel = (
        hb.gears.Gear(z, "3 mm", "20 mm", helix_angle=f"{angle} deg", tip_relief=f"{relief} um", **options)
        for z, angle in zip(teeth, (helix, -helix), strict=True)
    )
    return hb.GearPair(pinion, wheel, backlash="80 um")


@pytest.mark.parametrize(
    "pair, slices, error",
    [
        (drawing(), None, 1e-3),
        (drawing(12.0), None, 1e-3),
        (drawing(12.0, 15.0), 20, 5e-3),
        (drawing(12.0, crowning="10 um"), 24, 2.5e-2),
    ],
    ids=["spur", "relief", "helical", "crowned"],
)
def test_static_equilibrium(pair, slices, error):
    """The contacts have the transmission error of the loaded mesh under the load at which they were computed, in um."""
    mesh, cycle = tooth_mesh(pair, 200.0, slices=slices), pair.mesh(200.0)
    law, phase = mesh.contacts(pair.half_backlash), np.linspace(0.003, 0.997, 40)
    load = mesh.force / (mesh.stiffness * pair.half_backlash)
    low, high = np.full(len(phase), -2.0), np.full(len(phase), 5.0)
    for _ in range(60):
        middle = (low + high) / 2
        above = law.force(middle, np.zeros(len(phase)), TURN * phase)[0] > load
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    np.testing.assert_allclose(1e6 * pair.half_backlash * low, 1e6 * cycle.static_error(phase), rtol=0, atol=error)


def test_back_flanks_of_equal_gears_follow_half_a_pitch_later():
    """Without backlash and profile shift a tooth is as thick as its space, so that the back flanks alternate."""
    drive, back = tooth_mesh(drawing(5.0, teeth=(30, 30)), 200.0).flanks
    assert (drive.side, back.side) == (1, -1)
    assert back.stiffness.nodes[0] == pytest.approx(0.5, abs=1e-9)
    assert back.stiffness.nodes[-1] == pytest.approx(0.5 + drive.stiffness.length, abs=1e-9)


@pytest.mark.parametrize("helix", [0.0, 15.0, 30.0])
def test_mean_meshes_of_back_flanks_have_the_phase_of_the_pairs_of_teeth(helix):
    """The last slice of helical driving flanks is the first of the back flanks: mean meshes were late by the overlap
    ratio. Their tables, which figures of a wheel that drives show, were those of the driving flanks."""
    pair, phase = drawing(0.0, helix), (np.arange(300) + 0.37) / 300
    contacts = pair.model("-200 N m", 0.04).contacts.contacts
    pairs = sum(contact.stiffness(TURN * phase) for contact in contacts if contact.side < 0)
    mean = pair.model("-200 N m", 0.04, mesh="secant").stiffness(TURN * phase)
    table = pair.mesh("200 N m").mirrored(mirror_phase(pair))
    for values in (mean, table.stiffness(phase)):
        np.testing.assert_allclose(values / values.mean(), pairs / pairs.mean(), rtol=0, atol=1e-3)
    assert np.ptp(pairs) > 0.02 * pairs.mean()
    assert table.stiffness.mean == pytest.approx(pair.mesh("200 N m").stiffness.mean, rel=1e-9)


@pytest.mark.parametrize("helix", [0.2, 0.0])
def test_a_wheel_that_drives_is_the_exchanged_pair(helix):
    """Back flanks under load are those of the exchanged pair, whose pinion is the wheel, misaligned the other way: the
    forces at one displacement have the same harmonics."""
    pinion, wheel = (
        hb.gears.Gear(z, "3 mm", "20 mm", helix_angle=sign * helix, tip_relief=f"{relief} um")
        for z, relief, sign in ((25, 8, 1), (40, 5, -1))
    )
    drawn = hb.GearPair(pinion, wheel, "80 um", misalignment="4 um")
    exchanged = hb.GearPair(wheel, pinion, "80 um", misalignment="-4 um")
    models = drawn.model("-200 N m", 0.05), exchanged.model(200 * drawn.ratio, 0.05)
    assert models[0].F_m == pytest.approx(-models[1].F_m, rel=1e-6)
    N, found = 1 << 14, []
    tau = TURN * (np.arange(N) + 0.5) / N
    for model in models:
        x = np.sign(model.F_m) * 1.4
        force = np.abs(model.system().elements[0].law.force(np.full(N, x), 0 * tau, tau)[0])
        found.append(np.abs(np.fft.rfft(force))[:6] / N)
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=5e-5)
    assert found[0][1] > 0.01


def test_misaligned_flanks():
    """A slice has the gap f (1/2 + z) on the driving flank and that of its mirror image on the back flank; slices that
    are not joined with their mirror images have the same stiffness."""
    aligned = drawing()
    p = dataclasses.replace(aligned, misalignment="8 um")
    flanks = tooth_mesh(p, 200.0, slices=6).flanks
    driving, back = ([flank.gap.rows[0, 0] for flank in flanks if flank.side == side] for side in (1, -1))
    np.testing.assert_allclose(driving, 8e-6 * (np.arange(6) + 0.5) / 6, rtol=1e-9)
    np.testing.assert_allclose(back, driving[::-1], rtol=1e-9)
    for n in (5, 6):  # an odd number has a slice in the middle
        apart = tooth_mesh(dataclasses.replace(aligned, misalignment=1e-14), 200.0, slices=n)
        assert apart.stiffness == pytest.approx(tooth_mesh(aligned, 200.0, slices=n).stiffness, rel=1e-6)


def test_stiffness_where_single_contact_begins_and_ends():
    """One pair has the stiffness of the loaded mesh next to the jumps of its load; few cubics are enough."""
    pair = drawing()
    flank, cycle = tooth_mesh(pair, 200.0).flanks[0], pair.mesh(200.0).stiffness
    leaves = int(np.flatnonzero(np.diff(cycle.phase) == 0)[0])
    for u, k in ((pair.contact_ratio - 1 + 1e-6, cycle.value[leaves + 1]), (1 - 1e-6, cycle.value[-1])):
        assert float(flank.stiffness.at(np.array(u))) == pytest.approx(k, rel=2e-5)
    assert len(flank.stiffness.rows) <= 16


def test_gap_of_reliefs_of_different_lengths():
    """The gap is linear within both reliefs, which begin at the ends of the path, and zero between them."""
    pinion, wheel = (
        hb.gears.Gear(z, "3 mm", "20 mm", tip_relief=relief, tip_relief_length=length)
        for z, relief, length in ((25, 12e-6, 3e-3), (40, 7e-6, 2e-3))
    )
    pair = hb.GearPair(pinion, wheel, backlash="80 um")
    u = np.linspace(0.0, pair.contact_ratio, 1001)
    s, length = u * pair.base_pitch, pair.path[1] - pair.path[0]
    exact = 7e-6 * np.maximum(1 - s / 2e-3, 0.0) + 12e-6 * np.maximum(1 - (length - s) / 3e-3, 0.0)
    np.testing.assert_allclose(tooth_mesh(pair, 200.0).flanks[0].gap.at(u), exact, rtol=0, atol=1e-12)


def jumps(curve: hb.Branch) -> list[hb.Jump]:
    """Jumps of a curve and of the other curves of its span: a curve may end at motions without bound."""
    return sorted((jump for one in curve.curves for jump in one.jumps()), key=lambda jump: jump.value)


SWEEPS = {
    0: "-5500 +6700 -8300 +11900",
    5: "-6000 +6800 -8300 +12500",
    10: "-6600 +6900 -8400 +13100",
    12: "-6800 +7000 -8700 +13300",
    16: "-12600 +13900",
    20: "",
    25: "-13000",
}
"""Speeds of jumps [r/min] of increasing (+) and decreasing (-) sweeps in steps of 100 r/min, by relief [um].

Every pair of teeth was integrated with its own gap. The damping ratio referred to the mean of the secant stiffness.
"""


@pytest.mark.parametrize("relief", SWEEPS)
def test_jumps_over_relief(relief):
    """Each jump of the sweeps is a jump of the curve; curves may have others, of motions that sweeps pass over."""
    pair = drawing(relief)
    model = pair.model("200 N m", 0.04, mesh="teeth")
    secant = pair.mesh(200.0).stiffness.mean
    model = model.replace(zeta=0.04 * np.sqrt(secant * pair.half_backlash / model.reference[2]))
    curve = hb.trace(hb.HarmonicBalance(model, 24), "Omega", (1.7, 0.37))
    found = [(jump.direction, float(model.scales.pinion_speed(jump.value))) for jump in jumps(curve)]
    assert bool(found) == bool(SWEEPS[relief])
    for text in SWEEPS[relief].split():
        speed = float(text[1:])
        nearest = min(abs(rpm - speed) for direction, rpm in found if (direction > 0) == (text[0] == "+"))
        assert nearest < 0.01 * speed + 50


def test_damper_does_not_depend_on_the_model_of_the_mesh():
    dampers = []
    for mesh in ("teeth", "secant", "tangent"):
        model = drawing(12.0).model("200 N m", 0.04, mesh=mesh)
        omega_n, length, force, _ = model.reference
        dampers.append(2 * model.zeta * force / (length * omega_n))
        part = hb.gears.Mesh.of("pinion", "wheel", drawing(12.0), "200 N m", 0.04, mesh=mesh)
        dampers.append(2 * part.damping * np.sqrt(part.k_mean * drawing().equivalent_mass))
    np.testing.assert_allclose(dampers, dampers[0], rtol=1e-12)
    assert drawing(12.0).model("200 N m", 0.04) == drawing(12.0).model("200 N m", 0.04, mesh="teeth")


def extrema(values: np.ndarray) -> int:
    """Number of extrema of a periodic sequence whose changes exceed rounding."""
    change = np.diff(np.append(values, values[0]))
    sign = np.sign(change[np.abs(change) > 1e-7 * np.abs(values).max()])
    return int(np.sum(sign != np.roll(sign, 1)))


def test_slices_leave_no_trace_in_the_stiffness():
    """Lightly loaded helical teeth with relief: slices that came into contact at once left 46 to 70 extrema."""
    few, many = (drawing(12.0, 15.0).mesh(20.0, linearized="tangent", slices=n).stiffness for n in (24, 96))
    assert extrema(few.value[:-1]) == extrema(many.value[:-1]) == 4
    np.testing.assert_allclose(few.value, many.value, rtol=0, atol=2e-3 * many.mean)


@pytest.mark.parametrize("options", [{}, {"module": "10 mm", "face_width": "100 mm"}], ids=["3 mm", "10 mm"])
def test_error_of_the_contact_compliance_at_the_static_load(options):
    """At three times the load a pair of teeth is 3.9 to 4.9 % stiffer; at a third 3.6 to 4.5 % less stiff."""
    gear = {"module": "3 mm", "face_width": "20 mm", **options}
    pair = hb.GearPair(*(hb.gears.Gear(z, **gear) for z in (25, 40)), backlash="80 um")
    torque = 300e3 * pair.face_width * pair.base_radii[0]  # 300 N/mm
    alone = 0.5 * pair.contact_ratio  # one pair of teeth is in contact there
    small, middle, large = (float(pair.mesh(factor * torque).stiffness(alone % 1.0)) for factor in (1 / 3, 1.0, 3.0))
    assert 0.036 < 1 - small / middle < 0.045
    assert 0.039 < large / middle - 1 < 0.049


def planetary(teeth: tuple[int, int, int] = (26, 34, 94), **options) -> hb.gears.PlanetarySet:
    sun, planet = (hb.gears.Gear(z, "3 mm", "20 mm", tip_relief="10 um") for z in teeth[:2])
    ring = hb.gears.Gear(teeth[2], "3 mm", "20 mm", internal=True, tip_diameter=f"{3 * teeth[2] - 4} mm")
    pairs = hb.GearPair(sun, planet, backlash="60 um"), hb.GearPair(planet, ring, backlash="60 um")
    return hb.gears.PlanetarySet.of(*pairs, "300 N m", planets=3, **options)


def test_meshes_of_planets_are_shifted_copies():
    """Every planet has the force of the first one, later by its phase; a carrier that drives turns the path around."""
    tau, still = TURN * (np.arange(400) + 0.37) / 400, np.zeros(400)
    drawn, driven = planetary(), planetary(driver="carrier")
    assert drawn.phasing == "sequential"
    elements, lags = drawn.system().elements, list(drawn.lags.values())
    for first in (0, 3):
        for n in (1, 2):
            wanted = elements[first].law.force(np.full(400, 1.2), still, tau - lags[first + n] + lags[first])[0]
            found = elements[first + n].law.force(np.full(400, 1.2), still, tau)[0]
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9 * wanted.max())
    back = driven.system().elements[0].law.force(np.full(400, 1.2), still, -tau)[0]
    forth = elements[0].law.force(np.full(400, 1.2), still, tau)[0]
    np.testing.assert_allclose(back, forth, rtol=0, atol=1e-9 * forth.max())


def test_a_pair_of_planet_teeth_is_at_the_pitch_point_at_phase_zero():
    """The mesh of the sun as that of a train, which has the phase of the pitch point of its drawing."""
    sun, planet = (hb.gears.Gear(z, "3 mm", "20 mm", tip_relief="10 um") for z in (26, 34))
    part = hb.gears.Mesh.of("sun", "planet", hb.GearPair(sun, planet, backlash="60 um"), "100 N m")
    tau, still, d = TURN * (np.arange(100) + 0.37) / 100, np.zeros(100), np.full(100, 20e-6)
    force = part.contacts.force(d, still, tau + part.pitch_phase)[0]
    np.testing.assert_allclose(planetary().contacts_sp.force(d, still, tau)[0], force, rtol=1e-9)


def test_tables_under_load_are_the_tangent():
    """Slope and error of a loaded tooth contact analysis give the model of the tangent mesh."""
    pair = drawing(12.0)
    cycle = pair.mesh(200.0, linearized="tangent")
    given = hb.gears.MeshCycle.loaded(cycle.stiffness, cycle.static_error, cycle.force)
    models = pair.model(200.0, 0.0, cycle=given), pair.model(200.0, 0.0, mesh="tangent")
    tau = np.linspace(0.1, 6.2, 50)
    for name in ("stiffness", "error"):
        values = [getattr(model, name)(tau) for model in models]
        np.testing.assert_allclose(*values, rtol=0, atol=1e-9)


def test_relief_that_is_too_long_or_too_large():
    with pytest.raises(ValueError, match=r"relief of the 25 teeth is 20 mm long and the path of contact 14.72 mm"):
        drawing(12.0, tip_relief_length="20 mm").model(200.0, 0.04)
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match=r"contact ratio of 1.066 of 1.663.*72.2\d* to 78.5"):
        drawing(25.0).model(20.0, 0.04)


def test_without_relief_the_mean_mesh_is_the_same():
    """Every jump is one of the mean mesh.

    Motions with back-side contact differ a little, because the mean mesh has both flanks in phase.
    """
    teeth, mean = (
        jumps(hb.trace(hb.HarmonicBalance(drawing().model("200 N m", 0.04, mesh=mesh), 24), "Omega", (1.5, 0.5)))
        for mesh in ("teeth", "secant")
    )
    assert [jump.direction for jump in teeth] == [-1, -1, 1]
    for jump in teeth:
        nearest = min(abs(other.value / jump.value - 1) for other in mean if other.direction == jump.direction)
        assert nearest < 2e-3


def test_the_law_is_the_sum_of_its_contacts():
    law = drawing(12.0, 15.0).model("200 N m", 0.04).system().elements[0].law
    tau, d = np.random.default_rng(1).uniform(-9.0, 9.0, (2, 500))
    parts = [contact.force(d / 3, 0 * d, tau) for contact in law.contacts]
    for found, wanted in zip(law.force(d / 3, 0 * d, tau), np.sum(parts, axis=0), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("clearance", ["0 um", "20 um"])
def test_contacts_with_bearings(clearance):
    """Exact forces of a mesh of contacts between bearings with clearance, against samples of the same laws.

    The error of N samples of a force that jumps is of the order 1/N.
    """
    supports = (hb.gears.Support("3e8 N/m", clearance=clearance, preload="500 N"), hb.gears.Support("4e8 N/m"))
    model = drawing(12.0).model("200 N m", 0.04, "bearings", supports=supports, mesh="teeth")
    exact, sampled = (hb.HarmonicBalance(model, 10, samples=count, sampled=bool(count)) for count in (None, 60_000))
    X = 0.2 * np.random.default_rng(1).normal(size=exact.size)
    X.reshape(3, -1)[:, 0] = 1.3, 0.1, 0.1
    np.testing.assert_allclose(exact.evaluate(X, Omega=0.8)[0], sampled.evaluate(X, Omega=0.8)[0], rtol=0, atol=5e-6)


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
def test_rigid_bearings_leave_the_torsion():
    rigid = (hb.gears.Support(1e13), hb.gears.Support(1e13))
    torsion = drawing(12.0).model("200 N m", 0.04, mesh="teeth")
    held = drawing(12.0).model("200 N m", 0.04, "bearings", supports=rigid, mesh="teeth")
    points = [hb.trace(hb.HarmonicBalance(model, 12), "Omega", (0.95, 0.94))[0] for model in (torsion, held)]
    np.testing.assert_allclose(points[1].coefficients(0), points[0].coefficients(0), rtol=0, atol=1e-3)
    leading = [np.abs(point.multipliers).max() for point in points]
    assert leading[1] == pytest.approx(leading[0], abs=1e-3)


def test_a_jump_has_its_sensitivities():
    """The largest parameters of a jump of contacts; the stiffness amplitude is no parameter of them."""
    model = drawing(12.0).model("200 N m", 0.04)
    assert "eps_scale" not in model.parameters and "zeta" in model.parameters
    with pytest.raises(ValueError, match=r"eps_scale = 0.5 has no meaning for contacts"):
        model.replace(eps_scale=0.5)
    curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", (1.2, 0.62))
    found = hb.analysis.sensitivity(curve["LP1"], ["zeta"]).of()["zeta"]
    moved = hb.trace(hb.HarmonicBalance(model.replace(zeta=model.zeta + 1e-4), 8), "Omega", (1.2, 0.62))["LP1"]
    change = moved.parameters["Omega"] - curve["LP1"].parameters["Omega"]
    assert found == pytest.approx(1e4 * change, rel=0.02)


def test_a_saved_curve_has_its_contacts(tmp_path):
    model = drawing(12.0).model("200 N m", 0.04, mesh="teeth")
    curve = hb.trace(hb.HarmonicBalance(model, 12), "Omega", (1.2, 1.0))
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz")
    assert problem_along(again).model == model


@pytest.mark.parametrize(
    "options, text",
    [
        ({"mesh": "mean"}, "must be one of teeth, secant, tangent"),
        ({"mesh": "teeth", "cycle": drawing().mesh(200.0)}, "keep one"),
    ],
)
def test_refused_options(options, text):
    with pytest.raises(ValueError, match=text):
        drawing().model("200 N m", 0.04, **options)
