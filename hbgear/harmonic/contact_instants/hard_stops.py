"""Hard stops, whose contacts the harmonics of a balance do not resolve: their curves are traced in contact instants."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.status import Status
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.tracing.coverage import uncovered_intervals
from hbgear.harmonic.contact_instants.problem import ContactInstants, other_events
from hbgear.harmonic.contact_instants.special_states import MAX_HARD_COORDINATES
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.harmonic.instants.equations import NotPiecewiseLinear
from hbgear.harmonic.instants.pattern import InconsistentPatternError
from hbgear.harmonic.structure.linear_structure import dense

UNRESOLVED_CONTACT = 2.0
"""Frequency of the closed contact, over the highest harmonic at the lowest Omega, from which it is not resolved."""

HARD_STOP_RATIO = 10.0
"""Frequency of the closed contact over the highest Omega from which stops are hard. It is 14 for a stop of a thousand
times the stiffness of the mass; below it, few harmonics are the choice of the user."""

_TRIED = "contact instants were tried"
"""Begin of the reason for which a curve in contact instants was not completed."""


def trace_hard_stops(
    balance: HarmonicBalance, span: tuple[float, float], start: Any, settings: Any, cover: bool, unresolved: bool
) -> Branch | str | None:
    """Return the curve of a harmonic balance in contact instants if its harmonics do not resolve the contacts.

        w = max sqrt(eig(M^-1 (K + W k W^T))),   w > 2 H Omega_low / nu,   w > 10 Omega_high

    k is the reference stiffness of the laws. Contacts then take less than a quarter of the period of the highest
    harmonic, and less than a twentieth of the period of the excitation. If a trace has shown that the harmonics do not
    resolve the curve (``unresolved``), contacts of constant stiffness are sufficient, and the curves must cover the
    span. A curve that ends at its largest number of points or is interrupted is returned in any case, because it is
    exact as far as it goes. If the curve cannot be completed otherwise, a text states the reason. None is returned for
    other models.
    """
    if settings.parameter != "Omega" or start is not None or balance.auto or balance.selection or balance.is_sampled:
        return None
    if other_events(settings):
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
    except NotPiecewiseLinear:
        return None
    except (NoConvergence, InconsistentPatternError) as error:
        return f"{_TRIED}: {error}"
    stopped = branch.status in (Status.MAX_POINTS, Status.INTERRUPTED)  # exact as far as it goes
    if not (stopped or branch.status.complete):
        return f"{_TRIED}: {branch.message}"
    if unresolved and not stopped and uncovered_intervals([branch, *branch.others], span):
        return f"{_TRIED}: the curves do not cover the span"
    ratio = fastest / min(map(abs, span))
    text = f"traced in contact instants, because H = {balance.H} does not resolve contacts of {ratio:.3g} Omega"
    return replace(branch, message=f"{branch.message}; {text}")


def _contact_frequency(system: Any) -> float:
    """Return the highest natural frequency with closed contacts; 0 if contacts do not raise it."""
    if system.receptances is not None or system.massless:
        return 0.0
    M, K = dense(system.M), dense(system.K)
    k = np.array([e.law.reference for e in system.elements])
    closed = np.abs(np.linalg.eigvals(np.linalg.solve(M, K + (system.W * k) @ system.W.T))).max()
    opened = np.abs(np.linalg.eigvals(np.linalg.solve(M, K))).max()
    return float(np.sqrt(closed)) if closed > 4 * opened else 0.0
