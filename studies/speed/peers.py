"""hbgear and other Python packages for harmonic balance: time and accuracy for the same curves, run in turn.

    python -m studies.speed.peers [--quick] [-o DIR]

Duffing oscillator (H = 7), spur gear pair (H = 10) and a chain of n masses with a cubic spring at its end (H = 5);
their equations are in `peers_curve`. Each package runs in an environment of its own, made on first use in `.peers`
next to this file, on one core. Folds and peaks of the packages are taken from their points by parabolas. pyHarm has
arclength continuation with step control, harmonicbalance one with a fixed step and one coordinate; mousai finds motions
at given frequencies, so it finds jumps and no folds; so does algebraic-hbm, for one coordinate and polynomial laws, and
compiles its equations for every curve. None of them gives stability.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from scipy import sparse
from threadpoolctl import threadpool_limits

import hbgear as hb
from studies import study
from studies.speed import peers_curve

ALONE = True
LIMIT = 60.0
"""Seconds a package has for a curve and its warm-up."""
LONG = 15.0
"""Seconds; a curve that takes longer is traced once."""
PACKAGES = {
    "pyHarm": "pyHarm-os==1.2.2",
    "harmonicbalance": "harmonicbalance==0.2.0",
    "mousai": "mousai==0.3.1",
    "algebraic_hbm": "algebraic-hbm==0.1.4",
}
MODES = 12
VARIANTS = {
    "hbgear": (False, False),
    "hbgear, stability": (True, False),
    f"hbgear, {MODES} modes": (False, True),
    f"hbgear, {MODES} modes, stability": (True, True),
}
"""Of hbgear: with stability, structure reduced."""
PROBLEMS = {
    "duffing": "Duffing",
    "spur": "spur pair",
    "chain10": "chain, n = 10",
    "chain50": "chain, n = 50",
    "chain100": "chain, n = 100",
    "chain200": "chain, n = 200",
}
BEFORE = {"duffing": 0.84, "spur": 1.07, "chain10": 1.1, "chain50": 2.2, "chain100": 7.3, "chain200": 37.0}
PYHARM_BEFORE = {"duffing": 1.1, "spur": 1.7, "chain10": 5.3, "chain50": 152.0}
"""ms per point of the fastest Python package known before hbgear, measured elsewhere; and of pyHarm there."""
EXACT = {
    "duffing": ((1.1001550351366, 1.1033778377325), 1.65351716694),
    "spur": ((0.7080316187, 0.8284639844), 1.36550347),
}
"""Folds and peak max|x| of converged solutions. Chains are compared with hbgear's folds and peak on all coordinates."""

Row = dict[str, Any]


def model(name: str, store: Callable[..., Any] = np.asarray) -> hb.mechanics.Model:
    """The problem as a model of hbgear; ``store``: how its matrices are kept, `scipy.sparse.csr_array` for instance."""
    if name == "duffing":
        return hb.Duffing(zeta=0.05, k3=0.1, F=0.18)
    if name == "spur":
        return hb.SpurPair()
    given = peers_curve.problem(name)
    n = len(given.M)
    spring = hb.Element(np.eye(1, n, n - 1)[0], hb.Cubic(k1=0.0, k3=given.k), name="spring")
    load = hb.Load(cosine={1: given.cosine * np.eye(1, n)[0]})
    return hb.System(store(given.M), store(given.C), store(given.K), [spring], load)


def ours(name: str, stability: bool, reduced: bool) -> Row:
    """A curve by hbgear; the reduction is part of its time, `peaks` is not. Folds are located in the time taken."""
    given = peers_curve.problem(name)
    start = time.perf_counter()
    system: hb.mechanics.Model = (
        hb.mechanics.reduce(model(name, sparse.csr_array), MODES).system if reduced else model(name)
    )
    problem = hb.HarmonicBalance(system, given.harmonics)
    branch = hb.trace(problem, "Omega", given.span, stability=stability)
    seconds = time.perf_counter() - start
    folds = [float(branch[p.label].parameters["Omega"]) for p in branch.special if p.label.startswith("LP")]
    (top,) = hb.analysis.peaks(branch, "max", share=0.999)
    return {
        "seconds": seconds,
        "points": len(branch),
        "failed": 0,
        "folds": folds,
        "peak": top.amplitude("max"),
        "residual": float(branch.residual.max()),
    }


def environment(package: str) -> Path:
    """Python of the environment of a package, made with the pinned version if it is not there."""
    folder = Path(__file__).parent / ".peers" / package
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True, capture_output=True)
        subprocess.run([python, "-m", "pip", "install", "-q", PACKAGES[package]], check=True, capture_output=True)
    return python


def theirs(name: str, package: str) -> Row:
    """A curve by another package, or ``{"failure": why}``."""
    script = f"studies.speed.peers_{package.lower()}"
    command = [environment(package), "-W", "ignore", "-m", script, name]
    settings = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(study.ROOT.parent)}
    try:
        with tempfile.TemporaryDirectory() as scratch:  # pyHarm writes a folder where it runs
            done = subprocess.run(
                command, timeout=LIMIT, check=True, cwd=scratch, env=settings, capture_output=True, text=True
            )
    except subprocess.TimeoutExpired:
        return {"failure": f"not done in {LIMIT:.0f} s"}
    except subprocess.CalledProcessError as error:
        text = error.stderr if isinstance(error.stderr, str) else error.stderr.decode(errors="replace")
        return {"failure": text.strip().splitlines()[-1] if text.strip() else f"ended with {error.returncode}"}
    row: Row = json.loads(done.stdout.splitlines()[-1])
    return row


def tools(name: str, packages: list[str]) -> dict[str, Callable[[], Row]]:
    """What runs on a problem: the variants of hbgear, and the packages."""
    larger = len(peers_curve.problem(name).M) > MODES
    out: dict[str, Callable[[], Row]] = {
        label: partial(ours, name, *how) for label, how in VARIANTS.items() if larger or not how[1]
    }
    return out | {package: partial(theirs, name, package) for package in packages}


def compared(name: str, repeats: int, packages: list[str]) -> list[Row]:
    """One row per tool: the last run's numbers with the median of the seconds of all its runs.

    ``ratio`` is the median, over the rounds, of its time per point over that of hbgear in the same round. A tool that
    fails, or takes long, is not run again.
    """
    runs: dict[str, list[Row]] = {tool: [] for tool in tools(name, packages)}
    for _ in range(repeats):
        for tool, traced in tools(name, packages).items():
            if not any("failure" in row or row["seconds"] > LONG for row in runs[tool]):
                runs[tool].append(traced())
    base = [row["seconds"] / row["points"] for row in runs["hbgear"]]
    out = []
    for tool, mine in runs.items():
        row = {"problem": name, "tool": tool} | mine[-1]
        if "failure" not in row:
            row["seconds"] = median(one["seconds"] for one in mine)
            row["ratio"] = median(one["seconds"] / one["points"] / own for one, own in zip(mine, base, strict=False))
        out.append(row)
    return out


def run(quick: bool = False) -> list[Row]:
    """Rows of all tools on all problems; quick: hbgear alone, on the small ones, once.

    A package that fails on a chain is not run on the longer ones.
    """
    rows: list[Row] = []
    with threadpool_limits(1):
        ours("duffing", True, False)  # warm-up
        for name in ("duffing", "spur", "chain10") if quick else PROBLEMS:
            gone = {row["tool"] for row in rows if row["problem"].startswith("chain") and "failure" in row}
            rows += compared(name, 1 if quick else 3, [p for p in PACKAGES if not quick and p not in gone])
    return rows


def away(row: Row, rows: list[Row]) -> tuple[float, float]:
    """Largest distances of folds (nan if there are not as many) and of the peak, relative, from the exact ones."""
    problem = row["problem"]
    if problem in EXACT:
        folds, peak = EXACT[problem]
    else:
        whole = next(r for r in rows if (r["problem"], r["tool"]) == (problem, "hbgear"))
        if row is whole:
            return np.nan, np.nan
        folds, peak = whole["folds"], whole["peak"]
    same = len(row["folds"]) == len(folds)
    near = np.sort(row["folds"]) / np.sort(folds) - 1 if same else np.array([np.nan])
    return float(np.abs(near).max()), abs(row["peak"] / peak - 1)


def cells(row: Row, rows: list[Row]) -> list[str]:
    """A line of the table."""
    head = [PROBLEMS[row["problem"]], row["tool"]]
    if "failure" in row:
        return [*head, row["failure"], *["-"] * 8]
    folds, peak = (f"{value:.0e}" if np.isfinite(value) else "-" for value in away(row, rows))
    points = f"{row['points']}" + (f" ({row['failed']} not converged)" if row["failed"] else "")
    return [
        *head,
        points,
        f"{_each(row):.2f}",
        f"{row['ratio']:.2f}",
        f"{row['seconds']:.2f}",
        f"{BEFORE[row['problem']]:g}",
        str(len(row["folds"])),
        folds,
        peak,
        f"{row['residual']:.0e}",
    ]


def report(rows: list[Row]) -> str:
    """The table in Markdown."""
    head = [
        "problem",
        "tool",
        "points",
        "ms/point",
        "over hbgear",
        "curve [s]",
        "fastest before [ms/point]",
        "folds",
        "error of folds",
        "error of peak",
        "largest residual",
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    lines += ["| " + " | ".join(cells(row, rows)) + " |" for row in rows]
    note = (
        "Medians of runs in turn, on one core. Fastest before: the fastest Python package known before hbgear, ms per"
        f" point on two cores, measured elsewhere. Curves by {MODES} modes contain the reduction. hbgear with stability"
        " also locates changes of stability; folds are located while it traces, the peak after it, not timed."
        " Errors are relative; on the chains they are the distance from hbgear's curve on all coordinates. Residuals of"
        " the packages are of the equation of motion, over the largest load. A package that fails on a chain is not run"
        " on longer ones. mousai and algebraic_hbm walk up and down in Omega: a turn of the walk is not a fold."
    )
    return "\n".join([*lines, "", note, "", *against_before(rows), ""])


def against_before(rows: list[Row]) -> list[str]:
    """Lines of a table: hbgear with stability against pyHarm, and the fastest package known before on this machine.

    That one was measured on another machine together with pyHarm, whose times give the ratio of the machines.
    """
    done = {(row["problem"], row["tool"]): row for row in rows if "failure" not in row}
    lines = [
        "| problem | curve of pyHarm over that of hbgear | pyHarm here / there |"
        " fastest before, scaled [ms/point] | over hbgear |",
        "| --- | --- | --- | --- | --- |",
    ]
    slower = 1.0
    for name in dict.fromkeys(row["problem"] for row in rows):
        own = min((done[name, tool] for tool in VARIANTS if "stability" in tool and (name, tool) in done), key=_each)
        other = done.get((name, "pyHarm"))
        if other is not None and name in PYHARM_BEFORE:
            slower = _each(other) / PYHARM_BEFORE[name]
        ratio = f"{other['seconds'] / own['seconds']:.0f}" if other else f"> {LIMIT / own['seconds']:.0f}"
        scaled = slower * BEFORE[name]
        cells = [PROBLEMS[name], ratio, f"{slower:.2f}", f"{scaled:.2f}", f"{scaled / _each(own):.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    note = (
        "hbgear with stability, the others without. pyHarm is the one package here that takes chains; where it is not"
        f" done in {LIMIT:.0f} s, its curve takes longer than that, as do those of longer chains, and the ratio of the"
        " machines is that of the problem before. The fastest before: an estimate."
    )
    return [*lines, "", note]


def _each(row: Row) -> float:
    """Milliseconds of a point."""
    return 1e3 * float(row["seconds"]) / int(row["points"])


def plot(rows: list[Row]) -> Figure:
    """Bars: milliseconds per point."""
    names = list(dict.fromkeys(row["problem"] for row in rows))
    labels = [*VARIANTS, *PACKAGES]
    ours = ("#9db9dd", study.BLUE, "#9fcbb0", study.GREEN)
    colours = dict(zip(labels, (*ours, study.ORANGE, study.PURPLE, study.GREY, "#c9b458"), strict=True))
    figure, ax = plt.subplots(figsize=(8.0, 3.6), layout="constrained")
    for label in labels:
        mine = [row for row in rows if row["tool"] == label and "failure" not in row]
        here = [[r["tool"] for r in rows if r["problem"] == row["problem"] and "failure" not in r] for row in mine]
        at = [
            names.index(row["problem"]) + 0.12 * (found.index(label) - (len(found) - 1) / 2)
            for row, found in zip(mine, here, strict=True)
        ]
        if mine:
            ax.bar(at, [_each(row) for row in mine], 0.11, color=colours[label], label=label)
    for k, name in enumerate(names):
        ax.hlines(
            BEFORE[name],
            k - 0.42,
            k + 0.42,
            color="black",
            ls="--",
            lw=0.9,
            label="fastest before (elsewhere)" if k == 0 else None,
        )
    ax.set_yscale("log")
    ax.set_xticks(range(len(names)), [PROBLEMS[name] for name in names])
    ax.set_ylabel("time of a converged point [ms]")
    ax.tick_params(axis="y", which="both", direction="in", right=True)
    ax.tick_params(axis="x", length=0)
    figure.legend(loc="outside upper center", ncols=4)
    return figure


if __name__ == "__main__":
    study.main()
