"""Cost of a point as the structure grows: flat once it is reduced, but for its stability; linear in memory.

    python -m studies.speed.scale [--quick] [-o DIR]

Left, a chain of n masses between walls (m = 1, springs 1, C = 0.02 K) with a cubic spring 0.5 x^3 to ground at the last
and 0.1 cos(Omega t) on the first, H = 5, Omega from 0.8 to 1.3 of its first frequency: solved with all coordinates, and
with its lowest 20 modes and residual flexibility. Right, a gear pair on two shafts in a housing, a square membrane of
finer and finer mesh, by 60 modes: seconds to reduce it, and memory.

Each structure runs in a process of its own, so that memory is its own.
"""

from __future__ import annotations

import multiprocessing
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy import sparse
from threadpoolctl import threadpool_limits

import hbgear as hb
from studies import study

ALONE = True
CHAIN_MODES, HOUSING_MODES = 20, 60
SPAN = (8.0, 4.0)
"""Omega of the geared housing; its mesh resonates near 6.3, and the teeth lose contact there."""


def chain(n: int, dense: bool = True) -> hb.System:
    """The chain; equations at the head of this file."""
    K: Any = sparse.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]).tocsr()
    M: Any = sparse.eye_array(n).tocsr()
    if dense:
        M, K = M.toarray(), K.toarray()
    spring = hb.Element(np.eye(1, n, n - 1)[0], hb.Cubic(k1=0.0, k3=0.5), name="ground spring")
    return hb.System(M, 0.02 * K, K, [spring], hb.Load(cosine={1: 0.1 * np.eye(1, n)[0]}))


def housing(side: int, shaft: int = 20) -> hb.System:
    """Gear pair on two shafts in a housing.

    A square membrane of side x side nodes (edges held, unit tension, mass and length) carries two rods of ``shaft``
    nodes each (mass 0.1, stiffness 40 from end to end) on bearings of stiffness 4, springs to all nodes of a patch;
    between their middles teeth of stiffness 1 and half backlash 0.005, loaded by 0.05 and excited by a transmission
    error 0.01 sin(tau). C = 0.01 K.
    """
    h = 1.0 / (side + 1)
    line = sparse.diags_array([-np.ones(side - 1), 2 * np.ones(side), -np.ones(side - 1)], offsets=[-1, 0, 1])
    eye, nodes = sparse.eye_array(side), side * side
    plate = sparse.kron(line, eye) + sparse.kron(eye, line)
    rod = sparse.diags_array([-np.ones(shaft - 1), 2 * np.ones(shaft), -np.ones(shaft - 1)], offsets=[-1, 0, 1]).tolil()
    rod[0, 0] = rod[-1, -1] = 1.0
    K = sparse.block_diag([plate, 40 * (shaft - 1) * rod, 40 * (shaft - 1) * rod]).tocsr()
    n = nodes + 2 * shaft
    x, y = (g.ravel() for g in np.meshgrid(*[h * np.arange(1, side + 1)] * 2, indexing="ij"))
    for k, centre in enumerate((0.35, 0.65)):
        for end, height in ((0, 0.3), (shaft - 1, 0.7)):
            seat = np.flatnonzero(np.hypot(x - centre, y - height) <= 0.1)
            spring = np.arange(len(seat))
            ends = sparse.csr_array((-np.ones(len(seat)), (spring, seat)), (len(seat), n)).tolil()
            ends[:, nodes + k * shaft + end] = 1.0
            ends = ends.tocsr()
            K = K + 4.0 / len(seat) * (ends.T @ ends)
    M = sparse.diags_array(np.concatenate([np.full(nodes, h * h), np.full(2 * shaft, 0.1 / shaft)])).tocsr()
    gap, drive = np.zeros(n), np.zeros(n)
    gap[nodes + shaft // 2], gap[nodes + shaft + shaft // 2] = 1.0, -1.0
    drive[nodes + shaft // 2], drive[nodes + shaft + shaft // 2] = 0.05, -0.05
    mesh = hb.Element(gap, hb.Backlash(b=0.005), hb.mechanics.Series(sine=(0.01,)), 0.01, "mesh")
    return hb.System(M, 0.01 * K, K, [mesh], hb.Load(constant=drive))


def traced(system: hb.System, span: tuple[float, float], repeats: int) -> dict[str, Any]:
    """Seconds per point with and without stability (the least of the runs), points, and the peak."""
    seconds: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(repeats):
        for stability, found in seconds.items():
            start = time.perf_counter()
            branch = hb.trace(hb.HarmonicBalance(system, 5), "Omega", span, stability=stability, accuracy=None)
            found.append((time.perf_counter() - start) / len(branch))
    top = branch.peak("pp2")
    return {
        "seconds": min(seconds[True]),
        "alone": min(seconds[False]),
        "points": len(branch),
        "peak": top.amplitude("pp2"),
        "status": str(branch.status),
    }


def on_chain(n: int, repeats: int, full: bool = True) -> dict[str, Any]:
    """The chain with all coordinates and reduced."""
    first = 2 * np.sin(np.pi / (2 * (n + 1)))
    span = (0.8 * first, 1.3 * first)
    with threadpool_limits(1):
        reduced = hb.mechanics.reduce(chain(n, dense=False), min(CHAIN_MODES, n - 1))
        row = {
            "n": n,
            "reduced": traced(reduced.system, span, repeats),
            "error": float(reduced.error(np.arange(6) * span[1]).max()),
        }
        return row | ({"full": traced(chain(n), span, repeats)} if full else {})


def on_housing(side: int, full: bool = False) -> dict[str, Any]:
    """The geared housing reduced; ``full``: with all coordinates too, without stability."""
    with threadpool_limits(1):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        system = housing(side)
        start = time.perf_counter()
        reduced = hb.mechanics.reduce(system, HOUSING_MODES)
        seconds = time.perf_counter() - start
        row = {"n": system.n, "reduce": seconds, "reduced": traced(reduced.system, SPAN, 2)}
        row["memory"] = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
        row["error"] = float(reduced.error(np.arange(6) * max(SPAN)).max())
        row["modulation"], row["damping"] = reduced.modulation() / 2, 0.005 * float(reduced.frequencies[-1])
        if full:
            branch = hb.trace(hb.HarmonicBalance(system, 5), "Omega", SPAN, stability=False, accuracy=None)
            row["peak"] = branch.peak("pp2").amplitude("pp2")
        return row


def run(quick: bool = False) -> dict[str, list[dict[str, Any]]]:
    """Rows of the chains and of the housings."""
    if quick:
        return {"chain": [on_chain(10, 1), on_chain(30, 1)], "housing": [on_housing(8, full=True), on_housing(12)]}
    tasks: list[tuple[Any, ...]] = [(on_chain, n, 5) for n in (10, 50, 100, 200)]
    tasks += [(on_housing, 31, True), (on_housing, 100, False), (on_housing, 316, False)]
    rows: list[dict[str, Any]] = []
    for function, *given in tasks:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            rows.append(pool.submit(function, *given).result())
    return {"chain": rows[:4], "housing": rows[4:]}


def report(results: dict[str, list[dict[str, Any]]]) -> str:
    """Both tables in Markdown."""
    lines = [
        "| n of the chain | all coordinates [ms/point] | points alone | reduced [ms/point] | points alone |"
        " points alone over n = 10 | error of receptance | difference of the peaks |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    base = results["chain"][0]["reduced"]["alone"]
    for row in results["chain"]:
        apart = abs(row["reduced"]["peak"] / row["full"]["peak"] - 1)
        times = [row[which][what] for which in ("full", "reduced") for what in ("seconds", "alone")]
        cells = [str(row["n"]), *(f"{1e3 * t:.2f}" for t in times), f"{times[-1] / base:.2f}"]
        cells += [f"{row['error']:.1e}", f"{apart:.1e}"]
        lines.append("| " + " | ".join(cells) + " |")
    lines += [
        "",
        "| n of the housing | reduced in [s] | memory [MiB] | [ms/point] | error of receptance |"
        " difference of the peaks | mu / 2 of modes left out | their least damping ratio |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in results["housing"]:
        apart_text = f"{abs(row['reduced']['peak'] / row['peak'] - 1):.1e}" if "peak" in row else "-"
        cells = [str(row["n"]), f"{row['reduce']:.2f}", f"{row['memory']:.0f}"]
        cells += [f"{1e3 * row['reduced']['seconds']:.2f}", f"{row['error']:.1e}", apart_text]
        cells += [f"{row['modulation']:.3f}", f"{row['damping']:.3f}"]
        lines.append("| " + " | ".join(cells) + " |")
    note = (
        "Points are with stability unless alone, and with 5 harmonics at any truncation error (`accuracy=None`): of the"
        " chain from n = 100 that is 5 % of some motions, so that `trace` would trace it again with 10. The cost of"
        " stability goes with the length of the period: the fastest motion of the kept modes is followed through it,"
        " and the period of the chain grows with n."
        " Errors of receptance are the largest at harmonics 0 to 5 of the highest Omega."
        " A mode left out is stable by itself if its damping ratio is above mu / 2, half the largest share of its"
        " stiffness by which the teeth can modulate it (`Reduction.modulation`)."
    )
    return "\n".join([*lines, "", note, ""])


def plot(results: dict[str, list[dict[str, Any]]]) -> Figure:
    """Milliseconds per point over n; seconds and memory over n."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.0, 3.4), layout="constrained")
    n = [row["n"] for row in results["chain"]]
    for name, text, mark, colour in (
        ("full", "all coordinates", "s", study.ORANGE),
        ("reduced", f"{CHAIN_MODES} modes", "o", study.BLUE),
    ):
        for what, line, more in (("seconds", "-", ", stability"), ("alone", "--", "")):
            each = [1e3 * row[name][what] for row in results["chain"]]
            left.loglog(n, each, mark + line, color=colour, ms=4, label=text + more)
    left.set_xlabel("masses of the chain $n$ [-]")
    left.set_ylabel("time of a point [ms]")
    n = [row["n"] for row in results["housing"]]
    right.loglog(n, [row["reduce"] for row in results["housing"]], "o-", color=study.BLUE, ms=4, label="reduction [s]")
    right.loglog(n, [row["memory"] for row in results["housing"]], "^-", color=study.PURPLE, ms=4, label="memory [MiB]")
    per_point = [1e3 * row["reduced"]["seconds"] for row in results["housing"]]
    right.loglog(n, per_point, "s-", color=study.ORANGE, ms=4, label="point with stability [ms]")
    right.set_xlabel("coordinates of the geared housing $n$ [-]")
    right.set_ylabel(f"cost with {HOUSING_MODES} modes")
    for ax, free in ((left, "upper left"), (right, "center left")):
        ax.legend(loc=free)
        ax.tick_params(which="both", direction="in", top=True, right=True)
    return figure


if __name__ == "__main__":
    study.main()
