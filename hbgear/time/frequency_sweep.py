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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import atomic_write
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import ANY, Range, checked
from hbgear.common.text.messages import did_you_mean
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination
from hbgear.harmonic.equations import layout as measures
from hbgear.mechanics.models import Model
from hbgear.mechanics.plausibility import check_model
from hbgear.mechanics.series.fourier import to_real
from hbgear.time.exponential.integrator import ExponentialIntegrator, StateBatch
from hbgear.time.steady_state import FEWEST, OBSERVED, WINDOW, Settled, SteadyStateSettings, disturbed, lyapunov, settle

HARMONICS = 16
"""Harmonics of the excitation that are kept of each settled motion."""


_PATIENCE = 400  # periods after which a motion that has not settled is tested for chaos


_CHAOTIC = 0.02  # growth of a disturbance per period, as a logarithm, above which a motion is called chaotic


_JUMP_IN_CHAOS = 0.2  # the same where a motion is not periodic, its amplitude then fluctuates


_JUMP = 0.02  # change between neighbouring values, relative to the largest amplitude so far, that may be a jump


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


def observe(integrator: ExponentialIntegrator, motions: StateBatch, periods: int) -> Observation:
    """One motion over so many excitation periods; the motions moves on."""
    fine = integrator.advance(motions, periods, record=True)
    assert fine is not None
    d, v = fine[0][0], fine[1][0]
    per_period = d.shape[1] // periods
    h = 2 * np.pi / (integrator.Omega[0] * per_period)
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
    met: Array = d[rows, i] + gain
    return met


# ---- sweeps


class _RunsAway(ValueError):
    """A motion that grew beyond all numbers."""


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
        return index_of(self.elements, element)

    def amplitude(self, measure: str = "rms", element: int | str = 0) -> Array:
        """A measure of every motion (P,), as `Branch.amplitude`; "H1", "H2", ... are harmonics of the excitation."""
        j = self.index(element)
        if measure in measures.MEASURES:
            return np.asarray(getattr(self, measure)[:, j])
        return measures.measure(measure, self.rows[:, j])

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a table of the values (.csv), whole or not at all."""
        export((self,), path)


def index_of(elements: Sequence[str], element: int | str) -> int:
    """Position of an element, given by position or name, among those of these names.

    Raises
    ------
    KeyError
        If it is none of them.
    """
    if isinstance(element, str) and element in elements:
        return elements.index(element)
    if not isinstance(element, str) and 0 <= element < len(elements):
        return int(element)
    raise KeyError(f"no element {element!r}; there are {', '.join(map(repr, elements))} (or by number from 0)")


def export(sweeps: Sequence[Sweep], path: str | os.PathLike[str]) -> None:
    """Write several sweeps of one model to one table (.csv), whole or not at all; direction is +1 or -1."""
    if not str(path).lower().endswith(".csv"):
        raise ValueError(f"'{path}' must end in .csv")
    with atomic_write(path, "x", encoding="utf-8", newline="") as handle:
        writer = csv.writer(handle)
        for i, found in enumerate(sweeps):
            columns: dict[str, Any] = {found.parameter: found.values, "direction": [found.direction] * len(found)}
            for j, name in enumerate(found.elements):
                columns |= {f"{measure}_{name}": found.amplitude(measure, j) for measure in measures.MEASURES}
            columns |= {name: getattr(found, name) for name in ("period", "taken", "left", "lyapunov")}
            if i == 0:
                writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))


@checked_arguments()
def sweep(
    model: Model,
    grid: Sequence[float] | Array,
    direction: str = "up",
    *,
    parameter: str = "Omega",
    at: Mapping[str, float] | None = None,
    start: Array | None = None,
    settling: SteadyStateSettings = SteadyStateSettings(),
    disturbance: float = 1e-4,
    steps: int | None = None,
    progress: ProgressCallback | None = None,
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
    progress : called with a `Progress`, such as ``print``.

    A change between neighbouring values that is much larger than the one before is a jump if the sweep does not find
    back when the parameter is turned back by one value; a steep but single curve is none.

    Returns
    -------
    Sweep
        Ctrl-C ends it with the status ``interrupted`` and everything found so far.

    Raises
    ------
    ValueError, KeyError
        If the grid is empty or not finite, the direction or a parameter unknown, Omega missing or not positive, the
        disturbance not from 0 to 1, or the motion at the first value runs away. One that runs away at a later value
        ends the sweep with the status ``failed`` and everything found so far.

    Examples
    --------
    >>> import hbgear as hb
    >>> up = hb.time.sweep(hb.Duffing(zeta=0.3), [0.5, 0.6], "up")
    >>> up.values.tolist(), len(up.jumps)
    ([0.5, 0.6], 0)
    """
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
    settling: SteadyStateSettings
    disturbance: float
    steps: int | None
    progress: ProgressCallback | None
    found: list[tuple[float, Observation, Settled, float]] = field(default_factory=list)
    last: ExponentialIntegrator | None = None
    jumps: list[SweepJump] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.direction not in ("up", "down"):
            raise ValueError(f"direction = {self.direction!r} must be 'up' or 'down'")
        values = np.unique(np.asarray(self.grid, dtype=float))
        if values.size == 0 or not np.all(np.isfinite(values)):
            raise ValueError(f"a sweep needs at least one value, all finite; got {self.grid!r}")
        self.values = values if self.direction == "up" else values[::-1]
        checked("sweep", "disturbance", self.disturbance, Range(0, 1))
        self.random = np.random.default_rng(1)
        known = ("Omega", *self.model.parameters, *self.model.entries)
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
        check_model(self.model, system)
        state = np.zeros(2 * system.n) if self.start is None else np.asarray(self.start, dtype=float)
        if state.shape != (2 * system.n,) or not np.all(np.isfinite(state)):
            raise ValueError(f"start = {self.start}: need a state (q, q') of {2 * system.n} finite numbers")
        ending = Termination(message=f"{self.parameter} = {self.values[-1]:.6g} reached")
        try:
            for i, value in enumerate(self.values):
                before = state
                state = self._settle(value, state)
                self._look_for_jump(i, before, state)
                if self.progress:
                    self.progress(Progress((i + 1) / len(self.values), self._text()))
        except (Exception, KeyboardInterrupt) as error:
            if isinstance(error, Exception) and not self.found:
                raise
            place = f"after {len(self.found)} of {len(self.values)} values"
            if isinstance(error, _RunsAway):
                ending.record_end(Status.FAILED, f"{place}, {error}")
            else:
                ending.record_error(error, place)
        return self._result(system, ending.status, ending.message_with_advice)

    def _stepper(self, value: float) -> ExponentialIntegrator:
        here = {**self.at, self.parameter: float(value)}
        Omega = here.pop("Omega")
        if self.last and self.parameter == "Omega":
            return self.last.at(Omega, self.steps)
        self.last = ExponentialIntegrator(self.model.replace(**here) if here else self.model, Omega, self.steps)
        return self.last

    def _settle(self, value: float, state: Array) -> Array:
        """Settle at a value from a state, note what is found, and return the state then."""
        integrator = self._stepper(value)
        motions = self._disturbed(integrator, integrator.start(state))
        how, exponent = self._wait(value, integrator, motions)
        period = int(how.period[0])
        seen = observe(integrator, motions, period or OBSERVED)
        self.found.append((float(value), seen, how, exponent))
        states: Array = integrator.states(motions)[0]
        return states

    def _disturbed(self, integrator: ExponentialIntegrator, motions: StateBatch) -> StateBatch:
        """The motion a little beside; the same little in every run."""
        if not self.found:  # a start at rest has no size yet
            integrator.advance(motions, WINDOW)
        return disturbed(integrator, motions, self.disturbance, self.random)

    def _wait(self, value: float, integrator: ExponentialIntegrator, motions: StateBatch) -> tuple[Settled, float]:
        """Settle; a motion that has not and whose neighbours run away from it is chaotic and not waited for."""

        def settled(longest: int) -> Settled:
            how = settle(integrator, motions, replace(self.settling, longest=longest))
            if not np.isfinite(motions.zeta).all():
                raise _RunsAway(
                    f"the motion diverges at {self.parameter} = {value:.6g}: begin at a value where one stays, "
                    "or with a start near it"
                )
            return how

        longest, fewest = self.settling.longest, max(FEWEST, self.settling.periods)
        first = max(_PATIENCE, fewest)
        if longest - first < fewest:  # what is left after a test for chaos would be too short to judge the motion again
            first = longest
        how = settled(first)
        if how.period[0]:
            return how, np.nan
        exponent = lyapunov(integrator, motions)
        if first == longest or exponent * 2 * np.pi / integrator.Omega[0] > _CHAOTIC:
            return how, exponent
        how = settled(longest - first)
        how = replace(how, taken=how.taken + first)
        return how, np.nan if how.period[0] else lyapunov(integrator, motions)

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
        integrator = self._stepper(self.values[i - 1])
        motions = integrator.start(state)
        how = settle(integrator, motions, self.settling)
        back = observe(integrator, motions, int(how.period[0]) or OBSERVED)
        if not np.abs(back.rms - rms[-2]).max() <= 0.2 * change[-1]:  # it does not if it runs away
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
