"""Strides along a solution curve: the next rows behind the last ones, and how far the next step may go.

Problems that bring a compiled loop of their own (`problem.Pursued`) are followed by it for many rows at once, all
others one row after the other. The rules are the same, and stand in `stepping`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.curve.segment import CurvePoint, parameter_direction
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.solvers.corrector import correct
from hbgear.continuation.solvers.newton import NewtonSettings, NoConvergence
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.stepping.status import ACCEPTED, NOT_CONVERGED, PREDICTION_ERROR, status_message


class StepResult(NamedTuple):
    """Rows found, the next step, and why the last attempt failed if there are none."""

    rows: list[CurvePoint]
    step: float
    reason: str


_STEADY = 0.35  # least share of the parameter in the tangent with which rows are sought at a value given beforehand


_WORK = 3e8  # multiplications of one call, so that Ctrl-C is heard within a second


@dataclass(frozen=True)
class Stepper:
    """Finds rows of the curve of a problem in a parameter, the others fixed.

    bounds : the span of the parameter; a stride ends with the first row outside.
    single : one row at a time, whatever the problem offers.
    """

    problem: ContinuationProblem
    name: str
    fixed: Mapping[str, float]
    bounds: tuple[float, float]
    steps: StepControl
    settings: NewtonSettings
    single: bool = False

    def stride(self, rows: Sequence[CurvePoint], scale: Array, top: float, step: float, most: int) -> StepResult:
        """The next rows, at most so many, behind the last ones, which are given with the newest first.

        scale : of u; top : size of the largest motion so far. Without rows the shortest step has failed.
        """
        steps, settings, history = self.steps, self.settings, self.steps.predictor_points
        count, width = min(len(rows), history), len(scale)
        u, t = np.zeros((2, history, width))
        for i, row in enumerate(rows[:count]):
            u[i], t[i] = row.u, row.tangent
        miss = math.inf if self.problem.is_nonsmooth else steps.max_prediction_error
        control = np.array([steps.min_step, steps.max_step, steps.max_turn_deg, steps.target_newton_iterations, miss])
        tolerances = np.array([settings.tolerance, settings.step_tolerance, settings.max_iterations])
        pursue = self.problem.compiled_continuation(self.name, self.fixed)
        if pursue is None:
            found, step, refusal = self._one(u, t, count, scale, step, control)
        else:
            most = 1 if self.single else max(1, min(most, int(_WORK / width**3)))
            out = np.empty((most, 2 * width + 4))
            made, step, why, number = pursue(
                u, t, count, np.array([top, scale[-1]]), step, np.array(self.bounds), control, tolerances, out
            )
            found, refusal = out[:made], status_message(why, number)
        return StepResult(self._rows(found, rows[0], scale), step, refusal)

    def _rows(self, found: Array, before: CurvePoint, scale: Array) -> list[CurvePoint]:
        """Rows of a table of u, tangent, step, orientation, iterations, residual."""
        out, n, heading = [], len(scale), before.heading
        moves = (found[:, 2 * n - 1] / scale[-1]).tolist()
        for row, move, (step, sign, iterations, residual) in zip(found, moves, found[:, 2 * n :].tolist(), strict=True):
            heading = parameter_direction(move, heading)
            out.append(CurvePoint(row[:n], row[n : 2 * n], int(sign), residual, int(iterations), step, heading))
        return out

    def _one(
        self, u: Array, t: Array, count: int, scale: Array, step: float, control: Array
    ) -> tuple[Array, float, str]:
        """The next row of any problem, with shorter and shorter steps; none if the shortest fails."""
        from hbgear.continuation.stepping.kernels import (
            NO_ERROR_CONTROL_BELOW,
            POLISH_ABOVE,
            accept_step,
            arclength_normal,
            next_step,
            predict,
        )

        normal, predicted, limits = np.empty(len(scale)), np.empty(len(scale)), np.array([control[2], math.inf])
        arclength_normal(t[0], scale, normal)
        if self.problem.is_expensive(self.name) and abs(t[0, -1] / scale[-1]) > _STEADY * norm(t[0] / scale):
            normal[:-1], normal[-1] = 0.0, math.copysign(1.0, t[0, -1])  # Newton keeps the value of the parameter
        while True:
            predict(u, t, count, scale, step, predicted)
            limits[1] = control[4] if count > 1 and step > NO_ERROR_CONTROL_BELOW * control[0] else math.inf
            try:
                point = correct(self.problem, predicted, normal, self.name, self.fixed, self.settings, POLISH_ABOVE)
                solution, direction = point.solution, np.array(point.direction)
                found = np.append(solution.X, solution.value)
                why, turn, missed = accept_step(found, direction, predicted, u[0], t[0], scale, step, limits)
                refusal = status_message(why, missed if why == PREDICTION_ERROR else turn)
            except (ValueError, NoConvergence, np.linalg.LinAlgError) as error:  # out of the range of a model, ...
                why, refusal = NOT_CONVERGED, str(error)
            if why == ACCEPTED:
                told = [step, point.orientation, solution.iterations, solution.residual]
                step = next_step(step, solution.iterations, turn, missed, control)
                return np.concatenate([found, direction, told])[None], step, ""
            if step <= control[0]:
                return np.empty((0, 2 * len(scale) + 4)), step, refusal
            step = max(0.5 * step, float(control[0]))
