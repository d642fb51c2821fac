"""Stretches of a curve that are drawn alike: of one impact regime of an element, and of one verdict on stability."""

from __future__ import annotations

from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.equations.layout import layout_of
from hbgear.plot.style import State, regime_of


def states(branch: Branch, element: int | str) -> list[State]:
    """Regime of the element and stability of each row."""
    known: dict[str, bool | str] = {"stable": True, "unstable": False, "undecided": "undecided"}
    stable = [known.get(verdict) for verdict in branch.stability]
    layout = layout_of(branch)
    return [(regime_of(layout, codes, element), s) for codes, s in zip(branch.regime, stable, strict=True)]


def stretches(branch: Branch, element: int | str) -> list[tuple[State, int, int]]:
    """Stretches ``(state, first row, last row)`` of one regime and stability; each starts where the last one ended.

    A special point is the border between two stretches: the piece of curve beside it has the state of its other end.
    """
    each = states(branch, element)
    border = {point.index for point in branch.special}
    runs = [(each[0], 0, 0)] if len(each) == 1 else []
    for i in range(len(each) - 1):
        state = each[i + 1] if i in border and i + 1 not in border else each[i]
        if runs and runs[-1][0] == state:
            runs[-1] = (state, runs[-1][1], i + 1)
        else:
            runs.append((state, i, i + 1))
    return runs


ABOVE = 4.0
"""Height of axes over the largest amplitude of what stays bounded, if a curve runs off to infinity."""


def bounded(branch: Branch, amplitude: Array) -> float:
    """The largest amplitude of a branch before it runs off to infinity: up to its last special points on both sides."""
    marks = [point.index for point in branch.special]
    first = min(marks, default=len(branch) - 1) if "first" in branch.asymptotes else 0
    last = max(marks, default=0) if "last" in branch.asymptotes else len(branch) - 1
    return float(amplitude[min(first, last) : max(first, last) + 1].max())
