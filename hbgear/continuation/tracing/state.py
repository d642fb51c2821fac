"""Settings and state of one trace.

Settings that do not change (`TraceSettings`, `Span`, `TraceSetup`) are separate from the state that changes from point
to point (`TraceState`). The parts of the continuation loop share the state and have no other means of communication.

Lengths and angles are measured in scaled unknowns: X over the largest solution norm so far, the continuation parameter
over the width of the span.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.process.progress import ProgressCallback
from hbgear.common.ranges import POSITIVE, Range, checked
from hbgear.continuation.curve.segment import BranchStart, CurvePoint, Segment, rescaled
from hbgear.continuation.events.event import Event, LocatedEvent
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.termination import Termination
from hbgear.continuation.solvers.newton import NewtonSettings
from hbgear.continuation.stepping.control import StepControl

NUMBER_OF_RECENT_POINTS = 3
"""Number of last points of a curve that a search for earlier points nearby leaves out: a step starts at them."""

MIN_SCALE_RATIO = 1e-2
"""Smallest scale of the unknowns relative to the norm of the solution, for solutions of zero `solution_norm`."""


@dataclass(frozen=True)
class TraceSettings:
    """Settings of a trace, the arguments of `trace`; ``newton`` are the settings of the corrector."""

    parameter: str
    at: Mapping[str, float] | None
    steps: StepControl
    newton: NewtonSettings
    stability: bool
    special: bool
    events: Sequence[Event]
    progress: ProgressCallback | None
    accuracy: float | None

    def __post_init__(self) -> None:
        if self.accuracy is not None:
            checked("trace", "accuracy", self.accuracy, POSITIVE)

    def header(self, begin: float, end: float) -> dict[str, Any]:
        """Return the settings and the span as plain data, for the header of a file."""
        return {
            "span": [begin, end],
            "steps": vars(self.steps),
            "newton": vars(self.newton),
            "stability": self.stability,
            "accuracy": self.accuracy,
            "special": self.special,
        }

    def points_only(self) -> TraceSettings:
        """Return the settings of a trace without stability and special points."""
        return replace(self, stability=False, special=False, events=())


@dataclass(frozen=True)
class Span:
    """Section of the parameter axis, from ``start`` to ``end``, and the admissible values of the parameter."""

    start: float
    end: float
    admissible: Range

    @property
    def width(self) -> float:
        """Distance of the two ends."""
        return abs(self.end - self.start)

    @property
    def bounds(self) -> tuple[float, float]:
        """The lower and the upper end."""
        return min(self.start, self.end), max(self.start, self.end)

    @property
    def direction(self) -> float:
        """Return +1.0 if the span leads to larger values, else -1.0."""
        return 1.0 if self.end > self.start else -1.0

    def reversed(self) -> Span:
        """Return the span with its ends exchanged."""
        return replace(self, start=self.end, end=self.start)

    def end_at(self, value: float) -> float | None:
        """Return the end on which or beyond which a value lies; None for a value inside the span."""
        if self.direction * (value - self.end) >= 0:
            return self.end
        if self.direction * (value - self.start) < 0:
            return self.start
        return None


@dataclass(frozen=True)
class TraceSetup:
    """Constants of one trace.

    ``problem`` is restricted to the span. ``requested`` is the problem at the resolution that the user requested, at
    which initial solutions are searched. ``fixed`` has the values of all other parameters. With
    ``abort_if_under_resolved`` the trace stops, to be repeated at a higher resolution, as soon as a solution is
    under-resolved. ``switched_from`` is the special point at which the curve leaves another branch.
    """

    settings: TraceSettings
    problem: ContinuationProblem
    requested: ContinuationProblem
    span: Span
    fixed: dict[str, float]
    abort_if_under_resolved: bool
    work: Work
    switched_from: BranchStart | None

    @property
    def name(self) -> str:
        """Name of the continuation parameter."""
        return self.settings.parameter

    @cached_property
    def batch_size(self) -> int:
        """Number of points monitored together; 1 if the resolution may change from point to point."""
        return 1 if self.problem.changes else self.problem.batch_size

    def parameters_at(self, value: float) -> dict[str, float]:
        """Return all parameters at a value of the continuation parameter."""
        return {**self.fixed, self.name: value}


def set_up(
    problem: ContinuationProblem,
    settings: TraceSettings,
    span: tuple[float, float],
    start: Point | BranchStart | Array | None,
    *,
    requested: ContinuationProblem | None = None,
    abort_if_under_resolved: bool = False,
    work: Work,
) -> TraceSetup:
    """Check the arguments of a trace and return its constants.

    KeyError is raised if the problem does not have a parameter of this name, and ValueError if the span is empty or not
    admissible, a parameter has no value or two meanings, or stability cannot be computed.
    """
    name, values = settings.parameter, settings.at or {}
    for parameter in (name, *values):
        problem.check_parameter(parameter)
    if name in values:
        raise ValueError(f"at={{'{name}': ...}}: it is what changes along the curve; give its span")
    section = _checked_span(name, span, problem.range_of(name))
    if isinstance(start, Point) and math.isclose(start.parameters.get(name, section.start), section.end, rel_tol=1e-12):
        section = section.reversed()  # only the first end is left to reach
    fixed = _fixed_parameters(problem, settings, start)
    problem.check_trace(name, *section.bounds, fixed)
    restricted = problem.restricted_to(name, *section.bounds, fixed)
    if settings.stability:
        restricted.check_stability()
    requested = requested or problem
    requested = restricted if requested is problem else requested.restricted_to(name, *section.bounds, fixed)
    return TraceSetup(
        settings,
        restricted,
        requested,
        section,
        fixed,
        abort_if_under_resolved,
        work,
        start if isinstance(start, BranchStart) and start.bifurcating else None,
    )


def _checked_span(parameter: str, span: tuple[float, float], admissible: Range) -> Span:
    """Return the span; raise ValueError if it is empty or has an inadmissible end."""
    a, b = map(float, span)
    if a == b:
        raise ValueError(f"span = ({a}, {b}) is empty; give two different values of {parameter}")
    if a not in admissible or b not in admissible:
        raise ValueError(f"span = ({a}, {b}): {parameter} must {admissible}")
    return Span(a, b, admissible)


def _fixed_parameters(
    problem: ContinuationProblem, settings: TraceSettings, start: Point | BranchStart | Array | None
) -> dict[str, float]:
    """Return the values of all fixed parameters: of the problem, replaced by the start and by ``at``."""
    fixed = dict(problem.parameters)
    if isinstance(start, Point | BranchStart):
        fixed.update(start.parameters)
    fixed.update({name: float(value) for name, value in (settings.at or {}).items()})
    parameter, unknown = settings.parameter, problem.unknown_parameters
    for name in (parameter, *unknown):
        fixed.pop(name, None)
    for name in problem.missing((parameter, *fixed, *unknown)):
        raise ValueError(
            f"tracing in {parameter} needs a fixed {name}: give at={{'{name}': ...}} or start from a point of a curve"
        )
    return fixed


class PendingSegment(NamedTuple):
    """A segment that was not yet searched for special points: the problem and the scales with which it was computed."""

    problem: ContinuationProblem
    scale: Array


@dataclass(eq=False)
class TraceState:
    """State of one trace.

    Attributes
    ----------
    setup : TraceSetup
        Constants of the trace.
    problem : ContinuationProblem
        The problem at the present resolution, stated relative to the last point.
    original : ContinuationProblem
        The problem at the first resolution.
    largest : ContinuationProblem
        The problem at the highest resolution so far.
    points : list of CurvePoint
        Accepted points.
    scale : ndarray, shape (n + 1,)
        Scales of the unknowns and of the continuation parameter.
    solution_scale : float
        Largest solution norm so far.
    step : float
        Next step size.
    pending : list of PendingSegment
        The last segments, which were not yet searched for special points.
    located : list of (int, LocatedEvent)
        Special points, each with the number of the point after it.
    samples : dict
        Points inserted between special points of one segment, each with its fraction, by the number of the point after.
    terminal : LocatedEvent or None
        The event at which the trace ended.
    has_folded : bool
        Whether the parameter direction has changed.
    boundary_value : float or None
        End of the admissible range at which the last point was computed.
    asymptote : float or None
        Value of the parameter at which the curve tends to infinity.
    ended_at_sharp_turn : bool
        Whether the trace ended at a point that no step passes. Beyond it, solutions are expensive and under-resolved.
    termination : Termination
        Status and message.
    """

    setup: TraceSetup
    problem: ContinuationProblem
    original: ContinuationProblem
    largest: ContinuationProblem = field(init=False)
    points: list[CurvePoint] = field(init=False, default_factory=list)
    scale: Array = field(init=False)
    solution_scale: float = field(init=False, default=0.0)
    step: float = field(init=False)
    pending: list[PendingSegment] = field(init=False, default_factory=list)
    located: list[tuple[int, LocatedEvent]] = field(init=False, default_factory=list)
    samples: dict[int, list[tuple[float, CurvePoint]]] = field(init=False, default_factory=dict)
    terminal: LocatedEvent | None = field(init=False, default=None)
    has_folded: bool = field(init=False, default=False)
    boundary_value: float | None = field(init=False, default=None)
    asymptote: float | None = field(init=False, default=None)
    ended_at_sharp_turn: bool = field(init=False, default=False)
    termination: Termination = field(init=False, default_factory=Termination)
    _history: Array = field(init=False, default_factory=lambda: np.empty((0, 0)))
    _history_count: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.largest, self.step = self.original, self.setup.settings.steps.first_step

    @property
    def first(self) -> CurvePoint:
        """The first point of the curve."""
        return self.points[0]

    @property
    def last(self) -> CurvePoint:
        """The last point so far."""
        return self.points[-1]

    def location_text(self) -> str:
        """Return the location of the last point for a message."""
        return f"at {self.setup.name} = {self.last.value:.6g}"

    def keep_largest(self, problem: ContinuationProblem) -> None:
        """Update the problem at the highest resolution."""
        self.largest = max(self.largest, problem, key=number_of_unknowns)

    # ---- scales

    def update_scale(self, X: Array, solution_scale: float) -> None:
        """Set the scales of (X, parameter) for a largest solution norm."""
        self.solution_scale = solution_scale
        unknown = len(self.problem.unknown_parameters)
        floor = MIN_SCALE_RATIO * norm(X[: len(X) - unknown]) or 1.0
        scale = np.full(len(X) + 1, max(solution_scale, floor))
        scale[-1] = self.setup.span.width
        for i, name in enumerate(self.problem.unknown_parameters):  # the largest value so far
            past = [abs(point.X[-1 - i]) for point in self.points]
            scale[-2 - i] = max([*past, abs(X[-1 - i]), self.problem.smallest_scale(name)]) or 1.0
        self.scale = scale

    def scale_for(self, problem: ContinuationProblem) -> Array:
        """Return the present scales for the unknowns of another problem."""
        return rescaled(self.scale, problem, number_of_unknowns(problem))

    # ---- geometry

    @property
    def equations(self) -> CurveEquations:
        """Equations of the curve at the present resolution."""
        return CurveEquations(self.problem, self.setup.name, self.setup.fixed)

    def segment(self, a: CurvePoint, b: CurvePoint) -> Segment:
        """Return the segment between two points, of the present problem."""
        setup = self.setup
        return Segment(self.problem, setup.name, setup.fixed, a, b, self.scale, setup.settings.newton)

    def resized(self, point: CurvePoint) -> CurvePoint:
        """Return an earlier point at the present resolution."""
        if len(point.u) == len(self.scale):
            return point
        fit = self.problem.resized
        u, t = np.append(fit(point.u[:-1]), point.u[-1]), np.append(fit(point.tangent[:-1]), point.tangent[-1])
        return replace(point, u=u, tangent=t)

    def at_present_resolution(self, points: Iterable[CurvePoint]) -> list[CurvePoint]:
        """Return the points that have the present number of unknowns."""
        return [point for point in points if len(point.u) == len(self.scale)]

    def history(self) -> Array:
        """Return the unknowns (P, n + 1) of all points but the most recent ones, at the present resolution."""
        count, width = len(self.points), len(self.scale)
        if self._history.shape[1] != width:
            self._history, self._history_count = np.empty((0, width)), 0
        if count > len(self._history):
            self._history = np.concatenate([self._history, np.empty((count, width))])
        for i in range(self._history_count, count):
            self._history[i] = self.resized(self.points[i]).u
        self._history_count = count
        return self._history[: count - NUMBER_OF_RECENT_POINTS]


def number_of_unknowns(problem: ContinuationProblem) -> int:
    """Return the number of unknowns of a problem, 0 if it is not known."""
    return problem.size or 0
