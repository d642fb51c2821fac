"""How accurate special points are: what more unknowns would change of them.

    {R, g}(X, p) = 0  at n unknowns,    delta = -J'^-1 {R', g'}(X, p)  at more of them,    error = |delta_p|

R', g' and J' are the equations of the special point with more unknowns (`problem.Refinable`), at the point found with
fewer: one Newton step. It tells the error as long as the errors fall fast enough with the number of unknowns that those
of the finer solution do not count. Points that no equations are known for, and those that leave their piece of the
curve, are located again between the ends of the piece solved again. Where the error is larger than wanted, the point is
solved for with more unknowns, and judged anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.algebra import norm
from hbgear.continuation.branch import SpecialPoint
from hbgear.continuation.events import Found, Sharp, Turning
from hbgear.continuation.newton import NoConvergence, Solution, solution_at
from hbgear.continuation.problem import FullProblem, as_problem, observe_all
from hbgear.continuation.record import fields_of
from hbgear.continuation.segment import CurvePoint, Segment, solved_again, widened

_ROUNDING = 1e-12  # of a parameter, relative to its unit: no error is told to be smaller


_FAR = 0.05  # scaled length by which a point may move when it is solved for with more unknowns


_REACHES = 1.0, 3.0, 9.0  # lengths of the piece, at either end, with which it is looked at again


_MISSED = 2  # times in a row that a point is not found with more unknowns, after which it is given up


_SKETCH = 0.5  # error of a solution relative to its size above which it is no start for one with more unknowns


def assessed(arc: Segment, found: Found, accuracy: float) -> Found:
    """A special point with its error, solved for with more unknowns where that is above the accuracy.

    Parameters
    ----------
    arc : the piece of the curve on which it was found.
    accuracy : largest error wanted, relative to the size of the parameter (`FullProblem.unit_of`).

    Returns
    -------
    Found
        Its error is infinite if it is not found again with more unknowns, nan if nothing could be said.
    """
    rough = (is_sketch(arc.problem, end.X, end.observed.get("error", 0.0)) for end in (arc.a, arc.b))
    if arc.problem.finer is None or any(rough):
        return found
    unit = arc.problem.unit_of(arc.name, found.row.value)
    goal = accuracy * unit
    simple = found.located and found.finder is None  # where two multipliers pass at once, the equations are singular
    best = _by_equations(arc, found, goal) if simple and arc.problem.smooth else found
    left = _left(arc, best)
    if left or not best.error <= goal:
        other = _by_pieces(arc, found, goal)
        better = other.error < best.error or math.isnan(best.error)
        best = other if (_moved(arc, found, other) < _moved(arc, found, best) if left else better) else best
    return replace(best, error=max(best.error, _ROUNDING * unit))


def is_sketch(problem: FullProblem, X: Array, error: float) -> bool:
    """Whether a solution with this error is too rough to be solved for with more unknowns."""
    return error > _SKETCH * problem.motion_size(X)


def _by_equations(arc: Segment, found: Found, goal: float) -> Found:
    """`assessed` by Newton on the equations of the point; the last that could be solved for."""
    problem, row = arc.problem, found.row
    while problem.finer is not None:
        finer, here = as_problem(problem.finer), {**arc.parameters, arc.name: row.value}
        try:
            point = SpecialPoint(**fields_of(problem, arc.name, here, row), kind=found.event.kind, note=found.note)
            extended = found.event.equations(finer, arc.name, point)
            if extended is None:
                break
            U = np.append(finer.fitted(row.X), row.value)
            extended, U = extended.stepped(U, here, found.event.judged_by)
            found = replace(found, error=abs(float(U[-1] - row.value)))
            if found.error <= goal:
                break
            solution = extended.located(U, here)
        except (NoConvergence, np.linalg.LinAlgError, ValueError):
            break
        problem, row = finer, _row_of(arc, finer, solution_at(finer, solution.X, arc.name, arc.parameters))
        if _apart(arc, row, found.row) > _FAR or row.residual > arc.settings.tolerance:
            break
        found = replace(found, sharp=Sharp(problem, row))
    return found


def _left(arc: Segment, found: Found) -> bool:
    """Whether Newton with more unknowns went beyond the ends of the piece, where another point may be."""
    return found.sharp is not None and not 0 <= arc.place(_fitted(arc, found.sharp.row)) <= 1


def _moved(arc: Segment, found: Found, judged: Found) -> float:
    """How far a point moved with more unknowns: of two answers the one that moved less is likelier to be that point."""
    if math.isinf(judged.error):
        return math.inf
    return 0.0 if judged.sharp is None else _apart(arc, judged.sharp.row, found.row)


def _by_pieces(arc: Segment, found: Found, goal: float) -> Found:
    """`assessed` by looking for the point again on the piece of the curve solved with more unknowns."""
    place, missed = found.row.value if found.located else math.nan, 0
    find = (found.finder or found.event).find
    reaches = _REACHES if found.event.judged_by > 1 else _REACHES[:1]  # where equations bend, points run farther
    found = replace(found, error=math.inf)
    while arc.problem.finer is not None and missed < _MISSED:
        try:
            if found.located and isinstance(found.event, Turning):
                error = _of_turn(arc, found.sharp.row if found.sharp else found.row, as_problem(arc.problem.finer))
                if error <= goal:
                    return replace(found, error=error)
            arc = _again(arc, as_problem(arc.problem.finer))
            again = [
                p for p in find(arc) or _beyond(arc, find, reaches) if p.located and p.event.kind == found.event.kind
            ]
        except (NoConvergence, np.linalg.LinAlgError):
            break
        missed = 0 if again else missed + 1
        if not again:
            continue
        row = min(again, key=lambda p: abs(arc.place(p.row.u) - found.s)).row
        if abs(row.value - place) <= goal:
            return replace(found, error=abs(row.value - place))
        error = math.inf if math.isnan(place) else abs(row.value - place)
        place, found = row.value, replace(found, error=error, sharp=Sharp(arc.problem, row), located=True)
    return found


def _of_turn(arc: Segment, row: CurvePoint, finer: FullProblem) -> float:
    """What more unknowns change of the value at which the curve turns, from one row with them beside it.

        p(s) ~ p + t (s - s_0) + k (s - s_0)^2 / 2,   at its turn p - t^2 / 2k

    with the slopes t there and k = dt/ds of the piece: where the curve turns its value hardly changes along it.
    """
    finer = finer.based(finer.fitted(row.X), {**arc.parameters, arc.name: row.value})
    scale = widened(arc.scale, finer, len(finer.fitted(row.X)))
    beside = solved_again(row, finer, arc.name, arc.parameters, scale, arc.settings)
    begin, end = arc.slopes
    bend = (end[-1] - begin[-1]) / arc.length**2
    return float(abs(beside.value - row.value) + beside.tangent[-1] ** 2 / abs(2 * bend))


def _again(arc: Segment, finer: FullProblem) -> Segment:
    """The piece with its ends solved for with more unknowns, and observed."""
    scale = widened(arc.scale, finer, len(finer.fitted(arc.a.X)))
    finer = finer.based(finer.fitted(arc.a.X), {**arc.parameters, arc.name: arc.a.value})
    a, b = (solved_again(row, finer, arc.name, arc.parameters, scale, arc.settings) for row in (arc.a, arc.b))
    return _between(replace(arc, problem=finer, scale=scale), a, b)


def _beyond(arc: Segment, find: Callable[[Segment], list[Found]], reaches: Sequence[float]) -> list[Found]:
    """What is found with more of the curve at both ends, where more unknowns may have put a point near them."""
    for reach in reaches:
        if reach > 1 and reach * arc.length > _FAR:
            break
        try:
            found = find(_between(arc, arc.at(-reach), arc.at(1.0 + reach)))
        except (NoConvergence, np.linalg.LinAlgError):
            break
        if found:
            return found
    return []


def _between(arc: Segment, a: CurvePoint, b: CurvePoint) -> Segment:
    """The piece between two other rows, which are observed as its own were."""
    seen = observe_all(arc.problem, np.array([a.u, b.u]), arc.name, arc.parameters, "multipliers" in arc.a.observed)
    for end, told in zip((a, b), seen, strict=True):
        end.observed.update(told)
    return arc.part(a, b)


def _row_of(arc: Segment, problem: FullProblem, point: Solution) -> CurvePoint:
    """The row of a special point of the piece, with the tangent of the piece's beginning."""
    u = np.append(point.X, point.value)
    tangent = np.append(problem.fitted(arc.a.tangent[:-1]), arc.a.tangent[-1])
    return CurvePoint(u, tangent, arc.a.orientation, point.residual, point.iterations)


def _apart(arc: Segment, one: CurvePoint, other: CurvePoint) -> float:
    """Scaled distance of two rows in the unknowns of the piece."""
    return norm((_fitted(arc, one) - _fitted(arc, other)) / arc.scale)


def _fitted(arc: Segment, row: CurvePoint) -> Array:
    """A row in the unknowns of the piece."""
    return np.append(arc.problem.fitted(row.X), row.value)
