"""Where the time of a point goes: receptances, contact, linear algebra, special points, stability, the rest.

    python -m studies.speed.profile [--quick] [-o DIR]

Each part is called by itself at the rows of a traced curve and its median time multiplied by how often the trace calls
it. What is left of the time of the whole trace is prediction, step control, bookkeeping, the start, and what the same
calls cost more when they come between others than over and over.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.fourier import to_complex
from hbgear.newton import bordered, solve_linear
from studies import study
from studies.speed.peers import model
from studies.speed.peers_curve import problem as peer

ALONE = True
CASES = {"duffing": "Duffing\n$H=7$", "spur": "spur pair\n$H=10$", "chain10": "chain of 10\n$H=5$",
         "double-helical": "double-helical\npair, $H=16$"}  # fmt: skip
PARTS = {"receptances": study.PURPLE, "forces of the laws": study.ORANGE, "assembly of the equations": "#e8c27a",
         "linear algebra": study.BLUE, "truncation, regime": "#9fcbb0", "stability": study.GREEN,
         "special points": "#b8423a", "all else": study.GREY}  # fmt: skip


SUPPORTS = (1, 2, 3, 4, 5)
"""Rows of the predictors compared."""


class Counted(hb.HarmonicBalance):
    """A balance that counts how often it is evaluated."""

    calls = motions = 0

    def linearise_all(self, X: np.ndarray, Omega: np.ndarray, **parameters: float) -> Any:
        """As `HarmonicBalance.linearise_all`."""
        self.calls += 1
        self.motions += len(X)
        return super().linearise_all(X, Omega, **parameters)


def seconds(call: Callable[[], Any], repeats: int) -> float:
    """Median of the time of a call."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return median(times)


def case(name: str) -> tuple[hb.Model, int, tuple[float, float]]:
    """Model, harmonics and span."""
    if name == "double-helical":
        pair = hb.DoubleHelicalPair()
        return pair, 16, pair.default_span
    return model(name), peer(name).harmonics, peer(name).span


def predicted(name: str, supports: tuple[int, ...]) -> dict[int, float]:
    """Newton steps per point of the curve with predictors through so many rows: tangent, cubic, and so on."""
    machine, harmonics, span = case(name)
    found = {}
    for support in supports:
        branch = hb.trace(hb.HarmonicBalance(machine, harmonics), "Omega", span, stability=False, special=False,
                          steps=hb.Steps(support=support))  # fmt: skip
        found[support] = float(branch.iterations.mean())
    return found


def profiled(name: str, repeats: int) -> dict[str, Any]:
    """Milliseconds per point of each part, and of one Newton iteration and one LAPACK solve."""
    machine, harmonics, span = case(name)
    balance = hb.HarmonicBalance(machine, harmonics)
    counted = Counted(machine, harmonics)
    branch = hb.trace(counted, "Omega", span, special=False)
    calls, points = counted.calls, len(branch)
    counted.calls = 0
    whole = seconds(lambda: hb.trace(balance, "Omega", span), repeats)
    plain = seconds(lambda: hb.trace(balance, "Omega", span, special=False), repeats)
    single: dict[str, list[float]] = {"receptances": [], "forces": [], "evaluation": [], "solve": []}
    for X, value in zip(branch.X, branch.values, strict=True):
        here = {**branch.fixed, "Omega": float(value)}
        compiled, rows = balance.compiled(here), X.reshape(balance.m, -1)
        now, omega, c = balance.linearise(X, "Omega", **here), here["Omega"], to_complex(rows)
        matrix, rhs = bordered(now, np.append(0 * X, 1.0)), np.append(now.R, 0.0)
        parts = {
            "receptances": lambda compiled=compiled, omega=omega: compiled.receptance.at(omega),
            "forces": lambda rows=rows, c=c, omega=omega, at=compiled: balance.forces(rows, c, omega, at),
            "evaluation": lambda X=X, here=here: balance.linearise(X, "Omega", **here),
            "solve": lambda matrix=matrix, rhs=rhs: solve_linear(matrix, rhs),
        }
        for part, call in parts.items():
            compiled._linear = None  # as after a change of Omega
            single[part].append(seconds(call, 3))
    each = {part: median(times) for part, times in single.items()}
    observe = [seconds(lambda on=on: balance.observe_all(branch.X, branch.values, on, **branch.fixed), repeats) / points
               for on in (False, True)]  # fmt: skip
    per_point = calls / points
    solves = branch.iterations.mean() + 1  # Newton's, and that of the tangent
    parts_of_point = {
        "receptances": per_point * each["receptances"],
        "forces of the laws": per_point * each["forces"],
        "assembly of the equations": per_point * max(0.0, each["evaluation"] - each["receptances"] - each["forces"]),
        "linear algebra": solves * each["solve"],
        "truncation, regime": observe[0],
        "stability": observe[1] - observe[0],
        "special points": (whole - plain) / points,
    }
    parts_of_point["all else"] = max(0.0, whole / points - sum(parts_of_point.values()))
    return {"name": name, "points": points, "whole": whole / points, "evaluations": per_point, "parts": parts_of_point,
            "iteration": each["evaluation"] + each["solve"], "solve": each["solve"],
            "newton": float(branch.iterations.mean()), "predictors": predicted(name, SUPPORTS)}  # fmt: skip


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per case."""
    with threadpool_limits(1):
        return [profiled(name, 1 if quick else 7) for name in (list(CASES)[:2] if quick else CASES)]


def report(rows: list[dict[str, Any]]) -> str:
    """Table in Markdown."""
    head = ["case", "ms/point", *PARTS, "evaluations per point", "Newton steps per point",
            "Newton iteration / LAPACK solve", "stability / rest"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        stability = row["parts"]["stability"]
        cells = [CASES[row["name"]].replace("\n", " ").replace("$", ""), f"{1e3 * row['whole']:.3f}"]
        cells += [f"{1e3 * row['parts'][part]:.3f}" for part in PARTS]
        cells += [f"{row['evaluations']:.2f}", f"{row['newton']:.2f}", f"{row['iteration'] / row['solve']:.1f}"]
        lines.append("| " + " | ".join([*cells, f"{stability / (row['whole'] - stability):.2f}"]) + " |")
    lines += ["", "Parts in milliseconds per point of the curve; one core.", "",
              "| Newton steps per point, predictor through | " + " | ".join(f"{k} rows" for k in SUPPORTS) + " |",
              "|" + " --- |" * (1 + len(SUPPORTS))]  # fmt: skip
    for row in rows:
        steps = " | ".join(f"{row['predictors'][k]:.2f}" for k in SUPPORTS)
        lines.append(f"| {CASES[row['name']].replace(chr(10), ' ').replace('$', '')} | {steps} |")
    return "\n".join([*lines, ""])


def plot(rows: list[dict[str, Any]]) -> Figure:
    """Stacked bars: milliseconds per point."""
    figure, ax = plt.subplots(figsize=(7.2, 3.8), layout="constrained")
    low = np.zeros(len(rows))
    for part, colour in PARTS.items():
        height = np.array([1e3 * row["parts"][part] for row in rows])
        ax.bar(range(len(rows)), height, 0.6, low, color=colour, label=part)
        low += height
    ax.set_xticks(range(len(rows)), [CASES[row["name"]] for row in rows])
    ax.set_ylabel("time of a point of the curve [ms]")
    ax.tick_params(axis="x", length=0)
    figure.legend(*(x[::-1] for x in ax.get_legend_handles_labels()), loc="outside right center")
    return figure


if __name__ == "__main__":
    study.main()
