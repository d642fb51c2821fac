"""Predictor-corrector steps along a curve: the next points after the last ones, and the next step size.

A problem with a compiled continuation loop (`ContinuationProblem.compiled_continuation`) computes many points per call.
Other problems compute one point per call. Both use the rules of `stepping.kernels`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.augmented.special_point_problem import SpecialPointProblem
from hbgear.continuation.curve.segment import CurvePoint, parameter_direction
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.evaluation import Pursuit
from hbgear.continuation.solvers.corner import Corner, step_over_corner
from hbgear.continuation.solvers.corrector import correct, newton_limits
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, NewtonSettings
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.stepping.status import ACCEPTED, NOT_CONVERGED, PREDICTION_ERROR, status_message


class StepResult(NamedTuple):
    """New points along a curve, the next step size, and the reason why the last attempt failed, empty if it did not.

    There are no points if the smallest step failed. Beyond a corner, a curve may go on next to its earlier points.
    """

    points: list[CurvePoint]
    step: float
    reason: str
    is_beyond_corner: bool = False


class _Attempt(NamedTuple):
    """Status of a step, the row of its point for a table, the angle [deg], the next step size and the reason."""

    status: int
    row: Array
    turn: float
    following_step: float
    reason: str


class _History(NamedTuple):
    """Last points: u and tangent (2, history, n + 1), the newest first, their number, and the scales (n + 1,)."""

    points: Array
    number: int
    scale: Array


CORNER_TURN_RATIO = 0.9
"""Angle by which the tangent turns in half a step, over that in the whole step, from which there may be a corner."""


FAILURES_AT_CORNER = 4
"""Number of successive failures of a step, each of half the size, after which there may be a corner."""


SHORTEST_COMPILED_STEP = 1e-2
"""Smallest step size of the compiled loop along curves that have corners, over the largest step size."""


MIN_PARAMETER_COMPONENT = 0.1
"""Component of the scaled unit tangent in the parameter above which the corrector keeps the parameter value.

This is done for expensive parameters only. A smaller component is close to a fold, which needs the arclength plane.
"""


MAX_MULTIPLICATIONS_PER_CALL = 3e8
"""Number of multiplications of one compiled call. The call takes less than a second, for which Ctrl-C has to wait."""


@dataclass(frozen=True)
class Stepper:
    """Predictor and corrector of a curve.

    A compiled call ends with the first point outside ``bounds``, the ends of the span. With ``single`` each call
    computes one point only.
    """

    equations: CurveEquations
    bounds: tuple[float, float]
    steps: StepControl
    settings: NewtonSettings
    single: bool = False

    @property
    def problem(self) -> ContinuationProblem:
        """The problem."""
        return self.equations.problem

    def stride(
        self, recent: Sequence[CurvePoint], scale: Array, solution_scale: float, step: float, max_points: int
    ) -> StepResult:
        """Compute the next points of the curve, at most ``max_points``, from the last ones, the newest of them first.

        ``solution_scale`` is the largest solution norm so far.
        """
        steps, width = self.steps, len(scale)
        recent = recent[: steps.predictor_points]
        history = _History(np.zeros((2, steps.predictor_points, width)), len(recent), scale)
        for i, point in enumerate(recent):
            history.points[0, i], history.points[1, i] = point.u, point.tangent
        limit = math.inf if self.problem.is_nonsmooth else steps.max_prediction_error
        control = np.array([steps.min_step, steps.max_step, steps.max_turn_deg, steps.target_newton_iterations, limit])
        table, reason = np.empty((0, 2 * width + 4)), ""
        compiled_loop = self.problem.compiled_continuation(self.equations.name, self.equations.fixed)
        if compiled_loop is not None:
            max_count = 1 if self.single else max(1, min(max_points, int(MAX_MULTIPLICATIONS_PER_CALL / width**3)))
            out, sizes = np.empty((max_count, 2 * width + 4)), np.array([solution_scale, scale[-1]])
            table, step, reason = self._compiled_steps(compiled_loop, history, sizes, step, control, out)
        if compiled_loop is None or (self.problem.is_nonsmooth and not len(table)):
            table, following, reason, is_at_corner = self._single_step(history, step, control)
            if is_at_corner:
                result = self._past_corner(table, recent[0], scale, step)
                if result.points:
                    return result
            step = following
        if not len(table):
            corner = self.over_corner(recent[0], scale, step)
            return corner if corner.points else corner._replace(reason=reason)
        return StepResult(self._points(table, recent[0], scale), step, reason)

    def _compiled_steps(
        self, loop: Pursuit, history: _History, sizes: Array, step: float, control: Array, out: Array
    ) -> tuple[Array, float, str]:
        """Return the next points as a table, the next step size and the reason of a failure, from a compiled loop."""
        from hbgear.continuation.stepping.kernels import POLISH_ABOVE

        bounds, control, limits = np.array(self.bounds), control.copy(), newton_limits(self.settings, POLISH_ABOVE)
        if self.problem.is_nonsmooth:  # single steps search corners
            control[0] = max(control[0], SHORTEST_COMPILED_STEP * control[1])
        points, count = history.points, history.number
        accepted, step, status, detail = loop(points, count, sizes, step, bounds, control, limits, out)
        return out[:accepted], step, status_message(status, detail)

    def _past_corner(self, table: Array, last: CurvePoint, scale: Array, step: float) -> StepResult:
        """Return the last point before a corner, if it is a new one, and the point beyond it, if the curve goes on."""
        before = self._points(table, last, scale)
        beyond = self.over_corner(before[-1] if before else last, scale, step).points
        if beyond:  # steps begin as at the start of a curve
            step = max(step, self.steps.first_step)
        return StepResult(before + beyond, step, "", bool(beyond))

    def over_corner(self, last: CurvePoint, scale: Array, step: float) -> StepResult:
        """Compute a point beyond a corner near the last point, if the curve can have corners and has one there.

        The step size given is returned if there is no corner.
        """
        if not (self.problem.is_nonsmooth or isinstance(self.problem, SpecialPointProblem)):
            return StepResult([], step, "")
        corner = Corner(self.equations, self.settings, last.u, last.tangent, last.orientation, scale)
        crossing = step_over_corner(corner, self.steps.min_step, self.steps.max_turn_deg)
        if crossing is None:
            return StepResult([], step, "")
        (solution, direction, orientation), step = crossing
        numbers = [step, orientation, solution.iterations, solution.residual]
        row = np.concatenate([solution.X, [solution.value], direction, numbers])
        return StepResult(self._points(row[None], last, scale), step, "", True)

    def _points(self, table: Array, last: CurvePoint, scale: Array) -> list[CurvePoint]:
        """Return the points of a table with u, tangent, step, orientation, iterations and residual in each row."""
        out, n, direction = [], len(scale), last.parameter_direction
        moves = (table[:, 2 * n - 1] / scale[-1]).tolist()
        for row, move, (step, sign, iterations, residual) in zip(table, moves, table[:, 2 * n :].tolist(), strict=True):
            direction = parameter_direction(move, direction)
            out.append(CurvePoint(row[:n], row[n : 2 * n], int(sign), residual, int(iterations), step, direction))
        return out

    def _single_step(self, history: _History, step: float, control: Array) -> tuple[Array, float, str, bool]:
        """Return the next point as a table of one row, with step halving; an empty table if the smallest step fails.

        The last result is True if the curve has a corner there: the point is the last one before it, and the table is
        empty if that is the point from which the step begins.
        """
        attempted = partial(self._attempt, history, control, self._normal(history.points[1, 0], history.scale))
        no_point, last_turn, failures = np.empty((0, 2 * len(history.scale) + 4)), math.inf, 0
        while True:
            attempt = attempted(step)
            if attempt.status == ACCEPTED:
                return attempt.row[None], attempt.following_step, "", False
            failures += 1
            turned = attempt.turn >= CORNER_TURN_RATIO * last_turn or failures == FAILURES_AT_CORNER
            if self.problem.is_nonsmooth and turned and step > control[0]:
                return _bisect_to_corner(attempted, step, control, no_point)
            if step <= control[0]:
                return no_point, step, attempt.reason, False
            step, last_turn = max(0.5 * step, float(control[0])), attempt.turn or math.inf

    def _normal(self, tangent: Array, scale: Array) -> Array:
        """Return the normal of the plane of the corrector."""
        from hbgear.continuation.stepping.kernels import arclength_normal

        normal = np.empty(len(scale))
        arclength_normal(tangent, scale, normal)
        component = abs(tangent[-1] / scale[-1]) / norm(tangent / scale)
        if self.problem.is_expensive(self.equations.name) and component > MIN_PARAMETER_COMPONENT:
            normal[:-1], normal[-1] = 0.0, math.copysign(1.0, tangent[-1])  # the corrector keeps the parameter
        return normal

    def _attempt(self, history: _History, control: Array, normal: Array, step: float) -> _Attempt:
        """Return the result of one step of a given size."""
        from hbgear.continuation.stepping.kernels import (
            NO_ERROR_CONTROL_BELOW,
            POLISH_ABOVE,
            accept_step,
            next_step,
            predict,
        )

        (u, t), count, scale = history
        predicted, limits = np.empty(len(scale)), np.array([control[2], math.inf])
        predict(u, t, count, scale, step, predicted)
        limits[1] = control[4] if count > 1 and step > NO_ERROR_CONTROL_BELOW * control[0] else math.inf
        try:
            point = correct(self.equations, predicted, normal, self.settings, POLISH_ABOVE)
            solution, direction = point.solution, np.array(point.direction)
            u_new = point.u
            status, turn, deviation = accept_step(u_new, direction, predicted, u[0], t[0], scale, step, limits)
        except SEARCH_ERRORS as error:  # ValueError of a model
            return _Attempt(NOT_CONVERGED, np.empty(0), 0.0, step, str(error))
        numbers = [step, point.orientation, solution.iterations, solution.residual]
        following = next_step(step, solution.iterations, turn, deviation, control)
        reason = status_message(status, deviation if status == PREDICTION_ERROR else turn)
        return _Attempt(status, np.concatenate([u_new, direction, numbers]), turn, following, reason)


def _bisect_to_corner(
    attempted: Callable[[float], _Attempt], step: float, control: Array, no_point: Array
) -> tuple[Array, float, str, bool]:
    """Return the result of `Stepper._single_step` where a step of a given size does not pass a corner.

    The largest accepted step leads to the last point before the corner. A curve that turns much in an accepted step has
    a smooth bend, and its point is the next one.
    """
    table, low, high, reason = no_point, 0.0, step, ""
    while high - low > control[0]:
        middle = 0.5 * (low + high)
        attempt = attempted(middle)
        reason = attempt.reason
        if attempt.status != ACCEPTED:
            high = middle
        elif attempt.turn > 0.5 * control[2]:
            return attempt.row[None], attempt.following_step, "", False
        else:
            low, table = middle, attempt.row[None]
    return table, step, reason, True
