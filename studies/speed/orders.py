"""Sparse orders against all orders: a train of two stages whose tooth frequencies are as 21 to 10.

    python -m studies.speed.orders [--quick] [-o DIR]

An input pinion of 20 teeth drives a gear of 42, which is on one shaft with a pinion of 20 that drives a gear of 50.
The second mesh resonates and loses contact. A curve with few orders (`orders="meshes"`) tells which orders exceed a
tolerance (`with_orders_of`); with these the curve is traced again, and with all orders up to the highest of them. Where
LP1 and LP2 lie then is compared with folds of all orders up to 252, and so is the motion at every tenth row.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.continuation.newton import solve
from studies import study

ALONE = True
SPAN = (0.105, 0.09)
TOLERANCES = (1e-3, 1e-4, 1e-5)
HIGHEST = 252
"""All orders up to 12 of the faster mesh."""


def train() -> hb.Train:
    """The train; words at the head of this file."""
    teeth, module = {"in": 20, "first": 42, "second": 20, "out": 50}, 3e-3
    place = {"in": 0.0, "first": 0.093, "second": 0.093, "out": 0.198}
    wheels = [
        hb.Wheel(
            name, 7800 * np.pi / 2 * 0.025 * (module * z / 2) ** 4, 1.0, teeth=z,
            base_radius=module * z / 2 * np.cos(np.radians(20)), x=place[name], torque=100.0 if name == "in" else 0.0,
        )
        for name, z in teeth.items()
    ]  # fmt: skip
    meshes = [
        hb.Mesh("in", "first", 3e8, 4e-5, eps=(0.08, 0.1), damping=0.016),
        hb.Mesh("second", "out", 3.9e8, 5e-5, eps=(0.25, 0.08), damping=0.016),
    ]
    return hb.Train(wheels, meshes, [hb.Shaft("first", "second", torsion=3e5)], balance="out")


def traced(problem: hb.HarmonicBalance) -> tuple[hb.Branch, float]:
    """The curve with stability, and the seconds it took."""
    start = time.perf_counter()
    curve = hb.trace(problem, "Omega", SPAN, accuracy=None)
    return curve, time.perf_counter() - start


def fold_of(problem: hb.HarmonicBalance, point: hb.SpecialPoint) -> float:
    """Omega of a fold solved for with the orders of a problem."""
    U = np.append(problem.converted(point), point.parameters["Omega"])
    return float(solve(hb.Fold(problem, "Omega").based(U, {}), U, {}).X[-1])


def off(curve: hb.Branch, whole: hb.HarmonicBalance) -> tuple[float, float]:
    """Largest differences of folds, and of coefficients at every tenth row where no fold is near, with all orders."""
    folds = [p for p in curve.special if p.kind == "LP"]
    moved = max(abs(fold_of(whole, p) - p.parameters["Omega"]) for p in folds)
    apart = [0.0]
    for i in range(0, len(curve), 10):
        here, known = {"Omega": float(curve.values[i])}, curve.layout.spread(curve.X[i])
        if min(abs(here["Omega"] - p.parameters["Omega"]) for p in folds) < 2e-4:
            continue
        X = whole.rows(solve(whole, whole.in_basis(curve.X[i], curve.layout), here).X)
        apart.append(float(np.abs(X[:, : known.shape[1]] - known).max()))
    return moved, max(apart)


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per tolerance: orders and seconds, those with all orders, and the differences from the finest ones."""
    model, rows = train(), []
    with threadpool_limits(1):
        first = hb.HarmonicBalance(model, 6, orders="meshes")
        traced(first)  # the warm-up
        coarse, seconds = traced(first)
        finest = hb.HarmonicBalance(model, HIGHEST)
        for tolerance in TOLERANCES[:1] if quick else TOLERANCES:
            some = first.with_orders_of(coarse, tolerance)
            sparse, all_orders = (traced(problem) for problem in (some, hb.HarmonicBalance(model, some.H)))
            folds, motions = off(sparse[0], finest)
            rows.append(
                {
                    "tolerance": tolerance,
                    "orders": len(some.orders) - 1,
                    "H": some.H,
                    "points": [len(curve) for curve, _ in (sparse, all_orders)],
                    "seconds": [took for _, took in (sparse, all_orders)],
                    "coarse": seconds,
                    "folds": folds,
                    "folds of all": off(all_orders[0], finest)[0],
                    "motions": motions,
                }
            )
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """The results as a table in Markdown."""
    head = ["tolerance", "orders", "of", "curve [s]", "with all orders [s]", "times faster", "folds off",
            "folds off with all up to H", "motions off"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        some, every = row["seconds"]
        cells = [f"{row['tolerance']:.0e}", str(row["orders"]), str(row["H"]), f"{some:.2f}", f"{every:.2f}"]
        cells += [f"{every / some:.1f}", *(f"{row[what]:.0e}" for what in ("folds", "folds of all", "motions"))]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", f"The curve that tells the orders takes {rows[0]['coarse']:.2f} s.", ""])


if __name__ == "__main__":
    study.main()
