"""Laws whose force is a compiled function: the same numbers as of the law in Python, by the compiled loop."""

import ctypes
import pickle
from dataclasses import dataclass

import numpy as np
import pytest

import hbgear as hb

numba = pytest.importorskip("numba")


@numba.njit
def drag(d, v, tau, c):
    k = 1 + 0.5 * np.cos(tau)
    return c[0] * d * d * v + k * d + 0.1 * v**3, 2 * c[0] * d * v + k, c[0] * d * d + 0.3 * v * v


@numba.njit
def stop(d, v, tau, p):
    over = d > p[1]
    return p[0] * (d - p[1]) if over else 0.0, p[0] if over else 0.0, 0.0


@dataclass(frozen=True)
class Drag(hb.mechanics.Law):
    """p = c d^2 v + (1 + cos(tau) / 2) d + v^3 / 10, in Python."""

    c: float = 0.3

    def force(self, d, v, tau):
        k = 1 + 0.5 * np.cos(tau)
        return self.c * d * d * v + k * d + 0.1 * v**3, 2 * self.c * d * v + k, self.c * d * d + 0.3 * v * v


def two_masses(law):
    elements = [
        hb.Element([1.0, -1.0], law, hb.mechanics.Series(cosine=(0.1,)), damping=0.02),
        hb.Element([0.0, 1.0], hb.Backlash(0.2)),
    ]
    load = hb.Load([0.1, 0.2], cosine={1: [0.3, 0.0]})
    return hb.System(np.diag([1.0, 2.0]), 0.05 * np.eye(2), [[1.3, -0.3], [-0.3, 1.2]], elements, load)


@pytest.mark.parametrize("nu", [1, 2])
def test_the_balance_is_that_of_the_law_in_python(nu, rng):
    """Residual, both derivatives, truncation error and multipliers."""
    python, compiled = (
        hb.HarmonicBalance(two_masses(law), 7, nu=nu) for law in (Drag(), hb.mechanics.CompiledLaw(drag, (0.3,)))
    )
    X = 0.4 * rng.standard_normal(python.size)
    for a, b in zip(*(p.linearise(X, "Omega", Omega=0.8) for p in (python, compiled)), strict=True):
        np.testing.assert_allclose(b, a, rtol=0, atol=1e-13 * np.abs(a).max())
    assert compiled.truncation(X, Omega=0.8) == pytest.approx(python.truncation(X, Omega=0.8), rel=1e-11)
    mu, expected = (p.multipliers(X, Omega=0.8) for p in (compiled, python))
    np.testing.assert_allclose(mu, expected, rtol=1e-9, atol=1e-14)
    assert compiled.compiled_continuation("Omega", {}) is not None and python.compiled_continuation("Omega", {}) is None


@pytest.mark.slow
def test_a_curve_is_that_of_the_law_in_python():
    laws = Drag(), hb.mechanics.CompiledLaw(drag, (0.3,))
    curves = [hb.trace(hb.HarmonicBalance(two_masses(law), 7), "Omega", (2.0, 0.5)) for law in laws]
    assert [c.status for c in curves] == [hb.Status.REACHED_END] * 2
    marks = [[(p.label, p.parameters["Omega"]) for p in curve.special] for curve in curves]
    assert [label for label, _ in marks[0]] == [label for label, _ in marks[1]] and marks[0]
    np.testing.assert_allclose([x for _, x in marks[1]], [x for _, x in marks[0]], rtol=1e-8)


def test_a_corner_is_met_as_that_of_a_spring():
    """Regimes, grazing contacts, forces and slopes are those of `Unilateral`: the force is integrated between the
    crossings of the breakpoint, for any number of samples."""
    spring, compiled = hb.Unilateral(5.0, 0.6), hb.mechanics.CompiledLaw(stop, (5.0, 0.6), 5.0, (0.6,), rated=False)
    problems = [hb.HarmonicBalance(two_masses(law), 10) for law in (spring, compiled)]
    assert problems[0].smooth and problems[1].smooth
    X = problems[0].start(Omega=0.9)
    for each in ("regime", "clearance"):
        np.testing.assert_array_equal(*(getattr(problem, each)(X, Omega=0.9) for problem in problems))
    for a, b in zip(*(problem.evaluate(X, Omega=0.9) for problem in problems), strict=True):
        np.testing.assert_allclose(b, a, rtol=0, atol=1e-12)
    assert hb.mechanics.CompiledLaw(stop, (5.0, 0.6), 5.0, (0.6,)).force(0.8, 0.0, 0.0)[0] == pytest.approx(1.0)


def test_a_function_of_c():
    """As ctypes makes them, of any language."""
    number, numbers = ctypes.c_double, ctypes.POINTER(ctypes.c_double)

    @ctypes.CFUNCTYPE(None, number, number, number, numbers, numbers)
    def spring(d, v, tau, parameters, out):
        out[0], out[1], out[2] = parameters[0] * d**3, 3 * parameters[0] * d**2, 0.0

    law = hb.mechanics.CompiledLaw(spring, (0.2,))
    d = np.linspace(-1, 1, 5)
    for a, b in zip(law.force(d, 0 * d, 0 * d), hb.Cubic(0.2).force(d, 0 * d, 0 * d), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-15)


def test_it_goes_to_other_processes():
    law = hb.mechanics.CompiledLaw(drag, (0.3,))
    assert law.address
    other = pickle.loads(pickle.dumps(law))
    assert other.force(0.5, 0.2, 0.1) == law.force(0.5, 0.2, 0.1) and other.address != 0


@numba.njit
def endless(d, v, tau, p):
    return 1 / (d - d), 1.0, 0.0


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: hb.mechanics.CompiledLaw(lambda d, v, tau, p: (d, 1.0, 0.0)), TypeError, "decorate it by @numba.njit"),
        (lambda: hb.mechanics.CompiledLaw(drag, (0.3,), -1.0), ValueError, "reference = -1"),
        (lambda: hb.mechanics.CompiledLaw(drag, (0.3,), 1.0, (1.0, 0.5)), ValueError, "ascend"),
        (lambda: hb.mechanics.CompiledLaw(drag, ("c",)), ValueError, "parameters"),
        (lambda: hb.mechanics.CompiledLaw(stop, (np.nan, 0.6)), ValueError, "parameters"),
    ],
)
def test_bad_input(make, error, message):
    with pytest.raises(error, match=message):
        make()
