"""Structures that depend on speed, against closed forms of rotors: whirl, unbalance, critical speeds.

disc on a shaft, tilt in the complex plane p = x + i y:   I_d p'' + (c - i I_p Omega) p' + k p = Omega^2 u e^{i tau}
"""

import numpy as np
import pytest
import scipy

from hbgear import Backlash, Cubic, Element, HarmonicBalance, Load, System, Unilateral, trace
from hbgear.analysis import campbell
from hbgear.harmonic.multipliers.hill import hill_multipliers
from hbgear.mechanics import MatrixTable, SpeedTerms, reduce
from hbgear.mechanics.series.fourier import to_complex
from hbgear.time import integrate, shoot
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.integration import state_of

M, K, C, U = 1.3, 2.0, 0.05, 0.1  # Jeffcott rotor: mass, stiffness, damping, unbalance
I_D, I_P, K_T, C_T, U_T = 0.5, 0.8, 2.4, 0.03, 0.02  # its tilt: diametral and polar inertia, ...


def disc(s=1.0, element=None, **kwargs):
    """Lateral motion (x, y) and tilts (a, b) of a rigid disc in the middle of an elastic shaft."""
    G = np.zeros((4, 4))
    G[2, 3], G[3, 2] = I_P, -I_P
    unbalance = Load(cosine={1: [U, 0, U_T, 0]}, sine={1: [0, U, 0, U_T]}, power=2)
    elements = [element or Element(np.eye(4)[i], Cubic(k1=0, k3=0)) for i in ((0,) if element else range(4))]
    return System(
        np.diag([M, M, I_D, I_D]),
        np.diag([C, C, C_T, C_T]),
        np.diag([K, K, K_T, K_T]),
        elements,
        unbalance,
        speed=SpeedTerms(G, s, **kwargs),
    )


@pytest.mark.parametrize("Omega", [0.4, 1.24, 1.7, 5.0])
def test_unbalance_of_jeffcott_rotor_and_gyroscopic_disc(Omega):
    problem = HarmonicBalance(disc(), 3)
    q = to_complex(problem.motion(problem.start(Omega=Omega), Omega=Omega))[:, 1]
    lateral = Omega**2 * U / (K - M * Omega**2 + 1j * C * Omega)
    tilt = Omega**2 * U_T / (K_T - (I_D - I_P) * Omega**2 + 1j * C_T * Omega)
    np.testing.assert_allclose(q, [lateral, -1j * lateral, tilt, -1j * tilt], rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("s", [1.0, 1 / 17])
def test_whirl_of_a_gyroscopic_disc(s):
    """lambda of I_d lambda^2 + (c -+ i I_p s Omega) lambda + k = 0: forward and backward whirl."""
    found = campbell(disc(s), (0.5, 4.0), {"shaft": s}, points=8)
    for Omega, frequencies, damping in zip(found.Omega, found.frequencies, found.damping, strict=True):
        spin = I_P * s * Omega
        roots = np.concatenate([np.roots([I_D, C_T + sign * 1j * spin, K_T]) for sign in (-1, 1)])
        roots = np.append(
            roots[roots.imag > 0], 2 * [np.roots([M, C, K])[0].real + 1j * np.sqrt(K / M - (C / 2 / M) ** 2)]
        )
        for i in np.argsort(roots.imag):
            at = np.argmin(np.abs(frequencies - roots[i].imag) + np.abs(damping + roots[i].real / abs(roots[i])))
            assert frequencies[at] == pytest.approx(roots[i].imag, rel=1e-10)
            assert damping[at] == pytest.approx(-roots[i].real / abs(roots[i]), rel=1e-9)


def test_critical_speeds_of_a_gyroscopic_disc():
    """Undamped: k = (I_d -+ I_p) Omega^2, forward only if I_d > I_p; the lateral modes at sqrt(K / M)."""
    system = disc()
    still = System(system.M, None, system.K, system.elements, system.load, speed=system.speed)
    found = campbell(still, (0.3, 3.0), points=20)
    expected = [np.sqrt(K_T / (I_D + I_P)), np.sqrt(K / M), np.sqrt(K / M)]
    np.testing.assert_allclose([one.Omega for one in found.critical], sorted(expected), rtol=1e-10)
    thin = System(
        system.M, None, system.K, system.elements, system.load, speed=SpeedTerms(0.5 * system.speed.gyroscopic)
    )
    assert np.sqrt(K_T / (I_D - I_P / 2)) == pytest.approx(4.898979, abs=1e-6)
    found = campbell(thin, (3.0, 6.0))
    assert [one.Omega for one in found.critical] == [pytest.approx(np.sqrt(24.0), rel=1e-10)]


@pytest.mark.parametrize("s", [1.0, -1 / 17])
def test_forward_whirl_is_the_mode_whose_frequency_rises_with_speed(s):
    """Equal stiffness in both planes: circles, w = +-1; the root with +I_p s Omega rises, its partner falls."""
    found = campbell(disc(s), (0.5, 4.0), {"shaft": abs(s)}, points=8)
    tilts = np.isfinite(found.whirl[0])
    assert tilts.sum() == 2  # the lateral modes have no gyroscopic forces
    for i in np.flatnonzero(tilts):
        sense = np.sign(found.frequencies[-1, i] - found.frequencies[0, i])
        np.testing.assert_allclose(found.whirl[:, i], sense, atol=1e-6)
    assert sorted(found.whirl[0, tilts]) == pytest.approx([-1, 1], abs=1e-6)
    if s == 1.0:
        (backward,) = (one for one in found.critical if np.isfinite(one.whirl))
        assert backward.Omega == pytest.approx(np.sqrt(K_T / (I_D + I_P)), rel=1e-3)
        assert backward.whirl == pytest.approx(-1, abs=1e-6)


def test_sense_of_whirl_of_an_elliptic_orbit():
    """Planes of stiffness k1, k2: (k1 - I w^2) a + i w g b = 0, and the sense is 2 Im(conj(a) b) over |a|^2 + |b|^2."""
    G, k1, k2, Omega = 0.3, 1.0, 1.5, 0.7
    linear = [Element([1.0, 0.0], Cubic(k1=0, k3=0))]
    one = System(
        np.eye(2),
        None,
        np.diag([k1, k2]),
        linear,
        Load(cosine={1: [0.1, 0.0]}),
        speed=SpeedTerms(np.array([[0.0, G], [-G, 0.0]])),
    )
    found = campbell(one, (Omega, 2 * Omega), points=2)
    for i in range(2):
        w = found.frequencies[0, i]
        ratio = -(k1 - w**2) / (1j * w * Omega * G)  # b / a
        assert found.whirl[0, i] == pytest.approx(-2 * ratio.imag / (1 + abs(ratio) ** 2), rel=1e-8)
    assert 0.1 < abs(found.whirl[0, 0]) < 0.9


def test_contacts_are_those_of_the_static_equilibrium():
    """A stop at rest with a gap adds no stiffness; a mean load beyond the gap, or its name, adds k."""
    k, gap = 3.0, 0.5
    stop = Element([1.0], Unilateral(k=k, gap=gap), name="stop")

    def lowest(force, **kwargs):
        system = System([[1.0]], None, [[1.0]], [stop], Load(constant=[force], cosine={1: [0.1]}))
        return campbell(system, (0.2, 3.0), points=3, **kwargs)

    for force, shut in ((0.0, False), (0.99 * gap, False), (1.01 * gap, True), (-2.0, False)):
        found = lowest(force)
        assert found.frequencies[0, 0] == pytest.approx(np.sqrt(1 + k * shut), rel=1e-10)
        assert (found.closed, found.opened) == ((("stop",), ()) if shut else ((), ("stop",)))
    assert lowest(0.0, closed={"stop": True}).frequencies[0, 0] == pytest.approx(np.sqrt(1 + k), rel=1e-10)
    assert lowest(2.0, closed={"stop": False}).frequencies[0, 0] == pytest.approx(1.0, rel=1e-10)
    with pytest.raises(KeyError, match="no element 'stopp'; did you mean 'stop'"):
        lowest(0.0, closed={"stopp": True})


def test_teeth_without_load_are_not_in_contact():
    """Free gears with backlash and no torque: touching flanks carry no force, the mesh has no stiffness."""
    gears = System(
        np.eye(2),
        None,
        np.diag([0.04, 0.0]),
        [Element([1.0, -1.0], Backlash(k=1.0, b=1.0), name="mesh")],
        Load(cosine={1: [0.1, 0.0]}),
    )
    found = campbell(gears, (0.1, 3.0), points=3)
    assert found.opened == ("mesh",) and found.frequencies[0].tolist() == pytest.approx([0.2])


def test_contact_that_changes_with_speed_is_reported():
    lifted = [Load(constant=[0.2], power=2), Load(cosine={1: [0.1]})]
    stop = Element([1.0], Unilateral(k=3.0, gap=0.5), name="stop")
    with pytest.warns(UserWarning, match="stop: the contact changes"):
        campbell(System([[1.0]], None, [[1.0]], [stop], lifted), (0.5, 3.0), points=3)


def mesh(**kwargs):
    """A tilting disc whose tilt meets backlash: gap, gyroscopic term, damping and stiffness over speed all at once."""
    speeds = np.linspace(0.2, 3.0, 8)
    table = MatrixTable(speeds, [np.diag([0.2, 0.1, 0.3, 0.1]) * np.sin(w) for w in speeds])
    gap = Element([0.3, 0.0, 1.0, 0.0], Backlash(0.01, 3.0), damping=0.05, name="gap")
    return disc(0.3, gap, damping=lambda w: 0.02 * w**2 * np.ones((4, 4)), stiffness=table, **kwargs)


def test_derivatives_in_frequency(slope):
    problem, rng = HarmonicBalance(mesh(), 4), np.random.default_rng(1)
    X, v = rng.standard_normal((2, problem.size))
    linear = problem.compiled({}).receptance
    here = linear.at(1.1)
    np.testing.assert_allclose(here.matrices[1], slope(lambda w: linear.at(w).Z, 1.1, 1e-4), rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(here.constants[1], slope(lambda w: linear.at(w).g, 1.1, 1e-4), rtol=1e-7, atol=1e-8)
    across = slope(lambda w: problem.evaluate(X, Omega=w)[1], 1.1, 1e-4)
    np.testing.assert_allclose(problem.curvature(X, v, "Omega", Omega=1.1)[1], across, rtol=1e-6, atol=1e-7)


def test_the_linear_part_is_that_of_the_frozen_structure():
    system = mesh()
    spinning, frozen = HarmonicBalance(system, 5), HarmonicBalance(system.at_speed(1.1), 5)
    X = spinning.start(Omega=1.1)
    np.testing.assert_allclose(X, frozen.start(Omega=1.1), rtol=1e-9, atol=1e-12)
    assert not np.allclose(X, HarmonicBalance(system.at_speed(1.3), 5).start(Omega=1.1), rtol=1e-3)


@pytest.mark.slow
def test_nonlinear_motions_agree_with_integration_in_time():
    system = mesh()
    problem = HarmonicBalance(system, 24)
    curve = trace(problem, "Omega", (0.7, 2.2))
    assert curve.status.complete and [p.kind for p in curve.special]
    for i in (10, len(curve) // 2, -10):
        X, Omega = curve.X[i], float(curve.values[i])
        state = state_of(problem, X, Omega=Omega)
        orbit = shoot(system, Omega, state)
        allowed = (20 * curve.error[i] + 1e-9) * np.repeat([1, 24 * Omega], 4)  # of velocities as of the last harmonic
        assert np.all(np.abs(orbit.state - state) < allowed)
        leading = np.sort(np.abs(curve.multipliers[i]))
        np.testing.assert_allclose(np.sort(np.abs(orbit.multipliers)), leading, atol=2e-3)
        hill = hill_multipliers(problem.compiled({}), X, Omega)
        np.testing.assert_allclose(np.sort(np.abs(hill))[-2:], leading[-2:], atol=1e-2)
        ends = [integrate(system, orbit.state, 3, Omega, method=name).end for name in ("DOP853", "exponential")]
        np.testing.assert_allclose(*ends, atol=1e-8)


def test_one_stepper_for_several_speeds():
    system = mesh()
    state = 0.01 * np.arange(8.0)
    both = integrate(system, np.tile(state, (2, 1)), 2, np.array([0.8, 1.4]), method="exponential")
    for i, Omega in enumerate((0.8, 1.4)):
        one = integrate(system, state, 2, Omega)
        np.testing.assert_allclose(both.end[i], one.end, atol=1e-7)
    stepper = ExponentialIntegrator(system, np.array([0.8, 1.1, 1.4]))
    some = stepper.select(np.array([2, 0])).select(np.array([1]))
    assert some.Omega.tolist() == [0.8] and some.at(1.3).Omega.tolist() == [1.3]


def test_table_and_function_are_one():
    values = np.linspace(0.1, 3.0, 400)
    matrices = [np.diag([0.1, 0.2]) * np.cos(w) for w in values]
    stop = Element([1.0, 0.0], Unilateral(2.0, 0.1))
    load = Load(cosine={1: [0.1, 0.1]})

    def solved(stiffness):
        system = System(np.eye(2), 0.1 * np.eye(2), np.eye(2), [stop], load, speed=SpeedTerms(stiffness=stiffness))
        return HarmonicBalance(system, 6).start(Omega=0.9)

    exact = solved(lambda w: np.diag([0.1, 0.2]) * np.cos(w))
    np.testing.assert_allclose(solved(MatrixTable(values, matrices)), exact, atol=1e-5)


def test_reduction_keeps_terms_that_depend_on_speed():
    """A chain of gyroscopic discs by all but a few of its modes: the same receptance, and so the same motion."""
    n = 24
    chain = n * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K, mass = scipy.linalg.block_diag(chain, chain), np.eye(2 * n) / n
    G = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]]) / n
    stop = Element(np.eye(2 * n)[n // 2], Unilateral(2.0, 0.05))
    load = Load(cosine={1: np.eye(2 * n)[n // 2]}, sine={1: 0.3 * np.eye(2 * n)[n + 3]})
    full = System(
        mass,
        0.002 * K,
        K,
        [stop],
        load,
        speed=SpeedTerms(G, 0.7, stiffness=MatrixTable([0.1, 2.0], [0.1 * K, 0.2 * K])),
    )
    small = reduce(full, modes=30)
    assert small.error([0.5, 1.0, 2.0], Omega=1.0).max() < 1e-3
    X = [HarmonicBalance(system, 6).start(Omega=1.0) for system in (full, small.system)]
    np.testing.assert_allclose(X[1], X[0], atol=1e-3 * np.abs(X[0]).max())
    with pytest.raises(ValueError, match="give Omega"):
        small.error([1.0])


def test_switched_off_nothing_changes():
    gap = Element([1.0, -1.0], Backlash(0.1, 2.0), damping=0.05)
    plain = System(np.eye(2), 0.02 * np.eye(2), np.eye(2), [gap], Load(cosine={1: [0.2, 0.0]}))
    zero = System(plain.M, plain.C, plain.K, [gap], plain.load, speed=SpeedTerms(np.zeros((2, 2))))
    one, other = (trace(HarmonicBalance(system, 8), "Omega", (0.6, 2.0)) for system in (plain, zero))
    assert [p.kind for p in one.special] == [p.kind for p in other.special]
    for a, b in zip(one.special, other.special, strict=True):
        assert a.parameters["Omega"] == pytest.approx(b.parameters["Omega"], rel=1e-7)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: SpeedTerms(), "give gyroscopic, damping or stiffness"),
        (lambda: SpeedTerms(np.eye(2)), "skew-symmetric"),
        (lambda: SpeedTerms(np.zeros((2, 3))), "square"),
        (lambda: SpeedTerms([[0, np.nan], [0, 0]]), "not finite"),
        (lambda: SpeedTerms(np.zeros((2, 2)), "fast"), "ratio"),
        (lambda: SpeedTerms(stiffness=3.0), "MatrixTable or a function"),
        (lambda: MatrixTable([1.0, 0.5], np.zeros((2, 1, 1))), "ascend"),
        (lambda: MatrixTable([0.5, 1.0], np.zeros((3, 1, 1))), "3 matrices for 2"),
        (lambda: MatrixTable([0.5, 1.0], np.full((2, 1, 1), np.inf)), "not finite"),
        (lambda: MatrixTable([0.5, 1.0], np.zeros((2, 1, 1)))(2.0), "outside of a table"),
        (lambda: mesh().at_speed(4.0), "outside of a table over Omega from 0.2 to 3"),
        (lambda: trace(HarmonicBalance(mesh(), 4), "Omega", (1.0, 4.0)), "Omega"),
        (lambda: campbell(mesh(), (1.0, 4.0)), "exceeds the tables"),
        (lambda: campbell(disc(), (2.0, 1.0)), "end of the span"),
        (lambda: campbell(disc(), (1.0, 2.0), {"mesh": -1.0}), "order 'mesh'"),
        (lambda: campbell(disc(), (1.0, 2.0), closed=[True]), "one for each element"),
        (
            lambda: System(
                np.eye(3), None, np.eye(3), [Element(np.ones(3), Backlash())], speed=SpeedTerms(np.zeros((2, 2)))
            ),
            "shape of M",
        ),
        (lambda: HarmonicBalance(disc(damping=lambda w: np.eye(3)), 3).start(Omega=1.0), r"need \(4, 4\)"),
    ],
)
def test_bad_input(make, said):
    with pytest.raises((ValueError, TypeError), match=said):
        make()


def test_a_linear_element_needs_no_static_equilibrium():
    """A free chain with an element without stiffness: sqrt(2 k / m), although no equilibrium exists."""
    K = np.array([[1.0, -1.0], [-1.0, 1.0]])
    element = Element([1.0, 0.0], Cubic(k3=0.0), name="none")
    found = campbell(System(np.eye(2), 0 * K, K, [element], Load()), (1.0, 2.0), points=2)
    np.testing.assert_allclose(found.frequencies[-1], [np.sqrt(2.0)], rtol=1e-9)
