"""The least change of a design that reaches a goal: no jump, or a peak below a limit.

    min_a  sum_i (a_i / a_i0 - 1)^2     with  c(a) >= 0,   low <= a <= high

    no jump:       c = +-(q - q*(a)) / q0 - margin   beyond the cusp q* where the folds of a jump meet, in a parameter q
    peak below L:  c = 1 - A*(a) / L

c is linearised, with the derivatives of cusps and peaks (`hbgear.analysis.parameter_sensitivity`), and the nearest
point of the
half-spaces that follow is taken, until it does not move any more. The result is held against a trace.

With a scatter s of parameters, c must be positive by k standard deviations, k (sum_i (dc/da_i s_i)^2)^(1/2). With a
sample of deviations there is one c for each of them, the cusp or peak being solved for again, and all must be positive,
or a share of them: of the worst of the others nothing is asked in that step. The result is traced with every deviation.

References
----------
Nocedal & Wright (2006), Numerical Optimization, ch. 18, https://doi.org/10.1007/978-0-387-40065-5.
Lawson & Hanson (1995), Solving Least Squares Problems, ch. 23, https://doi.org/10.1137/1.9781611971217.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from hbgear.analysis.critical_parameters import NoFoldError, critical_parameter
from hbgear.analysis.parameter_sensitivity import Relocation, measured_along
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress, ProgressCallback
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, Range, checked
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch, SpecialPoint, Status
from hbgear.continuation.results.termination import Termination, whole
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.tracing.trace import trace
from hbgear.design.bounds import bounds_of
from hbgear.design.cases.samples import Grid, Sample
from hbgear.harmonic.bifurcations.peaks import peaks
from hbgear.harmonic.equations.layout import Layout, check_measure
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model
from hbgear.mechanics.plausibility import ImplausibleInputWarning

_MARGIN = 1e-3  # by how much c is positive in the end, so that the goal is reached and not only touched

_STEPS = 25

_WIDEST = (0.01, 11.0)  # times a value: bounds without others

_STILL = 2e-4  # relative change of the parameters at which the search ends

_SHARE = Range(above=0, high=1)

_LONGEST = 0.3  # relative change of a parameter in one step: derivatives do not hold farther


@dataclass(frozen=True)
class Goal:
    """What a design is to reach: see `no_jumps` and `peak_below`.

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
    """The goal that slow sweeps of the frequency do not jump, and will not if a parameter changes by so much.

    Parameters
    ----------
    margin : float, default 0.0
        Least distance to the critical value at which the jump appears, in shares of the design's own value.
    parameter : str, default ""
        In which the distance is measured; by default the first of those that may change that has such a value.

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
    """The goal that the highest peak of an amplitude, as of `Branch.amplitude`, is at most a limit.

    Raises
    ------
    ValueError
        If the limit is not positive, or there is no such measure.

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
    """The changed design.

    Parameters
    ----------
    model : Model
        With the new values.
    values, changes : dict of str to float
        Of the parameters by name, and relative to the old ones.
    distance : float
        Root of the sum of squares of the changes.
    reached : bool
        Whether a trace confirms the goal.
    short : float
        How far the goal is missed, relative (of a jump: the change of a parameter that is still wanting, nan if no
        change removes it); 0 if it is reached.
    share : float
        Of the sample of tolerances that reaches the goal, each traced; nan without one.
    curve : Branch
        The response of the new model.
    steps : int
        How often cusps or peaks were computed.
    status, message : Status
        Why it ended.

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
        told = ", ".join(f"{name} = {value:.6g} ({self.changes[name]:+.2%})" for name, value in self.values.items())
        return f"<Redesign: {told}; {'goal reached' if self.reached else 'goal not reached'}>"


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
    """The least relative change of some parameters with which a model reaches a goal, confirmed by a trace.

    Parameters
    ----------
    model : Model or HarmonicBalance
        The design that is to be changed; a `HarmonicBalance` brings its settings.
    goal : Goal
        `no_jumps` or `peak_below`.
    over : sequence of str
        Parameters that may change, none of them zero; entries of tuples as ``e[0]``.
    within : mapping of str, tuple[float to float] or None, optional
        Bounds of some of them; by default from 99 % less to ten times more, within their ranges.
    scatter, sigmas : mapping of str to float or None, optional
        Standard deviations of parameters, and how many of them the goal is to be reached by, to first order.
    tolerances, share : Grid or Sample or None, optional
        Instead, a sample of deviations that are added to the values, such as ``hb.design.latin_hypercube(20,
        zeta=("normal", 0, 0.002))``, and the share of it that is to reach the goal.
    span : tuple[float, float] or None, optional
        Of Omega; the model's by default.
    harmonics : int, default 16
        Used if a model is given.
    progress : ProgressCallback or None, optional
        Called with a `Progress` as work goes on, such as ``print``.

    Returns
    -------
    Redesign
        Where no values within the bounds reach the goal, the nearest ones found, with ``reached`` False and ``short``
        telling how much is wanting. Ctrl-C ends it with the last values; ``status`` and ``message`` say so.

    Raises
    ------
    KeyError
        If the model has no such parameter.
    ValueError
        If a parameter is zero, bounds do not hold the model's own value, or its curve has no peak within the span.

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
        ending.reached(Status.REACHED_END, search.told)
    except KeyboardInterrupt as error:
        u = search.last
        ending.note(error, f"after {search.steps} steps")
    return _result(search, u, ending)


def _bounds(
    problem: HarmonicBalance, over: Sequence[str], within: Mapping[str, tuple[float, float]]
) -> tuple[tuple[str, ...], Array, Array, Array]:
    """Names, own values, and bounds of the relative changes."""
    names = tuple(dict.fromkeys(over))
    if not names:
        raise ValueError("redesign: name at least one parameter that may change, such as over=['zeta']")
    for name in within:
        problem.check_parameter(name)
        if name not in names:
            raise ValueError(f"redesign: {name} is not among the parameters that may change: {', '.join(names)}")
    values, low, high = problem.model.parameters | problem.model.entries, [], []
    for name in names:
        own, ends = values.get(name, 0.0), bounds_of(problem, name, within.get(name), _WIDEST, "redesign")
        if not own:
            raise ValueError(f"redesign: {name} is 0 in the model, so its change has no measure; give it a value first")
        if not ends[0] <= own <= ends[1]:
            raise ValueError(f"redesign: bounds of {name} = {quoted(ends)} must hold its value {own:g}")
        sides = sorted(end / own - 1.0 for end in ends)
        low.append(sides[0])
        high.append(sides[1])
    return names, np.array([values[name] for name in names]), np.array(low), np.array(high)


@dataclass(frozen=True)
class _Spread:
    """What scatters: standard deviations to first order, or a sample of deviations, and what is asked of it."""

    deviations: dict[str, float]
    sigmas: float
    sample: tuple[dict[str, float], ...]
    share: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters of the sample."""
        return tuple(dict.fromkeys(name for row in self.sample for name in row))


def _spread(
    problem: HarmonicBalance, scatter: Mapping[str, float], sigmas: float, tolerances: Grid | Sample | None,
    share: float,
) -> _Spread:  # fmt: skip
    checked("redesign", "sigmas", sigmas, NOT_NEGATIVE)
    checked("redesign", "share", share, _SHARE)
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
    """A cusp or peak with deviations of parameters: place and amplitude, with their derivatives by parameter."""

    deviations: dict[str, float]
    place: float
    slopes: dict[str, float]
    amplitude: float
    grown: dict[str, float]

    def moved(self, deviations: Mapping[str, float]) -> _Relocated:
        """That of other deviations, to first order."""
        place, amplitude = (
            value + sum(slopes.get(name, 0.0) * x for name, x in deviations.items())
            for value, slopes in ((self.place, self.slopes), (self.amplitude, self.grown))
        )
        return replace(self, deviations=dict(deviations), place=place, amplitude=amplitude)


@dataclass(frozen=True)
class _Cusp:
    """A cusp in a parameter: +1 if the jump exists below it, else -1, and the relative changes of its design."""

    name: str
    side: float
    point: SpecialPoint
    start: Array


_One = tuple[float, dict[str, float]]  # c, and its derivatives by parameter


@dataclass(frozen=True)
class _Slack:
    """c (S,) of the design and of a sample about it, derivatives (S, A) in the relative changes, and the least c."""

    c: Array
    slopes: Array
    needed: float

    @property
    def wanting(self) -> float:
        """By how much the worst of them misses."""
        return self.needed - float(self.c.min())

    def kept(self, share: float) -> _Slack:
        """The design, and this share of the sample: those that come nearest to the goal."""
        count = math.ceil(share * (len(self.c) - 1) - 1e-9)
        best = np.append(0, 1 + np.argsort(-self.c[1:], kind="stable")[:count])
        return _Slack(self.c[best], self.slopes[best], self.needed)


class _Search:
    """Steps to the nearest point of the linearised goal."""

    def __init__(
        self, problem: HarmonicBalance, goal: Goal, names: tuple[str, ...], own: Array, span: tuple[float, float],
        spread: _Spread, progress: ProgressCallback | None,
    ) -> None:  # fmt: skip
        self.problem, self.goal, self.names, self.own, self.span = problem, goal, names, own, span
        self.spread, self.progress = spread, progress
        self.steps = 0
        self.last = np.zeros(len(names))
        self.told = ""
        self.slack = _Slack(np.array([math.nan]), np.zeros((1, len(names))), 0.0)
        self.cusp: _Cusp | None = None

    def values(self, u: Array, deviations: Mapping[str, float] | None = None) -> dict[str, float]:
        """Values of the parameters at relative changes, with deviations of these and others."""
        out = {name: float(a * (1.0 + x)) for name, a, x in zip(self.names, self.own, u, strict=True)}
        start = self.problem.model.parameters | self.problem.model.entries
        for name, deviation in (deviations or {}).items():
            out[name] = out.get(name, start[name]) + deviation
        return out

    def balance(self, u: Array, deviations: Mapping[str, float] | None = None) -> HarmonicBalance:
        """The problem of the model at relative changes, with deviations."""
        old = self.problem
        return HarmonicBalance(
            old.model.replace(**self.values(u, deviations)), old.H, old.N, nu=old.nu, sampled=old.is_sampled,
            reduce=old.reduce, orders=old.selection,
        )  # fmt: skip

    def run(self, u: Array, low: Array, high: Array) -> Array:
        """Relative changes at which the goal is reached, or as near to it as the bounds allow."""
        for _ in range(_STEPS):
            self.last = u
            slack = self._slack(u)
            if slack is None:
                self.told = "there is no jump to be removed" if not u.any() else "the jump vanished on the way"
                return u
            self.slack, self.steps = slack.kept(self.spread.share), self.steps + 1
            if self.progress is not None:
                told = ", ".join(f"{name} = {value:.5g}" for name, value in self.values(u).items())
                self.progress(Progress(math.nan, f"{told}: {-self.slack.wanting:+.3g}"))
            if not u.any() and self.slack.wanting <= 0:
                self.told = "the design reaches the goal as it is"
                return u
            new = _nearest(self.slack, u, low, high)
            step = np.clip(new - u, -_LONGEST, _LONGEST)
            if np.abs(step).max() < _STILL:
                if self.cusp is None or not (self.cusp.start - u).any():
                    self.told = f"{self.steps} steps"
                    return new
                self.cusp = None  # sought anew at the end: another one may be nearer by now
            u = u + step
        self.told = f"the values still move after {_STEPS} steps"
        return u

    def _slack(self, u: Array) -> _Slack | None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ImplausibleInputWarning)  # of values on the way
            return self._of_cusp(u) if self.goal.kind == "no jumps" else self._of_peak(u)

    def _of_cusp(self, u: Array) -> _Slack | None:
        """Beyond the cusp in one of the parameters: that of the last step solved for again, or one that is sought."""
        found = None
        if self.cusp is not None:
            with suppress(NoConvergence, ValueError, np.linalg.LinAlgError):
                found = self._relocated(self.cusp.point, self.cusp.name, self.cusp.start, u)
        cusp = self.cusp
        if cusp is None or found is None:
            self.cusp = cusp = self._sought(u)
            if cusp is None:
                return None
            found = self._relocated(cusp.point, cusp.name, u, u)
        name, own = cusp.name, (self.problem.model.parameters | self.problem.model.entries)[cusp.name]
        value, unit = self.values(u).get(name, own), cusp.side / abs(own)

        def told(at: _Relocated) -> _One:
            rates = {name: unit, **{other: -unit * slope for other, slope in at.slopes.items()}}
            return unit * (value + at.deviations.get(name, 0.0) - at.place), rates

        return self._slack_of([told(at) for at in found])

    def _sought(self, u: Array) -> _Cusp | None:
        """The cusp in the first of the parameters that has one, or in that which is named."""
        problem = self.balance(u)
        for name in [self.goal.parameter] if self.goal.parameter else self.names:
            with suppress(NoFoldError, NoConvergence):
                cusp = critical_parameter(problem, name, frequencies=self.span)
                return _Cusp(name, 1.0 if cusp.jump_below else -1.0, cusp.point, u)
        return None

    def _of_peak(self, u: Array) -> _Slack:
        """Below the limit by a share of it."""
        problem, goal = self.balance(u), self.goal
        curve = whole(trace(problem, "Omega", self.span, accuracy=None, stability=False, special=False))
        tops = peaks(curve, goal.measure, goal.element, share=0.99, accuracy=None)
        if not tops:
            raise ValueError(f"redesign: {goal.measure} has no peak from Omega = {self.span[0]:g} to {self.span[1]:g}")
        top = max(tops, key=lambda point: point.amplitude(goal.measure, goal.element))
        return self._slack_of([
            (1.0 - at.amplitude / goal.limit, {name: -slope / goal.limit for name, slope in at.grown.items()})
            for at in self._relocated(top, "Omega", u, u)
        ])  # fmt: skip

    def _relocated(self, point: SpecialPoint, parameter: str, start: Array, u: Array) -> list[_Relocated]:
        """The point of the design at u, and of each of the sample; to first order where it is not found there.

        ``start`` are the relative changes of the design that the point is of.
        """
        every = (*self.names, *self.spread.deviations, *self.spread.names)
        names = [name for name in dict.fromkeys(every) if name != parameter]
        again, old, new = Relocation(point, names), self.values(start), self.values(u)
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
        self, again: Relocation, point: SpecialPoint, names: Sequence[str], changes: Mapping[str, float],
        deviations: Mapping[str, float],
    ) -> _Relocated:  # fmt: skip
        U, here = again.solved(np.array([changes.get(name, 0.0) + deviations.get(name, 0.0) for name in names]))
        slopes, layout, goal = again.slopes(U, here), point.layout, self.goal
        assert isinstance(layout, Layout)
        X, along = U[None, : layout.width], slopes.X[None, :, : layout.width]
        size = float(layout.measure(goal.measure, X[0], goal.element))
        grown = measured_along(layout, goal.measure, goal.element, X, along)[0] if names else np.zeros(0)
        return _Relocated(
            dict(deviations), float(U[-1]), dict(zip(names, slopes.p.tolist(), strict=True)), size,
            dict(zip(names, grown.tolist(), strict=True)),
        )  # fmt: skip

    def _slack_of(self, found: Sequence[_One]) -> _Slack:
        """With derivatives in the relative changes, and the reserve for the scatter."""
        rates = found[0][1]
        reserve = self.spread.sigmas * math.sqrt(
            sum((rates[name] * s) ** 2 for name, s in self.spread.deviations.items())
        )
        slopes = np.array([[rates[name] for name in self.names] for _, rates in found]) * self.own
        return _Slack(np.array([c for c, _ in found]), slopes, max(_MARGIN, self.goal.margin) + reserve)


def _nearest(slack: _Slack, u: Array, low: Array, high: Array) -> Array:
    """The least change v with c + c' (v - u) >= needed of each, within the bounds.

    The problem of least distance of Lawson and Hanson, by least squares without negative numbers. Where no change
    within the bounds suffices, that of the largest c of the worst of all.
    """
    from scipy.optimize import lsq_linear

    n = len(u)
    G = np.concatenate([slack.slopes, np.eye(n), -np.eye(n)])
    h = np.concatenate([slack.needed - slack.c + slack.slopes @ u, low, -high])
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
    curve, missed = _missed_by(search, u, {})
    each = [_missed_by(search, u, deviations)[1] for deviations in spread.sample]
    share = float(np.mean([miss == 0 for miss in each])) if each else math.nan
    few = bool(each) and share < spread.share - 1e-9
    short = missed
    if few:
        short = max(missed, sorted(each)[math.ceil(spread.share * len(each) - 1e-9) - 1])
    reached = curve.status.complete and not missed and not few
    if not reached and ending.error is None:
        of = f" in {1 - share:.0%} of the sample" if few and not missed else ""
        told = f"{search.told}; the goal is not reached: {_what_is_left(search, short)}{of}"
        if math.isnan(short):
            told = f"jumps are left, and no value of {', '.join(search.names)} was found at which one vanishes"
        ending.reached(ending.status, told)
    return Redesign(
        curve.problem.model, search.values(u), dict(zip(search.names, u.tolist(), strict=True)),
        float(np.linalg.norm(u)), reached, short, share, curve, search.steps, ending.status, ending.told,
    )  # fmt: skip


def _what_is_left(search: _Search, short: float) -> str:
    if search.goal.kind != "no jumps":
        return f"the highest peak is {short:.2%} above the limit"
    more = "" if search.cusp is None else f": {search.cusp.name} would have to change by {short:.2%} more"
    return f"jumps are left{more}"


def _missed_by(search: _Search, u: Array, deviations: Mapping[str, float]) -> tuple[Branch, float]:
    """The curve with deviations of parameters, and by how much it misses the goal; 0 if it does not.

    Of a cusp that is to be some way off also the curve that far towards it, which must not have jumps yet either.
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
            nearer = {**deviations, name: deviations.get(name, 0.0) - goal.margin * unit}
            jumps = _jumps(trace(search.balance(u, nearer), "Omega", search.span))
    wanting = search.slack.wanting  # nan if there is no value at which they vanish
    return curve, (wanting if math.isnan(wanting) else max(_MARGIN, wanting)) if jumps else 0.0


def _jumps(curve: Branch) -> bool:
    """Whether there are jumps, or folds that could be some."""
    return any(one.jumps() or any(point.kind == "LP" for point in one.special) for one in (curve, *curve.others))
