"""Where the jumps of several branches land: on the same curve, or on another one that was traced.

A sweep that leaves a curve lands on a stable motion at the same parameter. `Branch.jumps` looks for it on the same
curve; where that has none, the other branches may: unconnected ones, and those of another period. Of several stable
motions the nearest is taken, measured over a common multiple of both periods, whole excitation periods apart or not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbgear.continuation.branch import Branch, Jump, Point
from hbgear.continuation.jumps import motions_at, seen_points
from hbgear.continuation.newton import Settings
from hbgear.harmonic.observables import Layout, layout_of

_SAMPLES = 128  # of one period of the excitation, where motions are compared


@dataclass(frozen=True, eq=False)
class Landing:
    """A jump, and the position in the sequence given of the branch on which it ends; None if none has a stable motion.

    ``jump.after`` is the motion there.
    """

    jump: Jump
    branch: int | None


def landings(branches: Sequence[Branch]) -> tuple[tuple[Landing, ...], ...]:
    """For each branch its jumps in their order, landing on any of the branches.

    Other branches count if they are curves in the same parameter with all others at the same values.
    """
    return tuple(tuple(_landing(branches, i, jump) for jump in branch.jumps()) for i, branch in enumerate(branches))


def _landing(branches: Sequence[Branch], own: int, jump: Jump) -> Landing:
    if jump.after is not None:
        return Landing(jump, own)
    found = [
        (point, i)
        for i, other in enumerate(branches)
        if i != own and _comparable(branches[own], other)
        for point in _stable_points(other, jump.value)
    ]
    if not found:
        return Landing(jump, None)
    point, i = min(found, key=lambda pair: _distance(jump.before, pair[0]))
    return Landing(replace(jump, after=point), i)


def _comparable(one: Branch, other: Branch) -> bool:
    """Whether both are curves in the same parameter of the same machine, the other parameters equal."""
    if one.parameter != other.parameter or one.fixed.keys() != other.fixed.keys() or one.tracked or other.tracked:
        return False
    mine, others = layout_of(one), layout_of(other)
    known = mine is not None and others is not None and mine.elements == others.elements
    return known and bool(np.allclose([*one.fixed.values()], [*other.fixed.values()], rtol=1e-12, atol=0.0))


def _stable_points(branch: Branch, value: float) -> list[Point]:
    """Stable motions at the value: solved for if the branch knows its problem, else between two stable rows."""
    if branch.problem is not None:
        return [point for point in seen_points(branch, [motions_at(branch, value, Settings())])[0] if point.stable]
    if branch.stable is None:
        return []
    x, found = branch.values - value, []
    for i in np.flatnonzero(x[:-1] * x[1:] <= 0):
        if branch.stable[i] and branch.stable[i + 1]:
            s = x[i] / (x[i] - x[i + 1]) if x[i] != x[i + 1] else 0.0
            near = branch[int(i if s < 0.5 else i + 1)]
            X = (1 - s) * branch.X[i] + s * branch.X[i + 1]
            found.append(replace(near, X=X, parameters={**near.parameters, branch.parameter: value}, label=""))
    return found


def _distance(one: Point, other: Point) -> float:
    """Rms distance of two motions of any periods, the least over shifts by whole periods of the excitation."""
    nu = math.lcm(_layout(one).nu, _layout(other).nu)
    a, b = _sampled(one, nu), _sampled(other, nu)
    return min(float(np.sqrt(np.mean((a - np.roll(b, k * _SAMPLES, axis=1)) ** 2))) for k in range(nu))


def _sampled(point: Point, nu: int) -> np.ndarray:
    """Values of every element over nu periods of the excitation, (m, nu * samples)."""
    layout = _layout(point)
    rows = [point.samples(j, _SAMPLES * layout.nu)[1] for j in range(len(layout.elements))]
    return np.tile(rows, (1, nu // layout.nu))


def _layout(point: Point) -> Layout:
    layout = layout_of(point)
    assert layout is not None  # else the branches are not comparable
    return layout
