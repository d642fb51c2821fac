"""Amplitude peaks of a branch, each locate_peaks on the curve."""

from __future__ import annotations

from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.continuation.curve.builder import build_special_point, point_fields
from hbgear.continuation.curve.segment import CurvePoint, Segment, normal_of, point_from_solution
from hbgear.continuation.events.accuracy import estimate_error
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import linearise
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, Solution
from hbgear.harmonic.bifurcations.peak_events import AmplitudePeakEvent
from hbgear.harmonic.equations.layout import check_peaks, layout_of


@checked_arguments()
def peaks(
    branch: Branch, measure: str = "rms", element: int | str = 0, *, share: float = 0.0, accuracy: float | None = 1e-5
) -> tuple[SpecialPoint, ...]:
    """Locate the local maxima of an amplitude along a branch, labelled PK1, PK2, ... in its order.

    Between the neighbours of each highest point the amplitude is maximised along the curve. Newton's method on its
    equations (`AmplitudeExtremum`) then gives full accuracy. A peak can be followed in a second parameter with
    ``follow(branch, peak, "zeta", span)``.

    Parameters
    ----------
    branch : Branch
        A branch that has its problem.
    measure : str, optional
        Measure of the amplitude, see `Branch.amplitude`. The default is "rms".
    element : int or str, optional
        Number or name of the element. The default is the first one.
    share : float, optional
        Peaks whose highest point is below this fraction of the largest amplitude are left out. The default is 0; 0.99
        locates the largest peak without the work for the others.
    accuracy : float or None, optional
        Largest relative error of the frequency of a peak, as in `trace`. The default is 1e-5. With None the peaks are
        those of the equations of the branch, without error estimates.

    Returns
    -------
    tuple of SpecialPoint
        The peaks in the order of the branch.

    Raises
    ------
    ValueError
        If the branch has no problem, or the measure does not exist or was registered with ``peaks=False``.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> top = hb.analysis.peaks(curve, "rms")[0]
    >>> top.label, bool(top.amplitude("rms") >= curve.amplitude("rms").max())
    ('PK1', True)
    """
    tops = locate_peaks(branch, measure, element, share)
    if accuracy is not None:
        tops = [(i, segment, estimate_error(segment, found, accuracy)) for i, segment, found in tops]
    return tuple(_point(branch, i, number, found) for number, (i, _, found) in enumerate(tops, 1))


def locate_peaks(
    branch: Branch, measure: str, element: int | str, share: float
) -> list[tuple[int, Segment, LocatedEvent]]:
    """Locate the peaks of the equations of the branch, each with its highest point and the segment around it."""
    check_peaks("peaks", measure)
    layout = layout_of(branch)
    if branch.problem is None or layout is None:
        raise ValueError("peaks need the problem; load the branch with load(path, problem=HarmonicBalance(...))")
    A = branch.amplitude(measure, element)
    tops = np.flatnonzero((A[:-2] <= A[1:-1]) & (A[1:-1] > A[2:]) & (A[1:-1] >= share * A.max())) + 1
    event = AmplitudePeakEvent(measure, layout.index(element))
    segments = [(i, _segment_around(branch, i)) for i in tops.tolist()]
    return [(i, segment, _peak_on_segment(segment, i, branch, event)) for i, segment in segments]


def _point(branch: Branch, i: int, number: int, found: LocatedEvent) -> SpecialPoint:
    """Return peak number ``number``, located near point i, with its monitored quantities."""
    problem, point = (
        (found.sharp.problem, found.sharp.point) if found.sharp else (as_problem(branch.problem), found.point)
    )
    fixed = {k: v for k, v in branch.parameters_at(i).items() if k != branch.parameter}
    point.observed.update(
        problem.observe(point.X, stability=branch.multipliers is not None, **fixed, **{branch.parameter: point.value})
    )
    known = point_fields(problem, branch.parameter, fixed, point)
    interval = (float(branch.values[i - 1]), float(branch.values[i + 1]))
    known["problem"] = branch.problem
    return build_special_point(found, known, f"PK{number}", i, interval)


def _peak_on_segment(segment: Segment, i: int, branch: Branch, event: AmplitudePeakEvent) -> LocatedEvent:
    """Return the peak near point i; that point, marked as not located, if the peak is not found."""
    try:
        return event.find(segment)[0]
    except (NoConvergence, np.linalg.LinAlgError):
        point = _point_with_tangent(branch, i, segment.scale, segment.b.u - segment.a.u)
        return LocatedEvent(event, 0.5, point, False, f"peak of {event.measure}")


def _segment_around(branch: Branch, i: int) -> Segment:
    """Return the segment between the neighbours of point i."""
    problem: Any = branch.problem
    scale = np.append(
        np.full(branch.X.shape[1], problem.solution_norm(branch.X[i]) or 1.0), np.ptp(branch.values) or 1.0
    )
    direction = np.append(branch.X[i + 1] - branch.X[i - 1], branch.values[i + 1] - branch.values[i - 1])
    fixed = {k: v for k, v in branch.parameters_at(i).items() if k != branch.parameter}
    a, b = (_point_with_tangent(branch, j, scale, direction) for j in (i - 1, i + 1))
    return Segment(problem, branch.parameter, fixed, a, b, scale, NewtonSettings())


def _point_with_tangent(branch: Branch, i: int, scale: Array, along: Array) -> CurvePoint:
    """Return point i of a branch with its tangent."""
    X, value = branch.X[i], float(branch.values[i])
    now = linearise(branch.problem, X, branch.parameter, branch.parameters_at(i))
    return point_from_solution(Solution(X, value, now, int(branch.iterations[i]), float(branch.residual[i])),
                  normal_of(along, scale), scale)  # fmt: skip
