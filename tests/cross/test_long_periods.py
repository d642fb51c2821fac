"""Trains whose tooth frequencies have a high common multiple: ordinary tooth counts, unbalanced wheels."""

from math import cos, pi, radians

import numpy as np
import pytest

import hbgear as hb
from hbgear.harmonic.equations.harmonic_selection import tooth_orders

MODULES = 2e-3, 2e-3, 3e-3, 3e-3


def two_stages(teeth, eps=(), unbalance=None, **meshes):
    """Wheel a drives b, on whose shaft c drives d; unbalances by wheel, which then moves in the plane."""
    radii = [m * z * cos(radians(20)) / 2 for m, z in zip(MODULES, teeth, strict=True)]
    middle = MODULES[0] * sum(teeth[:2]) / 2
    places = 0.0, middle, middle, middle + MODULES[2] * sum(teeth[2:]) / 2
    unbalance = unbalance or {}
    wheels = [
        hb.gears.Wheel(
            name,
            7800 * pi / 32 * 0.03 * (m * z) ** 4,
            teeth=z,
            base_radius=r,
            x=x,
            mass=1.0,
            torque=9000.0 if name == "a" else 0.0,
            moves="plane" if name in unbalance else "torsion",
            unbalance=unbalance.get(name, 0.0),
        )
        for name, m, z, r, x in zip("abcd", MODULES, teeth, radii, places, strict=True)
    ]
    two = [hb.gears.Mesh(*ends, 4e8, 4e-5, eps, e=(3e-6, 1e-6)) for ends in ("ab", "cd")]
    bearings = [hb.gears.Bearing(name, x=1e8, y=1.3e8) for name in unbalance]
    return hb.gears.Train(wheels, two, [hb.gears.Shaft("b", "c", torsion=4e5)], bearings, balance="d", **meshes)


def linear_response(system, Omega):
    """Complex amplitudes {order: (m,)} of the element coordinates with all teeth in contact."""
    W = np.array([e.direction for e in system.elements]).T
    k = np.array([e.law.stiffness.mean if hasattr(e.law, "stiffness") else e.law.k for e in system.elements])
    c = np.array([e.damping for e in system.elements])
    K, C = system.K + (W * k) @ W.T, system.C + (W * c) @ W.T
    rows = np.array([e.displacement.row(300) for e in system.elements])
    errors = {n: rows[:, 2 * n - 1] - 1j * rows[:, 2 * n] for n in range(1, 301)}
    loads = {n: np.zeros(system.n, complex) for n in errors}
    for load in system.loads:
        for n, F in load.complex(system.n).items():
            if n:
                loads[n] = loads[n] + F * Omega**load.power
    out = {}
    for n in errors:
        if errors[n].any() or loads[n].any():
            w = n * Omega
            q = np.linalg.solve(K - w**2 * system.M + 1j * w * C, loads[n] + W @ ((k + 1j * w * c) * errors[n]))
            out[n] = W.T @ q - errors[n]
    return out


@pytest.mark.parametrize(
    ("teeth", "unbalance", "orders"),
    [
        ((82, 23, 88, 22), {}, {23, 46, 88, 176}),
        ((21, 83, 19, 77), {}, {83, 166, 19, 38}),
        ((22, 88, 88, 22), {"b": 2e-4}, {1, 88, 176}),
        ((22, 33, 31, 62), {"a": 1e-4, "b": 2e-4}, {2, 3, 66, 132, 62, 124}),
    ],
)
def test_small_motions_are_the_linear_response(teeth, unbalance, orders):
    train = two_stages(teeth, unbalance=unbalance)
    problem = hb.HarmonicBalance(train, 2)
    assert problem.selection is not None
    assert orders <= set(problem.orders.tolist())
    highest = max(train.orders.values())
    Omega = 0.31 / highest
    X = problem.start(Omega=Omega)
    spread = problem.discretization.spread(X)
    expected = linear_response(train.system(), Omega)
    assert min(orders) in expected
    for n, d in expected.items():
        found = spread[:, 2 * n - 1] - 1j * spread[:, 2 * n]
        np.testing.assert_allclose(found, d, rtol=0, atol=1e-8 * np.abs(d).max())


def test_base_orders_of_functions_with_breakpoints():
    """A square wave that repeats itself 700 times a period has the base order 700."""
    from hbgear.gears.trains.train import in_order

    wave = hb.mechanics.Periodic.rectangular(1.2, 0.8, 0.3)
    ramp = hb.mechanics.Periodic.table([0.0, 1.0, 4.0], [0.0, 0.05, -0.03])
    elements = [
        hb.Element([1.0, -1.0], hb.Backlash(b=1.0, stiffness=in_order(wave, 700, 0.3))),
        hb.Element([1.0, 0.0], hb.Backlash(b=1.0), in_order(ramp, 90, 0.1)),
    ]
    system = hb.System(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), elements, hb.Load(constant=[0.1, 0.2]))
    assert tooth_orders(system) == (90, 700)


def test_orders_up_to_sixty_are_all_unknowns():
    assert hb.HarmonicBalance(two_stages((20, 30, 20, 60)), 8).selection is None


def test_tables_that_need_too_much_memory_are_refused():
    with pytest.raises(ValueError, match=r"harmonics up to 8,924 .* GB for a table of basis functions"):
        hb.HarmonicBalance(two_stages((23, 97, 31, 89), unbalance={"a": 1e-4, "b": 2e-4}), 4)


def test_common_periods_that_are_too_long_are_refused():
    with pytest.raises(ValueError, match=r"no simple ratio.*at most 10,000.*fewer wheels with unbalance"):
        two_stages((41, 97, 43, 89), unbalance=dict.fromkeys("abd", 1e-4))
