"""Periodic motions of a model with which the points of measured sweeps are compared.

The jumps of a sweep determine its motion where several stable motions exist. Another stable motion, or the end of the
stable segment from which the sweep came, replaces it if the measured amplitude is far from the motion of the sweep and
close to the other one. The reason is that a sweep that jumped slightly earlier or later than the sweep of the model
contains no information about the motion that it left or did not reach. A point beyond the end of its segment is
compared with this end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hbgear.analysis.jump_landings import landings
from hbgear.analysis.parameter_sensitivity.units import LENGTH, units_at
from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import norm
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.interpolation import Crossing, crossings_at
from hbgear.continuation.results.point import Jump
from hbgear.continuation.results.stability import is_stable
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.continuation.tracing.trace import trace
from hbgear.design.fitting.measurements import Measurements
from hbgear.design.studies.sweep_statistics import stable_segments, sweep_response
from hbgear.harmonic.harmonic_balance import HarmonicBalance

SWEPT, OTHER, END, UNREACHED = "swept", "other", "end", "unreached"
"""Kinds of the motion with which a measured point is compared.

They are the motion of the sweep, another stable motion, the end of the stable segment of the sweep, or none."""

SWITCH_DEVIATIONS = 5.0
"""Distance of an amplitude from the motion of the sweep, in deviations, above which another motion is considered."""

SWITCH_RATIO = 0.8
"""Largest ratio of the distances to another motion and to the motion of the sweep for which the former is used."""

MAX_END_DISTANCE = 0.15
"""Largest relative distance in frequency between the end of a segment and a point that is compared with it."""

FREQUENCY_DEVIATION = 1e-3
"""Relative deviation of the frequencies of points beyond the end of their segment."""

POSITION_DECIMALS = 6
"""Decimals of positions on the curve, so that the motions that both sweeps pass are computed once."""

COARSE_DEVIATION = 0.03
"""Relative deviation of frequencies and amplitudes in the distances between points and curve."""


class NotTraced(ValueError):
    """The response of the model cannot be traced with these values."""


class SampledCurves(NamedTuple):
    """Points (P,) of all curves of a model: Omega, amplitude, stability and unknowns (P, n); nan between curves."""

    Omega: Array
    amplitude: Array
    stable: NDArray[np.bool_]
    X: Array


@dataclass(frozen=True)
class Reference:
    """Motion with which a measured point is compared.

    ``position`` is the index in `SweepMotions.points` with its fraction; ``jump`` is the jump at the end of a segment.
    """

    kind: str
    position: float = math.nan
    jump: Jump | None = None


class SweepMotions:
    """Curves of a model over a span of Omega with given values of some parameters, and its motions at measured points.

    NotTraced is raised if no complete curve over the span can be traced.
    """

    def __init__(
        self, problem: HarmonicBalance, data: Measurements, values: Mapping[str, float], span: tuple[float, float]
    ) -> None:
        self.problem, self.data, self.names = problem.with_cache_size(2 * len(values) + 10), data, tuple(values)
        model = problem.model
        self.parameter_values = {**model.parameters, **values}
        try:
            self.units = units_at(self.problem, {**model.entries, **self.parameter_values}, self.names)
            self.curve = raise_if_interrupted(trace(self.problem, "Omega", span, at=dict(values), accuracy=None))
        except (NoConvergence, ValueError) as error:
            raise NotTraced(f"no response at {_values_text(values)}: {error}") from error
        if not len(self.curve) or self.curve.multipliers is None or not self.curve.status.complete:
            raise NotTraced(f"no response at {_values_text(values)}: {self.curve.message}")

    # ---- points of the curves

    @cached_property
    def curves(self) -> tuple[Branch, ...]:
        """The curve and the other curves that cover the span."""
        return self.curve.curves

    @cached_property
    def points(self) -> SampledCurves:
        """Points of all curves."""
        rows = []
        for curve in self.curves:
            assert curve.multipliers is not None
            A = curve.amplitude(self.data.measure, self.data.element)
            columns = np.column_stack([curve.values, A, is_stable(curve.multipliers), curve.X])
            rows += [columns, np.full((1, columns.shape[1]), math.nan)]
        table = np.concatenate(rows[:-1])
        return SampledCurves(table[:, 0], table[:, 1], table[:, 2] == 1.0, table[:, 3:])

    def _crossings_at(self, Omega: float) -> list[Crossing]:
        """Return the crossings of all curves with a value of Omega, in indices of `points`."""
        starts = np.cumsum([0, *(len(curve) + 1 for curve in self.curves)]).tolist()
        return [
            Crossing(start + crossing.index, crossing.fraction)
            for start, curve in zip(starts, self.curves, strict=False)
            for crossing in crossings_at(curve, Omega)
        ]

    # ---- frequencies and positions

    @cached_property
    def Omega(self) -> Array:
        """Values of Omega (N,) of the measured points."""
        return np.asarray(self.data.frequency / self.unit_of(self.data.unit)[0])

    def unit_of(self, name: str) -> tuple[float, Array]:
        """Return a unit of frequency, or `LENGTH`, in the unit of the model, and its derivatives."""
        units, derivatives = self.units
        if name not in units and name == "Omega":
            return 1.0, np.zeros(len(self.names))
        return units[name], derivatives[name]

    @cached_property
    def length(self) -> tuple[float, Array]:
        """Unit of length of the model in the unit of the data, and its derivatives."""
        return self.unit_of(LENGTH) if self.data.length else (1.0, np.zeros(len(self.names)))

    @cached_property
    def jumps(self) -> tuple[Jump, ...]:
        """Jumps of slow sweeps of the curves."""
        all_jumps = (landing.jump for of_curve in landings(self.curves) for landing in of_curve)
        return tuple(jump for jump in all_jumps if jump.parameter == "Omega")

    @cached_property
    def references(self) -> list[Reference]:
        """Motion with which each measured point is compared."""
        data, points = self.data, self.points
        sampled = np.array([points.Omega, np.arange(len(points.Omega)), points.stable], dtype=float)
        amplitude = self.curve_amplitudes
        segments = list(stable_segments(sampled))
        positions = np.full(len(data), math.nan)
        for direction in (1, -1):
            selected = np.flatnonzero(data.directions == direction)
            order = selected[np.argsort(self.Omega[selected])]
            if order.size and segments:
                ends = [self._jump_positions(jump) for jump in self.jumps if jump.direction == direction]
                jumps = np.array(ends).reshape(-1, 3)
                positions[order] = sweep_response(sampled, jumps, self.Omega[order], direction)[0]
        positions = np.round(positions, POSITION_DECIMALS)
        return [self._reference(i, float(positions[i]), segments, amplitude) for i in range(len(data))]

    @cached_property
    def curve_amplitudes(self) -> Array:
        """Amplitudes (P,) of `points`, in the unit of the data."""
        return self.length[0] * self.points.amplitude

    def _jump_positions(self, jump: Jump) -> tuple[float, float, float]:
        """Return Omega and the positions in `points` before and after a jump; nan without a known landing."""
        after = jump.after
        if after is None:
            return jump.value, math.nan, math.nan
        crossings, X = self._crossings_at(jump.value), self.points.X
        nearest = min(crossings, key=lambda crossing: norm(crossing.interpolate(X) - self.problem.from_point(after)))
        return jump.value, math.nan, nearest.index + nearest.fraction

    def _reference(
        self, i: int, position: float, segments: Sequence[tuple[Array, Array]], amplitude: Array
    ) -> Reference:
        """Return the motion to which a measured point belongs: on the sweep, or another one that fits far better."""
        Omega, measured = float(self.Omega[i]), float(self.data.amplitude[i])
        deviation, direction = float(self.data.deviation[i]), int(self.data.directions[i])

        def distance(index: float) -> float:
            return abs(float(np.interp(index, np.arange(len(amplitude)), amplitude)) - measured) / deviation

        options: list[tuple[float, Reference]] = []
        for x, y in segments:
            if x[0] <= Omega <= x[-1]:
                index = round(float(np.interp(Omega, x, y)), POSITION_DECIMALS)
                options.append((distance(index), Reference(OTHER, index)))
        for jump in self.jumps:
            overshoot = (Omega - jump.value) * direction
            if jump.direction == direction and 0 < overshoot <= MAX_END_DISTANCE * Omega:
                size = self.length[0] * jump.before.amplitude(self.data.measure, self.data.element)
                residual = overshoot_residual(overshoot, Omega)[0]
                options.append((math.hypot((size - measured) / deviation, residual), Reference(END, jump=jump)))
        swept_distance = distance(position) if math.isfinite(position) else math.inf
        best, reference = min(options, key=lambda option: option[0], default=(math.inf, Reference(UNREACHED)))
        if (
            swept_distance <= SWITCH_DEVIATIONS
            or best > SWITCH_RATIO * swept_distance
            or reference.position == position
        ):
            reference = Reference(SWEPT, position) if math.isfinite(position) else reference
        if reference.kind != UNREACHED or not (crossings := self._crossings_at(Omega)):
            return reference
        return Reference(UNREACHED, min((p.index + p.fraction for p in crossings), key=distance))

    # ---- motions and amplitudes

    @cached_property
    def motions(self) -> list[tuple[Array, dict[str, float]] | None]:
        """Unknowns and parameters of the motion with which each point is compared; None without one."""
        motions: list[tuple[Array, dict[str, float]] | None] = []
        solutions: dict[tuple[float, float], tuple[Array, dict[str, float]] | None] = {}
        for Omega, reference in zip(self.Omega.tolist(), self.references, strict=True):
            key = (Omega, reference.position)
            if key not in solutions:
                solutions[key] = None if math.isnan(reference.position) else self._solved(reference.position, Omega)
            motions.append(solutions[key])
        return motions

    def _solved(self, position: float, Omega: float) -> tuple[Array, dict[str, float]] | None:
        i, X = int(position), self.points.X
        parameters, fraction = {**self.parameter_values, "Omega": Omega}, position - i
        guess = (1 - fraction) * X[i] + fraction * X[i + 1] if fraction else X[i]
        try:
            return solve(self.problem, guess, parameters, "Omega").X, parameters
        except NoConvergence:
            return None

    @cached_property
    def amplitudes(self) -> Array:
        """Amplitudes (N,) in the unit of the data; nan without a motion."""
        amplitudes = np.full(len(self.data), math.nan)
        layout, data = self.problem.layout, self.data
        solved = [i for i, motion in enumerate(self.motions) if motion is not None]
        if solved:
            X = np.array([self.motions[i][0] for i in solved])  # type: ignore[index]
            amplitudes[solved] = self.length[0] * layout.measure(data.measure, X, data.element)
        for i, reference in enumerate(self.references):
            if reference.jump is not None:
                amplitudes[i] = self.length[0] * reference.jump.before.amplitude(data.measure, data.element)
        return amplitudes

    def nearest_jump(self, direction: int, frequency: float) -> Jump | None:
        """Return the jump in a direction that is nearest to a measured one."""
        Omega = frequency / self.unit_of(self.data.unit)[0]
        candidates = [jump for jump in self.jumps if jump.direction == direction]
        return min(candidates, key=lambda jump: abs(jump.value - Omega), default=None)

    @cached_property
    def jump_frequencies(self) -> Array:
        """Jump frequencies (J,) in the unit of the data; nan for jumps that the model does not have."""
        unit = self.unit_of(self.data.unit)[0]
        nearest = [self.nearest_jump(direction, frequency) for frequency, direction, _ in self.data.jumps]
        return np.array([math.nan if jump is None else unit * jump.value for jump in nearest])

    @cached_property
    def deviation(self) -> Array:
        """Deviations (N,) of the amplitudes, including the effect of a frequency error where the curve is steep.

            s^2 = s_A^2 + (dA/dOmega s_Omega)^2

        Close to a fold an amplitude determines the frequency of the fold and barely its height.
        """
        Omega, data, sizes = self.points.Omega, self.data, self.curve_amplitudes
        deviation = np.array(data.deviation, dtype=float)
        for i, reference in enumerate(self.references):
            if math.isfinite(reference.position):
                k = int(reference.position)
                k -= k + 1 == len(Omega) or math.isnan(Omega[k + 1])  # the last point of a curve
                step = float(Omega[k + 1] - Omega[k])
                slope = float(sizes[k + 1] - sizes[k]) / step if step else math.inf
                deviation[i] = math.hypot(
                    deviation[i], min(abs(slope) * FREQUENCY_DEVIATION * float(self.Omega[i]), float(data.amplitude[i]))
                )
            elif reference.jump is not None:
                deviation[i] = math.hypot(deviation[i], COARSE_DEVIATION * float(data.amplitude[i]))
        return deviation


def overshoot_residual(overshoot: float, Omega: float) -> tuple[float, float]:
    """Return the residual of a point at Omega beyond the end of its segment, and its derivative in the overshoot."""
    deviation = FREQUENCY_DEVIATION * Omega
    residual, slope = soft_residual(overshoot / deviation)
    return residual, slope / deviation


def soft_residual(t: float) -> tuple[float, float]:
    """Return a residual that is t near zero and the square root of 2 t for large t, and its derivative."""
    root = math.sqrt(1.0 + t * t)
    r = math.copysign(math.sqrt(2.0) * abs(t) / math.sqrt(root + 1.0), t)
    return r, (t / (root * r) if r else 1.0)


def _values_text(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
