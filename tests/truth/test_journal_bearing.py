"""Hopf points and limit cycles of a rotor in a short journal bearing, and Campbell diagrams of shafts in round holes.

    x'' = (1, 0) + B (-F_r n + F_t t),   e = |x|,  n = x / e,  p' = angular speed of n
    F_r = 2 e^2 (w - 2 p') / (1 - e^2)^2 + pi (1 + 2 e^2) e' / (1 - e^2)^2.5
    F_t = pi e (w - 2 p') / (2 (1 - e^2)^1.5) + 4 e e' / (1 - e^2)^2

Displacements are in tenths of the clearance.
"""

import math
from dataclasses import dataclass

import numpy as np
import pytest

import hbgear as hb

CLEARANCE = 10.0


@dataclass(frozen=True)
class ShortBearing(hb.mechanics.VectorLaw):
    B: float
    speed: float

    @property
    def size(self) -> int:
        return 2

    @property
    def reference(self) -> float:
        return 1.0

    def force(self, d, v, tau):
        d, v, h = d / CLEARANCE, v / CLEARANCE, 1e-30
        kd, kv = (np.empty((2, 2, d.shape[1])) for _ in range(2))
        for j in range(2):  # derivatives by complex steps
            step = np.zeros((2, 1), dtype=complex)
            step[j] = 1j * h
            kd[:, j], kv[:, j] = self._film(d + step, v).imag / h, self._film(d, v + step).imag / h
        return CLEARANCE * self._film(d, v), kd, kv

    def _film(self, d, v):
        square = d[0] ** 2 + d[1] ** 2 + 1e-24
        e, room = np.sqrt(square), 1 - square
        n, t = d / e, np.array([-d[1], d[0]]) / e
        radial, sliding = n[0] * v[0] + n[1] * v[1], self.speed - 2 * (t[0] * v[0] + t[1] * v[1]) / e
        F_r = 2 * square * sliding / room**2 + math.pi * (1 + 2 * square) * radial / room**2.5
        F_t = math.pi * e * sliding / (2 * room**1.5) + 4 * e * radial / room**2
        return self.B * (F_r * n - F_t * t)


@hb.mechanics.model
def rotor(B: float = 0.05, speed: float = 3.0) -> hb.System:
    bearing = hb.mechanics.VectorElement(np.eye(2), ShortBearing(B, speed), name="bearing")
    return hb.System(np.eye(2), None, np.zeros((2, 2)), [*bearing], hb.Load(constant=[CLEARANCE, 0.0]))


@pytest.mark.parametrize(
    ("B", "span", "speed", "whirl"),
    [
        (0.05, (3.0, 5.0), 3.876154693080033, 1.2472269242363203),
        (0.2, (2.0, 3.0), 2.5878939507798515, 1.2945337982600496),
    ],
)
def test_oil_whip_begins_at_the_eigenvalues(B, span, speed, whirl):
    (hopf,) = hb.analysis.hopf_points(rotor(B, span[0]), "speed", span, start=np.array([5.0, 4.0]))
    assert abs(hopf.value - speed) < 1e-10
    assert abs(hopf.Omega - whirl) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize(
    ("speed", "omega", "rms", "mu"),
    [
        (3.953677786941634, 1.2523348358019553, (0.029581847656695304, 0.030640596609450926), 0.9798199257799872),
        (4.263770162388036, 1.2745253128459275, (0.06853671613693213, 0.06568557633136167), 0.9050951813514796),
    ],
)
def test_limit_cycles_agree_with_shooting(speed, omega, rms, mu):
    (hopf,) = hb.analysis.hopf_points(rotor(), "speed", (3.0, 5.0), start=np.array([5.0, 4.0]))
    last = hb.analysis.limit_cycles(rotor(), hopf, (hopf.value, speed), harmonics=12)[-1]
    assert abs(last.parameters["Omega"] - omega) < 1e-10
    np.testing.assert_allclose([last.amplitude("rms", j) / CLEARANCE for j in (0, 1)], rms, rtol=0, atol=1e-10)
    assert abs(abs(last.multipliers[0]) - mu) < 1e-8


@pytest.fixture
def resting() -> hb.System:
    """A shaft of weight 3 in a hole of clearance 1 and stiffness 4, on springs of stiffness 1: contact at r = 7 / 5."""
    hole = hb.mechanics.VectorElement(np.eye(2), hb.mechanics.RadialClearance(4.0, 1.0), name="hole")
    loads = [hb.Load(cosine={1: [0.01, 0.0]}), hb.Load(constant=[0.0, -3.0])]
    return hb.System(np.eye(2), 0.02 * np.eye(2), np.eye(2), [*hole], loads)


def test_a_shaft_that_rests_in_a_hole(resting):
    """At r = 1.4, 1.4 + 4 (1.4 - 1) = 3: stiffness 1 + 4 along the contact and 1 + 4 (1 - 1 / 1.4) across it."""
    found = hb.analysis.campbell(resting, (0.1, 3.0), points=2)
    squares = [1 + 4 * (1 - 1 / 1.4), 5.0]
    np.testing.assert_allclose(found.frequencies[0] ** 2, [s - 1e-4 for s in squares], rtol=1e-8)
    closed = hb.analysis.campbell(resting, (0.1, 3.0), points=2, closed=True)
    np.testing.assert_allclose(closed.frequencies[0] ** 2, [5.0 - 1e-4] * 2, rtol=1e-9)


def test_equilibrium_of_a_shaft_in_a_hole_with_friction():
    """(k0 + k (1 - c / r) (1 + i mu)) z = -i W at rest."""
    hole = hb.mechanics.VectorElement(np.eye(2), hb.mechanics.RadialClearance(4.0, 1.0, 0.3), name="hole")
    model = hb.System(np.eye(2), 0.02 * np.eye(2), np.eye(2), [*hole], hb.Load(constant=[0.0, -3.0]))
    x, y = hb.harmonic.EquilibriumProblem(model).start()
    z = complex(x, y)
    assert abs((1 + 4 * (1 - 1 / abs(z)) * (1 + 0.3j)) * z + 3j) < 1e-9
