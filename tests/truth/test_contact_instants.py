"""Curves in contact instants against references computed without hbgear, and against closed forms.

The special points of the stop (k = 1000, damping .1, load .3, gap .5) were solved with 30 digits by an independent code
from the same physical model; the folds of the spur pair were enclosed in interval arithmetic.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machines import single_mass
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import hbgear as hb
from hbgear.continuation.events.residual_form import RESIDUAL_FORM_ACCURACY, in_residual_form
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.harmonic.instants.equations import NotPiecewiseLinear
from hbgear.harmonic.instants.special_points.critical import _may_bend

SPECIAL_POINTS = [
    ("GR", 0.6351148661549015, None),
    ("LP", 0.63511556216024336889, (1.0, 0.3718376438922347)),
    ("LP", 0.53922921257049587057, (1.0, 0.31185527980758565)),
    ("GR", 0.5625767552586286, None),
    ("PD", 0.56257718974461716466, (-1.0, -0.32730675499112594)),
    ("PD", 0.61535672072453194588, (-1.0, -0.3602115086455919)),
    ("LP", 0.64218892339878866177, (1.0, 0.37591155742514193)),
    ("LP", 0.63724087535896512535, (1.0, 0.37306654375295933)),
    ("GR", 0.6372408763970063, None),
    ("PD", 0.86396784958531215291, (-1.0, -0.4832372315084473)),
    ("PD", 0.96254908803479464627, (-1.0, -0.5206042191341322)),
    ("LP", 1.731365021391413406, (1.0, 0.6956535187699948)),
    ("LP", 1.2596146258363070128, (1.0, 0.6072479631664087)),
    ("GR", 1.259614665994741, None),
]
"""Kind, Omega and multipliers of all special points from Omega = .5 to 2.2."""


SPECIAL_POINTS_WITHOUT_GAP = [
    ("PD", 1.2561),
    ("PD", 0.9968),
    ("GR", 0.9904),
    ("PD", 0.852),
    ("PD", 0.6948),
    ("GR", 0.6339),
    ("LP", 0.6339),
    ("LP", 0.674),
    ("PD", 0.6381),
    ("PD", 0.5373),
    ("GR", 0.4772),
    ("LP", 0.4772),
    ("LP", 0.5257),
    ("PD", 0.5148),
    ("PD", 0.4407),
]
"""Kind and Omega of all special points for k = 1e4, gap 0, damping .04 and load .1 from Omega = 2.3 to .4."""


def stop(k: float = 1e3, gap: float = 0.5) -> hb.System:
    """Return a mass with a stop."""
    return single_mass(hb.Unilateral(k=k, gap=gap), F=0.3, name="stop")


def two_equal_masses(k: float = 10.0) -> hb.System:
    """Return two coupled masses with equal stops and loads; the symmetric motion is that of one mass."""
    stops = [hb.Element(row, hb.Unilateral(k=k, gap=0.5), name=f"stop {i + 1}") for i, row in enumerate(np.eye(2))]
    K = [[1.5, -0.5], [-0.5, 1.5]]
    return hb.System(np.eye(2), 0.1 * np.eye(2), K, stops, hb.Load(cosine={1: [0.3, 0.3]}))


@pytest.fixture(scope="module")
def curve() -> hb.Branch:
    """Curve of the stop through four grazing points."""
    return hb.trace(hb.ContactInstants(stop(), 32), "Omega", (0.5, 2.2))


HARD_STOPS = json.loads((Path(__file__).parents[1] / "data/hard_stops.json").read_text())
"""Twenty curves of a mass with a stop, k = 50 to 1e5: kind and Omega of all special points, by an independent code."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", HARD_STOPS, ids=lambda case: "k = {k:g}, c = {c:g}, gap = {gap:g}, {span}".format(**case)
)
def test_all_special_points_of_twenty_curves(case: dict[str, Any]) -> None:
    model = single_mass(hb.Unilateral(k=case["k"], gap=case["gap"]), F=case["F"], c=case["c"])
    curve = hb.trace(hb.ContactInstants(model), "Omega", case["span"])
    assert curve.status is hb.Status.REACHED_END
    found = sorted((point.kind, point.parameters["Omega"]) for point in curve.special)
    assert [kind for kind, _ in found] == sorted(kind for kind, _ in case["special"])
    np.testing.assert_allclose(
        [x for _, x in found], [x for _, x in sorted(map(tuple, case["special"]))], atol=1e-9, rtol=0
    )


def test_all_special_points_of_a_hard_stop(curve: hb.Branch) -> None:
    assert curve.status is hb.Status.REACHED_END
    assert [point.kind for point in curve.special] == [kind for kind, *_ in SPECIAL_POINTS]
    for point, (_, Omega, multipliers) in zip(curve.special, SPECIAL_POINTS, strict=True):
        assert abs(point.parameters["Omega"] - Omega) < 1e-9, point
        if multipliers is not None:
            assert point.multipliers is not None
            np.testing.assert_allclose(np.sort_complex(point.multipliers), np.sort(multipliers), atol=1e-8)


@pytest.mark.parametrize("parts", [(500.0, 500.0), (100.0, 200.0, 700.0)])
def test_parallel_stops_have_the_special_points_of_one_stop(parts: tuple[float, ...], capfd: Any) -> None:
    """Stops at one place begin and end contact at the same instants; one of the folds is 1e-9 from a grazing point."""
    stops = [hb.Element([1.0], hb.Unilateral(k=k, gap=0.5), name=f"stop {i}") for i, k in enumerate(parts, start=1)]
    parallel = hb.trace(hb.HarmonicBalance(replace(stop(), elements=stops), 12), "Omega", (0.5, 2.2))
    assert [point.kind for point in parallel.special] == [kind for kind, *_ in SPECIAL_POINTS]
    for point, (_, Omega, _) in zip(parallel.special, SPECIAL_POINTS, strict=True):
        assert abs(point.parameters["Omega"] - Omega) < 1e-9, point
    assert parallel["GR1"].note == f"highest of {', '.join(e.name for e in stops)} at 0.5"
    assert (parallel.regime == parallel.regime[:, :1]).all() and parallel.regime.max() == 1
    assert parallel.X.shape[1] == len(parts) * 25 and not any(capfd.readouterr())


@pytest.mark.slow
def test_a_curve_without_a_first_motion_is_followed_from_the_other_end() -> None:
    """The balance with H = 32 finds no motion at Omega = .4; the curve from 2.3 covers the span."""
    hard = replace(stop(1e4, 0.0), C=[[0.04]], load=hb.Load(cosine={1: [0.1]}))
    curve = hb.trace(hb.ContactInstants(hard, 32), "Omega", (0.4, 2.3))
    assert curve.status is hb.Status.REACHED_END and curve.values[-1] == pytest.approx(0.4)
    assert "no solution was found at Omega = 0.4: followed from the other end" in curve.message
    found = [(point.kind, round(point.parameters["Omega"], 4)) for point in curve.special]
    assert found == SPECIAL_POINTS_WITHOUT_GAP


@pytest.mark.slow
@pytest.mark.parametrize("Omega", [0.6, 0.8, 1.0, 1.5])
def test_motions_of_hard_contacts_are_found_from_softer_ones(Omega: float) -> None:
    """The balance with 16 harmonics has no motion with the right number of contacts at these frequencies."""
    hard = replace(stop(1e4, 0.0), C=[[0.04]], load=hb.Load(cosine={1: [0.1]}))
    problem = hb.ContactInstants(hard)
    with pytest.raises(hb.NoConvergence):
        problem.exact_motion(problem.balance.start(Omega=Omega), Omega=Omega)
    few = hb.StepControl(max_points=2)
    first = hb.trace(problem, "Omega", (Omega, Omega + 1e-4), cover=False, steps=few)[0]
    curve = hb.trace(hb.ContactInstants(hard, 32), "Omega", (2.3, 0.55))  # its first motion is found with 32 harmonics
    passes = np.flatnonzero((curve.values[1:] - Omega) * (curve.values[:-1] - Omega) <= 0)
    assert curve.problem is not None and len(passes)
    found = [np.sort_complex(curve.problem.exact_motion(curve.X[i], Omega=Omega).multipliers) for i in passes]
    assert min(np.abs(mu - np.sort_complex(first.multipliers)).max() for mu in found) < 1e-7


@pytest.mark.slow
def test_contacts_of_a_symmetric_machine_begin_and_end_together() -> None:
    """Two equal masses move as one; their contacts begin and end at the same instants, also at grazing points."""
    one = hb.trace(hb.ContactInstants(stop(10.0), 8), "Omega", (0.5, 2.2))
    two = hb.trace(hb.ContactInstants(two_equal_masses(), 8), "Omega", (0.5, 2.2))
    assert two.status is hb.Status.REACHED_END and len(one.special) == 6
    assert [point.label for point in two.special] == [point.label for point in one.special]
    for alone, both in zip(one.special, two.special, strict=True):
        assert abs(alone.parameters["Omega"] - both.parameters["Omega"]) < 1e-12
        for mu in alone.multipliers:  # the others belong to antisymmetric disturbances
            assert np.abs(both.multipliers - mu).min() < 1e-7
    assert two["GR2"].note == "highest of stop 1 at 0.5, highest of stop 2 at 0.5"


@pytest.mark.slow
def test_a_fold_of_the_double_helical_pair() -> None:
    """24 coordinates, stiffness that varies in time, two gaps that lose contact together; harmonic balance, H = 64."""
    pair = hb.gears.DoubleHelicalPair(zeta=0.05)
    balance = hb.trace(hb.HarmonicBalance(pair, 64), "Omega", (0.9, 0.84))
    before = balance[balance["LP2"].index - 1]
    value = before.parameters["Omega"]
    exact = hb.trace(hb.ContactInstants(pair, 16), "Omega", (value, value + 1e-3), start=before)
    (fold,) = (point for point in exact.special if point.kind == "LP")
    assert abs(fold.parameters["Omega"] - balance["LP2"].parameters["Omega"]) < 1e-9
    assert np.abs(fold.multipliers - 1).min() < 1e-6


def test_first_grazing_is_the_linear_response(curve: hb.Branch) -> None:
    Omega = curve["GR1"].parameters["Omega"]
    assert abs(abs(0.3 / (1 - Omega**2 + 0.1j * Omega)) - 0.5) < 1e-13
    assert curve["GR1"].note == "highest of stop at 0.5"


def test_coefficients_are_those_of_the_harmonic_balance() -> None:
    """With a soft stop, the truncation error of 64 harmonics is 1e-9."""
    balance, exact = hb.HarmonicBalance(stop(5.0), 64), hb.ContactInstants(stop(5.0), 64)
    X, Y = balance.start(Omega=1.2), exact.start(Omega=1.2)
    solved = balance.evaluate(X, Omega=1.2)
    X = X - np.linalg.solve(solved[1], solved[0])
    np.testing.assert_allclose(Y, X, atol=1e-6)
    assert np.abs(X).max() > 0.5 and np.abs(X[1::2][2:6]).max() > 1e-3


@pytest.mark.parametrize("switches", [2, 4])
def test_coefficients_are_integrals_of_the_flow(curve: hb.Branch, switches: int) -> None:
    """Quadrature of the closed form of each segment, with 200 nodes in a segment, for one and two contacts."""
    count = [len(state.pattern.switches) for state in curve.problem.known_states.states]
    points = np.flatnonzero(np.array(count) == switches)
    point = points[len(points) // 2]
    X, Omega, k, H = curve.X[point], float(curve.values[point]), 1e3, curve.problem.H
    motion = curve.problem.exact_motion(X, Omega=Omega)
    assert len(motion.instants) == switches
    c = np.zeros(H + 1, dtype=complex)
    for i, begin in enumerate(motion.instants):
        end = np.append(motion.instants, motion.instants[0] + math.tau)[i + 1]
        closed = motion.switches[i].sign > 0
        stiffness, level = 1.0 + closed * k, closed * k * 0.5
        particular = 0.3 / complex(stiffness - Omega**2, 0.1 * Omega)
        s = np.roots([Omega**2, 0.1 * Omega, stiffness])
        q, v = 0.5, _velocity(curve.problem, motion, i)
        wave = np.exp(1j * begin)
        free = np.array([q - (particular * wave).real - level / stiffness, v - (1j * particular * wave).real])
        a = np.linalg.solve(np.array([[1.0, 1.0], s]), free)
        x, w = np.polynomial.legendre.leggauss(200)
        tau, w = begin + (end - begin) * 0.5 * (1 + x), 0.5 * (end - begin) * w
        d = (particular * np.exp(1j * tau)).real + level / stiffness + (a @ np.exp(np.outer(s, tau - begin))).real
        c += np.exp(-1j * np.outer(np.arange(H + 1), tau)) @ (w * d) / math.tau
    expected = np.concatenate([[c[0].real], np.array([2 * c[1:].real, -2 * c[1:].imag]).T.ravel()])
    np.testing.assert_allclose(X, expected, atol=1e-12)


def _velocity(problem: hb.ContactInstants, motion: Any, i: int) -> float:
    """Return dq/dtau at a contact instant: the second state in its units."""
    reduce = problem.compiled({}).contact_equations.fixed.reduce
    return float(np.linalg.solve(reduce, motion.states[i])[1] / motion.Omega)


def test_points_are_predicted_by_their_predecessors(curve: hb.Branch) -> None:
    """A tangent needs 3.5 iterations of the corrector, polynomials through the last points 2.8."""
    assert curve.iterations[1:].mean() < 3.1


def test_doubled_branch_joins_at_the_second_doubling(curve: hb.Branch) -> None:
    doubled = hb.switch(curve, "PD3", (0.8, 1.0))
    assert doubled.status is hb.Status.MERGED and doubled.problem.nu == 2
    assert abs(doubled["EP1"].parameters["Omega"] - 0.96254908803479464627) < 1e-8
    assert {"LP", "GR"} <= {point.kind for point in doubled.special}


def test_harmonic_balance_covers_a_hard_stop() -> None:
    found = hb.trace(hb.HarmonicBalance(stop(1e4), 32), "Omega", (1.0, 2.0))
    assert found.status is hb.Status.REACHED_END and "contact instants" in found.message
    assert abs(found["LP1"].parameters["Omega"] - 1.76114206319) < 1e-9
    jump = found.jumps()[0]
    assert jump.after is not None and jump.after.amplitude("max") < 0.5  # back to the motion without contact


def test_stated_errors_contain_the_independent_values(curve: hb.Branch) -> None:
    """Stated errors are positive because of rounding; the reference has 20 digits, 12 for grazing points."""
    for kind, Omega, _ in SPECIAL_POINTS:
        point = min((p for p in curve.special if p.kind == kind), key=lambda p: abs(p.parameters["Omega"] - Omega))
        assert 0 < point.error <= 1e-11
        assert abs(point.parameters["Omega"] - Omega) <= 3 * point.error


@pytest.mark.slow
def test_jumps_of_a_hard_stop_land_by_integration() -> None:
    """Regimes after jumps by integration, and amplitudes equal to those of the nearest solutions."""
    found = hb.trace(hb.HarmonicBalance(stop(1e4), 32), "Omega", (1.2, 2.0))
    nearest = {jump.label: jump.after for jump in found.jumps()}
    jumps = found.jumps(landing="integrate")
    assert {jump.label: jump.after.regime.tolist() for jump in jumps} == {"LP1": [1], "LP2": [0]}
    for jump in jumps:
        assert jump.after.stable and jump.after.amplitude("rms") == pytest.approx(
            nearest[jump.label].amplitude("rms"), rel=1e-6
        )


@pytest.mark.slow
def test_hard_stop_without_a_gap_starts_from_more_harmonics() -> None:
    """16 harmonics do not resolve a contact of 1/70 of the period; the motion is periodic by Runge-Kutta to 1e-7."""
    k, c, F, Omega = 23357.0, 0.2, 0.1, 2.1
    system = single_mass(hb.Unilateral(k=k, gap=0.0), F=F, c=c, name="stop")
    curve = hb.trace(hb.HarmonicBalance(system, 16), "Omega", (2.2, Omega))
    assert curve.status is hb.Status.REACHED_END and "traced in contact instants" in curve.message
    known = curve.problem.exact_motion(curve.X[-1], Omega=Omega)
    start, t = known.states[0] * (1.0, np.sqrt(1 + k)), known.instants[0] / Omega
    period = 2 * np.pi / Omega

    def rates(t: float, y: np.ndarray) -> list[float]:
        return [y[1], F * np.cos(Omega * t) - c * y[1] - y[0] - k * max(y[0], 0.0)]

    end = solve_ivp(rates, (t, t + period), start, method="DOP853", rtol=1e-11, atol=1e-13, max_step=2e-3).y[:, -1]
    np.testing.assert_allclose(end, start, atol=1e-7)
    assert np.prod(curve.multipliers[-1]) == pytest.approx(np.exp(-c * period), rel=1e-9)  # Liouville


def test_soft_stops_are_traced_by_harmonics() -> None:
    found = hb.trace(hb.HarmonicBalance(stop(5.0), 16), "Omega", (1.0, 1.2))
    assert "contact instants" not in found.message


def test_folds_of_a_spur_pair_lie_in_their_enclosures() -> None:
    curve = hb.trace(hb.ContactInstants(hb.SpurPair(zeta=0.05, F_m=0.1, e=(0.05,))), "Omega", (1.0, 0.6))
    assert 0.7080316187218250 <= curve["LP1"].parameters["Omega"] <= 0.7080316187218381
    assert 0.8284639843882141 <= curve["LP2"].parameters["Omega"] <= 0.8284639843882173


def test_curve_from_a_file_is_solved_again(curve: hb.Branch, tmp_path) -> None:
    path = tmp_path / "stop.npz"
    curve.save(path)
    again = hb.load(path)
    problem = again.require_problem()
    assert isinstance(problem, hb.ContactInstants)
    point = again[int(np.argmax(again.values > 1.5))]
    mu = problem.observe(point.X, **point.parameters)["multipliers"]
    np.testing.assert_allclose(np.sort_complex(mu), np.sort_complex(point.multipliers), atol=1e-9)


def test_a_machine_at_rest_is_traced() -> None:
    """The search for an asymptote divided by the size of the motion."""
    curve = hb.trace(hb.ContactInstants(single_mass(hb.Unilateral(k=10.0, gap=0.3))), "Omega", (1.5, 0.6))
    assert curve.status is hb.Status.REACHED_END and not curve.amplitude("pp2").any()


@pytest.mark.slow
def test_a_curve_inside_of_the_span_is_found() -> None:
    """Curves from both ends of the span turn back; the harmonic balance has a third one between them.

    A curve that is traced from its inside in both directions knows the exact motions of all its points.
    """
    model = single_mass(hb.Backlash(b=0.516, k=16.344), F=0.29, mean=0.001, c=0.042, k=0.0)
    exact, balance = (hb.trace(one(model, 32), "Omega", (3.0, 0.6)) for one in (hb.ContactInstants, hb.HarmonicBalance))
    assert len(exact.others) == 2 and "2 other curves cover the rest of the span" in exact.message
    found, expected = (
        sorted((point.kind, point.parameters["Omega"]) for part in curve.curves for point in part.special)
        for curve in (exact, balance)
    )
    assert [kind for kind, _ in found] == [kind for kind, _ in expected]
    np.testing.assert_allclose([x for _, x in found], [x for _, x in expected], atol=1e-6, rtol=0)
    inner = exact.others[1]
    assert inner.values.min() == 0.6 and inner.values.max() == 3.0
    for i in range(0, len(inner), 9):
        assert np.linalg.norm(inner.problem.linearise(inner.X[i], "Omega", **inner.parameters_at(i)).R) < 1e-10


def test_smooth_law_is_refused() -> None:
    with pytest.raises(NotPiecewiseLinear, match="is not piecewise linear"):
        hb.ContactInstants(hb.Duffing())


@pytest.mark.parametrize(
    "model",
    [stop(), hb.SpurPair(eps=(0.1,), e=(0.05,)), two_equal_masses(1e3)],
    ids=["constant", "varying", "simultaneous"],
)
def test_jacobian_is_the_derivative_of_the_residual(model: Any) -> None:
    """Central differences of the residual; the equation of the short contact is divided by its duration."""
    from hbgear.harmonic.instants.corrector import CurveState
    from hbgear.harmonic.instants.shooting import linearise, short_visits

    branch = hb.trace(hb.ContactInstants(model, 8), "Omega", (0.9, 0.84))
    family = branch.problem.family("Omega", dict(branch.fixed))
    states = [s for s in branch.problem.known_states.states if s.pattern.count > 1]
    state = min(states, key=lambda s: abs(s.iterate.durations(2 * np.pi).min() - 0.05))
    state = CurveState(state.pattern, state.z * (1 + 1e-3 * np.cos(np.arange(len(state.z)))), state.fixed)
    ode = family(state.value)
    linearised = linearise(ode, state.iterate)
    divided = short_visits(state.pattern.divisible_visits, state.iterate.tau, ode.period) >= 0
    assert divided.any() or isinstance(model, hb.SpurPair)
    for k in range(len(linearised.R)):
        h = 1e-6
        a, b = (linearise(ode, state.with_z(state.z + d * np.eye(len(state.z))[k]).iterate, False).R for d in (h, -h))
        assert (a - b) / (2 * h) == pytest.approx(linearised.J[:, k], abs=1e-6 * np.abs(linearised.J).max())


def test_multipliers_of_a_contracting_pair_are_no_second_frequency() -> None:
    """Two masses with a soft stop: a modulus that passed .3 changed the sign of the test function."""
    from studies.contact.discretisations import Results, compare, machine

    results = Results()
    compare(results, "two masses", *machine("two masses", np.random.default_rng([41, 3, 0])))
    assert results.machines["two masses"] == 1 and not results.ended and not results.alone


@pytest.mark.slow
def test_two_neimark_sacker_points_within_one_step() -> None:
    """The pair leaves the unit circle for .003 in Omega; its test function is .0005 at the point before."""
    from studies.contact.discretisations import Results, compare, machine

    results = Results()
    compare(results, "two masses", *machine("two masses", np.random.default_rng([41, 3, 20])))
    assert not results.ended and not [point for point in results.alone if "NS" in point]


@pytest.mark.slow
def test_both_discretisations_have_the_same_special_points() -> None:
    """One machine of each kind of the study; the study itself compares a thousand."""
    from studies.contact.discretisations import SAME, report, run

    results = run(quick=True)
    assert sum(results.machines.values()) == 4 and not results.ended and not results.alone
    assert len(results.pairs) >= 8 and max(distance for _, distance, _ in results.pairs) < SAME
    assert "| pair, rectangular | 1 | 4 |" in report(results)


def test_a_fold_where_a_contact_begins_at_a_jump_of_the_stiffness() -> None:
    """Between two points the contact and the jump exchange their order; the fold there has mu = 1."""
    stiffness = hb.mechanics.Periodic.rectangular(1.0489, 0.8859, 4.39822971502571 / (2 * np.pi))
    pair = hb.SpurPair(zeta=0.056, F_m=0.16, e=(0.092,), stiffness=stiffness)
    exact = hb.trace(hb.ContactInstants(pair), "Omega", (1.3, 0.65))
    assert exact.warnings == () and [point.label for point in exact.special] == ["LP1", "LP2", "GR1"]
    assert exact["LP1"].parameters["Omega"] == pytest.approx(0.7058095997, abs=2e-8)  # harmonic balance, H = 32
    assert np.abs(exact["LP1"].multipliers - 1).min() < 1e-10


def two_masses_with_stops(k: float) -> hb.System:
    """Return two equal, coupled masses with equal stops and equal loads."""
    stops = [hb.Element(row, hb.Unilateral(k=k, gap=0.3)) for row in np.eye(2)]
    K = [[1.1, -0.1], [-0.1, 1.1]]
    return hb.System(np.eye(2), 0.1 * np.eye(2), K, stops, hb.Load(cosine={1: [0.2, 0.2]}))


BIFURCATIONS = {
    2.0: {"BP": (1.253885, 1.272015), "NS": (1.257016, 1.266804), "LP": (1.279367,), "GR": (1.272808, 1.273018)},
    20.0: {"BP": (1.286027, 1.491190), "LP": (1.363423, 1.502932, 1.570828), "GR": (1.286062, 1.363647)},
}
"""Special points of the branch on which the masses differ, by harmonic balance with H = 96."""


@pytest.mark.slow
@pytest.mark.parametrize("k", BIFURCATIONS)
def test_a_branch_leaves_and_joins_a_symmetric_motion(k: float) -> None:
    """Contacts of both masses are simultaneous on the symmetric motion, and have an order on the branch."""
    model = two_masses_with_stops(k)
    curve, balance = hb.trace(hb.ContactInstants(model, 96), "Omega", (0.6, 2.2)), hb.HarmonicBalance(model, 96)
    for side in (1, -1):
        branch = hb.switch(curve, "BP1", side=side)
        assert branch.status is hb.Status.CLOSED and not branch.warnings
        for kind, known in BIFURCATIONS[k].items():
            found = sorted({round(p.parameters["Omega"], 5) for p in branch.special if p.kind == kind})
            assert found == pytest.approx(known, abs=1e-5)
        middle = branch[len(branch) // 4]
        R, J = balance.evaluate(middle.X, **middle.parameters)
        assert np.linalg.norm(np.linalg.solve(J, R)) < 1e-4 * np.linalg.norm(middle.X)
        assert middle.amplitude("rms", 0) != pytest.approx(middle.amplitude("rms", 1), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("k", BIFURCATIONS)
def test_branch_points_do_not_depend_on_the_span(k: float) -> None:
    problem = hb.ContactInstants(two_masses_with_stops(k), 48)
    found = []
    for span in ((0.6, 2.2), (2.2, 0.6), (1.2, 1.55)):
        curve = hb.trace(problem, "Omega", span)
        points = [point for point in curve.special if point.kind == "BP"]
        assert all(np.abs(point.multipliers - 1).min() < 1e-9 for point in points)
        found.append(sorted(point.parameters["Omega"] for point in points))
    np.testing.assert_allclose(found, np.tile(found[0], (3, 1)), rtol=1e-10)


def test_two_doublings_in_a_long_step_are_located() -> None:
    """The multiplier is beyond -1 between .8489 and .8599 and reaches -1.0026; steps are .1 of the span."""
    problem = hb.ContactInstants(two_masses_with_stops(20.0))
    long, short = (hb.trace(problem, "Omega", span) for span in ((0.6, 2.2), (0.84, 0.87)))
    for label in ("PD1", "PD2"):
        assert abs(long[label].parameters["Omega"] - short[label].parameters["Omega"]) < 1e-10
        assert np.abs(long[label].multipliers + 1).min() < 1e-9


def test_a_symmetric_motion_has_a_start() -> None:
    """Simultaneous contact instants of two masses differ by rounding, which changed their order in each iteration."""
    problem = hb.ContactInstants(two_masses_with_stops(20.0), 48)
    X = problem.start(Omega=1.1)
    first, second = X.reshape(2, -1)
    np.testing.assert_allclose(first, second, atol=1e-9)


def test_a_sweep_continues_on_an_exact_motion_of_twice_the_period() -> None:
    """The sweep with increasing Omega leaves at PD1 onto a stable motion of twice the period; it does not jump."""
    from tests.cross.test_neimark_sacker import between_stops

    curve = hb.trace(hb.ContactInstants(between_stops(), 16), "Omega", (0.5, 0.6))
    doubled = hb.switch(curve, "PD1", steps=hb.StepControl(max_points=6))
    assert doubled.stable[:5].all() and (np.diff(doubled.values) > 0).all()
    assert [(jump.label, jump.direction) for jump in curve.jumps()] == [("LP2", -1)]


def two_backlashes(k: float, b: float, force: float, damping: float, coupling: float, load: float = 0.0) -> hb.System:
    """Return two equal coupled masses in equal backlashes, with equal loads."""
    K = np.array([[1.3, coupling], [coupling, 1.3]])
    elements = [hb.Element(w, hb.Backlash(b=b, k=k), name=name) for w, name in (([1.0, 0.0], "a"), ([0.0, 1.0], "b"))]
    loads = hb.Load(constant=[load, load], cosine={1: [force, force]})
    return hb.System(np.eye(2), 2 * damping * K + 0.01 * np.eye(2), K, elements, loads)


@pytest.mark.slow
def test_two_doublings_between_corners_are_located() -> None:
    """PD4 and PD5 are less than 4e-4 apart, in one step of 4e-3; the harmonic balance agrees to 1e-6."""
    model = two_backlashes(11.758, 0.1618, 0.24648, 0.01403, 0.3, 0.16161)
    curve = hb.trace(hb.ContactInstants(model), "Omega", (0.5216, 0.6))
    balance = hb.trace(hb.HarmonicBalance(model, 48), "Omega", (0.578, 0.588))
    for label in ("PD4", "PD5"):
        near = min(abs(point.parameters["Omega"] - curve[label].parameters["Omega"]) for point in balance.special)
        assert near < 1e-6
    assert curve["PD5"].parameters["Omega"] - curve["PD4"].parameters["Omega"] < 4e-4


@pytest.mark.slow
def test_a_symmetric_motion_passes_several_branch_points() -> None:
    """Tangents are exact where dF/du is nearly singular: in earlier versions the curve ended at Omega = .7153."""
    k, F, damping, b = 15.436699402610017, 0.19363924737704585, 0.024780978660692975, 0.3218514178138575
    model, span = two_backlashes(k, b, F, damping, -0.3), (0.527555282775874, 1.6447693265037202)
    curve = hb.trace(hb.ContactInstants(model), "Omega", span)
    balance = hb.trace(hb.HarmonicBalance(model, 32), "Omega", span)
    assert [point.label for point in curve.special] == ["GR1", "BP1", "BP2", "BP3", "BP4"]
    for exact, point in zip(curve.special, balance.special, strict=True):
        assert abs(exact.parameters["Omega"] - point.parameters["Omega"]) < 2e-5
    for other in ((0.53, 1.6), (0.68, 0.66)):  # tangents next to the branch point are inaccurate
        part = hb.trace(hb.ContactInstants(model), "Omega", other)
        near = min(abs(point.parameters["Omega"] - curve["BP2"].parameters["Omega"]) for point in part.special)
        assert near < 1e-10


def test_a_contact_begins_between_samples() -> None:
    """The first contact is found although a point lies 5e-6 beyond it; a cubic through the samples did not resolve it.

    Below the contact the motion is linear: |a| = .35 for a = F / (1.6 - Omega^2 + i c Omega), c = .17.
    """
    curve = hb.trace(hb.ContactInstants(two_backlashes(11.0, 0.35, 0.0854, 0.05, 0.3)), "Omega", (0.886, 1.37))
    assert curve.status is hb.Status.REACHED_END
    Omega = curve["GR1"].parameters["Omega"]
    assert abs(0.0854 / abs(1.6 - Omega**2 + 0.17j * Omega) - 0.35) < 1e-10


def test_a_gap_beyond_a_breakpoint_between_samples_of_one_direction() -> None:
    """h = -x (x - .05) (x - .12) falls at the samples 0 and .2, and is positive from .05 to .12."""
    from hbgear.harmonic.instants.kernels import unexpected_crossings

    x, h = np.linspace(0.0, 1.0, 6), -np.polynomial.Polynomial.fromroots([0.0, 0.05, 0.12])
    samples = x, h(x)[:, None], h.deriv()(x)[:, None], np.array([6]), np.array([[[-np.inf, 0.0]]])
    ((_, _, side, begin, end),) = unexpected_crossings(*samples, (1e-9, 0.0))
    assert side == 1 and h(0.5 * (begin + end)) > 0


def preloaded() -> hb.System:
    """Return two masses, the first of which rests on a preloaded spring from which it lifts off."""
    C, K = [[0.1926, -0.0963], [-0.0963, 0.2386]], [[1.852, -0.926], [-0.926, 1.852]]
    spring = hb.Element([1.0, 0.0], hb.Unilateral(k=5.989, gap=-0.355), name="spring")
    return hb.System(np.diag([1.319, 0.92]), C, K, [spring], hb.Load(cosine={1: [0.229, 0.333]}))


@pytest.mark.slow
def test_a_gap_that_ends_its_contact_and_returns_between_two_samples() -> None:
    """It has a minimum and a maximum between two samples, with slopes of one sign. The balance has H = 64."""
    curve = hb.trace(hb.ContactInstants(preloaded()), "Omega", (0.82, 0.87), cover=False)
    expected = [0.841700223, 0.844358442, 0.847203907, 0.847217769]
    for label, values in (("PD1", expected), ("PD2", expected[::-1])):
        doubled = hb.switch(curve, label)
        assert doubled.status is hb.Status.MERGED
        found = [point.parameters["Omega"] for point in doubled.special if point.kind == "GR"]
        np.testing.assert_allclose(found, values, rtol=0, atol=5e-8)


@pytest.mark.slow
@pytest.mark.parametrize(("label", "end"), [("PD1", "PD2"), ("PD2", "PD1")])
def test_a_flat_doubled_branch_joins_where_it_came_from(label: str, end: str) -> None:
    """Omega changes little along the branch near its end, where the equations are nearly singular in a wide region."""
    two_sided = hb.mechanics.PiecewiseLinear((-0.375, 0.375), (2.589, 0.0, 2.589))
    elements = [
        hb.Element([1.0, -1.0], two_sided, damping=0.009),
        hb.Element([-1.0, 1.0], hb.Unilateral(k=3.116, gap=-0.155)),
    ]
    C, K = [[0.0779, -0.039], [-0.039, 0.0779]], [[1.558, -0.779], [-0.779, 1.558]]
    load = hb.Load(cosine={1: [0.08, 0.278]}, sine={2: [0.04, 0.029]})
    model = hb.System(np.diag([0.979, 1.444]), C, K, elements, load)
    curve = hb.trace(hb.ContactInstants(model), "Omega", (0.86, 0.81), cover=False)
    doubled = hb.switch(curve, label)
    assert doubled.status is hb.Status.MERGED
    assert abs(doubled.values[-1] - curve[end].parameters["Omega"]) < 1e-9


@pytest.mark.slow
def test_a_doubled_branch_joins_where_two_contacts_exchange_their_order() -> None:
    """Next to its end both halves of the period differ in the order of the contacts. The special points are those of a
    balance with H = 32.
    """
    teeth = hb.mechanics.Series(1.0, (0.024, 0.063), (0.091,))
    two_sided = hb.mechanics.PiecewiseLinear((-0.526, 0.526), (7.503, 0.0, 7.503), stiffness=teeth)
    unequal = hb.mechanics.PiecewiseLinear((-0.393, 0.291), (1.071, 0.0, 3.382))
    elements = [hb.Element([1.0, 0.0, 0.0], two_sided, damping=0.013), hb.Element([0.0, 1.0, 0.0], unequal)]
    C, K = (np.diag(3 * [2 * x]) - x * np.eye(3, k=1) - x * np.eye(3, k=-1) for x in (0.06165, 1.101))
    load = hb.Load(cosine={1: [0.1, 0.322, 0.181]}, sine={2: [0.006, 0.042, 0.029]})
    model = hb.System(np.diag([1.487, 0.975, 1.343]), C, K, elements, load)
    curve = hb.trace(hb.ContactInstants(model), "Omega", (1.2, 1.02), cover=False)
    doubled = hb.switch(curve, "PD1")
    expected = [1.0801, 1.0965, 1.1037, 1.096, 1.0367, 1.0367, 1.0396, 1.0447, 1.0466, 1.0467, 1.0459]
    found = [point.parameters["Omega"] for point in doubled.special]
    assert doubled.status is hb.Status.MERGED and found[:-1] == pytest.approx(expected, abs=2e-4)
    assert abs(found[-1] - curve["PD2"].parameters["Omega"]) < 1e-9


def two_equal(law: Any, force: float, damping: float, coupling: float) -> hb.System:
    """Return two equal coupled masses, each with a contact of one law, with equal forces."""
    K = np.array([[1.3, coupling], [coupling, 1.3]])
    elements = [hb.Element(w, law, name=name) for w, name in (([1.0, 0.0], "a"), ([0.0, 1.0], "b"))]
    return hb.System(np.eye(2), 2 * damping * K + 0.01 * np.eye(2), K, elements, hb.Load(cosine={1: [force, force]}))


def between_two_stops() -> hb.System:
    """Return a mass with equal stops on both sides."""
    law = hb.Unilateral(k=9.94, gap=0.01446)
    elements = [hb.Element([1.0], law, name="right"), hb.Element([-1.0], law, name="left")]
    return hb.System([[1.0]], [[0.0586]], [[0.5]], elements, hb.Load(cosine={1: [0.15125]}))


def in_a_backlash() -> hb.System:
    """Return a mass in a backlash, with contact on the lower side at a smaller Omega than on the upper side."""
    element = hb.Element([1.0], hb.Backlash(b=0.3, k=27.0), name="gap")
    return hb.System([[1.0]], [[0.05]], [[1.0]], [element], hb.Load(cosine={1: [0.1]}, sine={2: [0.002]}))


ALL_PASSED = {
    "the second of two new contacts in a segment is the first": (between_two_stops(), (0.42, 1.76)),
    "a later grazing on the other side": (in_a_backlash(), (0.6, 1.6)),
    "two branch points in a step": (two_equal(hb.Backlash(b=0.2729, k=16.08), 0.17377, 0.0549, -0.3), (0.677, 1.98)),
    "simultaneous contacts vanish": (two_equal(hb.Unilateral(k=12.89, gap=-0.0544), 0.1053, 0.0392, 0.3), (1.1, 1.75)),
}
"""Models with spans in which earlier versions ended curves early or missed special points."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL_PASSED)
def test_curves_are_those_of_the_harmonic_balance(name: str) -> None:
    """The balance does not report contacts that begin next to a longer one, so that grazing points are not compared."""
    model, span = ALL_PASSED[name]
    exact = hb.trace(hb.ContactInstants(model), "Omega", span)
    balance = hb.trace(hb.HarmonicBalance(model, 48), "Omega", span)
    assert exact.status is hb.Status.REACHED_END
    found, expected = ([point for point in one.special if point.kind != "GR"] for one in (exact, balance))
    assert [point.label for point in found] == [point.label for point in expected]
    for one, other in zip(found, expected, strict=True):
        assert abs(one.parameters["Omega"] - other.parameters["Omega"]) < 5 * other.error + 1e-8


def test_the_first_of_two_grazings_is_that_of_the_linear_motion() -> None:
    curve = hb.trace(hb.ContactInstants(in_a_backlash()), "Omega", (0.6, 1.6))
    Omega, tau = curve["GR1"].parameters["Omega"], np.linspace(0, 2 * np.pi, 20001)
    first, second = (F / (1 - (n * Omega) ** 2 + 0.05j * n * Omega) for n, F in ((1, 0.1), (2, -0.002j)))
    q = (first * np.exp(1j * tau) + second * np.exp(2j * tau)).real
    assert abs(np.abs(q).max() - 0.3) < 1e-8


def test_a_doubled_branch_joins_where_its_parameter_turns() -> None:
    """At the end point the parameter of the doubled branch turns, and the equations are singular."""
    M, C = np.diag([1.822, 0.902, 0.726]), [[0.0561, -0.021, 0.0], [-0.021, 0.0721, -0.0189], [0.0, -0.0189, 0.0434]]
    K = [[1.2976, -0.8203, 0.0], [-0.8203, 2.3718, -0.738], [0.0, -0.738, 1.3389]]
    stop = hb.Element([0.0, -1.0, 0.0], hb.Unilateral(k=58.2, gap=0.379), name="stop")
    load = hb.Load(constant=[-0.0031, -0.058, 0.0491], cosine={1: [0.1572, 0, 0]}, sine={2: [0.0244, -0.02, -0.0205]})
    curve = hb.trace(hb.ContactInstants(hb.System(M, C, K, [stop], load)), "Omega", (0.49, 0.6))
    doubled = hb.switch(curve, "PD1")
    assert doubled.status is hb.Status.MERGED
    assert abs(doubled["EP1"].parameters["Omega"] - curve["PD2"].parameters["Omega"]) < 1e-8


@pytest.mark.slow
def test_multipliers_of_a_very_hard_stop_are_those_at_its_contact_instants() -> None:
    """Product of the closed-form flows of x'' + c x' + K x = 0 between the instants, for k = 1e5."""
    curve = hb.trace(hb.ContactInstants(stop(1e5)), "Omega", (0.5, 2.2), cover=False)
    errors = []
    for point, state in zip(curve, curve.problem.known_states.states, strict=True):
        durations, P = state.iterate.durations(2 * math.pi) / state.value, np.eye(2)
        for duration, contact in zip(durations, state.pattern.contacts, strict=True):
            K, c = 1.0 + 1e5 * contact.levels[0], 0.1
            w = math.sqrt(K - c**2 / 4)
            C, S = math.cos(w * duration), math.sin(w * duration) / w
            P = math.exp(-c / 2 * duration) * np.array([[C + c / 2 * S, S], [-K * S, C - c / 2 * S]]) @ P
        mu = np.linalg.eigvals(P)
        errors.append(np.abs(np.sort_complex(mu) - np.sort_complex(point.multipliers)).max() / np.abs(mu).max())
    assert len(errors) > 100 and max(errors) < 1e-8


@pytest.mark.slow
def test_multipliers_of_a_motion_have_no_truncation_error() -> None:
    """Sixteen harmonics of a motion next to a fold are enough to find it, but not for its multipliers."""
    from tests.cross.test_neimark_sacker import between_stops

    curve = hb.trace(hb.ContactInstants(between_stops(), 16), "Omega", (0.5, 0.6))
    i = curve["LP1"].index + 1
    problem, here = curve.require_problem(), curve.parameters_at(i)
    np.testing.assert_allclose(problem.multipliers(curve.X[i], **here)[:2], curve.multipliers[i, :2], rtol=1e-6)
    report = hb.validate(curve, 2)
    assert report.ok and any("near LP1" in row[0] for row in report.table()[1])


@hb.mechanics.model
def stop_of(k: float = 50.0, gap: float = 0.5, F: float = 0.3) -> hb.System:
    """Return a mass with a stop, with parameters."""
    return single_mass(hb.Unilateral(k=k, gap=gap), F=F, name="stop")


@pytest.mark.slow
@pytest.mark.parametrize("label", ["GR1", "PD1", "PD2", "LP1", "LP2"])
def test_sensitivities_are_those_of_curves_of_neighbouring_models(label: str) -> None:
    curve = hb.trace(hb.ContactInstants(stop_of(), 32), "Omega", (0.5, 2.0))
    found = hb.analysis.sensitivity(curve[label], ["gap", "F"]).of("Omega")
    for name, h in (("gap", 5e-5), ("F", 3e-5)):
        models = (replace(stop_of(), **{name: getattr(stop_of(), name) + side * h}) for side in (1, -1))
        up, down = (hb.trace(hb.ContactInstants(model, 32), "Omega", (0.5, 2.0)) for model in models)
        slope = (up[label].parameters["Omega"] - down[label].parameters["Omega"]) / (2 * h)
        assert found[name] == pytest.approx(slope, rel=1e-6)


@pytest.fixture(scope="module")
def hard() -> hb.Branch:
    """Return the curve of a hard stop."""
    return hb.trace(hb.ContactInstants(stop_of(k=1e3), 32), "Omega", (0.5, 2.0))


@pytest.mark.slow
@pytest.mark.parametrize("label", ["GR1", "LP1", "LP2", "GR2", "PD1", "PD2", "LP4", "PD3", "LP6"])
def test_special_points_of_exact_motions_are_followed(hard: hb.Branch, label: str) -> None:
    """Both ends agree with traces at these gaps, to 1e-10; LP1, LP4 and LP6 are 1e-6 from grazing points."""
    found = hb.follow(hard, label, "gap", (0.49, 0.51))
    assert found.status is hb.Status.REACHED_END
    for i in (0, -1):
        other = hb.trace(hb.ContactInstants(stop_of(k=1e3, gap=float(found.values[i])), 32), "Omega", (0.5, 2.0))
        assert found.tracked["Omega"][i] == pytest.approx(other[label].parameters["Omega"], rel=1e-10)


def folds_at(F: float) -> int:
    """Return the number of folds near .65 at a load."""
    curve = hb.trace(hb.ContactInstants(stop_of(k=1e3, F=F), 16), "Omega", (0.64, 0.675))
    return sum(point.kind == "LP" for one in curve.curves for point in one.special)


@pytest.mark.slow
def test_cusps_and_isola_centres_are_where_folds_meet(hard: hb.Branch) -> None:
    """By similarity, Omega depends on F / gap only. Two folds appear at the cusp."""
    over_load = hb.follow(hard, "LP1", "F", (0.3, 0.28))
    over_gap = hb.follow(hard, "LP1", "gap", (0.5, 0.53))
    assert [point.kind for point in over_load.special] == [point.kind for point in over_gap.special] == ["CP", "IC"]
    for one, other in zip(over_load.special, over_gap.special, strict=True):
        ratio = one.parameters["F"] / one.parameters["gap"]
        assert other.parameters["F"] / other.parameters["gap"] == pytest.approx(ratio, rel=1e-8)
        assert one.parameters["Omega"] == pytest.approx(other.parameters["Omega"], rel=1e-7)
    F = over_load["CP1"].parameters["F"]
    assert folds_at(F * (1 + 1e-5)) == folds_at(F * (1 - 1e-5)) + 2
    centre = over_load["IC1"].parameters
    at = [crossing.interpolate(over_load.tracked["Omega"]) for crossing in crossings_at(over_load, centre["F"] - 1e-5)]
    near = [float(Omega) for Omega in at if abs(Omega - centre["Omega"]) < 2e-3]
    assert len(near) == 2 and min(near) < centre["Omega"] < max(near)


@pytest.mark.slow
def test_curves_in_two_parameters_agree_with_a_balance() -> None:
    exact, balance = hb.ContactInstants(hb.SpurPair(), 32), hb.HarmonicBalance(hb.SpurPair(), 48)
    curves = [hb.trace(problem, "Omega", (0.4, 1.2)) for problem in (exact, balance)]
    for label, name, span in (("LP1", "zeta", (0.04, 0.12)), ("GR1", "F_m", (0.08, 0.12))):
        found, other = (hb.follow(curve, label, name, span) for curve in curves)
        np.testing.assert_allclose(found.values[[0, -1]], other.values[[0, -1]], rtol=1e-12)
        np.testing.assert_allclose(found.tracked["Omega"][[0, -1]], other.tracked["Omega"][[0, -1]], rtol=1e-7)
        assert [point.kind for point in found.special] == [point.kind for point in other.special]
        for one, two in zip(found.special, other.special, strict=True):
            assert one.parameters[name] == pytest.approx(two.parameters[name], rel=1e-6)


@hb.mechanics.model
def two_stops(left: float = 0.8) -> hb.System:
    """Return a mass between two stops."""
    stops = [hb.Element([1.0], hb.Unilateral(k=20.0, gap=0.5), name="right")]
    stops += [hb.Element([-1.0], hb.Unilateral(k=20.0, gap=left), name="left")]
    return hb.System([[1.0]], [[0.1]], [[1.0]], stops, hb.Load(cosine={1: [0.3]}))


@pytest.mark.slow
def test_the_curve_of_a_fold_passes_the_begin_and_the_end_of_a_contact() -> None:
    """Without the left contact the fold is that of one stop; with it the curve has a cusp. Both directions agree."""
    near, far = (hb.trace(hb.ContactInstants(two_stops(left), 16), "Omega", (0.8, 3.5)) for left in (0.8, 3.0))
    out, back = hb.follow(near, "LP1", "left", (0.8, 3.0)), hb.follow(far, "LP1", "left", (3.0, 0.8))
    for curve in (out, back):
        assert curve.status is hb.Status.REACHED_END and [point.kind for point in curve.special] == ["CP"]
        assert {*curve.regime[:, 1].tolist()} == {0, 1}
    alone = out.tracked["Omega"][out.regime[:, 1] == 0]
    np.testing.assert_allclose(alone, far["LP1"].parameters["Omega"], rtol=1e-8)
    assert out["CP1"].parameters["left"] == pytest.approx(back["CP1"].parameters["left"], rel=1e-9)
    assert back.tracked["Omega"][-1] == pytest.approx(near["LP1"].parameters["Omega"], rel=1e-10)
    value = 2.6  # between the beginning of the left contact and the cusp: two folds with this contact, one without
    special = hb.trace(hb.ContactInstants(two_stops(value), 16), "Omega", (0.8, 3.5)).special
    folds = [p.parameters["Omega"] for p in special if p.kind == "LP" and p.parameters["Omega"] > 1.4]
    Omega = sorted(float(one.interpolate(out.tracked["Omega"])) for one in crossings_at(out, value))
    assert len(Omega) == 3
    np.testing.assert_allclose(Omega, sorted(folds), rtol=1e-4)


@hb.mechanics.model
def masses_with_a_stop(f: float = 1.0) -> hb.System:
    """Return two masses with a stop between them, whose stiffness jumps twice in a period."""
    stiffness = hb.mechanics.Periodic(phases=(0.1257, 3.8956), coefficients=((1.2,), (0.8,)))
    stop = hb.Element([1.0, -1.0], hb.Unilateral(k=27.184, gap=0.08576, stiffness=stiffness), name="stop")
    M, C = np.diag([1.9252, 0.7154]), [[0.07282, -0.02998], [-0.02998, 0.0705]]
    return hb.System(M, C, [[1.0544, -0.6202], [-0.6202, 1.2904]], [stop], hb.Load(cosine={1: [0.0, 0.30036 * f]}))


@pytest.mark.slow
def test_a_curve_of_neimark_sacker_points_ends_on_a_curve_of_folds() -> None:
    """At a 1:1 resonance the multiplier +1 is double: the fold has the same Omega, to 1e-9."""
    curve = hb.trace(hb.ContactInstants(masses_with_a_stop(), 16), "Omega", (0.53, 0.58))
    pairs = hb.follow(curve, "NS2", "f", (1.0, 0.6))
    end = pairs["RI1"]
    assert pairs.status is hb.Status.EVENT and "1:1 resonance" in pairs.message
    fold = hb.follow(curve, "LP1", "f", (1.0, end.parameters["f"]))
    assert fold.tracked["Omega"][-1] == pytest.approx(end.parameters["Omega"], rel=1e-9)


def test_a_grazing_point_is_located_with_its_own_order_of_contact_instants() -> None:
    """Before it the end of another contact passes a jump of the stiffness; with a long step the error was 4e-7."""
    stiffness = hb.mechanics.Periodic(phases=(0.0379, 3.8078), coefficients=((1.2,), (0.8,)))
    law = hb.Backlash(b=0.3375, k=5.495, stiffness=stiffness)
    gap = hb.Element([1.0], law, hb.mechanics.Series(0.0, (0.00816,)), name="gap")
    load = hb.Load(constant=[-0.0893], cosine={1: [0.146]})
    model = hb.System([[1.552]], [[0.05074]], [[0.9387]], [gap], load)
    problem = hb.ContactInstants(model, 16)
    values = [hb.trace(problem, "Omega", span)["GR1"].parameters["Omega"] for span in ((0.7, 1.26), (0.79, 0.83))]
    assert values[0] == pytest.approx(values[1], rel=1e-12)
    exact = hb.trace(hb.HarmonicBalance(model, 96), "Omega", (0.79, 0.83))["GR1"]
    assert abs(values[0] - exact.parameters["Omega"]) < 3 * exact.error < 1e-7


@hb.mechanics.model
def equal_masses(gap: float = 0.5) -> hb.System:
    """Return two coupled masses with equal stops and loads."""
    stops = [hb.Element(row, hb.Unilateral(k=10.0, gap=gap), name=f"stop {i + 1}") for i, row in enumerate(np.eye(2))]
    K = [[1.5, -0.5], [-0.5, 1.5]]
    return hb.System(np.eye(2), 0.1 * np.eye(2), K, stops, hb.Load(cosine={1: [0.3, 0.3]}))


@pytest.mark.slow
def test_folds_of_contacts_that_switch_at_the_same_instant_are_followed() -> None:
    """The symmetric motion is that of one mass: Omega of the fold depends on F / gap only."""
    curve = hb.trace(hb.ContactInstants(equal_masses(), 16), "Omega", (0.8, 2.2))
    label = next(point.label for point in curve.special if point.kind == "LP")
    found = hb.follow(curve, label, "gap", (0.5, 0.52))
    alone = hb.trace(hb.ContactInstants(stop_of(k=10.0, gap=0.52), 16), "Omega", (0.8, 2.2))
    folds = [point.parameters["Omega"] for point in alone.special if point.kind == "LP"]
    assert found.status is hb.Status.REACHED_END
    assert min(abs(found.tracked["Omega"][-1] - Omega) for Omega in folds) < 1e-12


@pytest.mark.slow
def test_a_curve_whose_frequency_tends_to_zero_ends(hard: hb.Branch) -> None:
    """With a gap equal to the static displacement, the grazing point is at Omega = 0."""
    found = hb.follow(hard, "GR1", "gap", (0.5, 0.25))
    assert found.status is hb.Status.EVENT and "Omega = 0.0" in found.message and "end of its range" in found.message
    assert found.values[-1] == pytest.approx(0.3, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("label", ["LP2", "GR2"])
def test_points_of_a_curve_from_a_file_are_followed(hard: hb.Branch, label: str, tmp_path: Path) -> None:
    """The 32 harmonics of the file do not resolve the shorter contact of LP2 or the contact that begins at GR2."""
    hard.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz", problem=hb.ContactInstants(stop_of(k=1e3), 32))
    known, found = (hb.follow(curve, label, "gap", (0.5, 0.51)) for curve in (hard, again))
    assert found.tracked["Omega"][-1] == pytest.approx(known.tracked["Omega"][-1], rel=1e-10)


@pytest.mark.slow
def test_a_curve_reaches_the_end_of_the_range_of_its_parameter() -> None:
    """Without damping the gear pair jumps at another Omega; the model refuses a negative damping ratio."""
    curve = hb.trace(hb.ContactInstants(hb.SpurPair(), 16), "Omega", (0.7, 1.0))
    found = hb.follow(curve, "LP1", "zeta", (0.05, 0.0))
    assert found.status is hb.Status.REACHED_END and found.values[-1] == 0.0
    balance = hb.HarmonicBalance(hb.SpurPair(), 48)
    other = hb.follow(hb.trace(balance, "Omega", (0.7, 1.0)), "LP1", "zeta", (0.05, 0.0))
    assert found.tracked["Omega"][-1] == pytest.approx(other.tracked["Omega"][-1], rel=1e-8)


@pytest.mark.slow
def test_the_curve_of_a_fold_is_a_problem_of_its_own(hard: hb.Branch, tmp_path: Path) -> None:
    """A point of the curve is a start, also at other fixed parameters; a file stores a curve of folds."""
    folds = hb.follow(hard, "LP2", "gap", (0.49, 0.51))
    middle = len(folds) // 2
    part = hb.follow(hard, "LP2", "gap", (0.5, 0.51), steps=hb.StepControl(max_points=5))
    whole = hb.extend(part)
    assert (part.status, whole.status) == (hb.Status.MAX_POINTS, hb.Status.REACHED_END)
    assert whole.tracked["Omega"][-1] == pytest.approx(folds.tracked["Omega"][-1], rel=1e-11)
    again = hb.trace(folds.problem, "gap", (float(folds.values[middle]), 0.51), folds[middle])
    assert again.tracked["Omega"][-1] == pytest.approx(folds.tracked["Omega"][-1], rel=1e-11)
    moved = hb.trace(folds.problem, "gap", (0.49, 0.51), folds[0], at={"F": 0.31})
    curve = hb.trace(hb.ContactInstants(stop_of(k=1e3, gap=0.51, F=0.31), 32), "Omega", (0.5, 2.0))
    assert moved.tracked["Omega"][-1] == pytest.approx(curve["LP2"].parameters["Omega"], rel=1e-10)
    folds.save(tmp_path / "folds.npz")
    loaded = hb.load(tmp_path / "folds.npz")
    np.testing.assert_array_equal(loaded.tracked["Omega"], folds.tracked["Omega"])
    assert loaded.meta["curve"] == {"of": "FoldProblem", "in": "Omega"}
    with pytest.raises(ValueError, match="needs a start"):
        hb.trace(folds.problem, "gap", (0.49, 0.51))


def test_an_interrupted_trace_keeps_its_points() -> None:
    """Ctrl-C after some points of a response curve, and of a curve of folds."""

    def stop(progress: Any) -> None:
        if progress.numbers.get("points", 0) >= 9:
            raise KeyboardInterrupt

    problem = hb.ContactInstants(stop_of(k=1e3), 16)
    curve = hb.trace(problem, "Omega", (0.5, 2.0), progress=stop)
    assert curve.status is hb.Status.INTERRUPTED and len(curve) == 9
    whole = hb.trace(problem, "Omega", (1.8, 2.0))
    folds = hb.follow(hb.trace(problem, "Omega", (0.5, 0.7)), "LP1", "gap", (0.5, 0.52), progress=stop)
    assert folds.status is hb.Status.INTERRUPTED and len(folds) == 9 and whole.status.complete


@pytest.mark.slow
def test_sensitivities_of_jumps_at_folds_next_to_a_grazing() -> None:
    """LP1 is 1e-6 from a grazing point: Omega and amplitudes before and after, against neighbouring models."""

    def jump_of(k: float) -> hb.Jump:
        return hb.trace(hb.ContactInstants(stop_of(k=k), 32), "Omega", (0.5, 1.0)).jumps()[0]

    here, up, down = (jump_of(k) for k in (1e3, 1e3 + 0.1, 1e3 - 0.1))
    found = hb.analysis.sensitivity(here, ["k"])
    assert here.label == "LP1"
    for name, value in (
        ("Omega", lambda jump: jump.before.parameters["Omega"]),
        ("rms before", lambda jump: jump.before.amplitude("rms")),
        ("rms after", lambda jump: jump.after.amplitude("rms")),
    ):
        assert found.of(name)["k"] == pytest.approx((value(up) - value(down)) / 0.2, rel=2e-4)


@pytest.mark.slow
def test_jump_maps_and_critical_values_are_those_of_the_balance() -> None:
    exact, balance = hb.ContactInstants(stop_of(), 32), hb.HarmonicBalance(stop_of(), 32)
    maps = [hb.jump_map(one, "F", (0.25, 0.35), frequencies=(0.8, 2.0), seeds=2) for one in (exact, balance)]
    assert len(maps[0].folds) == len(maps[1].folds) == 2
    for fold, other in zip(maps[0].folds, maps[1].folds, strict=True):
        np.testing.assert_allclose(fold.values[[0, -1]], other.values[[0, -1]], rtol=1e-12)
        np.testing.assert_allclose(fold.tracked["Omega"][[0, -1]], other.tracked["Omega"][[0, -1]], rtol=2e-5)
    values = [hb.analysis.critical_parameter(one, "F", frequencies=(0.8, 2.0)).value for one in (exact, balance)]
    assert values[0] == pytest.approx(values[1], rel=1e-4)


@pytest.mark.slow
def test_a_map_of_a_hard_stop_has_the_folds_next_to_grazing_points(hard: hb.Branch) -> None:
    found = hb.jump_map(hb.ContactInstants(stop_of(k=1e3), 16), "gap", (0.49, 0.51), frequencies=(0.5, 2.0), seeds=2)
    assert len(found.folds) == 6 and not found.message
    folds = [point for point in hard.special if point.kind == "LP"]
    expected = sorted(
        (p.parameters["Omega"], 1 if hard.values[p.index - 1] < p.parameters["Omega"] else -1) for p in folds
    )
    at = sorted(found.jumps_at(0.5))
    assert [direction for _, direction in at] == [direction for _, direction in expected]
    np.testing.assert_allclose([Omega for Omega, _ in at], [Omega for Omega, _ in expected], rtol=1e-5)


def test_only_the_special_points_of_a_trace_are_located() -> None:
    problem, span = hb.ContactInstants(stop_of(), 16), (0.8, 2.0)
    assert hb.trace(problem, "Omega", span, special=False).special == ()
    folds = hb.trace(problem, "Omega", span, special=False, events=["LP"])
    assert [point.label for point in folds.special] == ["LP1", "LP2"]
    with pytest.raises(ValueError, match="curves in contact instants have no PK: use hb"):
        hb.trace(problem, "Omega", span, events=["PK"])


def test_a_branch_turns_at_its_end_without_a_fold() -> None:
    """Where a doubled branch merges its parameter turns; this is an end point and not a fold."""
    curve = hb.trace(hb.ContactInstants(stop_of(), 32), "Omega", (0.8, 2.0))
    doubled = hb.switch(curve, "PD1")
    assert [point.label for point in doubled.special] == ["LP1", "LP2", "GR1", "GR2", "LP3", "EP1"]
    assert doubled.warnings == ()
    assert abs(doubled["EP1"].parameters["Omega"] - curve["PD2"].parameters["Omega"]) < 1e-8


@pytest.mark.slow
def test_an_iteration_that_leaves_a_table_of_the_structure_fails() -> None:
    """An iteration outside the table shortens the step; folds agree with the balance to 1e-6."""
    Omega = [0.5, 1.0, 1.5]
    table = hb.mechanics.MatrixTable(Omega, [[[x]] for x in (0.0, 0.1, 0.15)])
    system = replace(stop(10.0, 0.2), speed=hb.mechanics.SpeedTerms(stiffness=table))
    problem = hb.ContactInstants(system, 32)
    with pytest.raises(hb.NoConvergence, match="outside of a table over Omega"):
        problem.family("Omega", {"Omega": 1.0})(0.1)
    exact, balance = (hb.trace(one, "Omega", (0.5, 1.5)) for one in (problem, hb.HarmonicBalance(system, 48)))
    assert exact.status is hb.Status.REACHED_END
    for label in ("LP1", "LP2"):
        other = balance[label].parameters["Omega"]
        assert exact[label].parameters["Omega"] == pytest.approx(other, abs=1e-6)


@pytest.mark.slow
def test_motions_without_bound_end_at_their_asymptote() -> None:
    """At the asymptote the equation without gap and load has a periodic motion, by Runge-Kutta to 1e-8."""
    m, c, K, k = 2.0, 0.1, 0.8, 8.0
    stiffness = hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.6)
    element = hb.Element([1.0], hb.Unilateral(k=k, gap=0.2, stiffness=stiffness), name="stop")
    system = hb.System([[m]], [[c]], [[K]], [element], hb.Load(constant=[0.02], cosine={1: [0.45]}))
    curve = hb.trace(hb.ContactInstants(system, 32), "Omega", (0.5, 1.6))
    balance = hb.trace(hb.HarmonicBalance(system, 64), "Omega", (0.5, 1.6))
    assert curve.status is balance.status is hb.Status.UNBOUNDED and len(curve) < 200
    Omega, approximate = curve.asymptotes["last"], balance.asymptotes["last"]
    assert Omega == pytest.approx(approximate, rel=1e-5)
    steps = [0.0, *stiffness.phases, 2 * np.pi]

    def after_a_period(angle: float) -> np.ndarray:
        y = np.array([np.cos(angle), np.sin(angle)])
        for begin, end in pairwise(steps):
            factor = k * stiffness(0.5 * (begin + end))

            def rates(tau: float, y: np.ndarray, factor: float = factor) -> list[float]:
                return [y[1] / Omega, -(c * y[1] + K * y[0] + factor * max(y[0], 0.0)) / m / Omega]

            y = solve_ivp(rates, (begin, end), y, method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.02).y[:, -1]
        return y

    def turn(angle: float) -> float:
        x, v = after_a_period(angle)
        return float((np.arctan2(v, x) - angle + np.pi) % (2 * np.pi) - np.pi)

    angles = np.linspace(0.0, 2 * np.pi, 25)
    turns = [turn(angle) for angle in angles]
    roots = [
        brentq(turn, a, b, xtol=1e-12)
        for (a, b), (f, g) in zip(pairwise(angles), pairwise(turns), strict=True)
        if f * g < 0 and abs(f - g) < 2
    ]
    growths = [float(np.linalg.norm(after_a_period(root))) for root in roots]
    assert min(abs(growth - 1) for growth in growths) < 1e-8


def test_a_point_is_followed_by_a_balance_that_has_it_to_the_stated_accuracy(curve: hb.Branch) -> None:
    """The number of harmonics is doubled until the fold of the balance agrees in Omega to the threshold."""
    point = curve["LP2"]
    balance, resolved = in_residual_form(point.problem, point, "Omega", point.event)

    def distance(H: int) -> float:
        problem = hb.HarmonicBalance(stop(), H)
        u = np.append(problem.from_point(resolved), Omega := point.parameters["Omega"])
        fold = hb.continuation.FoldProblem(problem, "Omega").with_borders_at(u, {})
        return abs(float(fold.located(u, {}, hb.NewtonSettings()).X[-1]) / Omega - 1)

    assert balance.H == 128 and distance(128) < RESIDUAL_FORM_ACCURACY < distance(64)


@pytest.mark.slow
def test_sensitivities_of_a_curve_from_a_file_are_exact_or_refused(tmp_path) -> None:
    """A file stores 32 harmonics of each motion, which do not resolve the short contacts of PD1 and LP4."""
    problem = hb.ContactInstants(stop_of(k=1e3), 32)
    curve = hb.trace(problem, "Omega", (0.5, 2.0))
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz", problem=problem)
    for label in ("LP1", "LP3", "PD3"):
        known, found = (hb.analysis.sensitivity(one[label], ["gap"]).of("Omega")["gap"] for one in (curve, again))
        assert found == pytest.approx(known, rel=1e-6)
    for label in ("PD1", "LP4"):
        with pytest.raises(hb.NoConvergence, match=f"{label} is not known to HarmonicBalance"):
            hb.analysis.sensitivity(again[label], ["gap"])


@pytest.mark.slow
@pytest.mark.parametrize("order", [7, 20, 40])
def test_the_unit_of_the_frequency_is_arbitrary(order):
    """Order n at Omega / n and order 1 at Omega are the same excitation: the multipliers are n-th powers."""
    found = []
    for n in (1, order):
        stiffness = hb.mechanics.Series(1.0, (0.0,) * (n - 1) + (0.3,))
        mesh = hb.Element([1.0], hb.Backlash(0.3, stiffness=stiffness), damping=0.1)
        pair = hb.System([[1.0]], [[0.0]], [[0.0]], [mesh], hb.Load([0.2], {n: [0.3]}))
        curve = hb.trace(hb.ContactInstants(pair, harmonics=16 * n), "Omega", (1.3 / n, 1.301 / n))
        found.append((curve.amplitude("rms")[0], np.sort_complex(curve.multipliers[0])))
    (amplitude, mu), (other, powers) = found
    assert abs(other - amplitude) < 1e-10
    np.testing.assert_allclose(powers, np.sort_complex(mu**order), atol=1e-9 * np.abs(powers).max())


@pytest.mark.parametrize("depth, expected", [(0.04, True), (-0.5, True), (-8.0, False)])
def test_a_step_is_searched_where_a_determinant_may_bend_to_zero(depth: float, expected: bool) -> None:
    """Multipliers of modulus 1 - .1 ((s - 1/2)^2 - depth) at s = -1, 0, 1 pass the limit twice for depth .04."""

    def point(kind: str, s: float) -> Any:
        modulus = 1 - 0.1 * ((s - 0.5) ** 2 - depth)
        return SimpleNamespace(multipliers=np.array([-modulus] if kind == "PD" else [1j * modulus, -1j * modulus]))

    for kind in ("PD", "NS"):
        assert _may_bend(kind, (point(kind, -1.0), point(kind, 0.0), point(kind, 1.0)), 1.0, 1.0) is expected


@pytest.mark.slow
@pytest.mark.parametrize("end", [0.6, 1.0])
def test_a_curve_starts_at_a_cusp_of_folds(end: float) -> None:
    """At a cusp the equations at fixed Omega are singular to second order; the curve through it is regular."""
    curve = hb.trace(hb.ContactInstants(hb.SpurPair()), "Omega", (1.0, 0.6))
    cusp = hb.follow(curve, "LP1", "zeta", (0.05, 0.2))["CP1"]
    Omega, zeta = cusp.parameters["Omega"], cusp.parameters["zeta"]
    started = hb.trace(hb.ContactInstants(hb.SpurPair()), "Omega", (Omega, end), start=cusp)
    whole = hb.trace(hb.ContactInstants(hb.SpurPair(zeta=zeta)), "Omega", (1.0, 0.6))
    assert started.status is hb.Status.REACHED_END and started.values[-1] == end
    assert abs(started.values[0] - Omega) < 1e-6 and abs(abs(started.multipliers[0]).max() - 1) < 1e-3
    X = whole.X[0 if end == 1.0 else -1]
    np.testing.assert_allclose(started.X[-1], X, atol=1e-9)
    same = [
        point.parameters["Omega"] for point in whole.special if (point.parameters["Omega"] - Omega) * (end - Omega) > 0
    ]
    found = [point.parameters["Omega"] for point in started.special]
    np.testing.assert_allclose(sorted(found), sorted(same), atol=1e-9)


@pytest.mark.slow
def test_a_pair_that_leaves_the_circle_and_returns_within_a_step():
    """Two Neimark-Sacker points in one step; moduli by shooting with DOP853 and the variational equations."""
    K = np.array([[1.30596319, -0.36553514], [-0.36553514, 1.23585073]])
    C = np.array([[0.01685707, -0.00471824], [-0.00471824, 0.01595208]])
    stops = [
        hb.Element([1.0, 0.0], hb.Unilateral(k=24.04462462, gap=0.75741778), name="one"),
        hb.Element([0.0, 1.0], hb.Unilateral(k=1.50066992, gap=0.14753906), name="two"),
    ]
    system = hb.System(np.eye(2), C, K, stops, hb.Load(cosine={1: [0.2228762, 0.15719407]}))
    curve = hb.trace(hb.ContactInstants(system, 16), "Omega", (0.6, 0.85), cover=False, work=None)
    pair = [p.parameters["Omega"] for p in curve.special if p.kind == "NS" and p.parameters["Omega"] > 0.7]
    np.testing.assert_allclose(pair, [0.79123343, 0.79893851], rtol=0, atol=1e-6)
    for Omega, modulus in ((0.7905, 0.994551), (0.792, 1.004466), (0.795633, 1.011715), (0.7985, 1.002666)):
        point = hb.trace(curve.problem, "Omega", (Omega, 0.81), curve.at(Omega)[-1], work=None)[0]
        assert np.abs(point.multipliers).max() == pytest.approx(modulus, abs=2e-6)


def test_the_largest_step_of_the_trace_applies() -> None:
    """It was ignored. Special points do not depend on it."""
    curves = [
        hb.trace(hb.ContactInstants(stop(k=20.0)), "Omega", (1.4, 1.2), steps=hb.StepControl(max_step=largest))
        for largest in (0.04, 0.01)
    ]
    assert len(curves[1]) > 2 * len(curves[0]) > 40
    for coarse, fine in zip(*(curve.special for curve in curves), strict=True):
        assert fine.kind == coarse.kind
        assert fine.parameters["Omega"] == pytest.approx(coarse.parameters["Omega"], abs=1e-9)
