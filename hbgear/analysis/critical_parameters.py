"""Critical parameters: values of a design parameter at which a jump appears or vanishes.

At such a value two folds meet in a cusp of the fold curve in the design parameter.

References
----------
Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), https://doi.org/10.1137/1.9780898719543.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hbgear.analysis.fold_curves import (
    check_parameter,
    fold_equations,
    folds_of,
    on_fold_curve,
    problem_of,
    report_progress,
    response_curve,
)
from hbgear.common.argument_checks import checked_arguments
from hbgear.common.process.progress import ProgressCallback
from hbgear.continuation.events.fold import TURNING_KINDS
from hbgear.continuation.results.branch import Branch
from hbgear.continuation.results.point import SpecialPoint
from hbgear.continuation.results.status import Status
from hbgear.continuation.results.termination import Termination, raise_if_interrupted
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.continuation.stepping.control import StepControl
from hbgear.continuation.tracing.trace import trace
from hbgear.harmonic.harmonic_balance import HarmonicBalance
from hbgear.mechanics.models import Model

_MAX_PARAMETER_RATIO = 5.0
"""Range in which a fold is followed, over the value of the parameter in the model."""

_MIN_PARAMETER_RATIO = 0.01
"""Smallest value to which a fold is followed, over its own value; folds are not followed through zero.

Fold curves change ever faster towards zero, where the model has no load, no gap or no damping.
"""

_FOLD_STEPS = StepControl(first_step=0.002, max_step=0.1, max_points=300)
"""Step sizes of fold curves. A small first step resolves a cusp near the start; most are almost straight afterwards."""

_NARROW = 0.01
"""Relative distance of two successive cusps up to which they are left out: one fold replaces another there.

A fold curve turns twice where its motion grazes, within 1e-4 of the parameter. The jump exists on both sides.
"""

_MAX_CURVES_WITHOUT_CUSP = 6
"""Number of fold curves without a cusp after which the search ends."""


class NoFoldError(ValueError):
    """No jump that appears or vanishes was found at any value of the parameter.

    Examples
    --------
    >>> import hbgear as hb
    >>> try:
    ...     hb.analysis.critical_parameter(hb.Duffing(), "zeta", frequencies=(0.5, 0.55), harmonics=1)
    ... except hb.analysis.NoFoldError:
    ...     print("far below its resonance a Duffing oscillator does not jump")
    ...
    far below its resonance a Duffing oscillator does not jump
    """


@dataclass(frozen=True)
class CriticalParameter:
    """Value of a parameter at which a jump appears or vanishes.

    Attributes
    ----------
    parameter : str
        Name of the parameter.
    value : float
        Value of the parameter at the cusp.
    Omega : float
        Frequency of the cusp.
    point : SpecialPoint
        Motion at the cusp.
    folds : Branch
        Fold curve with the cusp.
    jump_below : bool
        True if the jump exists below the value, False if above. Other jumps may remain on the other side: see
        ``others``.
    others : tuple of tuple of float
        Value and Omega of further cusps, at which other jumps appear or vanish.
    status : Status
        Complete if all folds of the response curve were followed. If not, another cusp may be nearer.
    message : str
        Reason of an early end, and advice.

    Examples
    --------
    >>> import hbgear as hb
    >>> critical = hb.analysis.critical_parameter(hb.Duffing(), "zeta", frequencies=(0.9, 1.4), harmonics=1)
    >>> critical.point.kind, critical.point.parameters["zeta"] == critical.value
    ('CP', True)
    """

    parameter: str
    value: float
    Omega: float
    point: SpecialPoint
    folds: Branch
    jump_below: bool
    others: tuple[tuple[float, float], ...] = ()
    status: Status = Status.REACHED_END
    message: str = ""


class FoldCusp(NamedTuple):
    """Cusp of a fold curve, the fold curve, and True if the jump exists below the value of the cusp."""

    point: SpecialPoint
    folds: Branch
    jump_below: bool


@checked_arguments(parameter="the name of a parameter, such as 'zeta'")
def critical_parameter(
    model: Model | HarmonicBalance,
    parameter: str,
    *,
    frequencies: tuple[float, float] | None = None,
    harmonics: int = 16,
    progress: ProgressCallback | None = None,
) -> CriticalParameter:
    """Find the value of a parameter at which a jump appears or vanishes, nearest to the value of the model.

    The response curve of the model is searched for folds. If it has none, response curves at values with increasing
    distance on both sides are searched, within the range of the parameter. Each fold is followed in the parameter to
    its cusps, or over five times the value of the model, and towards zero to a hundredth of the value. Two cusps within
    1 % of each other, as next to a grazing of the fold, are left out.

    Parameters
    ----------
    model : Model or HarmonicBalance
        Model, or its equations with their settings.
    parameter : str
        Name of a float parameter of the model.
    frequencies : tuple of float, optional
        Range of Omega. By default the range of the model.
    harmonics : int, optional
        Harmonic truncation order H if a model is given. The default is 16.
    progress : callable, optional
        Function that is called with a `Progress` after each step, such as ``print``. Its fraction is unknown.

    Returns
    -------
    CriticalParameter
        The value with its motion. After Ctrl-C it is the nearest cusp found before; ``status`` and ``message`` report
        the reason.

    Raises
    ------
    NoFoldError
        If no response curve has a fold, or no fold curve a cusp; the message states the steepest slope of the
        amplitude.
    KeyError, ValueError
        If the model has no such parameter, or the parameter is Omega.
    KeyboardInterrupt
        If Ctrl-C is pressed before a cusp is found.

    Examples
    --------
    >>> import hbgear as hb
    >>> critical = hb.analysis.critical_parameter(hb.Duffing(), "zeta", frequencies=(0.9, 1.4), harmonics=1)
    >>> bool(0.05 < critical.value < 0.1), critical.jump_below
    (True, True)
    """
    problem = problem_of(model, harmonics)
    check_parameter(problem, parameter)
    ending = Termination(advice="points found so far are kept; start the search again for all of them")
    cusps: list[FoldCusp] = []
    try:
        for cusp in find_cusps(problem, parameter, frequencies, progress):
            cusps.append(cusp)  # one by one: after Ctrl-C they remain
    except KeyboardInterrupt as error:
        if not cusps:
            raise
        ending.record_error(error, f"after {len(cusps)} of the points where a jump appears or vanishes")
    model_value = problem.value_of(parameter)
    point, fold, below = min(cusps, key=lambda cusp: abs(cusp.point.parameters[parameter] - model_value))
    other_cusps = [(p.parameters[parameter], p.parameters["Omega"]) for p, *_ in cusps if p is not point]
    return CriticalParameter(
        parameter,
        point.parameters[parameter],
        point.parameters["Omega"],
        point,
        fold,
        below,
        tuple(other_cusps),
        ending.status,
        ending.message_with_advice,
    )


def find_cusps(
    problem: HarmonicBalance,
    parameter: str,
    frequencies: tuple[float, float] | None,
    progress: ProgressCallback | None = None,
) -> Iterator[FoldCusp]:
    """Yield the cusps to which the folds of the first response curve with such folds lead; see `critical_parameter`.

    Cusps of one fold curve follow each other in its order. NoFoldError is raised if no cusp is found.
    """
    p0, allowed = problem.value_of(parameter), problem.range_of(parameter)
    traced: list[Branch] = []
    values: list[float] = []
    slope = ""
    for value in _search_values(p0):
        if len(traced) >= _MAX_CURVES_WITHOUT_CUSP:
            break
        if value not in allowed:
            continue
        try:
            curve = response_curve(problem, parameter, value, frequencies)
        except NoConvergence:
            continue
        count = len(folds_of(curve))
        report_progress(
            progress, f"response curve at {parameter} = {value:.5g}: {count or 'no'} fold{'s' * (count > 0)}"
        )
        values.append(value)
        slope = slope or _steepest_slope(curve)
        has_cusp = False
        for cusp in _follow_to_cusps(problem, parameter, curve, traced, progress):
            has_cusp = True
            yield cusp
        if has_cusp:
            return
    searched = [p0, *values, *(float(p) for fold in traced for p in (fold.values.min(), fold.values.max()))]
    raise NoFoldError(
        f"no jump that appears or vanishes with {parameter} was found from {parameter} = {min(searched):.5g} "
        f"to {max(searched):.5g} (response curves: {len(values)}, fold curves: {len(traced)}); {slope}. "
        "Try another parameter, or a model nearer to a jump"
    )


def _search_values(model_value: float) -> Iterator[float]:
    """Yield the value of the model, then values with increasing distance on both sides."""
    yield model_value
    step = abs(model_value) or 1.0
    for fraction in (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9):
        yield model_value - fraction * step
        yield model_value + step * (1 / (1 - fraction) - 1)


def _follow_to_cusps(
    problem: HarmonicBalance, parameter: str, curve: Branch, traced: list[Branch], progress: ProgressCallback | None
) -> Iterator[FoldCusp]:
    """Follow the folds of a response curve and yield their cusps.

    Each fold curve is appended to `traced`; folds on a fold curve of this list are skipped.
    """
    model_value, allowed = problem.value_of(parameter), problem.range_of(parameter)
    max_change = _MAX_PARAMETER_RATIO * (abs(model_value) or 1.0)
    for point in folds_of(curve):
        if any(on_fold_curve(problem, fold, point, parameter) for fold in traced):
            continue
        try:
            equations, start = fold_equations(problem, point)
        except NoConvergence:  # contacts of the fold are too short
            continue
        value = point.parameters[parameter]
        first = -1 if model_value < value else 1  # towards the value of the model
        for side in (first, -first):
            end = allowed.clipped(value + side * max_change, value)
            if end * value < _MIN_PARAMETER_RATIO * value**2:
                end = _MIN_PARAMETER_RATIO * value
            if end == value:
                continue
            report_progress(
                progress, f"fold at Omega = {point.parameters['Omega']:.5g} followed in {parameter} towards {end:.4g}"
            )
            fold = raise_if_interrupted(trace(equations, parameter, (value, end), start, steps=_FOLD_STEPS))
            traced.append(fold)
            cusps = [p for p in _turns(fold) if p.located]
            for cusp in cusps:  # its value may be the one of more harmonics: points of the curve are compared
                neighbours = fold.values[max(cusp.index - 1, 0) : cusp.index + 2]
                yield FoldCusp(cusp, fold, bool(neighbours.min() < fold.values[cusp.index]))
            if cusps:
                break


def _turns(fold: Branch) -> list[SpecialPoint]:
    """Return the points at which a fold curve turns back, without pairs that are too narrow; see `_NARROW`."""
    turns: list[SpecialPoint] = []
    for point in (p for p in fold.special if p.kind in TURNING_KINDS):
        value = point.parameters[fold.parameter]
        if turns and abs(turns[-1].parameters[fold.parameter] - value) <= _NARROW * abs(value):
            turns.pop()
        else:
            turns.append(point)
    return turns


def _steepest_slope(curve: Branch) -> str:
    """Return the steepest slope of the rms amplitude as text."""
    A, Omega = curve.amplitude("rms"), curve.values
    with np.errstate(all="ignore"):
        slope = np.diff(A) / np.diff(Omega)
    i = int(np.nanargmax(np.abs(np.where(np.isfinite(slope), slope, 0.0))))
    return f"the steepest slope of the rms amplitude is {slope[i]:.3g} at Omega = {0.5 * (Omega[i] + Omega[i + 1]):.5g}"
