"""Tori of laws of several displacements against limit cycles in the rotating frame, scalar laws and invariances.

Isotropic rotor with cross-coupled stiffness h and gyroscopic moment g, in complex form q = x + i y:

    q'' + (c - i g Omega) q' + (1 - i h) q + |q|^2 q = e exp(i Omega t)

In the rotating frame, q = z exp(i Omega t), the load is constant, so that tori are limit cycles of z.
"""

import dataclasses
import math

import numba
import numpy as np
import pytest
import scipy
from machines import single_mass

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.autonomous.tori.basis import TorusBasis

UNIT, TURN = np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]])
C, H, E = 0.1, 0.12, 0.2
RADIAL = hb.mechanics.Polynomial([[3, 0], [1, 2], [2, 1], [0, 3]], [[1, 0], [1, 0], [0, 1], [0, 1]])


def rotor(g: float = 0.0, directions=UNIT) -> hb.System:
    spring = hb.mechanics.VectorElement(directions, RADIAL, name="shaft")
    load = hb.Load(cosine={1: [E, 0.0]}, sine={1: [0.0, E]})
    speed = hb.mechanics.SpeedTerms(g * TURN) if g else None
    return hb.System(UNIT, C * UNIT, UNIT + H * TURN, [*spring], load, speed=speed)


def limit_cycle(g: float, Omega: float) -> tuple[float, float, float]:
    """Return the frequency, the rms of x, and the second largest multiplier of the cycle in the rotating frame."""

    def rate(t, s):
        z, v = s[0] + 1j * s[1], s[2] + 1j * s[3]
        a = E - 2j * Omega * v + Omega**2 * z - (C - 1j * g * Omega) * (v + 1j * Omega * z)
        a -= (1 - 1j * H + abs(z) ** 2) * z
        return np.array([v.real, v.imag, a.real, a.imag])

    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    settled = scipy.integrate.solve_ivp(rate, (0, 4000), [0.1, 0.2, 0, 0], **options).y[:, -1]
    free = scipy.integrate.solve_ivp(rate, (0, 60), settled, dense_output=True, **options)
    middle = free.sol(np.linspace(0, 60, 3001))[0].mean()

    def section(t, s):
        return s[0] - middle

    section.direction = 1
    cycles = scipy.integrate.solve_ivp(rate, (0, 80), settled, events=section, dense_output=True, **options)
    begin, end = cycles.t_events[0][-2:]
    z = cycles.sol(begin + (end - begin) * np.arange(4096) / 4096)[:2]
    state, h = cycles.sol(begin), 1e-6

    def mapped(s):
        return scipy.integrate.solve_ivp(rate, (0, end - begin), s, **options).y[:, -1]

    flow = np.array([(mapped(state + h * x) - mapped(state - h * x)) / (2 * h) for x in np.eye(4)]).T
    mu = np.sort(np.abs(np.linalg.eigvals(flow)))
    return 2 * math.pi / (end - begin), float(np.sqrt(np.mean(z**2))), float(mu[-2])


@pytest.mark.slow
@pytest.mark.parametrize("g", [0.0, -0.1])
def test_whirl_of_a_rotor_is_a_limit_cycle_in_the_rotating_frame(g):
    Omega = 0.8
    frequency, rms, multiplier = limit_cycle(g, Omega)
    curve = hb.trace(hb.HarmonicBalance(rotor(g), 3), "Omega", (0.7, 1.2))
    tori = hb.analysis.torus(curve, "NS1", (0.7, 1.2), harmonics=(7, 7))
    i = int(np.argmin(np.abs(tori.values - Omega)))
    start = tori.problem.join(tori[i].X, tori[i].parameters)
    X = solve(tori.problem.with_borders_at(start, {"Omega": Omega}, renew=True), start, {"Omega": Omega}).X
    assert math.cos(2 * math.pi * X[-1] / Omega) == pytest.approx(math.cos(2 * math.pi * frequency / Omega), abs=1e-8)
    assert tori.layout.measure("rms", X[:-1]) == pytest.approx(rms, rel=1e-8)
    growth = tori.problem.observe(X, Omega=Omega)
    expected = multiplier ** (frequency / Omega)  # in a period of the excitation
    assert abs(growth["multipliers"][0] - expected) < min(1e-3, 3 * growth["modulus_error"])


@numba.njit
def cubic(d, v, tau, k):
    return k[0] * d**3, 3 * k[0] * d**2, 0.0


@pytest.mark.parametrize(
    "law",
    [
        hb.mechanics.VectorElement([[1.0]], hb.mechanics.Polynomial([[3]], [[0.3]]))[0].law,
        hb.mechanics.CompiledLaw(cubic, parameters=(0.3,), rated=False),
    ],
)
def test_cubic_as_a_polynomial_and_compiled(law):
    second, parameters = hb.Load(cosine={1: [0.1]}), {"Omega": 0.9}
    scalar, vector = (
        hb.harmonic.TwoToneProblem(single_mass(force, F=0.4, c=0.1, name="x"), math.sqrt(2.0), second, harmonics=(3, 3))
        for force in (hb.Cubic(0.3), law)
    )
    U = np.append(0.3 * np.random.default_rng(1).normal(size=scalar.size - 1), 0.9 * math.sqrt(2.0))
    found, expected = (problem.linearise(U, "Omega", **parameters) for problem in (vector, scalar))
    for a, b in ((found.R, expected.R), (found.dR_dX, expected.dR_dX), (found.dR_dp, expected.dR_dp)):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)
    growths = [problem.observe(U, **parameters)["multipliers"][0] for problem in (vector, scalar)]
    assert growths[0] == pytest.approx(growths[1], rel=1e-10)


@pytest.mark.parametrize("g", [0.0, 0.1])
@pytest.mark.parametrize("law", [RADIAL, hb.mechanics.RadialClearance(4.0, 0.1, 0.2)])
def test_derivatives_of_the_balance_are_differences(g, law):
    system = dataclasses.replace(rotor(g), elements=[*hb.mechanics.VectorElement(UNIT, law)])
    problem = hb.harmonic.TorusProblem(hb.HarmonicBalance(system, 3), TorusBasis(3, 2))
    U = np.append(0.3 * np.random.default_rng(2).normal(size=problem.size - 1), 0.37)
    problem, h = problem.with_borders_at(U, {"Omega": 0.8}), 1e-6
    found = problem.linearise(U, "Omega", Omega=0.8)

    def residual(X, Omega=0.8):
        return problem.linearise(X, "", Omega=Omega).R[:-1]  # the scale of the phase condition is not differentiated

    differences = np.array([(residual(U + x) - residual(U - x)) / (2 * h) for x in h * np.eye(len(U))]).T
    np.testing.assert_allclose(differences, found.dR_dX[:-1], rtol=0, atol=2e-7)
    change = (residual(U, 0.8 + h) - residual(U, 0.8 - h)) / (2 * h)
    np.testing.assert_allclose(change, found.dR_dp[:-1], rtol=0, atol=1e-6)


def test_directions_of_an_isotropic_law_are_arbitrary():
    turned = np.array([[0.6, 0.8], [-0.8, 0.6]])
    first, second = (
        hb.harmonic.TorusProblem(hb.HarmonicBalance(rotor(0.1, directions), 3), TorusBasis(3, 2))
        for directions in (UNIT, turned)
    )
    d = 0.3 * np.random.default_rng(3).normal(size=(2, first.basis.width))
    parameters = {"Omega": 0.8}
    results = []
    for problem, rows in ((first, d), (second, turned @ d)):
        U = np.append(rows.ravel(), 0.37)
        R = problem.linearise(U, "", **parameters).R[:-1].reshape(2, -1)
        results.append((R, problem.observe(U, **parameters)["multipliers"][0]))
    np.testing.assert_allclose(results[1][0], turned @ results[0][0], rtol=0, atol=1e-12)
    assert results[1][1] == pytest.approx(results[0][1], rel=1e-9)


def test_a_varying_law_of_several_displacements_follows_one_frequency():
    """It followed the frequency of its first element, without a message."""

    class Varying(hb.mechanics.VectorLaw):
        size, rated, steady = 2, False, False

        def force(self, d, v, tau):
            k = 1 + 0.2 * np.cos(tau)
            return k * d, k * UNIT[:, :, None], np.zeros((2, 2, len(tau)))

    def problem(law, elements):
        system = dataclasses.replace(rotor(), elements=[*hb.mechanics.VectorElement(UNIT, law, name="seal")])
        return hb.harmonic.TwoToneProblem(system, math.sqrt(2.0), elements=elements, harmonics=(3, 3))

    with pytest.raises(ValueError, match=r"one frequency; add seal 1 to elements"):
        problem(Varying(), ["seal 2"])
    assert problem(Varying(), ["seal 1", "seal 2"]).size == problem(RADIAL, ["seal 2"]).size


@pytest.mark.slow
def test_errors_of_the_whirl_of_a_rub_with_friction_at_a_neimark_sacker_point():
    """The tori are unstable: shooting in the rotating frame, with cycles of the frequency 2 Omega - Omega_2."""
    k, gap, mu, e = 2.0, 0.3, 0.1, 0.2
    seal = hb.mechanics.VectorElement(UNIT, hb.mechanics.RadialClearance(k, gap, mu))
    unbalance = hb.Load(cosine={1: [e, 0.0]}, sine={1: [0.0, e]}, power=2)
    system = hb.System(UNIT, C * UNIT, UNIT, [*seal], unbalance)
    curve = hb.trace(hb.HarmonicBalance(system, 5), "Omega", (1.75, 1.65), accuracy=None)
    tori = hb.analysis.torus(curve, "NS1", (1.65, 1.715), harmonics=(7, 7))
    point, W = tori[-1], float(tori.values[-1])

    def flow(s, T, t=None):
        def rate(t, s):
            z, v = s[0] + 1j * s[1], s[2] + 1j * s[3]
            a = e * W**2 - (C + 2j * W) * v - (1 - W**2 + 1j * C * W) * z
            a -= k * (1 + 1j * mu) * max(1 - gap / abs(z), 0.0) * z
            return [v.real, v.imag, a.real, a.imag]

        return scipy.integrate.solve_ivp(rate, (0, T), s, "DOP853", t, rtol=1e-11, atol=1e-13).y

    Omega_2, basis = tori.tracked["Omega_2"][-1], tori.problem.basis
    q = tori.problem.motion(point.X, **point.parameters)
    x, y = q.sum(axis=1).real
    vx, vy = (q * (1j * (basis.k @ [W, Omega_2]))).sum(axis=1).real
    guess = np.array([x, y, vx + W * y, vy - W * x])
    across = flow(guess, 1e-6)[:, -1] - guess

    def closes(u):
        return np.append(flow(u[:4], u[4])[:, -1] - u[:4], across @ (u[:4] - guess) * 1e6)

    u = scipy.optimize.fsolve(closes, np.append(guess, 2 * math.pi / (2 * W - Omega_2)), xtol=1e-12)
    assert np.abs(closes(u)).max() < 1e-10
    z = flow(u[:4], u[4], u[4] * np.arange(1024) / 1024)
    rms = math.sqrt(np.mean(z[0] ** 2 + z[1] ** 2) / 2)
    changes = abs((2 * W - 2 * math.pi / u[4]) / Omega_2 - 1), math.sqrt(2) * abs(tori.amplitude("rms", 0)[-1] - rms)
    assert 1e-6 < changes[0] < 3 * tori.unknown_errors["Omega_2"] and 1e-6 < changes[1] < 3 * tori.error[-1]
    h = 1e-6 * np.eye(4)
    mu_cycle = np.linalg.eigvals([(flow(u[:4] + x, u[4])[:, -1] - flow(u[:4] - x, u[4])[:, -1]) / 2e-6 for x in h])
    factor = np.abs(mu_cycle[np.abs(mu_cycle - 1) > 1e-3]).max() ** (2 * math.pi / (W * u[4]))
    assert factor > 1 and abs(abs(tori.multipliers[-1, 0]) - factor) < tori.modulus_error[-1]
    assert "unstable" in tori.stability


@pytest.mark.slow
def test_rub_with_two_loads_is_that_of_time_integration():
    second, Omega, ratio = np.array([0.02, 0.05]), 0.8, math.sqrt(2.0)
    law, damping = hb.mechanics.RadialClearance(2.0, 0.2, 0.2), 0.3
    load = hb.Load(cosine={1: [E, 0.0]}, sine={1: [0.0, E]})
    system = hb.System(UNIT, damping * UNIT, UNIT, [*hb.mechanics.VectorElement(UNIT, law)], load)
    span, loads = (Omega, Omega + 1e-3), hb.Load(cosine={1: second})
    tori = hb.analysis.two_tones(system, ratio, span, load=loads, harmonics=(9, 9))

    def rate(t, s):
        p = law.force(s[:2, None], s[2:, None], np.zeros(1))[0][:, 0]
        unbalance = E * np.array([math.cos(Omega * t), math.sin(Omega * t)])
        return np.concatenate([s[2:], unbalance + second * math.cos(ratio * Omega * t) - damping * s[2:] - s[:2] - p])

    t = np.linspace(150, 1500, 20001)
    x = scipy.integrate.solve_ivp(rate, (0, 1500), np.zeros(4), "DOP853", t, rtol=1e-8, atol=1e-10).y[0]
    weights = np.exp(-1 / np.maximum(1 - np.linspace(-1, 1, len(t)) ** 2, 1e-9))  # averages without end effects
    mean = np.average(x, weights=weights)
    rms = math.sqrt(np.average((x - mean) ** 2, weights=weights))
    assert abs(tori.amplitude("rms", 0)[0] - rms) < 3 * tori.error[0] < 6e-4
    assert tori.stability[0] == "stable"
