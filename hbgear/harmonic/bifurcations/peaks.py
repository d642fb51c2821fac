"""Amplitude peaks of a branch, each located on the curve."""

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
from hbgear.harmonic.bifurcations.events import AmplitudePeakEvent
from hbgear.harmonic.equations.layout import layout_of


@checked_arguments()
def peaks(
    branch: Branch, measure: str = "rms", element: int | str = 0, *, share: float = 0.0, accuracy: float | None = 1e-5
) -> tuple[SpecialPoint, ...]:
    """Local maxima of an amplitude along a branch, in its order, labelled PK1, PK2, ...

    Between the neighbours of each highest row the amplitude is maximised along the curve; Newton on its equations
    (`AmplitudeExtremum`) then gives all digits, and the point can be followed in a second parameter with
    ``follow(branch, peak, "zeta", span)``.

    Parameters
    ----------
    branch : a branch that still knows its problem.
    measure, element : see `Branch.amplitude`.
    share : peaks whose highest row is below this share of the highest of all are left out; 0.99 finds the largest peak
        without the work for the others.
    accuracy : as of `trace`: largest relative error of the frequency of a peak; None for the peaks of the branch's own
        equations, without errors.

    Raises
    ------
    ValueError
        If the branch has lost its problem, or there is no such measure.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> top = hb.analysis.peaks(curve, "rms")[0]
    >>> top.label, bool(top.amplitude("rms") >= curve.amplitude("rms").max())
    ('PK1', True)
    """
    tops = located(branch, measure, element, share)
    if accuracy is not None:
        tops = [(i, arc, estimate_error(arc, found, accuracy)) for i, arc, found in tops]
    return tuple(_point(branch, i, number, found) for number, (i, _, found) in enumerate(tops, 1))


def located(branch: Branch, measure: str, element: int | str, share: float) -> list[tuple[int, Segment, LocatedEvent]]:
    """`peaks` of the branch's own equations, with the highest row and the piece between its neighbours."""
    layout = layout_of(branch)
    if branch.problem is None or layout is None:
        raise ValueError("peaks need the problem; load the branch with load(path, problem=HarmonicBalance(...))")
    A = branch.amplitude(measure, element)
    tops = np.flatnonzero((A[:-2] <= A[1:-1]) & (A[1:-1] > A[2:]) & (A[1:-1] >= share * A.max())) + 1
    event = AmplitudePeakEvent(measure, layout.index(element))
    arcs = [(i, _arc(branch, i)) for i in tops.tolist()]
    return [(i, arc, _on(arc, i, branch, event)) for i, arc in arcs]


def _point(branch: Branch, i: int, number: int, found: LocatedEvent) -> SpecialPoint:
    """Peak number ``number``, found near row i, with what its problem says of it."""
    problem, row = (found.sharp.problem, found.sharp.row) if found.sharp else (as_problem(branch.problem), found.row)
    fixed = {k: v for k, v in branch.parameters_at(i).items() if k != branch.parameter}
    row.observed.update(
        problem.observe(row.X, stability=branch.multipliers is not None, **fixed, **{branch.parameter: row.value})
    )
    known = point_fields(problem, branch.parameter, fixed, row)
    interval = (float(branch.values[i - 1]), float(branch.values[i + 1]))
    known["problem"] = branch.problem
    return build_special_point(found, known, f"PK{number}", i, interval)


def _on(arc: Segment, i: int, branch: Branch, event: AmplitudePeakEvent) -> LocatedEvent:
    """The peak near row i; that row, not located, if it cannot be found."""
    try:
        return event.find(arc)[0]
    except (NoConvergence, np.linalg.LinAlgError):
        row = _row(branch, i, arc.scale, arc.b.u - arc.a.u)
        return LocatedEvent(event, 0.5, row, False, f"peak of {event.measure}")


def _arc(branch: Branch, i: int) -> Segment:
    problem: Any = branch.problem
    scale = np.append(
        np.full(branch.X.shape[1], problem.solution_norm(branch.X[i]) or 1.0), np.ptp(branch.values) or 1.0
    )
    chord = np.append(branch.X[i + 1] - branch.X[i - 1], branch.values[i + 1] - branch.values[i - 1])
    fixed = {k: v for k, v in branch.parameters_at(i).items() if k != branch.parameter}
    a, b = (_row(branch, j, scale, chord) for j in (i - 1, i + 1))
    return Segment(problem, branch.parameter, fixed, a, b, scale, NewtonSettings())


def _row(branch: Branch, i: int, scale: Array, along: Array) -> CurvePoint:
    """Row i of a branch with its tangent."""
    X, value = branch.X[i], float(branch.values[i])
    now = linearise(branch.problem, X, branch.parameter, branch.parameters_at(i))
    return point_from_solution(Solution(X, value, now, int(branch.iterations[i]), float(branch.residual[i])),
                  normal_of(along, scale), scale)  # fmt: skip
