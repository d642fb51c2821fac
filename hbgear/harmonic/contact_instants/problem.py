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
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array, ComplexArray
from hbgear.common.lru_cache import LRUCache
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.events.detector import events_of
from hbgear.continuation.events.event import Event
from hbgear.continuation.problem.base import ContinuationProblem
from hbgear.continuation.problem.curve_equations import CurveEquations
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.concatenation import with_asymptotes
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.tracing.jumps import find_jumps
from hbgear.continuation.tracing.state import set_up
from hbgear.harmonic.contact_instants.branches import ExactBranchPoint, ExactPeriodDoubling, ExactStart
from hbgear.harmonic.contact_instants.coverage import (
    first_curve,
    initial_state,
    reversed_message,
    state_near,
    sufficient_harmonics,
    with_other_curves,
)
from hbgear.harmonic.contact_instants.known_states import KnownStates
from hbgear.harmonic.contact_instants.special_states import exact_or_traced_again, state_of
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.instants.corrector import CurveState, Family
from hbgear.harmonic.instants.equations import Equations, EquationsAt
from hbgear.harmonic.instants.following import Follower
from hbgear.harmonic.instants.observables import regime_of, reporter
from hbgear.harmonic.instants.pattern import InconsistentPatternError
from hbgear.harmonic.instants.refine import ExactMotion, exact_motion_of, solve
from hbgear.harmonic.instants.results import build_exact_branch
from hbgear.harmonic.instants.sampling import coefficients, sample_gaps
from hbgear.harmonic.instants.shooting import Iterate, monodromy_matrix, multipliers_of
from hbgear.harmonic.instants.shooting import linearise as linearise_switches
from hbgear.harmonic.stability.exact_motion import exact_iterate
from hbgear.mechanics.models import Model

CONTACT_INSTANTS = "contact instants"
"""Name of this discretisation in the headers of files."""

MAX_REFINEMENT_DISTANCE = 0.3
"""Distance of an exact motion from given coefficients, relative to them, beyond which it is another motion."""

NEIGHBOURS = 3
"""Number of known points from which Newton's method starts."""


SHORTEST_RESOLVED_CONTACT = 3.0
"""Duration of a contact [rad] times the number of harmonics from which derivatives in all parameters agree with the
exact motion to 1e-3; with 1.2 one of them was 13 percent off, although the fold itself agreed to 1e-6."""


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

    Of ``steps`` in `trace`, ``max_points`` applies, and ``max_step`` changes the largest step in proportion. The other
    limits follow from the multipliers, the turn of the tangent and the correction of each step.

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
        super().__init__(model, harmonics=sufficient_harmonics(harmonics, model, nu), nu=nu, orders="all")
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
        self, X: Array, points: int | None = None, max_step: float | None = None, **parameters: float
    ) -> ComplexArray:
        """Return the multipliers of the exact motion near X, largest first; ``points`` and ``max_step`` are unused."""
        return multipliers_of(monodromy_matrix(linearise_switches(*self._exact_iterate(X, parameters))))

    def _exact_iterate(self, X: Array, parameters: Mapping[str, float]) -> tuple[EquationsAt, Iterate]:
        """Return the equations at the parameters, and the contact instants of the exact motion near X."""
        return self._equations_at(parameters), self.exact_state(X, "Omega", parameters).iterate

    def _equations_at(self, parameters: Mapping[str, float]) -> EquationsAt:
        """Return the equations of the exact motion at the parameters."""
        return self.compiled(parameters).contact_equations.at(float(parameters["Omega"]))

    def exact_state(self, X: Array, name: str, parameters: Mapping[str, float]) -> CurveState:
        """Return the exact motion near coefficients X as the state of a curve in a parameter.

        Newton's method starts from the nearest points of the branch of this problem, if it has one, whose short
        contacts are not visible in X; else from the switching times of X.
        """
        ode = self._equations_at(parameters)
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
        state = state_of(self, point)
        if state is None:
            return form.from_point(point)
        ode = self._equations_at(point.parameters)
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
        regime, error = regime_of(iterate.pattern, ode.equations.first), coefficients(ode, iterate, self.H)[1]
        observed: dict[str, Any] = {"regime": regime, "instants": np.sort(iterate.tau % ode.period), "error": error}
        if stability:
            observed["multipliers"] = multipliers_of(monodromy_matrix(linearise_switches(ode, iterate)))
        return observed

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
            return Equations(self.model_at({**fixed, name: value}).system(), self.nu).at(float(fixed["Omega"]))

        return _stored(equations_at, name)

    def own_trace(
        self,
        span: tuple[float, float],
        start: Point | BranchStart | Array | None,
        settings: Any,
        cover: bool,
        unresolved: bool = False,
    ) -> Branch:
        """Return the curve of exact motions over a span of a parameter; see `hbgear.harmonic.instants.following`.

        With ``cover``, a span that the curve does not cover is searched for others: from the other end, then from the
        inside. A curve without a first solution is followed from the other end only.

        Raises
        ------
        ValueError
            If the trace asks for events that are not located on these curves.
        """
        if missing := other_events(settings):
            raise ValueError(
                f"curves in contact instants have no {', '.join(missing)}: use hb.analysis.peaks(curve) for peaks, or "
                "trace a HarmonicBalance"
            )
        if start is not None:
            return self.traced_curve(span, start, settings, False)
        branch, first = first_curve(self, span, settings, cover)
        branch = branch if first == span else reversed_message(branch, span)
        searched = cover and branch.status is not Status.INTERRUPTED
        return with_other_curves(self, branch, span, settings) if searched else branch

    def traced_curve(self, span: tuple[float, float], start: Any, settings: Any, softer: bool) -> Branch:
        """Return one curve of exact motions, with its jumps; ``softer``: its first motion by softer contacts."""
        setup = set_up(self, settings, span, start, work=Work(math.inf))
        state, direction = self._first_state(setup, start, softer)
        kinds = LOCATED_KINDS if settings.special else tuple(event.kind for event in settings.events)
        family, report = self.family(setup.name, setup.fixed), reporter(settings.progress, setup.name, span)
        curve = Follower(family, setup, bool(kinds), report).run(state, direction)
        events = {event.kind: event for event in events_of(self, setup.name)}
        equations = CurveEquations(self, setup.name, setup.fixed)
        branch = build_exact_branch(equations, family, curve, events, setup)
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
            return initial_state(self, name, parameters, softer), None
        X = self.from_point(start) if isinstance(start, Point) else np.asarray(getattr(start, "X", start))
        if isinstance(start, BranchStart) and isinstance(start.event, ExactStart):
            return start.event
        return state_near(self, self.resized(X), name, parameters), None


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


LOCATED_KINDS = ("LP", "BP", "PD", "NS", "GR", "EP")
"""Special points of curves in contact instants."""


def other_events(settings: Any) -> list[str]:
    """Return the kinds of events that a trace asks for and that are not located in contact instants."""
    return [event.kind for event in settings.events if event.kind not in LOCATED_KINDS]
