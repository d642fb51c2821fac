"""Reliability of a branch: warnings about errors, undecided stability and contradictions.

A branch changes its stability only at a fold, a branch point, a period doubling or a Neimark-Sacker point, or where a
contact begins at all phases at once, as all around a circular whirl: the multipliers jump there. The two sides of a
fold are never both stable, because one real multiplier passes +1 there, unless the fold is a branch point: a pair of
motions without the symmetry of the system turns there. A contradiction to these rules indicates a wrong multiplier, or
a special point that was not detected.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hbgear.common.arrays import Array, ComplexArray
from hbgear.continuation.results.branch_data import BranchData
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.stability import (
    STABILITY_CHANGING_KINDS,
    STABILITY_TOLERANCE,
    STABLE,
    UNDECIDED,
    UNSTABLE,
)

MAX_RELATIVE_ERROR = 1e-2
"""Relative error of a solution above which a branch is not accurate enough for engineering use (1 percent)."""


def branch_warnings(branch: BranchData) -> tuple[str, ...]:
    """Return one sentence for each reason why a branch is not reliable everywhere; see `Branch.warnings`."""
    out = [*_inaccurate_special_points(branch), *_undecided_points(branch)]
    if (
        branch.stable is not None
        and len(branch)
        and not {"stable", "neutral"} & set(branch.stability)
        and "unstable" in branch.stability
    ):
        out.append(
            "no point of the curve is stable: a machine does not stay on it; trace from another start, or search "
            "other curves with hb.trace_all"
        )
    out += _contradictions(branch)
    if branch.relative_error > MAX_RELATIVE_ERROR:
        value = branch.values[int(np.nanargmax(branch.error))]
        at = f"{branch.relative_error:.0e}, at {branch.parameter} = {value:.6g}"
        if "discretisation" in branch.meta:  # contact instants: X are exact coefficients up to H
            out.append(
                f"the harmonics that are not stored are up to {at}; special points and stability are exact, measures "
                "and figures have this error"
            )
        else:
            out.append(f"the relative error of motions is up to {at}; trace with more harmonics")
    out += [
        f"the relative error of {name} is up to {error:.0e}; trace with more harmonics"
        for name, error in branch.unknown_errors.items()
        if error > MAX_RELATIVE_ERROR
    ]
    return tuple(out)


_SMALLEST_SIZE = 1e-3
"""Size of a parameter at a special point, relative to its largest value on the curve; a value near zero is no size."""


def special_point_size(branch: BranchData, point: SpecialPoint) -> float:
    """Return the size of the parameter at a special point, to which its relative error refers."""
    smallest = _SMALLEST_SIZE * float(np.abs(branch.values).max(initial=0.0))
    return max(abs(point.parameters[branch.parameter]), smallest) or 1.0


def _inaccurate_special_points(branch: BranchData) -> list[str]:
    """Return a warning if errors of special points are unknown or larger than twice the accuracy of the trace."""
    accuracy = branch.meta.get("trace", {}).get("accuracy") or math.inf
    with_errors = math.isfinite(accuracy) and bool(np.isfinite(branch.error).any())
    labels = []
    for point in branch.special:
        limit = 2 * accuracy * special_point_size(branch, point)
        inaccurate = with_errors if math.isnan(point.error) else point.error > limit
        if not point.located or inaccurate:
            labels.append(point.label)
    return [f"{', '.join(labels)} not known to the accuracy of {accuracy:g}"] if labels else []


def _undecided_points(branch: BranchData) -> list[str]:
    """Return a warning if the stability of points is undecided."""
    undecided = np.flatnonzero(branch.undecided)
    if not undecided.size:
        return []
    low, high, name = branch.values[undecided].min(), branch.values[undecided].max(), branch.parameter
    if undecided.size == 1:
        return [f"stability undecided at 1 point, {name} = {low:.6g}"]
    return [f"stability undecided at {undecided.size} points from {name} = {low:.6g} to {name} = {high:.6g}"]


START_DISTANCE = 1e-3
"""Distance of a multiplier from +1 up to which the first point of a branch is a special point, within truncation."""


def _contradictions(branch: BranchData) -> list[str]:
    """Return a warning for each contradiction between the special points and the stability of the points."""
    settings = branch.meta.get("trace", {})
    if branch.multipliers is None or not settings.get("special", True):
        return []
    kinds: dict[int, list[str]] = {}
    for point in branch.special:  # an end point EP lies on both branches, and has their multipliers
        if point.kind in (*STABILITY_CHANGING_KINDS, "EP") or point.at_all_phases:
            kinds.setdefault(point.index, []).append(point.kind)
    at_limit = np.abs(branch.multipliers[0] - 1.0).min(initial=math.inf) < START_DISTANCE
    if at_limit or settings.get("bifurcating"):
        kinds.setdefault(0, [])  # a branch begins at a special point of another one
    name, codes = branch.parameter, branch.stability_codes
    codes = np.where(_in_family(branch.values, branch.multipliers), UNDECIDED, codes)
    out = [
        f"stability changes between {name} = {branch.values[a]:.9g} and {name} = {branch.values[b]:.9g} without a "
        "special point"
        for a, b in unexplained_changes(codes, kinds)
        if not any(_is_displaced_between(branch, point, a, b) for point in branch.special)
    ]
    folds = {point.index: point.label for point in branch.special if point.kind == "LP"}
    stable_folds = [folds[i] for i in stable_on_both_sides(codes, kinds)]
    return out + ([f"both sides of {', '.join(stable_folds)} are stable"] if stable_folds else [])


_SAME_VALUE = 1e-12
"""Relative difference of two values of the parameter that is rounding error."""


def _in_family(values: Array, multipliers: ComplexArray) -> NDArray[np.bool_]:
    """Return which points belong to a family at one value of the parameter, with a multiplier +1.

    Motions of twice the period in a linear regime have any amplitude at the period doubling. Their stability is
    neutral, and the curve has a corner where it meets the family.
    """
    same = np.abs(np.diff(values)) <= _SAME_VALUE * np.abs(values[1:])
    is_vertical = np.append(same, False) | np.append(False, same)
    distance = np.abs(multipliers - 1.0).min(axis=1, initial=math.inf)
    return is_vertical & (distance < STABILITY_TOLERANCE)


def _is_displaced_between(branch: BranchData, point: SpecialPoint, a: int, b: int) -> bool:
    """Return whether a special point, located with more harmonics than its row, lies between points a and b.

    The parameter must be monotone from the row of the special point to both points.
    """
    if point.kind not in STABILITY_CHANGING_KINDS:
        return False
    steps = np.diff(branch.values[min(point.index, a) : max(point.index, b) + 1])
    value, (low, high) = point.parameters[branch.parameter], sorted((branch.values[a], branch.values[b]))
    return bool((np.all(steps >= 0) or np.all(steps <= 0)) and low <= value <= high)


def unexplained_changes(codes: NDArray[np.int_], kinds: Mapping[int, Sequence[str]]) -> list[tuple[int, int]]:
    """Return pairs of neighbouring points of different stability without a special point between them.

    ``codes`` are the stability codes (P,), ``kinds`` the kinds of special points at which stability can change, by the
    number of their point. Undecided points are not compared. Special points, whose critical multiplier lies on the unit
    circle, are not compared either.

    Examples
    --------
    >>> unexplained_changes(np.array([1, 1, 0, 0]), {})
    [(1, 2)]
    >>> unexplained_changes(np.array([1, 1, 0, 0]), {1: ["LP"]})
    []
    """
    return [(a, b) for a, b in _compared_pairs(codes, kinds) if codes[a] != codes[b] and not _between(a, b, kinds)]


def stable_on_both_sides(codes: NDArray[np.int_], kinds: Mapping[int, Sequence[str]]) -> list[int]:
    """Return the numbers of the folds with stable points on both sides; see `unexplained_changes`.

    Examples
    --------
    >>> stable_on_both_sides(np.array([1, 1, 1]), {1: ["LP"]})
    [1]
    """
    out = []
    for a, b in _compared_pairs(codes, kinds):
        special = _between(a, b, kinds)
        if codes[a] == codes[b] == STABLE and len(special) == 1 and list(kinds[special[0]]) == ["LP"]:
            out.append(special[0])
    return out


def _compared_pairs(codes: NDArray[np.int_], kinds: Mapping[int, Sequence[str]]) -> Iterator[tuple[int, int]]:
    """Yield pairs of stable or unstable points that are separated by special points only."""
    last: int | None = None
    for i, code in enumerate(codes.tolist()):
        if i in kinds:
            continue
        determined = code in (UNSTABLE, STABLE)
        if determined and last is not None:
            yield last, i
        last = i if determined else None


def _between(a: int, b: int, kinds: Mapping[int, Sequence[str]]) -> list[int]:
    """Return the special points from point a to point b. A point that was not located has the previous number."""
    return [i for i in range(a, b + 1) if i in kinds]
