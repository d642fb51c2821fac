"""Harmonic balance and contact instants against each other on random machines: special points of both, one by one.

    python -m studies.contact.discretisations [--quick] [-o DIR]

Spur pairs (`certified_folds.pair`), a mass with a soft stop, and two masses of which one has a stop. Both
discretisations trace the same span. A fold, period doubling, Neimark-Sacker, branch or grazing point of one curve has
a partner on the other one if a point of its kind lies within `SAME`, or three errors that the balance estimates.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

import hbgear as hb
from hbgear.continuation.solvers.newton import NoConvergence
from studies import study
from studies.contact.certified_folds import pair

KINDS = ("LP", "PD", "NS", "BP", "GR")
"""Kinds of special points that are compared."""

HARMONICS = 32
"""Harmonics of the balance."""

SAME = 1e-5
"""Distance in Omega up to which two points are the same: the accuracy of points of the balance."""

MACHINES = {"pair, constant": 400, "pair, rectangular": 200, "stop": 200, "two masses": 200}
"""Number of machines of each kind."""


@dataclass
class Results:
    """Machines of each kind, pairs of points (kind of machine, distance, estimate), points without a partner, ends."""

    machines: Counter[str] = field(default_factory=Counter)
    pairs: list[tuple[str, float, float]] = field(default_factory=list)
    alone: list[tuple[str, str, str, float]] = field(default_factory=list)
    ended: Counter[str] = field(default_factory=Counter)


def machine(kind: str, rng: np.random.Generator) -> tuple[hb.mechanics.Model | hb.System, tuple[float, float]]:
    """Return a random machine and the span of its curve."""
    if kind.startswith("pair"):
        return pair(kind.removeprefix("pair, "), rng), (1.3, 0.45)
    k, gap, F = (round(float(rng.uniform(*bounds)), 3) for bounds in ((1.0, 10.0), (0.2, 1.0), (0.05, 0.3)))
    zeta = round(float(rng.uniform(0.03, 0.1)), 3)
    if kind == "stop":
        stop = hb.Element([1.0], hb.Unilateral(k=k, gap=gap), name="stop")
        return hb.System([[1.0]], [[2 * zeta]], [[1.0]], [stop], hb.Load(cosine={1: [F]})), (2.0, 0.7)
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    stop = hb.Element([1.0, 0.0], hb.Unilateral(k=k, gap=gap), name="stop")
    return hb.System(np.eye(2), 2 * zeta * K, K, [stop], hb.Load(cosine={1: [0.0, F]})), (2.2, 0.7)


def machines(quick: bool = False) -> Iterator[tuple[str, hb.mechanics.Model | hb.System, tuple[float, float]]]:
    """Yield the kind of each machine, the machine and its span; the quick form has one of each kind."""
    for number, (kind, count) in enumerate(MACHINES.items()):
        for i in range(1 if quick else count):
            yield kind, *machine(kind, np.random.default_rng([41, number, i]))


def run(quick: bool = False) -> Results:
    """Trace and compare all machines."""
    results = Results()
    for kind, model, span in machines(quick):
        compare(results, kind, model, span)
    return results


def compare(results: Results, kind: str, model: hb.mechanics.Model | hb.System, span: tuple[float, float]) -> None:
    """Trace the curve of a machine with both discretisations, and compare their special points."""
    results.machines[kind] += 1
    balance = hb.trace(hb.HarmonicBalance(model, HARMONICS), "Omega", span)
    try:
        exact = hb.trace(hb.ContactInstants(model, HARMONICS), "Omega", span)
    except NoConvergence:
        results.ended[f"{kind}: no start in contact instants"] += 1
        return
    if not (balance.status.complete and exact.status.complete):
        results.ended[f"{kind}: {balance.status}, {exact.status} in contact instants"] += 1
        return
    others = [(p.kind, p.parameters["Omega"]) for p in exact.special if p.kind in KINDS]
    for point in (p for p in balance.special if p.kind in KINDS):
        Omega = point.parameters["Omega"]
        near = [(abs(value - Omega), i) for i, (name, value) in enumerate(others) if name == point.kind]
        distance, i = min(near, default=(np.inf, -1))
        if distance <= max(SAME, 3 * point.error):
            results.pairs.append((kind, distance, point.error))
            others.pop(i)
        else:
            results.alone.append((kind, "balance", point.kind, Omega))
    results.alone += [(kind, "contact instants", name, value) for name, value in others]


def report(results: Results) -> str:
    """Return the numbers of compared points, and the points without a partner."""
    lines = [
        "| machines | number | points of both | largest distance | within the estimate | without a partner |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for kind, count in results.machines.items():
        found = [one for one in results.pairs if one[0] == kind]
        alone = sum(one[0] == kind for one in results.alone)
        largest = f"{max((one[1] for one in found), default=0.0):.0e}"
        within = sum(distance <= error + 1e-12 for _, distance, error in found)
        lines.append(f"| {kind} | {count} | {len(found)} | {largest} | {within} | {alone} |")
    lines += [
        "",
        *(f"- {kind}: {name} at Omega = {value:.6f} of the {which} only" for kind, which, name, value in results.alone),
    ]
    lines += [f"- {text}: {count} machines, not compared" for text, count in results.ended.items()]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
