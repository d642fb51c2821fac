"""Validation of curves by time integration: correct curves agree, and errors of a curve are detected."""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from machines import gear_pair

import hbgear as hb
from hbgear import plot
from hbgear.time.validation.point_selection import choose, problem_for
from hbgear.time.validation.validate import LEAST, validate


@pytest.fixture(scope="module")
def pair():
    """A curve with impacts and two folds, unstable between them."""
    return hb.trace(hb.HarmonicBalance(hb.SpurPair(), 40), "Omega", (1.5, 0.3))


@pytest.fixture(scope="module")
def report(pair):
    return validate(pair, 10, 1e-5)


@pytest.mark.slow
def test_duffing_agrees_within_the_accuracy_of_integration():
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 15), "Omega", (0.5, 1.6))
    found = validate(curve, 6, 1e-9, multiplier_tolerance=1e-6)
    assert found.ok and len(found.rows) == 6
    assert max(row.rms_error for row in found.rows) < 1e-10
    assert max(row.closure for row in found.rows) < 1e-9
    assert {row.stable for row in found.rows} == {True, False}


@pytest.mark.slow
def test_spur_pair_agrees(report):
    assert report.ok and len(report.rows) == 10
    assert max(row.rms_error for row in report.rows) < 1e-6
    for row in report.rows:
        assert row.growth == pytest.approx(abs(row.mu), abs=2e-4)
        assert (row.growth < 1) == row.stable
    assert {row.stable for row in report.rows} == {True, False}


@pytest.mark.slow
def test_double_helical_pair_of_low_damping():
    """24 coordinates: rms to 1e-5 with 24 harmonics at 7 points, and the stability of each point.

    At some points a disturbance of a second frequency grows, in opposite phase on the two helices.
    """
    curve = hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05), 24), "Omega", (1.0, 0.8))
    found = validate(curve, 7, 1e-5, multiplier_tolerance=1e-3)
    assert found.ok and len(found.rows) == 7
    assert max(row.rms_error for row in found.rows) < 1e-5
    unstable = [row for row in found.rows if not row.stable]
    assert len(unstable) >= 2 and all(row.growth > 1 for row in unstable)


@pytest.mark.slow
def test_teeth_of_a_drawing():
    """Tooth contacts begin at tau = 0, where velocities with H = 16 have errors of 1e-2; some points are near the fold.

    At one of them, shooting from the state of the series converges to the motion beyond the fold.
    """
    model = gear_pair().model(200.0, 0.04)
    curve = hb.trace(hb.HarmonicBalance(model, 16), "Omega", (0.9, 0.6), cover=False)
    found = validate(curve, 5)
    assert found.ok and len(found.rows) == 5 and {row.stable for row in found.rows} == {True, False}
    assert max(row.closure for row in found.rows) < 3e-3


@pytest.mark.slow
def test_period_doubling_of_the_double_helical_pair():
    """Between Omega = 0.3306 and 0.3435 the default pair is unstable with a multiplier below -1."""
    problem = hb.HarmonicBalance(hb.gears.DoubleHelicalPair(), 10)
    curve = hb.trace(problem, "Omega", (0.336, 0.33595))
    (row,) = validate(curve, [0], 1e-5).rows
    assert row.ok and row.stable is False
    assert row.mu_true.real == pytest.approx(-1.0291, abs=2e-3)
    assert row.growth == pytest.approx(abs(row.mu_true), abs=1e-5)


@pytest.mark.slow
def test_motions_of_two_periods():
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 30), "Omega", (2.2, 1.85))
    doubled = hb.switch(curve, "PD1", steps=hb.StepControl(max_points=12))
    found = validate(doubled, 4, 1e-5)
    assert found.ok and doubled.layout.nu == 2
    # the first point is the period doubling, where shooting is singular: it is checked on request only
    assert np.abs(doubled.multipliers[0] - 1).min() < 1e-3 and len(found.rows) == 4
    assert 0 not in {row.index for row in found.rows}
    (singular,) = validate(doubled, [0], 1e-5).rows
    assert not singular.ok and not singular.sensitivity <= 1e3  # nan if shooting does not converge


# ---- errors are detected


def test_a_wrong_motion_is_found(pair):
    X = pair.X.copy()
    X[30] *= 1 + 1e-3
    (row,) = validate(replace(pair, X=X), [30], 1e-5).rows
    assert not row.ok and "rms" in row.status and "harmonics" in row.status
    assert row.rms_error == pytest.approx(1e-3, rel=0.01)
    assert row.closure > 1e-5


def test_wrong_multipliers_are_found(pair):
    mu = pair.multipliers.copy()
    mu[30] *= 1.05
    (row,) = validate(replace(pair, multipliers=mu), [30], 1e-5).rows
    assert row.status == "multipliers differ"


@pytest.mark.slow
def test_right_multipliers_of_a_coarse_motion_are_no_reason_against_more_harmonics():
    """Multipliers of verified points belong to a refined motion, not to the coefficients of the curve."""
    coarse, fine = (hb.HarmonicBalance(hb.Duffing(), H) for H in (1, 8))
    curve = hb.trace(coarse, "Omega", (1.0, 1.05))
    mu = curve.multipliers.copy()
    mu[5] = hb.trace(fine, "Omega", (float(curve.values[5]), 1.06))[0].multipliers
    (row,) = validate(replace(curve, multipliers=mu), [5]).rows
    assert row.status == "agrees with H = 4" and row.multiplier_error < 1e-6


@pytest.mark.parametrize(("by", "status"), [(3e-6, "agrees with H = 12"), (3e-3, "rms, harmonics, multipliers differ")])
def test_multipliers_that_differ_by_the_last_newton_step_are_no_reason_against_more_harmonics(by, status):
    """Multipliers of a trace belong to the state before the last Newton step, which is up to 1e-6."""
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(zeta=0.03), 6), "Omega", (0.9, 0.8), special=False)
    mu = curve.multipliers.copy()
    mu[5] = curve.problem.multipliers(curve.X[5], **curve.parameters_at(5)) * (1 + by * np.array([1, -1]))
    (row,) = validate(replace(curve, multipliers=mu), [5], 1e-6, multiplier_tolerance=1e-4).rows
    assert row.status == status


def test_a_wrong_verdict_on_stability_is_found(pair):
    """An unstable motion with multipliers of a stable one is reported, and vice versa."""
    middle = pair["LP1"].index + 8
    for i, other, words in ((middle, 5, "disturbances decay"), (5, middle, "disturbances grow")):
        mu = pair.multipliers.copy()
        mu[i] = mu[other]
        (row,) = validate(replace(pair, multipliers=mu), [i], 1e-5, multiplier_tolerance=1e-3).rows
        assert words != row.status and ("disturbances grow" if i == middle else "disturbances decay") in row.status


@pytest.mark.slow
def test_few_harmonics_are_confirmed_with_more_and_their_error_is_stated():
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 5), "Omega", (1.0, 0.9))
    found = validate(curve, 3, 1e-6)
    assert found.ok and all(row.refined and row.harmonics > 5 for row in found.rows)
    for row in found.rows:
        assert row.refined_error < 1e-6 < max(row.rms_error, row.harmonic_error)
        assert row.rms == curve.amplitude("rms")[row.index]  # rms belongs to the curve as traced
        assert row.rms_error == pytest.approx(abs(row.rms / row.rms_true - 1), rel=1e-6)
    assert "3 of them with more harmonics" in repr(found)
    top, low = plot.validation(found, curve).axes
    marks = {line.get_gid(): line for line in (*top.lines, *low.lines)}
    assert len(marks[plot.REFINED].get_xdata()) == 3 and "agrees with integration" not in marks
    np.testing.assert_array_equal(marks["refined_error"].get_ydata(), [row.refined_error for row in found.rows])
    plt.close("all")
    assert all(row.status == "agrees" for row in validate(curve, 3, 1e-2).rows)


def test_a_curve_whose_harmonics_vary_is_refined_too():
    problem = hb.HarmonicBalance(hb.SpurPair(), "auto", tolerance=1e-3)
    (row,) = validate(hb.trace(problem, "Omega", (1.0, 0.9)), [5], 1e-5).rows
    assert row.refined and row.refined_error < 1e-5


@pytest.mark.slow
def test_the_default_harmonics_near_the_fold_of_the_double_helical_pair():
    """At 6e-7 from LP1 the equations are nearly singular: the error exceeds 1e-4 with H = 16, not with H = 32."""
    curve = hb.trace(hb.HarmonicBalance(hb.gears.DoubleHelicalPair(zeta=0.05)), "Omega", (0.87, 0.8453693))
    (row,) = validate(curve, [-1]).rows
    assert row.status == "agrees with H = 32" and row.refined and row.Omega == 0.8453693
    assert row.refined_error < 1e-4 < row.harmonic_error


# ---- selection of points


def test_points_that_matter_are_chosen(pair):
    chosen = dict(choose(pair, 12))
    reasons = " ".join(chosen.values())
    for word in ("near LP1", "near LP2", "near GR1", "peak", "worst error", "between"):
        assert word in reasons
    assert len(chosen) == 12 and list(chosen) == sorted(chosen)
    assert not {p.index for p in pair.special if p.kind == "LP"} & set(chosen)
    assert len(choose(pair, 10_000)) == len(pair) - 2
    assert [i for i, _ in choose(pair, ["GR1", 3, -1])] == sorted([3, pair["GR1"].index, len(pair) - 1])


@pytest.mark.parametrize(
    ("points", "error", "words"),
    [
        (0, ValueError, "at least 1"),
        (10**9, ValueError, "is more than 1,000,000"),
        ([], ValueError, "no points"),
        ([100_000], IndexError, "outside the branch"),
        (["LP9"], KeyError, "no special point 'LP9'"),
    ],
)
def test_points_that_are_not_there(pair, points, error, words):
    with pytest.raises(error, match=words):
        validate(pair, points)


@pytest.mark.parametrize("tolerance", [1e-12, 0.0, 2.0, np.nan])
def test_tolerances_that_cannot_be_met(pair, tolerance):
    with pytest.raises(ValueError, match="must be a finite number" if np.isnan(tolerance) else "cannot be verified"):
        validate(pair, 3, tolerance)
    assert LEAST < 1e-8


def test_a_tolerance_of_multipliers_that_cannot_be_met(pair):
    """A zero tolerance would refine each point to the largest number of harmonics without success."""
    with pytest.raises(ValueError, match="multiplier_tolerance = 0 cannot be verified"):
        validate(pair, 3, multiplier_tolerance=0.0)


# ---- curves from files


def test_a_saved_curve_is_checked_with_the_model_of_its_header(pair, tmp_path):
    pair.save(tmp_path / "pair.npz")
    loaded = hb.load(tmp_path / "pair.npz")
    assert loaded.problem.model == pair.problem.model
    assert validate(loaded, [40], 1e-5).ok and validate(replace(loaded, problem=None), [40], 1e-5).ok


def test_curves_in_another_parameter():
    problem = hb.HarmonicBalance(hb.SpurPair(), 20)
    curve = hb.trace(problem, "zeta", (0.08, 0.06), at={"Omega": 0.9}, stability=False)
    (row,) = validate(curve, [3], 1e-4).rows
    assert row.ok and row.stable is None and row.Omega == 0.9


def test_another_model_is_refused(pair):
    for other, words in (
        (hb.SpurPair(zeta=0.06), "with other zeta"),
        (hb.gears.DoubleHelicalPair(), "was traced with another model"),
        (hb.SpurPair(b=0.5), "breakpoints"),
    ):
        with pytest.raises(ValueError, match=words):
            validate(pair, 2, problem=hb.HarmonicBalance(other, 40))
    with pytest.raises(ValueError, match="the header of the file has no model and balance"):
        validate(replace(pair, problem=None, meta={}), 2)
    unknown = {**pair.meta, "model": {"class": "Pump", "fields": {}}}
    with pytest.raises(KeyError, match="no model class 'Pump'"):
        validate(replace(pair, problem=None, meta=unknown), 2)


def test_a_curve_of_version_0_1_is_validated():
    """Its file has none of the fields that later versions have added; they have their defaults."""
    old = hb.load(Path(__file__).parents[1] / "data" / "schema1.npz")
    assert "mesh_order" not in old.meta["model"]["fields"]
    with pytest.warns(UserWarning, match=r"traced with hbgear 0\.1\.0"):
        assert validate(old, [0], 1e-2).ok
    other = hb.HarmonicBalance(hb.SpurPair(mesh_order=2), old.meta["balance"]["harmonics"])
    with pytest.raises(ValueError, match=r"another model \(with other mesh_order\)"):
        problem_for(old, other)


def test_a_curve_of_folds_is_refused():
    problem = hb.HarmonicBalance(hb.SpurPair(), 8)
    start = hb.trace(problem, "Omega", (1.0, 0.6))["LP1"]
    folds = hb.trace(hb.continuation.FoldProblem(problem, "Omega"), "zeta", (0.05, 0.051), start=start)
    with pytest.raises(ValueError, match="a curve of special points"):
        validate(folds, 1)
    with pytest.raises(ValueError, match="only curves of periodic motions"):
        validate(replace(folds, layout=None), 1)


@pytest.mark.slow
def test_all_curves_of_the_span_are_validated_in_the_units_of_the_drawing():
    model = hb.SpurPair(zeta=0.01, eps=(0, 0.2), reference=(38000.0, 37.6e-6, 15000.0, 25))
    curve = hb.trace(hb.HarmonicBalance(model, 8), "Omega", (1.5, 0.3))
    assert len(curve.curves) == 2
    found = hb.validate(curve, 3, 1e-2)
    assert [row.curve for row in found.rows] == [1, 1, 2]
    for row in found.rows:
        one = curve.curves[row.curve - 1]
        assert row.value == one.values[row.index] and row.rms == pytest.approx(one.amplitude("rms")[row.index])
    assert [(j.curve, j.label) for j in found.jumps] == [
        (k, jump.label) for k, each in enumerate(curve.curves, 1) for jump in each.jumps()
    ]
    headers, rows = found.table()
    assert headers[1:3] == ["pinion r/min", "rms [um]"] and rows[2][0].startswith("2:")
    # n = 60 Omega omega_n / (2 pi z), with omega_n = 38000 rad/s and 25 teeth; lengths in 37.6 um
    assert float(rows[2][1]) == pytest.approx(60 * 38000 * found.rows[2].value / (2 * np.pi * 25), rel=1e-5)
    assert float(rows[2][2]) == pytest.approx(37.6 * found.rows[2].rms, rel=1e-5)
    assert float(found.table(dimensionless=True)[1][2][1]) == pytest.approx(found.rows[2].value, rel=1e-5)


@pytest.mark.slow
def test_points_near_a_fold_lie_beyond_its_error():
    """Within the error of LP2, which is next to a grazing point, the exact motion does not exist."""
    M, K = np.diag([1.0, 0.5]), [[3.0, -1.0], [-1.0, 1.0]]
    stop = hb.Element([1.0, -1.0], hb.Unilateral(k=20.0, gap=0.3))
    C = hb.mechanics.modal_damping(M, K, 0.03)
    model = hb.System(M, C, K, [stop], hb.Load(cosine={1: [0.2, 0.0]}))
    curve = hb.trace(hb.HarmonicBalance(model, 16), "Omega", (1.05, 1.3))
    fold = next(point for point in curve.special if point.kind == "LP" and point.parameters["Omega"] < 1.2)
    near = [curve.values[i] for i, reason in choose(curve, 12) if reason == f"near {fold.label}"]
    assert len(near) == 2 and np.abs(np.subtract(near, fold.parameters["Omega"])).min() > 5 * fold.error > 1e-6
    assert hb.validate(curve, 6, landing="nearest").ok


def test_another_version_is_mentioned(pair):
    with pytest.warns(UserWarning, match=r"traced with hbgear 0\.0\.1"):
        problem_for(replace(pair, meta={**pair.meta, "hbgear": "0.0.1"}))


# ---- tables, files and figures


def test_table_file_and_figure(pair, report, tmp_path):
    headers, rows = report.table()
    assert len(rows) == 10 and {len(row) for row in rows} == {len(headers)} and rows[0][-1] == "agrees"
    report.export(tmp_path / "report.csv")
    text = (tmp_path / "report.csv").read_text().splitlines()
    assert len(text) == 11 and text[0].startswith("index,reason,value,Omega")
    with pytest.raises(ValueError, match=r"must end in \.csv"):
        report.export(tmp_path / "report.txt")
    top, low = plot.validation(report, pair).axes
    marks = {line.get_gid(): line for line in (*top.lines, *low.lines)}
    np.testing.assert_array_equal(marks["agrees with integration"].get_xdata(), [row.value for row in report.rows])
    np.testing.assert_array_equal(marks["rms_error"].get_ydata(), [max(r.rms_error, 1e-16) for r in report.rows])
    plt.close("all")


def test_results_are_kept_after_an_interruption(pair):
    def stop(now):
        if now.done > 0.4:
            raise KeyboardInterrupt

    found = validate(pair, [3, 20, 40, 60], 1e-5, progress=stop)
    assert [row.index for row in found.rows] == [3, 20] and not found.complete and not found.ok
    assert "interrupted" in repr(found)
