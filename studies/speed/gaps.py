"""Many gaps: a train of 6 meshes on 500 coordinates, and a planetary set of 6 planets with backlash in 12 meshes.

    python -m studies.speed.gaps [--quick] [-o DIR]

How long a curve takes with and without stability, which part of it is the solution of the dense equations of Newton,
and what could be gained by elimination: gaps that touch no corner over a period, always in contact or always apart,
are linear in the unknowns. The block of such gaps is solved for first, in the order of the harmonics, in which it is a
band as wide as their stiffness has harmonics, and the others with what remains (Schur complement). Side by side with
the dense way, on the Jacobians of the curve itself, for as many gaps as touch nothing there and for all but one.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

import hbgear as hb
from studies import study

ALONE = True


def train(n: int = 500, meshes: int = 6) -> hb.System:
    """Wheels on long shafts, one behind the other: n coordinates in rows of n / (meshes + 1), a mesh between rows."""
    each = n // (meshes + 1)
    K = np.zeros((n, n))
    for row in range(meshes + 1):
        first, last = row * each, (row + 1) * each if row < meshes else n
        for i in range(first, last - 1):
            K[i : i + 2, i : i + 2] += 40.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    elements = []
    for j in range(meshes):
        w = np.zeros(n)
        w[j * each + each // 2], w[(j + 1) * each + each // 2] = 1.0, -1.0
        stiffness = hb.mechanics.Series(1.0, (0.15 * np.cos(j), 0.05), (0.15 * np.sin(j), 0.0))
        elements.append(hb.Element(w, hb.Backlash(b=1.0, stiffness=stiffness), damping=0.03, name=f"mesh {j + 1}"))
    F = np.zeros(n)
    F[each // 2], F[meshes * each + each // 2] = 0.1, -0.1
    M = np.eye(n) * (meshes + 1) / n
    return hb.System(M, 0.004 * K, K, elements, hb.Load(constant=F))


def cases() -> dict[str, tuple[hb.mechanics.Model, int, tuple[float, float]]]:
    """Models, harmonics and spans."""
    planets = hb.gears.PlanetarySet(40, 20, 80, planets=6)
    return {"6 meshes, 500 coordinates": (train(), 12, (1.4, 1.0)), "6 planets, 12 meshes": (planets, 8, (1.8, 1.0))}


def banded(J: np.ndarray, m: int, linear: np.ndarray, rest: np.ndarray, b: np.ndarray) -> np.ndarray:
    """J^-1 b by elimination of the gaps ``linear``, whose block is a band in the order of harmonics."""
    n = len(J) // m
    first = (np.arange(n)[:, None] + n * linear).ravel()  # harmonic after harmonic
    last = (np.arange(n)[None] + n * rest[:, None]).ravel()
    A = J[np.ix_(first, first)]
    rows, columns = np.nonzero(np.abs(A) > 1e-14 * np.abs(A).max())
    width = int(np.abs(rows - columns).max())
    band = np.zeros((2 * width + 1, len(A)))
    band[width + rows - columns, columns] = A[rows, columns]
    sides = np.column_stack([J[np.ix_(first, last)], b[first]])
    solved = scipy.linalg.solve_banded((width, width), band, sides, overwrite_ab=True, check_finite=False)
    B = J[np.ix_(last, first)]
    x = np.empty(len(J))
    x[last] = np.linalg.solve(J[np.ix_(last, last)] - B @ solved[:, :-1], b[last] - B @ solved[:, -1])
    x[first] = solved[:, -1] - solved[:, :-1] @ x[last]
    return x


def best(call: Any, times: int) -> float:
    """The shortest of some runs, in ms."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return 1e3 * min(seconds)


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per case."""
    rows = []
    with threadpool_limits(1):
        for name, (model, harmonics, span) in cases().items():
            problem = hb.HarmonicBalance(model, harmonics)
            few = hb.StepControl(max_points=20 if quick else 400)
            hb.trace(problem, "Omega", span, steps=hb.StepControl(max_points=3))  # the warm-up
            row: dict[str, Any] = {"case": name, "size": problem.size}
            for what, stability in (("alone", False), ("stability", True)):
                start = time.perf_counter()
                curve = hb.trace(
                    problem, "Omega", span, steps=few, stability=stability, special=stability, accuracy=None
                )
                row[what] = time.perf_counter() - start
            row |= {"points": len(curve), "newton": float(curve.iterations.mean()) + 1}
            touched = (curve.regime > 0).sum(axis=1)
            i = int(np.argmax(touched))
            idle = np.flatnonzero(curve.regime[i] == 0)
            J, b = (
                problem.evaluate(curve.X[i], Omega=curve.values[i])[1],
                np.random.default_rng(0).normal(size=problem.size),
            )
            times = 3 if quick else 15
            row["dense"] = best(lambda J=J, b=b: scipy.linalg.lapack.dgesv(J, b), times)
            row |= {"touched": float(touched.mean()), "most": int(touched.max()), "gaps": problem.m}
            still = problem.evaluate(problem.start(Omega=span[0]), Omega=span[0])[1]
            for what, matrix, linear in (("idle", J, idle), ("all but one", still, np.arange(1, problem.m))):
                if not 0 < len(linear) < problem.m:
                    row[what] = float("nan")
                    continue
                rest = np.setdiff1d(np.arange(problem.m), linear)
                x, y = banded(matrix, problem.m, linear, rest, b), np.linalg.solve(matrix, b)
                row[f"{what} off"] = float(np.abs(x - y).max() / np.abs(y).max())
                row[what] = best(lambda a=matrix, u=linear, v=rest, b=b, m=problem.m: banded(a, m, u, v, b), times)
            rows.append(row)
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """The results as a table in Markdown."""
    head = [
        "case",
        "unknowns",
        "points",
        "gaps that touch, mean and most",
        "curve [s]",
        "with stability [s]",
        "solving dense equations [s]",
        "one solution, dense [ms]",
        "gaps that touch nothing eliminated [ms]",
        "all but one eliminated [ms]",
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        solving = 1e-3 * row["dense"] * row["newton"] * row["points"]
        cells = [row["case"], str(row["size"]), str(row["points"])]
        cells += [f"{row['touched']:.1f}, {row['most']} of {row['gaps']}"]
        times = (row["alone"], row["stability"], solving, row["dense"], row["idle"], row["all but one"])
        cells += ["-" if np.isnan(x) else f"{x:.2f}" for x in times]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    study.main()
