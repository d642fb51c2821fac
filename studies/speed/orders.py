"""Sparse orders against all orders: trains of two stages, with teeth that stay in contact and with teeth that lose it.

    python -m studies.speed.orders [--quick] [-o DIR]

An input pinion of 20 teeth drives a gear of z, which is on one shaft with a pinion that drives a gear of 50. While
nothing loses contact, z = 57 and a second pinion of 22: tooth frequencies as 57 to 22. Where a mesh loses contact near
a resonance, 42 and 20: as 21 to 10. A curve with few orders (`orders="meshes"`) shows which orders exceed a tolerance
(`with_harmonics_of`). This is repeated with the new curve until no order is added; the last one is also traced with all
orders up to the highest. Folds, and motions at every tenth row away from folds, are compared with those of all orders
up to 6 or 12 of the faster mesh.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.continuation.solvers.newton import solve
from studies import study

ALONE = True


class Case(NamedTuple):
    """Teeth on the middle shaft, amplitude of the stiffness and damping, span, tolerances, and the highest order."""

    name: str
    teeth: tuple[int, int]
    eps: float
    damping: float
    span: tuple[float, float]
    tolerances: tuple[float, ...]
    highest: int


CASES = (
    Case("in contact, 57 to 22", (57, 22), 0.08, 0.05, (0.045, 0.04), (1e-6, 1e-10), 342),
    Case("contact lost, 21 to 10", (42, 20), 0.08, 0.016, (0.105, 0.09), (1e-3, 1e-4, 1e-5), 252),
)


def train(case: Case) -> hb.gears.Train:
    """The train; words at the head of this file."""
    first, second = case.teeth
    teeth, module = {"in": 20, "first": first, "second": second, "out": 50}, 3e-3
    middle, last = module * (20 + first) / 2, module * (20 + first + second + 50) / 2
    place = {"in": 0.0, "first": middle, "second": middle, "out": last}
    wheels = [
        hb.gears.Wheel(
            name,
            7800 * np.pi / 2 * 0.025 * (module * z / 2) ** 4,
            1.0,
            teeth=z,
            base_radius=module * z / 2 * np.cos(np.radians(20)),
            x=place[name],
            torque=100.0 if name == "in" else 0.0,
        )
        for name, z in teeth.items()
    ]
    meshes = [
        hb.gears.Mesh("in", "first", 3e8, 4e-5, eps=(case.eps, 0.1), damping=case.damping),
        hb.gears.Mesh("second", "out", 3.9e8, 5e-5, eps=(0.25, 0.08), damping=case.damping),
    ]
    return hb.gears.Train(wheels, meshes, [hb.gears.Shaft("first", "second", torsion=3e5)], balance="out")


def traced(problem: hb.HarmonicBalance, span: tuple[float, float]) -> tuple[hb.Branch, float]:
    """The curve with stability, and the seconds it took."""
    start = time.perf_counter()
    curve = hb.trace(problem, "Omega", span, accuracy=None)
    return curve, time.perf_counter() - start


def fold_of(problem: hb.HarmonicBalance, point: hb.SpecialPoint) -> float:
    """Omega of a fold solved for with the orders of a problem."""
    U = np.append(problem.from_point(point), point.parameters["Omega"])
    return float(solve(hb.continuation.FoldProblem(problem, "Omega").with_borders_at(U, {}), U, {}).X[-1])


def off(curve: hb.Branch, whole: hb.HarmonicBalance) -> tuple[float, float]:
    """Largest differences of folds, and of coefficients at every tenth row where no fold is near, with all orders."""
    folds = [p for p in curve.special if p.kind == "LP"]
    moved = max((abs(fold_of(whole, p) - p.parameters["Omega"]) for p in folds), default=float("nan"))
    apart = [0.0]
    for i in range(0, len(curve), 10):
        here, known = {"Omega": float(curve.values[i])}, curve.layout.spread(curve.X[i])
        if min((abs(here["Omega"] - p.parameters["Omega"]) for p in folds), default=1.0) < 2e-4:
            continue
        X = whole.rows(solve(whole, whole.from_layout(curve.X[i], curve.layout), here).X)
        apart.append(float(np.abs(X[:, : known.shape[1]] - known).max()))
    return moved, max(apart)


def settled(problem: hb.HarmonicBalance, curve: hb.Branch, tolerance: float, span: tuple[float, float]) -> Any:
    """The problem with the orders that curves ask for, of which the last adds none, and how many curves it took."""
    for count in range(1, 6):
        known = problem
        problem = problem.with_harmonics_of(curve, tolerance)
        if count > 1 and set(problem.orders.tolist()) <= set(known.orders.tolist()):
            return known, count
        curve, _ = traced(problem, span)
    return problem, count


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per case and tolerance: orders and seconds, those with all orders, and differences from the finest."""
    rows = []
    with threadpool_limits(1):
        for case in CASES:
            model = train(case)
            first = hb.HarmonicBalance(model, 6, orders="meshes")
            traced(first, case.span)  # the warm-up
            coarse, _ = traced(first, case.span)
            finest = hb.HarmonicBalance(model, case.highest)
            for tolerance in case.tolerances[:1] if quick else case.tolerances:
                some, curves = settled(first, coarse, tolerance, case.span)
                whole = hb.HarmonicBalance(model, some.H)
                (sparse, seconds), (every, longer) = (traced(problem, case.span) for problem in (some, whole))
                folds, motions = off(sparse, finest)
                rows.append(
                    {
                        "case": case.name,
                        "tolerance": tolerance,
                        "orders": len(some.orders) - 1,
                        "H": some.H,
                        "curves": curves,
                        "points": [len(sparse), len(every)],
                        "seconds": [seconds, longer],
                        "folds": folds,
                        "motions": motions,
                        "of all": off(every, finest),
                    }
                )
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """The results as a table in Markdown."""
    head = [
        "teeth",
        "tolerance",
        "orders",
        "of",
        "curves before",
        "curve [s]",
        "with all of these orders [s]",
        "times faster",
        "folds off",
        "motions off",
        "with all of these, folds off",
        "motions off",
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        some, every = row["seconds"]
        cells = [row["case"], f"{row['tolerance']:.0e}", str(row["orders"]), str(row["H"]), str(row["curves"])]
        cells += [f"{some:.2f}", f"{every:.2f}", f"{every / some:.1f}"]
        cells += ["-" if np.isnan(x) else f"{x:.0e}" for x in (row["folds"], row["motions"], *row["of all"])]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
