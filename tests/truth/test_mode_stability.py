"""Stability of backbones without dissipation: closed forms, variational equations, energy, Hill determinants."""

import math

import numpy as np
import pytest
import scipy

import hbgear as hb
from hbgear.harmonic.autonomous.unforced import unforced_balance


def equal_masses() -> hb.System:
    """Return two equal Duffing oscillators x'' + x + x^3, coupled by a spring of stiffness 2."""
    springs = [hb.Element([1, 0], hb.Cubic(1.0)), hb.Element([0, 1], hb.Cubic(1.0))]
    return hb.System(np.eye(2), None, [[3.0, -2.0], [-2.0, 3.0]], springs)


def one_cubic() -> hb.System:
    return hb.System(np.eye(2), None, [[2.0, -1.0], [-1.0, 2.0]], [hb.Element([1, 0], hb.Cubic(0.5))])


def two_stops() -> hb.System:
    springs = [hb.Element([1, 0], hb.Unilateral(10.0, 0.2)), hb.Element([-1, 1], hb.Unilateral(2.0, 0.7))]
    return hb.System(np.eye(2), None, [[2.0, -1.0], [-1.0, 2.0]], springs)


def rms_at(m: float) -> float:
    """Return the rms of both masses in phase, A cn(w t, m) each with A^2 = 2 m / (1 - 2 m)."""
    mean = (scipy.special.ellipe(m) / scipy.special.ellipk(m) - (1 - m)) / m
    return math.sqrt(2 * 2 * m / (1 - 2 * m) * mean)


@pytest.mark.parametrize("span", [(0.5, 1.0), (0.1, 2.0)])  # points within the unstable band, and none
def test_the_unstable_band_of_equal_masses_has_its_closed_form(span):
    """A difference y of the masses obeys Lame's equation y'' + (5 / w^2 + 6 m - 6 m sn^2) y = 0.

    Two of its five band edges, 2 (1 + m) + 2 sqrt(1 - m + m^2) and 4 + m, are reached at these m.
    """
    curve = hb.analysis.backbone(equal_masses(), span=span, harmonics=9)
    found = hb.analysis.backbone_stability(curve)
    edges = [rms_at((32 - math.sqrt(384)) / 64), rms_at(0.2)]
    np.testing.assert_allclose([change.amplitude for change in found.changes], edges, rtol=2e-8)
    assert [change.kind for change in found.changes] == ["+1", "+1"]
    inside = (curve.values > edges[0] + 1e-6) & (curve.values < edges[1] - 1e-6)
    assert (np.array(found.states)[inside] == "unstable").all()
    assert set(np.array(found.states)[~inside]) <= {"stable", "undecided"}


def test_multipliers_are_those_of_the_variational_equation():
    """One pair of the integrated monodromy matrix is +1; the other one is that of the result."""
    curve = hb.analysis.backbone(one_cubic(), span=(1.0, 2.5), harmonics=25)
    found = hb.analysis.backbone_stability(curve)
    for i in (0, len(curve) - 1):
        point = curve[i]
        Omega, rows = point.parameters["Omega"], curve.problem.motion(point.X, **point.parameters)
        k = np.arange(1, (rows.shape[1] + 1) // 2)
        begin = np.concatenate([rows[:, 0] + rows[:, 1::2].sum(axis=1), Omega * (rows[:, 2::2] * k).sum(axis=1)])
        end = scipy.integrate.solve_ivp(
            _variational,
            (0, 2 * math.pi / Omega),
            [*begin, *np.eye(4).ravel()],
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
        ).y[:, -1]
        np.testing.assert_allclose(end[:4], begin, atol=2e-7)
        trace = float(np.trace(end[4:].reshape(4, 4)))
        assert abs(found.multipliers[i].sum() + 2 - trace) < 1e-6
    assert (found.states[0], found.states[-1]) == ("stable", "unstable")


def _variational(t: float, z: np.ndarray) -> np.ndarray:
    q, Z = z[:2], z[4:].reshape(4, 4)
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    slope = K + np.diag([1.5 * q[0] ** 2, 0.0])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-slope, np.zeros((2, 2))]])
    return np.concatenate([z[2:4], -K @ q - [0.5 * q[0] ** 3, 0.0], (A @ Z).ravel()])


@pytest.mark.slow
def test_stability_changes_at_extrema_of_the_energy_and_at_branch_points():
    curve = hb.analysis.backbone(one_cubic(), span=(1.5, 4.5), harmonics=25)
    found = hb.analysis.backbone_stability(curve)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve.X, axis=0), axis=1))])
    energy = scipy.interpolate.CubicSpline(length, hb.analysis.backbone_energy(curve))
    extrema = energy.derivative().roots(extrapolate=False)
    branching = [length[point.index] for point in curve.special if point.kind == "BP"]
    at = np.interp([change.position for change in found.changes], np.arange(len(curve)), length)
    assert {change.kind for change in found.changes} == {"+1"} and len(extrema) == 4
    np.testing.assert_allclose(at, sorted([*extrema, *branching]), atol=5e-3)


def test_a_period_doubling_is_a_zero_of_the_hill_determinant():
    """The half-integer harmonics are free at the change: the determinant of their block changes sign there."""
    curve = hb.analysis.backbone(two_stops(), mode=2, span=(2.0, 3.0), harmonics=24)
    found = hb.analysis.backbone_stability(curve)
    (change,) = found.changes
    assert change.kind == "-1" and (found.states[0], found.states[-1]) == ("stable", "unstable")
    signs = [_half_integer_determinant(curve, i) for i in range(len(curve))]
    assert signs == [signs[0] if i <= change.position else -signs[0] for i in range(len(curve))]


def _half_integer_determinant(curve: hb.Branch, i: int) -> float:
    """Return the sign of the determinant of the half-integer block of the balance without excitation."""
    problem, H = unforced_balance(two_stops(), 48), 24
    doubled = hb.HarmonicBalance(problem.model, 48, nu=2)
    X = np.zeros((doubled.m, 97))
    rows = curve.X[i].reshape(doubled.m, -1)
    X[:, 0], X[:, 3:97:4], X[:, 4:97:4] = rows[:, 0], rows[:, 1 : 2 * H : 2], rows[:, 2 : 2 * H + 1 : 2]
    J = doubled.linearise(X.ravel(), "", Omega=float(curve.tracked["Omega"][i])).dR_dX
    odd = np.zeros((doubled.m, 97), dtype=bool)
    odd[:, 1::4] = odd[:, 2::4] = True
    return float(np.linalg.slogdet(J[np.ix_(odd.ravel(), odd.ravel())])[0])


def test_one_coordinate_is_stable_and_has_no_other_multipliers():
    found = hb.analysis.backbone_stability(hb.analysis.backbone(hb.Duffing(zeta=0.0), span=(0.01, 1.0), harmonics=5))
    assert set(found.states) == {"stable"} and found.multipliers.shape[1] == 0


def test_stability_is_undefined_where_energy_is_dissipated():
    """A friction slider dissipates from its first slip on; a viscous damper always."""
    system = hb.System(
        np.eye(2), None, [[2.0, -1.0], [-1.0, 2.0]], [hb.Element([1, 0], hb.mechanics.Jenkins(1.0, 0.5))]
    )
    curve = hb.analysis.backbone(system, span=(0.1, 1.0), harmonics=8)
    found = hb.analysis.backbone_stability(curve)
    slips = curve.values > curve["SL1"].parameters["amplitude"] + 1e-6
    assert {state for state, slip in zip(found.states, slips, strict=True) if slip} == {"undefined"}
    assert {state for state, slip in zip(found.states, slips, strict=True) if not slip} == {"stable"}
    damped = hb.analysis.backbone_stability(hb.analysis.backbone(hb.Duffing(), span=(0.1, 0.2), harmonics=3))
    assert set(damped.states) == {"undefined"} and damped.multipliers.shape[1] == 0


@pytest.mark.slow
def test_few_harmonics_leave_motions_undecided_and_none_wrong():
    """With 11 harmonics the motions near the internal resonance have errors of a percent."""
    coarse, fine = (hb.analysis.backbone(one_cubic(), span=(1.5, 5.0), harmonics=H) for H in (11, 41))
    states = [hb.analysis.backbone_stability(curve) for curve in (coarse, fine)]
    assert "undecided" in states[0].states
    for a, b in zip(states[0].changes, states[1].changes, strict=True):
        assert abs(a.amplitude - b.amplitude) < 1e-3


def test_stability_of_a_saved_backbone(tmp_path):
    curve = hb.analysis.backbone(equal_masses(), span=(0.7, 0.9), harmonics=5)
    curve.save(tmp_path / "curve.npz")
    again = hb.analysis.backbone_stability(hb.load(tmp_path / "curve.npz"))
    assert again.states == hb.analysis.backbone_stability(curve).states


def test_other_curves_have_no_stability_of_a_backbone():
    curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 3), "Omega", (0.8, 0.9))
    with pytest.raises(ValueError, match=r"give hb.analysis.backbone\(model\)"):
        hb.analysis.backbone_stability(curve)


def test_the_figure_shows_unstable_motions_dashed():
    curve = hb.analysis.backbone(equal_masses(), span=(0.5, 1.0), harmonics=5)
    found = hb.analysis.backbone_stability(curve)
    axes = hb.plot.backbone(curve, stability=found)
    lines = {line.get_gid(): line for line in axes.lines}
    assert lines["unstable"].get_linestyle() == "--" and len(lines["changes"].get_xdata()) == 2
    with pytest.raises(ValueError, match="is given for a curve of"):
        hb.plot.backbone(hb.analysis.backbone(equal_masses(), span=(0.5, 0.6), harmonics=5), stability=found)
