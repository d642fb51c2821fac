"""Branch switching: onto the other curve that passes a special point.

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

from typing import Any

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.text.messages import article
from hbgear.continuation.events.detector import event_of
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.tracing.trace import trace


@checked_arguments(label="the label of a PD or BP of the branch, such as 'PD1'")
def switch(
    branch: Branch, label: str, span: tuple[float, float] | None = None, *, side: int = 1, **options: Any
) -> Branch:
    """Trace the branch that crosses another one at a special point.

    At BP it leaves across the traced curve, within the null space of [dR/dX, dR/dp]. At PD the motion takes twice the
    period: the new branch has ``nu`` doubled and the harmonics to match, and leaves along the null vector of the
    half-integer block.

    Parameters
    ----------
    branch : a branch that still knows its problem.
    label : a point on it at which another branch leaves: PD or BP.
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
        If no other branch leaves there, or the branch has lost its problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 5)
    >>> curve = hb.trace(pair, "Omega", (2.1, 1.8))
    >>> doubled = hb.switch(curve, "PD1", steps=hb.StepControl(max_points=6))
    >>> doubled.problem.nu
    2
    """
    point = branch[label]
    assert isinstance(point, SpecialPoint)
    if branch.problem is None:
        raise ValueError("switching needs the problem; load the branch with load(path, problem=HarmonicBalance(...))")
    if span is None:
        span = (float(branch.values.min()), float(branch.values.max()))
    event = event_of(branch, point)
    left = event.branch_direction(branch, point, side) if event else None
    if left is not None:
        problem, start = left
        return trace(problem, branch.parameter, span, start, **options)
    raise ValueError(f"{label} is {article(point.kind)}; no other branch leaves there: choose a PD or BP")
