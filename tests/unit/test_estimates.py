"""Error estimates of special points of parabolas and lines that move with the number of unknowns, in closed form.

The fold of p = c + (x - d)^2 is (d, c), and its comparisons have other vertices. The level x = 1/2 of a line p = x - c
is at p = 1/2 - c. `tests/cross/test_errors.py` has the estimates of mechanical systems.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation.augmented.fold import FoldProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment, point_from_solution
from hbgear.continuation.events import accuracy
from hbgear.continuation.events.event import Event, LocatedEvent, RefinedLocation
from hbgear.continuation.events.fold import FoldEvent
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence, solution_at

ONE = 7e2**-3 + 2e-3
"""Work of a solution with one unknown."""


class Moved(ContinuationProblem):
    """p = c + bend (x - d)^2 + slope x, and further unknowns that are zero: one for segments, two elsewhere."""

    size, equivalent_size = 3, 1

    def __init__(self, c=0.0, d=0.0, others=(), finer=None, smooth=True, bend=1.0, slope=0.0, fails=(), observed=None):
        self.c, self.d, self.others, self.finer, self.smooth = c, d, others, finer, smooth
        self.bend, self.slope, self.fails, self.observed = bend, slope, fails, observed or {}
        self.evaluations = 0

    @property
    def resolution(self):
        return f"number {id(self)}"

    @property
    def comparisons(self):
        return self.others

    @property
    def refined_problem(self):
        return self.finer

    def linearise(self, X, name, p):
        self.evaluations += 1
        if "all" in self.fails:
            raise np.linalg.LinAlgError("no solution")
        R, slope = p - self.f(X[0]), -2 * self.bend * (X[0] - self.d) - self.slope
        return self.completed(X, R, slope)

    def f(self, x):
        return self.c + self.bend * (x - self.d) ** 2 + self.slope * x

    def completed(self, X, R, slope):
        """Return the evaluation with the equations of the further unknowns."""
        J, rest = np.eye(self.size), X[1:]
        J[0, 0] = slope
        return hb.continuation.Evaluation(np.append(R, rest), J, np.eye(self.size)[0], 1.0)

    def resized(self, X):
        return np.append(X, np.zeros(self.size))[: self.size]

    def curvature(self, X, v, name, **parameters):
        if "equations" in self.fails:
            raise np.linalg.LinAlgError("no second derivatives")
        along = np.zeros((self.size, self.size))
        along[0, 0] = -2 * self.bend * v[0]
        return along, np.zeros_like(along)

    def observe(self, X, stability=True, **parameters):
        return dict(self.observed)

    def at(self, x):
        u, tangent = (self.unknowns(x, p) for x, p in ((x, self.f(x)), (1.0, self.f(x + 0.5) - self.f(x - 0.5))))
        point = point_from_solution(solution_at(self, u, "p", {}), tangent, np.ones(self.size + 1))
        point.observed.update(self.observed)
        return point

    def unknowns(self, x, p):
        return np.append(self.resized(np.array([x])), p)

    def segment(self, a=-0.01, b=0.01):
        return Segment(self, "p", {}, self.at(a), self.at(b), np.ones(self.size + 1), hb.NewtonSettings())


def fold_of(problem, a=-0.01, b=0.01, event=None):
    """The segment and the fold on it."""
    problem.size = 2
    segment = problem.segment(a, b)
    point = CurvePoint(problem.unknowns(problem.d, problem.c), problem.unknowns(1.0, 0.0), 1, 0.0, 0)
    return segment, LocatedEvent(event or FoldEvent(), (problem.d - a) / (b - a), point, True, "note")


def level_of(problem, x=0.5, a=0.4, b=0.6):
    """The segment of a line and the point at which x has a value."""
    problem.size = 2
    segment = problem.segment(a, b)
    event = Event("level", lambda point: point.X[0] - x)
    return segment, LocatedEvent(event, (x - a) / (b - a), problem.at(x), True)


def line(c=0.0, **more):
    return Moved(c, bend=0.0, slope=1.0, **more)


# ---- the estimate


@pytest.mark.parametrize(
    "others",
    [
        [(3e-4, 1e-3, 1.0)],
        [(-3e-4, -1e-3, 0.5)],
        [(2e-4, 0.0, 1.0), (5e-4, 1e-3, 0.25)],
        [(1e-4, 0.0, 0.5), (4e-5, 0.0, 2.0)],
    ],
)
def test_the_error_is_the_largest_weighted_change_of_the_parameter(others):
    problem = Moved(others=tuple((Moved(c, d), w) for c, d, w in others))
    segment, fold = fold_of(problem)
    found = accuracy.estimate_error(segment, fold, 1e-9)
    assert found.error == pytest.approx(max(w * abs(c) for c, _, w in others), rel=1e-9)
    assert found.located and found.refined is None and found.value == 0.0 and found.note == "note"


@pytest.mark.parametrize("c", [1e-3, -2e-4])
def test_the_error_of_a_level(c):
    found = accuracy.estimate_error(*level_of(line(others=((line(c), 1.0),))), 1e-9)
    assert found.error == pytest.approx(abs(c), rel=1e-9)


def test_the_rounding_error_is_the_smallest_error():
    segment, fold = level_of(line(others=((line(), 1.0),)), 0.5)
    assert accuracy.estimate_error(segment, fold, 1e-9).error == 1e-12 * 0.5
    assert accuracy.PARAMETER_ROUNDING == 1e-12


def test_without_comparisons_nothing_is_estimated():
    segment, fold = fold_of(Moved())
    assert accuracy.estimate_error(segment, fold, 1e-9) is fold


@pytest.mark.parametrize("end", ["a", "b"])
@pytest.mark.parametrize(("error", "rough"), [(0.0049, False), (0.0051, True)])
def test_solutions_that_are_not_resolved_are_no_guesses(error, rough, end):
    """An error of half of the norm, 0.01, at one end of the segment."""
    segment, fold = fold_of(Moved(others=((Moved(1e-4), 1.0),)))
    getattr(segment, end).observed["error"] = error
    assert (accuracy.estimate_error(segment, fold, 1e-9) is fold) == rough
    assert accuracy.is_under_resolved(segment.problem, np.array([-0.01]), error) == rough


def chain(*vertices, **more):
    """Problems of which each is compared with the next one, and refined to it."""
    problem = Moved(vertices[-1], **more)
    for c in vertices[-2::-1]:
        problem = Moved(c, others=((problem, 1.0),), finer=problem, **more)
    return problem


@pytest.mark.parametrize(
    ("goal", "value", "error"),
    [
        (1.01e-1, 0.0, 1e-3),
        (0.99e-1, 1e-3, 1e-4),
        (1.01e-2, 1e-3, 1e-4),
        (0.99e-2, 1.1e-3, 1e-5),
        (0.99e-3, 1.11e-3, 1e-6),
        (1e-9, 1.111e-3, 1e-6),
    ],
)
def test_a_point_is_located_with_more_unknowns_until_the_error_is_below_the_target(goal, value, error):
    """The target is relative to the unit 0.01 of a parameter near zero.

    The highest resolution has nothing to be compared with, and keeps the error of the one before.
    """
    found = accuracy.estimate_error(*fold_of(chain(0.0, 1e-3, 1.1e-3, 1.11e-3, 1.111e-3)), goal)
    assert found.value == pytest.approx(value, rel=1e-9, abs=1e-15)
    assert found.error == pytest.approx(error, rel=1e-6) and found.located
    assert (found.refined is None) == (value == 0.0)


def test_a_trace_to_the_highest_resolution():
    """The circle x^2 + p^2 = r^2 of an object that defines its refined problem only."""

    class Circle:
        def __init__(self, *radii):
            self.radius, self.size, self.resolution = radii[0], 1, f"r = {radii[0]}"
            self.refined_problem = Circle(*radii[1:]) if radii[1:] else None

        def evaluate(self, X, p):
            return X**2 + p**2 - self.radius**2, np.diag(2 * X)

    curve = hb.trace(Circle(1.0, 1.01, 1.0101), "p", (0.0, 1.5), np.array([1.0]))
    assert curve["LP1"].parameters["p"] == pytest.approx(1.0101, abs=1e-9)
    assert curve["LP1"].error == pytest.approx(1e-4, rel=1e-6)


def test_the_first_comparison_above_the_target_ends_an_estimate_that_can_be_refined():
    second = Moved(5e-3)
    finer = Moved(1e-3)
    problem = Moved(others=((finer, 1.0), (second, 1.0)), finer=finer)
    finer.others = ((Moved(1e-3), 1.0),)
    found = accuracy.estimate_error(*fold_of(problem), 1e-9)
    assert second.evaluations == 0 and found.value == pytest.approx(1e-3) and found.refined.problem is finer
    below = accuracy.estimate_error(*fold_of(problem), 1.0)
    assert below.error == pytest.approx(5e-3, rel=1e-9) and second.evaluations > 0


# ---- the work


def test_the_work_of_estimates_and_locations():
    """Three solutions of a comparison for the first estimate; four of a location and three of a later one."""
    work = Work(1e9)
    problem = Moved(others=((Moved(1e-6), 1.0), (Moved(2e-6), 1.0)))
    accuracy.estimate_error(*fold_of(problem), 1.0, work)
    assert (work.estimated, work.spent) == (pytest.approx(3 * ONE, rel=1e-12), 0.0)
    work = Work(1e9)
    accuracy.estimate_error(*fold_of(chain(0.0, 1e-3, 1e-3, 1e-3)), 1e-3, work)
    assert work.estimated == pytest.approx(3 * ONE, rel=1e-12) and work.spent == pytest.approx(7 * ONE, rel=1e-12)


def test_a_point_that_does_not_exist_elsewhere_costs_more():
    """150 of the smallest solutions."""
    work = Work(1e9)
    found = accuracy.estimate_error(*fold_of(Moved(others=((Moved(fails=("all",)), 1.0),))), 1e-9, work)
    assert found.error == math.inf and found.located
    assert work.estimated == pytest.approx(3 * ONE + 150 * 2e-3, rel=1e-9)


def test_limits_of_the_work():
    problem = chain(0.0, 1e-3, 1.1e-3)
    none = accuracy.estimate_error(*fold_of(problem), 1e-9, Work(2.9 * ONE))
    assert math.isnan(none.error) and none.refined is None and none.located
    # the first estimate is allowed, the location not: the complete estimate with all comparisons remains
    problem.others = ((problem.finer, 1.0), (Moved(-7e-3), 1.0))
    first = accuracy.estimate_error(*fold_of(problem), 1e-9, Work(7.9 * ONE))
    assert first.error == pytest.approx(8e-3, rel=1e-9) and first.refined is None  # the others are further apart
    # the location is allowed (8 of 8 + 8), a second estimate not
    second = accuracy.estimate_error(*fold_of(problem), 1e-9, Work(9.9 * ONE))
    assert second.value == pytest.approx(1e-3) and second.error == pytest.approx(1e-3, rel=1e-6)


def test_two_failed_refinements_end_the_search():
    for failures, error in ((1, 1e-4), (2, math.inf)):
        last = Moved(1e-3, others=((Moved(1.1e-3), 1.0),))
        problem = last
        for _ in range(failures):
            problem = Moved(others=((problem, 1.0),), finer=problem, fails=("all",))
        first = Moved(others=((problem, 1.0),), finer=problem)
        found = accuracy.estimate_error(*fold_of(first), 1e-9)
        assert found.error == pytest.approx(error, rel=1e-6) and (found.refined is None) == (failures == 2)
        assert found.located


# ---- multipliers


class Doubling(Event):
    """A level of x at which the nearest multiplier is -1."""

    kind, meaning = "PD", "doubling"

    def __init__(self):
        pass

    def test(self, point):
        return point.X[0] - 0.5

    def deviation(self, multipliers):
        return float(np.abs(multipliers + 1).min(initial=math.inf))


@pytest.mark.parametrize(("off", "located"), [(0.9e-3, True), (1.1e-3, False)])
def test_multipliers_off_by_more_than_a_thousandth_are_no_special_point(off, located):
    observed = {"multipliers": np.array([-1 - off, 0.3])}
    problem = line(others=((line(1e-6), 1.0),), observed=observed)
    segment, found = level_of(problem)
    found = replace(found, event=Doubling())
    found.point.observed.clear()
    judged = accuracy.estimate_error(segment, found, 1e-3)
    assert judged.located == located and judged.error == pytest.approx(1e-6 if located else math.inf, rel=1e-6)
    # one at a higher resolution, where they are correct
    finer = line(1e-6, others=((line(2e-6), 1.0),), observed={"multipliers": np.array([-1.0, 0.3])})
    problem.others, problem.finer = ((finer, 1.0),), finer
    judged = accuracy.estimate_error(segment, found, 1e-3)
    assert judged.located and (judged.refined is not None) == (not located)
    assert accuracy._deviation(segment, replace(found, located=False)) == 0.0
    assert accuracy._deviation(segment, replace(found, event=FoldEvent())) == 0.0
    found.point.observed["multipliers"] = np.array([math.nan, 0.3])
    assert accuracy._deviation(segment, found) == 0.0
    found.point.observed["multipliers"] = np.array([-1.25, 0.3])
    assert accuracy._deviation(segment, found) == 0.25
    for end in (segment.a, segment.b):
        end.observed.clear()
    assert accuracy._deviation(segment, found) == 0.0


# ---- other resolutions


@pytest.mark.parametrize(("c", "found"), [(0.034, True), (0.036, False), (-0.034, True), (-0.036, False)])
def test_a_point_that_moves_by_a_twentieth_is_another_one(c, found):
    """The vertex (c, c) is sqrt(2) |c| away, and the limit is 0.05."""
    segment, fold = fold_of(Moved())
    moved = accuracy._by_equations(segment, fold, Moved(c, c))
    assert (moved is not None) == found
    if found:
        assert moved.value == pytest.approx(c, abs=1e-12) and moved.distance == pytest.approx(2**0.5 * abs(c))
        refined = moved.locate()
        np.testing.assert_allclose(refined.point.u, [c, 0.0, 0.0, c], atol=1e-12)
        assert refined.point.residual < 1e-12 and refined.point.orientation == segment.a.orientation
        np.testing.assert_array_equal(refined.point.tangent, np.insert(segment.a.tangent, 2, 0.0))


def test_a_point_without_equations_or_solutions():
    segment, fold = fold_of(Moved())
    assert accuracy._by_equations(segment, fold, Moved(fails=("equations",))) is None
    none = replace(fold, event=type("Bare", (FoldEvent,), {"equations": lambda *_: None})())
    assert accuracy._by_equations(segment, none, Moved(1e-3)) is None
    lost = accuracy._at_other_resolution(segment, none, Moved(fails=("all",)))
    assert math.isnan(lost.value) and lost.distance == math.inf and lost.locate() is None


def test_steps_end_when_the_change_is_known():
    """p = 100 x^3 with the level x^2 = 4, from x = 1.5: steps of x are those of the square root; p follows the tangent.

    The second step is 0.14 of the change of p, the third one 0.005.
    """

    class Cubic(Moved):
        def linearise(self, X, name, p):
            self.evaluations += 1
            return self.completed(X, p - 100 * X[0] ** 3, -300 * X[0] ** 2)

    event = Event("level", lambda point: point.X[0] ** 2 - 4.0)
    start = np.array([1.5, 0.0, 0.0, 337.5])
    problem = Cubic()
    x = 1.5
    for _ in range(3):
        step = (4 - x * x) / (2 * x)
        x, p = x + step, 100 * x**3 + 300 * x * x * step
    U = accuracy._newton_until_settled(event.equations(problem, "p", special_point(start)), start, {}, 1e-12)
    assert U[-1] == pytest.approx(p, abs=1e-5) and abs(p - 800.0) > 1e-4
    exact = accuracy._newton_until_settled(
        event.equations(problem, "p", special_point(start)), np.array([2.0, 0.0, 0.0, 800.0]), {}, 1e-9
    )
    assert exact[-1] == pytest.approx(800.0, abs=1e-7)


def special_point(u):
    return SpecialPoint(u[:-1], {"p": u[-1]}, 0.0, 0, None, np.zeros(0, np.int8), math.nan, None)


def test_a_singular_step_leads_to_the_damped_iteration():
    """The damped iteration fails, too, and its error is raised."""
    equations = FoldProblem(Moved(bend=0.0, slope=1.0), "p")
    with pytest.raises((NoConvergence, np.linalg.LinAlgError)):
        accuracy._newton_until_settled(equations, np.array([0.1, 0.0, 0.0, 0.1]), {}, 1e-12)


@pytest.mark.parametrize(
    ("x", "left"), [(0.0, False), (0.00999, False), (0.0101, True), (-0.0101, True), (-0.00999, False)]
)
def test_a_point_beyond_the_ends_has_left_its_segment(x, left):
    segment, _ = fold_of(Moved())
    there = RefinedLocation(segment.problem, segment.problem.at(x))
    moved = accuracy.Comparison(there.point.value, abs(x) or 1.0, lambda: there)
    assert accuracy._left_segment(segment, moved) == left
    assert not accuracy._left_segment(segment, replace(moved, distance=0.99e-3 * 0.02))
    if left:
        assert accuracy._left_segment(segment, replace(moved, distance=1.01e-3 * 0.02))
    assert not accuracy._left_segment(segment, replace(moved, locate=lambda: None))


@pytest.mark.parametrize(
    ("d", "exists"), [(0.004, True), (0.015, True), (-0.028, True), (0.028, True), (0.032, False), (-0.032, False)]
)
def test_a_point_is_searched_on_the_segment_solved_again_and_on_its_extension(d, exists):
    """The segment from -0.01 to 0.01 is extended by its length 0.02; three times of it exceed 0.05."""
    segment, fold = fold_of(Moved(smooth=False))
    finer = Moved(1e-5, d, smooth=False)
    moved = accuracy._on_segment(segment, fold, finer)
    if not exists:
        assert math.isnan(moved.value) and moved.distance == math.inf and moved.locate() is None
        return
    assert moved.value == pytest.approx(1e-5, abs=1e-12)
    assert moved.distance == pytest.approx(math.hypot(d, 1e-5), rel=1e-6)
    assert moved.locate().problem is finer
    np.testing.assert_allclose(moved.locate().point.u, [d, 0.0, 0.0, 1e-5], atol=1e-8)


@pytest.mark.parametrize(("d", "exists"), [(0.008, True), (0.0185, True), (-0.0185, True), (0.02, False)])
def test_a_short_segment_is_extended_three_and_nine_times(d, exists):
    """From -0.001 to 0.001: 0.001 + 9 0.002 on either side."""
    segment, fold = fold_of(Moved(smooth=False), -0.001, 0.001)
    moved = accuracy._on_segment(segment, fold, Moved(0.0, d, smooth=False))
    assert math.isnan(moved.value) != exists
    if exists:
        assert moved.distance == pytest.approx(abs(d), rel=1e-5)


@pytest.mark.parametrize("c", [1e-4, -1e-4])
@pytest.mark.parametrize("d", [0.002, 0.004])
def test_the_shift_of_a_fold_by_one_point_near_it(c, d):
    """From (0, c + d^2) with the slope 2 d and the curvature 2: |c + d^2| + (2 d)^2 / 4 up to third order."""
    segment, fold = fold_of(Moved())
    assert accuracy._fold_shift(segment, fold.point, Moved(c, d)) == pytest.approx(abs(c + d * d) + d * d, rel=2e-4)


def test_a_fold_without_equations_is_shifted():
    """Its distance counts as zero, and it is located on the segment."""
    segment, fold = fold_of(Moved(smooth=False))
    finer = Moved(1e-5, 0.002, smooth=False)
    moved = accuracy._at_other_resolution(segment, fold, finer)
    assert moved.value == pytest.approx(1e-5 + 8e-6, rel=1e-3) and moved.distance == 0.0
    np.testing.assert_allclose(moved.locate().point.u, [0.002, 0.0, 0.0, 1e-5], atol=1e-8)


def test_distances_of_points_are_scaled():
    segment = Moved().segment()
    one, other = segment.problem.at(0.003), segment.problem.at(0.0)
    assert accuracy._distance(segment, one, other) == pytest.approx(math.hypot(0.003, 9e-6))
    scaled = replace(segment, scale=np.array([0.5, 1.0, 1.0, 3.0]))
    assert accuracy._distance(scaled, one, other) == pytest.approx(math.hypot(0.006, 3e-6))


def test_of_several_points_the_nearest_one_is_chosen():
    (segment, fold), finer = fold_of(Moved()), Moved(smooth=False)
    points = [replace(fold, s=s, point=finer.at(-0.01 + 0.02 * s)) for s in (0.1, 0.45, 0.8)]
    points.append(replace(points[1], point=finer.at(0.0), located=False))
    points.append(replace(points[1], point=finer.at(0.0), event=Doubling()))
    finder = type("Finder", (FoldEvent,), {"find": lambda self, segment: points})()
    moved = accuracy._on_segment(segment, replace(fold, finder=finder), finer)
    assert moved.value == points[1].point.value and moved.locate().point is points[1].point
