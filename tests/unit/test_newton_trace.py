"""Newton's method and pseudo-arclength continuation on closed-form curves, and errors for invalid input."""

import gc
from typing import ClassVar

import numpy as np
import pytest
from scipy.optimize import brentq

from hbgear import (
    Backlash,
    Duffing,
    Element,
    HarmonicBalance,
    Load,
    NewtonSettings,
    NoConvergence,
    Point,
    SpurPair,
    Status,
    StepControl,
    System,
    trace,
)
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.fold import fold_on_segment
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.solvers.corrector import correct
from hbgear.continuation.solvers.newton import solve
from hbgear.continuation.stepping.kernels import predict
from hbgear.continuation.tracing.ends import CurveEnds
from hbgear.continuation.tracing.stepper import Stepper
from hbgear.gears import DoubleHelicalPair


class Curve:
    """One equation f(x, p) = 0 with df/dx: the minimal interface of a problem."""

    def __init__(self, f, slope):
        self.f, self.slope = f, slope

    def evaluate(self, X, p):
        x = X[0]
        return np.array([self.f(x, p)]), np.array([[self.slope(x, p)]])


def at(x, p):
    """Return a start point."""
    return Point(np.atleast_1d(float(x)), {"p": float(p)}, 0.0, 0, None, np.zeros(0, dtype=np.int8), np.nan, None)


CIRCLE = Curve(lambda x, p: x * x + p * p - 1, lambda x, p: 2 * x)
CHAIN = Curve(lambda x, p: x + 3 * np.sin(x) - p, lambda x, p: 1 + 3 * np.cos(x))
"""x + 3 sin x = p: two folds per 2 pi, at cos x = -1/3."""
PITCHFORK = Curve(lambda x, p: (p - 0.3) * x - x**3, lambda x, p: p - 0.3 - 3 * x * x)


# ---- segments


@pytest.mark.parametrize("scale", [(1.0, 1.0), (0.01, 1.0), (0.5, 1.0)])
def test_a_segment_is_interpolated_for_any_length_of_its_tangents(scale):
    """At the fold of a circle the error is of fourth order and the fold is at the middle, for all scales."""

    def piece(h, before=1.0, behind=1.0):
        ends = [
            CurvePoint(np.array([np.sin(x), np.cos(x)]), length * np.array([np.cos(x), -np.sin(x)]), 1, 0.0, 0)
            for x, length in ((-h, before), (h, behind))
        ]
        return Segment(as_problem(CIRCLE), "p", {}, *ends, np.array(scale), NewtonSettings())

    def off(arc):
        return np.abs(np.linalg.norm(arc.guess(np.linspace(0.0, 1.0, 21)[:, None]), axis=1) - 1).max()

    wide, narrow, plain = piece(0.2, 3.0, 0.25), piece(0.1, 0.5, 40.0), piece(0.2)
    assert off(wide) == pytest.approx(off(plain), rel=1e-9)
    assert np.log2(off(wide) / off(narrow)) == pytest.approx(4.0, abs=0.2)
    assert [fold_on_segment(arc) for arc in (wide, narrow, plain)] == pytest.approx([0.5] * 3, abs=1e-12)


# ---- Newton


def test_newton_converges_quadratically():
    problem = Curve(lambda x, p: x**3 - p, lambda x, p: 3 * x * x)
    solution = solve(problem, np.array([1.5]), {"p": 2.0})
    assert solution.X[0] == pytest.approx(2 ** (1 / 3), rel=1e-10)
    assert solution.iterations <= 4
    now = as_problem(problem).linearise(solution.X, "p", p=2.0)
    np.testing.assert_allclose(now.dR_dp, [-1.0], rtol=1e-9)


def test_newton_halves_steps_that_overshoot():
    problem = Curve(lambda x, p: np.arctan(x) - p, lambda x, p: 1 / (1 + x * x))
    assert solve(problem, np.array([20.0]), {"p": 0.0}).X[0] == pytest.approx(0.0, abs=1e-9)


def test_no_convergence_has_the_iterations():
    problem = Curve(lambda x, p: x * x + p, lambda x, p: 2 * x)
    with pytest.raises(NoConvergence, match=r"relative residual of .* \(needed 1e-10\) .* p = 1") as caught:
        solve(problem, np.array([0.7]), {"p": 1.0})
    error = caught.value
    assert error.X.shape == (1,) and error.parameters == {"p": 1.0} and len(error.residuals) > 1


# ---- curves


def test_a_closed_curve_is_noticed():
    curve = trace(CIRCLE, "p", (-2, 2), at(1, 0))
    assert curve.status is Status.CLOSED and curve.status.complete
    np.testing.assert_allclose([p.parameters["p"] for p in curve.special], [1, -1], atol=1e-10)
    assert [p.kind for p in curve.special] == ["LP", "LP"] and all(p.located for p in curve.special)
    np.testing.assert_allclose(curve.X[:, 0] ** 2 + curve.values**2, 1, atol=1e-9)
    # exactly one revolution
    turned = np.unwrap(np.arctan2(curve.values, curve.X[:, 0]))
    assert np.ptp(turned) == pytest.approx(2 * np.pi, abs=1e-6)


@pytest.mark.parametrize("span", [(0.0, 20.0), (20.0, 0.0)])
def test_every_fold_is_passed_in_both_directions(span):
    x0 = 0.0 if span[0] == 0 else 19.7
    curve = trace(CHAIN, "p", span, np.array([x0]))
    assert curve.status is Status.REACHED_END and curve.values[-1] == span[1]
    x = np.arccos(-1 / 3)
    folds = np.array([2 * np.pi * n + s * x for n in range(4) for s in (1, -1)])
    ends = np.sort([curve.X[0, 0], curve.X[-1, 0]])
    folds = np.sort(folds[(folds > ends[0]) & (folds < ends[1])])
    found = np.array([p.X[0] for p in curve.special])
    np.testing.assert_allclose(np.sort(found), folds, atol=1e-8)
    np.testing.assert_allclose([p.parameters["p"] for p in curve.special], found + 3 * np.sin(found), atol=1e-10)
    assert np.all(np.diff(curve.X[:, 0]) * (span[1] - span[0]) > 0)


def test_a_curve_that_turns_back_leaves_through_its_start():
    parabola = Curve(lambda x, p: x * x + p - 1, lambda x, p: 2 * x)
    curve = trace(parabola, "p", (0.0, 2.0), np.array([1.0]))
    assert (
        curve.status is Status.LEFT_SPAN and curve.values[-1] == 0.0 and curve.X[-1, 0] == pytest.approx(-1, abs=1e-9)
    )
    assert "other end" in curve.message or "turned back" in curve.message


@pytest.mark.parametrize("first", [0.01, 0.0123, 0.02])
def test_a_branch_point_is_located(first):
    curve = trace(PITCHFORK, "p", (-1.0, 1.0), np.array([0.0]), steps=StepControl(first_step=first))
    (point,) = curve.special
    assert (point.kind, point.label, point.located) == ("BP", "BP1", True)
    assert point.parameters["p"] == pytest.approx(0.3, abs=1e-8)
    assert curve.status is Status.REACHED_END and np.all(curve.X == 0)


def test_a_branch_point_of_a_curved_trunk_is_located():
    """A pitchfork u (p - 0.3 - u^2) = 0 in u = x - sin 2p; y = x^2."""

    class Trunk:
        def evaluate(self, X, p):
            x, y = X
            u = x - np.sin(2 * p)
            R = [u * (p - 0.3 - u * u), y - x * x]
            return np.array(R), np.array([[p - 0.3 - 3 * u * u, 0.0], [-2 * x, 1.0]])

    start = np.array([np.sin(-2.0), np.sin(-2.0) ** 2])
    curve = trace(Trunk(), "p", (-1.0, 1.0), start)
    (point,) = curve.special
    assert point.kind == "BP" and point.parameters["p"] == pytest.approx(0.3, abs=1e-8)
    np.testing.assert_allclose(curve.X[:, 0], np.sin(2 * curve.values), atol=1e-8)


@pytest.mark.parametrize("bend", [0.0, 0.7, -0.4])
def test_the_vertex_of_a_pitchfork_has_one_label(bend):
    """On u^2 = p - 0.3 the branch point was listed together with a fold, at the same place."""

    class Pitchfork:
        def evaluate(self, X, p):
            x, y = X
            u = x - bend * y
            R = [u * (p - 0.3 - u * u), y - u * u - u**3]
            slope = (p - 0.3 - 3 * u * u) * np.array([1.0, -bend])
            return np.array(R), np.array([slope, (-2 * u - 3 * u * u) * np.array([1.0, -bend]) + [0.0, 1.0]])

    u, y = 0.7**0.5, 0.7 + 0.7**1.5
    curve = trace(Pitchfork(), "p", (1.0, 0.0), np.array([u + bend * y, y]))
    u = curve.X[:, 0] - bend * curve.X[:, 1]
    assert u.max() > 0.8 and u.min() < -0.8
    np.testing.assert_allclose(u * u, curve.values - 0.3, atol=1e-8)
    vertex = [point for point in curve.special if abs(point.parameters["p"] - 0.3) < 1e-4]
    assert [point.kind for point in vertex] == ["BP"] and vertex[0].parameters["p"] == pytest.approx(0.3, abs=1e-12)


def on_circle(angles):
    """Return points of the unit circle x = sin s, p = cos s and their tangents, (k, 2) each."""
    sine, cosine = np.sin(angles), np.cos(angles)
    return np.column_stack([sine, cosine]), np.column_stack([cosine, -sine])


def predicted(u, t, step, scale=(1.0, 1.0)):
    """Return the prediction one step ahead of points u with tangents t, the newest first."""
    out = np.empty(u.shape[1])
    predict(u, t, len(u), np.array(scale), step, out)
    return out


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_prediction_from_k_points_is_of_order_2k(k):
    """Hermite extrapolation from k points and tangents at unequal distances has an error of h^2k on a circle."""
    lengths, errors = 0.12 * 1.5 ** -np.arange(4), []
    for h in lengths:
        rows, tangents = on_circle(1.0 - h * np.array([0.0, 0.8, 1.5, 2.7][:k]))
        u = predicted(rows, tangents, h)
        assert (u - rows[0]) @ tangents[0] == pytest.approx(h, rel=1e-12)  # on the plane of the corrector
        errors.append(abs(np.hypot(*u) - 1))
    order = np.diff(np.log(errors)) / np.diff(np.log(lengths))
    np.testing.assert_allclose(order[1 if k == 4 else -1], 2 * k, atol=0.4)  # before rounding dominates


def polynomial_curve(degree, scale):
    """Return a function for u and du/dx of a curve in three unknowns: x, the distance along the tangent at 0, and two
    polynomials in x with the powers 2, ..., degree."""
    power = np.arange(2, degree + 1)
    bend = 0.3 * np.column_stack([np.cos(power), np.sin(power)])

    def at(x):
        return np.array([*(x**power @ bend), x]) * scale, np.array([*(power * x ** (power - 1) @ bend), 1.0]) * scale

    return at


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_prediction_from_k_points_is_exact_for_polynomials_of_degree_2k_minus_1(k):
    """In scaled unknowns, with unequal distances and tangent lengths; degree 2k + 1 is not reproduced."""
    scale, lengths = np.array([2.0, 0.5, 10.0]), np.array([1.3, 0.7, 1.4, 2.0])[:k]
    for degree in (2 * k - 1, 2 * k + 1):
        curve = polynomial_curve(degree, scale)
        u, t = (np.array(x) for x in zip(*(curve(x) for x in (0.0, -0.11, -0.19, -0.34)[:k]), strict=True))
        error = np.abs((predicted(u, lengths[:, None] * t, 0.1, scale) - curve(0.1)[0]) / scale).max()
        assert (error < 1e-13) if degree < 2 * k else (error > 1e-7), (degree, error)


def test_prediction_across_a_corner_uses_fewer_points():
    """Points before a corner of the curve are not used: the prediction is the tangent alone."""
    rows, tangents = on_circle(np.array([1.0, 1.05]))
    tangents[1] = tangents[1, 1], -tangents[1, 0]
    np.testing.assert_allclose(predicted(rows, tangents, 0.05), rows[0] + 0.05 * tangents[0], rtol=1e-12)


@pytest.mark.parametrize("first", [0.01, 0.013, 0.02, 0.027, 0.04])
def test_a_small_loop_is_not_stepped_over(first):
    """p = x - 2 x exp(-(x / w)^2) has two folds within a twentieth of the span, closer than the longest step."""
    w = 0.025
    loop = Curve(
        lambda x, p: p - x + 2 * x * np.exp(-((x / w) ** 2)),
        lambda x, p: -1 + 2 * np.exp(-((x / w) ** 2)) * (1 - 2 * (x / w) ** 2),
    )
    z = brentq(lambda z: 2 * np.exp(-(z**2)) * (1 - 2 * z**2) - 1, 0.1, 0.7, xtol=1e-15)
    curve = trace(loop, "p", (-1.0, 1.0), np.array([-1.0]), steps=StepControl(first_step=first))
    assert [p.kind for p in curve.special] == ["LP", "LP"]
    expected = w * z * (1 - 2 * np.exp(-(z**2)))
    np.testing.assert_allclose([p.parameters["p"] for p in curve.special], [-expected, expected], rtol=1e-6)
    blind = trace(
        loop, "p", (-1.0, 1.0), np.array([-1.0]), steps=StepControl(first_step=first, max_prediction_error=1.0)
    )
    assert len(curve) > len(blind)


def test_a_prediction_is_corrected_on_its_plane():
    """Predictions near the circle are corrected onto it within their plane, with the direction of the curve and the
    sign of the determinant. A distant prediction raises NoConvergence."""
    for angle, length, normal in ((1.0, 1.0, (-0.8, 0.6)), (0.9, 2.0, (-0.8, 0.6)), (0.8, 1.0, (0.8, -0.6))):
        normal, u = np.array(normal) * length, 1.0001 * np.array([np.cos(angle), np.sin(angle)])
        found = correct(CurveEquations(as_problem(CIRCLE), "p", {}), u, normal)
        x, p = found.solution.X[0], found.solution.value
        assert np.hypot(x, p) == pytest.approx(1.0, abs=1e-14)
        assert normal @ ([x, p] - u) == pytest.approx(0, abs=1e-14)
        assert [x, p] @ found.direction == pytest.approx(0.0, abs=1e-9)  # dR/dp is a finite difference
        assert normal @ found.direction == pytest.approx(1.0, abs=1e-14)
        assert found.orientation == np.sign(x * normal[1] - p * normal[0])
    with pytest.raises(NoConvergence, match="the corrector stopped at a relative residual of"):
        correct(CurveEquations(as_problem(CIRCLE), "p", {}), np.array([40.0, 3.0]), np.array([-0.8, 0.6]))


def test_points_keep_no_matrices():
    """The evaluations of the corrector (residual, Jacobian) are not stored with the points."""

    def held(*_):
        counts.append(len([x for x in gc.get_objects() if isinstance(x, Evaluation) and x.R.size]))

    counts = []
    gc.collect()
    gc.freeze()  # excludes earlier objects from the count at every point
    try:
        trace(CIRCLE, "p", (-2, 2), at(1, 0), progress=held)
    finally:
        gc.unfreeze()
    assert len(counts) > 80 and max(counts) < 4


def test_prediction_from_more_points_saves_newton_steps():
    """Predictions by the tangent alone and by polynomials from two and four points."""
    curves = [
        trace(
            HarmonicBalance(Duffing(), 5), "Omega", (0.5, 1.6), steps=StepControl(predictor_points=k), stability=False
        )
        for k in (1, 2, 4)
    ]
    needed = [curve.iterations.sum() for curve in curves]
    assert needed[0] > 1.2 * needed[1] > 1.2 * 1.2 * needed[2]
    assert curves[2].iterations[5:].mean() < 1.2


def test_a_step_that_always_leads_back_ends_the_curve(monkeypatch):
    """A step across a corner has a fixed size; if it retraces the curve, no shorter step is possible."""
    stride, before = Stepper.stride, CurveEnds.points_before_retrace
    monkeypatch.setattr(Stepper, "stride", lambda self, recent, *rest: stride(self, recent, *rest[:2], 0.02, 1))
    monkeypatch.setattr(
        CurveEnds, "points_before_retrace", lambda self, path: 0 if path[-1].value > 1 else before(self, path)
    )
    curve = trace(HarmonicBalance(Duffing(), 3), "Omega", (0.8, 1.2), special=False, stability=False, cover=False)
    assert curve.status is Status.RETRACED and 0.9 < curve.values[-1] < 1


def test_a_point_costs_its_newton_steps_and_one_evaluation():
    calls = []

    class Counted:
        def evaluate(self, X, p):
            return CIRCLE.evaluate(X, p)

        def linearise(self, X, name, p):
            calls.append(p)
            return Evaluation(*CIRCLE.evaluate(X, p), np.array([2 * p]), 1.0)

    curve = trace(Counted(), "p", (-2, 2), at(1, 0), special=False)
    assert len(calls) <= curve.iterations.sum() + len(curve) + 4  # and the start and the end
    assert curve.iterations[5:].max() <= 2 and np.mean(curve.iterations[5:]) < 1.5


class Weighed(ContinuationProblem):
    """x^3 - x / 2 - a = 0 with a = p + p^3 / 4: two folds; records all values of p at which it is evaluated."""

    def __init__(self, costly):
        self.said, self.values = costly, []

    def is_expensive(self, name):
        return self.said

    def linearise(self, X, name, p):
        self.values.append(p)
        R, J = np.array([X[0] ** 3 - X[0] / 2 - p - p**3 / 4]), np.array([[3 * X[0] ** 2 - 0.5]])
        return Evaluation(R, J, np.array([-1 - 0.75 * p * p]), 1.0)


def test_a_costly_parameter_is_kept_while_a_point_is_corrected():
    """An expensive parameter needs about one value per point away from folds; curve and folds are the same."""
    curves, asked = [], []
    for costly in (False, True):
        curves.append(trace(Weighed(costly), "p", (-1.0, 1.0), np.array([-1.1])))
        problem = Weighed(costly)
        rows = trace(problem, "p", (-1.0, 1.0), np.array([-1.1]), special=False)
        asked.append(len(set(problem.values)) / len(rows))
        x, p = curves[-1].X[:, 0], curves[-1].values
        np.testing.assert_allclose(x**3 - x / 2, p + p**3 / 4, rtol=0, atol=1e-10)
    folds = [[point.parameters["p"] for point in curve.special] for curve in curves]
    heights = np.sqrt(1 / 6) * np.array([1, -1]) / 3  # of x^3 - x / 2 at its extrema
    exact = [brentq(lambda p, a=a: p + p**3 / 4 - a, -1, 1, xtol=1e-15) for a in heights]
    for found in folds:
        np.testing.assert_allclose(sorted(found), sorted(exact), rtol=0, atol=1e-10)
    assert asked[1] < 1.5 < 1.8 < asked[0], asked


def test_the_first_step_fits_between_the_shortest_and_the_longest():
    assert (
        StepControl().first_step,
        StepControl(max_step=0.004).first_step,
        StepControl(min_step=0.02).first_step,
    ) == (0.01, 0.004, 0.02)
    curve = trace(HarmonicBalance(Duffing(), 3), "Omega", (0.8, 0.85), steps=StepControl(max_step=0.004))
    assert curve.status.complete and curve.step.max() <= 0.004 * (1 + 1e-12)
    with pytest.raises(ValueError, match="0 < min_step <= first_step <= max_step"):
        StepControl(first_step=0.01, max_step=0.004)
    with pytest.raises(ValueError, match="max_step = '1' must be a finite number"):
        StepControl(max_step="1")


def test_step_control_accepts_the_names_of_version_0_2():
    with pytest.warns(DeprecationWarning, match=r"StepControl\(longest=\.\.\.\) is deprecated: use max_step="):
        old = StepControl(longest=0.02, max_points=9)
    assert old == StepControl(max_step=0.02, max_points=9)
    for name, value in (("first", 0.01), ("longest", 0.02), ("shortest", 1e-7), ("newton", 3), ("history", 4)):
        with pytest.warns(DeprecationWarning, match=f"StepControl.{name} is deprecated: use "):
            assert getattr(old, name) == value
    with pytest.raises(TypeError, match="longest is the deprecated name of max_step; give only max_step"):
        StepControl(longest=0.02, max_step=0.02)


def test_steps_stay_within_their_limits():
    steps = StepControl(first_step=0.003, max_step=0.01, max_turn_deg=5)
    curve = trace(CIRCLE, "p", (-2, 2), at(1, 0), steps=steps, special=False)
    assert curve.step[1] <= 0.003 * (1 + 1e-12) and curve.step.max() <= 0.01 * (1 + 1e-12)


def test_max_points():
    curve = trace(CIRCLE, "p", (-2, 2), at(1, 0), steps=StepControl(max_points=12), special=False)
    assert curve.status is Status.MAX_POINTS and len(curve) == 12 and "12 points" in curve.message
    advice = curve.status.advice
    assert f". {advice[0].upper()}{advice[1:]}" in curve.message and not curve.status.complete


def test_interruption_keeps_the_points():
    def stop(now):
        if now.numbers["points"] == 7:
            raise KeyboardInterrupt

    curve = trace(CIRCLE, "p", (-2, 2), at(1, 0), progress=stop)
    assert curve.status is Status.INTERRUPTED and len(curve) == 7 and "interrupted at p" in curve.message


def test_progress_is_reported_at_every_point():
    seen = []
    curve = trace(CIRCLE, "p", (-2, 2), at(1, 0), special=False, progress=seen.append)
    assert [now.numbers["points"] for now in seen] == list(range(2, len(curve) + 1))
    np.testing.assert_array_equal([now.numbers["value"] for now in seen], curve.values[1:])
    np.testing.assert_allclose([now.done for now in seen], (curve.values[1:] + 2) / 4, atol=1e-12)
    assert f"p = {curve.values[1]:.5f}, 2 points, step {seen[0].numbers['step']:.1e}" in str(seen[0])


def test_progress_of_stability_that_takes_long(monkeypatch):
    """Points are monitored one by one, each is reported, and the curve is identical to the last bit."""
    monkeypatch.setattr("hbgear.continuation.tracing.monitoring.MAX_SECONDS_WITHOUT_PROGRESS", 0.0)
    problem, steps, seen = HarmonicBalance(SpurPair(), 5), StepControl(max_points=10), []
    curve = trace(problem, "Omega", (0.6, 1.6), steps=steps, progress=lambda now: seen.append(now.text))
    usual = trace(problem, "Omega", (0.6, 1.6), steps=steps)
    assert np.array_equal(curve.X, usual.X) and np.array_equal(curve.multipliers, usual.multipliers)
    found = [text.partition("points, ")[2] for text in seen if "step" not in text]
    assert found[:10] == [f"stability of {i} of 10 points" for i in range(1, 11)]
    assert found[10:] == ["verification of the stability", "search for special points"]

    def stop(now):
        if "of 3 of" in now.text:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as raised:
        trace(problem, "Omega", (0.6, 1.6), steps=steps, progress=stop)
    assert len(raised.value.branch) == 10 and raised.value.branch.status is Status.FAILED


def test_a_trace_continues_from_any_point():
    half = trace(CHAIN, "p", (0.0, 20.0), np.array([0.0]), steps=StepControl(max_points=60))
    rest = trace(CHAIN, "p", (0.0, 20.0), half[-1])
    assert rest.values[0] == half.values[-1] and rest.X[-1, 0] == pytest.approx(19.7, abs=1)
    assert rest.X[-1, 0] + 3 * np.sin(rest.X[-1, 0]) == pytest.approx(20.0, rel=NewtonSettings().tolerance)


def test_the_end_of_the_admissible_range_is_a_status():
    """A model raises ValueError outside an undeclared range: the trace stops there and reports the error."""

    class Damped(Duffing):
        ranges: ClassVar = {}

        def __post_init__(self):
            super().__post_init__()
            if self.zeta < 0:
                raise ValueError(f"zeta = {self.zeta} must not be negative")

    curve = trace(HarmonicBalance(Damped(), 3), "zeta", (0.2, -0.1), at={"Omega": 0.7})
    assert curve.status is Status.STEP_TOO_SMALL and "must not be negative" in curve.message
    assert 0 <= curve.values[-1] < 1e-5


@pytest.mark.parametrize("stability", [True, False])
@pytest.mark.parametrize(
    ("model", "name", "span"),
    [
        (Duffing(), "zeta", (0.2, 0.0)),
        (Duffing(), "zeta", (0.0, 0.2)),
        (SpurPair(e=(0.01,)), "b", (0.02, 0.0)),
        (SpurPair(e=(0.01,)), "b", (0.0, 0.02)),
    ],
)
def test_the_end_of_a_range_is_reached_and_left(model, name, span, stability):
    """Evaluation beyond the end of the range is impossible, and the gap b is closed there."""
    curve = trace(HarmonicBalance(model, 3), name, span, at={"Omega": 0.7}, stability=stability)
    assert curve.status is Status.REACHED_END and (curve.values[0], curve.values[-1]) == span
    assert len(curve) < 120 and np.all(curve.residual < 1e-10)


def test_a_span_outside_the_range_is_refused():
    with pytest.raises(ValueError, match=r"span = \(0.2, -0.1\): zeta must not be negative"):
        trace(HarmonicBalance(Duffing(), 3), "zeta", (0.2, -0.1), at={"Omega": 0.7})


def test_a_resonance_without_damping_ends_with_a_status():
    """x = F / (1 - Omega^2) cos tau is unbounded at Omega = 1; the trace continues on the other side."""
    curve = trace(HarmonicBalance(Duffing(zeta=0.0, k3=0.0), 1), "Omega", (0.5, 1.5), steps=StepControl(max_points=400))
    (other,) = curve.others
    assert curve.values.max() < 1 < other.values.min() and other.values.max() == 1.5
    for side in (curve, other):
        x = 0.18 / (1 - side.values**2)
        np.testing.assert_allclose(side.X[:, 1], x, rtol=1e-6)
        assert side.status is Status.UNBOUNDED and side.asymptotes["last"] == pytest.approx(1, abs=1e-10)
        assert abs(x).max() > 20 * 0.18


def test_a_load_to_the_negative_side_takes_no_more_steps_to_its_static_state(monkeypatch):
    """Both signs of the load need the same number of Newton runs (at most 3), a nonlinear law at most 8."""
    from hbgear.harmonic.equations import static_state

    steps, static = [], static_state._solve_static
    monkeypatch.setattr(static_state, "_solve_static", lambda *given: steps.append(given) or static(*given))
    counts = []
    for model in (SpurPair(), SpurPair(F_m=-0.1), Duffing()):
        HarmonicBalance(model, 5).start(0.5)
        counts.append(len(steps) - sum(counts))
    assert counts[0] == counts[1] <= 3 and counts[2] <= 8


def test_no_load_no_motion():
    curve = trace(HarmonicBalance(Duffing(F=0.0), 3), "Omega", (0.5, 1.6))
    assert curve.status is Status.REACHED_END and not curve.X.any() and not curve.special
    assert np.all(curve.stable)
    still = trace(HarmonicBalance(SpurPair(e=()), 3), "Omega", (0.5, 1.6))
    np.testing.assert_allclose(still.X, np.tile([1.1, 0, 0, 0, 0, 0, 0], (len(still), 1)), atol=1e-12)


def test_in_a_gap_without_any_load_the_position_is_arbitrary():
    curve = trace(HarmonicBalance(SpurPair(F_m=0.0, e=()), 3), "Omega", (0.5, 1.6))
    assert curve.status is Status.ARBITRARY and "load the system" in curve.status.advice
    assert not curve.X.any() and curve.values[-1] == 1.6


MODELS = {
    "Duffing": (Duffing(), (0.5, 1.6)),
    "SpurPair": (SpurPair(), (1.5, 0.3)),
    "DoubleHelicalPair": (DoubleHelicalPair(eps=(0.16,), e=(0.03,)), (1.3, 0.7)),
}


@pytest.mark.parametrize("H", [1, 5])
@pytest.mark.parametrize("name", MODELS)
def test_every_point_solves_its_equations(name, H):
    model, span = MODELS[name]
    problem = HarmonicBalance(model, H)
    curve = trace(problem, "Omega", span, accuracy=None)
    assert curve.status is Status.REACHED_END
    assert curve.residual.max() < 1e-9 and curve.iterations.mean() < 3
    for i in range(len(curve)):
        now = problem.linearise(curve.X[i], "", **curve.parameters_at(i))
        assert np.linalg.norm(now.R) / now.size < 1e-9
    for point in curve.special:
        assert curve.values[point.index] == point.parameters["Omega"]
        np.testing.assert_array_equal(curve.X[point.index], point.X)
        assert np.ptp([*point.interval, point.parameters["Omega"]]) < 0.06


def test_both_directions_find_the_same_folds():
    forth, back = (trace(HarmonicBalance(Duffing(), 5), "Omega", span) for span in ((0.5, 1.6), (1.6, 0.5)))
    a, b = ([p.parameters["Omega"] for p in curve.special] for curve in (forth, back))
    assert len(a) == 2
    np.testing.assert_allclose(a, b[::-1], atol=1e-9)


def test_any_parameter_and_its_folds():
    """The load as parameter: at fixed A the closed H = 1 relation gives F, and dF/dA = 0 at the folds."""
    problem, Omega, zeta, k3 = HarmonicBalance(Duffing(), 1), 1.3, 0.05, 0.1
    curve = trace(problem, "F", (0.1, 1.5), at={"Omega": Omega})
    A = curve.amplitude("H1")
    F = A * np.hypot(1 - Omega**2 + 0.75 * k3 * A**2, 2 * zeta * Omega)
    np.testing.assert_allclose(curve.values, F, rtol=1e-9)
    # d(F^2)/d(A^2) = 0 in s = A^2
    a, b = 1 - Omega**2, 0.75 * k3
    s = np.roots([3 * b * b, 4 * a * b, a * a + (2 * zeta * Omega) ** 2])
    expected = np.sort(np.sqrt(s * ((a + b * s) ** 2 + (2 * zeta * Omega) ** 2)))
    np.testing.assert_allclose(np.sort([p.parameters["F"] for p in curve.special]), expected, atol=1e-10)


def test_units_do_not_matter():
    """The spur pair in metres and seconds (b = 25 um, 5 kHz) has the folds of the dimensionless one."""
    b, m, w = 25e-6, 1.8, 2 * np.pi * 5e3
    k = m * w * w
    gap = Element([1.0], Backlash(b, k), damping=2 * 0.05 * m * w)
    load = [Load([0.1 * k * b]), Load(None, {1: [0.05 * m * b]}, power=2)]
    physical = HarmonicBalance(System([[m]], None, [[0.0]], [gap], load), 8)
    a = trace(HarmonicBalance(SpurPair(), 8), "Omega", (1.5, 0.5))
    c = trace(physical, "Omega", (1.5 * w, 0.5 * w))
    assert [p.kind for p in a.special] == [p.kind for p in c.special]
    for p, q in zip(a.special, c.special, strict=True):
        assert q.parameters["Omega"] / w == pytest.approx(p.parameters["Omega"], abs=1e-8)
        np.testing.assert_allclose(q.X / b, p.X, atol=1e-5)
    assert len(c) < 2 * len(a)


def test_jumps_leave_at_the_folds_and_land_on_stable_motions():
    curve = trace(HarmonicBalance(Duffing(), 5), "Omega", (0.5, 1.6))
    up, down = sorted(curve.jumps(), key=lambda j: -j.direction)
    assert (up.label, up.direction, down.label, down.direction) == ("LP1", 1, "LP2", -1)
    for jump in (up, down):
        assert jump.value == curve[jump.label].parameters["Omega"] == jump.after.parameters["Omega"]
        assert jump.after.stable and jump.after.residual < 1e-9
    # Duffing's hardening spring: the sweep up falls to the low motion, the sweep down rises to the high one
    assert up.before.amplitude() > 1.5 * up.after.amplitude() and down.after.amplitude() > 1.3 * down.before.amplitude()


# ---- bad input

DUFFING = HarmonicBalance(Duffing(), 3)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("Omega", (1.0, 1.0)), ValueError, r"span = \(1.0, 1.0\) is empty; give two different values of Omega"),
        (("Omega", (1.0, np.nan)), ValueError, r"span = \(1.0, nan\) must be finite"),
        (("Omega", (1.0, np.inf)), ValueError, "must be finite"),
        (("Omega", 1.0), ValueError, "span = 1.0 must be two numbers"),
        (("Omega", (1.0, 2.0, 3.0)), ValueError, "must be two numbers"),
        (("Omega", (1.0, -1.0)), ValueError, "Omega must be positive"),
        (("Omga", (0.5, 1.0)), KeyError, "Duffing has no parameter 'Omga'; did you mean 'Omega'"),
        (("zetta", (0.5, 1.0)), KeyError, "did you mean 'zeta'"),
        (("zeta", (0.05, 0.1)), ValueError, "needs a fixed Omega: give at="),
        (("Omega", (0.5, 1.0), np.zeros(9)), ValueError, "9 .*7"),
        (("Omega", (0.5, 1.0), np.full(7, np.nan)), ValueError, "finite"),
    ],
)
def test_bad_input(arguments, error, message):
    with pytest.raises(error, match=message):
        trace(DUFFING, *arguments)


def test_bad_fixed_values_and_starts():
    with pytest.raises(KeyError, match="did you mean 'zeta'"):
        trace(DUFFING, "Omega", (0.5, 1.0), at={"zetta": 0.1})
    with pytest.raises(ValueError, match="finite"):
        trace(DUFFING, "Omega", (0.5, 1.0), at={"zeta": np.nan})
    with pytest.raises(ValueError, match=r"the start has p = 0, outside the span \(1, 2\); widen the span"):
        trace(CIRCLE, "p", (1, 2), at(1, 0))
    with pytest.raises(ValueError, match="has no initial guess; give start="):
        trace(CIRCLE, "p", (1, 2))


def test_a_start_with_other_harmonics_works_or_is_refused():
    coarse = trace(DUFFING, "Omega", (0.5, 0.6))
    try:
        finer = trace(HarmonicBalance(Duffing(), 5), "Omega", (0.5, 0.6), coarse[0])
    except ValueError as error:
        assert "harmonics" in str(error)
    else:
        assert finer.status.complete and finer.layout.harmonics == 5


@pytest.mark.parametrize("before", [1e-7, 1e-6, 1e-5])
def test_a_fold_next_to_the_start_is_on_the_curve_which_ends_behind_it(before):
    problem = HarmonicBalance(Duffing(), 7)
    fold = trace(problem, "Omega", (0.8, 1.6))["LP1"].parameters["Omega"]
    start = trace(problem, "Omega", (0.8, fold - before))[-1]
    curve = trace(problem, "Omega", (fold - before, 1.6), start)
    assert curve.status == "left_span" and [p.label for p in curve.special] == ["LP1"]
    assert curve.values[0] == curve.values[-1] == fold - before
    assert curve["LP1"].parameters["Omega"] == pytest.approx(fold, rel=0, abs=1e-13)
    assert np.linalg.norm(curve.X[-1] - curve.X[0]) > np.sqrt(before)  # the other side of the fold


def test_a_start_on_a_fold_works_or_is_refused():
    curve = trace(DUFFING, "Omega", (0.5, 1.6))
    try:
        again = trace(DUFFING, "Omega", (0.5, 1.6), curve["LP1"])
    except NoConvergence as error:
        assert "fold" in str(error)
    else:
        assert again.status.complete


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"first_step": 0.1}, "0 < min_step <= first_step <= max_step"),
        ({"min_step": 0.0}, "0 < min_step"),
        ({"max_turn_deg": 0.0}, "max_turn_deg = 0.0 degrees must be above 0"),
        ({"max_points": 1}, "max_points = 1 must be a whole number of at least 2"),
        ({"max_prediction_error": 0.0}, "max_prediction_error = 0.0 must be above 0"),
        ({"predictor_points": 0}, "predictor_points = 0 must be a whole number of at least 1"),
    ],
)
def test_bad_steps(settings, message):
    with pytest.raises(ValueError, match=message):
        StepControl(**settings)


class Wiggles(ContinuationProblem):
    """x = 1e-5 sin(1e6 p): no step larger than about 1e-7 turns by less than the limit."""

    def evaluate(self, X, *, p):
        return X - 1e-5 * np.sin(1e6 * p), np.eye(1)


def test_a_trace_that_makes_no_progress_ends():
    """Forty steps whose sum is below a hundredth of the largest step; it took 5000 of them before."""
    curve = trace(Wiggles(), "p", (0.0, 1.0), np.zeros(1))
    assert curve.status is Status.STEP_TOO_SMALL and "40 steps in succession" in curve.message
    assert 40 <= len(curve) < 80
