"""Stated errors of motions of frictional machines drawn at random, against event-exact shooting.

python -m studies.random.friction --count 100

One to three masses in a row with one to three sliders: constant limits, limits prescribed over the period, and limits
proportional to the force of a stop. Each machine is computed at two frequencies with 15 harmonics. The stated error is
that of the largest coordinate, the true one the difference of its rms from that of the motion found by shooting.
"""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Iterator

import numpy as np

import hbgear as hb
from hbgear.continuation.solvers.newton import NoConvergence, solve
from studies.random.drawing import logarithmic as log
from studies.random.machines import Machine
from studies.random.other_machines import _row_of_masses

ROUNDING = 1e-9
"""Error of shooting, below which no stated error is compared."""

HARMONICS = 15
"""Harmonics of each motion."""


def machine(number: int) -> Machine:
    """A machine with friction; its number is the seed."""
    random = np.random.default_rng([zlib.crc32(b"friction"), number])
    n = int(random.integers(1, 4))
    M, C, K = _row_of_masses(random, n)
    force = log(random, 0.1, 0.5)
    elements = []
    if random.random() < 0.4:
        stop = hb.Unilateral(k=log(random, 0.5, 5.0), gap=random.uniform(-0.2, 0.3))
        elements.append(hb.Element(np.eye(n)[-1], stop, name="stop"))
    for i in range(int(random.integers(1, 4))):
        k, limit = log(random, 0.3, 3.0), force * log(random, 0.05, 0.5)
        kind = random.random()
        if elements and elements[0].name == "stop" and kind < 0.4:
            law: hb.mechanics.Law = hb.mechanics.ContactFriction(k, log(random, 0.05, 0.4), "stop")
        elif kind < 0.7:
            law = hb.mechanics.Jenkins(k, limit)
        else:
            law = hb.mechanics.Jenkins(k, limit, cosine=(limit * random.uniform(-0.6, 0.6),), sine=(0.3 * limit,))
        elements.append(hb.Element(np.eye(n)[int(random.integers(n))], law, name=f"slider {i + 1}"))
    model = hb.System(M, C, K, elements, hb.Load(cosine={1: force * np.eye(n)[0]}))
    return Machine("friction", number, model, (0.5, 2.0))


def compared(number: int) -> Iterator[tuple[float, float, float]]:
    """Omega, stated and true errors of motions of a machine."""
    it = machine(number)
    random = np.random.default_rng(number)
    problem = hb.HarmonicBalance(it.model, HARMONICS)
    for Omega in random.uniform(*it.span, 2).tolist():
        try:
            X = solve(problem, np.zeros(problem.size), {"Omega": Omega}).X
            rows = problem.motion(X, Omega=Omega)
            q, v = rows[:, 0] + rows[:, 1::2].sum(axis=1), Omega * rows[:, 2::2] @ np.arange(1, HARMONICS + 1)
            state = np.concatenate([q, v, problem.slider_positions(X, Omega=Omega)])
            orbit = hb.time.shoot(it.model, Omega, state)
        except (NoConvergence, ArithmeticError, ValueError, RuntimeError) as error:
            print(f"{it.name} at {Omega:.6g}: {type(error).__name__}: {str(error)[:80]}", flush=True)
            continue
        exact = orbit.rows(4 * HARMONICS)
        size = np.sqrt(0.5 * (exact[:, 1:] ** 2).sum(axis=1))
        own = X.reshape(problem.m, -1)
        found = np.sqrt(0.5 * (own[:, 1:] ** 2).sum(axis=1))
        stated = float(problem.observe(X, stability=False, Omega=Omega)["error"])
        yield Omega, stated, float(np.abs(found - size).max())


def main() -> None:
    """Print each motion whose error is more than three times as large as stated, and how many are not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=10)
    given = parser.parse_args()
    ratios = []
    for number in range(given.first, given.first + given.count):
        for Omega, stated, true in compared(number):
            ratios.append(true / max(stated, ROUNDING))
            if ratios[-1] > 3:
                print(f"friction {number} at {Omega:.6g}: {stated:.1e} stated, {true:.1e} true", flush=True)
    found = np.array(ratios)
    print(f"{len(found)} motions: {np.mean(found < 3):.1%} within three times, {np.mean(found < 10):.1%} within ten")


if __name__ == "__main__":
    main()
