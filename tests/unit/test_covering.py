"""A span is covered by one call, or it is said which part of it no curve was found in."""

import csv
import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import loadmat

import hbgear as hb
from hbgear import Status
from hbgear.analysis.branch_search.multistart import complete_branch
from hbgear.continuation.tracing import coverage
from hbgear.continuation.tracing.coverage import uncovered_intervals

PAIR = hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,))
THROUGH_INFINITY = hb.SpurPair(zeta=0.0114, F_m=0.248, eps=(0.028, 0.18, 0.219), e=(0.0188,))


def two_elements():
    """The motion found at Omega = 2.5 lies on a loop that turns back there."""
    stops = [
        hb.Element([0, 1], hb.Backlash(b=0.5514427, k=2.4076872)),
        hb.Element([1, 0], hb.Backlash(b=0.4821965, k=29.1391655)),
    ]
    return hb.System(
        np.diag([1.343, 0.8225]),
        [[0.06589, -0.02677], [-0.02677, 0.05806]],
        [[3.7676, -1.9224], [-1.9224, 3.579]],
        stops,
        hb.Load(cosine={1: [0, 0.26142156]}),
    )


def traced(model, span, **options):
    return hb.trace(hb.HarmonicBalance(model), "Omega", span, **{"stability": False, **options})


@pytest.fixture(scope="module")
def pair():
    return hb.trace(hb.HarmonicBalance(PAIR, 8), "Omega", (1.5, 0.3))


def left_over(curve, span):
    return uncovered_intervals([curve, *curve.others], span)


def passing(low, high, **asymptotes):
    """A branch that passes a range of its parameter."""
    return SimpleNamespace(values=np.array([low, high]), asymptotes=asymptotes)


@pytest.mark.parametrize(("free", "gap"), [(0.9e-4, False), (1.1e-4, True), (5e-3, True)])
def test_a_gap_is_longer_than_a_ten_thousandth_of_the_span(free, gap):
    """Between two branches, at the beginning and at the end of the span (2, 4), in either direction."""
    free *= 2.0
    for span in ((2.0, 4.0), (4.0, 2.0)):
        between = uncovered_intervals([passing(3.0 + free, 4.0), passing(3.0, 2.0)], span)
        assert between == ([(3.0, 3.0 + free)] if gap else [])
        assert uncovered_intervals([passing(2.0 + free, 4.5)], span) == ([(2.0, 2.0 + free)] if gap else [])
        assert uncovered_intervals([passing(1.5, 4.0 - free)], span) == ([(4.0 - free, 4.0)] if gap else [])


def test_a_branch_passes_its_asymptote_and_hides_branches_within():
    branches = [passing(2.0, 2.4, last=2.8), passing(2.1, 2.2), passing(3.5, 3.1)]
    assert uncovered_intervals(branches, (2.0, 4.0)) == [(2.8, 3.1), (3.5, 4.0)]
    assert uncovered_intervals([], (4.0, 2.0)) == [(2.0, 4.0)]


@pytest.mark.parametrize(("gain", "count"), [(1e-9, 0), (0.9e-4, 0), (1.1e-4, 1), (0.1, 1)])
def test_a_curve_that_is_traced_again_is_no_further_curve(gain, count):
    """It ends at other rounding errors: only a curve that covers a ten-thousandth of the span more is kept."""

    def branch(low):
        values = np.array([low, 4.0])
        return SimpleNamespace(values=values, asymptotes={}, unbounded_ends=(), status=Status.CLOSED, parameter="Omega")

    search = coverage.CoverageSearch(
        lambda span, start, rough: branch(3.0 - 2.0 * gain), lambda value, X: SimpleNamespace(direction=1.0), None
    )
    others = []
    coverage.cover_span(branch(3.0), others, (2.0, 4.0), search)
    assert len(others) == count


def test_a_curve_with_the_largest_number_of_points_ends_the_search():
    """Each further start would take as many points again."""
    starts = []

    def follow(span, start, rough):
        values = np.array([2.5 + 0.1 * len(starts), 2.6 + 0.1 * len(starts)])
        return SimpleNamespace(
            values=values, asymptotes={}, unbounded_ends=(), status=Status.MAX_POINTS, parameter="Omega", message=""
        )

    def start(value, X):
        starts.append(value)
        return SimpleNamespace(direction=1.0)

    others, first = [], SimpleNamespace(values=np.array([2.0, 2.1]), asymptotes={}, unbounded_ends=())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "trace_both_directions", lambda start, span, follow, _: follow(span, start))
        coverage.cover_span(first, others, (4.5, 2.0), coverage.CoverageSearch(follow, start, None))
    assert len(starts) == len(others) == 1


@pytest.mark.parametrize("status", list(Status))
def test_a_curve_that_is_whole_one_way_is_not_followed_back(monkeypatch, status):
    """Closed, or retraced to its beginning: the other way leads along the same curve."""
    asked = []
    monkeypatch.setattr(coverage, "concatenate", lambda *branches: branches[0])
    monkeypatch.setattr(coverage, "replace", lambda given, **changes: SimpleNamespace(**{**vars(given), **changes}))

    def follow(span, start):
        asked.append((span, start.direction))
        return SimpleNamespace(status=status)

    coverage.trace_both_directions(SimpleNamespace(direction=1.5), (4.0, 2.0), follow, None)
    whole = status in (Status.CLOSED, Status.RETRACED)
    assert asked == [((2.0, 4.0), 1.5), ((4.0, 2.0), -1.5)][: 1 if whole else 2]


def test_a_curve_that_turns_back_to_its_own_end_is_completed_from_the_other():
    curve = traced(two_elements(), (2.5, 0.3))
    assert curve.status is Status.LEFT_SPAN and uncovered_intervals([curve], (2.5, 0.3)) != []
    (other,) = curve.others
    assert other.status is Status.REACHED_END and (other.values[0], other.values[-1]) == (0.3, 2.5)
    assert curve.message == "the curve turned back to Omega = 2.5; another curve covers the rest of the span"
    from_there = traced(two_elements(), (0.3, 2.5))
    np.testing.assert_array_equal(other.X, from_there.X)
    assert from_there.others == () and from_there.message == "Omega = 2.5 reached"


def test_the_span_of_a_curve_that_runs_off_to_infinity_is_covered(pair):
    """What lies below the fold at Omega = 0.396 was never reached."""
    assert pair.values.min() == pytest.approx(0.3957, abs=1e-3)
    assert left_over(pair, (1.5, 0.3)) == [] and [other.status for other in pair.others] == [Status.LEFT_SPAN]
    assert pair.message.endswith("towards Omega = 1.04828; another curve covers the rest of the span")
    assert all(other.multipliers is not None for other in pair.others)


def test_a_curve_is_taken_up_again_on_the_other_side_of_infinity():
    """Where X runs off, -X comes back; each curve begins at the asymptote the one before ended at."""
    curve = traced(THROUGH_INFINITY, (1.5, 0.3))
    assert curve.status is Status.UNBOUNDED and left_over(curve, (1.5, 0.3)) == []
    backs = [other for other in curve.others if other.asymptotes]
    known = list(curve.asymptotes.values())
    for other in backs:
        nearest = min(abs(a - b) for a in other.asymptotes.values() for b in known)
        assert nearest < 1e-9
        known += other.asymptotes.values()
    assert backs
    back = backs[0]
    end = next(end for end, value in back.asymptotes.items() if abs(value - curve.asymptotes["last"]) < 1e-9)
    X = back.X[0 if end == "first" else -1]
    assert X @ curve.X[-1] < -0.95 * np.linalg.norm(X) * np.linalg.norm(curve.X[-1])
    for other in backs:  # rows of both ways, in one order
        steps = np.linalg.norm(np.diff(other.X, axis=0), axis=1)
        assert steps.max() < 0.1 * np.linalg.norm(other.X, axis=1).max() and other.residual.max() < 1e-10


def test_a_survey_follows_a_curve_that_runs_off_both_ways(pair):
    """From a motion in the middle of the curve: one way to infinity, the other way to the end of the span."""
    i = int(np.argmin(np.abs(pair.values - 0.7)))
    branch = complete_branch(pair.problem, pair.X[i], float(pair.values[i]), (1.5, 0.3), hb.StepControl(), True)
    assert (branch.values[0] == 1.5) != (branch.values[-1] == 1.5) and len(branch.asymptotes) == 1
    assert branch.values.min() == pytest.approx(pair.values[pair["LP1"].index], abs=1e-6)
    (mine,), (theirs,) = branch.jumps(), pair.jumps()
    assert mine.value == pytest.approx(theirs.value, abs=1e-8) and mine.direction == theirs.direction


@pytest.mark.parametrize("seed", range(6))
def test_random_pairs_are_covered(seed):
    rng = np.random.default_rng(seed)
    eps = tuple(rng.uniform(0.1, 0.3, 2))
    model = hb.SpurPair(zeta=10 ** rng.uniform(-2.3, -1.5), F_m=rng.uniform(0.02, 0.3), eps=eps, e=(0.05,))
    curve = traced(model, (1.5, 0.3))
    assert left_over(curve, (1.5, 0.3)) == [] and max(map(len, curve.curves)) < 1500


# ---- any equations


class Broken:
    """x^2 = (p - 1)(p - 2): nothing lies between p = 1 and p = 2."""

    asked = ()

    def evaluate(self, X, p):
        return np.array([X[0] ** 2 - (p - 1) * (p - 2)]), np.array([[2 * X[0]]])

    def start(self, p):
        self.asked = (*self.asked, p)
        if 1 < p < 2:
            raise hb.NoConvergence("nothing there", np.zeros(1), {"p": p}, [1.0])
        return np.array([((p - 1) * (p - 2)) ** 0.5])


def test_ranges_without_a_curve_are_reported():
    curve = hb.trace(Broken(), "p", (0.0, 3.0))
    assert curve.status is Status.LEFT_SPAN and [other.values[0] for other in curve.others] == [3.0]
    assert curve.message == (
        "the curve turned back to p = 0; another curve covers more of the span; no curve was found from p = 1 to 2"
    )


def test_from_the_other_end_where_nothing_is_found_at_the_beginning():
    curve = hb.trace(Broken(), "p", (1.5, 3.0))
    assert curve.values[0] == 3.0 and curve.values.min() == pytest.approx(2.0)
    assert curve.message.endswith("no solution was found at p = 1.5: followed from the other end")
    for span, options in (((1.2, 1.8), {}), ((1.5, 3.0), {"cover": False})):
        with pytest.raises(hb.NoConvergence, match="nothing there"):
            hb.trace(Broken(), "p", span, **options)


class Middle(Broken):
    """Curves at both ends that turn back, and one between that closes: (x - 5)^2 + (p - 1.5)^2 = 0.45^2."""

    def evaluate(self, X, p):
        outer, slope = (a[0] for a in super().evaluate(X, p))
        inner = (X[0] - 5) ** 2 + (p - 1.5) ** 2 - 0.45**2
        return np.array([outer * inner]), np.array([[slope[0] * inner + outer * 2 * (X[0] - 5)]])

    def start(self, p):
        return np.array([5 + (0.45**2 - (p - 1.5) ** 2) ** 0.5]) if abs(p - 1.5) < 0.45 else super().start(p)


def test_motions_found_in_a_gap_are_traced():
    curve = hb.trace(Middle(), "p", (0.0, 3.0))
    assert [other.status for other in curve.others] == [Status.LEFT_SPAN, Status.CLOSED]
    assert "no curve was found from p = 1 to 1.05 and 1.95 to 2" in curve.message


class Line(Broken):
    """Curves at both ends that turn back, and one through all of the span that starts only find between: x = 4 + p."""

    def evaluate(self, X, p):
        outer, slope = (a[0] for a in super().evaluate(X, p))
        return np.array([outer * (X[0] - 4 - p)]), np.array([[slope[0] * (X[0] - 4 - p) + outer]])

    def start(self, p):
        return np.array([4.0 + p]) if 1 < p < 2 else super().start(p)


def test_a_curve_that_is_found_inside_of_the_span_is_followed_both_ways():
    curve = hb.trace(Line(), "p", (0.0, 3.0))
    through = curve.others[-1]
    assert sorted([through.values[0], through.values[-1]]) == [0.0, 3.0] and np.all(np.diff(through.values) > 0)
    np.testing.assert_allclose(through.X[:, 0], 4 + through.values, rtol=1e-9)
    assert "no curve" not in curve.message and curve.others[-1].message == "p = 3 reached; the other way p = 0 reached"


def test_no_more_is_done_than_needed():
    """One start where the curve leads through; none beyond the first where more is not wanted or cannot be meant."""
    through = Line()
    through.start = lambda p: calls.append(p) or np.array([4.0 + p])
    calls = []
    assert hb.trace(through, "p", (0.0, 3.0)).others == () and calls == [0.0]
    problem = Broken()
    assert hb.trace(problem, "p", (0.0, 3.0), cover=False).message == "the curve turned back to p = 0"
    assert hb.trace(problem, "p", (0.0, 3.0), np.array([2**0.5])).others == ()
    assert hb.trace(problem, "p", (0.0, 3.0), steps=hb.StepControl(max_points=9)).others == ()
    assert problem.asked == (0.0, 0.0)


@pytest.mark.slow
def test_curves_of_different_harmonics_are_joined():
    """The number of harmonics varies from row to row, and so from way to way."""
    problem = hb.HarmonicBalance(THROUGH_INFINITY, "auto", tolerance=1e-3)
    curve = hb.trace(problem, "Omega", (1.5, 0.3), stability=False)
    assert curve.others and left_over(curve, (1.5, 0.3)) == []
    assert all(other.X.shape[1] == other.layout.width for other in curve.others)


# ---- interruptions


def stopped_in_the_second(error):
    """Progress that raises at the 20th point of the second curve."""
    seen = []

    def progress(now):
        seen.append(now.numbers["points"])
        if seen.count(2) == 2 and seen[-1] == 20:
            raise error

    return progress


def test_an_interruption_keeps_all_curves():
    curve = hb.trace(Broken(), "p", (0.0, 3.0), progress=stopped_in_the_second(KeyboardInterrupt))
    assert curve.status is Status.INTERRUPTED and "while the rest of the span was searched" in curve.message
    assert curve.values[-1] == 0.0 and [len(other) for other in curve.others] == [20]


def test_an_exception_of_progress_comes_with_all_curves():
    with pytest.raises(ZeroDivisionError) as caught:
        hb.trace(Broken(), "p", (0.0, 3.0), progress=stopped_in_the_second(ZeroDivisionError()))
    branch = caught.value.branch
    assert branch.values[-1] == 0.0 and [len(other) for other in branch.others] == [20]


# ---- what is kept


def test_files_keep_all_curves(pair, tmp_path):
    for name in ("c.npz", "c.csv", "c.mat"):
        (pair.save if name.endswith("z") else pair.export)(tmp_path / name)
    again = hb.load(tmp_path / "c.npz", problem=pair.problem)
    assert again.status is Status.UNBOUNDED and again.asymptotes == pair.asymptotes
    for old, new in zip(pair.others, again.others, strict=True):
        assert np.array_equal(old.X, new.X) and old.message == new.message and new.problem is pair.problem
        assert [p.label for p in old.special] == [p.label for p in new.special]
    with open(tmp_path / "c.csv", newline="", encoding="utf-8") as handle:
        rows = list(csv.DictReader(line for line in handle if not line.startswith("#")))
    curves = pair.curves
    assert [row["curve"] for row in rows] == [str(i + 1) for i, c in enumerate(curves) for _ in range(len(c))]
    np.testing.assert_array_equal([float(r["Omega"]) for r in rows], np.concatenate([c.values for c in curves]))
    (other,) = np.atleast_1d(loadmat(tmp_path / "c.mat", simplify_cells=True)["others"])
    np.testing.assert_array_equal(other["values"], pair.others[0].values)
    assert "1 other curve" in repr(pair)


@pytest.mark.parametrize(
    ("known", "words"),
    [
        ([1.0], "asymptotes other than those of the first"),
        ({"middle": 1.0}, "asymptotes other than those of the first"),
        ({"last": "x"}, "not finite numbers"),
    ],
)
def test_a_file_with_made_up_asymptotes_is_refused(pair, tmp_path, known, words):
    pair.save(tmp_path / "c.npz")
    with np.load(tmp_path / "c.npz") as handle:
        arrays = dict(handle)
    header = json.loads(str(arrays["header"]))
    header["branch"]["meta"]["asymptotes"] = known
    arrays["header"] = np.array(json.dumps(header))
    np.savez(tmp_path / "d.npz", **arrays)
    with pytest.raises(ValueError, match=words):
        hb.load(tmp_path / "d.npz")


def test_extended_curves_keep_the_other_branches():
    part = hb.trace(Broken(), "p", (0.0, 3.0))
    whole = hb.extend(part, (-1.0, 3.0))
    assert whole.others == part.others and len(whole.others) == 1 and whole.values[-1] == -1.0


def test_every_curve_of_a_span_is_extended():
    """Both branches of x^2 = (p - 1)(p - 2) end early: each goes on to the other side of its fold, x -> -x."""
    few = hb.StepControl(max_points=8)
    first, other = (hb.trace(Broken(), "p", span, steps=few, cover=False) for span in ((0.0, 3.0), (3.0, 0.0)))
    both = dataclasses.replace(first, others=(other,))
    whole = hb.extend(both)
    for curve, part, end in zip(whole.curves, both.curves, (0.0, 3.0), strict=True):
        assert part.status is Status.MAX_POINTS and curve.status is Status.LEFT_SPAN
        assert np.array_equal(curve.X[: len(part)], part.X) and len(curve["LP1"].X) == 1
        assert curve.values[-1] == end and curve.X[-1] == pytest.approx(-curve.X[0], rel=1e-9)
    assert whole["LP1"].parameters["p"] == pytest.approx(1.0) and whole.others[0]["LP1"].parameters[
        "p"
    ] == pytest.approx(2.0)
    assert hb.extend(dataclasses.replace(whole, others=(other,))).others[0].status is Status.LEFT_SPAN
    with pytest.raises(ValueError, match=r"the branch ends at p = 0, where it leaves the span"):
        hb.extend(whole)
    longer = hb.extend(whole, (-1.0, 4.0))
    assert [curve.values[-1] for curve in longer.curves] == [-1.0, 4.0]


def test_ctrl_c_in_one_curve_keeps_the_next_ones_as_they_are():
    few = hb.StepControl(max_points=8)
    first, other = (hb.trace(Broken(), "p", span, steps=few, cover=False) for span in ((0.0, 3.0), (3.0, 0.0)))

    def stop(progress):
        raise KeyboardInterrupt

    whole = hb.extend(dataclasses.replace(first, others=(other,)), progress=stop)
    assert whole.status is Status.INTERRUPTED and whole.others == (other,)
