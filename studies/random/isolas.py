"""Twenty systems with isolated branches: attractors by integration against the branches of `trace_all`.

    python -m studies.random.isolas [--quick] [-o DIR]

Oscillators with a hardening spring, and with a gap under load, are drawn at random. Runge-Kutta integration from 200
random states finds the attractors at three frequencies, with their periods. A system counts if one of its attractors
lies on no curve that `trace` finds from the linear response, so that its branch is isolated. It is complete if all
attractors of up to three periods lie on branches of `trace_all`, which is not given any of them.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.continuation.results.interpolation import crossings_at
from studies import study

SYSTEMS = 20
"""Number of systems with isolated branches."""

STATES, TRANSIENT, STEPS = 200, 600, 96
"""Random states, periods until the motion is settled, and time steps of a period."""

SAME = 1e-2
"""Relative difference of mean and rms displacement up to which an attractor lies on a branch."""

GUESSES, SEARCHED = 10, 4
"""Random initial guesses of `trace_all` at each frequency, and number of its frequencies."""


HARMONICS = {1: 12, 2: 16, 3: 15}
"""Harmonics of the basis of one, two and three periods."""


@dataclass(frozen=True)
class Drawn:
    """A system: displacement x, force of its spring, and the span of its curves."""

    name: str
    model: hb.System
    force: object
    zeta: float
    load: tuple[float, float]
    span: tuple[float, float]
    reach: float


@dataclass(frozen=True)
class Result:
    """Attractors of a system: isolated ones, all of them, and the missing ones as text."""

    name: str
    isolated: int
    attractors: int
    missing: tuple[str, ...]
    seconds: float


def drawn(number: int) -> Drawn:
    """Return a system of the sequence: even numbers have a hardening spring, odd ones a gap."""
    rng = np.random.default_rng([20261125, number])
    if number % 2 == 0:
        zeta, k3, F = rng.uniform(0.005, 0.015), rng.uniform(0.5, 2.0), rng.uniform(2.0, 5.0)
        model = hb.System([[1.0]], [[2 * zeta]], [[1.0]], [hb.Element([1.0], hb.Cubic(k3))], hb.Load(cosine={1: [F]}))
        return Drawn(f"hardening {number}", model, lambda x: x + k3 * x**3, zeta, (0.0, F), (6.5, 3.0), 3.0)
    zeta, mean, F = rng.uniform(0.01, 0.03), rng.uniform(0.05, 0.15), rng.uniform(0.1, 0.3)
    element = hb.Element([1.0], hb.Backlash(1.0))
    load = hb.Load(constant=[mean], cosine={1: [F]})
    model = hb.System([[1.0]], [[2 * zeta]], [[0.0]], [element], load)

    def gap(x: Array) -> Array:
        return np.sign(x) * np.maximum(np.abs(x) - 1, 0.0)

    return Drawn(f"gap {number}", model, gap, zeta, (mean, F), (2.6, 1.2), 2.5)


def attractors(system: Drawn, Omega: float, seed: int) -> list[tuple[int, float, float]]:
    """Return period, mean and rms displacement of the attractors of up to three periods at a frequency."""
    rng = np.random.default_rng(seed)
    x, v = rng.uniform(-system.reach, system.reach, (2, STATES))
    v *= Omega
    h = 2 * math.pi / Omega / STEPS
    cosine = np.cos(2 * math.pi * np.arange(2 * STEPS + 1) / (2 * STEPS))
    constant, amplitude = system.load

    def rate(x: Array, v: Array, c: float) -> Array:
        return constant + amplitude * c - 2 * system.zeta * v - system.force(x)  # type: ignore[operator]

    sections, mean, square = [], np.zeros(STATES), np.zeros(STATES)
    for period in range(TRANSIENT + 6):
        if period >= TRANSIENT:
            sections.append((x.copy(), v.copy()))
        for i in range(STEPS):
            c0, c1, c2 = cosine[2 * i : 2 * i + 3]
            a1 = rate(x, v, c0)
            v1 = v + h / 2 * a1
            a2 = rate(x + h / 2 * v, v1, c1)
            v2 = v + h / 2 * a2
            a3 = rate(x + h / 2 * v1, v2, c1)
            v3 = v + h * a3
            a4 = rate(x + h * v2, v3, c2)
            x, v = x + h / 6 * (v + 2 * v1 + 2 * v2 + v3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            if period >= TRANSIENT:  # six periods are whole multiples of one, two and three
                mean += x / (6 * STEPS)
                square += x**2 / (6 * STEPS)
    found: list[tuple[int, float, float]] = []
    for n in range(STATES):
        q = next((q for q in (1, 2, 3) if all(abs(s[q][n] - s[0][n]) < 1e-4 for s in zip(*sections, strict=True))), 0)
        rms = math.sqrt(max(square[n] - mean[n] ** 2, 0.0))
        if q and not any(q == p and _same((mean[n], rms), (m, r)) for p, m, r in found):
            found.append((q, float(mean[n]), rms))
    return found


def _same(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Return whether two motions have equal mean, up to its sign, and rms."""
    size = math.hypot(*other)
    return abs(abs(one[0]) - abs(other[0])) < SAME * size and abs(one[1] - other[1]) < SAME * size


def on_a_branch(branches: tuple[hb.Branch, ...], Omega: float, motion: tuple[float, float]) -> bool:
    """Return whether a motion with this mean and rms lies on one of the branches."""
    for curve in branches:
        mean, rms = curve.amplitude("mean"), curve.amplitude("rms")
        for crossing in crossings_at(curve, Omega):
            if _same(motion, (float(crossing.interpolate(mean)), float(crossing.interpolate(rms)))):
                return True
    return False


def result(number: int) -> Result | None:
    """Return the result for a system; None if it has no isolated attractor."""
    system, started = drawn(number), time.perf_counter()
    low, high = sorted(system.span)
    frequencies = np.random.default_rng([1, number]).uniform(low, high, 3).tolist()
    found = [(Omega, *one) for i, Omega in enumerate(frequencies) for one in attractors(system, Omega, i)]
    usual = {"accuracy": None, "stability": False}
    curve = hb.trace(hb.HarmonicBalance(system.model, 12), "Omega", system.span, **usual)  # type: ignore[arg-type]
    main = curve.curves
    isolated = [one for one in found if not on_a_branch(main, one[0], one[2:])]
    if not isolated:
        return None
    missing = []
    for nu in sorted({one[1] for one in isolated}):
        problem = hb.HarmonicBalance(system.model, HARMONICS[nu], nu=nu)
        search = hb.trace_all(problem, system.span, frequencies=SEARCHED, guesses=GUESSES, stability=False)
        for Omega, q, mean, rms in isolated:
            if q == nu and not on_a_branch(search.branches, Omega, (mean, rms)):
                missing.append(f"{q} periods at Omega = {Omega:.4g}, mean {mean:.3g}, rms {rms:.3g}")
    return Result(system.name, len(isolated), len(found), tuple(missing), time.perf_counter() - started)


def run(quick: bool = False) -> list[Result]:
    """Return the results of `SYSTEMS` systems; ``quick``: of one."""
    results: list[Result] = []
    for number in range(10 * SYSTEMS):
        one = result(number)
        if one is not None:
            results.append(one)
        if len(results) == (1 if quick else SYSTEMS):
            break
    return results


def report(results: list[Result]) -> str:
    """Return a table of the systems and the number of complete ones."""
    lines = [
        "| system | attractors | isolated | missing |",
        "|---|---|---|---|",
        *(
            f"| {one.name} | {one.attractors} | {one.isolated} | {'; '.join(one.missing) or 'none'} |"
            for one in results
        ),
        "",
        f"{sum(not one.missing for one in results)} of {len(results)} systems are complete; median time "
        f"{np.median([one.seconds for one in results]):.0f} s.",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    study.main()
