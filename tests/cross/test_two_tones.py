"""Motions with two prescribed frequencies against exact responses, invariant circles and time integration."""

import math

import numpy as np
import pytest
import scipy
from machines import single_mass

import hbgear as hb
from hbgear.analysis.summary import summary_facts
from hbgear.continuation.solvers.newton import solve

RATIO = math.sqrt(2.0)


def duffing(zeta, k3, F) -> hb.System:
    return single_mass(hb.Cubic(k3), F=F, c=2 * zeta)


def velocity_rms(curve, i):
    layout, at = curve.layout, curve.parameters_at(i)
    rows = layout.in_time(layout.rows(curve.X[i], 0), {name: np.array(at[name]) for name in ("Omega", "Omega_2")}, 1)
    return float(layout.measure_rows("rms", rows))


@pytest.mark.slow
def test_a_linear_system_has_the_sum_of_both_responses():
    """Both the load and the prescribed displacement of the second element follow the second frequency."""
    M, C = np.diag([1.0, 2.0]), np.array([[0.06, -0.02], [-0.02, 0.05]])
    linear = hb.mechanics.PiecewiseLinear((), (1.0,))
    displacement = hb.mechanics.Series(mean=0.1, cosine=(0.3,), sine=(0.0, 0.2))
    elements = [
        hb.Element([1.0, 0.0], linear, name="ground"),
        hb.Element([1.0, -1.0], linear, displacement=displacement, damping=0.03, name="mesh"),
    ]
    system = hb.System(M, C, np.diag([0.0, 0.5]), elements, hb.Load(cosine={1: [1.0, 0.0]}, sine={2: [0.0, 0.5]}))
    second = hb.Load(cosine={1: [0.0, 0.7]}, sine={3: [0.2, 0.0]}, power=2)
    curve = hb.analysis.two_tones(system, RATIO, (0.4, 0.5), load=second, elements=["mesh"], harmonics=(4, 4))
    point = curve[-1]
    X = curve.problem.motion(curve.X[-1], **point.parameters)
    W = np.array([[1.0, 1.0], [0.0, -1.0]])
    K, D = np.diag([0.0, 0.5]) + W @ W.T, C + 0.03 * np.outer(W[:, 1], W[:, 1])
    Omega, Omega_2 = 0.5, 0.5 * RATIO
    loads = {(1, 0): [1.0, 0.0], (2, 0): [0.0, -0.5j]}
    for k, e, F in ((1, 0.3, [0.0, 0.7]), (2, -0.2j, [0.0, 0.0]), (3, 0.0, [-0.2j, 0.0])):
        loads[0, k] = Omega_2**2 * np.array(F) + (1 + 0.03j * k * Omega_2) * e * W[:, 1]
    expected = np.zeros_like(X)
    for i, (k1, k2) in enumerate(curve.problem.basis.k.tolist()):
        w = k1 * Omega + k2 * Omega_2
        if (k1, k2) in loads:
            expected[:, i] = np.linalg.solve(K + 1j * w * D - w**2 * M, loads[k1, k2])
        elif (k1, k2) == (0, 0):
            expected[:, i] = np.linalg.solve(K, 0.1 * W[:, 1])
    np.testing.assert_allclose(X, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("F1", "Omega", "F2", "Omega_2", "rms", "rms_v"),
    [
        pytest.param(0.2, 0.8, 0.2, 1.1313708498984762, 0.6874531628127134, 0.7440100444846435, marks=pytest.mark.slow),
        (0.15, 1.2, 0.1, 0.7416407864998739, 0.28247544515112827, 0.30869940103464555),
    ],
)
def test_a_cubic_oscillator_agrees_with_its_invariant_circle(F1, Omega, F2, Omega_2, rms, rms_v):
    second = hb.Load(cosine={1: [F2]})
    curve = hb.analysis.two_tones(duffing(0.05, 0.1, F1), Omega_2 / Omega, (Omega - 0.1, Omega), load=second)
    assert curve.status == "reached_end"
    assert abs(curve[-1].amplitude("rms") - rms) < 1e-10
    assert abs(velocity_rms(curve, -1) - rms_v) < 1e-10


def test_a_gap_agrees_with_pieces_in_closed_form():
    """Averages over 24 000 periods of pieces in closed form; the teeth separate twice per period."""
    system = single_mass(hb.Backlash(1.0), F=0.05, mean=0.1, k=0.0)
    few = hb.StepControl(max_points=2)
    curve = hb.analysis.two_tones(
        system,
        1.905255888325765 / 1.1,
        (1.1, 1.2),
        load=hb.Load(cosine={1: [0.04]}),
        harmonics=(15, 15),
        dense=2,
        steps=few,
    )
    assert abs(curve[0].amplitude("mean") - 1.0894003212714038) < 1e-6
    assert abs(curve[0].amplitude("rms") - 0.10249375260864962) < 1e-6
    assert abs(velocity_rms(curve, 0) - 0.11166870616664852) < 1e-6


def settled(F0, F1, O1, F2, O2, zeta=0.05):
    """Displacements of the oscillator with a gap from Runge-Kutta steps, after 200 of 2300 periods."""
    h, x, v, t = 2 * math.pi / O1 / 64, 1 + F0, 0.0, 0.0
    out = np.empty(2300 * 64)

    def rate(t, x, v):
        force = x - 1 if x > 1 else x + 1 if x < -1 else 0.0
        return F0 + F1 * math.cos(O1 * t) + F2 * math.cos(O2 * t) - 2 * zeta * v - force

    for n in range(len(out)):
        a1 = rate(t, x, v)
        a2 = rate(t + h / 2, x + h / 2 * v, v + h / 2 * a1)
        a3 = rate(t + h / 2, x + h / 2 * (v + h / 2 * a1), v + h / 2 * a2)
        a4 = rate(t + h, x + h * (v + h / 2 * a2), v + h * a3)
        x, v, t = x + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4), (n + 1) * h
        out[n] = x
    return h * np.arange(200 * 64 + 1, len(out) + 1), out[None, 200 * 64 :]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("loads", "half", "mean", "rms", "rms_v"),
    [
        ((0.1, 0.06, 0.75, 0.05, 1.0606601717798214), None, 0.93937491152327, 0.297706536249645, 0.21353094707357015),
        (
            (0.3, 0.1, 0.9, 0.08, 0.5562305898749055),
            (1, 1),
            1.1538858398971235,
            0.5152116423050708,
            0.39380323490236263,
        ),
    ],
)
def test_irregular_impacts_agree_with_pieces_in_closed_form(loads, half, mean, rms, rms_v):
    """Averages over 24 000 periods of pieces in closed form; the second motion lies on a doubled torus."""
    F0, F1, O1, F2, O2 = loads
    system = single_mass(hb.Backlash(1.0), F=F1, mean=F0, k=0.0)
    second = hb.Load(cosine={1: [F2]})
    many = {"harmonics": (150, 90), "band": 15.5, "dense": 2}
    problem = hb.harmonic.TwoToneProblem(system, O2 / O1, second, half=half, **many)
    X = solve(problem, problem.fit(*settled(*loads), O1), {"Omega": O1}).X
    assert abs(problem.layout.measure("mean", X[:-1]) - mean) < 3e-7
    assert abs(problem.layout.measure("rms", X[:-1]) - rms) < 3e-7
    layout, frequencies = problem.layout, {"Omega": np.array(O1), "Omega_2": X[-1]}
    velocities = layout.in_time(layout.rows(X[:-1], 0), frequencies, 1)
    assert abs(layout.measure_rows("rms", velocities) - rms_v) < 3e-7


@pytest.mark.slow
def test_a_doubled_basis_contains_the_motions_of_single_periods(tmp_path):
    """Halves of both phases, a band of frequencies, and files of them."""
    system, load = duffing(0.05, 0.1, 0.1), hb.Load(cosine={1: [0.1]}, power=1)
    single = hb.analysis.two_tones(system, RATIO, (0.5, 0.6), load=load, harmonics=(7, 7))
    doubled = hb.analysis.two_tones(system, RATIO, (0.5, 0.6), load=load, harmonics=(16, 16), band=6.0, half=(1, 0))
    assert doubled[-1].amplitude("rms") == pytest.approx(single[-1].amplitude("rms"), abs=2e-7)
    doubled.save(tmp_path / "doubled.npz")
    again = hb.load(tmp_path / "doubled.npz")
    assert again.amplitude("rms")[-1] == doubled.amplitude("rms")[-1]
    assert again.require_problem().basis.half == (1, 0) and again.require_problem().size == doubled.problem.size


def test_two_meshes_of_varying_stiffness_agree_with_time_integration():
    """The stiffness of each spring varies with its own phase."""
    first, second = (hb.mechanics.Series(mean=1.0, cosine=(depth,)) for depth in (0.2, 0.15))
    springs = [
        hb.Element([1.0, 0.0], hb.mechanics.PiecewiseLinear((), (1.0,), stiffness=first), name="first"),
        hb.Element([1.0, -1.0], hb.mechanics.PiecewiseLinear((), (1.0,), stiffness=second), name="second"),
    ]
    system = hb.System(np.eye(2), 0.2 * np.eye(2), np.zeros((2, 2)), springs, hb.Load(constant=[0.3, 0.2]))
    few = hb.StepControl(max_points=2)
    curve = hb.analysis.two_tones(system, RATIO, (0.7, 0.8), elements=["second"], harmonics=(8, 8), steps=few)

    def rates(t, y):
        k1, k2 = 1 + 0.2 * math.cos(0.7 * t), 1 + 0.15 * math.cos(0.7 * RATIO * t)
        a, b = k1 * y[0], k2 * (y[0] - y[1])
        return [y[2], y[3], 0.3 - a - b - 0.2 * y[2], 0.2 + b - 0.2 * y[3]]

    times = np.linspace(300, 330, 61)
    states = scipy.integrate.solve_ivp(rates, (0, 330), [0.5, 0.7, 0, 0], "DOP853", times, rtol=1e-11, atol=1e-12).y
    X = curve.problem.motion(curve.X[0], **curve[0].parameters)
    theta = np.outer(times, [0.7, 0.7 * RATIO])
    np.testing.assert_allclose(curve.problem.basis.evaluate(X, theta), states[:2], atol=1e-8)


@pytest.mark.parametrize("harmonics", [(4, 4), (5, 5), (6, 6), (1, 9), (9, 1), (3, 8)])
def test_the_stated_error_is_the_distance_from_the_motion_with_more_harmonics(harmonics):
    """A symmetric law has no coefficients at even k1 + k2, which are the outermost ones of half of these bases."""
    few, load = hb.StepControl(max_points=2), hb.Load(cosine={1: [0.1]})
    found, fine = (
        hb.analysis.two_tones(duffing(0.05, 1.0, 0.1), RATIO, (0.6, 0.7), load=load, harmonics=H, steps=few)
        for H in (harmonics, (13, 13))
    )
    basis, rows = fine.problem.basis, found.problem.basis
    difference = basis.to_complex(basis.convert(found.X[0][None], rows) - fine.X[0][None])
    distance = np.sqrt(np.sum(np.where(basis.k.any(axis=1), 0.5, 1.0) * np.abs(difference) ** 2))
    assert found.error[0] == pytest.approx(distance, rel=0.1) and distance > 1e-5
    assert (found.relative_error > 1e-2) == any("relative error" in text for text in found.warnings)


def test_errors_of_tori_have_the_unit_of_the_motion():
    """The law is homogeneous of degree 3: a mass that moves k times as far has k times the error."""
    few = hb.StepControl(max_points=2)
    errors = []
    for size in (1.0, 1e-6, 1e3):
        load = hb.Load(cosine={1: [0.1 * size]})
        curve = hb.analysis.two_tones(
            duffing(0.05, 1 / size**2, 0.1 * size), RATIO, (0.6, 0.7), load=load, harmonics=(5, 5), steps=few
        )
        errors.append((curve.error[0] / size, curve.relative_error))
    np.testing.assert_allclose(errors[1:], [errors[0], errors[0]], rtol=1e-6)


def test_harmonics_of_the_second_excitation_that_are_left_out():
    few, load = hb.StepControl(max_points=2), hb.Load(cosine={1: [0.1], 5: [0.3]})
    with pytest.warns(hb.mechanics.ImplausibleInputWarning, match=r"has 5 harmonics, and H = \(5, 3\) leaves some"):
        curve = hb.analysis.two_tones(
            duffing(0.05, 0.0, 0.1), RATIO, (0.6, 0.7), load=load, harmonics=(5, 3), steps=few
        )
    w = 5 * curve.values[-1] * RATIO
    assert curve.error[-1] == pytest.approx(0.3 / abs(1 - w**2 + 0.1j * w) / math.sqrt(2), rel=1e-9)


def test_the_summary_states_the_harmonics_of_both_phases():
    few, load = hb.StepControl(max_points=2), hb.Load(cosine={1: [0.1]})
    curve = hb.analysis.two_tones(duffing(0.05, 0.1, 0.1), RATIO, (0.6, 0.7), load=load, harmonics=(5, 3), steps=few)
    assert dict(summary_facts(curve))["settings"] == "harmonics = (5,3), dense = 1, ratio = 1.41421"


def test_figures_of_tori_accept_the_curve():
    curve = hb.analysis.two_tones(
        duffing(0.05, 0.1, 0.1), RATIO, (0.5, 0.6), load=hb.Load(cosine={1: [0.1]}), harmonics=(4, 4)
    )
    assert hb.plot.torus(curve, "pp2").lines and hb.plot.torus_section(curve, -1).lines
    assert hb.plot.torus_spectrum(curve, -1)


@pytest.mark.slow
def test_a_saved_curve_is_continued(tmp_path):
    load = hb.Load(cosine={1: [0.1]}, power=1)
    part = hb.analysis.two_tones(duffing(0.05, 0.1, 0.1), RATIO, (0.5, 0.6), load=load, harmonics=(4, 4))
    part.save(tmp_path / "part.npz")
    whole = hb.extend(hb.load(tmp_path / "part.npz"), (0.5, 0.7))
    direct = hb.analysis.two_tones(duffing(0.05, 0.1, 0.1), RATIO, (0.5, 0.7), load=load, harmonics=(4, 4))
    np.testing.assert_allclose(whole.X[-1], direct.X[-1], atol=1e-10)
    assert whole.problem.ratio == RATIO and whole.problem.load.power == 1


def test_bad_input():
    system, load = duffing(0.05, 0.1, 0.1), hb.Load(cosine={1: [0.1]})
    with pytest.raises(ValueError, match=r"3/2: both frequencies have the common base Omega / 2.*orders 2, 4"):
        hb.analysis.two_tones(system, 1.5, (0.5, 0.6), load=load)
    with pytest.raises(ValueError, match="constant part"):
        hb.analysis.two_tones(system, RATIO, (0.5, 0.6), load=hb.Load(constant=[1.0]))
    with pytest.raises(ValueError, match="no element 'mesh'"):
        hb.analysis.two_tones(system, RATIO, (0.5, 0.6), elements=["mesh"])
    with pytest.raises(ValueError, match="doubled tori are of the kinds"):
        hb.analysis.two_tones(system, RATIO, (0.5, 0.6), load=load, half=(0, 0))
    with pytest.raises(ValueError, match="need 1 entries"):
        hb.analysis.two_tones(system, RATIO, (0.5, 0.6), load=hb.Load(cosine={1: [0.1, 0.2]}))
