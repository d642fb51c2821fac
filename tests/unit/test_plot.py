"""Figures: what is drawn is what the branch holds. The curves are closed-form one-harmonic resonance curves."""

import subprocess
import sys

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from hbgear import plot
from hbgear.branch import Branch, Jump, Layout, Point, SpecialPoint, Status

LABELS = {"Omega": r"$\Omega = \omega_\mathrm{mesh}/\omega_n$", "amplitude": r"$d / b_c$"}
FIXED = {"zeta": 0.04, "F": 0.12}


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def frequency(A, side, k3, zeta, F):
    """Omega at which x'' + 2 zeta x' + x + k3 x^3 = F cos(Omega t) has the amplitude A, with one harmonic.

        (p - s)^2 + 4 zeta^2 s = F^2 / A^2,   s = Omega^2,   p = 1 + 3/4 k3 A^2
    """
    p = 1 + 0.75 * k3 * A**2
    return np.sqrt(p - 2 * zeta**2 + side * np.sqrt(np.maximum((p - 2 * zeta**2) ** 2 - p**2 + (F / A) ** 2, 0.0)))


def resonance(k3=-0.12, mean=1.9, corners=((-1.0, 1.0),), multipliers=True, harmonics=5):
    """Softening resonance curve in Omega, from high to low frequency, with its folds, grazings and jumps."""
    zeta, F = FIXED["zeta"], FIXED["F"]
    peak = brentq(lambda A: (1 + 0.75 * k3 * A**2 - 2 * zeta**2) ** 2 - (1 + 0.75 * k3 * A**2) ** 2 + (F / A) ** 2, 0.5, 2)

    def points(u):  # u in (-1, 1): up one side of the peak and down the other
        A = peak * (1 - np.abs(u))
        return frequency(A, -np.sign(k3) * 0 + np.where(u < 0, 1, -1), k3, zeta, F), A

    grid = np.linspace(-0.9, 0.9, 400)
    Omega, _ = points(grid)
    turns = [i for i in range(1, len(grid) - 1) if (Omega[i] - Omega[i - 1]) * (Omega[i + 1] - Omega[i]) < 0]
    sign = [1 if Omega[i] > Omega[i - 1] else -1 for i in turns]
    folds = [
        minimize_scalar(lambda u, s=s: -s * float(points(u)[0]), (grid[i - 1], grid[i], grid[i + 1]), tol=1e-12).x
        for i, s in zip(turns, sign, strict=True)
    ]
    grazes = [side * (1 - (mean - 1) / peak) for side in (-1, 1)] if corners[0] and mean > 1 else []
    special = sorted([(u, "LP") for u in folds] + [(u, "GR") for u in grazes])
    u = np.unique(np.concatenate([grid, folds, grazes]))
    Omega, A = points(u)
    unstable = (u > min(folds)) & (u < max(folds)) if folds else np.zeros(len(u), bool)
    mu = np.where(unstable, 1.3, 0.7)[:, None] + 0j if multipliers else None
    if mu is not None:
        mu[np.isin(u, folds)] = 1.0
    p, s = 1 + 0.75 * k3 * A**2, Omega**2
    phase = np.arctan2(2 * zeta * Omega, p - s)
    X = np.zeros((len(u), 2 * harmonics + 1))
    X[:, 0], X[:, 1], X[:, 2] = mean, A * np.cos(phase), A * np.sin(phase)
    low = mean - A
    regime = ((low < 1) & ~np.isin(u, grazes)).astype(np.int8)[:, None] + (low < -1)[:, None]
    layout = Layout(harmonics, 1, ("mesh",), corners, LABELS)
    branch = Branch(
        "Omega", Omega, X, FIXED, {}, mu, np.full(len(u), 3), np.zeros(len(u)), regime, np.zeros(len(u)),
        np.zeros(len(u)), (), (), Status.REACHED_END, "", layout, {},
    )  # fmt: skip
    found, count = [], {"LP": 0, "GR": 0}
    for at, kind in special:
        i = int(np.searchsorted(u, at))
        count[kind] += 1
        found.append(as_special(branch, i, kind, f"{kind}{count[kind]}"))
    jumps = [jump(branch, point) for point in found if point.kind == "LP"]
    return rebuilt(branch, special=tuple(found), jump_records=tuple(jumps))


def rebuilt(branch, **changes):
    fields = {name: getattr(branch, name) for name in branch.__dataclass_fields__}
    return Branch(**{**fields, **changes})


def as_special(branch, i, kind, label):
    p = branch[i]
    return SpecialPoint(
        p.X, p.parameters, p.residual, p.iterations, p.multipliers, p.regime, p.error, p.layout, label,
        kind, i, True, (branch.values[i - 1], branch.values[i + 1]),
    )  # fmt: skip


def jump(branch, point):
    """To the stable row of the nearest parameter value, other than those beside the fold."""
    i = point.index
    direction = 1 if branch.values[i] > branch.values[i + 1] else -1
    far = np.abs(np.arange(len(branch)) - i) > 30
    gap = np.where(far & (branch.stable if branch.stable is not None else far), np.abs(branch.values - branch.values[i]), 9)
    return Jump(point.label, "Omega", float(branch.values[i]), direction, point, branch[int(np.argmin(gap))])


def curves(ax):
    return [line for line in ax.lines if str(line.get_gid()).startswith("branch")]


def rich_point(nu=1):
    X = np.zeros(2 * 8 * nu + 1)
    X[0] = 1.2
    for k, (a, b) in {1: (0.9, 0.4), 2: (-0.25, 0.3), 3: (0.1, -0.12), 4: (0.03, 0.02), 6: (0.01, 0)}.items():
        X[2 * k * nu - 1], X[2 * k * nu] = a, b
    if nu > 1:
        X[1], X[2], X[5], X[6] = 0.15, 0.1, -0.06, 0.1
    layout = Layout(8 * nu, nu, ("mesh",), ((-1.0, 1.0),), LABELS)
    return Point(X, {"Omega": 0.85, "zeta": 0.05}, 0.0, 3, np.array([0.5 + 0.2j]), np.array([1], np.int8), 0.0, layout)
