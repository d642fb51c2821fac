"""Ranges of the pinion speed: loss of contact, possible jumps, and no stable motion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

import hbgear as hb
from hbgear.common.arrays import Array
from hbgear.harmonic.equations.layout import layout_of
from hbgear.mechanics.structures.scales import Scales

Ranges = list[tuple[float, float]]

SHORTEST_RANGE = 1e-3
"""Width of a range of speeds without a stable motion, over its highest speed, that is reported; next to special points
the points of a curve leave shorter ones."""


def is_shown(speed: float, shown: tuple[float, float] | None) -> bool:
    """Return whether a speed lies in the range of speeds that is reported, with its ends; None is any range."""
    return shown is None or shown[0] <= speed <= shown[1]


def clipped(ranges: Ranges, shown: tuple[float, float] | None) -> Ranges:
    """Return the parts of ranges within the range that is reported.

    Examples
    --------
    >>> clipped([(1.0, 2.0), (5.0, 9.0)], (1.5, 6.0))
    [(1.5, 2.0), (5.0, 6.0)]
    """
    if shown is None:
        return ranges
    parts = [(max(low, shown[0]), min(high, shown[1])) for low, high in ranges]
    return [(low, high) for low, high in parts if low < high]


def scales_of(model: hb.mechanics.Model) -> Scales:
    """Return the scales of a model, which the speeds in r/min need."""
    if model.scales is None:
        raise ValueError("the model has no scales, so its speeds in r/min are unknown")
    return model.scales


def meshes_of(model: hb.mechanics.Model) -> Sequence[int | str]:
    """Return the names of the meshes of a model, or the number of the first element."""
    return model.mesh_names or [0]


def contact_lost(model: hb.mechanics.Model, curve: hb.Branch) -> Ranges:
    """Return the ranges of the pinion speed [r/min] in which a known motion loses the contact of teeth of a mesh."""
    names = meshes_of(model)

    def lost(branch: hb.Branch) -> Array:
        layout, regime = layout_of(branch), np.asarray(branch.regime)
        if not regime.shape[1]:  # motions in the gap, without contact
            return np.ones(len(branch), dtype=bool)
        columns = [layout.index(name) if layout else 0 for name in names]
        return np.asarray((regime[:, columns] > 0).any(axis=1))

    return merged(part for branch in curve.curves for part in _speed_ranges(model, branch, lost(branch)))


def without_stable_motion(model: hb.mechanics.Model, curve: hb.Branch) -> Ranges:
    """Return the ranges of the pinion speed [r/min] in which no stable motion of the period of the curve is known."""
    if any(branch.stable is None for branch in curve.curves):
        return []
    return _longer(outside(_with_stability(model, curve, True), *speed_span(model, curve)))


def jumps_possible(model: hb.mechanics.Model, curve: hb.Branch, excluded: Ranges) -> Ranges:
    """Return the ranges of the pinion speed [r/min] with unstable motions, between folds, outside known ranges.

    The motions on both sides of an unstable one coexist, and jumps lead from one to the other.
    """
    unstable = _with_stability(model, curve, False)
    return _longer(part for low, high in unstable for part in outside(excluded, low, high))


def _with_stability(model: hb.mechanics.Model, curve: hb.Branch, stable: bool) -> Ranges:
    """Return the ranges of the pinion speed [r/min] in which a stable, or an unstable motion is known."""
    branches = [branch for branch in curve.curves if branch.stable is not None]
    return merged(
        part for branch in branches for part in _speed_ranges(model, branch, np.asarray(branch.stable, bool) == stable)
    )


def _longer(ranges: Iterable[tuple[float, float]]) -> Ranges:
    """Return the ranges that are longer than `SHORTEST_RANGE`."""
    return [(low, high) for low, high in ranges if high - low > SHORTEST_RANGE * high]


def speed_span(model: hb.mechanics.Model, curve: hb.Branch) -> tuple[float, float]:
    """Return the lowest and the highest pinion speed [r/min] of a curve and the other curves of its span."""
    values, scales = np.concatenate([branch.values for branch in curve.curves]), scales_of(model)
    return float(scales.pinion_speed(float(values.min()))), float(scales.pinion_speed(float(values.max())))


def _speed_ranges(model: hb.mechanics.Model, branch: hb.Branch, holds: Array) -> Ranges:
    """Return the ranges of the pinion speed [r/min] between neighbouring points at which a condition holds."""
    speeds = np.asarray(scales_of(model).pinion_speed(branch.values))
    pairs = (speeds[i : i + 2] for i in np.flatnonzero(holds[:-1] & holds[1:]))
    return [(float(min(pair)), float(max(pair))) for pair in pairs]


def merged(ranges: Iterable[tuple[float, float]]) -> Ranges:
    """Return the union of ranges as ranges that do not overlap.

    Examples
    --------
    >>> merged([(5.0, 7.0), (1.0, 2.0), (6.0, 9.0)])
    [(1.0, 2.0), (5.0, 9.0)]
    """
    union: Ranges = []
    for low, high in sorted(ranges):
        if union and low <= union[-1][1]:
            union[-1] = union[-1][0], max(union[-1][1], high)
        else:
            union.append((low, high))
    return union


def outside(ranges: Ranges, low: float, high: float) -> Ranges:
    """Return the parts of the range from low to high that are in none of the ranges.

    Examples
    --------
    >>> outside([(1.0, 2.0), (5.0, 9.0)], 0.0, 10.0)
    [(0.0, 1.0), (2.0, 5.0), (9.0, 10.0)]
    """
    gaps, start = [], low
    for a, b in [*ranges, (high, high)]:
        if min(a, high) > start:
            gaps.append((start, min(a, high)))
        start = max(start, b)
    return gaps


def numbers_text(ranges: Ranges) -> str:
    """Return ranges as text."""
    return ", ".join(f"{low:.0f} to {high:.0f}" for low, high in ranges)


def speeds_text(ranges: Ranges) -> str:
    """Return ranges of the speed as text with their unit."""
    return f"{numbers_text(ranges)} r/min"
