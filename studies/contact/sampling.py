"""Errors of backlash forces: AFT with N samples, and exact projection with H harmonics.

    python -m studies.contact.sampling [--quick] [-o DIR]

Left, against the exact projection of the same harmonics: force and Jacobian of random motions, and the jump-up
frequency of the spur pair of Kahraman & Singh (F_ah = 0.05) at H = 10, with the truncation error of ten harmonics for
comparison. Right, against many harmonics: both jump frequencies of the exact projection.

Sampling errors depend on the positions of the samples; each value is a root mean square over motions or neighbouring N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.continuation.solvers.newton import solve
from hbgear.mechanics.series.fourier import resize
from studies import study

H_SAMPLED = 10
MOTIONS = 20
UP, DOWN = "#1f4e8c", "#d9730d"
"""Colours of the two jump frequencies."""


@dataclass(frozen=True)
class Results:
    """Errors, and the numbers of samples and harmonics.

    N (a,), force, jacobian (a,): relative errors of sampled forces; N_fold (b,), fold (b,): of the jump-up frequency.
    H (c,), folds (c, 2): errors of the jump-up and jump-down frequency of the exact projection.
    """

    N: Array
    force: Array
    jacobian: Array
    N_fold: Array
    fold: Array
    H: Array
    folds: Array

    @property
    def slopes(self) -> dict[str, float]:
        """Fitted orders: d log error / d log N or H."""
        return {
            "force": order(self.N, self.force),
            "jacobian": order(self.N, self.jacobian),
            "sampled fold": order(self.N_fold, self.fold),
            "jump-up": order(self.H, self.folds[:, 0]),
            "jump-down": order(self.H, self.folds[:, 1]),
        }


def order(x: Array, errors: Array) -> float:
    """Slope of a straight line through the logarithms."""
    return float(np.polyfit(np.log(x), np.log(errors), 1)[0])


def run(quick: bool = False) -> Results:
    """Measure; the quick form has fewer and smaller N and H."""
    N = 2 ** np.arange(6, 12 if quick else 17)
    N_fold = np.array([128, 1024]) if quick else 2 ** np.arange(7, 15)
    H = np.array([10, 20, 40] if quick else [6, 8, 10, 14, 20, 28, 40, 56, 80, 112, 160])
    spread = (1.0,) if quick else (0.93, 1.0, 1.07)
    start = folds(H_SAMPLED)
    force, jacobian = forces(N)
    sampled = sampled_folds(N_fold, start[0].parameters["Omega"], spread)
    return Results(N, force, jacobian, N_fold, sampled, H, exact_folds(H, start, 120 if quick else 400))


def forces(counts: Array) -> tuple[Array, Array]:
    """Relative errors of residual and Jacobian for each N: root mean square over random motions."""
    rng = np.random.default_rng(0)
    exact = hb.HarmonicBalance(hb.SpurPair(), H_SAMPLED)
    decay = np.repeat(np.arange(H_SAMPLED + 1.0), 2)[1:]
    motions = [3 * rng.standard_normal(exact.size) / (1 + decay) ** 2 for _ in range(MOTIONS)]
    out = np.empty((2, len(counts)))
    for i, N in enumerate(counts):
        sampled = hb.HarmonicBalance(hb.SpurPair(), H_SAMPLED, samples=int(N), sampled=True)
        errors = []
        for X in motions:
            pairs = zip(exact.evaluate(X, Omega=0.8), sampled.evaluate(X, Omega=0.8), strict=True)
            errors.append([np.linalg.norm(a - b) / np.linalg.norm(a) for a, b in pairs])
        out[:, i] = np.sqrt(np.mean(np.square(errors), axis=0))
    return out[0], out[1]


def folds(harmonics: int, **settings: object) -> list[hb.SpecialPoint]:
    """The two folds of the response, jump-up first."""
    problem = hb.HarmonicBalance(hb.SpurPair(), harmonics, **settings)  # type: ignore[arg-type]
    curve = hb.trace(problem, "Omega", (1.2, 0.65), stability=False, accuracy=None)  # of these N and H, not of more
    points = [p for p in curve.special if p.kind == "LP"]
    return sorted(points, key=lambda p: p.parameters["Omega"])


def sampled_folds(counts: Array, truth: float, spread: tuple[float, ...]) -> Array:
    """Errors of the jump-up frequency: root mean square over the N times these factors."""

    def error(N: int) -> float:
        return folds(H_SAMPLED, samples=N, sampled=True)[0].parameters["Omega"] - truth

    errors = [[error(round(N * factor)) for factor in spread] for N in counts]
    return np.sqrt(np.mean(np.square(errors), axis=1))


def exact_folds(harmonics: Array, start: list[hb.SpecialPoint], many: int) -> Array:
    """Errors of both jump frequencies against ``many`` harmonics, (len(harmonics), 2); Newton from the start."""

    def frequencies(H: int) -> Array:
        problem = hb.continuation.FoldProblem(hb.HarmonicBalance(hb.SpurPair(), H))
        guesses = [np.append(resize(p.X, H), p.parameters["Omega"]) for p in start]
        return np.array([solve(problem, U, hb.SpurPair().parameters).X[-1] for U in guesses])

    truth = frequencies(many)
    return np.array([np.abs(frequencies(int(H)) - truth) for H in harmonics])


def plot(results: Results) -> Figure:
    """Both convergences with their fitted slopes."""
    slopes = results.slopes
    lost = float(np.interp(H_SAMPLED, results.H, results.folds[:, 0]))
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.0, 3.6), layout="constrained", sharey=True)
    _line(left, results.N, results.jacobian, "s-", "#8a8a8a", "Jacobian, relative", slopes["jacobian"])
    _line(left, results.N, results.force, "o-", "#333333", "force, relative", slopes["force"])
    _line(left, results.N_fold, results.fold, "^-", UP, "jump-up frequency", slopes["sampled fold"])
    left.axhline(lost, color=UP, lw=0.9, ls=":", label=f"the same, lost by $H = {H_SAMPLED}$ alone")
    left.set_xlabel("samples per period $N$ [-]")
    left.set_ylabel(r"error: relative, or of $\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]")
    left.set_title(f"forces sampled, $H = {H_SAMPLED}$")
    _line(right, results.H, results.folds[:, 0], "^-", UP, "jump-up frequency", slopes["jump-up"])
    _line(right, results.H, results.folds[:, 1], "v-", DOWN, "jump-down frequency", slopes["jump-down"])
    right.set_xlabel("harmonics $H$ [-]")
    right.set_title("exact projection")
    for ax in (left, right):
        ax.legend(loc="lower left")
        ax.tick_params(which="both", direction="in", top=True, right=True)
    return figure


def _line(ax: Axes, x: Array, errors: Array, style: str, color: str, label: str, slope: float) -> None:
    ax.loglog(x, errors, style, color=color, ms=3.5, lw=0.9, label=f"{label}, slope ${slope:.1f}$")


def report(results: Results) -> str:
    """The fitted orders, as a table in Markdown."""
    lines = [f"| {name} | {slope:.2f} |" for name, slope in results.slopes.items()]
    return "\n".join(["| error | slope in N or H |", "| --- | --- |", *lines, ""])


if __name__ == "__main__":
    study.main()
