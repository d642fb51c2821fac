"""Points of codimension two against extended systems of shooting, and multipliers by integration."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
import scipy
from machines import VanDerPol, single_mass, two_masses

import hbgear as hb
from hbgear.time.integration import state_of

EPS = 0.2


@hb.mechanics.model
def forced(F: float = 0.2, quadratic: float = 0.0) -> hb.System:
    return single_mass(VanDerPol(EPS, quadratic), F=F, c=0.0)


def monodromy(point, quadratic):
    """Return trace and determinant of the monodromy matrix of the periodic motion near a point, by shooting."""
    Omega, F = point.parameters["Omega"], point.parameters["F"]

    def rates(t, y):
        x, v, (a, b, c, d) = y[0], y[1], y[2:]
        k, r = 1 + 2 * EPS * x * v + 2 * quadratic * x, EPS * (x**2 - 1)
        force = F * math.cos(Omega * t) - x - r * v - quadratic * x**2
        return [v, force, c, d, -k * a - r * c, -k * b - r * d]

    def flow(start):
        y = scipy.integrate.solve_ivp(
            rates, (0, 2 * math.pi / Omega), [*start, 1, 0, 0, 1], method="DOP853", rtol=1e-13, atol=1e-13
        ).y[:, -1]
        return y[:2], y[2:].reshape(2, 2)

    x = point.samples(0, 64)[1][0], Omega * point.samples(0, 64, order=1)[1][0]
    end, Phi = flow(x)
    for _ in range(3):
        if np.abs(end - x).max() < 1e-11:
            break
        x = x + np.linalg.lstsq(np.eye(2) - Phi, end - x, rcond=1e-6)[0]
        end, Phi = flow(x)
    assert np.abs(end - x).max() < 1e-9
    return float(np.trace(Phi)), float(np.linalg.det(Phi))


@pytest.fixture(scope="module")
def symmetric():
    return hb.trace(hb.HarmonicBalance(forced(), 9), "Omega", (0.93, 0.95), at={"F": 0.203}, accuracy=None)


@pytest.mark.slow
def test_resonance_and_cusp_of_the_forced_van_der_pol_oscillator(symmetric):
    """Numbers: extended systems of shooting."""
    folds = [hb.follow(symmetric, "LP1", "F", (0.203, end), accuracy=None) for end in (0.19, 0.25)]
    resonance, cusp = folds[0]["RI1"], folds[1]["CP1"]
    assert resonance.parameters["F"] == pytest.approx(0.1924005883486835, abs=1e-10)
    assert resonance.parameters["Omega"] == pytest.approx(0.9493419784674177, abs=1e-10)
    assert cusp.parameters["F"] == pytest.approx(0.21146912508265248, abs=1e-10)
    assert cusp.parameters["Omega"] == pytest.approx(0.9404391721811415, abs=1e-10)
    trace, determinant = monodromy(resonance, 0.0)
    assert abs(trace - 2) < 1e-8 and abs(determinant - 1) < 1e-8


def test_neimark_sacker_points_end_at_the_resonance(symmetric):
    held = hb.follow(symmetric, "NS1", "F", (0.203, 0.1), accuracy=None)
    assert held.status == "event" and "1:1 resonance" in held.message
    end = held["RI1"]
    assert end.index == len(held) - 1
    assert end.parameters["F"] == pytest.approx(0.1924005883486835, abs=1e-10)
    assert end.parameters["Omega"] == pytest.approx(0.9493419784674177, abs=1e-10)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-9])
def test_the_error_of_the_end_at_the_resonance_is_that_of_its_truncation(accuracy):
    """It was infinite. The reference is the resonance by shooting; the point is refined to the accuracy."""
    curve = hb.trace(hb.HarmonicBalance(forced(), 3), "Omega", (0.93, 0.95), at={"F": 0.203}, accuracy=None)
    held = hb.follow(curve, "NS1", "F", (0.203, 0.19), accuracy=accuracy)
    end, true = held["RI1"], abs(held["RI1"].parameters["F"] - 0.1924005883486835)
    assert true == pytest.approx(end.error, rel=0.01, abs=1e-12) and end.error < accuracy and held.warnings == ()
    assert (true > 1e-6) == (accuracy == 1e-3)  # the error of 3 harmonics is 1.3e-6
    assert hb.switch(held, "RI1", (0.185, 0.2), accuracy=None).values[-1] == 0.2  # from a refined point


@dataclass(frozen=True)
class ScaledVanDerPol(hb.mechanics.Law):
    """The law with lengths in units of L and times in units of T."""

    L: float
    T: float

    def force(self, d, v, tau):
        force, k, c = VanDerPol(EPS, 0.0).force(d / self.L, v * self.T / self.L, tau)
        return force * self.L, k, c * self.T


@pytest.mark.slow
@pytest.mark.parametrize(("L", "T"), [(1e-6, 1e-3), (1e3, 1e3)])
def test_neimark_sacker_points_end_at_the_resonance_in_any_units(L, T):
    @hb.mechanics.model
    def scaled(F: float = 0.2 * L) -> hb.System:
        spring = hb.Element([1.0], ScaledVanDerPol(L, T))
        return hb.System([[T**2]], [[0.0]], [[1.0]], [spring], hb.Load(cosine={1: [F]}))

    problem = hb.HarmonicBalance(scaled(), 9)
    curve = hb.trace(problem, "Omega", (0.93 / T, 0.95 / T), at={"F": 0.203 * L}, accuracy=None)
    held = hb.follow(curve, "NS1", "F", (0.203 * L, 0.1 * L), accuracy=None)
    assert held["RI1"].parameters["F"] / L == pytest.approx(0.1924005883486835, abs=1e-10)
    assert held["RI1"].parameters["Omega"] * T == pytest.approx(0.9493419784674177, abs=1e-10)


@pytest.mark.slow
def test_neimark_sacker_points_leave_the_resonance(symmetric):
    """Shooting: the product of the multipliers is 1, their sum below 2 and falling from the resonance on."""
    folds = hb.follow(symmetric, "LP1", "F", (0.203, 0.19), accuracy=None)
    found = hb.switch(folds, "RI1", (0.19, 0.23), accuracy=None)
    assert isinstance(found.problem, hb.harmonic.NeimarkSackerProblem) and found.values[-1] == 0.23
    assert 0 < found.values[0] - folds["RI1"].parameters["F"] < 1e-3
    sums = []
    for i in (1, len(found) // 2, -1):
        trace, determinant = monodromy(found[i], 0.0)
        assert abs(determinant - 1) < 1e-8
        sums.append(trace)
    assert 2 > sums[0] > sums[1] > sums[2] > 1.8


@pytest.mark.slow
@pytest.mark.parametrize(("side", "end"), [(1, 0.205), (-1, 0.18)])
def test_folds_leave_the_end_of_neimark_sacker_points(symmetric, side, end):
    """Shooting: a multiplier is +1, the other one is below 1 for larger F and above 1 for smaller F."""
    held = hb.follow(symmetric, "NS1", "F", (0.203, 0.1), accuracy=None)
    found = hb.switch(held, "RI1", (0.18, 0.205), side=side, accuracy=None)
    assert found.values[0] == held["RI1"].parameters["F"] and found.values[-1] == end
    trace, determinant = monodromy(found[-1], 0.0)
    assert abs(1 - trace + determinant) < 1e-8 and side * (1 - determinant) > 0.01


def test_points_without_complex_multipliers_nearby_have_no_other_branch(symmetric):
    folds = hb.follow(symmetric, "LP1", "F", (0.203, 0.25), accuracy=None)
    with pytest.raises(ValueError, match=r"CP1 is .* no other branch leaves there"):
        hb.switch(folds, "CP1")


@pytest.mark.slow
def test_upper_resonance_and_cusp():
    curve = hb.trace(hb.HarmonicBalance(forced(), 9), "Omega", (1.03, 1.06), at={"F": 0.203}, accuracy=None)
    fold = max((point for point in curve.special if point.kind == "LP"), key=lambda point: point.parameters["Omega"])
    folds = hb.follow(curve, fold, "F", (0.203, 0.4), accuracy=None)
    found = {point.kind: point.parameters for point in folds.special}
    assert found["RI"]["F"] == pytest.approx(0.2074110762026159, abs=1e-9)
    assert found["RI"]["Omega"] == pytest.approx(1.0494045823802225, abs=1e-9)
    assert found["CP"]["F"] == pytest.approx(0.22404822820243483, abs=1e-9)
    assert found["CP"]["Omega"] == pytest.approx(1.0562073304154307, abs=1e-9)


@pytest.fixture(scope="module")
def tongue():
    """Period doublings of the asymmetric oscillator, in F."""
    problem = hb.HarmonicBalance(forced(quadratic=0.05), 9)
    curve = hb.trace(problem, "Omega", (1.9, 1.97), at={"F": 4.5}, accuracy=None)
    return hb.follow(curve, "PD1", "F", (4.5, 3.6), accuracy=None)


@pytest.mark.slow
def test_second_resonance_on_period_doublings(tongue):
    trace, determinant = monodromy(tongue["RII1"], 0.05)
    assert abs(trace + 2) < 1e-8 and abs(determinant - 1) < 1e-8


def test_neimark_sacker_points_leave_the_second_resonance(tongue):
    found = hb.switch(tongue, "RII1", (3.5, 4.5), accuracy=None)
    assert found.values[-1] == 3.5 and found.values[0] < tongue["RII1"].parameters["F"]
    sums = []
    for i in (1, -1):
        trace, determinant = monodromy(found[i], 0.05)
        assert abs(determinant - 1) < 1e-8
        sums.append(trace)
    assert -2 < sums[0] < sums[1] < -1.9


@pytest.mark.slow
def test_resonances_of_neimark_sacker_points(tongue):
    problem = hb.HarmonicBalance(forced(quadratic=0.05), 9)
    curve = hb.trace(problem, "Omega", (1.1, 1.2), at={"F": 0.5}, accuracy=None)
    held = hb.follow(curve, "NS1", "F", (0.5, 6.0), accuracy=None)
    assert [point.label for point in held.special] == ["RIV1", "RIII1", "RII1"]
    for label, expected in (("RIV1", 0.0), ("RIII1", -1.0), ("RII1", -2.0)):
        trace, determinant = monodromy(held[label], 0.05)
        assert abs(trace - expected) < 1e-8 and abs(determinant - 1) < 1e-8
    for name in ("F", "Omega"):
        assert held["RII1"].parameters[name] == pytest.approx(tongue["RII1"].parameters[name], abs=1e-9)


@dataclass(frozen=True)
class StiffVanDerPol(hb.mechanics.Law):
    """eps (d^2 - 1) d' + cubic d^3"""

    eps: float
    cubic: float

    def force(self, d, v, tau):
        damping = self.eps * (d**2 - 1)
        return damping * v + self.cubic * d**3, 2 * self.eps * d * v + 3 * self.cubic * d**2, damping


@hb.mechanics.model
def stiffening(F: float = 4.0, eps: float = 0.4, cubic: float = 0.3) -> hb.System:
    return single_mass(StiffVanDerPol(eps, cubic), F=F, c=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.2, 1.0])
def test_angles_at_resonances_are_accurate_to_rounding(start):
    """Multipliers by shooting; the exponents of Hill's determinant once were wrong by 1e-9 between some points."""
    problem = hb.HarmonicBalance(stiffening(), 14)
    curve = hb.trace(problem, "Omega", (2.0, 2.2), accuracy=None)
    held = hb.follow(curve, "NS1", "F", (start, 8.0), accuracy=None)
    for label, turns in (("RIV1", 1 / 4), ("RIII1", 1 / 3)):
        at = {name: held[label].parameters[name] for name in ("F", "Omega")}
        state = state_of(problem, problem.from_point(held[label]), **at)
        multipliers = hb.time.shoot(stiffening(at["F"]), at["Omega"], state, tolerance=1e-12).multipliers
        assert np.abs(np.angle(multipliers)) / (2 * math.pi) == pytest.approx(turns, abs=5e-11)


@pytest.mark.slow
def test_errors_far_along_a_curve_are_those_of_the_pair_there():
    """The comparisons began at the exponent of the first point, and the error was infinite. Reference: H = 12."""
    found = []
    for H, accuracy in ((6, 1e-5), (12, None)):
        problem = hb.HarmonicBalance(stiffening(2.0), H)
        curve = hb.trace(problem, "Omega", (1.6, 1.8), accuracy=accuracy)
        held = hb.follow(curve, "NS1", "F", (2.0, 9.0), accuracy=accuracy)
        assert held.warnings == ()
        found.append([held[label] for label in ("RIV1", "RIII1")])
    for point, exact in zip(*found, strict=True):
        assert abs(point.parameters["F"] - exact.parameters["F"]) < 3 * point.error < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("last", [1.3, 9.0])
def test_long_steps_do_not_pass_the_end_of_neimark_sacker_points(last):
    """From F = 1.172 to 1.18 the pair is real. Longer steps towards F = 9 reached the points beyond, without RI1."""
    problem = hb.HarmonicBalance(stiffening(1.0, 0.3, 0.1), 12)
    curve = hb.trace(problem, "Omega", (0.5, 0.8), accuracy=None)
    held = hb.follow(curve, "NS1", "F", (1.0, last), accuracy=None)
    end = held["RI1"].parameters
    state = state_of(problem, problem.from_point(held["RI1"]), **end)
    shot = hb.time.shoot(stiffening(end["F"], 0.3, 0.1), end["Omega"], state, tolerance=1e-12)
    assert np.abs(shot.multipliers - 1).max() < 1e-3  # the square root of the error of a double multiplier
    assert end["F"] == pytest.approx(1.171672145, abs=1e-8) and held.status is hb.Status.EVENT


@pytest.mark.slow
def test_elements_with_one_direction_have_the_points_of_one_element():
    @hb.mechanics.model
    def split(F: float = 0.5) -> hb.System:
        springs = [hb.Element([1.0], VanDerPol(EPS, 0.0), name="damper")]
        springs += [hb.Element([1.0], VanDerPol(0.0, 0.05), name="spring")]
        return hb.System([[1.0]], [[0.0]], [[1.0]], springs, hb.Load(cosine={1: [F]}))

    points = []
    for model in (split(), forced(0.5, 0.05)):
        curve = hb.trace(hb.HarmonicBalance(model, 5), "Omega", (1.1, 1.2), accuracy=None)
        held = hb.follow(curve, "NS1", "F", (0.5, 6.0), accuracy=None)
        curve = hb.trace(hb.HarmonicBalance(model, 5), "Omega", (1.9, 1.97), at={"F": 4.5}, accuracy=None)
        doublings = hb.follow(curve, "PD1", "F", (4.5, 3.6), accuracy=None)
        points.append([(p.kind, p.parameters["F"], p.parameters["Omega"]) for p in (*held.special, *doublings.special)])
    assert [kind for kind, _, _ in points[0]] == [kind for kind, _, _ in points[1]]
    assert {"RIII", "RIV", "RII", "GPD"} <= {kind for kind, _, _ in points[0]}
    ours, theirs = (np.array([place for _, *place in found]) for found in points)
    np.testing.assert_allclose(ours, theirs, rtol=1e-8)


def test_the_doubled_branch_turns_over_at_a_generalised_period_doubling(tongue):
    """Omega = Omega_PD + beta a^2 of the doubled branch with amplitude a: beta changes sign at the point.

    From the resonance 1:2 the curve reaches the same point, which rounding displaced by 7e-7.
    """
    point = tongue["GPD1"]
    F = point.parameters["F"]
    slopes, values = [], (F - 0.02, F + 0.02)
    for value in values:
        Omega = float(np.interp(value, tongue.values[::-1], tongue.tracked["Omega"][::-1]))
        problem = hb.HarmonicBalance(forced(value, 0.05), 9)
        near = (Omega - 0.002, Omega + 0.002)
        curve = hb.trace(problem, "Omega", near, accuracy=None)
        doubled = hb.switch(curve, "PD1", span=near, accuracy=None, steps=hb.StepControl(max_points=12, max_step=0.02))
        part = np.array([doubled.problem.subharmonic_part(X) for X in doubled.X])
        slopes.append(np.polyfit(np.square(part).sum(axis=1), doubled.values, 2)[1])
    assert slopes[0] * slopes[1] < 0
    assert np.interp(0.0, sorted(slopes), [values[i] for i in np.argsort(slopes)]) == pytest.approx(F, abs=1e-3)
    few = hb.trace(tongue.problem, "F", (3.85, 4.2), tongue.at(3.85)[0], accuracy=None)
    assert few["GPD1"].parameters["F"] == pytest.approx(F, abs=3e-9)


@hb.mechanics.model
def two_oscillators(F: float = 1.0, depth: float = 0.3) -> hb.System:
    """A forced cubic oscillator and, without coupling, one with periodic stiffness 0.49 (1 + depth cos tau)."""
    varying = hb.mechanics.Series(mean=0.49, cosine=(0.49 * depth,))
    elements = [
        hb.Element([1.0, 0.0], hb.Cubic(1.0), name="forced"),
        hb.Element([0.0, 1.0], hb.mechanics.PiecewiseLinear((), (1.0,), stiffness=varying), name="parametric"),
    ]
    load = hb.Load(cosine={1: [F, 0.0]})
    return hb.System(np.eye(2), np.diag([0.1, 0.05]), np.diag([1.0, 0.0]), elements, load)


def limits_of_the_tongue(depth):
    """Return the frequencies at which a multiplier of y'' + 0.05 y' + 0.49 (1 + depth cos tau) y = 0 is -1."""

    def test(Omega):
        def rates(t, y):
            k = 0.49 * (1 + depth * math.cos(Omega * t))
            return [y[2], y[3], -k * y[0] - 0.05 * y[2], -k * y[1] - 0.05 * y[3]]

        T = 2 * math.pi / Omega
        Phi = scipy.integrate.solve_ivp(rates, (0, T), [1, 0, 0, 1], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        return np.linalg.det(Phi.reshape(2, 2) + np.eye(2))

    return [scipy.optimize.brentq(test, *ends, xtol=1e-13) for ends in ((1.2, 1.4), (1.4, 1.6))]


@pytest.mark.slow
def test_fold_flip_of_two_oscillators_without_coupling():
    curve = hb.trace(hb.HarmonicBalance(two_oscillators(), 5), "Omega", (2.6, 1.2), at={"F": 0.35}, accuracy=None)
    fold = max((p for p in curve.special if p.kind == "LP"), key=lambda p: p.parameters["Omega"])
    folds = hb.follow(curve, fold.label, "F", (0.35, 0.1), accuracy=None)
    found = [point.parameters["Omega"] for point in folds.special if point.kind == "FF"]
    limits = limits_of_the_tongue(0.3)
    crossed = [w for w in limits[::-1] if folds.tracked["Omega"].min() < w < fold.parameters["Omega"]]
    assert crossed and found == pytest.approx(crossed, abs=1e-9)
    held = hb.follow(curve, "PD2", "F", (0.35, 0.7), accuracy=None)  # the other curve passes through the same point
    other = hb.follow(curve, "LP1", "F", (0.35, 0.7), accuracy=None)
    assert held["FF1"].parameters["F"] == pytest.approx(other["FF1"].parameters["F"], abs=1e-9)
    assert "GPD" not in {point.kind for point in held.special}  # the parametric oscillator is linear


def test_a_turning_point_in_the_second_parameter_alone_is_no_cusp():
    """Two folds of x^2 = (p - 1)^2 + q meet at q = 0 where p = 1: the curves in p separate there."""

    class Curves(hb.continuation.ContinuationProblem):
        def evaluate(self, X, p, q):
            return np.array([X[0] ** 2 - (p - 1) ** 2 - q]), np.array([[2 * X[0]]])

    curve = hb.trace(Curves(), "p", (0.0, 2.0), np.array([0.7]), at={"q": -0.5}, cover=False)
    folds = hb.follow(curve, "LP1", "q", (-0.5, 0.5))
    assert [point.label for point in folds.special] == ["IC1"]
    assert folds["IC1"].parameters["q"] == pytest.approx(0, abs=1e-9)
    assert folds["IC1"].parameters["p"] == pytest.approx(1, abs=1e-6)


def test_branch_points_are_not_followed_where_the_symmetry_is_broken():
    @hb.mechanics.model
    def duffing(F0: float = 0.0) -> hb.System:
        return single_mass(hb.Cubic(1.0), F=20.0, mean=F0)

    curve = hb.trace(hb.HarmonicBalance(duffing(), 9), "Omega", (1.0, 1.4), stability=False, accuracy=None)
    with pytest.raises(ValueError, match="F0 breaks their symmetry"):
        hb.follow(curve, "BP1", "F0", (0.0, 0.1), accuracy=None)


@pytest.mark.slow
def test_neimark_sacker_points_over_the_load_are_those_of_shooting():
    @hb.mechanics.model
    def masses(F: float = 0.13) -> hb.System:
        return two_masses(F)

    curve = hb.trace(hb.HarmonicBalance(masses(), 11), "Omega", (1.1, 1.16), at={"F": 0.11})
    held = hb.follow(curve, "NS1", "F", (0.11, 0.1))
    assert held.tracked["Omega"][-1] == pytest.approx(1.1301287894345817, abs=1e-8)
    again = hb.trace(hb.HarmonicBalance(masses(), 11), "Omega", (1.12, 1.16), at={"F": 0.1})
    found = [point.parameters["Omega"] for point in again.special if point.kind == "NS"]
    assert found == pytest.approx([1.1301287894345817, 1.1473065816207717], abs=1e-8)
    for label, angle in (("NS1", 0.08945804739400363), ("NS2", 0.08740938130294855)):
        point = again[label]
        pair = point.multipliers[np.argmin(np.abs(np.abs(point.multipliers) - 1))]
        assert abs(np.angle(pair)) / (2 * np.pi) == pytest.approx(angle, abs=1e-7)


@dataclass(frozen=True)
class PythonCubic(hb.mechanics.Law):
    k3: float

    def force(self, d, v, tau):
        return self.k3 * d**3, 3 * self.k3 * d**2, np.zeros_like(d)


def test_sampled_slopes_give_the_same_hill_determinant_as_closed_forms():
    exponents, X = [], np.random.default_rng(1).normal(size=22) * 0.1
    for law in (hb.Cubic, PythonCubic):
        problem = hb.HarmonicBalance(two_masses(ground=law(1.0), link=law(0.0042)), 5)
        exponents.append(hb.harmonic.NeimarkSackerProblem(problem, "Omega").exponent(X, Omega=1.14))
    assert abs(exponents[1] - exponents[0]) < 1e-12


def test_gradient_of_the_exponent_with_a_law_in_python():
    balance = hb.HarmonicBalance(forced(quadratic=0.05), 5)
    X = np.random.default_rng(2).normal(size=11) * 0.3
    U, here = np.append(X, 1.2), {"F": 0.5, "quadratic": 0.05}
    problem = hb.harmonic.NeimarkSackerProblem(balance, "Omega").with_borders_at(U, here)
    now, h = problem.linearise(U, "F", **here), 1e-6
    differences = [
        (problem.linearise(U + h * e, "", **here).R - problem.linearise(U - h * e, "", **here).R) / (2 * h)
        for e in np.eye(len(U))
    ]
    np.testing.assert_allclose(now.dR_dX, np.array(differences).T, rtol=1e-6, atol=1e-7 * now.size)


@hb.mechanics.model
def loose_teeth(F: float = 0.13) -> hb.System:
    """Return one mass between teeth with backlash and a constant load."""
    return single_mass(hb.Backlash(b=0.95, k=0.33), F=F, mean=0.15, c=0.02, name="teeth")


@pytest.mark.parametrize("first, last", [(0.13, 0.1), (0.1, 0.13)])
def test_a_fold_passes_a_grazing_contact(first, last):
    """With F = .13 the motion of the fold touches both flanks, with F = .1 only one.

    Between them its curve has a corner: with contact the clearance is proportional to the square of the distance to it.
    The curve traced again in contact instants has no truncation.
    """
    curve = hb.trace(hb.HarmonicBalance(loose_teeth(first), 14), "Omega", (1.12, 1.0))
    folds = hb.follow(curve, "LP1", "F", (first, last))
    assert folds.status is hb.Status.REACHED_END
    again = hb.trace(hb.ContactInstants(loose_teeth(last)), "Omega", (1.12, 1.0))
    assert folds.tracked["Omega"][-1] == pytest.approx(again["LP1"].parameters["Omega"], abs=5e-6)
    order = [[point.kind for point in one.special if point.kind in ("LP", "GR")][1:3] for one in (curve, again)]
    assert sorted(order) == [["GR", "LP"], ["LP", "GR"]]
