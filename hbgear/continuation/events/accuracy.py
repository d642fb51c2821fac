"""Errors of special points: what other numbers of unknowns change of them.

    {R, g}(X, p) = 0,     error(n) = max_i w_i | p(n_i) - p(n) |

R and g are the equations of the special point, p(n) the value of the parameter that solves them with n unknowns. The
problem states the numbers n_i and weights w_i (`ContinuationProblem.comparisons`): 3/2 n and 2 n with the
weight 1, where they can be solved for; else fewer unknowns, with weights for the slow rate n^-2. One difference is no
estimate: with short contacts the error oscillates with the number of unknowns, and passes zero.

Each p(n_i) is converged: a single Newton step is wrong by a factor of 20 where contacts are short. The estimate is a
function of the point and its number of unknowns alone, whatever led to it. Where the error is larger than wanted, or
the multipliers are not those of the event (`Event.deviation`), the point is located with twice the unknowns, and its
error estimated again. Points without equations, and those that leave their segment of the curve, are located on the
segment solved again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.minimally_augmented import MinimallyAugmentedProblem
from hbgear.continuation.curve.builder import point_fields
from hbgear.continuation.curve.segment import CurvePoint, Segment, rescaled, resolve_at_resolution
from hbgear.continuation.events.event import LocatedEvent, RefinedLocation
from hbgear.continuation.events.fold import FoldEvent
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem, observe_all
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.solvers.newton import NoConvergence, Solution, solution_at

_ROUNDING = 1e-12  # of a parameter, relative to its unit: no error is stated to be smaller


_FAR = 0.05  # scaled length by which a point may move when it is located with another number of unknowns


_REACHES = 1.0, 3.0, 9.0  # lengths of the segment, at either end, with which it is searched again


_MISSED = 2  # times in a row that a point is not found with more unknowns, after which the search ends


_SKETCH = 0.5  # error of a solution relative to its size above which it is no start for one with more unknowns


_SETTLED = 0.1  # last Newton step, over the change of the parameter, at which that change is known


_STEPS = 6  # Newton steps in which it settles, before the damped iteration takes over


@dataclass(frozen=True)
class Moved:
    """A special point with another number of unknowns.

    value : of the parameter, nan if the point was not found. distance : scaled, from where it was.
    sharp : locates it to all digits.
    """

    value: float
    distance: float
    sharp: Callable[[], RefinedLocation | None]


_LOST = Moved(math.nan, math.inf, lambda: None)


def estimate_error(arc: Segment, found: LocatedEvent, accuracy: float, work: Work | None = None) -> LocatedEvent:
    """A special point with its error, located with more unknowns where that is above the accuracy.

    Parameters
    ----------
    arc : Segment
        The segment of the curve on which it was found.
    found : Found
        The point.
    accuracy : float
        Largest error wanted, relative to the size of the parameter (`ContinuationProblem.unit_of`).
    work : Work, optional
        Bound of the work; none by default. Where it is reached the error stays as large as it was estimated.

    Returns
    -------
    Found
        Its error is infinite if other numbers of unknowns do not have it, nan if none can be compared. It is not
        located if its multipliers are farther than 1e-3 from those of the event with the most unknowns.
    """
    rough = (is_under_resolved(arc.problem, end.X, end.observed.get("error", 0.0)) for end in (arc.a, arc.b))
    if not arc.problem.comparisons or any(rough):
        return found
    work = work or Work(math.inf)
    unit = arc.problem.unit_of(arc.name, found.row.value)
    goal, problem, missed, error = accuracy * unit, arc.problem, 0, math.inf
    while True:
        moved: list[tuple[ContinuationProblem, Moved]] = []
        if not _may_compare(problem, problem is arc.problem, work):
            break
        error = _error(arc, found, problem, goal, moved)
        finer = None if problem.refined_problem is None else problem.refined_problem
        if (error <= goal and _deviation(arc, found) <= _CRITICAL) or finer is None:
            break
        if not work.allows(finer.size or 0, _SEARCH):
            error = _error(arc, found, problem, math.inf, [])
            break
        known = next((there for other, there in moved if other is finer), None)
        sharp = (known or _moved(arc, found, finer)).sharp()
        missed, problem = (0 if sharp else missed + 1), finer
        if sharp:
            found = replace(found, sharp=sharp, located=True)
        elif missed == _MISSED:
            break
    located = found.located and _deviation(arc, found) <= _CRITICAL
    return replace(found, error=math.inf if missed else max(error, _ROUNDING * unit), located=located)


_CRITICAL = 1e-3
"""Distance of a multiplier from +1 (BP), -1 (PD) or the unit circle (NS) above which a point is not located.

Points that are right were seen with 1e-4 and less, ends of segments that were taken for points with .01 and more.
"""


def _deviation(arc: Segment, found: LocatedEvent) -> float:
    """Distance of the multipliers of a point from those that its event requires; 0 if there are none, or not known."""
    if not found.located or "multipliers" not in arc.a.observed or found.event.deviation(np.empty(0, complex)) == 0:
        return 0.0
    there = found.sharp or RefinedLocation(arc.problem, found.row)
    if not there.row.observed:
        there.row.observed.update(observe_all(there.problem, there.row.u[None], arc.name, arc.parameters, True)[0])
    multipliers = there.row.observed.get("multipliers", np.full(1, math.nan))
    return 0.0 if np.isnan(multipliers).any() else found.event.deviation(multipliers)


def _may_compare(problem: ContinuationProblem, first: bool, work: Work) -> bool:
    """Whether the bound of the work allows all comparisons of a problem: one difference alone is no estimate.

    first : whether they are the first estimate of a point, which has a bound of its own. Later ones only improve it: a
    point located with more unknowns has no larger error than the one with fewer.
    """
    sizes = [other.size or 0 for other, _ in problem.comparisons]
    return work.estimates(max(sizes), _COMPARED) if first else work.allows(max(sizes), _COMPARED)


def _error(
    arc: Segment,
    found: LocatedEvent,
    problem: ContinuationProblem,
    goal: float,
    moved: list[tuple[ContinuationProblem, Moved]],
) -> float:
    """The error of a point located with the unknowns of a problem; some larger number than the goal, if it is larger.

    An infinite goal: the whole error.
    moved : filled with what was located, each with its problem.
    """
    own = (found.sharp.problem if found.sharp else arc.problem) is problem
    if not found.located or not own:  # not known with so many unknowns
        return math.inf
    value, errors = found.value, []
    for other, weight in problem.comparisons:
        there = _moved(arc, found, other)
        moved.append((other, there))
        errors.append(weight * abs(there.value - value))
        if problem.refined_problem is not None and not errors[-1] <= goal:
            return math.inf if math.isnan(errors[-1]) else errors[-1]
    known = [error for error in errors if not math.isnan(error)]
    return max(known, default=math.inf)


_COMPARED = 3  # solutions with 2 n unknowns that take as long as a point by its equations with 3/2 n and 2 n


_SEARCH = 4  # solutions that take as long as a point that is located to all digits


def is_under_resolved(problem: ContinuationProblem, X: Array, error: float) -> bool:
    """Whether a solution with this error is too rough to be solved for with more unknowns."""
    return error > _SKETCH * problem.solution_norm(X)


def _moved(arc: Segment, found: LocatedEvent, problem: ContinuationProblem) -> Moved:
    """The point with the unknowns of another problem: by its equations, else on the segment solved again.

    Where the equations leave the segment, another point may lie, and of both answers the nearer one is the point.
    """
    simple = found.located and found.finder is None  # where two multipliers pass at once, the equations are singular
    if simple and arc.problem.smooth:
        first = _by_equations(arc, found, problem)
        if first is not None:
            sharp = first.sharp() if _left(arc, found, first) else None
            if sharp is None:
                return first
            second = _by_pieces(arc, found, problem)
            return second if second.distance < first.distance else first
    if found.located and isinstance(found.event, FoldEvent):
        try:
            change = _of_turn(arc, found.sharp.row if found.sharp else found.row, problem)
            return Moved(found.value + change, 0.0, lambda: _by_pieces(arc, found, problem).sharp())
        except (NoConvergence, np.linalg.LinAlgError):
            pass
    return _by_pieces(arc, found, problem)


def _by_equations(arc: Segment, found: LocatedEvent, problem: ContinuationProblem) -> Moved | None:
    """The point by Newton on its equations with the unknowns of another problem; None if it has none or they fail."""
    now = found.sharp or RefinedLocation(arc.problem, found.row)
    row, here = now.row, {**arc.parameters, arc.name: now.row.value}
    start = np.append(problem.resized(row.X), row.value)
    try:
        point = SpecialPoint(**point_fields(now.problem, arc.name, here, row), kind=found.event.kind, note=found.note)
        extended = found.event.equations(problem, arc.name, point)
        if extended is None:
            return None
        unit = problem.unit_of(arc.name, row.value)
        U = _settled(extended, start, here, _ROUNDING * unit)
    except (NoConvergence, np.linalg.LinAlgError, ValueError):
        return None

    def sharp() -> RefinedLocation | None:
        try:
            solution = extended.located(U, here)
        except (NoConvergence, np.linalg.LinAlgError, ValueError):
            return None
        there = _row_of(arc, problem, solution_at(problem, solution.X, arc.name, arc.parameters))
        good = _apart(arc, there, row) <= _FAR and there.residual <= arc.settings.tolerance
        return RefinedLocation(problem, there) if good else None

    distance = _apart(arc, replace(row, u=U), row)
    return Moved(float(U[-1]), distance, sharp) if distance <= _FAR else None


def _settled(extended: MinimallyAugmentedProblem, start: Array, here: dict[str, float], rounding: float) -> Array:
    """Unknowns (X, p) of a special point whose change of p is known to a tenth."""
    U, own = start, extended
    for _ in range(_STEPS):
        last = U
        try:
            own, U = own.stepped(U, here, 1)
        except np.linalg.LinAlgError:
            break
        if not np.isfinite(U).all():
            break
        if abs(U[-1] - last[-1]) <= max(_SETTLED * abs(U[-1] - start[-1]), rounding):
            return U
    return extended.located(start, here).X


def _left(arc: Segment, found: LocatedEvent, moved: Moved) -> bool:
    """Whether a point moved beyond the ends of the segment on which it was found, where another point may be."""
    if moved.distance <= _AT_THE_END * arc.length:
        return False
    sharp = moved.sharp()
    return sharp is not None and not 0 <= arc.place(_fitted(arc, sharp.row)) <= 1


_AT_THE_END = 1e-3  # share of a segment by which a point may move without being another one


def _by_pieces(arc: Segment, found: LocatedEvent, problem: ContinuationProblem) -> Moved:
    """The point located again on the segment solved with the unknowns of another problem."""
    find = (found.finder or found.event).find
    try:
        again = _again(arc, problem)
        points = [p for p in find(again) or _beyond(again, find) if p.located and p.event.kind == found.event.kind]
    except (NoConvergence, np.linalg.LinAlgError):
        return _LOST
    if not points:
        return _LOST
    row = min(points, key=lambda p: abs(again.place(p.row.u) - found.s)).row
    return Moved(row.value, _apart(arc, row, (found.sharp or found).row), lambda: RefinedLocation(problem, row))


def _of_turn(arc: Segment, row: CurvePoint, finer: ContinuationProblem) -> float:
    """What more unknowns change of the value at which the curve turns, from one row with them beside it.

        p(s) ~ p + t (s - s_0) + k (s - s_0)^2 / 2,   at its turn p - t^2 / 2k

    with the slopes t there and k = dt/ds of the piece: where the curve turns its value hardly changes along it.
    """
    finer = finer.with_borders_at(finer.resized(row.X), {**arc.parameters, arc.name: row.value})
    scale = rescaled(arc.scale, finer, len(finer.resized(row.X)))
    beside = resolve_at_resolution(row, finer, arc.name, arc.parameters, scale, arc.settings)
    begin, end = arc.slopes
    bend = (end[-1] - begin[-1]) / arc.length**2
    return float(abs(beside.value - row.value) + beside.tangent[-1] ** 2 / abs(2 * bend))


def _again(arc: Segment, finer: ContinuationProblem) -> Segment:
    """The piece with its ends solved for with more unknowns, and observed."""
    scale = rescaled(arc.scale, finer, len(finer.resized(arc.a.X)))
    finer = finer.with_borders_at(finer.resized(arc.a.X), {**arc.parameters, arc.name: arc.a.value})
    a, b = (resolve_at_resolution(row, finer, arc.name, arc.parameters, scale, arc.settings) for row in (arc.a, arc.b))
    return _between(replace(arc, problem=finer, scale=scale), a, b)


def _beyond(arc: Segment, find: Callable[[Segment], list[LocatedEvent]]) -> list[LocatedEvent]:
    """What is found with more of the curve at both ends, where other unknowns may have put a point near them."""
    for reach in _REACHES:
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


def _row_of(arc: Segment, problem: ContinuationProblem, point: Solution) -> CurvePoint:
    """The row of a special point of the piece, with the tangent of the piece's beginning."""
    u = np.append(point.X, point.value)
    tangent = np.append(problem.resized(arc.a.tangent[:-1]), arc.a.tangent[-1])
    return CurvePoint(u, tangent, arc.a.orientation, point.residual, point.iterations)


def _apart(arc: Segment, one: CurvePoint, other: CurvePoint) -> float:
    """Scaled distance of two rows in the unknowns of the piece."""
    return norm((_fitted(arc, one) - _fitted(arc, other)) / arc.scale)


def _fitted(arc: Segment, row: CurvePoint) -> Array:
    """A row in the unknowns of the piece."""
    return np.append(arc.problem.resized(row.X), row.value)
