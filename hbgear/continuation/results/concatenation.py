"""Concatenation of branches."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from hbgear.continuation.results.branch import Branch

_ARRAYS = ("values", "X", "iterations", "residual", "regime", "error", "step", "modulus_error")


def append_continuation(first: Branch, second: Branch) -> Branch:
    """Return a branch and its continuation from its last point, as one branch with status and message of the second.

    Both get the number of harmonics of the larger one, and the result has its problem. Special points are numbered
    consecutively. Jumps are removed and have to be searched again.
    """
    n, problem = len(first), most_resolved(first, second)
    ends = {"first": first.asymptotes.get("first"), "last": second.asymptotes.get("last")}
    first, second = padded_to_common_size(first, second)
    names = list(_ARRAYS)
    if first.multipliers is not None and second.multipliers is not None:
        names.append("multipliers")
    arrays: dict[str, Any] = {name: np.concatenate([getattr(first, name), getattr(second, name)[1:]]) for name in names}
    count: dict[str, int] = {}
    special = []
    for p in (*first.special, *(dataclasses.replace(p, index=n - 1 + p.index) for p in second.special)):
        count[p.kind] = count.get(p.kind, 0) + 1
        special.append(dataclasses.replace(p, label=f"{p.kind}{count[p.kind]}"))
    tracked = {k: np.concatenate([first.tracked[k], x[1:]]) for k, x in second.tracked.items()}
    return dataclasses.replace(
        second,
        **{"multipliers": None, **arrays},
        special=tuple(special),
        jump_records=(),
        tracked=tracked,
        full_motion=None,
        meta=_joined_header(first, second, ends),
        others=first.others,
        problem=problem,
    )


def _joined_header(first: Branch, second: Branch, ends: dict[str, float | None]) -> dict[str, Any]:
    """Return the header of the second part, with the asymptotes of a curve and the larger errors of both parts."""
    meta, errors = with_asymptotes(second.meta, **ends), (first.unknown_errors, second.unknown_errors)
    largest = {
        name: float(np.fmax.reduce([x.get(name, np.nan) for x in errors])) for name in {**errors[0], **errors[1]}
    }
    return meta | ({"unknown_errors": largest} if largest else {})


def concatenate(backward: Branch, forward: Branch) -> Branch:
    """Return two traces that left one point in opposite directions, as one branch to the last point of ``forward``.

    Special points are numbered consecutively. The message states how both traces ended. The status is taken from the
    trace that is not complete, if there is one.
    """
    names = (*_ARRAYS, "multipliers")
    arrays: dict[str, Any] = {name: x[::-1] for name in names if (x := getattr(backward, name)) is not None}
    special = tuple(dataclasses.replace(p, index=len(backward) - 1 - p.index) for p in reversed(backward.special))
    tracked = {k: x[::-1] for k, x in backward.tracked.items()}
    reversed_backward = dataclasses.replace(backward, **arrays, special=special, tracked=tracked)
    joined = append_continuation(reversed_backward, forward)
    worse = backward if not backward.status.complete else forward
    ends = {"first": backward.asymptotes.get("last"), "last": forward.asymptotes.get("last")}
    meta = _joined_header(backward, forward, ends)
    message = f"{forward.message}; the other way {backward.message}"
    return dataclasses.replace(joined, status=worse.status, message=message, meta=meta)


def with_asymptotes(meta: dict[str, Any], **ends: float | None) -> dict[str, Any]:
    """Return the header of a branch with other asymptotes, beyond its "first" and its "last" point."""
    new = {end: value for end, value in ends.items() if value is not None}
    return {name: x for name, x in meta.items() if name != "asymptotes"} | ({"asymptotes": new} if new else {})


def most_resolved(*branches: Branch) -> Any:
    """Return the problem of the last branch with the largest number of unknowns among those with a problem."""
    return max((b for b in reversed(branches) if b.problem is not None), key=lambda b: b.X.shape[1]).problem


def padded_to_common_size(*branches: Branch) -> list[Branch]:
    """Return branches of one model with the number of harmonics of the largest, padded with zeros."""
    largest = max(branches, key=lambda b: b.X.shape[1])
    return [b if b.layout == largest.layout else _padded(b, largest) for b in branches]


def _padded(branch: Branch, like: Branch) -> Branch:
    """Return a branch with the layout of another one, which has more unknowns."""
    layout = like.layout
    pad = like.problem.from_point
    special = tuple(
        p if p.layout != branch.layout else dataclasses.replace(p, X=pad(p), layout=layout) for p in branch.special
    )
    X = np.array([pad(branch[i]) for i in range(len(branch))])
    return dataclasses.replace(branch, X=X, special=special, layout=layout)
