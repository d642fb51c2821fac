"""Special points as problems: derivatives against differences, normal forms in closed form, what they refuse."""

import numpy as np
import pytest

from hbgear import Backlash, Cubic, Duffing, Element, HarmonicBalance, Load, SpurPair, StepControl, System, trace
from hbgear.continuation import FoldProblem
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic import AmplitudeExtremum, GrazingProblem, PeriodDoublingProblem

KINDS = {
    "fold": FoldProblem,
    "period doubling": PeriodDoublingProblem,
    "grazing, lowest": lambda p: GrazingProblem(p, which=2),
    "grazing, highest": lambda p: GrazingProblem(p, which=3),
    "peak of rms": AmplitudeExtremum,
    "peak of H2": lambda p: AmplitudeExtremum(p, measure="H2"),
}


class CuspForm:
    """x^3 - a x - (b - b_0) = 0, y = x: folds at b = b_0 +- 2 (a / 3)^(3/2), a cusp at a = 0, b = b_0."""

    def __init__(self, b0=0.0):
        self.b0 = b0

    def evaluate(self, X, a, b):
        x, y = X
        return np.array([x**3 - a * x - (b - self.b0), y - x]), np.array([[3 * x * x - a, 0.0], [-1.0, 1.0]])

    def curve(self):
        """In b, at a = 1."""
        return trace(self, "b", (self.b0 - 2, self.b0 + 2), np.array([-1.5, -1.5]), at={"a": 1.0})


@pytest.fixture(scope="module")
def curve():
    """Contact loss with varying stiffness, through both folds."""
    return trace(HarmonicBalance(SpurPair(eps=(0.1, 0.05)), 6), "Omega", (1.5, 0.6), accuracy=None)


def differences(f, x, slope):
    """Columns df/dx_i."""
    return np.column_stack([slope(lambda s, e=e: f(x + s * e), h=1e-4) for e in np.eye(len(x))])


@pytest.mark.parametrize("kind", KINDS)
def test_values_do_not_depend_on_earlier_calls(curve, kind):
    own, U, far = SpurPair().parameters, somewhere(curve, 0.65), somewhere(curve, 1.2)
    fresh, asked = KINDS[kind](curve.problem), KINDS[kind](curve.problem)
    asked.evaluate(far, **own)
    asked.with_borders_at(far, own).evaluate(U, **own)
    for a, b in zip(fresh.evaluate(U, **own), asked.evaluate(U, **own), strict=True):
        np.testing.assert_array_equal(a, b)
    assert fresh.base is None and asked.base is None


@pytest.mark.parametrize("label", ["LP1", "LP2"])
def test_a_fold_without_a_base_is_the_signed_least_singular_value(curve, label, slope):
    fold, U, own = FoldProblem(curve.problem), unknowns(curve[label]), SpurPair().parameters
    signs = []
    for h in (-1e-3, 1e-3):
        V = U + h * np.append(np.linalg.svd(curve.problem.evaluate(U[:-1], Omega=U[-1])[1])[2][-1], 0.0)
        R, J = fold.evaluate(V, **own)
        A = curve.problem.evaluate(V[:-1], Omega=V[-1])[1]
        assert R[-1] == pytest.approx(np.linalg.slogdet(A)[0] * np.linalg.svd(A)[1][-1], rel=1e-8)
        signs.append(np.sign(R[-1]))
        expected = differences(lambda W: fold.evaluate(W, **own)[0], V, slope)
        np.testing.assert_allclose(J[-1], expected[-1], rtol=0, atol=1e-6 * np.abs(J[-1]).max())
    assert signs[0] != signs[1]


def test_an_exact_fold_of_one_equation():
    """x^2 + p = 0 at the origin: dR/dX is zero, and nothing is divided by it."""

    class Parabola:
        def evaluate(self, X, p):
            return np.array([X[0] ** 2 + p]), np.array([[2 * X[0]]])

    R, J = FoldProblem(Parabola(), "p").evaluate(np.zeros(2))
    np.testing.assert_array_equal(R, [0.0, 0.0])
    np.testing.assert_allclose(np.abs(J), [[0.0, 1.0], [2.0, 0.0]], atol=1e-9)


def unknowns(point):
    return np.append(point.X, point.parameters["Omega"])


def somewhere(curve, place):
    """Unknowns at a label, or at the row nearest to an Omega."""
    if isinstance(place, str):
        return unknowns(curve[place])
    return unknowns(curve[int(np.argmin(np.abs(curve.values - place)))])


# ---- derivatives


@pytest.mark.parametrize("place", ["LP1", "LP2", 1.2, 0.65])
@pytest.mark.parametrize("kind", [name for name in KINDS if "peak" not in name])
def test_jacobian_in_the_motion_and_the_parameter(curve, kind, place, slope):
    own, U = SpurPair().parameters, somewhere(curve, place)
    problem = KINDS[kind](curve.problem).with_borders_at(U, own)
    J = problem.evaluate(U, **SpurPair().parameters)[1]
    expected = differences(lambda V: problem.evaluate(V, **SpurPair().parameters)[0], U, slope)
    np.testing.assert_allclose(J, expected, rtol=0, atol=2e-7)
    assert np.abs(J[-1]).max() > 1e-3


@pytest.mark.parametrize("place", [1.3, 1.2, 0.95, 0.65])
@pytest.mark.parametrize("kind", [name for name in KINDS if "peak" in name])
def test_jacobian_of_a_peak_away_from_folds(curve, kind, place, slope):
    """Its direction of the curve is scaled by its share of Omega, which vanishes at a fold."""
    test_jacobian_in_the_motion_and_the_parameter(curve, kind, place, slope)


@pytest.mark.parametrize("name", ["zeta", "F_m", "eps_scale", "e_scale", "b"])
@pytest.mark.parametrize("kind", KINDS)
def test_derivative_in_a_second_parameter(curve, kind, name, slope):
    U, own = somewhere(curve, 1.2), SpurPair().parameters
    problem = KINDS[kind](curve.problem).with_borders_at(U, own)
    dR = problem.linearise(U, name, **own).dR_dp
    expected = slope(lambda s: problem.evaluate(U, **{**own, name: own[name] + s})[0], h=1e-4)
    np.testing.assert_allclose(dR, expected, rtol=0, atol=1e-8)
    assert np.abs(dR).max() > 1e-4


@pytest.mark.parametrize("kind", [FoldProblem, PeriodDoublingProblem, AmplitudeExtremum])
def test_jacobian_with_two_elements_and_two_laws(kind, slope):
    """A gap between two masses, one of them on a cubic spring."""
    elements = [Element([1.0, -1.0], Backlash(0.3)), Element([0.0, 1.0], Cubic(0.5, 0.5))]
    system = System(np.diag([1.0, 2.0]), 0.1 * np.eye(2), 0.3 * np.eye(2), elements, Load([0.2, 0], {1: [0.5, 0]}))
    balance = HarmonicBalance(system, 4)
    U = np.append(balance.start(0.9), 0.9)
    problem = kind(balance).with_borders_at(U, {})
    J = problem.evaluate(U)[1]
    np.testing.assert_allclose(J, differences(lambda V: problem.evaluate(V)[0], U, slope), rtol=0, atol=2e-7)


# ---- zeros


@pytest.mark.parametrize("label", ["LP1", "LP2", "GR1", "GR2"])
def test_located_points_solve_their_equations(curve, label):
    names = list(curve.problem.clearance_names)
    point = curve[label]
    problem = (
        FoldProblem(curve.problem)
        if label[:2] == "LP"
        else GrazingProblem(curve.problem, which=names.index(point.note))
    )
    now = problem.linearise(unknowns(point), "", **SpurPair().parameters)
    assert np.linalg.norm(now.R) < 1e-10 * now.size


def test_grazing_reads_the_extremum_that_touches(curve):
    """Teeth in contact at d > b begin to part where the lowest value is b."""
    for label in ("GR1", "GR2"):
        d = curve[label].samples(count=100000)[1]
        assert d.min() == pytest.approx(1.0, abs=1e-8)
        assert curve[label].note == "lowest of gap at 1"


def test_folds_of_a_normal_form():
    problem = CuspForm()
    curve, b = problem.curve(), 2 / 3**1.5
    assert [p.parameters["b"] for p in curve.special] == pytest.approx([b, -b], rel=1e-12)
    assert [p.X[0] for p in curve.special] == pytest.approx([-(3**-0.5), 3**-0.5], rel=1e-9)
    for point, sense in zip(curve.special, (1, -1), strict=True):
        assert FoldProblem(problem, "b").direction(np.append(point.X, point.parameters["b"]), a=1.0) == sense


@pytest.mark.parametrize("b0", [1.0, 0.0])
def test_cusp_of_a_normal_form(b0):
    """The same trace follows the folds of any problem around the cusp and back, also if b passes zero there."""
    problem = CuspForm(b0)
    start = problem.curve()["LP1"]
    folds = trace(FoldProblem(problem, "b"), "a", (1.0, -1.0), start, steps=StepControl(max_points=300))
    assert folds.status == "left_span"
    np.testing.assert_allclose((folds.tracked["b"] - b0) ** 2, 4 * (folds.values / 3) ** 3, rtol=0, atol=1e-10)
    assert [p.label for p in folds.special] == ["CP1"]
    assert folds["CP1"].parameters["a"] == pytest.approx(0.0, abs=1e-8)
    assert folds["CP1"].parameters["b"] == pytest.approx(b0, abs=1e-8)


def test_period_doubling_of_a_linear_parametric_motion():
    """No subharmonics in the motion: the odd block decouples, the even one is the balance itself."""
    balance = HarmonicBalance(SpurPair(eps=(0.3,), e=()), 8)
    problem, X = PeriodDoublingProblem(balance), balance.start(2.2)
    wide = problem.embed(X)
    R, J = problem.doubled.evaluate(wide, Omega=2.2)
    own_R, own_J = balance.evaluate(X, Omega=2.2)
    np.testing.assert_allclose(R[problem.even], own_R, rtol=0, atol=1e-12)
    np.testing.assert_allclose(R[problem.odd], 0, atol=1e-13)
    np.testing.assert_allclose(J[np.ix_(problem.even, problem.even)], own_J, rtol=0, atol=1e-12)
    np.testing.assert_allclose(J[np.ix_(problem.even, problem.odd)], 0, atol=1e-13)
    np.testing.assert_allclose(J[np.ix_(problem.odd, problem.even)], 0, atol=1e-13)


def test_period_doubling_solved_from_afar():
    """Newton from 2 % away; there a multiplier is -1 and the null vector a solution of the doubled linear equations."""
    balance = HarmonicBalance(SpurPair(F_m=0.1, eps=(0.3,), e=()), 16)
    problem = PeriodDoublingProblem(balance)
    U = solve(problem, np.append(balance.start(2.14), 2.14), SpurPair().parameters).X
    assert U[-1] == pytest.approx(2.1063923779, abs=1e-9)
    assert np.abs(balance.multipliers(U[:-1], Omega=U[-1]) + 1).min() < 1e-7
    v = problem.null_vector(U[:-1], Omega=U[-1])
    J = problem.doubled.evaluate(problem.embed(U[:-1]), Omega=U[-1])[1]
    assert np.linalg.norm(v) == pytest.approx(1.0) and np.linalg.norm(J @ v) < 1e-9


def test_direction_is_where_the_motions_are(curve):
    """A softening jump: between the folds there are three motions."""
    low, high = sorted(("LP1", "LP2"), key=lambda label: curve[label].parameters["Omega"])
    fold = FoldProblem(curve.problem)
    assert fold.direction(unknowns(curve[low]), **SpurPair().parameters) == -1
    assert fold.direction(unknowns(curve[high]), **SpurPair().parameters) == 1


def test_a_fold_keeps_its_place_when_its_borders_are_renewed(curve):
    U, far = unknowns(curve["LP1"]), somewhere(curve, 1.2)
    fold = FoldProblem(curve.problem).with_borders_at(U, SpurPair().parameters)
    before = fold.evaluate(far, **SpurPair().parameters)[0][-1]
    renewed = fold.with_borders_at(far, SpurPair().parameters, renew=True)
    assert np.linalg.norm(renewed.base.b - fold.base.b) > 1e-3 and renewed.base.weight == fold.base.weight
    assert np.sign(renewed.evaluate(far, **SpurPair().parameters)[0][-1]) == np.sign(before)
    assert abs(renewed.evaluate(U, **SpurPair().parameters)[0][-1]) < 1e-9


# ---- as problems


def test_unknowns_are_joined_and_split(curve):
    fold, point = FoldProblem(curve.problem), curve["LP1"]
    U = fold.join(point.X, point.parameters)
    X, own = fold.split(U)
    np.testing.assert_array_equal(X, point.X)
    assert own == {"Omega": point.parameters["Omega"]}
    assert fold.unknown_parameters == ("Omega",)
    assert fold.parameters == curve.problem.parameters
    assert fold.describe()["curve"] == {"of": "FoldProblem", "in": "Omega"}


@pytest.mark.parametrize("kind", [FoldProblem, PeriodDoublingProblem, GrazingProblem, AmplitudeExtremum])
def test_second_parameter_equal_to_the_first(curve, kind):
    problem = kind(curve.problem, "Omega")
    with pytest.raises(ValueError, match=f"{kind.__name__} in Omega cannot be followed in Omega again; choose"):
        trace(problem, "Omega", (0.8, 0.9), curve["LP1"])


@pytest.mark.parametrize("kind", [FoldProblem, PeriodDoublingProblem, GrazingProblem, AmplitudeExtremum])
def test_a_parameter_that_is_no_field(curve, kind):
    with pytest.raises(KeyError, match="SpurPair has no parameter 'zetta'; did you mean 'zeta'"):
        kind(curve.problem, "zetta")
    with pytest.raises(KeyError, match="SpurPair has no parameter 'zetta'; did you mean 'zeta'"):
        trace(kind(curve.problem), "zetta", (0.1, 0.2), curve["LP1"])


@pytest.mark.parametrize("measure", ["pp2", "max", "mean", "H0", "H7", "H1/2", "Hx", ""])
def test_a_peak_of_no_such_amplitude(curve, measure):
    with pytest.raises(ValueError, match="need 'rms' or 'H1' to 'H6'"):
        AmplitudeExtremum(curve.problem, measure=measure)


@pytest.mark.slow
def test_a_fold_followed_in_a_parameter_that_is_not_the_frequency():
    """Folds in the load amplitude, followed in the damping at fixed Omega: the parameter of a fold can be any."""
    balance = HarmonicBalance(Duffing(k3=0.1), 3)
    curve = trace(balance, "F", (0.02, 0.6), at={"Omega": 1.15})
    folds = [p for p in curve.special if p.kind == "LP"]
    assert len(folds) == 2
    followed = trace(FoldProblem(balance, "F"), "zeta", (0.05, 0.03), folds[0])
    assert followed.status == "reached_end" and set(followed.tracked) == {"F"}
    for i in (0, len(followed) // 2, -1):
        here = {**Duffing().parameters, "zeta": followed.values[i], "F": followed.tracked["F"][i], "Omega": 1.15}
        J = balance.evaluate(followed.X[i], **here)[1]
        assert np.linalg.svd(J)[1][-1] < 1e-7
