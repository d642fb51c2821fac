"""Search for the least change of a design that reaches a goal: cusps or peaks and their linearized distances.

    min_a  sum_i (a_i / a_i0 - 1)^2     with  c(a) >= 0,   low <= a <= high

The steps of `hbgear.design.least_change`: c and its derivatives for the design and each deviation of a sample, and the
nearest point of the half-spaces of the linearized c within a box around the last design. If the half-spaces do not meet
in the box, the smallest c is maximized. The box shrinks if a step does not improve the design.

References
----------
Fletcher & Leyffer (2002), Mathematical Programming 91, 239-269, https://doi.org/10.1007/s101070100244, for the filter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from hbgear.analysis.critical_parameters import NoFoldError, find_cusps
from hbgear.analysis.parameter_sensitivity.relocated_point import RelocatedMotion, RelocatedPoint
from hbgear.analysis.parameter_sensitivity.units import measured_along
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, checked
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.termination import raise_if_interrupted
from hbgear.continuation.solvers.newton import SEARCH_ERRORS, NoConvergence
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.bifurcations.peaks import peaks
from hbgear.harmonic.equations.layout import Layout
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.series.measures import check_measure

GOAL_MARGIN = 1e-3
"""Smallest final value of c, so that the goal is reached in spite of the tolerance of the search."""

MAX_STEPS = 25
"""Largest number of steps of the search."""

STEP_TOLERANCE = 2e-4
"""Relative change of the parameters at which the search has converged."""

SAME_SHORTFALL = 1e-9
"""Shortfall [-] below which the linearized goal is reached."""

MIN_GAIN = 1e-6
"""Predicted decrease of the shortfall [-] up to which a step has no effect."""

SAME_CUSP = 1e-6
"""Relative difference of the values of two cusps [-] up to which they are one."""

SHARE_OF_PEAKS = 0.7
"""Height of a peak over the highest one [-] from which a step takes account of it; see `MAX_RELATIVE_STEP`."""

MAX_RELATIVE_STEP = 0.3
"""Largest relative change of a parameter in one step; the linearization is not valid for larger changes."""

REJECTED_STEP_FACTOR = 0.25
"""Largest relative change of the next step over that of a step that does not improve the design."""

WITHOUT_CHANGE = "the design reaches the goal without a change"


@dataclass(frozen=True)
class Goal:
    """Goal of a design; `no_jumps` and `peak_below` create goals.

    Attributes
    ----------
    kind : {"no jumps", "peak"}
        No jumps, or a limit of the highest peak.
    limit : float
        Limit of the peak.
    measure, element : str and int or str
        Measure and element of the peak, see `Branch.amplitude`.
    margin : float
        Smallest distance to the value at which a jump appears, as a fraction of the value of the design.
    parameter : str
        Parameter of the margin; "" for the first one that has such a value.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.design.peak_below(0.5, "pp2")
    Goal(kind='peak', limit=0.5, measure='pp2', element=0, ...)
    """

    kind: str
    limit: float = math.nan
    measure: str = "pp2"
    element: int | str = 0
    margin: float = 0.0
    parameter: str = ""


@checked_arguments()
def no_jumps(margin: float = 0.0, parameter: str = "") -> Goal:
    """Return the goal that slow sweeps of the frequency do not jump, with a margin in a parameter.

    Parameters
    ----------
    margin : float, default 0.0
        Smallest distance to the critical value at which the jump appears, as a fraction of the value of the design.
    parameter : str, default ""
        Parameter in which the distance is measured. Default: the first one of those that may change and that has a
        critical value.

    Raises
    ------
    ValueError
        If the margin is negative.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.design.no_jumps(0.2, "zeta").margin
    0.2
    """
    checked("no_jumps", "margin", margin, NOT_NEGATIVE)
    return Goal("no jumps", margin=float(margin), parameter=parameter)


@checked_arguments()
def peak_below(limit: float, measure: str = "pp2", element: int | str = 0) -> Goal:
    """Return the goal that the highest peak of an amplitude, a measure of `Branch.amplitude`, is at most a limit.

    Amplitudes at the ends of the span may not be larger either.

    Raises
    ------
    ValueError
        If the limit is not positive or the measure is unknown.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.design.peak_below(0.5).limit
    0.5
    """
    checked("peak_below", "limit", limit, POSITIVE)
    check_measure("peak_below", measure)
    return Goal("peak", float(limit), measure, element)


@dataclass(frozen=True)
class Spread:
    """Scatter of parameters: standard deviations to first order, or a sample and the required share of it."""

    deviations: dict[str, float]
    sigmas: float
    sample: tuple[dict[str, float], ...]
    share: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters of the sample."""
        return tuple(dict.fromkeys(name for row in self.sample for name in row))


@dataclass(frozen=True)
class _Relocated:
    """Cusp or peak with deviations of parameters: value and amplitude with their derivatives by parameter."""

    deviations: dict[str, float]
    value: float
    slopes: dict[str, float]
    amplitude: float
    amplitude_slopes: dict[str, float]

    def linearized(self, deviations: Mapping[str, float]) -> _Relocated:
        """Return the cusp or peak with other deviations, to first order."""
        value, amplitude = (
            base + sum(slopes.get(name, 0.0) * x for name, x in deviations.items())
            for base, slopes in ((self.value, self.slopes), (self.amplitude, self.amplitude_slopes))
        )
        return replace(self, deviations=dict(deviations), value=value, amplitude=amplitude)


@dataclass(frozen=True)
class Cusp:
    """Cusp in a parameter.

    ``side`` is +1 if the jump exists below it, else -1; ``start`` are the relative changes of the design of ``point``.
    """

    name: str
    side: float
    point: SpecialPoint
    start: Array


_Constraint = tuple[float, dict[str, float]]  # c and its derivatives by parameter


@dataclass(frozen=True)
class Slack:
    """Values c (K, S) for K cusps or peaks, of the design and a sample, and their derivatives (K, S, A).

    ``slopes`` are derivatives by the relative changes, and ``required`` (K,) are the least values of c.
    """

    c: Array
    slopes: Array
    required: Array

    @property
    def excess(self) -> Array:
        """Smallest c less the required c, of the design and the sample (S,)."""
        return (self.c - self.required[:, None]).min(axis=0)

    @property
    def shortfall(self) -> float:
        """Largest difference between the required c and c."""
        return -float(self.excess.min())

    def predicted(self, step: Array) -> float:
        """Return the shortfall after a step, to first order."""
        return -float((self.c + self.slopes @ step - self.required[:, None]).min())

    def closest_to_goal(self, share: float) -> Slack:
        """Return the design and a share of the sample, the ones closest to the goal."""
        excess = self.excess[1:]
        count = math.ceil(share * len(excess) - 1e-9)
        best = np.append(0, 1 + np.argsort(-excess, kind="stable")[:count])
        return Slack(self.c[:, best], self.slopes[:, best], self.required)


class Search:
    """Search with steps to the nearest point of the linearized goal."""

    def __init__(
        self,
        problem: HarmonicBalance,
        goal: Goal,
        names: tuple[str, ...],
        nominal: Array,
        span: tuple[float, float],
        spread: Spread,
        progress: ProgressCallback | None,
    ) -> None:
        self.problem, self.goal, self.names, self.nominal, self.span = problem, goal, names, nominal, span
        self.spread, self.progress = spread, progress
        self.start = problem.model.parameters | problem.model.entries
        self.steps = 0
        self.last = np.zeros(len(names))
        self.message = ""
        self.slack = Slack(np.full((1, 1), math.nan), np.zeros((1, 1, len(names))), np.zeros(1))
        self.cusps: list[Cusp] = []
        self.stopped: Branch | None = None

    def values(self, u: Array, deviations: Mapping[str, float] | None = None) -> dict[str, float]:
        """Return the values of the parameters at relative changes, with added deviations."""
        result = {name: float(a * (1.0 + x)) for name, a, x in zip(self.names, self.nominal, u, strict=True)}
        for name, deviation in (deviations or {}).items():
            result[name] = result.get(name, self.start[name]) + deviation
        return result

    def balance(self, u: Array, deviations: Mapping[str, float] | None = None) -> HarmonicBalance:
        """Return the problem of the model at relative changes, with added deviations."""
        base = self.problem
        return HarmonicBalance(
            base.model.replace(**self.values(u, deviations)),
            base.H,
            base.N,
            nu=base.nu,
            sampled=base.is_sampled,
            reduce=base.reduce,
            orders=base.selection,
        )

    def run(self, u: Array, low: Array, high: Array) -> Array:
        """Return relative changes that reach the goal, or the nearest ones within low and high, by linear programs."""
        radius, slack = MAX_RELATIVE_STEP, self._evaluated(u)
        accepted: list[tuple[float, float]] = []
        for _ in range(MAX_STEPS):
            if slack is None:
                self.message = "there is no jump to remove" if not u.any() else "the jump vanished during the search"
                return u
            self.slack, self.last = slack, u
            if not u.any() and slack.shortfall <= 0:
                self.message = WITHOUT_CHANGE
                return u
            accepted.append(_rating(slack, u))
            new = smallest_change(slack, u, np.maximum(low, u - radius), np.minimum(high, u + radius))
            length = float(np.abs(new - u).max())
            if slack.shortfall > 0 and slack.shortfall - slack.predicted(new - u) <= MIN_GAIN:
                new, length = u, 0.0
            if length >= STEP_TOLERANCE:
                trial = self._trial(new)
                if trial is None or _improves(_rating(trial, new), accepted, slack.predicted(new - u)):
                    u, slack, radius = new, trial, min(2.0 * radius, MAX_RELATIVE_STEP)
                else:
                    radius = REJECTED_STEP_FACTOR * length
            elif self._add_cusps(u):
                slack, radius, accepted = self._evaluated(u), MAX_RELATIVE_STEP, []
            else:
                self.message = f"{self.steps} steps"
                return new
        self.message = f"no convergence after {MAX_STEPS} steps"
        return self.last

    def _trial(self, u: Array) -> Slack | None:
        """Return the slack, infinitely short of the goal if it cannot be computed, or None without a jump."""
        try:
            return self._evaluated(u)
        except SEARCH_ERRORS:
            return Slack(np.full((1, 1), -math.inf), np.zeros((1, 1, len(u))), np.zeros(1))

    def _evaluated(self, u: Array) -> Slack | None:
        """Return the slack of the design and the required share of the sample, or None without a jump."""
        self.steps += 1
        slack = self._slack(u)
        if slack is None:
            return None
        slack = slack.closest_to_goal(self.spread.share)
        if self.progress is not None:
            text = ", ".join(f"{name} = {value:.5g}" for name, value in self.values(u).items())
            self.progress(Progress(math.nan, f"{text}: {-slack.shortfall:+.3g}"))
        return slack

    def _slack(self, u: Array) -> Slack | None:
        return self._cusp_slack(u) if self.goal.kind == "no jumps" else self._peak_slack(u)

    def _cusp_slack(self, u: Array) -> Slack | None:
        """Return the slack beyond all cusps known, or None without any.

        A removed jump leaves others, and its cusp must stay removed: otherwise the search could alternate between two
        cusps. Cusps are searched if none is known, or none of them can be relocated.
        """
        constraints = self._relocated_cusps(u)
        if not constraints and self._add_cusps(u):
            constraints = self._relocated_cusps(u)
        return self._assembled_slack(constraints) if constraints else None

    def _relocated_cusps(self, u: Array) -> list[list[_Constraint]]:
        """Return the constraints of all cusps; cusps that are not found for this design are dropped."""
        relocated: list[Cusp] = []
        constraints: list[list[_Constraint]] = []
        for cusp in self.cusps:
            with suppress(*SEARCH_ERRORS):
                constraints.append(self._constraints(cusp, u))
                relocated.append(cusp)
        self.cusps = relocated
        return constraints

    def _constraints(self, cusp: Cusp, u: Array) -> list[_Constraint]:
        """Return the distance beyond a cusp in its parameter for the design and each deviation of the sample."""
        name, nominal = cusp.name, self.start[cusp.name]
        value, unit = self.values(u).get(name, nominal), cusp.side / abs(nominal)

        def constraint(relocated: _Relocated) -> _Constraint:
            rates = {name: unit, **{parameter: -unit * slope for parameter, slope in relocated.slopes.items()}}
            return unit * (value + relocated.deviations.get(name, 0.0) - relocated.value), rates

        return [constraint(relocated) for relocated in self._relocated(cusp.point, name, cusp.start, u)]

    def _add_cusps(self, u: Array) -> bool:
        """Search the cusps of the design in the named parameter, or in the first parameter that has one.

        Returns True if one of them was not known.
        """
        if self.goal.kind != "no jumps" or any(not (cusp.start - u).any() for cusp in self.cusps):
            return False
        problem, old_count = self.balance(u), len(self.cusps)
        for name in [self.goal.parameter] if self.goal.parameter else self.names:
            with suppress(NoFoldError, NoConvergence):
                cusps = list(find_cusps(problem, name, self.span))
                nearest = [cusp for i, cusp in enumerate(cusps) if not i or cusp.folds is not cusps[i - 1].folds]
                for cusp in nearest:  # of each fold curve; those behind it matter once its jump is removed
                    self._add(Cusp(name, 1.0 if cusp.jump_below else -1.0, cusp.point, u))
                break
        return len(self.cusps) > old_count

    def _add(self, cusp: Cusp) -> None:
        """Append a cusp unless a known one has the same value for its design."""
        value = cusp.point.parameters[cusp.name]
        for other in (other for other in self.cusps if (other.name, other.side) == (cusp.name, cusp.side)):
            with suppress(*SEARCH_ERRORS):
                relocated = self._relocated(other.point, other.name, other.start, cusp.start)[0]
                if abs(relocated.value - value) <= SAME_CUSP * abs(value):
                    return
        self.cusps.append(cusp)

    def _peak_slack(self, u: Array) -> Slack:
        """Return the slack of the highest peaks and of the ends of the span below the limit, relative to it.

        Lower ones than the highest one count, because a change may exchange them.
        """
        problem, goal = self.balance(u), self.goal
        curve = raise_if_interrupted(trace(problem, "Omega", self.span, accuracy=None, stability=False, special=False))
        curves = curve.curves
        unbounded = [Omega for c in curves for Omega in c.asymptotes.values()]
        if unbounded:
            raise ValueError(
                f"redesign: motions grow without bound towards Omega = {unbounded[0]:.6g}, so that {goal.measure} has "
                "no highest peak; start from a design with bounded motions, such as one with more damping"
            )
        tops = highest_points(curves, goal, self.span)

        def constraint(relocated: _Relocated) -> _Constraint:
            rates = {name: -rate / goal.limit for name, rate in relocated.amplitude_slopes.items()}
            return 1.0 - relocated.amplitude / goal.limit, rates

        heights = [top.amplitude(goal.measure, goal.element) for top in tops]
        high = [top for top, height in zip(tops, heights, strict=True) if height >= SHARE_OF_PEAKS * max(heights)]
        return self._assembled_slack(
            [[constraint(relocated) for relocated in self._relocated(top, "Omega", u, u)] for top in high]
        )

    def _relocated(self, point: Point, parameter: str, start: Array, u: Array) -> list[_Relocated]:
        """Return the special point, or the motion at an end of the span, at u and for each deviation of the sample.

        ``start`` are the relative changes of the design of ``point``. A deviation for which the point is not found has
        its first-order estimate.
        """
        all_names = (*self.names, *self.spread.deviations, *self.spread.names)
        names = [name for name in dict.fromkeys(all_names) if name != parameter]
        mover = (RelocatedPoint if isinstance(point, SpecialPoint) else RelocatedMotion)(point, names)
        old, new = self.values(start), self.values(u)
        changes = {name: new[name] - old[name] for name in new}
        first = self._relocated_at(mover, point, names, changes, {})
        points = [first]
        for deviations in self.spread.sample:
            try:
                points.append(self._relocated_at(mover, point, names, changes, deviations))
            except SEARCH_ERRORS:
                points.append(first.linearized(deviations))
        return points

    def _relocated_at(
        self,
        mover: RelocatedPoint | RelocatedMotion,
        point: Point,
        names: Sequence[str],
        changes: Mapping[str, float],
        deviations: Mapping[str, float],
    ) -> _Relocated:
        """Return the point, its frequency and its size at changed parameters, with their derivatives."""
        U, resolved = mover.solved(np.array([changes.get(name, 0.0) + deviations.get(name, 0.0) for name in names]))
        slopes, layout, goal = mover.slopes(U, resolved), point.layout, self.goal
        assert isinstance(layout, Layout)
        X, along = U[None, : layout.width], slopes.X[None, :, : layout.width]
        size = float(layout.measure(goal.measure, X[0], goal.element))
        rates = measured_along(layout, goal.measure, goal.element, X, along)[0] if names else np.zeros(0)
        return _Relocated(
            dict(deviations),
            float(U[-1]),
            dict(zip(names, slopes.p.tolist(), strict=True)),
            size,
            dict(zip(names, rates.tolist(), strict=True)),
        )

    def _assembled_slack(self, rows: Sequence[Sequence[_Constraint]]) -> Slack:
        """Return the slack with derivatives by the relative changes and the reserve for the scatter."""

        def reserve(rates: Mapping[str, float]) -> float:
            return self.spread.sigmas * math.hypot(*(rates[name] * s for name, s in self.spread.deviations.items()))

        slopes = np.array([[[rates[name] for name in self.names] for _, rates in row] for row in rows]) * self.nominal
        required = [max(GOAL_MARGIN, self.goal.margin) + reserve(row[0][1]) for row in rows]
        return Slack(np.array([[c for c, _ in row] for row in rows]), slopes, np.array(required))


def highest_points(curves: Sequence[Branch], goal: Goal, span: tuple[float, float]) -> list[Point]:
    """Return the located high peaks of the measure of a goal, and the points of the curves at the ends of the span."""
    tops: list[Point] = [
        top for curve in curves for top in peaks(curve, goal.measure, goal.element, share=SHARE_OF_PEAKS, accuracy=None)
    ]
    return tops + [curve[i] for curve in curves for i in (0, -1) if curve.values[i] in span]


def _rating(slack: Slack, u: Array) -> tuple[float, float]:
    """Return the shortfall, at least zero, and the distance from the design."""
    return max(slack.shortfall, 0.0), float(np.linalg.norm(u))


def _improves(rating: tuple[float, float], accepted: Sequence[tuple[float, float]], predicted: float) -> bool:
    """Return whether a design improves the accepted ones, given the ratings and its predicted shortfall.

    If the step reaches the linearized goal, the shortfall or the distance must be smaller than that of each accepted
    design, the condition of a filter. Otherwise the shortfall must be smaller than that of the last one.
    """
    if predicted > SAME_SHORTFALL:
        return rating[0] < accepted[-1][0]
    return all(rating[0] < shortfall or rating[1] < distance for shortfall, distance in accepted)


def smallest_change(slack: Slack, u: Array, low: Array, high: Array) -> Array:
    """Return the least change v with c + c' (v - u) >= required for each c, within the bounds.

    This is the least distance problem of Lawson and Hanson, solved by nonnegative least squares. If no change within
    the bounds suffices, all required values are lowered by the least number with which one does.
    """
    from scipy.optimize import linprog, lsq_linear

    n = len(u)
    slopes = slack.slopes.reshape(-1, n)
    required = (slack.required[:, None] - slack.c).ravel() + slopes @ u
    unit = np.append(np.zeros(n), 1.0)
    relaxed = linprog(
        unit,
        np.column_stack([-slopes, -np.ones(len(slopes))]),
        -required,
        bounds=[*zip(low, high, strict=True), (0.0, None)],
    )
    G = np.concatenate([slopes, np.eye(n), -np.eye(n)])
    h = np.concatenate([required - relaxed.x[n], low, -high])
    size = np.linalg.norm(G, axis=1)
    E = np.vstack([G.T, h]) / np.where(size, size, 1.0)
    y = lsq_linear(E, unit, (0.0, np.inf), "bvls", tol=1e-15, max_iter=100 * len(h)).x
    r = E @ y - unit
    nearest = -r[:n] / r[n] if -r[n] > 1e-10 else relaxed.x[:n]
    return np.asarray(np.clip(nearest, low, high))
