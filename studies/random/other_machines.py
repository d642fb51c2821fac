"""Machines drawn at random that differ from those of `machines`, on which stated errors are calibrated.

    machine("chain", 7)  is the same machine wherever it is asked for: kind and number are its seed

| kind | machine |
|---|---|
| chain | three masses in a row, a stop or a clearance at one or two of them |
| stops | one or two masses between two stops of different gaps and stiffnesses |
| rectangular | a gear pair with rectangular or trapezoidal mesh stiffness |
| mixed | one or two masses with a cubic spring and a clearance |
| rotor | a rotor with gyroscopic terms, unbalance and a stop in one direction |
"""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np

import hbgear as hb
from studies.random.drawing import logarithmic as log
from studies.random.machines import Machine

Drawn = tuple[hb.mechanics.Model, tuple[float, float]]


def machine(kind: str, number: int) -> Machine:
    """A machine of one of the `KINDS`."""
    random = np.random.default_rng([zlib.crc32(kind.encode()), number])
    model, span = KINDS[kind](random)
    return Machine(kind, number, model, span if random.random() < 0.5 else span[::-1])


def _row_of_masses(random: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, C and K (n, n) of n masses in a row between two walls, of which the second spring may be absent."""
    k = random.uniform(0.4, 1.6, n + 1)
    k[-1] *= random.random() < 0.5
    K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    M = np.diag(random.uniform(0.6, 1.6, n))
    return M, log(random, 0.01, 0.05) * K + log(random, 0.005, 0.04) * M, K


def chain(random: np.random.Generator) -> Drawn:
    """Three masses in a row with one or two elements."""
    M, C, K = _row_of_masses(random, 3)
    elements = []
    for j in random.permutation(3)[: int(random.integers(1, 3))].tolist():
        k, gap = log(random, 0.5, 30.0), random.uniform(0.2, 1.0)
        law: hb.mechanics.Law = hb.Unilateral(k=k, gap=gap) if random.random() < 0.5 else hb.Backlash(b=gap, k=k)
        elements.append(hb.Element(np.eye(3)[j], law, name=f"mass {j + 1}"))
    force = log(random, 0.05, 0.4) * np.eye(3)[int(random.integers(3))]
    return hb.System(M, C, K, elements, hb.Load(cosine={1: force})), (2.2, 0.3)


def stops(random: np.random.Generator) -> Drawn:
    """One or two masses between stops of different gaps and stiffnesses."""
    n = int(random.integers(1, 3))
    M, C, K = _row_of_masses(random, n)
    low, high = -random.uniform(0.2, 1.2), random.uniform(0.2, 1.2)
    law = hb.mechanics.PiecewiseLinear((low, high), (log(random, 0.5, 60.0), 0.0, log(random, 0.5, 60.0)))
    load = hb.Load(constant=random.uniform(-0.1, 0.1, n), cosine={1: log(random, 0.05, 0.4) * np.eye(n)[-1]})
    return hb.System(M, C, K, [hb.Element(np.eye(n)[0], law, name="stops")], load), (2.5, 0.3)


def rectangular(random: np.random.Generator) -> Drawn:
    """A gear pair whose mesh stiffness jumps or ramps between two values."""
    duty, depth = random.uniform(0.3, 0.7), random.uniform(0.1, 0.5)
    high, low = 1.0 + depth * (1.0 - duty), 1.0 - depth * duty  # of mean 1
    if random.random() < 0.5:
        stiffness = hb.mechanics.Periodic.rectangular(high, low, duty)
    else:
        stiffness = hb.mechanics.Periodic.trapezoidal(high, low, duty - 0.1, 0.1)
    zeta, load = log(random, 0.02, 0.1), hb.Load(constant=[log(random, 0.05, 0.5)])
    error = hb.mechanics.Series(0.0, (log(random, 0.005, 0.1),))
    mesh = hb.Element([1.0], hb.Backlash(stiffness=stiffness), damping=2 * zeta, displacement=error, name="mesh")
    return hb.System([[1.0]], [[0.0]], [[0.0]], [mesh], load), (2.3, 0.4)


def mixed(random: np.random.Generator) -> Drawn:
    """One or two masses with a cubic spring at one and a clearance at the other, or both at the same."""
    n = int(random.integers(1, 3))
    M, C, K = _row_of_masses(random, n)
    elements = [
        hb.Element(np.eye(n)[0], hb.Cubic(log(random, 0.05, 2.0)), name="cubic"),
        hb.Element(np.eye(n)[-1], hb.Backlash(b=random.uniform(0.2, 1.0), k=log(random, 0.5, 15.0)), name="clearance"),
    ]
    load = hb.Load(cosine={1: log(random, 0.05, 0.5) * np.eye(n)[0]})
    return hb.System(M, C, K, elements, load), (3.0, 0.3)


def rotor(random: np.random.Generator) -> Drawn:
    """A rotor with gyroscopic terms, unbalance and a stop in one direction."""
    k = random.uniform(0.7, 1.4, 2)
    C = log(random, 0.02, 0.1) * np.eye(2)
    g = random.uniform(0.05, 0.5)
    seal = hb.Element([1.0, 0.0], hb.Unilateral(k=log(random, 0.5, 20.0), gap=random.uniform(0.4, 1.5)), name="seal")
    e = log(random, 0.03, 0.2)
    unbalance = hb.Load(cosine={1: [e, 0.0]}, sine={1: [0.0, e]}, power=2)
    speed = hb.mechanics.SpeedTerms(np.array([[0.0, g], [-g, 0.0]]))
    return hb.System(np.eye(2), C, np.diag(k), [seal], unbalance, speed=speed), (0.4, 2.0)


KINDS: dict[str, Callable[[np.random.Generator], Drawn]] = {
    "chain": chain,
    "stops": stops,
    "rectangular": rectangular,
    "mixed": mixed,
    "rotor": rotor,
}
"""Ways to draw a machine."""
