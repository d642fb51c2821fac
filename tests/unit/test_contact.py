"""The exact projection of piecewise-linear laws against quadrature and against samples."""

from dataclasses import dataclass

import numpy as np
import pytest
from machines import single_mass
from scipy.optimize import brentq

from hbgear import Backlash, Cubic, Element, HarmonicBalance, System, Unilateral
from hbgear.harmonic.forces.switching_times import crossings
from hbgear.mechanics import KelvinVoigt, Law, Parallel, PiecewiseLinear, Series, model
from hbgear.mechanics.series.fourier import evaluate, samples_of, to_complex, to_real

WAVY = Series(mean=1.0, cosine=(-0.2, 0.07), sine=(0.1, 0.0, 0.05))


@dataclass(frozen=True)
class TwoStage(Law):
    """A user-defined law: a spring in parallel with a stiffer spring of periodic stiffness behind a gap."""

    gap: float = 0.3

    @property
    def reference(self):
        return 1.0

    @property
    def piecewise(self):
        return PiecewiseLinear((), (1.0,)), Unilateral(2.0, self.gap, WAVY)

    def force(self, d, v, tau):
        k = WAVY(tau)
        return d + 2 * k * np.maximum(d - self.gap, 0), 1 + 2 * k * (d > self.gap), 0 * d


LAWS = {
    "backlash": Backlash(0.8),
    "backlash, varying stiffness": Backlash(0.8, 2.0, WAVY),
    "unilateral": Unilateral(3.0, 0.4),
    "preloaded, varying stiffness": Unilateral(3.0, -0.4, WAVY),
    "asymmetrical gaps": PiecewiseLinear((-0.3, 1.1), (2.0, 0.0, 0.7), stiffness=WAVY),
    "three stages": PiecewiseLinear((-1.0, 0.2, 0.9), (0.5, 1.0, 0.2, 3.0), 0.4, WAVY),
    "teeth and a stop": Parallel((Backlash(0.8, 2.0), Unilateral(3.0, 0.4))),
    "two variations": Parallel((Backlash(0.8, 2.0, WAVY), Unilateral(3.0, -0.2), Unilateral(1.0, 0.5, WAVY))),
    "a user's own": TwoStage(),
}
GAUSS = np.polynomial.legendre.leggauss(30)


def balance(*laws, H=8, nu=1, **settings):
    """Return a harmonic balance whose elements have the given laws."""
    n = len(laws)
    elements = [Element(direction=np.eye(n)[j], law=law) for j, law in enumerate(laws)]
    return HarmonicBalance(System(np.eye(n), 0.1 * np.eye(n), np.eye(n), elements), H, nu=nu, **settings)


def quadrature(law, row, H, nu=1):
    """Return the force row (2H + 1,) by Gauss quadrature between crossings of breakpoints found on a dense grid."""
    grid = np.linspace(0, 2 * np.pi, 20001)
    cuts = [0.0, 2 * np.pi, *np.linspace(0, 2 * np.pi, 33)[1:-1]]
    for x in law.breakpoints:
        value = evaluate(row, grid) - x
        for i in np.flatnonzero(value[:-1] * value[1:] < 0):
            cuts.append(brentq(lambda t, x=x: evaluate(row, t)[0] - x, grid[i], grid[i + 1], xtol=1e-15))
    cuts = np.sort(cuts)
    half = np.diff(cuts)[:, None] / 2
    theta = (cuts[:-1, None] + half * (GAUSS[0] + 1)).ravel()
    weight = (half * GAUSS[1]).ravel()
    p = law.force(evaluate(row, theta), 0 * theta, nu * theta)[0]
    c = 2 * np.exp(-1j * np.outer(np.arange(H + 1), theta)) @ (weight * p) / (2 * np.pi)
    c[0] /= 2
    return to_real(c)


def force(problem, X):
    """Return the force rows (m, 2H + 1) of a problem, exact or sampled."""
    return problem.force_rows(X.ravel(), Omega=1.0)


def crossed(row, level, N=64):
    """Return the instants at which the function of a real row crosses a level, and the signs of the crossings."""
    theta, sign = np.empty((2, len(row) + 3))
    count = crossings(to_complex(row), float(level), samples_of(to_complex(row), N), theta, sign)
    return theta[:count], sign[:count]


@pytest.mark.parametrize("nu", [1, 2])
@pytest.mark.parametrize("name", LAWS)
def test_against_quadrature(name, nu, rng):
    law, H = LAWS[name], 8
    problem = balance(law, H=H, nu=nu)
    for _ in range(5):
        X = rng.standard_normal(2 * H + 1) * 0.5
        np.testing.assert_allclose(force(problem, X)[0], quadrature(law, X, H, nu), atol=1e-12)


def test_two_elements_with_different_laws(rng):
    laws, H = (LAWS["three stages"], LAWS["backlash, varying stiffness"]), 6
    X = rng.standard_normal((2, 2 * H + 1)) * 0.6
    expected = [quadrature(law, row, H) for law, row in zip(laws, X, strict=True)]
    np.testing.assert_allclose(force(balance(*laws, H=H), X), expected, atol=1e-12)


@pytest.mark.parametrize("nu", [1, 2])
def test_against_samples(nu, rng):
    laws = tuple(LAWS.values())
    exact = balance(*laws, nu=nu)
    sampled = balance(*laws, nu=nu, sampled=True, samples=65536)
    X = rng.standard_normal(exact.size) * 0.5
    (R, J), (Rs, Js) = (p.evaluate(X, Omega=0.8) for p in (exact, sampled))
    np.testing.assert_allclose(R, Rs, atol=1e-7)
    np.testing.assert_allclose(J, Js, atol=1e-3)


def test_samples_converge_to_the_exact_projection(rng):
    """Sampling errors, summed over eight motions, are O(1/N^2) in the force and O(1/N) in its Jacobian."""
    laws = tuple(LAWS.values())
    exact, counts = balance(*laws), 2 ** np.arange(8, 15)
    motions = [rng.standard_normal(exact.size) * 0.5 for _ in range(8)]
    errors = np.zeros((2, len(counts)))
    for i, N in enumerate(counts):
        sampled = balance(*laws, sampled=True, samples=int(N))
        for X in motions:
            pairs = zip(exact.evaluate(X, Omega=0.8), sampled.evaluate(X, Omega=0.8), strict=True)
            errors[:, i] += [np.linalg.norm(a - b) for a, b in pairs]
    slopes = np.polyfit(np.log(counts), np.log(errors.T), 1)[0]
    np.testing.assert_allclose(slopes, [-2, -1], atol=0.15)


@pytest.mark.parametrize("name", LAWS)
def test_jacobian_against_differences(name, rng):
    problem = balance(LAWS[name], H=6)
    X, h = rng.standard_normal(13) * 0.5, 1e-6
    J = problem.evaluate(X, Omega=0.8)[1]
    columns = [
        (problem.residual(X + h * e, Omega=0.8) - problem.residual(X - h * e, Omega=0.8)) / (2 * h) for e in np.eye(13)
    ]
    np.testing.assert_allclose(J, np.transpose(columns), atol=1e-7)


def touching(over, H=6, at=1.234, corner=0.8):
    """Return a row with maximum ``corner + over`` between two samples; its second derivative there is about -1."""
    k = np.arange(1, H + 1)
    c = 0.5**k * np.exp(-1j * k * at)
    row = to_real(np.concatenate([[0.0 + 0j], c]))
    row[0] = corner + over - evaluate(row, at)[0]
    return row


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("over", [1e-12, 1e-9, 1e-6, 1e-4])
def test_grazing(over, sign):
    """Above the breakpoint contact lasts 2 sqrt(2 over / |d''|), even far below the grid spacing; else no contact."""
    row = touching(sign * over)
    problem = balance(Unilateral(1.0, 0.8), H=6)
    found = problem.switching(row, Omega=1.0)
    R, J = problem.evaluate(row, Omega=1.0)
    free = balance(Unilateral(1.0, 9.0), H=6).evaluate(row, Omega=1.0)
    if sign < 0:
        assert found.theta.size == 0
        np.testing.assert_array_equal(R, free[0])
        np.testing.assert_array_equal(J, free[1])
        return
    bend = -evaluate(row, 1.234, 2)[0]
    length = 2 * np.sqrt(2 * over / bend)
    np.testing.assert_array_equal(found.sign, [1, -1])
    assert np.diff(found.theta)[0] == pytest.approx(length, rel=max(1e-3, 1e-16 / over), abs=0)
    # dp_0/da_0 is the share of the period in contact, p_0 the area of a parabola over the period
    assert J[0, 0] - free[1][0, 0] == pytest.approx(length / (2 * np.pi), rel=2e-3)
    assert R[0] - free[0][0] == pytest.approx(2 / 3 * over * length / (2 * np.pi), rel=1e-2, abs=1e-16)


@pytest.mark.parametrize("over", [-1e-12, 0.0, 1e-12])
def test_newton_is_not_upset_by_grazing_from_either_side(over):
    """Residual and Jacobian are continuous across a grazing contact, to 1e-8 and 1e-4: no single root is lost."""
    here, there = (balance(Backlash(0.8, 2.0, WAVY), H=6).evaluate(touching(x), Omega=1.0) for x in (over, 3e-10))
    np.testing.assert_allclose(here[0], there[0], atol=1e-8)
    np.testing.assert_allclose(here[1], there[1], atol=1e-4)


def test_a_parting_shorter_than_the_grid():
    """Contact lost for a time shorter than the spacing of the grid is detected."""
    row = touching(1e-8) * -1.0
    problem = balance(Unilateral(1.0, -0.8), H=6)
    assert problem.switching(row, Omega=1.0).theta.size == 2
    np.testing.assert_allclose(force(problem, row)[0], row + np.eye(13)[0] * 0.8, atol=1e-11)


def test_always_and_never_in_contact(rng):
    X = 0.05 * rng.standard_normal(17)
    for shift, expected in ((5.0, 1.0), (-5.0, 1.0), (0.0, 0.0)):
        row = X + shift * np.eye(17)[0]
        contact = row - np.sign(shift) * np.eye(17)[0]
        np.testing.assert_allclose(force(balance(Backlash(1.0)), row)[0], expected * contact, atol=1e-13)


def test_constant_motion_with_varying_stiffness():
    row = np.eye(17)[0] * 1.5
    expected = np.zeros(17)
    expected[:7] = 0.5 * WAVY.row()
    np.testing.assert_allclose(force(balance(Backlash(1.0, 1.0, WAVY)), row)[0], expected, atol=1e-14)


def test_crossings_through_samples_and_at_the_ends_of_the_period():
    """Crossings exactly at samples and at theta = 0: cos(2 theta) and sin(theta) at the level 0."""
    theta, sign = crossed(np.array([0, 0, 0, 1.0, 0]), 0.0)
    np.testing.assert_allclose(theta, np.pi * np.array([0.25, 0.75, 1.25, 1.75]), atol=1e-15)
    np.testing.assert_array_equal(sign, [-1, 1, -1, 1])
    theta, sign = crossed(np.array([0, 0, 1.0, 0, 0]), 0.0)
    assert sign.sum() == 0 and len(theta) == 2
    half = balance(Unilateral(1.0, 0.0), H=2)
    row = np.array([0, 0, 1.0, 0, 0])
    np.testing.assert_allclose(force(half, row)[0], [1 / np.pi, 0, 0.5, -2 / (3 * np.pi), 0], atol=1e-14)


def test_as_many_crossings_as_a_polynomial_has_roots(rng):
    """All crossings agree to 1e-10 with the roots of the polynomial in exp(i theta) on the unit circle."""
    H = 12
    problem = balance(Unilateral(1.0, 0.1), H=H)
    for _ in range(50):
        X = rng.standard_normal(2 * H + 1)
        c = to_complex(X)
        c[0] -= 0.1
        z = np.roots(np.concatenate([c[:0:-1] / 2, [c[0].real], np.conj(c[1:]) / 2]))
        roots = np.sort(np.mod(np.angle(z[np.abs(np.abs(z) - 1) < 1e-9]), 2 * np.pi))
        np.testing.assert_allclose(problem.switching(X, Omega=1.0).theta, roots, atol=1e-10)


def test_instants_have_all_their_digits(rng):
    """At each instant the function equals the level within rounding of the function, or of theta times its slope."""
    rows, seen = rng.standard_normal((200, 15)) * rng.choice([0.5, 2.0], (200, 1)), 0
    for row, level in zip(rows, rng.uniform(0.2, 1.0, 200), strict=True):
        for theta in crossed(row, level)[0]:
            value, slope = evaluate(row, theta)[0] - level, evaluate(row, theta, 1)[0]
            assert abs(value) < 4e-15 * (1 + np.abs(to_complex(row)).sum()) + 1e-14 * abs(slope)
            seen += 1
    assert seen > 400


def test_elements_are_projected_as_each_alone(rng):
    """Forces, Jacobian and instants of several elements in one table agree with models of each element alone."""
    laws, H = (*LAWS.values(), Cubic(0.3, 0.2), Parallel((Cubic(0.3, 0.2), Backlash(0.8, 2.0, WAVY)))), 7
    together, alone = balance(*laws, H=H), [balance(law, H=H) for law in laws]
    corners, regimes = np.cumsum([0, *(len(law.breakpoints) for law in laws)]), set()
    for size in (0.1, 0.5, 0.5, 2.0, 2.0):
        X = size * rng.standard_normal((len(laws), 2 * H + 1))
        kr = np.array([law.reference for law in laws])
        J = together.evaluate(X.ravel(), Omega=1.0)[1].reshape(len(laws), 2 * H + 1, len(laws), 2 * H + 1)
        found = together.switching(X.ravel(), Omega=1.0)
        for j, (one, row) in enumerate(zip(alone, X, strict=True)):
            np.testing.assert_allclose(force(together, X)[j], force(one, row)[0], rtol=0, atol=1e-13 * size * kr[j])
            np.testing.assert_allclose(J[j, :, j], one.evaluate(row, Omega=1.0)[1], rtol=0, atol=1e-12)
            mine, single = (found.row >= corners[j]) & (found.row < corners[j + 1]), one.switching(row, Omega=1.0)
            np.testing.assert_array_equal(found.theta[mine], single.theta)
            np.testing.assert_array_equal(found.row[mine] - corners[j], single.row)
            regimes |= set(np.bincount(single.row).tolist())
    assert regimes >= {0, 2, 4}


CUBIC = Cubic(0.3, -0.2)


def test_a_cubic_spring_is_projected_exactly(rng):
    """The force has harmonics up to 3H, so 4000 samples have no aliasing: row and Jacobian agree within rounding."""
    H, N, theta = 7, 4000, 2 * np.pi * np.arange(4000) / 4000
    problem, X = balance(CUBIC, H=H), rng.standard_normal(15)
    assert not problem.compiled({}).aft_laws
    d = evaluate(X, theta)
    spectrum = np.fft.rfft(CUBIC.force(d, 0 * d, theta)[0])[: H + 1] / N
    np.testing.assert_allclose(force(problem, X)[0], to_real(np.append(spectrum[:1], 2 * spectrum[1:])), atol=2e-14)
    columns = []
    for wave in np.eye(15):
        c = np.fft.rfft((CUBIC.k1 + 3 * CUBIC.k3 * d * d) * evaluate(wave, theta))[: H + 1] / N
        columns.append(to_real(np.append(c[:1], 2 * c[1:])))
    J = problem.evaluate(X, Omega=1.0)[1] - balance(Cubic(0.0, 0.0), H=H).evaluate(X, Omega=1.0)[1]
    np.testing.assert_allclose(J, np.transpose(columns), rtol=0, atol=2e-13)


@pytest.mark.parametrize("nu", [1, 2])
def test_a_cubic_spring_with_a_gap_against_samples(nu, rng):
    """Parallel((Backlash, Cubic)): exact projection and 65536 samples agree, in the truncation estimate too."""
    law = Parallel((Backlash(0.8, 2.0, WAVY), Cubic(0.3, 0.2)))
    exact, sampled = balance(law, nu=nu), balance(law, nu=nu, sampled=True, samples=65536)
    assert exact.compiled({}).is_fully_compiled and not sampled.compiled({}).is_fully_compiled
    X = 0.7 * rng.standard_normal(exact.size)
    (R, J), (Rs, Js) = (p.evaluate(X, Omega=0.8) for p in (exact, sampled))
    np.testing.assert_allclose(R, Rs, atol=1e-7)
    np.testing.assert_allclose(J, Js, atol=1e-3)
    assert exact.truncation(X, Omega=0.8) == pytest.approx(sampled.truncation(X, Omega=0.8), rel=1e-6)


def test_three_crossings_between_two_samples():
    """sin^3 - delta^2 sin crosses zero three times between two samples; missing two of them makes the Jacobian jump."""
    delta, H = 0.03, 3
    problem = balance(Unilateral(1.0, 0.0), H=H)
    at = 20.5 * 2 * np.pi / problem.N
    # sin^3 x = (3 sin x - sin 3x) / 4
    c = np.array([0, -1j * (0.75 - delta**2), 0, 0.25j]) * np.exp(-1j * at * np.arange(H + 1))
    found = problem.switching(to_real(c), Omega=1.0)
    near = found.theta[np.abs(found.theta - at) < 0.1]
    np.testing.assert_allclose(near, at + np.arcsin([-delta, 0.0, delta]), atol=1e-9)


@pytest.mark.parametrize("depth", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_second_derivatives_of_short_contacts(depth, damping):
    """x = a cos t is in contact for |t| < arccos(g / a). With J = dR/dX, J_00 = k t / pi.

    dJ_00 / da = k g / (pi a^2 sin t) and dJ_00 / dg = -k / (pi a sin t): steps larger than the penetration would end
    the contact.
    """

    @model
    def stopped(gap: float = 0.999) -> System:
        law = KelvinVoigt(5.0, damping, gap) if damping else Unilateral(k=5.0, gap=gap)
        return single_mass(law, F=1.0)

    problem, a = HarmonicBalance(stopped(), 2), 0.999 + depth
    X, v = np.array([0.0, a, 0.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    sine = np.sqrt((a - 0.999) * (a + 0.999)) / a
    along, _ = problem.curvature(X, v, "Omega", Omega=0.8)
    assert along[0, 0] == pytest.approx(5.0 * 0.999 / (np.pi * a**2 * sine), rel=2e-4)
    _, across = problem.curvature(X, v, "gap", Omega=0.8, gap=0.999)
    assert across[0, 0] == pytest.approx(-5.0 / (np.pi * a * sine), rel=2e-4)
