"""Branch switching: onto the doubled motion at PD, onto the crossing curve at BP."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from hbgear.common.given import article, given, need
from hbgear.continuation.branch import Branch, SpecialPoint
from hbgear.continuation.problem import linearise
from hbgear.continuation.segment import Departure
from hbgear.continuation.tracer import trace
from hbgear.harmonic.special import PeriodDoubling


def switch(
    branch: Branch, label: str, span: tuple[float, float] | None = None, *, side: int = 1, **options: Any
) -> Branch:
    """Trace the branch that crosses another one at a special point.

    At PD the motion takes twice the period: the new branch has ``nu`` doubled and the harmonics to match, and leaves
    along the null vector of the half-integer block. At BP it leaves across the traced curve, within the null space
    of [dR/dX, dR/dp].

    Parameters
    ----------
    branch : a branch that still knows its problem.
    label : a PD or BP on it.
    span : of the parameter; by default the range of the branch. The new branch ends where it leaves the span,
        closes, or joins the old one again.
    side : +1 or -1, the direction in which to leave. At PD both give the same motion, one period apart.
    options : passed to `trace`.

    Raises
    ------
    TypeError
        If it is no branch, or the label is no text.
    KeyError
        If there is no such label.
    ValueError
        If it is no PD or BP, or the branch has lost its problem.
    """
    need("switch(branch)", branch, "Branch")
    if not isinstance(label, str):
        raise TypeError(f"label: got {given(label)}; need the label of a PD or BP of the branch, such as 'PD1'")
    point = branch[label]
    assert isinstance(point, SpecialPoint)
    if branch.problem is None:
        raise ValueError("switching needs the problem; load the branch with load(path, problem=HarmonicBalance(...))")
    if span is None:
        span = (float(branch.values.min()), float(branch.values.max()))
    if point.kind == "PD":
        doubling = PeriodDoubling(branch.problem, branch.parameter)
        direction = np.append(side * doubling.null_vector(point.X, **point.parameters), 0.0)
        start = Departure(doubling.embed(point.X), dict(point.parameters), direction)
        return trace(doubling.doubled, branch.parameter, span, start, **options)
    if point.kind == "BP":
        start = Departure(point.X, dict(point.parameters), side * _across(branch, point))
        return trace(branch.problem, branch.parameter, span, start, **options)
    raise ValueError(f"{label} is {article(point.kind)}; no other branch leaves there: choose a PD or BP")


def _across(branch: Branch, point: SpecialPoint) -> np.ndarray:
    """Direction in the null space of [dR/dX, dR/dp] at right angles to the traced curve, in scaled unknowns."""
    now = linearise(branch.problem, point.X, branch.parameter, point.parameters)
    size = getattr(branch.problem, "motion_size", np.linalg.norm)
    scale = np.append(np.full(len(point.X), float(size(point.X)) or 1.0), np.ptp(branch.values) or 1.0)
    null = scipy.linalg.svd(np.column_stack([now.dR_dX, now.dR_dp]) * scale)[2][-2:]
    i = point.index
    before, after = max(i - 1, 0), min(i + 1, len(branch) - 1)
    along = np.append(branch.X[after] - branch.X[before], branch.values[after] - branch.values[before]) / scale
    inside = null @ along
    inside = inside / np.linalg.norm(inside)
    return scale * (np.array([-inside[1], inside[0]]) @ null)
