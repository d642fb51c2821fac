"""What a model says of measured sweeps, with derivatives: the motion that the sweep is on at each measured frequency.

    d_i = A(X(Omega_i, a)),   dd_i/da = A_X (X_a + X_Omega dOmega_i/da),   Omega_i = f_i / s(a)

Which of several motions a sweep is on is told by its jumps. Where the measured amplitude is far from that motion and
close to another one, or to the end of the stable part that the sweep came from, that is taken instead: a sweep that
jumped a little earlier or later than the model's says nothing of the motion it did not jump to. A point beyond the end
of its part is held against that end, and the distance in frequency counts as well; so it pulls at the jump.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbgear.analysis.parameter_sensitivity import LENGTH, measured_along, sensitivity, units_at
from hbgear.common.arrays import Array
from hbgear.continuation.augmented.sensitivity import tangent
from hbgear.continuation.numerics.linear import Factors, norm
from hbgear.continuation.results.branch import Jump, is_stable
from hbgear.continuation.results.interpolation import crossings_at
from hbgear.continuation.solvers.newton import NoConvergence, solve
from hbgear.continuation.tracing.trace import trace
from hbgear.design.cases.sweep_statistics import stable_parts, swept
from hbgear.design.fitting.measurements import Measurements
from hbgear.harmonic.harmonic_balance import HarmonicBalance

SWEPT, OTHER, END, UNREACHED = "swept", "other", "end", "unreached"
"""What a measured point is held against: the motion of the sweep, another stable one, the end of the part that the
sweep came from, or nothing that is stable."""

_FAR, _CLOSER = 5.0, 0.8  # deviations from which another motion is looked at, and the share of them it must lie within

_BEYOND = 0.15  # relative distance in frequency up to which the end of a part stands for a point beyond it

_OMEGA = 1e-3  # relative deviation of frequencies of points beyond the end of their part

_MISSING = 0.1  # relative distance of a jump that the model does not have


_PLACES = 6  # of the fraction of a row, so that what both sweeps pass is solved for once

_ROUGH = 0.03  # relative deviation of frequencies and amplitudes that are looked at from afar


class NotTraced(ValueError):
    """The response of the model cannot be traced with these values."""


@dataclass(frozen=True)
class Place:
    """What a measured point is held against: kind, row of the curve (with its fraction), and the jump that ends it."""

    kind: str
    row: float = math.nan
    jump: Jump | None = None


class Prediction:
    """The response of a model with given values of some parameters, held against measurements.

    Parameters
    ----------
    problem : HarmonicBalance
        Of the model.
    data : Measurements
        The measurements.
    values : mapping of str to float
        Of the parameters that are sought.
    span : tuple[float, float]
        Of the trace.

    Raises
    ------
    NotTraced
        If there is no curve over the span.
    """

    def __init__(
        self, problem: HarmonicBalance, data: Measurements, values: Mapping[str, float], span: tuple[float, float]
    ) -> None:
        self.problem, self.data, self.names = problem.with_cache_size(2 * len(values) + 10), data, tuple(values)
        model = problem.model
        self.here = {**model.parameters, **values}
        try:
            self.units = units_at(self.problem, {**model.entries, **self.here}, self.names)
            self.curve = trace(self.problem, "Omega", span, at=dict(values), accuracy=None, cover=False)
        except (NoConvergence, ValueError) as error:
            raise NotTraced(f"no response at {_told(values)}: {error}") from error
        if not len(self.curve) or self.curve.multipliers is None or not self.curve.status.complete:
            raise NotTraced(f"no response at {_told(values)}: {self.curve.message}")

    # ---- frequencies and places

    @cached_property
    def Omega(self) -> Array:
        """(N,) of the measured points."""
        return np.asarray(self.data.frequency / self._unit(self.data.unit)[0])

    def _unit(self, name: str) -> tuple[float, Array]:
        """The unit of frequencies or "m", in the model's, and its derivatives."""
        own, moved = self.units
        if name not in own and name == "Omega":
            return 1.0, np.zeros(len(self.names))
        return own[name], moved[name]

    @cached_property
    def length(self) -> tuple[float, Array]:
        """The model's unit of length in that of the data, and its derivatives."""
        return self._unit(LENGTH) if self.data.length else (1.0, np.zeros(len(self.names)))

    @cached_property
    def jumps(self) -> tuple[Jump, ...]:
        """Of slow sweeps of the curve."""
        return tuple(jump for jump in self.curve.jumps() if jump.parameter == "Omega")

    @cached_property
    def places(self) -> list[Place]:
        """What each measured point is held against."""
        curve, data = self.curve, self.data
        assert curve.multipliers is not None
        sketch = np.array([curve.values, np.arange(len(curve)), is_stable(curve.multipliers)], dtype=float)
        amplitude = self.sizes
        parts = list(stable_parts(sketch))
        rows = np.full(len(data), math.nan)
        for direction in (1, -1):
            mine = np.flatnonzero(data.directions == direction)
            order = mine[np.argsort(self.Omega[mine])]
            if order.size and parts:
                found = [self._leap(jump) for jump in self.jumps if jump.direction == direction]
                leaps = np.array(found).reshape(-1, 3)
                rows[order] = swept(sketch, leaps, self.Omega[order], direction)[0]
        rows = np.round(rows, _PLACES)
        return [self._place(i, float(rows[i]), parts, amplitude) for i in range(len(data))]

    @cached_property
    def sizes(self) -> Array:
        """(P,) amplitudes of the rows of the curve, in the unit of the data."""
        return self.length[0] * self.curve.amplitude(self.data.measure, self.data.element)

    def _leap(self, jump: Jump) -> tuple[float, float, float]:
        """Omega and the rows a jump leaves and lands at, nan if it lands nowhere."""
        after = jump.after
        if after is None:
            return jump.value, math.nan, math.nan
        near = crossings_at(self.curve, jump.value)
        to = min(near, key=lambda place: norm(place.between(self.curve.X) - self.problem.from_point(after)))
        return jump.value, math.nan, to.index + to.share

    def _place(self, i: int, row: float, parts: Sequence[tuple[Array, Array]], amplitude: Array) -> Place:
        Omega, measured = float(self.Omega[i]), float(self.data.amplitude[i])
        deviation, direction = float(self.data.deviation[i]), int(self.data.directions[i])

        def off(at: float) -> float:
            return abs(float(np.interp(at, np.arange(len(amplitude)), amplitude)) - measured) / deviation

        options: list[tuple[float, Place]] = []
        for x, y in parts:
            if x[0] <= Omega <= x[-1]:
                at = round(float(np.interp(Omega, x, y)), _PLACES)
                options.append((off(at), Place(OTHER, at)))
        for jump in self.jumps:
            beyond = (Omega - jump.value) * direction
            if jump.direction == direction and 0 < beyond <= _BEYOND * Omega:
                size = self.length[0] * jump.before.amplitude(self.data.measure, self.data.element)
                apart = math.hypot((size - measured) / deviation, soft(beyond / (_OMEGA * Omega))[0])
                options.append((apart, Place(END, jump=jump)))
        own = off(row) if math.isfinite(row) else math.inf
        best, place = min(options, key=lambda option: option[0], default=(math.inf, Place(UNREACHED)))
        if own <= _FAR or best > _CLOSER * own or place.row == row:
            place = Place(SWEPT, row) if math.isfinite(row) else place
        if place.kind != UNREACHED or not (near := crossings_at(self.curve, Omega)):
            return place
        return Place(UNREACHED, min((p.index + p.share for p in near), key=off))

    # ---- numbers

    @cached_property
    def motions(self) -> list[tuple[Array, dict[str, float]] | None]:
        """Unknowns and parameters of the motion each measured point is held against; None if there is none."""
        found: list[tuple[Array, dict[str, float]] | None] = []
        known: dict[tuple[float, float], tuple[Array, dict[str, float]] | None] = {}
        for Omega, place in zip(self.Omega.tolist(), self.places, strict=True):
            key = (Omega, place.row)
            if key not in known:
                known[key] = None if math.isnan(place.row) else self._solved(place.row, Omega)
            found.append(known[key])
        return found

    def _solved(self, row: float, Omega: float) -> tuple[Array, dict[str, float]] | None:
        i = min(int(row), len(self.curve) - 2)
        here = {**self.here, "Omega": Omega}
        guess = (1 - (row - i)) * self.curve.X[i] + (row - i) * self.curve.X[i + 1]
        try:
            return solve(self.problem, guess, here, "Omega").X, here
        except NoConvergence:
            return None

    @cached_property
    def amplitudes(self) -> Array:
        """(N,) in the unit of the data; nan where there is no motion."""
        out = np.full(len(self.data), math.nan)
        layout, data = self.problem.layout, self.data
        some = [i for i, motion in enumerate(self.motions) if motion is not None]
        if some:
            X = np.array([self.motions[i][0] for i in some])  # type: ignore[index]
            out[some] = self.length[0] * layout.measure(data.measure, X, data.element)
        for i, place in enumerate(self.places):
            if place.jump is not None:
                out[i] = self.length[0] * place.jump.before.amplitude(data.measure, data.element)
        return out

    @property
    def reached(self) -> Array:
        """(N,) whether a stable motion of the curve is where the point was measured."""
        kinds = [place.kind in (SWEPT, OTHER) for place in self.places]
        return np.array(kinds, dtype=bool) & np.isfinite(self.amplitudes)

    def jump_of(self, direction: int, frequency: float) -> Jump | None:
        """The jump in a direction that is nearest to a measured one."""
        Omega = frequency / self._unit(self.data.unit)[0]
        mine = [jump for jump in self.jumps if jump.direction == direction]
        return min(mine, key=lambda jump: abs(jump.value - Omega), default=None)

    @cached_property
    def jump_frequencies(self) -> Array:
        """(J,) in the unit of the data, nan of those that the model does not have."""
        unit = self._unit(self.data.unit)[0]
        found = [self.jump_of(direction, frequency) for frequency, direction, _ in self.data.jumps]
        return np.array([math.nan if jump is None else unit * jump.value for jump in found])

    @cached_property
    def deviation(self) -> Array:
        """(N,) of the amplitudes, with what a small error of the frequency makes of them where the curve is steep.

            s^2 = s_A^2 + (dA/dOmega s_Omega)^2

        Close to a fold an amplitude says where the fold is and hardly anything of its height.
        """
        curve, data, sizes = self.curve, self.data, self.sizes
        out = np.array(data.deviation, dtype=float)
        for i, place in enumerate(self.places):
            if math.isfinite(place.row):
                k = min(int(place.row), len(curve) - 2)
                run = float(curve.values[k + 1] - curve.values[k])
                steep = float(sizes[k + 1] - sizes[k]) / run if run else math.inf
                out[i] = math.hypot(out[i], min(abs(steep) * _OMEGA * float(self.Omega[i]), float(data.amplitude[i])))
            elif place.jump is not None:
                out[i] = math.hypot(out[i], _ROUGH * float(data.amplitude[i]))
        return out

    def residuals(self, deviation: Array) -> Array:
        """(2N + J,) differences over deviations: amplitudes, frequencies of points beyond an end, and jumps."""
        data = self.data
        off = np.nan_to_num((self.amplitudes - data.amplitude) / deviation)
        beyond = np.array([
            0.0 if place.jump is None else soft((Omega - place.jump.value) / (_OMEGA * Omega))[0]
            for place, Omega in zip(self.places, self.Omega.tolist(), strict=True)
        ])  # fmt: skip
        at = zip(data.jumps, self.jump_frequencies.tolist(), strict=True)
        jumps = [_MISSING * f / s if math.isnan(found) else (found - f) / s for (f, _, s), found in at]
        return np.concatenate([off, beyond, jumps])

    def jacobian(self, deviation: Array) -> Array:
        """(2N + J, A) derivatives of `residuals`."""
        J, count = self._moved.copy(), len(self.data)
        J[:count] /= deviation[:, None]
        return J

    def information(self, deviation: Array) -> Array:
        """The same without points beyond the end of their part.

        They say that the part should reach them, and nothing any more as soon as it does: a wall to one side.
        """
        J, count = self.jacobian(deviation), len(self.data)
        for i, place in enumerate(self.places):
            if place.jump is not None:
                J[[i, count + i]] = 0.0
        return J

    @cached_property
    def _moved(self) -> Array:
        """`jacobian` with amplitudes in the unit of the data."""
        data, count = self.data, len(self.data)
        J = np.zeros((2 * count + len(data.jumps), len(self.names)))
        length, moved_length = self.length
        scale, moved_scale = self._unit(data.unit)
        slopes = self._slopes()
        for i, place in enumerate(self.places):
            if place.jump is not None:
                moved = self._of_jump(place.jump)
                size = place.jump.before.amplitude(data.measure, data.element)
                J[i] = length * moved["size"] + size * moved_length
                # of 1 - Omega_j / Omega with Omega = f / s
                Omega = float(self.Omega[i])
                rate = soft((Omega - place.jump.value) / (_OMEGA * Omega))[1] / (_OMEGA * Omega)
                J[count + i] = -rate * (moved["Omega"] + place.jump.value * moved_scale / scale)
            elif i in slopes:
                J[i] = length * slopes[i] + float(self.amplitudes[i]) / length * moved_length
        for j, (frequency, direction, deviation) in enumerate(data.jumps, 2 * count):
            jump = self.jump_of(direction, frequency)
            if jump is not None:
                J[j] = (scale * self._of_jump(jump)["Omega"] + jump.value * moved_scale) / deviation
        return np.nan_to_num(J)

    # ---- from afar

    @cached_property
    def _nearest(self) -> tuple[list[int], Array, Array]:
        """Row of a stable motion that is nearest to each point, and its distances in frequency and amplitude."""
        curve, data = self.curve, self.data
        assert curve.multipliers is not None
        rows = np.flatnonzero(is_stable(curve.multipliers))
        if not rows.size or not len(data):
            return [], np.zeros(0), np.zeros(0)
        sizes = self.sizes[rows]
        wide = np.maximum(data.deviation, _ROUGH * data.amplitude)
        ahead = (curve.values[rows] - self.Omega[:, None]) / (_ROUGH * self.Omega[:, None])
        above = (sizes - data.amplitude[:, None]) / wide[:, None]
        near = np.argmin(np.hypot(ahead, above), axis=1)
        each = np.arange(len(data))
        return rows[near].tolist(), ahead[each, near], above[each, near]

    @cached_property
    def distances(self) -> Array:
        """Distances (N + J,) of the points to the stable parts of the curve, and of its jumps to those measured.

        In frequency and amplitude at once, both relative: what is far off is told by its direction, and a resonance at
        another frequency attracts the points of the measured one.
        """
        _, ahead, above = self._nearest
        unit = self._unit(self.data.unit)[0]
        jumps = []
        for frequency, direction, _ in self.data.jumps:
            jump = self.jump_of(direction, frequency)
            jumps.append(_MISSING / _ROUGH if jump is None else (unit * jump.value / frequency - 1.0) / _ROUGH)
        return np.concatenate([np.hypot(ahead, above), jumps])

    @cached_property
    def distances_moved(self) -> Array:
        """(N + J, A) derivatives of `distances`."""
        curve, data = self.curve, self.data
        (length, moved_length), (scale, moved_scale) = self.length, self._unit(data.unit)
        rows, ahead, above = self._nearest
        slopes = self._slopes_at(sorted(set(rows)))
        J = np.zeros((len(self.distances), len(self.names)))
        for i, row in enumerate(rows):
            if row in slopes and self.distances[i]:
                wide = max(data.deviation[i], _ROUGH * data.amplitude[i])
                moved = (length * slopes[row] + self.sizes[row] / length * moved_length) / wide
                along = curve.values[row] * moved_scale / (scale * _ROUGH * self.Omega[i])
                J[i] = (above[i] * moved + ahead[i] * along) / self.distances[i]
        for j, (frequency, direction, _) in enumerate(data.jumps, len(rows)):
            jump = self.jump_of(direction, frequency)
            if jump is not None:
                J[j] = (scale * self._of_jump(jump)["Omega"] + jump.value * moved_scale) / (_ROUGH * frequency)
        return np.nan_to_num(J)

    def _slopes_at(self, rows: Sequence[int]) -> dict[int, Array]:
        """Derivatives of the amplitudes of rows of the curve, at their frequencies, in the model's unit."""
        if not rows:
            return {}
        X, (known, along) = (
            self.curve.X[list(rows)],
            self._displaced(self.curve.X[list(rows)], self.curve.values[list(rows)]),
        )
        return dict(zip((rows[i] for i in known), self._measured_along(X[known], along), strict=True))

    def _displaced(self, X: Array, Omega: Array) -> tuple[list[int], Array]:
        """Derivatives (P, A, n) of motions at held frequencies, and which of them have some: all but folds."""
        here = {**self.problem.model.entries, **self.here}
        moved = np.stack([self.problem.parameter_derivatives(X, Omega, name, here) for name in self.names], axis=1)
        known, found = [], []
        for i, w in enumerate(Omega.tolist()):
            along = -Factors(self.problem.evaluate(X[i], **here, Omega=w)[1]).solve(moved[i].T).T
            if np.isfinite(along).all():
                known.append(i)
                found.append(along)
        return known, np.array(found).reshape(len(known), *moved.shape[1:])

    def _of_jump(self, jump: Jump) -> dict[str, Array]:
        """Derivatives of its frequency and of the amplitude before it."""
        if jump.label not in self._jumps_moved:
            try:
                found = sensitivity(jump.before, self.names, measure=self.data.measure, element=self.data.element)
                moved = {"Omega": found.slopes[0], "size": np.array(list(found.of(self.data.measure).values()))}
            except (ValueError, NoConvergence, np.linalg.LinAlgError):
                moved = {"Omega": np.zeros(len(self.names)), "size": np.zeros(len(self.names))}
            self._jumps_moved[jump.label] = moved
        return self._jumps_moved[jump.label]

    @cached_property
    def _jumps_moved(self) -> dict[str, dict[str, Array]]:
        return {}

    def _slopes(self) -> dict[int, Array]:
        """Derivatives of amplitudes in the model's unit, by number of the point."""
        scale, moved_scale = self._unit(self.data.unit)
        place: dict[tuple[float, float], int] = {}
        for i, (motion, where) in enumerate(zip(self.motions, self.places, strict=True)):
            if motion is not None and where.kind != END:
                place.setdefault((float(self.Omega[i]), where.row), i)
        some = list(place.values())
        if not some:
            return {}
        X, Omega = np.array([self.motions[i][0] for i in some]), self.Omega[some]  # type: ignore[index]
        known, along = self._displaced(X, Omega)
        if moved_scale.any():
            here = {**self.problem.model.entries, **self.here}
            for X_a, i in zip(along, known, strict=True):
                t = tangent(self.problem, X[i], {**here, "Omega": float(Omega[i])}, "Omega")
                X_a -= np.outer(Omega[i] * moved_scale / scale, t)
        found = dict(zip((some[i] for i in known), self._measured_along(X[known], along), strict=True))
        each = {i: place.get((float(self.Omega[i]), where.row), -1) for i, where in enumerate(self.places)}
        return {i: found[first] for i, first in each.items() if first in found}

    def _measured_along(self, X: Array, along: Array) -> Array:
        """Derivatives (P, A) of the measure of motions X (P, n) along directions (P, A, n)."""
        return measured_along(self.problem.layout, self.data.measure, self.data.element, X, along)


def soft(t: float) -> tuple[float, float]:
    """A residual that grows like t near zero and like the root of 2 t far away, and its derivative."""
    root = math.sqrt(1.0 + t * t)
    r = math.copysign(math.sqrt(2.0) * abs(t) / math.sqrt(root + 1.0), t)
    return r, (t / (root * r) if r else 1.0)


def _told(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
