"""Special points of traced curves: stored values, location, and curves without special points."""

import numpy as np
import pytest
from machines import single_mass

from hbgear import (
    Backlash,
    Cubic,
    Duffing,
    Element,
    HarmonicBalance,
    Load,
    SpurPair,
    Status,
    StepControl,
    System,
    Unilateral,
    follow,
    trace,
)
from hbgear.continuation import FoldProblem
from hbgear.continuation.solvers.newton import solve
from hbgear.gears import DoubleHelicalPair
from hbgear.harmonic import GrazingProblem, PeriodDoublingProblem
from hbgear.mechanics import model
from hbgear.mechanics.series.fourier import resize

KINDS = ("LP", "PD", "NS", "BP", "GR", "CP")
STRONG = SpurPair(e=(0.10,))


def frequency(point):
    return point.parameters["Omega"]


def pair_of_oscillators(coupling=0.1):
    """Return two equal Duffing oscillators with a weak coupling spring and equal loads."""
    K = np.eye(2) + coupling * np.array([[1.0, -1.0], [-1.0, 1.0]])
    elements = [Element([1.0, 0.0], Cubic(1.0)), Element([0.0, 1.0], Cubic(1.0))]
    return System(np.eye(2), 0.1 * np.eye(2), K, elements, Load(cosine={1: [1.0, 1.0]}))


@pytest.fixture(scope="module")
def strong():
    """Return a curve with period doublings, folds and a grazing contact: PD1 PD2 LP1 LP2 GR1."""
    return trace(HarmonicBalance(STRONG, 12), "Omega", (2.2, 0.5))


@pytest.fixture(scope="module")
def pair():
    return trace(HarmonicBalance(pair_of_oscillators(), 9), "Omega", (0.5, 4.0))


# ---- stored values


def test_labels_are_numbered_in_the_order_of_the_curve(strong):
    assert [p.label for p in strong.special] == ["PD1", "PD2", "LP1", "LP2", "GR1"]
    assert [p.index for p in strong.special] == sorted(p.index for p in strong.special)


def test_stored_values_of_each_case(strong):
    for point in strong.special:
        assert point.kind in KINDS and point.label.startswith(point.kind)
        assert point.located and point.residual < 1e-10
        assert np.array_equal(strong.X[point.index], point.X)
        assert strong.values[point.index] == frequency(point)
        residual = strong.problem.residual(point.X, **point.parameters)
        assert np.linalg.norm(residual) < 1e-9
        low, high = sorted(point.interval)
        if point.kind != "LP":  # the curve turns there: a fold lies outside of its interval
            assert low < frequency(point) < high
        assert high - low < 0.15


def test_a_label_that_does_not_exist_lists_those_that_do(strong):
    with pytest.raises(KeyError, match="no special point 'NS1' on this branch; it has: PD1, PD2, LP1, LP2, GR1"):
        strong["NS1"]


@pytest.mark.parametrize("label", ["PD1", "PD2", "LP1", "LP2", "GR1"])
def test_any_label_is_a_start(strong, label):
    """A trace in the frequency or the damping starts with the motion of the special point, to 1e-9."""
    for name, span in (("Omega", (0.45, 2.3)), ("zeta", (0.05, 0.02)), ("zeta", (0.05, 0.06))):
        branch = trace(strong.problem, name, span, strong[label], stability=False, steps=StepControl(max_points=8))
        np.testing.assert_allclose(branch.X[0], strong[label].X, rtol=0, atol=1e-9)
        assert branch.status in ("max_points", "left_span", "reached_end") and branch.residual.max() < 1e-10


def test_special_points_can_be_left_out():
    curve = trace(HarmonicBalance(SpurPair(), 8), "Omega", (1.5, 0.6), stability=False, special=False)
    assert curve.special == () and np.any(np.diff(np.sign(np.diff(curve.values))))


def test_without_multipliers_neither_pd_nor_ns(strong):
    curve = trace(strong.problem, "Omega", (2.2, 0.5), stability=False)
    assert [p.kind for p in curve.special] == ["LP", "LP", "GR"]
    for label in ("LP1", "LP2", "GR1"):
        assert frequency(curve[label]) == pytest.approx(frequency(strong[label]), rel=0, abs=1e-9)


# ---- folds


def test_folds_are_located_to_rounding(strong):
    """At each fold dR/dX is singular and the curve turns in Omega."""
    for label in ("LP1", "LP2"):
        point = strong[label]
        values = np.linalg.svd(strong.problem.evaluate(point.X, **point.parameters)[1])[1]
        assert values[-1] < 1e-9 * values[0]
        i = point.index
        assert (strong.values[i - 1] - point.parameters["Omega"]) * (strong.values[i + 1] - strong.values[i]) > 0


def test_the_same_points_for_all_steps(strong):
    """A trace from the other end of the span, with other points and brackets, agrees to 1e-8."""
    back = trace(strong.problem, "Omega", (0.5, 2.2))
    assert [p.kind for p in back.special] == [p.kind for p in strong.special][::-1]
    found, expected = ([frequency(p) for p in branch.special] for branch in (back, strong))
    np.testing.assert_allclose(found, expected[::-1], rtol=0, atol=1e-8)


def test_folds_of_sampled_forces_by_bracket():
    """Sampled forces have no second derivatives: folds are bracketed roots of the tangent, accurate to 1e-5."""
    settings = {"sampled": True, "samples": 4096}
    problem = HarmonicBalance(SpurPair(), 10, **settings)
    assert not problem.smooth
    curve = trace(problem, "Omega", (1.5, 0.6), stability=False)
    exact = trace(HarmonicBalance(SpurPair(), 10), "Omega", (1.5, 0.6), stability=False)
    found = [(p.label, p.located) for p in curve.special if p.kind == "LP"]
    assert found == [("LP1", True), ("LP2", True)]
    for label in ("LP1", "LP2"):
        assert frequency(curve[label]) == pytest.approx(frequency(exact[label]), rel=0, abs=1e-5)
        assert frequency(curve[label]) != frequency(exact[label])


def test_no_folds_on_a_curve_without():
    curve = trace(HarmonicBalance(SpurPair(zeta=0.2), 12), "Omega", (1.5, 0.3))
    assert curve.status == "reached_end"
    assert [p.kind for p in curve.special if p.kind != "GR"] == []


# ---- period doublings


def test_period_doublings_of_a_smooth_law():
    """An oscillator with periodic stiffness, whose motion is exact, has a multiplier of -1 to 1e-7."""
    model = SpurPair(F_m=0.1, eps=(0.3,), e=())
    curve = trace(HarmonicBalance(model, 16), "Omega", (2.3, 1.8))
    assert [p.label for p in curve.special] == ["PD1", "PD2"]
    for point in curve.special:
        assert np.abs(point.multipliers + 1).min() < 1e-7
    inside = (curve.values < frequency(curve["PD1"]) - 1e-6) & (curve.values > frequency(curve["PD2"]) + 1e-6)
    outside = (curve.values > frequency(curve["PD1"]) + 1e-6) | (curve.values < frequency(curve["PD2"]) - 1e-6)
    assert not curve.stable[inside].any() and curve.stable[outside].all()


def test_period_doublings_of_sampled_forces():
    """A bracketed root of det(Phi + 1): a multiplier of the traced motion is -1 to 1e-5."""
    curve = trace(HarmonicBalance(STRONG, 8, sampled=True, samples=512), "Omega", (2.2, 1.8))
    assert [p.label for p in curve.special] == ["PD1"]
    assert curve["PD1"].located
    assert np.abs(curve["PD1"].multipliers + 1).min() < 1e-5


# ---- branch points


def test_branch_point_where_two_equal_halves_part(pair):
    """Perturbations of the difference obey y'' + 0.1 y' + (1 + 2 c + 3 x^2) y = 0, with mu = +1 at BP."""
    points = [p for p in pair.special if p.kind == "BP"]
    assert len(points) == 2 and all(p.located for p in points)
    for point in points:
        # the difference is singular there: a residual of 1e-12 determines it to about 1e-8
        np.testing.assert_allclose(point.coefficients(0), point.coefficients(1), rtol=0, atol=1e-7)
        n = pair.X.shape[1] // 2
        J = pair.problem.evaluate(point.X, **point.parameters)[1]
        difference = J[:n, :n] - J[:n, n:]
        values = np.linalg.svd(difference)[1]
        assert values[-1] < 1e-7 * values[0]
        assert np.abs(point.multipliers - 1).min() < 1e-4


def test_symmetry_breaking_of_a_single_oscillator():
    """Motions have odd harmonics only; the decoupled block of even harmonics is singular at BP."""
    problem = HarmonicBalance(Duffing(zeta=0.1, k3=1.0, F=10.0), 15)
    curve = trace(problem, "Omega", (1.5, 1.8), stability=False)
    assert [p.label for p in curve.special] == ["BP1"]
    point = curve["BP1"]
    k = np.concatenate([[0], np.repeat(np.arange(1, 16), 2)])
    even = k % 2 == 0
    np.testing.assert_allclose(point.X[even], 0, atol=1e-8)
    values = np.linalg.svd(problem.evaluate(point.X, **point.parameters)[1][np.ix_(even, even)])[1]
    assert values[-1] < 1e-8 * values[0]


# ---- grazing


def test_grazing_names_the_element():
    """Strong excitation with contact loss and contact on the back: extrema at GR equal the breakpoints to 1e-7."""
    curve = trace(HarmonicBalance(SpurPair(F_m=0.1, e=(0.5,)), 8), "Omega", (1.5, 0.3), stability=False)
    grazing = [p for p in curve.special if p.kind == "GR"]
    assert {p.note for p in grazing} >= {"lowest of gap at 1", "lowest of gap at -1"}
    for point in grazing:
        d = point.samples(count=100000)[1]
        end, corner = point.note.split()[0], float(point.note.split()[-1])
        extrema = d[(d - np.roll(d, 1)) * (np.roll(d, -1) - d) < 0]
        nearest = extrema[np.argmin(np.abs(extrema - corner))]
        assert {"lowest": d.min(), "highest": d.max(), "inner": nearest}[end] == pytest.approx(corner, abs=1e-7)
        assert (curve.regime[point.index - 1, 0] != curve.regime[point.index + 1, 0]) == (end != "inner")


def test_elements_that_graze_together_are_one_point():
    K = np.eye(2) + 0.1 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    stop = Unilateral(2.0, 1.0)
    elements = [Element([1.0, 0.0], stop, name="left"), Element([0.0, 1.0], stop, name="right")]
    system = System(np.eye(2), 0.1 * np.eye(2), K, elements, Load(cosine={1: [0.3, 0.3]}))
    curve = trace(HarmonicBalance(system, 8), "Omega", (0.5, 0.9), stability=False)
    assert [p.kind for p in curve.special] == ["GR"]
    assert curve["GR1"].note == "highest of left at 1, highest of right at 1"
    # without contact both move as one linear oscillator: 0.3 = |1 - w^2 + 0.1 i w|
    w = frequency(curve["GR1"])
    assert abs(1 - w**2 + 0.1j * w) == pytest.approx(0.3, abs=1e-9)


def test_no_grazing_without_corners():
    assert [p.kind for p in trace(HarmonicBalance(Duffing(), 5), "Omega", (0.5, 1.6)).special] == ["LP", "LP"]


# ---- curves of special points


def test_a_cusp_is_labelled_on_a_fold_curve():
    problem = HarmonicBalance(SpurPair(), 10)
    start = trace(problem, "Omega", (1.3, 0.6), at={"zeta": 0.115}, stability=False)["LP1"]
    folds = trace(FoldProblem(problem), "zeta", (0.115, 0.125), start)
    assert folds.status == "left_span" and [p.label for p in folds.special] == ["CP1"]
    cusp = folds["CP1"]
    assert cusp.located and cusp.parameters["zeta"] == folds.values.max()
    assert set(folds.tracked) == {"Omega"}
    for i in (0, len(folds) // 2, -1):
        J = problem.evaluate(folds.X[i], **folds.parameters_at(i))[1]
        assert np.linalg.svd(J)[1][-1] < 1e-8


def test_a_curve_of_period_doublings_turns_where_they_meet(strong):
    """Both doublings of the response, continued in the damping, form one curve, which turns where they vanish."""
    curve = trace(PeriodDoublingProblem(strong.problem), "zeta", (0.05, 0.4), strong["PD1"])
    assert curve.status == "left_span" and [p.label for p in curve.special] == ["LP1"]
    assert curve.tracked["Omega"][-1] == pytest.approx(frequency(strong["PD2"]), rel=0, abs=1e-6)
    top = curve["LP1"].parameters["zeta"]
    Omega = frequency(curve["LP1"])
    for zeta, count in ((0.99 * top, 2), (1.01 * top, 0)):
        response = trace(strong.problem, "Omega", (2.2, Omega - 0.1), at={"zeta": zeta})
        assert sum(p.kind == "PD" for p in response.special) == count


def test_a_curve_of_grazing_contacts(strong):
    """Onset of contact loss against the damping: the minimum of the motions along the curve equals b to 1e-7."""
    which = list(strong.problem.clearance_names).index(strong["GR1"].note)
    curve = trace(GrazingProblem(strong.problem, which=which), "zeta", (0.05, 0.08), strong["GR1"])
    assert curve.status == "reached_end"
    for i in (0, len(curve) // 2, -1):
        assert curve[i].samples(count=50000)[1].min() == pytest.approx(1.0, abs=1e-7)


# ---- curves without special points


def test_a_contact_of_any_name_is_followed():
    """Names with commas were taken for two names. A linear motion touches the stop: 0.3 = |1 - w^2 + 0.1 i w| gap."""

    @model
    def stop(gap: float = 1.0) -> System:
        law = Element([1.0], Unilateral(2.0, gap), name="stop, left")
        return System([[1.0]], [[0.1]], [[1.0]], [law], Load(cosine={1: [0.3]}))

    curve = trace(HarmonicBalance(stop(), 4), "Omega", (0.5, 0.9), stability=False)
    contacts = follow(curve, "GR1", "gap", (1.0, 1.5))
    w = contacts.tracked["Omega"][-1]
    assert contacts.values[-1] == 1.5 and abs(1 - w**2 + 0.1j * w) * 1.5 == pytest.approx(0.3, abs=1e-9)


@pytest.mark.parametrize("H", [15, 16, 21])
def test_a_motion_of_the_single_period_in_a_longer_basis_merges_with_nothing(H):
    """Its subharmonics are rounding errors, and their sign changes are not detected as a merger."""
    problem = HarmonicBalance(Duffing(zeta=0.1, k3=1.0, F=10.0), H, nu=3)
    assert trace(problem, "Omega", (3.0, 12.0), stability=False).status == "reached_end"


def test_a_double_basis_finds_the_points_of_the_single_one():
    single = trace(HarmonicBalance(SpurPair(), 10), "Omega", (1.5, 0.6), stability=False)
    double = trace(HarmonicBalance(SpurPair(), 20, nu=2), "Omega", (1.5, 0.6), stability=False)
    assert double.status == "reached_end"
    assert [p.label for p in double.special] == [p.label for p in single.special]
    for a, b in zip(single.special, double.special, strict=True):
        assert frequency(b) == pytest.approx(frequency(a), rel=0, abs=1e-8)


def test_more_harmonics_do_not_add_points():
    """The equations of motion have two folds, and so has every truncation."""
    for H in (6, 24):
        curve = trace(HarmonicBalance(SpurPair(), H), "Omega", (1.5, 0.6), stability=False)
        assert sorted(p.kind for p in curve.special) == ["GR", "GR", "LP", "LP"], H


def test_a_rigid_gap_has_no_corner_to_graze():
    curve = trace(HarmonicBalance(SpurPair(b=0.0), 3), "Omega", (1.5, 0.5))
    assert curve.special == () and curve.stable.all()


def test_points_can_be_refined_with_more_harmonics(strong):
    """Newton's method needs at most four iterations from the motion padded with zeros."""
    fine = HarmonicBalance(STRONG, 60)
    for label, kind in (("LP1", FoldProblem), ("PD1", PeriodDoublingProblem)):
        point = strong[label]
        U = np.append(resize(point.X, 60), frequency(point))
        solution = solve(kind(fine), U, STRONG.parameters)
        assert solution.iterations <= 4
        assert solution.X[-1] == pytest.approx(frequency(point), rel=0, abs=1e-5)


def test_clearances_are_named():
    system = single_mass(Backlash(1.0), F=0.05, mean=0.1, k=0.0, name="gap")
    assert HarmonicBalance(system, 3).clearance_names == (
        "lowest of gap at -1",
        "highest of gap at -1",
        "lowest of gap at 1",
        "highest of gap at 1",
    )


# ---- pairs of special points on one step


@pytest.fixture(scope="module")
def cusp():
    """Return the damping of the spur pair at which its folds meet, near (Omega, zeta) = (0.857221, 0.118007)."""
    curve = trace(HarmonicBalance(SpurPair(), 16), "Omega", (1.0, 0.6))
    return follow(curve, "LP1", "zeta", (0.05, 0.2))["CP1"].parameters["zeta"]


@pytest.mark.parametrize("less", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("span", [(1.5, 0.3), (0.3, 1.5)])
def test_folds_just_below_their_cusp(cusp, less, span):
    """At a relative distance `less` below the cusp they are 0.205 less^(3/2) apart (normal form): 2e-4 to 6e-9."""
    curve = trace(HarmonicBalance(SpurPair(zeta=cusp * (1 - less)), 16), "Omega", span)
    first, second = (p for p in curve.special if p.kind == "LP")
    assert first.located and second.located
    assert abs(frequency(first) - frequency(second)) == pytest.approx(0.205 * less**1.5, rel=2e-2)
    above = trace(HarmonicBalance(SpurPair(zeta=cusp * (1 + less)), 16), "Omega", span)
    assert not any(p.kind == "LP" for p in above.special)


@pytest.mark.parametrize("steps", [StepControl(), StepControl(max_step=0.03)], ids=["usual", "short"])
@pytest.mark.parametrize(("zeta", "expected"), [(0.12, (0.336273, 0.337659)), (0.1205, (0.336781, 0.337149))])
def test_doublings_closer_than_the_points(zeta, expected, steps):
    """The period-doubled range of the double-helical pair shrinks to a hundredth of a step before it vanishes."""
    problem = HarmonicBalance(DoubleHelicalPair(zeta=zeta), 12)
    curve = trace(problem, "Omega", (0.2, 0.6), steps=steps)
    found = [p for p in curve.special if p.kind == "PD"]
    np.testing.assert_allclose([p.parameters["Omega"] for p in found], expected, atol=1e-6)
    assert all(p.located and np.abs(p.multipliers + 1).min() < 1e-4 for p in found)
    middle, here = 0.5 * (found[0].X + found[1].X), {"Omega": sum(expected) / 2}
    assert np.abs(problem.multipliers(solve(problem, middle, here).X, **here)).max() > 1
    assert trace(HarmonicBalance(DoubleHelicalPair(zeta=0.1207), 12), "Omega", (0.2, 0.6), steps=steps).special == ()


@pytest.mark.parametrize("less", [1e-3, 1e-5, 1e-7])
def test_contact_between_two_points_only(less):
    """A stop just below a resonance peak: (1 - w^2)^2 + (2 zeta w)^2 = (F / gap)^2 at first and last contact."""
    zeta, F = 0.1, 0.3
    gap = F / (2 * zeta * np.sqrt(1 - zeta**2)) * (1 - less)
    system = single_mass(Unilateral(1.0, gap), F=F, c=2 * zeta)
    curve = trace(HarmonicBalance(system, 5), "Omega", (0.5, 1.6))
    expected = np.sqrt(np.roots([1, 4 * zeta**2 - 2, 1 - (F / gap) ** 2]))
    assert [p.kind for p in curve.special] == ["GR", "GR"]
    np.testing.assert_allclose([p.parameters["Omega"] for p in curve.special], np.sort(expected), rtol=1e-7)


def oscillators_with_gaps(count):
    """Return a rotor with equal gaps in x and y and an unbalance; count = 1 models the motion in x alone."""
    one = np.eye(count)
    gaps = [Element(w, Backlash(b=0.5, k=2.0), name=name) for w, name in zip(one, "xy", strict=False)]
    load = Load(cosine={1: one[0]}, sine={1: one[1]} if count > 1 else {}, power=2)
    return System(one, 0.02 * one, one, gaps, load)


def test_an_isotropic_rotor_has_its_branch_points_in_pairs():
    """x and y are uncoupled: two multipliers pass +1 at the branch points of x alone, without a change of sign.

    The points of x alone are located by the determinant, the points of both by multipliers: they differ by the
    truncation error.
    """
    both = trace(HarmonicBalance(oscillators_with_gaps(2), 20), "Omega", (0.5, 2.5))
    alone = trace(HarmonicBalance(oscillators_with_gaps(1), 20), "Omega", (0.5, 2.5))
    assert both.status.complete and [p.label for p in both.special] == [p.label for p in alone.special]
    assert [p.label for p in both.special] == ["GR1", "BP1", "BP2"]
    for label in ("BP1", "BP2"):
        double, single = both[label], alone[label]
        assert double.located and "two multipliers" in double.note
        assert np.sort(np.abs(double.multipliers - 1))[:2].max() < 1e-6
        assert frequency(double) == pytest.approx(frequency(single), abs=1e-5)
    assert both.stable[[0, -1]].all() and not both.stable[(both.values > 0.59) & (both.values < 0.62)].any()


def hard_stops():
    """Return two masses with a stop and a stiff gap: real multipliers pass +1 near their folds."""
    C, K = np.array([[0.1714, -0.0922], [-0.0922, 0.1114]]), np.array([[1.4258, -0.8069], [-0.8069, 0.8069]])
    elements = [
        Element([0.0, 1.0], Unilateral(k=2.2025, gap=0.7689), name="q2"),
        Element([1.0, 0.0], Backlash(b=0.27504, k=54.957), name="q1"),
    ]
    return System(np.diag([0.8534, 1.922]), C, K, elements, Load(cosine={1: [0.13765, 0.0]}))


@pytest.mark.slow
@pytest.mark.parametrize("H", [9, 12, 16])
def test_real_multipliers_that_pass_one_after_the_other_are_no_pair(H):
    curve = trace(HarmonicBalance(hard_stops(), H), "Omega", (2.5, 0.47))
    assert curve.status is not Status.FAILED and len(curve) > 200
    assert not any("two multipliers" in p.note for p in curve.special)
    for p in (p for p in curve.special if p.kind == "NS" and p.located):
        nearest = p.multipliers[np.argmin(np.abs(np.abs(p.multipliers) - 1))]
        assert abs(nearest.imag) > 1e-3


@pytest.mark.parametrize("span", [(0.045, 0.055), (0.055, 0.045)])
def test_a_curve_of_folds_reaches_both_ends_of_a_span_around_its_point(span):
    """The folds at both ends agree with folds of response curves to 1e-8."""
    problem = HarmonicBalance(SpurPair(), 5)
    own = trace(problem, "Omega", (1.0, 0.6), stability=False)
    found = follow(own, "LP1", "zeta", span)
    assert (found.values[0], found.values[-1]) == span and found.status.complete
    assert np.abs(found.tracked["Omega"] - own["LP1"].parameters["Omega"]).min() < 1e-10
    for i in (0, -1):
        curve = trace(problem, "Omega", (1.0, 0.6), at={"zeta": float(found.values[i])}, stability=False)
        assert found.tracked["Omega"][i] == pytest.approx(curve["LP1"].parameters["Omega"], abs=1e-8)


def test_problem_of_a_special_point_has_its_resolution():
    """A fold refined with more harmonics can be given to the methods of its problem, also after loading."""
    curve = trace(HarmonicBalance(SpurPair(zeta=0.02, F_m=0.05, e=(0.08,)), 7), "Omega", (0.7, 0.3))
    for point in (*curve.special, *(jump.before for jump in curve.jumps())):
        motion = point.problem.at_resolution_of(point)
        assert motion is point.problem and len(point.X) == 2 * point.problem.H + 1
        assert np.abs(point.problem.residual(point.X, **point.parameters)).max() < 1e-9
    assert {point.problem.H for point in curve.special} == {7, 14}
