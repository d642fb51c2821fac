"""Derivatives of located points against central differences of points located with changed parameters."""

import math
import pickle

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.analysis.parameter_sensitivity.point_sensitivity import (
    PointSensitivity,
    parameter_names,
    problem_and_parameters,
    with_cache_size,
)
from hbgear.continuation.solvers.newton import refine, solve
from hbgear.harmonic.bifurcations.extremum import EXTREMA
from hbgear.io.branches.npz import read

CLOSE = 1e-6  # relative tolerance of a derivative
LEAST = 1e-8  # absolute tolerance, relative to Omega per unit of the parameter: rounding of the differences


def located(problem, equations, U, here):
    """Return the unknowns of the special point, solved with the parameters ``here``."""
    based = equations.with_borders_at(U, here)
    return refine(based, solve(based, U, here), here).X


def differences(point, parameters=None):
    """Return names, central differences of (X, p) with steps h and 2h (one-sided at a range end), and the equations."""
    problem, here, parameter = problem_and_parameters(point)
    names = parameter_names(problem, here, parameter, parameters)
    at = PointSensitivity(with_cache_size(problem, point, 8), point, here, parameter, names)
    equations = at.equations()
    first = located(at.problem, equations, np.append(at.X, here[parameter]), here)
    out = []
    for name in names:
        h = 2e-5 * at.problem.unit_of(name, here[name])
        moved = {}
        for k in (-2, -1, 1, 2):
            try:
                moved[k] = located(at.problem, equations, first, {**here, name: here[name] + k * h}) - first
            except ValueError:
                continue
        if -1 in moved:
            out.append((8 * (moved[1] - moved[-1]) - (moved[2] - moved[-2])) / (12 * h))
        else:
            out.append((4 * moved[1] - moved[2]) / (2 * h))
    return names, np.array(out), at


def check(point, parameters=None):
    found = hb.analysis.sensitivity(point, parameters)
    names, expected, at = differences(point, parameters)
    assert found.parameters == names
    unit = np.array([at.problem.unit_of(name, at.parameters[name]) for name in names])
    p, size = expected[:, -1], max(abs(point.parameters[at.parameter]), 1e-3)
    error = np.abs(found.slopes[0] - p)
    bad = error > CLOSE * np.abs(p) + LEAST * size / unit
    failed = [(n, a, b) for n, a, b, wrong in zip(names, found.slopes[0], p, bad, strict=True) if wrong]
    assert not failed, failed
    # slope of the amplitude: its directional derivative along the differences of the unknowns
    measure = found.quantities[-2] if found.quantities[-1].endswith(" m") else found.quantities[-1]
    layout, X = point.layout, point.X
    for name, dX, slope, one in zip(names, expected[:, :-1], found.of(measure).values(), unit, strict=True):
        length = np.linalg.norm(dX)
        h = 1e-5 / length if length else 1.0
        rate = float(layout.measure(measure, X + h * dX) - layout.measure(measure, X - h * dX)) / (2 * h)
        assert slope == pytest.approx(rate, rel=1e-5, abs=1e-7 / one), (name, measure)
    return found


@pytest.fixture(scope="module")
def spur():
    pair = hb.SpurPair(e=(0.1, 0.02), eps=(0.1,), reference=(38000.0, 37.6e-6, 15000.0, 25.0))
    return hb.trace(hb.HarmonicBalance(pair, 8), "Omega", (2.6, 0.4))


def test_every_point_of_a_spur_pair(spur):
    kinds = {point.kind for point in spur.special}
    assert {"LP", "PD", "GR"} <= kinds
    for kind in kinds & {"LP", "PD", "GR"}:
        found = check(next(point for point in spur.special if point.kind == kind))
        assert {"eps[0]", "e[1]", "reference[0]", "b"} <= set(found.parameters)
        assert found.quantities[:3] == ("Omega", "mesh Hz", "pinion r/min")


@pytest.mark.parametrize("measure", ["rms", "H1", "pp2", "max", "mean"])
def test_peaks(spur, measure):
    tops = hb.analysis.peaks(spur, measure, accuracy=None)
    top = tops[0] if measure == "mean" else max(tops, key=lambda point: point.amplitude(measure))
    found = check(top)
    assert found.quantities[-2] == measure
    if measure in EXTREMA:  # against differences of the largest peaks of two traced curves
        for name in ("zeta", "e[0]"):
            h = 1e-3 * found.values[found.parameters.index(name)]
            sizes = []
            for side in (1, -1):
                model = spur.problem.model.replace(**{name: spur.problem.model.entries.get(name, 0.05) + side * h})
                span = top.parameters["Omega"] + np.array([0.03, -0.03])
                curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", tuple(span), top.X, special=False)
                peaks = hb.analysis.peaks(curve, measure, accuracy=None)
                sizes.append(max(point.amplitude(measure) for point in peaks))
            assert found.of(measure)[name] == pytest.approx((sizes[0] - sizes[1]) / (2 * h), rel=1e-4)


MODELS = {
    "duffing": (hb.Duffing(), (0.8, 1.6)),
    "rotor": (hb.gears.GearRotorBearing(), None),
    "helical": (hb.gears.HelicalPair(), None),
    "double": (hb.gears.DoubleHelicalPair(zeta=0.05), (1.0, 0.8)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_every_parameter_of_every_model(name):
    model, span = MODELS[name]
    curve = hb.trace(hb.HarmonicBalance(model, 5), "Omega", span or model.default_span)

    for kind in dict.fromkeys(point.kind for point in curve.special):
        if kind in ("LP", "PD", "GR"):
            print(kind)
            found = check(next(point for point in curve.special if point.kind == kind))
            assert set(found.parameters) == set(model.parameters) | set(model.entries)


def moved_point(model, kind, place, name, h, harmonics=5):
    """Return the special point of a kind nearest to ``place`` on a curve traced with a parameter changed by h."""
    own = (model.parameters | model.entries)[name]
    problem = hb.HarmonicBalance(model.replace(**{name: own + h}), harmonics)
    curve = hb.trace(problem, "Omega", (1.0, 0.8), accuracy=None)
    points = [point for point in curve.special if point.kind == kind]
    return min(points, key=lambda point: abs(point.parameters["Omega"] - place))


@pytest.mark.slow
def test_neimark_sacker_point():
    """Derivatives agree to 2e-5 with differences of points bracketed on two traced curves to about 1e-10 of Omega."""
    model = hb.gears.DoubleHelicalPair(zeta=0.05)
    curve = hb.trace(hb.HarmonicBalance(model, 5), "Omega", (1.0, 0.8), accuracy=None)
    point = curve["NS1"]
    place = point.parameters["Omega"]
    found = hb.analysis.sensitivity(point)
    for name in ("zeta", "eps[0]", "k_mean"):
        h = 1e-4 * found.values[found.parameters.index(name)]
        up, down = (moved_point(model, "NS", place, name, side * h) for side in (1, -1))
        for quantity, of in (("Omega", lambda p: p.parameters["Omega"]), ("rms", lambda p: p.amplitude("rms"))):
            assert found.of(quantity)[name] == pytest.approx((of(up) - of(down)) / (2 * h), rel=2e-5)


def test_grazing_at_two_breakpoints_at_once():
    """A force that is never tensile has a kink where contact begins. The response up to contact is linear:

    F = gap |1 - Omega^2 + 2 i zeta Omega|, so that dOmega/dF = 1 / F' and dOmega/dgap = -F / (gap F')
    """

    @hb.mechanics.model
    def stops(F: float = 0.3, gap: float = 1.0, zeta: float = 0.05) -> hb.System:
        law = hb.mechanics.ClippedKelvinVoigt(2.0, 0.4, gap, 2)
        return single_mass(law, F=F, c=2 * zeta)

    curve = hb.trace(hb.HarmonicBalance(stops(), 6), "Omega", (2.0, 1.05), stability=False)
    point = curve["GR1"]
    w, zeta, gap = point.parameters["Omega"], 0.05, 1.0
    size = math.hypot(1 - w**2, 2 * zeta * w)
    slope = gap * (2 * w * (w**2 - 1) + 4 * zeta**2 * w) / size  # dF/dOmega
    assert gap * size == pytest.approx(0.3, rel=1e-12)
    found = hb.analysis.sensitivity(point).of("Omega")
    assert found["F"] == pytest.approx(1 / slope, rel=1e-9)
    assert found["gap"] == pytest.approx(-size / slope, rel=1e-9)
    assert found["zeta"] == pytest.approx(-gap * 4 * zeta * w**2 / size / slope, rel=1e-9)


@pytest.mark.slow
def test_neimark_sacker_points_between_grazing_and_a_fold():
    """Two points within 2e-4 of a grazing contact and 4e-6 of a fold, where dX/dOmega is large, of a contact with a
    damper; against points of curves traced with other parameters."""

    @hb.mechanics.model
    def chain(F: float = 0.094, c: float = 1.0) -> hb.System:
        M = np.diag([1.294, 0.952, 1.195])
        C = np.array([[0.0419, -0.0108, 0.0], [-0.0108, 0.0444, -0.0186], [0.0, -0.0186, 0.0373]])
        K = np.array([[1.599, -0.805, 0.0], [-0.805, 2.183, -1.378], [0.0, -1.378, 1.378]])
        law = hb.mechanics.KelvinVoigt(1.842, 0.1234, 0.4117, 2)
        return hb.System(M, c * C, K, [hb.Element([0.0, 0.0, 1.0], law)], hb.Load(cosine={1: [F, 0.0, 0.0]}))

    def points(**changed):
        curve = hb.trace(hb.HarmonicBalance(chain(**changed), 12), "Omega", (1.14, 1.125), accuracy=None)
        return [point for point in curve.special if point.kind == "NS"]

    one = points()
    assert len(one) >= 2
    h = 3e-4
    for name, value in (("F", 0.094), ("c", 1.0)):
        up, down = points(**{name: value * (1 + h)}), points(**{name: value * (1 - h)})
        for k in (0, 1):
            expected = (up[k].parameters["Omega"] - down[k].parameters["Omega"]) / (2 * h * value)
            assert hb.analysis.sensitivity(one[k]).of("Omega")[name] == pytest.approx(expected, rel=2e-4), (name, k)


def test_scatter_of_a_jump_at_a_neimark_sacker_point():
    """Each draw is the point solved with its parameters; the first one agrees with a traced curve to 1e-7."""
    problem = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 5)
    curve = hb.trace(problem, "Omega", (1.0, 0.8), accuracy=None)
    one = next(
        one for one in hb.design.jump_tolerance(curve, {"zeta": 2e-4}, draws=5, unit="Omega") if one.label == "NS1"
    )
    xi = np.random.default_rng(0).normal(size=(5, 1))[:, 0]
    assert one.lost == 0 and one.first > 1e-4
    np.testing.assert_allclose(one.draws - one.value, xi * one.effects["zeta"], atol=0.2 * one.first)
    place = moved_point(problem.model, "NS", one.value, "zeta", 2e-4 * xi[0])
    assert one.draws[0] == pytest.approx(place.parameters["Omega"], rel=1e-7)


@pytest.mark.slow
def test_draws_of_a_jump_that_occurs_at_a_point_of_another_kind():
    """Each draw is the jump of a traced curve: at the fold LP1 above zeta = 0.0507, else at the point NS1."""
    problem = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 5)
    curve = hb.trace(problem, "Omega", (1.0, 0.8), accuracy=None)
    found = hb.design.jump_tolerance(curve, {"zeta": 0.003}, draws=12, unit="Omega")
    kinds = set()
    for i, x in enumerate(np.random.default_rng(0).normal(size=12)):
        drawn = hb.trace(problem, "Omega", (1.0, 0.8), at={"zeta": 0.05 + 0.003 * x}, accuracy=None).jumps()
        kinds |= {jump.label for jump in drawn if jump.direction < 0}
        for one in found:
            (expected,) = [jump.value for jump in drawn if jump.direction == one.direction]
            assert one.draws[i] == pytest.approx(expected, rel=1e-5)
    assert kinds == {"NS1", "LP1"} and [one.lost for one in found] == [0, 0]


def test_draws_outside_the_range_of_a_parameter_are_left_out_with_a_warning():
    """They are no draws without the jump: its frequency exists for any admissible damping below the cusp."""
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(zeta=0.02), 3), "Omega", (0.8, 2.0), accuracy=None)
    negative = int((0.02 + 0.01 * np.random.default_rng(0).normal(size=60) < 0).sum())
    with pytest.warns(UserWarning, match=rf"{negative} of 60 draws are left out, because zeta must not be negative"):
        found = hb.design.jump_tolerance(curve, {"zeta": 0.01}, draws=60)
    falling = next(one for one in found if one.direction < 0)
    assert negative > 0 and falling.lost == 0 and len(falling.draws) == 60 - negative


def test_branch_point_and_its_imperfections():
    """A mean load separates the curves at a symmetry-breaking branch point: derivatives with respect to it are nan."""

    @hb.mechanics.model()
    def symmetric(zeta: float = 0.1, k3: float = 1.0, F: float = 10.0, mean: float = 0.0) -> hb.System:
        return single_mass(hb.Cubic(k3), F=F, mean=mean, c=2 * zeta)

    model = symmetric()
    curve = hb.trace(hb.HarmonicBalance(model, 9), "Omega", (1.5, 1.8), stability=False)
    found = hb.analysis.sensitivity(curve["BP1"])
    assert math.isnan(found.of("Omega")["mean"]) and math.isnan(found.of("rms")["mean"])
    for name in ("zeta", "k3", "F"):
        h = 1e-4 * found.values[found.parameters.index(name)]
        sides = []
        for side in (1, -1):
            other = hb.HarmonicBalance(model.replace(**{name: getattr(model, name) + side * h}), 9)
            sides.append(hb.trace(other, "Omega", (1.5, 1.8), stability=False, accuracy=None)["BP1"])
        for quantity, of in (("Omega", lambda p: p.parameters["Omega"]), ("rms", lambda p: p.amplitude("rms"))):
            rate = (of(sides[0]) - of(sides[1])) / (2 * h)
            assert found.of(quantity)[name] == pytest.approx(rate, rel=1e-5), (name, quantity)


@pytest.mark.slow
def test_critical_value():
    model = hb.Duffing()  # with 8 harmonics the cusp is converged: more harmonics do not change it
    cusp = hb.analysis.critical_parameter(model, "zeta", frequencies=(0.9, 1.4), harmonics=8)
    found = hb.analysis.sensitivity(cusp)
    assert found.quantities[:2] == ("zeta", "Omega") and set(found.parameters) == {"k3", "F"}
    for name in found.parameters:
        h = 1e-3 * getattr(model, name)
        up, down = (
            hb.analysis.critical_parameter(
                model.replace(**{name: getattr(model, name) + side * h}), "zeta", frequencies=(0.9, 1.4), harmonics=8
            )
            for side in (1, -1)
        )
        assert found.of("zeta")[name] == pytest.approx((up.value - down.value) / (2 * h), rel=1e-5)
        assert found.of("Omega")[name] == pytest.approx((up.Omega - down.Omega) / (2 * h), rel=1e-4)


def test_jump_with_both_of_its_motions(spur):
    model = spur.problem.model
    jump = next(jump for jump in spur.jumps() if jump.after is not None and jump.label.startswith("LP"))
    found = hb.analysis.sensitivity(jump, ["zeta", "e[0]", "reference[0]"], measure="pp2")
    assert found.quantities[3:] == ("pp2 before", "pp2 before m", "pp2 after", "pp2 after m")
    check(jump.before, ["zeta", "e[0]"])
    name, h = "zeta", 1e-5
    sides = []
    for side in (1, -1):
        problem = hb.HarmonicBalance(model.replace(zeta=model.zeta + side * h), 8)
        curve = hb.trace(problem, "Omega", (2.6, 0.4))
        sides.append(min(curve.jumps(), key=lambda one: abs(one.value - jump.value)))
    speed = [problem.model.scales.pinion_speed(one.value) for one in sides]
    assert found.of("pinion r/min")[name] == pytest.approx((speed[0] - speed[1]) / (2 * h), rel=1e-6)
    after = [one.after.amplitude("pp2") for one in sides]
    assert found.of("pp2 after")[name] == pytest.approx((after[0] - after[1]) / (2 * h), rel=1e-5)
    # the natural frequency changes no dimensionless quantity; the speed is proportional to it
    assert found.of("Omega")["reference[0]"] == pytest.approx(0.0, abs=1e-12)
    assert found.percent("pinion r/min")["reference[0]"] == pytest.approx(1.0, rel=1e-8)


def test_row_of_a_curve(spur):
    """At a fixed frequency the slopes of Omega are 0; amplitude and largest multiplier agree with differences."""
    row = spur[40]
    found = hb.analysis.sensitivity(row, measure="pp2", multipliers=True)
    assert not any(found.of("Omega").values())
    model, Omega = spur.problem.model, row.parameters["Omega"]
    for name in ("zeta", "e[1]", "F_m"):
        h = 1e-5 * found.values[found.parameters.index(name)]
        sizes, moduli = [], []
        for side in (1, -1):
            value = (model.parameters | model.entries)[name] + side * h
            other = hb.HarmonicBalance(model.replace(**{name: value}), 8)
            here = {**other.parameters, "Omega": Omega}
            X = refine(other, solve(other, row.X, here), here).X
            sizes.append(float(row.layout.measure("pp2", X)))
            moduli.append(abs(other.multipliers(X, points=8, max_step=1.0, Omega=Omega)[0]))
        assert found.of("pp2")[name] == pytest.approx((sizes[0] - sizes[1]) / (2 * h), rel=1e-6)
        # zero for e and F_m, as |mu| = exp(-2 pi zeta / Omega) of a pair; their differences have the rounding 1e-12 / h
        assert found.of("|mu|")[name] == pytest.approx((moduli[0] - moduli[1]) / (2 * h), rel=1e-5, abs=5e-5)


def test_equations_of_a_user():
    class Ellipse:
        @property
        def parameters(self):
            return {"a": 2.0, "b": 1.5}

        def evaluate(self, X, p, a, b):
            return np.array([(X[0] / a) ** 2 + (p / b) ** 2 - 1]), np.array([[2 * X[0] / a**2]])

    curve = hb.trace(Ellipse(), "p", (0, 2), np.array([2.0]))
    found = hb.analysis.sensitivity(curve["LP1"])
    assert found.quantities == ("p",)
    assert found.of() == pytest.approx({"a": 0.0, "b": 1.0}, abs=1e-8)


def test_event_of_a_user(spur):
    level = float(np.median(spur.amplitude("H1")))
    limit = hb.Event("limit", lambda point: point.amplitude("H1") - level)
    curve = hb.trace(spur.problem, "Omega", (2.6, 0.4), events=[limit])
    check(curve["limit1"], ["zeta", "e[0]"])


def test_points_know_their_problem(spur, tmp_path):
    path = tmp_path / "curve.npz"
    spur.save(path)
    bare, known, given = read(path), hb.load(path), hb.load(path, problem=spur.problem)
    with pytest.raises(ValueError, match=r"LP1 does not know its problem; take it from the curve, as curve\['LP1'\]"):
        hb.analysis.sensitivity(bare["LP1"])
    for curve in (known, given, pickle.loads(pickle.dumps(spur))):
        again = hb.analysis.sensitivity(curve["LP1"], ["zeta"])
        assert again.of() == pytest.approx(hb.analysis.sensitivity(spur["LP1"], ["zeta"]).of(), rel=1e-9)
        assert hb.analysis.sensitivity(curve.jumps()[0], ["zeta"]).parameters == ("zeta",)


def test_scatter_and_order(spur):
    found = hb.analysis.sensitivity(spur["LP1"])
    share = found.percent("Omega")
    assert list(map(abs, share.values())) == sorted(map(abs, share.values()), reverse=True)
    slopes = found.of("Omega")
    both = math.hypot(slopes["zeta"] * 0.01, slopes["b"] * 0.1)
    assert found.scatter({"zeta": 0.01, "b": 0.1}) == pytest.approx(both)
    with pytest.raises(KeyError, match="no derivative in 'zetta'; did you mean 'zeta'"):
        found.scatter({"zetta": 0.1})
    with pytest.raises(ValueError, match="must be a standard deviation of at least 0"):
        found.scatter({"zeta": -0.1})


@hb.mechanics.model
def rubbing(clearance: float = 1.0, e: float = 0.2, k: float = 2.0) -> hb.System:
    """A rotor on unequal springs that rubs in a seal: lengths scale with the clearance and the eccentricity."""
    one, load = np.eye(2), hb.Load(cosine={1: [e, 0.0]}, sine={1: [0.0, e]}, power=2)
    seal = hb.mechanics.VectorElement(one, hb.mechanics.RadialClearance(k, clearance), name="seal")
    return hb.System(one, 0.12 * one, np.diag([1.0, 1.2]), [*seal], load)


@pytest.mark.slow
def test_sensitivities_of_a_rub_do_not_depend_on_the_unit_of_length():
    """A clearance of 1e-7 units of length: differences had the size of a motion of 1e-3."""
    percent = []
    for unit in (1.0, 1e-7):
        curve = hb.trace(hb.HarmonicBalance(rubbing(unit, 0.2 * unit), 6), "Omega", (0.6, 1.6))
        percent.append(hb.analysis.sensitivity(curve["LP4"]).percent("Omega"))
    assert percent[1] == pytest.approx(percent[0], abs=1e-9)
    assert percent[1]["clearance"] + percent[1]["e"] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    "law", [hb.mechanics.RadialClearance(2.0, 3e-6), hb.mechanics.Directed(hb.Unilateral(k=1.0, gap=3e-6))]
)
def test_gaps_of_laws_of_several_displacements_are_lengths(law):
    one = np.eye(2)
    system = hb.System(one, one, one, [*hb.mechanics.VectorElement(one, law)])
    assert hb.HarmonicBalance(system, 1).least_size == pytest.approx(3e-9, rel=1e-12)


def test_invalid_sensitivities_are_refused(spur):
    with pytest.raises(KeyError, match="no parameter 'zetta'; did you mean 'zeta'"):
        hb.analysis.sensitivity(spur["LP1"], ["zetta"])
    with pytest.raises(KeyError, match=r"no parameter 'eps\[7\]'"):
        hb.analysis.sensitivity(spur["LP1"], ["eps[7]"])
    with pytest.raises(ValueError, match="Omega is an unknown of the point"):
        hb.analysis.sensitivity(spur["LP1"], ["Omega"])
    with pytest.raises(ValueError, match="name at least one parameter"):
        hb.analysis.sensitivity(spur["LP1"], [])
    with pytest.raises(TypeError, match="needs names of parameters, such as"):
        hb.analysis.sensitivity(spur["LP1"], "zeta")
    with pytest.raises(TypeError, match="needs a special point, peak, jump, critical parameter or point"):
        hb.analysis.sensitivity(spur)
    with pytest.raises(KeyError, match="no derivatives of 'pp2'"):
        hb.analysis.sensitivity(spur["LP1"], ["zeta"]).of("pp2")


def test_traced_in_an_entry(spur):
    """An entry such as e[0] can be the parameter of a curve and of a curve of special points."""
    problem = spur.problem
    curve = hb.trace(problem, "e[0]", (0.1, 0.11), at={"Omega": 1.5}, start=None)
    assert curve.status.complete and curve.values[-1] == 0.11
    whole = hb.trace(hb.HarmonicBalance(problem.model.replace(**{"e[0]": 0.11}), 8), "Omega", (1.5, 1.49))
    np.testing.assert_allclose(curve.X[-1], whole.X[0], rtol=1e-8, atol=1e-9)
    folds = hb.follow(spur, "LP1", "e[0]", (0.1, 0.101))
    slope = hb.analysis.sensitivity(spur["LP1"], ["e[0]"]).of()["e[0]"]
    h = folds.values[-1] - folds.values[0]
    assert (folds.tracked["Omega"][-1] - folds.tracked["Omega"][0]) / h == pytest.approx(slope, rel=2e-2)


@pytest.mark.slow
def test_scatter_of_jumps_against_monte_carlo(spur):
    """Small deviations: linear and sampled standard deviations agree within 12 %. Large ones: some jumps are lost."""
    jumps = [jump for jump in spur.jumps() if jump.label.startswith("LP")]
    found = {
        one.label: one for one in hb.design.jump_tolerance(spur, {"zeta": 1e-4, "e[0]": 2e-4}, draws=400, unit="Omega")
    }
    for jump in jumps:
        one = found[jump.label]
        assert one.lost == 0 and abs(one.error) < 0.12
        slopes = hb.analysis.sensitivity(jump.before, ["zeta", "e[0]"]).of()
        assert one.first == pytest.approx(math.hypot(1e-4 * slopes["zeta"], 2e-4 * slopes["e[0]"]))
    # the first draw against a curve traced with its parameters
    xi = np.random.default_rng(0).normal(size=(400, 2))[0]
    model = spur.problem.model.replace(**{"zeta": 0.05 + 1e-4 * xi[0], "e[0]": 0.1 + 2e-4 * xi[1]})
    again = hb.trace(hb.HarmonicBalance(model, 8), "Omega", (2.6, 0.4), accuracy=None)
    for jump in jumps:
        place = min((one.value for one in again.jumps()), key=lambda value: abs(value - jump.value))
        assert found[jump.label].draws[0] == pytest.approx(place, rel=1e-6)
    wide = hb.design.jump_tolerance(spur, {"zeta": 0.02, "e[0]": 0.03}, draws=100)
    assert any(one.lost for one in wide)
    lossy = next(one for one in wide if one.lost)
    assert repr(lossy).startswith(f"<JumpTolerance of {lossy.label} at") and f"{lossy.lost} lost>" in repr(lossy)
    with pytest.raises(ValueError, match="name at least one parameter"):
        hb.design.jump_tolerance(spur, {})
    with pytest.raises(KeyError, match="no parameter 'zetta'"):
        hb.design.jump_tolerance(spur, {"zetta": 0.1})
