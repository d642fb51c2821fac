"""Special points of curves in contact instants as solutions of a problem, with a curve in a second parameter."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.special_point_problem import SpecialPointProblem
from hbgear.continuation.curve.builder import SpecialPointMark, build_branch
from hbgear.continuation.curve.segment import BranchStart, CurvePoint
from hbgear.continuation.events.accuracy import PARAMETER_ROUNDING
from hbgear.continuation.events.event import Event, LocatedEvent
from hbgear.continuation.events.fold import CuspEvent, FoldEvent, IsolaCentreEvent
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.state import set_up
from hbgear.harmonic.instants.corrector import CurveState
from hbgear.harmonic.instants.observables import observed_point, reporter
from hbgear.harmonic.instants.sampling import coefficients
from hbgear.harmonic.instants.special_points.critical import ExactPoint, exact_point, point_on_curve
from hbgear.harmonic.instants.special_points.grazing import Grazing
from hbgear.harmonic.instants.special_points.special_motion import SpecialMotion, state_near
from hbgear.harmonic.instants.special_points.surface import Surface
from hbgear.harmonic.instants.special_points.two_parameters import SpecialPointCurve, SpecialPointFollower

EQUATIONS = {"LP": "FoldProblem", "PD": "PeriodDoublingProblem", "NS": "NeimarkSackerProblem", "GR": "GrazingProblem"}
"""Equations of the same special points of a harmonic balance, which name the curve in files and figures."""

DISTANCE_FROM_FOLD = 1e-4
"""Distance along a curve, over the shortest contact [rad] or 1, at which motions on both sides of a fold are
compared."""


class KnownPoint(NamedTuple):
    """Special point: exact motion, all parameters, the contact that grazes, for GR, and the direction of the curve.

    The direction is +1 where the second parameter increases along the curve, -1 where it decreases, 0 if unknown.
    """

    state: CurveState
    parameters: dict[str, float]
    grazing: Grazing | None
    direction: int = 0


class ExactSpecialPointProblem(SpecialPointProblem):
    """Folds, period doublings, Neimark-Sacker points or grazing points of curves in contact instants.

    Its curve in a second parameter is computed in contact instants; see `two_parameters`.

    Parameters
    ----------
    problem : ContactInstants
        Problem of the curve that has the point.
    parameter : str
        Parameter of this curve.
    kind : str
        LP, PD, NS or GR.
    point : KnownPoint
        The point.
    resonances : sequence of Event
        Events of the 1:1 and 1:2 resonances of Neimark-Sacker points.
    """

    problem: Any
    kind: str
    known_points: tuple[KnownPoint, ...]
    codimension_two: Mapping[str, Event]

    def __init__(self, problem: Any, parameter: str, kind: str, point: KnownPoint, resonances: Sequence[Event]) -> None:
        super().__init__(problem, parameter)
        events = (FoldEvent(), CuspEvent(), IsolaCentreEvent(), *resonances)
        self._fixed(kind=kind, known_points=(point,), codimension_two={event.kind: event for event in events})

    @property
    def turning_kind(self) -> str:  # type: ignore[override]
        """Kind of the turning points of the curve."""
        return CuspEvent.kind if self.kind == FoldEvent.kind else FoldEvent.kind

    def describe(self) -> dict[str, Any]:
        """Return the data for the header of a file."""
        return {**self.problem.describe(), "curve": {"of": EQUATIONS[self.kind], "in": self.parameter}}

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return the difference of the unknowns (X, p) from the special point near them, and the unit matrix."""
        point = self.located(X, parameters)
        fixed = {key: value for key, value in point.parameters.items() if key != self.parameter}
        ode = self.problem.family(self.parameter, fixed)(point.state.value)
        exact = np.append(coefficients(ode, point.state.iterate, self.problem.H)[0].ravel(), point.state.value)
        return Evaluation(X - exact, np.eye(len(X)), np.zeros(len(X)), 1.0 + float(np.linalg.norm(X)))

    # ---- points

    def located(self, U: Array, parameters: Mapping[str, float]) -> KnownPoint:
        """Return the special point near unknowns (X, p) at the other parameters.

        It is followed from the nearest known point, in one parameter after the other.

        Raises
        ------
        NoConvergence
            If the curve from there does not reach these parameters.
        """
        fixed = {name: value for name, value in parameters.items() if name != self.parameter}

        def distance(start: KnownPoint) -> float:
            goal = {**fixed, self.parameter: float(U[-1])}
            return sum(abs(value - start.parameters[name]) / self.unit_of(name, value) for name, value in goal.items())

        point = min(self.known_points, key=distance)
        for name, value in fixed.items():
            if value != point.parameters[name]:
                point = self._followed(point, name, value)
        return point

    def _followed(self, point: KnownPoint, name: str, value: float) -> KnownPoint:
        """Return a special point at another value of a parameter."""
        if abs(value - point.parameters[name]) <= NEXT_VALUE * self.unit_of(name, value):
            return self._relocated(point, name, value)
        start, steps = point._replace(direction=0), StepControl(max_points=MAX_POINTS_BETWEEN)
        curve = self._curve(start, name, (point.parameters[name], value), steps, lambda *_: None)
        if curve.status is not Status.REACHED_END:
            raise NoConvergence(f"the {self.kind} was not found: {curve.message}", point.state.z, point.parameters, [])
        return self._known_point(curve.points[-1], point, name)

    def _relocated(self, point: KnownPoint, name: str, value: float) -> KnownPoint:
        """Return a special point at a value of a parameter that differs by rounding."""
        parameters = {**point.parameters, name: value}
        family = self._surface(point, name).family(value)
        scale = point.state.scale(abs(point.state.value) or 1.0)
        state = state_near(family, point.state, self.kind, point.grazing, scale, MAX_RELOCATION)
        return point._replace(state=state, parameters={**parameters, self.parameter: state.value})

    def _known_point(self, motion: SpecialMotion, start: KnownPoint, name: str) -> KnownPoint:
        """Return a point of a curve in a parameter from a start."""
        state = motion.point.state
        parameters = {**start.parameters, self.parameter: state.value, name: motion.point.second}
        return KnownPoint(state, parameters, motion.grazing, int(np.sign(motion.tangent[-1])))

    def _surface(self, start: KnownPoint, name: str) -> Surface:
        """Return the motions in the parameter of the curve and a second one."""
        fixed = {key: value for key, value in start.parameters.items() if key not in (self.parameter, name)}
        return Surface(lambda second: self.problem.family(self.parameter, {**fixed, name: second}))

    def _curve(
        self, start: KnownPoint, name: str, span: tuple[float, float], steps: StepControl, report: Any
    ) -> SpecialPointCurve:
        """Return the curve of the special point over a span of a second parameter."""
        follower = SpecialPointFollower(self, self._surface(start, name), name, span, steps, report)
        return follower.run(start.state, start.parameters[name], start.grazing, start.direction)

    def direction(self, U: Array, **parameters: float) -> int:
        """Return +1 if motions exist below a fold only, -1 if above: the direction of a sweep that reaches it."""
        point = self.located(U, parameters)
        fixed = {key: value for key, value in point.parameters.items() if key != self.parameter}
        family, state = self.problem.family(self.parameter, fixed), point.state
        fold = point_on_curve(family, state, state.scale(abs(state.value) or 1.0))
        visits = state.pattern.visits
        durations = state.iterate.visit_durations(visits, family(state.value).period)
        step = DISTANCE_FROM_FOLD * min(1.0, float(np.abs(durations).min(initial=1.0)))

        def at_distance(distance: float) -> ExactPoint:
            guess = state.with_z(state.z + distance * fold.tangent * fold.scale)
            return exact_point(family, guess, fold.tangent, fold.scale, fold.tangent)

        return 1 if at_distance(step).tangent[-1] < at_distance(-step).tangent[-1] else -1

    # ---- the curve

    def own_trace(
        self, span: tuple[float, float], start: Any, settings: Any, cover: bool, unresolved: bool = False
    ) -> Branch:
        """Return the curve of the special point over a span of the second parameter.

        Raises
        ------
        ValueError
            If there is no start.
        """
        if not isinstance(start, Point | BranchStart):
            raise ValueError(f"a curve of {self.kind} needs a start: a point of a curve in contact instants")
        setup = set_up(self, settings, span, start, work=Work(float("inf")))
        name, ends = setup.name, (setup.span.start, setup.span.end)
        second = float(start.parameters.get(name, ends[0]))
        first_value = float(start.parameters.get(self.parameter, start.X[-1]))
        first_point = self.located(np.append(start.X, first_value), {**setup.fixed, name: second})
        if isinstance(start, Point):
            first_point = first_point._replace(direction=0)  # towards the end of the span
        report = reporter(settings.progress, name, ends)
        curve = self._curve(first_point, name, ends, settings.steps, report)
        surface = self._surface(first_point, name)
        steps = zip(curve.points, curve.steps, strict=True)
        points = [self._curve_point(surface, motion, step) for motion, step in steps]
        marks = []
        for kind, index in curve.marks if settings.special else ():
            low, high = points[max(index - 1, 0)].value, points[min(index + 1, len(points) - 1)].value
            error = PARAMETER_ROUNDING * abs(points[index].value)
            event = LocatedEvent(self.codimension_two[kind], 0.5, points[index], True, "in contact instants", error)
            marks.append(SpecialPointMark(index, event, (low, high)))
        problem = copy.copy(self)
        problem._fixed(known_points=tuple(self._known_point(motion, first_point, name) for motion in curve.points))
        equations = CurveEquations(problem, name, setup.fixed)
        return build_branch(equations, points, marks, (curve.status, curve.message), settings.header(*ends))

    def _curve_point(self, surface: Surface, motion: SpecialMotion, step: float) -> CurvePoint:
        """Return a point of the branch."""
        point, values = motion.point, [motion.point.state.value, motion.point.second]
        equations, change = surface.at(point), float(motion.tangent[-1])
        out = observed_point(equations, point.state.iterate, point.linearised, self.problem.H, values, change)
        out.step = step
        return out


MAX_RELOCATION = 1e-3
"""Largest distance along a curve, in scaled unknowns, of a point from its place at a value that differs by rounding."""

NEXT_VALUE = 1e-9
"""Change of a parameter, over its unit, up to which a special point is located at the new value without a curve."""

MAX_POINTS_BETWEEN = 200
"""Largest number of points of a curve between a known special point and one at other parameters."""
