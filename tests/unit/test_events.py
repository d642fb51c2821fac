"""User-defined events: located, labelled, saved, listed, drawn, usable as starts and followed in a second parameter."""

import csv
import pickle
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import hbgear as hb
from hbgear.cli.app import main
from hbgear.continuation.curve.segment import Segment, point_from_solution
from hbgear.continuation.events.event import RESERVED, is_marker, locate_root
from hbgear.continuation.events.fold import CuspEvent
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.bifurcations.events import KINDS
from hbgear.harmonic.bifurcations.multiplier_events import PeriodDoublingMergeEvent

LIMIT = hb.Event("limit", lambda point: point.amplitude("max") - 1.3, "the largest deflection is 1.3", marker="*")


@pytest.fixture(scope="module")
def curve():
    return hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6), events=[LIMIT])


def test_located_and_labelled(curve):
    points = [point for point in curve.special if point.kind == "limit"]
    assert [point.label for point in points] == ["limit1", "limit2"]
    for point in points:
        assert point.located and point.meaning == "the largest deflection is 1.3" and point.marker == "*"
        assert point.amplitude("max") == pytest.approx(1.3, abs=1e-9)
        low, high = sorted(point.interval)
        assert low <= point.parameters["Omega"] <= high
    alone = hb.trace(curve.problem, "Omega", (1.2, 0.6))
    assert [p.label for p in curve.special if p.kind != "limit"] == [p.label for p in alone.special]


def test_every_crossing_between_points_is_found(curve):
    size = curve.amplitude("max") - 1.3
    assert sum(size[:-1] * size[1:] < 0) <= 2 == sum(point.kind == "limit" for point in curve.special)


def test_saved_and_loaded(curve, tmp_path):
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz")
    point = again["limit1"]
    assert (point.meaning, point.marker) == ("the largest deflection is 1.3", "*")
    assert point.amplitude("max") == curve["limit1"].amplitude("max")


def test_a_start(curve):
    again = hb.trace(curve.problem.at_resolution_of(curve["limit1"]), "Omega", (1.2, 0.6), start=curve["limit1"])
    np.testing.assert_allclose(again.X[0], curve["limit1"].X, atol=1e-9)


def test_followed_in_a_second_parameter(curve):
    """The frequency at which the largest deflection is 1.3, at another damping, agrees with a new trace to 1e-9."""
    held = hb.follow(curve, "limit1", "zeta", (0.05, 0.052))
    assert held.status is hb.Status.REACHED_END
    np.testing.assert_allclose(held.amplitude("max"), 1.3, atol=1e-9)
    fresh = hb.trace(curve.problem, "Omega", (1.2, 0.6), at={"zeta": 0.052}, events=[LIMIT])
    assert held.tracked["Omega"][-1] == pytest.approx(fresh["limit1"].parameters["Omega"], abs=1e-9)


def values_of(branch):
    return branch.values, branch.tracked["Omega"], branch.X


@pytest.mark.parametrize(
    ("label", "equations"),
    [
        ("LP1", lambda p, curve: hb.continuation.FoldProblem(p, "Omega")),
        ("GR1", lambda p, curve: hb.harmonic.GrazingProblem(p, "Omega", p.clearance_names.index(curve["GR1"].note))),
    ],
)
def test_follow_is_the_trace_of_the_equations(curve, label, equations):
    span = (0.05, 0.055)
    followed = hb.follow(curve, label, "zeta", span)
    traced = hb.trace(equations(curve.problem, curve), "zeta", span, start=curve[label])
    for one, other in zip(values_of(followed), values_of(traced), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_follow_a_doubling_and_a_peak(curve):
    problem = hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 6)
    doubled = hb.trace(problem, "Omega", (2.2, 1.7))
    followed = hb.follow(doubled, "PD1", "zeta", (0.05, 0.052))
    mu = problem.multipliers(followed.X[-1], **followed.parameters_at(-1))
    assert abs(mu + 1).min() < 1e-3
    for measure in ("rms", "H2", "pp2", "max"):
        peak = hb.analysis.peaks(curve, measure)[0]
        held = hb.follow(curve, peak, "zeta", (0.05, 0.055))
        fresh = hb.trace(curve.problem, "Omega", (1.2, 0.6), at={"zeta": 0.055})
        top = hb.analysis.peaks(fresh, measure)[0].parameters["Omega"]
        assert held.tracked["Omega"][-1] == pytest.approx(top, abs=1e-9)


def test_invalid_second_parameters_are_refused(curve, tmp_path):
    flip = hb.Event("flip", lambda point: abs(point.multipliers[0]) - 1.0)
    with pytest.raises(ValueError, match="'flip' cannot be followed: its test may use only the unknowns"):
        flip.equations(curve.problem, "Omega", curve["LP1"])
    for kind in (CuspEvent, PeriodDoublingMergeEvent):
        point = replace(curve["LP1"], kind=kind.kind, label=f"{kind.kind}1", meaning=kind.meaning, event=kind())
        with pytest.raises(ValueError, match=f"{kind.kind}1 .* cannot be followed in a second parameter"):
            hb.follow(curve, point, "zeta", (0.05, 0.06))
    folds = hb.follow(curve, "LP1", "zeta", (0.05, 0.051))
    with pytest.raises(ValueError, match="the branch is a curve of special points;"):
        hb.follow(folds, curve["LP1"], "F_m", (0.1, 0.11))
    with pytest.raises(TypeError, match="needs the label of a special point"):
        hb.follow(curve, 3, "zeta", (0.05, 0.06))
    with pytest.raises(hb.NoConvergence, match=r"LP1 \(stated error .*\) cannot be followed, because it"):
        hb.follow(curve, replace(curve["LP1"], X=-3 * curve["LP1"].X), "zeta", (0.05, 0.06))
    with pytest.raises(ValueError, match="event 'other' did not locate limit1"):
        hb.follow(curve, "limit1", "zeta", (0.05, 0.06), event=hb.Event("other", LIMIT.test))


@pytest.mark.slow
def test_a_loaded_curve_knows_the_events_of_its_problem_and_needs_yours(curve, tmp_path):
    curve.save(tmp_path / "curve.npz")
    again = hb.load(tmp_path / "curve.npz")
    with pytest.raises(ValueError, match="needs the problem of the branch"):
        hb.follow(replace(again, problem=None, meta={}), "LP1", "zeta", (0.05, 0.051))
    for label, options in (("LP1", {}), ("limit1", {"event": LIMIT})):
        one, other = (hb.follow(c, label, "zeta", (0.05, 0.051), **options) for c in (curve, again))
        np.testing.assert_array_equal(one.X, other.X)
    with pytest.raises(ValueError, match=r"the event that located limit1 is unknown.*give event="):
        hb.follow(again, "limit1", "zeta", (0.05, 0.051))


OLD = Path(__file__).parents[1] / "data" / "schema1.npz"  # hbgear at d546e19: no meanings, no markers


def test_a_file_of_schema_1(tmp_path):
    old = hb.load(OLD)
    assert [(p.label, p.meaning, p.marker) for p in old.special] == [("LP1", "fold: the curve turns back", "o")]
    assert old["LP1"].parameters["Omega"] == pytest.approx(0.708030808011212, abs=1e-9)
    old.save(tmp_path / "new.npz")
    assert old.meta["trace"]["steps"]["longest"] == 0.04 and "max_step" not in old.meta["trace"]["steps"]
    assert hb.load(tmp_path / "new.npz").meta["trace"] == old.meta["trace"]
    assert hb.load(tmp_path / "new.npz")["LP1"].meaning == old["LP1"].meaning
    with np.load(OLD) as archive:
        arrays = dict(archive)
    assert '"schema": 1' in str(arrays["header"]) and "meaning" not in str(arrays["header"])
    strange = np.array(str(arrays["header"]).replace('"kind": "LP"', '"kind": "XY"'))
    np.savez(tmp_path / "strange.npz", **{**arrays, "header": strange})
    point = hb.load(tmp_path / "strange.npz").special[0]
    assert (point.meaning, point.marker) == ("XY", hb.Event.marker)


def test_a_marker_in_a_file_that_cannot_be_drawn(curve, tmp_path):
    curve.save(tmp_path / "curve.npz")
    with np.load(tmp_path / "curve.npz") as archive:
        arrays = dict(archive)
    header = np.array(str(arrays["header"]).replace('"marker": "*"', '"marker": "$\\\\frac$"'))
    np.savez(tmp_path / "wrong.npz", **{**arrays, "header": header})
    with pytest.raises(ValueError, match=r"special\.0\.marker is .*; need one of \. , o v"):
        hb.load(tmp_path / "wrong.npz")


def test_one_table_of_kinds():
    """The reserved kinds are the kinds of the table, and each kind has its own marker."""
    assert set(RESERVED) == set(KINDS)
    markers = [event.marker for event in KINDS.values()]
    assert len({*markers, hb.Event.marker}) == len(markers) + 1
    assert all(event.meaning and is_marker(event.marker) for event in KINDS.values())


def test_the_table_of_labels_in_the_pages():
    page = (Path(__file__).parents[2] / "docs" / "labels.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| ([A-Z]+) \| ([^|]+) \|", page, re.MULTILINE))
    assert {kind: rows.get(kind) for kind in KINDS} == {
        kind: event.meaning.partition(": ")[0] for kind, event in KINDS.items()
    }


def test_drawn_with_marker_label_and_entry(curve):
    ax = hb.plot.response(curve, "max")
    drawn = {line.get_gid(): line for line in ax.lines}
    assert drawn["limit1"].get_marker() == "*" and drawn["LP1"].get_marker() == KINDS["LP"].marker
    assert any(text.get_text() == "limit1" for text in ax.texts)
    entries = [text.get_text() for text in ax.get_legend().get_texts()]
    assert entries[-1] == "the largest deflection is 1.3 (limit)" and entries.count(entries[-1]) == 1


def test_exported(curve, tmp_path):
    curve.export(tmp_path / "curve.csv")
    with (tmp_path / "curve.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert [i for i, row in enumerate(rows) if row["special"] == "limit1"] == [curve["limit1"].index]
    curve.export(tmp_path / "curve.mat")
    points = loadmat(tmp_path / "curve.mat", simplify_cells=True)["special"]
    found = next(point for point in points if point["label"] == "limit1")
    assert (found["meaning"], found["marker"], found["row"]) == (LIMIT.meaning, "*", curve["limit1"].index + 1)


def exit_of(words):
    with pytest.raises(SystemExit) as end:
        main(words)
    return end.value.code


def test_on_the_command_line(curve, tmp_path, capsys):
    file, figure = tmp_path / "curve.npz", tmp_path / "point.png"
    curve.save(file)
    assert exit_of(["info", str(file)]) == 0
    assert re.search(r"limit1 .* the largest deflection is 1\.3", capsys.readouterr().out)
    assert exit_of(["plot", str(file), "--point", "limit1", "-o", str(figure)]) == 0 and figure.stat().st_size > 1000
    line = ["trace", "spur-pair", "--start", f"{file}:limit1", "--from", "1.2", "--to", "0.6", "--harmonics", "8"]
    assert exit_of([*line, "--max-points", "2", "-o", str(tmp_path / "more.npz")]) == 3
    more = hb.load(tmp_path / "more.npz")
    assert more.values[0] == pytest.approx(curve["limit1"].parameters["Omega"], abs=1e-12)


def test_the_equations_cannot_be_changed(curve):
    """Evaluation does not change them either: four threads that share them get identical results."""
    problem = curve.problem
    every = (
        hb.continuation.FoldProblem(problem),
        hb.harmonic.PeriodDoublingProblem(problem),
        hb.harmonic.GrazingProblem(problem),
        hb.harmonic.AmplitudeExtremum(problem),
        LIMIT.equations(problem, "Omega", curve["limit1"]),
    )
    points = [np.append(curve.X[i], curve.values[i]) for i in range(0, len(curve), 12)]
    zeta = curve.fixed
    for equations in every:
        for name in ("parameter", "base", "anything"):
            with pytest.raises(AttributeError, match=f"{type(equations).__name__} cannot be changed"):
                setattr(equations, name, None)
        based = equations.with_borders_at(points[0], zeta)
        assert equations.base is None and based.base is not None and based.problem is equations.problem
        for one in (equations, based):
            before = dict(vars(one))
            alone = [one.evaluate(U, **zeta) for U in points]
            with ThreadPoolExecutor(4) as pool:
                together = list(pool.map(lambda U, one=one: one.evaluate(U, **zeta), reversed(points)))
            for (R, J), (R2, J2) in zip(alone, reversed(together), strict=True):
                np.testing.assert_array_equal(R, R2)
                np.testing.assert_array_equal(J, J2)
            assert vars(one).keys() == before.keys() and all(vars(one)[k] is x for k, x in before.items())


def test_pickled_without_the_event(curve):
    again = pickle.loads(pickle.dumps(curve))
    assert again["limit1"].meaning == LIMIT.meaning and again["limit1"].event is None
    assert curve["limit1"].event is LIMIT


def test_a_terminal_event_ends_the_trace(curve):
    stop = hb.Event("stop", lambda point: point.amplitude("max") - 1.3, terminal=True)
    cut = hb.trace(curve.problem, "Omega", (1.2, 0.6), events=[stop])
    assert cut.status is hb.Status.EVENT and cut.status.complete
    assert cut.special[-1].label == "stop1" and cut.special[-1].index == len(cut) - 1
    assert cut.values[-1] == pytest.approx(curve.values[curve["limit1"].index], abs=1e-12)


def test_without_special_points_only_own_events():
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6), special=False, events=[LIMIT])
    assert {point.kind for point in curve.special} == {"limit"}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: hb.Event("LP", abs), "reserved by hbgear"),
        (lambda: hb.Event("two words", abs), "must be letters"),
        (lambda: hb.Event("", abs), "must be letters"),
        (lambda: hb.Event("limit", 2.0), "needs a function of a point"),
        (lambda: hb.Event("limit", abs, marker="star"), "marker = 'star' must be one of"),
    ],
)
def test_bad_input(make, words):
    with pytest.raises((ValueError, TypeError), match=words):
        make()


def test_two_of_one_name(curve):
    with pytest.raises(ValueError, match="two events have the kind limit"):
        hb.trace(curve.problem, "Omega", (1.2, 0.6), events=[LIMIT, LIMIT])


def test_a_test_that_is_not_finite(curve):
    broken = hb.Event("broken", lambda point: float("nan"))
    with pytest.raises(ValueError, match="the test of the event 'broken' is nan"):
        broken.test(curve[0])


def test_a_root_is_not_the_end_where_a_growing_function_is_less():
    """(p - .9) exp(60 p) is -.9 at 0 and 1e10 at .9 + 1e-13: the root is not the end with the smaller value."""

    class Line:
        def evaluate(self, X, p):
            return X - p, np.eye(1)

    problem = as_problem(Line())
    rows = [
        point_from_solution(solve(problem, np.zeros(1), {"p": p}, "p"), np.array([0.0, 1.0]), np.ones(2))
        for p in (0.0, 1.0)
    ]
    segment = Segment(problem, "p", {}, *rows, np.ones(2), hb.NewtonSettings())
    found = locate_root(segment, LIMIT, lambda row: (row.value - 0.9) * np.exp(60 * row.value))
    assert found.located and found.point.value == pytest.approx(0.9, abs=1e-12)
