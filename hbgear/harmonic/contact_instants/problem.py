"""Periodic motions in contact instants: the second discretisation of models with piecewise-linear laws.

    x_{i+1} = Psi_i x_i + ...,   h(tau_i) = 0          states and phases at the contact instants, see `instants`

There is no truncation: the only tolerance is rounding. Points of a branch hold the exact Fourier coefficients of the
elements up to H, so that measures, files and figures are the same as with `HarmonicBalance`. H has no influence on the
curve.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.lru_cache import LRUCache
from hbgear.common.ranges import counted
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.events.branch_point import BranchPointEvent
from hbgear.continuation.events.detector import events_of
from hbgear.continuation.events.event import Event
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.concatenation import with_asymptotes
from hbgear.continuation.results.point import Point, SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.tracing.coverage import coverage_message, reversed_span_message
from hbgear.continuation.tracing.jumps import find_jumps
from hbgear.continuation.tracing.state import set_up
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.bifurcations.codimension_two import FirstResonanceEvent, SecondResonanceEvent
from hbgear.harmonic.bifurcations.multiplier_events import PeriodDoublingEvent
from hbgear.harmonic.equations.discretization import MAX_COUNT
from hbgear.harmonic.equations.harmonic_selection import tooth_orders
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.instants.corrector import CurveState, Family, jacobian
from hbgear.harmonic.instants.equations import Equations, EquationsAt, NotPiecewiseLinear
from hbgear.harmonic.instants.following import Follower
from hbgear.harmonic.instants.observables import regime_of, reporter
from hbgear.harmonic.instants.pattern import InconsistentPatternError, Pattern
from hbgear.harmonic.instants.refine import ExactMotion, exact_motion_of, solve
from hbgear.harmonic.instants.results import build_exact_branch
from hbgear.harmonic.instants.sampling import coefficients, sample_gaps
from hbgear.harmonic.instants.shooting import SIMULTANEOUS_SWITCHES, Iterate
from hbgear.harmonic.instants.special_points.critical import point_on_curve, relocated
from hbgear.harmonic.instants.special_points.grazing import Grazing
from hbgear.harmonic.instants.special_points.problem import ExactSpecialPointProblem, KnownPoint
from hbgear.harmonic.stability.exact_motion import exact_iterate, iterate_by_stiffness
from hbgear.harmonic.structure.linear_structure import dense
from hbgear.mechanics.models import Model

CONTACT_INSTANTS = "contact instants"
"""Name of this discretisation in the headers of files."""

MAX_REFINEMENT_DISTANCE = 0.3
"""Distance of an exact motion from given coefficients, relative to them, beyond which it is another motion."""

NEIGHBOURS = 3
"""Number of known points from which Newton's method starts."""


RELOCATED_KINDS = ("LP", "PD", "NS")
"""Kinds of special points that are located again along a curve of other equations."""

SAME_PLACE = 1e-9
"""Relative distance of a special point from its place in a file, up to which it is the same one."""

SHORTEST_RESOLVED_CONTACT = 3.0
"""Duration of a contact [rad] times the number of harmonics from which derivatives in all parameters agree with the
exact motion to 1e-3; with 1.2 one of them was 13 percent off, although the fold itself agreed to 1e-6."""


class KnownStates(NamedTuple):
    """Points of a branch in a parameter, the others fixed: values (P,), coefficients (P, n), states.

    contacts : contacts that graze, by the number of the point.
    """

    name: str
    fixed: dict[str, float]
    values: Array
    X: Array
    states: list[CurveState]
    contacts: dict[int, tuple[Grazing, ...]]


class ExactStart(NamedTuple):
    """First state of a branch and the direction in which it leaves, in the unknowns of the state."""

    state: CurveState
    direction: Array


class ExactPeriodDoubling(PeriodDoublingEvent):
    """Period doubling of exact motions: the branch of twice the period is traced in contact instants as well."""

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> tuple[Any, BranchStart]:
        """Return the problem of twice the period and the start at the point; both sides are the same motion."""
        problem = point.problem or branch.require_problem()
        doubled = problem.with_order(2 * problem.nu, 2 * problem.H)
        single = problem.exact_state(point.X, branch.parameter, point.parameters)
        fixed = {name: value for name, value in point.parameters.items() if name != branch.parameter}
        state, direction = _doubled_state(single, math.tau * problem.nu, doubled.family(branch.parameter, fixed))
        return doubled, _branch_start(doubled, point, ExactStart(state, side * direction))


class ExactBranchPoint(BranchPointEvent):
    """Branch point of exact motions: the other branch is traced in contact instants as well."""

    def branch_direction(self, branch: Branch, point: SpecialPoint, side: int) -> tuple[Any, BranchStart]:
        """Return the problem, and the start of the branch that crosses the traced curve."""
        problem, i, name = point.problem or branch.require_problem(), point.index, branch.parameter
        state = _state_near(problem, branch, i)
        fixed = {key: value for key, value in point.parameters.items() if key != name}
        family, scale = problem.family(name, fixed), state.scale(float(np.ptp(branch.values)) or 1.0)
        null = np.linalg.svd(jacobian(family, state)[1] * scale)[2][-2:]
        changes = np.array([_change_of_gaps(family, state, direction * scale, problem.H) for direction in null])
        before, after = max(i - 1, 0), min(i + 1, len(branch) - 1)
        along_curve = np.linalg.lstsq(changes.T, branch.X[after] - branch.X[before])[0]
        along_curve = along_curve / np.linalg.norm(along_curve)
        transverse = np.array([-along_curve[1], along_curve[0]]) @ null
        return problem, _branch_start(problem, point, ExactStart(state, side * transverse * scale))


def _state_near(problem: Any, branch: Branch, i: int) -> CurveState:
    """Return the state of a branch point, where Newton's method does not converge, or of a point next to it."""
    states = problem.nearest_states(branch.X[i], branch.parameters_at(i))
    if states:
        return cast(CurveState, states[0])
    for k in (i, max(i - 1, 0), min(i + 1, len(branch) - 1)):
        with suppress(NoConvergence):
            return cast(CurveState, problem.exact_state(branch.X[k], branch.parameter, branch.parameters_at(k)))
    raise NoConvergence("no exact motion was found at the branch point", branch.X[i], branch.parameters_at(i), [])


def _change_of_gaps(family: Family, state: CurveState, direction: Array, H: int) -> Array:
    """Return the derivatives of the coefficients of all gaps in a direction of the state."""
    rows = []
    for sign in (1, -1):
        shifted = state.with_z(state.z + sign * DIFFERENCE * direction)
        rows.append(coefficients(family(shifted.value), shifted.iterate, H)[0].ravel())
    out: Array = (rows[0] - rows[1]) / (2 * DIFFERENCE)
    return out


DIFFERENCE = 1e-5
"""Step in scaled unknowns of the derivatives of coefficients, which select one of two directions."""


def _branch_start(problem: Any, point: SpecialPoint, start: ExactStart) -> BranchStart:
    """Return a start of a problem that follows curves itself: it has no coefficients and no direction of them."""
    X = np.zeros(problem.size)
    return BranchStart(X, dict(point.parameters), np.append(X, 0.0), event=start)


def _doubled_state(single: CurveState, period: float, family: Family) -> ExactStart:
    """Return a motion over two periods, and the null vector that a shift by one period reverses."""
    iterate = single.iterate
    pattern = Pattern(iterate.pattern.switches * 2, iterate.pattern.contacts * 2)
    doubled = Iterate(pattern, np.concatenate([iterate.tau, iterate.tau + period]), np.concatenate([iterate.x] * 2))
    state = CurveState.of(doubled, single.value)
    J, scale = jacobian(family, state)[1], state.scale(1.0)
    n, free = iterate.x.size, len(single.z) - 1 - iterate.x.size
    blocks = [np.r_[0:n, 2 * n : 2 * n + free], np.r_[n : 2 * n, 2 * n + free : 2 * n + 2 * free]]
    antisymmetric = np.zeros((len(state.z), n + free))
    antisymmetric[blocks[0], range(n + free)], antisymmetric[blocks[1], range(n + free)] = 1.0, -1.0
    null = np.linalg.svd((J * scale) @ antisymmetric)[2][-1]
    return ExactStart(state, (antisymmetric @ null) * scale)


class ContactInstants(HarmonicBalance):
    """Periodic motions of a model with piecewise-linear laws in contact instants: a problem for `trace`.

    Unknowns are the phases of all contacts and the states there; between them the flow is linear. The motion has no
    truncation error, curves pass every grazing point, and multipliers are products of the flows. It is no time
    integration: there is no time step and no transient. Use it for hard stops and short contacts, which need many
    harmonics; `HarmonicBalance` is faster for soft contacts, many contacts in a period and structures with many modes.

    Parameters
    ----------
    model : Model
        A model whose laws are piecewise linear, with at most 60 coordinates.
    harmonics : int, optional
        H, number of harmonics of the results, 16 by default, and at least the base orders of the excitation. The curve
        does not depend on it; ``Branch.error`` is the rms of the harmonics that the results leave out.
    nu : int, optional
        Subharmonic order, 1 by default.

    Raises
    ------
    NotPiecewiseLinear
        A ValueError, if a law is not piecewise linear or the structure is too large.

    Notes
    -----
    ``evaluate(X, ...)`` returns X minus the coefficients of the exact motion near X, with the unit matrix as its
    derivative, so that Newton's method returns an exact motion.

    References
    ----------
    Stoer & Bulirsch, Introduction to Numerical Analysis (2002), section 7.3, https://doi.org/10.1007/978-0-387-21738-3.

    Examples
    --------
    >>> import hbgear as hb
    >>> stop = hb.Element([1.0], hb.Unilateral(k=1e3, gap=0.5))
    >>> model = hb.System([[1.0]], [[0.1]], [[1.0]], [stop], hb.Load(cosine={1: [0.3]}))
    >>> curve = hb.trace(hb.ContactInstants(model), "Omega", (1.4, 1.25))
    >>> curve["GR1"].kind, round(curve["GR1"].parameters["Omega"], 6)
    ('GR', 1.259615)
    """

    known_states: KnownStates | None = None
    """Points of the branch to which the problem belongs."""

    @checked_arguments()
    def __init__(self, model: Model, harmonics: int = 16, nu: int = 1) -> None:
        super().__init__(model, harmonics=_sufficient(harmonics, model, nu), nu=nu, orders="all")
        self.compiled({}).contact_equations  # noqa: B018  raises NotPiecewiseLinear

    def __repr__(self) -> str:
        return f"ContactInstants({self.model!r}, harmonics={self.H}, nu={self.nu})"

    def describe(self) -> dict[str, Any]:
        """Return model and settings as plain data, for the header of a saved branch."""
        return {**super().describe(), "discretisation": CONTACT_INSTANTS}

    def with_order(self, nu: int, harmonics: int | None = None) -> ContactInstants:
        """Return the problem with another subharmonic order or number of harmonics.

        Points of a branch remain known if the order is the same.
        """
        out = super().with_order(nu, harmonics)
        assert isinstance(out, ContactInstants)
        known, out.known_states = self.known_states, None
        if known is not None and nu == self.nu:
            family = self.family(known.name, known.fixed)
            X = [coefficients(family(state.value), state.iterate, out.H)[0].ravel() for state in known.states]
            out.known_states = known._replace(X=np.array(X))
        return out

    # ---- equations

    def exact_motion(self, X: Array, **parameters: float) -> ExactMotion:
        """Return the exact motion near coefficients X: contact instants, states and multipliers.

        Raises
        ------
        NoConvergence
            If there is no motion near X.
        """
        ode, iterate = self._exact_iterate(X, parameters)
        return exact_motion_of(ode, iterate, sample_gaps(ode, iterate)[0], 0.0)

    def multipliers(
        self, X: Array, points: int | None = None, width: float | None = None, **parameters: float
    ) -> ComplexArray:
        """Return the multipliers of the exact motion near X, largest first; ``points`` and ``width`` have no effect."""
        return self.exact_motion(X, **parameters).multipliers

    def _exact_iterate(self, X: Array, parameters: Mapping[str, float]) -> tuple[EquationsAt, Iterate]:
        """Return the equations at the parameters, and the contact instants of the exact motion near X."""
        equations = self.compiled(dict(parameters)).contact_equations
        return equations.at(float(parameters["Omega"])), self.exact_state(X, "Omega", parameters).iterate

    def exact_state(self, X: Array, name: str, parameters: Mapping[str, float]) -> CurveState:
        """Return the exact motion near coefficients X as the state of a curve in a parameter.

        Newton's method starts from the nearest points of the branch of this problem, if it has one, whose short
        contacts are not visible in X; else from the switching times of X.
        """
        equations = self.compiled(dict(parameters)).contact_equations
        ode = equations.at(float(parameters["Omega"]))
        for state in self.nearest_states(X, parameters):
            with suppress(NoConvergence, InconsistentPatternError):
                iterate = solve(ode, state.iterate, False)[1]
                if float(np.linalg.norm(coefficients(ode, iterate, self.H)[0].ravel() - X)) <= (
                    MAX_REFINEMENT_DISTANCE * (float(np.linalg.norm(X)) or 1.0)
                ):
                    return CurveState.of(iterate, float(parameters[name]))
        try:
            iterate = exact_iterate(self, X, parameters)[1]
        except InconsistentPatternError as error:
            raise NoConvergence(f"no exact motion found: {error}", X, dict(parameters), []) from error
        return CurveState.of(iterate, float(parameters[name]))

    @property
    def known_parameter(self) -> str:
        """Name of the parameter of the known points; empty without them."""
        return self.known_states.name if self.known_states is not None else ""

    def nearest_states(self, X: Array, parameters: Mapping[str, float]) -> list[CurveState]:
        """Return the states of the known points nearest to coefficients X; none at other fixed parameters."""
        known = self.known_states
        if known is None or {k: v for k, v in parameters.items() if k != known.name} != known.fixed:
            return []
        distance = np.linalg.norm(known.X - X, axis=1) / (float(np.linalg.norm(X)) or 1.0)
        distance = distance + np.abs(known.values - parameters[known.name]) / float(np.ptp(known.values) or 1.0)
        return [known.states[i] for i in np.argsort(distance, kind="stable")[:NEIGHBOURS]]

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return X minus the coefficients of the exact motion near X, and the unit matrix."""
        exact = coefficients(*self._exact_iterate(X, parameters), self.H)[0].ravel()
        return Evaluation(X - exact, np.eye(len(X)), np.zeros(len(X)), 1.0 + float(np.linalg.norm(X)))

    def start(self, Omega: float, **parameters: float) -> Array:  # type: ignore[override]
        """Return the coefficients of an exact motion at Omega, near a solution of the harmonic balance."""
        X = self.balance.start(Omega=Omega, **parameters)
        return X - self.linearise(X, "", **{**parameters, "Omega": Omega}).R

    @property
    def balance(self) -> HarmonicBalance:
        """The harmonic balance of the same model with the same number of harmonics."""
        return HarmonicBalance(self.model, self.H, nu=self.nu, orders="all")

    @property
    def residual_form(self) -> HarmonicBalance:
        """The harmonic balance: special points are followed and differentiated with H harmonics."""
        return self.balance

    def in_residual_form(self, point: Point, form: HarmonicBalance) -> Array:
        """Return the coefficients of the exact motion with the harmonics of a balance.

        Raises
        ------
        NoConvergence
            If the shortest contact of the motion is too short for the harmonics.
        """
        state = _state_of(self, point)
        if state is None:
            return form.from_point(point)
        ode = self.compiled(dict(point.parameters)).contact_equations.at(float(point.parameters["Omega"]))
        visits = state.pattern.visits
        shortest = float(state.iterate.visit_durations(visits, ode.period).min()) if visits else math.inf
        if shortest * form.H < SHORTEST_RESOLVED_CONTACT * form.nu:
            raise NoConvergence(f"a contact of {shortest:.2g} rad needs more harmonics", point.X, {}, [])
        return coefficients(ode, state.iterate, form.H)[0].ravel()

    def compiled_continuation(self, name: str, parameters: Mapping[str, float]) -> None:
        """Return None: curves are followed by `own_trace`."""

    def compiled_locator(self, name: str, parameters: Mapping[str, float], which: int) -> None:
        """Return None: special points are located by `own_trace`."""

    @property
    def refined_problem(self) -> None:
        """None: exact motions have no resolution."""

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """Return multipliers, regime, instants and rms of the harmonics above H of the exact motion near X."""
        ode, iterate = self._exact_iterate(X, parameters)
        exact = exact_motion_of(ode, iterate, sample_gaps(ode, iterate)[0], 0.0)
        regime, error = regime_of(iterate.pattern, ode.equations.m), coefficients(ode, iterate, self.H)[1]
        observed: dict[str, Any] = {"regime": regime, "instants": exact.instants, "error": error}
        return observed | ({"multipliers": exact.multipliers} if stability else {})

    def observe_many(
        self, X: Array, name: str, values: Array, stability: bool = True, **parameters: float
    ) -> list[dict[str, Any]]:
        """Return `observe` of solutions X (k, n) at values (k,) of a parameter, one after the other."""
        return ContinuationProblem.observe_many(self, X, name, values, stability, **parameters)

    def check_errors(self, *_: Any) -> None:
        """Do nothing: exact motions have no resolution."""

    def events(self, parameter: str) -> tuple[Event, ...]:
        """Return the events of periodic motions; branches that leave are curves in contact instants."""
        inherited = (event for event in super().events(parameter) if event.kind not in ("PD", "BP"))
        return ExactPeriodDoubling(), ExactBranchPoint(), *inherited

    def special_point_equations(self, parameter: str, point: Point, branch: Branch | None = None) -> Any:
        """Return the problem of a special point LP, PD, NS or GR whose exact motion is known, or traced again."""
        return exact_or_traced_again(self, parameter, point, branch)

    # ---- curves

    def family(self, name: str, fixed: Mapping[str, float]) -> Family:
        """Return the equations as a function of a parameter, the others fixed."""
        if name == "Omega":
            return _stored(Equations(self.model_at(fixed).system(), self.nu).at, name)

        def equations_at(value: float) -> EquationsAt:
            model = self.model_at({**fixed, name: value})
            return Equations(model.system(), self.nu).at(float(fixed["Omega"]))

        return _stored(equations_at, name)

    def own_trace(
        self, span: tuple[float, float], start: Point | BranchStart | Array | None, settings: Any, cover: bool,
        unresolved: bool = False,
    ) -> Branch:  # fmt: skip
        """Return the curve of exact motions over a span of a parameter; see `hbgear.harmonic.instants.following`.

        With ``cover``, a curve that turns back to its start is followed from the other end as well, and a curve without
        a first solution from there only.

        Raises
        ------
        ValueError
            If the trace asks for events that are not located on these curves.
        """
        if missing := _other_events(settings):
            raise ValueError(
                f"curves in contact instants have no {', '.join(missing)}: use hb.analysis.peaks(curve) for peaks, or "
                "trace a HarmonicBalance"
            )
        covers = cover and start is None
        branch, first = self._first_curve(span, start, settings, covers)
        if not covers:
            return branch
        other_curves: tuple[Branch, ...] = ()
        if branch.status in (Status.LEFT_SPAN, Status.UNBOUNDED) and first == span:
            with suppress(NoConvergence):
                other_curves = (self._first_curve(span[::-1], None, settings, False)[0],)
        no_start = "" if first == span else reversed_span_message(settings.parameter, span[0])
        messages = branch.message, no_start, coverage_message(branch, other_curves, span)
        return replace(branch, others=other_curves, message="; ".join(message for message in messages if message))

    def _first_curve(
        self, span: tuple[float, float], start: Any, settings: Any, either_end: bool
    ) -> tuple[Branch, tuple[float, float]]:
        """Return a curve and its span: from either end if ``either_end``, else from a motion of softer contacts."""
        failure: NoConvergence | None = None
        for softer in (False,) if start is not None else (False, True):
            for ends in (span, span[::-1]) if either_end else (span,):
                try:
                    return self._traced_curve(ends, start, settings, softer), ends
                except NoConvergence as error:
                    failure = failure or error
        assert failure is not None
        raise failure

    def _traced_curve(self, span: tuple[float, float], start: Any, settings: Any, softer: bool = False) -> Branch:
        """Return one curve of exact motions, with its jumps; ``softer``: its first motion by softer contacts."""
        setup = set_up(self, settings, span, start, work=Work(math.inf))
        state, direction = self._first_state(setup, start, softer)
        ends = setup.span.start, setup.span.end
        kinds = LOCATED_KINDS if settings.special else tuple(event.kind for event in settings.events)
        follower = Follower(
            self.family(setup.name, setup.fixed), setup.name, ends, settings.steps.max_points, bool(kinds),
            reporter(settings.progress, setup.name, span),
        )  # fmt: skip
        curve = follower.run(state, direction)
        events = {event.kind: event for event in events_of(self, setup.name)}
        branch = build_exact_branch(
            self, follower.family, setup.name, setup.fixed, curve, events, settings.header(*ends), settings.stability
        )
        problem = copy.copy(self)
        states = [point.state for point in curve.points]
        contacts = {mark.index: mark.contacts for mark in curve.marks if mark.contacts}
        problem.known_states = KnownStates(setup.name, dict(setup.fixed), branch.values, branch.X, states, contacts)
        special = tuple(replace(point, problem=problem) for point in branch.special if point.kind in kinds)
        meta = with_asymptotes(branch.meta, last=curve.asymptote)
        branch = replace(branch, problem=problem, special=special, meta=meta)
        return replace(branch, jump_records=find_jumps(branch, settings.newton)) if settings.special else branch

    def _first_state(self, setup: Any, start: Any, softer: bool) -> tuple[CurveState, Array | None]:
        """Return the first state of a curve, and its direction if the start gives one."""
        name = setup.name
        value = (
            float(start.parameters.get(name, setup.span.start)) if hasattr(start, "parameters") else setup.span.start
        )
        parameters = setup.parameters_at(value)
        if start is None:
            return _initial_state(self, name, parameters, softer), None
        X = self.from_point(start) if isinstance(start, Point) else np.asarray(getattr(start, "X", start))
        if isinstance(start, BranchStart) and isinstance(start.event, ExactStart):
            return start.event
        return self.exact_state(self.resized(X), name, parameters), None


def _sufficient(harmonics: int, model: Model, nu: int) -> int:
    """Return the number of harmonics, or the largest base order of the excitation if it is higher."""
    counted("harmonics", harmonics, MAX_COUNT)
    counted("nu", nu, MAX_COUNT)
    return max(int(harmonics), int(nu) * max(tooth_orders(model.system())))


def _initial_state(problem: ContactInstants, name: str, parameters: Mapping[str, float], softer: bool) -> CurveState:
    """Return an exact motion found by the balance, or by the balance of ``softer`` contacts."""
    H = min(problem.H, _sufficient(START_HARMONICS, problem.model, problem.nu))
    if softer:
        balance = partial(HarmonicBalance, harmonics=H, nu=problem.nu, orders="all")
        system, Omega = problem.compiled(dict(parameters)).system, float(parameters["Omega"])
        return CurveState.of(iterate_by_stiffness(balance, system, problem.nu, Omega), float(parameters[name]))
    coarse = problem.with_order(problem.nu, H)
    return coarse.exact_state(coarse.balance.start(**parameters), name, parameters)


def special_state(problem: ContactInstants, point: SpecialPoint) -> CurveState:
    """Return the state of a fold, period doubling or Neimark-Sacker point of a curve.

    A curve from a file does not have its states. There the exact motion nearest to the point is computed with a
    free Omega, and the special point is located along the curve.

    Raises
    ------
    NoConvergence
        If the motion is not found at the place of the point, as with contacts that its harmonics do not show.
    """
    states = problem.nearest_states(point.X, point.parameters)
    if states:
        return states[0]
    name = list(point.parameters)[-1]
    value = float(point.parameters[name])
    try:
        ode, iterate = exact_iterate(problem, point.X, point.parameters, name == "Omega")
    except InconsistentPatternError as error:
        raise NoConvergence(str(error), point.X, dict(point.parameters), []) from error
    state = CurveState.of(iterate, ode.Omega if name == "Omega" else value)
    family = problem.family(name, {key: x for key, x in point.parameters.items() if key != name})
    point_nearby = point_on_curve(family, state, state.scale(abs(value) or 1.0))
    special = relocated(family, point_nearby, point.kind, reach=0.2).state
    if abs(special.value - value) > SAME_PLACE * abs(value):
        raise NoConvergence(f"no exact motion found at {point.label}", point.X, dict(point.parameters), [])
    return special


def exact_special_point(problem: ContactInstants, parameter: str, point: Point) -> ExactSpecialPointProblem | None:
    """Return the problem of a special point whose exact motion is known, with a curve in a second parameter.

    None is returned for structures with many coordinates, which take seconds a point, and for contacts of a symmetric
    machine that switch at the same instant, where the equations are nearly singular: there harmonics are better.
    """
    if not isinstance(point, SpecialPoint) or point.kind not in (*RELOCATED_KINDS, "GR"):
        return None
    contacts = grazing_contacts(problem, point) if point.kind == "GR" else ()
    if problem.compiled({}).system.n > MAX_HARD_COORDINATES or (point.kind == "GR" and len(contacts) != 1):
        return None
    try:
        states = problem.nearest_states(point.X, point.parameters) if contacts else [special_state(problem, point)]
    except NoConvergence:
        return None
    period = math.tau * problem.nu
    if np.abs(states[0].iterate.durations(period)).min() < SIMULTANEOUS_SWITCHES * period:
        return None
    known_point = KnownPoint(states[0], dict(point.parameters), contacts[0] if contacts else None)
    resonances = FirstResonanceEvent(), SecondResonanceEvent()
    return ExactSpecialPointProblem(problem, parameter, point.kind, known_point, resonances)


def exact_or_traced_again(
    problem: ContactInstants, parameter: str, point: Point, branch: Branch | None
) -> ExactSpecialPointProblem | None:
    """Return `exact_special_point`; for a point of a curve from a file, also on the same curve traced again.

    The file has the harmonics of each motion, which do not show short contacts.
    """
    exact = exact_special_point(problem, parameter, point)
    span = branch.meta.get("trace", {}).get("span") if branch is not None else None
    is_large = problem.compiled({}).system.n > MAX_HARD_COORDINATES
    if exact is not None or branch is None or span is None or problem.known_states is not None or is_large:
        return exact
    value = point.parameters[parameter]
    with suppress(NoConvergence, ValueError):
        curve = trace(problem, parameter, tuple(span), at=dict(branch.fixed), stability=False)
        for special in (candidate for part in curve.curves for candidate in part.special):
            is_same = abs(special.parameters[parameter] - value) <= SAME_PLACE * abs(value)
            if is_same and special.kind == getattr(point, "kind", ""):
                return exact_special_point(special.problem, parameter, special)
    return None


def grazing_contacts(problem: ContactInstants, point: SpecialPoint) -> tuple[Grazing, ...]:
    """Return the contacts that graze at a point of the curve of a problem; empty for a curve from a file."""
    known, states = problem.known_states, problem.nearest_states(point.X, point.parameters)
    if known is None or not states:
        return ()
    return next((known.contacts.get(i, ()) for i, state in enumerate(known.states) if state is states[0]), ())


def _state_of(problem: ContactInstants, point: Point) -> CurveState | None:
    """Return the exact motion of a point as the state of a curve; None if it is not found and not required."""
    if isinstance(point, SpecialPoint) and point.kind in RELOCATED_KINDS:
        return special_state(problem, point)
    states = problem.nearest_states(point.X, point.parameters)
    with suppress(NoConvergence):
        return states[0] if states else problem.exact_state(point.X, "Omega", point.parameters)
    return None


START_HARMONICS = 32
"""Most harmonics of the balance whose motion is the first guess: with 128 the search takes a minute for a hard stop."""

_STORED_VALUES = 16
"""Values of the parameter whose equations are stored: a corrector, its differences and a grazing use a few in turn."""


def _stored(make: Callable[[float], EquationsAt], name: str) -> Family:
    """Return the function of a parameter with its last results; a value that the model refuses ends an iteration."""
    cache = LRUCache[EquationsAt](_STORED_VALUES)

    def equations_at(value: float) -> EquationsAt:
        try:
            return cache.get(value, lambda: make(value))
        except ValueError as error:
            raise NoConvergence(str(error), np.empty(0), {name: value}, []) from error

    return equations_at


UNRESOLVED_CONTACT = 2.0
"""Frequency of the closed contact, over the highest harmonic at the lowest Omega, from which it is not resolved."""

HARD_STOP_RATIO = 10.0
"""Frequency of the closed contact over the highest Omega from which stops are hard. It is 14 for a stop of a thousand
times the stiffness of the mass; below it, few harmonics are the choice of the user."""


def trace_hard_stops(
    balance: HarmonicBalance, span: tuple[float, float], start: Any, settings: Any, cover: bool, unresolved: bool
) -> Branch | None:
    """Return the curve of a harmonic balance in contact instants if its harmonics do not resolve the contacts.

        w = max sqrt(eig(M^-1 (K + W k W^T))),   w > 2 H Omega_low / nu,   w > 10 Omega_high

    k is the reference stiffness of the laws. Contacts then take less than a quarter of the period of the highest
    harmonic, and less than a twentieth of the period of the excitation. If a trace has shown that the harmonics do not
    resolve the curve (``unresolved``), contacts of constant stiffness are sufficient, and the curve must reach the end
    of the span. None is returned for other models, and if the curve cannot be completed in contact instants.
    """
    if settings.parameter != "Omega" or start is not None or balance.auto or balance.selection or balance.is_sampled:
        return None
    if _other_events(settings):
        return None
    system = balance.compiled({}).system
    if system.n > MAX_HARD_COORDINATES or any(e.law.piecewise is None for e in system.elements):
        return None
    fastest = _contact_frequency(system)
    lowest, highest = min(map(abs, span)), max(map(abs, span))
    hard = fastest > UNRESOLVED_CONTACT * balance.H * lowest / balance.nu and fastest > HARD_STOP_RATIO * highest
    constant = not any(law.stiffness.varies for e in system.elements for law in e.law.piecewise or ())
    if not (hard or (unresolved and fastest and constant)):
        return None
    try:
        exact = ContactInstants(balance.model, balance.H, nu=balance.nu)
        branch = exact.own_trace(span, start, settings, cover)
    except (NotPiecewiseLinear, NoConvergence, InconsistentPatternError):
        return None
    if not branch.status.complete or (unresolved and branch.status is not Status.REACHED_END):
        return None
    ratio = fastest / min(map(abs, span))
    text = f"traced in contact instants, because H = {balance.H} does not resolve contacts of {ratio:.3g} Omega"
    return replace(branch, message=f"{branch.message}; {text}")


LOCATED_KINDS = ("LP", "BP", "PD", "NS", "GR", "EP")
"""Special points of curves in contact instants."""


def _other_events(settings: Any) -> list[str]:
    """Return the kinds of events that a trace asks for and that are not located in contact instants."""
    return [event.kind for event in settings.events if event.kind not in LOCATED_KINDS]


def _contact_frequency(system: Any) -> float:
    """Return the highest natural frequency with closed contacts; 0 if contacts do not raise it."""
    if system.receptances is not None or system.massless:
        return 0.0
    M, K = dense(system.M), dense(system.K)
    k = np.array([e.law.reference for e in system.elements])
    closed = np.abs(np.linalg.eigvals(np.linalg.solve(M, K + (system.W * k) @ system.W.T))).max()
    opened = np.abs(np.linalg.eigvals(np.linalg.solve(M, K))).max()
    return float(np.sqrt(closed)) if closed > 4 * opened else 0.0


MAX_HARD_COORDINATES = 10
"""Coordinates up to which hard stops are traced in contact instants without a request: some seconds at most."""
