"""Floquet multipliers against theory: their product, folds, period doublings and linear motions.

det Phi = exp(-int_0^T tr(M^-1 [C + sum_j w_j (c_j + dp_j/dv) w_j^T]) dt)
"""

import copy
import itertools

import numpy as np
import pytest
import scipy
from cross.shooting import integrate, state
from machines import Drag, SteepFriction, cantilever, single_mass, state_matrix

from hbgear import Backlash, Cubic, Duffing, Element, HarmonicBalance, Load, SpurPair, System, Unilateral, trace
from hbgear.continuation.solvers.newton import solve
from hbgear.gears import DoubleHelicalPair
from hbgear.harmonic.equations.motion import truncation_error, with_driven_harmonics
from hbgear.harmonic.multipliers import constant_flow
from hbgear.harmonic.multipliers.floquet import _eigenvalues, floquet_multipliers, monodromies
from hbgear.harmonic.structure.modes import SymmetricPair
from hbgear.mechanics import Jenkins, Parallel, PiecewiseLinear, Series, SpeedTerms, reduce
from hbgear.mechanics.series.fourier import evaluate

EXCITED = Series(cosine=(0.2, 0.1, 0.05, 0.03, 0.02, 0.01), sine=(0, 0, 0, 0, 0, 0.04))
"""Prescribed displacement with six harmonics."""


def three_masses(rng):
    """Random damped system of three masses with a cubic spring, and a gap with a parallel damper."""
    A, B = rng.standard_normal((2, 3, 3)) / 3
    C = 0.05 * (np.eye(3) + A @ A.T)
    elements = [Element([1.0, -1.0, 0.5], Backlash(0.3), damping=0.1), Element([0.0, 1.0, 1.0], Cubic(0.5, 0.3))]
    loads = Load([0.3, 0.0, 0.1], {1: [0.4, 0.1, 0.0]})
    return System(np.eye(3) + A @ A.T, C, np.eye(3) + B @ B.T, elements, loads)


def motion(model, Omega, H=15, start=1.8):
    """Return the balance and its motion at Omega, by continuation down from `start`."""
    problem = HarmonicBalance(model, H)
    return problem, trace(problem, "Omega", (start, Omega), stability=False, special=False).X[-1]


def damping_integral(problem, X, Omega):
    """int_0^T tr(M^-1 C(t)) dt by the trapezoidal rule, exact to rounding for smooth laws."""
    system = problem.compiled({}).system
    theta = 2 * np.pi * np.arange(4096) / 4096
    T = 2 * np.pi * problem.nu / Omega
    inverse = np.linalg.inv(np.asarray(system.M))
    total = np.trace(inverse @ system.C)
    for element, row in zip(system.elements, X.reshape(problem.m, -1), strict=True):
        d, v = evaluate(row, theta), Omega / problem.nu * evaluate(row, theta, 1)
        c = element.damping + element.law.force(d, v, problem.nu * theta)[2].mean()
        total += c * element.direction @ inverse @ element.direction
    return total * T


def dragged():
    return single_mass(Drag(), F=0.8, c=0.05, k=0.2)


def chain(n=12):
    """Chain of masses between walls, with a force and a cubic spring to ground at the last mass."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    spring = Element(np.eye(n)[-1], Cubic(1.0, 0.2))
    return System(np.eye(n), 0.01 * np.eye(n), K, [spring], Load(cosine={1: 0.4 * np.eye(n)[-1]}))


FINE = {"points": 5, "max_step": 0.05}
CASES = {
    "Duffing": (lambda rng: Duffing(), 1.0),
    "SpurPair": (lambda rng: SpurPair(eps=(0.2, 0.1)), 0.8),
    "three masses": (three_masses, 0.9),
    "velocity-dependent": (lambda rng: dragged(), 1.1),
    "steps of several parts": (lambda rng: chain(), 1.6),
}


def beam(law, n=2):
    """Cantilever of n finite elements with contact or friction at its tip; modes differ by 60 times in frequency."""
    (M, K), end = cantilever(n), np.eye(2 * n)[-2]
    return System(M, 2e-4 * K + 0.05 * M, K, [Element(end, law)], Load(cosine={1: 0.2 * end}))


def flow_between(system, stiffness, begin, end, Omega):
    """Flow of the variational equation in physical coordinates, with the element stiffness as a function of tau."""
    M, (w,) = np.asarray(system.M), system.W.T
    C, K, n = np.asarray(system.C), np.asarray(system.K), len(M)

    def matrix(tau):
        return state_matrix(M, C, K + stiffness(tau) * np.outer(w, w))

    if stiffness(begin) == stiffness(0.5 * (begin + end)):
        return scipy.linalg.expm(matrix(begin) * (end - begin) / Omega)
    flow = scipy.integrate.solve_ivp(
        lambda t, y: (matrix(begin + Omega * t) @ y.reshape(2 * n, -1)).ravel(),
        (0, (end - begin) / Omega),
        np.eye(2 * n).ravel(),
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
    )
    return flow.y[:, -1].reshape(2 * n, -1)


@pytest.mark.parametrize("varying", [0.0, 0.3])
@pytest.mark.parametrize("k", [2.0, 200.0])
def test_modes_much_faster_than_the_springs(k, varying):
    """Steps resolve fast modes that a soft spring excites: errors below 3e-8; longer steps had errors up to 2e-2.

    The reference propagates the disturbance in physical coordinates, by matrix exponentials or DOP853.
    """
    law = (
        PiecewiseLinear((0.05,), (0.0, 1.0), stiffness=Series(k, (varying * k,)))
        if varying
        else Unilateral(k, gap=0.05)
    )
    system = beam(law)
    problem = HarmonicBalance(system, 24)
    X, Omega = problem.start(3.3), np.array([3.3])
    compiled = problem.compiled({})
    wide = with_driven_harmonics(compiled, X[None], Omega)

    def gap(tau):
        return float(evaluate(wide, np.array([tau]))[0, 0]) - 0.05

    grid = np.linspace(0.0, 2 * np.pi, 400)
    signs = np.sign([gap(tau) for tau in grid])
    theta = [scipy.optimize.brentq(gap, *grid[i : i + 2], xtol=1e-14) for i in np.flatnonzero(np.diff(signs))]
    assert len(theta) >= 2
    Phi = np.eye(8)
    for begin, end in itertools.pairwise([*theta, theta[0] + 2 * np.pi]):
        touch = k * (gap(0.5 * (begin + end)) > 0)
        Phi = flow_between(system, lambda tau, k=touch: k * (1 + varying * np.cos(tau)), begin, end, 3.3) @ Phi
    expected = np.linalg.eigvals(Phi)
    found = floquet_multipliers(compiled, wide, Omega)[0]
    assert np.abs(found[:, None] - expected).min(axis=1).max() < 3e-8
    assert np.sort(np.abs(expected))[-4] > 0.3


@pytest.mark.slow
def test_more_elements_than_coordinates():
    """Two coordinates with four elements: displacements and forces of two determine the others."""
    rng = np.random.default_rng(3)
    directions = rng.standard_normal((4, 2))
    elements = [Element(w, Cubic(0.2, k)) for w, k in zip(directions, (0.5, 0.8, 1.1, 1.4), strict=True)]
    M, C, K = np.array([[1.0, 0.2], [0.2, 0.7]]), 0.05 * np.eye(2), np.array([[1.2, -0.4], [-0.4, 0.9]])
    system = System(M, C, K, elements, Load(cosine={1: [0.6, 0.3]}))
    problem, X = motion(system, 0.9, H=12)
    compiled, Omega = problem.compiled({}), np.array([0.9])
    assert len(compiled.stability_modes().coupled.modes.base.output) == 2
    rows = X.reshape(4, -1)

    def rate(t, y):
        d = evaluate(rows, np.array([0.9 * t]))[:, 0]
        slopes = [e.law.force(d[j : j + 1], 0 * d[:1], 0 * d[:1])[1][0] for j, e in enumerate(elements)]
        total = K + sum(k * np.outer(w, w) for k, w in zip(slopes, directions, strict=True))
        return (state_matrix(M, C, total) @ y.reshape(4, 4)).ravel()

    flow = scipy.integrate.solve_ivp(
        rate, (0, 2 * np.pi / 0.9), np.eye(4).ravel(), method="DOP853", rtol=1e-12, atol=1e-12
    )
    expected = np.linalg.eigvals(flow.y[:, -1].reshape(4, 4))
    found = floquet_multipliers(compiled, X[None], Omega)[0]
    assert np.abs(found[:, None] - expected).min(axis=1).max() < 1e-9


@pytest.mark.parametrize("k", [2.0, 200.0])
def test_exact_flows_of_friction_are_the_limit_of_short_steps(k):
    problem = HarmonicBalance(beam(Jenkins(k, 0.1), 5), 24)
    X = problem.start(3.3)
    compiled = problem.compiled({})
    schemes = {}, {"points": 8, "max_step": 1.6}
    exact, steps = (floquet_multipliers(compiled, X[None], np.array([3.3]), **scheme)[0] for scheme in schemes)
    assert np.abs(exact[:, None] - steps).min(axis=1).max() < 1e-8
    assert np.abs(exact[2]) > 0.3


def test_truncated_modes_change_multipliers_of_friction_little():
    """The displacement of a slider at stick includes the static part of the truncated modes: errors below 2e-5."""
    problem = HarmonicBalance(beam(Jenkins(20.0, 0.1), 20), 24)
    X, Omega = problem.start(3.3), np.array([3.3])
    reduced = problem.compiled({})
    full = copy.copy(reduced)
    full.reduce = False
    few, all_ = (floquet_multipliers(one, X[None], Omega)[0] for one in (reduced, full))
    assert np.abs(few[:4, None] - all_).min(axis=1).max() < 2e-5
    steps = floquet_multipliers(full, X[None], Omega, points=8, max_step=1.6)[0]
    assert np.abs(all_[:4, None] - steps).min(axis=1).max() < 1e-8


def test_exact_flow_is_that_of_the_matrix_exponential(rng):
    for q, g, columns in ((2, 1, 3), (5, 3, 13), (10, 5, 25)):
        poles = -0.1 + 1j * rng.uniform(1, 200, q)
        output, input_ = (
            scale * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
            for scale, shape in ((1.0, (g, q)), (0.01, (q, g)))
        )
        rest, D, pull = rng.standard_normal((g, g)) / 10, rng.standard_normal(g), rng.standard_normal((g, columns))
        modes = SymmetricPair.of(poles, output, input_, np.arange(g), rest)
        C, B = np.hstack([output.real, -output.imag]), np.vstack([input_.real, input_.imag])
        turn = np.block([[np.diag(poles.real), -np.diag(poles.imag)], [np.diag(poles.imag), np.diag(poles.real)]])
        ports = np.linalg.inv(np.eye(g) + D[:, None] * rest)
        F, b = turn - B @ ports @ (D[:, None] * C), B @ ports @ pull
        flow, state = constant_flow.flow_workspace(g, q, columns), rng.standard_normal((2 * q, columns))
        constant_flow.fill_flow(modes, D, pull, 0.7, flow)
        whole = scipy.linalg.expm(0.7 * np.block([[F, b], [np.zeros((columns, 2 * q + columns))]]))
        expected = whole[: 2 * q, : 2 * q] @ state + whole[: 2 * q, 2 * q :]
        u = ports @ (D[:, None] * (C @ state) - pull)
        constant_flow.fill_displacements(modes, D, state, pull, flow)
        np.testing.assert_allclose(flow.displacements, C @ state - rest @ u, atol=1e-12)
        constant_flow.apply_flow(flow, state)
        np.testing.assert_allclose(state, expected, atol=1e-10)


@pytest.mark.parametrize("name", CASES)
def test_product_is_the_damping(name, rng):
    make, Omega = CASES[name]
    problem, X = motion(make(rng), Omega)
    product = np.prod(problem.multipliers(X, Omega=Omega, **FINE)).real
    assert product == pytest.approx(np.exp(-damping_integral(problem, X, Omega)), rel=1e-10)


@pytest.mark.parametrize("name", CASES)
def test_product_at_the_default_steps(name, rng):
    make, Omega = CASES[name]
    problem, X = motion(make(rng), Omega)
    product = np.prod(problem.multipliers(X, Omega=Omega)).real
    assert product == pytest.approx(np.exp(-damping_integral(problem, X, Omega)), rel=1e-6)


@pytest.mark.parametrize("Omega", [0.7, 2.0])
def test_linear_motion_has_the_multipliers_of_its_poles(Omega):
    """Contact throughout: mu = exp(lambda T), lambda = -zeta +- i sqrt(1 - zeta^2), for any amplitude."""
    problem = HarmonicBalance(SpurPair(b=0.0), 5)
    mu = problem.multipliers(problem.start(Omega), Omega=Omega)
    poles = -0.05 + 1j * np.sqrt(1 - 0.05**2) * np.array([1, -1])
    np.testing.assert_allclose(np.sort_complex(mu), np.sort_complex(np.exp(poles * 2 * np.pi / Omega)), atol=1e-12)


def test_linear_motion_of_the_double_helical_pair():
    """All 46 multipliers are exp(lambda T) of the closed mesh; the pair +1 of the free rotation is excluded."""
    model = DoubleHelicalPair(W=-1.0, eps=())
    system, problem = model.system(), HarmonicBalance(model, 3)
    W = system.W
    K, C = system.K + W @ W.T, system.C + system.elements[0].damping * W @ W.T
    poles = np.linalg.eigvals(state_matrix(system.M, C, K))
    poles = poles[np.argsort(np.abs(poles))][2:]
    expected = np.exp(poles * 2 * np.pi / 0.9)
    mu = problem.multipliers(problem.start(0.9), Omega=0.9)
    assert mu.shape == (46,)
    big = np.abs(expected) > 1e-3
    match = np.abs(mu[:, None] - expected[big]).min(axis=0)
    np.testing.assert_allclose(match, 0, atol=1e-9)
    assert np.sum(np.abs(mu) > 1e-3) == big.sum()


def excited_at(order, law):
    """One mass whose stiffness, displacement and load have a given base order."""
    displacement = Series(0.2, (0.0,) * (order - 1) + (0.2,)) if isinstance(law, Cubic) else Series()
    element = Element([1.0], law, displacement)
    return System([[1.0]], [[0.05]], [[1.0]], [element], Load([0.3], {order: [0.8]}))


@pytest.mark.slow
@pytest.mark.parametrize("order", [7, 20])
@pytest.mark.parametrize("kind", ["stiffness", "cubic", "tanh"])
@pytest.mark.parametrize("speed", [1.3, 3.0])
def test_the_unit_of_the_frequency_is_arbitrary(kind, order, speed):
    """Order n at Omega / n and order 1 at Omega are the same excitation: the multipliers are n-th powers."""
    laws = {"cubic": Cubic(2.0), "tanh": SteepFriction(0.1, 0.02)}
    multipliers, X = [], None
    for n in (1, order):
        stiffness = Series(1.0, (0.0,) * (n - 1) + (0.4,))
        model = excited_at(n, laws.get(kind, Backlash(0.2, stiffness=stiffness)))
        problem = HarmonicBalance(model, orders=[n * k for k in range(1, 25)], samples=1024 * n)
        X = problem.start(Omega=speed) if X is None else X
        multipliers.append(np.sort_complex(problem.multipliers(X, Omega=speed / n)))
    powers = np.sort_complex(multipliers[0] ** order)
    np.testing.assert_allclose(multipliers[1], powers, atol=1e-8 * np.abs(powers).max(), rtol=0)


STEEP_FRICTION = {
    0.7: (0.23186874809896602, -0.17028115 + 0.17415585j),
    0.9: (0.5705117751083822, 0.57512204 + 0.41469782j),
    1.1: (0.48518318509710945, 0.66076699 + 0.38076839j),
    1.4: (0.11034930474724017, -0.08981513 + 0.48680914j),
}
"""x'' + .01 x' + x + .1 tanh(20 x') = .2 cos(Omega t): rms and one multiplier by shooting (Runge-Kutta of order 8)."""


@pytest.mark.parametrize("Omega", STEEP_FRICTION)
def test_motions_and_multipliers_with_steep_friction_are_those_of_shooting(Omega):
    """Integration steps of the multipliers are short near velocity reversals: errors below 2e-8."""
    problem = HarmonicBalance(single_mass(SteepFriction(0.1, 0.05), F=0.2, c=0.01), 96)
    X, (rms, multiplier) = problem.start(Omega=Omega), STEEP_FRICTION[Omega]
    assert abs(np.sqrt(0.5 * np.sum(X**2)) - rms) < 1e-9
    assert np.abs(problem.multipliers(X, Omega=Omega) - multiplier).min() < 2e-8


@pytest.mark.parametrize("model", [SpurPair(), SpurPair(eps=(0.1, 0.05))], ids=["constant", "varying stiffness"])
def test_a_multiplier_is_one_at_every_fold(model):
    """The multiplier at the fold of H harmonics differs from 1 by a truncation error O(H^-3).

    It is below 1e-6 at H = 150 with constant and at H = 200 with varying stiffness.
    """
    H = 200
    problem = HarmonicBalance(model, H)
    curve = trace(problem, "Omega", (1.5, 0.6), stability=False)
    folds = [p for p in curve.special if p.kind == "LP"]
    assert len(folds) == 2
    for fold in folds:
        mu = problem.multipliers(fold.X, Omega=fold.parameters["Omega"])
        assert np.abs(mu - 1).min() < 1e-6


def test_a_multiplier_is_minus_one_where_the_doubled_balance_is_singular():
    """Where mu = -1 the Jacobian of the balance over two periods is singular: its determinant changes sign.

    Without contact loss the equation is linear, and few harmonics solve it to rounding accuracy.
    """
    model = SpurPair(zeta=0.02, F_m=0.3, eps=(0.3,), e=(0.02,))
    problem = HarmonicBalance(model, 20)
    doubled = problem.with_order(2)
    curve = trace(problem, "Omega", (2.6, 1.7))
    points = [p for p in curve.special if p.kind == "PD"]
    assert len(points) == 2 and all(p.located for p in points)
    for point in points:
        Omega = point.parameters["Omega"]
        assert np.abs(problem.multipliers(point.X, Omega=Omega, **FINE) + 1).min() < 1e-8
        signs = []
        for shift in (-1e-6, 1e-6):
            nearby = trace(problem, "Omega", (Omega, Omega + shift), point.X, stability=False, special=False).X[-1]
            J = doubled.evaluate(doubled.from_layout(nearby, problem.layout), Omega=Omega + shift)[1]
            signs.append(np.linalg.slogdet(J)[0])
        assert signs[0] == -signs[1]


def test_stable_means_disturbances_die():
    """Of three motions of Duffing's oscillator at one Omega the middle one is unstable, also by integration."""
    model, Omega = Duffing(), 1.102
    problem = HarmonicBalance(model, 9)
    curve = trace(problem, "Omega", (0.5, 1.6))
    x = curve.values - Omega
    found = {}
    for i in np.flatnonzero(x[:-1] * x[1:] < 0):
        piece = trace(problem, "Omega", (curve.values[i], Omega), curve[int(i)])
        y = state(problem, piece.X[-1], Omega=Omega)
        mu = problem.multipliers(piece.X[-1], Omega=Omega, **FINE)
        true = np.linalg.eigvals(integrate(model.system(), Omega, y).monodromy)
        np.testing.assert_allclose(np.sort_complex(mu), np.sort_complex(true), atol=1e-7)
        found[round(piece.amplitude()[-1], 2)] = bool(piece.stable[-1])
    assert list(dict(sorted(found.items())).values()) == [True, False, True]


def switched():
    """Chain of three masses with two gaps, one of varying stiffness in parallel with a nonlinear damper."""
    parallel = Parallel((Backlash(0.2, 0.5, Series(1.0, (0.3,), (0.1,))), Drag(0.2)))
    elements = [Element([1.0, -1.0, 0.0], parallel, name="a"), Element([0.0, 1.0, -1.0], Backlash(0.4), name="b")]
    K = np.diag([1.2, 1.0, 0.8])
    return System(np.eye(3), 0.04 * np.eye(3), K, elements, Load(cosine={1: [0.5, 0.0, -0.3], 2: [0.0, 0.2, 0.0]}))


def along(model, H, span):
    """Problem, motions and frequencies along a curve, including grazing points."""
    problem = HarmonicBalance(model, H)
    curve = trace(problem, "Omega", span, stability=False)
    grazing = [p for p in curve.special if p.kind == "GR"]
    X = np.array([*curve.X[:: max(1, len(curve) // 20)], *(problem.from_point(p) for p in grazing)])
    Omega = np.array([*curve.values[:: max(1, len(curve) // 20)], *(p.parameters["Omega"] for p in grazing)])
    return problem, X, Omega


def doubled():
    """Motions of one period in the layout of twice the period."""
    problem, X, Omega = along(SpurPair(e=(0.1,)), 10, (2.2, 1.7))
    twice = problem.with_order(2)
    return twice, np.array([twice.from_layout(x, problem.layout) for x in X]), Omega


CURVES = {
    "no corner": lambda: along(Duffing(), 7, (0.5, 1.6)),
    "all regimes": lambda: along(SpurPair(eps=(0.2, 0.1)), 12, (1.5, 0.3)),
    "two gaps and a damper": lambda: along(switched(), 12, (2.0, 0.7)),
    "twice the period": doubled,
    "many coordinates": lambda: along(DoubleHelicalPair(), 8, (1.3, 0.7)),
    "long steps": lambda: along(chain(), 5, (0.3, 0.6)),
}


def test_multipliers_of_one_mode_are_the_eigenvalues_of_lapack(rng):
    """Matrices of any norm, with nearly equal multipliers, and with one near zero: sums and products to 1e-14."""
    A = rng.standard_normal((600, 2, 2)) * 10.0 ** rng.uniform(-9, 9, (600, 1, 1))
    A[200:400, 1, 1] = A[200:400, 0, 0] * (1 + 1e-9 * rng.standard_normal(200))
    A[200:300, 1, 0] *= 1e-12
    A[400:, 1] = A[400:, 0] * (1 + 1e-12 * rng.standard_normal((200, 1)))
    size = np.abs(A).max(axis=(1, 2))
    mine, known = _eigenvalues(A), np.linalg.eigvals(A)
    for symmetric in (lambda mu: mu.sum(axis=1) / size, lambda mu: mu.prod(axis=1) / size**2):
        np.testing.assert_allclose(symmetric(mine), symmetric(known), rtol=0, atol=1e-14)
    apart = np.abs(mine[:, :, None] - known[:, None]).min(axis=2).max(axis=1) / size
    assert apart[:200].max() < 1e-13 and apart.max() < 1e-6  # double eigenvalues have half of the digits
    A[7, 0, 1] = np.nan
    with pytest.raises(ValueError, match="the monodromy matrix is not finite"):
        _eigenvalues(A)


@pytest.mark.parametrize(("nu", "gyroscopic"), [(1, 0.0), (2, 0.0), (1, 0.2)])
def test_an_excitation_above_the_harmonics(nu, gyroscopic):
    """The response of a linear system to loads and prescribed displacements of truncated orders, in closed form.

    A law k d with k = 0.6 is a contact that never opens. The error of the motion is the rms of this response.
    """
    k, c, Omega, H = 0.6, 0.05, 0.7, 4 * nu
    w = np.array([1.0, -0.5])
    M, C, K = np.diag([1.0, 1.5]), np.array([[0.1, -0.02], [-0.02, 0.1]]), np.array([[2.0, -0.5], [-0.5, 3.0]])
    element = Element(w, PiecewiseLinear((-50.0,), (0.0, k)), name="d", displacement=EXCITED, damping=c)
    load = Load(cosine={1: [0.3, 0.0], 6: [0.02, 0.05]}, sine={7: [0.03, 0.01]}, power=2)
    G = np.array([[0.0, gyroscopic], [-gyroscopic, 0.0]])
    problem = HarmonicBalance(System(M, C, K, [element], load, speed=SpeedTerms(G) if gyroscopic else None), H, nu=nu)
    X, compiled = np.zeros(problem.layout.width), problem.compiled({}).at(Omega)
    wide = with_driven_harmonics(compiled, X[None], np.array([Omega]))[0]
    damping = C + Omega * G + c * np.outer(w, w)
    truncated = []
    for order in range(5, 9):
        s, e = 1j * order * Omega, 0j
        if order <= 6:
            e = EXCITED.cosine[order - 1] - 1j * EXCITED.sine[order - 1]
        F = Omega**2 * (load.cosine.get(order, 0 * w) - 1j * np.array(load.sine.get(order, 0 * w)))
        D = s**2 * M + s * damping + K + k * np.outer(w, w)
        d = w @ np.linalg.solve(D, F + w * (k + c * s) * e) - e
        truncated.append(d)
        at = 2 * nu * order
        assert wide[at - 1] - 1j * wide[at] == pytest.approx(d, abs=1e-13)
    error = truncation_error(compiled, X, Omega)
    assert error == pytest.approx(np.sqrt(0.5 * np.sum(np.abs(truncated) ** 2)), rel=1e-9)


@pytest.mark.parametrize("Omega", [0.8, 1.1])
def test_multipliers_with_an_excitation_above_the_harmonics(Omega):
    """Eight harmonics of a pair whose error has orders 1 and 12: multipliers and error, against 64 harmonics.

    Without order 12 the multipliers differ by 0.07.
    """
    model = SpurPair(zeta=0.05, F_m=0.1, e=(0.15, *([0.0] * 10), 0.01))
    rough, fine = HarmonicBalance(model, 8), HarmonicBalance(model, 64)
    X = rough.start(Omega)
    true = solve(fine, fine.resized(X), {"Omega": Omega}).X
    beyond = np.sqrt(0.5 * np.sum(true[17:] ** 2))
    assert rough.observe(X, Omega=Omega)["error"] == pytest.approx(beyond, rel=0.03)
    exact = fine.multipliers(true, Omega=Omega)
    plain = floquet_multipliers(rough.compiled({}), X[None], np.array([Omega]))[0]
    assert np.abs(plain - exact).max() > 0.06
    assert np.abs(rough.multipliers(X, Omega=Omega) - exact).max() < 0.015


@pytest.mark.slow
@pytest.mark.parametrize("name", CURVES)
def test_many_at_once_are_those_one_by_one(name):
    problem, X, Omega = CURVES[name]()
    count = {len(problem.switching(x, Omega=w).theta) for x, w in zip(X, Omega, strict=True)}
    if name == "all regimes":
        assert {0, 2, 4} <= count
    compiled = problem.compiled({})
    together = floquet_multipliers(compiled, with_driven_harmonics(compiled, X, Omega), Omega)
    single = np.array([problem.multipliers(x, Omega=w) for x, w in zip(X, Omega, strict=True)])
    assert together.shape == (len(X), single.shape[1]) and together.dtype == complex
    assert np.all(np.diff(np.abs(together)) <= 1e-12)
    scale = np.abs(single).max(axis=1, keepdims=True)
    np.testing.assert_allclose(together / scale, single / scale, rtol=0, atol=1e-11)


def test_steps_of_few_and_of_many_points():
    """Monodromy matrices of all modes by steps of 4 and 6 Gauss points equal those by longer steps of 8, to 1e-10.

    Rounding errors grow with the nodes, see `gauss`: 3e-12 with 8, 2e-9 with 12.
    """
    problem, X, Omega = CURVES["long steps"]()
    compiled = problem.compiled({})
    parts = compiled.stability_modes()
    long = monodromies(compiled, parts.coupled, parts.mobility, X, Omega, points=8, max_step=0.8)
    for points in (4, 6):
        short = monodromies(compiled, parts.coupled, parts.mobility, X, Omega, points=points, max_step=0.2)
        np.testing.assert_allclose(short, long, rtol=0, atol=1e-10)


def test_without_modes_the_message_has_a_remedy():
    problem = HarmonicBalance(Duffing(), 3)
    X = problem.start(0.7)
    problem.compiled({}).structure.modes = None
    for call in (
        lambda: problem.multipliers(X, Omega=0.7),
        lambda: floquet_multipliers(problem.compiled({}), X[None], np.array([0.7])),
    ):
        with pytest.raises(ValueError, match="reduce the model"):
            call()


@pytest.mark.slow
def test_both_period_doublings_of_a_beam_with_a_stop():
    """Between them the motion is stable or quasi-periodic. With 12 harmonics they are 2.6 times as far apart.

    The frequencies are those of shooting with exact flows of 40 modes of the uniform beam in closed form.
    """
    (M, K), tip = cantilever(100), np.eye(1, 200, 198)[0]
    stop = Element(tip, Unilateral(k=50.0, gap=0.05))
    beam = System(M, 0.2 * M, K, [stop], Load(cosine={1: 0.02 * tip}))
    curve = trace(HarmonicBalance(reduce(beam, 10).system, 12), "Omega", (2.5, 3.6))
    found = [point.parameters["Omega"] for point in curve.special if point.kind == "PD"]
    assert len(found) == 4  # no pair of them is left out
    assert found[1] == pytest.approx(3.525534, abs=3e-5)
    assert found[2] == pytest.approx(3.533802, abs=3e-5)


@pytest.mark.filterwarnings("ignore::hbgear.mechanics.ImplausibleInputWarning")
@pytest.mark.parametrize("gap", [5.0, 0.05])
def test_a_beam_whose_modes_decay_alike_has_no_period_doubling(gap):
    """The beam does not reach its stop, or touches it so gently that all multipliers have the modulus .95.

    High modes, which the multipliers leave out, turn by many radians from point to point, and seemed to pass -1.
    """
    (M, K), end = cantilever(40), np.eye(80)[78]
    beam = System(M, 0.05 * M, K, [Element(end, Unilateral(k=0.2, gap=gap))], Load(cosine={1: 0.1 * end}))
    curve = trace(HarmonicBalance(beam, 9), "Omega", (3.0, 3.2))
    assert not curve.special and np.any(curve.regime) == (gap < 1)
    assert np.abs(np.abs(curve.multipliers).max(axis=1) - np.exp(-0.025 * 2 * np.pi / curve.values)).max() < 2e-3
