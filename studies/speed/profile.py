"""Where the time of a point goes: receptances, contact, corrector, special points, stability, the rest.

    python -m studies.speed.profile [--quick] [-o DIR]

The parts of the steps along a curve are timed while it is traced; special points and stability are the difference that
leaving them out makes. The cost of a Newton iteration beside that of one LAPACK solution of its matrix is measured by
itself at the rows of the curve, for one motion and for eight at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.continuation import stride
from hbgear.continuation.algebra import all_bordered, solve_linear
from studies import study
from studies.speed.peers import model
from studies.speed.peers_curve import problem as peer

ALONE = True
CASES = {"duffing": "Duffing\n$H=7$", "spur": "spur pair\n$H=10$", "chain10": "chain of 10\n$H=5$",
         "double-helical": "double-helical\npair, $H=16$"}  # fmt: skip
PARTS = {"receptances": study.PURPLE, "forces of the laws": study.ORANGE, "assembly of the equations": "#e8c27a",
         "corrector": study.BLUE, "predictor, step control": "#9db9dd", "truncation, regime": "#9fcbb0",
         "stability": study.GREEN, "special points, jumps": "#b8423a", "all else": study.GREY}  # fmt: skip
TOGETHER = hb.StepControl().batch
"""Rows of one problem that a trace seeks together."""

SUPPORTS = (1, 2, 3, 4, 5)
"""Rows of the predictors compared."""


class Counted(hb.HarmonicBalance):
    """A balance that counts how often it is evaluated and for how many motions, and times the parts of it."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        self.calls = self.motions = 0
        self.spent = {"evaluation": 0.0, "receptances": 0.0, "forces": 0.0}
        super().__init__(*args, **settings)

    def linearise_all(self, X: np.ndarray, Omega: np.ndarray, **parameters: float) -> Any:
        """As `HarmonicBalance.linearise_all`."""
        self.calls += 1
        self.motions += len(X)
        with timed(self.spent, "receptances"):  # kept for the evaluation, which asks for them again
            self.compiled(parameters).linear(Omega)
        with timed(self.spent, "evaluation"):
            return super().linearise_all(X, Omega, **parameters)

    def forces(self, *args: Any) -> Any:
        """As `HarmonicBalance.forces`."""
        with timed(self.spent, "forces"):
            return super().forces(*args)


@contextmanager
def timed(spent: dict[str, float], part: str) -> Iterator[None]:
    """Add the time of what is done in it."""
    start = time.perf_counter()
    yield
    spent[part] += time.perf_counter() - start


@contextmanager
def strides_timed(spent: dict[str, float]) -> Iterator[None]:
    """Time the strides of traces made in it, and the corrector in them."""
    whole, corrector = stride.Strider.stride, stride.correct_all

    def timed_whole(*args: Any) -> Any:
        with timed(spent, "stride"):
            return whole(*args)

    def timed_corrector(*args: Any) -> Any:
        with timed(spent, "corrector"):
            return corrector(*args)

    stride.Strider.stride, stride.correct_all = timed_whole, timed_corrector  # type: ignore[method-assign]
    try:
        yield
    finally:
        stride.Strider.stride, stride.correct_all = whole, corrector  # type: ignore[method-assign]


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
                          steps=hb.Steps(history=support))  # fmt: skip
        found[support] = float(branch.iterations.mean())
    return found


def along(name: str) -> tuple[Counted, hb.Branch, dict[str, float]]:
    """A curve without special points and stability, with what it took: its balance, and seconds of its parts."""
    machine, harmonics, span = case(name)
    counted = Counted(machine, harmonics)
    start = counted.start(span[0])
    counted.calls, counted.motions, counted.spent = 0, 0, dict.fromkeys(counted.spent, 0.0)
    counted.spent |= {"stride": 0.0, "corrector": 0.0}
    with strides_timed(counted.spent):
        branch = hb.trace(counted, "Omega", span, start, special=False, stability=False)
    return counted, branch, counted.spent


def iteration(name: str, branch: hb.Branch, together: int) -> tuple[float, float]:
    """Seconds, for each of so many motions at once, of an evaluation and of the solution of its bordered matrix."""
    machine, harmonics, _ = case(name)
    balance = hb.HarmonicBalance(machine, harmonics)
    evaluation, solution = [], []
    for first in range(0, len(branch) - together, together):
        X, Omega = branch.X[first : first + together], branch.values[first : first + together]
        now = balance.linearise_all(X, Omega)
        A = all_bordered(now.dR_dX, now.dR_dp, np.append(0 * X[0], 1.0))
        fresh = iter(1 + 1e-12 * np.arange(5))  # a frequency that is not kept from the last call
        evaluation.append(seconds(lambda X=X, w=Omega, f=fresh: balance.linearise_all(X, next(f) * w), 4) / together)
        solution.append(seconds(lambda A=A[0]: solve_linear(A, A[:, 0]), 4))
    return median(evaluation), median(solution)


def profiled(name: str, repeats: int) -> dict[str, Any]:
    """Seconds per point of each part, and Newton iterations against LAPACK solutions."""
    machine, harmonics, span = case(name)
    balance = hb.HarmonicBalance(machine, harmonics)
    runs = [along(name) for _ in range(repeats)]
    counted, branch, _ = runs[-1]
    points = len(branch)
    spent = {part: median(one[part] for *_, one in runs) / points for part in counted.spent}
    whole = seconds(lambda: hb.trace(balance, "Omega", span), repeats)
    plain = seconds(lambda: hb.trace(balance, "Omega", span, special=False), repeats)
    observe = [seconds(lambda on=on: balance.observe_all(branch.X, branch.values, on, **branch.fixed), repeats) / points
               for on in (False, True)]  # fmt: skip
    parts = {
        "receptances": spent["receptances"],
        "forces of the laws": spent["forces"],
        "assembly of the equations": spent["evaluation"] - spent["forces"],
        "corrector": max(0.0, spent["corrector"] - spent["evaluation"] - spent["receptances"]),
        "predictor, step control": spent["stride"] - spent["corrector"],
        "truncation, regime": observe[0],
        "stability": max(0.0, observe[1] - observe[0]),
        "special points, jumps": max(0.0, whole - plain) / points,
    }
    parts["all else"] = max(0.0, whole / points - sum(parts.values()))
    return {"name": name, "points": points, "whole": whole / points, "parts": parts,
            "evaluations": counted.calls / points, "motions": counted.motions / points,
            "newton": float(branch.iterations.mean()), "predictors": predicted(name, SUPPORTS),
            "iterations": {k: iteration(name, branch, k) for k in (1, TOGETHER)}}  # fmt: skip


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per case."""
    with threadpool_limits(1):
        return [profiled(name, 1 if quick else 7) for name in (list(CASES)[:2] if quick else CASES)]


def report(rows: list[dict[str, Any]]) -> str:
    """Table in Markdown."""
    head = ["case", "ms/point", *PARTS, "evaluations per point", "motions evaluated per point",
            "Newton steps per point", "Newton iteration / LAPACK solve", f"of {TOGETHER} at once",
            "stability / rest"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        stability = row["parts"]["stability"]
        cells = [CASES[row["name"]].replace("\n", " ").replace("$", ""), f"{1e3 * row['whole']:.3f}"]
        cells += [f"{1e3 * row['parts'][part]:.3f}" for part in PARTS]
        cells += [f"{row['evaluations']:.2f}", f"{row['motions']:.2f}", f"{row['newton']:.2f}"]
        cells += [f"{(evaluation + solution) / solution:.1f}" for evaluation, solution in row["iterations"].values()]
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
