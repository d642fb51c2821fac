"""Exact motions near solutions of harmonic balance with piecewise-linear laws; see `hbgear.harmonic.instants`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.harmonic.instants.equations import Equations, EquationsAt
from hbgear.harmonic.instants.refine import Approximation, ExactMotion, initial, refine, solve
from hbgear.harmonic.instants.shooting import Iterate


def refine_motion(problem: Any, X: Array, parameters: Mapping[str, float]) -> ExactMotion:
    """Compute the exact motion at the same parameters, near a solution of harmonic balance.

    Parameters
    ----------
    problem : HarmonicBalance
        The problem of the solution.
    X : array_like, shape (n,)
        Unknowns of the solution.
    parameters : dict of str to float
        Omega, and the parameters of the model that differ from its own.

    Returns
    -------
    ExactMotion
        Contact instants, states and multipliers without truncation error.

    Raises
    ------
    NotPiecewiseLinear
        If a law of the model is not piecewise linear, or the structure is too large.
    NoConvergence
        If Newton's method does not converge. Close to a fold there may be no motion at this Omega; see
        `refine_near_fold`.

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
    return _refine(problem, X, parameters, free=False)


def refine_near_fold(problem: Any, X: Array, parameters: Mapping[str, float]) -> ExactMotion:
    """Compute the exact motion nearest to a solution of harmonic balance, at a free Omega.

    Close to a fold that truncation has displaced there is no exact motion at the same Omega. Parameters and exceptions
    are the same as in `refine_motion`.
    """
    return _refine(problem, X, parameters, free=True)


def exact_iterate(
    problem: Any, X: Array, parameters: Mapping[str, float], free: bool = False
) -> tuple[EquationsAt, Iterate]:
    """Return the equations and the contact instants of the exact motion near a solution of harmonic balance.

    With ``free``, Omega may change. Exceptions are those of `refine_motion`, and InconsistentPatternError.
    """
    equations, approximation = _approximation(problem, X, parameters)
    at = equations.at(float(parameters["Omega"]))
    return solve(at, initial(at, approximation), free)[:2]


def _refine(problem: Any, X: Array, parameters: Mapping[str, float], free: bool) -> ExactMotion:
    """Compute the exact motion from the switching times of a solution, at its Omega or at a free one."""
    equations, approximation = _approximation(problem, X, parameters)
    return refine(equations, approximation, float(parameters["Omega"]), free)


def _approximation(problem: Any, X: Array, parameters: Mapping[str, float]) -> tuple[Equations, Approximation]:
    """Return the equations, and the switching times and Fourier coefficients of a solution."""
    compiled = problem.compiled(dict(parameters))
    values = {name: float(value) for name, value in parameters.items()}
    crossings = compiled.crossings(X)
    number = np.concatenate([np.arange(len(b)) for b in compiled.contact_equations.breakpoints]).astype(int)
    found = [
        (float(theta * problem.nu), int(compiled.element[row]), int(number[row]), int(sign))
        for row, theta, sign in zip(crossings.row, crossings.theta, crossings.sign, strict=True)
    ]
    return compiled.contact_equations, Approximation(problem.motion(X, **values), found)
