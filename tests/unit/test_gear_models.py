"""Models of a pair from its drawing: the same machine in all forms, its loads by statics, units, files."""

from math import cos, pi, radians, sin, sqrt, tan

import numpy as np
import pytest

import hbgear as hb
from hbgear.gears.mesh.mesh_excitation import contacts_in_order, lagged_series, transmission_error
from hbgear.gears.mesh.tooth_contacts import Flank, PathFunction, mesh_contacts
from hbgear.harmonic.models.frequency_units import scales
from hbgear.harmonic.models.model_registry import rebuild_model
from hbgear.mechanics.models import describe

TORQUE = 200.0
TAU = np.linspace(0, 6.2, 50)
HELD = (
    hb.gears.Support("3e8 N/m", axial="1e8 N/m", tilt="5e5 N m/rad", damping=0.03),
    hb.gears.Support("4e8 N/m", axial="2e8 N/m", tilt="9e5 N m/rad"),
)


def drawing(beta=0.0, **fields):
    gears = [hb.gears.Gear(z, "3 mm", "20 mm", helix_angle=radians(h), **fields) for z, h in ((25, beta), (40, -beta))]
    return hb.GearPair(*gears, backlash="80 um")


def test_one_degree_of_freedom_is_the_drawing():
    pair = drawing()
    model, cycle = pair.model("200 N m", "4 %", mesh="secant"), pair.mesh(TORQUE)
    k, b = cycle.stiffness.mean, pair.half_backlash
    assert model.scales.frequency == pytest.approx(sqrt(k / pair.equivalent_mass), rel=1e-5)  # cubics, not the table
    assert model.F_m * model.scales.force == pytest.approx(TORQUE / pair.base_radii[0], rel=1e-12)
    assert (model.scales.length, model.b, model.scales.teeth) == (b, 1.0, 25)
    assert model.zeta == pytest.approx(0.04, rel=1e-4)  # all gaps are closed, so that it refers to the same stiffness
    assert model.scales.pinion_speed(1.0) == pytest.approx(model.scales.frequency * 60 / (2 * pi * 25), rel=1e-12)
    assert model.scales.acceleration == pytest.approx(b * model.scales.frequency**2, rel=1e-12)
    stiffness = model.system().elements[0].law.stiffness
    x, value = cycle.stiffness.phase, cycle.stiffness.value
    inside = np.flatnonzero((x > 0) & (x < 1) & (np.diff(x, prepend=-1) > 0) & (np.diff(x, append=2) > 0))
    np.testing.assert_allclose(stiffness(2 * pi * x[inside]) * k, value[inside], rtol=1.5e-4)
    assert len(stiffness.corners) == 2  # a pair of teeth comes and goes; the rest is smooth


def test_spatial_form_of_a_spur_pair_is_the_form_with_bearings():
    """Axial and tilting motion do not couple; along the line of action both have the same three equations."""
    pair = drawing(tip_relief="10 um")
    three, twelve = (
        pair.model(TORQUE, 0.04, "bearings", supports=HELD),
        pair.model(TORQUE, 0.04, "spatial", supports=HELD),
    )
    for Omega in (0.71, 1.2):
        found = []
        for model in (three, twelve):
            problem = hb.HarmonicBalance(model, 12)
            curve = hb.trace(problem, "Omega", (Omega, Omega + 1e-3))
            found.append(curve.X[0, :25])
        np.testing.assert_allclose(found[1], found[0], atol=1e-8)


@pytest.mark.parametrize("form", ["bearings", "spatial"])
def test_rigid_bearings_leave_the_torsion(form):
    pair = drawing(15 if form == "spatial" else 0)
    stiff = (hb.gears.Support(1e13, axial=1e13, tilt=1e12),) * 2
    one, more = pair.model(TORQUE, 0.04), pair.model(TORQUE, 0.04, form, supports=stiff)
    points = [hb.trace(hb.HarmonicBalance(model, 12), "Omega", (1.2, 1.201))[0] for model in (one, more)]
    np.testing.assert_allclose(points[1].coefficients(0), points[0].coefficients(0), atol=2e-4)


@pytest.mark.parametrize("direction", [0.0, 40.0])
@pytest.mark.parametrize("beta", [15.0, -15.0])
def test_static_forces_of_a_helical_pair(beta, direction):
    """Tangential T/r_w, radial and axial component by the angles of the standard; the pinion is pushed away and,
    right-handed and driving from x to y, along its own thread."""
    pair = drawing(beta)
    model = pair.model(TORQUE, 0.04, "spatial", supports=HELD, direction=f"{direction} deg")
    w, F = model.mesh_vector(), TORQUE / pair.base_radii[0]
    on_pinion, on_wheel = -F * w[:3], -F * w[6:9]
    phi, tangential = radians(direction), TORQUE / pair.working_radii[0]
    ahead, across = np.array([cos(phi), sin(phi), 0]), np.array([-sin(phi), cos(phi), 0])
    assert on_pinion @ across == pytest.approx(-tangential, rel=1e-9)  # against its rotation
    assert on_pinion @ ahead == pytest.approx(-tangential * tan(pair.working_pressure_angle), rel=1e-9)
    assert on_pinion[2] == pytest.approx(tangential * tan(radians(beta)), rel=1e-9)  # V0 pair: working helix is beta
    np.testing.assert_allclose(on_wheel, -on_pinion, rtol=1e-12)
    moment = np.cross(pair.working_radii[0] * ahead, on_pinion)
    np.testing.assert_allclose(-F * w[3:6], moment, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(model.torques()[[5, 11]], [TORQUE, TORQUE * 1.6], rtol=1e-9)
    assert -F * w[5] == pytest.approx(-TORQUE, rel=1e-12)


def test_ring_turns_the_same_way():
    ring = hb.gears.Gear(60, "3 mm", "20 mm", internal=True, addendum=0.8, profile_shift=-0.2)
    pair = hb.GearPair(hb.gears.Gear(20, "3 mm", "20 mm", profile_shift=0.2), ring, backlash="80 um")
    model = pair.model(TORQUE, 0.04, "spatial", supports=HELD)
    assert model.internal
    np.testing.assert_allclose(model.torques()[[5, 11]], [TORQUE, -TORQUE * 3], rtol=1e-9)


def test_lags_of_amplitudes():
    series = lagged_series((0.3, 0.1), (0.4, -1.0))
    np.testing.assert_allclose(series(TAU), 0.3 * np.cos(TAU - 0.4) + 0.1 * np.cos(2 * TAU + 1.0), atol=1e-15)
    late = transmission_error((0.2,), "sin", 2.0, (0.7,))
    np.testing.assert_allclose(late(TAU), 0.4 * np.sin(TAU - 0.7), atol=1e-15)
    pair = hb.SpurPair(eps=(0.2,), eps_lag=(0.5,), e=(0.1,), e_lag=(0.3,))
    law = pair.system().elements[0].law
    np.testing.assert_allclose(law.stiffness(TAU), 1 - 0.2 * np.cos(TAU - 0.5), atol=1e-15)
    np.testing.assert_allclose(pair.transmission_error(TAU), 0.1 * np.cos(TAU - 0.3), atol=1e-15)


def two_meshes():
    """Contacts with an error of one pair of teeth in two."""
    stiffness, gap = (PathFunction.linear([0.0, 0.9, 1.6], values) for values in ([0.4, 0.7, 0.5], [0.1, 0.0, 0.2]))
    return mesh_contacts([Flank(1, stiffness, gap, errors={1: 0.3}, lag=0.2)], 2)


@pytest.mark.parametrize(("order", "lag"), [(2, 0.0), (2, 0.5), (6, 0.0), (6, 0.5)])
def test_contacts_in_an_order(order, lag):
    """The mesh has the phase order tau - lag; a period of the contacts is that of two meshes."""
    d, still, base = np.full(50, 0.8), np.zeros(50), two_meshes()
    found = contacts_in_order(base, order, lag).force(d, still, TAU)[0]
    np.testing.assert_allclose(found, base.force(d, still, (order * TAU - lag) / 2)[0], atol=1e-12)


def test_contacts_leave_the_other_parameters():
    pair = hb.SpurPair(eps=(), contacts=two_meshes(), mesh_order=2)
    assert pair.parameters.keys() == hb.SpurPair().parameters.keys() - {"eps_scale"}


def test_a_fluctuation_acts_in_its_direction():
    """Its mean adds to the constant load; the scale multiplies all of it."""
    wave = hb.mechanics.Series(0.2, cosine=(0.0, 0.3), sine=(0.5, -0.4))
    pair = hb.SpurPair(fluctuation=wave, fluctuation_scale=1.5, mesh_order=2)
    terms = pair.fluctuating_load([1.0, -2.0], [2.0, 3.0]).complex(2)
    found = sum(np.outer(terms[k], np.exp(1j * k * TAU)).real for k in terms)
    np.testing.assert_allclose(found, [1 + 3 * wave(TAU), -2 + 4.5 * wave(TAU)], atol=1e-12)
    assert 2 * np.array(pair.default_span) == pytest.approx(hb.SpurPair.default_span)  # Omega is half as large


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"eps": (0.1,), "contacts": two_meshes(), "mesh_order": 2}, "contacts and a mesh stiffness are both given"),
        ({"stiffness": hb.mechanics.Series(1.0), "contacts": two_meshes(), "mesh_order": 2}, "both given"),
        ({"eps": (0.1,), "eps_lag": (0.1, 0.2)}, "one lag for each"),
        ({"reference": (1.0, 2.0)}, "omega_n"),
        ({"reference": (1.0, -2.0, 3.0, 4.0)}, "all positive"),
        ({"e_lag": ("a",)}, "e_lag"),
    ],
)
@pytest.mark.parametrize("cls", [hb.SpurPair, hb.gears.GearRotorBearing])
def test_lags_and_units_that_do_not_fit(cls, fields, said):
    with pytest.raises(ValueError, match=said):
        cls(**fields)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"form": "planar"}, "torsion, bearings, spatial"),
        ({"form": "bearings"}, "supports="),
        ({"form": "spatial", "supports": (hb.gears.Support(1e8),) * 2}, "needs the key tilt in both supports"),
        ({"form": "spatial", "supports": (hb.gears.Support(1e8, tilt=1e5, clearance=1e-5),) * 2}, "no clearance"),
        ({"supports": HELD}, "has no supports"),
        ({"damping": "4 mm"}, "damping"),
        ({"damping": 4}, "damping = 4 is beyond"),
        ({"torque": "200 N"}, "torque"),
    ],
)
def test_invalid_models(options, said):
    with pytest.raises(ValueError, match=said):
        drawing().model(**{"torque": TORQUE, "damping": 0.04, **options})


def test_no_backlash_no_model():
    pair = hb.GearPair(*(hb.gears.Gear(z, "3 mm", "20 mm") for z in (25, 40)))
    with pytest.raises(ValueError, match="no backlash"):
        pair.model(TORQUE, 0.04)


def test_models_are_written_and_read():
    for form in ("torsion", "bearings", "spatial"):
        model = drawing().model(TORQUE, 0.04, form, supports=None if form == "torsion" else HELD)
        again = rebuild_model(describe(model))
        assert again == model and scales(again, {}) == scales(model, {}) != {}
    assert hb.SpurPair().scales is None and scales(hb.SpurPair(), {}) == {}


def test_dynamic_factor_is_that_of_the_force():
    """Against the force rows of the balance, whose mean is F_m and whose sum of many harmonics is the force."""
    model = drawing().model(TORQUE, 0.04)
    curve = hb.trace(hb.HarmonicBalance(model, 48), "Omega", (1.25, 1.0))
    point = curve[len(curve) // 2]
    row = hb.HarmonicBalance(model, 48).force_rows(point.X, **point.parameters)[0]
    assert row[0] == pytest.approx(model.F_m, rel=1e-8)
    theta = np.linspace(0, 2 * pi, 5000)
    k = np.arange(1, 49)
    force = row[0] + row[1::2] @ np.cos(np.outer(k, theta)) + row[2::2] @ np.sin(np.outer(k, theta))
    assert hb.analysis.dynamic_factor(model, point) == pytest.approx(force.max() / model.F_m, rel=0.02)
    assert hb.analysis.dynamic_factor(model, point, "gap") == hb.analysis.dynamic_factor(model, point)
    with pytest.raises((ValueError, IndexError, KeyError)):
        hb.analysis.dynamic_factor(model, point, "bearing")


# ---- tables


def test_table_of_a_cycle_goes_through_a_file(tmp_path):
    cycle = drawing(tip_relief="10 um").mesh(TORQUE)
    path = tmp_path / "cycle.csv"
    cycle.export(path)
    k, e = hb.io.read_mesh_table(path), hb.io.read_mesh_table(path, column=2, unit="m")
    np.testing.assert_allclose(k.function().row(20), cycle.stiffness.function().row(20), rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(e.function().row(20), cycle.error.function().row(20), rtol=1e-9, atol=1e-15)
    again = drawing().model(TORQUE, 0.04, cycle=hb.gears.MeshCycle(k, e))
    np.testing.assert_allclose(again.eps, drawing().model(TORQUE, 0.04, cycle=cycle).eps, atol=1e-9)


def test_units_and_phases_of_a_table(tmp_path):
    path = tmp_path / "k.csv"
    path.write_text(
        "# of another program\nphase [deg], stiffness [N/um]\n"
        + "".join(f"{a}, {400 + 50 * cos(radians(a))}\n" for a in range(0, 360, 2))
    )
    table = hb.io.read_mesh_table(path)
    assert table.mean == pytest.approx(4e8, rel=1e-12)
    assert table.function().row(1)[1] == pytest.approx(5e7, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("phase [cycle], k [N/m]\n0, 1e8\n0.5, 2e8\n1, 1.5e8\n", "not periodic: the first is 1e.08, the last"),
        ("phase [cycle], k [N/m]\n0, 1e8\n0.2, 2e8\n0.4, 1e8\n", "phases span 0.4 mesh cycles"),
        ("phase [cycle], k [N/m]\n0, 1e8\n0.9, 2e8\n2, 1e8\n", "phases span 2 mesh cycles"),
        ("phase [cycle], k [N/m]\n0, 1e8\n0.6, 2e8\n0.5, 1e8\n1, 1e8\n", "must ascend; line 4"),
        ("phase, k [N/m]\n0, 1\n", "has no unit; write it as in .phase .cycle"),
        ("phase [cycle], k [kg]\n0, 1\n.5, 1\n1, 1\n", "N/m"),
        ("phase [min], k [N/m]\n0, 1\n.5, 1\n1, 1\n", "accepted are cycle, deg, rad"),
        ("phase [cycle], k [N/m]\n0, 1e8\n0.5, x\n1, 1e8\n", "line 3: .x. in the column"),
        ("phase [cycle], k [N/m]\n0, 1e8\n", "too few"),
        ("phase [cycle]\n0\n1\n", "no column 1"),
        ("", "no rows of numbers"),
        ("phase [cycle], k [N/m]\n0, nan\n0.5, 1\n1, 1\n", "finite"),
    ],
)
def test_tables_that_are_none(tmp_path, text, said):
    path = tmp_path / "k.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        hb.io.read_mesh_table(path)


def test_a_table_that_is_not_there(tmp_path):
    with pytest.raises(ValueError, match=r"none.csv' cannot be read as a table of a mesh cycle: No such file or"):
        hb.io.read_mesh_table(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="it is not text"):
        hb.io.read_mesh_table(tmp_path / "b.csv")


@pytest.mark.parametrize("fields", [{"stiffness": 1e8}, {"error": 0.0}, {"force": "much"}, {"force": -1.0}])
def test_invalid_mesh_cycles(fields):
    good = {"stiffness": hb.gears.MeshTable([0, 1], [1e8, 1e8]), "error": hb.gears.MeshTable([0, 1], [0, 0])}
    with pytest.raises((ValueError, TypeError), match="MeshCycle"):
        hb.gears.MeshCycle(**{**good, **fields})
    with pytest.raises((ValueError, TypeError), match="cycle"):
        drawing().model(TORQUE, 0.04, cycle=1e8)


def test_stiffness_must_be_positive():
    with pytest.raises(ValueError, match=r"-1e\+08 N/m at 0.5 of the cycle; it must be positive"):
        hb.gears.MeshCycle(hb.gears.MeshTable([0, 0.5, 1], [1e8, -1e8, 1e8]), hb.gears.MeshTable([0, 1], [0, 0]))


def test_tables_as_functions_of_the_phase():
    """A square wave in closed form; straight pieces at any place; few cubics within a tolerance; jumps stay."""
    square = hb.gears.MeshTable([0, 0.25, 0.25, 0.75, 0.75, 1], [1, 1, -1, -1, 1, 1]).function()
    np.testing.assert_allclose(square.row(3)[1::2], [4 / pi, 0, -4 / (3 * pi)], atol=1e-14)
    odd = hb.gears.MeshTable([0, 0.3, 0.3, 0.6, 1], [1, 2, 5, 0, 4])
    x = np.linspace(0, 1, 77, endpoint=False)
    np.testing.assert_allclose(odd.function()(2 * pi * x), odd(x), atol=1e-12)
    at_begin = hb.gears.MeshTable([0, 0, 0.5, 1, 1], [7, 1, 2, 3, 7])  # a jump that is there twice, at both ends
    np.testing.assert_allclose(at_begin.function()(2 * pi * x), np.interp(x, [0, 0.5, 1], [1, 2, 3]), atol=1e-12)
    x = np.concatenate([np.linspace(0, 0.4, 80), np.linspace(0.4, 1, 120)])
    bent = hb.gears.MeshTable(x, np.where(np.arange(200) < 80, np.sin(5 * x), 3 - np.exp(x)))
    for tolerance, most in ((1e-2, 4), (1e-5, 14)):
        found = bent.function(tolerance)
        away = np.abs(found(2 * pi * x) - bent.value)[np.append(np.diff(x) > 0, False)]
        assert away.max() <= tolerance and len(found.phases) <= most
        assert sum(np.abs(found.jumps[:, 0]) > 0.1) == 2
    assert hb.gears.MeshTable([0, 1], [2.0, 2.0]).function() == hb.mechanics.Series(2.0)


def test_static_error_of_tables_with_jumps():
    """Jumps within the cycle and at its ends, of one table or of both, remain: F/k is 10 um, then 20 um."""
    k = hb.gears.MeshTable([0, 0.4, 0.4, 1], [2e8, 2e8, 1e8, 1e8])
    e = hb.gears.MeshTable([0, 0, 0.4, 0.4, 0.7, 1, 1], [7e-6, 1e-6, 3e-6, 5e-6, 5e-6, 2e-6, 7e-6])
    found = hb.gears.MeshCycle(k, e, 2e3).static_error
    np.testing.assert_array_equal(found.phase, [0, 0, 0.4, 0.4, 0.7, 1, 1])
    np.testing.assert_allclose(found.value, np.array([17, 11, 13, 25, 25, 22, 27]) * 1e-6, rtol=1e-12)
    again = hb.gears.MeshCycle.loaded(k, found, 2e3)
    np.testing.assert_allclose(again.error.value, e.value, rtol=1e-9)


def test_an_error_that_jumps_is_smoothed():
    """Pairs of teeth that come with a pitch error: the damper of the mesh has no force for a jump."""
    pinion, wheel = (hb.gears.Gear(z, "3 mm", "20 mm") for z in (25, 40))
    pair = hb.GearPair(pinion, wheel, backlash="80 um", pitch_error="5 um")
    function = pair.mesh(TORQUE).error.function()
    model = pair.model(TORQUE, 0.04, mesh="secant")
    assert not function.continuous
    np.testing.assert_allclose(model.error.row(24) * pair.half_backlash, function.row(24), atol=1e-8)


@pytest.mark.parametrize(
    ("phase", "value"),
    [
        ([0, 0.5], [1, 1]),
        ([0.1, 1], [1, 1]),
        ([0, 0.6, 0.5, 1], [1] * 4),
        ([0, 0.5, 0.5, 0.5, 1], [1] * 5),
        ([0, 1], [1, np.inf]),
    ],
)
def test_tables_that_are_no_cycle(phase, value):
    with pytest.raises(ValueError, match="Table"):
        hb.gears.MeshTable(phase, value)
