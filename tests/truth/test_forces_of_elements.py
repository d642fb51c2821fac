"""Forces of elements along a motion: friction sliders, laws of several displacements, and the balance of the structure.

M q'' + C q' + K q + sum_j w_j p_j = F
"""

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.analysis.quantities.engineering_quantities import element_force
from hbgear.mechanics import ContactFriction, Directed, Iwan, Jenkins, RadialClearance, VectorElement
from hbgear.mechanics.series.fourier import to_complex

UNIT = np.eye(2)


def blade(law):
    return single_mass(law, F=0.3, c=0.02, name="damper")


def rotor(weight=0.0):
    seal = VectorElement(UNIT, RadialClearance(k=4.0, clearance=1.0, friction=0.1), name="seal")
    unbalance = hb.Load(cosine={1: [0.3, 0.0]}, sine={1: [0.0, 0.3]}, power=2)
    return hb.System(UNIT, 0.1 * UNIT, UNIT, [*seal], [unbalance, hb.Load([0.0, -weight])])


def foot():
    stop = hb.Element([0.0, 1.0], hb.Unilateral(k=2.0, gap=-0.1), name="stop")
    rub = hb.Element([1.0, 0.0], ContactFriction(k=5.0, friction=0.3, normal="stop"), name="rub")
    return hb.System(UNIT, 0.1 * UNIT, UNIT, [stop, rub], hb.Load(cosine={1: [0.3, 0.2]}))


def across():
    stop = hb.Element([1.0, 0.0], hb.Unilateral(k=1.0, gap=0.1), name="stop")
    cross = VectorElement(UNIT, Directed(hb.Unilateral(k=0.5, gap=0.1)), name="cross")
    return hb.System(UNIT, 0.1 * UNIT, UNIT, [stop, *cross], hb.Load(cosine={1: [0.3, 0.1]}))


@pytest.mark.parametrize(
    ("system", "Omega"),
    [
        (blade(Jenkins(k=1.0, limit=0.1)), 1.1),
        (blade(Jenkins(k=1.0, limit=0.2, cosine=(0.0, 0.1))), 1.2),
        (blade(Iwan.uniform(k=2.0, limit=0.5, number=4)), 1.2),
        pytest.param(rotor(0.3), 1.05, marks=pytest.mark.slow),
        (foot(), 0.9),
        (across(), 0.8),
    ],
    ids=("jenkins", "prescribed limit", "iwan", "rub", "contact friction", "directed"),
)
def test_forces_balance_the_structure(system, Omega):
    problem = hb.HarmonicBalance(system, 9)
    point = hb.trace(problem, "Omega", (Omega, Omega + 0.01), special=False, stability=False)[0]
    rate = Omega * np.arange(10)
    q = to_complex(problem.motion(point.X, Omega=Omega)).T
    inner = np.array([(system.K + 1j * w * system.C - w**2 * system.M) @ x for w, x in zip(rate, q, strict=True)])
    forces = np.array([element_force(problem, point.X, {"Omega": Omega}, j) for j in range(problem.m)])
    harmonics = np.fft.rfft(forces)[:, :10] / forces.shape[1] * np.where(rate > 0, 2, 1)
    inner += harmonics.T @ np.array([element.direction for element in system.elements])
    loads = np.zeros_like(inner)
    for load in system.loads:
        loads[0] += 0.0 if load.constant is None else load.constant
        for k, amplitude in load.cosine.items():
            loads[k] += amplitude * Omega**load.power
        for k, amplitude in load.sine.items():
            loads[k] -= 1j * amplitude * Omega**load.power
    np.testing.assert_allclose(inner, loads, rtol=0, atol=3e-7)
    assert np.abs(harmonics).max() > 0.03


@pytest.mark.slow
def test_friction_that_slips_has_its_limit():
    curve = hb.trace(hb.HarmonicBalance(blade(Jenkins(k=1.0, limit=0.1)), 9), "Omega", (0.9, 1.1))
    found = hb.analysis.machine_quantities(curve)
    np.testing.assert_allclose(found["force, largest"], 0.1, rtol=1e-12)
    assert not found["force, static"].any() and np.isnan(found["dynamic factor"]).all()


@pytest.mark.slow
def test_circular_whirl_in_a_hole():
    """The force turns with the shaft: k (r - clearance) (1 + friction^2)^1/2 in each direction."""
    curve = hb.trace(hb.HarmonicBalance(rotor(), 3), "Omega", (1.0, 1.1), cover=False)
    r = np.sqrt(2) * curve.amplitude("rms", "seal 1")
    for element in ("seal 1", "seal 2"):
        force = hb.analysis.order_amplitudes(curve, "force", 1, element)
        np.testing.assert_allclose(force * np.sqrt(2), 4.0 * (r - 1.0) * np.sqrt(1.01), rtol=1e-9)


@pytest.mark.filterwarnings("ignore:no friction slider slips")
def test_dynamic_factor_of_friction_with_a_mean():
    """A slider that a constant load has moved: the mean force is that of the last turning point."""
    system = single_mass(Jenkins(1.0, 0.2), F=0.05, mean=0.4, c=0.02, name="damper")
    point = hb.trace(hb.HarmonicBalance(system, 3), "Omega", (0.5, 0.51))[0]
    A = 0.05 / abs(2.0 - 0.25 + 0.01j)  # sticks: stiffness 2, the largest force is the limit
    assert hb.analysis.dynamic_factor(system, point, "damper") == pytest.approx(0.2 / (0.2 - A), rel=1e-6)
