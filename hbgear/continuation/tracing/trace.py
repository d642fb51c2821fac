"""Pseudo-arclength continuation: trace the solutions of a problem while one parameter changes.

    R(X, p) = 0,   n (u - u_predicted) = 0        u = (X, p), n normal of the plane across the predicted direction

Unknowns are scaled so that the span of the parameter and the size of the solution are one. The step size is adapted
to the number of corrector iterations, the angle between successive tangents and the prediction error. A step that turns
too far, lands too far from its prediction or retraces the curve is repeated with half the step size. The tangent passes
folds without a change of parameter. Special points are located between the points, ends of the curve are tested at
every point.

`Tracer` coordinates one trace. Its parts share one `TraceState`: `first_point`, `loop`, `ends`, `monitoring`,
`special_points`, `even_crossing_search`, `resolution`; other branches of the span are traced by `coverage`.

References
----------
Keller, in: Applications of Bifurcation Theory, ed. Rabinowitz (1977), 359-384.
Allgower & Georg, Introduction to Numerical Continuation Methods (2003), https://doi.org/10.1137/1.9780898719154.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import ProgressCallback
from hbgear.common.ranges import NOT_NEGATIVE, checked
from hbgear.continuation.curve.builder import build_branch
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.events.detector import EventDetector, events_of
from hbgear.continuation.events.event import Event
from hbgear.continuation.events.registry import resolved_events
from hbgear.continuation.problem.adapter import as_problem
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.evaluation import AnyProblem
from hbgear.continuation.problem.work import DEFAULT_LIMIT, Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.concatenation import with_asymptotes
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence, solve
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.coverage import (
    UNCOVERED,
    CoverageSearch,
    cover_span,
    coverage_message,
    reversed_span_message,
)
from hbgear.continuation.tracing.first_point import ArbitrarySolutionError, begin, solution_by_problem
from hbgear.continuation.tracing.jumps import find_jumps
from hbgear.continuation.tracing.loop import ContinuationLoop
from hbgear.continuation.tracing.monitoring import CallbackError, Monitor, UnderResolvedError
from hbgear.continuation.tracing.resolution import ResolutionControl
from hbgear.continuation.tracing.special_points import SpecialPoints, points_and_marks
from hbgear.continuation.tracing.state import TraceSettings, set_up

SAME_END_RATIO = 1e-3
"""Distance of the ends of two branches, relative to the span, below which they are the same point."""


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
    events: Sequence[Event | str] = (),
    progress: ProgressCallback | None = None,
    cover: bool = True,
    accuracy: float | None = 1e-5,
    work: float | None = DEFAULT_LIMIT,
) -> Branch:
    """Trace a curve of solutions over a span of one parameter.

    Pseudo-arclength continuation follows the curve through all folds. Special points are located between the points,
    and the stability of each point is computed.

    Parameters
    ----------
    problem : HarmonicBalance, ContinuationProblem or object with ``evaluate``
        Equations R(X, p) = 0. The minimum is an object with ``evaluate(X, **parameters) -> (R, dR_dX)``; the optional
        methods are described in `hbgear.continuation.problem.base`.
    parameter : str
        Name of the continuation parameter.
    span : (float, float)
        First and last value of the parameter. The trace ends where the curve leaves the span at either end, closes on
        itself, or cannot be computed further.
    start : Point or array_like, shape (n,), optional
        Initial solution. A `Point`, such as ``curve["LP1"]`` or ``curve[10]``, starts the trace at its own parameter
        value, and an array at ``span[0]``. From a point at ``span[1]`` the curve is traced to ``span[0]``. By default
        the problem computes an initial solution at ``span[0]``. If that fails and `cover` is True, the trace starts at
        ``span[1]``, and `Branch.message` reports it.
    at : mapping of str to float, optional
        Values of the other parameters by name, such as ``{"zeta": 0.05}``. By default they are taken from the start,
        else from the problem.
    steps : StepControl, optional
        Limits of the step size and of the predictor.
    settings : NewtonSettings, optional
        Tolerances and number of iterations of the corrector.
    stability : bool, optional
        Whether the multipliers of each point are computed. The default is True.
    special : bool, optional
        Whether the special points known to the problem (folds, branch points, ...) are located and inserted into the
        branch. The default is True.
    events : sequence of Event or str, optional
        Additional events, which are located and inserted as well. Names select events that are located on request, such
        as "PK", and events registered with `hbgear.continuation.register_event`; the error for an unknown name lists
        them. With ``special=False``, names such as "LP" select single kinds. By default there are none.
    progress : callable, optional
        Function that is called with a `Progress` after every point, such as ``print``. An exception raised by it ends
        the trace and is raised by `trace`, with the branch computed so far as its attribute ``branch``.
    cover : bool, optional
        Whether other curves are searched if the curve does not cover the span, for example because it turns back to
        its start or tends to infinity. This requires `start` to be None. The curves found are stored in
        `Branch.others`, and `Branch.message` reports sections of the span that no curve covers. The default is True.
    accuracy : float or None, optional
        Target relative error of special points. None switches all error estimates off. The default is 1e-5; see Notes.
    work : float or None, optional
        Limit of the work for error estimates, refined special points and the verification of stability. The unit is
        one solution with 700 unknowns; a solution with n unknowns counts as (n / 700)^3. First error estimates, and
        exact motions that verify the stability, have further limits of the same size. None removes the limits.

    Returns
    -------
    Branch
        The traced curve. After the first point, every trace returns a branch; its `status` and `message` state why it
        ended. Ctrl-C gives the status ``interrupted``. An error gives the status ``failed`` with the error in the
        message; the curve is traced as far as possible, without the results that the error concerns. Points that could
        not be monitored have multipliers nan and an unknown regime.

    Raises
    ------
    TypeError
        If an argument has a wrong type, such as a model instead of its `HarmonicBalance`.
    KeyError
        If the problem does not have this parameter.
    ValueError
        If the span is empty, not finite or outside the range of the parameter, or a fixed parameter is missing.
    NoConvergence
        If no solution is found at the start and, with `cover`, at the other end of the span.
    KeyboardInterrupt
        If Ctrl-C is pressed before the first point is computed.

    Notes
    -----
    With an `accuracy`, errors are estimated and reduced in three ways:

    1. Each special point has an error estimate, `SpecialPoint.error`. A special point is located again with more
       unknowns if its error exceeds the target, or if its multipliers differ by more than 1e-3 from the values that
       its type requires. `SpecialPoint.located` is False if the largest number of unknowns does not suffice.
    2. Points of undecided stability are verified with more unknowns. All other points keep their number of unknowns.
    3. A curve that covers its span is traced again with twice the unknowns if the error of its solutions exceeds 5 %
       of their size, or if the error of a special point exceeds a thousandth of its parameter value, so that the
       point may not exist. `Branch.message` reports it. This is done only while half of `work` is left.

    Once the limit `work` is reached, special points keep their errors, points of uncertain stability are undecided, and
    `Branch.message` reports it.

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
    requested = as_problem(problem)
    if work is not None:
        checked("trace", "work", work, NOT_NEGATIVE)
    bound = Work(math.inf if work is None else float(work))
    located = resolved_events(events, requested, parameter)
    trace_settings = TraceSettings(parameter, at, steps, settings, stability, special, located, progress, accuracy)
    own = requested.own_trace(span, start, trace_settings, cover)
    return own if isinstance(own, Branch) else _trace_refined(requested, trace_settings, span, start, cover, bound, own)


def _trace_refined(
    requested: ContinuationProblem,
    settings: TraceSettings,
    span: tuple[float, float],
    start: Point | BranchStart | Array | None,
    cover: bool,
    work: Work,
    failure: str | None,
) -> Branch:
    """Trace the curve; at a higher resolution if it is under-resolved, from the other end if it has no start.

    ``failure`` states why an own curve of the problem was not completed.
    """
    problem, refinement = requested, ""
    reversal = ""
    while True:
        follow = partial(Tracer, settings=settings, work=work)
        try:
            search = cover and start is None
            tracer = follow(problem, span=span, start=start, cover=search, requested=requested)
        except ArbitrarySolutionError as arbitrary:
            return _trace_chosen_solution(arbitrary, follow, problem, span, cover)
        except NoConvergence:
            if reversal or start is not None or not cover:
                raise
            reversal = reversed_span_message(settings.parameter, span[0])
            span = span[::-1]
            continue
        try:
            branch = tracer.run()
        except UnderResolvedError as finding:
            own = None if refinement else requested.own_trace(span, start, settings, cover, unresolved=True)
            if isinstance(own, Branch):
                return own
            failure = own or failure
            problem, refinement = finding.finer, str(finding)
            work = work.renewed()
            continue
        if not refinement and not reversal and not failure:
            return branch
        reason = "" if branch.status.complete else failure
        message = "; ".join(text for text in (branch.message, refinement, reversal, reason) if text)
        return replace(branch, message=message)


def _trace_chosen_solution(
    arbitrary: ArbitrarySolutionError,
    follow: Callable[..., Tracer],
    problem: ContinuationProblem,
    span: tuple[float, float],
    cover: bool,
) -> Branch:
    """Trace the chosen solution of a continuum, and the curve behind its end where solutions are isolated again."""
    curve = follow(arbitrary.problem, span=span, start=arbitrary.X).run()
    text = f"{arbitrary.description}; {curve.message}"
    if not curve.status.complete:
        return replace(curve, message=text)
    others: tuple[Branch, ...] = ()
    if curve.status is Status.EVENT and cover:  # the other curve may pass this end and return to it
        with suppress(NoConvergence):
            other = follow(problem, span=span[::-1], start=None).run()
            if other.status is Status.STEP_TOO_SMALL and _is_same_end(other, curve, span):
                other = replace(other, status=Status.ARBITRARY, message=_ends_at_continuum(text))
            others = (other,)
    uncovered = coverage_message(curve, others, span) if cover else ""
    message = "; ".join(filter(None, (text, uncovered)))
    return replace(curve, status=Status.ARBITRARY, message=message, others=others)


def _is_same_end(branch: Branch, other: Branch, span: tuple[float, float]) -> bool:
    """Return whether two branches end at the same value of the parameter."""
    return bool(abs(branch.values[-1] - other.values[-1]) <= SAME_END_RATIO * abs(span[1] - span[0]))


def _ends_at_continuum(text: str) -> str:
    """Return the message of a curve that ends at a continuum, from the message of the solution chosen of it."""
    return f"{text}; this curve ends there"


class Tracer:
    """Coordinator of one trace: stages of the work, and the result.

    With ``cover`` other branches are searched where the curve does not cover the span. `run` raises
    `UnderResolvedError` for an under-resolved curve if ``abort_if_under_resolved``, or if ``cover`` is set and the
    problem can be refined. ``requested`` is the problem at the resolution that the user requested, if another one.
    Without ``work`` it has no bound.
    """

    def __init__(
        self,
        problem: ContinuationProblem,
        settings: TraceSettings,
        span: tuple[float, float],
        start: Point | BranchStart | Array | None = None,
        cover: bool = False,
        abort_if_under_resolved: bool = False,
        requested: ContinuationProblem | None = None,
        work: Work | None = None,
    ) -> None:
        refinable = settings.accuracy is not None and problem.refined_problem is not None
        restartable = problem.restarts and not problem.changes and not problem.unknown_parameters
        may_restart = cover and refinable and restartable
        abort = abort_if_under_resolved or may_restart
        self.setup = setup = set_up(
            problem,
            settings,
            span,
            start,
            requested=requested,
            abort_if_under_resolved=abort,
            work=work or Work(math.inf),
        )
        self.cover, self._requested = cover, requested
        # a trace that starts on another curve is not complete in itself, and is not checked as a whole
        self._is_whole_curve = start is None or setup.switched_from is not None
        self.others: list[Branch] = []  # branches that cover the rest of the span
        self._coverage_message = ""
        self._branch: Branch | None = None
        self.state, self._second = begin(setup, start)
        standard = events_of(setup.problem, setup.name)
        selected = standard if settings.special else [event for event in standard if event.terminal]
        kinds = {type(event) for event in selected}  # a name may select an event that is located anyway
        additional = [event for event in settings.events if type(event) not in kinds]
        detector = EventDetector([*selected, *additional], CurveEquations(setup.problem, setup.name, setup.fixed))
        self.monitor = Monitor(self.state)
        self.resolution = ResolutionControl(self.state, self.monitor)
        self.special_points = SpecialPoints(self.state, self.monitor, self.resolution, detector)
        self.loop = ContinuationLoop(self.state, self.special_points, self.resolution)

    def run(self) -> Branch:
        """Trace until something ends the trace; return all points computed until then.

        The exception of the progress callback is raised if it raised one, and `UnderResolvedError` if the trace is to
        be repeated at a higher resolution.
        """
        branch = self.traced()
        if isinstance(self.state.termination.error, CallbackError):
            raise self.state.termination.error.with_branch(branch)
        return branch

    def traced(self) -> Branch:
        """Return the branch as `run` does; an exception of the progress callback is recorded only."""
        termination = self.state.termination
        try:
            self._run_stages()
        except (Exception, KeyboardInterrupt) as error:
            termination.record_error(error, self.state.location_text())
        if self.monitor.first_error is not None:
            raise self.monitor.first_error
        while True:
            try:
                return self._result()
            except KeyboardInterrupt as error:  # the result takes no time, and would be lost
                termination.record_error(error, "while the result was assembled")

    def _run_stages(self) -> None:
        """Run all stages: Ctrl-C or an error ends one stage, and the next one works with the points so far."""
        for stage, location in (
            (self._trace_points, self.state.location_text),
            (self.special_points.flush_pending, lambda: "while the last points were processed"),
            (self.special_points.complete, lambda: "while the special points were monitored"),
            (self._postprocess, lambda: "while the branch was built"),
            (self._cover_span, lambda: "while the rest of the span was searched"),
        ):
            try:
                stage()
            except (Exception, KeyboardInterrupt) as error:
                self.state.termination.record_error(error, location())

    # ---- stages

    def _trace_points(self) -> None:
        """Trace the curve and record how it ended."""
        self.state.termination.record_end(*self.loop.run(self._second))
        if self.state.termination.status is Status.STEP_TOO_SMALL:
            self._add_reason()

    def _postprocess(self) -> None:
        """Build the branch with its jumps and the additions of the problem."""
        settings = self.setup.settings
        self._branch = self._build_branch()
        if settings.special:
            self._branch = replace(self._branch, jump_records=find_jumps(self._branch, settings.newton))
        checked_points = self.state.points if settings.special and self._is_whole_curve else []
        observed = [point.observed for point in checked_points]
        self._branch = self.state.largest.postprocess(self._branch, observed)

    def _cover_span(self) -> None:
        """Trace other branches where this one does not cover the span."""
        termination, span = self.state.termination, self.setup.span
        if not self.cover or self._branch is None or termination.error or termination.status not in UNCOVERED:
            return
        ends, settings = (span.start, span.end), self.setup.settings
        search = CoverageSearch(self._trace_other_branch, self._start_at, settings.newton if settings.special else None)
        inside = not self.state.ended_at_sharp_turn
        cover_span(self._branch, self.others, ends, search, inside=inside)
        self._coverage_message = coverage_message(self._branch, self.others, ends, inside=inside)
        for branch in self.others if termination.status is Status.STEP_TOO_SMALL else ():
            if branch.status is Status.ARBITRARY and _is_same_end(self._branch, branch, ends):
                termination.record_end(Status.ARBITRARY, _ends_at_continuum(branch.message))

    def _add_reason(self) -> None:
        """Add the reason why no step succeeds to the message, with advice, if the problem knows it."""
        last, termination = self.state.last, self.state.termination
        reason, advice = self.state.problem.stall(last.X, self.setup.name, self.setup.parameters_at(last.value))
        if reason:
            termination.message, termination.advice = f"{termination.message}; {reason}", advice

    def _trace_other_branch(self, span: tuple[float, float], start: BranchStart | None, rough: bool) -> Branch:
        """Trace another branch of the span, its points alone if ``rough``; Ctrl-C ends this trace too."""
        settings = self.setup.settings.points_only() if rough else self.setup.settings
        follow = partial(Tracer, settings=settings, span=span, requested=self._requested, work=self.setup.work)
        description = ""
        try:
            abort = self.setup.abort_if_under_resolved
            tracer = follow(self.state.original, start=start, abort_if_under_resolved=abort)
        except ArbitrarySolutionError as arbitrary:
            tracer, description = follow(arbitrary.problem, start=arbitrary.X), arbitrary.description
        branch = tracer.traced()
        if description and branch.status.complete:
            branch = replace(branch, status=Status.ARBITRARY, message=f"{description}; {branch.message}")
        error = tracer.state.termination.error
        if isinstance(error, KeyboardInterrupt | CallbackError):
            self.others += [branch]
            raise error
        return branch

    def _start_at(self, value: float, estimate: Array | None) -> BranchStart:
        """Return a solution at a value of the parameter, near given unknowns or found by the problem."""
        parameters, problem = self.setup.parameters_at(value), self.state.original
        guess = solution_by_problem(self.setup, problem, parameters) if estimate is None else problem.resized(estimate)
        X = solve(problem, guess, parameters, "", self.setup.settings.newton).X
        return BranchStart(X, parameters, np.append(np.zeros(len(X)), 1.0), bifurcating=False)

    # ---- result

    def _build_branch(self) -> Branch:
        """Return the branch of the points so far, without jumps."""
        state, setup = self.state, self.setup
        header = setup.settings.header(setup.span.start, setup.span.end)
        header |= {"bifurcating": True} if setup.switched_from is not None else {}
        end = state.termination.status, state.termination.message_with_advice
        branch = build_branch(state.equations._replace(problem=state.largest), *points_and_marks(state), end, header)
        if state.asymptote is None:
            return branch
        return replace(branch, meta=with_asymptotes(branch.meta, last=state.asymptote))

    def _result(self) -> Branch:
        """Return the branch with its final status and message."""
        branch, termination = self._branch or self._build_branch(), self.state.termination
        remarks = self.state.largest.remarks(replace(branch, status=termination.status)) if len(branch) else ()
        texts = termination.message_with_advice, *remarks, self._coverage_message, self.setup.work.message
        message = "; ".join(text for text in texts if text)
        if not self.others and (branch.status, branch.message) == (termination.status, message):
            return branch
        return replace(branch, status=termination.status, message=message, others=tuple(self.others))
