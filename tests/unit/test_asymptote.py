"""Curves that run off to infinity: it is seen early, and the value they near is that of the machine without gaps."""

from dataclasses import dataclass

import numpy as np
import pytest
from machines import single_mass
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import hbgear as hb
from hbgear import Status
from hbgear.continuation.curve.asymptote import power_law_limit
from hbgear.harmonic.structure.recession import Receded, longest, receded, recession

PAIR = hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,))


def traced(model, harmonics=16, span=(1.5, 0.3), **options):
    options = {"cover": False, "stability": False} | options
    return hb.trace(hb.HarmonicBalance(model, harmonics), "Omega", span, **options)


def instability(pair, Omega):
    """det(Phi - 1) of x'' + 2 zeta x' + k(Omega t) x = 0 over one period: zero where a multiplier is +1."""

    def rate(t, z):
        k = 1 - sum(eps * np.cos((i + 1) * Omega * t) for i, eps in enumerate(pair.eps))
        x, v = z.reshape(2, 2)
        return np.concatenate([v, -2 * pair.zeta * v - k * x])

    end = solve_ivp(rate, (0, 2 * np.pi / Omega), [1, 0, 0, 1], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return np.linalg.det(end.reshape(2, 2) - np.eye(2))


def test_a_pair_with_parametric_resonance_runs_off_to_infinity():
    """It was followed to rms 1e74 and to the last of 5000 points."""
    curve = traced(PAIR)
    assert curve.status is Status.UNBOUNDED and curve.status.complete and len(curve) < 300
    assert 10 < curve.amplitude("rms")[-1] < 50
    assert curve.message == "the curve runs off to infinity towards Omega = 1.04828"
    assert curve.meta["asymptotes"] == curve.asymptotes and list(curve.asymptotes) == ["last"]


@pytest.mark.parametrize(
    "pair",
    [
        PAIR,
        hb.SpurPair(zeta=0.02, eps=(0.1, 0.15), e=(0.03, 0.01), F_m=0.2),
        hb.SpurPair(zeta=0.01, eps=(0.25, 0.12, 0.05), e=(0.05,)),
    ],
)
def test_the_asymptote_is_where_the_pair_without_backlash_has_a_multiplier_of_one(pair):
    """By integration in time, which knows nothing of harmonics."""
    found = traced(pair).asymptotes["last"]
    exact = brentq(lambda Omega: instability(pair, Omega), found - 1e-3, found + 1e-3, xtol=1e-14)
    assert found == pytest.approx(exact, abs=1e-10)


def test_the_curve_nears_its_asymptote_like_one_over_its_size():
    """Far behind the last row of a trace: Omega - asymptote = c / |X|."""
    curve = traced(PAIR)
    problem, far = curve.problem, curve.asymptotes["last"]
    X = curve.X[-1] * 1e4
    Omega = far + (curve.values[-1] - far) / 1e4
    there = hb.trace(problem, "Omega", (Omega, 1.5), hb.HarmonicBalance.resized(problem, X), cover=False)
    c = [(x - far) * np.linalg.norm(row) for x, row in ((curve.values[-1], curve.X[-1]), (Omega, there.X[0]))]
    assert c[1] == pytest.approx(c[0], rel=0.1)


def test_sampled_forces_run_off_at_the_same_frequency():
    curve = hb.trace(hb.HarmonicBalance(PAIR, 8, sampled=True), "Omega", (1.5, 0.3), cover=False, stability=False)
    assert curve.asymptotes["last"] == pytest.approx(traced(PAIR, 8).asymptotes["last"], abs=1e-11)


@pytest.mark.slow
def test_it_is_seen_in_another_parameter_too():
    """Less and less of the variation of stiffness at a frequency that is held."""
    there = traced(PAIR)
    i = int(np.argmax(there.amplitude("rms") > 12))
    curve = hb.trace(there.problem, "eps_scale", (1.0, 0.0), there[i])
    assert curve.status is Status.UNBOUNDED
    scaled = PAIR.replace(eps=tuple(curve.asymptotes["last"] * eps for eps in PAIR.eps))
    Omega = curve.fixed["Omega"]
    slope = (instability(scaled, Omega * 1.001) - instability(scaled, Omega)) / (0.001 * Omega)
    assert abs(instability(scaled, Omega)) < 1e-7 * abs(slope)


@pytest.mark.parametrize(("H", "error"), [(10, 1e-6), (20, 5e-8), (40, 2e-9)])
def test_a_stop_without_damping_leads_to_the_frequency_of_the_bilinear_oscillator(H, error):
    """Far out the gap is nothing: half a period at each stiffness, Omega = 2 w1 w2 / (w1 + w2)."""
    curve = traced(single_mass(hb.Unilateral(k=3.0, gap=0.5), F=0.1, c=None), H, (0.8, 1.8))
    assert curve.status is Status.UNBOUNDED
    assert curve.asymptotes["last"] == pytest.approx(4 / 3, abs=error)


@dataclass(frozen=True)
class Soft(hb.mechanics.Law):
    """p = d - tanh d: a backlash without corners."""

    reference = 1.0

    def force(self, d, v, tau):
        return d - np.tanh(d), np.tanh(d) ** 2, np.zeros_like(d)


def test_a_law_of_the_user_is_sampled_at_large_displacements():
    machine = single_mass(Soft(), F=0.3, c=None, k=0.2)
    curve = traced(machine, 7, (0.3, 1.5))
    assert curve.status is Status.UNBOUNDED and curve.asymptotes["last"] == pytest.approx(1.2**0.5, abs=1e-10)


@pytest.mark.parametrize("zeta", [1e-3, 1e-5])
def test_a_sharp_resonance_that_is_finite_is_followed_over_its_top(zeta):
    curve = traced(hb.Duffing(zeta=zeta, k3=0.0), 1, (0.5, 1.5))
    assert curve.status is Status.REACHED_END and not curve.asymptotes
    assert curve.amplitude("H1").max() == pytest.approx(0.18 / (2 * zeta), rel=0.01)


def test_a_resonance_too_sharp_to_be_followed_is_not_taken_for_one_without_bound():
    curve = traced(hb.Duffing(zeta=1e-8, k3=0.0), 1, (0.5, 1.5))
    assert not curve.asymptotes and curve.amplitude("H1").max() > 1e5


def test_a_large_motion_with_backlash_that_is_finite_is_followed_over_its_top():
    curve = traced(hb.SpurPair(zeta=0.001, e=(0.2,)))
    assert curve.status is not Status.UNBOUNDED and curve.amplitude("rms").max() > 50


def test_a_hardening_spring_has_no_asymptote():
    curve = traced(hb.Duffing(zeta=0.0), 3, (0.5, 2.5))
    assert curve.status is not Status.UNBOUNDED and curve.amplitude("H1").max() > 5


@dataclass(frozen=True)
class Touchy(hb.mechanics.Law):
    """A spring that refuses stiffness it was not made for."""

    k: float
    reference = 1.0

    def force(self, d, v, tau):
        if np.abs(d).max() > 1e6:
            raise ValueError("that far it was never measured")
        return self.k * d, self.k + 0 * d, 0 * d


def test_a_law_that_refuses_large_displacements_stops_no_trace():
    machine = single_mass(Touchy(1.0), F=0.3, c=None, k=0.2)
    curve = traced(machine, 3, (0.3, 1.5), steps=hb.StepControl(max_points=150))
    assert curve.status is Status.MAX_POINTS and not curve.asymptotes


class Hyperbola:
    """(1 - p) x = 1."""

    def evaluate(self, X, p):
        return np.array([(1 - p) * X[0] - 1]), np.array([[1 - p]])

    def recession(self, X, parameters):
        return Line()


class Line:
    def evaluate(self, X, p):
        return (1 - p) * X, np.array([[1 - p]])


def test_any_equations_with_a_limit_at_infinity():
    curve = hb.trace(Hyperbola(), "p", (0.0, 3.0), np.array([1.0]))
    assert curve.status is Status.UNBOUNDED and curve.asymptotes == {"last": pytest.approx(1.0, abs=1e-9)}
    back = hb.trace(Hyperbola(), "p", (3.0, 0.0), np.array([-0.5]))
    assert back.asymptotes == {"last": pytest.approx(1.0, abs=1e-9)} and back.values[-1] > 1


def test_a_span_that_ends_before_the_asymptote_is_reached():
    assert hb.trace(Hyperbola(), "p", (0.0, 0.999), np.array([1.0])).status is Status.REACHED_END


def test_there_is_nothing_to_extend():
    curve = traced(PAIR)
    with pytest.raises(ValueError, match="nothing to extend"):
        hb.extend(curve)


def test_a_curve_that_was_stopped_runs_off_when_it_is_extended():
    part = traced(PAIR, steps=hb.StepControl(max_points=200))
    assert part.status is Status.MAX_POINTS and not part.asymptotes
    whole = hb.extend(part)
    assert whole.status is Status.UNBOUNDED
    assert whole.asymptotes["last"] == pytest.approx(traced(PAIR).asymptotes["last"], abs=1e-11)


# ---- limit cycles, which approach an asymptote by a power law

SPRING, DAMPER = 0.5, 0.3


def maxwell(law, c):
    """A mass with the damping c < 0, a law, and a spring in series with a damper."""
    K = np.array([[1 + SPRING, -SPRING], [-SPRING, SPRING]])
    return hb.System(np.diag([1.0, 0.0]), np.diag([c, DAMPER]), K, [hb.Element([1.0, 0.0], law)])


@hb.mechanics.model
def with_cubic_spring(c: float = 0.1) -> hb.System:
    return maxwell(hb.Cubic(1.0), c)


@hb.mechanics.model
def with_play(c: float = 0.1) -> hb.System:
    return maxwell(hb.mechanics.PiecewiseLinear((-1.0, 1.0), (1.0, 0.0, 1.0)), c)


def cycles(model, span, length=1.0, **options):
    """The limit cycles from the Hopf point of a model; a search of rounding errors took minutes from 400 points on."""
    (hopf,) = hb.analysis.hopf_points(model(), "c", (0.1, -0.5))
    steps = hb.StepControl(max_points=600)
    return hb.analysis.limit_cycles(model(), hopf, span, harmonics=7, length=length, steps=steps, **options)


@pytest.mark.slow
@pytest.mark.parametrize("end", [0.1, 0.0, -1e-9])
def test_limit_cycles_with_a_cubic_spring_run_off_to_infinity_without_special_points(end):
    """The power of the Maxwell element decreases: c <v^2> = -(k^2 / d) <x^2>, with x = A cn(A t | 1/2) up to A^-2."""
    curve = cycles(with_cubic_spring, (-0.5, end))
    assert curve.status is Status.UNBOUNDED and curve.asymptotes == {"last": pytest.approx(0.0, abs=5e-6)}
    assert curve.message == "the curve runs off to infinity towards c = 0" and not curve.special and len(curve) < 320
    K, E = ellipk(0.5), ellipe(0.5)
    squares = 3 * (2 * E / K - 1) * (np.pi / (2 * K)) ** 2  # Omega^2 <x^2> / <v^2>
    assert curve.values[-1] * curve.tracked["Omega"][-1] ** 2 == pytest.approx(
        -(SPRING**2) / DAMPER * squares, rel=5e-4
    )


@pytest.mark.slow
def test_limit_cycles_reach_the_end_of_a_span_before_the_asymptote():
    curve = cycles(with_cubic_spring, (-0.5, -1e-5))
    assert curve.status is Status.REACHED_END and not curve.asymptotes and not curve.special


@pytest.mark.slow
def test_limit_cycles_with_play_run_off_at_the_hopf_point_of_the_machine_in_contact():
    """Hurwitz: (k + c d) (c k + (2 + k) d) = 2 k d at c = -1/6."""
    curve = cycles(with_play, (-0.5, 0.1), length=40.0)
    assert curve.status is Status.UNBOUNDED and curve.asymptotes["last"] == pytest.approx(-1 / 6, abs=1e-6)


@pytest.mark.slow
def test_a_curve_of_folds_without_bound_ends_as_the_damping_vanishes():
    """It was followed with ever shorter steps. Power at the top of a resonance: 2 zeta Omega sum (n A_n)^2 = F A_1."""
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(zeta=0.02), 3), "Omega", (0.8, 2.5), cover=False)
    folds = hb.follow(curve, "LP1", "zeta", (0.02, 0.0), steps=hb.StepControl(max_points=300))
    assert folds.status is Status.UNBOUNDED and folds.asymptotes["last"] == pytest.approx(0.0, abs=1e-7)
    first, third = (folds.amplitude(name)[-1] for name in ("H1", "H3"))
    power = 2 * folds.values[-1] * folds.tracked["Omega"][-1] * (first**2 + (3 * third) ** 2)
    assert power == pytest.approx(0.18 * first, rel=1e-3)


@pytest.mark.parametrize("k", [0.5, 1.0, 2.0, 6.0])
@pytest.mark.parametrize("second", [0.0, 0.2])
def test_the_limit_of_a_power_law_is_known_to_its_error(k, second):
    r = np.geomspace(1.0, 10.0, 400)
    limit, error = power_law_limit(r, 0.3 - 1e-4 / r**k * (1 + second / r))
    assert abs(limit - 0.3) <= error <= 0.5 * 1e-4 / 10**k


def test_a_finite_top_and_other_laws_are_no_power_laws():
    r = np.geomspace(1.0, 10.0, 400)
    for values in (np.sqrt(1 / r**2 - 0.99e-2), np.log(r), r, np.sin(r), np.full(400, 0.3)):
        assert power_law_limit(r, values) is None


# ---- recession of laws and systems


def test_recession_of_laws():
    tau = np.linspace(0, 6, 12)
    d, still = np.linspace(-3, 3, 12), np.zeros(12)
    mesh = hb.mechanics.Series(mean=1.0, cosine=(0.2,))
    stop = hb.Unilateral(k=2.0, gap=0.7)
    for law, far in (
        (hb.Backlash(b=0.5, k=3.0, stiffness=mesh), 3 * mesh(tau) * d),
        (stop, 2 * np.maximum(d, 0)),
        (hb.mechanics.Parallel((hb.Backlash(b=0.5, stiffness=mesh), stop)), mesh(tau) * d + 2 * np.maximum(d, 0)),
        (hb.Cubic(k3=0.0, k1=1.5), 1.5 * d),
        (Soft(), d),
        (hb.mechanics.Parallel((Soft(), stop)), d + 2 * np.maximum(d, 0)),
    ):
        known = recession(law)
        np.testing.assert_allclose(known.force(d, still, tau)[0], far, atol=1e-10)
        np.testing.assert_allclose(law.force(1e9 * d, still, tau)[0] / 1e9, far, atol=1e-7)
    for law in (hb.Cubic(1.0), hb.mechanics.Parallel((hb.Backlash(), hb.Cubic(-0.1)))):
        assert recession(law) is None


def test_the_reach_of_a_slider_is_a_length_of_the_model():
    """Motions below ten times limit / k are not far larger than all lengths."""
    system = single_mass(hb.mechanics.Jenkins(k=2.0, limit=1.0), F=0.3)
    problem = hb.HarmonicBalance(system, 2)
    small, large = ([0.0, A, 0.0, 0.0, 0.0] for A in (4.9, 5.1))
    assert longest(system) == 0.5 and problem.recession(np.array(small), {}) is None
    assert not problem.recession(np.array(large), {}).model.system().elements[0].law.sliders


def test_recession_of_a_model_keeps_its_parameters():
    far = Receded(PAIR).replace(eps_scale=0.5).system()
    (element,) = far.elements
    assert element.damping == 0.02 and not element.displacement.row().any() and not far.loads[0].vectors()
    assert element.law.stiffness.row()[3] == pytest.approx(-0.1) and not element.law.breakpoints
    assert longest(PAIR.system()) == 1.0 and receded(hb.Duffing().system()) is None
    with pytest.raises(ValueError, match="does not grow in proportion"):
        Receded(hb.Duffing()).system()
