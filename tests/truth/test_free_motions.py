"""Backbones, Hopf points and limit cycles against closed forms and shooting."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
import scipy
from machines import VanDerPol, single_mass, van_der_pol

import hbgear as hb
from hbgear.harmonic.models import model_registry
from hbgear.mechanics.series.fourier import evaluate


def unloaded(b: float = 1.0, k: float = 1.0) -> hb.System:
    return single_mass(hb.Backlash(b=b, k=k), c=None, k=0.0)


def backlash_frequency(A: np.ndarray) -> np.ndarray:
    """Return the frequency of the unloaded backlash oscillator, half gap and stiffness 1, at a largest displacement."""
    return 1 / (1 + 2 / (math.pi * (A - 1)))


def test_the_unloaded_backlash_oscillator_has_its_closed_form():
    curve = hb.analysis.backbone(unloaded(), span=(6.0, 2.0), harmonics=32)
    A = curve.amplitude("max")
    assert np.abs(curve.tracked["Omega"] - backlash_frequency(A)).max() < 2e-6
    assert np.abs(curve.tracked["modal_damping"]).max() < 1e-12


def test_the_backbone_converges_with_the_harmonics():
    errors = []
    for H in (8, 16, 32):
        curve = hb.analysis.backbone(unloaded(), span=(3.0, 2.9), harmonics=H)
        errors.append(abs(curve.tracked["Omega"][0] - backlash_frequency(curve.amplitude("max")[0])))
    assert errors[0] > 8 * errors[1] > 64 * errors[2]


@pytest.mark.parametrize("F, A", [(0.1, 1.4), (0.3, 2.8)])
def test_a_loaded_backlash_oscillator_leaves_the_linear_frequency_where_contact_is_lost(F, A):
    """x = 1 + F + a cos in contact; free flight under the force F until the flank is met again."""
    system = single_mass(hb.Backlash(), mean=F, c=None, k=0.0)
    curve = hb.analysis.backbone(system, span=(0.01, 1.6), harmonics=40)
    at = np.interp(A, curve.amplitude("max"), np.arange(len(curve)))
    near = curve[int(at)]
    a = float(near.amplitude("max")) - 1 - F
    assert abs(near.parameters["Omega"] - flight_frequency(F, a)) < 5e-6
    closed = curve.amplitude("max") < 1 + 2 * F
    assert np.abs(curve.tracked["Omega"][closed] - 1).max() < 1e-9


def flight_frequency(F: float, a: float) -> float:
    """Return the frequency for x = 1 + F + a cos in contact at x > 1, and no stiffness for -1 < x < 1."""
    leave = math.acos(-F / a)
    v = a * math.sin(leave)  # speed at x = 1; the force F returns the mass
    if v**2 / (2 * F) <= 2:  # it does not reach the other flank
        return 2 * math.pi / (2 * leave + 2 * v / F)
    w = math.sqrt(v**2 - 4 * F)  # speed at x = -1
    across = (v - w) / F
    r = math.hypot(F, w)  # x = -1 + F - r cos(t - t0) at the other flank
    back = 2 * (math.pi - math.acos(-F / r)) if r > F else 0.0
    return 2 * math.pi / (2 * leave + 2 * across + back)


def test_a_cubic_oscillator_has_the_frequency_of_its_elliptic_integral():
    k3, zeta = 0.5, 0.0
    system = single_mass(hb.Cubic(k3), c=2 * zeta)
    curve = hb.analysis.backbone(system, span=(0.05, 2.0), harmonics=20)
    x, w = np.polynomial.legendre.leggauss(60)
    angle = math.pi / 4 * (x + 1)
    for A, Omega in zip(curve.amplitude("max"), curve.tracked["Omega"], strict=True):
        quarter = math.pi / 4 * np.sum(w / np.sqrt(1 + 0.5 * k3 * A**2 * (1 + np.sin(angle) ** 2)))
        assert abs(Omega - math.pi / (2 * quarter)) < 1e-10


@pytest.mark.parametrize(
    "mode, q1, omega, energy",
    [(1, 2.0, 1.5169614506422335, 8.78823145791752), (2, 2.0, 2.011087756939591, 9.617487479919205)],
)
def test_two_masses_with_cubic_springs_agree_with_shooting(mode, q1, omega, energy):
    problem = hb.harmonic.BackboneProblem(two_masses(), mode, 13)
    hit = hb.Event("amplitude", lambda point: point.amplitude("max", 0) - q1)
    curve = hb.trace(problem, "amplitude", (1.0, 3.0), cover=False, events=[hit])
    point = curve["amplitude1"]
    assert abs(point.parameters["Omega"] - omega) < 1e-8
    own = hb.trace(
        problem,
        "amplitude",
        (point.parameters["amplitude"], 3.0),
        point,
        cover=False,
        steps=hb.StepControl(max_points=2),
    )
    assert abs(hb.analysis.backbone_energy(own)[0] / energy - 1) < 1e-8


def two_masses() -> hb.System:
    springs = [hb.Element([1, 0], hb.Cubic(0.5)), hb.Element([0, 1], hb.Cubic(0.3))]
    return hb.System(np.eye(2), None, [[2.0, -1.0], [-1.0, 2.0]], springs)


def test_energy_grows_with_the_action():
    """dE = Omega dJ with the action J = int v^2 dt / 2 pi, computed from the harmonics of the coordinates alone."""
    curve = hb.analysis.backbone(two_masses(), span=(0.5, 1.0), harmonics=9)
    k = np.repeat(np.arange(1, 10), 2)
    rows = np.array([curve.problem.motion(point.X, **point.parameters)[:, 1:] * k for point in curve])
    action, Omega = 0.5 * curve.tracked["Omega"] * np.sum(rows**2, axis=(1, 2)), curve.tracked["Omega"]
    slope = np.diff(hb.analysis.backbone_energy(curve)) / np.diff(action)
    assert np.abs(slope / (0.5 * (Omega[1:] + Omega[:-1])) - 1).max() < 1e-4


def test_resonance_lies_on_the_backbone_of_a_lightly_damped_pair():
    model = hb.Duffing(zeta=0.005, F=0.02)
    response = hb.trace(hb.HarmonicBalance(model, 9), "Omega", (0.8, 1.8))
    peak = hb.analysis.peaks(response, "rms")[0]
    curve = hb.analysis.backbone(model, span=(0.01, 2.0), harmonics=9)
    Omega = np.interp(peak.amplitude("rms"), curve.values, curve.tracked["Omega"])
    assert abs(Omega - peak.parameters["Omega"]) < 2e-4
    # F cos at phase resonance: F = 2 D Omega^2 q_1
    D = np.interp(peak.amplitude("rms"), curve.values, curve.tracked["modal_damping"])
    assert abs(2 * D * Omega**2 * peak.amplitude("H1") / 0.02 - 1) < 2e-3


def test_backbones_do_not_depend_on_units():
    length, time = 1e-6, 1e3
    curve = hb.analysis.backbone(unloaded(), span=(3.0, 2.0), harmonics=12)
    scaled = single_mass(hb.Backlash(b=length, k=1 / time**2), c=None, k=0.0)
    other = hb.analysis.backbone(scaled, span=(3.0 * length, 2.0 * length), harmonics=12)
    assert abs(other.tracked["Omega"][-1] * time - curve.tracked["Omega"][-1]) < 1e-9


def test_a_model_without_a_mode_of_the_number_is_refused():
    with pytest.raises(ValueError, match="give a number up to 1"):
        hb.analysis.backbone(hb.Duffing(), mode=2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "eps, omega, amplitude, rms, multiplier, harmonics",
    [
        (0.2, 0.9975088563587282, 2.000413678992092, 1.415095799728286, 0.282826994188057, 12),
        (1.0, 0.94295584744161, 2.0086198608748598, 1.4350529588979852, 0.0008596950636079459, 20),
        (3.0, 0.7092355317061698, 2.0233041416822153, 1.5208671301735879, 1.7763568394002505e-15, 80),
    ],
)
def test_the_van_der_pol_cycle_agrees_with_shooting(eps, omega, amplitude, rms, multiplier, harmonics):
    """The rms of displacement and of velocity are equal."""
    model = van_der_pol(eps)
    (hopf,) = hb.analysis.hopf_points(model, "damping", (2 * eps, -0.5))
    assert abs(hopf.value - eps) < 1e-10
    assert abs(hopf.Omega - 1) < 1e-10
    cycles = hb.analysis.limit_cycles(model, hopf, (0.0, 2 * eps), harmonics=harmonics)
    last = cycles[-1]
    assert last.parameters["damping"] == 0
    assert abs(last.parameters["Omega"] - omega) < 1e-9
    assert abs(last.amplitude("pp2") - amplitude) < 1e-6
    assert abs(last.amplitude("rms") - rms) < 1e-8
    assert abs(cycles.amplitude("rms", derivative=1)[-1] - rms) < 1e-8
    assert abs(last.multipliers[0] - multiplier) < 1e-6
    assert last.stable


@dataclass(frozen=True)
class Quartic(hb.mechanics.Law):
    eps: float = 0.1

    def force(self, d, v, tau):
        g = d**4 - 2 * d**2
        return self.eps * g * v, self.eps * (4 * d**3 - 4 * d) * v, self.eps * g


@hb.mechanics.model
def subcritical(damping: float = 0.1) -> hb.System:
    return single_mass(Quartic(), c=damping)


@pytest.mark.slow
def test_a_subcritical_hopf_point_leads_to_a_fold_of_cycles():
    """x'' + eps (c - 2 x^2 + x^4) x' + x = 0: averaging gives c = A^2 / 2 - A^4 / 8, a fold at A^2 = 2, c = 1/2."""
    (hopf,) = hb.analysis.hopf_points(subcritical(), "damping", (0.1, -0.1))
    cycles = hb.analysis.limit_cycles(subcritical(), hopf, (-0.02, 0.1), harmonics=7)
    fold = cycles["LP1"]
    assert abs(fold.parameters["damping"] / 0.1 - 0.5) < 2e-3  # averaging has an error of order eps^2
    assert abs(fold.amplitude("H1") ** 2 - 2) < 1e-2
    assert not cycles[3].stable
    assert cycles[-1].stable
    assert abs(cycles[-1].parameters["damping"] + 0.02) < 1e-12


def test_flutter_of_two_coordinates_begins_where_frequencies_meet():
    """K = [[2, -p], [p, 1]] without damping: s^4 + 3 s^2 + 2 + p^2 = 0 has complex s^2 for p > 1/2."""

    @hb.mechanics.model
    def panel(p: float = 0.1) -> hb.System:
        springs = [hb.Element([1.0, 0.0], hb.Cubic(1.0)), hb.Element([0.0, 1.0], hb.Cubic(1.0))]
        return hb.System(np.eye(2), 0.02 * np.eye(2), [[2.0, -p], [p, 1.0]], springs)

    (hopf,) = hb.analysis.hopf_points(panel(), "p", (0.1, 1.0))
    # s (s + .02) = lambda, the eigenvalue -3/2 +- i sqrt(p^2 - 1/4): imaginary s = i w needs w^2 = 3/2, .02 w = sqrt(.)
    assert abs(hopf.Omega**2 - 1.5) < 1e-9
    assert abs(hopf.value - math.sqrt(0.25 + 0.02**2 * 1.5)) < 1e-9


def test_an_equilibrium_that_stays_stable_has_no_hopf_point():
    assert hb.analysis.hopf_points(hb.Duffing(), "zeta", (0.01, 0.3)) == ()


@pytest.mark.slow
def test_coordinates_of_a_saved_backbone_are_those_of_the_artificial_damping(tmp_path):
    """Below contact the mode is linear: the ratio of two coordinates is that of an eigenvector."""
    K, M = np.array([[3.0, -1.0], [-1.0, 2.0]]), np.diag([1.0, 0.5])
    model = hb.System(M, 0.02 * K, K, [hb.Element([1.0, 0.0], hb.Unilateral(k=5.0, gap=1.0))])
    curve = hb.analysis.backbone(model, mode=2, span=(0.01, 0.1), harmonics=5)
    curve.save(tmp_path / "curve.npz")
    shape = scipy.linalg.eigh(K, M)[1][:, 1]
    for one in (curve, hb.load(tmp_path / "curve.npz")):
        ratio = one.amplitude("rms", dof=1) / one.amplitude("rms", dof=0)
        np.testing.assert_allclose(ratio, abs(shape[1] / shape[0]), rtol=1e-9)
        np.testing.assert_allclose(hb.analysis.backbone_energy(one), hb.analysis.backbone_energy(curve), rtol=1e-12)


@hb.mechanics.model
def driven_van_der_pol(damping: float = 0.0, F: float = 5.0) -> hb.System:
    load = hb.Load(cosine={1: [0.0, F]})
    return hb.System(
        np.eye(2),
        [[damping, 0.0], [0.0, 0.05]],
        [[2.0, -0.5], [-0.5, 3.0]],
        [hb.Element([1.0, 0.0], VanDerPol())],
        load,
    )


@pytest.mark.slow
def test_the_excitation_is_left_out_of_saved_limit_cycles(tmp_path):
    """Coordinates that no element measures are computed from the model in the file, which has its excitation."""
    hopf = hb.analysis.hopf_points(driven_van_der_pol(), "damping", (0.4, 0.0))[-1]
    cycles = hb.analysis.limit_cycles(driven_van_der_pol(), hopf, (0.0, 0.4), harmonics=7, stability=False)
    cycles.save(tmp_path / "cycles.npz")
    meta = hb.load(tmp_path / "cycles.npz").meta
    problem = model_registry.rebuild_traced_problem(meta, type(driven_van_der_pol()))
    saved = hb.load(tmp_path / "cycles.npz", problem=problem)
    amplitude = cycles.amplitude("rms", dof=1)
    np.testing.assert_allclose(saved.amplitude("rms", dof=1), amplitude, rtol=1e-12)
    ratio = amplitude / cycles.amplitude("rms", dof=0)  # of the first harmonic: 0.5 / |3 - Omega^2 + 0.05 i Omega|
    Omega = cycles.tracked["Omega"]
    expected = 0.5 / np.abs(3.0 - Omega[0] ** 2 + 0.05j * Omega[0])
    assert abs(ratio[0] / expected - 1) < 1e-3


@pytest.mark.slow
def test_the_predicted_peak_of_a_linear_oscillator_has_its_closed_form():
    """At phase resonance the amplitude is F / (2 zeta), for a load and a displacement of the support in any phase."""
    for zeta in (0.02, 0.1):
        spring = hb.Element([1.0], hb.Cubic(1e-12))
        load = hb.Load(cosine={1: [0.01], 2: [0.03]}, sine={1: [0.02]})
        M = scipy.sparse.csc_array([[1.0]])
        curve = hb.analysis.backbone(hb.System(M, [[2 * zeta]], [[1.0]], [spring], load), span=(0.01, 3.0))
        (peak,), (double,) = (hb.analysis.predicted_peaks(curve, order) for order in (1, 2))
        assert peak.amplitude == pytest.approx(math.hypot(0.01, 0.02) / (2 * zeta) / math.sqrt(2), rel=1e-5)
        assert peak.Omega == pytest.approx(1.0, abs=1e-9) and peak.is_maximum
        assert double.amplitude == pytest.approx(0.03 / (2 * zeta) / math.sqrt(2), rel=1e-5)
        assert double.Omega == pytest.approx(0.5, abs=1e-9)
        assert hb.analysis.predicted_peaks(curve, 3) == ()
    straight = hb.mechanics.PiecewiseLinear(corners=(5.0,), slopes=(1.0, 1.0))
    moved = hb.Element([1.0], straight, hb.mechanics.Series(cosine=(0.01,)), damping=0.1)
    model = hb.System([[1.0]], None, [[0.0]], [moved], hb.Load(sine={1: [0.02]}))
    (peak,) = hb.analysis.predicted_peaks(hb.analysis.backbone(model, span=(0.01, 1.0)))
    assert peak.amplitude == pytest.approx(abs(0.01 * (1 + 0.1j) - 0.02j) / 0.1 / math.sqrt(2), rel=1e-5)


@pytest.mark.slow
def test_predicted_peaks_have_an_error_of_the_order_of_the_squared_damping():
    errors = []
    for zeta in (0.04, 0.02):
        model = hb.Duffing(zeta=zeta, k3=0.5, F=zeta)
        (peak,) = hb.analysis.predicted_peaks(hb.analysis.backbone(model, span=(0.01, 3.0)))
        exact = highest_peak(model, (0.5, 2.0))
        errors.append([peak.Omega - exact.parameters["Omega"], peak.amplitude - exact.amplitude("rms")])
    assert np.abs(errors[0]).max() < 2e-3
    np.testing.assert_allclose(np.divide(*errors), 4.0, rtol=0.05)


def test_peaks_are_predicted_along_the_amplitude_only(tmp_path):
    """A followed point from a file has the problem of its backbone, but another parameter."""
    lost = hb.follow(hb.analysis.backbone(hb.SpurPair(), span=(0.01, 0.2)), "GR1", "F_m", (0.1, 0.11))
    lost.save(tmp_path / "lost.npz")
    for one, message in ((lost, "a predicted peak is that of a backbone"), (hb.load(tmp_path / "lost.npz"), "in F_m")):
        with pytest.raises(ValueError, match=message):
            hb.analysis.predicted_peaks(one)


@pytest.mark.parametrize(("e", "eps"), [((0.02,), ()), ((0.0,), (0.1,)), ((0.02,), (0.1,))])
def test_predicted_peaks_of_gear_pairs_lie_on_their_response_curves(e, eps):
    """Transmission error, varying stiffness, and both with their phases."""
    pair = hb.SpurPair(zeta=0.01, e=e, eps=eps)
    (peak,) = hb.analysis.predicted_peaks(hb.analysis.backbone(pair, span=(0.005, 3.0)))
    exact = highest_peak(pair, (0.3, 1.2))
    assert peak.Omega == pytest.approx(exact.parameters["Omega"], rel=6e-3)
    assert peak.amplitude == pytest.approx(exact.amplitude("rms"), rel=1e-2)


def highest_peak(model, span):
    curve = hb.trace(hb.HarmonicBalance(model), "Omega", span, stability=False)
    return max(hb.analysis.peaks(curve, "rms"), key=lambda point: point.amplitude("rms"))


def test_a_branch_leaves_the_backbone_of_equal_masses():
    """Equal masses leave the motion in phase; the branch is a motion of one period by integration."""
    springs = [hb.Element([1, 0], hb.Cubic(1.0)), hb.Element([0, 1], hb.Cubic(1.0))]
    K = np.array([[3.0, -2.0], [-2.0, 3.0]])
    curve = hb.analysis.backbone(hb.System(np.eye(2), None, K, springs), span=(0.7, 0.8), harmonics=12)
    for side in (1, -1):
        branch = hb.switch(curve, "BP1", side=side, steps=hb.StepControl(max_points=8))
        point = branch[-1]
        rows, Omega = branch.problem.motion(point.X, **point.parameters), point.parameters["Omega"]
        k = np.arange(1, 13)
        start = np.concatenate([rows[:, 0] + rows[:, 1::2].sum(axis=1), Omega * (rows[:, 2::2] @ k)])
        assert abs(start[0] - start[1]) + abs(start[2] - start[3]) > 0.05
        end = scipy.integrate.solve_ivp(
            lambda t, y: np.concatenate([y[2:], -K @ y[:2] - y[:2] ** 3]),
            (0, 2 * np.pi / Omega),
            start,
            "DOP853",
            rtol=1e-12,
            atol=1e-12,
        ).y[:, -1]
        assert np.abs(end - start).max() < 1e-8


def test_a_closed_branch_of_free_motions_ends_where_it_began():
    """Once around the branch the motion, which is not symmetric in time, has another phase."""
    M = [[2.0, 0.3, 0.0], [0.3, 1.5, 0.1], [0.0, 0.1, 1.0]]
    K = [[3.0, -1.0, 0.0], [-1.0, 2.5, -1.2], [0.0, -1.2, 2.0]]
    laws = hb.Cubic(0.7), hb.Cubic(0.4), hb.Unilateral(k=2.0, gap=0.5)
    elements = [hb.Element(w, law) for w, law in zip([[1, -1, 0], [0, 1, -1], [0, 0, 1]], laws, strict=True)]
    system = hb.System(M, None, K, elements, hb.Load(constant=[0.1, 0.0, 0.2]))
    options = {"special": False, "events": ["BP"], "stability": False, "accuracy": None}
    curve = hb.analysis.backbone(system, span=(0.01, 1.85), harmonics=10, **options)
    branch = hb.switch(curve, "BP1", steps=hb.StepControl(max_points=200), **options)
    assert branch.status is hb.Status.CLOSED
    assert abs(branch.values.max() - curve["BP2"].parameters["amplitude"]) < 1e-4
    assert np.linalg.norm(branch.X[-1] - branch.X[0]) > 0.1 * np.linalg.norm(branch.X[0])


def test_events_of_the_user_on_free_motions_are_followed():
    """A largest displacement of 1.05: the frequency of the elliptic integral over the stiffness, and of the cycle."""
    largest = hb.Event("largest", lambda point: point.amplitude("max") - 1.05)
    fast = hb.Event("fast", lambda point: point.parameters["Omega"] - 1.05)
    model = hb.Duffing(zeta=0.0, k3=0.5)
    curve = hb.analysis.backbone(model, span=(0.01, 1.0), harmonics=16, events=[largest, fast])
    held = hb.follow(curve, "largest1", "k3", (0.5, 0.6))
    assert np.abs(held.amplitude("max") - 1.05).max() < 1e-9
    angle = np.linspace(0.0, math.pi, 33)[:-1]
    for k3, Omega in zip(held.values, held.tracked["Omega"], strict=True):
        rate = np.mean(1 / np.sqrt(1 + 0.5 * k3 * 1.05**2 * (1 + np.sin(angle) ** 2)))
        assert abs(Omega * rate - 1) < 1e-9
    assert np.abs(hb.follow(curve, "fast1", "k3", (0.5, 0.6)).tracked["Omega"] - 1.05).max() < 1e-10


def test_branch_points_of_a_backbone_are_followed():
    """With a cubic stiffness k3 all displacements are proportional to 1 / sqrt(k3), and frequencies are the same."""

    @hb.mechanics.model
    def equal(k3: float = 1.0) -> hb.System:
        springs = [hb.Element([1, 0], hb.Cubic(k3)), hb.Element([0, 1], hb.Cubic(k3))]
        return hb.System(np.eye(2), None, [[3.0, -2.0], [-2.0, 3.0]], springs)

    curve = hb.analysis.backbone(equal(), span=(0.5, 1.0), harmonics=9)
    for label in ("BP1", "BP2"):
        found = hb.follow(curve, label, "k3", (1.0, 1.5))
        scaled = found.tracked["amplitude"] * np.sqrt(found.values)
        assert np.abs(scaled / curve[label].parameters["amplitude"] - 1).max() < 1e-9
        assert np.abs(found.tracked["Omega"] / curve[label].parameters["Omega"] - 1).max() < 1e-9


@dataclass(frozen=True)
class Hysteretic(hb.mechanics.Law):
    """The cycles x = A cos t of m x'' + 0.01 x' + x + law = 0 have level + slope r - r^3 = 0, r = A^2 - 1."""

    slope: float
    level: float

    def force(self, d, v, tau):
        r = d**2 + v**2 - 1
        c, rate = -(self.level + self.slope * r - r**3) - 0.01, 3 * r**2 - self.slope
        return c * v, rate * 2 * d * v, c + rate * 2 * v * v


@hb.mechanics.model
def hysteretic(slope: float = 0.1, level: float = 0.5) -> hb.System:
    return single_mass(Hysteretic(slope, level), c=0.01)


@pytest.mark.slow
def test_jumps_of_limit_cycles_that_start_within_the_span():
    motion = hb.time.integrate(hysteretic(level=0.03), [1.2, 0.0], 60, 1.0, tolerance=1e-9, samples=256)
    cycles = hb.analysis.limit_cycles(
        hysteretic(level=0.03), motion, (-0.05, 0.05), parameter="level", harmonics=3, accuracy=None
    )
    fold = 2 * (0.1 / 3) ** 1.5
    assert sorted((jump.direction, round(jump.value, 9)) for jump in cycles.jumps()) == [
        (-1, round(-fold, 9)),
        (1, round(fold, 9)),
    ]
    landing = [jump.after.amplitude("max") ** 2 - 1 for jump in cycles.jumps()]
    assert np.abs(np.abs(landing) - 2 * math.sqrt(0.1 / 3)).max() < 1e-6  # the other root of fold + slope r = r^3


@pytest.mark.slow
def test_folds_of_limit_cycles_are_followed_to_their_cusp():
    motion = hb.time.integrate(hysteretic(), [1.4, 0.0], 60, 1.0, tolerance=1e-9, samples=256)
    cycles = hb.analysis.limit_cycles(
        hysteretic(), motion, (-0.5, 0.5), parameter="level", harmonics=3, accuracy=None, stability=False
    )
    assert abs(abs(cycles["LP1"].parameters["level"]) - 2 * (0.1 / 3) ** 1.5) < 1e-12
    folds = hb.follow(cycles, "LP1", "slope", (0.1, -0.1), accuracy=None)
    assert np.abs(np.abs(folds.tracked["level"]) - 2 * (folds.values.clip(0.0) / 3) ** 1.5).max() < 1e-12
    cusp = folds["CP1"].parameters
    assert abs(cusp["slope"]) < 1e-12 and abs(cusp["level"]) < 1e-12


def test_energy_of_a_slider_that_sticks_is_that_of_its_spring():
    curve = hb.analysis.backbone(
        single_mass(hb.mechanics.Jenkins(k=0.5, limit=0.1), c=0.0, name="damper"), span=(0.01, 0.1), harmonics=3
    )
    assert set(curve.regimes) == {"stick"}  # up to the amplitude 0.2
    np.testing.assert_allclose(hb.analysis.backbone_energy(curve), 1.5 * curve.values**2, rtol=1e-9)


def test_energy_of_a_coupled_law_is_constant_along_a_motion():
    """V = d1^2 d2^2 / 2 + (d1^4 + d2^4) / 4; the kinetic and potential energy at one instant are those of all."""
    W = np.array([[1.0, 0.5], [0.0, 1.0]])
    law = hb.mechanics.Polynomial(
        exponents=[[1, 2], [2, 1], [3, 0], [0, 3]], coefficients=[[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]
    )
    system = hb.System(np.eye(2), None, np.diag([1.0, 1.3]), [*hb.mechanics.VectorElement(W, law)])
    curve = hb.analysis.backbone(system, span=(0.5, 1.0), harmonics=12, special=False)
    rows = curve.problem.motion(curve.X[-1], **curve.parameters_at(-1))
    x, v = (evaluate(rows, np.array([0.7]), k)[:, 0] for k in (0, 1))
    d1, d2 = W @ x
    kinetic = 0.5 * curve.tracked["Omega"][-1] ** 2 * v @ v
    potential = 0.5 * (x[0] ** 2 + 1.3 * x[1] ** 2 + d1**2 * d2**2) + 0.25 * (d1**4 + d2**4)
    assert hb.analysis.backbone_energy(curve)[-1] == pytest.approx(kinetic + potential, rel=1e-7)
