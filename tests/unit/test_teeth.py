"""Mutation tests: each docstring names the mutants, which are changes of the program that the test must detect."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from machines import single_mass
from scipy.optimize import brentq

from hbgear import Cubic, Element, HarmonicBalance, Load, Point, SpurPair, Status, StepControl, System
from hbgear.continuation import FoldProblem
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.solvers.corrector import correct
from hbgear.continuation.solvers.newton import NewtonSettings, solve
from hbgear.continuation.tracing.jumps import find_jumps, nearest
from hbgear.continuation.tracing.state import TraceSettings
from hbgear.continuation.tracing.trace import Tracer, trace
from hbgear.harmonic.bifurcations.multiplier_events import NeimarkSackerEvent, PeriodDoublingEvent, refine_root
from hbgear.harmonic.structure.linear_structure import LinearStructure, UnbalancedLoadError
from hbgear.mechanics import PiecewiseLinear
from hbgear.mechanics.series.fourier import resize
from hbgear.time.exponential.kernels.periodicity import is_periodic


def point_at(x, **parameters):
    return Point(np.atleast_1d(np.array(x, dtype=float)), parameters, 0.0, 0, None, np.zeros(0, np.int8), np.nan, None)


# ---- continuation: jumps


class Stairs:
    """p = f(x), f' = x (x - 1) (x - 3) (x - 5): x is stable where f rises."""

    rise = np.poly([0.0, 1.0, 3.0, 5.0])
    f = np.polyint(rise)

    def __init__(self, sense=1.0):
        self.sense = sense

    def evaluate(self, X, p):
        x = self.sense * X[0]
        return np.array([np.polyval(self.f, x) - p]), np.array([[self.sense * np.polyval(self.rise, x)]])

    def observe(self, X, stability, p):
        return {"multipliers": np.exp([-0.01 * np.polyval(self.rise, self.sense * X[0]) + 0j])}


@pytest.mark.parametrize("sense", [1, -1])
def test_a_jump_lands_on_thenearest_stable_motion(sense):
    """Where x = 0 loses its stability, two other motions are stable. Mutant: `nearest_solution` takes the farthest."""
    curve = trace(Stairs(sense), "p", (-20.0, 20.0), point_at(-0.9 * sense, p=np.polyval(Stairs.f, -0.9)))
    assert [round(sense * point.X[0], 6) for point in curve.special if point.kind == "LP"] == [0, 1, 3, 5]
    jump = next(jump for jump in find_jumps(curve) if jump.label == "LP1")
    landings = [x.real for x in np.roots(Stairs.f) if abs(x.imag) < 1e-9 and x.real > 0.1]
    stable = sorted(x for x in landings if np.polyval(Stairs.rise, x) > 0)
    assert len(stable) == 2 and len(landings) == 3
    assert jump.direction == 1 and jump.value == pytest.approx(0.0, abs=1e-9)
    assert sense * jump.after.X[0] == pytest.approx(stable[0], abs=1e-7)


def test_a_jump_never_lands_on_an_unstable_motion():
    """The nearest stable motion is returned, or None. Mutant: `nearest_solution` ignores the stability."""
    found = [replace(point_at(x), multipliers=np.array([mu + 0j])) for x, mu in ((0.1, 1.5), (3.0, 0.5), (-2.0, 0.9))]
    assert nearest(point_at(0.0), found) is found[2]
    assert nearest(point_at(0.0), found[:1]) is None


# ---- continuation: borders


class Turning(ContinuationProblem):
    """A fold at p = s / 10 whose right null vector turns by the angle s: (y_1 - 1)^2 = p - s / 10, y_2 = 2, y = Q x."""

    size = 2

    def evaluate(self, X, p, s):
        Q = np.array([[np.cos(s), np.sin(s)], [-np.sin(s), np.cos(s)]])
        y = Q @ X
        return np.array([(y[0] - 1) ** 2 - p + s / 10, y[1] - 2]), np.diag([2 * (y[0] - 1), 1.0]) @ Q


def test_a_curve_that_goes_far_renews_its_borders():
    """Constant borders become orthogonal to the null vector after a quarter of a turn: g has a pole there and changes
    sign as at a branch point. Mutants: `based(..., renew=True)` returns itself; `Fold.renewed` returns the old base."""
    fold = FoldProblem(Turning(), "p")
    curve = trace(fold, "s", (0.0, 2 * np.pi), np.array([1.0, 2.0, 0.0]))
    assert curve.status is Status.REACHED_END and curve.special == ()
    np.testing.assert_allclose(curve.tracked["p"], curve.values / 10, rtol=0, atol=1e-9)


# ---- continuation: corrector and tracer


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_the_corrector_obeys_its_step_tolerance(tolerance):
    """At a triple root the residual is small long before the error, so the last step is also tested. Each iteration
    reduces the error by a third: the last step is half of the remaining error. Mutant: only the residual is tested."""

    class Flat:
        def evaluate(self, X, p):
            return np.array([(X[0] - 1) ** 3]), np.array([[3 * (X[0] - 1) ** 2]])

    settings = NewtonSettings(step_tolerance=tolerance, max_iterations=100)
    found = correct(CurveEquations(as_problem(Flat()), "p", {}), np.array([1.2, 0.0]), np.array([0.0, 1.0]), settings)
    error = found.solution.X[0] - 1
    assert 1.33 * tolerance < error < 2.001 * tolerance


def test_a_curve_closes_in_its_own_direction_only():
    """The same segment in the opposite direction also passes the first point, but does not close the curve.
    Mutant: `CurveEnds.closes` ignores the direction."""

    class Circle:
        def evaluate(self, X, p):
            return np.array([X[0] ** 2 + p**2 - 1]), np.array([[2 * X[0]]])

    start = point_at(0.8, p=0.6)
    settings = TraceSettings("p", None, StepControl(), NewtonSettings(), True, True, (), None, None)
    tracer = Tracer(as_problem(Circle()), settings, (-2.0, 2.0), start)
    assert tracer.run().status is Status.CLOSED
    last, first = tracer.state.points[-2], tracer.state.points[1]
    assert tracer.loop.ends.closes(last, first)

    def turned(row):
        return replace(row, tangent=-row.tangent, parameter_direction=-row.parameter_direction)

    assert not tracer.loop.ends.closes(turned(first), turned(last))


class Cusp:
    """x^3 - a x - (b - 1) / unit = 0: the folds are at a parameter b of any size."""

    def __init__(self, unit):
        self.unit = unit

    def evaluate(self, X, a, b):
        x, y = X
        return np.array([x**3 - a * x - b / self.unit + 1, y - x]), np.array([[3 * x * x - a, 0.0], [-1.0, 1.0]])


@pytest.mark.parametrize("unit", [1e-4, 1e4])
def test_the_unit_of_an_unknown_parameter_does_not_matter(unit):
    """A curve of folds with b as an unknown has the same points in every unit of b. Mutant: an unknown parameter is
    scaled like the other unknowns."""
    curves = []
    for size in (1.0, unit):
        x, a = 3**-0.5, 1.0
        start = np.array([x, x, size * (1 + x**3 - a * x)])
        curves.append(trace(FoldProblem(Cusp(size), "b"), "a", (1.0, -1.0), start, steps=StepControl(max_points=60)))
    one, other = curves
    assert len(one) == len(other) > 20 and one.status == other.status
    np.testing.assert_allclose(other.values, one.values, rtol=0, atol=1e-6)
    np.testing.assert_allclose(other.tracked["b"] / unit, one.tracked["b"], rtol=0, atol=1e-6)
    np.testing.assert_allclose((one.tracked["b"] - 1) ** 2, 4 * (one.values / 3) ** 3, rtol=0, atol=1e-9)


# ---- harmonic: events by multipliers


class Multipliers(ContinuationProblem):
    """x = p with multipliers that are given functions of p."""

    size = 1

    def __init__(self, *of):
        self.of = of

    def evaluate(self, X, p):
        return np.array([X[0] - p]), np.array([[1.0]])

    def observe(self, X, stability=True, **parameters):
        return {"multipliers": self.multipliers(X, **parameters)}

    def multipliers(self, X, points=None, max_step=None, *, p):
        return np.concatenate([np.atleast_1d(f(p)) for f in self.of]).astype(complex)

    smooth = False  # events are bracketed


def pair(p0, angle=1.0):
    """A complex pair that leaves the unit circle at p0."""
    return lambda p: np.exp(p - p0) * np.exp([1j * angle, -1j * angle])


def doubling(p0):
    """A real multiplier that passes -1 at p0."""
    return lambda p: -np.exp(p - p0)


def twice(p0):
    """Two equal real multipliers that pass +1 at p0."""
    return lambda p: np.exp(p - p0) * np.ones(2)


def inside(p):
    return 0.3


@pytest.mark.parametrize(
    ("of", "expected"),
    [
        ([pair(0.41), inside], {"NS": [0.41]}),
        ([pair(0.31), pair(0.63, 2.0)], {"NS": [0.31, 0.63]}),
        ([doubling(0.41), inside], {"PD": [0.41]}),
        ([doubling(0.401), pair(0.404)], {"PD": [0.401], "NS": [0.404]}),  # one step: three leave, one at PD
        ([lambda p: np.exp(p - 0.41), inside], {}),  # one passes +1 (a fold nearby), no pair
        ([lambda p: np.exp(p - 0.402), doubling(0.405)], {"PD": [0.405]}),  # two real ones leave, one at PD
        ([lambda p: pair(0.41)(0.82 - p), inside], {"NS": [0.41]}),  # a pair that returns
        ([pair(-0.7, 2.0), pair(0.41)], {"NS": [0.41]}),  # a second pair, while one is already outside
        ([pair(-0.7, 2.0), twice(0.41)], {"BP": [0.41]}),  # two at +1 by symmetry, and a pair outside
        ([lambda p: -twice(0.41)(p), pair(-0.7, 2.0)], {"PD": [0.41]}),  # two at -1
        ([doubling(0.401), lambda p: pair(0.404)(0.808 - p), pair(-0.7, 2.0)], {"PD": [0.401], "NS": [0.404]}),
    ],
)
@pytest.mark.parametrize("span", [(0.0, 1.0), (1.0, 0.0)])
def test_a_neimark_sacker_point_is_a_pair_that_nothing_else_explains(of, expected, span):
    """Mutants: three multipliers must pass; multipliers of a period doubling are subtracted twice; multipliers outside
    at both ends are counted as passing ones."""
    curve = trace(
        Multipliers(*of), "p", span, np.array([span[0]]), events=[NeimarkSackerEvent(), PeriodDoublingEvent()]
    )
    found = {}
    for point in curve.special:
        found.setdefault(point.kind, []).append(point.parameters["p"])
        assert point.located
    assert set(found) == set(expected)
    for kind, places in expected.items():
        np.testing.assert_allclose(sorted(found[kind]), places, rtol=0, atol=1e-8)


def meeting(p0, stiffness, modulus=0.985):
    """Return two complex pairs whose angles coincide at p0, where the coupling makes a bubble of their moduli."""

    def of(p):
        turn = 6.0 * (p - p0)
        mu = modulus * np.linalg.eigvals(
            np.exp(1j) * np.array([[np.exp(1j * turn), stiffness], [stiffness, np.exp(-1j * turn)]])
        )
        return np.concatenate([mu, mu.conj()])

    return of


@pytest.mark.parametrize("stiffness", [0.02, 0.04, 0.08])
@pytest.mark.parametrize("span", [(0.0, 0.8), (0.8, 0.0)])
def test_two_pairs_that_meet_between_two_points(stiffness, span):
    """Moduli leave the circle and return within one step, and are equal at all points of the curve."""
    of = meeting(0.41, stiffness)
    curve = trace(
        Multipliers(of, inside), "p", span, np.array([span[0]]), events=[NeimarkSackerEvent(), PeriodDoublingEvent()]
    )
    assert not np.any(np.abs(of(0.5)) > 1) and np.any(np.abs(of(0.41)) > 1)
    size = [brentq(lambda p: np.abs(of(p)).max() - 1, *sorted((0.41, end)), xtol=1e-12) for end in (0.3, 0.52)]
    assert [point.kind for point in curve.special] == ["NS", "NS"]
    np.testing.assert_allclose(sorted(p.parameters["p"] for p in curve.special), size, rtol=0, atol=1e-8)
    below = trace(
        Multipliers(meeting(0.41, stiffness, 0.9), inside),
        "p",
        span,
        np.array([span[0]]),
        events=[NeimarkSackerEvent(), PeriodDoublingEvent()],
    )
    assert below.special == ()


# ---- harmonic: Floquet multipliers


@pytest.mark.parametrize("nu", [2, 3])
def test_the_longest_floquet_step_is_a_share_of_the_excitation_period(nu):
    """Over nu periods the integration takes nu times as many equal steps: multipliers are powers within rounding, with
    the same error of the steps. Mutants: the step is a share of the basis period; the share is divided by nu^2."""
    base = HarmonicBalance(SpurPair(zeta=0.1, eps=(0.0,) * 5 + (0.4,), e=(0.02,)), 10)
    X, here = base.start(3.0), {"Omega": 3.0, "points": 3, "max_step": 100.0}
    wide = base.with_order(nu)
    mu, powers = (
        np.sort_complex(x)
        for x in (wide.multipliers(wide.from_layout(X, base.layout), **here), base.multipliers(X, **here) ** nu)
    )
    fine = np.sort_complex(base.multipliers(X, Omega=3.0, points=8, max_step=0.05) ** nu)
    np.testing.assert_allclose(mu, powers, rtol=0, atol=1e-12)
    assert np.abs(powers - fine).max() > 1e-9  # the steps cause a larger error, so other steps would be detected


# ---- harmonic: balanced loads and the truncation


def chain(stiff, load):
    """Return three free masses joined by a stiff and a soft spring; the element is parallel to the soft one."""
    K = np.array([[stiff, -stiff, 0.0], [-stiff, stiff + 1.0, -1.0], [0.0, -1.0, 1.0]])
    gap = Element([0.0, 1.0, -1.0], Cubic(1.0))
    return System(np.eye(3), None, K, [gap], Load(load))


@pytest.mark.parametrize("stiff", [1.0, 1e4, 1e9])
def test_balanced_and_unbalanced_loads(stiff):
    """The tolerance of the balance is the rounding error, about eps times the ratio of the stiffnesses. Mutants:
    `_BALANCED` is 1e-2, or 0; the rounding of the free motion is 0, or a million times larger."""
    LinearStructure(chain(stiff, [1.0, 1.0, -2.0]))
    LinearStructure(chain(stiff, [1 / 3, 1 / 3, -2 / 3]))
    LinearStructure(chain(stiff, [0.1, 0.2, -0.3]))
    LinearStructure(chain(stiff, [1 / 3, 1 / 3, -0.666666667]))  # given to nine digits
    tolerance = max(1e-7, 1e4 * np.finfo(float).eps * stiff)
    assert tolerance < 5e-3
    for sign in (1, -1):
        with pytest.raises(UnbalancedLoadError, match="the constant load does work"):
            LinearStructure(chain(stiff, [1.0, 1.0, -2.0 + sign * tolerance]))


@pytest.mark.parametrize("law", [Cubic(1e-3), PiecewiseLinear((0.3,), (0.0, 1e-3))], ids=["sampled", "exact"])
def test_the_truncation_estimate_is_the_error_of_a_weak_law(law):
    """The feedback of a weak law is negligible: the response to harmonics H+1..2H of its force is the error, up to the
    share of the law in the stiffness. Mutant: the estimate times or over sqrt 2 (mean square of a cosine omitted)."""
    system = single_mass(law, F=1.0, mean=0.2)
    H, Omega = 2, 0.7
    coarse, fine = HarmonicBalance(system, H), HarmonicBalance(system, 2 * H)
    X = solve(coarse, coarse.start(Omega), {"Omega": Omega}, settings=NewtonSettings(tolerance=1e-13)).X
    x = solve(fine, resize(X, 2 * H), {"Omega": Omega}, settings=NewtonSettings(tolerance=1e-13)).X
    difference = x - resize(X, 2 * H)
    error = np.sqrt(0.5 * np.sum(difference[1:] ** 2))
    assert error > 1e-6
    assert coarse.truncation(X, Omega=Omega) == pytest.approx(error, rel=0.02)


# ---- time domain


@pytest.mark.parametrize("k", [1, 2, 3, 5])
@pytest.mark.parametrize("rho", [0.9, 0.99])
def test_remaining_decay_of_a_motion_of_several_periods(k, rho):
    """x_p of period k plus a part that decays like rho^p: D_k / (1 - rho^k) is the size of this part k periods earlier,
    and the largest D_k is at the start of the window. Mutant: 1 - rho instead of 1 - rho^k."""
    periods, window, last = 6, 8, 400
    p = np.arange(last - 2 * window - periods, last + 1)
    x = np.exp(2j * np.pi * (p % k) / k) + 1e-3 * rho ** (p - float(last))
    past = np.zeros((len(p), 1, 2))
    past[(p - 1) % len(p), 0] = np.column_stack([x.real, x.imag])
    period, left, guess = is_periodic(past, last, periods, window, np.ones((1, 2)), np.ones(1), 1e-12)
    assert period[0] == 0 and guess[0] == k
    assert left[0] == pytest.approx(1e-3 * rho ** -(window - 1 + k), rel=1e-8)


def test_a_root_on_a_segment_of_zero_length_is_not_refined():
    """Two points of a curve may coincide; the admissible shift must not be divided by the length zero."""
    rough = SimpleNamespace(located=True)
    assert refine_root(SimpleNamespace(length=0.0), rough, None) is rough
