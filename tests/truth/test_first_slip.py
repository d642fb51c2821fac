"""First slips and the contact of radial clearances: equations, curves in two parameters and sensitivities."""

from dataclasses import replace

import numpy as np
import pytest
from machines import chain, single_mass
from scipy.optimize import brentq

import hbgear as hb
from hbgear.analysis.fold_curves import equations_of_curve
from hbgear.harmonic.bifurcations.grazing import EdgeProblem
from hbgear.harmonic.bifurcations.slip import SlipProblem

BLADE = {"load": 0.06, "k": 1.0, "limit": 0.1, "c": 0.02}


@hb.mechanics.model
def blade(load: float = 0.06, k: float = 1.0, limit: float = 0.1, c: float = 0.02) -> hb.System:
    return single_mass(hb.mechanics.Jenkins(k, limit), F=load, c=c, name="damper")


def excess(Omega, load, k, limit, c):
    """Amplitude of the blade that sticks, relative to limit / k, less one."""
    return load / np.hypot(1.0 + k - Omega**2, c * Omega) / (limit / k) - 1.0


@pytest.fixture(scope="module")
def slipping():
    return hb.trace(hb.HarmonicBalance(blade(), 9), "Omega", (0.6, 2.2))


@pytest.mark.parametrize(("name", "span"), [("limit", (0.05, 0.2)), ("k", (0.5, 2.0)), ("load", (0.03, 0.1))])
def test_curves_of_first_slip(slipping, name, span):
    curve = hb.follow(slipping, "SL1", name, span)
    assert curve.status.complete and len(curve) > 20
    assert (curve.values.min(), curve.values.max()) == pytest.approx(span)
    for value, Omega in zip(curve.values, curve.tracked["Omega"], strict=True):
        assert excess(Omega, **{**BLADE, name: value}) == pytest.approx(0, abs=1e-10)


@pytest.mark.parametrize(("label", "low", "high"), [("SL1", 1.0, 2**0.5), ("SL2", 2**0.5, 2.0)])
def test_sensitivity_of_first_slip(slipping, label, low, high):
    """Against differences of the root of the closed form, with an error of 1e-7."""
    found = hb.analysis.sensitivity(slipping[label]).of("Omega")
    assert set(found) == set(BLADE)
    for name, value in BLADE.items():
        step = 1e-4 * value
        up, down = (
            brentq(excess, low, high, tuple({**BLADE, name: value + side * step}.values()), xtol=1e-15)
            for side in (1, -1)
        )
        assert found[name] == pytest.approx((up - down) / (2 * step), rel=1e-6)


def test_equal_blades_begin_to_slip_at_one_point_that_names_both():
    dampers = [hb.Element(w, hb.mechanics.Jenkins(1.0, 0.1), name=name) for w, name in (([1, 0], "a"), ([0, 1], "b"))]
    blades = hb.System(np.eye(2), 0.02 * np.eye(2), np.eye(2), dampers, hb.Load(cosine={1: [0.06, 0.06]}))
    curve = hb.trace(hb.HarmonicBalance(blades, 9), "Omega", (0.6, 2.2), accuracy=None)
    slips = [point for point in curve.special if point.kind == "SL"]
    assert [point.note for point in slips] == ["a, b", "a, b"]
    assert excess(slips[0].parameters["Omega"], **BLADE) == pytest.approx(0, abs=1e-10)


def test_first_slip_of_a_backbone_over_the_limit():
    """The free motion slips from the displacement limit / k on."""
    curve = hb.analysis.backbone(blade(), 1, (0.01, 1.0))
    found = hb.analysis.sensitivity(curve["SL1"]).of("amplitude")
    assert found["limit"] == pytest.approx(0.5**0.5, rel=1e-8)
    assert found["k"] == pytest.approx(-0.1 * 0.5**0.5, rel=1e-8) and abs(found["load"]) < 1e-12
    slips = hb.follow(curve, "SL1", "limit", (0.05, 0.2))
    assert slips.status.complete
    np.testing.assert_allclose(slips.tracked["amplitude"], slips.values / 2**0.5, rtol=1e-11)


def test_a_curve_of_first_slip_ends_where_its_frequency_is_zero(slipping):
    """The static displacement load / (1 + k) is limit / k at limit = .03; there the curve is vertical in Omega^2."""
    curve = hb.follow(slipping, "SL1", "limit", (0.1, 0.02))
    assert curve.status is hb.Status.EVENT and "Omega leaves its range (it must be positive)" in curve.message
    assert curve.values[-1] == pytest.approx(0.03, rel=1e-6) and 0 < curve.tracked["Omega"][-1] < 1e-3


@pytest.mark.slow
def test_curves_of_first_slip_pass_corners():
    """Where two sliders begin to slip at once, each curve has a corner, and both curves cross there."""
    curve = hb.trace(hb.HarmonicBalance(corners(), 9), "Omega", (0.4, 2.4))
    assert (curve["SL3"].note, curve["SL4"].note) == ("link", "ground")
    curves = [hb.follow(curve, label, "limit", (0.03, 0.25)) for label in ("SL3", "SL4")]
    assert all(one.status is hb.Status.REACHED_END for one in curves)
    own = [one.tracked["Omega"] for one in curves]
    gap = np.interp(curves[0].values, curves[1].values, own[1]) - own[0]
    assert gap.min() < 0 < gap.max()


@hb.mechanics.model
def corners(limit: float = 0.1) -> hb.System:
    elements = [
        hb.Element([1.0, 0.0], hb.mechanics.Jenkins(1.0, limit), name="ground"),
        hb.Element([1.0, -1.0], hb.mechanics.Jenkins(0.5, 0.1), name="link"),
    ]
    load = hb.Load(cosine={1: [0.2, 0.0]})
    return hb.System(np.eye(2), 0.05 * np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], elements, load)


@hb.mechanics.model
def contact(mu: float = 0.25, gap: float = -0.6, kn: float = 2.0) -> hb.System:
    """Two masses: friction at the first one, whose limit is proportional to the force of a stop at the second."""
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    stop = hb.Element([0.0, 1.0], hb.Unilateral(k=kn, gap=gap), name="stop")
    slider = hb.Element([1.0, 0.0], hb.mechanics.ContactFriction(1.0, mu, "stop"), name="slider")
    return hb.System(np.eye(2), 0.06 * K, K, [stop, slider], hb.Load(constant=[0.0, 0.3], cosine={1: [0.12, 0.012]}))


@hb.mechanics.model
def two_sliders(first: float = 0.1, second: float = 0.1, load: float = 0.2) -> hb.System:
    """Two masses with sliders and two orders of the load; a third slider has a limit that varies over the period."""
    varying = hb.mechanics.Jenkins(0.3, 0.2, cosine=(0.05,), sine=(0.03,))
    elements = [
        hb.Element([1.0, 0.0], hb.mechanics.Jenkins(1.0, first), name="ground"),
        hb.Element([1.0, -1.0], hb.mechanics.Jenkins(0.5, second), name="link"),
        hb.Element([0.0, 1.0], varying, name="varying"),
    ]
    load_ = hb.Load(constant=[0.02, 0.0], cosine={1: [load, 0.0], 2: [0.0, 0.1]})
    return hb.System(np.eye(2), 0.05 * np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], elements, load_)


@pytest.mark.parametrize("make", [contact, two_sliders])
@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_derivative_of_the_margin(make, offset):
    """The derivative of a margin is that of differences, for any motion; with an offset the stop opens."""
    problem = hb.HarmonicBalance(make(), 6)
    random = np.random.default_rng(3)
    for _ in range(5):
        X = random.normal(size=problem.size) * 0.3
        X.reshape(problem.m, -1)[0, 0] -= offset
        for which in range(len(problem.slider_names)):
            value, rows = problem.threshold("slip", X, which, Omega=1.1)
            assert value == pytest.approx(problem.threshold_distances("slip", X, Omega=1.1)[which], abs=1e-14)
            for i in range(problem.size):
                step = 1e-6 * np.eye(problem.size)[i]
                up, down = (problem.threshold_distances("slip", X + side * step, Omega=1.1)[which] for side in (1, -1))
                assert rows.ravel()[i] == pytest.approx((up - down) / 2e-6, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(("make", "H"), [(contact, 15), (two_sliders, 9)])
def test_sensitivity_against_curves_traced_again(make, H):
    def slips(**changed):
        curve = hb.trace(hb.HarmonicBalance(make(**changed), H), "Omega", (0.5, 2.4))
        return [point for point in curve.special if point.kind == "SL"]

    here = slips()
    assert len(here) >= 2
    for name in ("mu", "gap") if make is contact else ("first", "second", "load"):
        value = here[0].parameters[name]
        up, down = slips(**{name: 1.0001 * value}), slips(**{name: 0.9999 * value})
        assert len(up) == len(down) == len(here)
        for point, one, other in zip(here, up, down, strict=True):
            expected = (one.parameters["Omega"] - other.parameters["Omega"]) / (2e-4 * value)
            assert hb.analysis.sensitivity(point).of("Omega")[name] == pytest.approx(expected, rel=1e-6, abs=1e-8)


@pytest.mark.slow
def test_a_fold_at_a_first_slip_moves_with_it():
    """dR/dX is regular on both sides of the corner, so the equations of a smooth fold do not hold there."""

    def corner(**changed):
        curve = hb.trace(hb.HarmonicBalance(chain(**changed), 16), "Omega", (1.45, 2.0), accuracy=None)
        slip = next(p for p in curve.special if p.kind == "SL" and p.note == "ground")
        fold = min(
            (p for p in curve.special if p.kind == "LP"),
            key=lambda p: abs(p.parameters["Omega"] - slip.parameters["Omega"]),
        )
        assert fold.parameters["Omega"] == pytest.approx(slip.parameters["Omega"], abs=1e-10)
        return curve, slip, fold

    curve, slip, fold = corner()
    own, other = (hb.analysis.sensitivity(point).of("Omega") for point in (fold, slip))
    for name in ("limit", "load"):
        up, down = (corner(**{name: 1.0 + side * 1e-4})[2].parameters["Omega"] for side in (1, -1))
        assert own[name] == pytest.approx((up - down) / 2e-4, rel=1e-5)
        assert own[name] == pytest.approx(other[name], rel=1e-9)
    followed = hb.follow(curve, fold.label, "limit", (0.95, 1.05))
    assert followed.status.complete and isinstance(followed.problem, SlipProblem)


@pytest.mark.slow
def test_a_followed_fold_ends_at_the_first_slip_that_it_meets():
    """Beyond it, the curve turns back at the first slip itself: fold and first slip have one frequency."""

    @hb.mechanics.model
    def hardening(limit: float = 0.05) -> hb.System:
        parts = [hb.Element([1.0], hb.Cubic(1.0)), hb.Element([1.0], hb.mechanics.Jenkins(0.1, limit), name="damper")]
        return hb.System([[1.0]], [[0.03]], [[1.0]], parts, hb.Load(cosine={1: [0.15]}))

    def response(limit: float) -> hb.Branch:
        problem = hb.HarmonicBalance(hardening(limit=limit), 7)
        return hb.trace(problem, "Omega", (0.6, 3.5), accuracy=None, cover=False)

    folds = hb.follow(response(0.05), "LP1", "limit", (0.04, 0.4), accuracy=None)
    assert not folds.status.complete and "meets the first slip of damper" in folds.message
    assert "follow the first slip" in folds.message and "more harmonics" not in folds.message
    end = folds.values[-1]
    below, above = (response(end + change) for change in (-1e-3, 2e-5))
    for curve, is_corner in ((below, False), (above, True)):
        fold = curve["LP1"].parameters["Omega"]
        slip = min(abs(p.parameters["Omega"] - fold) for p in curve.special if p.kind == "SL")
        assert (slip < 1e-8) is is_corner and (slip > 1e-4) is not is_corner


@pytest.mark.slow
def test_first_slips_at_corners_are_those_with_many_harmonics():
    """Their stated errors cover the location with 72 harmonics, though 9 harmonics shift some by 4e-3."""
    curve, finer = hb.trace(hb.HarmonicBalance(chain(), 9), "Omega", (0.5, 2.0)), hb.HarmonicBalance(chain(), 72)
    slips = [point for point in curve.special if point.kind == "SL"]
    assert len(slips) == 10
    for point in slips:
        value = point.parameters["Omega"]
        equations = SlipProblem(finer, "Omega", finer.slider_names.index(point.note))
        true = equations.located(np.append(finer.from_point(point), value), {"Omega": value}).X[-1]
        assert abs(true - value) <= point.error + 1e-9
        assert point.error < 1e-3


@pytest.mark.slow
def test_few_points_lead_to_a_corner():
    """Two close points enclose the corner; steps do not shrink towards it and grow behind it."""
    problem = hb.HarmonicBalance(chain(), 9)
    curve = hb.trace(problem, "Omega", (1.45, 1.6), stability=False, special=False, accuracy=None)
    direction = np.diff(curve.X, axis=0) / np.linalg.norm(np.diff(curve.X, axis=0), axis=1)[:, None]
    corner = curve.values[1 + np.argmin(np.sum(direction[1:] * direction[:-1], axis=1))]
    slipping = np.array(
        [problem.threshold_distances("slip", X, Omega=w)[1] > 0 for X, w in zip(curve.X, curve.values, strict=True)]
    )
    assert slipping[0] != slipping[-1] and abs(corner - 1.5745) < 1e-4
    assert np.count_nonzero(np.abs(curve.values - corner) < 3e-4) <= 6  # 12 with shrinking and growing steps


@pytest.mark.slow
def test_a_jump_map_has_the_folds_at_first_slips():
    jumps = hb.jump_map(hb.HarmonicBalance(chain(), 16), "limit", (0.99, 1.01), frequencies=(1.45, 2.0), seeds=2)
    (corner,) = (one for one in jumps.folds if isinstance(one.problem, SlipProblem))
    assert corner.status is hb.Status.REACHED_END
    (arm,) = (arm for arm in jumps.arms if arm.Omega[0] == pytest.approx(corner.tracked["Omega"][0]))
    curve = jumps.curves[0]
    fold = min((p for p in curve.special if p.kind == "LP"), key=lambda p: abs(p.parameters["Omega"] - arm.Omega[0]))
    assert fold.parameters["Omega"] == pytest.approx(arm.Omega[0], abs=1e-9)
    near = curve.values[fold.index - 2 : fold.index + 3]
    assert near.max() <= arm.Omega[0] + 1e-9 and arm.direction == 1  # the curve exists below the corner only
    assert isinstance(equations_of_curve(jumps.folds[0].problem.problem, replace(corner, problem=None)), SlipProblem)
    assert "is not in the map: its equations do not converge" in jumps.message  # the fold near Omega = 1.63


def test_newton_and_the_bracketed_root_agree(slipping, monkeypatch):
    from hbgear.harmonic.bifurcations import threshold

    def refused(*arguments):
        raise np.linalg.LinAlgError("refused")

    monkeypatch.setattr(threshold, "locate_by_newton", refused)
    again = hb.trace(hb.HarmonicBalance(blade(), 9), "Omega", (0.6, 2.2))
    for label in ("SL1", "SL2"):
        assert again[label].parameters["Omega"] == pytest.approx(slipping[label].parameters["Omega"], rel=1e-11)


# ---- radial clearance


@hb.mechanics.model
def rotor(e: float = 0.12, clearance: float = 0.5, ky: float = 1.2) -> hb.System:
    seal = hb.mechanics.VectorElement(np.eye(2), hb.mechanics.RadialClearance(3.0, clearance, 0.05), name="seal")
    unbalance = hb.Load(cosine={1: [e, 0.0]}, sine={1: [0.0, e]}, power=2)
    return hb.System(np.eye(2), 0.08 * np.eye(2), np.diag([1.0, ky]), seal, unbalance)


def longest_radius(Omega, e=0.12, ky=1.2):
    """Half the major axis of the ellipse of a rotor without contact."""
    x, y = (e * Omega**2 / (k - Omega**2 + 0.08j * Omega) for k in (1.0, ky))
    return np.sqrt((abs(x) ** 2 + abs(y) ** 2 + abs(x**2 - y**2)) / 2)


@pytest.mark.slow
def test_contact_in_a_radial_clearance_over_its_size():
    curve = hb.trace(hb.HarmonicBalance(rotor(), 9), "Omega", (0.7, 0.95))
    point = curve["GR1"]
    assert point.note == "highest of seal"
    assert longest_radius(point.parameters["Omega"]) == pytest.approx(0.5, rel=1e-10)
    found = hb.analysis.sensitivity(point).of("Omega")
    slope = (longest_radius(point.parameters["Omega"] + 1e-6) - longest_radius(point.parameters["Omega"] - 1e-6)) / 2e-6
    assert found["clearance"] == pytest.approx(1 / slope, rel=1e-6)
    assert found["e"] == pytest.approx(-0.5 / 0.12 / slope, rel=1e-6)
    contacts = hb.follow(curve, "GR1", "clearance", (0.3, 0.7))
    assert contacts.status.complete and len(contacts) > 10
    for clearance, Omega in zip(contacts.values, contacts.tracked["Omega"], strict=True):
        assert longest_radius(Omega) == pytest.approx(clearance, rel=1e-9)


@pytest.mark.parametrize("kind", [SlipProblem, EdgeProblem])
def test_jacobian_of_the_equations(kind):
    """Against differences, at motions away from the threshold."""
    model, H = (two_sliders(), 4) if kind is SlipProblem else (rotor(), 4)
    problem = hb.HarmonicBalance(model, H)
    equations = kind(problem, "Omega", 1)
    random = np.random.default_rng(5)
    U = np.append(0.4 * random.normal(size=problem.size), 1.2)
    now = equations.linearise(U, "")
    for i in range(len(U)):
        step = 1e-6 * np.eye(len(U))[i]
        up, down = (equations.linearise(U + side * step, "").R for side in (1, -1))
        np.testing.assert_allclose(now.dR_dX[-1, i], (up[-1] - down[-1]) / 2e-6, atol=1e-6)


def test_a_model_without_parameters_has_no_sensitivities():
    model = single_mass(hb.mechanics.Jenkins(1.0, 0.1), F=0.06, c=0.02, name="damper")
    curve = hb.trace(hb.HarmonicBalance(model, 5), "Omega", (1.0, 1.3))
    with pytest.raises(ValueError, match="the model has no parameters; write it as a function"):
        hb.analysis.sensitivity(curve["SL1"])
