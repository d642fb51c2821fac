"""Strides along a solution curve: some rows predicted and corrected together, and how far the next ones may go.

    predictor   u_p = Hermite extrapolation through the last rows with their tangents, u = (X, lambda)
    corrector   R(u) = 0,  n^T (u - u_p) = 0    Newton with the bordered matrix [J R_lambda; n^T]

The extrapolation is good far beyond the next row where the curve is smooth, and a problem that evaluates many points
in one set of arrays does so for little more than the price of one. Rows are judged in their order as if they had been
found one by one; those behind the first that is refused are dropped.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hbgear.arc import Row, normal_of, orientations, row_along
from hbgear.fourier import Array
from hbgear.newton import Corrected, Settings, correct_all, norm, norms
from hbgear.ranges import checked, counted


@dataclass(frozen=True)
class Steps:
    """Step control, in scaled arclength (the span of the parameter is 1).

    first, longest, shortest : step lengths.
    turn : largest angle [deg] between successive tangents; steps aim at half of it.
    newton : Newton steps per point the step length aims at.
    miss : largest distance of a point from its prediction, as a share of the step: what the curve does that its last
        rows do not tell, a small loop for instance, is looked at in smaller steps. Not used with sampled corners.
    support : rows the predictor extrapolates from, at most; 1 is the tangent alone.
    ahead : rows predicted and corrected together, at most, where that is cheaper: in Omega, with a fixed number of
        harmonics and no sampled corners. The rows obey the same limits as one after the other.
    max_points : rows after which the trace stops.

    Raises
    ------
    ValueError
        If lengths are not positive and in order, or a limit is out of range.
    """

    first: float = 0.01
    longest: float = 0.04
    shortest: float = 1e-7
    turn: float = 20.0
    newton: int = 3
    miss: float = 0.02
    support: int = 4
    ahead: int = 8
    max_points: int = 5000

    def __post_init__(self) -> None:
        for name in ("first", "longest", "shortest", "turn", "miss"):
            checked("Steps", name, getattr(self, name))
        for name, least in (("newton", 1), ("support", 1), ("ahead", 1), ("max_points", 2)):
            counted(f"Steps: {name}", getattr(self, name), least=least)
        if not 0 < self.shortest <= self.first <= self.longest < math.inf:
            raise ValueError(
                f"step lengths must obey 0 < shortest <= first <= longest, got {self.shortest}, {self.first}, "
                f"{self.longest}"
            )
        if not 0 < self.turn <= 60:
            raise ValueError(f"turn = {self.turn} degrees must be above 0 and at most 60")
        if not 0 < self.miss <= 1:
            raise ValueError(f"miss = {self.miss} must be above 0 and at most 1")


class Pace(NamedTuple):
    """Length of the next step, and how many rows are sought together."""

    step: float
    rows: int = 1


class Stride(NamedTuple):
    """Rows found, the pace of the next stride, and why not more were found."""

    rows: list[Row]
    pace: Pace
    reason: str


_HASTE = 1e3  # steps below so many of the shortest are not shortened for the sake of the prediction
_FAR = 1.5  # distance of two rows, in steps, that is too large
_BENT = 0.8  # cosine of the turn of a stride at which it ends
_FURTHER = 2  # rows sought together beyond those of the last stride: those that are refused cost little


@dataclass(frozen=True)
class Strider:
    """Finds rows of the curve of a problem in a parameter, the others fixed.

    miss : as `Steps.miss`; infinite where the curve itself has corners.
    bounds : the span of the parameter; a stride ends with the first row predicted outside.
    """

    problem: Any
    name: str
    fixed: Mapping[str, float]
    bounds: tuple[float, float]
    steps: Steps
    miss: float
    settings: Settings

    def stride(self, rows: Sequence[Row], scale: Array, pace: Pace) -> Stride:
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
        together = min(self.steps.ahead, len(found) + _FURTHER)
        step = self._next_step(found[0].solution.iterations, max(turns), misses[0], pace.step)
        return Stride(found, Pace(step, together), reason)

    def _ahead(self, rows: Sequence[Row], unit: Array, scale: Array, pace: Pace) -> Array:
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
        self, rows: Sequence[Row], predicted: Array, points: Sequence[Corrected], scale: Array, step: float
    ) -> tuple[list[Row], str, list[float], list[float]]:
        """Rows up to the first that is refused, why it was, and turns [deg] and misses of all that were looked at."""
        if not points:
            return [], "", [], []
        u = np.array([rows[0].u, *(np.append(p.solution.X, p.solution.value) for p in points)])
        t = np.array([rows[0].tangent, *(p.direction for p in points)]) / scale
        t /= norms(t)[:, None]
        turns = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", t[1:], t[:-1]), -1.0, 1.0))).tolist()
        gaps = (norms((u[1:] - u[:-1]) / scale) / step).tolist()
        misses = (norms((u[1:] - predicted[: len(points)]) / scale) / step).tolist()
        signs = orientations(np.array([p.A for p in points]))
        missing = len(rows) > 1 and step > _HASTE * self.steps.shortest
        found: list[Row] = []
        for i, point in enumerate(points):
            reason = ""
            if gaps[i] > _FAR:
                reason = "the corrector landed far from the prediction"
            elif turns[i] > self.steps.turn:
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
        by_angle = 0.5 * self.steps.turn / max(angle, 0.1)
        by_miss = (0.5 * self.miss / max(missed, 1e-9)) ** 0.5
        factor = min(2.0, max(0.5, min(by_newton, by_angle, by_miss)))
        return min(self.steps.longest, max(self.steps.shortest, factor * step))


_STRAIGHT = 0.3  # share of the step by which the first predicted bend may move the point; cosine of the last turn


def predict(rows: Sequence[Row], unit: Array, scale: Array, distance: Array) -> Array:
    """Unknowns (k, n + 1) at distances (k,) along the tangent ``unit`` from the last row: Hermite extrapolation.

    Parameters
    ----------
    rows : the last rows, the newest first. Through one of them with its tangent goes a line, through two a cubic,
        through r a polynomial of degree 2r - 1, in the distance x = unit . (u - u_0) (scaled). As many are used
        as bring smaller and smaller changes: beyond that the curve is not smooth on their scale.
    """
    along = normal_of(unit, scale)
    u, t = np.array([row.u for row in rows]), np.array([row.tangent for row in rows])
    x, cosine = (u - u[0]) @ along, t @ along
    steep = np.flatnonzero(cosine[1:] < _STRAIGHT * norms(t[1:] / scale))
    r = 1 + int(steep[0]) if steep.size else len(rows)
    value, slope = _hermite(x[:r], distance)
    guesses = np.concatenate([
        (rows[0].u + distance[:, None] * unit)[None], value @ u[:r] + (slope / cosine[:r]) @ t[:r]
    ])  # fmt: skip
    change = np.sqrt(np.square((guesses[1:] - guesses[:-1]) / scale).sum(axis=2))
    before = np.concatenate([_STRAIGHT * distance[None], change])
    better = np.logical_and.accumulate(change < before[:-1], axis=0).sum(axis=0)
    return guesses[better, np.arange(len(distance))]


def _hermite(x: Array, at: Array) -> tuple[Array, Array]:
    """Weights (r - 1, k, r) of values and slopes at the nodes x (r,) in Hermite polynomials, evaluated at (k,).

    They go through the first 2, ..., r nodes: L_i^2 (1 - 2 (x - x_i) sum_j 1 / (x_i - x_j)) and L_i^2 (x - x_i), with
    Lagrange's polynomials L_i.
    """
    used, others = _used(len(x))
    gap = np.where(others, x[:, None] - x, 1.0)  # from every node to the others that are used
    off = at[:, None] - x
    lagrange = np.where(used[:, None], off, 1.0).prod(axis=2)[..., None] / (off * gap.prod(axis=2)[:, None])
    squared = np.where(used[:, None], lagrange * lagrange, 0.0)
    slope = off * squared
    steep = np.where(others, 1.0 / gap, 0.0).sum(axis=2)
    return squared - 2 * steep[:, None] * slope, slope


@lru_cache(maxsize=16)
def _used(r: int) -> tuple[np.ndarray, np.ndarray]:
    """Which of r nodes the polynomials through the first 2, ..., r use (r - 1, r), and beside each (r - 1, r, r)."""
    used = np.arange(r) < np.arange(2, r + 1)[:, None]
    return used, used[:, :, None] & used[:, None] & ~np.eye(r, dtype=bool)
