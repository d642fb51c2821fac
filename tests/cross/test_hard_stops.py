"""One mass and a hard stop: the curve passes its grazing points in contact instants."""

import numpy as np
import pytest
from machines import single_mass
from scipy.optimize import brentq

import hbgear as hb
from hbgear.time.integration import state_of

GAP, C, F = 0.5, 0.1, 0.3


def grazing(low, high):
    """Omega at which the motion without contact reaches the stop."""
    return brentq(lambda w: F / abs(1 - w**2 + 1j * w * C) - GAP, low, high, xtol=1e-15)


@pytest.mark.parametrize("k", [1e4, 1e5])
def test_a_curve_of_a_hard_stop_is_traced_through_its_grazing_points(k):
    """The first grazing and the motion without contact have closed forms; the folds beyond agree with 1e-9."""
    model = single_mass(hb.Unilateral(k=k, gap=GAP), F=F, c=C, name="stop")
    curve = hb.trace(hb.HarmonicBalance(model, 32), "Omega", (0.6, 2.2))
    assert curve.status.complete and "contact instants" in curve.message
    curves = curve.curves
    first, last = grazing(0.6, 0.7), grazing(1.1, 1.4)
    found = [point.parameters["Omega"] for each in curves for point in each.special if point.kind == "GR"]
    for Omega in (first, last):
        assert min(abs(Omega - one) for one in found) < 1e-10
    for each in curves:
        free = (each.regime[:, 0] == 0) & ((each.values < first) | (each.values > last))
        q = F / np.abs(1 - each.values[free] ** 2 + 1j * C * each.values[free])
        np.testing.assert_allclose(np.linalg.norm(each.X[free, 1:], axis=1), q, rtol=1e-8)
        size = np.abs(each.multipliers[free, 0])
        np.testing.assert_allclose(size, np.exp(-C * np.pi / each.values[free]), rtol=1e-6)


@pytest.mark.parametrize("name, end", [("F", 0.12), ("gap", 0.4), ("c", 0.05)])
def test_a_fold_next_to_a_grazing_contact_is_followed(name, end):
    """The penetration is 2.6e-6 of the motion; the fold of contact instants at the end is the same."""

    @hb.mechanics.model
    def stopped(F: float = 0.1, gap: float = GAP, c: float = 0.04) -> hb.System:
        return single_mass(hb.Unilateral(k=100.0, gap=gap), F=F, c=c, name="stop")

    curve = hb.trace(hb.HarmonicBalance(stopped(), 24), "Omega", (1.3, 1.05))
    assert 0 < curve["LP1"].amplitude("max") / GAP - 1 < 1e-5
    folds = hb.follow(curve, "LP1", name, (getattr(stopped(), name), end))
    assert folds.status is hb.Status.REACHED_END and len(folds) < 50
    exact = hb.trace(hb.ContactInstants(stopped(**{name: end})), "Omega", (1.3, 1.05))
    assert folds.tracked["Omega"][-1] == pytest.approx(exact["LP1"].parameters["Omega"], abs=1e-8)


@pytest.mark.slow
def test_contacts_that_few_harmonics_do_not_resolve():
    """A stop without gap: H = 16 leaves an error of 5 % and loses points; the curve is traced in contact instants.

    Integration confirms the period doublings: motions of one period with the multiplier -1.
    """
    model = single_mass(hb.Unilateral(k=36.0, gap=0.0), F=0.2, c=0.05, name="stop")
    curve = hb.trace(hb.HarmonicBalance(model, 16), "Omega", (0.6, 0.45))
    assert curve.status is hb.Status.REACHED_END
    assert "traced in contact instants, because H = 16 does not resolve contacts" in curve.message
    assert [point.label for point in curve.special] == ["GR1", "LP1", "LP2", "PD1", "PD2"]
    finer = hb.trace(hb.ContactInstants(model, 48), "Omega", (0.6, 0.45))  # start values of the integration
    for label in ("PD1", "PD2"):
        Omega = curve[label].parameters["Omega"]
        assert abs(Omega - finer[label].parameters["Omega"]) < 1e-10
        orbit = hb.time.shoot(model, Omega, state_of(finer.problem, finer[label].X, Omega=Omega))
        assert np.abs(orbit.multipliers + 1).min() < 1e-6


def hard_stop():
    """Return the harmonic balance of a stop that 32 harmonics do not resolve."""
    return hb.HarmonicBalance(single_mass(hb.Unilateral(k=1e4, gap=GAP), F=F, c=C, name="stop"), 32)


def test_a_curve_that_ends_at_its_number_of_points_stays_exact():
    """The balance would end at the grazing point. The other end is covered up to the first grazing: a closed form."""
    curve = hb.trace(hard_stop(), "Omega", (2.2, 0.6), steps=hb.StepControl(max_points=100))
    assert curve.status is hb.Status.MAX_POINTS and len(curve) == 100
    assert "traced in contact instants" in curve.message
    assert curve["GR1"].parameters["Omega"] == pytest.approx(grazing(1.1, 1.4), abs=1e-10)
    (other,) = curve.others
    assert other.values.max() == pytest.approx(grazing(0.6, 0.7), abs=1e-6)
    assert "no curve was found from Omega = 0.635115 to 1.25961" in curve.message
    assert len(hb.extend(curve)) > 100


def test_other_curves_that_end_early_are_reported():
    """The curve turns back at the first grazing; the one from the other end ends at its number of points."""
    curve = hb.trace(hard_stop(), "Omega", (0.6, 2.2), steps=hb.StepControl(max_points=60))
    assert curve.status is hb.Status.LEFT_SPAN and curve.others[0].status is hb.Status.MAX_POINTS
    assert f"it ended early, {curve.others[0].message}" in curve.message


def test_an_interrupted_curve_in_contact_instants_is_the_result():
    """Ctrl-C ends the trace; no other curve is started."""
    values = []

    def interrupt(progress):
        values.append(progress.numbers["value"])
        if len(values) == 30:
            raise KeyboardInterrupt

    curve = hb.trace(hard_stop(), "Omega", (2.2, 0.6), progress=interrupt)
    assert curve.status is hb.Status.INTERRUPTED and len(values) == 30
    assert curve.values[-1] == values[-1] and "traced in contact instants" in curve.message


def test_the_message_states_why_a_curve_in_contact_instants_was_not_completed(monkeypatch):
    """The balance of a hard stop ends at the first grazing; its message has the reason of the other attempt."""
    import hbgear.harmonic.contact_instants.problem as exact

    def no_motion(*_, **__):
        raise hb.NoConvergence("no exact motion at all", np.zeros(1), {}, [])

    monkeypatch.setattr(exact, "first_curve", no_motion)
    balance = hb.HarmonicBalance(hard_stop().model, 16)
    curve = hb.trace(balance, "Omega", (2.2, 1.9), steps=hb.StepControl(max_points=3))
    assert curve.status is hb.Status.MAX_POINTS
    assert curve.message.endswith("contact instants were tried: no exact motion at all")


def test_harmonics_that_are_not_stored_are_no_error_of_an_exact_curve(tmp_path):
    """With 2 harmonics instead of 16 the special points are the same to rounding; the warning does not advise more."""
    curves = [hb.trace(hb.ContactInstants(hard_stop().model, H), "Omega", (1.5, 1.2)) for H in (2, 16)]
    points = [[point.parameters["Omega"] for point in curve.special] for curve in curves]
    np.testing.assert_allclose(*points, rtol=1e-10)
    curves[0].save(tmp_path / "curve.npz")
    for curve in (curves[0], hb.load(tmp_path / "curve.npz")):
        (warning,) = [text for text in curve.warnings if "harmonics" in text]
        assert warning.startswith("the harmonics that are not stored are up to ") and "more harmonics" not in warning


@pytest.fixture(scope="module")
def inner_grazing():
    """Return a model whose second contact in the period begins and vanishes, with its curve of 32 harmonics."""

    @hb.mechanics.model
    def stopped(F: float = 0.3, gap: float = 0.3) -> hb.System:
        stop = hb.Element([1.0], hb.Unilateral(k=20.0, gap=gap), name="stop")
        return hb.System([[1.0]], [[0.1]], [[1.0]], [stop], hb.Load(cosine={1: [F], 2: [0.25]}))

    return stopped, hb.trace(hb.HarmonicBalance(stopped(), 32), "Omega", (2.0, 0.35))


def grazings(curve):
    """Return the grazing points of a curve."""
    return [point for point in curve.special if point.kind == "GR"]


def test_extrema_that_are_not_the_highest_graze(inner_grazing):
    """Both discretisations have the same grazing points, also where a further contact begins in the period."""
    stopped, balance = inner_grazing
    exact = hb.trace(hb.ContactInstants(stopped()), "Omega", (2.0, 0.35))
    points, others = grazings(balance), grazings(exact)
    assert [point.note for point in points] == [point.note for point in others]
    assert [point.note for point in points] == ["highest of stop at 0.3"] + 5 * ["inner extremum of stop at 0.3"]
    for point, other in zip(points, others, strict=True):
        assert abs(point.parameters["Omega"] - other.parameters["Omega"]) < 3 * point.error < 2e-5


def test_inner_extrema_reach_the_breakpoint(inner_grazing):
    """The derivative of the motion of a grazing point has a root at which the motion is at the stop, to rounding."""
    for point in grazings(inner_grazing[1])[1:]:
        c = (point.X[1::2] - 1j * point.X[2::2]) / 2
        orders = np.arange(1, len(c) + 1)
        slope = np.concatenate([(-1j * orders * c.conj())[::-1], [0.0], 1j * orders * c])
        roots = np.roots(slope[::-1])
        theta = np.angle(roots[np.abs(np.abs(roots) - 1) < 1e-7])
        d = point.X[0] + 2 * (np.exp(1j * np.outer(theta, orders)) @ c).real
        assert np.abs(d - 0.3).min() < 1e-9 and d.max() > 0.301


@pytest.mark.slow
@pytest.mark.parametrize("name", ["F", "gap"])
def test_inner_grazings_are_followed(inner_grazing, name):
    """The curve of a grazing point over a parameter ends at the point of the curve with this parameter."""
    stopped, balance = inner_grazing
    followed = hb.follow(balance, "GR2", name, (0.3, 0.33))
    other = hb.trace(hb.HarmonicBalance(stopped(**{name: 0.33}), 32), "Omega", (1.0, 0.6))
    (Omega,) = [p.parameters["Omega"] for p in grazings(other)][:1]
    assert followed.tracked["Omega"][-1] == pytest.approx(Omega, abs=1e-9)
