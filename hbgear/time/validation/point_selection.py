"""Points of a curve that are compared with time integration, and the problem of the curve."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from hbgear._version import __version__
from hbgear.common.ranges import counted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.harmonic.autonomous.backbone import BackboneProblem
from hbgear.harmonic.autonomous.limit_cycle import LimitCycleProblem
from hbgear.harmonic.equations.layout import layout_of
from hbgear.harmonic.models.model_registry import is_description, rebuild_problem
from hbgear.mechanics.fields import defaults_of
from hbgear.mechanics.models import describe, differing_fields
from hbgear.mechanics.serialization import to_plain

_MAX_POINTS = 1_000_000
"""Largest number of points [-]; it detects mistaken input."""

_MIN_DISTANCE_FROM_FOLD = 0.02
"""Smallest |mu - 1| [-] of the points selected near a fold; below it the motion at a given frequency is
ill-conditioned."""

_FOLD_ERRORS = 5.0
"""Smallest distance of the points selected near a fold, over its estimated error [-]."""

_MAX_NEIGHBOUR_DISTANCE = 20
"""Largest number of points [-] from a fold to the points selected near it."""

_BRANCH_POINT_TOLERANCE = 1e-3
"""|mu - 1| [-] of a located branch point, see `trace`; motions at its frequency are not isolated."""


def problem_for(branch: Branch, problem: Any = None) -> Any:
    """Return the harmonic balance of a branch: the given one, its own, or one rebuilt from its header.

    ValueError or KeyError is raised if the branch does not contain periodic motions, or the problem does not fit it.
    """
    layout = layout_of(branch)
    if layout is None or "Omega" not in branch.parameters_at(0):
        raise ValueError(
            "only curves of periodic motions with harmonics and a frequency can be validated; give such a curve"
        )
    if "Omega" in branch.tracked:
        raise ValueError(_UNFORCED.get(branch.meta.get("curve", {}).get("of", ""), _SINGULAR))
    version = branch.meta.get("hbgear")
    if version not in (None, __version__):
        text = f"the curve was traced with hbgear {version}, this is {__version__}; differences may result"
        warnings.warn(text, stacklevel=3)
    if problem is None:
        problem = branch.problem or rebuild_problem(branch.meta)
    target = problem.layout
    if (target.elements, target.breakpoints) != (layout.elements, layout.breakpoints):
        raise ValueError(
            f"the curve has elements {layout.elements} with breakpoints {layout.breakpoints}, the model "
            f"{target.elements} with {target.breakpoints}: it was traced with another model; give the problem it was "
            "traced with"
        )
    same_model(branch.meta.get("model"), problem.model)
    if (target.nu, problem.size) != (layout.nu, branch.X.shape[1]):
        problem = problem.with_order(layout.nu, layout.harmonics)
    for name in branch.parameters_at(0):
        problem.check_parameter(name)
    return problem


_SINGULAR = (
    "a curve of special points has singular motions and cannot be validated; validate response curves traced through "
    "them instead"
)
_UNFORCED = {
    BackboneProblem.__name__: "a backbone has no excitation, and a validation integrates over periods of excitation; "
    "validate a response curve of the model instead",
    LimitCycleProblem.__name__: "limit cycles have no excitation, and a validation integrates over periods of "
    "excitation; compare them with a motion of hb.time.integrate that has settled",
}
"""Reasons why curves with an unknown Omega are not validated, by the class of their equations."""


def same_model(stored: Any, model: Any) -> None:
    """Raise ValueError if a model is not the one in the header of a branch; without a header any is accepted."""
    current = describe(model)
    if not stored:
        return
    if not is_description(stored):
        raise ValueError("the curve does not contain its model: trace it again")
    defaults = {name: to_plain(x) for name, x in defaults_of(type(model)).items() if name in current["fields"]}
    added = {"fields": defaults | stored["fields"]}  # fields that are missing in files of earlier versions
    differing = differing_fields({**stored, **added}, current)
    if stored["class"] == current["class"] and not differing:
        return
    difference = (
        f"with other {', '.join(differing)}"
        if stored["class"] == current["class"]
        else f"a {stored['class']}, not {current['class']}"
    )
    raise ValueError(f"the curve was traced with another model ({difference}): give the problem it was traced with")


def choose(branch: Branch, points: int | Sequence[int | str]) -> list[tuple[int, str]]:
    """Select the points of a branch to be compared: index and reason of each point, in the order of the branch.

    The points are a number, or indices and labels of special points. ValueError, IndexError or KeyError is raised if no
    point is given, or a point is not on the branch.
    """
    if isinstance(points, int | np.integer):
        return _selected_points(branch, counted("points", points, _MAX_POINTS))
    selected: dict[int, str] = {}
    for key in points:
        if isinstance(key, str):
            selected.setdefault(branch[key].index, key)  # type: ignore[attr-defined]
        elif not -len(branch) <= key < len(branch):
            raise IndexError(f"point {key} is outside the branch, which has points 0 to {len(branch) - 1}")
        else:
            selected.setdefault(int(key) % len(branch), "selected")
    if not selected:
        raise ValueError("no points to validate; give a number, indices or labels")
    return sorted(selected.items())


def _selected_points(branch: Branch, count: int) -> list[tuple[int, str]]:
    """Return up to 3/4 of the points near special points, the peak and the largest error, and others between."""
    candidates: list[tuple[int, str]] = []
    for point in branch.special:
        if point.kind == "LP":
            candidates += [(_regular_neighbour(branch, point, side), f"near {point.label}") for side in (-1, 1)]
    candidates.append((int(np.nanargmax(branch.amplitude("rms"))), "peak"))
    if not np.isnan(branch.error).all():
        candidates.append((int(np.nanargmax(branch.error)), "worst error"))
    for point in branch.special:
        if point.kind not in ("LP", "CP", "IC", "SL"):
            candidates += [(_clipped_index(branch, point.index + side), f"near {point.label}") for side in (-1, 1)]
    selected: dict[int, str] = {}
    # at these points the motion is singular or its stability changes
    unfit = {p.index for p in branch.special if p.kind in ("LP", "BP", "CP", "IC", "PD", "NS")} | _singular_ends(branch)
    # at first slip the growth of a disturbance is not that of a multiplier: some disturbances slip, others do not
    unfit |= {p.index + side for p in branch.special if p.kind == "SL" for side in (-1, 0, 1)}
    for i, reason in candidates:
        if len(selected) < max(count - count // 4, 1) and i not in selected and i not in unfit:
            selected[i] = reason
    free = [i for i in range(len(branch)) if i not in unfit]
    while len(selected) < min(count, len(free)):
        selected[_farthest_point(branch, free, selected)] = "between"
    return sorted(selected.items())


def _singular_ends(branch: Branch) -> set[int]:
    """Return the indices of the ends that are the branch point at which the branch leaves another branch."""
    if branch.multipliers is None:
        return set()
    return {
        i
        for i in (0, len(branch) - 1)
        if np.abs(branch.multipliers[i] - 1).min(initial=np.inf) <= _BRANCH_POINT_TOLERANCE
    }


def _clipped_index(branch: Branch, i: int) -> int:
    """Return an index limited to the branch."""
    return min(max(i, 0), len(branch) - 1)


def _regular_neighbour(branch: Branch, fold: SpecialPoint, side: int) -> int:
    """Return the index of the first point on one side of a fold that is not nearly singular.

    Within the error of the fold the exact motion may not exist at the value of the point.
    """
    uncertain = _FOLD_ERRORS * fold.error if np.isfinite(fold.error) else 0.0
    fold_value = fold.parameters[branch.parameter]
    for distance in range(1, _MAX_NEIGHBOUR_DISTANCE + 1):
        i = _clipped_index(branch, fold.index + side * distance)
        if abs(branch.values[i] - fold_value) < uncertain:
            continue
        if branch.multipliers is None or np.abs(branch.multipliers[i] - 1).min() > _MIN_DISTANCE_FROM_FOLD:
            return i
    return _clipped_index(branch, fold.index + 2 * side)


def _farthest_point(branch: Branch, free: list[int], selected: dict[int, str]) -> int:
    """Return the index of the point with the largest arclength from the selected points."""
    size = max(float(np.linalg.norm(np.ptp(branch.X, axis=0))), 1e-300)
    span = float(np.ptp(branch.values)) or 1.0
    steps = np.hypot(np.diff(branch.values) / span, np.linalg.norm(np.diff(branch.X, axis=0), axis=1) / size)
    arclength = np.concatenate([[0.0], np.cumsum(steps)])
    distances = [np.abs(arclength[i] - arclength[list(selected)]).min() if selected else -i for i in free]
    return free[int(np.argmax([-1.0 if i in selected else x for i, x in zip(free, distances, strict=True)]))]
