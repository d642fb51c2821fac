"""Predicted amplitudes of measured sweeps and their derivatives: residuals of a fit and distances from the curve.

    d_i = A(X(Omega_i, a)),   dd_i/da = A_X (X_a + X_Omega dOmega_i/da),   Omega_i = f_i / s(a)

The motion X of each point is chosen by `hbgear.design.fitting.sweep_motions`. For a point beyond the end of its segment
the distance in frequency is a residual as well, so that the point attracts the jump.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from hbgear.analysis.parameter_sensitivity.sensitivity import sensitivity
from hbgear.analysis.parameter_sensitivity.units import measured_along
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.sensitivity import tangent
from hbgear.continuation.numerics.linear import Factors
from hbgear.continuation.results.point import Jump
from hbgear.continuation.solvers.newton import SEARCH_ERRORS
from hbgear.design.fitting.sweep_motions import COARSE_DEVIATION, END, SweepMotions, overshoot_residual

MISSING_JUMP_DISTANCE = 0.1
"""Relative distance in frequency that is assumed for a jump that the model does not have."""


class Prediction(SweepMotions):
    """Response of a model compared with measurements: residuals, distances and their derivatives.

    `SweepMotions` states the parameters.
    """

    # ---- residuals

    def residuals(self, deviation: Array) -> Array:
        """Return residuals (2N + J,) in deviations: amplitudes, frequencies of points beyond an end, and jumps."""
        data = self.data
        offsets = np.nan_to_num((self.amplitudes - data.amplitude) / deviation)
        overshoots = [
            0.0 if reference.jump is None else overshoot_residual(Omega - reference.jump.value, Omega)[0]
            for reference, Omega in zip(self.references, self.Omega.tolist(), strict=True)
        ]
        pairs = zip(data.jumps, self.jump_frequencies.tolist(), strict=True)
        jumps = [
            MISSING_JUMP_DISTANCE * f / s if math.isnan(model_frequency) else (model_frequency - f) / s
            for (f, _, s), model_frequency in pairs
        ]
        return np.concatenate([offsets, overshoots, jumps])

    def jacobian(self, deviation: Array) -> Array:
        """Return the derivatives (2N + J, A) of `residuals`."""
        J, count = self._derivatives.copy(), len(self.data)
        J[:count] /= deviation[:, None]
        return J

    def information(self, deviation: Array) -> Array:
        """Return the Jacobian without the points beyond the end of their segment.

        Such a point only requires that the segment reaches it; it contains no further information once it does.
        """
        J, count = self.jacobian(deviation), len(self.data)
        for i, reference in enumerate(self.references):
            if reference.jump is not None:
                J[[i, count + i]] = 0.0
        return J

    @cached_property
    def _derivatives(self) -> Array:
        """Derivatives of `residuals`, with amplitudes in the unit of the data."""
        data, count = self.data, len(self.data)
        J = np.zeros((2 * count + len(data.jumps), len(self.names)))
        length, length_slopes = self.length
        scale, scale_slopes = self.unit_of(data.unit)
        slopes = self._slopes()
        for i, reference in enumerate(self.references):
            if reference.jump is not None:
                jump_slopes = self._jump_derivatives(reference.jump)
                size = reference.jump.before.amplitude(data.measure, data.element)
                J[i] = length * jump_slopes["size"] + size * length_slopes
                # derivative of 1 - Omega_j / Omega with Omega = f / s
                Omega = float(self.Omega[i])
                rate = overshoot_residual(Omega - reference.jump.value, Omega)[1]
                J[count + i] = -rate * (jump_slopes["Omega"] + reference.jump.value * scale_slopes / scale)
            elif i in slopes:
                J[i] = length * slopes[i] + float(self.amplitudes[i]) / length * length_slopes
        for j, (frequency, direction, deviation) in enumerate(data.jumps, 2 * count):
            jump = self.nearest_jump(direction, frequency)
            if jump is not None:
                J[j] = (scale * self._jump_derivatives(jump)["Omega"] + jump.value * scale_slopes) / deviation
        return np.nan_to_num(J)

    # ---- distances of points and curve

    @cached_property
    def _nearest(self) -> tuple[list[int], Array, Array]:
        """Index in `points` of the stable point nearest to each measured point, and both distances.

        The distances are in frequency and amplitude.
        """
        data = self.data
        rows = np.flatnonzero(self.points.stable)
        if not rows.size or not len(data):
            return [], np.zeros(0), np.zeros(0)
        sizes = self.curve_amplitudes[rows]
        deviations = np.maximum(data.deviation, COARSE_DEVIATION * data.amplitude)
        dOmega = (self.points.Omega[rows] - self.Omega[:, None]) / (COARSE_DEVIATION * self.Omega[:, None])
        dA = (sizes - data.amplitude[:, None]) / deviations[:, None]
        nearest = np.argmin(np.hypot(dOmega, dA), axis=1)
        numbers = np.arange(len(data))
        return (rows[nearest].tolist(), dOmega[numbers, nearest], dA[numbers, nearest])

    @cached_property
    def distances(self) -> Array:
        """Distances (N + J,) of the points from the stable segments and of the jumps from the measured ones.

        Frequency and amplitude are both relative. The distance has a gradient for distant points too, so that a
        resonance at another frequency is moved to the measured points.
        """
        _, dOmega, dA = self._nearest
        unit = self.unit_of(self.data.unit)[0]
        jumps = []
        for frequency, direction, _ in self.data.jumps:
            jump = self.nearest_jump(direction, frequency)
            jumps.append(
                MISSING_JUMP_DISTANCE / COARSE_DEVIATION
                if jump is None
                else (unit * jump.value / frequency - 1.0) / COARSE_DEVIATION
            )
        return np.concatenate([np.hypot(dOmega, dA), jumps])

    @cached_property
    def distance_jacobian(self) -> Array:
        """Derivatives (N + J, A) of `distances`."""
        data = self.data
        (length, length_slopes), (scale, scale_slopes) = self.length, self.unit_of(data.unit)
        rows, dOmega, dA = self._nearest
        slopes = self._slopes_at(sorted(set(rows)))
        J = np.zeros((len(self.distances), len(self.names)))
        for i, row in enumerate(rows):
            if row in slopes and self.distances[i]:
                deviation = max(data.deviation[i], COARSE_DEVIATION * data.amplitude[i])
                amplitude_slopes = (
                    length * slopes[row] + self.curve_amplitudes[row] / length * length_slopes
                ) / deviation
                frequency_slopes = self.points.Omega[row] * scale_slopes / (scale * COARSE_DEVIATION * self.Omega[i])
                J[i] = (dA[i] * amplitude_slopes + dOmega[i] * frequency_slopes) / self.distances[i]
        for j, (frequency, direction, _) in enumerate(data.jumps, len(rows)):
            jump = self.nearest_jump(direction, frequency)
            if jump is not None:
                J[j] = (scale * self._jump_derivatives(jump)["Omega"] + jump.value * scale_slopes) / (
                    COARSE_DEVIATION * frequency
                )
        return np.nan_to_num(J)

    def _slopes_at(self, rows: Sequence[int]) -> dict[int, Array]:
        """Return derivatives of the amplitudes of `points` at constant frequency.

        They are in the unit of the model.
        """
        if not rows:
            return {}
        X, Omega = self.points.X[list(rows)], self.points.Omega[list(rows)]
        solved, directions = self._solution_derivatives(X, Omega)
        return dict(zip((rows[i] for i in solved), self._measured_along(X[solved], directions), strict=True))

    def _solution_derivatives(self, X: Array, Omega: Array) -> tuple[list[int], Array]:
        """Return the indices of motions with finite derivatives (all but folds) and the derivatives (P, A, n)."""
        parameters = {**self.problem.model.entries, **self.parameter_values}
        residual_slopes = np.stack(
            [self.problem.parameter_derivatives(X, Omega, name, parameters) for name in self.names], axis=1
        )
        solved, directions = [], []
        for i, w in enumerate(Omega.tolist()):
            direction = -Factors(self.problem.evaluate(X[i], **parameters, Omega=w)[1]).solve(residual_slopes[i].T).T
            if np.isfinite(direction).all():
                solved.append(i)
                directions.append(direction)
        return solved, np.array(directions).reshape(len(solved), *residual_slopes.shape[1:])

    def _jump_derivatives(self, jump: Jump) -> dict[str, Array]:
        """Return the derivatives of the frequency of a jump and of the amplitude before it."""
        if jump.label not in self._cached_jump_derivatives:
            try:
                slopes = sensitivity(jump.before, self.names, measure=self.data.measure, element=self.data.element)
                derivatives = {"Omega": slopes.slopes[0], "size": np.array(list(slopes.of(self.data.measure).values()))}
            except SEARCH_ERRORS:
                derivatives = {"Omega": np.zeros(len(self.names)), "size": np.zeros(len(self.names))}
            self._cached_jump_derivatives[jump.label] = derivatives
        return self._cached_jump_derivatives[jump.label]

    @cached_property
    def _cached_jump_derivatives(self) -> dict[str, dict[str, Array]]:
        return {}

    def _slopes(self) -> dict[int, Array]:
        """Return derivatives of the amplitudes in the unit of the model, by index of the measured point."""
        scale, scale_slopes = self.unit_of(self.data.unit)
        first_index: dict[tuple[float, float], int] = {}
        for i, (motion, reference) in enumerate(zip(self.motions, self.references, strict=True)):
            if motion is not None and reference.kind != END:
                first_index.setdefault((float(self.Omega[i]), reference.position), i)
        selected = list(first_index.values())
        if not selected:
            return {}
        X, Omega = np.array([self.motions[i][0] for i in selected]), self.Omega[selected]  # type: ignore[index]
        solved, directions = self._solution_derivatives(X, Omega)
        if scale_slopes.any():
            parameters = {**self.problem.model.entries, **self.parameter_values}
            for X_a, i in zip(directions, solved, strict=True):
                t = tangent(self.problem, X[i], {**parameters, "Omega": float(Omega[i])}, "Omega")
                X_a -= np.outer(Omega[i] * scale_slopes / scale, t)
        slopes = dict(zip((selected[i] for i in solved), self._measured_along(X[solved], directions), strict=True))
        first_by_point = {
            i: first_index.get((float(self.Omega[i]), reference.position), -1)
            for i, reference in enumerate(self.references)
        }
        return {i: slopes[first] for i, first in first_by_point.items() if first in slopes}

    def _measured_along(self, X: Array, directions: Array) -> Array:
        """Return derivatives (P, A) of the measure of motions X (P, n) in the directions (P, A, n)."""
        return measured_along(self.problem.layout, self.data.measure, self.data.element, X, directions)
