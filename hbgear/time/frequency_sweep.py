"""Slow sweeps by time integration: the procedure of experiments and of most of the literature.

    state at values[i + 1], tau = 0   <-   settled state at values[i], tau = 0

At each value the motion is integrated by the exponential method until it is settled, not for a fixed number of periods,
see `steady_state`. A motion that does not settle is classified as not periodic, and its largest Lyapunov exponent is
computed.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.atomic_write import checked_suffix, csv_table
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import ANY, Range, checked
from hbgear.common.text.messages import did_you_mean
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination
from hbgear.harmonic.equations.layout import element_index
from hbgear.mechanics.models import Model
from hbgear.mechanics.plausibility import check_model
from hbgear.mechanics.series import measures
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.exponential.modal_states import StateBatch
from hbgear.time.observation import HARMONICS, Observation, observe
from hbgear.time.steady_state import (
    FEWEST,
    MIN_CHAOTIC_GROWTH,
    OBSERVED,
    WINDOW,
    Settled,
    SteadyStateSettings,
    disturbed,
    lyapunov,
    settle,
)

_PERIODS_BEFORE_LYAPUNOV = 400
"""Number of excitation periods [-] after which a motion that has not settled is tested for chaos."""

_MIN_JUMP = 0.02
"""Smallest change of rms or pp2 between neighbouring values, relative to the largest so far [-], that may be a jump."""

_MIN_JUMP_APERIODIC = 0.2
"""The same threshold [-] if a motion is not periodic, because its amplitude fluctuates."""

_ADVICE = "motions up to there are kept; sweep the other values from the last state: start=sweep.states[-1]"
"""Recommended action for a sweep that is not complete."""


class _MotionDiverges(ValueError):
    """The motion grew beyond the range of floating-point numbers."""


@dataclass(frozen=True, eq=False)
class SweepJump:
    """Jump of a sweep between two neighbouring values of the grid.

    Attributes
    ----------
    parameter : str
        Name of the swept parameter.
    interval : tuple of float
        Values before and after the jump.
    before, after : ndarray, shape (m,)
        Root mean square of each element coordinate.
    """

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
    """Settled motions at each of P values, in the order of the sweep.

    Attributes
    ----------
    parameter : str
        Name of the swept parameter.
    values : ndarray, shape (P,)
        Values of the parameter that were reached.
    elements : tuple of str
        Names of the elements.
    labels : dict
        Axis labels of the parameters.
    rms, pp2, max, mean : ndarray, shape (P, m)
        Root mean square, half peak-to-peak, largest modulus and mean of each element coordinate.
    rows : ndarray, shape (P, m, 2H + 1)
        Real Fourier coefficients of each element coordinate, in harmonics of the excitation.
    points : tuple of ndarray, shape (k, m, 2)
        Poincare points (d, v) at tau = 0 of each motion, one per excitation period.
    period : ndarray, shape (P,)
        Period in excitation periods; 0 if the motion did not settle.
    integrated_periods : ndarray, shape (P,)
        Number of integrated excitation periods.
    remaining_distance : ndarray, shape (P,)
        Estimated remaining distance, relative to the state.
    likely_period : ndarray, shape (P,)
        Period in excitation periods to which the motion comes closest.
    states : ndarray, shape (P, 2n)
        State (q, q') of each motion at tau = 0.
    lyapunov : ndarray, shape (P,)
        Largest Lyapunov exponent per unit of time if the motion did not settle, else nan.
    jumps : tuple of SweepJump
        Jumps with the values between which they lie.
    direction : int
        +1 for increasing, -1 for decreasing values.
    status : Status
        Status at the end.
    message : str
        Reason for the end.
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
    integrated_periods: np.ndarray
    remaining_distance: Array
    likely_period: np.ndarray
    states: Array
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
        """Array (P,): True where the motion settled."""
        return self.period > 0

    def index(self, element: int | str) -> int:
        """Return the index of an element, given by index or name."""
        return element_index(self.elements, element)

    def amplitude(self, measure: str = "rms", element: int | str = 0) -> Array:
        """Return a measure of the amplitude of each motion.

        Parameters
        ----------
        measure : str, optional
            Measure as in `Branch.amplitude`; "H1", "H2", ... are harmonics of the excitation.
        element : int or str, optional
            Index or name of the element.

        Returns
        -------
        ndarray, shape (P,)
            Amplitude of each motion.
        """
        j = self.index(element)
        if measure in measures.BUILT_IN_MEASURES:
            return np.asarray(getattr(self, measure)[:, j])
        if measure in measures.MEASURES:
            names = ", ".join(measures.BUILT_IN_MEASURES)
            raise ValueError(f"a sweep has no measure '{measure}': time integration records {names}, H1, H2, ...")
        return measures.measure(measure, self.rows[:, j])

    def section_points(self, rows: np.ndarray, element: int | str = 0, rate: bool = False) -> tuple[Array, Array]:
        """Return parameter values and displacements, or rates, of all Poincare points of some motions."""
        j = self.index(element)
        heights = [self.points[i][:, j, int(rate)] for i in rows]
        counts = np.array([len(height) for height in heights], dtype=int)
        return np.repeat(self.values[rows], counts), np.concatenate([np.empty(0), *heights])

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write a table of the values (.csv) by an atomic replacement of the file."""
        export((self,), path)


def export(sweeps: Sequence[Sweep], path: str | os.PathLike[str]) -> None:
    """Write several sweeps of one model to one table (.csv) by an atomic replacement of the file.

    Parameters
    ----------
    sweeps : sequence of Sweep
        Sweeps of one model.
    path : str or path-like
        Name of the file, which ends in .csv.

    Raises
    ------
    ValueError
        If the name does not end in .csv.
    """
    checked_suffix(path, (".csv",), "tables are .csv files")
    with csv_table(path) as writer:
        for i, result in enumerate(sweeps):
            columns: dict[str, Any] = {result.parameter: result.values, "direction": [result.direction] * len(result)}
            for j, name in enumerate(result.elements):
                columns |= {f"{measure}_{name}": result.amplitude(measure, j) for measure in measures.BUILT_IN_MEASURES}
            columns |= {
                name: getattr(result, name)
                for name in ("period", "integrated_periods", "remaining_distance", "lyapunov")
            }
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
    """Compute a slow sweep over a grid of a parameter, in which each motion starts from the last state.

    Parameters
    ----------
    model : Model
        Model with any number of coordinates for which its modes can be computed.
    grid : array_like
        Values of the parameter, in any order.
    direction : {"up", "down"}, optional
        Order of the values. Default: "up".
    parameter : str, optional
        "Omega" or the name of a parameter of the model. Default: "Omega".
    at : dict, optional
        Values of fixed parameters, such as ``{"Omega": 0.9}`` if another parameter is swept.
    start : array_like, shape (2n,), optional
        State (q, q') at tau = 0 before the first value. Default: at rest at q = 0.
    settling : SteadyStateSettings, optional
        Conditions under which a motion is settled.
    disturbance : float, optional
        Size of a random disturbance at each value, relative to the state, from 0 to 1. Default: 1e-4. Without it a
        symmetric model (two equal helices) remains on a symmetric motion even if that is unstable. It must exceed the
        tolerance.
    steps : int, optional
        Number of integration steps per excitation period. By default it is selected for the model.
    progress : callable, optional
        Called with a `Progress`, such as ``print``.

    Returns
    -------
    Sweep
        Settled motions. After Ctrl-C it has the status ``interrupted`` and contains all motions so far.

    Raises
    ------
    ValueError, KeyError
        If the grid is empty or not finite, the direction or a parameter is unknown, Omega is missing or not positive,
        the disturbance is not from 0 to 1, or the motion at the first value diverges. A motion that diverges at a later
        value ends the sweep with the status ``failed``, with all motions so far.

    Notes
    -----
    A change of rms or half peak-to-peak between neighbouring values that is much larger than the change before it is
    a jump if the sweep does not return to the former motion after one step back. A steep but continuous curve has no
    jump.

    Examples
    --------
    >>> import hbgear as hb
    >>> up = hb.time.sweep(hb.Duffing(zeta=0.3), [0.5, 0.6], "up")
    >>> up.values.tolist(), len(up.jumps)
    ([0.5, 0.6], 0)
    """
    fixed = dict(at or {})
    return _Sweeper(model, grid, direction, parameter, fixed, start, settling, disturbance, steps, progress).run()


@dataclass(eq=False)
class _Sweeper:
    """State of one sweep."""

    model: Model
    grid: Any
    direction: str
    parameter: str
    fixed: dict[str, float]
    start: Array | None
    settling: SteadyStateSettings
    disturbance: float
    steps: int | None
    progress: ProgressCallback | None
    results: list[tuple[float, Observation, Settled, float]] = field(default_factory=list)
    last: ExponentialIntegrator | None = None
    jumps: list[SweepJump] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.direction not in ("up", "down"):
            raise ValueError(f"direction = {self.direction!r} must be 'up' or 'down'")
        values = np.unique(np.asarray(self.grid, dtype=float))
        if values.size == 0 or not np.all(np.isfinite(values)):
            raise ValueError(f"a sweep needs at least one value, all finite; given: {self.grid!r}")
        self.values = values if self.direction == "up" else values[::-1]
        checked("sweep", "disturbance", self.disturbance, Range(0, 1))
        self.random = np.random.default_rng(1)
        names = ("Omega", *self.model.parameters, *self.model.entries)
        for name in (self.parameter, *self.fixed):
            if name not in names:
                raise KeyError(f"{type(self.model).__name__} has no parameter '{name}'{did_you_mean(name, names)}")
        if self.parameter != "Omega" and "Omega" not in self.fixed:
            raise ValueError(f"a sweep in {self.parameter} needs a fixed Omega: give at={{'Omega': ...}}")
        for name, value in self.fixed.items():
            checked("sweep: at", name, value)
        lowest = values.min() if self.parameter == "Omega" else self.fixed["Omega"]
        if lowest <= 0:
            raise ValueError(f"Omega = {lowest:.6g} must be positive; remove it from the grid")
        allowed = self.model.ranges.get(self.parameter, ANY)
        if values[0] not in allowed or values[-1] not in allowed:
            raise ValueError(f"grid from {values[0]:g} to {values[-1]:g}: {self.parameter} must {allowed}")

    def run(self) -> Sweep:
        """Integrate at all values unless interrupted, and return the sweep."""
        system = self.model.system()
        check_model(self.model, system)
        state = np.zeros(2 * system.n) if self.start is None else np.asarray(self.start, dtype=float)
        if state.shape != (2 * system.n,) or not np.all(np.isfinite(state)):
            raise ValueError(f"start = {self.start}: give a state (q, q') of {2 * system.n} finite numbers")
        ending = Termination(message=f"{self.parameter} = {self.values[-1]:.6g} reached", advice=_ADVICE)
        try:
            for i, value in enumerate(self.values):
                before = state
                state = self._settle(value, state)
                self._detect_jump(i, before, state)
                if self.progress:
                    self.progress(Progress((i + 1) / len(self.values), self._progress_text()))
        except (Exception, KeyboardInterrupt) as error:
            if isinstance(error, Exception) and not self.results:
                raise
            position = f"after {len(self.results)} of {len(self.values)} values"
            if isinstance(error, _MotionDiverges):
                ending.record_end(Status.FAILED, f"{position}, {error}")
            else:
                ending.record_error(error, position)
        return self._result(system, ending.status, ending.message_with_advice)

    def _integrator_at(self, value: float) -> ExponentialIntegrator:
        """Return the integrator at a value of the parameter."""
        fields = {**self.fixed, self.parameter: float(value)}
        Omega = fields.pop("Omega")
        if self.last and self.parameter == "Omega":
            return self.last.at(Omega, self.steps)
        self.last = ExponentialIntegrator(self.model.replace(**fields) if fields else self.model, Omega, self.steps)
        return self.last

    def _settle(self, value: float, state: Array) -> Array:
        """Integrate at a value from a state until settled, store the motion, and return its state."""
        integrator = self._integrator_at(value)
        motions = self._disturbed(integrator, integrator.start(state))
        settled, exponent = self._integrate_until_settled(value, integrator, motions)
        period = int(settled.period[0])
        observed = observe(integrator, motions, period or OBSERVED)
        self.results.append((float(value), observed, settled, exponent))
        self.states.append(integrator.states(motions)[0])
        return self.states[-1]

    def _disturbed(self, integrator: ExponentialIntegrator, motions: StateBatch) -> StateBatch:
        """Return the motion with a disturbance, which is equal in every run."""
        if not self.results:  # the size of a start at rest is zero
            integrator.advance(motions, WINDOW)
        return disturbed(integrator, motions, self.disturbance, self.random)

    def _integrate_until_settled(
        self, value: float, integrator: ExponentialIntegrator, motions: StateBatch
    ) -> tuple[Settled, float]:
        """Integrate until settled; stop early if a positive Lyapunov exponent shows that the motion is chaotic."""

        def settled(longest: int) -> Settled:
            result = settle(integrator, motions, replace(self.settling, longest=longest))
            if not np.isfinite(motions.zeta).all():
                raise _MotionDiverges(
                    f"the motion diverges at {self.parameter} = {value:.6g}: begin at a value with a bounded motion, "
                    "or give a start near it"
                )
            return result

        longest, shortest = self.settling.longest, max(FEWEST, self.settling.periods)
        first = max(_PERIODS_BEFORE_LYAPUNOV, shortest)
        if longest - first < shortest:  # after a test for chaos too few periods would remain
            first = longest
        result = settled(first)
        if result.period[0]:
            return result, np.nan
        exponent = lyapunov(integrator, motions)
        if first == longest or exponent * 2 * np.pi / integrator.Omega[0] > MIN_CHAOTIC_GROWTH:
            return result, exponent
        result = settled(longest - first)
        result = replace(result, integrated_periods=result.integrated_periods + first)
        return result, np.nan if result.period[0] else lyapunov(integrator, motions)

    def _detect_jump(self, i: int, before: Array, state: Array) -> None:
        """Store a jump between the last two values if the change is large and one step back does not undo it."""
        if i == 0:
            return
        is_periodic = all(f[2].period[0] for f in self.results[-2:])
        measures = ("rms", "pp2") if is_periodic else ("rms",)
        largest = {name: max(getattr(f[1], name).max() for f in self.results) or 1.0 for name in measures}

        def relative(observed: Observation) -> Array:
            return np.array([getattr(observed, name) / largest[name] for name in measures])

        sizes = [relative(f[1]) for f in self.results[-3:]]
        change = [np.abs(after - before).max() for before, after in pairwise(sizes)]
        previous = change[-2] if i > 1 else 0.0
        if change[-1] < max(3 * previous, _MIN_JUMP if is_periodic else _MIN_JUMP_APERIODIC):
            return
        integrator = self._integrator_at(self.values[i - 1])
        motions = integrator.start(state)
        settled = settle(integrator, motions, self.settling)
        returned = observe(integrator, motions, int(settled.period[0]) or OBSERVED)
        if not np.abs(relative(returned) - sizes[-2]).max() <= 0.2 * change[-1]:  # also true if the motion diverges
            interval = (float(self.values[i - 1]), float(self.values[i]))
            self.jumps.append(SweepJump(self.parameter, interval, *(f[1].rms for f in self.results[-2:])))

    def _progress_text(self) -> str:
        """Return the message of the last value."""
        value, observed, out, _ = self.results[-1]
        period = f"period {out.period[0]}" if out.period[0] else "not periodic"
        return (
            f"{self.parameter} = {value:.5g}, rms {observed.rms.max():.4g}, {period} after {out.integrated_periods[0]}"
        )

    def _result(self, system: Any, status: Status, message: str) -> Sweep:
        """Return the sweep of all values so far."""
        observed = [f[1] for f in self.results]
        m, settled = len(system.elements), [f[2] for f in self.results]
        unsettled = sum(int(h.period[0] == 0) for h in settled)
        if unsettled:
            message += f"; {unsettled} of {len(settled)} motions did not settle within {self.settling.longest} periods"

        def stacked(name: str, shape: tuple[int, ...]) -> Array:
            return np.array([getattr(s, name) for s in observed]).reshape(len(observed), *shape)

        return Sweep(
            parameter=self.parameter,
            values=np.array([f[0] for f in self.results]),
            elements=tuple(e.name for e in system.elements),
            labels=dict(self.model.labels),
            rms=stacked("rms", (m,)),
            pp2=stacked("pp2", (m,)),
            max=stacked("max", (m,)),
            mean=stacked("mean", (m,)),
            rows=stacked("rows", (m, 2 * HARMONICS + 1)),
            points=tuple(s.points for s in observed),
            period=np.array([h.period[0] for h in settled], dtype=int),
            integrated_periods=np.array([h.integrated_periods[0] for h in settled], dtype=int),
            remaining_distance=np.array([h.remaining_distance[0] for h in settled]),
            likely_period=np.array([h.likely_period[0] for h in settled], dtype=int),
            states=np.array(self.states).reshape(len(self.states), 2 * system.n),
            lyapunov=np.array([f[3] for f in self.results]),
            jumps=tuple(self.jumps),
            direction=1 if self.direction == "up" else -1,
            status=status,
            message=message,
        )
