"""Curves of exact motions over a whole span: their first motions, from either end and from the inside of the span.

The first motion is a solution of the harmonic balance. Truncation may change the number of hard contacts; then it is
found from softer contacts, which are made harder step by step.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial, reduce
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.common.ranges import counted
from hbgear.continuation.curve.segment import BranchStart
from hbgear.continuation.problem.work import Work
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.tracing.coverage import (
    UNCOVERED,
    CoverageSearch,
    cover_span,
    coverage_message,
    reversed_span_message,
)
from hbgear.continuation.tracing.state import set_up
from hbgear.harmonic.contact_instants.branches import ExactStart
from hbgear.harmonic.contact_instants.known_states import KnownStates
from hbgear.harmonic.equations.discretization import MAX_COUNT
from hbgear.harmonic.equations.harmonic_selection import tooth_orders
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.instants.corrector import CurveState
from hbgear.harmonic.instants.pattern import InconsistentPatternError
from hbgear.harmonic.stability.exact_motion import exact_iterate, iterate_by_stiffness
from hbgear.mechanics.models import Model

START_HARMONICS = 32
"""Most harmonics of the balance whose motion is the first guess: with 128 the search takes a minute for a hard stop."""


def sufficient_harmonics(harmonics: int, model: Model, nu: int) -> int:
    """Return the number of harmonics, or the largest base order of the excitation if it is higher."""
    counted("harmonics", harmonics, MAX_COUNT)
    counted("nu", nu, MAX_COUNT)
    return max(int(harmonics), int(nu) * max(tooth_orders(model.system())))


def initial_state(problem: Any, name: str, parameters: Mapping[str, float], softer: bool) -> CurveState:
    """Return an exact motion found by the balance, or by the balance of ``softer`` contacts."""
    H = min(problem.H, sufficient_harmonics(START_HARMONICS, problem.model, problem.nu))
    if softer:
        balance = partial(HarmonicBalance, harmonics=H, nu=problem.nu, orders="all")
        system, Omega = problem.compiled(parameters).system, float(parameters["Omega"])
        return CurveState.of(iterate_by_stiffness(balance, system, problem.nu, Omega), float(parameters[name]))
    coarse = problem.with_order(problem.nu, H)
    return coarse.exact_state(coarse.balance.start(**parameters), name, parameters)


def state_near(problem: Any, X: Array, name: str, parameters: Mapping[str, float]) -> CurveState:
    """Return the exact motion near coefficients; close to a fold or a cusp, which is singular, at a free Omega."""
    try:
        return problem.exact_state(X, name, parameters)
    except NoConvergence:
        if name != "Omega":
            raise
        with suppress(NoConvergence, InconsistentPatternError):
            ode, iterate = exact_iterate(problem, X, parameters, free=True)
            return CurveState.of(iterate, ode.Omega)
        raise


def first_curve(
    problem: Any, span: tuple[float, float], settings: Any, either_end: bool
) -> tuple[Branch, tuple[float, float]]:
    """Return a curve and its span: from either end if ``either_end``, also from motions of softer contacts.

    Contacts that harmonics do not resolve at the begin of a span of falling frequency are not resolved at its end.
    """
    failure: NoConvergence | None = None
    attempts = [(softer, ends) for softer in (False, True) for ends in ((span, span[::-1]) if either_end else (span,))]
    if settings.parameter == "Omega" and span[0] > span[1]:
        attempts.sort(key=lambda attempt: attempt[1] is not span)
    for softer, ends in attempts:
        try:
            return problem.traced_curve(ends, None, settings, softer), ends
        except NoConvergence as error:
            failure = failure or error
    assert failure is not None
    raise failure


def with_other_curves(problem: Any, branch: Branch, span: tuple[float, float], settings: Any) -> Branch:
    """Return a branch with further curves where it does not cover the span, and a message on the coverage.

    First motions inside of the span are those of softer contacts: the balance fails there more often, and takes longer.
    """
    setup, others = set_up(problem, settings, span, None, work=Work(math.inf)), list[Branch]()
    traced, message = [branch], branch.message

    def follow(span: tuple[float, float], start: BranchStart | None, rough: bool) -> Branch:
        """Return a further curve; Ctrl-C ends the search too."""
        part = (
            first_curve(problem, span, settings, False)[0]
            if start is None
            else (problem.traced_curve(span, start, settings.points_only() if rough else settings, False))
        )
        if part.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        traced.append(part)
        return part

    def start_at(value: float, X: Array | None) -> BranchStart:
        """Return a start at a value of the parameter: near coefficients, or at a motion of softer contacts."""
        parameters, size = setup.parameters_at(value), problem.size
        found = None if X is not None else ExactStart(initial_state(problem, setup.name, parameters, True), None)
        return BranchStart(np.zeros(size) if X is None else X, parameters, np.zeros(size + 1), event=found)

    try:
        search = CoverageSearch(follow, start_at, settings.newton if settings.special else None)
        cover_span(branch, others, span, search, inside=branch.status in UNCOVERED)
    except KeyboardInterrupt:
        branch, message = replace(branch, status=Status.INTERRUPTED), f"{message}; interrupted during the search"
    texts = [message, coverage_message(branch, others, span)]
    texts += [f"it ended early, {other.message}" for other in others if not other.status.complete]
    known = reduce(KnownStates.joined, (part.problem.known_states for part in traced if part.problem))
    return replace(
        branch, others=tuple(_knowing(other, known) for other in others), message="; ".join(filter(None, texts))
    )


def _knowing(curve: Branch, known: KnownStates) -> Branch:
    """Return a curve that was traced in two directions with a problem that knows the motions of all its points."""
    if curve.problem is None or len(curve) <= len(curve.problem.known_states.states):
        return curve
    problem = copy.copy(curve.problem)
    problem.known_states = known
    return replace(curve, problem=problem)


def reversed_message(branch: Branch, span: tuple[float, float]) -> Branch:
    """Return a branch with the message that it was followed from the other end of the span."""
    return replace(branch, message=f"{branch.message}; {reversed_span_message(branch.parameter, span[0])}")
