"""Neimark-Sacker points of limit cycles against multipliers by integration."""

import dataclasses
from functools import partial

import numpy as np
import pytest
import scipy
from machines import VanDerPol, single_mass, van_der_pol

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from hbgear.harmonic.autonomous.cycle_events import CycleDoublingEvent, CycleTorusEvent

MU, ZETA = 0.05, 0.05


@hb.mechanics.model
def absorber(eps: float = 0.1) -> hb.System:
    """A van der Pol oscillator with a tuned mass on it."""
    c, k = 2 * ZETA * MU, MU
    springs = [hb.Element([1.0, 0.0], VanDerPol(eps))]
    return hb.System(np.diag([1.0, MU]), [[c, -c], [-c, c]], [[1 + k, -k], [-k, k]], springs)


@pytest.mark.slow
def test_neimark_sacker_point_of_a_limit_cycle_has_a_pair_of_modulus_one():
    second = hb.analysis.hopf_points(absorber(), "eps", (0.0, 0.3))[1]
    cycles = hb.analysis.limit_cycles(absorber(), second, (0.0, 0.3), harmonics=13)
    assert [point.label for point in cycles.special] == ["NS1"]
    point = cycles["NS1"]
    after = int(point.index) + 1
    assert not cycles.stable[0] and cycles.stable[after]
    eps, T = point.parameters["eps"], 2 * np.pi / point.parameters["Omega"]
    c, k = 2 * ZETA * MU, MU

    def rates(t, y):
        x, v, Y = y[:2], y[2:4], y[4:].reshape(4, 4)
        force = -eps * (x[0] ** 2 - 1) * v[0] - x[0]
        link = k * (x[1] - x[0]) + c * (v[1] - v[0])
        J = np.zeros((4, 4))
        J[0, 2] = J[1, 3] = 1.0
        J[2] = [-1 - 2 * eps * x[0] * v[0] - k, k, -eps * (x[0] ** 2 - 1) - c, c]
        J[3] = np.array([k, -k, c, -c]) / MU
        return np.concatenate([v, [force + link, -link / MU], (J @ Y).ravel()])

    def flow(start, T):
        y0 = np.concatenate([start, np.eye(4).ravel()])
        y = scipy.integrate.solve_ivp(rates, (0, T), y0, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        return y[:4], y[4:].reshape(4, 4)

    problem = cycles.problem.problem
    rows = problem.motion(point.X, **{name: x for name, x in point.parameters.items()})
    x = np.concatenate([rows[:, 0] + rows[:, 1::2].sum(axis=1), np.zeros(2)])
    order = np.arange(1, rows.shape[1] // 2 + 1)
    x[2:] = point.parameters["Omega"] * (rows[:, 2::2] * order).sum(axis=1)
    for _ in range(4):  # Newton in the state and the period, orthogonal to the flow
        end, Phi = flow(x, T)
        f = rates(0.0, np.concatenate([x, np.eye(4).ravel()]))[:4]
        A = np.block([[Phi - np.eye(4), rates(0.0, np.concatenate([end, np.eye(4).ravel()]))[:4, None]], [f, 0.0]])
        change = np.linalg.solve(A, np.append(x - end, 0.0))
        x, T = x + change[:4], T + change[4]
    assert np.abs(change).max() < 1e-9
    mu = np.linalg.eigvals(flow(x, T)[1])
    pair = mu[np.abs(mu.imag) > 0.1]
    assert len(pair) == 2 and np.abs(np.abs(pair) - 1).max() < 1e-6
    assert pytest.approx(2 * np.pi / point.parameters["Omega"], abs=1e-8) == T
    ends = [after - 2, after]
    slope = np.diff(np.log(np.abs(cycles.multipliers[ends]).max(axis=1)))[0] / np.diff(cycles.values[ends])[0]
    assert np.log(np.abs(pair).max()) / abs(slope) < point.error < 1e-8  # mostly that of the multipliers, 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1e-1, 1e-3])
@pytest.mark.parametrize("stiffness", [1.3, 5.0])
def test_the_stated_error_of_a_slow_passage_contains_that_of_the_multipliers(rate, stiffness):
    """|mu| = exp(-c T / 2) of an oscillator at rest next to a limit cycle, with c = rate (p - 0.3): zero at p = 0.3.

    The slower the passage, the more the rounding of the multipliers moves it.
    """

    @hb.mechanics.model
    def passing(p: float = 0.5) -> hb.System:
        system = beside().system()
        C, K = np.diag([0.0, rate * (p - 0.3), 0.3]), np.diag([1.0, stiffness, 3.3])
        return hb.System(system.M, C, K, system.elements)

    motion = hb.time.integrate(passing(), [2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 20, 1.0, tolerance=1e-9, samples=256)
    cycles = hb.analysis.limit_cycles(passing(), motion, (0.6, 0.05), parameter="p", harmonics=9)
    (point,) = cycles.special
    assert point.kind == "NS" and abs(point.parameters["p"] - 0.3) < point.error < 1e-10 / rate


@hb.mechanics.model
def servo(gain: float = 0.4, backlash: float = 0.1) -> hb.System:
    """A motor that controls the position of a load behind a backlash; its equilibrium is a range of positions."""
    mesh = hb.Element([1.0, -1.0], hb.mechanics.KelvinVoigt(k=20.0, c=0.4, gap=backlash / 2, sides=2), name="mesh")
    load = hb.Element([0.0, 1.0], hb.Cubic(0.0), name="load")
    control = [[0.0, gain], [0.0, 0.0]]
    return hb.System(np.eye(2), [[0.3, 0.0], [0.0, 0.1]], control, [mesh, load])


@pytest.fixture(scope="module")
def hunting():
    return hb.time.integrate(servo(), [0.3, 0.3, 0.0, 0.0], 80, 0.5, tolerance=1e-9, samples=512)


@pytest.mark.slow
def test_limit_cycles_from_an_integrated_motion(hunting):
    """The servo has no Hopf point. The motion repeats after the period of the cycle at the gain of the integration."""
    cycles = hb.analysis.limit_cycles(servo(), hunting, (0.38, 0.42), parameter="gain", harmonics=96)
    assert cycles.values[[0, -1]].tolist() == [0.38, 0.42]
    assert cycles.stable.all()
    point = cycles[int(np.abs(cycles.values - 0.4).argmin())]
    assert point.parameters["gain"] == 0.4
    Omega, t, x = point.parameters["Omega"], hunting.tau / 0.5, hunting.d[1]
    rising = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))[-9:]
    zeros = t[rising] - x[rising] * (t[rising + 1] - t[rising]) / (x[rising + 1] - x[rising])
    assert pytest.approx(8 * 2 * np.pi / (zeros[-1] - zeros[0]), rel=5e-5) == Omega
    assert pytest.approx(np.ptp(x[-4096:]) / 2, rel=1e-3) == point.amplitude("pp2", "load")


@pytest.mark.slow
def test_a_curve_ends_at_a_family_of_motions_in_the_gap():
    """A damper that acts in the gap makes the motion there linear: at one gain it has any amplitude and position."""

    @hb.mechanics.model
    def damped(gain: float = 0.4) -> hb.System:
        mesh = hb.Element([1.0, -1.0], hb.Backlash(b=0.05, k=20.0), damping=0.4, name="mesh")
        load = hb.Element([0.0, 1.0], hb.Cubic(0.0), name="load")
        return hb.System(np.eye(2), [[0.3, 0.0], [0.0, 0.02]], [[0.0, gain], [0.0, 0.0]], [mesh, load])

    motion = hb.time.integrate(damped(), [0.3, 0.3, 0.0, 0.0], 150, 0.5, tolerance=1e-9)
    cycles = hb.analysis.limit_cycles(damped(), motion, (0.2, 0.8), parameter="gain", harmonics=16)
    assert "a family of solutions, which are not isolated, lies at gain = 0.3752" in cycles.message
    C, K = np.array([[0.7, -0.4], [-0.4, 0.42]]), np.array([[0.0, 0.3752], [0.0, 0.0]])
    roots = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -C]]))
    assert np.abs(roots.real).min() < 1e-9 < roots.imag.max()


def test_a_motion_leads_to_the_cycles_of_the_hopf_point():
    """Van der Pol with eps = .2: the frequency is known to ten digits."""
    motion = hb.time.integrate(van_der_pol(), [0.5, 0.0], 12, 1.0, tolerance=1e-8)
    cycles = hb.analysis.limit_cycles(van_der_pol(), motion, (-0.1, 0.1), parameter="damping", harmonics=9)
    point = cycles[int(np.abs(cycles.values).argmin())]
    assert point.parameters == {"eps": 0.2, "damping": 0.0, "Omega": pytest.approx(0.99750885636, abs=1e-9)}
    assert cycles.values[[0, -1]].tolist() == [-0.1, 0.1]


def test_what_limit_cycles_do_not_have_is_stated():
    """Branches of cycles and equations of their points: the advice is another method, not a point of the same kind."""
    motion = hb.time.integrate(van_der_pol(), [0.5, 0.0], 12, 1.0, tolerance=1e-8)
    curve = hb.analysis.limit_cycles(
        van_der_pol(), motion, (-0.1, 0.1), parameter="damping", harmonics=5, accuracy=None
    )
    fields = {field.name: getattr(curve[3], field.name) for field in dataclasses.fields(hb.Point)}
    for event in (CycleDoublingEvent(), CycleTorusEvent()):
        given = {"label": f"{event.kind}1", "kind": event.kind, "meaning": event.meaning, "event": event, "index": 3}
        marked = dataclasses.replace(curve, special=(hb.SpecialPoint(**{**fields, **given}),))
        with pytest.raises(
            ValueError, match=f"{event.kind}1 is a {event.name}, from which no branch .*hb.time.integrate"
        ):
            hb.switch(marked, f"{event.kind}1")
        with pytest.raises(ValueError, match="no equations are known for it on this curve; trace the curve again"):
            hb.follow(marked, f"{event.kind}1", "eps", (0.1, 0.3))
    with pytest.raises(ValueError, match="limit cycles have no excitation"):
        hb.time.validate(curve)
    backbone = hb.analysis.backbone(hb.Duffing(), span=(0.01, 0.1), harmonics=3)
    with pytest.raises(ValueError, match="a backbone has no excitation"):
        hb.time.validate(backbone)


def test_motions_that_are_no_limit_cycles_are_refused(hunting):
    cycles = partial(hb.analysis.limit_cycles, servo())
    with pytest.raises(ValueError, match=r"give parameter=, the name of a parameter of the model \(gain, backlash\)"):
        cycles(hunting, (0.3, 0.5))
    with pytest.raises(KeyError, match="no parameter 'gains'; did you mean 'gain'"):
        cycles(hunting, (0.3, 0.5), parameter="gains")
    with pytest.raises(ValueError, match=r"the model has gain = 0.4, outside the span \(0.5, 0.6\)"):
        cycles(hunting, (0.5, 0.6), parameter="gain")
    still = hb.time.integrate(van_der_pol(damping=1.0), [0.5, 0.0], 30, 1.0, tolerance=1e-8)
    with pytest.raises(ValueError, match="the motion comes to rest"):
        hb.analysis.limit_cycles(van_der_pol(damping=1.0), still, (0.9, 1.1), parameter="damping")
    short = hb.time.integrate(servo(), [0.3, 0.3, 0.0, 0.0], 1, 0.5, tolerance=1e-8)
    with pytest.raises(ValueError, match="does not repeat: the state nearest to its last one differs by"):
        cycles(short, (0.3, 0.5), parameter="gain")
    with pytest.raises(TypeError, match="needs a point of hopf_points or a motion of hb"):
        cycles([1.0, 2.0], (0.3, 0.5), parameter="gain")


def test_functions_of_the_multipliers_change_sign_at_the_circle():
    doubling, torus = CycleDoublingEvent(), CycleTorusEvent()
    assert doubling.functions(np.array([-0.99, 0.3]))[0] > 0 > doubling.functions(np.array([-1.01, 0.3]))[0]
    pair = np.array([0.3 + 0.8j, 0.3 - 0.8j])
    inside, outside = pair / abs(pair[0]) * 0.99, pair / abs(pair[0]) * 1.01
    assert torus.functions(inside)[0] < 0 < torus.functions(outside)[0]
    assert torus.occurs(inside)
    assert not torus.occurs(np.array([1.0 + 1e-7j, -0.5]))  # a fold: one part of the double multiplier, by rounding


@hb.mechanics.model
def beside(first: float = 0.3, second: float = 0.3) -> hb.System:
    """A van der Pol oscillator, and two oscillators at rest: their multipliers are exp(s T), s = -c / 2 + i w."""
    springs = [hb.Element([1.0, 0.0, 0.0], VanDerPol(0.3)), *(hb.Element(w, hb.Cubic(0.0)) for w in np.eye(3)[1:])]
    return hb.System(np.eye(3), np.diag([0.0, first, second]), np.diag([1.0, 2.0, 3.3]), springs)


@pytest.fixture(scope="module")
def settled():
    return hb.time.integrate(beside(), [2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 20, 1.0, tolerance=1e-9, samples=256)


@pytest.mark.parametrize("second, span", [(-0.35, (0.1, 0.6)), (0.01, (0.5, -0.2)), (0.35, (0.5, -0.2))])
def test_a_pair_passes_the_circle_next_to_another_pair(settled, second, span):
    """One pair passes at zero damping; the distances of both pairs from the circle are equal elsewhere."""
    own = beside(first=span[0], second=second)
    cycles = hb.analysis.limit_cycles(own, settled, span, parameter="first", harmonics=9)
    found = [point.parameters["first"] for point in cycles.special]
    assert len(found) == (min(span) < 0 < max(span))
    assert np.abs(found).max(initial=0.0) < 1e-12


def test_two_equal_pairs_that_pass_together_are_one_point(settled):
    both = hb.mechanics.model(_equal)
    cycles = hb.analysis.limit_cycles(both(), settled, (0.5, -0.2), parameter="damping", harmonics=9)
    assert [(point.kind, abs(point.parameters["damping"]) < 1e-12) for point in cycles.special] == [("NS", True)]
    assert cycles.warnings == ()  # the value is zero up to rounding, and so is its error


def _equal(damping: float = 0.5) -> hb.System:
    """Three oscillators, of which two are equal and without motion."""
    system = beside().system()
    return hb.System(system.M, np.diag([0.0, damping, damping]), np.diag([1.0, 2.0, 2.0]), system.elements)


def test_newton_starts_exactly_at_a_natural_frequency_of_an_undamped_structure():
    """There the receptance of K + k is infinite, and its inverse K - Omega^2 M is not."""

    @hb.mechanics.model
    def sprung(eps: float = 0.2) -> hb.System:
        return single_mass(hb.mechanics.Parallel((hb.Cubic(0.0, 0.5), VanDerPol(eps))), c=0.0, k=0.5)

    problem = hb.harmonic.LimitCycleProblem(hb.HarmonicBalance(sprung(), 9))
    balance = problem.problem.compiled({})
    assert balance.structure.kr == pytest.approx(0.5)
    part = balance.linear(1.0)
    np.testing.assert_allclose(part.Z[:, 0, 0], 0.5 - np.arange(10) ** 2, rtol=1e-9)
    X = np.zeros(20)
    X[1], X[-1] = 2.0, 1.0
    started = problem.with_borders_at(X, problem.parameters)
    Omega = solve(started, X, problem.parameters).X[-1]
    assert Omega == pytest.approx(0.99750885636, abs=1e-9)
