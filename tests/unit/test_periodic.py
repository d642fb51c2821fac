"""Periodic functions with corners: values, harmonics, and what is refused."""

import json
from itertools import pairwise

import numpy as np
import pytest

import hbgear as hb
from hbgear.harmonic.models.model_registry import rebuild_model
from hbgear.mechanics.models import describe
from hbgear.mechanics.series.fourier import Series, evaluate, to_real
from hbgear.mechanics.series.periodic import described, undescribed
from hbgear.mechanics.series.piecewise_polynomial import TURN, PiecewisePolynomial, equal_parts

RNG = np.random.default_rng(7)
PHASE = np.sort(RNG.uniform(0, 1, 9))
VALUES = RNG.normal(size=9)
FUNCTIONS = {
    "rectangular": hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.3, start=5.5),
    "trapezoidal": hb.mechanics.Periodic.trapezoidal(1.0, -0.5, 0.3, 0.2, start=6.0),
    "triangular": hb.mechanics.Periodic.trapezoidal(1.0, 0.0, 0.0, 0.5),
    "linear": hb.mechanics.Periodic.table(PHASE, VALUES, period=1),
    "cubic": hb.mechanics.Periodic.table(PHASE, VALUES, period=1, kind="cubic"),
    "saw": hb.mechanics.Periodic((2.0,), ((1.0, -0.3, 0.05, -0.002),)),
    "fine": hb.mechanics.Periodic.table(np.arange(300) / 300, RNG.normal(size=300), period=1, kind="cubic"),
}


def value_of(piece: PiecewisePolynomial, theta: np.ndarray) -> np.ndarray:
    i = np.searchsorted(piece.at, theta, side="right") - 1
    return np.array([np.polyval(piece.rows[k][::-1], x - piece.at[k]) for k, x in zip(i, theta, strict=True)])


def by_quadrature(f, H: int) -> np.ndarray:
    """Harmonics by a Gauss rule of 250 points between corners, exact to rounding for H up to 60."""
    ends = np.unique([0.0, *(x % TURN for x in f.phases), TURN])
    x, w = np.polynomial.legendre.leggauss(250)
    c = np.zeros(H + 1, dtype=complex)
    for a, b in pairwise(ends):
        theta = (a + b) / 2 + (b - a) / 2 * x
        c += np.exp(-1j * np.outer(np.arange(H + 1), theta)) @ (f(theta) * w) * (b - a) / 2 / np.pi
    c[0] /= 2
    return to_real(c)


@pytest.mark.parametrize("f", FUNCTIONS.values(), ids=FUNCTIONS)
def test_harmonics_are_exact(f):
    np.testing.assert_allclose(f.row(60), by_quadrature(f, 60), rtol=0, atol=2e-13 * f.bound)
    assert f.mean == pytest.approx(f.row(0)[0], abs=1e-14)


def test_high_harmonics_are_those_of_the_closed_form():
    """c_k of a square wave of share 1/2 from -pi/2: 2 sin(k pi / 2) / (pi k), however high."""
    square, k = hb.mechanics.Periodic.rectangular(1.0, 0.0, 0.5, start=-np.pi / 2), np.arange(1, 5001)
    row = square.row(5000)
    np.testing.assert_allclose(row[1::2], 2 * np.sin(k * np.pi / 2) / (np.pi * k), rtol=0, atol=1e-15)
    np.testing.assert_allclose(row[2::2], 0, atol=1e-15)


def test_usual_functions_have_their_values():
    tau = np.array([0.0, 0.1, 0.2, 0.3, 0.45, 0.55, 0.8, 0.99]) * TURN
    k = hb.mechanics.Periodic.rectangular(high=2.0, low=1.0, share=0.25, start=0.15 * TURN)
    assert k(tau).tolist() == [1, 1, 2, 2, 1, 1, 1, 1] and k(np.array(-0.8 * TURN)) == 2
    e = hb.mechanics.Periodic.trapezoidal(high=1.0, low=0.0, share=0.3, ramp=0.2)
    np.testing.assert_allclose(e(tau), [0, 0.5, 1, 1, 1, 0.75, 0, 0], atol=1e-14)
    np.testing.assert_allclose(e(tau, 1) * TURN, [5, 5, 0, 0, 0, -5, 0, 0], atol=1e-13)
    table = hb.mechanics.Periodic.table([0, 90, 180, 360], [0.0, 1.0, 3.0, 0.0], period=360)
    np.testing.assert_allclose(table(tau), [0, 0.4, 0.8, 1.4, 2.6, 2.7, 1.2, 0.06], atol=1e-14)
    assert table.corners == pytest.approx([0, TURN / 4, TURN / 2])


def test_a_spline_is_smooth_and_goes_through_its_values():
    f = FUNCTIONS["cubic"]
    np.testing.assert_allclose(f(TURN * PHASE), VALUES, atol=1e-13)
    for order in range(3):
        before, after = (f(TURN * PHASE + step, order) for step in (-1e-13, 1e-13))
        assert np.abs(after - before).max() < 1e-9 * np.abs(after).max()
    assert len(f.corners) == len(PHASE) and f.continuous  # the third derivative jumps
    wave = hb.mechanics.Periodic.table(
        np.arange(200) / 200, np.cos(TURN * np.arange(200) / 200), period=1, kind="cubic"
    )
    tau = np.linspace(0, TURN, 999)
    assert np.abs(wave(tau) - np.cos(tau)).max() < 1e-8


@pytest.mark.parametrize("f", FUNCTIONS.values(), ids=FUNCTIONS)
def test_others_are_made_of_it(f):
    tau = RNG.uniform(-10, 10, 40)
    np.testing.assert_allclose(f.shifted(1.3)(tau), f(tau - 1.3), atol=1e-10 * f.bound)
    np.testing.assert_allclose(f.reversed()(tau), f(-tau), atol=1e-10 * f.bound)
    np.testing.assert_allclose(f.scaled(-2.0)(tau), -2 * f(tau), atol=1e-12 * f.bound)
    np.testing.assert_allclose(f.varied(0.5)(tau), f.mean + 0.5 * (f(tau) - f.mean), atol=1e-12 * f.bound)
    assert f.varied(0.0) == Series(f.mean) and f.scaled(0.0) == Series()
    low, high = f.extremes()
    samples = f(np.linspace(0, TURN, 20001))
    assert low <= samples.min() <= low + 1e-3 * f.bound and high >= samples.max() >= high - 1e-3 * f.bound
    assert undescribed(json.loads(json.dumps(described(f)))) == f


@pytest.mark.parametrize("nu", [1, 2, 3])
@pytest.mark.parametrize("f", FUNCTIONS.values(), ids=FUNCTIONS)
def test_pieces_over_several_periods(f, nu):
    theta, g = RNG.uniform(0, TURN, 50), FUNCTIONS["linear"]
    piece, other = f.pieces(nu), g.pieces(nu)
    assert piece.at[0] == 0 and (np.diff(piece.at) > 0).all() and piece.at[-1] < TURN
    np.testing.assert_allclose(value_of(piece, theta), f(nu * theta), atol=1e-10 * f.bound)
    product = piece.times(other)
    np.testing.assert_allclose(value_of(product, theta), f(nu * theta) * g(nu * theta), atol=1e-10 * f.bound)
    whole = product.integrals(20)[-1]
    x, w = np.polynomial.legendre.leggauss(40)
    sums, ends = np.zeros(20, dtype=complex), np.append(product.at, TURN)
    for a, b in pairwise(ends):
        here = (a + b) / 2 + (b - a) / 2 * x
        sums += np.exp(-1j * np.outer(np.arange(20), here)) @ (f(nu * here) * g(nu * here) * w) * (b - a) / 2
    np.testing.assert_allclose(whole, sums, atol=1e-10 * f.bound)


@pytest.mark.parametrize("f", FUNCTIONS.values(), ids=FUNCTIONS)
def test_equal_parts_of_the_period(f):
    """Two functions that repeat 6 and 4 times repeat together twice; one jump more, and they do not repeat."""
    theta, pieces = RNG.uniform(0, TURN, 50), f.pieces(6)
    (divided,), parts = equal_parts([pieces])
    assert parts == 6 and len(divided.at) % 6 == 0
    np.testing.assert_allclose(value_of(divided, theta), f(6 * theta), atol=1e-10 * f.bound)
    both = pieces.times(FUNCTIONS["linear"].pieces(4))
    assert (
        equal_parts([both])[1] == equal_parts([pieces.on(both.at), FUNCTIONS["linear"].pieces(4).on(both.at)])[1] == 2
    )
    changed = PiecewisePolynomial(
        pieces.at, pieces.rows * np.where(np.arange(len(pieces.at))[:, None] == 1, 1 + 1e-9, 1.0)
    )
    assert equal_parts([changed])[1] == 1


def test_text_of_a_function_is_short():
    table = hb.mechanics.Periodic.table(np.arange(160), np.sin(np.arange(160) * TURN / 160) + 1.5, period=160)
    assert repr(table) == "<Periodic: 160 segments, mean 1.5>"
    pair = hb.GearPair(*(hb.gears.Gear(z, "3 mm", "20 mm") for z in (25, 40)), backlash="80 um")
    assert len(repr(pair.model("200 N m", 0.04))) < 500 and len(repr(pair.mesh("200 N m"))) < 300


def test_series_have_the_same_questions():
    s = hb.mechanics.Series(1.0, (0.3, 0.0), (0.0, 0.2))
    tau = np.linspace(0, 6, 7)
    np.testing.assert_allclose(s(tau, 1), evaluate(s.row(), tau, 1), atol=1e-15)
    np.testing.assert_allclose(s.varied(2.0)(tau), 1 + 2 * (s(tau) - 1), atol=1e-15)
    low, high = s.extremes()
    assert s.varies and not hb.mechanics.Series(1.0).varies and s.corners == () and s.bound == 1.5
    assert low == pytest.approx(s(np.linspace(0, TURN, 9999)).min(), abs=1e-7) and high <= s.bound


Table = hb.mechanics.Periodic.table


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: Table([0, 1, 0.5], [1, 2, 3]), "phases must ascend, but after 1 comes 0.5; sort the table"),
        (lambda: Table([0, 1, 1], [1, 2, 3]), "after 1 comes 1; sort the table and keep one value for each phase"),
        (
            lambda: Table([0, 180, 360], [1.0, 2.0, 1.5], period=360),
            "not periodic: the value one period after the first, 1",
        ),
        (lambda: Table([0, 180, 400], [1.0, 2.0, 1.5], period=360), "from 0 to 400 are more than the period 360"),
        (lambda: Table([0.0], [1.0]), "1 values in a period; linear interpolation needs at least 2"),
        (lambda: Table([0, 1], [1, 2], kind="cubic"), "cubic interpolation needs at least 3"),
        (lambda: Table([0, 1], [1, 2], kind="spline"), "kind = 'spline' must be 'linear' or 'cubic'"),
        (lambda: Table([0, 1], [1, 1]), "all values are 1, a constant; give a number"),
        (lambda: Table([0, 1], [1, np.nan]), "need as many finite values as phases"),
        (lambda: Table([0, 1, 2], [1, 2]), "3 phases and 2 values"),
        (lambda: Table([0, 1], [1, "2 um"]), "values = .* must be a sequence of numbers"),
        (lambda: Table(np.arange(3000), np.arange(3000), period=3000), "3,000 is more than 2,000"),
        (lambda: hb.mechanics.Periodic.rectangular(1.2, 0.8, 1.6), "share = 1.6 must lie between 0 and 1"),
        (lambda: hb.mechanics.Periodic.rectangular(1.0, 1.0, 0.6), "high = low = 1 is constant"),
        (lambda: hb.mechanics.Periodic.trapezoidal(1.2, 0.8, 0.6, 0.3), "share . 2 ramp = 1.2 is more than the period"),
        (lambda: hb.mechanics.Periodic((0.0, 1.0), ((1.0,), (1.0,))), "is constant, without a breakpoint"),
        (
            lambda: hb.mechanics.Periodic((0.0, 7.0), ((1.0,), (2.0,))),
            "phases from 0 to 7 are more than the period 6.28319",
        ),
        (lambda: hb.mechanics.Periodic((0.0,), ((1.0, 2.0, 3.0, 4.0, 5.0),)), "must be 1 to 4 finite numbers"),
        (lambda: hb.mechanics.Periodic((0.0, 1.0), ((1.0,),)), "must be a row of numbers for each of the phases"),
        (lambda: hb.mechanics.Periodic((0.0, 1.0), np.ma.masked), "must be a row of numbers for each of the phases"),
        (
            lambda: hb.Backlash(stiffness=hb.mechanics.Periodic.rectangular(1.0, 0.0, 0.5)),
            "has the minimum 0; teeth in contact",
        ),
        (lambda: hb.SpurPair(stiffness=Table([0, 3], [1.0, -0.2])), "SpurPair: the stiffness has the minimum -0.2"),
        (
            lambda: hb.SpurPair(eps=(0.1,), stiffness=hb.mechanics.Series(1.0)),
            "eps = .* and a stiffness are both given",
        ),
        (
            lambda: hb.SpurPair(error=hb.mechanics.Periodic.rectangular(0.1, 0.0, 0.5)).system(),
            "displacement jumps at tau = 0",
        ),
        (lambda: hb.Unilateral(stiffness=1.0), "stiffness = 1.0 must be a Series such as .* or a Periodic such as"),
        (lambda: undescribed({"function": "Periodic", "phases": [0.0]}), "described as a Series or a Periodic"),
        (lambda: undescribed({"function": "os.system"}), "described as a Series or a Periodic"),
    ],
)
def test_implausible_input_is_refused(make, said):
    with pytest.raises(ValueError, match=said):
        make()


@pytest.mark.parametrize(
    "cls", [hb.SpurPair, hb.gears.GearRotorBearing, hb.gears.HelicalPair, hb.gears.DoubleHelicalPair]
)
def test_gear_models_take_functions(cls):
    k, e = FUNCTIONS["rectangular"], hb.mechanics.Periodic.table([0, 1, 2], [0.0, 0.03, 0.01])
    pair = cls(eps=(), stiffness=k, error=e, eps_scale=0.5, e_scale=2.0)
    gap = pair.system().elements[0]
    tau = RNG.uniform(0, TURN, 30)
    sign = -1 if cls is hb.gears.DoubleHelicalPair else 1
    factor = gap.law.slopes[-1]  # both sides of the backlash
    np.testing.assert_allclose(factor * gap.law.stiffness(tau), k.mean + 0.5 * (k(tau) - k.mean), atol=1e-13)
    np.testing.assert_allclose(gap.displacement(tau), 2 * sign * e(tau), atol=1e-13)
    assert rebuild_model(json.loads(json.dumps(describe(pair)))) == pair
    lagging = hb.gears.DoubleHelicalPair(eps=(), stiffness=k, error=e, stagger=0.7, e_phase=0.2).system().elements[1]
    np.testing.assert_allclose(lagging.law.stiffness(tau), k(tau - 0.7), atol=1e-12)
    np.testing.assert_allclose(lagging.displacement(tau), -e(tau - 0.9), atol=1e-12)


@pytest.mark.parametrize("apart", [0.0, 3e-14, 6e-14, 2e-13])
def test_product_of_functions_whose_corners_are_within_rounding(apart):
    """f = 1 below 1, 2 above; g = 3 below, 5 above, with a piece as narrow as rounding in between."""
    f = PiecewisePolynomial(np.array([0.0, 1.0]), np.array([[1.0], [2.0]]))
    g = PiecewisePolynomial(np.array([0.0, 1.0 - apart, 1.0 + apart]), np.array([[3.0], [4.0], [5.0]]))
    for one, other in ((f, g), (g, f)):
        mean = one.times(other).integrals(1)[-1, 0]
        assert mean == pytest.approx(3 * 1.0 + 10 * (2 * np.pi - 1), rel=1e-12)
