"""Rigid friction by time integration: closed forms, differences of the period map, and the limit of stiff sliders."""

import numpy as np
import pytest
from machines import single_mass

import hbgear as hb
from hbgear.mechanics import Coulomb, RigidFriction
from hbgear.mechanics.laws.registry import LAWS


def oscillator(static, kinetic, zeta=0.0, speed=0.0, force=0.0):
    return single_mass(RigidFriction(static, kinetic, speed), F=force, c=2 * zeta, name="friction")


def test_mass_on_a_belt_in_closed_form():
    """It sticks until the spring force is the static limit, and slips on a circle about the kinetic one."""
    static, kinetic, speed = 1.0, 0.7, 0.3
    motion = hb.time.integrate(oscillator(static, kinetic, speed=speed), [0.0, 0.0], 5, 1.0, samples=1024)
    slip, stick = np.diff(motion.switches[-3:])
    step = static - kinetic
    assert abs(stick - 2 * step / speed) < 1e-9
    assert abs(slip - (2 * np.pi - 2 * np.arctan(step / speed))) < 1e-9
    cycle = motion.tau > motion.switches[-3]
    assert abs(motion.d[0, cycle].min() - (kinetic - np.hypot(step, speed))) < 1e-5
    assert abs(motion.v[0, cycle].max() - speed) < 1e-10


@pytest.mark.parametrize(
    ("static", "kinetic", "speed", "zeta", "period", "stick"),
    [
        (1.0, 0.7, 0.3, 0.0, 6.71238898038456, 1.999999999999659),
        (0.4, 0.25, 0.1, 0.02, 7.168858688051557, 2.774687276179975),
    ],
)
def test_stick_slip_cycles_of_event_exact_integration(static, kinetic, speed, zeta, period, stick):
    motion = hb.time.integrate(oscillator(static, kinetic, zeta, speed), [0.0, 0.0], 8, 1.0)
    times = np.diff(motion.switches[-5:])
    assert abs(times[:2].sum() - period) < 1e-8 and abs(times.min() - stick) < 1e-8


@pytest.mark.parametrize("Omega", [0.8, 1.3])
def test_forced_oscillator_without_stops_in_closed_form(Omega):
    """Den Hartog (1931), Trans. ASME 53, 107-115."""
    limit = 0.2
    sines = np.sin(np.pi / Omega) / (Omega * (1 + np.cos(np.pi / Omega)))
    amplitude = np.sqrt(1 / (1 - Omega**2) ** 2 - limit**2 * sines**2)
    model = oscillator(limit, limit, force=1.0)
    orbit = hb.time.shoot(model, Omega, hb.time.integrate(model, [amplitude, 0.0], 4, Omega).end)
    motion = orbit.motion()
    assert len(motion.switches) == 2
    peak = hb.time.integrate(model, orbit.state, 1, Omega, samples=20000).d.max()
    assert abs(peak - amplitude) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize(
    ("static", "kinetic", "force", "Omega", "speed", "sticks"),
    [(0.6, 0.4, 1.0, 0.35, 0.0, 2), (0.4, 0.4, 0.7, 0.3, 0.0, 2), (0.5, 0.35, 0.6, 0.7, 0.2, 1)],
)
def test_monodromy_matrices_have_the_jumps_of_the_vector_field(static, kinetic, force, Omega, speed, sticks):
    model = oscillator(static, kinetic, 0.05, speed, force)
    orbit = hb.time.shoot(model, Omega, hb.time.integrate(model, [0.1, 0.0], 8, Omega).end)
    sides = [
        [hb.time.integrate(model, orbit.state + h, 1, Omega).end for h in (1e-6 * e, -1e-6 * e)] for e in np.eye(2)
    ]
    map_slopes = np.array([(ahead - behind) / 2e-6 for ahead, behind in sides]).T
    assert len(orbit.motion().switches) >= 2 * sticks
    np.testing.assert_allclose(orbit.monodromy, map_slopes, atol=3e-6)
    assert abs(orbit.multipliers[1]) < 1e-10 < abs(orbit.multipliers[0])  # the instant of sticking forgets the phase


def chain(laws):
    elements = [
        hb.Element(w, law, name=f"f{i}") for i, (w, law) in enumerate(zip([[1, 0], [-1, 1]], laws, strict=True))
    ]
    return hb.System(
        np.diag([1.0, 0.5]),
        [[0.1, -0.02], [-0.02, 0.06]],
        [[2, -1], [-1, 1.5]],
        elements,
        hb.Load(cosine={1: [0.0, 1]}),
    )


@pytest.mark.slow
def test_two_elements_are_the_limit_of_stiff_sliders():
    """Sliders vibrate while they stick; the difference of the motions decreases like the root of 1 / k."""
    limits, Omega, start = (0.3, 0.2), 0.6, np.zeros(4)
    rigid = hb.time.integrate(chain([RigidFriction(x, x) for x in limits]), start, 3, Omega)
    size, differences = np.abs(rigid.d).max(), []
    for k in (300.0, 3000.0):
        soft = hb.time.integrate(chain([Coulomb(x, k) for x in limits]), start, 3, Omega)
        differences.append(np.abs(soft.d - rigid.d).max() / size)
    assert differences[0] < 0.05 and 2.5 < differences[0] / differences[1] < 4
    assert ((np.abs(rigid.v) < 1e-12).mean(axis=1) > 0.01).all() and len(rigid.switches) > 10


@pytest.mark.slow
def test_independent_oscillators_in_other_coordinates():
    """x = T q couples the coordinates of two oscillators, and both may stick at the same time."""
    T, zeta = np.array([[1.0, 0.4], [-0.3, 0.9]]), 0.05
    laws = RigidFriction(0.6, 0.4), RigidFriction(0.5, 0.35, 0.1)
    load = hb.Load(cosine={1: T.T @ [1.0, 0.6]})
    elements = [hb.Element(T[i], law, name=f"f{i}") for i, law in enumerate(laws)]
    both = hb.System(T.T @ T, 2 * zeta * T.T @ T, T.T @ T, elements, load)
    motion = hb.time.integrate(both, np.zeros(4), 4, 0.35)
    alone = [
        hb.time.integrate(oscillator(law.static, law.kinetic, zeta, law.speed, force), np.zeros(2), 4, 0.35)
        for law, force in zip(laws, (1.0, 0.6), strict=True)
    ]
    np.testing.assert_allclose(motion.d, np.concatenate([one.d for one in alone]), atol=1e-7)
    np.testing.assert_allclose(motion.switches, np.sort(np.concatenate([one.switches for one in alone])), atol=1e-7)
    assert ((np.abs(alone[0].v) < 1e-11) & (np.abs(alone[1].v - 0.1) < 1e-11)).any()


def test_a_motion_within_the_static_limit_rests():
    motion = hb.time.integrate(oscillator(1.0, 0.5, force=0.99), [0.0, 0.0], 3, 0.5)
    assert not len(motion.switches) and not motion.d.any()
    assert len(hb.time.integrate(oscillator(1.0, 0.5, force=1.01), [0.0, 0.0], 1, 0.5).switches)


@pytest.mark.slow
def test_breakpoints_of_the_excitation_do_not_release_an_element():
    """A second mass with a stiffness that jumps at 64 phases leaves the instants of the first one unchanged."""
    phases = np.linspace(0, 2 * np.pi, 65)
    spring = hb.Backlash(b=5.0, stiffness=hb.mechanics.Periodic.table(phases[:-1], 1 + 0.1 * (-1.0) ** np.arange(64)))
    friction = hb.Element([1.0, 0.0], RigidFriction(0.6, 0.4), name="friction")
    other = hb.Element([0.0, 1.0], spring, name="other")
    both = hb.System(np.eye(2), 0.1 * np.eye(2), np.eye(2), [friction, other], hb.Load(cosine={1: [1.0, 0.0]}))
    alone = hb.time.integrate(oscillator(0.6, 0.4, 0.05, force=1.0), np.zeros(2), 3, 0.35)
    found = hb.time.integrate(both, np.zeros(4), 3, 0.35)
    assert len(found.switches) == len(alone.switches) > 6
    np.testing.assert_allclose(found.switches, alone.switches, atol=1e-8)


def test_rigid_friction_in_toml():
    law = LAWS["rigid friction"].from_toml({"static": 0.6, "kinetic": 0.4, "speed": 0.1})
    assert law == RigidFriction(0.6, 0.4, 0.1)


def test_bad_input():
    with pytest.raises(ValueError, match=r"static = 0\.5 must be at least kinetic = 0\.7"):
        RigidFriction(0.5, 0.7)
    model = oscillator(0.6, 0.4, force=1.0)
    with pytest.raises(ValueError, match=r"'friction' has rigid friction.*Coulomb\(limit, k\)"):
        hb.HarmonicBalance(model, 5)
    with pytest.raises(ValueError, match=r"'friction' has rigid friction"):
        hb.ContactInstants(model)
    with pytest.raises(ValueError, match="does not integrate friction"):
        hb.time.integrate(model, [0.0, 0.0], 1, 1.0, method="exponential")
    both = hb.mechanics.Parallel((RigidFriction(0.6, 0.4), hb.Cubic(1.0)))
    with pytest.raises(ValueError, match="give the friction an element of its own"):
        hb.time.integrate(single_mass(both, c=0.0), [0.0, 0.0], 1, 1.0)
    twice = [hb.Element([1.0], RigidFriction(0.6, 0.4), name=name) for name in ("a", "b")]
    with pytest.raises(ValueError, match="'a', 'b' with rigid friction are linearly dependent"):
        hb.time.integrate(hb.System([[1.0]], [[0.0]], [[1.0]], twice), [0.0, 0.0], 1, 1.0)
