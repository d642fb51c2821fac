"""Slow sweeps by time integration, attractors and their basins: what experiments and most of the literature do.

    state at values[i + 1], tau = 0   <-   settled state at values[i], tau = 0

At each value the motion is integrated (exponential method, see `timedomain`) until it is settled: with x_p the state
after p excitation periods and D_k = |x_p - x_{p-k}|, a motion of period k that is approached like rho^p is still

    D_k / (1 - rho^k)

away; it is settled when that is below a tolerance, not after a fixed number of periods. The smallest such k is the
period. A motion that never settles is called not periodic and gets its largest Lyapunov exponent.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hbgear import measures
from hbgear.branch import Status
from hbgear.doubts import of_model
from hbgear.ending import Ending
from hbgear.fourier import Array, ComplexArray, evaluate, to_real
from hbgear.given import need
from hbgear.model import Model, did_you_mean
from hbgear.ranges import ANY, NOT_NEGATIVE, POSITIVE, checked, counted
from hbgear.replacing import replacing
from hbgear.stepper import Flight, Stepper, modal_state

Progress = Callable[[float, str], None]

HARMONICS = 16
"""Harmonics of the excitation that are kept of each settled motion."""

_WINDOW = 8  # periods over which the rate of approach is judged, twice
_MOST_STARTS = 250_000  # integrated at once
_LONG = 128  # periods a motion that is not periodic is observed for
_PATIENCE = 400  # periods after which a motion that has not settled is tested for chaos
_CHAOTIC = 0.02  # growth of a disturbance per period, as a logarithm, above which a motion is called chaotic
_JUMP_IN_CHAOS = 0.2  # the same where a motion is not periodic, its amplitude then fluctuates
_JUMP = 0.02  # change between neighbouring values, relative to the largest amplitude so far, that may be a jump


@dataclass(frozen=True)
class Settling:
    """When a motion counts as settled.

    tolerance : distance it may still have to go, relative to the size of the state.
    longest : excitation periods after which it is given up.
    periods : largest period, in excitation periods, that is looked for.

    Raises
    ------
    ValueError
        If the tolerance is beyond double precision or a number is out of range.
    """

    tolerance: float = 1e-7
    longest: int = 3000
    periods: int = 16

    def __post_init__(self) -> None:
        checked("Settling", "tolerance", self.tolerance)
        if not 1e-12 <= self.tolerance < 1:
            raise ValueError(f"tolerance = {self.tolerance} cannot be met in double precision; need 1e-12 to 1")
        counted("periods", self.periods, 1000)
        counted("longest", self.longest, 1_000_000)
        if self.periods > self.longest:
            raise ValueError(f"need 1 <= periods <= longest, got periods = {self.periods}, longest = {self.longest}")


@dataclass(frozen=True, eq=False)
class Settled:
    """How B motions settled.

    period : (B,) in excitation periods, 0 if it did not. taken : (B,) excitation periods integrated.
    left : (B,) distance still to go relative to the state, for the period ``guess`` (B,) that is nearest to settling.
    """

    period: np.ndarray
    taken: np.ndarray
    left: Array
    guess: np.ndarray


def settle(
    stepper: Stepper,
    flight: Flight,
    settling: Settling = Settling(),
    progress: Callable[[int, int], None] | None = None,
) -> Settled:
    """Carry motions at tau = 0 on until each is settled, in place.

    ``progress(periods, settled)`` is called now and then.
    """
    out = _unsettled(len(flight.d), settling)
    _settle_into(out, stepper, flight, settling, progress)
    return out


def _unsettled(count: int, settling: Settling) -> Settled:
    none = np.zeros(count, dtype=int)
    return Settled(none, np.full(count, settling.longest), np.full(count, np.nan), none.copy())


def _settle_into(
    out: Settled, stepper: Stepper, flight: Flight, settling: Settling, progress: Callable[[int, int], None] | None
) -> None:
    """`settle`, noting each motion in out once it is settled: if this is interrupted, those and their places hold."""
    B = len(flight.d)
    weights = _weights(stepper)
    going, part, here = np.arange(B), stepper, flight
    past: list[ComplexArray] = []  # strobed states, the latest first
    gaps: list[Array] = []  # D_k (K, B) of the last periods, the latest first
    size = np.linalg.norm(weights * stepper.land(flight), axis=-1)
    for p in range(settling.longest + 1):
        x = weights * here.zeta
        gaps = [_gaps(x, past, settling.periods), *gaps[: 2 * _WINDOW - 1]]
        past = [x, *past[: settling.periods - 1]]
        if p % 4 == 0 and p >= 2 * _WINDOW + 1:
            if p < 50:  # a start at rest says nothing of the size
                size = np.maximum(size, np.linalg.norm(weights * part.land(here), axis=-1))
            period, left, guess = _judge(np.array(gaps), size, settling)
            out.left[going], out.guess[going] = left, guess
            done = period > 0
            if done.any():
                flight.put(going[done], here.select(np.flatnonzero(done)))
                out.taken[going[done]] = p
                out.period[going[done]] = period[done]
                keep = np.flatnonzero(~done)
                if keep.size == 0:
                    return
                going, part, here = going[keep], part.select(keep), here.select(keep)
                weights = weights if len(weights) == 1 else weights[keep]
                past, gaps, size = [x[keep] for x in past], [g[:, keep] for g in gaps], size[keep]
            if progress:
                progress(p, B - len(going))
        if p < settling.longest:
            part.advance(here)
    flight.put(going, here)


def _weights(stepper: Stepper) -> Array:
    """Size of the motion each mode stands for, in coordinates scaled by the root of their mass: (rows or 1, r)."""
    each = []
    for structure in stepper.structures:
        assert structure.modes is not None
        each.append(np.linalg.norm(np.sqrt(np.abs(np.diag(structure.M)))[:, None] * structure.modes.right, axis=0))
    return np.array(each)[stepper.of]


def _gaps(x: ComplexArray, past: Sequence[ComplexArray], periods: int) -> Array:
    """D_k for k = 1..periods (K, B), inf where the past is too short."""
    out = np.full((periods, len(x)), np.inf)
    for k, before in enumerate(past):
        out[k] = np.linalg.norm(x - before, axis=-1)
    return out


def _judge(gaps: Array, size: Array, settling: Settling) -> tuple[np.ndarray, Array, np.ndarray]:
    """Period of each motion (0: not settled), distance still to go, and the period that is nearest to settling.

    gaps (2 windows, K, B), the latest first.
    """
    k = np.arange(1, gaps.shape[1] + 1)[:, None]
    new, old = gaps[:_WINDOW].max(axis=0), gaps[_WINDOW:].max(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.minimum((new / old) ** (1.0 / _WINDOW), 1.0)
        left = np.where(np.isfinite(new) & (rho < 1), new / (1 - rho**k), np.inf) / size
    left[new <= 1e-14 * size] = 0.0
    settled = left <= settling.tolerance
    best = np.argmin(left, axis=0)
    first = np.argmax(settled, axis=0)
    # a multiple of the period closes before the period does; what is that small is the period
    same = new <= 30 * settling.tolerance * size
    period = np.where(
        settled.any(axis=0), np.minimum(first, np.where(same.any(axis=0), np.argmax(same, axis=0), first)) + 1, 0
    )
    return period, left[best, np.arange(len(best))], best + 1


def lyapunov(stepper: Stepper, flight: Flight, periods: int = 400) -> float:
    """Largest Lyapunov exponent of one motion, per unit of time, from a neighbour pulled close after every period.

        lambda = lim (1 / t) sum_p log(|delta_p| / |delta_0|)

    The first quarter of the periods, in which the disturbance turns to the direction that grows fastest, is left out.
    The flight itself is not changed.
    """
    weights, structure = _weights(stepper), stepper.structures[0]
    pair = flight.select(np.array([0, 0]))
    small = 1e-8 * (float(np.linalg.norm(weights * stepper.land(flight)[0])) or 1.0)
    delta = modal_state(structure, np.ones(2 * structure.n))
    logs = []
    for _ in range(periods):
        delta = delta * (small / np.linalg.norm(weights * delta))
        z = stepper.land(pair)
        z[1] = z[0] + delta
        pair = stepper.fly(z)
        stepper.advance(pair)
        delta = pair.zeta[1] - pair.zeta[0]
        logs.append(np.log(np.linalg.norm(weights * delta) / small))
    return float(np.mean(logs[periods // 4 :]) * stepper.Omega[0] / (2 * np.pi))


# ---- what is kept of a motion


@dataclass(frozen=True, eq=False)
class Observation:
    """A settled motion (or a stretch of one that is not periodic).

    rms, pp2, max, mean : (m,) of each element coordinate; rows (m, 2H + 1) its harmonics of the excitation.
    points : (k, m, 2) Poincare points (d, v) at tau = 0, one per excitation period.
    """

    rms: Array
    pp2: Array
    max: Array
    mean: Array
    rows: Array
    points: Array


def observe(stepper: Stepper, flight: Flight, periods: int) -> Observation:
    """One motion over so many excitation periods; the flight moves on."""
    fine = stepper.advance(flight, periods, record=True)
    assert fine is not None
    d, v = fine[0][0], fine[1][0]
    per_period = d.shape[1] // periods
    h = 2 * np.pi / (stepper.Omega[0] * per_period)
    low, high = _extremum(d, v, h, -1), _extremum(d, v, h, 1)
    c = np.fft.rfft(d, axis=1)[:, : HARMONICS * periods + 1 : periods] / d.shape[1]
    c[:, 1:] *= 2
    points = np.stack([d[:, ::per_period], v[:, ::per_period]], axis=-1).transpose(1, 0, 2)
    return Observation(
        d.std(axis=1), (high - low) / 2, np.maximum(np.abs(low), np.abs(high)), d.mean(axis=1), to_real(c), points
    )


def _extremum(d: Array, v: Array, h: float, sign: int) -> Array:
    """Largest (or smallest) value of each row: the best sample, h apart, and the parabola there, d - v^2 / (2 v')."""
    i = np.argmax(sign * d, axis=1)
    rows, count = np.arange(len(d)), d.shape[1]
    bend = (v[rows, (i + 1) % count] - v[rows, (i - 1) % count]) / (2 * h)
    gain = np.divide(-(v[rows, i] ** 2), 2 * bend, out=np.zeros(len(d)), where=sign * bend < 0)
    return d[rows, i] + gain


# ---- sweeps


@dataclass(frozen=True, eq=False)
class SweepJump:
    """A jump of a sweep between two neighbouring values of the grid; rms (m,) of the elements before and after."""

    parameter: str
    interval: tuple[float, float]
    before: Array
    after: Array

    @property
    def direction(self) -> int:
        """+1 while the parameter increases, -1 while it decreases."""
        return 1 if self.interval[1] > self.interval[0] else -1


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a sweep found at each of P values, in the order they were passed.

    Parameters
    ----------
    parameter, values : what was swept, and the (P,) values reached.
    elements, labels : names of the elements, axis labels.
    rms, pp2, max, mean : (P, m) amplitudes of each element coordinate.
    rows : (P, m, 2H + 1) its harmonics of the excitation.
    points : P arrays (k, m, 2) of Poincare points (d, v) at tau = 0, one per excitation period.
    period : (P,) in excitation periods, 0 where the motion is not periodic or did not settle.
    taken : (P,) excitation periods integrated until it was settled.
    left : (P,) estimated distance still to go, relative to the state.
    lyapunov : (P,) largest Lyapunov exponent per unit of time where the motion did not settle, else nan.
    jumps : brackets of the jumps.
    direction : +1 or -1, sense in which the parameter was changed.
    status, message : why it ended.
    """

    parameter: str
    values: Array
    elements: tuple[str, ...]
    labels: dict[str, str]
    rms: Array
    pp2: Array
    max: Array
    mean: Array
    rows: Array
    points: tuple[Array, ...]
    period: np.ndarray
    taken: np.ndarray
    left: Array
    lyapunov: Array
    jumps: tuple[SweepJump, ...]
    direction: int
    status: Status
    message: str

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        span = f"{self.values[0]:.6g} to {self.values[-1]:.6g}, " if len(self) else ""
        return f"<Sweep in {self.parameter}: {span}{len(self)} values, {len(self.jumps)} jumps, {self.status}>"

    @property
    def settled(self) -> np.ndarray:
        """(P,) whether the motion settled."""
        return self.period > 0

    def index(self, element: int | str) -> int:
        """Position of an element given by position or name."""
        if isinstance(element, str) and element in self.elements:
            return self.elements.index(element)
        if not isinstance(element, str) and 0 <= element < len(self.elements):
            return int(element)
        raise KeyError(f"no element {element!r}; there are {', '.join(map(repr, self.elements))} (or by number from 0)")

    def amplitude(self, measure: str = "rms", element: int | str = 0) -> Array:
        """A measure of every motion (P,), as `Branch.amplitude`; "H1", "H2", ... are harmonics of the excitation."""
        j = self.index(element)
        if measure in measures.MEASURES:
            return np.asarray(getattr(self, measure)[:, j])
        return measures.measure(measure, self.rows[:, j])

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a table of the values (.csv), whole or not at all."""
        export((self,), path)


def export(sweeps: Sequence[Sweep], path: str | os.PathLike[str]) -> None:
    """Write several sweeps of one model to one table (.csv), whole or not at all; direction is +1 or -1."""
    if not str(path).lower().endswith(".csv"):
        raise ValueError(f"'{path}' must end in .csv")
    with replacing(path, "x", encoding="utf-8", newline="") as handle:
        writer = csv.writer(handle)
        for i, found in enumerate(sweeps):
            columns: dict[str, Any] = {found.parameter: found.values, "direction": [found.direction] * len(found)}
            for j, name in enumerate(found.elements):
                columns |= {f"{measure}_{name}": found.amplitude(measure, j) for measure in measures.MEASURES}
            columns |= {name: getattr(found, name) for name in ("period", "taken", "left", "lyapunov")}
            if i == 0:
                writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))


def sweep(
    model: Model,
    grid: Sequence[float] | Array,
    direction: str = "up",
    *,
    parameter: str = "Omega",
    at: Mapping[str, float] | None = None,
    start: Array | None = None,
    settling: Settling = Settling(),
    disturbance: float = 1e-4,
    steps: int | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Slow sweep over a grid of a parameter with the state carried over from value to value.

    Parameters
    ----------
    model : `Model`.
    grid : values of the parameter, in any order.
    direction : "up" or "down": the order in which they are passed.
    parameter : "Omega" or a float field of the model.
    at : values of parameters that stay fixed (``{"Omega": 0.9}`` when something else is swept).
    start : (2n,) state (q, q') at tau = 0 before the first value; by default at rest at q = 0.
    settling : when a motion counts as settled.
    disturbance : size, relative to the state, of a random disturbance given at each value. Without one, a symmetric
        model (two equal helices) stays on a symmetric motion even where that is unstable; it must exceed the tolerance.
    steps : of the integration per excitation period; chosen by default.
    progress : called as ``progress(share done, text)``.

    A change between neighbouring values that is much larger than the one before is a jump if the sweep does not find
    back when the parameter is turned back by one value; a steep but single curve is none.

    Returns
    -------
    Sweep
        Ctrl-C ends it with the status ``interrupted`` and everything found so far.

    Raises
    ------
    ValueError, KeyError
        If the grid is empty or not finite, the direction or a parameter unknown, Omega missing or not positive, or the
        disturbance negative.
    """
    need("sweep(model)", model, "Model")
    held = dict(at or {})
    return _Sweeper(model, grid, direction, parameter, held, start, settling, disturbance, steps, progress).run()


@dataclass(eq=False)
class _Sweeper:
    """State of one sweep."""

    model: Model
    grid: Any
    direction: str
    parameter: str
    at: dict[str, float]
    start: Array | None
    settling: Settling
    disturbance: float
    steps: int | None
    progress: Progress | None
    found: list[tuple[float, Observation, Settled, float]] = field(default_factory=list)
    jumps: list[SweepJump] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.direction not in ("up", "down"):
            raise ValueError(f"direction = {self.direction!r} must be 'up' or 'down'")
        values = np.unique(np.asarray(self.grid, dtype=float))
        if values.size == 0 or not np.all(np.isfinite(values)):
            raise ValueError(f"a sweep needs at least one value, all finite; got {self.grid!r}")
        self.values = values if self.direction == "up" else values[::-1]
        checked("sweep", "disturbance", self.disturbance, NOT_NEGATIVE)
        self.random = np.random.default_rng(1)
        known = ("Omega", *self.model.parameters)
        for name in (self.parameter, *self.at):
            if name not in known:
                raise KeyError(f"{type(self.model).__name__} has no parameter '{name}'{did_you_mean(name, known)}")
        if self.parameter != "Omega" and "Omega" not in self.at:
            raise ValueError(f"a sweep in {self.parameter} needs a fixed Omega: give at={{'Omega': ...}}")
        for name, value in self.at.items():
            checked("sweep: at", name, value)
        lowest = values.min() if self.parameter == "Omega" else self.at["Omega"]
        if lowest <= 0:
            raise ValueError(f"Omega = {lowest:.6g} must be positive; leave it out of the grid")
        allowed = self.model.ranges.get(self.parameter, ANY)
        if values[0] not in allowed or values[-1] not in allowed:
            raise ValueError(f"grid from {values[0]:g} to {values[-1]:g}: {self.parameter} must {allowed}")

    def run(self) -> Sweep:
        """Pass all values unless interrupted."""
        system = self.model.system()
        of_model(self.model, system)
        state = np.zeros(2 * system.n) if self.start is None else np.asarray(self.start, dtype=float)
        if state.shape != (2 * system.n,) or not np.all(np.isfinite(state)):
            raise ValueError(f"start = {self.start}: need a state (q, q') of {2 * system.n} finite numbers")
        ending = Ending(message=f"{self.parameter} = {self.values[-1]:.6g} reached")
        try:
            for i, value in enumerate(self.values):
                before = state
                state = self._settle(value, state)
                self._look_for_jump(i, before, state)
                if self.progress:
                    self.progress((i + 1) / len(self.values), self._text())
        except (Exception, KeyboardInterrupt) as error:
            if isinstance(error, Exception) and not self.found:
                raise
            ending.note(error, f"after {len(self.found)} of {len(self.values)} values")
        return self._result(system, ending.status, ending.told)

    def _stepper(self, value: float) -> Stepper:
        here = {**self.at, self.parameter: float(value)}
        Omega = here.pop("Omega")
        return Stepper(self.model.replace(**here) if here else self.model, Omega, self.steps)

    def _settle(self, value: float, state: Array) -> Array:
        """Settle at a value from a state, note what is found, and return the state then."""
        stepper = self._stepper(value)
        flight = self._disturbed(stepper, stepper.start(state))
        how, exponent = self._wait(stepper, flight)
        period = int(how.period[0])
        seen = observe(stepper, flight, period or _LONG)
        self.found.append((float(value), seen, how, exponent))
        return stepper.states(flight)[0]

    def _disturbed(self, stepper: Stepper, flight: Flight) -> Flight:
        """The motion a little beside; the same little in every run."""
        weights, structure = _weights(stepper), stepper.structures[0]
        if not self.found:  # a start at rest has no size yet
            stepper.advance(flight, _WINDOW)
        z = stepper.land(flight)
        beside = modal_state(structure, self.random.standard_normal(2 * structure.n))
        size = np.linalg.norm(weights * z) / np.linalg.norm(weights * beside)
        return stepper.fly(z + self.disturbance * size * beside)

    def _wait(self, stepper: Stepper, flight: Flight) -> tuple[Settled, float]:
        """Settle; a motion that has not and whose neighbours run away from it is chaotic and not waited for."""
        longest = self.settling.longest
        first = min(max(_PATIENCE, self.settling.periods), longest)
        how = settle(stepper, flight, replace(self.settling, longest=first))
        if how.period[0]:
            return how, np.nan
        exponent = lyapunov(stepper, flight)
        if first == longest or exponent * 2 * np.pi / stepper.Omega[0] > _CHAOTIC:
            return how, exponent
        how = settle(stepper, flight, replace(self.settling, longest=longest - first))
        how = replace(how, taken=how.taken + first)
        return how, np.nan if how.period[0] else lyapunov(stepper, flight)

    def _look_for_jump(self, i: int, before: Array, state: Array) -> None:
        """Note a jump between the last two values if the change stands out and turning back does not undo it."""
        if i == 0:
            return
        rms = np.array([f[1].rms for f in self.found])
        change = np.abs(np.diff(rms, axis=0)).max(axis=1)
        usual = change[-2] if i > 1 else 0.0
        least = _JUMP if all(f[2].period[0] for f in self.found[-2:]) else _JUMP_IN_CHAOS
        if change[-1] < max(3 * usual, least * rms.max()):
            return
        stepper = self._stepper(self.values[i - 1])
        flight = stepper.start(state)
        how = settle(stepper, flight, self.settling)
        back = observe(stepper, flight, int(how.period[0]) or _LONG)
        if np.abs(back.rms - rms[-2]).max() > 0.2 * change[-1]:
            interval = (float(self.values[i - 1]), float(self.values[i]))
            self.jumps.append(SweepJump(self.parameter, interval, rms[-2], rms[-1]))

    def _text(self) -> str:
        value, seen, how, _ = self.found[-1]
        period = f"period {how.period[0]}" if how.period[0] else "not periodic"
        return f"{self.parameter} = {value:.5g}, rms {seen.rms.max():.4g}, {period} after {how.taken[0]}"

    def _result(self, system: Any, status: Status, message: str) -> Sweep:
        seen = [f[1] for f in self.found]
        m, how = len(system.elements), [f[2] for f in self.found]
        lost = sum(int(h.period[0] == 0) for h in how)
        if lost:
            message += f"; {lost} of {len(how)} motions did not settle within {self.settling.longest} periods"

        def stacked(name: str, shape: tuple[int, ...]) -> Array:
            return np.array([getattr(s, name) for s in seen]).reshape(len(seen), *shape)

        return Sweep(
            parameter=self.parameter,
            values=np.array([f[0] for f in self.found]),
            elements=tuple(e.name for e in system.elements),
            labels=dict(self.model.labels),
            rms=stacked("rms", (m,)),
            pp2=stacked("pp2", (m,)),
            max=stacked("max", (m,)),
            mean=stacked("mean", (m,)),
            rows=stacked("rows", (m, 2 * HARMONICS + 1)),
            points=tuple(s.points for s in seen),
            period=np.array([h.period[0] for h in how], dtype=int),
            taken=np.array([h.taken[0] for h in how], dtype=int),
            left=np.array([h.left[0] for h in how]),
            lyapunov=np.array([f[3] for f in self.found]),
            jumps=tuple(self.jumps),
            direction=1 if self.direction == "up" else -1,
            status=status,
            message=message,
        )


# ---- basins of attraction


@dataclass(frozen=True, eq=False)
class Attractor:
    """Where motions end: period (0: not periodic), Poincare points (k, 2) of (d, v), rms, share of the starts."""

    period: int
    points: Array
    rms: float
    share: float


@dataclass(frozen=True, eq=False)
class Basins:
    """Which attractor each start leads to.

    d, v : (X,), (Y,) displacements and rates of the element coordinate at tau = 0.
    label : (Y, X) number of the attractor in `attractors`; -1 where that was not yet known when Ctrl-C ended the work.
    status, message : whether all starts were followed.
    """

    Omega: float
    d: Array
    v: Array
    label: np.ndarray
    attractors: tuple[Attractor, ...]
    labels: dict[str, str]
    status: Status = Status.REACHED_END
    message: str = ""


def basins(
    model: Model,
    Omega: float,
    d: tuple[float, float] = (-2.0, 2.0),
    v: tuple[float, float] = (-2.0, 2.0),
    shape: tuple[int, int] = (60, 60),
    *,
    settling: Settling = Settling(tolerance=1e-6),
    progress: Progress | None = None,
) -> Basins:
    """Basins of attraction of a model with one coordinate, all starts integrated at once.

    Parameters
    ----------
    model : with one coordinate and one element.
    Omega : excitation frequency.
    d, v : ranges of the element coordinate and its rate at tau = 0.
    shape : numbers of starts along d and v.
    settling : when a motion counts as settled; those that never are form one attractor of period 0.
    progress : called as ``progress(share done, text)``.

    Returns
    -------
    Basins
        Ctrl-C or an error ends it with the starts whose motions have settled until then.

    Raises
    ------
    ValueError
        If the model has more coordinates, a range is empty or not finite, or there are no starts or too many.
    KeyboardInterrupt
        If Ctrl-C comes before any motion has settled.
    """
    need("basins(model)", model, "Model")
    system = model.system()
    if system.n != 1 or len(system.elements) != 1:
        raise ValueError(
            f"basins are drawn over one coordinate and its rate; {type(model).__name__} has {system.n} coordinates and "
            f"{len(system.elements)} elements"
        )
    checked("basins", "Omega", Omega, POSITIVE)
    for end in (*d, *v):
        checked("basins", "an end of d or v", end)
    if not (d[0] < d[1] and v[0] < v[1]):
        raise ValueError(f"need ascending finite ranges of two numbers; got d = {d}, v = {v}")
    starts = counted("shape[0]", shape[0]) * counted("shape[1]", shape[1])
    counted("shape[0] * shape[1]", starts, _MOST_STARTS)
    of_model(model, system)
    x, y = np.linspace(*d, shape[0]), np.linspace(*v, shape[1])
    stepper = Stepper(model, Omega)
    flight = stepper.start(_starts(system, Omega, *np.meshgrid(x, y)))
    count = len(flight.d)

    def report(periods: int, settled: int) -> None:
        if progress:
            progress(settled / count, f"{settled} of {count} motions settled after {periods} periods")

    how, ending, done = _unsettled(count, settling), Ending(message="all starts were followed"), np.arange(count)
    try:
        _settle_into(how, stepper, flight, settling, report)
    except (Exception, KeyboardInterrupt) as error:
        done = np.flatnonzero(how.period)
        if not done.size:
            raise
        ending.note(error, f"after {done.size} of {count} motions had settled")
    label = np.full(count, -1)
    label[done], attractors = _sort(stepper.select(done), flight.select(done), how.period[done])
    return Basins(
        float(Omega), x, y, label.reshape(len(y), len(x)), attractors, dict(model.labels), ending.status, ending.told
    )


def _starts(system: Any, Omega: float, d: Array, v: Array) -> Array:
    """States (B, 2) with these element coordinates and rates at tau = 0: w q = d + e, w q' = v + e'."""
    element = system.elements[0]
    w, row = float(element.direction[0]), element.displacement.row()
    e, de = evaluate(row, 0.0)[0], Omega * evaluate(row, 0.0, 1)[0]
    return np.column_stack([(d.ravel() + e) / w, (v.ravel() + de) / w])


def _sort(stepper: Stepper, flight: Flight, period: np.ndarray) -> tuple[np.ndarray, tuple[Attractor, ...]]:
    """Number of the attractor each motion has reached, and the attractors, the most frequent first.

    Motions of one period belong together if their Poincare points do, at whichever of its periods they are.
    """
    y = np.concatenate([flight.d, flight.v], axis=1)
    scale = np.ptp(y, axis=0) + 1e-9
    number = np.full(len(y), -1)
    found: list[tuple[int, Observation]] = []
    for i in range(len(y)):
        if number[i] >= 0:
            continue
        k = int(period[i])
        seen = observe(stepper, flight.select(np.array([i])), k or _LONG)
        near = np.abs((y[:, None] - seen.points[:, 0]) / scale).max(axis=-1).min(axis=1) < 1e-3
        number[np.where(k > 0, near & (period == k), period == 0)] = len(found)
        number[i] = len(found)
        found.append((k, seen))
    order = np.argsort(-np.bincount(number, minlength=len(found)), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    attractors = tuple(
        Attractor(k, seen.points[:, 0], float(seen.rms[0]), float(np.mean(number == i)))
        for i in order for k, seen in [found[i]]
    )  # fmt: skip
    return rank[number], attractors
