"""Pseudo-arclength continuation: follow the solutions of a problem as one parameter changes.

Rows are found in strides (`stride`), in unknowns scaled so that the span of the parameter and the size of the solution
are one. The step follows the number of Newton steps, the angle the tangent turned through and how far the prediction
missed the curve; a step that turns too far, lands too far from where it was sent or runs back over the curve is taken
again at half its length. The tangent passes folds without a change of parameter. Special points are looked for between
the rows, the curve's ends at every row.

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range, checked
from hbgear.continuation.curve.asymptote import vertical_asymptote
from hbgear.continuation.curve.builder import SpecialPointMark, build_branch
from hbgear.continuation.curve.segment import (
    BranchStart,
    CurvePoint,
    Points,
    Segment,
    cosine,
    normal_of,
    point_from_solution,
    rescaled,
    resolve_at_resolution,
)
from hbgear.continuation.events.accuracy import estimate_error
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.events.detector import EventDetector, events_of
from hbgear.continuation.events.even_crossings import SampledCurve, drop_odd_counts, find_even_crossings
from hbgear.continuation.events.event import Event, LocatedEvent, unknowns
from hbgear.continuation.events.fold import FoldEvent, far_side_of_fold
from hbgear.continuation.numerics.linear import norm, norms
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem, observe_all
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.problem.work import DEFAULT_LIMIT, Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.branch_data import relative_errors
from hbgear.continuation.results.concatenation import with_asymptotes
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS, STABLE, UNSTABLE, stability_codes
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, refine, solve
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.branch_start import departed, first_two
from hbgear.continuation.tracing.coverage import UNCOVERED, CoverageSearch, cover_span, coverage_message
from hbgear.continuation.tracing.jumps import find_jumps
from hbgear.continuation.tracing.stepper import Stepper


@checked_arguments(
    parameter="the name of a parameter, such as 'Omega'",
    start="a Point such as curve['LP1'] or curve[-1], or unknowns (n,)",
    at="values by name, such as at={'zeta': 0.05}",
)
def trace(
    problem: AnyProblem,
    parameter: str,
    span: tuple[float, float],
    start: Point | BranchStart | Array | None = None,
    *,
    at: Mapping[str, float] | None = None,
    steps: StepControl = StepControl(),
    settings: NewtonSettings = NewtonSettings(),
    stability: bool = True,
    special: bool = True,
    events: Sequence[Event] = (),
    progress: ProgressCallback | None = None,
    cover: bool = True,
    accuracy: float | None = 1e-5,
    work: float | None = DEFAULT_LIMIT,
) -> Branch:
    """Follow the solutions of a problem from one end of a span of a parameter to the other.

    Parameters
    ----------
    problem : a `HarmonicBalance`, a `FoldProblem`, or any object with ``evaluate(X, **parameters) -> (R, dR_dX)``; what
    else
        it may offer is told in `hbgear.continuation.problem.base`.
    parameter : the parameter that changes.
    span : (from, to). The curve is followed through every fold until it leaves the span at either end, closes on
        itself, or cannot be followed.
    start : where to begin: a `Point` (``curve["LP1"]``, ``curve[10]``) or unknowns (n,); by default the problem finds
        one at ``span[0]``, or if there is none, and the whole span is looked at, at ``span[1]``, which the message
        says. A Point that knows ``parameter`` is begun from at its own value.
    at : values of parameters that stay fixed, if not the problem's own (``{"zeta": 0.05}``).
    steps, settings : step control and corrector.
    stability : ask the problem for multipliers at every point.
    special : locate the special points that the problem knows (folds, branch points, ...) and insert them as rows.
    events : special points of your own, located and inserted as well; see `Event`.
    progress : called with a `Progress` after every point, such as ``print``. An exception it raises ends the trace and
        comes out of it as it is, with the branch traced so far as its attribute ``branch``.
    cover : without a start: if the curve does not lead through the whole span (it turns back to where it began, or
        runs off to infinity), look for others that do, which are the ``others`` of the branch; see `Branch`. The
        message says so, and which part of the span no curve was found in.
    accuracy : largest error of a special point, relative to its parameter. Each point states its own
        (`SpecialPoint.error`), and one whose error is larger, or whose multipliers are not those of its event to 1e-3,
        is located with more unknowns (`SpecialPoint.located` is False where these do not suffice), as are rows whose
        stability they leave undecided; the other rows stay what they are. But where solutions turn out to be off by a
        twentieth of their size, or a special point is not found with more unknowns within a thousandth of where it was,
        a curve that covers its span is followed anew with twice the unknowns throughout, and the message says so.
        None for the curve and the points of the problem's own equations, without errors.
    work : bound of the work for errors, accurate special points and verdicts in doubt, in solutions with 700 unknowns;
        one with n counts (n / 700)^3. Where it is reached, special points keep the errors that they have, rows in doubt
        are undecided, and the message says so. First estimates of errors have a second bound of the same size. None
        for no bound.

    Returns
    -------
    Branch
        with a status and advice whatever happens after the first point. Ctrl-C ends the trace with the status
        ``interrupted`` and everything traced so far. An error gives the status ``failed``, with the error in the
        message: the curve is then followed as far as possible, without what the error concerns (rows whose motion
        could not be observed have multipliers nan and the regime unknown).

    Raises
    ------
    TypeError
        If an argument is of another kind, such as a model instead of its `HarmonicBalance`.
    KeyError
        If the problem has no such parameter.
    ValueError
        If the span is empty, not finite or outside the range of the parameter, or a fixed parameter is missing.
    NoConvergence
        If no solution is found at the start, nor at the other end.
    KeyboardInterrupt
        If Ctrl-C comes before the first point is found.

    Examples
    --------
    >>> import hbgear as hb
    >>> problem = hb.HarmonicBalance(hb.Duffing(), 5)
    >>> curve = hb.trace(problem, "Omega", (0.8, 1.6))
    >>> [point.label for point in curve.special]
    ['LP1', 'LP2']
    >>> [round(jump.value, 3) for jump in curve.jumps()]
    [1.103, 1.1]
    """
    asked = full = as_problem(problem)
    if work is not None:
        checked("trace", "work", work, NOT_NEGATIVE)
    bound = Work(math.inf if work is None else float(work))
    anew = nowhere = ""
    while True:
        follow = partial(
            Tracer, parameter=parameter, at=at, steps=steps, settings=settings, stability=stability, special=special,
            events=events, progress=progress, accuracy=accuracy, work=bound,
        )  # fmt: skip
        try:
            tracer = follow(full, span=span, start=start, cover=cover and start is None, asked=asked)
        except _Arbitrary as found:
            return _chosen(found, follow, full, span, cover)
        except NoConvergence:
            if nowhere or start is not None or not cover:
                raise
            nowhere = f"no solution was found at {parameter} = {span[0]:.6g}: followed from the other end"
            span = span[::-1]
            continue
        try:
            branch = tracer.run()
        except _UnderResolved as sketch:
            full, anew = sketch.finer, str(sketch)
            bound = Work(bound.limit)  # what the rough curve took is no reason to leave the better one unfinished
            continue
        if not anew and not nowhere:
            return branch
        return replace(branch, message="; ".join(text for text in (branch.message, anew, nowhere) if text))


def _chosen(
    found: _Arbitrary,
    follow: Callable[..., Tracer],
    problem: ContinuationProblem,
    span: tuple[float, float],
    cover: bool,
) -> Branch:
    """The curve of one of the solutions of which something is arbitrary, and another where nothing is any more."""
    curve = follow(found.problem, span=span, start=found.X).run()
    text = f"{found.words}; {curve.message}"
    if not curve.status.complete:
        return replace(curve, message=text)
    others: tuple[Branch, ...] = ()
    if curve.status is Status.EVENT and cover:
        with suppress(NoConvergence):
            others = (follow(problem, span=(span[1], float(curve.values[-1])), start=None).run(),)
    left = coverage_message(curve, others, span) if cover else ""
    return replace(curve, status=Status.ARBITRARY, message="; ".join(filter(None, (text, left))), others=others)


MAX_RELATIVE_TRUNCATION_ERROR = (
    0.05  # error of a solution, relative to its size, above which a curve of it is only a sketch
)


_CURVE = 8  # solutions with errors and verdicts that take as long as the rows of a curve


SPURIOUS_POINT_ERROR = (
    1e-3  # error of a special point, over the unit of the parameter, above which it may not be there at all
)


class Tracer:
    """State of one trace."""

    def __init__(
        self,
        problem: ContinuationProblem,
        parameter: str,
        span: tuple[float, float],
        start: Point | BranchStart | Array | None,
        at: Mapping[str, float] | None,
        steps: StepControl,
        settings: NewtonSettings,
        stability: bool,
        special: bool,
        events: Sequence[Event],
        progress: ProgressCallback | None,
        cover: bool = False,
        accuracy: float | None = None,
        strict: bool = False,
        asked: ContinuationProblem | None = None,
        work: Work | None = None,
    ) -> None:
        # asked : the problem with as many unknowns as were asked for, in which solutions are looked for at less cost
        self.work = work or Work(math.inf)
        self.another = partial(  # curve of the span
            Tracer, parameter=parameter, at=at, steps=steps, settings=settings, stability=stability, special=special,
            events=events, progress=progress, accuracy=accuracy, asked=asked, work=self.work,
        )  # fmt: skip
        if accuracy is not None:
            checked("trace", "accuracy", accuracy, POSITIVE)
        self.accuracy = accuracy
        self.original, self.cover = problem, cover
        refinable = accuracy is not None and problem.refined_problem is not None
        self.strict = strict or (cover and refinable and not problem.changes and not problem.unknown_parameters)
        self.others: list[Branch] = []  # curves that cover what this one leaves of the span
        self.remark = ""  # what there is to say of them
        self.problem, self.name, self.largest = problem, parameter, problem
        self.steps, self.settings, self.special, self.progress = steps, settings, special, progress
        self.stability = stability
        # else it goes on from a point of another curve, and what it is not is no surprise
        self.whole = start is None or (isinstance(start, BranchStart) and start.away)
        for name in (parameter, *(at or {})):
            problem.check_parameter(name)
        if parameter in (at or {}):
            raise ValueError(f"at={{'{parameter}': ...}}: it is what changes along the curve; give its span")
        self.range = problem.range_of(parameter)
        self.a, self.b = _checked_span(parameter, span, self.range)
        self.landed: float | None = None  # end of the parameter's range that the last row was put on
        self.fixed = self._fixed(start, at)
        ends = min(self.a, self.b), max(self.a, self.b)
        problem.check_trace(parameter, *ends, self.fixed)
        whole, problem = problem, problem.restricted_to(parameter, *ends, self.fixed)
        self.original = self.problem = self.largest = problem
        asked = asked or whole
        self.asked = problem if asked is whole else asked.restricted_to(parameter, *ends, self.fixed)
        self.sense = 1.0 if self.b > self.a else -1.0
        self.rows: list[CurvePoint] = []
        self.found: list[
            tuple[int, LocatedEvent]
        ] = []  # special points, each with the number of the row it comes before
        self.between: dict[int, list[tuple[float, CurvePoint]]] = {}  # rows between them, each with its place
        self.waiting: list[
            tuple[ContinuationProblem, Array]
        ] = []  # problem and scale of the last pieces, not yet looked at
        self.stop: LocatedEvent | None = None  # the terminal event the trace stopped at
        # a problem that changes its unknowns from row to row is looked at row by row
        self.together = 1 if problem.changes else problem.batch_size  # rows observed at once
        # whether it ended before a point where it is not smooth: beyond it, solutions take minutes and are not resolved
        self.is_nonsmooth = False
        self.turned = False  # whether the curve has changed its heading
        self.path, self.kept = np.empty((0, 0)), 0  # u of the first rows, and how many of them; see _earlier
        self.ending = Termination()
        self.first_unseen: Exception | None = None  # why what the problem says of the first motion could not be had
        self.made: Branch | None = None
        self.asymptote: float | None = None  # where the curve runs off to infinity
        self.branch_direction = start if isinstance(start, BranchStart) and start.away else None
        self.ahead: list[CurvePoint] = []  # the row behind the special point at which the curve begins, if it does
        self.first = self._first_row(start)
        self.rows = [self.first]
        own = events_of(problem, parameter)
        self.watch = EventDetector([*(own if special else [e for e in own if e.terminal]), *events], problem, parameter,
                           self.fixed)  # fmt: skip

    # ---- start

    def _fixed(self, start: Point | BranchStart | Array | None, at: Mapping[str, float] | None) -> dict[str, float]:
        """All parameters but the traced one: the problem's, then the start's, then those given."""
        fixed = dict(self.problem.parameters)
        if isinstance(start, Point | BranchStart):
            fixed.update(start.parameters)
        fixed.update({name: float(value) for name, value in (at or {}).items()})
        own = self.problem.unknown_parameters
        for name in (self.name, *own):
            fixed.pop(name, None)
        for name in self.problem.missing((self.name, *fixed, *own)):
            raise ValueError(
                f"tracing in {self.name} needs a fixed {name}: give at={{'{name}': ...}} or start from a point of a "
                "curve"
            )
        return fixed

    def _first_row(self, start: Point | BranchStart | Array | None) -> CurvePoint:
        value = self.a
        problem = self.problem
        if isinstance(start, BranchStart):
            return self._depart(start)
        if isinstance(start, Point):
            value = start.parameters.get(self.name, self.a)
            if not min(self.a, self.b) <= value <= max(self.a, self.b):
                raise ValueError(
                    f"the start has {self.name} = {value:.6g}, outside the span ({self.a:.6g}, {self.b:.6g}); "
                    "widen the span or choose another start"
                )
            X = problem.join(problem.from_point(start), start.parameters)
        elif start is not None:
            X = np.array(start, dtype=float)
        else:
            X = self._anywhere({**self.fixed, self.name: value})
        _check_start(problem, X)
        self.problem = problem = problem.with_borders_at(X, {**self.fixed, self.name: value})
        solution = solve(problem, X, {**self.fixed, self.name: value}, self.name, self.settings)
        finer = problem.resolved(solution.X, {**self.fixed, self.name: value})
        if finer is not problem:
            solution = solve(finer, solution.X, {**self.fixed, self.name: value}, self.name, self.settings)
            self.problem = self.original = self.largest = problem = finer
        loose = problem.arbitrary(solution.X, {**self.fixed, self.name: value}) if start is None else None
        if loose is not None:
            raise _Arbitrary(solution.X, {**self.fixed, self.name: value}, *loose)
        self.top = self._motion_size(solution.X)
        self.scale = self._scale(solution.X)
        normal = np.zeros(len(solution.X) + 1)
        normal[-1] = self.sense
        try:
            row = point_from_solution(solution, normal, self.scale)
        except np.linalg.LinAlgError:
            message = (
                f"the curve has no direction at {self.name} = {value:.6g}: a fold or branch point lies exactly there, "
                f"or something is not determined ({problem.singular_hint}); start elsewhere"
            )
            raise NoConvergence(message, solution.X, {**self.fixed, self.name: value}, [solution.residual]) from None
        if self.top == 0 and abs(row.tangent[-1]) > 0:  # from zero: the size it heads for is the scale
            self.top = self._motion_size(row.tangent[:-1] / row.tangent[-1] * abs(self.b - self.a))
            self.scale = self._scale(solution.X)
            row = point_from_solution(solution, normal, self.scale)
        return row

    def _anywhere(self, here: dict[str, float]) -> Array:
        """A solution wherever the problem finds one, if it can with as few unknowns as were asked for."""
        X = self.asked.start(**here)
        if self.asked is self.original:
            return X
        try:
            return solve(self.original, self.original.resized(X), here, "", self.settings).X
        except NoConvergence:
            return self.original.start(**here)

    def _depart(self, start: BranchStart) -> CurvePoint:
        """The point at which another branch begins."""
        self.problem = self.problem.with_borders_at(start.X, {**self.fixed, self.name: start.parameters[self.name]})
        self.top = self._motion_size(start.X)
        self.scale = self._scale(start.X)
        if not start.away:
            return departed(self.problem, self.name, self.fixed, start, 0.0, self.scale, self.settings)
        first, *self.ahead = first_two(
            self.problem, self.name, self.fixed, start, self.steps, self.scale, self.settings
        )
        return first

    def _motion_size(self, X: Array) -> float:
        return float(self.problem.solution_norm(X))

    def _scale(self, X: Array) -> Array:
        """Scales of (X, lambda): the largest solution so far, and the span."""
        own = len(self.problem.unknown_parameters)
        floor = 1e-2 * norm(X[: len(X) - own]) or 1.0
        scale = np.full(len(X) + 1, max(self.top, floor))
        scale[-1] = abs(self.b - self.a)
        for i in range(own):  # parameters among the unknowns: the largest value so far
            past = [abs(row.X[-1 - i]) for row in self.rows]
            scale[-2 - i] = max([*past, abs(X[-1 - i])]) or 1.0
        return scale

    def _observe(self, rows: list[CurvePoint], problem: ContinuationProblem | None = None) -> None:
        """Note with the rows what the problem says of their motions; nothing where that fails, which is told.

        problem : whose rows these are; that of the last row by default. If it fails for the first row, so does the
        trace.
        """
        fresh = [row for row in rows if not row.observed]
        if not fresh:
            return
        told: Iterable[dict[str, Any]]
        u = np.array([row.u for row in fresh])
        try:
            told = observe_all(problem or self.problem, u, self.name, self.fixed, self.stability)
        except Exception:
            told = (self._observed_alone(row, problem or self.problem) for row in fresh)
        for row, seen in zip(fresh, told, strict=True):
            row.observed.update(seen)
        if self.strict:
            self._check_enough(u, np.array([row.observed.get("error", 0.0) for row in fresh]))

    def _check_enough(self, u: Array, error: Array) -> None:
        """Give up a curve of solutions u (P, n + 1) that so few unknowns cannot tell."""
        relative = relative_errors(u[:, :-1], error)
        if (relative > MAX_RELATIVE_TRUNCATION_ERROR).any() and self._may_refine():
            first = int(np.argmax(relative > MAX_RELATIVE_TRUNCATION_ERROR))
            raise _UnderResolved(self.problem, f"an error of {relative[first]:.0%} at {self.name} = {u[first, -1]:.6g}")

    def _may_refine(self) -> bool:
        """Whether the bound of the work allows to follow the curve with more unknowns."""
        finer = self.problem.refined_problem
        return finer is not None and self.work.affords(finer.size or 0, _CURVE)

    def _observed_alone(self, row: CurvePoint, problem: ContinuationProblem) -> dict[str, Any]:
        try:
            return observe_all(problem, row.u[None], self.name, self.fixed, self.stability)[0]
        except Exception as error:
            if row is self.first:
                self.first_unseen = error
                raise
            self.ending.record_error(error, f"in observing the motion at {self.name} = {row.value:.6g}")
            return {}

    # ---- main loop

    def run(self) -> Branch:
        """Trace until something ends it; what was traced survives whatever that is."""
        branch = self.traced()
        if isinstance(self.ending.error, _CallbackError):
            raise self.ending.error.with_branch(branch)
        return branch

    def traced(self) -> Branch:
        """`run`, which leaves an exception of the user's own progress to whoever asks."""
        try:
            self._work()
        except (Exception, KeyboardInterrupt) as error:
            self.ending.record_error(error, self._place())
        if self.first_unseen is not None:
            raise self.first_unseen
        while True:
            try:
                return self._result()
            except KeyboardInterrupt as error:  # all would be lost, and it takes no time
                self.ending.record_error(error, "while the result was put together")

    def _work(self) -> None:
        """All that takes time: Ctrl-C or an error ends one stage, and the next goes on with what there is."""
        for stage, place in (
            (self._follow, self._place),
            (self._settle_the_rest, lambda: "while the last motions were being looked at"),
            (self._complete, lambda: "while the special points were being looked at"),
            (self._finish, lambda: "while the curve was looked at as a whole"),
            (self._cover, lambda: "while the rest of the span was looked at"),
        ):
            try:
                stage()
            except (Exception, KeyboardInterrupt) as error:
                self.ending.record_error(error, place())

    def _place(self) -> str:
        return f"at {self.name} = {self.rows[-1].value:.6g}"

    def _follow(self) -> None:
        """Trace until something ends it."""
        if self.ahead:
            self._append(self.ahead)
        elif self.together == 1:
            self._settle()
        self._adapt()
        self.first = self.rows[0]
        self.step = self.steps.first_step
        self.ending.record_end(*self._loop())

    def _complete(self) -> None:
        """Observe what is not yet: special points, and rows whose turn did not come."""
        self._observe(self.rows)
        self._observe([point.row for _, point in self.found])
        for _, point in self.found:
            if point.sharp is not None:
                self._observe([point.sharp.row], point.sharp.problem)

    def _finish(self) -> None:
        """Let the problem say what there is to say of the whole curve: its jumps, and what is hardly meant."""
        self.made = self._branch()
        if self.special:
            self.made = replace(self.made, jump_records=find_jumps(self.made, self.settings))
        seen = [row.observed for row in self.rows] if self.special and self.whole else []
        self.made = self.largest.postprocess(self.made, seen)

    def _cover(self) -> None:
        """Look for other curves where this one leaves something of the span."""
        if not self.cover or self.made is None or self.ending.error or self.ending.status not in UNCOVERED:
            return
        search = CoverageSearch(self._followed, self._departure, self.settings if self.special else None)
        cover_span(self.made, self.others, (self.a, self.b), search, inside=not self.is_nonsmooth)
        self.remark = coverage_message(self.made, self.others, (self.a, self.b), inside=not self.is_nonsmooth)
        near = _AT_ITS_END * abs(self.b - self.a)
        for other in self.others if self.ending.status is Status.STEP_TOO_SMALL else ():
            if other.status is Status.ARBITRARY and abs(other.values[-1] - self.rows[-1].value) <= near:
                self.ending.record_end(Status.ARBITRARY, f"{other.message}; this curve ends there")

    def _followed(self, span: tuple[float, float], start: BranchStart | None, rough: bool) -> Branch:
        """Another curve of the span; what interrupts it interrupts this one."""
        least: dict[str, Any] = {"stability": False, "special": False, "events": ()} if rough else {}
        words = ""
        try:
            other = self.another(self.original, span=span, start=start, strict=self.strict, **least)
        except _Arbitrary as found:
            other, words = self.another(found.problem, span=span, start=found.X, **least), found.words
        branch = other.traced()
        if words and branch.status.complete:
            branch = replace(branch, status=Status.ARBITRARY, message=f"{words}; {branch.message}")
        if isinstance(other.ending.error, KeyboardInterrupt | _CallbackError):
            self.others += [branch]
            raise other.ending.error
        return branch

    def _departure(self, value: float, near: Array | None) -> BranchStart:
        """A solution at a value of the parameter, to go up from in it."""
        here, problem = {**self.fixed, self.name: value}, self.original
        near = self._anywhere(here) if near is None else problem.resized(near)
        X = solve(problem, near, here, "", self.settings).X
        return BranchStart(X, here, np.append(np.zeros(len(X)), 1.0), away=False)

    def _branch(self) -> Branch:
        meta = {
            "span": [self.a, self.b], "steps": vars(self.steps), "newton": vars(self.settings),
            "stability": self.stability, "accuracy": self.accuracy, "special": self.special,
        }  # fmt: skip
        status, message = self.ending.status, self.ending.message_with_advice
        made = build_branch(self.largest, self.name, self.fixed, *self._record(), status, message, meta)
        return made if self.asymptote is None else replace(made, meta=with_asymptotes(made.meta, last=self.asymptote))

    def _result(self) -> Branch:
        made = self.made or self._branch()
        message = "; ".join(text for text in (self.ending.message_with_advice, self.remark, self.work.message) if text)
        if not self.others and (made.status, made.message) == (self.ending.status, message):
            return made
        return replace(made, status=self.ending.status, message=message, others=tuple(self.others))

    def _loop(self) -> tuple[Status, str]:
        while True:
            if len(self.rows) >= self.steps.max_points:
                return Status.MAX_POINTS, f"{len(self.rows)} points, at {self.name} = {self.rows[-1].value:.6g}"
            path, reason = self._advance()
            path, far = self._to_infinity(path)
            if len(path) == 1:
                status = Status.RETRACED if reason == _BACK else Status.STEP_TOO_SMALL
                where = f"{reason} at {self.name} = {self.rows[-1].value:.6g}; the shortest step was tried"
                return status, where + self._corner_ahead()
            ended = self._through(path)
            if ended is not None:
                if self.stop is None:
                    self._adapt(last=True)
                return ended
            if far is not None:
                self.asymptote = far
                return Status.UNBOUNDED, f"the curve runs off to infinity towards {self.name} = {far:.6g}"
            sizes = self.problem.solution_norms(unknowns(path)[1:, :-1])
            self.top = max(self.top, float(sizes.max()))
            self.scale = self._scale(self.rows[-1].X)
            self._adapt()

    def _corner_ahead(self) -> str:
        """Go on to the special point that no step reaches, if there is one just beyond the last row; what it is."""
        if len(self.rows) < 2 or not self.watch.passing:
            return ""
        self._settle()
        arc = self._arc(self._as_now(self.rows[-2]), self.rows[-1])
        point = self.watch.ahead(arc)
        if point is None:
            return ""
        self.is_nonsmooth = True
        (self.stop,) = self._assessed(arc, [point])
        self.rows += [self.stop.row]
        return f". It turns sharply at {self.name} = {point.value:.9g}, {point.event.meaning} ({point.note})"

    def _through(self, path: Points) -> tuple[Status, str] | None:
        """Go on to new rows, those at which nothing can end together; status and message if the curve ends there.

        path : the last row, and the new ones.
        """
        rows, done = path[1:], 0
        for i in self._watched(path):
            if done < i:
                self._append(rows[done:i])
            ended = self._take(rows[i])
            if ended is not None:
                return ended
            done = i + 1
        if done < len(rows):
            self._append(rows[done:])
        return None

    def _watched(self, path: Points) -> Sequence[int]:
        """Numbers of the new rows at which the curve may end: outside, where it turns, or then near its first row."""
        if self.progress or self.watch.terminal or self.landed is not None or len(path) == 2:
            return range(len(path) - 1)
        u, heading = unknowns(path), np.array([row.heading for row in path])
        turns, value = heading[1:] != heading[:-1], u[1:, -1]
        outside = (self.sense * (value - self.b) >= 0) | (self.sense * (value - self.a) < 0)
        length = norms((u[1:] - u[:-1]) / self.scale)
        near = np.abs(value - self.first.value) <= _AROUND * length * self.scale[-1]
        turned = np.logical_or.accumulate(turns) | self.turned
        watched: list[int] = np.flatnonzero(outside | turns | (near & turned)).tolist()
        return watched

    def _take(self, row: CurvePoint) -> tuple[Status, str] | None:
        """Go on to a row; status and message if the curve ends there."""
        last = self.rows[-1]
        row = self._turn_outside(last, row)
        end = self._outside(row.value)
        if self.landed is not None:
            end = self.landed
        elif end is not None:
            row = self._final(last, row, end)
        closed = end is None and self._closes(last, row)
        if closed:
            row = self._closing(last)
        arc = self._arc(last, row)
        stop = self.watch.ends(arc) if self.watch.terminal else None
        if stop is not None:
            (stop,) = self._assessed(arc, [stop])
            return self._end_at(stop)
        self._append([row])
        if closed and self.branch_direction is not None and self.branch_direction.event is not None:
            self._settle()
            (self.stop,) = self._assessed(arc, [LocatedEvent(self.branch_direction.event, 1.0, row, True)])
        if self.progress:
            self._tell(row, self.progress)
        if end is not None:
            if end == self.b:
                return Status.REACHED_END, f"{self.name} = {end:.6g} reached"
            return Status.LEFT_SPAN, f"the curve turned back to {self.name} = {end:.6g}"
        return (Status.CLOSED, f"the curve closed after {len(self.rows)} points") if closed else None

    def _closing(self, last: CurvePoint) -> CurvePoint:
        """The first row as the last one; if it is a special point, with the sides on which the curve comes to it."""
        row = self._as_now(self.first)
        if self.branch_direction is None:
            return row
        return replace(row, heading=last.heading, orientation=last.orientation)

    def _tell(self, row: CurvePoint, progress: ProgressCallback) -> None:
        """Call the user's progress; an exception of theirs is told from all others."""
        try:
            progress(self._progress(row))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise _CallbackError(error) from error

    def _progress(self, row: CurvePoint) -> Progress:
        """How far the trace is at a point."""
        done = min(max((row.value - self.a) / (self.b - self.a), 0.0), 1.0)
        text = f"{self.name} = {row.value:.5f}, {len(self.rows)} points, step {row.step:.1e}"
        return Progress(done, text, {"value": row.value, "points": len(self.rows), "step": row.step})

    def _end_at(self, stop: LocatedEvent) -> tuple[Status, str]:
        """Go on to the point of a terminal event."""
        if stop.event.alone:
            self._settle()
            self.rows += [stop.row]
        else:
            self._append([stop.row])
        self.stop = stop
        return stop.event.ending(self.name, stop.row.value)

    def _advance(self) -> tuple[Points, str]:
        """The last row and the next ones, or none and the reason why even the shortest step failed."""
        low, high = sorted((self.a, self.b))
        single = self.together == 1
        strider = Stepper(self.problem, self.name, self.fixed, (low, high), self.steps, self.settings, single)
        last = [self.rows[-1], *(self._as_now(row) for row in self.rows[-2 : -1 - self.steps.predictor_points : -1])]
        most = min(self.steps.max_points - len(self.rows), self.together)
        while True:
            tried = self.step
            rows, self.step, reason = strider.stride(last, self.scale, self.top, tried, most)
            path = Points([last[0], *rows])
            kept = self._before_running_back(path)
            if kept < len(rows):
                shorter = max(0.5 * rows[kept].step, self.steps.min_step)
                path, reason, self.step = Points(path[: kept + 1]), _BACK, shorter
            if len(path) == 1 and (row := self._at_the_range_end(tried)):
                return Points([last[0], row]), ""
            if len(path) > 1 or tried <= self.steps.min_step or reason != _BACK:
                return path, reason

    def _at_the_range_end(self, step: float) -> CurvePoint | None:
        """The row at the end of the parameter's range that a step would cross: nothing can be evaluated beyond it."""
        last = self.rows[-1]
        unit = last.tangent / norm(last.tangent / self.scale)
        beyond = last.value + step * unit[-1]
        end = next((x for x in (self.a, self.b) if (x - last.value) * (x - beyond) < 0), None)
        if end is None or math.nextafter(end, beyond) in self.range:
            return None
        guess = last.u + (end - last.value) / unit[-1] * unit
        try:
            solution = solve(self.problem, guess[:-1], {**self.fixed, self.name: end}, self.name, self.settings)
            row = point_from_solution(solution, normal_of(unit, self.scale), self.scale, step, last)
        except (ValueError, NoConvergence, np.linalg.LinAlgError):
            return None
        apart = norm((row.u - last.u) / self.scale)
        if apart > 2 * step or cosine(row, last, self.scale) < _TURNED * norm(row.tangent / self.scale) * norm(
            last.tangent / self.scale
        ):
            return None
        self.landed = end
        return row

    def _append(self, rows: list[CurvePoint]) -> None:
        """Store rows; what lies between them and the last is looked at when enough have come together."""
        pieces, heading = [(self.problem, self.scale)] * len(rows), self.rows[-1].heading
        self.turned = self.turned or any(row.heading != heading for row in rows)
        self.waiting += pieces  # no call, and so no Ctrl-C, comes between this and the next
        self.rows += rows
        if len(self.waiting) >= self.together:
            self._settle()
        if self.problem.unknown_parameters:
            self.problem = self.problem.with_borders_at(
                rows[-1].X, {**self.fixed, self.name: rows[-1].value}, renew=True
            )

    def _settle_the_rest(self) -> None:
        """`_settle` at the end; row by row if Ctrl-C ended the trace, and only as far as that takes no time.

        What happens between two rows can take minutes to look at; rows that are left out for it are found again in no
        time by whoever goes on from the one before.
        """
        if not isinstance(self.ending.error, KeyboardInterrupt):
            self._settle()
            return
        settled = len(self.rows) - len(self.waiting)
        rest = list(zip(self.rows[settled:], self.waiting, strict=True))
        del self.rows[settled:]
        self.waiting = []
        self._settle()
        end = time.monotonic() + (_PATIENCE if self.together > 1 else 0.0)
        for row, piece in rest:
            if time.monotonic() >= end:
                break
            self.rows.append(row)
            self.waiting = [piece]
            self._settle()

    def _settle(self) -> None:
        """Observe the rows that wait and find the special points between them."""
        start = len(self.rows) - len(self.waiting) - 1
        path = self.rows[start:]
        self._observe(path)
        self._decide(path)
        found = self._search(start)
        if self._verify(start, found):
            found = self._search(start)
        if self.together == 1:  # the problem may be another one at the next row
            fresh = [point.row for points in found.values() for point in points]
            self._observe([row for row in fresh if len(row.u) == len(self.scale)])
        self._look_between(found)
        before = [one for one in self.found if one[0] not in found]
        self.waiting, self.found = [], before + [(i, point) for i, points in found.items() for point in points]

    def _search(self, start: int) -> dict[int, list[LocatedEvent]]:
        """Special points on the pieces that wait, behind row number start, by the number of the row behind."""
        found: dict[int, list[LocatedEvent]] = {}
        if self.watch.passing and self.waiting:
            before = max(start - 2, 0)  # with two rows on either side of the last segment, for test functions bend
            rows = Points(self.rows[before:])
            for i in self.watch.sign_changes(rows):
                number = i + 1 + before
                if number > start:
                    problem, scale = self.waiting[number - start - 1]
                    arc = Segment(problem, self.name, self.fixed, rows[i], rows[i + 1], scale, self.settings)
                    found[number] = self._located(arc)
            self._look_closer(rows, before, found)
        return found

    def _verify(self, start: int, found: Mapping[int, list[LocatedEvent]]) -> bool:
        """Decide points again that contradict the special points between them; returns whether a verdict changed.

        They do if the verdicts of neighbours differ without a special point between them, or if both sides of a fold
        are stable.
        """
        if not (self.stability and self.special) or self.accuracy is None:
            return False
        path = self.rows[start:]
        codes = _codes(path)
        doubtful = set[int]()
        for i in range(1, len(path)):
            kinds = [
                point.event.kind for point in found.get(start + i, []) if point.event.kind in STABILITY_CHANGING_KINDS
            ]
            changed = {codes[i - 1], codes[i]} == {UNSTABLE, STABLE} and not kinds
            both = codes[i - 1] == codes[i] == STABLE and kinds == [FoldEvent.kind]
            if changed or both:
                doubtful |= {i - 1, i}
        again = [path[i] for i in sorted(doubtful) if not path[i].observed.get("contradicts")]
        for row in again:
            row.observed["contradicts"] = True
            row.observed.pop("modulus_error", None)
        self._decide(again)
        return bool(again) and _codes(path) != codes

    def _decide(self, path: list[CurvePoint]) -> None:
        """Make sure of the stability of rows that were observed just now."""
        fresh = [row for row in path if "multipliers" in row.observed and "modulus_error" not in row.observed]
        if self.accuracy is None or not fresh:
            return
        u = np.array([row.u for row in fresh])
        for row in fresh:
            row.observed["determinant"] = row.determinant
        try:
            self.problem.decided(u[:, :-1], self.name, u[:, -1], [row.observed for row in fresh], self.fixed, self.work)
        except Exception as error:
            self.ending.record_error(error, f"in making sure of the stability near {self.name} = {u[-1, -1]:.6g}")

    def _assessed(self, arc: Segment, found: list[LocatedEvent]) -> list[LocatedEvent]:
        """Special points of a piece with their errors, solved for as accurately as is wanted."""
        if self.accuracy is None:
            return found
        out = [estimate_error(arc, point, self.accuracy, self.work) for point in found]
        if self.strict and arc.problem.smooth:
            self._check_found(arc, out)
        return out

    def _check_found(self, arc: Segment, found: list[LocatedEvent]) -> None:
        """Give up a curve with special points that solutions with more unknowns do not have, or far from there."""
        for point in found:
            if point.error > SPURIOUS_POINT_ERROR * arc.problem.unit_of(self.name, point.value) and self._may_refine():
                where = f"{self.name} = {point.value:.6g}"
                raise _UnderResolved(self.problem, f"it open whether there is the {point.event.kind} near {where}")

    def _located(self, arc: Segment) -> list[LocatedEvent]:
        """The special points on a piece; none if an error ends the search, which is noted."""
        try:
            return self._assessed(arc, self._with_enough(arc, self.watch.find(arc)))
        except Exception as error:
            ends = f"{self.name} = {arc.a.value:.6g} and {arc.b.value:.6g}"
            self.ending.record_error(error, f"in locating a special point between {ends}")
            return []

    def _with_enough(self, arc: Segment, found: list[LocatedEvent]) -> list[LocatedEvent]:
        """Special points of a piece, located again with more unknowns where their observations ask for more."""
        while arc.problem.changes:
            self._observe([point.row for point in found], arc.problem)
            asked = [arc.problem.adapted(point.row.observed) for point in found if point.located]
            finer = max((p for p in asked if p is not None), key=_size, default=arc.problem)
            if _size(finer) <= _size(arc.problem):
                break
            a, b = (self._solved_again(finer, row) for row in (arc.a, arc.b))
            if a is None or b is None:
                break
            arc = Segment(finer, self.name, self.fixed, a, b, self._wide(finer), self.settings)
            again = self.watch.find(arc)
            if [point.event.kind for point in again] != [point.event.kind for point in found]:
                break
            found, self.largest = again, max(self.largest, finer, key=_size)
        return found

    def _look_closer(self, rows: Points, first: int, found: dict[int, list[LocatedEvent]]) -> None:
        """Add what happens twice between two rows, of which the first is number ``first``, and so shows at neither.

        What is found so divides its piece, on whose parts the next may show, as it may on the pieces beside it.

        found : what is known of its pieces; replaced where there is more.
        """
        if len({len(row.u) for row in rows}) > 1:
            return
        known = {**found}
        for number, point in self.found:
            if number > first and number not in found:
                known[number] = [*known.get(number, []), point]
        pieces: Sequence[int] = range(len(rows) - 1)

        @cache  # a look asks for the same rows as the one before
        def between(piece: int, s: float) -> CurvePoint | None:
            return self._row_at(self._arc(rows[piece], rows[piece + 1]), s)

        for _ in range(_LOOKS):
            fresh = self._hidden(rows, first, known, pieces, between)
            found.update(fresh)
            known.update(fresh)
            pieces = sorted({number - first - 1 + beside for number in fresh for beside in (-1, 0, 1)})
            if not pieces:
                break

    def _hidden(
        self, rows: Points, first: int, known: Mapping[int, list[LocatedEvent]], pieces: Sequence[int],
        between: Callable[[int, float], CurvePoint | None],
    ) -> dict[int, list[LocatedEvent]]:  # fmt: skip
        """What is known of some pieces, of those on which there is more than that, by the number of the row behind.

        between : as of `Path.through`.
        """
        points = {(number - first - 1, one.s): one for number, some in known.items() for one in some
                  if one.located and 0 < one.s < 1 and len(one.row.u) == len(self.scale)}  # fmt: skip
        self._observe([point.row for point in points.values()])
        path, found = SampledCurve.through(rows, points, between), dict[int, list[LocatedEvent]]()
        for piece, parts in path.unseen(self.watch, rows).items():
            if piece not in pieces:
                continue
            arcs = [(self._arc(*path.rows[k : k + 2]), event) for k, event in parts]
            number = first + piece + 1
            others = known.get(number, [])
            hidden = [(arc, point) for arc, event in arcs for point in event.find(arc)
                      if point.located and not any(_coincide(point, other) for other in others)]  # fmt: skip
            sure = self._sure(hidden, self._arc(rows[piece], rows[piece + 1]))
            fresh = drop_odd_counts(sure, made_up=any(one.event.kind in STABILITY_CHANGING_KINDS for one in others))
            if fresh:
                found[number] = sorted([*others, *fresh], key=lambda point: point.s)
        for k, hints in path.hints(self.watch, rows, self.scale).items():
            piece, low, high = path.ends(k)
            if piece not in pieces:
                continue
            hidden = find_even_crossings(self.watch, self._arc(*path.rows[k : k + 2]), hints, self._row_at, path, k)
            number, whole = first + piece + 1, self._arc(rows[piece], rows[piece + 1])
            others = found.get(number, known.get(number, []))
            kept = [point for point in others if not low < point.s < high]
            fresh = self._sure(hidden, whole)
            fresh = fresh if len(kept) < len(others) or any(path.kinds[k : k + 2]) else drop_odd_counts(fresh)
            if len(fresh) > len(others) - len(kept):
                found[number] = sorted(kept + fresh, key=lambda point: point.s)
        return found

    def _look_between(self, found: Mapping[int, list[LocatedEvent]]) -> None:
        """A row between neighbouring points of a piece at which stability may change: no other tells of the stretch."""
        for number, points in found.items() if self.stability else ():
            ends = [one for one in sorted(points, key=lambda one: one.s)
                    if one.event.kind in STABILITY_CHANGING_KINDS and one.located
                    and 0 < one.s < 1 and len(one.row.u) == len(self.scale)]  # fmt: skip
            rows = [(0.5 * (a.s + b.s), self._row_at(self._arc(a.row, b.row), 0.5)) for a, b in pairwise(ends)]
            self.between[number] = [(s, row) for s, row in rows if row is not None]
            self._decide([row for _, row in self.between[number]])

    def _sure(self, hidden: Sequence[tuple[Segment, LocatedEvent]], whole: Segment) -> list[LocatedEvent]:
        """Points found on parts of a piece, those that more unknowns have too, at their places on the whole of it."""
        sure = (self._confirmed(arc, point) for arc, point in hidden)
        return [replace(point, s=whole.place(point.row.u)) for point in sure if point is not None]

    def _confirmed(self, arc: Segment, point: LocatedEvent) -> LocatedEvent | None:
        """A point that no change of sign between rows told of, with its error; None if more unknowns do not have it."""
        if self.accuracy is None:
            return point
        refused = self.work.refused
        judged = estimate_error(arc, point, self.accuracy, self.work)
        refined = judged.sharp is not None or self.work.refused > refused  # a refusal is no evidence against a point
        most = max(self.accuracy, SPURIOUS_POINT_ERROR) if refined else self.accuracy
        return None if judged.error > most * arc.problem.unit_of(self.name, judged.row.value) else judged

    def _row_at(self, arc: Segment, s: float) -> CurvePoint | None:
        """The row at a share of a piece, observed; None if it cannot be solved for."""
        try:
            row = arc.at(s)
            self._observe([row])
        except (NoConvergence, np.linalg.LinAlgError):
            return None
        return row

    def _record(self) -> tuple[list[CurvePoint], list[SpecialPointMark]]:
        """All rows, the located special points among them, and the marks of these."""
        rows: list[CurvePoint] = []
        marks: list[SpecialPointMark] = []
        found: list[tuple[int, float, LocatedEvent | CurvePoint]] = [
            (i, point.s, point) for i, point in (self._placed(*one) for one in self._single())
        ]
        found += [(i, s, row) for i, some in self.between.items() for s, row in some]
        found.sort(key=lambda one: one[:2])
        for i, row in enumerate(self.rows):
            while found and found[0][0] == i:
                point = found.pop(0)[2]
                if isinstance(point, CurvePoint):
                    rows.append(point)
                    continue
                if point.located:
                    rows.append(point.row)
                interval = (self.rows[i - 1].value, row.value)
                marks.append(SpecialPointMark(len(rows) - 1, point, interval))
            rows.append(row)
        if self.stop is not None and self.rows[-1].u is self.stop.row.u:
            interval = (self.rows[-2].value, self.rows[-1].value)
            marks.append(SpecialPointMark(len(rows) - 1, self.stop, interval))
        return rows, marks

    def _single(self) -> list[tuple[int, LocatedEvent]]:
        """Special points, but of those that more unknowns take for one only that which they move least."""
        out: list[tuple[int, LocatedEvent]] = []
        for here in self.found:
            same = next((i for i, (_, other) in enumerate(out) if _same(here[1], other)), None)
            if same is None:
                out.append(here)
            elif _shift(here[1]) < _shift(out[same][1]):
                out[same] = here
        return out

    def _placed(self, number: int, point: LocatedEvent) -> tuple[int, LocatedEvent]:
        """A special point on the piece that it lies on: its equations may put it beyond the one it was found on."""
        for _ in range(_FARTHEST):
            on = number + (point.s > 1) - (point.s < 0)
            if on == number or not 0 < on < len(self.rows):
                break
            a, b = self.rows[on - 1 : on + 1]
            if not len(a.u) == len(b.u) == len(point.row.u) == len(self.scale):
                break
            arc = self._arc(a, b)
            s, before = arc.place(point.row.u), self._arc(*self.rows[number - 1 : number + 1])
            corner = (s - 0.5) * (point.s - 0.5) < 0  # between the two, beyond the end of both chords
            if not corner or _beyond(s) * arc.length < _beyond(point.s) * before.length:
                number, point = on, replace(point, s=s)
            if corner:
                break
        return number, point

    def _adapt(self, last: bool = False) -> None:
        """Give the last row as many unknowns as its observations ask for; not fewer, if it is the last of the curve."""
        while True:
            before = self.problem, self.scale, self.rows[-1]
            other = self.problem.adapted(self.rows[-1].observed)
            if other is None or (last and _size(other) < _size(self.problem)) or not self._to(other, last):
                return
            if len(self.rows[-1].u) < len(before[2].u):  # fewer: keep them only if they suffice
                if self.problem.adapted(self.rows[-1].observed) is not None:
                    self.problem, self.scale, self.rows[-1] = before
                return
            self.largest = max(self.largest, self.problem, key=_size)

    def _to(self, problem: ContinuationProblem, still: bool) -> bool:
        """Solve the last row again with other unknowns and go on with that problem; False if that fails."""
        row = self._solved_again(problem, self.rows[-1], still)
        if row is None:
            return False
        self.problem, self.scale, self.rows[-1] = problem, self._wide(problem), row
        return True

    def _solved_again(self, problem: ContinuationProblem, last: CurvePoint, still: bool = False) -> CurvePoint | None:
        """A row with the unknowns of another problem, observed; None if that fails.

        still : at its value of the parameter, as the ends of the curve; else in the plane across the curve.
        """
        try:
            row = resolve_at_resolution(last, problem, self.name, self.fixed, self._wide(problem), self.settings, still)
        except (NoConvergence, np.linalg.LinAlgError):
            return None
        self._observe([row], problem)
        return row

    def _wide(self, problem: ContinuationProblem) -> Array:
        """The present scales for the unknowns of another problem."""
        return rescaled(self.scale, problem, _size(problem))

    def _as_now(self, row: CurvePoint) -> CurvePoint:
        """An earlier row in the present number of unknowns."""
        if len(row.u) == len(self.scale):
            return row
        fit = self.problem.resized
        u, t = np.append(fit(row.u[:-1]), row.u[-1]), np.append(fit(row.tangent[:-1]), row.tangent[-1])
        return replace(row, u=u, tangent=t)

    def _arc(self, last: CurvePoint, row: CurvePoint) -> Segment:
        return Segment(self.problem, self.name, self.fixed, last, row, self.scale, self.settings)

    # ---- ends

    def _to_infinity(self, path: Points) -> tuple[Points, float | None]:
        """The path up to where the curve is seen to run off to infinity, and the value of the parameter it nears."""
        last = path[-1]
        if len(path) == 1 or self._motion_size(last.X) <= self.top or self._outside(last.value) is not None:
            return path, None
        if vertical_asymptote(self.problem, self.name, self.fixed, last) is None:
            return path, None
        for i, row in enumerate(path[1:], 1):
            far = vertical_asymptote(self.problem, self.name, self.fixed, row)
            if far is not None and self._outside(far) is None:
                return Points(path[: i + 1]), far
        return path, None

    def _outside(self, value: float) -> float | None:
        """The end of the span that a value lies on or beyond, if any."""
        if self.sense * (value - self.b) >= 0:
            return self.b
        if self.sense * (value - self.a) < 0:
            return self.a
        return None

    def _turn_outside(self, last: CurvePoint, row: CurvePoint) -> CurvePoint:
        """The row; or the fold before it, where that lies outside the span and the step came back into it."""
        if last.heading * row.heading >= 0:
            return row
        arc = self._arc(last, row)
        near = arc.guess(np.arange(1, 8)[:, None] / 8)[:, -1].tolist()
        reach = max(near) - min(near)
        if all(self._outside(x + d) is None for x in near for d in (-reach, reach)):
            return row
        for found in FoldEvent().find(arc):
            if found.located and self._outside(found.row.value) is not None:
                return found.row
        return row

    def _final(self, last: CurvePoint, row: CurvePoint, end: float) -> CurvePoint:
        """CurvePoint exactly at the end of the span, solved at fixed parameter from between the last two rows."""
        arc, here = self._arc(last, row), {**self.fixed, self.name: end}
        s = (end - last.value) / (row.value - last.value)
        try:
            guess = far_side_of_fold(arc, end) if last.heading * row.heading < 0 else arc.guess(s)
            solution = solve(self.problem, guess[:-1], here, self.name, self.settings)
            solution = refine(self.problem, solution, here, self.name)
            final = point_from_solution(solution, normal_of(row.u - last.u, self.scale), self.scale, s * row.step, last)
        except (NoConvergence, np.linalg.LinAlgError):
            return row
        return final

    def _closes(self, last: CurvePoint, row: CurvePoint) -> bool:
        """Whether the piece from last to row passes through the first row, in its direction."""
        if len(self.rows) < 4 or not self.turned:
            return False
        length = norm((row.u - last.u) / self.scale)
        if abs(self.first.value - row.value) > _AROUND * length * self.scale[-1]:
            return False
        first = self._as_now(self.first)
        return cosine(row, first, self.scale) > 0 and self._arc(last, row).passes(first)

    def _before_running_back(self, path: Points) -> int:
        """How many of the new rows, behind the first of a path, come before the curve runs back over an earlier row."""
        turned = self.turned or any(row.heading != path[0].heading for row in path)
        if len(self.rows) < 4 or not turned:
            return len(path) - 1
        earlier, u = self._earlier() / self.scale, unknowns(path) / self.scale
        apart = np.square(earlier).sum(axis=1)[:, None] - 2 * earlier @ u.T + np.square(u).sum(axis=1)
        reach = np.square(u[1:] - u[:-1]).sum(axis=1)
        for k in np.flatnonzero((apart[:, 1:] < _NEAR * reach).any(axis=0)):
            if self._runs_back(path[k], path[k + 1], earlier):
                return int(k)
        return len(path) - 1

    def _runs_back(self, last: CurvePoint, row: CurvePoint, earlier: Array) -> bool:
        """Whether the piece passes through an earlier row (``earlier``: all, scaled) in the other direction."""
        chord = (row.u - last.u) / self.scale
        offsets = earlier - last.u / self.scale
        s = np.clip(offsets @ chord / (chord @ chord), 0, 1)
        away = offsets - s[:, None] * chord
        near = np.flatnonzero(np.einsum("ij,ij->i", away, away) < 0.01 * (chord @ chord))
        others, arc = [self._as_now(self.rows[i]) for i in near], self._arc(last, row)
        return any(cosine(row, other, self.scale) < 0 and arc.passes(other) for other in others)

    def _earlier(self) -> Array:
        """Unknowns (P, n + 1) of all rows but the last three, in the present number of unknowns."""
        count, width = len(self.rows), len(self.scale)
        if self.path.shape[1] != width:
            self.path, self.kept = np.empty((0, width)), 0
        if count > len(self.path):
            self.path = np.concatenate([self.path, np.empty((count, width))])
        for i in range(self.kept, count):
            self.path[i] = self._as_now(self.rows[i]).u
        self.kept = count
        return self.path[: count - 3]


class _Arbitrary(NoConvergence):
    """The first solution is one of a continuum; the problem chooses one of them, and words say what is arbitrary."""

    def __init__(self, X: Array, parameters: Mapping[str, float], problem: ContinuationProblem, words: str) -> None:
        super().__init__(words, X, parameters, [])
        self.problem, self.words = problem, words


class _UnderResolved(BaseException):
    """Solutions are too rough for the curve to be worth its end: no error, and no stage of a trace goes on after it."""

    def __init__(self, problem: ContinuationProblem, left: str) -> None:
        self.finer = problem.refined_problem or problem
        super().__init__(f"followed with {self.finer.resolution}, for {problem.resolution} leaves {left}")


class _CallbackError(Exception):
    """An exception of the user's own progress."""

    def __init__(self, given: BaseException) -> None:
        super().__init__(f"in progress, {type(given).__name__}: {given}")
        self.given = given

    def with_branch(self, branch: Branch) -> BaseException:
        """The exception as it was raised, with what was traced as its attribute ``branch``."""
        self.given.branch = branch  # type: ignore[attr-defined]
        self.given.add_note(f"what was traced until then ({len(branch)} points) is this exception's attribute branch")
        return self.given


_AT_ITS_END = 1e-3  # share of the span between the ends of a curve and of one on which something is arbitrary


def _codes(rows: Sequence[CurvePoint]) -> list[int]:
    """Codes of the verdicts of observed rows; see `stability_codes`."""
    sets = [row.observed.get("multipliers") for row in rows]
    if len({None if mu is None else len(mu) for mu in sets}) > 1:  # compare the largest alone
        sets = [None if mu is None else mu[[np.abs(mu).argmax()]] for mu in sets]
    none = np.full(next((len(mu) for mu in sets if mu is not None), 1), np.nan + 0j)
    multipliers = np.array([none if mu is None else mu for mu in sets])
    errors = [row.observed.get("modulus_error", math.nan) for row in rows]
    codes: list[int] = stability_codes(multipliers, np.array(errors)).tolist()
    return codes


_LOOKS = 4  # times that the parts of a piece are looked at once more for what they hide


_PATIENCE = 0.3  # seconds that rows are still looked at after Ctrl-C


_FARTHEST = 64  # pieces, some of them very short, by which a special point may lie beyond the one it was found on


def _beyond(s: float) -> float:
    """How far a place on a piece lies beyond its ends, over its length."""
    return max(-s, s - 1.0)


_BACK = "the curve ran back over itself"


_TURNED = 0.9  # least cosine of the turn on the last step to the end of a parameter's range


_NEAR = 1.3  # squared distance from its end, in its length squared, that what lies beside a piece may have


_AROUND = 1.1  # distance from its end, in its length, that a row on a piece may have


def _same(one: LocatedEvent, other: LocatedEvent) -> bool:
    """Whether two special points, with the same number of unknowns, are one; where it crosses itself a curve has two.

    Where multipliers change so fast that their determinants change sign back and forth, Newton ends at one each time.
    """
    if (one.event.kind, one.note) != (other.event.kind, other.note) or one.event.kind == BranchPointEvent.kind:
        return False
    u, v = ((point.sharp or point).row.u for point in (one, other))
    return one.located and other.located and _alike(u, v)


def _coincide(one: LocatedEvent, other: LocatedEvent) -> bool:
    """Whether two points of a kind on a piece are one as they were found, whatever more unknowns make of them.

    Two multipliers that pass together do so once: there the equations are singular, and tell few digits.
    """
    together = one.finder is not None and other.finder is not None
    return one.event.kind == other.event.kind and (together or _alike(one.row.u, other.row.u))


def _shift(point: LocatedEvent) -> float:
    """How far more unknowns put a point from where it was found."""
    return abs(point.sharp.row.value - point.row.value) if point.sharp else 0.0


def _alike(u: Array, v: Array) -> bool:
    """Whether two rows are the same up to rounding."""
    return len(u) == len(v) and norm(u - v) <= 1e-6 * norm(u)


def _size(problem: ContinuationProblem) -> int:
    """Number of unknowns of a problem that can change it."""
    return problem.size or 0


def _check_start(problem: ContinuationProblem, X: Array) -> None:
    if not np.all(np.isfinite(X)):
        raise ValueError("the start has entries that are not finite")
    if problem.size is not None and X.shape != (problem.size,):
        raise ValueError(
            f"the start has {X.size} unknowns; the problem has {problem.size}. Start from a Point, which is converted "
            "to this number, or from unknowns of the right length"
        )


def _checked_span(parameter: str, span: tuple[float, float], allowed: Range) -> tuple[float, float]:
    a, b = map(float, span)
    if a == b:
        raise ValueError(f"span = ({a}, {b}) is empty; give two different values of {parameter}")
    if a not in allowed or b not in allowed:
        raise ValueError(f"span = ({a}, {b}): {parameter} must {allowed}")
    return a, b
