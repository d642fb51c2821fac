"""Exact motions near solutions of harmonic balance with piecewise-linear laws; see `hbgear.harmonic.instants`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NoConvergence
from hbgear.harmonic.equations.motion import coordinates
from hbgear.harmonic.instants.equations import Equations, EquationsAt
from hbgear.harmonic.instants.pattern import InconsistentPatternError
from hbgear.harmonic.instants.refine import Approximation, ExactMotion, initial, refine, solve
from hbgear.harmonic.instants.shooting import Iterate
from hbgear.mechanics.laws.laws import Law, Parallel
from hbgear.mechanics.models import System


def refine_motion(problem: Any, X: Array, parameters: Mapping[str, float], free: bool = False) -> ExactMotion:
    """Compute the exact motion near a solution X (n,) of harmonic balance.

    The parameters are Omega, and those that differ from the model. With ``free``, Omega may change: close to a fold
    that truncation has displaced there is no exact motion at the same Omega. NotPiecewiseLinear is raised if a law of
    the model is not piecewise linear, or the structure is too large, NoConvergence if Newton's method does not
    converge.

    Examples
    --------
    >>> import hbgear as hb
    >>> from hbgear.harmonic.stability.exact_motion import refine_motion
    >>> stop = hb.Element([1.0], hb.Unilateral(k=20.0, gap=0.5))
    >>> model = hb.System([[1.0]], [[0.1]], [[1.0]], [stop], hb.Load(cosine={1: [0.3]}))
    >>> problem = hb.HarmonicBalance(model, 16)
    >>> exact = refine_motion(problem, problem.start(Omega=1.0), {"Omega": 1.0})
    >>> len(exact.instants), bool(exact.residual < 1e-10), bool(exact.distance < 1e-2)
    (2, True, True)
    """
    equations, approximation = _approximation(problem, X, parameters)
    return refine(equations, approximation, float(parameters["Omega"]), free)


def exact_iterate(
    problem: Any, X: Array, parameters: Mapping[str, float], free: bool = False
) -> tuple[EquationsAt, Iterate]:
    """Return the equations and the contact instants of the exact motion near a solution of harmonic balance.

    With ``free``, Omega may change. Exceptions are the same as for `refine_motion`, and InconsistentPatternError.
    """
    equations, approximation = _approximation(problem, X, parameters)
    ode = equations.at(float(parameters["Omega"]))
    return solve(ode, initial(ode, approximation), free)[:2]


def iterate_by_stiffness(balance: Callable[[System], Any], system: System, nu: int, Omega: float) -> Iterate:
    """Return the contact instants of an exact motion of hard contacts, by continuation in their stiffness.

    Truncation may change the number of hard contacts, so that no exact motion is near the solution of harmonic balance.
    The forces of all elements are divided by powers of `SOFTENING` until an exact motion is found. They are increased
    to the forces of the system in steps, each with Newton's method from the instants of the step before. ``balance``
    returns the harmonic balance of a system.

    Raises
    ------
    NoConvergence
        If no motion of softer contacts is found, or the stiffness cannot be increased to that of the system.
    """
    factor, iterate = _softened_motion(balance, system, nu, Omega)
    ratio = STIFFNESS_RATIO
    while factor < 1.0:
        harder = min(1.0, factor * ratio)
        try:
            iterate = solve(Equations(system, nu, harder).at(Omega), iterate, False)[1]
        except (*SOLVER_ERRORS, InconsistentPatternError) as error:
            ratio **= 0.5
            if ratio < MIN_STIFFNESS_RATIO:
                message = (
                    f"no exact motion found with more than {factor:.3g} times the stiffness of the elements: {error}"
                )
                raise NoConvergence(message, np.zeros(0), {"Omega": Omega}, []) from error
        else:
            factor, ratio = harder, min(ratio**1.5, MAX_STIFFNESS_RATIO)
    return iterate


def _softened_motion(balance: Callable[[System], Any], system: System, nu: int, Omega: float) -> tuple[float, Iterate]:
    """Return a factor of the forces of all elements, and an exact motion of the system with these forces."""
    for power in range(1, MAX_SOFTENINGS + 1):
        factor = SOFTENING**-power
        elements = [replace(element, law=_scaled(element.law, factor)) for element in system.elements]
        softer = balance(replace(system, elements=elements))
        with suppress(*SOLVER_ERRORS, InconsistentPatternError):
            approximation = _approximation(softer, softer.start(Omega=Omega), {"Omega": Omega})[1]
            ode = Equations(system, nu, factor).at(Omega)
            return factor, solve(ode, initial(ode, approximation), False)[1]
    message = f"no exact motion found, even with 1e-{MAX_SOFTENINGS} times the stiffness of the elements"
    raise NoConvergence(message, np.zeros(0), {"Omega": Omega}, [])


def _scaled(law: Law, factor: float) -> Law:
    """Return a piecewise-linear law with its force times a factor."""
    springs = [
        replace(spring, slopes=tuple(factor * k for k in spring.slopes), force_at_zero=factor * spring.force_at_zero)
        for spring in law.piecewise or ()
    ]
    return springs[0] if len(springs) == 1 else Parallel(tuple(springs))


SOFTENING, MAX_SOFTENINGS = 10.0, 4
"""Ratio of the forces of all elements from one softer system to the next, and the number of such systems."""


STIFFNESS_RATIO, MIN_STIFFNESS_RATIO, MAX_STIFFNESS_RATIO = 2.0, 1.01, 4.0
"""First, smallest and largest ratio of the forces of all elements in a step of the continuation in stiffness."""


def _approximation(problem: Any, X: Array, parameters: Mapping[str, float]) -> tuple[Equations, Approximation]:
    """Return the equations, and the switching times and Fourier coefficients of a solution."""
    compiled = problem.compiled(parameters)
    crossings, equations = compiled.crossings(X), compiled.contact_equations
    number = np.concatenate([np.arange(len(e.law.breakpoints)) for e in equations.given.elements]).astype(int)
    instants = [
        (float(theta * problem.nu), int(compiled.element[row]), int(number[row]), int(sign))
        for row, theta, sign in zip(crossings.row, crossings.theta, crossings.sign, strict=True)
        if equations.first[compiled.element[row]] == compiled.element[row]
    ]
    rows = coordinates(compiled, X, float(parameters["Omega"]))  # of the reduced structure, if the structure is large
    return equations, Approximation(rows, instants)
