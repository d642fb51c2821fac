"""Branch switching: trace of the other curve through a special point.

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

from dataclasses import replace
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
    """Trace the branch that leaves another one at a special point.

    At a branch point (BP) the new branch leaves across the traced curve, within the null space of [dR/dX, dR/dp]. At a
    period doubling (PD) the period doubles: the new branch has twice the value of ``nu`` and the corresponding
    harmonics, and leaves along the null vector of the half-integer block.

    At a resonance 1:1 or 1:2 (RI, RII) of a curve of folds or period doublings in two parameters, see `follow`, the new
    branch is the curve of Neimark-Sacker points that begins there. At the end of such a curve it is the curve of folds
    or period doublings. At LPNS, PDNS and NSNS it is the other curve of special points that passes there.

    Parameters
    ----------
    branch : Branch
        Branch with its problem.
    label : str
        Label of a PD or BP of the branch, or of an RI, RII, LPNS, PDNS or NSNS of a curve of special points.
    span : (float, float), optional
        Span of the parameter. The default is the range of the branch. The new branch ends where it leaves the span,
        closes, or meets the old one again.
    side : {1, -1}, optional
        Direction in which the new branch leaves. At a PD both directions give the same motion, shifted by one period.
        A curve of Neimark-Sacker points leaves in one direction only. At its end, 1 is the direction of an increasing
        parameter. The default is 1.
    **options
        Arguments of `trace`.

    Returns
    -------
    Branch
        The new branch.

    Raises
    ------
    TypeError
        If the branch is not a `Branch`, or the label is not a str.
    KeyError
        If the label does not exist.
    ValueError
        If no other branch leaves at the point, or the branch does not have its problem.

    Examples
    --------
    >>> import hbgear as hb
    >>> pair = hb.HarmonicBalance(hb.SpurPair(e=(0.1,)), 5)
    >>> curve = hb.trace(pair, "Omega", (2.1, 1.8))
    >>> doubled = hb.switch(curve, "PD1", steps=hb.StepControl(max_points=6))
    >>> doubled.problem.nu
    2
    """
    branch = replace(branch, problem=branch.continued_problem())
    point = branch[label]
    assert isinstance(point, SpecialPoint)
    if span is None:
        span = (float(branch.values.min()), float(branch.values.max()))
    event = event_of(branch, point)
    departure = event.branch_direction(branch, point, side) if event else None
    if departure is not None:
        problem, start = departure
        return trace(problem, branch.parameter, span, start, **options)
    raise ValueError(
        f"{label} is {article(point.kind)}; no other branch leaves there: choose a PD or BP, or an RI, "
        "RII, LPNS, PDNS or NSNS of a curve in two parameters"
    )
