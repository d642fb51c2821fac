"""Verdicts on stability against motions that are computed without harmonic balance: exact flow between contacts."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy
from machines import single_mass

import hbgear as hb
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.results.reliability import stable_on_both_sides, unexplained_changes
from hbgear.continuation.results.stability import stability_codes
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.harmonic.equations.motion import shortest_intervals
from hbgear.harmonic.multipliers.multiplier_error import (
    count_beyond,
    difference_of,
    estimate_multiplier_error,
    largest_shift,
)
from hbgear.harmonic.stability.exact_motion import refine_motion
from hbgear.harmonic.stability.parity import Parity, half_integer_sign
from hbgear.time.integration import state_of
from studies.random.stops import Stop, compared


@pytest.mark.slow
def test_points_between_two_folds_of_a_stop_are_unstable():
    """Ten rows whose multipliers are a complex pair with 16 harmonics, and 1.118 to 1.025 of the exact motion."""
    stop = Stop(0.04, 200.0, 0.5, 0.1)
    curve = hb.trace(hb.HarmonicBalance(stop.system, 16), "Omega", (1.7, 1.0), special=False)
    found = compared(stop, curve, 5)
    decided = [one for one in found if one.verdict != "undecided"]
    assert len([one for one in found if one.right]) >= 15 and len(found) - len(decided) <= 1
    assert not [one for one in decided if one.verdict != one.right and one.right]
    assert max(one.off - 3 * one.error for one in decided if np.isfinite(one.error)) <= 1e-7


@pytest.mark.slow
def test_errors_of_multipliers_hold_on_a_curve_that_is_steep_in_omega():
    """The motion changes by a quarter of its size within 2e-5, and refined motions were compared 2e-5 away from Omega.

    Stated errors were up to 500 times too small, where the difference of the multipliers changes its sign.
    """
    stop = Stop(0.04, 16.237767391887218, 0.0, 0.1)
    curve = hb.trace(hb.HarmonicBalance(stop.system, 16), "Omega", (0.8067, 0.806), special=False, cover=False)
    held = [one for one in compared(stop, curve, 3) if one.right]
    assert len(held) > 15 and all(one.verdict == "stable" == one.right for one in held)
    assert np.mean([one.off > 1e-6 for one in held]) > 0.5
    assert max(one.off - 3 * one.error for one in held) <= 1e-7


@pytest.mark.slow
def test_errors_of_multipliers_do_not_vanish_where_their_difference_changes_its_sign():
    """One point had a fifth of its error: the difference changes by 0.1 from point to point, and was small there."""
    elements = [hb.Element([1.0], hb.Unilateral(k=k, gap=gap)) for k, gap in ((100.0, 0.554), (1.0, -0.06))]
    system = hb.System([[1.0]], [[0.148]], [[0.246]], elements, hb.Load(cosine={1: [0.17]}))
    curve = hb.trace(hb.HarmonicBalance(system, 16), "Omega", (0.9, 0.75), special=False, cover=False)
    exact = []
    for X, Omega in zip(curve.X, curve.values.tolist(), strict=True):
        try:
            exact.append(np.abs(refine_motion(curve.problem, X, {"Omega": Omega}).multipliers).max())
        except NoConvergence:
            exact.append(np.nan)
    off, stated = np.abs(np.abs(curve.multipliers).max(axis=1) - exact), curve.modulus_error + 1e-7
    known = np.isfinite(off) & np.isfinite(stated)
    assert known.sum() > 25 and np.all(off[known] < 3 * stated[known])
    assert off[known].max() > 1e-3


@pytest.mark.slow
def test_a_hard_stop_is_decided_right_or_not_at_all():
    """k = 1e5, where multipliers of the balance are wrong by 3.5 though its motion seems accurate to 1e-4.

    From a point next to the grazing, Newton's method in the contact instants goes to the motion without contact. Where
    it converges at another Omega only, the stated error covers the difference.
    """
    stop = Stop(0.2, 1e5, 0.5, 0.1)
    problem = hb.HarmonicBalance(stop.system, 16)
    start = problem.start(Omega=2.2)  # with a start the curve is not traced in contact instants
    curve = hb.trace(problem, "Omega", (2.2, 0.9), start=start, special=False)
    found = compared(stop, curve, 1)
    held = [one for one in found if one.right]
    assert held and all(one.verdict in (one.right, "undecided") for one in held)
    assert max(one.off - 3 * one.error for one in held if one.verdict != "undecided") <= 1e-7


@pytest.mark.parametrize(("k", "refined"), [(1.0, False), (1e4, True)])
def test_short_contacts_are_refined_only_where_they_can_change_the_stability(k, refined):
    """A motion that just touches a stop with 8 harmonics: multipliers at 0.73, exact only for the hard stop."""
    stop = Stop(0.2, k, 0.5, 0.1)
    problem = hb.HarmonicBalance(stop.system, 8)
    X, Omega = np.zeros(17), 1.0
    X[1], X[2] = 0.0, 0.5 * (1 + 1e-3 / np.sqrt(k))
    seen = problem.observe_many(X[None], "Omega", np.array([Omega]))[0] | {"determinant": 0}
    problem.verify_stability(CurveSolutions(X[None], "Omega", np.array([Omega]), {}), [seen])
    assert shortest_intervals(problem.compiled({}), X[None])[0] < np.pi / 8
    assert (seen["modulus_error"] >= 1e-7) == refined


@pytest.mark.parametrize(("k", "gap", "q", "v"), [(5.5e4, 0.0, -1.9e-2, 1.3e-4), (9.6e4, 0.5, 0.4998, 1.9e-2)])
def test_contacts_shorter_than_a_step_of_the_reference_are_found(k, gap, q, v):
    """The exact march from contact to contact ends where a Runge-Kutta method of small steps does."""
    stop, Omega = Stop(0.04, k, gap, 0.1), 1.1
    end, transition, count = stop.march(q, v, Omega)

    def rates(t, y):
        return [y[1], -0.04 * y[1] - y[0] - k * max(y[0] - gap, 0.0) + 0.1 * np.cos(Omega * t)]

    period, most = 2 * np.pi / Omega, 0.2 / np.sqrt(k)
    seen = scipy.integrate.solve_ivp(rates, (0, period), [q, v], "DOP853", rtol=1e-10, atol=1e-12, max_step=most)
    assert count >= 2 and end == pytest.approx(seen.y[:, -1], abs=1e-8)
    assert np.linalg.det(transition) == pytest.approx(np.exp(-0.04 * period), rel=1e-10)


def test_an_exact_motion_on_the_other_side_of_a_fold_is_not_used():
    """8e-6 before the fold Newton in the contact instants ends at the unstable motion, with the multiplier 1.599."""
    stop, Omega = Stop(0.04, 42.81332398719393, 0.0, 0.1), 0.5633671818937167
    problem = hb.HarmonicBalance(stop.system, 32)
    curve = hb.trace(problem, "Omega", (0.64, Omega), cover=False, special=False, accuracy=None)
    X = curve.X[-1]
    sign = int(np.linalg.slogdet(problem.linearise(X, "", Omega=Omega).dR_dX)[0])
    observed = {
        "multipliers": curve.multipliers[-1],
        "error": curve.error[-1],
        "regime": curve.regime[-1],
        "determinant": sign,
        "contradicts": True,
    }
    problem.verify_stability(CurveSolutions(X[None], "Omega", np.array([Omega]), {}), [observed])
    finer = problem.with_order(1, 256)
    multipliers = finer.multipliers(solve(finer, finer.resized(X), {"Omega": Omega}).X, Omega=Omega)
    assert abs(multipliers[0].imag) > 0.5
    assert np.sort_complex(observed["multipliers"]) == pytest.approx(np.sort_complex(multipliers), abs=3e-3)


@pytest.mark.parametrize("apart", [0.1, 1e-2, 1e-4])
def test_the_error_of_a_nearly_double_multiplier_covers_the_real_pair(apart):
    """Trace and determinant of a pair, the trace changed so that a complex pair becomes real."""
    mean, product = 0.95, 0.95**2 + apart**2
    mu = np.roots([1.0, -2 * mean, product])
    trace = 2 * np.sqrt(product) + 0.5 * apart**2
    true = np.roots([1.0, -trace, product])
    half = np.roots([1.0, -(2 * mean + 0.5 * (2 * mean - trace)), product])  # a motion with half that error, elsewhere
    error = estimate_multiplier_error(mu[None], difference_of(mu[None], half[None]))[0]
    assert np.isreal(true).all() and abs(np.abs(mu).max() - true.max()) <= error
    assert abs(np.abs(mu).max() - np.abs(half).max()) < 1e-12  # the difference of moduli says nothing


def test_an_error_is_that_of_the_multiplier_itself():
    """A small multiplier that changes by 0.1 does not spread an error of this size to one that changes by 1e-3."""
    mu, other = np.array([[0.9, -0.4]]), np.array([[0.901, -0.5]])
    error = float(estimate_multiplier_error(mu, difference_of(mu, other))[0])
    assert 1e-3 < error < 0.1  # 0.47 if the error were that of the other multiplier
    swapped = float(estimate_multiplier_error(-mu, difference_of(-mu, -other))[0])
    assert swapped == pytest.approx(error, rel=1e-12)


def test_a_difference_that_vanishes_by_chance_is_a_share_of_the_largest():
    """One multiplier agrees, the other changes by 0.01: the error of the first is 0.3 of that, times 3."""
    mu, other = np.array([[0.9, 0.3]]), np.array([[0.9, 0.31]])
    residual = difference_of(mu, other).residual[0]
    np.testing.assert_allclose(residual, [0.3 * 0.01 * 0.6, 0.01 * 0.6], rtol=0.05)
    error = float(estimate_multiplier_error(mu, difference_of(mu, other))[0])
    assert error == pytest.approx(3 * 0.3 * 0.01, rel=0.05)


def test_a_root_moves_by_the_largest_shift():
    """x max(x, d - x) = epsilon, by both branches of the formula and at their common end."""
    for d, x in ((1.0, 0.2), (1.0, 0.5), (0.1, 0.3), (0.0, 0.2)):
        assert largest_shift(x * max(x, d - x), d) == pytest.approx(x, rel=1e-12)


def test_multipliers_beyond_the_circle_are_counted():
    mu = np.array([[1.5, -1.2, -1.1, 0.2], [0.9j, -0.9j, 1.1, 0.0], [1.2j, -1.2j, -0.5, 0.5]])
    assert count_beyond(mu).tolist() == [[1, 2, 0], [1, 0, 0], [0, 0, 2]]


@pytest.mark.parametrize(
    ("model", "span", "H", "least"),
    [
        (hb.Duffing(), (0.8, 1.6), 7, 3),
        (hb.SpurPair(e=(0.1,)), (2.2, 0.6), 10, 10),
        (hb.gears.DoubleHelicalPair(zeta=0.05), (1.6, 0.4), 8, 0),
    ],
)
def test_both_determinants_have_the_parity_of_the_multipliers(model, span, H, least):
    """At every row that is not next to a special point, and with one multiplier more beyond +1 they do not."""
    curve = hb.trace(hb.HarmonicBalance(model, H), "Omega", span, special=False, accuracy=None)
    parity = Parity.of(curve.problem, CurveSolutions(curve.X, "Omega", curve.values, {}))
    odd, checked = 0, 0
    for i in range(len(curve)):
        mu, here = curve.multipliers[i], curve.parameters_at(i)
        if min(np.abs(mu - 1).min(), np.abs(mu + 1).min()) < 0.03:
            continue
        assert parity.agrees(curve.problem, curve.X[i], here, mu), curve.values[i]
        more = np.where(np.arange(len(mu)) == np.abs(mu).argmin(), 1.5, mu)
        assert not parity.agrees(curve.problem, curve.X[i], here, more)
        checked, odd = checked + 1, odd + int(count_beyond(mu)[0] % 2 or count_beyond(mu)[1] % 2)
        beyond = 1 - 2 * (count_beyond(mu)[1] % 2)
        assert half_integer_sign(curve.problem, curve.X[i], here) == beyond
    assert checked > 20 and odd >= least


def test_small_multipliers_that_are_rounding_are_no_period_doublings():
    """x'' + 0.1 x' - 2 x - 0.1 x^3 = 0.05 cos: about the saddle both multipliers are real, with product exp(-0.1 T)."""
    saddle = single_mass(hb.Cubic(k3=-0.1, k1=0.5), F=0.05, k=-2.5)
    with warnings.catch_warnings(action="error"):
        curve = hb.trace(hb.HarmonicBalance(saddle, 12), "Omega", (0.3, 0.1), start=np.zeros(25))
        slow = hb.trace(hb.HarmonicBalance(saddle, 12), "Omega", (0.01, 0.005), start=np.zeros(25))
    assert not curve.special and set(curve.stability) == {"unstable"}
    exact = np.exp((-0.05 + np.sqrt(2.0025)) * 2 * np.pi / curve.values)
    np.testing.assert_allclose(np.abs(curve.multipliers).max(axis=1), exact, rtol=1e-2)
    assert np.isfinite(slow.multipliers).all() and set(slow.stability) == {"unstable"} and not slow.special


@pytest.mark.slow
def test_two_multipliers_that_pass_together_have_a_doubling_each():
    """A planetary set: multipliers 1e-5 apart pass -1 within 4e-7 of Omega, and a slow sweep leaves there."""
    planets = hb.gears.PlanetarySet(
        26,
        38,
        102,
        planets=4,
        torque=377.0804699071937,
        zeta=0.0638684660852385,
        zeta_b=0.03993897318124806,
        b_sp=3.9700532168119484e-05,
        b_rp=1.7135056004278744e-05,
        eps_sp=(0.25911137806391893, 0.05),
        eps_rp=(0.09633942894663837, 0.04),
        e_sp=(1.4453354116209893e-06,),
        e_rp=(2.0164792541625583e-06,),
    )
    curve = hb.trace(hb.HarmonicBalance(planets, 8), "Omega", (1.23, 1.262))
    near = [p for p in curve.special if p.kind == "PD" and abs(p.parameters["Omega"] - 1.236475) < 2e-5]
    assert len(near) == 2
    (fall,) = [jump for jump in curve.jumps() if jump.direction < 0]
    assert fall.label in [p.label for p in near]
    counts = count_beyond(curve.multipliers, 1e-4)[:, 1]
    first, last = sorted(p.index for p in near)
    assert sorted((counts[first - 1], counts[last + 1])) == [0, 2]


def test_contradictions_of_a_branch_are_warnings():
    """A curve that loses a fold from its special points, or a verdict, says so."""
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    assert curve.warnings == ()
    less = replace(curve, special=curve.special[1:], jump_records=())
    assert "without a special point" in less.warnings[0]
    mu = curve.multipliers.copy()
    mu[curve["LP1"].index + 1 : curve["LP2"].index] *= 0.1
    assert "both sides of LP1, LP2 are stable" in replace(curve, multipliers=mu).warnings
    codes = stability_codes(curve.multipliers, curve.modulus_error)
    marks = {p.index: [p.kind] for p in curve.special}
    assert not unexplained_changes(codes, marks) and not stable_on_both_sides(codes, marks)


@pytest.mark.parametrize(("first", "warned"), [(1.0008, False), (1.1, True)])
def test_the_first_point_of_a_branch_is_a_special_point(first, warned):
    """The multiplier +1 of a branch point is 1 + 8e-4 by truncation, which is no loss of stability behind it."""
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 0.9))
    mu = curve.multipliers.copy()
    mu[0] = first, 0.5
    warnings = " ".join(replace(curve, multipliers=mu).warnings)
    assert ("stability changes between Omega = 0.8 " in warnings) is warned


def test_a_special_point_located_with_more_harmonics_explains_a_change_beyond_its_point():
    """The change of stability lies where the point is, two rows after the row of the coarse balance."""
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.8, 1.6))
    row, mu = curve["LP2"].index + 3, curve.multipliers.copy()
    mu[row + 3 :] *= -10.0

    def warned(Omega):
        special = replace(curve["LP1"], kind="PD", label="PD1", index=row, parameters={"Omega": Omega})
        changed = replace(curve, multipliers=mu, special=(*curve.special, special), jump_records=())
        return f"between Omega = {curve.values[row + 2]:.9g}" in " ".join(changed.warnings)

    assert not warned(0.5 * (curve.values[row + 2] + curve.values[row + 3]))
    assert warned(0.5 * (curve.values[row + 1] + curve.values[row + 2]))


@pytest.mark.slow
def test_doubt_about_a_law_that_is_not_piecewise_linear_is_refined_with_more_harmonics():
    """A cubic spring and a stop in one element: no exact motion; every row is contradicted, and so refined."""
    law = hb.mechanics.Parallel((hb.Cubic(0.0, 0.3), hb.Unilateral(2.0, 0.5)))
    model = single_mass(law, F=0.5)
    curve = hb.trace(hb.HarmonicBalance(model, 5), "Omega", (0.5, 2.5), special=False)
    assert curve.status.complete
    problem, rows = curve.problem, range(0, len(curve), len(curve) // 5)
    for point in (curve[i] for i in rows):
        seen = problem.observe(point.X, True, **point.parameters) | {"determinant": 0, "contradicts": True}
        rest = {name: value for name, value in point.parameters.items() if name != "Omega"}
        problem.verify_stability(
            CurveSolutions(point.X[None], "Omega", np.array([point.parameters["Omega"]]), rest), [seen]
        )
        shot = hb.time.shoot(model, point.parameters["Omega"], state_of(problem, point.X, **point.parameters))
        assert np.abs(seen["multipliers"]).max() == pytest.approx(np.abs(shot.multipliers).max(), abs=1e-3)


def test_multipliers_of_a_motion_without_contact_have_no_error_and_no_warning():
    """A stop that is not reached: the motion is that of the linear oscillator, |mu| = exp(-zeta omega_0 T)."""
    model = single_mass(hb.Unilateral(2.0, 5.0), F=0.1)
    problem = hb.HarmonicBalance(model, 5)
    X = problem.start(Omega=0.5)
    seen = problem.observe(X, True, Omega=0.5) | {"determinant": 1, "contradicts": True}
    with warnings.catch_warnings(action="error"):
        problem.verify_stability(CurveSolutions(X[None], "Omega", np.array([0.5]), {}), [seen])
    assert seen["error"] == 0 and seen["modulus_error"] <= 1e-7
    np.testing.assert_allclose(np.abs(seen["multipliers"]), np.exp(-0.05 * 2 * np.pi / 0.5), rtol=1e-9)
