"""Backbones with friction and backlash, and cubic springs, against closed forms and shooting."""

import math

import numpy as np
import pytest
import scipy
from machines import single_mass

import hbgear as hb


def at_displacement(model: hb.System, harmonics: int, x: float, span: tuple[float, float], mode: int = 1) -> hb.Point:
    """Return the point of a backbone at which the largest displacement of the first element is x."""
    problem = hb.harmonic.BackboneProblem(model, mode, harmonics)
    hit = hb.Event("largest", lambda point: point.amplitude("max", 0) - x)
    return hb.trace(problem, "amplitude", span, cover=False, events=[hit], accuracy=None)["largest1"]


def slider(k: float, limit: float) -> hb.System:
    return single_mass(hb.mechanics.Jenkins(k, limit), c=None, name="slider")


JENKINS = [
    (1.0, 0.1, 0.11, 1.3979722454389134, 0.026790202675902486),
    (1.0, 0.1, 0.15, 1.3074059276417724, 0.08207404840969729),
    (1.0, 0.1, 0.2, 1.2258676901976977, 0.10575288042635411),
    (1.0, 0.1, 0.4, 1.0935981120211686, 0.10105727714235226),
    (1.0, 0.1, 1.0, 1.0252868006149383, 0.05503715314077884),
    (1.0, 0.1, 3.0, 1.0049856727723823, 0.020373713229677667),
    (0.25, 0.05, 0.25, 1.1019878712654194, 0.020900473831894785),
    (0.25, 0.05, 0.5, 1.0457422542960422, 0.034991946530664605),
    (0.25, 0.05, 2.0, 1.0064571813314003, 0.014176790533008164),
]
"""Stiffness, limit, largest displacement, frequency and damping of x'' - 2 D omega x' + x + Jenkins = 0 by shooting."""


@pytest.mark.parametrize(("k", "limit", "x", "omega", "damping"), JENKINS)
def test_a_friction_slider_agrees_with_shooting(k, limit, x, omega, damping):
    point = at_displacement(slider(k, limit), 64, x, (0.5 * x, 1.5 * x))
    assert abs(point.parameters["Omega"] - omega) < 5e-9
    assert abs(point.parameters["modal_damping"] - damping) < 5e-9


def test_the_backbone_passes_the_first_slip():
    """The slider slips from x = limit / k on; before, the frequency is that of the closed link and the damping zero."""
    problem = hb.harmonic.BackboneProblem(slider(0.25, 0.05))
    for span in ((0.1, 0.2), (0.2, 0.1)):
        curve = hb.trace(problem, "amplitude", span, cover=False)
        assert curve.status.complete and [point.kind for point in curve.special] == ["SL"]
        assert curve["SL1"].parameters["amplitude"] == pytest.approx(0.2 / math.sqrt(2), rel=1e-9)
        sticks = curve.values < 0.2 / math.sqrt(2) * (1 - 1e-6)
        assert np.abs(curve.tracked["Omega"][sticks] - math.sqrt(1.25)).max() < 1e-12
        assert np.abs(curve.tracked["modal_damping"][sticks]).max() < 1e-9 < curve.tracked["modal_damping"].max()


def gap(F: float) -> hb.System:
    load = hb.Load(constant=[F]) if F else ()
    return hb.System([[1.0]], None, [[0.0]], [hb.Element([1.0], hb.Backlash(), name="gap")], load)


BACKLASH = [
    (0.0, 3.0, 0.7585469929947761),
    (0.0, 4.0, 0.8249418932369944),
    (0.1, 1.4, 0.6629146738553157),
    (0.1, 1.7, 0.41043370727068135),
    (0.1, 2.1, 0.5838276062196354),
    (0.3, 1.8, 0.8855466812136265),
    (0.3, 2.8, 0.6714496036385587),
]
"""Mean force, largest displacement and frequency of x'' + g(x) = F, half gap and stiffness 1, closed forms."""


@pytest.mark.parametrize(("F", "x", "omega"), BACKLASH)
def test_backlash_has_its_closed_form(F, x, omega):
    span = (0.3 * F, 1.1 * x) if F else (x, 0.5 * x)
    assert abs(at_displacement(gap(F), 128, x, span).parameters["Omega"] - omega) < 2e-8


@pytest.mark.slow
@pytest.mark.parametrize(("F", "x", "omega"), BACKLASH)
def test_backlash_has_its_closed_form_to_ten_digits(F, x, omega):
    """From the motion with 128 harmonics, a short piece with 512."""
    coarse = at_displacement(gap(F), 128, x, (0.3 * F, 1.1 * x) if F else (x, 0.5 * x))
    problem = hb.harmonic.BackboneProblem(gap(F), 1, 512)
    start = problem.resized(problem.join(coarse.X, coarse.parameters))
    hit = hb.Event("largest", lambda point: point.amplitude("max", 0) - x)
    near = coarse.parameters["amplitude"]
    curve = hb.trace(
        problem,
        "amplitude",
        (0.999 * near, 1.001 * near),
        start,
        cover=False,
        events=[hit],
        accuracy=None,
        stability=False,
        steps=hb.StepControl(max_step=0.5, first_step=0.5),
    )
    assert abs(curve["largest1"].parameters["Omega"] - omega) < 1e-10


def test_contact_is_lost_where_the_gap_opens():
    """x = 1 + F + a cos reaches 1 at a = F: the rms is F / sqrt(2)."""
    curve = hb.analysis.backbone(gap(0.3), span=(0.1, 0.4))
    assert curve["GR1"].parameters["amplitude"] == pytest.approx(0.3 / math.sqrt(2), rel=1e-9)


TWO_MASSES = {
    (0.0, 1): [(0.5, 1.0370690976579064), (1.0, 1.1437105229248123), (2.0, 1.5169614506422335)],
    (0.0, 2): [(0.5, 1.7532817849076823), (1.0, 1.8120777618344084), (2.0, 2.011087756939591)],
    (0.2, 2): [(0.5, 1.5160371848090328), (1.0, 1.7835839029605487), (2.0, 2.5800552632235734)],
}
"""Largest displacement of the first mass and frequency by shooting; by cubic coefficient of the coupling, and mode."""


@pytest.mark.parametrize(("coupling", "mode"), TWO_MASSES)
def test_two_masses_with_cubic_springs_agree_with_shooting(coupling, mode):
    k12, grounds = (0.5, ()) if coupling else (1.0, (([1, 0], 0.5), ([0, 1], 0.3)))
    springs = [hb.Element(direction, hb.Cubic(c)) for direction, c in (*grounds, ([1, -1], coupling)) if c]
    if coupling:  # the first element measures the first mass
        springs.insert(0, hb.Element([1, 0], hb.Cubic(1e-30)))
    model = hb.System(np.eye(2), None, [[1 + k12, -k12], [-k12, 1 + k12]], springs)
    for x, omega in TWO_MASSES[coupling, mode]:
        point = at_displacement(model, 15, x, (0.3 * x, 3.0 * x), mode)
        assert abs(point.parameters["Omega"] - omega) < 1e-8


def stop_between(K, C) -> hb.System:
    """Return two masses with a stop between them, which is open at rest."""
    stop = hb.Element([1.0, -1.0], hb.Unilateral(k=20.0, gap=0.3), name="stop")
    return hb.System(np.diag([1.0, 0.5]), C, K, [stop])


@pytest.mark.parametrize("mode", [1, 2])
@pytest.mark.parametrize("ratios", [0.03, [0.01, 0.04]])
def test_a_damped_backbone_begins_below_the_contact(mode, ratios):
    """All forces of the elements are zero there: frequency and damping ratio are those of the linear mode."""
    K = np.array([[3.1, -1.0], [-1.0, 1.0]])
    C = hb.mechanics.modal_damping(np.diag([1.0, 0.5]), K, ratios)
    curve = hb.analysis.backbone(stop_between(K, C), mode=mode, span=(1e-4, 1.0), harmonics=8)
    omega = np.sqrt(scipy.linalg.eigh(K, np.diag([1.0, 0.5]), eigvals_only=True))[mode - 1]
    below = curve.amplitude("max") < 0.3
    np.testing.assert_allclose(curve.tracked["Omega"][below], omega, rtol=1e-9)
    np.testing.assert_allclose(curve.tracked["modal_damping"][below], np.resize(ratios, 2)[mode - 1], rtol=1e-8)
    assert (~below).sum() > 20 and np.ptp(curve.tracked["Omega"][~below]) > 0.01


@pytest.mark.slow
def test_a_backbone_at_an_internal_resonance_ends_with_a_reason():
    """omega_2 = 1.9999 omega_1: contact makes the curve turn sharply."""
    K = np.array([[3.001, -1.0], [-1.0, 1.0]])
    curve = hb.analysis.backbone(stop_between(K, None))
    assert "error" not in curve.message and [point.kind for point in curve.special][:1] == ["GR"]


@hb.mechanics.model
def loaded_gap(F: float = 0.3) -> hb.System:
    return gap(F)


def test_the_loss_of_contact_is_followed_over_the_load():
    """The rms at which contact is lost is F / sqrt(2) for every mean force F."""
    curve = hb.analysis.backbone(loaded_gap(), span=(0.1, 0.4))
    followed = hb.follow(curve, "GR1", "F", (0.3, 0.6))
    assert followed.status.complete and len(followed) > 3
    np.testing.assert_allclose(followed.tracked["amplitude"], followed.values / math.sqrt(2), rtol=1e-9)


@pytest.mark.slow
def test_the_contact_on_the_back_flank_is_followed_over_the_damping():
    """The last point of the curve lies on the backbone traced with the changed damping."""
    pair = hb.gears.DoubleHelicalPair()
    zeta = pair.parameters["zeta"]
    curve = hb.analysis.backbone(pair, mode=3, span=(0.01, 2.0))
    followed = hb.follow(curve, "GR2", "zeta", (zeta, 1.1 * zeta))
    again = hb.analysis.backbone(pair, mode=3, span=(0.01, 2.0), at={"zeta": 1.1 * zeta})["GR2"]
    assert abs(followed.tracked["amplitude"][-1] - again.parameters["amplitude"]) < 3 * again.error


def test_a_mode_that_the_elements_measure_little_continues_beyond_the_first_contact():
    """The residual changes so much with Omega that its rounding errors exceed 1e-10 of the forces of the elements."""
    curve = hb.analysis.backbone(hb.gears.DoubleHelicalPair(), mode=2, span=(0.4, 0.55))
    assert curve.status.complete and curve["GR1"].parameters["amplitude"] < 0.45


@pytest.mark.parametrize("mode", [1, 2])
def test_backbones_of_an_isotropic_rotor_are_forward_and_backward_whirl(mode):
    """In circular whirl of radius r, W^2 = 1 + k (1 - g / r) and 2 D W^2 = c W +- mu k (1 - g / r)."""
    k, g, mu, c, turned = 4.0, 1.0, 0.1, 0.02, np.array([[0.8, -0.6], [0.6, 0.8]])
    seal = hb.mechanics.VectorElement(turned, hb.mechanics.RadialClearance(k, g, mu))
    rotor = hb.System(np.eye(2), c * np.eye(2), np.eye(2), list(seal), hb.Load(cosine={1: [0.1, 0.0]}))
    curve = hb.analysis.backbone(rotor, mode, (0.1, 3.0), harmonics=3)
    assert curve.status is hb.Status.REACHED_END and {p.kind for p in curve.special} == {"GR"}
    r, W, D = curve.values, curve.tracked["Omega"], curve.tracked["modal_damping"]
    contact = k * np.maximum(1 - g / r, 0)
    np.testing.assert_allclose(W, np.sqrt(1 + contact), rtol=1e-10)
    np.testing.assert_allclose(2 * D * W**2, c * W + {1: 1, 2: -1}[mode] * mu * contact, atol=1e-10)


def test_the_whirl_of_a_rotor_with_static_weight_ends_at_the_first_contact():
    """Contact on one side leaves no circular whirl: a curve of ellipses that touch the hole went on without end."""
    seal = hb.mechanics.VectorElement(np.eye(2), hb.mechanics.RadialClearance(4.0, 1.0))
    rotor = hb.System(np.eye(2), 0.02 * np.eye(2), np.eye(2), list(seal), hb.Load([0.0, -0.3], {1: [0.1, 0.0]}))
    curve = hb.analysis.backbone(rotor, 1, (0.1, 3.0), harmonics=3)
    assert curve.status is hb.Status.EVENT and "the whirl ends at the first contact" in curve.message
    assert curve["GR1"].parameters["amplitude"] == pytest.approx(0.7, rel=1e-9)  # clearance less static deflection
    assert 0 < curve["WL1"].parameters["amplitude"] - 0.7 < 2e-3


def test_modes_of_equal_frequency_are_counted():
    """Two uncoupled equal masses have two modes; a frequency counted once was refused."""
    masses = [hb.Element(row, hb.Cubic(1.0)) for row in np.eye(2)]
    equal = hb.System(np.eye(2), None, np.eye(2), masses, hb.Load(cosine={1: [0.1, 0.0]}))
    first, second = (hb.analysis.backbone(equal, mode, (0.1, 0.5), harmonics=3) for mode in (1, 2))
    np.testing.assert_allclose(first.tracked["Omega"][-1], second.tracked["Omega"][-1], rtol=1e-9)
    assert first[-1].amplitude("rms", 0) == pytest.approx(second[-1].amplitude("rms", 1), abs=1e-9)
