"""Plausibility checks: unlikely input raises a warning, impossible input an error, and usual input neither."""

import warnings
from fractions import Fraction

import numpy as np
import pytest
from scipy import sparse

import hbgear as hb
from hbgear.harmonic.models.model_registry import MODELS

PUSHED = hb.Load(cosine={1: [1.0]})
STOP = hb.Element([1.0], hb.Backlash(b=1e3), name="stop")


def oscillator(M=1.0, C=0.1, K=1.0, element=STOP, load=PUSHED):
    return hb.System([[M]], [[C]], [[K]], [element], load)


def two(M, C, K):
    return hb.System(M, C, K, [hb.Element([1, 0], hb.Cubic(1.0))], hb.Load(cosine={1: [1.0, 0.0]}))


def balance(model, H=8):
    return hb.HarmonicBalance(model, H)


def response(model, span=(0.5, 1.5), H=8):
    return hb.trace(balance(model, H), "Omega", span, stability=False)


EYE = np.eye(2)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: balance(hb.gears.DoubleHelicalPair(b_c=80.0)), r"b_c = 80.0 .* usual values .*unit \(m\)"),
        (lambda: balance(hb.gears.DoubleHelicalPair(module=6.0)), "module = 6.0 .* usual"),
        (lambda: balance(hb.gears.DoubleHelicalPair(stagger=90.0)), r"stagger = 90.0 .*unit \(rad\)"),
        (lambda: balance(hb.SpurPair(0.05, 200)), "F_m = 200 .* usual"),
        (lambda: balance(hb.SpurPair(zeta=5.0)), "zeta = 5.0 .* usual"),
        (lambda: balance(hb.SpurPair(eps=(0.9, 0.8))), "stiffness of gap is negative"),
        (lambda: balance(hb.SpurPair(), 1), "1 harmonic .* cannot represent a contact"),
        (lambda: response(hb.SpurPair(), (12000, 9000)), "Omega = 12000 .* highest natural frequency .* r/min"),
        (lambda: hb.trace(balance(hb.SpurPair()), "zeta", (0.05, 0.06), at={"Omega": 3000.0}), "Omega = 3000 "),
        (lambda: response(oscillator()), "no element comes near a breakpoint"),
        (lambda: balance(oscillator(load=())), "nothing excites this System"),
        (lambda: balance(oscillator(C=-0.1)), "C has a negative eigenvalue"),
        (lambda: balance(oscillator(M=-1.0)), "M has a negative eigenvalue"),
        (lambda: balance(two(EYE, [[0.1, 0.3], [0.3, 0.1]], EYE)), "C has a negative eigenvalue"),
        (lambda: balance(two(EYE, None, [[2.0, -1.0], [0.0, 2.0]])), r"K couples .* K\[0, 1\] = -1, K\[1, 0\] = 0"),
    ],
)
def test_unlikely_input_is_warned_of_and_computed(act, message):
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match=message):
        assert act() is not None


def test_the_warning_names_the_line_of_the_caller():
    with pytest.warns(hb.mechanics.ImplausibleInputWarning) as seen:
        response(hb.SpurPair(), (12000, 9000))
    assert all(each.filename == __file__ for each in seen)


@pytest.mark.parametrize("cls", MODELS.values())
def test_defaults_are_beyond_doubt(cls):
    with warnings.catch_warnings(action="error"):
        response(cls(), cls.default_span, 16)


def test_oil_film_and_gyroscopes_are_beyond_doubt():
    """Cross-coupled stiffness of bearings and the skew-symmetric C of gyroscopic moments raise no warning."""
    with warnings.catch_warnings(action="error"):
        balance(two(EYE, [[0.1, 0.3], [-0.3, 0.1]], [[2.0, 0.4], [-0.7, 2.0]]))


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: hb.SpurPair(zeta="0.05"), "zeta = '0.05' must be a finite number"),
        (lambda: hb.SpurPair(b=None), "b = None must be a finite number"),
        (lambda: hb.SpurPair(b=np.array([1.0, 2.0])), r"b = array\(\[1., 2.\]\) must be a finite number"),
        (lambda: hb.System(EYE, None, EYE, hb.Element([1, 0], hb.Cubic(1.0))), r"in a list: elements=\[...\]"),
        (lambda: hb.System(EYE, None, EYE, [hb.Cubic(1.0)]), "element 0 is a Cubic"),
        (lambda: hb.System(EYE, None, EYE, [hb.Element([1, 0], hb.Cubic(1.0))], {1: [1.0, 0]}), "need a Load"),
        (lambda: hb.System("M", None, EYE), "M = 'M' must be a square matrix of numbers"),
        (lambda: hb.System(np.zeros((0, 0)), None, None), "M = .* shape|need a square"),
        (lambda: hb.System(EYE, None, EYE, dof_names=sparse.eye_array(2)), "must be a list of names"),
        (lambda: hb.Load(power=np.nan), "power = nan"),
        (lambda: hb.Load(cosine={10**9: [1.0]}), "harmonic number = 1,000,000,000 is more than 10,000"),
        (
            lambda: hb.mechanics.Series(1.0, np.zeros(10**6)),
            "number of entries of cosine = 1,000,000 is more than 10,000",
        ),
        (lambda: hb.SpurPair(eps=np.zeros(10**6)), "number of entries of eps = 1,000,000 is more than 10,000"),
        (lambda: hb.mechanics.Range(low=1.0, high=0.0), "no number lies from 1.0 to 0.0"),
        (lambda: hb.mechanics.Range(above=1.0, high=1.0), "no number lies from 1.0 to 1.0"),
        (lambda: hb.System(EYE, None, EYE, [None]), "element 0 is None; need an Element"),
        (lambda: hb.System(EYE, None, EYE, [(1, 2)]), r"element 0 is a tuple; need .* a star: \*VectorElement"),
        (lambda: hb.gears.DoubleHelicalPair(module=1e-300), "module = 1e-300 is below 1e-60: check its unit"),
        (lambda: hb.gears.GearRotorBearing(mu_2=1e-300), "mu_2 = 1e-300 is below 1e-60: check its unit"),
        (lambda: hb.Backlash(b="1"), "half backlash b = '1'"),
        (lambda: hb.Backlash(stiffness=1.0), "stiffness = 1.0 must be a Series"),
        (lambda: hb.Cubic(None), "k3 = None must be a finite number"),
        (lambda: hb.mechanics.Series(cosine=0.1), "cosine = 0.1 must be a sequence of numbers"),
        (lambda: hb.Element([[1.0]], hb.Cubic(1.0)), "direction"),
        (lambda: hb.Element(None, hb.Cubic(1.0)), "direction"),
        (lambda: hb.Element([1.0], hb.Cubic(1.0), displacement=0.1), "displacement = 0.1 must be a Series"),
        (lambda: hb.Element([1.0], hb.Cubic(1.0), damping="x"), "damping = 'x' must"),
        (lambda: hb.NewtonSettings(tolerance=np.nan), "tolerance = nan must be a finite number"),
        (lambda: hb.NewtonSettings(max_iterations=0), "max_iterations = 0 must be a whole number"),
        (lambda: balance(hb.Duffing(), 10**9), "2,000,000,001 unknowns; at most"),
        (lambda: hb.HarmonicBalance(hb.Duffing(), 8, samples=10**12), "samples = 1,000,000,000,000 .* at most"),
        (lambda: hb.HarmonicBalance(hb.Duffing(), 8, nu=10**9), "do not reach Omega itself"),
        (lambda: hb.design.monte_carlo(10**12, zeta=("uniform", 0.1, 0.2)), "count = 1,000,000,000,000 is more than"),
        (lambda: hb.design.latin_hypercube(2.5, zeta=("uniform", 0.1, 0.2)), "count = 2.5 must be a whole number"),
        (lambda: hb.jump_map(hb.SpurPair(), "b", (-1.0, 1.0)), "b must not be negative"),
        (lambda: hb.jump_map(hb.SpurPair(), "b", (0.5, 1.0), seeds=10**9), "seeds = 1,000,000,000 is more than"),
        (lambda: hb.trace_all(balance(hb.Duffing()), (0.5, 1.5), frequencies=10**12), "frequencies = .* is more than"),
        (lambda: hb.trace_all(balance(hb.Duffing()), (0.5, 1.5), guesses=10**12), "guesses = .* is more than"),
        (lambda: hb.time.basins(hb.Duffing(), 1.0, d=(-np.inf, 2.0)), r"d = \(-inf, 2.0\) must be finite"),
        (lambda: hb.time.basins(hb.Duffing(), 1.0, shape=(10**6, 10**6)), "is more than"),
        (lambda: hb.time.basins(hb.Duffing(), np.inf), "Omega = inf must be a finite number"),
        (lambda: hb.time.basins(hb.Duffing(), 1e-12), "steps per period at Omega = 1e-12 .* is more than"),
        (lambda: hb.time.sweep(hb.Duffing(), [1.0], start=[np.inf, 0.0]), r"start = \[inf, 0.0\] must be finite"),
        (
            lambda: hb.time.sweep(hb.Duffing(), [-0.1, 0.1], parameter="zeta", at={"Omega": 1.0}),
            "zeta must not be negative",
        ),
        (
            lambda: hb.time.sweep(hb.Duffing(), [0.1], parameter="zeta", at={"Omega": np.nan}),
            "Omega = nan must be a finite",
        ),
        (lambda: hb.time.integrate(hb.Duffing(), [np.nan, 0.0], 1, 1.0), r"state = \[nan, 0.0\] must be finite"),
        (lambda: hb.time.integrate(hb.Duffing(), [0.0, 0.0], 10**12, 1.0), "is more than"),
        (lambda: hb.time.shoot(hb.Duffing(), 1.0, [np.inf, 0.0]), r"guess = \[inf, 0.0\] must be finite"),
        (lambda: hb.mechanics.reduce(two(EYE, None, EYE), 10**9), "modes = 1000000000 must be"),
    ],
)
def test_implausible_input_is_refused_before_the_work(act, message):
    with pytest.raises(ValueError, match=message):
        act()


def test_an_element_without_a_law_is_reported():
    with pytest.raises(TypeError, match="element 'mesh': law must be a hbgear Law, got None"):
        hb.Element([1.0], None, name="mesh")
    with pytest.raises(TypeError, match=r"Element: law must be .*, got a function; .* derived from hb\.mechanics\.Law"):
        hb.Element([1.0], lambda d: d**3)


def test_derivatives_and_samples_that_cannot_be_meant_are_refused():
    curve = hb.trace(balance(hb.Duffing(), 3), "Omega", (0.5, 0.6), stability=False)
    with pytest.raises(ValueError, match="derivative = -1 must be a whole number"):
        curve.amplitude(derivative=-1)
    with pytest.raises(ValueError, match="is more than"):
        curve[0].samples(count=10**12)
    with pytest.raises(ValueError, match="order = 11 is more than 10"):
        curve[0].samples(order=11)


def test_fractions_are_numbers_of_time_integration_too():
    third = Fraction(1, 3)
    motion = hb.time.integrate(hb.Duffing(), [0.1, 0.0], 1, third, phase=third, tolerance=third / 100)
    same = hb.time.integrate(hb.Duffing(), [0.1, 0.0], 1, 1 / 3, phase=1 / 3, tolerance=1 / 300)
    np.testing.assert_array_equal(motion.d, same.d)
    curve = hb.trace(balance(hb.Duffing(), 5), "Omega", (0.8, 0.81))
    assert hb.validate(curve, 1, Fraction(1, 1000), multiplier_tolerance=Fraction(1, 10)).ok


def test_a_large_structure_requires_a_reduction():
    from hbgear.mechanics.plausibility import check_size

    n = 500
    first = np.eye(n)[0]
    large = hb.System(np.eye(n), None, np.eye(n), [hb.Element(first, hb.Cubic(1.0))], hb.Load(cosine={1: first}))
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match="hb.mechanics.reduce"):
        check_size(large)
