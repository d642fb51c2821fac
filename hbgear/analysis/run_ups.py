"""Run-up and run-down: the stable motions that a slow sweep of the parameter passes, from jump to jump.

On a stable part of a curve the sweep follows it; where that part ends in a fold it jumps, to where `landings` says, and
goes on from there; where it only loses its stability, or a curve of doubled motions ends, it goes on along the nearest
stable motion of the other curves. All of it is read off curves that were traced: nothing is integrated unless their
jumps were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.analysis.jump_landings import Landing, landings, stable_motions
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.point import Jump, Point
from hbgear.continuation.tracing.jumps import nearest
from hbgear.harmonic.equations.layout import layout_of

DIRECTIONS = {"up": 1, "down": -1}
"""Ways of a run, and the sign of the change of the parameter."""

_MOST_JUMPS = 1000


@dataclass(frozen=True, eq=False)
class BranchSection:
    """Rows of a branch that a run passes, in its order; ``landed`` is the motion a jump brought it to before them."""

    branch: Branch
    rows: np.ndarray
    landed: Point | None = None

    @property
    def values(self) -> Array:
        """Of the parameter, that of the landing first."""
        first = [] if self.landed is None else [self.landed.parameters[self.branch.parameter]]
        return np.array([*first, *self.branch.values[self.rows]])

    def amplitude(self, measure: str, element: int | str, derivative: int = 0) -> Array:
        """A measure, for each of the values."""
        rest: Array = self.branch.amplitude(measure, element, derivative=derivative)[self.rows]
        if self.landed is None:
            return rest
        layout = layout_of(self.landed)
        assert layout is not None  # runs are along motions
        row = layout.rows(self.landed.X, element)[None]
        if derivative:
            row = layout.in_time(row, {k: np.array([x]) for k, x in self.landed.parameters.items()}, derivative)
        out: Array = np.concatenate([layout.measure_rows(measure, row), rest])
        return out


@dataclass(frozen=True, eq=False)
class RunUp:
    """What a slow sweep passes.

    Parameters
    ----------
    direction : "up" or "down".
    stretches : the parts of curves in order.
    jumps : where it jumps, in order; the last one may land on no curve known.
    message : where and why the run ends.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    >>> up = hb.analysis.run_up(curve, "up")
    >>> [jump.label for jump in up.jumps], up.message
    (['LP1'], 'Omega = 1.6 reached')
    """

    direction: str
    stretches: tuple[BranchSection, ...]
    jumps: tuple[Jump, ...]
    message: str

    @property
    def parameter(self) -> str:
        """What is swept."""
        return self.stretches[0].branch.parameter

    @property
    def values(self) -> Array:
        """Of the parameter along the run; those of jumps twice."""
        return np.concatenate([stretch.values for stretch in self.stretches])

    @checked_arguments()
    def amplitude(self, measure: str = "rms", element: int | str = 0, derivative: int = 0) -> Array:
        """A measure along the run, one for each of the values; see `Branch.amplitude`."""
        return np.concatenate([stretch.amplitude(measure, element, derivative) for stretch in self.stretches])


@checked_arguments()
def run_up(branch: Branch, direction: str = "up", others: Sequence[Branch] = ()) -> RunUp:
    """The run-up or run-down along a curve and others.

    It begins at the stable motion of the curve with the lowest value of the parameter (the highest, down), and ends
    where curves end, or where a jump lands on none of them.

    Parameters
    ----------
    branch : a curve with stability, of periodic motions.
    direction : "up" or "down".
    others : further curves that jumps may land on; those of its span (`Branch.others`) are among them anyway.

    Raises
    ------
    ValueError
        If there is no such direction, the stability is not known or nothing is stable.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 10), "Omega", (1.5, 0.6))
    >>> for way in ("up", "down"):
    ...     print(way, [f"{jump.value:.4f}" for jump in hb.analysis.run_up(curve, way).jumps])
    up ['0.8285']
    down ['0.7080']
    """
    if direction not in DIRECTIONS:
        raise ValueError(f"direction = {quoted(direction)} must be 'up' or 'down'")
    branches = (branch, *branch.others, *others)
    if layout_of(branch) is None or any(one.stable is None for one in branches):
        raise ValueError("a run needs curves of motions whose stability is known; trace with stability=True")
    way, stable = DIRECTIONS[direction], np.flatnonzero(np.asarray(branch.stable))
    if not stable.size:
        raise ValueError("no motion of the curve is stable, so that no sweep follows it")
    at, row, landed = 0, int(stable[np.argmin(way * branch.values[stable])]), None
    found = landings(branches)
    stretches: list[BranchSection] = []
    jumps: list[Jump] = []
    for _ in range(_MOST_JUMPS):
        rows, landing, message = _follow(branches[at], row, way, found[at])
        stretches.append(BranchSection(branches[at], rows, landed))
        if landing is None:
            value = float(_ahead(branches[at].values, rows, way))
            known = stable_motions(branches, at, value)
            landed = nearest(branches[at][int(rows[-1])], [point for point, _ in known])
            if landed is None:
                return RunUp(direction, tuple(stretches), tuple(jumps), message)
            at = next(i for point, i in known if point is landed)
            row = _beyond(branches[at], landed, value, way)
            continue
        jumps.append(landing.jump)
        after = landing.jump.after
        if after is None or landing.branch is None:
            message = f"jump at {landing.jump.label} to a motion that is on none of the curves"
            return RunUp(direction, tuple(stretches), tuple(jumps), message)
        at, landed = landing.branch, after
        row = _beyond(branches[at], after, landing.jump.value, way)
    return RunUp(direction, tuple(stretches), tuple(jumps), f"{_MOST_JUMPS} jumps: the run is given up")


def _follow(branch: Branch, row: int, way: int, found: Sequence[Landing]) -> tuple[np.ndarray, Landing | None, str]:
    """Rows of a branch from one on while the parameter goes the given way, the jump that ends them, or why they end."""
    leaving: dict[int, Landing] = {}
    for landing in found:
        before: Any = landing.jump.before
        if landing.jump.direction == way:
            leaving[before.index] = landing
    marks = {point.index: point.label for point in branch.special}
    values, stable = branch.values, branch.stable
    assert stable is not None
    ahead = [s for s in (1, -1) if 0 <= row + s < len(values) and (values[row + s] - values[row]) * way > 0]
    rows = [row]
    step = next((s for s in ahead if stable[row + s]), 0)
    while row not in leaving:
        after = row + step
        if not step or not 0 <= after < len(values):
            return np.array(rows), None, f"{branch.parameter} = {values[row]:.6g} reached"
        turned, lost = (values[after] - values[row]) * way <= 0, not stable[after]
        if (turned or lost) and not any(abs(i - row) <= _NEAR for i in leaving):
            place = marks.get(row, f"{branch.parameter} = {values[row]:.6g}")
            return np.array(rows), None, f"the motion loses its stability at {place}, and no curve goes on from there"
        row = after
        rows.append(row)
    return np.array(rows), leaving[row], ""


def _ahead(values: Array, rows: np.ndarray, way: int) -> float:
    """A value of the parameter just beyond the last of these rows."""
    last = int(rows[-1])
    beside = [abs(values[i] - values[last]) for i in (last - 1, last + 1) if 0 <= i < len(values)]
    return float(values[last] + way * max(beside, default=0.0))


_NEAR = 4  # rows beside a fold whose verdict may be that of the other side


def _beyond(branch: Branch, landed: Point, value: float, way: int) -> int:
    """The row of a branch next to the motion landed on, on the way of the run."""
    layout, own = layout_of(branch), layout_of(landed)
    assert layout is not None and own is not None
    places = crossings_at(branch, value)
    near = min(places, key=lambda place: layout.distance(place.interpolate(branch.X), own, landed.X))
    ends = [i for i in (near.index, near.index + 1) if (branch.values[i] - value) * way > 0]
    return ends[0] if ends else near.nearest
