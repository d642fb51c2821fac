"""Tooth-resolved mesh of a drawing: static equilibrium, flanks, and jump speeds against pair-by-pair sweeps."""

import dataclasses

import numpy as np
import pytest

import hbgear as hb
from hbgear.analysis.engineering_quantities import problem_along
from hbgear.gears.mesh.tooth_mesh import tooth_mesh

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
        (drawing(12.0, crowning="10 um"), 24, 5e-3),
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


def test_misaligned_flanks():
    """A slice has the gap f (1/2 + z) on the driving flank and that of its mirror image on the back flank; slices that
    are not joined with their mirror images have the same stiffness."""
    aligned = drawing()
    p = dataclasses.replace(aligned, misalignment="8 um")
    flanks = tooth_mesh(p, 200.0, slices=6).flanks
    driving, back = ([flank.gap.rows[0, 0] for flank in flanks if flank.side == side] for side in (1, -1))
    np.testing.assert_allclose(driving, 8e-6 * (np.arange(6) + 0.5) / 6, rtol=1e-9)
    np.testing.assert_allclose(back, driving[::-1], rtol=1e-9)
    apart = tooth_mesh(dataclasses.replace(aligned, misalignment=1e-14), 200.0, slices=6)
    assert apart.stiffness == pytest.approx(tooth_mesh(aligned, 200.0, slices=6).stiffness, rel=1e-6)


def jumps(curve: hb.Branch) -> list[hb.Jump]:
    """Jumps of a curve and of the other curves of its span: a curve may end at motions without bound."""
    return sorted((jump for one in (curve, *curve.others) for jump in one.jumps()), key=lambda jump: jump.value)


SWEEPS = {
    0: "+6700 -8300 +11900",
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
    curve = hb.trace(hb.HarmonicBalance(model, 24), "Omega", (1.7, 0.4))
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
    np.testing.assert_allclose(dampers, dampers[0], rtol=1e-12)


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
