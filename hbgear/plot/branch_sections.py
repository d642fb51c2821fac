"""Sections of a curve with the same line style: one impact regime of an element and one stability state."""

from __future__ import annotations

from hbgear.common.arrays import Array
from hbgear.continuation.results.branch import Branch
from hbgear.harmonic.equations.layout import layout_of
from hbgear.plot.style import State, regime_of


def states(branch: Branch, element: int | str) -> list[State]:
    """Return the regime of the element and the stability at each point."""
    known: dict[str, bool | str] = {
        "stable": True, "neutral": True, "unstable": False, "undecided": "undecided",
    }  # fmt: skip
    stable = [known.get(state) for state in branch.stability]
    layout = layout_of(branch)
    return [(regime_of(layout, codes, element), s) for codes, s in zip(branch.regime, stable, strict=True)]


def sections(branch: Branch, element: int | str) -> list[tuple[State, int, int]]:
    """Return sections ``(state, first point, last point)`` of one regime and stability, which share their end points.

    A special point ends a section: the segment after it has the state of its other end.
    """
    each = states(branch, element)
    borders = {point.index for point in branch.special}
    runs = [(each[0], 0, 0)] if len(each) == 1 else []
    for i in range(len(each) - 1):
        state = each[i + 1] if i in borders and i + 1 not in borders else each[i]
        if runs and runs[-1][0] == state:
            runs[-1] = (state, runs[-1][1], i + 1)
        else:
            runs.append((state, i, i + 1))
    return runs


HEADROOM = 4.0
"""Ratio of the upper limit of the axes to the largest bounded amplitude, for a curve that goes to infinity."""


def bounded(branch: Branch, amplitude: Array) -> float:
    """Return the largest amplitude of a branch up to its last special points before it goes to infinity."""
    marks = [point.index for point in branch.special]
    first = min(marks, default=len(branch) - 1) if "first" in branch.asymptotes else 0
    last = max(marks, default=0) if "last" in branch.asymptotes else len(branch) - 1
    return float(amplitude[min(first, last) : max(first, last) + 1].max())
