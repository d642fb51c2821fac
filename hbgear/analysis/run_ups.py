"""Run-up and run-down: the stable motions of a slow sweep of the parameter, with its jumps.

The sweep follows a stable section of a branch. At a fold it jumps to the motion that `landings` returns and continues
there. Where a section ends without a fold, for example at a period doubling, the sweep continues on the nearest stable
motion of the other branches. Only traced branches are evaluated; landings are integrated in time only if the jumps of
the branches are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hbgear.analysis.jump_landings import Landing, landings, stable_motions
from hbgear.analysis.quantities.engineering_quantities import with_known_problem
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.results.point import Jump, Point
from hbgear.continuation.switch import switch
from hbgear.continuation.tracing.jumps import nearest
from hbgear.harmonic.equations.layout import layout_of

DIRECTIONS = {"up": 1, "down": -1}
"""Names of the directions of a sweep, with the sign of the change of the parameter."""

_MAX_JUMPS = 1000
"""Number of jumps after which a run-up is stopped; prevents an endless loop between sections."""

_MAX_DOUBLING_OFFSET = 3
"""Largest number of points between the last stable point and the period doubling at which stability is lost."""

_MAX_FOLD_OFFSET = 4
"""Number of points next to a fold whose stability may be that of the other side of the fold."""


@dataclass(frozen=True, eq=False)
class BranchSection:
    """Section of a branch that a slow sweep follows, with the numbers of its points in the order of the sweep.

    ``landed`` is the motion on which the sweep landed before the first of these points; None if it did not jump there.
    """

    branch: Branch
    points: np.ndarray
    landed: Point | None = None

    @property
    def values(self) -> Array:
        """Values of the parameter; the first one is the landing, if there is one."""
        first = [] if self.landed is None else [self.landed.parameters[self.branch.parameter]]
        return np.array([*first, *self.branch.values[self.points]])

    def amplitude(self, measure: str, element: int | str, derivative: int = 0) -> Array:
        """Return a measure of amplitude of each motion of the section; see `Branch.amplitude`."""
        rest = self.branch.amplitude(measure, element, derivative=derivative)[self.points]
        if self.landed is None:
            return rest
        layout = layout_of(self.landed)
        assert layout is not None  # `run_up` accepts branches of periodic motions only
        row = layout.rows(self.landed.X, element)[None]
        if derivative:
            row = layout.in_time(row, {k: np.array([x]) for k, x in self.landed.parameters.items()}, derivative)
        return np.concatenate([layout.measure_rows(measure, row), rest])


@dataclass(frozen=True, eq=False)
class RunUp:
    """Motions and jumps of a slow sweep.

    Attributes
    ----------
    direction : {"up", "down"}
        Direction of the sweep.
    sections : tuple of BranchSection
        Stable sections of branches in the order of the sweep.
    jumps : tuple of Jump
        Jumps in the order of the sweep. The last one may land on none of the branches.
    message : str
        Position and reason of the end of the sweep.

    Examples
    --------
    >>> import hbgear as hb
    >>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
    >>> up = hb.analysis.run_up(curve, "up")
    >>> [jump.label for jump in up.jumps], up.message
    (['LP1'], 'Omega = 1.6 reached')
    """

    direction: str
    sections: tuple[BranchSection, ...]
    jumps: tuple[Jump, ...]
    message: str

    def __repr__(self) -> str:
        jumps = "".join(f", {jump.label} at {jump.value:.6g}" for jump in self.jumps) or ", no jumps"
        return f"<RunUp {self.direction} in {self.parameter}{jumps}; {self.message}>"

    @property
    def parameter(self) -> str:
        """Name of the parameter of the sweep."""
        return self.sections[0].branch.parameter

    @property
    def values(self) -> Array:
        """Values of the parameter along the sweep; the value of a jump occurs twice."""
        return np.concatenate([section.values for section in self.sections])

    @checked_arguments()
    def amplitude(self, measure: str = "rms", element: int | str = 0, derivative: int = 0) -> Array:
        """Return a measure of amplitude along the sweep, for each of the values.

        Parameters
        ----------
        measure : str, optional
            Measure of amplitude, see `Branch.amplitude`. The default is "rms".
        element : int or str, optional
            Element by number or name. The default is 0.
        derivative : int, optional
            Order of the derivative in time. The default is 0.

        Returns
        -------
        ndarray
            Amplitude of each motion of the sweep.
        """
        return np.concatenate([section.amplitude(measure, element, derivative) for section in self.sections])


@checked_arguments()
def run_up(branch: Branch, direction: str = "up", others: Sequence[Branch] = (), doublings: int = 0) -> RunUp:
    """Return the run-up or run-down along a branch and others.

    The sweep starts at the stable motion of `Branch.curves` with the lowest value of the parameter (the highest one for
    a run-down). It ends at the end of the last branch, or at a jump that lands on none of the branches.

    Parameters
    ----------
    branch : Branch
        Branch of periodic motions with stability.
    direction : {"up", "down"}, optional
        Direction of the sweep. The default is "up".
    others : sequence of Branch, optional
        Further branches on which jumps may land, in addition to `Branch.others`.
    doublings : int, optional
        Number of period doublings at which the motions of twice the period are traced and followed, if the sweep loses
        its stability there. The default is 0.

    Returns
    -------
    RunUp
        Sections, jumps and the reason of the end.

    Raises
    ------
    ValueError
        If the direction is unknown, the stability is unknown, or no motion of the branch is stable.

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
    branches = tuple(map(with_known_problem, (*branch.curves, *others)))
    if layout_of(branch) is None or any(curve.stable is None for curve in branches):
        raise ValueError("a run-up needs branches of motions with known stability; trace them with stability=True")
    sign, start_motion = DIRECTIONS[direction], None
    starts = [
        (sign * curve.values[i], number, i)
        for number, curve in enumerate(branches[: len(branch.curves)])
        for i in np.flatnonzero(np.asarray(curve.stable)).tolist()
    ]
    if not starts:
        raise ValueError("no motion of the branch is stable, so no sweep follows it; give a branch with stable points")
    _, current, first = min(starts)
    sweep = _SweepBranches(branches, (float(branch.values.min()), float(branch.values.max())), doublings)
    sections: list[BranchSection] = []
    jumps: list[Jump] = []
    for _ in range(_MAX_JUMPS):
        points, landing, message = _follow_section(sweep.branches[current], first, sign, sweep.landings[current])
        sections.append(BranchSection(sweep.branches[current], points, start_motion))
        if landing is None:
            continuation = sweep.next_branch(current, points, sign)
            if continuation is None:
                return RunUp(direction, tuple(sections), tuple(jumps), message)
            current, first, start_motion = continuation
            continue
        jumps.append(landing.jump)
        after = landing.jump.after
        if after is None or landing.branch is None:
            message = f"jump at {landing.jump.label} to a motion that is on none of the branches"
            return RunUp(direction, tuple(sections), tuple(jumps), message)
        current, start_motion = landing.branch, after
        first = _first_point_beyond(sweep.branches[current], after, landing.jump.value, sign)
    return RunUp(direction, tuple(sections), tuple(jumps), f"stopped after {_MAX_JUMPS} jumps")


class _SweepBranches:
    """Branches that a sweep may follow, with their jumps; period doublings add further ones."""

    def __init__(self, branches: tuple[Branch, ...], span: tuple[float, float], doublings: int) -> None:
        self.branches, self.span, self.doublings = branches, span, doublings
        self.landings = landings(branches)

    def next_branch(self, number: int, points: np.ndarray, sign: int) -> tuple[int, int, Point] | None:
        """Return branch, point and motion on which a sweep continues that ends at the last of these points, if any."""
        branch, last = self.branches[number], int(points[-1])
        value = float(_value_beyond(branch.values, points, sign))
        successor = self._nearest(number, last, value, sign)
        doubled = _doubled(branch, last, self.span) if successor is None and self.doublings > 0 else None
        if doubled is None:
            return successor
        self.branches, self.doublings = (*self.branches, doubled), self.doublings - 1
        self.landings = landings(self.branches)
        start = _first_stable(doubled, branch.values[last], sign)
        if start is not None:
            return len(self.branches) - 1, start, doubled[start]
        return self._nearest(number, last, value, sign)  # a subcritical doubling: the sweep jumps

    def _nearest(self, number: int, last: int, value: float, sign: int) -> tuple[int, int, Point] | None:
        """Return the nearest stable motion at a value on another branch."""
        motions = stable_motions(self.branches, number, value)
        motion = nearest(self.branches[number][last], [point for point, _ in motions])
        if motion is None:
            return None
        other_number = next(i for point, i in motions if point is motion)
        return other_number, _first_point_beyond(self.branches[other_number], motion, value, sign), motion


def _follow_section(
    branch: Branch, first: int, sign: int, section_landings: Sequence[Landing]
) -> tuple[np.ndarray, Landing | None, str]:
    """Return the points of a stable section from its first one, the jump at its end or None, and a message if None."""
    departures: dict[int, Landing] = {}
    for landing in section_landings:
        before: Any = landing.jump.before
        if landing.jump.direction == sign:
            departures[before.index] = landing
    labels = {point.index: point.label for point in branch.special}
    values, stable = branch.values, branch.stable
    assert stable is not None
    last = first
    directions = [s for s in (1, -1) if 0 <= last + s < len(values) and (values[last + s] - values[last]) * sign > 0]
    points = [last]
    step = next((s for s in directions if stable[last + s]), 0)
    while last not in departures:
        after = last + step
        if not step or not 0 <= after < len(values):
            return np.array(points), None, f"{branch.parameter} = {values[last]:.6g} reached"
        reverses, is_unstable = (values[after] - values[last]) * sign <= 0, not stable[after]
        if (reverses or is_unstable) and not any(abs(i - last) <= _MAX_FOLD_OFFSET for i in departures):
            label = labels.get(last, f"{branch.parameter} = {values[last]:.6g}")
            hint = f"; hb.switch(curve, '{label}') traces one of twice the period" if label.startswith("PD") else ""
            text = f"the motion loses its stability at {label}, and none of the branches continues there{hint}"
            return np.array(points), None, text
        last = after
        points.append(last)
    return np.array(points), departures[last], ""


def _doubled(branch: Branch, last: int, span: tuple[float, float]) -> Branch | None:
    """Return the branch of twice the period that leaves next to a point; None without a period doubling there."""
    doublings = [p for p in branch.special if p.kind == "PD" and abs(p.index - last) <= _MAX_DOUBLING_OFFSET]
    point = min(doublings, key=lambda p: abs(p.index - last), default=None)
    return None if point is None else switch(branch, point.label, span)


def _first_stable(branch: Branch, value: float, sign: int) -> int | None:
    """Return the number of the first stable point of a new branch if it lies beyond a value; None if it does not."""
    stable = np.flatnonzero(np.asarray(branch.stable, bool))
    first = int(stable[0]) if stable.size else None
    return first if first is not None and (branch.values[first] - value) * sign > 0 else None


def _value_beyond(values: Array, points: np.ndarray, sign: int) -> float:
    """Return a value of the parameter beyond the last of these points, by the larger of the adjacent steps."""
    last = int(points[-1])
    steps = [abs(values[i] - values[last]) for i in (last - 1, last + 1) if 0 <= i < len(values)]
    return float(values[last] + sign * max(steps, default=0.0))


def _first_point_beyond(branch: Branch, motion: Point, value: float, sign: int) -> int:
    """Return the number of the point of a branch next to a landing, in the direction of the sweep."""
    layout, source = layout_of(branch), layout_of(motion)
    assert layout is not None and source is not None
    crossings = crossings_at(branch, value)
    closest = min(crossings, key=lambda crossing: layout.distance(crossing.interpolate(branch.X), source, motion.X))
    ends = [i for i in (closest.index, closest.index + 1) if (branch.values[i] - value) * sign > 0]
    return ends[0] if ends else closest.nearest
