"""Periodic motions in contact instants: the second discretisation of models with piecewise-linear laws.

    x_{i+1} = Psi_i x_i + ...,   h(tau_i) = 0          states and phases at the contact instants, see `instants`

There is no truncation: the only tolerance is rounding. Points of a branch hold the exact Fourier coefficients of the
elements up to H, so that measures, files and figures are the same as with `HarmonicBalance`. H has no influence on the
curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.argument_checks import checked_arguments
from hbgear.common.arrays import Array
from hbgear.common.process.progress import Progress
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.events.detector import events_of
from hbgear.continuation.problem.evaluation import Evaluation
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import Point
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.tracing.coverage import coverage_message
from hbgear.continuation.tracing.jumps import find_jumps
from hbgear.continuation.tracing.state import set_up
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.instants.corrector import CurveState, Family
from hbgear.harmonic.instants.equations import Equations, EquationsAt, NotPiecewiseLinear
from hbgear.harmonic.instants.following import ExactCurve, Follower
from hbgear.harmonic.instants.pattern import InconsistentPatternError
from hbgear.harmonic.instants.refine import Approximation, ExactMotion, initial, solve
from hbgear.harmonic.instants.results import build_exact_branch
from hbgear.harmonic.instants.spectrum import coefficients
from hbgear.harmonic.stability.exact_motion import refine_motion
from hbgear.mechanics.models import Model

CONTACT_INSTANTS = "contact instants"
"""Name of this discretisation in the headers of files."""


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
        H, number of harmonics of the results, 16 by default. The curve does not depend on it; ``Branch.error`` is the
        rms of the harmonics that the results leave out.
    nu : int, optional
        Subharmonic order, 1 by default.

    Raises
    ------
    NotPiecewiseLinear
        A ValueError, if a law is not piecewise linear or the structure is too large.

    Notes
    -----
    ``evaluate(X, ...)`` returns X minus the coefficients of the exact motion near X, with the unit matrix as its
    derivative, so that Newton's method returns an exact motion. `follow` uses the equations of the harmonic balance
    with H harmonics.

    References
    ----------
    Stoer & Bulirsch, Introduction to Numerical Analysis (2002), section 7.3, https://doi.org/10.1007/978-0-387-21738-3.

    Examples
    --------
    >>> import hbgear as hb
    >>> stop = hb.Element([1.0], hb.Unilateral(k=1e3, gap=0.5))
    >>> model = hb.System([[1.0]], [[0.1]], [[1.0]], [stop], hb.Load(cosine={1: [0.3]}))
    >>> curve = hb.trace(hb.ContactInstants(model), "Omega", (1.9, 1.5))
    >>> curve.status.complete, curve["LP1"].kind, round(curve["LP1"].parameters["Omega"], 6)
    (True, 'LP', 1.731365)
    """

    @checked_arguments()
    def __init__(self, model: Model, harmonics: int = 16, nu: int = 1) -> None:
        super().__init__(model, harmonics=harmonics, nu=nu)
        self.compiled({}).contact_equations  # noqa: B018  raises NotPiecewiseLinear

    def __repr__(self) -> str:
        return f"ContactInstants({self.model!r}, harmonics={self.H}, nu={self.nu})"

    def describe(self) -> dict[str, Any]:
        """Return model and settings as plain data, for the header of a saved branch."""
        return {**super().describe(), "discretisation": CONTACT_INSTANTS}

    # ---- equations

    def exact_motion(self, X: Array, **parameters: float) -> ExactMotion:
        """Return the exact motion near coefficients X: contact instants, states and multipliers.

        Raises
        ------
        NoConvergence
            If there is no motion near X.
        """
        return refine_motion(self, X, parameters)

    def _exact_state(self, X: Array, name: str, parameters: Mapping[str, float]) -> CurveState:
        """Return the exact motion near coefficients X as the state of a curve in a parameter."""
        compiled = self.compiled(dict(parameters))
        equations, crossings = compiled.contact_equations, compiled.crossings(X)
        number = np.concatenate([np.arange(len(b)) for b in equations.breakpoints]).astype(int)
        found = [
            (float(theta * self.nu), int(compiled.element[row]), int(number[row]), int(sign))
            for row, theta, sign in zip(crossings.row, crossings.theta, crossings.sign, strict=True)
        ]
        at = equations.at(float(parameters["Omega"]))
        guess = Approximation(self.motion(X, **parameters), found)
        _, iterate, _ = solve(at, initial(at, guess), False)
        return CurveState.of(iterate, float(parameters[name]))

    def linearise(self, X: Array, name: str, **parameters: float) -> Evaluation:
        """Return X minus the coefficients of the exact motion near X, and the unit matrix."""
        at = self.compiled(dict(parameters)).contact_equations.at(float(parameters["Omega"]))
        exact = coefficients(at, self._exact_state(X, "Omega", parameters).iterate, self.H)[0].ravel()
        return Evaluation(X - exact, np.eye(len(X)), np.zeros(len(X)), 1.0 + float(np.linalg.norm(X)))

    def evaluate(self, X: Array, **parameters: float) -> tuple[Array, Array]:
        """Return X minus the coefficients of the exact motion near X, and the unit matrix."""
        now = self.linearise(X, "", **parameters)
        return now.R, np.asarray(now.dR_dX)

    def start(self, Omega: float, **parameters: float) -> Array:
        """Return the coefficients of an exact motion at Omega, near a solution of the harmonic balance."""
        X = self.balance.start(Omega=Omega, **parameters)
        return X - self.linearise(X, "", **{**parameters, "Omega": Omega}).R

    @property
    def balance(self) -> HarmonicBalance:
        """The harmonic balance of the same model with the same number of harmonics."""
        return HarmonicBalance(self.model, self.H, nu=self.nu)

    def compiled_continuation(self, name: str, parameters: Mapping[str, float]) -> None:
        """Return None: curves are followed by `own_trace`."""

    def compiled_locator(self, name: str, parameters: Mapping[str, float], which: int) -> None:
        """Return None: special points are located by `own_trace`."""

    @property
    def refined_problem(self) -> None:
        """None: exact motions have no resolution."""

    def observe(self, X: Array, stability: bool = True, **parameters: float) -> dict[str, Any]:
        """Return multipliers, regime and contact instants of the exact motion near X."""
        exact = self.exact_motion(X, **parameters)
        found: dict[str, Any] = {"regime": self.regime(X, **parameters), "instants": exact.instants}
        return found | ({"multipliers": exact.multipliers} if stability else {})

    def observe_many(
        self, X: Array, name: str, values: Array, stability: bool, **parameters: float
    ) -> list[dict[str, Any]]:
        """Return `observe` of solutions X (k, n) at values (k,) of a parameter."""
        return [
            self.observe(x, stability, **{**parameters, name: float(value)}) for x, value in zip(X, values, strict=True)
        ]

    # ---- curves

    def family(self, name: str, fixed: Mapping[str, float]) -> Family:
        """Return the equations as a function of a parameter, the others fixed."""
        if name == "Omega":
            equations = self.compiled(dict(fixed)).contact_equations
            return _remembering(lambda value: equations.at(value))

        def equations_at(value: float) -> EquationsAt:
            model = self.model_at({**fixed, name: value})
            return Equations(model.system(), self.nu).at(float(fixed["Omega"]))

        return _remembering(equations_at)

    def own_trace(
        self, span: tuple[float, float], start: Point | BranchStart | Array | None, settings: Any, cover: bool
    ) -> Branch:
        """Return the curve of exact motions over a span of a parameter; see `hbgear.harmonic.instants.following`.

        With ``cover``, a curve that turns back to its start is followed from the other end as well.
        """
        branch = self._followed(span, start, settings)
        others: tuple[Branch, ...] = ()
        if cover and start is None and branch.status is Status.LEFT_SPAN:
            with suppress(NoConvergence):
                others = (self._followed(span[::-1], None, settings),)
        if not cover or start is not None:
            return branch
        texts = branch.message, coverage_message(branch, others, span)
        return replace(branch, others=others, message="; ".join(text for text in texts if text))

    def _followed(self, span: tuple[float, float], start: Any, settings: Any) -> Branch:
        """Return one curve of exact motions, with its jumps."""
        setup = set_up(self, settings, span, start, work=Work(math.inf))
        state, direction = self._first_state(setup, start)
        ends = setup.span.start, setup.span.end
        follower = Follower(
            self.family(setup.name, setup.fixed), setup.name, ends, settings.steps.max_points, settings.special,
            _reporter(settings.progress, setup.name, span),
        )  # fmt: skip
        curve = follower.run(state, direction)
        events = {event.kind: event for event in events_of(self, setup.name)}
        header = {
            "span": list(ends), "steps": vars(settings.steps), "newton": vars(settings.newton),
            "stability": settings.stability, "accuracy": settings.accuracy, "special": settings.special,
        }  # fmt: skip
        branch = build_exact_branch(
            self, follower.family, setup.name, setup.fixed, curve, events, header, settings.stability
        )
        return replace(branch, jump_records=find_jumps(branch, settings.newton)) if settings.special else branch

    def _first_state(self, setup: Any, start: Any) -> tuple[CurveState, Array | None]:
        """Return the first state of a curve, and its direction if the start gives one."""
        name = setup.name
        value = float(start.parameters.get(name, setup.span.start)) if hasattr(start, "parameters") else setup.span.start
        here = setup.parameters_at(value)
        if start is None:
            X = self.balance.start(**here)
        else:
            X = self.from_point(start) if isinstance(start, Point) else np.asarray(getattr(start, "X", start))
        return self._exact_state(self.resized(X), name, here), None


def _remembering(make: Callable[[float], EquationsAt]) -> Family:
    """Return the function with its last results."""
    known: dict[float, EquationsAt] = {}

    def at(value: float) -> EquationsAt:
        if value not in known:
            if len(known) >= 16:
                known.clear()
            known[value] = make(value)
        return known[value]

    return at


def _reporter(progress: Any, name: str, span: tuple[float, float]) -> Callable[[ExactCurve], None]:
    """Return a function that reports the progress of a curve."""

    def report(curve: ExactCurve) -> None:
        if progress is not None:
            value, step = curve.points[-1].state.value, curve.steps[-1]
            done = min(max((value - span[0]) / (span[1] - span[0]), 0.0), 1.0)
            text = f"{name} = {value:.5f}, {len(curve.points)} points, step {step:.1e}"
            progress(Progress(done, text, {"value": value, "points": len(curve.points), "step": step}))

    return report



UNRESOLVED_CONTACT = 2.0
"""Frequency of the closed contact, over the highest harmonic at the lowest Omega, from which stops are hard."""


def trace_hard_stops(
    balance: HarmonicBalance, span: tuple[float, float], start: Any, settings: Any, cover: bool
) -> Branch | None:
    """Return the curve of a harmonic balance in contact instants if its harmonics do not resolve the contacts.

        max sqrt(eig(M^-1 (K + W k W^T))) > 2 H Omega / nu          k reference stiffness of the laws

    Contacts then take less than a quarter of the period of the highest harmonic. None is returned for other models, and
    if the curve cannot be completed in contact instants.
    """
    if settings.parameter != "Omega" or start is not None or balance.auto or balance.selection or balance.is_sampled:
        return None
    system = balance.compiled({}).system
    if system.n > MAX_HARD_COORDINATES or any(e.law.piecewise is None for e in system.elements):
        return None
    fastest = _contact_frequency(system)
    highest = balance.H * min(map(abs, span)) / balance.nu
    if not fastest > UNRESOLVED_CONTACT * highest:
        return None
    try:
        exact = ContactInstants(balance.model, balance.H, nu=balance.nu)
        branch = exact.own_trace(span, start, settings, cover)
    except (NotPiecewiseLinear, NoConvergence, InconsistentPatternError):
        return None
    if not branch.status.complete:
        return None
    ratio = fastest / min(map(abs, span))
    text = f"traced in contact instants, because H = {balance.H} does not resolve contacts of {ratio:.3g} Omega"
    return replace(branch, message=f"{branch.message}; {text}")


def _contact_frequency(system: Any) -> float:
    """Return the highest natural frequency with closed contacts; 0 if contacts do not raise it."""
    if system.receptances is not None:
        return 0.0
    M, K = (np.asarray(A.toarray() if hasattr(A, "toarray") else A, dtype=float) for A in (system.M, system.K))
    k = np.array([e.law.reference for e in system.elements])
    closed = np.abs(np.linalg.eigvals(np.linalg.solve(M, K + (system.W * k) @ system.W.T))).max()
    open_ = np.abs(np.linalg.eigvals(np.linalg.solve(M, K))).max()
    return float(np.sqrt(closed)) if closed > 4 * open_ else 0.0


MAX_HARD_COORDINATES = 10
"""Coordinates up to which hard stops are traced in contact instants without a request: some seconds at most."""
