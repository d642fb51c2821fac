"""Least change of a design that reaches a goal: no jump, or a peak below a limit.

    min_a  sum_i (a_i / a_i0 - 1)^2     with  c(a) >= 0,   low <= a <= high

    no jump:       c = +-(q - q*(a)) / q0 - margin   beyond the cusp q* of the folds of a jump, in a parameter q
    peak below L:  c = 1 - A*(a) / L

c is linearized with the derivatives of cusps and peaks (`hbgear.analysis.parameter_sensitivity`). The nearest point of
the resulting half-spaces is the next iterate, until it converges. A trace verifies the result.

With a scatter s of parameters, c must be positive by k standard deviations, k (sum_i (dc/da_i s_i)^2)^(1/2). With a
sample of deviations there is one c for each of them, computed from its own cusp or peak. All of them, or a given share,
must be positive; the worst ones beyond this share are ignored in the step. The result is traced with every deviation.

References
----------
Nocedal & Wright (2006), Numerical Optimization, ch. 18, https://doi.org/10.1007/978-0-387-40065-5. Lawson & Hanson
(1995), Solving Least Squares Problems, ch. 23, https://doi.org/10.1137/1.9781611971217.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from hbgear.analysis.critical_parameters import NoFoldError, critical_parameter
from hbgear.analysis.parameter_sensitivity import RelocatedPoint, measured_along
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range, checked
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination, raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.tracing.trace import trace
from hbgear.design.bounds import bounds_of
from hbgear.design.studies.samples import Grid, Sample
from hbgear.harmonic.bifurcations.peaks import peaks
from hbgear.harmonic.equations.layout import Layout, check_measure
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model
from hbgear.mechanics.plausibility import ImplausibleInputWarning

GOAL_MARGIN = 1e-3
"""Smallest final value of c, so that the goal is reached in spite of the tolerance of the search."""

MAX_STEPS = 25
"""Largest number of steps of the search."""

DEFAULT_BOUND_FACTORS = (0.01, 11.0)
"""Default bounds of a parameter as multiples of its value."""

STEP_TOLERANCE = 2e-4
"""Relative change of the parameters at which the search has converged."""

SHARE_RANGE = Range(above=0, high=1)
"""Range of the share of a sample that must reach the goal."""

MAX_RELATIVE_STEP = 0.3
"""Largest relative change of a parameter in one step; the linearization is not valid for larger changes."""


@dataclass(frozen=True)
class Goal:
    """Goal of a design; `no_jumps` and `peak_below` create goals.

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


@dataclass(frozen=True, eq=False, repr=False)
class Redesign:
    """Changed design.

    Attributes
    ----------
    model : Model
        Model with the new values.
    values, changes : dict of str to float
        New values of the parameters and their relative changes, by name.
    distance : float
        Square root of the sum of the squared relative changes.
    reached : bool
        True if a trace verifies the goal.
    short : float
        Relative shortfall; 0 if the goal is reached. For a jump it is the missing change of the parameter, nan if no
        change removes the jump.
    share : float
        Share of the tolerance sample that reaches the goal in a trace; nan without a sample.
    curve : Branch
        Response of the new model.
    steps : int
        Number of computations of cusps or peaks.
    status, message : Status and str
        Reason for the end of the search.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.design.redesign(hb.Duffing(), hb.design.peak_below(1.5), ["zeta"], harmonics=3)
    >>> found.reached, round(float(found.curve.amplitude("pp2").max()), 2)
    (True, 1.5)
    """

    model: Model
    values: dict[str, float]
    changes: dict[str, float]
    distance: float
    reached: bool
    short: float
    share: float
    curve: Branch
    steps: int
    status: Status
    message: str

    def __repr__(self) -> str:
        text = ", ".join(f"{name} = {value:.6g} ({self.changes[name]:+.2%})" for name, value in self.values.items())
        return f"<Redesign: {text}; {'goal reached' if self.reached else 'goal not reached'}>"


@checked_arguments(
    goal="a goal, such as no_jumps() or peak_below(0.5)",
    over="names of the parameters that may change, such as ['zeta', 'e_scale']",
    within="bounds by name, such as {'zeta': (0.04, 0.1)}",
    scatter="standard deviations by name, such as {'zeta': 0.002}",
    tolerances="a sample, such as latin_hypercube(20, zeta=('normal', 0, 0.002))",
)
def redesign(
    model: Model | HarmonicBalance,
    goal: Goal,
    over: Sequence[str],
    within: Mapping[str, tuple[float, float]] | None = None,
    *,
    scatter: Mapping[str, float] | None = None,
    sigmas: float = 2.0,
    tolerances: Grid | Sample | None = None,
    share: float = 1.0,
    span: tuple[float, float] | None = None,
    harmonics: int = 16,
    progress: ProgressCallback | None = None,
) -> Redesign:
    """Find the least relative change of some parameters with which a model reaches a goal, and verify it by a trace.

    Parameters
    ----------
    model : Model or HarmonicBalance
        Design to change. A `HarmonicBalance` supplies its settings.
    goal : Goal
        Goal from `no_jumps` or `peak_below`.
    over : sequence of str
        Parameters that may change, all nonzero, also entries of tuples such as ``e[0]``.
    within : mapping of str to tuple, optional
        Bounds of some of these parameters. Default: from 1 % to 11 times the value, within the range of the parameter.
    scatter, sigmas : mapping of str to float and float, optional
        Standard deviations of parameters, and the number of standard deviations (default 2) by which the goal is
        exceeded, to first order.
    tolerances, share : Grid or Sample, and float, optional
        Instead of ``scatter``, a sample of deviations that are added to the values, such as
        ``hb.design.latin_hypercube(20, zeta=("normal", 0, 0.002))``, and the share of it (default 1) that must reach
        the goal.
    span : tuple[float, float] or None, optional
        Span of Omega. Default: the span of the model.
    harmonics : int, default 16
        Harmonic truncation order if a model is given.
    progress : ProgressCallback or None, optional
        Function that is called with a `Progress`, such as ``print``.

    Returns
    -------
    Redesign
        The changed design. If no values within the bounds reach the goal, it is the nearest one found, with
        ``reached`` False and the shortfall in ``short``. Ctrl-C ends the search with the last values; ``status`` and
        ``message`` report this.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If a parameter is zero, bounds do not contain the value of the model, or its curve has no peak in the span.

    References
    ----------
    Nocedal & Wright (2006), Numerical Optimization, ch. 18, https://doi.org/10.1007/978-0-387-40065-5.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.design.redesign(hb.Duffing(), hb.design.no_jumps(), ["zeta", "F"], harmonics=1)
    >>> found.reached, found.curve.jumps(), found.values["zeta"] > 0.05
    (True, (), True)
    """
    problem = model if isinstance(model, HarmonicBalance) else HarmonicBalance(model, harmonics)
    problem.require_fixed_resolution("redesign")
    if goal.parameter:
        problem.check_parameter(goal.parameter)
    names, own, low, high = _bounds(problem, over, within or {})
    spread = _spread(problem, scatter or {}, sigmas, tolerances, share)
    search = _Search(problem, goal, names, own, span or problem.model.default_span, spread, progress)
    ending = Termination()
    u = np.zeros(len(names))
    try:
        u = search.run(u, low, high)
        ending.record_end(Status.REACHED_END, search.message)
    except KeyboardInterrupt as error:
        u = search.last
        ending.record_error(error, f"after {search.steps} steps")
    return _result(search, u, ending)


def _bounds(
    problem: HarmonicBalance, over: Sequence[str], within: Mapping[str, tuple[float, float]]
) -> tuple[tuple[str, ...], Array, Array, Array]:
    """Return names, values of the design and bounds of the relative changes."""
    names = tuple(dict.fromkeys(over))
    if not names:
        raise ValueError("redesign: name at least one parameter that may change, such as over=['zeta']")
    for name in within:
        problem.check_parameter(name)
        if name not in names:
            raise ValueError(f"redesign: {name} is not among the parameters that may change: {', '.join(names)}")
    values, low, high = problem.model.parameters | problem.model.entries, [], []
    for name in names:
        own, ends = values.get(name, 0.0), bounds_of(problem, name, within.get(name), DEFAULT_BOUND_FACTORS, "redesign")
        if not own:
            raise ValueError(
                f"redesign: {name} is 0 in the model, so a relative change is not defined; give it a nonzero value"
            )
        if not ends[0] <= own <= ends[1]:
            raise ValueError(f"redesign: bounds of {name} = {quoted(ends)} must contain its value {own:g}")
        sides = sorted(end / own - 1.0 for end in ends)
        low.append(sides[0])
        high.append(sides[1])
    return names, np.array([values[name] for name in names]), np.array(low), np.array(high)


@dataclass(frozen=True)
class _Spread:
    """Scatter of parameters: standard deviations to first order, or a sample and the required share of it."""

    deviations: dict[str, float]
    sigmas: float
    sample: tuple[dict[str, float], ...]
    share: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters of the sample."""
        return tuple(dict.fromkeys(name for row in self.sample for name in row))


def _spread(
    problem: HarmonicBalance, scatter: Mapping[str, float], sigmas: float, tolerances: Grid | Sample | None,
    share: float,
) -> _Spread:  # fmt: skip
    checked("redesign", "sigmas", sigmas, NOT_NEGATIVE)
    checked("redesign", "share", share, SHARE_RANGE)
    if scatter and tolerances is not None:
        raise ValueError("redesign: give either scatter, for a reserve to first order, or tolerances, a sample")
    for name, deviation in scatter.items():
        problem.check_parameter(name)
        checked("redesign", f"scatter: {name}", deviation, NOT_NEGATIVE)
    for name in () if tolerances is None else tolerances.names:
        problem.check_parameter(name)
        if name == "Omega":
            raise ValueError("redesign: tolerances are of parameters of the model, not of Omega")
    sample = () if tolerances is None else tuple(tolerances.rows())
    return _Spread(dict(scatter), sigmas, sample, share)


@dataclass(frozen=True)
class _Relocated:
    """Cusp or peak with deviations of parameters: value and amplitude with their derivatives by parameter."""

    deviations: dict[str, float]
    value: float
    slopes: dict[str, float]
    amplitude: float
    amplitude_slopes: dict[str, float]

    def moved(self, deviations: Mapping[str, float]) -> _Relocated:
        """Return the cusp or peak with other deviations, to first order."""
        value, amplitude = (
            base + sum(slopes.get(name, 0.0) * x for name, x in deviations.items())
            for base, slopes in ((self.value, self.slopes), (self.amplitude, self.amplitude_slopes))
        )
        return replace(self, deviations=dict(deviations), value=value, amplitude=amplitude)


@dataclass(frozen=True)
class _Cusp:
    """Cusp in a parameter.

    ``side`` is +1 if the jump exists below it, else -1; ``start`` are the relative changes of its design.
    """

    name: str
    side: float
    point: SpecialPoint
    start: Array


_Constraint = tuple[float, dict[str, float]]  # c and its derivatives by parameter


@dataclass(frozen=True)
class _Slack:
    """Values c (S,) of the design and a sample, derivatives (S, A) by the relative changes, and the required c."""

    c: Array
    slopes: Array
    required: float

    @property
    def shortfall(self) -> float:
        """Difference between the required and the smallest c."""
        return self.required - float(self.c.min())

    def kept(self, share: float) -> _Slack:
        """Return the design and a share of the sample, the ones closest to the goal."""
        count = math.ceil(share * (len(self.c) - 1) - 1e-9)
        best = np.append(0, 1 + np.argsort(-self.c[1:], kind="stable")[:count])
        return _Slack(self.c[best], self.slopes[best], self.required)


class _Search:
    """Search with steps to the nearest point of the linearized goal."""

    def __init__(
        self, problem: HarmonicBalance, goal: Goal, names: tuple[str, ...], own: Array, span: tuple[float, float],
        spread: _Spread, progress: ProgressCallback | None,
    ) -> None:  # fmt: skip
        self.problem, self.goal, self.names, self.own, self.span = problem, goal, names, own, span
        self.spread, self.progress = spread, progress
        self.steps = 0
        self.last = np.zeros(len(names))
        self.message = ""
        self.slack = _Slack(np.array([math.nan]), np.zeros((1, len(names))), 0.0)
        self.cusp: _Cusp | None = None

    def values(self, u: Array, deviations: Mapping[str, float] | None = None) -> dict[str, float]:
        """Return the values of the parameters at relative changes, with added deviations."""
        out = {name: float(a * (1.0 + x)) for name, a, x in zip(self.names, self.own, u, strict=True)}
        start = self.problem.model.parameters | self.problem.model.entries
        for name, deviation in (deviations or {}).items():
            out[name] = out.get(name, start[name]) + deviation
        return out

    def balance(self, u: Array, deviations: Mapping[str, float] | None = None) -> HarmonicBalance:
        """Return the problem of the model at relative changes, with added deviations."""
        old = self.problem
        return HarmonicBalance(
            old.model.replace(**self.values(u, deviations)), old.H, old.N, nu=old.nu, sampled=old.is_sampled,
            reduce=old.reduce, orders=old.selection,
        )  # fmt: skip

    def run(self, u: Array, low: Array, high: Array) -> Array:
        """Return relative changes that reach the goal, or the nearest ones within the bounds."""
        for _ in range(MAX_STEPS):
            self.last = u
            slack = self._slack(u)
            if slack is None:
                self.message = "there is no jump to remove" if not u.any() else "the jump vanished during the search"
                return u
            self.slack, self.steps = slack.kept(self.spread.share), self.steps + 1
            if self.progress is not None:
                text = ", ".join(f"{name} = {value:.5g}" for name, value in self.values(u).items())
                self.progress(Progress(math.nan, f"{text}: {-self.slack.shortfall:+.3g}"))
            if not u.any() and self.slack.shortfall <= 0:
                self.message = "the design reaches the goal without a change"
                return u
            new = _least_change(self.slack, u, low, high)
            step = np.clip(new - u, -MAX_RELATIVE_STEP, MAX_RELATIVE_STEP)
            if np.abs(step).max() < STEP_TOLERANCE:
                if self.cusp is None or not (self.cusp.start - u).any():
                    self.message = f"{self.steps} steps"
                    return new
                self.cusp = None  # repeat the search: another cusp may be nearer now
            u = u + step
        self.message = f"no convergence after {MAX_STEPS} steps"
        return u

    def _slack(self, u: Array) -> _Slack | None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ImplausibleInputWarning)  # for values during the search
            return self._of_cusp(u) if self.goal.kind == "no jumps" else self._of_peak(u)

    def _of_cusp(self, u: Array) -> _Slack | None:
        """Return the slack beyond the cusp in a parameter.

        The cusp of the last step is relocated; if this fails, a cusp is searched.
        """
        found = None
        if self.cusp is not None:
            with suppress(NoConvergence, ValueError, np.linalg.LinAlgError):
                found = self._relocated(self.cusp.point, self.cusp.name, self.cusp.start, u)
        cusp = self.cusp
        if cusp is None or found is None:
            self.cusp = cusp = self._find_cusp(u)
            if cusp is None:
                return None
            found = self._relocated(cusp.point, cusp.name, u, u)
        name, own = cusp.name, (self.problem.model.parameters | self.problem.model.entries)[cusp.name]
        value, unit = self.values(u).get(name, own), cusp.side / abs(own)

        def constraint(at: _Relocated) -> _Constraint:
            rates = {name: unit, **{other: -unit * slope for other, slope in at.slopes.items()}}
            return unit * (value + at.deviations.get(name, 0.0) - at.value), rates

        return self._slack_of([constraint(at) for at in found])

    def _find_cusp(self, u: Array) -> _Cusp | None:
        """Return the cusp in the named parameter, or in the first parameter that has one."""
        problem = self.balance(u)
        for name in [self.goal.parameter] if self.goal.parameter else self.names:
            with suppress(NoFoldError, NoConvergence):
                cusp = critical_parameter(problem, name, frequencies=self.span)
                return _Cusp(name, 1.0 if cusp.jump_below else -1.0, cusp.point, u)
        return None

    def _of_peak(self, u: Array) -> _Slack:
        """Return the slack below the limit, relative to it."""
        problem, goal = self.balance(u), self.goal
        curve = raise_if_interrupted(trace(problem, "Omega", self.span, accuracy=None, stability=False, special=False))
        tops = peaks(curve, goal.measure, goal.element, share=0.99, accuracy=None)
        if not tops:
            raise ValueError(f"redesign: {goal.measure} has no peak from Omega = {self.span[0]:g} to {self.span[1]:g}")
        top = max(tops, key=lambda point: point.amplitude(goal.measure, goal.element))
        return self._slack_of([
            (1.0 - at.amplitude / goal.limit, {name: -rate / goal.limit for name, rate in at.amplitude_slopes.items()})
            for at in self._relocated(top, "Omega", u, u)
        ])  # fmt: skip

    def _relocated(self, point: SpecialPoint, parameter: str, start: Array, u: Array) -> list[_Relocated]:
        """Return the special point of the design at u and of each deviation of the sample.

        ``start`` are the relative changes of the design of ``point``. A deviation for which the point is not found has
        its first-order estimate.
        """
        every = (*self.names, *self.spread.deviations, *self.spread.names)
        names = [name for name in dict.fromkeys(every) if name != parameter]
        again, old, new = RelocatedPoint(point, names), self.values(start), self.values(u)
        changes = {name: new[name] - old[name] for name in new}
        first = self._at(again, point, names, changes, {})
        out = [first]
        for deviations in self.spread.sample:
            try:
                out.append(self._at(again, point, names, changes, deviations))
            except (NoConvergence, ValueError, np.linalg.LinAlgError):
                out.append(first.moved(deviations))
        return out

    def _at(
        self, again: RelocatedPoint, point: SpecialPoint, names: Sequence[str], changes: Mapping[str, float],
        deviations: Mapping[str, float],
    ) -> _Relocated:  # fmt: skip
        U, here = again.solved(np.array([changes.get(name, 0.0) + deviations.get(name, 0.0) for name in names]))
        slopes, layout, goal = again.slopes(U, here), point.layout, self.goal
        assert isinstance(layout, Layout)
        X, along = U[None, : layout.width], slopes.X[None, :, : layout.width]
        size = float(layout.measure(goal.measure, X[0], goal.element))
        rates = measured_along(layout, goal.measure, goal.element, X, along)[0] if names else np.zeros(0)
        return _Relocated(
            dict(deviations), float(U[-1]), dict(zip(names, slopes.p.tolist(), strict=True)), size,
            dict(zip(names, rates.tolist(), strict=True)),
        )  # fmt: skip

    def _slack_of(self, found: Sequence[_Constraint]) -> _Slack:
        """Return the slack with derivatives by the relative changes and the reserve for the scatter."""
        rates = found[0][1]
        reserve = self.spread.sigmas * math.sqrt(
            sum((rates[name] * s) ** 2 for name, s in self.spread.deviations.items())
        )
        slopes = np.array([[rates[name] for name in self.names] for _, rates in found]) * self.own
        return _Slack(np.array([c for c, _ in found]), slopes, max(GOAL_MARGIN, self.goal.margin) + reserve)


def _least_change(slack: _Slack, u: Array, low: Array, high: Array) -> Array:
    """Return the least change v with c + c' (v - u) >= required for each c, within the bounds.

    This is the least distance problem of Lawson and Hanson, solved by nonnegative least squares. If no change within
    the bounds suffices, the result maximizes the smallest c.
    """
    from scipy.optimize import lsq_linear

    n = len(u)
    G = np.concatenate([slack.slopes, np.eye(n), -np.eye(n)])
    h = np.concatenate([slack.required - slack.c + slack.slopes @ u, low, -high])
    size = np.linalg.norm(G, axis=1)
    E = np.vstack([G.T, h]) / np.where(size, size, 1.0)
    y = lsq_linear(E, np.append(np.zeros(n), 1.0), (0.0, np.inf), "bvls", tol=1e-15, max_iter=100 * len(h)).x
    r = E @ y - np.append(np.zeros(n), 1.0)
    if -r[n] > 1e-10:
        return np.asarray(np.clip(-r[:n] / r[n], low, high))
    worst = slack.slopes[int(np.argmin(slack.c))]
    return np.where(worst > 0, high, np.where(worst < 0, low, 0.0))


def _result(search: _Search, u: Array, ending: Termination) -> Redesign:
    spread = search.spread
    curve, missed = _traced_shortfall(search, u, {})
    each = [_traced_shortfall(search, u, deviations)[1] for deviations in spread.sample]
    share = float(np.mean([miss == 0 for miss in each])) if each else math.nan
    too_few = bool(each) and share < spread.share - 1e-9
    short = missed
    if too_few:
        short = max(missed, sorted(each)[math.ceil(spread.share * len(each) - 1e-9) - 1])
    reached = curve.status.complete and not missed and not too_few
    if not reached and ending.error is None:
        of = f" in {1 - share:.0%} of the sample" if too_few and not missed else ""
        text = f"{search.message}; the goal is not reached: {_shortfall_text(search, short)}{of}"
        if math.isnan(short):
            text = f"jumps remain, and no value of {', '.join(search.names)} was found at which one vanishes"
        ending.record_end(ending.status, text)
    return Redesign(
        curve.problem.model, search.values(u), dict(zip(search.names, u.tolist(), strict=True)),
        float(np.linalg.norm(u)), reached, short, share, curve, search.steps, ending.status, ending.message_with_advice,
    )  # fmt: skip


def _shortfall_text(search: _Search, short: float) -> str:
    """Return the shortfall as a text."""
    if search.goal.kind != "no jumps":
        return f"the highest peak is {short:.2%} above the limit"
    more = "" if search.cusp is None else f": {search.cusp.name} would have to change by {short:.2%} more"
    return f"jumps remain{more}"


def _traced_shortfall(search: _Search, u: Array, deviations: Mapping[str, float]) -> tuple[Branch, float]:
    """Trace the curve with deviations of parameters; return it and the shortfall, 0 if the goal is reached.

    For a goal with a margin, the curve at this distance toward the cusp must not have jumps either.
    """
    goal = search.goal
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImplausibleInputWarning)
        curve = trace(search.balance(u, deviations), "Omega", search.span, stability=goal.kind == "no jumps")
        if goal.kind != "no jumps":
            top = max(one.amplitude(goal.measure, goal.element).max() for one in (curve, *curve.others))
            return curve, max(0.0, float(top) / goal.limit - 1.0)
        jumps = _jumps(curve)
        if not jumps and goal.margin and search.cusp is not None:
            name = search.cusp.name
            unit = search.cusp.side * abs((search.problem.model.parameters | search.problem.model.entries)[name])
            toward_cusp = {**deviations, name: deviations.get(name, 0.0) - goal.margin * unit}
            jumps = _jumps(trace(search.balance(u, toward_cusp), "Omega", search.span))
    shortfall = search.slack.shortfall  # nan if there is no value at which they vanish
    return curve, (shortfall if math.isnan(shortfall) else max(GOAL_MARGIN, shortfall)) if jumps else 0.0


def _jumps(curve: Branch) -> bool:
    """Return whether there are jumps, or folds that could cause jumps."""
    return any(one.jumps() or any(point.kind == "LP" for point in one.special) for one in (curve, *curve.others))
