"""Landings of jumps on several branches: stable motions of the same branch or of another traced branch.

At a jump the sweep lands on a stable motion at the same parameter: of the same branch, of a disconnected one, or of one
with another period. If several motions are stable, their basins of attraction determine the landing;
`hbgear.time.jump_integration` integrates it. Otherwise the nearest stable motion is taken, independent of the phases;
see `hbgear.continuation.tracing.jumps.nearest`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.point import BIFURCATING, Jump, Point
from hbgear.continuation.tracing.jumps import nearest, points_of
from hbgear.harmonic.equations.layout import Layout, layout_of
from hbgear.harmonic.models.model_registry import is_description
from hbgear.mechanics.models import differing_fields

_KEPT_LANDINGS = ("integrate", BIFURCATING)
"""Kinds of landings that are kept; any other landing is the nearest stable motion."""

MAX_MOTION_DIFFERENCE = 0.02
"""Largest rms difference of two motions that are the same, relative to their alternating part.

Allows for truncated harmonics: the two motions may have different numbers of harmonics.
"""

_COMPARED_SAMPLES = 128
"""Number of samples of one period of the excitation at which two motions are compared."""


@dataclass(frozen=True, eq=False)
class Landing:
    """Jump with the number of the branch in a sequence on which it lands, None if it lands on none of them.

    ``jump.after`` is the motion on which it lands, ``jump.candidates`` are all motions that were compared.
    """

    jump: Jump
    branch: int | None


def landings(branches: Sequence[Branch]) -> tuple[tuple[Landing, ...], ...]:
    """Return the jumps of each branch in its order, with landings on any of the branches.

    Another branch is considered if it has the same model and parameter and equal fixed parameters. Landings that were
    integrated are kept.
    """
    return tuple(tuple(_landing(branches, i, jump) for jump in branch.jumps()) for i, branch in enumerate(branches))


def _landing(branches: Sequence[Branch], origin: int, jump: Jump) -> Landing:
    """Return the landing of a jump of the branch with number `origin`."""
    motions = candidates(branches, origin, jump)
    points = tuple(point for point, _ in motions)
    after = jump.after if jump.landing in _KEPT_LANDINGS else nearest(jump.before, points)
    if after is None:
        return Landing(replace(jump, candidates=points), None)
    # another trace may have passed the same branch: motions of the own branch come first
    origin_points = [point for point, i in motions if i == origin]
    origin_index = same_motion(after, origin_points)
    index = origin_index if origin_index is not None else same_motion(after, points)
    if index is None:
        return Landing(replace(jump, candidates=points), None)
    after = after if jump.landing in _KEPT_LANDINGS else points[index]
    return Landing(replace(jump, after=after, candidates=points), motions[index][1])


def candidates(branches: Sequence[Branch], origin: int, jump: Jump) -> list[tuple[Point, int]]:
    """Return the stable motions at the value of a jump, with the numbers of their branches; of the own branch first."""
    points = jump.candidates
    if not points and jump.after is not None and jump.landing == "nearest":  # branch from a file without candidates
        points = (jump.after,)
    return [(point, origin) for point in points] + stable_motions(branches, origin, jump.value)


def stable_motions(branches: Sequence[Branch], origin: int, value: float) -> list[tuple[Point, int]]:
    """Return the stable motions of other branches at a value of the parameter, with the numbers of their branches.

    Another branch than number ``origin`` is considered if its parameters are comparable.
    """
    return [
        (point, i)
        for i, branch in enumerate(branches)
        if i != origin and _comparable(branches[origin], branch)
        for point in stable_points(branch, value)
    ]


def _comparable(a: Branch, b: Branch) -> bool:
    """Return whether two branches have the same parameter, elements and model, and equal fixed parameters."""
    if a.parameter != b.parameter or a.fixed.keys() != b.fixed.keys() or a.tracked or b.tracked:
        return False
    first, second = layout_of(a), layout_of(b)
    if first is None or second is None or first.elements != second.elements or not _same_model(a, b):
        return False
    return bool(np.allclose([*a.fixed.values()], [*b.fixed.values()], rtol=1e-12, atol=0.0))


def _same_model(a: Branch, b: Branch) -> bool:
    """Return whether the models of two branches differ in fixed parameters only; True if a model is unknown."""
    first, second = (branch.meta.get("model", {}) for branch in (a, b))
    if not (is_description(first) and is_description(second)):
        return True
    replaced = {name.partition("[")[0] for name in a.fixed}
    return first["class"] == second["class"] and not {*differing_fields(first, second)} - replaced


def stable_points(branch: Branch, value: float) -> list[Point]:
    """Return the stable motions of a branch at a value of its parameter.

    They are solved for if the branch knows its problem. Otherwise they are interpolated between two stable points.
    """
    if branch.problem is not None:
        return [point for point in points_of(branch, value) if point.stable]
    if branch.stable is None:
        return []
    points = []
    for crossing in crossings_at(branch, value):
        if all(branch.stable[i] for i in crossing.points):
            motion, X = branch[crossing.nearest], crossing.interpolate(branch.X)
            points.append(replace(motion, X=X, parameters={**motion.parameters, branch.parameter: value}, label=""))
    return points


def same_motion(motion: Point, points: Sequence[Point], tolerance: float = MAX_MOTION_DIFFERENCE) -> int | None:
    """Return the index of the nearest point that equals a motion at the same parameter, including its phase, or None.

    Motions may differ in resolution and period, and by a shift of whole periods of the excitation. The tolerance is the
    largest rms difference relative to the alternating part. Solutions of the same equations are compared by
    `hbgear.continuation.solvers.deflation.same_solution`, with a tolerance of Newton's method.
    """
    differences = [_relative_difference(motion, point) for point in points]
    nearest_index = int(np.argmin(differences)) if differences else -1
    return nearest_index if differences and differences[nearest_index] <= tolerance else None


def _relative_difference(motion: Point, other: Point) -> float:
    """Return the rms difference of two motions over the rms of the larger alternating part.

    It is the minimum over shifts by whole periods of the excitation.
    """
    nu = math.lcm(_layout(motion).nu, _layout(other).nu)
    a, b = _sampled(motion, nu), _sampled(other, nu)
    shifts = (np.roll(b, k * _COMPARED_SAMPLES, axis=1) for k in range(nu))
    difference = min(float(np.sqrt(np.mean((a - x) ** 2))) for x in shifts)
    size = max(float(np.sqrt(np.mean((x - x.mean(axis=1, keepdims=True)) ** 2))) for x in (a, b))
    return difference / (size or 1.0)


def _sampled(point: Point, nu: int) -> np.ndarray:
    """Return the displacements of all elements over nu periods of the excitation, shape (m, nu * samples)."""
    layout = _layout(point)
    samples = [point.samples(j, _COMPARED_SAMPLES * layout.nu)[1] for j in range(len(layout.elements))]
    return np.tile(samples, (1, nu // layout.nu))


def _layout(point: Point) -> Layout:
    """Return the layout of a motion."""
    layout = layout_of(point)
    assert layout is not None  # otherwise the branches are not comparable
    return layout
