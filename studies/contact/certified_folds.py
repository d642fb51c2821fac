"""Folds of random spur pairs that are proved by ball arithmetic, with rectangular and harmonic mesh stiffness.

    python -m studies.contact.certified_folds [--quick] [-o DIR]

Damping ratio .02 to .1, mean load .05 to .3, transmission error .01 to .1 of half the backlash, variation of the mesh
stiffness up to .2. The curves are traced by harmonic balance, so the proof is independent of the discretisation; the
distance of the proved frequency is compared with the error that the balance estimates. Shooting with Runge-Kutta steps
solves y(T) = y, det(dy(T)/dy - 1) = 0 for each fold, from the harmonic balance; its frequency is another comparison.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import scipy

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.harmonic.structure.receptance import LinearStructure
from hbgear.time.integration import state_of
from hbgear.time.runge_kutta import Flow
from hbgear.time.shooting import variation
from studies import study

SPAN = (1.3, 0.45)
"""Frequencies of the trace, over the natural frequency."""

PAIRS = {"constant": 20, "rectangular": 140, "harmonic": 60}
"""Number of pairs with each kind of stiffness."""

SHOOTING_TOLERANCE = 1e-12
"""Relative error of a Runge-Kutta step. It leaves errors of some 1e-11 in Omega."""

MAX_SHOOTING_DISTANCE = 1e-9
"""Distance of the frequencies of shooting and of the proof, relative, beyond which they contradict each other."""


@dataclass
class Results:
    """Folds of each kind of stiffness: distance, its estimate, time [s], distance from shooting; failed conditions."""

    pairs: Counter[str] = field(default_factory=Counter)
    folds: list[tuple[str, float, float, float, float]] = field(default_factory=list)
    failed: list[tuple[str, str]] = field(default_factory=list)


def pair(kind: str, rng: np.random.Generator) -> hb.SpurPair:
    """Return a random pair; numbers of three digits, so that its decimals are short."""
    ranges = ((0.02, 0.1), (0.05, 0.3), (0.01, 0.1), (0.03, 0.2))
    zeta, F_m, e, depth = (round(float(rng.uniform(*bounds)), 3) for bounds in ranges)
    share = round(float(rng.uniform(0.3, 0.8)), 2)
    if kind == "rectangular":
        teeth = hb.mechanics.Periodic.rectangular(high=1 + depth * (1 - share), low=1 - depth * share, share=share)
        return hb.SpurPair(zeta=zeta, F_m=F_m, e=(e,), stiffness=teeth)
    return hb.SpurPair(zeta=zeta, F_m=F_m, e=(e,), eps=(depth,) if kind == "harmonic" else ())


def run(quick: bool = False) -> Results:
    """Trace the curves and certify all folds; the quick form has two pairs."""
    results, rng = Results(), np.random.default_rng(41)
    for kind, count in ({"constant": 1, "rectangular": 1} if quick else PAIRS).items():
        for _ in range(count):
            results.pairs[kind] += 1
            curve = hb.trace(hb.HarmonicBalance(pair(kind, rng), 32), "Omega", SPAN)
            for point in curve.special:
                if point.kind == "LP":
                    _certify(results, kind, point)
    return results


def _certify(results: Results, kind: str, point: hb.SpecialPoint) -> None:
    """Certify a fold."""
    begin = time.process_time()
    try:
        proof = hb.analysis.certify(point)
    except hb.analysis.NotCertifiedError as error:
        results.failed.append((kind, error.condition))
        return
    Omega, spent = float(proof.Omega[0]), time.process_time() - begin
    shot = shot_fold(point)
    results.folds.append((kind, abs(Omega - point.parameters["Omega"]), point.error, spent, abs(shot / Omega - 1)))


def shot_fold(point: hb.SpecialPoint) -> float:
    """Return Omega of a fold by shooting, nan without convergence: y(T) = y and det(dy(T)/dy - 1) = 0."""
    system = point.problem.model.system()
    structure = LinearStructure(system)
    start = state_of(point.problem, point.X, **point.parameters)
    size = np.linalg.norm(start)

    def residual(z: Array) -> Array:
        flow = Flow(system, float(z[-1]), variational=True)
        end, Phi, _ = variation(flow, structure, z[:-1] * size, 1, SHOOTING_TOLERANCE)
        return np.append(end / size - z[:-1], np.linalg.det(Phi - np.eye(len(Phi))))

    found = scipy.optimize.root(residual, np.append(start / size, point.parameters["Omega"]), tol=1e-13)
    closed = np.linalg.norm(residual(found.x)) < MAX_SHOOTING_DISTANCE
    return float(found.x[-1]) if closed else float("nan")


def report(results: Results) -> str:
    """Return the shares of certified folds, and the conditions that failed."""
    lines = [
        "| stiffness | pairs | folds | certified | largest distance | distance / estimate: median, largest | "
        "equal by shooting | largest distance of shooting | median CPU time [s] |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind, pairs in results.pairs.items():
        found = [fold for fold in results.folds if fold[0] == kind]
        failed = [one for one in results.failed if one[0] == kind]
        if not found:
            lines.append(f"| {kind} | {pairs} | {len(failed)} | 0 | | | | | |")
            continue
        ratios = [distance / error for _, distance, error, *_ in found]
        shot = [f[4] for f in found]
        lines.append(
            f"| {kind} | {pairs} | {len(found) + len(failed)} | {len(found)} | {max(f[1] for f in found):.0e} | "
            f"{np.median(ratios):.2f}, {np.max(ratios):.2f} | {sum(d < MAX_SHOOTING_DISTANCE for d in shot)} | "
            f"{np.nanmax(shot):.0e} | "
            f"{np.median([f[3] for f in found]):.1f} |"
        )
    reasons = ", ".join(f"{condition} ({count})" for condition, count in Counter(c for _, c in results.failed).items())
    lines += ["", f"Conditions that failed: {reasons or 'none'}.", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    study.main()
