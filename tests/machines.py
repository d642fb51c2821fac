"""Models as users write them; processes import them from here."""

import typing
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

import hbgear as hb

Ratio = Annotated[float, "over the critical one"]


def single_mass(law, F=None, mean=None, c=0.1, k=1.0, **element):
    """A unit mass on a damper and a spring, with a law; ``mean`` + F cos(tau) acts on it."""
    load = hb.Load(None if mean is None else [mean], {} if F is None else {1: [F]})
    return hb.System(np.eye(1), None if c is None else [[c]], [[k]], [hb.Element([1.0], law, **element)], load)


def system(zeta, F):
    """The Duffing oscillator of hbgear, as a user would write it."""
    spring = hb.Element([1.0], hb.Cubic(0.1), name="x")
    return hb.System([[1.0]], [[2 * zeta]], [[1.0]], [spring], hb.Load(cosine={1: [F]}))


@hb.mechanics.model(ranges={"zeta": hb.mechanics.Range(low=0)}, default_span=(0.5, 1.6), labels={"zeta": "damping"})
def two(zeta: Ratio = 0.05, F: float | np.floating = 0.18, n: int = 1, kind: Literal["a", "b"] = "a") -> hb.System:
    """An oscillator of somebody."""
    return system(zeta, F)


@dataclass(frozen=True)
class Needs(hb.mechanics.Model):
    """A machine with a field that has no default."""

    F: "float"
    zeta: Annotated[float, "damping ratio"] = 0.05
    teeth: int | np.integer = 30
    W: np.float64 = 0.0  # type: ignore[assignment]
    other: typing.Optional[float] = None  # noqa: UP045

    def system(self):
        return system(self.zeta, self.F)


def gear_pair(teeth=(25, 40), **fields):
    """A pair of spur gears of 3 mm module, 20 mm wide, with a backlash of 80 um; ``fields`` are those of both gears."""
    return hb.GearPair(*(hb.gears.Gear(z, "3 mm", "20 mm", **fields) for z in teeth), backlash="80 um")


@dataclass(frozen=True)
class VanDerPol(hb.mechanics.Law):
    """Negative damping of small motions: eps (d^2 - 1) v + quadratic d^2."""

    eps: float = 0.2
    quadratic: float = 0.0

    def force(self, d, v, tau):
        force = self.eps * (d**2 - 1) * v + self.quadratic * d**2
        return force, 2 * self.eps * d * v + 2 * self.quadratic * d, self.eps * (d**2 - 1)


@dataclass(frozen=True)
class SteepFriction(hb.mechanics.Law):
    """Regularized friction: p = limit tanh(v / scale)."""

    limit: float = 0.1
    scale: float = 0.05

    def force(self, d, v, tau):
        p = np.tanh(v / self.scale)
        return self.limit * p, 0 * d, self.limit / self.scale * (1 - p * p)


@dataclass(frozen=True)
class Drag(hb.mechanics.Law):
    """Damping that varies with the motion: p = c d^2 v + (1 + wave cos(tau)) d + cubic v^3."""

    c: float = 0.3
    wave: float = 0.0
    cubic: float = 0.0

    reference = 1.0

    def force(self, d, v, tau):
        k, square = 1 + self.wave * np.cos(tau), self.c * d * d
        return square * v + k * d + self.cubic * v**3, 2 * self.c * d * v + k, square + 3 * self.cubic * v * v


@hb.mechanics.model
def van_der_pol(eps: float = 0.2, damping: float = 0.0) -> hb.System:
    """The van der Pol oscillator."""
    return hb.System([[1.0]], [[damping]], [[1.0]], [hb.Element([1.0], VanDerPol(eps))])


def two_masses(F=0.13, ground=None, link=None):
    """Two masses whose response is quasi-periodic between the Neimark-Sacker points 1.1153 and 1.2513."""
    C, K = [[0.015, -0.013], [-0.013, 0.013]], [[1.0453, -0.0453], [-0.0453, 0.0453]]
    springs = [
        hb.Element([1.0, 0.0], ground or hb.Cubic(1.0), name="ground"),
        hb.Element([1.0, -1.0], link or hb.Cubic(0.0042), name="link"),
    ]
    return hb.System(np.diag([1.0, 0.05]), C, K, springs, hb.Load(cosine={1: [F, 0.0]}))


@hb.mechanics.model
def chain(limit: float = 1.0, load: float = 1.0) -> hb.System:
    """Three masses with stiff sliders to the ground and between two of them, cubic springs and a stop."""
    K = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    elements = [
        hb.Element([1.0, 0.0, 0.0], hb.mechanics.Jenkins(20.0, limit), name="ground"),
        hb.Element([-1.0, 1.0, 0.0], hb.mechanics.Jenkins(20.0, 1.0), name="link"),
        hb.Element([0.0, 1.0, 0.0], hb.Cubic(1.0), name="second"),
        hb.Element([0.0, -1.0, 1.0], hb.Cubic(1.0), name="third"),
        hb.Element([0.0, 0.0, 1.0], hb.Unilateral(k=1.0, gap=0.25), name="stop"),
    ]
    return hb.System(np.eye(3), 0.02 * K, K, elements, hb.Load(cosine={1: [0.0, load, 0.0]}))


def static_node(stop, condensed=False):
    """Two masses joined by two springs in series, whose node has no mass, or by one spring; a stop at the first one."""
    a, b = 1.5, 0.7
    if condensed:
        k = a * b / (a + b)
        K = np.array([[1 + k, -k], [-k, 1 + k]])
        load = hb.Load(cosine={1: [0.2 * a / (a + b), 0.3 + 0.2 * b / (a + b)]})
        return hb.System(np.eye(2), 0.05 * np.eye(2), K, [hb.Element([1.0, 0.0], stop, name="stop")], load)
    K = np.array([[1 + a, -a, 0.0], [-a, a + b, -b], [0.0, -b, 1 + b]])
    element, M = hb.Element([1.0, 0.0, 0.0], stop, name="stop"), np.diag([1.0, 0, 1])
    return hb.System(M, 0.05 * M, K, [element], hb.Load(cosine={1: [0.0, 0.2, 0.3]}))


def state_matrix(M, C, K):
    """The matrix A of the equations of motion (q, v)' = A (q, v)."""
    n = len(M)
    return np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])


def cantilever(n):
    """Mass and stiffness matrices of a clamped beam of unit length, mass and bending stiffness, of n elements."""
    h, (M, K) = 1 / n, np.zeros((2, 2 * n + 2, 2 * n + 2))
    stiffness = [
        [12, 6 * h, -12, 6 * h],
        [6 * h, 4 * h**2, -6 * h, 2 * h**2],
        [-12, -6 * h, 12, -6 * h],
        [6 * h, 2 * h**2, -6 * h, 4 * h**2],
    ]
    mass = [
        [156, 22 * h, 54, -13 * h],
        [22 * h, 4 * h**2, 13 * h, -3 * h**2],
        [54, 13 * h, 156, -22 * h],
        [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
    ]
    for e in range(n):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += np.divide(stiffness, h**3)
        M[at, at] += np.multiply(mass, h / 420)
    return M[2:, 2:], K[2:, 2:]
