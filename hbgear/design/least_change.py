"""Least change of a design that reaches a goal: no jump, or a peak below a limit.

    min_a  sum_i (a_i / a_i0 - 1)^2     with  c(a) >= 0,   low <= a <= high

    no jump:       c = +-(q - q*(a)) / q0 - margin   beyond the cusp q* of the folds of a jump, in a parameter q
    peak below L:  c = 1 - A*(a) / L                     A* at a peak or at an end of the span

c is linearized with the derivatives of cusps and peaks (`hbgear.analysis.parameter_sensitivity`). The nearest point of
the resulting half-spaces is the next iterate, until it converges (`hbgear.design.goal_search`). If no values reach the
goal, the smallest c is maximized. A trace verifies the result.

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
from dataclasses import dataclass

import numpy as np

from hbgear.analysis.fold_curves import problem_of
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import ProgressCallback
from hbgear.common.ranges import NOT_NEGATIVE, Range, checked
from hbgear.common.text.messages import quoted
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination, raise_if_interrupted
from hbgear.continuation.tracing.trace import trace
from hbgear.design.bounds import bounds_of
from hbgear.design.goal_search import GOAL_MARGIN, WITHOUT_CHANGE, Goal, Search, Spread, highest_points
from hbgear.design.studies.samples import Grid, Sample
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model
from hbgear.mechanics.plausibility import ImplausibleInputWarning

DEFAULT_BOUND_FACTORS = (0.01, 11.0)
"""Default bounds of a parameter as multiples of its value."""

SHARE_RANGE = Range(above=0, high=1)
"""Range of the share of a sample that must reach the goal."""


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
        change removes the jump. It is also nan if a trace that verifies the goal stopped early.
    share : float
        Share of the tolerance sample that reaches the goal in a trace; nan without a sample.
    curve : Branch
        Response of the new model.
    steps : int
        Number of computations of cusps or peaks.
    status, message : Status and str
        Reason for the end of the search, or of a trace that verifies the goal and stopped early.

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
        If a parameter is zero, bounds do not contain the value of the model, or its motions grow without bound.

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
    problem = problem_of(model, harmonics)
    problem.require_fixed_resolution("redesign")
    if goal.parameter:
        problem.check_parameter(goal.parameter)
    names, own, low, high = _bounds(problem, over, within or {})
    spread = _spread(problem, scatter or {}, sigmas, tolerances, share)
    search = Search(problem, goal, names, own, span or problem.model.default_span, spread, progress)
    ending, curve = Termination(advice="the best design so far is kept; start again for the whole search"), None
    u = np.zeros(len(names))
    try:
        curve = _curve_without_jumps(search, u)
        if curve is not None:
            search.message = WITHOUT_CHANGE
        else:
            with warnings.catch_warnings(action="ignore", category=ImplausibleInputWarning):  # of values on the way
                u = search.run(u, low, high)
        ending.record_end(Status.REACHED_END, search.message)
    except KeyboardInterrupt as error:
        u = search.last
        ending.record_error(error, f"after {search.steps} steps")
    return _result(search, u, ending, curve)


def _curve_without_jumps(search: Search, u: Array) -> Branch | None:
    """Return the curve of the design if it has no jumps and needs no distance from them, else None.

    A fold may leave the span at the value of a parameter where no cusp exists.
    """
    if search.goal.kind != "no jumps" or search.goal.margin or search.spread.deviations or search.spread.sample:
        return None
    curve, missed = _traced_shortfall(search, u, {})
    raise_if_interrupted(curve)
    return None if missed else curve


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
        value = values.get(name, math.nan)
        if not value:
            raise ValueError(
                f"redesign: {name} is 0 in the model, so its relative change is not defined; start from a model with a "
                f"nonzero {name}"
            )
        ends = bounds_of(problem, name, within.get(name), DEFAULT_BOUND_FACTORS, "redesign")
        if not ends[0] <= value <= ends[1]:
            raise ValueError(f"redesign: bounds of {name} = {quoted(ends)} must contain its value {value:g}")
        changes = sorted(end / value - 1.0 for end in ends)
        low.append(changes[0])
        high.append(changes[1])
    return names, np.array([values[name] for name in names]), np.array(low), np.array(high)


def _spread(
    problem: HarmonicBalance,
    scatter: Mapping[str, float],
    sigmas: float,
    tolerances: Grid | Sample | None,
    share: float,
) -> Spread:
    """Return the checked scatter of the parameters, to first order or as a sample."""
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
    return Spread(dict(scatter), sigmas, sample, share)


def _result(search: Search, u: Array, ending: Termination, known_curve: Branch | None) -> Redesign:
    """Return the result, verified by a trace unless the curve of the design, without jumps, is known."""
    spread, search.stopped = search.spread, None
    curve, missed = _traced_shortfall(search, u, {}) if known_curve is None else (known_curve, 0.0)
    shortfalls = [_traced_shortfall(search, u, deviations)[1] for deviations in spread.sample]
    share = float(np.mean([miss == 0 for miss in shortfalls])) if shortfalls else math.nan
    sample_fails = bool(shortfalls) and share < spread.share - 1e-9
    short = missed
    if sample_fails:  # nan, of traces that stopped early, is the largest
        worst = np.sort(shortfalls)[math.ceil(spread.share * len(shortfalls) - 1e-9) - 1]
        short = float(np.maximum(missed, worst))
    reached = not missed and not sample_fails
    if math.isnan(short) and search.stopped is not None:
        ending.merge(search.stopped, "a trace that verifies the goal")
    elif not reached and ending.error is None:
        extent = f" in {1 - share:.0%} of the sample" if sample_fails and not missed else ""
        text = f"{search.message}; the goal is not reached: {_shortfall_text(search, short)}{extent}"
        if math.isnan(short):
            text = f"jumps remain, and no value of {', '.join(search.names)} was found at which one vanishes"
        ending.record_end(ending.status, text)
    return Redesign(
        curve.problem.model,
        search.values(u),
        dict(zip(search.names, u.tolist(), strict=True)),
        float(np.linalg.norm(u)),
        reached,
        short,
        share,
        curve,
        search.steps,
        ending.status,
        ending.message_with_advice,
    )


def _shortfall_text(search: Search, short: float) -> str:
    """Return the shortfall as a text."""
    if search.goal.kind != "no jumps":
        return "motions grow without bound" if math.isinf(short) else f"the highest peak is {short:.2%} above the limit"
    needed = f": {search.cusps[0].name} would have to change by {short:.2%} more" if search.cusps else ""
    return f"jumps remain{needed}"


def _traced_shortfall(search: Search, u: Array, deviations: Mapping[str, float]) -> tuple[Branch, float]:
    """Trace the curve with deviations of parameters; return it and the shortfall, 0 if the goal is reached.

    For a goal with a margin, the curve at this distance toward the cusps must not have jumps either. The shortfall is
    nan if the traced parts of curves reach the goal and a trace stopped early, `Search.stopped`.
    """
    goal = search.goal
    with warnings.catch_warnings(action="ignore", category=ImplausibleInputWarning):
        balance, stability = search.balance(u, deviations), goal.kind == "no jumps"
        curve = raise_if_interrupted(trace(balance, "Omega", search.span, stability=stability))
        if goal.kind != "no jumps":
            curves = curve.curves
            if any(part.asymptotes for part in curves):
                return curve, math.inf
            tops: list[Branch | Point] = [*curves, *highest_points(curves, goal, search.span)]
            top = max(float(np.max(part.amplitude(goal.measure, goal.element))) for part in tops)
            missed = max(0.0, top / goal.limit - 1.0)
            return curve, missed if missed or _complete(search, curve) else math.nan
        traced = [curve]
        for name, side in {(cusp.name, cusp.side) for cusp in search.cusps} if goal.margin else ():
            if _jumps(traced[-1]):
                break
            unit = side * abs(search.start[name])
            toward_cusp = {**deviations, name: deviations.get(name, 0.0) - goal.margin * unit}
            traced.append(raise_if_interrupted(trace(search.balance(u, toward_cusp), "Omega", search.span)))
    if not any(map(_jumps, traced)):
        return curve, 0.0 if _complete(search, *traced) else math.nan
    shortfall = search.slack.shortfall  # nan if there is no value at which they vanish
    return curve, shortfall if math.isnan(shortfall) else max(GOAL_MARGIN, shortfall)


def _complete(search: Search, *traced: Branch) -> bool:
    """Return whether curves and the other curves of their span are complete; the search keeps one that is not."""
    stopped = [part for curve in traced for part in curve.curves if not part.status.complete]
    search.stopped = search.stopped or next(iter(stopped), None)
    return not stopped


def _jumps(curve: Branch) -> bool:
    """Return whether there are jumps, or folds that could cause jumps."""
    return any(part.jumps() or any(point.kind == "LP" for point in part.special) for part in curve.curves)
