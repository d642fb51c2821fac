"""Monitored quantities and verified stability of the points of a trace.

The problem supplies the quantities that are stored with a point: multipliers, regime, truncation error
(`ContinuationProblem.observe`), and verifies the stability of solutions near a stability limit
(`ContinuationProblem.verify_stability`). A stability that contradicts the special points nearby is verified again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.progress import curve_progress
from hbgear.continuation.curve.segment import CurvePoint, Segment
from hbgear.continuation.events.event import LocatedEvent
from hbgear.continuation.events.fold import FoldEvent
from hbgear.continuation.problem.base import ContinuationProblem, observe_all
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.branch_data import relative_errors
from hbgear.continuation.results.stability import STABILITY_CHANGING_KINDS, STABLE, UNSTABLE, stability_codes
from hbgear.continuation.solvers.newton import SOLVER_ERRORS
from hbgear.continuation.tracing.state import TraceState

MAX_RELATIVE_TRUNCATION_ERROR = 0.05
"""Truncation error relative to the solution, above which a solution is under-resolved."""

SPURIOUS_POINT_ERROR = 1e-3
"""Error of a special point, relative to the unit of the parameter, above which the point may not exist."""

CURVE_EQUIVALENT_SOLUTIONS = 40
"""Number of solutions with error estimates and verified stability that take as long as a curve with its special points.

The points of a curve take as long as 8, and each special point 1 to 3. Curves with many uncertain special points have
a hundred and more: one with 240 was traced with 32, 64 and 128 harmonics in 120 s, and was no more certain.
"""


class UnderResolvedError(BaseException):
    """The solutions of a trace are under-resolved.

    It is not an `Exception`, so that no stage of the trace continues after it.
    """

    def __init__(self, problem: ContinuationProblem, finding: str) -> None:
        self.finer = problem.refined_problem or problem
        super().__init__(f"traced with {self.finer.resolution}, because with {problem.resolution} {finding}")


MAX_SECONDS_WITHOUT_PROGRESS = 1.0
"""Time [s] after which the progress of the monitoring of a batch of points is reported."""


class CallbackError(Exception):
    """An exception raised by the progress callback of the user, which is its ``cause``."""

    def __init__(self, cause: BaseException) -> None:
        super().__init__(f"in progress, {type(cause).__name__}: {cause}")
        self.cause = cause

    def with_branch(self, branch: Branch) -> BaseException:
        """Return the exception as it was raised, with the partial branch as its attribute ``branch``."""
        self.cause.branch = branch  # type: ignore[attr-defined]
        self.cause.add_note(f"what was traced until then ({len(branch)} points) is this exception's attribute branch")
        return self.cause


class Monitor:
    """Monitored quantities and stability of the points of a trace.

    ``first_error`` is the error that prevented the monitoring of the first point. It ends the trace. ``slow`` is True
    if the last batch of points took longer than `MAX_SECONDS_WITHOUT_PROGRESS`.
    """

    def __init__(self, state: TraceState) -> None:
        self.state = state
        self.first_error: Exception | None = None
        self.slow = False

    def observe(
        self, points: Iterable[CurvePoint], problem: ContinuationProblem | None = None, errors: bool = True
    ) -> None:
        """Store the monitored quantities with those points that do not have them yet.

        Where this fails, nothing is stored and the termination records the error. ``problem`` is the problem of the
        points, by default the present one. The error estimates are not checked with ``errors=False``. With a progress
        callback the first point is observed alone; if a point takes long, the others are observed in parts that take
        about a second, and each part is reported.
        """
        fresh = [point for point in points if not point.observed]
        finished, batch_size = 0, len(fresh) if self.state.setup.settings.progress is None else 1
        while finished < len(fresh):
            begin = time.monotonic()
            self._observe_together(fresh[finished : finished + batch_size], problem or self.state.problem, errors)
            finished = min(finished + batch_size, len(fresh))
            seconds_per_point = (time.monotonic() - begin) / batch_size
            batch_size = max(int(MAX_SECONDS_WITHOUT_PROGRESS / max(seconds_per_point, 1e-6)), 1)
            self.slow = batch_size < len(fresh)
            self.report_if_slow(f"stability of {finished} of {len(fresh)} points")

    def _observe_together(self, fresh: Sequence[CurvePoint], problem: ContinuationProblem, errors: bool) -> None:
        """Store the monitored quantities with some points."""
        equations, stability = self.state.equations._replace(problem=problem), self.state.setup.settings.stability
        results: Iterable[dict[str, Any]]
        u = np.array([point.u for point in fresh])
        try:
            results = observe_all(equations, u, stability, errors)
        except Exception:
            results = (self._observe_alone(point, problem) for point in fresh)
        for point, quantities in zip(fresh, results, strict=True):
            point.observed.update(quantities)
        if self.state.setup.abort_if_under_resolved:
            self._check_resolution(u, np.array([point.observed.get("error", 0.0) for point in fresh]))

    def report_if_slow(self, activity: str) -> None:
        """Report the activity at the last point if the monitoring of the last batch took long."""
        if self.slow:
            self.report(self.state.last, activity)

    def report(self, point: CurvePoint, activity: str = "") -> None:
        """Call the progress callback if there is one; raise its exceptions as `CallbackError`."""
        setup, count = self.state.setup, len(self.state.points)
        progress, span = setup.settings.progress, (setup.span.start, setup.span.end)
        if progress is None:
            return
        try:
            progress(curve_progress(setup.name, point.value, span, count, point.step, activity))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise CallbackError(error) from error

    def solve_on_segment(self, segment: Segment, s: float, errors: bool = False) -> CurvePoint | None:
        """Return the monitored point at a fraction of a segment; None if it cannot be computed.

        Its error estimate is checked only with ``errors=True``.
        """
        try:
            point = segment.at(s)
            self.observe([point], errors=errors)
        except SOLVER_ERRORS:
            return None
        return point

    def _observe_alone(self, point: CurvePoint, problem: ContinuationProblem) -> dict[str, Any]:
        """Return the monitored quantities of one point; none if an error is raised, which is recorded."""
        state = self.state
        try:
            equations, stability = state.equations._replace(problem=problem), state.setup.settings.stability
            return observe_all(equations, point.u[None], stability)[0]
        except Exception as error:
            if point is state.first:
                self.first_error = error
                raise
            state.termination.record_error(error, f"in observing the motion at {state.setup.name} = {point.value:.6g}")
            return {}

    def _check_resolution(self, u: Array, error: Array) -> None:
        """Raise `UnderResolvedError` if one of the solutions u (P, n + 1) has too large a truncation error."""
        relative = relative_errors(u[:, :-1], error)
        if (relative > MAX_RELATIVE_TRUNCATION_ERROR).any() and self.can_refine():
            first = int(np.argmax(relative > MAX_RELATIVE_TRUNCATION_ERROR))
            name = self.state.setup.name
            raise UnderResolvedError(
                self.state.problem, f"the error is {relative[first]:.0%} at {name} = {u[first, -1]:.6g}"
            )

    def can_refine(self) -> bool:
        """Return whether the bound of the work allows a trace at a higher resolution."""
        finer = self.state.problem.refined_problem
        return finer is not None and self.state.setup.work.affords(finer.equivalent_size, CURVE_EQUIVALENT_SOLUTIONS)

    # ---- stability

    def verify_stability(self, points: Sequence[CurvePoint]) -> None:
        """Verify the stability of monitored points whose stability was not verified yet."""
        state, setup = self.state, self.state.setup
        fresh = [p for p in points if "multipliers" in p.observed and "modulus_error" not in p.observed]
        if setup.settings.accuracy is None or not fresh:
            return
        u = np.array([point.u for point in fresh])
        for point in fresh:
            point.observed["determinant"] = point.determinant
        observed = [point.observed for point in fresh]
        try:
            solutions = CurveSolutions(u[:, :-1], setup.name, u[:, -1], setup.fixed)
            state.problem.verify_stability(solutions, observed, setup.work)
        except Exception as error:
            location = f"near {setup.name} = {u[-1, -1]:.6g}"
            state.termination.record_error(error, f"in the verification of the stability {location}")

    def resolve_contradictions(self, start: int, located: Mapping[int, list[LocatedEvent]]) -> bool:
        """Verify points again that contradict the special points between them; return whether a stability changed.

        Neighbouring points from number ``start`` on contradict them if their stability differs without a special point
        between them, or if both sides of a fold are stable.
        """
        settings = self.state.setup.settings
        if not (settings.stability and settings.special) or settings.accuracy is None:
            return False
        path = self.state.points[start:]
        codes = stability_codes_of(path)
        contradicting = set[int]()
        for i in range(1, len(path)):
            kinds = [
                point.event.kind for point in located.get(start + i, []) if point.event.kind in STABILITY_CHANGING_KINDS
            ]
            changed = {codes[i - 1], codes[i]} == {UNSTABLE, STABLE} and not kinds
            both_stable = codes[i - 1] == codes[i] == STABLE and kinds == [FoldEvent.kind]
            if changed or both_stable:
                contradicting |= {i - 1, i}
        rechecked = [path[i] for i in sorted(contradicting) if not path[i].observed.get("contradicts")]
        for point in rechecked:
            point.observed["contradicts"] = True
            point.observed.pop("modulus_error", None)
        self.verify_stability(rechecked)
        return bool(rechecked) and stability_codes_of(path) != codes


def stability_codes_of(points: Sequence[CurvePoint]) -> list[int]:
    """Return the stability codes of monitored points; see `stability_codes`."""
    sets = [point.observed.get("multipliers") for point in points]
    if len({None if mu is None else len(mu) for mu in sets}) > 1:  # compare the largest multiplier alone
        sets = [None if mu is None else mu[[np.abs(mu).argmax()]] for mu in sets]
    missing = np.full(next((len(mu) for mu in sets if mu is not None), 1), np.nan + 0j)
    multipliers = np.array([missing if mu is None else mu for mu in sets])
    errors = [point.observed.get("modulus_error", math.nan) for point in points]
    return stability_codes(multipliers, np.array(errors)).tolist()
