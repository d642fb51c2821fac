"""Harmonics and samples of a balance: those that a motion requires, and the error of those that it has.

    error of resolution    delta X = -J_fine^-1 R_fine(X)

The error of resolution is a Newton step of the balance with twice the harmonics, and more samples of laws evaluated by
the alternating frequency/time method (AFT). It contains two effects that the truncation error does not. Truncated
harmonics change the contact and so act back on the kept ones, which multiplies the error of a motion with stops by up
to 8. With N samples per period, AFT adds the force harmonics k + N, k + 2N, ... to harmonic k; this aliasing is not
small where a law is steep, as the friction force tanh(v / v0). The step of free motions has the change of their
frequency, an unknown, too.

References
----------
Krack & Gross, Harmonic Balance for Nonlinear Vibration Problems (2019), https://doi.org/10.1007/978-3-030-14023-6.
Cameron & Griffin (1989), J. Appl. Mech. 56(1), https://doi.org/10.1115/1.3176036, for AFT.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from hbgear.common.arrays import Array
from hbgear.continuation.numerics.linear import Factors, norm, solve_linear
from hbgear.continuation.problem.base import Observed
from hbgear.continuation.problem.curve_equations import CurveSolutions
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.solvers.newton import SOLVER_ERRORS, NoConvergence, solve
from hbgear.harmonic.equations.discretization import MAX_SAMPLES
from hbgear.harmonic.equations.evaluator import Evaluator, elements_between_breakpoints
from hbgear.harmonic.equations.motion import with_driven_harmonics
from hbgear.harmonic.equations.thresholds import edged_laws
from hbgear.mechanics.laws.vector_laws import Component

CHECK_INTERVAL = 4
"""Points per check of the error of resolution, which costs as much as several evaluations of the balance."""

PROJECTED_CHECK_INTERVAL = 8
"""Points per check of contacts that are projected exactly, whose evaluations cost less than the check."""

MIN_CHECKED_ERROR = 1e-9
"""Truncation error, relative to the motion, up to which it is not checked."""

MAX_CHECKED_UNKNOWNS = 1200
"""Unknowns up to which the error of resolution is computed with twice the harmonics."""

MAX_CHOSEN_SAMPLES = 32_768
"""Samples per period up to which their number is raised automatically."""

CORNER_SAMPLES = 2048
"""Least number of samples per period of laws with breakpoints that lie between samples. A curve has a corner where a
sample passes a breakpoint, and multipliers depend on the samples of slopes that jump there: period doublings of a
rubbing rotor are known to 1e-8, and to 1e-5 with 128 samples."""

MAX_ALIASING = 1e-5
"""Change of a motion by twice the samples, relative to its size, for which a number of samples is accepted."""


def with_enough_samples(problem: Any, X: Array, parameters: Mapping[str, float]) -> Any:
    """Return a balance with as many samples as the AFT of a motion requires.

    They are doubled until aliasing changes the motion by less than 1e-5 of its size. A law with breakpoints has
    `CORNER_SAMPLES` or more, because the motion may reach its breakpoints later on the curve.
    """
    limit = min(MAX_SAMPLES // max(problem.m, 1), MAX_CHOSEN_SAMPLES)
    best, motion = problem, X
    min_samples = min(limit, CORNER_SAMPLES) if _samples_have_corners(problem.compiled(parameters)) else 0
    if min_samples > best.N:
        best = best.denser(math.ceil(min_samples / best.N))
    while limit >= 2 * best.N:
        denser = best.denser(2)
        if norm(_newton_step(denser, motion, parameters)) <= MAX_ALIASING * norm(motion):
            break
        best = denser
        with suppress(NoConvergence):
            motion = solve(best, motion, parameters).X
    return best


def _samples_have_corners(evaluator: Evaluator) -> bool:
    """Return whether the slope of a law that is evaluated by AFT jumps between samples."""
    divided = elements_between_breakpoints(evaluator)
    scalar = (law for j, law in evaluator.aft_laws if not isinstance(law, Component) and j not in divided)
    return any(law.breakpoints for law in scalar) or bool(edged_laws(evaluator))


def _newton_step(problem: Any, X: Array, parameters: Mapping[str, float]) -> Array:
    """Return the Newton step (n,) of a problem at a motion; nan where its Jacobian is singular."""
    R, J = problem.evaluate(X, **parameters)
    try:
        return solve_linear(J, -R)
    except np.linalg.LinAlgError:
        return np.full(len(X), np.nan)


def add_resolution_error(problem: Any, solutions: CurveSolutions, observed: Observed) -> None:
    """Replace ``"error"`` by the error of resolution where this is larger.

    Some of successive motions are checked. Between them, the error of laws evaluated by AFT, of damped contacts and of
    friction is interpolated. For stops, the ratio to the truncation error, which is zero without contact, is
    interpolated instead. With friction, this ratio has a minimum wherever a truncated harmonic is in resonance with the
    stuck slider.
    """
    X, parameters_at = solutions.X, solutions.parameters_at
    if not len(X):
        return
    evaluator, truncation = problem.compiled(parameters_at(0)), np.array([entry["error"] for entry in observed])
    if not (evaluator.aft_laws or evaluator.damped or evaluator.sliders or len(evaluator.breakpoints)):
        return
    checked, interval, unit = np.arange(len(X)), CHECK_INTERVAL, np.ones(len(X))
    if not (evaluator.aft_laws or evaluator.damped):
        checked = np.flatnonzero(truncation > MIN_CHECKED_ERROR * np.linalg.norm(X, axis=1))
        if not evaluator.sliders:
            interval, unit = PROJECTED_CHECK_INTERVAL, truncation
    subset = every(interval, checked)
    ratios = [max(_resolution_error(problem, X[i], parameters_at(i)), truncation[i]) / unit[i] for i in subset]
    for i in checked.tolist() if ratios else ():
        observed[i]["error"] = float(np.fmax(truncation[i], unit[i] * np.interp(i, subset, ratios)))


def every(interval: int, points: np.ndarray) -> np.ndarray:
    """Return one of each ``interval`` successive points, from the middle of the first ones; at least one of any."""
    return points[min(interval // 2, max(len(points) - 1, 0)) :: interval]


def finer_balance(problem: Any, parameters: Mapping[str, float]) -> Any:
    """Return the balance with twice the harmonics, and more samples per harmonic of laws evaluated by AFT.

    There are four times as many, or twice as many of a law with breakpoints, whose number is large. The harmonics are
    the same if twice as many are too many, or a reduced or measured structure is not known at their frequencies. None
    is returned if the samples are too many as well, or are not used.
    """
    evaluator, refined = problem.compiled(parameters), problem.refined_problem
    is_unreduced = problem.models.reduced_for is None and math.isinf(evaluator.structure.highest)
    has_room = 2 * problem.size <= MAX_CHECKED_UNKNOWNS and problem.discretization.fits(2 * problem.H)
    can_double = has_room and (is_unreduced or refined is not None)
    if not evaluator.aft_laws:
        return (refined or problem.denser(1, 2)) if can_double else None
    factor = 2 if _samples_have_corners(evaluator) else 4
    for harmonics in (2, 1) if can_double else (1,):
        with suppress(ValueError):
            return problem.denser(factor, harmonics)
    return None


def _resolution_error(problem: Any, X: Array, parameters: Mapping[str, float]) -> float:
    """Return the rms distance of a motion from the one with more samples and harmonics; nan if it is unknown."""
    refined = finer_balance(problem, parameters)
    if refined is None:
        return math.nan
    start = refined.resized(X)
    weight = rms_weights(refined)
    sliders = bool(refined.slider_names)
    return norm(weight * change_to_solution(refined, start, weight, parameters, "Omega", sliders))


def rms_weights(problem: Any) -> Array:
    """Return the weights (n,) with which the norm of the unknowns of a balance is the rms of all elements."""
    return np.sqrt(np.where(np.arange(problem.size) % (problem.size // problem.m) == 0, 1.0, 0.5))


def change_to_solution(
    problem: Any, start: Array, weight: Array, parameters: Mapping[str, float], name: str, sliders: bool = False
) -> Array:
    """Return the change (n,) of unknowns to a solution of a problem, with weights (n,); nan if it is unknown.

    It is the Newton step at the same parameters if a second step with the same Jacobian is shorter (Deuflhard's natural
    monotonicity test). Next to a fold in the parameter ``name`` it is not, because the other motion is far away or does
    not exist. Then the parameter is free, and the change to the curve is returned; a change of the parameter, relative
    to its size, weighs as much as that of the motion relative to its own. If a free parameter changes the step little,
    there is no fold: the force is so steep that one step is inaccurate, and Newton's method is completed. With friction
    sliders it always is, because the order of their stops changes within the step.
    """
    R, J, slope, _ = problem.linearise(start, name, **parameters)
    unknown = np.full(len(start), np.nan)
    try:
        factors = Factors(J)
        step, tangent = factors.solve(np.column_stack([-R, -slope])).T
        if not np.isfinite(step).all():
            return unknown
        second = factors.solve(-problem.linearise(start + step, "", **parameters).R)
    except np.linalg.LinAlgError:
        return unknown
    if norm(weight * second) <= norm(weight * step):
        return step
    direction, size = weight * tangent, norm(weight * start) / problem.unit_of(name, parameters[name])
    to_curve = step - (weight * step @ direction) / (direction @ direction + size**2) * tangent
    if sliders or norm(weight * to_curve) > STEP_WITHOUT_FOLD * norm(weight * step):
        with suppress(*SOLVER_ERRORS):
            return solve(problem, start, parameters).X - start
    return to_curve


STEP_WITHOUT_FOLD = 0.2
"""Distance from a curve over the Newton step at the same parameters, above which the point is not next to a fold."""


def add_errors_of_free_motions(
    problem: Any, finer: Any, balance: Any, solutions: CurveSolutions, observed: Observed
) -> None:
    """Replace ``"error"`` by the Newton step of a finer problem, and add ``"unknown_errors"``.

    The truncation error is that of a motion with a given frequency, and is infinite where a truncated harmonic is in
    resonance.

    Some of successive motions are checked. Between them the error of the motion is interpolated. ``balance`` is that of
    the finer problem. If it is None, the errors of the parameters are unknown.
    The frequency may be much less accurate than the motion: with 16 harmonics, that of a mode with a stiff friction
    slider is 6 % off, and the motion of given amplitude 0.6 %.
    """
    X, name = solutions.X, solutions.name
    subset = every(CHECK_INTERVAL, np.arange(len(X)))
    if balance is None:
        for i in subset:
            observed[i]["unknown_errors"] = dict.fromkeys(problem.unknown_parameters, np.nan)
        return
    errors = []
    for i in subset:
        start, at = finer.resized(X[i]), solutions.parameters_at(i)
        weight = np.append(rms_weights(balance), np.zeros(len(problem.unknown_parameters)))
        bordered = finer.with_borders_at(start, at, renew=True)
        change = change_to_solution(bordered, start, weight, at, name, bool(balance.slider_names))
        observed[i]["unknown_errors"] = relative_changes(finer, start, change)
        errors.append(norm(weight * change))
    known = np.isfinite(errors)
    if known.any():
        for i, error in enumerate(np.interp(np.arange(len(X)), subset[known], np.array(errors)[known])):
            observed[i]["error"] = float(error)


def relative_changes(problem: Any, X: Array, change: Array) -> dict[str, float]:
    """Return the change of each unknown parameter, relative to its size, from the change (n,) of the unknowns."""
    (_, before), (_, after) = problem.split(X), problem.split(X + change)
    return {name: abs(after[name] - x) / max(abs(x), problem.smallest_scale(name)) for name, x in before.items()}


def largest_amplitudes(problem: Any, curve: Branch) -> Array:
    """Return the largest amplitude of each order 1, 2, ... of Omega in any element and at any point of a curve.

    Amplitudes of orders that are not unknowns of the problem, a `HarmonicBalance`, are the response to the truncated
    force harmonics up to 2H.
    """
    motions = []
    for i, x in enumerate(curve.X):
        parameters = curve.parameters_at(i)
        X = problem.from_layout(x, curve.layout)
        motions.append(with_driven_harmonics(problem.compiled(parameters), X[None], np.array([parameters["Omega"]]))[0])
    rows = np.array(motions).reshape(len(motions), problem.m, -1)
    cosine, sine = (rows[..., 2 * problem.nu - offset :: 2 * problem.nu] for offset in (1, 0))
    return np.hypot(cosine, sine).max(axis=(0, 1))
