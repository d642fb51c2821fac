"""Candidates for zeros of a test function between points where it has equal signs, and the search for the zeros."""

import math
from dataclasses import replace

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.curve.segment import Segment, point_from_solution
from hbgear.continuation.events.detector import EventDetector
from hbgear.continuation.events.even_crossings import SampledCurve, drop_odd_counts, find_even_crossings
from hbgear.continuation.events.event import Event, LocatedEvent
from hbgear.continuation.events.near_tangency import near_zeros
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.solvers.newton import solution_at
from hbgear.harmonic.bifurcations.multiplier_events import MotionBranchPointEvent


def found(f, x):
    x = np.asarray(x, dtype=float)
    return near_zeros(np.array([f(x)]).T, np.diff(x))


def places(f, x):
    return [x[i] + s * (x[i + 1] - x[i]) for i, s in found(f, x)]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_parabola_through_three_points(sign):
    x = [0.0, 1.0, 1.9, 3.0]
    assert places(lambda x: sign * ((x - 1.4) ** 2 - 0.04), x) == pytest.approx([1.4])
    assert not found(lambda x: sign * ((x - 1.4) ** 2 + 2.0), x)


def test_lines_meet_beyond_zero_on_a_piece_longer_than_others():
    """The secants of the short outer segments reach zero on the long middle segment before they intersect."""
    x = np.array([0.0, 0.2, 3.2, 3.4])
    ((piece, s),) = found(lambda x: np.abs(x - 1.7) - 1.0, x)
    assert piece == 1 and s == pytest.approx(0.5)
    assert not found(lambda x: np.abs(x - 1.7) + 0.1, x)


@pytest.mark.parametrize("mirror", [1, -1])
def test_a_line_that_reaches_zero_at_once(mirror):
    """det(Phi + 1) of two masses, steep on one side, flat on the other: zero at .9386125 and .9422022."""
    x = np.array([0.923315, 0.9320736, 0.9363386, 0.9423536, 0.9444353, 0.9462202])[::mirror]
    f = np.array([-19.30286, -12.07228, -7.12432, -0.01074, -0.14504, -0.26161])[::mirror, None]
    between = [x[i] + s * (x[i + 1] - x[i]) for i, s in near_zeros(f, np.abs(np.diff(x)))]
    assert any(0.9386125 < place < 0.9422022 for place in between)


def test_unknown_values_and_few_points():
    assert near_zeros(np.full((4, 2), np.nan), np.ones(3)) == []
    assert near_zeros(np.ones((2, 1)), np.ones(1)) == []
    assert near_zeros(np.array([[1.0], [-1.0], [1.0], [2.0]]), np.ones(3)) == []  # a sign change is no candidate


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("where", [0.07, 0.28, 0.74, 1.28, 1.8])
def test_the_minimum_of_a_parabola_between_unequal_steps_is_exact(where, sign):
    """Three points determine a parabola; its minimum lies on the first, an inner or the last segment."""
    x = np.array([0.0, 0.1, 0.35, 0.5, 1.0, 1.15, 1.7, 2.0])
    places = dict(near_zeros(sign * ((x - where) ** 2 + 1e-4)[:, None], np.diff(x)))
    segment = int(np.searchsorted(x, where)) - 1
    assert x[segment] + places[segment] * (x[segment + 1] - x[segment]) == pytest.approx(where, abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("where", "least", "near"), [(0.6, 0.0533, True), (0.6, 0.0534, False), (1.3, 0.0299, True), (1.3, 0.0301, False)]
)
def test_a_minimum_below_a_quarter_of_the_smallest_value(where, least, near, sign):
    """(x - c)^2 + m at 0, 1, 2: the smallest value is d^2 + m at distance d from c; a candidate needs m < d^2 / 3."""
    x = np.arange(3.0)
    found = dict(near_zeros(sign * ((x - where) ** 2 + least)[:, None], np.diff(x)))
    assert (int(where) in found) == near
    if near:
        assert found[int(where)] == pytest.approx(where % 1, abs=1e-12)


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize(("at_end", "near"), [(0.19, True), (0.21, False)])
def test_a_single_secant_reaches_zero_within_a_fifth_of_the_segment(at_end, near, mirror):
    """The secant of the first segment, of length 2, reaches zero after that fraction of the second, of length 1."""
    a = at_end / 2 / (1 + at_end / 2)
    f, length = np.array([1.0, a, a, 1.001 * a]), np.array([2.0, 1.0, 1.0])
    f, length = (f[::-1], length[::-1]) if mirror else (f, length)
    found = [s for i, s in near_zeros(f[:, None], length) if i == 1]
    assert len(found) == near
    if near:
        assert found[0] == pytest.approx(1 - 2 * at_end if mirror else 2 * at_end, abs=1e-12)


def test_secants_from_both_sides_meet_beyond_zero():
    """Secants reach zero at 0.3 and at 0.6 of the middle segment; the segments have the lengths 1, 2 and 3."""
    f, length = np.array([1.0 + 1 / 0.6, 1.0, 2.0, 2.0 + 6.0 / 0.8])[:, None], np.array([1.0, 2.0, 3.0])
    assert [s for i, s in near_zeros(f, length) if i == 1] == [pytest.approx(0.45, abs=1e-12)]
    f[3] = 2.0 + 6.0 / 1.41  # the second one at 0.295, before the first one
    assert [s for i, s in near_zeros(f, length) if i == 1] == []


# ---- the search, on the line x = p


class Line:
    def evaluate(self, X, p):
        return X - p, np.eye(1)


LINE = as_problem(Line())


def at(p, multipliers=None):
    solution = solution_at(LINE, np.array([p, p]), "p", {})
    point = point_from_solution(solution, np.array([0.0, 1.0]), np.ones(2))
    if multipliers is not None:
        point.observed["multipliers"] = np.array(multipliers, dtype=complex)
    return point


def segment_between(a, b):
    return Segment(LINE, "p", {}, at(a), at(b), np.ones(2), hb.NewtonSettings())


def detector_of(*events):
    return EventDetector(events, CurveEquations(LINE, "p", {}))


def level(f, kind="wall"):
    return Event(kind, lambda point: f(point.parameters["p"]))


class Given(Event):
    """An event whose sign changes and candidates are given for each number of points."""

    def __init__(self, kind="wall", changes=None, near=None, sides=False):
        self.kind, self.needs_two_sides = kind, sides
        self.given, self.near = changes or {}, near or {}

    def values(self, points, equations):
        return np.zeros((len(points), 0))

    def sign_changes(self, points, values):
        return np.array(self.given[len(points)])

    def near_zeros(self, points, values, scale):
        return self.near.get(len(points), [])


def special(event, p, **more):
    return LocatedEvent(event, p % 1, at(p, **more), True)


def test_a_sampled_curve_holds_points_and_special_points_in_order():
    points, event = [at(p) for p in (0.0, 1.0, 2.0)], Given()
    assert SampledCurve.through(points, {}, None).points is points
    path = SampledCurve.through(points, {(1, 0.7): special(event, 1.7), (0, 0.4): special(event, 0.4)}, None)
    assert [point.value for point in path.points] == [0.0, 0.4, 1.0, 1.7, 2.0]
    assert path.positions == [(0, 0.0), (0, 0.4), (1, 0.0), (1, 0.7), (2, 0.0)]
    assert path.kinds == ["", "wall", "", "wall", ""] and path.replaced_kinds == {}
    assert [path.ends(k) for k in range(4)] == [(0, 0.0, 0.4), (0, 0.4, 1.0), (1, 0.0, 0.7), (1, 0.7, 1.0)]


def test_a_point_on_either_side_replaces_a_special_point():
    """Each is added at 1/20 of the distance to the next point, an end of the segment or another special point."""
    points, event = [at(p) for p in (0.0, 1.0, 2.0)], Given("PD", sides=True)
    asked = []

    def between(segment, s):
        asked.append((segment, s))
        return at(segment + s)

    path = SampledCurve.through(points, {(0, 0.4): special(event, 0.4), (0, 0.8): special(event, 0.8)}, between)
    expected = [0.0, 0.38, 0.42, 0.78, 0.81, 1.0, 2.0]
    np.testing.assert_allclose([point.value for point in path.points], expected, atol=1e-12)
    np.testing.assert_allclose([i + s for i, s in path.positions], expected, atol=1e-12)
    assert path.kinds == [""] * 7 and path.replaced_kinds == {1: "PD", 3: "PD"} and len(asked) == 4
    path = SampledCurve.through(points, {(0, 0.4): special(event, 0.4)}, lambda segment, s: None)
    assert path.kinds == ["", "PD", "", ""] and path.replaced_kinds == {}


@pytest.mark.parametrize(
    ("rate", "error", "side"),
    [
        (0.1, 0.0, 0.38),
        (0.1, 0.6e-3, 0.38),
        (0.1, 0.7e-3, 0.34),
        (0.1, 1.9e-3, 0.34),
        (0.1, 2.1e-3, 0.22),
        (0.1, 0.1, 0.22),
        (5.1e-5, 0.0, 0.38),
        (4.9e-5, 0.0, 0.34),
        (math.nan, 0.0, 0.38),
    ],
)
def test_the_next_larger_distance_where_a_multiplier_is_too_close_to_the_circle(rate, error, side):
    """The multiplier is 1 + rate |p - 0.4|, compared with three times the error at the special point, or with 1e-6."""
    points, event = [at(p) for p in (0.0, 1.0)], Given("PD", sides=True)

    def between(segment, s):
        return at(s, multipliers=[0.5, -1 - rate * abs(s - 0.4)])

    path = SampledCurve.through(points, {(0, 0.4): special(event, 0.4, multipliers=[0.5, -1 - error])}, between)
    assert path.points[1].value == pytest.approx(side, abs=1e-12)
    if side > 0.22:  # the second point cannot be found, so the first one stays
        path = SampledCurve.through(
            points,
            {(0, 0.4): special(event, 0.4, multipliers=[0.5, -1 - 0.1])},
            lambda segment, s: between(segment, s) if abs(s - 0.4) < 0.05 else None,
        )
        assert [point.value for point in path.points] == pytest.approx([0.0, 0.38, 0.43, 1.0])


def test_candidates_of_the_sampled_curve_and_of_the_curve():
    """Candidates of the curve are added if they differ by more than a tenth of the part, or in the event."""
    points = [at(p) for p in (0.0, 1.0, 2.0)]
    one = Given("one", near={4: [(1, 0.5)], 3: [(0, 0.7), (0, 0.71), (0, 0.77), (0, 0.1), (1, 0.3)]})
    two = Given("two", near={3: [(0, 0.7)]})
    path = SampledCurve.through(points, {(0, 0.4): special(Given(), 0.4)}, None)
    found = path.near_zero_candidates(detector_of(one, two), points, np.ones(2))
    assert {k: [(event.kind, round(s, 9)) for event, s in some] for k, some in found.items()} == {
        1: [("one", 0.5), ("one", round(0.37 / 0.6, 9)), ("two", 0.5)],
        0: [("one", 0.25)],
        2: [("one", 0.3)],
    }
    alone = SampledCurve.through(points, {}, None)
    assert alone.near_zero_candidates(detector_of(two), points, np.ones(2)) == {0: [(two, 0.7)]}


def unmatched(event, positions, kinds, replaced):
    """Return the parts with unmatched sign changes by segment, for a curve of three segments."""
    points = [at(p) for p in (0.0, 1.0, 2.0, 3.0)]
    path = SampledCurve([at(i + s) for i, s in positions], positions, kinds, replaced)
    found = path.unmatched_sign_changes(detector_of(event), points)
    assert all(one is event for some in found.values() for _, one in some)
    return {segment: [k for k, _ in some] for segment, some in found.items()}


@pytest.mark.parametrize(
    ("kind", "sides", "changes", "known", "expected"),
    [
        ("limit", False, [1, 1, 0, 0], [0, 0, 0], {0: [0, 1]}),
        ("zone", False, [1, 1, 0, 0], [0, 0, 0], {0: [0, 1]}),
        ("limit", False, [1, 0, 1, 0], [1, 0, 0], {1: [2]}),
        ("limit", False, [1, 0, 1, 1], [1, 0, 0], {1: [2], 2: [3]}),
        ("wall", False, [1, 1, 0, 0], [0, 0, 0], {}),
        ("BP", False, [1, 1, 0, 0], [1, 0, 0], {}),
        ("BP", True, [1, 1, 0, 0], [1, 0, 0], {0: [0, 1]}),
        ("limit", True, [1, 1, 0, 0], [1, 0, 0], {}),
    ],
)
def test_sign_changes_that_known_special_points_do_not_explain(kind, sides, changes, known, expected):
    """A special point at 0.4 has another kind, the same kind, or a kind that changes the stability."""
    positions = [(0, 0.0), (0, 0.4), (1, 0.0), (2, 0.0), (3, 0.0)]
    event = Given("wall", {5: changes, 4: known}, sides=sides)
    assert unmatched(event, positions, ["", kind, "", "", ""], {}) == expected


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ([0, 1, 0, 0, 0, 0], {}),
        ([0, 2, 0, 0, 0, 0], {0: [1]}),
        ([0, 1, 1, 0, 0, 0], {0: [2]}),
        ([1, 0, 0, 0, 0, 0], {}),
        ([1, 0, 0, 1, 0, 0], {0: [3]}),
        ([0, 0, 1, 1, 0, 0], {0: [3]}),
        ([0, 0, 0, 0, 1, 0], {1: [4]}),
        ([0, 0, 0, 1, 1, 0], {1: [4]}),
    ],
)
def test_the_sign_change_of_a_replaced_special_point(changes, expected):
    """It is expected between the points at 0.38 and 0.42, or on the nearest part of the segment with a sign change."""
    positions = [(0, 0.0), (0, 0.38), (0, 0.42), (0, 0.6), (1, 0.0), (2, 0.0), (3, 0.0)]
    event = Given("PD", {7: changes, 4: [1, 0, 0]}, sides=True)
    assert unmatched(event, positions, [""] * 7, {1: "PD"}) == expected
    for kind in ("NS", "SL"):  # of another event
        fresh = Given("PD", {7: [0, 1, 0, 0, 0, 0], 4: [0, 0, 0]}, sides=True)
        assert unmatched(fresh, positions, [""] * 7, {1: kind}) == {0: [1]}


def test_a_curve_without_special_points_has_no_unmatched_sign_change():
    points = [at(p) for p in (0.0, 1.0)]
    path = SampledCurve.through(points, {}, None)
    assert path.unmatched_sign_changes(detector_of(Given(changes={2: [1]})), points) == {}


def crossings(f, kinds=("", "", "", ""), k=1, kind="wall"):
    """Return the values of p at the zeros found on part k of the line through 0, 1, 2 and 3."""
    points = [at(p) for p in (0.0, 1.0, 2.0, 3.0)]
    detector = detector_of(level(f, kind))
    path = SampledCurve(points, [(i, 0.0) for i in range(4)], list(kinds), {})
    near = path.near_zero_candidates(detector, points, np.ones(2))
    if k not in near:
        return []
    out = find_even_crossings(detector, segment_between(k, k + 1), near[k], lambda part, s: part.at(s), path, k)
    for part, found in out:
        assert found.located and part.a.value < found.value < part.b.value
        assert found.s == pytest.approx((found.value - part.a.value) / (part.b.value - part.a.value), abs=1e-9)
    return [found.value for _, found in out]


@pytest.mark.parametrize(("k", "s"), [(0, 0.7), (0, 0.8), (1, 0.2), (1, 0.3), (1, 0.7), (2, 0.2), (2, 0.3)])
def test_two_zeros_between_two_points(k, s):
    found = crossings(lambda p: (p - k - s) ** 2 - 0.01, k=k)
    assert found == pytest.approx([k + s - 0.1, k + s + 0.1], abs=1e-10)
    assert crossings(lambda p: (p - k - s) ** 2 + 1e-4, k=k) == []


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize(
    ("end", "first", "count"),
    [("wall", 0.04, 1), ("wall", 0.06, 2), ("", 0.04, 2), ("other", 0.04, 2), ("", 0.5e-6, 1), ("", 2e-6, 2)],
)
def test_a_zero_next_to_the_same_special_point_is_that_point(end, first, count, mirror):
    """A zero within 1/20 of the segment from such an end is not returned; within 1e-6 no end needs to be special."""
    roots = 1 + np.array([first, 0.3])
    roots = np.sort(3 - roots) if mirror else roots
    kinds = ["", "", end, ""] if mirror else ["", end, "", ""]
    found = crossings(lambda p: (p - roots[0]) * (p - roots[1]), kinds)
    kept = roots if count == 2 else roots[:1] if mirror else roots[1:]
    assert found == pytest.approx(list(kept), abs=1e-10)


def test_the_number_of_points_that_are_added():
    """At most eight points are added for each candidate while the test function stays close to zero, otherwise one."""
    points = [at(p) for p in (0.0, 1.0)]
    path = SampledCurve.through(points, {}, None)
    asked = []

    def solved(part, s):
        asked.append(s)
        return part.at(s)

    def count(near, event_type=Given, s=0.5, solved=solved):
        asked.clear()
        event = event_type(near={n: near for n in range(3, 20)}, changes={n: [0] * (n - 1) for n in range(2, 20)})
        assert find_even_crossings(detector_of(event), segment_between(0, 1), [(event, s)], solved, path, 0) == []
        return len(asked)

    assert count([(0, 0.5)]) == 8
    np.testing.assert_allclose(asked, 0.5 ** np.arange(1, 9))
    assert count([]) == 1 and count([(0, 0.0)]) == 1 and count([(5, 0.5)] * 0) == 1
    assert [count([(0, 0.5)], s=s) for s in (0.0, 1.0, -0.1, 1.1)] == [0, 0, 0, 0]
    assert count([(0, 0.5)], solved=lambda part, s: asked.append(s)) == 1
    assert count([(1, 0.5)]) == 8
    np.testing.assert_allclose(asked[:3], [0.5, 0.75, 0.625])


def test_points_end_where_the_sign_changes():
    """(p - 1.3)^2 - 0.01 has the other sign at the first added point, so no further point is added."""
    asked = []
    points = [at(p) for p in (0.0, 1.0, 2.0, 3.0)]
    event = level(lambda p: (p - 1.3) ** 2 - 0.01)
    path = SampledCurve.through(points, {}, None)

    def solved(part, s):
        asked.append(s)
        return part.at(s)

    found = find_even_crossings(detector_of(event), segment_between(1, 2), [(event, 0.3)], solved, path, 1)
    assert asked == [0.3] and len(found) == 2


def test_zeros_on_the_segments_beside_are_not_returned():
    """Only the two zeros between 1 and 2 are returned; the zeros at 0.5 and 2.5 cause sign changes between points."""
    assert (
        crossings(lambda p: -(p - 0.5) * (p - 2.5) * ((p - 1.5) ** 2 - 1e-4)) == []
    )  # no candidate: signs of three points differ
    points = [at(p) for p in (0.0, 1.0, 2.0, 3.0)]
    event = level(lambda p: (p - 0.5) * (p - 2.5) * ((p - 1.5) ** 2 - 1e-2))
    path = SampledCurve.through(points, {}, None)
    out = find_even_crossings(
        detector_of(event), segment_between(1, 2), [(event, 0.5)], lambda part, s: part.at(s), path, 1
    )
    assert [found.value for _, found in out] == pytest.approx([1.4, 1.6], abs=1e-10)


def test_a_located_fold_is_no_sign_of_branch_points():
    """On p = x^2 with det(Phi - 1) = x / 5, its ratio to dp/ds has no zero. At the fold it is 0 / 0: rounding."""
    points = []
    for x in (-0.7, -0.4, -0.15, 0.0, 0.2, 0.5, 0.9):
        multiplier, slope = (1 + 0.2 * x, 2 * x) if x else (1 + 1e-9, 1e-13)
        point = at(x, [multiplier, 0.0])
        points.append(replace(point, u=np.array([x, x * x]), tangent=np.array([1.0, slope]) / math.hypot(1.0, slope)))
    assert MotionBranchPointEvent().near_zeros(points, np.zeros((7, 0)), np.ones(2)) == []


def test_kinds_that_occur_an_odd_number_of_times_are_dropped():
    one, two, sided = Given("one"), Given("two"), Given("PD", sides=True)
    points = [special(event, p) for event, p in ((one, 0.1), (two, 0.2), (one, 0.3), (sided, 0.4))]
    assert drop_odd_counts(points) == [points[0], points[2]]
    assert drop_odd_counts(points, True) == [points[0], points[2], points[3]]
    by_another = replace(points[1], finder=one)
    assert drop_odd_counts([points[0], by_another]) == [by_another]
    assert drop_odd_counts([points[0], by_another, points[1]]) == [by_another]
