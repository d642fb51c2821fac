"""Location of special points on small algebraic curves, whose folds, branch points and levels are known in closed form.

The curves are p = f(x) with the unknown x, and two lines that cross. Fractions of segments follow from projections.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import hbgear as hb
from hbgear.continuation import FoldProblem
from hbgear.continuation.augmented.branch_point import BranchPointProblem
from hbgear.continuation.curve.segment import CurvePoint, Segment, point_from_solution
from hbgear.continuation.events import branch_point
from hbgear.continuation.events.branch_point import BranchPointEvent, as_traced
from hbgear.continuation.events.columns import lengths, monitored_values, unknowns
from hbgear.continuation.events.detector import EventDetector, event_at, event_of, events_of
from hbgear.continuation.events.event import (
    MARKERS,
    Event,
    LocatedEvent,
    RefinedLocation,
    is_marker,
    locate_by_newton,
    locate_root,
)
from hbgear.continuation.events.fold import (
    TURNING_KINDS,
    CuspEvent,
    FoldEvent,
    IsolaCentreEvent,
    far_side_of_fold,
    fold_on_segment,
)
from hbgear.continuation.events.residual_form import in_residual_form
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence, solution_at


class Graph(ContinuationProblem):
    """p = f(x) with f a polynomial, and a second unknown that is zero."""

    size = 2

    def __init__(self, *coefficients, smooth=True):
        self.f, self.smooth = np.polynomial.Polynomial(coefficients), smooth

    def evaluate(self, X, p):
        return np.array([p - self.f(X[0]), X[1]]), np.diag([-self.f.deriv()(X[0]), 1.0])

    def linearise(self, X, name, **parameters):
        R, J = self.evaluate(X, **parameters)
        return hb.continuation.Evaluation(R, J, np.array([1.0, 0.0]), 1.0)

    def curvature(self, X, v, name, **parameters):
        return np.diag([-self.f.deriv(2)(X[0]) * v[0], 0.0]), np.zeros((2, 2))

    def point(self, x, scale=(1.0, 1.0)):
        """The point at x of the curve in the direction of growing x."""
        u, tangent = np.array([x, 0.0, self.f(x)]), np.array([1.0, 0.0, self.f.deriv()(x)])
        return point_from_solution(solution_at(self, u, "p", {}), tangent, scales(scale))

    def segment(self, a, b, scale=(1.0, 1.0)):
        ends = self.point(a, scale), self.point(b, scale)
        return Segment(self, "p", {}, *ends, scales(scale), hb.NewtonSettings())


def scales(scale=(1.0, 1.0)):
    """Scales of both unknowns and of p from those of x and p."""
    return np.array([scale[0], 1.0, scale[1]])


LINE = Graph(0.0, 1.0)
"""x = p."""


def level(kind, f, **more):
    return Event(kind, lambda point: f(point.parameters["p"]), **more)


# ---- quantities of points


def test_lengths_are_scaled():
    points = [replace(LINE.point(0.0), u=np.array(u)) for u in ([0.0, 1.0], [3.0, 5.0], [3.0, 6.0])]
    np.testing.assert_array_equal(unknowns(points), [[0, 1], [3, 5], [3, 6]])
    for scale, expected in (([1.0, 1.0], [5.0, 1.0]), ([0.5, 0.5], [10.0, 2.0]), ([3.0, 2.0], [5**0.5, 0.5])):
        np.testing.assert_allclose(lengths(points, np.array(scale)), expected, rtol=1e-15)


def test_monitored_quantities_are_nan_where_they_are_unknown():
    points = [replace(LINE.point(x), observed={}) for x in (0.0, 1.0, 2.0)]
    assert monitored_values(points, "gap") is None
    points[1].observed["gap"] = np.array([2.0, 3.0])
    np.testing.assert_array_equal(monitored_values(points, "gap"), [[np.nan] * 2, [2.0, 3.0], [np.nan] * 2])
    points[2].observed["gap"] = np.array([2.0])
    assert monitored_values(points, "gap") is None


# ---- events in general


def test_what_an_event_has_by_default():
    event = level("wall", lambda p: p - 0.25)
    assert (event.kind, event.meaning, event.marker, event.terminal) == ("wall", "wall", "v", False)
    assert not event.needs_two_sides and not event.alone and not Event.terminal and Event.marker == "v"
    assert repr(level("wall", abs, meaning="a wall")) == "<Event wall: a wall>"
    segment = LINE.segment(0.0, 1.0)
    assert event.ahead(segment) is None and event.branch_direction(None, None, 1) is None
    assert event.deviation(np.array([3.0 + 0j])) == 0.0
    assert event.termination("p", 1 / 3) == (Status.EVENT, "wall at p = 0.333333")
    assert event.test_function(point_of_line(0.5)) == 0.25 and CuspEvent().test_function is None


def point_of_line(p):
    """A point of the line."""
    return SpecialPoint(np.array([p, 0.0]), {"p": p}, 0.0, 0, None, np.zeros(0, np.int8), math.nan, None, problem=LINE)


@pytest.mark.parametrize("kind", ["", "a1", "a b", "_", "a_", 3, "LP"])
def test_kinds_that_are_refused(kind):
    with pytest.raises(ValueError, match="Event: kind = "):
        Event(kind, abs)


def test_kinds_with_underscores():
    assert Event("wide_open", abs).kind == "wide_open" and Event("_open", abs).kind == "_open"


def test_markers():
    assert all(map(is_marker, MARKERS)) and not any(map(is_marker, ("", "ov", "q", 3, None)))
    with pytest.raises(ValueError, match="Event: marker = 'ov' must be one of"):
        Event("wall", abs, marker="ov")


def test_values_and_signs_at_points():
    points = [LINE.point(p) for p in (0.0, 0.25, 0.5, 1.0)]
    event = level("wall", lambda p: p - 0.25)
    np.testing.assert_allclose(
        event.values(points, CurveEquations(LINE, "p", {})), [[-0.25], [0.0], [0.25], [0.75]], atol=1e-15
    )
    values = np.array([[1.0, 1.0], [1.0, -1.0], [2.0, -1.0], [0.0, -1.0], [-3.0, -2.0], [3.0, 2.0]])
    np.testing.assert_array_equal(event.sign_changes(points, values), [True, False, False, False, True])


def test_near_zeros_are_weighted_with_scaled_lengths():
    """(x - 1)^2 + 0.01 at 0, 0.8 and 2: the minimum is at 1, a sixth of the second segment."""
    points, event = [LINE.point(p) for p in (0.0, 0.8, 2.0)], level("wall", abs)
    values = np.array([[(p.value - 1) ** 2 + 0.01] for p in points])
    for scale in ([1.0, 1.0], [3.0, 0.2]):
        ((i, s),) = event.near_zeros(points, values, scales(scale))
        assert i == 1 and s == pytest.approx(1 / 6, abs=1e-12)
    assert event.near_zeros(points, values[:, :0], scales()) == []


def test_a_level_is_found_where_its_sign_changes():
    segment, event = LINE.segment(0.0, 2.0), level("wall", lambda p: p - 0.5)
    (found,) = event.find(segment)
    assert found.event is event and found.located and found.note == "" and found.finder is found.refined is None
    assert found.s == pytest.approx(0.25, abs=1e-12) and found.value == pytest.approx(0.5, abs=1e-12)
    assert math.isnan(found.error)
    for f in (lambda p: p + 1, lambda p: p, lambda p: p - 2, lambda p: (p - 1) ** 2):
        assert level("wall", f).find(segment) == []


def test_the_value_is_that_with_more_unknowns():
    found = LocatedEvent(FoldEvent(), 0.5, LINE.point(1.0), True)
    assert found.value == 1.0
    assert replace(found, refined=RefinedLocation(LINE, LINE.point(1.5))).value == 1.5


# ---- bracketed roots


class Holed(Segment):
    """A segment with tangents (1 + s, 1), and without points in a hole."""

    hole = (0.5, 1e-9)

    def at(self, s):
        middle, radius = self.hole
        assert 0 <= s <= 1
        if abs(s - middle) <= radius:
            raise NoConvergence("here is a hole", np.zeros(1), {}, [])
        return CurvePoint(np.array([s, 0.0, s]), np.array([1.0 + s, 0.0, 1.0]), 1, 0.0, 3)


def holed(middle, radius):
    whole = LINE.segment(0.0, 1.0)
    ends = [CurvePoint(np.array([s, 0.0, s]), np.array([1.0 + s, 0.0, 1.0]), 1, 0.0, 0) for s in (0.0, 1.0)]
    segment = Holed(LINE, "p", {}, *ends, whole.scale, whole.settings)
    object.__setattr__(segment, "hole", (middle, radius))
    return segment


@pytest.mark.parametrize(
    ("middle", "low", "high"), [(0.5, 0.49999, 0.50001), (4e-6, 0.0, 1.4e-5), (1 - 4e-6, 1 - 1.4e-5, 1.0)]
)
def test_a_singular_point_is_the_special_point_between_its_sides(middle, low, high):
    """The test function is p - c: between the sides the straight line through its values gives c."""
    c = low + 0.625 * (high - low)
    found = locate_root(holed(middle, 1e-7), FoldEvent(), lambda p: p.value - c, "note", first=middle)
    assert found.located and found.s == pytest.approx(middle, abs=1e-15) and found.note == "note"
    np.testing.assert_allclose(found.point.u, [c, 0.0, c], rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.point.tangent, [1 + c, 0.0, 1.0], rtol=0, atol=1e-14)
    assert found.point.orientation == 1 and found.point.residual == 0 and found.point.iterations == 0


@pytest.mark.parametrize(("c", "end"), [(0.49, 0.0), (0.51, 1.0), (0.5, 1.0)])
def test_a_root_in_a_hole_is_not_located(c, end):
    """The end with the smaller value is returned, the last one if they are equal."""
    found = locate_root(holed(0.5, 0.1), FoldEvent(), lambda p: p.value - c, "note")
    assert not found.located and found.s == end == found.point.value and found.note == "note"


def test_one_sign_on_both_sides_of_a_hole_is_no_root():
    found = locate_root(holed(0.5, 1e-7), FoldEvent(), lambda p: p.value - 0.4)
    assert not found.located and found.s == 0.0
    found = locate_root(holed(0.5, 1e-7), FoldEvent(), lambda p: round(p.value - 0.5, 3))
    assert not found.located


def test_the_tolerance_of_a_root_and_its_first_place():
    calls = []

    def cubic(point):
        calls.append(point.value)
        return (point.value - 0.3) ** 3 + 1e-3 * (point.value - 0.3)

    segment, errors, counts = LINE.segment(0.0, 1.0), [], []
    for fine in (1e-13, 1e-3):
        calls.clear()
        errors.append(abs(locate_root(segment, FoldEvent(), cubic, fine=fine).s - 0.3))
        counts.append(len(set(calls)))
        assert calls[2] == pytest.approx(0.5)
    assert errors[0] < 1e-12 < errors[1] < 1e-3 and counts[1] < counts[0]
    calls.clear()
    locate_root(segment, FoldEvent(), cubic, first=0.2)
    assert calls[2] == pytest.approx(0.2) and len(calls) == len(set(calls))


# ---- Newton's method on a segment


def parabola_segment(scale=(1.0, 1.0), smooth=True):
    """p = 1 - x^2 from x = -1 to 1.5, with its fold at (0, 1)."""
    return Graph(1.0, 0.0, -1.0, smooth=smooth).segment(-1.0, 1.5, scale)


@pytest.mark.parametrize(("scale", "fraction"), [((1.0, 1.0), 0.16), ((1.0, 2.0), 2.1875 / 6.640625)])
def test_the_fraction_of_a_located_fold_is_its_projection(scale, fraction):
    """The chord is (2.5, -1.25), and the fold (1, 1) from the first end."""
    segment = parabola_segment(scale)
    found = locate_by_newton(segment, FoldEvent(), FoldProblem(segment.problem, "p"), 0.4, "note")
    assert found.located and found.note == "note" and found.s == pytest.approx(fraction, abs=1e-12)
    np.testing.assert_allclose(found.point.u, [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(found.point.tangent, [scale[0], 0.0, 0.0], atol=1e-9)
    assert found.point.residual < 1e-12


@pytest.mark.parametrize("mirror", [1, -1])
@pytest.mark.parametrize(
    ("x", "beyond", "inside"), [(1e-6, None, True), (1e-5, None, False), (1e-2, 0.01, True), (1e-2, 0.001, False)]
)
def test_a_point_may_lie_slightly_beyond_the_ends(mirror, x, beyond, inside):
    """p = -x^2 from x = -1 to -x: the fold lies x / 2 of the segment behind its end."""
    ends = (-1.0, -x) if mirror > 0 else (x, 1.0)
    segment = Graph(0.0, 0.0, -1.0).segment(*ends)
    more = {} if beyond is None else {"margin": beyond}

    def locate():
        return locate_by_newton(
            segment, FoldEvent(), FoldProblem(segment.problem, "p"), 1.0 if mirror > 0 else 0.0, **more
        )

    if inside:
        assert locate().s == pytest.approx(1 + x / 2 if mirror > 0 else -x / 2, rel=3 * x)
    else:
        with pytest.raises(NoConvergence, match="left the segment"):
            locate()


@pytest.mark.parametrize(
    ("x", "beyond", "inside"), [(0.49, 1e-6, True), (0.51, 1e-6, False), (0.58, 0.1, True), (0.62, 0.1, False)]
)
def test_a_point_more_than_half_a_segment_away_is_another_one(x, beyond, inside):
    segment = Graph(0.0, 0.0, -0.01).segment(-x, 1 - x)
    extended = FoldProblem(segment.problem, "p")
    if inside:
        found = locate_by_newton(segment, FoldEvent(), extended, 0.0, margin=beyond)
        assert found.s == pytest.approx(x, abs=1e-3)
    else:
        with pytest.raises(NoConvergence, match="left the segment"):
            locate_by_newton(segment, FoldEvent(), extended, 0.0, margin=beyond)


# ---- folds


def test_folds_are_changes_of_the_direction():
    points = [replace(LINE.point(0.0), parameter_direction=d) for d in (1, 1, -1, 0, -1, 1)]
    event = FoldEvent()
    np.testing.assert_array_equal(event.sign_changes(points, np.zeros((6, 0))), [False, True, False, False, True])
    assert event.values(points, CurveEquations(LINE, "p", {})).shape == (6, 0)
    assert (event.kind, event.marker, event.terminal) == ("LP", "o", False)


def slope_near_zero(c, m, sign=1.0):
    """dp/dx = e ((x - c)^2 + m) with e = 1e-6, so that lengths are those in x to 12 digits."""
    e = 1e-6 * sign
    return Graph(0.0, e * (c * c + m), -e * c, e / 3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("scale", [(1.0, 1.0), (2.0, 5.0)])
@pytest.mark.parametrize(
    ("c", "m", "near"),
    [
        (0.3, 0.029, True),
        (0.3, 0.031, False),
        (0.7, 0.029, True),
        (0.7, 0.031, False),
        (0.3, -0.01, True),
        (0.5, 0.08, True),
        (0.5, 0.09, False),
        (1.2, 0.001, False),
        (-0.2, 0.001, False),
        (0.8, -0.3, False),
        (0.2, -0.3, False),
        (0.97, 1e-5, True),
        (1.03, 1e-5, False),
    ],
)
def test_where_the_slope_of_the_parameter_comes_close_to_zero(sign, scale, c, m, near):
    """The smallest slope m at c is less than a quarter of the smaller one of the ends, of equal signs."""
    problem = slope_near_zero(c, m, sign)
    points = [problem.point(x, scale) for x in (-1.0, 0.0, 1.0, 2.0)]
    found = [(i, s) for i, s in FoldEvent().near_zeros(points, np.zeros((4, 0)), scales(scale)) if i == 1]
    assert len(found) == near
    if near:
        assert found[0][1] == pytest.approx(c, abs=1e-9)


def test_a_slope_that_grows_between_has_no_fold():
    """dp/dx = e (1.2 - (x - 0.5)^2) is largest between the ends."""
    problem = Graph(0.0, 0.95e-6, 0.5e-6, -1e-6 / 3)
    points = [problem.point(x) for x in (0.0, 1.0)]
    assert FoldEvent().near_zeros(points, np.zeros((2, 0)), scales()) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("scale", [(1.0, 1.0), (2.0, 5.0)])
@pytest.mark.parametrize(("c", "k"), [(0.1, 1.0), (0.5, 0.3), (0.9, 2.0), (0.4, -1.5), (0.7, 1e9)])
def test_the_fold_of_a_cubic_segment(sign, scale, c, k):
    """dp/dx = e (x - c) (x + k) between 0 and 1."""
    e = sign * 1e-6 / max(1.0, abs(k))
    segment = Graph(0.0, -e * c * k, e * (k - c) / 2, e / 3).segment(0.0, 1.0, scale)
    assert fold_on_segment(segment) == pytest.approx(c, abs=1e-9)


@pytest.mark.parametrize("smooth", [True, False])
def test_the_fold_of_a_parabola(smooth):
    event, segment = FoldEvent(), parabola_segment(smooth=smooth)
    (found,) = event.find(segment)
    assert found.event is event and found.located and found.s == pytest.approx(0.16, abs=1e-8)
    np.testing.assert_allclose(found.point.u, [0.0, 0.0, 1.0], atol=1e-8)


def test_a_fold_is_bracketed_if_newton_fails_or_a_branch_point_is_near():
    class NoCurvature(Graph):
        def curvature(self, X, v, name, **parameters):
            raise np.linalg.LinAlgError("no second derivatives")

    segment = NoCurvature(1.0, 0.0, -1.0).segment(-1.0, 1.5)
    (found,) = FoldEvent().find(segment)
    assert found.located and found.s == pytest.approx(0.16, abs=1e-8)
    turned = parabola_segment()
    turned = turned.part(turned.a, replace(turned.b, orientation=-turned.b.orientation))
    (found,) = FoldEvent().find(turned)
    assert found.located and 0 < abs(found.point.tangent[-1]) < 1e-7  # the tolerance of a bracketed fold


def test_segments_without_a_fold():
    segment = parabola_segment()
    for direction in (1, 0):
        same = segment.part(segment.a, replace(segment.b, parameter_direction=direction))
        assert FoldEvent().find(same) == []
    back = (replace(end, parameter_direction=-1) for end in (segment.a, segment.b))
    assert FoldEvent().find(segment.part(*back)) == []


def test_a_fold_on_a_section_of_constant_parameter_is_its_first_point():
    segment, event = LINE.segment(0.0, 1.0), FoldEvent()
    for tangent in (segment.b.tangent, np.array([1.0, 0.0, 0.0])):
        (found,) = event.find(segment.part(segment.a, replace(segment.b, parameter_direction=-1, tangent=tangent)))
        assert found.event is event and found.s == 0.0 and found.point is segment.a and found.located


class TwoParameters(ContinuationProblem):
    """p = -x^2 and q = k x: a curve of folds that turns in p, q among the unknowns."""

    size = 2

    def __init__(self, k, names=("q",)):
        self.k, self.unknown_parameters = k, names

    def evaluate(self, X, p):
        x, q = X
        return np.array([p + x * x, q - self.k * x]), np.array([[2 * x, 0.0], [-self.k, 1.0]])


@pytest.mark.parametrize(
    ("k", "names", "kind"),
    [(1.8e-3, ("q",), "CP"), (2.2e-3, ("q",), "IC"), (-2.2e-3, ("q",), "IC"), (0.5, (), "CP"), (0.5, ("q",), "IC")],
)
def test_a_turn_is_a_cusp_if_the_first_parameter_rests(k, names, kind):
    """The component of the tangent in q / 2 is k / 2 of its norm, and the limit is 1e-3."""
    problem, scale = TwoParameters(k, names), np.array([1.0, 2.0, 1.0])
    ends = [
        point_from_solution(
            solution_at(problem, np.array([x, k * x, -x * x]), "p", {}), np.array([1, k, -2 * x]), scale
        )
        for x in (-0.5, 0.6)
    ]
    event = CuspEvent()
    (found,) = event.find(Segment(problem, "p", {}, *ends, scale, hb.NewtonSettings()))
    assert found.located and found.event.kind == kind and found.value == pytest.approx(0.0, abs=1e-12)
    assert found.finder is (event if kind == "IC" else None)
    assert event.equations(problem, "p", None) is None
    assert TURNING_KINDS == ("CP", "IC") and IsolaCentreEvent().marker == "8" and event.marker == "*"


def test_a_turn_that_is_not_located_is_a_cusp():
    class Lost(TwoParameters):
        smooth = False

        def evaluate(self, X, p):
            if abs(X[0]) < 0.4:
                raise np.linalg.LinAlgError("no solutions here")
            return super().evaluate(X, p)

    problem, scale = Lost(0.5), np.ones(3)
    ends = [
        point_from_solution(
            solution_at(problem, np.array([x, x / 2, -x * x]), "p", {}), np.array([1, 0.5, -2 * x]), scale
        )
        for x in (-0.5, 0.6)
    ]
    (found,) = CuspEvent().find(Segment(problem, "p", {}, *ends, scale, hb.NewtonSettings()))
    assert not found.located and found.event.kind == "CP"


def test_the_far_side_of_a_fold():
    segment = Graph(0.0, 0.0, -1.0).segment(-1.0, 1.0)
    np.testing.assert_allclose(far_side_of_fold(segment, -0.25), [0.5, 0.0, -0.25], atol=1e-8)
    with pytest.raises(NoConvergence, match="does not return to this parameter value"):
        far_side_of_fold(segment, -2.0)


# ---- branch points


class Crossing(ContinuationProblem):
    """(x - a p') (x - b p') + h = 0 and y = 2 p with p' = p - c: x = a p' and x = b p' cross at c for h = 0."""

    size = 2

    def __init__(self, a=0.0, b=1.0, c=2.0, h=0.0):
        self.a, self.b, self.c, self.h = a, b, c, h

    def evaluate(self, X, p):
        one, two = (X[0] - slope * (p - self.c) for slope in (self.a, self.b))
        return np.array([one * two + self.h, X[1] - 2 * p]), np.array([[one + two, 0.0], [0.0, 1.0]])

    def linearise(self, X, name, **parameters):
        R, J = self.evaluate(X, **parameters)
        r = parameters["p"] - self.c
        slope = -self.a * (X[0] - self.b * r) - self.b * (X[0] - self.a * r)
        return hb.continuation.Evaluation(R, J, np.array([slope if name else 0.0, -2.0 if name else 0.0]), 1.0)

    def point(self, p, scale=(1.0, 1.0, 1.0)):
        """A point of the first line."""
        u = np.array([self.a * (p - self.c), 2 * p, p])
        return point_from_solution(solution_at(self, u, "p", {}), np.array([self.a, 2.0, 1.0]), np.array(scale))

    def segment(self, low, high, scale=(1.0, 1.0, 1.0)):
        ends = self.point(low, scale), self.point(high, scale)
        return Segment(self, "p", {}, *ends, np.array(scale), hb.NewtonSettings())


@pytest.mark.parametrize("a", [0.0, 0.7])
def test_the_branch_point_of_two_lines(a):
    segment, event = Crossing(a).segment(1.5, 3.5), BranchPointEvent()
    (found,) = event.find(segment)
    assert found.event is event and found.located and found.s == pytest.approx(0.25, abs=1e-7)
    np.testing.assert_allclose(found.point.u, [0.0, 4.0, 2.0], rtol=0, atol=1e-11)
    assert found.point.residual < 1e-12
    points = [segment.a, segment.a, segment.b, segment.b]
    np.testing.assert_array_equal(event.sign_changes(points, np.zeros((4, 0))), [False, True, False])
    assert event.find(Crossing(a).segment(1.0, 1.5)) == [] and event.values(
        [segment.a], CurveEquations(None, "p", {})
    ).shape == (1, 0)
    assert isinstance(event.equations(segment.problem, "p", None), BranchPointProblem)
    assert (event.kind, event.marker) == ("BP", "P")


def test_the_distance_of_multipliers_from_one():
    event = BranchPointEvent()
    assert event.deviation(np.array([0.5, -1.0, 1.2, 1 + 0.3j])) == pytest.approx(0.2, rel=1e-12)
    assert event.deviation(np.zeros(0, complex)) == math.inf


def test_the_determinant_relative_to_the_first_point():
    """Of [dR/dX dR/dp; t^T / scale^2] by its expansion: (a - b) p' and the tangent (a, 2, 1)."""
    scale = np.array([2.0, 3.0, 5.0])
    problem = Crossing(0.5, 1.5)
    segment = problem.segment(1.0, 4.0, scale)
    value = branch_point._determinant(segment)
    for p in (1.0, 1.7, 2.3, 4.0):
        at = problem.point(p, scale)
        # rows ((a - b) p' (1, 0, -a)), (0, 1, -2), (a/4, 2/9, 1/25) t: determinant (a - b) p' t (1/25 + 4/9 + a^2/4)
        sign = -np.sign(p - 2.0)
        assert value(at) == pytest.approx(sign * abs(p - 2.0), rel=1e-9)
    turned = replace(segment.b, tangent=np.array([1.0, 0.0, 0.0]))
    t = segment.a.tangent[-1]
    expected = (2.0 * 0.5 / 4) / (t * (1 / 25 + 4 / 9 + 0.25 / 4))
    assert abs(value(turned)) == pytest.approx(expected, rel=1e-9)
    near = problem.segment(2.0 + 1e-14, 4.0, scale)
    far = replace(near.b, tangent=1e20 * near.b.tangent)
    assert abs(branch_point._determinant(near)(far)) == pytest.approx(math.exp(50), rel=1e-12)


@pytest.mark.parametrize(("shift", "moves"), [(0.9e-3, True), (1.1e-3, False), (-0.9e-3, True), (-1.1e-3, False)])
def test_a_branch_point_is_refined_by_a_thousandth_of_its_segment(shift, moves):
    scale = (2.0, 3.0, 0.5)
    segment = Crossing().segment(1.0, 3.0, scale)
    rough = LocatedEvent(BranchPointEvent(), 0.5, Crossing().point(2.0 + 2.0 * shift, scale), True)
    found = branch_point._refined_branch_point(segment, rough)
    assert found.value == pytest.approx(2.0 if moves else 2.0 + 2.0 * shift, abs=1e-9)
    assert (found is rough) != moves
    lost = replace(rough, located=False)
    assert branch_point._refined_branch_point(segment, lost) is lost


@pytest.mark.parametrize(("h", "moves"), [(0.5e-10, True), (2e-10, False)])
def test_a_branch_point_that_an_imperfection_removes_is_not_refined(h, moves):
    """The refined point leaves the component h of the residual, and the tolerance is 1e-10."""
    segment = Crossing().segment(1.0, 3.0)
    rough = LocatedEvent(BranchPointEvent(), 0.5, Crossing().point(2.0 + 1e-4), True)
    found = branch_point._refined_branch_point(replace(segment, problem=Crossing(h=h)), rough)
    assert (found is rough) != moves


@pytest.mark.parametrize("place", ["inside", "first", "last"])
@pytest.mark.parametrize(("a", "c"), [(0.7, 2.0), (0.0, 2.0), (0.7, 0.0)])
def test_another_branch_leaves_across_the_traced_curve(a, c, place):
    """In the null space of [dR/dX, dR/dp], orthogonal to the traced curve and of unit length in scaled unknowns."""
    problem = Crossing(a, -1.0, c)
    curve = hb.trace(problem, "p", (c - 0.5, c + 1.0), np.array([-0.5 * a, 2 * c - 1.0]))
    (point,) = [point for point in curve.special if point.kind == "BP"]
    assert point.parameters["p"] == pytest.approx(c, abs=1e-9)
    index = {"inside": point.index, "first": 0, "last": len(curve) - 1}[place]
    point = replace(point, index=index)
    size = np.hypot(a, 2 * c + 2.0)  # at the last point
    scale = np.array([size, size, 1.5])
    directions = []
    for side in (1, -1):
        own, start = BranchPointEvent().branch_direction(curve, point, side)
        directions.append(start.direction)
        assert own is problem and start.bifurcating and start.event.kind == "BP"
        np.testing.assert_array_equal(start.X, point.X)
        assert start.parameters == point.parameters
    np.testing.assert_array_equal(directions[0], -directions[1])
    direction = directions[0] / scale
    assert np.linalg.norm(direction) == pytest.approx(1.0, rel=1e-9)
    assert direction @ (np.array([a, 2.0, 1.0]) / scale) == pytest.approx(0.0, abs=1e-9)
    assert directions[0][1] == pytest.approx(2 * directions[0][2], abs=1e-7)  # y = 2 p
    assert as_traced(curve, point) is point
    finer = as_traced(curve, replace(point, layout="finer", X=np.zeros(7)))
    np.testing.assert_array_equal(finer.X, curve.X[index])
    assert finer.layout is curve.layout and finer.parameters == curve.parameters_at(index)


def test_a_branch_leaves_a_zero_solution_in_the_direction_of_the_unknown():
    """The pitchfork p x = x^3 on x = 0, where the size of the unknown is not known."""

    class Pitchfork:
        def evaluate(self, X, p):
            return p * X - X**3, np.diag(p - 3 * X**2)

    curve = hb.trace(Pitchfork(), "p", (-0.5, 1.0), np.zeros(1))
    _, start = BranchPointEvent().branch_direction(curve, curve["BP1"], 1)
    np.testing.assert_allclose(np.abs(start.direction), [1.0, 0.0], atol=1e-9)
    other = hb.switch(curve, "BP1")
    np.testing.assert_allclose(other.X[:, 0] ** 2, other.values, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("a", "c"), [(0.7, 0.0), (0.3, 0.0), (0.7, 2.0)])
def test_a_switch_where_the_solution_is_zero_up_to_rounding(a, c):
    """Scaled by a norm of 1e-27, the other direction was that of the traced curve x = a p'."""
    curve = hb.trace(Crossing(a, -1.0, c), "p", (c - 0.5, c + 1.0), np.array([-0.5 * a, 2 * c - 1.0]))
    other = hb.switch(curve, "BP1")
    assert 3 < len(other) < 100
    np.testing.assert_allclose(other.X[3:, 0], c - other.values[3:], rtol=0, atol=1e-7)  # nearer points have few digits


# ---- the detector


def test_events_of_a_problem():
    wall, own_fold = level("wall", abs), FoldEvent()
    problem = Graph(0.0, 1.0)
    assert [type(event) for event in events_of(problem, "p")] == [FoldEvent, BranchPointEvent]
    problem.turning_kind = "CP"
    assert [type(event) for event in events_of(problem, "p")] == [CuspEvent, BranchPointEvent]
    problem.turning_kind, problem.events = "LP", lambda parameter: (own_fold, wall)
    assert [event.kind for event in events_of(problem, "p")] == ["BP", "LP", "wall"]
    assert events_of(problem, "p")[1] is own_fold
    point = replace(point_of_line(0.0), kind="".join(["wa", "ll"]))  # another object, as from a file
    assert event_at(problem, "p", point) is wall and event_at(LINE, "p", point) is None
    other = level("wall", abs)
    assert event_at(problem, "p", replace(point, event=other)) is other
    assert event_at(problem, "p", replace(point, event=other, kind="LP")) is own_fold
    curve = hb.trace(LINE, "p", (0.0, 1.0), np.zeros(2), events=[wall, level("at", lambda p: p - 0.5)])
    assert event_of(curve, curve["at1"]).kind == "at"


def test_a_detector_of_levels():
    """Levels at 0.3 and 0.8, and terminal ones at 1.4 and 1.2, on the line from 0 to 2."""
    high, low = level("high", lambda p: p - 0.8), level("low", lambda p: p - 0.3)
    ends = [level("later", lambda p: p - 1.4, terminal=True), level("sooner", lambda p: p - 1.2, terminal=True)]
    detector = EventDetector([high, ends[0], low, ends[1]], CurveEquations(LINE, "p", {}))
    assert detector.passing == (high, low) and detector.terminal == tuple(ends)
    points = [LINE.point(p) for p in (0.0, 0.5, 0.6, 1.0, 1.3, 2.0)]
    assert detector.sign_changes(points) == [0, 2]
    np.testing.assert_array_equal(detector.changes(high, points), [0, 0, 1, 0, 0])
    np.testing.assert_allclose(detector.values(low, points).ravel(), np.array([0, 0.5, 0.6, 1, 1.3, 2]) - 0.3)
    segment = LINE.segment(0.0, 2.0)
    assert [(one.event, round(one.value, 9)) for one in detector.find(segment)] == [(low, 0.3), (high, 0.8)]
    assert detector.ends(segment).event is ends[1] and detector.ends(segment).value == pytest.approx(1.2)
    assert detector.ends(LINE.segment(0.0, 1.0)) is None and detector.ahead(segment) is None
    with pytest.raises(ValueError, match="two events have the kind high, low; give each event another kind"):
        EventDetector([high, low, low, high, ends[0]], CurveEquations(LINE, "p", {}))


def test_events_ahead_of_a_segment():
    class Ahead(Event):
        def __init__(self, kind, s, terminal=False):
            self.kind, self.s, self.terminal = kind, s, terminal

        def ahead(self, segment):
            return LocatedEvent(self, self.s, segment.b, True)

    events = [Ahead("c", 1.3), Ahead("a", 1.1, True), Ahead("b", 1.2)]
    assert EventDetector(events, CurveEquations(LINE, "p", {})).ahead(LINE.segment(0.0, 1.0)).s == 1.1
    assert EventDetector([events[0], events[2]], CurveEquations(LINE, "p", {})).ahead(LINE.segment(0.0, 1.0)).s == 1.2


def test_folds_with_corners_are_not_searched_between_points():
    wall, fold = level("wall", lambda p: (p - 1.05) ** 2 + 1e-4), FoldEvent()
    for smooth in (True, False):
        detector = EventDetector([fold, wall], CurveEquations(Graph(0.0, 1.0, smooth=smooth), "p", {}))
        assert detector.searched == ((fold, wall) if smooth else (wall,))
    points = [LINE.point(p) for p in (0.0, 1.0, 2.0, 3.0)]
    ((i, ((event, s),)),) = detector.touching(points, scales()).items()
    assert i == 1 and event is wall and s == pytest.approx(0.05, abs=1e-9)


# ---- residual forms


class Shifted(ContinuationProblem):
    """x = (1 + d) p q, the residual form of a problem without a residual, and a second unknown that is zero."""

    size = 2

    def __init__(self, d, refined=None):
        self.d, self.finer = d, refined

    @property
    def refined_problem(self):
        return self.finer

    def evaluate(self, X, p, q):
        return np.array([X[0] - (1 + self.d) * p * q, X[1]]), np.eye(2)

    def __repr__(self):
        return f"shifted by {self.d:g}"


class NoResidual(ContinuationProblem):
    residual_form = None

    def __init__(self, form):
        self.residual_form = form

    def in_residual_form(self, point, form):
        return point.X


def formless(p):
    """A point of the problem without a residual, at q = 1."""
    return replace(point_of_line(p), parameters={"q": 1.0, "p": p})


@pytest.mark.parametrize("by_event", [False, True])
@pytest.mark.parametrize("p", [2.0, -2.0])
@pytest.mark.parametrize(("d", "accurate"), [(0.9e-5, True), (1.1e-5, False), (-0.9e-5, True), (-1.1e-5, False)])
def test_a_residual_form_is_refined_until_it_has_the_point(d, accurate, p, by_event):
    """The relative difference, of x or of the parameter at which x has its value, is d."""
    # x / p = 1 + d; an event at x = p_0 lies at p_0 / (1 + d)
    event = Event("at", lambda point: point.X[0] - p) if by_event else None
    exact = Shifted(0.0)
    point = formless(p)
    form, here = in_residual_form(NoResidual(Shifted(d, exact)), point, "p", event)
    assert (form is exact) != accurate and here.problem is form and here.X[0] == p
    if not accurate:
        with pytest.raises(NoConvergence, match="the point is not known to shifted by"):
            in_residual_form(NoResidual(Shifted(d)), point, "p", event)


def test_a_residual_form_at_zero_and_of_itself():
    point = formless(0.0)
    assert in_residual_form(LINE, point, "p", None) == (LINE, point)
    form = Shifted(0.0)
    for event in (None, Event("at", lambda point: point.X[0])):
        assert in_residual_form(NoResidual(form), point, "p", event)[0] is form
    with pytest.raises(NoConvergence, match="LP1 is not known to shifted by 1"):
        in_residual_form(NoResidual(Shifted(1.0)), replace(formless(1.0), label="LP1"), "p", None)
