"""Jumps: where a slow sweep of the parameter leaves a branch, and where on the same curve it lands."""

from __future__ import annotations

import numpy as np

from hbgear.branch import Branch, Jump, Point, SpecialPoint
from hbgear.newton import NoConvergence, Settings, solve


def find_jumps(branch: Branch, settings: Settings = Settings()) -> tuple[Jump, ...]:  # noqa: B008
    """A `Jump` for each located fold at which a stable part of the branch ends.

    A sweep that follows the stable part reaches the fold and finds no motion beyond it. It lands on the stable part of
    the same curve at the same parameter; if there are several, on the one whose motion is nearest.
    """
    stable = branch.stable
    if stable is None or branch.problem is None:
        return ()
    out = []
    for point in branch.special:
        if point.kind != "LP" or not point.located or not 0 < point.index < len(branch) - 1:
            continue
        i = point.index
        if not (stable[i - 1] or stable[i + 1]):
            continue
        value = float(branch.values[i])
        direction = 1 if branch.values[i - 1] < value else -1
        out.append(Jump(point.label, branch.parameter, value, direction, point, _landing(branch, point, settings)))
    return tuple(out)


def _landing(branch: Branch, fold: SpecialPoint, settings: Settings) -> Point | None:
    """The nearest stable motion at the fold's parameter, away from the fold."""
    stable = branch.stable
    assert stable is not None and branch.problem is not None
    value = float(branch.values[fold.index])
    x = branch.values - value
    sides = np.flatnonzero(x[:-1] * x[1:] <= 0)
    candidates: list[Point] = []
    for i in sides:
        if fold.index in (i, i + 1) or not (stable[i] or stable[i + 1]):
            continue
        s = x[i] / (x[i] - x[i + 1]) if x[i] != x[i + 1] else 0.0
        guess = (1 - s) * branch.X[i] + s * branch.X[i + 1]
        here = {**branch.parameters_at(int(i)), branch.parameter: value}
        try:
            solution = solve(branch.problem, guess, here, branch.parameter, settings)
        except NoConvergence:
            continue
        seen = branch.problem.observe(solution.X, stability=True, **here)
        landed = Point(
            solution.X, here, solution.residual, solution.iterations,
            seen["multipliers"], seen["regime"], seen["error"], branch.layout,
        )  # fmt: skip
        if landed.stable:
            candidates.append(landed)
    if not candidates:
        return None
    return min(candidates, key=lambda p: float(np.linalg.norm(p.X - fold.X)))
