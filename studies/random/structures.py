"""Further machines drawn at random: fifteen kinds that differ from those of `studies.random.machines`.

    machine("chain", 7)  is the same machine wherever it is asked for: kind and number are its seed

One machine in eight is extreme, as there: little damping, stiff contacts, small loads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.mechanics.laws.laws import Forces
from studies.random.drawing import Span, falling, logarithmic

Drawn = tuple[hb.mechanics.Model, Span]


# ---- laws of a user


@dataclass(frozen=True)
class Septic(hb.mechanics.Law):
    """p = k d + k7 d^7."""

    k: float
    k7: float

    @property
    def reference(self) -> float:
        """See `hbgear.mechanics.Law`."""
        return self.k

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """See `hbgear.mechanics.Law`."""
        return self.k * d + self.k7 * d**7, self.k + 7 * self.k7 * d**6, 0 * d


@dataclass(frozen=True)
class Saturating(hb.mechanics.Law):
    """A spring that softens: p = f tanh(k d / f)."""

    k: float
    f: float

    @property
    def reference(self) -> float:
        """See `hbgear.mechanics.Law`."""
        return self.k

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """See `hbgear.mechanics.Law`."""
        t = np.tanh(self.k * d / self.f)
        return self.f * t, self.k * (1 - t * t), 0 * d


@dataclass(frozen=True)
class SoftStop(hb.mechanics.Law):
    """A stop with a rounded corner of width w: p = k w log(1 + exp((d - gap) / w))."""

    k: float
    gap: float
    w: float

    @property
    def reference(self) -> float:
        """See `hbgear.mechanics.Law`."""
        return self.k

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """See `hbgear.mechanics.Law`."""
        x = (d - self.gap) / self.w
        return self.k * self.w * np.logaddexp(0.0, x), self.k * 0.5 * (1 + np.tanh(0.5 * x)), 0 * d


@dataclass(frozen=True)
class Friction(hb.mechanics.Law):
    """Friction with a rounded corner: p = f tanh(v / w)."""

    f: float
    w: float

    @property
    def reference(self) -> float:
        """See `hbgear.mechanics.Law`."""
        return self.f

    def force(self, d: Array, v: Array, tau: Array) -> Forces:
        """See `hbgear.mechanics.Law`."""
        t = np.tanh(v / self.w)
        return self.f * t, 0 * d, self.f * (1 - t * t) / self.w


# ---- one, two and three masses


def _one(
    random: np.random.Generator,
    extreme: bool,
    law: hb.mechanics.Law,
    k: float = 1.0,
    load: tuple[float, float] = (0.03, 0.6),
) -> hb.System:
    """One mass on a spring k with a law."""
    zeta = logarithmic(random, 0.005, 0.02) if extreme else logarithmic(random, 0.02, 0.12)
    force = logarithmic(random, *load)
    steady = [random.uniform(-0.3, 0.3)] if random.random() < 0.4 else None
    second = {2: [0.4 * force]} if random.random() < 0.2 else {}
    forces = hb.Load(constant=steady, cosine={1: [force], **second})
    return hb.System([[1.0]], [[2 * zeta]], [[k]], [hb.Element([1.0], law, name="contact")], forces)


def stops(random: np.random.Generator, extreme: bool) -> Drawn:
    """One mass between two unequal stops."""
    k = [logarithmic(random, 1.0, 300.0 if extreme else 40.0) for _ in range(2)]
    gaps = random.uniform(0.1, 1.2, 2)
    law = hb.mechanics.PiecewiseLinear((-gaps[0], gaps[1]), (k[0], 0.0, k[1]))
    return _one(random, extreme, law), (2.2, 0.3)


def touching(random: np.random.Generator, extreme: bool) -> Drawn:
    """One mass that touches a stop at rest: gap 0."""
    law = hb.Unilateral(k=logarithmic(random, 0.5, 300.0 if extreme else 40.0), gap=0.0)
    return _one(random, extreme, law), (3.0, 0.3)


def preloaded(random: np.random.Generator, extreme: bool) -> Drawn:
    """One mass on a preloaded spring: several slopes, pressed together by a load, or a stop with negative gap."""
    k = logarithmic(random, 0.5, 100.0 if extreme else 20.0)
    if random.random() < 0.5:
        law = hb.Unilateral(k=k, gap=-random.uniform(0.05, 0.5))
    else:
        corners = np.cumsum([random.uniform(-0.6, -0.1), *random.uniform(0.1, 0.6, 2)])
        law = hb.mechanics.PiecewiseLinear(tuple(corners), (k, random.uniform(0, 0.3 * k), random.uniform(0, k), 2 * k))
    return _one(random, extreme, law), (2.5, 0.3)


def stepped(random: np.random.Generator, extreme: bool) -> Drawn:
    """A gear mesh with backlash whose stiffness jumps or has ramps."""
    low = 1 - (random.uniform(0.2, 0.6) if extreme else random.uniform(0.05, 0.3))
    share, start = random.uniform(0.2, 0.8), random.uniform(0, 2 * np.pi)
    if random.random() < 0.6:
        stiffness = hb.mechanics.Periodic.rectangular(high=1.2, low=low, share=share, start=start)
    else:
        ramp = random.uniform(0.02, 0.15)
        stiffness = hb.mechanics.Periodic.table(
            np.array([0.0, ramp, share, share + ramp]) * 2 * np.pi * 0.85, [low, 1.2, 1.2, low], kind="linear"
        )
    zeta = logarithmic(random, 0.005, 0.02) if extreme else logarithmic(random, 0.02, 0.12)
    error = hb.mechanics.Series(cosine=falling(random, logarithmic(random, 0.004, 0.2), 2))
    mesh = hb.Element([1.0], hb.Backlash(b=1.0, stiffness=stiffness), displacement=error, damping=2 * zeta, name="mesh")
    load = hb.Load(constant=[logarithmic(random, 0.03, 0.4)])
    return hb.System([[1.0]], [[0.0]], [[0.0]], [mesh], load), (2.2, 0.3)


def cubic(random: np.random.Generator, extreme: bool) -> Drawn:
    """One mass on a cubic spring and backlash, in parallel or on either side."""
    slack = hb.Backlash(b=random.uniform(0.1, 1.0), k=logarithmic(random, 0.3, 60.0 if extreme else 10.0))
    law = hb.mechanics.Parallel((hb.Cubic(logarithmic(random, 0.05, 2.0)), slack))
    return _one(random, extreme, law), (2.5, 0.3)


def python(random: np.random.Generator, extreme: bool) -> Drawn:
    """One mass on a law written in Python."""
    kind = int(random.integers(3))
    if kind == 0:
        law: hb.mechanics.Law = Septic(random.uniform(0.1, 1.0), logarithmic(random, 0.1, 10.0))
    elif kind == 1:
        law = Saturating(logarithmic(random, 0.3, 3.0), logarithmic(random, 0.05, 1.0))
    else:
        width = logarithmic(random, 0.005, 0.03) if extreme else logarithmic(random, 0.03, 0.2)
        law = SoftStop(logarithmic(random, 1.0, 20.0), random.uniform(0.2, 1.0), width)
    return _one(random, extreme, law), (2.2, 0.4)


def compiled(random: np.random.Generator, extreme: bool) -> Drawn:
    """One mass on a law that is a compiled function: cubic damping and a fifth power."""
    from studies.random.compiled_laws import quintic

    numbers = (logarithmic(random, 0.05, 5.0), logarithmic(random, 0.01, 0.3))
    return _one(random, extreme, hb.mechanics.CompiledLaw(quintic, parameters=numbers)), (2.5, 0.4)


def friction(random: np.random.Generator, extreme: bool) -> Drawn:
    """One mass with friction of a rounded corner, and at times a cubic spring."""
    width = logarithmic(random, 1e-3, 1e-2) if extreme else logarithmic(random, 1e-2, 0.2)
    law: hb.mechanics.Law = Friction(logarithmic(random, 0.02, 0.2), width)
    if random.random() < 0.5:
        law = hb.mechanics.Parallel((law, hb.Cubic(logarithmic(random, 0.05, 2.0))))
    return _one(random, extreme, law, load=(0.1, 0.8)), (2.0, 0.4)


def impacts(random: np.random.Generator, extreme: bool) -> Drawn:
    """Two masses: one meets a stop, and both meet each other."""
    k = random.uniform(0.3, 1.5, 2)
    K, M = np.diag(k), np.diag(random.uniform(0.5, 2.0, 2))
    C = (0.2 if extreme else 1.0) * (logarithmic(random, 0.02, 0.08) * K + logarithmic(random, 0.01, 0.06) * M)
    stiff = 100.0 if extreme else 20.0
    elements = [
        hb.Element(
            [1.0, -1.0], hb.Unilateral(k=logarithmic(random, 0.5, stiff), gap=random.uniform(0.1, 0.8)), name="between"
        ),
        hb.Element(
            [0.0, 1.0], hb.Unilateral(k=logarithmic(random, 0.5, stiff), gap=random.uniform(0.1, 0.8)), name="stop"
        ),
    ]
    load = hb.Load(cosine={1: [logarithmic(random, 0.05, 0.5), 0.0]})
    return hb.System(M, C, K, elements, load), (2.2, 0.3)


def chain(random: np.random.Generator, extreme: bool) -> Drawn:
    """Three masses in a row with one or two elements."""
    k = random.uniform(0.3, 2.0, 4) * [1, 1, 1, random.random() < 0.5]
    K = np.diag(k[:3] + k[1:]) - np.diag(k[1:3], 1) - np.diag(k[1:3], -1)
    M = np.diag(random.uniform(0.5, 2.0, 3))
    C = (0.2 if extreme else 1.0) * (logarithmic(random, 0.005, 0.03) * K + logarithmic(random, 0.005, 0.06) * M)
    ways = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    some = random.choice(4, size=int(random.integers(1, 3)), replace=False)
    laws = [
        hb.Backlash(b=random.uniform(0.1, 1.0), k=logarithmic(random, 0.3, 100.0 if extreme else 20.0)),
        hb.Unilateral(k=logarithmic(random, 0.3, 100.0 if extreme else 20.0), gap=random.uniform(0.1, 1.0)),
        hb.Cubic(logarithmic(random, 0.05, 3.0)),
    ]
    elements = [hb.Element(ways[i], laws[int(random.integers(3))], name=f"element {j + 1}") for j, i in enumerate(some)]
    force = logarithmic(random, 0.03, 0.5) * np.eye(3)[int(random.integers(3))]
    return hb.System(M, C, K, elements, hb.Load(cosine={1: force})), (2.5, 0.3)


# ---- shafts and gears


def gyroscopic(random: np.random.Generator, extreme: bool) -> Drawn:
    """A disc on a shaft with gyroscopic terms and unbalance that meets a stop or has clearance in a direction."""
    g = random.uniform(0.05, 0.6)
    K = np.diag([1.0, random.uniform(0.8, 1.5)])
    C = 2 * (logarithmic(random, 0.005, 0.02) if extreme else logarithmic(random, 0.02, 0.1)) * np.eye(2)
    k, gap = logarithmic(random, 0.5, 60.0 if extreme else 15.0), random.uniform(0.1, 0.8)
    law = hb.Backlash(b=gap, k=k) if random.random() < 0.5 else hb.Unilateral(k=k, gap=gap)
    e = logarithmic(random, 0.02, 0.2)
    load = hb.Load(cosine={1: [e, 0.0]}, sine={1: [0.0, e]}, power=2)
    elements = [hb.Element([1.0, 0.0], law, name="seal")]
    speed = hb.mechanics.SpeedTerms(np.array([[0.0, g], [-g, 0.0]]))
    return hb.System(np.eye(2), C, K, elements, load, speed=speed), (0.4, 2.0)


def engine(random: np.random.Generator, extreme: bool) -> Drawn:
    """A torsional chain with a gear ratio and backlash, excited by several orders of an engine."""
    J = np.array([0.3, 0.12, 0.05, 0.9, 2.0]) * random.uniform(0.6, 1.6, 5)
    ratio, unit = random.uniform(1.5, 3.0), 6e3
    K = np.zeros((5, 5))
    for i, j, k in ((0, 1, 4e4), (1, 2, 1.5e5), (3, 4, 6e3)):
        w = np.eye(5)[i] - np.eye(5)[j]
        K += k * random.uniform(0.5, 2.0) * np.outer(w, w) / unit
    omega = np.sqrt(unit)  # time in 1 / omega, so that Omega = 1 is 77 rad/s
    C = (0.2 if extreme else 1.0) * (2e-4 * omega * K + np.diag([0.5, 0.0, 0.0, 0.0, 8.0]) * omega / unit)
    gear = np.array([0.0, 0.0, 1.0, -ratio, 0.0])
    torque = random.uniform(0.5, 2.0)
    law = hb.Backlash(b=1.0, k=logarithmic(random, 3.0, 30.0))
    mesh = hb.Element(gear, law, damping=random.uniform(0.02, 0.08), name="gear")
    orders = {n: logarithmic(random, 0.1, 1.0) * torque * np.eye(5)[0] for n in (1, 2, 3, 4, 6)}
    orders[4] *= random.uniform(1.0, 3.0)
    load = hb.Load(constant=torque * np.array([1.0, 0.0, 0.0, 0.0, -ratio]), cosine=orders)
    return hb.System(np.diag(J), C, K, [mesh], load), (1.3, 0.5)


def train(random: np.random.Generator, extreme: bool) -> Drawn:
    """A train of three wheels: an idler between two gears."""
    teeth = [int(z) for z in random.integers(20, 45, 3)]
    inertias, radii = [logarithmic(random, 5e-4, 5e-3) for _ in teeth], [1.4e-3 * z for z in teeth]
    names = ["a", "b", "c"]
    gap = logarithmic(random, 1e-5, 8e-5)
    eps = random.uniform(0.02, 0.5) if extreme else random.uniform(0.02, 0.25)
    zeta = logarithmic(random, 0.01, 0.03) if extreme else logarithmic(random, 0.03, 0.12)
    meshes = [
        hb.gears.Mesh(
            one,
            two,
            k_mean=logarithmic(random, 1e8, 5e8),
            half_backlash=gap * random.uniform(0.5, 2.0),
            eps=falling(random, eps, 2) or (eps,),
            e=(gap * random.uniform(0.0, 0.1),),
            damping=zeta,
        )
        for one, two in (("a", "b"), ("b", "c"))
    ]
    torque = gap * meshes[0].k_mean * radii[0] * logarithmic(random, 0.05, 0.5)
    wheels = [
        hb.gears.Wheel(name, inertia=J, teeth=z, base_radius=r, torque=torque if name == "a" else 0.0)
        for name, J, z, r in zip(names, inertias, teeth, radii, strict=True)
    ]
    return hb.gears.Train(tuple(wheels), tuple(meshes), balance="c"), (1.8, 0.4)


def planetary(random: np.random.Generator, extreme: bool) -> Drawn:
    """A planetary set of three or four planets."""
    teeth, planets = ((26, 34, 94), 3) if random.random() < 0.5 else ((28, 36, 100), 4)
    zeta = logarithmic(random, 0.01, 0.03) if extreme else logarithmic(random, 0.03, 0.12)
    eps = random.uniform(0.1, 0.5) if extreme else random.uniform(0.03, 0.25)
    model = hb.gears.PlanetarySet(
        *teeth,
        planets=planets,
        torque=logarithmic(random, 60.0, 1500.0),
        zeta=zeta,
        zeta_b=zeta,
        b_sp=logarithmic(random, 1e-5, 4e-5),
        b_rp=logarithmic(random, 1e-5, 4e-5),
        eps_sp=(eps, 0.3 * eps),
        eps_rp=(eps * random.uniform(0.3, 1.0),),
    )
    return model, (2.0, 0.6)


def drawing(random: np.random.Generator, extreme: bool) -> Drawn:
    """A spur pair from its drawing."""
    pinion, wheel = (
        hb.gears.Gear(teeth=int(z), module="3 mm", face_width="20 mm", profile_shift=random.uniform(0.0, 0.3))
        for z in random.integers(22, 45, 2)
    )
    pair = hb.GearPair(pinion, wheel, backlash=logarithmic(random, 3e-5, 2e-4))
    zeta = logarithmic(random, 0.01, 0.03) if extreme else logarithmic(random, 0.03, 0.12)
    return pair.model(logarithmic(random, 30.0, 500.0), zeta), (2.0, 0.4)


STRUCTURES: dict[str, Callable[[np.random.Generator, bool], Drawn]] = {
    "stops": stops,
    "touching": touching,
    "preloaded": preloaded,
    "stepped": stepped,
    "cubic": cubic,
    "python": python,
    "compiled": compiled,
    "friction": friction,
    "impacts": impacts,
    "chain": chain,
    "gyroscopic": gyroscopic,
    "engine": engine,
    "train": train,
    "planetary": planetary,
    "drawing": drawing,
}
"""Ways to draw such a machine."""
