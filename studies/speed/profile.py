"""Time of a point: balance, elimination, stability, special points, other; and its LU factorisation alone.

    python -m studies.speed.profile [--quick] [-o DIR]

The kernels are timed in loops over the rows of a curve, and taken as often as a point asks for them: those of the
balance once for each Newton step and once for its result. What special points cost is the difference that leaving them
out makes. The rest is Python's rows, and steps taken again. For comparison: the LU factorisation of the bordered
matrix by LAPACK, as often, and nothing else.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import scipy
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.common.process.compiling import kernel
from hbgear.continuation.numerics.gauss_kernels import solve_in_place
from hbgear.continuation.stepping.kernels import predict
from hbgear.harmonic.equations.assembly_kernels import assemble, workspace_for
from hbgear.harmonic.equations.motion import with_driven_harmonics
from hbgear.harmonic.multipliers.floquet import monodromies
from hbgear.harmonic.structure.receptance_kernels import fill_linear_part
from studies import study

ALONE = True
CASES = {
    "duffing": (hb.Duffing(), 7, "Duffing, $H=7$"),
    "spur": (hb.SpurPair(), 10, "spur pair, $H=10$"),
    "double-helical": (hb.gears.DoubleHelicalPair(), 16, "double-helical pair, $H=16$"),
}
"""Models, harmonics and titles."""
PARTS = {
    "linear part": study.PURPLE,
    "laws, assembly": study.ORANGE,
    "elimination": study.BLUE,
    "prediction": "#9db9dd",
    "reach, truncation": "#9fcbb0",
    "monodromy": study.GREEN,
    "eigenvalues": "#17563a",
    "special points": "#b8423a",
    "start": "#d8d8d8",
    "rest": study.GREY,
}


@kernel
def linear_parts(numbers: Any, Omega: Any) -> None:
    """Linear parts of all rows."""
    room = workspace_for(numbers)
    for w in Omega:
        fill_linear_part(
            numbers.linear, w, room.w, room.pole_terms, room.sums, room.work, room.matrices, room.constants
        )


@kernel
def assemblies(numbers: Any, X: Any, Omega: Any, matrices: Any, constants: Any, R: Any, J: Any, dR: Any) -> None:
    """Equations of all rows."""
    room = workspace_for(numbers)
    for p in range(X.shape[0]):
        assemble(numbers, X[p], Omega[p] / numbers.linear.nu, matrices, constants, R, J, dR, room)


@kernel
def eliminations(A: Any, work: Any) -> None:
    """Newton steps and directions of all rows, from their bordered matrices with two columns more (P, n, n + 2)."""
    for p in range(A.shape[0]):
        work[:, :] = A[p]
        solve_in_place(work)


@kernel
def predictions(u: Any, t: Any, scale: Any, out: Any) -> None:
    """Predictions behind points with their tangents (P, history, n)."""
    for p in range(u.shape[0]):
        predict(u[p], t[p], u.shape[1], scale, 0.01, out)


def seconds(call: Callable[[], Any], repeats: int) -> float:
    """Median of the time of a call, after one that is not counted."""
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return median(times)


def kernels(problem: hb.HarmonicBalance, curve: hb.Branch) -> dict[str, Callable[[], Any]]:
    """What computes each part, and the LU factorisations alone, for all rows of a curve."""
    compiled, X, Omega = problem.compiled({}), curve.X, curve.values
    (P, n), U = X.shape, np.column_stack([X, Omega])
    linear = compiled.receptance.at(float(Omega[0]))
    R, J, dR, A = np.empty(n), np.empty((n, n)), np.empty(n), np.ones((P, n + 1, n + 3))
    for row, x, w in zip(A, X, Omega.tolist(), strict=True):
        now = problem.linearise(x, "Omega", Omega=w)
        row[:n, :n], row[:n, n], row[n, :n] = now.dR_dX, now.dR_dp, 0.0
    columns, work = [np.asfortranarray(row[:, : n + 1]) for row in A], np.empty((n + 1, n + 3))
    history = hb.StepControl().predictor_points
    last = np.arange(history - 1, P)[:, None] - np.arange(history)
    u, t, one, out = U[last], np.gradient(U, axis=0)[last], np.ones(n + 1), np.empty(n + 1)
    parts, mobility = compiled.stability_modes().blocks, compiled.stability_modes().mobility
    more = with_driven_harmonics(compiled, X, Omega)
    found = [monodromies(compiled, part, mobility, more, Omega, None, None) for part in parts]
    return {
        "linear part": lambda: linear_parts(compiled.packed, Omega),
        "laws, assembly": lambda: assemblies(compiled.packed, X, Omega, *linear, R, J, dR),
        "elimination": lambda: eliminations(A, work),
        "prediction": lambda: predictions(u, t, one, out),
        "reach, truncation": lambda: (compiled.extrema_and_regime(X), with_driven_harmonics(compiled, X, Omega)),
        "monodromy": lambda: [monodromies(compiled, part, mobility, more, Omega, None, None) for part in parts],
        "eigenvalues": lambda: [np.linalg.eigvals(matrices) for matrices in found],
        "start": lambda: problem.start(float(Omega[0])),
        "LU": lambda: [scipy.linalg.lapack.dgetrf(matrix) for matrix in columns],
    }


def profiled(name: str, repeats: int) -> dict[str, Any]:
    """Seconds per point of each part, and of the LU factorisations alone."""
    model, H, _ = CASES[name]
    problem = hb.HarmonicBalance(model, H)
    curve = hb.trace(problem, "Omega", model.default_span, special=False)
    points, newton = len(curve), float(curve.iterations.mean())
    often = dict.fromkeys(["linear part", "laws, assembly", "elimination", "LU"], 1 + newton)
    parts = {
        part: often.get(part, 1.0) * seconds(call, repeats) / points for part, call in kernels(problem, curve).items()
    }
    lu = parts.pop("LU")
    whole, plain = (
        seconds(lambda on=on: hb.trace(problem, "Omega", model.default_span, special=on), repeats) / points
        for on in (True, False)
    )
    parts |= {"rest": max(0.0, plain - sum(parts.values())), "special points": max(0.0, whole - plain)}
    return {"name": name, "points": points, "whole": whole, "parts": parts, "lu": lu, "newton": newton}


def run(quick: bool = False) -> list[dict[str, Any]]:
    """One row per case."""
    with threadpool_limits(1):
        return [profiled(name, 1 if quick else 9) for name in (list(CASES)[:2] if quick else CASES)]


def report(rows: list[dict[str, Any]]) -> str:
    """Table in Markdown."""
    head = ["case", "points", "Newton steps", "whole", *PARTS, "LU alone", "whole / LU alone"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        cells = [CASES[row["name"]][2].replace("$", ""), str(row["points"]), f"{row['newton']:.2f}"]
        cells += [f"{1e6 * x:.1f}" for x in (row["whole"], *(row["parts"][part] for part in PARTS), row["lu"])]
        lines.append("| " + " | ".join([*cells, f"{row['whole'] / row['lu']:.1f}"]) + " |")
    return "\n".join([*lines, "", "Microseconds and Newton steps per point of the curve; one core.", ""])


def plot(rows: list[dict[str, Any]]) -> Figure:
    """For each case a stacked bar of the parts of a point, and the LU factorisations alone."""
    figure, axes = plt.subplots(1, len(rows), figsize=(7.2, 3.8), layout="constrained")
    for ax, row in zip(axes, rows, strict=True):
        low = 0.0
        for part, colour in PARTS.items():
            ax.bar(0, 1e6 * row["parts"][part], 0.6, low, color=colour, label=part)
            low += 1e6 * row["parts"][part]
        ax.bar(1, 1e6 * row["lu"], 0.6, color="k")
        ax.set_ylim(0, 1.05 * low)
        ax.set_xticks([0, 1], ["a point", "LU alone"])
        ax.set_title(CASES[row["name"]][2].replace(", ", "\n"))
        ax.tick_params(axis="x", length=0)
    axes[0].set_ylabel(r"time of a point of the curve [$\mu$s]")
    figure.legend(*(x[::-1] for x in axes[0].get_legend_handles_labels()), loc="outside right center")
    return figure


if __name__ == "__main__":
    study.main()
