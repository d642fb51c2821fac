"""Where the jumps of several branches land: on the same curve, or on another one that was traced.

A sweep that leaves a curve lands on a stable motion at the same parameter: of the same curve, of unconnected ones, or
of another period. Which of several it is, their basins decide, which `hbgear.time.jump_integration` asks by
integration.
Where that was not asked, the nearest is taken, whatever the phases; see `hbgear.continuation.tracing.jumps.nearest`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.point import BIFURCATING, Jump, Point
from hbgear.continuation.solvers.newton import NewtonSettings
from hbgear.continuation.tracing.jumps import monitored_points, motions_at, nearest
from hbgear.harmonic.equations.layout import Layout, layout_of

_DECIDED = ("integrate", BIFURCATING)  # landings that are not those of the nearest motion


SAME = 0.02
"""Difference of two motions at one parameter, relative to their size, that harmonics left out may make."""


_SAMPLES = 128  # of one period of the excitation, where motions are compared


@dataclass(frozen=True, eq=False)
class Landing:
    """A jump, and the position in the sequence given of the branch on which it ends; None if it ends on none of them.

    ``jump.after`` is the motion there, ``jump.candidates`` all that were considered.
    """

    jump: Jump
    branch: int | None


def landings(branches: Sequence[Branch]) -> tuple[tuple[Landing, ...], ...]:
    """For each branch its jumps in their order, landing on any of the branches.

    Other branches count if they are curves in the same parameter with all others at the same values. Jumps that were
    decided by integration stay as they are.
    """
    return tuple(tuple(_landing(branches, i, jump) for jump in branch.jumps()) for i, branch in enumerate(branches))


def _landing(branches: Sequence[Branch], own: int, jump: Jump) -> Landing:
    known = candidates(branches, own, jump)
    points = tuple(point for point, _ in known)
    after = jump.after if jump.landing in _DECIDED else nearest(jump.before, points)
    if after is None:
        return Landing(replace(jump, candidates=points), None)
    mine = [point for point, i in known if i == own]
    at = same_motion(after, mine)  # the curve of another trace may be the same one: then it stays on its own
    place = at if at is not None else same_motion(after, points)
    if place is None:
        return Landing(replace(jump, candidates=points), None)
    after = after if jump.landing in _DECIDED else points[place]
    return Landing(replace(jump, after=after, candidates=points), known[place][1])


def candidates(branches: Sequence[Branch], own: int, jump: Jump) -> list[tuple[Point, int]]:
    """Stable motions at the value of a jump of one of some branches, with the positions of their branches."""
    mine = jump.candidates
    if not mine and jump.after is not None and jump.landing == "nearest":  # of a file that does not tell the candidates
        mine = (jump.after,)
    return [(point, own) for point in mine] + stable_motions(branches, own, jump.value)


def stable_motions(branches: Sequence[Branch], own: int, value: float) -> list[tuple[Point, int]]:
    """Stable motions at a value of the parameter on the branches that go with one of them, with their positions."""
    return [
        (point, i)
        for i, other in enumerate(branches)
        if i != own and _comparable(branches[own], other)
        for point in stable_points(other, value)
    ]


def _comparable(one: Branch, other: Branch) -> bool:
    """Whether both are curves in the same parameter of the same machine, the other parameters equal."""
    if one.parameter != other.parameter or one.fixed.keys() != other.fixed.keys() or one.tracked or other.tracked:
        return False
    mine, others = layout_of(one), layout_of(other)
    known = mine is not None and others is not None and mine.elements == others.elements
    return known and bool(np.allclose([*one.fixed.values()], [*other.fixed.values()], rtol=1e-12, atol=0.0))


def stable_points(branch: Branch, value: float) -> list[Point]:
    """Stable motions at the value: solved for if the branch knows its problem, else between two stable rows."""
    if branch.problem is not None:
        return [
            point
            for point in monitored_points(branch, [motions_at(branch, value, NewtonSettings())])[0]
            if point.stable
        ]
    if branch.stable is None:
        return []
    found = []
    for place in crossings_at(branch, value):
        if all(branch.stable[i] for i in place.points):
            near, X = branch[place.nearest], place.interpolate(branch.X)
            found.append(replace(near, X=X, parameters={**near.parameters, branch.parameter: value}, label=""))
    return found


def same_motion(motion: Point, others: Sequence[Point], most: float = SAME) -> int | None:
    """Which of several motions at the same parameter this one is, phase included; None if it is none of them.

    most : largest difference relative to the size of the motion.
    """
    apart = [_difference(motion, other) for other in others]
    best = int(np.argmin(apart)) if apart else -1
    return best if apart and apart[best] <= most else None


def _difference(one: Point, other: Point) -> float:
    """Rms difference of two motions of any periods over the rms of the alternating part of the larger.

    Motions may lie whole periods of the excitation apart.
    """
    nu = math.lcm(_layout(one).nu, _layout(other).nu)
    a, b = _sampled(one, nu), _sampled(other, nu)
    apart = min(float(np.sqrt(np.mean((a - np.roll(b, k * _SAMPLES, axis=1)) ** 2))) for k in range(nu))
    size = max(float(np.sqrt(np.mean((x - x.mean(axis=1, keepdims=True)) ** 2))) for x in (a, b))
    return apart / (size or 1.0)


def _sampled(point: Point, nu: int) -> np.ndarray:
    """Values of every element over nu periods of the excitation, (m, nu * samples)."""
    layout = _layout(point)
    rows = [point.samples(j, _SAMPLES * layout.nu)[1] for j in range(len(layout.elements))]
    return np.tile(rows, (1, nu // layout.nu))


def _layout(point: Point) -> Layout:
    layout = layout_of(point)
    assert layout is not None  # else the branches are not comparable
    return layout
