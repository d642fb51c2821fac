"""Machines drawn at random: spur pairs, double-helical pairs, pairs on bearings, two masses with one or two elements.

    machine("spur", 7)  is reproducible: kind and number are the seed

One machine in eight is extreme: very small damping, stiff stops, very small load, strong excitation.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import hbgear as hb
from studies.random.drawing import EXTREME, Span, falling, logarithmic
from studies.random.structures import STRUCTURES


class Machine(NamedTuple):
    """What is traced: a model over a span of Omega; kind and number, from which it comes."""

    kind: str
    number: int
    model: hb.mechanics.Model
    span: Span

    @property
    def name(self) -> str:
        """Kind and number, as ``python -m studies.random.truth`` takes them."""
        return f"{self.kind}:{self.number}"


def machine(kind: str, number: int) -> Machine:
    """A machine of one of the `KINDS`."""
    random = np.random.default_rng([zlib.crc32(kind.encode()), number])
    model, span = KINDS[kind](random, bool(random.random() < EXTREME))
    return Machine(kind, number, model, span if random.random() < 0.75 else span[::-1])


def _mesh(random: np.random.Generator, extreme: bool) -> dict[str, object]:
    """Damping, load, stiffness and error of a mesh."""
    return {
        "zeta": logarithmic(random, 0.002, 0.02) if extreme else logarithmic(random, 0.015, 0.15),
        "F_m": logarithmic(random, 0.003, 1.0) if extreme else logarithmic(random, 0.03, 0.4),
        "eps": falling(random, random.uniform(0.2, 0.7) if extreme else random.uniform(0.02, 0.3), 3),
        "e": falling(random, logarithmic(random, 0.05, 1.0) if extreme else logarithmic(random, 0.004, 0.2), 3),
        "phase": str(random.choice(["cos", "sin"])),
    }


def spur(random: np.random.Generator, extreme: bool) -> tuple[hb.mechanics.Model, Span]:
    """A spur pair; without stiffness variation and error it stands still, as it should."""
    return hb.SpurPair(**_mesh(random, extreme)), (2.5, 0.3)  # type: ignore[arg-type]


def helical(random: np.random.Generator, extreme: bool) -> tuple[hb.mechanics.Model, Span]:
    """A pair of Dong et al. with other damping, load, excitation, backlash, stagger and supports."""
    model = hb.gears.DoubleHelicalPair(
        zeta=logarithmic(random, 0.005, 0.03) if extreme else random.uniform(0.03, 0.1),
        torque=logarithmic(random, 50.0, 5000.0) if extreme else random.uniform(600.0, 2500.0),
        W=random.uniform(-1.0, 2.0) if extreme else random.uniform(-0.5, 0.8),
        eps_scale=random.uniform(0.5, 3.0) if extreme else random.uniform(0.3, 1.6),
        e_scale=random.uniform(0.5, 10.0) if extreme else random.uniform(0.3, 3.0),
        e_phase=float(random.uniform(0, 2 * np.pi)),
        stagger=float(random.choice([0.0, np.pi, random.uniform(0, 2 * np.pi)])),
        phi_deg=random.uniform(0.0, 90.0),
        support_damping=str(random.choice(["tabulated", "zeta"])),  # type: ignore[arg-type]
        tilt=bool(random.random() < 0.8),
    )
    return model, (1.6, 0.2)


def bearings(random: np.random.Generator, extreme: bool) -> tuple[hb.mechanics.Model, Span]:
    """A pair on shafts and bearings with clearance."""
    ratios = (0.02, 1.5) if extreme else (0.1, 0.5)
    model = hb.gears.GearRotorBearing(
        **_mesh(random, extreme),  # type: ignore[arg-type]
        zeta_1=logarithmic(random, 0.005, 0.1),
        zeta_2=logarithmic(random, 0.005, 0.1),
        kappa_1=logarithmic(random, 0.2, 6.0),
        kappa_2=logarithmic(random, 0.2, 6.0),
        mu_1=logarithmic(random, *ratios),
        mu_2=logarithmic(random, *ratios),
        F_1=random.uniform(0.02, 0.4),
        F_2=random.uniform(0.02, 0.4),
        b_1=random.uniform(0.0, 1.5),
        b_2=random.uniform(0.0, 1.5),
    )
    return model, (2.0, 0.3)


def two(random: np.random.Generator, extreme: bool) -> tuple[hb.mechanics.Model, Span]:
    """Two masses in a row with one or two elements: stops, clearances, springs of several slopes, cubic springs."""
    k = random.uniform(0.3, 2.0, 3) * [1, 1, random.random() < 0.6]
    K = np.array([[k[0] + k[1], -k[1]], [-k[1], k[1] + k[2]]])
    M = np.diag(random.uniform(0.5, 2.0, 2))
    C = logarithmic(random, 0.003, 0.02) * K + logarithmic(random, 0.003, 0.06) * M
    if extreme:
        C = 0.2 * C
    directions = [[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]]
    chosen = random.choice(3, size=int(random.integers(1, 3)), replace=bool(random.random() < 0.1))
    elements = [hb.Element(directions[i], _law(random, extreme), name=f"element {j + 1}") for j, i in enumerate(chosen)]
    force = logarithmic(random, 0.03, 0.6) * np.eye(2)[int(random.integers(2))]
    steady = random.uniform(-0.3, 0.3, 2) if random.random() < 0.3 else None
    load = hb.Load(constant=steady, cosine={1: force, **({2: 0.3 * force} if random.random() < 0.2 else {})})
    return hb.System(M, C, K, elements, load), (2.5, 0.3)


def _law(random: np.random.Generator, extreme: bool) -> hb.mechanics.Law:
    k, gap = logarithmic(random, 0.2, 300.0 if extreme else 40.0), random.uniform(0.1, 1.2)
    kind = int(random.integers(4))
    if kind == 0:
        return hb.Backlash(b=gap, k=k)
    if kind == 1:
        return hb.Unilateral(k=k, gap=gap)
    if kind == 2:
        return hb.Cubic(logarithmic(random, 0.05, 20.0 if extreme else 3.0))
    return hb.mechanics.PiecewiseLinear((-random.uniform(0.1, 1.2), gap), (random.uniform(0.0, k), 0.0, k))


PAIRS: dict[str, Callable[[np.random.Generator, bool], tuple[hb.mechanics.Model, Span]]] = {
    "spur": spur,
    "helical": helical,
    "bearings": bearings,
    "two": two,
}
"""Ways to draw a machine of this module."""

KINDS = {**PAIRS, **STRUCTURES}
"""All ways to draw a machine."""
