"""Strides along a solution curve: some rows predicted and corrected together, and how far the next ones may go.

    predictor   u_p = Hermite extrapolation through the last rows with their tangents, u = (X, lambda)
    corrector   R(u) = 0,  n^T (u - u_p) = 0    Newton with the bordered matrix [J R_lambda; n^T]

The extrapolation is good far beyond the next row where the curve is smooth, and a problem that evaluates many points
in one set of arrays does so for little more than the price of one. Rows are judged in their order as if they had been
found one by one; those behind the first that is refused are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.algebra import norm, norms, orientations
from hbgear.continuation.corrector import Corrected, correct_all
from hbgear.continuation.newton import Settings
from hbgear.continuation.predictor import predict
from hbgear.continuation.problem import FullProblem
from hbgear.continuation.segment import CurvePoint, normal_of, row_along
from hbgear.continuation.stepsize import Pace, StepControl


class Stride(NamedTuple):
    """Rows found, the pace of the next stride, and why not more were found."""

    rows: list[CurvePoint]
    pace: Pace
    reason: str


_HASTE = 1e3  # steps below so many of the shortest are not shortened for the sake of the prediction


_FAR = 1.5  # distance of two rows, in steps, that is too large


_BENT = 0.8  # cosine of the turn of a stride at which it ends


_FURTHER = 2  # rows sought together beyond those of the last stride: those that are refused cost little


@dataclass(frozen=True)
class Strider:
    """Finds rows of the curve of a problem in a parameter, the others fixed.

    miss : as `StepControl.max_prediction_error`; infinite where the curve itself has corners.
    bounds : the span of the parameter; a stride ends with the first row predicted outside.
    """

    problem: FullProblem
    name: str
    fixed: Mapping[str, float]
    bounds: tuple[float, float]
    steps: StepControl
    miss: float
    settings: Settings

    def stride(self, rows: Sequence[CurvePoint], scale: Array, pace: Pace) -> Stride:
        """The next rows behind the last ones, which are given with the newest first; none if the step is too long."""
        unit = rows[0].tangent / norm(rows[0].tangent / scale)
        normal = normal_of(unit, scale)
        predicted = self._ahead(rows, unit, scale, pace)
        try:
            points, reason = correct_all(
                self.problem, predicted, normal / norm(normal), self.name, self.fixed, self.settings
            )
        except (ValueError, np.linalg.LinAlgError) as error:  # out of the range of a model, or a singular matrix
            return Stride([], Pace(pace.step) if pace.rows > 1 else self.shorter(pace.step), str(error))
        found, reason_of, turns, misses = self._judged(rows, predicted, points, scale, pace.step)
        reason = reason_of or reason
        if not found:
            return Stride([], self.shorter(pace.step), reason)
        together = min(self.steps.batch, len(found) + _FURTHER)
        step = self._next_step(found[0].solution.iterations, max(turns), misses[0], pace.step)
        return Stride(found, Pace(step, together), reason)

    def _ahead(self, rows: Sequence[CurvePoint], unit: Array, scale: Array, pace: Pace) -> Array:
        """Predictions, as far as the curve they tell of neither turns much nor leaves the span."""
        predicted = predict(rows, unit, scale, pace.step * np.arange(1, pace.rows + 1))
        if len(predicted) == 1:
            return predicted
        last = np.concatenate([rows[0].u[None], predicted[:-1]])
        length = norms((predicted - last) / scale)
        outside = (predicted[:, -1] < self.bounds[0]) | (predicted[:, -1] > self.bounds[1])
        bent = ~(length * _BENT < pace.step)
        bent[0] = False
        ends = np.flatnonzero(bent | np.concatenate([[False], outside[:-1]]))
        return predicted[: ends[0]] if ends.size else predicted

    def _judged(
        self, rows: Sequence[CurvePoint], predicted: Array, points: Sequence[Corrected], scale: Array, step: float
    ) -> tuple[list[CurvePoint], str, list[float], list[float]]:
        """Rows up to the first that is refused, why it was, and turns [deg] and misses of all that were looked at."""
        if not points:
            return [], "", [], []
        u = np.array([rows[0].u, *(np.append(p.solution.X, p.solution.value) for p in points)])
        t = np.array([rows[0].tangent, *(p.direction for p in points)]) / scale
        t /= norms(t)[:, None]
        turns = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", t[1:], t[:-1]), -1.0, 1.0))).tolist()
        gaps = (norms((u[1:] - u[:-1]) / scale) / step).tolist()
        misses = (norms((u[1:] - predicted[: len(points)]) / scale) / step).tolist()
        signs = orientations([p.A for p in points])
        missing = len(rows) > 1 and step > _HASTE * self.steps.shortest
        found: list[CurvePoint] = []
        for i, point in enumerate(points):
            reason = ""
            if gaps[i] > _FAR:
                reason = "the corrector landed far from the prediction"
            elif turns[i] > self.steps.max_turn_deg:
                reason = f"the tangent turned by {turns[i]:.0f} degrees"
            elif missing and misses[i] > self.miss:
                reason = f"the prediction missed the curve by {misses[i]:.0%} of the step"
            if reason:
                return found, reason, turns[: i + 1], misses[: i + 1]
            found.append(row_along(point.solution, u[i + 1], scale * t[i + 1], signs[i], scale, step,
                                   found[-1] if found else rows[0]))  # fmt: skip
        return found, "", turns, misses

    def shorter(self, step: float) -> Pace:
        """The pace after a step that was too long."""
        return Pace(max(0.5 * step, self.steps.shortest))

    def _next_step(self, iterations: int, angle: float, missed: float, step: float) -> float:
        """Next step from the Newton count, the turning angle and the prediction, at most doubled or halved."""
        by_newton = 2.0 ** ((self.steps.newton - iterations) / 2)
        by_angle = 0.5 * self.steps.max_turn_deg / max(angle, 0.1)
        by_miss = (0.5 * self.miss / max(missed, 1e-9)) ** 0.5
        factor = min(2.0, max(0.5, min(by_newton, by_angle, by_miss)))
        length: float = min(self.steps.longest, max(self.steps.shortest, factor * step))
        return length
