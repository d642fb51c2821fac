"""The least change of a design that reaches a goal: no jump, or a peak below a limit.

    min_a  sum_i (a_i / a_i0 - 1)^2     with  c(a) >= 0,   low <= a <= high

    no jump:       c = +-(q - q*(a)) / q0   beyond the cusp q* where the folds of a jump meet, in one parameter q of a
    peak below L:  c = 1 - A*(a) / L

c is linearised, with the derivatives of cusps and peaks (`hbgear.harmonic.sensitivity`), and the nearest point of the
half-spaces that follow is taken, until it does not move any more. The result is held against a trace.

With a scatter s of parameters, c must be positive by k standard deviations, k (sum_i (dc/da_i s_i)^2)^(1/2).

References
----------
Nocedal & Wright (2006), Numerical Optimization, ch. 18, https://doi.org/10.1007/978-0-387-40065-5.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hbgear.common.arguments import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.messages import quoted
from hbgear.common.progress import Progress, ProgressCallback
from hbgear.common.ranges import NOT_NEGATIVE, POSITIVE, checked
from hbgear.continuation.branch import Branch, Status
from hbgear.continuation.ending import Ending, whole
from hbgear.continuation.newton import NoConvergence
from hbgear.continuation.tracer import trace
from hbgear.harmonic.balance import HarmonicBalance
from hbgear.harmonic.critical import NoFold, critical
from hbgear.harmonic.peaks import peaks
from hbgear.harmonic.sensitivity import sensitivity
from hbgear.mechanics.doubts import Unlikely
from hbgear.mechanics.model import Model

_MARGIN = 1e-3  # by how much c is positive in the end, so that the goal is reached and not only touched

_STEPS = 25

_WIDEST = (-0.99, 10.0)  # relative changes without other bounds

_STILL = 2e-4  # relative change of the parameters at which the search ends

_LONGEST = 0.3  # relative change of a parameter in one step: derivatives do not hold farther


@dataclass(frozen=True)
class Goal:
    """What a design is to reach: see `no_jumps` and `peak_below`.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.peak_below(0.5, "pp2")
    Goal(kind='peak', limit=0.5, measure='pp2', element=0)
    """

    kind: str
    limit: float = math.nan
    measure: str = "pp2"
    element: int | str = 0


def no_jumps() -> Goal:
    """The goal that slow sweeps of the frequency do not jump.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.no_jumps().kind
    'no jumps'
    """
    return Goal("no jumps")


@checked_arguments()
def peak_below(limit: float, measure: str = "pp2", element: int | str = 0) -> Goal:
    """The goal that the highest peak of an amplitude, as of `Branch.amplitude`, is at most a limit.

    Raises
    ------
    ValueError
        If the limit is not positive.

    Examples
    --------
    >>> import hbgear as hb
    >>> hb.peak_below(0.5).limit
    0.5
    """
    checked("peak_below", "limit", limit, POSITIVE)
    return Goal("peak", float(limit), measure, element)


@dataclass(frozen=True, eq=False, repr=False)
class Redesign:
    """The changed design.

    Parameters
    ----------
    model : with the new values.
    values, changes : of the parameters by name, and relative to the old ones.
    distance : root of the sum of squares of the changes.
    reached : whether a trace confirms the goal.
    short : how far the goal is missed, relative (of a jump: the change of a parameter that is still wanting); 0 if it
        is reached.
    curve : the response of the new model.
    steps : how often cusps or peaks were computed.
    status, message : why it ended.

    Examples
    --------
    >>> import hbgear as hb
    >>> found = hb.redesign(hb.Duffing(), hb.peak_below(1.5), ["zeta"], harmonics=3)
    >>> found.reached, round(float(found.curve.amplitude("pp2").max()), 2)
    (True, 1.5)
    """

    model: Model
    values: dict[str, float]
    changes: dict[str, float]
    distance: float
    reached: bool
    short: float
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
)
def redesign(
    model: Model | HarmonicBalance,
    goal: Goal,
    over: Sequence[str],
    within: Mapping[str, tuple[float, float]] | None = None,
    *,
    scatter: Mapping[str, float] | None = None,
    sigmas: float = 2.0,
    span: tuple[float, float] | None = None,
    harmonics: int = 16,
    progress: ProgressCallback | None = None,
) -> Redesign:
    """The least relative change of some parameters with which a model reaches a goal, confirmed by a trace.

    Parameters
    ----------
    model : the design that is to be changed; a `HarmonicBalance` brings its settings.
    goal : `no_jumps` or `peak_below`.
    over : parameters that may change, none of them zero; entries of tuples as ``e[0]``.
    within : bounds of some of them; by default from 99 % less to ten times more, within their ranges.
    scatter, sigmas : standard deviations of parameters, and how many of them the goal is to be reached by, to first
        order.
    span : of Omega; the model's by default.
    harmonics : used if a model is given.
    progress : called with a `Progress` as work goes on, such as ``print``.

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
    >>> found = hb.redesign(hb.Duffing(), hb.no_jumps(), ["zeta", "F"], harmonics=1)
    >>> found.reached, found.curve.jumps(), found.values["zeta"] > 0.05
    (True, (), True)
    """
    problem = model if isinstance(model, HarmonicBalance) else HarmonicBalance(model, harmonics)
    problem.check_fixed("redesign")
    checked("redesign", "sigmas", sigmas, NOT_NEGATIVE)
    names, own, low, high = _bounds(problem, over, within or {})
    spread = _spread(problem, scatter or {})
    search = _Search(problem, goal, names, own, span or problem.model.default_span, spread, sigmas, progress)
    ending = Ending()
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
    values = problem.model.parameters | problem.model.entries
    low, high = [], []
    for name in (*names, *within):
        problem.check_parameter(name)
        if name == "Omega" or name not in names:
            raise ValueError(f"redesign: {name} is not among the parameters that may change: {', '.join(names)}")
    for name in names:
        own, allowed = values[name], problem.range_of(name)
        if not own:
            raise ValueError(f"redesign: {name} is 0 in the model, so its change has no measure; give it a value first")
        far = tuple(allowed.clipped(own + change * abs(own), own) for change in _WIDEST)
        ends = within.get(name, far)
        if not ends[0] <= own <= ends[1] or not ends[0] < ends[1]:
            raise ValueError(f"redesign: bounds of {name} = {quoted(ends)} must rise and hold its value {own:g}")
        sides = sorted((float(end) / own - 1.0) for end in ends)
        low.append(sides[0])
        high.append(sides[1])
    return names, np.array([values[name] for name in names]), np.array(low), np.array(high)


def _spread(problem: HarmonicBalance, scatter: Mapping[str, float]) -> dict[str, float]:
    for name, deviation in scatter.items():
        problem.check_parameter(name)
        checked("redesign", f"scatter: {name}", deviation, NOT_NEGATIVE)
    return dict(scatter)


@dataclass(frozen=True)
class _Slack:
    """c of a goal at some values, and its derivatives in the relative changes; needed is what c must exceed."""

    c: float
    slopes: Array
    needed: float


class _Search:
    """Steps to the nearest point of the linearised goal."""

    def __init__(
        self, problem: HarmonicBalance, goal: Goal, names: tuple[str, ...], own: Array, span: tuple[float, float],
        spread: Mapping[str, float], sigmas: float, progress: ProgressCallback | None,
    ) -> None:  # fmt: skip
        self.problem, self.goal, self.names, self.own, self.span = problem, goal, names, own, span
        self.spread, self.sigmas, self.progress = spread, sigmas, progress
        self.steps = 0
        self.last = np.zeros(len(names))
        self.told = ""
        self.slack = _Slack(math.nan, np.zeros(len(names)), 0.0)

    def values(self, u: Array) -> dict[str, float]:
        """Values of the parameters at relative changes."""
        return {name: float(a * (1.0 + x)) for name, a, x in zip(self.names, self.own, u, strict=True)}

    def balance(self, u: Array) -> HarmonicBalance:
        """The problem of the model at relative changes."""
        old = self.problem
        return HarmonicBalance(
            old.model.replace(**self.values(u)), old.H, old.N, nu=old.nu, sampled=old.is_sampled, reduce=old.reduce
        )

    def run(self, u: Array, low: Array, high: Array) -> Array:
        """Relative changes at which the goal is reached, or as near to it as the bounds allow."""
        for _ in range(_STEPS):
            self.last = u
            slack = self._slack(u)
            if slack is None:
                self.told = "there is no jump to be removed" if not u.any() else "the jump vanished on the way"
                return u
            self.slack, self.steps = slack, self.steps + 1
            if self.progress is not None:
                told = ", ".join(f"{name} = {value:.5g}" for name, value in self.values(u).items())
                self.progress(Progress(math.nan, f"{told}: {slack.c - slack.needed:+.3g}"))
            if not u.any() and slack.c >= slack.needed:
                self.told = "the design reaches the goal as it is"
                return u
            new = _nearest(slack, u, low, high)
            step = np.clip(new - u, -_LONGEST, _LONGEST)
            if np.abs(step).max() < _STILL:
                self.told = f"{self.steps} steps"
                return new
            u = u + step
        self.told = f"the values still move after {_STEPS} steps"
        return u

    def _slack(self, u: Array) -> _Slack | None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Unlikely)  # of values on the way
            return self._of_cusp(u) if self.goal.kind == "no jumps" else self._of_peak(u)

    def _of_cusp(self, u: Array) -> _Slack | None:
        """Beyond the cusp in one of the parameters, which is the one of the last step as long as it has a cusp."""
        problem = self.balance(u)
        for i, name in enumerate(self.names):
            try:
                cusp = critical(problem, name, frequencies=self.span)
            except (NoFold, NoConvergence):
                continue
            others = [other for other in dict.fromkeys((*self.names, *self.spread)) if other != name]
            moved = sensitivity(cusp.point, others).of(name) if others else {}
            side, own = (1.0 if cusp.jump_below else -1.0), self.own[i]
            value = self.values(u)[name]
            rates = {name: side / abs(own), **{k: -side * slope / abs(own) for k, slope in moved.items()}}
            return self._slack_of(side * (value - cusp.value) / abs(own), rates)
        return None

    def _of_peak(self, u: Array) -> _Slack:
        """Below the limit by a share of it."""
        problem, goal = self.balance(u), self.goal
        curve = whole(trace(problem, "Omega", self.span, accuracy=None, stability=False, special=False))
        tops = peaks(curve, goal.measure, goal.element, share=0.99, accuracy=None)
        if not tops:
            raise ValueError(f"redesign: {goal.measure} has no peak from Omega = {self.span[0]:g} to {self.span[1]:g}")
        top = max(tops, key=lambda point: point.amplitude(goal.measure, goal.element))
        found = sensitivity(top, list(dict.fromkeys((*self.names, *self.spread))), element=goal.element)
        rates = {name: -slope / goal.limit for name, slope in found.of(goal.measure).items()}
        return self._slack_of(1.0 - found.size(goal.measure) / goal.limit, rates)

    def _slack_of(self, c: float, rates: Mapping[str, float]) -> _Slack:
        """With derivatives in the relative changes, and the reserve for the scatter."""
        reserve = self.sigmas * math.sqrt(sum((rates[name] * s) ** 2 for name, s in self.spread.items()))
        slopes = np.array([rates[name] for name in self.names]) * self.own
        return _Slack(c, slopes, _MARGIN + reserve)


def _nearest(slack: _Slack, u: Array, low: Array, high: Array) -> Array:
    """The least change with c + c' (v - u) >= needed within the bounds; where there is none, that of the largest c.

    v = t c' clipped to the bounds, with the least t >= 0 that suffices: the solution of this quadratic program.
    """
    g, wanted = slack.slopes, slack.needed - slack.c + float(slack.slopes @ u)

    def at(t: float) -> Array:
        return np.clip(t * g, low, high)

    if wanted <= 0:
        return np.zeros(len(u))
    t = 1.0
    while float(g @ at(t)) < wanted:
        t *= 2.0
        if t > 1e12:
            return at(t)
    from scipy.optimize import brentq

    return at(float(brentq(lambda t: float(g @ at(t)) - wanted, 0.0, t, xtol=1e-14)))


def _result(search: _Search, u: Array, ending: Ending) -> Redesign:
    problem, goal = search.balance(u), search.goal
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Unlikely)
        curve = trace(problem, "Omega", search.span, stability=goal.kind == "no jumps")
    if goal.kind == "no jumps":
        every = (curve, *curve.others)
        missed = any(one.jumps() or any(point.kind == "LP" for point in one.special) for one in every)
        short = max(0.0, search.slack.needed - search.slack.c) if missed else 0.0
    else:
        top = max(one.amplitude(goal.measure, goal.element).max() for one in (curve, *curve.others))
        missed = top > goal.limit
        short = max(0.0, float(top) / goal.limit - 1.0)
    reached = curve.status.complete and not missed
    if not reached and ending.error is None:
        what = "jumps are left" if goal.kind == "no jumps" else f"the highest peak is {short:.2%} above the limit"
        ending.reached(ending.status, f"{search.told}; the goal is not reached: {what}")
    return Redesign(
        problem.model, search.values(u), dict(zip(search.names, u.tolist(), strict=True)), float(np.linalg.norm(u)),
        reached, short, curve, search.steps, ending.status, ending.told,
    )  # fmt: skip
