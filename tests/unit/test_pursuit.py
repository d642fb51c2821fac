"""The compiled continuation loop agrees with the general one, which evaluates single points in Python."""

import numpy as np
import pytest

from hbgear import (
    Backlash,
    Cubic,
    Duffing,
    Element,
    HarmonicBalance,
    Load,
    NewtonSettings,
    NoConvergence,
    SpurPair,
    Status,
    StepControl,
    System,
    Unilateral,
    trace,
)
from hbgear.continuation import FoldProblem
from hbgear.continuation.curve.segment import point_from_solution
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.evaluation import HELD
from hbgear.continuation.solvers.newton import solve
from hbgear.continuation.tracing.stepper import Stepper
from hbgear.gears import DoubleHelicalPair
from hbgear.mechanics import Parallel, Periodic, Series


class GeneralLoop(HarmonicBalance):
    """Traced by the general loop; special points are located by the equations in Python."""

    def compiled_continuation(self, name, parameters):
        return None

    def compiled_locator(self, name, parameters, which):
        return None


def hardening_gap():
    """Return two masses with a cubic spring and a gap of periodic stiffness in parallel; the second is unbalanced."""
    law = Parallel((Cubic(0.2, 0.1), Backlash(0.4, 1.5, Series(1.0, (0.2,), (0.0, 0.1)))))
    elements = [Element([1.0, -1.0], law, damping=0.08), Element([0.0, 1.0], Unilateral(0.7, 0.3))]
    loads = [Load([0.2, 0.0], {1: [0.3, 0.0]}), Load(cosine={1: [0.0, 0.05]}, power=2)]
    return System(np.diag([1.0, 2.0]), 0.06 * np.eye(2), np.array([[0.6, -0.1], [-0.1, 1.4]]), elements, loads)


def arc():
    """Return a spur pair with parabolic arcs as transmission error, which has a corner."""
    return SpurPair(e=(), error=Periodic((2.0,), ((-0.13, 0.04 * np.pi, -0.02),)))


CURVES = {
    "duffing": (lambda: Duffing(zeta=0.05, k3=0.1, F=0.18), 7, (0.5, 1.6), {"LP"}),
    "spur pair": (SpurPair, 10, (1.5, 0.3), {"GR", "LP"}),
    "double-helical": (lambda: DoubleHelicalPair(zeta=0.05), 12, (1.1, 0.75), {"GR", "LP"}),
    "cubic spring and gap": (hardening_gap, 8, (1.8, 0.4), {"GR"}),
}


def compared(curve):
    """Special points without two inner grazings within 2e-4 of the span: a step that contains both may miss them."""
    inner = [p.parameters["Omega"] for p in curve.special if p.note.startswith("inner")]
    width = 2e-4 * np.ptp(curve.values)
    return [
        p
        for p in curve.special
        if not p.note.startswith("inner") or sum(abs(p.parameters["Omega"] - Omega) < width for Omega in inner) == 1
    ]


@pytest.mark.parametrize("back", [False, True], ids=["forth", "back"])
@pytest.mark.parametrize("name", CURVES)
def test_the_compiled_loop_gives_the_same_curve(name, back):
    """Equal ends, special points and jumps; points solve the equations and respect the maximum step size."""
    model, H, span, kinds = CURVES[name]
    span = span[::-1] if back else span
    one, many = (trace(kind(model(), H), "Omega", span) for kind in (GeneralLoop, HarmonicBalance))
    assert many.problem.compiled_continuation("Omega", {}) is not None
    assert one.status is many.status and one.message == many.message and one.status.complete
    points, others = compared(one), compared(many)
    assert [p.kind for p in points] == [p.kind for p in others]
    assert kinds <= {p.kind for p in many.special}
    for a, b in zip(points, others, strict=True):
        assert a.parameters["Omega"] == pytest.approx(b.parameters["Omega"], rel=0, abs=1e-9)
        np.testing.assert_allclose(a.X, b.X, rtol=0, atol=1e-6)
    assert [(j.label, j.direction) for j in one.jumps()] == [(j.label, j.direction) for j in many.jumps()]
    for a, b in zip(one.jumps(), many.jumps(), strict=True):
        assert a.value == pytest.approx(b.value, rel=0, abs=1e-9)
    sizes = many.problem.solution_norms(many.X)
    np.testing.assert_allclose(sizes, [many.problem.solution_norm(X) for X in many.X], rtol=1e-14)
    largest = sizes.max()
    rows = np.column_stack([many.X / largest, many.values / abs(span[1] - span[0])])
    assert np.linalg.norm(np.diff(rows, axis=0), axis=1).max() < 1.5 * StepControl().max_step
    assert many.residual.max() < 1e-10


@pytest.mark.parametrize("name", CURVES)
def test_both_loops_choose_the_same_points(name):
    """Step sizes and Newton iterations follow the same rules: the first 80 points, which include a resonance, agree
    to 1e-7."""
    model, H, span, _ = CURVES[name]
    few = StepControl(max_points=80)
    one, many = (
        trace(kind(model(), H), "Omega", span, steps=few, special=False) for kind in (GeneralLoop, HarmonicBalance)
    )
    assert one.status is many.status is Status.MAX_POINTS
    np.testing.assert_allclose(one.values, many.values, rtol=0, atol=1e-7)
    np.testing.assert_allclose(one.step, many.step, rtol=1e-4)
    np.testing.assert_array_equal(one.iterations, many.iterations)


@pytest.mark.parametrize("name", ["duffing", "spur pair", "double-helical", "arc"])
def test_newton_on_special_points_is_the_same_compiled(name):
    """From perturbed starts both locate folds and grazing contacts to 1e-11; Newton steps agree to 5 %."""
    model, H, span, kinds = (arc, 10, (1.5, 0.6), {"GR"}) if name == "arc" else CURVES[name]
    one, many = (kind(model(), H) for kind in (GeneralLoop, HarmonicBalance))
    curve = trace(many, "Omega", span, stability=False, accuracy=None)
    assert kinds <= {p.kind for p in curve.special}
    for point in curve.special:
        if point.kind not in ("LP", "GR"):
            continue
        U = np.append(point.X, point.parameters["Omega"])
        perturbed, here = U + 1e-4 * np.linalg.norm(U) * np.sin(np.arange(len(U))), point.parameters
        python, compiled = (point.event.equations(p, "Omega", point) for p in (one, many))
        assert compiled.compiled(here) is not None and python.compiled(here) is None
        for problem in (python, compiled):
            found = problem.located(perturbed, here)
            np.testing.assert_allclose(found.X, U, rtol=0, atol=1e-11 * np.linalg.norm(U))
            assert found.residual < 1e-12
        # weights and borders of the test function g differ; its curvature enters squared
        steps = [problem.stepped(perturbed, here, 1)[1] for problem in (python, compiled)]
        far = np.linalg.norm(perturbed - U)
        np.testing.assert_allclose(steps[0], steps[1], rtol=0, atol=0.05 * far)


@pytest.mark.parametrize("name", ["duffing", "spur pair", "double-helical", "cubic spring and gap"])
def test_newton_at_a_given_frequency_is_the_same_compiled(name):
    """Equal motions and derivatives from perturbed starts, and equal NoConvergence messages from NaN."""
    model, H, span, _ = CURVES[name]
    one, many = (kind(model(), H) for kind in (GeneralLoop, HarmonicBalance))
    here = {"Omega": 0.5 * sum(span)}
    X = many.start(**here)
    perturbed = X + 1e-2 * np.linalg.norm(X) * np.sin(np.arange(len(X)))
    assert many.compiled_locator("Omega", here, HELD) is not None and one.compiled_locator("Omega", here, HELD) is None
    python, compiled = (solve(problem, perturbed, here, "Omega") for problem in (one, many))
    assert python.iterations == compiled.iterations > 0 and compiled.value == here["Omega"]
    np.testing.assert_allclose(compiled.X, python.X, rtol=0, atol=1e-9 * np.linalg.norm(X))
    for a, b in zip(compiled.evaluation, python.evaluation, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-7 * max(np.abs(b).max(), python.evaluation.size))
    reasons = []
    for problem in (one, many):
        with pytest.raises(NoConvergence) as error:
            solve(problem, np.full(len(X), np.nan), here, "Omega")
        reasons.append(str(error.value))
    assert reasons[0] == reasons[1] and "residual of nan" in reasons[0]


def test_compiled_newton_gives_up():
    """NoConvergence far from folds; sampled laws and parameters other than Omega have no compiled locator."""
    problem = HarmonicBalance(SpurPair(), 6)
    U = np.append(problem.start(1.5), 1.5)
    with pytest.raises(NoConvergence, match="no special point"):
        FoldProblem(problem, "Omega").located(U, {"Omega": 1.5}, NewtonSettings(max_iterations=1))
    assert HarmonicBalance(SpurPair(), 6, sampled=True).compiled_locator("Omega", {}, -1) is None
    assert problem.compiled_locator("zeta", {"Omega": 0.9}, -1) is None


def test_problems_without_a_compiled_loop():
    """Sampled laws and parameters other than Omega are traced by the general loop."""
    problem = HarmonicBalance(SpurPair(), 6)
    assert (
        problem.compiled_continuation("Omega", {"zeta": 0.06}) is not None
        and problem.compiled_continuation("zeta", {"Omega": 0.9}) is None
    )
    assert HarmonicBalance(SpurPair(), 6, sampled=True).compiled_continuation("Omega", {}) is None


def stride_of(problem, steps, X, step, bounds):
    """Return a stride from a solution towards larger Omega, with unit scales."""
    scale, normal = np.ones(len(X) + 1), np.append(0 * X, 1.0)
    row = point_from_solution(solve(problem, X, {"Omega": 0.5}, "Omega", NewtonSettings()), normal, scale)
    strider = Stepper(CurveEquations(problem, "Omega", {}), bounds, steps, NewtonSettings())
    return strider.stride([row], scale, 1.0, step, 128)


@pytest.mark.parametrize("kind", [GeneralLoop, HarmonicBalance])
def test_a_stride_ends_beyond_the_span(kind):
    problem = kind(Duffing(), 3)
    found = stride_of(problem, StepControl(), problem.start(0.5), 0.01, (0.4, 0.505))
    assert found.reason == "" and found.points[-1].value > 0.505
    assert all(row.value < 0.505 for row in found.points[:-1])


def test_a_stride_is_bounded():
    """A call computes at most 128 points, fewer for large problems, so that Ctrl-C is handled in time."""
    small, large = HarmonicBalance(Duffing(), 3), HarmonicBalance(Duffing(), 150)
    steps = StepControl(first_step=1e-4, max_step=1e-4)
    assert len(stride_of(small, steps, small.start(0.5), 1e-4, (0.4, 1.6)).points) == 128
    assert len(stride_of(large, steps, large.start(0.5), 1e-4, (0.4, 1.6)).points) < 32


@pytest.mark.parametrize("kind", [GeneralLoop, HarmonicBalance])
def test_why_the_shortest_step_failed(kind):
    """The message reports a turn of the tangent above its limit, or a residual after one Newton iteration."""
    problem = kind(Duffing(), 3)
    start, equal = problem.start(0.9), {"first_step": 0.04, "min_step": 0.04, "max_step": 0.04}
    for steps, settings, reason in (
        ({"max_turn_deg": 1e-3}, NewtonSettings(), "the tangent turned by"),
        ({"max_turn_deg": 60.0, "predictor_points": 1}, NewtonSettings(max_iterations=1), "relative residual of"),
    ):
        curve = trace(problem, "Omega", (0.9, 1.3), start, steps=StepControl(**equal | steps), settings=settings)
        assert curve.status is Status.STEP_TOO_SMALL and reason in curve.message
