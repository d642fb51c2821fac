"""The same machine in other units, and with other reference stiffnesses: the same special points.

x' = L x,   t' = T t,   m' = M m:   K' = K M / T^2,   C' = C M / T,   F' = F M L / T^2,   Omega' = Omega / T
"""

import dataclasses

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.harmonic.bifurcations.slip import SlipEvent
from hbgear.harmonic.equations import model_cache
from hbgear.harmonic.structure import linear_structure
from hbgear.mechanics.reference_stiffness import references
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.segments import segment_at

UNITS = {
    "length": (1e-6, 1.0, 1.0),
    "tiny": (1e-12, 1.0, 1.0),
    "large": (1e6, 1.0, 1.0),
    "time": (1.0, 1e3, 1.0),
    "mass": (1.0, 1.0, 1e3),
    "all": (1e-6, 1e3, 1e3),
}


def scaled_series(series, times):
    return hb.mechanics.Series(
        times * series.mean, tuple(times * np.array(series.cosine)), tuple(times * np.array(series.sine))
    )


def scaled_law(law, L, F):
    if isinstance(law, hb.Cubic):
        return hb.Cubic(k3=law.k3 * F / L**3, k1=law.k1 * F / L)
    corners, slopes = (tuple(times * np.array(x)) for times, x in ((L, law.corners), (F / L, law.slopes)))
    return dataclasses.replace(law, corners=corners, slopes=slopes, force_at_zero=F * law.force_at_zero)


def in_units(system, L, T, M):
    """The system written in other units."""
    F = M * L / T**2
    elements = [
        dataclasses.replace(
            e, law=scaled_law(e.law, L, F), displacement=scaled_series(e.displacement, L), damping=e.damping * M / T
        )
        for e in system.elements
    ]
    loads = [
        dataclasses.replace(
            load,
            constant=None if load.constant is None else F * T**load.power * np.asarray(load.constant),
            cosine={k: F * T**load.power * np.asarray(v) for k, v in load.cosine.items()},
            sine={k: F * T**load.power * np.asarray(v) for k, v in load.sine.items()},
        )
        for load in system.loads
    ]
    return hb.System(system.M * M, system.C * M / T, system.K * M / T**2, elements, loads)


def oscillator(K, C, law, F, constant=0.0):
    return single_mass(law, F=F, mean=constant, c=C, k=K)


MACHINES = {
    "duffing": (hb.Duffing().system(), (0.8, 1.6), 5),
    "spur pair": (hb.SpurPair(e=(0.2,)).system(), (1.2, 0.6), 6),
    "softening": (oscillator(1.0, 0.1, hb.Cubic(k3=-1.0), 0.05), (0.6, 1.4), 5),
    "double well": (oscillator(-1.0, 0.1, hb.Cubic(k3=1.0), 0.05), (1.6, 1.0), 5),
    "pure cubic": (oscillator(0.0, 0.1, hb.Cubic(k3=1.0), 0.2), (1.6, 0.4), 5),
    "tether": (oscillator(1.0, 0.1, hb.Unilateral(k=20.0, gap=0.0), 1.0), (2.2, 1.2), 12),
    "stop": (oscillator(1.0, 0.1, hb.Unilateral(k=10.0, gap=0.5), 0.3), (0.8, 1.8), 10),
}


def special_points(system, span, H, **options):
    curve = hb.trace(hb.HarmonicBalance(system, H), "Omega", span, **options)
    assert curve.status.complete and not np.isnan(curve.X).any()
    kinds = sorted((p.kind, p.parameters["Omega"]) for p in curve.special if p.kind != "GR")
    return [kind for kind, _ in kinds], np.array([value for _, value in kinds]), curve


@pytest.fixture(scope="module")
def known():
    return {name: special_points(*machine) for name, machine in MACHINES.items()}


@pytest.fixture(scope="module")
def same_harmonics():
    return {name: special_points(*machine, accuracy=None) for name, machine in MACHINES.items()}


def errors_of(curve):
    """Stated errors of the special points, in the order of `special_points`."""
    points = sorted((p.kind, p.parameters["Omega"], p.error) for p in curve.special if p.kind != "GR")
    return np.array([error for _, _, error in points])


@pytest.mark.parametrize("name", MACHINES)
def test_there_is_something_to_compare(name, known):
    """Each curve has a stable part, and but for the tether special points."""
    kinds, _, curve = known[name]
    assert curve.stable.any() and not any("no point of the curve is stable" in doubt for doubt in curve.warnings)
    assert kinds or name == "tether"


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("name", MACHINES)
def test_units_change_nothing(name, units, known):
    system, span, H = MACHINES[name]
    L, T, M = UNITS[units]
    kinds, values, curve = special_points(in_units(system, L, T, M), tuple(x / T for x in span), H)
    assert kinds == known[name][0]
    np.testing.assert_allclose(values * T, known[name][1], rtol=1e-7)
    expected = known[name][2]
    np.testing.assert_allclose(curve[-1].X / L, expected[-1].X, rtol=0, atol=1e-6 * np.abs(expected[-1].X).max())
    assert curve.stable[-1] == expected.stable[-1] and curve.stable[0] == expected.stable[0]


@pytest.mark.parametrize("factor", [1e-2, 3.0, 1e2])
@pytest.mark.parametrize("name", MACHINES)
def test_reference_stiffness_changes_nothing(name, factor, known, same_harmonics, monkeypatch):
    def other(system):
        return factor * references(system)

    monkeypatch.setattr(model_cache, "references", other)
    monkeypatch.setattr(linear_structure, "references", other)
    kinds, values, curve = special_points(*MACHINES[name], accuracy=None)
    usual = references(MACHINES[name][0])[0]
    assert curve.problem.compiled({}).structure.kr[0] == pytest.approx(factor * usual, rel=0.5)
    assert kinds == same_harmonics[name][0]
    np.testing.assert_allclose(values, same_harmonics[name][1], rtol=1e-7)
    kinds, values, curve = special_points(*MACHINES[name])  # points may be located with other numbers of harmonics
    assert kinds == known[name][0]
    stated = errors_of(curve) + errors_of(known[name][2])
    assert np.isfinite(stated).all()
    assert np.all(np.abs(values - known[name][1]) <= stated + 1e-7 * np.abs(values))


# ---- time integration


def rubbing_mass(L=1.0, T=1.0, M=1.0):
    """Two masses with a cubic spring, a damped stop, friction on a stop, and a slider; lengths L, times T, masses M."""
    k, F = M / T**2, M * L / T**2
    elements = [
        hb.Element([1, 0], hb.Cubic(k3=0.8 * k / L**2)),
        hb.Element([0, 1], hb.mechanics.ClippedKelvinVoigt(k=2.0 * k, c=0.3 * M / T, gap=0.2 * L)),
        hb.Element([-1, 1], hb.Unilateral(k=3.0 * k, gap=0.05 * L), name="stop"),
        hb.Element([1, 0.5], hb.mechanics.ContactFriction(4.0 * k, 0.4, "stop")),
        hb.Element([1, 0], hb.mechanics.Jenkins(1.5 * k, 0.04 * F)),
    ]
    load = hb.Load(constant=[0.0, 0.1 * F], cosine={1: [0.5 * F, 0.2 * F]}, sine={2: [0.0, 0.2 * F]})
    K = np.array([[2.0, -0.5], [-0.5, 1.5]])
    return hb.System(M * np.eye(2), 0.05 * K * M / T, K * k, elements, load)


OTHER_UNITS = [
    (1e-6, 1.0, 1.0),
    (1e-12, 1.0, 1.0),
    (1e6, 1.0, 1.0),
    (1e-9, 1e-6, 1e-12),
    (1.0, 1e-7, 1.0),
    (1e3, 1e3, 1e6),
]


@pytest.fixture(scope="module")
def from_rest():
    return hb.time.integrate(rubbing_mass(), np.zeros(4), 2, 0.9)


@pytest.mark.parametrize(("L", "T", "M"), OTHER_UNITS)
def test_integration_from_rest(L, T, M, from_rest):
    motion = hb.time.integrate(rubbing_mass(L, T, M), np.zeros(4), 2, 0.9 / T)
    np.testing.assert_allclose(motion.d / L, from_rest.d, rtol=0, atol=1e-9)


@pytest.mark.parametrize("L", [1e-12, 1e-9, 1e3])
@pytest.mark.parametrize("name", ["spur pair", "stop"])
def test_exponential_integration_of_contacts(name, L):
    """In lengths of 1e-12 the instants of contact had been in error by up to a step."""
    motions = []
    for length in (1.0, L):
        integrator = ExponentialIntegrator(in_units(MACHINES[name][0], length, 1.0, 1.0), 0.8)
        d, _ = integrator.advance(integrator.start(np.array([[0.1 * length, 0.0]])), 30, record=True)
        motions.append(d / length)
    assert np.ptp(motions[0]) > 1.0
    np.testing.assert_allclose(motions[1], motions[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("L", [1e-12, 1.0, 1e6])
def test_segments_at_and_next_to_a_breakpoint(L):
    """On a breakpoint the velocity decides, next to it the position."""
    high = L * np.array([0.0, 2.0, np.inf])
    d = L * np.array([0.0, 0.0, -0.01, 0.01, 2.0, 2.0, 1.99, 2.01])
    v = L * np.array([-1.0, 1.0, 1.0, -1.0, -1.0, 0.0, 1.0, -1.0])
    np.testing.assert_array_equal(segment_at(high, d, v), [0, 1, 0, 1, 1, 2, 1, 2])


def test_a_stop_out_of_reach_does_not_change_the_accuracy():
    far = hb.Element([1.0], hb.Unilateral(k=1.0, gap=1e6))
    cubic, load = hb.Element([1.0], hb.Cubic(k3=1.0)), hb.Load(cosine={1: [0.3]})
    with_stop, without = (
        hb.time.integrate(hb.System([[1.0]], [[0.1]], [[1.0]], elements, load), [0.1, 0.0], 3, 1.1)
        for elements in ([cubic, far], [cubic])
    )
    np.testing.assert_allclose(with_stop.end, without.end, rtol=0, atol=1e-10)


@pytest.mark.parametrize("L", [1e-9, 1e-6, 1e6])
def test_a_level_of_an_amplitude_is_followed_in_any_unit_of_length(L):
    """The same oscillator with lengths in other units: k3 L^-2, F L and the level L."""

    def followed(L):
        level = hb.Event("level", lambda point: point.amplitude("H1") - 0.4 * L)
        problem = hb.HarmonicBalance(hb.Duffing(k3=1.0 / L**2, F=0.2 * L), 5)
        curve = hb.trace(problem, "Omega", (0.5, 1.0), events=[level], accuracy=None)
        found = hb.follow(curve, "level1", "zeta", (0.05, 0.2), accuracy=None)
        assert found.status == "reached_end"
        np.testing.assert_allclose(found.amplitude("H1") / L, 0.4, rtol=1e-9)
        return found.tracked["Omega"][-1]

    assert followed(L) == pytest.approx(followed(1.0), rel=1e-9)


@hb.mechanics.model
def stopped_mass(L: float = 1.0, k: float = 50.0, gap: float = 0.5, F: float = 0.1, c: float = 0.04) -> hb.System:
    """A mass with a stop, with lengths in a unit L."""
    return single_mass(hb.Unilateral(k=k, gap=gap * L), F=F * L, c=c)


def derivatives_of(L):
    """Derivatives of the special points in the parameters, by the equations of the points."""
    curve = hb.trace(hb.HarmonicBalance(stopped_mass(L=L), 16), "Omega", (0.6, 2.0), accuracy=None)
    tables = {point.label: hb.analysis.sensitivity(point).of("Omega") for point in curve.special}
    return {label: np.array([table[name] for name in ("k", "gap", "F", "c")]) for label, table in tables.items()}


@pytest.mark.slow
def test_sensitivities_do_not_depend_on_the_unit_of_length():
    """In metres a motion is below 1e-3: second derivatives of R are differences relative to the motion there, too."""
    expected = derivatives_of(1.0)
    assert {"PD1", "LP2", "GR1"} <= set(expected)
    for L in (1e-6, 1e-9):
        found = derivatives_of(L)
        assert found.keys() == expected.keys()
        for label, value in found.items():
            np.testing.assert_allclose(value, expected[label], rtol=0, atol=1e-6 * np.abs(expected[label]).max())


@pytest.mark.parametrize("L", [1.0, 1e-6, 1e-9])
def test_the_peak_of_a_registered_measure_does_not_depend_on_the_unit_of_length(L, registries_are_restored):
    """The measure is the rms value, whose peak has equations of its own."""
    hb.harmonic.register_measure(name="alternating", text="rms")(
        lambda coefficients: np.sqrt((coefficients[..., 1:] ** 2).sum(axis=-1) / 2)
    )
    problem = hb.HarmonicBalance(hb.Duffing(k3=1.0 / L**2, F=0.2 * L, zeta=0.1), 5)
    curve = hb.trace(problem, "Omega", (0.5, 1.8), accuracy=None)
    (own,), (built_in,) = hb.analysis.peaks(curve, "alternating"), hb.analysis.peaks(curve, "rms")
    assert own.parameters["Omega"] == pytest.approx(built_in.parameters["Omega"], rel=1e-10)


@pytest.mark.parametrize("L", [1.0, 1e-6])
def test_a_corner_lies_at_its_threshold_relative_to_the_motion(L):
    """A fold 1e-5 of the motion away from the first slip is no corner, also if lengths are in metres."""
    law, event = hb.mechanics.Jenkins(k=1.0, limit=0.1 * L), SlipEvent()
    problem = hb.HarmonicBalance(single_mass(law, F=0.06 * L, c=0.02), 9)
    slip = hb.trace(problem, "Omega", (0.6, 1.4), accuracy=None)["SL1"]
    assert event.corner(problem, "Omega", slip.X, slip.parameters) is not None
    assert event.corner(problem, "Omega", slip.X * (1 - 1e-5), slip.parameters) is None
