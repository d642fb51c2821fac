"""Properties that hold for any input, tried on many: hypothesis draws the cases, the same ones in every run of one
version of hypothesis on the same imported modules (it collects constants from them)."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import Phase, assume, example, given, settings
from hypothesis import strategies as st
from machines import single_mass
from scipy.integrate import quad
from scipy.optimize import brentq
from unit.test_branch import make, same
from unit.test_contact import crossed

import hbgear as hb
from hbgear.common.ranges import Range, checked
from hbgear.continuation.solvers.newton import solve
from hbgear.io.branches.npz import load
from hbgear.mechanics.models import System
from hbgear.mechanics.series.fourier import evaluate, resize, stretch, to_complex, to_real
from hbgear.mechanics.series.real_basis import after_derivative, derivative, one_sided

EPS = np.finfo(float).eps


_PHASES = [Phase.explicit, Phase.generate]


def few(count):
    """The same cases in every run, no clock; one that fails is shown as it was drawn, for shrinking takes minutes."""
    return settings(max_examples=count, derandomize=True, deadline=None, database=None, phases=_PHASES)


coefficient = st.floats(-2.0, 2.0, allow_subnormal=False).map(lambda x: round(x, 6))


@st.composite
def waves(draw, most=6, least=1):
    """Real coefficients (2H + 1,) of a function with its first harmonic."""
    H = draw(st.integers(least, most))
    row = np.array(draw(st.lists(coefficient, min_size=2 * H + 1, max_size=2 * H + 1)))
    row[1] += math.copysign(0.3, row[1])
    return row


@st.composite
def stiffnesses(draw):
    """A periodic factor of mean about one."""
    pair = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
    return hb.mechanics.Series(1.0, draw(pair), draw(pair))


@st.composite
def laws(draw):
    """A continuous piecewise-linear law with one to three corners that lie apart, and a periodic stiffness."""
    count = draw(st.integers(1, 3))
    first, gaps = draw(st.floats(-1.5, 0.5)), draw(st.lists(st.floats(0.2, 1.0), min_size=count, max_size=count))
    slopes = draw(st.lists(st.floats(-1.0, 3.0), min_size=count + 1, max_size=count + 1))
    corners = tuple(first + np.cumsum([0.0, *gaps[1:]]))
    return hb.mechanics.PiecewiseLinear(corners, tuple(slopes), draw(st.floats(-1.0, 1.0)), draw(stiffnesses()))


def plain(row):
    """The function of one number, by the definition of its coefficients."""
    H = len(row) // 2

    def value(t):
        return row[0] + sum(row[2 * k - 1] * math.cos(k * t) + row[2 * k] * math.sin(k * t) for k in range(1, H + 1))

    row = row.tolist()
    return value


def roots(row, level):
    """Places where a function crosses a level, by brackets on a grid that misses no wave."""
    grid = np.linspace(0, 2 * np.pi, 1501)
    x = evaluate(row, grid) - level
    ends = np.array([evaluate(row, t)[0] - level for t in grid])  # one by one, as the brackets are looked at
    cells = np.flatnonzero((ends[:-1] > 0) != (ends[1:] > 0))  # a root may lie on the grid
    return [brentq(lambda t: evaluate(row, t)[0] - level, grid[i], grid[i + 1], xtol=1e-15) for i in cells], x


# ---- exact contact


def by_hand(law):
    """g(d) as the integral of its slopes from zero, of one number."""
    ends = [-math.inf, *law.corners, math.inf]

    def g(d):
        pieces = zip(law.slopes, ends, ends[1:], strict=False)
        return law.force_at_zero + sum(s * (min(max(d, a), b) - min(max(0.0, a), b)) for s, a, b in pieces)

    return g


@few(15)
@given(laws(), waves(4), st.sampled_from([1, 2]))
@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
def test_the_exact_projection_is_the_integral_of_the_force(law, row, nu):
    """f_k = (1 / pi) int p(d, nu theta) exp(-i k theta) dtheta by adaptive quadrature between the corners. An error of
    a corner's instant enters squared, so the tolerance is rounding of the terms of the sum."""
    H = len(row) // 2
    cuts = [0.0, 2 * np.pi, *np.linspace(0, 2 * np.pi, 7)[1:-1]]
    for corner in law.corners:
        found, x = roots(row, corner)
        assume(np.abs(x).min() > 1e-6)
        cuts += found
    cuts = sorted(cuts)
    assume(nu <= H)  # Omega itself is to be among the harmonics of Omega / nu
    problem = hb.HarmonicBalance(single_mass(law), H, nu=nu)
    # orders are selected if the stiffness varies above the order H only, and may be as many: 0 and 2 for H = 1
    assume(problem.orders.tolist() == list(range(H + 1)))
    f = problem.force_rows(row, Omega=1.0)[0]
    g, d, stiffness = by_hand(law), plain(row), plain(law.stiffness.row())
    size = max(map(abs, law.slopes)) * (np.abs(row).sum() + max(map(abs, law.corners))) + abs(law.force_at_zero) + 1
    tolerance = 50 * EPS * (1 + 2 * H) * size
    for place in range(len(row)):
        k, wave = (place + 1) // 2, math.cos if place % 2 else math.sin
        if place == 0:
            wave = math.cos

        def integrand(t, k=k, wave=wave):
            return stiffness(nu * t) * g(d(t)) * wave(k * t)

        parts = [quad(integrand, a, b, epsabs=1e-13, epsrel=1e-12)[0] for a, b in pairwise(cuts)]
        expected = (1.0 if k else 0.5) * math.fsum(parts) / np.pi
        assert f[place] == pytest.approx(expected, rel=0, abs=tolerance)
        assert f[place] + 10 * tolerance != pytest.approx(expected, rel=0, abs=tolerance)


@pytest.mark.slow
@few(60)
@given(waves(8), st.floats(-1.5, 1.5))
@example(np.array([0.0, 0.3, 1.125492, 1.125492, 0.0]), 0.0)  # a root at pi / 2, and on the grid
@example(np.array([-1.78169, -2.08169, 0.0, -1.78169, 1.14332]), 0.0)  # a second root in the cell that ends at pi / 2
@example(np.array([-1.78169, -2.08169, 0.0, -1.78169, 1.14332]), -1e-58)  # a sample within rounding on the other side
@example(np.array([1.78169, 2.08169, 0.0, 1.78169, 1.14332]), 0.0)  # the same, with a minimum
@example(np.array([1.78169, 2.08169, 0.0, 1.78169, 1.14332]), -1e-58)
def test_crossings_are_all_roots(row, level):
    """As many as a fine sampling finds, at the same places: as near as rounding of the value over its slope."""
    expected, x = roots(row, level)
    H = len(row) // 2
    turns = np.flatnonzero((np.diff(x)[1:] > 0) != (np.diff(x)[:-1] > 0)) + 1
    assume(np.abs(x[turns]).min(initial=1.0) > 1e-4 and abs(x[0]) > 1e-6)  # not grazing between two samples
    found, sign = crossed(row, level, max(64, 8 * H))
    assert len(found) == len(expected)
    np.testing.assert_array_equal(sign, [np.sign(evaluate(row, t, 1)[0]) for t in expected])
    for theta, root in zip(found, expected, strict=True):
        tolerance = 20 * EPS * (2 * np.pi + (np.abs(row).sum() + abs(level)) * (1 + H) / abs(evaluate(row, root, 1)[0]))
        assert theta == pytest.approx(root, rel=0, abs=tolerance)
        assert not abs(theta + 10 * tolerance - root) <= tolerance


# ---- coefficients


@few(50)
@given(waves(), st.integers(1, 4), st.integers(0, 8), st.floats(-7.0, 7.0))
def test_algebra_of_coefficients(row, nu, H, theta):
    """Complex and real forms, derivatives, longer and shorter rows, and the same function over nu periods."""
    own, size = len(row) // 2, np.abs(row).sum() + 1
    np.testing.assert_array_equal(to_real(to_complex(row)), row)
    phases, h = np.array([theta]), 1e-4
    near = evaluate(row, np.array([theta + h, theta - h]))
    k = np.repeat(np.arange(own + 1), 2)[1:]
    third = (k**3 * np.abs(row)).sum()
    slope = evaluate(derivative(row), phases)[0]
    assert slope == pytest.approx((near[0] - near[1]) / (2 * h), abs=h * h * third + 100 * EPS * own * size / h)
    np.testing.assert_allclose(evaluate(row, phases, 1), slope, rtol=0, atol=40 * EPS * own**2 * size)
    np.testing.assert_array_equal(resize(resize(row, own + H), own), row)
    np.testing.assert_array_equal(resize(row, H)[: 2 * min(H, own) + 1], row[: 2 * min(H, own) + 1])
    wide = stretch(row, nu)
    assert len(wide) == 2 * nu * own + 1
    tolerance = 100 * EPS * (1 + abs(theta)) * nu * own * size
    np.testing.assert_allclose(evaluate(wide, phases), evaluate(row, nu * phases), rtol=0, atol=tolerance)
    np.testing.assert_allclose(derivative(wide), nu * stretch(derivative(row), nu), rtol=1e-15, atol=0)
    A = np.arange(row.size**2, dtype=float).reshape(row.size, -1) / row.size
    tolerance = 40 * EPS * own * size * row.size**2
    np.testing.assert_allclose(after_derivative(A) @ row, A @ derivative(row), rtol=0, atol=tolerance)
    c = to_complex(row)
    two_sided = np.concatenate([c[:1], c[1:] / 2])
    np.testing.assert_array_equal(one_sided(two_sided), c)


@few(40)
@given(stiffnesses(), st.floats(-7.0, 7.0), st.floats(-7.0, 7.0), st.floats(-3.0, 3.0))
def test_algebra_of_series(series, phase, tau, factor):
    """A delay, there and back; a factor; values."""
    tolerance = 100 * EPS * (1 + abs(tau) + abs(phase))
    late = series.shifted(phase)
    assert float(late(tau)) == pytest.approx(float(series(tau - phase)), rel=0, abs=tolerance)
    np.testing.assert_allclose(late.shifted(-phase).row(), series.row(), rtol=0, atol=tolerance)
    np.testing.assert_allclose(series.scaled(factor).row(), factor * series.row(), rtol=4 * EPS, atol=0)
    expected = 1.0 + sum(
        a * math.cos(k * tau) + b * math.sin(k * tau)
        for k, (a, b) in enumerate(zip(series.cosine, series.sine, strict=True), 1)
    )
    assert float(series(tau)) == pytest.approx(expected, rel=0, abs=tolerance)
    if factor:
        assert abs(float(series.shifted(phase + 1e-3)(tau)) - float(late(tau))) <= 1e-3 * 2 * 0.3 * 3


# ---- files


finite = st.floats(-1e100, 1e100)  # beyond it a file is refused


@pytest.mark.slow
@few(12)
@given(st.data(), st.integers(1, 3), st.integers(1, 5))
def test_a_saved_branch_comes_back_bit_for_bit(tmp_path_factory, data, nu, H):
    """Any finite floats, subnormal and negative zero included, estimates that are not known; texts of any script."""
    one = make(nu, H)
    X = one.X.copy()
    X[0, :4] = data.draw(st.lists(finite, min_size=4, max_size=4))
    fixed = data.draw(st.dictionaries(st.text(min_size=1, max_size=8), finite, max_size=3))
    text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
    error = data.draw(st.sampled_from([X[:, 0], np.full(len(X), np.nan), np.full(len(X), -0.0)]))
    one = replace(one, X=X, fixed=fixed, message=data.draw(text), error=error)
    path = tmp_path_factory.mktemp("round") / "branch.npz"
    one.save(path)
    again = load(path)
    assert same(one, again)
    X = X.copy()
    X[0, 0] = np.nextafter(X[0, 0], 0.0) if X[0, 0] else -X[0, 0]
    assert not same(replace(one, X=X), again)


# ---- the same machine written in another way


def machine(seed=0):
    """Three masses, a gap between two of them and a stop on the third, loads on all."""
    gap = hb.Element([1.0, -1.0, 0.0], hb.Backlash(0.3), hb.mechanics.Series(0.0, (0.05,)), 0.05, name="gap")
    stop = hb.Element([0.0, 0.3, 1.0], hb.Unilateral(2.0, 0.1), name="stop")
    K = np.array([[1.5, -0.4, 0.0], [-0.4, 1.2, -0.3], [0.0, -0.3, 0.9]])
    return hb.System(
        np.diag([1.0, 1.5, 0.8]),
        0.1 * K + 0.05 * np.eye(3),
        K,
        [gap, stop],
        hb.Load([0.5, -0.2, 0.1], {1: [0.2, 0.0, 0.1]}, {2: [0.0, 0.05, 0.0]}),
    )


def solution(problem, X, Omega):
    """To rounding, and the error of it that the residual leaves open."""
    tight = hb.NewtonSettings(tolerance=1e-13)
    now = solve(problem, X, {"Omega": Omega}, settings=tight)
    inverse = np.linalg.norm(np.linalg.inv(now.evaluation.dR_dX), 2)
    return now.X, 2 * inverse * now.evaluation.size * max(now.residual, 64 * EPS)


BASE = hb.HarmonicBalance(machine(), 5)
MOTIONS = {Omega: solution(BASE, BASE.start(Omega), Omega) for Omega in (0.6, 1.3, 2.1)}


@few(10)
@given(st.permutations(range(3)), st.booleans(), st.sampled_from(sorted(MOTIONS)))
def test_order_of_coordinates_and_elements(order, exchanged, Omega):
    system, p = machine(), list(order)
    (load,), which = system.load, [1, 0] if exchanged else [0, 1]
    elements = [replace(system.elements[j], direction=system.elements[j].direction[p]) for j in which]
    take = lambda vectors: {k: np.asarray(v)[p] for k, v in vectors.items()}  # noqa: E731
    mixed = System(
        system.M[np.ix_(p, p)],
        system.C[np.ix_(p, p)],
        system.K[np.ix_(p, p)],
        elements,
        hb.Load(np.asarray(load.constant)[p], take(load.cosine), take(load.sine)),
    )
    X, error = MOTIONS[Omega]
    problem = hb.HarmonicBalance(mixed, 5)
    start = 1.001 * X.reshape(2, -1)[which].ravel()
    Y, other = solution(problem, start, Omega)
    np.testing.assert_allclose(Y.reshape(2, -1)[which].ravel(), X, rtol=0, atol=error + other)
    assert np.abs(start.reshape(2, -1)[which].ravel() - X).max() > 10 * (error + other)
    mu, nu = (np.sort_complex(P.multipliers(Z, Omega=Omega)) for P, Z in ((problem, Y), (BASE, X)))
    np.testing.assert_allclose(mu, nu, rtol=0, atol=1e-9)


@few(10)
@given(st.floats(1e-4, 1e4), st.floats(1e-4, 1e4), st.sampled_from(sorted(MOTIONS)))
def test_units_of_time_and_length(clock, length, Omega):
    """Seconds or milliseconds, metres or micrometres: t' = clock t, q' = length q, forces with q."""
    system = machine()
    (load,) = system.load

    def longer(law):
        return replace(law, corners=tuple(length * x for x in law.corners), force_at_zero=length * law.force_at_zero)

    elements = [
        replace(e, law=longer(e.law), displacement=e.displacement.scaled(length), damping=e.damping * clock)
        for e in system.elements
    ]
    times = lambda vectors: {k: length * np.asarray(v) for k, v in vectors.items()}  # noqa: E731
    scaled = System(
        system.M * clock**2,
        system.C * clock,
        system.K,
        elements,
        hb.Load(length * np.asarray(load.constant), times(load.cosine), times(load.sine)),
    )
    X, error = MOTIONS[Omega]
    problem = hb.HarmonicBalance(scaled, 5)
    Y, other = solution(problem, 1.001 * length * X, Omega / clock)
    tolerance = error + other / length
    np.testing.assert_allclose(Y / length, X, rtol=0, atol=tolerance)
    assert np.abs(1e-3 * X).max() > 10 * tolerance
    mu, nu = (np.sort_complex(P.multipliers(Z, Omega=w)) for P, Z, w in ((problem, Y, Omega / clock), (BASE, X, Omega)))
    np.testing.assert_allclose(mu, nu, rtol=0, atol=1e-9)


@few(4)
@given(st.floats(0.03, 0.08), st.floats(0.08, 0.15), st.floats(0.0, 0.15))
def test_special_points_do_not_know_the_sense_of_the_span(zeta, error, eps):
    """Located to rounding on the way up and on the way down: the same kinds at the same places."""
    problem = hb.HarmonicBalance(hb.SpurPair(zeta=zeta, e=(error,), eps=(eps,)), 6)
    up, down = (hb.trace(problem, "Omega", span, stability=False) for span in ((0.45, 1.4), (1.4, 0.45)))
    assume(up.status == "reached_end")  # where error and eps cancel, the start of a span may lie on another curve
    assert down.status == "reached_end"
    one, other = (sorted((p.kind, p.parameters["Omega"]) for p in curve.special) for curve in (up, down))
    assert [kind for kind, _ in one] == [kind for kind, _ in other]
    places = np.array([place for _, place in one])
    np.testing.assert_allclose([place for _, place in other], places, rtol=0, atol=1e-8)


# ---- checks


@few(80)
@given(st.floats(allow_nan=False), st.floats(-10, 10), st.floats(-10, 10), st.booleans(), st.booleans())
def test_ranges(value, a, b, open_low, open_high):
    """In the range or refused, and clipped into it from inside; nan and infinity never pass."""
    assume(b - a > 1e-3)
    low, high = {"above" if open_low else "low": a}, {"below" if open_high else "high": b}
    allowed = Range(**low, **high)
    inside = (value > a if open_low else value >= a) and (value < b if open_high else value <= b)
    assert (value in allowed) == inside
    assert (a in allowed) == (not open_low) and (b in allowed) == (not open_high)
    assert math.nan not in allowed
    middle = 0.5 * (a + b)
    clipped = allowed.clipped(value, middle)
    assert clipped in allowed
    assert clipped == value if inside else abs(clipped - value) > 0
    if inside:
        checked("Owner", "x", value, allowed)
    else:
        with pytest.raises(ValueError, match=r"Owner: x = .* must"):
            checked("Owner", "x", value, allowed)
    for wrong in (math.nan, math.inf, -math.inf, True, "1", None, 1j):
        with pytest.raises(ValueError, match=r"Owner: x = .* must be a finite number"):
            checked("Owner", "x", wrong)
